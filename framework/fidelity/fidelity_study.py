"""The least detailed model that is enough for a motion: each level of fidelity against the highest.

All levels follow one motion: that of the plan of the highest level or, if there is none, of the rigid level.
The torques of each level drive the forward simulation of the highest model that the robot's file can express,
from rest at the start of the path. A level is enough if two errors are within the tolerance: the distance of
the platform from the motion, relative to the path's length, and the difference of the level's torques from
those of the plan, relative to their peak. A comparison of adjacent levels would not suffice: if legs have no
mass, two levels agree exactly, whatever the springs of the levels above.

The simulation shows the effect of missing torques near a singularity. There the robot cannot resist a force
along t_s, and the remaining t_s . W_p pushes the platform off its path. A robot that falls by itself is
simulated with controllers of the motors (`model_comparison`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from framework.dynamics.open_loop import open_loop_growth
from framework.errors import InvalidInput, NoAnswer
from framework.fidelity.model_comparison import EQUAL_TORQUES, Comparison, ReferenceMotion
from framework.fidelity.predicted_level import (
    TOLERANCE,
    Indicators,
    compute_indicators,
    compute_level_motions,
    request_without_geometry,
    robot_at_level,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import is_number
from framework.laws.path import Path
from framework.model.description import LEVELS, LEVELS_BY_NAME, Level
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.output import Document, plain, select_fields
from framework.planning.neglected_effects import neglected_friction
from framework.planning.plan import plan_request
from framework.planning.request import MOTION_SAMPLES, Request
from framework.planning.result import CrossingPlan
from framework.tolerances import CLOSED_LOOP

MIN_TOLERANCE = 10 * EQUAL_TORQUES  # a level with torques that count as equal is enough
ERROR_ROUNDING = CLOSED_LOOP  # share of the path's length or the peak torque, below which errors are rounding


@dataclass(frozen=True, eq=False)
class FidelityStudy(ReadOnlyArrays):
    """The comparison of all levels for one motion."""

    tolerance: float  # allowed error, as a share of the path's length and of the peak torque
    highest: CrossingPlan  # the plan of the motion, of the highest level or else of the rigid one
    robot: ParallelRobot  # the highest model
    length: float  # [m] of the path, with rotations multiplied by the robot's length
    times: Array  # (T,) [s] instants of the levels' errors
    levels: tuple[Comparison, ...]  # in the order of `description.LEVELS`
    indicators: Indicators
    fall: float  # time constants in the motion with which errors grow where the robot falls by itself
    has_control: bool  # whether the simulated motors have controllers, because the robot falls
    simulating: float  # [s] computing time of all simulations
    seconds: float  # computing time of the study

    def is_enough(self, comparison: Comparison) -> bool:
        """Return whether a level's errors of torque and platform are within the tolerance."""
        return max(comparison.torque, comparison.platform) <= self.tolerance

    @cached_property
    def neglected_work(self) -> float:
        """The work of dry friction that no level models, divided by the work of the motors.

        Both are integrals of absolute powers. Torques cannot be compared: the law meets condition (8) without
        this friction, so that the torque against it is unbounded near Type 2. Zero without such friction;
        infinite if the motors do no work.
        """
        plan = self.highest
        friction = neglected_friction(self.highest.dynamics)
        if not friction.any():
            return 0.0
        times = np.linspace(0.0, plan.duration, MOTION_SAMPLES)
        dissipated = np.abs(plan.velocity(times)) @ friction  # (T,) [W]
        supplied = np.abs(plan.torque(times) * plan.motor_angle(times, order=1)).sum(axis=1)  # (T,) [W]
        motor_work = np.trapezoid(supplied, times)
        return float(np.trapezoid(dissipated, times) / motor_work) if motor_work else np.inf

    @cached_property
    def enough(self) -> Comparison | None:
        """The least level that is enough; None if no level is.

        No level is enough if the work of dry friction that no level models exceeds the tolerance.
        """
        if self.neglected_work > self.tolerance:
            return None
        return next((level for level in self.levels if self.is_enough(level)), None)

    @property
    def by_luck(self) -> tuple[str, ...]:
        """Names of levels above `enough` that are not enough; normally none.

        The lower level is then enough by chance: its errors cancel, those of the levels above do not.
        """
        if self.enough is None:
            return ()
        above = self.levels[self.levels.index(self.enough) :]  # and the level itself, which is enough
        return tuple(comparison.level.name for comparison in above if not self.is_enough(comparison))

    @cached_property
    def indicated(self) -> Comparison:
        """The level that the indicators predict; of levels with equal torques the lowest."""
        by_name = {comparison.level.name: comparison for comparison in self.levels}
        chosen = by_name[self.indicators.choose_level(self.tolerance)]
        return by_name[chosen.same_as] if chosen.same_as else chosen

    def law_difference(self, comparison: Comparison) -> float:
        """Return the largest difference in s between the law of a compared level and the motion's.

        It is infinite if the level has no motion.
        """
        if comparison.motion is None:
            return np.inf
        return float(np.abs(comparison.motion.law(self.times) - self.highest.law(self.times)).max())

    def place(self, errors: Array) -> float | None:
        """Return the s at which a level's errors (T,) are largest; None if all are rounding."""
        errors_or_zero = np.nan_to_num(errors)  # NaN without a motion, and after the end of a simulation
        if errors_or_zero.max() <= ERROR_ROUNDING:
            return None
        return float(self.highest.law(self.times[np.argmax(errors_or_zero)]))

    @property
    def scene_entry(self) -> Document | None:
        """The entry `fidelity` of a scene in the robot file; None if no level is enough."""
        enough = self.enough
        return None if enough is None else {"level": enough.level.name, "tolerance": self.tolerance}

    @property
    def refusal(self) -> NoAnswer | None:
        """The error with the reason why no level is enough; None if a level is."""
        if self.enough is not None:
            return None
        if self.neglected_work > self.tolerance:
            return NoAnswer(
                f"no model is accurate to {100 * self.tolerance:g} %: dry friction that "
                f"none of them has ({self.highest.neglected_friction}) takes "
                f"{100 * self.neglected_work:.2g} % of the motors' work",
                name=self.robot.name,
            )
        most_detailed = [level for level in self.levels if level.motion is not None][-1]
        deviation = f"leave the path by {100 * most_detailed.platform:.2g} % of its length"
        failure = most_detailed.reason or deviation
        cause = (
            "each motor has a controller, which sees its own angle and not the platform"
            if self.has_control
            else "without feedback, errors of rounding and integration grow along this motion"
        )
        return NoAnswer(
            f"no model is accurate to {100 * self.tolerance:g} %: in the full elastic simulation even the "
            f"torques of the most detailed one, {most_detailed.level.name}, {failure}; {cause}",
            name=self.robot.name,
        )

    def to_dict(self) -> Document:
        """Return the study as the document of `--json`."""
        return plain(
            {
                "robot": self.robot.name,
                "tolerance": self.tolerance,
                "duration": self.highest.duration,
                "path_length": self.length,
                "peak_torque": self.highest.peak_torque,
                "crossings": [select_fields(crossing, "s", "time") for crossing in self.highest.crossings],
                "enough": None if self.enough is None else self.enough.level.name,
                "by_luck": self.by_luck,
                "predicted": self.indicated.level.name,
                "growth": open_loop_growth(self.fall),
                "time_constants": self.fall,
                "controlled": self.has_control,
                "neglected": {
                    "dry_friction": self.highest.neglected_friction,
                    "share_of_work": self.neglected_work,
                    "left_out": self.robot.description.left_out,
                },
                "levels": [self._entry(comparison) for comparison in self.levels],
                "simulating": self.simulating,
                "seconds": self.seconds,
            }
        )

    def _entry(self, comparison: Comparison) -> Document:
        """Return the entry of a compared level in the document of `to_dict`."""
        name = comparison.level.name
        spring = comparison.deflection
        return {
            "level": name,
            "models": comparison.level.summary,
            "enough": self.is_enough(comparison),
            "same_as": comparison.same_as or None,
            "reason": comparison.reason or None,
            "seconds": None if comparison.motion is None else comparison.seconds,
            "torque": comparison.torque,
            "torque_at": self.place(comparison.torque_error),
            "platform": comparison.platform,
            "platform_at": self.place(comparison.platform_error),
            "deflection": None if spring is None else {"spring": spring[0], "largest": spring[1]},
            "law": self.law_difference(comparison),
            "predicted": self.indicators.error[name],
            "indicator": self.indicators.words[name],
        }


def fidelity_study(
    robot: ParallelRobot,
    path: Path | str,
    *,
    tolerance: float = TOLERANCE,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> FidelityStudy:
    """Find the least detailed model of a robot that is enough for a motion, with evidence.

    Args:
        robot: the robot, with any flexibility; the levels are made from its description.
        path: path to follow, or the name of a scene.
        tolerance: allowed error of a level, as a share of the path's length and of the peak torque.
        progress: called with the number of levels done.
        options: options of `plan_crossing` except geometry, since each level has its own. The default
            smoothness of all levels is that of the highest.

    Raises:
        InvalidInput: an option is invalid, or the robot cannot be simulated.
        NoAnswer: neither the highest nor the rigid level has a plan, so that there is no motion.
    """
    if not (is_number(tolerance) and MIN_TOLERANCE <= tolerance < 1):
        raise InvalidInput(f"tolerance: needs a share in [{MIN_TOLERANCE:g}, 1), got {tolerance!r}")
    started = time.perf_counter()
    highest = robot_at_level(robot.description, LEVELS[-1])
    level, plan = _plan_motion(highest, request_without_geometry(highest, path, **options))
    motions = compute_level_motions(highest.description, plan, level)
    reference = ReferenceMotion.of(plan, highest, tolerance)
    levels: list[Comparison] = []
    began = time.perf_counter()
    for comparison in reference.compare_levels(motions.items()):
        levels.append(comparison)
        if progress is not None:
            progress(len(levels))
    simulating = time.perf_counter() - began  # other computations of this loop take milliseconds
    return FidelityStudy(
        tolerance=tolerance,
        highest=plan,
        robot=highest,
        length=reference.length,
        times=reference.times,
        levels=tuple(levels),
        indicators=compute_indicators(motions, reference.control),
        fall=reference.fall,
        has_control=reference.control is not None,
        simulating=simulating,
        seconds=time.perf_counter() - started,
    )


def _plan_motion(highest: ParallelRobot, request: Request) -> tuple[Level, CrossingPlan]:
    """Plan with the highest level or, without a plan, with the rigid one; return level and plan.

    Raises:
        NoAnswer: the refusal of the highest level, if neither has a plan.
    """
    try:
        return LEVELS[-1], plan_request(highest, request)
    except NoAnswer as refusal:
        rigid = LEVELS_BY_NAME["rigid"]
        with suppress(NoAnswer):
            robot = robot_at_level(highest.description, rigid)
            if robot.n_a > robot.n:  # redundant motors, whose torques at all levels are those of least norm
                request = replace(request, torque_sharing="least_norm")
            return rigid, plan_request(robot, replace(request, geometry=rigid.geometry))
        raise refusal
