"""Equations of balance for the coefficients of unknown deflections and of an unknown law.

The unknowns are the deflections l, splines in the parameter of the law, and scalars c of the law. The
residual F of `loaded_balance` is evaluated at more nodes than there are coefficients. A Gauss-Newton step
solves

    F_l dl + F_l' dl' + F_l" dl" + F_c dc = -F

in the least squares. Directions that hardly change F are suppressed.

If springs carry inertia, F = 0 is a differential equation. Some of its solutions decay within milliseconds
near an end or a knot of the path; these belong to motions that do not begin or end at rest. Rates and
accelerations at the ends, and jumps at the knots, are therefore minimised too, with a weight so small that F
does not grow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from framework.dynamics.known_deflections import SPLINE_DEGREE, DeflectionSplines
from framework.dynamics.loaded_balance import (
    DeflectedMotion,
    LoadedBalance,
    deflection_slopes,
    evaluate_balance,
    load_at_rates,
    locked_columns,
    spring_units,
)
from framework.kinematics.continuation.tracking import Branch
from framework.laws.clock import Clock, OnParameter
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array, IntArray
from framework.numerics.banded_rows import BandedFactor, banded_rows, column_sizes
from framework.numerics.ordered_sums import matvec
from framework.tolerances import END_RATE_MISFIT, END_RATE_WEIGHT, WEAK_COLUMN

Family = Callable[[Array], Clock]  # laws by their scalars (k,)


class SampledMotion(NamedTuple):
    """A motion with deflections at the T nodes of splines, and its law."""

    clock: Clock
    prescribed: DeflectedMotion
    bases: Array  # (3, T, SPLINE_DEGREE + 1) of the splines that are not zero: values and time derivatives


class BalanceState(NamedTuple):
    """An iterate: coefficients of the deflections, scalars of the law, and their balance."""

    splines: DeflectionSplines
    series: Array  # (size, n_e) in units of the springs
    scalars: Array  # (k,)
    samples: SampledMotion
    balance: LoadedBalance

    @property
    def cell_misfits(self) -> Array:
        """The largest |F| on each cell (cells,), over the largest load of all."""
        largest = np.zeros(len(self.splines.intervals))
        np.maximum.at(largest, self.splines.nodes.cells, np.abs(self.balance.F).max(axis=1))
        return largest / self.balance.size

    @property
    def misfit(self) -> float:
        """The largest |F|, over the largest load."""
        return float(self.cell_misfits.max())


class Step(NamedTuple):
    """A Gauss-Newton step of the unknowns."""

    series: Array  # (size, n_e)
    scalars: Array  # (k,)
    predicted_misfit: float  # after the step, if F were linear


@dataclass(frozen=True, eq=False)
class LinearBalance:
    """The linearised equations of balance and of rest, in unknowns multiplied by the sizes of columns.

    The normal equations of balance are N = B'B + small^2 with derivatives B of F. Their part of the series is
    banded; the scalars of the law are eliminated last.
    """

    by_series: Any  # sparse (T n_e, C) derivatives of F by the series
    by_scalars: Array  # (T n_e, k) derivatives of F by the law's scalars
    rest: Array  # (rows, C + k) derivatives of the terms that vanish at rest
    sizes: Array  # (C + k,) of the columns before scaling
    factor: BandedFactor  # of the series' part of N
    eliminated: Array  # (C, k) N_series^-1 N_series,scalars
    core: Array  # (k, k) Schur complement of the scalars in N

    @staticmethod
    def factorise(by_series: Any, by_scalars: Array, rest: Array) -> LinearBalance:
        """Scale the columns, and factor the normal equations of balance.

        Columns of the series smaller than their median are scaled by the median.
        """
        series_sizes = column_sizes(by_series)
        series_sizes = np.maximum(series_sizes, np.median(series_sizes))
        scalar_sizes = np.linalg.norm(by_scalars, axis=0)
        scalar_sizes[scalar_sizes == 0.0] = 1.0  # of a scalar that changes nothing
        by_series.data /= series_sizes[by_series.indices]
        by_scalars = by_scalars / scalar_sizes
        sizes = np.append(series_sizes, scalar_sizes)
        factor = BandedFactor.of_squares(by_series, WEAK_COLUMN**2)
        coupling = by_series.T @ by_scalars
        eliminated = factor.solve(coupling)
        weak = WEAK_COLUMN**2 * np.eye(len(scalar_sizes))
        core = by_scalars.T @ by_scalars - coupling.T @ eliminated + weak
        return LinearBalance(by_series, by_scalars, rest / sizes, sizes, factor, eliminated, core)

    @cached_property
    def rest_response(self) -> Array:
        """The matrix N^-1 R' (C + k, rows) of the terms R u of rest."""
        return self._solve_normal(self.rest.T)

    def step(self, state: BalanceState) -> Step:
        """Compute the Gauss-Newton step from a state with the same splines.

        The step y minimises |B y + F|^2 + small^2 |y|^2 + w^2 |R (u + y)|^2 with the unknowns u of the state.
        The weight w falls with the misfit.
        """
        series = state.series
        F = state.balance.F.reshape(-1, 1)
        unknowns = np.append(series, np.zeros(len(state.scalars))) * self.sizes
        weight = min(1.0, state.misfit / END_RATE_MISFIT)
        y = self._least_change(F, self.rest @ unknowns[:, None], weight)
        of_series, of_scalars = np.split(y, [series.size])
        predicted = np.abs(self.by_series @ of_series + self.by_scalars @ of_scalars + F).max()
        step = y[:, 0] / self.sizes
        return Step(
            step[: series.size].reshape(series.shape),
            step[series.size :],
            float(predicted / state.balance.size),
        )

    def follow(self, F: Array) -> Array:
        """Compute changes (C + k, n) that cancel changes F (T n_e, n) of the balance and preserve rest."""
        rest = np.zeros((len(self.rest), F.shape[1]))
        return self._least_change(F, rest, 1.0) / self.sizes[:, None]

    def _least_change(self, F: Array, rest: Array, weight: float) -> Array:
        """Return scaled changes y (C + k, n) for F (T n_e, n) and terms R u of rest (rows, n).

        By Sherman, Morrison and Woodbury y = y_0 - N^-1 R' (1 / w^2 + R N^-1 R')^-1 R (u + y_0), with the
        change y_0 without rest. One factorisation of N thus serves all weights w.
        """
        y = -self._solve_normal(np.concatenate([self.by_series.T @ F, self.by_scalars.T @ F]))  # y_0
        core = np.eye(len(self.rest)) / weight**2 + self.rest @ self.rest_response
        return np.asarray(y - self.rest_response @ np.linalg.solve(core, rest + self.rest @ y))

    def _solve_normal(self, right: Array) -> Array:
        """Solve N y = right (C + k, n)."""
        of_series, of_scalars = np.split(right, [len(self.eliminated)])
        scalars = np.linalg.solve(self.core, of_scalars - self.eliminated.T @ of_series)
        return np.concatenate([self.factor.solve(of_series) - self.eliminated @ scalars, scalars])


class BalanceEquations:
    """The equations F = 0 of a path and a family of laws."""

    def __init__(self, branch: Branch, family: Family, steps: Array) -> None:
        """Store path and laws, and the steps (k,) of differences in the scalars."""
        self.branch = branch
        self.family = family
        self.steps = steps
        self.units = spring_units(branch.robot)
        self.stiffness = float((branch.robot.stiffness * self.units**2).max())  # equal for all springs
        # rates and accelerations of deflections cause forces only if springs carry inertia
        self.orders = 3 if branch.robot.elastic_inertia else 1

    def evaluate(
        self,
        splines: DeflectionSplines,
        series: Array,
        scalars: Array,
        *,
        stiffer: float = 1.0,
        near: Array | None = None,
    ) -> BalanceState:
        """Compute the balance of given unknowns.

        Args:
            stiffer: factor of the robot's spring stiffness.
            near: configurations (T, nq) from which the loops are closed; those of the branch by default.

        Raises:
            NotAssembled: the deflections tear the loops.
        """
        branch = self.branch
        samples = self._sample(splines, series, scalars)
        guess = branch.guess(samples.prescribed.s) if near is None else near
        balance = evaluate_balance(
            branch.robot, samples.prescribed, guess, wrenches=branch.wrenches, stiffer=stiffer
        )
        return BalanceState(splines, series, scalars, samples, balance)

    def _sample(self, splines: DeflectionSplines, series: Array, scalars: Array) -> SampledMotion:
        """Evaluate motion and deflections, with two time derivatives, at the nodes."""
        clock = self.family(scalars)
        return self._prescribe(splines, series, clock, clock.motion(splines.nodes.p))

    def prescribe_at(self, state: BalanceState, z: float, u: float) -> DeflectedMotion:
        """Return the motion at z and u of the law, with the deflections of a state as functions of xi."""
        clock = state.samples.clock
        assert isinstance(clock, OnParameter)
        motion = clock.motion_at(state.splines.nodes.p, z, u)
        return self._prescribe(state.splines, state.series, clock, motion).prescribed

    def _prescribe(
        self,
        splines: DeflectionSplines,
        series: Array,
        clock: Clock,
        motion: tuple[list[Array], Array, Array],
    ) -> SampledMotion:
        """Return motion and deflections at the nodes, from `motion` of the law: s, dp/dt and d2p/dt2."""
        s, rate, acceleration = motion
        bases = _time_bases(splines.nodes.bases, rate, acceleration)
        deflections = [splines.combine(basis, series) * self.units for basis in bases]
        prescribed = DeflectedMotion(s[0], *time_derivatives(self.branch.path, s), *deflections)
        return SampledMotion(clock, prescribed, bases)

    def linearise(self, state: BalanceState) -> LinearBalance:
        """Return the linear equations for steps from this state and from neighbouring states."""
        return LinearBalance.factorise(*self.slopes(state), self._rest_matrix(state))

    def slopes(self, state: BalanceState) -> tuple[Any, Array]:
        """Compute derivatives of F = Y' load by the series, sparse (T n_e, C), and by the scalars (T n_e, k).

        A coefficient c_ji of spring i changes F_e at a node by the sum over the orders o of F_e,oi b_j^(o),
        with b_j^(o) the o-th time derivative of the spline j. Scalars change F by central differences.
        """
        robot = self.branch.robot
        columns, units = locked_columns(robot)
        to_F = state.balance.Y.swapaxes(1, 2)  # (T, n_e, f)
        n_e = robot.n_e

        by_deflections = to_F @ deflection_slopes(robot, state.balance, self.orders)  # (T, n_e, orders n_e)
        by_order = by_deflections.reshape(-1, n_e, self.orders, n_e)
        bases = state.samples.bases[: self.orders].transpose(1, 2, 0)  # (T, SPLINE_DEGREE + 1, orders)
        values = (bases[:, None] @ by_order).reshape(-1, n_e, (SPLINE_DEGREE + 1) * n_e)
        splines = state.splines.nodes.columns
        unknowns = (splines[:, :, None] * n_e + np.arange(n_e)).reshape(len(splines), -1)

        def balance_at(scalars: Array) -> Array:
            """Compute F (T n_e,) with the rates of the law of other scalars."""
            prescribed = self._sample(state.splines, state.series, scalars).prescribed
            load = load_at_rates(robot, state.balance, prescribed)[:, columns] * units
            return matvec(to_F, load).ravel()

        by_scalars = np.zeros((state.balance.F.size, len(self.steps)))
        for k, change in enumerate(np.diag(self.steps)):
            difference = balance_at(state.scalars + change) - balance_at(state.scalars - change)
            by_scalars[:, k] = difference / (2.0 * self.steps[k])
        return banded_rows(values, unknowns, state.series.size), by_scalars

    def _rest_matrix(self, state: BalanceState) -> Array:
        """Compute the weighted derivative (rows, unknowns) of the terms that vanish at rest.

        Rows are the rate and the acceleration of each deflection at both ends of the motion, and the jumps of
        value and rate at each inner edge of a panel.
        """
        splines, clock = state.splines, state.samples.clock
        edges = splines.panels
        cells_after = splines.intervals[np.searchsorted(splines.cells, edges[:-1])]
        cells_before = splines.intervals[np.searchsorted(splines.cells, edges[1:]) - 1]
        _, rate, acceleration = clock.motion(edges)
        scales = clock.law.duration ** np.arange(3)[:, None, None]
        panels = np.arange(len(edges) - 1)

        def rows_at(intervals: IntArray, chosen: slice) -> Array:
            """Compute all splines and two time derivatives (3, edges, size) on one side of chosen edges."""
            bases = splines.bases(intervals, edges[chosen])
            rows = np.zeros((3, len(intervals), splines.size))
            rows[:, panels[:, None], splines.columns(intervals)] = scales * _time_bases(
                bases, rate[chosen], acceleration[chosen]
            )
            return rows

        after = rows_at(cells_after, slice(None, -1))
        before = rows_at(cells_before, slice(1, None))
        jumps = before[:2, :-1] - after[:2, 1:]  # of value and rate
        rows = np.concatenate([after[1:, 0], before[1:, -1], *jumps])
        weight = END_RATE_WEIGHT * state.balance.stiffer * self.stiffness
        matrix = weight * np.kron(rows, np.eye(len(self.units)))  # the same for each spring
        return np.pad(matrix, ((0, 0), (0, len(self.steps))))


def _time_bases(bases: Array, rate: Array, acceleration: Array) -> Array:
    """Convert values and derivatives by p (3, T, k) into time derivatives.

    The rates dp/dt and accelerations d2p/dt2 are (T,).
    """
    value, slope, bend = bases
    rate, acceleration = rate[:, None], acceleration[:, None]
    return np.stack([value, rate * slope, rate**2 * bend + acceleration * slope])
