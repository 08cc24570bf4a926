"""The best law along a path: the optimum of the cone program, with rows where a limit was exceeded, as a law.

Between the points of the program, and at the crossings themselves, torques follow by interpolation; what
exceeds a limit there becomes a row of the next round.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.crossing.speed_program import BETWEEN, KEPT, SPARSER, SpeedProgram
from framework.errors import InvalidInput
from framework.motion.cone_program import Affine, ConeProgram, Optimum, Unsolved, solve
from framework.motion.exact_duration import adjusted, blended, duration_of
from framework.motion.infeasibility import Infeasible
from framework.motion.optimal_law import OptimalLaw

DEGREES = (40, 80)  # of the squared speed; the second where the first finds no law
MANY = 4  # crossings, beyond which the second is tried at once
NEAR = 0.7  # share of the peak from which a torque counts as near its limit
ROUNDS = 8  # of solving with further rows where a limit was exceeded
# times the least peak, what a law that must be slower may take
LAXER = (1.002, 1.005, 1.01, 1.02, 1.05, 1.2, 1.5, 2.0, 4.0)
SLOWER = 8  # steps from the quickest towards the slowest law
SLOWEST = 0.02  # least z of such a law, over the mean speed squared


class Best(NamedTuple):
    """The best law of its degree; `peak` of torque over `reference` (n_a,) [N m] is what the program saw.

    cost: what was to be least: the duration [s], the peak of torque [N m], or the energy [N2 m2 s].
    bound: the same of the program with rows at few points, which no law of this degree goes below.
    """

    law: OptimalLaw
    peak: float
    reference: Array
    cost: float
    bound: float


def best_law(program: SpeedProgram) -> Best | Infeasible | Unsolved:
    """The best law that a program has, or why it has none."""
    cones = program.cones()
    found = program.solved(cones)
    return within_limits(program, cones, found) if isinstance(found, Optimum) else found


def off_limits(program: SpeedProgram) -> tuple[float | None, float | None]:
    """The least peak of torque over its limit in the duration asked, and the least duration [s] within
    all limits, by laws of this degree; None where none was found."""
    specification = program.specification
    free = replace(
        specification, goal="peak_torque", torque_limit=np.full(len(specification.torque_limit), np.inf)
    )
    quickest = replace(specification, goal="time", duration=None, longest=None)
    # a motor without a limit counts for nothing in a peak over the limits
    units = program.units._replace(
        torque=np.where(specification.limited_motors, program.units.torque, np.inf)
    )
    gentle = (
        _found(replace(program, specification=free, units=units))
        if specification.limited and specification.most is not None
        else None
    )
    quick = _found(replace(program, specification=quickest)) if specification.limited else None
    return (None if gentle is None else gentle.peak, None if quick is None else quick.law.duration)


def _found(program: SpeedProgram) -> Best | None:
    best = best_law(program)
    return best if isinstance(best, Best) else None


def within_limits(program: SpeedProgram, cones: ConeProgram, found: Optimum) -> Best | Infeasible | Unsolved:
    """The law of an optimum, solved again with rows where a limit does not hold between the points.

    Rows that are far from their limit are left out of that; where they are needed they come back.
    """
    first = found
    near = np.abs(cones.torque(found.y)) > NEAR * _allowed(cones.bounded, found.peak)
    rows = Affine(cones.torque.matrix[near], cones.torque.offset[near])
    cones = replace(cones, torque=rows, bounded=cones.bounded[near])
    limited = program.specification.limited_motors
    for _ in range(ROUNDS):
        allowed = np.where(limited, 1.0, np.inf)
        if program.specification.goal == "peak_torque" or not program.specification.limited:
            allowed = _allowed(limited, found.peak) * (1.0 + 2.0 * KEPT)
        extended = _with_rows_where_exceeded(program, cones, found.y, allowed)
        if extended is None:
            break
        again = program.solved(extended)
        if not isinstance(again, Optimum):
            return again
        cones, found = extended, again
    try:
        y = found.y if program.specification.duration is None else _lasting(program, cones, found)
        law = OptimalLaw(
            y * program.scale,
            program.specification.smoothness,
            program.specification.duration or 0.0,
            program.on_path.stretch.at,
        )
    except InvalidInput as problem:
        return Unsolved(str(problem))
    peak = float(program.torques(y).max())
    final = found._replace(peak=peak, duration=law.duration / program.units.time)
    return Best(law, peak, program.units.torque, _cost(program, final), _cost(program, first))


def _cost(program: SpeedProgram, found: Optimum) -> float:
    time, torque = program.units.time, float(program.units.torque.max())
    if program.specification.goal == "time":
        return found.duration * time
    return (
        found.peak * torque if program.specification.goal == "peak_torque" else found.value * torque**2 * time
    )


def _with_rows_where_exceeded(
    program: SpeedProgram, cones: ConeProgram, y: Array, allowed: Array
) -> ConeProgram | None:
    """The cones with rows where torques of y exceed what is allowed (n_a,) or z is low, if it does."""
    over = _peaks((program.torques(y) / allowed).max(axis=1), 1.0)
    low = _peaks(-(program.speeds_between @ y), -0.5 * cones.floor)
    if not len(over) and not len(low):
        return None
    return replace(
        cones,
        torque=_both(cones.torque, program.torque_rows(program.between[over])),
        bounded=np.append(cones.bounded, np.tile(program.specification.limited_motors, len(over))),
        positive=np.concatenate([cones.positive, program.speeds_between[low]]),
    )


def _lasting(program: SpeedProgram, cones: ConeProgram, quick: Optimum) -> Array:
    """Coefficients of a law of the duration asked for: between the quick one and a slow one.

    Admissible z are a convex set, and the duration is continuous along a blend of two. The slow law keeps
    to the same peak of the torques but for a small share, grown as far as it must, and to the limits at
    any rate.

    The duration is convex in z, so it is at least its linearisation about any z0: the integral of
    -z0^(-3/2)/2 (z - z0) added to that of z0. The z that makes this largest takes longer than z0, and so
    on (the convex-concave procedure: Yuille and Rangarajan 2003).

    Raises:
        InvalidInput: none of this degree was found.
    """
    duration = (program.specification.duration or 0.0) / program.units.time
    stretch = program.on_path.stretch
    if duration_of(quick.y, stretch) > duration * (1.0 - 1e-6):  # a rounding away, or nearly so
        return adjusted(quick.y, cones.equalities, duration, stretch)
    everywhere = program.speeds_between[:: SPARSER * BETWEEN]
    slower = replace(cones, positive=np.concatenate([cones.positive, everywhere]), floor=SLOWEST)
    for lax in LAXER:
        before, allowed = quick.y, _allowed(program.specification.limited_motors, lax * quick.peak)
        for _ in range(SLOWER):
            rows = _scaled(slower.torque, _allowed(slower.bounded, lax * quick.peak))
            everything = replace(slower, torque=rows, bounded=np.ones_like(slower.bounded))
            slow = solve(everything, "slowest", about=before)
            if not isinstance(slow, Optimum):
                break
            extended = _with_rows_where_exceeded(program, slower, slow.y, allowed * (1.0 + 2.0 * KEPT))
            if extended is not None:
                slower = extended
            elif duration_of(slow.y, stretch) > duration:
                blend = blended(before, slow.y, duration, stretch)
                return adjusted(blend, cones.equalities, duration, stretch)
            else:
                before = slow.y
    raise InvalidInput("no law of this degree advances all the time and takes so long")


def _both(one: Affine, two: Affine) -> Affine:
    return Affine(np.concatenate([one.matrix, two.matrix]), np.concatenate([one.offset, two.offset]))


def _scaled(rows: Affine, units: Array) -> Affine:
    return Affine(rows.matrix / units[:, None], rows.offset / units)


def _allowed(limited: BoolArray, peak: float) -> Array:
    """The peak, or the limit of those that have one where that is less."""
    return np.where(limited, min(peak, 1.0), peak)


def _peaks(values: Array, allowed: float) -> IntArray:
    """Indices of the local maxima above what is allowed."""
    padded = np.concatenate(([-np.inf], values, [-np.inf]))
    highest = (values >= padded[:-2]) & (values >= padded[2:])
    return np.flatnonzero(highest & (values > allowed))
