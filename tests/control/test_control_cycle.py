"""The control cycle against forward kinematics and the dynamics of one instant, for every robot."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import (
    InvalidInput,
    NotAssembled,
    ParallelRobot,
    Type2Singularity,
    assemble,
    dynamics_at,
    forward_kinematics,
    plan_scene,
)
from framework.control import ControlCycle, control_cycle
from tests.dynamics.test_dynamics_derivatives import OTHERS, STAGES
from tests.kinematics.test_couplings import cardan_in

REDUNDANT = ("two_arms", "standing_quadruped")  # their motors depend on one another
CASES = [case for case in STAGES if getattr(case, "values", (case,))[0][0] not in REDUNDANT]


def geared(folder):
    """Two links with a gear whose ratio rounds: an error of its rows grows from one update to the next."""
    description = cardan_in(folder).description
    (coupling,) = description.couplings
    return ParallelRobot.from_description(replace(description, couplings=(replace(coupling, ratio=-1.7),)))


def curved(folder):
    """The same gear with a ratio that changes along the motion, whose rows have a drift."""
    description = geared(folder).description
    (coupling,) = description.couplings
    coupling = replace(coupling, terms=(((coupling.of, coupling.of), 0.4),))
    return ParallelRobot.from_description(replace(description, couplings=(coupling,)))


OTHERS = OTHERS | {"couplings": curved}


def test_a_geared_joint_is_closed_without_another_search(tmp_path, monkeypatch):
    cycle = ControlCycle(robot := geared(tmp_path))
    monkeypatch.setattr(control_cycle, "forward_kinematics", None)
    for q_a, dq_a, _ in zip(*swing(robot, count=90), strict=True):
        cycle.update(q_a, dq_a)
        np.testing.assert_allclose(cycle.q, [q_a[0], -1.7 * q_a[0]], rtol=0, atol=1e-14)
        np.testing.assert_allclose(cycle.v, [dq_a[0], -1.7 * dq_a[0]], rtol=1e-13)


@pytest.fixture(params=[*CASES, *(pytest.param((name,), id=name) for name in OTHERS)])
def robot(request, tmp_path):
    case = request.param
    return OTHERS[case[0]](tmp_path) if len(case) == 1 else robots.load(case[0], flexibility=case[1])


def swing(robot, count=40, size=2e-3, seed=0):
    """Positions, rates and accelerations of the motors' joints, 1 ms apart, each (count, n_a)."""
    t, rng = 1e-3 * np.arange(count)[:, None], np.random.default_rng(seed)
    start = robot.actuated_coordinates(robot.reference.q[None])[0]
    w, size = 20.0 + rng.uniform(0, 10, robot.n_a), size * robot.column_scale[robot.actuated]
    wave = size * np.sin(w * t)
    return start + wave, size * w * np.cos(w * t), -(w**2) * wave


def test_pose_rates_and_torques_are_those_of_one_instant(robot):
    cycle = ControlCycle(robot)
    for q_a, dq_a, ddq_a in zip(*swing(robot), strict=True):
        cycle.update(q_a, dq_a)
        torque = cycle.torque(ddq_a)
    pose = forward_kinematics(robot, q_a)
    if not len(robot.structure.idle):  # an idle turn is where the way has left it
        np.testing.assert_allclose(cycle.q, pose.q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(cycle.x, pose.x, rtol=0, atol=1e-10 * robot.length)
    assert cycle.residual < 1e-13 * max(robot.length, 1.0)
    # the same joint rates, and accelerations of the platform that give the motors ddq_a
    at_rest = dynamics_at(robot, cycle.q, dx=cycle.dx)
    np.testing.assert_allclose(at_rest.v, cycle.v, rtol=0, atol=1e-9 * np.abs(cycle.v).max())
    units = [dynamics_at(robot, cycle.q, dx=cycle.dx, ddx=e).a - at_rest.a for e in np.eye(robot.n)]
    by_motors = np.array(units).T[robot.actuated]
    ddx = np.linalg.solve(by_motors, ddq_a - at_rest.a[robot.actuated])
    expected = dynamics_at(robot, cycle.q, dx=cycle.dx, ddx=ddx).torque
    scale = np.abs(expected).max()
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-8 * scale)
    np.testing.assert_allclose(cycle.mass @ ddq_a + cycle.bias, torque, rtol=0, atol=1e-10 * scale)


def test_a_cycle_linearises_once_and_its_torques_are_those_of_the_plan(monkeypatch):
    """In steps of a millisecond along scene C: an error of T would show in the torques."""
    plan = plan_scene(robot := robots.load("five_bar"), "C")
    t = np.arange(0.0, 0.6, 1e-3)
    motion, torque = plan.dynamics.motion(t), plan.torque(t)
    cycle = ControlCycle(robot, near=motion.q[0])
    linearise, poses = cycle._linearise, []
    monkeypatch.setattr(cycle, "_linearise", lambda q: poses.append(q) or linearise(q))
    of_motors = [values[:, robot.actuated] for values in (motion.q, motion.v, motion.a)]
    for q_a, dq_a, ddq_a, expected in zip(*of_motors, torque, strict=True):
        cycle.update(q_a, dq_a)
        np.testing.assert_allclose(cycle.torque(ddq_a), expected, rtol=0, atol=1e-11 * np.abs(torque).max())
    assert len(poses) == len(t)


def test_distances_are_those_of_the_matrices(robot):
    """That to Type 2 within the square root of the size of P of the least singular value."""
    cycle = ControlCycle(robot)
    count = np.sqrt(len(robot.following))
    least = dynamics_at(robot, cycle.q).clearance
    assert (
        least / count * (1 - 1e-9) <= cycle.type2 <= 3 * least * count
    )  # an estimate of the norm, not above
    motors = robot.actuated_coordinates(cycle.q[None])[0]
    steps = 1e-6 * robot.column_scale[robot.actuated]
    columns = []
    for k, h in enumerate(steps):
        ends = [forward_kinematics(robot, motors + s * h * np.eye(robot.n_a)[k]).x for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2e-6 * robot.platform_scale))
    values = np.linalg.svd(np.array(columns).T, compute_uv=False)
    if getattr(robot.platform, "attitude", None) is None or robot.platform.attitude.rates_are_velocities:
        assert abs(cycle.type1) == pytest.approx(values[-1], rel=1e-6)


@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "gough_stewart"])
def test_no_jump_leads_to_another_branch(name):
    """Motors far away: the pose that the followed way has, or the same refusal, and the cycle goes on."""
    robot, rng = robots.load(name), np.random.default_rng(5)
    cycle, start = ControlCycle(robot), robot.actuated_coordinates(robot.reference.q[None])[0]
    size, refused = 0.7 * robot.column_scale[robot.actuated], 0
    for _ in range(12):
        target, before = start + size * rng.uniform(-1, 1, robot.n_a), cycle.q.copy()
        try:
            expected = forward_kinematics(robot, target, near=before).q
        except NotAssembled as refusal:
            refused += 1
            with pytest.raises(type(refusal)):
                cycle.update(target, np.zeros(robot.n_a))
            np.testing.assert_array_equal(cycle.q, before)
        else:
            cycle.update(target, np.zeros(robot.n_a))
            np.testing.assert_allclose(cycle.q, expected, rtol=0, atol=1e-9)
    assert refused > 0 or name == "gough_stewart"


def test_a_way_into_a_type_2_singularity_ends_there_and_leads_back():
    """The 5R's cranks towards the pose with both rods in line, in steps of a millisecond."""
    robot = robots.load("five_bar")
    inside, singular = (assemble(robot, [0.0, y]) for y in (0.28, np.sqrt(0.06)))
    start, end = (robot.actuated_coordinates(pose.q[None])[0] for pose in (inside, singular))
    cycle = ControlCycle(robot, near=inside)
    distances = []
    for share in np.arange(0.0, 0.9985, 1e-3):
        cycle.update(start + share * (end - start), end - start)
        distances.append(cycle.type2)
    with pytest.raises(Type2Singularity, match="Type 2"):
        cycle.update(start + 1.001 * (end - start), end - start)
    assert distances[-1] < 0.05 * distances[0]
    assert min(distances) > 0.0
    cycle.update(start, np.zeros(2))
    np.testing.assert_allclose(cycle.q, inside.q, rtol=0, atol=1e-10)


def test_an_exactly_singular_pose_is_at_no_distance_from_type_2():
    cycle = ControlCycle(robots.load("five_bar"))
    cycle._scale = np.zeros_like(cycle._scale)  # which makes P singular to the last bit
    cycle.approach(cycle.x)
    assert cycle.type2 == 0.0


def test_what_cannot_be_is_refused_by_name():
    robot = robots.load("five_bar")
    cycle = ControlCycle(robot)
    for motors in ([0.0], [0.0, np.nan], "no"):
        with pytest.raises(InvalidInput, match="left_motor"):
            cycle.update(motors, [0.0, 0.0])
    with pytest.raises(InvalidInput, match="none of them can move"):
        ControlCycle(robots.load("two_arms"))


@pytest.mark.parametrize("name", ["five_bar", "delta"])
def test_a_smooth_motion_takes_one_linearisation_a_cycle(name, monkeypatch):
    robot = robots.load(name)
    cycle = ControlCycle(robot)
    start = robot.actuated_coordinates(robot.reference.q[None])[0]
    amplitudes = 0.02 * np.array([1.0, -0.7, 0.4])[: robot.n_a]
    poses = []
    evaluate_pose = control_cycle.SinglePose.evaluate_pose
    monkeypatch.setattr(
        control_cycle.SinglePose, "evaluate_pose", lambda self, q: [poses.append(q), evaluate_pose(self, q)]
    )
    counts = []
    for t in 1e-3 * np.arange(1, 60):  # at 1 kHz, up to 0.08 rad/s
        poses.clear()
        cycle.update(start + amplitudes * np.sin(4.0 * t), 4.0 * amplitudes * np.cos(4.0 * t))
        counts.append(len(poses))
    assert set(counts[4:]) == {1}
    exact = forward_kinematics(robot, start + amplitudes * np.sin(4.0 * t))
    np.testing.assert_allclose(cycle.q, exact.q, rtol=0.0, atol=1e-13)
    assert cycle.residual < 1e-14
