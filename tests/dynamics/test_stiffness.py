"""Stiffness and vibrations: closed forms of the 5R, energies written anew, differences of the simulator."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import robots
from framework import InvalidInput, NotConverged, ParallelRobot, assemble
from framework.dynamics.forces import mass_matrices
from framework.dynamics.stiffness import (
    compliant_motions,
    direction_in_words,
    least_stiffness,
    locked_motor_frequency,
    platform_stiffness,
)
from framework.dynamics.vibrations import platform_vibrations
from framework.kinematics.linearised_loops import linearised_at, linearised_at_reference
from framework.model.description import JointDynamics, LineSpring
from framework.simulation.equations import EquationsOfMotion
from tests.oracles import five_bar_pose
from tests.oracles.planar import cross, legs

POINTS = [(0.1, 0.345), (-0.05, 0.15), (0.03, -0.2)]
SINGULAR = (0.0, np.sqrt(0.06))
DRIVE, ROD, ROTOR, PAYLOAD = 25000.0, 350000.0, 6.4e-6 * 50**2, 10.0  # [N m/rad], [N/m], [kg m^2], [kg]


@pytest.mark.parametrize("x", [*POINTS, SINGULAR])
@pytest.mark.parametrize("flexibility", ["flexible_joints", "flexible_links"])
def test_the_stiffness_of_the_5r_is_that_of_its_legs(x, flexibility):
    robot = robots.load("five_bar", flexibility=flexibility)
    found = platform_stiffness(robot, assemble(robot, x))
    at = five_bar_pose.pose(np.array([x]))
    K = five_bar_pose.stiffness(at, rods=flexibility == "flexible_links")[0]
    np.testing.assert_allclose(found.stiffness, K, rtol=0, atol=1e-10 * np.abs(K).max())
    squares = np.linalg.eigvalsh(K) / five_bar_pose.PAYLOAD
    np.testing.assert_allclose(found.squares, squares, rtol=0, atol=1e-10 * squares.max())
    if x is not SINGULAR:
        free_across = np.linalg.det(K) / np.diagonal(K)[::-1]  # K_xx - K_xy^2 / K_yy, and the same of y
        np.testing.assert_allclose(found.along_axes, free_across, rtol=1e-9)
    softest = found.softest_direction
    np.testing.assert_allclose(K @ softest, np.linalg.eigvalsh(K)[0] * softest, atol=1e-10 * np.abs(K).max())
    assert softest[np.abs(softest).argmax()] > 0.5


def test_at_type_2_stiffness_and_compliance_across_stay_finite_and_along_t_s_nothing_holds():
    robot = robots.load("five_bar", flexibility="flexible_links")
    found = platform_stiffness(robot, assemble(robot, SINGULAR))  # rods in line along x: t_s is along y
    assert np.isfinite(found.stiffness).all()
    assert abs(found.stiffness[1, 1]) < 1e-12 * found.stiffness[0, 0]
    assert found.compliance[1, 1] == np.inf
    assert found.compliance[0, 0] == pytest.approx(1 / found.stiffness[0, 0], rel=1e-9)
    np.testing.assert_allclose(
        np.abs(found.platform_modes[0] / found.platform_modes[0, 1]), [0, 1], atol=1e-6
    )
    assert found.frequencies[0] == 0.0
    assert found.frequencies[1] > 1.0
    assert platform_stiffness(robot, assemble(robot, [0.0, 0.35])).is_stable


@pytest.mark.parametrize("x", [*POINTS, SINGULAR])
def test_under_load_the_payload_rests_where_an_energy_written_anew_is_least(x):
    robot = robots.load("five_bar", flexibility="flexible_links")
    w = np.array([300.0, 20.0])
    reference = assemble(robot, x)
    found = platform_stiffness(robot, reference, loaded=True, wrench=w)
    start, h = five_bar_pose.pose(np.array([x])), 1e-5
    steps = np.array([[0, 0], [h, 0], [-h, 0], [0, h], [0, -h], [h, h], [-h, -h], [h, -h], [-h, h]])
    V = five_bar_pose.energy(found.x + steps, start) - steps @ w
    scale = np.abs(found.stiffness).max()
    # at rest to a nanometre; the third derivative of V weighs h^3
    np.testing.assert_allclose([V[1] - V[2], V[3] - V[4]], 0.0, rtol=0, atol=2 * h * scale * 1e-9)
    mixed = (V[5] + V[6] - V[7] - V[8]) / (4 * h * h)
    hessian = [[(V[1] + V[2] - 2 * V[0]) / h**2, mixed], [mixed, (V[3] + V[4] - 2 * V[0]) / h**2]]
    np.testing.assert_allclose(found.stiffness, hessian, rtol=0, atol=1e-5 * scale)


@pytest.mark.parametrize(
    ("name", "flexibility"),
    [("five_bar", "flexible_links"), ("delta", "flexible_joints"), ("biglide", "flexible_links")],
)
def test_compliance_is_the_difference_of_two_equilibria(name, flexibility):
    robot = robots.load(name, flexibility=flexibility)
    reference = robot.reference
    rest = platform_stiffness(robot, reference, loaded=True)
    for k in range(robot.n):
        if not robot.translations[k]:
            continue
        w = np.zeros(robot.n)
        w[k] = 1e-6 * np.abs(np.diag(rest.stiffness)).min() * robot.length
        ends = [platform_stiffness(robot, reference, loaded=True, wrench=side * w).x for side in (1, -1)]
        moved = (ends[0] - ends[1]) / (2 * w[k])
        expected = rest.compliance[:, k]
        np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def simulated_acceleration(robot, q):
    """Joint accelerations (nv,) from rest in q (nq,) with rotors too heavy to move, by the simulator."""
    nothing = np.zeros((1, robot.model.nv))
    stuck = replace(robot, rotor_inertia=np.full(robot.n_a, 1e12))
    at = EquationsOfMotion.of(stuck).tangent(q[None], nothing, nothing)
    count = at.jacobian.shape[1]
    whole = np.block([[at.mass[0], -at.jacobian[0].T], [at.jacobian[0], np.zeros((count, count))]])
    return np.linalg.solve(whole, np.concatenate([-at.force[0], np.zeros(count)]))[: robot.model.nv]


@pytest.mark.parametrize(
    ("name", "flexibility", "loaded"),
    [
        ("five_bar_heavy", "flexible_links", False),
        ("five_bar_heavy", "flexible_links", True),
        ("delta", "flexible_joints", True),
    ],
)
def test_every_mode_of_a_robot_with_masses_swings_in_the_simulator(name, flexibility, loaded):
    robot = robots.CATALOGUE[name].load(flexibility=flexibility)
    if not loaded:
        robot.model.gravity.linear = np.zeros(3)
    found = platform_stiffness(robot, robot.reference, loaded=loaded)
    assert len(found.squares) >= robot.n
    for square, mode in zip(found.squares, found.modes, strict=True):
        h = 1e-5 / np.abs(mode / robot.column_scale).max()
        ahead, behind = (simulated_acceleration(robot, found.q + side * h * mode) for side in (1, -1))
        np.testing.assert_allclose(
            (ahead - behind) / (2 * h), -square * mode, rtol=0, atol=1e-5 * square * np.abs(mode).max()
        )


def test_a_robot_without_springs_or_without_equilibrium_is_told_so():
    with pytest.raises(InvalidInput, match="no springs"):
        platform_stiffness(robots.load("five_bar"), robots.load("five_bar").reference)
    robot = robots.load("five_bar", flexibility="flexible_joints")
    with pytest.raises(InvalidInput, match="wrench"):
        platform_stiffness(robot, robot.reference, wrench=[1.0, 0.0])
    robot = robots.load("five_bar", flexibility="flexible_links")
    with pytest.raises(NotConverged, match="no equilibrium"):  # it would stretch the rods by a kilometre
        platform_stiffness(robot, robot.reference, loaded=True, wrench=[0.0, 1e9])


@pytest.mark.parametrize("x", [(0.1, 0.345), (-0.05, 0.295), (0.0, 0.2449)])  # the last one beside Type 2
@pytest.mark.parametrize("flexibility", ["flexible_joints", "flexible_links"])
def test_the_paper_s_robot_vibrates_on_two_legs_of_springs_in_series(x, flexibility):
    robot = robots.load("five_bar", flexibility=flexibility)
    stiffness = np.zeros((2, 2))  # of x and y, with locked motors
    for crank, rod in legs(*x):
        rod = np.array(rod) / np.hypot(*rod)
        lever = cross(crank, rod)  # how fast the rod's near end moves along it, for a turn of the crank
        in_series = lever**2 / DRIVE + (1.0 / ROD if flexibility == "flexible_links" else 0.0)
        stiffness += np.outer(rod, rod) / in_series
    squares = np.linalg.eigvalsh(stiffness / PAYLOAD)
    found = platform_stiffness(robot, assemble(robot, x).q)
    np.testing.assert_allclose(found.frequencies, np.sqrt(squares) / (2 * np.pi), rtol=1e-6)


@pytest.mark.parametrize("loaded", [False, True])
def test_springs_on_joints_alone_leave_a_platform_without_a_stiffness(loaded):
    """The motors of the 5R hold all joints, so its elbow's spring gives way to nothing."""
    description = robots.load("five_bar").description
    joints = {"left_elbow": JointDynamics(stiffness=2.0)}
    robot = ParallelRobot.from_description(replace(description, joints=joints))
    with pytest.raises(InvalidInput, match="leave the platform rigid"):
        platform_stiffness(robot, robot.reference, loaded=loaded)
    free = compliant_motions(robot, linearised_at_reference(robot), robot.reference.q[None])
    assert np.isnan(least_stiffness(robot, free)).all()
    assert np.isnan(locked_motor_frequency(free)).all()


@pytest.mark.parametrize("damping", [0.0, 40.0])
def test_the_response_to_torques_is_that_of_all_coordinates_with_their_loops_also_at_type_2(damping):
    description = robots.load("five_bar").description
    joints = {"left_elbow": JointDynamics(damping=damping), "right_motor": JointDynamics(damping=damping / 2)}
    to_ground = LineSpring(("base", "left_tip"), damping=7.0 * damping)
    description = replace(description, joints=joints, line_springs=(to_ground,) if damping else ())
    robot = ParallelRobot.from_description(description, flexibility="flexible_links")
    x = np.array([[0.05, 0.3], [0.0, np.sqrt(0.06)]])  # the second is singular
    q = np.array([assemble(robot, one).q for one in x])
    frequencies = np.array([3.0, 120.0])
    found = platform_vibrations(robot, q, frequencies=frequencies, loss=0.04)
    linearised = linearised_at(robot, q)
    for k, f in product(range(2), range(2)):
        w, (J, X) = 2 * np.pi * frequencies[f], np.split(linearised.jacobian[k], [robot.n])[::-1]
        mass = mass_matrices(robot, q[k][None])[0] + np.diag(robot.rotors)
        along = x[k] / np.linalg.norm(x[k]) @ X
        dampers = np.diag(robot.joint_damping) + 7.0 * damping * np.outer(along, along)
        K = np.diag(robot.all_stiffness) * (1 + 0.04j) + 1j * w * dampers - w**2 * mass
        system = np.block([[K, J.T], [J, np.zeros((len(J), len(J)))]])
        drive = np.zeros((len(system), robot.n_a))
        drive[robot.actuated, range(robot.n_a)] = robot.gear_ratio
        witness = X @ np.linalg.solve(system, drive)[: robot.nv]
        assert found.response[k, f] == pytest.approx(witness, rel=1e-8, abs=1e-12)
    assert found.natural[1, 0] == pytest.approx(0.0, abs=1e-3)  # [Hz] along t_s nothing holds
    assert found.softest[1] == pytest.approx([0.0, 1.0], abs=1e-6)


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ([0.0, 1.0], "along y"),
        ([-1.0, 0.0], "along -x"),
        ([-0.6, 0.8], "37 degrees off y, towards -x"),
    ],
)
def test_directions_are_said_in_words(direction, words):
    assert direction_in_words(("x", "y"), np.array(direction)) == words
