"""Whether the largest torque of a plan stands beside a near miss of the singular locus.

There |g| is about g0 (1 + x^2) with x = (s - s0) / width, and the motors need (c + d x) / |g|: what a motion
asks along t_s, to first order, over the measure. Whatever c and d are, that is largest within |x| <= 1; other
torques on top of it move the largest outwards. Planning with the optimal law lowers such a peak.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.arrays import Array
from framework.crossing.result import PEAK_SAMPLES, CrossingPlan
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import NEAR_MISS_WIDTHS

SAMPLES_BESIDE = 65


def miss_of_peak(plan: CrossingPlan, near_misses: Sequence[NearMiss]) -> NearMiss | None:
    """Return the near miss beside which the largest torque of a plan stands; None if there is none.

    Of the motor that has the largest torque over its limit, or in N m or N.
    """
    if not near_misses:
        return None
    times = np.linspace(0.0, plan.duration, PEAK_SAMPLES)
    s = plan.law(times)
    widths = NEAR_MISS_WIDTHS * np.linspace(-1.0, 1.0, SAMPLES_BESIDE)
    beside = [np.interp(miss.s + miss.width * widths, s, times) for miss in near_misses]
    times = np.concatenate([times, *beside])
    limits = [motor.torque_limit for motor in plan.robot.description.actuators]
    size = 1.0 if None in limits else np.array(limits, dtype=float)
    peak = float(plan.law(times[int(np.argmax((np.abs(plan.torque(times)) / size).max(axis=1)))]))
    return next((miss for miss in near_misses if abs(peak - miss.s) <= NEAR_MISS_WIDTHS * miss.width), None)


def max_torque_ratio(plan: CrossingPlan, reference: Array) -> float:
    """Return the largest torque of a plan over reference (n_a,) [N m, N]."""
    return float((np.array(list(plan.peak_torque.values())) / reference).max())


def largest_torque(plan: CrossingPlan) -> str:
    """Return the largest torque of each kind of motor, with its unit."""
    peaks = zip(plan.peak_torque.values(), plan.robot.torque_units, strict=True)
    largest: dict[str, float] = {}
    for torque, unit in peaks:
        largest[unit] = max(torque, largest.get(unit, 0.0))
    return ", ".join(f"{torque:.4g} {unit}" for unit, torque in largest.items())
