"""Independent loop equations and idle joints of a mechanism, determined once at its assembled reference.

The loop equations of a planar robot described in 3D are redundant: those out of its plane follow from the
others in every pose. A rank-revealing QR finds redundant rows. If the rank drops only at isolated poses,
these are singularities (see `singularity`). So a reference with a lower rank than nearby poses is refused:
the structure found there would not hold at any other pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.errors import SingularReference
from framework.kinematics.assembly import all_loops_matrix
from framework.kinematics.closures import scale_jacobian
from framework.kinematics.frames import frames_at
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.platform import PlatformCoordinates
from framework.numerics.arrays import LEAST_DIVISOR, Array, IntArray, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values
from framework.numerics.subspaces import split_row_space
from framework.tolerances import BRANCHES_MEET, RANK_LOST, RANK_ROUNDING

ODD_SIZE = 0.02  # rows are scaled to unit size if the largest entry is below this or above its inverse


@dataclass(frozen=True, eq=False)
class LoopStructure(ReadOnlyArrays):
    """The independent rows and idle joints of a mechanism, determined once at its reference."""

    independent: IntArray  # (m,) ascending indices of independent equations in the mechanism's `rows`
    dropped: IntArray  # (rows - m,) ascending indices of redundant equations
    springs_alone: Names  # names of equations that only springs can change
    idle: IntArray  # columns of passive joints that rest because their motion moves nothing
    row_sizes: Array  # (m,) divisors that bring the independent equations to unit size for rank decisions

    @staticmethod
    def of(mechanism: Mechanism, passive: IntArray, matrices: Sequence[Array]) -> LoopStructure:
        """Determine the structure from `motion_matrix` at the reference and at poses nearby.

        Args:
            passive: columns of the velocity vector without a motor and without a spring.
            matrices: (n + rows, nv) each, that of the reference first.
        """
        loops = matrices[0][-len(mechanism.rows.names) :]
        independent = independent_rows(loops[:, mechanism.joints])
        idle = find_idle_joints(matrices[0][:, passive], passive)
        moving = np.setdiff1d(mechanism.joints, idle)
        return LoopStructure(
            independent=independent,
            dropped=np.setdiff1d(np.arange(len(loops)), independent),
            springs_alone=spring_only_rows(mechanism, independent, matrices),
            idle=idle,
            row_sizes=_row_sizes(loops[independent][:, moving]),
        )


def refuse_singular_reference(
    mechanism: Mechanism, passive: IntArray, poses: Sequence[Array], matrices: Sequence[Array]
) -> None:
    """Raise SingularReference if a rank at the reference is lower than at a nearby pose.

    Two ranks are compared: that of the loops along all joints, and that of platform and loops along the
    passive joints. `matrices` are those of `motion_matrix` at the `poses` (nq,), the reference first.
    """
    reference, *others = matrices
    count = len(mechanism.rows.names)  # the last rows of each matrix are the loops
    for nearby in others:
        rows = _rows_losing_rank(reference[-count:, mechanism.joints], nearby[-count:, mechanism.joints])
        joints = _rows_losing_rank(reference[:, passive].T, nearby[:, passive].T)
        if len(rows) or len(joints):
            raise SingularReference(
                mechanism.name,
                rows=[mechanism.rows.names[k] for k in rows],
                joints=[mechanism.coordinates.name_of(passive[k]) for k in joints],
                poses=[mechanism.reference_values(pose) for pose in poses[1:]],
            )


def independent_rows(matrix: Array) -> IntArray:
    """Return the ascending indices of rows that form a basis of the row space."""
    return np.sort(pivot_rows(matrix)[: numerical_rank(matrix)])


def spring_only_rows(mechanism: Mechanism, independent: IntArray, matrices: Sequence[Array]) -> Names:
    """Return the names of loop equations that only springs can change.

    Only its springs would close a closure with such an equation, which planning refuses.

    Args:
        independent: rows that are independent along the joints.
        matrices: those of `motion_matrix` at several poses; their last rows are the loops.
    """
    if not mechanism.n_e:
        return ()
    names = mechanism.rows.names
    for matrix in matrices:
        with_springs = independent_rows(matrix[-len(names) :])  # along all columns, springs included
        if len(with_springs) > len(independent):
            return tuple(names[row] for row in np.setdiff1d(with_springs, independent))
    return ()


def find_idle_joints(matrix: Array, passive: IntArray) -> IntArray:
    """Find one passive joint for each motion that moves neither platform nor loops.

    An example is the turn of a rod about its own axis. The motions are the null space of `motion_matrix`
    along the passive joints, `matrix` (n + rows, n_p). They carry no load if the turning body is balanced
    about its axis; `dynamics.motion_checks` measures the load that remains.
    """
    if not len(passive):
        return passive
    motions = null_directions(matrix, RANK_ROUNDING)  # (c, n_p)
    return np.sort(passive[pivot_rows(motions.T)[: len(motions)]])


def motion_matrix(mechanism: Mechanism, platform: PlatformCoordinates, q: Array) -> Array:
    """Compute the dimensionless Jacobian (n + rows, nv) of platform and all loop equations at q (nq,)."""
    jacobian = platform.jacobian(frames_at(mechanism, q[None]))
    rows = scale_jacobian(mechanism, jacobian, ~platform.translations)[0]
    return np.concatenate([rows, all_loops_matrix(mechanism, q)])


def _rows_losing_rank(at_reference: Array, nearby: Array) -> IntArray:
    """Find the rows of `nearby` (rows, columns) that raise its rank above that of `at_reference`.

    The rows that are independent at the reference span a space at the nearby pose, too. The rows farthest
    from this space are chosen one after the other.
    """
    rank, rank_at_reference = numerical_rank(nearby), numerical_rank(at_reference, BRANCHES_MEET)
    if rank_at_reference >= rank:
        return np.empty(0, dtype=np.intp)
    independent = pivot_rows(at_reference)[:rank_at_reference]
    span = np.linalg.qr(nearby[independent].T)[0]  # (columns, rank_at_reference) orthonormal
    outside = nearby - nearby @ span @ span.T  # components of all rows orthogonal to the span
    return np.sort(pivot_rows(outside)[: rank - rank_at_reference])


def numerical_rank(matrix: Array, level: float = RANK_ROUNDING) -> int:
    """Count the singular values above `level` times the largest."""
    values = singular_values(matrix)
    return int(np.sum(values > level * values.max(initial=0.0)))


def null_directions(matrix: Array, level: float = RANK_LOST, *, at_least: int = 0) -> Array:
    """Compute orthonormal vectors (c, k) that a matrix (m, k) maps nearly to zero.

    They are the right singular vectors whose singular values are below `level` times the largest value, or
    times 1 if this is more. At least `at_least` vectors are returned, even if their singular values are
    larger.
    """
    return split_row_space(matrix, level, scale=(1.0, np.inf), at_least=at_least)[1]


def pivot_rows(matrix: Array) -> IntArray:
    """Order the rows of a matrix: each is the farthest from the span of its predecessors."""
    outside = matrix.copy()  # components of all rows orthogonal to the rows chosen so far
    order = np.arange(len(matrix))
    for chosen in range(min(matrix.shape)):
        sizes = np.linalg.norm(outside[order[chosen:]], axis=1)
        farthest = chosen + sizes.argmax()
        order[[chosen, farthest]] = order[[farthest, chosen]]
        direction = outside[order[chosen]] / max(sizes.max(), LEAST_DIVISOR)
        outside -= np.outer(outside @ direction, direction)
    return order


def _row_sizes(loops: Array) -> Array:
    """Return the largest entry (m,) of each equation (m, columns), or 1 if near 1.

    Multiplying an equation by a factor, as a change of unit does, must not make it look singular.
    """
    sizes = np.abs(loops).max(axis=1, initial=0.0)
    is_odd = (sizes < ODD_SIZE) | (sizes > 1 / ODD_SIZE)
    return np.where(is_odd, np.maximum(sizes, LEAST_DIVISOR), 1.0)
