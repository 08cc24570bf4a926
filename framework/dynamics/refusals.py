"""The errors for deflections that do not converge and torques that no grid resolves, with remedies."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from framework.dynamics.elastic_pass import spring_scale
from framework.dynamics.elasticity import DeflectionSolution
from framework.dynamics.near_misses import describe_near_miss
from framework.dynamics.result import InverseDynamics
from framework.errors import NotConverged, round_up
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import PointPath
from framework.singularity.points_on_path import SearchedPath
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import RESOLVABLE_TAIL


def unsettled_error(robot: ParallelRobot, state: DeflectionSolution) -> NotConverged:
    """Return the error for deflections that did not converge, with the largest deflection."""
    size = np.abs(state.caused / spring_scale(robot))  # (T, n_e)
    instant, k = np.unravel_index(np.argmax(size), size.shape)
    unit = "m" if robot.sliding[robot.elastic][k] else "rad"
    return NotConverged(
        f"{robot.name}: no deflections found that hold the forces they cause: with "
        f"{state.caused[instant, k]:.3g} {unit} of {robot.elastic_names[k]} at t = "
        f"{state.grid.times[instant]:.4g} s, {state.change:.2g} of that is lacking; use stiffer "
        f"springs, geometry rigid, or another law",
        residual=state.change,
    )


def unresolved_error(
    searched: SearchedPath,
    result: InverseDynamics,
    tolerance: float,
    *,
    size: int,
    enough: float,
    unseen: NearMiss | None,
) -> NotConverged:
    """Return the error for a motion that the finest grid does not resolve.

    Args:
        result: the motion on the finest grid.
        size: number of nodes per panel of this grid.
        enough: the least tolerance that some grid met.
        unseen: a near miss that no grid resolved, if any.
    """
    robot, certificate = searched.branch.robot, result.certificate
    near_miss = unseen or min(searched.near_misses, key=lambda miss: miss.width, default=None)
    if certificate.tail > tolerance:
        problem = f"the torques are not resolved (tail {certificate.tail:.2g}, tolerance {tolerance:.2g})"
    elif certificate.change > tolerance:
        problem = (
            f"the deflections are not resolved (one more pass would change them by {certificate.change:.2g} "
            f"of the largest, tolerance {tolerance:.2g})"
        )
    elif unseen is not None:
        problem = f"the torques within {unseen.width:.2g} in s of a near miss are not resolved"
    else:
        gap = certificate.max_closure_error
        problem = f"the motion is not resolved (loops open by {gap:.2g} m or rad between nodes)"
    advice = "is the law smooth, is the path far from other singularities?"
    if not isinstance(searched.branch.path, PointPath):
        advice = f"is every s at which the pieces of the path join among its `knots`, {advice}"
    if near_miss is not None:
        advice = describe_near_miss(searched, near_miss)
    elif len(searched.points) > 1:
        first, second = min(pairwise(searched.points), key=lambda pair: pair[1].s - pair[0].s)
        distance = second.s - first.s
        advice = f"is the law smooth? The path is singular at s = {first.s:.9g} and {distance:.2g} farther on"
    if tolerance < enough < RESOLVABLE_TAIL:
        advice = f"tolerance {round_up(1.1 * enough, 2):g} would do; {advice}"
    return NotConverged(
        f"{robot.name}: {problem} by {size} nodes a panel: {advice}",
        residual=certificate.unresolved,
        s=None if near_miss is None else near_miss.s,
        platform=None if near_miss is None else searched.branch.path(near_miss.s),
    )
