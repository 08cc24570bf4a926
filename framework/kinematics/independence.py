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
from framework.kinematics.frames import difference, frames_at
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.platform import PlatformCoordinates


def singular_reference(
    mechanism: Mechanism, platform: PlatformCoordinates, passive: IntArray, q: Array, nearby: Sequence[Array]
) -> SingularReference | None:
    """Why nothing can be decided at the reference q (nq,) once for all; None where it can.

    The loops, or the loops and the platform along the passive joints, have a lower rank there than nearby.
    """
    joints = mechanism.joints
    loops, felt = loop_matrix(mechanism, q)[:, joints], felt_matrix(mechanism, platform, passive, q)
    for other in nearby:
        rows = _lost_rows(loops, loop_matrix(mechanism, other)[:, joints])
        columns = _lost_rows(felt.T, felt_matrix(mechanism, platform, passive, other).T)
        if len(rows) or len(columns):
            return SingularReference(
                mechanism.name,
                rows=[mechanism.rows.names[k] for k in rows],
                joints=[mechanism.joint_of(int(passive[k])) for k in columns],
                poses=[_joint_angles(mechanism, pose) for pose in nearby],
            )
    return None


def independent_rows(matrix: Array) -> IntArray:
    """Ascending indices of rows that do not repeat others."""
    return np.sort(_pivots(matrix)[: _rank(matrix)])


def rows_of_springs_alone(
    mechanism: Mechanism, independent: IntArray, poses: Sequence[Array]
) -> tuple[str, ...]:
    """Names of loop equations that springs can move and joints cannot, at one of the poses (nq,).

    No loop may rely on them.
    """
    for q in poses if len(mechanism.elastic) else ():
        with_springs = independent_rows(loop_matrix(mechanism, q))
        if len(with_springs) > len(independent):
            return tuple(mechanism.rows.names[row] for row in np.setdiff1d(with_springs, independent))
    return ()


def idle_columns(felt: Array, passive: IntArray) -> IntArray:
    """Passive joints to hold still because their motion moves nothing, such as a rod about its axis.

    Passive motions that neither the loops nor the platform feel, of `felt_matrix` (n + rows, n_p) at the
    reference; one joint of each is chosen by pivoting. They carry no load as long as the body that they turn
    is balanced about them; `dynamics.neglected` measures it.
    """
    if not len(passive):
        return np.empty(0, dtype=np.intp)
    values, right = np.linalg.svd(felt)[1:]
    rank = int(np.sum(values > REDUNDANT * max(float(values[0]), 1.0)))
    order = _pivots(right[rank:].T) if rank < len(right) else np.empty(0, dtype=np.intp)
    return np.sort(passive[order[: len(passive) - rank]])


def felt_matrix(mechanism: Mechanism, platform: PlatformCoordinates, passive: IntArray, q: Array) -> Array:
    """Jacobian (n + rows, n_p) of the platform and all loop equations along the passive joints at q (nq,)."""
    moved = scaled(mechanism, platform.jacobian(frames_at(mechanism, q[None])), ~platform.translations)[0]
    return np.concatenate([moved, loop_matrix(mechanism, q)])[:, passive]


def _joint_angles(mechanism: Mechanism, q: Array) -> dict[str, float]:
    """Angles [rad, m] of all joints but springs at q (nq,)."""
    angles = difference(mechanism, mechanism.neutral, q[None])[0]
    return {mechanism.joint_of(int(column)): float(angles[column]) for column in mechanism.joints}


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
