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

from framework.errors import finite_numbers
from framework.kinematics.frames import FrameStack, integrate_columns
from framework.kinematics.inverse_kinematics import remove_idle_spin, require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import Leg, leg_signs, legs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.proofs.leg_paving import are_leg_solutions_complete
from framework.proofs.passive_joints import (
    close_all_loops,
    distinct_rows,
    draw_starts,
    has_one_solution_near,
    shortest_offset,
)
from framework.proofs.real_displacements import Status
from framework.tolerances import LOOP_GAP

RANDOM_STARTS = 300
MAX_COMBINATIONS = 512  # of the legs' solutions


@dataclass(frozen=True, eq=False)
class WorkingMode(ReadOnlyArrays):
    """A solution of the inverse kinematics."""

    q: Array  # (nq,)
    motors: Array  # (n_a,) joint side
    signs: Array  # (legs,) see `leg_signs`
    proved: bool  # that it exists and is single in a neighbourhood
    within_limits: bool  # of the joints in the URDF


@dataclass(frozen=True, eq=False)
class WorkingModes:
    """The working modes found, of at most MAX_COMBINATIONS of the legs' solutions."""

    # within the joints' limits first, then by their distance from the reference
    modes: tuple[WorkingMode, ...]
    solutions: tuple[int, ...]  # of each leg
    legs: tuple[tuple[str, ...], ...]  # the motors of each leg
    proved_legs: tuple[bool, ...]  # that have no other solutions, with the legs before them as in the modes
    truncated: bool  # not all combinations were looked at

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
        each = ", ".join(
            f"{count}{'' if all_known else ' or more'} of {' and '.join(motors) or 'joints without a motor'}"
            for count, motors, all_known in zip(self.solutions, self.legs, self.proved_legs, strict=True)
        )
        within = f"{inside} within the joints' limits"
        count = f"{proved}, proved to be all" if self.status == "proved" else f"at least {proved}"
        return f"{count}, each proved to exist and to be single ({each}); {within}"


def working_modes(robot: ParallelRobot, x: ArrayLike) -> WorkingModes:
    """Find all solutions of the inverse kinematics at platform coordinates x (n,).

    Springs at rest.

    Raises:
        InvalidInput: x has the wrong length or is not finite, or the platform does not determine the joints.
    """
    expect_robot(robot)
    require_square(robot)
    x = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    solutions = _search_leg_solutions(robot, x)
    modes = _closed_modes(robot, _combine_solutions(robot, solutions), x)
    modes.sort(
        key=lambda mode: (not mode.within_limits, float(np.abs(_reference_offset(robot, mode.q)).sum()))
    )
    q = np.array([mode.q for mode in modes]).reshape(-1, robot.model.nq)
    return WorkingModes(
        modes=tuple(modes),
        solutions=tuple(len(joints) for joints in solutions),
        legs=tuple(leg.motors for leg in legs(robot)),
        proved_legs=tuple(
            _is_leg_complete(robot, leg, joints, q, x)
            for leg, joints in zip(legs(robot), solutions, strict=True)
        ),
        truncated=prod(len(joints) for joints in solutions) > MAX_COMBINATIONS,
    )


def _search_leg_solutions(robot: ParallelRobot, x: Array) -> list[Array]:
    """Search the joints (solutions, k) of each leg with the platform at x (n,).

    They are offsets from the reference [rad, robot lengths], found by Newton's method from random starts on
    the loops and the platform's coordinates together.
    """
    scale = robot.platform_scale
    columns = robot.moving

    def platform_equations(frames: FrameStack) -> tuple[Array, Array]:
        """Compute the offsets (T, n) of the platform from x, and their slopes (T, n, nv)."""
        offsets = robot.platform.residual(frames, np.tile(x, (len(frames.position), 1))) / scale
        return offsets, robot.platform.jacobian(frames) * robot.column_scale / scale[:, None]

    starts = draw_starts(robot, robot.reference.q[None], RANDOM_STARTS, columns)
    q, closed = close_all_loops(robot, starts, platform_equations, columns)
    q = q[closed]
    q = remove_idle_spin(robot, robot.reference.q, q, np.tile(x, (len(q), 1)))
    offsets = (_reference_offset(robot, q) / robot.column_scale)[:, columns]
    of_legs = [offsets[:, leg.columns] for leg in legs(robot)]
    return [joints[distinct_rows(joints)] for joints in of_legs]


def _reference_offset(robot: ParallelRobot, q: Array) -> Array:
    """Compute offsets (..., nv) of q (..., nq) from the reference, hinges within half a turn."""
    return shortest_offset(robot, q, np.arange(robot.model.nv))


def _combine_solutions(robot: ParallelRobot, solutions: list[Array]) -> Array:
    """Return configurations (T, nq) of all combinations of the legs' solutions.

    One solution of each leg, at most MAX_COMBINATIONS.
    """
    columns = np.concatenate([robot.moving[leg.columns] for leg in legs(robot)])
    combinations = islice(product(*solutions), MAX_COMBINATIONS)
    offsets = np.reshape([np.concatenate(joints) for joints in combinations], (-1, len(columns)))
    offsets = offsets * robot.column_scale[columns]
    return integrate_columns(robot, robot.reference.q, columns, offsets)


def _is_leg_complete(robot: ParallelRobot, leg: Leg, solutions: Array, q: Array, x: Array) -> bool:
    """Return whether a leg provably has no other `solutions` (k, n), off the reference.

    The legs on which it stands are in turn as in each of the modes q (T, nq). Without modes nothing is proved
    unless the leg stands alone.
    """
    columns = robot.moving[leg.columns]
    previous = robot.moving[leg.needed]
    fixed = np.ones(robot.model.nv, dtype=bool)
    fixed[robot.moving] = False
    fixed[previous] = True
    if not len(q):
        stands_alone = not len(previous) and robot.platform.is_point
        return stands_alone and are_leg_solutions_complete(
            robot, columns, fixed, robot.reference.q, solutions[:0], x
        )
    offsets = _reference_offset(robot, q) / robot.column_scale
    return all(
        are_leg_solutions_complete(robot, columns, fixed, q[k], solutions - offsets[k, columns], x)
        for k in distinct_rows(offsets[:, previous])
    )


def _closed_modes(robot: ParallelRobot, q: Array, x: Array) -> list[WorkingMode]:
    """Return the configurations (T, nq) that close the loops with the platform at x, as modes."""
    if not len(q):
        return []
    linearised = linearised_at(robot, q, np.repeat(x[None], len(q), axis=0))
    signs = leg_signs(robot, linearised)
    motors = robot.actuated_coordinates(q)
    lengths = np.concatenate([robot.platform_scale, robot.loop_lengths])
    closed = np.abs(linearised.residual / lengths).max(axis=1) < LOOP_GAP
    return [
        WorkingMode(
            q=q[k],
            motors=motors[k],
            signs=signs[k],
            proved=has_one_solution_near(robot, q[k], locked="platform"),
            within_limits=not positions_beyond_limits(robot.limits, q[k : k + 1]),
        )
        for k in np.flatnonzero(closed)
    ]
