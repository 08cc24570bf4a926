"""GMRES with the step of least size: laws of linear algebra."""

import numpy as np
import pytest

from framework.numerics.krylov import gmres

SIZE = 30


def solved(matrix: np.ndarray, right: np.ndarray, **options) -> tuple[np.ndarray, int]:
    """x, and how many products it took."""
    products = 0

    def product(vector: np.ndarray) -> np.ndarray:
        nonlocal products
        assert np.linalg.norm(vector) == pytest.approx(1.0)
        products += 1
        return matrix @ vector

    x = gmres(product, right, **({"tolerance": 1e-12, "max_products": 50, "cutoff": 1e-14} | options))
    return x, products


def test_it_solves_a_regular_system_in_as_many_products_as_unknowns():
    rng = np.random.default_rng(1)
    matrix, x = rng.normal(size=(SIZE, SIZE)), rng.normal(size=SIZE)
    found, products = solved(matrix, matrix @ x)
    assert products <= SIZE
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-9 * np.linalg.cond(matrix))


def test_a_nilpotent_change_takes_as_many_products_as_its_degree():
    """What plain repetition amplifies a thousandfold before it dies out."""
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    nilpotent = np.kron(np.diag(np.full(4, 10.0), 1), turn)  # its fifth power is zero
    matrix, right = np.eye(SIZE) - nilpotent, rng.normal(size=SIZE)
    assert np.linalg.norm(np.linalg.matrix_power(nilpotent, 3) @ right) > 1e3 * np.linalg.norm(right) / 2
    found, products = solved(matrix, right)
    assert products <= 6
    assert np.linalg.norm(right - matrix @ found) < 1e-10 * np.linalg.norm(right)


def test_directions_that_are_all_but_annihilated_are_not_asked_for():
    rng = np.random.default_rng(3)
    q = np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0]
    values = np.concatenate([np.linspace(1.0, 2.0, SIZE - 1), [1e-9]])
    matrix, right = (q * values) @ q.T, q @ np.ones(SIZE)
    whole, _ = solved(matrix, right)
    assert np.abs(q[:, -1] @ whole) > 1e5
    least, _ = solved(matrix, right, cutoff=1e-6)
    assert np.linalg.norm(least) < 2 * np.sqrt(SIZE)
    left = q.T @ (right - matrix @ least)
    np.testing.assert_allclose(left[:-1], 0.0, atol=1e-6)


def test_nothing_is_asked_of_nothing():
    found, products = solved(np.eye(3), np.zeros(3))
    assert products == 0
    np.testing.assert_array_equal(found, 0.0)
