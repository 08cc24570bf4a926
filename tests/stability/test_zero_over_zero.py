"""0/0 at the instant of the crossing.

What goes wrong: a motion that meets condition (8) has A^-T W_p = 0/0 at the singular instant. The limit is
finite, the quotient of two rounded numbers is not it: at a distance d the numerator, of size d, carries
rounding of size eps, so the error grows as eps / d, and on the instant itself anything comes out.
Why: A is singular there, and the formula divides by its determinant.
What we do: the torque is a Chebyshev series through nodes that stay clear of the instant; a removable
quotient between two nodes is no event for it.
"""

from functools import cache

import numpy as np

from framework import plan_crossing
from tests.oracles import naive
from tests.oracles.planar import (
    CROSSING_SPEED,
    CROSSING_TIME,
    DURATION,
    LINE,
    crossing_coordinate,
    exact_torque,
    mp,
    power_law,
    relative,
    without_rotors,
)

DISTANCES = 10.0 ** -np.arange(2, 16)  # [s] from the crossing


@cache
def plan():
    return plan_crossing(
        without_rotors(), LINE, duration=DURATION, times=[CROSSING_TIME], speeds=[CROSSING_SPEED]
    )


def errors(distances=DISTANCES) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of the torque, naive and ours, at distances [s] behind the crossing."""
    law = power_law((crossing_coordinate(), mp.mpf(CROSSING_SPEED), mp.zero))
    direct, ours = [], []
    for distance in distances:
        t = CROSSING_TIME + distance
        true = exact_torque(law, mp.mpf(t) if t != CROSSING_TIME else mp.mpf(t) + mp.mpf(10) ** -20)
        direct.append(relative(naive.torque_at(plan().law, t), true))
        ours.append(relative(plan().torque(t), true))
    return np.array(direct), np.array(ours)


def test_the_series_has_all_digits_however_near_the_crossing():
    assert errors()[1].max() < 1e-11
    assert errors([0.0])[1] < 1e-11
