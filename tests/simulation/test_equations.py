"""The equations of motion and their derivatives against differences, on robots with every kind of closure."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput
from framework.kinematics.closures import loop_curvature, loop_equations
from framework.kinematics.frames import frames_at
from framework.simulation.collocation import NewtonMatrix, radau_table
from framework.simulation.consistent_states import _pseudo_inverse
from framework.simulation.equations import EquationsOfMotion

# points, hinges with turned axes, a weld, cardan joints; springs on, in and behind joints
CASES = [
    ("five_bar_heavy", "flexible_links"),
    ("agile_eye", "flexible_links"),
    ("bricard", "flexible_joints"),
    ("three_upu", "rigid"),
    ("gough_stewart", "rigid"),
]


@pytest.fixture(params=CASES, ids="-".join, scope="module")
def equations(request) -> EquationsOfMotion:
    name, flexibility = request.param
    robot = robots.load(name, flexibility=flexibility)
    return EquationsOfMotion.of(robot, 0.1 + np.arange(robot.model.nv))


def state(equations, seed=1):
    rng, model = np.random.default_rng(seed), equations.robot.model
    q = np.asarray(pin.integrate(model, equations.robot.q_near, 0.1 * rng.standard_normal(model.nv)))
    return q, rng.standard_normal(model.nv), rng.standard_normal(model.nv)


def around(equations, q, h):
    """q moved by +-h along each column, (2, nv, nq)."""
    steps = np.eye(equations.robot.model.nv)
    return np.array([[pin.integrate(equations.robot.model, q, s * h * e) for e in steps] for s in (1, -1)])


def test_frames_are_those_that_pinocchio_gives(equations):
    q, v, a = state(equations)
    ours, theirs = equations.tangent(q[None], v[None], a[None]).frames, frames_at(equations.robot, q[None])
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)


def test_derivatives_of_the_forces_are_differences_of_the_forces(equations):
    q, v, a = state(equations)
    at, h = equations.tangent(q[None], v[None], a[None]), 1e-6
    nv = len(v)

    def many(x):
        return np.repeat(x[None], nv, axis=0)

    ahead, back = (equations.tangent(x, many(v), many(a)).force for x in around(equations, q, h))
    scale = np.abs(at.by_q).max()
    np.testing.assert_allclose(at.by_q[0], (ahead - back).T / (2 * h), atol=1e-8 * scale)
    # quadratic in v and linear in a: differences of any width are exact
    ahead, back = (equations.tangent(many(q), v + s * np.eye(nv), many(a)).force for s in (1, -1))
    np.testing.assert_allclose(at.by_v[0], (ahead - back).T / 2, atol=1e-13 * scale)
    ahead, back = (equations.tangent(many(q), many(v), a + s * np.eye(nv)).force for s in (1, -1))
    np.testing.assert_allclose(at.mass[0], (ahead - back).T / 2, atol=1e-13 * scale)


def test_loop_curvature_is_the_derivative_of_the_loop_forces(equations):
    q, v, a = state(equations)
    multipliers = np.random.default_rng(2).standard_normal(len(equations.rows.names))
    at, h = equations.tangent(q[None], v[None], a[None]), 1e-6
    ahead, back = (
        multipliers @ loop_equations(equations.rows, frames_at(equations.robot, x)).jacobian
        for x in around(equations, q, h)
    )
    curvature = loop_curvature(equations.robot, equations.rows, at.frames, multipliers[None])[0]
    np.testing.assert_allclose(curvature, (ahead - back).T / (2 * h), atol=1e-8)
    np.testing.assert_allclose(curvature, curvature.T, atol=1e-12)  # all joints turn or slide about one axis


@pytest.mark.parametrize("damping", [-1.0, np.nan, [1.0, 2.0]])
def test_damping_that_cannot_be_is_refused(damping):
    with pytest.raises(InvalidInput, match="damping"):
        EquationsOfMotion.of(robots.load("five_bar"), np.asarray(damping))


# the eliminated system of a step against the whole one, solved at once


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

    matrix = NewtonMatrix.of(length, table.differentiation, by_motion, jacobian, rank=m)
    moved, a, multipliers = matrix.solve(force, residual)

    wrong = np.concatenate([force, residual], axis=1).ravel()
    both = -np.linalg.solve(whole(length, table.integration, by_motion, jacobian), wrong).reshape(s, nv + m)
    np.testing.assert_allclose(a, both[:, :nv], rtol=1e-8, atol=1e-8 * np.abs(both[:, :nv]).max())
    np.testing.assert_allclose(multipliers, -both[:, nv:], atol=1e-8 * np.abs(both[:, nv:]).max())
    np.testing.assert_allclose(
        moved, length**2 * table.integration @ table.integration @ a, atol=1e-10 * np.abs(moved).max()
    )


def test_a_loop_written_twice_at_a_node_is_singular():
    rows = np.zeros((3, 2, 4))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    by_motion = np.tile(np.hstack([np.eye(4), np.zeros((4, 8))]), (3, 1, 1))
    NewtonMatrix.of(0.1, radau_table(3).differentiation, by_motion, rows, rank=2)  # regular
    rows[1, 1] = rows[1, 0]
    with pytest.raises(np.linalg.LinAlgError):
        NewtonMatrix.of(0.1, radau_table(3).differentiation, by_motion, rows, rank=2)
    no_mass = np.zeros_like(by_motion)
    rows[1, 1] = np.eye(4)[1]
    with pytest.raises(np.linalg.LinAlgError):
        NewtonMatrix.of(0.1, radau_table(3).differentiation, no_mass, rows, rank=2)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e12])
def test_pseudo_inverses_know_their_rank_in_any_unit(size):
    """The third row repeats the first two; the rank must not depend on the unit."""
    jacobian = size * np.array([[1.0, 2.0, 0.5, 0.0], [0.0, 1.0, -1.0, 3.0], [1.0, 3.0, -0.5, 3.0]])
    left, values, right = np.linalg.svd(jacobian[None])
    np.testing.assert_allclose(
        size * _pseudo_inverse(left, values, right)[0], size * np.linalg.pinv(jacobian), rtol=0, atol=1e-12
    )
