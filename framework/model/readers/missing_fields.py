"""What a foreign file leaves out - platform, axes, motors, reference - and a person must say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from framework.errors import RobotFileError, choose_from, short
from framework.model.description import AXES, Actuator, Platform

_SHOWN = 24  # candidates named in a message


@dataclass(frozen=True)
class Options:
    """What was said beside the file; None is left to the file.

    `reference` [rad, m] goes by the names of joints, of a ball J by J_rx, J_ry, J_rz (a rotation vector); a
    foreign file's zero pose is the reference unless it says something else.
    """

    platform: str | None = None
    axes: tuple[str, ...] | None = None
    motors: tuple[str, ...] | None = None
    reference: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None  # a link: what it does not carry is locked


class Resolved(NamedTuple):
    """Platform and motors, from the options and else from the file."""

    platform: Platform
    actuators: tuple[Actuator, ...]


def resolve(
    options: Options,
    *,
    frames: Sequence[str],
    joints: Sequence[str],
    platform: Platform | None = None,
    actuators: Sequence[Actuator] = (),
    likely_motors: Sequence[str] = (),
) -> Resolved:
    """What the options say, else the file; `frames` and movable `joints` are the valid names.

    Raises:
        RobotFileError: something is said nowhere (names the options and the candidates), or an
            option is not valid.
    """
    frame = options.platform or (platform.frame if platform else None)
    joint_coordinates = platform.joints if platform and not options.axes else ()
    axes = options.axes or (platform.axes if platform else None)
    missing = []
    if frame is None:
        missing.append(f"--platform FRAME (of: {_few(frames)})")
    if axes is None:
        missing.append(f"--axes (of: {', '.join(AXES)})")
    if options.motors is None and not actuators:
        missing.append(f"--motors (of: {_few(likely_motors or joints)})")
    if frame is None or axes is None or missing:
        raise RobotFileError(f"the file does not say: give {'; '.join(missing)}")
    if frame not in frames:
        raise RobotFileError(f"--platform: {choose_from('frame', frame, frames)}")
    for axis in axes:
        if axis not in AXES:
            raise RobotFileError(f"--axes: {choose_from('axis', axis, AXES)}")
    if len(set(axes)) < len(axes):
        raise RobotFileError(f"--axes: needs different axes, got {' '.join(axes)}")
    return Resolved(Platform(frame, axes, joint_coordinates), _actuators(options.motors, joints, actuators))


def _actuators(
    motors: Sequence[str] | None, joints: Sequence[str], known: Sequence[Actuator]
) -> tuple[Actuator, ...]:
    """The motors of the file, or those of the options with what the file knows of them."""
    if motors is None:
        return tuple(known)
    by_joint = {actuator.joint: actuator for actuator in known}
    for name in motors:
        if name not in joints:
            raise RobotFileError(f"--motors: {choose_from('movable joint', name, joints)}")
        if list(motors).count(name) > 1:
            raise RobotFileError(f"--motors: duplicate {name!r}")
    if not motors:
        raise RobotFileError(f"--motors: needs at least one joint (valid: {_few(joints)})")
    return tuple(by_joint.get(name, Actuator(name)) for name in motors)


def checked_reference(
    options: Options, coordinates: Sequence[str], found: Mapping[str, float]
) -> dict[str, float]:
    """The reference of the file with that of the options over it; `coordinates` are those of all joints."""
    for name in options.reference:
        if name not in coordinates:
            raise RobotFileError(f"--reference: {choose_from('movable joint', name, coordinates)}")
    return {**found, **{name: float(value) for name, value in options.reference.items()}}


def _few(names: Sequence[str]) -> str:
    listed = ", ".join(names[:_SHOWN]) or "none"
    return listed + (f", and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


def names_list(where: str, value: object) -> tuple[str, ...]:
    """A list of texts.

    Raises:
        RobotFileError: it is not.
    """
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise RobotFileError(f"{where}: needs a list of names, got {short(value)}")
    return tuple(value)
