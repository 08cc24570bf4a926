"""Indicators of what each level of fidelity leaves out, without a simulation.

From the plan of the rigid level, one pass of first order gives the deflections of the highest model
(`crossing.fuller_model`). A level's torques are then off in two ways, and the larger counts:

* from the torques that the highest model needs for nearly the same motion: over their peak;
* on the platform: the wrench W - G' tau that they lack along the path carries the platform off, and nothing
  corrects the error (`dynamics.open_loop`): over the path's length.

Both are regular at Type 2. The highest model crosses with its own condition (8), and the second divides by
nothing that vanishes there: a rest of t_s . W_p pushes like any other wrench. The error of a level is the
largest of its own and of all levels above: errors that cancel in one of them are luck.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from framework.arrays import Array
from framework.crossing.fuller_model import FullerModel
from framework.crossing.motion_scales import coordinate_sizes, largest_by_unit, path_length
from framework.crossing.result import CrossingPlan
from framework.dynamics.elastic_pass import Pass, evaluate_pass
from framework.dynamics.forces import motor_torque
from framework.dynamics.open_loop import ErrorDynamics, error_dynamics, open_loop_error, open_loop_growth
from framework.dynamics.platform_wrench import platform_wrench
from framework.errors import NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import FLEXIBILITIES
from framework.model.fidelity_levels import LEVELS

INSTANTS = 65  # of the motion at which the dynamics of an error of the platform are computed
STEPS = 512  # by which it is integrated


class Indicators(NamedTuple):
    """The estimated error of each level, and its indicators in words."""

    error: Mapping[str, float]
    words: Mapping[str, str]
    growth: float  # of what is off, by weight and torques that nothing corrects; see `open_loop_growth`

    def choose_level(self, tolerance: float) -> str:
        """Choose the least level whose error is within the tolerance."""
        return next(name for name, error in self.error.items() if error <= tolerance)


class LevelError(NamedTuple):
    """The error of a level as estimated: of torques over their peak, of the platform over the path."""

    torque: float
    platform: float


def indicators_of(
    rigid: CrossingPlan | None, payload: CrossingPlan | None, highest: ParallelRobot
) -> Indicators:
    """Compute the indicators of a motion from the plans of its two levels without springs.

    Args:
        rigid, payload: the plans of these levels, None where there is none.
        highest: the highest model.
    """
    with suppress(NoAnswer):  # at the border of the workspace, or with springs too soft
        if rigid is not None:
            return _accumulate_errors(
                _Motion.of(rigid, highest).errors(payload), open_loop_growth(rigid.dynamics)
            )
    return _accumulate_errors({}, np.inf)  # unknown: every effect may matter


def _accumulate_errors(errors: Mapping[str, LevelError], growth: float) -> Indicators:
    """Accumulate errors from the highest level down: lower levels leave out at least as much.

    An error that is not a number is unknown and counts as infinite.
    """
    names = [level.name for level in LEVELS]
    counted = {name: np.where(np.isfinite(one), one, np.inf) for name, one in errors.items()}
    largest = [0.0, *(counted.get(name, np.array(np.inf)).max() for name in reversed(names[:-1]))]
    words = {
        name: f"torques {percent(torque)}, platform {percent(platform)}"
        for name, (torque, platform) in counted.items()
    }
    return Indicators(
        dict(zip(names, np.maximum.accumulate(largest)[::-1].tolist(), strict=True)),
        {name: words.get(name, "") for name in names},
        growth,
    )


@dataclass(frozen=True, eq=False)
class _Motion:
    """The motion of the rigid plan, and the highest model's forces along this motion."""

    rigid: CrossingPlan
    fuller: FullerModel
    deformed: Pass  # with the deflections that its forces cause, along the rigid plan's law
    needed: Array  # (T, n_a) motor torques of the highest model that crosses with its own condition (8)

    @classmethod
    def of(cls, rigid: CrossingPlan, highest: ParallelRobot) -> _Motion:
        fuller = FullerModel.of(rigid.dynamics, highest)
        undeformed = fuller.first_pass
        deflections = fuller.grid.fit(undeformed.caused)
        deformed = evaluate_pass(fuller.searched.branch, fuller.grid, rigid.law, deflections, undeformed)
        return cls(rigid, fuller, deformed, fuller.torque(fuller.compute_pass(undeformed.caused)))

    def errors(self, payload: CrossingPlan | None) -> dict[str, LevelError]:
        """Compute the error of each level but the highest; without a plan the payload's is missing."""
        rigid, times = self.rigid, self.fuller.grid.times
        rotors = rigid.robot.rotor_inertia * rigid.robot.gear_ratio
        turning = rotors * rigid.dynamics.motion(times).a[:, rigid.robot.actuated]
        errors = {"kinematics": self._mass_error(rigid, times, turning)}
        if payload is not None:
            alike = times * (payload.duration / rigid.duration)
            errors["payload"] = self._mass_error(
                payload, alike, payload.dynamics.torque_without_friction(alike)
            )
        for name in FLEXIBILITIES:
            springs = self.fuller.robot.description.active_springs(name)
            errors[name] = self._displacement_error([one for spring in springs for one in spring.coordinates])
        return errors | {"deformed": self._elastic_inertia_error()}

    def _mass_error(self, plan: CrossingPlan, times: Array, torque: Array) -> LevelError:
        """Compute the error of torques (T, n_a) on a plan's motion, of the rigid robot with all masses."""
        wrench = platform_wrench(self.rigid.robot, plan.dynamics.motion(times))
        return self._error(torque, wrench.missing_wrench(torque))

    def _displacement_error(self, names: Sequence[str]) -> LevelError:
        """Compute the error of forces of the undeformed robot, its motors moved by some deflections."""
        fuller, undeformed = self.fuller, self.fuller.first_pass
        motion = undeformed.motion
        if names:
            caused = np.where(np.isin(fuller.robot.elastic_names, names), undeformed.caused, 0.0)
            branch, function = fuller.searched.branch, fuller.grid.fit(caused)
            motion = evaluate_pass(branch, fuller.grid, self.rigid.law, function, undeformed).motion
        torque = motor_torque(fuller.robot, motion, undeformed.forces.joint_torque)
        return self._error(torque, platform_wrench(fuller.robot, self.deformed.motion).missing_wrench(torque))

    def _elastic_inertia_error(self) -> LevelError:
        """Compute the error of forces of the deformed robot whose bodies do not feel how the springs move."""
        robot, motion = self.fuller.robot, self.deformed.motion
        if not robot.n_e:
            return LevelError(0.0, 0.0)
        still = replace(robot, elastic_inertia=False)
        fuller = FullerModel.of(self.rigid.dynamics, still)
        torque = fuller.torque(fuller.compute_pass(self.fuller.first_pass.caused))
        return self._error(
            torque, platform_wrench(robot, motion).required - platform_wrench(still, motion).required
        )

    def _error(self, torque: Array, lacking: Array) -> LevelError:
        """Compute the error of torques (T, n_a), and of the platform for lack of a wrench (T, n).

        Of torques over the peak of motors of that unit, of the platform over the path's length.
        """
        robot, times = self.rigid.robot, np.linspace(0.0, self.rigid.duration, STEPS + 1)
        peaks = largest_by_unit(robot, np.abs(self.needed).max(axis=0))
        wrench = self.fuller.grid.fit(lacking)(times)
        off = open_loop_error(self.error_dynamics, times, wrench) * coordinate_sizes(robot)
        return LevelError(
            float((np.abs(torque - self.needed) / peaks).max()),
            float(np.linalg.norm(off, axis=1).max() / path_length(robot, self.rigid.path)),
        )

    @cached_property
    def error_dynamics(self) -> ErrorDynamics:
        """How a platform off its path accelerates, at the ends of all steps."""
        few = np.linspace(0.0, self.rigid.duration, INSTANTS)
        many = np.linspace(0.0, self.rigid.duration, STEPS + 1)
        matrices = np.stack(error_dynamics(self.rigid.dynamics, few)).transpose(1, 0, 2, 3)
        values = CubicSpline(few, matrices)(many)
        return ErrorDynamics(*values.transpose(1, 0, 2, 3))


def percent(share: float) -> str:
    """Return a share in per cent, in words."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
