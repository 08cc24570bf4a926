"""Torques and speeds that a path demands of the motors, as Chebyshev series in s.

The search for a law takes dozens of cone programs with thousands of points. These series require the robot's
equations at only some hundred poses. All torques have a pole at a crossing s_c, so that the series are those
of torque (s - s_c).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import cut_cells, uniform_cells
from framework.planning.optimal.phase_plane import AffineInSpeed, Demand, demand

FIRST_CELLS, NODES = 4, 16  # an even number of nodes: none in the middle of a cell, where a crossing is
MAX_CELLS = 60  # with more cells, the equations are evaluated at each point of a program instead
SERIES_TAIL = 1e-9  # last coefficients of a resolved series, over the largest one on the cell


class SampledDemand(NamedTuple):
    """The demand on the motors along a path as series in s.

    poles: (k,) s of the crossings; listed twice for a pole of second order.
    series: (5 n_a,) functions of s: torques at rest, per s'^2, per s" and per s', each multiplied by
        s - pole for all poles; and motor speeds per s'.
    has_friction: whether dry friction acts on any motor.
    """

    poles: Array
    series: TimeFunction
    has_friction: bool

    def evaluate(self, phi: Smoothstep, sigma: Array) -> Demand:
        """Compute the demand at sigma (M,), affine in z and u.

        It follows from the series with s'^2 = phi'^2 z and s" = phi' u + phi" z.
        """
        s = phi(sigma)
        dphi = phi(sigma, 1)[:, None]
        ddphi = phi(sigma, 2)[:, None]
        pole_product = _pole_product(s, self.poles)
        *torques, speed = np.split(self.series(s), 5, axis=1)
        constant, per_z, per_u, damping = (torque / pole_product for torque in torques)
        affine = AffineInSpeed(constant, per_z * dphi**2 + per_u * ddphi, per_u * dphi)
        return Demand(affine, damping * dphi, speed * dphi, speed if self.has_friction else None)


def _pole_product(s: Array, poles: Array) -> Array:
    """Compute the product (T, 1) of s - pole over all poles."""
    return (s[:, None] - poles).prod(axis=1)[:, None]


def sample_demand(task: Task) -> SampledDemand | None:
    """Fit Chebyshev series to the undeformed robot's demand along a path; None without success."""
    points = task.to_cross.points
    # the pole is of second order if the path touches the locus, or if several motions escape at once
    pole_orders = [1 + (point.corank > 1 or point.contact == "tangential") for point in points]
    poles = np.repeat([point.s for point in points], pole_orders)
    edges = uniform_cells(task, FIRST_CELLS)
    while len(edges) <= MAX_CELLS:
        grid = TimeGrid(edges, NODES)
        required = demand(task.branch, Smoothstep(0), grid.times)
        pole_product = _pole_product(grid.times, poles)
        torques = [part * pole_product for part in (*required.torque, required.damping)]
        series = grid.fit(np.concatenate([*torques, required.speed], axis=1))
        is_unresolved = _find_unresolved(series, task.robot.n_a)
        if not is_unresolved.any():
            return SampledDemand(poles, series, required.direction is not None)
        edges = cut_cells(task, edges, np.where(is_unresolved, 2, 1))
    return None


def _find_unresolved(series: TimeFunction, motors: int) -> Array:
    """Return the mask (P,) of panels on which one of the five quantities is not resolved.

    A quantity is resolved if it is finite and its last two coefficients are small compared with the largest
    one, over all motors. Torques per s'^2 and per s" have the same unit and are compared with the larger of
    the two, because either may be rounding of the other.
    """
    panels, size, _ = series.coefficients.shape
    by_quantity = np.abs(series.coefficients).reshape(panels, size, 5, motors).max(axis=3)
    at_rest, per_z, per_u, damping, speed = np.moveaxis(by_quantity, 2, 0)
    sizes = np.stack([at_rest, np.maximum(per_z, per_u), damping, speed], axis=2)
    tail = sizes[:, -2:].max(axis=1)
    largest = sizes.max(axis=1)
    resolved = tail <= SERIES_TAIL * largest  # not a number compares false
    return np.asarray(~resolved.all(axis=1))
