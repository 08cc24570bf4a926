"""SDFormat 1.4 to 1.12: the joints of a model need no tree, and those that close loops become closures.

Read are models, also in a world, in a model and by `<include>` of a file beside it (`a::b` names what is
nested); frames and poses with `relative_to` and `attached_to`; joints fixed, revolute, prismatic, universal,
revolute2 and ball with limits, damping, friction, springs and `<mimic>`; inertias and primitive shapes. A
joint whose parent is a `<frame>` stands in that frame, so that the loops may be open where the file has its
links. Joints with something of their own, such as a limit, stay in the tree, others are cut first. Joints
that a plugin names are likely motors. The file says nothing about the platform.

Source: sdformat.org, "Pose frame semantics".
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.input import read_text
from framework.model.description import Closure, Coupling, JointDynamics, ParsedRobot, locked_axes
from framework.model.documents import naming, parse_xml
from framework.model.inertia import ENTRIES, symmetric
from framework.model.placement import from_quaternion, from_rpy, inverse, placement, turning
from framework.model.readers.describe import describe
from framework.model.readers.left_out import LeftOut
from framework.model.readers.missing_fields import Options
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.urdf_elements import local_name
from framework.model.urdf_writing import inertial_element, joint_element, origin_element, vector_text
from framework.model.xml_reading import attribute, child_element, numbers

WORLD, MODEL = "world", "__model__"
UNLIMITED = 1e15  # [rad, m] larger ones stand for no limit
_KINDS = {kind: kind for kind in ("fixed", "revolute", "prismatic", "universal")} | {
    "continuous": "revolute",
    "revolute2": "universal",
    "ball": "spherical",
}
_NOT_READ = ("screw", "gearbox")
_CONSTRAINTS = {"weld_constraint": "fixed", "ball_constraint": "ball"}  # of Drake
_OWN = ("dynamics", "limit", "mimic")  # what a joint of the tree can have, and a closure cannot
_VERSION_OF_JOINT_AXES = 1.5  # before, axes were in the frame of the model


@dataclass
class Scope:
    """The frames of all models, by scoped name: what each is relative to, its pose there, its body."""

    version: float
    relative: dict[str, tuple[str, Array]] = field(default_factory=dict)
    attached: dict[str, str] = field(default_factory=dict)
    links: dict[str, ElementTree.Element] = field(default_factory=dict)
    joints: dict[str, ElementTree.Element] = field(default_factory=dict)

    def place(self, name: str, depth: int = 0) -> Array:
        """Return the placement (4, 4) of a frame in the world, where the file has its links."""
        if name == WORLD:
            return np.eye(4)
        if name not in self.relative:
            raise RobotFileError(choose_from("frame", name, self.relative))
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

    def in_link(self, name: str, where: Array) -> Array:
        """Return a placement in the world as one in a link."""
        return inverse(self.place(name)) @ where


def read_sdf(file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
    """Read the description in an SDF file.

    Raises:
        RobotFileError: names the element.
    """
    (version,) = numbers("<sdf> version", root.get("version", "1.4"), 1)
    scope = Scope(version)
    _add_models(scope, root, file.parent, "", WORLD)
    for world in root.findall("world"):
        _add_models(scope, world, file.parent, "", WORLD)
    ends = {name: _ends(scope, name, joint) for name, joint in scope.joints.items()}
    part = _largest_part(scope, ends)
    left_out = [
        LeftOut(f"joint {name!r}: {joint.get('type')}: not read", (name, *ends[name]), is_decisive=True)
        for name, joint in scope.joints.items()
        if joint.get("type") in _NOT_READ
    ]
    within = {name: pair for name, pair in ends.items() if set(pair) <= part}
    chosen = _tree_joints(scope, within, part)
    tree = UrdfTree(_urdf(scope, within, chosen, part, file.stem))
    closures = [_closure(scope, tree, name, within[name]) for name in within if name not in chosen]
    for name in within:
        if name not in chosen and (own := _own(scope.joints[name], ("dynamics", "mimic"))):
            left_out.append(LeftOut(f"joint {name!r}: its {own}, where the loop is cut", (within[name][1],)))
    plugged = [text.text or "" for text in root.iter("joint_name")]
    acting = {name: _dynamics(name, scope.joints[name]) for name in chosen}
    return describe(
        tree,
        file,
        options,
        closures,
        couplings=[c for name in chosen for c in _couplings(scope, name, chosen)],
        likely_motors=[name for name in chosen if name.rsplit("::", 1)[-1] in plugged],
        joints={name: joint for name, joint in acting.items() if joint != JointDynamics()},
        gravity=_gravity(root),
        left_out=left_out,
        remarks=_others(scope, part),
    )._replace(dialect="sdf")


def _gravity(root: ElementTree.Element) -> tuple[float, float, float]:
    x, y, z = numbers("<gravity>", root.findtext("world/gravity", "0 0 -9.81"), 3)
    return x, y, z


def _others(scope: Scope, part: set[str]) -> list[str]:
    """Return remarks on links that no joint joins with the mechanism."""
    names = [name for name in scope.links if name not in part]
    return [f"not read: {', '.join(names)}, which no joint joins with the mechanism"] if names else []


# ------------------------------------------------------------------ models and frames


def _add_models(scope: Scope, parent: ElementTree.Element, folder: Path, prefix: str, base: str) -> None:
    """Add the models in an element, and those that it includes."""
    for model in parent.findall("model"):
        _add_model(scope, model, folder, prefix, base)
    for include in parent.findall("include"):
        uri = (include.findtext("uri") or "").removeprefix("model://").removeprefix("file://")
        file = next((f for f in (folder / uri, folder.parent / uri) if f.exists()), None)
        if file is not None and file.is_dir():
            file = file / "model.sdf"
        if file is None or not file.is_file():
            continue  # scenery, such as a ground plane; a joint to it says what is missing
        with naming(f"<include> {uri}"):
            model = child_element(
                parse_xml(read_text(file, "cannot read it", error=RobotFileError)), "<sdf>", "model"
            )
        model.set("name", include.findtext("name") or model.get("name") or "")
        for pose in include.findall("pose"):
            for own in model.findall("pose"):
                model.remove(own)
            model.append(pose)
        if include.get("merge") in ("true", "1"):
            _add_content(scope, model, file.parent, prefix, base)
        else:
            _add_model(scope, model, file.parent, prefix, base)


def _add_model(scope: Scope, model: ElementTree.Element, folder: Path, prefix: str, base: str) -> None:
    """Add a model; nested ones get its name in front of theirs."""
    name = attribute(model, "<model>", "name")
    inner = f"{prefix}{name}::" if prefix or base != WORLD else f"{name}::" if _is_nested(scope) else ""
    own = f"{prefix}{name}::{MODEL}"
    relative, pose = _pose(model, prefix, base, f"model {name!r}")
    scope.relative[own] = (relative, pose)
    if inner != f"{prefix}{name}::":
        scope.relative[MODEL] = (own, np.eye(4))
    _add_content(scope, model, folder, inner, own)
    links = [key for key in scope.links if key.startswith(inner)]
    canonical = model.get("canonical_link")
    if links:
        scope.attached[own] = f"{inner}{canonical}" if canonical else links[0]
        scope.attached[f"{inner}{MODEL}"] = scope.attached[f"{prefix}{name}"] = scope.attached[own]
        scope.relative.setdefault(f"{prefix}{name}", (own, np.eye(4)))
    if model.get("placement_frame"):
        there = inverse(scope.place(own)) @ scope.place(f"{inner}{model.get('placement_frame')}")
        scope.relative[own] = (relative, pose @ inverse(there))


def _is_nested(scope: Scope) -> bool:
    """Whether another model of the world was read: names of a second one begin with its own."""
    return bool(scope.links)


def _add_content(scope: Scope, model: ElementTree.Element, folder: Path, prefix: str, base: str) -> None:
    """Add links, frames, joints and models of a model whose frame is `base`."""
    for element in model:
        if element.tag not in ("link", "frame", "joint"):
            continue
        name = prefix + attribute(element, f"<{element.tag}>", "name")
        known = scope.relative.keys() if element.tag != "joint" else scope.joints.keys()
        if name in known:
            raise RobotFileError(f"duplicate {element.tag} {name!r}")
        default = base
        if element.tag == "link":
            scope.links[name] = element
        elif element.tag == "frame":
            to = element.get("attached_to")
            default = base if not to else to if to == WORLD else f"{prefix}{to}"
            scope.attached[name] = default
        else:
            element.set("scope", prefix)
            element.set("base", base)
            scope.joints[name] = element
            default = _named(prefix, element, "child")
            scope.attached.setdefault(name, default)
        pose = _pose(element, prefix, default, f"{element.tag} {name!r}", base)
        scope.relative[f"joint {name}" if element.tag == "joint" else name] = pose
        if element.tag == "joint":
            scope.relative.setdefault(name, pose)
    for number, element in enumerate(model):
        if local_name(element.tag) in _CONSTRAINTS:
            _add_constraint(scope, element, f"{local_name(element.tag)}_{number}", prefix)
    _add_models(scope, model, folder, prefix, base)


def _add_constraint(scope: Scope, element: ElementTree.Element, name: str, prefix: str) -> None:
    """Add Drake's constraint of two bodies as the joint that it is: a weld, or a ball between two points."""
    parts = {local_name(child.tag).removeprefix("ball_constraint_"): child.text for child in element}
    joint = ElementTree.Element("joint", name=name, scope=prefix, type=_CONSTRAINTS[local_name(element.tag)])
    for end, body, point in (("parent", "body_A", "p_AP"), ("child", "body_B", "p_BQ")):
        frame = f"{name}_at_{end}"
        ElementTree.SubElement(joint, end).text = frame
        body = prefix + (parts.get(end) or parts.get(body) or "").strip()
        at = numbers(f"{name}: {point}", parts.get(point) or "0 0 0", 3)
        scope.relative[prefix + frame] = (body, placement(None, at))
        scope.attached[prefix + frame] = body
    scope.joints[prefix + name] = joint
    scope.relative[f"joint {prefix}{name}"] = (f"{prefix}{name}_at_child", np.eye(4))


def _named(prefix: str, joint: ElementTree.Element, end: str) -> str:
    """Return the scoped name of the parent or child of a joint."""
    name = (joint.findtext(end) or "").strip()
    if not name:
        raise RobotFileError(f"joint {joint.get('name')!r}: <{end}> is missing")
    return name if name == WORLD else prefix + name


def _pose(
    element: ElementTree.Element, prefix: str, default: str, where: str, base: str | None = None
) -> tuple[str, Array]:
    """Return what the `<pose>` of an element is relative to, and the placement (4, 4)."""
    pose = element.find("pose")
    if pose is None:
        return default, np.eye(4)
    to = pose.get("relative_to") or pose.get("frame")
    relative = default if not to else to if to == WORLD else base if to == MODEL and base else f"{prefix}{to}"
    count = 7 if pose.get("rotation_format") == "quat_xyzw" else 6
    values = numbers(f"{where}: <pose>", pose.text or " 0" * count, count)
    if count == 7:
        x, y, z, w = values[3:]
        return str(relative), placement(from_quaternion(w, x, y, z), values[:3])
    unit = np.pi / 180.0 if pose.get("degrees") in ("true", "1") else 1.0
    turn = [unit * value for value in values[3:]]
    return str(relative), placement(from_rpy(turn) if any(turn) else None, values[:3])


# ------------------------------------------------------------------ the tree


def _ends(scope: Scope, name: str, joint: ElementTree.Element) -> tuple[str, str]:
    """Return the links that a joint joins, parent first."""
    kind = attribute(joint, f"joint {name!r}", "type")
    if kind not in (*_KINDS, *_NOT_READ):
        raise RobotFileError(f"joint {name!r}: {choose_from('type', kind, (*_KINDS, *_NOT_READ))}")
    with naming(f"joint {name!r}"):
        first, second = (
            scope.link_of(_named(joint.get("scope", ""), joint, end)) for end in ("parent", "child")
        )
    if first == second:
        raise RobotFileError(f"joint {name!r}: joins {first!r} with itself")
    return first, second


def _largest_part(scope: Scope, ends: dict[str, tuple[str, str]]) -> set[str]:
    """Return the links of the part with loops, of several that with most joints."""
    groups: list[set[str]] = [{name} for name in (*scope.links, WORLD)]
    for pair in ends.values():
        joined = [group for group in groups if group & set(pair)]
        groups = [group for group in groups if group not in joined] + [set().union(*joined)]
    counts = []
    for group in groups:
        joints = [scope.joints[name] for name, pair in ends.items() if set(pair) <= group]
        mimics = sum(joint.find("axis/mimic") is not None for joint in joints)
        counts.append((len(joints) - len(group) + 1 + mimics > 0, len(joints)))
    if not max(counts)[1]:
        raise RobotFileError("there is no joint in it")
    return groups[counts.index(max(counts))]


def _own(joint: ElementTree.Element, tags: Sequence[str] = _OWN) -> str:
    """Return names of what a joint has that a closure cannot have."""
    found = [tag for tag in tags for axis in joint.findall("axis") if axis.find(tag) is not None]
    return ", ".join(found)


def _tree_joints(scope: Scope, ends: dict[str, tuple[str, str]], part: set[str]) -> list[str]:
    """Choose the joints of a tree: those with something of their own first, and balls last."""
    mimicked = {mimic.get("joint") for joint in scope.joints.values() for mimic in joint.iter("mimic")}

    def rank(name: str) -> tuple[bool, bool, bool, bool]:
        joint = scope.joints[name]
        is_constraint = f"{name}_at_child" in scope.relative
        leads = name.rsplit("::", 1)[-1] in mimicked or bool(_own(joint, ("mimic",)))
        return (
            is_constraint,
            not leads,
            not _own(joint),
            _KINDS.get(joint.get("type", "")) in ("universal", "spherical"),
        )

    groups = {link: {link} for link in part}
    chosen = []
    for name in sorted(ends, key=rank):
        first, second = (groups[link] for link in ends[name])
        if first is not second:
            first |= second
            groups |= dict.fromkeys(second, first)
            chosen.append(name)
    return [name for name in ends if name in chosen]


def _urdf(
    scope: Scope, ends: dict[str, tuple[str, str]], chosen: Sequence[str], part: set[str], name: str
) -> ElementTree.Element:
    """Return the tree as a URDF, from the world or the first link that is nobody's child outwards."""
    root = ElementTree.Element("robot", name=name)
    children = {ends[joint][1] for joint in ends}
    links = [link for link in (WORLD, *scope.links) if link in part]
    base = WORLD if WORLD in part else next((link for link in links if link not in children), links[0])
    waiting = [base]
    reached = {base}
    while waiting:
        link = waiting.pop(0)
        root.append(_link(scope, link))
        for joint in chosen:
            first, second = ends[joint]
            if link in (first, second) and not {first, second} <= reached:
                other = second if link == first else first
                root.extend(list(_joint(scope, joint, link, other, is_reversed=link == second)))
                reached.add(other)
                waiting.append(other)
    return root


def _link(scope: Scope, name: str) -> ElementTree.Element:
    """Return a link with its inertia, that of SDF's default where it says none, and its primitive shapes."""
    link = ElementTree.Element("link", name=name)
    if name == WORLD:
        return link
    where, inertial = f"link {name!r}", scope.links[name].find("inertial")
    mass, place, matrix = 1.0, np.eye(4), np.eye(3)
    if inertial is not None:
        (mass,) = numbers(f"{where}: <mass>", inertial.findtext("mass", "1"), 1)
        place = _pose(inertial, "", "", where)[1]
        matrix = symmetric(
            *(
                numbers(f"{where}: <{key}>", inertial.findtext(f"inertia/{key}", default), 1)[0]
                for key, default in zip(ENTRIES, "111000", strict=True)
            )
        )
    turn = place[:3, :3]
    link.append(inertial_element(mass, place[:3, 3], turn @ matrix @ turn.T))
    link.extend(list(_visuals(scope.links[name], where)))
    return link


def _visuals(link: ElementTree.Element, where: str) -> Iterator[ElementTree.Element]:
    for visual in link.findall("visual"):
        for shape, keys in {"box": ["size"], "sphere": ["radius"], "cylinder": ["radius", "length"]}.items():
            geometry = visual.find(f"geometry/{shape}")
            if geometry is not None:
                element = ElementTree.Element("visual")
                element.append(origin_element(_pose(visual, "", "", where)[1]))
                words = {key: (geometry.findtext(key) or "1").strip() for key in keys}
                ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), shape, words)
                yield element


def _places(scope: Scope, name: str, first: str, second: str) -> tuple[Array, Array]:
    """Return the placements of a joint in its parent link and in its child link."""
    joint = scope.joints[name]
    at = scope.place(f"joint {name}")
    parent = _named(joint.get("scope", ""), joint, "parent")
    in_parent = scope.place(parent) if parent in scope.attached and parent not in scope.links else at
    return scope.in_link(first, in_parent), scope.in_link(second, at)


def _axis(scope: Scope, name: str, tag: str = "axis") -> Array:
    """Return an axis of a joint in the joint's frame."""
    joint = scope.joints[name]
    text = joint.findtext(f"{tag}/xyz", "0 0 1")
    axis = np.array(numbers(f"joint {name!r}: <{tag}> xyz", text, 3))
    if not axis.any():
        raise RobotFileError(f"joint {name!r}: <{tag}>: the axis is zero")
    xyz, prefix = joint.find(f"{tag}/xyz"), joint.get("scope", "")
    within = None if xyz is None else xyz.get("expressed_in")
    in_model = (joint.findtext(f"{tag}/use_parent_model_frame") or "").strip() in ("true", "1")
    if within == MODEL or (not within and (in_model or scope.version < _VERSION_OF_JOINT_AXES)):
        within = joint.get("base", "")
    elif within:
        within = within if within == WORLD else prefix + within
    else:
        return axis
    turn = scope.place(f"joint {name}")[:3, :3].T @ scope.place(within)[:3, :3]
    return np.asarray(turn @ axis)


def _joint(
    scope: Scope, name: str, link: str, other: str, *, is_reversed: bool
) -> Iterator[ElementTree.Element]:
    """Yield the URDF's elements of a joint of the tree, from the link nearer to the root to the other."""
    ends = (other, link) if is_reversed else (link, other)
    origin, behind = _places(scope, name, *ends)
    if is_reversed:
        origin, behind = behind, origin
    kind = _KINDS.get(scope.joints[name].get("type", ""), "fixed")
    sign = -1.0 if is_reversed else 1.0
    tags = {"universal": ["axis", "axis2"], "fixed": [], "spherical": []}.get(kind, ["axis"])
    if is_reversed:
        tags.reverse()
    names = [name if tag == "axis" else f"{name}_2" for tag in tags] or [name]
    parent = link
    for joint, tag in zip(names, tags or [""], strict=True):
        child = f"{joint}_link"
        yield ElementTree.Element("link", name=child)
        lower, upper = _limits(scope.joints[name], name, tag) if tag else (-np.inf, np.inf)
        turns = "continuous" if lower == -np.inf and upper == np.inf else "revolute"
        element = joint_element(
            joint,
            turns if kind in ("revolute", "universal") else kind,
            parent,
            child,
            origin=origin_element(origin),
            axis=vector_text(sign * _axis(scope, name, tag)) if tag else None,
        )
        limit = element.find("limit")
        if limit is not None and np.isfinite([lower, upper]).all():
            limit.attrib |= {"lower": repr(lower), "upper": repr(upper)}
        yield element
        parent, origin = child, np.eye(4)
    mount = origin_element(inverse(behind))
    yield joint_element(f"{other}_mount", "fixed", parent, other, origin=mount)


def _limits(joint: ElementTree.Element, name: str, tag: str) -> tuple[float, float]:
    """Return lower and upper limit [rad, m]; infinite without."""
    values = [
        _number(f"joint {name!r}: <{end}>", joint.findtext(f"{tag}/limit/{end}", default))
        for end, default in (("lower", "-inf"), ("upper", "inf"))
    ]
    lower, upper = values if max(map(abs, values)) < UNLIMITED else (-np.inf, np.inf)
    if lower > upper:
        raise RobotFileError(f"joint {name!r}: <limit>: needs lower <= upper, got {lower:g} and {upper:g}")
    return lower, upper


def _number(where: str, text: str) -> float:
    """Read a number, which may be infinite, as newer files write what older ones write as 1e16."""
    stripped = text.strip().lower()
    return float(stripped) if stripped in ("inf", "-inf", "+inf") else numbers(where, text, 1)[0]


def _dynamics(name: str, joint: ElementTree.Element) -> JointDynamics:
    """Return damping, friction and spring of a joint's axis."""
    values = {}
    for key, tag in (
        ("damping", "damping"),
        ("friction", "friction"),
        ("stiffness", "spring_stiffness"),
        ("rest", "spring_reference"),
    ):
        (values[key],) = numbers(f"joint {name!r}: <{tag}>", joint.findtext(f"axis/dynamics/{tag}", "0"), 1)
    return JointDynamics(**values | ({} if values["stiffness"] else {"rest": 0.0}))


def _couplings(scope: Scope, name: str, chosen: Sequence[str]) -> Iterator[Coupling]:
    """Yield the coupling of a joint that mimics another."""
    joint = scope.joints[name]
    for mimic in joint.findall("axis/mimic"):
        of = joint.get("scope", "") + (mimic.get("joint") or "")
        if of not in chosen:
            raise RobotFileError(f"joint {name!r}: <mimic>: {choose_from('joint', of, chosen)}")
        ratio, offset, reference = (
            numbers(f"joint {name!r}: <mimic> {key}", mimic.findtext(key, default), 1)[0]
            for key, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
        )
        yield Coupling(name, of, ratio, offset - ratio * reference)


def read_cut_joint(scope: Scope, tree: UrdfTree, joint: ElementTree.Element) -> Closure:
    """Read the closure of a joint between links of a tree; `scope` places them at zero.

    Raises:
        RobotFileError: names the joint.
    """
    name = attribute(joint, "<joint>", "name")
    scope.joints[name] = joint
    scope.relative[f"joint {name}"] = _pose(joint, "", _named("", joint, "child"), f"joint {name!r}")
    ends = _ends(scope, name, joint)
    if joint.get("type") in _NOT_READ:
        raise RobotFileError(f"joint {name!r}: {joint.get('type')}: not read")
    return _closure(scope, tree, name, ends)


def _closure(scope: Scope, tree: UrdfTree, name: str, ends: tuple[str, str]) -> Closure:
    """Return the closure of a joint that is cut, of the joint's own kind."""
    kind = _KINDS.get(scope.joints[name].get("type", ""), "fixed")
    turns = [np.eye(3), np.eye(3)]
    if kind in ("revolute", "prismatic"):
        turns = [turning("z", _axis(scope, name))] * 2
    elif kind == "universal":  # the first axis is x of the first frame, the second is y of the second frame
        turns = [turning("x", _axis(scope, name)), turning("y", _axis(scope, name, "axis2"))]
    places = _places(scope, name, *ends)
    frames = [
        tree.frame_at(f"{name}_{end}", link, place @ placement(turn))
        for end, link, place, turn in zip((1, 2), ends, places, turns, strict=True)
    ]
    return Closure(name, (frames[0], frames[1]), locked_axes(kind))
