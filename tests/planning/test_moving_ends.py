"""Laws that start or end in motion: against figures found by another program, bounds, and simulation."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import CrossingPlan, InvalidInput, Line, NoLaw, load_plan, plan_crossing, simulate
from framework.control import ControlLoop, Spread, reference_of, run_study, tuned_controller
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.saved import save_plan
from tests.oracles.equations_of_motion import defects_of

PATH = Line([0.1, 0.345], [-0.05, 0.195])
LIMIT = 0.165  # [N m]
# s' and s" at start and goal; least peak [N m] in 1.5 s and least duration [s] within LIMIT, by a free search
FIGURES = (
    pytest.param({"start_speed": 0.6}, 0.0332, 0.705, marks=pytest.mark.slow),
    pytest.param({"end_speed": 0.6}, 0.0179, 0.649, marks=pytest.mark.slow),
    ({"start_speed": [0.6, 0.3], "end_speed": [0.6, -0.3]}, 0.0071, 0.618),
)


def robot(flexibility: str = "rigid"):
    return robots.load("five_bar", flexibility=flexibility)


def end_derivatives(plan: CrossingPlan, orders: int) -> np.ndarray:
    """s', s", ... (2, orders) at start and goal."""
    return np.array([[plan.law(t, k) for k in range(1, orders + 1)] for t in (0.0, plan.duration)])


def stated(ends: dict, orders: int) -> np.ndarray:
    """The derivatives (2, orders) that the options ask for; those that are left out vanish."""
    rows = [np.atleast_1d(ends.get(name, 0.0)) for name in ("start_speed", "end_speed")]
    return np.array([np.pad(row, (0, orders - len(row))) for row in rows])


def value_and_bound(plan: CrossingPlan) -> tuple[float, float]:
    """The cost of a plan by its goal, measured on samples, and what no law can undercut."""
    bound = bound_plan(plan)
    assert bound is not None
    if plan.request.goal == "time":
        return plan.duration, bound.value
    peak = np.abs(plan.torque(np.linspace(0.0, plan.duration, 4001))).max()
    return float(peak), bound.value * float(bound.reference.max())


@pytest.mark.slow
@pytest.mark.parametrize(("ends", "peak", "duration"), FIGURES)
def test_moving_ends_need_less_torque_and_time_and_the_bound_knows(ends, peak, duration):
    least_peak = plan_crossing(robot(), PATH, duration=1.5, law="optimal", **ends)
    quickest = plan_crossing(robot(), PATH, optimize="time", torque_limit=LIMIT, **ends)
    for plan, figure in ((least_peak, peak), (quickest, duration)):
        value, bound = value_and_bound(plan)
        assert value == pytest.approx(figure, rel=1e-2)
        assert 0.975 * value < bound <= value * (1.0 + 1e-9)
        np.testing.assert_allclose(end_derivatives(plan, 2), stated(ends, 2), atol=1e-8)
        assert simulate(plan).tracking_error < 1e-9


@pytest.mark.parametrize("k", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 8))])
def test_bounds_hold_for_drawn_ends(k):
    """Polynomials are laws, too: none undercuts the bound of the free law's request."""
    rng = np.random.default_rng([55, k])
    ends = {name: [rng.uniform(0.1, 1.0), rng.uniform(-0.5, 0.5)] for name in ("start_speed", "end_speed")}
    value, bound = value_and_bound(plan_crossing(robot(), PATH, duration=1.2, law="optimal", **ends))
    assert bound <= value * (1.0 + 1e-9)
    polynomial = plan_crossing(robot(), PATH, duration=1.2, law="polynomial", **ends)
    assert bound <= max(polynomial.peak_torque.values())


@pytest.mark.parametrize(
    "flexibility", ["flexible_joints", pytest.param("flexible_links", marks=pytest.mark.slow)]
)
def test_elastic_robots_start_and_end_in_motion(flexibility):
    ends = {"start_speed": [0.6, 0.3, -0.2, 0.4], "end_speed": 0.5}
    for law in ("polynomial", "optimal"):
        plan = plan_crossing(robot(flexibility), PATH, duration=1.5, law=law, **ends)
        np.testing.assert_allclose(end_derivatives(plan, 4), stated(ends, 4), atol=1e-6)
        assert simulate(plan).tracking_error < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("goal", ["peak_torque", "energy"])
def test_a_law_between_moving_ends_holds_back_as_long_as_required(goal):
    """It takes more than twice as long as at the speed of its ends, and slows down between them."""
    plan = plan_crossing(robot(), PATH, duration=4.0, start_speed=0.6, end_speed=0.6, optimize=goal)
    assert plan.duration == pytest.approx(4.0, rel=1e-12)
    assert plan.law(np.array([0.0, 4.0]), 1) == pytest.approx([0.6, 0.6])
    assert plan.certificate.monotone
    assert np.abs(defects_of(plan).force) < 1e-8


def test_required_times_are_met_between_moving_ends_by_a_higher_degree():
    plan = plan_crossing(robot(), PATH, duration=1.5, times=[0.5], start_speed=0.2, end_speed=0.3)
    assert plan.law.degree > 8
    assert plan.certificate.monotone
    assert plan.crossings[0].time == pytest.approx(0.5, abs=1e-12)
    np.testing.assert_allclose(end_derivatives(plan, 2), [[0.2, 0.0], [0.3, 0.0]], atol=1e-8)
    defect = defects_of(plan)
    assert max(defect.open, defect.acceleration, defect.force) < 1e-8


@pytest.mark.slow
def test_a_start_too_fast_to_brake_is_refused_with_a_speed_that_brakes():
    with pytest.raises(NoLaw, match=r"from s' = 2 1/s, too fast to brake within the limits") as refusal:
        plan_crossing(robot(), PATH, optimize="time", torque_limit=0.02, start_speed=2.0)
    remedy = refusal.value.remedy
    assert 0.1 < remedy["start_speed"][0] < 2.0
    plan = plan_crossing(robot(), PATH, optimize="time", torque_limit=0.02, **remedy)
    assert max(plan.peak_torque.values()) <= 0.02


def test_an_end_that_alone_exceeds_the_limits_is_refused_for_it():
    with pytest.raises(NoLaw, match=r"at the start left_motor must drive with 0\.57"):
        plan_crossing(robot(), PATH, optimize="time", torque_limit=LIMIT, start_speed=[2.0, 60.0])


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"start_speed": -0.1}, "start_speed: s' must be greater than zero"),
        ({"end_speed": [0.0, 0.3]}, "end_speed: s' must be greater than zero"),
        ({"start_speed": [0.1, 0.0, 0.0]}, "start_speed: needs 1 to 2 derivatives"),
        ({"end_speed": "fast"}, "end_speed"),
    ],
)
def test_ends_that_no_law_has_are_invalid(option, message):
    with pytest.raises(InvalidInput, match=message):
        plan_crossing(robot(), PATH, duration=1.5, **option)


def test_rest_may_be_stated():
    stated_rest = plan_crossing(robot(), PATH, duration=1.5, start_speed=0.0, end_speed=[0.0, 0.0])
    at_rest = plan_crossing(robot(), PATH, duration=1.5)
    np.testing.assert_array_equal(stated_rest.law.coefficients, at_rest.law.coefficients)


@pytest.mark.parametrize("law", ["polynomial", pytest.param("optimal", marks=pytest.mark.slow)])
def test_a_saved_plan_keeps_its_ends(law, tmp_path):
    plan = plan_crossing(robot(), PATH, duration=1.5, law=law, start_speed=[0.6, 0.1])
    save_plan(plan, tmp_path)
    again = load_plan(tmp_path)
    np.testing.assert_array_equal(again.torque(0.3), plan.torque(0.3))
    assert again.request.ends == plan.request.ends


def test_dry_friction_acts_at_an_end_in_motion():
    """The torque at the start is the limit of those just after it; from rest friction sets in with a jump."""
    heavy = robots.load("biglide", flexibility="rigid")
    axes = heavy.reference.x
    path = Line(axes, axes + 0.02)
    friction = heavy.joint_friction.copy()
    friction[heavy.actuated] = 0.3
    rubbing = replace(heavy, joint_friction=friction)
    plan = plan_crossing(rubbing, path, duration=1.0, start_speed=0.5)
    np.testing.assert_allclose(plan.torque(0.0), plan.torque(1e-9), atol=1e-5)
    smooth = plan.dynamics.torques(0.0)
    np.testing.assert_allclose(np.abs(plan.torque(0.0) - smooth), 0.3 / np.abs(rubbing.gear_ratio))


def test_a_controlled_robot_starts_with_the_speed_of_its_plan():
    plan = plan_crossing(robot(), PATH, duration=1.5, start_speed=0.6)
    study = run_study(
        tuned_controller("feedforward", reference_of(plan, period=5e-3)), ControlLoop(), Spread(), runs=1
    )
    assert study.tracking_error.max() < 1e-3
