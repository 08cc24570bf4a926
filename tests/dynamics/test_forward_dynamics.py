"""From torques to accelerations: the way back from inverse dynamics, through Type 2, and without mass."""

import numpy as np
import pytest

import robots
from framework import InvalidInput, assemble, dynamics_at, forward_dynamics, simulate
from framework.kinematics.inverse_kinematics import close_loops
from framework.simulation import Stepper
from tests.oracles.equations_of_motion import defects
from tests.robots.every_robot import crossing

ROBOT = "five_bar"
QUICK = ("five_bar", "four_bar", "biglide")
NAMES = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in robots.CATALOGUE]


def moving(robot, seed=4):
    """An assembled configuration and joint rates that its loops allow."""
    rng = np.random.default_rng(seed)
    size = robot.platform_scale
    q = assemble(robot, robot.reference.x + 0.02 * size * rng.uniform(-1, 1, robot.n)).q
    return q, dynamics_at(robot, q, dx=size * rng.uniform(-1, 1, robot.n)).v, rng


@pytest.mark.parametrize("name", NAMES)
def test_it_undoes_inverse_dynamics_on_a_plan_and_on_its_crossings(name):
    robot = robots.load(name)
    plan = crossing(robot)
    frame = robot.description.platform.frame
    scale = robot.column_scale
    for t in (0.3 * plan.duration, *(one.time for one in plan.crossings)):
        motion = plan.dynamics.motion(t)
        found = forward_dynamics(robot, motion.q[0], motion.v[0], plan.torque(t))
        size = np.abs(motion.a / scale).max()
        np.testing.assert_allclose(found.a / scale, motion.a[0] / scale, rtol=0, atol=1e-10 * size)
        ddx = robot.platform.twist(
            plan.platform(t)[None], plan.platform(t, 1)[None], plan.platform(t, 2)[None]
        )
        np.testing.assert_allclose(found.platform_acceleration, ddx[1][0], rtol=0, atol=1e-10 * size)
    q, _, rng = moving(robot)
    wrenches = {frame: rng.uniform(-1, 1, 6)}
    dx, ddx = rng.uniform(-1, 1, (2, robot.n))
    back = dynamics_at(robot, q, dx=dx, ddx=ddx, wrenches=wrenches)
    again = forward_dynamics(robot, q, back.v, back.torque, wrenches=wrenches)
    size = np.abs(back.a / scale).max()
    np.testing.assert_allclose(again.a / scale, back.a / scale, rtol=0, atol=1e-10 * size)
    # of bricard's ring only a couple is determinate, and that is zero: the wrenches given are of size 1
    largest = max(1.0, *(np.nanmax(np.abs(force), initial=0.0) for force in back.loop_forces.values()))
    for closure, force in back.loop_forces.items():
        np.testing.assert_allclose(again.loop_forces[closure], force, rtol=0, atol=1e-8 * largest)


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
@pytest.mark.parametrize("name", ["five_bar_heavy", pytest.param("gough_stewart", marks=pytest.mark.slow)])
def test_any_torque_meets_equations_of_motion_written_anew(name, flexibility):
    robot = robots.load(name, flexibility=flexibility)
    q, v, rng = moving(robot)
    found = forward_dynamics(robot, q, v, torque=rng.uniform(-1, 1, robot.n_a))
    left = defects(
        robot, q=q[None], v=v[None], a=found.a[None], torque=found.torque[None], x=assemble(robot).x[None]
    )
    assert max(left.acceleration, left.force) < 1e-11


def test_parts_without_mass_have_no_acceleration_that_torques_of_one_instant_tell():
    """Stretch and twist of the massless legs stand where the springs balance; payload and motors do not."""
    robot = robots.load("five_bar", flexibility="flexible_links")
    torque, twisted = np.array([0.02, -0.01]), assemble(robot).q.copy()
    twisted[robot.elastic] = 1e-5
    state = Stepper.of(robot).start(twisted, torque=torque)
    found = forward_dynamics(robot, state.q, state.v, torque)
    assert np.isnan(found.a[robot.elastic]).all()
    assert np.isfinite(found.a[robot.actuated]).all()
    rotors = robot.gear_ratio * robot.rotor_inertia * found.a[robot.actuated]
    np.testing.assert_allclose(found.joint_torque, robot.gear_ratio * (torque - rotors), atol=1e-12)
    drives = [robot.elastic_names.index(name) for name in ("left_drive", "right_drive")]
    assert np.abs(found.joint_torque).min() > 1e-3
    np.testing.assert_allclose(found.spring_force[drives], found.joint_torque, rtol=1e-9)
    assert np.isfinite(found.platform_acceleration).all()
    off_balance = close_loops(robot, assemble(robot).x[None], twisted[None])
    with pytest.raises(InvalidInput, match=r"has no mass and is .*Stepper.start"):
        forward_dynamics(robot, off_balance.q[0], np.zeros(robot.model.nv), torque)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"v": [1.0, 0.0, 0.0, 0.0]}, "v: the loops of five_bar open with"),
        ({"v": [1.0]}, "v must be 4 finite numbers"),
        ({"torque": [1.0]}, r"torque \(left_motor, right_motor\) must be 2 finite numbers"),
        ({"q": np.zeros(4)}, "the loops of five_bar are open"),
        ({"wrenches": {"tip": [0] * 6}}, "unknown frame 'tip'"),
    ],
)
def test_what_cannot_be(robot, changed, words):
    given = {"q": assemble(robot).q, "v": np.zeros(4), "torque": np.zeros(2)} | changed
    with pytest.raises(InvalidInput, match=words):
        forward_dynamics(robot, given["q"], given["v"], given["torque"], wrenches=given.get("wrenches"))


@pytest.mark.parametrize("method", ["reference", "stiff", "fast"])
@pytest.mark.parametrize("name", ["four_bar", "delta"])
def test_what_a_simulation_returns_is_accepted_from_rest_on(name, method):
    robot = robots.load(name)
    motion = simulate(robot, lambda t: np.zeros(robot.n_a), duration=0.05, method=method)
    torque = np.zeros((len(motion.q), robot.n_a))
    assert np.isfinite(forward_dynamics(robot, motion.q, motion.v, torque).a).all()


def test_a_velocity_that_opens_the_loops_is_refused_by_both():
    robot = robots.load("four_bar")
    v = np.zeros(robot.nv)
    v[0] = 5.0  # the crank alone
    with pytest.raises(InvalidInput, match="start_velocity: the loops of four_bar open with"):
        simulate(robot, lambda t: np.zeros(1), start_velocity=v, duration=0.01)
    with pytest.raises(InvalidInput, match="v: the loops of four_bar open with"):
        forward_dynamics(robot, robot.reference.q, v, np.zeros(1))


def test_on_the_locus_it_is_regular(robot):
    q = assemble(robot, [0.0, np.sqrt(0.06)]).q
    found = forward_dynamics(robot, q, np.zeros(4), [0.1, 0.1])
    assert found.clearance < 1e-7
    # level rods put no upright force on the payload, whatever the motors do
    assert found.platform_acceleration[1] == pytest.approx(0.0, abs=1e-12)


def test_a_stack_is_refused_by_the_row_that_cannot_be(robot):
    q, v = np.repeat(assemble(robot).q[None], 3, axis=0), np.zeros((3, 4))
    opening, open_pose = v.copy(), q.copy()
    opening[1, 0], open_pose[2, 0] = 1.0, 3.0
    with pytest.raises(InvalidInput, match="v, row 1: the loops of five_bar open with"):
        forward_dynamics(robot, q, opening, [0.0, 0.0])
    with pytest.raises(InvalidInput, match="q, row 2: the loops of five_bar are open by"):
        forward_dynamics(robot, open_pose, v, [0.0, 0.0])
    with pytest.raises(InvalidInput, match="v: got 2 rows for 3 configurations"):
        forward_dynamics(robot, q, v[:2], [0.0, 0.0])
    soft = robots.load("five_bar", flexibility="flexible_links")
    level = np.repeat(assemble(soft).q[None], 2, axis=0)
    level[1, soft.elastic] = 1e-5
    level[1] = close_loops(soft, assemble(soft).x[None], level[1:]).q[0]
    torque = np.zeros((2, 2))
    level[0] = Stepper.of(soft).start(level[0], torque=torque[0]).q
    still = np.zeros((2, soft.model.nv))
    with pytest.raises(InvalidInput, match=r"q, row 1: .* has no mass and is"):
        forward_dynamics(soft, level, still, torque)
