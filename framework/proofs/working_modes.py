"""All configurations for a given pose of the platform: the working modes, leg by leg.

Newton's method solves the inverse kinematics from many starts. The distinct solutions of each leg (`legs`)
are combined in every way that closes the loops, and each configuration is proved to exist and to be single
(Newton and Kantorovich). If a leg has at most four joints, at most one of them a slide, paving the joints
proves that it has no other solutions (`leg_paving`). With this proof for all legs, all working modes are
known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, product
from math import prod

import numpy as np

from framework.errors import finite_numbers
from framework.kinematics.frames import FrameStack, integrate_columns
from framework.kinematics.inverse_kinematics import remove_idle_spin, require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import Leg, leg_signs, legs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.proofs.homotopy import Status
from framework.proofs.leg_paving import are_leg_solutions_complete
from framework.proofs.passive_joints import (
    RANDOM_STARTS,
    close_all_loops,
    distinct_rows,
    draw_starts,
    has_one_solution_near,
    shortest_offset,
)
from framework.tolerances import LOOP_GAP

MAX_COMBINATIONS = 512  # of one solution for each leg


@dataclass(frozen=True, eq=False)
class WorkingMode(ReadOnlyArrays):
    """A solution of the inverse kinematics."""

    q: Array  # (nq,) configuration
    motors: Array  # (n_a,) motor joints, joint side of the gears
    signs: Array  # (legs,) of the determinant of each leg, 0 at Type 1
    proved: bool  # to exist, and to be the only solution in a neighbourhood
    within_limits: bool  # of the joints in the URDF


@dataclass(frozen=True, eq=False)
class WorkingModes:
    """The working modes among at most MAX_COMBINATIONS of the legs' solutions."""

    # those within joint limits first, then by their distance from the reference
    modes: tuple[WorkingMode, ...]
    solutions: tuple[int, ...]  # number of solutions of each leg
    legs: tuple[tuple[str, ...], ...]  # the motors of each leg
    proved_legs: tuple[bool, ...]  # whether each leg has no other solutions beside the legs it depends on
    truncated: bool  # whether there are more combinations than were tested

    @property
    def status(self) -> Status:
        """Whether the modes are proved to be all, or at least so many exist."""
        proved = all(mode.proved for mode in self.modes) and not self.truncated
        return "proved" if proved and all(self.proved_legs) else "at least"

    @property
    def sentence(self) -> str:
        """The numbers of modes and of solutions of each leg, in a sentence."""
        proved = sum(mode.proved for mode in self.modes)
        inside = sum(mode.within_limits for mode in self.modes)
        leg_counts = []
        for count, motors, all_known in zip(self.solutions, self.legs, self.proved_legs, strict=True):
            number = f"{count}" if all_known else f"{count} or more"
            leg_counts.append(f"{number} of {' and '.join(motors) or 'joints without a motor'}")
        total = f"{proved}, proved to be all" if self.status == "proved" else f"at least {proved}"
        return (
            f"{total}, each proved to exist and to be single ({', '.join(leg_counts)}); "
            f"{inside} within the joints' limits"
        )


def working_modes(robot: ParallelRobot, x: ArrayLike) -> WorkingModes:
    """Find all solutions of the inverse kinematics at platform coordinates x (n,), springs at rest.

    Raises:
        InvalidInput: x has the wrong length or is not finite, or the platform does not determine the joints.
    """
    expect_robot(robot)
    require_square(robot)
    x = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    # combine the solutions of the legs to modes
    solutions = _search_leg_solutions(robot, x)
    modes = _closed_modes(robot, _combine_solutions(robot, solutions), x)

    # prove that each leg has no other solutions
    q = np.array([mode.q for mode in modes]).reshape(-1, robot.model.nq)  # (0, nq) without modes
    robot_legs = legs(robot)
    counts = tuple(map(len, solutions))
    proved_legs = [
        _is_leg_complete(robot, leg, joints, q, x) for leg, joints in zip(robot_legs, solutions, strict=True)
    ]
    return WorkingModes(
        modes=tuple(modes),
        solutions=counts,
        legs=tuple(leg.motors for leg in robot_legs),
        proved_legs=tuple(proved_legs),
        truncated=prod(counts) > MAX_COMBINATIONS,
    )


def _search_leg_solutions(robot: ParallelRobot, x: Array) -> list[Array]:
    """Search the solutions (solutions, k) of each leg of k joints, with the platform at x (n,).

    Solutions are offsets of the joints from the reference [rad, robot lengths]. Newton's method solves the
    equations of loops and platform from random starts.
    """
    scale = robot.platform_scale
    columns = robot.moving

    def platform_equations(frames: FrameStack) -> tuple[Array, Array]:
        """Compute dimensionless offsets (T, n) of the platform from x, and their slopes (T, n, nv)."""
        offsets = robot.platform.residual(frames, np.tile(x, (len(frames.q), 1))) / scale
        return offsets, robot.platform.jacobian(frames) * robot.column_scale / scale[:, None]

    starts = draw_starts(robot, robot.reference.q, columns, RANDOM_STARTS)
    ends, closed = close_all_loops(robot, starts, columns, platform_equations)
    q = ends[closed]  # (T, nq)
    # an idle spin would make equal solutions differ
    q = remove_idle_spin(robot, robot.reference.q, q, np.tile(x, (len(q), 1)))

    offsets = (shortest_offset(robot, q) / robot.column_scale)[:, columns]  # (T, moving joints)
    solutions = []
    for leg in legs(robot):
        joints = offsets[:, leg.columns]
        solutions.append(joints[distinct_rows(joints)])
    return solutions


def _combine_solutions(robot: ParallelRobot, solutions: list[Array]) -> Array:
    """Return up to MAX_COMBINATIONS configurations (T, nq), with one solution of each leg.

    `solutions` (solutions, k) of each leg are offsets from the reference [rad, robot lengths].
    """
    columns = np.concatenate([robot.moving[leg.columns] for leg in legs(robot)])
    combinations = islice(product(*solutions), MAX_COMBINATIONS)
    offsets = np.reshape([np.concatenate(joints) for joints in combinations], (-1, len(columns)))  # (T, k)
    steps = offsets * robot.column_scale[columns]  # [rad, m]
    return integrate_columns(robot, robot.reference.q, columns, steps)


def _is_leg_complete(robot: ParallelRobot, leg: Leg, solutions: Array, q: Array, x: Array) -> bool:
    """Return whether a leg of k joints provably has no solutions besides `solutions` (s, k).

    Solutions are offsets from the reference [rad, robot lengths]. The legs on which this leg depends are
    placed as in each of the modes q (T, nq) in turn, with the platform at x (n,). Without modes, T = 0, the
    proof is that the leg has no solution at all. It is made only for a leg that depends on no other one, and
    only for a platform without attitude, because no mode shows where other legs and the attitude are.
    """
    # columns of the velocity vector: of the leg's joints, and of the legs on which this leg depends
    columns = robot.moving[leg.columns]
    previous = robot.moving[leg.needed]
    fixed = np.ones(robot.model.nv, dtype=bool)  # joints that the proof keeps where they are
    fixed[robot.moving] = False
    fixed[previous] = True
    if not len(q):
        if len(previous) or not robot.platform.is_point:
            return False
        no_solutions = solutions[:0]  # (0, k)
        return are_leg_solutions_complete(robot, columns, fixed, robot.reference.q, no_solutions, x)
    offsets = shortest_offset(robot, q) / robot.column_scale
    # modes with the same placement of the previous legs need one proof
    return all(
        are_leg_solutions_complete(robot, columns, fixed, q[mode], solutions - offsets[mode, columns], x)
        for mode in distinct_rows(offsets[:, previous])
    )


def _closed_modes(robot: ParallelRobot, q: Array, x: Array) -> list[WorkingMode]:
    """Return the modes among q (T, nq), the configurations with closed loops at x (n,).

    Modes within the joint limits come first. Among them, and among the others, the nearest to the reference
    comes first.
    """
    if not len(q):
        return []
    linearised = linearised_at(robot, q, np.tile(x, (len(q), 1)))
    signs = leg_signs(robot, linearised)
    motors = robot.actuated_coordinates(q)
    units = np.concatenate([robot.platform_scale, robot.loop_lengths])  # of the equations
    is_closed = np.abs(linearised.residual / units).max(axis=1) < LOOP_GAP
    within_limits = np.all(shares_beyond_limits(robot.limits, q) <= 0.0, axis=1)  # > 0 beyond a limit
    distances = np.abs(shortest_offset(robot, q)).sum(axis=1)  # (T,) [rad, m], only to sort the modes
    modes = []
    for k in np.lexsort([distances, ~within_limits]):  # the last key comes first
        if is_closed[k]:
            proved = has_one_solution_near(robot, q[k], platform_locked=True)
            modes.append(WorkingMode(q[k], motors[k], signs[k], proved, bool(within_limits[k])))
    return modes
