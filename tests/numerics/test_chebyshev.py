"""Functions of time as Chebyshev series, against numpy, mpmath and closed forms."""

import tracemalloc

import mpmath as mp
import numpy as np
import pytest
from numpy.polynomial import chebyshev

from framework import InvalidInput
from framework.numerics.chebyshev import (
    TimeFunction,
    TimeGrid,
    coefficients,
    extrema,
    nodes,
    peak_sizes,
    real_roots,
    tail,
)

START, END = 0.3, 1.8
WHOLE = np.array([START, END])
EPS = np.finfo(float).eps


def fitted(function, edges=WHOLE, size=48) -> TimeFunction:
    grid = TimeGrid(np.asarray(edges, dtype=float), size)
    return grid.fit(function(grid.times)[:, None])


def waves(t):
    return np.exp(np.sin(3 * t))


@pytest.mark.parametrize("size", [2, 3, 8, 33, 64])
def test_coefficients_are_those_of_the_polynomial_sampled(size):
    series = np.random.default_rng(size).standard_normal(size)
    sampled = chebyshev.chebval(nodes(size), series)[:, None]
    np.testing.assert_allclose(coefficients(sampled)[:, 0], series, atol=size * EPS)


def test_nodes_ascend_from_end_to_end():
    assert nodes(7)[0] == -1.0
    assert nodes(7)[-1] == 1.0
    assert np.all(np.diff(nodes(7)) > 0)
    times = TimeGrid(np.array([START, 0.9, END]), 16).times
    assert times.shape == (32,)
    assert (times[0], times[15], times[16], times[31]) == (START, 0.9, 0.9, END)  # edges to the last bit


@pytest.mark.parametrize("order", range(5))
def test_values_and_derivatives_agree_with_fifty_digits(order):
    function = fitted(waves)
    times = np.linspace(START, END, 41)
    with mp.workdps(50):
        exact = [float(mp.diff(lambda t: mp.exp(mp.sin(3 * t)), mp.mpf(t), order)) for t in times]
    # rounding of the values, amplified as Markov's inequality allows
    markov = np.prod([(47**2 - k**2) / (2 * k + 1) for k in range(order)])
    slack = 48 * EPS * markov * (2 / (END - START)) ** order
    np.testing.assert_allclose(function(times, order)[:, 0], exact, atol=slack)


def test_shapes_follow_the_times():
    function = fitted(waves)
    assert function(START).shape == (1,)
    assert function(np.array([START])).shape == (1, 1)
    assert function(np.full((2, 3), END)).shape == (2, 3, 1)
    assert function(np.empty(0)).shape == (0, 1)


def test_many_instants_take_little_memory_and_agree_with_few():
    function, times = fitted(waves, size=128), np.linspace(START, END, 100_001)
    tracemalloc.start()
    values = function(times)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 16 * values.nbytes  # fewer numbers for each instant than coefficients
    np.testing.assert_allclose(values[::1000], function(times[::1000]), rtol=128 * EPS)


@pytest.mark.parametrize("t", [START - 1e-6, END + 1e-6, np.nan, np.inf, [0.5, 2.0]])
def test_times_outside_raise_and_say_the_interval(t):
    with pytest.raises(InvalidInput, match=r"outside \[0\.3, 1\.8\] s"):
        fitted(waves)(t)


def test_the_ends_belong_to_the_interval():
    np.testing.assert_allclose(fitted(waves)(WHOLE)[:, 0], waves(WHOLE), rtol=48 * EPS)


def test_differentiation_at_the_nodes_agrees_with_the_closed_form():
    grid = TimeGrid(np.array([START, 1.1, END]), 24)
    t = grid.times[:, None]
    _, first, second = grid.values(grid.fit(np.hstack([np.sin(4 * t), t**3])))
    np.testing.assert_allclose(first, np.hstack([4 * np.cos(4 * t), 3 * t**2]), atol=1e-11)  # 24^2 / 3 eps
    np.testing.assert_allclose(second, np.hstack([-16 * np.sin(4 * t), 6 * t]), atol=1e-8)  # 24^4 / 15 eps


KINK = 0.95


def kinked(t):
    return np.abs(t - KINK) * np.cos(t)


@pytest.mark.parametrize(
    ("function", "edges", "resolved"),
    [
        (waves, WHOLE, True),
        (lambda t: np.zeros_like(t), WHOLE, True),
        (kinked, WHOLE, False),
        (kinked, [START, KINK, END], True),
        (lambda t: 1 / (t - 1.0001), WHOLE, False),  # a pole between two nodes
        (lambda t: 1e-4 / (t - 1.0001) + np.cos(t), WHOLE, False),  # a narrow one
        (lambda t: np.sign(t - 1.0), WHOLE, False),
        (lambda t: np.where(t > 1, np.nan, 1.0), WHOLE, False),
        (lambda t: np.sin(200 * t), WHOLE, False),  # too quick for 64 nodes
    ],
    ids=["analytic", "zero", "kink", "kink on an edge", "pole", "narrow pole", "step", "nan", "quick"],
)
def test_the_tail_is_small_exactly_where_the_function_is_resolved(function, edges, resolved):
    size = fitted(function, edges, 64).tail
    assert size < 1e-13 if resolved else size > 1e-4


def test_a_function_with_a_kink_on_an_edge_is_exact_on_either_side():
    function = fitted(kinked, [START, KINK, END], 32)
    t = np.linspace(START, END, 101)
    slope = np.sign(t - KINK) * (np.cos(t) - (t - KINK) * np.sin(t))
    np.testing.assert_allclose(function(t)[:, 0], kinked(t), atol=32 * EPS)
    np.testing.assert_allclose(function(t, 1)[:, 0], slope, atol=32**3 * EPS)  # t misses the kink


def test_a_removable_quotient_is_no_event():
    def quotient(t):  # sin(t - 1) / (t - 1), 0/0 at t = 1
        return np.sin(t - 1) / (t - 1)

    grid = TimeGrid.clear_of(np.array([1.0]), WHOLE, 32)
    function = grid.fit(quotient(grid.times)[:, None])
    assert function.tail < 1e-13
    assert function(1.0)[0] == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_the_tail_knows_no_unit(scale):
    series = scale * np.array([3.0, 1.0, *np.zeros(12), 0.3, 0.0])[:, None]
    assert tail(series) == pytest.approx(0.1, rel=1e-15)


def test_the_tail_is_the_last_eighth_of_many_coefficients_and_at_least_two():
    for size, last in ((8, 2), (64, 8)):
        for column in range(size):
            series = np.ones((size, 1))
            series[column + 1 :] = 0.0
            assert (tail(series) > 0.0) == (column >= size - last)


@pytest.mark.parametrize("size", [16, 64, 65])
def test_nodes_keep_clear_of_instants(size):
    for instants in ([1.05], [START + 0.5, 1.05], TimeGrid(WHOLE, size).times[[size // 2, size // 3]]):
        grid = TimeGrid.clear_of(np.asarray(instants), WHOLE, size)
        assert size <= grid.size <= size + 5
        gap = np.abs(grid.times[:, None] - np.asarray(instants)).min()
        spacing = np.pi / 2 * (END - START) / grid.size  # in the middle, where it is widest
        assert gap > 0.02 * spacing


def test_of_six_sizes_the_grid_takes_the_one_farthest_from_an_instant_for_its_spacing():
    for instant in np.random.default_rng(0).uniform(START, END, 40):
        gaps = [size * np.abs(TimeGrid(WHOLE, size).times - instant).min() for size in range(32, 38)]
        chosen = TimeGrid.clear_of(np.array([instant]), WHOLE, 32).size
        assert gaps[chosen - 32] > 0.995 * max(gaps)


def test_without_instants_the_grid_is_the_one_asked_for():
    assert TimeGrid.clear_of(np.empty(0), WHOLE, 32).size == 32


@pytest.mark.parametrize(
    ("roots", "inside"),
    [
        ([0.0], [0.0]),
        ([-0.9, -0.2, 0.3, 0.999], [-0.9, -0.2, 0.3, 0.999]),
        ([-1.0, 1.0], [-1.0, 1.0]),
        ([-1.5, 0.4, 2.0], [0.4]),
        ([0.5 + 0.1j, 0.5 - 0.1j, -0.3], [-0.3]),
        ([0.3, -0.9], [-0.9, 0.3]),
        ([-0.4, 0.4], [-0.4, 0.4]),
        ([0.2, 1e6], [0.2]),
        ([0.5 + 0.1j, 0.5 - 0.1j], []),
        ([], []),
    ],
)
def test_real_roots_are_those_inside(roots, inside):
    series = np.real(chebyshev.chebfromroots(roots)) if roots else np.array([2.0])
    np.testing.assert_allclose(real_roots(series), inside, atol=1e-12)
    np.testing.assert_allclose(real_roots(1e-30 * np.append(series, np.zeros(9))), inside, atol=1e-12)


def test_a_double_root_is_not_lost():
    found = real_roots(chebyshev.chebfromroots([0.25, 0.25]))
    assert len(found) > 0
    np.testing.assert_allclose(found, 0.25, atol=1e-7)  # a double root carries sqrt(eps)


def test_zero_has_no_roots_to_speak_of():
    assert real_roots(np.zeros(5)).shape == real_roots(np.empty(0)).shape == (0,)


def test_roots_and_extrema_of_a_cosine():
    series = fitted(lambda t: np.cos(2 * np.pi * t), [-1.0, 1.0], 40).coefficients[0, :, 0]
    np.testing.assert_allclose(real_roots(series), [-0.75, -0.25, 0.25, 0.75], atol=1e-14)
    # at the ends the slope vanishes too; rounding may put those just outside
    np.testing.assert_allclose([t for t in extrema(series) if abs(t) < 0.9], [-0.5, 0.0, 0.5], atol=1e-13)


# peaks of functions of time, against closed forms


def test_peaks_are_those_of_the_closed_form_however_they_lie_to_the_samples():
    """A wave of one component has its largest size 1 between samples; the other grows to an end."""
    generator = np.random.default_rng(0)
    for _ in range(50):
        frequency, phase, duration = generator.uniform(3.0, 30.0), generator.uniform(0.0, 6.0), 1.7
        edges = np.array([0.0, *np.sort(generator.uniform(0.1, 1.6, 2)), duration])
        # 41 coefficients resolve 30 rad/s on a panel of 1.7 s
        peaks = peak_sizes(
            lambda t, f=frequency, p=phase: np.stack([np.sin(f * t + p), -np.exp(t)], axis=1),
            TimeGrid(edges, 41),
        )
        assert np.abs(peaks - [1.0, np.exp(duration)]).max() < 1e-12
