"""Proof that a cone program has no solution, and what it is worth in floating point (Farkas' lemma).

Source: Boyd and Vandenberghe, Convex Optimization (2004), section 5.8, theorems of alternatives.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from framework.arrays import Array, IntArray
from framework.tolerances import MIN_PROOF_REACH


class Infeasible(NamedTuple):
    """A proof that no x is admissible, A x + s = b, s in the cone K: q in K's dual, A' q = 0, b' q < 0."""

    proof: Array
    matrix: Any  # A
    right: Array  # b
    cones: tuple[int, ...]  # sizes of second-order cones, the last rows of A; the rest of K is nonnegative
    equalities: int = 0  # the first rows of A, where s is zero and q of either sign

    @property
    def contradiction(self) -> tuple[float, float]:
        """Largest entry of A' q, and b' q, with q of largest entry 1.

        The first is rounding, the second well below zero: for any x in the program, b' q = (b - A x)' q
        would be at least zero, since b - A x is in the cone and q in its dual.
        """
        proof = self.proof / np.abs(self.proof).max()
        return float(np.abs(self.matrix.T @ proof).max()), float(self.right @ proof)

    @property
    def reach(self) -> float:
        """The proof rules out all x whose entries are less than this: b' q + |A' q|_1 max|x| < 0."""
        left = float(np.abs(self.matrix.T @ self.proof).sum())
        return float(-self.right @ self.proof) / max(left, np.finfo(float).tiny)

    @property
    def holds(self) -> bool:
        """Whether q is in the dual of K, which is K itself, and rules out all x up to MIN_PROOF_REACH."""
        if not np.isfinite(self.proof).all():
            return False
        linear, heads, lengths = self._in_cones()
        rounding = np.finfo(float).eps * np.array(self.cones)  # of lengths, sums of as many terms
        inside = (linear >= 0.0).all() and (heads >= (1.0 - rounding) * lengths).all()
        return bool(inside and self.reach > MIN_PROOF_REACH)

    def refined(self) -> Infeasible:
        """Return the proof with A' q = 0 to rounding, q changed least over its distance from the cone's edge.

        An interior-point solver stops at 1e-8 of that, which is much where the limits are off by far.
        """
        if not np.isfinite(self.proof).all():
            return self
        linear, heads, lengths = self._in_cones()
        inside = np.concatenate([linear, np.repeat(heads - lengths, self.cones)])
        inside = np.concatenate([np.full(self.equalities, inside.max(initial=1.0)), inside])
        rows = self.matrix.multiply(inside[:, None]).T
        combined = np.linalg.lstsq((rows @ rows.T).toarray(), self.matrix.T @ self.proof, rcond=None)[0]
        return self._replace(proof=self.proof - inside * (rows.T @ combined))

    def _in_cones(self) -> tuple[Array, Array, Array]:
        """Return the entries of q not to be negative, of its cones the first ones and the others' lengths."""
        sizes = np.array(self.cones, dtype=int)
        bounds = [self.equalities, len(self.proof) - int(sizes.sum())]
        _, linear, others = np.split(self.proof, bounds)
        starts: IntArray = np.cumsum(sizes) - sizes
        squares = others**2
        squares[starts] = 0.0
        return linear, others[starts], np.sqrt(np.add.reduceat(squares, starts))
