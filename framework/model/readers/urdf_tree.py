"""The tree that the readers of all dialects fill, with the content of a file beside it.

`UrdfTree` has the checked tree, which readers edit, and lists of loops, motors and forces. `describe` turns
both into records.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from framework.errors import RobotFileError, check_name, choose_from, nearest
from framework.model.description import (
    Closure,
    Coupling,
    JointDynamics,
    LineSpring,
    Polynomial,
    lock_couplings,
    locked_axes,
)
from framework.model.documents import attribute, parse_numbers
from framework.model.placement import placement, rotation_about, rotation_with_axis, unit_vector
from framework.model.urdf_edits import add_chain, add_frame, fixed_joint, free_name
from framework.model.urdf_elements import (
    COORDINATE_SUFFIXES,
    INERTIA_ENTRIES,
    MAX_TREE_DEPTH,
    MAX_TREE_ELEMENTS,
    Complaints,
    Joint,
    Tree,
    check_tree,
    local_name,
    read_tree,
    symmetric_matrix,
)
from framework.numerics.arrays import Array, Names
from framework.tolerances import FILE_ROUNDING, INERTIA_ROUNDING

MAX_FREEDOMS = MAX_TREE_DEPTH  # sum over the joints in a file
MAX_LOOPS = MAX_FREEDOMS  # in a file: each loop that restricts the motion takes a freedom
# By how much both motors of a transmission turn, before their own gears, by a unit turn of either joint, for
# the reductions n1 and n2 of the joints (transmission_interface of ros_control and ros2_control)
_TURNS_OF_MOTORS: dict[str, Callable[[float, float], tuple[tuple[float, float], tuple[float, float]]]] = {
    "DifferentialTransmission": lambda n1, n2: ((n1, n2), (n1, -n2)),
    "FourBarLinkageTransmission": lambda n1, n2: ((n1, 0.0), (1.0, n2)),
}
# top-level elements that belong to every URDF; children that are read, of some of them
_URDF_TAGS = ("link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor")
_READ_CHILDREN = {
    "link": ("inertial", "visual", "collision"),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
}


class UnreadElement(NamedTuple):
    """An unread element, with the joints and links under its action.

    Most such elements are forces, and without them the mechanism is the same. If an element decides how the
    mechanism moves (`is_decisive`) and acts on a part that moves, the file is refused.
    """

    what: str  # for messages: element, name, effect and its size
    acts_on: Names  # joints and links
    is_decisive: bool = False


class Transmission(NamedTuple):
    """A motor or tendon that acts along a length sum(arm q) of joints.

    A motor with a gear turns by gear times this length.
    """

    name: str  # such as "motor 'm'"
    arms: Mapping[str, float]  # moment arms by joint: d length / d q
    gear: float = 1.0
    dynamics: JointDynamics = JointDynamics()  # before the gear; also of a motor that is not chosen
    torque_limit: float | None = None  # motor side [N m]
    is_motor: bool = True


def _remove_foreign_elements(root: Element, valid: Sequence[str]) -> Counter[str]:
    """Remove top-level elements whose tags are not `valid`, and attributes of other programs.

    Return the counts of unused elements by tag.
    """
    _remove_xacro_definitions(root)
    unused = Counter[str]()
    for element in list(root):
        tag = local_name(element.tag)
        if tag in valid:
            if tag in ("gazebo", "sensor") and element.find("joint/child") is None:
                unused[f"<{tag}>"] += 1
            read = _READ_CHILDREN.get(tag)
            unused.update(f"<{child.tag}>" for child in element if read and child.tag not in read)
        elif "}" not in element.tag and nearest(tag, valid):  # in no namespace, so probably misspelled
            raise RobotFileError(choose_from("element", tag, valid))
        else:
            unused[f"<{tag}>"] += 1
            root.remove(element)
    for element in root.iter():
        for key in list(element.attrib):
            if key.startswith("{"):  # in the namespace of another program
                del element.attrib[key]
    return unused


def _remove_xacro_definitions(root: Element) -> None:
    """Remove xacro definitions, which may remain in expanded files."""
    arguments = ""
    for element in list(root):
        if _is_xacro_definition(element):
            root.remove(element)
            if local_name(element.tag) == "arg":
                arguments += f" {element.get('name')}:={element.get('default')}"
    for element in root.iter():
        values = " ".join(element.attrib.values())
        if _is_xacro(element) or "${" in values or "$(" in values:
            raise RobotFileError(
                f"<{local_name(element.tag)}>: expand the xacro macros first: xacro FILE{arguments} > OUT"
            )


def _read_reductions(parts: Iterable[Element], where: str) -> dict[str, float]:
    """Return the reduction [motor / joint] of each part of a transmission, by name.

    Parts are in the order of their roles. The reduction is the product of those that the part states, else 1.
    """
    reductions: dict[str, float] = {}
    for part in sorted(parts, key=lambda part: part.get("role", "")):
        name = part.get("name", "")
        factor = reductions.setdefault(name, 1.0)
        for tag in ("mechanicalReduction", "mechanical_reduction"):
            for element in part.findall(tag):
                factor *= parse_numbers(f"{where}: <{tag}>", element.text, 1)[0]
        if not factor:
            raise RobotFileError(f"{where}: the reduction of {name} is zero")
        reductions[name] = factor
    return reductions


def _select_tree(root: Element, base: str | None) -> None:
    """Remove the links and joints that no joint connects with the link `base`."""
    ends = {}  # the two links of each joint, by its element
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            ends[joint] = parent.get("link", ""), child.get("link", "")
    links = [link.get("name", "") for link in root.findall("link")]
    children = {child for _, child in ends.values()}
    roots = [link for link in links if link not in children]
    trees = merge_overlapping([*((link,) for link in links), *ends.values()])
    if len(roots) < 2 or len(trees) < 2 or len(links) > MAX_TREE_ELEMENTS:
        return  # other faults are told by `read_tree`
    selected = next((tree for tree in trees if base in tree), None)
    if selected is None:
        raise RobotFileError(
            f"needs exactly one root link, got {', '.join(roots[:5])}; --base {roots[0]} reads one tree"
        )
    for element in [*root.findall("link"), *ends]:
        if ends.get(element, (element.get("name"),))[0] not in selected:
            root.remove(element)


def _repair_rounded_inertia(link: Element) -> str | None:
    """Repair principal moments that rounding in the file made impossible; return a remark, else None.

    The largest moment may exceed the sum of the others by what half a unit in the last digit of each entry
    accounts for. The excess is shared among the three.
    """
    inertia = link.find("inertial/inertia")
    texts = [] if inertia is None else [inertia.get(key, "") for key in INERTIA_ENTRIES]
    try:
        numbers = [Decimal(text.strip()) for text in texts]
    except InvalidOperation:
        return None
    if inertia is None or not all(number.is_finite() for number in numbers):
        return None
    units = [10.0 ** min(int(number.as_tuple().exponent), 0) if number else 0.0 for number in numbers]
    units = [unit if unit < 1.0 else 0.0 for unit in units]  # whole numbers are exact
    moments, axes = np.linalg.eigh(symmetric_matrix(*map(float, numbers)))  # ascending
    excess = moments[2] - moments[1] - moments[0]
    # the excess is 2 I3 - trace, and I3 changes by v'E v with errors E of the entries and the axis v of I3
    slopes = 2.0 * np.outer(axes[:, 2], axes[:, 2]) - np.eye(3)
    rounding = 0.5 * float((np.abs(slopes) * symmetric_matrix(*units)).sum())
    if moments[0] <= 0.0 or not INERTIA_ROUNDING * moments[2] < excess <= rounding * (1 + FILE_ROUNDING):
        return None
    moments += excess / 3.0 * np.array([1.0, 1.0, -1.0])
    repaired = (axes * moments) @ axes.T
    for key in INERTIA_ENTRIES:
        inertia.set(key, repr(float(repaired["xyz".index(key[1]), "xyz".index(key[2])])))
    name = link.get("name")
    return f"link {name!r}: its inertia is rounded to impossible moments; repaired in their last digit"


def _is_xacro(element: Element) -> bool:
    """Return whether an element is in the namespace of xacro."""
    return "xacro" in element.tag.partition("}")[0]


def _is_xacro_definition(element: Element) -> bool:
    """Return whether an element defines what xacro expands elsewhere."""
    return _is_xacro(element) and local_name(element.tag) in ("property", "arg", "macro")


def merge_overlapping(groups: Iterable[Iterable[str]]) -> list[list[str]]:
    """Merge groups with common members; order the unions by the last group in each."""
    unions: list[list[str]] = []
    union_of: dict[str, list[str]] = {}
    for members in map(list, groups):
        # members of the unions so far that have a member in common with this group
        shared = [name for member in members for name in union_of.get(member, ())]
        union = list(dict.fromkeys([*shared, *members]))
        unions.append(union)
        union_of |= dict.fromkeys(union, union)
    # the members of a union that was merged into a later one belong to the later one
    return [union for union in unions if union and union_of[union[0]] is union]


def read_urdf_tree(
    root: Element, extra: Sequence[str] = (), base: str | None = None
) -> tuple[UrdfTree, list[Element]]:
    """Read tree and motors of a URDF, and a dialect's own top-level elements.

    Args:
        root: of the URDF, which is changed: other programs' elements and namespaces are removed.
        extra: tags of the dialect's own top-level elements.
        base: a link; of several trees in the file the one with this link is read.

    Raises:
        RobotFileError: the root is no <robot> or has no name; an element is misspelled, or a macro is not
            expanded; links and joints are no tree, see `read_tree`; loops or freedoms are too many.
    """
    if root.tag != "robot":
        raise RobotFileError(f"<{root.tag}>: the root of a URDF is <robot>")
    is_part = not root.get("name") or all(map(_is_xacro_definition, root))  # of a robot
    if root.find("link") is None and any(map(_is_xacro, root)) and is_part:
        raise RobotFileError(
            "<robot>: has xacro definitions and no link: expand the file that includes it, and give the "
            "result: xacro FILE > OUT"
        )
    attribute(root, "<robot>", "name")
    # Drake's files need not declare the link `world`
    if root.find("joint/parent[@link='world']") is not None and root.find("link[@name='world']") is None:
        SubElement(root, "link", name="world")
    unused = _remove_foreign_elements(root, (*_URDF_TAGS, *extra))
    elements = [element for element in root if local_name(element.tag) in extra]
    for element in elements:
        root.remove(element)
        for part in element.iter():
            part.tag = local_name(part.tag)
    if len(elements) > MAX_LOOPS:
        raise RobotFileError(f"<robot>: {len(elements)} loops; at most {MAX_LOOPS} are read")
    _select_tree(root, base)
    remarks = list(filter(None, map(_repair_rounded_inertia, root.findall("link"))))

    impossible: Complaints = []
    for joint in root.findall("joint[@type='planar']"):
        # read as a floating joint, so that it can be held
        joint.set("type", "floating")
        name = joint.get("name", "")
        impossible.append((name, f"joint {name!r}: planar joints are only read where they are held (--lock)"))
    tree = UrdfTree(read_tree(root, impossible), impossible)
    tree.unused, tree.remarks = unused, remarks
    # the two ways in which ROS declares motors
    driven = root.findall("transmission/joint") + root.findall("ros2_control/joint[command_interface]")
    tree.motors = list(dict.fromkeys(filter(None, (joint.get("name") for joint in driven))))
    for transmission in root.iter("transmission"):
        tree.read_transmission(transmission)
    return tree, elements


class UrdfTree(Tree):
    """A checked tree with loops, motors and forces, which readers edit.

    Messages name the element; the caller prefixes the file.
    """

    def __init__(self, tree: Tree, impossible: Complaints | None = None) -> None:
        """Check the links and joints of a tree, which this one takes over.

        A file with impossible inertias or limits is refused only if their links or joints move.

        Args:
            tree: of a file.
            impossible: complaints about its links and joints so far, see `check_tree`.

        Raises:
            RobotFileError: links and joints are no tree, see `check_tree`; freedoms are too many.
        """
        complaints: Complaints = [] if impossible is None else impossible
        check_tree(tree, complaints)
        super().__init__(tree.name, tree.links, tree.joints, tree.others)
        freedoms = len(self.coordinates)
        if freedoms > MAX_FREEDOMS:
            raise RobotFileError(f"<robot>: joints of {freedoms} freedoms; at most {MAX_FREEDOMS} are read")
        self.fixed_positions: dict[str, float] = {}  # of fixed joints, in their first coordinate [rad, m]
        self._taken = {*self.links, *self.joints}  # names of links, joints and added frames

        # the content of the file beside the tree
        self.unused = Counter[str]()  # elements by tag
        self.remarks: list[str] = []
        self.motors: list[str] = []  # joints
        self.gears: dict[str, float] = {}  # of these motors, where it is not 1
        self.unread_transmissions: list[str] = []
        self.closures: list[Closure] = []
        self.couplings: list[Coupling] = []
        self.line_springs: list[LineSpring] = []
        self.transmissions: list[Transmission] = []
        self.likely_motors: list[str] = []
        self.gravity = (0.0, 0.0, -9.81)
        self.reference: dict[str, float] = {}  # by coordinate
        self.left_out = [UnreadElement(text, (name,), is_decisive=True) for name, text in complaints]

    # -------------------------------------------------------------- edits

    def close(
        self, name: str, locked: Names, ends: Iterable[tuple[str, str, Array]], axes: Sequence[Array] = ()
    ) -> None:
        """Add a closure with `locked` axes between two ends.

        Args:
            name: of the closure, with which the names of its frames begin.
            locked: axes of the first frame along which the relative pose of both frames is locked.
            ends: for each end the suffix of the frame's name, the link, and the joint's placement (4, 4) in
                the link.
            axes: (3,) each, in the joint's placement; one for each end, one for both, or none. The first axis
                of a universal joint becomes x of the first frame, the second becomes y of the second frame.
                Axes of other kinds become z.

        Raises:
            RobotFileError: see `add_frame`.
        """
        letters = "xy" if locked == locked_axes("universal") else "zz"  # of both frames, along the axes
        rotations = 2 * [np.eye(3)]
        if axes:
            end_axes = axes[0], axes[-1]  # one axis stands for both ends
            rotations = list(map(rotation_with_axis, letters, end_axes))
        frames = []
        for (suffix, link, origin), rotation in zip(ends, rotations, strict=True):
            in_link = origin @ placement(rotation)
            is_link_frame = np.array_equal(in_link, np.eye(4))
            frames.append(link if is_link_frame else self.add_frame(f"{name}_{suffix}", link, in_link))
        self.closures.append(Closure(name, (frames[0], frames[1]), locked))

    def add_motor(self, joint: str) -> None:
        """Add a motor to a joint, with the gear that the URDF states."""
        self.transmissions.append(Transmission(f"motor {joint!r}", {joint: 1.0}, self.gears.get(joint, 1.0)))

    def read_transmission(self, transmission: Element) -> None:
        """Read the gears of one motor or of two; remark on other transmissions.

        The reduction stands at the actuator (ROS 1), at the joint (ros2_control), or beside both (older
        files). It is a product where several do.
        """
        name = transmission.get("name", "")
        where = f"transmission {name!r}"
        kinds = transmission.findtext("type"), transmission.findtext("plugin"), transmission.get("type")
        kind = next(filter(None, kinds), "").strip().rpartition("/")[2]
        (common,) = _read_reductions([transmission], where).values()
        joints = _read_reductions(transmission.findall("joint"), where)
        motors = _read_reductions(transmission.findall("actuator"), where)
        offsets = [parse_numbers(f"{where}: <offset>", part.text, 1) for part in transmission.iter("offset")]
        if np.any(offsets):
            self.remarks.append(
                f"{where}: its offset is not read: motor angles are zero where the joints are"
            )
        if kind in _TURNS_OF_MOTORS and len(joints) == 2 == len(motors) and all([*joints, *motors]):
            gears = {motor: common * reduction for motor, reduction in motors.items()}
            self._add_rotors(name, kind, joints, gears)
        elif len(joints) > 1 or kind not in ("", "SimpleTransmission"):
            unread = f"not read: {where}, {kind or 'of several joints'} of {', '.join(joints)}"
            self.unread_transmissions.append(unread)
            self.remarks.append(f"{unread}: motors are taken to be at these joints, without gears")
        else:
            for joint, reduction in joints.items():
                gear = common * reduction * math.prod(motors.values())
                self.gears[joint] = self.gears.get(joint, 1.0) * gear
                if self.gears[joint] < 0.0:
                    self.remarks.append(
                        f"{where}: the motor of {joint} turns against its joint; its sign is left out"
                    )

    def _add_rotors(
        self, name: str, kind: str, joints: Mapping[str, float], gears: Mapping[str, float]
    ) -> None:
        """Add a massless rotor for each motor that moves two joints, and the equation of its turn.

        Args:
            name: of the transmission.
            kind: one of _TURNS_OF_MOTORS.
            joints, gears: reductions by name of the two joints in the order of the roles, and of the motors.

        Raises:
            RobotFileError: a joint is not one of the movable ones.
        """
        for joint in joints:
            check_name(f"transmission {name!r}: {kind}", "movable joint", joint, self.movable)
        self.motors = [motor for motor in self.motors if motor not in joints]
        turns = _TURNS_OF_MOTORS[kind](*joints.values())
        carried = self.joints[list(joints)[-1]].child
        for (motor, gear), arms in zip(gears.items(), turns, strict=True):
            rotor = free_name(f"{motor}_rotor", self._taken)
            hinge = free_name(motor, self._taken)
            turn = Joint(hinge, "continuous", axis=unit_vector("z"))
            add_chain(self, self.base, [turn], rotor, np.eye(4), self._taken)
            # gear ratios have no sign, so that the rotor has it
            terms = {hinge: math.copysign(1.0, -gear), **dict(zip(joints, arms, strict=True))}
            self.equate(f"{name}_{motor}", terms, 0.0, (rotor, carried))
            self.transmissions.append(Transmission(f"motor {hinge!r}", {hinge: 1.0}, abs(gear)))

    def add_frame(self, name: str, link: str, origin: Array) -> str:
        """Add a frame at a placement `origin` (4, 4) in a link; return the name.

        Underscores are added to the name until it is free, and so is that of the joint NAME_mount.

        Raises:
            RobotFileError: the tree has twice MAX_TREE_ELEMENTS links.
        """
        if len(self.links) >= 2 * MAX_TREE_ELEMENTS:
            raise RobotFileError(f"more than {2 * MAX_TREE_ELEMENTS} links and frames")
        free = name
        while free in self._taken or f"{free}_mount" in self._taken:
            free += "_"
        self._taken |= {free, f"{free}_mount"}
        add_frame(self, free, link, origin)
        return free

    def fix_at_reference(self, joint: Joint, reference: Mapping[str, float]) -> None:
        """Fix a joint at the reference [rad, m] of its coordinates, else at zero."""
        self.fix(joint, *(reference.get(name, 0.0) for name in joint.coordinates))

    def fix(self, joint: Joint, *values: float) -> None:
        """Fix a joint at the values [rad, m] of its coordinates, zero by default.

        A joint that is fixed already stays where it is.
        """
        if not joint.moves:
            self.fixed_positions.setdefault(joint.name, 0.0)
            return
        values = values or (0.0,) * len(joint.coordinates)
        self.fixed_positions[joint.name] = values[0]
        self.put(fixed_joint(joint, *values))

    def lock_turn_of_ball(
        self, ball: Joint, axis: str, value: float | None, rotation_vector: Sequence[float]
    ) -> dict[str, float]:
        """Lock one rotation of a ball, which becomes two hinges; return their angles [rad].

        Args:
            axis: letter of the locked rotation, the first of the three in the chain.
            value: its angle [rad]; None for the one in the reference.
            rotation_vector: (3,) of the ball in the reference [rad].

        Raises:
            RobotFileError: the name of a hinge, or of the link behind it, is taken.
        """
        from scipy.spatial.transform import Rotation

        others = "xyz".replace(axis, "")
        sequence = f"{axis}{others}".upper()  # capitals: about the axes of the turned body
        locked_angle, *angles = Rotation.from_rotvec(rotation_vector).as_euler(sequence)
        if value is not None:
            locked_angle = value
        ball = replace(ball, origin=ball.origin @ placement(rotation_about(unit_vector(axis), locked_angle)))
        names = [f"{ball.name}_r{other}" for other in others]
        self.replace_by_turns(ball, others, names)
        self.fixed_positions[f"{ball.name}_r{axis}"] = locked_angle
        return dict(zip(names, map(float, angles), strict=True))

    def replace_by_turns(self, joint: Joint, axes: str, names: Sequence[str]) -> None:
        """Replace a joint by hinges called `names` about `axes`, letters of x, y, z.

        The first hinge has the placement of the joint. Massless links stand between the hinges.

        Raises:
            RobotFileError: the name of a hinge, or of the link behind it, is taken.
        """
        for name in names:
            if name in self._taken or f"{name}_link" in self._taken:
                raise RobotFileError(f"joint {joint.name!r}: needs the name {name!r}, taken in the URDF")
        motions = [
            Joint(name, "continuous", axis=unit_vector(axis), dynamics=joint.dynamics)
            for name, axis in zip(names, axes, strict=True)
        ]
        motions[0] = replace(motions[0], origin=joint.origin)
        del self.joints[joint.name]
        add_chain(self, joint.parent, motions, joint.child, np.eye(4), self._taken)
        self._taken.update(names)

    def fix_coupled_joints(self) -> None:
        """Fix joints that couplings determine from fixed joints, and substitute these in the couplings."""
        imposed: dict[str, float] | None = None
        while imposed or imposed is None:
            self.couplings, imposed = lock_couplings(self.couplings, self.fixed_positions)
            for name, position in imposed.items():
                self.fix(self.joints[name], position)
        moving = {joint.name for joint in self.joints.values() if joint.moves}
        self.couplings = [coupling for coupling in self.couplings if moving.issuperset(coupling.joints)]

    def equate(
        self,
        name: str,
        arms: Mapping[str, float],
        offset: float,
        links: tuple[str, str],
        *,
        products: Polynomial | None = None,
    ) -> bool:
        """Add the loop equation sum(arm q) + products = offset of joints; return whether this is possible.

        An equation that says that two links turn equally becomes a closure, which all proofs support. Any
        other equation of one joint fixes the joint, one of more joints becomes a coupling.

        Args:
            name: of the equation.
            arms: factor of each joint's coordinate; zeros have no effect.
            offset: [rad or m].
            links: the two links that may turn equally.
            products: coefficients of products of joints' coordinates.
        """
        arms = {joint: arm for joint, arm in arms.items() if arm}
        equation = {(joint,): arm for joint, arm in arms.items()} | {(): -offset} | dict(products or {})
        only_first, only_second = self.moving_chains(*links)
        joints = only_first + only_second
        # arms of the difference between the turns of both links
        arms_of_turn = {joint.name: 1.0 if joint in only_first else -1.0 for joint in joints}
        are_equal_turns = len(arms) > 1 and offset == 0.0 and arms == arms_of_turn and not products
        if are_equal_turns and self._are_parallel_hinges(joints):
            # each link gets a frame that is parallel to the base at zero joint positions. Equal turns keep
            # both parallel: the closure locks their relative turn about the axis, which becomes their z axis
            ends = []
            for suffix, link in zip(("first", "second"), links, strict=True):
                axes_of_base = self.zero_pose(link)[:3, :3].T  # in the link
                ends.append((suffix, link, placement(axes_of_base)))
            self.close(name, ("rz",), ends, [self._turning_axis(joints[0])])
            return True
        coupled = {joint for product in equation for joint in product}
        if any(self.joints[joint].kind in COORDINATE_SUFFIXES for joint in coupled):
            return False
        if len(coupled) == 1 and not products:
            ((joint, arm),) = arms.items()
            self.fix(self.joints[joint], offset / arm)
            return True
        coupling = Coupling.solve_equation(equation, [coupling.joint for coupling in self.couplings])
        self.couplings += [coupling] if coupling else []
        return coupling is not None

    def _turning_axis(self, joint: Joint) -> Array:
        """Return the unit axis (3,) of a hinge in the base at zero joint positions."""
        axis = self.zero_pose(joint.child)[:3, :3] @ joint.axis
        return axis / np.linalg.norm(axis)

    def _are_parallel_hinges(self, joints: Sequence[Joint]) -> bool:
        """Return whether joints are hinges about parallel axes, so that turns are sums of their angles.

        Hinges about opposite axes count as not parallel.
        """
        if any(joint.kind in ("prismatic", *COORDINATE_SUFFIXES) for joint in joints):
            return False
        axes = np.array([self._turning_axis(joint) for joint in joints])
        return bool(np.linalg.norm(axes - axes[0], axis=1).max() <= FILE_ROUNDING)
