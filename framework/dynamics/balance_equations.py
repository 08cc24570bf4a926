"""The balance of a motion with unknown deflections and an unknown law, as equations for their coefficients.

Unknown are the deflections l, one Chebyshev series from knot to knot of the path, and scalars c of the law. F
of `loaded_balance` is to vanish at twice as many points as there are coefficients,

    F_l dl + F_l' dl' + F_l" dl" + F_c dc = -F,

in the least squares. Steps that change F next to nothing are left out.

Where springs carry inertia F = 0 is a differential equation. Near an end or a knot this has solutions that
die away within milliseconds; they belong to motions that do not begin or end at rest. So rates and
accelerations at the ends, and jumps at the knots, are minimised too, with so little weight that F does not
grow by it.
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
    spring_units,
)
from framework.kinematics.continuation.tracking import Branch
from framework.laws.clock import Clock, OnParameter
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import coefficients, derivative_matrix, nodes
from framework.tolerances import END_RATE_MISFIT, END_RATE_WEIGHT, WEAK_COLUMN

Family = Callable[[Array], Clock]  # laws by their scalars (k,)


class SampledMotion(NamedTuple):
    """A motion with deflections at T nodes, 2 N of each panel, and its law."""

    clock: Clock
    parameters: Array  # (T,) of the law
    prescribed: DeflectedMotion
    rate: Array  # (T,) dp/dt, p the variable of the Chebyshev series
    bases: tuple[Array, Array, Array]  # (T, N) the polynomials T_j(p(t)) and two time derivatives


class BalanceState(NamedTuple):
    """An iterate: coefficients of the deflections, scalars of the law, and their balance."""

    series: Array  # (panels, N, n_e) in units of the springs
    scalars: Array  # (k,)
    samples: SampledMotion
    balance: LoadedBalance

    @property
    def misfit(self) -> float:
        """The largest |F| over the largest load."""
        return float(np.abs(self.balance.F).max() / self.balance.size)


class LoadSlopes(NamedTuple):
    """Derivatives of the load by deflections, their rates and accelerations, and the law's scalars.

    Those by rates are times dp/dt, p the variable of the series: so they are as smooth as the squared speed.
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

    Deflections of a panel do not act on F of another one. So N is factored panel by panel, and the scalars of
    the law last.
    """

    factors: tuple[tuple[Array, bool], ...]  # Cholesky's, of each panel
    eliminated: Array  # (panels, C, k) N_series^-1 N_series,scalars
    core: Array  # (k, k) of the scalars, once the series are eliminated

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
    """The linearised equations of balance and of rest, their unknowns scaled by the columns' sizes."""

    by_series: Array  # (panels, R, C) derivatives of F on each panel by its own coefficients
    by_scalars: Array  # (panels, R, k) by the law's scalars
    rest: Array  # (rows, unknowns)
    sizes: Array  # (unknowns,) of the columns that are not scaled
    normal: NormalFactors
    rest_response: Array  # (unknowns, rows) N^-1 R'

    @staticmethod
    def factorise(by_series: Array, by_scalars: Array, rest: Array) -> LinearBalance:
        """Factor the normal equations of balance.

        Columns of the series count as not smaller than their median.
        """
        series_sizes = np.linalg.norm(by_series, axis=1)  # (panels, C)
        series_sizes = np.maximum(series_sizes, np.median(series_sizes))
        scalar_sizes = np.linalg.norm(by_scalars, axis=(0, 1))
        scalar_sizes[scalar_sizes == 0.0] = 1.0  # a scalar that changes nothing
        by_series, by_scalars = by_series / series_sizes[:, None], by_scalars / scalar_sizes
        sizes = np.append(series_sizes, scalar_sizes)
        rest, normal = rest / sizes, NormalFactors.factorise(by_series, by_scalars)
        return LinearBalance(by_series, by_scalars, rest, sizes, normal, normal.solve(rest.T))

    def step(self, state: BalanceState) -> Step:
        """Compute the Gauss-Newton step from a state with as many coefficients.

        The least |B y + F|^2 + small^2 |y|^2 + w^2 |R (u + y)|^2, u the unknowns of the state. The weight w
        of rest falls with the misfit, so that one factorisation serves all states: by Sherman, Morrison and
        Woodbury y = y_0 - N^-1 R' (1 / w^2 + R N^-1 R')^-1 R (u + y_0), y_0 the step without rest.
        """
        series, F = state.series, state.balance.F.ravel()
        unknowns = np.append(series.ravel(), np.zeros(len(state.scalars))) * self.sizes
        weight = min(1.0, state.misfit / END_RATE_MISFIT)
        y = self._least_change(F[:, None], self.rest @ unknowns[:, None], weight)
        of_series, of_scalars = self.normal.split(y)
        remaining = self.by_series @ of_series + self.by_scalars @ of_scalars
        predicted = float(np.abs(remaining.ravel() + F).max() / state.balance.size)
        step = y[:, 0] / self.sizes
        return Step(step[: series.size].reshape(series.shape), step[series.size :], predicted)

    def follow(self, F: Array) -> Array:
        """Compute changes (unknowns, k) that cancel changes F (T n_e, k) of the balance, and keep rest."""
        rest = np.zeros((len(self.rest), F.shape[1]))
        return self._least_change(F, rest, 1.0) / self.sizes[:, None]

    def _least_change(self, F: Array, rest: Array, weight: float) -> Array:
        """Return the scaled changes y (unknowns, k) for F (T n_e, k) and terms of rest (rows, k)."""
        F = F.reshape(*self.by_series.shape[:2], -1)
        gradient = self.by_series.swapaxes(1, 2) @ F
        scalar_gradient = (self.by_scalars.swapaxes(1, 2) @ F).sum(axis=0)
        y = -self.normal.solve(np.concatenate([*gradient, scalar_gradient]))  # y_0
        core = np.eye(len(self.rest)) / weight**2 + self.rest @ self.rest_response
        return np.asarray(y - self.rest_response @ np.linalg.solve(core, rest + self.rest @ y))


class BalanceEquations:
    """The equations F = 0 of a path and a family of laws."""

    def __init__(self, branch: Branch, family: Family, steps: Array) -> None:
        """Store path and laws.

        `steps` (k,) are those of differences in the scalars. Rates and accelerations of deflections count
        only where springs carry inertia.
        """
        self.branch, self.family, self.steps = branch, family, steps
        self.units = spring_units(branch.robot)
        self.stiffness = float((branch.robot.stiffness * self.units**2).max())  # of each spring, in its unit
        self.orders = 3 if branch.robot.elastic_inertia else 1

    def evaluate(
        self, series: Array, scalars: Array, *, stiffer: float = 1.0, near: Array | None = None
    ) -> BalanceState:
        """Compute the balance with given unknowns, the loops closed from configurations `near` (T, nq).

        Raises:
            NotAssembled: the deflections tear the loops.
        """
        samples = self._sample(series, scalars)
        guess = self.branch.guess(samples.prescribed.s) if near is None else near
        balance = evaluate_balance(
            self.branch.robot, samples.prescribed, guess, wrenches=self.branch.wrenches, stiffer=stiffer
        )
        return BalanceState(series, scalars, samples, balance)

    def _sample(self, series: Array, scalars: Array) -> SampledMotion:
        """Evaluate motion and deflections, with two rates, at 2 N nodes of each panel."""
        clock, size = self.family(scalars), 2 * series.shape[1]
        half_widths = 0.5 * np.diff(clock.edges)[:, None]
        parameters = (clock.edges[:-1, None] + half_widths * (nodes(size) + 1.0)).ravel()
        return self._prescribe(series, clock, parameters, clock.motion(parameters))

    def prescribe_at(self, state: BalanceState, z: float, u: float) -> DeflectedMotion:
        """Return the motion of a state's deflections, as functions of xi, at constant z and u of the law."""
        clock, parameters = state.samples.clock, state.samples.parameters
        assert isinstance(clock, OnParameter)
        motion = clock.motion_at(parameters, z, u)
        return self._prescribe(state.series, clock, parameters, motion).prescribed

    def _prescribe(
        self, series: Array, clock: Clock, parameters: Array, motion: tuple[list[Array], Array, Array]
    ) -> SampledMotion:
        """Return motion and deflections at the nodes for the law's `motion`."""
        s, rate, acceleration = motion
        panels, N, n_e = series.shape
        half_widths = 0.5 * np.diff(clock.edges)
        local = np.repeat(1.0 / half_widths, 2 * N)  # of the series' variable, by the law's parameter
        bases = _time_bases(panels, N, local * rate, local * acceleration)
        deflections = [
            (basis.reshape(panels, 2 * N, N) @ series).reshape(-1, n_e) * self.units for basis in bases
        ]
        prescribed = DeflectedMotion(s[0], *time_derivatives(self.branch.path, s), *deflections)
        return SampledMotion(clock, parameters, prescribed, local * rate, bases)

    def slopes(self, state: BalanceState) -> LoadSlopes:
        """Compute the derivatives of the load at a state; by scalars as central differences."""
        robot, series, n_e = self.branch.robot, state.series, self.branch.robot.n_e
        by_deflections = deflection_slopes(robot, state.balance, self.orders)  # (T, f, orders n_e)
        by_deflections[:, :, n_e : 2 * n_e] *= state.samples.rate[:, None, None]
        by_scalars = np.zeros((*by_deflections.shape[:2], len(self.steps)))
        for k, step in enumerate(self.steps):
            change = step * np.eye(len(self.steps))[k]
            forward = self._sample(series, state.scalars + change).prescribed
            backward = self._sample(series, state.scalars - change).prescribed
            difference = load_at_rates(robot, state.balance, forward)
            difference = difference - load_at_rates(robot, state.balance, backward)
            by_scalars[:, :, k] = difference / (2.0 * step)
        changes = np.concatenate([by_deflections, by_scalars], axis=2)
        values = changes.reshape(len(series), len(changes) // len(series), -1)  # (panels, 2 N, f d)
        return LoadSlopes(coefficients(values), changes.shape[2], state.misfit)

    def linearise(self, state: BalanceState, slopes: LoadSlopes) -> LinearBalance:
        """Return the linear equations for a step from this state, and from others near this one."""
        return LinearBalance.factorise(*self._balance_slopes(state, slopes), self._rest_matrix(state))

    def _balance_slopes(self, state: BalanceState, slopes: LoadSlopes) -> tuple[Array, Array]:
        """Compute derivatives of F = Y' load on each panel by its coefficients and by the scalars.

        A coefficient c_ji of spring i changes F_e at node t of its own panel by the sum over the orders o of
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
        rows = (panels, 2 * N * n_e)  # (T, n_e, N, n_e) before
        return by_series.reshape(*rows, N * n_e), by_scalars.reshape(*rows, -1)

    def _rest_matrix(self, state: BalanceState) -> Array:
        """Compute the weighted derivative (rows, unknowns) of the terms that vanish at rest.

        Rows are the rate and the acceleration of each deflection at both ends of the motion, and the jumps of
        value and rate at each knot.
        """
        panels, N, n_e = state.series.shape
        duration = state.samples.clock.law.duration
        value, rate, acceleration = (basis.reshape(panels, 2 * N, N) for basis in state.samples.bases)
        rows = np.zeros((2 * panels + 2, panels, N))
        rows[0, 0], rows[1, -1] = duration * rate[0, 0], duration * rate[-1, -1]
        rows[-2, 0], rows[-1, -1] = duration**2 * acceleration[0, 0], duration**2 * acceleration[-1, -1]
        for k in range(panels - 1):
            for row, part in ((2 + 2 * k, value), (3 + 2 * k, duration * rate)):
                rows[row, k], rows[row, k + 1] = part[k, -1], -part[k + 1, 0]
        weight = END_RATE_WEIGHT * state.balance.stiffer * self.stiffness
        matrix = weight * np.kron(rows.reshape(len(rows), -1), np.eye(n_e))  # the same for each spring
        return np.pad(matrix, ((0, 0), (0, len(self.steps))))


def _time_bases(panels: int, N: int, rate: Array, acceleration: Array) -> tuple[Array, Array, Array]:
    """Compute T_j(p(t)) and two time derivatives at the nodes, (panels 2 N, N) each.

    There are N polynomials, j < N, and 2 N nodes a panel. With rate dp/dt and acceleration d2p/dt2 at the
    nodes, (panels 2 N,) each, they are T_j, T_j' dp/dt and T_j" (dp/dt)^2 + T_j' d2p/dt2.
    """
    values = np.asarray(chebyshev.chebvander(nodes(2 * N), N - 1), dtype=float)
    slopes, bends = values @ derivative_matrix(N), values @ derivative_matrix(N, 2)
    value, slope, bend = (np.tile(basis, (panels, 1)) for basis in (values, slopes, bends))
    rate, acceleration = rate[:, None], acceleration[:, None]
    return np.asarray(value), np.asarray(rate * slope), np.asarray(rate**2 * bend + acceleration * slope)


def resize_series(series: Array, count: int) -> Array:
    """Cut Chebyshev series (panels, N, n_e) to `count` coefficients, or extend the series by zeros."""
    return np.pad(series[:, :count], ((0, 0), (0, max(count - series.shape[1], 0)), (0, 0)))
