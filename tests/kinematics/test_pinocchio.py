"""Robots of models in memory, and their loops as constraints, against pinocchio's own dynamics."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import (
    InvalidInput,
    Line,
    ParallelRobot,
    dynamics_at,
    forward_dynamics,
    forward_kinematics,
    plan_crossing,
)

CLOSED_BY_POINTS_AND_POSES = [
    "five_bar_heavy",
    "delta",
    "humanoid_ankle",
    "biglide",
    "gough_stewart",
]


def constrained_acceleration(robot: ParallelRobot, q: Any, v: Any, torque: Any) -> Any:
    """The acceleration by pinocchio's proximal constraint dynamics, rotors as armature."""
    model = pin.Model(robot.model)
    model.armature += robot.rotors
    constraints = pin.StdVec_RigidConstraintModel()
    datas = pin.StdVec_RigidConstraintData()
    for constraint in robot.constraint_models():
        constraints.append(constraint)
        datas.append(constraint.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, constraints, datas)
    forces = np.zeros(model.nv)
    forces[robot.actuated] = robot.gear_ratio * torque
    forces -= robot.joint_damping * v
    settings = pin.ProximalSettings(1e-13, 1e-9, 40)
    return pin.constraintDynamics(model, data, q, v, forces, constraints, datas, settings)


def moving_state(robot: ParallelRobot) -> tuple[Any, Any, Any]:
    """q and v of a motion of the closed robot beside its reference, and motor torques."""
    rng = np.random.default_rng(3)
    dx = rng.normal(size=robot.n) * robot.platform_scale
    instant = dynamics_at(robot, robot.reference.q, dx=dx)
    return robot.reference.q, instant.v, rng.normal(size=robot.n_a) * np.abs(instant.torque).max()


def hand_made(swapped: bool = False) -> tuple[pin.Model, dict[str, Any]]:
    """A planar five-bar of hand-made joints, siblings not in the order of the alphabet."""
    model = pin.Model()
    names = ["b", "a"] if swapped else ["a", "b"]
    for name, x in zip(names, (0.2, -0.2), strict=True):
        crank = model.addJoint(
            0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), f"{name}_motor"
        )
        rod = model.addJoint(crank, pin.JointModelRevoluteUnaligned(0.0, 0.0, 1.0), at(0.25), f"{name}_elbow")
        for joint, length in ((crank, 0.25), (rod, 0.3)):
            body = pin.Inertia(0.7, np.array([length / 2, 0.0, 0.0]), np.diag([1e-4, 5e-3, 5e-3]))
            model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_tip", rod, at(0.3), pin.FrameType.OP_FRAME))
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    model.armature[:] = 1e-3
    return model, dict.fromkeys(names, 1.0)


def at(x: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))


REFERENCE = [1.345, 1.249, 1.796, -1.249]  # of the leg on the right, then of the one on the left
ASKED: dict[str, Any] = {
    "actuators": ["a_motor", {"joint": "b_motor", "gear_ratio": 3.0, "rotor_inertia": 2e-4}],
    "platform": {"frame": "a_tip", "axes": ["x", "y"]},
    "reference": REFERENCE,
}


@pytest.mark.parametrize("swapped", [False, True])
def test_a_model_in_memory_keeps_the_order_of_its_joints_and_its_dynamics(swapped: bool) -> None:
    model, _ = hand_made(swapped)
    loop = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D, model, 2, at(0.3), 4, at(0.3), pin.ReferenceFrame.LOCAL
    )
    robot = ParallelRobot.from_pinocchio(model, [loop], **ASKED)
    assert list(robot.model.names) == list(model.names)
    q, v, torque = moving_state(robot)
    np.testing.assert_allclose(
        pin.crba(robot.model, robot.model.createData(), q), crba_of(model, q), atol=1e-15
    )
    expected = constrained_acceleration(robot, q, v, torque)
    np.testing.assert_allclose(
        forward_dynamics(robot, q, v, torque).a, expected, rtol=0, atol=1e-10 * np.abs(expected).max()
    )
    # the same robot by frames in words, and its reference as q of the model
    same = ParallelRobot.from_pinocchio(model, [("a_tip", "b_tip")], **ASKED | {"reference": q})
    np.testing.assert_allclose(same.reference.q, q, atol=1e-12)
    assert robot.name == "robot"
    model.name = "two_legs"
    assert ParallelRobot.from_pinocchio(model, [loop], **ASKED).name == "two_legs"
    assert ParallelRobot.from_pinocchio(model, [loop], **ASKED, name="mine").name == "mine"
    x = robot.reference.x
    assert plan_crossing(same, Line(x, x + 0.01), duration=1.0).certificate.tail < 1e-10


def crba_of(model: pin.Model, q: Any) -> Any:
    return pin.crba(model, model.createData(), q)


@pytest.mark.parametrize("name", CLOSED_BY_POINTS_AND_POSES)
def test_pinocchio_s_constraint_dynamics_is_ours(name: str) -> None:
    robot = robots.load(name)
    q, v, torque = moving_state(robot)
    ours = forward_dynamics(robot, q, v, torque).a
    theirs = constrained_acceleration(robot, q, v, torque)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10 * np.abs(theirs).max())


def test_a_robot_goes_to_pinocchio_and_back() -> None:
    robot = robots.load("five_bar_heavy")
    back = ParallelRobot.from_pinocchio(
        robot.model,
        robot.constraint_models(),
        [{"joint": name, "gear_ratio": 50} for name in robot.actuator_names],
        {"frame": "left_tip", "axes": ["x", "y"]},
        reference=robot.reference.q,
    )
    np.testing.assert_allclose(back.reference.x, robot.reference.x, atol=1e-12)
    q_a = robot.reference.q[robot.actuated] + 0.01
    np.testing.assert_allclose(forward_kinematics(back, q_a).q, forward_kinematics(robot, q_a).q, atol=1e-10)


def test_a_plan_of_a_model_in_memory_is_not_saved_without_a_robot_file(tmp_path: Path) -> None:
    model, _ = hand_made()
    robot = ParallelRobot.from_pinocchio(model, [("a_tip", "b_tip")], **ASKED)
    start = robot.reference.x
    plan = plan_crossing(robot, Line(start, start + 0.01), duration=1.0)
    with pytest.raises(InvalidInput, match=r"robot: only a robot of a file .*plan\.to_csv"):
        plan.save(tmp_path / "plan")
    assert not (tmp_path / "plan").exists()
    plan.to_csv(tmp_path / "motion.csv")
    assert (tmp_path / "motion.csv").exists()


def test_what_pinocchio_or_a_robot_cannot_hold_is_refused() -> None:
    model, _ = hand_made()
    for closures, error, words in (
        ([("a_tip", "c_tip")], InvalidInput, "c_tip.*did you mean"),
        ([("a_tip", "b_tip", "sperical")], InvalidInput, "did you mean 'spherical'"),
        (["a_tip"], InvalidInput, r"closures\[0\].*two frames and a kind"),
        ([("a_tip",)], InvalidInput, r"closures\[0\].*two frames and a kind"),
    ):
        with pytest.raises(error, match=words):
            ParallelRobot.from_pinocchio(model, closures, **ASKED)
    open_tree = ParallelRobot.from_pinocchio(model, [], **ASKED)
    assert open_tree.rows.names == ()
    with pytest.raises(InvalidInput, match=r"0 independent loop equations.*as many platform axes as degrees"):
        plan_crossing(open_tree, Line([0.1, 0.345], [-0.05, 0.195]), duration=1.0)
    with pytest.raises(InvalidInput, match="reference, the model's q, must be 4 finite numbers"):
        ParallelRobot.from_pinocchio(model, [("a_tip", "b_tip")], **ASKED | {"reference": [0.0]})
    model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "cart")
    with pytest.raises(InvalidInput, match="'cart' is a Planar"):
        ParallelRobot.from_pinocchio(model, [("a_tip", "b_tip")], **ASKED)
    with pytest.raises(InvalidInput, match=r"loop .* locks .*points and poses"):
        robots.load("orthoglide").constraint_models()


def test_visuals_stand_where_pinocchio_s_reader_puts_them() -> None:
    robot = robots.load("five_bar_heavy")
    theirs = pin.buildGeomFromUrdfString(robot.model, robot.description.urdf_text, pin.GeometryType.VISUAL)
    ours = robot.visual_model
    assert len(ours.geometryObjects) == len(theirs.geometryObjects)
    for a, b in zip(ours.geometryObjects, theirs.geometryObjects, strict=True):
        assert a.parentJoint == b.parentJoint
        np.testing.assert_allclose(a.placement.homogeneous, b.placement.homogeneous, atol=1e-12)
