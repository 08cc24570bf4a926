"""A path whose derivatives are not those of its values is refused where it enters; a right one never is."""

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    InvalidInput,
    Law,
    Line,
    Spline,
    inverse_dynamics,
    locate_singularities,
    plan_crossing,
)
from framework.laws.path import check_path

START, SPAN = np.array([0.1, 0.345]), np.array([-0.15, -0.15])


class Bent:
    """A gentle bow from one point to another; `wrong` changes what it says of one order."""

    def __init__(self, wrong=lambda order, values: values, waves=0.5, bow=0.01, knots=()):
        self.n, self.knots = 2, np.array(knots, dtype=float)
        self.wrong, self.waves, self.bow = wrong, 2 * np.pi * waves, bow

    def __call__(self, s, order=0):
        s = np.asarray(s, dtype=float)
        across = self.bow * self.waves**order * np.sin(self.waves * s + order * np.pi / 2)
        along = s if order == 0 else np.full(s.shape, float(order == 1))
        values = along[..., None] * SPAN + across[..., None] * np.array([1.0, -1.0])
        return self.wrong(order, values + START if order == 0 else values)


WRONG = {
    "x' doubled": (lambda order, values: values * (2.0 if order == 1 else 1.0), "1"),
    "x' a thousandth too large": (lambda order, values: values * (1.001 if order == 1 else 1.0), "1"),
    'x" of one coordinate': (lambda order, values: values * ([1, 1.01] if order == 2 else 1.0), "2"),
    'x" left out': (lambda order, values: values * (0.0 if order == 2 else 1.0), "2"),
    "derivatives in another unit": (lambda order, values: values * 0.2**order, "1"),
}


@pytest.mark.parametrize(("wrong", "order"), WRONG.values(), ids=WRONG)
def test_a_wrong_derivative_is_named(wrong, order):
    with pytest.raises(InvalidInput, match=rf"path\(s, {order}\) is not the derivative of path\(s"):
        check_path(Bent(wrong))


def test_planning_and_inverse_dynamics_refuse_it_rather_than_certify_other_torques():
    robot, path = robots.load("five_bar"), Bent(WRONG["x' doubled"][0])
    for ask in (
        lambda: plan_crossing(robot, path, duration=1.5),
        lambda: inverse_dynamics(robot, path, Law.rest_to_rest(1.5, 2, [])),
        lambda: locate_singularities(robot, path),
    ):
        with pytest.raises(InvalidInput, match="is not the derivative"):
            ask()


@pytest.mark.parametrize(
    ("wrong", "knots", "words"),
    [
        (lambda order, values: values[..., :1], (), r"must give 2 finite numbers .* got shape \(18, 1\)"),
        (lambda order, values: values * (np.nan if order == 2 else 1), (), r"path\(s, 2\) must give"),
        (lambda order, values: values, (0.7, 0.3), "knots must ascend"),
        (lambda order, values: values, (0.0, 0.3), "knots must ascend"),
    ],
)
def test_what_is_no_path_is_told(wrong, knots, words):
    with pytest.raises(InvalidInput, match=words):
        check_path(Bent(wrong, knots=knots))


RANDOM = np.random.default_rng(5).normal(size=(200, 3))
RIGHT = [
    Line([0.1, 0.345], [-0.05, 0.195]),
    Line([1e6, 0.0], [1e6 + 1e-3, 0.0]),  # a short way far from the origin
    Line([0.3, 0.3], [0.3, 0.3 + 1e-9]),
    Arc([0.1, 0.3], [0.0, 0.35], [-0.1, 0.3]),
    Bent(),
    Bent(waves=40, bow=1e-3),
    Bent(bow=0.0),
    Spline(RANDOM),
    Spline([[0, 0], [1e-6, 0], [1, 0], [1, 1], [2, 3], [5, 5], [5, 9]]),
]


@pytest.mark.parametrize("path", RIGHT, ids=lambda path: type(path).__name__)
def test_a_right_path_passes(path):
    check_path(path)


def test_a_path_of_tabulated_differences_passes():
    """Central differences with a step of 1e-4: right to 1e-7, as a user would write them."""

    class Differences(Bent):
        def __call__(self, s, order=0):
            s, h = np.asarray(s, dtype=float), 1e-4
            if order == 0:
                return super().__call__(s)
            if order == 1:
                return (self(s + h) - self(s - h)) / (2 * h)
            return (self(s + h) - 2 * self(s) + self(s - h)) / h**2

    check_path(Differences())
