"""Independent loop equations and idle joints of a mechanism, decided once at its assembled reference.

A planar robot written in 3D has loop equations out of its plane that follow from the others in all poses.
Rank-revealing QR finds such redundant rows. A rank that drops at single poses is a singularity, see
`singularity`. A reference with a lower rank than nearby poses is refused: its structure holds nowhere else.
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

ODD_SIZE = 0.02  # a loop equation below this share of a unit motion, or above its inverse, is brought to it


@dataclass(frozen=True, eq=False)
class LoopStructure(ReadOnlyArrays):
    """The independent rows and idle joints of a mechanism, decided once at its reference."""

    independent: IntArray  # (m,) ascending, of the mechanism's `rows`: equations that do not repeat others
    dropped: IntArray  # (rows - m,) ascending, equations that repeat others
    springs_alone: Names  # names of equations that springs can move and joints cannot
    idle: IntArray  # passive joints that rest because their motion moves nothing
    row_sizes: Array  # (m,) divides the independent equations where rank is judged

    @staticmethod
    def of(mechanism: Mechanism, passive: IntArray, matrices: Sequence[Array]) -> LoopStructure:
        """Decide by `motion_matrix` at the reference, first of the `matrices`, and at poses nearby.

        Args:
            passive: entries of the velocity vector without a motor and without a spring.
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


def singular_reference_error(
    mechanism: Mechanism, passive: IntArray, poses: Sequence[Array], matrices: Sequence[Array]
) -> SingularReference | None:
    """Return the error for a singular reference; None for a regular one.

    There the loops, or the loops and the platform along the passive joints, have a lower rank than at another
    pose. `matrices` are those of `motion_matrix` at the `poses` (nq,), of which the first is the reference.
    """
    at_reference, count = matrices[0], len(mechanism.rows.names)
    for nearby in matrices[1:]:  # the loops' rows are the last `count`
        rows = _rows_losing_rank(at_reference[-count:, mechanism.joints], nearby[-count:, mechanism.joints])
        joints = _rows_losing_rank(at_reference[:, passive].T, nearby[:, passive].T)
        if len(rows) or len(joints):
            return SingularReference(
                mechanism.name,
                rows=[mechanism.rows.names[k] for k in rows],
                joints=[mechanism.coordinates.name_of(int(passive[k])) for k in joints],
                poses=[mechanism.reference_values(pose) for pose in poses[1:]],
            )
    return None


def independent_rows(matrix: Array) -> IntArray:
    """Return the indices, ascending, of rows of a matrix that span all its rows."""
    return np.sort(pivot_rows(matrix)[: numerical_rank(matrix)])


def spring_only_rows(mechanism: Mechanism, independent: IntArray, matrices: Sequence[Array]) -> Names:
    """Return the names of loop equations that springs can move and joints cannot.

    A closure with such an equation would hold by its springs alone, which no loop may rely on.

    Args:
        independent: rows that are independent along the joints.
        matrices: those of `motion_matrix` at several poses; the loops are their last rows.
    """
    if not len(mechanism.elastic):
        return ()
    names = mechanism.rows.names
    for matrix in matrices:
        with_springs = independent_rows(matrix[-len(names) :])  # along all columns, those of springs too
        if len(with_springs) > len(independent):  # the rank grows by rows that only springs move
            return tuple(names[row] for row in np.setdiff1d(with_springs, independent))
    return ()


def find_idle_joints(matrix: Array, passive: IntArray) -> IntArray:
    """Find a passive joint for each motion that moves neither platform nor loops.

    An example is the turn of a rod about its own axis. These motions are the null space of `motion_matrix` (n
    + rows, n_p) along the passive joints. They carry no load as long as the body that they turn is balanced
    about them; `dynamics.residuals` measures the load.
    """
    motions = null_directions(matrix, RANK_ROUNDING) if len(passive) else np.empty((0, 0))  # (c, n_p)
    if not len(motions):
        return passive[:0]
    return np.sort(passive[pivot_rows(motions.T)[: len(motions)]])


def motion_matrix(mechanism: Mechanism, platform: PlatformCoordinates, q: Array) -> Array:
    """Compute the dimensionless Jacobian (n + rows, nv) of platform and all loop equations at q (nq,)."""
    jacobian = platform.jacobian(frames_at(mechanism, q[None]))
    rows = scale_jacobian(mechanism, jacobian, ~platform.translations)[0]
    return np.concatenate([rows, all_loops_matrix(mechanism, q)])


def _rows_losing_rank(at_reference: Array, nearby: Array) -> IntArray:
    """Find the rows by which the rank of `nearby` exceeds that of `at_reference`, (rows, columns) both.

    Rows that are independent at the reference span a space nearby. The rows sought are those that are
    farthest from this space, one after the other.
    """
    rank, rank_at_reference = numerical_rank(nearby), numerical_rank(at_reference, BRANCHES_MEET)
    if rank_at_reference >= rank:
        return np.empty(0, dtype=np.intp)
    independent = pivot_rows(at_reference)[:rank_at_reference]
    span = np.linalg.qr(nearby[independent].T)[0]  # (columns, rank_at_reference) orthonormal
    outside = nearby - nearby @ span @ span.T  # the parts of all rows across the span
    return np.sort(pivot_rows(outside)[: rank - rank_at_reference])


def numerical_rank(matrix: Array, level: float = RANK_ROUNDING) -> int:
    """Count singular values above `level` times the largest."""
    values = singular_values(matrix)
    return int(np.sum(values > level * values.max(initial=0.0)))


def null_directions(matrix: Array, level: float = RANK_LOST, *, at_least: int = 0) -> Array:
    """Compute orthonormal vectors (c, k) that a matrix (m, k) maps to nearly zero, `at_least` so many.

    They are the right singular vectors of values below level times the largest, or times 1 if that is more.
    """
    return split_row_space(matrix, level, scale=(1.0, np.inf), at_least=at_least)[1]


def pivot_rows(matrix: Array) -> IntArray:
    """Order the rows of a matrix, each the farthest from the span of its predecessors."""
    outside = matrix.copy()  # the part of each row outside of the span of the rows before `chosen`
    order = np.arange(len(matrix))
    for chosen in range(min(matrix.shape)):
        sizes = np.linalg.norm(outside[order[chosen:]], axis=1)
        farthest = chosen + sizes.argmax()
        order[[chosen, farthest]] = order[[farthest, chosen]]
        direction = outside[order[chosen]] / max(sizes.max(), LEAST_DIVISOR)
        outside -= np.outer(outside @ direction, direction)
    return order


def _row_sizes(loops: Array) -> Array:
    """Return the largest entry of each equation (m, columns) if far from 1, else 1, (m,).

    An equation may be written in any unit, or as any multiple of itself, without being singular.
    """
    sizes = np.abs(loops).max(axis=1, initial=0.0)
    is_odd = (sizes < ODD_SIZE) | (sizes > 1 / ODD_SIZE)
    return np.where(is_odd, np.maximum(sizes, LEAST_DIVISOR), 1.0)
