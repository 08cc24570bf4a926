"""Check that the torques of a motion are resolved at near misses of the singular locus.

Beside a singularity torques may rise like 1/|g|, in a peak as wide as the stretch of the path on which |g|
doubles. Nodes that are farther apart do not resolve this peak, however small the tail of the series. So the
torques are computed again where |g| is least and where it has doubled. They must agree with the series to
the tolerance of a resolved torque, plus the rounding of g.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.elasticity import DeflectionSolution
from framework.dynamics.forces import joint_forces
from framework.dynamics.residuals import evaluate_motion
from framework.dynamics.result import InverseDynamics
from framework.dynamics.singularity_crossings import find_instants
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.linearised_loops import type2_matrix
from framework.numerics.arrays import Array
from framework.singularity.piecewise_measure import extremum_near
from framework.singularity.points_on_path import SearchedPath
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import RESOLVABLE_TAIL


def unseen_near_miss(
    searched: SearchedPath, state: DeflectionSolution, result: InverseDynamics
) -> NearMiss | None:
    """Find the first near miss at which the torques differ from their series, if any."""
    for miss in searched.near_misses:
        if miss.s in (0.0, 1.0):  # there the motion is at rest and the nodes are dense
            continue
        for t in find_instants(state.law, state.grid.edges, miss.s):
            if not _is_resolved_near(searched.branch, state, result, miss, t):
                return miss
    return None


def _is_resolved_near(
    branch: Branch, state: DeflectionSolution, result: InverseDynamics, miss: NearMiss, instant: float
) -> bool:
    """Return whether the series of the torques is accurate at a near miss.

    The torques are computed at the least |g| and, on both sides, where |g| is twice as large.

    Args:
        instant: time [s] at which the robot with springs at rest passes the near miss.
    """
    robot, edges = branch.robot, state.grid.edges
    duration = edges[-1]

    def matrices(shares: Array) -> Array:
        """Compute the Type 2 matrices (T, n, n) at shares (T,) of the duration."""
        _closed, motion = evaluate_motion(branch, result, shares * duration)
        return type2_matrix(robot, motion.linearised)

    # deflections shift the least |g|
    closest = extremum_near(matrices, edges / duration, instant / duration, miss.size)
    times = duration * np.array([closest.s, *closest.bracket(2 * abs(closest.g))])
    _closed, motion = evaluate_motion(branch, result, times)
    computed = joint_forces(robot, motion).joint_torque
    torques = state.forces.joint_torque
    error = np.abs(computed - state.grid.fit(torques)(times)).max()
    allowed = RESOLVABLE_TAIL + closest.rounding / max(abs(closest.g), closest.rounding)
    return bool(error <= allowed * np.abs(torques).max())


def describe_near_miss(searched: SearchedPath, miss: NearMiss) -> str:
    """Return the place of a near miss, its |g| and a remedy, in words."""
    robot, x = searched.branch.robot, searched.branch.path(miss.s)
    return (
        f"at s = {miss.s:.9g}, {robot.place(x)} the path misses a singularity by "
        f"|g| = {abs(miss.g):.2g}: move it across the locus, or farther off"
    )
