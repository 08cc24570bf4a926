"""Derivatives of torques and accelerations against central differences, for every robot and kind of loop."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import (
    InvalidInput,
    ParallelRobot,
    SingularPose,
    assemble,
    dynamics_at,
    dynamics_derivatives,
    forward_dynamics,
)
from framework.dynamics.body_parameters import body_parameters
from framework.dynamics.forward_dynamics import forward_derivatives
from framework.kinematics.diagnostics.proposal import propose
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.motion_rates import motion_at
from framework.model.description import JointDynamics, LineSpring
from framework.model.readers import parse_any
from tests.kinematics.test_couplings import cardan_in
from tests.model.readers.foreign_files import DATA, without_dry_friction
from tests.oracles.massless_legs import machine
from tests.robots.every_robot import CASES, in_stages
from tests.robots.test_closures_of_all_kinds import without_right_rod
from tests.stability.test_many_crossings import massless_legs

STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}  # eighth order, odd
MASSLESS = {("five_bar", "flexible_links"), ("bricard", "flexible_links")}  # whose springs bear no mass
STEP = 5e-4  # [rad, robot lengths], and as much a second
THREE_PRS = Path(__file__).parents[1] / "data" / "three_prs" / "three_prs.yaml"


def slopes(values, points, sizes):
    """Eighth-order central differences (f, k) of values (T, f) of points (T, k) at points (k,)."""
    k = len(points)
    shifts = [sign * m for m in STENCIL for sign in (1, -1)]
    moved = np.concatenate([points + STEP * m * np.diag(sizes) for m in shifts])
    results = values(moved).reshape(len(shifts), k, -1)
    weights = [np.sign(m) * STENCIL[abs(m)] for m in shifts]
    return (np.tensordot(weights, results, 1) / (STEP * sizes[:, None])).T


def on_balls():
    """The head on six rods between balls, which rest; its springs and damping are left out."""
    description = parse_any(DATA / "head_on_six_rods.xml", propose=propose).description
    return ParallelRobot.from_description(without_dry_friction(replace(description, joints={})))


def with_springs():
    """The 5R with a spring and damper between two points and a spring on a joint."""
    description = robots.load("five_bar").description
    pull = LineSpring(("base", "left_tip"), stiffness=300.0, rest=0.2, damping=5.0)
    elbow = JointDynamics(armature=0.01, damping=0.5, stiffness=3.0, rest=0.2)
    return ParallelRobot.from_description(
        replace(description, line_springs=(pull,), joints={"left_elbow": elbow})
    )


OTHERS = {
    "springs": lambda _: with_springs(),
    "distance": lambda _: ParallelRobot.from_description(
        without_right_rod(robots.load("five_bar").description)
    ),
    "two turns": lambda _: ParallelRobot.from_file(THREE_PRS),
    "balls": lambda _: on_balls(),
    "coupling": cardan_in,
}


AT_ONCE = ("five_bar", "three_rpr", "spherical_rrr", "two_arms")
STAGES = in_stages(CASES, at_once=lambda case: case[0] in AT_ONCE and case[1] != "flexible_joints")


@pytest.fixture(params=[*STAGES, *(pytest.param((name,), id=name) for name in OTHERS)])
def robot(request, tmp_path) -> ParallelRobot:
    case = request.param
    return OTHERS[case[0]](tmp_path) if len(case) == 1 else robots.load(case[0], flexibility=case[1])


def state_of(robot, seed=1):
    """Deflections and a pose near the reference, with rates and accelerations; a force of the world."""
    rng = np.random.default_rng(seed)
    x = robot.reference.x + 0.02 * robot.platform_scale * rng.standard_normal(robot.n)
    bent = 1e-3 * robot.column_scale[robot.elastic] * rng.standard_normal(robot.n_e)
    dx, ddx = rng.standard_normal((2, robot.n)) * robot.platform_scale
    body = robot.model.frames[robot.model.nframes - 1].name
    return x, bent, dx, ddx, {body: rng.standard_normal(6)}


def closed_at(robot, x, bent):
    """Configurations (T, nq) at x (T, n) with deflections (T, n_e)."""
    guess = np.repeat(robot.reference.q[None], len(x), axis=0)
    step = np.zeros((len(x), robot.model.nv))
    step[:, robot.elastic] = bent - difference(robot, robot.neutral, guess)[:, robot.elastic]
    return close_loops(robot, x, integrate(robot, guess, step)).q


def test_torque_derivatives_are_differences_of_torques(robot):
    x, bent, dx, ddx, wrenches = state_of(robot)
    q = closed_at(robot, x[None], bent[None])[0]

    def torque(points):
        at = closed_at(robot, points[:, : robot.n], np.repeat(bent[None], len(points), axis=0))
        rates = points[:, robot.n :].reshape(len(points), 2, robot.n)
        return dynamics_at(robot, at, dx=rates[:, 0], ddx=rates[:, 1], wrenches=wrenches).torque

    found = dynamics_derivatives(robot, q, dx=dx, ddx=ddx, wrenches=wrenches)
    sizes = np.tile(robot.platform_scale, 3)
    expected = slopes(torque, np.concatenate([x, dx, ddx]), sizes) * sizes
    ours = np.concatenate([found.torque_x, found.torque_dx, found.torque_ddx], axis=1) * sizes
    np.testing.assert_allclose(found.torque, torque(np.concatenate([x, dx, ddx])[None])[0], rtol=1e-12)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_torque_derivatives_are_those_of_virtual_work():
    """The delta without mass in its legs, by differences in forty digits (tests/oracles/massless_legs.py)."""
    delta = massless_legs("delta")
    x, dx, ddx = np.array([-0.13, -0.04, -1.1]), np.array([0.3, -0.2, 0.5]), np.array([-4.0, 3.0, 9.0])
    found = dynamics_derivatives(delta, assemble(delta, x).q, dx=dx, ddx=ddx)
    ours = np.concatenate([found.torque_x, found.torque_dx, found.torque_ddx], axis=1)
    expected = machine("delta").slopes(x, dx, ddx)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_acceleration_derivatives_are_differences_of_accelerations(robot):
    """Of all coordinates; of springs without mass the torques of one instant do not tell the acceleration."""
    n, n_a, d = robot.n, robot.n_a, robot.n + robot.n_e
    x, bent, dx, _, wrenches = state_of(robot)
    torque = np.linspace(-0.1, 0.1, n_a)

    def state(points):
        y, dy = points[:, :d], points[:, d : 2 * d]
        closed = assembled_at(robot, closed_at(robot, y[:, :n], y[:, n:]), stacks=True)
        motion = motion_at(robot, closed, dy[:, :n], np.zeros_like(dy[:, :n]), dy[:, n:])
        return closed.q, motion.v

    def accelerations(points):
        q, v = state(points)
        a = forward_dynamics(robot, q, v, points[:, 2 * d :], wrenches=wrenches).a
        return a[:, np.concatenate([robot.elastic, robot.actuated])]

    point = np.concatenate([x, bent, dx, np.zeros(robot.n_e), torque])
    q, v = (part[0] for part in state(point[None]))
    if (robot.name, robot.flexibility) in MASSLESS:
        with pytest.raises(InvalidInput, match="no mass"):
            forward_derivatives(robot, q, v, torque, wrenches=wrenches)
        return
    found = forward_derivatives(robot, q, v, torque, wrenches=wrenches)
    sizes = np.concatenate(
        [np.tile([*robot.platform_scale, *robot.column_scale[robot.elastic]], 2), np.ones(n_a)]
    )
    expected = slopes(accelerations, point, sizes) * sizes
    of_springs = np.hstack([found.acceleration_y, found.acceleration_dy, found.acceleration_torque])[n:]
    of_motors = np.hstack([found.motor_y, found.motor_dy, found.motor_torque])
    ours = np.concatenate([of_springs, of_motors]) * sizes
    at_point = accelerations(point[None])[0]
    np.testing.assert_allclose(found.motor, at_point[robot.n_e :], rtol=1e-12)
    rounding = 1e-14 * np.abs(at_point).max() / STEP  # of the differences: springs accelerate quickly
    for part in (slice(0, d), slice(d, 2 * d), slice(2 * d, None)):
        scale = np.abs(expected[:, part]).max()
        np.testing.assert_allclose(ours[:, part], expected[:, part], rtol=0, atol=1e-7 * scale + rounding)


@pytest.mark.parametrize("name", ["five_bar_heavy", "gough_stewart"])
def test_a_wrench_on_axes_of_its_frame_turns_on_with_it(name):
    """Differences of accelerations under a wrench that pinocchio's rotation of the frame turns."""
    robot = robots.load(name)
    x, _, dx, _, wrenches = state_of(robot)
    ((frame, own),) = wrenches.items()
    data, index, n = robot.model.createData(), robot.model.getFrameId(frame), robot.n

    def state(points):
        closed = assembled_at(robot, closed_at(robot, points[:, :n], np.zeros((len(points), 0))), stacks=True)
        return closed.q, motion_at(robot, closed, points[:, n:], np.zeros_like(points[:, n:])).v

    def on_base_axes(q):
        pin.framesForwardKinematics(robot.model, data, q)
        return (own.reshape(2, 3) @ data.oMf[index].rotation.T).ravel()

    def accelerations(points):
        q, v = state(points)
        turned = np.array([on_base_axes(row) for row in q])
        torque = np.zeros((len(q), robot.n_a))
        return forward_dynamics(robot, q, v, torque, wrenches={frame: turned}).a[:, robot.actuated]

    point = np.concatenate([x, dx])
    q, v = (part[0] for part in state(point[None]))
    zero, turned = np.zeros(robot.n_a), {frame: on_base_axes(q)}
    sizes = np.tile(robot.platform_scale, 2)
    expected = slopes(accelerations, point, sizes)[:, :n] * robot.platform_scale
    turning = forward_derivatives(robot, q, v, zero, wrenches=turned, turning=[frame])
    still = forward_derivatives(robot, q, v, zero, wrenches=turned)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(turning.motor_y * robot.platform_scale, expected, rtol=0, atol=1e-7 * scale)
    assert np.abs(still.motor_y * robot.platform_scale - expected).max() > 1e-4 * scale


def test_the_regressor_gives_what_bodies_ask_of_the_motors(robot):
    """Torques less those of rotors, armature, damping and springs; another payload asks for what it says."""
    x, bent, dx, ddx, _ = state_of(robot)
    q = closed_at(robot, x[None], bent[None])[0]
    bare = replace(
        robot,
        rotor_inertia=0.0 * robot.rotor_inertia,
        joint_damping=0.0 * robot.joint_damping,
        joint_stiffness=0.0 * robot.joint_stiffness,
        line_springs=robots.load("five_bar").line_springs,  # none
    )
    armature = bare.model.armature.copy()
    bare.model.armature[:] = 0.0
    torque = dynamics_at(bare, q, dx=dx, ddx=ddx).torque
    bare.model.armature[:] = armature
    found, (names, values) = dynamics_derivatives(robot, q, dx=dx, ddx=ddx), body_parameters(robot)
    given = found.regressor @ values
    assert found.parameters == names
    np.testing.assert_allclose(given, torque, rtol=0, atol=1e-10 * np.abs(torque).max())


def test_at_a_type_2_singularity_forward_derivatives_are_finite_and_torques_have_a_pole():
    """The 5R at y = sqrt(0.06), where its rods are in line."""
    robot = robots.load("five_bar")
    q = assemble(robot, [0.0, np.sqrt(0.06)]).q
    instant = forward_dynamics(robot, q, np.zeros(4), [0.1, -0.2])
    found = forward_derivatives(robot, q, np.zeros(4), [0.1, -0.2])
    np.testing.assert_allclose(found.motor, instant.a[robot.actuated], rtol=1e-12)
    assert all(np.isfinite(part).all() for part in vars(found).values())
    assert np.linalg.matrix_rank(found.acceleration_torque, tol=1e-9) == 1
    with pytest.raises(SingularPose, match="Type 2"):
        dynamics_derivatives(robot, q)


def test_idle_turns_that_balls_drive_are_refused_by_name():
    description = parse_any(DATA / "head_on_six_rods.xml", propose=propose).description
    driven = ParallelRobot.from_description(without_dry_friction(description))
    with pytest.raises(InvalidInput, match="idle turns passive"):
        dynamics_derivatives(driven, driven.reference.q)
