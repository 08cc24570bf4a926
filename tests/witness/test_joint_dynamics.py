"""What acts along joints, and couplings of them, against MuJoCo's inverse dynamics along the same motion.

MuJoCo computes what the open tree needs, with its own armature, damping and springs, and the Jacobian of its
own equalities; the motors then balance the power along every motion that these leave free.
"""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

import robots
from framework import Line, ParallelRobot, plan_crossing, plan_scene
from framework.files.mjcf import convert_to_qpos, mjcf_text
from framework.model.description import JointDynamics
from tests.kinematics.test_couplings import cardan_in
from tests.witness.installed import REQUIRED

if not REQUIRED:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install '.[witness]'")
mujoco = import_module("mujoco")


def acting(description, seed):
    """Something on every other coordinate, with motors and without."""
    random = np.random.default_rng(seed)
    names = [name for name in robots.load(description.name).coordinates.names if random.uniform() < 0.6]
    return {
        name: JointDynamics(
            armature=random.uniform(0.0, 0.3),
            damping=random.uniform(0.0, 0.5),
            stiffness=random.uniform(0.0, 2.0),
            rest=random.uniform(-0.3, 0.3),
        )
        for name in names
    }


def power_left(robot, plan, t):
    """Power of the tree's forces less that of the motors, along motions that MuJoCo's equalities leave."""
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot))
    data = mujoco.MjData(model)
    dynamics, at = plan.dynamics, np.array([t])
    data.qpos[:] = convert_to_qpos(robot.model, dynamics.configuration(at)[0])
    data.qvel[:] = dynamics.velocity(at)[0]
    mujoco.mj_forward(model, data)
    jacobian = (
        data.efc_J.reshape(data.nefc, model.nv) if not mujoco.mj_isSparse(model) else _dense(data, model)
    )
    values, right = np.linalg.svd(jacobian)[1:]
    free = right[int(np.sum(values > 1e-8 * values[0])) :]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data.qacc[:] = dynamics.velocity(at, 2)[0]
    mujoco.mj_inverse(model, data)
    given = np.zeros(model.nv)
    given[robot.actuated] = robot.gear_ratio * plan.torque(t)
    size = np.abs(given).max()
    return np.abs(free @ (data.qfrc_inverse - given)).max() / size


def _dense(data, model):
    dense = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return dense


@pytest.mark.parametrize(("name", "scene"), [("five_bar_heavy", "A"), ("delta", None)])
def test_torques_are_those_of_mujoco_s_inverse_dynamics(name, scene):
    description = robots.load(name).description
    robot = ParallelRobot.from_description(replace(description, joints=acting(description, 3)))
    plan = plan_scene(robot, scene or next(iter(description.scenes)))
    for t in plan.duration * np.array([0.13, 0.37, 0.59, 0.83]):
        assert power_left(robot, plan, t) < 1e-7


@pytest.mark.slow
def test_torques_of_an_optimal_crossing_with_damping_and_armature_are_those_of_mujoco():
    description = robots.load("five_bar_heavy").description
    robot = ParallelRobot.from_description(replace(description, joints=acting(description, 3)))
    plan = plan_crossing(robot, Line([0.1, 0.345], [-0.05, 0.195]), duration=1.5, law="optimal")
    assert plan.crossings
    for t in plan.duration * np.array([0.13, 0.37, 0.59, 0.83]):
        assert power_left(robot, plan, t) < 1e-7


def test_torques_of_coupled_joints_are_those_of_mujoco(tmp_path):
    robot = cardan_in(tmp_path)
    plan = plan_crossing(robot, Line([0.3], [0.2]), duration=1.0)
    for t in (0.2, 0.5, 0.8):
        assert power_left(robot, plan, t) < 1e-7
