"""Zonotopes and slabs against the hull of all their corners, and against linear programs."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from framework.numerics.polytope import slabs, zonotope

SIZES = [(1, 1), (1, 3), (2, 2), (2, 4), (3, 3), (3, 5), (4, 5), (6, 6)]


def corners(generators):
    return np.array(list(product((-1.0, 1.0), repeat=len(generators)))) @ generators


def as_set(points):
    return {tuple(point) for point in np.round(points, 8) + 0.0}


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_a_zonotope_is_the_hull_of_its_corners(n, m):
    rng = np.random.default_rng(10 * n + m)
    centre, generators = rng.standard_normal(n), rng.standard_normal((m, n))
    found, points = zonotope(centre, generators), centre + corners(generators)
    if n == 1:
        expected = np.array([points.min(axis=0), points.max(axis=0)])
    else:
        expected = points[ConvexHull(points).vertices]
    assert as_set(found.vertices) == as_set(expected)
    assert found.contains(points).all()
    np.testing.assert_allclose(found.bounds(), np.stack([points.min(0), points.max(0)], 1), atol=1e-12)
    assert not found.contains(centre + 1.001 * (found.vertices - centre)).any()
    away = 0.4 * rng.standard_normal((15, n)) * np.abs(generators).sum(axis=0)
    sums = [linprog(np.zeros(m), A_eq=generators.T, b_eq=point, bounds=(-1, 1)).success for point in away]
    np.testing.assert_array_equal(found.contains(centre + away), sums)


@pytest.mark.parametrize(("n", "m"), [size for size in SIZES if size != (6, 6)])
def test_slabs_reach_as_far_as_linear_programs_say(n, m):
    rng = np.random.default_rng(n + 10 * m)
    rows, limits = rng.standard_normal((m, n)), rng.uniform(0.5, 2.0, m)
    found = slabs(rows, limits)
    A, b = np.concatenate([rows, -rows]), np.tile(limits, 2)
    for direction in rng.standard_normal((3, n)):
        most = -linprog(-direction, A_ub=A, b_ub=b, bounds=(None, None)).fun
        assert (found.vertices @ direction).max() == pytest.approx(most, rel=1e-9)
        low, high = found.reach(direction)
        assert high == pytest.approx(np.min(limits / np.abs(rows @ direction)), rel=1e-12)
        assert low == pytest.approx(-high, rel=1e-12)
        np.testing.assert_allclose(found.reach(1e-9 * direction), [1e9 * low, 1e9 * high], rtol=1e-12)
    assert np.abs(found.vertices @ rows.T).max(axis=0) == pytest.approx(limits, rel=1e-9) or m > n


def test_generators_that_do_not_span_make_a_flat_polytope():
    generators = np.array([[1.0, 2.0, 0.0], [2.0, -1.0, 0.0], [3.0, 1.0, 0.0]])
    centre = np.array([0.1, 0.2, 0.0])
    beside = np.array([0.1, 0.2, 1.0])
    found = zonotope(centre, generators)
    assert found.contains(centre + corners(generators)).all()
    assert not found.contains(np.array([0.0, 0.0, 1e-6]))
    np.testing.assert_allclose(found.reach(np.array([0.0, 0.0, 1.0])), [0.0, 0.0], atol=1e-15)
    assert np.isnan(zonotope(beside, generators).reach(np.array([1.0, 0, 0]))).all()
    assert len(found.vertices) == 6


def test_rows_that_do_not_span_leave_a_direction_without_bound():
    found = slabs(np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]), np.array([1.0, 2.0]))
    np.testing.assert_array_equal(np.abs(found.free), [[0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(found.bounds()[2], [-np.inf, np.inf])
    np.testing.assert_allclose(found.bounds()[:2], [[-1, 1], [-3, 3]], atol=1e-12)
    np.testing.assert_array_equal(found.axis_ranges()[2], [-np.inf, np.inf])


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_what_is_inside_does_not_depend_on_the_unit(scale):
    generators = scale * np.random.default_rng(1).standard_normal((5, 3))
    found = zonotope(np.zeros(3), generators)
    assert found.contains(corners(generators)).all()
    assert not found.contains(1.001 * found.vertices).any()
