"""A parallel robot as pinocchio sees it: the open tree, its index sets and its loop equations."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from framework.arrays import Array, IntArray, ReadOnlyArrays, read_only
from framework.errors import RobotFileError, expect
from framework.model.bare_urdf import bare_urdf
from framework.model.description import AXES, Closure, ParsedRobot, RobotDescription
from framework.model.documents import naming, parse_xml
from framework.model.readers.recognise import parse_any
from framework.model.spring_joints import count_turns, insert_springs

MOST_JOINTS = 250  # a `pin.Data` for them takes 0.5 GB


class LoopRows(NamedTuple):
    """The scalar loop equations of a robot as a table; m rows.

    A translation row is e . (p2 - p1) = 0 with e the axis `first_axis` of the first frame. A rotation
    row is sign u . w = 0 with u the axis `first_axis` of the first and w the axis `second_axis` of the
    second frame (Haug's dot-1 primitive): polynomial in the rotation matrices, so it has no angle that
    jumps, and to first order it is the relative rotation about the locked axis. A distance row is
    (|p2 - p1|^2 - length^2) / (2 length) = 0, to first order the error in length.
    """

    first: IntArray  # (m,) frame, as index into ParallelRobot.frames
    second: IntArray  # (m,)
    distance: NDArray[np.bool_]  # (m,)
    rotation: NDArray[np.bool_]  # (m,)
    first_axis: IntArray  # (m,)
    second_axis: IntArray  # (m,)
    sign: Array  # (m,)
    length: Array  # (m,) [m], of distance rows
    names: tuple[str, ...]  # closure.axis

    @property
    def only_translations(self) -> bool:
        return not (np.count_nonzero(self.rotation) or np.count_nonzero(self.distance))

    def take(self, rows: IntArray) -> LoopRows:
        """The table of some of the rows."""
        names = tuple(self.names[i] for i in rows)
        return LoopRows(*[read_only(column[rows]) for column in self[:-1]], names)  # type: ignore[call-arg,arg-type]


@dataclass(frozen=True, eq=False)
class ParallelRobot(ReadOnlyArrays):
    """The tree with its springs (`model`), and which of its coordinates are what.

    `actuated` (n_a,), `elastic` (n_e,) and `passive` (n_p,) index pinocchio's velocity vector, in the
    order of the robot file for the first two. q_a is the joint side of the gear; the motor angle is
    gear_ratio * q_a. Nothing here changes after construction.
    """

    description: RobotDescription
    flexibility: str  # the least one with these springs, whatever was asked for
    model: pin.Model
    actuated: IntArray
    elastic: IntArray
    passive: IntArray
    gear_ratio: Array  # (n_a,) motor angle over joint angle
    rotor_inertia: Array  # (n_a,) [kg m^2], motor side
    stiffness: Array  # (n_e,) [N/m] or [N m/rad]
    joint_stiffness: Array  # (nv,) of springs on joints of the URDF, joint side
    joint_rest: Array  # (nv,) where those springs are at rest
    elastic_names: tuple[str, ...]  # (n_e,)
    frames: tuple[int, ...]  # pinocchio frames whose motion the equations need; the platform is 0
    rows: LoopRows
    platform_axes: IntArray  # (n,) 0..5 into the twist (linear, angular)
    q_near: Array  # (nq,) configuration of the robot file, nearly assembled
    length: float  # [m] size of the robot, to compare metres with radians

    @property
    def name(self) -> str:
        return self.description.name

    @property
    def n(self) -> int:
        """Number of platform coordinates."""
        return len(self.platform_axes)

    @property
    def n_a(self) -> int:
        return len(self.actuated)

    @property
    def translations(self) -> NDArray[np.bool_]:
        """Which of the platform's coordinates are translations, (n,) [m]; the others are turns [rad]."""
        return np.asarray(self.platform_axes < 3)

    @property
    def n_e(self) -> int:
        return len(self.elastic)

    @property
    def n_p(self) -> int:
        return len(self.passive)

    @property
    def actuator_names(self) -> tuple[str, ...]:
        return tuple(actuator.joint for actuator in self.description.actuators)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each motor's torque: N for a slide without a gear (gear ratio 1), N m for all others."""
        slides = self.sliding[self.actuated]
        return tuple(
            "N" if slide and gear == 1.0 else "N m"
            for slide, gear in zip(slides, self.gear_ratio, strict=True)
        )

    @property
    def sliding(self) -> NDArray[np.bool_]:
        """Which coordinates of pinocchio's velocity vector slide [m], (nv,); the others turn [rad]."""
        sliding = np.zeros(self.model.nv, dtype=bool)
        for joint in self.model.joints[1:]:
            sliding[joint.idx_v] = joint.shortname().startswith("JointModelP")
        return sliding

    def __repr__(self) -> str:
        return (
            f"ParallelRobot({self.name!r}, {self.flexibility}: platform {', '.join(self.axis_names)}; "
            f"motors {', '.join(self.actuator_names)}; springs {', '.join(self.elastic_names) or 'none'})"
        )

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the platform coordinates, e.g. ("x", "y")."""
        return self.description.platform.axes

    def joint_of(self, column: int) -> str:
        """Name of the joint that owns one entry of the velocity vector."""
        return str(self.model.names[int(np.searchsorted(_first_columns(self.model), column, "right"))])

    @staticmethod
    def from_file(
        file: str | Path,
        *,
        flexibility: str = "rigid",
        platform: str | None = None,
        axes: Sequence[str] | None = None,
        motors: Sequence[str] | None = None,
        reference: Mapping[str, float] | None = None,
    ) -> ParallelRobot:
        """The robot of a file with the springs of one flexibility.

        The file is ours or of any dialect that `framework.model.readers` knows; `platform`, `axes`, `motors`
        and `reference` [rad, m] say what a foreign file does not, as for `read_any`.

        Raises:
            RobotFileError: see `read_any`; or pinocchio refuses the URDF.
        """
        parsed = parse_any(file, platform=platform, axes=axes, motors=motors, reference=reference)
        return ParallelRobot._built(parsed, flexibility)

    @staticmethod
    def from_description(description: RobotDescription, *, flexibility: str = "rigid") -> ParallelRobot:
        """The robot of a description with the springs of one flexibility.

        Raises:
            RobotFileError: unknown flexibility, pinocchio refuses the URDF, or too many joints.
        """
        with naming(f"{description.file}: urdf"):
            urdf = parse_xml(description.urdf_text)
        return ParallelRobot._built(ParsedRobot(description, urdf), flexibility)

    @staticmethod
    def _built(parsed: ParsedRobot, flexibility: str) -> ParallelRobot:
        description, urdf = parsed
        springs = description.active_springs(flexibility)
        moving = bare_urdf(urdf)
        count_turns(moving)
        insert_springs(moving, springs)
        try:
            model = pin.buildModelFromXML(ElementTree.tostring(moving, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise RobotFileError(
                f"{description.file}: urdf: pinocchio refuses it: {' '.join(str(error).split())}"
            ) from None
        if model.nv > MOST_JOINTS:
            raise RobotFileError(
                f"{description.file}: {model.nv} joints that move, springs included; at most {MOST_JOINTS} "
                f"are taken (pinocchio's working memory grows with their third power)"
            )
        model.gravity.linear = np.array(description.gravity)

        def columns(names: list[str]) -> IntArray:
            return np.array([model.joints[model.getJointId(name)].idx_v for name in names], dtype=int)

        elastic_names = [name for spring in springs for name in spring.coordinates]
        actuated = columns([actuator.joint for actuator in description.actuators])
        elastic = columns(elastic_names)
        passive = np.setdiff1d(np.arange(model.nv), np.concatenate([actuated, elastic]))
        frame_names = [description.platform.frame]
        for closure in description.closures:
            frame_names += [name for name in closure.frames if name not in frame_names]
        frames = tuple(_frame(model, name) for name in frame_names)
        q_near = np.asarray(
            pin.integrate(model, pin.neutral(model), _on_joints(model, description.reference))
        )
        return ParallelRobot(
            description=description,
            flexibility=description.least_flexibility(flexibility),
            model=model,
            actuated=actuated,
            elastic=elastic,
            passive=passive,
            gear_ratio=np.array([actuator.gear_ratio for actuator in description.actuators]),
            rotor_inertia=np.array([actuator.rotor_inertia for actuator in description.actuators]),
            stiffness=np.array([value for spring in springs for value in spring.stiffness]),
            joint_stiffness=_on_joints(model, {s.joint: s.stiffness for s in description.joint_springs}),
            joint_rest=_on_joints(model, {s.joint: s.rest for s in description.joint_springs}),
            elastic_names=tuple(elastic_names),
            frames=frames,
            rows=_loop_rows(description.closures, frame_names),
            platform_axes=np.array([AXES.index(axis) for axis in description.platform.axes]),
            q_near=q_near,
            length=_length(model, q_near),
        )


def expect_robot(given: object) -> None:
    """Raise InvalidInput unless what was given is a robot."""
    expect("robot", given, ParallelRobot, 'robots.load("five_bar") or ParallelRobot.from_file("my.yaml")')


def _frame(model: pin.Model, name: str) -> int:
    """Index of the frame of a link or else of a joint: URDF lets the two share a name."""
    link = pin.FrameType.BODY
    is_link = model.existFrame(name, link)
    return int(model.getFrameId(name, link) if is_link else model.getFrameId(name))


def _first_columns(model: pin.Model) -> list[int]:
    return [joint.idx_v for joint in model.joints[1:]]


def _loop_rows(closures: tuple[Closure, ...], frame_names: list[str]) -> LoopRows:
    """One row for each locked axis of each closure."""
    table: list[tuple[float, ...]] = []
    names: list[str] = []
    for closure in closures:
        first, second = (frame_names.index(name) for name in closure.frames)
        locked = {AXES.index(axis) - 3 for axis in closure.axes if axis.startswith("r")}
        for axis in closure.axes:
            distance, rotation = axis == "distance", axis.startswith("r")
            k = 0 if distance else "xyz".index(axis[-1])
            pair = _perpendicular_pair(k, locked) if rotation else (k, 0, 1.0)
            table.append((first, second, distance, rotation, *pair, closure.length or 0.0))
            names.append(f"{closure.name}.{axis}")
    columns = np.array(table).T
    first_frame, second_frame, first_axis, second_axis = columns[[0, 1, 4, 5]].astype(np.intp)
    return LoopRows(
        first=read_only(first_frame),
        second=read_only(second_frame),
        distance=read_only(columns[2] > 0),
        rotation=read_only(columns[3] > 0),
        first_axis=read_only(first_axis),
        second_axis=read_only(second_axis),
        sign=read_only(columns[6]),
        length=read_only(columns[7]),
        names=tuple(names),
    )


def _perpendicular_pair(locked_axis: int, locked: set[int]) -> tuple[int, int, float]:
    """Axes (of the first, of the second frame) to keep perpendicular, and the sign, to lock a rotation.

    With i, j, k cyclic, R = 1 + [phi]x gives x_j . (R x_k) = -phi_i and x_k . (R x_j) = +phi_i.
    """
    following, preceding = (locked_axis + 1) % 3, (locked_axis + 2) % 3
    free = {0, 1, 2} - locked
    if free == {following}:  # the free axis is carried by the second frame
        return preceding, following, 1.0
    if free == {preceding} or not free:
        return following, preceding, -1.0
    # two free axes: a universal joint, its first axis on the first frame, its second on the second
    first, second = min(following, preceding), max(following, preceding)
    return first, second, -1.0 if first == following else 1.0


def _on_joints(model: pin.Model, values: Mapping[str, float]) -> Array:
    """A vector (nv,) with values by joint name, zero elsewhere."""
    vector = np.zeros(model.nv)
    for name, value in values.items():
        vector[model.joints[model.getJointId(name)].idx_v] = value
    return vector


def _length(model: pin.Model, q: Array) -> float:
    """Largest distance between two frames of the robot at q [m]; 1 for a robot without extent."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    points = np.array([placement.translation for placement in list(data.oMf)[1:]])  # not the universe
    extent = float(np.sqrt(((points[:, None] - points[None]) ** 2).sum(axis=2).max()))
    return extent if extent > 0 else 1.0
