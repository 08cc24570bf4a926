"""The bordered measure against determinants and singular values, in more digits than doubles have."""

import mpmath as mp
import numpy as np
import pytest

import robots
from framework import Line, track_path
from framework.kinematics.frames import integrate
from framework.kinematics.linearised_loops import linearised_at, passive_matrix, type2_matrix
from framework.planning.scenes import scene_path
from framework.singularity.bordered_system import Border, determinant, solve_bordered
from framework.singularity.type2 import measure_gradient, singularity_measure
from tests.dynamics.test_dynamics_derivatives import on_balls


def matrix(seed: int, values) -> np.ndarray:
    """A matrix with these singular values."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.standard_normal((len(values),) * 2))[0] for _ in range(2))
    return left * np.asarray(values, dtype=float) @ right


def whole(M, border):
    size = border.b.shape[1]
    return np.block([[M, border.b], [border.c.T, np.zeros((size, size))]])


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("last", [0.3, 1e-3, 1e-12])
def test_g_is_the_determinant_over_that_of_the_bordered_matrix(size, last):
    """Jacobi's theorem on complementary minors: det G = det M / det [M b; c' 0], here in fifty digits."""
    M = matrix(1, [2.0, 1.1, 0.7, 0.4, last])
    border = Border.of(matrix(1, [2.1, 1.0, 0.8, 0.5, 0.1]) + 0.02 * matrix(2, np.ones(5)), size)
    found = solve_bordered(M[None], border).g[0]
    with mp.workdps(50):
        expected = mp.det(mp.matrix(M.tolist())) / mp.det(mp.matrix(whole(M, border).tolist()))
    assert found == pytest.approx(float(expected), rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("size", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_with_its_own_border_g_is_the_product_of_the_least_singular_values_with_the_sign_of_det(size, seed):
    M = matrix(seed, [3.0, 1.0, 0.2, 0.05])
    found = solve_bordered(M[None], Border.of(M, size))
    assert abs(found.g[0]) == pytest.approx(np.prod([0.05, 0.2][:size]), rel=1e-12)
    assert np.sign(found.g[0]) == np.sign(np.linalg.det(M))
    np.testing.assert_array_equal(found.g, determinant(found.G))


@pytest.mark.parametrize("size", [1, 2])
def test_eta_solves_the_bordered_equations(size):
    M, border = matrix(5, [1.0, 0.5, 0.1, 0.01]), Border.of(matrix(6, [1.0, 0.5, 0.1, 0.01]), size)
    found = solve_bordered(M[None], border)
    np.testing.assert_allclose(M @ found.eta[0] + border.b @ found.G[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(border.c.T @ found.eta[0], np.eye(size), atol=1e-12)


def test_on_a_singular_matrix_eta_is_its_null_space_and_g_is_rounding():
    M = matrix(7, [1.0, 0.6, 0.0, 0.0])
    one, two = (solve_bordered(M[None], Border.of(M + 0.01 * matrix(8, np.ones(4)), size)) for size in (1, 2))
    np.testing.assert_allclose(M @ two.eta[0], 0.0, atol=1e-14)
    assert abs(two.g[0]) < 1e-16
    # one border for two null vectors: G is zero or the system is singular, and no error either way
    assert abs(one.g[0]) < 1e-12
    zero = np.zeros((2, 3, 3))
    assert np.all(np.abs(solve_bordered(zero, Border.of(np.eye(3), 1)).g) < 1e-12)


def test_g_passes_smoothly_through_zero_where_singular_values_have_a_kink():
    one, other = matrix(9, [1.0, 0.8, 0.5]), matrix(10, [0.3, 0.2, 0.1])
    along = np.linalg.svd(one)
    start = one - along[1][2] * np.outer(along[0][:, 2], along[2][2])  # its last singular value is zero
    t = np.linspace(-1e-3, 1e-3, 5)
    matrices = start + t[:, None, None] * other
    g = solve_bordered(matrices, Border.of(matrices[2])).g
    assert g[0] * g[-1] < 0
    fitted = np.polynomial.Polynomial.fit(t, g, 3)
    assert np.abs(fitted(t) - g).max() < 1e-9 * np.abs(g).max()
    np.testing.assert_array_equal(np.sign(g * np.linalg.det(matrices))[[0, -1]], [1.0, 1.0])


# the measure that figures show


S = np.linspace(0.0, 1.0, 301)
START, END = np.array([0.12, 0.06, 0.55]), np.array([-0.08, -0.04, 0.62])
BESIDE = 5e-5 * np.array([1.0, -2.0, 0.0]) / np.sqrt(5.0)  # [m] from the axis on which two values vanish


def linearised_on(robot, path):
    return track_path(robot, path).close(S)


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("three_upu", Line(START + BESIDE, END + BESIDE)),
        ("par4", "pick"),  # two singular values come near one another
        ("five_bar", "C"),
        ("slider_crank", "full_turn"),
    ],
)
def test_g_moves_no_more_than_P_does(name, path):
    """Weyl's inequality, on either side of zero: no step where singular values change places."""
    robot = robots.load(name)
    path = scene_path(robot.description.scenes[path]) if isinstance(path, str) else path
    linearised = linearised_on(robot, path)
    P, measure = type2_matrix(robot, linearised), singularity_measure(robot, linearised)
    assert np.all(
        np.abs(np.diff(measure.g)) <= np.linalg.norm(np.diff(P, axis=0), ord=2, axis=(1, 2)) + 1e-14
    )
    np.testing.assert_array_equal(np.sign(measure.g), np.linalg.slogdet(P)[0])
    np.testing.assert_allclose(np.abs(measure.g), np.linalg.norm(P, ord=-2, axis=(1, 2)), atol=1e-14)
    assert np.all(np.sum(measure.motion[1:] * measure.motion[:-1], axis=1) > 0)


def test_a_robot_of_motors_alone_has_nothing_to_escape():
    robot = robots.load("two_arms")
    measure = singularity_measure(robot, linearised_on(robot, scene_path(robot.description.scenes["lift"])))
    np.testing.assert_array_equal(measure.g, 1.0)
    np.testing.assert_array_equal(measure.motion, 0.0)


@pytest.mark.parametrize("name", ["delta", "balls"])
def test_the_gradient_of_g_is_that_of_differences(name):
    """Turns about two axes of a ball do not commute; without that term it is wrong by a fiftieth."""
    robot = robots.load(name) if name == "delta" else on_balls()
    step, rng = 1e-3 * robot.column_scale, np.random.default_rng(5)
    q = integrate(
        robot, robot.reference.q[None], 0.1 * robot.column_scale * rng.standard_normal((1, robot.nv))
    )
    border = Border.of(passive_matrix(robot, linearised_at(robot, q)))

    def g(offsets):
        moved = linearised_at(robot, integrate(robot, np.repeat(q, len(offsets), axis=0), offsets))
        return solve_bordered(passive_matrix(robot, moved), border).G[:, 0, 0]

    near, far = (g(k * np.diag(step)) - g(-k * np.diag(step)) for k in (1, 2))
    expected = (8 * near - far) / (12 * step)  # fourth order
    found = measure_gradient(robot, linearised_at(robot, q), border).G_by_q[0, 0, 0]
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())
