"""The singular locus of a robot in two of its freedoms, traced curve by curve, over all its modes.

Robots of two freedoms are traced as they are; of others a slice is: the platform's other coordinates held
(a 3-RPR at one orientation, a Gough-Stewart platform at one orientation and height, or at one position and
turn), or the other motors (the sections of the joint space in which cusps are drawn). Curves are found from
starts that are given or drawn at random in joint space, always alike, and from the branch points of curves
already traced. A curve that no start and no branch leads to is missed: completeness is not claimed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import assembled_at, system_at
from framework.kinematics.legs import leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.singularity.curve_tracing import (
    LONGEST,
    ON_CHORD,
    Curve,
    Points,
    points_at,
    solutions_near,
    whole_curves,
)
from framework.singularity.locus_equations import LocusEquations
from framework.singularity.locus_region import Region, drawn, drawn_in_mode
from framework.singularity.special_points import branch_point, branches_at, root_between

REACH = 1.2  # of the region about the pose, in lengths of the robot
STARTS = 40
SEED = 0
MOST_CURVES = 100
RANK = 1e-7  # of derivatives by differences: without rank 2e-8 is left of one, next to a branch point 1e-5
REST = 1e-7  # [rad, lengths]: less is rounding of what rests along a curve


class LocusPoint(NamedTuple):
    """A special point of the locus."""

    q: Array  # (nq,)
    x: Array  # (n,)
    motors: Array  # (n_a,) joint side


@dataclass(frozen=True, eq=False)
class LocusCurve(ReadOnlyArrays):
    """One curve of the locus, through m points; a closed one ends with its first point.

    Every point but the cusps is a fold of the forward kinematics: two assembly modes meet there. At a cusp
    three do; its image in the space of the motors is the corner around which assembly modes are changed
    without a singularity (Wenger and El Omri 1996; McAree and Daniel 1999).
    """

    q: Array  # (m, nq)
    x: Array  # (m, n)
    motors: Array  # (m, n_a) joint side, whole turns counted on
    modes: Array  # (m, legs) working mode: the sign of each leg, see `leg_signs`
    kind: str  # type_2; self_motion: the motors rest all along; joints_only: the platform does
    closed: bool
    ends: tuple[str, str]  # closed, left (the region), stalled or long, see `Curve`
    cusps: tuple[LocusPoint, ...]
    branch_points: tuple[LocusPoint, ...]  # where another curve of the locus crosses


@dataclass(frozen=True, eq=False)
class TracedLocus:
    """The locus as far as it was found; `curves` are distinct, in the order in which they were found.

    That each point is singular is certain, that there is no further curve is not claimed.
    """

    robot: ParallelRobot
    free: tuple[str, str]  # the two freedoms of the slice
    curves: tuple[LocusCurve, ...]
    starts: int  # points of the locus that the search found, each on one of the curves

    @property
    def cusps(self) -> tuple[LocusPoint, ...]:
        """All cusps, each once."""
        return tuple(point for curve in self.curves for point in curve.cusps)


def trace_locus(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    free: tuple[str, str] | None = None,
    reach: float = REACH,
    starts: int = STARTS,
    seed: int = SEED,
    one_mode: bool = False,
    near: Sequence[Array] = (),
    longest: float = LONGEST,
) -> TracedLocus:
    """The singular locus in the slice through an assembled configuration q (nq,).

    Args:
        free: the two freedoms that are left, axes of the platform or actuators; all others keep the values
            that they have at q. The platform's two translations by default.
        reach: half the width of the region that curves are followed in, in lengths of the robot: of free
            translations and sliding motors about q. Hinges turn without bound.
        starts: configurations that the search begins from, drawn with `seed`.
        one_mode: follow curves in the working mode of q alone; quicker.
        near: further configurations (nq,) that the search begins from.
        longest: the longest step along a curve [rad, lengths of the robot].

    Raises:
        InvalidInput: see `LocusEquations.of`; or q is no assembled configuration.
    """
    closed = assembled_at(robot, q)
    equations = LocusEquations.of(robot, closed.q[0], closed.x[0], free)
    mode = leg_signs(robot, closed.system)[0] if one_mode else None
    region = Region(equations, closed.q[0], closed.x[0], reach * robot.length, mode)
    begun = drawn_in_mode(region, starts, seed) if one_mode else drawn(equations, closed.q[0], starts, seed)
    found = solutions_near(equations, np.concatenate([begun, np.reshape(near, (-1, robot.model.nq))]))
    found = found[region.contains(found)]
    count, curves, crossings = len(found), list[Curve](), list[list[Points]]()
    new = points_at(equations, found) if count else None
    while new is not None and len(curves) < MOST_CURVES:
        traced = whole_curves(equations, new, region.contains, longest)
        curves += traced
        crossings += [_crossings(equations, curve) for curve in traced]
        new_crossings = (point for some in crossings[-len(traced) :] for point in some)
        branches = [point for crossing in new_crossings for point in branches_at(equations, crossing)]
        branches = [point for point in branches if region.contains(point.q)[0]]
        branches = [
            point for point in branches if not any(_passes(equations, curve, point) for curve in curves)
        ]
        new = Points.joined(branches) if branches else None
    return TracedLocus(
        robot=robot,
        free=equations.free_names,
        curves=tuple(
            _described(equations, region.cut(curve), crossing)
            for curve, crossing in zip(curves, crossings, strict=True)
        ),
        starts=count,
    )


def _crossings(equations: LocusEquations, curve: Curve) -> list[Points]:
    """The branch points of a curve, where others cross it.

    Where the equations lose rank all along the curve (Type 1 and Type 2 at once) signs are rounding.
    """
    points = curve.points
    changes = np.flatnonzero(points.orientation[1:] * points.orientation[:-1] < 0)
    ranks = [_least_slope(equations, points.take(changes + k)) for k in (0, 1)]
    changes = changes[np.maximum(*ranks) > RANK]
    return [branch_point(equations, points.one(k), points.one(k + 1)) for k in changes.tolist()]


def _least_slope(equations: LocusEquations, points: Points) -> Array:
    """The smallest singular value (S,) of the equations' derivatives."""
    if not len(points.q):
        return np.zeros(0)
    return np.asarray(np.linalg.svd(equations.at(points.q, points.border).slopes, compute_uv=False)[:, -1])


def _passes(equations: LocusEquations, curve: Curve, point: Points) -> bool:
    """Whether a curve passes a point (S = 1)."""
    to = equations.apart(point.q, curve.points.q)  # (m, k)
    start, chord = to[:-1], np.diff(to, axis=0)
    length = np.linalg.norm(chord, axis=1)
    near = (length < 2 * LONGEST) & (length > 0)  # others jump where a hinge has turned once round
    start, chord, length = start[near], chord[near], length[near]
    share = np.clip(-np.sum(start * chord, axis=1) / length**2, 0.0, 1.0)
    gap = np.linalg.norm(start + share[:, None] * chord, axis=1)
    return bool((gap < ON_CHORD * length).any())


def _described(equations: LocusEquations, curve: Curve, crossings: list[Points]) -> LocusCurve:
    """A curve in the robot's own coordinates."""
    robot, points = equations.robot, curve.points
    system = system_at(robot, points.q, np.broadcast_to(equations.x, (len(points.q), robot.n)))
    x, motors = robot.platform.coordinates(system.frames), robot.actuated_coordinates(points.q)
    ways = equations.apart(points.q[:-1], points.q[1:])
    kind = "type_2"
    if np.abs(ways[:, : robot.n_a]).max(initial=0.0) < REST:
        kind = "self_motion"
    if np.ptp(x / np.where(robot.translations, robot.length, 1.0), axis=0).max() < REST:
        kind = "joints_only"
    alike = np.sum(points.eta[1:] * points.eta[:-1], axis=1)
    turning = points.cusp[1:] * points.cusp[:-1] * alike < 0
    turning &= (
        points.orientation[1:] * points.orientation[:-1] > 0
    )  # a second motion escapes where curves cross
    turning &= kind == "type_2"
    cusps = [_cusp(equations, points.one(k), points.one(k + 1)) for k in np.flatnonzero(turning).tolist()]
    hinges = ~robot.sliding[robot.actuated]
    motors[:, hinges] = np.unwrap(motors[:, hinges], axis=0)  # pieces may differ by whole turns
    return LocusCurve(
        q=points.q,
        x=x,
        motors=motors,
        modes=leg_signs(robot, system),
        kind=kind,
        closed=curve.ends[0] == "closed",
        ends=curve.ends,
        cusps=tuple(_place(robot, cusp.q[0]) for cusp in cusps if cusp is not None),
        branch_points=tuple(_place(robot, crossing.q[0]) for crossing in crossings),
    )


def _cusp(equations: LocusEquations, one: Points, two: Points) -> Points | None:
    """The cusp between two neighbours."""
    if one.eta[0] @ two.eta[0] < 0:
        two = two._replace(eta=-two.eta, cusp=-two.cusp)
    return root_between(equations, one, two, lambda point: float(point.cusp[0]))


def _place(robot: ParallelRobot, q: Array) -> LocusPoint:
    x = robot.platform.coordinates(frames_at(robot, q[None]))[0]
    return LocusPoint(q, x, robot.actuated_coordinates(q[None])[0])
