"""Stacked sparse systems in one band against dense linear algebra, matrix by matrix."""

import numpy as np
import pytest

from framework.numerics.banded_lu import Band, DenseFactors

COUNT = 5


def chain(size: int, rng) -> np.ndarray:
    """Where neighbours touch neighbours, rows and columns in any order."""
    near = np.abs(np.subtract.outer(np.arange(size), np.arange(size))) <= 1
    return near[rng.permutation(size)][:, rng.permutation(size)]


def star(size: int, rng) -> np.ndarray:
    """Where all touch one in the middle."""
    there = np.eye(size, dtype=bool)
    there[0] = there[:, 0] = True
    return there[rng.permutation(size)]


def full(size: int, rng) -> np.ndarray:
    return np.ones((size, size), dtype=bool)


def stacked(shape, size: int):
    rng = np.random.default_rng(size)
    there = shape(size, rng)
    row, column = np.nonzero(there)
    matrices = rng.standard_normal((COUNT, size, size)) * there
    return Band.of(there, np.arange(size), np.arange(size)), matrices, matrices[:, row, column], rng


@pytest.mark.parametrize("size", [1, 2, 7, 60])
@pytest.mark.parametrize("shape", [chain, star, full])
def test_solutions_and_determinants_are_those_of_each_matrix_alone(shape, size):
    band, matrices, values, rng = stacked(shape, size)
    factors = band.factor(values)
    right = rng.standard_normal((2, COUNT, size))
    error = 1e-14 * np.linalg.cond(matrices).max() * size
    for k in range(2):
        expected = np.linalg.solve(matrices, right[k][..., None])[..., 0]
        np.testing.assert_allclose(factors.solve(right)[k], expected, rtol=0, atol=error)
        np.testing.assert_allclose(factors.solve(right[k]), expected, rtol=0, atol=error)
        expected = np.linalg.solve(matrices.transpose(0, 2, 1), right[k][..., None])[..., 0]
        np.testing.assert_allclose(factors.solve(right, transposed=True)[k], expected, rtol=0, atol=error)
    sign, size_of = np.linalg.slogdet(matrices)
    np.testing.assert_array_equal(factors.slogdet[0], sign)
    np.testing.assert_allclose(factors.slogdet[1], size_of, atol=error)


def test_what_is_singular_to_the_factors_has_no_sign():
    """Matrices of small integers, some of them singular: rounding of another elimination may differ."""
    rng = np.random.default_rng(5)
    matrices = rng.integers(-1, 2, (400, 9, 9)).astype(float)
    band = Band.of(np.ones((9, 9), dtype=bool), np.arange(9), np.arange(9))
    singular = 0
    for matrix in matrices:
        factors = band.factor(matrix.reshape(1, 81))
        try:
            factors.solve(np.ones((1, 9)))
        except np.linalg.LinAlgError:
            singular += 1
            assert factors.slogdet[0] == 0.0
    assert singular


@pytest.mark.parametrize("size", [1, 2, 7])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_small_systems_are_solved_as_the_banded_ones(size, shape):
    """For any number of right-hand sides; against the definition A x = b and the product of eigenvalues."""
    _, matrices, _, rng = stacked(full, size)
    factors = DenseFactors(matrices)
    right = rng.standard_normal((*shape, COUNT, size))
    error = 1e-14 * np.linalg.cond(matrices).max() * size
    products = np.einsum("tij,...tj->...ti", matrices, factors.solve(right))
    np.testing.assert_allclose(products, right, rtol=0, atol=error)
    products = np.einsum("tji,...tj->...ti", matrices, factors.solve(right, transposed=True))
    np.testing.assert_allclose(products, right, rtol=0, atol=error)
    determinant = np.linalg.eigvals(matrices).prod(axis=1).real
    np.testing.assert_allclose(factors.slogdet[0] * np.exp(factors.slogdet[1]), determinant, rtol=error)


def test_a_chain_has_a_narrow_band_however_it_is_written():
    for size in (10, 100, 400):
        band, *_ = stacked(chain, size)
        assert band.lower + band.upper <= 6


@pytest.mark.parametrize("instant", [0, 2, COUNT - 1])
def test_one_singular_matrix_is_named_and_the_signs_of_the_others_stand(instant):
    band, matrices, values, _ = stacked(chain, 12)
    column = np.flatnonzero(matrices[0].any(axis=0))[3]
    _, columns = np.nonzero(matrices[0])
    values[instant, columns == column] = 0.0
    factors = band.factor(values)
    sign = np.linalg.slogdet(matrices)[0]
    sign[instant] = 0.0
    np.testing.assert_array_equal(factors.slogdet[0], sign)
    for transposed in (False, True):
        with pytest.raises(np.linalg.LinAlgError, match=f"instant {instant}"):
            factors.solve(np.ones((COUNT, 12)), transposed=transposed)


def test_an_empty_stack_has_empty_solutions():
    band, *_ = stacked(chain, 6)
    factors = band.factor(np.empty((0, len(band.index))))
    assert factors.solve(np.empty((0, 6))).shape == (0, 6)
    assert factors.solve(np.empty((3, 0, 6)), transposed=True).shape == (3, 0, 6)
    assert factors.slogdet[0].shape == (0,)
