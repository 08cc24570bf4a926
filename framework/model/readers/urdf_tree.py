"""The URDF part of the dialects that extend it: an open tree, checked, edited and written out again."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.model.additions import AddedFrame, add_frames
from framework.model.description import (
    Actuator,
    Closure,
    JointSpring,
    Platform,
    RobotDescription,
)
from framework.model.readers.missing_fields import Options, checked_reference, settle
from framework.model.readers.placement import (
    about,
    from_rpy,
    inverse,
    numbers,
    placement,
    short,
    to_rpy,
    turning,
)
from framework.model.urdf import JOINT_TYPES, MOVING

LARGEST = 5000  # links; more is no robot, and names are compared pairwise further on
PARALLEL = 1e-9  # how far two unit axes may differ and still be called parallel
_PLAIN = ("link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor")
_LIMIT = ("lower", "upper", "effort", "velocity")


@dataclass
class Joint:
    """A joint of the tree; `origin` (4, 4) is its placement in the parent link at zero."""

    element: ElementTree.Element
    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array

    @property
    def moves(self) -> bool:
        return self.kind in MOVING


class UrdfTree:
    """A URDF whose names, joints and numbers were checked, open to small edits.

    `extra` are the top-level elements of the dialect; they are taken out of the URDF. Complaints name
    the element; the caller puts the file in front.
    """

    def __init__(self, root: ElementTree.Element, extra: Sequence[str] = ()) -> None:
        if root.tag != "robot":
            raise RobotFileError(f"<{root.tag}>: the root of a URDF is <robot>")
        attribute(root, "<robot>", "name")
        self.root = root
        valid = (*_PLAIN, *extra)
        for element in root:
            if element.tag.startswith("{") and "xacro" in element.tag:
                raise RobotFileError(f"<{_local(element.tag)}>: expand the xacro macros first (xacro FILE)")
            if element.tag not in valid:
                raise RobotFileError(choose_from("element", element.tag, valid))
        self.extra = [element for element in root if element.tag in extra]
        self.motors = _declared_motors(root)
        for element in self.extra:
            root.remove(element)
        self.links = _names(root, "link")
        _names(root, "joint")
        most = max(len(self.links), len(root.findall("joint")))
        if most > LARGEST:
            raise RobotFileError(f"<robot>: {most} links or joints; at most {LARGEST} are read")
        known = set(self.links)
        self.joints = {j.name: j for j in (_read_joint(e, known) for e in root.findall("joint"))}
        for link in root.findall("link"):
            _check_link(link)
        self.parent_joint = {joint.child: joint for joint in self.joints.values()}
        self.base = self._check_tree()
        self._added: list[AddedFrame] = []

    # -------------------------------------------------------------- what is there

    @property
    def frames(self) -> list[str]:
        """Names of links, of joints and of added frames."""
        added = [frame.name for frame in self._added]
        return list(dict.fromkeys([*self.links, *self.joints, *added]))

    @property
    def movable(self) -> list[str]:
        return [joint.name for joint in self.joints.values() if joint.moves]

    def link(self, where: str, name: str | None) -> str:
        """A link's name, if there is one.

        Raises:
            RobotFileError: there is none.
        """
        if name not in self.links:
            raise RobotFileError(f"{where}: {choose_from('link', name, self.links)}")
        return str(name)

    def link_of(self, frame: str) -> str:
        """The link that carries a frame of the tree."""
        if frame in self.links:
            return frame
        added = {found.name: found.parent for found in self._added}
        return added[frame] if frame in added else self.joints[frame].child

    def path_to_base(self, link: str) -> list[Joint]:
        """The joints from a link down to the base."""
        path = []
        while link in self.parent_joint:
            path.append(self.parent_joint[link])
            link = path[-1].parent
        return path

    def at_zero(self, link: str) -> Array:
        """Placement of a link in the base with all joints at zero."""
        matrix = np.eye(4)
        for joint in self.path_to_base(link):
            matrix = joint.origin @ matrix
        return matrix

    def moving_chains(self, first: str, second: str) -> tuple[list[Joint], list[Joint]]:
        """The movable joints that carry one link and not the other, for each of the two."""
        one, two = self.path_to_base(first), self.path_to_base(second)
        shared = {joint.name for joint in one} & {joint.name for joint in two}

        def own(path: list[Joint]) -> list[Joint]:
            return [joint for joint in path if joint.name not in shared and joint.moves]

        return own(one), own(two)

    def axis_at_zero(self, joint: Joint) -> Array:
        """Direction of a joint's axis in the base, all joints at zero."""
        direction = (self.at_zero(joint.parent) @ joint.origin)[:3, :3] @ joint.axis
        return np.asarray(direction / np.linalg.norm(direction))

    # -------------------------------------------------------------- small edits

    def frame_at(self, name: str, link: str, where: Array) -> str:
        """A frame on a link: the link's own where the placement is the identity, else one added."""
        return link if np.array_equal(where, np.eye(4)) else self.add_frame(name, link, where)

    def add_frame(self, name: str, link: str, where: Array) -> str:
        """A frame added to a link; its name, with underscores behind where that was taken."""
        taken = {*self.frames, *(f"{frame.name}_mount" for frame in self._added)}
        free = name
        while free in taken or f"{free}_mount" in taken:
            free += "_"
        x, y, z = map(float, where[:3, 3])
        self._added.append(AddedFrame(free, link, (x, y, z), to_rpy(where[:3, :3])))
        return free

    def fix(self, joint: Joint, value: float) -> None:
        """Hold a joint at a value [rad, m]."""
        if joint.kind == "prismatic":
            motion = placement(None, value * joint.axis / np.linalg.norm(joint.axis))
        else:
            motion = placement(about(joint.axis, value))
        joint.origin = joint.origin @ motion
        joint.kind = "fixed"
        joint.element.set("type", "fixed")
        for tag in ("axis", "limit", "origin"):
            for element in joint.element.findall(tag):
                joint.element.remove(element)
        joint.element.append(origin_element(joint.origin))

    def replace_by_turns(self, joint: Joint, axes: str) -> list[str]:
        """Put turns about axes (letters of x, y, z) in place of a joint; the names end in the letters."""
        names = [f"{joint.name}_{axis.upper()}" for axis in axes]
        for name in names:
            if name in self.joints or f"{name}_link" in self.links:
                raise RobotFileError(f"joint {joint.name!r}: needs the name {name!r}, taken in the URDF")
        position = list(self.root).index(joint.element)
        self.root.remove(joint.element)
        del self.joints[joint.name]
        parent, origin = joint.parent, joint.origin
        for name, axis in zip(names, axes.lower(), strict=True):
            child = joint.child if name == names[-1] else f"{name}_link"
            if child != joint.child:
                self.links.append(child)
                self.root.append(ElementTree.Element("link", name=child))
            element = joint_element(name, "continuous", parent, child, origin, "xyz".index(axis))
            self.root.insert(position, element)
            position += 1
            self.joints[name] = Joint(
                element, name, "continuous", parent, child, origin, np.eye(3)["xyz".index(axis)]
            )
            self.parent_joint[child] = self.joints[name]
            parent, origin = child, np.eye(4)
        return names

    def same_turning(self, name: str, first: str, second: str) -> Closure | None:
        """A closure that keeps two links turned alike as at zero, if all joints between turn in parallel.

        Then the turn of each link is the sum of its joints' angles, and "the sums are equal" is a loop
        equation; None where it is none.
        """
        one, two = self.moving_chains(first, second)
        axes = [self.axis_at_zero(joint) for joint in (*one, *two)]
        if not axes or any(joint.kind == "prismatic" for joint in (*one, *two)):
            return None
        if any(np.linalg.norm(axis - axes[0]) > PARALLEL for axis in axes):
            return None
        common = placement(turning("z", axes[0]))
        frames = []
        for end, link in (("first", first), ("second", second)):
            turn = inverse(self.at_zero(link))[:3, :3] @ common[:3, :3]
            frames.append(self.frame_at(f"{name}_{end}", link, placement(turn)))
        return Closure(name, (frames[0], frames[1]), ("rz",))

    # -------------------------------------------------------------- the description

    def describe(
        self,
        file: Path,
        options: Options,
        closures: Sequence[Closure],
        *,
        platform: Platform | None = None,
        actuators: Sequence[Actuator] = (),
        likely_motors: Sequence[str] = (),
        joint_springs: Sequence[JointSpring] = (),
        gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
        reference: dict[str, float] | None = None,
    ) -> RobotDescription:
        """The records, once the options have said what the file does not."""
        if not closures:
            raise RobotFileError("there is no loop in it: a parallel robot needs at least one closure")
        names = [closure.name for closure in closures]
        for closure in closures:
            if names.count(closure.name) > 1:
                raise RobotFileError(f"closure {closure.name!r} is there twice")
            if closure.frames[0] == closure.frames[1]:
                raise RobotFileError(
                    f"closure {closure.name!r}: joins {closure.frames[0]!r} with itself; needs two frames"
                )
            if not any(self.moving_chains(*map(self.link_of, closure.frames))):
                raise RobotFileError(
                    f"closure {closure.name!r}: no joint moves between {closure.frames[0]!r} and "
                    f"{closure.frames[1]!r}, so it closes no loop"
                )
        frames, joints = self.frames, self.movable
        said = settle(
            options,
            frames=frames,
            joints=joints,
            platform=platform,
            actuators=actuators,
            likely_motors=likely_motors,
        )
        text = add_frames(ElementTree.tostring(self.root, encoding="unicode"), self._added)
        return RobotDescription(
            name=file.stem,
            file=file,
            urdf_text=text,
            platform=said.platform,
            actuators=said.actuators,
            closures=tuple(closures),
            joint_springs=tuple(joint_springs),
            gravity=gravity,
            reference=checked_reference(options, joints, reference or {}),
        )

    def _check_tree(self) -> str:
        children = [joint.child for joint in self.joints.values()]
        for child in children:
            if child == self.parent_joint[child].parent:
                raise RobotFileError(f"joint {self.parent_joint[child].name!r}: joins {child!r} with itself")
            if children.count(child) > 1:
                raise RobotFileError(
                    f"link {child!r} has two parents; a URDF is a tree: cut the loop there and declare it"
                )
        roots = [link for link in self.links if link not in self.parent_joint]
        if len(roots) != 1:
            raise RobotFileError(f"needs exactly one root link, got {', '.join(roots[:5]) or 'none'}")
        below: dict[str, list[str]] = {}
        for joint in self.joints.values():
            below.setdefault(joint.parent, []).append(joint.child)
        reached, waiting = set(roots), list(roots)
        while waiting:
            for child in below.get(waiting.pop(), []):
                reached.add(child)
                waiting.append(child)
        lost = [link for link in self.links if link not in reached]
        if lost:
            raise RobotFileError(f"link {lost[0]!r} hangs in a circle of joints without a root")
        return roots[0]


# ------------------------------------------------------------------ reading the elements


def only(
    element: ElementTree.Element, where: str, children: Iterable[str], attributes: Iterable[str]
) -> None:
    """Complain about children and attributes that are not known, and children given twice."""
    tags = [child.tag for child in element]
    for tag in tags:
        if tag not in children:
            raise RobotFileError(f"{where}: {choose_from('element', tag, children)}")
        if tags.count(tag) > 1:
            raise RobotFileError(f"{where}: <{tag}> is there twice")
    for attribute in element.attrib:
        if attribute not in attributes:
            raise RobotFileError(f"{where}: {choose_from('attribute', attribute, attributes)}")


def required(element: ElementTree.Element, where: str, tag: str) -> ElementTree.Element:
    """The child with this tag."""
    found = element.find(tag)
    if found is None:
        given = ", ".join(f"<{child.tag}>" for child in element) or "nothing"
        raise RobotFileError(f"{where}: <{tag}> is missing (given: {given})")
    return found


def attribute(element: ElementTree.Element, where: str, key: str) -> str:
    """An attribute that must be there and not empty."""
    value = element.get(key)
    if not value:
        given = ", ".join(element.attrib) or "nothing"
        raise RobotFileError(f"{where}: attribute {key!r} is missing or empty (given: {given})")
    return value


def origin_of(element: ElementTree.Element | None, where: str) -> Array:
    """The placement of an `<origin xyz rpy>`; the identity without one."""
    if element is None:
        return np.eye(4)
    only(element, where, (), ("xyz", "rpy"))
    xyz = numbers(f"{where} xyz", element.get("xyz", "0 0 0"), 3)
    rpy = numbers(f"{where} rpy", element.get("rpy", "0 0 0"), 3)
    return placement(from_rpy(rpy), xyz)


def axis_of(element: ElementTree.Element, where: str) -> Array:
    """The direction of an `<axis xyz>`, which must not be zero."""
    only(element, where, (), ("xyz",))
    axis = np.array(numbers(f"{where} xyz", attribute(element, where, "xyz"), 3))
    if not axis.any():
        raise RobotFileError(f"{where}: the axis is zero")
    return axis


def origin_element(matrix: Array) -> ElementTree.Element:
    """The `<origin>` of a placement."""
    rpy = to_rpy(matrix[:3, :3])
    return ElementTree.Element(
        "origin", xyz=" ".join(repr(float(v)) for v in matrix[:3, 3]), rpy=" ".join(map(repr, rpy))
    )


def joint_element(
    name: str, kind: str, parent: str, child: str, origin: Array, axis: int | Sequence[float] | Array | None
) -> ElementTree.Element:
    """A `<joint>` without limits; `axis` is the number of a coordinate axis or a vector."""
    element = ElementTree.Element("joint", name=name, type=kind)
    ElementTree.SubElement(element, "parent", link=parent)
    ElementTree.SubElement(element, "child", link=child)
    element.append(origin_element(origin))
    if axis is not None:
        vector = np.eye(3)[axis] if isinstance(axis, int) else np.asarray(axis, dtype=float)
        ElementTree.SubElement(element, "axis", xyz=" ".join(repr(float(v)) for v in vector))
    if kind == "prismatic":
        ElementTree.SubElement(element, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return element


def _names(root: ElementTree.Element, tag: str) -> list[str]:
    names: dict[str, None] = {}
    for element in root.findall(tag):
        name = attribute(element, f"<{tag}>", "name")
        if name in names:
            raise RobotFileError(f"{tag} {name!r} is there twice")
        names[name] = None
    return list(names)


def _read_joint(element: ElementTree.Element, links: set[str]) -> Joint:
    name = str(element.get("name"))
    where = f"joint {name!r}"
    kind = attribute(element, where, "type")
    if kind not in JOINT_TYPES:
        raise RobotFileError(f"{where}: {choose_from('type', kind, JOINT_TYPES)}")
    if element.find("mimic") is not None:
        raise RobotFileError(f"{where}: <mimic> is not supported; declare a loop instead")
    ends = []
    for end in ("parent", "child"):
        link = attribute(required(element, where, end), f"{where}: <{end}>", "link")
        if link not in links:
            raise RobotFileError(f"{where}: {end}: {choose_from('link', link, links)}")
        ends.append(link)
    axis = element.find("axis")
    direction = np.array([1.0, 0.0, 0.0])
    if kind == "fixed" and axis is not None:
        element.remove(axis)  # without a meaning, and some exporters write 0 0 0
    elif axis is not None:
        direction = axis_of(axis, f"{where}: <axis>")
    if kind in ("revolute", "prismatic"):
        limit = required(element, where, "limit")
        for key in ("effort", "velocity"):
            attribute(limit, f"{where}: <limit>", key)
        lower, upper, effort, velocity = (
            numbers(f"{where}: <limit> {key}", limit.get(key, "0"), 1)[0] for key in _LIMIT
        )
        if lower > upper or effort < 0 or velocity < 0:
            raise RobotFileError(
                f"{where}: <limit>: needs lower <= upper, effort and velocity of at least zero, got lower "
                f"{lower:g}, upper {upper:g}, effort {effort:g}, velocity {velocity:g}"
            )
    if "independent" in element.attrib:
        del element.attrib["independent"]  # a URDF+ hint, read before
    origin = origin_of(element.find("origin"), f"{where}: <origin>")
    return Joint(element, name, kind, ends[0], ends[1], origin, direction)


def _check_link(link: ElementTree.Element) -> None:
    where = f"link {link.get('name')!r}"
    inertial = link.find("inertial")
    if inertial is None:
        return
    origin_of(inertial.find("origin"), f"{where}: <inertial> <origin>")
    mass = required(inertial, f"{where}: <inertial>", "mass")
    if numbers(f"{where}: <mass>", attribute(mass, f"{where}: <mass>", "value"), 1)[0] < 0:
        raise RobotFileError(f"{where}: <mass>: must not be negative, got {short(mass.get('value'))}")
    inertia = required(inertial, f"{where}: <inertial>", "inertia")
    for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        (value,) = numbers(f"{where}: <inertia> {key}", attribute(inertia, f"{where}: <inertia>", key), 1)
        if value < 0 and key in ("ixx", "iyy", "izz"):
            raise RobotFileError(f"{where}: <inertia> {key}: must not be negative, got {value:g}")


def _declared_motors(root: ElementTree.Element) -> list[str]:
    """Joints with a transmission or a command interface, as ROS says which joints are driven."""
    names = [joint.get("name", "") for joint in root.findall("transmission/joint")]
    names += [
        joint.get("name", "")
        for joint in root.findall("ros2_control/joint")
        if joint.find("command_interface") is not None
    ]
    return list(dict.fromkeys(name for name in names if name))


def _local(tag: str) -> str:
    return tag.rsplit("}", 1)[-1]
