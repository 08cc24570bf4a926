"""The root of g: where a matrix of known determinant loses rank, whatever moves it."""

import numpy as np
import pytest

from framework.singularity.bordered_system import DIFFERENCE_STEP, differentiate_g, root_of_g, stencil


def moved_by(values, seed: int = 3):
    """Matrices U diag(values(p)) V' of a parameter p, with orthogonal U and V that turn with p."""
    rng = np.random.default_rng(seed)
    size = len(values(0.0))
    turns = [part - part.T for part in rng.standard_normal((2, size, size))]

    def orthogonal(generator, p):  # Cayley's map
        return np.linalg.solve(np.eye(size) + p * generator, np.eye(size) - p * generator)

    return lambda at: np.array([orthogonal(turns[0], p) * values(p) @ orthogonal(turns[1], p) for p in at])


@pytest.mark.parametrize("root", [0.0, 1e-5, 0.37, 1.0])
@pytest.mark.parametrize("size", [1, 2])
def test_the_root_is_that_of_the_singular_value_that_vanishes(root, size):
    def values(p):
        return np.array([1.3, 0.02, np.sin(3.0 * (p - root))])

    for start in (root - 3e-4, root, root + 2e-3):
        place, converged = root_of_g(moved_by(values), float(np.clip(start, 0.0, 1.0)), size=size)
        assert converged
        assert place == pytest.approx(root, abs=5e-15)


@pytest.mark.parametrize("high", [1e-3, 1.0, 1e3])
def test_the_unit_of_the_parameter_does_not_matter(high):
    matrices = moved_by(lambda p: np.array([1.0, np.expm1(p - 0.4)]))
    place, _ = root_of_g(lambda t: matrices(t / high), 0.41 * high, high=high)
    assert place == pytest.approx(0.4 * high, rel=1e-14)


def test_without_a_root_none_is_found():
    assert not root_of_g(moved_by(lambda p: np.array([1.0, 0.1 + (p - 0.5) ** 2])), 0.45)[1]
    assert not root_of_g(moved_by(lambda p: np.array([1.0, 0.3])), 0.45)[1]  # no slope either
    away = moved_by(lambda p: np.array([1.0, p - 0.9]))
    assert root_of_g(away, 0.2)[0] == pytest.approx(0.9, abs=1e-14)
    assert root_of_g(away, 0.2, longest=0.1) == (0.2, False)


@pytest.mark.parametrize("place", [0.0, 0.4, 1.0])
def test_the_slope_is_the_derivative_of_the_singular_value(place):
    matrices = moved_by(lambda p: np.array([2.0, np.sin(p - place)]))
    at = stencil(place)
    assert at[2] - at[0] == pytest.approx(DIFFERENCE_STEP * (2 if 0 < place < 1 else 1))
    g, slope, g_above = differentiate_g(matrices(at), at)
    # a central difference errs by the square of the stencil, one on a side by the stencil, times derivatives
    # of order ten, since the singular vectors turn
    assert abs(slope) == pytest.approx(1.0, abs=10 * DIFFERENCE_STEP ** (2 if 0 < place < 1 else 1))
    assert g == pytest.approx(0.0, abs=1e-15)
    # at the upper end nothing lies beyond
    assert abs(g_above) == pytest.approx(0.0 if place == 1.0 else DIFFERENCE_STEP, rel=1e-3, abs=1e-15)
