"""The best law of an undeformed robot, or of torques linear in the law, or the refusal if there is none.

A law is a squared speed z = (d sigma/dt)^2 along the path's parameter sigma. Viscous damping, torque-speed
curves and RMS torques over an open duration are linearised about the previous law, until errors are small.

A failed search on cells proves nothing. Two bounds of every law do: the torque that holds the robot at rest
at the ends, and the bound of the peak torque by duality (`peak_bound`). A refusal advises limits and
durations only after a law was planned with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from framework.errors import InvalidInput, NoLaw, NotConverged, format_distinct, round_up
from framework.laws.optimal_law import OptimalLaw, Smoothstep
from framework.laws.squared_speed import SpeedSpace
from framework.planning.optimal.best_law import Best, adapt_law, find_best_law, resume_law
from framework.planning.optimal.law_problem import POLE_WIDTH, LawProblem, condition_rows, motor_rows
from framework.planning.optimal.least_cost import NoneFound, find_least_cost
from framework.planning.optimal.optimal_task import Task, check_speeds, conditions_at
from framework.planning.optimal.path_series import sample_demand
from framework.planning.optimal.peak_bound import find_refuting_bound, torques_at_ends
from framework.planning.optimal.phase_plane import SquaredSpeed, demand
from framework.planning.optimal.smooth_search import NEARLY_REACHED
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.planning.refusals import (
    ELASTIC_RATIO,
    LARGEST_RAISE,
    PRINTED_DIGITS,
    RAISED_RATIO,
    HoldingTorque,
    SearchEvidence,
)
from framework.tolerances import (
    BOUND_MARGIN,
    DAMPING_TORQUE_ERROR,
    DRIVE_SLACK,
    LIMIT_MARGIN,
    SMOOTHNESS_COST,
)

MAX_TANGENTS = 20  # linearisations about the previous law
SLOWER_STARTS = np.arange(9, 0, -1) / 10  # shares of the speed of a start from which no law brakes
MAX_CONDITION_STEPS = 4  # Newton steps from a law that nearly meets condition (8)


def find_undeformed_law(task: Task) -> Best:
    """Find the best law of the undeformed robot through the crossing points, with its own damping.

    The law has no certificate.

    Raises:
        NoLaw: no law was found within the limits.
        NotConverged: law and damping do not settle together, or the solver gave up.
    """
    check_speeds(task)
    problem = problem_of(task)._replace(sampled=sample_demand(task))
    result = settle_tangents(problem)
    if isinstance(result, NoneFound):
        raise refuse_law(result.program.problem, result)
    return result


def settle_tangents(problem: LawProblem, *, enough: float = 0.0) -> Best | NoneFound:
    """Find the best law, with damping and limits of drives linearised about itself.

    Rows of torque-speed curves are inner approximations: each law is within the curves. RMS torques over an
    open duration count over a suggested time.

    The tangent of sqrt(z) at the z0 of a law exceeds sqrt(z). So a problem without a law about one z0 may
    have one about another. The second z0 is that of the law of least peak without limits of torque.

    Args:
        enough: peak over the reference, with the damping of the law, below which the search may end.

    Raises:
        NotConverged: law and damping do not settle together.
    """
    longest = problem.specification.longest
    drives = problem.specification.drives
    if drives is not None and problem.specification.goal == "time" and longest is not None:
        # inner approximations about other laws may ask for more time than the quickest law
        result = settle_tangents(problem.with_goal("time", longest=None))
        if isinstance(result, NoneFound) or result.law.duration <= longest:
            return result
        resumed = resume_law(result, result.program.problem.with_goal("time", longest=longest))
        if isinstance(resumed, NoneFound):
            return NoneFound(resumed.program, f"the quickest found takes {result.law.duration:.4g} s")
        return resumed
    result = find_best_law(problem)
    is_damped = problem.task.robot.is_damped
    averages = problem.averages_open_duration
    if not is_damped and not averages and (drives is None or not drives.has_curve.any()):
        return result  # nothing is linearised
    is_about_least_peak = not problem.specification.limited
    for _ in range(MAX_TANGENTS):
        if isinstance(result, NoneFound):
            if is_about_least_peak:
                return result
            is_about_least_peak = True
            no_limit = np.full_like(problem.reference, np.inf)
            lifted = problem.with_goal("peak_torque", torque_limit=no_limit, drives=None)
            result = settle_tangents(lifted, enough=1.0 - 2.0 * LIMIT_MARGIN)
            if isinstance(result, NoneFound):
                return result
            problem = _linearise(problem, result.law.squared_speed)
            result = find_best_law(problem)
            continue
        last = result
        counts_all = not averages or problem.average_over is not None
        problem = _linearise(problem, result.law.squared_speed)
        if averages:
            problem = problem._replace(average_over=suggest_time(result))
        resumed = resume_law(result, problem)
        if isinstance(resumed, NoneFound):  # search again, without the last law
            resumed = find_best_law(problem, result.program.cells)
        result = resumed
        if isinstance(result, NoneFound):
            if counts_all and not is_damped:
                return last
            continue
        is_settled = _drive_slack(problem, result) <= DRIVE_SLACK
        if not is_damped:
            if is_settled:
                return result
            continue
        error = _tangent_error(problem, result)
        if is_settled and (error <= DAMPING_TORQUE_ERROR or (1.0 + error) * result.peak <= enough):
            return result._replace(law=_meet_conditions(problem, result.law))
    if not is_damped:  # the last law is within the limits of drives, and may be slower than needed
        return result
    raise NotConverged(
        f"law and damping do not settle together in {MAX_TANGENTS} passes",
        name=problem.task.robot.name,
        residual=error,
    )


def adapt_found_law(best: Best, *, excess: float = 1.0, share: float | None = None) -> Best:
    """Find a smooth law near the best, as `adapt_law`, that meets condition (8) with its own damping."""
    adapted = adapt_law(best, excess=excess, share=share)
    problem = adapted.program.problem
    if not problem.task.robot.is_damped:
        return adapted
    # condition (8) was linearised about another law
    return adapted._replace(law=_meet_conditions(problem, adapted.law))


def problem_of(task: Task, places: Sequence[float] | None = None) -> LawProblem:
    """Return the problem of a task, without damping.

    Args:
        places: s of the required times and speeds; by default the crossing points.
    """
    if places is None:
        places = [point.s for point in task.targets]
    stops = [float(task.phi.inverse(s)) for s in places] if task.specification.times else ()
    return LawProblem(task, *conditions_at(task, None, places), tuple(stops))


def solve_problem(
    problem: LawProblem,
    *,
    share: float = SMOOTHNESS_COST,
    similar: Best | None = None,
) -> Best:
    """Find the best law of a problem.

    Args:
        similar: the law of a similar problem; the search resumes from it if z has the same basis.

    Raises:
        NoLaw: no law was found within the limits.
        NotConverged: the solver gave up.
    """
    if similar is not None and similar.program.problem.degree == problem.degree:
        return require_law(problem, resume_law(similar, problem, share=share))
    units = None if similar is None else similar.search.units
    return require_law(problem, find_best_law(problem, share=share, units=units))


def _linearise(problem: LawProblem, z0: SquaredSpeed) -> LawProblem:
    """Return the problem with damping and drives linearised about a law's z0."""
    crossings, conditions = conditions_at(problem.task, z0)
    return problem._replace(crossings=crossings, conditions=conditions, z0=z0)


def suggest_time(best: Best) -> float:
    """Return the time [s] over which to average squared torques, by a law of open duration T.

    Inertial torques fall with the square of time: where the largest RMS torque over T is e times its limit, a
    law within the limit takes about T e^(1/2). At e = 1 this is T. The time is a little shorter, so that the
    last law takes longer.
    """
    duration = best.speed.duration
    return float((1.0 - 0.5 * DRIVE_SLACK) * duration * np.sqrt(rms_ratio(best, duration)))


def rms_ratio(best: Best, time: float) -> float:
    """Return the largest ratio of RMS torques over a time [s] to limits."""
    drives = best.program.problem.specification.drives
    assert drives is not None
    mean_squares = best.program.squared_torques(best.speed.y) / time
    return float(np.max(np.sqrt(mean_squares) / drives.rms_torque_limit))


def _drive_slack(problem: LawProblem, best: Best) -> float:
    """Compute the share of drives' limits that linearisation elsewhere leaves free.

    Where a curve is nearly reached, it is the difference of the ratios by the tangent and by the law itself.
    RMS torques over a time that is longer than the law count as not settled; a shorter one leaves a share
    free if they reach their limits.
    """
    drives = problem.specification.drives
    if drives is None:
        return 0.0
    program, y = best.program, best.speed.y
    slack = 0.0
    if problem.average_over is not None:
        missing = 1.0 - problem.average_over / best.speed.duration
        is_reached = rms_ratio(best, problem.average_over) > NEARLY_REACHED
        slack = np.inf if missing < 0.0 and is_reached else 0.5 * missing * is_reached
    about_itself = _linearise(problem, best.law.squared_speed)
    rows = motor_rows(about_itself, program.basis, program.conditions, program.xi, program.frames)
    for curve, own in zip(program.rows.curve, rows.curve, strict=True):
        ratio = curve(y)[: len(program.xi)]
        slack = max(slack, np.max((ratio - own(y))[ratio > NEARLY_REACHED], initial=0.0))
    return slack


def require_law(problem: LawProblem, result: Best | NoneFound) -> Best:
    """Return the law of a search; raise the refusal if none was found."""
    if isinstance(result, NoneFound):
        raise refuse_law(problem, result)
    return result


def _tangent_error(problem: LawProblem, best: Best) -> float:
    """Compute the largest error of linearised damping torques, divided by the peak torque of the law.

    The program replaces damping torques d sqrt(z) by their tangent d (sqrt(z0) + z / sqrt(z0)) / 2 at the
    squared speed z0. The error is taken at the points xi of the program, where sigma = stretch^-1(xi). Points
    beside crossings, where torques have a pole, are left out: the final law meets condition (8) with the
    damping itself. The first and the last point are left out because z0 = 0 there.
    """
    assert problem.z0 is not None
    xi = best.program.xi
    is_beside = np.abs(xi[:, None] - problem.crossing_xi).min(axis=1, initial=np.inf) < POLE_WIDTH
    sigma = problem.task.stretch.inverse(xi[~is_beside][1:-1])
    root_z0 = np.sqrt(problem.z0(sigma))  # of the previous law
    z = best.law.squared_speed(sigma)
    root_error = np.sqrt(z) - 0.5 * (root_z0 + z / root_z0)
    torque_error = problem.demand(sigma).damping * root_error[:, None]
    return float(np.abs(torque_error / best.reference).max(initial=0.0)) / best.peak


def _meet_conditions(problem: LawProblem, law: OptimalLaw) -> OptimalLaw:
    """Find the law nearest in speed that meets condition (8), t_s . W_p = 0, with damping, to rounding."""
    space = SpeedSpace(law.basis, law.stretch)
    for _ in range(MAX_CONDITION_STEPS):
        problem = _linearise(problem, law.squared_speed)
        rows = condition_rows(problem, law.basis)
        try:
            y = space.adjust(law.coefficients, rows, problem.instants_until(law.duration))
            law = replace(law, coefficients=y)
        except InvalidInput as reason:
            raise NotConverged(
                f"no law near the best has condition (8) with damping ({reason})",
                name=problem.task.robot.name,
                residual=np.inf,
            ) from None
    return law


def refuse_law(problem: LawProblem, none: NoneFound) -> NoLaw | NotConverged:
    """Return the refusal of a problem without a law, with a proof or the evidence of a search.

    A motor that cannot hold the robot at an end of the path excludes every law. So does a bound of all peaks
    above the limits. Without such a proof the refusal states the least limits that were found. If none were
    found either, the limits may not be the reason: the search has not converged.

    Args:
        none: the failed search.
    """
    name = problem.task.robot.name
    cells = len(none.program.basis.cells) - 1
    not_found = NotConverged(
        f"no optimal law was found on {cells} cells: {none.status}", name=name, residual=np.inf
    )
    if problem.response is not None or not problem.task.to_cross.explained:
        return not_found  # torques linearised about another motion prove nothing about limits
    if problem.specification.drives is not None:  # the least limits below are those without drives
        problem = problem.with_goal(problem.specification.goal, drives=None)
        if isinstance(settle_tangents(problem), Best):
            words = "no law of free shape was found within torque-speed curves and RMS torques"
            return NotConverged(words, name=name, residual=np.inf)
    holding = _overloaded_at_ends(problem)
    evidence = find_least_limits(problem)._replace(cells=cells)
    if holding is None and not none.infeasible and not evidence.has_peaks:
        return not_found

    # a proof, if there is one, and what would help
    if holding is not None:
        return _refuse_holding(problem, holding, evidence)
    quickest = None if problem.specification.max_duration is None else _find_quickest(problem)
    proof = find_refuting_bound(problem.task)
    evidence = evidence._replace(quickest=quickest, start_speed=_find_slower_start(problem))
    start = ""
    if evidence.start_speed is not None:
        start = f" from s' = {problem.specification.ends.start[0]:g} 1/s"
    reason = f"no law of free shape was found{start}{_describe_times(none.program)}"
    if proof is not None:
        peak, _ = format_distinct(proof.value, 1.0)
        start += ", too fast to brake within the limits" if start else ""
        reason = f"no law is admissible{start}: each needs {peak} times the torque limits or more"
        reason += ", if the speeds keep theirs" * evidence.together
    return NoLaw(reason, name=name, clauses=evidence.clauses, proof=proof, evidence=evidence)


def _describe_times(program: SpeedProgram) -> str:
    """Describe the required times and the stages that are too short for them.

    Too short is a stage that takes longer in the quickest law found within the limits. A stage leads from the
    start or a crossing to the next crossing or the end.
    """
    problem = program.problem
    times = problem.specification.times
    if not times:
        return ""
    words = f" that crosses at t = {', '.join(f'{t:g}' for t in times)} s"
    units = Units(problem.specification.max_duration or times[-1], 1.0)
    instants = ["the start", *(f"t = {t:g} s" for t in times), "the end"]
    for stage, required in enumerate(problem.stages):
        quickest = program.minimise("time", Bounds(), units, stage=stage) if np.isfinite(required) else None
        if isinstance(quickest, Speed) and quickest.durations[stage] > required:
            words += (
                f", but from {instants[stage]} to {instants[stage + 1]} the quickest found within the limits "
                f"takes {quickest.durations[stage]:.4g} s"
            )
    return words


def _refuse_holding(problem: LawProblem, holding: HoldingTorque, evidence: SearchEvidence) -> NoLaw:
    """Return the refusal of a path at whose start or end a motor cannot hold the robot."""
    robot = problem.task.robot
    end = "start" if holding.s == 0 else "end"
    unit = dict(zip(robot.actuator_names, robot.torque_units, strict=True))[holding.joint]
    needed, allowed = format_distinct(holding.torque, holding.limit)
    has_friction = robot.joint_friction.any()
    uncounted = " (dry friction, which may hold some of it, not counted)" if has_friction else ""
    load = f"hold {needed} {unit} at rest{uncounted}"
    ends = problem.specification.ends
    if ends.moving[int(holding.s)]:
        speed, acceleration = ends.derivatives(2)[int(holding.s)]
        load = f"drive with {needed} {unit} at s' = {speed:g} 1/s and s\" = {acceleration:g} 1/s^2"
    shared = ", even with the load shared best" if problem.specification.shares_freely else ""
    return NoLaw(
        f"no law is admissible: at the {end} {holding.joint} must {load}, and may {allowed}{shared}",
        name=robot.name,
        proof=holding,
        evidence=evidence,
    )


def find_least_limits(problem: LawProblem) -> SearchEvidence:
    """Find the least multiples of the limits with which a problem has a law.

    First, torque limits and speed limits are raised alone, within the limits of the other kind. If neither
    suffices, both are raised together.
    """
    specification = problem.specification
    # peaks are relative to the reference: infinite for a motor without a limit, which then does not count
    over_limits = problem._replace(chosen_reference=specification.torque_limit)

    def find_least(goal: str, *, counts: bool = True) -> tuple[float | None, float | None]:
        """Return the peaks of torque and speed of the law of least peaks, if the limits count."""
        if not counts:
            return None, None
        least = find_least_cost(over_limits.with_goal(goal), torque_limits=goal != "peak_torque")
        return (None, None) if isinstance(least, NoneFound) else (least.speed.peak, least.speed.peak_speed)

    torque, _ = find_least("peak_torque", counts=specification.limited)
    _, speed = find_least("peak_speed", counts=specification.limited_speeds)
    together = torque is None and speed is None and specification.limited and specification.limited_speeds
    if together:
        torque, speed = find_least("limits")
        together = torque is not None
    # a little above the peaks, with the margin of the request
    ratio = ELASTIC_RATIO if problem.task.robot.n_e else RAISED_RATIO
    ratio /= 1.0 - problem.task.request.margin
    limits = {}
    for name, peak in (("torque_limit", torque), ("speed_limit", speed)):
        if peak is not None and peak <= LARGEST_RAISE:
            raised = ratio * peak * getattr(specification, name)  # (n_a,)
            limits[name] = np.array([round_up(limit, PRINTED_DIGITS) for limit in raised])
    options = [{name: limit} for name, limit in limits.items()]
    if together:
        options = [limits] if len(limits) == 2 else []
    return SearchEvidence(0, torque, speed, together, options)


def _find_slower_start(problem: LawProblem) -> tuple[float, ...] | None:
    """Find derivatives of s at a slower start from which a law keeps the limits; None without one.

    The same motion, slowed to a share v of its speed, starts with v s', v^2 s", ...
    """
    ends = problem.specification.ends
    for share in SLOWER_STARTS if ends.start else ():
        start = tuple(
            float(f"{derivative * share**order:.{PRINTED_DIGITS}g}")
            for order, derivative in enumerate(ends.start, start=1)
        )
        slower = problem.with_goal(problem.specification.goal, ends=ends._replace(start=start))
        if not isinstance(find_least_cost(slower), NoneFound):
            return start
    return None


def _find_quickest(problem: LawProblem) -> float | None:
    """Find a duration [s] near the least within the limits; None without limits or if no law was found."""
    if not (problem.specification.limited or problem.specification.limited_speeds):
        return None
    result = settle_tangents(problem.with_goal("time", duration=None, longest=None))
    return result.law.duration if isinstance(result, Best) else None


def _overloaded_at_ends(problem: LawProblem) -> HoldingTorque | None:
    """Find a torque above its limit at an end of the path, at rest or in motion; None without one."""
    task = problem.task
    limit = problem.specification.torque_limit
    at_rest = demand(task.branch, Smoothstep(0), np.array([0.0, 1.0])).torque.constant
    is_moving = np.array(problem.specification.ends.moving)[:, None]
    torques = np.where(is_moving, torques_at_ends(task), at_rest)  # (2, n_a)
    holding = np.abs(problem.least_peak(torques, np.array([-1.0, 1.0])))
    rounding = BOUND_MARGIN if problem.specification.shares_freely else 0.0  # of a solver
    overloaded = np.argwhere(holding > (1.0 + rounding) * limit)  # rows (end, motor)
    if not len(overloaded):
        return None
    end, motor = overloaded[0]  # end: 0 for s = 0, 1 for s = 1
    joint = task.robot.actuator_names[motor]
    return HoldingTorque(joint, float(end), float(holding[end, motor]), float(limit[motor]))
