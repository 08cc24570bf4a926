"""Forces of the world that are functions of the state, against forces that `simulate` knows otherwise."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, simulate

ROBOT = robots.load("five_bar")
LOADED = {"start_velocity": None, "duration": 0.2, "samples": 5}


def no_torque(t):
    return np.zeros(2)


@pytest.mark.parametrize("method", ["reference", "fast"])
def test_a_force_against_the_rate_of_a_joint_is_its_damping(method):
    robot = ROBOT
    damping = np.zeros(robot.nv)
    column = robot.model.joints[robot.model.getJointId("left_elbow")].idx_v
    damping[column] = 0.2
    options = {"method": method, "step": 1e-3 if method == "fast" else None, **LOADED}
    options["wrenches"] = {"left_tip": [0.0, -3.0, 0.0, 0.0, 0.0, 0.0]}
    damped = simulate(robot, no_torque, damping=damping, **options)
    forced = simulate(robot, no_torque, forces={"left_elbow": lambda t, q, v: -0.2 * v[column]}, **options)
    moved = np.abs(damped.q[-1] - damped.q[0]).max()
    assert moved > 0.01
    tolerance = {"reference": 1e-9, "fast": 1e-2}[method]
    np.testing.assert_allclose(forced.q[-1], damped.q[-1], atol=tolerance * moved)


def test_a_force_on_a_frame_is_an_external_wrench():
    wrench = np.array([1.0, -3.0, 0.0, 0.0, 0.0, 0.1])
    stated = simulate(ROBOT, no_torque, wrenches={"left_tip": wrench}, **LOADED)
    forced = simulate(ROBOT, no_torque, forces={"left_tip": lambda t, q, v: wrench}, **LOADED)
    np.testing.assert_allclose(forced.q[-1], stated.q[-1], atol=1e-9)


def test_a_spring_between_two_points_keeps_the_energy():
    """From the tip to a point of the world, in a level plane: kinetic energy is what the spring has lost."""
    model, data = ROBOT.model, ROBOT.model.createData()
    tip, anchor, stiffness = model.getFrameId("left_tip"), np.array([0.3, 0.1, 0.0]), 40.0

    def stretch(q):
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[tip].translation - anchor

    def pull(t, q, v):
        return np.append(-stiffness * stretch(q), np.zeros(3))

    run = simulate(ROBOT, no_torque, forces={"left_tip": pull}, **LOADED)
    stored = np.array([stiffness / 2 * (stretch(q)[:2] ** 2).sum() for q in run.q])
    mass = [pin.crba(model, data, q).copy() for q in run.q]
    upper = [np.triu(M) + np.triu(M, 1).T for M in mass]
    rotors = np.zeros(ROBOT.nv)
    rotors[ROBOT.actuated] = ROBOT.rotor_inertia * ROBOT.gear_ratio**2
    kinetic = np.array([v @ (M + np.diag(rotors)) @ v / 2 for v, M in zip(run.v, upper, strict=True)])
    assert kinetic[-1] > 0.1 * stored[0]
    np.testing.assert_allclose(kinetic + stored, stored[0], rtol=1e-8)


def test_forces_that_cannot_act_are_refused():
    with pytest.raises(InvalidInput, match="elbo"):
        simulate(ROBOT, no_torque, forces={"elbo": lambda t, q, v: 0.0}, **LOADED)
    with pytest.raises(InvalidInput, match="needs a function"):
        simulate(ROBOT, no_torque, forces={"left_elbow": 1.0}, **LOADED)
    with pytest.raises(InvalidInput, match="left_elbow"):
        simulate(ROBOT, no_torque, forces={"left_elbow": lambda t, q, v: [0.0, 1.0]}, **LOADED)
