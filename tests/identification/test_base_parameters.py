"""Base parameters: their number and names against a regressor by differences, and torques they do not change.

The regressor of the witness: forces of the tree by RNEA on models whose parameters differ by one, projected
on the motions that the loops allow, a null space of their derivatives by differences.
"""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, ParallelRobot, dynamics_at
from framework.identification import base_parameters
from framework.identification.base_parameters import (
    central_moments,
    parameter_regressor,
    random_motion,
    torque_parameters,
)
from tests.robots.every_robot import RIGID, in_stages

SOME_DIRECTIONS = 8  # of a robot, drawn at random
SQUARE = [(name,) for name, robot in RIGID.items() if robot.n_a == robot.n]


def allowed_motions(robot: ParallelRobot, motion, k: int) -> np.ndarray:
    """Joint rates (nv, n) for unit twists of the platform, idle joints at rest.

    dF/dq itself is that of the framework, held against differences elsewhere; the null space is by SVD.
    """
    jacobian = motion.linearised.jacobian[k]
    moving = np.sort(robot.moving)
    loops, platform = jacobian[robot.n :, moving], jacobian[: robot.n, moving]
    null = np.linalg.svd(loops)[2][np.linalg.matrix_rank(loops, tol=1e-8) :].T
    rates = np.zeros((robot.model.nv, robot.n))
    rates[moving] = null @ np.linalg.inv(platform @ null)
    return rates


def body(parameters: np.ndarray) -> pin.Inertia:
    return pin.Inertia.FromDynamicParameters(parameters)


def witness_regressor(robot: ParallelRobot, motion) -> np.ndarray:
    """(T, n, p): what a unit of each parameter adds to the forces along the platform."""
    described = torque_parameters(robot)
    start = np.array([3.0, 0.1, 0.2, 0.3, 5.0, 0.1, 5.0, 0.1, 0.1, 5.0])
    columns = []
    rates = [allowed_motions(robot, motion, k) for k in range(len(motion.q))]

    def projected(forces) -> np.ndarray:
        return np.array([N.T @ r for N, r in zip(rates, forces, strict=True)])

    for j in map(int, described.bodies):
        name = str(robot.model.names[j])
        axes = robot.model.frames[robot.model.getFrameId(name, pin.FrameType.JOINT)].placement
        for entry in np.eye(10):
            forces = []
            for sign in (1.0, -1.0):
                model = robot.model.copy()
                model.inertias[j] = axes.act(body(start + sign * entry))
                data = model.createData()
                forces.append(
                    np.array(
                        [
                            pin.rnea(model, data, *row)
                            for row in zip(motion.q, motion.v, motion.a, strict=True)
                        ]
                    )
                )
            columns.append(projected(0.5 * (forces[0] - forces[1])))
    for column, gear in zip(robot.actuated, robot.gear_ratio, strict=True):
        for values in (gear**2 * motion.a[:, column], motion.v[:, column], np.sign(motion.v[:, column])):
            forces = np.zeros_like(motion.v)
            forces[:, column] = values
            columns.append(projected(forces))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("case", in_stages(SQUARE))
def test_the_rank_and_the_gap_are_those_of_a_regressor_by_differences(case):
    robot = RIGID[case[0]]
    found = base_parameters(robot)
    described = torque_parameters(robot)
    count = int(np.ceil(2.0 * len(described.names) / robot.n))
    motion = random_motion(robot, count, np.random.default_rng(7))
    matrix = witness_regressor(robot, motion)
    size = np.abs(matrix * described.sizes).max(axis=2, keepdims=True)
    ours = parameter_regressor(robot, motion, described).matrix
    np.testing.assert_allclose(
        ours * described.sizes / size, matrix * described.sizes / size, rtol=0, atol=1e-9
    )
    scaled = matrix * described.sizes
    scaled = (scaled / np.linalg.norm(scaled, axis=(1, 2))[:, None, None]).reshape(-1, matrix.shape[2])
    lengths = np.linalg.norm(scaled, axis=0)
    values = np.linalg.svd(scaled[:, lengths > 1e-9] / lengths[lengths > 1e-9], compute_uv=False)
    assert found.without_effect == tuple(np.array(described.names)[lengths <= 1e-9].tolist())
    assert found.certain
    assert found.gap > 1e6
    assert values[found.rank - 1] > 1e3 * np.append(values, 0.0)[found.rank]
    assert values[found.rank - 1] > 1e-8 * values[0]


def changed(robot: ParallelRobot, step: np.ndarray) -> ParallelRobot:
    """The robot with its parameters changed by a step (p,)."""
    bodies, model, damping = torque_parameters(robot).bodies, robot.model.copy(), robot.joint_damping.copy()
    for j, more in zip(map(int, bodies), step[: 10 * len(bodies)].reshape(-1, 10), strict=True):
        axes = model.frames[model.getFrameId(str(model.names[j]), pin.FrameType.JOINT)].placement
        model.inertias[j] = axes.act(body(axes.actInv(model.inertias[j]).toDynamicParameters() + more))
    of_motors = step[10 * len(bodies) :].reshape(-1, 3)
    damping[robot.actuated] += of_motors[:, 1]
    assert not of_motors[:, 2].any()  # dry friction of every motor is seen
    rotors = robot.rotor_inertia + of_motors[:, 0]
    return dataclasses.replace(robot, model=model, rotor_inertia=rotors, joint_damping=damping)


@pytest.mark.parametrize("case", in_stages(SQUARE))
def test_torques_do_not_change_along_what_is_unseen(case):
    robot = RIGID[case[0]]
    found, random = base_parameters(robot), np.random.default_rng(3)
    q = random_motion(robot, 1, random).q[0]
    dx, ddx = random.standard_normal((2, robot.n)) * robot.platform_scale

    def torque(step: np.ndarray) -> np.ndarray:
        return dynamics_at(changed(robot, step), q, dx=dx, ddx=ddx).torque

    own = torque(np.zeros(len(found.parameters)))
    leads = np.setdiff1d(np.arange(len(found.parameters)), found.combinations.leading)
    pairs = list(zip(leads, found.combinations.unseen, strict=True))
    for k, direction in [pairs[i] for i in random.permutation(len(pairs))[:SOME_DIRECTIONS]]:
        step = direction * 0.3 / np.abs(direction / found.described.sizes).max()
        alone = torque(step * (np.arange(len(step)) == k))
        size = max(np.abs(own).max(), np.abs(alone).max())
        np.testing.assert_allclose(torque(step), own, rtol=0, atol=1e-12 * size)


def test_a_planar_five_bar_by_name():
    """Of a planar two-link arm per leg on one tip: 11 with three parameters of each motor, horizontal."""
    found = base_parameters(robots.load("five_bar_heavy"))
    assert (found.rank, len(found.parameters)) == (11, 46)
    assert (
        "left_crank.Izz + 0.0625 left_rod.mass + right_rod.Izz + 2500 left_motor.rotor_inertia" in found.names
    )
    assert "right_motor.friction" in found.names
    assert {"left_rod.mz", "left_rod.Ixx", "left_crank.mass"} <= set(found.without_effect)
    np.testing.assert_allclose(found.values[-1], robots.load("five_bar_heavy").joint_friction[-1])


def test_massless_bodies_are_left_out_unless_they_are_asked_for():
    robot = robots.load("five_bar")
    assert "right_rod" in base_parameters(robot).left_out
    assert base_parameters(robot, massless=True).rank == base_parameters(robots.load("five_bar_heavy")).rank


def test_a_robot_with_springs_is_told_to_be_rigid():
    with pytest.raises(InvalidInput, match="rigid"):
        base_parameters(robots.load("five_bar", flexibility="flexible_links"))


@pytest.mark.parametrize("name", ["five_bar_heavy", "delta", "slider_crank"])
def test_base_parameters_stand_for_all_others_and_are_what_their_names_say(name):
    """Torques with the leading parameter of each combination at its value, all others zero, are the same."""
    robot = robots.load(name)
    found, described = base_parameters(robot), torque_parameters(robot)
    motion = random_motion(robot, 5, np.random.default_rng(2))
    matrix = parameter_regressor(robot, motion, described).matrix
    own = matrix @ described.values
    leading = matrix[:, :, found.combinations.leading] @ found.values
    np.testing.assert_allclose(leading, own, rtol=0, atol=1e-9 * np.abs(own).max())
    in_file = dict(zip(described.names, described.values, strict=True))
    for words, value in zip(found.names, found.values, strict=True):
        if "terms" in words:  # shortened
            continue
        terms = [term.split() for term in words.replace("- ", "+ -").split(" + ")]
        parts = []
        for *factor, parameter in terms:
            sign = -1.0 if parameter.startswith("-") else 1.0
            parts.append(sign * float((factor or ["1"])[0]) * in_file[parameter.removeprefix("-")])
        assert sum(parts) == pytest.approx(value, abs=1e-3 * np.abs(parts).max() + 1e-15)


def test_moments_about_the_centre_are_those_of_points():
    rng = np.random.default_rng(2)
    masses, points = rng.uniform(0.5, 2.0, 7), rng.standard_normal((7, 3))
    whole = sum(
        (pin.Inertia(mass, point, np.zeros((3, 3))) for mass, point in zip(masses, points, strict=True)),
        start=pin.Inertia.Zero(),
    )
    centre, moments = central_moments(whole.toDynamicParameters())
    expected = masses @ points / masses.sum()
    np.testing.assert_allclose(centre, expected, rtol=1e-12)
    np.testing.assert_allclose(moments, ((points - expected).T * masses) @ (points - expected), rtol=1e-12)
