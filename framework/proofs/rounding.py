"""Upper bounds on rounding errors, for all proofs of this package.

A computed sum of k products has an error of at most `gamma(k)` times the sum of their moduli. A computed sum
of non-negative numbers, times `ROUND_UP`, is at least the exact sum (Rump, Verification methods, Acta
Numerica 19, 2010). No rounding mode is switched; the bounds hold if sums and products are rounded as in IEEE
754.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.numerics.arrays import Array

UNIT_ROUNDOFF = np.finfo(float).eps / 2
WIDENING_RATIO = 1.1  # of a box to the image of the box tested before
ROUND_UP = 1.0 + 1e-10  # outweighs the rounding of a sum of some hundred non-negative numbers


def gamma(terms: int) -> float:
    """Bound the rounding of a sum of `terms` products, relative to the sum of their moduli.

    The bound counts four more terms, for the operations around the sum, and has a margin of 8.
    """
    return 8 * (terms + 4) * UNIT_ROUNDOFF


def approximate_inverses(matrices: Any) -> Any:
    """Compute inverses (S, k, k) of real or complex matrices up to rounding; zero for a singular matrix."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(matrices) == matrices.shape[1]
        inverted = np.zeros_like(matrices)
        inverted[regular] = np.linalg.inv(matrices[regular])
        return inverted


def identity_defect(inverse: Any, matrices: Any) -> Array:
    """Bound |1 - X M| entry by entry (S, k, k), rounding included.

    X (S, k, m) is near the inverse, or the pseudo-inverse, of M (S, m, k). A complex product counts as two
    real ones.
    """
    m, k = matrices.shape[1:]
    identity = np.eye(k)
    defect = np.abs(identity - inverse @ matrices)
    products = 2 * m if np.iscomplexobj(matrices) else m
    return defect + gamma(products) * (np.abs(inverse) @ np.abs(matrices) + identity)
