"""Platform, axes, motors and reference that a foreign file leaves out: the user states or confirms these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from framework.errors import RobotFileError, check_name, check_unique, short
from framework.model.description import AXES, Actuator, Platform, RobotDescription
from framework.model.readers.urdf_tree import UrdfTree

_MAX_LISTED_NAMES = 24


class Known(NamedTuple):
    """Content of a file, perhaps without platform and motors, with remarks on what is added."""

    tree: UrdfTree
    description: RobotDescription  # its platform is the base on no axes, its motors those of the file
    platform: Platform | None = None
    likely_motors: tuple[str, ...] = ()
    chooses_motors: bool = False  # where the file has more than the mechanism needs
    remarks: tuple[str, ...] = ()

    def with_platform(self, platform: Platform, *remarks: str) -> Known:
        """Return the content with a platform in its description, and further remarks."""
        description = replace(self.description, platform=platform)
        return self._replace(description=description, remarks=(*self.remarks, *remarks))


@dataclass(frozen=True)
class Options:
    """The options beside the file; None means the file's value.

    `reference` [rad, m] goes by the names of joints, of a ball J by J_rx, J_ry, J_rz (a rotation vector); a
    foreign file's zero pose is the reference unless it says something else. `locked` [rad, m] holds joints,
    at the reference if the value is None. `propose` completes the rest.
    """

    platform: str | None = None
    axes: tuple[str, ...] | None = None
    motors: tuple[str, ...] | None = None
    reference: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None  # a link: what it does not carry is locked
    locked: Mapping[str, float | None] = field(default_factory=dict)
    platform_joints: tuple[str, ...] | None = None
    propose: Propose | None = None

    @property
    def is_silent(self) -> bool:
        """Whether the options leave platform and motors open."""
        return not (self.platform or self.axes or self.platform_joints or self.motors)


Propose = Callable[[Options, Known], Known]


def complete(options: Options, known: Known) -> Known:
    """Complete the content of a file by the options, else the file, else proposals.

    Raises:
        RobotFileError: something is said nowhere (names the options and the candidates), or an
            option is not valid.
    """
    joints, description = known.tree.movable, known.description
    if options.motors is not None:
        motors = _actuators(options.motors, joints, description.actuators)
        description = replace(description, actuators=motors)
    platform = _platform(options, known)
    known = known._replace(description=description, platform=platform)
    if options.propose is not None:
        return options.propose(options, known)
    if platform is not None and description.actuators:
        return known.with_platform(platform)
    missing = []
    if platform is None and options.platform is None:
        missing.append(f"--platform FRAME (of: {_few(known.tree.frames)})")
    if platform is None and options.axes is None:
        missing.append(f"--axes (of: {', '.join(AXES)})")
    if not description.actuators:
        missing.append(f"--motors (of: {_few(known.likely_motors or joints)})")
    raise RobotFileError(
        f"the file does not say: give {'; '.join(missing)}; or let `crossing convert` propose them"
    )


def _platform(options: Options, known: Known) -> Platform | None:
    """Return the platform by options and file; None where both leave something open."""
    frame, platform, joints = options.platform, known.platform, options.platform_joints
    if frame is not None:
        check_name("--platform", "frame", frame, known.tree.frames)
    if joints is not None:
        if options.axes is not None:
            raise RobotFileError("--platform-joints: the platform has joints or --axes, not both")
        _check_axes("--platform-joints", "movable joint", joints, known.tree.movable)
        return Platform(frame or known.tree.joints[joints[-1]].child, (), joints)
    if options.axes is not None:
        _check_axes("--axes", "axis", options.axes, AXES)
        frame = frame or (platform.frame if platform else None)
        return None if frame is None else Platform(frame, options.axes)
    return platform if platform is None or frame is None else replace(platform, frame=frame)


def _check_axes(option: str, kind: str, names: Sequence[str], valid: Sequence[str]) -> None:
    for name in names:
        check_name(option, kind, name, valid)
    if len(set(names)) < len(names):
        plural = "axes" if kind == "axis" else "joints"
        raise RobotFileError(f"{option}: needs different {plural}, got {' '.join(names)}")


def _actuators(
    motors: Sequence[str], joints: Sequence[str], known: Sequence[Actuator]
) -> tuple[Actuator, ...]:
    """Return the motors of the options with their properties in the file."""
    by_joint = {actuator.joint: actuator for actuator in known}
    for name in motors:
        check_name("--motors", "movable joint", name, joints)
    check_unique("--motors", motors)
    if not motors:
        raise RobotFileError(f"--motors: needs at least one joint (valid: {_few(joints)})")
    return tuple(by_joint.get(name, Actuator(name)) for name in motors)


def checked_reference(
    options: Options, coordinates: Sequence[str], near: Mapping[str, float]
) -> dict[str, float]:
    """Return the file's reference, overridden by the options', of known `coordinates`."""
    for name in options.reference:
        check_name("--reference", "movable joint", name, coordinates)
    return {**near, **{name: float(value) for name, value in options.reference.items()}}


def _few(names: Sequence[str]) -> str:
    listed = ", ".join(names[:_MAX_LISTED_NAMES]) or "none"
    return listed + (f", and {len(names) - _MAX_LISTED_NAMES} more" if len(names) > _MAX_LISTED_NAMES else "")


def names_list(where: str, value: object) -> tuple[str, ...]:
    """Read a list of texts.

    Raises:
        RobotFileError: it is not.
    """
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise RobotFileError(f"{where}: needs a list of names, got {short(value)}")
    return tuple(value)
