"""Joints as platform: the same robot in other coordinates has the same motions, torques and singularities."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import (
    ParallelRobot,
    Spline,
    assemble,
    dynamics_at,
    forward_kinematics,
    locate_singularities,
    track_path,
    velocity_matrices,
)
from framework.model.description import Platform
from framework.planning.scenes import scene_path

JOINTS = ("left_motor", "left_elbow")


@pytest.fixture(scope="module")
def pair():
    """The 5R, its tip as platform, and the joints of its left leg."""
    tip = robots.load("five_bar")
    platform = Platform("left_tip", joints=JOINTS)
    return tip, ParallelRobot.from_description(replace(tip.description, platform=platform, scenes={}))


def positions(robot, q):
    return np.array([q[robot.model.joints[robot.model.getJointId(name)].idx_q] for name in JOINTS])


def test_coordinates_are_the_positions_of_the_joints(pair):
    tip, joints = pair
    assert joints.axis_names == JOINTS
    assert not joints.translations.any()
    for x in ([0.1, 0.345], [-0.05, 0.3]):
        q = assemble(tip, x).q
        found = assemble(joints, positions(tip, q))
        np.testing.assert_allclose(found.q, q, atol=1e-13)
        back = forward_kinematics(joints, q[joints.actuated], near=joints.reference.q)
        np.testing.assert_allclose(back.x, positions(tip, q), atol=1e-12)


def test_the_same_motion_takes_the_same_torques(pair):
    tip, joints = pair
    rng = np.random.default_rng(1)
    for x in ([0.1, 0.345], [-0.05, 0.3]):
        dx, ddx = rng.standard_normal((2, 2))
        one = dynamics_at(tip, assemble(tip, x).q, dx=dx, ddx=ddx)
        two = dynamics_at(joints, one.q, dx=positions(tip, one.v), ddx=positions(tip, one.a))
        np.testing.assert_allclose(two.v, one.v, atol=1e-12)
        np.testing.assert_allclose(two.a, one.a, atol=1e-11)
        np.testing.assert_allclose(two.torque, one.torque, rtol=1e-11)
        A, B, _ = velocity_matrices(joints, one.q)
        np.testing.assert_allclose(A @ positions(tip, one.v), B @ one.v[joints.actuated], atol=1e-12)


def test_the_same_singularity_lies_on_the_same_way(pair):
    tip, joints = pair
    path = scene_path(tip.description.scenes["C"])
    (there,) = locate_singularities(tip, path)
    branch = track_path(tip, path)
    way = Spline([positions(tip, branch.close(s).q[0]) for s in np.linspace(0, 1, 41)])
    (found,) = locate_singularities(joints, way)
    # the spline through 41 points misses the way by less than 1e-6
    np.testing.assert_allclose(found.platform, positions(tip, there.q), atol=1e-5)
    motion = there.motion[[tip.model.joints[tip.model.getJointId(name)].idx_v for name in JOINTS]]
    cosine = found.twist @ motion / np.linalg.norm(found.twist) / np.linalg.norm(motion)
    assert abs(cosine) == pytest.approx(1.0, abs=1e-9)
