"""Derivatives of pose and matrices along motors and parameters, against robots built a little off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, SingularPose, assemble, velocity_matrices
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import difference, frames_at
from framework.kinematics.kinematic_derivatives import kinematic_derivatives

ROBOTS = [
    ("five_bar", "flexible_links"),
    ("three_rpr", "rigid"),
    ("spherical_rrr", "rigid"),
    ("delta", "rigid"),
]
STEP = 1e-4  # [m, rad], with differences of fourth order


@pytest.fixture(scope="module", params=ROBOTS, ids="-".join)
def robot(request):
    return robots.load(request.param[0], flexibility=request.param[1])


def built_off(robot, name: str, step: float):
    """The robot with one placement displaced along or about its own axes."""
    owner, way = name.rsplit(".", 1)
    shift = pin.exp6(step * np.eye(6)[("x", "y", "z", "rx", "ry", "rz").index(way)])
    model = pin.Model(robot.model)
    frame = [k for k in robot.frames if model.frames[k].name == owner]
    if model.existJointName(owner) and name not in [f"{model.frames[k].name}.{way}" for k in robot.frames]:
        model.jointPlacements[model.getJointId(owner)] = (
            model.jointPlacements[model.getJointId(owner)] * shift
        )
    else:
        model.frames[frame[0]].placement = model.frames[frame[0]].placement * shift
    return replace(robot, model=model)


def closed(robot, q, columns):
    """q (nq,) with the loops closed by some joints, and the platform's coordinates."""
    for _ in range(6):
        loops = loop_equations(robot.loops, frames_at(robot, q[None]))
        step = np.zeros(robot.model.nv)
        step[columns] = -np.linalg.solve(loops.jacobian[0][:, columns], loops.residual[0])
        q = pin.integrate(robot.model, q, step)
    return q, robot.platform.coordinates(frames_at(robot, q[None]))[0]


def slope(values):
    """The derivative of values(step) at 0."""
    one, two = (values(s * STEP) - values(-s * STEP) for s in (1, 2))
    return (8 * one - two) / (12 * STEP)


def projector(matrices, robot):
    """dx/dq_a and dx/dq_e of A, B, C: what does not depend on the choice of their rows."""
    return np.linalg.solve(matrices.A, np.concatenate([matrices.B, matrices.C], axis=1))


def of_slopes(robot, q, slopes, k):
    """The derivative of `projector` by those of A, B, C."""
    at = velocity_matrices(robot, q)
    changed = np.concatenate([slopes.B[k], slopes.C[k]], axis=1) - slopes.A[k] @ projector(at, robot)
    return np.linalg.solve(at.A, changed)


def test_along_the_motors(robot):
    q = robot.reference.q
    found = kinematic_derivatives(robot, q).motors
    for k, column in enumerate(robot.actuated):

        def moved(step, column=column):
            there = pin.integrate(robot.model, q, step * np.eye(robot.model.nv)[column])
            there, x = closed(robot, there, robot.following)
            matrices = projector(velocity_matrices(robot, there), robot)
            return np.concatenate([difference(robot, q, there[None])[0], x, matrices.ravel()])

        ours = np.concatenate([found.q[:, k], found.x[:, k], of_slopes(robot, q, found, k).ravel()])
        expected = slope(moved)
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_along_geometric_parameters(robot):
    q = robot.reference.q
    found = kinematic_derivatives(robot, q)
    chosen = np.random.default_rng(0).choice(len(found.names), 24, replace=False)
    for k in chosen:
        name = found.names[k]

        def built(step, name=name):
            other = built_off(robot, name, step)
            there, x = closed(other, q, other.following)
            try:
                matrices = projector(velocity_matrices(other, there), other)
            except InvalidInput:  # rows that repeat others no longer do
                matrices = np.full((robot.n, robot.n_a + robot.n_e), np.nan)
            return np.concatenate([difference(robot, q, there[None])[0], x, matrices.ravel()])

        ours = [found.parameters.q[:, k], found.parameters.x[:, k]]
        ours = np.concatenate([*ours, of_slopes(robot, q, found.parameters, k).ravel()])
        expected = slope(built)
        known = ~np.isnan(expected)
        scale = max(np.abs(expected[known]).max(), 1.0)
        np.testing.assert_allclose(ours[known], expected[known], rtol=0, atol=1e-7 * scale, err_msg=name)


def test_with_the_platform_held_the_motors_make_up_for_what_it_would_move(robot):
    """dx/dq_a dq_a + dx/dp = 0."""
    found = kinematic_derivatives(robot, robot.reference.q)
    left = found.motors.x @ found.q_a + found.parameters.x
    np.testing.assert_allclose(left, 0, atol=1e-10 * np.abs(found.parameters.x).max())


def test_at_type_2_the_motors_do_not_tell_the_pose():
    robot = robots.load("five_bar")
    with pytest.raises(SingularPose, match="Type 2"):
        kinematic_derivatives(robot, assemble(robot, [0.0, np.sqrt(0.06)]).q)
    with pytest.raises(InvalidInput, match="none of them can move"):
        kinematic_derivatives(robots.load("two_arms"), robots.load("two_arms").reference.q)
