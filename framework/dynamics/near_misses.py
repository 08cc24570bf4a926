"""Check that the torques of a motion are resolved at near misses of the singular locus.

Beside a singularity torques may rise like 1/|g|, over a stretch of the path in which |g| doubles. Nodes
farther apart do not resolve it, however small the tail of their series is. So the torques are computed again
from the motion where |g| is least and where it has doubled. They have to agree with the series to the
tolerance of a resolved torque, plus the rounding of g.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.elasticity import DeflectionSolution
from framework.dynamics.forces import joint_forces
from framework.dynamics.residuals import evaluate_motion
from framework.dynamics.result import InverseDynamics
from framework.dynamics.singularity_crossings import find_instants
from framework.kinematics.loop_matrices import type2_matrix
from framework.numerics.arrays import Array
from framework.singularity.piecewise_measure import extremum_near
from framework.singularity.points_on_path import SearchedPath
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import RESOLVABLE_TAIL


def unseen_near_miss(
    searched: SearchedPath, state: DeflectionSolution, result: InverseDynamics
) -> NearMiss | None:
    """Return the first near miss where the torques differ from their series, else None."""
    for miss in searched.near_misses:
        if miss.s in (0.0, 1.0):  # the motion is at rest, and nodes are densest
            continue
        for t in find_instants(state.law, state.grid.edges, miss.s):
            if not _is_resolved_near(searched, state, result, miss, t):
                return miss
    return None


def _is_resolved_near(
    searched: SearchedPath, state: DeflectionSolution, result: InverseDynamics, miss: NearMiss, instant: float
) -> bool:
    """Whether the series of the torques is right at a near miss that the law passes at `instant` [s].

    Torques are computed at the least |g| and where |g| is twice as large on both sides.
    """
    robot, edges = searched.branch.robot, state.grid.edges
    start, duration = edges[0], edges[-1] - edges[0]

    def matrices(share: Array) -> Array:
        """Compute the Type 2 matrices (T, n, n) at shares (T,) of the duration."""
        times = start + share * duration
        return type2_matrix(robot, evaluate_motion(searched.branch, result, times)[1].linearised)

    # the instant of the least |g| of the deflected robot, which is not that of the robot at rest
    closest = extremum_near(matrices, (edges - start) / duration, (instant - start) / duration, miss.size)
    shares = np.array([closest.s, *closest.bracket(2 * abs(closest.g))])
    times = start + duration * shares
    motion = evaluate_motion(searched.branch, result, times)[1]
    computed = joint_forces(robot, motion).joint_torque
    expected = state.grid.fit(state.forces.joint_torque)(times)
    allowed = RESOLVABLE_TAIL + closest.rounding / max(abs(closest.g), closest.rounding)
    return bool(np.abs(computed - expected).max() <= allowed * np.abs(state.forces.joint_torque).max())


def describe_near_miss(searched: SearchedPath, miss: NearMiss) -> str:
    """Return the advice about a near miss: its place, |g| and a remedy."""
    robot, x = searched.branch.robot, searched.branch.path(miss.s)
    return (
        f"at s = {miss.s:.9g}, {robot.place(x)} the path misses a singularity by "
        f"|g| = {abs(miss.g):.2g}: move it across the locus, or farther off"
    )
