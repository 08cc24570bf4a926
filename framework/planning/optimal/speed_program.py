"""The cone program of the best law along a path, in the squared speed z.

A law s = phi(sigma(t)) has z = (d sigma/dt)^2 and u = d2 sigma/dt2 = z'/2. The coefficients y of z multiply
B-splines on cells of xi(sigma), or the functions of one Chebyshev series. Splines are positive everywhere if
y >= floor > 0. The relations

    torque = c + cz z + cu u,     duration = integral of v,   v r >= 1,  r^2 <= z,
                                  energy = integral of e,     e r >= |torque|^2

are affine in y or second-order cones. Condition (8) is a sparse equality (see `law_problem`). The torque at a
crossing is interpolated through points of the cell about it.

Source of the unknowns: Verscheure, Demeulenaere, Swevers, De Schutter and Diehl, IEEE TAC 54 (2009).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.dynamics.torque_distribution import second_differences
from framework.laws.squared_speed import ONE_CELL, SpeedBasis, SpeedSpace
from framework.numerics.arrays import Array, IntArray
from framework.numerics.chebyshev import gauss_legendre
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
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.law_problem import LawProblem, MotorRows, condition_rows, motor_rows
from framework.planning.optimal.path_series import cells_about
from framework.tolerances import LIMIT_MARGIN, MAX_END_RATE

# Gauss points of a cell, and of a cell about a crossing or at an end. Their number is even: none is in the
# middle of the cell, where the pole is.
POINTS, POINTS_ABOUT = 4, 8
FINE_PARTS, FINE_POINTS = 4, 8  # parts of a cell, and Gauss points of each, for the integral of a duration
POSITIVE_PARTS = 2  # of the interval between two points, at whose ends a series must be positive
RMS_TOLERANCE = 1e-6  # of programs with RMS limits, whose squared torques may lie anywhere below loose limits
CURVATURE_GAP = 1e-5  # of the smoothest law where the solver stalls; it may be a little less smooth
REST_SHARE = 0.5  # of what springs may move at the ends
# of what springs move there about the law where torques are linear, which may be left: with REST_SHARE alone
# a first law of delta is lost, whose rest falls from 25 to 6.2, 2.8, 1.1 and 0.8
REST_LEFT = 0.3
MAX_ROW_SIZE = 100.0  # of entries in units; rows with larger entries are scaled down
INTERNAL_WEIGHT = 1e-1  # of the bends of internal torques in the cost of a smooth law
NO_INTERNAL = np.empty(0)


class Bounds(NamedTuple):
    """The bounds of a solution besides condition (8), t_s . W_p = 0; None means no bound.

    longest: bounds (m,) of the durations of the stages between required instants [s]; infinite where open.
    peak: bound of all torques over the reference.
    energy: bound of the integral of the sum of (torque over reference)^2 [s].
    torque_limits: whether the torque limits of the specification hold.
    share: share of the limits that may be used.
    """

    longest: Array | None = None
    peak: float | None = None
    energy: float | None = None
    torque_limits: bool = True
    share: float = 1.0 - LIMIT_MARGIN


class Units(NamedTuple):
    """The units of time [s] and of relative torque of a program."""

    time: float
    torque: float


class Speed(NamedTuple):
    """A squared speed with coefficients y (n,) [1/s^2], and its costs.

    durations: (m,) [s] of the stages between required instants.
    peak: of torques over the reference; peak_speed: of motor speeds over their limits; both at the rows.
    energy: [s], the integral of the sum of (torque over reference)^2.
    least_duration: the least duration [s] with the required instants, by the quadrature of the program; NaN
        for other goals than "time".
    floor: [1/s^2], the lower bound of the coefficients of splines, or of the values of a series.
    x: coefficients (n r,) of the internal torques of redundant motors; none if there are no such motors.
    """

    y: Array
    durations: Array
    peak: float
    peak_speed: float
    energy: float
    least_duration: float = np.nan
    floor: float = 0.0
    x: Array = NO_INTERNAL

    @property
    def duration(self) -> float:
        """The duration [s]."""
        return float(self.durations.sum())


@dataclass(frozen=True, eq=False)
class SpeedProgram:
    """The cone program of a problem on cells of xi."""

    problem: LawProblem
    basis: SpeedBasis
    cells: Array  # (k + 1,) edges in xi of the cells with the points; also those of splines, if z has any
    xi: Array  # (M,) points, both ends among them
    weights: Array  # (M,) of integrals over sigma; zero at the ends
    rows: MotorRows  # at the points, then at crossings, then at further_xi
    conditions: Affine  # (k, n)
    further_xi: Array  # (R,) between the points, where a limit was exceeded
    frames: Array | None  # (n, n_a, r) of internal torques, if redundant motors share the load freely

    @staticmethod
    def on_cells(problem: LawProblem, cells: Array) -> SpeedProgram:
        """Build the program on cells (k + 1,) of xi, with rows at points and crossings.

        Each crossing is in the middle of a cell. Cells about a crossing and at the ends have more points,
        because torques change quickly in these cells. A cell in which an instant is required has two halves
        with points of their own, so that integrals end there.
        """
        basis = SpeedBasis.from_cells(cells)
        if problem.degree is not None:  # one series over the whole path, whatever the cells
            basis = SpeedBasis(np.array(ONE_CELL), problem.degree + 1)
        crossings = np.unique(problem.crossing_xi)
        counts = np.where(cells_about(cells, crossings), POINTS_ABOUT, POINTS)
        counts[[0, -1]] = POINTS_ABOUT
        edges = np.union1d(cells, problem.stop_xi)
        parts = np.searchsorted(edges, cells[1:]) - np.searchsorted(edges, cells[:-1])  # (k,)
        counts = np.repeat(np.where(parts > 1, POINTS, counts), parts)
        xi, weights = _integration_points(problem, edges, counts)
        conditions = condition_rows(problem, basis)
        frames = problem.internal_frames(cells)
        rows = motor_rows(problem, basis, conditions, xi, frames)
        limit_weights = _weigh_limits(xi, cells, crossings)
        if limit_weights:
            rows_at_crossings = rows.combine(np.array(limit_weights))
            rows = rows.stack(rows_at_crossings)
        return SpeedProgram(problem, basis, cells, xi, weights, rows, conditions, np.empty(0), frames)

    @property
    def space(self) -> SpeedSpace:
        return SpeedSpace(self.basis, self.problem.task.stretch)

    @cached_property
    def solved_conditions(self) -> Affine:
        """The conditions (k, n) with orthonormal rows for ends in motion.

        The solver stalls on rows of high derivatives, which are nearly parallel.
        """
        count = len(self.problem.conditions)  # of those at crossings
        matrix, offset = self.conditions
        at_ends = matrix.toarray()[count:]
        if not len(at_ends):
            return self.conditions
        # at_ends' = Q R turns the rows into Q' y + R'^-1 offset
        sizes = np.abs(at_ends).max(axis=1)
        Q, R = np.linalg.qr((at_ends / sizes[:, None]).T)
        rows = matrix[slice(count)].append(SparseRows.of(Q.T))
        return Affine(rows, np.append(offset[:count], np.linalg.solve(R.T, offset[count:] / sizes)))

    @cached_property
    def _inner_points(self) -> slice:
        """The slice of the P inner points, all but the ends.

        The ends have the weight zero in integrals.
        """
        return slice(1, len(self.xi) - 1)

    @property
    def _inner_weights(self) -> Array:
        """Weights (P,) of integrals over sigma, at the inner points."""
        return self.weights[self._inner_points]

    @cached_property
    def z(self) -> SparseRows:
        """Rows (P, n) that give the values z = rows @ y at the inner points."""
        return self.basis.matrix(self.xi[self._inner_points])

    @cached_property
    def positive_xi(self) -> Array:
        """The xi (m,) of `positive_rows`: centres of splines; points and middles for a series."""
        return self.basis.centres if self.basis.is_spline else _subdivide(self.xi, POSITIVE_PARTS)

    @cached_property
    def positive_rows(self) -> SparseRows:
        """Rows (m, n) on y that make z positive: coefficients of splines; values of a series."""
        if self.basis.is_spline:
            return SparseRows.identity(self.basis.size)
        return self.basis.matrix(self.positive_xi)

    @cached_property
    def bends(self) -> SparseRows:
        """Compute rows (P, n) on y whose sum of squares is the integral of (d2z/dsigma2)^2.

        A row is d2z/dsigma2 = xi'^2 d2z/dxi2 + xi" dz/dxi at an inner point, times the root of its weight.
        """
        stretch = self.problem.task.stretch
        inside = self._inner_points
        sigma = self.problem.sigma(self.xi)[inside]
        z_xi, z_xi_xi = (self.basis.matrix(self.xi[inside], order) for order in (1, 2))
        bends = z_xi_xi.scale(stretch(sigma, 1) ** 2) + z_xi.scale(stretch(sigma, 2))
        return bends.scale(np.sqrt(self._inner_weights))

    @cached_property
    def curvature(self) -> AffineRows:
        """Compute rows (P, n) of `bends` and of internal torques.

        All rows are divided by their root mean square, so that the cost is near 1, as the solver needs it.
        """
        rows = self.bends
        # the root mean square of the entries, times the root of the number of rows
        size = np.sqrt(np.mean(np.square(rows.values)) * rows.shape[0])
        curvature = rows / size
        if self.frames is None:
            return linear_rows(y=curvature)
        bends = second_differences(self.frames)
        bends = bends * (INTERNAL_WEIGHT / np.sqrt(len(self.frames)))
        return linear_rows(
            y=curvature.append(SparseRows.zeros((bends.shape[0], self.basis.size))),
            x=SparseRows.zeros((curvature.shape[0], bends.shape[1])).append(bends),
        )

    @cached_property
    def fine_quadrature(self) -> tuple[SparseRows, Array]:
        """Rows (F, n) of z on y at fine points, and weights (m, F) of integrals over the sigma of stages."""
        cells = _subdivide(np.union1d(self.cells, self.problem.stop_xi), FINE_PARTS)
        counts = np.full(len(cells) - 1, FINE_POINTS)
        xi, weights = _integration_points(self.problem, cells, counts)
        xi, weights = xi[1:-1], weights[1:-1]  # without the ends, whose weights are zero
        return self.basis.matrix(xi), _split_by_stage(self.problem, xi, weights)

    @cached_property
    def stage_weights(self) -> Array:
        """Weights (m, P) of integrals over the sigma of each stage, at the inner points."""
        return _split_by_stage(self.problem, self.xi[self._inner_points], self._inner_weights)

    def extend(self, xi: Array) -> SpeedProgram:
        """Return the program with further rows at xi (R,)."""
        rows = motor_rows(self.problem, self.basis, self.conditions, xi, self.frames)
        return replace(self, rows=self.rows.stack(rows), further_xi=np.append(self.further_xi, xi))

    def evaluate_speed(self, y: Array, x: Array = NO_INTERNAL, least_duration: float = np.nan) -> Speed:
        """Compute durations, peaks and energy of the squared speed z with coefficients y (n,).

        The durations (m,), one for each stage between required instants, are integrals of z^(-1/2) over sigma
        by a fine quadrature. The energy is the integral of |torque|^2 z^(-1/2) at the points of the program,
        with torques over their reference.

        Args:
            x: coefficients (n r,) of internal torques.
            least_duration: the optimum [s] of the goal "time", by the program's quadrature; else NaN.
        """
        fine_z, fine_weights = self.fine_quadrature
        z = fine_z @ y  # (F,)
        durations = fine_weights @ z**-0.5 if z.min() > 0 else np.full(len(fine_weights), np.inf)

        # energy, with z > 0 also where the solver missed it by rounding; peaks at all rows
        torque = np.stack(self.rows.torques(y, x), axis=1) / self.problem.reference
        slowness = np.maximum(self.z @ y, np.finfo(float).tiny) ** -0.5  # dt/d sigma
        power = (torque[self._inner_points] ** 2).sum(axis=1) * slowness
        energy = float(self._inner_weights @ power)
        peak = float(np.abs(torque).max(initial=0.0))
        squared_speeds = [(rows @ y).max() for rows in self.rows.squared_speed]
        peak_speed = float(np.sqrt(max([0.0, *squared_speeds])))
        return Speed(y, durations, peak, peak_speed, energy, least_duration, x=x)

    def squared_torques(self, y: Array) -> Array:
        """Integrate squared torques (n_a,) [N^2 m^2 s] over time, for the squared speed of coefficients y."""
        slowness = np.maximum(self.z @ y, np.finfo(float).tiny) ** -0.5  # dt/d sigma
        torque = np.stack([row(y) for row in self.rows.torque], axis=1)[self._inner_points]
        return np.asarray((self._inner_weights * slowness) @ torque**2)

    def minimise(
        self,
        goal: str,
        bounds: Bounds,
        units: Units,
        *,
        floor: Array | float = 0.0,
        cap: Array | float = np.inf,
        about: tuple[Array, Array, bool] | None = None,
        stage: int = -1,
        tolerance: float = TOLERANCE,
        model: tuple[dict[str, Array], AffineRows] | None = None,
    ) -> Speed | Unsolved:
        """Compute the speed of least cost within bounds.

        Besides y, the program has unknowns at the points with a weight: r <= z^(1/2), v >= 1 / r for the
        duration, and e >= |torque|^2 / r for the energy. The unknown `peak` is the largest torque or squared
        speed that counts for the goal.

        Args:
            goal: "time", "peak_torque", "energy"; "peak_speed" or "limits", the least multiple of the speed
                limits or of all limits; "curvature", the integral of (d2z/dsigma2)^2.
            bounds: bounds of duration, peak and energy, and the share of the limits that may be used.
            units: units of time and torque in which the optimum is near 1.
            floor: lower bound of the `positive_rows` [1/s^2], one or (m,).
            cap: upper bound of the `positive_rows` (m,) [1/s^2].
            about: y (n,), durations (m,) [s] of stages, and whether the tangents of T(z) at y must be equal
                to those that are finite; otherwise they must not fall below.
            stage: index of the stage whose duration is least for the goal "time"; the last by default.
            tolerance: relative, of the cost and of the rows.
            model: linear cost and square rows, in the units, in place of those of the goal.
        """
        problem = self.problem
        scale = units.time**2  # the unknown y is in units of 1 / time^2
        timed = goal == "time" or bounds.longest is not None  # whether the duration counts
        # motors whose squared torques count for an energy, by the name of its unknowns
        rms_motors = list[int]()
        drives = problem.specification.drives
        counts = bounds.torque_limits and goal != "limits"
        # over an open duration they count from the second law on, over the time that the first suggests
        if counts and drives is not None and problem.averaging_time is not None:
            rms_motors = np.flatnonzero(np.isfinite(drives.rms_torque_limit)).tolist()
        powers = {f"e{motor}": [motor] for motor in rms_motors}
        if rms_motors:
            tolerance = max(tolerance, RMS_TOLERANCE)
        if goal == "energy" or bounds.energy is not None:
            powers["e"] = list(range(len(self.rows.torque)))

        # the numbers of unknowns; r, v and energies have one for each of the P inner points
        sizes = {"y": self.basis.size, "peak": 1}
        if self.frames is not None:  # (n, n_a, r)
            sizes["x"] = self.frames.shape[0] * self.frames.shape[2]
        pointwise = ["r"] * (timed or bool(powers)) + ["v"] * timed
        sizes |= dict.fromkeys([*pointwise, *powers], self.z.shape[0])

        # rows that must vanish: conditions on the law, each divided by its largest entry if that is large
        matrix, offset = self.solved_conditions
        conditions = AffineRows({"y": matrix / scale}, offset)
        equal = [_scale_large_rows(conditions)]
        # rows that may not be negative: z between its bounds, limits, integrals, motions of springs at ends
        positive = self.positive_rows  # (m, n)
        lowest = np.maximum(floor, np.zeros(positive.shape[0]))  # (m,) [1/s^2]
        highest = np.minimum(cap, np.full(positive.shape[0], problem.max_squared_speed))
        nonnegative = [AffineRows({"y": positive}, -lowest * scale)]
        nonnegative += self._limit_rows(goal, bounds, units)
        capped = np.flatnonzero(np.isfinite(highest))
        if len(capped):
            nonnegative.append(AffineRows({"y": -positive[capped]}, highest[capped] * scale))
        nonnegative += self._bound_integrals(bounds, units, rms_motors)
        if problem.response is not None and problem.response.holds_rest:
            rest = problem.response.rest
            present = float(np.abs(rest(problem.response.y)).max())
            allowed = max(REST_SHARE * MAX_END_RATE, REST_LEFT * present)
            matrix = SparseRows.of(rest.matrix / (allowed * scale))
            nonnegative += _bound_size(AffineRows({"y": matrix}, rest.offset / allowed), 1.0)
        if about is not None:
            y_0, durations, is_equal = about
            tangents = self._duration_tangents(y_0, durations, units)
            (equal if is_equal else nonnegative).append(tangents)

        cost: dict[str, Array] = {"peak": np.ones(1)}
        square = None
        if model is not None:
            cost, square = model
        elif goal == "time":
            cost = {"v": self.stage_weights[stage]}
        elif goal == "energy":
            cost = {"e": self._inner_weights}
        elif goal == "curvature":
            cost, square = {}, self.curvature
        cones = self._cones(units, powers, timed=timed)
        optimum = solve_cone_program(
            ConeProgram(sizes, cost, square, equal, nonnegative, cones),
            tolerance=tolerance,
            stalled_gap=CURVATURE_GAP if goal == "curvature" else 0.0,
        )
        if isinstance(optimum, Unsolved):
            return optimum

        y = optimum["y"] / scale
        if len(conditions.offset):  # met to rounding by the nearest coefficients
            y = self.space.adjust(y, self.conditions)
        least = np.nan
        if goal == "time":
            open_stage = float(self.stage_weights[stage] @ optimum["v"]) * units.time
            least = open_stage + sum(problem.specification.times[-1:])
        x = optimum["x"] * self._internal_unit(units) if self.frames is not None else NO_INTERNAL
        return self.evaluate_speed(y, x, least)._replace(floor=float(np.min(floor)))

    def _bound_integrals(self, bounds: Bounds, units: Units, rms_motors: Sequence[int]) -> list[AffineRows]:
        """Return bounds less integrals of durations and energies, as rows that may not be negative.

        The bound of an RMS torque over the time T is one of the integral of its square: limit^2 T.
        """
        rows = []
        if bounds.longest is not None:
            bounded = np.isfinite(bounds.longest)
            stage_weights = SparseRows.of(-self.stage_weights[bounded])
            rows.append(AffineRows({"v": stage_weights}, bounds.longest[bounded] / units.time))
        largest = dict[str, float]()  # of the integral of each energy, in units
        if bounds.energy is not None:
            largest["e"] = bounds.energy / (units.torque**2 * units.time)
        for motor in rms_motors:
            drives, T = self.problem.specification.drives, self.problem.averaging_time
            assert drives is not None
            assert T is not None
            limit = bounds.share * drives.rms_torque_limit[motor]  # [N m]
            relative = limit / (self.problem.reference[motor] * units.torque)
            largest[f"e{motor}"] = relative**2 * T / units.time
        for name, bound in largest.items():
            weights = SparseRows.of(-self._inner_weights[None])
            rows.append(AffineRows({name: weights}, np.array([bound])))
        return rows

    def _duration_tangents(self, y: Array, durations: Array, units: Units) -> AffineRows:
        """Return the rows T_lin(z) - duration of all stages with a finite duration.

        T_lin is the tangent at z_0 of the duration T = integral of z^(-1/2) over the stage:
        T_lin(z) = integral of 1.5 z_0^(-1/2) - 0.5 z_0^(-3/2) z. Both T, as `evaluate_speed` computes it, and
        T_lin are integrated by the fine quadrature, so that T(z) >= T_lin(z) holds but for rounding. Rows
        are in units of `units.time`.

        Args:
            y: coefficients (n,) of z_0 [1/s^2].
            durations: of the stages (m,) [s]; infinite where open.
            units: units of the program; its unknowns y are in 1 / time^2.
        """
        fine_z, weights = self.fine_quadrature
        z_0 = fine_z @ y * units.time**2  # (F,)
        required = np.isfinite(durations)
        weights = weights[required]
        slopes = np.array([(-0.5 * stage * z_0**-1.5) @ fine_z for stage in weights])
        constant = 1.5 * weights @ z_0**-0.5 - durations[required] / units.time
        return AffineRows({"y": SparseRows.of(slopes)}, constant)

    def _limit_rows(self, goal: str, bounds: Bounds, units: Units) -> list[AffineRows]:
        """Return bounds of torques and squared speeds, as rows that must not be negative.

        The unknown `peak` bounds the torques for the goal "peak_torque", the squared speeds for "peak_speed",
        and both, as a multiple of their limits, for "limits".
        """
        rows = list[AffineRows]()
        limits = self.problem.specification.torque_limit  # (n_a,) [N m]
        counts = goal != "limits" and bounds.torque_limits  # whether the limits themselves hold
        for motor, torque in enumerate(self._torques_in_units(units)):
            limit = limits[motor]
            if goal == "peak_torque":
                rows += _bound_size(torque, peak_share=1.0)
            elif goal == "limits" and np.isfinite(limit):
                rows += _bound_size(torque, peak_share=bounds.share)
            largest = np.inf if bounds.peak is None else bounds.peak / units.torque
            if counts and np.isfinite(limit):
                # every law needs the torque that holds the robot at an end, up to the limit itself
                allowed = max(bounds.share * limit, min(self._holding_torques[motor], limit))
                largest = min(largest, allowed / (self.problem.reference[motor] * units.torque))
            if np.isfinite(largest):
                rows += _bound_size(torque, largest)
        if bounds.torque_limits and goal != "limits":
            for matrix, offset in self.rows.curve:
                curve = AffineRows({"y": -(matrix / units.time**2)}, bounds.share - offset)
                rows.append(_scale_large_rows(curve))
        for matrix in self.rows.squared_speed:  # of a motor, over its squared limit
            parts = {"y": -(matrix / units.time**2)}
            largest = bounds.share**2
            if goal in ("peak_speed", "limits"):
                parts["peak"] = _constant_column(matrix, 1.0)
                largest = 0.0
            rows.append(_scale_large_rows(AffineRows(parts, np.full(matrix.shape[0], largest))))
        return rows

    def _torques_in_units(self, units: Units) -> list[AffineRows]:
        """Return for each motor the rows (M, n) of its torque over its reference, in a program's units."""
        torques = []
        for motor, reference in enumerate(self.problem.reference):
            matrix, offset = self.rows.torque[motor]
            unit = reference * units.torque
            parts = {"y": matrix / (unit * units.time**2)}
            if self.frames is not None:
                parts["x"] = self.rows.internal[motor] * (self._internal_unit(units) / unit)
            torques.append(AffineRows(parts, offset / unit))
        return torques

    def _internal_unit(self, units: Units) -> float:
        """Return the unit [N m] of the internal torques' coefficients in a program of these units."""
        return float(self.problem.reference.min() * units.torque)

    @cached_property
    def _holding_torques(self) -> Array:
        """The larger torques (n_a,) [N m] of both ends at z = u = 0, distributed with the least peak."""
        ends = [0, len(self.xi) - 1]
        torques = np.stack([torque.offset[ends] for torque in self.rows.torque], axis=1)
        return np.asarray(np.abs(self.problem.least_peak(torques, self.xi[ends])).max(axis=0))

    def _cones(
        self, units: Units, powers: Mapping[str, Sequence[int]], *, timed: bool
    ) -> list[list[AffineRows]]:
        """Return the cones of durations and energies at the points with a weight.

        They are, if durations or the powers of motors count, r^2 <= z, v r >= 1 and e r >= |torque|^2. The
        first is 4 z >= (2 r)^2, that is z + 1 >= |(z - 1, 2 r)|, since (z + 1)^2 - (z - 1)^2 = 4 z.
        """
        count = self.z.shape[0]
        identity = SparseRows.identity(count)
        cones: list[list[AffineRows]] = []
        if timed or powers:
            z_plus_and_minus_1 = [AffineRows({"y": self.z}, np.full(count, offset)) for offset in (1.0, -1.0)]
            cones.append([*z_plus_and_minus_1, linear_rows(r=2.0 * identity)])
        if timed:
            two = AffineRows({}, np.full(count, 2.0))  # v r >= 1 is 4 v r >= 2^2, as `product_cone` takes it
            cones.append(product_cone({"v": identity}, {"r": identity}, [two]))
        inside = self._inner_points
        torques = self._torques_in_units(units) if powers else []
        for name, motors in powers.items():
            twice_torque = [
                AffineRows(
                    {part: 2.0 * matrix[inside] for part, matrix in torques[k].parts.items()},
                    2.0 * torques[k].offset[inside],
                )
                for k in motors
            ]
            cones.append(product_cone({name: identity}, {"r": identity}, twice_torque))
        return cones


def _weigh_limits(xi: Array, cells: Array, crossings: Array) -> list[Array]:
    """Return weights (M,) of the values at all points, for each crossing.

    The weighted sum is the limit at the crossing. A torque at a crossing is 0 / 0. Its limit is interpolated
    by the polynomial through the points of the cell about the crossing. A crossing on the edge of two cells
    has no weights.

    Args:
        xi: (M,) points, cell by cell, between the ends -1 and 1, which belong to no cell.
        cells: (k + 1,) edges of the cells.
        crossings: xi of the crossings.
    """
    weights = []
    for crossing in crossings:
        for cell in np.flatnonzero(cells_about(cells, crossing[None])):
            chosen = np.flatnonzero((cells[cell] < xi) & (xi < cells[cell + 1]))
            points = xi[chosen]  # (k,)
            # Lagrange: the product of (crossing - x_j) / (x_i - x_j) over all j other than i
            denominators = points[:, None] - points + np.eye(len(points))  # (k, k)
            numerators = np.tile(crossing - points, (len(points), 1))
            np.fill_diagonal(numerators, 1.0)
            weights.append(np.zeros(len(xi)))
            weights[-1][chosen] = numerators.prod(axis=1) / denominators.prod(axis=1)
    return weights


def _split_by_stage(problem: LawProblem, xi: Array, weights: Array) -> Array:
    """Return the weights (M,) of points xi (M,) for each stage between required instants, (m, M)."""
    stages = np.arange(len(problem.stops) + 1)
    return np.asarray(weights * (np.searchsorted(problem.stop_xi, xi) == stages[:, None]))


def _subdivide(edges: Array, parts: int) -> Array:
    """Cut each of k intervals between edges (k + 1,) in equal parts; return the edges (k parts + 1,)."""
    starts = edges[:-1, None] + np.diff(edges)[:, None] * np.arange(parts) / parts
    return np.append(starts, edges[-1])


def _integration_points(problem: LawProblem, cells: Array, counts: IntArray) -> tuple[Array, Array]:
    """Return points xi (M,), Gauss points and both ends, and weights (M,) of integrals over sigma.

    Since d sigma = d xi / xi', the weights are Gauss weights of integrals over xi, divided by
    xi' = d xi / d sigma. The ends -1 and 1 are points for rows of torques, and have the weight zero.

    Args:
        cells: (k + 1,) edges of the cells in xi.
        counts: (k,) numbers of Gauss points of the cells.
    """
    rules = {count: gauss_legendre(count) for count in set(counts.tolist())}
    local = np.concatenate([rules[count][0] for count in counts.tolist()])  # in [-1, 1] on each cell
    local_weights = np.concatenate([rules[count][1] for count in counts.tolist()])
    middle = np.repeat(0.5 * (cells[:-1] + cells[1:]), counts)
    half_width = np.repeat(0.5 * (cells[1:] - cells[:-1]), counts)
    xi = np.concatenate([[-1.0], middle + half_width * local, [1.0]])
    xi_weights = np.concatenate([[0.0], half_width * local_weights, [0.0]])
    xi_slope = problem.task.stretch(problem.sigma(xi), order=1)  # d xi / d sigma
    return xi, xi_weights / xi_slope


def _scale_large_rows(rows: AffineRows) -> AffineRows:
    """Scale down rows with entries of y above MAX_ROW_SIZE, to this largest entry.

    The solver loses accuracy if rows differ much in size.
    """
    if not len(rows.offset):
        return rows
    largest = rows.parts["y"].largest()
    if largest.max() <= MAX_ROW_SIZE:
        return rows
    factors = 1.0 / np.maximum(1.0, largest / MAX_ROW_SIZE)
    parts = {name: matrix.scale(factors) for name, matrix in rows.parts.items()}
    return AffineRows(parts, factors * rows.offset)


def _bound_size(
    torque: AffineRows, largest: float = 0.0, *, peak_share: float | None = None
) -> list[AffineRows]:
    """Return |torque| <= largest + peak_share * peak as rows that may not be negative.

    `peak` is an unknown of the program. Without a `peak_share` it does not count.
    """
    peak = {} if peak_share is None else {"peak": _constant_column(torque.parts["y"], peak_share)}
    return [
        _scale_large_rows(
            AffineRows(
                {**{name: sign * matrix for name, matrix in torque.parts.items()}, **peak},
                sign * torque.offset + largest,
            )
        )
        for sign in (-1.0, 1.0)
    ]


def _constant_column(matrix: SparseRows, value: float) -> SparseRows:
    """Return a column filled with a value, with as many rows as a matrix."""
    return SparseRows.of(np.full((matrix.shape[0], 1), value))
