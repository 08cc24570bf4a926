"""The best motion along a path: cone program and certified inverse dynamics in turn.

A rigid robot needs each once. An elastic one is optimised with its deflections frozen as functions of the
path parameter, and resolved anew; while `resolve` iterates on the deflections of one law, that law follows
the condition (8) of the deflected robot with the least change of its speed.
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
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, NoLaw, NotConverged
from framework.motion.chebyshev import TimeFunction
from framework.motion.cone_program import Optimum, Unsolved
from framework.motion.exact_duration import adjusted
from framework.motion.infeasibility import Infeasible
from framework.motion.law import MotionLaw
from framework.motion.optimal_law import OptimalLaw
from framework.tolerances import PEAK_TORQUE_MISMATCH

MAX_PASSES = 8  # of optimising and resolving in turn
ROUGHNESS_WEIGHT_GROWTH = 30.0  # factor on the weight, for a law that could not be resolved
MAX_ROUGHNESS_WEIGHT = 1e-2
MAX_DEGREE_GAP = 5e-3  # cost above the bound of the degree, over it: more, and a higher degree is tried
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
    deflections: Deflections | None = None
    places = crossing_places(task, None, None)
    specification = task.specification
    elastic, damped = task.branch.robot.n_e > 0, task.branch.robot.is_damped
    if elastic and damped:
        raise NoLaw(
            f"{task.branch.robot.name}: optimal laws of elastic robots with damping are not supported; use "
            f"law polynomial, or flexibility rigid"
        )
    check_speeds(task, places)
    program, best = _first(task, places)
    degree, units = program.degree, program.units
    roughness, excess = ROUGHNESS_WEIGHT, np.inf
    for k in range(MAX_PASSES):
        try:
            if k > 0:
                again = _program(task, places, deflections, specification, degree, units)
                best = _solved(replace(again, roughness=roughness), task)
            if damped:
                best = _damped(task, places, specification, best, units, roughness)
        except NotConverged:
            higher = [more for more in DEGREES if more > degree]
            if not higher:
                raise
            degree = higher[0]
            continue
        try:
            dynamics, law = _resolved(task, best.law, places)
        except NotConverged:
            # deflections rarely settle at the third trial
            if roughness >= MAX_ROUGHNESS_WEIGHT or (elastic and k > 0):
                raise
            roughness *= ROUGHNESS_WEIGHT_GROWTH
            continue
        excess = _excess(dynamics, task.specification)
        settled = not elastic
        if elastic:
            settled = (
                abs(_peak(dynamics, best.reference) / best.peak - 1.0) <= PEAK_TORQUE_MISMATCH
                and deflections is not None
            )
            deflections = DeflectionsOnPath(law, dynamics.deflections)
            places = crossing_places(task, deflections, places)
        if settled and excess <= 1.0:
            return OptimalMotion(dynamics, law, best)
        if excess > 1.0 and settled:
            specification = specification.tightened((1.0 - LIMIT_TIGHTENING) / excess)
    raise NotConverged(
        f"{task.branch.robot.name}: law and deflections do not settle together in {MAX_PASSES} passes; use "
        f"stiffer springs, law polynomial, or geometry rigid",
        residual=abs(excess - 1.0),
    )


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


def _first(task: Task, places: Sequence[CrossingPoint]) -> tuple[SpeedProgram, Best]:
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
        if best.cost <= (1.0 + MAX_DEGREE_GAP) * best.bound:
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
    task: Task, law: OptimalLaw, places: Sequence[CrossingPoint]
) -> tuple[InverseDynamics, OptimalLaw]:
    """Certify the motion of this law, its speed changed with the conditions of the deflecting robot."""
    branch, searched = task.branch, task.to_cross.searched
    tolerance, friction = task.request.tolerance, task.request.friction
    at_rest = crossing_places(task, None, None)

    def follow(
        places_on_path: Sequence[CrossingPoint], deflections: Deflections | None, base: OptimalLaw
    ) -> OptimalLaw:
        sigma, conditions = conditions_at(task, places_on_path, deflections)
        equalities = conditions_on_speed(sigma, conditions, base.degree, base.stretch)
        try:
            y = adjusted(base.coefficients, equalities, base.duration, base.stretch)
        except InvalidInput:
            raise NotConverged(
                f"{branch.robot.name}: no law near the best crosses where the deflected robot is singular; "
                f"use stiffer springs, law polynomial, or geometry rigid",
                residual=np.inf,
            ) from None
        return OptimalLaw(y, base.smoothness, base.duration, base.dense_at)

    if not branch.robot.n_e or task.geometry == "rigid":
        dynamics = resolve(
            searched, lambda *_: law, geometry=task.geometry, tolerance=tolerance, friction=friction
        )
        return dynamics, law
    near, chosen = list(places), [law]

    def choose_law(deflections: TimeFunction | None, previous: MotionLaw | None) -> MotionLaw:
        last = next((known for known in reversed(chosen) if known is previous), None)
        if deflections is None or last is None:
            chosen.append(follow(at_rest, None, law))
        else:
            on_path = DeflectionsOnPath(last, deflections)
            near[:] = crossing_places(task, on_path, near)
            chosen.append(follow(near, on_path, law))
        return chosen[-1]

    dynamics = resolve(searched, choose_law, geometry=task.geometry, tolerance=tolerance, friction=friction)
    return dynamics, next(known for known in reversed(chosen) if known is dynamics.law)


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
