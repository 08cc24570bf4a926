"""Cells of a speed program: their ends, and those to cut, beside a coefficient near nothing or a bend."""

from types import SimpleNamespace

import numpy as np
import pytest

from framework.laws.squared_speed import SpeedBasis
from framework.planning.optimal.least_cost import _cells_to_cut, cost_of
from framework.planning.optimal.path_series import uniform_cells

CELLS = np.linspace(-1.0, 1.0, 31) ** 3  # of unequal widths
BASIS = SpeedBasis.from_cells(CELLS)
PROGRAM = SimpleNamespace(basis=BASIS, cells=CELLS)


def cells_of_spline(k):
    """The cells in whose middle a spline is not zero."""
    unit = np.eye(BASIS.size)[k]
    return np.flatnonzero(BASIS.matrix(0.5 * (CELLS[1:] + CELLS[:-1])) @ unit)


def test_all_cells_of_a_spline_whose_coefficient_is_nearly_zero_are_cut():
    for k in (0, 3, 17, BASIS.size - 1):
        coefficients = 1.0 + 0.05 * np.abs(np.arange(BASIS.size) - k)
        coefficients[k] = 1e-9
        np.testing.assert_array_equal(
            np.flatnonzero(_cells_to_cut(PROGRAM, coefficients))[[0, -1]], cells_of_spline(k)[[0, -1]]
        )


def test_where_coefficients_bend_the_two_cells_in_the_middle_are_cut():
    for k in (8, 17, 24):
        coefficients = 1.0 + 0.3 * np.maximum(0, np.arange(BASIS.size) - k)
        np.testing.assert_array_equal(
            np.flatnonzero(_cells_to_cut(PROGRAM, coefficients)), cells_of_spline(k)[2:-2]
        )


@pytest.mark.parametrize(
    ("peak", "peak_speed", "share"), [(0.7, 0.5, 0.7), (0.2, 0.5, 0.25), (1.2, 1.3, 1.69)]
)
def test_limits_are_used_as_far_as_the_nearer_one(peak, peak_speed, share):
    """A law twice as fast has twice the speed and, but for weight, four times the torque."""
    assert cost_of("limits", SimpleNamespace(peak=peak, peak_speed=peak_speed, duration=9.0, energy=9.0)) == (
        pytest.approx(share)
    )


@pytest.mark.parametrize("s", [3e-7, 1.0 - 3e-7])
def test_cells_end_where_the_path_does_however_near_a_crossing_is(s):
    task = SimpleNamespace(
        branch=SimpleNamespace(
            path=SimpleNamespace(knots=np.array([0.0, 1.0])), wrenches=SimpleNamespace(knots=np.zeros(0))
        ),
        to_cross=SimpleNamespace(points=[SimpleNamespace(s=s)]),
    )
    edges = uniform_cells(task, 12)
    np.testing.assert_array_equal(edges[[0, -1]], [0.0, 1.0])
    assert (np.diff(edges) > 0.0).all()
    assert np.searchsorted(edges, s) not in (0, len(edges))
