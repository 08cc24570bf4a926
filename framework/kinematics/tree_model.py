"""Pinocchio's model of the open tree; names and limits of its coordinates.

A ball has a quaternion, so none of its poses is singular; three hinges in series would be singular where the
second has turned by a right angle. A floating joint consists of three slides and a ball. The velocity of a
ball is the angular velocity of its child link relative to its parent link, on axes that move with the child.
The third of these axes passes through the centre of mass of the child. So a rod between two balls spins about
this axis when it spins idly, and planning holds this one rate at zero, however the frame of the rod is
oriented. Files, tables and messages state the position of a ball as a rotation vector on the axes of the
joint's origin.

Limits are `lower` and `upper` of a revolute or prismatic joint. A joint is unlimited if both are missing or
equal, as exporters write joints without limits. If only one of them is missing, it is 0, as URDF says. A
column is an index into pinocchio's velocity vector (nv,).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, SupportsIndex

import numpy as np
import pinocchio as pin

from framework.errors import format_distinct
from framework.model.placement import rotation_with_axis
from framework.model.urdf_elements import COORDINATE_SUFFIXES, ENDLESS, MOVING, Joint, Tree, read_inertial
from framework.numerics.arrays import Array, IntArray, Names
from framework.tolerances import SAME_PLACE

# suffixes of the names of a floating joint's slides, with their kinds
_SLIDES = (("_x", pin.JointModelPX), ("_y", pin.JointModelPY), ("_z", pin.JointModelPZ))


def tree_model(tree: Tree, as_declared: Collection[str] = (), order: Sequence[str] = ()) -> pin.Model:
    """Build pinocchio's model of a tree.

    A continuous joint becomes a hinge that counts its turns: pinocchio's own has the cosine and sine of the
    angle, and a motor behind a gear needs the angle itself. A floating joint becomes three slides and a ball.
    The third axis of a ball is turned towards the centre of mass of its child, except on those `as_declared`.

    Args:
        tree: of a URDF, with the joints of springs.
        as_declared: names of the balls whose axes are not turned.
        order: names of joints; those between them, of springs, follow the joint that carries them. By default
            the order is that of pinocchio's parser: depth first, the joints of a link by name.

    Raises:
        ValueError, RuntimeError: pinocchio refuses a name.
    """
    model = pin.Model()
    model.name = tree.name
    # of each link: the joint that carries it, its pose on the axes of this joint, and its frame
    base = model.addBodyFrame(tree.base, 0, pin.SE3.Identity(), 0)
    carriers = {tree.base: (0, pin.SE3.Identity(), base)}
    model.appendBodyToJoint(0, _inertia(tree, tree.base), pin.SE3.Identity())
    for joint in _order_joints(tree, order):
        parent, parent_pose, frame = carriers[joint.parent]
        pose = parent_pose * pin.SE3(joint.origin)
        body = _inertia(tree, joint.child)
        if joint.moves:
            turned = pin.SE3.Identity()  # pose of the joint's axes on those of its link
            if joint.kind in COORDINATE_SUFFIXES and joint.name not in as_declared:
                turned.rotation = rotation_with_axis("z", _centre_direction(tree, joint.child))
            j = _add_moving_joint(model, joint, parent, pose, turned)
            axes = turned.inverse()
            frame = model.addFrame(pin.Frame(joint.name, j, frame, axes, pin.FrameType.JOINT))
            model.appendBodyToJoint(j, body, axes)
        else:  # the frame adds its inertia to that of the joint that carries it
            fixed = pin.Frame(joint.name, parent, frame, pose, pin.FrameType.FIXED_JOINT, body)
            j, axes, frame = parent, pose, model.addFrame(fixed)
        carriers[joint.child] = j, axes, model.addBodyFrame(joint.child, j, axes, frame)
    return model


def _add_moving_joint(model: pin.Model, joint: Joint, parent: int, pose: pin.SE3, turned: pin.SE3) -> int:
    """Add a joint that moves, with its limits, at a pose on its parent, `turned` there; return its index."""
    if joint.kind == "floating":
        for suffix, slide in _SLIDES:  # one carries the other, the last one the ball
            parent = model.addJoint(parent, slide(), pose, f"{joint.name}{suffix}")
            pose = pin.SE3.Identity()
    j = model.addJoint(parent, _joint_model(joint), pose * turned, joint.name)
    if joint.kind in MOVING:
        k = model.joints[j].idx_q
        model.lowerPositionLimit[k], model.upperPositionLimit[k] = joint.limits or (-ENDLESS, ENDLESS)
        k = model.joints[j].idx_v
        model.effortLimit[k], model.velocityLimit[k] = joint.effort, joint.speed
    return j


def _order_joints(tree: Tree, order: Sequence[str]) -> list[Joint]:
    """Order the joints of a tree as `tree_model` does, each behind its carriers."""
    children: dict[str, list[Joint]] = {}
    for joint in sorted(tree.joints.values(), key=lambda joint: joint.name, reverse=True):
        children.setdefault(joint.parent, []).append(joint)
    ordered = list[Joint]()
    rank = {tree.base: -1}  # index in `order` of the last such joint on the way to each link
    remaining = children.get(tree.base, []).copy()
    while remaining:
        joint = remaining.pop()
        ordered.append(joint)
        rank[joint.child] = order.index(joint.name) if joint.name in order else rank[joint.parent]
        remaining += children.get(joint.child, ())
    return sorted(ordered, key=lambda joint: rank[joint.child])  # a stable sort


def _joint_model(joint: Joint) -> Any:
    """Return pinocchio's joint of a joint that moves."""
    if joint.kind in COORDINATE_SUFFIXES:
        return pin.JointModelSpherical()
    axis = joint.axis / np.linalg.norm(joint.axis)
    short, long = ("P", "Prismatic") if joint.kind == "prismatic" else ("R", "Revolute")
    for letter, unit in zip("XYZ", np.eye(3), strict=True):  # along a coordinate axis it is faster
        if np.array_equal(axis, unit):
            return getattr(pin, f"JointModel{short}{letter}")()
    return getattr(pin, f"JointModel{long}Unaligned")(axis)


def _inertia(tree: Tree, link: str) -> pin.Inertia:
    """Return a link's inertia on its own axes."""
    mass, origin, matrix = read_inertial(tree.links[link])
    axes = origin[:3, :3]
    return pin.Inertia(mass, origin[:3, 3], axes @ matrix @ axes.T)


def _centre_direction(tree: Tree, link: str) -> Array:
    """Return a vector (3,) from the origin of a link to the centre of mass of its rigid body.

    If the two coincide, the vector leads to the farthest link of the body. If all coincide, it is the z axis.
    """
    poses = {link: pin.SE3.Identity()}  # of the links of the body
    body = pin.Inertia.Zero()
    for joint in _order_joints(tree, ()):
        if joint.parent in poses and not joint.moves:
            poses[joint.child] = poses[joint.parent] * pin.SE3(joint.origin)
    for name, pose in poses.items():
        body += pose.act(_inertia(tree, name))
    farthest = max((pose.translation for pose in poses.values()), key=np.linalg.norm)
    if body.mass > 0 and np.linalg.norm(body.lever) > SAME_PLACE * np.linalg.norm(farthest):
        return body.lever
    return farthest if farthest.any() else np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Names and axes of the columns of a model in files and messages."""

    model: pin.Model

    @cached_property
    def names(self) -> Names:
        """The name of each column, (nv,): its joint's, or NAME_rx, NAME_ry, NAME_rz of a ball."""
        return coordinate_names(self.model)

    def name_of(self, column: SupportsIndex) -> str:
        """Return the name of one column."""
        return self.names[column]

    def turn_name(self, column: SupportsIndex) -> str:
        """Return the name of the coordinate nearest to the axis of a column, another one on some balls."""
        return self.names[int(np.abs(file_axes(self.model)[:, column]).argmax())]

    def positions(self, q: Array) -> Array:
        """Compute joint positions (T, nv) [rad, m] at q (T, nq), as rotation vectors for balls."""
        model = self.model
        if model.nq == model.nv:
            return q
        neutral = pin.neutral(model)
        from_neutral = [pin.difference(model, neutral, np.ascontiguousarray(row)) for row in q]
        return self.to_file_axes(np.asarray(from_neutral))

    def to_file_axes(self, v: Array) -> Array:
        """Convert tangent vectors v (T, nv) to the axes of files, which differ from the model's on balls."""
        return v if self.model.nq == self.model.nv else v @ file_axes(self.model).T


def single_columns(model: pin.Model) -> frozenset[int]:
    """Return the columns of hinges and slides, which have one column each."""
    return frozenset(joint.idx_v for joint in model.joints[1:] if joint.nv == 1)


def coordinate_names(model: pin.Model) -> Names:
    """Return the name of each velocity coordinate, (nv,): of the joint, with a suffix on balls."""
    names: list[str] = []
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):  # without the world
        suffixes = COORDINATE_SUFFIXES["spherical"] if is_ball(joint) else ("",) * joint.nv
        names += [f"{name}{suffix}" for suffix in suffixes]
    return tuple(names)


def is_ball(joint: pin.JointModel) -> bool:
    """Return whether a joint has a quaternion."""
    return bool(joint.shortname() == "JointModelSpherical")


def is_slide(joint: pin.JointModel) -> bool:
    """Return whether a joint is prismatic."""
    return bool(joint.shortname().startswith("JointModelP"))


@lru_cache(maxsize=64)
def ball_columns(model: pin.Model) -> IntArray:
    """Return the columns (b, 3) of b balls."""
    first = np.array([joint.idx_v for joint in model.joints if is_ball(joint)], dtype=np.intp)
    return first[:, None] + np.arange(3)


def file_axes(model: pin.Model) -> Array:
    """Return the matrix (nv, nv) that converts tangent vectors to the axes of files.

    It is the identity except for balls, whose axes `tree_model` turns.
    """
    axes = np.eye(model.nv)
    for j, joint in enumerate(model.joints):
        if is_ball(joint):
            columns = slice(joint.idx_v, joint.idx_v + 3)
            axes[columns, columns] = link_axes(model, j).rotation.T
    return axes


def link_axes(model: pin.Model, j: int) -> pin.SE3:
    """Return the placement of the link's axes on joint j; the identity except for balls."""
    name = model.names[j]
    if model.existFrame(name, pin.FrameType.JOINT):
        return model.frames[model.getFrameId(name, pin.FrameType.JOINT)].placement
    return pin.SE3.Identity()


def link_of(model: pin.Model, j: int) -> str:
    """Return the name of the first link fixed to joint j."""
    body = pin.FrameType.BODY
    names = (frame.name for frame in model.frames if frame.parentJoint == j and frame.type == body)
    return str(next(names, model.names[j]))


class JointLimit(NamedTuple):
    """The position limits of one joint in a URDF."""

    joint: str  # name
    coordinate: int  # index of its position in q
    column: int  # index of its velocity
    lower: float  # in `unit`
    upper: float
    unit: str  # rad or m


def joint_limits(tree: Tree, model: pin.Model) -> tuple[JointLimit, ...]:
    """Return the limits of all limited joints, in the order of the URDF.

    Equal limits are none, nor are two of the size `ENDLESS`.
    """
    limits = []
    for joint in tree.joints.values():
        lower, upper = joint.limits or (0.0, 0.0)
        if joint.moves and lower != upper and (lower > -ENDLESS or upper < ENDLESS):
            unit = "m" if joint.kind == "prismatic" else "rad"
            model_joint = model.joints[model.getJointId(joint.name)]
            limits.append(JointLimit(joint.name, model_joint.idx_q, model_joint.idx_v, lower, upper, unit))
    return tuple(limits)


def shares_beyond_limits(limits: Sequence[JointLimit], q: Array) -> Array:
    """Compute by how much q (..., nq) exceeds joint limits, as shares (..., limits) of their ranges."""
    positions = q[..., [limit.coordinate for limit in limits]]
    lower = np.array([limit.lower for limit in limits])
    upper = np.array([limit.upper for limit in limits])
    rounding = SAME_PLACE * np.maximum(np.abs(lower), np.abs(upper))
    excess = np.maximum(lower - positions, positions - upper)
    ranges = np.maximum(upper - lower, rounding)  # not zero where both limits are equal
    return np.where(excess > rounding, excess, 0.0) / ranges


def positions_beyond_limits(limits: Sequence[JointLimit], q: Array) -> dict[str, str]:
    """Describe the joints of q (T, nq) beyond their limits: `position -4.27 rad of -3.2` by joint."""
    exceeded = {}
    for limit in limits:
        rounding = SAME_PLACE * max(abs(limit.lower), abs(limit.upper))
        positions = q[:, limit.coordinate]
        farthest = (float(positions.min()), limit.lower, -1.0), (float(positions.max()), limit.upper, 1.0)
        excesses = []
        for position, bound, sign in farthest:  # below the lower limit, then above the upper one
            if sign * (position - bound) > rounding:
                position_text, bound_text = format_distinct(position, bound, 6)
                excesses.append(f"{position_text} {limit.unit} of {bound_text}")
        if excesses:
            exceeded[limit.joint] = f"position {' and '.join(excesses)}"
    return exceeded
