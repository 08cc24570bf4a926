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
    MAX_CROSSINGS_AT_FIRST_DEGREE,
    Best,
    best_law,
    off_limits,
    within_limits,
)
from framework.crossing.optimal.elastic_balance import in_balance
from framework.crossing.optimal.optimal_task import (
    Task,
    check_speeds,
    check_unfolded,
    conditions_at,
    crossing_places,
)
from framework.crossing.optimal.phase_plane import Deflections, DeflectionsOnPath, SquaredSpeed, demand
from framework.crossing.optimal.speed_program import (
    ROUGHNESS_WEIGHT,
    OnPath,
    SpeedProgram,
    Units,
    better_units,
    conditions_on_speed,
    guessed_units,
    points_of,
)
from framework.crossing.refusals.refusal_proofs import HoldingTorque, NoAdmissibleSpeed
from framework.crossing.specification import Specification
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer, NoLaw, NotConverged, UnboundedTorque
from framework.motion.cone_program import Optimum, Unsolved
from framework.motion.exact_duration import adjusted
from framework.motion.infeasibility import Infeasible
from framework.motion.optimal_law import OptimalLaw
from framework.tolerances import PEAK_TORQUE_MISMATCH

MAX_PASSES = 8  # of optimising and resolving in turn
ROUGHNESS_WEIGHT_GROWTH = 30.0  # factor on the weight, for a law that could not be resolved
MAX_ROUGHNESS_WEIGHT = 1e-2
MAX_DEGREE_GAP = 5e-3  # cost above the bound of the degree, over it: more, and a higher degree is tried
ELASTIC_DEGREE_GAP = 2e-2  # the same where deflections have to be resolved as well, at the cost of its cube
# of laws whose deflections are to be resolved: at first, and at most, where it costs some of the peak
ELASTIC_ROUGHNESS_WEIGHT, MAX_ELASTIC_ROUGHNESS_WEIGHT = 1e-5, 0.3
ENERGY_SAMPLES = 2001
MAX_TANGENTS = 20  # of damping linearised about the previous law
SQUARED_SPEED_CHANGE = 1e-3  # largest relative one from a law to the next that has settled
SPEED_SAMPLES = 201  # of the path, at which that change is measured
MAX_CONDITION_STEPS = 4  # of Newton's method, from a law that nearly meets condition (8)
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
            f"law polynomial, or flexibility rigid"
        )
    check_speeds(task, places)
    if elastic:
        return _elastic(task, places)
    program, best = _first(task, places)
    roughness, degree = ROUGHNESS_WEIGHT, program.degree
    specification = task.specification
    for k in range(MAX_PASSES):
        try:
            if k > 0:
                again = _program(task, places, None, specification, degree, program.units)
                best = _solved(replace(again, roughness=roughness), task)
            if damped:
                best = _damped(task, places, specification, best, program.units, roughness)
        except NotConverged:
            higher = [more for more in DEGREES if more > degree]
            if not higher:
                raise
            degree = higher[0]
            continue
        try:
            dynamics, law, _ = _resolved(task, best.law, None)
        except NotConverged:
            if roughness >= MAX_ROUGHNESS_WEIGHT:
                raise
            roughness *= ROUGHNESS_WEIGHT_GROWTH
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

    Each program has the deflections of the motion before, as functions of the path parameter.
    """
    first, _ = _first(task, places, ELASTIC_DEGREE_GAP)
    specification, roughness = task.specification, ELASTIC_ROUGHNESS_WEIGHT
    deflections: Deflections | None = None
    known: KnownDeflections | None = None
    kept: OptimalMotion | None = None
    unresolved: NoAnswer | None = None
    for _ in range(MAX_PASSES):
        try:
            program = _program(task, places, deflections, specification, first.degree, first.units)
            best = _solved(replace(program, roughness=roughness), task)
        except (NoLaw, NotConverged) as failure:
            if kept is not None:
                return kept
            raise unresolved or failure from None
        try:
            dynamics, law, known = _resolved(task, best.law, known)
        except (NoLaw, NotConverged, UnboundedTorque) as failure:
            if kept is not None:
                return kept
            unresolved, roughness = failure, roughness * ROUGHNESS_WEIGHT_GROWTH
            if roughness > MAX_ELASTIC_ROUGHNESS_WEIGHT:
                raise
            continue
        new, excess = OptimalMotion(dynamics, law, best), _excess(dynamics, task.specification)
        if excess <= 1.0:
            if kept is not None and not _cost(task, new) < (1.0 - PEAK_TORQUE_MISMATCH) * _cost(task, kept):
                return min(new, kept, key=lambda motion: _cost(task, motion))
            kept = new
        elif deflections is not None:
            specification = specification.tightened((1.0 - LIMIT_TIGHTENING) / excess)
        roughness = max(roughness / ROUGHNESS_WEIGHT_GROWTH**0.5, ELASTIC_ROUGHNESS_WEIGHT)
        deflections = DeflectionsOnPath(law, dynamics.deflections)
        places = crossing_places(task, deflections, places)
    if kept is not None:
        return kept
    raise NotConverged(
        f"{task.branch.robot.name}: law and deflections do not settle together in {MAX_PASSES} passes; use "
        f"stiffer springs, law polynomial, or geometry rigid",
        residual=abs(excess - 1.0),
    )


def _cost(task: Task, motion: OptimalMotion) -> float:
    """What the goal counts, of a certified motion."""
    goal, best = task.specification.goal, motion.best
    if goal == "time":
        return motion.dynamics.duration
    if goal == "peak_torque":
        return _peak(motion.dynamics, best.reference)
    t = np.linspace(0.0, motion.dynamics.duration, ENERGY_SAMPLES)
    return float(np.trapezoid(((motion.dynamics.torque(t) / best.reference) ** 2).sum(axis=1), t))


def best_undeformed(task: Task) -> Best:
    """Compute the best law of the undeformed robot in the cone program, without a certificate.

    Raises:
        NoLaw: no law is admissible; says what stands against it.
        NotConverged: the solver gave up.
    """
    places = crossing_places(task, None, None)
    check_speeds(task, places)
    program, best = _first(task, places)
    if not task.branch.robot.is_damped:
        return best
    return _damped(task, places, task.specification, best, program.units, ROUGHNESS_WEIGHT)


def _damped(
    task: Task,
    places: Sequence[CrossingPoint],
    specification: Specification,
    best: Best,
    units: Units,
    roughness: float,
) -> Best:
    """Compute the best law with damping, linearised about the previous law until the squared speed settles.

    Where it has settled to a share e, what the tangent leaves of the damping is of the size of e^2 / 8 of it,
    and of condition (8) nothing: that is met by a last adjustment.

    Raises:
        NoLaw: none is admissible; NotConverged: the squared speed does not settle, or the solver gave up.
    """
    sigma = np.linspace(0.0, 1.0, SPEED_SAMPLES)
    for _ in range(MAX_TANGENTS):
        previous = best.law.squared_speed(sigma)
        program = _program(task, places, None, specification, best.law.degree, units, best.law.squared_speed)
        best = _solved(replace(program, roughness=roughness), task)
        change = float(np.abs(best.law.squared_speed(sigma) / previous - 1.0).max())
        if change <= SQUARED_SPEED_CHANGE:
            return best._replace(law=_meeting_conditions(task, places, best.law))
    raise NotConverged(
        f"{task.branch.robot.name}: law and damping do not settle together in {MAX_TANGENTS} passes; "
        f"use law polynomial",
        residual=change,
    )


def _meeting_conditions(task: Task, places: Sequence[CrossingPoint], law: OptimalLaw) -> OptimalLaw:
    """Return the law that meets condition (8) with damping, to rounding, with the least change of speed."""
    for _ in range(MAX_CONDITION_STEPS):
        sigma, conditions = conditions_at(task, places, None, law.squared_speed)
        equalities = conditions_on_speed(sigma, conditions, law.degree, law.stretch)
        y = adjusted(law.coefficients, equalities, law.duration, law.stretch)
        law = OptimalLaw(y, law.smoothness, law.duration, law.dense_at)
    return law


def _first(
    task: Task, places: Sequence[CrossingPoint], gap: float = MAX_DEGREE_GAP
) -> tuple[SpeedProgram, Best]:
    """Return the program of the least degree that leaves little to be gained, and its best law."""
    best_of_degrees: tuple[SpeedProgram, Best] | None = None
    failures: list[tuple[SpeedProgram, Infeasible | Unsolved]] = []
    for degree in DEGREES[len(task.targets) > MAX_CROSSINGS_AT_FIRST_DEGREE :]:
        program, optimum = _in_fitting_units(_program(task, places, None, task.specification, degree, None))
        best = within_limits(program, program.cones(), optimum) if isinstance(optimum, Optimum) else optimum
        if not isinstance(best, Best):
            failures.append((program, best))
            continue
        if best_of_degrees is None or best.cost < best_of_degrees[1].cost:
            best_of_degrees = program, best
        if best.cost <= (1.0 + gap) * best.bound:
            break
    if best_of_degrees is None:  # what the highest degree cannot do no lower one can
        proved = [failure for failure in failures if isinstance(failure[1], Infeasible)]
        raise _refusal(task, *(proved or failures)[-1], failures[0][0])
    return best_of_degrees


def _in_fitting_units(program: SpeedProgram) -> tuple[SpeedProgram, Optimum | Infeasible | Unsolved]:
    """Return the program in units near its own optimum, and that optimum."""
    optimum = program.solved(program.cones())
    for _ in range(2):
        better = (
            better_units(program.units, program.specification, optimum)
            if isinstance(optimum, Optimum)
            else None
        )
        if better is None or better is program.units:
            break
        program = replace(program, units=better)
        optimum = program.solved(program.cones())
    return program, optimum


def _program(
    task: Task,
    places: Sequence[CrossingPoint],
    deflections: Deflections | None,
    specification: Specification,
    degree: int,
    units: Units | None,
    previous_speed: SquaredSpeed | None = None,
) -> SpeedProgram:
    sigma_of_conditions, conditions = conditions_at(task, places, deflections, previous_speed)
    sigma = points_of(degree, sigma_of_conditions, task.stretch)
    torque_demand = demand(task.branch, task.phi, sigma, deflections, task.geometry, previous_speed)
    on_path = OnPath(sigma, torque_demand, sigma_of_conditions, conditions, task.stretch)
    guessed = guessed_units(on_path, specification)
    if units is not None:
        guessed = Units(units.time, guessed.torque if specification.limited else units.torque)
    return SpeedProgram(on_path, specification, degree, guessed)


def _solved(program: SpeedProgram, task: Task) -> Best:
    """Return the best law of a program.

    Raises:
        NoLaw: none is admissible; NotConverged: the solver gave up.
    """
    best = best_law(program)
    if not isinstance(best, Best):
        raise _refusal(task, program, best, program)
    return best


def _refusal(
    task: Task, program: SpeedProgram, obstacle: Infeasible | Unsolved, quicker: SpeedProgram
) -> NoLaw | NotConverged:
    """Return the reason why there is no law; the `quicker` program says how far off the limits are."""
    name = task.branch.robot.name
    holding = _holding(task, program.on_path)
    if holding is not None:
        where, unit = "start" if holding.s == 0 else "end", _unit(task, holding.joint)
        rubs = task.branch.robot.joint_friction.any()
        uncounted = " (dry friction, which may hold some of it, not counted)" if rubs else ""
        return NoLaw(
            f"{name}: no law is admissible: at the {where} {holding.joint} must hold {holding.torque:.4g} "
            f"{unit} at rest{uncounted}, and may {holding.limit:.4g}",
            proof=holding,
        )
    if not isinstance(obstacle, Infeasible):
        return NotConverged(
            f"{name}: no optimal law of degree {program.degree} found ({obstacle.status})", residual=np.inf
        )
    proof = NoAdmissibleSpeed(program.degree, *off_limits(quicker), obstacle)
    return NoLaw(
        f"{name}: no law of free shape (degree {program.degree}) is admissible: "
        f"{proof.sentence or 'none within all limits meets condition (8)'}",
        proof=proof,
    )


def _holding(task: Task, on_path: OnPath) -> HoldingTorque | None:
    """Return a motor whose limit does not even hold the robot at an end of its path."""
    limit = task.specification.torque_limit
    still = np.abs(on_path.demand.torque.constant)[[0, -1]]
    over = np.argwhere(still > limit)
    if not len(over):
        return None
    end, motor = map(int, over[0])
    joint = task.branch.robot.actuator_names[motor]
    return HoldingTorque(joint, float(end), float(still[end, motor]), float(limit[motor]))


def _unit(task: Task, joint: str) -> str:
    robot = task.branch.robot
    return str(robot.torque_units[list(robot.actuator_names).index(joint)])


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


def _sampled(dynamics: InverseDynamics) -> tuple[Array, Array]:
    """Compute the largest motor torques [N m] and speeds [rad/s] (n_a,), sampled at 8 times the nodes."""
    t = np.linspace(0.0, dynamics.duration, 8 * dynamics.certificate.nodes)
    return np.abs(dynamics.torque(t)).max(axis=0), np.abs(dynamics.motor_angle(t, 1)).max(axis=0)


def _excess(dynamics: InverseDynamics, specification: Specification) -> float:
    """Return the largest torque or speed over its limit; 0 without limits."""
    torque, speed = _sampled(dynamics)
    return float(max((torque / specification.torque_limit).max(), (speed / specification.speed_limit).max()))


def _peak(dynamics: InverseDynamics, reference: Array) -> float:
    return float((_sampled(dynamics)[0] / reference).max())
