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

from framework.numerics.arrays import Array, IntArray
from framework.numerics.bernstein import (
    DEGREE,
    Bernstein,
    bound_mean_size,
    elevation_matrix,
    multiply,
    product_weights,
)
from framework.numerics.cone_program import (
    AffineRows,
    ConeProgram,
    Unsolved,
    linear_rows,
    product_cone,
    solve_cone_program,
)
from framework.planning.optimal.path_series import PathSeries

MULTIPLIER_DEGREE = 2  # of x: with 1 the factor is off by the size of the cells, with 2 by its square
SIZE = DEGREE + MULTIPLIER_DEGREE + 1  # coefficients of a product
HALVINGS = 2  # of cells on which |nu| is integrated
SUM_ROUNDING = 1e-12  # of a sum, over the sizes of its terms
MAX_NEWTON_STEPS = 20
SOLVER_ERROR = 1e-7  # of rows of the program
# from coefficients of a function to its SIZE coefficients: of a series, of a line, of the slope of x
_ELEVATED_SERIES, _ELEVATED_LINE = elevation_matrix(DEGREE, SIZE - 1), elevation_matrix(1, SIZE - 1)
_ELEVATED_SLOPE = elevation_matrix(MULTIPLIER_DEGREE - 1, SIZE - 1)


class Multipliers(NamedTuple):
    """Multipliers on k cells: lambda, and functions in Bernstein form.

    x: (k, MULTIPLIER_DEGREE + 1, m) of nu = sum of x_i v_i.
    mu: (k, n), constant on each cell.
    minorant: (k, 2), linear on each cell; added to a constant, each lies below the factor.
    """

    x: Array
    mu: Array
    minorant: Array
    lam: float


class Evidence(NamedTuple):
    """The bound that multipliers prove.

    lacking: (k,), by how much the factor may be negative on each cell; the bound is proved where all are 0.
    shares: (k,), the part of each cell in the integral of |nu|_1.
    """

    value: float
    lacking: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class DualProgram:
    """The search for multipliers of the best bound, a cone program.

    Its cells are those of a series.

    longest: the duration [s] that a bound of the peak may count on.
    timed: whether the bound is of the duration, with peaks of at most 1, instead.
    """

    series: PathSeries
    longest: float | None
    timed: bool

    def evaluate_bound(self, multipliers: Multipliers) -> Evidence:
        """Compute the bound that multipliers prove.

        P integral of |nu|_1 + lambda T >= total gives P >= (total - lambda longest) / integral of |nu|_1, or
        T >= (total - integral of |nu|_1) / lambda.
        """
        width = self.series.width
        # (k, 2) at both ends of each cell
        least_factor = multipliers.minorant + self._bound_distance(multipliers)[:, None]
        terms = self._bound_terms(multipliers, least_factor)
        norm = self._bound_norm(multipliers.x)
        total_norm = float(width @ norm)  # the integral of |nu|_1
        rounding = SUM_ROUNDING * float((np.abs(terms) @ width).sum() + total_norm)
        total = float((terms @ width).sum()) - rounding
        if self.timed:
            value = (total - total_norm) / multipliers.lam
        else:
            value = (total - multipliers.lam * (self.longest or 0.0)) / total_norm
        return Evidence(value, np.maximum(-least_factor.min(axis=1), 0.0), width * norm / total_norm)

    def _bound_terms(self, multipliers: Multipliers, least_factor: Array) -> Array:
        """Bound the means (3, k) of the terms of the bound from below.

        The terms on each cell are nu . c, -mu and C(factor, nu . d). C is concave in the factor: on a line
        below the factor, its mean is at least that of both ends.

        Args:
            least_factor: of the line at both ends (k, 2).
        """
        x = multipliers.x
        series = self.series
        least_damping, _ = _bound_sum(series.damping, x)
        end_costs = _least_cost(np.maximum(least_factor, 0.0), least_damping[:, None], multipliers.lam)
        _, mean_constant = _bound_sum(series.constant, x)
        return np.stack([mean_constant, -multipliers.mu.sum(axis=1), end_costs.mean(axis=1)])

    def _bound_norm(self, x: Array) -> Array:
        """Bound the mean (k,) of |nu|_1 on each cell from above."""
        v = self.series.v
        nu = multiply(v.coefficients, x[..., None]).sum(axis=2)
        error = (np.abs(x).max(axis=1)[..., None] * v.error).sum(axis=(1, 2))
        return bound_mean_size(nu, HALVINGS).sum(axis=1) + error

    def _bound_distance(self, multipliers: Multipliers) -> Array:
        """Bound factor - minorant from below on each cell (k,).

        factor = nu . cz - p' + mu . k, each as SIZE coefficients on a cell.
        """
        series = self.series
        x = multipliers.x
        mu = multipliers.mu
        p_slope = MULTIPLIER_DEGREE * np.diff(x[..., 0], axis=1) / series.width[:, None]
        distance = multiply(series.per_z.coefficients, x).sum(axis=2) - p_slope @ _ELEVATED_SLOPE.T
        speed_terms = (mu[:, None] * series.squared_speed.coefficients).sum(axis=2)
        distance += speed_terms @ _ELEVATED_SERIES.T
        distance -= multipliers.minorant @ _ELEVATED_LINE.T
        error = (np.abs(x).max(axis=1) * series.per_z.error).sum(axis=1)
        return distance.min(axis=1) - error - (mu * series.squared_speed.error).sum(axis=1)

    # ------------------------------------------------------------------ the program

    @property
    def factor_error(self) -> Array:
        """The error (k,) of the factor that the solver may leave on each cell."""
        return SOLVER_ERROR * self.p_unit / self.series.width

    def solve(self, margin: Array) -> Multipliers | None:
        """Find multipliers with factor - minorant >= margin (k,) and the best bound.

        None if unsolved.
        """
        draft = _Draft()
        self._add_torques(draft)
        if self.series.squared_speed.error.size:
            self._add_speed_limits(draft)
        if self.series.damping.coefficients.any():
            self._add_damping(draft)
        if self.timed or self.longest is not None:
            self._add_duration(draft)
        # rows of unit size: factor - minorant - margin >= 0, times the width of the cell
        scaling = 1.0 / abs(draft.factor["x"]).max(axis=1).toarray().ravel()
        rows = {
            name: sparse.csr_array(sparse.diags_array(scaling) @ part) for name, part in draft.factor.items()
        }
        draft.nonnegative.append(AffineRows(rows, -scaling * np.repeat(self.series.width * margin, SIZE)))
        program = ConeProgram(
            draft.sizes, draft.cost, equal=draft.equal, nonnegative=draft.nonnegative, cones=draft.cones
        )
        optimum = solve_cone_program(program)
        return None if isinstance(optimum, Unsolved) else self._from_unknowns(optimum)

    def _from_unknowns(self, unknowns: Mapping[str, Array]) -> Multipliers:
        """Return the multipliers of a solution, multiplied by their units; zero where not sought."""
        count = len(self.series.width)
        x = np.stack([unknowns["x"][columns] for columns in self._x_columns], axis=2)
        x[..., 0] *= self.p_unit
        x[..., 1:] *= self._nu_unit[:, None, None]
        mu = unknowns.get("mu", np.zeros(0)).reshape(-1, count).T * self._mu_unit
        minorant = unknowns.get("minorant", np.zeros(2 * count)).reshape(count, 2)
        minorant = self.p_unit * self._slowness**3 * minorant
        lam = self._lambda_unit * float(unknowns.get("lam", np.zeros(1))[0])
        return Multipliers(x, np.maximum(mu, 0.0), minorant, max(lam, 0.0))

    def _add_torques(self, draft: _Draft) -> None:
        """Add x to the cost and the factor, and t >= |nu|.

        The cost has nu . c, the factor nu . cz - p'. A bound of the peak is per integral of |nu|_1, so that
        this is at most 1. For a bound of the duration it is part of the cost. On a cell p' has the
        coefficients MULTIPLIER_DEGREE (p_(i+1) - p_i) / width.
        """
        series = self.series
        m = self.series.v.error.shape[2]
        count = len(series.width) * SIZE  # coefficients of a function on all cells
        # the cost -nu . c: the mean of a function on a cell is the mean of its coefficients
        nu_c = self._x_rows(series.constant.coefficients)
        draft.sizes |= {"x": nu_c.shape[1], "t": count * m}
        draft.cost["x"] = -np.repeat(series.width / SIZE, SIZE) @ nu_c
        # the factor nu . cz - p'
        nu_cz = self._x_rows(series.width[:, None, None] * series.per_z.coefficients)
        slope = MULTIPLIER_DEGREE * _ELEVATED_SLOPE @ np.diff(np.eye(MULTIPLIER_DEGREE + 1), axis=0)
        slopes = np.broadcast_to(self.p_unit * slope, (len(series.width), *slope.shape))
        draft.factor["x"] = nu_cz - _block_rows(slopes, self._x_columns[0], nu_c.shape[1])
        # t >= |nu|, coefficient by coefficient
        for j in range(m):
            nu = self._x_rows(series.v.coefficients[..., j] / self._nu_unit[:, None, None])
            t = sparse.csr_array(sparse.kron(np.eye(1, m, j), sparse.identity(count)))  # of motor j
            draft.nonnegative += [linear_rows(x=sign * nu, t=t) for sign in (-1.0, 1.0)]
        norm = np.full(count * m, 1.0 / count)  # of t: the integral of |nu|_1
        if self.timed:
            draft.cost["t"] = norm
        else:
            draft.nonnegative.append(AffineRows({"t": -sparse.csr_array(norm[None])}, np.ones(1)))

    def _add_speed_limits(self, draft: _Draft) -> None:
        """Add mu >= 0 (k, n) of motors with speed limits, and mu . k to the factor.

        mu is constant on cells. Terms are integrals over cells, so that mu . k counts times the width.
        """
        width = self.series.width
        squared_speed = self.series.squared_speed.coefficients
        count, _, n = squared_speed.shape
        terms = (_ELEVATED_SERIES @ squared_speed) * self._mu_unit * width[:, None, None]  # (k, SIZE, n)
        columns = np.arange(count)[:, None]
        parts = [_block_rows(terms[..., motor, None], columns, count) for motor in range(n)]
        draft.factor["mu"] = sparse.hstack(parts, format="csr")
        draft.sizes["mu"] = n * count
        draft.cost["mu"] = np.outer(self._mu_unit, width).ravel()
        identity = sparse.identity(n * count, format="csr")
        draft.nonnegative.append(linear_rows(mu=identity))

    def _add_damping(self, draft: _Draft) -> None:
        """Add bounds of the damping term (nu . d) sqrt(z).

        The unknowns drag, omega, phi, loss >= 0 are constant on cells. nu . d >= drag - omega. The factor
        gives phi away, so that phi z - omega sqrt(z) >= -omega^2 / (4 phi) is at least -loss. `_add_duration`
        makes use of drag.
        """
        width = self.series.width
        count = len(width)
        identity = sparse.identity(count, format="csr")
        on_cells = sparse.kron(identity, np.ones((SIZE, 1)), format="csr")
        draft.sizes |= {"omega": count, "drag": count, "phi": count, "loss": count}
        draft.cost["loss"] = width
        draft.factor["phi"] = -self.p_unit * on_cells @ sparse.diags_array(width)
        in_unit = np.sqrt(self.p_unit) * on_cells
        damping = self._x_rows(self.series.damping.coefficients)
        omega = linear_rows(omega=identity)
        draft.nonnegative += [
            linear_rows(x=damping, omega=in_unit, drag=-in_unit),
            omega,
            linear_rows(drag=identity),
        ]
        draft.cones.append(product_cone({"loss": identity}, {"phi": identity}, [omega]))

    def _add_duration(self, draft: _Draft) -> None:
        """Add lambda, the minorant, and the bound `slow` of its costs.

        At both ends of each cell `slow` <= (2 minorant lambda^2)^(1/3), so that 1.5 slow is the least of
        minorant z + lambda z^(-1/2). Two cones bound it: slow^2 <= root lambda and root^2 <= 2 minorant slow.
        """
        width = self.series.width
        count = 2 * len(width)
        ends = np.arange(count).reshape(-1, 2)
        identity = sparse.identity(count, format="csr")
        lines = -self.p_unit * _ELEVATED_LINE * (width[:, None] * self._slowness**3)[:, None]
        draft.factor["minorant"] = _block_rows(lines, ends, count)
        draft.sizes |= {"lam": 1, "minorant": count, "slow": count, "root": count}
        end_width = (width[:, None] * self._slowness).ravel()
        draft.cost["slow"] = -0.75 * self._lambda_unit * self.time_unit * end_width
        half_lambda = {"lam": sparse.csr_array(np.full((count, 1), 0.5))}  # less the share of the drag
        if "drag" in draft.sizes:
            half_lambda["share"] = self._add_drag(draft)
        root = linear_rows(root=identity)
        slow = linear_rows(slow=identity)
        draft.cones.append(product_cone({"minorant": identity}, {"slow": 0.5 * identity}, [root]))
        draft.cones.append(product_cone({"root": 0.5 * identity}, half_lambda, [slow]))
        if self.timed:  # multipliers have no size of their own: lambda is 1
            draft.equal.append(AffineRows({"lam": sparse.csr_array(np.ones((1, 1)))}, -np.ones(1)))
        else:
            draft.cost["lam"] = np.array([self._lambda_unit * (self.longest or 0.0)])

    def _add_drag(self, draft: _Draft) -> Any:
        """Add `share` and `dragged`, constant on cells; return -share / 2 as rows (2 k, k) at ends of cells.

        Each cell gives a share of lambda for `dragged`, at most the least 2 (drag share)^(1/2) of
        drag z^(1/2) + share z^(-1/2).
        """
        width = self.series.width
        cell = sparse.identity(len(width), format="csr")
        draft.sizes |= {"share": len(width), "dragged": len(width)}
        draft.cost["dragged"] = -np.sqrt(np.sqrt(self.p_unit) * self._lambda_unit) * width
        draft.cones.append(product_cone({"drag": cell}, {"share": cell}, [linear_rows(dragged=cell)]))
        return -0.5 * sparse.kron(cell, np.ones((2, 1)), format="csr")

    # ------------------------------------------------------------------ units and columns of the unknowns

    @cached_property
    def p_unit(self) -> float:
        """The size of p where nu is 1."""
        return float(1.0 / np.median(np.linalg.norm(self.series.v.coefficients[:, 0, 0], axis=1)))

    @property
    def time_unit(self) -> float:
        """The duration [s], or one of the size that torques of the reference allow."""
        return self.longest or 3.0 * float(np.sqrt(self.p_unit))

    @property
    def _lambda_unit(self) -> float:
        return self.p_unit / self.time_unit**3

    @cached_property
    def _nu_unit(self) -> Array:
        """The size (k,) of nu with equal parts of |nu|_1 on all cells."""
        return 1.0 / (len(self.series.width) * self.series.width)

    @cached_property
    def _mu_unit(self) -> Array:
        """The unit (n,) of mu of each motor with a speed limit."""
        largest = self.series.squared_speed.coefficients.max(axis=(0, 1))
        return self.p_unit / np.where(largest > 0.0, largest, 1.0)

    @cached_property
    def _slowness(self) -> Array:
        """The unit (k, 2) of 1 / (s' T) near the ends of cells.

        That of a law with s' proportional to (s (1 - s))^(1/2).
        """
        low = self.series.edges[:-1, None]
        high = self.series.edges[1:, None]
        s = low + (high - low) * np.array([0.25, 0.75])
        return 1.0 / (np.pi * np.sqrt(s * (1.0 - s)))

    @cached_property
    def _x_columns(self) -> list[IntArray]:
        """The columns (k, MULTIPLIER_DEGREE + 1) of each x_i among the unknowns "x".

        x_0 is continuous: neighbouring cells share the coefficient of their common edge.
        """
        count = len(self.series.width)
        each = MULTIPLIER_DEGREE + 1
        continuous = MULTIPLIER_DEGREE * np.arange(count)[:, None] + np.arange(each)  # edges are shared
        columns = [continuous]
        first = continuous[-1, -1] + 1
        for _ in range(self.series.v.error.shape[2] - 1):
            columns.append(first + np.arange(count * each).reshape(count, each))
            first += count * each
        return columns

    def _x_rows(self, functions: Array) -> Any:
        """Return rows (k SIZE, ...) of the coefficients of sum f_i x_i.

        Args:
            functions: (k, DEGREE + 1, m) coefficients of f_i.
        """
        weights = product_weights(DEGREE, MULTIPLIER_DEGREE)  # c_j = sum of weights_jab f_a x_b
        count = int(self._x_columns[-1][-1, -1]) + 1
        rows = sparse.csr_array((len(functions) * SIZE, count))
        for i, columns in enumerate(self._x_columns):
            unit = self.p_unit if i == 0 else self._nu_unit[:, None, None]
            blocks = unit * np.einsum("jab,ka->kjb", weights, functions[..., i])
            rows = rows + _block_rows(blocks, columns, count)
        return rows


def _least_cost(factor: Array, damping: Array, lam: float) -> Array:
    """Bound from below the least of F z + w z^(1/2) + lambda z^(-1/2).

    The least is at z = y^2 with 2 F y^3 + w y^2 = lambda. Any y gives a bound, and the root the sharpest:
    Newton's method comes to the root from above.
    With w < 0, w z^(1/2) is at least its tangent w y / 2 + w z / (2 y).
    With w > 0, a share of lambda gives w z^(1/2) + share z^(-1/2) >= 2 (w share)^(1/2).
    For what remains, F z + lambda z^(-1/2) >= 1.5 (2 F lambda^2)^(1/3).
    """
    positive = np.maximum(damping, 0.0)
    negative = np.minimum(damping, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        y = np.cbrt(0.5 * lam / factor) - negative / (2.0 * factor)
        for _ in range(MAX_NEWTON_STEPS):
            y = y - (2.0 * factor * y**3 + damping * y**2 - lam) / (6.0 * factor * y**2 + 2.0 * damping * y)
        y = np.nan_to_num((1.0 + SUM_ROUNDING) * y, nan=0.0, posinf=0.0)
        tangent_slope = np.where(y > 0.0, damping / (2.0 * y), np.where(damping < 0.0, -np.inf, 0.0))
    share = np.minimum(positive * y**2, lam)
    remaining = factor + np.minimum(tangent_slope, 0.0)
    cost = 1.5 * np.cbrt(2.0 * np.maximum(remaining, 0.0) * (lam - share) ** 2)
    cost = cost + 2.0 * np.sqrt(positive * share)
    return np.where(remaining >= 0.0, cost + 0.5 * negative * y, -np.inf)


def _bound_sum(functions: Bernstein, x: Array) -> tuple[Array, Array]:
    """Bound the least value and mean (k,) of sum f_i x_i from below.

    There is one of each on each cell.
    """
    total = multiply(functions.coefficients, x).sum(axis=2)
    error = (np.abs(x).max(axis=1) * functions.error).sum(axis=1)
    return total.min(axis=1) - error, total.mean(axis=1) - error


@dataclass
class _Draft:
    """The collected parts of a cone program.

    factor: by unknowns, rows (k SIZE, ...) of the coefficients of (factor - minorant) times the width.
    """

    sizes: dict[str, int] = field(default_factory=dict)
    cost: dict[str, Array] = field(default_factory=dict)
    factor: dict[str, Any] = field(default_factory=dict)
    equal: list[AffineRows] = field(default_factory=list)
    nonnegative: list[AffineRows] = field(default_factory=list)
    cones: list[list[AffineRows]] = field(default_factory=list)


def _block_rows(blocks: Array, columns: IntArray, count: int) -> Any:
    """Return sparse rows (k r, count) of blocks (k, r, c).

    Each block stands at its columns (k, c).
    """
    k, r, _ = blocks.shape
    row = np.broadcast_to(np.arange(k * r).reshape(k, r, 1), blocks.shape)
    column = np.broadcast_to(columns[:, None], blocks.shape)
    return sparse.csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(k * r, count))
