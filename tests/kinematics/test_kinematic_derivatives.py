"""Derivatives of pose and matrices along motors, springs and geometric parameters, against differences."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import (
    InvalidInput,
    ParallelRobot,
    SingularPose,
    assemble,
    forward_kinematics,
    velocity_matrices,
)
from framework.identification.geometry import parametrise_geometry
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import difference, frames_at
from framework.kinematics.velocity_matrices import kinematic_derivatives

ROBOTS = {
    "five_bar": lambda: robots.load("five_bar", flexibility="flexible_links"),
    "spherical_rrr": lambda: parametrise_geometry(robots.load("spherical_rrr")).model,
    "delta": lambda: parametrise_geometry(robots.load("delta")).model,
    "three_rpr": lambda: robots.load("three_rpr"),
}
STEP = 1e-4  # [m, rad], with differences of fourth order


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.slow if name == "delta" else ()) for name in ROBOTS],
)
def robot(request):
    return ROBOTS[request.param]()


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


def test_along_the_motors_and_the_springs(robot):
    q = robot.reference.q
    found = kinematic_derivatives(robot, q)
    random = np.random.default_rng(0)
    springs = random.choice(robot.n_e, min(robot.n_e, 8), replace=False)
    along = [(found.motors, k, column) for k, column in enumerate(robot.actuated)]
    along += [(found.springs, k, robot.elastic[k]) for k in springs]
    for slopes, k, column in along:

        def moved(step, column=column):
            there = pin.integrate(robot.model, q, step * np.eye(robot.model.nv)[column])
            there, x = closed(robot, there, robot.following)
            try:
                matrices = projector(velocity_matrices(robot, there), robot)
            except InvalidInput:  # rows that repeat others no longer do
                matrices = np.full((robot.n, robot.n_a + robot.n_e), np.nan)
            return np.concatenate([difference(robot, q, there[None])[0], x, matrices.ravel()])

        ours = np.concatenate([slopes.q[:, k], slopes.x[:, k], of_slopes(robot, q, slopes, k).ravel()])
        expected = slope(moved)
        known = ~np.isnan(expected)
        scale = max(np.abs(expected[known]).max(), 1.0)
        np.testing.assert_allclose(
            ours[known], expected[known], rtol=0, atol=1e-7 * scale, err_msg=str(column)
        )


@pytest.mark.parametrize("name", ["three_rpr", pytest.param("delta", marks=pytest.mark.slow)])
def test_geometric_parameters_are_springs_of_their_model(name):
    """Against robots whose files are off, at the same motors."""
    geometry = parametrise_geometry(robots.load(name))
    model, planar = geometry.model, name == "three_rpr"
    found = kinematic_derivatives(model, model.reference.q)
    q_a = model.actuated_coordinates(model.reference.q[None])[0]
    across = (".z", ".rx", ".ry")  # of planar robots' planes: their loops would not close
    kept = [k for k, name in enumerate(geometry.names) if not (planar and name.endswith(across))]
    for k in np.random.default_rng(0).choice(kept, 6, replace=False):

        def built(step, k=k):
            values = step * np.eye(len(geometry.names))[k]
            other = ParallelRobot.from_description(geometry.description(values))
            return forward_kinematics(other, q_a).x

        expected = slope(built)
        scale = max(np.abs(expected).max(), 1.0)
        ours = found.springs.x[:, k]
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-7 * scale, err_msg=geometry.names[k])


def test_with_the_platform_held_the_motors_make_up_for_what_it_would_move(robot):
    """dx/dq_a dq_a + dx/dq_e = 0."""
    found = kinematic_derivatives(robot, robot.reference.q)
    left = found.motors.x @ found.q_a + found.springs.x
    np.testing.assert_allclose(left, 0, atol=1e-10 * np.abs(found.springs.x).max(initial=0.0))


def test_at_type_2_the_motors_do_not_tell_the_pose():
    robot = robots.load("five_bar")
    with pytest.raises(SingularPose, match="Type 2"):
        kinematic_derivatives(robot, assemble(robot, [0.0, np.sqrt(0.06)]).q)
    with pytest.raises(InvalidInput, match="none of them can move"):
        kinematic_derivatives(robots.load("two_arms"), robots.load("two_arms").reference.q)
