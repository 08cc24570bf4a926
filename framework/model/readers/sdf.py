"""Read SDFormat 1.4 to 1.12: joints may form loops, and those that are not in the tree become closures.

The reader supports

- models, also in a world, in a model, and by `<include>` of a file (nested names are `a::b`);
- frames and poses with `relative_to` and `attached_to`, and Drake's two frames of a joint;
- joints fixed, revolute, prismatic, universal, revolute2, ball and screw, with limits, damping, friction,
  springs and `<mimic>`;
- inertias, also those of solid primitive shapes (`auto`), and primitive shapes.

A screw becomes a hinge and a coupled slide, and cannot close a loop. A joint whose parent is a `<frame>`
stands in that frame, so loops may be open in the poses of the file. Loops are cut first at joints without
properties such as a limit, which a closure cannot have. Joints that a plugin names are likely motors, or else
those whose effort is not 0, if that of others is. The file says nothing about the platform.

Source: sdformat.org, the specification of each element.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError, check_name
from framework.model.description import Coupling, JointDynamics, locked_axes
from framework.model.documents import attribute, parse_axis, parse_numbers, prefix_errors
from framework.model.placement import invert_placement
from framework.model.readers.describe import Options, describe
from framework.model.readers.sdf_scope import (
    MODEL_FRAME,
    TRUE_TEXTS,
    WORLD,
    Scope,
    add_models,
    child_text,
    drop_detached,
    end_name,
    read_placement,
    read_pose,
    scoped_name,
)
from framework.model.readers.urdf_tree import UnreadElement, UrdfTree, merge_overlapping
from framework.model.urdf_edits import add_chain, inertial_element, visual_element
from framework.model.urdf_elements import (
    ENDLESS,
    MOVING,
    SIZES_OF_SHAPES,
    Joint,
    ParsedRobot,
    Tree,
    parse_limit,
    symmetric_matrix,
)
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.numerics.fields import vector3

# kinds of joints by their type in the file
_KIND_OF_TYPE = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "universal": "universal",
    "revolute2": "universal",
    "screw": "screw",
    "ball": "spherical",
}
# the motions of one freedom that make each kind: suffix of the name, type in the URDF, tag of the axis
_MOTIONS_OF_KIND = {
    "revolute": (("", "continuous", "axis"),),
    "prismatic": (("", "prismatic", "axis"),),
    "universal": (("", "continuous", "axis"), ("_2", "continuous", "axis2")),
    "screw": (("", "continuous", "axis"), ("_slide", "prismatic", "slide")),
}
_SUFFIXES = {"axis": "", "axis2": "_2"}  # of the name of the motion about each axis
_UNREAD_TYPES = ("gearbox",)  # types of joints
# elements without an effect on the motion
_UNUSED_TAGS = ("plugin", "sensor", "light", "battery", "actor", "projector", "particle_emitter", "gripper")
# properties that joints of the tree can have, and closures cannot
_TREE_PROPERTIES = ("dynamics", "limit", "mimic")
_DYNAMICS_TAGS = ("damping", "friction", "spring_stiffness", "spring_reference")  # children of <dynamics>
# texts of the children of <inertial> that SDF takes by default, moments in the order of INERTIA_ENTRIES
_DEFAULT_INERTIA = {
    "mass": "1",
    "inertia/ixx": "1",
    "inertia/iyy": "1",
    "inertia/izz": "1",
    "inertia/ixy": "0",
    "inertia/ixz": "0",
    "inertia/iyz": "0",
}
_AUTO_DENSITY = "1000"  # [kg/m^3] of collisions whose density the file does not state
_SOLIDS = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder, "capsule": coal.Capsule}
_VERSION_OF_JOINT_AXES = 1.5  # axes of earlier versions are in the frame of the model


class _Joint(NamedTuple):
    """A joint with its motions, and its placements in both links."""

    name: str  # scoped, see `sdf_scope`
    element: Element
    kind: str  # one of the values of _KIND_OF_TYPE
    links: tuple[str, str]  # the parent first
    placements: tuple[Array, Array]  # (4, 4) of the joint in each link
    # of one freedom each, in the joint's frame; a fixed joint or a ball has one motion, without an axis
    motions: list[Joint]

    def chain_from(self, link: str) -> tuple[list[Joint], str, Array]:
        """Return the joints of a URDF that lead from one link of the joint to the other.

        Returns:
            The joints, the other link, and its placement (4, 4) behind the last joint.
        """
        parent, child = self.links
        on_parent, on_child = self.placements
        if link == parent:
            first, *others = self.motions
            return [replace(first, origin=on_parent), *others], child, invert_placement(on_child)
        # from child to parent the motions are in reverse order, about opposite axes
        last, *others = [replace(motion, axis=-motion.axis) for motion in reversed(self.motions)]
        return [replace(last, origin=on_child), *others], parent, invert_placement(on_parent)


def read_sdf(file: Path, root: Element, options: Options) -> ParsedRobot:
    """Read the robot in an SDF file.

    Raises:
        RobotFileError: the file is malformed or has content that is not read; the message names the element.
    """
    (version,) = parse_numbers("<sdf> version", root.get("version", "1.4"), 1)
    scope = Scope(version)
    for parent in (root, *root.findall("world")):
        add_models(scope, parent, file.parent, "", WORLD)
    detached = list(drop_detached(scope))
    missing = f"{', '.join(scope.unread)}: not read, as there is no such file; put the model's folder beside"
    try:
        joints = _joints_of_main_part(scope)
    except RobotFileError as error:
        raise RobotFileError(f"{error}; {missing}" if scope.unread else str(error)) from None
    tree_names = _choose_tree_joints(scope, joints)
    tree = UrdfTree(_make_tree(scope, joints, tree_names, file.stem))
    tree.unused += Counter({f"<{tag}>": len(list(root.iter(tag))) for tag in _UNUSED_TAGS})  # += drops zeros
    tree.unused -= Counter({"<plugin>": sum(bool(joint.get("optional")) for joint in scope.joints.values())})
    tree.gravity = vector3("<gravity>", child_text(root, "world/gravity", "0 0 -9.81").split())
    named_by_plugins = [element.text or "" for element in root.iter("joint_name")]
    tree.likely_motors = [name for name in tree_names if name.rsplit("::", 1)[-1] in named_by_plugins]
    if not named_by_plugins:  # nor has a joint a motor whose effort is 0
        effort = {"axis/limit/effort": "-1"}  # not limited, as is one that is left out
        driven = [name for name in tree_names if any(_read_values(scope.joints[name], name, effort))]
        tree.likely_motors = driven if len(driven) < len(tree_names) else []
    for name in scope.frames:
        with suppress(RobotFileError):  # a frame without a place, such as one on a model without a file
            if (link := scope.link_of(name)) in tree.links:
                in_link = invert_placement(scope.placement_of(link)) @ scope.placement_of(name)
                tree.add_frame(name, link, in_link)
    _report_unread_parts(scope, tree, joints)
    tree.left_out += [UnreadElement(text, (link,)) for text, link in detached if link in tree.links]
    tree.remarks += [missing] * bool(scope.unread)
    for joint in joints:
        if joint.name in tree_names:
            tree.couplings += _read_couplings(joint, tree.movable)
            for tag, suffix in _SUFFIXES.items():  # where each motion begins [rad, m], as Drake reads it
                path, name = f"{tag}/initial_position", f"{joint.name}{suffix}"
                if name in tree.movable and joint.element.find(path) is not None:
                    (tree.reference[name],) = _read_values(
                        joint.element, f"joint {joint.name!r}", {path: "0"}
                    )
        else:
            close_joint(tree, joint)
            # what the joint has beside its motion acts on its child, which the closure does not tell
            has_dynamics = any(motion.dynamics != JointDynamics() for motion in joint.motions)
            properties = {"dynamics": has_dynamics, "mimic": _has_property(joint.element, "mimic")}
            for name in filter(properties.get, properties):
                text = f"joint {joint.name!r}: its {name}, where the loop is cut"
                tree.left_out.append(UnreadElement(text, joint.links[1:]))
    return describe(tree, file, options, "sdf")


def _report_unread_parts(scope: Scope, tree: UrdfTree, joints: Sequence[_Joint]) -> None:
    """Report gearboxes, links without gravity, and links apart from the mechanism of `joints`."""
    gears = []
    for name, element in scope.joints.items():
        if (kind := element.get("type")) in _UNREAD_TYPES:
            acts_on = name, *_links_of_joint(scope, name)
            gears.append(UnreadElement(f"joint {name!r}: {kind}: not read", acts_on, is_decisive=True))
    tree.left_out[:0] = gears  # in front, since their messages are more precise

    links = {link for joint in joints for link in joint.links}
    apart = []
    for name, link in scope.links.items():
        mass = child_text(link, "inertial/mass", "1")
        if child_text(link, "gravity", "1") in ("0", "false"):
            tree.left_out.append(UnreadElement(f"link {name!r}: <gravity> off, {mass} kg", (name,)))
        shapes = [next(iter(shape.find("geometry") or ()), shape).tag for shape in link.findall("collision")]
        if _has_auto_inertia(link) and (others := sorted({*shapes} - {*SIZES_OF_SHAPES})):
            what = f"link {name!r}: its <inertial auto> is that of a {', '.join(others)}, which is not read"
            tree.left_out.append(UnreadElement(what, (name,), is_decisive=True))
        if name not in links:
            apart.append(f"{name} of {mass} kg")
    if apart:
        tree.remarks.append(f"not read: {', '.join(apart)}, which no joint joins with the mechanism")


def _read_values(element: Element, where: str, defaults: Mapping[str, str]) -> list[float]:
    """Read the number at each path below an element, such as "inertia/ixx", or the path's default.

    Args:
        where: names the element in messages.
        defaults: default text of each path.
    """
    values: list[float] = []
    for path, default in defaults.items():
        tag = path.rsplit("/", 1)[-1]
        values += parse_numbers(f"{where}: <{tag}>", child_text(element, path, default), 1)
    return values


# ------------------------------------------------------------------ joints


def _links_of_joint(scope: Scope, name: str) -> tuple[str, str]:
    """Return the two links of the joint `name`, the parent first; refuse types that are not known."""
    joint = scope.joints[name]
    where = f"joint {name!r}"
    kind = attribute(joint, where, "type")
    check_name(where, "type", kind, (*_KIND_OF_TYPE, *_UNREAD_TYPES))
    with prefix_errors(where):
        first, second = (scope.link_of(end_name(joint, end)) for end in ("parent", "child"))
    if first == second:
        raise RobotFileError(f"{where}: joins {first!r} with itself")
    return first, second


def make_joint(scope: Scope, name: str) -> _Joint:
    """Make the joint `name` with its motions and its placement in each link.

    Raises:
        RobotFileError: the joint is malformed, or joins a link with itself.
        InvalidInput: its axis is expressed in a frame that does not exist.
    """
    element = scope.joints[name]
    kind = _KIND_OF_TYPE.get(element.get("type", ""), "fixed")
    # placements of the joint in the world, as the child and the parent carry it; they differ where the parent
    # end is a frame of its own
    on_child = scope.placement_of(f"joint {name}")
    parent = end_name(element, "parent")
    has_frames = element.find("parent[@is_frame]") is not None  # which may be its links themselves
    is_frame = has_frames or (parent in scope.attached and parent not in scope.links)
    on_parent = scope.placement_of(parent) if is_frame else on_child
    links = _links_of_joint(scope, name)
    parent_link, child_link = links
    placements = (
        invert_placement(scope.placement_of(parent_link)) @ on_parent,
        invert_placement(scope.placement_of(child_link)) @ on_child,
    )
    return _Joint(name, element, kind, links, placements, _read_motions(scope, name, kind))


def _read_motions(scope: Scope, name: str, kind: str) -> list[Joint]:
    """Read the motions of one freedom of a joint of this kind."""
    element = scope.joints[name]
    motions = []
    for suffix, motion, tag in _MOTIONS_OF_KIND.get(kind, ()):
        axis = _read_axis(scope, name, "axis" if tag == "slide" else tag)  # a screw slides along its axis
        paths = {f"{tag}/dynamics/{key}": "0" for key in _DYNAMICS_TAGS}
        damping, friction, stiffness, rest = _read_values(element, f"joint {name!r}", paths)
        dynamics = JointDynamics(0.0, damping, friction, stiffness, rest if stiffness else 0.0)
        limits = _read_limits(element, name, tag)
        motions.append(Joint(name + suffix, motion, axis=axis, limits=limits, dynamics=dynamics))
    return motions or [Joint(name, kind)]


def _read_axis(scope: Scope, name: str, tag: str) -> Array:
    """Read the axis (3,) of a joint in the element `tag`, in the joint's frame.

    The file may express the axis in the frame of the model or in another frame.
    """
    joint = scope.joints[name]
    where = f"joint {name!r}: <{tag}>"
    axis = parse_axis(where, child_text(joint, f"{tag}/xyz", "0 0 1"))
    xyz = joint.find(f"{tag}/xyz")
    expressed_in = None if xyz is None else xyz.get("expressed_in")
    in_model = child_text(joint, f"{tag}/use_parent_model_frame", "") in TRUE_TEXTS
    if not expressed_in and not in_model and scope.version >= _VERSION_OF_JOINT_AXES:
        return axis
    frame = scoped_name(joint.get("scope", ""), expressed_in or MODEL_FRAME)
    to_world = scope.placement_of(frame)[:3, :3]
    from_joint = scope.placement_of(f"joint {name}")[:3, :3]
    return from_joint.T @ to_world @ axis


def _has_property(joint: Element, *properties: str) -> bool:
    """Return whether an axis of a joint has a child with a tag in `properties`."""
    return any(joint.find(f"{axis}/{tag}") is not None for axis in _SUFFIXES for tag in properties)


def _read_couplings(joint: _Joint, names: Sequence[str]) -> Iterator[Coupling]:
    """Yield the coupling of a mimic joint, and the coupling of a screw's slide to its hinge.

    `names` are those of the motions that a mimic may follow.
    """
    where = f"joint {joint.name!r}"
    element = joint.element
    mimics = [
        (suffix, mimic) for tag, suffix in _SUFFIXES.items() for mimic in element.findall(f"{tag}/mimic")
    ]
    for suffix, mimic in mimics:
        leader = f"{element.get('scope', '')}{mimic.get('joint', '')}"
        leader += _SUFFIXES.get(mimic.get("axis", "axis"), "")
        check_name(f"{where}: <mimic>", "joint", leader, names)
        # q = multiplier (q_leader - reference) + offset
        defaults = {"multiplier": "1", "offset": "0", "reference": "0"}
        ratio, offset, reference = _read_values(mimic, f"{where}: <mimic>", defaults)
        yield Coupling(f"{joint.name}{suffix}", leader, ratio, offset - ratio * reference)
    if joint.kind == "screw":
        pitch, old_pitch = _read_values(element, where, {"screw_thread_pitch": "1", "thread_pitch": "0"})
        lead = pitch / (2.0 * np.pi)  # [m/rad] of the slide; screw_thread_pitch is in [m] per turn
        if old_pitch and element.find("screw_thread_pitch") is None:
            lead = -1.0 / old_pitch  # the older thread_pitch is in [rad/m], and of a left-handed screw
        yield Coupling(f"{joint.name}_slide", joint.name, lead)


# ------------------------------------------------------------------ the spanning tree


def _joints_of_main_part(scope: Scope) -> list[_Joint]:
    """Return the joints of the largest connected part with a loop, else of the largest part.

    Sizes are numbers of joints. Links that no joint connects with this part, such as scenery, are left out.
    """
    ends = {name: _links_of_joint(scope, name) for name in scope.joints}
    if not ends:
        raise RobotFileError("there is no joint in it")

    def names_of_joints(links: Sequence[str]) -> list[str]:
        """Return the names of the joints between links of a connected part."""
        return [name for name, (parent, _) in ends.items() if parent in links]

    def rank(links: Sequence[str]) -> tuple[bool, int]:
        """Return whether a connected part of links has a loop, and its number of joints."""
        names = names_of_joints(links)
        mimics = sum(_has_property(scope.joints[name], "mimic") for name in names)
        # a tree has one joint less than links; a mimic is a loop equation, too
        return len(names) + mimics >= len(links), len(names)

    main_part = max(merge_overlapping(ends.values()), key=rank)
    return [make_joint(scope, name) for name in names_of_joints(main_part)]


def _choose_tree_joints(scope: Scope, joints: Sequence[_Joint]) -> list[str]:
    """Choose the names of the joints of a spanning tree; cut loops at joints that closures express best."""
    mimicked = {mimic.get("joint") for joint in scope.joints.values() for mimic in joint.iter("mimic")}

    def reasons_to_cut(joint: _Joint) -> tuple[bool, ...]:
        """Return whether each reason to cut a loop at a joint holds, the strongest reason first."""
        is_coupled = joint.name.rsplit("::", 1)[-1] in mimicked or _has_property(joint.element, "mimic")
        return (
            joint.kind != "screw",  # which cannot be cut
            not is_coupled,  # couplings need joints of the tree
            not _has_property(joint.element, *_TREE_PROPERTIES),
            joint.kind in ("universal", "spherical"),  # which saves several joints of the tree
        )

    # Kruskal's algorithm: a joint enters the tree if it joins two groups of connected links. Joints with weak
    # reasons to cut come first: False sorts before True.
    groups = {link: {link} for joint in joints for link in joint.links}  # of each link
    chosen = set()
    for joint in sorted(joints, key=reasons_to_cut):
        first, second = (groups[link] for link in joint.links)
        if first is not second:  # the joint closes no loop: merge the groups
            first |= second
            groups |= dict.fromkeys(second, first)
            chosen.add(joint.name)
    return [joint.name for joint in joints if joint.name in chosen]


def _make_tree(scope: Scope, joints: Sequence[_Joint], tree_names: Sequence[str], name: str) -> Tree:
    """Return the tree called `name`, whose root is the world or else a link without a parent.

    `tree_names` are the names of the joints in the tree.
    """
    ends = {link for joint in joints for link in joint.links}  # links of the main part
    children = {joint.links[1] for joint in joints}
    links = [link for link in scope.links if link in ends]
    taken = {*links, WORLD}
    reached = [WORLD]
    if WORLD not in ends:
        reached = [next((link for link in links if link not in children), links[0])]
    tree = Tree(name, {})
    tree_joints = [joint for joint in joints if joint.name in tree_names]
    for link in reached:  # grows during the loop: breadth first
        tree.links[link] = _make_link(scope, link)
        for joint in tree_joints:
            if link not in joint.links:
                continue
            motions, outer, end = joint.chain_from(link)  # joints, link behind them, its placement there
            if outer not in reached:
                add_chain(tree, link, motions, outer, end, taken)
                reached.append(outer)
    return tree


def _make_link(scope: Scope, name: str) -> Element:
    """Return a link with the stated inertia, else SDF's default, and its primitive shapes.

    The world is a link without a body.
    """
    link = Element("link", name=name)
    if name == WORLD:
        return link
    link.append(_read_inertia(scope, name))
    for shape, sizes, origin, _ in _primitive_shapes(scope, name, "visual"):
        link.append(visual_element(shape, sizes, origin))
    return link


def _primitive_shapes(
    scope: Scope, link: str, tag: str
) -> Iterator[tuple[str, dict[str, str], Array, Element]]:
    """Yield each primitive shape of the visuals or collisions of a link, by their `tag`.

    A shape is its own tag, the texts of its sizes, its placement (4, 4) in the link, and the element.
    """
    model = link.removesuffix(link.rpartition("::")[2])  # prefix of the model's names
    to_link = invert_placement(scope.placement_of(link))
    for element in scope.links[link].findall(tag):
        for shape, keys in SIZES_OF_SHAPES.items():
            if (geometry := element.find(f"geometry/{shape}")) is not None:
                frame, pose = read_pose(element, model, link, f"link {link!r}")
                sizes = {key: child_text(geometry, key, "1") for key in keys}
                yield shape, sizes, to_link @ scope.placement_of(frame) @ pose, element


def _read_inertia(scope: Scope, name: str) -> Element:
    """Read the stated inertia of a link, for `auto` that of collisions, without any SDF's default."""
    where, link = f"link {name!r}", scope.links[name]
    stated = link.find("inertial")
    inertial = Element("inertial") if stated is None else stated
    if not _has_auto_inertia(link):
        mass, *moments = _read_values(inertial, where, _DEFAULT_INERTIA)
        body_pose = read_placement(inertial.find("pose"), where)  # (4, 4) of the centre of mass and its axes
        axes = body_pose[:3, :3]
        return inertial_element(mass, body_pose[:3, 3], axes @ symmetric_matrix(*moments) @ axes.T)

    body = pin.Inertia.Zero()
    common = child_text(inertial, "density", _AUTO_DENSITY)
    for shape, sizes, origin, collision in _primitive_shapes(scope, name, "collision"):
        numbers: list[float] = []
        for key, text in sizes.items():
            numbers += parse_numbers(f"{where}: <{shape}>: <{key}>", text, 3 if key == "size" else 1)
        solid = _SOLIDS[shape](*numbers)
        (density,) = _read_values(collision, where, {"density": common})
        mass = density * solid.computeVolume()
        moment = density * solid.computeMomentofInertia()
        body += pin.SE3(origin).act(pin.Inertia(mass, np.zeros(3), moment))
    (mass,) = _read_values(inertial, where, {"mass": repr(body.mass)})  # stated, it replaces densities
    return inertial_element(mass, body.lever, body.inertia * mass / max(body.mass, LEAST_DIVISOR))


def _has_auto_inertia(link: Element) -> bool:
    """Return whether the inertia of a link is that of its collisions."""
    is_auto = any(inertial.get("auto") in TRUE_TEXTS for inertial in link.findall("inertial"))
    return is_auto and link.find("collision") is not None


def _read_limits(joint: Element, name: str, tag: str) -> tuple[float, float] | None:
    """Read lower and upper limit [rad, m] along the axis in the element `tag`; None without limits."""
    where = f"joint {name!r}"
    lower, upper = (
        parse_limit(f"{where}: <{end}>", child_text(joint, f"{tag}/limit/{end}", default))
        for end, default in (("lower", "-inf"), ("upper", "inf"))
    )
    if lower > upper:
        raise RobotFileError(f"{where}: <limit>: needs lower <= upper, got {lower:g} and {upper:g}")
    return None if (lower, upper) == (-ENDLESS, ENDLESS) else (lower, upper)


def close_joint(tree: UrdfTree, joint: _Joint) -> None:
    """Close the loop that is cut at a joint between two links of the tree.

    Raises:
        RobotFileError: a closure cannot express joints of this type.
    """
    if (kind := joint.element.get("type")) in (*_UNREAD_TYPES, "screw"):
        instead = {
            "screw": "a revolute and a prismatic joint in series, one with <mimic> of the other",
            "gearbox": "<mimic> of one of its joints",
        }
        same = f"; {instead[kind]}, say the same" if kind in instead else ""
        raise RobotFileError(f"joint {joint.name!r}: {kind}: not read where it closes a loop{same}")
    # of each end: suffix of the name of its frame, link, and placement (4, 4) in the link
    ends = zip(("1", "2"), joint.links, joint.placements, strict=True)
    axes = [motion.axis for motion in joint.motions if motion.kind in MOVING]
    tree.close(joint.name, locked_axes(joint.kind), ends, axes)
