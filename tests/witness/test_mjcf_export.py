"""Robots that we export, loaded by MuJoCo: the same tree, the same loops, the same motion."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, ParallelRobot, assemble, plan_scene
from framework.files.mjcf import (
    MIN_INERTIA,
    MIN_MASS,
    OFF_ORIGIN,
    ROD,
    convert_to_qpos,
    equality_axes,
    mjcf_text,
    ranges_left_out,
)
from framework.kinematics.frames import frames_at
from framework.model.description import Closure
from framework.simulation.consistent_states import accelerations
from framework.simulation.equations import EquationsOfMotion
from tests.model.readers.leg import SAID, ankle
from tests.robots.every_robot import KINDS
from tests.witness.installed import REQUIRED

if not REQUIRED:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install '.[witness]'")
mujoco = import_module("mujoco")

NAMES = list(robots.CATALOGUE)


def loaded(robot):
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot))
    return model, mujoco.MjData(model)


def tree_in_mujoco(model, data):
    """Mass matrix with armature, and the forces of weight and speed."""
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass, data.qfrc_bias.copy()


def tree_in_pinocchio(robot, tree, q, v):
    data = tree.createData()
    upper = np.triu(pin.crba(tree, data, q))
    mass = upper + np.triu(upper, 1).T
    mass[robot.actuated, robot.actuated] += robot.rotor_inertia * robot.gear_ratio**2
    return mass, pin.nonLinearEffects(tree, data, q, v)


def with_stand_ins(robot):
    """The tree with mass in each body: MuJoCo takes none without."""
    tree = pin.Model(robot.model)
    for j in range(1, tree.njoints):
        body = tree.inertias[j]
        lacking = max(0.0, MIN_INERTIA - np.linalg.eigvalsh(body.inertia)[0])
        tree.inertias[j] = pin.Inertia(
            max(body.mass, MIN_MASS), body.lever, body.inertia + lacking * np.eye(3)
        )
    return tree


@pytest.mark.parametrize(
    ("name", "flexibility"),
    [*((name, "rigid") for name in NAMES), *((name, "flexible_links") for name in KINDS)],
)
def test_tree_and_loops_are_the_same(name, flexibility):
    robot = robots.load(name, flexibility=flexibility)
    model, data = loaded(robot)
    assert [model.joint(j).name for j in range(model.njnt)] == list(robot.model.names)[1:]
    np.testing.assert_allclose(model.key("reference").qpos, assemble(robot).q, rtol=0, atol=1e-15)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qvel[:] = np.random.default_rng(1).normal(size=model.nv)
    theirs = tree_in_mujoco(model, data)
    ours = tree_in_pinocchio(robot, with_stand_ins(robot), data.qpos.copy(), data.qvel.copy())
    for one, two in zip(theirs, ours, strict=True):
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12 * np.abs(two).max())
    assert data.nefc > 0
    assert np.abs(data.efc_pos).max() < 1e-11 * max(robot.length, 1.0)


def test_balls_are_those_of_mujoco(tmp_path):
    """The ankle on rods with balls, read from MJCF and written: the same tree and the same loops."""
    robot = ankle(tmp_path)
    model, data = loaded(robot)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qvel[:] = np.random.default_rng(1).normal(size=model.nv)
    theirs, q = tree_in_mujoco(model, data), assemble(robot, [-0.5, 0.3]).q
    ours = tree_in_pinocchio(robot, with_stand_ins(robot), robot.reference.q, data.qvel.copy())
    for one, two in zip(theirs, ours, strict=True):
        np.testing.assert_allclose(one, two, rtol=0, atol=10 * MIN_INERTIA)  # of the thin rods' stand-ins
    data.qpos[:] = convert_to_qpos(robot.model, q)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-13


def test_the_points_that_close_a_hinge_are_a_tenth_of_the_robot_apart():
    """Their distance is the weight of a rotation beside a translation in MuJoCo's equalities."""
    robot = robots.load("n_four_bar")
    model, data = loaded(robot)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    axes = equality_axes(robot)
    hinges = [closure for closure in robot.description.closures if OFF_ORIGIN[axes[closure.name]]]
    assert hinges
    for closure in hinges:
        for axis in OFF_ORIGIN[axes[closure.name]]:
            for end in closure.frames:
                ends = [data.site(name).xpos for name in (end, f"{end}_{closure.name}_{axis}")]
                assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(0.1 * robot.length)


@pytest.mark.parametrize("name", ["five_bar_heavy", "gough_stewart", "delta", "spherical_rrr", "n_four_bar"])
def test_loops_stay_closed_along_a_planned_motion(name):
    robot = robots.load(name)
    scene = next(name for name in robot.description.scenes if not _refused(robot, name))
    plan = plan_scene(robot, scene)
    model, data = loaded(robot)
    for time in np.linspace(0.0, plan.duration, 11):
        motion = plan.dynamics.motion(time)
        data.qpos[:], data.qvel[:] = motion.q[0], motion.v[0]
        mujoco.mj_forward(model, data)
        scale = max(1.0, float(np.abs(data.qvel).max()))
        assert np.abs(data.efc_pos).max() < 1e-9 * robot.length
        assert np.abs(data.efc_vel).max() < 1e-9 * robot.length * scale


def _refused(robot, scene):
    return robot.description.scenes[scene].times == ()


@pytest.mark.slow
def test_planned_torques_bring_mujocos_robot_along_the_path():
    robot = robots.load("five_bar_heavy")
    plan = plan_scene(robot, "C")
    model, data = loaded(robot)
    model.opt.timestep = 1e-4
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.eq_solref[:, 0] = 2e-4
    motion = plan.dynamics.motion(0.0)
    data.qpos[:], data.qvel[:] = motion.q[0], motion.v[0]
    tip, off = model.site("left_tip").id, 0.0
    for time in np.arange(0.0, plan.duration, model.opt.timestep):
        mujoco.mj_forward(model, data)
        off = max(off, float(np.linalg.norm(data.site_xpos[tip, :2] - plan.platform(time))))
        data.ctrl[:] = plan.torque(min(time + 0.5 * model.opt.timestep, plan.duration))
        mujoco.mj_step(model, data)
    assert off < 1e-4  # soft loops at steps of 1e-4 s; the path is 0.21 m long


def accelerations_of(robot, q, v, torque):
    """Joint accelerations (nv,) of one state."""
    equations, still = EquationsOfMotion.of(robot), np.zeros((1, robot.model.nv))
    return accelerations(equations, q[None], v[None], torque[None], still).a[0]


@pytest.mark.parametrize("name", KINDS)
def test_our_reader_takes_back_every_robot_and_it_moves_alike(name, tmp_path):
    robot, again = robots.load(name), read_back(robots.load(name), tmp_path)
    q, v, torque = at_rest(robot)
    ours, theirs = (accelerations_of(each, q, v, torque)[robot.moving] for each in (robot, again))
    # the stand-ins weigh 1e-9 kg where the robot weighs nothing
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-8 * np.abs(ours).max())


def read_back(robot, folder):
    file = folder / "robot.xml"
    file.write_text(mjcf_text(robot))
    platform = robot.description.platform
    axes = platform.axes or ("rx", "ry", "rz")[: robot.n]  # joints of the tree as platform turn its frame
    return ParallelRobot.from_file(file, platform=platform.frame, axes=axes, motors=robot.actuator_names)


def at_rest(robot):
    """The assembled reference, no speed, and motor torques of the size that the weight asks for."""
    weight = 9.81 * sum(body.mass for body in robot.model.inertias)
    share = np.random.default_rng(3).uniform(-0.3, 0.3, robot.n_a)
    torque = share * weight * robot.length / robot.n_a / robot.gear_ratio
    return assemble(robot).q, np.zeros(robot.model.nv), torque


def loops_in_mujoco(model, data):
    """The Jacobian of its equalities."""
    rows = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    else:
        rows = data.efc_J[: rows.size].reshape(rows.shape).copy()
    return rows[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]


@pytest.mark.parametrize("name", NAMES)
def test_our_accelerations_are_those_of_mujocos_equations_with_rigid_loops(name):
    robot = robots.load(name)
    model, data = loaded(robot)
    q, v, torque = at_rest(robot)
    a = accelerations_of(robot, q, v, torque)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = torque
    mass = tree_in_mujoco(model, data)[0]
    terms = np.array([mass @ a, data.qfrc_bias, -data.qfrc_actuator, -data.qfrc_passive])
    scale = robot.column_scale
    rows = loops_in_mujoco(model, data) * scale
    sizes, ways = np.linalg.svd(rows)[1:]
    free = ways[int(np.sum(sizes > 1e-8 * sizes[0])) :] * scale
    assert len(free) == robot.n + len(robot.structure.idle)
    np.testing.assert_allclose(rows @ (a / scale), 0, atol=1e-11 * np.abs(a / scale).max())
    # 1e-9 kg and 1e-12 kg m^2 stand in for nothing
    np.testing.assert_allclose(free @ terms.sum(axis=0), 0, atol=1e-7 * np.abs(free @ terms.T).max())


def test_limits_are_ranges():
    robot = robots.load("gough_stewart")
    actuators = [
        replace(actuator, torque_limit=2.5, speed_limit=300.0) for actuator in robot.description.actuators
    ]
    robot = replace(robot, description=replace(robot.description, actuators=tuple(actuators)))
    model, data = loaded(robot)
    assert model.actuator_ctrllimited.all()
    assert model.actuator_forcelimited.all()
    np.testing.assert_array_equal(model.actuator_forcerange, [[-2.5, 2.5]] * 6)
    assert model.numeric("leg_1_motor_speed_limit").data == [300.0]
    for limit in robot.limits:
        assert model.joint(limit.joint).limited
        np.testing.assert_array_equal(model.joint(limit.joint).range, [limit.lower, limit.upper])
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = 10.0
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.actuator_force, 2.5)


def test_our_reader_takes_back_torque_limits(tmp_path):
    robot = robots.load("five_bar")
    actuators = tuple(replace(actuator, torque_limit=0.5) for actuator in robot.description.actuators)
    limited = replace(robot, description=replace(robot.description, actuators=actuators))
    again = read_back(limited, tmp_path)
    assert [actuator.torque_limit for actuator in again.description.actuators] == [0.5, 0.5]


def test_a_range_that_the_reference_is_not_in_is_left_out():
    robot = robots.load("five_bar")
    urdf = robot.description.urdf_text.replace('lower="-6.28"', 'lower="2"', 1)
    outside = ParallelRobot.from_description(replace(robot.description, urdf_text=urdf))
    assert ranges_left_out(outside) == ("left_motor",)
    model, _ = loaded(outside)
    assert not model.joint("left_motor").limited
    assert model.joint("left_elbow").limited


def test_rods_that_lock_two_axes_are_points_since_the_orthoglide_keeps_the_third():
    axes = equality_axes(robots.load("orthoglide", flexibility="flexible_links"))
    assert axes["rod_1b"] == ("x", "y", "z")
    assert axes["mount_2"] == ("x", "y", "z", "rx", "rz")


def test_a_closure_that_no_equality_says_is_refused_by_name_and_axis():
    original = robots.load("five_bar").description
    loose = replace(original, closures=(replace(original.closures[0], axes=("x",)),))
    with pytest.raises(InvalidInput, match=r"closure 'tip', which locks x .*would lock y, z, along which"):
        mjcf_text(ParallelRobot.from_description(loose))


def test_balls_as_hinges_are_the_same_tree(tmp_path):
    """At zero masses and weights are those of the balls; turned, sites are where balls put them."""
    robot = ankle(tmp_path)
    model, data = loaded(robot)
    hinged = mujoco.MjModel.from_xml_string(mjcf_text(robot, hinges=True))
    turned = mujoco.MjData(hinged)
    assert mujoco.mjtJoint.mjJNT_BALL not in hinged.jnt_type
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_resetDataKeyframe(hinged, turned, 0)
    for one, other in zip(tree_in_mujoco(model, data), tree_in_mujoco(hinged, turned), strict=True):
        np.testing.assert_allclose(other, one, atol=1e-12)
    angles = np.array([0.3, -0.2, 0.4])
    for k in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL):
        joint = model.joint(k)
        for axis, angle in zip("xyz", angles, strict=True):
            turned.qpos[hinged.joint(f"{joint.name}_hinge_{axis}").qposadr] = angle
        quaternion = data.qpos[joint.qposadr[0] :][:4]
        for axis, angle in zip(np.eye(3), angles, strict=True):
            turn = np.append(np.cos(angle / 2), np.sin(angle / 2) * axis)
            mujoco.mju_mulQuat(quaternion, quaternion.copy(), turn)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_kinematics(hinged, turned)
    assert np.abs(data.site_xpos - turned.site_xpos).max() < 1e-12
    np.testing.assert_allclose(turned.xpos, data.xpos, atol=1e-12)


@pytest.mark.parametrize("hinges", [False, True])
def test_a_rod_to_a_body_on_a_ball_has_its_length_in_the_reference(tmp_path, hinges):
    """From the end of a rod of the ankle, turned, to the foot, on which this end stays where it is."""
    robot = ankle(tmp_path)
    turned = robot.reference_values(assemble(robot, [-0.5, 0.3]).q)
    end, held = robot.description.closures[0].frames
    foot = SAID["platform"]
    place = frames_at(robot, robot.reference.q[None]).placements[0]
    names = [robot.model.frames[k].name for k in robot.frames]
    length = float(np.linalg.norm(place[names.index(held), 3] - place[names.index(foot), 3]))
    rod = Closure("rod", (end, foot), ROD, length)
    description = robot.description
    robot = ParallelRobot.from_description(
        replace(description, closures=(*description.closures, rod), reference=turned)
    )
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot, hinges=hinges))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert len(data.efc_pos) == 7
    assert np.abs(data.efc_pos).max() < 1e-12


def test_each_hinge_of_a_ball_has_the_damping_of_its_axis(tmp_path):
    robot = ankle(tmp_path)
    column = next(joint.idx_v for joint in robot.model.joints if joint.nv == 3)
    damping = robot.joint_damping.copy()
    damping[column : column + 3] = 1.0, 2.0, 3.0
    damped = ParallelRobot.of(replace(robot, joint_damping=damping))
    hinged = mujoco.MjModel.from_xml_string(mjcf_text(damped, hinges=True))
    assert {1.0, 2.0, 3.0} <= set(hinged.dof_damping)
    with pytest.raises(InvalidInput, match=r"dynamics of ball .* differ between its axes") as refusal:
        mjcf_text(damped)
    assert refusal.value.remedy == {"hinges": True}


def test_a_ball_with_a_spring_is_not_written_as_hinges(tmp_path):
    robot = ankle(tmp_path)
    column = next(joint.idx_v for joint in robot.model.joints if joint.nv == 3)
    stiffness = robot.joint_stiffness.copy()
    stiffness[column : column + 3] = 5.0
    sprung = ParallelRobot.of(replace(robot, joint_stiffness=stiffness))
    with pytest.raises(InvalidInput, match="has a spring"):
        mjcf_text(sprung, hinges=True)
    assert "ball" in mjcf_text(sprung)
