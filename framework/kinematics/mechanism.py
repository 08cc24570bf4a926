"""A mechanism for pinocchio: the open tree with its springs, and the equations of its loops.

The loops need not close. `check`, the search for a closed pose and the construction of a `ParallelRobot`
start from a mechanism. A column is an index into pinocchio's velocity vector (nv,).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Self

import coal
import numpy as np
import pinocchio as pin

from framework.argument_errors import explain_errors
from framework.errors import InvalidInput, RobotFileError
from framework.kinematics.tree_model import (
    Coordinates,
    JointLimit,
    coordinate_names,
    file_axes,
    is_slide,
    joint_limits,
    tree_model,
)
from framework.model.description import AXES, Coupling, JointDynamics, RobotDescription, Spring
from framework.model.documents import parse_xml, prefix_errors
from framework.model.loop_rows import CoupledJoints, LockedDirections, LoopRows, locked_directions, loop_rows
from framework.model.readers.pinocchio_model import parse_pinocchio
from framework.model.readers.recognise import parse_any
from framework.model.urdf_edits import insert_springs
from framework.model.urdf_elements import ParsedRobot, read_tree
from framework.model.visuals import read_visuals
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, Names, ReadOnlyArrays, read_only
from framework.tolerances import SAME_PLACE

MAX_JOINTS = 250  # a `pin.Data` of so many joints takes 0.5 GB


@dataclass(frozen=True, eq=False)
class LineSprings(ReadOnlyArrays):
    """The K springs and dampers between points.

    Numbers are (K,), or (T, K) of robots that differ in them.
    """

    names: Names
    first: IntArray  # (K,) frames at which the springs begin, indices into `Mechanism.frames`
    second: IntArray  # (K,) frames at which they end
    stiffness: Array  # [N/m]
    rest: Array  # [m] length at which a spring exerts no force
    damping: Array  # [N s/m]


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(ReadOnlyArrays):
    """The tree with its springs (`model`) and the table of its loop equations (`rows`).

    A mechanism does not change after construction; `dataclasses.replace` makes another one.
    """

    description: RobotDescription  # content of the robot file
    flexibility: str  # the least flexibility that has these springs
    model: pin.Model  # the open tree
    elastic: IntArray  # (n_e,) columns of the springs' own joints, in the order of the robot file
    stiffness: Array  # (n_e,) [N/m] or [N m/rad]
    joint_stiffness: Array  # (nv,) of springs on joints of the URDF, joint side
    joint_rest: Array  # (nv,) positions at which these springs exert no torque
    joint_damping: Array  # (nv,) viscous [N m s/rad, N s/m]; the armature of the joints is in `model`
    joint_friction: Array  # (nv,) dry [N m, N]
    elastic_names: Names  # (n_e,) of the springs' own joints
    # pinocchio's indices of the platform's frame, then of the frames of loops and of springs between points
    frames: tuple[int, ...]
    line_springs: LineSprings  # between two points
    rows: LoopRows  # all loop equations, redundant ones included
    rounded: LoopRows  # excluded rows, redundant except for rounded dimensions: they are only measured
    directions: LockedDirections  # pairs of axes that are all parallel only if no closure is flipped
    limits: tuple[JointLimit, ...]  # of joint positions, as in the URDF
    q_near: Array  # (nq,) reference of the robot file, at which the loops nearly close
    length: float  # [m] size of the mechanism, by which lengths become dimensionless

    @classmethod
    @explain_errors
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
        locked: Mapping[str, float | None] | None = None,
        platform_joints: Sequence[str] | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> Self:
        """Read the mechanism or robot of a file with the springs of one flexibility.

        The file is one of ours or in a dialect that `framework.model.readers` reads. All options but the
        first and the last complete a foreign file and override it.

        Args:
            flexibility: which springs exist, `rigid` for none.
            platform: name of the platform's frame.
            axes: base axes of the platform's coordinates, such as ("x", "y", "rz").
            motors: names of the motors' joints.
            reference: joint positions by name [rad, m] near an assembled pose.
            base: a link; all joints that it does not carry are locked at the reference.
            locked: positions of locked joints by name [rad, m]; None for the reference.
            platform_joints: joints whose positions are the platform's coordinates, in place of `axes`.
            parameters: values that replace those that a robot file of ours declares.

        Raises:
            RobotFileError: see `read_any`; or pinocchio refuses the URDF.
            NotAssembled, SingularReference: for a `ParallelRobot`, see `ParallelRobot.of`.
        """
        parsed = parse_any(
            file,
            platform=platform,
            axes=axes,
            motors=motors,
            reference=reference,
            base=base,
            locked=locked,
            platform_joints=platform_joints,
            parameters=parameters,
        )
        return cls.assemble_or_advise(_build_mechanism(parsed, flexibility))

    @classmethod
    @explain_errors
    def from_description(cls, description: RobotDescription, *, flexibility: str = "rigid") -> Self:
        """Build an object of this class from a description, with the springs of one flexibility.

        `ParallelRobot.from_description` also assembles the robot. Errors in the URDF name the robot file.

        Raises:
            RobotFileError: unknown flexibility, invalid URDF, pinocchio refuses it, or too many joints.
            NotAssembled, SingularReference: for a `ParallelRobot`, see `ParallelRobot.of`.
        """
        with prefix_errors(f"{description.file}: urdf"):
            tree = read_tree(parse_xml(description.urdf_text))
        return cls.of(_build_mechanism(ParsedRobot(description, tree), flexibility))

    @classmethod
    @explain_errors
    def from_pinocchio(
        cls,
        model: pin.Model,
        closures: Sequence[Any],
        actuators: Sequence[str | Mapping[str, Any]],
        platform: Mapping[str, Any],
        *,
        reference: ArrayLike | Mapping[str, float] | None = None,
        flexibility: str = "rigid",
        name: str | None = None,
        **keys: Any,
    ) -> Self:
        """Build a robot of a pinocchio model of the open tree and what closes its loops.

        The robot's own `model` has the joints of the given one, in the same order. A continuous joint is a
        hinge that counts turns; a free flyer becomes three slides and a ball. Armature, viscous damping,
        limits of positions and gravity are those of the given model.

        Args:
            model: hinges, slides, balls and free flyers.
            closures: loops, each as two frames and a kind, `("tip", "other_tip", "spherical")`, with an axis
                or a length of some kinds (`"revolute", "y"`; `"distance", 0.25`); as a
                `pin.RigidConstraintModel`; or as an entry of `closures` in a robot file.
            actuators: names of the motors' joints, or entries of `actuators` in a robot file, such as
                `{"joint": "hip", "gear_ratio": 50, "rotor_inertia": 6e-6, "torque_limit": 2}`.
            platform: frame and axes, `{"frame": "tip", "axes": ["x", "y"]}`, or `{"joints": [...]}`.
            reference: q (nq,) of the given model, or joint positions by name [rad, m], near an assembled
                pose, which decides the modes; pinocchio's neutral configuration by default.
            flexibility: which of the `springs` exist, `rigid` for none.
            name: of the robot; by default that of the model, or `robot` if it has none.
            keys: further keys of a robot file: `springs`, `couplings`, `joints` (dry friction), `scenes`.

        Raises:
            RobotFileError: a value is not what the key of its name takes; names the valid ones.
            InvalidInput: a joint of another kind, or a reference of another length.
            NotAssembled, SingularReference: for a `ParallelRobot`, see `ParallelRobot.of`.
        """
        parsed = parse_pinocchio(
            model,
            closures,
            actuators,
            platform,
            reference=reference,
            name=name or model.name or "robot",
            keys=keys,
        )
        return cls.assemble_or_advise(_build_mechanism(parsed, flexibility))

    def constraint_models(self) -> list[pin.RigidConstraintModel]:
        """Return the loops as pinocchio's constraints on `model`: points, poses, and hinges as two points.

        Pinocchio's constraint dynamics of these and of `model`, with `robot.rotors` added to the armature, is
        that of `forward_dynamics` but for springs, damping and friction. The rows of a planar robot are
        redundant in space: give `pin.ProximalSettings(1e-12, 1e-8, 20)`.

        Raises:
            InvalidInput: a loop of another kind, or a coupling between joints, which pinocchio does not have.
        """
        model, description = self.model, self.description
        if description.couplings:
            raise InvalidInput(
                f"{self.name}: {description.couplings[0].name} couples joints, and pinocchio's constraints "
                f"hold points and poses"
            )
        constraints = []
        for closure in description.closures:
            ends = [model.frames[frame_index(model, frame)] for frame in closure.frames]
            locked = set(closure.axes)
            free = [k for k, turn in enumerate(AXES[3:]) if turn not in locked]  # turns
            if not locked >= set(AXES[:3]) or len(free) == 2:
                raise InvalidInput(
                    f"{self.name}: loop {closure.name} locks {', '.join(closure.axes)}; pinocchio's "
                    f"constraints hold points and poses (kinds spherical, fixed, revolute)"
                )
            kind = pin.ContactType.CONTACT_3D if free else pin.ContactType.CONTACT_6D
            offsets = [np.zeros(3)]  # of the points that coincide; a hinge is two points of its axis
            if len(free) == 1:
                offsets.append(self.length * np.eye(3)[free[0]])
            for offset in offsets:
                shift = pin.SE3(np.eye(3), offset)
                (first, pose), (second, other) = ((end.parentJoint, end.placement * shift) for end in ends)
                constraint = pin.RigidConstraintModel(
                    kind, model, first, pose, second, other, pin.ReferenceFrame.LOCAL
                )
                constraint.name = closure.name
                constraints.append(constraint)
        return constraints

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """The visuals of the URDF on `model`, for pinocchio's viewers."""
        solids = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}
        geometries = pin.GeometryModel()
        for k, shape in enumerate(read_visuals(self.description, self.model)):
            if shape.vertices is None or shape.faces is None:
                sizes = (np.array(shape.size),) if shape.kind == "box" else shape.size
                solid = solids[shape.kind](*sizes)
            else:
                solid = coal.BVHModelOBBRSS()
                solid.beginModel(len(shape.faces), len(shape.vertices))
                solid.addVertices(shape.vertices)
                solid.addTriangles(shape.faces)
                solid.endModel()
            name = f"{self.model.names[shape.node]}_{k}"
            geometry = pin.GeometryObject(name, shape.node, pin.SE3(shape.placement), solid)
            geometry.meshColor = np.array(shape.color)
            geometries.addGeometryObject(geometry)
        return geometries

    @classmethod
    def of(cls, mechanism: Mechanism) -> Self:
        """Return the mechanism of a robot without the fields that `ParallelRobot` adds."""
        return cls(**{field.name: getattr(mechanism, field.name) for field in fields(Mechanism)})

    @classmethod
    def assemble_or_advise(cls, mechanism: Mechanism) -> Self:
        """Return a user's mechanism, whose loops need not close; a `ParallelRobot` is assembled."""
        return cls.of(mechanism)

    @property
    def name(self) -> str:
        return self.description.name

    @cached_property
    def n_e(self) -> int:
        return len(self.elastic)

    @cached_property
    def nv(self) -> int:
        """Number of columns: entries of pinocchio's velocity vector."""
        return self.model.nv

    @cached_property
    def has_balls(self) -> bool:
        """Whether a joint is a ball, whose quaternion makes q longer than the velocity vector."""
        return self.model.nq > self.model.nv

    @cached_property
    def mass(self) -> float:
        """Mass of all moving bodies [kg]."""
        return float(sum(body.mass for body in self.model.inertias[1:]))

    @cached_property
    def weightless(self) -> pin.Model:
        """The model without gravity."""
        model = pin.Model(self.model)
        model.gravity.linear = np.zeros(3)
        return model

    @cached_property
    def joints(self) -> IntArray:
        """All columns except the elastic ones."""
        return read_only(np.setdiff1d(np.arange(self.nv), self.elastic))

    @cached_property
    def all_stiffness(self) -> Array:
        """Stiffness on each coordinate, springs on joints included, (nv,) joint side [N/m, N m/rad]."""
        stiffness = self.joint_stiffness.copy()
        stiffness[self.elastic] += self.stiffness
        return read_only(stiffness)

    @property
    def spring_names(self) -> Names:
        """Names of all springs: virtual joints, then joints of the URDF, then springs between points."""
        sprung = np.flatnonzero(self.joint_stiffness)
        return (*self.elastic_names, *map(self.coordinates.name_of, sprung), *self.line_springs.names)

    @property
    def has_springs(self) -> bool:
        """Whether any spring acts: virtual, on a joint of the URDF, or between points."""
        return bool(self.n_e or self.joint_stiffness.any() or self.line_springs.stiffness.any())

    def friction_sizes(self, columns: IntArray) -> str:
        """Describe the dry friction of columns, such as `knee 0.1 N m`; empty without friction."""
        sizes = []
        for column in columns[self.joint_friction[columns] > 0.0].tolist():
            unit = "N" if self.sliding[column] else "N m"
            sizes.append(f"{self.coordinates.name_of(column)} {self.joint_friction[column]:.3g} {unit}")
        return ", ".join(sizes)

    @cached_property
    def is_damped(self) -> bool:
        """Whether viscous damping acts on joints of the URDF, or between two points."""
        return bool(self.joint_damping.any() or self.line_springs.damping.any())

    @cached_property
    def sliding(self) -> BoolArray:
        """Whether each column belongs to a slide [m], (nv,); the others belong to turns [rad]."""
        sliding = np.zeros(self.nv, dtype=bool)
        for joint in self.model.joints[1:]:
            sliding[joint.idx_v] = is_slide(joint)
        return read_only(sliding)

    def unit_lengths(self, turning: BoolArray) -> Array:
        """Return the units (k,) of k numbers: 1 if `turning` (k,), else the length [m] of the mechanism."""
        return np.where(turning, 1.0, self.length)

    @cached_property
    def column_scale(self) -> Array:
        """Characteristic size of each column, (nv,): length of the mechanism for slides, 1 for turns."""
        return read_only(self.unit_lengths(~self.sliding))

    @cached_property
    def row_lengths(self) -> Array:
        """Characteristic size of each loop equation, (rows,): mechanism length [m], 1 for rotations."""
        return read_only(self.unit_lengths(self.rows.rotation))

    @property
    def joint_ranges(self) -> Array:
        """Lower and upper limits of joint positions, (2, nv) [rad, m]; infinite without limits."""
        ranges = np.repeat([[-np.inf], [np.inf]], self.nv, axis=1)  # (2, nv)
        for limit in self.limits:
            ranges[:, limit.column] = limit.lower, limit.upper
        return ranges

    @cached_property
    def neutral(self) -> Array:
        """Pinocchio's neutral configuration (nq,), at which all joint positions are zero."""
        return read_only(pin.neutral(self.model))

    @cached_property
    def coordinates(self) -> Coordinates:
        """Names and axes of the coordinates in files."""
        return Coordinates(self.model)

    def unit_of(self, column: int) -> str:
        """Return the unit of the coordinate of a column: m or rad."""
        return "m" if self.sliding[column] else "rad"

    def reference_values(self, q: Array) -> dict[str, float]:
        """Return q (nq,) as a `reference` of a robot file: positions by name [rad, m], without springs."""
        values = self.coordinates.positions(q[None])[0]
        return {self.coordinates.name_of(column): float(values[column]) for column in self.joints}

    def printed_reference(self, q: Array) -> dict[str, float]:
        """Return q (nq,) as a `reference` at the six digits that messages print, rounding as zero."""
        values = self.reference_values(q)
        return {name: float(f"{v:.6g}") if abs(v) > SAME_PLACE else 0.0 for name, v in values.items()}

    def with_nearby_pose(self, q: Array) -> Self:
        """Return the mechanism with the pose q (nq,) in the place of its file's reference."""
        return replace(self, q_near=q, length=reference_length(self.model, q, self.frames))

    def __repr__(self) -> str:
        loops = ", ".join(closure.name for closure in self.description.closures)
        return f"{type(self).__name__}({self.name!r}, {self.flexibility}: loops {loops})"


def velocity_columns(model: pin.Model, names: Iterable[str]) -> IntArray:
    """Return the columns (k,) of k coordinates by their names, such as `knee`, or `hip_rx` of a ball."""
    all_names = coordinate_names(model)  # one for each column
    return np.array([all_names.index(name) for name in names], dtype=int)


def _build_mechanism(parsed: ParsedRobot, flexibility: str) -> Mechanism:
    """Build a mechanism from a parsed file, with the springs of one flexibility."""
    description = parsed.description
    springs = description.active_springs(flexibility)
    model = _build_tree_model(parsed, springs)
    model.gravity.linear = np.array(description.gravity)

    def joint_parameter(key: str) -> Array:
        """Return the parameter `key` of `JointDynamics` on each column, (nv,)."""
        return _joint_vector(model, {name: getattr(joint, key) for name, joint in description.joints.items()})

    model.armature[:] = joint_parameter("armature")
    # (nv,) on pinocchio's axes, which differ from those of the file on balls
    reference = file_axes(model).T @ _joint_vector(model, description.reference)
    q_near = pin.integrate(model, pin.neutral(model), reference)
    elastic_names = tuple(chain.from_iterable(spring.coordinates for spring in springs))

    loop_ends = chain.from_iterable(closure.frames for closure in description.closures)
    between = description.line_springs
    spring_ends = chain.from_iterable(spring.between for spring in between)
    # without repetitions
    frame_names = list(dict.fromkeys([description.platform.frame, *loop_ends, *spring_ends]))
    frames = tuple(frame_index(model, name) for name in frame_names)
    rows = loop_rows(
        description.closures,
        frame_names,
        [_index_coupling(model, coupling) for coupling in description.couplings],
    )
    return Mechanism(
        description=description,
        flexibility=description.least_flexibility(flexibility),
        model=model,
        elastic=velocity_columns(model, elastic_names),
        stiffness=np.array([*chain.from_iterable(spring.stiffness for spring in springs)]),
        joint_stiffness=joint_parameter("stiffness"),
        joint_rest=joint_parameter("rest"),
        joint_damping=joint_parameter("damping"),
        joint_friction=joint_parameter("friction"),
        elastic_names=elastic_names,
        frames=frames,
        line_springs=LineSprings(
            names=tuple(spring.label for spring in between),
            first=np.array([frame_names.index(spring.between[0]) for spring in between], dtype=np.intp),
            second=np.array([frame_names.index(spring.between[1]) for spring in between], dtype=np.intp),
            stiffness=np.array([spring.stiffness for spring in between]),
            rest=np.array([spring.rest for spring in between]),
            damping=np.array([spring.damping for spring in between]),
        ),
        rows=rows,
        rounded=rows.take(np.empty(0, dtype=int)),  # none yet
        directions=locked_directions(description.closures, frame_names),
        limits=joint_limits(parsed.tree, model),
        q_near=q_near,
        length=reference_length(model, q_near, frames),
    )


def _build_tree_model(parsed: ParsedRobot, springs: Sequence[Spring]) -> pin.Model:
    """Build pinocchio's model of the tree of a parsed file, with a joint for each of the `springs`."""
    file = parsed.description.file
    # balls keep the axes of the file if parameters differ between axes, or if springs rest off zero
    as_declared = []
    for joint in parsed.tree.joints.values():
        turns = joint.coordinates[-3:]  # without the slides of a floating joint
        parameters = {parsed.description.joints.get(turn, JointDynamics()) for turn in turns}
        if len(parameters) > 1 or any(axis.rest for axis in parameters):
            as_declared.append(joint.name)
    tree = parsed.tree.copy()
    insert_springs(tree, springs)
    try:
        model = tree_model(tree, as_declared, parsed.joint_order)
    except (ValueError, RuntimeError) as error:
        raise RobotFileError(f"{file}: urdf: pinocchio refuses it: {' '.join(str(error).split())}") from None
    if model.nv > MAX_JOINTS:
        raise RobotFileError(
            f"{file}: {model.nv} joints that move, springs included; at most {MAX_JOINTS} "
            f"are taken (pinocchio's working memory grows with their third power)"
        )
    return model


def _index_coupling(model: pin.Model, coupling: Coupling) -> CoupledJoints:
    """Return a coupling with its joints as indices into the velocity vector and into q.

    The two indices of a joint differ if a ball precedes it, as a ball has four entries of q and three rates.
    """
    names = coupling.joints
    joints = [model.joints[model.getJointId(name)] for name in names]
    return CoupledJoints(
        name=coupling.name,
        columns=tuple(joint.idx_v for joint in joints),
        places=tuple(joint.idx_q for joint in joints),
        terms={
            tuple(product.count(name) for name in names): coefficient
            for product, coefficient in coupling.equation.items()
        },
        turns=not is_slide(joints[0]),
    )


def frame_index(model: pin.Model, name: str) -> int:
    """Return the index of the frame of a link, or of a joint if no link has the name.

    In URDF a link and a joint may share a name.
    """
    kinds = (pin.FrameType.BODY, pin.FrameType.JOINT)
    kind = next((kind for kind in kinds if model.existFrame(name, kind)), None)
    return int(model.getFrameId(name) if kind is None else model.getFrameId(name, kind))


def _joint_vector(model: pin.Model, values: Mapping[str, float]) -> Array:
    """Return a vector (nv,) with the values of named joints, zero elsewhere."""
    vector = np.zeros(model.nv)
    vector[velocity_columns(model, values)] = list(values.values())
    return vector


def reference_length(model: pin.Model, q: Array, frames: Iterable[int]) -> float:
    """Compute the size [m] of the mechanism at q (nq,); 1 if this is zero.

    The size makes metres comparable with radians. It is the largest distance between joints, moving frames
    and frames of loops and springs, so it does not depend on where the robot stands. A radius of gyration of
    a body about its joint counts, too, in case all frames coincide, as in a spherical robot.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    moving = {k for k, frame in enumerate(model.frames) if frame.parentJoint > 0}
    placements = [*data.oMi[1:], *(data.oMf[k] for k in moving.union(frames))]
    points = np.array([placement.translation for placement in placements])  # (k, 3)
    size = np.linalg.norm(points[:, None] - points, axis=2).max()
    for body in model.inertias[1:]:
        if body.mass > 0.0:
            # mean square distance of the mass from the joint; trace / 2 is the integral about its centre
            gyration_square = body.lever @ body.lever + 0.5 * np.trace(body.inertia) / body.mass
            size = max(size, np.sqrt(gyration_square))
    return float(size) or 1.0
