"""The eliminated system of a step against the whole one, solved at once."""

import numpy as np
import pytest

from framework.simulation.collocation import NewtonMatrix, radau_table


def whole(length, once, by_motion, jacobian):
    """The matrix of (da, -dlambda) of all nodes, rows and columns node by node."""
    s, m, nv = jacobian.shape
    mass, by_v, by_q = np.split(by_motion, 3, axis=2)
    matrix = np.zeros((s, nv + m, s, nv + m))
    for k in range(s):
        for j in range(s):
            matrix[k, :nv, j, :nv] = length * once[k, j] * by_v[k]
            matrix[k, :nv, j, :nv] += length**2 * (once @ once)[k, j] * by_q[k]
            matrix[k, nv:, j, :nv] = length**2 * (once @ once)[k, j] * jacobian[k]
        matrix[k, :nv, k, :nv] += mass[k]
        matrix[k, :nv, k, nv:] = jacobian[k].T
    return matrix.reshape(s * (nv + m), -1)


@pytest.mark.parametrize("massless", [0, 2])
@pytest.mark.parametrize(("nv", "m"), [(4, 2), (6, 5), (9, 3)])
def test_elimination_changes_no_solution(nv, m, massless):
    rng, s, length, table = np.random.default_rng(nv), 7, 0.3, radau_table(7)
    mass = np.eye(nv) + 0.2 * rng.normal(size=(s, nv, nv))
    mass[:, :massless] = mass[:, :, :massless] = 0.0  # such coordinates have springs
    by_q = rng.normal(size=(s, nv, nv)) + 20.0 * np.diag(np.arange(nv) < massless)
    by_motion = np.concatenate([mass, rng.normal(size=(s, nv, nv)), by_q], axis=2)
    jacobian = rng.normal(size=(s, m, nv))
    force, residual = rng.normal(size=(s, nv)), rng.normal(size=(s, m))

    matrix = NewtonMatrix.of(length, table.rates, by_motion, jacobian)
    moved, a, multipliers = matrix.solve(force, residual)

    wrong = np.concatenate([force, residual], axis=1).ravel()
    both = -np.linalg.solve(whole(length, table.once, by_motion, jacobian), wrong).reshape(s, nv + m)
    np.testing.assert_allclose(a, both[:, :nv], rtol=1e-8, atol=1e-8 * np.abs(both[:, :nv]).max())
    np.testing.assert_allclose(multipliers, -both[:, nv:], atol=1e-8 * np.abs(both[:, nv:]).max())
    np.testing.assert_allclose(
        moved, length**2 * table.once @ table.once @ a, atol=1e-10 * np.abs(moved).max()
    )


def test_a_loop_written_twice_at_a_node_is_singular():
    rows = np.zeros((3, 2, 4))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    by_motion = np.tile(np.hstack([np.eye(4), np.zeros((4, 8))]), (3, 1, 1))
    NewtonMatrix.of(0.1, radau_table(3).rates, by_motion, rows)  # regular
    rows[1, 1] = rows[1, 0]
    with pytest.raises(np.linalg.LinAlgError):
        NewtonMatrix.of(0.1, radau_table(3).rates, by_motion, rows)
    no_mass = np.zeros_like(by_motion)
    rows[1, 1] = np.eye(4)[1]
    with pytest.raises(np.linalg.LinAlgError):
        NewtonMatrix.of(0.1, radau_table(3).rates, no_mass, rows)
