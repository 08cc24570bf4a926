"""The URDF as far as this project judges it before pinocchio parses it: names, tree, numbers.

Pinocchio's parser prints to the console and tells little; what can be told better is told here.
"""

from __future__ import annotations

import math
import sysconfig
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from framework.errors import MissingPackage, RobotFileError, choose_from
from framework.model.description import LARGEST, SHORTEST
from framework.model.inertia import ENTRIES, check_inertia, symmetric

PACKAGE = "package://"
MOVING = ("revolute", "continuous", "prismatic")  # types of joints with one degree of freedom
JOINT_TYPES = ("fixed", *MOVING)
LARGEST_TREE = 5000  # links or joints; more is no robot
DEEPEST_TREE = 1000  # joints from the root to a link: pinocchio's parser calls itself once for each


@dataclass(frozen=True)
class Urdf:
    """Names in a URDF; a frame is a link or a joint."""

    links: list[str]
    joints: dict[str, str]  # type by name
    parents: dict[str, tuple[str, str]]  # (joint, parent link) by child link
    children: dict[str, str]  # child link by joint

    @property
    def names(self) -> list[str]:
        """Names of all frames."""
        return [*self.links, *self.joints]

    def body(self, frame: str) -> str:
        """The link nearest to the root that is rigidly connected to a frame: the name of its body."""
        link = frame if frame in self.links else self.children[frame]
        while link in self.parents and self.joints[self.parents[link][0]] == "fixed":
            link = self.parents[link][1]
        return link


def locate_urdf(folder: Path, reference: str) -> Path:
    """The file that a robot file in `folder` means by `urdf: reference`.

    A path is taken from the folder. package://NAME/REST is share/NAME/REST as the Python distribution NAME
    has installed it or, failing that, under the prefix of this interpreter (where conda puts it).

    Raises:
        MissingPackage: NAME is not installed.
        RobotFileError: it is installed and has no such file, or the reference names no file.
    """
    if not reference.startswith(PACKAGE):
        return folder / reference
    package, _, rest = reference.removeprefix(PACKAGE).partition("/")
    if not package or not rest:
        raise RobotFileError(f"urdf: needs {PACKAGE}NAME/FILE, got {reference!r}")
    shared = f"share/{package}/{rest}"
    beside = Path(sysconfig.get_path("data")) / shared
    try:
        installed = files(package) or []
    except PackageNotFoundError:
        installed = None
    for file in installed or ():
        if file.as_posix() == shared or file.as_posix().endswith(f"/{shared}"):
            return Path(str(file.locate()))
    if beside.is_file():
        return beside
    if installed is None and not (beside.parents[rest.count("/")]).is_dir():
        raise MissingPackage(
            f"urdf: {reference} is in the package {package}, which is not installed: pip install {package}",
            package=package,
        )
    raise RobotFileError(f"urdf: the package {package} has no file {shared}")


def check_urdf(path: Path, root: ElementTree.Element, locked: Collection[str] = ()) -> Urdf:
    """Names of a URDF, once it was judged; `path` is for messages.

    Joints named in `locked` may mimic others, for they are about to be fixed.

    Raises:
        RobotFileError: not a tree of known joint types, or a number that is none.
    """
    if root.tag != "robot":
        raise RobotFileError(f"urdf: {path} is not a URDF: its root is <{root.tag}>, not <robot>")
    found = {tag: root.findall(tag) for tag in ("link", "joint")}
    for tag, elements in found.items():
        if len(elements) > LARGEST_TREE:
            raise RobotFileError(f"urdf: {path}: {len(elements)} {tag}s; at most {LARGEST_TREE} are read")
        taken: set[str] = set()
        for name in (element.get("name", "") for element in elements):
            if not name or name in taken:
                raise RobotFileError(f"urdf: {path}: the {tag} name {name!r} is empty or there twice")
            taken.add(name)
    links = [link.get("name", "") for link in found["link"]]
    known = set(links)
    for link in found["link"]:
        _check_inertial(f"urdf: {path}: link {link.get('name')!r}", link)
    parents: dict[str, tuple[str, str]] = {}
    children: dict[str, str] = {}
    for joint in found["joint"]:
        name, where = joint.get("name", ""), f"urdf: {path}: joint {joint.get('name')!r}"
        parent, child = (_link_of(where, joint, end, known) for end in ("parent", "child"))
        if child in parents:
            raise RobotFileError(
                f"urdf: {path}: link {child!r} has two parents; a URDF is a tree: cut the loop and "
                f"declare it under closures"
            )
        parents[child], children[name] = (name, parent), child
        _check_joint(where, joint, locked=name in locked)
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        raise RobotFileError(f"urdf: {path}: needs exactly one root link, got {roots or 'none'}")
    depths = depths_below(roots[0], {child: parent for child, (_, parent) in parents.items()})
    hanging = known - depths.keys()
    if hanging:
        raise RobotFileError(
            f"urdf: {path}: links {', '.join(sorted(hanging))} hang from each other and not from the root "
            f"{roots[0]!r}: a URDF is a tree"
        )
    if max(depths.values()) > DEEPEST_TREE:
        raise RobotFileError(f"urdf: {path}: more than {DEEPEST_TREE} joints in a row")
    joints = {joint.get("name", ""): joint.get("type", "") for joint in found["joint"]}
    return Urdf(links, joints, parents, children)


def depths_below(root: str, parents: Mapping[str, str]) -> dict[str, int]:
    """How many joints lie between the root and each link that hangs from it, by the parent of each link."""
    children: dict[str, list[str]] = {}
    for child, parent in parents.items():
        children.setdefault(parent, []).append(child)
    depths, waiting = {root: 0}, [root]
    while waiting:
        link = waiting.pop()
        for child in children.get(link, []):
            depths[child] = depths[link] + 1
            waiting.append(child)
    return depths


def _link_of(where: str, joint: ElementTree.Element, end: str, links: set[str]) -> str:
    element = joint.find(end)
    link = element.get("link", "") if element is not None else ""
    if link not in links:
        raise RobotFileError(f"{where}: {end}: {choose_from('link', link, links)}")
    return link


def _check_joint(where: str, joint: ElementTree.Element, locked: bool) -> None:
    kind = joint.get("type")
    if kind not in JOINT_TYPES:
        raise RobotFileError(f"{where}: {choose_from('type', kind, JOINT_TYPES)}")
    if joint.find("mimic") is not None and not locked:
        raise RobotFileError(
            f"{where}: mimic joints are not supported; use a closure instead, or fix it under locked"
        )
    _check_origin(where, joint)
    axis = joint.find("axis")
    if axis is not None and kind != "fixed":
        direction = _vector(f"{where}: axis xyz", axis.get("xyz", "1 0 0"))
        if max(map(abs, direction)) < SHORTEST:
            raise RobotFileError(f"{where}: its axis is zero")
    limit = joint.find("limit")
    if kind in ("revolute", "prismatic"):
        if limit is None:
            raise RobotFileError(f"{where}: a {kind} joint needs a <limit> with effort and velocity")
        for key in ("effort", "velocity"):
            if limit.get(key) is None:
                raise RobotFileError(f"{where}: its <limit> lacks {key}")
    if limit is not None:
        for key, value in limit.attrib.items():
            _number(f"{where}: limit {key}", value, largest=math.inf)  # some files mean none by 1.8e308


def _check_inertial(where: str, link: ElementTree.Element) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    _check_origin(f"{where}: inertial", inertial)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise RobotFileError(f"{where}: its <inertial> needs both <mass> and <inertia>")
    kilograms = _number(f"{where}: mass", mass.get("value", ""))
    if kilograms < 0:
        raise RobotFileError(f"{where}: mass: must not be negative, got {mass.get('value')!r}")
    entries = [_number(f"{where}: inertia {key}", inertia.get(key, "")) for key in ENTRIES]
    check_inertia(f"{where}: inertia", symmetric(*entries), kilograms)


def _check_origin(where: str, element: ElementTree.Element) -> None:
    origin = element.find("origin")
    for key in ("xyz", "rpy"):
        if origin is not None and origin.get(key) is not None:
            _vector(f"{where}: origin {key}", origin.get(key, ""))


def _number(where: str, text: str, *, largest: float = LARGEST) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RobotFileError(f"{where}: needs a finite number, got {text!r}")
    if abs(value) > largest:
        raise RobotFileError(f"{where}: must be at most {largest:g} in size, got {text!r}")
    return value


def _vector(where: str, text: str) -> list[float]:
    parts = text.split()
    if len(parts) != 3:
        raise RobotFileError(f"{where}: needs three numbers, got {text!r}")
    return [_number(where, part) for part in parts]
