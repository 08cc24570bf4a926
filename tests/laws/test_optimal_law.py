"""The law of free shape: its time by quadrature, its derivatives, and how exactly time is inverted."""

import mpmath as mp
import numpy as np
import pytest
from numpy.polynomial import chebyshev

from framework import InvalidInput, Law
from framework.laws.optimal_law import OptimalLaw, Smoothstep, count_reversals
from framework.laws.squared_speed import STRETCH_HEIGHT, STRETCH_WIDTH
from framework.numerics.chebyshev import TimeGrid

RNG = np.random.default_rng(7)


def series(degree: int) -> np.ndarray:
    """A positive squared speed [1/s^2] that varies about fivefold."""
    coefficients = 0.25 * RNG.normal(size=degree + 1) / (1 + np.arange(degree + 1))
    coefficients[0] = 2.0
    return coefficients


LAWS = [OptimalLaw(series(degree), smoothness) for degree, smoothness in ((3, 2), (20, 2), (40, 3), (20, 4))]
LAWS += [OptimalLaw(series(20), 2, dense_at=(0.3,)), OptimalLaw(series(20), 3, dense_at=(0.35, 0.6))]
CELLS = (-1.0, -0.7, -0.5, -0.1, 0.2, 0.25, 0.6, 1.0)
LAWS += [OptimalLaw(RNG.uniform(1.0, 3.0, len(CELLS) + 4), 2, 0.0, (0.3,), CELLS)]
laws = pytest.mark.parametrize(
    "law", LAWS, ids=lambda law: f"{law.degree}-{law.smoothness}-{len(law.dense_at)}-{len(law.cells)}"
)


def exact_phi(sigma: mp.mpf, R: int) -> mp.mpf:
    """The smoothstep from its definition, phi' proportional to (sigma (1 - sigma))^R."""
    whole = mp.beta(R + 1, R + 1)
    return (
        sum(mp.binomial(R, k) * (-1) ** k * sigma ** (R + k + 1) / (R + k + 1) for k in range(R + 1)) / whole
    )


def exact_xi(law: OptimalLaw, sigma: mp.mpf) -> mp.mpf:
    def raw(at: mp.mpf) -> mp.mpf:
        return at + STRETCH_HEIGHT * sum(
            mp.atan((at - mp.mpf(place)) / STRETCH_WIDTH) for place in law.dense_at
        )

    return 2 * (raw(sigma) - raw(mp.mpf(0))) / (raw(mp.mpf(1)) - raw(mp.mpf(0))) - 1


def exact_speed(law: OptimalLaw, sigma: mp.mpf) -> mp.mpf:
    x, out = exact_xi(law, sigma), mp.mpf(0)
    if len(law.cells) > 2:
        return exact_spline(law, x)
    below, polynomial = x, mp.mpf(1)  # T_-1 = T_1
    for c in law.coefficients:
        out += mp.mpf(float(c)) * polynomial
        below, polynomial = polynomial, 2 * x * polynomial - below
    return out


def exact_spline(law: OptimalLaw, x: mp.mpf) -> mp.mpf:
    """The sum of quintic B-splines by the recurrence of Cox and de Boor."""
    knots = [mp.mpf(-1)] * 5 + [mp.mpf(cell) for cell in law.cells] + [mp.mpf(1)] * 5

    def spline(i: int, degree: int) -> mp.mpf:
        if degree == 0:
            return mp.mpf(int(knots[i] <= x < knots[i + 1] or (x == 1 == knots[i + 1] > knots[i])))
        left, right = knots[i + degree] - knots[i], knots[i + degree + 1] - knots[i + 1]
        return ((x - knots[i]) / left * spline(i, degree - 1) if left else 0) + (
            (knots[i + degree + 1] - x) / right * spline(i + 1, degree - 1) if right else 0
        )

    return mp.fsum(mp.mpf(float(y)) * spline(i, 5) for i, y in enumerate(law.coefficients))


def test_the_squared_speed_of_a_spline_against_its_recurrence():
    law = LAWS[-1]
    for sigma in (0.0, 0.1, 0.37, 0.5, 0.83, 1.0):
        exact = float(exact_spline(law, exact_xi(law, mp.mpf(sigma))))
        assert float(law.squared_speed(sigma)) == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize("cells", [(-1.0,), (-1.0, 0.5, 0.2, 1.0), (-0.9, 0.0, 1.0), (-1.0, 0.0, 1.0)])
def test_cells_that_do_not_fit_are_refused(cells):
    with pytest.raises(InvalidInput, match="cells"):
        OptimalLaw(np.ones(9), 2, 0.0, (), cells)


@pytest.mark.parametrize("swings", [0, 1, 3])
def test_turns_are_counted_between_the_ends(swings):
    t = np.linspace(0.0, 1.0, 2001)
    speed = 1.0 - np.cos(2 * np.pi * (swings + 1) * t)
    assert count_reversals(speed) == 2 * swings + 1
    assert count_reversals(speed + 1e-4 * np.sin(200 * t)) == 2 * swings + 1


@pytest.mark.parametrize("R", [2, 3, 4, 6])
def test_the_smoothstep_and_its_derivatives_against_many_digits(R):
    phi = Smoothstep(R)
    for sigma in (1e-6, 0.01, 0.3, 0.5, 0.77, 0.999):
        exact = mp.mpf(sigma)
        for order in range(5):
            with mp.workdps(90):
                true = float(mp.diff(lambda x: exact_phi(x, R), exact, order))
            largest = np.abs(phi(np.linspace(0, 1, 201), order)).max() if sigma == 0.5 else 0.0
            # in the middle the powers cancel, and the even derivatives vanish
            assert float(phi(sigma, order)) == pytest.approx(true, rel=1e-11, abs=1e-12 * largest)
        assert float(phi(phi.inverse(sigma))) == pytest.approx(sigma, rel=1e-12)


@pytest.mark.parametrize(
    "law", [pytest.param(LAWS[1], marks=pytest.mark.slow), LAWS[4]], ids=["20", "stretched"]
)
def test_time_is_the_integral_of_the_slowness(law):
    with mp.workdps(30):
        for sigma in (0.2, 1.0):
            exact = mp.quad(lambda x: 1 / mp.sqrt(exact_speed(law, x)), mp.linspace(0, sigma, 9))
            assert float(law.time(sigma)) == pytest.approx(float(exact), rel=1e-14)


@laws
def test_the_parameter_inverts_time_to_rounding(law):
    t = np.linspace(0.0, law.duration, 1001)
    assert np.abs(law.time(law.parameter(t)) - t).max() < 1e-15 * max(law.duration, 1.0)
    assert law.time(1.0) == law.duration == law.edges[-1]


@laws
def test_each_derivative_is_that_of_the_one_before(law):
    edges = np.union1d(np.linspace(0.0, law.duration, 21), law.edges if len(law.cells) > 2 else [])
    grid = TimeGrid(edges, 32)
    t = np.linspace(0.0, law.duration, 997)
    for order in range(1, 5):
        below = grid.fit(law(grid.times, order - 1)[:, None])
        assert np.abs(below(t, 1)[:, 0] - law(t, order)).max() < 1e-8 * np.abs(law(t, order)).max()


@laws
def test_the_ends_are_at_rest_to_the_order_of_smoothness(law):
    ends = np.array([0.0, law.duration])
    np.testing.assert_allclose(law(ends), [0.0, 1.0], rtol=0, atol=1e-15)
    middle = np.linspace(0.0, law.duration, 101)
    for order in range(1, min(law.smoothness, 4) + 1):
        assert np.abs(law(ends, order)).max() < 1e-9 * np.abs(law(middle, order)).max()


def test_a_constant_speed_is_the_smoothstep_of_time_itself():
    law = OptimalLaw(np.array([4.0]), 2)
    t = np.linspace(0.0, 0.5, 41)
    plain = Law.rest_to_rest(0.5, 2)
    assert law.duration == pytest.approx(0.5, rel=1e-15)
    for order in range(5):
        np.testing.assert_allclose(law(t, order), plain(t, order), rtol=0, atol=1e-12 * 2.0 ** (order + 5))


def test_the_square_of_the_speed_along_the_path_is_linear_in_z():
    law = LAWS[1]
    sigma = np.linspace(0.05, 0.95, 19)
    t = law.time(sigma)
    z = chebyshev.chebval(2 * sigma - 1, law.coefficients)
    np.testing.assert_allclose(law(t, 1) ** 2, law.phi(sigma, 1) ** 2 * z, rtol=1e-12)


def test_a_given_duration_is_kept_to_the_last_bit():
    coefficients = LAWS[1].coefficients
    duration = LAWS[1].duration * (1 + 3e-15)
    assert OptimalLaw(coefficients, 2, duration).duration == duration
    assert OptimalLaw(coefficients, 2, duration)(duration) == 1.0
    with pytest.raises(InvalidInput, match="takes"):
        OptimalLaw(coefficients, 2, 1.001 * duration)


@pytest.mark.parametrize("bad", [[1.0, 1.5], [-1.0], [np.nan, 0.0], [1.0, 1.0]])
def test_a_speed_that_vanishes_is_no_law(bad):
    with pytest.raises(InvalidInput, match="law"):
        OptimalLaw(np.array(bad), 2)


@pytest.mark.parametrize("t", [-0.1, np.nan, 1e9])
def test_instants_outside_are_refused(t):
    with pytest.raises(InvalidInput, match="outside"):
        LAWS[0](t)


def test_a_law_s_squared_speed_has_its_degree_and_no_more():
    """The derivative of that order is there, the next one is nothing."""
    xi = np.linspace(-0.99, 0.99, 9)
    for law in LAWS:
        assert np.abs(law.basis.matrix(xi, law.degree).values).max() > 0
        if len(law.cells) == 2:  # one polynomial
            assert not np.any(law.basis.matrix(xi, law.degree + 1).values)


@pytest.mark.parametrize("moving", [(False, False), (True, False), (False, True), (True, True)])
def test_a_law_says_at_which_ends_it_moves(moving):
    said = OptimalLaw(np.array([4.0]), 2, moving=moving).to_dict().get("moving", [False, False])
    assert tuple(said) == moving
