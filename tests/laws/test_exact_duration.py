"""The integral of z^(-1/2) and laws that take exactly so long, against mpmath."""

import mpmath as mp
import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.interpolate import BSpline

from framework import InvalidInput
from framework.laws.optimal_law import OptimalLaw
from framework.laws.squared_speed import (
    ONE_CELL,
    SPLINE_DEGREE,
    Instants,
    SpeedBasis,
    SpeedSpace,
    Stretch,
)
from framework.numerics.cone_program import Affine

SERIES = SpeedSpace(SpeedBasis(np.array(ONE_CELL), 3), Stretch())
CELLS = np.linspace(-1.0, 1.0, 8)
SPLINES = SpeedSpace(SpeedBasis.from_cells(CELLS), Stretch())
NOTHING = Affine(np.empty((0, 3)), np.empty(0))


def ending(duration: float) -> Instants:
    return Instants.of((), (), duration)


def dipping(least: float, at: float = 0.3) -> np.ndarray:
    """z = least + (sigma - at)^2 as a series in 2 sigma - 1."""
    return chebyshev.poly2cheb([least + (0.5 - at) ** 2, 0.5 - at, 0.25])


@pytest.mark.parametrize("least", [1e-1, 1e-4, 1e-8])
def test_a_duration_is_right_however_near_to_zero_the_speed_comes(least):
    exact = mp.asinh((1 - 0.3) / mp.sqrt(least)) + mp.asinh(0.3 / mp.sqrt(least))
    # what rounding of z leaves: eps over the least z, where the speed is that
    assert SERIES.duration(dipping(least)) == pytest.approx(float(exact), rel=1e-14 + 1e-16 / least)


def test_an_adjusted_series_meets_its_conditions_and_its_duration_to_rounding():
    conditions = Affine(np.array([[1.0, 2.0, -1.0]]), np.array([-0.3]))
    start = dipping(0.1)
    found = SERIES.adjust(start, conditions, ending(1.02 * SERIES.duration(start)))
    assert np.abs(conditions(found)).max() < 1e-14
    law = OptimalLaw(found, 2, 1.02 * SERIES.duration(start))
    assert law.duration == 1.02 * SERIES.duration(start)


def test_a_speed_that_stops_takes_for_ever():
    with pytest.raises(InvalidInput, match="too near to zero"):
        SERIES.duration(dipping(0.0))
    with pytest.raises(InvalidInput, match="too near to zero"):
        SERIES.adjust(dipping(-0.01), NOTHING, ending(1.0))


def spline_of(series: np.ndarray) -> np.ndarray:
    """Coefficients of the spline that is a polynomial of xi, by collocation at the centres."""
    at = SPLINES.basis.centres
    return np.linalg.solve(SPLINES.basis.matrix(at).toarray(), chebyshev.chebval(at, series))


@pytest.mark.parametrize("least", [1e-1, 1e-4])
def test_a_spline_of_the_same_speed_takes_the_same_time(least):
    exact = mp.asinh((1 - 0.3) / mp.sqrt(least)) + mp.asinh(0.3 / mp.sqrt(least))
    assert SPLINES.duration(spline_of(dipping(least))) == pytest.approx(
        float(exact), rel=1e-13 + 1e-15 / least
    )


def test_an_adjusted_spline_meets_its_conditions_and_its_duration_to_rounding():
    row = SPLINES.basis.matrix(np.array([0.4]), 1)
    conditions = Affine(row, np.array([0.05]))
    start = spline_of(dipping(0.1))
    duration = 1.02 * SPLINES.duration(start)
    found = SPLINES.adjust(start, conditions, ending(duration))
    assert np.abs(conditions(found)).max() < 1e-14
    assert OptimalLaw(found, 2, duration, (), tuple(CELLS)).duration == duration


@pytest.mark.parametrize("order", [0, 1, 2])
def test_splines_and_their_derivatives_are_those_of_scipy(order):
    xi = np.union1d(CELLS, np.random.default_rng(7).uniform(-1.0, 1.0, 50))
    basis = SPLINES.basis
    expected = BSpline(basis.splines.knots, np.eye(basis.size), SPLINE_DEGREE)(xi, order)
    np.testing.assert_allclose(basis.matrix(xi, order).toarray(), expected, rtol=0.0, atol=1e-11)
