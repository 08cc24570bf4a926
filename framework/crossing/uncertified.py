"""A motion whose torque has no bound, sampled all the same: to see what goes wrong, never to be driven."""

from __future__ import annotations

from dataclasses import dataclass

from framework.crossing.plan import law_before_proof, plan_request
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.dynamics.finite_differences import FiniteDifferenceTorques, finite_difference_torques
from framework.dynamics.result import SingularityCrossing
from framework.errors import UnboundedTorque
from framework.kinematics.continuation.tracking import track_path
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.law import Law
from framework.motion.path import Path
from framework.singularity.points_on_path import search_path


@dataclass(frozen=True, eq=False)
class UncertifiedMotion:
    """A law refused with `reason`, and unproved samples of the rigid robot's torques."""

    robot: ParallelRobot  # rigid: at the pole springs would tear the loops
    path: Path
    law: Law
    reason: str
    crossings: tuple[SingularityCrossing, ...]  # singular instants, with t_s . W_p
    samples: FiniteDifferenceTorques


def plan_or_sample(
    robot: ParallelRobot, request: Request, *, samples: int
) -> CrossingPlan | UncertifiedMotion:
    """Plan a motion, or sample its torques that have a pole; search the path once.

    Args:
        samples: how many, equidistant in time.

    Raises:
        As `plan_crossing`, but no UnboundedTorque.
    """
    path = request.path
    searched = search_path(robot, path).under(request.external_wrenches)
    try:
        return plan_request(robot, request, searched=searched)
    except UnboundedTorque as refusal:
        reason = str(refusal)
    law, crossings = law_before_proof(searched, request)
    if robot.n_e:
        rigid = ParallelRobot.from_description(robot.description, flexibility="rigid")
        branch = track_path(rigid, path).with_wrenches(request.external_wrenches)
    else:
        rigid, branch = robot, searched.branch
    raw = finite_difference_torques(rigid, path, law, samples=samples, branch=branch)
    return UncertifiedMotion(rigid, path, law, reason, crossings, raw)
