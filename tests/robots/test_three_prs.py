"""One translation and two rotations: a 3-PRS (tests/data/three_prs) against its closed form.

A ball at r (cos f, sin f, 0) of the platform stays in the plane of its leg, the one of direction f. Of
three legs at 120 degrees that asks, with P the platform's centre and R its attitude,

    R_xy = R_yx,    P_x = r / 2 (R_xx - R_yy),    P_y = -r R_yx,

so with R = Ry(t) Rx(p) Rz(z) the parasitic turn is tan z = sin p sin t / (cos p + cos t) (Carretero et al.
2000), and each slide is below its ball by the rest of the rod. Derivatives of it by complex steps.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from framework import (
    ParallelRobot,
    assemble,
    dynamics_at,
    forward_kinematics,
    plan_scene,
    simulate,
    velocity_matrices,
)
from framework.kinematics.frames import frames_at

FILE = Path(__file__).parents[1] / "data" / "three_prs" / "three_prs.yaml"
BASE, CORNER, ROD, GEAR = 0.4, 0.2, 0.5, 2 * np.pi / 0.01
LEGS = np.radians([0.0, 120.0, 240.0])


@pytest.fixture(scope="module")
def robot():
    return ParallelRobot.from_file(FILE)


def attitude(t, p):
    """R (3, 3) of the platform for pitch t and roll p; complex ones too."""
    z = np.arctan(np.sin(p) * np.sin(t) / (np.cos(p) + np.cos(t)))
    about_y = np.array([[np.cos(t), 0, np.sin(t)], [0, 1, 0], [-np.sin(t), 0, np.cos(t)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    return about_y @ about_x @ about_z


def centre(x):
    R = attitude(x[1], x[2])
    return np.array([CORNER / 2 * (R[0, 0] - R[1, 1]), -CORNER * R[1, 0], x[0]])


def slides(x):
    """Heights (3,) of the slides for x = (z, pitch, roll)."""
    corners = CORNER * np.array([np.cos(LEGS), np.sin(LEGS), 0 * LEGS])
    balls = centre(x)[:, None] + attitude(x[1], x[2]) @ corners
    out = balls[0] * np.cos(LEGS) + balls[1] * np.sin(LEGS)
    return balls[2] - np.sqrt(ROD**2 - (BASE - out) ** 2)


def derivative(function, x):
    h = 1e-30
    return np.stack([np.imag(function(x + 1j * h * axis)) / h for axis in np.eye(3)], axis=-1)


def poses(count):
    spread = np.random.default_rng(1).uniform(-1, 1, (count, 3))
    return [0.45, 0.0, 0.0] + [0.1, 0.4, 0.4] * spread


def test_motors_attitude_and_parasitic_motion_have_their_closed_form(robot):
    for x in poses(20):
        q = assemble(robot, x).q
        np.testing.assert_allclose(robot.actuated_coordinates(q[None])[0], slides(x), atol=1e-12)
        at = frames_at(robot, q[None])
        np.testing.assert_allclose(at.rotation[0, 0], attitude(x[1], x[2]), atol=1e-12)
        np.testing.assert_allclose(at.position[0, 0], centre(x), atol=1e-12)
        back = forward_kinematics(robot, slides(x), near=robot.reference.q)
        np.testing.assert_allclose(back.x, x, atol=1e-11)


def test_A_and_B_are_the_derivative_of_the_closed_form(robot):
    for x in poses(10):
        A, B, _ = velocity_matrices(robot, assemble(robot, x).q)
        np.testing.assert_allclose(np.linalg.solve(B, A), derivative(slides, x), atol=1e-11)


def test_accelerations_are_those_of_the_closed_form(robot):
    rng = np.random.default_rng(3)
    h = 1e-5
    for x in poses(4):
        dx, ddx = rng.standard_normal((2, 3))
        here = dynamics_at(robot, assemble(robot, x).q, dx=dx, ddx=ddx)
        rate = derivative(slides, x)
        curve = (derivative(slides, x + h * dx) - derivative(slides, x - h * dx)) @ dx / (2 * h)
        np.testing.assert_allclose(here.v[robot.actuated], rate @ dx, atol=1e-11)
        np.testing.assert_allclose(here.a[robot.actuated], rate @ ddx + curve, atol=1e-7)


def test_the_motors_hold_a_wrench_by_virtual_work_of_the_closed_form(robot):
    """(force, moment) on the platform, over the twist of all six: the parasitic motion takes part."""
    rng = np.random.default_rng(4)
    for x in poses(4):
        q = assemble(robot, x).q
        wrench = 10 * rng.standard_normal(6)
        loaded = dynamics_at(robot, q, wrenches={"platform": wrench}).torque - dynamics_at(robot, q).torque
        R = attitude(x[1], x[2])
        turned = derivative(lambda at: attitude(at[1], at[2]), x)  # (3, 3, 3)
        about = np.einsum("ijk,lj->ilk", turned, R)
        omega = np.array([about[2, 1], about[0, 2], about[1, 0]])
        generalised = derivative(centre, x).T @ wrench[:3] + omega.T @ wrench[3:]
        expected = -np.linalg.solve(derivative(slides, x).T, generalised) / GEAR
        np.testing.assert_allclose(loaded, expected, atol=1e-12)


def test_power_of_the_motors_is_the_rate_of_energy_of_the_closed_form(robot):
    plan = plan_scene(robot, "tilt")
    t = np.linspace(0, plan.duration, 41)
    h = 1e-4
    model, data = robot.model, robot.model.createData()

    def energy(times):
        q, v = plan.configuration(times), plan.velocity(times)
        stored = [
            pin.computeKineticEnergy(model, data, a, b) + pin.computePotentialEnergy(model, data, a)
            for a, b in zip(q, v, strict=True)
        ]
        return np.array(stored) + 0.5 * plan.motor_angle(times, 1) ** 2 @ robot.rotor_inertia

    inside = t[1:-1]
    rate = (energy(inside + h) - energy(inside - h)) / (2 * h)
    power = np.sum(plan.torque(inside) * plan.motor_angle(inside, 1), axis=1)
    np.testing.assert_allclose(power, rate, atol=1e-6 * np.abs(power).max() + 1e-6)
    assert simulate(robot, plan).tracking_error < 1e-9
