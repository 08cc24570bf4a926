"""All joints for a given platform: the working modes, leg by leg.

The inverse kinematics is solved by Newton's method from many starts; the solutions of each leg (`legs`) are
told apart and put together in every way that closes the loops. Each is proved to exist and to be single
(Newton and Kantorovich); that there are no others is not, so their number is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from framework.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.errors import finite_numbers
from framework.kinematics.frames import FrameStack, between, integrate
from framework.kinematics.idle_spin import without_spin
from framework.kinematics.inverse_kinematics import require_square, system_at
from framework.kinematics.joint_limits import positions_beyond_limits
from framework.kinematics.legs import leg_signs, legs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.passive_joints import is_proved, loops_closed, random_starts

STARTS = 300
ALIKE = 1e-6  # [rad, lengths] between joints that are one solution
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
    """The working modes that were found, of at most `MOST_MODES` combinations; at least so many exist."""

    modes: tuple[
        WorkingMode, ...
    ]  # within the joints' limits first, then by their distance from the reference
    solutions: tuple[int, ...]  # of each leg
    legs: tuple[tuple[str, ...], ...]  # the motors of each leg

    @property
    def sentence(self) -> str:
        """How many there are, and of which leg."""
        proved = sum(mode.proved for mode in self.modes)
        inside = sum(mode.within_limits for mode in self.modes)
        each = ", ".join(
            f"{count} of {' and '.join(motors) or 'joints without a motor'}"
            for count, motors in zip(self.solutions, self.legs, strict=True)
        )
        within = f"{inside} within the joints' limits"
        return f"at least {proved}, each proved to exist and to be single ({each}); {within}"


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
        _distinct(ways[:, columns[leg.columns]] / robot.column_scale[columns[leg.columns]])
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
    return WorkingModes(
        tuple(found), tuple(len(each) for each in solutions), tuple(leg.motors for leg in legs(robot))
    )


def _closed_modes(robot: ParallelRobot, q: Array, x: Array) -> list[WorkingMode]:
    """Those of the configurations (T, nq) whose loops are closed with the platform at x (n,)."""
    if not len(q):
        return []
    system = system_at(robot, q, np.repeat(x[None], len(q), axis=0))
    signs, motors = leg_signs(robot, system), robot.actuated_coordinates(q)
    closed = np.abs(system.residual).max(axis=1) < ALIKE * max(robot.length, 1.0)
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


def _distinct(joints: Array) -> list[Array]:
    """The rows of (T, k) that differ from all before them, hinges up to whole turns."""
    found: list[Array] = []
    for row in joints:
        if all(np.abs(np.exp(1j * row) - np.exp(1j * other)).max() > ALIKE for other in found):
            found.append(row)
    return found
