"""Condition (8) imposed beside the true singular point, 1e-3 ... 1e-13 off in s.

What goes wrong: the law is perfect at a point that is not singular, and where it is singular a force is left
along t_s. The torque has a pole, as infinite as any, but narrow: a table of 1501 samples does not show it.
Why: condition (8) is a condition on the singular instant itself, and rounded data name another.
What we do: t_s . W_p is taken on the instant at which the robot is singular, and compared with the sum of
its terms. Above 1e-11 of them it is a pole and no torque is returned; below, it is rounding of s itself, and
what is returned is the torque of the true crossing.
"""

from functools import cache

import numpy as np
import pytest

from framework import UnboundedTorque, plan_crossing
from framework.planning.plan import uncertified_law
from tests.oracles import naive
from tests.oracles.planar import (
    CROSSING_SPEED,
    CROSSING_TIME,
    DURATION,
    END,
    LINE,
    PAYLOAD,
    START,
    crossing_coordinate,
    exact,
    exact_torque,
    legs,
    mp,
    on_line,
    power_law,
    relative,
    value,
    without_rotors,
)

OFFSETS = 10.0 ** -np.arange(3, 14)  # of the imposed path coordinate
SEEN = 1e-11  # the smallest that is told from rounding
ASKED = dict(duration=DURATION, times=[CROSSING_TIME], speeds=[CROSSING_SPEED])


@cache
def true_point() -> float:
    return float(crossing_coordinate())


def left_over(offset: float) -> float:
    """|t_s . W_p| [N] at the singular instant of a law made for s_c + offset, in fifty digits."""
    s_c = crossing_coordinate()
    law = power_law((mp.mpf(true_point() + offset), mp.mpf(CROSSING_SPEED), mp.zero))
    t = mp.findroot(lambda t: value(law, t) - s_c, (CROSSING_TIME - offset, CROSSING_TIME), tol=1e-30)
    (_, (px, py)), _ = legs(*on_line(s_c))
    tangent = [exact(END[k]) - exact(START[k]) for k in range(2)]
    across = (-py * tangent[0] + px * tangent[1]) / mp.hypot(px, py)
    return float(abs(PAYLOAD * value(law, t, 2) * across))


def right_peak() -> float:
    """Largest torque [N m] of the right law, in fifty digits; none of the instants is singular."""
    law = power_law((crossing_coordinate(), mp.mpf(CROSSING_SPEED), mp.zero))
    instants = np.linspace(0.0, DURATION, 152)
    return float(max(abs(part) for t in instants for part in exact_torque(law, t)))


def naive_peaks(samples: int = 1501) -> np.ndarray:
    """Largest sampled torque [N m] of the law for each offset, over that of the right law."""
    robot = without_rotors()
    peaks = []
    for offset in OFFSETS:
        law, _ = uncertified_law(robot, LINE, at=[true_point() + offset], **ASKED)
        peaks.append(naive.peak_torque(law, samples))
    return np.array(peaks) / right_peak()


def beside_the_pole(offset: float, distance: float = 1e-9) -> float:
    """Torque [N m], in fifty digits, `distance` [s] behind the singular instant."""
    s_c = crossing_coordinate()
    law = power_law((mp.mpf(true_point() + offset), mp.mpf(CROSSING_SPEED), mp.zero))
    t = mp.findroot(lambda t: value(law, t) - s_c, (CROSSING_TIME - offset, CROSSING_TIME), tol=1e-30)
    return float(max(abs(part) for part in exact_torque(law, t + mp.mpf(distance))))


@cache
def our_verdicts() -> np.ndarray:
    """|t_s . W_p| [N] that stops us for each offset; not a number where a plan is returned."""
    verdicts = []
    for offset in OFFSETS:
        try:
            plan_crossing(without_rotors(), LINE, at=[true_point() + offset], **ASKED)
            verdicts.append(np.nan)
        except UnboundedTorque as error:
            verdicts.append(abs(error.wrench))
    return np.array(verdicts)


def test_we_measure_what_is_left_at_the_singular_instant():
    verdicts = our_verdicts()
    told = OFFSETS >= 0.9 * SEEN
    assert not np.any(np.isnan(verdicts[told]))
    expected = np.array([left_over(offset) for offset in OFFSETS[told]])
    # s is known to 1e-16, hence the wrench to 1e-16 / offset of itself
    assert np.all(np.abs(verdicts[told] / expected - 1) < np.maximum(1e-6, 1e-14 / OFFSETS[told]))


def test_a_force_of_three_in_1e11_is_told_and_one_of_a_third_is_rounding():
    """Over the payload's largest inertia across the left rod along the motion, in closed form."""
    law = power_law((crossing_coordinate(), mp.mpf(CROSSING_SPEED), mp.zero))
    tangent = [exact(END[k]) - exact(START[k]) for k in range(2)]
    largest = mp.zero
    for t in np.linspace(0.0, DURATION, 302):
        (_, (px, py)), _ = legs(*on_line(value(law, mp.mpf(t))))
        across = (px * tangent[1] - py * tangent[0]) / mp.hypot(px, py)
        largest = max(largest, abs(PAYLOAD * value(law, mp.mpf(t), 2) * across))
    offset = 1e-11 * float(largest) / (left_over(1e-7) / 1e-7)
    plan_crossing(without_rotors(), LINE, at=[true_point() + offset / 3], **ASKED)
    with pytest.raises(UnboundedTorque):
        plan_crossing(without_rotors(), LINE, at=[true_point() + 3 * offset], **ASKED)


def test_what_is_not_told_from_rounding_is_harmless():
    assert np.all(np.isnan(our_verdicts()[OFFSETS < 0.9 * SEEN]))
    law = power_law((crossing_coordinate(), mp.mpf(CROSSING_SPEED), mp.zero))
    for offset in (1e-12, -1e-12, 1e-13):
        plan = plan_crossing(without_rotors(), LINE, at=[true_point() + offset], **ASKED)
        for t in (0.3, 0.999, 1.0 - 1e-6, 1.0 + 1e-9, 1.2):
            assert relative(plan.torque(t), exact_torque(law, t)) < 1e-9
