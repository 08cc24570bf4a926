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

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, SupportsIndex

import numpy as np
import pinocchio as pin

from framework.errors import format_distinct
from framework.model.placement import rotation_with_axis
from framework.model.urdf_elements import COORDINATE_SUFFIXES, ENDLESS
from framework.numerics.arrays import Array, IntArray, Names
from framework.tolerances import SAME_PLACE

# suffixes of the names of a floating joint's slides, with their kinds
_SLIDES = (("_x", pin.JointModelPX), ("_y", pin.JointModelPY), ("_z", pin.JointModelPZ))


def tree_model(
    urdf: ElementTree.Element, as_declared: Collection[str], order: Sequence[str] = ()
) -> pin.Model:
    """Build pinocchio's model of a URDF without shapes; modify `urdf`.

    In `urdf` joints of several freedoms become floating joints, the only such kind that the parser knows. The
    third axis of a ball is turned towards the centre of mass of its child, except on the balls `as_declared`.
    Joints are in the `order` of their names; by default in that of the parser.

    Raises:
        ValueError, RuntimeError: from pinocchio's parser.
    """
    several = {}  # kind by name of each joint with several freedoms
    for joint in urdf.findall("joint"):
        kind = joint.get("type", "")
        if kind in COORDINATE_SUFFIXES:
            several[joint.get("name", "")] = kind
            joint.set("type", "floating")  # the only kind with several freedoms that the parser knows
    model = pin.buildModelFromXML(ElementTree.tostring(urdf, encoding="unicode"))
    return _rebuild(model, several, as_declared, order) if several or order else model


def _rebuild(
    parsed: pin.Model, several: Mapping[str, str], as_declared: Collection[str], order: Sequence[str]
) -> pin.Model:
    """Return the model with joints in order, and balls in place of floating joints.

    The parser made the floating ones.

    A joint declared as floating gets three slides before its ball.

    Args:
        parsed: the model with floating joints.
        several: declared kinds of these joints by name.
        as_declared: names of the balls whose axes are not turned towards the centre of mass.
        order: names of joints; those between them, of springs, follow the joint that carries them.
    """
    rank = {0: (-1, 0)}  # of each parsed joint: index in `order`, and joints since then
    for j in range(1, parsed.njoints):
        carrier = rank[parsed.parents[j]]
        rank[j] = (
            (order.index(parsed.names[j]), 0) if parsed.names[j] in order else (carrier[0], carrier[1] + 1)
        )
    model = pin.Model()
    model.name = parsed.name
    new_index = {0: 0}  # of each parsed joint in the new model
    axes = {0: pin.SE3.Identity()}  # pose of each parsed joint's axes on those of the new joint
    for j in sorted(range(1, parsed.njoints), key=rank.__getitem__) if order else range(1, parsed.njoints):
        name, parsed_parent = parsed.names[j], parsed.parents[j]
        parent = new_index[parsed_parent]
        placement = axes[parsed_parent] * parsed.jointPlacements[j]
        joint = parsed.joints[j]
        axes[j] = pin.SE3.Identity()

        if name in several:
            joint = pin.JointModelSpherical()
            if several[name] == "floating":
                for suffix, slide in _SLIDES:  # one carries the other, the last one the ball
                    parent = model.addJoint(parent, slide(), placement, f"{name}{suffix}")
                    placement = pin.SE3.Identity()
            if name not in as_declared:  # turn the third axis of the ball towards the centre of mass
                to_centre = pin.SE3(rotation_with_axis("z", _centre_direction(parsed, j)), np.zeros(3))
                placement = placement * to_centre
                axes[j] = to_centre.inverse()

        new_index[j] = model.addJoint(parent, joint, placement, name)
        model.appendBodyToJoint(new_index[j], parsed.inertias[j], axes[j])
    for frame in parsed.frames[1:]:  # all except the universe
        j = frame.parentJoint
        pose = axes[j] * frame.placement
        # False: the frame adds no inertia, which the joints have already
        model.addFrame(pin.Frame(frame.name, new_index[j], frame.parentFrame, pose, frame.type), False)
    return model


def _centre_direction(model: pin.Model, j: int) -> Array:
    """Return a vector (3,) from joint j to the centre of mass of its child link.

    If the two coincide, the vector leads to the farthest frame of the link. If all frames coincide with the
    joint, too, it is the z axis.
    """
    frames = [frame.placement.translation for frame in model.frames if frame.parentJoint == j]
    farthest = max(frames, key=np.linalg.norm)
    lever = model.inertias[j].lever
    if model.inertias[j].mass > 0 and np.linalg.norm(lever) > SAME_PLACE * np.linalg.norm(farthest):
        return lever
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


def joint_limits(urdf: ElementTree.Element, model: pin.Model) -> tuple[JointLimit, ...]:
    """Return the limits of all limited joints, in the order of the URDF.

    Equal limits are none, nor are two of the size `ENDLESS`.
    """
    limits = []
    for joint in urdf.findall("joint"):
        limit, kind = joint.find("limit"), joint.get("type")
        if limit is None or kind not in ("revolute", "prismatic"):
            continue
        lower, upper = (float(limit.get(key, "0")) for key in ("lower", "upper"))
        if lower == upper or (lower <= -ENDLESS and upper >= ENDLESS):
            continue
        name = joint.get("name", "")
        unit = "m" if kind == "prismatic" else "rad"
        model_joint = model.joints[model.getJointId(name)]
        limits.append(JointLimit(name, model_joint.idx_q, model_joint.idx_v, lower, upper, unit))
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
        least, largest = float(positions.min()), float(positions.max())
        excesses = []
        # the farthest position beyond each limit, with the limit and the excess
        for position, bound, excess in (
            (least, limit.lower, limit.lower - least),
            (largest, limit.upper, largest - limit.upper),
        ):
            if excess > rounding:
                position_text, bound_text = format_distinct(position, bound, 6)
                excesses.append(f"{position_text} {limit.unit} of {bound_text}")
        if excesses:
            exceeded[limit.joint] = f"position {' and '.join(excesses)}"
    return exceeded
