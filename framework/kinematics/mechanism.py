"""A mechanism as pinocchio sees it: the open tree with its springs, and the loops that are to close.

It may not close, and nothing is asked of it but its numbers: `check`, the search for a closed pose and the
proof that a `ParallelRobot` starts from work on it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from framework.arrays import Array, IntArray, ReadOnlyArrays, read_only
from framework.errors import RobotFileError
from framework.kinematics.joint_limits import JointLimit, joint_limits
from framework.kinematics.tree_model import coordinate_names, named_axes, tree_model
from framework.model.bare_urdf import bare_urdf
from framework.model.description import ParsedRobot, RobotDescription
from framework.model.documents import naming, parse_xml
from framework.model.loop_rows import LockedDirections, LoopRows, locked_directions, loop_rows
from framework.model.readers.recognise import parse_any
from framework.model.spring_joints import count_turns, insert_springs

MOST_JOINTS = 250  # a `pin.Data` for them takes 0.5 GB


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(ReadOnlyArrays):
    """The tree with its springs (`model`) and the table of its loop equations (`rows`).

    `elastic` (n_e,) indexes pinocchio's velocity vector, in the order of the robot file. Nothing here
    changes after construction; `dataclasses.replace` makes another mechanism.
    """

    description: RobotDescription
    flexibility: str  # the least one with these springs, whatever was asked for
    model: pin.Model
    elastic: IntArray
    stiffness: Array  # (n_e,) [N/m] or [N m/rad]
    joint_stiffness: Array  # (nv,) of springs on joints of the URDF, joint side
    joint_rest: Array  # (nv,) where those springs are at rest
    elastic_names: tuple[str, ...]  # (n_e,)
    frames: tuple[int, ...]  # pinocchio frames whose motion the equations need; the platform is 0
    rows: LoopRows  # all loop equations, redundant ones too
    directions: LockedDirections  # what the loop equations alone would let turn over
    limits: tuple[JointLimit, ...]  # of the joints' positions, as the URDF has them
    q_near: Array  # (nq,) configuration of the robot file, nearly assembled
    length: float  # [m] size of the mechanism, to compare metres with radians

    @classmethod
    def from_file(
        cls,
        file: str | Path,
        *,
        flexibility: str = "rigid",
        platform: str | None = None,
        axes: Sequence[str] | None = None,
        motors: Sequence[str] | None = None,
        reference: Mapping[str, float] | None = None,
        base: str | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> Self:
        """The mechanism or robot of a file with the springs of one flexibility.

        The file is ours or of any dialect that `framework.model.readers` knows; `platform`, `axes`, `motors`,
        `reference` [rad, m] and `base` say what a foreign file does not, as for `read_any`; `parameters` are
        values in place of those that a robot file declares.

        Raises:
            RobotFileError: see `read_any`; or pinocchio refuses the URDF.
            NotAssembled, SingularReference: of a `ParallelRobot`, see `ParallelRobot.of`.
        """
        parsed = parse_any(
            file,
            platform=platform,
            axes=axes,
            motors=motors,
            reference=reference,
            base=base,
            parameters=parameters,
        )
        return cls.of(_built(parsed, flexibility))

    @classmethod
    def from_description(cls, description: RobotDescription, *, flexibility: str = "rigid") -> Self:
        """The mechanism or robot of a description with the springs of one flexibility.

        Raises:
            RobotFileError: unknown flexibility, pinocchio refuses the URDF, or too many joints.
            NotAssembled, SingularReference: of a `ParallelRobot`, see `ParallelRobot.of`.
        """
        with naming(f"{description.file}: urdf"):
            urdf = parse_xml(description.urdf_text)
        return cls.of(_built(ParsedRobot(description, urdf), flexibility))

    @classmethod
    def of(cls, mechanism: Mechanism) -> Self:
        """The same numbers, without what a `ParallelRobot` adds to them."""
        return cls(**{field.name: getattr(mechanism, field.name) for field in fields(Mechanism)})

    @property
    def name(self) -> str:
        return self.description.name

    @property
    def n_e(self) -> int:
        return len(self.elastic)

    @cached_property
    def joints(self) -> IntArray:
        """All entries of the velocity vector but those of springs."""
        return read_only(np.setdiff1d(np.arange(self.model.nv), self.elastic))

    @cached_property
    def has_joint_springs(self) -> bool:
        """Whether springs act on joints of the URDF."""
        return bool(self.joint_stiffness.any())

    @cached_property
    def sliding(self) -> NDArray[np.bool_]:
        """Which coordinates of pinocchio's velocity vector slide [m], (nv,); the others turn [rad]."""
        sliding = np.zeros(self.model.nv, dtype=bool)
        for joint in self.model.joints[1:]:
            sliding[joint.idx_v] = joint.shortname().startswith("JointModelP")
        return read_only(sliding)

    @cached_property
    def column_scale(self) -> Array:
        """Length of the mechanism for sliding joints, 1 for turning ones, (nv,)."""
        return read_only(np.where(self.sliding, self.length, 1.0))

    @cached_property
    def neutral(self) -> Array:
        """The configuration (nq,) from which pinocchio counts."""
        return read_only(np.asarray(pin.neutral(self.model)))

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each entry of the velocity vector: its joint's, of a ball NAME_rx, NAME_ry, NAME_rz."""
        return coordinate_names(self.model)

    def joint_of(self, column: int) -> str:
        """Name of one entry of the velocity vector."""
        return self.coordinate_names[column]

    def positions(self, q: Array) -> Array:
        """The coordinates (T, nv) by which files say q (T, nq) [rad, m]: of balls, rotation vectors."""
        model = self.model
        if model.nq == model.nv:
            return q
        from_neutral = [pin.difference(model, self.neutral, np.ascontiguousarray(row)) for row in q]
        return self.named(np.asarray(from_neutral))

    def named(self, v: Array) -> Array:
        """Velocities (T, nv), or other tangent vectors, on the axes that `coordinate_names` mean."""
        return v if self.model.nq == self.model.nv else np.asarray(v @ named_axes(self.model).T)

    def reference_values(self, q: Array) -> dict[str, float]:
        """A `reference` that says q (nq,): all coordinates by name, springs left out."""
        values = self.positions(q[None])[0]
        return {self.joint_of(int(column)): float(values[column]) for column in self.joints}

    def __repr__(self) -> str:
        loops = ", ".join(closure.name for closure in self.description.closures)
        return f"{type(self).__name__}({self.name!r}, {self.flexibility}: loops {loops})"


def columns_of(model: pin.Model, joints: Iterable[str]) -> IntArray:
    """Entries of the velocity vector that have these names."""
    names = coordinate_names(model)
    return np.array([names.index(name) for name in joints], dtype=int)


def _built(parsed: ParsedRobot, flexibility: str) -> Mechanism:
    description, urdf, _ = parsed
    springs = description.active_springs(flexibility)
    moving = bare_urdf(urdf)
    count_turns(moving)
    insert_springs(moving, springs)
    try:
        model = tree_model(moving)
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
    elastic_names = [name for spring in springs for name in spring.coordinates]
    frames = [description.platform.frame]
    for closure in description.closures:
        frames += [name for name in closure.frames if name not in frames]
    reference = named_axes(model).T @ _on_joints(model, description.reference)
    q_near = np.asarray(pin.integrate(model, pin.neutral(model), reference))
    return Mechanism(
        description=description,
        flexibility=description.least_flexibility(flexibility),
        model=model,
        elastic=columns_of(model, elastic_names),
        stiffness=np.array([value for spring in springs for value in spring.stiffness]),
        joint_stiffness=_on_joints(model, {s.joint: s.stiffness for s in description.joint_springs}),
        joint_rest=_on_joints(model, {s.joint: s.rest for s in description.joint_springs}),
        elastic_names=tuple(elastic_names),
        frames=tuple(frame_of(model, name) for name in frames),
        rows=loop_rows(description.closures, frames),
        directions=locked_directions(description.closures, frames),
        limits=joint_limits(urdf, model),
        q_near=q_near,
        length=_length(model, q_near),
    )


def frame_of(model: pin.Model, name: str) -> int:
    """Index of the frame of a link or else of a joint: URDF lets the two share a name."""
    link = pin.FrameType.BODY
    is_link = model.existFrame(name, link)
    return int(model.getFrameId(name, link) if is_link else model.getFrameId(name))


def _on_joints(model: pin.Model, values: Mapping[str, float]) -> Array:
    """A vector (nv,) with values by joint name, zero elsewhere."""
    vector = np.zeros(model.nv)
    vector[columns_of(model, values)] = list(values.values())
    return vector


def _length(model: pin.Model, q: Array) -> float:
    """Largest distance between two frames of the robot at q [m]; 1 for a robot without extent."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    points = np.array([placement.translation for placement in list(data.oMf)[1:]])  # not the universe
    extent = float(np.sqrt(((points[:, None] - points[None]) ** 2).sum(axis=2).max()))
    return extent if extent > 0 else 1.0
