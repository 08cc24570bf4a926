"""SDFormat 1.4 to 1.12: the joints of a model need no tree, and those that close loops become closures.

Read are models, also in a world, in a model and by `<include>` of a file beside it (`a::b` names what is
nested); frames and poses with `relative_to` and `attached_to`; joints fixed, revolute, prismatic, universal,
revolute2, ball and screw with limits, damping, friction, springs and `<mimic>`; inertias and primitive
shapes. A screw is a turn and a coupled slide, and cannot close a loop. A joint whose parent is a `<frame>`
stands in that frame, so that the loops may be open where the file has its
links. Joints with something of their own, such as a limit, stay in the tree, others are cut first. Joints
that a plugin names are likely motors. The file says nothing about the platform.

Source: sdformat.org, "Pose frame semantics".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from framework.errors import RobotFileError, check_choice, check_name, choose_from
from framework.model.description import Coupling, JointDynamics, ParsedRobot, locked_axes
from framework.model.documents import (
    attribute,
    child_element,
    parse_numbers,
    parse_xml,
    prefix_errors,
    remove_children,
)
from framework.model.placement import from_quaternion, from_rpy, invert_placement, placement
from framework.model.readers.describe import Options, describe
from framework.model.readers.urdf_tree import UnreadElement, UrdfTree, merge_overlapping
from framework.model.urdf_edits import NewJoint, chain_elements, inertial_element, visual_element
from framework.model.urdf_elements import ENTRIES, local_name, symmetric_matrix
from framework.numerics.arrays import Array
from framework.numerics.fields import vector3
from framework.numerics.input import read_text

WORLD, MODEL = "world", "__model__"
UNLIMITED = 1e15  # [rad, m] larger ones stand for no limit
_KINDS = {kind: kind for kind in ("fixed", "revolute", "prismatic", "universal", "screw")} | {
    "continuous": "revolute",
    "revolute2": "universal",
    "ball": "spherical",
}
# motions of one freedom by kind: what ends the name, the joint of the URDF, the element of its properties
_MOTIONS = {  # of each kind: suffix of the motion's name, motion, tag of its axis
    "revolute": (("", "continuous", "axis"),),
    "prismatic": (("", "prismatic", "axis"),),
    "universal": (("", "continuous", "axis"), ("_2", "continuous", "axis2")),
    "screw": (("", "continuous", "axis"), ("_slide", "prismatic", "slide")),
}
_NOT_READ = ("gearbox",)
_UNUSED = ("plugin", "sensor", "light", "battery", "actor", "projector", "particle_emitter", "gripper")
BALL_CONSTRAINT = "ball_constraint"
_CONSTRAINTS = {"weld_constraint": "fixed", BALL_CONSTRAINT: "ball"}  # of Drake
_OWN = ("dynamics", "limit", "mimic")  # what a joint of the tree can have, and a closure cannot
_DYNAMICS = {
    "damping": "damping",
    "friction": "friction",
    "stiffness": "spring_stiffness",
    "rest": "spring_reference",
}
_INERTIA = {"mass": "1"} | {f"inertia/{key}": one for key, one in zip(ENTRIES, "111000", strict=True)}
_SHAPES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length")}
_VERSION_OF_JOINT_AXES = 1.5  # before, axes were in the frame of the model


@dataclass
class Scope:
    """The frames of all models by scoped name, each with its base frame, relative pose and body."""

    version: float
    relative: dict[str, tuple[str, Array]] = field(default_factory=lambda: {MODEL: (WORLD, np.eye(4))})
    attached: dict[str, str] = field(default_factory=dict)
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)  # with their `scope`

    def place(self, name: str, depth: int = 0) -> Array:
        """Return the placement (4, 4) of a frame in the world, as in the file."""
        if name == WORLD:
            return np.eye(4)
        check_choice("frame", name, self.relative)
        if depth > len(self.relative):
            raise RobotFileError(f"frame {name!r}: is relative to itself")
        base, pose = self.relative[name]
        return self.place(base, depth + 1) @ pose

    def link_of(self, name: str, depth: int = 0) -> str:
        """Return the link that carries a frame."""
        if name in self.links or name == WORLD:
            return name
        if name not in self.attached or depth > len(self.attached):
            raise RobotFileError(choose_from("link or frame", name, [*self.links, *self.attached]))
        return self.link_of(self.attached[name], depth + 1)


class _Joint(NamedTuple):
    """A joint with motions, dynamics, and its placements in both links."""

    name: str
    element: Element
    kind: str
    links: tuple[str, str]  # of the parent first
    places: tuple[Array, Array]  # (4, 4), of the joint in each link's frame
    motions: tuple[NewJoint, ...]  # in the joint's frame
    dynamics: dict[str, JointDynamics]  # by motion, none where nothing acts

    def chain(self, *, is_reversed: bool) -> list[NewJoint]:
        """Return the motions as joints of a URDF from parent to child, or in reverse."""
        motions = list(self.motions)
        if is_reversed:
            opposite = (None if motion.axis is None else -motion.axis for motion in motions)
            pairs = zip(motions, opposite, strict=True)
            motions = [motion._replace(axis=axis) for motion, axis in pairs][::-1]
        return [motions[0]._replace(origin=self.places[is_reversed]), *motions[1:]]


def read_sdf(file: Path, root: Element, options: Options) -> ParsedRobot:
    """Read the robot in an SDF file; raise RobotFileError with the element's name."""
    (version,) = parse_numbers("<sdf> version", root.get("version", "1.4"), 1)
    scope = Scope(version)
    for parent in (root, *root.findall("world")):
        _add_models(scope, parent, file.parent, "", WORLD)
    joints = _joints_of_main_part(scope)
    tree_names = _choose_tree_joints(scope, joints)
    tree = UrdfTree(_make_urdf(scope, joints, tree_names, file.stem))
    tree.unused += Counter({f"<{tag}>": len(list(root.iter(tag))) for tag in _UNUSED})  # without zeros
    tree.gravity = vector3("<gravity>", root.findtext("world/gravity", "0 0 -9.81").split())
    named_by_plugins = [element.text or "" for element in root.iter("joint_name")]
    tree.likely_motors = [name for name in tree_names if name.rsplit("::", 1)[-1] in named_by_plugins]
    _report_unread_parts(scope, tree, joints)
    for joint in joints:
        if joint.name in tree_names:
            tree.couplings += _read_couplings(joint, tree_names)
            tree.dynamics |= joint.dynamics
        else:
            _close_cut_joint(tree, joint)
            _report_cut_properties(tree, joint)
    return describe(tree, file, options, "sdf")


def _report_cut_properties(tree: UrdfTree, joint: _Joint) -> None:
    """Report dynamics and mimic of a joint where a loop is cut: a closure has neither."""
    properties = {"dynamics": bool(joint.dynamics), "mimic": _has_property(joint.element, "mimic")}
    for name, is_there in properties.items():
        if is_there:
            text = f"joint {joint.name!r}: its {name}, where the loop is cut"
            tree.left_out.append(UnreadElement(text, (joint.links[1],)))


def _report_unread_parts(scope: Scope, tree: UrdfTree, joints: Sequence[_Joint]) -> None:
    """Report gearboxes, links without gravity, and links beside the mechanism."""
    for name, element in reversed(scope.joints.items()):
        if (kind := element.get("type")) in _NOT_READ:
            acts_on = name, *_links_of_joint(scope, name)
            gear = UnreadElement(f"joint {name!r}: {kind}: not read", acts_on, is_decisive=True)
            tree.left_out.insert(0, gear)
    part, apart = {link for joint in joints for link in joint.links}, []
    for name, link in scope.links.items():
        mass = link.findtext("inertial/mass", "1").strip()
        if link.findtext("gravity", "1").strip() in ("0", "false"):
            tree.left_out.append(UnreadElement(f"link {name!r}: <gravity> off, {mass} kg", (name,)))
        if name not in part:
            apart.append(f"{name} of {mass} kg")
    if apart:
        tree.remarks.append(f"not read: {', '.join(apart)}, which no joint joins with the mechanism")


def _scope_name(prefix: str, name: str) -> str:
    """Return the scoped name of a name in a model."""
    return name if name == WORLD else prefix + name


def _read_values(element: Element, where: str, defaults: Mapping[str, str]) -> list[float]:
    """Read the number at each path below an element, or its default."""
    return [
        parse_numbers(f"{where}: <{path.rsplit('/', 1)[-1]}>", element.findtext(path, default), 1)[0]
        for path, default in defaults.items()
    ]


# ------------------------------------------------------------------ models and frames


def _add_models(scope: Scope, parent: Element, folder: Path, prefix: str, base: str) -> None:
    """Add the models in an element and in its included files."""
    for model in parent.findall("model"):
        _add_model(scope, model, folder, prefix, base)
    for include in parent.findall("include"):
        uri = (include.findtext("uri") or "").removeprefix("model://").removeprefix("file://")
        file = next((f for f in (folder / uri, folder.parent / uri) if f.exists()), folder / uri)
        if file.is_dir():
            file = file / "model.sdf"
        if not file.is_file():
            continue  # scenery, such as a ground plane; a joint to it says what is missing
        with prefix_errors(f"<include> {uri}"):
            document = parse_xml(read_text(file, "cannot read it", error=RobotFileError))
            model = child_element(document, "<sdf>", "model")
        model.set("name", include.findtext("name") or model.get("name") or "")
        if poses := include.findall("pose"):
            remove_children(model, "pose")
            model.extend(poses)
        add = add_content if include.get("merge") in ("true", "1") else _add_model
        add(scope, model, file.parent, prefix, base)


def _add_model(scope: Scope, model: Element, folder: Path, prefix: str, base: str) -> None:
    """Add a model to the scope; if nested or not the first, prefix its names."""
    name = attribute(model, "<model>", "name")
    full = f"{prefix}{name}"
    own, is_first = f"{full}::{MODEL}", base == WORLD and not prefix and not scope.links
    inner = "" if is_first else f"{full}::"
    relative, pose = _read_pose(model, prefix, base, f"model {name!r}")
    scope.relative[own] = (relative, pose)
    if is_first:
        scope.relative[MODEL] = (own, np.eye(4))
    add_content(scope, model, folder, inner, own)
    links = [key for key in scope.links if key.startswith(inner)]
    canonical = model.get("canonical_link")
    if links:
        link = f"{inner}{canonical}" if canonical else links[0]
        scope.attached |= dict.fromkeys((own, f"{inner}{MODEL}", full), link)
        scope.relative.setdefault(full, (own, np.eye(4)))
    if frame := model.get("placement_frame"):
        within = invert_placement(scope.place(own)) @ scope.place(f"{inner}{frame}")
        scope.relative[own] = (relative, pose @ invert_placement(within))


def add_content(scope: Scope, model: Element, folder: Path, prefix: str, base: str) -> None:
    """Add the links, frames, joints and models of a model whose frame is `base`."""
    replaced = [
        part
        for number, element in enumerate(model)
        if local_name(element.tag) in _CONSTRAINTS
        for part in _constraint_elements(element, f"{local_name(element.tag)}_{number}")
    ]
    for element in (*model, *replaced):
        tag, default = element.tag, base
        if tag not in ("link", "frame", "joint"):
            continue
        name = prefix + attribute(element, f"<{tag}>", "name")
        if name in (scope.joints if tag == "joint" else scope.relative):
            raise RobotFileError(f"duplicate {tag} {name!r}")
        if tag == "link":
            scope.links[name] = element
        elif tag == "frame":
            to = element.get("attached_to")
            default = scope.attached[name] = _scope_name(prefix, to) if to else base
        else:
            element.set("scope", prefix)
            scope.joints[name] = element
            default = _end_name(element, "child")
            scope.attached.setdefault(name, default)
        pose = _read_pose(element, prefix, default, f"{tag} {name!r}")
        if tag == "joint":
            scope.relative[f"joint {name}"] = pose
        scope.relative.setdefault(name, pose)
    _add_models(scope, model, folder, prefix, base)


def _constraint_elements(element: Element, name: str) -> Iterator[Element]:
    """Yield Drake's constraint of two bodies as two frames and a joint."""
    kind, parts = local_name(element.tag), dict[str, str]()
    for child in element:  # of SDF with a text, of URDF with an attribute
        text = child.text or child.get("name") or child.get("value") or ""
        parts[local_name(child.tag).removeprefix(f"{BALL_CONSTRAINT}_")] = text.strip()
    joint = Element("joint", name=name, type=_CONSTRAINTS[kind])
    origin = "" if kind == BALL_CONSTRAINT else "0 0 0"  # a ball needs its points
    for end, body, point in (("parent", "body_A", "p_AP"), ("child", "body_B", "p_BQ")):
        needed = {body: parts.get(end) or parts.get(body) or "", point: parts.get(point) or origin}
        for part, text in needed.items():
            if not text:
                raise RobotFileError(f"<{kind}>: {part} is missing")
        parse_numbers(f"<{kind}> {point}", needed[point], 3)
        frame = Element("frame", name=f"{name}_at_{end}", attached_to=needed[body])
        SubElement(frame, "pose").text = f"{needed[point]} 0 0 0"
        SubElement(joint, end).text = frame.get("name")
        yield frame
    yield joint


def _end_name(joint: Element, end: str) -> str:
    """Return the scoped name of the parent or child of a joint."""
    name = (joint.findtext(end) or "").strip()
    if not name:
        raise RobotFileError(f"joint {joint.get('name')!r}: <{end}> is missing")
    return _scope_name(joint.get("scope", ""), name)


def _read_pose(element: Element, prefix: str, default: str, where: str) -> tuple[str, Array]:
    """Read an element's `<pose>`: its base frame, and the placement (4, 4)."""
    pose = element.find("pose")
    if pose is None:
        return default, np.eye(4)
    to = pose.get("relative_to") or pose.get("frame")
    has_quaternion = pose.get("rotation_format") == "quat_xyzw"
    count = 7 if has_quaternion else 6
    position, turn = np.split(parse_numbers(f"{where}: <pose>", pose.text or " 0" * count, count), [3])
    if has_quaternion:
        matrix = from_quaternion(*np.roll(turn, 1))
    else:
        matrix = from_rpy(np.radians(turn) if pose.get("degrees") in ("true", "1") else turn)
    return _scope_name(prefix, to) if to else default, placement(matrix, position)


# ------------------------------------------------------------------ joints


def _links_of_joint(scope: Scope, name: str) -> tuple[str, str]:
    """Return the links of a joint, parent first."""
    joint, where = scope.joints[name], f"joint {name!r}"
    kind = attribute(joint, where, "type")
    check_name(where, "type", kind, (*_KINDS, *_NOT_READ))
    with prefix_errors(where):
        first, second = (scope.link_of(_end_name(joint, end)) for end in ("parent", "child"))
    if first == second:
        raise RobotFileError(f"{where}: joins {first!r} with itself")
    return first, second


def _make_joint(scope: Scope, name: str, links: tuple[str, str]) -> _Joint:
    """Make a joint with its motions, placed in its parent's frame and in its child's."""
    element = scope.joints[name]
    kind = _KINDS.get(element.get("type", ""), "fixed")
    ends = [scope.place(f"joint {name}")] * 2  # of the joint on its parent and its child
    parent = _end_name(element, "parent")
    if parent in scope.attached and parent not in scope.links:  # a frame, which the joint begins at
        ends[0] = scope.place(parent)
    in_parent, in_child = (
        invert_placement(scope.place(link)) @ end for link, end in zip(links, ends, strict=True)
    )
    motions, dynamics = [], dict[str, JointDynamics]()
    for suffix, motion, tag in _MOTIONS.get(kind, ()):
        axis = _read_axis(scope, name, "axis" if tag == "slide" else tag)  # a screw slides along its axis
        motions.append(NewJoint(name + suffix, motion, np.eye(4), axis, _read_limits(element, name, tag)))
        if (acting := _read_dynamics(element, name, tag)) != JointDynamics():
            dynamics[name + suffix] = acting
    motions = motions or [NewJoint(name, kind, np.eye(4))]
    return _Joint(name, element, kind, links, (in_parent, in_child), tuple(motions), dynamics)


def _read_dynamics(joint: Element, name: str, tag: str) -> JointDynamics:
    """Read damping, friction and spring along an axis of a joint."""
    paths = {f"{tag}/dynamics/{key}": "0" for key in _DYNAMICS.values()}
    values = dict(zip(_DYNAMICS, _read_values(joint, f"joint {name!r}", paths), strict=True))
    return JointDynamics(**values | ({} if values["stiffness"] else {"rest": 0.0}))


def _read_axis(scope: Scope, name: str, tag: str) -> Array:
    """Read an axis (3,) of a joint, in the joint's frame."""
    joint, where = scope.joints[name], f"joint {name!r}: <{tag}>"
    axis = np.array(parse_numbers(f"{where} xyz", joint.findtext(f"{tag}/xyz", "0 0 1"), 3))
    if not axis.any():
        raise RobotFileError(f"{where}: the axis is zero")
    xyz = joint.find(f"{tag}/xyz")
    within = None if xyz is None else xyz.get("expressed_in")
    in_model = (joint.findtext(f"{tag}/use_parent_model_frame") or "").strip() in ("true", "1")
    if not within and not in_model and scope.version >= _VERSION_OF_JOINT_AXES:
        return axis
    frame = scope.place(_scope_name(joint.get("scope", ""), within or MODEL))
    return scope.place(f"joint {name}")[:3, :3].T @ frame[:3, :3] @ axis


def _has_property(joint: Element, *properties: str) -> bool:
    """Return whether an axis of a joint has one of the properties."""
    return any(axis.find(tag) is not None for axis in joint.findall("axis") for tag in properties)


def _read_couplings(joint: _Joint, names: Sequence[str]) -> Iterator[Coupling]:
    """Yield the couplings of a mimic joint and of a screw's slide."""
    where, element = f"joint {joint.name!r}", joint.element
    for mimic in element.findall("axis/mimic"):
        of = element.get("scope", "") + (mimic.get("joint") or "")
        check_name(f"{where}: <mimic>", "joint", of, names)
        defaults = {"multiplier": "1", "offset": "0", "reference": "0"}
        ratio, offset, reference = _read_values(mimic, f"{where}: <mimic>", defaults)
        yield Coupling(joint.name, of, ratio, offset - ratio * reference)
    if joint.kind == "screw":
        pitch, left_handed = _read_values(element, where, {"screw_thread_pitch": "1", "thread_pitch": "0"})
        lead = pitch / (2.0 * np.pi)  # [m/rad]
        if left_handed and element.find("screw_thread_pitch") is None:
            lead = -1.0 / left_handed  # which was in [rad/m]
        yield Coupling(f"{joint.name}_slide", joint.name, lead)


# ------------------------------------------------------------------ the tree and what it is cut from


def _joints_of_main_part(scope: Scope) -> list[_Joint]:
    """Return the joints of the part with a loop and the most joints."""
    ends = {name: _links_of_joint(scope, name) for name in scope.joints}
    if not ends:
        raise RobotFileError("there is no joint in it")

    def loops_and_joints(part: tuple[list[str], list[str]]) -> tuple[bool, int]:
        """Return whether a part closes a loop, and its number of joints.

        A tree has one joint less than links. A mimic is a loop equation too.
        """
        links, names = part
        mimics = sum(_has_property(scope.joints[name], "mimic") for name in names)
        return len(names) + mimics >= len(links), len(names)

    parts = [
        (links, [name for name, pair in ends.items() if pair[0] in links])
        for links in merge_overlapping(ends.values())
    ]
    _, names = max(parts, key=loops_and_joints)
    return [_make_joint(scope, name, ends[name]) for name in names]


def _choose_tree_joints(scope: Scope, joints: Sequence[_Joint]) -> list[str]:
    """Choose the joints of a spanning tree: with own properties first, balls last."""
    mimicked = {mimic.get("joint") for joint in scope.joints.values() for mimic in joint.iter("mimic")}

    def reasons_to_cut(joint: _Joint) -> tuple[bool, ...]:
        """Return the reasons to cut a loop at a joint, the strongest first."""
        is_coupled = joint.name.rsplit("::", 1)[-1] in mimicked or _has_property(joint.element, "mimic")
        return (
            f"{joint.name}_at_child" in scope.relative,  # made of a constraint: `_constraint_elements`
            joint.kind != "screw",
            not is_coupled,
            not _has_property(joint.element, *_OWN),
            joint.kind in ("universal", "spherical"),
        )

    groups = {link: {link} for joint in joints for link in joint.links}
    chosen = set()
    for joint in sorted(joints, key=reasons_to_cut):
        first, second = (groups[link] for link in joint.links)
        if first is not second:  # the joint closes no loop with those chosen
            first |= second
            groups |= dict.fromkeys(second, first)
            chosen.add(joint.name)
    return [joint.name for joint in joints if joint.name in chosen]


def _make_urdf(scope: Scope, joints: Sequence[_Joint], chosen: Sequence[str], name: str) -> Element:
    """Return the tree as a URDF, rooted in the world or a link without parent."""
    root = Element("robot", name=name)
    part = {link for joint in joints for link in joint.links}
    children = {joint.links[1] for joint in joints}
    links = [link for link in scope.links if link in part]
    waiting = [WORLD if WORLD in part else next((link for link in links if link not in children), links[0])]
    taken = {*links, WORLD}
    in_tree = [joint for joint in joints if joint.name in chosen]
    for link in waiting:  # which grows
        root.append(_make_link(scope, link))
        for joint in in_tree:
            is_reversed = link != joint.links[0]
            inner, outer = joint.links[is_reversed], joint.links[not is_reversed]
            if link != inner or outer in waiting:
                continue
            end = invert_placement(joint.places[not is_reversed])
            root.extend(chain_elements(link, joint.chain(is_reversed=is_reversed), outer, end, taken))
            waiting.append(outer)
    return root


def _make_link(scope: Scope, name: str) -> Element:
    """Return a link with its inertia, by default SDF's, and its primitive shapes."""
    link = Element("link", name=name)
    if name == WORLD:
        return link
    where, element = f"link {name!r}", scope.links[name]
    inertial = element.find("inertial")
    if inertial is None:
        inertial = Element("inertial")
    mass, *moments = _read_values(inertial, where, _INERTIA)
    origin = _read_pose(inertial, "", "", where)[1]
    turn = origin[:3, :3]
    link.append(inertial_element(mass, origin[:3, 3], turn @ symmetric_matrix(*moments) @ turn.T))
    for visual in element.findall("visual"):
        for shape, keys in _SHAPES.items():
            geometry = visual.find(f"geometry/{shape}")
            if geometry is not None:
                words = {key: (geometry.findtext(key) or "1").strip() for key in keys}
                link.append(visual_element(shape, words, _read_pose(visual, "", "", where)[1]))
    return link


def _read_limits(joint: Element, name: str, tag: str) -> tuple[float, float] | None:
    """Read lower and upper limit [rad, m]; None if infinite, in words or numbers."""
    where, ends = f"joint {name!r}", list[float]()
    for end, default in (("lower", "-inf"), ("upper", "inf")):
        text = joint.findtext(f"{tag}/limit/{end}", default).lower()
        ends += parse_numbers(f"{where}: <{end}>", text.replace("inf", f"{UNLIMITED:g}"), 1)
    lower, upper = ends
    if max(abs(lower), abs(upper)) >= UNLIMITED:
        return None
    if lower > upper:
        raise RobotFileError(f"{where}: <limit>: needs lower <= upper, got {lower:g} and {upper:g}")
    return lower, upper


def close_joint(scope: Scope, tree: UrdfTree, name: str) -> None:
    """Close the loop of a joint of `scope` between links of a tree."""
    _close_cut_joint(tree, _make_joint(scope, name, _links_of_joint(scope, name)))


def _close_cut_joint(tree: UrdfTree, joint: _Joint) -> None:
    """Close the loop of a cut joint."""
    if (kind := joint.element.get("type")) in (*_NOT_READ, "screw"):
        raise RobotFileError(f"joint {joint.name!r}: {kind}: not read where it closes a loop")
    ends = zip("12", joint.links, joint.places, strict=True)
    axes = [motion.axis for motion in joint.motions if motion.axis is not None]
    tree.close(joint.name, locked_axes(joint.kind), ends, axes)
