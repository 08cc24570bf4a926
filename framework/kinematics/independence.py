"""What counts of a mechanism, decided once at its assembled reference: rows that repeat others, idle joints.

A planar robot written in 3D closes its loop out of the plane for nothing; such rows are redundant
everywhere, and found by rank-revealing QR. A rank that drops in passing is a singularity and is the business
of `singularity`; one that is lower at the reference than beside it is refused, for what is decided there
would be wrong everywhere else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.arrays import Array, IntArray
from framework.errors import SingularReference
from framework.kinematics.assembly import CROSSED, REDUNDANT, loop_matrix
from framework.kinematics.closures import scaled
from framework.kinematics.frames import frames_at
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.platform import PlatformCoordinates


def singular_reference(
    mechanism: Mechanism, passive: IntArray, poses: Sequence[Array], matrices: Sequence[Array]
) -> SingularReference | None:
    """Why nothing can be decided at the reference once for all; None where it can.

    The loops, or the loops and the platform along the passive joints, have a lower rank at the reference, the
    first of the `poses` (nq,), than at the others. `matrices` are those of `motion_matrix` there.
    """
    here, rows = matrices[0], len(mechanism.rows.names)
    for beside in matrices[1:]:
        lost = _lost_rows(here[-rows:, mechanism.joints], beside[-rows:, mechanism.joints])
        still = _lost_rows(here[:, passive].T, beside[:, passive].T)
        if len(lost) or len(still):
            return SingularReference(
                mechanism.name,
                rows=[mechanism.rows.names[k] for k in lost],
                joints=[mechanism.joint_of(int(passive[k])) for k in still],
                poses=[mechanism.reference_values(pose) for pose in poses[1:]],
            )
    return None


def independent_rows(matrix: Array) -> IntArray:
    """Ascending indices of rows that do not repeat others."""
    return np.sort(_pivots(matrix)[: _rank(matrix)])


def rows_of_springs_alone(
    mechanism: Mechanism, independent: IntArray, matrices: Sequence[Array]
) -> tuple[str, ...]:
    """Names of loop equations that springs can move and joints cannot, by one of the `matrices` of poses.

    No loop may rely on them.
    """
    for matrix in matrices if len(mechanism.elastic) else ():
        with_springs = independent_rows(matrix[-len(mechanism.rows.names) :])
        if len(with_springs) > len(independent):
            return tuple(mechanism.rows.names[row] for row in np.setdiff1d(with_springs, independent))
    return ()


def idle_columns(felt: Array, passive: IntArray) -> IntArray:
    """Passive joints to hold still because their motion moves nothing, such as a rod about its axis.

    Passive motions that neither the loops nor the platform feel, of `motion_matrix` (n + rows, n_p) at the
    reference; one joint of each is chosen by pivoting. They carry no load as long as the body that they turn
    is balanced about them; `dynamics.neglected` measures it.
    """
    if not len(passive):
        return np.empty(0, dtype=np.intp)
    values, right = np.linalg.svd(felt)[1:]
    rank = int(np.sum(values > REDUNDANT * max(float(values[0]), 1.0)))
    order = _pivots(right[rank:].T) if rank < len(right) else np.empty(0, dtype=np.intp)
    return np.sort(passive[order[: len(passive) - rank]])


def motion_matrix(mechanism: Mechanism, platform: PlatformCoordinates, q: Array) -> Array:
    """Jacobian (n + rows, nv) of the platform and all loop equations at q (nq,), without dimension."""
    moved = scaled(mechanism, platform.jacobian(frames_at(mechanism, q[None])), ~platform.translations)[0]
    return np.concatenate([moved, loop_matrix(mechanism, q)])


def _lost_rows(here: Array, nearby: Array) -> IntArray:
    """Rows that `nearby` has more in its rank than `here`, as independent of those of `here` as can be."""
    rank, now = _rank(nearby), _rank(here, CROSSED)
    if now >= rank:
        return np.empty(0, dtype=np.intp)
    kept = _pivots(here)[:now]
    span = np.linalg.qr(nearby[kept].T)[0]
    return np.sort(_pivots(nearby - nearby @ span @ span.T)[: rank - len(kept)])


def _rank(matrix: Array, level: float = REDUNDANT) -> int:
    """Number of singular values above `level` times the largest."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > level * values.max(initial=0.0)))


def _pivots(matrix: Array) -> IntArray:
    """Rows of a matrix, each the farthest from the span of those before it."""
    from scipy.linalg import qr

    return np.asarray(qr(matrix.T, mode="r", pivoting=True)[1])
