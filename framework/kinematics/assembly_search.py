"""Search for a closed pose within the joints' limits, from several starts around the reference.

Loops that share a joint form a group. Groups are closed independently, so that two legs do not have to
succeed from the same start. The first start of a group is the reference itself. The others are drawn with a
fixed seed from the range of each joint. The range is that of the limits; without limits it is half a turn or
a length of the robot in both directions. If the reference states some joints only, these stay near it as
far as the loops allow, and the others are free. From each start bounded trust-region least squares
(`scipy.optimize`) first nearly closes the loops with joints near the reference, then closes them. Of the
first few closed poses the nearest to the reference is returned, or the one whose platform is nearest to given
coordinates. Then all loops are one group, and the offset of the platform counts as a gap at first.

The result closes the loops and keeps the limits. But parts may collide, or the robot may be intended for
another assembly.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.closures import (
    direction_gap_derivatives,
    direction_gaps,
    find_flipped_closure,
    scale_jacobian,
    scaled_equations,
)
from framework.kinematics.couplings import coupling_pattern
from framework.kinematics.frames import FrameStack, frames_at, integrate, integrate_columns, scratch_of
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.kinematics.platform import PlatformCoordinates, platform_coordinates
from framework.kinematics.tree_model import positions_beyond_limits
from framework.model.loop_rows import LockedDirections, LoopRows
from framework.numerics.arrays import Array, IntArray, select
from framework.numerics.rotations import wrap_angles
from framework.tolerances import LOOP_GAP, SAME_PLACE

MAX_STARTS = 32  # for one group of loops
UNSTATED_WEIGHT = 0.05  # of the offset of a joint that the reference does not state
GAP_PER_RADIAN = 0.1  # gap of the loops that weighs as much as a joint one radian away from the reference
# options of `scipy.optimize.least_squares`, first to nearly close the loops, then to close them
NEARLY_CLOSING: dict[str, Any] = {"max_nfev": 100, "xtol": 1e-6, "ftol": 1e-6, "gtol": 1e-6}
CLOSING: dict[str, Any] = {"max_nfev": 60, "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
STALLED = 1e-6  # relative fall of the squared gaps in a step at which a start stays open


class ClosedPose(NamedTuple):
    """A configuration with closed loops, and its distance from the reference."""

    q: Array  # (nq,)
    farthest: str  # joint, of those that the reference states, and how far it is away, as in "knee 0.6 rad"


def find_closed_pose(mechanism: Mechanism, near_platform: Array | None = None) -> ClosedPose:
    """Find a configuration that closes all loops within the joints' limits, springs at rest.

    Args:
        near_platform: platform coordinates (n,) near which it is sought, instead of near the reference.

    Raises:
        NotAssembled: no start leads to a closed pose; the message names a loop equation and its least
            residual.
    """
    lower, upper = _joint_ranges(mechanism)
    u = np.zeros(mechanism.nv)  # offsets from the reference [rad, robot lengths]
    for group in _group_loops(mechanism, lower, upper, near_platform):
        try:
            u[group.columns] = _find_nearest_offsets(group)
        except NotAssembled as failure:
            u[group.columns] = _find_with_fewer_limits(group, failure)
    step = u * mechanism.column_scale  # [rad, m]
    q = integrate(mechanism, mechanism.q_near, step)
    stated = velocity_columns(mechanism.model, mechanism.description.reference)
    moved = stated if len(stated) else np.arange(mechanism.nv)
    farthest = int(moved[np.argmax(np.abs(u[moved]))])
    name, unit = mechanism.coordinates.name_of(farthest), mechanism.unit_of(farthest)

    # close once more, with q as the reference: offsets from a far one have its rounding. With a slide stated
    # at 1e6 m, loops that count as closed are still a millimetre apart
    there = mechanism.with_nearby_pose(q)
    lower, upper = _joint_ranges(there)  # of offsets from q
    offsets = np.zeros(there.nv)  # [rad, robot lengths]
    for group in _group_loops(there, lower, upper):
        start = np.clip(0.0, group.lower, group.upper)  # q, but for joints beyond their range by rounding
        offsets[group.columns], _residual = group.close(start)
    q = integrate(there, there.q_near, offsets * there.column_scale)
    return ClosedPose(q, f"{name} {abs(step[farthest]):.3g} {unit}")


def can_close(
    mechanism: Mechanism, columns: IntArray, positions: Array, near_platform: Array | None = None
) -> bool:
    """Return whether a search closes the loops in any mode, whatever the joints' limits.

    Args:
        columns: (k,) of joints that stand at `positions` (k,).
        near_platform: platform coordinates (n,) that the pose must have.
    """
    free = replace(mechanism, limits=())
    lower, upper = _joint_ranges(free)
    reference = mechanism.coordinates.positions(mechanism.q_near[None])[0]
    offsets = (positions - reference[columns]) / mechanism.column_scale[columns]
    lower[columns] = offsets
    upper[columns] = offsets + SAME_PLACE * np.maximum(np.abs(offsets), 1.0)
    groups = _group_loops(free, lower, upper, near_platform)
    try:
        misses = [group.residual(_find_nearest_offsets(group))[group.gaps.stop :] for group in groups]
    except NotAssembled:
        return False
    return bool(np.abs(np.concatenate(misses)).max(initial=0.0) < LOOP_GAP)


@dataclass(frozen=True, eq=False)
class _Group:
    """m loop equations of k joints as functions of offsets u (k,) from the reference.

    Offsets are in radians and lengths of the robot.
    """

    mechanism: Mechanism
    rows: LoopRows
    directions: LockedDirections  # d pairs of axes that are all parallel only if no closure is flipped
    columns: IntArray  # (k,) columns of the joints
    lower: Array  # (k,) least offsets within the limits; infinite without limits
    upper: Array  # (k,) largest offsets within the limits
    weights: Array  # (k,) of the offsets: 1 for joints that the reference states, less for others
    platform: PlatformCoordinates | None = None  # that is to come near to a target
    target: Array | None = None  # (n,) its coordinates there

    def residual(self, u: Array) -> Array:
        """Compute all residuals (m + 3 d + n,) at u [robot lengths or rad].

        They are m loop equations, d direction gaps, and the offset of the platform from a target; n = 0
        without one.
        """
        frames = self._frames(u)
        equations = scaled_equations(self.mechanism, self.rows, frames)
        parts = [equations.residual[0], direction_gaps(self.directions, frames).ravel()]
        if self.platform is not None and self.target is not None:
            offset = self.platform.residual(frames, self.target[None])[0]  # (n,) [m, rad]
            parts.append(offset / self.mechanism.unit_lengths(~self.platform.translations))
        return np.concatenate(parts)

    def slope(self, u: Array) -> Array:
        """Compute the derivative (m + 3 d + n, k) of `residual` along u."""
        frames = self._frames(u)
        equations = scaled_equations(self.mechanism, self.rows, frames)
        # (d, 3, nv)
        direction_slopes = direction_gap_derivatives(self.directions, frames)[0] * self.mechanism.column_scale
        rows = [equations.jacobian[0], direction_slopes.reshape(-1, self.mechanism.nv)]  # (m, nv), (3 d, nv)
        if self.platform is not None:
            lengths = self.mechanism.unit_lengths(~self.platform.translations)
            rows.append(scale_jacobian(self.mechanism, self.platform.jacobian(frames)[0], lengths))
        return np.concatenate(rows)[:, self.columns]

    @property
    def gaps(self) -> slice:
        """The residuals of loops and directions, without the platform's."""
        return slice(len(self.rows.names) + 3 * len(self.directions.closures))

    def close(self, start: Array) -> tuple[Array, float]:
        """Find offsets (k,) near a start (k,) that close the loops best.

        Returns:
            The offsets; the largest residual there [robot lengths or rad].
        """
        from scipy.optimize import least_squares

        # steps of least norm (lsmr), as most loops have more joints than independent equations
        solver = "lsmr" if len(start) > 1 else "exact"
        bounds = self.lower, self.upper
        if self.target is not None:  # first at the target, if it is within reach
            start = least_squares(self.residual, start, self.slope, bounds=bounds, **CLOSING).x
        answer = least_squares(
            lambda u: self.residual(u)[self.gaps],
            start,
            lambda u: self.slope(u)[self.gaps],
            bounds=bounds,
            tr_solver=solver,
            **{**CLOSING, "ftol": STALLED},
        )
        return answer.x, float(np.abs(answer.fun).max())

    def nearly_close(self, start: Array) -> Array:
        """Find the smallest offsets u (k,) near a start that nearly close the loops, near the target.

        They minimise the sum of the squares of `weights` u, and of residuals over `GAP_PER_RADIAN`.
        """
        from scipy.optimize import least_squares

        def residual(u: Array) -> Array:
            """Compute the weighted residuals, then the weighted offsets, (m + 3 d + n + k,)."""
            return np.concatenate([self.residual(u) / GAP_PER_RADIAN, self.weights * u])

        def slope(u: Array) -> Array:
            """Compute the derivative (m + 3 d + n + k, k) of this residual."""
            return np.concatenate([self.slope(u) / GAP_PER_RADIAN, np.diag(self.weights)])

        answer = least_squares(residual, start, slope, bounds=(self.lower, self.upper), **NEARLY_CLOSING)
        return np.asarray(answer.x)

    def configuration(self, u: Array) -> Array:
        """Return the configuration (nq,) at offsets u (k,)."""
        steps = u * self.mechanism.column_scale[self.columns]
        return integrate_columns(self.mechanism, self.mechanism.q_near, self.columns, steps)

    def _frames(self, u: Array) -> FrameStack:
        """Compute the frames at offsets u (k,), T = 1."""
        return frames_at(self.mechanism, self.configuration(u)[None])


def _group_loops(
    mechanism: Mechanism, lower: Array, upper: Array, target: Array | None = None
) -> list[_Group]:
    """Split the loop equations into groups that share no joint; a target makes one group of all.

    A group is a connected component of the graph in which two of the m rows are joined if both depend on a
    joint. Springs stay at rest, so their joints join no rows.

    Args:
        lower, upper: (nv,) limits of the joints as offsets from the reference [rad, robot lengths].
        target: (n,) platform coordinates.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    weights = np.full(mechanism.nv, UNSTATED_WEIGHT)  # of the offsets
    weights[velocity_columns(mechanism.model, mechanism.description.reference)] = 1.0
    directions = mechanism.directions
    if target is not None:
        platform = platform_coordinates(mechanism.description.platform, mechanism.model)
        platform = platform.choose_chart(frames_at(mechanism, mechanism.q_near[None]).platform_rotation)
        columns = mechanism.joints
        bounds = lower[columns], upper[columns]
        weights *= UNSTATED_WEIGHT  # the target comes first
        rows = mechanism.rows
        return [_Group(mechanism, rows, directions, columns, *bounds, weights[columns], platform, target)]

    carried = scratch_of(mechanism).carried  # (F, nv) 1 where a joint moves a frame
    # (m, nv) whether a row depends on a joint, which then moves only one of the row's two bodies
    depends = mechanism.rows.joint_signs(carried) != 0.0
    depends |= coupling_pattern(mechanism.rows, mechanism.nv)
    depends[:, mechanism.elastic] = False
    shared = depends.astype(float) @ depends.T  # (m, m) number of joints on which two rows depend
    count, label = connected_components(csr_array(shared), directed=False)  # (m,) group of each row

    groups = []
    for k in range(count):
        is_row = label == k
        columns = np.flatnonzero(depends[is_row].any(axis=0))
        table = mechanism.rows.take(np.flatnonzero(is_row))
        closures = [name.rpartition(".")[0] for name in table.names]  # names of rows are closure.axis
        locked = select(directions, np.isin(directions.closures, closures))
        bounds = lower[columns], upper[columns]
        groups.append(_Group(mechanism, table, locked, columns, *bounds, weights[columns]))
    return groups


def _joint_ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return the limits of all joints as offsets from the reference, (nv,) each [rad, robot lengths]."""
    reference = mechanism.coordinates.positions(mechanism.q_near[None])[0]
    lower, upper = (mechanism.joint_ranges - reference) / mechanism.column_scale
    # the solver refuses equal bounds, so equal limits are moved apart by a distance that does not matter
    limited = np.isfinite(lower)
    least_range = SAME_PLACE * np.maximum(np.abs(lower[limited]), 1.0)
    upper[limited] = np.maximum(upper[limited], lower[limited] + least_range)
    return lower, upper


def _find_nearest_offsets(group: _Group) -> Array:
    """Find the smallest offsets (k,) that close a group's loops, from several starts."""
    enough_poses = 8  # number of closed poses after which the search ends
    turning = ~group.mechanism.sliding[group.columns]
    limited = np.isfinite(group.lower)
    reference = np.clip(0.0, group.lower, group.upper)
    # half a turn, or a length of the robot; within limits up to two turns, or ten lengths
    half_range = np.where(turning, np.where(limited, 4.0, 1.0) * np.pi, np.where(limited, 10.0, 1.0))
    low = np.maximum(group.lower, reference - half_range)
    high = np.minimum(group.upper, reference + half_range)

    # with some joints stated and some not, every other start has the stated ones where the file has them
    stated = group.weights == group.weights.max(initial=0.0)
    holds = stated.any() and not stated.all()
    rng = np.random.default_rng(0)
    poses: list[Array] = []  # offsets (k,) that close the loops
    best_u, least_gap = reference, np.inf  # of all starts so far
    for k in range(MAX_STARTS):
        start = rng.uniform(low, high) if k else reference
        if holds and k % 2:
            start = np.where(stated, reference, start)
        u, gap = group.close(group.nearly_close(start))
        if gap < least_gap:
            best_u, least_gap = u, gap
        if gap < LOOP_GAP:
            wrapped = wrap_angles(u)
            within = (group.lower <= wrapped) & (wrapped <= group.upper)
            poses.append(np.where(turning & within, wrapped, u))
            if (k == 0 and group.target is None) or len(poses) == enough_poses:
                break
    if not poses:
        raise _still_open_error(group, best_u)

    def distance(u: Array) -> float:
        """Compute the distance of a pose from the target and from the reference."""
        return float(np.linalg.norm(np.append(group.residual(u)[group.gaps.stop :], group.weights * u)))

    return min(poses, key=distance)


def _find_with_fewer_limits(group: _Group, failure: NotAssembled) -> Array:
    """Search offsets (k,) of a group without the limits of one joint [rad, robot lengths].

    Raises:
        NotAssembled: the failure; if the loops close beyond the joints' limits, with these limits.
    """
    mechanism = group.mechanism
    limits = tuple(limit for limit in mechanism.limits if limit.column in group.columns)
    if not limits:
        raise failure

    def search_without(columns: list[int]) -> tuple[Array, dict[str, str]]:
        """Return offsets (k,) found without the limits of some columns, and positions beyond limits."""
        is_free = np.isin(group.columns, columns)
        lower, upper = np.where(is_free, -np.inf, group.lower), np.where(is_free, np.inf, group.upper)
        u = _find_nearest_offsets(replace(group, lower=lower, upper=upper))
        return u, positions_beyond_limits(limits, group.configuration(u)[None])

    try:
        free, beyond = search_without(group.columns.tolist())
    except NotAssembled:
        raise failure from None
    if not beyond:
        return free
    alone = []  # joints of which one beyond its limits is enough
    for joint in beyond:
        with suppress(NotAssembled):
            u, exceeded = search_without([limit.column for limit in limits if limit.joint == joint])
            if not exceeded:
                return u
            alone.append(" and ".join(f"{name} {words}" for name, words in exceeded.items()))
    listed = " or ".join(alone) or " and ".join(f"{joint} {words}" for joint, words in beyond.items())
    raise NotAssembled(
        f"the loops close only beyond the joints' limits, with {listed}: the limits "
        f"contradict the loops; change them, or the zero of the joint",
        name=mechanism.name,
        q=group.configuration(free),
        residual=failure.residual,
    )


def _still_open_error(group: _Group, u: Array) -> NotAssembled:
    """Return the error for a group that no start has closed; offsets `u` (k,) have the least gap."""
    mechanism, q = group.mechanism, group.configuration(u)
    gap = np.abs(group.residual(u))[: len(group.rows.names)]  # of the loop equations, without directions
    row = np.argmax(gap)
    length, unit = (1.0, "rad") if group.rows.rotation[row] else (mechanism.length, "m")
    residual = float(gap[row]) * length
    best = f"{group.rows.names[row]} stays {residual:.3g} {unit} apart"
    advice = "check the link lengths and the closures, or give a reference near to an assembled configuration"
    if np.abs(group.slope(u)[row]).max() < LOOP_GAP:  # as across the plane of a planar loop
        advice = "no joint changes this gap: place the two frames alike along it"
    if gap[row] < LOOP_GAP:  # the equations are closed, so a closure must be flipped
        best = f"{find_flipped_closure(mechanism, frames_at(mechanism, q[None]))} is turned over"
    return NotAssembled(
        f"the loops do not close: of {MAX_STARTS} starts within the joints' limits none "
        f"leads to a closed pose; in the best {best}; {advice}",
        name=mechanism.name,
        q=q,
        residual=residual,
    )
