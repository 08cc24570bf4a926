"""Bases of the range of an overconstrained loop Jacobian, smooth and with one orientation.

R rows of rank m < R have a range of dimension m that turns with the pose. A determinant of m chosen rows is
one coordinate of this range and vanishes at poses where nothing happens. Combinations U'J with an orthonormal
basis U (R, m) of the range have no such poses: they lose rank only where J does.

The sign of a determinant of U'J depends on the orientation of U. det U'J_p / det [X ; U'J] is a positive
multiple of det (dq_a/dx), with the platform's rows X, whatever U. So U is oriented by the Type 1 matrix
[X ; U'J]: its determinant is positive. Then det U'J_p has the sign of det (dq_a/dx), at each pose by itself.
"""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array


def oriented_bases(J: Array, X: Array, row_space: Array, q: Array) -> Array:
    """Compute orthonormal bases U (T, R, m) of the ranges of J (T, R, k), oriented by Type 1.

    A stack in which all poses are near their neighbours is a sequence and has one orientation. So a
    determinant changes its sign where a sequence passes a singularity of its loops smoothly.

    Args:
        J, X: (T, R, k) and (T, n, k) dimensionless rows of loops and platform along the moving joints.
        row_space: (k, m) basis V of the row space at the reference, with J V orthonormal.
        q: (T, nq) the poses.
    """
    largest_step = 0.5  # [rad, m] between neighbours of a sequence of poses
    least_overlap = 0.5  # det U_1'U_2 of neighbours
    least_share = 0.1
    # Gram-Schmidt of J V, where V is the row space at the reference if it serves the whole stack, else that
    # of the middle pose. J V loses rank where the loops allow a motion in V: singular vectors serve there
    m = row_space.shape[1]
    U, share = _positive_qr(J @ row_space)
    if share.min(initial=1.0) < least_share:
        U, share = _positive_qr(J @ row_space_basis(J[len(J) // 2], m))
        lost = share < least_share
        U[lost] = np.linalg.svd(J[lost], full_matrices=False)[0][:, :, :m]
    square = np.concatenate([X, U.swapaxes(1, 2) @ J], axis=1)  # (T, n + m, k) Type 1
    if not len(U) or square.shape[1] != square.shape[2]:
        return U
    sign, size = np.linalg.slogdet(square)
    if len(U) > 1 and np.abs(q[1:] - q[:-1]).max() < largest_step:
        overlap = np.linalg.det(U[1:].swapaxes(1, 2) @ U[:-1])  # (T - 1,)
        if np.abs(overlap).min() > least_overlap:
            along = np.cumprod(np.sign(np.append(1.0, overlap)))
            sign = along * (along * sign)[size.argmax()]
    U[:, :, -1] *= np.where(sign < 0.0, -1.0, 1.0)[:, None]
    return U


def align_bases(J: Array, bases: Array) -> Array:
    """Compute bases U (T, R, m) of the ranges of J (T, R, k) nearest to `bases` (..., R, m).

    J J' maps the nearby basis into the range and keeps its orientation. Gram-Schmidt makes U upper triangular
    with a positive diagonal in that basis, so U is a smooth function of J, and the basis itself in its range.
    """
    spanning, _ = np.linalg.qr(J @ (J.swapaxes(1, 2) @ bases))
    return np.asarray(spanning @ _positive_qr(spanning.swapaxes(1, 2) @ bases)[0])


def relative_orientation(start: Array, end: Array) -> Array:
    """Return the signs (T,) of det U_1'U_2 of bases (T, R, m) of neighbours: 1 if they turn alike."""
    return np.asarray(np.sign(np.linalg.det(start.swapaxes(1, 2) @ end)))


def row_space_basis(J: Array, m: int) -> Array:
    """Compute V (k, m), a basis of the row space of J (R, k) of rank m, for which J V is orthonormal."""
    _, values, V_rows = np.linalg.svd(J)
    return np.asarray(V_rows[:m].T / values[:m])


def _positive_qr(matrices: Array) -> tuple[Array, Array]:
    """Return the factor Q of matrices (T, r, m) and the least diagonal entry (T,) of R, made positive."""
    Q, R = np.linalg.qr(matrices)
    diagonal = np.diagonal(R, axis1=1, axis2=2)  # (T, m)
    signs = np.where(diagonal < 0.0, -1.0, 1.0)
    return Q * signs[:, None, :], np.abs(diagonal).min(axis=1, initial=np.inf)
