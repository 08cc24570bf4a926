"""The request of a plan: a record that checks its options when it is made, and its goal and limits.

A law is s(t), the course of the path coordinate s from 0 to 1; s' is its rate. Crossings are the instants at
which the robot is singular. The last section has the sizes of a motion, with which limits and errors are
compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from framework.dynamics.drive_limits import DriveLimits, curve_ratios, drive_limits, rms_torques
from framework.dynamics.inverse_dynamics import checked_geometry
from framework.dynamics.motor_friction import motor_friction
from framework.dynamics.motor_limits import is_limited, motor_limits, shortest_form
from framework.dynamics.result import InverseDynamics
from framework.dynamics.torque_distribution import distribute_torques
from framework.errors import InvalidInput, did_you_mean
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import REST, Ends
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, Smoothstep
from framework.laws.path import HIGHEST_ORDER, HIGHEST_STATED, Path, expect_path
from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.chebyshev import peak_sizes
from framework.planning.options import DEFAULTS, OPTIONS, PlanOptions, takes_options

DRIVE_OPTIONS = ("corner_speed", "no_load_speed", "rms_torque_limit")  # limits of `DriveLimits`
MOTOR_LIMITS = ("torque_limit", "speed_limit", *DRIVE_OPTIONS)
SMOOTHNESS = {True: 4, False: 2}  # order up to which derivatives of s vanish at both ends, by "has springs"
MOTION_SAMPLES = 1001  # equidistant values of s, or instants, at which a path or a motion is measured
PEAK_SAMPLES = 2 * MOTION_SAMPLES - 1  # instants at which peaks are located and limits are checked


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
            TypeError: an option does not exist.
        """
        expect_path(path)
        for name in options.keys() - OPTIONS.keys():
            raise TypeError(f"{name!r} is no option of a plan{did_you_mean(name, OPTIONS)}")
        limits = {  # (n_a,) each
            name: motor_limits(robot, name, options.get(name))
            for name in MOTOR_LIMITS
            if name not in DRIVE_OPTIONS or options.get(name) is not None
        }
        stated = {name: shortest_form(limits[name]) for name in limits if options.get(name) is not None}
        geometry = checked_geometry(robot, options.get("geometry"))
        smoothness = checked_smoothness(robot, options.get("smoothness"))
        request = Request(path=path, **{**options, **stated, "geometry": geometry, "smoothness": smoothness})
        request.external_wrenches.check_frames(robot)
        drives: dict[str, Any] = {name: stated[name] for name in DRIVE_OPTIONS if name in stated}
        has_drives = drive_limits(robot, limits["torque_limit"], **drives) is not None
        if request.torque_sharing == "free" and (has_drives or robot.n_e):
            alone = "elastic robots have least_norm alone, as their springs deflect with the distribution"
            if has_drives:
                alone = "motors with torque-speed curves or RMS torque limits have least_norm alone"
            raise InvalidInput(f"torque_sharing: {alone}").advising({"torque_sharing": None})
        if request.goal == "time" and np.isinf([limits["torque_limit"], limits["speed_limit"]]).all():
            raise InvalidInput(
                "torque_limit or speed_limit is needed, given or in the robot file (effort and velocity of "
                "the URDF are not read): without limits no law is the quickest"
            )
        return request

    def __post_init__(self) -> None:
        """Check each option by itself, and convert its value; then check options against each other."""
        expect_path(self.path)
        values = vars(self)
        for name, option in OPTIONS.items():
            value = values[name]
            is_left_open = value is None and DEFAULTS[name] is None  # None is the default
            if option.check is not None and not is_left_open:
                object.__setattr__(self, name, option.check(name, value))  # since the record is frozen
        self._check_crossings()
        self._check_ends()
        self._check_law()

    def _check_law(self) -> None:
        """Refuse limits, goals and durations that the kind of law does not have."""
        if self.cycle_time is not None and self.cycle_time < (self.duration or 0.0):
            raise InvalidInput(
                f"cycle_time: must be at least the duration {self.duration:g} s, got {self.cycle_time:g} s"
            )
        if self.bounded and self.law == "polynomial":
            why = "optimize, longest, limits and margin are for the optimal law, not the polynomial"
            raise self._refuse(why, law=None)
        if self.kind == "optimal":
            self._check_optimal()
        elif self.duration is None:
            raise InvalidInput("duration: needed, unless optimize time finds the least, or longest bounds it")

    @cached_property
    def kind(self) -> str:
        """The kind of law: polynomial, optimal or auto.

        Auto means the polynomial if it advances and keeps the limits. A goal or a bound of the duration asks
        for the optimal law. So do limits without a duration. Given times ask for the polynomial; the optimal
        law replaces it if it does not advance or exceeds limits.
        """
        asks_for_optimal = self.law == "optimal" or self.optimize is not None or self.longest is not None
        if asks_for_optimal or (self.bounded and self.duration is None):
            return "optimal"
        return "polynomial" if self.times is not None else self.law

    @property
    def external_wrenches(self) -> ExternalWrenches:
        """The external wrenches along the path."""
        return ExternalWrenches.of(self.wrenches)

    @property
    def model_options(self) -> dict[str, Any]:
        """The options of `resolve`: geometry, tolerance and friction."""
        return {"geometry": self.geometry, "tolerance": self.tolerance, "friction": self.friction}

    @property
    def ends(self) -> Ends:
        """The derivatives of s at ends in motion."""
        return Ends(self.start_speed or (), self.end_speed or ())  # type: ignore[arg-type]  # checked

    @property
    def goal(self) -> str:
        """The goal of an optimal law."""
        return self.optimize or "peak_torque"

    @property
    def may_be_optimal(self) -> bool:
        """Whether the request admits an optimal law."""
        is_left_open = self.kind == "auto" or (self.law == "auto" and self.times != ())
        return self.kind == "optimal" or (is_left_open and self.smoothness <= HIGHEST_SMOOTHNESS)

    @property
    def fixed_duration(self) -> float:
        """The duration [s] of a polynomial law.

        Raises:
            InvalidInput: the request leaves the duration open.
        """
        if self.duration is None:
            raise InvalidInput("duration: a polynomial law needs one; only the optimal law can find its own")
        return self.duration

    @cached_property
    def bounded(self) -> bool:
        """Whether motor limits, a margin, a longest duration or a goal are stated."""
        if self.margin > 0 or self.optimize is not None or self.longest is not None:
            return True
        limits = (self.torque_limit, self.speed_limit)
        drives = (self.corner_speed, self.no_load_speed, self.rms_torque_limit)
        return any(map(is_limited, limits + drives))

    def _check_crossings(self) -> None:
        """Refuse invalid speeds [1/s], times [s] and path coordinates of crossings."""
        max_paths = 1e6  # largest s' at a crossing times the duration; feasible laws have a few
        largest = np.inf if self.duration is None else max_paths / self.duration
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

    def _check_ends(self) -> None:
        """Refuse more derivatives of s at an end in motion than a law can have there."""
        most = self.smoothness
        if self.smoothness >= HIGHEST_ORDER:  # springs follow derivatives beyond those that torques contain
            most = max(most, HIGHEST_STATED)
        for name, derivatives in (("start_speed", self.start_speed), ("end_speed", self.end_speed)):
            count = len(derivatives or ())  # type: ignore[arg-type]  # checked
            if count > most:
                raise InvalidInput(f"{name}: needs 1 to {most} derivatives of s, got {count}")

    def _check_optimal(self) -> None:
        """Refuse options that contradict the optimal law; advise the change that corrects the request.

        There is no advice if the duration is missing: only the user can choose one.
        """
        if self.times == ():
            why = "times: none, for a law without crossings, belong to the polynomial"
            raise self._refuse(why, times=None, speeds=None)
        end = self.duration or self.longest or np.inf
        for t in self.times or ():
            if not 0.0 < t < end:
                why = f"times: a crossing must lie inside the motion, (0, {end:g}) s, got {t:g}"
                raise self._refuse(why, times=None, speeds=None)
        if self.longest is not None and self.duration is not None:
            raise self._refuse(
                "longest: bounds a duration that is open; give either, not both", duration=None
            )
        if self.goal == "time" and self.duration is not None:
            raise self._refuse(
                "duration: with optimize time it is found; give longest to bound it", duration=None
            )
        if self.goal != "time" and self.duration is None and self.longest is None:
            raise InvalidInput(
                f"duration: optimize {self.goal} needs one, or longest: without, slower is always better"
            )
        if self.smoothness > HIGHEST_SMOOTHNESS:
            why = f"smoothness: got {self.smoothness}, the optimal law has at most {HIGHEST_SMOOTHNESS}"
            raise self._refuse(why, smoothness=HIGHEST_SMOOTHNESS)

    def _refuse(self, why: str, **change: Any) -> InvalidInput:
        """Return a refusal with a change of options that makes the request valid, if that can be.

        The changed request is made, and where it contradicts itself in other options, their remedy is added.
        None leaves an option out.
        """
        options = {name: DEFAULTS[name] if value is None else value for name, value in change.items()}
        refusal = InvalidInput(why)
        try:
            replace(self, **options)
        except InvalidInput as other:
            return refusal.advising(None if other.remedy is None else {**change, **other.remedy})
        return refusal.advising(change)


def checked_smoothness(robot: ParallelRobot, smoothness: int | None) -> int:
    """Return the order up to which derivatives of s vanish at both ends.

    The default is the least valid one: the torques contain at least the derivatives of s up to this order.

    Raises:
        InvalidInput: `smoothness` is no whole number, so small that the torques would jump at the ends, or
            too large.
    """
    least, largest = SMOOTHNESS[robot.n_e > 0], 12
    if smoothness is None:
        return least
    if isinstance(smoothness, bool) or not isinstance(smoothness, int | np.integer):
        raise InvalidInput(f"smoothness: needs a whole number, got {smoothness!r}")
    if not least <= smoothness <= largest:
        raise InvalidInput(
            f"smoothness: got {smoothness}, valid: {least} .. {largest} (the torque of a "
            f"{robot.flexibility} robot contains derivatives of s up to order {least} at least; fewer zeros "
            f"make it jump there)"
        ).advising({"smoothness": None})
    return int(smoothness)


# ------------------------------------------------------------------ goal and limits


@dataclass(frozen=True, eq=False)
class Specification(ReadOnlyArrays):
    """The goal of an optimal law, and its limits.

    goal: "time"; "peak_torque", the largest torque divided by its limit; or "energy", the integral of the sum
        of (torque over limit)^2. In these ratios the largest limit of the other motors replaces a missing
        limit, without bounding the torque; if no motor has a limit, all have the same weight.
    duration: exact duration [s]; None if open.
    longest: largest duration [s]; None if unbounded.
    times: required instants [s] of the crossings; empty if they are open.
    torque_limit, speed_limit: (n_a,) [N m], [rad/s], motor side; infinite for motors without a limit.
    smoothness: order up to which derivatives of s are given at both ends.
    friction: (n_a,) dry friction, which is part of the motors' torques [N m], motor side.
    ends: the derivatives of s at ends in motion; the others vanish.
    drives: torque-speed curves and RMS torque limits; None without any.
    shares_freely: whether redundant motors share the load as the goal and the limits ask for; otherwise
        their torques are those of least norm.
    """

    goal: str
    duration: float | None
    longest: float | None
    torque_limit: Array
    speed_limit: Array
    smoothness: int
    friction: Array
    ends: Ends = REST
    times: tuple[float, ...] = ()
    shares_freely: bool = False
    drives: DriveLimits | None = None

    @property
    def phi(self) -> Smoothstep:
        """The map from sigma to s, whose slope vanishes at ends at rest."""
        return Smoothstep(*self.ends.zeros(self.smoothness))

    @property
    def reference(self) -> Array:
        """Torques (n_a,) [N m] that peaks are relative to: the limits.

        A motor without a limit gets the largest limit of the others; 1 if no motor has one.
        """
        limit = self.torque_limit
        return np.where(self.limited_motors, limit, limit[self.limited_motors].max(initial=0.0) or 1.0)

    @property
    def limited(self) -> bool:
        """Whether any torque has a limit."""
        return bool(self.limited_motors.any())

    @property
    def limited_motors(self) -> BoolArray:
        """The mask (n_a,) of motors whose torque has a limit."""
        return np.isfinite(self.torque_limit)

    @property
    def limited_speeds(self) -> bool:
        """Whether any speed has a limit."""
        return bool(np.isfinite(self.speed_limit).any())

    @property
    def max_duration(self) -> float | None:
        """The largest admissible duration [s], if any."""
        return self.duration or self.longest


def specification_of(robot: ParallelRobot, request: Request) -> Specification:
    """Return the goal and the limits of a request, less its margin.

    The robot file has the limits that the request does not state.
    """
    share = 1.0 - request.margin
    torque_limit = motor_limits(robot, "torque_limit", request.torque_limit)
    drives = drive_limits(
        robot,
        torque_limit,
        request.corner_speed,
        request.no_load_speed,
        request.rms_torque_limit,
        request.cycle_time,
    )
    longest = request.longest
    if request.duration is None and drives is not None and request.cycle_time is not None:
        longest = min(longest or np.inf, request.cycle_time)  # the motion ends within its cycle
    # torques are distributed within torque limits alone
    shares_freely = robot.n_a > robot.n and not robot.n_e and drives is None
    return Specification(
        goal=request.goal,
        duration=request.duration,
        longest=longest,
        torque_limit=share * torque_limit,
        speed_limit=share * motor_limits(robot, "speed_limit", request.speed_limit),
        smoothness=request.smoothness,
        ends=request.ends,
        times=tuple(request.times or ()),
        friction=motor_friction(robot, request.friction),
        drives=None if drives is None else drives.scale(share),
        shares_freely=shares_freely and request.torque_sharing != "least_norm",
    )


# ------------------------------------------------------------------ sizes of a motion


def motor_peaks(dynamics: InverseDynamics) -> tuple[Array, Array]:
    """Compute the largest torques [N m, N] and speeds [rad/s, m/s] of a motion's motors, (n_a,) each.

    They are peaks of Chebyshev series, so that peaks between nodes count. The series have the panels and the
    number of coefficients of the torques.
    """
    grid = dynamics.torques.grid
    return peak_sizes(dynamics.torque, grid), peak_sizes(lambda t: dynamics.motor_angle(t, 1), grid)


def share_load(dynamics: InverseDynamics, request: Request, *, optimal: bool) -> InverseDynamics:
    """Return a motion with its torques distributed over redundant motors as a request asks for.

    Args:
        optimal: whether the law is that of the request's goal, which the distribution then serves.
    """
    if dynamics.robot.n_a == dynamics.robot.n:
        return dynamics
    return share_within(dynamics, specification_of(dynamics.robot, request), optimal=optimal)


def share_within(
    dynamics: InverseDynamics, specification: Specification, *, optimal: bool
) -> InverseDynamics:
    """Return a motion with its torques distributed within specified limits, as `share_load`."""
    if not specification.shares_freely:
        return dynamics
    goal = specification.goal if optimal else ""
    return distribute_torques(
        dynamics,
        specification.torque_limit,
        specification.reference,
        least_norm=goal == "energy",
        least_peak=goal == "peak_torque",
    )


def limit_excess(dynamics: InverseDynamics, specification: Specification) -> float:
    """Return the largest ratio of a motion's torques and speeds to the specified limits; 0 without limits."""
    drives = specification.drives
    torque_limit, speed_limit = specification.torque_limit, specification.speed_limit
    if drives is None and np.isinf([torque_limit, speed_limit]).all():
        return 0.0
    torque, speed = motor_peaks(dynamics)
    ratios = [torque / torque_limit, speed / speed_limit]
    if drives is not None:
        ratios += [
            curve_ratios(dynamics, drives),
            rms_torques(dynamics, drives.cycle_time) / drives.rms_torque_limit,
        ]
    return float(np.max(ratios))


def largest_by_unit(robot: ParallelRobot, torques: Array) -> Array:
    """Compute for each motor (n_a,) the largest torque of all motors of the same unit.

    Errors of torques are divided by it, since torques [N m] and forces [N] cannot be compared.

    Args:
        torques: (n_a,) >= 0.

    Returns:
        Positive numbers: the least positive float stands for zero, so that they can be divisors.
    """
    units = np.array(robot.torque_units)
    largest = [torques[units == unit].max() for unit in units]
    return np.maximum(largest, np.finfo(float).tiny)


def path_length(robot: ParallelRobot, path: Path) -> float:
    """Compute the length [m] of a path, with rotations multiplied by the robot's length.

    It is the length of the polygon through MOTION_SAMPLES of its points.
    """
    points = path(np.linspace(0.0, 1.0, MOTION_SAMPLES)) * (robot.length / robot.platform_scale)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
