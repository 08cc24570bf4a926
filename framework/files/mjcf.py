"""A robot as MuJoCo's model: the open tree with its springs, the loops as equalities between sites.

Joints keep their names, axes and zeros, armature, damping, dry friction and springs; the frames of the
platform and of the loops become sites. A rotor adds the armature gear ratio^2 times its inertia, a motor is
an actuator of that gear whose control is its torque, a spring of the robot a joint with stiffness. Loops and
couplings of joints are equalities. MuJoCo wants mass in each body that moves: where the robot has none,
MIN_MASS and MIN_INERTIA stand in. Bodies have no shape.

A loop is closed by points that coincide, MuJoCo's `connect`: one, two on a hinge's axis, three of a weld. Any
other closure is written as the first of these that locks its axes and more, if the robot cannot move along
the axes that are added. That is tested at random configurations beside the reference, springs deflected; as
the loop equations are analytic, it then holds everywhere on that branch, but for chance. Rods of a
parallelogram that lock two axes for the sake of few equations are points that coincide in this way.

A torque limit is the range of a motor's control and force, which MuJoCo keeps. The URDF's range of a joint is
its range, which MuJoCo keeps by forces of its own; a range without the reference is left out
(`ranges_left_out`). MuJoCo knows no speed limit: `<custom>` passes it on, `JOINT_speed_limit` [rad/s],
motor side.

Source: MuJoCo's documentation, chapter "XML Reference". Loops are as hard as the step allows.
"""

from __future__ import annotations

from dataclasses import replace
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.assembly import nearby_configurations
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import is_ball, positions_beyond_limits
from framework.model.description import Closure, locked_axes
from framework.model.loop_rows import loop_rows
from framework.model.urdf_edits import AXIS, vector_text
from framework.numerics.arrays import Array

MIN_MASS, MIN_INERTIA = 1e-9, 1e-12  # [kg], [kg m^2] of bodies without; MuJoCo refuses less than 1e-15
TIME_STEP = 1e-3  # [s]
START = (
    "start from the keyframe `reference`, where the loops are closed: "
    "mj_resetDataKeyframe(model, data, 0); at zero they are torn"
)
HARD = "0.9999 0.9999 0.001 0.5 2"  # solimp: what is nearest to a rigid loop
CLOSING_POINT_DISTANCE = 0.1  # robot lengths between the points that close a hinge or a weld


def mjcf_text(robot: ParallelRobot, *, hinges: bool = False) -> str:
    """Return the robot as MJCF.

    The keyframe `reference` is its assembled reference.

    With `hinges` a ball J becomes three, J_hinge_x, J_hinge_y and J_hinge_z, for programs that know no balls:
    turns about the axes of its body, one after the other, all zero in the reference. Where the second is at
    a right angle, the other two are about one line.

    Raises:
        InvalidInput: a loop that MuJoCo has no equality for, see `equality_axes`; a ball with a spring, whose
            torque `hinges` in turn do not have, or without them one with other dynamics about each axis.
    """
    root = Element("mujoco", model=robot.name)
    root.append(Comment(f" {START} "))
    SubElement(root, "compiler", angle="radian", autolimits="false")
    SubElement(
        root,
        "option",
        timestep=repr(TIME_STEP),
        gravity=vector_text(robot.model.gravity.linear),
        integrator="implicitfast",
    )
    bodies = [SubElement(root, "worldbody")]
    q, data = robot.reference.q, robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, np.zeros(robot.model.nv))
    for j in range(1, robot.model.njoints):
        bodies.append(_add_body(robot, data, j, bodies[robot.model.parents[j]], hinges=hinges))
    _add_loops(robot, root, bodies)
    _add_motors(robot, root)
    keys = SubElement(root, "keyframe")
    qpos = vector_text(convert_to_qpos(robot.model, q, hinges=hinges))
    SubElement(keys, "key", name="reference", qpos=qpos)
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def convert_to_qpos(model: pin.Model, q: Array, *, hinges: bool = False) -> Array:
    """Convert q (nq,) to MuJoCo's order: balls by real part first, or hinges at 0."""
    parts = []
    for joint in list(model.joints)[1:]:
        part = q[joint.idx_q : joint.idx_q + joint.nq]
        if is_ball(joint):
            part = np.zeros(3) if hinges else np.roll(part, 1)
        parts.append(part)
    return np.concatenate(parts)


def ranges_left_out(robot: ParallelRobot) -> tuple[str, ...]:
    """Return the joints whose range is not written, as the reference is outside."""
    return tuple(positions_beyond_limits(robot.limits, robot.reference.q[None]))


def _add_motors(robot: ParallelRobot, root: Element) -> None:
    """Add an actuator for each motor, controlled by its torque [N m], motor side."""
    actuator = SubElement(root, "actuator")
    speeds = Element("custom")
    for motor in robot.description.actuators:
        words = {"name": f"{motor.joint}_torque", "joint": motor.joint, "gear": repr(float(motor.gear_ratio))}
        if motor.torque_limit is not None:
            limit = vector_text([-motor.torque_limit, motor.torque_limit])
            words |= {"ctrllimited": "true", "ctrlrange": limit, "forcelimited": "true", "forcerange": limit}
        SubElement(actuator, "motor", words)
        if motor.speed_limit is not None:
            words = {"name": f"{motor.joint}_speed_limit", "data": repr(float(motor.speed_limit))}
            SubElement(speeds, "numeric", words)
    if len(speeds):
        root.append(speeds)


def _add_body(robot: ParallelRobot, data: pin.Data, j: int, parent: Element, *, hinges: bool) -> Element:
    """Add the body behind joint j to that of its parent; return its element."""
    model, inertia = robot.model, robot.model.inertias[j]
    is_split = hinges and is_ball(model.joints[j])
    attributes = _placement_attributes(data.liMi[j] if is_split else model.jointPlacements[j])
    body = SubElement(parent, "body", {"name": f"{model.names[j]}_body"} | attributes)
    _add_joints(robot, body, np.asarray(data.joints[j].S), j, is_split=is_split)
    moments = _acceptable_inertia(inertia.inertia)
    SubElement(
        body,
        "inertial",
        pos=vector_text(inertia.lever),
        mass=repr(max(float(inertia.mass), MIN_MASS)),
        fullinertia=vector_text(moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]),
    )
    return body


def _add_joints(robot: ParallelRobot, body: Element, screws: Array, j: int, *, is_split: bool) -> None:
    """Add joint j with screws (6, k) to a body, or three hinges for a ball."""
    name, joint = str(robot.model.names[j]), robot.model.joints[j]
    columns = range(joint.idx_v, joint.idx_v + joint.nv)
    if is_split and robot.all_stiffness[columns].any():
        raise InvalidInput(f"{robot.name}: ball {name!r} has a spring, which three hinges in turn do not say")
    acting = [_acting_attributes(robot, column) for column in columns]
    if is_split:
        for axis, attributes in zip("xyz", acting, strict=True):
            hinge = {"name": f"{name}_hinge_{axis}", "type": "hinge", "axis": AXIS[axis]}
            SubElement(body, "joint", hinge | attributes)
        return
    if any(attributes != acting[0] for attributes in acting):
        raise InvalidInput(
            f"{robot.name}: what acts about the axes of ball {name!r} differs, which one ball of MuJoCo does "
            f"not say; write it as hinges (--hinges)"
        ).advising({"hinges": True})
    words = {"name": name, "type": "ball"}
    if not is_ball(joint):
        linear, angular = np.split(screws.ravel(), 2)  # the axis, fixed in the joint
        slides = np.linalg.norm(angular) == 0
        words |= {"type": "slide" if slides else "hinge", "axis": vector_text(linear if slides else angular)}
    for limit in robot.limits:
        if limit.joint == name and name not in ranges_left_out(robot):
            words |= {"limited": "true", "range": vector_text([limit.lower, limit.upper])}
    SubElement(body, "joint", words | acting[0])


def _acting_attributes(robot: ParallelRobot, column: int) -> dict[str, str]:
    """Return inertia, spring, damping and friction along a velocity column as attributes."""
    rotors = np.zeros(robot.model.nv)
    rotors[robot.actuated] = robot.rotor_inertia * robot.gear_ratio**2
    values = {
        "armature": robot.model.armature[column] + rotors[column],
        "stiffness": robot.all_stiffness[column],
        "springref": robot.joint_rest[column],
        "damping": robot.joint_damping[column],
        "frictionloss": robot.joint_friction[column],
    }
    return {key: repr(float(value)) for key, value in values.items() if value}


def _acceptable_inertia(inertia: Array) -> Array:
    """Return an inertia (3, 3) that MuJoCo accepts, of a body that can exist.

    Planar robots are often given one moment of three; each of the others becomes half of it, which nothing in
    the plane feels. The lesser two grow by what their sum lacks: by rounding if the body is a thin rod.
    """
    moments, axes = np.linalg.eigh(inertia)
    moments[:2] += 0.5 * max(0.0, moments[2] - moments[0] - moments[1])
    return axes @ np.diag(np.maximum(moments, MIN_INERTIA)) @ axes.T


def _add_loops(robot: ParallelRobot, root: Element, bodies: list[Element]) -> None:
    """Add the equalities, and sites at the frames of the platform and the loops."""
    frames = dict(zip(frame_names(robot), robot.frames, strict=True))
    axes = equality_axes(robot)
    equality = SubElement(root, "equality")
    hard = {"solref": f"{2 * TIME_STEP!r} 1", "solimp": HARD}
    for name, frame in frames.items():
        _add_site(robot, bodies, name, frame, np.zeros(3))
    for closure in robot.description.closures:
        for k in (None, *OFF_ORIGIN[axes[closure.name]]):  # the origins, then points off them on axis k
            name, pair = closure.name, list(closure.frames)
            if k is not None:
                name = f"{closure.name}_{'xyz'[k]}"
                pair = [f"{end}_{name}" for end in closure.frames]
                offset = CLOSING_POINT_DISTANCE * robot.length * np.eye(3)[k]
                for point, end in zip(pair, closure.frames, strict=True):
                    _add_site(robot, bodies, point, frames[end], offset)
            joined = {"name": name, "site1": pair[0], "site2": pair[1]}
            SubElement(equality, "connect", joined | hard)
    for coupling in robot.description.couplings:
        joined = {"name": coupling.name, "joint1": coupling.joint, "joint2": coupling.of}
        polynomial = vector_text([coupling.offset, coupling.ratio, 0, 0, 0])
        SubElement(equality, "joint", joined | {"polycoef": polynomial} | hard)


def _add_site(robot: ParallelRobot, bodies: list[Element], name: str, frame: int, offset: Array) -> None:
    """Add a site at an offset (3,) [m] from the frame of an index."""
    origin = robot.model.frames[frame]
    placement = _placement_attributes(origin.placement * pin.SE3(np.eye(3), offset))
    SubElement(bodies[origin.parentJoint], "site", {"name": name} | placement)


def _placement_attributes(placement: pin.SE3) -> dict[str, str]:
    """Return place and rotation as attributes of an element."""
    rotation = pin.Quaternion(placement.rotation)
    quaternion = vector_text([rotation.w, rotation.x, rotation.y, rotation.z])
    return {"pos": vector_text(placement.translation), "quat": quaternion}


POINT, WELD = locked_axes("spherical"), locked_axes("fixed")
HINGES = {locked_axes("revolute", axis): k for k, axis in enumerate("xyz")}  # and the axis that is free
# Axes on which there are more points than the origin. MuJoCo's own weld weighs its couples with the inertia
# of a body about its centre, which makes it soft where that is next to nothing (a rod about its own axis).
OFF_ORIGIN = {POINT: (), **{axes: (k,) for axes, k in HINGES.items()}, WELD: (0, 1)}
TRIED_DEFLECTION = 1e-3  # [rad, robot lengths] by which springs are, where the loops are looked at
# [rad, robot lengths]: the square of TRIED_DEFLECTION, by which a free axis opens, is above it
CLOSED_GAP = 1e-10


def equality_axes(robot: ParallelRobot) -> dict[str, tuple[str, ...]]:
    """Choose the axes (of OFF_ORIGIN) that the equalities of each closure lock.

    Raises:
        InvalidInput: no equality locks the axes of a closure; names it, and the axes along which it moves.
    """
    closures, poses = robot.description.closures, None
    locked = {}
    for closure in closures:
        if closure.axes in OFF_ORIGIN:
            locked[closure.name] = closure.axes
            continue
        poses = _configurations_near(robot) if poses is None else poses
        locked[closure.name] = _choose_wider_axes(robot, closure, poses)
    return locked


def _choose_wider_axes(robot: ParallelRobot, closure: Closure, poses: Array) -> tuple[str, ...]:
    """Choose the first axes of OFF_ORIGIN along all of which a closure is closed anyway.

    An equality that locks more axes than the closure changes nothing if these do not move at any of the
    poses (K, nq).
    """
    lacking = dict[tuple[str, ...], float]()
    placements, names = frames_at(robot, poses), frame_names(robot)
    for axes in OFF_ORIGIN:
        if not set(closure.axes) <= set(axes):
            continue
        rows = loop_rows([replace(closure, axes=axes)], names)
        lengths = np.where(rows.rotation, 1.0, robot.length)
        gap = float((np.abs(loop_equations(rows, placements).residual) / lengths).max(initial=0.0))
        if gap <= CLOSED_GAP:
            return axes
        lacking[axes] = gap
    least = min(lacking, key=lacking.__getitem__, default=())
    added = ", ".join(axis for axis in least if axis not in closure.axes)
    raise InvalidInput(
        f"{robot.name}: MuJoCo has no equality for closure {closure.name!r}, which locks "
        f"{', '.join(closure.axes)} (valid: kinds spherical, revolute and fixed"
        f"{f'; the robot has to move along {added}' if added else ''})"
    )


def _configurations_near(robot: ParallelRobot) -> Array:
    """Return assembled poses (K, nq) near the reference, springs deflected or not."""
    rest = robot.reference.q
    share = np.random.default_rng(0).uniform(-1, 1, robot.n_e)
    deflections = TRIED_DEFLECTION * robot.column_scale[robot.elastic] * share
    starts = [rest, integrate_columns(robot, rest, robot.elastic, deflections)] if robot.n_e else [rest]
    return np.array([rest, *(q for start in starts for q in nearby_configurations(robot, start))])


def frame_names(robot: ParallelRobot) -> list[str]:
    """Return the names of `robot.frames`, in their order."""
    closures = robot.description.closures
    ends = (name for closure in closures for name in closure.frames)
    return list(dict.fromkeys([robot.description.platform.frame, *ends]))
