"""Laws of motion and of energy, for every robot of the catalogue with every flexibility.

Generated: a robot added to the catalogue is tested here without a line written.
"""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import (
    ParallelRobot,
    UnboundedTorque,
    locate_singularities,
    plan_scene,
    track_path,
    velocity_matrices,
)
from framework.kinematics.closures import closure_drift, loop_equations
from framework.kinematics.frames import frame_motions, frames_at, integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.motion_rates import jacobian_rates, motion_at
from framework.numerics.chebyshev import TimeGrid
from framework.planning.scenes import scene_path
from tests.oracles.equations_of_motion import defects_of
from tests.robots.back_on_path import BACK, misses
from tests.robots.every_robot import (
    ELASTIC,
    KINDS,
    RIGID,
    SCENES,
    STAGED,
    asks_nothing,
    crossing,
    first_path,
    in_stages,
    planned,
)


@pytest.fixture(params=STAGED, scope="module")
def robot(request) -> ParallelRobot:
    name, flexibility = request.param
    return robots.load(name, flexibility=flexibility)


def closed_with_deflections(robot: ParallelRobot, x, q_e, near):
    """Assembled configurations at x (T, n) and deflections q_e (T, n_e), near one configuration."""
    step = np.zeros((len(x), robot.model.nv))
    step[:, robot.elastic] = q_e
    return close_loops(robot, x, integrate(robot, np.repeat(near[None], len(x), axis=0), step))


def test_loop_jacobian_and_drift_are_derivatives_of_the_loop_equations(robot):
    rng = np.random.default_rng(1)
    q = np.repeat(robot.q_near[None], 2, axis=0) + 0.1 * rng.standard_normal((2, robot.model.nq))
    v = rng.standard_normal((2, robot.model.nv))
    at = frames_at(robot, q)
    # errors of first differences are h^2 and eps / h, of second ones h^2 and eps / h^2: a longer step
    h, long = 1e-5, 4e-5

    def differences(values):
        """The first and the second derivative along v, of values at steps of v."""
        far, ahead, here, back, far_back = (values(step) for step in (long, h, 0.0, -h, -long))
        return (ahead - back) / (2 * h), (far - 2 * here + far_back) / long**2

    rate, drift = differences(
        lambda step: loop_equations(robot.rows, frames_at(robot, integrate(robot, q, step * v))).residual
    )
    jacobian = loop_equations(robot.rows, at).jacobian
    np.testing.assert_allclose(np.einsum("tmv,tv->tm", jacobian, v), rate, atol=1e-8)
    np.testing.assert_allclose(closure_drift(robot.rows, frame_motions(robot, at, v), q, v), drift, atol=1e-5)
    # of platform and of loops that suffice everywhere; their combination turns where loops are open
    robot = robot.with_fixed_rows(robot.structure.spanning)
    rate, curvature = differences(
        lambda step: linearised_at(robot, integrate(robot, q, step * v), None).jacobian
    )
    first, second = jacobian_rates(robot, linearised_at(robot, q, None), v)
    np.testing.assert_allclose(first, rate, atol=1e-8)
    np.testing.assert_allclose(second, curvature, atol=1e-5)


@pytest.mark.parametrize("name", robots.CATALOGUE)
def test_the_stated_reference_closes_the_loops(name):
    mechanism = robots.load(name)
    q = mechanism.q_near[None]
    gap = loop_equations(mechanism.rows, frames_at(mechanism, q)).residual
    assert np.abs(gap / np.where(mechanism.rows.rotation, 1.0, mechanism.length)).max() < 1e-3


def test_velocity_matrices_relate_rates_on_the_manifold(robot):
    rng = np.random.default_rng(2)
    branch = track_path(robot, first_path(robot))
    h = 1e-5
    for s in (0.1, 0.5, 0.9):
        x, near = branch.path(s), branch.close(s).q[0]
        q_e = 1e-4 * rng.standard_normal(robot.n_e)
        dx, dq_e = rng.standard_normal(robot.n), rng.standard_normal(robot.n_e)
        dq_e *= robot.column_scale[robot.elastic]  # metres in lengths of the robot, however small it is
        steps = np.array([[0.0], [h], [-h]])
        q = closed_with_deflections(robot, x + steps * dx, q_e + steps * dq_e, near).q
        dq_a = ((q[1] - q[2]) / (2 * h))[robot.actuated]
        A, B, C = velocity_matrices(robot, q[0])
        v = robot.platform.twist(x[None], dx[None])[0][0]
        # differences are good to h^2 (curvature of order 10 to 100) and eps / h
        np.testing.assert_allclose(A @ v, B @ dq_a + C @ dq_e, atol=1e-7)


def test_velocities_and_accelerations_are_time_derivatives_of_positions(robot):
    branch = track_path(robot, first_path(robot))
    grid = TimeGrid(np.array([0.0, 1.0]), 48)
    t = grid.times[:, None]
    s = 0.05 + 0.1 * t + 0.1 * t**2
    x = branch.path(s[:, 0])
    slope, curve = branch.path(s[:, 0], 1), branch.path(s[:, 0], 2)
    ds, dds = 0.1 + 0.2 * t, 0.2
    phase = np.arange(robot.n_e)
    q_e, dq_e, ddq_e = (1e-3 * np.sin(t + phase + k * np.pi / 2) * np.ones(robot.n_e) for k in range(3))
    closed = closed_with_deflections(robot, x, q_e, branch.close(0.1).q[0])
    motion = motion_at(robot, closed, slope * ds, curve * ds**2 + slope * dds, dq_e, ddq_e)
    _, v, a = grid.values(grid.fit(closed.q - closed.q[0]))
    # joints are known as loops are closed, the worse the shorter the levers; differentiation adds up the
    # errors of all nodes, twice amplifies them by about size^4 / 10
    levers = np.linalg.pinv(closed.jacobian[:, :, robot.moving])
    error = np.abs(closed.residual).max() + np.finfo(float).eps  # and that of looking at it
    known = error * np.abs(levers).sum(axis=2).max()
    most = np.abs(grid.values(grid.fit(np.eye(48)))[1]).sum(axis=1).max()
    np.testing.assert_allclose(motion.v, v, atol=known * most)
    np.testing.assert_allclose(motion.a, a, atol=1e-7)


@pytest.mark.parametrize(("name", "scene"), SCENES, ids=["-".join(case) for case in SCENES])
def test_null_vector_of_A_is_the_twist_of_the_passive_columns(name, scene):
    robot = robots.load(name)
    for point in locate_singularities(robot, scene_path(robot.description.scenes[scene])):
        A, B, _ = velocity_matrices(robot, point.q)
        values, right = np.linalg.svd(A)[1:]
        null = right[-1] / np.linalg.norm(right[-1])
        null *= np.sign(null @ point.twist)
        assert values[-1] < 1e-12 * max(values[0], np.abs(B).max())  # A is a number when n = 1
        np.testing.assert_allclose(null, point.twist / np.linalg.norm(point.twist), atol=1e-12)
        moved = robot.platform.jacobian(frames_at(robot, point.q[None]))[0] @ point.motion
        np.testing.assert_allclose(moved, point.twist, atol=1e-12)
        assert np.abs(point.motion[robot.actuated]).max() == 0.0


SOFT = [(name, "flexible_links") for name in ("five_bar", "biglide", "delta", "gough_stewart")]


@pytest.mark.parametrize("case", in_stages(ELASTIC, at_once=lambda case: case in SOFT))
def test_stiff_springs_tend_to_the_rigid_robot_as_one_over_stiffness(case):
    name, flexibility = case
    description = robots.load(name).description
    rigid = planned(robots.load(name), smoothness=4)
    t = np.linspace(0.0, rigid.duration, 301)
    differences = []
    for factor in (1.0, 1e3, 1e6):
        springs = tuple(
            replace(spring, stiffness=tuple(factor * k for k in spring.stiffness))
            for spring in description.springs
        )
        stiff = ParallelRobot.from_description(replace(description, springs=springs), flexibility=flexibility)
        differences.append(np.abs(planned(stiff).torque(t) - rigid.torque(t)).max())
    soft, stiff, stiffer = differences
    # behind a motor without inertia a spring changes no torque at all, and all that differs is rounding
    rounding = 1e-12 * np.abs(rigid.torque(t)).max()
    assert soft < 0.5 * np.abs(rigid.torque(t)).max()
    assert stiff == pytest.approx(soft / 1e3, rel=0.05, abs=rounding)  # second order in 1/k is of this size
    assert stiffer == pytest.approx(stiff / 1e3, rel=1e-3, abs=rounding)


# planned torques, integrated forward, bring every robot along its path: for every scene with a law


LAWFUL = [(name, scene) for name, scene in SCENES if not asks_nothing(RIGID[name].description.scenes[scene])]
FIRST = list({name: (name, scene) for name, scene in reversed(LAWFUL)}.values())  # scene of each robot
UNPREPARED = [case for case in SCENES if case not in LAWFUL]
# Rods with mass hang between a drive's spring and their own: each spring on the way to the motor needs two
# more derivatives of s to start from rest. With 4 the springs would be set ringing, by 1e-6 m at most.
SMOOTHNESS = {"flexible_joints": 4, "flexible_links": 8}


@pytest.mark.parametrize("case", in_stages(LAWFUL, at_once=lambda case: case in FIRST and case[0] in KINDS))
def test_planned_torques_bring_a_rigid_robot_along_the_path(case):
    name, scene = case
    robot = RIGID[name]
    off = misses(robot, plan_scene(robot, scene), rtol=1e-11)
    print(f"{name}, {scene}: back on the path within {np.abs(off).max():.1e} m, rad")
    assert np.abs(off).max() < BACK  # measured: 7e-11 at most


@pytest.mark.parametrize("case", in_stages(ELASTIC, at_once=lambda case: False))
def test_planned_torques_bring_an_elastic_robot_along_the_path(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    plan = crossing(robot, smoothness=SMOOTHNESS[flexibility], times=None, speeds=None)
    off = misses(robot, plan, rtol=1e-8)
    print(f"{name}, {flexibility}: back on the path within {np.abs(off).max():.1e} m, rad")
    assert np.abs(off).max() < BACK


@pytest.mark.parametrize("case", in_stages(UNPREPARED, at_once=lambda case: True))
def test_a_scene_that_asks_for_no_condition_where_it_meets_a_singularity_has_no_torques(case):
    name, scene = case
    robot = RIGID[name]
    assert locate_singularities(robot, scene_path(robot.description.scenes[scene]))
    with pytest.raises(UnboundedTorque):
        plan_scene(robot, scene)


# planned motions obey the equations of motion as the tests write them


# [N m], on the motor side, of rigid robots' first crossings
PEAK_TORQUE = {"delta": 10.0, "gough_stewart": 500.0, "orthoglide": 0.5, "par4": 2.0, "spherical_rrr": 0.5}


@pytest.mark.parametrize("case", STAGED)
def test_a_plan_obeys_the_equations_of_motion_written_anew(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    plan = crossing(robot)
    assert plan.certificate.tail < 1e-9
    speed = plan.law(plan.duration * np.linspace(0.0, 1.0, 2001)[1:-1], 1)
    assert plan.certificate.monotone == (speed.min() > 0.0)
    assert all(point.residual < 1e-12 for point in plan.crossings)
    if flexibility == "rigid" and name in PEAK_TORQUE:
        assert plan.certificate.monotone
        assert max(plan.peak_torque.values()) < PEAK_TORQUE[name]
    found = defects_of(plan)
    size = max(robot.length, 1.0)
    assert found.open < 1e-12 * size  # measured: 1e-14 at most
    assert found.platform < 1e-12 * size
    # derivatives of Chebyshev series lose three digits a time or more; measured: 1e-11, 2e-8, 3e-8 at most
    assert found.speed < 1e-9
    assert found.acceleration < 1e-6
    assert found.force < 1e-6
