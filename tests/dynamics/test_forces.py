"""Generalised forces by power and by virtual work, which know nothing of how they were computed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot, assemble, locate_singularities
from framework.dynamics.forces import joint_forces, motor_torque, tree_forces
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.motion_rates import Motion, motion_at
from framework.model.description import JointDynamics
from framework.planning.scenes import scene_path
from tests.oracles.closure_rows import closure_rows
from tests.oracles.forward_simulation import kinematics
from tests.robots.every_robot import CASES, RIGID, in_stages

FEW = ("five_bar", "delta", "standing_quadruped", "two_arms", "three_upu")


def at_once(case) -> bool:
    return case[0] in FEW


def moving(robot, q, seed: int) -> Motion:
    """Any rates and accelerations at an assembled configuration; the loops need not allow them."""
    rng = np.random.default_rng(seed)
    v, a = rng.standard_normal((2, 1, robot.model.nv)) * robot.column_scale
    closed = assembled_at(robot, q)
    return Motion(closed.q, v, a, closed)


def allowed_motions(robot, q):
    """A basis (nv, d) of what the closures allow, springs moving too, by rows written anew."""
    model, data = robot.model, robot.model.createData()
    kinematics(model, data, q, np.zeros(model.nv))
    scale = robot.column_scale
    rows = closure_rows(model, data, robot.description.closures).jacobian * scale
    values, right = np.linalg.svd(rows)[1:]
    rank = int(np.sum(values > 1e-9 * values.max(initial=0.0)))
    return scale[:, None] * right[rank:].T


@pytest.mark.parametrize("case", in_stages(CASES, at_once=at_once))
def test_the_power_of_the_tree_s_forces_is_what_damping_takes_and_the_rate_of_its_energy(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    model, data = robot.model, robot.model.createData()
    motion = moving(robot, assemble(robot).q, 1)
    (q,), (v,), (a,) = motion.q, motion.v, motion.a

    def energy(t):
        here = pin.integrate(model, q, t * v + 0.5 * t**2 * a)
        rate = v + t * a
        turned = pin.difference(model, pin.neutral(model), here) - robot.joint_rest
        held = 0.5 * np.sum(robot.joint_stiffness * turned**2)
        return (
            pin.computeKineticEnergy(model, data, here, rate)
            + pin.computePotentialEnergy(model, data, here)
            + held
        )

    h = 1e-4
    rate = (energy(h) - energy(-h)) / (2 * h)
    power = float(tree_forces(robot, motion)[0] @ v - robot.joint_damping @ v**2)
    assert power == pytest.approx(rate, rel=1e-5, abs=1e-6 * abs(energy(0.0)))


@pytest.mark.parametrize("case", in_stages(CASES, at_once=at_once))
def test_motors_and_springs_do_all_the_work_on_what_the_loops_allow(case):
    """d'Alembert: for each motion that the loops allow, motors and springs balance the tree's forces."""
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    q = assemble(robot).q
    motion = moving(robot, q, 2)
    r = tree_forces(robot, motion)[0]
    found = joint_forces(robot, motion)
    given = np.zeros(robot.model.nv)
    given[robot.actuated] = found.joint_torque[0]
    given[robot.elastic] = found.spring_force[0]
    N = allowed_motions(robot, q)
    size = np.abs(N * r[:, None]).sum() + np.abs(N * given[:, None]).sum()
    np.testing.assert_allclose(N.T @ (r - given), 0.0, atol=1e-10 * size)


def test_a_spring_on_a_joint_adds_its_own_torque():
    plain = robots.load("five_bar")
    spring = JointDynamics(stiffness=3.0, rest=0.25)
    sprung = ParallelRobot.from_description(replace(plain.description, joints={"left_elbow": spring}))
    q = assemble(plain).q
    column = [plain.coordinates.name_of(k) for k in range(plain.model.nv)].index("left_elbow")
    expected = np.zeros(plain.model.nv)
    expected[column] = 3.0 * (q[column] - 0.25)
    forces = [tree_forces(robot, moving(robot, q, 3))[0] for robot in (plain, sprung)]
    np.testing.assert_allclose(forces[1] - forces[0], expected, atol=1e-12)


def test_redundant_motors_share_the_load_with_the_least_squares_of_their_torques():
    """On the motor side: no other torques that balance the same forces have a smaller sum of squares."""
    robot = RIGID["standing_quadruped"]
    q = assemble(robot).q
    motion = moving(robot, q, 4)
    geared = joint_forces(robot, motion).joint_torque[0] / robot.gear_ratio
    # motors balance one another if they do no work on any allowed motion
    work = allowed_motions(robot, q)[robot.actuated].T * robot.gear_ratio
    values, right = np.linalg.svd(work)[1:]
    inner = right[int(np.sum(values > 1e-9 * values[0])) :]
    assert len(inner) == robot.n_a - robot.n
    np.testing.assert_allclose(inner @ geared, 0.0, atol=1e-9 * np.abs(geared).max())


def test_on_a_type_2_singularity_nothing_balances():
    """Unless t_s . W_p vanishes no torque does: it is told as infinite or as huge, never as one to use."""
    robot = RIGID["five_bar"]
    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["C"]))
    motion = moving(robot, point.q, 5)
    asked = tree_forces(robot, motion)[0] @ point.motion
    assert abs(asked) > 0.1  # the robot weighs 10 kg and moves with rates of order one
    torque = joint_forces(robot, motion).joint_torque
    assert not np.abs(torque).max() < 1e9


def test_the_motor_turns_its_rotor_and_what_the_gear_leaves_of_the_joint():
    """By power: motor torque times motor speed is joint power plus the rate of the rotors' energy."""
    robot = RIGID["five_bar"]
    motion = moving(robot, assemble(robot).q, 6)
    joint = np.array([[0.7, -1.3]])
    speed, growth = (robot.gear_ratio * part[0, robot.actuated] for part in (motion.v, motion.a))
    rotors = np.sum(robot.rotor_inertia * speed * growth)
    power = motor_torque(robot, motion, joint)[0] @ speed
    assert power == pytest.approx(rotors + joint[0] @ motion.v[0, robot.actuated], rel=1e-12)


@pytest.mark.parametrize("name", ["five_bar_heavy", "delta", "two_arms"])
def test_without_elastic_inertia_forces_are_those_of_deflections_that_stand_still(name):
    robot = robots.load(name, flexibility="flexible_links")
    rng = np.random.default_rng(7)
    closed = assembled_at(robot, assemble(robot).q)
    dx, ddx = rng.standard_normal((2, 1, robot.n))
    rates = rng.standard_normal((2, 1, robot.n_e)) * robot.column_scale[robot.elastic]
    still, bending = motion_at(robot, closed, dx, ddx), motion_at(robot, closed, dx, ddx, *rates)
    unfelt = replace(robot, elastic_inertia=False)
    size = np.abs(tree_forces(robot, bending)).max()
    np.testing.assert_allclose(
        tree_forces(unfelt, bending), tree_forces(robot, still), rtol=0, atol=1e-10 * size
    )
    assert np.abs(tree_forces(robot, bending) - tree_forces(robot, still)).max() > 1e-3 * size


@pytest.mark.parametrize("name", ["five_bar", "spherical_rrr", "three_upu"])  # the last one has balls
def test_a_stack_has_the_forces_of_its_instants_also_of_a_body_changed_in_place(name):
    shared = robots.load(name)
    robot = replace(shared, model=shared.model.copy())
    model, data = robot.model, robot.model.createData()
    random = np.random.default_rng(0)
    steps, v, a = random.standard_normal((3, 12, robot.nv))
    q = np.array([pin.integrate(model, robot.reference.q, step) for step in steps])
    for _ in range(2):
        single = np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
        for part in (slice(None), slice(None, None, 3), slice(0)):  # whole, with gaps in memory, empty
            motion = SimpleNamespace(q=q[part], v=v[part], a=a[part], wrenches=())
            assert np.array_equal(tree_forces(robot, motion), single[part])
        body = model.inertias[2]
        model.inertias[2] = pin.Inertia(body.mass + 1.0, body.lever, body.inertia)
