"""The best law of a problem: the smoothest law whose cost is hardly more than the least.

A law is a squared speed z, with coefficients y in the parameter xi of the path (`speed_program`). The optimum
is rarely unique, and a solver returns one with abrupt changes of speed. So the least cost is found first
(`least_cost`), with squared speeds that may come arbitrarily near to zero. The smoothest law within a share
of that cost follows, within all limits (`smooth_search`).
"""

from __future__ import annotations

from typing import NamedTuple

from framework.errors import InvalidInput, NotConverged
from framework.laws.optimal_law import OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.time_limit import SearchEnded
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import NoneFound, cost_of, find_least_cost, solve_least_cost
from framework.planning.optimal.smooth_search import SmoothSearch, find_exceeded_places
from framework.planning.optimal.speed_program import Speed, SpeedProgram, Units
from framework.tolerances import SMOOTHNESS_COST

MAX_ROW_ROUNDS = 3  # of adding rows where a limit is exceeded between the points
LIMIT_TIGHTENING = 1e-5  # share by which a limit that was exceeded is lowered further


class Best(NamedTuple):
    """A law, its squared speed, and the search that found the speed."""

    law: OptimalLaw
    search: SmoothSearch
    speed: Speed

    @property
    def program(self) -> SpeedProgram:
        return self.search.program

    @property
    def reference(self) -> Array:
        """Torques (n_a,) [N m] that peak and energy are relative to."""
        return self.program.problem.reference

    @property
    def peak(self) -> float:
        """The largest torque over the reference at the rows of the program."""
        return self.speed.peak

    @property
    def cost(self) -> float:
        """The cost by the goal: the duration [s], the relative peak, or the relative energy [s].

        Peak and energy are divided by the reference and its square.
        """
        return cost_of(self.search.goal, self.speed)

    @property
    def gap(self) -> float:
        """The cost divided by the least cost, minus 1; a law of least cost need not be smooth."""
        return max(self.cost / self.search.least_cost - 1.0, 0.0)


def find_best_law(
    problem: LawProblem,
    cells: Array | None = None,
    *,
    share: float = SMOOTHNESS_COST,
    units: Units | None = None,
) -> Best | NoneFound:
    """Find the smoothest law whose cost is within a share of the least.

    If the search for the least duration or energy fails, the law of least peak is tried.

    Args:
        cells: (k + 1,) edges in xi, which are refined; by default, `first_cells` chooses them.
        share: share of the least cost by which the smooth law may exceed it.
        units: units of a similar program, from which the solution begins.
    """
    goal = problem.specification.goal
    least_cost = find_least_cost(problem, cells, units=units)
    if isinstance(least_cost, NoneFound):
        return least_cost if goal == "peak_torque" else _find_least_peak(problem, least_cost, share)
    program, least, units = least_cost
    longest = problem.specification.longest
    if goal == "time" and longest is not None and least.least_duration > longest:
        return NoneFound(program, f"the quickest found takes {least.duration:.4g} s")
    return _search_smooth(SmoothSearch(program, units, least, share), is_least_new=True)


def resume_law(best: Best, problem: LawProblem, *, share: float | None = None) -> Best | NoneFound:
    """Find the law of a problem similar to that of `best`, on the same cells and with the same rows.

    Args:
        share: of the least cost for smoothness; by default that of `best`.
    """
    program = SpeedProgram.on_cells(problem, best.program.cells)
    if len(best.program.further_xi):
        program = program.extend(best.program.further_xi)
    least_cost = solve_least_cost(program, best.search.units, limit_share=best.search.limit_share)
    if isinstance(least_cost, NoneFound):
        return least_cost
    search = best.search._replace(
        program=program,
        least=least_cost.speed,
        units=least_cost.units,
        share=best.search.share if share is None else share,
    )
    return _search_smooth(search, best.speed, is_least_new=True)


def adapt_law(best: Best, *, excess: float = 1.0, share: float | None = None) -> Best:
    """Find a smooth law near the best, with tighter limits or another share of cost for smoothness.

    If the search fails for the least duration or energy, the law of least peak torque is tried.

    Args:
        excess: largest torque or speed of the motion over its limit, 1 or more; limits are divided by it.
        share: share of the least cost by which the smooth law may exceed it; by default that of `best`.

    Raises:
        NotConverged: no such law was found.
    """
    search = best.search
    if share is not None:
        search = search._replace(share=share)
    if excess > 1.0:
        search = search._replace(limit_share=search.limit_share * (1.0 - LIMIT_TIGHTENING) / excess)
    adapted = _search_smooth(search, best.speed)
    if isinstance(adapted, NoneFound) and search.goal != "peak_torque":
        adapted = _find_least_peak(search.program.problem, adapted, search.share)
    if isinstance(adapted, NoneFound):
        raise NotConverged(
            "no law near the best keeps all limits between its points",
            name=search.program.problem.task.robot.name,
            residual=excess - 1.0,
        )
    return adapted


def _find_least_peak(problem: LawProblem, failure: NoneFound, share: float) -> Best | NoneFound:
    """Find the law of least peak torque after another goal failed.

    The failure is returned if this law is not found, or is not within the limits.
    """
    if not problem.specification.limited:
        return failure
    best = find_best_law(problem.with_goal("peak_torque"), share=share)
    is_within_limits = isinstance(best, Best) and best.peak <= 1.0
    return best if is_within_limits else failure


def _search_smooth(
    search: SmoothSearch, similar: Speed | None = None, *, is_least_new: bool = False
) -> Best | NoneFound:
    """Find the smooth law, adding rows where limits are exceeded between the points.

    Such rows, or tighter limits, may raise the least cost by more than the share for smoothness, so that no
    smooth law is found. The least cost is then solved for again, once for each set of rows.

    Args:
        similar: the speed of a similar law, from which the search begins.
        is_least_new: whether the least cost of the search already counts its rows and limits.
    """
    # the program whose least cost is up to date: solving for it again would change nothing
    program_of_least = search.program if is_least_new else None
    best: Best | None = None
    try:
        search = search.limit_duration()
        for _ in range(MAX_ROW_ROUNDS + 1):
            is_least_known = search.program is program_of_least
            search, smooth = search.find_smooth(similar, is_least_known=is_least_known)
            if isinstance(smooth, NoneFound) and is_least_known and similar is not None:
                search, smooth = search.find_smooth()
            if isinstance(smooth, Speed):
                # keep the law; add rows where it exceeds limits between the points
                made = make_best(search, smooth)
                if isinstance(made, NoneFound):
                    return best or made
                best = made
                similar = smooth
                exceeded = find_exceeded_places(search.program, smooth, search.bounds)
                if not len(exceeded):
                    return best
                search = search._replace(program=search.program.extend(exceeded))
                continue
            # no smooth law: solve for the least cost again
            if is_least_known:
                return best or smooth
            least = solve_least_cost(search.program, search.units, limit_share=search.limit_share)
            if isinstance(least, NoneFound):
                return best or smooth
            search = search._replace(least=least.speed, units=least.units).limit_duration()
            similar = None
            program_of_least = search.program
    except SearchEnded:
        if best is None:
            raise
        return best
    return best or NoneFound(search.program, "limits are exceeded between the points")


def make_best(search: SmoothSearch, speed: Speed) -> Best | NoneFound:
    """Make the law of a speed that has the required instants; none if z comes too near to zero."""
    program = search.program
    specification = program.problem.specification
    stretch = program.problem.task.stretch
    try:
        law = OptimalLaw(
            speed.y,
            specification.smoothness,
            specification.duration or 0.0,
            stretch.dense_at,
            tuple(program.basis.cells),
            specification.ends.moving,
        )
    except InvalidInput as reason:
        return NoneFound(program, str(reason))
    return Best(law, search, speed)
