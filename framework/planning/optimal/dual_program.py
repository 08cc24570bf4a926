"""Bounds of every law by Lagrange duality, and the cone program that makes these bounds sharp.

A law that advances has z = s'^2 > 0 within (0, 1); its z at both ends is given, 0 at rest. Its torques over
their reference are c + cz z + cu u + d sqrt(z) with u = z'/2 (`path_series`). For any multipliers nu(s) with
a continuous p = nu . cu / 2, integration of p z' by parts leaves

    integral of nu . torque = B + integral of nu . c + (nu . cz - p') z + (nu . d) sqrt(z),
    B = p(1) z(1) - p(0) z(0).

Let mu, lambda >= 0, and let k z <= 1 be the squared speeds over their limits. With

    factor = nu . cz - p' + mu . k >= 0,     C(F, w) = least of F z + w z^(1/2) + lambda z^(-1/2) over z > 0

the peak P of the torques and the duration T = integral of z^(-1/2) of every law are bounded by

    P integral of |nu|_1 + lambda T >= B + integral of nu . c - mu + C(factor, nu . d).

With T <= D this bounds P from below; with P <= 1 it bounds T. The bound is computed from the multipliers, and
all errors of the series lower it: no proof relies on the solver that found the multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import block_diag, csr_array, diags_array, eye_array, hstack, kron

from framework.numerics.arrays import Array
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
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.path_series import PathSeries

# of x; the error of the factor is of the order of the cells' width with degree 1, of its square with degree 2
MULTIPLIER_DEGREE = 2
SIZE = DEGREE + MULTIPLIER_DEGREE + 1  # number of coefficients of a product of a function and a multiplier
HALVINGS = 2  # of each cell, for the bound of the integral of |nu|
SUM_ROUNDING = 1e-12  # rounding error of a sum, over the sum of sizes of its terms
SOLVER_ERROR = 1e-7  # by which a solution may violate the rows of the program
# degree elevation to SIZE Bernstein coefficients: of a series, of a line, of the slope of x
_ELEVATED_SERIES, _ELEVATED_LINE = elevation_matrix(DEGREE, SIZE - 1), elevation_matrix(1, SIZE - 1)
_ELEVATED_SLOPE = elevation_matrix(MULTIPLIER_DEGREE - 1, SIZE - 1)


class Multipliers(NamedTuple):
    """Multipliers on k cells: functions in Bernstein form, and lambda.

    x: coefficients (k, MULTIPLIER_DEGREE + 1, m) of x_i in nu = sum of x_i v_i.
    mu: multipliers (k, n) of the speed limits, constant on each cell.
    minorant: values (k, 2) at both ends of each cell of a line that, shifted by a constant, is below the
        factor.
    lam: lambda.
    """

    x: Array
    mu: Array
    minorant: Array
    lam: float


class Evidence(NamedTuple):
    """The bound that multipliers prove.

    value: the bound of the peak over the reference, or of the duration [s].
    shortfall: how far below zero the factor may be on each cell (k,); the bound is proved if all are 0.
    shares: shares (k,) of the cells in the integral of |nu|_1.
    """

    value: float
    shortfall: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class DualProgram:
    """The search for multipliers of the best bound: a cone program on the cells of a series.

    longest: the largest duration [s] of the laws whose peak is bounded; None without a limit.
    timed: whether the duration of laws with peaks of at most 1 is bounded instead of the peak.
    end_z: z at the start and at the goal.
    """

    series: PathSeries
    longest: float | None
    timed: bool
    end_z: tuple[float, float] = (0.0, 0.0)

    def evaluate_bound(self, multipliers: Multipliers) -> Evidence:
        """Compute the bound that multipliers prove.

        With a lower bound `total` of the right side of the header's inequality,
        P integral of |nu|_1 + lambda T >= total gives P >= (total - lambda longest) / integral of |nu|_1, or
        T >= (total - integral of |nu|_1) / lambda.
        """
        width = self.series.width
        # a line below the factor: its values (k, 2) at both ends of each cell
        least_factor = multipliers.minorant + self._bound_distance(multipliers)[:, None]
        terms = self._bound_terms(multipliers, least_factor)
        norm = self._bound_norm(multipliers.x)
        total_norm = width @ norm  # the integral of |nu|_1
        start_z, goal_z = self.end_z
        p = multipliers.x[..., 0]
        at_ends = np.array([goal_z * p[-1, -1], -start_z * p[0, 0]])  # the terms of B
        rounding = SUM_ROUNDING * ((np.abs(terms) @ width).sum() + np.abs(at_ends).sum() + total_norm)
        total = (terms @ width).sum() + at_ends.sum() - rounding

        if self.timed:
            value = (total - total_norm) / multipliers.lam
        else:
            value = (total - multipliers.lam * (self.longest or 0.0)) / total_norm
        return Evidence(float(value), np.maximum(-least_factor.min(axis=1), 0.0), width * norm / total_norm)

    def _bound_terms(self, multipliers: Multipliers, least_factor: Array) -> Array:
        """Bound the means (3, k) of nu . c, -mu and C(factor, nu . d) on each cell from below.

        C is concave in the factor. Along a line below the factor, `least_factor` (k, 2) at both ends of each
        cell, the mean of C on a cell is therefore at least the mean of its values at both ends.
        """
        damping, damping_error = _sum_products(self.series.damping, multipliers.x)
        least_damping = damping.min(axis=1) - damping_error
        end_costs = _bound_cost(np.maximum(least_factor, 0.0), least_damping[:, None], multipliers.lam)
        constant, constant_error = _sum_products(self.series.constant, multipliers.x)
        mean_constant = constant.mean(axis=1) - constant_error
        return np.stack([mean_constant, -multipliers.mu.sum(axis=1), end_costs.mean(axis=1)])

    def _bound_norm(self, x: Array) -> Array:
        """Bound the mean (k,) of |nu|_1 on each cell from above, with nu = sum of x_i v_i.

        Args:
            x: (k, MULTIPLIER_DEGREE + 1, m) coefficients of x_i.
        """
        v = self.series.v
        nu = multiply(v.coefficients, x[..., None]).sum(axis=2)  # (k, SIZE, m) coefficients
        # |x_i| is at most its largest coefficient, so that v.error (k, m, m) changes |nu|_1 by at most this
        error = (np.abs(x).max(axis=1)[..., None] * v.error).sum(axis=(1, 2))
        return bound_mean_size(nu, HALVINGS).sum(axis=1) + error

    def _bound_distance(self, multipliers: Multipliers) -> Array:
        """Bound factor - minorant from below on each cell (k,).

        All terms of factor = nu . cz - p' + mu . k get SIZE coefficients, the least of which is a bound.
        """
        series = self.series
        x, mu, minorant, _ = multipliers
        p_slope = MULTIPLIER_DEGREE * np.diff(x[..., 0], axis=1) / series.width[:, None]
        speed_terms = (mu[:, None] * series.squared_speed.coefficients).sum(axis=2)  # mu . k
        distance, error = _sum_products(series.per_z, x)  # nu . cz
        distance -= p_slope @ _ELEVATED_SLOPE.T
        distance += speed_terms @ _ELEVATED_SERIES.T
        distance -= minorant @ _ELEVATED_LINE.T
        return distance.min(axis=1) - error - (mu * series.squared_speed.error).sum(axis=1)

    # ------------------------------------------------------------------ the program

    @property
    def factor_error(self) -> Array:
        """The error (k,) that the solver may leave in the factor on each cell."""
        return SOLVER_ERROR * self.p_unit / self.series.width

    def solve(self, margin: Array) -> Multipliers | None:
        """Find multipliers with factor - minorant >= margin (k,) and the best bound; None if unsolved.

        A positive margin covers errors of the solver and of the series, so that the bound can be proved.
        """
        # unknowns of torques, and of speed limits, damping and duration where they count
        draft = ConeProgram()
        # rows (k SIZE, size) of the coefficients of (factor - minorant) times the width, by name of unknowns
        factor = dict[str, Any]()
        self._add_torques(draft, factor)
        if self.series.squared_speed.error.size:
            self._add_speed_limits(draft, factor)
        if self.series.damping.coefficients.any():
            self._add_damping(draft, factor)
        if self.timed or self.longest is not None:
            self._add_duration(draft, factor)

        # factor - minorant - margin >= 0, times the width of the cell, in rows scaled to unit size
        scaling = 1.0 / abs(factor["x"]).max(axis=1).toarray().ravel()
        rows = {name: SparseRows.of(part).scale(scaling) for name, part in factor.items()}
        margins = np.repeat(self.series.width * margin, SIZE)
        draft.nonnegative.append(AffineRows(rows, -scaling * margins))
        optimum = solve_cone_program(draft)
        if isinstance(optimum, Unsolved):
            return None

        # the multipliers: unknowns times their units. The solver may return slightly negative ones
        count = len(self.series.width)
        x = np.reshape(self._x_coefficients @ optimum["x"], (count, MULTIPLIER_DEGREE + 1, -1))
        mu = optimum.get("mu", np.zeros(0)).reshape(-1, count).T * self._mu_unit
        minorant = optimum.get("minorant", np.zeros(2 * count)).reshape(count, 2)
        (lam,) = self._lambda_unit * optimum.get("lam", np.zeros(1))
        scaled_minorant = self.p_unit * self._slowness**3 * minorant
        return Multipliers(x, np.maximum(mu, 0.0), scaled_minorant, max(lam, 0.0))

    def _add_torques(self, draft: ConeProgram, factor: dict[str, Any]) -> None:
        """Add the multipliers nu = sum of x_i v_i of the m torques: unknowns x, and t >= |nu|.

        The bound's right side, which is to be large, has the terms integral of nu . c + B with
        B = p(1) z(1) - p(0) z(0). The factor has nu . cz - p'; p is x_0.

        The bound of a peak is divided by the integral of |nu|_1, which is therefore limited to 1. In a bound
        of the duration this integral is part of the cost.
        """
        series = self.series
        width = series.width  # (k,) of the cells
        unknowns, m = series.v.error.shape[1:]  # number of functions x_i and of torques
        count = len(width) * SIZE  # number of coefficients of a function on all cells

        # the cost -(integral of nu . c) - B: the mean of a function on a cell is that of its coefficients
        nu_c = self._x_rows(series.constant.coefficients)  # (count, size of x)
        cell_means = np.repeat(width / SIZE, SIZE)  # (count,) @ coefficients: the integral of a function
        start_z, goal_z = self.end_z
        start_p, goal_p = self._x_coefficients[[0, -unknowns]].toarray()  # rows (size of x,) of p(0) and p(1)
        draft.sizes["x"] = nu_c.shape[1]
        draft.cost["x"] = -(cell_means @ nu_c) - (goal_z * goal_p - start_z * start_p)

        # the factor nu . cz - p', times the width of each cell
        # a polynomial p of degree d has the slope's coefficients d (p_(j+1) - p_j) / width
        nu_cz = self._x_rows(width[:, None, None] * series.per_z.coefficients)  # (count, size of x)
        slope = MULTIPLIER_DEGREE * _ELEVATED_SLOPE @ np.diff(np.eye(MULTIPLIER_DEGREE + 1), axis=0)
        x_0_slope = np.kron(slope, np.eye(1, unknowns))  # the same from the coefficients of all x_i of a cell
        p_slope = kron(eye_array(len(width)), x_0_slope, format="csr") @ self._x_coefficients
        factor["x"] = nu_cz - p_slope

        # t >= |nu|, coefficient by coefficient; the sum of the means of t bounds the integral of |nu|_1
        draft.sizes["t"] = count * m  # by torque, then by cell
        for j in range(m):
            nu = self._x_rows(series.v.coefficients[..., j] / self._nu_unit[:, None, None])
            t = kron(np.eye(1, m, j), eye_array(count), format="csr")  # selects the coefficients of torque j
            draft.nonnegative.extend([linear_rows(x=sign * nu, t=t) for sign in (-1.0, 1.0)])
        mean = np.full(count * m, 1.0 / count)
        if self.timed:
            draft.cost["t"] = mean
        else:
            draft.nonnegative.append(AffineRows({"t": -csr_array(mean[None])}, np.ones(1)))

    def _add_speed_limits(self, draft: ConeProgram, factor: dict[str, Any]) -> None:
        """Add mu >= 0 of motors with speed limits to cost and factor.

        The factor contains mu . k(s), with one entry for each of the n motors with speed limits, where
        k(s) z <= 1 are the squared speeds over their limits. mu is constant on each cell; its unknowns are
        ordered by motor, then by cell. Rows of the factor are multiplied by the width of their cell, and so
        is mu . k.
        """
        width = self.series.width
        squared_speed = self.series.squared_speed.coefficients  # of k(s), (cells, DEGREE + 1, n)
        count, _, n = squared_speed.shape
        # Bernstein coefficients (cells, SIZE, n) of k(s), elevated to the degree of the factor
        terms = (_ELEVATED_SERIES @ squared_speed) * self._mu_unit * width[:, None, None]
        parts = [block_diag([*terms[..., motor, None]], format="csr") for motor in range(n)]
        factor["mu"] = hstack(parts, format="csr")
        draft.sizes["mu"] = n * count
        draft.cost["mu"] = np.outer(self._mu_unit, width).ravel()
        draft.nonnegative.append(linear_rows(mu=eye_array(n * count, format="csr")))

    def _add_damping(self, draft: ConeProgram, factor: dict[str, Any]) -> None:
        """Add bounds of the damping term (nu . d) sqrt(z).

        The unknowns are not negative and constant on cells. `drag` and `omega` bound the positive and the
        negative part: nu . d >= drag - omega. The part `phi` of the factor is spent on omega:
        phi z - omega sqrt(z) is at least -omega^2 / (4 phi), which is at least -`loss`. What drag adds to the
        bound follows in `_add_drag`.
        """
        width = self.series.width
        count = len(width)
        identity = eye_array(count, format="csr")
        on_cells = kron(identity, np.ones((SIZE, 1)), format="csr")  # a constant as SIZE coefficients
        draft.sizes.update({"omega": count, "drag": count, "phi": count, "loss": count})
        draft.cost["loss"] = width
        factor["phi"] = -self.p_unit * on_cells @ diags_array(width)
        in_unit = np.sqrt(self.p_unit) * on_cells
        damping = self._x_rows(self.series.damping.coefficients)
        omega = linear_rows(omega=identity)
        bounds = linear_rows(x=damping, omega=in_unit, drag=-in_unit)
        draft.nonnegative.extend([bounds, omega, linear_rows(drag=identity)])
        draft.cones.append(product_cone({"loss": identity}, {"phi": identity}, [omega]))

    def _add_duration(self, draft: ConeProgram, factor: dict[str, Any]) -> None:
        """Add lambda, the minorant, and the unknown `cube_root`, which bounds the cost C of the minorant.

        The minorant is a line on each cell below the factor, and C grows with the factor. The least of
        minorant z + lambda z^(-1/2) over z > 0 is 1.5 (2 minorant lambda^2)^(1/3). At both ends of each cell,
        two cones with an auxiliary unknown make cube_root <= (2 minorant lambda^2)^(1/3):
        cube_root^2 <= auxiliary lambda and auxiliary^2 <= 2 minorant cube_root.
        """
        width = self.series.width[:, None]
        count = 2 * len(width)
        identity = eye_array(count, format="csr")
        # the factor less the minorant, a line on each cell with the values of the unknowns at its ends
        lines = -self.p_unit * _ELEVATED_LINE * (width * self._slowness**3)[:, None]
        factor["minorant"] = block_diag([*lines], format="csr")
        draft.sizes.update({"lam": 1, "minorant": count, "cube_root": count, "auxiliary": count})

        # the mean of C on a cell is at least the mean of 1.5 cube_root at its ends, 0.75 of each; the cost is
        # negative because C raises the bound
        end_width = (width * self._slowness).ravel()
        draft.cost["cube_root"] = -0.75 * self._lambda_unit * self.time_unit * end_width

        # the cones auxiliary^2 <= 2 minorant cube_root and cube_root^2 <= auxiliary lambda
        # `product_cone` means 4 first * second >= |others|^2, which halves of the factors turn into 2 and 1
        half_lambda = {"lam": csr_array(np.full((count, 1), 0.5))}
        if "drag" in draft.sizes:  # less the share of lambda that each cell spends on drag, at both its ends
            self._add_drag(draft)
            cell_at_ends = kron(eye_array(len(width), format="csr"), np.ones((2, 1)), format="csr")
            half_lambda["lambda_share"] = -0.5 * cell_at_ends
        auxiliary = linear_rows(auxiliary=identity)
        cube_root = linear_rows(cube_root=identity)
        draft.cones.append(product_cone({"minorant": identity}, {"cube_root": 0.5 * identity}, [auxiliary]))
        draft.cones.append(product_cone({"auxiliary": 0.5 * identity}, half_lambda, [cube_root]))
        if self.timed:  # the bound does not depend on the size of the multipliers: lambda is set to 1
            draft.equal.append(AffineRows({"lam": csr_array(np.ones((1, 1)))}, -np.ones(1)))
        else:
            draft.cost["lam"] = np.array([self._lambda_unit * (self.longest or 0.0)])

    def _add_drag(self, draft: ConeProgram) -> None:
        """Add `lambda_share` and `drag_cost` (k,), by which drag on the k cells raises the bound.

        Drag is the positive part of the damping, see `_add_damping`. A cell spends lambda_share of lambda on
        it: drag z^(1/2) + lambda_share z^(-1/2) is at least 2 (drag lambda_share)^(1/2) for all z > 0. The
        cone drag_cost^2 <= 4 drag lambda_share keeps drag_cost below this least value.
        """
        width = self.series.width
        cell = eye_array(len(width), format="csr")
        draft.sizes.update({"lambda_share": len(width), "drag_cost": len(width)})
        # the units of drag, p_unit^(1/2), and of lambda_share give drag_cost the root of their product
        unit = np.sqrt(np.sqrt(self.p_unit) * self._lambda_unit)
        draft.cost["drag_cost"] = -unit * width  # negative, because drag_cost raises the bound
        drag_cost = linear_rows(drag_cost=cell)
        draft.cones.append(product_cone({"drag": cell}, {"lambda_share": cell}, [drag_cost]))

    # ------------------------------------------------------------------ units and columns of the unknowns

    @cached_property
    def p_unit(self) -> float:
        """The size of p if nu is 1: the median over the cells.

        nu = x_0 v_0 with p = x_0, so that |nu| = 1 gives p = 1 / |v_0|, taken at the left end of each cell.
        """
        return float(1.0 / np.median(np.linalg.norm(self.series.v.coefficients[:, 0, 0], axis=1)))

    @property
    def time_unit(self) -> float:
        """The longest duration [s], or an estimate of the duration at torques of the reference."""
        return self.longest or 3.0 * float(np.sqrt(self.p_unit))

    @property
    def _lambda_unit(self) -> float:
        """The size of lambda if its term in C is as large as that of p."""
        return self.p_unit / self.time_unit**3

    @cached_property
    def _nu_unit(self) -> Array:
        """The size (k,) of nu if all cells have equal shares of the integral of |nu|_1."""
        return 1.0 / (len(self.series.width) * self.series.width)

    @cached_property
    def _mu_unit(self) -> Array:
        """The unit (n,) of mu of each motor with a speed limit.

        In this unit mu . k, a term of the factor, is near p_unit, with the squared speeds k per z over their
        limits. A motor that never moves has the unit p_unit.
        """
        largest = self.series.squared_speed.coefficients.max(axis=(0, 1))
        return self.p_unit / np.where(largest > 0.0, largest, 1.0)

    @cached_property
    def _slowness(self) -> Array:
        """The unit (k, 2) of 1 / (s' T) near the two ends of each cell.

        It is the value of a law with s' proportional to (s (1 - s))^(1/2), a quarter of the width from the
        ends.
        """
        s = self.series.edges[:-1, None] + self.series.width[:, None] * np.array([0.25, 0.75])
        return 1.0 / (np.pi * np.sqrt(s * (1.0 - s)))

    @cached_property
    def _x_coefficients(self) -> Any:
        """The sparse matrix from the unknowns "x" to all coefficients (k, MULTIPLIER_DEGREE + 1, m) of x.

        x_0 is continuous: neighbouring cells share the unknown at their common edge. The other x_i have
        unknowns of their own on each cell. The matrix contains the units of the unknowns.
        """
        count, m = len(self.series.width), self.series.v.error.shape[1]
        size = MULTIPLIER_DEGREE + 1
        # indices of the unknowns of x_0 (k, size), and after them of the other x_i
        continuous = MULTIPLIER_DEGREE * np.arange(count)[:, None] + np.arange(size)
        others = continuous[-1, -1] + 1 + np.arange(count * size * (m - 1))
        columns = np.dstack([continuous, others.reshape(count, size, m - 1)]).ravel()
        units = np.repeat(self._nu_unit, size * m).reshape(count, size, m)
        units[..., 0] = self.p_unit
        return csr_array((units.ravel(), columns, np.arange(len(columns) + 1)))  # one entry in each row

    def _x_rows(self, functions: Array) -> Any:
        """Return rows (k SIZE, number of unknowns "x") of the coefficients of sum f_i x_i.

        Args:
            functions: (k, DEGREE + 1, m) coefficients of f_i.
        """
        weights = product_weights(DEGREE, MULTIPLIER_DEGREE)  # c_j = sum of weights_jab f_a x_b
        blocks = np.einsum("jab,kam->kjbm", weights, functions)  # from coefficient b of x_m to j, on cell k
        return block_diag([*blocks.reshape(len(functions), SIZE, -1)], format="csr") @ self._x_coefficients


def _bound_cost(factor: Array, damping: Array, lam: float) -> Array:
    """Bound C(factor, damping): C(F, w) is the least of F z + w z^(1/2) + lambda z^(-1/2), from below.

    The least is at z = y^2 with 2 F y^3 + w y^2 = lambda. Any y gives a bound; the root gives the sharpest.
    The terms are bounded as follows:

    * with w < 0, w z^(1/2) is at least its tangent w y / 2 + w z / (2 y);
    * with w > 0, a share of lambda gives w z^(1/2) + share z^(-1/2) >= 2 (w share)^(1/2);
    * the remaining F and lambda give F z + lambda z^(-1/2) >= 1.5 (2 F lambda^2)^(1/3).
    """
    y = _cost_minimiser(factor, damping, lam)
    positive = np.maximum(damping, 0.0)
    negative = np.minimum(damping, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        without_root = np.where(negative < 0.0, -np.inf, 0.0)  # y = 0 gives no bound with w < 0
        tangent_slope = np.where(y > 0.0, negative / (2.0 * y), without_root)
    share = np.minimum(positive * y**2, lam)  # the sharpest one if y is the root
    remaining = factor + tangent_slope
    cost = 1.5 * np.cbrt(2.0 * np.maximum(remaining, 0.0) * (lam - share) ** 2)
    cost = cost + 2.0 * np.sqrt(positive * share) + 0.5 * negative * y
    return np.where(remaining >= 0.0, cost, -np.inf)


def _cost_minimiser(factor: Array, damping: Array, lam: float) -> Array:
    """Solve 2 F y^3 + w y^2 = lambda for y by Newton's method from above; 0 without a root.

    F is the factor, w the damping, lambda `lam`. The iterates fall until rounding stops them. The root is
    enlarged by rounding, so that it is no less than the true one.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        # at this y, 2 F y^3 + w y^2 >= lambda
        y = np.cbrt(0.5 * lam / factor) - np.minimum(damping, 0.0) / (2.0 * factor)
        falls = True
        while falls:
            residual = 2.0 * factor * y**3 + damping * y**2 - lam
            step = residual / (6.0 * factor * y**2 + 2.0 * damping * y)
            falls = bool((y - step < (1.0 - SUM_ROUNDING) * y).any())  # not for NaN
            y = y - step
    return np.nan_to_num((1.0 + SUM_ROUNDING) * y, nan=0.0, posinf=0.0)


def _sum_products(functions: Bernstein, x: Array) -> tuple[Array, Array]:
    """Compute the coefficients (k, SIZE) of sum f_i x_i on each cell, and their error (k,).

    The values of a function are between its least and its largest coefficient. Its mean is the mean of its
    coefficients.

    Args:
        functions: the m functions f_i.
        x: coefficients (k, MULTIPLIER_DEGREE + 1, m) of the multipliers x_i.
    """
    total = multiply(functions.coefficients, x).sum(axis=2)
    error = (np.abs(x).max(axis=1) * functions.error).sum(axis=1)
    return total, error
