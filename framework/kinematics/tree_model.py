"""Pinocchio's model of the open tree, the names of its coordinates, and their limits.

A ball keeps a quaternion, so that none of its poses is singular; three hinges in series are singular where
the second has turned by a right angle. A floating joint is three slides and a ball. The velocity of a ball is
the angular velocity of its child link relative to its parent link, about axes that move with the child. The
third axis goes through the centre of mass behind the ball. So a rod that spins idly between two balls spins
about that axis, and planning holds this one rate at zero, whatever the frame of the rod is. Files, tables and
messages state a ball by its rotation vector about the axes of the joint's origin.

Limits are `lower` and `upper` of a revolute or prismatic joint. A joint is unlimited if both are left out or
equal, as exporters without limits write them; one left out alone is 0, as in URDF.
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
from framework.model.urdf_elements import SEVERAL
from framework.numerics.arrays import Array, IntArray, Names
from framework.tolerances import SAME_PLACE

_SLIDES = (("_x", pin.JointModelPX), ("_y", pin.JointModelPY), ("_z", pin.JointModelPZ))
CENTRE_DISTANCE = 1e-12  # [m] nearer to the ball's centre than this, a centre of mass gives no direction


def tree_model(urdf: ElementTree.Element, as_declared: Collection[str] = ()) -> pin.Model:
    """Return pinocchio's model of a URDF made by `bare_urdf`; the URDF is modified.

    The axes of a ball are turned towards the centre of mass behind it, except for joints `as_declared`.

    Raises:
        ValueError, RuntimeError: of pinocchio's parser.
    """
    several = {}
    for joint in urdf.findall("joint"):
        if (kind := joint.get("type", "")) in SEVERAL:
            several[joint.get("name", "")] = kind
            joint.set("type", "floating")  # the only one that the parser knows
    model = pin.buildModelFromXML(ElementTree.tostring(urdf, encoding="unicode"))
    return _replace_balls(model, several, as_declared) if several else model


def _replace_balls(parsed: pin.Model, several: Mapping[str, str], as_declared: Collection[str]) -> pin.Model:
    """Return the model with balls in place of the floating joints `several`.

    `several` has the kinds of joints by name; a floating one has slides too.
    """
    model = pin.Model()
    model.name = parsed.name
    new = {0: 0}  # the new joint of each parsed one
    axes = {0: pin.SE3.Identity()}  # the pose of each parsed joint in the new one, whose axes may be turned
    for j in range(1, parsed.njoints):
        name, parent = str(parsed.names[j]), int(parsed.parents[j])
        placement = axes[parent] * parsed.jointPlacements[j]
        parent = new[parent]
        joint = parsed.joints[j]
        axes[j] = pin.SE3.Identity()
        if name in several:
            joint = pin.JointModelSpherical()
            if several[name] == "floating":
                parent = _add_slides(model, parent, placement, name)
                placement = pin.SE3.Identity()
            if name not in as_declared:
                to_centre = pin.SE3(rotation_with_axis("z", _centre_direction(parsed, j)), np.zeros(3))
                placement = placement * to_centre
                axes[j] = to_centre.inverse()
        new[j] = model.addJoint(parent, joint, placement, name)
        model.appendBodyToJoint(new[j], parsed.inertias[j], axes[j])
    for frame in list(parsed.frames)[1:]:  # not the universe
        j = int(frame.parentJoint)
        pose = axes[j] * frame.placement
        model.addFrame(pin.Frame(frame.name, new[j], frame.parentFrame, pose, frame.type), False)
    return model


def _add_slides(model: pin.Model, parent: int, placement: pin.SE3, name: str) -> int:
    """Add slides along x, y and z to a parent joint; return the last."""
    for suffix, slide in _SLIDES:
        parent = model.addJoint(parent, slide(), placement, f"{name}{suffix}")
        placement = pin.SE3.Identity()
    return parent


def _centre_direction(model: pin.Model, j: int) -> Array:
    """Return a vector (3,) from joint j to its centre of mass.

    Without one, to its farthest frame, else z.
    """
    inertia = model.inertias[j]
    if inertia.mass > 0 and np.linalg.norm(inertia.lever) > CENTRE_DISTANCE:
        return inertia.lever
    frames = [frame.placement.translation for frame in model.frames if frame.parentJoint == j]
    farthest = max(frames, key=np.linalg.norm)
    return farthest if np.linalg.norm(farthest) > CENTRE_DISTANCE else np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Names and axes of the entries of a model's velocity vector in files and messages."""

    model: pin.Model

    @cached_property
    def names(self) -> Names:
        """A name for each entry, (nv,): its joint's, of a ball NAME_rx, NAME_ry, NAME_rz."""
        return coordinate_names(self.model)

    def name_of(self, column: SupportsIndex) -> str:
        """Return the name of one entry."""
        return self.names[column]

    def positions(self, q: Array) -> Array:
        """Compute joint positions (T, nv) [rad, m] at q (T, nq): of balls, rotation vectors."""
        model = self.model
        if model.nq == model.nv:
            return q
        neutral = pin.neutral(model)
        from_neutral = [pin.difference(model, neutral, np.ascontiguousarray(row)) for row in q]
        return self.to_file_axes(np.asarray(from_neutral))

    def to_file_axes(self, v: Array) -> Array:
        """Convert tangent vectors v (T, nv) to the axes of files, see `file_axes`."""
        return v if self.model.nq == self.model.nv else v @ file_axes(self.model).T


def single_columns(model: pin.Model) -> frozenset[int]:
    """Return the columns of joints with one column: hinges and slides."""
    return frozenset(int(joint.idx_v) for joint in list(model.joints)[1:] if joint.nv == 1)


def coordinate_names(model: pin.Model) -> Names:
    """Return a name for each entry of the velocity vector, (nv,)."""
    names: list[str] = []
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        suffixes = SEVERAL["spherical"] if is_ball(joint) else ("",) * joint.nv
        names += [f"{name}{suffix}" for suffix in suffixes]
    return tuple(names)


def is_ball(joint: pin.JointModel) -> bool:
    """Whether a joint keeps a quaternion."""
    return bool(joint.shortname() == "JointModelSpherical")


@lru_cache(maxsize=64)
def ball_columns(model: pin.Model) -> IntArray:
    """Return the columns (b, 3) of balls in the velocity vector."""
    first = np.array([joint.idx_v for joint in model.joints if is_ball(joint)], dtype=np.intp)
    return first[:, None] + np.arange(3)


def file_axes(model: pin.Model) -> Array:
    """Return the matrix (nv, nv) from tangent vectors to coordinates on the axes of files.

    It is the identity except for balls, whose axes the model turns.
    """
    axes = np.eye(model.nv)
    for j, joint in enumerate(model.joints):
        if is_ball(joint):
            columns = slice(joint.idx_v, joint.idx_v + 3)
            axes[columns, columns] = link_axes(model, j).rotation.T
    return axes


def link_axes(model: pin.Model, j: int) -> pin.SE3:
    """Return the placement of the link's axes on joint j.

    It is the identity except for balls.
    """
    name = str(model.names[j])
    if model.existFrame(name, pin.FrameType.JOINT):
        return model.frames[model.getFrameId(name, pin.FrameType.JOINT)].placement
    return pin.SE3.Identity()


class JointLimit(NamedTuple):
    """The limits of one joint in a URDF."""

    joint: str
    coordinate: int  # its index in q
    column: int  # in the velocity vector
    lower: float
    upper: float
    unit: str  # rad or m


def joint_limits(urdf: ElementTree.Element, model: pin.Model) -> tuple[JointLimit, ...]:
    """Return the limits of all limited joints, in the order of the URDF."""
    limits = []
    for joint in urdf.findall("joint"):
        limit, kind = joint.find("limit"), joint.get("type")
        if limit is None or kind not in ("revolute", "prismatic"):
            continue
        lower, upper = (float(limit.get(key, "0")) for key in ("lower", "upper"))
        if lower == upper:
            continue
        name, unit = joint.get("name", ""), "m" if kind == "prismatic" else "rad"
        own = model.joints[model.getJointId(name)]
        limits.append(JointLimit(name, own.idx_q, own.idx_v, lower, upper, unit))
    return tuple(limits)


def shares_beyond_limits(limits: Sequence[JointLimit], q: Array) -> Array:
    """Compute by how much q (..., nq) exceeds each limit, over the joint's range, (..., limits)."""
    positions = q[..., [limit.coordinate for limit in limits]]
    lower = np.array([limit.lower for limit in limits])
    upper = np.array([limit.upper for limit in limits])
    rounding = SAME_PLACE * np.maximum(np.abs(lower), np.abs(upper))
    excess = np.maximum(lower - positions, positions - upper)
    return np.where(excess > rounding, excess, 0.0) / np.maximum(upper - lower, rounding)


def positions_beyond_limits(limits: Sequence[JointLimit], q: Array) -> dict[str, str]:
    """Describe the joints of q (T, nq) beyond their limits: `position -4.27 rad of -3.2` by joint."""
    exceeded = {}
    for limit in limits:
        positions, slack = q[:, limit.coordinate], SAME_PLACE * max(abs(limit.lower), abs(limit.upper))
        extremes = []  # beyond the limits, with the limit
        if limit.lower - positions.min() > slack:
            extremes.append((float(positions.min()), limit.lower))
        if positions.max() - limit.upper > slack:
            extremes.append((float(positions.max()), limit.upper))
        texts = (format_distinct(*pair, 6) for pair in extremes)
        if extremes:
            excesses = " and ".join(f"{position} {limit.unit} of {bound}" for position, bound in texts)
            exceeded[limit.joint] = f"position {excesses}"
    return exceeded
