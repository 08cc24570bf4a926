"""Idle turns that balls drive: their rates are those of a motion, and leave no torque along the turn."""

from dataclasses import replace

import numpy as np
import pytest

from framework import ParallelRobot, simulate
from framework.kinematics.diagnostics.proposal import propose
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops, idle_turns
from framework.kinematics.motion_rates import motion_at
from framework.model.readers import parse_any
from tests.model.readers.foreign_files import DATA, short_move, without_dry_friction


def head(**acting: float) -> ParallelRobot:
    """The head on six rods, the last of which is between two balls of the tree; `acting` on all balls."""
    description = parse_any(DATA / "head_on_six_rods.xml", propose=propose).description
    joints = {
        name: replace(joint, **acting) if name.startswith("passive") else joint
        for name, joint in description.joints.items()
    }
    return ParallelRobot.from_description(without_dry_friction(replace(description, joints=joints)))


@pytest.fixture(scope="module")
def moving():
    """The head, a platform pose with rates and accelerations, and its motion there."""
    robot, rng = head(), np.random.default_rng(3)
    x = robot.reference.x + 0.01 * rng.normal(size=(1, 6)) * np.repeat([0.1, 1.0], 3)
    dx, ddx = (rng.normal(size=(1, 6)) * np.repeat([0.1, 1.0], 3) for _ in range(2))
    closed = close_loops(robot, x, robot.reference.q[None])
    return robot, x, dx, ddx, motion_at(robot, closed, dx, ddx)


def test_accelerations_are_the_derivatives_of_the_rates_along_the_motion(moving):
    robot, x, dx, ddx, motion = moving
    h, rates = 1e-4, []
    for step in (h, -h):
        ahead = integrate(robot, motion.q, step * motion.v + 0.5 * step**2 * motion.a)
        closed = close_loops(robot, x + step * dx + 0.5 * step**2 * ddx, ahead)
        rates.append(motion_at(robot, closed, dx + step * ddx, ddx).v)
    derivative = (rates[0] - rates[1]) / (2 * h)
    np.testing.assert_allclose(motion.a, derivative, rtol=0, atol=1e-6 * np.abs(motion.a).max())


def test_damping_of_the_balls_gives_no_torque_along_an_idle_turn(moving):
    robot, *_, motion = moving
    turns = idle_turns(robot, motion.linearised)
    torques = robot.joint_damping * motion.v
    along = np.einsum("tvk,tv->tk", turns.motions, torques)
    assert np.abs(motion.v[:, robot.structure.idle]).max() > 0.01
    assert np.abs(along).max() < 1e-13 * np.abs(torques).max()


@pytest.mark.parametrize("acting", [{"damping": 0.0}, {"armature": 0.0}], ids=["armature", "damping"])
def test_planned_torques_bring_the_head_along_while_its_rods_turn(acting):
    plan = short_move(head(**acting))
    peak = max(plan.peak_torque.values())
    assert plan.certificate.max_held_torque < 1e-6 * peak
    simulated = simulate(plan)
    assert simulated.tracking_error < 1e-6 * plan.robot.length
    assert simulated.turning_error < 1e-6


def test_without_damping_or_armature_of_balls_idle_turns_rest():
    robot = head(damping=0.0, armature=0.0)
    closed = close_loops(robot, robot.reference.x[None], robot.reference.q[None])
    assert idle_turns(robot, closed) is None
    motion = motion_at(robot, closed, np.ones((1, 6)), np.ones((1, 6)))
    assert not motion.v[:, robot.structure.idle].any()
