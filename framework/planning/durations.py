"""The shortest motion along a path under the optimal law, before a law is planned.

If a law of free shape exists, slower ones exist without bound: the squared speeds z that meet condition (8)
and the limits are a convex set, and near an end of the path, where a smooth law needs little more than the
weight, z may be scaled by a factor close to zero. Without limits quicker ones exist, too, since condition (8)
concerns z and z' at the crossing alone. So limits give such laws a least duration, and never a longest.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from framework.errors import NoLaw, NotConverged
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.planning.crossing_points import PathToCross
from framework.planning.feasibility import is_crossable
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.undeformed_law import find_undeformed_law
from framework.planning.request import Request
from framework.planning.specification import specification_of
from framework.singularity.points_on_path import SearchedPath


class OptimalDurations(NamedTuple):
    """The least duration [s] found of a law of free shape within the limits of the motors, 0 without limits.

    None where none was found, with the reason. There is never a longest.
    """

    shortest: float | None
    refusal: str = ""

    @property
    def sentence(self) -> str:
        """The durations, in one line."""
        if self.shortest is None:
            return f"within the limits no law of free shape was found ({self.refusal})"
        if not self.shortest:
            return "without limits laws of free shape have no shortest duration and no longest"
        return (
            f"within the limits the quickest law of free shape found takes {self.shortest:.4g} s; none is "
            f"the slowest"
        )


def optimal_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """Return the durations of laws of free shape through all singular points of a path, springs at rest.

    The limits and the smoothness are those of the request. None where no law can cross, and beyond the
    smoothness that such a law can have.
    """
    if request.smoothness > HIGHEST_SMOOTHNESS or not is_crossable(searched):
        return None
    robot = searched.branch.robot
    specification = replace(specification_of(robot, request), goal="time", duration=None, longest=None)
    if not (specification.limited or specification.limited_speeds):
        return OptimalDurations(0.0)
    try:
        to_cross = PathToCross(searched, searched.points)
        best = find_undeformed_law(
            Task(to_cross, replace(request, times=None, speeds=None, at=None), specification)
        )
    except (NoLaw, NotConverged) as refusal:
        return OptimalDurations(None, str(refusal))
    return OptimalDurations(best.law.duration)
