"""The platform's coordinates and its twist: one is the derivative of the other, whatever turns."""

from dataclasses import fields
from functools import lru_cache
from itertools import permutations
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import robots
from framework import Line, Mechanism, ParallelRobot, plan_crossing, simulate
from framework.kinematics.attitude import attitude_about
from framework.kinematics.frames import frame_motions, frames_at, move_wrench
from framework.kinematics.placements import platform_wrenches
from framework.kinematics.platform import platform_coordinates
from framework.model.description import Platform
from framework.numerics.rotations import rotation_matrix

JOINTS = "joints"

# two translations; one turn; both; a rotation vector; with translations; two angles, either hand; with a
# translation; one turn of a frame that turns otherwise too; joints that turn; with one that slides
PLATFORMS = {
    "five_bar": None,
    "four_bar": None,
    "three_rrr": None,
    "agile_eye": None,
    "gough_stewart": None,
    "spherical_rrr": ("ry", "rx"),
    "three_rpr": ("rz", "ry"),
    "delta": ("rx", "z", "ry"),
    "standing_quadruped": ("x", "rz"),
    "two_arms": JOINTS,
    "three_upu": JOINTS,
}
NAMES = list(PLATFORMS)

WRIST = """<robot name="wrist"><link name="base"/><link name="fork"/>
  <link name="hand"><inertial><origin xyz="0.1 0 0.05"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="roll" type="continuous"><parent link="base"/><child link="fork"/><axis xyz="1 0 0"/></joint>
  <joint name="yaw" type="continuous"><parent link="fork"/><child link="hand"/><axis xyz="0 0 1"/></joint>
</robot>"""
WRIST_FILE = """version: 1
urdf: wrist.urdf
platform: {frame: hand, axes: [rz]}
actuators: [{joint: yaw}]
couplings: [{joint: roll, of: yaw, ratio: 0.8}]
reference: {yaw: 0.3, roll: 0.24}
"""


@lru_cache
def made(name: str) -> SimpleNamespace:
    """A robot of the catalogue, or its mechanism with another platform."""
    robot, asked = robots.load(name), PLATFORMS[name]
    if asked is None:
        return robot
    movable = [robot.coordinates.name_of(k) for k in (0, 2, robot.model.nv - 1)]
    new = Platform("", joints=tuple(movable)) if asked is JOINTS else Platform("", asked)
    poses = np.array([robot.q_near, *(nearby(robot, seed)[0] for seed in range(3))])
    attitudes = frames_at(robot, poses).rotation[:, 0]
    coordinates = platform_coordinates(new, robot.model).choose_chart(attitudes)
    return SimpleNamespace(
        **{field.name: getattr(robot, field.name) for field in fields(Mechanism)},
        column_scale=robot.column_scale,
        platform=coordinates,
        n=coordinates.n,
        translations=coordinates.translations,
    )


def nearby(robot, seed: int, size: float = 0.3):
    rng = np.random.default_rng(seed)
    step = size * rng.standard_normal(robot.model.nv) * robot.column_scale
    return pin.integrate(robot.model, robot.q_near, step), rng.standard_normal(robot.model.nv)


def coordinates(robot, q):
    return robot.platform.coordinates(frames_at(robot, np.atleast_2d(q)))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_the_twist_is_the_derivative_of_the_coordinates(name, seed):
    robot = made(name)
    q, v = nearby(robot, seed)
    h = 1e-5
    steps = np.array([pin.integrate(robot.model, q, t * v) for t in (-h, 0.0, h)])
    before, x, after = robot.platform.unwrap(coordinates(robot, steps), coordinates(robot, q)[0])
    twist, _ = robot.platform.twist(x[None], ((after - before) / (2 * h))[None])
    expected = robot.platform.jacobian(frames_at(robot, q[None]))[0] @ v
    np.testing.assert_allclose(twist[0], expected, rtol=0, atol=1e-8 * max(np.abs(expected).max(), 1.0))


@pytest.mark.parametrize("name", NAMES)
def test_the_derivative_of_the_twist_is_its_second_answer(name):
    robot = made(name)
    rng = np.random.default_rng(5)
    x, dx, ddx = rng.uniform(-1.0, 1.0, (3, robot.n))
    h = 1e-4

    def twist(t):
        return robot.platform.twist((x + t * dx + 0.5 * t**2 * ddx)[None], (dx + t * ddx)[None])[0][0]

    _, derivative = robot.platform.twist(x[None], dx[None], ddx[None])
    np.testing.assert_allclose(derivative[0], (twist(h) - twist(-h)) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_the_residual_is_zero_at_the_coordinates_and_grows_by_the_twist(name):
    robot = made(name)
    q, _ = nearby(robot, 4)
    at, x = frames_at(robot, q[None]), coordinates(robot, q)
    np.testing.assert_allclose(robot.platform.residual(at, x), 0.0, atol=1e-15)
    small = 1e-7 * np.random.default_rng(6).standard_normal((1, robot.n))
    expected, _ = robot.platform.twist(x, small)
    np.testing.assert_allclose(robot.platform.residual(at, x - small), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("name", "turns"), [("four_bar", 3), ("three_rrr", -2), ("agile_eye", 1)])
def test_unwrapped_coordinates_are_the_same_attitude_next_to_the_last_one(name, turns):
    robot = made(name)
    q, _ = nearby(robot, 7)
    at, x = frames_at(robot, q[None]), coordinates(robot, q)
    turning = ~robot.translations
    far = x[0].copy()
    far[turning] *= 1.0 + 2 * np.pi * turns / np.linalg.norm(x[0, turning])
    found = robot.platform.unwrap(x, far + 0.01)
    np.testing.assert_allclose(found[0], far, atol=1e-12)
    np.testing.assert_allclose(robot.platform.residual(at, found), 0.0, atol=1e-13)
    np.testing.assert_array_equal(robot.platform.unwrap(x, x[0]), x)


def test_the_angle_of_a_platform_is_that_about_its_axis():
    """Also where it is tilted: of all turns about the axis the one that leaves the least."""
    robot = robots.load("four_bar")  # rz
    tilted = Rotation.from_rotvec([0.3, -0.2, 0.0])
    for angle in (0.4, -2.0, 3.0):
        turned = Rotation.from_rotvec([0.0, 0.0, angle]) * tilted
        at = frames_at(robot, robot.q_near[None])
        at.rotation[0, 0] = turned.as_matrix()
        found = float(robot.platform.coordinates(at)[0, 0])
        angles = np.linspace(-np.pi, np.pi, 20001)
        left = (Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).inv() * turned).magnitude()
        best = angles[np.argmin(left)]
        assert abs(np.angle(np.exp(1j * (found - best)))) < 4e-4  # the spacing of the angles tried
        assert found == pytest.approx(angle, abs=0.1)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-4, 0.3, 0.999999, 1.000001, 2.5, 6.0])
def test_the_left_jacobian_of_rotations_to_the_last_digits(size):
    """omega = (1 + a [r]x + b [r]x^2) dr with a, b in fifty digits, small turns and large ones alike."""
    robot = robots.load("agile_eye")
    axis = np.array([2.0, -1.0, 2.0]) / 3
    rate = np.array([0.4, 1.1, -0.7])
    with mp.workdps(50):
        t = mp.mpf(float(np.linalg.norm(size * axis)))
        a = (1 - mp.cos(t)) / t**2 if t else mp.mpf(1) / 2
        b = (t - mp.sin(t)) / t**3 if t else mp.mpf(1) / 6
    r = size * axis
    swept = np.cross(r, rate)
    expected = rate + float(a) * swept + float(b) * np.cross(r, swept)
    found, _ = robot.platform.twist(r[None], rate[None])
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=4e-15)


def test_rotation_vectors_make_scipy_s_matrices_and_paths_their_twists():
    vectors = np.random.default_rng(8).standard_normal((10, 3))
    np.testing.assert_allclose(rotation_matrix(vectors), Rotation.from_rotvec(vectors).as_matrix())
    robot = robots.load("agile_eye")
    path = Line([0.1, 0.2, -0.3], [0.5, -0.4, 0.2])
    h = 1e-6
    turned = Rotation.from_rotvec(path(0.6 + h)) * Rotation.from_rotvec(path(0.6 - h)).inv()
    np.testing.assert_allclose(robot.platform.path_twist(path, 0.6), turned.as_rotvec() / (2 * h), atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_jacobian_and_drift_are_derivatives_along_the_motion(name):
    """v = J q', dv/dt = J q'' + drift: the drift by differences of J along a motion with constant rates."""
    robot = made(name)
    q, v = nearby(robot, 9)
    h = 1e-5
    ahead, back = (frames_at(robot, pin.integrate(robot.model, q, t * v)[None]) for t in (h, -h))
    change = robot.platform.jacobian(ahead)[0] @ v - robot.platform.jacobian(back)[0] @ v
    at = frames_at(robot, q[None])
    drift = robot.platform.drift(frame_motions(robot, at, v[None]))[0]
    np.testing.assert_allclose(drift, change / (2 * h), rtol=0, atol=1e-7 * max(1.0, np.abs(drift).max()))


@pytest.mark.parametrize("name", NAMES)
def test_a_wrench_of_the_platform_and_its_motion_have_one_power(name):
    """W . v = (force, moment) . twist for the twist that is drawn, and v is what the wrenches yield on it."""
    robot = made(name)
    q, _ = nearby(robot, 10)
    at = frames_at(robot, q[None])
    W, v = np.random.default_rng(11).standard_normal((2, 1, robot.n))
    wrench, twist = platform_wrenches(robot, q[None], W), robot.platform.frame_twist(at, v)
    if PLATFORMS[name] is not JOINTS:  # each of whose wrenches is felt by one joint alone
        assert np.sum(wrench * twist) == pytest.approx(np.sum(W * v), abs=1e-13)
    loads = np.broadcast_to(robot.platform.wrenches(at), (1, robot.n, 6)).copy()
    loads[..., 3:] += np.cross(at.position[:, :1], loads[..., :3])  # about the base's origin
    felt = robot.platform.joint_incidence(at.carried[0])
    yielded = loads[0] @ at.screws[0].T * felt
    np.testing.assert_allclose(yielded, robot.platform.jacobian(at)[0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("axes", list(permutations("xyz", 2)))
def test_two_angles_are_two_hinges_in_series_and_a_turn_that_follows(axes):
    """R = R_1(x_1) R_2(x_2) R_3(free), as scipy composes it."""
    third = next(axis for axis in "xyz" if axis not in axes)
    chart = attitude_about(np.array(["xyz".index(axis) for axis in axes]))
    rng = np.random.default_rng(12)
    angles = rng.uniform([-3, -1.5, -3], [3, 1.5, 3], (20, 3))
    R = Rotation.from_euler("".join((*axes, third)).upper(), angles).as_matrix()
    np.testing.assert_allclose(chart.coordinates(R), angles[:, :2], atol=1e-13)
    np.testing.assert_allclose(chart.residual(R, angles[:, :2] + [2 * np.pi, 0]), 0, atol=1e-13)


@pytest.mark.parametrize("name", NAMES)
def test_wrenches_change_as_their_rates_say(name):
    """First and second rates about the base's origin, by differences along a motion of constant rates."""
    robot = made(name)
    q, v = nearby(robot, 3, 0.1)
    h = 1e-5

    def at(k):
        frames = frames_at(robot, pin.integrate(robot.model, q, k * h * v)[None])
        wrenches = np.broadcast_to(robot.platform.wrenches(frames), (1, robot.n, 6))
        return move_wrench(wrenches, frames.position[:, :1]), frames.screws

    (ahead, ahead_screws), (here, screws), (back, back_screws) = map(at, (1, 0, -1))
    screw_rates = [(ahead_screws - back_screws) / (2 * h), (ahead_screws - 2 * screws + back_screws) / h**2]
    motions = frame_motions(robot, frames_at(robot, q[None]), v[None])
    felt = np.ones((robot.n, 6))
    if PLATFORMS[name] is JOINTS:  # a slide feels no couple
        felt[robot.translations, 3:] = 0.0
    first, second = felt * robot.platform.wrench_rates(motions, np.stack(screw_rates))
    np.testing.assert_allclose(first, felt * (ahead - back) / (2 * h), atol=1e-8)  # h^2 and eps / h
    np.testing.assert_allclose(second, felt * (ahead - 2 * here + back) / h**2, atol=3e-5)  # eps / h^2


def test_a_turn_about_one_axis_of_a_leg_that_also_rolls_is_planned_with_its_true_rate(tmp_path):
    """R = Rx(0.8 yaw) Rz(yaw): the angle about z is yaw, and w_z = yaw' cos roll."""
    (tmp_path / "wrist.urdf").write_text(WRIST)
    file = tmp_path / "wrist.yaml"
    file.write_text(WRIST_FILE)
    robot = ParallelRobot.from_file(file)
    plan = plan_crossing(robot, Line([0.2], [1.0]), duration=1.0)
    t, h = np.linspace(0.1, 0.9, 9), 1e-5
    yaw = (plan.platform(t + h) - plan.platform(t - h))[:, 0] / (2 * h)
    rate = plan.dynamics.velocity(t)[:, robot.coordinates.names.index("yaw")]
    np.testing.assert_allclose(rate, yaw, rtol=1e-7)
    assert simulate(robot, plan).tracking_error < 1e-9


def test_rates_of_a_rotation_vector_turn_as_its_matrix():
    """E dx against R(x + h) R(x - h)' of scipy, for large turns."""
    platform, h = robots.load("gough_stewart").platform, 1e-6
    for seed in range(3):
        x = np.append(np.zeros(3), np.random.default_rng(seed).uniform(-1.5, 1.5, 3))
        E = platform.rate_matrix(x[None])[0]
        for k in range(3):
            ahead, behind = (Rotation.from_rotvec(x[3:] + side * h * np.eye(3)[k]) for side in (1, -1))
            np.testing.assert_allclose(E[3:, 3 + k], (ahead * behind.inv()).as_rotvec() / (2 * h), atol=1e-9)
        np.testing.assert_allclose(E[:3], np.eye(6)[:3], atol=0)


BALL = """<robot name="ball"><link name="base"/>
  <link name="rod"><inertial><origin xyz="0.1 0.2 0.05"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="b" type="spherical"><parent link="base"/><child link="rod"/>
    <origin rpy="0.3 0.5 -0.2"/></joint> <link name="crank"/>
  <joint name="motor" type="continuous"><parent link="base"/><child link="crank"/></joint>
</robot>"""
BALL_FILE = """version: 1
urdf: ball.urdf
platform: {frame: rod, axes: [rx, ry, rz]}
actuators: [{joint: motor}]
closures: [{name: c, frames: [rod, crank], axes: [x]}]
reference: {b_rx: 0.4, b_ry: -0.9, b_rz: 0.7}
"""


def test_a_ball_stands_where_its_rotation_vector_in_the_file_says(tmp_path):
    """On the axes of the joint's origin, although the model's third axis goes through the centre of mass."""
    (tmp_path / "ball.urdf").write_text(BALL)
    (tmp_path / "ball.yaml").write_text(BALL_FILE)
    mechanism = Mechanism.from_file(tmp_path / "ball.yaml")
    data = mechanism.model.createData()
    pin.framesForwardKinematics(mechanism.model, data, mechanism.q_near)
    rod = data.oMf[mechanism.model.getFrameId("rod", pin.FrameType.BODY)].rotation
    origin = Rotation.from_euler("xyz", [0.3, 0.5, -0.2])
    expected = (origin * Rotation.from_rotvec([0.4, -0.9, 0.7])).as_matrix()
    np.testing.assert_allclose(rod, expected, atol=1e-12)
