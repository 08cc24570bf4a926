"""Systems of quadrics: all solutions, and the proof that each is one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from framework.proofs.homotopy import refine_solutions, solve_start_system
from framework.proofs.krawczyk import (
    MAX_RADIUS,
    MIN_RADIUS,
    Enclosures,
    are_apart,
    choose_chart,
    enclose_solutions,
    widen_until_proved,
)
from framework.proofs.study_quadric import (
    _SQUARE,
    Displacements,
    displacement_functions,
    planar_displacements,
    spatial_displacements,
    spherical_displacements,
    translation_displacements,
)
from tests.proofs.rods import rod

GROUPS = [
    translation_displacements((0, 1)),
    translation_displacements((0, 1, 2)),
    planar_displacements(2),
    planar_displacements(0),
    spherical_displacements(),
    spatial_displacements(),
]


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: f"{group.name} {group.bound}")
def test_monodromy_finds_as_many_solutions_as_there_are_and_all_are_proved(group):
    coefficients, z = solve_start_system(group)
    assert len(z) == group.bound
    quadrics, chart = group.quadrics(coefficients), choose_chart(z)
    z = refine_solutions(quadrics, z, chart.astype(complex))
    proof = enclose_solutions(quadrics, 1e-13 * np.abs(quadrics), chart, z)
    assert proof.proved.all()
    assert are_apart(z, proof.radii)


def test_monodromy_that_does_not_reach_the_bound_ends_with_fewer_solutions(monkeypatch):
    group = GROUPS[0]
    monkeypatch.setattr("framework.proofs.homotopy.MONODROMY_ROUNDS", 5)
    assert len(solve_start_system(replace(group, bound=group.bound + 1))[1]) == group.bound


def test_a_dual_quaternion_is_the_displacement_that_its_functions_are_of():
    rng = np.random.default_rng(3)
    z = rng.standard_normal((20, 8))
    z[:, 4:] -= (
        z[:, :4] * np.sum(z[:, 4:] * z[:, :4], axis=1, keepdims=True) / np.sum(z[:, :4] ** 2, 1)[:, None]
    )
    R, p = spatial_displacements().to_displacements(z)
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-13)
    np.testing.assert_allclose(R, Rotation.from_quat(z[:, [1, 2, 3, 0]]).as_matrix(), atol=1e-13)
    forms = spatial_displacements().members
    values = np.einsum("mij,ti,tj->tm", forms, z, z)
    np.testing.assert_allclose(values / values[:, :1], displacement_functions(R, p), atol=1e-12)


def test_a_rod_is_met_by_displacements_that_keep_its_length():
    rng = np.random.default_rng(4)
    a, b, p = rng.standard_normal((3, 3))
    R = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
    length = float(np.linalg.norm(R @ b + p - a))
    assert abs(displacement_functions(R[None], p[None])[0] @ rod(a, b, length)) < 1e-13
    assert abs(displacement_functions(R[None], p[None])[0] @ rod(a, b, 1.01 * length)) > 1e-3


def circles(apart):
    """Quadrics in (1, x, y): unit circles about (0, 0) and (apart, 0)."""
    one = np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    two = np.array([[apart**2 - 1, -apart, 0], [-apart, 1, 0], [0, 0, 1]])
    return np.stack([one, two]).astype(complex)


@pytest.mark.parametrize("depth", [1e-1, 1e-3, 1e-5])
def test_solutions_however_near_to_each_other_are_proved_to_be_two(depth):
    """Circles that overlap by a depth meet at +- sqrt(depth - ...): the enclosures hold the exact places."""
    apart = 2 - depth
    exact = np.sqrt(1 - (apart / 2) ** 2)
    z = np.array([[1, apart / 2, exact * (1 + 1e-10)], [1, apart / 2, -exact]]).astype(complex)
    proof = enclose_solutions(circles(apart), np.zeros((2, 3, 3)), np.array([1.0, 0, 0]), z)
    assert proof.proved.all()
    assert are_apart(z, proof.radii)
    assert abs(z[0, 2].real - exact) <= proof.radii[0, 2] < 1e-6


def test_what_is_no_single_solution_is_not_proved():
    chart = np.array([1.0, 0, 0])
    touching = enclose_solutions(
        circles(2.0), np.zeros((2, 3, 3)), chart, np.array([[1, 1, 0]]).astype(complex)
    )
    assert not touching.proved[0]  # a double one
    nowhere = enclose_solutions(
        circles(1.0), np.zeros((2, 3, 3)), chart, np.array([[1, 0.5, 0.5]]).astype(complex)
    )
    assert not nowhere.proved[0]  # 0.36 from the next
    inexact = 1e-3 * np.abs(circles(1.9999))
    exact = np.array([[1, 1.9999 / 2, np.sqrt(1 - (1.9999 / 2) ** 2)]]).astype(complex)
    assert not enclose_solutions(circles(1.9999), inexact, chart, exact).proved[
        0
    ]  # some of these circles do not meet


def test_circles_apart_meet_in_two_points_that_are_not_real():
    z = np.array([[1, 1.5, 1j * np.sqrt(1.25)], [1, 1.5, -1j * np.sqrt(1.25)]])
    proof = enclose_solutions(circles(3.0), np.zeros((2, 3, 3)), np.array([1.0, 0, 0]), z)
    assert proof.proved.all()
    assert (np.abs(z.imag) > proof.radii).any(axis=1).all()


@pytest.mark.parametrize("seed", range(20))
def test_errors_of_eliminated_conditions_bound_every_change_of_the_coefficients(seed):
    rng = np.random.default_rng(seed)
    chosen = SimpleNamespace(chosen=np.array([_SQUARE, _SQUARE + 1, _SQUARE + 2, _SQUARE + 3]))
    conditions = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-3.0, 3.0, (4, 1))
    conditions[:, 0] *= 10.0 ** rng.uniform(-2.0, 0.0)  # shares of |p|^2
    rounding = 1e-6
    rows, errors = Displacements.eliminate_square(chosen, conditions, rounding)
    largest = np.abs(conditions).max(axis=1, keepdims=True)
    k = np.argmax(np.abs(conditions[:, :1]) / largest)
    for _ in range(50):
        changed = conditions + rounding * largest * rng.choice([-1.0, 1.0], size=(4, 4))
        pivot = changed[k] / changed[k, 0]
        exact = changed - changed[:, :1] * pivot
        exact[k] = pivot
        assert np.all(np.abs(exact - rows)[:, 1:] <= (1.0 + 1e-8) * errors[:, 1:])  # 1e-8: rounding here


def test_boxes_without_a_proof_are_widened_beyond_their_image_and_the_others_stay():
    tried = []

    def test(radii):
        """Three boxes of which the last is proved, and whose images do not grow with them."""
        tried.append(radii)
        image = np.array([[0.0, 0.5], [100.0, 0.0], [1.0, 1.0]])
        return Enclosures(np.array([False, False, True]), np.zeros(3, dtype=bool), radii, image)

    tested = widen_until_proved(test, np.full((3, 2), 1e-17))
    assert len(tried) > 2
    for radii in tried[1:]:
        assert (radii[:2] >= MIN_RADIUS).all()
        assert (radii[:2] > [[0.0, 0.5], [MAX_RADIUS / 2, 0.0]]).all()
        assert radii.max() <= 1.01 * MAX_RADIUS
        np.testing.assert_array_equal(radii[2], 1e-17)
    np.testing.assert_array_equal(tested.radii, tried[-1])
