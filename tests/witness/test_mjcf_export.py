"""Robots that we export, loaded by MuJoCo: the same tree, the same loops, the same motion."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot, assemble, plan_scene
from framework.errors import InvalidInput
from framework.export.mjcf import INERTIA, MASS, mjcf_text
from tests.witness.installed import REQUIRED

if not REQUIRED:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install '.[witness]'")
mujoco = import_module("mujoco")

REFUSED = {"orthoglide"}  # its rods lock two axes
NAMES = [name for name in robots.CATALOGUE if name not in REFUSED]


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
        lacking = max(0.0, INERTIA - np.linalg.eigvalsh(body.inertia)[0])
        tree.inertias[j] = pin.Inertia(max(body.mass, MASS), body.lever, body.inertia + lacking * np.eye(3))
    return tree


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
@pytest.mark.parametrize("name", NAMES)
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


def test_our_reader_takes_back_what_we_wrote(tmp_path):
    robot = robots.load("five_bar_heavy")
    file = tmp_path / "robot.xml"
    file.write_text(mjcf_text(robot))
    again = ParallelRobot.from_file(
        file,
        platform=robot.description.platform.frame,
        axes=["x", "y"],
        motors=list(robot.actuator_names),
        reference=dict(robot.description.reference),
    )
    one, two = assemble(robot, [0.0, 0.3]), assemble(again, [0.0, 0.3])
    np.testing.assert_allclose(one.q, two.q, rtol=0, atol=1e-11)
    v = np.random.default_rng(2).normal(size=robot.model.nv)
    ours, theirs = (tree_in_pinocchio(each, each.model, one.q, v) for each in (robot, again))
    for written, read in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(read, written, rtol=0, atol=1e-10 * np.abs(written).max())


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_a_closure_without_an_equality_is_refused_by_name(name):
    with pytest.raises(InvalidInput, match="rod_1b"):
        mjcf_text(robots.load(name))
