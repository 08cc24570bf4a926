"""The best law of an undeformed robot, or of torques linear in the law, or the refusal if there is none.

Viscous damping is linearised about the previous law, until the error of the linearised torque is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from framework.errors import InvalidInput, NotConverged
from framework.laws.optimal_law import OptimalLaw
from framework.laws.squared_speed import SpeedSpace
from framework.planning.condition import CrossingPoint
from framework.planning.optimal.best_law import Best, adapt_law, find_best_law, resume_law
from framework.planning.optimal.law_problem import POLE_WIDTH, LawProblem, condition_rows
from framework.planning.optimal.least_cost import NoneFound
from framework.planning.optimal.limit_refusals import refuse_law
from framework.planning.optimal.optimal_task import (
    Task,
    check_speeds,
    conditions_at,
    find_crossing_points,
    other_law,
)
from framework.planning.optimal.phase_plane import SquaredSpeed
from framework.planning.optimal.sampled_demand import sample_demand
from framework.tolerances import DAMPING_TORQUE_ERROR, SMOOTHNESS_COST

MAX_TANGENTS = 20  # linearisations of damping about the previous law
MAX_CONDITION_STEPS = 4  # Newton steps from a law that nearly meets condition (8)


def find_undeformed_law(task: Task) -> Best:
    """Find the best law of the undeformed robot, without a certificate.

    Raises:
        NoLaw: no law was found within the limits.
        NotConverged: law and damping do not settle together, or the solver gave up.
    """
    points = find_crossing_points(task)
    check_speeds(task, points)
    return find_law(task, points)


def find_law(task: Task, points: Sequence[CrossingPoint]) -> Best:
    """Find the best law through crossing points.

    Damping is linearised about the previous law, until the error of the linearisation is small.

    Raises:
        As `find_undeformed_law`.
    """
    problem = problem_of(task, points)._replace(sampled=sample_demand(task))
    best = solve_problem(problem)
    if not task.robot.is_damped:
        return best
    for _ in range(MAX_TANGENTS):
        problem = _linearise_damping(problem, points, best.law.squared_speed)
        result = resume_law(best, problem)
        if isinstance(result, NoneFound):
            result = find_best_law(problem, best.program.cells)
        best = _require_law(problem, result)
        error = _tangent_error(problem, best)
        if error <= DAMPING_TORQUE_ERROR:
            return best._replace(law=_meet_conditions(problem, points, best.law))
    raise NotConverged(
        f"{task.robot.name}: law and damping do not settle together in {MAX_TANGENTS} passes; "
        f"use {other_law(task)}another duration",
        residual=error,
    )


def adapt_found_law(
    task: Task,
    points: Sequence[CrossingPoint],
    best: Best,
    *,
    excess: float = 1.0,
    share: float | None = None,
) -> Best:
    """Find a smooth law near the best, with tighter limits or a larger cost; see `adapt_law`.

    Args:
        excess: largest torque or speed of the best law's motion over its limit.
        share: of the least cost, by which a smooth law may exceed it.

    Raises:
        NotConverged: no such law was found.
    """
    adapted = adapt_law(best, excess=excess, share=share)
    if isinstance(adapted, NoneFound):
        raise NotConverged(
            f"{task.robot.name}: no law near the best keeps all limits between its points",
            residual=excess - 1.0,
        )
    if not task.robot.is_damped:
        return adapted
    # condition (8) was linearised about another law
    return adapted._replace(law=_meet_conditions(adapted.program.problem, points, adapted.law))


def problem_of(
    task: Task, points: Sequence[CrossingPoint], speed_places: Sequence[float] | None = None
) -> LawProblem:
    """Return the problem of a task, without damping; see `conditions_at`."""
    return LawProblem(task, *conditions_at(task, points, None, speed_places))


def solve_problem(
    problem: LawProblem, *, share: float = SMOOTHNESS_COST, similar: Best | None = None
) -> Best:
    """Find the best law of a problem.

    Args:
        share: of the least cost, by which a smooth law may exceed it.
        similar: the law of a similar problem; the search resumes from it if z has the same basis.

    Raises:
        As `find_undeformed_law`.
    """
    if similar is not None and similar.program.problem.degree == problem.degree:
        return _require_law(problem, resume_law(similar, problem, share=share))
    units = None if similar is None else similar.search.units
    return _require_law(problem, find_best_law(problem, share=share, units=units))


def _linearise_damping(problem: LawProblem, points: Sequence[CrossingPoint], z0: SquaredSpeed) -> LawProblem:
    """Return the problem with damping linearised about the squared speed z0 of a law."""
    crossings, conditions = conditions_at(problem.task, points, z0)
    return problem._replace(crossings=crossings, conditions=conditions, z0=z0)


def _require_law(problem: LawProblem, result: Best | NoneFound) -> Best:
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
    root_z0 = np.sqrt(problem.z0(sigma))
    z = best.law.squared_speed(sigma)
    root_error = np.sqrt(z) - 0.5 * (root_z0 + z / root_z0)
    torque_error = problem.demand(sigma).damping * root_error[:, None]
    return float(np.abs(torque_error / best.reference).max(initial=0.0)) / best.peak


def _meet_conditions(problem: LawProblem, points: Sequence[CrossingPoint], law: OptimalLaw) -> OptimalLaw:
    """Find the law nearest in speed that meets condition (8) with damping, to rounding."""
    space = SpeedSpace(law.basis, law.stretch)
    for _ in range(MAX_CONDITION_STEPS):
        problem = _linearise_damping(problem, points, law.squared_speed)
        rows = condition_rows(problem, law.basis)
        try:
            law = replace(law, coefficients=space.adjust(law.coefficients, rows, law.duration))
        except InvalidInput as reason:
            raise NotConverged(
                f"{problem.task.robot.name}: no law near the best has condition (8) with damping ({reason})",
                residual=np.inf,
            ) from None
    return law
