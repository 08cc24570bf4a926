"""What the readers of all dialects write into: an open URDF, and what a file says beside its tree.

`UrdfTree` holds the tree, checked and open to edits, with loops, motors and forces in lists; `describe` makes
the records of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from framework.errors import RobotFileError, choose_from, nearest
from framework.model.description import Closure, Coupling, JointDynamics, locked_axes
from framework.model.documents import attribute, remove_children
from framework.model.placement import placement, rotation_about, rotation_with_axis
from framework.model.urdf_edits import NewJoint, add_frame, chain_elements, fix_joint
from framework.model.urdf_elements import (
    MAX_TREE_ELEMENTS,
    SEVERAL,
    Joint,
    Tree,
    local_name,
    read_joint,
    read_tree,
)
from framework.numerics.arrays import Array, Names
from framework.tolerances import FILE_ROUNDING

MAX_LOOPS = 1000  # in a file
MAX_FREEDOMS = 1000  # freedoms of the joints in a file
_PLAIN = ("link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor")
_USED = {
    "link": ("inertial", "visual", "collision"),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
}


class UnreadElement(NamedTuple):
    """An element that is not read, with the joints and links under its action.

    Without the force of most elements a robot is still the same mechanism. Where an element decides how the
    mechanism moves (`is_decisive`), the file is refused if that part moves.
    """

    what: str
    acts_on: Names
    is_decisive: bool = False


class Transmission(NamedTuple):
    """A motor or tendon that acts along the length sum(coefficient q) of joints."""

    name: str  # with its kind
    arms: Mapping[str, float]
    gear: float = 1.0
    dynamics: JointDynamics = JointDynamics()  # before the gear; a motor's whether or not it is chosen
    torque_limit: float | None = None  # motor side [N m]
    is_motor: bool = True


def _remove_foreign_elements(root: Element, valid: Sequence[str]) -> Counter[str]:
    """Remove other programs' elements and attributes from a URDF without xacro; count unused tags.

    Raises:
        RobotFileError: a mistyped element, or a xacro macro.
    """
    _remove_xacro_definitions(root)
    unused = Counter[str]()
    for element in list(root):
        tag = local_name(element.tag)
        if tag in valid:
            unused.update(_unused_parts(element, tag))
        elif "}" not in element.tag and nearest(tag, valid):
            raise RobotFileError(choose_from("element", tag, valid))
        else:
            unused[f"<{tag}>"] += 1
            root.remove(element)
    for element in root.iter():
        for key in [key for key in element.attrib if key.startswith("{")]:
            del element.attrib[key]
    return unused


def _remove_xacro_definitions(root: Element) -> None:
    """Remove definitions of xacro, which expanded files may keep.

    Raises:
        RobotFileError: a macro or a value is not expanded; advises the command with the file's arguments.
    """
    arguments = ""
    for element in list(root):
        tag = local_name(element.tag)
        if _is_xacro(element) and tag in ("property", "arg", "macro"):
            root.remove(element)
            arguments += f" {element.get('name')}:={element.get('default')}" if tag == "arg" else ""
    for element in root.iter():
        if _is_xacro(element) or any("${" in value or "$(" in value for value in element.attrib.values()):
            raise RobotFileError(
                f"<{local_name(element.tag)}>: expand the xacro macros first: xacro FILE{arguments} > OUT"
            )


def _is_xacro(element: Element) -> bool:
    """Return whether an element has the namespace of xacro."""
    return "xacro" in element.tag.partition("}")[0]


def _unused_parts(element: Element, tag: str) -> Iterator[str]:
    """Yield the tags of unread children of an element, or its own."""
    if tag in ("gazebo", "sensor") and element.find("joint/child") is None:
        yield f"<{tag}>"
    for child in element if tag in _USED else ():
        if child.tag not in _USED[tag]:
            yield f"<{child.tag}>"


def merge_overlapping(groups: Iterable[Iterable[str]]) -> list[list[str]]:
    """Merge groups with common members, in the order of their last groups."""
    unions: list[list[str]] = []
    union_of: dict[str, list[str]] = {}
    for members in map(list, groups):
        shared = [name for member in members for name in union_of.get(member, ())]
        union = list(dict.fromkeys([*shared, *members]))
        unions.append(union)
        union_of |= dict.fromkeys(union, union)
    return [union for union in unions if union and union_of[union[0]] is union]


class UrdfTree(Tree):
    """A checked URDF, open to small edits, with loops, motors and forces.

    `extra` are the top-level elements of the dialect; they are taken out of the URDF. Complaints name
    the element; the caller puts the file in front.
    """

    def __init__(self, root: Element, extra: Sequence[str] = ()) -> None:
        """Check a URDF and take out elements of other programs, `extra` ones kept aside."""
        if root.tag != "robot":
            raise RobotFileError(f"<{root.tag}>: the root of a URDF is <robot>")
        attribute(root, "<robot>", "name")
        self.root = root
        names = {link.get("name") for link in root.findall("link")}
        if "world" not in names and any(end.get("link") == "world" for end in root.findall("joint/parent")):
            SubElement(root, "link", name="world")  # Drake's, which need not be declared
        self.unused = _remove_foreign_elements(root, (*_PLAIN, *extra))
        self.extra = [element for element in root if local_name(element.tag) in extra]
        with_interface = root.findall("ros2_control/joint[command_interface]")
        driven = [joint.get("name") for joint in (*root.findall("transmission/joint"), *with_interface)]
        self.motors = list(dict.fromkeys(filter(None, driven)))  # as ROS declares motors
        for element in self.extra:
            root.remove(element)
            for part in element.iter():
                part.tag = local_name(part.tag)  # its dialect has no namespace, or another program's
        impossible: list[tuple[str, str]] = []  # links and joints, and what is wrong with each
        tree = read_tree(root, impossible)
        super().__init__(tree.links, tree.joints, tree.base)
        if len(self.extra) > MAX_LOOPS:
            raise RobotFileError(f"<robot>: {len(self.extra)} loops; at most {MAX_LOOPS} are read")
        if len(self.coordinates) > MAX_FREEDOMS:
            raise RobotFileError(
                f"<robot>: joints of {len(self.coordinates)} freedoms; at most {MAX_FREEDOMS} are read"
            )
        self.fixed_at: dict[str, tuple[float, ...]] = {}  # joints that were fixed, and where [rad, m]
        self._added: dict[str, str] = {}  # the link that carries each frame
        self._taken = {*self.links, *self.joints}  # names
        # what a dialect says beside the tree
        self.closures: list[Closure] = []
        self.couplings: list[Coupling] = []
        self.transmissions: list[Transmission] = []
        self.likely_motors: list[str] = []
        self.dynamics: dict[str, JointDynamics] = {}  # by coordinate
        self.gravity = (0.0, 0.0, -9.81)
        self.reference: dict[str, float] = {}  # by coordinate
        self.left_out = [UnreadElement(text, (name,), is_decisive=True) for name, text in impossible]
        self.remarks: list[str] = []

    @property
    def frames(self) -> list[str]:
        """Names of links, of joints and of added frames."""
        return list(dict.fromkeys([*super().frames, *self._added]))

    def link_of(self, frame: str) -> str:
        """Return the link that carries a frame of the tree."""
        return self._added[frame] if frame in self._added else super().link_of(frame)

    def path_to_base(self, link: str) -> list[Joint]:
        """Return the joints from a link down to the base."""
        path = []
        while link in self.parent_joint:
            path.append(self.parent_joint[link])
            link = path[-1].parent
        return path

    def zero_pose(self, link: str) -> Array:
        """Compute the placement (4, 4) of a link in the base, all joints at zero."""
        matrix = np.eye(4)
        for joint in self.path_to_base(link):
            matrix = joint.origin @ matrix
        return matrix

    def moving_chains(self, first: str, second: str) -> tuple[list[Joint], list[Joint]]:
        """Return the movable joints that carry only the first, only the second link."""
        paths = self.path_to_base(first), self.path_to_base(second)
        shared = {joint.name for joint in paths[0]} & {joint.name for joint in paths[1]}
        of_first, of_second = (
            [joint for joint in path if joint.moves and joint.name not in shared] for path in paths
        )
        return of_first, of_second

    # -------------------------------------------------------------- small edits

    def close(
        self,
        name: str,
        locked: Names,
        ends: Iterable[tuple[str, str, Array]],
        axes: Sequence[Array] = (),
    ) -> None:
        """Add a closure with `locked` axes of two ends: suffix of a frame, link, placement (4, 4).

        `axes` (3,) are in both ends. Of a universal joint the first axis is x of the first frame, the second
        is y of the second frame. Of other kinds they are z, one may stand for both, and a kind without an
        axis needs none.
        """
        letters = "xy" if locked == locked_axes("universal") else "zz"
        turns = [rotation_with_axis(*pair) for pair in zip(letters, 2 * tuple(axes), strict=False)]
        turns = turns or 2 * [np.eye(3)]
        frames = []
        for (suffix, link, origin), turn in zip(ends, turns, strict=True):
            where = origin @ placement(turn)
            is_own = np.array_equal(where, np.eye(4))
            frames.append(link if is_own else self.add_frame(f"{name}_{suffix}", link, where))
        self.closures.append(Closure(name, (frames[0], frames[1]), locked))

    def add_motor(self, joint: str) -> None:
        """Add a motor without a gear to a joint."""
        self.transmissions.append(Transmission(f"motor {joint!r}", {joint: 1.0}))

    def add_frame(self, name: str, link: str, where: Array) -> str:
        """Add a frame to a link; return its name, with underscores if taken."""
        if len(self._added) >= MAX_TREE_ELEMENTS:
            raise RobotFileError(f"more than {MAX_TREE_ELEMENTS} frames besides links and joints")
        free = name
        while free in self._taken or f"{free}_mount" in self._taken:
            free += "_"
        self._taken |= {free, f"{free}_mount"}
        self._added[free] = link
        add_frame(self.root, free, link, where)
        return free

    def fix_at_reference(self, joint: Joint, reference: Mapping[str, float]) -> None:
        """Fix a joint at the reference [rad, m] of its coordinates, else at zero."""
        self.fix(joint, *(reference.get(name, 0.0) for name in joint.coordinates))

    def fix(self, joint: Joint, *values: float) -> None:
        """Fix a joint at the values [rad, m] of its coordinates, zero by default."""
        values = values or (0.0,) * len(joint.coordinates)
        self.fixed_at[joint.name] = values
        fix_joint(joint, *values)

    def replace_by_ball(self, joint: Joint) -> None:
        """Replace a joint by a ball."""
        remove_children(joint.element, "axis", "limit")
        joint.kind = "spherical"
        joint.element.set("type", joint.kind)

    def lock_turn_of_ball(
        self, ball: Joint, axis: str, value: float | None, turn: Sequence[float]
    ) -> dict[str, float]:
        """Replace a ball by two hinges, one turn locked; return their angles [rad].

        Args:
            axis: letter of the turn that is held.
            value: of that turn, ahead of the other two [rad]; None: as the reference has it.
            turn: (3,) rotation vector of the ball in the reference [rad].
        """
        from scipy.spatial.transform import Rotation

        others = "xyz".replace(axis, "")
        locked_angle, *angles = Rotation.from_rotvec(turn).as_euler(f"{axis}{others}".upper())
        locked_angle = locked_angle if value is None else value
        locked_turn = rotation_about(np.eye(3)["xyz".index(axis)], locked_angle)
        ball.origin = ball.origin @ placement(locked_turn)
        names = [f"{ball.name}_r{other}" for other in others]
        self.replace_by_turns(ball, others, names)
        self.fixed_at[f"{ball.name}_r{axis}"] = (locked_angle,)
        return dict(zip(names, map(float, angles), strict=True))

    def replace_by_turns(self, joint: Joint, axes: str, names: Sequence[str] = ()) -> None:
        """Replace a joint by hinges about axes (letters of x, y, z), one behind another."""
        names = names or [f"{joint.name}_{axis.upper()}" for axis in axes]
        for name in names:
            if name in self._taken or f"{name}_link" in self._taken:
                raise RobotFileError(f"joint {joint.name!r}: needs the name {name!r}, taken in the URDF")
        position = list(self.root).index(joint.element)
        del self.joints[joint.name]
        motions = [
            NewJoint(name, "continuous", np.eye(4), np.eye(3)["xyz".index(axis)])
            for name, axis in zip(names, axes.lower(), strict=True)
        ]
        motions[0] = motions[0]._replace(origin=joint.origin)
        chain = list(chain_elements(joint.parent, motions, joint.child, np.eye(4), self._taken))
        self.root[position : position + 1] = chain
        for element in chain:
            if element.tag == "link":
                self.links.append(element.get("name", ""))
            else:
                turn = read_joint(element, set(self.links))
                self._taken.add(turn.name)
                self.joints[turn.name] = self.parent_joint[turn.child] = turn

    def close_turns(self, name: str, first: str, second: str) -> bool:
        """Add the closure that keeps the rotations of two links equal, one loop equation.

        The rotation of a link is the sum of its joints' angles if all joints between are parallel hinges;
        return False where they are not. Hinges about opposite axes count as not parallel.
        """
        joints = [joint for chain in self.moving_chains(first, second) for joint in chain]
        axes = [self.zero_pose(joint.child)[:3, :3] @ joint.axis for joint in joints]
        axes = [axis / np.linalg.norm(axis) for axis in axes]
        if not axes or any(joint.kind in ("prismatic", *SEVERAL) for joint in joints):
            return False
        if any(np.linalg.norm(axis - axes[0]) > FILE_ROUNDING for axis in axes):
            return False
        # on the axes of the base
        turns = [placement(self.zero_pose(link)[:3, :3].T) for link in (first, second)]
        self.close(name, ("rz",), zip(("first", "second"), (first, second), turns, strict=True), axes[:1])
        return True
