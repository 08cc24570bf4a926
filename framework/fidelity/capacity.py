"""The largest load with which a robot still crosses a path within the limits of its motors.

The load is a multiple m of the external wrenches of a request. Torques and condition (8) of a rigid robot are
linear in m and in the squared speed z of a law (`planning.optimal`). So the admissible pairs (m, z) form a
convex set, and the multiples that admit a law of free shape form an interval. Bisection brackets the upper
end of the interval between a multiple with a certified plan and a multiple that is refused or undecided. It
begins beside the multiple at which the least peak of undeformed laws reaches the limits, if that is found.

A refusal for lack of a law proves nothing, since the search may have missed one. So larger and larger
multiples are tried until the lower bound on the peaks of all laws (`peak_bound`) exceeds the limits. For
elastic robots and polynomials there is no such proof.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from framework.errors import InvalidInput, LimitsExceeded, NoAnswer, NoLaw
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.planning.crossing_points import path_to_cross
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import sample_demand
from framework.planning.optimal.peak_bound import bound_peak
from framework.planning.optimal.undeformed_law import find_least_limits, problem_of
from framework.planning.options import takes_options
from framework.planning.plan import plan_request
from framework.planning.refusals import SearchEvidence
from framework.planning.request import Request, specification_of
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.tolerances import BOUND_MARGIN, LIMIT_MARGIN

# Relative width of the bracket at which the bisection ends; a search leaves LIMIT_MARGIN of each limit free.
BRACKET_RATIO = 2.0 * LIMIT_MARGIN
IMPOSSIBLE_RATIOS = (1.0, 1.003, 1.01, 1.03, 1.1, 1.3, 2.0)  # multiples over the refused one, in turn
MAX_MULTIPLE = 2.0**20  # beyond, the capacity counts as unbounded; below one over it, as zero


@dataclass(frozen=True, eq=False)
class Capacity:
    """The largest multiple of a request's wrenches with a plan, and the reason for the limit.

    multiple: the largest planned multiple.
    plan: the plan under this multiple.
    refused: the least refused multiple (`NoLaw`, `LimitsExceeded`); infinite if no multiple was refused.
    refusal: the error for `refused`; None if no multiple was refused.
    impossible: a multiple at which a bound on all laws exceeds the limits; infinite if none was found.
        Without damping of the motors, larger multiples are impossible, too.
    undecided: the least multiple for which planning failed for numerical reasons (`NotConverged` and others);
        infinite if there was none.
    failure: the error for `undecided`.
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
        """The least multiple without a plan; infinite if all tried multiples have plans."""
        return min(self.refused, self.undecided)

    @property
    def proved(self) -> bool:
        """Whether the least multiple without a plan is refused with a proof."""
        has_proof = getattr(self.refusal, "proof", None) is not None
        is_impossible = self.impossible <= self.refused
        return self.refused < self.undecided and (has_proof or is_impossible)


@takes_options
def largest_load(robot: ParallelRobot, path: Path, **options: Any) -> Capacity:
    """Find the largest multiple of `wrenches` with which an admissible law crosses.

    Args:
        robot: as returned by `load_robot`.
        path: the platform's path.
        {options}
        If no duration is given, `optimize` is "time" by default.

    Raises:
        InvalidInput: there are no wrenches, or no limits of torque or speed; see `plan_crossing`.
        NoAnswer: there is no plan even without the wrenches, nor under the first multiple tried.
    """
    return largest_load_of(robot, capacity_request(robot, path, **options))


def capacity_request(robot: ParallelRobot, path: Path, **options: Any) -> Request:
    """Return the request of `largest_load`, by default for the quickest law.

    Raises:
        InvalidInput: see `Request.of`.
    """
    if all(options.get(key) is None for key in ("optimize", "duration", "longest")):
        options["optimize"] = "time"
    return Request.of(robot, path, **options)


def largest_load_of(
    robot: ParallelRobot, request: Request, *, progress: Callable[[int], None] = lambda planned: None
) -> Capacity:
    """Find the largest multiple of the wrenches of a request, as `largest_load`.

    Args:
        progress: called before each plan with its number, 1, 2, ...
    """
    if not request.external_wrenches.is_nonzero:
        raise InvalidInput("wrenches: give a wrench that is not zero, whose largest multiple is looked for")
    specification = specification_of(robot, request)
    if not (specification.limited or specification.limited_speeds):
        raise InvalidInput("torque_limit or speed_limit is needed: without limits no multiple is the largest")
    numbers = count(1)
    searched = search_path(robot, request.path)
    task = _Multiples(robot, request, searched, lambda: progress(next(numbers)))
    capacity = _bracket_capacity(task)
    if not np.isfinite(capacity.refused):
        return capacity
    # the bound need not refute the refused multiple itself: it is not sharp, and a search may miss a law
    multiples = (ratio * capacity.refused for ratio in IMPOSSIBLE_RATIOS)
    refuted = (multiple for multiple in multiples if task.bound_peaks(multiple) > 1.0 + BOUND_MARGIN)
    return replace(capacity, impossible=next(refuted, np.inf))


class _Multiples(NamedTuple):
    """A request under multiples of its wrenches."""

    robot: ParallelRobot
    request: Request
    searched: SearchedPath  # the path of the request, without wrenches
    report_plan: Callable[[], None]  # called before each plan

    def plan_multiple(self, multiple: float) -> CrossingPlan | NoAnswer:
        """Plan under a multiple of the wrenches; return the plan, or the refusal."""
        self.report_plan()
        try:
            return plan_request(self.robot, self._request(multiple), searched=self.searched)
        except NoAnswer as refusal:
            return refusal

    def _request(self, multiple: float) -> Request:
        """Return the request under a multiple of the wrenches."""
        wrenches = self.request.external_wrenches.times(multiple)
        return replace(self.request, wrenches=wrenches.document or None)

    def _task(self, multiple: float) -> Task:
        """Return the task of a law under a multiple; raise NoAnswer if no law crosses one of the points."""
        request = self._request(multiple)
        to_cross = path_to_cross(self.searched, request)
        return Task(to_cross, request, specification_of(self.robot, request))

    def bound_peaks(self, multiple: float) -> float:
        """Compute a bound on the peaks of all laws over the limits under a multiple; 0 if none is known."""
        try:
            task = self._task(multiple)
        except NoAnswer:
            return 0.0
        bound = bound_peak(task, task.specification.torque_limit)
        return 0.0 if bound is None else bound.value

    def find_least_peak(self, multiple: float) -> float:
        """Find the least peak over the torque limits of undeformed laws under a multiple; 0 without one."""
        try:
            task = self._task(multiple)
            problem = problem_of(task)._replace(sampled=sample_demand(task))
            return find_least_limits(problem).torque_peak or 0.0
        except NoAnswer:
            return 0.0

    def try_multiple(self, multiple: float, capacity: Capacity | None) -> Capacity:
        """Plan under a multiple; return the capacity updated by the outcome.

        Where nothing was planned before, a multiple without a plan is followed by the unloaded robot.

        Raises:
            NoAnswer: the unloaded robot has no plan either.
        """
        answer = self.plan_multiple(multiple)
        if not isinstance(answer, NoAnswer):
            return replace(capacity or Capacity(multiple, answer), multiple=multiple, plan=answer)
        if capacity is None:
            unloaded = self.plan_multiple(0.0)
            if isinstance(unloaded, NoAnswer):
                raise unloaded
            capacity = Capacity(0.0, unloaded)
        if isinstance(answer, NoLaw | LimitsExceeded):
            return replace(capacity, refused=multiple, refusal=answer)
        return replace(capacity, undecided=multiple, failure=answer)


def _bracket_capacity(task: _Multiples) -> Capacity:
    """Bracket the largest planned multiple within BRACKET_RATIO.

    The first multiple is just below the one at which the least peak of undeformed laws meets the limits, or 1
    if these are not found. Then `_choose_multiple` widens or narrows the bracket from the largest multiple
    with a plan, `multiple`, to the least one without, `end`.
    """
    multiple = 1.0
    peaks = [(0.0, 0.0)]  # multiples, with least peaks over the limits, 0 if unknown
    for _ in range(12):  # the least peak is convex: secants meet the limit, within twice the last multiple
        peak = task.find_least_peak(multiple)
        peaks.append((multiple, peak))
        limit = _find_limit(peaks)
        if limit is None and not 0.0 < peak < 1.0 - LIMIT_MARGIN:
            multiple = 1.0
            break
        limit = 2.0 * multiple if limit is None else limit
        multiple = min(limit * (1.0 - 0.45 * BRACKET_RATIO), 2.0 * multiple)
        if abs(peak - 1.0 + LIMIT_MARGIN) < BRACKET_RATIO:
            break
    capacity = None
    while 1.0 / MAX_MULTIPLE <= multiple <= MAX_MULTIPLE:
        capacity = task.try_multiple(multiple, capacity)
        evidence = None if capacity.refusal is None else capacity.refusal.evidence
        if capacity.refused == multiple and isinstance(evidence, SearchEvidence):
            peaks.append((multiple, evidence.torque_peak or 0.0))
        if (1.0 + BRACKET_RATIO) * capacity.multiple >= capacity.end:
            break
        multiple = _choose_multiple(capacity, peaks)
    assert capacity is not None  # the first multiple is within the range
    return capacity


def _choose_multiple(capacity: Capacity, peaks: Sequence[tuple[float, float]]) -> float:
    """Choose a multiple between the largest with a plan and the least without, if there is one.

    A multiple just below the limit by the last peaks is tried, and after it one just above. Where they do not
    serve, the multiple is doubled while it has plans, halved while none has one, or else the geometric mean.
    """
    limit = _find_limit(peaks)
    if limit is not None:
        trial = limit * (1.0 - 0.45 * BRACKET_RATIO)
        if abs(limit - capacity.multiple) < BRACKET_RATIO * capacity.multiple:  # planned just below it
            trial = capacity.multiple * (1.0 + 0.9 * BRACKET_RATIO)  # which ends the search if it is refused
        if capacity.multiple < trial < capacity.end:
            return trial
    if capacity.end == np.inf:
        return 2.0 * capacity.multiple
    return float(np.sqrt(capacity.multiple * capacity.end)) or 0.5 * capacity.end


def _find_limit(peaks: Sequence[tuple[float, float]]) -> float | None:
    """Find the multiple at which the secant of the last two peaks meets the limit; None if they do not rise.

    The least peak is convex in the multiple, so that of two refused ones lies at or above the capacity.
    """
    if len(peaks) < 2:
        return None
    (m_2, p_2), (m_1, p_1) = peaks[-2:]
    slope = (p_2 - p_1) / (m_2 - m_1) if m_1 != m_2 else 0.0
    if p_1 == 0.0 or slope <= 0.0:
        return None
    limit = m_1 - (p_1 - 1.0 + LIMIT_MARGIN) / slope
    return limit if 0.0 < limit < MAX_MULTIPLE else None
