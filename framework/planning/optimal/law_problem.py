"""The conditions of a law along a path, and the demand on the motors, as sparse rows on its coefficients.

Condition (8) is a sparse equality. Torques have a pole where it is not met. So beside a crossing a multiple
of the condition is subtracted from each torque row, which stays bounded and sparse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from framework.laws.speed_basis import ONE_CELL, SpeedBasis
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.cone_program import Affine
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.phase_plane import Deflections, Demand, SquaredSpeed, demand
from framework.planning.optimal.sampled_demand import SampledDemand
from framework.planning.specification import Specification

POLE_WIDTH = 0.05  # in xi, beside a crossing, where rows are freed of their pole


class LawProblem(NamedTuple):
    """The task of a law, with its conditions at `crossings` sigma (k,) and the known parts of its motion.

    conditions: (k, 4), constant + per_z z + per_u u + per_du u' = 0.
    deflections: of the springs along the path, if any.
    before: the squared speed about which damping is linearised, if any.
    sampled: the demand along the path, if it was resolved.
    weighing: the `reference`, where that is not of the limits.
    degree: of z as one Chebyshev series, which deflections need; None for splines.
    """

    task: Task
    crossings: Array
    conditions: Array
    deflections: Deflections | None = None
    before: SquaredSpeed | None = None
    sampled: SampledDemand | None = None
    weighing: Array | None = None
    degree: int | None = None

    def demand(self, sigma: Array) -> Demand:
        """Compute torques and speeds of the motors at sigma (M,)."""
        task = self.task
        if self.sampled is not None:
            return self.sampled.evaluate(task.phi, sigma)
        return demand(task.branch, task.phi, sigma, self.deflections, task.geometry)

    def basis_on(self, cells: Array) -> SpeedBasis:
        """Return the basis of z: splines on cells (k + 1,), or the series of the degree."""
        if self.degree is None:
            return SpeedBasis.from_cells(cells)
        return SpeedBasis(np.array(ONE_CELL), self.degree + 1)

    @property
    def specification(self) -> Specification:
        return self.task.specification

    def with_goal(self, goal: str) -> LawProblem:
        """Return the problem with another goal."""
        specification = replace(self.specification, goal=goal)
        return self._replace(task=self.task._replace(specification=specification), weighing=self.reference)

    @property
    def places(self) -> Array:
        """Places of the conditions in xi (k,)."""
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
        if self.weighing is not None:
            return self.weighing
        limit = self.specification.torque_limit
        limited = np.isfinite(limit)
        return np.where(limited, limit, limit[limited].max(initial=0.0) or 1.0)


class MotorRows(NamedTuple):
    """Torques and squared speeds of the motors at points of the path, affine in the coefficients of z."""

    torque: tuple[Affine, ...]  # of each motor, (M, n) [N m]
    squared_speed: tuple[Any, ...]  # of each motor with a limit, over its square: (M, n)

    def combine(self, weights: Any) -> MotorRows:
        """Return the rows weights (R, M) @ rows."""
        torque = tuple(Affine(weights @ matrix, weights @ offset) for matrix, offset in self.torque)
        return MotorRows(torque, tuple(weights @ matrix for matrix in self.squared_speed))

    def used_share(self, y: Array, allowed: Array) -> Array:
        """Return the largest share (M,) of allowed torques (n_a,) [N m], or of squared speed limits."""
        torques = [np.abs(torque(y)) / limit for torque, limit in zip(self.torque, allowed, strict=True)]
        return np.asarray(np.max([*torques, *(rows @ y for rows in self.squared_speed)], axis=0))

    def stack(self, other: MotorRows) -> MotorRows:
        """Return the rows of both, one below the other."""
        torque = tuple(
            Affine(sparse.vstack([a.matrix, b.matrix], format="csr"), np.append(a.offset, b.offset))
            for a, b in zip(self.torque, other.torque, strict=True)
        )
        speeds = zip(self.squared_speed, other.squared_speed, strict=True)
        return MotorRows(torque, tuple(sparse.vstack(pair, format="csr") for pair in speeds))


def motor_rows(problem: LawProblem, basis: SpeedBasis, conditions: Affine, xi: Array) -> MotorRows:
    """Compute rows of torques and squared speeds at places xi (M,), none on a crossing, without their poles.

    A torque is c + cz z + cu u, dry friction in c and damping linearised, with u = z'/2.
    """
    sigma = problem.sigma(xi)
    required = problem.demand(sigma)
    before = None if problem.before is None else problem.before(sigma)
    constant, per_z, per_u = required.linearise_damping(before)
    constant = constant + required.friction(problem.specification.friction)
    z = basis.matrix(xi)
    u = sparse.diags_array(0.5 * problem.task.stretch(sigma, 1)) @ basis.matrix(xi, 1)
    torques = []
    for j in range(constant.shape[1]):
        matrix = sparse.diags_array(per_z[:, j]) @ z + sparse.diags_array(per_u[:, j]) @ u
        torques.append(Affine(sparse.csr_array(matrix), constant[:, j].copy()))
    for crossing in np.unique(problem.places):
        beside = np.abs(xi - crossing) < POLE_WIDTH
        its_conditions = np.flatnonzero(problem.places == crossing)
        torques = [_subtract_conditions(torque, conditions, its_conditions, beside) for torque in torques]
    return MotorRows(
        tuple(torques), _squared_speed_rows(required.speed, problem.specification.speed_limit, z)
    )


def _squared_speed_rows(speed: Array, limit: Array, z: Any) -> tuple[Any, ...]:
    """Return rows (M, n) of the squared speed over its limit of each motor with a limit.

    Args:
        speed: (M, n_a) of the motors over d sigma/dt.
        z: rows (M, n) of the squared speed (d sigma/dt)^2.
    """
    ratios = (speed[:, j] / limit[j] for j in np.flatnonzero(np.isfinite(limit)))
    return tuple(sparse.csr_array(sparse.diags_array(ratio**2) @ z) for ratio in ratios)


def _subtract_conditions(torque: Affine, conditions: Affine, chosen: IntArray, beside: BoolArray) -> Affine:
    """Subtract multiples of the conditions C from the torque rows T beside a crossing.

    T - share C is orthogonal to C with share = T C' (C C')^-1.

    Args:
        chosen: the conditions (k,) at the crossing.
        beside: mask (M,) of the rows.
    """
    rows = conditions.matrix[chosen]
    share = np.linalg.lstsq((rows @ rows.T).toarray(), (torque.matrix @ rows.T).toarray().T, rcond=None)[0].T
    share = beside[:, None] * share
    matrix = torque.matrix - sparse.csr_array(share) @ rows
    return Affine(sparse.csr_array(matrix), torque.offset - share @ conditions.offset[chosen])


def condition_rows(problem: LawProblem, basis: SpeedBasis) -> Affine:
    """Return the conditions of a problem as rows (k, n) on coefficients, with u = z'/2 and u' = z"/2.

    z is a function of xi: dz/dsigma = xi' dz/dxi, d2z/dsigma2 = xi'^2 d2z/dxi2 + xi" dz/dxi.
    """
    stretch, sigma = problem.task.stretch, problem.crossings
    constant, per_z, per_u, per_du = problem.conditions.T
    values, first, second = (basis.matrix(problem.places, order) for order in range(3))
    slope, bend = stretch(sigma, 1), stretch(sigma, 2)
    rows = (
        sparse.diags_array(per_z) @ values
        + sparse.diags_array(0.5 * per_u * slope + 0.5 * per_du * bend) @ first
        + sparse.diags_array(0.5 * per_du * slope**2) @ second
    )
    return Affine(sparse.csr_array(rows), constant)
