"""Motions of a microsecond and of a fortnight.

What goes wrong: a law in raw powers of t has columns t^0 ... t^12, which for 1e6 s span 72 decades. Steps and
tolerances in seconds see nothing or never end.
Why: time has a unit, and the powers of a number far from one do not fit together.
What we do: time is normalised and the basis is Chebyshev's; torques scale as 1 / T^2 to rounding. Elastic
robots that would tear in a microsecond are refused. So is a slow crossing under gravity: "slowly enough,
inertia vanishes" leaves the whole weight along t_s, however slowly; only a fall with it passes.
"""

import numpy as np
import pytest

import robots
from framework import InvalidInput, Line, NoLaw, NotConverged, UnboundedTorque, plan_crossing
from tests.oracles.planar import LINE

DEAD_CENTRE = Line([1.0], [-0.8])  # [rad] of the crank, over its outer dead centre
DURATIONS = 10.0 ** np.arange(-6, 7, 2)  # [s]


def scaled_torque(duration: float, flexibility: str = "rigid") -> np.ndarray:
    """Torques times T^2 [N m s^2] at equal shares of the duration."""
    plan = plan_crossing(
        robots.load("five_bar", flexibility=flexibility),
        LINE,
        law="polynomial",
        duration=duration,
        times=[0.6 * duration],
        speeds=[1.2 / duration],
    )
    return plan.torque(np.linspace(0.0, duration, 101)) * duration**2


@pytest.mark.parametrize("duration", DURATIONS)
def test_rigid_torques_scale_as_one_over_the_square_of_the_duration(duration):
    one = scaled_torque(1.0)
    assert np.abs(scaled_torque(duration) - one).max() < 1e-11 * np.abs(one).max()


@pytest.mark.parametrize(
    "flexibility", [pytest.param("flexible_joints", marks=pytest.mark.slow), "flexible_links"]
)
def test_elastic_robots_are_as_rigid_in_a_fortnight_and_torn_in_a_microsecond(flexibility):
    slow, slower = (scaled_torque(duration, flexibility) for duration in (1e4, 1e6))
    assert np.abs(slower - slow).max() < 1e-7 * np.abs(slow).max()  # deflections fall as 1 / T^2
    for duration in (1e-6, 1e-4, 1e-2):
        with pytest.raises(NotConverged, match="springs are too soft"):
            scaled_torque(duration, flexibility)


def left_of_the_weight(duration: float) -> float:
    """|t_s . W_p| [N m] when a slider-crank is taken over its dead centre without a condition (8)."""
    robot = robots.load("slider_crank")
    with pytest.raises(UnboundedTorque) as caught:
        plan_crossing(robot, DEAD_CENTRE, duration=duration, times=[])
    return abs(caught.value.wrench)


def test_under_gravity_slowness_does_not_help():
    left = np.array([left_of_the_weight(duration) for duration in (1e1, 1e2, 1e4, 1e6)])
    assert left[-1] > 0.01
    assert left[-1] == pytest.approx(
        left[-2], rel=1e-6
    )  # the moment of the weight about the crank, 1 / T^2 apart
    plan = plan_crossing(robots.load("slider_crank"), DEAD_CENTRE, duration=1.0)
    assert plan.crossings[0].residual < 1e-11
    with pytest.raises(NoLaw):
        plan_crossing(robots.load("slider_crank"), DEAD_CENTRE, law="polynomial", duration=1e6)


@pytest.mark.slow
def test_under_gravity_no_law_whatever_is_slow():
    with pytest.raises(NoLaw, match="no law that always advances"):
        plan_crossing(robots.load("slider_crank"), DEAD_CENTRE, duration=1e6)


@pytest.mark.parametrize("duration", [1e-300, 1e-31, 1e31, 1e300])
def test_durations_whose_powers_overflow_are_refused(duration):
    with pytest.raises(InvalidInput, match="duration: must lie in"):
        scaled_torque(duration)
