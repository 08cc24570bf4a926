"""The law of the paper: one polynomial with given s, s' and s" at its crossings.

The law is the path coordinate s as a function of time, with derivatives s' and s". Condition (8), alpha s" +
beta s'^2 + gamma + delta s' = 0, gives s" at each crossing of a singular point. Times and speeds s' of the
crossings that the user leaves open are chosen so that the law always advances.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.inverse_dynamics import resolve, resolve_law
from framework.dynamics.restoration import solve_balance
from framework.dynamics.result import InverseDynamics
from framework.dynamics.singularity_crossings import LAW_ROOT_ROUNDING, find_instants, panel_edges
from framework.errors import InvalidInput, NoLaw, NotConverged, SpringsTooSoft
from framework.laws.law import NO_HIGH, Law, PlannedLaw, conditions_at_instants, speed_ratios_and_peaks
from framework.laws.optimal_law import InTime
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction
from framework.planning.condition import require_effect
from framework.planning.crossing_points import CrossingTime, PathToCross, check_one_condition_each
from framework.planning.crossing_tracker import CrossingTracker
from framework.planning.options import OPTIMAL_LAW
from framework.planning.refusals import check_advance
from framework.planning.request import Request, share_load
from framework.planning.result import CrossingPlan, certified_plan
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import MIN_POLYNOMIAL_ADVANCE

# least speed ratio that a chosen law should have: least speed over the mean, without the zeros at the ends
COMFORTABLE_ADVANCE = 2.0 * MIN_POLYNOMIAL_ADVANCE
RAISED_DEGREES = (24, 32, 40)  # tried in turn where the law of least degree does not advance at given times
MAX_CROSSINGS = 8  # polynomials through more crossings oscillate so much that none is found to advance
# laws that each round of the search draws for each open time or speed; largest number of rounds
LAWS_PER_UNKNOWN, MAX_ROUNDS = 64, 25

# advice where times or speeds do not suit the duration
OF_A_SCENE = (
    "times and speeds of a scene belong to its own duration: give others for this one, or take law optimal, "
    "which finds its own"
)


def plan_polynomial(to_cross: PathToCross, request: Request, *, searched: bool = True) -> CrossingPlan:
    """Plan with the polynomial of least degree; choose times and speeds left open.

    At required times the degree is raised where the polynomial of least degree does not advance. It is raised
    further where deflections or torques are not resolved, since a law of more coefficients can bend less.

    Args:
        to_cross: the path, with the points where condition (8), t_s . W_p = 0, is to hold.
        searched: whether open times and speeds are searched if none of the first ones will do.

    Raises:
        InvalidInput, NoAnswer: as `plan_crossing`.
    """
    first = undeformed_polynomial(to_cross, request, searched=searched)
    raised = _raise_degree(to_cross.crossing_points, request, above=first[0].degree)
    failures = list[NotConverged]()
    for law, undeformed_timing in chain([first], raised):
        timing = undeformed_timing
        crossed: Sequence[SingularPoint] = ()  # of the deformed robot
        try:
            if request.geometry == "deformed":
                dynamics, timing, crossed = _cross_deformed(to_cross, request, law, timing)
            else:
                dynamics = resolve_law(to_cross.searched, law, **request.model_options)
            dynamics = share_load(dynamics, request, optimal=False)
            break
        except SpringsTooSoft:  # whatever the law
            raise
        except NotConverged as failure:
            failures.append(failure)
    else:
        raise failures[0]
    planned = dynamics.law
    assert isinstance(planned, Law)
    speed_ratio = planned.least_speed_ratio(request.smoothness, request.ends)
    if request.kind == "polynomial":
        least_degree = request.ends.least_degree(request.smoothness, len(timing))
        reason = "it was asked for" if request.law == "polynomial" else "times of the crossings are given"
        if planned.degree > least_degree:
            reason += f"; that of the least degree, {least_degree}, does not advance at the times given"
        if 0 < speed_ratio < MIN_POLYNOMIAL_ADVANCE:
            reason += f"; it nearly stops, at {speed_ratio:.2g} of its mean speed"
    else:
        reason = f"the polynomial{' advances' if speed_ratio > 0 else ', though it overshoots its ends'}"
    return certified_plan(to_cross, request, dynamics, planned, timing, crossed=crossed, reason=reason)


def _cross_deformed(
    to_cross: PathToCross, request: Request, law: Law, timing: tuple[CrossingTime, ...]
) -> tuple[InverseDynamics, tuple[CrossingTime, ...], Sequence[SingularPoint]]:
    """Compute motion, times, speeds and singular points of a polynomial through the deflected robot's points.

    The points are none if the user imposes them. Deflections move the crossing points along the path, and may
    so make the law turn back. Its degree is then raised, with new speeds where they are open.
    """
    max_raises = 2
    crossings = to_cross.crossing_points
    for raises_left in reversed(range(max_raises + 1)):
        dynamics, tracker = _resolve_deformed(to_cross, request, law, timing)
        assert isinstance(dynamics.law, Law)
        try:
            _refuse_turning_back(dynamics.law, request, [crossing.s for crossing in dynamics.crossings])
            break
        except NoLaw:
            if not request.times or not raises_left:
                raise
            moved = tracker.follow(dynamics.deflection)
            raised = next(_raise_degree(moved, request, above=law.degree - 1), None)
            if raised is None:
                raise
            advancing, timing = raised
            law = _solve_law(crossings, timing, request, _high_coefficients(advancing, request, timing))
    return dynamics, timing, () if request.at else tracker.crossings


def _resolve_deformed(
    to_cross: PathToCross, request: Request, undeformed: Law, timing: tuple[CrossingTime, ...]
) -> tuple[InverseDynamics, CrossingTracker]:
    """Compute the motion of the polynomial on the deflected robot, with the tracker of the crossings.

    Each pass of the deflections solves for a law of its own, with the same times and speeds. If the passes do
    not converge, law and deflections are solved for together. The last law may turn back.
    """
    high = _high_coefficients(undeformed, request, timing)
    times = np.array([time for time, _ in timing])  # (k,) [s]
    tracker = CrossingTracker(to_cross.branch, to_cross.crossing_points, times)

    def choose_law(deflections: TimeFunction | None) -> Law:
        """Return the law of a pass with deflections (n_e) over time; None before the first pass."""
        if deflections is None:
            return undeformed
        return _solve_law(tracker.follow(deflections), timing, request, high)

    find_balance = partial(_find_balanced_law, to_cross, tracker, request, timing, high)
    is_free = request.at is None  # s" at imposed points is prescribed
    dynamics = resolve(
        to_cross.searched,
        choose_law,
        **request.model_options,
        find_balance=find_balance if is_free else None,
    )
    return dynamics, tracker


def _high_coefficients(law: Law, request: Request, timing: Sequence[CrossingTime]) -> Array:
    """Return the Chebyshev coefficients of a law above its least degree; none of the law of that degree."""
    return law.coefficients[request.ends.least_degree(request.smoothness, len(timing)) + 1 :]


def _find_balanced_law(
    to_cross: PathToCross,
    tracker: CrossingTracker,
    request: Request,
    timing: Sequence[CrossingTime],
    high: Array,
) -> tuple[Law, KnownDeflections]:
    """Solve for law and deflections together, if passes of the deflections do not converge.

    Unknown are the deflections as functions of time and c (k,) [1/s^2], by which s" at the crossings differs
    from the s" of condition (8) at the last deflections. Deflections in balance with the forces of a law move
    the crossings along the path, so that the law misses them. Law and deflections are solved for again until
    the law passes the crossings at their times. `high` are the law's coefficients above its least degree.

    Raises:
        NoAnswer: no deflections in balance were found, or the polynomial misses the crossings.
    """
    max_balances = 40  # of law and deflections
    acceleration_step = 1e-4  # of differences in s" at a crossing, times the duration squared
    branch, crossings = to_cross.branch, to_cross.crossing_points
    unchanged = np.zeros(len(crossings))  # (k,) [1/s^2]
    steps = unchanged + acceleration_step / request.fixed_duration**2
    deflections: KnownDeflections | None = None  # of the last law
    edges = np.empty(0)  # of the panels of all laws through the last crossings

    def law_of(c: Array) -> Law:
        """Return the polynomial through the last crossings with s" changed by c (k,) [1/s^2]."""
        return _solve_law(crossings, timing, request, high, c)

    def law_on_panels(c: Array) -> InTime:
        """Return the law of `law_of` for c (k,) [1/s^2] with its panels."""
        return InTime(law_of(c), edges)

    for _ in range(max_balances):
        edges = panel_edges(branch, law_of(unchanged))
        if deflections is not None and not np.array_equal(deflections.splines.panels, edges):
            deflections = None  # its panels end elsewhere
        balance = solve_balance(branch, law_on_panels, steps, deflections)
        law, deflections = law_of(balance.state.scalars), balance.deflections
        crossings = tracker.follow(deflections.evaluate)
        s = np.array([point.s for point in crossings])  # (k,)
        miss = float(np.abs(law(tracker.times) - s).max(initial=0.0))
        if miss <= LAW_ROOT_ROUNDING:
            return law, deflections
    raise NotConverged(f"the polynomial misses the crossings by {miss:.2g} in s", residual=miss)


def _solve_law(
    crossings: Sequence[SingularPoint],
    timing: Sequence[CrossingTime],
    request: Request,
    high: Array = NO_HIGH,
    changes: Array | None = None,
) -> Law:
    """Solve for the polynomial with the s, s' and s" of each of k crossings.

    Args:
        high: coefficients of the law above its least degree.
        changes: (k,) [1/s^2] of s" at the crossings, added to those of the conditions; none by default.

    Raises:
        InvalidInput: there is no such polynomial with the user's times.
        NoLaw: there is no such polynomial with chosen times.
    """
    changes = np.zeros(len(crossings)) if changes is None else changes
    values = [  # s, s' and s" at each crossing
        (point.s, speed, point.acceleration_at(speed) + change)
        for point, (_, speed), change in zip(crossings, timing, changes, strict=True)
    ]
    inner = conditions_at_instants([time for time, _ in timing], values)
    try:
        return Law.rest_to_rest(request.fixed_duration, request.smoothness, inner, high, request.ends)
    except InvalidInput as problem:
        through = ", ".join(f"t = {time:g} s (s' = {speed:g} 1/s)" for time, speed in timing) or "the ends"
        why = f"no polynomial over {request.duration:g} s through {through} could be computed: {problem}"
        if request.times is None:
            raise NoLaw(why) from None
        raise InvalidInput(f"times: {why}; {OF_A_SCENE}").advising(OPTIMAL_LAW) from None


def undeformed_polynomial(
    to_cross: PathToCross, request: Request, *, searched: bool = True
) -> tuple[Law, tuple[CrossingTime, ...]]:
    """Compute a law of the undeformed robot that always advances.

    Open times and speeds are chosen. Torques are neither computed nor certified.

    Args:
        searched: whether open ones are searched if none of the first ones will do.

    Returns:
        The law, and times and speeds of its crossings. The law has the least degree if that one advances, or
        if the times are open.

    Raises:
        InvalidInput: times or speeds of the request do not suit the path.
        NoLaw: no law can cross, or none that advances was found.
    """
    duration = request.fixed_duration
    check_one_condition_each(to_cross.branch.robot, to_cross.crossing_points)
    for t in request.times or ():
        if not 0 < t < duration:
            raise InvalidInput(
                f"times: a crossing at t = {t:g} s must lie inside the motion, (0, {duration:g}) s; "
                f"{OF_A_SCENE}"
            ).advising(OPTIMAL_LAW)
    crossings = [
        require_effect(to_cross.branch, point, deflected=False) for point in to_cross.crossing_points
    ]
    try:
        timing = choose_timing(crossings, request, searched=searched) if crossings else ()
        law = _solve_law(crossings, timing, request)
        _refuse_turning_back(law, request, [point.s for point in to_cross.points])
        return law, timing
    except NoLaw as refusal:
        if not request.times:
            raise
        raised = next(_raise_degree(crossings, request), None)
        if raised is None:
            raise refusal.adding(f"nor was one of degree {RAISED_DEGREES[-1]} found") from None
        return raised


def _refuse_turning_back(law: PlannedLaw, request: Request, s: Sequence[float]) -> None:
    """Raise NoLaw if a law turns back, leaves the path, or repeats a crossing at s (k,)."""
    if law.least_speed_ratio(request.smoothness, request.ends) <= 0.0:  # otherwise it always advances
        check_advance(law, s)


def _raise_degree(
    crossings: Sequence[SingularPoint], request: Request, *, above: int = 0
) -> Iterator[tuple[Law, tuple[CrossingTime, ...]]]:
    """Find laws of higher degrees that advance, by degree, with times and speeds of their crossings.

    There are none if the times are open.

    Args:
        above: a degree; only higher ones are tried.
    """
    if not request.times:
        return
    from framework.planning.raised_polynomial import RaisedDegree  # slow to import, seldom needed

    places = [point.s for point in crossings]
    conditions = [point.condition for point in crossings if point.condition is not None]
    for degree in RAISED_DEGREES:
        if degree <= above:
            continue
        search = RaisedDegree(
            degree,
            request.fixed_duration,
            request.smoothness,
            request.ends,
            places,
            request.times,
            conditions,
            enough=COMFORTABLE_ADVANCE,
        )
        raised = search.find(request.speeds)
        if raised is None:
            continue
        speeds, high = raised
        timing = tuple(map(CrossingTime, request.times, speeds.tolist()))
        law = _solve_law(crossings, timing, request, high)
        if law.least_speed_ratio(request.smoothness, request.ends) > 0.0:
            yield law, timing


# ------------------------------------------------------------------ times and speeds of crossings


def choose_timing(
    crossings: Sequence[SingularPoint], request: Request, *, searched: bool = True
) -> tuple[CrossingTime, ...]:
    """Choose times and speeds of the crossings (k,), in their order on the path.

    Times or speeds of the request are kept. Candidates for the open ones are tried in turn: first those of
    the law without crossing conditions, then faster ones. The first candidate whose least speed ratio
    reaches COMFORTABLE_ADVANCE is chosen. If there is none, times and speeds are searched.

    Args:
        searched: whether times and speeds are searched if no candidate will do.

    Raises:
        NoLaw: the search finds no law that always advances.
    """
    if request.times is not None and request.speeds is not None:
        # nothing is open; `check_advance` judges the law
        return tuple(map(CrossingTime, request.times, request.speeds))
    s = [point.s for point in crossings]
    score_laws = partial(_score_laws, crossings, request)
    starts = _first_timings(s, request)  # (m, 2, k)
    scores = score_laws(starts)
    comfortable = np.flatnonzero(scores >= COMFORTABLE_ADVANCE)
    if len(comfortable):
        return tuple(map(CrossingTime, *starts[comfortable[0]].tolist()))
    if len(s) > MAX_CROSSINGS or not searched:
        raise NoLaw(
            f"the path meets {len(s)} singular points, and of {len(starts)} polynomials none keeps "
            f"its speed above {COMFORTABLE_ADVANCE:g} of the mean",
            clauses=("no others are searched: cut the path, take law optimal, or give all times and speeds",),
        )

    best_first = np.argsort(-scores, kind="stable")  # equal scores stay in the order of `starts`
    best, score = _search_timings(starts[best_first], request, score_laws)
    timing = tuple(map(CrossingTime, *best.tolist()))
    if score <= 0:
        or_optimal = "" if request.may_be_optimal else ", or take law optimal"  # or it is tried next
        raise NoLaw(
            f"no law that always advances found through s = {', '.join(f'{value:.6g}' for value in s)}, "
            f"tried t = {', '.join(f'{m.time:.6g}' for m in timing)} s, s' = "
            f"{', '.join(f'{m.speed:.6g}' for m in timing)} 1/s",
            clauses=(f"give other times, speeds or another duration{or_optimal}",),
        )
    return timing


def _first_timings(s: Sequence[float], request: Request) -> Array:
    """Return times and speeds (m, 2, k) of the laws to try first.

    The first entry has times and speeds of the law without crossing conditions. Each other entry has one
    speed for all crossings, and the times of a motion at this constant speed that passes s = 1/2 at half of
    the duration. The speeds are between 1.2 and 2.4 paths per duration, around 1.9, the peak of the law
    without crossing conditions and of smoothness 2.
    """
    duration = request.fixed_duration
    plain = Law.rest_to_rest(duration, request.smoothness, ends=request.ends)  # without crossing conditions
    if plain.least_speed_ratio(request.smoothness, request.ends) <= 0.0:  # its ends are too fast to advance
        plain = Law.rest_to_rest(duration, request.smoothness)
    ends = np.array([0.0, duration])
    plain_times = np.concatenate(find_instants(plain, ends, s))  # one each, as the law advances
    constant_speeds = np.linspace(1.2, 2.4, 7)[:, None] / duration  # (7, 1)
    constant_speed_times = 0.5 * duration + (np.array(s) - 0.5) / constant_speeds  # (7, k)

    times = np.vstack([plain_times, constant_speed_times])
    if request.times is not None:  # the user's times replace all others
        plain_times = np.array(request.times)
        times[:] = plain_times
    speeds = np.vstack([plain(plain_times, 1), np.repeat(constant_speeds, len(s), axis=1)])
    if request.speeds is not None:  # the user's speeds, too
        speeds[:] = request.speeds
    return np.stack([times, speeds], axis=1)


def _score_laws(crossings: Sequence[SingularPoint], request: Request, timings: Array) -> Array:
    """Score laws (m,) by the times and speeds (m, 2, k) of their crossings; higher is better.

    The score is the least speed ratio of the law. A law that reaches COMFORTABLE_ADVANCE scores
    this value plus the reciprocal of its dimensionless peak |s"|, so that gentler laws win. Impossible times
    or speeds score negative infinity.

    Args:
        crossings: k points with their s; condition (8), t_s . W_p = 0, gives s" for s'.
        timings: times [s] and speeds [1/s] of the k crossings of each law.
    """
    min_separation = 1e-3  # of crossings from each other and from the ends, over the duration
    duration = request.fixed_duration
    times, speeds = timings.swapaxes(0, 1)  # each (m, k)
    separation = np.diff(times, axis=1, prepend=0.0, append=duration).min(axis=1)
    possible = (separation >= min_separation * duration) & (speeds > 0).all(axis=1)
    scores = np.full(len(timings), -np.inf)
    s, speeds = np.broadcast_arrays([point.s for point in crossings], speeds[possible])
    accelerations = np.empty_like(speeds)
    for k, point in enumerate(crossings):
        accelerations[:, k] = point.acceleration_at(speeds[:, k])
    values = np.stack([s, speeds, accelerations], axis=2)  # (m, k, 3)
    speed_ratios, peaks = speed_ratios_and_peaks(
        duration, request.smoothness, times[possible], values, request.ends
    )
    by_peak = COMFORTABLE_ADVANCE + 1.0 / (peaks * duration**2)
    scores[possible] = np.where(speed_ratios < COMFORTABLE_ADVANCE, speed_ratios, by_peak)
    return scores


def _search_timings(
    starts: Array, request: Request, score_laws: Callable[[Array], Array]
) -> tuple[Array, float]:
    """Search open times and speeds; return the best (2, k) and its score.

    The method is an evolution strategy. The unknowns of a law are its times over the duration and the
    logarithms of its speeds; `score_laws` scores laws (m, 2, k). In the first round laws are drawn around all
    `starts` (m, 2, k), best first. In each further round they are drawn around the mean of the survivors,
    with the covariance of the survivors about the mean of the round before. This covariance stretches along
    an ascent of the score and shrinks at its maximum.
    The search ends when all survivors score COMFORTABLE_ADVANCE or more, or nearly the same.
    """
    # standard deviation in the first round, of times over the duration and of log speeds
    draw_spread = 0.1
    laws_per_survivor = 8  # the best one in so many is kept in each round
    min_spread = 1e-4  # of the survivors' scores; below, the search ends
    duration = request.fixed_duration
    is_open = np.array([[request.times is None], [request.speeds is None]])  # (2, 1)

    def to_timings(laws: Array) -> Array:
        """Convert unknowns (m, 2, k) to times [s] and speeds [1/s], or the request's own."""
        physical = np.stack([duration * laws[:, 0], np.exp(laws[:, 1])], axis=1)
        return np.where(is_open, physical, starts[0])

    random = np.random.default_rng(0)
    first_laws = np.stack([starts[:, 0] / duration, np.log(starts[:, 1])], axis=1)  # (m, 2, k)
    count = LAWS_PER_UNKNOWN * int(is_open.sum()) * starts.shape[2]  # laws drawn in each round
    centres = first_laws[random.integers(len(starts), size=count)]
    drawn = centres + is_open * draw_spread * random.standard_normal(centres.shape)

    # the survivors, best first, with their scores, and the mean of the survivors of the round before
    laws = first_laws[:1]
    scores = score_laws(starts[:1])
    mean = first_laws[0]
    for _ in range(MAX_ROUNDS):
        # survivors of the round before stay in the race
        laws = np.concatenate([laws, drawn])
        scores = np.concatenate([scores, score_laws(to_timings(drawn))])
        survivors = np.argsort(-scores, kind="stable")[: count // laws_per_survivor]
        laws, scores = laws[survivors], scores[survivors]
        if scores[-1] >= COMFORTABLE_ADVANCE or scores[-1] > scores[0] - min_spread:
            break
        # sums of offsets with independent normal weights have the covariance of the offsets
        weights = random.standard_normal((count, len(laws))) / np.sqrt(len(laws))
        steps = np.tensordot(weights, laws - mean, axes=1)  # (count, 2, k)
        mean = laws.mean(axis=0)  # (2, k)
        drawn = mean + steps
    return to_timings(laws[:1])[0], scores[0]
