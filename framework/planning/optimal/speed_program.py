"""The cone program of the best law along a path, in the squared speed z.

z has B-spline coefficients y on cells of xi(sigma). With y >= floor it is positive everywhere, and

    torque = c + cz z + cu u,     duration = integral of v,   v r >= 1,  r^2 <= z,
                                  energy = integral of e,     e r >= |torque|^2

are affine in y, or second-order cones. Condition (8) is a sparse equality (see `law_problem`). At a crossing
the limit of the torque is a row, interpolated through points of its cell.

Unknowns: Verscheure, Demeulenaere, Swevers, De Schutter and Diehl, IEEE TAC 54 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy import sparse

from framework.laws.exact_duration import SpeedSpace
from framework.laws.speed_basis import SpeedBasis
from framework.numerics.arrays import Array, read_only
from framework.numerics.cone_program import (
    TOLERANCE,
    Affine,
    AffineRows,
    ConeProgram,
    Unsolved,
    linear_rows,
    product_cone,
    solve_cone_program,
)
from framework.planning.optimal.law_problem import LawProblem, MotorRows, condition_rows, motor_rows
from framework.planning.optimal.path_series import cells_about
from framework.tolerances import LIMIT_MARGIN

# Gauss points of a cell, and of a cell about a crossing or at an end. An even number has no point in the
# middle, where the pole is.
POINTS, POINTS_ABOUT = 4, 8
FINE_PARTS, FINE_POINTS = 4, 8  # parts of a cell, and Gauss points of each, where a duration is integrated
POSITIVE_PARTS = 2  # of the way from a point to the next, where a series is positive
MAX_ROW_SIZE = 100.0  # of entries in units: larger rows are scaled down


class Bounds(NamedTuple):
    """The bounds of a solution besides condition (8); None without one.

    longest: of the duration [s].
    peak: of all torques over the reference.
    energy: of the integral of the sum of (torque over reference)^2 [s].
    torque_limits: whether the torque limits of the specification are kept.
    share: of the limits, which may be used.
    """

    longest: float | None = None
    peak: float | None = None
    energy: float | None = None
    torque_limits: bool = True
    share: float = 1.0 - LIMIT_MARGIN


class Units(NamedTuple):
    """The units of time [s] and of relative torque of a program."""

    time: float
    torque: float


class Speed(NamedTuple):
    """A squared speed by its coefficients y (n,) [1/s^2], with its costs.

    duration: [s].
    peak: of torques over the reference; peak_speed: of motor speeds over their limits; both at the rows.
    energy: [s], the integral of the sum of (torque over reference)^2.
    value: the least duration [s] by the solver's own quadrature; not a number for another goal.
    floor: [1/s^2], below which coefficients were not sought.
    """

    y: Array
    duration: float
    peak: float
    peak_speed: float
    energy: float
    value: float = np.nan
    floor: float = 0.0


@dataclass(frozen=True, eq=False)
class SpeedProgram:
    """The cone program of a problem on cells of xi."""

    problem: LawProblem
    basis: SpeedBasis
    cells: Array  # (k + 1,) edges in xi, of the splines
    xi: Array  # (M,) points, both ends among them
    weights: Array  # (M,) of integrals over sigma; zero at the ends
    rows: MotorRows  # at the points, at crossings and at further places
    conditions: Affine  # (k, n)
    further_xi: Array  # (R,) between the points, where a limit was exceeded

    @staticmethod
    def on_cells(problem: LawProblem, cells: Array) -> SpeedProgram:
        """Return the program on cells (k + 1,) of xi, with rows at points and crossings.

        Each crossing is in the middle of a cell. Cells about a crossing and at the ends have more points:
        torques change quickly there.
        """
        basis = problem.basis_on(cells)
        crossings = np.unique(problem.crossing_xi)
        counts = np.where(cells_about(cells, crossings), POINTS_ABOUT, POINTS)
        counts[[0, -1]] = POINTS_ABOUT
        xi, weights = _integration_points(problem, cells, counts)
        conditions = condition_rows(problem, basis)
        rows = motor_rows(problem, basis, conditions, xi)
        limit_weights = _weigh_limits(xi, cells, counts, crossings)
        if limit_weights:
            rows_at_crossings = rows.combine(sparse.csr_array(np.array(limit_weights)))
            rows = rows.stack(rows_at_crossings)
        return SpeedProgram(problem, basis, cells, xi, weights, rows, conditions, np.empty(0))

    @property
    def space(self) -> SpeedSpace:
        return SpeedSpace(self.basis, self.problem.task.stretch)

    @cached_property
    def _inner_points(self) -> slice:
        """The points with a weight: all but the ends."""
        return slice(1, len(self.xi) - 1)

    @property
    def _inner_weights(self) -> Array:
        """Weights (P,) of the points with a weight."""
        return self.weights[self._inner_points]

    @cached_property
    def z(self) -> Any:
        """Values (P, n) of z at the points with a weight."""
        return self.basis.matrix(self.xi[self._inner_points])

    @cached_property
    def positive(self) -> tuple[Any, Array]:
        """Rows (m, n) on y that make z positive, and their xi (m,).

        The coefficients themselves for splines; for a series the values at the points and between these.
        """
        if self.basis.is_spline:
            return sparse.identity(self.basis.size, format="csr"), self.basis.centres
        parts = self.xi[:-1, None] + np.diff(self.xi)[:, None] * np.arange(POSITIVE_PARTS) / POSITIVE_PARTS
        xi = np.append(parts.ravel(), self.xi[-1])
        return self.basis.matrix(xi), xi

    @cached_property
    def curvature(self) -> AffineRows:
        """Compute rows (M - 2, n) whose sum of squares is the integral of (d2z/dsigma2)^2.

        A row is d2z/dsigma2 = xi'^2 d2z/dxi2 + xi" dz/dxi at an inner point, times the root of its weight.
        All are divided by their root mean square, so that the integral is near 1.
        """
        stretch = self.problem.task.stretch
        inside = self._inner_points
        sigma = self.problem.sigma(self.xi)[inside]
        first, second = (self.basis.matrix(self.xi[inside], order) for order in (1, 2))
        curvature = (
            sparse.diags_array(stretch(sigma, 1) ** 2) @ second
            + sparse.diags_array(stretch(sigma, 2)) @ first
        )
        rows = sparse.diags_array(np.sqrt(self._inner_weights)) @ curvature
        size = np.sqrt(np.mean(np.square(rows.data)) * rows.shape[0])
        return linear_rows(y=rows / size)

    @cached_property
    def fine_quadrature(self) -> tuple[Any, Array]:
        """Values (F, n) of z and weights (F,) that integrate a duration.

        The integral is over sigma.
        """
        parts = np.linspace(0.0, 1.0, FINE_PARTS + 1)[:-1]
        starts = (self.cells[:-1, None] + np.diff(self.cells)[:, None] * parts).ravel()
        counts = np.full(len(starts), FINE_POINTS)
        xi, weights = _integration_points(self.problem, np.append(starts, 1.0), counts)
        return self.basis.matrix(xi[1:-1]), weights[1:-1]  # without the ends, whose weights are zero

    def extend(self, xi: Array) -> SpeedProgram:
        """Return the program with rows at further places xi (R,)."""
        rows = motor_rows(self.problem, self.basis, self.conditions, xi)
        return replace(self, rows=self.rows.stack(rows), further_xi=np.append(self.further_xi, xi))

    def speed(self, y: Array, value: float = np.nan) -> Speed:
        """Compute the costs of coefficients y (n,).

        The duration is the integral of z^(-1/2) over sigma, the energy that of |torque|^2 z^(-1/2).
        """
        fine_z, fine_weights = self.fine_quadrature
        z = fine_z @ y
        duration = float(fine_weights @ z**-0.5) if z.min() > 0 else np.inf
        torque = np.stack([row(y) for row in self.rows.torque], axis=1) / self.problem.reference
        slowness = np.maximum(self.z @ y, np.finfo(float).tiny) ** -0.5  # dt/d sigma
        power = (torque[self._inner_points] ** 2).sum(axis=1) * slowness
        energy = float(self._inner_weights @ power)
        peak = float(np.abs(torque).max(initial=0.0))
        squared_speeds = [float((rows @ y).max()) for rows in self.rows.squared_speed]
        peak_speed = float(np.sqrt(max([0.0, *squared_speeds])))
        return Speed(y, duration, peak, peak_speed, energy, value)

    def minimise(
        self,
        goal: str,
        bounds: Bounds,
        units: Units,
        *,
        floor: float = 0.0,
        cap: Array | None = None,
        weights: Array | None = None,
        about: tuple[Array, float] | None = None,
        tolerance: float = TOLERANCE,
    ) -> Speed | Unsolved:
        """Compute the speed of least cost within bounds.

        Beside y there are unknowns at the points with a weight: r <= z^(1/2), for the duration v >= 1 / r,
        for the energy e >= |torque|^2 / r. `peak` is the largest torque or squared speed that counts for the
        goal.

        Args:
            goal: "time", "peak_torque", "energy"; "peak_speed" or "limits", the least multiple of the speed
                limits or of all limits; "curvature", the integral of (d2z/dsigma2)^2; "slowness", that of
                `weights` z.
            floor, cap: of the `positive` rows [1/s^2], a number and (m,).
            weights: (P,) at the points with a weight.
            about: y (n,) and a duration [s], which the tangent of T(z) at y must not fall below.
            tolerance: relative, of the cost and of the rows.
        """
        timed = goal == "time" or bounds.longest is not None
        powered = goal == "energy" or bounds.energy is not None
        scale = units.time**2  # the unknown y is in units of 1 / time^2
        conditions = AffineRows({"y": self.conditions.matrix / scale}, self.conditions.offset)
        positive = self.positive[0]
        nonnegative = [AffineRows({"y": positive}, np.full(positive.shape[0], -floor * scale))]
        nonnegative += self._limit_rows(goal, bounds, units)
        highest = np.full(positive.shape[0], self.problem.max_squared_speed)
        cap = highest if cap is None else np.minimum(cap, highest)
        if np.isfinite(cap).any():
            capped = np.flatnonzero(np.isfinite(cap))
            nonnegative.append(AffineRows({"y": -positive[capped]}, cap[capped] * scale))
        nonnegative += self._bound_integrals(bounds, units)
        if about is not None:
            nonnegative.append(self._duration_tangent(*about, units))
        program = ConeProgram(
            self._sizes(timed=timed, powered=powered),
            self._linear_cost(goal, weights),
            self.curvature if goal == "curvature" else None,
            [_limit_entries(conditions)],
            nonnegative,
            self._cones(units, timed=timed, powered=powered),
        )
        optimum = solve_cone_program(program, tolerance=tolerance)
        if isinstance(optimum, Unsolved):
            return optimum
        y = optimum["y"] / scale
        if len(conditions.offset):  # met to rounding by the nearest coefficients
            y = self.space.adjust(y, self.conditions)
        duration = float(self._inner_weights @ optimum["v"]) if goal == "time" else np.nan
        return self.speed(y, duration * units.time)._replace(floor=floor)

    def _sizes(self, *, timed: bool, powered: bool) -> dict[str, int]:
        """Return the numbers of unknowns, by name.

        They are r, v for a duration and e for an energy at each point.
        """
        count = self.z.shape[0]
        sizes = {"y": self.basis.size, "peak": 1}
        sizes |= {"r": count} if timed or powered else {}
        sizes |= {"v": count} if timed else {}
        sizes |= {"e": count} if powered else {}
        return sizes

    def _linear_cost(self, goal: str, weights: Array | None) -> dict[str, Array]:
        """Return the cost of each unknown by a goal.

        None for "curvature", whose cost is quadratic.
        """
        match goal:
            case "time":
                return {"v": self._inner_weights}
            case "energy":
                return {"e": self._inner_weights}
            case "slowness":
                assert weights is not None
                return {"y": (self._inner_weights * weights) @ self.z}
            case "curvature":
                return {}
        return {"peak": np.ones(1)}

    def _bound_integrals(self, bounds: Bounds, units: Units) -> list[AffineRows]:
        """Return the bounds of duration and energy as rows not negative.

        They are less the integrals of v and e.
        """
        weights = sparse.csr_array(-self._inner_weights[None])
        rows = []
        if bounds.longest is not None:
            rows.append(AffineRows({"v": weights}, np.array([bounds.longest / units.time])))
        if bounds.energy is not None:
            unit = units.torque**2 * units.time
            rows.append(AffineRows({"e": weights}, np.array([bounds.energy / unit])))
        return rows

    def _duration_tangent(self, y: Array, duration: float, units: Units) -> AffineRows:
        """Compute T_lin(z) - duration at the coefficients y.

        T_lin is the tangent of the duration there. T = integral of z^(-1/2), so that T_lin(z) = integral of
        1.5 z_0^(-1/2) - 0.5 z_0^(-3/2) z.
        """
        weights = self._inner_weights
        z = self.z @ y * units.time**2
        slope = sparse.csr_array((-0.5 * weights * z**-1.5)[None]) @ self.z
        return AffineRows({"y": slope}, np.array([1.5 * weights @ z**-0.5 - duration / units.time]))

    def _limit_rows(self, goal: str, bounds: Bounds, units: Units) -> list[AffineRows]:
        """Return bounds of torques and squared speeds as rows that may not be negative.

        `peak` bounds the torques for the goal "peak_torque", the squared speeds for "peak_speed", and the
        limited torques and the squared speeds for "limits", as a multiple of their limits.
        """
        rows = list[AffineRows]()
        scale = units.time**2
        for motor, (matrix, offset) in enumerate(self.rows.torque):
            unit = self.problem.reference[motor] * units.torque
            torque = AffineRows({"y": matrix / (unit * scale)}, offset / unit)
            is_limited = np.isfinite(self.problem.specification.torque_limit[motor])
            if goal == "peak_torque":
                rows += _bound_size(torque, peak_share=1.0)
            elif goal == "limits" and is_limited:
                rows += _bound_size(torque, peak_share=bounds.share)
            largest = self._largest_torque(motor, goal, bounds, units)
            if np.isfinite(largest):
                rows += _bound_size(torque, largest)
        for matrix in self.rows.squared_speed:
            parts = {"y": -(matrix / scale)}
            largest = bounds.share**2
            if goal in ("peak_speed", "limits"):
                parts["peak"] = _constant_column(matrix, 1.0)
                largest = 0.0
            rows.append(_limit_entries(AffineRows(parts, np.full(matrix.shape[0], largest))))
        return rows

    def _largest_torque(self, motor: int, goal: str, bounds: Bounds, units: Units) -> float:
        """Return the largest relative torque of a motor, in its unit.

        It is infinite without a bound. A share of a torque limit may be less than the torque that holds the
        robot at an end, whatever the law. Then the holding torque is allowed, up to the limit itself.
        """
        largest = np.inf if bounds.peak is None else bounds.peak / units.torque
        limit = self.problem.specification.torque_limit[motor]
        if goal == "limits" or not bounds.torque_limits or not np.isfinite(limit):
            return largest
        at_ends = self.rows.torque[motor].offset[[0, len(self.xi) - 1]]
        allowed = max(bounds.share * limit, min(np.abs(at_ends).max(), limit))
        return min(largest, allowed / (self.problem.reference[motor] * units.torque))

    def _cones(self, units: Units, *, timed: bool, powered: bool) -> list[list[AffineRows]]:
        """Return the cones of durations and energies at the points.

        They are r^2 <= z, v r >= 1 and e r >= |torque|^2, where a point has a weight. The first is 4 z >= (2
        r)^2, that is z + 1 >= |(z - 1, 2 r)|.
        """
        count = self.z.shape[0]
        cones: list[list[AffineRows]] = []
        if timed or powered:
            z_plus_and_minus_1 = [AffineRows({"y": self.z}, np.full(count, offset)) for offset in (1.0, -1.0)]
            twice_r = linear_rows(r=2.0 * sparse.identity(count, format="csr"))
            cones.append([*z_plus_and_minus_1, twice_r])
        identity = sparse.identity(count, format="csr")
        if timed:
            two = AffineRows({}, np.full(count, 2.0))
            cones.append(product_cone({"v": identity}, {"r": identity}, [two]))
        if powered:
            inside = self._inner_points
            scale = units.time**2
            unit = self.problem.reference * units.torque
            twice_torque = [
                AffineRows({"y": 2.0 * matrix[inside] / (unit[j] * scale)}, 2.0 * offset[inside] / unit[j])
                for j, (matrix, offset) in enumerate(self.rows.torque)
            ]
            cones.append(product_cone({"e": identity}, {"r": identity}, twice_torque))
        return cones


def _weigh_limits(xi: Array, cells: Array, counts: Array, crossings: Array) -> list[Array]:
    """Weigh the values (M,) at points in the limit at each crossing.

    A torque at a crossing is 0 / 0. Its limit is that of the polynomial through the points of the cell about
    the crossing; a crossing on an edge of two cells has no weights.

    Args:
        counts: (k,) points of each cell; the first point of all is the end -1.
    """
    first_points = 1 + np.cumsum(counts) - counts
    weights = []
    for crossing in crossings:
        for cell in np.flatnonzero(cells_about(cells, np.array([crossing]))):
            points = first_points[cell] + np.arange(counts[cell])
            weights.append(_interpolation(xi, points, crossing))
    return weights


def _integration_points(problem: LawProblem, cells: Array, counts: Array) -> tuple[Array, Array]:
    """Return Gauss points xi (M,) of the cells and weights (M,) in sigma.

    Points -1 and 1 have the weight zero. The weights are those in xi over xi' = d xi / d sigma.
    """
    points_of = [np.array([-1.0])]
    weights_of = [np.zeros(1)]
    for low, high, count in zip(cells[:-1], cells[1:], counts, strict=True):
        points, point_weights = _gauss_legendre(int(count))
        points_of.append(0.5 * (low + high) + 0.5 * (high - low) * points)
        weights_of.append(0.5 * (high - low) * point_weights)
    xi = np.concatenate([*points_of, [1.0]])
    return xi, np.concatenate([*weights_of, [0.0]]) / problem.task.stretch(problem.sigma(xi), 1)


@lru_cache(maxsize=8)
def _gauss_legendre(count: int) -> tuple[Array, Array]:
    """Return Gauss points (count,) on [-1, 1] and their weights."""
    points, weights = legendre.leggauss(count)
    return read_only(points), read_only(weights)


def _interpolation(xi: Array, chosen: Array, x: float) -> Array:
    """Compute the weights (M,) of Lagrange's polynomial at x.

    It goes through some of the points xi (M,). The weight of point i is the product of (x - x_j) / (x_i -
    x_j) over all j other than i.

    Args:
        chosen: indices (k,) of the points.
    """
    points = xi[chosen]
    denominators = points[:, None] - points + np.eye(len(points))
    numerators = np.tile(x - points, (len(points), 1))
    np.fill_diagonal(numerators, 1.0)
    weights = np.zeros(len(xi))
    weights[chosen] = numerators.prod(axis=1) / denominators.prod(axis=1)
    return weights


def _limit_entries(rows: AffineRows) -> AffineRows:
    """Scale down rows with entries of y above MAX_ROW_SIZE.

    The largest entry of each is then that.
    """
    if not len(rows.offset):
        return rows
    largest = np.abs(rows.parts["y"]).max(axis=1).toarray().ravel()
    factors = 1.0 / np.maximum(1.0, largest / MAX_ROW_SIZE)
    scaling = sparse.diags_array(factors)
    return AffineRows({name: scaling @ matrix for name, matrix in rows.parts.items()}, factors * rows.offset)


def _bound_size(
    torque: AffineRows, largest: float = 0.0, *, peak_share: float | None = None
) -> list[AffineRows]:
    """Return the bounds of |torque| as rows that may not be negative.

    They say |torque| <= largest + peak_share * peak.
    """
    matrix = torque.parts["y"]
    peak = {} if peak_share is None else {"peak": _constant_column(matrix, peak_share)}
    return [
        _limit_entries(AffineRows({"y": sign * matrix, **peak}, sign * torque.offset + largest))
        for sign in (-1.0, 1.0)
    ]


def _constant_column(matrix: Any, value: float) -> Any:
    """Return a sparse column of one value with as many rows as a matrix."""
    return sparse.csr_array(np.full((matrix.shape[0], 1), value))
