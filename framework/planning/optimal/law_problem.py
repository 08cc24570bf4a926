"""Conditions on a law and motor torques along a path, as sparse rows on the coefficients of the law.

A law s = phi(sigma(t)) is given by its squared speed z = (d sigma/dt)^2. Its coefficients y multiply
functions of xi = stretch(sigma), which is steep at the crossings. Torques are affine in z and in
u = d2 sigma/dt2 = z'/2.

Condition (8) keeps torques finite at a crossing, and is a sparse equality on y. Where it is not met, torques
have a pole. A multiple of the condition is therefore subtracted from each torque row beside a crossing: the
row stays bounded and sparse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.torque_distribution import (
    InternalSplines,
    internal_frames,
    internal_rows,
    least_peak_torques,
)
from framework.dynamics.torque_response import TorqueResponse
from framework.laws.law import compose_derivatives
from framework.laws.optimal_law import Smoothstep
from framework.laws.path import HIGHEST_ORDER
from framework.laws.squared_speed import ONE_CELL, Instants, SpeedBasis
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import SampledDemand
from framework.planning.optimal.phase_plane import Demand, SquaredSpeed, demand
from framework.planning.request import Specification

POLE_WIDTH = 0.05  # distance in xi from a crossing within which the pole is removed from torque rows


class LawProblem(NamedTuple):
    """The search for a law: a task with conditions at `crossings`, sigma (k,).

    conditions: (k, 4), constant + per_z z + per_u u + per_du u' = 0.
    stops: sigma at which the required times of crossings, if any, must hold.
    z0: the squared speed about which damping is linearised; None leaves damping out.
    sampled: the motors' torques and speeds along the path as series, if these resolve them.
    chosen_reference: overrides the `reference` that follows from the limits.
    degree: degree of z as one Chebyshev series, as smooth as deflections need it; None for splines.
    max_squared_speed: limit of z [1/s^2]; a law that is quick at its ends shakes springs that carry inertia.
    response: the response of an elastic robot's torques to the law, in place of the rigid robot's torques.
    trust: share of the response's z by which z may differ from it.
    """

    task: Task
    crossings: Array
    conditions: Array
    stops: tuple[float, ...] = ()
    z0: SquaredSpeed | None = None
    sampled: SampledDemand | None = None
    chosen_reference: Array | None = None
    degree: int | None = None
    max_squared_speed: float = np.inf
    response: TorqueResponse | None = None
    trust: float = np.inf

    def demand(self, sigma: Array) -> Demand:
        """Compute torques and speeds of the motors at sigma (M,)."""
        phi = self.task.phi
        if self.sampled is not None:
            return self.sampled.evaluate(phi, sigma)
        return demand(self.task.branch, phi, sigma)

    def basis_on(self, cells: Array) -> SpeedBasis:
        """Return the basis of z: splines on cells (k + 1,), or a series.

        With a `degree` z is one series over the whole path, whatever the cells.
        """
        if self.degree is None:
            return SpeedBasis.from_cells(cells)
        return SpeedBasis(np.array(ONE_CELL), self.degree + 1)

    @property
    def specification(self) -> Specification:
        return self.task.specification

    def internal_frames(self, splines: InternalSplines) -> Array | None:
        """Compute frames (n, n_a, r) of internal torques at the centres of n splines; None without any.

        The r columns of a frame are an orthonormal basis of the torques that move nothing.

        Args:
            splines: on cells of xi.
        """
        if not self.specification.shares_freely or self.response is not None:
            return None
        projectors = self.demand(self.sigma(splines.centres)).internal
        assert projectors is not None
        return internal_frames(projectors, self.task.robot.n_a - self.task.robot.n)

    def least_peak(self, torques: Array, xi: Array) -> Array:
        """Return torques (M, n_a) [N m] at xi (M,), of least peak over the limits if shared freely."""
        if not self.specification.shares_freely or self.response is not None:
            return torques
        projectors = self.demand(self.sigma(xi)).internal
        assert projectors is not None
        robot = self.task.robot
        return least_peak_torques(torques, projectors, self.specification.torque_limit, robot.n_a - robot.n)

    def with_goal(self, goal: str, **changes: Any) -> LawProblem:
        """Return the problem with another goal, and other `changes` of its specification except limits.

        The reference of peaks stays the same.
        """
        task = self.task._replace(specification=replace(self.specification, goal=goal, **changes))
        return self._replace(task=task, chosen_reference=self.reference)

    @property
    def instants(self) -> Instants:
        """The required instants of crossings, and the duration if it is required."""
        return self.instants_until(self.specification.duration)

    def instants_until(self, duration: float | None) -> Instants:
        """Return the required instants of crossings, and a duration [s] unless None."""
        return Instants.of(self.stops, self.specification.times, duration)

    @property
    def stages(self) -> Array:
        """The durations (m,) [s] between required instants; the last is infinite if the end is open."""
        specification = self.specification
        end = np.inf if specification.duration is None else specification.duration
        return np.diff([0.0, *specification.times, end])

    def bound_stages(self, longest: float | None) -> Array | None:
        """Return bounds (m,) [s] of the stages in a law that takes at most `longest`; None without any."""
        bounds = self.stages
        if longest is not None:
            bounds[-1] = min(bounds[-1], longest - sum(self.specification.times[-1:]))
        return bounds if np.isfinite(bounds).any() else None

    @property
    def stop_xi(self) -> Array:
        """The parameter xi of each required instant inside the path."""
        return self.task.stretch(np.array(self.stops))

    @property
    def crossing_xi(self) -> Array:
        """The parameter xi (k,) of each condition."""
        return self.task.stretch(self.crossings)

    def sigma(self, xi: Array) -> Array:
        """Return sigma (M,) at xi; exactly 0 and 1 at the ends, free of rounding."""
        sigma = self.task.stretch.inverse(xi)
        return np.where(xi <= -1.0, 0.0, np.where(xi >= 1.0, 1.0, sigma))

    @property
    def reference(self) -> Array:
        """Torques (n_a,) [N m] that peaks are relative to: the limits.

        A motor without a limit gets the largest limit of the others; 1 if no motor has one.
        """
        if self.chosen_reference is not None:
            return self.chosen_reference
        return self.specification.reference


class MotorRows(NamedTuple):
    """Torques and squared speeds of the motors at M points of a path, affine in the n coefficients of z."""

    torque: tuple[Affine, ...]  # of each motor, (M, n) [N m]
    squared_speed: tuple[SparseRows, ...]  # (M, n) of each motor with a speed limit, over the squared limit
    internal: tuple[SparseRows, ...] = ()  # of each redundant motor, (M, n r) on coefficients x (n r,) [N m]

    def torques(self, y: Array, x: Array) -> list[Array]:
        """Compute the torque (M,) [N m] of each motor from coefficients y (n,) and x (n r,)."""
        torques = [torque(y) for torque in self.torque]
        if not self.internal:
            return torques
        return [torque + rows @ x for torque, rows in zip(torques, self.internal, strict=True)]

    def combine(self, weights: Array) -> MotorRows:
        """Return the rows weights (R, M) @ rows."""
        torque = tuple(
            Affine(SparseRows.of(weights @ matrix), weights @ offset) for matrix, offset in self.torque
        )
        others = (self.squared_speed, self.internal)
        return MotorRows(torque, *(tuple(SparseRows.of(weights @ rows) for rows in part) for part in others))

    def largest_limit_ratio(self, y: Array, x: Array, allowed: Array) -> Array:
        """Compute the largest ratio (M,) of a torque or squared speed to its limit, over all motors.

        A ratio above 1 exceeds a limit.

        Args:
            y: (n,) coefficients of z.
            x: (n r,) coefficients of internal torques [N m].
            allowed: (n_a,) torques [N m].
        """
        ratios = [np.abs(torque) / limit for torque, limit in zip(self.torques(y, x), allowed, strict=True)]
        ratios += [rows @ y for rows in self.squared_speed]
        return np.asarray(np.max(ratios, axis=0))

    def stack(self, other: MotorRows) -> MotorRows:
        """Return the rows, with the rows of `other` below."""
        torques = zip(self.torque, other.torque, strict=True)
        speeds = zip(self.squared_speed, other.squared_speed, strict=True)
        internal = zip(self.internal, other.internal, strict=True)
        return MotorRows(
            tuple(_stack_affine(upper, lower) for upper, lower in torques),
            tuple(upper.append(lower) for upper, lower in speeds),
            tuple(upper.append(lower) for upper, lower in internal),
        )


def _stack_affine(upper: Affine, lower: Affine) -> Affine:
    """Return the affine functions `upper` and `lower`, one below the other."""
    return Affine(upper.matrix.append(lower.matrix), np.append(upper.offset, lower.offset))


def motor_rows(
    problem: LawProblem, basis: SpeedBasis, conditions: Affine, xi: Array, frames: Array | None
) -> MotorRows:
    """Compute rows of torques and squared speeds at xi (M,), without poles.

    No xi is on a crossing. A torque is c + cz z + cu u with u = z'/2 = xi' (dz/dxi) / 2. Dry friction is part
    of c; damping is linearised.

    Args:
        basis: the functions of xi whose combination is z.
        conditions: rows (k, n) of the conditions on the law, which serve to remove the poles.
        frames: `LawProblem.internal_frames` on the cells of the basis.
    """
    if problem.response is not None:
        return _rows_of_response(problem.response, problem.specification, basis, xi)
    sigma = problem.sigma(xi)
    required = problem.demand(sigma)
    c, cz, cu = required.linearise_damping(None if problem.z0 is None else problem.z0(sigma))
    c = c + required.friction(problem.specification.friction)

    # z and u as rows (M, n) on the coefficients of z
    z = basis.matrix(xi)
    u = basis.matrix(xi, 1).scale(0.5 * problem.task.stretch(sigma, 1))
    # the rows of each motor, bounded beside crossings
    torques = []
    for motor_c, motor_cz, motor_cu in zip(c.T, cz.T, cu.T, strict=True):
        matrix = z.scale(motor_cz) + u.scale(motor_cu)
        torques.append(_remove_poles(Affine(matrix, motor_c), problem, conditions, xi))
    speeds = _squared_speed_rows(required.speed, problem.specification, z)
    if frames is None:
        return MotorRows(tuple(torques), speeds)
    assert required.internal is not None
    internal = InternalSplines(basis.cells).matrix(xi)
    return MotorRows(tuple(torques), speeds, internal_rows(required.internal, internal, frames))


def _rows_of_response(
    response: TorqueResponse, specification: Specification, basis: SpeedBasis, xi: Array
) -> MotorRows:
    """Compute rows of torques and squared speeds at xi (M,) from a torque response.

    With the torques T_0 of the motion at y_0 and their slopes S by y, a torque is S y + (T_0 - S y_0).

    Args:
        response: the torques linearised about a motion in balance.
        basis: the functions of xi whose combination is z.
    """
    speed = response.speed(xi)
    torque = response.torque(xi)
    slopes = response.slopes(xi).reshape(*torque.shape, -1)  # (M, n_a, n)
    offset = torque - slopes @ response.y + specification.friction * speed_signs(speed)
    motors = range(torque.shape[1])
    torques = tuple(Affine(SparseRows.of(slopes[:, j]), offset[:, j]) for j in motors)
    return MotorRows(torques, _squared_speed_rows(speed, specification, basis.matrix(xi)))


def _squared_speed_rows(speed: Array, specification: Specification, z: SparseRows) -> tuple[SparseRows, ...]:
    """Compute rows (M, n) of squared speeds over their squared limits.

    A motor without a limit has no rows.

    Args:
        speed: (M, n_a) of the motors over d sigma/dt.
        z: rows (M, n) of the squared speed (d sigma/dt)^2.
    """
    limit = specification.speed_limit
    ratios = (speed / limit)[:, np.isfinite(limit)]
    return tuple(z.scale(ratio**2) for ratio in ratios.T)


def _remove_poles(torque: Affine, problem: LawProblem, conditions: Affine, xi: Array) -> Affine:
    """Remove the poles of torque rows T (M, n) beside each crossing.

    A multiple of the conditions C is subtracted, which vanishes for laws that meet them. T - share C with
    share = T C' (C C')^-1 is orthogonal to C, the direction of the pole.

    Args:
        torque: torques of one motor [N m] at xi (M,), affine in the coefficients of z.
        conditions: rows (k, n) C on the coefficients of z, which must vanish.
    """
    C = conditions.matrix
    C_transposed = C.toarray().T  # (n, k)
    gram = C @ C_transposed  # (k, k)
    products = torque.matrix @ C_transposed  # (M, k)
    shares = np.zeros_like(products)
    for crossing in np.unique(problem.crossing_xi):
        chosen = np.flatnonzero(problem.crossing_xi == crossing)
        beside = np.flatnonzero(np.abs(xi - crossing) < POLE_WIDTH)
        left = products[beside][:, chosen] - shares[beside] @ gram[:, chosen]  # of the rows so far
        # least squares, as conditions may depend on each other
        share = np.linalg.lstsq(gram[np.ix_(chosen, chosen)], left.T, rcond=None)[0].T
        shares[np.ix_(beside, chosen)] = share
    return Affine(torque.matrix.subtract_multiples(shares, C), torque.offset - shares @ conditions.offset)


def condition_rows(problem: LawProblem, basis: SpeedBasis) -> Affine:
    """Return the conditions of a problem as rows (k, n) on the coefficients of z.

    The conditions are constant + per_z z + per_u u + per_du u' = 0 with u = z'/2 and u' = z"/2. The basis is
    in xi: dz/dsigma = xi' dz/dxi and d2z/dsigma2 = xi'^2 d2z/dxi2 + xi" dz/dxi. A torque response replaces
    the first rows, condition (8) of the undeformed robot, by those of the loaded robot. The last rows are
    those of ends in motion.
    """
    constant, per_z, per_u, per_du = problem.conditions.T
    z, z_xi, z_xi_xi = (basis.matrix(problem.crossing_xi, order) for order in range(3))
    dxi, ddxi = (problem.task.stretch(problem.crossings, order) for order in (1, 2))
    per_slope = 0.5 * per_u * dxi + 0.5 * per_du * ddxi  # per dz/dxi
    per_bend = 0.5 * per_du * dxi**2  # per d2z/dxi2
    rows = z.scale(per_z) + z_xi.scale(per_slope) + z_xi_xi.scale(per_bend)
    at_ends = _end_rows(problem, basis)
    rows = rows.append(at_ends.matrix)
    constant = np.append(constant, at_ends.offset)
    if problem.response is None:
        return Affine(rows, constant)
    loaded = problem.response.scalar_slopes  # (k, n)
    matrix = SparseRows.of(loaded).append(rows[slice(len(loaded), None)])
    return Affine(matrix, np.append(-loaded @ problem.response.y, constant[len(loaded) :]))


def _end_rows(problem: LawProblem, basis: SpeedBasis) -> Affine:
    """Return the conditions of ends in motion as rows (k, n) on the coefficients of z.

    s' ... s^(R) at such an end, where phi' > 0, determine the first R derivatives of sigma by time, and so z
    and its first R - 1 derivatives by sigma: with v = d sigma/dt, the derivatives of sigma are v, z'/2,
    v z"/2 and z'z"/4 + z z"'/2. The rows of z are those of its derivatives by xi, by the chain rule.
    """
    specification = problem.specification
    orders = min(specification.smoothness, HIGHEST_ORDER)
    rows = [np.empty((0, len(basis.matrix(np.ones(1)).toarray()[0])))]
    values = [np.empty(0)]
    ends = zip(specification.ends.moving, specification.ends.derivatives(orders), strict=True)
    for sigma, (is_moving, derivatives) in enumerate(ends):
        if not is_moving:
            continue
        at_end = np.array(float(sigma))
        by_xi = [
            basis.matrix(np.array([2.0 * sigma - 1.0]), k).toarray()[0] for k in range(orders)
        ]  # (n,) each
        xi_slopes = [problem.task.stretch(at_end, k) for k in range(1, orders)]
        matrix = np.array(compose_derivatives(by_xi, xi_slopes))  # (R, n) of z by sigma
        targets = _squared_speed_at_end(problem.task.phi, at_end, derivatives)
        sizes = np.abs(matrix).max(axis=1)
        rows.append(matrix / sizes[:, None])
        values.append(targets / sizes)
    return Affine(SparseRows.of(np.concatenate(rows)), -np.concatenate(values))


def _squared_speed_at_end(phi: Smoothstep, sigma: Array, derivatives: Array) -> Array:
    """Compute z and its derivatives (R,) by sigma at an end with derivatives (R,) of s by time, R <= 4."""
    orders = len(derivatives)
    by_sigma = [phi(sigma, k) for k in range(orders + 1)]
    rates = list[Array]()  # of sigma by time: those of phi(sigma(t)) are the given ones, one after the other
    for order, derivative in enumerate(derivatives, start=1):
        rest = compose_derivatives(by_sigma[: order + 1], [*rates, np.zeros(())])[order]
        rates.append((derivative - rest) / by_sigma[1])
    v, a, *higher = rates
    z = [v**2, 2.0 * a]
    if higher:
        z.append(2.0 * higher[0] / v)
    if len(higher) > 1:
        z.append(2.0 * (higher[1] - 0.5 * a * z[2]) / v**2)
    return np.array(z)
