"""Equations of balance for the coefficients of unknown deflections and of an unknown law.

The unknowns are the deflections l, splines in the parameter p of the law, and scalars c of the law. The
residual F(l, c) = Y' load of `loaded_balance`, n_e equations at each node, is evaluated at more nodes than
there are coefficients. A Gauss-Newton step solves

    F_l dl + F_l' dl' + F_l" dl" + F_c dc = -F

in the least squares. Directions that hardly change F are suppressed.

If springs carry inertia, F = 0 is a differential equation, whose solutions differ by free vibrations. Coarse
cells do not represent these, and finer cells begin from the coarse solution, which is smooth. Where the cells
represent vibrations, these hardly change F. Under a law that begins and ends at rest to its sixth derivative,
they are chosen such that the springs are as near to rest at both ends as possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from framework.dynamics.deflection_splines import SPLINE_DEGREE, DeflectionSplines
from framework.dynamics.loaded_balance import (
    DeflectedMotion,
    LoadedBalance,
    deflection_slopes,
    evaluate_balance,
    forces_of_neighbour,
    spring_units,
)
from framework.kinematics.continuation.tracking import Branch
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, Clock, OnParameter, OptimalLaw
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec
from framework.numerics.splines import BandedFactor, banded_rows, column_sizes
from framework.tolerances import MAX_END_ACCELERATION, MAX_END_RATE, WEAK_COLUMN

Family = Callable[[Array], Clock]  # laws by their scalars (k,)
# What free vibrations change the balance by: at most this, over the least share of stiffness in a column,
# and this in all. Stiffness and inertia of vibrations cancel. Other unit directions leave what they miss of a
# natural frequency, of the share of stiffness, which falls with the square of the cells' width. Measured on
# agile_eye, three_rrr and delta, 150 to 420 cells: 0.04 to 0.14 of the least share; vibrations 0.014 to 1e-8
# where cells represent them, and up to 5e-5 in all where these are too few
VIBRATION_SHARE, LARGEST_VIBRATION = 0.03, 1e-5
# accepted misfit above which a balance is loose. In settled balances vibrations change it by WEAK_COLUMN at
# most, for what they change is left of F: with 1e-5 motions of three_rpr kept tails of 2e-7
LEAST_LOOSE_MISFIT = 1e-10


class BalanceState(NamedTuple):
    """An iterate: coefficients of the deflections, scalars of the law, and their balance at T nodes."""

    splines: DeflectionSplines
    series: Array  # (size, n_e) in units of the springs
    scalars: Array  # (k,)
    clock: Clock  # the law of these scalars
    bases: Array  # (3, T, SPLINE_DEGREE + 1) of the splines that are not zero: values and time derivatives
    balance: LoadedBalance

    @property
    def cell_misfits(self) -> Array:
        """The largest |F| on each cell (cells,), over the largest entry of the load on all cells."""
        largest = np.zeros(len(self.splines.intervals))
        np.maximum.at(largest, self.splines.nodes.cells, np.abs(self.balance.F).max(axis=1))
        return largest / self.balance.largest_load

    @property
    def misfit(self) -> float:
        """The largest |F|, over the largest entry of the load."""
        return float(self.cell_misfits.max())


class Step(NamedTuple):
    """A Gauss-Newton step of the unknowns."""

    series: Array  # (size, n_e)
    scalars: Array  # (k,)
    predicted_misfit: float  # after the step, if F were linear


@dataclass(frozen=True, eq=False)
class LinearBalance:
    """The linearised equations of balance and of rest, in unknowns multiplied by the sizes of columns.

    The normal equations of balance are N = B'B + WEAK_COLUMN^2 with derivatives B of F. Their part of the
    series is banded; the scalars of the law are eliminated last.
    """

    by_series: Any  # sparse (T n_e, C) derivatives of F by the series
    by_scalars: Array  # (T n_e, k) derivatives of F by the law's scalars
    sizes: Array  # (C + k,) of the columns before scaling
    factor: BandedFactor  # of the series' part of N
    eliminated: Array  # (C, k) N_series^-1 N_series,scalars
    core: Array  # (k, k) Schur complement of the scalars in N
    rest: Array  # (rows, C + k) R, derivatives of the terms that vanish at rest
    vibration: float  # what unit directions may change the balance by, to count as vibrations

    @staticmethod
    def factorise(by_series: Any, by_scalars: Array, rest: Array, vibration: float) -> LinearBalance:
        """Scale the columns, and factor the normal equations of balance.

        Columns of the series smaller than their median are scaled by the median, so that unknowns of little
        effect on F stay weak.

        Args:
            by_series: sparse (T n_e, C) derivatives of F by the series; its entries are scaled in place.
            by_scalars: (T n_e, k) derivatives of F by the scalars of the law.
            rest: (rows, C + k) derivatives of the terms that vanish at rest.
            vibration: as the field.
        """
        series_sizes = column_sizes(by_series)
        series_sizes = np.maximum(series_sizes, np.median(series_sizes))
        scalar_sizes = np.linalg.norm(by_scalars, axis=0)
        scalar_sizes[scalar_sizes == 0.0] = 1.0  # of a scalar that changes nothing
        by_series.data /= series_sizes[by_series.indices]
        by_scalars = by_scalars / scalar_sizes
        sizes = np.append(series_sizes, scalar_sizes)
        factor = BandedFactor.factor_squares(by_series, WEAK_COLUMN**2)
        coupling = by_series.T @ by_scalars
        eliminated = factor.solve(coupling)
        weak = WEAK_COLUMN**2 * np.eye(len(scalar_sizes))
        core = by_scalars.T @ by_scalars - coupling.T @ eliminated + weak
        return LinearBalance(by_series, by_scalars, sizes, factor, eliminated, core, rest / sizes, vibration)

    @cached_property
    def vibrations(self) -> Array:
        """Orthonormal directions V (C + k, m) that change the balance by at most `vibration`.

        Inverse iteration on N, begun with R', finds the directions that also change the terms of rest.
        """
        V = self._solve_normal(self.rest.T)
        V = self._solve_normal(np.linalg.qr(V)[0])
        V = np.linalg.qr(V)[0]
        change = self._change_balance(V)
        squares, axes = np.linalg.eigh(change.T @ change)
        return V @ axes[:, squares <= self.vibration**2]

    def step(self, state: BalanceState) -> Step:
        """Compute the Gauss-Newton step from a state with the same splines."""
        F = state.balance.F.reshape(-1, 1)
        y = self._least_change(F, self.rest_of(state)[:, None])
        predicted = np.abs(self._change_balance(y) + F).max() / state.balance.largest_load
        series, scalars = np.split(y[:, 0] / self.sizes, [state.series.size])
        return Step(series.reshape(state.series.shape), scalars, float(predicted))

    def rest_of(self, state: BalanceState) -> Array:
        """Compute the terms (rows,) that vanish at rest: linear in the deflections, whatever the scalars."""
        unknowns = np.append(state.series, np.zeros(len(state.scalars)))
        return np.asarray(self.rest @ (unknowns * self.sizes))

    def cancel_changes(self, F: Array) -> Array:
        """Compute changes (C + k, n) of the unknowns that cancel changes F (T n_e, n) and preserve rest."""
        at_rest = np.zeros((len(self.rest), F.shape[1]))
        return self._least_change(F, at_rest) / self.sizes[:, None]

    def _change_balance(self, y: Array) -> Array:
        """Return the changes B y (T n_e, n) of F by scaled changes y (C + k, n)."""
        of_series, of_scalars = np.split(y, [len(self.eliminated)])
        return np.asarray(self.by_series @ of_series + self.by_scalars @ of_scalars)

    def _least_change(self, F: Array, rest: Array) -> Array:
        """Solve for scaled changes y (C + k, n) that cancel F, and terms of rest if possible.

        First, y minimises |B y + F|^2 + WEAK_COLUMN^2 |y|^2. Then `vibrations`, which hardly change the
        balance, are added so that they minimise |R y + rest|.

        Args:
            F: (T n_e, n) residuals of the balance.
            rest: (rows, n) terms that vanish at rest.
        """
        y = -self._solve_normal(np.concatenate([self.by_series.T @ F, self.by_scalars.T @ F]))
        V = self.vibrations
        amplitudes = np.linalg.lstsq(self.rest @ V, rest + self.rest @ y, rcond=None)[0]
        return np.asarray(y - V @ amplitudes)

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
            series: (size, n_e) coefficients of the deflections, in units of the springs.
            scalars: (k,) of the law.
            stiffer: factor of the robot's spring stiffness.
            near: configurations (T, nq) from which the loops are closed; those of the branch by default.

        Raises:
            NotAssembled: the deflections tear the loops.
        """
        branch = self.branch
        clock = self.family(scalars)
        prescribed, bases = self._prescribe(splines, series, clock.motion(splines.nodes.p))
        guess = branch.guess(prescribed.s) if near is None else near
        balance = evaluate_balance(branch.robot, prescribed, guess, wrenches=branch.wrenches, stiffer=stiffer)
        return BalanceState(splines, series, scalars, clock, bases, balance)

    def prescribe_at(self, state: BalanceState, z: float, u: float) -> DeflectedMotion:
        """Return the motion at z and u of the law, with the deflections of a state as functions of xi."""
        assert isinstance(state.clock, OnParameter)
        motion = state.clock.motion_at(state.splines.nodes.p, z, u)
        return self._prescribe(state.splines, state.series, motion)[0]

    def _prescribe(
        self, splines: DeflectionSplines, series: Array, motion: tuple[list[Array], Array, Array]
    ) -> tuple[DeflectedMotion, Array]:
        """Return motion and deflections at the nodes, and the bases of a `BalanceState`.

        Args:
            series: (size, n_e) coefficients of the deflections, in units of the springs.
            motion: of the law: s, dp/dt and d2p/dt2 (T,).
        """
        s, rate, acceleration = motion
        bases = _time_bases(splines.nodes.bases, rate, acceleration)
        deflections = [splines.combine(basis, series) * self.units for basis in bases]
        return DeflectedMotion(s[0], *time_derivatives(self.branch.path, s), *deflections), bases

    def linearise(self, state: BalanceState, misfit: float = np.inf) -> LinearBalance:
        """Return the linear equations for steps from this state and from neighbouring states.

        Args:
            misfit: |F| over the largest load that steps aim at.
        """
        by_series, by_scalars, by_values = self.slopes(state)
        stiffness = column_sizes(by_values) / column_sizes(by_series)  # (C,) shares
        largest = LARGEST_VIBRATION if misfit > LEAST_LOOSE_MISFIT else WEAK_COLUMN
        vibration = min(VIBRATION_SHARE * stiffness.min(), largest)
        return LinearBalance.factorise(by_series, by_scalars, self._rest_matrix(state), vibration)

    def slopes(self, state: BalanceState) -> tuple[Any, Array, Any]:
        """Compute derivatives of F = Y' load at a state, by the series and by the scalars.

        A coefficient c_ji of spring i changes F_e at a node by the sum over the orders o of F_e,oi b_j^(o),
        with b_j^(o) the o-th time derivative of the spline j.

        Returns:
            A sparse matrix (T n_e, C) by the series, an array (T n_e, k) by the scalars, and the part of the
            matrix by values of deflections alone, without their rates and accelerations.
        """
        robot, n_e = self.branch.robot, self.branch.robot.n_e
        to_F = state.balance.Y.swapaxes(1, 2)  # (T, n_e, f)
        by_deflections = to_F @ deflection_slopes(robot, state.balance, self.orders)  # (T, n_e, orders n_e)
        by_order = by_deflections.reshape(-1, n_e, self.orders, n_e)
        splines = state.splines.nodes.columns
        unknowns = (splines[:, :, None] * n_e + np.arange(n_e)).reshape(len(splines), -1)

        def assemble_matrix(orders: int) -> Any:
            """Return the matrix of the first orders of derivatives."""
            bases = state.bases[:orders].transpose(1, 2, 0)  # (T, SPLINE_DEGREE + 1, orders)
            values = (bases[:, None] @ by_order[:, :, :orders]).reshape(-1, n_e, (SPLINE_DEGREE + 1) * n_e)
            return banded_rows(values, unknowns, state.series.size)

        by_series, by_values = assemble_matrix(self.orders), assemble_matrix(1)
        return by_series, self._slopes_by_scalars(state, to_F), by_values

    def _slopes_by_scalars(self, state: BalanceState, to_F: Array) -> Array:
        """Compute the derivatives (T n_e, k) of F by the scalars of the law, as central differences.

        They are taken about the law of zero scalars, whose neighbours serve all states.

        Args:
            to_F: (T, n_e, f) Y', from loads to F.
        """

        def balance_under(clock: Clock) -> Array:
            """Compute F (T n_e,) along the motion under another law, with the deflections of the state."""
            motion = clock.motion(state.splines.nodes.p)
            prescribed, _bases = self._prescribe(state.splines, state.series, motion)
            return matvec(to_F, forces_of_neighbour(self.branch.robot, state.balance, prescribed)).ravel()

        slopes = np.zeros((state.balance.F.size, len(self.steps)))
        for k, (forward, backward) in enumerate(self._neighbours):
            slopes[:, k] = (balance_under(forward) - balance_under(backward)) / (2.0 * self.steps[k])
        return slopes

    @cached_property
    def _neighbours(self) -> list[tuple[Clock, Clock]]:
        """The laws with one scalar of plus and of minus its step, for each scalar."""
        return [(self.family(change), self.family(-change)) for change in np.diag(self.steps)]

    def _rest_matrix(self, state: BalanceState) -> Array:
        """Compute the derivative (rows, C + k) of the terms that vanish at rest.

        Rows are rate and acceleration of each spring at both ends, over the spring's largest in the motion.
        There are none if rates cause no forces, or if the law itself is not at rest to its sixth derivative:
        then springs that do not vibrate are not at rest either.
        C is the number of coefficients of the series, k that of the law's scalars.
        """
        # rate or acceleration over that of the quickest spring; below, rest counts less
        negligible_spring = 1e-3
        splines, prescribed = state.splines, state.balance.prescribed
        law = state.clock.law
        is_at_rest = (
            isinstance(law, OptimalLaw) and law.smoothness == HIGHEST_SMOOTHNESS and not any(law.moving)
        )
        if self.orders == 1 or not is_at_rest:
            return np.zeros((0, state.series.size + len(self.steps)))
        ends = splines.cells[[0, -1]]
        intervals = splines.intervals[[0, -1]]
        _, rate, acceleration = state.clock.motion(ends)
        bases = _time_bases(splines.bases(intervals, ends), rate, acceleration)[1:]  # without the values
        rows = np.zeros((2, 2, splines.size))  # order by end
        rows[:, np.arange(2)[:, None], splines.columns(intervals)] = bases
        sizes = np.abs([prescribed.dl, prescribed.ddl]).max(axis=1) / self.units  # (2, n_e)
        largest = sizes.max(axis=1, keepdims=True)
        # a spring that hardly moves counts by the largest motion of all springs
        weights = 1.0 / np.maximum(sizes, negligible_spring * np.where(largest > 0.0, largest, 1.0))
        weights[1] *= MAX_END_RATE / MAX_END_ACCELERATION  # accelerations may be larger at the ends
        # order o, end p, spring e; spline s of spring f: each spring depends on its own coefficients alone
        by_series = np.einsum("ops,oe,ef->opesf", rows, weights, np.eye(len(self.units)))
        return np.pad(by_series.reshape(-1, state.series.size), ((0, 0), (0, len(self.steps))))


def _time_bases(bases: Array, rate: Array, acceleration: Array) -> Array:
    """Convert values and derivatives by p (3, T, k) into time derivatives.

    The rates dp/dt and accelerations d2p/dt2 are (T,).

    Args:
        bases: values and first and second derivatives by p of the k splines that are not zero.
    """
    value, slope, bend = bases
    rate, acceleration = rate[:, None], acceleration[:, None]
    return np.stack([value, rate * slope, rate**2 * bend + acceleration * slope])
