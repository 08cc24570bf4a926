"""A law printed with a few decimals, in powers of t.

What goes wrong: the twelfth-degree law of the paper has coefficients of size 400 and more that cancel to
values between 0 and 1. Rounded to the two decimals that are printed, it ends at s = 1.77 instead of 1, and
its condition at the crossing is lost long before.
Why: powers of t are nearly parallel on an interval: what is small in the law is not small in them.
What we do: coefficients belong to Chebyshev polynomials, none larger than one: what is rounded off a
coefficient is all that is lost in s.
"""

from functools import cache

import numpy as np

import robots
from framework import plan_scene
from tests.oracles.planar import CROSSING_SPEED, CROSSING_TIME, DURATION, crossing_coordinate, mp, power_law

DECIMALS = np.arange(1, 11)
TIMES = np.linspace(0.0, DURATION, 301)


@cache
def laws():
    """Scene C's law of degree 12: exact powers, and ours."""
    ours = plan_scene(robots.load("five_bar", flexibility="flexible_joints"), "C").law
    return power_law((crossing_coordinate(), mp.mpf(CROSSING_SPEED), mp.zero), smoothness=4), ours


def errors(decimals: int) -> tuple[float, float]:
    """Largest |error| of s(t) when coefficients are rounded: in powers of t, and of Chebyshev."""
    powers, ours = laws()
    exact = np.array([float(sum(c * mp.mpf(t) ** k for k, c in enumerate(powers))) for t in TIMES])
    rounded = np.polynomial.Polynomial([float(mp.nint(c * 10**decimals) / 10**decimals) for c in powers])
    kept = type(ours)(np.round(ours.coefficients, decimals), ours.duration)
    return float(np.abs(rounded(TIMES) - exact).max()), float(np.abs(kept(TIMES) - exact).max())


def test_two_decimals_of_powers_end_somewhere_else():
    direct, ours = np.array([errors(decimals) for decimals in DECIMALS]).T
    assert direct[DECIMALS == 2] > 0.1
    # thirteen coefficients, each off by half a unit of the last decimal at most
    assert np.all(ours <= 13 * 0.5 * 10.0**-DECIMALS + 1e-14)
    assert np.all(direct > 3 * ours)


def test_ours_is_the_exact_law_at_the_crossing_too():
    _, ours = laws()
    found = [float(ours(CROSSING_TIME, order)) for order in range(3)]
    np.testing.assert_allclose(found, [float(crossing_coordinate()), CROSSING_SPEED, 0.0], atol=1e-13)
