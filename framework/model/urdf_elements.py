"""Locate a URDF; read and check its joints and links: names, numbers, tree.

Pinocchio's parser prints to the console and explains little, so this module finds the errors first. Messages
name the element (`where`); the caller prefixes the file.
"""

from __future__ import annotations

import math
import sysconfig
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from framework.errors import MissingPackage, RobotFileError, check_name
from framework.model.description import Coupling
from framework.model.documents import (
    attribute,
    child_element,
    parse_numbers,
    read_axis,
    read_link,
    read_number,
    read_origin,
    remove_children,
)
from framework.model.placement import unit_vector
from framework.numerics.arrays import Array, ArrayLike, Names
from framework.tolerances import INERTIA_ROUNDING, POINT_BODY_GYRATION

MOVING = ("revolute", "continuous", "prismatic")  # types of joints with one degree of freedom
# Types of joints with several degrees of freedom, with the suffixes of their coordinates: a translation [m]
# and a rotation vector, both on the axes of the joint's origin. URDF itself has no spherical joint; URDF+ and
# converters from SDF have one.
COORDINATE_SUFFIXES = {
    "spherical": ("_rx", "_ry", "_rz"),
    "floating": ("_x", "_y", "_z", "_rx", "_ry", "_rz"),
}
JOINT_TYPES = ("fixed", *MOVING, *COORDINATE_SUFFIXES)
ENDLESS = 1e9  # limit [rad, m, N m, N and per s] that no motion reaches
UNIVERSE = "universe"  # pinocchio's name of what does not move
MAX_TREE_ELEMENTS = 5000  # links or joints; no robot has more
MAX_TREE_DEPTH = 1000  # joints from the root to a link: pinocchio's parser recurses once for each
PACKAGE = "package://"
INERTIA_ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # attributes of an inertia
# primitive shapes, with the attributes (in SDF the children) that have their sizes
SIZES_OF_SHAPES = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
JointValues = dict[str, dict[str, float]]  # for each coordinate, values of fields of JointDynamics
Complaints = list[tuple[str, str]]  # the name of a link or joint, and what is impossible about it


@dataclass(eq=False)
class Joint:
    """A joint of the tree, with its XML element.

    Readers of other dialects change joints; then they change the element, too.
    """

    element: Element
    name: str
    kind: str  # one of JOINT_TYPES
    parent: str  # link
    child: str  # link
    origin: Array  # (4, 4) placement in the parent link at position zero
    axis: Array  # (3,) in the joint's frame, of any length; x where the joint has no axis

    @property
    def moves(self) -> bool:
        """Whether the joint is not fixed."""
        return self.kind != "fixed"

    @property
    def coordinates(self) -> Names:
        """Names of the joint's coordinates: its own name, or one for each freedom."""
        return coordinates_of(self.name, self.kind)


@dataclass
class Tree:
    """Links and joints of a URDF by name, in the order of the file."""

    links: list[str]
    joints: dict[str, Joint]
    base: str  # the root link

    def __post_init__(self) -> None:
        """Find the joint that carries each link, the root aside."""
        self.parent_joint = {joint.child: joint for joint in self.joints.values()}

    @property
    def frames(self) -> list[str]:
        """Names of all frames."""
        return [*self.links, *self.joints]

    @property
    def movable(self) -> list[str]:
        """Names of the joints with one degree of freedom, which a motor can drive."""
        return [joint.name for joint in self.joints.values() if joint.kind in MOVING]

    @property
    def coordinates(self) -> list[str]:
        """Names of the coordinates of all joints."""
        return [name for joint in self.joints.values() for name in joint.coordinates]

    def link_of(self, frame: str) -> str:
        """Return the link that carries a frame."""
        return frame if frame in self.links else self.joints[frame].child

    def body(self, frame: str) -> str:
        """Return the link that is nearest to the root on a frame's rigid body."""
        link = self.link_of(frame)
        while link in self.parent_joint and not self.parent_joint[link].moves:
            link = self.parent_joint[link].parent
        return link


def locate_urdf(folder: Path, reference: str) -> Path:
    """Return the file that `reference` means in a robot file in `folder`.

    A path is relative to the folder. package://NAME/REST means share/NAME/REST in the files of the Python
    distribution NAME or, failing that, under the prefix of this interpreter, where conda installs.

    Args:
        folder: of the robot file.
        reference: path, or package://NAME/REST.

    Raises:
        MissingPackage: NAME is not installed.
        RobotFileError: NAME is installed and has no such file, or the reference names no file.
    """
    if not reference.startswith(PACKAGE):
        return folder / reference
    from importlib.metadata import PackageNotFoundError, files  # takes time to import

    package, _, rest = reference.removeprefix(PACKAGE).partition("/")
    if not package or not rest:
        raise RobotFileError(f"urdf: needs {PACKAGE}NAME/FILE, got {reference!r}")
    shared = f"share/{package}/{rest}"
    prefix = Path(sysconfig.get_path("data"))
    try:
        installed = files(package) or []  # all files of the distribution, if it lists them
    except PackageNotFoundError:
        installed = None  # no distribution of this name
    for file in installed or ():
        if f"/{file.as_posix()}".endswith(f"/{shared}"):
            return Path(str(file.locate()))
    if (prefix / shared).is_file():
        return prefix / shared
    if installed is None and not (prefix / "share" / package).is_dir():
        raise MissingPackage(
            f"urdf: {reference} is in the package {package}, which is not installed: pip install {package}",
            package=package,
        )
    raise RobotFileError(f"urdf: the package {package} has no file {shared}")


def coordinates_of(name: str, kind: str) -> Names:
    """Return the names of the coordinates of a joint of a `kind` (JOINT_TYPES), one for each freedom."""
    suffixes = COORDINATE_SUFFIXES | dict.fromkeys(MOVING, ("",))
    return tuple(f"{name}{suffix}" for suffix in suffixes.get(kind, ()))


def read_tree(root: Element, impossible: Complaints | None = None) -> Tree:
    """Read and check the links and joints below `<robot>`.

    Impossible inertias of links and impossible limits of joints are errors. With a list `impossible` they are
    removed from `root` instead, and the list receives the name of the link or joint and the complaint.

    Raises:
        RobotFileError: the elements are not a tree of known joints and possible bodies, or are too many.
    """
    if root.tag != "robot":
        raise RobotFileError(f"<{root.tag}>: not a URDF, whose root is <robot>")
    links = unique_names(root, "link")
    count = max(len(links), len(unique_names(root, "joint")))
    if count > MAX_TREE_ELEMENTS:
        raise RobotFileError(f"<robot>: {count} links or joints; at most {MAX_TREE_ELEMENTS} are read")

    link_names = set(links)
    all_joints = [read_joint(element, link_names, impossible) for element in root.findall("joint")]
    joints = {joint.name: joint for joint in all_joints}
    for joint in all_joints:
        for coordinate in joint.coordinates:
            if coordinate in joints and coordinate != joint.name:
                raise RobotFileError(
                    f"joint {joint.name!r}: its coordinate {coordinate!r} has the name of another joint"
                )

    extent = max((float(np.linalg.norm(joint.origin[:3, 3])) for joint in all_joints), default=0.0)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            read_origin(visual, f"link {link.get('name')!r}: <visual>")
        try:
            check_inertial(link, extent)
        except RobotFileError as error:
            if impossible is None:
                raise
            impossible.append((link.get("name", ""), str(error)))
            remove_children(link, "inertial")
    return Tree(links, joints, _find_root(links, joints))


def _find_root(links: list[str], joints: Mapping[str, Joint]) -> str:
    """Find the root of the tree of links; refuse joints that do not make a tree."""
    for joint in joints.values():
        if joint.child == joint.parent:
            raise RobotFileError(f"joint {joint.name!r}: joins {joint.child!r} with itself")
    parents: dict[str, str] = {}  # the parent link of each link
    for joint in joints.values():
        if joint.child in parents:
            raise RobotFileError(
                f"link {joint.child!r} has two parents; a URDF is a tree: cut the loop there and declare it "
                f"(in a robot file under closures)"
            )
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        raise RobotFileError(f"needs exactly one root link, got {', '.join(roots[:5]) or 'none'}")
    (root,) = roots
    for link in links:
        depth = 0
        ancestor = link
        while ancestor in parents:
            depth += 1
            ancestor = parents[ancestor]
            if depth > len(parents):
                raise RobotFileError(f"link {link!r} hangs in a circle of joints without a root")
        if depth > MAX_TREE_DEPTH:
            raise RobotFileError(f"<robot>: more than {MAX_TREE_DEPTH} joints in a row")
    return root


def unique_names(root: Element, tag: str) -> list[str]:
    """Return the names of the elements with a tag; refuse missing and repeated names."""
    names = [attribute(element, f"<{tag}>", "name") for element in root.findall(tag)]
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        raise RobotFileError(f"duplicate {tag} {repeated[0]!r}")
    return names


def read_joint(element: Element, links: set[str], impossible: Complaints | None = None) -> Joint:
    """Read and check a joint between two links; remove children that mean nothing for its type.

    Args:
        element: the `<joint>`.
        links: names of all links.
        impossible: receives the joint's name and the complaint about an impossible limit, which is removed.

    Raises:
        RobotFileError: a part is missing, malformed or of no known type; the limit is impossible, and there
            is no list `impossible`.
    """
    name = str(element.get("name"))
    where = f"joint {name!r}"
    kind = attribute(element, where, "type")
    check_name(where, "type", kind, JOINT_TYPES)
    if name == UNIVERSE and kind in MOVING:
        raise RobotFileError(f"{where}: pinocchio gives this name to what does not move; rename the joint")
    parent = read_link(element, where, "parent", links)
    child = read_link(element, where, "child", links)

    axis = element.find("axis")
    direction = unit_vector("x")
    if kind not in MOVING:
        remove_children(element, "axis")  # it has no meaning, and some exporters write 0 0 0
    elif axis is not None:
        direction = read_axis(axis, f"{where}: <axis>")
    try:
        if kind in MOVING:
            _check_limit(element, where, is_needed=kind != "continuous")
    except RobotFileError as error:
        if impossible is None:
            raise
        impossible.append((name, str(error)))
        remove_children(element, "limit")
        add_endless_limit(element)
    element.attrib.pop("independent", None)  # a hint of URDF+, which its reader has read already
    origin = read_origin(element, where)
    return Joint(element, name, kind, parent, child, origin, direction)


def add_endless_limit(joint: Element) -> Element:
    """Add a `<limit>` that no motion reaches; return the element."""
    upper = f"{ENDLESS:g}"
    return SubElement(joint, "limit", lower=f"-{upper}", upper=upper, effort=upper, velocity=upper)


def parse_limit(where: str, text: str) -> float:
    """Parse a limit; infinite and huge ones, such as 1.8e308, become `ENDLESS`."""
    text = text.lower().replace("infinity", "inf").replace("inf", f"{ENDLESS:g}")
    (number,) = parse_numbers(where, text, 1, largest=math.inf)
    return math.copysign(min(abs(number), ENDLESS), number)


def _check_limit(joint: Element, where: str, *, is_needed: bool) -> None:
    """Refuse a joint's <limit> without numbers; write `ENDLESS` for larger ones.

    With `is_needed`, missing keys, limits in the wrong order and negative efforts or speeds are refused, too.
    """
    limit = child_element(joint, where, "limit") if is_needed else joint.find("limit")
    if limit is None:
        return
    if is_needed:
        for key in ("effort", "velocity"):
            attribute(limit, f"{where}: <limit>", key)
    numbers: list[float] = []
    for key in ("lower", "upper", "effort", "velocity"):
        number = parse_limit(f"{where}: <limit> {key}", limit.get(key, "0"))
        numbers.append(number)
        if abs(number) == ENDLESS:
            limit.set(key, f"{number:g}")
    lower, upper, effort, velocity = numbers
    if is_needed and (lower > upper or effort < 0 or velocity < 0):
        raise RobotFileError(
            f"{where}: <limit>: needs lower <= upper, effort and velocity of at least zero, got lower "
            f"{lower:g}, upper {upper:g}, effort {effort:g}, velocity {velocity:g}"
        )


def check_inertial(link: Element, extent: float) -> None:
    """Refuse a link's inertia that no body can have.

    `extent` [m] is the length of the longest joint offset in the robot. It tells which inertias are
    negligible: those of bodies that are a point with respect to the robot.

    Raises:
        RobotFileError: the mass or a principal moment is negative, one moment exceeds the sum of the others,
            or a part is missing or malformed.
    """
    where = f"link {link.get('name')!r}"
    inertial = link.find("inertial")
    if inertial is None:
        return
    read_origin(inertial, f"{where}: <inertial>")
    mass = read_number(child_element(inertial, f"{where}: <inertial>", "mass"), f"{where}: <mass>", "value")
    if mass < 0:
        raise RobotFileError(f"{where}: <mass>: must not be negative, got {mass:g}")
    inertia = child_element(inertial, f"{where}: <inertial>", "inertia")
    values = [read_number(inertia, f"{where}: <inertia>", key) for key in INERTIA_ENTRIES]
    negligible = mass * (POINT_BODY_GYRATION * extent) ** 2
    check_inertia(f"{where}: <inertia>", symmetric_matrix(*values), negligible=negligible)


def symmetric_matrix(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the symmetric matrix (3, 3) with six entries in the order of INERTIA_ENTRIES."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def check_inertia(where: str, matrix: ArrayLike, *, negligible: float = 0.0) -> None:
    """Refuse an inertia (3, 3) [kg m^2] that no body can have.

    The inertia about the centre of mass is the integral of (r.r 1 - r r') dm over the body. Its principal
    moments are I1 = b + c, I2 = a + c, I3 = a + b, where a, b, c >= 0 are the second moments of mass along
    the principal axes. Hence no moment is negative, and none exceeds the sum of the other two (Wensing, Kim
    and Slotine, IEEE Robotics and Automation Letters 3(1), 2018). A negative moment would also make kinetic
    energy negative.

    Args:
        matrix: (3, 3) [kg m^2] about the centre of mass, symmetric, finite.
        negligible: [kg m^2] an inertia without a larger entry is that of a point and is not checked.

    Raises:
        RobotFileError: a principal moment is negative, or exceeds the sum of the other two.
    """
    entries = np.asarray(matrix, dtype=float)
    largest_entry = float(np.abs(entries).max())
    if largest_entry <= negligible:
        return
    moments = np.linalg.eigvalsh(entries / largest_entry)  # (3,) ascending; scaled against overflow
    least, middle, largest = moments
    rounding = INERTIA_ROUNDING * float(np.abs(moments).max())
    if least < -rounding or largest - middle - least > rounding:
        with np.errstate(over="ignore"):
            shown = ", ".join(f"{moment:.4g}" for moment in largest_entry * moments)
        raise RobotFileError(
            f"{where}: has the principal moments {shown} kg m^2, as no body has: none may be negative, none "
            f"above the sum of the other two"
        )


def declared_dynamics(root: Element) -> JointValues:
    """Return positive damping and dry friction of <dynamics>, by coordinate.

    Raises:
        RobotFileError: a value is negative or malformed.
    """
    declared = {}
    for joint in root.findall("joint[dynamics]"):
        name = joint.get("name", "")
        coordinates = coordinates_of(name, joint.get("type", ""))
        if not coordinates:
            continue
        where = f"joint {name!r}: <dynamics>"
        element = child_element(joint, "", "dynamics")
        values = {}
        for key in ("damping", "friction"):
            value = read_number(element, where, key, "0")
            if value < 0:
                raise RobotFileError(f"{where} {key}: must not be negative, got {value:g}")
            if value:
                values[key] = value
        if values:
            declared.update(dict.fromkeys(coordinates, values))
    return declared


def declared_couplings(root: Element, locked: Iterable[str] = ()) -> list[Coupling]:
    """Remove each <mimic> from a URDF; return the couplings.

    A <mimic> is q = multiplier q_leader + offset. The leader may be one of the `locked` joints.

    Raises:
        RobotFileError: the leader is not a joint that can move, or a number is malformed.
    """
    movable = [joint.get("name", "") for joint in root.findall("joint") if joint.get("type") in MOVING]
    couplings = []
    for joint in root.findall("joint[mimic]"):
        name = joint.get("name", "")
        mimic = child_element(joint, "", "mimic")
        joint.remove(mimic)
        if name not in movable:
            continue  # fixed joints follow no other
        where = f"joint {name!r}: <mimic>"
        leader = mimic.get("joint", "")
        check_name(where, "movable joint", leader, {*movable, *locked} - {name})
        ratio = read_number(mimic, where, "multiplier", "1")
        offset = read_number(mimic, where, "offset", "0")
        couplings.append(Coupling(name, leader, ratio, offset))
    return couplings


def local_name(tag: str) -> str:
    """Return a tag without its namespace."""
    return tag.rsplit("}", 1)[-1]
