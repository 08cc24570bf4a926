"""A parallel robot: an assembled mechanism with platform, motors and a known loop structure.

The module also has the table of the robot's equations and the sparsity pattern of their Jacobian. Neither
depends on q. A column is an index into pinocchio's velocity vector (nv,).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from framework.errors import FrameworkError, NotAssembled, SingularReference, expect, point
from framework.kinematics.assembly import Configuration, nearby_configurations, remark_on_turns
from framework.kinematics.assembly_search import find_closed_pose
from framework.kinematics.couplings import coupling_jacobian, coupling_pattern
from framework.kinematics.frames import FrameStack, frames_at, integrate, scratch_of
from framework.kinematics.loop_structure import (
    DISTANCE_APART,
    LoopStructure,
    assemble_mechanism,
    jacobians_apart,
    motion_matrix,
    refuse_singular_reference,
)
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.kinematics.platform import PlatformCoordinates, platform_coordinates
from framework.lazy_names import notebook_picture
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays, read_only
from framework.numerics.banded_lu import Band


@dataclass(frozen=True, eq=False, repr=False)
class ParallelRobot(Mechanism):
    """An assembled mechanism with a platform and motors.

    A robot has its mechanism (tree, springs, loops), the platform's coordinates x, the columns of its
    actuated, elastic and passive joints in pinocchio's velocity vector, the assembled `reference`, and the
    `structure` of the loops at the reference. Everything else is derived from these. q_a is on the joint side
    of the gears: a motor angle is gear_ratio * q_a.

    `dataclasses.replace` keeps reference and structure. Use it to change masses, springs and motors, or to
    change lengths slightly. After larger changes `ParallelRobot.of` determines reference and structure again.
    """

    platform: PlatformCoordinates
    actuated: IntArray  # (n_a,) columns of the motors' joints, in the order of the robot file
    passive: IntArray  # columns of the joints without motor or spring, idle ones included
    gear_ratio: Array  # (n_a,) motor angle over joint angle
    rotor_inertia: Array  # (n_a,) [kg m^2], motor side
    reference: Configuration  # assembled; decides the working mode and the assembly mode
    structure: LoopStructure  # independent loop equations and idle joints
    equations: Equations  # platform and independent loops, with the sparsity pattern of their Jacobian
    elastic_inertia: bool = True  # False: a model in which the motion of the springs moves no mass

    @classmethod
    def of(cls, mechanism: Mechanism, *, advises: bool = True) -> Self:
        """Assemble a mechanism with the platform and the motors of its description.

        Args:
            advises: whether a SingularReference has poses that would serve, which are tried.

        Raises:
            NotAssembled: the loops do not close near the reference, see `assemble_mechanism`.
            SingularReference: the loops are singular at the reference, see `refuse_singular_reference`.
        """
        mechanism, closed = assemble_mechanism(mechanism)
        description = mechanism.description
        poses = (closed.q, *nearby_configurations(mechanism, closed.q))  # the reference first
        frames = frames_at(mechanism, np.stack(poses))
        platform = platform_coordinates(description.platform, mechanism.model)
        platform = platform.choose_chart(frames.platform_rotation)
        actuated = velocity_columns(mechanism.model, description.motor_joints)
        passive = np.setdiff1d(mechanism.joints, actuated)

        matrices = [motion_matrix(mechanism, platform, q) for q in poses]
        try:
            refuse_singular_reference(mechanism, passive, poses, matrices)
        except SingularReference as refusal:
            served = [pose for pose in refusal.poses if advises and cls._serves(mechanism, pose)]
            if advises and not served:  # of many legs, poses nearby free some only
                step = DISTANCE_APART * np.isin(np.arange(mechanism.nv), mechanism.joints)  # (nv,)
                start = integrate(mechanism, closed.q, step * mechanism.column_scale)
                with suppress(NotAssembled):
                    pose = mechanism.printed_reference(find_closed_pose(mechanism.with_nearby_pose(start)).q)
                    served = [pose] if cls._serves(mechanism, pose) else []
            raise SingularReference(
                mechanism.name, rows=refusal.rows, joints=refusal.joints, poses=served
            ).advising({"reference": served[0]} if served else None) from None
        apart = jacobians_apart(mechanism, closed.q)
        structure = LoopStructure.from_matrices(mechanism, passive, matrices, apart)
        moving = np.concatenate([actuated, np.setdiff1d(passive, structure.idle)])

        return cls(
            **vars(Mechanism.of(mechanism)),
            platform=platform,
            actuated=actuated,
            passive=passive,
            gear_ratio=np.array([actuator.gear_ratio for actuator in description.actuators]),
            rotor_inertia=np.array([actuator.rotor_inertia for actuator in description.actuators]),
            reference=Configuration(
                closed.q, platform.coordinates(frames)[0], closed.residual, closed.iterations
            ),
            structure=structure,
            equations=Equations.of(mechanism, platform, structure, moving, len(actuated)),
        )

    @classmethod
    def assemble_or_advise(cls, mechanism: Mechanism) -> Self:
        """Assemble a user's mechanism; a refusal advises a reference that a search finds, tried.

        Raises:
            NotAssembled: the loops do not close near the reference, or in no pose that the search finds.
            SingularReference: as `of`.
        """
        try:
            return cls.of(mechanism)
        except NotAssembled as failure:
            if remark_on_turns(mechanism, mechanism.description.reference):
                raise  # the angles seem to be in degrees: a search would only hide this
            pose = mechanism.printed_reference(find_closed_pose(mechanism).q)
            remedy = {"reference": pose} if cls._serves(mechanism, pose) else None
            raise failure.advising(remedy) from None

    @cached_property
    def n(self) -> int:
        """Number of platform coordinates."""
        return self.equations.n

    @cached_property
    def n_a(self) -> int:
        return len(self.actuated)

    @cached_property
    def n_p(self) -> int:
        """Number of passive joints without the idle ones."""
        return len(self.following)

    @cached_property
    def rotors(self) -> Array:
        """Inertia of the rotors on each column, (nv,) joint side [kg m^2, kg]."""
        rotors = np.zeros(self.model.nv)
        rotors[self.actuated] = self.gear_ratio**2 * self.rotor_inertia
        return read_only(rotors)

    @cached_property
    def loops(self) -> LoopRows:
        """The independent loop equations."""
        return self.equations.loops

    @cached_property
    def spanning_loops(self) -> LoopRows:
        """The R loop equations whose combinations are solved; `loops` if R = m."""
        return self.equations.spanning

    @cached_property
    def moving(self) -> IntArray:
        """Columns (k,) of the joints that x and q_e determine: actuated, then passive without idle ones."""
        return self.equations.columns

    @cached_property
    def following(self) -> IntArray:
        """Columns (n_p,) of the passive joints without the idle ones."""
        return read_only(self.moving[self.n_a :])

    @cached_property
    def unlocked(self) -> IntArray:
        """Columns (f,) of the joints that move with locked motors: elastic, then `following`."""
        return read_only(np.concatenate([self.elastic, self.following]))

    @cached_property
    def translations(self) -> BoolArray:
        """Whether each platform coordinate is a translation [m], (n,); the others are turns [rad]."""
        return self.platform.translations

    @cached_property
    def platform_scale(self) -> Array:
        """Length of the robot for translations of the platform, 1 for its turns, (n,)."""
        return read_only(self.unit_lengths(~self.translations))

    @cached_property
    def actuator_names(self) -> Names:
        return self.description.motor_joints

    @property
    def axis_units(self) -> list[str]:
        """Unit of each platform coordinate: m or rad."""
        return length_units(self.translations)

    @property
    def motor_joint_units(self) -> list[str]:
        """Unit of each motor's joint: m or rad."""
        return length_units(self.sliding[self.actuated])

    def place(self, x: Array) -> str:
        """Format platform coordinates x (n,) with their names, such as `x, y = (0.1, 0.2)`."""
        return f"{', '.join(self.axis_names)} = {point(x, self.platform_scale)}"

    @property
    def speed_units(self) -> tuple[str, ...]:
        """Unit of each motor's speed."""
        return tuple("m/s" if unit == "N" else "rad/s" for unit in self.torque_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each motor's torque: N of slides with gear ratio 1, else N m."""
        are_forces = self.sliding[self.actuated] & (self.gear_ratio == 1.0)
        return tuple("N" if is_force else "N m" for is_force in are_forces)

    @property
    def axis_names(self) -> Names:
        """Names of the platform coordinates, e.g. ("x", "y"), or names of joints."""
        return self.description.platform.names

    @cached_property
    def loop_lengths(self) -> Array:
        """Unit of each independent loop equation, (m,): robot length [m]; 1 of rotations and combinations."""
        return read_only(self.unit_lengths(self.loops.rotation | self.structure.varies))

    @cached_property
    def equation_sizes(self) -> Array:
        """Characteristic size of each equation, (n + m,) [m or rad], the platform's first."""
        return read_only(np.concatenate([self.platform_scale, self.loop_lengths * self.structure.row_sizes]))

    @cached_property
    def moving_scale(self) -> Array:
        """Factors (n + m, moving) that make dF/dq along the moving joints dimensionless."""
        return read_only(self.column_scale[self.moving] / self.equation_sizes[:, None])

    @cached_property
    def passive_scale(self) -> Array:
        """Factors (m, n_p) that make the passive columns of the loop equations dimensionless."""
        return read_only(self.moving_scale[self.n :, self.n_a :])

    def with_fixed_rows(self, rows: IntArray) -> Self:
        """Return the robot with loop equations at indices `rows` (k,) of `rows`, in place of combinations."""
        if not self.structure.varies:
            return self
        structure = replace(
            self.structure,
            independent=rows,
            spanning=rows,
            row_sizes=np.ones(len(rows)),
            span_sizes=np.ones(len(rows)),
        )
        equations = Equations.of(self, self.platform, structure, self.moving, self.n_a)
        return replace(self, structure=structure, equations=equations)

    def actuated_coordinates(self, q: Array) -> Array:
        """Return the motors' joints q_a (T, n_a) at q (T, nq), joint side of the gears [rad, m]."""
        return self.coordinates.positions(q)[:, self.actuated]

    @classmethod
    def _serves(cls, mechanism: Mechanism, pose: Mapping[str, float]) -> bool:
        """Return whether a pose, by joint, serves as the reference."""
        posed = replace(mechanism.description, reference=pose)
        try:
            cls.of(Mechanism.from_description(posed, flexibility=mechanism.flexibility), advises=False)
        except FrameworkError:
            return False
        return True

    _repr_mimebundle_ = notebook_picture("robot_picture")

    def __repr__(self) -> str:
        """Return name, flexibility, platform axes, motors and springs in one line."""
        return (
            f"ParallelRobot({self.name!r}, {self.flexibility}: platform {', '.join(self.axis_names)}; "
            f"motors {', '.join(self.actuator_names)}; springs {', '.join(self.spring_names) or 'none'})"
        )


def length_units(slides: Iterable[bool]) -> list[str]:
    """Return the units of coordinates: m of slides, rad of hinges."""
    return ["m" if slide else "rad" for slide in slides]


def expect_robot(robot: object) -> None:
    """Raise InvalidInput unless `robot` is a `ParallelRobot`."""
    expect("robot", robot, ParallelRobot, 'load_robot("five_bar") or load_robot("my_robot.yaml")')


@dataclass(frozen=True, eq=False)
class Equations(ReadOnlyArrays):
    """The n + m equations F = [platform - x ; closures], with the sparsity pattern of dF/dq.

    The closures are the R spanning rows if R = m, else m combinations of these that depend on q.
    """

    loops: LoopRows  # the m independent ones
    bodies: IntArray  # (n + R,) frame at whose origin each row's wrench acts, index into `frames`
    n: int  # number of the platform's equations, which come first
    signs: Array  # (n + R, nv) 1 if the joint carries only the second frame, -1 if only the first, else 0
    pattern: BoolArray  # (n + m, nv) whether an entry of dF/dq can differ from zero
    columns: IntArray  # of the joints that x and q_e determine: actuated, then passive
    moving_part: Band | None  # all rows, `columns`; None if the part is not square
    passive_part: Band | None  # rows of the loops, passive `columns`; None if not square
    spanning: LoopRows  # the R rows whose combinations are solved; `loops` if R = m
    span_scale: Array  # (R,) divisors that make these rows dimensionless and of unit size

    @staticmethod
    def of(
        mechanism: Mechanism,
        platform: PlatformCoordinates,
        structure: LoopStructure,
        columns: IntArray,
        n_a: int,
    ) -> Equations:
        """Make the table of the equations and of the sparsity of their Jacobian.

        Args:
            structure: which m loop equations are independent, and which R span these in all poses.
            columns: columns (k,) of the moving joints, those of the n_a motors first.
            n_a: number of motors.
        """
        n = platform.n
        m = len(structure.independent)
        # the R rows, of all loop equations and of those that only rounded dimensions keep from redundancy
        rows = mechanism.rows.append(mechanism.rounded).take(structure.spanning)
        carried = scratch_of(mechanism).carried  # (F, nv) 1 where a joint carries a frame; 0 is the platform
        signs = np.concatenate([platform.joint_incidence(carried[0]), rows.joint_signs(carried)])

        # an entry differs from zero where a joint moves one end of a row, or is coupled by the row
        of_platform = signs[:n] != 0.0  # (n, nv)
        of_rows = (signs[n:] != 0.0) | coupling_pattern(rows, mechanism.nv)  # (R, nv)
        if structure.varies:  # each of the m combinations of the R rows may have the entries of all
            of_rows = np.tile(of_rows.any(axis=0), (m, 1))  # (m, nv)
        pattern = np.concatenate([of_platform, of_rows])  # (n + m, nv)
        equations = np.arange(n + m)
        return Equations(
            loops=mechanism.rows.take(structure.independent),
            bodies=np.pad(rows.second, (n, 0)),  # n zeros first, for the platform
            n=n,
            signs=signs,
            pattern=pattern,
            columns=columns,
            moving_part=Band.of(pattern, equations, columns),
            passive_part=Band.of(pattern, equations[n:], columns[n_a:]),
            spanning=rows,
            span_scale=mechanism.unit_lengths(rows.rotation) * structure.span_sizes,
        )

    def jacobian(self, wrenches: Array, frames: FrameStack) -> Array:
        """Compute the Jacobian (T, n + R, nv): the powers of the rows' wrenches on the joints' screws.

        Wrenches (T, n + R, 6) and screws refer to the base's origin. Couplings have no wrenches.
        """
        jacobian: Array = (wrenches @ frames.screws.swapaxes(1, 2)) * self.signs
        if self.spanning.has_couplings:
            jacobian[:, self.n :] += coupling_jacobian(self.spanning, frames.q, jacobian.shape[2])
        return jacobian
