"""What acts along a joint: armature, damping and springs, of passive and of driven joints."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import (
    Line,
    Mechanism,
    NoLaw,
    ParallelRobot,
    RobotFileError,
    assemble,
    dynamics_at,
    plan_crossing,
    plan_scene,
    simulate,
)
from framework.cli import main
from framework.kinematics.frames import difference, forces_on_joints
from framework.model import read_robot_file
from framework.model.description import Closure, JointDynamics, Platform
from framework.model.robot_file_writer import write_robot_file
from framework.planning.feasibility import feasibility_on_path
from framework.singularity.points_on_path import search_path
from tests.oracles.equations_of_motion import defects_of

L1 = 0.25  # [m] proximal links of the 5R
START, END = [0.1, 0.345], [-0.05, 0.195]


def five_bar(**joints: JointDynamics) -> ParallelRobot:
    return ParallelRobot.from_description(replace(robots.load("five_bar").description, joints=joints))


def speeds_of(robot: ParallelRobot, x: np.ndarray) -> np.ndarray:
    """d(joint angles)/dx (4, 2) of the planar 5R by central differences of its closed poses."""
    h = 1e-5
    return np.column_stack(
        [(assemble(robot, x + h * unit).q - assemble(robot, x - h * unit).q) / (2 * h) for unit in np.eye(2)]
    )


@pytest.mark.parametrize("joint", ["left_motor", "left_elbow", "right_elbow"])
@pytest.mark.parametrize("what", ["armature", "damping", "stiffness"])
def test_a_joint_of_any_kind_costs_the_motors_its_power(joint, what):
    """tau_m . n dq_a = torque of the joint times its rate, for all motions of the platform."""
    plain, loaded = five_bar(), five_bar(**{joint: JointDynamics(**{what: 0.7})})
    x, dx, ddx = np.array([0.06, 0.35]), np.array([0.3, -0.2]), np.array([1.0, 2.0])
    q = assemble(plain, x).q
    before, after = (dynamics_at(robot, q, dx=dx, ddx=ddx) for robot in (plain, loaded))
    rates = speeds_of(plain, x)
    column = plain.coordinates.names.index(joint)
    factor = {"armature": before.a, "damping": before.v, "stiffness": q}[what][column]
    geared = plain.gear_ratio[:, None] * rates[plain.actuated]
    expected = np.linalg.solve(geared.T, 0.7 * factor * rates[column])
    np.testing.assert_allclose(after.torque - before.torque, expected, rtol=1e-7, atol=1e-9)


DAMPING = {"left_motor": 0.8, "left_elbow": 0.4, "right_motor": 0.3, "right_elbow": 0.0}  # [N m s/rad]


def lagrange_torques(plan, t):
    """Motor torques (2,) of the paper's 5R with damped joints, written down from its geometry.

    A payload of 10 kg at x; proximal links turn by theta about (-0.2, 0) and (0.2, 0), distal ones by psi.
    With dissipation D/2 theta'^2 + D_e/2 (psi' - theta')^2 a leg and massless links,
    sum of n tau dtheta/dx = m x" + sum of (D theta' dtheta/dx + D_e (psi' - theta') d(psi - theta)/dx).
    """
    x, dx, ddx = (plan.platform(t, order) for order in range(3))
    theta, dtheta, ddtheta = (plan.motor_angle(t, order) / plan.robot.gear_ratio for order in range(3))
    asked, transposed = 10.0 * ddx, []
    for leg, base in enumerate((-0.2, 0.2)):
        damping = list(DAMPING.values())[2 * leg : 2 * leg + 2]
        along = np.array([np.cos(theta[leg]), np.sin(theta[leg])])
        across = np.array([-along[1], along[0]])
        rod = x - [base, 0.0] - L1 * along  # L2 (cos psi, sin psi)
        by_x = rod / (L1 * (rod @ across))  # dtheta/dx, of |rod| = L2
        turned = np.array([-rod[1], rod[0]]) / (rod @ rod)  # dpsi of a motion of the rod's end
        elbow_by_x = turned - L1 * (turned @ across) * by_x - by_x
        assert by_x @ dx == pytest.approx(dtheta[leg], abs=1e-9)
        asked = asked + damping[0] * dtheta[leg] * by_x + damping[1] * (elbow_by_x @ dx) * elbow_by_x
        transposed.append(by_x)
    rotors = plan.robot.rotor_inertia * plan.robot.gear_ratio * ddtheta
    return np.linalg.solve(np.array(transposed).T, asked) / plan.robot.gear_ratio + rotors


@pytest.mark.parametrize(
    "options",
    [
        {"duration": 1.5, "times": [1.0], "speeds": [1.5]},
        pytest.param({"law": "optimal", "duration": 1.5, "optimize": "peak_torque"}, marks=pytest.mark.slow),
        pytest.param({"optimize": "time", "torque_limit": 0.165}, marks=pytest.mark.slow),
    ],
    ids=["polynomial", "peak torque", "time"],
)
def test_a_damped_robot_crosses_with_the_torques_of_lagrange(options):
    robot = five_bar(**{name: JointDynamics(damping=value) for name, value in DAMPING.items()})
    plan = plan_crossing(robot, Line(START, END), **options)
    assert plan.certificate.tail < 1e-9
    assert plan.crossings[0].residual < 1e-11
    beside = plan.crossings[0].time + plan.duration * np.array([-0.4, -0.1, -0.01, 0.01, 0.1, 0.2])
    expected = np.array([lagrange_torques(plan, t) for t in beside])
    peak = max(plan.peak_torque.values())
    np.testing.assert_allclose(plan.torque(beside), expected, atol=1e-8 * peak)
    assert simulate(robot, plan).tracking_error < 1e-9
    if "torque_limit" in options:
        assert peak <= 0.165


@pytest.mark.slow
def test_an_elastic_robot_with_damping_crosses_with_little_more_torque_than_the_rigid_one():
    options = {"law": "optimal", "optimize": "peak_torque", "duration": 1.5}
    rigid = five_bar(left_elbow=JointDynamics(damping=0.4))
    elastic = ParallelRobot.from_description(rigid.description, flexibility="flexible_links")
    plans = [plan_crossing(robot, Line(START, END), **options) for robot in (rigid, elastic)]
    defects = defects_of(plans[1])
    assert defects.force < 1e-9
    assert defects.open < 1e-12
    peaks = [max(plan.peak_torque.values()) for plan in plans]
    assert peaks[1] < 1.05 * peaks[0]


@pytest.mark.slow
def test_limits_hold_the_dry_friction_of_elastic_robots_too():
    rigid = five_bar(left_motor=JointDynamics(damping=0.1, friction=0.2))
    elastic = ParallelRobot.from_description(rigid.description, flexibility="flexible_joints")
    plan = plan_crossing(elastic, Line(START, END), optimize="time", torque_limit=2.0)
    assert 1.99 < max(plan.peak_torque.values()) <= 2.0


def test_an_optimal_law_with_springs_damping_and_rigid_geometry_is_refused_by_these_words():
    robot = robots.load("two_arms", flexibility="flexible_links")
    with pytest.raises(NoLaw, match="damping are not supported with geometry rigid"):
        plan_scene(robot, "lift", law="optimal", geometry="rigid")


def test_the_condition_of_a_damped_robot_names_delta():
    robot = five_bar(left_elbow=JointDynamics(damping=0.4))
    searched = search_path(robot, Line(START, END))
    (asked,) = feasibility_on_path(searched)
    assert asked.condition.delta != 0.0
    assert "delta" in asked.sentence
    constant, per_squared_speed, per_speed = asked.acceleration
    for speed in (0.3, 1.0, 2.0):
        stated = constant + per_speed * speed + per_squared_speed * speed**2
        assert stated == pytest.approx(asked.condition.acceleration(speed), rel=1e-12)


def test_springs_and_friction_of_joints_are_shown(tmp_path, capsys):
    joints = {"left_elbow": JointDynamics(stiffness=2.0), "right_elbow": JointDynamics(friction=0.25)}
    robot = five_bar(**joints)
    assert "springs left_elbow" in repr(robot)
    file = str(write_robot_file(robot.description, tmp_path))
    assert main(["check", file]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"springs +left_elbow", shown)
    assert "right_elbow 0.25 N m" in shown
    assert main(["plan", file, "--scene", "A"]) == 0
    assert "dry friction of right_elbow 0.25 N m (joint side): worth" in capsys.readouterr().out


@pytest.mark.parametrize("rest", [0.2, 0.0])
def test_a_spring_or_damper_on_one_turn_of_a_ball_acts_on_the_axes_of_the_file(rest):
    """Power of the joint's forces is the rate of the spring's energy and what the damper takes."""
    acting = {"arm_rx": JointDynamics(stiffness=3.0, rest=rest), "arm_rz": JointDynamics(damping=0.7)}
    text = """<robot name="ball"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0.2 0.1"/>
      <mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="arm" type="spherical"><parent link="base"/><child link="arm"/></joint></robot>"""
    like = robots.load("five_bar").description
    closure = Closure("pin", ("base", "arm"), ("rz",))
    robot, plain = (
        Mechanism.from_description(
            replace(
                like,
                urdf_text=text,
                platform=Platform("arm", ("rx",)),
                actuators=(),
                springs=(),
                closures=(closure,),
                reference={},
                joints=joints,
            )
        )
        for joints in (acting, {})
    )
    assert not np.allclose(plain.model.jointPlacements[1].rotation, np.eye(3))
    np.testing.assert_array_equal(robot.model.jointPlacements[1].rotation, np.eye(3))
    q, v = (
        pin.integrate(robot.model, pin.neutral(robot.model), np.array([0.7, -0.4, 0.9])),
        np.array([1, 2, -1.5]),
    )

    def energy(t):
        return 1.5 * (pin.log3(pin.Quaternion(pin.integrate(robot.model, q, t * v)).matrix())[0] - rest) ** 2

    forces = forces_on_joints(
        robot,
        robot.neutral,
        q[None],
        robot.joint_stiffness * (difference(robot, robot.neutral, q[None]) - robot.joint_rest),
    )
    assert forces[0] @ v == pytest.approx((energy(1e-6) - energy(-1e-6)) / 2e-6, rel=1e-7)
    np.testing.assert_array_equal(robot.joint_damping, [0, 0, 0.7])


def test_what_the_urdf_declares_is_read_and_the_file_may_say_otherwise(write_robot):
    changed = (("</joint>", '<dynamics damping="0.25" friction="0.1"/></joint>'),)
    joints = read_robot_file(write_robot(urdf=changed)).joints
    assert joints == {"left_motor": JointDynamics(damping=0.25, friction=0.1)}
    other = ("joints", {"left_motor": {"damping": 0, "armature": 2}})
    joints = read_robot_file(write_robot(other, urdf=changed)).joints
    assert joints == {"left_motor": JointDynamics(armature=2.0, friction=0.1)}


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ({"left_motr": {"damping": 1}}, "joints.left_motr: unknown joint 'left_motr'"),
        ({"left_motor": {"damping": -1}}, "joints.left_motor.damping: must not be negative"),
        ({"left_motor": {"viscosity": 1}}, "joints.left_motor.viscosity: unknown key"),
    ],
)
def test_what_cannot_act_on_a_joint_is_refused(write_robot, joints, message):
    with pytest.raises(RobotFileError) as raised:
        read_robot_file(write_robot(("joints", joints)))
    assert message in str(raised.value)


def test_what_acts_on_joints_is_written_and_read_again(tmp_path):
    joints = {
        "left_elbow": JointDynamics(damping=0.1, stiffness=2.0, rest=-0.3),
        "left_motor": JointDynamics(armature=0.5, friction=0.2),
    }
    description = replace(robots.load("five_bar").description, joints=joints)
    assert read_robot_file(write_robot_file(description, tmp_path)).joints == joints


@pytest.mark.parametrize("flexibility", ["flexible_joints", "flexible_links"])
def test_a_polynomial_law_of_an_elastic_robot_with_damping_leaves_nothing_of_the_equations(flexibility):
    joints = {"left_elbow": JointDynamics(damping=0.05), "right_motor": JointDynamics(damping=0.3)}
    description = replace(robots.load("five_bar").description, joints=joints)
    robot = ParallelRobot.from_description(description, flexibility=flexibility)
    plan = plan_crossing(robot, Line(START, END), duration=1.5, times=[1.0], speeds=[1.5])
    undamped = plan_crossing(
        robots.load("five_bar", flexibility=flexibility),
        Line(START, END),
        duration=1.5,
        times=[1.0],
        speeds=[1.5],
    )
    t = np.linspace(0.1, 1.4, 9)
    peak = max(plan.peak_torque.values())
    assert np.abs(plan.torque(t) - undamped.torque(t)).max() > 1e-2 * peak
    left = defects_of(plan)
    assert max(left.force, left.open, left.speed, left.acceleration) < 1e-8


TWO_CRANKS = """<robot name="two_cranks"><link name="base"/><link name="crank_1"/><link name="crank_2"/>
  <link name="coupler"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j1" type="continuous"><parent link="base"/><child link="crank_1"/><axis xyz="0 1 0"/></joint>
  <joint name="j2" type="continuous"><parent link="base"/><child link="crank_2"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="continuous"><parent link="crank_1"/><child link="coupler"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/></joint></robot>"""
TWO_CRANKS_FILE = """version: 1
urdf: two_cranks.urdf
platform: {joints: [j2]}
actuators: [{joint: j1}]
frames:
- {name: far_end, parent: coupler, xyz: [0.4, 0, 0]}
- {name: top, parent: crank_2, xyz: [0, 0, 0.3]}
closures: [{name: far, frames: [far_end, top], axes: [x, z]}]
joints: {j1: {armature: 0.5}, j2: {armature: 0.5}}
reference: {j1: 0.5, j2: 0.5, elbow: -0.5}
"""


def test_armature_counts_at_both_cranks_of_which_one_has_the_motor(tmp_path):
    """The coupler translates: tau = (2 I + m l^2) phi" - m g l sin phi, phi from the vertical."""
    (tmp_path / "two_cranks.urdf").write_text(TWO_CRANKS)
    file = tmp_path / "two_cranks.yaml"
    file.write_text(TWO_CRANKS_FILE)
    plan = plan_crossing(ParallelRobot.from_file(file), Line([0.5], [1.1]), duration=0.8)
    t = np.linspace(0.0, 0.8, 33)
    phi, acceleration = (plan.platform(t, order)[:, 0] for order in (0, 2))
    expected = (2 * 0.5 + 2.0 * 0.3**2) * acceleration - 2.0 * 9.81 * 0.3 * np.sin(phi)
    torque = plan.torque(t)[:, 0]
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    single = expected - 0.5 * acceleration  # with the armature of one crank alone
    assert np.abs(torque - single).max() > 0.2 * np.abs(expected).max()
