"""Required times of crossings under the law of free shape."""

import mpmath as mp
import numpy as np
import pytest
from numpy.polynomial.chebyshev import poly2cheb

import robots
from framework import Line, NoLaw, plan_crossing
from framework.laws.squared_speed import ONE_CELL, Instants, SpeedBasis, SpeedSpace, Stretch
from framework.numerics.cone_program import Affine
from framework.planning.optimal.peak_bound import bound_plan
from tests.dynamics.upright_robots import rigid_crossing
from tests.planning.optimal.law_contradictions import Asked, answer

LINE = Line([0.1, 0.345], [-0.05, 0.195])
MET = 1e-9  # relative error of a time
SMOOTH = 5e-3  # what smoothness may cost, and rounding


def test_a_speed_is_adjusted_to_several_instants_at_once():
    """z = c + (sigma - a)^2 is at sigma at t = asinh((sigma - a) / c^(1/2)) + asinh(a / c^(1/2))."""
    space = SpeedSpace(SpeedBasis(np.array(ONE_CELL), 5), Stretch())
    c, a = 0.2, 0.3
    sigma = np.array([0.4, 0.7, 1.0])
    times = [float(mp.asinh((s - a) / mp.sqrt(c)) + mp.asinh(a / mp.sqrt(c))) for s in sigma]
    exact = np.pad(poly2cheb([c + (0.5 - a) ** 2, 0.5 - a, 0.25]), (0, 2))
    nothing = Affine(np.empty((0, 5)), np.empty(0))
    np.testing.assert_allclose(
        space.adjust(exact, nothing, Instants(sigma, np.array(times))), exact, atol=1e-13
    )
    other = exact * np.array([1.1, 0.9, 1.0, 1.0, 1.0])
    found = space.adjust(other, nothing, Instants(sigma, np.array(times)))
    z = np.polynomial.Chebyshev(found, [0.0, 1.0])
    for s, t in zip(sigma, times, strict=True):
        assert float(mp.quad(lambda x: float(z(float(x))) ** -0.5, [0, s])) == pytest.approx(t, rel=1e-12)


@pytest.mark.parametrize(
    "request_",
    [
        pytest.param({"duration": 1.5, "law": "optimal"}, marks=pytest.mark.slow),
        {"duration": 1.5, "optimize": "energy"},
        pytest.param({"optimize": "time", "torque_limit": 0.165}, marks=pytest.mark.slow),
    ],
    ids=["peak", "energy", "time"],
)
def test_a_required_time_is_met_with_condition_8_under_every_goal(request_):
    plan = plan_crossing(robots.load("five_bar"), LINE, times=[0.8], **request_)
    (crossing,) = plan.crossings
    assert plan.law.kind == "optimal"
    assert crossing.time == pytest.approx(0.8, rel=1e-12)
    assert float(plan.law(0.8)) == pytest.approx(crossing.s, abs=1e-11)
    assert plan.certificate.monotone
    assert np.abs(plan.torque(0.8 + np.array([-1e-6, 0.0, 1e-6]))).max() <= max(plan.peak_torque.values())


def check_times(k: int, share: float) -> None:
    """Hold laws with times, at a share of the way from their own to those of a uniform motion."""
    one = rigid_crossing(k)
    free = answer(one.robot, one.path, Asked("peak_torque", duration=one.duration))
    assert free.plan is not None, free.refusal
    own = np.array([crossing.time for crossing in free.plan.crossings])
    again = answer(one.robot, one.path, free.asked, times=own.tolist())
    assert again.plan is not None, again.refusal
    assert again.peak == pytest.approx(free.peak, rel=SMOOTH)  # own times are not those of the least cost
    times = own + share * (one.duration * np.array([crossing.s for crossing in free.plan.crossings]) - own)
    timed = answer(one.robot, one.path, free.asked, times=times.tolist())
    assert timed.plan is not None, timed.refusal
    np.testing.assert_allclose([crossing.time for crossing in timed.plan.crossings], times, rtol=MET)
    assert timed.peak >= free.peak * (1.0 - SMOOTH)
    bound = bound_plan(timed.plan)
    assert bound is None or bound.value * timed.plan.optimality.reference.max() <= timed.peak * (1.0 + 1e-9)
    try:
        polynomial = plan_crossing(
            one.robot, one.path, duration=one.duration, times=times.tolist(), law="polynomial"
        )
    except NoLaw:
        return
    assert timed.peak <= max(polynomial.peak_torque.values()) * (1.0 + SMOOTH)


@pytest.mark.slow
@pytest.mark.parametrize(("k", "share"), [(2, 0.5), (3, 0.5), (5, 0.5), (9, 0.3)])
def test_laws_with_times_cost_more_than_free_ones_less_than_polynomials_and_own_times_nothing(k, share):
    check_times(k, share)


@pytest.mark.slow
def test_limits_that_a_refusal_of_a_time_advises_do():
    robot, limits = robots.load("five_bar"), {"torque_limit": 0.165, "optimize": "time"}
    with pytest.raises(NoLaw, match=r"crosses at t = 0\.3 s, but from the start to t = 0\.3 s") as refused:
        plan_crossing(robot, LINE, times=[0.3], **limits)
    plan = plan_crossing(robot, LINE, times=[0.3], **{**limits, **refused.value.remedy})
    assert plan.crossings[0].time == pytest.approx(0.3, rel=MET)


@pytest.mark.slow
def test_an_elastic_robot_crosses_at_the_required_time_where_it_is_singular():
    robot = robots.load("five_bar", flexibility="flexible_joints")
    plan = plan_crossing(robot, LINE, duration=1.5, law="optimal", times=[0.9])
    assert plan.law.kind == "optimal"
    assert plan.crossings[0].time == pytest.approx(0.9, rel=MET)
