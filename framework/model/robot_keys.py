"""The keys of a robot file: for each mapping a table from its keys to their readers.

The methods of `RobotReader` read the values that name parts of the URDF. As all readers, they are called
with the place `where` in the file and the value there, see `framework.numerics.fields`. They raise
InvalidInput, or RobotFileError if the value contradicts the URDF.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from framework.errors import InvalidInput, RobotFileError
from framework.model.description import (
    AXES,
    CLOSURE_KINDS,
    GOALS,
    LEVELS_BY_NAME,
    MAX_DEGREE,
    MAX_TERMS,
    Actuator,
    Closure,
    Coupling,
    FrameWrench,
    KeptLevel,
    LineSpring,
    Platform,
    Points,
    Product,
    Scene,
    Spring,
    kinds_with_length,
    locked_axes,
)
from framework.model.urdf_elements import COORDINATE_SUFFIXES, Tree, check_inertia
from framework.numerics.fields import (
    Table,
    anything,
    below,
    dataclass_of,
    distinct,
    integer,
    list_of,
    mapping,
    mapping_of,
    not_negative,
    number,
    one_of,
    one_or_list_of,
    optional,
    positive,
    read_table,
    record,
    required,
    text,
    vector3,
)

VERSION = 1
PATH_KINDS = {"line": 2, "arc": 3, "spline": 2, "polyline": 3}  # least number of points
_OPEN_KINDS = ("spline", "polyline")  # paths through any number of points from the least one on


def _read_version(where: str, given: Any) -> int:
    """Read the version of a robot file, which must be `VERSION`."""
    version = integer(where, given)
    if version != VERSION:
        raise RobotFileError(f"{where}: got {version}, this program reads version {VERSION}")
    return version


# keys that are read first, since they change the URDF to which the other keys refer
TREE: Table = {
    "version": required(_read_version),
    "urdf": required(text),
    "parameters": optional(anything, {}),  # `parameters` has read them before the file is parsed
    "locked": optional(mapping_of(number), {}),
    "root": optional(one_of("root", ("fixed", "free")), "fixed"),
    "frames": optional(list_of(anything, least=1), ()),
}


def _read_moments(where: str, given: Any) -> tuple[float, float, float]:
    """Read principal moments of inertia (3,) [kg m^2] that a body can have."""
    moments = vector3(where, given)
    check_inertia(where, np.diag(moments))
    return moments


def closure_entry(words: Sequence[Any]) -> dict[str, Any]:
    """Return the entry of a closure in words: two frames, a kind (by default spherical), axis or length."""
    first, second, kind, *rest = [*words, "spherical"][: max(len(words), 3)]
    key = "length" if kind in kinds_with_length() else "axis"
    entry = {"name": f"{first}_{second}", "frames": [first, second], "kind": kind}
    return entry | ({key: rest[0]} if rest else {})


_read_axes = distinct("axis", AXES)  # one axis or several different ones


def _read_limit(where: str, given: Any) -> float | None:
    """Read a motor's limit; null or infinity means no limit."""
    return None if given is None or given == math.inf else positive(where, given)


# values of JointDynamics, None if not given
_DYNAMICS_TABLE: Table = {"rest": optional(number)} | dict.fromkeys(
    ("armature", "damping", "friction", "stiffness"), optional(not_negative)
)


JointValues = dict[str, dict[str, float]]  # for each coordinate, values of fields of JointDynamics


# ------------------------------------------------------------------ the robot on its tree


class RobotReader:
    """Readers of the values that name joints, links and frames of a URDF.

    Each is called with the place `where` in the file and the value `given` there.
    """

    def __init__(self, tree: Tree, locked: Iterable[str] = ()) -> None:
        """Collect the names that keys of the file may use.

        Args:
            tree: links and joints, in which locked joints are fixed.
            locked: names of locked joints. Couplings, springs, dynamics and reference may name them, too, and
                then have no effect.
        """
        self.tree = tree
        self.movable = [*tree.movable, *locked]  # joints of one freedom
        self.coordinates = [*tree.coordinates, *locked]  # also those of joints with several freedoms

    def table(self, *, is_coupled: bool) -> Table:
        """Return the keys that describe the robot on its tree.

        `is_coupled` says whether the robot has couplings, and so needs no closures.
        """
        closures = optional(list_of(self.closure), ()) if is_coupled else required(list_of(self.closure))
        return {
            "platform": required(self.platform),
            "actuators": required(list_of(self.actuator, least=1)),
            "closures": closures,
            "couplings": optional(list_of(self.coupling, least=1), ()),
            "springs": optional(list_of(self.spring, least=1), ()),
            "joints": optional(self.joints, {}),
            "gravity": optional(vector3, (0.0, 0.0, -9.81)),
            "reference": optional(mapping_of(number, one_of("joint", self.coordinates)), {}),
            "scenes": optional(self.scenes, {}),
            "left_out": optional(list_of(text), ()),
        }

    def added_frame(self, where: str, given: Any) -> dict[str, Any]:
        """Read a frame to add, with mass [kg] and inertia [kg m^2] if stated.

        An inertia needs a mass beside it. The values are the arguments of `urdf_edits.add_frame`, with `xyz`
        and `rpy` for the origin.
        """
        table = {
            "name": required(text),
            "parent": required(one_of("link", self.tree.links)),
            "xyz": optional(vector3, (0.0, 0.0, 0.0)),
            "rpy": optional(vector3, (0.0, 0.0, 0.0)),
            "mass": optional(positive),
            "inertia": optional(_read_moments),
        }
        values = read_table(where, given, table)
        if values["inertia"] is not None and values["mass"] is None:
            raise RobotFileError(f"{where}.inertia: needs a mass beside it")
        return {key: value for key, value in values.items() if value is not None}

    def frame(self, where: str, given: Any) -> str:
        """Read a frame, and return its link; a joint means its child."""
        return self.tree.link_of(one_of("frame", self.tree.frames)(where, given))

    def platform(self, where: str, given: Any) -> Platform:
        """Read a platform: a frame with axes, or joints with or without a frame."""
        content = mapping(where, given)
        if "joints" not in content:
            on_axes = {"frame": required(self.frame), "axes": required(_read_axes)}
            return Platform(**read_table(where, given, on_axes))
        if "axes" in content:
            raise RobotFileError(f"{where}: needs either axes or joints, and not both")
        of_joints = {"joints": required(distinct("joint", self.tree.movable)), "frame": optional(self.frame)}
        values = read_table(where, given, of_joints)
        frame = values["frame"] or self.tree.joints[values["joints"][-1]].child
        return Platform(frame, joints=values["joints"])

    def actuator(self, where: str, given: Any) -> Actuator:
        """Read a motor: joint, gear ratio, rotor inertia [kg m^2], limits, backlash [rad, m]."""
        readers = {
            "joint": one_of("joint", self.tree.joints),
            "gear_ratio": positive,
            "rotor_inertia": not_negative,
            "torque_limit": _read_limit,
            "speed_limit": _read_limit,
            "backlash": not_negative,
            "corner_speed": not_negative,
            "no_load_speed": positive,
            "rms_torque_limit": _read_limit,
        }
        motor: Actuator = dataclass_of(Actuator, readers)(where, given)
        corner, no_load = motor.corner_speed, motor.no_load_speed
        for key in ("torque_limit", "corner_speed", "no_load_speed"):
            if getattr(motor, key) is None and (corner, no_load) != (None, None):
                raise RobotFileError(f"{below(where, key)}: required, as part of a torque-speed curve")
        if corner is not None and no_load is not None and corner >= no_load:
            raise RobotFileError(
                f"{below(where, 'corner_speed')}: must be below the no_load_speed {no_load:g}, got {corner:g}"
            )
        return motor

    def closure(self, where: str, given: Any) -> Closure:
        """Read a closure, stated by a kind with its axis or length, or by locked axes."""
        content = mapping(where, given)
        if ("kind" in content) == ("axes" in content):  # both or neither
            raise RobotFileError(f"{where}: needs either kind or axes, and not both")
        table = {"name": required(text), "frames": required(self.pair_of_frames)}
        if "axes" in content:
            values = read_table(where, given, table | {"axes": required(_read_axes)})
            axes = tuple(sorted(values["axes"], key=AXES.index))
        else:
            table["kind"] = required(one_of("closure kind", CLOSURE_KINDS))
            if content["kind"] in kinds_with_length():
                table["length"] = required(positive)
            else:
                table["axis"] = optional(one_of("closure axis", tuple("xyz")))
            values = read_table(where, given, table)
            axes = locked_axes(values["kind"], values.get("axis") or "z")
        takes_axis = "axis" in table and set(axes) != set(locked_axes(values["kind"], "x"))
        omits_axis = takes_axis and values.get("axis") is None
        return Closure(values["name"], values["frames"], axes, values.get("length"), omits_axis)

    def pair_of_frames(self, where: str, given: Any) -> tuple[str, str]:
        """Read two frames of different bodies."""
        frames = list_of(self.frame)(where, given)
        if len(frames) != 2 or frames[0] == frames[1]:
            raise RobotFileError(f"{where}: needs two different frames, got {list(frames)}")
        first, second = frames
        if self.tree.body(first) == self.tree.body(second):
            raise RobotFileError(f"{where}: {first!r} and {second!r} are on one rigid body")
        return first, second

    def coupling(self, where: str, given: Any) -> Coupling:
        """Read a coupling of different joints."""
        joint = one_of("joint", self.movable)
        readers = {"joint": joint, "of": joint, "ratio": number, "offset": number, "terms": self.terms}
        coupling = dataclass_of(Coupling, readers)(where, given)
        if coupling.joint == coupling.of:
            raise RobotFileError(f"{below(where, 'of')}: needs another joint than {coupling.joint!r}")
        for product, _ in coupling.terms:
            place = below(where, f"terms.{'*'.join(product)}")
            if coupling.joint in product:
                raise RobotFileError(f"{place}: needs other joints than {coupling.joint!r}")
            if product == (coupling.of,):
                raise RobotFileError(f"{place}: the factor of {coupling.of!r} alone is the key `ratio`")
        return coupling

    def terms(self, where: str, given: Any) -> tuple[tuple[Product, float], ...]:
        """Read the coefficients of products of joints, such as knee*knee, by name."""
        read_joint = one_of("joint", self.movable)
        terms: dict[Product, float] = {}
        for name, coefficient in mapping_of(number)(where, given).items():
            place = below(where, name)
            joints = [name] if name in self.movable else [part.strip() for part in name.split("*")]
            product = tuple(sorted(read_joint(place, joint) for joint in joints))
            if len(product) > MAX_DEGREE:
                raise RobotFileError(f"{place}: at most {MAX_DEGREE} joints are multiplied")
            if product in terms:
                raise RobotFileError(f"{place}: stands twice")
            terms[product] = coefficient
        if len(terms) > MAX_TERMS:
            raise RobotFileError(f"{where}: at most {MAX_TERMS} terms, got {len(terms)}")
        return tuple(terms.items())

    def joints(self, where: str, given: Any) -> JointValues:
        """Read the entries of joints as entries of coordinates.

        An entry under the name of a ball is for its three coordinates; the values of an entry for one of
        these coordinates override it.
        """
        joints = self.tree.joints
        whole_joints = [name for name, joint in joints.items() if joint.kind in COORDINATE_SUFFIXES]
        read_name = one_of("joint", [*self.coordinates, *whole_joints])
        stated = mapping_of(record(_DYNAMICS_TABLE), read_name)(where, given)
        values: JointValues = {}
        # whole joints first, so that the entry of a coordinate overrides
        for name in sorted(stated, key=lambda name: name not in whole_joints):
            entry = {key: value for key, value in stated[name].items() if value is not None}
            if name not in joints and "armature" in entry:
                key = below(below(where, name), "armature")
                raise RobotFileError(
                    f"{key}: a ball has one armature for all directions; give it under the name of the joint"
                )
            coordinates = joints[name].coordinates if name in whole_joints else (name,)
            for coordinate in coordinates:
                values.setdefault(coordinate, {}).update(entry)
        return values

    def spring(self, where: str, given: Any) -> Spring | LineSpring | dict[str, Any]:
        """Read a spring: a virtual joint, between two points, or along a URDF joint.

        The last becomes its values (joint, stiffness, rest), since it is part of the joint's dynamics.
        """
        if "between" in mapping(where, given):
            return self.line_spring(where, given)
        if "joint" in given:
            on_joint = {
                "name": optional(text),
                "joint": required(one_of("joint", self.movable)),
                "stiffness": required(positive),
                "rest": optional(number, 0.0),
            }
            return read_table(where, given, on_joint)
        virtual = {
            "name": required(text),
            "part": required(one_of("part", ("joint", "link"))),
            "after": required(one_of("joint", self.tree.joints)),
            "motion": optional(lambda where, given: () if given == "own" else _read_axes(where, given), ()),
            "stiffness": required(one_or_list_of(positive)),
        }
        spring = Spring(**read_table(where, given, virtual))
        count = max(len(spring.motion), 1)
        if len(spring.stiffness) != count:
            raise RobotFileError(
                f"{where}.stiffness: needs one value an axis of motion ({count}), got {len(spring.stiffness)}"
            )
        if not spring.motion and spring.after not in self.movable:
            kind = self.tree.joints[spring.after].kind
            raise RobotFileError(
                f"{where}.motion: required, because joint {spring.after!r} is {kind} and has no motion of "
                f"its own (valid: {', '.join(AXES)} or a list of them)"
            )
        return spring

    def line_spring(self, where: str, given: Any) -> LineSpring:
        """Read a spring or damper between the origins of two frames."""
        table = {
            "name": optional(text, ""),
            "between": required(self.pair_of_frames),
            "stiffness": optional(positive, 0.0),
            "rest": optional(not_negative),
            "damping": optional(positive, 0.0),
        }
        values = read_table(where, given, table)
        if not (values["stiffness"] or values["damping"]):
            raise RobotFileError(f"{where}: needs a stiffness [N/m], a damping [N s/m], or both")
        if values["rest"] is None and values["stiffness"]:
            raise RobotFileError(
                f"{where}.rest: required beside stiffness {values['stiffness']:g}: the length [m] at "
                f"which the spring exerts no force, 0 for a balancing spring"
            )
        if values["rest"] is not None and not values["stiffness"]:
            raise RobotFileError(
                f"{where}.rest: got {values['rest']:g}, but no stiffness; a damper alone has no rest"
            )
        return LineSpring(**values | {"rest": values["rest"] or 0.0})

    def wrenches(self, where: str, given: Any) -> dict[str, Any]:
        """Read wrenches by frame; return each as written in plan.json."""
        stated = mapping_of(anything, self.frame)(where, given)
        return {frame: FrameWrench.of(frame, wrench, where).document for frame, wrench in stated.items()}

    def scenes(self, where: str, given: Any) -> dict[str, Scene]:
        """Read scenes, which are motions with a path and options, by name."""
        table = {**_SCENE_TABLE, "wrenches": optional(self.wrenches)}
        read_scene = record(table, _make_scene)
        scenes = mapping_of(read_scene)(where, given)
        return {name: replace(scene, name=name) for name, scene in scenes.items()}


# ------------------------------------------------------------------ scenes

PATHS: Table = {  # one of the kinds, see `select_path`
    **{kind: optional(list_of(list_of(number))) for kind in PATH_KINDS},
    "blend": optional(positive),
}
_SCENE_TABLE: Table = {
    **PATHS,
    "duration": optional(positive, also=("time",)),
    "optimize": optional(one_of("goal", GOALS)),
    "times": optional(list_of(number)),
    "speeds": optional(one_or_list_of(positive)),
    "at": optional(list_of(number)),
    "fidelity": optional(
        dataclass_of(KeptLevel, {"level": one_of("level", LEVELS_BY_NAME), "tolerance": positive})
    ),
}


def select_path(where: str, paths: Mapping[str, Any]) -> tuple[str, Points, float | None]:
    """Return kind, points and blend [m] of the only path in the values of PATHS.

    `paths` has the value of each key of PATHS, None if not given.

    Raises:
        InvalidInput: no path or several; too few or too many points; a polyline without a blend, or another
            path with one.
    """
    kinds = [kind for kind in PATH_KINDS if paths[kind] is not None]
    if len(kinds) != 1:
        raise InvalidInput(
            f"{where}: needs exactly one path ({', '.join(PATH_KINDS)}), got {kinds or 'none'}"
        )
    (kind,) = kinds
    points = paths[kind]
    least = PATH_KINDS[kind]
    may_have_more = kind in _OPEN_KINDS
    if len(points) < least or (len(points) > least and not may_have_more):
        count = f"at least {least}" if may_have_more else least
        raise InvalidInput(f"{where}.{kind}: needs {count} points, got {len(points)}")
    if (paths["blend"] is None) == (kind == "polyline"):  # a polyline without it, or another path with it
        raise InvalidInput(f"{where}.blend: belongs to a polyline, which needs one [m], and to no other path")
    return kind, points, paths["blend"]


def _make_scene(where: str, values: dict[str, Any]) -> Scene:
    """Make a scene without a name from the values of its keys."""
    kind, points, _ = select_path(where, values)
    if values["duration"] is None and values["optimize"] != "time":
        raise InvalidInput(f"{where}.duration: missing; only with `optimize: time` is it found [s]")
    if values["duration"] is not None and values["optimize"] == "time":
        raise InvalidInput(f"{where}.duration: leave it out, `optimize: time` finds the least")
    options = {key: value for key, value in values.items() if key not in PATH_KINDS}
    return Scene(name="", kind=kind, points=points, **options)
