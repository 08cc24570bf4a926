"""The motion law: its conditions, the paper's laws, and whether it always advances."""

import mpmath as mp
import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial, chebyshev

from framework import Condition, InvalidInput, Law
from framework.laws.law import REST, Ends, speed_ratios_and_peaks

EPS = np.finfo(float).eps
DURATION = 1.5


def crossing(time: float, s: float, speed: float, acceleration: float) -> list[Condition]:
    return [Condition(time, 0, s), Condition(time, 1, speed), Condition(time, 2, acceleration)]


ONE = crossing(1.0, 0.667, 1.5, -0.2)
FIVE = [c for k in range(5) for c in crossing(0.25 * (k + 1), 0.1 + 0.2 * k, 0.7 + 0.1 * k, 0.3 * (-1) ** k)]
LAWS = [  # degree, smoothness, conditions inside
    (5, 2, []),
    (9, 4, []),
    (8, 2, ONE),
    (12, 4, ONE),
    (24, 4, FIVE),
]
cases = pytest.mark.parametrize(("degree", "smoothness", "inner"), LAWS, ids=[f"{n}" for n, *_ in LAWS])


def all_conditions(smoothness: int, inner: list[Condition]) -> list[Condition]:
    ends = [Condition(t, k, float(t > 0 and k == 0)) for t in (0.0, DURATION) for k in range(smoothness + 1)]
    return [*ends, *inner]


def exact_law(conditions: list[Condition]) -> list[mp.mpf]:
    """Powers of t of the law that meets all conditions, by brute force with many digits."""
    count = len(conditions)

    def row(t, order):
        return [mp.ff(p, order) * mp.mpf(t) ** (p - order) if p >= order else 0 for p in range(count)]

    system = mp.matrix([row(t, order) for t, order, _ in conditions])
    return list(mp.lu_solve(system, mp.matrix([value for *_, value in conditions])))


def derivative(powers, t, order):
    return mp.fsum(c * mp.ff(p, order) * mp.mpf(t) ** (p - order) for p, c in enumerate(powers) if p >= order)


@cases
def test_its_coefficients_meet_the_conditions_in_fifty_digits(degree, smoothness, inner):
    """No help from cancellation in floating point: the stored numbers are taken as exact."""
    law = Law.rest_to_rest(DURATION, smoothness, inner)
    assert law.degree == degree == len(all_conditions(smoothness, inner)) - 1
    with mp.workdps(50):
        series = [mp.mpf(float(c)) for c in law.coefficients]

        def s(t):
            x = 2 * t / DURATION - 1
            return mp.fsum(c * mp.chebyt(k, x) for k, c in enumerate(series))

        powers = mp.taylor(s, 0, degree)
        for t, order, value in all_conditions(smoothness, inner):
            assert abs(derivative(powers, t, order) - value) < _rounding(law, order)


def _rounding(law: Law, order: int) -> float:
    """What half an ulp in each coefficient can do to a derivative, at the ends of [0, T]; 4 times it."""
    each = np.abs(law.coefficients)
    slopes = chebyshev.chebval(1.0, chebyshev.chebder(np.eye(len(each)), order))  # T_k^(m)(1), the largest
    return 4 * EPS * float(each @ slopes) * (2 / law.duration) ** order


@cases
def test_the_law_is_the_one_of_fifty_digits_in_between(degree, smoothness, inner):
    law = Law.rest_to_rest(DURATION, smoothness, inner)
    times = np.linspace(0, DURATION, 31)
    with mp.workdps(50):
        powers = exact_law(all_conditions(smoothness, inner))
        for order in range(3):
            exact = np.array([float(derivative(powers, t, order)) for t in times])
            np.testing.assert_allclose(law(times, order), exact, rtol=0, atol=_rounding(law, order))


@pytest.mark.parametrize("duration", [np.nan, np.inf, 0.0, -1.0, True, "1", None, [1.0], 10**400])
def test_a_law_is_not_made_for_what_is_no_duration(duration):
    with pytest.raises(InvalidInput, match="duration"):
        Law(np.array([0.5, 0.5]), duration)


@pytest.mark.parametrize(
    "values", [[np.nan, 0.5], [0.5, np.inf], [], [[0.5, 0.5]], 0.5, True, "ab", [1j, 0.0]]
)
def test_a_law_is_not_made_of_what_are_no_coefficients(values):
    with pytest.raises(InvalidInput, match="coefficients"):
        Law(values, 1.0)
    with pytest.raises(InvalidInput, match="coefficients"):
        Law(np.array(values), 1.0)


def test_a_list_of_coefficients_is_stored_as_an_array():
    law = Law([0.5, 0.5], 2)
    assert law.coefficients.dtype == float
    assert law(1.0) == 0.5


def test_derivatives_have_the_shape_of_the_times():
    law = Law.rest_to_rest(DURATION, 4, ONE)
    for t in (0.3, np.array(0.3), np.full(3, 0.3), np.full((2, 3), 0.3)):
        for order in (0, 1, 4, 13, 20):
            assert law(t, order).shape == np.shape(t)
    assert np.all(law(np.linspace(0, DURATION, 5), 13) == 0.0)  # beyond the degree


PAPER = [  # smoothness, conditions inside, printed coefficients of t^5, t^6, ...
    (4, crossing(1.0, 2 / 3, 1.5, 0.0), [14.96, -6.38, -128.38, 334.66, -381.71, 230.08, -71.67, 9.12]),
    (4, [], [16.59, -36.87, 31.6, -12.29, 1.82]),
]
printed = pytest.mark.parametrize(("smoothness", "inner", "powers"), PAPER, ids=["Eq. (32)", "ninth degree"])


@printed
def test_the_papers_laws_come_out_when_rounded_to_two_decimals(smoothness, inner, powers):
    law = Law.rest_to_rest(DURATION, smoothness, inner)
    ours = Chebyshev(law.coefficients, domain=[0, DURATION]).convert(kind=Polynomial).coef
    np.testing.assert_array_equal(np.round(ours[5:], 2), powers)
    np.testing.assert_allclose(ours[:5], 0.0, atol=1e-12)  # cancels out of numbers up to 1e3


def test_the_printed_coefficients_cannot_be_used_as_they_are():
    ends = [Polynomial([0] * 5 + powers)(DURATION) for *_, powers in PAPER]
    assert [round(end, 2) for end in ends] == [1.77, 0.91]  # of the path, where 1 is its end


@pytest.mark.parametrize(
    ("conditions", "duration", "words"),
    [
        ([Condition(0, 0, 0), Condition(0, 0, 1)], 1.0, "repeat or contradict"),
        ([Condition(0, 0, 0), Condition(0, 0, 0)], 1.0, "repeat or contradict"),
        ([Condition(0, 1, 0), Condition(1, 1, 1)], 1.0, "repeat or contradict"),  # no value of s at all
        ([Condition(0, 0, 0), Condition(1, 3, 1)], 1.0, "repeat or contradict"),  # beyond the degree
        ([*all_conditions(2, ONE), ONE[1]], DURATION, "repeat or contradict"),
        ([Condition(0, 0, np.nan)], 1.0, r"condition s\^\(0\)\(0\) = nan must be finite"),
        ([Condition(0, 0, np.inf)], 1.0, "must be finite"),
        ([Condition(np.nan, 0, 0)], 1.0, "must be finite"),
        ([Condition(2.0, 0, 0)], 1.0, r"2\.0.*inside \[0, 1\] s"),
        ([Condition(-0.1, 0, 0)], 1.0, r"inside \[0, 1\] s"),
        ([Condition(0, 0, "1")], 1.0, r"conditions: needs real numbers, got \[\(0, '1'\)\]"),
        ([Condition(0, 0, [1, 2])], 1.0, "conditions: needs real numbers"),
        ([Condition(0, 0, 0)], 0.0, r"duration: must be a positive number of seconds, got 0\.0"),
        ([Condition(0, 0, 0)], -1.0, "duration.*-1"),
        ([Condition(0, 0, 0)], np.nan, "duration.*nan"),
        ([Condition(0, 0, 0)], np.inf, "duration.*inf"),
    ],
)
def test_impossible_conditions_raise(conditions, duration, words):
    with pytest.raises(InvalidInput, match=words):
        Law.from_conditions(conditions, duration)


def law_with_slope(smoothness: int, factor: Polynomial) -> Law:
    """s' proportional to (t (T - t))^smoothness times `factor`, from 0 to 1: exact up to rounding."""
    ends = Polynomial([0, DURATION, -1]) ** smoothness
    s = (ends * factor).integ()
    s = s / s(DURATION)
    return Law(s.convert(kind=Chebyshev, domain=[0, DURATION]).coef, DURATION)


@pytest.mark.parametrize("smoothness", [2, 4])
@pytest.mark.parametrize("place", [0.0, 0.1, 0.75, 1.4, 1.5])
@pytest.mark.parametrize("depth", [1.0, 1e-3, 1e-6, -1e-6, -1e-3, -0.1])
def test_advance_is_positive_exactly_for_laws_that_advance(smoothness, place, depth):
    # the factor's least value on [0, T] is `depth`, at `place`, however near to an end
    law = law_with_slope(smoothness, Polynomial([place**2 + depth, -2 * place, 1]))
    assert np.sign(law.least_speed_ratio(smoothness)) == np.sign(depth)


@pytest.mark.parametrize("smoothness", [2, 4])
def test_advance_is_the_least_slope_over_the_mean_one(smoothness):
    law = law_with_slope(smoothness, Polynomial([1.0]))
    assert law.least_speed_ratio(smoothness) == pytest.approx(1.0, abs=1e-9)  # the ends are divided out


@pytest.mark.parametrize("seed", range(8))
def test_advance_agrees_with_a_fine_look_at_random_laws(seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.01, 0.99, 4001) * DURATION
    for _ in range(10):
        inner = crossing(rng.uniform(0.4, 1.1), rng.uniform(0.2, 0.8), rng.uniform(0.2, 2.5), rng.normal())
        law = Law.rest_to_rest(DURATION, 2, inner)
        least = (law(t, 1) / (t * (DURATION - t)) ** 2).min()
        if abs(least) > 0.05:  # what 4001 samples and the outermost hundredths decide for sure
            assert np.sign(law.least_speed_ratio(2)) == np.sign(least)


@pytest.mark.parametrize("smoothness", [2, 4])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_how_laws_advance_and_their_peaks_are_known_without_them(smoothness, count):
    rng = np.random.default_rng(count)
    times = DURATION * (np.arange(1, count + 1) + rng.uniform(-0.2, 0.2, (6, count))) / (count + 1)
    values = rng.uniform(0.2, 1.5, (6, count, 3))
    advances, peaks = speed_ratios_and_peaks(DURATION, smoothness, times, values)
    for k in range(6):
        inner = [c for t, value in zip(times[k], values[k], strict=True) for c in crossing(t, *value)]
        law = Law.rest_to_rest(DURATION, smoothness, inner)
        t = np.linspace(0.0, DURATION, 4003)[1:-1]
        slopes = law(t, 1) / (4.0 * t * (DURATION - t) / DURATION**2) ** smoothness
        # a polynomial between 16 samples a coefficient: (pi / 16)^2 / 8 of its size at most
        missed = 0.005 * np.abs(slopes).max() / np.abs(slopes).mean()
        assert -1e-9 <= advances[k] - law.least_speed_ratio(smoothness) <= missed
        assert 0.98 * np.abs(law(t, 2)).max() <= peaks[k] <= 1.00001 * np.abs(law(t, 2)).max()


@pytest.mark.parametrize("smoothness", [2, 4])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_no_law_advances_through_a_point_twice(smoothness, count):
    shares = np.arange(1, count + 1) / (count + 1)
    times = DURATION * np.tile(shares, (count, 1))
    values = np.stack([times / DURATION, np.ones_like(times), np.zeros_like(times)], axis=2)
    for k in range(1, count):  # the last law keeps its times
        times[k - 1, k], values[k - 1, k] = times[k - 1, k - 1], values[k - 1, k - 1]
    advances, peaks = speed_ratios_and_peaks(DURATION, smoothness, times, values)
    np.testing.assert_array_equal(advances[:-1], -np.inf)
    np.testing.assert_array_equal(peaks[:-1], np.inf)
    assert np.isfinite([advances[-1], peaks[-1]]).all()


def test_no_laws_have_no_measures():
    advances, peaks = speed_ratios_and_peaks(DURATION, 2, np.empty((0, 2)), np.empty((0, 2, 3)))
    assert advances.shape == peaks.shape == (0,)


@pytest.mark.parametrize("smoothness", [2, 4])
def test_coefficients_of_high_degree_are_kept_and_the_others_meet_the_conditions(smoothness):
    rng = np.random.default_rng(smoothness)
    inner = crossing(0.9, 0.55, 1.1, -0.4)
    high = 1e-2 * rng.normal(size=9)
    law = Law.rest_to_rest(DURATION, smoothness, inner, high)
    assert law.degree == 2 * smoothness + 4 + len(high)
    np.testing.assert_array_equal(law.coefficients[-len(high) :], high)
    for time, order, value in inner:
        assert law(time, order) == pytest.approx(value, abs=1e-10)
    assert law(0.0) == pytest.approx(0.0, abs=1e-13)
    assert law(DURATION) == pytest.approx(1.0, abs=1e-13)
    for order in range(1, smoothness + 1):
        largest = np.abs(law(np.linspace(0.0, DURATION, 1001), order)).max()
        np.testing.assert_allclose(law(np.array([0.0, DURATION]), order), 0.0, atol=1e-11 * largest)


@pytest.mark.parametrize("crossings", [0, 1, 2, 3])
@pytest.mark.parametrize("smoothness", [2, 4])
def test_the_least_degree_is_one_less_than_the_conditions(smoothness, crossings):
    """Of s and its derivatives at rest, and of s, s' and s" at each crossing: 8 and 12 in the paper."""
    assert REST.least_degree(smoothness, crossings) + 1 == 2 * (smoothness + 1) + 3 * crossings


def test_a_moving_end_gives_its_derivatives_and_is_at_rest_in_those_above():
    start, goal = Ends(start=(2.0, -3.0)).conditions(4)
    assert start.tolist() == [0.0, 2.0, -3.0, 0.0, 0.0]
    assert goal.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]
