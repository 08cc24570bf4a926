"""Plans one after the other, as one motion; plans that begin at an instant of another plan.

A plan that is left at an instant and the next one meet if the position of the platform and its time
derivatives agree there, up to the order that the torques contain. The chain has one path parameter s from 0
to 1, of which each plan has an equal part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import factorial
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import polynomial

from framework.dynamics.motor_friction import PlannedFriction, motor_friction
from framework.dynamics.result import Certificate, InverseDynamics
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.frames import difference
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import REST, Ends, PlannedLaw, compose_derivatives, is_number, normalise_time
from framework.laws.path import NO_KNOTS, Line, Part, Path, expect_path
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.planning.plan import plan_crossing
from framework.planning.request import PEAK_SAMPLES, SMOOTHNESS
from framework.planning.result import CrossingPlan
from framework.tolerances import SAME_PLACE, SEAM_JUMP


def restart_plan(
    plan: CrossingPlan, t: float, path: Path | Array | Sequence[float] | None, **options: Any
) -> CrossingPlan:
    """Plan on from an instant t [s] of a plan, as `CrossingPlan.restart`."""
    _check_instant(plan, t)
    robot = plan.robot
    orders = SMOOTHNESS[robot.n_e > 0]
    motion = [plan.platform(t, k) for k in range(orders + 1)]
    if isinstance(path, Sequence | np.ndarray):
        path = DepartingCurve.to_goal(robot, motion, finite_numbers("path", path, robot.n))
    elif path is None:
        s = float(plan.law(t))
        is_line = isinstance(plan.path, Line)
        path = Line(plan.path(s), plan.path(1.0)) if is_line else Part(plan.path, s, 1.0)
    expect_path(path)
    if "start_speed" in options:
        raise InvalidInput("start_speed: that of a restart is the plan's own, leave it out")
    start = _law_derivatives_on(robot, path, motion)
    shared = {"friction": plan.request.friction, "wrenches": plan.request.wrenches, "geometry": plan.geometry}
    restarted = plan_crossing(robot, path, **{**shared, **options}, start_speed=start)
    _check_seam(plan, t, restarted)
    return restarted


def chain_plans(plans: Sequence[CrossingPlan], times: Sequence[float] = ()) -> CrossingPlan:
    """Return plans of one robot, one after the other, as one plan for simulation, control and export.

    Args:
        plans: two or more; each begins where the last one is left, in position, speed and acceleration.
        times: instants [s] at which all plans but the last are left, each in the plan's own time; by default
            their ends.

    Raises:
        InvalidInput: the plans are of different robots, or do not meet.
    """
    if len(plans) < 2:
        raise InvalidInput(f"plans: a chain needs at least two, got {len(plans)}")
    leaves = [*(times or [plan.duration for plan in plans[:-1]]), plans[-1].duration]
    if len(leaves) != len(plans):
        raise InvalidInput(f"times: needs {len(plans) - 1}, one for each plan but the last, got {len(times)}")
    for plan, following, leave in zip(plans, plans[1:], leaves, strict=False):
        _check_instant(plan, leave)
        _check_seam(plan, leave, following)
        s = plan.law(np.linspace(0.0, leave, PEAK_SAMPLES))
        if not np.all(s <= s[-1] * (1.0 + SAME_PLACE)):
            raise InvalidInput(f"plans: one passes s = {s[-1]:.6g}, where it is left, before and comes back")
    if any(entry.rows.ndim == 2 for plan in plans for entry in plan.dynamics.wrenches.entries):
        raise InvalidInput("plans: wrenches that are tables over a path cannot be chained")

    law = ChainedLaw(tuple(plan.law for plan in plans), tuple(leaves))
    parts = [Part(plan.path, 0.0, end) for plan, end in zip(plans, law.s_ends, strict=True)]
    path = ChainedPath(tuple(parts))
    friction = motor_friction(plans[0].robot, plans[0].request.friction)
    dynamics = _join([plan.dynamics for plan in plans], law, path, friction)
    crossings = [
        replace(
            crossing,
            s=float(law(law.starts[k] + crossing.time)),
            time=law.starts[k] + crossing.time,
            speed=float(law(law.starts[k] + crossing.time, 1)),
            acceleration=float(law(law.starts[k] + crossing.time, 2)),
            condition=None,  # its coefficients are those of another s
        )
        for k, plan in enumerate(plans)
        for crossing in plan.crossings
        if crossing.time < leaves[k]
    ]
    first = plans[0]
    request = replace(
        first.request,
        path=path,
        times=None,
        speeds=None,
        at=None,
        optimize=None,
        longest=None,
        law="auto",
        margin=0.0,
        duration=law.duration,
        start_speed=tuple(law.s_scales[0] * np.array(first.request.ends.start)) or None,
        end_speed=tuple(law.s_scales[-1] * np.array(plans[-1].request.ends.goal)) or None,
    )
    return CrossingPlan(
        first.robot,
        request,
        law,
        tuple(crossings),
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

    @staticmethod
    def to_goal(robot: ParallelRobot, motion: Sequence[Array], goal: Array) -> DepartingCurve:
        """Return the curve of least degree from x, x', x", ... (n,) of a motion to a goal (n,).

        At s = 0, where s' = v and all further derivatives of s vanish, its derivatives by s are x'/v, x"/v^2,
        ... With v = |x'| / |goal - x| the tangent is as long as the way.

        Raises:
            InvalidInput: the platform rests, or is at the goal.
        """
        x, *rates = motion
        scale = robot.platform_scale
        way = float(np.linalg.norm((goal - x) / scale))
        v = float(np.linalg.norm(rates[0] / scale)) / way if way > 0.0 else 0.0
        if not v > 0.0:
            raise InvalidInput(
                f"path: from {x.tolist()} to {goal.tolist()} the platform rests, or has no way to go"
            )
        powers = [rate / (factorial(k) * v**k) for k, rate in enumerate(motion)]
        return DepartingCurve(np.array([*powers, goal - np.sum(powers, axis=0)]))

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return int(self.powers.shape[1])

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s; s of any shape (...) gives (..., n)."""
        derivative = polynomial.polyder(self.powers, order)
        return np.moveaxis(polynomial.polyval(np.asarray(s, dtype=float), derivative), 0, -1)


@dataclass(frozen=True, eq=False)
class ChainedPath:
    """Parts of paths one after the other, each on an equal interval of s."""

    parts: tuple[Path, ...]

    @property
    def edges(self) -> Array:
        """The ends (k + 1,) of the parts in s."""
        return np.linspace(0.0, 1.0, len(self.parts) + 1)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return self.parts[0].n

    @property
    def knots(self) -> Array:
        """The knots of the parts, and where they join."""
        edges = self.edges
        inner = [
            start + (end - start) * part.knots
            for part, start, end in zip(self.parts, edges, edges[1:], strict=False)
        ]
        return np.sort(np.concatenate([edges[1:-1], *inner]))

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s; at a join, of the part behind it."""
        values = np.asarray(s, dtype=float)
        flat = values.ravel()
        edges = self.edges
        index = np.searchsorted(edges[1:-1], flat, side="right")
        result = np.empty((len(flat), self.n))
        for k, part in enumerate(self.parts):
            chosen = index == k
            width = edges[k + 1] - edges[k]
            result[chosen] = part((flat[chosen] - edges[k]) / width, order) / width**order
        return result.reshape(*values.shape, self.n)


@dataclass(frozen=True, eq=False)
class ChainedLaw(PlannedLaw):
    """Laws one after the other, left at instants `leaves` (k,) [s] of their own time, on a `ChainedPath`."""

    laws: tuple[PlannedLaw, ...]
    leaves: tuple[float, ...]

    kind: ClassVar[str] = "chain"

    @property
    def starts(self) -> Array:
        """The instants (k + 1,) [s] at which the laws begin, and the end."""
        return np.concatenate([[0.0], np.cumsum(self.leaves)])

    @property
    def duration(self) -> float:  # type: ignore[override]
        """The duration of the chain [s]."""
        return float(self.starts[-1])

    @property
    def coefficients(self) -> Array:  # type: ignore[override]
        """The coefficients of all laws."""
        return np.concatenate([law.coefficients for law in self.laws])

    @property
    def degree(self) -> int:
        """The largest degree of the laws."""
        return max(law.degree for law in self.laws)

    @property
    def s_ends(self) -> Array:
        """The s (k,) of each law where it is left."""
        return np.array([float(law(leave)) for law, leave in zip(self.laws, self.leaves, strict=True)])

    @property
    def s_scales(self) -> Array:
        """The chain's s for one of each law (k,)."""
        return 1.0 / (len(self.laws) * self.s_ends)

    @property
    def edges(self) -> Array:
        """Panel edges (m,) [s] of all laws."""
        starts = self.starts
        inner = [
            start + law.edges[(law.edges > 0.0) & (law.edges < leave)]
            for law, start, leave in zip(self.laws, starts, self.leaves, strict=False)
        ]
        return np.unique(np.concatenate([starts, *inner]))

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate s(t) or its derivative [1/s^order], with the shape of t."""
        return self.derivatives(t, order + 1)[order]

    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        """Compute s and its derivatives of orders below `count`; at a join, of the law behind it."""
        normalise_time(t, self.duration)  # refuses t outside [0, duration]
        times = np.asarray(t, dtype=float)
        flat = np.clip(times.ravel(), 0.0, self.duration)
        starts, edges = self.starts, np.linspace(0.0, 1.0, len(self.laws) + 1)
        index = np.searchsorted(starts[1:-1], flat, side="right")
        result = np.empty((count, len(flat)))
        for k, (law, scale) in enumerate(zip(self.laws, self.s_scales, strict=True)):
            chosen = index == k
            values = law.derivatives(np.clip(flat[chosen] - starts[k], 0.0, self.leaves[k]), count)
            result[:, chosen] = scale * np.array(values)
            # on the law's own part of the path, whatever rounding says
            last = np.inf if k == len(self.laws) - 1 else np.nextafter(edges[k + 1], 0.0)
            result[0, chosen] = np.clip(edges[k] + result[0, chosen], edges[k] if k else -np.inf, last)
        return list(result.reshape(count, *times.shape))

    def least_speed_ratio(self, smoothness: int, ends: Ends = REST) -> float:
        """Return the least ratio of the laws, each with its own ends; not used for a chain."""
        return min(law.least_speed_ratio(smoothness, ends) for law in self.laws)

    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""
        return {"kind": self.kind, "leaves": list(self.leaves), "laws": [law.to_dict() for law in self.laws]}


def _law_derivatives_on(robot: ParallelRobot, path: Path, motion: Sequence[Array]) -> tuple[float, ...]:
    """Compute s', s", ... at the start of a path from x, x', x", ... (n,) of the platform there.

    With the derivatives p', p", ... of the path, x' = p' s', x" = p" s'^2 + p' s", ... determine them one
    after the other by least squares.

    Raises:
        InvalidInput: the path starts elsewhere, in another direction, or with another curvature, or the
            platform does not move along it.
    """
    scale = robot.platform_scale  # (n,)
    by_s = [path(0.0, k) / scale for k in range(len(motion))]
    x, *rates = (value / scale for value in motion)
    if np.abs(by_s[0] - x).max() > SEAM_JUMP:
        raise InvalidInput(f"path: starts at {path(0.0).tolist()}, the platform is at {motion[0].tolist()}")
    derivatives = list[Array]()
    for order, rate in enumerate(rates, start=1):
        given = compose_derivatives(by_s[: order + 1], [*derivatives, np.zeros(())])[order]
        derivatives.append((rate - given) @ by_s[1] / (by_s[1] @ by_s[1]))
        miss = np.abs(rate - given - derivatives[-1] * by_s[1]).max()
        speed = np.linalg.norm(by_s[1]) * float(derivatives[0]) ** order  # the size of such a derivative
        if miss > SEAM_JUMP * max(np.abs(rate).max(), np.abs(given).max(), speed):
            raise InvalidInput(
                f"path: its derivative of order {order} by s at its start does not follow the motion of the "
                f"platform, dx/dt = {motion[1].tolist()}: it is off by {miss * scale.max():.2g}"
            )
        if order == 1 and not derivatives[0] > 0.0:
            raise InvalidInput(
                "path: the platform rests at its start or moves backwards, a restart needs s' > 0"
            )
    return tuple(map(float, derivatives))


def _check_instant(plan: CrossingPlan, t: float) -> None:
    """Raise InvalidInput unless t [s] is an instant of a plan after its start."""
    if not (is_number(t) and 0.0 < t <= plan.duration):
        raise InvalidInput(f"t: must lie in (0, {plan.duration:g}] s, got {t!r}")


def _check_seam(plan: CrossingPlan, t: float, following: CrossingPlan) -> None:
    """Raise InvalidInput unless the next plan begins with the motion of a plan at t [s].

    Motor angles and speeds, platform, torques and deflections are compared, over the largest of the plan.
    """
    if following.robot is not plan.robot and following.robot.name != plan.robot.name:
        raise InvalidInput(f"plans: of {plan.robot.name} and of {following.robot.name}")
    robot = plan.robot
    samples = np.linspace(0.0, plan.duration, 201)
    compared = [
        ("motor angle", CrossingPlan.motor_angle, 0),
        ("torque", CrossingPlan.torque, 0),
        *(("platform", CrossingPlan.platform, order) for order in range(3)),
        *(("deflection", CrossingPlan.deflection, order) for order in range(2) if robot.n_e),
    ]
    for quantity, function, order in compared:
        jump = np.abs(function(following, 0.0, order) - function(plan, t, order)).max()
        size = np.abs(function(plan, samples, order)).max()
        if jump > SEAM_JUMP * 100**order * size:  # each derivative of a series loses two digits
            what = quantity if order == 0 else f"time derivative of order {order} of the {quantity}"
            raise InvalidInput(
                f"plans: at t = {t:g} s the {what} jumps by {jump:.2g}, its size is {size:.3g}"
            )


def _join(pieces: Sequence[InverseDynamics], law: ChainedLaw, path: Path, size: Array) -> InverseDynamics:
    """Join the torques and motions of pieces, each up to the instant at which its law is left.

    Args:
        size: dry friction (n_a,) of the motors [N m, N], motor side.
    """
    first = pieces[0]
    windows = list(zip(pieces, law.starts, law.leaves, strict=False))

    def join(functions: Sequence[TimeFunction]) -> TimeFunction:
        """Join a function of time of all pieces, each up to where it is left."""
        cut = [_cut(function, leave) for function, leave in zip(functions, law.leaves, strict=True)]
        size = max(function.coefficients.shape[1] for function in cut)
        edges = [start + function.edges[:-1] for function, start in zip(cut, law.starts, strict=False)]
        padded = [
            np.pad(function.coefficients, ((0, 0), (0, size - function.coefficients.shape[1]), (0, 0)))
            for function in cut
        ]
        return TimeFunction(np.concatenate([*edges, [law.duration]]), np.concatenate(padded))

    motor_angles = join([piece.motor_angles for piece in pieces])
    certificates = [piece.certificate for piece in pieces]
    largest = {
        name: max(getattr(certificate, name) for certificate in certificates)
        for name in (
            "tail",
            "change",
            "max_closure_error",
            "max_residual_torque",
            "max_held_torque",
            "rounded_gap",
        )
    }
    certificate = Certificate(
        nodes=sum(certificate.nodes for certificate in certificates),
        passes=sum(certificate.passes for certificate in certificates),
        end_speed=max(certificates[0].end_speed, certificates[-1].end_speed),
        monotone=all(certificate.monotone for certificate in certificates),
        **largest,
    )
    return replace(
        first,
        path=path,
        law=law,
        torques=join([piece.torques for piece in pieces]),
        motor_angles=motor_angles,
        deflections=join([piece.deflections for piece in pieces]),
        deflection_rates=tuple(join([piece.deflection_rates[k] for piece in pieces]) for k in range(2)),
        offsets=join([_offsets_from(first.origin, piece) for piece in pieces]),
        crossings=tuple(
            replace(crossing, time=start + crossing.time, s=float(law(start + crossing.time)))
            for piece, start, leave in windows
            for crossing in piece.crossings
            if crossing.time < leave
        ),
        certificate=certificate,
        friction=PlannedFriction.from_speed(size, partial(motor_angles, order=1), law.duration),
    )


def _cut(function: TimeFunction, leave: float) -> TimeFunction:
    """Return a function on [0, leave] [s]; the part of a polynomial is one of the same degree."""
    if leave >= function.edges[-1]:
        return function
    edges = np.append(function.edges[function.edges < leave], leave)
    grid = TimeGrid(edges, function.coefficients.shape[1])
    return grid.fit(function(np.clip(grid.times, 0.0, leave)))


def _offsets_from(origin: Array, piece: InverseDynamics) -> TimeFunction:
    """Return the tangent offsets of a motion from another origin (nq,)."""
    offsets = piece.offsets
    grid = TimeGrid(offsets.edges, offsets.coefficients.shape[1])
    return grid.fit(difference(piece.robot, origin, piece.configuration(grid.times)))
