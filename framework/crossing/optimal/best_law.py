"""The best law along a path: the optimum of the cone program, with rows where a limit was exceeded, as a law.

Between the points of the program, and at the crossings themselves, torques follow by interpolation; what
exceeds a limit there becomes a row of the next round.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array, BoolArray, IntArray
from framework.crossing.optimal.speed_program import SpeedProgram
from framework.errors import InvalidInput
from framework.motion.cone_program import Affine, ConeProgram, Optimum, Unsolved, solve_cone_program
from framework.motion.exact_duration import adjusted, blended, duration_of
from framework.motion.infeasibility import Infeasible
from framework.motion.optimal_law import OptimalLaw, ends_and_extrema
from framework.tolerances import LIMIT_MARGIN

DEGREES = (40, 80)  # of the squared speed; the second where the first has no law
MAX_CROSSINGS_AT_FIRST_DEGREE = 4  # more are tried with the second degree at once
MIN_ROW_TORQUE_RATIO = 0.7  # torque over the peak, below which its row is left out of further rounds
QUICKEST_MARGIN = 1e-6  # of the duration: a law this near to the quickest is made of it alone
MAX_ROW_ROUNDS = 8  # of solving with further rows where a limit was exceeded
# peak torque of a slow law over that of the quickest, tried in turn
PEAK_RATIOS = (1.002, 1.005, 1.01, 1.02, 1.05, 1.2, 1.5, 2.0, 4.0)
MAX_CONVEX_CONCAVE_STEPS = 8  # from the quickest towards the slowest law


class Best(NamedTuple):
    """The best law of its degree; `peak` of torque over `reference` (n_a,) [N m] is what the program saw.

    cost: what was to be least: the duration [s], the peak of torque [N m], or the energy [N2 m2 s].
    """

    law: OptimalLaw
    peak: float
    reference: Array
    cost: float


def best_law(program: SpeedProgram) -> Best | Infeasible | Unsolved:
    """Return the best law of a program, or why it has none."""
    cones = program.cones()
    optimum = program.solved(cones)
    return within_limits(program, cones, optimum) if isinstance(optimum, Optimum) else optimum


def within_limits(
    program: SpeedProgram, cones: ConeProgram, optimum: Optimum
) -> Best | Infeasible | Unsolved:
    """Return the law of an optimum, solved again until limits hold between the points (`kept_between`)."""
    kept = kept_between(program, cones, optimum)
    if isinstance(kept, Infeasible | Unsolved):
        return kept
    cones, optimum = kept
    try:
        y = optimum.y if program.specification.duration is None else _lasting(program, cones, optimum)
        law = OptimalLaw(
            y * program.scale,
            program.specification.smoothness,
            program.specification.duration or 0.0,
            program.on_path.stretch.at,
        )
    except InvalidInput as problem:
        return Unsolved(str(problem))
    peak = float(program.torques(y).max())
    final = optimum._replace(peak=peak, duration=law.duration / program.units.time)
    return Best(law, peak, program.units.torque, _cost(program, final))


def kept_between(
    program: SpeedProgram, cones: ConeProgram, optimum: Optimum
) -> tuple[ConeProgram, Optimum] | Infeasible | Unsolved:
    """Solve again with rows where a limit does not hold between the points.

    Rows that are far from their limit are left out of that; where they are needed they come back.
    """
    relevant = np.abs(cones.torque(optimum.y)) > MIN_ROW_TORQUE_RATIO * _allowed(cones.bounded, optimum.peak)
    rows = Affine(cones.torque.matrix[relevant], cones.torque.offset[relevant])
    cones = replace(cones, torque=rows, bounded=cones.bounded[relevant])
    limited = program.specification.limited_motors
    for _ in range(MAX_ROW_ROUNDS):
        allowed = np.where(limited, 1.0, np.inf)
        if program.specification.goal == "peak_torque" or not program.specification.limited:
            allowed = _allowed(limited, optimum.peak) * (1.0 + 2.0 * LIMIT_MARGIN)
        extended = _with_rows_where_exceeded(program, cones, optimum.y, allowed)
        if extended is None:
            break
        resolved = program.solved(extended)
        if not isinstance(resolved, Optimum):
            return resolved
        cones, optimum = extended, resolved
    return cones, optimum


def lowest_cost(program: SpeedProgram, optimum: Optimum) -> float:
    """Return the cost that no law of this degree goes below: rows at few points, no floor, rough or not.

    That of `optimum`, which had all of these, where the program without is not solved.
    """
    cones = replace(program, roughness=0.0).cones()
    lowest = program.solved(replace(cones, floor=0.0))
    return _cost(program, lowest if isinstance(lowest, Optimum) else optimum)


def _cost(program: SpeedProgram, optimum: Optimum) -> float:
    time, torque = program.units.time, float(program.units.torque.max())
    if program.specification.goal == "time":
        return optimum.duration * time
    return (
        optimum.peak * torque
        if program.specification.goal == "peak_torque"
        else optimum.value * torque**2 * time
    )


def _with_rows_where_exceeded(
    program: SpeedProgram, cones: ConeProgram, y: Array, allowed: Array
) -> ConeProgram | None:
    """Add rows where torques of y exceed what is allowed (n_a,), speeds what they may be, or z is too low.

    Returns None if there are none.
    """
    over = _peaks((program.torques(y) / allowed).max(axis=1), 1.0)
    low = ends_and_extrema(y)
    low = low[chebyshev.chebval(low, y) < 0.5 * cones.floor]
    fastest = 1.0
    if program.specification.goal in ("peak_speed", "peak"):
        fastest = float((cones.below_one @ y).max(initial=0.0)) * (1.0 + 2.0 * LIMIT_MARGIN)
    fast = _peaks(program.squared_speeds(y), fastest)
    if not len(over) and not len(low) and not len(fast):
        return None
    return replace(
        cones,
        torque=_stacked(cones.torque, program.torque_rows(program.between[over])),
        bounded=np.append(cones.bounded, np.tile(program.specification.limited_motors, len(over))),
        below_one=np.concatenate([cones.below_one, program.speed_rows(program.between[fast])]),
        positive=np.concatenate([cones.positive, chebyshev.chebvander(low, program.degree)]),
    )


def _lasting(program: SpeedProgram, cones: ConeProgram, quick: Optimum) -> Array:
    """Compute coefficients of a law of the required duration, between the quick one and a slow one.

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
    if duration_of(quick.y, stretch) > duration * (1.0 - QUICKEST_MARGIN):
        return adjusted(quick.y, cones.equalities, duration, stretch)
    for peak_ratio in PEAK_RATIOS:
        previous, allowed = quick.y, _allowed(program.specification.limited_motors, peak_ratio * quick.peak)
        for _ in range(MAX_CONVEX_CONCAVE_STEPS):
            rows = _scaled(cones.torque, _allowed(cones.bounded, peak_ratio * quick.peak))
            everything = replace(cones, torque=rows, bounded=np.ones_like(cones.bounded))
            slow = solve_cone_program(everything, "slowest", about=previous)
            if not isinstance(slow, Optimum):
                break
            extended = _with_rows_where_exceeded(program, cones, slow.y, allowed * (1.0 + 2.0 * LIMIT_MARGIN))
            if extended is not None:
                cones = extended
            elif duration_of(slow.y, stretch) > duration:
                blend = blended(previous, slow.y, duration, stretch)
                return adjusted(blend, cones.equalities, duration, stretch)
            else:
                previous = slow.y
    raise InvalidInput("no law of this degree advances all the time and takes so long")


def _stacked(first: Affine, second: Affine) -> Affine:
    return Affine(
        np.concatenate([first.matrix, second.matrix]), np.concatenate([first.offset, second.offset])
    )


def _scaled(rows: Affine, units: Array) -> Affine:
    return Affine(rows.matrix / units[:, None], rows.offset / units)


def _allowed(limited: BoolArray, peak: float) -> Array:
    """Return the peak, or the limit of motors that have one where that is less."""
    return np.where(limited, min(peak, 1.0), peak)


def _peaks(values: Array, allowed: float) -> IntArray:
    """Return the indices of the local maxima above the allowed value."""
    padded = np.concatenate(([-np.inf], values, [-np.inf]))
    highest = (values >= padded[:-2]) & (values >= padded[2:])
    return np.flatnonzero(highest & (values > allowed))
