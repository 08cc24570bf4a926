"""Quadratic programs against their optimality conditions and against the cone solver."""

import numpy as np
import pytest

from framework.numerics.cone_program import AffineRows, ConeProgram, solve_cone_program
from framework.numerics.quadratic_program import QuadraticProgram, solve_quadratic_program


@pytest.mark.parametrize("seed", range(5))
def test_the_cone_solver_finds_the_same_optimum(seed):
    rng = np.random.default_rng(seed)
    n, m, k = 12, 80, 2
    squares, c = rng.normal(size=(n, n)), rng.normal(size=n)
    A, G = rng.normal(size=(k, n)), rng.normal(size=(m, n))
    x = rng.normal(size=n)  # admissible, with some rows active
    program = QuadraticProgram(
        2.0 * squares.T @ squares, c, A, A @ x, G, G @ x + np.maximum(rng.normal(size=m), 0.0)
    )
    least = solve_quadratic_program(program)
    by_cones = solve_cone_program(
        ConeProgram(
            {"x": n},
            {"x": c},
            AffineRows({"x": squares}, np.zeros(n)),
            [AffineRows({"x": A}, -program.b)],
            [AffineRows({"x": -G}, program.h)],
        )
    )
    assert np.abs(least - by_cones["x"]).max() < 1e-4 * np.abs(least).max()
    assert (G @ least - program.h).max() < 1e-6
    assert np.abs(A @ least - program.b).max() < 1e-6


def test_contradicting_rows_have_no_solution():
    G = np.array([[1.0, 0.0], [-1.0, 0.0]])
    none = np.zeros((0, 2))
    program = QuadraticProgram(np.eye(2), np.ones(2), none, none[:, 0], G, np.array([-1.0, -1.0]))
    assert solve_quadratic_program(program) is None
