"""The nearest singular pose to a pose: the margin that a user keeps from Type 2.

Rays leave the pose in many directions and are followed by continuation, all at once, until a leg ends or g
changes its sign; where they do is found by halving steps. From where the shortest ones meet the locus g = 0,
its foot point is found by Newton's method: the nearest point x' to x on the tangent plane of g at y,

    x' = x + a (a . (y - x) - g(y)) / a . a,        a = dg/dy,

again and again. What is found is a singular pose, so the margin is at most its distance. It is at least the
radius of the ball in which `regular_ball` proves that no pose is singular, of Type 1 either: where that ball
ends at the edge of the workspace, or the proof at what time it may take, the two differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, ArrayLike, ReadOnlyArrays, join, select
from framework.atlas.sweep import STEP_PARTS, PoseReason, step_poses
from framework.errors import InvalidInput
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import assembled_at, linearised_at
from framework.kinematics.loop_matrices import type1_matrix, type2_matrix
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.proofs.regular_ball import MAX_CELLS, regular_ball
from framework.singularity.bordered_system import bordered_solution
from framework.singularity.type2 import has_signed_measure, uncontrolled_motion
from framework.tolerances import NEWTON_STEP, RANK_LOST, TYPE_1_END

RAY_STEP = 0.02  # [robot lengths, rad] along a ray
RAYS = {1: 2, 2: 96, 3: 300}  # directions, by the number of platform coordinates
RAYS_IN_MORE = 600  # of a platform with more coordinates
MAX_STARTS = 8  # of Newton's method, from where the shortest rays meet the locus
FAR_RATIO = 1.25  # of where a ray's stretch begins, to where the first one ends: farther ones are left out
MAX_FOOT_STEPS = 30  # steps towards a foot point
MAX_HALVINGS, COARSE_HALVINGS = 45, 10  # of a step along a ray: to rounding; of those that are compared
DIFFERENCE_STEP = 1e-5  # [robot lengths, rad] for the slope of g


@dataclass(frozen=True, eq=False)
class NearestSingularPose(ReadOnlyArrays):
    """The nearest Type 2 pose that a local search has found, if any, and the ball that is proved regular."""

    distance: (
        float  # [m] if all coordinates are translations, [rad] turns, else [robot lengths, rad]; inf: none
    )
    at_least: float  # in the same unit: nearer than that no pose is singular, Type 1 or Type 2: proved
    unit: str
    within: float  # how far rays were followed, in the same unit
    rays: int
    x: Array | None  # (n,) of the platform
    q: Array | None  # (nq,)
    twist: Array | None  # (n,) t_s, see `twist_norm`
    leg_end: float = np.inf  # in the same unit, if the ray that ends first does so at Type 1; else inf

    @property
    def status(self) -> str:
        """The margin in a sentence."""
        regular = "no proof of regular poses about it"
        if self.at_least > 0:
            regular = f"at least {self.at_least:.6g} {self.unit}, proved for Type 1 and Type 2"
        if self.leg_end < self.distance:
            regular += f"; a leg ends (Type 1) at {self.leg_end:.4g} {self.unit}"
        if self.x is not None:
            return f"{regular}; at most {self.distance:.6g} {self.unit}, Type 2"
        if self.at_least >= self.within:
            return f"{regular}: none within that"
        return f"{regular}; none found within {self.within:.4g} {self.unit} along {self.rays} rays"


def nearest_singular_pose(
    robot: ParallelRobot, q: ArrayLike, *, within: float | None = None, max_cells: int = MAX_CELLS
) -> NearestSingularPose:
    """Find the nearest Type 2 singular pose to an assembled configuration q (nq,), on its working mode.

    Args:
        within: how far to look [m if all coordinates are translations, rad if all are turns, else robot
            lengths and rad], half a robot length or 0.5 rad by default.
        max_cells: cells that the proof may take, see `regular_ball`.

    Raises:
        InvalidInput: q leaves the loops open; redundant motors, whose g has no sign; no passive joints.
    """
    expect_robot(robot)
    require_square(robot)
    if not has_signed_measure(robot):
        raise InvalidInput(
            f"{robot.name}: a margin needs a measure g with a sign: passive joints, and a motor for each "
            f"axis of the platform"
        )
    if within is not None and not 0 < within < np.inf:
        raise InvalidInput(f"within: needs a positive number, got {within!r}")
    centre = assembled_at(robot, q)
    size = robot.length if robot.translations.all() else 1.0
    reach = 0.5 if within is None else within / size
    unit = "robot lengths and rad" if robot.translations.any() else "rad"
    unit = "m" if robot.translations.all() else unit
    directions = _directions(robot.n)
    crossed, ended = _follow_rays(robot, centre.q[0], centre.x[0], directions, reach)
    hits = _advance_to_ends(robot, crossed, centre.x[0], by_sign=True)
    ends = _advance_to_ends(robot, ended, centre.x[0], by_sign=False)
    feet = [_find_foot(robot, hit, centre.x[0]) for hit in hits[:MAX_STARTS]]
    feet += [hit for hit in hits if _is_singular(robot, hit)][:1]
    near = [foot for foot in feet if foot is not None and foot.distance <= reach]
    nearest = min(near, key=lambda foot: foot.distance, default=None)
    radius = reach if nearest is None else nearest.distance
    proved = regular_ball(robot, centre.q[0], centre.x[0], radius, max_cells=max_cells).radius
    search = (proved * size, unit, reach * size, len(directions))
    leg_end = size * min((end.distance for end in ends if _is_type_1(robot, end)), default=np.inf)
    if nearest is None:
        return NearestSingularPose(np.inf, *search, None, None, None, leg_end)
    twist = uncontrolled_motion(robot, linearised_at(robot, nearest.q[None], None)).twist
    found = nearest.x, nearest.q, twist
    return NearestSingularPose(nearest.distance * size, *search, *found, leg_end)


class Stretches(NamedTuple):
    """Stretches of K rays, from poses that are reached."""

    q: Array  # (K, nq) at the start
    start: Array  # (K, n) of the platform
    end: Array  # (K, n)


class Foot(NamedTuple):
    """A pose, singular or almost, and its distance [robot lengths, rad]."""

    distance: float
    x: Array
    q: Array


def _directions(n: int) -> Array:
    """Return unit vectors (K, n), evenly spread: a circle, a spiral on the sphere, or drawn from one seed."""
    count = RAYS.get(n, RAYS_IN_MORE)
    k = np.arange(count)
    if n == 2:
        angle = 2 * np.pi * k / count
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if n == 3:
        z, angle = 1 - (2 * k + 1) / count, np.pi * (1 + np.sqrt(5)) * k
        return np.stack([*(np.sqrt(1 - z**2) * [np.cos(angle), np.sin(angle)]), z], axis=1)
    drawn = np.random.default_rng(0).standard_normal((count - 2 * n, n))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    return np.concatenate([np.eye(n), -np.eye(n), drawn])


def _sign(robot: ParallelRobot, q: Array) -> Array:
    """Compute the sign of g (T,) at q (T, nq)."""
    return np.linalg.slogdet(type2_matrix(robot, linearised_at(robot, q, None)))[0]


def _follow_rays(
    robot: ParallelRobot, q: Array, x: Array, directions: Array, reach: float
) -> tuple[Stretches, Stretches]:
    """Find stretches of rays (K, n) with a sign change of g, and stretches with an end of the branch."""
    rays = directions * robot.platform_scale
    count = max(int(np.ceil(reach / RAY_STEP)), 1)
    live = np.arange(len(rays))
    all_q = np.repeat(q[None], len(rays), axis=0)
    sign = _sign(robot, q[None])[0]
    crossed: list[Stretches] = []
    ended: list[Stretches] = []
    for k in range(count):
        start, end = (x + rays[live] * (reach * step / count) for step in (k, k + 1))
        step = step_poses(robot, all_q[live], start, end, STEP_PARTS)
        reached = step.reason == PoseReason.REACHED
        across = reached.copy()
        across[reached] = _sign(robot, step.q[reached]) != sign
        for stretches, mask in ((crossed, across), (ended, ~reached)):
            stretches.append(Stretches(all_q[live[mask]], start[mask], end[mask]))
        all_q[live] = step.q
        live = live[reached & ~across]
        if not len(live):
            break
    return _join_nearest(crossed, robot, x), _join_nearest(ended, robot, x)


def _join_nearest(stretches: list[Stretches], robot: ParallelRobot, x: Array) -> Stretches:
    """Return the stretches that begin hardly farther from x than the first one ends."""
    joined = join(stretches)
    begin, end = _distances(robot, joined.start, x), _distances(robot, joined.end, x)
    return select(joined, begin <= FAR_RATIO * end.min(initial=np.inf))


def _distances(robot: ParallelRobot, y: Array, x: Array) -> Array:
    """Compute the distances (...) of y (..., n) from x (n,) [robot lengths, rad]."""
    return np.linalg.norm((y - x) / robot.platform_scale, axis=-1)


def _advance_to_ends(robot: ParallelRobot, stretches: Stretches, x: Array, *, by_sign: bool) -> list[Foot]:
    """Find the last poses before rays end, or before g changes its sign, the nearest first.

    All are found coarsely, and the nearest to rounding.
    """
    coarse = _advance(robot, stretches, by_sign=by_sign, halvings=COARSE_HALVINGS)
    order = np.argsort(_distances(robot, coarse.start, x), kind="stable")
    nearest = select(coarse, order[:1])
    fine = _advance(robot, nearest, by_sign=by_sign, halvings=MAX_HALVINGS - COARSE_HALVINGS)
    ends = join([fine, select(coarse, order[1:])])
    distances = map(float, _distances(robot, ends.start, x))
    return [Foot(*foot) for foot in zip(distances, ends.start, ends.q, strict=True)]


def _advance(robot: ParallelRobot, stretches: Stretches, *, by_sign: bool, halvings: int) -> Stretches:
    """Advance along stretches until their ends, or a sign change of g, halving each refused step.

    A long step near an end is not trusted and a shorter one is, so a length is kept until it is refused.
    """
    q, start, end = (part.copy() for part in stretches)
    sign, share, size = _sign(robot, q), np.zeros(len(q)), np.full(len(q), 0.5)
    while (live := np.flatnonzero(size > 0.5 ** (halvings + 1))).size:
        ends = (share + size)[live]
        origin, target = (start[live] + (end - start)[live] * part[:, None] for part in (share[live], ends))
        step = step_poses(robot, q[live], origin, target)
        good = (step.reason == PoseReason.REACHED) & (ends < 1.0)
        if by_sign:
            good[good] = _sign(robot, step.q[good]) == sign[live[good]]
        q[live[good]], share[live[good]] = step.q[good], ends[good]
        size[live[~good]] *= 0.5
    return Stretches(q, start + (end - start) * share[:, None], end)


def _is_singular(robot: ParallelRobot, hit: Foot) -> bool:
    """Return whether the measure g of a pose is zero to rounding."""
    return bool(abs(_measure(robot, hit.q[None])[0]) < RANK_LOST)


def _is_type_1(robot: ParallelRobot, end: Foot) -> bool:
    """Return whether the inverse kinematics of a pose is singular, within TYPE_1_END."""
    matrix = type1_matrix(robot, linearised_at(robot, end.q[None], None))
    return bool(np.linalg.svd(matrix, compute_uv=False)[0, -1] < TYPE_1_END)


def _measure(robot: ParallelRobot, q: Array) -> Array:
    """Compute g (T,) at q (T, nq), with the border of the first."""
    return bordered_solution(type2_matrix(robot, linearised_at(robot, q, None)), 0).g


def _find_foot(robot: ParallelRobot, hit: Foot, x: Array) -> Foot | None:
    """Find the foot point of x near a hit; None where Newton's method does not lead to one."""
    scale, n = robot.platform_scale, robot.n
    _, y, q = hit
    offsets = np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)]) * DIFFERENCE_STEP * scale
    for _ in range(MAX_FOOT_STEPS):
        step = step_poses(robot, np.tile(q, (2 * n + 1, 1)), np.tile(y, (2 * n + 1, 1)), y + offsets)
        if (step.reason != PoseReason.REACHED).any():
            return None
        g = _measure(robot, step.q)
        slope = (g[1 : n + 1] - g[n + 1 :]) / (2 * DIFFERENCE_STEP)
        if not float(slope @ slope) > 0:
            return None
        foot = x + scale * slope * (slope @ ((y - x) / scale) - g[0]) / float(slope @ slope)
        move = float(_distances(robot, foot, y))
        if move < NEWTON_STEP:
            return Foot(float(_distances(robot, y, x)), y, q) if abs(g[0]) < RANK_LOST else None
        foot = y + min(1.0, RAY_STEP / move) * (foot - y)
        step = step_poses(robot, q[None], y[None], foot[None], STEP_PARTS)
        if step.reason[0] != PoseReason.REACHED:
            return None
        q, y = step.q[0], foot
    return None
