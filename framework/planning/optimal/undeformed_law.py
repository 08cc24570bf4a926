"""The best law of an undeformed robot, or of one with known deflections: found, or the reason why not.

Viscous damping is linearised about the law before, until what the tangent leaves of its torque is little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from framework.errors import InvalidInput, NotConverged
from framework.laws.exact_duration import SpeedSpace
from framework.laws.optimal_law import OptimalLaw
from framework.planning.condition import CrossingPoint
from framework.planning.optimal.best_law import Best, adapt_law, find_best_law, resume_law
from framework.planning.optimal.law_problem import POLE_WIDTH, LawProblem, condition_rows
from framework.planning.optimal.least_cost import NoneFound
from framework.planning.optimal.limit_refusals import refuse_law
from framework.planning.optimal.optimal_task import (
    Task,
    check_speeds,
    conditions_at,
    crossing_places,
    other_law,
)
from framework.planning.optimal.phase_plane import Deflections, SquaredSpeed
from framework.planning.optimal.sampled_demand import sample_demand
from framework.tolerances import DAMPING_TORQUE_ERROR, SMOOTHNESS_COST

MAX_TANGENTS = 20  # of damping linearised about the previous law
MAX_CONDITION_STEPS = 4  # of Newton's method, from a law that nearly meets condition (8)


def find_undeformed_law(task: Task) -> Best:
    """Find the best law of the undeformed robot, without a certificate.

    Raises:
        NoLaw: none was found within the limits; NotConverged: law and damping do not settle, or the solver
            gave up.
    """
    places = crossing_places(task, None, None)
    check_speeds(task, places)
    return find_law(task, places)


def find_law(
    task: Task,
    places: Sequence[CrossingPoint],
    *,
    deflections: Deflections | None = None,
    share: float = SMOOTHNESS_COST,
    degree: int | None = None,
) -> Best:
    """Find the best law through these places, with deflections along the path if they are known.

    Args:
        share: of the least cost, which smoothness may take.
        degree: of z as one series, in place of a spline.

    Raises:
        As `find_undeformed_law`.
    """
    sampled = sample_demand(task) if deflections is None else None
    problem = problem_of(task, places, deflections)._replace(degree=degree, sampled=sampled)
    best = _found_or_refused(problem, find_best_law(problem, share=share))
    if not task.branch.robot.is_damped:
        return best
    for _ in range(MAX_TANGENTS):
        problem = _linearise_damping(problem, places, best.law.squared_speed)
        found = resume_law(best, problem)
        if isinstance(found, NoneFound):
            found = find_best_law(problem, best.program.cells, share=share)
        best = _found_or_refused(problem, found)
        error = _tangent_error(problem, best)
        if error <= DAMPING_TORQUE_ERROR:
            return best._replace(law=_meet_conditions(problem, places, best.law))
    raise NotConverged(
        f"{task.branch.robot.name}: law and damping do not settle together in {MAX_TANGENTS} passes; "
        f"use {other_law(task)}another duration",
        residual=error,
    )


def adapt_found_law(
    task: Task,
    places: Sequence[CrossingPoint],
    best: Best,
    *,
    excess: float = 1.0,
    share: float | None = None,
) -> Best:
    """Find a smooth law near the best, within tighter limits or at more of the least cost, see `adapt_law`.

    Args:
        excess: largest torque or speed of the best law's motion over its limit.
        share: of the least cost, which smoothness may take.

    Raises:
        NotConverged: there is none near.
    """
    adapted = adapt_law(best, excess=excess, share=share)
    if isinstance(adapted, NoneFound):
        raise NotConverged(
            f"{task.branch.robot.name}: no law near the best keeps all limits between its points",
            residual=excess - 1.0,
        )
    if not task.branch.robot.is_damped:
        return adapted
    # the linearisation of damping has moved with the law, and condition (8) with it
    return adapted._replace(law=_meet_conditions(adapted.program.problem, places, adapted.law))


def problem_of(
    task: Task, places: Sequence[CrossingPoint], deflections: Deflections | None = None
) -> LawProblem:
    """Return the problem of a task, without damping."""
    return LawProblem(task, *conditions_at(task, places, deflections), deflections)


def _linearise_damping(
    problem: LawProblem, places: Sequence[CrossingPoint], before: SquaredSpeed
) -> LawProblem:
    """Return the problem with damping linearised about the squared speed of a law."""
    crossings, conditions = conditions_at(problem.task, places, problem.deflections, before)
    return problem._replace(crossings=crossings, conditions=conditions, before=before)


def _found_or_refused(problem: LawProblem, found: Best | NoneFound) -> Best:
    """Return what was found for a problem; raises as `find_undeformed_law`."""
    if isinstance(found, NoneFound):
        raise refuse_law(problem, found)
    return found


def _tangent_error(problem: LawProblem, best: Best) -> float:
    """Return the largest torque that linearised damping is off, over the peak of the law.

    Beside crossings, where torques have a pole, condition (8) is met with the damping itself.
    """
    task, before = problem.task, problem.before
    assert before is not None
    xi = best.program.xi
    beside = np.abs(xi[:, None] - problem.places).min(axis=1, initial=np.inf) < POLE_WIDTH
    sigma = task.stretch.inverse(xi[~beside][1:-1])
    root = np.sqrt(before(sigma))
    z = best.law.squared_speed(sigma)
    off = problem.demand(sigma).damping * (np.sqrt(z) - 0.5 * (root + z / root))[:, None]
    return float(np.abs(off / best.reference).max(initial=0.0)) / best.peak


def _meet_conditions(problem: LawProblem, places: Sequence[CrossingPoint], law: OptimalLaw) -> OptimalLaw:
    """Return the law nearest in speed that meets condition (8) with damping, to rounding."""
    for _ in range(MAX_CONDITION_STEPS):
        problem = _linearise_damping(problem, places, law.squared_speed)
        try:
            space, rows = SpeedSpace(law.basis, law.stretch), condition_rows(problem, law.basis)
            law = replace(law, coefficients=space.adjust(law.coefficients, rows, law.duration))
        except InvalidInput as reason:
            raise NotConverged(
                f"{problem.task.branch.robot.name}: no law near the best has condition (8) with damping "
                f"({reason})",
                residual=np.inf,
            ) from None
    return law
