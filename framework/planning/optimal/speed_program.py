"""The cone program of the best law along a path, in the squared speed z.

z has B-spline coefficients y on cells of xi(sigma). With y >= floor it is positive everywhere, and

    torque = c + cz z + cu u,     duration = integral of v,   v r >= 1,  r^2 <= z,
                                  energy = integral of e,     e r >= |torque|^2

are affine in y, or second-order cones. Condition (8) is a sparse equality (see `law_problem`). At a crossing
the limit of the torque is a row, interpolated through points of its cell.

Unknowns: Verscheure, Demeulenaere, Swevers, De Schutter and Diehl, IEEE TAC 54 (2009).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy import sparse

from framework.laws.exact_duration import SpeedSpace
from framework.laws.speed_basis import SpeedBasis
from framework.numerics.arrays import Array, BoolArray, read_only
from framework.numerics.cone_program import Affine, AffineRows, ConeProgram, Unsolved, solve_cone_program
from framework.planning.optimal.law_problem import LawProblem, MotorRows, condition_rows, motor_rows
from framework.tolerances import LIMIT_MARGIN

# of a cell; about crossings and at ends. An even number has no point in the middle, where the pole is
POINTS, POINTS_ABOUT = 4, 8
FINE_PARTS, FINE_POINTS = 4, 8  # of a cell, and of each of these, where a duration is integrated
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
    """The units of time [s] and of torques over the reference in which a program is solved."""

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
    rows: MotorRows  # at the points, at crossings and wherever a limit was exceeded
    conditions: Affine  # (k, n)

    @staticmethod
    def on_cells(problem: LawProblem, cells: Array) -> SpeedProgram:
        """Return the program with points on cells (k + 1,) of xi, each crossing in the middle of one."""
        basis, places = problem.basis_on(cells), np.unique(problem.places)
        counts = np.where(_cells_about(cells, places), POINTS_ABOUT, POINTS)
        counts[[0, -1]] = POINTS_ABOUT
        xi, weight = _gauss_points(cells, counts)
        weights = weight / problem.task.stretch(problem.sigma(xi), 1)
        conditions = condition_rows(problem, basis)
        rows = motor_rows(problem, basis, conditions, xi)
        # torques at a crossing are 0 / 0: take their limit by the polynomial through the points of its cell
        first_points = 1 + np.cumsum(counts) - counts  # of each cell; point 0 is the end -1
        limit_weights = []
        for place in places:
            for cell in np.flatnonzero(_cells_about(cells, np.array([place]))):  # one, or none on an edge
                points = first_points[cell] + np.arange(counts[cell])
                limit_weights.append(_interpolation(xi, points, place))
        if limit_weights:
            rows = rows.stack(rows.combine(sparse.csr_array(np.array(limit_weights))))
        return SpeedProgram(problem, basis, cells, xi, weights, rows, conditions)

    @property
    def space(self) -> SpeedSpace:
        return SpeedSpace(self.basis, self.problem.task.stretch)

    @cached_property
    def _integrated(self) -> slice:
        """The points with a weight: all but the ends."""
        return slice(1, len(self.xi) - 1)

    @cached_property
    def z(self) -> Any:
        """Values (P, n) of z at the points with a weight."""
        return self.basis.matrix(self.xi[self._integrated])

    @cached_property
    def positive(self) -> tuple[Any, Array]:
        """Rows (m, n) on y whose positive values make z positive, and their places in xi (m,).

        The coefficients themselves for splines; the values at the points for a series.
        """
        if self.basis.is_spline:
            return sparse.identity(self.basis.size, format="csr"), self.basis.centres
        return self.basis.matrix(self.xi), self.xi

    @cached_property
    def bend(self) -> AffineRows:
        """d2z/dsigma2 = xi'^2 d2z/dxi2 + xi" dz/dxi at the points, times the root of their weights."""
        stretch, inside = self.problem.task.stretch, self._integrated
        sigma = self.problem.sigma(self.xi)[inside]
        first, second = (self.basis.matrix(self.xi[inside], order) for order in (1, 2))
        bend = (
            sparse.diags_array(stretch(sigma, 1) ** 2) @ second
            + sparse.diags_array(stretch(sigma, 2)) @ first
        )
        root = np.sqrt(self.weights[inside])
        return AffineRows({"y": sparse.diags_array(root) @ bend}, np.zeros(len(root)))

    @cached_property
    def _fine(self) -> tuple[Any, Array]:
        """Values (F, n) of z and weights (F,) in sigma with which a duration is integrated."""
        cells = self.cells
        parts = np.linspace(0.0, 1.0, FINE_PARTS + 1)[:-1]
        edges = np.append((cells[:-1, None] + np.diff(cells)[:, None] * parts).ravel(), 1.0)
        xi, weight = _gauss_points(edges, np.full(len(edges) - 1, FINE_POINTS))
        sigma = self.problem.sigma(xi)[1:-1]
        return self.basis.matrix(xi[1:-1]), weight[1:-1] / self.problem.task.stretch(sigma, 1)

    def extend(self, xi: Array) -> SpeedProgram:
        """Return the program with rows at further places xi (R,)."""
        further = motor_rows(self.problem, self.basis, self.conditions, xi)
        return replace(self, rows=self.rows.stack(further))

    def speed(self, y: Array, value: float = np.nan) -> Speed:
        """Compute the costs of coefficients y (n,)."""
        fine, weights = self._fine
        z = fine @ y
        duration = float(weights @ z**-0.5) if z.min() > 0 else np.inf
        ratio = np.stack([torque(y) for torque in self.rows.torque], axis=1) / self.problem.reference
        fastest = max((float((rows @ y).max()) for rows in self.rows.squared_speed), default=0.0)
        slowness = np.maximum(self.z @ y, np.finfo(float).tiny) ** -0.5
        power = (ratio[self._integrated] ** 2).sum(axis=1) * slowness
        energy = float(self.weights[self._integrated] @ power)
        peak = float(np.abs(ratio).max(initial=0.0))
        return Speed(y, duration, peak, float(np.sqrt(max(fastest, 0.0))), energy, value)

    def meet_conditions(self, y: Array) -> Array:
        """Return the coefficients (n,) nearest to y that meet condition (8) to rounding."""
        return self.space.adjust(y, self.conditions) if len(self.conditions.offset) else y

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
    ) -> Speed | Unsolved:
        """Compute the speed of least cost within bounds.

        Beside y there are unknowns at the points with a weight: r <= z^(1/2), for the duration v >= 1 / r,
        for the energy e >= |torque|^2 / r. `peak` is the largest torque or squared speed that counts for the
        goal.

        Args:
            goal: "time", "peak_torque", "energy"; "peak_speed" or "limits", the least multiple of the speed
                limits or of all limits; "bend", the integral of (d2z/dsigma2)^2; "slowness", that of
                `weights` z.
            floor, cap: of the `positive` rows [1/s^2], a number and (m,).
            weights: (P,) at the points with a weight.
            about: y (n,) and a duration [s], which the tangent of T(z) at y must not fall below.
        """
        scale = units.time**2
        timed = goal == "time" or bounds.longest is not None
        powered = goal == "energy" or bounds.energy is not None
        count = self.z.shape[0]
        sizes = {"y": self.basis.size, "peak": 1}
        sizes |= {"r": count} if timed or powered else {}
        sizes |= {"v": count} if timed else {}
        sizes |= {"e": count} if powered else {}
        equal = [_limit_entries(AffineRows({"y": self.conditions.matrix / scale}, self.conditions.offset))]
        positive = self.positive[0]
        nonnegative = [AffineRows({"y": positive}, np.full(positive.shape[0], -floor * scale))]
        nonnegative += self._limit_rows(goal, bounds, units)
        if cap is not None:
            capped = np.flatnonzero(np.isfinite(cap))
            nonnegative.append(AffineRows({"y": -positive[capped]}, cap[capped] * scale))
        if bounds.longest is not None:
            nonnegative.append(self._integral_bound("v", bounds.longest / units.time))
        if bounds.energy is not None:
            nonnegative.append(self._integral_bound("e", bounds.energy / (units.torque**2 * units.time)))
        if about is not None:
            nonnegative.append(self._duration_tangent(*about, units))
        square = self.bend if goal == "bend" else None
        if square is not None:  # in the unit of its own size
            size = np.sqrt(np.mean(np.square(square.parts["y"].data)) * count)
            square = AffineRows({"y": square.parts["y"] / size}, square.offset)
        program = ConeProgram(
            sizes,
            self._linear_cost(goal, weights),
            square,
            equal,
            nonnegative,
            self._cones(units, timed=timed, powered=powered),
        )
        optimum = solve_cone_program(program)
        if isinstance(optimum, Unsolved):
            return optimum
        y = self.meet_conditions(optimum.unknowns["y"] / scale)
        inside = self.weights[self._integrated]
        value = float(inside @ optimum.unknowns["v"]) * units.time if goal == "time" else np.nan
        return self.speed(y, value)._replace(floor=floor)

    def _linear_cost(self, goal: str, weights: Array | None) -> dict[str, Array]:
        """Return the cost of each unknown by a goal; none for "bend", whose cost is quadratic."""
        inside = self.weights[self._integrated]
        match goal:
            case "time":
                return {"v": inside}
            case "energy":
                return {"e": inside}
            case "slowness":
                assert weights is not None
                return {"y": (inside * weights) @ self.z}
            case "bend":
                return {}
        return {"peak": np.ones(1)}

    def _integral_bound(self, name: str, largest: float) -> AffineRows:
        """Return largest - the integral of an unknown at the points with a weight."""
        weights = self.weights[self._integrated]
        return AffineRows({name: sparse.csr_array(-weights[None])}, np.array([largest]))

    def _duration_tangent(self, y: Array, duration: float, units: Units) -> AffineRows:
        """Return T_lin(z) - duration, with the tangent T_lin of the duration at the coefficients y.

        T = integral of z^(-1/2), so that T_lin(z) = integral of 1.5 z_0^(-1/2) - 0.5 z_0^(-3/2) z.
        """
        inside = self.weights[self._integrated]
        z = self.z @ y * units.time**2
        slope = sparse.csr_array((-0.5 * inside * z**-1.5)[None]) @ self.z
        return AffineRows({"y": slope}, np.array([1.5 * inside @ z**-0.5 - duration / units.time]))

    def _limit_rows(self, goal: str, bounds: Bounds, units: Units) -> list[AffineRows]:
        """Return bounds of torques and squared speeds as rows that may not be negative.

        A share of a torque limit may be less than what holds the robot at an end, whatever the law. There the
        holding torque is allowed, up to the limit itself.
        """
        limit, ends = self.problem.specification.torque_limit, [0, len(self.xi) - 1]
        rows, scale = [], units.time**2
        for motor, (matrix, offset) in enumerate(self.rows.torque):
            unit = self.problem.reference[motor] * units.torque
            largest = np.inf if bounds.peak is None else bounds.peak / units.torque
            limited = bool(np.isfinite(limit[motor]))
            if bounds.torque_limits and limited and goal != "limits":
                holding = min(np.abs(offset[ends]).max(), limit[motor])
                largest = min(largest, max(bounds.share * limit[motor], holding) / unit)
            torque = AffineRows({"y": matrix / (unit * scale)}, offset / unit)
            if goal == "peak_torque" or (goal == "limits" and limited):
                rows += _bound_by_peak(torque, bounds.share if goal == "limits" else 1.0)
            if np.isfinite(largest):
                rows += _bound_size(torque, largest)
        for matrix in self.rows.squared_speed:
            parts, largest = {"y": -(matrix / scale)}, bounds.share**2
            if goal in ("peak_speed", "limits"):
                parts, largest = {**parts, "peak": _column(matrix, 1.0)}, 0.0
            rows.append(_limit_entries(AffineRows(parts, np.full(matrix.shape[0], largest))))
        return rows

    def _cones(self, units: Units, *, timed: bool, powered: bool) -> list[list[AffineRows]]:
        """Return r^2 <= z, v r >= 1 and e r >= |torque|^2 at the points with a weight."""
        count = self.z.shape[0]
        cones: list[list[AffineRows]] = []
        if timed or powered:
            z_plus_and_minus_1 = [AffineRows({"y": self.z}, np.full(count, offset)) for offset in (1.0, -1.0)]
            twice_r = AffineRows({"r": 2.0 * sparse.identity(count, format="csr")}, np.zeros(count))
            cones.append([*z_plus_and_minus_1, twice_r])
        if timed:
            cones.append(_product_cone("v", "r", count, [AffineRows({}, np.full(count, 2.0))]))
        if powered:
            inside, scale = self._integrated, units.time**2
            unit = self.problem.reference * units.torque
            twice_torque = [
                AffineRows({"y": 2.0 * matrix[inside] / (unit[j] * scale)}, 2.0 * offset[inside] / unit[j])
                for j, (matrix, offset) in enumerate(self.rows.torque)
            ]
            cones.append(_product_cone("e", "r", count, twice_torque))
        return cones


def _cells_about(cells: Array, places: Array) -> BoolArray:
    """Return a mask (k,) of the cells in which a place lies."""
    return np.asarray(((cells[:-1, None] < places) & (places < cells[1:, None])).any(axis=1))


def _gauss_points(cells: Array, counts: Array) -> tuple[Array, Array]:
    """Return Gauss points of each cell and both ends of all, with weights in xi, zero at the ends."""
    xi, weights = [np.array([-1.0])], [np.zeros(1)]
    for low, high, count in zip(cells[:-1], cells[1:], counts, strict=True):
        points, weight = _gauss_legendre(int(count))
        xi.append(0.5 * (low + high) + 0.5 * (high - low) * points)
        weights.append(0.5 * (high - low) * weight)
    return np.concatenate([*xi, [1.0]]), np.concatenate([*weights, [0.0]])


@lru_cache(maxsize=8)
def _gauss_legendre(count: int) -> tuple[Array, Array]:
    """Return Gauss points (count,) on [-1, 1] and their weights."""
    points, weights = legendre.leggauss(count)
    return read_only(points), read_only(weights)


def _interpolation(xi: Array, through: Array, place: float) -> Array:
    """Return the weights (M,) of Lagrange's polynomial at a place, through some of the points.

    The weight of point i is the product of (place - x_j) / (x_i - x_j) over all others.

    Args:
        through: indices (k,) of these points.
    """
    points = xi[through]
    denominators = points[:, None] - points + np.eye(len(points))
    numerators = np.tile(place - points, (len(points), 1))
    np.fill_diagonal(numerators, 1.0)
    weights = np.zeros(len(xi))
    weights[through] = numerators.prod(axis=1) / denominators.prod(axis=1)
    return weights


def _limit_entries(rows: AffineRows) -> AffineRows:
    """Scale down the rows with entries of y above MAX_ROW_SIZE, so that the largest of each is that."""
    if not len(rows.offset):
        return rows
    largest = np.abs(rows.parts["y"]).max(axis=1).toarray().ravel()
    factors = 1.0 / np.maximum(1.0, largest / MAX_ROW_SIZE)
    scaling = sparse.diags_array(factors)
    return AffineRows({name: scaling @ matrix for name, matrix in rows.parts.items()}, factors * rows.offset)


def _bound_size(rows: AffineRows, largest: float) -> list[AffineRows]:
    """Return |rows| <= largest as rows that may not be negative."""
    return [
        _limit_entries(AffineRows({"y": sign * rows.parts["y"]}, sign * rows.offset + largest))
        for sign in (-1.0, 1.0)
    ]


def _bound_by_peak(rows: AffineRows, share: float) -> list[AffineRows]:
    """Return |rows| <= share * peak as rows that may not be negative."""
    peak = _column(rows.parts["y"], share)
    return [
        _limit_entries(AffineRows({"y": sign * rows.parts["y"], "peak": peak}, sign * rows.offset))
        for sign in (-1.0, 1.0)
    ]


def _column(matrix: Any, value: float) -> Any:
    """Return a sparse column of one value with as many rows as a matrix."""
    return sparse.csr_array(np.full((matrix.shape[0], 1), value))


def _product_cone(first: str, second: str, count: int, others: Sequence[AffineRows]) -> list[AffineRows]:
    """Return the cone 4 first * second >= |others|^2: first + second >= |(first - second, others)|."""
    one = sparse.identity(count, format="csr")
    zero = np.zeros(count)
    return [
        AffineRows({first: one, second: one}, zero),
        AffineRows({first: one, second: -one}, zero),
        *others,
    ]
