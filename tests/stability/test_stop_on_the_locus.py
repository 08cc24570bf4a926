"""A motion that stops on the locus, or just before it.

What goes wrong: near the end W_p falls as (T - t)^(R - 1) and det A as (T - t)^(R + 1), whatever smoothness
R the law has: their quotient grows as (T - t)^-2. Sampled, the torque at the last sample but one seems large
yet finite, and is four times as large with twice as many samples.
Why: a robot at rest on the locus can hold nothing along t_s, and it gets there ever more slowly.
What we do: such a path is refused and told from one that ends a little before, where a polynomial's torque is
large, finite and computed (and the optimal law, of lower peak, is taken where the law is open).
"""

import numpy as np
import pytest

from framework import Line, NoAnswer, NoLaw, plan_crossing
from tests.oracles import planar
from tests.oracles.planar import exact, mp, without_rotors
from tests.singularity.test_points_on_path import locus

START = (0.1, 0.345)
ON_IT = locus(1.6)  # [m] off the axis of symmetry
GAPS = 10.0 ** -np.arange(2, 8)  # [m] left between the end of the path and the locus


def end_before(gap: float) -> Line:
    """Straight to a point that is `gap` [m] short of the locus."""
    way = ON_IT - np.array(START)
    return Line(START, ON_IT - gap * way / np.linalg.norm(way))


def peak(gap: float) -> tuple[float, float]:
    """Largest torque [N m] when the path ends `gap` short of the locus: ours, and in fifty digits there."""
    path = end_before(gap)
    plan = plan_crossing(without_rotors(), path, duration=1.5, law="polynomial")
    t = np.linspace(0.0, 1.5, 20001)
    worst = t[np.argmax(np.abs(plan.torque(t)).max(axis=1))]
    u = mp.mpf(worst) / mp.mpf("1.5")
    s, push = 10 * u**3 - 15 * u**4 + 6 * u**5, 10 * (60 * u - 180 * u**2 + 120 * u**3) / mp.mpf("1.5") ** 2
    start, end = ([exact(float(c)) for c in point] for point in (path.start, path.end))
    x = [a + s * (b - a) for a, b in zip(start, end, strict=True)]
    true = planar.load_torque(*x, tuple(push * (b - a) for a, b in zip(start, end, strict=True)))
    return float(np.abs(plan.torque(worst)).max()), float(max(abs(part) for part in true))


def test_a_stop_on_the_locus_is_refused_at_all_smoothness():
    for smoothness in (2, 3, 4, 8):
        with pytest.raises(NoLaw, match="ends on a Type 2 singularity"):
            plan_crossing(without_rotors(), end_before(0.0), duration=1.5, smoothness=smoothness)


def test_just_before_the_locus_large_torques_are_right_or_refused():
    peaks = []
    for gap in GAPS:
        try:
            ours, true = peak(gap)
        except NoAnswer:
            assert gap < 1e-6
            continue
        peaks.append(ours)
        assert ours == pytest.approx(true, rel=1e-8)
    assert peaks[-1] > 1e2 * peaks[0]
