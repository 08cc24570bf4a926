"""A motion whose torque has no bound, sampled all the same: to see what goes wrong, never to be driven."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from framework.crossing.plan import plan_crossing, uncertified_law
from framework.crossing.result import CrossingPlan
from framework.dynamics.finite_differences import FiniteDifferenceTorques, finite_difference_torques
from framework.dynamics.result import SingularityCrossing
from framework.errors import UnboundedTorque
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tracking import track_path
from framework.motion.law import Law
from framework.motion.path import Path
from framework.singularity.points_on_path import search_path


@dataclass(frozen=True, eq=False)
class RefusedMotion:
    """The law that was refused with `reason`, and torques of the rigid robot as they come."""

    robot: ParallelRobot  # rigid: at the pole springs would tear the loops
    path: Path
    law: Law
    reason: str
    crossings: tuple[SingularityCrossing, ...]  # singular instants, with t_s . W_p
    samples: FiniteDifferenceTorques


def plan_or_sample(
    robot: ParallelRobot, path: Path, *, samples: int, **options: Any
) -> CrossingPlan | RefusedMotion:
    """The plan of a motion, or where that has a pole its samples; the path is tracked and searched once.

    Args:
        samples: how many, equidistant in time.
        options: of `plan_crossing`.

    Raises:
        As `plan_crossing`, but no UnboundedTorque.
    """
    searched = search_path(robot, path)
    try:
        return plan_crossing(robot, path, searched=searched, **options)
    except UnboundedTorque as refusal:
        reason = str(refusal)
    known = ("duration", "times", "speeds", "at", "smoothness")
    given = {key: options[key] for key in known if key in options}
    law, crossings = uncertified_law(robot, path, searched=searched, **given)
    if robot.n_e:
        rigid = ParallelRobot.from_description(robot.description, flexibility="rigid")
        branch = track_path(rigid, path)
    else:
        rigid, branch = robot, searched.branch
    raw = finite_difference_torques(rigid, path, law, samples=samples, branch=branch)
    return RefusedMotion(rigid, path, law, reason, crossings, raw)
