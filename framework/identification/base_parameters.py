"""Base parameters: the combinations of inertial and motor parameters that motor torques determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import NotAssembled, NotConverged
from framework.identification.combinations import (
    Combinations,
    find_combinations,
    format_combination,
)
from framework.identification.torque_parameters import (
    TorqueParameters,
    gravity_scale,
    parameter_regressor,
    torque_parameters,
)
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.inverse_kinematics import close_each, close_loops, require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.tolerances import BRANCHES_MEET, MIN_RANK_GAP

RANDOM_SETS = 3  # of instants, whose ranks must agree
ROWS_PER_PARAMETER = 1.5  # of a set
STEP = 0.5  # [rad, robot lengths] largest move of the platform in a step of a random walk
# steps of each random walk; of walks that have not moved by then, each further step half as long
STEPS, MAX_STEPS = 16, 36


@dataclass(frozen=True, eq=False)
class BaseParameters(ReadOnlyArrays):
    """The base parameters of a robot on its closed loops, by name.

    Attributes:
        rank: number of base parameters.
        gap: least ratio, over all random sets of instants, of the last singular value within the rank to the
            first beyond it.
        names: of the base parameters, each a combination of `parameters`.
        without_effect: parameters on which no torque depends.
        left_out: links without mass in the file, whose parameters are not identified.
    """

    robot: ParallelRobot
    rank: int
    gap: float
    names: tuple[str, ...]
    parameters: tuple[str, ...]
    without_effect: tuple[str, ...]
    left_out: tuple[str, ...]
    values: Array  # (rank,) of the robot's file, SI units
    described: TorqueParameters
    combinations: Combinations

    @property
    def certain(self) -> bool:
        """Whether the gap is large enough for the rank to be certain."""
        return self.gap >= MIN_RANK_GAP


def base_parameters(robot: ParallelRobot, *, massless: bool = False) -> BaseParameters:
    """Compute the parameter combinations that motor torques determine.

    These are the combinations that all motions near the reference determine together; a single line
    determines fewer. Their number is the rank of the closed robot's regressor (`parameter_regressor`) at
    random instants. Several sets of instants must have the same rank.

    They are the combinations that all motions near the reference determine together; a single line determines
    fewer. Their number is the rank of the closed robot's regressor (`parameter_regressor`) at random
    instants. Several sets of instants must have the same rank.

    Args:
        massless: whether bodies without mass in the file have parameters, too.

    Raises:
        InvalidInput: a robot with springs, or whose platform does not determine its joints.
        NotConverged: the sets of instants do not agree on the rank.
    """
    expect_robot(robot)
    described = torque_parameters(robot, massless=massless)
    random = np.random.default_rng(0)
    count = int(np.ceil(ROWS_PER_PARAMETER * len(described.names) / robot.n))
    sets = []
    for _ in range(RANDOM_SETS):
        matrix = parameter_regressor(robot, random_motion(robot, count, random), described).matrix
        # equal weights of instants, as forces are large near a singularity of the inverse kinematics
        matrix /= np.linalg.norm(matrix * described.sizes, axis=(1, 2))[:, None, None]
        sets.append(find_combinations(matrix.reshape(-1, matrix.shape[2]), described.sizes))
    ranks = [combinations.rank for combinations in sets]
    least = min(sets, key=lambda combinations: combinations.gap)
    if len(set(ranks)) > 1:
        raise NotConverged(
            f"{robot.name}: random instants give base parameters of rank {', '.join(map(str, ranks))}; the "
            f"singular values leave no clear gap",
            residual=1.0 / least.gap,
        )
    all_links = torque_parameters(robot, massless=True).links
    return BaseParameters(
        robot=robot,
        rank=least.rank,
        gap=least.gap,
        names=tuple(format_combination(described.names, row) for row in least.coefficients),
        parameters=described.names,
        without_effect=tuple(described.names[k] for k in least.without_effect),
        left_out=tuple(link for link in all_links if link not in described.links),
        values=least.coefficients @ described.values,
        described=described,
        combinations=least,
    )


def random_motion(robot: ParallelRobot, count: int, random: np.random.Generator) -> Motion:
    """Draw poses, rates and accelerations near the reference at `count` instants.

    Rates are of the size sqrt(g / length), accelerations g: inertial forces are as large as the weight.

    Raises:
        InvalidInput: the platform does not determine the joints.
        NotAssembled: the loops close nowhere near the reference.
    """
    require_square(robot)
    q, x = _random_poses(robot, count, random)
    rate = np.sqrt(gravity_scale(robot) / robot.length)
    dx = rate * robot.platform_scale * random.standard_normal((count, robot.n))
    ddx = rate**2 * robot.platform_scale * random.standard_normal((count, robot.n))
    return motion_at(robot, close_loops(robot, x, q), dx, ddx)


def _random_poses(robot: ParallelRobot, count: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw assembled configurations q (count, nq) and platform coordinates x (count, n).

    Each is the end of a random walk from the reference. A step is rejected if the loops do not close at its
    end, or if the end is near a singularity. After STEPS steps only walks without an accepted step continue,
    with shorter ones.
    """
    q = np.repeat(robot.reference.q[None], count, axis=0)
    x = np.repeat(robot.reference.x[None], count, axis=0)
    is_done = np.zeros(count, dtype=bool)
    has_moved = is_done.copy()
    for k in range(MAX_STEPS):
        if k >= STEPS:
            is_done = has_moved.copy()
            if is_done.all():
                break
        step = STEP * robot.platform_scale * random.uniform(-1.0, 1.0, (count, robot.n))
        target = x + step * 0.5 ** max(k - STEPS, 0)
        closed = close_each(robot, target, q, farthest=MAX_NEWTON_STEP)
        accepted = closed.closed & ~is_done  # (count,)
        accepted[accepted] = clearance(robot, linearised_at(robot, closed.q[accepted], None)) > BRANCHES_MEET
        q[accepted] = closed.q[accepted]
        x[accepted] = target[accepted]
        has_moved |= accepted
    if has_moved.all():
        return q, x
    raise NotAssembled(
        f"{robot.name}: the loops close at no pose beside the reference",
        q=robot.reference.q,
        residual=robot.reference.residual,
    )
