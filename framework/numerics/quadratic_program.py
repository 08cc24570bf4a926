"""Small dense quadratic programs with many rows, by an interior-point method.

    minimise  x'P x / 2 + c'x    subject to    A x = b,   G x <= h

Each step eliminates the slacks s = h - G x and the multipliers z of the rows: P + G' diag(z / s) G is of the
size of x, however many rows there are. Predictor and corrector: Mehrotra, SIAM J. Optim. 2 (1992).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.time_limit import check_time


class QuadraticProgram(NamedTuple):
    """A program in x (n,) with k equalities and m inequalities; rows of size 1 or so."""

    P: Array  # (n, n) positive definite
    c: Array  # (n,)
    A: Array  # (k, n)
    b: Array  # (k,)
    G: Array  # (m, n)
    h: Array  # (m,)


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # of rows that contradict each other
def solve_quadratic_program(
    program: QuadraticProgram,
    *,
    tolerance: float = 1e-7,  # of rows, and of gap and gradient over the cost's
    stalled_tolerance: float = 1e-5,  # of the best iterate, where rounding hides the gradient
    max_steps: int = 40,
    kept_share: float = 0.99,  # of the step at which a slack or a multiplier vanishes
) -> Array | None:
    """Compute the x (n,) of least cost; None if the method does not converge, as without a solution.

    Multipliers of active rows grow without bound beside their slacks: past the accuracy that rounding allows,
    errors grow again, and the best iterate counts.
    """
    check_time()
    P, c, A, b, G, h = program
    n, k = len(c), len(b)
    x, y, s, z = np.zeros(n), np.zeros(k), np.maximum(h, 1.0), np.ones(len(h))
    best, least_error = x, np.inf
    for _ in range(max_steps):
        # residuals, which vanish at the solution, and the duality gap s'z
        gradient = P @ x + c + G.T @ z + A.T @ y  # (n,)
        excess = G @ x + s - h  # (m,)
        unequal = A @ x - b  # (k,)
        gap = float(s @ z)
        cost = float(c @ x + 0.5 * x @ (P @ x))
        errors = (
            np.abs(unequal).max(initial=0.0),
            np.abs(excess).max(initial=0.0),
            np.abs(gradient).max() / (1.0 + np.abs(c).max()),
            gap / (1.0 + abs(cost)),
        )
        error = float(np.max(errors))  # not a number after an overflow, and then not the least
        if error < least_error:
            best, least_error = x, error
        if least_error <= tolerance or not gap > np.finfo(float).eps:
            break
        # with ds = -excess - G dx and s dz + z ds = target - s z
        weight = z / s  # (m,)
        system = np.block([[P + (G.T * weight) @ G, A.T], [A, np.zeros((k, k))]])
        ds = dz = np.zeros(len(h))
        target = np.zeros(len(h))
        for is_corrector in (False, True):
            if is_corrector:
                share = min(_longest(s, ds), _longest(z, dz), 1.0)
                reached = float((s + share * ds) @ (z + share * dz))
                target = (reached / gap) ** 3 * gap / len(h) - ds * dz
            dz_at_s = target / s - z  # dz without a change of s
            right = np.append(-gradient - G.T @ (dz_at_s + weight * excess), -unequal)
            try:
                step = np.linalg.solve(system, right)
            except np.linalg.LinAlgError:
                return best if least_error <= stalled_tolerance else None
            ds = -excess - G @ step[:n]
            dz = dz_at_s - weight * ds
        share = min(1.0, kept_share * min(_longest(s, ds), _longest(z, dz)))
        x, y = x + share * step[:n], y + share * step[n:]
        s, z = s + share * ds, z + share * dz
    return best if least_error <= stalled_tolerance else None


def _longest(values: Array, changes: Array) -> float:
    """Return the largest share of the changes (m,) with which positive values (m,) are not negative."""
    falls = changes < 0.0
    return float((values[falls] / -changes[falls]).min(initial=np.inf))
