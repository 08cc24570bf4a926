"""Limits with which a path that was refused is crossed: the least peaks of torque and of speed.

Torques are affine in the squared speed z and squared speeds linear, so the least peak of either, within the
limits of the other, is a cone program like the one that was refused. Where neither kind of limit alone is
enough, the larger of torque and squared speed, each over its limit, is made least.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from framework.crossing.optimal.best_law import Best, best_law, kept_between
from framework.crossing.optimal.speed_program import SpeedProgram
from framework.crossing.refusals.refusal_proofs import LeastLimits
from framework.motion.cone_program import Optimum, Unsolved
from framework.motion.infeasibility import Infeasible


def least_limits(program: SpeedProgram) -> LeastLimits:
    """Compute the limits that would do, in proportion to those of a program that has no law of its degree."""
    torque = _least_torque_peak(program)
    speed = _least_speed_peak(program)
    together = torque is None and speed is None
    if together:
        torque, speed = _least_peaks(program)
    return LeastLimits.of(program.specification, torque, speed, together=together and torque is not None)


def least_duration(program: SpeedProgram) -> float | None:
    """Compute the least duration [s] of laws of this degree within all limits; None where none was found."""
    specification = program.specification
    if not (specification.limited or specification.limited_speeds):
        return None
    quickest = replace(specification, goal="time", duration=None, longest=None)
    best = best_law(replace(program, specification=quickest))
    return best.law.duration if isinstance(best, Best) else None


def _least_torque_peak(program: SpeedProgram) -> float | None:
    """Return the least peak of torque over its limit, in the required duration within the speed limits."""
    if not program.specification.limited or program.specification.most is None:
        return None
    best = best_law(_without_torque_limits(program, "peak_torque"))
    return best.peak if isinstance(best, Best) else None


def _least_speed_peak(program: SpeedProgram) -> float | None:
    """Return the least peak of speed over its limit, in the required duration within the torque limits."""
    slow = replace(program, specification=replace(program.specification, goal="peak_speed"))
    optimum = _optimum(slow)
    return None if optimum is None else _speed_peak(slow, optimum)


def _least_peaks(program: SpeedProgram) -> tuple[float | None, float | None]:
    """Return peaks of torque and of speed over their limits where the larger of torque and squared speed is
    least, in the required duration."""
    free = _without_torque_limits(program, "peak")
    optimum = _optimum(free)
    if optimum is None:
        return None, None
    return float(free.torques(optimum.y).max()), _speed_peak(free, optimum)


def _without_torque_limits(program: SpeedProgram, goal: str) -> SpeedProgram:
    """Return a program in which torques are bounded by nothing but a goal that is over their limits."""
    specification = program.specification
    unlimited = np.full(len(specification.torque_limit), np.inf)
    # a motor without a limit counts for nothing in a peak over the limits
    torque = np.where(specification.limited_motors, program.units.torque, np.inf)
    return replace(
        program,
        specification=replace(specification, goal=goal, torque_limit=unlimited),
        units=program.units._replace(torque=torque),
    )


def _speed_peak(program: SpeedProgram, optimum: Optimum) -> float:
    return float(np.sqrt(program.squared_speeds(optimum.y).max()))


def _optimum(program: SpeedProgram) -> Optimum | None:
    """Return the optimum of a program with limits of speed in a duration; None without, or if it has none."""
    specification = program.specification
    if not specification.limited_speeds or specification.most is None:
        return None
    cones = program.cones()
    optimum = program.solved(cones)
    if not isinstance(optimum, Optimum):
        return None
    kept = kept_between(program, cones, optimum)
    return None if isinstance(kept, Infeasible | Unsolved) else kept[1]
