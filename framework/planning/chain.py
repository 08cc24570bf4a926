"""Plans one after the other, as one motion; plans that begin at an instant of another plan.

A plan that is left at an instant and the next one meet if the position of the platform and its time
derivatives agree there, up to the order that the torques contain. The path of a chain is the motion of the
platform itself, x(s) at the time t = s T of the whole duration T, so that it is as smooth as the motion; its
law is s = t / T.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import factorial
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import polynomial

from framework.dynamics.drive_limits import DriveLimits
from framework.dynamics.loaded_balance import springs_carry_inertia
from framework.dynamics.motor_friction import PlannedFriction, motor_friction
from framework.dynamics.motor_limits import shortest_form
from framework.dynamics.result import Certificate, InverseDynamics
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.continuation.tracking import track_path
from framework.kinematics.frames import difference
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import Law, compose_derivatives, is_number, law_derivatives
from framework.laws.path import (
    HIGHEST_STATED,
    NO_KNOTS,
    Line,
    Part,
    Path,
    expect_path,
    highest_order,
)
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.planning.plan import plan_crossing
from framework.planning.request import DRIVE_OPTIONS, MOTOR_LIMITS, SMOOTHNESS, specification_of
from framework.planning.result import Crossing, CrossingPlan
from framework.tolerances import AT_REST, SEAM_JUMP, SEAM_JUMP_GROWTH

END_SAMPLES = 1001  # of a chain, for the largest speed of its motors


def restart_plan(
    plan: CrossingPlan, t: float, path: Path | Array | Sequence[float] | None, **options: Any
) -> CrossingPlan:
    """Plan on from an instant t [s] of a plan, as `CrossingPlan.restart`."""
    _check_instant(plan, t)
    robot = plan.robot
    orders = [SMOOTHNESS[robot.n_e > 0]]
    if robot.n_e and plan.geometry == "deformed" and springs_carry_inertia(track_path(robot, plan.path)):
        # such springs follow all derivatives of x: eight leave 1e-7 of the torques beside a crossing alone
        most = highest_order(plan.path)
        if path is not None and not isinstance(path, Sequence | np.ndarray):
            most = min(most, highest_order(path))
        orders = sorted({min(8, most), most})
    for order in orders:
        restarted = _plan_on(plan, t, path, order, options)
        jump = _find_jump(plan, t, restarted)
        if jump is None:
            return restarted
    assert jump is not None  # from a loop that was entered
    raise jump


def _plan_on(
    plan: CrossingPlan,
    t: float,
    path: Path | Array | Sequence[float] | None,
    orders: int,
    options: Mapping[str, Any],
) -> CrossingPlan:
    """Plan on from an instant t [s] with so many `orders` of derivatives of the plan's motion."""
    robot = plan.robot
    s_rates = law_derivatives(plan.law, np.array(float(t)), orders + 1)
    by_s = [plan.path(s_rates[0], k) for k in range(orders + 1)]
    motion = compose_derivatives(by_s, s_rates[1:])
    rates = plan.platform(np.linspace(0.0, plan.duration, 201), 1) / robot.platform_scale  # (T, n)
    is_at_rest = np.abs(motion[1] / robot.platform_scale).max() <= AT_REST * np.abs(rates).max()
    if path is not None and is_at_rest:
        raise InvalidInput(f"path: at t = {t:g} s the platform rests, a restart needs s' > 0")
    if path is None:
        s = float(s_rates[0])
        if not s < 1.0 - SEAM_JUMP:
            raise InvalidInput(f"path: at t = {t:g} s nothing is left of the plan's own; give another")
        is_line = isinstance(plan.path, Line)
        path = Line(plan.path(s), plan.path(1.0)) if is_line else Part(plan.path, s, 1.0)
    elif isinstance(path, Sequence | np.ndarray):
        path = DepartingCurve.to_goal(robot, motion, finite_numbers("path", path, robot.n))
    expect_path(path)
    if "start_speed" in options:
        raise InvalidInput("start_speed: that of a restart is the plan's own, leave it out")
    if "wrenches" not in options and _has_varying_wrenches(plan):
        raise InvalidInput("wrenches: those of the plan depend on its s; state those along the new path")
    start = _law_derivatives_on(robot, path, motion)
    names = ("friction", "wrenches", "torque_sharing")
    shared = {name: getattr(plan.request, name) for name in names} | {"geometry": plan.geometry}
    return plan_crossing(robot, path, **{**shared, **options}, start_speed=start)


def chain_plans(plans: Sequence[CrossingPlan], times: Sequence[float] = ()) -> CrossingPlan:
    """Join plans of one robot, one after the other, to one plan.

    Args:
        plans: two or more; each begins where the last one is left, in position, speed and acceleration.
        times: instants [s] at which all plans but the last are left, each in the plan's own time; by default
            their ends.

    Raises:
        InvalidInput: the plans are of different robots, or do not meet.
    """
    if len(plans) < 2:
        raise InvalidInput(f"plans: a chain needs at least two, got {len(plans)}")
    leaves = [*(times if len(times) else [plan.duration for plan in plans[:-1]]), plans[-1].duration]
    if len(leaves) != len(plans):
        raise InvalidInput(f"times: needs {len(plans) - 1}, one for each plan but the last, got {len(times)}")
    for plan, following, leave in zip(plans, plans[1:], leaves, strict=False):
        _check_instant(plan, leave)
        jump = _find_jump(plan, leave, following)
        if jump is not None:
            raise jump
    wrenches = plans[0].request.wrenches
    if any(plan.request.wrenches != wrenches for plan in plans) or _has_varying_wrenches(plans[0]):
        raise InvalidInput(
            "plans: only those with the same wrenches, which do not depend on s, can be chained"
        )

    path = MotionPath(tuple(plans), tuple(leaves))
    law = Law(np.array([0.5, 0.5]), path.duration)
    friction = motor_friction(plans[0].robot, plans[0].request.friction)
    dynamics = _join(path, law, friction)
    speed = 1.0 / path.duration
    request = replace(
        plans[0].request,
        path=path,
        **_loosest_limits(plans),
        times=None,
        speeds=None,
        at=None,
        optimize=None,
        longest=None,
        law="auto",
        margin=0.0,
        duration=path.duration,
        start_speed=speed,
        end_speed=speed,
    )
    return CrossingPlan(
        plans[0].robot,
        request,
        law,
        dynamics.crossings,
        dynamics,
        dynamics.certificate,
        seconds=sum(plan.seconds for plan in plans),
        reason=f"a chain of {len(plans)} plans",
    )


@dataclass(frozen=True, eq=False)
class DepartingCurve:
    """A polynomial path that leaves a motion smoothly; `powers` (m, n) are its coefficients of s^k."""

    powers: Array

    knots: ClassVar[Array] = NO_KNOTS
    highest_order: ClassVar[int] = HIGHEST_STATED

    @staticmethod
    def to_goal(robot: ParallelRobot, motion: Sequence[Array], goal: Array) -> DepartingCurve:
        """Return a curve from a `motion` (n,) each to a goal (n,).

        The motion is x, x', x", ... With p' = x'/v as long as the way w to the goal, the law takes what of
        x", ... is along p', and the curve begins as c(s) = x + p' s + p" s^2 / 2 + ... with p", ... across
        p'. A step h(s), flat at both ends, leads to the straight way to the goal:
        (1 - h) c + h (x + s w) = c + h (x + s w - c).

        Raises:
            InvalidInput: the platform rests, or is at the goal.
        """
        x, *rates = motion
        scale = robot.platform_scale
        way = goal - x
        length = float(np.linalg.norm(way / scale))
        v = float(np.linalg.norm(rates[0] / scale)) / length if length > 0.0 else 0.0
        if not v > 0.0:
            raise InvalidInput(
                f"path: from {x.tolist()} to {goal.tolist()} the platform rests, or has no way to go"
            )
        by_s = [x, rates[0] / v]  # p, p', ... (n,) each, by s
        s_rates = [np.array(v)]  # s', s", ... by time
        tangent = by_s[1] / scale
        for order, rate in enumerate(rates[1:], start=2):
            # rate = p' s^(order) + p^(order) s'^order + what lower orders give
            rest = rate - compose_derivatives([*by_s, np.zeros(robot.n)], [*s_rates, np.zeros(())])[order]
            s_rates.append((rest / scale) @ tangent / (tangent @ tangent))
            by_s.append((rest - by_s[1] * s_rates[-1]) / v**order)
        # coefficients of s^k: h (h,) with h' ~ s^m (1 - s)^2, then c and x + s w - c (m, n)
        step = polynomial.polyint(polynomial.polymul([0.0] * len(rates) + [1.0], [1.0, -2.0, 1.0]))
        step = step / step.sum()
        curve = np.array(by_s) / [[factorial(k)] for k in range(len(by_s))]
        to_line = -curve
        to_line[:2] += [x, way]
        powers = np.zeros((len(step) + len(curve) - 1, robot.n))
        powers[: len(curve)] = curve
        for k, share in enumerate(step):  # the product of h and x + s w - c
            powers[k : k + len(curve)] += share * to_line
        return DepartingCurve(powers)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return int(self.powers.shape[1])

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s; s of any shape (...) gives (..., n)."""
        derivative = polynomial.polyder(self.powers, order)
        return np.moveaxis(polynomial.polyval(np.asarray(s, dtype=float), derivative), 0, -1)


@dataclass(frozen=True, eq=False)
class MotionPath:
    """The motion of the platform over its whole time, s = t / duration, as a path.

    plans: one after the other.
    leaves: the instants (k,) [s] at which they are left, each in its own time.
    """

    plans: tuple[CrossingPlan, ...]
    leaves: tuple[float, ...]

    @property
    def starts(self) -> Array:
        """The instants (k + 1,) [s] at which the pieces begin, and the end."""
        return np.concatenate([[0.0], np.cumsum(self.leaves)])

    @property
    def duration(self) -> float:
        """The time [s] of all pieces together."""
        return float(self.starts[-1])

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return self.plans[0].path.n

    @property
    def knots(self) -> Array:
        """The ends of the panels on which the motion is analytic, (m,) inside (0, 1)."""
        edges = [
            start + plan.dynamics.torques.edges[plan.dynamics.torques.edges < leave]
            for plan, start, leave in zip(self.plans, self.starts, self.leaves, strict=False)
        ]
        return np.unique(np.concatenate(edges))[1:] / self.duration

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s; s of any shape (...) gives (..., n)."""
        values = np.asarray(s, dtype=float)
        t = values.ravel() * self.duration
        index = np.searchsorted(self.starts[1:-1], t, side="right")
        result = np.empty((len(t), self.n))
        for k, (plan, leave) in enumerate(zip(self.plans, self.leaves, strict=True)):
            times = np.clip(t[index == k] - self.starts[k], 0.0, leave)
            result[index == k] = plan.platform(times, order) * self.duration**order
        return result.reshape(*values.shape, self.n)


def _law_derivatives_on(robot: ParallelRobot, path: Path, motion: Sequence[Array]) -> tuple[float, ...]:
    """Compute s', s", ... at the start of a path from the platform's motion.

    The `motion` is x, x', x", ... (n,) each. With the derivatives p', p", ... of the path, x' = p' s', x" =
    p" s'^2 + p' s", ... determine them one after the other by least squares.

    Raises:
        InvalidInput: the path starts elsewhere, in another direction, or with another curvature, or the
            platform does not move along it.
    """
    scale = robot.platform_scale  # (n,)
    by_s = [path(0.0, k) / scale for k in range(len(motion))]
    x, *rates = (value / scale for value in motion)
    if np.abs(by_s[0] - x).max() > SEAM_JUMP:
        raise InvalidInput(
            f"path: starts at {path(0.0).tolist()}, the platform is at {motion[0].tolist()}; a restart takes "
            f"a path that starts at all digits of plan.platform(t), or a goal"
        )
    derivatives = list[Array]()
    for order, rate in enumerate(rates, start=1):
        given = compose_derivatives(by_s[: order + 1], [*derivatives, np.zeros(())])[order]
        derivatives.append((rate - given) @ by_s[1] / (by_s[1] @ by_s[1]))
        miss = np.abs(rate - given - derivatives[-1] * by_s[1]).max()
        speed = np.linalg.norm(by_s[1]) * float(derivatives[0]) ** order  # the size of such a derivative
        if miss > SEAM_JUMP * max(np.abs(rate).max(), np.abs(given).max(), speed):
            raise InvalidInput(
                f"path: its derivative of order {order} by s at its start does not follow the motion of the "
                f"platform, dx/dt = {motion[1].tolist()}: it is off by {miss * scale.max():.2g}; "
                f"a restart takes a path that follows it, or a goal"
            )
        if order == 1 and not derivatives[0] > 0.0:
            raise InvalidInput(
                "path: the platform rests at its start or moves backwards, a restart needs s' > 0"
            )
    return tuple(map(float, derivatives))


def _has_varying_wrenches(plan: CrossingPlan) -> bool:
    """Return whether external wrenches of a plan depend on s."""
    return any(entry.rows.ndim == 2 for entry in plan.dynamics.wrenches.entries)


def _loosest_limits(plans: Sequence[CrossingPlan]) -> dict[str, Any]:
    """Return options of the largest limits (n_a,) of the plans, less margins, and their cycle time.

    Each plan keeps its own limits, and so the motion of all keeps the largest. None stands for those of the
    robot file.
    """
    specifications = [specification_of(plan.robot, plan.request) for plan in plans]
    has_margin = any(plan.request.margin for plan in plans)
    loosest: dict[str, Any] = dict.fromkeys(MOTOR_LIMITS)
    stated = {name for name in MOTOR_LIMITS for plan in plans if getattr(plan.request, name) is not None}
    for name in ("torque_limit", "speed_limit"):
        if has_margin or name in stated:
            limits = [getattr(specification, name) for specification in specifications]
            loosest[name] = shortest_form(np.max(limits, axis=0))
    if has_margin or stated.intersection(DRIVE_OPTIONS):
        unlimited = DriveLimits(*(np.full(plans[0].robot.n_a, np.inf),) * 4, None)
        corner, no_load, rms = envelop_drives([each.drives or unlimited for each in specifications])
        loosest["rms_torque_limit"] = shortest_form(rms)
        loosest["corner_speed"], loosest["no_load_speed"] = shortest_form(corner), shortest_form(no_load)
    cycles = [plan.request.cycle_time for plan in plans]
    if any(cycles):
        loosest["cycle_time"] = sum(cycle or plan.duration for cycle, plan in zip(cycles, plans, strict=True))
    return loosest


def envelop_drives(drives: Sequence[DriveLimits]) -> tuple[Array, Array, Array]:
    """Return the least corner speeds, no-load speeds and RMS torques (n_a,) that admit what each drive does.

    A curve admits |T| <= T_0 and |w + k T| <= w_0 (`dynamics.drive_limits`). Its corners at w > 0 are
    (w_0 - k T_0, T_0) and, braking, (w_0 + k T_0, -T_0). With the least k of all curves and the largest T_0
    the second corner is the one that needs the larger w_0: w_0 + (k - least k) T_0.
    """
    torque, corner, no_load, rms = (np.array(values) for values in list(zip(*drives, strict=True))[:4])
    has_curve = np.isfinite(no_load).all(axis=0)  # (n_a,) in every plan; the arrays above are (plans, n_a)
    with np.errstate(invalid="ignore"):  # of motors without a curve
        k = (no_load - corner) / torque
        widened = np.max(no_load + (k - k.min(axis=0)) * torque, axis=0)
        corner_speed = np.where(has_curve, widened - k.min(axis=0) * torque.max(axis=0), np.inf)
    return corner_speed, np.where(has_curve, widened, np.inf), rms.max(axis=0)


def _check_instant(plan: CrossingPlan, t: float) -> None:
    """Raise InvalidInput unless t [s] is an instant of a plan after its start."""
    if not (is_number(t) and 0.0 < t <= plan.duration):
        raise InvalidInput(f"t: must lie in (0, {plan.duration:g}] s, got {t!r}")


def _find_jump(plan: CrossingPlan, t: float, following: CrossingPlan) -> InvalidInput | None:
    """Return the error if the following plan does not begin as a plan moves at t [s]; else None.

    Motor angles, torques, the platform with two derivatives and the deflections with one are compared, over
    the largest of the plan.
    """
    robot, other = plan.robot, following.robot
    if other is not robot and (other.name, other.flexibility) != (robot.name, robot.flexibility):
        raise InvalidInput(
            f"plans: of {robot.name}, {robot.flexibility}, and of {other.name}, {other.flexibility}"
        )
    samples = np.linspace(0.0, plan.duration, 201)
    compared = [  # the cause before what follows from it
        ("platform", CrossingPlan.platform, 0),
        ("motor angle", CrossingPlan.motor_angle, 0),
        ("platform", CrossingPlan.platform, 1),
        ("platform", CrossingPlan.platform, 2),
        ("torque", CrossingPlan.torque, 0),
        *(("deflection", CrossingPlan.deflection, order) for order in range(2) if robot.n_e),
    ]
    for quantity, function, order in compared:
        jump = np.abs(function(following, 0.0, order) - function(plan, t, order)).max()
        size = np.abs(function(plan, samples, order)).max()
        if jump > SEAM_JUMP * SEAM_JUMP_GROWTH**order * size:
            what = quantity if order == 0 else f"time derivative of order {order} of the {quantity}"
            shared = specification_of(robot, plan.request).shares_freely and quantity == "torque"
            why = "the next plan begins with the motion at which this one is left"
            if order == 1 and quantity == "platform":
                why = "a corner is passed at rest"
            elif shared:
                why = "of torque_sharing, least_norm alone depends on the motion alone"
            return InvalidInput(
                f"plans: at t = {t:g} s the {what} jumps by {jump:.2g}, its size is {size:.3g}: {why}"
            )
    return None


def _join(path: MotionPath, law: Law, friction: Array) -> InverseDynamics:
    """Join the torques and motions of the pieces of a path, up to their leaves.

    Args:
        friction: dry, of the motors (n_a,) [N m, N], motor side.
    """
    pieces = [plan.dynamics for plan in path.plans]
    join = partial(_join_functions, path)
    motor_angles = join([piece.motor_angles for piece in pieces])
    return replace(
        pieces[0],
        path=path,
        law=law,
        torques=join([piece.torques for piece in pieces]),
        motor_angles=motor_angles,
        deflections=join([piece.deflections for piece in pieces]),
        deflection_rates=tuple(join([piece.deflection_rates[k] for piece in pieces]) for k in range(2)),
        offsets=join([_offsets_from(pieces[0].origin, piece) for piece in pieces]),
        crossings=_join_crossings(path),
        certificate=_join_certificates(path, motor_angles),
        friction=PlannedFriction.from_speed(friction, partial(motor_angles, order=1), path.duration),
    )


def _join_functions(path: MotionPath, functions: Sequence[TimeFunction]) -> TimeFunction:
    """Join a function of time, given on each of the pieces of a path, up to their leaves."""
    cut = [_cut_function(function, leave) for function, leave in zip(functions, path.leaves, strict=True)]
    size = max(function.coefficients.shape[1] for function in cut)
    edges, coefficients = [], []
    for function, start in zip(cut, path.starts[:-1], strict=True):
        missing = size - function.coefficients.shape[1]  # of the highest degrees, which are zero
        edges.append(start + function.edges[:-1])
        coefficients.append(np.pad(function.coefficients, ((0, 0), (0, missing), (0, 0))))
    return TimeFunction(np.concatenate([*edges, [path.duration]]), np.concatenate(coefficients))


def _join_crossings(path: MotionPath) -> tuple[Crossing, ...]:
    """Return the crossings of all pieces up to their leaves, at the s = t / duration of the path."""
    crossings = []
    speed = 1.0 / path.duration  # s' of a chain
    for plan, start, leave in zip(path.plans, path.starts[:-1].tolist(), path.leaves, strict=True):
        for crossing in plan.crossings:
            if crossing.time < leave:
                time = start + crossing.time
                crossings.append(
                    replace(
                        crossing, time=time, s=time * speed, speed=speed, acceleration=0.0, condition=None
                    )
                )
    return tuple(crossings)


def _join_certificates(path: MotionPath, motor_angles: TimeFunction) -> Certificate:
    """Return the worst numbers of all pieces' certificates, the sums of counts, and the speed at the ends."""
    certificates = [plan.certificate for plan in path.plans]
    each = [asdict(certificate) for certificate in certificates]
    worst: dict[str, Any] = {name: max(numbers[name] for numbers in each) for name in each[0]}
    times = np.linspace(0.0, path.duration, END_SAMPLES)
    speeds = np.abs(motor_angles(times, 1)).max(axis=1)  # (END_SAMPLES,)
    return replace(
        Certificate(**worst),
        nodes=sum(certificate.nodes for certificate in certificates),
        passes=sum(certificate.passes for certificate in certificates),
        monotone=all(certificate.monotone for certificate in certificates),
        end_speed=float(speeds[[0, -1]].max() / speeds.max()),
    )


def _cut_function(function: TimeFunction, leave: float) -> TimeFunction:
    """Return a function on [0, leave] [s]; the part of a polynomial is one of the same degree."""
    if leave >= function.edges[-1]:
        return function
    edges = np.append(function.edges[function.edges < leave], leave)
    grid = TimeGrid(edges, function.coefficients.shape[1])
    return grid.fit(function(np.clip(grid.times, 0.0, leave)))


def _offsets_from(origin: Array, piece: InverseDynamics) -> TimeFunction:
    """Return the tangent offsets of a motion from another origin (nq,)."""
    grid = piece.offsets.grid
    return grid.fit(difference(piece.robot, origin, piece.configuration(grid.times)))
