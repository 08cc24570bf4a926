"""Read a robot file (YAML beside its URDF) into frozen records, strictly.

Every complaint names the file and the key, says what was given and what is valid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from framework.errors import MissingPackage, RobotFileError, choose_from
from framework.model.additions import AddedFrame, add_frames, free_root, lock_joints
from framework.model.description import (
    AXES,
    Actuator,
    Closure,
    JointSpring,
    Platform,
    RobotDescription,
    Scene,
    Spring,
    locked_axes,
)
from framework.model.inertia import check_inertia
from framework.model.spring_joints import virtual_link
from framework.model.urdf import locate_urdf, parse_urdf, read_text

T = TypeVar("T")
VERSION = 1
PATH_KINDS = {"line": 2, "arc": 3, "spline": 2}  # least number of points


def read_robot_file(file: str | Path) -> RobotDescription:
    """The description in a robot file.

    Raises:
        RobotFileError: the file or its URDF is missing or malformed, or a key is unknown, missing,
            of the wrong type or length, not finite, or names something that the URDF does not have.
    """
    path = Path(file)
    text = read_text(path, f"{path}: cannot read the robot file")
    try:
        content = yaml.load(text, Loader=_StrictLoader)
    except yaml.YAMLError as error:
        raise RobotFileError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    try:
        return _description(path, _Mapping("", content))
    except MissingPackage as error:
        raise MissingPackage(f"{path}: {error}", package=error.package) from None
    except RobotFileError as error:
        raise RobotFileError(f"{path}: {error}") from None


def _description(path: Path, top: _Mapping) -> RobotDescription:
    version = top.required("version", _whole)
    if version != VERSION:
        raise RobotFileError(f"version: got {version}, this program reads version {VERSION}")
    urdf_path = locate_urdf(path.parent, top.required("urdf", _text))
    text = read_text(urdf_path, f"urdf: cannot read {urdf_path}")
    if top.has("locked"):
        locked = top.section("locked", _numbers_by_name)
        parse_urdf(urdf_path, text, locked)
        text = lock_joints(text, locked)
    if (
        top.optional("root", lambda at, value: _one_of("root", at, value, ("fixed", "free")), "fixed")
        == "free"
    ):
        parse_urdf(urdf_path, text)
        text = free_root(text)
    links = parse_urdf(urdf_path, text).links

    def added(entry: _Mapping) -> AddedFrame:
        return AddedFrame(
            name=entry.required("name", _text),
            parent=_one_of("link", f"{entry.where}parent", entry.required("parent", _any), links),
            xyz=entry.optional("xyz", _vector3, (0.0, 0.0, 0.0)),
            rpy=entry.optional("rpy", _vector3, (0.0, 0.0, 0.0)),
            mass=entry.optional("mass", _positive, 0.0),
            inertia=entry.optional("inertia", _moments, (0.0, 0.0, 0.0)) if entry.has("mass") else (0.0,) * 3,
        )

    urdf_text = add_frames(text, top.sections("frames", added) if top.has("frames") else ())
    urdf = parse_urdf(urdf_path, urdf_text)
    joints, frames = urdf.joints, urdf.names

    movable = {name: kind for name, kind in joints.items() if kind != "fixed"}

    def joint(where: str, value: Any) -> str:
        return _one_of("joint", where, value, joints)

    def frame(where: str, value: Any) -> str:
        """The link of a frame: a joint stands for its child, which moves when a spring behind it gives."""
        name = _one_of("frame", where, value, frames)
        return name if name in urdf.links else urdf.children[name]

    def platform(entry: _Mapping) -> Platform:
        axes = entry.required("axes", _axes)
        if sum(axis.startswith("r") for axis in axes) == 2:
            raise RobotFileError(
                f"{entry.where}axes: got {list(axes)}; a platform turns about none, one or all three of "
                f"rx, ry, rz"
            )
        return Platform(entry.required("frame", frame), axes)

    def actuator(entry: _Mapping) -> Actuator:
        return Actuator(
            joint=entry.required("joint", joint),
            gear_ratio=entry.optional("gear_ratio", _positive, 1.0),
            rotor_inertia=entry.optional("rotor_inertia", _not_negative, 0.0),
            torque_limit=entry.optional("torque_limit", _positive, None),
            speed_limit=entry.optional("speed_limit", _positive, None),
        )

    def closure(entry: _Mapping) -> Closure:
        pair = _list(frame)(f"{entry.where}frames", entry.required("frames", _any))
        if len(pair) != 2 or pair[0] == pair[1]:
            raise RobotFileError(f"{entry.where}frames: needs two different frames, got {list(pair)}")
        if urdf.body(pair[0]) == urdf.body(pair[1]):
            raise RobotFileError(
                f"{entry.where}frames: {pair[0]!r} and {pair[1]!r} are on one rigid body: nothing to close"
            )
        if entry.has("kind") == entry.has("axes"):
            raise RobotFileError(f"{entry.where[:-1]}: needs either kind or axes, and not both")
        if entry.has("axes"):
            given = entry.required("axes", _axes)
            axes = tuple(axis for axis in AXES if axis in given)
        else:
            kind, axis = entry.required("kind", _text), entry.optional("axis", _text, "z")
            try:
                axes = locked_axes(kind, axis)
            except RobotFileError as error:
                raise RobotFileError(f"{entry.where}kind: {error}") from None
        length = entry.required("length", _positive) if "distance" in axes else None
        return Closure(entry.required("name", _text), (pair[0], pair[1]), axes, length)

    def spring(entry: _Mapping) -> Spring | JointSpring:
        if entry.has("joint"):
            return JointSpring(
                name=entry.required("name", _text),
                joint=_one_of("joint", f"{entry.where}joint", entry.required("joint", _any), movable),
                stiffness=entry.required("stiffness", _positive),
                rest=entry.optional("rest", _number, 0.0),
            )
        motion = (
            ()
            if entry.optional("motion", _text_or_list, "own") == "own"
            else _axes(f"{entry.where}motion", entry.required("motion", _any))
        )
        stiffness = entry.required("stiffness", _positives)
        if len(stiffness) != max(len(motion), 1):
            raise RobotFileError(
                f"{entry.where}stiffness: needs one value an axis of motion "
                f"({max(len(motion), 1)}), got {len(stiffness)}"
            )
        part = _one_of("part", f"{entry.where}part", entry.required("part", _any), ("joint", "link"))
        after = entry.required("after", joint)
        if not motion and joints[after] not in ("revolute", "continuous", "prismatic"):
            raise RobotFileError(
                f"{entry.where}motion: required, because joint {after!r} is {joints[after]} and has no "
                f"motion of its own (valid: {', '.join(AXES)} or a list of them)"
            )
        return Spring(entry.required("name", _text), part, after, motion, stiffness)

    def reference(entry: _Mapping) -> Mapping[str, float]:
        for name in entry.content:
            _one_of("joint", f"{entry.where}{name}", name, movable)
        return {str(name): _number(f"{entry.where}{name}", entry.take(name)) for name in entry.content}

    def scenes(entry: _Mapping) -> Mapping[str, Scene]:
        return {
            str(name): _scene(str(name), _Mapping(f"{entry.where}{name}.", entry.take(name)), axes)
            for name in entry.content
        }

    springs = top.sections("springs", spring) if top.has("springs") else ()
    platform_read = top.section("platform", platform)
    axes = platform_read.axes
    description = RobotDescription(
        name=path.stem,
        file=path,
        urdf_text=urdf_text,
        platform=platform_read,
        actuators=top.sections("actuators", actuator),
        closures=top.sections("closures", closure),
        springs=tuple(found for found in springs if isinstance(found, Spring)),
        joint_springs=tuple(found for found in springs if isinstance(found, JointSpring)),
        gravity=top.optional("gravity", _vector3, (0.0, 0.0, -9.81)),
        reference=top.section("reference", reference) if top.has("reference") else {},
        scenes=top.section("scenes", scenes) if top.has("scenes") else {},
    )
    top.finish()
    _check_names(description, joints, frames)
    return description


def _numbers_by_name(entry: _Mapping) -> Mapping[str, float]:
    return {str(name): _number(f"{entry.where}{name}", entry.take(name)) for name in entry.content}


def _scene(name: str, entry: _Mapping, axes: Sequence[str]) -> Scene:
    kinds = [kind for kind in PATH_KINDS if entry.has(kind)]
    if len(kinds) != 1:
        raise RobotFileError(
            f"{entry.where[:-1]}: needs exactly one path ({', '.join(PATH_KINDS)}), got {kinds or 'none'}"
        )
    kind = kinds[0]
    points = _list(_numbers)(f"{entry.where}{kind}", entry.required(kind, _any))
    if len(points) < PATH_KINDS[kind] or (kind != "spline" and len(points) > PATH_KINDS[kind]):
        raise RobotFileError(
            f"{entry.where}{kind}: needs {'at least ' if kind == 'spline' else ''}{PATH_KINDS[kind]} "
            f"points, got {len(points)}"
        )
    for i, point in enumerate(points):
        if len(point) != len(axes):
            raise RobotFileError(
                f"{entry.where}{kind}[{i}]: needs {len(axes)} numbers, one for each axis of the platform "
                f"({', '.join(axes)}), got {list(point)}"
            )
    scene = Scene(
        name=name,
        kind=kind,
        points=points,
        duration=entry.required("duration", _positive),
        times=entry.optional("times", _numbers, None),
        speeds=entry.optional("speeds", _positives, None),
        at=entry.optional("at", _numbers, None),
    )
    entry.finish()
    return scene


def _check_names(description: RobotDescription, joints: Mapping[str, str], frames: Sequence[str]) -> None:
    """Names must be unique, and virtual joints must not take a name of the URDF."""
    groups = {
        "actuators": [actuator.joint for actuator in description.actuators],
        "closures": [closure.name for closure in description.closures],
        "springs": [name for spring in description.springs for name in spring.coordinates],
    }
    for key, names in groups.items():
        for name in names:
            if names.count(name) > 1:
                raise RobotFileError(f"{key}: {name!r} is there twice")
    for name in groups["springs"]:
        if name in joints:
            raise RobotFileError(f"springs: {name!r} is already a joint of the URDF")
        if virtual_link(name) in frames:
            raise RobotFileError(
                f"springs: {name!r} needs the name {virtual_link(name)!r}, taken in the URDF"
            )
    for actuator in description.actuators:
        if joints[actuator.joint] not in ("revolute", "continuous", "prismatic"):
            raise RobotFileError(
                f"actuators: joint {actuator.joint!r} is {joints[actuator.joint]}; a motor needs a "
                f"revolute, continuous or prismatic joint"
            )


# ------------------------------------------------------------------ YAML, key by key


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} is there twice", node.start_mark
                )
        return super().construct_mapping(node, deep=deep)


class _Mapping:
    """A YAML mapping that remembers which keys were asked for, so that unknown ones are noticed."""

    def __init__(self, where: str, content: Any) -> None:
        if not isinstance(content, dict):
            raise RobotFileError(
                f"{where[:-1] or 'the file'}: needs a mapping of keys, got {str(content)[:60]!r}"
            )
        self.where = where
        self.content: dict[Any, Any] = content
        self._asked: set[Any] = set()

    def has(self, key: str) -> bool:
        self._asked.add(key)
        return key in self.content

    def take(self, key: Any) -> Any:
        self._asked.add(key)
        return self.content[key]

    def required(self, key: str, read: Callable[[str, Any], T]) -> T:
        if not self.has(key):
            given = [str(name) for name in self.content]
            near = get_close_matches(key, given, n=1)
            hint = f"; is {near[0]!r} a misspelling?" if near else ""
            raise RobotFileError(f"{self.where}{key}: missing{hint} (given: {', '.join(given) or 'nothing'})")
        return read(f"{self.where}{key}", self.content[key])

    def optional(self, key: str, read: Callable[[str, Any], T], default: T | None) -> Any:
        return read(f"{self.where}{key}", self.content[key]) if self.has(key) else default

    def section(self, key: str, read: Callable[[_Mapping], T]) -> T:
        """A mapping below `key`."""
        return _finished(read, _Mapping(f"{self.where}{key}.", self.required(key, _any)))

    def sections(self, key: str, read: Callable[[_Mapping], T]) -> tuple[T, ...]:
        """A list of mappings below `key`, at least one."""
        items = self.required(key, _any)
        if not isinstance(items, list) or not items:
            raise RobotFileError(f"{self.where}{key}: needs a list with at least one entry, got {items!r}")
        return tuple(
            _finished(read, _Mapping(f"{self.where}{key}[{i}].", item)) for i, item in enumerate(items)
        )

    def finish(self) -> None:
        """Complain about keys that nobody asked for."""
        for key in self.content:
            if key not in self._asked:
                raise RobotFileError(f"{self.where}{key}: {choose_from('key', key, map(str, self._asked))}")


def _finished(read: Callable[[_Mapping], T], entry: _Mapping) -> T:
    value = read(entry)
    entry.finish()
    return value


def _any(where: str, value: Any) -> Any:
    return value


def _one_of(what: str, where: str, value: Any, valid: Sequence[str] | Mapping[str, str]) -> str:
    if not isinstance(value, str) or value not in valid:
        raise RobotFileError(f"{where}: {choose_from(what, value, valid)}")
    return value


def _text(where: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise RobotFileError(f"{where}: needs a text, got {value!r}")
    return value


def _text_or_list(where: str, value: Any) -> Any:
    return value if isinstance(value, list) else _text(where, value)


def _whole(where: str, value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise RobotFileError(f"{where}: needs a whole number, got {value!r}")
    return value


def _number(where: str, value: Any) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError
        number = float(value)  # a text, too: YAML 1.1 reads 1e5 as one
    except ValueError:
        raise RobotFileError(f"{where}: needs a number, got {value!r}") from None
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise RobotFileError(f"{where}: needs a finite number, got {value!r}")
    return number


def _positive(where: str, value: Any) -> float:
    number = _number(where, value)
    if number <= 0:
        raise RobotFileError(f"{where}: must be greater than zero, got {value!r}")
    return number


def _not_negative(where: str, value: Any) -> float:
    number = _number(where, value)
    if number < 0:
        raise RobotFileError(f"{where}: must not be negative, got {value!r}")
    return number


def _list(read: Callable[[str, Any], T]) -> Callable[[str, Any], tuple[T, ...]]:
    def read_list(where: str, value: Any) -> tuple[T, ...]:
        if not isinstance(value, list):
            raise RobotFileError(f"{where}: needs a list, got {value!r}")
        return tuple(read(f"{where}[{i}]", item) for i, item in enumerate(value))

    return read_list


_numbers = _list(_number)


def _positives(where: str, value: Any) -> tuple[float, ...]:
    return _list(_positive)(where, value if isinstance(value, list) else [value])


def _vector3(where: str, value: Any) -> tuple[float, float, float]:
    vector = _numbers(where, value)
    if len(vector) != 3:
        raise RobotFileError(f"{where}: needs three numbers, got {value!r}")
    return vector[0], vector[1], vector[2]


def _moments(where: str, value: Any) -> tuple[float, float, float]:
    moments = _vector3(where, value)
    check_inertia(where, np.diag(moments))
    return moments


def _axes(where: str, value: Any) -> tuple[str, ...]:
    axes = _list(lambda at, item: _one_of("axis", at, item, AXES))(
        where, value if isinstance(value, list) else [value]
    )
    if not axes or len(set(axes)) < len(axes):
        raise RobotFileError(f"{where}: needs different axes out of {', '.join(AXES)}, got {value!r}")
    return axes
