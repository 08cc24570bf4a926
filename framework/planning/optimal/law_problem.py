"""The conditions of a law along a path, and the demand on the motors, as sparse rows on its coefficients.

Condition (8) is a sparse equality. Torques have a pole where it is not met. So beside a crossing a multiple
of the condition is subtracted from each torque row, which stays bounded and sparse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.torque_response import TorqueResponse
from framework.laws.speed_basis import ONE_CELL, SpeedBasis
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.phase_plane import Demand, SquaredSpeed, demand
from framework.planning.optimal.sampled_demand import SampledDemand
from framework.planning.specification import Specification

POLE_WIDTH = 0.05  # in xi, beside a crossing, where rows are freed of their pole


class LawProblem(NamedTuple):
    """The task of a law, with conditions at `crossings` sigma (k,).

    conditions: (k, 4), constant + per_z z + per_u u + per_du u' = 0.
    z0: the squared speed about which damping is linearised, if any.
    sampled: the demand along the path, if it was resolved.
    chosen_reference: the `reference`, where that is not made of the limits.
    degree: of z as one Chebyshev series, which deflections need; None for splines.
    max_squared_speed: of z [1/s^2]; a law that is quick at its ends shakes springs that carry inertia.
    response: of the torques of an elastic robot to the law.
    """

    task: Task
    crossings: Array
    conditions: Array
    z0: SquaredSpeed | None = None
    sampled: SampledDemand | None = None
    chosen_reference: Array | None = None
    degree: int | None = None
    max_squared_speed: float = np.inf
    response: TorqueResponse | None = None

    def demand(self, sigma: Array) -> Demand:
        """Compute torques and speeds of the motors at sigma (M,)."""
        task = self.task
        if self.sampled is not None:
            return self.sampled.evaluate(task.phi, sigma)
        return demand(task.branch, task.phi, sigma)

    def basis_on(self, cells: Array) -> SpeedBasis:
        """Return the basis of z: splines on cells (k + 1,), or a series."""
        if self.degree is None:
            return SpeedBasis.from_cells(cells)
        return SpeedBasis(np.array(ONE_CELL), self.degree + 1)

    @property
    def specification(self) -> Specification:
        return self.task.specification

    def with_goal(self, goal: str, **changes: Any) -> LawProblem:
        """Return the problem with another goal and other changes of its specification but limits."""
        task = self.task._replace(specification=replace(self.specification, goal=goal, **changes))
        return self._replace(task=task, chosen_reference=self.reference)

    @property
    def crossing_xi(self) -> Array:
        """The parameter xi (k,) at which each condition holds."""
        return self.task.stretch(self.crossings)

    def sigma(self, xi: Array) -> Array:
        """Return sigma (M,) at xi, the ends exact."""
        sigma = self.task.stretch.inverse(xi)
        return np.where(xi <= -1.0, 0.0, np.where(xi >= 1.0, 1.0, sigma))

    @property
    def reference(self) -> Array:
        """Torques (n_a,) [N m] that peaks are relative to.

        The limits; of a motor without one the largest limit; 1 where no motor has a limit.
        """
        if self.chosen_reference is not None:
            return self.chosen_reference
        limit = self.specification.torque_limit
        limited = np.isfinite(limit)
        return np.where(limited, limit, limit[limited].max(initial=0.0) or 1.0)


class MotorRows(NamedTuple):
    """Torques and squared speeds of the motors at M points of the path.

    They are affine in the n coefficients of z.
    """

    torque: tuple[Affine, ...]  # of each motor, (M, n) [N m]
    squared_speed: tuple[Any, ...]  # of each motor with a speed limit, over the squared limit: (M, n)

    def combine(self, weights: Any) -> MotorRows:
        """Return the rows weights (R, M) @ rows."""
        torque = tuple(Affine(weights @ matrix, weights @ offset) for matrix, offset in self.torque)
        return MotorRows(torque, tuple(weights @ matrix for matrix in self.squared_speed))

    def used_share(self, y: Array, allowed: Array) -> Array:
        """Compute the largest use (M,) of a motor's limits.

        It is that of torque, or of squared speed, over the limit.

        Args:
            y: (n,) coefficients of z.
            allowed: (n_a,) torques [N m].
        """
        shares = [np.abs(torque(y)) / limit for torque, limit in zip(self.torque, allowed, strict=True)]
        shares += [rows @ y for rows in self.squared_speed]
        return np.asarray(np.max(shares, axis=0))

    def stack(self, other: MotorRows) -> MotorRows:
        """Return the rows of both, one below the other."""
        torque = tuple(
            Affine(sparse.vstack([a.matrix, b.matrix], format="csr"), np.append(a.offset, b.offset))
            for a, b in zip(self.torque, other.torque, strict=True)
        )
        speeds = zip(self.squared_speed, other.squared_speed, strict=True)
        return MotorRows(torque, tuple(sparse.vstack(pair, format="csr") for pair in speeds))


def motor_rows(problem: LawProblem, basis: SpeedBasis, conditions: Affine, xi: Array) -> MotorRows:
    """Compute rows of torques and squared speeds at xi (M,), without poles.

    No xi is on a crossing. A torque is c + cz z + cu u with u = z'/2 = xi' (dz/dxi) / 2. Dry friction is
    in c, damping is linearised.
    """
    if problem.response is not None:
        return _responding_rows(problem.response, problem.specification, basis, xi)
    sigma = problem.sigma(xi)
    required = problem.demand(sigma)
    c, cz, cu = required.linearise_damping(None if problem.z0 is None else problem.z0(sigma))
    c = c + required.friction(problem.specification.friction)
    z = basis.matrix(xi)
    u = sparse.diags_array(0.5 * problem.task.stretch(sigma, 1)) @ basis.matrix(xi, 1)
    torques = []
    for motor in range(c.shape[1]):
        matrix = sparse.diags_array(cz[:, motor]) @ z + sparse.diags_array(cu[:, motor]) @ u
        torque = Affine(sparse.csr_array(matrix), c[:, motor].copy())
        torques.append(_remove_poles(torque, problem, conditions, xi))
    squared_speeds = _squared_speed_rows(required.speed, problem.specification.speed_limit, z)
    return MotorRows(tuple(torques), squared_speeds)


def _responding_rows(
    response: TorqueResponse, specification: Specification, basis: SpeedBasis, xi: Array
) -> MotorRows:
    """Compute rows of torques and squared speeds at xi (M,) from the response to the law's coefficients."""
    torque, speed = response.torque(xi), response.speed(xi)
    slopes = response.slopes(xi).reshape(*torque.shape, -1)  # (M, n_a, n)
    offset = torque - slopes @ response.y + specification.friction * speed_signs(speed)
    torques = [Affine(sparse.csr_array(slopes[:, j]), offset[:, j].copy()) for j in range(torque.shape[1])]
    return MotorRows(tuple(torques), _squared_speed_rows(speed, specification.speed_limit, basis.matrix(xi)))


def _squared_speed_rows(speed: Array, limit: Array, z: Any) -> tuple[Any, ...]:
    """Compute rows (M, n) of squared speeds over their limits.

    Motors without a limit have none.

    Args:
        speed: (M, n_a) of the motors over d sigma/dt.
        z: rows (M, n) of the squared speed (d sigma/dt)^2.
    """
    ratios = (speed[:, j] / limit[j] for j in np.flatnonzero(np.isfinite(limit)))
    return tuple(sparse.csr_array(sparse.diags_array(ratio**2) @ z) for ratio in ratios)


def _remove_poles(torque: Affine, problem: LawProblem, conditions: Affine, xi: Array) -> Affine:
    """Subtract the poles from torque rows T (M, n) beside each crossing.

    They are multiples of the conditions C. On laws that meet the conditions the torques stay the same. T -
    share C is orthogonal to C with share = T C' (C C')^-1, which cancels the pole.
    """
    for crossing in np.unique(problem.crossing_xi):
        chosen = np.flatnonzero(problem.crossing_xi == crossing)
        C = conditions.matrix[chosen]
        products = (torque.matrix @ C.T).toarray()  # (M, k)
        share = np.linalg.lstsq((C @ C.T).toarray(), products.T, rcond=None)[0].T
        is_beside = np.abs(xi - crossing) < POLE_WIDTH
        share = is_beside[:, None] * share
        matrix = torque.matrix - sparse.csr_array(share) @ C
        torque = Affine(sparse.csr_array(matrix), torque.offset - share @ conditions.offset[chosen])
    return torque


def condition_rows(problem: LawProblem, basis: SpeedBasis) -> Affine:
    """Return the conditions of a problem as rows (k, n) on coefficients.

    They say constant + per_z z + per_u u + per_du u' = 0 with u = z'/2 and u' = z"/2. z is a function of xi:
    dz/dsigma = xi' dz/dxi, d2z/dsigma2 = xi'^2 d2z/dxi2 + xi" dz/dxi. A response has its own condition (8).
    """
    constant, per_z, per_u, per_du = problem.conditions.T
    z, z_xi, z_xi_xi = (basis.matrix(problem.crossing_xi, order) for order in range(3))  # in xi
    dxi, ddxi = (problem.task.stretch(problem.crossings, order) for order in (1, 2))
    rows = (
        sparse.diags_array(per_z) @ z
        + sparse.diags_array(0.5 * per_u * dxi + 0.5 * per_du * ddxi) @ z_xi
        + sparse.diags_array(0.5 * per_du * dxi**2) @ z_xi_xi
    )
    if problem.response is None:
        return Affine(sparse.csr_array(rows), constant)
    scalars = problem.response.scalars
    count = len(scalars)
    matrix = sparse.vstack([sparse.csr_array(scalars), sparse.csr_array(rows)[count:]], format="csr")
    return Affine(matrix, np.append(-scalars @ problem.response.y, constant[count:]))
