"""Where the polynomial is not resolved the optimal law is tried, and is right there."""

import numpy as np
import pytest

import robots
from framework import Line, NoAnswer, NotConverged, UnboundedTorque, plan_crossing
from tests.oracles.equations_of_motion import defects_at

TOP = float(np.sqrt(0.06))  # [m] of the locus of the 5R on its axis of symmetry


@pytest.mark.parametrize("gap", [1e-6, pytest.param(1e-5, marks=pytest.mark.slow)])
def test_a_path_beside_the_locus_is_planned_by_the_law_that_resolves_it(gap):
    robot, path = robots.load("five_bar"), Line([0.06, TOP + gap], [-0.06, TOP + gap])
    with pytest.raises(NotConverged, match="misses a singularity"):
        plan_crossing(robot, path, duration=1.5, law="polynomial")
    plan = plan_crossing(robot, path, duration=1.5)
    assert plan.law.kind == "optimal"
    assert plan.reason.startswith("optimal, as the polynomial is not resolved over 1.5 s: ")
    times = np.linspace(0.0, plan.duration, 1001)
    middle = float(np.interp(0.5, plan.law(times), times))
    t = np.concatenate([times[::50], middle + np.array([0.0, 1e-3, -1e-3, 1e-5, -1e-5, 1e-7, -1e-7])])
    found = defects_at(plan, t)
    assert found.open < 1e-12
    assert found.force < 1e-8  # beside the locus |g| is 1e-5 and less, and the torques are rounded by as much


def test_a_speed_that_is_given_is_kept_however_slow():
    """Without it a polynomial of a twentieth of the mean speed is replaced by the optimal law."""
    path = Line([0.06, 0.28], [-0.02, 0.2])
    plan = plan_crossing(robots.load("five_bar"), path, duration=1.0, speeds=[0.05])
    (crossing,) = plan.crossings
    assert plan.law.kind == "polynomial"
    assert crossing.speed == 0.05
    assert plan.law(crossing.time, 1) == pytest.approx(0.05, rel=1e-9)


BESIDE = Line([0.1, TOP + 1e-4], [-0.02, TOP + 1e-4])


def peaks(plan) -> float:
    return max(plan.peak_torque.values())


@pytest.fixture(scope="module")
def optimal():
    return plan_crossing(robots.load("five_bar"), BESIDE, duration=1.5)


def test_beside_the_locus_the_law_of_lower_peak_torque_is_taken(optimal):
    polynomial = plan_crossing(robots.load("five_bar"), BESIDE, duration=1.5, law="polynomial")
    assert optimal.law.kind == "optimal"
    assert peaks(optimal) < 0.5 * peaks(polynomial)
    assert f"largest torque, {peaks(polynomial):.4g} N m, is beside s = " in optimal.reason


@pytest.mark.slow
def test_the_law_that_takes_the_place_of_a_polynomial_is_the_optimal_one(optimal):
    plan = plan_crossing(robots.load("five_bar"), BESIDE, duration=1.5, law="optimal")
    assert (plan.law.kind, peaks(plan)) == ("optimal", peaks(optimal))


A, B, S = (
    np.array([0.1, 0.345]),
    np.array([-0.05, 0.195]),
    0.667006874764,
)  # of the paper, and where it crosses


def ending(off: float) -> Line:
    """The paper's line, ended this far [m] before the locus."""
    return Line(A, A + S * (B - A) - off * (B - A) / np.linalg.norm(B - A))


@pytest.mark.parametrize("off", [1e-4, pytest.param(1e-3, marks=pytest.mark.slow)])
def test_a_path_that_ends_before_the_locus_is_planned_with_the_law_of_lower_peak(off):
    robot = robots.load("five_bar")
    polynomial = plan_crossing(robot, ending(off), duration=1.5, law="polynomial")
    plan = plan_crossing(robot, ending(off), duration=1.5)
    assert plan.law.kind == "optimal"
    assert "is beside s = 1, where the path misses a singularity" in plan.reason
    assert peaks(plan) < 0.2 * peaks(polynomial)
    t = np.linspace(0.0, plan.duration, 101)
    left = defects_at(plan, t)
    assert left.force < 1e-9


@pytest.mark.slow
def test_what_was_tried_is_not_advised():
    path = Line(A + (S - 1e-5) * (B - A), B)
    with pytest.raises(NoAnswer) as refusal:
        plan_crossing(robots.load("five_bar"), path, duration=1.5, speeds=[1.5], torque_limit=0.5)
    assert "nor does the optimal law help" in str(refusal.value)
    assert "use the optimal law" not in str(refusal.value)
    assert "use law" not in str(refusal.value)


def test_a_polynomial_whose_peak_is_lower_is_kept_and_says_what_the_other_costs(monkeypatch, optimal):
    from framework.planning import plan as planning

    monkeypatch.setattr(planning, "max_torque_ratio", lambda plan, _: float(plan.law.kind == "optimal"))
    plan = plan_crossing(robots.load("five_bar"), BESIDE, duration=1.5)
    assert plan.law.kind == "polynomial"
    assert plan.reason.endswith(f"; the optimal law's is {peaks(optimal):.4g} N m")


@pytest.mark.parametrize(
    "error",
    [
        NotConverged("no", residual=1.0),
        UnboundedTorque("no", time=1.0, s=0.5, platform=np.zeros(2), wrench=1.0),
    ],
)
def test_a_polynomial_is_kept_where_the_other_law_is_not_found(error, monkeypatch):
    from framework.planning.optimal import optimal_motion

    def refused(*_):
        raise error

    monkeypatch.setattr(optimal_motion, "optimal_motion", refused)
    plan = plan_crossing(robots.load("five_bar"), BESIDE, duration=1.5)
    assert plan.law.kind == "polynomial"
    assert plan.reason.endswith("; the optimal law is not found: no")


@pytest.mark.parametrize("height", [TOP + 1e-3, TOP + 3e-2])
def test_away_from_the_locus_no_other_law_is_tried(height, monkeypatch):
    from framework.planning.optimal import optimal_motion

    monkeypatch.setattr(optimal_motion, "optimal_motion", None)
    plan = plan_crossing(robots.load("five_bar"), Line([0.1, height], [-0.02, height]), duration=1.5)
    assert (plan.law.kind, plan.reason) == ("polynomial", "the polynomial advances")
