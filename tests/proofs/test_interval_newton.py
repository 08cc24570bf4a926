"""Interval steps: nothing that solves the equations is lost, and what is proved is there."""

import numpy as np
import pytest

from framework.proofs.interval_newton import (
    LinearEnclosure,
    contract,
    damped_inverses,
    pivoted_inverses,
)
from framework.proofs.krawczyk import prove_existence
from framework.proofs.rounding import approximate_inverses

BOXES = 200


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def systems(rng, m, k):
    """Slopes, radii and a point of each box."""
    slopes = rng.standard_normal((BOXES, m, k))
    slopes[::3, -1] = 1e-9 * slopes[::3, -1] + slopes[::3, 0]  # nearly dependent equations too
    radii = 10.0 ** rng.uniform(-6, 0, (BOXES, k))
    return slopes, radii, radii * rng.uniform(-1, 1, (BOXES, k))


@pytest.mark.parametrize(("m", "k"), [(1, 3), (3, 4), (4, 4), (6, 7)])
def test_a_solution_is_never_cut_off(rng, m, k):
    slopes, radii, d = systems(rng, m, k)
    errors = 10.0 ** rng.uniform(-9, -2, (BOXES, m))
    values = -np.einsum("sij,sj->si", slopes, d) + 0.999 * errors * rng.choice([-1, 1], errors.shape)
    equations = LinearEnclosure(values, slopes, errors)
    for mixers in (pivoted_inverses(slopes, radii), damped_inverses(equations, radii)):
        left = contract(equations, radii, mixers)
        assert not left.empty.any()
        assert (left.lower <= d).all()
        assert (d <= left.upper).all()
        assert (left.upper - left.lower < 1.9 * radii).any(axis=1).mean() > 0.3  # and it does cut


def test_a_box_beside_the_only_solution_is_empty(rng):
    slopes, radii = rng.standard_normal((BOXES, 3, 3)), 10.0 ** rng.uniform(-6, 0, (BOXES, 3))
    d = radii * np.where(np.arange(3) == rng.integers(0, 3, (BOXES, 1)), 1.5, 0.5)
    values = -np.einsum("sij,sj->si", slopes, d)
    errors = 1e-9 * np.abs(values) * np.linalg.norm(radii, axis=1, keepdims=True)
    equations = LinearEnclosure(values, slopes, errors)
    for mixers in (pivoted_inverses(slopes, radii), damped_inverses(equations, radii)):
        assert contract(equations, radii, mixers).empty.mean() > 0.95


def test_one_root_is_proved_where_there_is_one_and_none_elsewhere(rng):
    """x^2 + y^2 = 1 and y = c x: two roots, and boxes about places near to the one, or half-way to it."""
    angle = rng.uniform(0.2, 1.3, BOXES)
    root = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    off = rng.uniform(-1, 1, (BOXES, 2)) * np.where(np.arange(BOXES) % 2, 0.3, 0.005)[:, None]
    x, radii = root + off, np.full((BOXES, 2), 0.02)
    values = np.stack([(x**2).sum(axis=1) - 1, x[:, 1] - np.tan(angle) * x[:, 0]], axis=1)
    slopes = np.stack([2 * x, np.stack([-np.tan(angle), np.ones(BOXES)], axis=1)], axis=1)
    changes = np.stack([2 * radii, 0 * radii], axis=1)
    found = prove_existence(LinearEnclosure(values, slopes, np.full((BOXES, 2), 1e-14)), changes, radii, None)
    inside = (np.abs(off) < radii).all(axis=1)
    assert found.proved[::2].all()
    assert inside[found.proved].all()
    within = (found.lower <= -off) & (-off <= found.upper)
    assert within[found.proved].all()


def test_a_singular_matrix_among_others_costs_only_its_own_inverse(rng):
    matrices = rng.standard_normal((5, 3, 3))
    matrices[2] = 0.0
    found = approximate_inverses(matrices)
    assert not found[2].any()
    others = [0, 1, 3, 4]
    np.testing.assert_allclose(found[others] @ matrices[others], np.tile(np.eye(3), (4, 1, 1)), atol=1e-9)
