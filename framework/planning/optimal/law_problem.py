"""Conditions on a law and motor torques along a path, as sparse rows on the coefficients of the law.

A law s = phi(sigma(t)) is given by its squared speed z = (d sigma/dt)^2. Its coefficients y multiply
functions of xi = stretch(sigma), which is steep at the crossings. Torques are affine in z and in
u = d2 sigma/dt2 = z'/2.

Condition (8), t_s . W_p = 0, keeps torques finite at a crossing, and is a sparse equality on y. Where it is
not met, torques have a pole: they grow as one over the distance from the crossing. A multiple of the
condition is therefore subtracted from each torque row beside a crossing: the row stays bounded and sparse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.torque_distribution import (
    SPLINE_DEGREE,
    internal_frames,
    internal_rows,
    least_peak_torques,
)
from framework.dynamics.torque_response import TorqueResponse
from framework.laws.law import compose_derivatives
from framework.laws.optimal_law import Smoothstep
from framework.laws.path import HIGHEST_ORDER
from framework.laws.squared_speed import Instants, SpeedBasis
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine
from framework.numerics.sparse_rows import SparseRows
from framework.numerics.splines import Splines
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import SampledDemand
from framework.planning.optimal.phase_plane import Demand, SquaredSpeed, demand
from framework.planning.request import Specification

# speeds over the no-load speed: the least and, without a law, the first about which roots of z are linearised
LEAST_TANGENT, FIRST_TANGENT = 1e-3, 0.25
POLE_WIDTH = 0.05  # distance in xi from a crossing within which the pole is removed from torque rows


class LawProblem(NamedTuple):
    """The search for a law: a task with conditions at `crossings`, sigma (k,).

    conditions: (k, 4), constant + per_z z + per_u u + per_du u' = 0.
    stops: sigma at which the required times of crossings, if any, must hold.
    z0: the squared speed about which damping and limits of drives are linearised; None leaves damping out.
        With a response, limits of drives are linearised about its z.
    average_over: time [s] over which squared torques are averaged if the duration is open and no cycle is
        stated; None leaves RMS limits out.
    sampled: the motors' torques and speeds along the path as series, if these resolve them.
    chosen_reference: overrides the `reference` that follows from the limits.
    degree: degree of z as one Chebyshev series, as smooth as deflections need it; None for splines.
    max_squared_speed: limit of z [1/s^2]; a law that is quick at its ends shakes springs that carry inertia.
    response: the response of an elastic robot's torques to the law, in place of the rigid robot's torques.
    """

    task: Task
    crossings: Array
    conditions: Array
    stops: tuple[float, ...] = ()
    z0: SquaredSpeed | None = None
    average_over: float | None = None
    sampled: SampledDemand | None = None
    chosen_reference: Array | None = None
    degree: int | None = None
    max_squared_speed: float = np.inf
    response: TorqueResponse | None = None

    def demand(self, sigma: Array) -> Demand:
        """Compute torques and speeds of the motors at sigma (M,)."""
        phi = self.task.phi
        if self.sampled is not None:
            return self.sampled.evaluate(phi, sigma)
        return demand(self.task.branch, phi, sigma)

    @property
    def specification(self) -> Specification:
        return self.task.specification

    def internal_frames(self, cells: Array) -> Array | None:
        """Compute frames (n, n_a, r) of internal torques at centres of n splines, if any.

        The r columns of a frame are an orthonormal basis of the torques that move nothing. The splines are on
        cells of xi with edges (k + 1,).
        """
        if not self.specification.shares_freely:
            return None
        centres = Splines.on_cells(cells, SPLINE_DEGREE).centres
        projectors = self.demand(self.sigma(centres)).internal
        assert projectors is not None
        return internal_frames(projectors, self.task.robot.n_a - self.task.robot.n)

    def least_peak(self, torques: Array, xi: Array) -> Array:
        """Return torques (M, n_a) [N m] at xi (M,), of least peak over the limits if shared freely."""
        if not self.specification.shares_freely:
            return torques
        projectors = self.demand(self.sigma(xi)).internal
        assert projectors is not None
        robot = self.task.robot
        return least_peak_torques(torques, projectors, self.specification.torque_limit, robot.n_a - robot.n)

    def with_goal(self, goal: str, **changes: Any) -> LawProblem:
        """Return the problem with another goal and other `changes` of its specification.

        The reference of peaks stays the same.
        """
        task = self.task._replace(specification=replace(self.specification, goal=goal, **changes))
        return self._replace(task=task, chosen_reference=self.reference)

    @property
    def averaging_time(self) -> float | None:
        """The time [s] over which squared torques are averaged; None if open, before a law."""
        return self.stated_time or self.average_over

    @property
    def stated_time(self) -> float | None:
        """The time [s] of a cycle or of the motion; None if open."""
        drives = self.specification.drives
        cycle_time = None if drives is None else drives.cycle_time
        return cycle_time or self.specification.duration

    @property
    def averages_open_duration(self) -> bool:
        """Whether squared torques are averaged over a duration that is open."""
        drives = self.specification.drives
        has_rms = drives is not None and bool(np.isfinite(drives.rms_torque_limit).any())
        return has_rms and self.stated_time is None

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
    curve: tuple[Affine, ...] = ()  # (M, n) of each motor with a torque-speed curve, 1 on the curve

    def torques(self, y: Array, x: Array) -> list[Array]:
        """Compute the torque (M,) [N m] of each motor from coefficients y (n,) and x (n r,)."""
        torques = [torque(y) for torque in self.torque]
        if not self.internal:
            return torques
        return [torque + rows @ x for torque, rows in zip(torques, self.internal, strict=True)]

    def combine(self, weights: Array) -> MotorRows:
        """Return the rows weights (R, M) @ rows."""
        torque, curve = [
            [Affine(SparseRows.of(weights @ matrix), weights @ offset) for matrix, offset in rows]
            for rows in (self.torque, self.curve)
        ]
        squared_speed, internal = [
            [SparseRows.of(weights @ rows) for rows in part] for part in (self.squared_speed, self.internal)
        ]
        return MotorRows(tuple(torque), tuple(squared_speed), tuple(internal), tuple(curve))

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
        ratios += [curve(y) for curve in self.curve]
        return np.asarray(np.max(ratios, axis=0))

    def stack(self, other: MotorRows) -> MotorRows:
        """Return the rows, with the rows of `other` below."""
        return MotorRows(
            tuple(map(_stack_affine, self.torque, other.torque)),
            tuple(map(SparseRows.append, self.squared_speed, other.squared_speed)),
            tuple(map(SparseRows.append, self.internal, other.internal)),
            tuple(map(_stack_affine, self.curve, other.curve)),
        )


def _stack_affine(upper: Affine, lower: Affine) -> Affine:
    """Return the affine functions `upper` and `lower`, one below the other."""
    return Affine(upper.matrix.append(lower.matrix), np.append(upper.offset, lower.offset))


def motor_rows(
    problem: LawProblem, basis: SpeedBasis, conditions: Affine, xi: Array, frames: Array | None
) -> MotorRows:
    """Compute rows of torques and squared speeds at xi (M,), none on a crossing.

    A torque is c + cz z + cu u with u = z'/2 = xi' (dz/dxi) / 2. Dry friction is part of c; damping and
    torque-speed curves are linearised. c, cz and cu are infinite at a crossing; multiples of the conditions
    remove this pole from the rows beside it. With a `response`, rows are those of an elastic robot.

    Args:
        basis: the n functions of xi whose combination is z.
        conditions: rows (k, n) of the conditions on the law, which serve to remove the poles.
        frames: `LawProblem.internal_frames` on the cells of the basis.
    """
    if problem.response is not None:
        return _rows_of_response(problem, problem.response, basis, xi)
    sigma = problem.sigma(xi)
    required = problem.demand(sigma)  # torques, speeds over d sigma/dt, and internal torques of the motors
    z0 = problem.z0 if problem.z0 is not None and problem.task.robot.is_damped else None
    c, cz, cu = required.torque.with_damping(required.damping, None if z0 is None else z0(sigma))
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
        if problem.specification.drives is None:
            return MotorRows(tuple(torques), speeds)
        curves = _curve_rows(problem, torques, required.speed, z, sigma)
        return MotorRows(tuple(torques), speeds, curve=curves)
    assert required.internal is not None  # of motors without curves
    internal = Splines.on_cells(basis.cells, SPLINE_DEGREE).matrix(xi)
    return MotorRows(tuple(torques), speeds, internal_rows(required.internal, internal, frames))


def _rows_of_response(
    problem: LawProblem, response: TorqueResponse, basis: SpeedBasis, xi: Array
) -> MotorRows:
    """Compute rows of torques and squared speeds at xi (M,) from a torque response.

    With the torques T_0 of the motion at y_0 and their slopes S by y, a torque is S y + (T_0 - S y_0).
    """
    specification = problem.specification
    torque, slopes, speed = response.evaluate_motors(xi)  # (M, n_a), (M, n_a, n), (M, n_a)
    offset = torque - slopes @ response.y + specification.friction * speed_signs(speed)
    motors = range(torque.shape[1])
    torques = tuple(Affine(SparseRows.of(slopes[:, j]), offset[:, j]) for j in motors)
    z = basis.matrix(xi)
    curves = _curve_rows(problem, torques, speed, z, problem.sigma(xi))
    return MotorRows(torques, _squared_speed_rows(speed, specification, z), curve=curves)


def _squared_speed_rows(speed: Array, specification: Specification, z: SparseRows) -> tuple[SparseRows, ...]:
    """Compute rows (M, n) of squared speeds over their squared limits.

    Speeds (M, n_a) are over d sigma/dt, z has rows (M, n). A motor without a limit has no rows.
    """
    limit = specification.speed_limit
    ratios = (speed / limit)[:, np.isfinite(limit)]
    return tuple(z.scale(ratio**2) for ratio in ratios.T)


def _curve_rows(
    problem: LawProblem, torques: Sequence[Affine], speed: Array, z: SparseRows, sigma: Array
) -> tuple[Affine, ...]:
    """Compute rows (M, n) of (k T + w) / w_0 for motors with a torque-speed curve, T > 0 along w.

    The speed w = |q'| sqrt(z) is concave in z, so that its tangent (w_t + w^2 / w_t) / 2 at any w_t > 0 is no
    less: laws within the rows are within the curve. w_t is the speed at the squared speed z0. Up to the
    corner speed the torque limit implies the curve, so that w_t need not be less than that.

    Args:
        torques: of all motors [N m], affine in the coefficients of z.
        speed: (M, n_a) of the motors over d sigma/dt.
        z: rows (M, n) of the squared speed (d sigma/dt)^2.
        sigma: (M,) of the points.
    """
    drives = problem.specification.drives
    if drives is None:
        return ()
    z0 = None if problem.z0 is None else problem.z0(sigma)  # (M,)
    if problem.response is not None:
        z0 = np.maximum(z @ problem.response.y, np.finfo(float).tiny)
    curves = []
    for k in np.flatnonzero(drives.has_curve).tolist():
        no_load = drives.no_load_speed[k]
        tangent_at = np.full(len(sigma), FIRST_TANGENT * no_load)
        if z0 is not None:
            tangent_at = np.maximum(np.abs(speed[:, k]) * np.sqrt(z0), LEAST_TANGENT * no_load)
        tangent_at = np.maximum(tangent_at, drives.corner_speed[k])
        per_torque = drives.per_torque[k] * np.where(speed[:, k] < 0.0, -1.0, 1.0)
        torque = torques[k]
        squared_speed = z.scale(0.5 * speed[:, k] ** 2 / (tangent_at * no_load))
        matrix = torque.matrix.scale(per_torque) + squared_speed
        curves.append(Affine(matrix, per_torque * torque.offset + 0.5 * tangent_at / no_load))
    return tuple(curves)


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
    the first rows, t_s . W_p = 0 of the undeformed robot, by those of the loaded robot. The last rows are
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

    The derivatives s' ... s^(R) by time at such an end, where phi' > 0, determine R derivatives of sigma by
    time, and so z and its first R - 1 derivatives by sigma. R is the number of derivatives that torques
    contain; a series has as many as are stated, if these are more. The rows of z are those of its derivatives
    by xi = stretch(sigma), in [-1, 1], by the chain rule.
    """
    specification = problem.specification
    n = basis.matrix(np.ones(1)).shape[1]
    rows, values = [np.empty((0, n))], [np.empty(0)]
    for sigma, stated in enumerate(specification.ends):  # the start at sigma = 0, the goal at sigma = 1
        if not stated:  # at rest
            continue
        R = min(specification.smoothness, HIGHEST_ORDER)
        if not basis.is_spline:
            R = max(R, len(stated))
        at_end = np.array(float(sigma))
        xi = np.array([2.0 * sigma - 1.0])
        by_xi = [basis.matrix(xi, order).toarray()[0] for order in range(R)]  # (n,) each
        xi_slopes = [problem.task.stretch(at_end, order) for order in range(1, R)]
        matrix = np.array(compose_derivatives(by_xi, xi_slopes))  # (R, n) of z by sigma
        derivatives = specification.ends.derivatives(R)[sigma]  # (R,) s' ... s^(R)
        targets = _squared_speed_at_end(problem.task.phi, at_end, derivatives)  # (R,) of z by sigma
        rows.append(matrix)
        values.append(targets)
    return Affine(SparseRows.of(np.concatenate(rows)), -np.concatenate(values))


def _squared_speed_at_end(phi: Smoothstep, sigma: Array, derivatives: Array) -> Array:
    """Compute z and its derivatives (R,) by sigma at an end with derivatives (R,) of s by time.

    The derivatives of s = phi(sigma(t)) give those of sigma one after the other, these those of u = z'/2 by
    sigma: the derivative of order k of u(sigma(t)), that of order k + 2 of sigma, contains v^k u^(k).
    """
    by_sigma = [phi(sigma, k) for k in range(len(derivatives) + 1)]
    rates = list[Array]()  # of sigma by time
    for order, derivative in enumerate(derivatives, start=1):
        rest = compose_derivatives(by_sigma[: order + 1], [*rates, np.zeros(())])[order]
        rates.append((derivative - rest) / by_sigma[1])
    v = rates[0]
    u = list[Array]()
    for order, rate in enumerate(rates[1:]):
        rest = compose_derivatives([*u, np.zeros(())], rates[:order])[order]
        u.append((rate - rest) / v**order)
    return np.array([v**2, *(2.0 * value for value in u)])
