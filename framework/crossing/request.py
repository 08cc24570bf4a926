"""What is asked of a plan: one record, checked where it is made, from a scene, a command line or a call."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from framework.dynamics.inverse_dynamics import GEOMETRIES, TOLERANCE, check_tolerance, checked_geometry
from framework.dynamics.motor_limits import Limit, limits_of_motors
from framework.errors import InvalidInput, choose_from
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.motion.cone_program import GOALS
from framework.motion.law import check_duration, is_number
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS
from framework.motion.path import Path, expect_path

LAWS = ("auto", "polynomial", "optimal")
LARGEST_SPEED = 1e6  # whole paths in the duration; what a law can keep is a few
SMOOTHNESS = {True: 4, False: 2}  # derivatives of s that vanish at both ends: elastic, rigid
MOST_SMOOTHNESS = 12


@dataclass(frozen=True, kw_only=True)
class Request:
    """A path, how long its motion takes, what is asked at the crossings, and which law is wanted.

    `Request.of` makes one for a robot, with the meaning of each field in `plan_crossing`. What was left open
    and depends on the robot alone is filled in: geometry and smoothness. What planning has to choose is None:
    the duration, times and speeds of crossings, `at` where the singular points are to be located, and
    `optimize`. Limits are those asked for, one number for all motors or one for each; None leaves it to the
    robot file (`limits.motor_limits`).

    Raises:
        InvalidInput: numbers or options that cannot be right, or that contradict each other.
    """

    path: Path
    duration: float | None = None
    times: tuple[float, ...] | None = None
    speeds: tuple[float, ...] | None = None
    at: tuple[float, ...] | None = None
    geometry: str = "rigid"
    smoothness: int = SMOOTHNESS[False]
    tolerance: float = TOLERANCE
    law: str = "auto"
    optimize: str | None = None
    longest: float | None = None
    torque_limit: tuple[float, ...] | None = None
    speed_limit: tuple[float, ...] | None = None
    margin: float = 0.0
    keep_limits: bool = False

    @staticmethod
    def of(
        robot: ParallelRobot,
        path: Path,
        *,
        duration: float | None = None,
        times: Iterable[float] | None = None,
        speeds: Iterable[float] | None = None,
        at: Iterable[float] | None = None,
        geometry: str | None = None,
        smoothness: int | None = None,
        tolerance: float = TOLERANCE,
        law: str = "auto",
        optimize: str | None = None,
        longest: float | None = None,
        torque_limit: Limit = None,
        speed_limit: Limit = None,
        margin: float = 0.0,
        keep_limits: bool = False,
    ) -> Request:
        """The request of `plan_crossing` with these arguments.

        Raises:
            InvalidInput: an argument that cannot be right; says what is valid.
        """
        expect_robot(robot)
        expect_path(path)
        request = Request(
            path=path,
            duration=duration,
            times=_numbers("times", times),
            speeds=_numbers("speeds", speeds),
            at=_numbers("at", at),
            geometry=checked_geometry(robot, geometry),
            smoothness=checked_smoothness(robot, smoothness),
            tolerance=tolerance,
            law=law,
            optimize=optimize,
            longest=longest,
            torque_limit=limits_of_motors(robot, "torque_limit", torque_limit),
            speed_limit=limits_of_motors(robot, "speed_limit", speed_limit),
            margin=margin,
            keep_limits=keep_limits,
        )
        request.check_limited(robot)
        return request

    def __post_init__(self) -> None:
        expect_path(self.path)
        if self.geometry not in GEOMETRIES:
            raise InvalidInput(choose_from("geometry", self.geometry, GEOMETRIES))
        if not isinstance(self.keep_limits, bool | np.bool_):
            raise InvalidInput(f"keep_limits: must be true or false, got {self.keep_limits!r}")
        if self.duration is not None:
            check_duration(self.duration)
        self._check_crossings()
        check_tolerance(self.tolerance)
        if not (is_number(self.margin) and 0 <= self.margin < 1):
            raise InvalidInput(f"margin: must lie in [0, 1), got {self.margin!r}")
        if self.law not in LAWS:
            raise InvalidInput(choose_from("law", self.law, LAWS))
        if self.optimize is not None and self.optimize not in GOALS:
            raise InvalidInput(choose_from("optimize", self.optimize, GOALS))
        if self.longest is not None:
            check_duration(self.longest)
        if self._bounded and self.law == "polynomial":
            raise InvalidInput(
                "optimize, longest, limits and margin are for the optimal law, not the polynomial"
            )
        if self.kind == "optimal":
            self._check_optimal()
        elif self.duration is None:
            raise InvalidInput("duration: needed, unless optimize time finds the least, or longest bounds it")
        for name in ("duration", "longest", "tolerance", "margin"):  # numpy's numbers are not all for JSON
            given = getattr(self, name)
            object.__setattr__(self, name, None if given is None else float(given))
        object.__setattr__(self, "keep_limits", bool(self.keep_limits))

    @property
    def kind(self) -> str:
        """The kind of law: polynomial, optimal, or auto for the first where that advances comfortably."""
        if self.law == "optimal" or self._bounded:
            return "optimal"
        return "polynomial" if self.times is not None else self.law

    @property
    def goal(self) -> str:
        """What an optimal law is to be best at."""
        return "peak_torque" if self.optimize is None else self.optimize

    @property
    def may_be_optimal(self) -> bool:
        """Whether an optimal law would do."""
        return self.kind == "optimal" or (self.kind == "auto" and self.smoothness <= HIGHEST_SMOOTHNESS)

    @property
    def fixed_duration(self) -> float:
        """The duration [s] of a law that cannot choose its own; raises InvalidInput if it is open."""
        if self.duration is None:
            raise InvalidInput("duration: a polynomial law needs one; only the optimal law can find its own")
        return self.duration

    @property
    def _bounded(self) -> bool:
        """Whether anything is asked that only an optimal law can keep."""
        limits = self.torque_limit is not None or self.speed_limit is not None or self.margin > 0
        return limits or self.optimize is not None or self.longest is not None

    def check_limited(self, robot: ParallelRobot) -> None:
        """Raise InvalidInput where the least time is asked of motors without any limit."""
        motors = robot.description.actuators
        given = [self.torque_limit, self.speed_limit]
        in_file = [limit for motor in motors for limit in (motor.torque_limit, motor.speed_limit)]
        if self.goal == "time" and all(limit is None for limit in (*given, *in_file)):
            raise InvalidInput(
                "torque_limit: optimize time needs a limit of torque or speed, given or in the robot file"
            )

    def _check_crossings(self) -> None:
        for speed in self.speeds or ():
            if speed <= 0:
                raise InvalidInput(f"speeds: s' at a crossing must be greater than zero, got {speed:g}")
            if self.duration is not None and speed > LARGEST_SPEED / self.duration:
                raise InvalidInput(
                    f"speeds: s' at a crossing must be at most {LARGEST_SPEED / self.duration:g} 1/s, a "
                    f"million paths in the duration, got {speed:g}"
                )
        for name, values in (("times", self.times), ("at", self.at)):
            if values is not None and np.any(np.diff(values) <= 0):
                raise InvalidInput(f"{name}: must ascend, got {list(values)}")
        for s in self.at or ():
            if not 0 < s < 1:
                raise InvalidInput(f"at: path coordinates must lie in (0, 1), got {s:g}")

    def _check_optimal(self) -> None:
        if self.times is not None:
            raise InvalidInput("times: belong to the polynomial; the optimal law finds its own")
        if self.longest is not None and self.duration is not None:
            raise InvalidInput("longest: bounds a duration that is open; give either, not both")
        if self.goal == "time" and self.duration is not None:
            raise InvalidInput("duration: with optimize time it is found; give longest to bound it")
        if self.goal != "time" and self.duration is None and self.longest is None:
            raise InvalidInput(
                f"duration: optimize {self.goal} needs one, or longest: without, slower is always better"
            )
        if self.smoothness > HIGHEST_SMOOTHNESS:
            raise InvalidInput(
                f"smoothness: got {self.smoothness}, the optimal law has at most {HIGHEST_SMOOTHNESS}"
            )


def _numbers(name: str, given: object) -> tuple[float, ...] | None:
    """A list of finite numbers as a tuple of floats."""
    if given is None:
        return None
    if not isinstance(given, Iterable) or isinstance(given, str) or np.ndim(given) == 0:  # type: ignore[arg-type]
        raise InvalidInput(f"{name}: needs a list of numbers, got {given!r}")
    values = list(given)
    for value in values:
        if not is_number(value):
            raise InvalidInput(f"{name}: must be finite numbers, got {value!r}")
    return tuple(map(float, values))


def checked_smoothness(robot: ParallelRobot, given: int | None) -> int:
    """How many derivatives of s are to vanish at both ends: by default as many as the torque contains."""
    least = SMOOTHNESS[robot.n_e > 0]
    if given is None:
        return least
    if isinstance(given, bool) or not isinstance(given, int | np.integer):
        raise InvalidInput(f"smoothness: needs a whole number, got {given!r}")
    if not least <= given <= MOST_SMOOTHNESS:
        raise InvalidInput(
            f"smoothness: got {given}, valid: {least} .. {MOST_SMOOTHNESS} (the torque of a "
            f"{robot.flexibility} robot contains derivatives of s up to order {least} at least; fewer zeros "
            f"make it jump there)"
        )
    return int(given)
