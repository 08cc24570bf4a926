"""One collocation step of the equations of motion with their loop equations (Radau IIA).

The tables are computed here, not copied. Radau IIA with s stages has its nodes at the zeros of
P_s(2c - 1) - P_{s-1}(2c - 1). The last node is the end of the step. The order is 2s - 1 at the end of a step
and s along it. The method is L-stable: free motions that a step does not resolve decay. A coordinate without
inertia is solved for, not integrated.

The unknowns at every node are all accelerations a (nv,) and multipliers lambda (R,):

    M a + c + g + K (q - rest) + D v - S' n tau - f - J' lambda = 0        F(q) = 0

with the external forces f, the velocities v = v0 + h A a, and q integrated from q0 by h A v. Here h [s] is
the length of the step, and A is the matrix of the table that integrates values at the nodes. The loops are
closed at all nodes, and the last node is the end of the step, so they do not drift. The mass matrix is never
inverted, so coordinates without mass follow from the balance of their springs in the same solution. Newton's
method uses all derivatives except the curvature of joints with several rotations.

The loops and their forces are eliminated from Newton's matrix node by node (`NewtonMatrix`). The matrix to
factorise has s (nv - m) rows instead of s (nv + m): 48 instead of 528 for a Delta robot with s = 16.

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

from framework.kinematics.closures import loop_curvature
from framework.kinematics.frames import difference_rates, integrate
from framework.numerics.arrays import LEAST_DIVISOR, Array, ReadOnlyArrays
from framework.simulation.consistent_states import MAX_ITERATIONS
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion, State, Tangent, singular_vectors
from framework.tolerances import NEWTON_STEP

COORDINATE_ROUNDING = 1e-15  # share of a coordinate, or of its motion in a step, that is rounding


@dataclass(frozen=True, eq=False)
class Collocation(ReadOnlyArrays):
    """The nodes of a collocation method with s stages, and matrices that act on values at the nodes.

    The values (s,) at the nodes define a polynomial p on the step [0, 1].
    """

    nodes: Array  # c (s,) in (0, 1]
    integration: Array  # A (s, s): from the values to the integrals of p from 0 to each node
    differentiation: Array  # A^-1 (s, s)
    to_series: Array  # (s, s) from the values to the Legendre coefficients of p
    to_series_with_start: Array  # (s + 1, s + 1) the same for a value at 0 followed by those at the nodes
    to_integral_series: Array  # (s + 1, s) from the values to the coefficients of the integral of p from 0

    @property
    def stages(self) -> int:
        """Number s of nodes."""
        return len(self.nodes)

    def basis(self, c: Array, degree: int | None = None) -> Array:
        """Compute Legendre polynomials (T, degree + 1) on [0, 1] at points c (T,); degree s by default."""
        return np.asarray(legendre.legvander(2 * c - 1, self.stages if degree is None else degree))


@lru_cache(maxsize=32)
def radau_table(stages: int) -> Collocation:
    """Compute the table of Radau IIA with s = `stages`.

    The nodes other than the end are the zeros of the Jacobi polynomial P_(s-1)^(1,0), since
    (1 - x) P_(s-1)^(1,0) is P_(s-1) - P_s. The matrices follow from Legendre polynomials in x = 2 c - 1,
    which is -1 at the start of the step and 1 at its end.
    """
    from scipy.special import roots_jacobi

    inner = np.empty(0)  # (s - 1,) zeros of the Jacobi polynomial
    if stages > 1:
        inner, _ = roots_jacobi(stages - 1, 1.0, 0.0)
    x = np.append(inner, 1.0)

    # Vandermonde matrices map coefficients to values at points, so their inverses map values to coefficients
    to_series = np.linalg.inv(legendre.legvander(x, stages - 1))
    to_series_with_start = np.linalg.inv(legendre.legvander(np.append(-1.0, x), stages))

    # coefficients of the integrals of all Legendre polynomials; dc = dx / 2
    integrals_of_basis = legendre.legint(np.eye(stages), lbnd=-1, scl=0.5, axis=0)  # (s + 1, s)
    to_integral_series = integrals_of_basis @ to_series
    integration = legendre.legvander(x, stages) @ to_integral_series
    return Collocation(
        nodes=(x + 1) / 2,
        integration=integration,
        differentiation=np.asarray(np.linalg.inv(integration)),
        to_series=to_series,
        to_series_with_start=to_series_with_start,
        to_integral_series=to_integral_series,
    )


@dataclass(frozen=True, eq=False)
class CollocationStep(ReadOnlyArrays):
    """The solution of a step from `time` over `length` [s] at its s nodes; the last node is its end."""

    table: Collocation
    time: float
    length: float
    start: Array  # (nq,)
    start_velocity: Array  # (nv,)
    q: Array  # (s, nq)
    v: Array  # (s, nv)
    a: Array  # (s, nv)
    multipliers: Array  # (s, R) of the loop equations
    # (s, nv) rate of the tangent offset q - start, at the nodes; equals v if the robot has no balls
    offset_rate: Array
    power: Array  # (s,) of the motors and the external wrenches [W]
    iterations: int  # of Newton's method
    unresolved: float  # estimate of the first Legendre coefficient left out [rad, robot lengths]

    @property
    def end(self) -> float:
        """The instant of the end [s]."""
        return self.time + self.length


class StepFailed(Exception):
    """Newton's method finds no solution of a step; the message says why."""


class _Balance(NamedTuple):
    """The equations of a step, evaluated at an iterate."""

    offset_rate: Array  # (s, nv) rate of the tangent offset from the start of the step
    torque: Array  # (s, n_a) [N m], motor side
    tangent: Tangent
    force: Array  # (s, nv) residual of the balance of forces [N m, N]


@dataclass(frozen=True, eq=False)
class StepEquations:
    """The equations of one step from `start` at `time` over `length` [s]."""

    equations: EquationsOfMotion
    drive: Drive
    table: Collocation
    time: float
    length: float
    start: State

    def solve(self, a: Array, multipliers: Array, accuracy: float) -> CollocationStep:
        """Solve by Newton's method from guesses of accelerations (s, nv) and multipliers (s, R).

        Args:
            accuracy: bound on the error that the last Newton step leaves [rad, robot lengths].

        Raises:
            StepFailed: Newton's method does not converge, or meets a singular matrix.
        """
        refactoring_rate = 0.02  # ratio of Newton steps above which the matrix is factorised anew
        accuracy = accuracy + COORDINATE_ROUNDING * float(np.abs(self.start.q).max())
        matrix = None  # factorised before the first step, and again where steps shrink too slowly
        last_newton_step = np.inf
        offset_rate = np.zeros_like(a)
        for iteration in range(1, MAX_ITERATIONS + 1):
            balance = self._balance(a, multipliers, offset_rate)
            offset_rate = balance.offset_rate
            residual = balance.tangent.residual
            if not (np.all(np.isfinite(balance.force)) and np.all(np.isfinite(residual))):
                raise StepFailed("not finite")
            if matrix is None:
                matrix = self._newton_matrix(balance.tangent, multipliers)

            q_change, a_change, multiplier_change = matrix.solve(balance.force, residual)
            # the largest change of a coordinate [rad, robot lengths]
            newton_step = float(np.abs(q_change / self.equations.robot.column_scale).max())
            a = a + a_change
            multipliers = multipliers + multiplier_change

            # the error that is left: at most the size of the step while the convergence is not yet known
            rate = newton_step / last_newton_step if last_newton_step > 0 else 0.0
            error = newton_step
            if iteration > 1 and rate < 0.5:  # later steps shrink by `rate`; their sum is a geometric series
                error = newton_step * rate / (1 - rate)
            if error <= accuracy:
                return self._solution(a, multipliers, balance, iteration)

            # steps that double in size diverge, unless they are rounding; the first two may still grow
            if iteration > 2 and rate > 2.0 and newton_step > NEWTON_STEP:
                raise StepFailed("Newton diverges")
            if rate > refactoring_rate:
                matrix = None
            last_newton_step = newton_step
        raise StepFailed("Newton does not converge")

    @cached_property
    def times(self) -> Array:
        """The instants (s,) of the nodes [s], moved off breaks by `Drive.shift_breaks`."""
        return self.drive.shift_breaks(self.time + self.length * self.table.nodes)

    @cached_property
    def torque(self) -> Array | None:
        """Motor torques (s, n_a) that depend on time alone; None with feedback."""
        return self.drive.torques_without_feedback(self.times)

    def _integrate_to_nodes(self, a: Array, rate_guess: Array) -> tuple[Array, Array, Array]:
        """Integrate accelerations a (s, nv) at the nodes to velocities and configurations.

        Args:
            rate_guess: (s, nv) guess of the rate of the tangent offset, refined by fixed-point iteration.

        Returns:
            Configurations (s, nq); velocities (s, nv); rates (s, nv) of the tangent offset from the start.
        """
        integration = self.length * self.table.integration
        v = self.start.v + integration @ a
        offset_rate = self._offset_rate(v, rate_guess)
        q = integrate(self.equations.robot, self.start.q, integration @ offset_rate)
        return q, v, offset_rate

    def _offset_rate(self, v: Array, guess: Array) -> Array:
        """Compute the rate (s, nv) of the tangent offset from the start for velocities v (s, nv).

        Without balls the rate is v. With balls the rate depends on the offset, which is the integral of the
        rate. So it is computed by fixed-point iteration from a `guess`, or from v if the guess is zero.
        """
        robot = self.equations.robot
        q0 = self.start.q
        if not robot.has_balls:
            return v
        rate = guess if guess.any() else v
        for _ in range(MAX_ITERATIONS):
            q = integrate(robot, q0, self.length * self.table.integration @ rate)
            next_rate = difference_rates(robot, q0, q, v)
            change = np.abs(next_rate - rate).max()
            rate = next_rate
            if change <= COORDINATE_ROUNDING * max(np.abs(v).max(), LEAST_DIVISOR):
                break
        return rate

    def _balance(self, a: Array, multipliers: Array, rate_guess: Array) -> _Balance:
        """Evaluate the equations at accelerations a (s, nv) and multipliers (s, m) at the nodes.

        From `rate_guess` (s, nv), `_offset_rate` iterates to the rate of the tangent offset from the start.
        """
        q, v, offset_rate = self._integrate_to_nodes(a, rate_guess)
        equations = self.equations
        world = self.drive.world
        torque = self.drive(self.times, q, v) if self.torque is None else self.torque
        tangent = equations.tangent(q, v, a)  # left side of the equations and loop Jacobian, linearised
        applied = equations.motor_forces(torque)
        if world.acts:
            applied += world(equations.robot, self.times, q, v)
            world_by_q = world.slope(equations.robot, self.times, tangent.frames)
            tangent = tangent._replace(by_q=tangent.by_q - world_by_q)
        loop_forces = np.einsum("smi,sm->si", tangent.jacobian, multipliers)  # J' lambda
        return _Balance(offset_rate, torque, tangent, tangent.force - applied - loop_forces)

    def _newton_matrix(self, tangent: Tangent, multipliers: Array) -> NewtonMatrix:
        """Factorise Newton's matrix at the terms `tangent` and multipliers (s, m) of the nodes.

        The force depends on q through the tree, springs, feedback and the curvature of the loops under their
        multipliers. It depends on v through the tree, dampers and feedback.

        Raises:
            StepFailed: the matrix is singular.
        """
        robot = self.equations.robot
        by_q = tangent.by_q - loop_curvature(robot, self.equations.rows, tangent.frames, multipliers)
        by_v = tangent.by_v.copy()
        gains = self.drive.gains(self.time, *self.start)
        if gains is not None:
            gains_q, gains_v = robot.gear_ratio[:, None] * gains  # (n_a, nv) each, joint side
            by_q[:, robot.actuated] -= gains_q
            by_v[:, robot.actuated] -= gains_v
        world_gains = self.drive.world.gains(robot, self.time, *self.start)
        if world_gains is not None:
            by_q, by_v = by_q - world_gains[0], by_v - world_gains[1]
        by_motion = np.concatenate([tangent.mass, by_v, by_q], axis=2)  # (s, nv, 3 nv)
        try:
            return NewtonMatrix.of(
                self.length, self.table.differentiation, by_motion, tangent.jacobian, rank=self.equations.rank
            )
        except np.linalg.LinAlgError:
            raise StepFailed("singular equations") from None

    def _solution(self, a: Array, multipliers: Array, balance: _Balance, iterations: int) -> CollocationStep:
        """Return the solution of the step, with the power [W] and the estimate of the unresolved part.

        The estimate is the first Legendre coefficient of the tangent offset that the step leaves out. It is
        extrapolated from those of the offset's rate: from the largest of the last pair, by its ratio to the
        largest of the previous pair. Pairs are compared because every other coefficient of an even or odd
        motion vanishes.

        Args:
            a, multipliers: accelerations (s, nv) and multipliers (s, m) at the nodes.
            balance: the equations at the last iterate but one.
        """
        robot = self.equations.robot
        q, v, offset_rate = self._integrate_to_nodes(a, balance.offset_rate)
        drives = self.equations.motor_forces(balance.torque) + self.drive.world(robot, self.times, q, v)
        magnitudes = np.abs(self.table.to_series @ offset_rate) / robot.column_scale  # (s, nv)
        last = float(magnitudes[-2:].max())
        previous = float(magnitudes[-4:-2].max(initial=0.0))
        first_omitted = last * min(1.0, last / max(previous, LEAST_DIVISOR))  # of the offset's rate
        return CollocationStep(
            table=self.table,
            time=self.time,
            length=self.length,
            start=self.start.q,
            start_velocity=self.start.v,
            q=q,
            v=v,
            a=a,
            multipliers=multipliers,
            offset_rate=offset_rate,
            power=np.vecdot(drives, v),
            iterations=iterations,
            # integration over the step divides the coefficient of P_s by about 2 s
            unresolved=self.length * first_omitted / (2 * self.table.stages),
        )


@dataclass(frozen=True, eq=False)
class NewtonMatrix:
    """Newton's matrix of a step of length h [s], reduced to the null space of J and factorised.

    Its unknowns are the changes dq at the nodes, with dq = h A dv = h^2 A A da:

        M da + D dv + K dq - J' dlambda = -force        J dq = -residual

    D and K are the derivatives of the force by v and q. At each node J' = Q R; if J has R > m rows, its
    pseudo-inverse stands for Q R'^-1.
    """

    length: float
    differentiation: Array  # (s, s) A^-1 of the table
    by_motion: Array  # (s, nv, 3 nv) derivatives of the force by a, v and q, side by side
    right_inverse: Array  # (s, nv, R) Q R'^-1 of J
    Z: Array  # (s, nv, nv - m) null space of J
    lu: Array  # (s (nv - m), s (nv - m)) LU factors, as LAPACK stores them
    pivots: Array  # (s (nv - m),) row exchanges of the LU factors

    @staticmethod
    def of(
        length: float, differentiation: Array, by_motion: Array, jacobian: Array, *, rank: int
    ) -> NewtonMatrix:
        """Factorise the matrix, multiplied by h^2.

        With M, D, K the derivatives of the force by a, v, q and A of the table, block (i, j) of the matrix
        is Z_i' (M_i (A^-1 A^-1)_ij + h D_i (A^-1)_ij + h^2 K_i 1_ij) Z_j for the nodes i and j.

        Args:
            length: h [s].
            differentiation: A^-1 (s, s).
            by_motion: M, D, K side by side, (s, nv, 3 nv).
            jacobian: J (s, R, nv) of the loop equations, of this `rank`.

        Raises:
            numpy.linalg.LinAlgError: the equations are singular.
        """
        from scipy.linalg.lapack import dgetrf

        right_inverse, Z = _eliminate_loops(jacobian, rank)
        s, nv, f = Z.shape  # f = nv - m

        # Z_i' M_i, Z_i' D_i and Z_i' K_i of all nodes i below one another, (s f, nv) each
        reduced = (Z.transpose(0, 2, 1) @ by_motion).reshape(s * f, 3 * nv)
        ZM, ZD, ZK = np.split(reduced, 3, axis=1)
        all_Z = Z.transpose(1, 0, 2).reshape(nv, s * f)  # Z_j of all nodes j side by side

        blocks = (s, f, s, f)  # axes: node i, motion of Z_i, node j, motion of Z_j
        matrix = (differentiation @ differentiation)[:, None, :, None] * (ZM @ all_Z).reshape(blocks)
        matrix += (length * differentiation)[:, None, :, None] * (ZD @ all_Z).reshape(blocks)
        matrix[range(s), :, range(s)] += length**2 * (ZK.reshape(s, f, nv) @ Z)  # diagonal blocks

        lu, pivots, is_singular = dgetrf(matrix.reshape(s * f, s * f))
        if is_singular:
            raise np.linalg.LinAlgError("singular matrix")
        return NewtonMatrix(length, differentiation, by_motion, right_inverse, Z, lu, pivots)

    def solve(self, force: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Compute the Newton step of q, accelerations and multipliers at the s nodes.

        The change of q is dq = -J^+ residual + Z z with the Jacobian J of the loops at each node: the first
        part closes the loops, and the balance of forces along the null space Z of J determines z. The
        multipliers balance the remaining forces, which are orthogonal to Z. Forces change with the changes of
        acceleration, velocity and q, which all follow from dq.

        Args:
            force: residual of the balance of forces, (s, nv).
            residual: residual of the loop equations, (s, R).

        Returns:
            The changes of q (s, nv), as tangent vectors, of accelerations (s, nv), and of multipliers (s, R).
        """
        from scipy.linalg.lapack import dgetrs

        # close the loops, then balance the forces along Z
        dq = -np.matvec(self.right_inverse, residual)
        unbalanced = force + np.matvec(self.by_motion, self._motion_change(dq))
        along_Z = np.matvec(self.Z.transpose(0, 2, 1), unbalanced)  # (s, nv - m)
        z, _ = dgetrs(self.lu, self.pivots, -(self.length**2) * along_Z.ravel())  # of the matrix times h^2
        dq += np.matvec(self.Z, z.reshape(along_Z.shape))

        # balance the remaining forces by the multipliers
        motion = self._motion_change(dq)
        unbalanced = force + np.matvec(self.by_motion, motion)
        multipliers = np.matvec(self.right_inverse.transpose(0, 2, 1), unbalanced)
        return dq, motion[:, : dq.shape[1]], multipliers

    def _motion_change(self, dq: Array) -> Array:
        """Return the changes of a, v and q, side by side (s, 3 nv), for a change dq (s, nv)."""
        dv = self.differentiation @ dq / self.length
        da = self.differentiation @ dv / self.length
        return np.concatenate([da, dv, dq], axis=1)


def _eliminate_loops(jacobian: Array, m: int) -> tuple[Array, Array]:
    """Compute the right inverse and the null space of J (s, R, nv) of rank m.

    Returns:
        Q R'^-1, or the pseudo-inverse if R > m, (s, nv, R); an orthonormal basis Z (s, nv, nv - m).
    """
    if jacobian.shape[1] > m:
        U, values, V_rows = singular_vectors(jacobian, m)
        inverse = (V_rows[:, :m].transpose(0, 2, 1) / values[:, None]) @ U.transpose(0, 2, 1)
        return inverse, V_rows[:, m:].transpose(0, 2, 1)
    Q, R = np.linalg.qr(jacobian.transpose(0, 2, 1), mode="complete")
    right_inverse = Q[:, :, :m] @ np.linalg.inv(R[:, :m]).transpose(0, 2, 1)
    return right_inverse, Q[:, :, m:]
