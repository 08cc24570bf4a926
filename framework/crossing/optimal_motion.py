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
from framework.crossing.optimal import DEGREES, MANY, Best, best_law, off_limits, within_limits
from framework.crossing.optimal_task import Task, check_speeds, check_unfolded, conditions_at, crossing_places
from framework.crossing.phase_plane import Deflections, DeflectionsOnPath, demand
from framework.crossing.refusal_proofs import HoldingTorque, NoAdmissibleSpeed
from framework.crossing.specification import Specification
from framework.crossing.speed_program import (
    ROUGHNESS,
    OnPath,
    SpeedProgram,
    Units,
    better_units,
    conditions_on_speed,
    guessed_units,
    points_of,
)
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, NoLaw, NotConverged
from framework.motion.chebyshev import TimeFunction
from framework.motion.cone_program import Optimum, Unsolved
from framework.motion.exact_duration import adjusted
from framework.motion.infeasibility import Infeasible
from framework.motion.law import MotionLaw
from framework.motion.optimal_law import OptimalLaw

MOST_PASSES = 8  # of optimising and resolving in turn
FORESEEN = 2e-3  # peak torque of the program and of the certified motion may differ by this share
SMOOTHER = 30.0  # times the weight on roughness, for a law that could not be resolved
ROUGHEST = 1e-2
GAIN = 1e-2  # what a law may cost more than its degree's bound before a higher degree is tried
ROOM = 1e-5  # share of a limit that is left free when it was exceeded


class OptimalMotion(NamedTuple):
    """The certified motion with the law that was found best, and what the cone program said of it."""

    dynamics: InverseDynamics
    law: OptimalLaw
    best: Best


def optimal_motion(task: Task) -> OptimalMotion:
    """The best law of the least degree that is enough, certified, with all limits kept.

    Raises:
        NoLaw: no law is admissible; says what stands against it.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve`.
    """
    check_unfolded(task)
    deflections: Deflections | None = None
    places = crossing_places(task, None, None)
    specification = task.specification
    elastic = task.branch.robot.n_e > 0
    check_speeds(task, places)
    program, best = _first(task, places)
    degree, units = program.degree, program.units
    roughness, excess = ROUGHNESS, np.inf
    for k in range(MOST_PASSES):
        try:
            if k > 0:
                again = _program(task, places, deflections, specification, degree, units)
                best = _solved(replace(again, roughness=roughness), task)
        except NotConverged:
            higher = [more for more in DEGREES if more > degree]
            if not higher:
                raise
            degree = higher[0]
            continue
        try:
            dynamics, law = _resolved(task, best.law, places)
        except NotConverged:
            if roughness >= ROUGHEST or (elastic and k > 0):  # deflections rarely settle at the third trial
                raise
            roughness *= SMOOTHER
            continue
        excess = _excess(dynamics, task.specification)
        settled = not elastic
        if elastic:
            settled = (
                abs(_peak(dynamics, best.reference) / best.peak - 1.0) <= FORESEEN and deflections is not None
            )
            deflections = DeflectionsOnPath(law, dynamics.deflections)
            places = crossing_places(task, deflections, places)
        if settled and excess <= 1.0:
            return OptimalMotion(dynamics, law, best)
        if excess > 1.0 and settled:
            specification = specification.tightened((1.0 - ROOM) / excess)
    raise NotConverged(
        f"{task.branch.robot.name}: law and deflections do not settle together in {MOST_PASSES} passes; use "
        f"stiffer springs, law polynomial, or geometry rigid",
        residual=abs(excess - 1.0),
    )


def best_undeformed(task: Task) -> Best:
    """The best law of the undeformed robot as the cone program sees it, which nothing has certified.

    Raises:
        NoLaw: no law is admissible; says what stands against it.
        NotConverged: the solver gave up.
    """
    places = crossing_places(task, None, None)
    check_speeds(task, places)
    return _first(task, places)[1]


def _first(task: Task, places: Sequence[CrossingPoint]) -> tuple[SpeedProgram, Best]:
    """The program of the least degree that leaves little to be gained, and the best law of that degree."""
    found: tuple[SpeedProgram, Best] | None = None
    failures: list[tuple[SpeedProgram, Infeasible | Unsolved]] = []
    for degree in DEGREES[len(task.targets) > MANY :]:
        program, optimum = _in_fitting_units(_program(task, places, None, task.specification, degree, None))
        best = within_limits(program, program.cones(), optimum) if isinstance(optimum, Optimum) else optimum
        if not isinstance(best, Best):
            failures.append((program, best))
            continue
        if found is None or best.cost < found[1].cost:
            found = program, best
        if best.cost <= (1.0 + GAIN) * best.bound:
            break
    if found is None:  # what the highest degree cannot do no lower one can
        proved = [failure for failure in failures if isinstance(failure[1], Infeasible)]
        raise _refusal(task, *(proved or failures)[-1], failures[0][0])
    return found


def _in_fitting_units(program: SpeedProgram) -> tuple[SpeedProgram, Optimum | Infeasible | Unsolved]:
    """The program in units near its own optimum, and that optimum."""
    found = program.solved(program.cones())
    for _ in range(2):
        better = (
            better_units(program.units, program.specification, found) if isinstance(found, Optimum) else None
        )
        if better is None or better is program.units:
            break
        program = replace(program, units=better)
        found = program.solved(program.cones())
    return program, found


def _program(
    task: Task,
    places: Sequence[CrossingPoint],
    deflections: Deflections | None,
    specification: Specification,
    degree: int,
    units: Units | None,
) -> SpeedProgram:
    at, conditions = conditions_at(task, places, deflections)
    sigma = points_of(degree, at, task.stretch)
    asked = demand(task.branch, task.phi, sigma, deflections, task.geometry)
    on_path = OnPath(sigma, asked, at, conditions, task.stretch)
    guessed = guessed_units(on_path, specification)
    if units is not None:
        guessed = Units(units.time, guessed.torque if specification.limited else units.torque)
    return SpeedProgram(on_path, specification, degree, guessed)


def _solved(program: SpeedProgram, task: Task) -> Best:
    """The law that a program finds best.

    Raises:
        NoLaw: none is admissible; NotConverged: the solver gave up.
    """
    best = best_law(program)
    if not isinstance(best, Best):
        raise _refusal(task, program, best, program)
    return best


def _refusal(
    task: Task, program: SpeedProgram, found: Infeasible | Unsolved, quicker: SpeedProgram
) -> NoLaw | NotConverged:
    """Why there is no law; how far off the limits are is told from the `quicker` program."""
    name = task.branch.robot.name
    holding = _holding(task, program.on_path)
    if holding is not None:
        where, unit = "start" if holding.s == 0 else "end", _unit(task, holding.joint)
        return NoLaw(
            f"{name}: no law is admissible: at the {where} {holding.joint} must hold {holding.torque:.4g} "
            f"{unit} at rest, and may {holding.limit:.4g}",
            proof=holding,
        )
    if not isinstance(found, Infeasible):
        return NotConverged(
            f"{name}: no optimal law of degree {program.degree} found ({found.status})", residual=np.inf
        )
    proof = NoAdmissibleSpeed(program.degree, *off_limits(quicker), found)
    return NoLaw(
        f"{name}: no law of free shape (degree {program.degree}) is admissible: "
        f"{proof.sentence or 'none within all limits meets condition (8)'}",
        proof=proof,
    )


def _holding(task: Task, on_path: OnPath) -> HoldingTorque | None:
    """The motor that may not even hold the robot at an end of its path."""
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
    """The certified motion of this law, its speed moved with the conditions of the deflecting robot."""
    branch, searched, tolerance = task.branch, task.targeted.searched, task.request.tolerance
    at_rest = crossing_places(task, None, None)

    def follow(
        here: Sequence[CrossingPoint], deflections: Deflections | None, base: OptimalLaw
    ) -> OptimalLaw:
        at, conditions = conditions_at(task, here, deflections)
        equalities = conditions_on_speed(at, conditions, base.degree, base.stretch)
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
        dynamics = resolve(searched, lambda *_: law, geometry=task.geometry, tolerance=tolerance)
        return dynamics, law
    near, chosen = list(places), [law]

    def choose_law(deflections: TimeFunction | None, before: MotionLaw | None) -> MotionLaw:
        last = next((known for known in reversed(chosen) if known is before), None)
        if deflections is None or last is None:
            chosen.append(follow(at_rest, None, law))
        else:
            on_path = DeflectionsOnPath(last, deflections)
            near[:] = crossing_places(task, on_path, near)
            chosen.append(follow(near, on_path, law))
        return chosen[-1]

    dynamics = resolve(searched, choose_law, geometry=task.geometry, tolerance=tolerance)
    return dynamics, next(known for known in reversed(chosen) if known is dynamics.law)


def _sampled(dynamics: InverseDynamics) -> tuple[Array, Array]:
    """Largest torques [N m] and speeds [rad/s] (n_a,) of the motors, eight times as finely as solved."""
    t = np.linspace(0.0, dynamics.duration, 8 * dynamics.certificate.nodes)
    return np.abs(dynamics.torque(t)).max(axis=0), np.abs(dynamics.motor_angle(t, 1)).max(axis=0)


def _excess(dynamics: InverseDynamics, specification: Specification) -> float:
    """The largest torque or speed over its limit; 0 without limits."""
    torque, speed = _sampled(dynamics)
    return float(max((torque / specification.torque_limit).max(), (speed / specification.speed_limit).max()))


def _peak(dynamics: InverseDynamics, reference: Array) -> float:
    return float((_sampled(dynamics)[0] / reference).max())
