"""All configurations for a given pose of the platform: the working modes, leg by leg (`leg_solutions`).

Each configuration is proved to exist and to be single (Newton and Kantorovich). With the proof for all legs
that they have no other solutions, all working modes are known.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from warnings import warn

import numpy as np

from framework.errors import finite_numbers
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.proofs.homotopy import Status
from framework.proofs.leg_solutions import MAX_COMBINATIONS, solve_legs
from framework.proofs.passive_joints import has_one_solution_near, shortest_offset, turn_within_ranges


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
    """The working modes among at most `leg_solutions.MAX_COMBINATIONS` of the legs' solutions."""

    # those within joint limits first, then by their distance from the reference
    modes: tuple[WorkingMode, ...]
    solutions: tuple[int, ...]  # number of solutions of each leg
    legs: tuple[tuple[str, ...], ...]  # the motors of each leg
    proved_legs: tuple[bool, ...]  # whether each leg has no other solutions beside the legs it depends on
    are_all: bool  # whether there are provably no other configurations

    @property
    def truncated(self) -> bool:
        """Deprecated: whether there are more combinations of solutions than are tested; see `are_all`."""
        warn("WorkingModes.truncated goes in 0.9: see are_all", DeprecationWarning, stacklevel=2)
        return prod(self.solutions) > MAX_COMBINATIONS

    @property
    def status(self) -> Status:
        """Whether the modes are proved to be all, or at least so many exist."""
        proved = all(mode.proved for mode in self.modes)
        return "proved" if proved and self.are_all else "at least"

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

    Modes within the joint limits come first. Among them, and among the others, the nearest to the reference
    comes first.

    Raises:
        InvalidInput: x has the wrong length or is not finite, or the platform does not determine the joints.
    """
    require_square(robot)
    x = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    solutions = solve_legs(robot, robot.reference.q, robot.moving, x)
    q = turn_within_ranges(robot, solutions.q, robot.joints)  # (T, nq)
    signs = leg_signs(robot, linearised_at(robot, q, np.tile(x, (len(q), 1))))
    motors = robot.actuated_coordinates(q)
    within_limits = np.all(shares_beyond_limits(robot.limits, q) <= 0.0, axis=1)  # > 0 beyond a limit
    distances = np.abs(shortest_offset(robot, q)).sum(axis=1)  # (T,) [rad, m], only to sort the modes
    modes = []
    for k in np.lexsort([distances, ~within_limits]):  # the last key comes first
        proved = has_one_solution_near(robot, q[k], platform_locked=True)
        modes.append(WorkingMode(q[k], motors[k], signs[k], proved, bool(within_limits[k])))
    return WorkingModes(
        modes=tuple(modes),
        solutions=solutions.counts,
        legs=tuple(leg.motors for leg in solutions.legs),
        proved_legs=solutions.complete,
        are_all=solutions.are_all,
    )
