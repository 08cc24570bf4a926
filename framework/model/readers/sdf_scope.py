"""The links, joints and frames of an SDF document: names, poses, and the links that carry frames.

Models may be nested, and may be included from other files. Names in nested models are `a::b`. A pose is
relative to another frame (`relative_to`), which the file may declare later. So all frames are collected
first, and placements are computed when all of them are known.

Source: sdformat.org, "Pose frame semantics".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from framework.errors import RobotFileError, check_choice, choose_from
from framework.model.documents import (
    attribute,
    child_element,
    parse_numbers,
    parse_xml,
    prefix_errors,
    remove_children,
)
from framework.model.placement import from_quaternion, from_rpy, invert_placement, placement
from framework.model.urdf_elements import local_name
from framework.numerics.arrays import Array
from framework.numerics.input import read_text

WORLD, MODEL_FRAME = "world", "__model__"  # SDF's names of the world's frame and of a model's own frame
TRUE_TEXTS = ("true", "1")  # texts of true
BALL_CONSTRAINT = "ball_constraint"
_CONSTRAINTS = {"weld_constraint": "fixed", BALL_CONSTRAINT: "ball"}  # types of joints by Drake's elements

_SDF_OF_CONFIG = re.compile(
    r"<sdf(?:\s+version=['\"]([\d.]*)['\"])?\s*>\s*([^<>]*[^<>\s])\s*</sdf>"
)  # version, file


@dataclass
class Scope:
    """The links, joints and frames of all models by scoped name."""

    version: float  # of SDF
    # of each frame the frame to which its pose is relative, and the pose as a placement (4, 4)
    relative: dict[str, tuple[str, Array]] = field(default_factory=lambda: {MODEL_FRAME: (WORLD, np.eye(4))})
    attached: dict[str, str] = field(default_factory=dict)  # the link or frame that carries each frame
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)  # the attribute `scope` is the model's prefix
    frames: list[str] = field(default_factory=list)  # the <frame> elements
    unread: list[str] = field(default_factory=list)  # included models without a file

    def placement_of(self, name: str, depth: int = 0) -> Array:
        """Compute the placement (4, 4) of a frame in the world, as in the file.

        `depth` counts the recursions, which do not end where frames are relative to one another.

        Raises:
            InvalidInput: there is no such frame.
            RobotFileError: the frame is relative to itself.
        """
        if name == WORLD:
            return np.eye(4)
        check_choice("frame", name, self.relative)
        if depth > len(self.relative):
            raise RobotFileError(f"frame {name!r}: is relative to itself")
        base, pose_in_base = self.relative[name]
        return self.placement_of(base, depth + 1) @ pose_in_base

    def link_of(self, name: str, depth: int = 0) -> str:
        """Return the link that carries a frame.

        `depth` counts the recursions, which do not end where frames are attached to one another.

        Raises:
            RobotFileError: there is no such frame, or it is attached to itself, so that no link carries it.
        """
        if name in self.links or name == WORLD:
            return name
        if name not in self.attached or depth > len(self.attached):
            raise RobotFileError(choose_from("link or frame", name, [*self.links, *self.attached]))
        return self.link_of(self.attached[name], depth + 1)


def scoped_name(prefix: str, name: str) -> str:
    """Return the scoped name of a name in the model with a prefix."""
    return name if name == WORLD else prefix + name


def child_text(element: Element, path: str, default: str) -> str:
    """Return the text of the element at a path, stripped; the default where there is none or it is empty."""
    return element.findtext(path, "").strip() or default


def end_name(joint: Element, end: str) -> str:
    """Return the scoped name of a joint's end, "parent" or "child".

    Raises:
        RobotFileError: the joint does not state this end.
    """
    name = child_text(joint, end, "")
    if not name:
        raise RobotFileError(f"joint {joint.get('name')!r}: <{end}> is missing")
    return scoped_name(joint.get("scope", ""), name)


# ------------------------------------------------------------------ models


def drop_detached(scope: Scope) -> Iterator[tuple[str, str]]:
    """Drop the joints of plugins whose links are not in the file, such as an object to be grasped.

    Yields:
        A sentence on each of them, and the name of its parent link.
    """
    for name, joint in list(scope.joints.items()):
        if joint.get("optional"):
            parent, child = (end_name(joint, end) for end in ("parent", "child"))
            try:
                scope.link_of(child)
                scope.link_of(parent)
            except RobotFileError as error:
                del scope.joints[name]
                yield f"<plugin> DetachableJoint of {parent} and {child}: {error}", parent


def add_models(scope: Scope, parent: Element, folder: Path, prefix: str, base: str) -> None:
    """Add the models in an element, and the models in files that the element includes.

    Args:
        parent: the element, such as a <world> or a <model>.
        folder: of the file, from which paths of included files start.
        prefix: of scoped names, such as "a::" in model a; empty in the world.
        base: frame to which a model's pose is relative by default.

    Raises:
        RobotFileError, InvalidInput: see `add_content`.
    """
    for model in parent.findall("model"):
        _add_model(scope, model, folder, prefix, base)
    for include in parent.findall("include"):
        uri = child_text(include, "uri", "").removeprefix("model://").removeprefix("file://")
        # beside the file, in the folder above, or in `models` there, as in packages of ROS
        places = (folder / uri, folder.parent / uri, folder.parent / "models" / uri)
        file = next((place for place in places if place.exists()), places[0])
        if file.is_dir():  # its model.config names a file for each version of SDF
            config = file / "model.config"
            text = read_text(config, "cannot read it", error=RobotFileError) if config.is_file() else ""
            file = file / max(_SDF_OF_CONFIG.findall(text), default=("", "model.sdf"))[1]
        if not file.is_file():
            scope.unread.append(f"<include> {uri}")  # often scenery, such as a ground plane
            continue
        with prefix_errors(f"<include> {uri}"):
            document = parse_xml(read_text(file, "cannot read it", error=RobotFileError))
            model = child_element(document, "<sdf>", "model")
        # name and pose of the <include> override those of the included model
        model.set("name", child_text(include, "name", model.get("name", "")))
        if poses := include.findall("pose"):
            remove_children(model, "pose")
            model.extend(poses)
        add = add_content if include.get("merge") in TRUE_TEXTS else _add_model
        add(scope, model, file.parent, prefix, base)


def _add_model(scope: Scope, model: Element, folder: Path, prefix: str, base: str) -> None:
    """Add a model and its content.

    The names in the first model of the world have no prefix, so that a file of one model keeps its names. The
    names in all others begin with the name of the model.

    Args:
        folder: of the file, from which paths of included files start.
        prefix: of scoped names outside of the model.
        base: frame to which the model's pose is relative by default.
    """
    name = attribute(model, "<model>", "name")
    scoped = f"{prefix}{name}"
    model_frame = f"{scoped}::{MODEL_FRAME}"
    is_first = base == WORLD and not prefix and not scope.links  # in the world, without a link before it
    inner = "" if is_first else f"{scoped}::"  # prefix of the model's content
    relative_to, pose = read_pose(model, prefix, base, f"model {name!r}")
    scope.relative[model_frame] = (relative_to, pose)
    if is_first:  # its frame has the name without a prefix, too
        scope.relative[MODEL_FRAME] = (model_frame, np.eye(4))
    add_content(scope, model, folder, inner, model_frame)

    # the canonical link, by default the first, carries the frame of the model under all names of this frame
    links = [link for link in scope.links if link.startswith(inner)]
    if links:
        canonical = model.get("canonical_link")
        link = f"{inner}{canonical}" if canonical else links[0]
        scope.attached |= dict.fromkeys((model_frame, f"{inner}{MODEL_FRAME}", scoped), link)
        scope.relative.setdefault(scoped, (model_frame, np.eye(4)))

    # with a placement frame the pose is that of this frame; the model's own follows from it
    if frame := model.get("placement_frame"):
        in_model = invert_placement(scope.placement_of(model_frame)) @ scope.placement_of(f"{inner}{frame}")
        scope.relative[model_frame] = (relative_to, pose @ invert_placement(in_model))


# ------------------------------------------------------------------ content of a model


def add_content(scope: Scope, model: Element, folder: Path, prefix: str, base: str) -> None:
    """Add the links, frames, joints and models of a model whose frame is `base`.

    A constraint of Drake becomes two frames and a joint.

    Args:
        folder: of the file, from which paths of included files start.
        prefix: of scoped names in the model, such as "a::" in model a.

    Raises:
        RobotFileError: an element has no name or that of another one; a pose, a constraint or the end of a
            joint is malformed; an included file is broken.
        InvalidInput: a placement frame does not exist.
    """
    elements = list(model)
    for number, element in enumerate(model):
        kind = local_name(element.tag)
        if kind in _CONSTRAINTS:
            elements += _constraint_elements(element, kind, f"{kind}_{number}")
        elif kind == "plugin" and "detachablejoint" in str(element.attrib).lower().replace("-", ""):
            elements.append(_detachable_joint(element, model, f"detachable_joint_{number}"))
    scope.frames += [prefix + frame.get("name", "") for frame in model.findall("frame")]
    for element in elements:
        if element.tag in ("link", "frame", "joint"):
            _add_element(scope, element, prefix, base)
    add_models(scope, model, folder, prefix, base)


def _add_element(scope: Scope, element: Element, prefix: str, base: str) -> None:
    """Add a link, frame or joint to the scope, with pose and carrier.

    Args:
        prefix: of scoped names in the model of the element.
        base: frame of this model, to which poses are relative by default.
    """
    tag = element.tag
    name = prefix + attribute(element, f"<{tag}>", "name")
    if name in (scope.joints if tag == "joint" else scope.relative):
        raise RobotFileError(f"duplicate {tag} {name!r}")
    default_frame = base  # to which the pose is relative unless it names a frame
    if tag == "link":
        scope.links[name] = element
    elif tag == "frame":
        if attached_to := element.get("attached_to"):
            default_frame = scoped_name(prefix, attached_to)
        scope.attached[name] = default_frame
    else:
        element.set("scope", prefix)  # `end_name` reads the ends of the joint relative to it
        scope.joints[name] = element
        _move_to_frames(element, name)
        default_frame = end_name(element, "child")
        scope.attached.setdefault(name, default_frame)
    pose = read_pose(element, prefix, default_frame, f"{tag} {name!r}")
    # a joint may have the name of a link or frame, so its pose has a key of its own, too
    if tag == "joint":
        scope.relative[f"joint {name}"] = pose
    scope.relative.setdefault(name, pose)


def _move_to_frames(joint: Element, name: str) -> None:
    """Make the frames of Drake's `<drake:parent_frame>` and `<drake:child_frame>` the ends of a joint.

    The joint then has no pose of its own: it stands in one frame on each of its links.
    """
    parts = {local_name(child.tag): child.text or "" for child in joint}
    frames = {end: parts[f"{end}_frame"].strip() for end in ("parent", "child") if f"{end}_frame" in parts}
    if len(frames) == 1:
        raise RobotFileError(f"joint {name!r}: needs both drake:parent_frame and drake:child_frame")
    for end, frame in frames.items():
        end_name(joint, end)  # raises an error if it is missing
        remove_children(joint, end)
        SubElement(joint, end, {"is_frame": "true"}).text = frame
        remove_children(joint, "pose")


def _detachable_joint(plugin: Element, model: Element, name: str) -> Element:
    """Return the fixed joint that Gazebo's plugin DetachableJoint makes when it starts.

    Args:
        plugin: names a link of the `model`, and a link of a model.
        model: of the plugin.
        name: of the joint.
    """
    where = "<plugin> DetachableJoint"
    parts = {tag: child_text(plugin, tag, "") for tag in ("parent_link", "child_model", "child_link")}
    for tag, value in parts.items():
        if not value:
            raise RobotFileError(f"{where}: <{tag}> is missing")
    joint = Element("joint", name=name, type="fixed", optional="true")  # the model may be spawned later
    SubElement(joint, "parent").text = parts["parent_link"]
    is_own = parts["child_model"] == model.get("name")
    child = parts["child_link"] if is_own else f"{parts['child_model']}::{parts['child_link']}"
    SubElement(joint, "child").text = child
    return joint


def _constraint_elements(element: Element, kind: str, name: str) -> Iterator[Element]:
    """Yield two frames and a joint that stand for Drake's constraint of two bodies.

    In SDF the children of the constraint state their values as text, in a URDF as an attribute.

    Args:
        kind: one of _CONSTRAINTS.
        name: of the joint, with which the names of the frames begin.
    """
    parts: dict[str, str] = {}
    for child in element:
        text = child.text or child.get("name") or child.get("value") or ""
        parts[local_name(child.tag).removeprefix(f"{BALL_CONSTRAINT}_")] = text.strip()
    joint = Element("joint", name=name, type=_CONSTRAINTS[kind])
    default_point = "" if kind == BALL_CONSTRAINT else "0 0 0"
    for end, body_part, point_part in (("parent", "body_A", "p_AP"), ("child", "body_B", "p_BQ")):
        body = parts.get(end) or parts.get(body_part)
        point = parts.get(point_part) or default_point
        for part, value in ((body_part, body), (point_part, point)):
            if not value:
                raise RobotFileError(f"<{kind}>: {part} is missing")
        parse_numbers(f"<{kind}> {point_part}", point, 3)
        frame = Element("frame", name=f"{name}_at_{end}", attached_to=str(body))
        SubElement(frame, "pose").text = f"{point} 0 0 0"
        SubElement(joint, end).text = frame.get("name")
        yield frame
    yield joint


# ------------------------------------------------------------------ poses


def read_pose(element: Element, prefix: str, default: str, where: str) -> tuple[str, Array]:
    """Read the pose of an element: a frame, and the placement (4, 4) in this frame.

    The frame is `default` unless the pose names another one in the model with the `prefix`.
    """
    pose = element.find("pose")
    relative_to = None if pose is None else pose.get("relative_to") or pose.get("frame")
    frame = scoped_name(prefix, relative_to) if relative_to else default
    return frame, read_placement(pose, where)


def read_placement(pose: Element | None, where: str) -> Array:
    """Read the placement (4, 4) in a `<pose>`; the identity without one.

    Raises:
        RobotFileError: the pose is malformed; the message names the element `where`.
    """
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    has_quaternion = pose.get("rotation_format") == "quat_xyzw"
    numbers = parse_numbers(f"{where}: <pose>", pose.text, 7 if has_quaternion else 6)
    position, orientation = numbers[:3], numbers[3:]
    if has_quaternion:
        x, y, z, w = orientation
        return placement(from_quaternion(w, x, y, z), position)
    in_degrees = pose.get("degrees") in TRUE_TEXTS
    return placement(from_rpy(np.radians(orientation) if in_degrees else orientation), position)
