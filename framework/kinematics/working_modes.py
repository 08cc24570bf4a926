"""All joints for a given platform: the working modes, leg by leg.

The inverse kinematics is solved by Newton's method from many starts; the solutions of each leg (`legs`) are
told apart and put together in every way that closes the loops. Each is proved to exist and to be single
(Newton and Kantorovich). That a leg has no others is proved where its joints are few, four at most and one of
them a slide, by paving their angles (`leg_paving`); where all legs are, all working modes are known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, product
from math import prod

import numpy as np

from framework.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.errors import finite_numbers
from framework.kinematics.frames import FrameStack, between, integrate
from framework.kinematics.idle_spin import without_spin
from framework.kinematics.inverse_kinematics import require_square, system_at
from framework.kinematics.joint_limits import positions_beyond_limits
from framework.kinematics.leg_paving import joints_have_no_others
from framework.kinematics.legs import Leg, leg_signs, legs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.passive_joints import (
    are_alike,
    distinct_joints,
    is_proved,
    loops_closed,
    random_starts,
)
from framework.linalg.real_displacements import Status

STARTS = 300
CLOSED = 1e-6  # [m, rad] loops of a combination that are closed
MOST_MODES = 512  # combinations of the legs' solutions that are looked at


@dataclass(frozen=True, eq=False)
class WorkingMode(ReadOnlyArrays):
    """One way in which the legs carry the platform."""

    q: Array  # (nq,)
    motors: Array  # (n_a,) joint side
    signs: Array  # (legs,) see `leg_signs`
    proved: bool  # that it exists and is single in a neighbourhood
    within_limits: bool  # of the joints in the URDF


@dataclass(frozen=True, eq=False)
class WorkingModes:
    """The working modes that were found, of at most `MOST_MODES` combinations."""

    # within the joints' limits first, then by their distance from the reference
    modes: tuple[WorkingMode, ...]
    solutions: tuple[int, ...]  # of each leg
    legs: tuple[tuple[str, ...], ...]  # the motors of each leg
    proved_legs: tuple[bool, ...]  # that have no other solutions, with the legs before them as in the modes
    truncated: bool  # not all combinations were looked at

    @property
    def status(self) -> Status:
        """In which sense they are all: proved, or at least so many exist."""
        known = all(mode.proved for mode in self.modes) and not self.truncated
        return "proved" if known and all(self.proved_legs) else "at least"

    @property
    def sentence(self) -> str:
        """How many there are, and of which leg."""
        proved = sum(mode.proved for mode in self.modes)
        inside = sum(mode.within_limits for mode in self.modes)
        each = ", ".join(
            f"{count}{'' if all_known else ' or more'} of {' and '.join(motors) or 'joints without a motor'}"
            for count, motors, all_known in zip(self.solutions, self.legs, self.proved_legs, strict=True)
        )
        within = f"{inside} within the joints' limits"
        count = f"{proved}, proved to be all" if self.status == "proved" else f"at least {proved}"
        return f"{count}, each proved to exist and to be single ({each}); {within}"


def working_modes(robot: ParallelRobot, x: ArrayLike) -> WorkingModes:
    """Every solution of the inverse kinematics at platform coordinates x (n,), springs at rest.

    Raises:
        InvalidInput: x has the wrong length or is not finite, or the platform does not determine the joints.
    """
    expect_robot(robot)
    require_square(robot)
    target = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    scale = np.where(robot.translations, robot.length, 1.0)

    def platform_rows(at: FrameStack) -> tuple[Array, Array]:
        off = robot.platform.residual(at, np.repeat(target[None], len(at.position), axis=0))
        return off / scale, robot.platform.jacobian(at) * robot.column_scale / scale[:, None]

    columns, reference = robot.moving, robot.reference.q[None]
    starts = random_starts(robot, reference, STARTS, columns)
    q, closed = loops_closed(robot, starts, platform_rows, columns)
    found_at = np.repeat(target[None], int(closed.sum()), axis=0)
    poses = without_spin(robot, robot.reference.q, q[closed], found_at)
    ways = np.array([_way(robot, pose) for pose in poses]).reshape(-1, robot.model.nv)
    solutions = [
        distinct_joints(ways[:, columns[leg.columns]] / robot.column_scale[columns[leg.columns]])
        for leg in legs(robot)
    ]
    combined = []
    for chosen in islice(product(*solutions), MOST_MODES):
        way = np.zeros(robot.model.nv)
        for leg, joints in zip(legs(robot), chosen, strict=True):
            way[columns[leg.columns]] = joints * robot.column_scale[columns[leg.columns]]
        combined.append(integrate(robot, robot.reference.q, way))
    found = _closed_modes(robot, np.array(combined).reshape(-1, robot.model.nq), target)
    found.sort(key=lambda mode: (not mode.within_limits, float(np.abs(_way(robot, mode.q)).sum())))
    poses = np.array([mode.q for mode in found]).reshape(-1, robot.model.nq)
    return WorkingModes(
        modes=tuple(found),
        solutions=tuple(len(each) for each in solutions),
        legs=tuple(leg.motors for leg in legs(robot)),
        proved_legs=tuple(
            _has_no_others(robot, leg, np.array(own), poses, target)
            for leg, own in zip(legs(robot), solutions, strict=True)
        ),
        truncated=prod(len(each) for each in solutions) > MOST_MODES,
    )


def _has_no_others(robot: ParallelRobot, leg: Leg, solutions: Array, q: Array, x: Array) -> bool:
    """Whether a leg is proved to have no solutions but these (k, n), as ways from the reference.

    With the legs before it as in any of the modes q (T, nq); without modes, if it stands alone.
    """
    columns, before = robot.moving[leg.columns], robot.moving[leg.before]
    given = np.ones(robot.model.nv, dtype=bool)
    given[robot.moving] = False
    given[before] = True
    if not len(q):
        alone = not len(before) and robot.platform.is_point
        q = robot.reference.q[None]
        return alone and joints_have_no_others(
            robot, columns, given, q[0], solutions.reshape(0, len(columns)), x
        )
    ways = np.array([_way(robot, pose) for pose in q]) / robot.column_scale
    apart = [
        next(k for k, way in enumerate(ways[:, before]) if are_alike(way, one))
        for one in distinct_joints(ways[:, before])
    ]
    return all(
        joints_have_no_others(robot, columns, given, q[k], solutions - ways[k, columns], x) for k in apart
    )


def _closed_modes(robot: ParallelRobot, q: Array, x: Array) -> list[WorkingMode]:
    """Those of the configurations (T, nq) whose loops are closed with the platform at x (n,)."""
    if not len(q):
        return []
    system = system_at(robot, q, np.repeat(x[None], len(q), axis=0))
    signs, motors = leg_signs(robot, system), robot.actuated_coordinates(q)
    closed = np.abs(system.residual).max(axis=1) < CLOSED * max(robot.length, 1.0)
    return [
        WorkingMode(
            q=q[k],
            motors=motors[k],
            signs=signs[k],
            proved=is_proved(robot, q[k], locked="platform"),
            within_limits=not positions_beyond_limits(robot.limits, q[k : k + 1]),
        )
        for k in np.flatnonzero(closed)
    ]


def _way(robot: ParallelRobot, q: Array) -> Array:
    """From the reference to q (nq,), all hinges the short way round (nv,)."""
    way = between(robot, robot.reference.q, q)
    hinges = ~robot.sliding
    way[hinges] = np.mod(way[hinges] + np.pi, 2 * np.pi) - np.pi
    return way
