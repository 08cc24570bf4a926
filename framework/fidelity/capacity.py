"""The largest load with which a robot still crosses a path within the limits of its motors.

The load is a multiple m of the external wrenches of a request. Torques and condition (8) of a rigid robot are
linear in m and in the squared speed z of a law (`planning.optimal`). So the admissible pairs (m, z) form a
convex set, and the multiples that admit a law of free shape form an interval. Bisection brackets the upper
end of the interval between a multiple with a certified plan and a multiple that is refused or undecided. It
begins where the lower bound on the peaks of all laws (`peak_bound`) reaches the limits, if there is one.

A refusal for lack of a law proves nothing, since the search may have missed one. So larger and larger
multiples are tried until that bound exceeds the limits. For elastic robots and polynomials there is no such
proof.
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
from framework.numerics.arrays import LEAST_DIVISOR
from framework.planning.crossing_points import path_to_cross
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.peak_bound import bound_peak
from framework.planning.options import takes_options
from framework.planning.plan import plan_request
from framework.planning.refusals import SearchEvidence
from framework.planning.request import Request, specification_of
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.tolerances import BOUND_MARGIN, LIMIT_MARGIN

# Relative width of the bracket at which the bisection ends; a search leaves LIMIT_MARGIN of each limit free.
BRACKET_RATIO = 2.0 * LIMIT_MARGIN
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
        NoAnswer: there is no plan even without the wrenches.
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
    unloaded = task.plan_multiple(0.0)
    if isinstance(unloaded, NoAnswer):
        raise unloaded
    bracket = _bracket_capacity(task, Capacity(multiple=0.0, plan=unloaded))
    return _bound_capacity(task, bracket)


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

    def bound_peaks(self, multiple: float) -> float:
        """Compute a bound on the peaks of all laws over the limits under a multiple; 0 if none is known."""
        request = self._request(multiple)
        try:
            to_cross = path_to_cross(self.searched, request)
        except NoAnswer:
            return 0.0
        specification = specification_of(self.robot, request)
        bound = bound_peak(Task(to_cross, request, specification), specification.torque_limit)
        return 0.0 if bound is None else bound.value

    def try_multiple(self, capacity: Capacity, multiple: float) -> Capacity:
        """Plan under a multiple; return the capacity updated by the outcome."""
        answer = self.plan_multiple(multiple)
        if isinstance(answer, NoLaw | LimitsExceeded):
            return replace(capacity, refused=multiple, refusal=answer)
        if isinstance(answer, NoAnswer):
            return replace(capacity, undecided=multiple, failure=answer)
        return replace(capacity, multiple=multiple, plan=answer)


def _bracket_capacity(task: _Multiples, capacity: Capacity) -> Capacity:
    """Bracket the largest planned multiple within BRACKET_RATIO.

    From 1 on, or from where a bound meets the limits, the multiple is doubled while it has plans. Then the
    bracket from the largest multiple with a plan, `multiple`, to the least one without, `end`, is narrowed by
    secants of the least peaks of refused multiples. Where they do not serve, it is bisected at geometric
    means, or halved while no multiple has a plan. `capacity` is that of the multiple 0, with its plan.
    """
    multiple = 1.0
    peaks = list[tuple[float, float]]()  # refused multiples, with least peaks over the limits, 0 if unknown
    bound = _bound_end(task)
    if bound is not None:
        end, slope = bound
        peaks.append((2.0 * end, 1.0 + slope * end))  # where the bound refuses
        multiple = 1.05 * end  # clearly refused: beside the end searches are long
    while 1.0 / MAX_MULTIPLE <= multiple <= MAX_MULTIPLE:
        capacity = task.try_multiple(capacity, multiple)
        evidence = None if capacity.refusal is None else capacity.refusal.evidence
        if capacity.refused == multiple and isinstance(evidence, SearchEvidence):
            peaks.append((multiple, evidence.least.torque_peak or 0.0))
        if capacity.end == np.inf:  # all multiples so far have plans
            multiple = 2.0 * capacity.multiple
        elif (1.0 + BRACKET_RATIO) * capacity.multiple < capacity.end:
            multiple = _narrow_bracket(capacity, peaks)
        else:
            break
    return capacity


def _bound_end(task: _Multiples) -> tuple[float, float] | None:
    """Find the multiple at which a bound on the peaks of all laws meets the limits, and the bound's slope.

    The bound is nearly linear in the multiple, so that two or three secants suffice. None without a bound.
    """
    last, last_peak, multiple = 0.0, 0.0, 1.0  # unloaded, a slow motion may take no torque
    for _ in range(5):
        peak = task.bound_peaks(multiple)
        slope = (peak - last_peak) / (multiple - last)
        if abs(peak - 1.0) < LIMIT_MARGIN:
            return multiple, slope
        last, last_peak, multiple = multiple, peak, multiple + (1.0 - peak) / max(slope, LEAST_DIVISOR)
        if not 0.0 < multiple < MAX_MULTIPLE:  # also without a bound
            break
    return None


def _narrow_bracket(capacity: Capacity, peaks: Sequence[tuple[float, float]]) -> float:
    """Choose a multiple between the largest with a plan and the least without.

    The least peak is convex in the multiple, so its secant through two refused multiples meets the limit at
    or above the capacity. A multiple just below that point is tried, and after it one just above.
    """
    middle = float(np.sqrt(capacity.multiple * capacity.end)) or 0.5 * capacity.end
    if len(peaks) < 2 or not 0.0 < peaks[-1][1] < peaks[-2][1]:
        return middle
    (m_2, p_2), (m_1, p_1) = peaks[-2:]
    limit = m_1 - (p_1 - 1.0 + LIMIT_MARGIN) * (m_2 - m_1) / (p_2 - p_1)
    if abs(limit - capacity.multiple) < BRACKET_RATIO * capacity.multiple:  # planned just below it
        trial = capacity.multiple * (1.0 + 0.9 * BRACKET_RATIO)  # which ends the search if it is refused
    else:
        trial = limit * (1.0 - 0.45 * BRACKET_RATIO)
    return trial if capacity.multiple < trial < capacity.end else middle


def _bound_capacity(task: _Multiples, capacity: Capacity) -> Capacity:
    """Return the capacity with `impossible`, the least of a few multiples that a bound refutes.

    The multiples are `impossible_ratios` times the refused one. The bound need not refute that one itself: a
    search may miss a law, and the bound is not sharp.
    """
    # multiples over the refused one, in turn
    impossible_ratios = (1.0, 1.003, 1.01, 1.03, 1.1, 1.3, 2.0)
    if not np.isfinite(capacity.refused):
        return capacity
    multiples = (ratio * capacity.refused for ratio in impossible_ratios)
    refuted = (multiple for multiple in multiples if task.bound_peaks(multiple) > 1.0 + BOUND_MARGIN)
    return replace(capacity, impossible=next(refuted, np.inf))
