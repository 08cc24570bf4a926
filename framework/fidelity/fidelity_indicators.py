"""Indicators: estimated errors of each level of fidelity, without a simulation.

From the plan of the rigid level, one pass of first order gives the deflections of the highest model
(`crossing.fuller_model`). Two errors of a level's torques are estimated, and the larger one counts:

* the difference from the torques that the highest model needs for nearly the same motion, over their peak;
* the error of the platform without feedback under the missing wrench W - G' tau, over the path's length
  (`dynamics.open_loop`).

Both are regular at Type 2. The highest model crosses with its own condition (8), and no divisor of the second
vanishes there: a remaining t_s . W_p acts like any other wrench. The error of a level is at least that of all
levels above, because errors may cancel in one of them by chance.
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

INSTANTS = 65  # of the motion, at which the dynamics of the platform's error are computed
STEPS = 512  # of the integration of the platform's error


class Indicators(NamedTuple):
    """The estimated error of each level by its name, and the same in words."""

    error: Mapping[str, float]
    words: Mapping[str, str]
    growth: float  # of an error of the platform without feedback, see `open_loop_growth`

    def choose_level(self, tolerance: float) -> str:
        """Return the name of the least level whose error is within the tolerance."""
        return next(name for name, error in self.error.items() if error <= tolerance)


class LevelError(NamedTuple):
    """The estimated errors of a level: of torques over their peak, of the platform over the path's length."""

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
            errors = _Motion.of(rigid, highest).errors(payload)
            return _accumulate_errors(errors, open_loop_growth(rigid.dynamics))
    return _accumulate_errors({}, np.inf)  # without a plan all errors are unknown


def _accumulate_errors(errors: Mapping[str, LevelError], growth: float) -> Indicators:
    """Return indicators in which the error of a level is at least that of all levels above.

    An error that is missing or not finite counts as infinite; that of the highest level is zero.
    """
    names = [level.name for level in LEVELS]
    finite_or_inf = {name: np.where(np.isfinite(error), error, np.inf) for name, error in errors.items()}
    unknown = np.array(np.inf)
    highest_first = [0.0, *(finite_or_inf.get(name, unknown).max() for name in reversed(names[:-1]))]
    accumulated = np.maximum.accumulate(highest_first)[::-1].tolist()
    words = {
        name: f"torques {percent(torque)}, platform {percent(platform)}"
        for name, (torque, platform) in finite_or_inf.items()
    }
    return Indicators(
        error=dict(zip(names, accumulated, strict=True)),
        words={name: words.get(name, "") for name in names},
        growth=growth,
    )


@dataclass(frozen=True, eq=False)
class _Motion:
    """The motion of the rigid plan, and the highest model's forces along this motion."""

    rigid: CrossingPlan
    fuller: FullerModel
    deformed: Pass  # with the deflections that its forces cause, along the rigid plan's law
    needed: Array  # (T, n_a) motor torques of the highest model, which crosses with its own condition (8)

    @classmethod
    def of(cls, rigid: CrossingPlan, highest: ParallelRobot) -> _Motion:
        """Return the motion of a rigid plan with the deflections of one pass in the highest model."""
        fuller = FullerModel.of(rigid.dynamics, highest)
        undeformed = fuller.first_pass
        deflections = fuller.grid.fit(undeformed.caused)
        deformed = evaluate_pass(fuller.searched.branch, fuller.grid, rigid.law, deflections, undeformed)
        return cls(rigid, fuller, deformed, fuller.torque(fuller.compute_pass(undeformed.caused)))

    def errors(self, payload: CrossingPlan | None) -> dict[str, LevelError]:
        """Estimate the errors of each level but the highest, and of payload only with its plan."""
        rigid, times = self.rigid, self.fuller.grid.times
        rotors = rigid.robot.rotor_inertia * rigid.robot.gear_ratio
        rotor_torque = rotors * rigid.dynamics.motion(times).a[:, rigid.robot.actuated]
        errors = {"kinematics": self._mass_error(rigid, times, rotor_torque)}
        if payload is not None:
            payload_times = times * (payload.duration / rigid.duration)
            payload_torque = payload.dynamics.torque_without_friction(payload_times)
            errors["payload"] = self._mass_error(payload, payload_times, payload_torque)
        for name in FLEXIBILITIES:
            springs = self.fuller.robot.description.active_springs(name)
            coordinates = [coordinate for spring in springs for coordinate in spring.coordinates]
            errors[name] = self._displacement_error(coordinates)
        return errors | {"deformed": self._elastic_inertia_error()}

    def _mass_error(self, plan: CrossingPlan, times: Array, torque: Array) -> LevelError:
        """Estimate the errors of torques (T, n_a) that neglect masses, along the motion of their plan.

        The missing wrench is that of the rigid robot with all masses.
        """
        wrench = platform_wrench(self.rigid.robot, plan.dynamics.motion(times))
        return self._error(torque, wrench.missing_wrench(torque))

    def _displacement_error(self, names: Sequence[str]) -> LevelError:
        """Estimate the errors of a level of small displacements with the springs `names`.

        Its joint torques are those of the undeformed robot; its motors follow the deflections of these
        springs.
        """
        fuller, undeformed = self.fuller, self.fuller.first_pass
        motion = undeformed.motion
        if names:
            caused = np.where(np.isin(fuller.robot.elastic_names, names), undeformed.caused, 0.0)
            branch, function = fuller.searched.branch, fuller.grid.fit(caused)
            motion = evaluate_pass(branch, fuller.grid, self.rigid.law, function, undeformed).motion
        torque = motor_torque(fuller.robot, motion, undeformed.forces.joint_torque)
        wrench = platform_wrench(fuller.robot, self.deformed.motion)
        return self._error(torque, wrench.missing_wrench(torque))

    def _elastic_inertia_error(self) -> LevelError:
        """Estimate the errors of the level without inertial forces of the elastic motion."""
        robot, motion = self.fuller.robot, self.deformed.motion
        if not robot.n_e:
            return LevelError(0.0, 0.0)
        without_inertia = replace(robot, elastic_inertia=False)
        fuller = FullerModel.of(self.rigid.dynamics, without_inertia)
        torque = fuller.torque(fuller.compute_pass(self.fuller.first_pass.caused))
        required, modelled = (platform_wrench(one, motion).required for one in (robot, without_inertia))
        return self._error(torque, required - modelled)

    def _error(self, torque: Array, missing_wrench: Array) -> LevelError:
        """Estimate the errors of torques (T, n_a) that miss a wrench W - G' tau (T, n) on the platform.

        The error of torques is over the peak of all motors with the same unit. The error of the platform is
        integrated without feedback; it is over the path's length.
        """
        robot, times = self.rigid.robot, np.linspace(0.0, self.rigid.duration, STEPS + 1)
        peaks = largest_by_unit(robot, np.abs(self.needed).max(axis=0))
        wrench = self.fuller.grid.fit(missing_wrench)(times)
        platform_error = open_loop_error(self.error_dynamics, times, wrench) * coordinate_sizes(robot)
        distance = float(np.linalg.norm(platform_error, axis=1).max())
        return LevelError(
            torque=float((np.abs(torque - self.needed) / peaks).max()),
            platform=distance / path_length(robot, self.rigid.path),
        )

    @cached_property
    def error_dynamics(self) -> ErrorDynamics:
        """The dynamics of the platform's error at the ends of all steps, interpolated from fewer instants."""
        few = np.linspace(0.0, self.rigid.duration, INSTANTS)
        many = np.linspace(0.0, self.rigid.duration, STEPS + 1)
        matrices = np.stack(error_dynamics(self.rigid.dynamics, few)).transpose(1, 0, 2, 3)
        values = CubicSpline(few, matrices)(many)
        return ErrorDynamics(*values.transpose(1, 0, 2, 3))


def percent(share: float) -> str:
    """Return a share as text in per cent, with two digits below 10 %."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
