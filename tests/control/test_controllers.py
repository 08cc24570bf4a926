"""Controllers: laws that hold for each of them, and the witnesses of the dynamics that they use."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import solve_discrete_are

import robots
from framework import InvalidInput, plan_scene
from framework.control import CONTROLLERS, Measurement, reference_of, tuned_controller
from framework.control.closed_loop import _VariedRobots
from framework.control.controllers import (
    ComputedTorque,
    RobotState,
    estimate_state,
    fading_thresholds,
    solve_damped,
)
from framework.control.linear_model import linearise_plan
from framework.control.regulators import solve_riccati
from framework.control.sensors import ControlLoop
from framework.control.variations import Spread, draw
from framework.dynamics.forward_dynamics import forward_derivatives
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.linearised_loops import scaled_loops
from framework.simulation.drive import WorldForces

PERIOD = 1.7e-3  # no sample on the singular instant, 1 s: the naive law has a value at each
ROBOTS = [("five_bar", "C"), ("five_bar_heavy", "C"), ("three_rrr", "crossing"), ("gough_stewart", "tilt")]


@cache
def reference(name, scene, period=PERIOD):
    return reference_of(plan_scene(robots.load(name), scene), period=period)


def test_dry_friction_is_smoothed_below_some_per_cent_of_a_motors_largest_speed():
    ref = reference("five_bar", "C")
    shares = ref.friction_speed / np.abs(ref.motor_speed).max(axis=0)
    assert np.all((shares > 0.001) & (shares < 0.1))


def test_in_a_period_a_wrench_is_that_of_its_middle():
    """A force in proportion to s, and a constant one of the size that the first has in the middle."""
    ref = reference("five_bar", "C")
    robot, force = ref.robot, np.array([5.0, -3.0, 0.0, 0.0, 0.0, 0.0])
    varied = _VariedRobots.of(ref, ControlLoop(), Spread(), [draw(robot, Spread(), (0, 0))])
    k = int(0.3 * len(ref.times))
    state = (ref.motion.q[[k]], ref.motion.v[[k]], ref.torque[[k]])
    growing = ExternalWrenches.of({"left_tip": [np.zeros(7), [1.0, *force]]})
    constant = ExternalWrenches.of({"left_tip": ref.law(ref.times[k] + 0.5 * PERIOD) * force})
    q, v = varied._replace(world=WorldForces.of(robot, growing, ref.law)).step(k, *state)
    expected = varied._replace(world=WorldForces.of(robot, constant, None)).step(k, *state)
    change = np.abs(expected.v - varied.step(k, *state).v).max()  # by the force
    np.testing.assert_allclose(v, expected.v, rtol=0, atol=1e-9 * change)
    np.testing.assert_allclose(q, expected.q, rtol=0, atol=1e-9 * change * PERIOD)


def on_the_plan(ref, k, sensors="joints"):
    state = RobotState(ref.motion.q[k][None], ref.motion.v[k][None], ref.x[k][None], ref.dx[k][None])
    readings = np.zeros((1, len(ref.robot.actuated)))  # of lqg, which has encoders on the motors here
    return Measurement(
        ref.motor_angle[k][None], ref.motor_speed[k][None], state if sensors == "joints" else None, readings
    )


@pytest.mark.parametrize("sensors", ["joints", "motors"])
@pytest.mark.parametrize("name", CONTROLLERS)
def test_on_the_plan_a_controller_asks_for_the_planned_torque(name, sensors):
    ref = reference("five_bar_heavy", "C")
    controller = tuned_controller(name, ref)
    held = name in ("feedforward", "lqr", "lqg")
    for k in range(0, len(ref.times), 291):
        planned = ref.period_torque[k] if held else ref.torque[k]
        asked = controller.torque(k, on_the_plan(ref, k, sensors))
        np.testing.assert_allclose(asked[0], planned, atol=1e-9)  # N m; the naive law loses digits near 1 s


@pytest.mark.parametrize(("name", "scene"), ROBOTS)
def test_the_planned_torque_gives_the_planned_acceleration(name, scene):
    """Forward dynamics, with tau from A and lambda: two routes, one of them regular at Type 2."""
    ref = reference(name, scene, period=plan_scene(robots.load(name), scene).duration / 300)
    model = forward_derivatives(ref.robot, ref.motion.q, ref.motion.v, ref.torque)
    scale = np.abs(ref.ddx).max()
    np.testing.assert_allclose(model.acceleration, ref.ddx, atol=1e-8 * scale)


def test_the_lqr_takes_wrenches_on_axes_of_a_tool_for_what_turns_with_it():
    """Which changes its A; how wrenches turn is compared with differences in test_dynamics_derivatives."""
    robot = robots.load("five_bar_heavy")
    rows = [[0.0, *6 * [0.0]], [0.5, 2.0, -1.0, 0.0, 0.0, 0.0, 0.02], [1.0, *6 * [0.0]]]
    wrenches = {"left_tip": {"wrench": rows, "axes": "tool"}}
    ref = reference_of(plan_scene(robot, "C", wrenches=wrenches), period=PERIOD)
    s, poses = np.asarray(ref.law(ref.times)), ref.motion.linearised.frames
    planned = ref.wrenches.evaluate_on_base_axes(robot, poses, s)
    A = linearise_plan(ref).A[:, robot.n :, : robot.n]
    turning, still = (
        forward_derivatives(
            *(robot, ref.motion.q, ref.motion.v, ref.torque), wrenches=planned, turning=frames
        ).acceleration_y
        for frames in (["left_tip"], [])
    )
    np.testing.assert_allclose(A, turning, atol=1e-9 * np.abs(A).max())
    assert np.abs(A - still).max() > 1e-3 * np.abs(A).max()


def test_with_constant_dynamics_the_riccati_gains_are_those_of_the_algebraic_equation():
    h = 0.01
    A, B = np.array([[0.0, 1.0], [3.0, -0.1]]), np.array([[0.0], [2.0]])
    Q, R = np.diag([5.0, 1.0]), np.array([[0.3]])
    # torques held: the exact discrete system by its power series
    joined = h * np.block([[A, B], [np.zeros((1, 3))]])
    series, term = np.eye(3), np.eye(3)
    for k in range(1, 20):
        term = term @ joined / k
        series = series + term
    F, G = series[:2, :2], series[:2, 2:]
    gain = solve_riccati(np.tile(F, (2000, 1, 1)), np.tile(G, (2000, 1, 1)), Q, R)
    P = solve_discrete_are(F, G, Q, R)
    np.testing.assert_allclose(gain[0], np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F), rtol=1e-9)


def test_motor_encoders_tell_the_platform_to_second_order():
    ref = reference("five_bar", "C")
    k = 100  # far from the crossing
    for size in (1e-3, 1e-4):
        dx = size * np.array([0.6, -0.8])
        closed = platform_state(ref, k, dx)
        for aware in (True, False):
            found = estimate_state(ref, k, closed, aware=aware)
            assert np.abs(found.x[0] - ref.x[k] - dx).max() < 20 * size**2


def platform_state(ref, k, dx):
    """What the motor encoders say with the platform dx beside the plan."""
    from framework.kinematics.inverse_kinematics import close_loops

    q = close_loops(ref.robot, ref.x[k][None] + dx, ref.motion.q[k][None]).q
    angle = ref.robot.gear_ratio * q[:, ref.robot.actuated]
    return Measurement(angle, ref.motor_speed[k][None], None)


def test_beside_the_crossing_the_naive_conclusion_is_noise_over_nothing():
    """2e-5 rad on the encoders, two samples beside the singular instant: millimetres, or not."""
    ref = reference("five_bar", "C")
    k = int(np.argmin(np.abs(ref.times - 1.0)))
    noisy = Measurement(
        ref.motor_angle[k][None] + 50 * 2e-5 * np.array([1.0, -1.0]), ref.motor_speed[k][None], None
    )
    naive = estimate_state(ref, k, noisy, aware=False)
    aware = estimate_state(ref, k, noisy, aware=True)
    assert np.abs(naive.x[0] - ref.x[k]).max() > 1e-3  # m
    assert np.abs(aware.x[0] - ref.x[k]).max() < 5e-5


def test_the_consistent_solution_is_the_solution_where_there_is_one():
    random = np.random.default_rng(5)
    regular, right = np.eye(4) + 0.1 * random.standard_normal((3, 4, 4)), random.standard_normal((3, 4))
    np.testing.assert_allclose(
        solve_damped(regular, right, np.full(4, 0.1)),
        np.linalg.solve(regular, right[..., None])[..., 0],
        atol=1e-12,
    )
    u, _, v = np.linalg.svd(random.standard_normal((4, 4)))
    singular = u @ np.diag([3.0, 2.0, 1.0, 0.0]) @ v
    found = solve_damped(singular[None], right[:1], np.full(4, 0.1))[0]
    np.testing.assert_allclose(found, np.linalg.pinv(singular) @ right[0], atol=1e-12)


def test_a_run_without_numbers_has_no_consistent_solution_and_leaves_the_others_theirs():
    matrices, right = np.tile(np.eye(2), (3, 1, 1)), np.ones((3, 2))
    matrices[1, 0, 0] = np.nan
    np.testing.assert_array_equal(
        solve_damped(matrices, right, np.full(2, 0.1)), [[1, 1], [np.nan, np.nan], [1, 1]]
    )


def test_what_is_small_in_every_pose_is_no_singularity():
    """Singular values 1 and 1e-3 along a plan; one decimal of the lesser beside a singularity is damped."""
    plan = np.array([[[1.0, 0.0], [0.0, least]] for least in (1e-3, 9e-4, 8e-4)])
    thresholds = fading_thresholds(plan)
    np.testing.assert_allclose(
        solve_damped(plan, np.ones(2), thresholds), [[1, 1e3], [1, 1 / 9e-4], [1, 1 / 8e-4]]
    )
    beside = np.diag([1.0, 1e-4])
    assert solve_damped(beside[None], np.ones(2), thresholds)[0, 1] < 2e3  # of 1e4


@pytest.mark.parametrize(
    ("name", "scene", "shares", "off"),
    [
        # the least singular values of the delta's platform are a hundredth of the largest in every pose
        ("delta", "pick", (0.0, 0.5, 1.0), (1e-3, -2e-3, 1e-3)),
        ("five_bar", "C", (0.06, 0.23, 0.96), (1e-4, 2e-4)),  # far from the crossing
    ],
)
def test_the_aware_law_is_the_naive_one_where_nothing_is_singular(name, scene, shares, off):
    ref = reference(name, scene)
    aware, naive = (ComputedTorque.tune(ref, aware=choice) for choice in (True, False))
    for share in shares:
        k = int(share * (len(ref.times) - 1))
        seen = platform_state(ref, k, np.array(off))
        np.testing.assert_allclose(aware.torque(k, seen), naive.torque(k, seen), rtol=1e-9)


@pytest.mark.parametrize("name", ["lqr", "computed_torque", "naive_computed_torque"])
def test_what_is_for_rigid_robots_says_so(name):
    plan = plan_scene(robots.load("five_bar_heavy", flexibility="flexible_joints"), "C")
    with pytest.raises(InvalidInput, match="rigid robots"):
        tuned_controller(name, reference_of(plan, period=1e-2))


def test_an_unknown_controller_lists_the_known():
    with pytest.raises(InvalidInput, match="feedforward"):
        tuned_controller("feedforwards", reference("five_bar", "C"))


@pytest.mark.parametrize("period", [0.0, -1e-3, np.nan, 1.0, 1e-9])
def test_a_period_that_cannot_be_is_refused(period):
    with pytest.raises(InvalidInput, match="period"):
        reference_of(plan_scene(robots.load("five_bar"), "C"), period=period)


@pytest.mark.parametrize(("name", "scene"), [("five_bar_heavy", "C"), ("gough_stewart", "tilt")])
def test_planned_multipliers_carry_what_the_motors_do_not(name, scene):
    """J' lambda = r - S' tau with the tree's forces r by pinocchio, also along screws."""
    ref = reference(name, scene, period=plan_scene(robots.load(name), scene).duration / 20)
    robot, motion = ref.robot, ref.motion
    data = robot.model.createData()
    rows = zip(motion.q, motion.v, motion.a, strict=True)
    forces = np.array([pin.rnea(robot.model, data, *row) for row in rows]) + robot.joint_damping * motion.v
    of_rotors = robot.rotor_inertia * robot.gear_ratio * motion.a[:, robot.actuated]
    forces[:, robot.actuated] -= robot.gear_ratio * (ref.torque - of_rotors)
    scaled = scaled_loops(robot, motion.linearised)
    carried = np.vecmat(ComputedTorque.tune(ref, aware=True).multipliers, scaled) / robot.column_scale
    np.testing.assert_allclose(carried, forces, atol=1e-8 * np.abs(forces).max())
