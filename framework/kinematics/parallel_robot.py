"""A parallel robot: an assembled mechanism with a platform and motors, its loop structure determined.

With it goes the table of its equations and the sparsity of their Jacobian, which do not depend on q.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from framework.errors import expect, point
from framework.kinematics.assembly import Configuration, nearby_configurations
from framework.kinematics.frames import frames_at
from framework.kinematics.loop_structure import LoopStructure, motion_matrix, singular_reference_error
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.kinematics.pinocchio_memory import scratch_of
from framework.kinematics.platform import PlatformCoordinates, platform_coordinates
from framework.kinematics.rounded_loops import assemble_mechanism
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays, read_only
from framework.numerics.banded_lu import Band, Factors


@dataclass(frozen=True, eq=False, repr=False)
class ParallelRobot(Mechanism):
    """A mechanism that is assembled, with a platform and motors.

    A robot is the mechanism (its tree, its springs, its loops); the index sets of its actuated (n_a), elastic
    (n_e) and passive (n_p) coordinates in pinocchio's velocity vector, the first two in the order of the
    robot file; the platform's coordinates x; the assembled `reference`; and the `structure` of the loops at
    the reference. All else is derived from these. q_a is the joint side of the gear; the motor angle is
    gear_ratio * q_a.

    `dataclasses.replace` keeps reference and structure: it is for other masses, springs and motors, and for
    lengths that are a little off. After larger changes `ParallelRobot.of` determines both anew.
    """

    platform: PlatformCoordinates
    actuated: IntArray
    passive: IntArray
    gear_ratio: Array  # (n_a,) motor angle over joint angle
    rotor_inertia: Array  # (n_a,) [kg m^2], motor side
    reference: Configuration  # assembled; fixes the working and the assembly mode
    structure: LoopStructure  # independent loop equations and idle joints
    equations: Equations  # the independent loops and the platform, and where their Jacobian has entries
    elastic_inertia: bool = True  # False: a model whose bodies do not feel how the springs move

    @classmethod
    def of(cls, mechanism: Mechanism) -> Self:
        """Assemble a mechanism with the platform and the motors of its description.

        Raises:
            NotAssembled: the loops do not close near the reference, see `assemble_mechanism`.
            SingularReference: the reference is on a singularity of the loops, see `singular_reference_error`.
        """
        mechanism, closed = assemble_mechanism(mechanism)
        description = mechanism.description
        poses = (closed.q, *nearby_configurations(mechanism, closed.q))
        frames = frames_at(mechanism, np.stack(poses))
        platform = platform_coordinates(description.platform, mechanism.model)
        platform = platform.choose_chart(frames.rotation[:, 0])
        actuated = velocity_columns(mechanism.model, description.motor_joints)
        passive = np.setdiff1d(mechanism.joints, actuated)
        matrices = [motion_matrix(mechanism, platform, q) for q in poses]
        singular = singular_reference_error(mechanism, passive, poses, matrices)
        if singular is not None:
            raise singular
        structure = LoopStructure.of(mechanism, passive, matrices)
        moving = np.concatenate([actuated, np.setdiff1d(passive, structure.idle)])
        loops = mechanism.rows.take(structure.independent)

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
            equations=Equations.of(mechanism, platform, loops, moving, len(actuated)),
        )

    @property
    def n(self) -> int:
        """Number of platform coordinates."""
        return self.equations.n

    @property
    def n_a(self) -> int:
        return len(self.actuated)

    @cached_property
    def rotors(self) -> Array:
        """Inertia of the rotors on each joint rate, (nv,) joint side [kg m^2, kg]."""
        rotors = np.zeros(self.model.nv)
        rotors[self.actuated] = self.gear_ratio**2 * self.rotor_inertia
        return read_only(rotors)

    @property
    def loops(self) -> LoopRows:
        """The table of the independent loop equations."""
        return self.equations.loops

    @property
    def moving(self) -> IntArray:
        """The columns that x and q_e determine: actuated, then passive but not idle."""
        return self.equations.columns

    @cached_property
    def following(self) -> IntArray:
        """The passive joints except the idle ones."""
        return read_only(self.equations.columns[self.n_a :])

    @property
    def translations(self) -> NDArray[np.bool_]:
        """Whether each platform coordinate is a translation [m], (n,); the others are turns [rad]."""
        return self.platform.translations

    @cached_property
    def platform_scale(self) -> Array:
        """Length of the robot for translations of the platform, 1 for its turns, (n,)."""
        return read_only(np.where(self.translations, self.length, 1.0))

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
        """Return platform coordinates x (n,) as text, such as `x, y = (0.1, 0.2)`."""
        return f"{', '.join(self.axis_names)} = {point(x)}"

    @property
    def speed_units(self) -> tuple[str, ...]:
        """Unit of each motor's speed."""
        return tuple({"N": "m/s", "N m": "rad/s"}[unit] for unit in self.torque_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each motor's torque: N for slides without a gear, else N m."""
        slides = self.sliding[self.actuated]
        return tuple(
            "N" if slide and gear == 1.0 else "N m"
            for slide, gear in zip(slides, self.gear_ratio, strict=True)
        )

    @property
    def axis_names(self) -> Names:
        """Names of the platform coordinates, e.g. ("x", "y"), or names of joints."""
        return self.description.platform.names

    @cached_property
    def row_lengths(self) -> Array:
        """Characteristic scale of each of `rows`, (rows,): length of the robot [m], or 1 for rotations."""
        return read_only(np.where(self.rows.rotation, 1.0, self.length))

    @property
    def loop_lengths(self) -> Array:
        """Characteristic scale of the independent loop equations, (m,), see `row_lengths`."""
        return self.row_lengths[self.structure.independent]

    @cached_property
    def passive_scale(self) -> Array:
        """Factors (m, n_p) that make the passive columns of the loop equations dimensionless."""
        rows = self.loop_lengths * self.structure.row_sizes
        return read_only(self.column_scale[self.following] / rows[:, None])

    def actuated_coordinates(self, q: Array) -> Array:
        """Return the motors' joints q_a (T, n_a) at q (T, nq), joint side of the gears [rad, m]."""
        return self.coordinates.positions(q)[:, self.actuated]

    def __repr__(self) -> str:
        """Return name, flexibility, platform axes, motors and springs in one line."""
        return (
            f"ParallelRobot({self.name!r}, {self.flexibility}: platform {', '.join(self.axis_names)}; "
            f"motors {', '.join(self.actuator_names)}; springs {', '.join(self.spring_names) or 'none'})"
        )


def length_units(slides: Iterable[bool]) -> list[str]:
    """Return the unit of each coordinate: m of slides, rad of hinges."""
    return ["m" if slide else "rad" for slide in slides]


def expect_robot(robot: object) -> None:
    """Raise InvalidInput unless this is a robot."""
    expect("robot", robot, ParallelRobot, 'load_robot("five_bar") or load_robot("my_robot.yaml")')


@dataclass(frozen=True, eq=False)
class Equations(ReadOnlyArrays):
    """F = [platform - x ; closures]: n + m equations, and where their Jacobian dF/dq has entries."""

    loops: LoopRows  # the m independent ones
    bodies: IntArray  # (n + m,) the frame that the wrench of each equation acts on
    n: int  # of the platform's equations, which come first
    signs: Array  # (n + m, nv) 1 where the joint moves the second body against the first, -1 reversed, else 0
    couplings: Array  # (n + m, nv) derivatives of equations between joints themselves, else 0
    pattern: BoolArray  # (n + m, nv) whether dF/dq has an entry that is not zero by construction
    columns: IntArray  # those that follow when x and q_e are given: actuated, then passive
    moving_part: SquarePart | None  # all rows, these columns; None if planning is not possible
    passive_part: SquarePart | None  # loops only, the passive columns; None with redundant motors

    @staticmethod
    def of(
        mechanism: Mechanism, platform: PlatformCoordinates, loops: LoopRows, columns: IntArray, n_a: int
    ) -> Equations:
        """Return the table of loop equations and `columns`, of which the first n_a have motors."""
        carried, n = scratch_of(mechanism).carried, platform.n
        signs = np.concatenate([platform.joint_incidence(carried[0]), loops.joint_signs(carried)])
        couplings = np.zeros_like(signs)
        couplings[n:] = loops.coupling_jacobian(signs.shape[1])
        pattern = (signs != 0.0) | (couplings != 0.0)
        rows = np.arange(len(signs))
        return Equations(
            loops=loops,
            bodies=np.concatenate([np.zeros(n, dtype=np.intp), loops.second]),
            n=n,
            signs=signs,
            couplings=couplings,
            pattern=pattern,
            columns=columns,
            moving_part=SquarePart.of(pattern, rows, columns),
            passive_part=SquarePart.of(pattern, rows[n:], columns[n_a:]),
        )

    def jacobian(self, wrenches: Array, screws: Array) -> Array:
        """Compute dF/dq (T, n + m, nv), the powers of wrenches on screws.

        Wrenches (T, n + m, 6) and screws (T, nv, 6) are about the base's origin.
        """
        return (wrenches @ screws.swapaxes(1, 2)) * self.signs + self.couplings


@dataclass(frozen=True, eq=False)
class SquarePart(ReadOnlyArrays):
    """The entries of a square part of matrices, in the memory of the whole and in a band matrix."""

    entries: IntArray  # (E,) places in the memory of a whole matrix
    band: Band

    @staticmethod
    def of(pattern: BoolArray, rows: IntArray, columns: IntArray) -> SquarePart | None:
        """Return the entries of a pattern in some rows and columns.

        None unless the columns are as many as the rows.
        """
        if not len(rows) == len(columns) > 0:
            return None
        i, j = np.nonzero(pattern[rows][:, columns])  # (E,) each, in the square part
        entries = rows[i] * pattern.shape[1] + columns[j]  # in the whole matrix, row by row
        return SquarePart(entries, Band.of(i, j, len(rows)))

    def factor(self, matrices: Array) -> Factors:
        """Factor this part (T, k, k) of matrices (T, r, c)."""
        count, rows, columns = matrices.shape
        values = matrices.reshape(count, rows * columns).take(self.entries, axis=1)  # (T, E)
        return self.band.factor(values)
