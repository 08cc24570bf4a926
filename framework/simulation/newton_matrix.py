"""Newton's matrix of a collocation step, with the loops and their forces eliminated node by node.

The unknowns of a step are the changes of q at its nodes, dq = h^2 A A da, which is h A dv:

    M da + D dv + K dq - J' dlambda = -force        J dq = -residual

with D and K the derivatives of the force by v and q. At each node J' = Q R: what the loops ask of dq is
Q R'^-1 of the residual, the rest lies in the null space Z of J, and Z' frees the balance of dlambda. What is
left to factorise has s (nv - m) rows in place of s (nv + m): 48 in place of 528 for a Delta robot at s = 16.
Source: Benzi, Golub and Liesen 2005, "Numerical solution of saddle point problems", Acta Numerica 14,
DOI 10.1017/S0962492904000212, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array


@dataclass(frozen=True, eq=False)
class NewtonMatrix:
    """The factorised matrix of a step of length h [s] with s nodes."""

    length: float
    rates: Array  # (s, s) inverse of the table's A
    by_motion: Array  # (s, nv, 3 nv) derivatives of the force by a, v and q
    onto: Array  # (s, nv, m) a right inverse of J
    free: Array  # (s, nv, nv - m) null space of J
    factors: tuple[Array, Array]

    @staticmethod
    def of(length: float, rates: Array, by_motion: Array, jacobian: Array) -> NewtonMatrix | None:
        """Factorise for loops with a jacobian (s, m, nv); None where the equations are singular."""
        from scipy.linalg.lapack import dgetrf

        s, m, nv = jacobian.shape
        Q, R = np.linalg.qr(jacobian.transpose(0, 2, 1), mode="complete")
        try:
            onto = Q[:, :, :m] @ np.linalg.inv(R[:, :m]).transpose(0, 2, 1)
        except np.linalg.LinAlgError:
            return None
        free = Q[:, :, m:]
        rows = (free.transpose(0, 2, 1) @ by_motion).reshape(-1, 3 * nv)
        columns = free.transpose(1, 0, 2).reshape(nv, -1)
        shape = (s, nv - m, s, nv - m)
        matrix = (rates @ rates)[:, None, :, None] * (rows[:, :nv] @ columns).reshape(shape)
        matrix += (length * rates)[:, None, :, None] * (rows[:, nv : 2 * nv] @ columns).reshape(shape)
        nodes = np.arange(s)
        matrix[nodes, :, nodes] += length**2 * (rows[:, 2 * nv :].reshape(s, -1, nv) @ free)
        *factors, singular = dgetrf(matrix.reshape(len(rows), -1))
        if singular:
            return None
        return NewtonMatrix(length, rates, by_motion, onto, free, (factors[0], factors[1]))

    def solve(self, force: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Return the changes of q (s, nv), accelerations (s, nv) and multipliers (s, m).

        Args:
            force: what is missing from the balance of forces, (s, nv).
            residual: the loop equations, (s, m).
        """
        from scipy.linalg.lapack import dgetrs

        dq = -np.matvec(self.onto, residual)
        missing = force + np.matvec(self.by_motion, self._motion(dq))
        unbalanced = np.matvec(self.free.transpose(0, 2, 1), missing)
        along = dgetrs(*self.factors, -(self.length**2) * unbalanced.ravel())[0]
        dq += np.matvec(self.free, along.reshape(unbalanced.shape))
        motion = self._motion(dq)
        multipliers = np.matvec(self.onto.transpose(0, 2, 1), force + np.matvec(self.by_motion, motion))
        return dq, motion[:, : dq.shape[1]], multipliers

    def _motion(self, dq: Array) -> Array:
        """Return the changes of a, v and q (s, 3 nv) for one of q (s, nv)."""
        rate = self.rates @ dq / self.length
        return np.concatenate([self.rates @ rate / self.length, rate, dq], axis=1)
