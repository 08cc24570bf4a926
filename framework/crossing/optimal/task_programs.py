"""The cone programs of a task: the best law of the least degree that is enough, or why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from framework.crossing.condition import CrossingPoint
from framework.crossing.optimal.best_law import (
    DEGREES,
    MAX_CROSSINGS_AT_FIRST_DEGREE,
    Best,
    best_law,
    lowest_cost,
    within_limits,
)
from framework.crossing.optimal.optimal_task import (
    Task,
    check_speeds,
    conditions_at,
    crossing_places,
    other_law,
)
from framework.crossing.optimal.phase_plane import Deflections, SquaredSpeed, demand
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
from framework.crossing.optimal.sufficient_limits import least_duration, least_limits
from framework.crossing.refusals.refusal_proofs import HoldingTorque, NoAdmissibleSpeed
from framework.crossing.specification import Specification
from framework.errors import InvalidInput, NoLaw, NotConverged, told_apart
from framework.motion.cone_program import Optimum, Unsolved
from framework.motion.exact_duration import adjusted
from framework.motion.infeasibility import Infeasible
from framework.motion.optimal_law import OptimalLaw

MAX_DEGREE_GAP = 5e-3  # cost above the bound of the degree, over it: more, and a higher degree is tried
MAX_TANGENTS = 20  # of damping linearised about the previous law
SQUARED_SPEED_CHANGE = 1e-3  # largest relative one from a law to the next that has settled
SPEED_SAMPLES = 201  # of the path, at which that change is measured
MAX_CONDITION_STEPS = 4  # of Newton's method, from a law that nearly meets condition (8)


def best_undeformed(task: Task) -> Best:
    """Compute the best law of the undeformed robot in the cone program, without a certificate.

    Raises:
        NoLaw: no law is admissible; says what stands against it.
        NotConverged: the solver gave up.
    """
    places = crossing_places(task, None, None)
    check_speeds(task, places)
    program, best = first_program(task, places)
    if not task.branch.robot.is_damped:
        return best
    return best_with_damping(task, places, task.specification, best, program.units, ROUGHNESS_WEIGHT)


def best_with_damping(
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
        program = program_of(
            task, places, None, specification, best.law.degree, units, best.law.squared_speed
        )
        best = best_of_program(replace(program, roughness=roughness), task)
        change = float(np.abs(best.law.squared_speed(sigma) / previous - 1.0).max())
        if change <= SQUARED_SPEED_CHANGE:
            return best._replace(law=_meeting_conditions(task, places, best.law))
    raise NotConverged(
        f"{task.branch.robot.name}: law and damping do not settle together in {MAX_TANGENTS} passes; "
        f"use {other_law(task)}another duration",
        residual=change,
    )


def _meeting_conditions(task: Task, places: Sequence[CrossingPoint], law: OptimalLaw) -> OptimalLaw:
    """Return the law that meets condition (8) with damping, to rounding, with the least change of speed."""
    for _ in range(MAX_CONDITION_STEPS):
        sigma, conditions = conditions_at(task, places, None, law.squared_speed)
        equalities = conditions_on_speed(sigma, conditions, law.degree, law.stretch)
        try:
            y = adjusted(law.coefficients, equalities, law.duration, law.stretch)
            law = OptimalLaw(y, law.smoothness, law.duration, law.dense_at)
        except InvalidInput as problem:
            raise NotConverged(
                f"{task.branch.robot.name}: no law near the best has condition (8) with damping ({problem})",
                residual=np.inf,
            ) from None
    return law


def first_program(
    task: Task,
    places: Sequence[CrossingPoint],
    gap: float = MAX_DEGREE_GAP,
    roughness: float = ROUGHNESS_WEIGHT,
) -> tuple[SpeedProgram, Best]:
    """Return the program of the least degree that leaves little to be gained, and its best law."""
    best_of_degrees: tuple[SpeedProgram, Best] | None = None
    failures: list[tuple[SpeedProgram, Infeasible | Unsolved]] = []
    units: Units | None = None
    for degree in DEGREES[len(task.targets) > MAX_CROSSINGS_AT_FIRST_DEGREE :]:
        program = program_of(task, places, None, task.specification, degree, units)
        program, optimum = _in_fitting_units(replace(program, roughness=roughness))
        units = program.units
        best = within_limits(program, program.cones(), optimum) if isinstance(optimum, Optimum) else optimum
        if not isinstance(best, Best):
            failures.append((program, best))
            continue
        if best_of_degrees is None or best.cost < best_of_degrees[1].cost:
            best_of_degrees = program, best
        assert isinstance(optimum, Optimum)
        if degree < DEGREES[-1] and best.cost <= (1.0 + gap) * lowest_cost(program, optimum):
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


def program_of(
    task: Task,
    places: Sequence[CrossingPoint],
    deflections: Deflections | None,
    specification: Specification,
    degree: int,
    units: Units | None,
    previous_speed: SquaredSpeed | None = None,
) -> SpeedProgram:
    """Return the program of this degree; damping is linearised about the previous squared speed."""
    sigma_of_conditions, conditions = conditions_at(task, places, deflections, previous_speed)
    sigma = points_of(degree, sigma_of_conditions, task.stretch)
    torque_demand = demand(task.branch, task.phi, sigma, deflections, task.geometry, previous_speed)
    on_path = OnPath(sigma, torque_demand, sigma_of_conditions, conditions, task.stretch)
    guessed = guessed_units(on_path, specification)
    if units is not None:
        guessed = Units(units.time, guessed.torque if specification.limited else units.torque)
    return SpeedProgram(on_path, specification, degree, guessed)


def best_of_program(program: SpeedProgram, task: Task) -> Best:
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
    robot = task.branch.robot
    name, holding = robot.name, _holding(task, program.on_path)
    least = least_limits(quicker)
    would_do = "".join(f"; {sentence}" for sentence in least.sentences(robot, task.request.margin))
    if holding is not None:
        where, unit = "start" if holding.s == 0 else "end", _unit(task, holding.joint)
        needed, allowed = told_apart(holding.torque, holding.limit)
        rubs = robot.joint_friction.any()
        uncounted = " (dry friction, which may hold some of it, not counted)" if rubs else ""
        return NoLaw(
            f"{name}: no law is admissible: at the {where} {holding.joint} must hold {needed} "
            f"{unit} at rest{uncounted}, and may {allowed}{would_do}",
            proof=replace(holding, least=least),
        )
    if not isinstance(obstacle, Infeasible):
        nearest = min(program.on_path.crossings, key=lambda sigma: min(sigma, 1.0 - sigma), default=None)
        near_end = ""
        if nearest is not None:
            s = float(task.phi(nearest))
            near_end = f"; the crossing nearest to an end of the path is {min(s, 1.0 - s):.2g} of it away"
        return NotConverged(
            f"{name}: no optimal law of degree {program.degree} found: the solver of the cone program ends "
            f"with {obstacle.status}{near_end}",
            residual=np.inf,
        )
    proof = NoAdmissibleSpeed(program.degree, least, least_duration(quicker), obstacle)
    return NoLaw(
        f"{name}: no law of free shape (degree {program.degree}) is admissible: "
        f"{proof.sentence or 'none within all limits meets condition (8)'}{would_do}",
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
