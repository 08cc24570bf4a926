"""A path that runs nearly orthogonal to t_s where it crosses.

What goes wrong: the acceleration that meets condition (8) is s" = -(beta s'^2 + gamma) / alpha, and alpha,
the hold that s" has on t_s . W_p, goes to zero with the angle a between the path and the normal of t_s. The
quotient grows as 1 / a, and with a = 0 it is whatever rounding says.
Why: an acceleration along the path then pushes nothing along t_s.
What we do: alpha is weighed against the force that s" = 1 can ask for at all. A bent path is refused; on a
straight one beta and gamma vanish as well, no s" is asked for, and it passes with s" = 0.
"""

from functools import cache

import numpy as np
import pytest

from framework import Arc, Line, NoAnswer, NoLaw, locate_singularities, plan_crossing
from tests.oracles.planar import without_rotors
from tests.singularity.test_points_on_path import locus

PLACE = locus(1.6)
ANGLES = np.array([0.3, 0.1, *10.0 ** -np.arange(2, 9)])  # [rad]


@cache
def twist() -> np.ndarray:
    """t_s (2,) at PLACE: normal to the rods, which lie on one line."""
    steep = np.array([0.03, 0.06])
    (point,) = locate_singularities(without_rotors(), Line(PLACE + steep, PLACE - steep))
    return point.twist


def directions(angle: float) -> np.ndarray:
    return np.array([-twist()[1], twist()[0]]) + angle * twist()


def bent(angle: float) -> Arc:
    """An arc through PLACE whose tangent there leaves the normal of t_s by an angle [rad]."""
    along = 0.05 * directions(angle)
    bend = 0.4 * np.array([along[1], -along[0]])  # across: PLACE is the middle of the arc
    return Arc(PLACE - along - bend, PLACE, PLACE + along - bend)


def asked_acceleration(angle: float, speed: float = 1.0) -> float:
    """s" [1/s^2] of condition (8) for a payload: -(t_s . x'') s'^2 / (t_s . x')."""
    path = bent(angle)
    with np.errstate(divide="ignore"):
        return float(-(path(0.5, 2) @ twist()) * speed**2 / np.float64(path(0.5, 1) @ twist()))


def our_answer(angle: float) -> float | None:
    """s" [1/s^2] over s'^2 that we cross the middle with, None when refused."""
    try:
        plan = plan_crossing(without_rotors(), bent(angle), duration=1.5, law="polynomial")
    except NoAnswer:
        return None
    middle = min(plan.crossings, key=lambda crossing: abs(crossing.s - 0.5))
    return middle.acceleration / middle.speed**2


@pytest.mark.slow
def test_we_cross_with_the_acceleration_asked_for_or_not_at_all():
    angles = [1.0, 0.8, *ANGLES]
    ours = [our_answer(angle) for angle in angles]
    assert ours[0] is not None  # steep enough for a law of degree 8
    for angle, answer in zip(angles, ours, strict=True):
        assert answer is None or answer == pytest.approx(asked_acceleration(angle), rel=1e-9)
    assert ours[-1] is None


def test_exactly_orthogonal_a_bent_path_is_refused():
    with pytest.raises(NoLaw, match="orthogonal to t_s"):
        plan_crossing(without_rotors(), bent(0.0), duration=1.5)


@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-13, 1e-11])
def test_exactly_orthogonal_a_straight_path_asks_for_no_acceleration(angle):
    along = 0.05 * directions(angle)
    plan = plan_crossing(without_rotors(), Line(PLACE - along, PLACE + along), duration=1.5)
    (crossing,) = plan.crossings
    assert crossing.acceleration == pytest.approx(0.0, abs=1e-14 * crossing.speed**2)  # rounding of the law
    assert plan.certificate.tail < 1e-12
    unprepared = plan_crossing(
        without_rotors(), Line(PLACE - along, PLACE + along), duration=1.5, times=[], law="polynomial"
    )
    assert unprepared.certificate.tail < 1e-10
    assert unprepared.crossings[0].residual < 1e-11
