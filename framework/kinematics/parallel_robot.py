"""A parallel robot: a mechanism with a platform and motors, assembled, and what counts of it proved."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray, read_only
from framework.errors import expect
from framework.kinematics.assembly import (
    Configuration,
    close_reference,
    nearby_configurations,
)
from framework.kinematics.equations import Equations
from framework.kinematics.frames import frames_at
from framework.kinematics.independence import (
    idle_columns,
    independent_rows,
    motion_matrix,
    rows_of_springs_alone,
    singular_reference,
)
from framework.kinematics.mechanism import Mechanism, columns_of
from framework.kinematics.platform import PlatformCoordinates
from framework.model.loop_rows import LoopRows

UNLIKE = 0.02  # a loop equation below this share of a unit motion, or above its inverse, is brought to it


@dataclass(frozen=True, eq=False, repr=False)
class ParallelRobot(Mechanism):
    """A mechanism that is assembled: which of its coordinates are what, and which loop equations count.

    `actuated` (n_a,), `elastic` (n_e,) and `passive` (n_p,) index pinocchio's velocity vector, in the
    order of the robot file for the first two. q_a is the joint side of the gear; the motor angle is
    gear_ratio * q_a.

    `dataclasses.replace` keeps what was proved: it is for other masses, springs and motors, and for lengths
    that are a little off. Where more is changed, `ParallelRobot.of` proves it anew.
    """

    platform: PlatformCoordinates
    actuated: IntArray
    passive: IntArray
    gear_ratio: Array  # (n_a,) motor angle over joint angle
    rotor_inertia: Array  # (n_a,) [kg m^2], motor side
    reference: Configuration  # assembled; fixes the working and the assembly mode
    independent: IntArray  # (m,) ascending, of `rows`: the loop equations that do not repeat others
    springs_alone: tuple[str, ...]  # names of those that springs can move and joints cannot
    idle: IntArray  # passive joints to hold still because their motion moves nothing
    equations: Equations  # the independent loops and the platform, and where their Jacobian has entries
    row_sizes: Array  # (m,) divides the loop equations where rank is judged, see `_row_sizes`
    elastic_inertia: bool = True  # False: a model whose bodies do not feel how the springs move

    @classmethod
    def of(cls, mechanism: Mechanism) -> Self:
        """The robot that a mechanism is with the platform and the motors of its description.

        Raises:
            NotAssembled: the loops do not close near the reference, see `close_reference`.
            SingularReference: the reference is on a singularity of the loops, see `singular_reference`.
        """
        numbers, description = vars(Mechanism.of(mechanism)), mechanism.description
        platform = PlatformCoordinates.of(description.platform, mechanism.model)
        actuated = columns_of(mechanism.model, (actuator.joint for actuator in description.actuators))
        passive = np.setdiff1d(mechanism.joints, actuated)
        closed = close_reference(mechanism)
        poses = (closed.q, *nearby_configurations(mechanism, closed.q))
        matrices = [motion_matrix(mechanism, platform, q) for q in poses]
        singular = singular_reference(mechanism, passive, poses, matrices)
        if singular is not None:
            raise singular
        here = matrices[0][platform.n :]
        independent = independent_rows(here[:, mechanism.joints])
        idle = idle_columns(matrices[0][:, passive], passive)
        moving = np.concatenate([actuated, np.setdiff1d(passive, idle)])
        loops = mechanism.rows.take(independent)
        x = platform.coordinates(frames_at(mechanism, closed.q[None]))[0]
        return cls(
            **numbers,
            platform=platform,
            actuated=actuated,
            passive=passive,
            gear_ratio=np.array([actuator.gear_ratio for actuator in description.actuators]),
            rotor_inertia=np.array([actuator.rotor_inertia for actuator in description.actuators]),
            reference=Configuration(closed.q, x, closed.residual, closed.iterations),
            independent=independent,
            springs_alone=rows_of_springs_alone(mechanism, independent, matrices),
            idle=idle,
            equations=Equations.of(mechanism, platform, loops, moving, len(actuated)),
            row_sizes=_row_sizes(here[independent][:, moving]),
        )

    @property
    def n(self) -> int:
        """Number of platform coordinates."""
        return self.equations.n

    @property
    def n_a(self) -> int:
        return len(self.actuated)

    @property
    def n_p(self) -> int:
        return len(self.passive)

    @property
    def loops(self) -> LoopRows:
        """The table of the independent loop equations."""
        return self.equations.loops

    @property
    def moving(self) -> IntArray:
        """The columns that follow when x and q_e are given: actuated, then passive but for the idle ones."""
        return self.equations.columns

    @cached_property
    def following(self) -> IntArray:
        """The passive joints that follow the platform and the motors: all but the idle ones."""
        return read_only(self.equations.columns[self.n_a :])

    @property
    def translations(self) -> NDArray[np.bool_]:
        """Which of the platform's coordinates are translations, (n,) [m]; the others are turns [rad]."""
        return self.platform.translations

    @cached_property
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
    def axis_names(self) -> tuple[str, ...]:
        """Names of the platform coordinates, e.g. ("x", "y"), or those of joints."""
        return self.description.platform.names

    @cached_property
    def row_lengths(self) -> Array:
        """What makes `rows` angles and lengths of the robot by division, (rows,): 1 where they turn."""
        return read_only(np.where(self.rows.rotation, 1.0, self.length))

    @cached_property
    def passive_scale(self) -> Array:
        """What makes the passive columns of the loop equations dimensionless by multiplication, (m, n_p)."""
        rows = self.row_lengths[self.independent] * self.row_sizes
        return read_only(self.column_scale[self.following] / rows[:, None])

    def actuated_coordinates(self, q: Array) -> Array:
        """The motors' joints q_a (T, n_a) at q (T, nq), joint side of the gears [rad, m]."""
        return self.positions(q)[:, self.actuated]

    def __repr__(self) -> str:
        return (
            f"ParallelRobot({self.name!r}, {self.flexibility}: platform {', '.join(self.axis_names)}; "
            f"motors {', '.join(self.actuator_names)}; springs {', '.join(self.elastic_names) or 'none'})"
        )


def expect_robot(given: object) -> None:
    """Raise InvalidInput unless what was given is a robot."""
    expect("robot", given, ParallelRobot, 'robots.load("five_bar") or ParallelRobot.from_file("my.yaml")')


def _row_sizes(loops: Array) -> Array:
    """What makes the largest entry of each loop equation (m, columns) 1 at the reference, if far from that.

    An equation may be written in any unit, or as any multiple of itself: none of that is a singularity.
    """
    sizes = np.abs(loops).max(axis=1, initial=0.0)
    return np.where((sizes < UNLIKE) | (sizes > 1 / UNLIKE), np.maximum(sizes, 1e-300), 1.0)
