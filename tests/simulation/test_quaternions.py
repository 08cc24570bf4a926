"""Joints whose configuration is a quaternion: a plate on a ball at the tip of a driven arm.

Robot files have no such joints; models made by hand may. The plate is a free body that a loop pins to
the arm; the witness is a tree with a ball joint there, integrated with pinocchio's articulated body
algorithm.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import robots
from framework import Mechanism, ParallelRobot, simulate
from framework.model.description import Actuator, Closure, Platform
from framework.model.loop_rows import locked_directions, loop_rows
from framework.simulation import Stepper

ARM = pin.Inertia(1.0, np.array([0.2, 0, 0]), np.diag([0.01, 0.02, 0.02]))
PLATE = pin.Inertia(
    2.0,
    np.array([0.1, 0.05, -0.2]),
    np.array([[0.03, 0.002, 0.001], [0.002, 0.02, -0.003], [0.001, -0.003, 0.04]]),
)
TIP = pin.SE3(np.eye(3), np.array([0.4, 0.0, 0.0]))
ROTOR, GEAR, DURATION = 1e-4, 10.0, 0.5


def torque(t):
    return 0.3 * np.sin(5 * t)


def arm_and(joint_of_plate, parent: str) -> pin.Model:
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "motor")
    model.appendBodyToJoint(arm, ARM, pin.SE3.Identity())
    base, place = (arm, TIP) if parent == "arm" else (0, pin.SE3.Identity())
    plate = model.addJoint(base, joint_of_plate, place, "plate")
    model.appendBodyToJoint(plate, PLATE, pin.SE3.Identity())
    for name, joint, at in (("tip", arm, TIP), ("ball", plate, pin.SE3.Identity())):
        model.addFrame(pin.Frame(name, joint, 0, at, pin.FrameType.OP_FRAME))
    return model


@pytest.fixture(scope="module")
def robot() -> ParallelRobot:
    model = arm_and(pin.JointModelFreeFlyer(), "base")
    start = pin.neutral(model)
    start[1:4] = TIP.translation
    names = ["tip", "ball"]
    closures = (Closure("ball", ("tip", "ball"), ("x", "y", "z")),)
    like = Mechanism.of(robots.load("four_bar"))
    description = replace(
        like.description,
        reference={},
        platform=Platform("tip", ("x", "y", "z")),
        actuators=(Actuator("motor", gear_ratio=GEAR, rotor_inertia=ROTOR),),
        closures=closures,
    )
    return ParallelRobot.of(
        replace(
            like,
            description=description,
            model=model,
            joint_stiffness=np.zeros(7),
            joint_rest=np.zeros(7),
            joint_damping=np.zeros(7),
            joint_friction=np.zeros(7),
            frames=tuple(model.getFrameId(name) for name in names),
            rows=loop_rows(closures, names),
            directions=locked_directions(closures, names),
            q_near=start,
            length=0.4,
        )
    )


@pytest.fixture(scope="module")
def witness():
    """Arm angle and centre of the plate at the end."""
    model = arm_and(pin.JointModelSpherical(), "arm")
    model.armature[0] = GEAR**2 * ROTOR
    data, origin = model.createData(), pin.neutral(model)

    def slope(t, y):
        q, v = pin.integrate(model, origin, y[:4]), y[4:]
        force = np.zeros(4)
        force[0] = GEAR * torque(t)
        rate = np.concatenate([v[:1], pin.Jlog3(pin.exp3(y[1:4])) @ v[1:]])
        return np.concatenate([rate, pin.aba(model, data, q, v, force)])

    end = solve_ivp(slope, (0, DURATION), np.zeros(8), "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    pin.framesForwardKinematics(model, data, pin.integrate(model, origin, end[:4]))
    return end[0], data.oMi[2].act(PLATE.lever)


@pytest.mark.parametrize(("method", "apart"), [("reference", 1e-10), ("stiff", 1e-6), ("fast", 1e-5)])
def test_a_plate_on_a_ball(robot, witness, method, apart):
    result = simulate(robot, lambda t: [torque(t)], duration=DURATION, method=method)
    angle, centre = witness
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, result.q[-1])
    assert np.ptp(result.q[:, 0]) > 0.1
    assert result.q[-1, 0] == pytest.approx(angle, abs=apart)
    np.testing.assert_allclose(data.oMi[2].act(PLATE.lever), centre, atol=apart)
    np.testing.assert_allclose(np.linalg.norm(result.q[:, 4:], axis=1), 1.0, atol=1e-12)
    assert result.closure_error < apart
    assert result.energy_error < 100 * apart  # velocities of collocation are of lower order


@pytest.mark.parametrize("scheme", ["midpoint", "extrapolated"])
def test_fixed_steps_on_the_manifold_are_of_second_order(robot, witness, scheme):
    stepper, off = Stepper.of(robot, scheme=scheme), []
    for count in (200, 400):
        h, state = DURATION / count, stepper.start(robot.q_near)
        for k in range(count):
            state = stepper.step(*state, np.array([torque((k + 0.5) * h)]), h)
        off.append(abs(state.q[0] - witness[0]))
    assert off[0] / off[1] > 3.5
    assert off[1] < 2e-4
