"""An item of a stack comes out the same to the last bit alone, among others, wherever it lies in memory."""

import numpy as np
import pytest

from framework.numerics.ordered_sums import are_regular, dot, matmul, matvec, solve

SIZES = (1, 2, 3, 5, 8, 13, 24)
WITNESS = {
    "dot": lambda a, b: np.einsum("...i,...i->...", a, b),
    "matvec": lambda a, b: np.einsum("...ij,...j->...i", a, b),
    "matmul": lambda a, b: np.einsum("...ij,...jk->...ik", a, b),
    "solve": lambda a, b: np.linalg.solve(a, b[..., None])[..., 0],
}


def operands(name, size, count=7):
    random = np.random.default_rng(size)
    shapes = {
        "dot": ((count, size), (count, size)),
        "matvec": ((count, 3, size), (count, size)),
        "matmul": ((count, 3, size), (count, size, 5)),
        "solve": ((count, size, size), (count, size)),
    }
    return [random.standard_normal(shape) for shape in shapes[name]]


def off_the_grid(array):
    """The same numbers eight bytes beside an address that kernels like."""
    memory = np.empty(array.size + 1)[1:].reshape(array.shape)
    memory[...] = array
    return memory


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("name", "function"), [(f.__name__, f) for f in (dot, matvec, matmul, solve)])
def test_an_item_does_not_feel_the_others(name, function, size):
    a, b = operands(name, size)
    together = function(a, b)
    np.testing.assert_allclose(together, WITNESS[name](a, b), atol=1e-9 * np.abs(together).max())
    for layout in (np.ascontiguousarray, np.asfortranarray, off_the_grid):
        np.testing.assert_array_equal(function(layout(a), layout(b)), together)
    for k in range(len(a)):
        some = slice(k, k + 1 + k % 2)
        np.testing.assert_array_equal(function(a[some].copy(), b[some].copy()), together[some])


def test_one_matrix_serves_a_stack_of_vectors():
    matrix, vectors = operands("matvec", 6)
    np.testing.assert_array_equal(matvec(matrix[0], vectors)[3], matvec(matrix[0], vectors[3]))


def test_a_singular_system_is_infinite_and_its_neighbours_are_solved():
    matrices, right = operands("solve", 3)
    alone = solve(matrices[:1], right[:1])
    matrices[1] = 0.0
    found = solve(matrices, right)
    assert np.all(np.isinf(found[1]))
    np.testing.assert_array_equal(found[:1], alone)
    assert np.all(np.isfinite(found[2:]))


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (4, 4)])
def test_matrices_are_regular_down_to_the_level(shape):
    generator = np.random.default_rng(4)
    U, _, V_rows = np.linalg.svd(generator.standard_normal((5, *shape)), full_matrices=False)
    least = np.array([1e-2, 2e-7, 5e-8, 1e-5, 0.0])
    values = np.ones((5, min(shape)))
    values[:, -1] = least
    matrices = (U * values[:, None]) @ V_rows
    np.testing.assert_array_equal(are_regular(matrices, 1e-7), least >= 1e-7)
    assert are_regular(matrices[:1], 1e-7).all()
