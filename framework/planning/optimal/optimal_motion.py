"""The best motion along a path: the law of a cone program and certified inverse dynamics in turn.

A rigid robot needs each once. An elastic one follows the series nearest to the law whose deflections are in
balance; then the law is sought again with these, as functions of the path parameter, as long as the certified
motion becomes better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer, NoLaw, NotConverged, SpringsTooSoft, UnboundedTorque
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.peaks import peak_sizes
from framework.numerics.time_limit import SearchEnded, report_result
from framework.planning.condition import CrossingPoint
from framework.planning.optimal.best_law import LIMIT_TIGHTENING, Best
from framework.planning.optimal.elastic_balance import in_balance
from framework.planning.optimal.optimal_task import (
    Task,
    check_speeds,
    check_unfolded,
    crossing_places,
    other_law,
)
from framework.planning.optimal.phase_plane import Deflections, DeflectionsOnPath
from framework.planning.optimal.rest_of_springs import check_rest
from framework.planning.optimal.undeformed_law import adapt_found_law, find_law
from framework.planning.specification import Specification
from framework.tolerances import PEAK_TORQUE_MISMATCH

MAX_PASSES = 8  # of optimising and resolving in turn
ENERGY_SAMPLES = 2001
RIGID_SHARES = (2e-2, 8e-2, 0.3)  # of the least cost, for laws smooth enough to be resolved, in turn
# Of elastic robots: the share of the least cost that smoothness may take, in turn, until deflections are
# resolved and at rest at both ends, with the degree of z as one series. A higher degree takes three times as
# long and is tried before much of the cost is paid.
ELASTIC_RUNGS = ((4e-3, 40), (2e-2, 40), (8e-2, 40), (8e-2, 60), (0.3, 40), (1.0, 40))


class OptimalMotion(NamedTuple):
    """The certified motion with the law that was found best, and the search that it comes from."""

    dynamics: InverseDynamics
    law: OptimalLaw
    best: Best


def optimal_motion(task: Task) -> OptimalMotion:
    """Find the best law, and certify it with all limits kept.

    Raises:
        NoLaw: none was found within the limits; says what stands against it.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve`.
    """
    check_unfolded(task)
    places = crossing_places(task, None, None)
    robot = task.branch.robot
    if robot.n_e and robot.is_damped:
        raise NoLaw(
            f"{robot.name}: optimal laws of elastic robots with damping are not supported; use "
            f"{other_law(task)}flexibility rigid"
        )
    check_speeds(task, places)
    if robot.n_e:
        return _elastic(task, places)
    best = find_law(task, places)
    for share in RIGID_SHARES:
        try:
            return _certify_law(task, places, best)
        except NotConverged as failure:
            unresolved = failure
        except UnboundedTorque as failure:  # condition (8) is met but for rounding
            unresolved = NotConverged(str(failure), residual=abs(failure.wrench), s=failure.s)
        best = adapt_found_law(task, places, best, share=share)
    raise unresolved


def _certify_law(task: Task, places: Sequence[CrossingPoint], best: Best) -> OptimalMotion:
    """Certify the motion of a rigid robot's law, lowering limits that the motion exceeds.

    Raises:
        NotConverged: limits are exceeded still; as `resolve`.
    """
    for _ in range(MAX_PASSES):
        dynamics, law, _ = _resolved(task, best.law, None)
        excess = limit_excess(dynamics, task.specification)
        if excess <= 1.0:
            return OptimalMotion(dynamics, law, best)
        best = adapt_found_law(task, places, best, excess=excess)
    raise NotConverged(
        f"{task.branch.robot.name}: no law within all limits is resolved in {MAX_PASSES} passes",
        residual=abs(excess - 1.0),
    )


def _elastic(task: Task, places: Sequence[CrossingPoint]) -> OptimalMotion:
    """Find laws and balances in turn, as long as the certified motion becomes better.

    Each search has the deflections of the motion before, as functions of the path parameter. What is not
    resolved or at rest at its ends is followed by a smoother law, with more of its derivatives zero there:
    rates of springs with inertia follow the fifth and their accelerations the sixth. The first law knows no
    deflections: where its motion exceeds limits, a smoother law follows. Later ones have limits scaled by
    what the motion before left free or exceeded.
    """
    sought, rung = task, 0
    fits_splines = False
    deflections: Deflections | None = None
    known: KnownDeflections | None = None
    kept: OptimalMotion | None = None
    unresolved: NoAnswer | None = None
    best: Best | None = None
    for _ in range(MAX_PASSES):
        try:
            share, high = ELASTIC_RUNGS[rung]
            degree = None if fits_splines else high
            problem = None if best is None else best.program.problem
            if best is None or problem is None or problem.task is not sought or problem.degree != degree:
                best = find_law(sought, places, deflections=deflections, share=share, degree=degree)
            else:  # the same least cost, of which smoothness may take more
                best = adapt_found_law(sought, places, best, share=share)
            if kept is not None and not best.cost < _worthwhile(task, kept):
                return kept
            dynamics, law, known = _resolved(task, best.law, known)
            check_rest(dynamics, law.smoothness)
        except (NoLaw, NotConverged, UnboundedTorque, SearchEnded) as failure:
            if kept is not None:
                return kept
            if isinstance(failure, SearchEnded | SpringsTooSoft):
                raise
            unresolved, rung = unresolved or failure, rung + 1
            if rung == 2 and best is None:  # no series twice: one is fitted to splines
                fits_splines, unresolved = True, None
            if rung == len(ELASTIC_RUNGS):
                raise unresolved or failure from None
            if sought.specification.smoothness < HIGHEST_SMOOTHNESS:
                smoother = replace(sought.specification, smoothness=HIGHEST_SMOOTHNESS)
                sought = sought._replace(specification=smoother)
            continue
        new, excess = OptimalMotion(dynamics, law, best), limit_excess(dynamics, task.specification)
        if excess <= 1.0:
            if kept is not None and not _cost(task, new) < _worthwhile(task, kept):
                return min(new, kept, key=lambda motion: _cost(task, motion))
            kept = new
            report_result()
        elif deflections is None:  # of a law that did not know them; a smoother one shakes the springs less
            rung = max(rung, 1)
        # a motion of least time is at a limit: limits follow it up and down
        if deflections is not None and (excess > 1.0 or task.specification.goal == "time"):
            scaled = sought.specification.scale_limits((1.0 - LIMIT_TIGHTENING) / excess)
            sought = sought._replace(specification=scaled)
        deflections, best = DeflectionsOnPath(law, dynamics.deflections), None
        places = crossing_places(task, deflections, places)
    if kept is not None:
        return kept
    raise NotConverged(
        f"{task.branch.robot.name}: law and deflections do not settle together in {MAX_PASSES} passes; use "
        f"{other_law(task)}stiffer springs, or geometry rigid",
        residual=abs(excess - 1.0),
    )


def _worthwhile(task: Task, kept: OptimalMotion) -> float:
    """Return what another motion has to cost less than."""
    return (1.0 - PEAK_TORQUE_MISMATCH) * _cost(task, kept)


def _cost(task: Task, motion: OptimalMotion) -> float:
    """Return what the goal counts, of a certified motion."""
    goal, reference = task.specification.goal, motion.best.reference
    if goal == "time":
        return motion.dynamics.duration
    if goal == "peak_torque":
        return float((_peaks(motion.dynamics)[0] / reference).max())
    t = np.linspace(0.0, motion.dynamics.duration, ENERGY_SAMPLES)
    return float(np.trapezoid(((motion.dynamics.torque(t) / reference) ** 2).sum(axis=1), t))


def _resolved(
    task: Task, law: OptimalLaw, before: KnownDeflections | None
) -> tuple[InverseDynamics, OptimalLaw, KnownDeflections | None]:
    """Certify the motion of this law, or of the nearest one that lets an elastic robot through."""
    known = None
    robot = task.branch.robot
    if robot.n_e and task.geometry == "deformed" and robot.n_a == robot.n:
        law, known = in_balance(task, law, before)
    dynamics = resolve(
        task.to_cross.searched,
        lambda *_: law,
        geometry=task.geometry,
        tolerance=task.request.tolerance,
        friction=task.request.friction,
        known=known,
    )
    return dynamics, law, known


def _peaks(dynamics: InverseDynamics) -> tuple[Array, Array]:
    """Compute the largest motor torques [N m] and speeds [rad/s] (n_a,)."""
    _, size, _ = dynamics.torques.coefficients.shape
    edges = dynamics.torques.edges
    speed = peak_sizes(lambda t: dynamics.motor_angle(t, 1), edges, size)
    return peak_sizes(dynamics.torque, edges, size), speed


def limit_excess(dynamics: InverseDynamics, specification: Specification) -> float:
    """Return the largest torque or speed over its limit; 0 without limits."""
    if not (specification.limited or specification.limited_speeds):
        return 0.0
    torque, speed = _peaks(dynamics)
    return float(max((torque / specification.torque_limit).max(), (speed / specification.speed_limit).max()))
