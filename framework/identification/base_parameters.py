"""Base parameters: the combinations of inertial and motor parameters that motor torques determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.errors import NotConverged
from framework.identification.combinations import (
    Combinations,
    combination_text,
    determined_combinations,
)
from framework.identification.random_motions import random_motion
from framework.identification.torque_parameters import (
    TorqueParameters,
    parameter_regressor,
    torque_parameters,
)
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.tolerances import MIN_RANK_GAP

RANDOM_SETS = 3  # of instants, whose ranks must agree
ROWS_PER_PARAMETER = 1.5  # of a set


@dataclass(frozen=True, eq=False)
class BaseParameters(ReadOnlyArrays):
    """The base parameters of a robot on its closed loops, by name.

    Attributes:
        rank: how many there are.
        gap: the last singular value that counts over the first that does not, of the random set of instants
            that has the least.
        names: of the base parameters, each a combination of `parameters`.
        without_effect: parameters that no torque depends on.
        left_out: links without mass in the file, whose parameters are not asked for.
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
        """Whether the gap leaves no doubt about the rank."""
        return self.gap >= MIN_RANK_GAP


def base_parameters(robot: ParallelRobot, *, massless: bool = False, seed: int = 0) -> BaseParameters:
    """Compute which combinations of inertial and motor parameters the motor torques determine.

    Of any motion near the reference, not of one that is given: a line shows less. The rank is that of the
    regressor of the closed robot (`parameter_regressor`) at random instants; several sets of them must agree.

    Args:
        massless: whether bodies without mass in the file have parameters, too.
        seed: of the random instants.

    Raises:
        InvalidInput: a robot with springs, or whose platform does not determine its joints.
        NotConverged: the sets of instants do not agree on the rank.
    """
    expect_robot(robot)
    described = torque_parameters(robot, massless=massless)
    random = np.random.default_rng(seed)
    count = int(np.ceil(ROWS_PER_PARAMETER * len(described.names) / robot.n))
    sets = []
    for _ in range(RANDOM_SETS):
        matrix = parameter_regressor(robot, random_motion(robot, count, random), described).matrix
        # every instant counts alike: near a singularity of the inverse kinematics forces are large
        matrix /= np.linalg.norm(matrix * described.sizes, axis=(1, 2))[:, None, None]
        sets.append(determined_combinations(matrix.reshape(-1, matrix.shape[2]), described.sizes))
    ranks = [each.rank for each in sets]
    if len(set(ranks)) > 1:
        raise NotConverged(
            f"{robot.name}: random instants give base parameters of rank {', '.join(map(str, ranks))}; the "
            f"singular values leave no clear gap",
            residual=max(1.0 / each.gap for each in sets),
        )
    least = min(sets, key=lambda each: each.gap)
    everything = torque_parameters(robot, massless=True).links
    return BaseParameters(
        robot=robot,
        rank=least.rank,
        gap=least.gap,
        names=tuple(combination_text(described.names, row) for row in least.coefficients),
        parameters=described.names,
        without_effect=tuple(described.names[k] for k in least.without_effect),
        left_out=tuple(link for link in everything if link not in described.links),
        values=least.coefficients @ described.values,
        described=described,
        combinations=least,
    )
