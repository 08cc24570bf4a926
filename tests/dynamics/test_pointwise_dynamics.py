"""One instant: every body in balance by Newton and Euler, power, inertia, and what cannot be told."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, ParallelRobot, SingularPose, assemble, dynamics_at, plan_scene
from framework.model.description import Actuator, Platform
from framework.numerics.chebyshev import TimeGrid
from tests.robots.cut_elsewhere import cut_elsewhere
from tests.robots.transformed import in_other_units

ROBOT = "five_bar"


def scene_of(robot):
    scenes = robot.description.scenes
    return next(name for name, scene in scenes.items() if scene.times != ())


@pytest.fixture(scope="module", params=["five_bar_heavy", "gough_stewart", "delta", "three_rrr"])
def moving(request):
    """A robot on its way, well before its crossing: the plan, the time, what `dynamics_at` says."""
    robot = robots.load(request.param)
    plan = plan_scene(robot, scene_of(robot))
    time = 0.3 * plan.duration
    q = plan.dynamics.motion(time).q[0]
    return plan, time, dynamics_at(robot, q, dx=plan.platform(time, 1), ddx=plan.platform(time, 2))


def momenta(robot, q, v):
    """Linear momentum and angular momentum about the base's origin of each body, (joints, 6)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, v)
    found = []
    for j in range(1, robot.model.njoints):
        body, placed = robot.model.inertias[j], data.oMi[j]
        turning = placed.rotation @ data.v[j].angular
        speed = placed.rotation @ (data.v[j].linear + np.cross(data.v[j].angular, body.lever))
        centre = placed.act(body.lever)
        spin = placed.rotation @ body.inertia @ placed.rotation.T @ turning
        found.append(np.concatenate([body.mass * speed, spin + np.cross(centre, body.mass * speed)]))
    return np.array(found)


def about_base(wrench, at):
    return np.concatenate([wrench[:3], wrench[3:] + np.cross(at, wrench[:3])])


def test_every_body_is_in_balance(moving):
    plan, time, found = moving
    robot, model = plan.robot, plan.robot.model
    h = 1e-3 * plan.duration
    stencil = {-2: 1.0, -1: -8.0, 1: 8.0, 2: -1.0}
    rates = np.zeros((model.njoints - 1, 6))
    for k, weight in stencil.items():
        motion = plan.dynamics.motion(time + k * h)
        rates += weight / (12 * h) * momenta(robot, motion.q[0], motion.v[0])
    data = model.createData()
    pin.framesForwardKinematics(model, data, found.q)
    loads = np.zeros((model.njoints, 6))
    for j in range(1, model.njoints):
        weight = model.inertias[j].mass * model.gravity.linear
        loads[j] += about_base(np.r_[weight, 0, 0, 0], data.oMi[j].act(model.inertias[j].lever))
        reaction = about_base(found.reactions[model.names[j]], data.oMi[j].translation)
        loads[j] += reaction
        loads[model.parents[j]] -= reaction
    for closure in robot.description.closures:
        first, second = (model.getFrameId(name) for name in closure.frames)
        force = about_base(found.loop_forces[closure.name], data.oMf[first].translation)
        loads[model.frames[first].parentJoint] += force
        loads[model.frames[second].parentJoint] -= force
    known = ~np.isnan(loads[1:])
    assert known.mean() > 0.3  # planar and overconstrained robots leave some open
    scale = np.nanmax(np.abs(loads))
    np.testing.assert_allclose(loads[1:][known], rates[known], rtol=0, atol=1e-8 * scale)


def test_a_joint_passes_on_along_its_axis_what_its_motor_gives_and_nothing_else(moving):
    plan, _, found = moving
    robot, model = plan.robot, plan.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, found.q, found.v)
    scale = max(np.nanmax(np.abs(w)) for w in found.reactions.values())
    for j in range(1, model.njoints):
        axis = pin.SE3(data.oMi[j].rotation, np.zeros(3)).act(pin.Motion(np.ravel(data.joints[j].S))).vector
        given = np.nansum(axis * found.reactions[model.names[j]])
        column = model.joints[j].idx_v
        motor = np.flatnonzero(robot.actuated == column)
        expected = found.joint_torque[motor[0]] if len(motor) else 0.0
        np.testing.assert_allclose(given, expected, rtol=0, atol=1e-9 * scale)


def test_what_the_motors_give_is_what_platform_and_energy_take(moving):
    """Against the energy's Chebyshev series about the instant, with a wrench of the world on the platform."""
    plan, time, found = moving
    robot, model = plan.robot, plan.robot.model
    frame = robot.description.platform.frame
    pushed = np.array([3.0, -1.0, 2.0, 0.5, -0.2, 0.4])
    loaded = dynamics_at(
        robot, found.q, dx=plan.platform(time, 1), ddx=plan.platform(time, 2), wrenches={frame: pushed}
    )
    data = model.createData()
    pin.forwardKinematics(model, data, found.q, found.v)
    here = pin.getFrameVelocity(model, data, model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED).vector
    half = 0.1 * plan.duration
    grid = TimeGrid(np.array([time - half, time + half]), 32)
    motion = plan.dynamics.motion(grid.times)
    energies = []
    for q, v in zip(motion.q, motion.v, strict=True):
        kinetic = pin.computeKineticEnergy(model, data, q, v)
        rotors = 0.5 * robot.rotor_inertia @ (robot.gear_ratio * v[robot.actuated]) ** 2
        energies.append(kinetic + rotors + pin.computePotentialEnergy(model, data, q))
    gained = float(grid.fit(np.array(energies)[:, None] - energies[0])(time, 1)[0])
    powers = loaded.torque * robot.gear_ratio * found.v[robot.actuated]
    size = np.abs([*powers, pushed @ here, gained]).sum()
    assert powers.sum() == pytest.approx(gained - pushed @ here, rel=0, abs=1e-12 * size)


def test_inertia_is_what_kinetic_energy_says(moving):
    plan, _, found = moving
    robot = plan.robot
    data = robot.model.createData()
    kinetic = pin.computeKineticEnergy(robot.model, data, found.q, found.v)
    kinetic += 0.5 * robot.rotor_inertia @ (robot.gear_ratio * found.v[robot.actuated]) ** 2
    motors = found.v[robot.actuated]
    assert 0.5 * motors @ found.motor_inertia @ motors == pytest.approx(kinetic, rel=1e-9)


def test_what_a_planar_robot_leaves_open_is_named_and_not_made_up(robot):
    """The legs of the 5R share the payload's weight in a way that no rigid robot tells."""
    found = dynamics_at(robot, assemble(robot).q)
    assert np.isnan(found.loop_forces["tip"][2])
    assert "tip: force z" in found.indeterminate
    assert not np.isnan(found.loop_forces["tip"][:2]).any()
    small = ParallelRobot.from_description(in_other_units(robot.description, length=1e-6))
    other = dynamics_at(small, small.reference.q)
    assert set(other.indeterminate) == set(dynamics_at(robot, robot.reference.q).indeterminate)


def test_at_the_singularity_there_is_no_torque_of_an_instant(robot):
    singular = assemble(robot, [0.0, np.sqrt(0.06)]).q
    with pytest.raises(SingularPose, match=r"Type 2.*plan"):
        dynamics_at(robot, singular)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"dx": [1.0]}, "dx must be 2 finite numbers"),
        ({"ddx": [np.nan, 0.0]}, "ddx must be 2 finite numbers"),
        ({"wrenches": {"left_tipp": [0] * 6}}, "unknown frame 'left_tipp'; did you mean 'left_tip'"),
        ({"wrenches": {"left_tip": [0] * 3}}, "wrenches: left_tip must be 6 finite numbers"),
    ],
)
def test_what_cannot_be(robot, arguments, words):
    with pytest.raises(InvalidInput, match=words):
        dynamics_at(robot, assemble(robot).q, **arguments)


def test_rows_of_a_stack_that_are_no_numbers_are_named(robot):
    q = np.tile(assemble(robot).q, (2000, 1))
    q[5], q[77, 1] = np.nan, np.inf
    with pytest.raises(InvalidInput, match=r"2 of 2000 rows are not, \[5, 77\]") as refused:
        dynamics_at(robot, q)
    assert len(str(refused.value)) < 200


def test_what_was_given_stays_the_givers_own(robot):
    """A stack may be filled anew for the next call: what was found does not change with it."""
    q = np.array([assemble(robot, [0.01 * k, 0.3]).q for k in range(3)])
    found, as_given = dynamics_at(robot, q), q.copy()
    q[:] = 0.0
    np.testing.assert_array_equal(found.q, as_given)
    expected = dynamics_at(robot, as_given).reactions["left_elbow"]
    np.testing.assert_array_equal(found.reactions["left_elbow"], expected)


def test_A_B_and_C_change_as_their_rates_say(moving):
    """B^-1 A and B^-1 C, which no choice of rows changes, differenced along the plan."""
    plan, time, _ = moving
    robot, h = plan.robot, 1e-3 * plan.duration

    def at(t):
        here = plan.dynamics.motion(t)
        return dynamics_at(robot, here.q[0], dx=plan.platform(t, 1), ddx=plan.platform(t, 2))

    def quotient(found):
        A, B, C = found.velocity_matrices
        return np.linalg.solve(B, np.concatenate([A, C], axis=1))

    before, near, beyond, far = (quotient(at(time + k * h)) for k in (-1, 1, 2, -2))
    slope = (far - 8 * before + 8 * near - beyond) / (12 * h)
    (A, B, C), (dA, dB, dC) = at(time).velocity_matrices, at(time).velocity_matrix_rates
    rates = np.concatenate([dA, dC], axis=1) - dB @ np.linalg.solve(B, np.concatenate([A, C], axis=1))
    scale = max(np.abs(slope).max(), np.abs(np.linalg.solve(B, rates)).max())
    np.testing.assert_allclose(np.linalg.solve(B, rates), slope, rtol=0, atol=1e-8 * scale)


def test_a_loop_that_slides_carries_what_a_slide_carries():
    """The wrench in the slide of a slider-crank, as a joint of the tree and as a closure, at one place."""
    description = robots.load("slider_crank").description
    crank = replace(
        description, platform=Platform("slider", ("x",)), actuators=(Actuator("crank_bearing"),), springs=()
    )
    (pin_joint,) = crank.closures
    tree = ParallelRobot.from_description(crank)
    loop = ParallelRobot.from_description(cut_elsewhere(crank, pin_joint, "slide"))
    x = tree.reference.x + 0.01
    one, other = (dynamics_at(r, assemble(r, x).q, dx=[0.3], ddx=[2.0]) for r in (tree, loop))
    on_slider, on_rail = one.reactions["slide"], other.loop_forces["slide_opened"]
    slide = tree.reference.q[2] + 0.01  # [m] from the rail's frame to the slider's
    assert on_rail[1] == pytest.approx(-on_slider[1], rel=1e-9)
    assert on_rail[5] == pytest.approx(-(on_slider[5] + slide * on_slider[1]), rel=1e-9)
