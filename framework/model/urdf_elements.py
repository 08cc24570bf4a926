"""Locate a URDF; read and check its joints and links: names, numbers, tree.

Readers, springs and pinocchio's model work on `Tree`; XML is read here and written by `urdf_edits.urdf_text`.
Messages name the element (`where`); the caller prefixes the file.
"""

from __future__ import annotations

import math
import sysconfig
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple
from warnings import warn
from xml.etree.ElementTree import Element, fromstring

import numpy as np

from framework.errors import MissingPackage, RobotFileError, check_name
from framework.model.description import Coupling, JointDynamics, RobotDescription
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
MAX_TREE_DEPTH = 1000  # joints from the root to a link; no robot has more
PACKAGE = "package://"
INERTIA_ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # attributes of an inertia
# primitive shapes, with the attributes (in SDF the children) that have their sizes
SIZES_OF_SHAPES = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
Complaints = list[tuple[str, str]]  # the name of a link or joint, and what is impossible about it


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the tree between two links."""

    name: str
    kind: str  # one of JOINT_TYPES
    origin: Array = field(default_factory=lambda: np.eye(4))  # (4, 4) placement in the parent link at zero
    axis: Array = field(default_factory=lambda: unit_vector("x"))  # (3,) in the joint's frame, of any length
    limits: tuple[float, float] | None = None  # lower and upper [rad, m]
    parent: str = ""  # link
    child: str = ""  # link
    effort: float = ENDLESS  # largest [N m, N], and the largest speed [per s]; neither is a limit of a motor
    speed: float = ENDLESS
    dynamics: JointDynamics = field(default_factory=JointDynamics)  # along each coordinate
    mimic: Coupling | None = None  # of a joint of one freedom
    element: Element | None = (
        None  # of the file, which is written instead of the fields; None if these differ
    )

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
    """Links and joints by name, in the order of the file; readers and springs add and replace joints."""

    name: str
    links: dict[str, Element]  # of the URDF, with inertia and shapes
    joints: dict[str, Joint] = field(default_factory=dict)
    others: Sequence[Element] = ()  # materials, and what other programs read

    def __post_init__(self) -> None:
        """Find the joint that carries each link, the root aside."""
        self.parent_joint = {joint.child: joint for joint in self.joints.values()}

    @property
    def base(self) -> str:
        """The root link."""
        return next(link for link in self.links if link not in self.parent_joint)

    def put(self, *joints: Joint) -> None:
        """Add joints and their child links, or replace joints of the same names."""
        for joint in joints:
            self.joints[joint.name] = joint
            self.parent_joint[joint.child] = joint
            self.links.setdefault(joint.child, Element("link", name=joint.child))

    def copy(self) -> Tree:
        """Return a copy with the same elements, whose links and joints can be replaced."""
        return Tree(self.name, dict(self.links), dict(self.joints), self.others)

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

    def path_to_base(self, link: str) -> list[Joint]:
        """Return the joints from a link to the base, the link's own first."""
        path = []
        while joint := self.parent_joint.get(link):
            path.append(joint)
            link = joint.parent
        return path

    def zero_pose(self, link: str) -> Array:
        """Compute the placement (4, 4) of a link in the base, all joints at zero."""
        matrix = np.eye(4)
        for joint in self.path_to_base(link):
            matrix = joint.origin @ matrix
        return matrix

    def moving_chains(self, first: str, second: str) -> tuple[list[Joint], list[Joint]]:
        """Return the moving joints that carry only the first link, and only the second.

        Each list leads from its link towards the base.
        """
        path = self.path_to_base(first)
        other_path = self.path_to_base(second)
        only_first = [joint for joint in path if joint.moves and joint not in other_path]
        only_second = [joint for joint in other_path if joint.moves and joint not in path]
        return only_first, only_second


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


class ParsedRobot(NamedTuple):
    """The content of a file of any dialect.

    `tree` is that of `description.urdf_text`; no reader of the record may change it. `dialect` is one of
    `readers.recognise.DIALECTS`. `remarks` report proposals for a foreign file. `stated` are positions
    [rad, m] that the file or its reader's options give as reference; other coordinates are 0.
    """

    description: RobotDescription
    tree: Tree
    dialect: str = "robot file"
    remarks: tuple[str, ...] = ()
    stated: Mapping[str, float] | None = None
    joint_order: Names = ()  # of pinocchio's joints; by default that of its parser

    @property
    def urdf(self) -> Element:
        """Deprecated: the root of the URDF's XML; see `tree`."""
        warn("ParsedRobot.urdf goes in 0.9: see tree", DeprecationWarning, stacklevel=2)
        return fromstring(self.description.urdf_text)


def read_tree(root: Element, impossible: Complaints | None = None) -> Tree:
    """Read and check the links and joints below `<robot>`.

    With a list `impossible`, impossible inertias and limits are removed instead of refused, see `check_tree`.

    Raises:
        RobotFileError: the elements are not a tree of known joints and possible bodies, or are too many.
    """
    if root.tag != "robot":
        raise RobotFileError(f"<{root.tag}>: not a URDF, whose root is <robot>")
    links, joints = (_unique_elements(root, tag) for tag in ("link", "joint"))
    count = max(len(links), len(joints))
    if count > MAX_TREE_ELEMENTS:
        raise RobotFileError(f"<robot>: {count} links or joints; at most {MAX_TREE_ELEMENTS} are read")
    others = [element for element in root if element.tag not in ("link", "joint")]
    tree = Tree(root.get("name", ""), links, {}, others)
    for element in joints.values():
        tree.put(_read_joint(element, links, impossible))
    check_tree(tree, impossible)
    return tree


def check_tree(tree: Tree, impossible: Complaints | None = None) -> None:
    """Refuse links and joints that are no tree of possible bodies.

    With a list `impossible`, an impossible inertia is removed, and the list receives the name of the link and
    the complaint.

    Raises:
        RobotFileError: what is wrong, with the name of the link or joint.
    """
    for joint in tree.joints.values():
        if joint.name == UNIVERSE and joint.kind in MOVING:
            raise RobotFileError(
                f"joint {joint.name!r}: pinocchio gives this name to what does not move; rename the joint"
            )
        for coordinate in joint.coordinates:
            if coordinate in tree.joints and coordinate != joint.name:
                raise RobotFileError(
                    f"joint {joint.name!r}: its coordinate {coordinate!r} has the name of another joint"
                )
    _check_root(tree)
    extent = max((float(np.linalg.norm(joint.origin[:3, 3])) for joint in tree.joints.values()), default=0.0)
    for name, link in tree.links.items():
        for visual in link.findall("visual"):
            read_origin(visual, f"link {name!r}: <visual>")
        try:
            check_inertial(link, extent)
        except RobotFileError as error:
            if impossible is None:
                raise
            impossible.append((name, str(error)))
            remove_children(link, "inertial")


def _check_root(tree: Tree) -> None:
    """Refuse joints that do not make a tree with one root."""
    parents: dict[str, str] = {}  # the parent link of each link
    for joint in tree.joints.values():
        if joint.child == joint.parent:
            raise RobotFileError(f"joint {joint.name!r}: joins {joint.child!r} with itself")
        if joint.child in parents:
            raise RobotFileError(
                f"link {joint.child!r} has two parents; a URDF is a tree: cut the loop there and declare it "
                f"(in a robot file under closures)"
            )
        parents[joint.child] = joint.parent
    roots = [link for link in tree.links if link not in parents]
    if len(roots) != 1:
        raise RobotFileError(f"needs exactly one root link, got {', '.join(roots[:5]) or 'none'}")
    for link in tree.links:
        depth = 0
        ancestor = link
        while ancestor in parents:
            depth += 1
            ancestor = parents[ancestor]
            if depth > len(parents):
                raise RobotFileError(f"link {link!r} hangs in a circle of joints without a root")
        if depth > MAX_TREE_DEPTH:
            raise RobotFileError(f"<robot>: more than {MAX_TREE_DEPTH} joints in a row")


def _unique_elements(root: Element, tag: str) -> dict[str, Element]:
    """Return the elements with a tag by name; refuse missing and repeated names."""
    elements: dict[str, Element] = {}
    for element in root.findall(tag):
        name = attribute(element, f"<{tag}>", "name")
        if name in elements:
            raise RobotFileError(f"duplicate {tag} {name!r}")
        elements[name] = element
    return elements


def _read_joint(element: Element, links: Collection[str], impossible: Complaints | None) -> Joint:
    """Read a joint between two of the `links`; refuse or collect an impossible limit.

    Raises:
        RobotFileError: a part is missing, malformed or of no known type; the limit is impossible, and there
            is no list `impossible`.
    """
    name = str(element.get("name"))
    where = f"joint {name!r}"
    kind = attribute(element, where, "type")
    check_name(where, "type", kind, JOINT_TYPES)
    parent, child = (read_link(element, where, end, links) for end in ("parent", "child"))
    origin = read_origin(element, where)
    joint = Joint(name, kind, origin, parent=parent, child=child, element=element)
    if not joint.moves:
        return joint
    joint = replace(joint, dynamics=_read_dynamics(element, f"{where}: <dynamics>"))
    if kind not in MOVING:
        return joint
    axis, mimic = element.find("axis"), element.find("mimic")
    if axis is not None:
        joint = replace(joint, axis=read_axis(axis, f"{where}: <axis>"))
    if mimic is not None:
        end = f"{where}: <mimic>"
        ratio, offset = read_number(mimic, end, "multiplier", "1"), read_number(mimic, end, "offset", "0")
        joint = replace(joint, mimic=Coupling(name, mimic.get("joint", ""), ratio, offset))
    try:
        return replace(joint, **_read_limits(element, where, is_needed=kind != "continuous"))
    except RobotFileError as error:
        if impossible is None:
            raise
        impossible.append((name, str(error)))
        return replace(joint, element=None)


def _read_dynamics(joint: Element, where: str) -> JointDynamics:
    """Read damping and dry friction of a joint, zero by default; refuse negative values."""
    element = joint.find("dynamics")
    if element is None:
        return JointDynamics()
    values = {key: read_number(element, where, key, "0") for key in ("damping", "friction")}
    for key, value in values.items():
        if value < 0:
            raise RobotFileError(f"{where} {key}: must not be negative, got {value:g}")
    return JointDynamics(**values)


def parse_limit(where: str, text: str) -> float:
    """Parse a limit; infinite and huge ones, such as 1.8e308, become `ENDLESS`."""
    text = text.lower().replace("infinity", "inf").replace("inf", f"{ENDLESS:g}")
    (number,) = parse_numbers(where, text, 1, largest=math.inf)
    return math.copysign(min(abs(number), ENDLESS), number)


def _read_limits(joint: Element, where: str, *, is_needed: bool) -> dict[str, Any]:
    """Read the fields `limits`, `effort` and `speed` of a joint in its <limit>.

    Without `is_needed`, that of a continuous joint, the numbers must be numbers and have no effect.

    Raises:
        RobotFileError: a number is malformed or, where they are needed, a key is missing, limits are in the
            wrong order, or effort or speed is negative.
    """
    limit = child_element(joint, where, "limit") if is_needed else joint.find("limit")
    if limit is None:
        return {}
    if is_needed:
        for key in ("effort", "velocity"):
            attribute(limit, f"{where}: <limit>", key)
    lower, upper, effort, speed = (
        parse_limit(f"{where}: <limit> {key}", limit.get(key, "0"))
        for key in ("lower", "upper", "effort", "velocity")
    )
    if not is_needed:
        return {}
    if lower > upper or effort < 0 or speed < 0:
        raise RobotFileError(
            f"{where}: <limit>: needs lower <= upper, effort and velocity of at least zero, got lower "
            f"{lower:g}, upper {upper:g}, effort {effort:g}, velocity {speed:g}"
        )
    return {"limits": (lower, upper), "effort": effort, "speed": speed}


def check_inertial(link: Element, extent: float) -> None:
    """Refuse a link's inertia that no body can have.

    `extent` [m] is the length of the longest joint offset in the robot. It tells which inertias are
    negligible: those of bodies that are a point with respect to the robot.

    Raises:
        RobotFileError: the mass or a principal moment is negative, one moment exceeds the sum of the others,
            or a part is missing or malformed.
    """
    mass, _, inertia = read_inertial(link)
    where = f"link {link.get('name')!r}"
    if mass < 0:
        raise RobotFileError(f"{where}: <mass>: must not be negative, got {mass:g}")
    radius = POINT_BODY_GYRATION * extent
    negligible = mass * radius * radius  # a power overflows with an error
    check_inertia(f"{where}: <inertia>", inertia, negligible=negligible)


def read_inertial(link: Element) -> tuple[float, Array, Array]:
    """Read a link's mass [kg], inertial placement (4, 4) and inertia (3, 3) [kg m^2].

    The inertia is about the centre of mass, the origin of the placement, on its axes. Without an <inertial>
    mass and inertia are zero.

    Raises:
        RobotFileError: a part is missing or malformed.
    """
    where = f"link {link.get('name')!r}"
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.eye(4), np.zeros((3, 3))
    origin = read_origin(inertial, f"{where}: <inertial>")
    mass = read_number(child_element(inertial, f"{where}: <inertial>", "mass"), f"{where}: <mass>", "value")
    inertia = child_element(inertial, f"{where}: <inertial>", "inertia")
    values = [read_number(inertia, f"{where}: <inertia>", key) for key in INERTIA_ENTRIES]
    return mass, origin, symmetric_matrix(*values)


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
    if not largest_entry > negligible:  # also if 0 kg at infinity make it no number
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


def declared_dynamics(tree: Tree) -> dict[str, JointDynamics]:
    """Return the joint dynamics that are not zero, by coordinate."""
    joints = [joint for joint in tree.joints.values() if joint.dynamics != JointDynamics()]
    return {coordinate: joint.dynamics for joint in joints for coordinate in joint.coordinates}


def declared_couplings(tree: Tree, locked: Iterable[str] = ()) -> list[Coupling]:
    """Remove each <mimic>, and return its coupling q = multiplier q_leader + offset.

    The leader may be one of the `locked` joints.

    Raises:
        RobotFileError: the leader is not a joint that can move.
    """
    couplings = []
    for joint in tree.joints.values():
        if joint.element is not None:
            remove_children(joint.element, "mimic")
        if joint.mimic is not None and joint.kind in MOVING:
            leaders = {*tree.movable, *locked} - {joint.name}
            check_name(f"joint {joint.name!r}: <mimic>", "movable joint", joint.mimic.of, leaders)
            couplings.append(joint.mimic)
    return couplings


def local_name(tag: str) -> str:
    """Return a tag without its namespace."""
    return tag.rsplit("}", 1)[-1]
