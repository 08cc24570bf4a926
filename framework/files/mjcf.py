"""Write a robot as a MuJoCo model: the open tree with springs, and the loops as equalities between sites.

Joints keep their names, axes, zeros, armature, damping, dry friction and springs. The frames of the platform
and of the loops become sites. A rotor adds gear ratio^2 times its inertia to the armature of its joint. A
motor is an actuator with the gear ratio as gear and the motor torque as control. A spring of the robot is a
joint with stiffness, one between points a spatial tendon. Loops and couplings are equalities. MuJoCo requires
mass in each moving body; bodies without mass are given MIN_MASS and MIN_INERTIA. Bodies have no shape.

Points that coincide, MuJoCo's `connect`, close a loop: one point, two on the axis of a hinge, or three of a
weld. Any other closure is written as the first of these that locks the axes of the closure and further ones,
provided that the robot cannot move along the further axes. This is tested at random configurations near the
reference, with deflected springs. Since the loop equations are analytic, the result then holds on the whole
branch, except by chance. For example, the rods of a parallelogram may lock only two axes, to have few
equations; they are written as points that coincide.

A torque limit becomes the range of a motor's control and force. The URDF's range of a joint becomes the
joint's range, which MuJoCo enforces by forces of its own; a range that does not contain the reference is left
out (`ranges_left_out`). MuJoCo has no speed limits: `<custom>` has them as `JOINT_speed_limit` [rad/s], motor
side.

Source: MuJoCo's documentation, chapter "XML Reference". Loops are as stiff as the time step allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.assembly import NEARBY_DISTANCE, nearby_configurations
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import is_ball, positions_beyond_limits
from framework.model.description import MAX_DEGREE, Closure, Coupling, locked_axes
from framework.model.loop_rows import loop_rows
from framework.model.placement import to_quaternion, unit_vector
from framework.model.urdf_edits import vector_text
from framework.numerics.arrays import Array
from framework.numerics.output import PROGRAM
from framework.tolerances import LOOP_GAP

MIN_MASS, MIN_INERTIA = 1e-9, 1e-12  # [kg], [kg m^2] of massless bodies; MuJoCo refuses less than 1e-15
TIME_STEP = 1e-3  # [s]
START = (
    "start from the keyframe `reference`, where the loops are closed: "
    "mj_resetDataKeyframe(model, data, 0); at zero they are torn"
)
# Solver parameters of the stiffest equality that MuJoCo can solve: the time constant, two time steps, and
# the damping ratio; the impedance, 0.9999 at any gap, with the form of a transition that has no effect.
HARD_EQUALITY = {"solref": f"{2 * TIME_STEP!r} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}


def mjcf_text(robot: ParallelRobot, *, hinges: bool = False) -> str:
    """Return the robot as an MJCF text.

    The keyframe `reference` is the assembled reference.

    With `hinges` a ball J becomes three hinges J_hinge_x, J_hinge_y and J_hinge_z, for programs without ball
    joints. They rotate about the body's axes, one after the other, and are zero in the reference. The chain
    is singular when the second angle is 90 degrees.

    Raises:
        InvalidInput: MuJoCo has no equality that locks the axes of a closure; with `hinges`, a ball has a
            spring, whose torque three hinges cannot have; without `hinges`, the dynamics of a ball differ
            between its axes.
    """
    model = robot.model
    root = Element("mujoco", model=robot.name)
    root.append(Comment(f" by {PROGRAM}: {START} "))
    SubElement(root, "compiler", angle="radian", autolimits="false")
    gravity = vector_text(model.gravity.linear)
    SubElement(root, "option", timestep=repr(TIME_STEP), gravity=gravity, integrator="implicitfast")

    # the tree: pinocchio numbers parents before children, and the world 0
    bodies = [SubElement(root, "worldbody")]
    q = robot.reference.q
    data = model.createData()
    pin.forwardKinematics(model, data, q, np.zeros(model.nv))
    for j in range(1, model.njoints):
        bodies.append(_add_body(robot, data, j, bodies[model.parents[j]], hinges=hinges))
    zero = pin.neutral(model)
    if hinges:  # hinges are zero where the balls are in the reference
        for joint in filter(is_ball, list(model.joints)):
            ball = slice(joint.idx_q, joint.idx_q + joint.nq)
            zero[ball] = q[ball]
    _add_loops(robot, root, bodies, zero)
    _add_motors(robot, root)

    # the assembled reference
    keys = SubElement(root, "keyframe")
    qpos = vector_text(convert_to_qpos(model, q, hinges=hinges))
    SubElement(keys, "key", name="reference", qpos=qpos)
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def convert_to_qpos(model: pin.Model, q: Array, *, hinges: bool = False) -> Array:
    """Convert the configuration q (nq,) of a model to MuJoCo's qpos.

    MuJoCo's quaternions are (w, x, y, z), pinocchio's are (x, y, z, w). With `hinges`, hinges replace each
    ball, and they are zero.
    """
    parts = []
    for joint in list(model.joints)[1:]:  # the first is pinocchio's universe
        part = q[joint.idx_q : joint.idx_q + joint.nq]
        if is_ball(joint):
            part = np.zeros(3) if hinges else np.roll(part, 1)
        parts.append(part)
    return np.concatenate(parts)


def ranges_left_out(robot: ParallelRobot) -> tuple[str, ...]:
    """Return the joints whose range is not written because the reference is outside."""
    return tuple(positions_beyond_limits(robot.limits, robot.reference.q[None]))


def _add_motors(robot: ParallelRobot, root: Element) -> None:
    """Add an actuator for each motor, controlled by the motor torque [N m], and the speed limits."""
    actuator = SubElement(root, "actuator")
    speed_limits = Element("custom")
    for motor in robot.description.actuators:
        words = {"name": f"{motor.joint}_torque", "joint": motor.joint, "gear": repr(float(motor.gear_ratio))}
        if motor.torque_limit is not None:
            torques = vector_text([-motor.torque_limit, motor.torque_limit])
            words |= {"ctrllimited": "true", "ctrlrange": torques}
            words |= {"forcelimited": "true", "forcerange": torques}
        SubElement(actuator, "motor", words)
        if motor.speed_limit is not None:
            speed = repr(float(motor.speed_limit))
            SubElement(speed_limits, "numeric", name=f"{motor.joint}_speed_limit", data=speed)
    if len(speed_limits):
        root.append(speed_limits)


def _add_body(robot: ParallelRobot, data: pin.Data, j: int, parent: Element, *, hinges: bool) -> Element:
    """Add the body behind pinocchio's joint j to the parent's body; return the element.

    `data` holds the kinematics of the reference. With `hinges` a ball becomes three hinges.
    """
    model = robot.model
    inertia = model.inertias[j]
    is_split = hinges and is_ball(model.joints[j])
    # three hinges are zero in the reference, so they stand as the ball does there
    attributes = _placement_attributes(data.liMi[j] if is_split else model.jointPlacements[j])
    body = SubElement(parent, "body", {"name": f"{model.names[j]}_body"} | attributes)
    _add_joints(robot, body, np.asarray(data.joints[j].S), j, is_split=is_split)

    # MuJoCo takes no principal moment above the sum of the others: half of the excess is added to each of
    # these. For a thin rod the excess is rounding; in planar robots often one moment is given and the others
    # are zero, which become half of it, without an effect on motion in the plane
    moments, axes = np.linalg.eigh(inertia.inertia)  # ascending
    moments[:2] += 0.5 * max(0.0, moments[2] - moments[0] - moments[1])
    matrix = axes @ np.diag(np.maximum(moments, MIN_INERTIA)) @ axes.T
    products = matrix[[0, 0, 1], [1, 2, 2]]  # xy, xz, yz
    SubElement(
        body,
        "inertial",
        pos=vector_text(inertia.lever),
        mass=repr(max(float(inertia.mass), MIN_MASS)),
        fullinertia=vector_text([*matrix.diagonal(), *products]),
    )
    return body


def _add_joints(robot: ParallelRobot, body: Element, screws: Array, j: int, *, is_split: bool) -> None:
    """Add joint j of pinocchio: a hinge, a slide or a ball; instead of a ball three hinges if `is_split`.

    Args:
        body: the element of the body behind the joint.
        screws: (6, k) motion subspace of the joint; of a hinge or slide, the axis is its one column.

    Raises:
        InvalidInput: a ball has a spring, which three hinges cannot represent, or dynamics that differ
            between its axes, which a ball of MuJoCo cannot represent.
    """
    name = str(robot.model.names[j])
    joint = robot.model.joints[j]
    # columns of the velocity vector: three of a ball, one of other joints
    columns = range(joint.idx_v, joint.idx_v + joint.nv)
    if is_split and robot.all_stiffness[columns].any():
        raise InvalidInput(f"{robot.name}: ball {name!r} has a spring, which three hinges cannot represent")
    # armature, spring, damping and friction about or along each axis of the joint
    dynamics = [_dynamic_attributes(robot, column) for column in columns]
    if is_split:
        for axis, about_axis in zip("xyz", dynamics, strict=True):
            hinge = {"name": f"{name}_hinge_{axis}", "type": "hinge", "axis": vector_text(unit_vector(axis))}
            SubElement(body, "joint", hinge | about_axis)
        return
    if any(about_axis != dynamics[0] for about_axis in dynamics):
        raise InvalidInput(
            f"{robot.name}: the dynamics of ball {name!r} differ between its axes, which a ball of MuJoCo "
            f"cannot represent; write it as hinges (--hinges)"
        ).advising({"hinges": True})
    attributes = {"name": name, "type": "ball"}
    if not is_ball(joint):
        linear, angular = np.split(screws.ravel(), 2)  # one of them is the axis, the other zero
        attributes["type"] = "hinge" if angular.any() else "slide"
        attributes["axis"] = vector_text(linear + angular)
    for limit in robot.limits:
        if limit.joint == name and name not in ranges_left_out(robot):
            attributes |= {"limited": "true", "range": vector_text([limit.lower, limit.upper])}
    SubElement(body, "joint", attributes | dynamics[0])


def _dynamic_attributes(robot: ParallelRobot, column: int) -> dict[str, str]:
    """Return armature, spring, damping and friction of velocity coordinate `column` as attributes."""
    armature = robot.model.armature.copy()
    armature[robot.actuated] += robot.rotor_inertia * robot.gear_ratio**2
    values = {
        "armature": armature[column],
        "stiffness": robot.all_stiffness[column],
        "springref": robot.joint_rest[column],
        "damping": robot.joint_damping[column],
        "frictionloss": robot.joint_friction[column],
    }
    return {key: repr(float(value)) for key, value in values.items() if value}


def _add_loops(robot: ParallelRobot, root: Element, bodies: list[Element], zero: Array) -> None:
    """Add the equalities of closures and couplings, springs between points, and sites at their frames.

    `bodies` are the elements of the bodies, by number of pinocchio's joint; `zero` (nq,) is MuJoCo's zero
    pose, from which MuJoCo measures the lengths of tendons.

    A closure makes the origins of its two frames coincide. If it also locks turns, further points of both
    frames coincide, each on one axis of the frame (`OFF_ORIGIN`).
    """
    point_distance = 0.1  # [robot lengths] between the points that close a hinge or a weld
    frames = {robot.model.frames[k].name: robot.model.frames[k] for k in robot.frames}
    for name, frame in frames.items():
        _add_site(bodies, name, frame, np.zeros(3))

    axes = equality_axes(robot)
    equality, tendons = SubElement(root, "equality"), Element("tendon")
    positions = dict(zip(frames, frames_at(robot, zero[None]).placements[0, :, 3], strict=True))
    for closure in robot.description.closures:
        if closure.axes == ROD and closure.length is not None:
            tendon = SubElement(tendons, "spatial", name=closure.name)
            for end in closure.frames:
                SubElement(tendon, "site", site=end)
            first, second = (positions[end] for end in closure.frames)
            excess = closure.length - float(np.linalg.norm(second - first))
            # length = length in the zero pose + excess
            _add_polynomial(equality, "tendon", {"name": closure.name, "tendon1": closure.name}, [excess])
            continue
        _add_connect(equality, closure.name, *closure.frames)
        for axis in OFF_ORIGIN[axes[closure.name]]:
            name = f"{closure.name}_{axis}"  # of the equality, and the end of its sites' names
            offset = point_distance * robot.length * unit_vector(axis)
            for end in closure.frames:
                _add_site(bodies, f"{end}_{name}", frames[end], offset)
            _add_connect(equality, name, *(f"{end}_{name}" for end in closure.frames))

    for coupling in robot.description.couplings:
        _add_coupling(equality, tendons, coupling)
    for spring in robot.description.line_springs:
        numbers = {"stiffness": spring.stiffness, "springlength": spring.rest, "damping": spring.damping}
        words = {key: repr(float(number)) for key, number in numbers.items()}
        tendon = SubElement(tendons, "spatial", {"name": spring.label} | words)
        for end in spring.between:
            SubElement(tendon, "site", site=end)

    if len(tendons):
        root.append(tendons)


def _add_coupling(equality: Element, tendons: Element, coupling: Coupling) -> None:
    """Add the equality of a coupling: a polynomial, or a tendon of several joints.

    Raises:
        InvalidInput: the coupling has a product of different joints, or powers of one joint beside others.
    """
    coefficients = [coupling.offset, coupling.ratio, *[0.0] * (MAX_DEGREE - 1)]  # of powers of q_of
    if len(coupling.joints) == 2:
        for product, coefficient in coupling.terms:
            coefficients[len(product)] += coefficient
        joints = {"name": coupling.name, "joint1": coupling.joint, "joint2": coupling.of}
        _add_polynomial(equality, "joint", joints, coefficients)
    elif coupling.is_linear:
        tendon = SubElement(tendons, "fixed", name=coupling.name)
        for product, factor in coupling.equation.items():
            if product and factor:
                SubElement(tendon, "joint", {"joint": product[0], "coef": repr(float(factor))})
        members = {"name": coupling.name, "tendon1": coupling.name}
        _add_polynomial(equality, "tendon", members, [coupling.offset])
    else:
        raise InvalidInput(
            f"MuJoCo has no equality for coupling {coupling.name!r} of {', '.join(coupling.joints)} (valid: "
            f"a polynomial in one joint, or a sum of several)"
        )


def _add_polynomial(
    equality: Element, tag: str, members: dict[str, str], coefficients: Sequence[float]
) -> None:
    """Add the equality of a joint or tendon with a polynomial in another one, up to MAX_DEGREE."""
    polynomial = {"polycoef": vector_text([*coefficients, *[0] * (MAX_DEGREE + 1 - len(coefficients))])}
    SubElement(equality, tag, members | polynomial | HARD_EQUALITY)


def _add_connect(equality: Element, name: str, site1: str, site2: str) -> None:
    """Add the equality of two sites that coincide."""
    SubElement(equality, "connect", {"name": name, "site1": site1, "site2": site2} | HARD_EQUALITY)


def _add_site(bodies: list[Element], name: str, frame: pin.Frame, offset: Array) -> None:
    """Add a site at an offset (3,) [m] from a frame's origin."""
    placement = _placement_attributes(frame.placement * pin.SE3(np.eye(3), offset))
    SubElement(bodies[frame.parentJoint], "site", {"name": name} | placement)


def _placement_attributes(placement: pin.SE3) -> dict[str, str]:
    """Return a placement as MuJoCo's attributes `pos` and `quat`."""
    quaternion = to_quaternion(placement.rotation)
    return {"pos": vector_text(placement.translation), "quat": vector_text(quaternion)}


ROD = locked_axes("distance")  # which a tendon that is held at its length expresses
# The sets of locked axes that equalities can express, each with the axes on which the equalities need points
# besides the origin. MuJoCo's own weld is not used: it weights couples by the inertia of a body about its
# centre, and is soft where this inertia is tiny (a rod about its own axis).
OFF_ORIGIN = {
    locked_axes("spherical"): "",
    **{locked_axes("revolute", axis): axis for axis in "xyz"},
    locked_axes("fixed"): "xy",
}


def equality_axes(robot: ParallelRobot) -> dict[str, tuple[str, ...]]:
    """Choose the axes (a key of OFF_ORIGIN) that the equalities of each closure lock, by its name.

    Raises:
        InvalidInput: no equality locks the axes of a closure; the message has the axes along which it moves.
    """
    closures = [closure for closure in robot.description.closures if closure.axes != ROD]
    locked = {closure.name: closure.axes for closure in closures}
    unexpressed = [closure for closure in closures if closure.axes not in OFF_ORIGIN]
    if not unexpressed:
        return locked
    rest = robot.reference.q
    poses = [rest, *nearby_configurations(robot, rest)]
    if robot.n_e:  # with springs deflected at random, too
        share = np.random.default_rng(0).uniform(-1, 1, robot.n_e)
        deflections = NEARBY_DISTANCE * robot.column_scale[robot.elastic] * share
        poses += nearby_configurations(robot, integrate_columns(robot, rest, robot.elastic, deflections))
    nearby = np.array(poses)  # (K, nq)
    return locked | {closure.name: _choose_wider_axes(robot, closure, nearby) for closure in unexpressed}


def _choose_wider_axes(robot: ParallelRobot, closure: Closure, poses: Array) -> tuple[str, ...]:
    """Choose the first axes in OFF_ORIGIN that include a closure's axes and lock no motion.

    An equality may lock further axes if its residual is zero in all `poses` (K, nq) of the robot, as the
    robot then does not move along these axes.

    Raises:
        InvalidInput: there are none; the message has the axes along which the closure moves.
    """
    gaps = dict[tuple[str, ...], float]()
    placements = frames_at(robot, poses)
    names = [robot.model.frames[k].name for k in robot.frames]
    for axes in OFF_ORIGIN:
        if not set(closure.axes) <= set(axes):
            continue
        rows = loop_rows([replace(closure, axes=axes)], names)
        scale = np.where(rows.rotation, 1.0, robot.length)
        residual = loop_equations(rows, placements).residual / scale  # (K, m) [rad, robot lengths]
        gaps[axes] = float(np.abs(residual).max(initial=0.0))
        # the poses are NEARBY_DISTANCE apart: motion along an axis opens a gap of at least its square
        if gaps[axes] <= LOOP_GAP:
            return axes

    nearest = min(gaps, key=gaps.__getitem__, default=())
    added = ", ".join(axis for axis in nearest if axis not in closure.axes)
    raise InvalidInput(
        f"{robot.name}: MuJoCo has no equality for closure {closure.name!r}, which locks "
        f"{', '.join(closure.axes)} (valid: kinds spherical, revolute, fixed and distance"
        f"{f'; wider ones would lock {added}, along which the robot moves' if added else ''})"
    )
