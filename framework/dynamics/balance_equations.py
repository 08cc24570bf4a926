"""Equations of balance for the coefficients of unknown deflections and of an unknown law.

The unknowns are the deflections l, one Chebyshev series between two knots of the path, and scalars c of the
law. The residual F of `loaded_balance` is evaluated at twice as many nodes as there are coefficients. A
Gauss-Newton step solves

    F_l dl + F_l' dl' + F_l" dl" + F_c dc = -F

in the least squares. Directions that hardly change F are suppressed.

If springs carry inertia, F = 0 is a differential equation. Some of its solutions decay within milliseconds
near an end or a knot; these belong to motions that do not begin or end at rest. Rates and accelerations at
the ends, and jumps at the knots, are therefore minimised too, with a weight so small that F does not grow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

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
from framework.laws.optimal_law import Clock, OnParameter
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import coefficients, derivative_matrix, nodes
from framework.tolerances import END_RATE_MISFIT, END_RATE_WEIGHT, WEAK_COLUMN

Family = Callable[[Array], Clock]  # laws by their scalars (k,)


class SampledMotion(NamedTuple):
    """A motion with deflections at T nodes, 2 N on each panel, and its law."""

    clock: Clock
    parameters: Array  # (T,) of the law
    prescribed: DeflectedMotion
    rate: Array  # (T,) dp/dt of the variable p of the Chebyshev series
    bases: tuple[Array, Array, Array]  # (T, N) each: the polynomials T_j(p(t)) and two time derivatives


class BalanceState(NamedTuple):
    """An iterate: coefficients of the deflections, scalars of the law, and their balance."""

    series: Array  # (panels, N, n_e) in units of the springs
    scalars: Array  # (k,)
    samples: SampledMotion
    balance: LoadedBalance

    @property
    def misfit(self) -> float:
        """The largest |F|, over the largest load."""
        return float(np.abs(self.balance.F).max() / self.balance.size)


class LoadSlopes(NamedTuple):
    """Derivatives of the load by deflections, their rates and accelerations, and the law's scalars.

    Derivatives by rates are multiplied by dp/dt, p the variable of the series. Like the squared speed of the
    law, this product is smooth.
    """

    series: Array  # (panels, M, f d) Chebyshev coefficients along each panel
    directions: int  # d
    misfit: float  # of the state at which they were computed

    def evaluate(self, size: int) -> Array:
        """Compute the derivatives (panels size, f, d) at `size` nodes of each panel."""
        values = chebyshev.chebvander(nodes(size), self.series.shape[1] - 1) @ self.series
        return values.reshape(len(self.series) * size, -1, self.directions)


class Step(NamedTuple):
    """A Gauss-Newton step of the unknowns."""

    series: Array  # (panels, N, n_e)
    scalars: Array  # (k,)
    predicted_misfit: float  # after the step, if F were linear


class NormalFactors(NamedTuple):
    """The factored normal equations N = B'B + small^2 of balance.

    Deflections of one panel do not affect F on another. N is therefore factored panel by panel, and the
    scalars of the law are eliminated last.
    """

    factors: tuple[tuple[Array, bool], ...]  # Cholesky's, of each panel
    eliminated: Array  # (panels, C, k) N_series^-1 N_series,scalars
    core: Array  # (k, k) Schur complement of the scalars

    @staticmethod
    def factorise(by_series: Array, by_scalars: Array) -> NormalFactors:
        """Factor N of derivatives by series (panels, R, C) and by scalars (panels, R, k)."""
        from scipy.linalg import cho_factor, cho_solve

        small = WEAK_COLUMN**2
        factors = tuple(cho_factor(block.T @ block + small * np.eye(block.shape[1])) for block in by_series)
        coupling = by_series.swapaxes(1, 2) @ by_scalars
        eliminated = np.stack([cho_solve(*pair) for pair in zip(factors, coupling, strict=True)])
        core = by_scalars.swapaxes(1, 2) @ by_scalars - coupling.swapaxes(1, 2) @ eliminated
        return NormalFactors(factors, eliminated, core.sum(axis=0) + small * np.eye(core.shape[1]))

    def solve(self, right: Array) -> Array:
        """Solve N y = right (unknowns, k)."""
        from scipy.linalg import cho_solve

        of_series, of_scalars = self.split(right)
        solved = np.stack([cho_solve(*pair) for pair in zip(self.factors, of_series, strict=True)])
        remaining = of_scalars - (self.eliminated.swapaxes(1, 2) @ of_series).sum(axis=0)
        scalars = np.linalg.solve(self.core, remaining)
        return np.concatenate([*(solved - self.eliminated @ scalars), scalars])

    def split(self, unknowns: Array) -> tuple[Array, Array]:
        """Split unknowns (unknowns, k) into series (panels, C, k) and scalars."""
        panels, count, _ = self.eliminated.shape
        of_series, of_scalars = np.split(unknowns, [panels * count])
        return of_series.reshape(panels, count, -1), of_scalars


class LinearBalance(NamedTuple):
    """The linearised equations of balance and of rest, in unknowns multiplied by the sizes of columns."""

    by_series: Array  # (panels, R, C) derivatives of F on each panel by its own coefficients
    by_scalars: Array  # (panels, R, k) derivatives of F by the law's scalars
    rest: Array  # (rows, unknowns) R, derivatives of the terms that vanish at rest
    sizes: Array  # (unknowns,) of the columns before scaling
    normal: NormalFactors
    rest_response: Array  # (unknowns, rows) N^-1 R'

    @staticmethod
    def factorise(by_series: Array, by_scalars: Array, rest: Array) -> LinearBalance:
        """Scale the columns, and factor the normal equations of balance.

        Columns of the series smaller than their median are scaled by the median.
        """
        series_sizes = np.linalg.norm(by_series, axis=1)  # (panels, C)
        series_sizes = np.maximum(series_sizes, np.median(series_sizes))
        scalar_sizes = np.linalg.norm(by_scalars, axis=(0, 1))
        scalar_sizes[scalar_sizes == 0.0] = 1.0  # of a scalar that changes nothing
        by_series = by_series / series_sizes[:, None]
        by_scalars = by_scalars / scalar_sizes
        sizes = np.append(series_sizes, scalar_sizes)
        rest = rest / sizes
        normal = NormalFactors.factorise(by_series, by_scalars)
        return LinearBalance(by_series, by_scalars, rest, sizes, normal, normal.solve(rest.T))

    def step(self, state: BalanceState) -> Step:
        """Compute the Gauss-Newton step from a state with the same number of coefficients.

        The step y minimises |B y + F|^2 + small^2 |y|^2 + w^2 |R (u + y)|^2 with the unknowns u of the state.
        The weight w falls with the misfit.
        """
        series = state.series
        F = state.balance.F.ravel()
        unknowns = np.append(series, np.zeros(len(state.scalars))) * self.sizes
        weight = min(1.0, state.misfit / END_RATE_MISFIT)
        y = self._least_change(F[:, None], self.rest @ unknowns[:, None], weight)
        of_series, of_scalars = self.normal.split(y)
        change = self.by_series @ of_series + self.by_scalars @ of_scalars  # of F
        predicted = float(np.abs(change.ravel() + F).max() / state.balance.size)
        step = y[:, 0] / self.sizes
        return Step(step[: series.size].reshape(series.shape), step[series.size :], predicted)

    def follow(self, F: Array) -> Array:
        """Compute changes (unknowns, k) that cancel changes F (T n_e, k) of the balance and preserve rest."""
        rest = np.zeros((len(self.rest), F.shape[1]))
        return self._least_change(F, rest, 1.0) / self.sizes[:, None]

    def _least_change(self, F: Array, rest: Array, weight: float) -> Array:
        """Return scaled changes y (unknowns, k) for F (T n_e, k) and terms R u of rest (rows, k).

        By Sherman, Morrison and Woodbury y = y_0 - N^-1 R' (1 / w^2 + R N^-1 R')^-1 R (u + y_0), with the
        change y_0 without rest. One factorisation of N thus serves all weights w.
        """
        F = F.reshape(*self.by_series.shape[:2], -1)
        gradient = self.by_series.swapaxes(1, 2) @ F
        scalar_gradient = (self.by_scalars.swapaxes(1, 2) @ F).sum(axis=0)
        y = -self.normal.solve(np.concatenate([*gradient, scalar_gradient]))  # y_0
        core = np.eye(len(self.rest)) / weight**2 + self.rest @ self.rest_response
        return np.asarray(y - self.rest_response @ np.linalg.solve(core, rest + self.rest @ y))


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
        self, series: Array, scalars: Array, *, stiffer: float = 1.0, near: Array | None = None
    ) -> BalanceState:
        """Compute the balance of given unknowns.

        Args:
            stiffer: factor of the robot's spring stiffness.
            near: configurations (T, nq) from which the loops are closed; those of the branch by default.

        Raises:
            NotAssembled: the deflections tear the loops.
        """
        branch = self.branch
        samples = self._sample(series, scalars)
        guess = branch.guess(samples.prescribed.s) if near is None else near
        balance = evaluate_balance(
            branch.robot, samples.prescribed, guess, wrenches=branch.wrenches, stiffer=stiffer
        )
        return BalanceState(series, scalars, samples, balance)

    def _sample(self, series: Array, scalars: Array) -> SampledMotion:
        """Evaluate motion and deflections, with two time derivatives, at 2 N nodes of each panel."""
        clock = self.family(scalars)
        local = nodes(2 * series.shape[1]) + 1.0
        half_widths = 0.5 * np.diff(clock.edges)[:, None]
        parameters = (clock.edges[:-1, None] + half_widths * local).ravel()
        return self._prescribe(series, clock, parameters, clock.motion(parameters))

    def prescribe_at(self, state: BalanceState, z: float, u: float) -> DeflectedMotion:
        """Return the motion at z and u of the law, with the deflections of a state as functions of xi."""
        clock = state.samples.clock
        assert isinstance(clock, OnParameter)
        motion = clock.motion_at(state.samples.parameters, z, u)
        return self._prescribe(state.series, clock, state.samples.parameters, motion).prescribed

    def _prescribe(
        self, series: Array, clock: Clock, parameters: Array, motion: tuple[list[Array], Array, Array]
    ) -> SampledMotion:
        """Return motion and deflections at the nodes, from `motion` of the law: s, dp/dt and d2p/dt2."""
        s, rate, acceleration = motion
        panels, N, n_e = series.shape
        half_widths = 0.5 * np.diff(clock.edges)
        local = np.repeat(1.0 / half_widths, 2 * N)  # derivative of the series' variable by the parameter
        bases = _time_bases(panels, N, local * rate, local * acceleration)
        deflections = [
            (basis.reshape(panels, 2 * N, N) @ series).reshape(-1, n_e) * self.units for basis in bases
        ]
        prescribed = DeflectedMotion(s[0], *time_derivatives(self.branch.path, s), *deflections)
        return SampledMotion(clock, parameters, prescribed, local * rate, bases)

    def slopes(self, state: BalanceState) -> LoadSlopes:
        """Compute derivatives of the load at a state; by scalars as central differences."""
        robot = self.branch.robot
        columns, units = locked_columns(robot)
        by_deflections = deflection_slopes(robot, state.balance, self.orders)  # (T, f, orders n_e)
        by_deflections[:, :, robot.n_e : 2 * robot.n_e] *= state.samples.rate[:, None, None]

        def load_at(scalars: Array) -> Array:
            """Compute the load (T, f) with the rates of the law of other scalars."""
            prescribed = self._sample(state.series, scalars).prescribed
            return load_at_rates(robot, state.balance, prescribed)[:, columns] * units

        by_scalars = np.zeros((*by_deflections.shape[:2], len(self.steps)))
        for k, change in enumerate(np.diag(self.steps)):
            difference = load_at(state.scalars + change) - load_at(state.scalars - change)
            by_scalars[:, :, k] = difference / (2.0 * self.steps[k])
        slopes = np.concatenate([by_deflections, by_scalars], axis=2)  # (T, f, d)
        panels, N, _ = state.series.shape
        series = coefficients(slopes.reshape(panels, 2 * N, -1))
        return LoadSlopes(series, slopes.shape[2], state.misfit)

    def linearise(self, state: BalanceState, slopes: LoadSlopes) -> LinearBalance:
        """Return the linear equations for steps from this state and from neighbouring states."""
        return LinearBalance.factorise(*self._balance_slopes(state, slopes), self._rest_matrix(state))

    def _balance_slopes(self, state: BalanceState, slopes: LoadSlopes) -> tuple[Array, Array]:
        """Compute derivatives of F = Y' load on each panel by its coefficients and by the scalars.

        A coefficient c_ji of spring i changes F_e at a node of its own panel by the sum over the orders o of
        F_e,oi T_j^(o), with T_j^(o) the o-th time derivative of T_j(p(t)).

        Returns:
            Arrays (panels, 2 N n_e, N n_e) and (panels, 2 N n_e, k).
        """
        panels, N, n_e = state.series.shape
        value, rate, acceleration = state.samples.bases
        bases = np.stack([value, rate / state.samples.rate[:, None], acceleration][: self.orders], axis=2)
        F_slopes = np.einsum("tfe,tfd->ted", state.balance.Y, slopes.evaluate(2 * N))  # Y' load
        by_deflections, by_scalars = np.split(F_slopes, [self.orders * n_e], axis=2)
        by_series = bases[:, None] @ by_deflections.reshape(len(bases), n_e, self.orders, n_e)
        rows = 2 * N * n_e  # of a panel; by_series was (T, n_e, N, n_e)
        return by_series.reshape(panels, rows, N * n_e), by_scalars.reshape(panels, rows, -1)

    def _rest_matrix(self, state: BalanceState) -> Array:
        """Compute the weighted derivative (rows, unknowns) of the terms that vanish at rest.

        Rows are the rate and the acceleration of each deflection at both ends of the motion, and the jumps of
        value and rate at each knot.
        """
        panels, N, n_e = state.series.shape
        duration = state.samples.clock.law.duration
        value, rate, acceleration = (
            duration**order * basis.reshape(panels, 2 * N, N)
            for order, basis in enumerate(state.samples.bases)
        )
        rows = np.zeros((2 * panels + 2, panels, N))
        rows[0, 0] = rate[0, 0]  # the first node
        rows[1, -1] = rate[-1, -1]  # the last node
        rows[-2, 0] = acceleration[0, 0]
        rows[-1, -1] = acceleration[-1, -1]
        for k in range(panels - 1):
            for row, part in ((2 + 2 * k, value), (3 + 2 * k, rate)):
                rows[row, k] = part[k, -1]
                rows[row, k + 1] = -part[k + 1, 0]
        weight = END_RATE_WEIGHT * state.balance.stiffer * self.stiffness
        matrix = weight * np.kron(rows.reshape(len(rows), -1), np.eye(n_e))  # the same for each spring
        return np.pad(matrix, ((0, 0), (0, len(self.steps))))


def _time_bases(panels: int, N: int, rate: Array, acceleration: Array) -> tuple[Array, Array, Array]:
    """Compute T_j(p(t)) and two time derivatives, j < N, at 2 N nodes a panel: (panels 2 N, N).

    They are T_j, T_j' dp/dt and T_j" (dp/dt)^2 + T_j' d2p/dt2, with the rate dp/dt and the acceleration
    d2p/dt2 at the nodes, (panels 2 N,) each.
    """
    values = np.asarray(chebyshev.chebvander(nodes(2 * N), N - 1), dtype=float)
    bases = (values, values @ derivative_matrix(N), values @ derivative_matrix(N, 2))
    value, slope, bend = (np.tile(basis, (panels, 1)) for basis in bases)
    rate, acceleration = rate[:, None], acceleration[:, None]
    return np.asarray(value), np.asarray(rate * slope), np.asarray(rate**2 * bend + acceleration * slope)


def resize_series(series: Array, count: int) -> Array:
    """Cut Chebyshev series (panels, N, n_e) to `count` coefficients, or pad the series with zeros."""
    return np.pad(series[:, :count], ((0, 0), (0, max(count - series.shape[1], 0)), (0, 0)))
