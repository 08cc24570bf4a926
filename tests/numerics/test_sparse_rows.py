"""Sparse matrices against the dense ones of numpy."""

import numpy as np
import pytest

from framework.numerics.sparse_rows import SparseRows

SHAPE = (7, 5)


def random_matrix(seed):
    generator = np.random.default_rng(seed)
    dense = generator.standard_normal(SHAPE) * (generator.random(SHAPE) < 0.4)
    dense[2] = 0.0  # a row without entries
    return dense


@pytest.mark.parametrize("seed", range(3))
def test_arithmetic_is_that_of_dense_matrices(seed):
    a, b = random_matrix(seed), random_matrix(seed + 10)
    A, B = SparseRows.of(a), SparseRows.of(b)
    generator = np.random.default_rng(seed + 20)
    y, ys = generator.standard_normal(5), generator.standard_normal((5, 2))
    w, ws = generator.standard_normal(7), generator.standard_normal((3, 7))
    shares = generator.standard_normal((7, 2)) * (generator.random((7, 2)) < 0.5)
    rows = np.array([3, 3, 2, 6])
    pairs = [
        (A @ y, a @ y),
        (A @ ys, a @ ys),
        (w @ A, w @ a),
        (ws @ A, ws @ a),
        ((A + B).toarray(), a + b),
        ((A + 2.0 * A).toarray(), 3.0 * a),
        ((-A / 4.0).toarray(), -a / 4.0),
        (A.scale(w).toarray(), w[:, None] * a),
        (A[1:6].toarray(), a[1:6]),
        (A[rows].toarray(), a[rows]),
        (A.append(B).toarray(), np.vstack([a, b])),
        (A.largest(), np.abs(a).max(axis=1)),
        (A.gram().toarray(), a.T @ a),
        (A.gram().upper_triangle().column_major().toarray(), np.triu(a.T @ a)),
        (A.subtract_multiples(shares, B[:2]).toarray(), a - shares @ b[:2]),
        (A.column_major().toarray(), a),
        (SparseRows.of(A.column_major()).toarray(), a),
        (SparseRows.identity(5).toarray(), np.eye(5)),
        (SparseRows.zeros(SHAPE).column_major().toarray(), np.zeros(SHAPE)),
    ]
    for computed, expected in pairs:
        np.testing.assert_allclose(
            computed, expected, rtol=0.0, atol=1e-15 * np.abs(expected).max(initial=1.0) * 8
        )


def test_entries_that_cancel_are_left_out():
    a = SparseRows.of(random_matrix(0))
    assert len((a + (-a)).values) == 0
    twice = SparseRows.sum_of_entries(
        np.array([1, 0, 1]), np.array([2, 3, 2]), np.array([1.0, 5.0, -1.0]), SHAPE
    )
    assert (twice.row.tolist(), twice.column.tolist(), twice.values.tolist()) == ([0], [3], [5.0])
