"""Baxter with a box in both hands: two serial arms of the untouched URDF and the box alone are the witness.

No closure, no locked joint and no box in that URDF: here they are Jacobians, a value and Newton's equations.
"""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import check_robot, plan_scene
from framework.kinematics.inverse_kinematics import close_loops
from framework.model.urdf_elements import locate_urdf

ROBOT = "two_arms"
BAXTER = "package://example-robot-data/robots/baxter_description/urdf/baxter.urdf"
JOINTS = ("s0", "s1", "e1", "w0", "w1", "w2")
LOCKED = {"left_e0": -0.5, "right_e0": 0.5}
FINGERS = {f"{side}_gripper_{k}_finger_joint": 0.01 * s for side in "lr" for k, s in (("l", 1), ("r", -1))}
MASS, INERTIA = 2.0, np.diag([0.0333, 0.0133, 0.0333])
GEAR, ROTOR = 100.0, np.tile([1e-5, 1e-5, 1e-5, 2e-6, 2e-6, 2e-6], 2)
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
G = np.array([0, 0, -9.81])


class Witness:
    """Two arms; `hold` are frames at the box's centre, one for each hand."""

    def __init__(self):
        folder = robots.CATALOGUE["two_arms"].file.parent
        self.model = pin.buildModelFromUrdf(str(locate_urdf(folder, BAXTER)))
        self.arms = [
            [self.model.joints[self.model.getJointId(f"{side}_{joint}")].idx_v for joint in JOINTS]
            for side in ("left", "right")
        ]
        turned = np.diag([-1.0, 1.0, -1.0])
        self.hold = []
        for side, across in (("left", -0.2), ("right", 0.2)):
            hand = self.model.frames[self.model.getFrameId(f"{side}_gripper", pin.FrameType.BODY)]
            place = hand.placement * pin.SE3(turned, np.array([0, across, 0.1]))
            frame = pin.Frame(f"{side}_centre", hand.parentJoint, place, pin.FrameType.OP_FRAME)
            self.hold.append(self.model.addFrame(frame))
        self.data = self.model.createData()

    def configuration(self, q_a):
        q = pin.neutral(self.model)
        for name, value in {**LOCKED, **FINGERS}.items():
            q[self.model.joints[self.model.getJointId(name)].idx_q] = value
        q[np.ravel(self.arms)] = q_a
        return q

    def box(self, q):
        """Placement of the box as each hand has it."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return [self.data.oMf[frame].copy() for frame in self.hold]

    def jacobians(self, q):
        """(6, 6) from the rates of an arm to the twist of the box, base axes."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        pairs = zip(self.hold, self.arms, strict=True)
        return [pin.getFrameJacobian(self.model, self.data, frame, WORLD)[:, arm] for frame, arm in pairs]

    def drifts(self, q, v):
        """(6,) accelerations of the box without those of the joints."""
        pin.forwardKinematics(self.model, self.data, q, v, 0 * v)
        return [
            pin.getFrameClassicalAcceleration(self.model, self.data, frame, WORLD).vector
            for frame in self.hold
        ]


@pytest.fixture(scope="module")
def witness():
    return Witness()


@pytest.fixture(scope="module")
def plan(robot):
    return plan_scene(robot, "turn")


def poses(count):
    spread = np.array([0.03, 0.05, 0.06, 0.15, 0.15, 0.25])
    return [0.57, 0, 0.15, 0, 0, 0] + spread * np.random.default_rng(4).uniform(-1, 1, (count, 6))


def test_mobility(robot):
    found = check_robot(robot)
    assert (found.mobility, found.redundant_motors, found.rank, found.redundant_rows) == (6, 6, 6, ())
    assert found.square
    assert found.passive_joints == ()
    assert found.smallest_singular_value is None
    assert found.closure_error < 1e-14


def test_only_the_box_is_added_to_the_urdf(robot, witness):
    masses = [pin.computeTotalMass(model) for model in (robot.model, witness.model)]
    # what no joint carries (torso, head on its locked neck) belongs to the base and is not counted
    neck = witness.model.inertias[witness.model.getJointId("head_pan")].mass
    assert masses[0] == pytest.approx(masses[1] - neck + MASS, abs=1e-12)


def test_both_hands_of_the_untouched_urdf_agree_about_the_box(robot, witness):
    """Locked joints at their values, mimic fingers dropped, frames where they should be."""
    for x in poses(12):
        q = close_loops(robot, x[None], robot.q_near[None]).q[0]
        for place in witness.box(witness.configuration(q[robot.actuated])):
            np.testing.assert_allclose(place.translation, x[:3], atol=1e-12)
            np.testing.assert_allclose(place.rotation, pin.exp3(x[3:]), atol=1e-12)


def test_joints_stay_within_their_limits(robot):
    for name in robot.description.scenes:
        plan = plan_scene(robot, name)
        t = np.linspace(0.0, plan.duration, 60)
        angle, speed, torque = (
            plan.motor_angle(t) / GEAR,
            plan.motor_angle(t, 1) / GEAR,
            GEAR * plan.torque(t),
        )
        model, a = robot.model, robot.actuated
        assert np.all(angle > model.lowerPositionLimit[a])
        assert np.all(angle < model.upperPositionLimit[a])
        assert np.all(np.abs(speed) < model.velocityLimit[a])
        assert np.all(np.abs(torque) < model.effortLimit[a])


def test_torques_are_the_least_that_satisfy_newton(robot, plan, witness):
    for t in np.linspace(0.0, plan.duration, 9):
        x, dx, ddx = (plan.platform(t, order)[None] for order in range(3))
        twist, dtwist = (part[0] for part in robot.platform.twist(x, dx, ddx))
        q = witness.configuration(plan.motor_angle(t) / GEAR)
        v, a = np.zeros(witness.model.nv), np.zeros(witness.model.nv)
        jacobians = witness.jacobians(q)
        follow = np.vstack([np.linalg.inv(J) for J in jacobians])  # joint rates of a twist of the box (12, 6)
        columns = np.ravel(witness.arms)
        v[columns] = follow @ twist
        for arm, J, drift in zip(witness.arms, jacobians, witness.drifts(q, v), strict=True):
            a[arm] = np.linalg.solve(J, dtwist - drift)
        np.testing.assert_allclose(plan.motor_angle(t, 1) / GEAR, v[columns], atol=1e-9)
        np.testing.assert_allclose(plan.motor_angle(t, 2) / GEAR, a[columns], atol=1e-6)
        R, omega, alpha = pin.exp3(x[0, 3:]), twist[3:], dtwist[3:]
        inertia = R @ INERTIA @ R.T
        turning = inertia @ alpha + np.cross(omega, inertia @ omega)
        box = np.concatenate([MASS * (dtwist[:3] - G), turning])
        tree = pin.rnea(witness.model, witness.data, q, v, a) + witness.model.damping * v
        wanted = box + follow.T @ tree[columns]
        torque = GEAR * (plan.torque(t) - ROTOR * GEAR * a[columns])
        np.testing.assert_allclose(follow.T @ torque, wanted, atol=1e-10)
        np.testing.assert_allclose(torque, np.linalg.pinv(follow.T) @ wanted, atol=1e-10)
