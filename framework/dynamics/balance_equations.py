"""The balance of a motion with unknown deflections and an unknown law, as equations for their coefficients.

Unknown are the deflections l, one Chebyshev series from knot to knot of the path, and scalars c of the law. F
of `loaded_balance` is to vanish at twice as many points as there are coefficients,

    F_l dl + F_l' dl' + F_l" dl" + F_c dc = -F,

in the least squares and but for what changes F next to nothing.

Where springs carry inertia F = 0 is a differential equation. Near an end or a knot it has solutions that die
away within milliseconds, of motions that do not begin or end at rest; so rates and accelerations at the ends,
and jumps at the knots, are asked to vanish as well, with so little weight that F has to give nothing for it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.dynamics.loaded_balance import (
    Course,
    LoadedBalance,
    balance_along,
    deflection_slopes,
    load_at_rates,
    spring_units,
)
from framework.kinematics.continuation.tracking import Branch
from framework.laws.clock import Clock
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import coefficients, derivative_matrix, nodes
from framework.tolerances import END_RATE_MISFIT, END_RATE_WEIGHT, WEAK_COLUMN

Family = Callable[[Array], Clock]  # laws by their scalars (k,)


class CoursePoints(NamedTuple):
    """Course and clock at 2 N Chebyshev points of each panel."""

    clock: Clock
    course: Course
    rate: Array  # (T,) d/dt of the Chebyshev series' variable
    bases: tuple[Array, Array, Array]  # (T, N) what a coefficient makes of deflections, rates, accelerations


class BalanceState(NamedTuple):
    """Coefficients, in units of the springs, and scalars, with what is out of balance."""

    series: Array  # (panels, N, n_e)
    scalars: Array  # (k,)
    points: CoursePoints
    balance: LoadedBalance

    @property
    def misfit(self) -> float:
        """What is out of balance, over the largest load."""
        return float(np.abs(self.balance.F).max() / self.balance.size)


class Slopes(NamedTuple):
    """What deflections, their rates and accelerations, and scalars change of the loads, along the panels.

    Of rates it is that of d/dp, p the series' variable: times dp/dt it is as smooth as the squared speed.
    """

    series: Array  # (panels, M, f d)
    directions: int  # d
    misfit: float  # of the state that they are of

    def at(self, size: int) -> Array:
        """At `size` nodes of all panels, (panels size, f, d)."""
        values = chebyshev.chebvander(nodes(size), self.series.shape[1] - 1) @ self.series
        return values.reshape(len(self.series) * size, -1, self.directions)


class LinearBalance(NamedTuple):
    """Linear equations of balance and of rest for a step, its unknowns in units of their columns' sizes."""

    balance: Array  # (T n_e, unknowns)
    rest: Array  # (rows, unknowns)
    sizes: Array  # (unknowns,) of the columns before
    factor: tuple[Array, bool]  # Cholesky's, of the normal equations of balance
    eased: Array  # (unknowns, rows) by how much balance gives way to rest

    @staticmethod
    def of(balance: Array, rest: Array, scalars_from: int) -> LinearBalance:
        """Factor the equations of least squares; columns of scalars weigh as much as others."""
        from scipy.linalg import cho_factor, cho_solve

        sizes = np.linalg.norm(balance, axis=0)
        sizes[:scalars_from] = np.maximum(sizes[:scalars_from], np.median(sizes[:scalars_from]))
        sizes[sizes == 0.0] = 1.0  # a scalar that changes nothing
        balance, rest = balance / sizes, rest / sizes
        factor = cho_factor(balance.T @ balance + WEAK_COLUMN**2 * np.eye(len(sizes)))
        return LinearBalance(balance, rest, sizes, factor, cho_solve(factor, rest.T))

    def step(self, state: BalanceState) -> Step:
        """The step of least squares but for what is weak, from a state with as many coefficients.

        The weight of rest falls with the misfit: a change of the normal equations in few directions
        (Sherman, Morrison and Woodbury).
        """
        from scipy.linalg import cho_solve

        series, F = state.series, state.balance.F.ravel()
        unknowns = np.append(series.ravel(), np.zeros(len(state.scalars))) * self.sizes
        y = -cho_solve(self.factor, self.balance.T @ F)
        weight = min(1.0, state.misfit / END_RATE_MISFIT)
        core = np.eye(len(self.rest)) / weight**2 + self.rest @ self.eased
        y -= self.eased @ np.linalg.solve(core, self.rest @ (unknowns + y))
        left = float(np.abs(self.balance @ y + F).max() / state.balance.size)
        step = y / self.sizes
        return Step(step[: series.size].reshape(series.shape), step[series.size :], left)


class Step(NamedTuple):
    """A step of the unknowns."""

    series: Array  # (panels, N, n_e)
    scalars: Array  # (k,)
    left: float  # the misfit that it would leave if F were linear


class BalanceEquations:
    """Those of a path and a family of laws, with `steps` (k,) of the scalars for differences."""

    def __init__(self, branch: Branch, family: Family, steps: Array) -> None:
        """Keep path, laws and steps; choose units of springs and how many orders of their rates count."""
        self.branch, self.family, self.steps = branch, family, steps
        self.units = spring_units(branch.robot)
        self.stiffness = float((branch.robot.stiffness * self.units**2).max())  # of each spring, in its unit
        self.orders = 3 if branch.robot.elastic_inertia else 1

    def at(
        self, series: Array, scalars: Array, *, stiffer: float = 1.0, near: Array | None = None
    ) -> BalanceState:
        """The state with these unknowns, from configurations near (T, nq).

        Raises:
            NotAssembled: the deflections tear the loops.
        """
        points = self._points(series, scalars)
        guess = self.branch.guess(points.course.s) if near is None else near
        balance = balance_along(
            self.branch.robot, points.course, guess, wrenches=self.branch.wrenches, stiffer=stiffer
        )
        return BalanceState(series, scalars, points, balance)

    def _points(self, series: Array, scalars: Array) -> CoursePoints:
        """Evaluate motion and deflections, with two rates, at 2 N nodes of each panel.

        With r = d(xi)/dt and a = dr/dt the bases of value, rate and acceleration are
        T_k, r T_k' and r^2 T_k'' + a T_k'.
        """
        clock, (panels, N, n_e) = self.family(scalars), series.shape
        half = 0.5 * np.diff(clock.edges)[:, None]
        s, rate, acceleration = clock.motion((clock.edges[:-1, None] + half * (nodes(2 * N) + 1.0)).ravel())
        per = np.repeat(1.0 / half, 2 * N)
        r, a = (per * rate)[:, None], (per * acceleration)[:, None]
        values = chebyshev.chebvander(nodes(2 * N), N - 1)
        value, slope, bend = (
            np.tile(basis, (panels, 1))
            for basis in (values, values @ derivative_matrix(N), values @ derivative_matrix(N, 2))
        )
        bases = np.asarray(value), np.asarray(r * slope), np.asarray(r**2 * bend + a * slope)
        bent = [(basis.reshape(panels, 2 * N, N) @ series).reshape(-1, n_e) * self.units for basis in bases]
        course = Course(s[0], *time_derivatives(self.branch.path, s), *bent)
        return CoursePoints(clock, course, r[:, 0], bases)

    def slopes(self, state: BalanceState) -> Slopes:
        """What each unknown changes at a state.

        Of the law's scalars by central differences of `steps`.
        """
        robot, series = self.branch.robot, state.series
        changes = deflection_slopes(robot, state.balance, self.orders)
        changes[:, :, robot.n_e : 2 * robot.n_e] *= state.points.rate[:, None, None]
        by_law = np.zeros((*changes.shape[:2], len(self.steps)))
        for k, step in enumerate(self.steps):
            change = step * np.eye(len(self.steps))[k]
            ahead, behind = (
                load_at_rates(robot, state.balance, self._points(series, state.scalars + d).course)
                for d in (change, -change)
            )
            by_law[:, :, k] = (ahead - behind) / (2.0 * step)
        changes = np.concatenate([changes, by_law], axis=2)
        count = changes.shape[2]
        changes = changes.reshape(len(series), len(changes) // len(series), -1)
        return Slopes(coefficients(changes), count, state.misfit)

    def linearised(self, state: BalanceState, slopes: Slopes) -> LinearBalance:
        """The equations for a step from this state, and from others near it."""
        return LinearBalance.of(self._matrix(state, slopes), self._at_rest(state), state.series.size)

    def _matrix(self, state: BalanceState, slopes: Slopes) -> Array:
        """Compute the Jacobian (T n_e, panels N n_e + k) of F = Y' load in coefficients and scalars.

        The load changes with deflections, their rates over dp/dt, their accelerations, and the scalars.
        """
        panels, N, n_e = state.series.shape
        change = np.einsum("tfe,tfd->ted", state.balance.Y, slopes.at(2 * N))
        value, slope, bend = state.points.bases
        bases = value, slope / state.points.rate[:, None], bend
        rows, columns = 2 * N * n_e, N * n_e
        matrix = np.zeros((panels * rows, panels * columns + len(self.steps)))
        for k in range(panels):
            here = slice(2 * N * k, 2 * N * (k + 1))
            block = np.zeros((2 * N, n_e, N, n_e))
            for order, basis in enumerate(bases[: self.orders]):
                of_order = change[here, :, order * n_e : (order + 1) * n_e]  # (2 N, n_e, n_e)
                block += of_order[:, :, None, :] * basis[here][:, None, :, None]
            matrix[k * rows : (k + 1) * rows, k * columns : (k + 1) * columns] = block.reshape(rows, columns)
        matrix[:, panels * columns :] = change[:, :, self.orders * n_e :].reshape(panels * rows, -1)
        return matrix

    def _at_rest(self, state: BalanceState) -> Array:
        """What unknowns change of rates and accelerations at the ends, and jumps at the knots, weighted."""
        panels, N, n_e = state.series.shape
        duration = state.points.clock.law.duration
        basis, slope, bend = (part.reshape(panels, 2 * N, N) for part in state.points.bases)
        rows = np.zeros((2 * panels + 2, panels, N))
        rows[0, 0], rows[1, -1] = duration * slope[0, 0], duration * slope[-1, -1]
        rows[-2, 0], rows[-1, -1] = duration**2 * bend[0, 0], duration**2 * bend[-1, -1]
        for k in range(panels - 1):
            for row, part in ((2 + 2 * k, basis), (3 + 2 * k, duration * slope)):
                rows[row, k], rows[row, k + 1] = part[k, -1], -part[k + 1, 0]
        weight = END_RATE_WEIGHT * state.balance.stiffer * self.stiffness
        matrix = weight * np.kron(rows.reshape(len(rows), -1), np.eye(n_e))
        return np.pad(matrix, ((0, 0), (0, len(self.steps))))


def longer(series: Array, count: int) -> Array:
    """The same functions (panels, N, n_e) with as many coefficients, or what is left of them with fewer."""
    return np.pad(series[:, :count], ((0, 0), (0, max(count - series.shape[1], 0)), (0, 0)))
