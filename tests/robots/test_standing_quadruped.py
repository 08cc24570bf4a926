"""Solo12 on its feet: closed-form legs, statics by virtual work, least torques from Newton's equations.

The witness is the untouched URDF on a free-flyer of pinocchio: no ground link, no root joints, no closures.
"""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import check_robot, plan_scene
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import close_loops
from framework.model.urdf_elements import locate_urdf

ROBOT = "standing_quadruped"
SOLO12 = "package://example-robot-data/robots/solo_description/robots/solo12.urdf"
LEGS = ("FL", "FR", "HL", "HR")
LINK = 0.16  # thigh and shank [m]
WIDTH = 0.014 + 0.03745 + 0.008  # from the axis of the hip to the foot, across [m]
GEAR, ROTOR = 9.0, 1e-5
STAND = np.array([[0.1946, 0.14695, 0], [0.1946, -0.14695, 0], [-0.1946, 0.14695, 0], [-0.1946, -0.14695, 0]])
HIP = np.array([[0.1946, 0.0875, 0], [0.1946, -0.0875, 0], [-0.1946, 0.0875, 0], [-0.1946, -0.0875, 0]])


def leg_angles(x):
    """Hip, thigh and knee (12,) of all legs for the trunk at x, knees bent inward."""
    R = pin.exp3(x[3:])
    found = []
    for leg, stand, hip in zip(LEGS, STAND, HIP, strict=True):
        px, py, pz = R.T @ (stand - x[:3]) - hip
        side = 1.0 if leg[1] == "L" else -1.0
        down = -np.sqrt(py**2 + pz**2 - WIDTH**2)
        roll = np.arctan2(pz, py) - np.arctan2(down, side * WIDTH)
        roll = (roll + np.pi) % (2 * np.pi) - np.pi
        knee = np.arccos((px**2 + down**2 - 2 * LINK**2) / (2 * LINK**2)) * (-1 if leg[0] == "F" else 1)
        found += [roll, np.arctan2(-px, -down) - knee / 2, knee]
    return np.array(found)


class Witness:
    """The untouched URDF, flying freely."""

    def __init__(self):
        file = locate_urdf(robots.CATALOGUE["standing_quadruped"].file.parent, SOLO12)
        self.model = pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        self.legs = [
            self.model.joints[self.model.getJointId(f"{leg}_{joint}")].idx_v
            for leg in LEGS
            for joint in ("HAA", "HFE", "KFE")
        ]
        self.feet = [self.model.getFrameId(f"{leg}_FOOT", pin.FrameType.BODY) for leg in LEGS]

    def configuration(self, x, q_a):
        q = pin.neutral(self.model)
        q[:3], q[3:7] = x[:3], pin.Quaternion(pin.exp3(x[3:])).coeffs()
        q[np.array(self.legs) + 1] = q_a
        return q

    def foot_jacobians(self, q):
        """(12, 18) velocities of the four feet, base axes."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.vstack([pin.getFrameJacobian(self.model, self.data, f, axes)[:3] for f in self.feet])

    def foot_drifts(self, q, v):
        """(12,) accelerations of the feet without any of the coordinates, base axes."""
        pin.forwardKinematics(self.model, self.data, q, v, 0 * v)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        found = [pin.getFrameClassicalAcceleration(self.model, self.data, f, axes) for f in self.feet]
        return np.concatenate([acceleration.linear for acceleration in found])


@pytest.fixture(scope="module")
def witness():
    return Witness()


@pytest.fixture(scope="module")
def plan(robot):
    return plan_scene(robot, "lower")


def poses(count):
    spread = np.array([0.04, 0.04, 0.03, 0.15, 0.15, 0.25])
    return [0, 0, 0.2, 0, 0, 0] + spread * np.random.default_rng(3).uniform(-1, 1, (count, 6))


def test_mobility(robot):
    found = check_robot(robot)
    assert (found.mobility, found.redundant_motors, found.rank, found.redundant_rows) == (6, 6, 12, ())
    assert found.square
    assert any("least norm" in advice for advice in found.advice)
    assert found.closure_error < 1e-15
    assert len(robot.loops.names) == 12


def test_the_urdf_of_somebody_else_keeps_its_mass(robot, witness):
    assert pin.computeTotalMass(robot.model) == pytest.approx(pin.computeTotalMass(witness.model), rel=1e-15)


def test_legs_have_their_closed_form(robot):
    for x in poses(20):
        q = close_loops(robot, x[None], robot.q_near[None]).q[0]
        np.testing.assert_allclose(q[robot.actuated], leg_angles(x), rtol=0, atol=1e-12)
        np.testing.assert_allclose(robot.platform.coordinates(frames_at(robot, q[None]))[0], x, atol=1e-14)


def test_forward_and_inverse_kinematics_agree(robot, witness):
    """The closed-form angles put the feet of the untouched URDF on their stands."""
    for x in poses(5):
        pin.framesForwardKinematics(witness.model, witness.data, witness.configuration(x, leg_angles(x)))
        for foot, stand in zip(witness.feet, STAND, strict=True):
            np.testing.assert_allclose(witness.data.oMf[foot].translation, stand, atol=1e-12)


def test_standing_still_the_feet_carry_the_weight(plan, witness):
    """From the torques of each leg the force on its foot; together they hold the robot up."""
    for t in (0.0, plan.duration):
        q = witness.configuration(plan.platform(t), plan.motor_angle(t) / GEAR)
        gravity = pin.computeGeneralizedGravity(witness.model, witness.data, q)[witness.legs]
        J = witness.foot_jacobians(q)[:, witness.legs]
        force = np.linalg.solve(J.T, gravity - GEAR * plan.torque(t)).reshape(4, 3)
        weight = 9.81 * pin.computeTotalMass(witness.model)
        centre = pin.centerOfMass(witness.model, witness.data, q)
        np.testing.assert_allclose(force.sum(axis=0), [0, 0, weight], atol=1e-11)
        moment = np.cross(STAND - centre, force).sum(axis=0)
        np.testing.assert_allclose(moment, 0, atol=1e-11)
        assert np.all(force[:, 2] > 0)  # no foot pulls


def test_torques_are_the_least_that_satisfy_newton(robot, plan, witness):
    """Inverse dynamics of the free-flyer, feet held: J' tau = r with the least |tau|, at all instants."""
    for t in np.linspace(0.0, plan.duration, 9):
        x, dx, ddx = (plan.platform(t, order)[None] for order in range(3))
        q = witness.configuration(x[0], plan.motor_angle(t) / GEAR)
        twist, dtwist = (part[0] for part in robot.platform.twist(x, dx, ddx))
        R = pin.exp3(x[0, 3:])
        v, a = np.zeros(18), np.zeros(18)
        v[:6] = np.concatenate([R.T @ twist[:3], R.T @ twist[3:]])
        a[:6] = np.concatenate([R.T @ dtwist[:3] - np.cross(v[3:6], v[:3]), R.T @ dtwist[3:]])
        J = witness.foot_jacobians(q)
        follow = -np.linalg.solve(J[:, witness.legs], J[:, :6])  # leg rates of a trunk twist, (12, 6)
        v[witness.legs] = follow @ v[:6]
        drift = witness.foot_drifts(q, v) + J[:, :6] @ a[:6]
        a[witness.legs] = -np.linalg.solve(J[:, witness.legs], drift)
        np.testing.assert_allclose(plan.motor_angle(t, 1) / GEAR, v[witness.legs], atol=1e-9)
        np.testing.assert_allclose(plan.motor_angle(t, 2) / GEAR, a[witness.legs], atol=1e-6)
        r = pin.rnea(witness.model, witness.data, q, v, a)
        wanted = r[:6] + follow.T @ r[witness.legs]
        least = np.linalg.pinv(follow.T) @ wanted
        torque = GEAR * (plan.torque(t) - ROTOR * GEAR * a[witness.legs])
        np.testing.assert_allclose(follow.T @ torque, wanted, atol=1e-10)
        np.testing.assert_allclose(torque, least, atol=1e-10)
