"""The Agile Eye against its published closed forms: axes, working modes, and why it has no Type 2 surface."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from framework import Line, Type1Singularity, assemble, locate_singularities, velocity_matrices
from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Kinematics
from tests.oracles.spherical import BASE, GEAR, WRISTS, Spherical, rodrigues, spin_matrix

ROBOT = "agile_eye"
ORACLE = Spherical(np.pi / 2, (1, 1, 1))


PLACES = 0.7 * np.random.default_rng(1).uniform(-1, 1, (20, 3))
KINEMATICS = Kinematics(PLACES, ORACLE.motor_angles, ORACLE.ratio, 1e-12, 1e-11)


def motor_torques(x, dx, ddx):
    A, B = ORACLE.matrices(x)
    rates = np.linalg.solve(B.real, A.real) @ spin_matrix(x).real
    return np.linalg.solve(rates.T, ORACLE.platform_force(x, dx, ddx)) / GEAR


def test_at_the_reference_all_neighbouring_axes_are_orthogonal(robot):
    q = assemble(robot, np.zeros(3)).q
    np.testing.assert_allclose(q[robot.actuated], np.pi / 2, atol=1e-12)
    A, B, _ = velocity_matrices(robot, q)
    # each motor turns the camera about its own axis
    np.testing.assert_allclose(np.linalg.solve(A, B), np.eye(3), atol=1e-12)


def test_tangents_of_the_motor_angles_are_ratios_of_entries_of_the_rotation_matrix(robot):
    """As published."""
    for x in PLACES:
        q = assemble(robot, x).q[robot.actuated]
        v = WRISTS @ rodrigues(x).real.T
        for i in range(3):
            assert np.sin(q[i]) * v[i, i - 2] == pytest.approx(np.cos(q[i]) * v[i, i - 1], abs=1e-12)


def test_two_rows_of_five_are_kept_of_each_wrist(robot):
    assert robot.loops.names == ("wrist_2.rx", "wrist_2.ry", "wrist_3.rx", "wrist_3.ry")


def test_type_2_is_met_on_curves_only_in_all_eight_working_modes():
    """w x v = +- (D V - 1) / |u x v| with rows v_i of V and D = diag(u_i . v_i).

    D V is a contraction, so det never changes its sign; it vanishes only where some |u_i . v_i| = 1, where
    leg i is stretched or folded.
    """
    rotations = Rotation.random(120, random_state=3).as_rotvec()
    for mode in product((1, -1), repeat=3):
        eye = Spherical(np.pi / 2, mode)
        for r in rotations:
            v = WRISTS @ rodrigues(r).real.T
            c = np.sum(v * BASE, axis=1)
            expected = np.linalg.det(c[:, None] * v - BASE) / np.prod(np.sqrt(1 - c**2)) * np.prod(mode)
            measure = eye.measure(r)
            assert measure == pytest.approx(expected, abs=1e-12)
            assert measure * np.prod(mode) < 0
    # leg 1 folded: v_1 = u_1
    folded = Rotation.from_rotvec([0.3, 0, 0]) * Rotation.from_rotvec([0, -np.pi / 2, 0])
    v = WRISTS @ folded.as_matrix().T
    c = np.sum(v * BASE, axis=1)
    assert abs(c[0]) == pytest.approx(1.0, abs=1e-15)
    assert abs(np.linalg.det(c[:, None] * v - BASE)) < 1e-15


def test_a_path_through_a_stretched_leg_is_refused_and_the_others_are_clear(robot):
    for name in ("orient", "sweep"):
        assert not locate_singularities(robot, scene_path(robot.description.scenes[name]))
    with pytest.raises(Type1Singularity, match="motor_1"):
        locate_singularities(robot, Line([0.0, 0.0, 0.0], [0.0, -np.pi / 1.2, 0.0]))
