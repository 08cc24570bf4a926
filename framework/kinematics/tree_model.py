"""Pinocchio's model of the open tree, and the names of its coordinates.

A ball keeps a quaternion, so that no pose of it is singular, as those of three hinges in series are where the
second has turned by a right angle. A floating joint is three slides and a ball. The velocity of a ball is the
angular velocity of what it carries relative to what carries it, about axes that move along; the third of them
goes through the centre of mass behind the ball. So a rod that spins idly between two balls spins about that
axis, and planning holds the one rate at zero, whatever the frame of the rod is. Files, tables and messages
say a ball by its rotation vector about the axes of the joint's origin.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.model.placement import turning
from framework.model.urdf_elements import SEVERAL

_SLIDES = (("_x", pin.JointModelPX), ("_y", pin.JointModelPY), ("_z", pin.JointModelPZ))
ON_CENTRE = 1e-12  # [m] nearer to the ball's centre than this, a centre of mass gives no direction


def tree_model(urdf: ElementTree.Element) -> pin.Model:
    """The model of a URDF as `bare_urdf` leaves it, which is used up.

    Raises:
        ValueError, RuntimeError: of pinocchio's parser.
    """
    several = {}
    for joint in urdf.findall("joint"):
        if (kind := joint.get("type", "")) in SEVERAL:
            several[joint.get("name", "")] = kind
            joint.set("type", "floating")  # the only one that the parser knows
    model = pin.buildModelFromXML(ElementTree.tostring(urdf, encoding="unicode"))
    return _with_balls(model, several) if several else model


def _with_balls(parsed: pin.Model, several: Mapping[str, str]) -> pin.Model:
    """The model with balls, behind slides if they float, in place of the joints that are named."""
    model = pin.Model()
    model.name = parsed.name
    identity = pin.SE3.Identity()
    index, turned = {0: 0}, {0: identity}  # the new joint of each old one, and its old place in the new one
    for j in range(1, parsed.njoints):
        name, parent = str(parsed.names[j]), int(parsed.parents[j])
        place, new, inertia = turned[parent] * parsed.jointPlacements[j], index[parent], parsed.inertias[j]
        turned[j] = identity
        if name not in several:
            index[j] = model.addJoint(new, parsed.joints[j], place, name)
        else:
            if several[name] == "floating":
                for suffix, slide in _SLIDES:
                    new, place = model.addJoint(new, slide(), place, f"{name}{suffix}"), identity
            axes = pin.SE3(turning("z", _along(parsed, j)), np.zeros(3))
            turned[j] = axes.inverse()
            index[j] = model.addJoint(new, pin.JointModelSpherical(), place * axes, name)
        model.appendBodyToJoint(index[j], inertia, turned[j])
    for frame in list(parsed.frames)[1:]:  # not the universe
        joint = int(frame.parentJoint)
        placed = pin.Frame(
            frame.name, index[joint], frame.parentFrame, turned[joint] * frame.placement, frame.type
        )
        model.addFrame(placed, False)  # the bodies are there
    return model


def _along(model: pin.Model, j: int) -> Array:
    """From joint j towards the centre of mass behind it, or, if that is none, its farthest frame (3,)."""
    inertia = model.inertias[j]
    if inertia.mass > 0 and np.linalg.norm(inertia.lever) > ON_CENTRE:
        return np.asarray(inertia.lever)
    frames = [frame.placement.translation for frame in model.frames if frame.parentJoint == j]
    farthest = max(frames, key=np.linalg.norm)
    return farthest if np.linalg.norm(farthest) > ON_CENTRE else np.array([0.0, 0.0, 1.0])


def coordinate_names(model: pin.Model) -> tuple[str, ...]:
    """A name for each entry of the velocity vector, (nv,)."""
    return tuple(
        f"{name}{suffix}"
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True)
        for suffix in (SEVERAL["spherical"] if is_ball(joint) else ("",) * joint.nv)
    )


def is_ball(joint: pin.JointModel) -> bool:
    """Whether a joint keeps a quaternion."""
    return bool(joint.shortname() == "JointModelSpherical")


def named_axes(model: pin.Model) -> Array:
    """Takes a tangent vector from the neutral configuration to the coordinates as files have them, (nv, nv).

    The identity but for balls, whose axes the model turns.
    """
    axes = np.eye(model.nv)
    for j in range(1, model.njoints):
        if is_ball(model.joints[j]):
            own = slice(model.joints[j].idx_v, model.joints[j].idx_v + 3)
            name = str(model.names[j])
            if model.existFrame(name, pin.FrameType.JOINT):
                frame = model.frames[model.getFrameId(name, pin.FrameType.JOINT)]
                axes[own, own] = frame.placement.rotation.T
    return axes
