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
from itertools import chain
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, ArrayLike, ReadOnlyArrays, join, select
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import assembled_at, linearised_at
from framework.kinematics.modes import leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import singular_values
from framework.locus.curve_tracing import (
    MAX_CURVE_OFFSET,
    MAX_STEP,
    Curve,
    Points,
    chord_offsets,
    points_at,
    solutions_near,
    whole_curves,
)
from framework.locus.locus_equations import LocusEquations
from framework.locus.locus_region import Region, draw_in_mode, draw_joints
from framework.locus.special_points import branch_point, branches_at, root_between
from framework.tolerances import RANK_LOST

RESTING_EXTENT = 1e-7  # [rad, lengths] of motors or platform along a curve: points are solved to 1e-12
REGION_REACH = 1.2  # [robot lengths] of the region about the pose
RANDOM_STARTS = 40
RANDOM_SEED = 0
MAX_CURVES = 100


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
    """The traced part of the locus; `curves` are distinct, in the order of tracing.

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
    reach: float = REGION_REACH,
    starts: int = RANDOM_STARTS,
    seed: int = RANDOM_SEED,
    one_mode: bool = False,
    near: Sequence[Array] = (),
    longest: float = MAX_STEP,
) -> TracedLocus:
    """Trace the singular locus in the slice through an assembled configuration q (nq,).

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
    mode = leg_signs(robot, closed.linearised)[0] if one_mode else None
    region = Region(equations, closed.q[0], closed.x[0], reach * robot.length, mode)
    if one_mode:
        guesses = draw_in_mode(region, starts, seed)
    else:
        guesses = draw_joints(equations, closed.q[0], starts, seed)
    solutions = solutions_near(equations, np.concatenate([guesses, np.reshape(near, (-1, robot.model.nq))]))
    solutions = solutions[region.contains(solutions)]
    curves = _trace_branches(equations, region, solutions, longest) if len(solutions) else []
    described = tuple(_describe(equations, region.clip(curve), crossings) for curve, crossings in curves)
    return TracedLocus(robot, equations.free_names, described, starts=len(solutions))


def _trace_branches(
    equations: LocusEquations, region: Region, solutions: Array, longest: float
) -> list[tuple[Curve, list[Points]]]:
    """Trace the curves through solutions (S, nq) and all curves that cross, with branch points."""
    curves: list[Curve] = []
    crossings: list[list[Points]] = []
    starts = [points_at(equations, solutions)]
    while starts and len(curves) < MAX_CURVES:
        traced = whole_curves(equations, join(starts), region.contains, longest)
        own_crossings = [_crossings(equations, curve) for curve in traced]
        curves += traced
        crossings += own_crossings
        starts = []
        for crossing in chain.from_iterable(own_crossings):
            for point in branches_at(equations, crossing):
                passed = any(_passes(equations, curve, point) for curve in curves)
                if region.contains(point.q)[0] and not passed:
                    starts.append(point)
    return list(zip(curves, crossings, strict=True))


def _crossings(equations: LocusEquations, curve: Curve) -> list[Points]:
    """Find the branch points of a curve, where other curves cross.

    Where the equations lose rank all along the curve (Type 1 and Type 2 at once) signs are rounding.
    """
    points = curve.points
    changes = np.flatnonzero(points.orientation[1:] * points.orientation[:-1] < 0)
    ranks = [_least_slope(equations, select(points, changes + k)) for k in (0, 1)]
    changes = changes[np.maximum(*ranks) > RANK_LOST]
    return [branch_point(equations, points.single(k), points.single(k + 1)) for k in changes.tolist()]


def _least_slope(equations: LocusEquations, points: Points) -> Array:
    """Compute the smallest singular value (S,) of the equations' derivatives."""
    if not len(points.q):
        return np.zeros(0)
    slopes = equations.evaluate(points.q, points.border).slopes
    return np.asarray(singular_values(slopes)[:, -1])


def _passes(equations: LocusEquations, curve: Curve, point: Points) -> bool:
    """Whether a curve passes a point (S = 1)."""
    offsets = equations.offsets(point.q, curve.points.q)  # (m, k)
    chord = np.diff(offsets, axis=0)
    length, gap = (np.linalg.norm(part, axis=1) for part in (chord, chord_offsets(-offsets[:-1], chord)))
    # longer ones jump where a hinge has turned once round
    return bool(((gap < MAX_CURVE_OFFSET * length) & (length < 2 * MAX_STEP)).any())


def _describe(equations: LocusEquations, curve: Curve, crossings: list[Points]) -> LocusCurve:
    """Describe a curve in the robot's own coordinates."""
    robot, points = equations.robot, curve.points
    linearised = linearised_at(robot, points.q, None)
    x, motors = robot.platform.coordinates(linearised.frames), robot.actuated_coordinates(points.q)
    steps = equations.offsets(points.q[:-1], points.q[1:])
    kind = "type_2"
    if np.abs(steps[:, : robot.n_a]).max(initial=0.0) < RESTING_EXTENT:
        kind = "self_motion"
    if np.ptp(x / robot.platform_scale, axis=0).max() < RESTING_EXTENT:
        kind = "joints_only"
    cosine = np.sum(points.eta[1:] * points.eta[:-1], axis=1)
    turning = points.cusp[1:] * points.cusp[:-1] * cosine < 0
    # not where curves cross: there a second motion escapes
    turning &= points.orientation[1:] * points.orientation[:-1] > 0
    turning &= kind == "type_2"
    cusps = [
        _cusp(equations, points.single(k), points.single(k + 1)) for k in np.flatnonzero(turning).tolist()
    ]
    hinges = ~robot.sliding[robot.actuated]
    motors[:, hinges] = np.unwrap(motors[:, hinges], axis=0)  # pieces may differ by whole turns
    return LocusCurve(
        q=points.q,
        x=x,
        motors=motors,
        modes=leg_signs(robot, linearised),
        kind=kind,
        closed=curve.ends[0] == "closed",
        ends=curve.ends,
        cusps=tuple(_locus_point(robot, cusp.q[0]) for cusp in cusps if cusp is not None),
        branch_points=tuple(_locus_point(robot, crossing.q[0]) for crossing in crossings),
    )


def _cusp(equations: LocusEquations, first: Points, second: Points) -> Points | None:
    """Find the cusp between two neighbours."""
    if first.eta[0] @ second.eta[0] < 0:
        second = second._replace(eta=-second.eta, cusp=-second.cusp)
    return root_between(equations, first, second, lambda point: float(point.cusp[0]))


def _locus_point(robot: ParallelRobot, q: Array) -> LocusPoint:
    """Return the special point at a configuration q (nq,)."""
    x = robot.platform.coordinates(frames_at(robot, q[None]))[0]
    return LocusPoint(q, x, robot.actuated_coordinates(q[None])[0])
