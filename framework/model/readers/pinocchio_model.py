"""The tree of a `pinocchio.Model`, and loops from its constraint models.

A joint of the model becomes a joint of its name, and the body behind it a link NAME_body. A frame becomes a
link fixed there, under its own name; the frame of a joint is the joint. Placements, inertias, armature,
viscous damping and limits of position are the model's. Dry friction and limits of effort and speed are those
that the caller states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, expect, finite_numbers
from framework.model.description import AXES
from framework.model.robot_file import describe_tree
from framework.model.robot_keys import closure_entry
from framework.model.urdf_edits import add_frame, free_name, inertial_element, urdf_text
from framework.model.urdf_elements import (
    COORDINATE_SUFFIXES,
    ENDLESS,
    UNIVERSE,
    Joint,
    ParsedRobot,
    Tree,
    check_tree,
)
from framework.numerics.arrays import ArrayLike

_SEVERAL = {"JointModelSpherical": "spherical", "JointModelFreeFlyer": "floating"}
_CONTACTS = {pin.ContactType.CONTACT_3D: list(AXES[:3]), pin.ContactType.CONTACT_6D: list(AXES)}


def parse_pinocchio(
    model: pin.Model,
    closures: Sequence[Any],
    actuators: Sequence[Any],
    platform: Mapping[str, Any],
    *,
    reference: ArrayLike | Mapping[str, float] | None,
    name: str,
    keys: Mapping[str, Any],
) -> ParsedRobot:
    """Describe a robot of a pinocchio model, see `ParallelRobot.from_pinocchio`.

    Raises:
        RobotFileError: a value is not what the key of a robot file of its name takes.
        InvalidInput: a joint of the model is of a kind that URDF does not have.
    """
    expect("model", model, pin.Model, "pin.buildModelFromUrdf(file)")
    expect("platform", platform, Mapping, '{"frame": "tip", "axes": ["x", "y"]}')
    tree = _tree_of(model, name)
    content: dict[str, Any] = {
        "gravity": model.gravity.linear.tolist(),
        "platform": dict(platform),
        "actuators": [dict(each) if isinstance(each, Mapping) else {"joint": each} for each in actuators],
        "closures": [_closure(tree, model, k, each) for k, each in enumerate(closures)],
        "reference": reference if isinstance(reference, Mapping) else _positions(model, reference),
        **keys,
        "joints": {**_dynamics(model), **keys.get("joints", {})},
    }
    check_tree(tree)
    parsed = describe_tree(Path(f"{name}.yaml"), urdf_text(tree), tree, content, {})
    return parsed._replace(dialect="pinocchio", joint_order=tuple(model.names[1:]))


# ------------------------------------------------------------------ the tree


def _tree_of(model: pin.Model, name: str) -> Tree:
    """Return the tree of a model."""
    joints = list(model.names[1:])
    taken = {frame.name for frame in model.frames} | set(joints)
    bodies = [UNIVERSE, *(free_name(f"{joint}_body", taken) for joint in joints)]
    tree = Tree(name, {body: Element("link", name=body) for body in bodies})
    for body, inertia in zip(bodies[1:], list(model.inertias)[1:], strict=True):
        if inertia.mass > 0.0:
            tree.links[body].append(inertial_element(inertia.mass, inertia.lever, inertia.inertia))
    for j, joint in enumerate(_joints(model), start=1):
        tree.put(replace(joint, parent=bodies[model.parents[j]], child=bodies[j]))
    written = {*joints, UNIVERSE}
    for frame in model.frames:
        if frame.name not in written:
            written.add(frame.name)
            add_frame(tree, frame.name, bodies[frame.parentJoint], frame.placement.homogeneous)
    return tree


def _joints(model: pin.Model) -> Iterator[Joint]:
    """Yield the joints of a model.

    The axis of a joint of one freedom is its unit velocity, linear or angular, in its own frame.
    """
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for j in range(1, model.njoints):
        joint, name = model.joints[j], model.names[j]
        origin = model.jointPlacements[j].homogeneous
        if joint.shortname() in _SEVERAL:
            yield Joint(name, _SEVERAL[joint.shortname()], origin)
            continue
        twist = pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL)[:, joint.idx_v]
        linear, angular = twist[:3], twist[3:]
        if joint.nv != 1 or (linear.any() and angular.any()):
            raise InvalidInput(
                f"model: joint {name!r} is a {joint.shortname().removeprefix('JointModel')}; take hinges, "
                f"slides, balls and free flyers in its place"
            )
        if joint.nq == 2:
            yield Joint(name, "continuous", origin, angular)
            continue
        k = joint.idx_q
        limits = np.clip((model.lowerPositionLimit[k], model.upperPositionLimit[k]), -ENDLESS, ENDLESS)
        stated = None if np.isnan(limits).any() or min(np.abs(limits)) == ENDLESS else tuple(limits.tolist())
        kind = "prismatic" if linear.any() else "revolute"
        yield Joint(name, kind, origin, linear if linear.any() else angular, stated)


def _dynamics(model: pin.Model) -> dict[str, dict[str, float]]:
    """Return armature and viscous damping of the joints by name.

    Those of a ball are of its last axis.
    """
    entries = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        column = joint.idx_v + joint.nv - 1  # of a free flyer a turn
        values = {"armature": float(model.armature[column]), "damping": float(model.damping[column])}
        if stated := {key: value for key, value in values.items() if value}:
            entries[name] = stated
    return entries


# ------------------------------------------------------------------ what the model does not say


def _closure(tree: Tree, model: pin.Model, index: int, given: Any) -> dict[str, Any]:
    """Return a loop as an entry of a robot file.

    The frames of a constraint model are added to `tree`. `given` is an entry; two frames with a kind, and an
    axis or a length of some kinds; or a constraint model of a point (3D) or of a pose (6D).
    """
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, tuple | list) and 2 <= len(given) <= 4:
        return closure_entry(given)
    what = f"closures[{index}]"
    if not hasattr(given, "joint1_placement"):
        raise InvalidInput(
            f"{what}: needs two frames and a kind, such as ('tip', 'other_tip', 'spherical'), or a "
            f"pin.RigidConstraintModel, got {given!r}"
        )
    if given.type not in _CONTACTS:
        raise InvalidInput(f"{what}: needs a contact of type CONTACT_3D or CONTACT_6D, got {given.type}")
    links = list(tree.links)  # universe, then one for each joint
    taken, name = set(links), given.name or f"loop_{index}"
    frames: list[str] = []
    for joint, pose in ((given.joint1_id, given.joint1_placement), (given.joint2_id, given.joint2_placement)):
        frames.append(free_name(f"{name}_{len(frames) + 1}", taken))
        add_frame(tree, frames[-1], links[joint], pose.homogeneous)
    return {"name": name, "frames": frames, "axes": _CONTACTS[given.type]}


def _positions(model: pin.Model, q: ArrayLike | None) -> dict[str, float]:
    """Return the positions of all joints at q (nq,) by name; neutral by default."""
    neutral = pin.neutral(model)
    stated = neutral if q is None else finite_numbers("reference, the model's q,", q, model.nq)
    values = pin.difference(model, neutral, stated)
    positions: dict[str, float] = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        own = values[joint.idx_v : joint.idx_v + joint.nv]
        suffixes = COORDINATE_SUFFIXES[_SEVERAL[joint.shortname()]] if joint.nv > 1 else ("",)
        if joint.nv == 6:  # pinocchio's difference of free flyers is a screw
            own = np.concatenate([stated[joint.idx_q : joint.idx_q + 3], own[3:]])
        positions |= {f"{name}{suffix}": float(x) for suffix, x in zip(suffixes, own, strict=True)}
    return positions
