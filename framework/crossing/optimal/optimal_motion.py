"""The best motion along a path: cone program and certified inverse dynamics in turn.

A rigid robot needs each once. An elastic one follows the law nearest to that of the program whose deflections
are in balance; then the program is solved again with these, as functions of the path parameter, as long as
the certified motion becomes better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.condition import CrossingPoint
from framework.crossing.optimal.best_law import (
    DEGREES,
    Best,
)
from framework.crossing.optimal.elastic_balance import in_balance
from framework.crossing.optimal.optimal_task import (
    Task,
    check_speeds,
    check_unfolded,
    crossing_places,
    other_law,
)
from framework.crossing.optimal.phase_plane import Deflections, DeflectionsOnPath
from framework.crossing.optimal.rest_of_springs import check_rest
from framework.crossing.optimal.speed_program import (
    ROUGHNESS_WEIGHT,
)
from framework.crossing.optimal.task_programs import (
    best_of_program,
    best_with_damping,
    first_program,
    program_of,
)
from framework.crossing.specification import Specification
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer, NoLaw, NotConverged, UnboundedTorque
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.motion.peaks import peak_sizes
from framework.tolerances import PEAK_TORQUE_MISMATCH

MAX_PASSES = 8  # of optimising and resolving in turn
ROUGHNESS_WEIGHT_GROWTH = 30.0  # factor on the weight, for a law that could not be resolved
MAX_ROUGHNESS_WEIGHT = 1e-2
MAX_RESIDUAL_RATIO = 0.5  # of what two such laws leave unresolved; above, smoother ones do not help
ELASTIC_DEGREE_GAP = 2e-2  # the same where deflections have to be resolved as well, at the cost of its cube
# of laws whose deflections are to be resolved: at first, and at most, where it costs some of the peak
ELASTIC_ROUGHNESS_WEIGHT, MAX_ELASTIC_ROUGHNESS_WEIGHT = 1e-5, 0.3
ENERGY_SAMPLES = 2001
LIMIT_TIGHTENING = 1e-5  # share of a limit that is left free when it was exceeded


class OptimalMotion(NamedTuple):
    """The certified motion with the law that was found best, and what the cone program said of it."""

    dynamics: InverseDynamics
    law: OptimalLaw
    best: Best


def optimal_motion(task: Task) -> OptimalMotion:
    """Compute the best law of the least degree that is enough, and certify it with all limits kept.

    Raises:
        NoLaw: no law is admissible; says what stands against it.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve`.
    """
    check_unfolded(task)
    places = crossing_places(task, None, None)
    elastic, damped = task.branch.robot.n_e > 0, task.branch.robot.is_damped
    if elastic and damped:
        raise NoLaw(
            f"{task.branch.robot.name}: optimal laws of elastic robots with damping are not supported; use "
            f"{other_law(task)}flexibility rigid"
        )
    check_speeds(task, places)
    if elastic:
        return _elastic(task, places)
    program, best = first_program(task, places)
    roughness, degree = ROUGHNESS_WEIGHT, program.degree
    specification, residual = task.specification, np.inf
    for k in range(MAX_PASSES):
        try:
            if k > 0:
                again = program_of(task, places, None, specification, degree, program.units)
                best = best_of_program(replace(again, roughness=roughness), task)
            if damped:
                best = best_with_damping(task, places, specification, best, program.units, roughness)
        except NotConverged:
            higher = [more for more in DEGREES if more > degree]
            if not higher:
                raise
            degree = higher[0]
            continue
        try:
            dynamics, law, _ = _resolved(task, best.law, None)
        except NotConverged as failure:
            if roughness >= MAX_ROUGHNESS_WEIGHT or failure.residual > MAX_RESIDUAL_RATIO * residual:
                raise
            residual, roughness = failure.residual, roughness * ROUGHNESS_WEIGHT_GROWTH
            continue
        excess = _excess(dynamics, task.specification)
        if excess <= 1.0:
            return OptimalMotion(dynamics, law, best)
        specification = specification.tightened((1.0 - LIMIT_TIGHTENING) / excess)
    raise NotConverged(
        f"{task.branch.robot.name}: no law within all limits is resolved in {MAX_PASSES} passes",
        residual=abs(excess - 1.0),
    )


def _elastic(task: Task, places: Sequence[CrossingPoint]) -> OptimalMotion:
    """Programs and balances in turn, as long as the certified motion becomes better.

    Each program has the deflections of the motion before, as functions of the path parameter. What is not
    resolved or at rest at its ends is followed by a smoother law, with more of its derivatives zero there:
    rates of springs with inertia follow the fifth and their accelerations the sixth.
    """
    specification, roughness = task.specification, ELASTIC_ROUGHNESS_WEIGHT
    least_roughness = roughness
    first, best = first_program(task, places, ELASTIC_DEGREE_GAP, roughness)
    deflections: Deflections | None = None
    known: KnownDeflections | None = None
    kept: OptimalMotion | None = None
    unresolved: NoAnswer | None = None
    for k in range(MAX_PASSES):
        try:
            if k > 0:
                program = program_of(task, places, deflections, specification, first.degree, first.units)
                best = best_of_program(replace(program, roughness=roughness), task)
        except (NoLaw, NotConverged) as failure:
            if kept is not None:
                return kept
            raise unresolved or failure from None
        if kept is not None and not _expected(task, best) < _worthwhile(task, kept):
            return kept
        try:
            dynamics, law, known = _resolved(task, best.law, known)
            check_rest(dynamics, law.smoothness)
        except (NoLaw, NotConverged, UnboundedTorque) as failure:
            if kept is not None:
                return kept
            task = task._replace(specification=replace(task.specification, smoothness=HIGHEST_SMOOTHNESS))
            specification = replace(specification, smoothness=HIGHEST_SMOOTHNESS)
            least_roughness = roughness * ROUGHNESS_WEIGHT_GROWTH**0.5
            unresolved, roughness = failure, roughness * ROUGHNESS_WEIGHT_GROWTH
            if roughness > MAX_ELASTIC_ROUGHNESS_WEIGHT:
                raise
            continue
        new, excess = OptimalMotion(dynamics, law, best), _excess(dynamics, task.specification)
        if excess <= 1.0:
            if kept is not None and not _cost(task, new) < _worthwhile(task, kept):
                return min(new, kept, key=lambda motion: _cost(task, motion))
            kept = new
        elif deflections is not None:
            specification = specification.tightened((1.0 - LIMIT_TIGHTENING) / excess)
        roughness = max(roughness / ROUGHNESS_WEIGHT_GROWTH**0.5, least_roughness)
        deflections = DeflectionsOnPath(law, dynamics.deflections)
        places = crossing_places(task, deflections, places)
    if kept is not None:
        return kept
    raise NotConverged(
        f"{task.branch.robot.name}: law and deflections do not settle together in {MAX_PASSES} passes; use "
        f"{other_law(task)}stiffer springs, or geometry rigid",
        residual=abs(excess - 1.0),
    )


def _worthwhile(task: Task, kept: OptimalMotion) -> float:
    """What another motion has to cost less than."""
    return (1.0 - PEAK_TORQUE_MISMATCH) * _cost(task, kept)


def _expected(task: Task, best: Best) -> float:
    """What `_cost` is of the motion that a program foresees."""
    if task.specification.goal == "time":
        return best.law.duration
    if task.specification.goal == "peak_torque":
        return best.peak
    return best.cost / float(best.reference.max()) ** 2


def _cost(task: Task, motion: OptimalMotion) -> float:
    """What the goal counts, of a certified motion."""
    goal, best = task.specification.goal, motion.best
    if goal == "time":
        return motion.dynamics.duration
    if goal == "peak_torque":
        return _peak(motion.dynamics, best.reference)
    t = np.linspace(0.0, motion.dynamics.duration, ENERGY_SAMPLES)
    return float(np.trapezoid(((motion.dynamics.torque(t) / best.reference) ** 2).sum(axis=1), t))


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


def _excess(dynamics: InverseDynamics, specification: Specification) -> float:
    """Return the largest torque or speed over its limit; 0 without limits."""
    torque, speed = _peaks(dynamics)
    return float(max((torque / specification.torque_limit).max(), (speed / specification.speed_limit).max()))


def _peak(dynamics: InverseDynamics, reference: Array) -> float:
    return float((_peaks(dynamics)[0] / reference).max())
