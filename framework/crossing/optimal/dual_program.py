"""Bounds of every law by Lagrange duality, and the cone program whose solution makes them sharp.

A law that advances from rest to rest has z = s'^2 > 0 within (0, 1), zero at the ends, and torques
c + cz z + cu u + d sqrt(z) over their reference, u = z'/2 (`path_series`). For any multipliers nu(s) of which
p = nu . cu / 2 is continuous, integration of p z' by parts leaves

    integral of nu . torque = integral of nu . c + (nu . cz - p') z + (nu . d) sqrt(z).

Let mu, lambda >= 0, and k z <= 1 for the squared speeds over their limits. With

    factor = nu . cz - p' + mu . k >= 0,     C(F, w) = least of F z + w z^(1/2) + lambda z^(-1/2) over z > 0

the peak P of the torques and the duration T = integral of z^(-1/2) of every law are bounded by

    P integral of |nu|_1 + lambda T >= integral of nu . c - mu + C(factor, nu . d):

P where T may be at most D, and T where P may be at most 1. The value is computed from the multipliers, with
all errors of the series against it: nothing rests on the solver that found them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from framework.arrays import Array, IntArray
from framework.crossing.optimal.path_series import PathSeries
from framework.motion.bernstein import (
    DEGREE,
    Bernstein,
    bound_mean_size,
    elevation_matrix,
    multiply,
    product_weights,
)
from framework.motion.cone_program import AffineRows, ConeProgram, Unsolved, solve_cone_program

MULTIPLIER_DEGREE = 2  # of x: with 1 the factor is off by the size of the cells, with 2 by its square
SIZE = DEGREE + MULTIPLIER_DEGREE + 1  # coefficients of a product
HALVINGS = 2  # of cells on which |nu| is integrated
SUM_ROUNDING = 1e-12  # of a sum, over the sizes of its terms
MAX_NEWTON_STEPS = 20
SOLVER_ERROR = 1e-7  # of rows of the program
_ELEVATED, _ELEVATED_LINE = elevation_matrix(DEGREE, SIZE - 1), elevation_matrix(1, SIZE - 1)
_ELEVATED_SLOPE = elevation_matrix(MULTIPLIER_DEGREE - 1, SIZE - 1)


class Multipliers(NamedTuple):
    """Multipliers on k cells: x (k, MULTIPLIER_DEGREE + 1, m) in Bernstein form, mu (k, n) and lambda.

    least: (k, 2), linear functions on the cells below the factor, up to a constant on each.
    """

    x: Array
    mu: Array
    least: Array
    lam: float


class Evidence(NamedTuple):
    """A bound by multipliers: its value, what the factor lacks (k,) to be proved, shares (k,) of |nu|_1."""

    value: float
    lacking: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class DualProgram:
    """The search for multipliers on the cells of a series.

    longest: the duration [s] that a bound of the peak may count on.
    timed: whether the bound is of the duration, with peaks of at most 1, instead.
    """

    series: PathSeries
    longest: float | None
    timed: bool

    def evaluate(self, found: Multipliers) -> Evidence:
        """Compute the bound that multipliers prove."""
        width, size = self.series.width, np.abs(found.x).max(axis=1)
        least = found.least + self._least_factor(found)[:, None]
        damping = _sum_bounds(self.series.damping, found.x)[0]
        cost = _least_cost(np.maximum(least, 0.0), damping[:, None], found.lam).mean(axis=1)
        nu = multiply(self.series.v.coefficients, found.x[..., None]).sum(axis=2)
        norm = bound_mean_size(nu, HALVINGS).sum(axis=1) + (size[..., None] * self.series.v.error).sum(
            axis=(1, 2)
        )
        terms = np.stack([_sum_bounds(self.series.constant, found.x)[1], -found.mu.sum(axis=1), cost])
        length = float(width @ norm)
        total = float((terms @ width).sum()) - SUM_ROUNDING * float((np.abs(terms) @ width).sum() + length)
        if self.timed:
            value = (total - length) / found.lam
        else:
            value = (total - (found.lam * self.longest if self.longest is not None else 0.0)) / length
        return Evidence(value, np.maximum(-least.min(axis=1), 0.0), width * norm / length)

    def _least_factor(self, found: Multipliers) -> Array:
        """Bound the factor less `least` from below on each cell (k,)."""
        series, (x, mu) = self.series, found[:2]
        slopes = MULTIPLIER_DEGREE * np.diff(x[..., 0], axis=1) / series.width[:, None]
        factor = multiply(series.per_z.coefficients, x).sum(axis=2) - slopes @ _ELEVATED_SLOPE.T
        factor += (mu[:, None] * series.squared_speed.coefficients).sum(axis=2) @ _ELEVATED.T
        factor -= found.least @ _ELEVATED_LINE.T
        error = (np.abs(x).max(axis=1) * series.per_z.error).sum(axis=1)
        return factor.min(axis=1) - error - (mu * series.squared_speed.error).sum(axis=1)

    # ------------------------------------------------------------------ the program

    @cached_property
    def unit(self) -> float:
        """The size of p where nu is 1."""
        return float(1.0 / np.median(np.linalg.norm(self.series.v.coefficients[:, 0, 0], axis=1)))

    @property
    def rounding(self) -> Array:
        """What the solver may leave of the factor (k,)."""
        return SOLVER_ERROR * self.unit / self.series.width

    def solve(self, margin: Array) -> Multipliers | None:
        """Find multipliers of the best bound whose factor is larger by a margin (k,) than it has to be."""
        blocks = _Blocks()
        self._add_torques(blocks)
        if self.series.squared_speed.error.size:
            self._add_speed_limits(blocks)
        if self.series.damping.coefficients.any():
            self._add_damping(blocks)
        if self.timed or self.longest is not None:
            self._add_duration(blocks)
        scaling = 1.0 / abs(blocks.factor["x"]).max(axis=1).toarray().ravel()
        rows = {
            name: sparse.csr_array(sparse.diags_array(scaling) @ part) for name, part in blocks.factor.items()
        }
        blocks.nonnegative.append(AffineRows(rows, -scaling * np.repeat(self.series.width * margin, SIZE)))
        program = ConeProgram(blocks.sizes, blocks.cost, None, blocks.equal, blocks.nonnegative, blocks.cones)
        optimum = solve_cone_program(program)
        return None if isinstance(optimum, Unsolved) else self._multipliers(optimum.unknowns)

    def _multipliers(self, found: Mapping[str, Array]) -> Multipliers:
        """Return the unknowns of the program in their own units."""
        count = len(self.series.width)
        x = np.stack([found["x"][columns] for columns in self._columns], axis=2)
        x[..., 0] *= self.unit
        x[..., 1:] *= self._density[:, None, None]
        mu = found.get("mu", np.zeros(0)).reshape(-1, count).T * self._speed_unit
        least = self.unit * self._slowness**3 * found.get("least", np.zeros(2 * count)).reshape(count, 2)
        lam = self._pace * float(found.get("lam", np.zeros(1))[0])
        return Multipliers(x, np.maximum(mu, 0.0), least, max(lam, 0.0))

    def _add_torques(self, blocks: _Blocks) -> None:
        """Add x with the factor that is made of them, and the sizes t of nu."""
        series, m = self.series, self.series.v.error.shape[2]
        count = len(series.width) * SIZE
        gain = self._rows(series.constant.coefficients)
        slope = MULTIPLIER_DEGREE * _ELEVATED_SLOPE @ np.diff(np.eye(MULTIPLIER_DEGREE + 1), axis=0)
        slopes = np.broadcast_to(self.unit * slope, (len(series.width), *slope.shape))
        products = self._rows(series.width[:, None, None] * series.per_z.coefficients)
        blocks.factor["x"] = products - _block_rows(slopes, self._columns[0], gain.shape[1])
        blocks.sizes |= {"x": gain.shape[1], "t": count * m}
        blocks.cost["x"] = -np.repeat(series.width / SIZE, SIZE) @ gain
        for j in range(m):
            nu = self._rows(series.v.coefficients[..., j] / self._density[:, None, None])
            t = sparse.csr_array(sparse.kron(np.eye(1, m, j), sparse.identity(count)))
            blocks.nonnegative += [
                AffineRows({"x": sign * nu, "t": t}, np.zeros(count)) for sign in (-1.0, 1.0)
            ]
        integral = np.full(count * m, 1.0 / count)
        if self.timed:
            blocks.cost["t"] = integral
        else:
            blocks.nonnegative.append(AffineRows({"t": -sparse.csr_array(integral[None])}, np.ones(1)))

    def _add_speed_limits(self, blocks: _Blocks) -> None:
        """Add mu, constant on each cell."""
        width, squared = self.series.width, self.series.squared_speed.coefficients
        count, _, n = squared.shape
        elevated = (_ELEVATED @ squared) * self._speed_unit * width[:, None, None]
        columns = np.arange(count)[:, None]
        parts = [_block_rows(elevated[..., j, None], columns, count) for j in range(n)]
        blocks.factor["mu"] = sparse.hstack(parts, format="csr")
        blocks.sizes["mu"] = n * count
        blocks.cost["mu"] = np.outer(self._speed_unit, width).ravel()
        blocks.nonnegative.append(
            AffineRows({"mu": sparse.identity(n * count, format="csr")}, np.zeros(n * count))
        )

    def _add_damping(self, blocks: _Blocks) -> None:
        """Add drag, omega and phi of cells: nu . d >= drag - omega, phi z - omega sqrt(z) >= -loss."""
        width = self.series.width
        count, one = len(width), sparse.identity(len(width), format="csr")
        each = sparse.kron(one, np.ones((SIZE, 1)), format="csr")
        blocks.sizes |= {"omega": count, "drag": count, "phi": count, "loss": count}
        blocks.cost["loss"] = width
        blocks.factor["phi"] = -self.unit * each @ sparse.diags_array(width)
        each = np.sqrt(self.unit) * each
        damping = {"x": self._rows(self.series.damping.coefficients), "omega": each, "drag": -each}
        blocks.nonnegative.append(AffineRows(damping, np.zeros(count * SIZE)))
        blocks.nonnegative += [AffineRows({name: one}, np.zeros(count)) for name in ("omega", "drag")]
        blocks.cones.append(_product({"loss": one}, {"phi": one}, {"omega": one}))

    def _add_duration(self, blocks: _Blocks) -> None:
        """Add lambda, the least of the factor, linear on each cell, and (2 least lambda^2)^(1/3) at its ends.

        That is `slow`, with slow^2 <= root lambda and root^2 <= 2 least slow. With drag each cell takes a
        share of lambda for (nu . d) z^(1/2) + share z^(-1/2) >= `dragged`.
        """
        width, count = self.series.width, 2 * len(self.series.width)
        ends, one = np.arange(count).reshape(-1, 2), sparse.identity(count, format="csr")
        lines = -self.unit * _ELEVATED_LINE * (width[:, None] * self._slowness**3)[:, None]
        blocks.factor["least"] = _block_rows(lines, ends, count)
        blocks.sizes |= {"lam": 1, "least": count, "slow": count, "root": count}
        blocks.cost["slow"] = -0.75 * self._pace * self.time * (width[:, None] * self._slowness).ravel()
        lam = {"lam": sparse.csr_array(np.full((count, 1), 0.5))}
        if "drag" in blocks.sizes:
            cell = sparse.identity(len(width), format="csr")
            blocks.sizes |= {"share": len(width), "dragged": len(width)}
            lam["share"] = -0.5 * sparse.kron(cell, np.ones((2, 1)), format="csr")
            blocks.cost["dragged"] = -np.sqrt(np.sqrt(self.unit) * self._pace) * width
            blocks.cones.append(_product({"drag": cell}, {"share": cell}, {"dragged": cell}))
        blocks.cones.append(_product({"least": one}, {"slow": 0.5 * one}, {"root": one}))
        blocks.cones.append(_product({"root": 0.5 * one}, lam, {"slow": one}))
        if self.timed:
            blocks.equal.append(AffineRows({"lam": sparse.csr_array(np.ones((1, 1)))}, -np.ones(1)))
        else:
            blocks.cost["lam"] = np.array([self._pace * (self.longest or 0.0)])

    # ------------------------------------------------------------------ units and columns

    @property
    def time(self) -> float:
        """A unit of time [s]: the duration, or one of the size that torques of the reference allow."""
        return self.longest or 3.0 * float(np.sqrt(self.unit))

    @property
    def _pace(self) -> float:
        """The unit of lambda."""
        return self.unit / self.time**3

    @cached_property
    def _density(self) -> Array:
        """The size of nu on each cell (k,) where all cells have the same share of |nu|_1."""
        return 1.0 / (len(self.series.width) * self.series.width)

    @cached_property
    def _speed_unit(self) -> Array:
        """The units (n,) of mu."""
        largest = self.series.squared_speed.coefficients.max(axis=(0, 1))
        return self.unit / np.where(largest > 0.0, largest, 1.0)

    @cached_property
    def _slowness(self) -> Array:
        """1 / s' (k, 2) over the duration near the ends of each cell, where s' ~ (s (1 - s))^(1/2)."""
        low, high = self.series.edges[:-1, None], self.series.edges[1:, None]
        s = low + (high - low) * np.array([0.25, 0.75])
        return 1.0 / (np.pi * np.sqrt(s * (1.0 - s)))

    @cached_property
    def _columns(self) -> list[IntArray]:
        """The unknowns (k, MULTIPLIER_DEGREE + 1) of each x_i; x_0 is continuous."""
        count, each = len(self.series.width), MULTIPLIER_DEGREE + 1
        first = MULTIPLIER_DEGREE * np.arange(count)[:, None] + np.arange(each)
        start, size = first[-1, -1] + 1, count * each
        motors = range(self.series.v.error.shape[2] - 1)
        return [first, *(start + i * size + np.arange(size).reshape(count, each) for i in motors)]

    def _rows(self, functions: Array) -> Any:
        """Return coefficients of the sum of functions (k, DEGREE + 1, m) times x as rows (k SIZE, ...)."""
        weights, count = product_weights(DEGREE, MULTIPLIER_DEGREE), int(self._columns[-1][-1, -1]) + 1
        rows = sparse.csr_array((len(functions) * SIZE, count))
        for i, columns in enumerate(self._columns):
            unit = self.unit if i == 0 else self._density[:, None, None]
            blocks = unit * np.einsum("jab,ka->kjb", weights, functions[..., i])
            rows = rows + _block_rows(blocks, columns, count)
        return rows


def _least_cost(factor: Array, damping: Array, lam: float) -> Array:
    """Bound C(factor, damping) from below, exactly where y is the root of 2 F y^3 + w y^2 = lambda.

    Any y not below it gives a bound, and Newton's method comes from above. With w < 0 it is by the tangent of
    z^(1/2) at y^2, else by w z^(1/2) + share z^(-1/2) >= 2 (w share)^(1/2) with a share of lambda.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        y = np.cbrt(0.5 * lam / factor) + np.maximum(-damping, 0.0) / (2.0 * factor)
        for _ in range(MAX_NEWTON_STEPS):
            y = y - (2.0 * factor * y**3 + damping * y**2 - lam) / (6.0 * factor * y**2 + 2.0 * damping * y)
        y = np.nan_to_num((1.0 + SUM_ROUNDING) * y, nan=0.0, posinf=0.0)
        tangent = np.where(y > 0.0, damping / (2.0 * y), np.where(damping < 0.0, -np.inf, 0.0))
    share = np.minimum(np.maximum(damping, 0.0) * y**2, lam)
    left = factor + np.minimum(tangent, 0.0)
    cost = 1.5 * np.cbrt(2.0 * np.maximum(left, 0.0) * (lam - share) ** 2) + 2.0 * np.sqrt(
        np.maximum(damping, 0.0) * share
    )
    return np.where(left >= 0.0, cost + 0.5 * np.minimum(damping, 0.0) * y, -np.inf)


def _sum_bounds(functions: Bernstein, x: Array) -> tuple[Array, Array]:
    """Bound the least value and the mean (k,) of the sum of functions (k, ..., m) times x from below."""
    total = multiply(functions.coefficients, x).sum(axis=2)
    error = (np.abs(x).max(axis=1) * functions.error).sum(axis=1)
    return total.min(axis=1) - error, total.mean(axis=1) - error


@dataclass
class _Blocks:
    """A cone program in the making; factor: rows (k SIZE, ...) of the factor times the widths."""

    sizes: dict[str, int] = field(default_factory=dict)
    cost: dict[str, Array] = field(default_factory=dict)
    factor: dict[str, Any] = field(default_factory=dict)
    equal: list[AffineRows] = field(default_factory=list)
    nonnegative: list[AffineRows] = field(default_factory=list)
    cones: list[list[AffineRows]] = field(default_factory=list)


def _product(first: dict[str, Any], second: dict[str, Any], root: dict[str, Any]) -> list[AffineRows]:
    """Return the cone 4 first * second >= root^2, row by row."""
    zero = np.zeros(next(iter(root.values())).shape[0])
    negative = {name: -matrix for name, matrix in second.items()}
    return [AffineRows(first | second, zero), AffineRows(first | negative, zero), AffineRows(root, zero)]


def _block_rows(blocks: Array, columns: IntArray, count: int) -> Any:
    """Return blocks (k, r, c) as sparse rows (k r, count) at columns (k, c)."""
    k, size, _ = blocks.shape
    rows = np.broadcast_to(np.arange(k * size).reshape(k, size, 1), blocks.shape)
    places = np.broadcast_to(columns[:, None], blocks.shape)
    return sparse.csr_array((blocks.ravel(), (rows.ravel(), places.ravel())), shape=(k * size, count))
