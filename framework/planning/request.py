"""The request of a plan: a record that checks its options when it is made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from framework.dynamics.inverse_dynamics import checked_geometry
from framework.dynamics.motor_limits import is_limited, motor_limits, shortest_form
from framework.errors import InvalidInput
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.laws.path import Path, expect_path
from framework.planning.options import OPTIONS, PlanOptions, takes_options

MAX_PATHS_PER_DURATION = 1e6  # largest s' at a crossing times the duration; feasible laws have a few units
SMOOTHNESS = {True: 4, False: 2}  # order up to which derivatives of s vanish at both ends, by "has springs"
MAX_SMOOTHNESS = 12


@dataclass(frozen=True, kw_only=True)
class Request(PlanOptions):
    """A path and the options of its plan, completed for one robot by `Request.of`.

    `Request.of` fills in geometry and smoothness, whose defaults depend on the robot. Other options may be
    None. Planning then chooses the duration, the times and speeds of crossings and the goal (`optimize`), and
    locates the singular points (`at`). Stated limits are stored in their shortest form
    (`motor_limits.shortest_form`); None stands for the limits of the robot file.

    Raises:
        InvalidInput: an option is invalid, or options contradict each other.
    """

    path: Path
    geometry: str = "rigid"
    smoothness: int = SMOOTHNESS[False]

    @staticmethod
    @takes_options
    def of(robot: ParallelRobot, path: Path, **options: Any) -> Request:
        """Return the checked request for a path and options of `plan_crossing`.

        Raises:
            InvalidInput: an option is invalid; the message lists valid ones.
        """
        expect_robot(robot)
        expect_path(path)
        filled_in = {
            "geometry": checked_geometry(robot, options.get("geometry")),
            "smoothness": checked_smoothness(robot, options.get("smoothness")),
        }
        limits = {}
        for name in ("torque_limit", "speed_limit"):
            limits[name] = motor_limits(robot, name, options.get(name))
            if options.get(name) is not None:
                filled_in[name] = shortest_form(limits[name])
        request = Request(path=path, **{**options, **filled_in})
        request.external_wrenches.check_frames(robot)
        if request.goal == "time" and np.isinf(list(limits.values())).all():
            raise InvalidInput(
                "torque_limit or speed_limit is needed, given or in the robot file: without limits no law is "
                "the quickest"
            )
        return request

    def __post_init__(self) -> None:
        """Check each option by itself, then options of the law against each other."""
        expect_path(self.path)
        for name, option in OPTIONS.items():
            value = getattr(self, name)
            is_left_open = value is None and getattr(PlanOptions, name) is None  # None is the default
            if option.check is not None and not is_left_open:
                object.__setattr__(self, name, option.check(name, value))
        self._check_crossings()
        if self.bounded and self.law == "polynomial":
            raise InvalidInput(
                "optimize, longest, limits and margin are for the optimal law, not the polynomial"
            ).advising({"law": None})
        if self.kind == "optimal":
            self._check_optimal()
        elif self.duration is None:
            raise InvalidInput("duration: needed, unless optimize time finds the least, or longest bounds it")

    @property
    def kind(self) -> str:
        """The kind of law: polynomial, optimal or auto.

        Auto means the polynomial if it advances and keeps the limits. A goal or a bound of the duration asks
        for the optimal law. So do limits without a duration, and limits together with times (a contradiction,
        which is then refused).
        """
        asks_for_optimal = self.law == "optimal" or self.optimize is not None or self.longest is not None
        limits_need_optimal = self.bounded and (self.duration is None or self.times is not None)
        if asks_for_optimal or limits_need_optimal:
            return "optimal"
        return "polynomial" if self.times is not None else self.law

    @property
    def external_wrenches(self) -> ExternalWrenches:
        """The external wrenches along the path."""
        return ExternalWrenches.of(self.wrenches)

    @property
    def goal(self) -> str:
        """The goal of an optimal law."""
        return self.optimize or "peak_torque"

    @property
    def may_be_optimal(self) -> bool:
        """Whether the request admits an optimal law."""
        return self.kind == "optimal" or (self.kind == "auto" and self.smoothness <= HIGHEST_SMOOTHNESS)

    @property
    def fixed_duration(self) -> float:
        """The duration [s] of a polynomial law.

        Raises:
            InvalidInput: the request leaves the duration open.
        """
        if self.duration is None:
            raise InvalidInput("duration: a polynomial law needs one; only the optimal law can find its own")
        return self.duration

    @property
    def bounded(self) -> bool:
        """Whether the request states limits, a bound of the duration or a goal."""
        limits = is_limited(self.torque_limit) or is_limited(self.speed_limit) or self.margin > 0
        return limits or self.optimize is not None or self.longest is not None

    def _check_crossings(self) -> None:
        """Refuse invalid speeds [1/s], times [s] and path coordinates of crossings."""
        largest = np.inf if self.duration is None else MAX_PATHS_PER_DURATION / self.duration
        for speed in self.speeds or ():
            if speed <= 0:
                raise InvalidInput(f"speeds: s' at a crossing must be greater than zero, got {speed:g}")
            if speed > largest:
                raise InvalidInput(
                    f"speeds: s' at a crossing must be at most {largest:g} 1/s, a million paths in the "
                    f"duration, got {speed:g}"
                )
        for name, values in (("times", self.times), ("at", self.at)):
            if values is not None and np.any(np.diff(values) <= 0):
                raise InvalidInput(f"{name}: must ascend, got {list(values)}")
        for s in self.at or ():
            if not 0 < s < 1:
                raise InvalidInput(f"at: path coordinates must lie in (0, 1), got {s:g}")

    def _check_optimal(self) -> None:
        """Refuse options that contradict the optimal law; advise the change that corrects the request."""
        if self.times is not None:
            raise InvalidInput("times: belong to the polynomial; the optimal law finds its own").advising(
                {"times": None, "speeds": None}
            )
        if self.longest is not None and self.duration is not None:
            raise InvalidInput("longest: bounds a duration that is open; give either, not both").advising(
                {"duration": None}
            )
        if self.goal == "time" and self.duration is not None:
            raise InvalidInput("duration: with optimize time it is found; give longest to bound it").advising(
                {"duration": None}
            )
        if self.goal != "time" and self.duration is None and self.longest is None:
            raise InvalidInput(
                f"duration: optimize {self.goal} needs one, or longest: without, slower is always better"
            )
        if self.smoothness > HIGHEST_SMOOTHNESS:
            raise InvalidInput(
                f"smoothness: got {self.smoothness}, the optimal law has at most {HIGHEST_SMOOTHNESS}"
            ).advising({"smoothness": HIGHEST_SMOOTHNESS})


def checked_smoothness(robot: ParallelRobot, smoothness: int | None) -> int:
    """Return the order up to which derivatives of s vanish at both ends.

    The default is the least valid one: the torques contain at least the derivatives of s up to this order.

    Raises:
        InvalidInput: `smoothness` is no whole number, so small that the torques would jump at the ends, or
            too large.
    """
    least = SMOOTHNESS[robot.n_e > 0]
    if smoothness is None:
        return least
    if isinstance(smoothness, bool) or not isinstance(smoothness, int | np.integer):
        raise InvalidInput(f"smoothness: needs a whole number, got {smoothness!r}")
    if not least <= smoothness <= MAX_SMOOTHNESS:
        raise InvalidInput(
            f"smoothness: got {smoothness}, valid: {least} .. {MAX_SMOOTHNESS} (the torque of a "
            f"{robot.flexibility} robot contains derivatives of s up to order {least} at least; fewer zeros "
            f"make it jump there)"
        ).advising({"smoothness": None})
    return int(smoothness)
