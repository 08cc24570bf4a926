"""Rounding, bounded from above: what every proof in this room is computed with.

A sum of k products of computed numbers is off by at most `gamma(k)` times the sum of their moduli, and a sum
of numbers without sign is rounded up by the factor `ROUND_UP` (Rump, Verification methods, Acta Numerica 19,
2010). No rounding mode is switched: bounds hold as long as sums and products are rounded as IEEE 754 has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.numerics.arrays import Array

UNIT_ROUNDOFF = 2.0**-53
REACH_MARGIN = 1.01  # of a bound on a length, over its rounding
WIDENING_RATIO = 1.1  # of a box over what a map of it into itself needs
ROUND_UP = 1.0 + 1e-10  # more than rounding takes from a sum of some hundred numbers without sign


def gamma(terms: int) -> float:
    """Bound the relative rounding of a sum of `terms` products, eight times over.

    Relative to the sum of the moduli.
    """
    return 8 * (terms + 4) * UNIT_ROUNDOFF


def approximate_inverses(matrices: Any) -> Any:
    """Compute inverses (S, k, k) up to rounding; zero where a matrix is singular."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(matrices) == matrices.shape[1]
        inverted = np.zeros_like(matrices)
        inverted[regular] = np.linalg.inv(matrices[regular])
        return inverted


def identity_defect(inverse: Any, matrices: Any) -> Array:
    """Bound |1 - X M| entry by entry (S, k, k), rounding included.

    X is near the inverse of M. A product of complex numbers counts as two of real ones.
    """
    identity = np.eye(matrices.shape[1])
    computed = np.abs(identity - inverse @ matrices)
    products = len(identity) * (2 if np.iscomplexobj(matrices) else 1)
    return computed + gamma(products) * (np.abs(inverse) @ np.abs(matrices) + identity)
