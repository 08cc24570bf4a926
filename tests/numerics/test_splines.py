"""B-splines against scipy's, and least squares with banded rows against dense ones."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from framework.dynamics.deflection_splines import SPLINE_DEGREE, DeflectionSplines
from framework.numerics.splines import (
    BandedFactor,
    banded_rows,
    column_sizes,
    find_intervals,
    spline_values,
)

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("degree", [2, 5, 13])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_values_and_derivatives_are_those_of_scipy(degree, order):
    cells = np.sort(np.concatenate([[-1.0, 1.0], RNG.uniform(-1.0, 1.0, 9)]))
    knots = np.concatenate([np.full(degree, -1.0), cells, np.full(degree, 1.0)])
    x = np.linspace(-1.0, 1.0, 101)
    intervals = find_intervals(knots, degree, x)
    ours = np.zeros((len(x), len(knots) - degree - 1))
    columns = intervals[:, None] + np.arange(-degree, 1)
    ours[np.arange(len(x))[:, None], columns] = spline_values(knots, degree, intervals, x, order)
    theirs = BSpline(knots, np.eye(ours.shape[1]), degree)(
        x[:-1], nu=order
    )  # scipy leaves the last point open
    np.testing.assert_allclose(ours[:-1], theirs, atol=1e-12 * np.abs(theirs).max())


@pytest.mark.parametrize("continuity", [-1, 0, 2])
def test_halved_cells_keep_a_function_of_two_panels(continuity):
    coarse = DeflectionSplines.uniform(np.array([-1.0, 0.3, 1.0]), 12, continuity=continuity)
    fine = coarse.halve(RNG.random(len(coarse.cells) - 1) < 0.5)
    series = RNG.normal(size=(coarse.size, 2))
    x = np.concatenate([np.linspace(-1.0, 1.0, 201), [0.3]])
    for order in range(3):
        before = coarse.evaluate(series, x, order)
        after = fine.evaluate(fine.insert(coarse, series), x, order)
        np.testing.assert_allclose(after, before, atol=1e-12 * np.abs(before).max())


def test_a_fit_reproduces_polynomials_of_the_degree_of_the_splines():
    splines = DeflectionSplines.uniform(np.array([-1.0, 1.0]), 10, continuity=-1)
    powers = np.arange(SPLINE_DEGREE + 1)
    series = splines.fit(splines.nodes.p[:, None] ** powers)
    x = np.linspace(-1.0, 1.0, 99)
    np.testing.assert_allclose(splines.evaluate(series, x), x[:, None] ** powers, atol=1e-9)


def test_banded_least_squares_are_those_of_numpy():
    columns = np.sort(RNG.integers(0, 6, 20))[:, None] + np.arange(3)
    rows = banded_rows(RNG.normal(size=(20, 2, 3)), columns, 8)
    right = RNG.normal(size=(40, 3))
    dense = rows.toarray()
    np.testing.assert_allclose(column_sizes(rows), np.linalg.norm(dense, axis=0))
    expected = np.linalg.lstsq(np.vstack([dense, 0.1 * np.eye(8)]), np.vstack([right, np.zeros((8, 3))]))[0]
    np.testing.assert_allclose(
        BandedFactor.factor_squares(rows, 0.01).solve(rows.T @ right), expected, atol=1e-12
    )
