"""The integral of z^(-1/2) and laws that take exactly so long, against mpmath."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from numpy.polynomial import chebyshev

from framework.errors import InvalidInput
from framework.motion.cone_program import Affine
from framework.motion.exact_duration import adjusted, blended, duration_of
from framework.motion.optimal_law import OptimalLaw, Stretch

PLAIN = Stretch()
NOTHING = Affine(np.empty((0, 3)), np.empty(0))


def dipping(least: float, at: float = 0.3) -> np.ndarray:
    """z = least + (sigma - at)^2 as a series in 2 sigma - 1."""
    return chebyshev.poly2cheb([least + (0.5 - at) ** 2, 0.5 - at, 0.25])


@pytest.mark.parametrize("least", [1e-1, 1e-4, 1e-8])
def test_a_duration_is_right_however_near_to_zero_the_speed_comes(least):
    exact = mp.asinh((1 - 0.3) / mp.sqrt(least)) + mp.asinh(0.3 / mp.sqrt(least))
    # what rounding of z leaves: eps over the least z, where the speed is that
    assert duration_of(dipping(least), PLAIN) == pytest.approx(float(exact), rel=1e-14 + 1e-16 / least)


def test_a_blend_takes_the_time_asked():
    quick, slow = dipping(0.1), dipping(1e-3, at=0.6)
    duration = 0.5 * (duration_of(quick, PLAIN) + duration_of(slow, PLAIN))
    between = blended(quick, slow, duration, PLAIN)
    assert duration_of(between, PLAIN) == pytest.approx(duration, rel=1e-9)
    share = (between - slow) @ (quick - slow) / ((quick - slow) @ (quick - slow))
    assert 0 < share < 1
    np.testing.assert_allclose(between, slow + share * (quick - slow), atol=1e-14)


def test_an_adjusted_series_meets_its_conditions_and_its_duration_to_rounding():
    conditions = Affine(np.array([[1.0, 2.0, -1.0]]), np.array([-0.3]))
    start = dipping(0.1)
    found = adjusted(start, conditions, 1.02 * duration_of(start, PLAIN), PLAIN)
    assert np.abs(conditions(found)).max() < 1e-14
    law = OptimalLaw(found, 2, 1.02 * duration_of(start, PLAIN))
    assert law.duration == 1.02 * duration_of(start, PLAIN)


def test_a_speed_that_stops_takes_for_ever():
    with pytest.raises(InvalidInput, match="too near to zero"):
        duration_of(dipping(0.0), PLAIN)
    with pytest.raises(InvalidInput, match="too near to zero"):
        adjusted(dipping(-0.01), NOTHING, 1.0, PLAIN)
