"""Which loop equations are redundant and which joints are idle, determined once at the assembled reference.

The loop equations of a planar robot described in 3D are redundant: those out of its plane follow from the
others in every pose. A rank-revealing QR finds redundant rows. If the rank drops only at isolated poses,
these are singularities (see `singularity`). So a reference with a lower rank than nearby poses is refused:
the structure found there would not hold at any other pose.

Overconstrained mechanisms with rounded dimensions: with exact dimensions some of their loop equations are
redundant. With dimensions of seven digits these equations contradict the others by about 1e-7, and no pose
satisfies all of them. So only equations that are independent beyond rounding are solved, exactly. The
residual of the other equations, `Mechanism.rounded`, is measured along each motion and reported in its
certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from framework.errors import NotAssembled, SingularReference
from framework.kinematics.assembly import (
    Closing,
    close_reference,
    joint_loops_matrix,
    loops_at,
    nearby_configurations,
)
from framework.kinematics.assembly_search import find_closed_pose
from framework.kinematics.closures import loop_equations, scale_jacobian, scaled_equations
from framework.kinematics.frames import frames_at
from framework.kinematics.loop_ranges import row_space_basis
from framework.kinematics.mechanism import Mechanism, reference_length
from framework.kinematics.platform import PlatformCoordinates
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import LEAST_DIVISOR, Array, IntArray, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values, split_row_space
from framework.tolerances import BRANCHES_MEET, EXPORT_ROUNDING, RANK_LOST, RANK_ROUNDING

ODD_SIZE = 0.02  # of the largest entry of a row, below which, or above its inverse, the row is scaled
DISTANCE_APART = 0.5  # [rad, robot lengths] of poses whose loops differ by more than rounding
ROUNDED_ROW = 10 * EXPORT_ROUNDING  # relative singular value of rounding; least in the catalogue: 8e-3


@dataclass(frozen=True, eq=False)
class LoopStructure(ReadOnlyArrays):
    """The independent rows and idle joints of a mechanism, determined once at its reference."""

    independent: IntArray  # (m,) ascending indices of independent equations in the mechanism's `rows`
    dropped: IntArray  # (rows - m,) ascending indices of redundant equations
    spring_only_rows: Names  # names of equations that only springs can change
    idle: IntArray  # columns of passive joints that rest because their motion moves nothing
    row_sizes: Array  # (m,) divisors that bring the independent equations to unit size for rank decisions
    spanning: IntArray  # (R,) ascending indices in `rows`, then `rounded`, of rows that suffice in all poses
    span_sizes: Array  # (R,) divisors that bring them to unit size
    row_space: Array  # (nv, m) see `row_space_basis`, at the reference along the moving joints

    @cached_property
    def varies(self) -> bool:
        """Whether no m fixed rows suffice in all poses: then m combinations of R rows are solved."""
        return len(self.spanning) > len(self.independent)

    @staticmethod
    def from_matrices(
        mechanism: Mechanism, passive: IntArray, matrices: Sequence[Array], apart: Sequence[Array]
    ) -> LoopStructure:
        """Determine the structure from Jacobians at the reference, at nearby poses and at poses far apart.

        A row is redundant in all poses if it follows from others by one combination, which then annihilates
        the Jacobians of all poses side by side. If more rows than m are independent side by side, no m of
        them suffice everywhere.

        Args:
            passive: columns of the velocity vector without a motor and without a spring.
            matrices: dimensionless Jacobians (n + rows, nv) at the reference, then at nearby poses. The n
                rows of the platform come first, then one row for each loop equation.
            apart: dimensionless Jacobians (rows + rounded, nv) at the reference and at poses far apart.
        """
        at_reference = matrices[0]
        platform_rows = len(at_reference) - len(mechanism.rows.names)
        loops = at_reference[platform_rows:]
        joints = mechanism.joints  # all columns without those of the springs' own joints
        independent = independent_rows(loops[:, joints])
        # One passive joint for each motion that moves neither platform nor loops, such as the turn of a rod
        # about its own axis: the null space of `motion_matrix` along the passive joints. They carry no load
        # if the turning body is balanced about its axis; `dynamics.motion_checks` measures what remains.
        idle_motions = null_directions(at_reference[:, passive], RANK_ROUNDING)  # (c, n_p)
        idle = passive[choose_rows(idle_motions.T, len(idle_motions))]
        moving = np.setdiff1d(joints, idle)

        spanning = independent
        side_by_side = np.hstack([jacobian[:, joints] for jacobian in apart])  # (rows, poses joints)
        # rounded rows differ from redundant ones by their rounding, in all poses
        level = ROUNDED_ROW if mechanism.rounded.names else BRANCHES_MEET
        needed = numerical_rank(side_by_side, level)
        varies = needed > len(independent)
        if varies:
            spanning = choose_rows(side_by_side, needed)
        rows = apart[0][spanning][:, moving]  # (R, moving) at the reference
        # divisors (R,) to unit size: a factor of an equation, as of another unit, makes none singular
        sizes = np.abs(rows).max(axis=1, initial=0.0)
        is_odd = (sizes < ODD_SIZE) | (sizes > 1 / ODD_SIZE)
        span_sizes = np.where(is_odd, np.maximum(sizes, LEAST_DIVISOR), 1.0)
        row_space = np.zeros((mechanism.nv, len(independent)))
        row_space[moving] = row_space_basis(rows / span_sizes[:, None], len(independent))
        return LoopStructure(
            independent=independent,
            dropped=np.setdiff1d(np.arange(len(loops)), independent),
            spring_only_rows=find_spring_only_rows(mechanism, independent, matrices),
            idle=idle,
            row_sizes=np.ones(len(independent)) if varies else span_sizes,
            spanning=spanning,
            span_sizes=span_sizes,
            row_space=row_space,
        )


def refuse_singular_reference(
    mechanism: Mechanism, passive: IntArray, poses: Sequence[Array], matrices: Sequence[Array]
) -> None:
    """Raise SingularReference if a rank at the reference is lower than at a nearby pose.

    Two ranks are compared: that of the loops along all joints, and that of platform and loops along the
    `passive` columns.

    Args:
        passive: columns of the velocity vector without a motor and without a spring.
        poses: configurations (nq,), the reference first.
        matrices: dimensionless Jacobians (n + rows, nv) of platform and loops at these poses.
    """
    reference, *others = matrices
    n = len(reference) - len(mechanism.rows.names)
    for nearby in others:
        rows = _rows_losing_rank(reference[n:, mechanism.joints], nearby[n:, mechanism.joints])
        # transposed, so that each row belongs to a passive joint
        joints = _rows_losing_rank(reference[:, passive].T, nearby[:, passive].T)  # indices into `passive`
        if len(rows) or len(joints):
            raise SingularReference(
                mechanism.name,
                rows=[mechanism.rows.names[k] for k in rows],
                joints=[mechanism.coordinates.name_of(passive[k]) for k in joints],
                poses=[mechanism.printed_reference(pose) for pose in poses[1:]],
            )


def independent_rows(matrix: Array) -> IntArray:
    """Return the ascending indices of rows of a matrix that form a basis of its row space."""
    return choose_rows(matrix, numerical_rank(matrix))


def find_spring_only_rows(mechanism: Mechanism, independent: IntArray, matrices: Sequence[Array]) -> Names:
    """Find the names of loop equations that only springs can change.

    Planning refuses a closure with such an equation, because its joints cannot close it.

    Args:
        independent: indices of the rows that are independent along the joints.
        matrices: dimensionless Jacobians (n + rows, nv) at several poses; their last rows are the loops.
    """
    if not mechanism.n_e:
        return ()
    names = mechanism.rows.names
    for matrix in matrices:
        # along all columns, springs included
        with_springs = independent_rows(matrix[len(matrix) - len(names) :])
        if len(with_springs) > len(independent):
            return tuple(names[row] for row in np.setdiff1d(with_springs, independent))
    return ()


def jacobians_apart(mechanism: Mechanism, reference: Array) -> list[Array]:
    """Compute dimensionless Jacobians (rows + rounded, nv) of the loops at the reference and poses apart.

    Poses DISTANCE_APART tell combinations of rows that change from pose to pose, also to
    third order only, from those that rounded dimensions leave.
    """
    rows = mechanism.rows.append(mechanism.rounded)
    poses = [reference, *nearby_configurations(mechanism, reference, distance=DISTANCE_APART)]
    return list(scaled_equations(mechanism, rows, frames_at(mechanism, np.stack(poses))).jacobian)


def motion_matrix(mechanism: Mechanism, platform: PlatformCoordinates, q: Array) -> Array:
    """Compute the dimensionless Jacobian (n + rows, nv) of platform and all loop equations at q (nq,)."""
    jacobian = platform.jacobian(frames_at(mechanism, q[None]))
    rows = scale_jacobian(mechanism, jacobian, mechanism.unit_lengths(~platform.translations))[0]
    return np.concatenate([rows, loops_at(mechanism, q).jacobian])


def _rows_losing_rank(at_reference: Array, nearby: Array) -> IntArray:
    """Find the rows of `nearby` (rows, columns) that raise its rank above that of `at_reference`.

    The rows that are independent at the reference span a space at the nearby pose, too. The rows farthest
    from this space are chosen one after the other. Both matrices have the same rows and columns.

    Returns:
        Ascending indices of the rows; empty if the rank does not rise.
    """
    rank = numerical_rank(nearby)
    # a coarser level at the reference, so that a nearly singular one counts as singular, too
    rank_at_reference = numerical_rank(at_reference, BRANCHES_MEET)
    if rank_at_reference >= rank:
        return np.empty(0, dtype=np.intp)
    independent = pivot_rows(at_reference)[:rank_at_reference]
    span, _ = np.linalg.qr(nearby[independent].T)  # (columns, rank_at_reference) orthonormal
    outside = nearby - nearby @ span @ span.T  # components of all rows orthogonal to the span
    return choose_rows(outside, rank - rank_at_reference)


def numerical_rank(matrix: Array, level: float = RANK_ROUNDING) -> int:
    """Count the singular values of a matrix above `level` times the largest."""
    values = singular_values(matrix)
    return int(np.sum(values > level * values.max(initial=0.0)))


def null_directions(matrix: Array, level: float = RANK_LOST, *, at_least: int = 0) -> Array:
    """Compute orthonormal vectors (c, k) that a matrix (m, k) maps nearly to zero.

    They are the right singular vectors whose singular values are below `level` times the largest value, or
    times 1 if this is more. At least `at_least` vectors are returned, even if their singular values are
    larger.
    """
    return split_row_space(matrix, level, scale=(1.0, np.inf), at_least=at_least)[1]


def choose_rows(matrix: Array, count: int) -> IntArray:
    """Choose `count` rows of a matrix that are as independent as possible; return ascending indices."""
    return np.sort(pivot_rows(matrix)[:count])


def pivot_rows(matrix: Array) -> IntArray:
    """Order the rows of a matrix (m, k): each is the farthest from the span of its predecessors.

    This is a Gram-Schmidt process with pivoting; the result has the indices of all m rows.
    """
    outside = matrix.copy()  # components of all rows orthogonal to the rows chosen so far
    order = np.arange(len(matrix))
    for chosen in range(min(matrix.shape)):  # number of rows chosen so far
        distances = np.linalg.norm(outside[order[chosen:]], axis=1)  # of the other rows from their span
        farthest = chosen + distances.argmax()
        order[[chosen, farthest]] = order[[farthest, chosen]]
        direction = outside[order[chosen]] / max(distances.max(), LEAST_DIVISOR)
        outside -= np.outer(outside @ direction, direction)
    return order


def assemble_mechanism(mechanism: Mechanism) -> tuple[Mechanism, Closing]:
    """Close the loops at the reference, without rows that only the rounding of dimensions keeps independent.

    Such rows show in one of two ways. Usually they keep the loops open. But the pose in which a mechanism was
    drawn may satisfy them to the last digit; then they close there, and lock the mechanism. In this case the
    Jacobian has singular values of the size of rounding, and the rows are excluded if they also follow from
    the others, up to rounding, at nearby poses.

    Without a stated reference, a pose beyond the joints' limits gives way to one within them, if a search
    finds one.

    Returns:
        The mechanism whose `rows` close exactly, and its closed pose.

    Raises:
        NotAssembled: the loops do not close, for another reason than rounding; see `close_reference`.
    """
    try:
        closing = close_reference(mechanism)
    except NotAssembled as failure:
        reduced = _exclude_rounded_rows(mechanism, failure.q)
        if reduced is None:
            raise
        return reduced, close_reference(reduced)
    if not mechanism.description.reference and positions_beyond_limits(mechanism.limits, closing.q[None]):
        with suppress(NotAssembled):
            mechanism = mechanism.with_nearby_pose(find_closed_pose(mechanism).q)
            closing = close_reference(mechanism)
    # for these decisions rows are scaled by the mechanism's size at the closed pose, because its `length` is
    # the size at the file's reference, which may be far off
    sized = replace(mechanism, length=reference_length(mechanism.model, closing.q, mechanism.frames))
    matrix = joint_loops_matrix(sized, closing.q)
    rank_without_rounding = numerical_rank(matrix, ROUNDED_ROW)
    if numerical_rank(matrix) > rank_without_rounding:
        reduced = _exclude_rounded_rows(sized, closing.q)
        poses = [] if reduced is None else nearby_configurations(reduced, closing.q)
        ranks = [numerical_rank(joint_loops_matrix(sized, pose), ROUNDED_ROW) for pose in poses]
        gaps = [np.abs(loops_at(sized, pose).residual).max() for pose in poses]  # [rad, robot lengths]
        if reduced is not None and set(ranks) == {len(reduced.rows.names)} and max(gaps) <= EXPORT_ROUNDING:
            return replace(reduced, length=mechanism.length), closing
    return mechanism, closing


def rounded_gap(mechanism: Mechanism, q: Array) -> float:
    """Compute the largest residual of the rounded rows over configurations q (T, nq) [m or rad]."""
    if not mechanism.rounded.names:
        return 0.0
    return float(np.abs(loop_equations(mechanism.rounded, frames_at(mechanism, q)).residual).max())


def _exclude_rounded_rows(mechanism: Mechanism, q: Array) -> Mechanism | None:
    """Move rows that are redundant except for rounding at q (nq,) to `Mechanism.rounded`.

    None if there are no such rows, or if more than rounding keeps the loops open at q.
    """
    rows, loops = mechanism.rows, loops_at(mechanism, q)
    matrix = loops.jacobian[:, mechanism.joints]
    rank = numerical_rank(matrix, ROUNDED_ROW)
    if np.abs(loops.residual).max() > EXPORT_ROUNDING or rank == len(rows.names):
        return None
    order = pivot_rows(matrix)
    independent, others = np.sort(order[:rank]), np.sort(order[rank:])
    return replace(mechanism, rows=rows.take(independent), rounded=rows.take(others))
