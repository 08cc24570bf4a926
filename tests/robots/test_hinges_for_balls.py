"""Balls made of three hinges lose a freedom where the outer two are parallel: the model's, never the robot's.

Where a way of the motors ends, something has to move with the motors locked: the platform, or a part that has
a mass. Hinges of a ball that only turn against one another move neither.
"""

import numpy as np
import pinocchio as pin
import pytest

from framework import NotAssembled, Type2Singularity, forward_kinematics
from framework.kinematics.continuation.forward_kinematics import motors_are_free
from framework.kinematics.linearised_loops import linearised_at, passive_matrix, passive_motion
from tests.robots.every_robot import KINDS, RIGID


def ends(robot, count, reach, seed):
    """Type 2 singularities where ways to motor angles drawn around the reference end."""
    rng = np.random.default_rng(seed)
    reference = robot.actuated_coordinates(robot.reference.q[None])[0]
    sizes = np.where(robot.sliding[robot.actuated], 0.2 * robot.length, reach)
    for target in reference + rng.uniform(-1, 1, (count, robot.n_a)) * sizes:
        try:
            forward_kinematics(robot, target)
        except Type2Singularity as end:
            yield end.q
        except NotAssembled:
            continue


def fastest_part(robot, q):
    """Fastest twist [rad/s, lengths/s] of platform and parts with mass, in the motion P all but loses."""
    eta = np.linalg.svd(passive_matrix(robot, linearised_at(robot, q[None], None))[0])[2][-1]
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, q, passive_motion(robot, eta))
    bodies = [j for j in range(1, model.njoints) if model.inertias[j].mass > 0]
    twists = [data.v[j] for j in bodies]
    twists.append(pin.getFrameVelocity(model, data, robot.frames[0]))
    return max(max(np.linalg.norm(t.linear) / robot.length, np.linalg.norm(t.angular)) for t in twists)


# balls of three hinges, universal joints, parallelograms; rings; planes
OTHERS = ("delta_hinges", "humanoid_ankle", "spherical_rrr")


@pytest.mark.parametrize("name", [name for name in (*KINDS, *OTHERS) if motors_are_free(RIGID[name])])
def test_where_a_way_of_the_motors_ends_something_moves(name):
    robot = RIGID[name]
    for q in ends(robot, 12, 1.0, seed=0):
        assert fastest_part(robot, q) > 1e-2


@pytest.mark.slow
def test_no_way_of_the_delta_ends_where_rod_1a_passes_the_horizontal():
    """With the hinges in the order x, y, z, of 400 five ended there, and seven went on through Type 2."""
    robot = RIGID["delta"]
    rates = [fastest_part(robot, q) for q in ends(robot, 200, 3.1, seed=5)]
    assert len(rates) > 150
    assert min(rates) > 1e-3
