"""The singular pose nearest to a given pose, and the pose nearest to a platform target out of reach.

The distance to the nearest singular pose is the margin from Type 2 (`nearest_singular_pose`). Rays start at
the platform coordinates x of the pose in many directions. Continuation follows all of them at once until the
branch ends at Type 1 or g changes its sign; bisection then locates the end. Newton's method looks for the
foot point, the point of the locus g = 0 nearest to x, starting where the shortest rays meet the locus. The
foot point is a singular pose, so its distance is an upper bound of the margin. The lower bound is the radius
of a ball in which `prove_regular_ball` proves that no pose is singular, of Type 1 or Type 2. The bounds
differ if a Type 1 pose limits the ball, or if the proof reaches its largest number of cells.

The nearest pose to a target is sought among the poses that are joined to the reference (`nearest_pose`). A
search (`PoseSearch`) ends in a local minimum of the distance, and there may be several. So poses are sampled
once per robot, on random walks from the reference, and searches start from the samples nearest to the target.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.atlas.sweep import STEP_PARTS, PoseReason, StepEnds, step_poses
from framework.errors import InvalidInput, NotAssembled, finite_numbers
from framework.kinematics.assembly_search import find_closed_pose
from framework.kinematics.continuation.pose_search import NearestPose, PoseSearch, distance_unit
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    assembled_at,
    linearised_at,
    type1_matrix,
    type2_matrix,
)
from framework.kinematics.modes import leg_signs
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, join, select
from framework.numerics.fields import positive
from framework.numerics.ordered_sums import least_singular_values
from framework.proofs.regular_ball import MAX_CELLS, prove_regular_ball
from framework.singularity.type2 import has_signed_measure, measure_gradient, uncontrolled_motion
from framework.tolerances import NEWTON_STEP, RANK_LOST, TYPE_1_END

RAY_STEP = 0.02  # [robot lengths, rad] along a ray
MAX_RAY_STEPS = 60_000  # along all rays together; half a robot length takes 15,000 at most
RAYS = {1: 2, 2: 96, 3: 300, 4: 600, 5: 600, 6: 600}  # by the number of platform coordinates
MAX_WALK_STEP = 0.1  # [robot lengths, rad]
STARTS = 3  # largest number of searches for the pose nearest to a target
START_DISTANCE = 2 * MAX_WALK_STEP  # least distance between their starts


@dataclass(frozen=True, eq=False)
class NearestSingularPose(ReadOnlyArrays):
    """The nearest Type 2 pose of a local search, and the radius of the ball proved regular."""

    at_least: float  # [unit] distance within which no pose is singular, of Type 1 or Type 2: proved
    unit: str  # m if all coordinates are translations, rad if all are turns, else robot lengths and rad
    within: float  # [unit] distance up to which rays were followed
    asked: float  # [unit] distance asked for; larger if MAX_RAY_STEPS ended the search
    rays: int  # number of rays
    leg_end: float  # [unit] distance at which the nearest ray ends at Type 1; inf without one
    distance: float = np.inf  # [unit] of the nearest Type 2 pose; inf if none was found
    x: Array | None = None  # (n,) platform coordinates of this pose
    q: Array | None = None  # (nq,)
    twist: Array | None = None  # (n,) t_s of the uncontrolled motion there, of unit size (`twist_norm`)

    @property
    def status(self) -> str:
        """A clause with the distances to singular poses: the proved lower bound, then the nearest found."""
        if self.within < self.asked:
            ended = f"{MAX_RAY_STEPS} steps lead no farther than {self.within:.4g}"
            return f"{self._found}; of {self.asked:.4g} {self.unit} asked for, {ended}"
        return self._found

    @property
    def _found(self) -> str:
        """The distances in words."""
        regular = "no proof of regular poses about it"
        if self.at_least > 0:
            regular = f"at least {self.at_least:.6g} {self.unit}, proved for Type 1 and Type 2"
        if self.leg_end < self.distance:
            regular += f"; a leg ends (Type 1) at {self.leg_end:.4g} {self.unit}"
        if self.x is not None:
            return f"{regular}; at most {self.distance:.6g} {self.unit}, Type 2"
        if self.at_least >= self.within:
            return f"{regular}: no singular pose in the ball searched"
        return f"{regular}; no Type 2 pose found within {self.within:.4g} {self.unit} along {self.rays} rays"


def nearest_singular_pose(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    within: float | None = None,
    max_cells: int = MAX_CELLS,
    progress: Callable[[int], None] = lambda steps: None,
) -> NearestSingularPose:
    """Find the Type 2 pose nearest to a configuration q (nq,), in the working mode of q.

    The search ends after MAX_RAY_STEPS steps along rays; the result says how far they have led.

    Args:
        within: largest distance of the search [m if all coordinates are translations, rad if all are turns,
            else robot lengths and rad]; by default half a robot length or 0.5 rad.
        max_cells: largest number of cells of platform coordinates that the proof tests.
        progress: called with the number of steps along rays.

    Raises:
        InvalidInput: the loops are open at q; redundant motors, whose g has no sign; no passive joints.
    """
    require_square(robot)
    if not has_signed_measure(robot):
        raise InvalidInput(
            f"{robot.name}: a margin needs a measure g with a sign: passive joints, and a motor for each "
            f"axis of the platform"
        )

    assembled = assembled_at(robot, q)
    centre = _Centre(robot, assembled.q[0], assembled.x[0])
    unit_length, unit = distance_unit(robot)  # of distances in the result
    asked = 0.5 if within is None else positive("within", within) / unit_length
    reach = min(asked, MAX_RAY_STEPS * RAY_STEP)  # of one ray alone

    # search the nearest pose along rays; all distances are in robot lengths and rad from here on
    directions = _spread_directions(robot.n)
    # segments in which g changes its sign, and in which the branch ends
    crossed, ended, share = _follow_rays(centre, directions * reach, progress)
    reach *= share
    nearest = _nearest_singular(centre, crossed, reach)

    # prove that no singular pose is nearer
    radius = reach if nearest is None else float(np.linalg.norm(nearest[1]))
    proved = prove_regular_ball(robot, centre.q, centre.x, radius, max_cells=max_cells)
    q_ends, z_ends = _locate_ends(centre, ended)  # of the segments in which the branch ends
    is_type_1 = least_singular_values(type1_matrix(robot, linearised_at(robot, q_ends))) < TYPE_1_END
    leg_end = float(np.linalg.norm(z_ends[is_type_1], axis=1).min(initial=np.inf))
    result = NearestSingularPose(
        at_least=proved * unit_length,
        unit=unit,
        within=reach * unit_length,
        asked=asked * unit_length,
        rays=len(directions),
        leg_end=leg_end * unit_length,
    )
    if nearest is None:
        return result
    q, z = nearest
    twist = uncontrolled_motion(robot, linearised_at(robot, q[None])).twist
    return replace(result, distance=radius * unit_length, x=centre.coordinates(z), q=q, twist=twist)


class _Centre(NamedTuple):
    """The pose at the start of all rays.

    Other poses have offsets z (.., n) from its platform coordinates [robot lengths, rad].
    """

    robot: ParallelRobot
    q: Array  # (nq,)
    x: Array  # (n,) platform coordinates

    def coordinates(self, z: Array) -> Array:
        """Return the platform coordinates (.., n) at offsets z (.., n)."""
        return self.x + z * self.robot.platform_scale

    def step(self, q: Array, start: Array, end: Array, parts: int = 1) -> StepEnds:
        """Continue configurations q (T, nq) from offsets `start` to `end` (T, n).

        A step that may have left the branch is tried again in `parts` equal steps.
        """
        return step_poses(self.robot, q, self.coordinates(start), self.coordinates(end), parts)

    def signs_of_g(self, q: Array) -> Array:
        """Compute the sign of g (T,) at q (T, nq)."""
        return np.linalg.slogdet(self.type2_matrices(q)).sign

    def type2_matrices(self, q: Array) -> Array:
        """Compute the matrices (T, s, s) at q (T, nq) that lose rank at Type 2."""
        return type2_matrix(self.robot, linearised_at(self.robot, q))


class _RaySegments(NamedTuple):
    """The last segments of K rays, in which g changes its sign or the branch ends.

    Each segment leads from a reached pose to a point that is not reached, or where g has the other sign.
    """

    q: Array  # (K, nq) at the start
    start: Array  # (K, n) offsets from the centre
    end: Array  # (K, n) offsets from the centre


def _spread_directions(n: int) -> Array:
    """Return evenly spread unit vectors (K, n), with K from `RAYS`.

    With two coordinates the vectors are on a circle. With three they are on a spiral around the sphere, which
    turns by the golden angle from one vector to the next; the heights z are equidistant, because bands of
    equal height have equal areas. Otherwise they are both directions of each axis, and random vectors.
    """
    count = RAYS[n]  # K
    k = np.arange(count)
    if n == 2:
        angle = 2 * np.pi * k / count
        return np.column_stack([np.cos(angle), np.sin(angle)])
    if n == 3:
        z = 1 - (2 * k + 1) / count
        angle = np.pi * (1 + np.sqrt(5)) * k  # the golden angle, up to whole turns
        radius = np.sqrt(1 - z**2)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    random = np.random.default_rng(0).standard_normal((count - 2 * n, n))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    return np.concatenate([np.eye(n), -np.eye(n), random])


def _follow_rays(
    centre: _Centre, rays: Array, progress: Callable[[int], None]
) -> tuple[_RaySegments, _RaySegments, float]:
    """Follow rays (K, n) from the centre; return segments with sign changes of g, segments with ends.

    The rays are vectors of equal length [robot lengths, rad]. A ray ends with its first segment in which g
    changes its sign or the branch ends. The last result is the share of the length that was followed, less
    than 1 if MAX_RAY_STEPS ended the search.
    """
    count = max(int(np.ceil(np.linalg.norm(rays[0]) / RAY_STEP)), 1)  # segments of a ray
    q = np.tile(centre.q, (len(rays), 1))  # of the rays that are still followed
    sign = centre.signs_of_g(q[:1])  # (1,) at the centre
    crossed: list[_RaySegments] = []
    ended: list[_RaySegments] = []
    steps = 0  # along all rays
    for k in range(count):
        if steps + len(rays) > MAX_RAY_STEPS and k:
            return join(crossed), join(ended), k / count
        steps += len(rays)
        progress(steps)
        segments = _RaySegments(q, rays * (k / count), rays * ((k + 1) / count))
        step = centre.step(*segments, STEP_PARTS)

        is_reached = step.reason == PoseReason.REACHED
        is_crossed = is_reached.copy()
        is_crossed[is_reached] = centre.signs_of_g(step.q[is_reached]) != sign
        crossed.append(select(segments, is_crossed))
        ended.append(select(segments, ~is_reached))

        continues = is_reached & ~is_crossed
        q = step.q[continues]
        rays = rays[continues]
        if not len(rays):
            break
    return join(crossed), join(ended), 1.0


def _nearest_singular(centre: _Centre, crossed: _RaySegments, reach: float) -> tuple[Array, Array] | None:
    """Find the singular pose q (nq,), z (n,) nearest to the centre, starting from sign changes of g.

    Candidates are foot points, and the nearest sign change at which g is zero to rounding; g may also change
    its sign by a jump to another branch. The foot points are sought from the nearest `max_starts` sign
    changes on the segments `crossed`. `reach` is in robot lengths and rad.
    """
    max_starts = 8
    q, z = _locate_ends(centre, crossed)
    is_singular = least_singular_values(centre.type2_matrices(q)) < RANK_LOST
    candidates = [_find_foot(centre, q[k], z[k]) for k in range(min(len(q), max_starts))]
    candidates += [(q[k], z[k]) for k in np.flatnonzero(is_singular)[:1]]  # the nearest one, if any
    within_reach = [pose for pose in candidates if pose is not None and np.linalg.norm(pose[1]) <= reach]
    return min(within_reach, key=lambda pose: float(np.linalg.norm(pose[1])), default=None)


def _locate_ends(centre: _Centre, segments: _RaySegments) -> tuple[Array, Array]:
    """Locate the last poses q (K, nq), z (K, n) before sign changes or ends of branches, nearest first.

    The nearest pose is located to rounding; for the other segments a few halvings are enough.
    """
    max_halvings = 45  # of a step on the nearest ray, down to rounding
    coarse_halvings = 10  # on all rays, enough to find the nearest
    coarse = _bisect_segments(centre, segments, coarse_halvings)
    order = np.argsort(np.linalg.norm(coarse.start, axis=1), kind="stable")
    fine = _bisect_segments(centre, select(coarse, order[:1]), max_halvings - coarse_halvings)
    ends = join([fine, select(coarse, order[1:])])
    return ends.q, ends.start


def _bisect_segments(centre: _Centre, segments: _RaySegments, halvings: int) -> _RaySegments:
    """Advance the starts of K segments towards the sign change or end, until 0.5^halvings of each is left.

    A pose where g has the other sign is a bracket: later steps lead halfway to it. A step that leaves the
    branch brackets nothing, since near the end of a branch a long step may not be trusted although a shorter
    one is: the step is halved, and doubled again after the next one that is accepted. Rounding may lead from
    a fold to the other branch, on which no step is long: the number of steps is bounded.
    """
    max_steps = 8 * halvings
    resolution = 0.5 ** (halvings + 1)  # of a segment
    q = segments.q.copy()  # (K, nq) at the points reached
    length = segments.end - segments.start  # (K, n) as vectors
    sign = centre.signs_of_g(q)
    fraction = np.zeros(len(q))  # of each segment that has been passed
    bracket = np.ones(len(q))  # the fraction that is not passed
    longest = np.ones(len(q))  # of the next steps that may be trusted
    for _ in range(max_steps):
        step_fraction = np.minimum(longest, 0.5 * (bracket - fraction))
        live = np.flatnonzero(step_fraction > resolution)
        if not live.size:
            break
        next_fraction = (fraction + step_fraction)[live]
        step_start = segments.start[live] + length[live] * fraction[live, None]
        step_end = segments.start[live] + length[live] * next_fraction[:, None]
        step = centre.step(q[live], step_start, step_end)

        is_reached = step.reason == PoseReason.REACHED
        is_crossed = is_reached.copy()
        is_crossed[is_reached] = centre.signs_of_g(step.q[is_reached]) != sign[live[is_reached]]
        is_accepted = is_reached & ~is_crossed

        q[live[is_accepted]] = step.q[is_accepted]
        fraction[live[is_accepted]] = next_fraction[is_accepted]
        bracket[live[is_crossed]] = next_fraction[is_crossed]
        longest[live] = step_fraction[live] * np.where(is_reached, 2.0, 0.5)
    return _RaySegments(q, segments.start + length * fraction[:, None], segments.end)


def _find_foot(centre: _Centre, q: Array, z: Array) -> tuple[Array, Array] | None:
    """Find the foot point of the centre by Newton's method from q (nq,), z (n,); None without convergence.

    Each step leads from the offset z to the point of the linearised locus that is nearest to the
    centre, or RAY_STEP towards this point. With the slopes a of g, the point is a (a . z - g) / |a|^2. It
    cannot be found where the slopes are zero, or at the end of a branch. The result is a pose with g = 0, up
    to RANK_LOST.
    """
    max_steps = 30
    for _ in range(max_steps):
        # the step to the point of the linearised locus
        try:
            # g and its slopes a (n,) along the offset z from the centre at one pose
            robot = centre.robot
            linearised = linearised_at(robot, q[None])
            measure = measure_gradient(robot, linearised)
            E = robot.platform.rate_matrix(centre.coordinates(z[None]))  # (1, n, n)
            rates = joint_rates(robot, linearised, E[0].T[:, None])[:, 0]  # (n, nv) at unit rates of x
            g = measure.g[0]
            a = (rates @ measure.by_q[0]) * robot.platform_scale
        except NotAssembled:
            return None
        square = a @ a
        if not square > 0:  # zero, or NaN
            return None
        step = a * (a @ z - g) / square - z
        distance = float(np.linalg.norm(step))
        if distance < NEWTON_STEP:
            return (q, z) if abs(g) < RANK_LOST else None

        # take the step, or RAY_STEP of it, if the pose stays on the branch
        next_z = z + min(1.0, RAY_STEP / distance) * step
        end = centre.step(q[None], z[None], next_z[None], STEP_PARTS)
        if end.reason[0] != PoseReason.REACHED:
            return None
        q, z = end.q[0], next_z
    return None


# ------------------------------------------------------------------ targets out of reach


def nearest_pose(robot: ParallelRobot, x: ArrayLike) -> NearestPose:
    """Find the pose nearest to platform coordinates x (n,) within the joints' ranges.

    The pose is joined to the reference by steps within the ranges, on which every leg keeps its working mode.
    A reference beyond the ranges is led into them first. The steps may cross Type 2 singularities. The pose
    is the best result of a few local searches, without a proof that no other pose is nearer. The first call
    for a robot samples poses, which takes about a second.

    Raises:
        InvalidInput: not n finite numbers; the platform does not determine the joints.
        NotAssembled: the reference is beyond the ranges, and no pose within them was found in its mode.
    """
    target = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    search = PoseSearch(robot)
    sampled_q, sampled_x = _sample_poses(robot, _start_within_ranges(robot, search))  # (S, nq), (S, n)
    ends: list[NearestPose] = []
    # samples to start from, START_DISTANCE apart, the nearest to the target first
    offsets = (sampled_x - target) / robot.platform_scale  # (S, n)
    starts: list[int] = []
    distances = np.linalg.norm(offsets, axis=1)
    while len(starts) < STARTS and np.isfinite(distances).any():
        start = int(np.argmin(distances))
        starts.append(start)
        is_close = np.linalg.norm(offsets - offsets[start], axis=1) < START_DISTANCE
        distances[is_close] = np.inf
    for k in starts:
        ends.append(search.find(sampled_q[k], sampled_x[k], target, earlier=ends))
        if not ends[-1].stops:  # the target is reached
            break
    return min(ends, key=lambda pose: pose.distance)


def _start_within_ranges(robot: ParallelRobot, search: PoseSearch) -> tuple[float, ...]:
    """Return the pose (nq,) of the reference's mode within ranges from which the search starts.

    Where the branch of the reference ends on the way into the ranges, another pose is sought whose legs have
    the same signs.
    """
    q = search.enter_ranges(robot.reference.q)
    if q is not None:
        return tuple(q.tolist())
    with suppress(NotAssembled):
        q = find_closed_pose(robot).q
        signs = leg_signs(robot, linearised_at(robot, np.array([robot.reference.q, q])))  # (2, legs)
        if (signs[0] == signs[1]).all():
            return tuple(q.tolist())
    raise NotAssembled(
        "the reference lies beyond the joints' ranges, and no pose within them was found in its working mode",
        name=robot.name,
        q=robot.reference.q,
        residual=robot.reference.residual,
    )


@lru_cache(maxsize=8)
def _sample_poses(robot: ParallelRobot, start: tuple[float, ...]) -> tuple[Array, Array]:
    """Sample poses q (S, nq) at x (S, n), joined to a `start` (nq,) within ranges.

    Each of `walks` random walks keeps its direction until a step is refused, at Type 1 or the end of a range.
    Then it continues in a new random direction. All poses of all walks are samples.
    """
    walks = 64
    walk_steps = 60
    random = np.random.default_rng(0)
    # where the walks are
    q = np.tile(start, (walks, 1))
    x = robot.platform.unwrap(robot.platform.coordinates(frames_at(robot, q)), robot.reference.x)
    samples_q = [q]
    samples_x = [x]
    direction = np.zeros_like(x)
    # whether the last step of each walk was accepted; false, so that each walk gets a first direction
    accepted = np.zeros(walks, dtype=bool)
    for _ in range(walk_steps):
        # draw a direction for every walk, but use it only for walks that were refused
        new_direction = random.standard_normal(x.shape)
        new_direction /= np.linalg.norm(new_direction, axis=1, keepdims=True)
        direction[~accepted] = new_direction[~accepted]

        length = MAX_WALK_STEP * random.random((walks, 1))
        target = x + direction * length * robot.platform_scale
        step = step_poses(robot, q, x, target)
        beyond = np.any(shares_beyond_limits(robot.limits, step.q) > 0.0, axis=1)  # (walks,) a joint's range
        accepted = (step.reason == PoseReason.REACHED) & ~beyond
        q = np.where(accepted[:, None], step.q, q)
        x = np.where(accepted[:, None], target, x)
        samples_q.append(q)
        samples_x.append(x)
    return np.concatenate(samples_q), np.concatenate(samples_x)
