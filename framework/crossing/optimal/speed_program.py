"""The cone program of the best law along a path: what the robot asks, as rows on the squared speed z.

z is a Chebyshev series in sigma, and torques at the points of the program are affine in its coefficients:
those of a rigid robot, or of one whose deflections are known as functions of the path parameter. Between the
points, and at the crossings themselves where only the limit of the torque exists, they are interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, legendre

from framework.arrays import Array
from framework.crossing.optimal.phase_plane import Demand
from framework.crossing.specification import Specification
from framework.motion.chebyshev import coefficients as series_through
from framework.motion.chebyshev import derivative_matrix, evaluate, nodes
from framework.motion.cone_program import Affine, ConeProgram, Optimum, Unsolved, solve_cone_program
from framework.motion.infeasibility import Infeasible
from framework.motion.optimal_law import Stretch
from framework.tolerances import LIMIT_MARGIN, MIN_SQUARED_SPEED_RATIO

FIRST_ROW_STRIDE = 2  # the first rows are at every other point
DENSE_POINTS_RATIO = 6  # points at which limits are checked, over those of the program
# Weight of the coefficients of z, grown with the square of their degree, whatever is to vanish at the ends.
ROUGHNESS_WEIGHT = 1e-6
MAX_UNIT_RATIO = 4.0  # of the optimum to the guessed units, or inverse: beyond, it is solved once more


class OnPath(NamedTuple):
    """Torques, speeds and conditions (8) along the path, in terms of z and u."""

    sigma: Array  # (M,) Chebyshev points of `stretch`, none of them on a crossing
    demand: Demand  # at `sigma`
    crossings: Array  # (k,) sigma
    conditions: Array  # (k, 4): constant + per_z z + per_u u + per_du u' = 0 there
    stretch: Stretch = Stretch()  # xi(sigma), in which z is a Chebyshev series


class Units(NamedTuple):
    """The units of time [s] and torques (n_a,) [N m] of the program: their limits, if they have one."""

    time: float
    torque: Array


def points_of(degree: int, crossings: Array, stretch: Stretch) -> Array:
    """Return sigma of Chebyshev points that resolve torques of z of this degree, clear of the crossings."""
    sizes = [3 * degree + 1 + extra for extra in range(10)]  # odd ones have a point in the middle
    places = stretch(crossings)

    def gap(size: int) -> float:
        return float(np.abs(nodes(size)[:, None] - places).min(initial=1.0)) * size

    sigma = stretch.inverse(nodes(max(sizes, key=gap)))
    sigma[[0, -1]] = 0.0, 1.0
    return sigma


class Basis(NamedTuple):
    """Values of z and u at points, as matrices on the coefficients."""

    z: Array
    u: Array

    @staticmethod
    def at(sigma: Array, degree: int, stretch: Stretch) -> Basis:
        """Return the basis of Chebyshev polynomials up to this degree in xi(sigma)."""
        values = np.asarray(chebyshev.chebvander(stretch(sigma), degree), dtype=float)
        slope = 0.5 * stretch(sigma, 1)[:, None]
        return Basis(values, slope * (values @ derivative_matrix(degree + 1)))  # u = z'/2

    def du(self, sigma: Array, stretch: Stretch) -> Array:
        """Return values of u' = z"/2."""
        once, twice = (self.z @ derivative_matrix(self.z.shape[1], order) for order in (1, 2))
        return np.asarray(0.5 * (stretch(sigma, 1)[:, None] ** 2 * twice + stretch(sigma, 2)[:, None] * once))


def guessed_units(on_path: OnPath, specification: Specification) -> Units:
    """Guess units in which the solution is near 1."""
    demand, limit = on_path.demand, specification.torque_limit
    time = specification.most
    if time is None:  # what the limits allow at half of the points, z constant
        spare = np.maximum(limit - np.abs(demand.torque.constant), 0.1 * limit)
        by_torque = np.sqrt(np.abs(demand.torque.per_z) / spare).max(axis=1)
        time = (
            float(np.median(np.maximum(by_torque, (demand.speed / specification.speed_limit).max(axis=1))))
            or 1.0
        )
    if specification.limited:
        return Units(time, np.where(np.isfinite(limit), limit, limit[np.isfinite(limit)].max()))
    steady = np.abs(demand.torque.constant + demand.torque.per_z / time**2).max(axis=1)
    size = float(np.median(steady)) or float(np.abs(demand.torque.per_u).max()) / time**2 or 1.0
    return Units(time, np.full(len(limit), size))


def better_units(units: Units, specification: Specification, optimum: Optimum) -> Units:
    """Return the units of the solution, or the same object if they are near enough."""
    longer = optimum.duration if specification.most is None else 1.0
    heavier = 1.0 if specification.limited else optimum.peak
    if max(longer, 1 / longer, heavier, 1 / heavier) < MAX_UNIT_RATIO:
        return units
    return Units(units.time * longer, units.torque * heavier)


@dataclass(frozen=True, eq=False)
class SpeedProgram:
    """The cone program of a specification, for z of one degree, in units."""

    on_path: OnPath
    specification: Specification
    degree: int
    units: Units
    roughness: float = ROUGHNESS_WEIGHT

    @cached_property
    def scale(self) -> float:
        """The unit of z [1/s^2]: the factor from the program's coefficients to those of z."""
        return self.units.time**-2

    @cached_property
    def _torque(self) -> tuple[Array, Array]:
        """Torques at the points as affine functions of the coefficients: (M, n_a, n) and (M, n_a)."""
        constant, per_z, per_u = self.on_path.demand.torque
        basis = Basis.at(self.on_path.sigma, self.degree, self.on_path.stretch)
        matrix = per_z[:, :, None] * basis.z[:, None] + per_u[:, :, None] * basis.u[:, None]
        return self.scale * matrix / self.units.torque[:, None], constant / self.units.torque

    def torque_rows(self, take: Array) -> Affine:
        """Return torques of all motors at combinations `take` (R, M) of the points, (R n_a)."""
        matrix, offset = self._torque
        rows = np.tensordot(take, matrix, axes=1)
        return Affine(rows.reshape(-1, self.degree + 1), (take @ offset + self._friction(take)).ravel())

    def _friction(self, take: Array) -> Array:
        """Return torques (R, n_a) of dry friction at combinations `take` (R, M) of the points, in units."""
        return self.on_path.demand.friction(self.specification.friction, take) / self.units.torque

    @cached_property
    def between(self) -> Array:
        """Combinations of the points that give the values between them and at the crossings."""
        size = len(self.on_path.sigma)
        at_crossings = evaluate(self.on_path.stretch(self.on_path.crossings), series_through(np.eye(size)))
        return np.concatenate([_dense(size), at_crossings])

    def torques(self, y: Array) -> Array:
        """Return sizes of the torques over their units between the points and at the crossings (R, n_a)."""
        matrix, offset = self._torque
        return np.asarray(np.abs(self.between @ (matrix @ y + offset) + self._friction(self.between)))

    @cached_property
    def _squared_speed(self) -> Array:
        """Squared speeds over their limits at the points, of motors that have one: (M, motors, n)."""
        limit = self.specification.speed_limit
        limited = np.isfinite(limit)
        ratio = self.on_path.demand.speed[:, limited] / limit[limited]
        basis = Basis.at(self.on_path.sigma, self.degree, self.on_path.stretch)
        return np.asarray(self.scale * ratio[:, :, None] ** 2 * basis.z[:, None])

    def speed_rows(self, take: Array) -> Array:
        """Return squared speeds over their limits at combinations `take` (R, M) of the points, as rows."""
        return np.tensordot(take, self._squared_speed, axes=1).reshape(-1, self.degree + 1)

    def squared_speeds(self, y: Array) -> Array:
        """Return the largest squared speed over its limit between the points and at the crossings (R,)."""
        return np.asarray((self.between @ (self._squared_speed @ y)).max(axis=1, initial=0.0))

    def conditions(self) -> Affine:
        """Return condition (8) at all crossings, as rows on the coefficients."""
        path = self.on_path
        return conditions_on_speed(path.crossings, path.conditions, self.degree, path.stretch, self.scale)

    def cones(self) -> ConeProgram:
        """Return the problem for the solver, with rows at every other point."""
        specification, degree = self.specification, self.degree
        points, weights = legendre.leggauss(degree + degree // 2)
        size = len(self.on_path.sigma)
        rows = np.append(np.arange(0, size - 1, FIRST_ROW_STRIDE), size - 1)  # both ends are among them
        power = Affine(np.empty((0, degree + 1)), np.empty(0))
        if specification.goal == "energy":
            power = self.torque_rows(evaluate(points, series_through(np.eye(size))))
        return ConeProgram(
            speeds=np.asarray(chebyshev.chebvander(points, degree), dtype=float),
            average=np.eye(len(weights)),
            weights=weights / self.on_path.stretch(self.on_path.stretch.inverse(points), 1),
            positive=np.empty((0, degree + 1)),
            torque=self.torque_rows(np.eye(size)[rows]),
            bounded=np.tile(specification.limited_motors, len(rows)),
            below_one=self.speed_rows(np.eye(size)[rows]),
            power=power,
            equalities=self.conditions(),
            roughness=self.roughness * np.diag(np.arange(degree + 1.0) ** 2),
            floor=MIN_SQUARED_SPEED_RATIO,
            kept=LIMIT_MARGIN if specification.limited or specification.limited_speeds else 0.0,
        )

    def solved(self, cones: ConeProgram) -> Optimum | Infeasible | Unsolved:
        """Return the optimum of these cones, or why there is none."""
        longest_allowed = self.specification.most
        longest = None if longest_allowed is None else longest_allowed / self.units.time
        return solve_cone_program(cones, self.specification.goal, longest=longest)


def conditions_on_speed(
    sigma: Array, conditions: Array, degree: int, stretch: Stretch, scale: float = 1.0
) -> Affine:
    """Return constant + per_z z + per_u u + per_du u' at sigma (k,), z of this degree in units of `scale`."""
    basis = Basis.at(sigma, degree, stretch)
    constant, per_z, per_u, per_du = conditions.T[:, :, None]
    rows = per_z * basis.z + per_u * basis.u
    if np.any(per_du):
        rows = rows + per_du * basis.du(sigma, stretch)
    return Affine(scale * rows, constant[:, 0])


@lru_cache(maxsize=8)
def _dense(size: int) -> Array:
    """Return the matrix that interpolates `size` Chebyshev points, DENSE_POINTS_RATIO times as densely."""
    count = DENSE_POINTS_RATIO * size
    return evaluate(-np.cos(np.pi * (np.arange(count) + 0.5) / count), series_through(np.eye(size)))
