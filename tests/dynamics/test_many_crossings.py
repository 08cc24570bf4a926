"""Paths through many singular points, against virtual work in mpmath: a panel for each crossing."""

import pytest

from tests.benchmarks.chart.along import crossing

TOLERANCE = 1e-10


@pytest.mark.parametrize("count", [3, 6])
def test_a_law_through_many_crossings_is_resolved(count):
    case = crossing("three_rpr", count)
    assert case.error(case.proved(TOLERANCE)) < TOLERANCE
