"""The witnesses bear witness: they agree with each other, and see what is wrong."""

import numpy as np
import pinocchio as pin

import robots
from framework import plan_scene
from framework.kinematics.frames import frames_at
from tests.oracles.closure_rows import ClosureRows
from tests.oracles.forward_simulation import point_rows, simulate_robot, simulate_tree
from tests.oracles.massless_simulation import massless_directions, simulate_massless

SPIN = np.array([2.0, -3.0, 1.5])  # [rad/s]
TOP = pin.Inertia(1.3, np.array([0.1, 0.05, 0.4]), np.diag([0.02, 0.03, 0.015]))


def top(joint) -> pin.Model:
    model = pin.Model()
    index = model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(index, TOP, pin.SE3.Identity())
    model.addFrame(pin.Frame("point", index, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return model


def test_a_free_body_held_at_a_point_moves_as_on_a_ball_joint():
    """Coordinates that are quaternions, and a closure against the world."""
    times = np.linspace(0.0, 1.0, 5)

    def simulate(model, rows, v0):
        q0, nothing = pin.neutral(model), np.zeros(model.nv)
        options = {"rows": rows, "armature": nothing, "q0": q0, "v0": v0, "times": times}
        return simulate_tree(model, force=lambda t, q: nothing, rtol=1e-11, atol=1e-13, **options)

    ball, free = top(pin.JointModelSpherical()), top(pin.JointModelFreeFlyer())
    ends = [(0, free.getFrameId("point"))]
    held, spin = simulate(ball, lambda data: ClosureRows(np.empty((0, 3)), np.empty(0)), SPIN)
    q, v = simulate(
        free, lambda data: point_rows(free, data, ends, [(0, 1, 2)]), np.append(np.zeros(3), SPIN)
    )
    np.testing.assert_allclose(q[:, :3], 0, atol=1e-10)
    np.testing.assert_allclose(q[:, 3:], held, atol=1e-9)
    np.testing.assert_allclose(v[:, 3:], spin, atol=1e-9)
    data = ball.createData()
    energy = [pin.computeMechanicalEnergy(ball, data, *state) for state in zip(held, spin, strict=True)]
    np.testing.assert_allclose(energy, energy[0], atol=1e-9)
    assert np.abs(spin[-1] - SPIN).max() > 1.0


def test_both_witnesses_agree_where_all_motions_move_masses():
    robot = robots.load("five_bar")
    plan = plan_scene(robot, "A")
    q0, times = plan.dynamics.configuration(np.zeros(1))[0], np.linspace(0.0, plan.duration, 4)
    assert massless_directions(robot, q0).shape == (4, 0)
    options = {"q0": q0, "times": times, "rtol": 1e-10, "atol": 1e-12}
    one = simulate_robot(robot, plan.torque, **options)[0]
    two = simulate_massless(robot, plan.torque, **options)
    np.testing.assert_allclose(two, one, rtol=0, atol=1e-10)


def test_the_witness_sees_a_millionth_of_the_torque():
    robot = robots.load("five_bar")
    plan = plan_scene(robot, "C")
    q0, times = plan.dynamics.configuration(np.zeros(1))[0], [0.0, plan.duration]
    q, _ = simulate_robot(
        robot, lambda t: (1 + 1e-6) * plan.torque(t), q0=q0, times=times, rtol=1e-10, atol=1e-12
    )
    off = robot.platform.coordinates(frames_at(robot, q[-1:]))[0] - plan.platform(plan.duration)
    assert np.abs(off).max() > 1e-7  # the path is 0.2 m long
