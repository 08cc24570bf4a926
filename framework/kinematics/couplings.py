"""Couplings of joints: polynomials in the joints' coordinates, with exact derivatives.

A coupling row (`LoopRows.coupled`) is p(z) = 0 in the coordinates z of K joints, each of one freedom, so that
dz/dt are entries of v. With p_k, p_kl the derivatives along z_k and z_l, the row of the Jacobian is p_k, its
time derivatives are p_kl v_l and p_kl a_l + p_kln v_l v_n, and the drift of the row is v_k p_kl v_l.
"""

from __future__ import annotations

import numpy as np

from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, BoolArray


def coupling_derivatives(rows: LoopRows, q: Array, order: int) -> Array:
    """Compute derivatives (T, c, K, ..., K) of an order of c couplings at q (T, nq).

    The order 0 gives the residuals (T, c) [rad, m]. The derivative of a term along z_k has the exponent of
    z_k as a factor, and an exponent that is one less.
    """
    coefficients, exponents = rows.coefficients[rows.coupled], rows.exponents[rows.coupled]
    unit = np.eye(exponents.shape[2], dtype=int)[:, None]  # (K, 1, K)
    for _ in range(order):
        coefficients = np.moveaxis(coefficients[..., None] * exponents, -1, -2)  # (c, ..., K, M)
        exponents = np.maximum(exponents[..., None, :, :] - unit, 0)  # (c, ..., K, M, K)
    z = q[:, rows.places[rows.coupled]]  # (T, c, K)
    axes = range(2, 3 + order)  # of the derivatives, and of the M terms
    products = np.prod(np.expand_dims(z, tuple(axes)) ** exponents, axis=-1)  # (T, c, ..., M)
    return np.sum(coefficients * products, axis=-1)


def coupling_jacobian(rows: LoopRows, q: Array, nv: int) -> Array:
    """Compute derivatives (T, m, nv) of couplings along velocities at q (T, nq); 0 in other rows."""
    return _scatter_slopes(rows, coupling_derivatives(rows, q, 1), nv)


def coupling_jacobian_rates(rows: LoopRows, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Compute two time derivatives (T, m, nv) of `coupling_jacobian` at q (T, nq), v and a (T, nv)."""
    columns = rows.columns[rows.coupled]
    dz, ddz = v[:, columns], a[:, columns]  # (T, c, K)
    second = coupling_derivatives(rows, q, 2)
    rate = np.einsum("tckl,tcl->tck", second, dz)
    rate_of_rate = np.einsum("tckl,tcl->tck", second, ddz)
    rate_of_rate += np.einsum("tckln,tcl,tcn->tck", coupling_derivatives(rows, q, 3), dz, dz)
    nv = v.shape[1]
    return _scatter_slopes(rows, rate, nv), _scatter_slopes(rows, rate_of_rate, nv)


def coupling_drift(rows: LoopRows, q: Array, v: Array) -> Array:
    """Compute second time derivatives (T, c) of couplings at q (T, nq) and constant rates v (T, nv)."""
    dz = v[:, rows.columns[rows.coupled]]  # (T, c, K)
    return np.einsum("tck,tckl,tcl->tc", dz, coupling_derivatives(rows, q, 2), dz)


def coupling_force_changes(rows: LoopRows, q: Array, multipliers: Array, motions: Array) -> Array:
    """Compute changes (T, k, nv) of the forces of couplings by motions (T, k, nv).

    `multipliers` (T, m) of all rows are constant.
    """
    dz = motions[..., rows.columns[rows.coupled]]  # (T, k, c, K)
    weighted = multipliers[:, rows.coupled, None, None] * coupling_derivatives(rows, q, 2)
    slopes = np.einsum("tcij,tkcj->tkci", weighted, dz)
    return _scatter_slopes(rows, slopes, motions.shape[2]).sum(axis=2)


def coupling_pattern(rows: LoopRows, nv: int) -> BoolArray:
    """Return whether a row is a coupling that depends on the joint of a column, (m, nv)."""
    degrees = (rows.coefficients != 0.0)[..., None] * rows.exponents  # (m, M, K)
    return _scatter_slopes(rows, degrees[rows.coupled].sum(axis=1).astype(float), nv) > 0.0


def _scatter_slopes(rows: LoopRows, slopes: Array, nv: int) -> Array:
    """Return slopes (..., c, K) of c couplings by K joints each as matrices (..., m, nv) of all m rows.

    Rows that are no couplings are zero. A coupling of fewer than K joints repeats one with the slope 0.
    """
    result = np.zeros((*slopes.shape[:-2], len(rows.names), nv))
    coupled = np.flatnonzero(rows.coupled)  # (c,)
    for k in range(slopes.shape[-1]):
        joint = rows.columns[coupled, k]  # (c,) the k-th joint of each coupling
        result[..., coupled, joint] += slopes[..., k]
    return result
