"""The largest load with which a path is still crossed within the limits of the motors.

Torques and condition (8) of a rigid robot are linear in the multiple m of a wrench and in the squared speed z
(`optimal`). So the admissible pairs (m, z) are a convex set, and the multiples with a law of free shape an
interval. Its upper end is bisected between a multiple that is planned, with its certificate, and one that is
refused or undecided. A search that finds no law proves nothing. So a multiple above the refused one is sought
for which the bound of all laws (`peak_bound`) exceeds the limits. Elastic robots and polynomials are bisected
alike, without that proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from framework.errors import InvalidInput, LimitsExceeded, NoAnswer, NoLaw
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.laws.path import Path
from framework.planning.crossing_points import path_to_cross
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.peak_bound import find_refuting_bound
from framework.planning.options import takes_options
from framework.planning.plan import plan_request
from framework.planning.request import Request
from framework.planning.result import CrossingPlan
from framework.planning.specification import specification_of
from framework.singularity.points_on_path import SearchedPath, search_path

MAX_DOUBLINGS = 20  # of the multiple, up or down, before it counts as without bound, or as none
BRACKET_RATIO = 1e-3  # of the refused multiple over the planned one, less 1: they are near enough
IMPOSSIBLE_RATIOS = (1.0, 1.003, 1.01, 1.03, 1.1, 1.3, 2.0)  # of multiples over the refused, tried in turn


@dataclass(frozen=True, eq=False)
class Capacity:
    """The largest multiple of a request's wrenches that was planned, and why no more.

    plan: under the largest multiple; its certificate and limits are those of any plan.
    refused: the least multiple that was refused (`NoLaw`, `LimitsExceeded`); infinite where none was.
    refusal: of that multiple; None where none was refused.
    impossible: a multiple that no law carries, by a bound of all laws; nor does one carry a larger multiple,
        unless motors are damped. Infinite where none was found.
    undecided: the least multiple that was neither planned nor refused, since planning failed on it for a
        reason that says nothing about laws (`NotConverged` and others); infinite where there was none.
    failure: that reason.
    """

    multiple: float
    plan: CrossingPlan
    refused: float = np.inf
    refusal: NoLaw | LimitsExceeded | None = None
    impossible: float = np.inf
    undecided: float = np.inf
    failure: NoAnswer | None = None

    @property
    def end(self) -> float:
        """Least multiple above the largest that was not planned; infinite where all were."""
        return min(self.refused, self.undecided)

    @property
    def proved(self) -> bool:
        """Whether the least multiple that was not planned is refused with a proof."""
        proved = getattr(self.refusal, "proof", None) is not None or self.impossible <= self.refused
        return self.refused < self.undecided and proved


@takes_options
def largest_load(robot: ParallelRobot, path: Path, **options: Any) -> Capacity:
    """Find the largest multiple of `wrenches` with which an admissible law crosses.

    Args:
        robot, path: as for `plan_crossing`.
        {options}
        optimize is "time" by default where no duration is given.

    Raises:
        InvalidInput: no wrenches, or no limit of torque or speed; see `plan_crossing`.
        NoAnswer: nothing is planned even without them.
    """
    return largest_load_of(robot, capacity_request(robot, path, **options))


def capacity_request(robot: ParallelRobot, path: Path, **options: Any) -> Request:
    """Return the request of `largest_load`, by default for the quickest law.

    Raises:
        InvalidInput: see `Request.of`.
    """
    expect_robot(robot)
    if all(options.get(key) is None for key in ("optimize", "duration", "longest")):
        options["optimize"] = "time"
    return Request.of(robot, path, **options)


def largest_load_of(
    robot: ParallelRobot, request: Request, *, progress: Callable[[int], None] = lambda planned: None
) -> Capacity:
    """Find the largest multiple of the wrenches of a request.

    Args:
        progress: called with the number of plans tried, before each.

    Raises:
        As `largest_load`.
    """
    unit = request.external_wrenches
    if not unit.push:
        raise InvalidInput("wrenches: give a wrench that is not zero, whose largest multiple is looked for")
    specification = specification_of(robot, request)
    if not (specification.limited or specification.limited_speeds):
        raise InvalidInput("torque_limit or speed_limit is needed: without limits no multiple is the largest")
    task = _Multiples(robot, request, unit, search_path(robot, request.path), progress)
    unloaded = task.plan_multiple(0.0)
    if isinstance(unloaded, NoAnswer):
        raise unloaded
    bracket = _bracket_capacity(task, Capacity(0.0, unloaded))
    return _bound_capacity(task, _bisect_capacity(task, bracket))


@dataclass
class _Multiples:
    """A request under multiples of its wrenches."""

    robot: ParallelRobot
    request: Request
    unit: ExternalWrenches
    searched: SearchedPath
    progress: Callable[[int], None]
    count: int = 0

    def plan_multiple(self, multiple: float) -> CrossingPlan | NoAnswer:
        """Return the plan under a multiple, or the refusal."""
        self.count += 1
        self.progress(self.count)
        try:
            return plan_request(self.robot, self._request(multiple), searched=self.searched)
        except NoAnswer as refusal:
            return refusal

    def _request(self, multiple: float) -> Request:
        """Return the request under a multiple of the wrenches."""
        return replace(self.request, wrenches=self.unit.times(multiple).document or None)

    def is_impossible(self, multiple: float) -> bool:
        """Return whether a bound of all laws is above the limits under a multiple."""
        request = self._request(multiple)
        try:
            to_cross = path_to_cross(self.searched, request)
        except NoAnswer:
            return False
        return find_refuting_bound(Task(to_cross, request, specification_of(self.robot, request))) is not None

    def try_multiple(self, capacity: Capacity, multiple: float) -> Capacity:
        """Plan one more multiple; return the capacity with its outcome."""
        answer = self.plan_multiple(multiple)
        if isinstance(answer, NoLaw | LimitsExceeded):
            return replace(capacity, refused=multiple, refusal=answer)
        if isinstance(answer, NoAnswer):
            return replace(capacity, undecided=multiple, failure=answer)
        return replace(capacity, multiple=multiple, plan=answer)


def _bracket_capacity(task: _Multiples, capacity: Capacity) -> Capacity:
    """Double or halve from 1 until m is planned and 2 m is not."""
    capacity = task.try_multiple(capacity, 1.0)
    for _ in range(MAX_DOUBLINGS):
        if not np.isfinite(capacity.end):
            capacity = task.try_multiple(capacity, 2.0 * capacity.multiple)
        elif capacity.multiple == 0.0:
            capacity = task.try_multiple(capacity, 0.5 * capacity.end)
        else:
            break
    return capacity


def _bisect_capacity(task: _Multiples, capacity: Capacity) -> Capacity:
    """Bisect, at geometric means, between the largest multiple planned and the least that failed."""
    while capacity.multiple > 0.0 and capacity.end < np.inf:
        if capacity.end <= (1.0 + BRACKET_RATIO) * capacity.multiple:
            break
        capacity = task.try_multiple(capacity, float(np.sqrt(capacity.multiple * capacity.end)))
    return capacity


def _bound_capacity(task: _Multiples, capacity: Capacity) -> Capacity:
    """Add the least multiple found that no law carries.

    Tried are IMPOSSIBLE_RATIOS times the refused one.
    """
    if not np.isfinite(capacity.refused):
        return capacity
    multiples = (ratio * capacity.refused for ratio in IMPOSSIBLE_RATIOS)
    impossible = next((multiple for multiple in multiples if task.is_impossible(multiple)), np.inf)
    return replace(capacity, impossible=impossible)
