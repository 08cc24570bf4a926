"""One step of collocation on the equations of motion and the loop equations themselves.

The tables are computed, not copied. Radau IIA of s stages: nodes are the zeros of
P_s(2c - 1) - P_{s-1}(2c - 1), the last one the end of the step. Order 2s - 1 at the end of a step, s along
it; free motions that a step does not resolve decay (L-stable), and a coordinate without inertia is solved
for, not integrated.

At every node the unknowns are all accelerations a (nv,) and multipliers lambda (m,):

    M a + c + g + K (q - rest) + D v - S' n tau - f - J' lambda = 0        F(q) = 0

with f the forces of the world, v = v0 + h A a and q = q0 moved by h A v. The loops are closed at the nodes,
and the last node is the end of the step: there is no drift. Nothing is divided by the mass matrix, so
coordinates without mass are found from the balance of their springs in the same solve. Newton's method with
all derivatives but the curvature of rotations with several degrees of freedom.

Newton's matrix has the loops and their forces eliminated node by node (`NewtonMatrix`). Its unknowns are the
changes of q at the nodes, dq = h^2 A A da, which is h A dv:

    M da + D dv + K dq - J' dlambda = -force        J dq = -residual

with D and K the derivatives of the force by v and q. At each node J' = Q R: what the loops ask of dq is
Q R'^-1 of the residual, the rest lies in the null space Z of J, and Z' frees the balance of dlambda. What is
left to factorise has s (nv - m) rows in place of s (nv + m): 48 in place of 528 for a Delta robot at s = 16.

Sources: Hairer and Wanner, Solving Ordinary Differential Equations II, Springer 1996, sections IV.5 and VI;
Benzi, Golub and Liesen 2005, "Numerical solution of saddle point problems", Acta Numerica 14, DOI
10.1017/S0962492904000212, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from framework.kinematics.frame_variations import loop_curvature
from framework.kinematics.frames import difference_rates, integrate
from framework.numerics.arrays import LEAST_DIVISOR, Array, ReadOnlyArrays
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion, Tangent

MAX_ITERATIONS = 12  # of Newton's method
REFACTORING_RATE = 0.02  # a contraction better than this keeps the factorised matrix
COORDINATE_ROUNDING = 1e-15  # of a coordinate: Newton's steps shrink no further
MAX_NEWTON_STEP = 3.0  # [rad, lengths] that a Newton step may not move a joint
# of steps [rad, lengths] that lead nowhere
DIVERGENCE_RATE, DIVERGENCE_STEP = 2.0, 1e-8
MAX_SLOPE_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Collocation(ReadOnlyArrays):
    """A table: `nodes` c (s,) in (0, 1], `once` A (s, s), its inverse, and Legendre series of values."""

    nodes: Array
    once: Array  # integrals from 0 to each node of the polynomial through values at the nodes
    rates: Array  # inverse of `once`
    series: Array  # (s, s) values at the nodes to Legendre coefficients on [0, 1]
    series_with_start: Array  # (s + 1, s + 1) the same with the value at 0 in front
    series_of_integral: Array  # (s + 1, s) values at the nodes to coefficients of their integral from 0

    @property
    def stages(self) -> int:
        return len(self.nodes)

    def basis(self, c: Array, degree: int | None = None) -> Array:
        """Compute Legendre polynomials (T, degree + 1), degree s by default, at points c (T,) in [0, 1]."""
        return np.asarray(legendre.legvander(2 * c - 1, self.stages if degree is None else degree))


@lru_cache(maxsize=32)
def radau_table(stages: int) -> Collocation:
    """Compute the table of Radau IIA with s stages.

    The inner nodes are the zeros of the Jacobi polynomial P_(s-1)^(1,0), which times (1 - x) is
    P_(s-1) - P_s. All else follows from Legendre polynomials in x = 2 c - 1.
    """
    from scipy.special import roots_jacobi

    inner = roots_jacobi(stages - 1, 1.0, 0.0)[0] if stages > 1 else np.empty(0)
    nodes = np.append((inner + 1) / 2, 1.0)
    x = 2 * nodes - 1
    series = np.linalg.inv(legendre.legvander(x, stages - 1))  # (s, s) values to coefficients
    of_integral = legendre.legint(np.eye(stages), lbnd=-1, scl=0.5, axis=0) @ series  # (s + 1, s)
    once = legendre.legvander(x, stages) @ of_integral  # (s, s) values to integrals from 0
    with_start = np.linalg.inv(legendre.legvander(np.append(-1.0, x), stages))
    rates = np.asarray(np.linalg.inv(once), dtype=float)
    return Collocation(nodes, once, rates, series, with_start, of_integral)


@dataclass(frozen=True, eq=False)
class CollocationStep(ReadOnlyArrays):
    """A step from `time` over `length` [s]: values at its nodes, the last one at its end."""

    table: Collocation
    time: float
    length: float
    start: Array  # (nq,)
    start_velocity: Array  # (nv,)
    q: Array  # (s, nq)
    v: Array  # (s, nv)
    a: Array  # (s, nv)
    multipliers: Array  # (s, m)
    slope: Array  # (s, nv) rate of the tangent offset from `start`; v itself where all joints are lines
    power: Array  # (s,) of the motors and the world [W]
    iterations: int
    unresolved: float  # next coefficient of the motion's series [rad, robot lengths]

    @property
    def times(self) -> Array:
        return self.time + self.length * self.table.nodes


def solve_step(
    equations: EquationsOfMotion,
    drive: Drive,
    table: Collocation,
    *,
    time: float,
    length: float,
    q0: Array,
    v0: Array,
    guess: tuple[Array, Array],
    accuracy: float,
) -> CollocationStep | str:
    """Solve a step by Newton's method from guesses of accelerations (s, nv) and multipliers (s, m).

    Returns:
        The step, its last correction below `accuracy` [rad, robot lengths]; or in words why there is none.
    """
    step = _StepEquations(equations, drive, table, time, length, q0, v0)
    a, multipliers = guess
    accuracy = accuracy + COORDINATE_ROUNDING * float(np.abs(q0).max())
    matrix = None  # to be factored anew
    last_size, slope = np.inf, np.zeros_like(a)
    for iteration in range(1, MAX_ITERATIONS + 1):
        balance = step.balance(a, multipliers, slope)
        slope, residual = balance.slope, balance.tangent.residual
        if not (np.all(np.isfinite(balance.force)) and np.all(np.isfinite(residual))):
            return "not finite"
        if matrix is None:
            matrix = step.newton_matrix(balance.tangent, multipliers)
            if matrix is None:
                return "singular equations"
        change, a_change, multiplier_change = matrix.solve(balance.force, residual)
        size = float(np.abs(change / equations.robot.column_scale).max())
        if not size < MAX_NEWTON_STEP:
            return "Newton steps too far"
        a, multipliers = a + a_change, multipliers + multiplier_change
        rate = size / last_size if last_size > 0 else 0.0
        # corrections that fall by `rate` each sum up to size rate / (1 - rate)
        if size <= accuracy or (iteration > 1 and rate < 0.5 and size * rate / (1 - rate) <= accuracy):
            return step.solution(a, multipliers, balance, iteration)
        if iteration > 2 and rate > DIVERGENCE_RATE and size > DIVERGENCE_STEP:
            return "Newton diverges"
        if rate > REFACTORING_RATE:
            matrix = None
        last_size = size
    return "Newton does not converge"


class _Balance(NamedTuple):
    """The equations of a step at an iterate."""

    slope: Array  # (s, nv) see `CollocationStep`
    torque: Array  # (s, n_a)
    tangent: Tangent
    force: Array  # (s, nv) residual of the balance of forces


@dataclass(frozen=True, eq=False)
class _StepEquations:
    """The equations of one step from (q0, v0) over `length` [s]."""

    equations: EquationsOfMotion
    drive: Drive
    table: Collocation
    time: float
    length: float
    q0: Array  # (nq,)
    v0: Array  # (nv,)

    @cached_property
    def times(self) -> Array:
        """The instants (s,) of the nodes [s]."""
        return self.drive.shift_breaks(self.time + self.length * self.table.nodes)

    @cached_property
    def torque(self) -> Array | None:
        """Torques (s, n_a) of time alone; None with feedback."""
        return self.drive.torques_without_feedback(self.times)

    def nodes(self, a: Array, slope: Array) -> tuple[Array, Array, Array]:
        """Compute q (s, nq), v (s, nv) and the slope (s, nv) for accelerations a (s, nv)."""
        integral = self.length * self.table.once
        v = self.v0 + integral @ a
        slope = self._slope(v, slope)
        return integrate(self.equations.robot, self.q0, integral @ slope), v, slope

    def _slope(self, v: Array, guess: Array) -> Array:
        """Compute the rate (s, nv) of the offset from q0 for velocities v.

        The offset is a tangent vector at q0. Only balls need iterations: there the rate depends on the
        offset, its own integral.
        """
        robot = self.equations.robot
        if not robot.has_balls:
            return v
        slope = guess if guess.any() else v
        for _ in range(MAX_SLOPE_ITERATIONS):
            q = integrate(robot, self.q0, self.length * self.table.once @ slope)
            next_slope = difference_rates(robot, self.q0, q, v)
            change = np.abs(next_slope - slope).max()
            slope = next_slope
            if change <= COORDINATE_ROUNDING * max(np.abs(v).max(), LEAST_DIVISOR):
                break
        return slope

    def balance(self, a: Array, multipliers: Array, slope: Array) -> _Balance:
        """Evaluate the equations at accelerations (s, nv) and multipliers (s, m)."""
        q, v, slope = self.nodes(a, slope)
        equations, world = self.equations, self.drive.world
        torque = self.drive(self.times, q, v) if self.torque is None else self.torque
        tangent = equations.tangent(q, v, a)
        force = equations.motor_forces(torque)
        if world.acts:
            force += world(equations.robot, self.times, q)
            tangent = tangent._replace(by_q=tangent.by_q - world.slope(equations.robot, self.times, q))
        loop_forces = np.einsum("smi,sm->si", tangent.jacobian, multipliers)  # J' lambda
        force = tangent.force - force - loop_forces
        return _Balance(slope, torque, tangent, force)

    def newton_matrix(self, tangent: Tangent, multipliers: Array) -> NewtonMatrix | None:
        """Return Newton's matrix; None where the equations are singular.

        The force depends on q through the tree and springs, the curvature of the loops under their
        multipliers (s, m), and a feedback, on v through the tree, dampers and the feedback.
        """
        robot, rows = self.equations.robot, self.equations.rows
        by_q = tangent.by_q - loop_curvature(robot, rows, tangent.frames, multipliers)
        by_v = tangent.by_v.copy()
        gains = self.drive.gains(self.time, self.q0, self.v0)
        if gains is not None:
            by_q[:, robot.actuated] -= robot.gear_ratio[:, None] * gains[0]
            by_v[:, robot.actuated] -= robot.gear_ratio[:, None] * gains[1]
        by_motion = np.concatenate([tangent.mass, by_v, by_q], axis=2)
        return NewtonMatrix.of(self.length, self.table.rates, by_motion, tangent.jacobian)

    def solution(self, a: Array, multipliers: Array, balance: _Balance, iterations: int) -> CollocationStep:
        """Return the step with its power and the unresolved part."""
        robot = self.equations.robot
        q, v, slope = self.nodes(a, balance.slope)
        power = np.vecdot(robot.gear_ratio * balance.torque, v[:, robot.actuated])  # (s,)
        power += np.vecdot(self.drive.world(robot, self.times, q), v)
        return CollocationStep(
            self.table,
            self.time,
            self.length,
            self.q0,
            self.v0,
            q,
            v,
            a,
            multipliers,
            slope,
            power,
            iterations,
            self._unresolved_part(slope),
        )

    def _unresolved_part(self, slope: Array) -> float:
        """Estimate the first Legendre coefficient that the step leaves out [rad, robot lengths].

        The last pair of coefficients is extrapolated by its ratio to the last but one; pairs, since a motion
        may be even or odd.
        """
        series = np.abs(self.table.series @ slope) / self.equations.robot.column_scale
        last = float(series[-2:].max())
        fall = min(1.0, last / max(float(series[-4:-2].max(initial=0.0)), LEAST_DIVISOR))
        return self.length * last * fall / (2 * self.table.stages)


@dataclass(frozen=True, eq=False)
class NewtonMatrix:
    """The factorised matrix of a step of length h [s] with s nodes."""

    length: float
    rates: Array  # (s, s) inverse of the table's A
    by_motion: Array  # (s, nv, 3 nv) derivatives of the force by a, v and q
    right_inverse: Array  # (s, nv, m) of J: Q R'^-1
    Z: Array  # (s, nv, nv - m) null space of J
    factors: tuple[Array, Array]

    @staticmethod
    def of(length: float, rates: Array, by_motion: Array, jacobian: Array) -> NewtonMatrix | None:
        """Factorise for loops with a jacobian (s, m, nv); None where the equations are singular."""
        from scipy.linalg.lapack import dgetrf

        s, m, nv = jacobian.shape
        Q, R = np.linalg.qr(jacobian.transpose(0, 2, 1), mode="complete")
        try:
            right_inverse = Q[:, :, :m] @ np.linalg.inv(R[:, :m]).transpose(0, 2, 1)  # (s, nv, m)
        except np.linalg.LinAlgError:
            return None
        Z, f = Q[:, :, m:], nv - m  # (s, nv, f)
        # Z_i' M_i, Z_i' D_i and Z_i' K_i of all nodes i below one another, (s f, nv) each
        by_a, by_v, by_q = np.split((Z.transpose(0, 2, 1) @ by_motion).reshape(s * f, 3 * nv), 3, axis=1)
        all_Z = Z.transpose(1, 0, 2).reshape(nv, s * f)  # Z_j of all nodes j side by side
        # block (i, j) of the matrix: Z_i' (M_i (A^-1 A^-1)_ij + h D_i (A^-1)_ij + h^2 K_i 1_ij) Z_j
        matrix = (rates @ rates)[:, None, :, None] * (by_a @ all_Z).reshape(s, f, s, f)
        matrix += (length * rates)[:, None, :, None] * (by_v @ all_Z).reshape(s, f, s, f)
        matrix[range(s), :, range(s)] += length**2 * (by_q.reshape(s, f, nv) @ Z)
        *factors, singular = dgetrf(matrix.reshape(s * f, s * f))
        if singular:
            return None
        return NewtonMatrix(length, rates, by_motion, right_inverse, Z, (factors[0], factors[1]))

    def solve(self, force: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Return the changes of q (s, nv), accelerations (s, nv) and multipliers (s, m).

        dq = -(right inverse of J) residual + Z z, with z from the balance of forces along Z; the multipliers
        balance what remains across.

        Args:
            force: residual of the balance of forces, (s, nv).
            residual: the loop equations, (s, m).
        """
        from scipy.linalg.lapack import dgetrs

        dq = -np.matvec(self.right_inverse, residual)
        unbalanced = force + np.matvec(self.by_motion, self._motion_change(dq))
        along_Z = np.matvec(self.Z.transpose(0, 2, 1), unbalanced)
        z = dgetrs(*self.factors, -(self.length**2) * along_Z.ravel())[0]
        dq += np.matvec(self.Z, z.reshape(along_Z.shape))
        motion = self._motion_change(dq)
        unbalanced = force + np.matvec(self.by_motion, motion)
        multipliers = np.matvec(self.right_inverse.transpose(0, 2, 1), unbalanced)
        return dq, motion[:, : dq.shape[1]], multipliers

    def _motion_change(self, dq: Array) -> Array:
        """Return the changes of a, v and q (s, 3 nv) for a change of q (s, nv)."""
        rate = self.rates @ dq / self.length
        return np.concatenate([self.rates @ rate / self.length, rate, dq], axis=1)
