"""Planning: what is chosen, what is refused, and what a plan promises."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    Condition,
    InvalidInput,
    Law,
    Line,
    NoLaw,
    ParallelRobot,
    Spline,
    UnboundedTorque,
    inverse_dynamics,
    locate_singularities,
    plan_crossing,
)
from framework.laws.law import conditions_at_instants
from framework.planning.plan_facts import motion_facts
from framework.planning.raised_polynomial import RaisedDegree
from framework.planning.refusals import check_advance
from framework.singularity.points_on_path import Condition8

ROBOT = "five_bar"
LINE = Line([0.1, 0.345], [-0.05, 0.195])
CLEAR = Line([0.1, 0.345], [-0.05, 0.295])
TWICE = Line([0.1, 0.345], [-0.2, -0.2])
CURVED = [
    Arc([0.1, 0.345], [0.02, 0.27], [-0.05, 0.16]),
    Spline(
        [[0.1, 0.345], [0.05, 0.3], [0.01, 0.27], [-0.02, 0.23], [-0.04, 0.2], [-0.05, 0.15], [-0.05, 0.1]]
    ),
]
VARIANTS = [("rigid", "rigid"), ("flexible_joints", "deformed"), ("flexible_links", "deformed")]


@pytest.mark.parametrize(("flexibility", "geometry"), VARIANTS)
@pytest.mark.parametrize(
    ("name", "path"),
    list(zip(("five_bar_heavy", "five_bar") * 2, (LINE, TWICE, *CURVED), strict=True)),
    ids=["line", "twice", "arc", "spline"],
)
def test_times_and_speeds_left_open_give_a_law_that_always_advances(name, flexibility, geometry, path):
    plan = plan_crossing(robots.load(name, flexibility=flexibility), path, duration=2.0)
    t = np.linspace(0.0, 2.0, 2001)
    assert plan.geometry == geometry
    assert plan.certificate.monotone
    assert np.diff(plan.law(t)).min() > -1e-15
    assert plan.certificate.tail < 1e-10
    for crossing in plan.crossings:
        law = [float(plan.law(crossing.time, order)) for order in range(3)]
        np.testing.assert_allclose(
            law, [crossing.s, crossing.speed, crossing.acceleration], rtol=1e-9, atol=1e-9
        )
        assert crossing.residual < 1e-10
        assert crossing.condition.alpha != 0


def test_a_curved_path_needs_an_acceleration_at_the_crossing(robot):
    plan = plan_crossing(robot, CURVED[0], duration=2.0)
    (crossing,) = plan.crossings
    # payload on massless legs: t_s . m (x' s" + x'' s'^2) = 0, in closed form
    first, second = (plan.path(crossing.s, order) for order in (1, 2))
    expected = -(crossing.twist @ second) * crossing.speed**2 / (crossing.twist @ first)
    assert abs(expected) > 1e-2
    assert crossing.acceleration == pytest.approx(expected, rel=1e-10)
    assert crossing.condition.alpha == pytest.approx(10.0 * crossing.twist @ first, rel=1e-10)
    assert crossing.condition.gamma == pytest.approx(0.0, abs=1e-12)  # gravity leaves the plane alone


def scaled_legs(urdf: str, factor: float) -> str:
    """The URDF with the inertia of the four rods multiplied by a factor."""
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None or link.get("name") == "left_tip":
            continue
        inertial.find("mass").set("value", repr(factor * float(inertial.find("mass").get("value"))))
        inertia = inertial.find("inertia")
        for key in list(inertia.attrib):
            inertia.set(key, repr(factor * float(inertia.get(key))))
    return ElementTree.tostring(root, encoding="unicode")


def test_a_law_of_the_users_own_is_judged_by_condition_8(robot):
    (point,) = locate_singularities(robot, LINE)
    right = Law.rest_to_rest(
        1.5, 4, [Condition(0.9, 0, point.s), Condition(0.9, 1, 1.3), Condition(0.9, 2, 0.0)]
    )
    result = inverse_dynamics(robot, LINE, right)
    assert result.certificate.tail < 1e-10
    assert [crossing.time for crossing in result.crossings] == [pytest.approx(0.9, abs=1e-12)]
    with pytest.raises(UnboundedTorque) as caught:
        inverse_dynamics(robot, LINE, Law.rest_to_rest(1.5, 4))
    assert 0 < caught.value.time < 1.5


class SineLaw:
    """Not a polynomial: s = (t - sin(2 pi t / T) T / 2 pi) / T."""

    duration = 1.2

    def __call__(self, t, order=0):
        w = 2 * np.pi / self.duration
        t = np.asarray(t, dtype=float)
        if order == 0:
            return t / self.duration - np.sin(w * t) / (w * self.duration)
        wave = -np.sin(w * t + order * np.pi / 2) * w**order / (w * self.duration)
        return wave + (1 / self.duration if order == 1 else 0.0)


def test_any_smooth_law_will_do_on_a_clear_path(robot):
    result = inverse_dynamics(robot, CLEAR, SineLaw())
    assert result.certificate.tail < 1e-10
    with pytest.raises(UnboundedTorque):
        inverse_dynamics(robot, LINE, SineLaw())


def law_of_least_degree(robot, time: float, speed: float) -> tuple[Law, float]:
    """The polynomial of degree 8 through the singular point of LINE, where s" = 0 is asked for, and its s."""
    (point,) = locate_singularities(robot, LINE)
    return Law.rest_to_rest(1.5, 2, conditions_at_instants([time], [(point.s, speed, 0.0)])), point.s


def test_a_law_that_runs_backwards_on_the_way_is_refused_and_one_of_higher_degree_found(robot):
    law, s = law_of_least_degree(robot, 1.2, 2.0)
    with pytest.raises(NoLaw, match="runs backwards at t = "):
        check_advance(law, [s])
    assert plan_crossing(robot, LINE, duration=1.5, times=[1.2], speeds=[2.0]).certificate.monotone


def test_a_speed_that_no_polynomial_found_meets_is_refused(robot):
    with pytest.raises(NoLaw, match=r"it leaves the path at s = 0.* degree 40 found"):
        plan_crossing(robot, LINE, duration=1.5, times=[1.2], speeds=[20.0], law="polynomial")


def test_points_imposed_where_nothing_is_singular_are_no_crossings(robot):
    (point,) = locate_singularities(robot, LINE)
    plan = plan_crossing(robot, LINE, duration=1.5, at=[0.3, point.s])
    assert [crossing.s for crossing in plan.crossings] == [pytest.approx(point.s, abs=1e-14)]


REFUSED = [
    (dict(duration=1.5, tolerance=np.nan), r"tolerance: must lie in \[1e-14, 1e-06\], got nan"),
    (dict(duration=1.5, times=[], speeds=[1.0]), "speeds: got 1, but times is empty"),
    (dict(duration=1.5, at=[0.6, 0.3]), "at: must ascend"),
    (dict(duration=0.0), "duration: must be a positive"),
    (dict(duration=np.nan), "duration: must be a positive"),
    (dict(duration=1.5, times=[0.0]), r"t = 0 s must lie inside the motion, \(0, 1.5\) s"),
    (dict(duration=1.5, times=[1.5]), "must lie inside the motion"),
    (dict(duration=1.5, times=[np.inf]), "times: must be finite"),
    (dict(duration=1.5, times=[0.5, 1.0]), "times: got 2 .* there is 1 singular point"),
    (dict(duration=1.5, speeds=[0.0]), "speeds: .* greater than zero, got 0"),
    (dict(duration=1.5, speeds=[1.0, 1.0]), "speeds: got 2"),
    (dict(duration=1.5, at=[1.5]), r"at: path coordinates must lie in \(0, 1\), got 1.5"),
    (dict(duration=1.5, geometry="bent"), "unknown geometry 'bent'.*valid: deformed, rigid"),
    (dict(duration=1.5, smoothness=1), "smoothness: got 1, valid: 2 .. 12"),
    (dict(duration=1.5, smoothness=2.5), "smoothness: needs a whole number"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_bad_options_get_one_clear_error(robot, options, message):
    with pytest.raises(InvalidInput, match=message):
        plan_crossing(robot, LINE, **options)


def test_times_for_a_path_without_a_crossing_are_refused(robot):
    with pytest.raises(InvalidInput, match=r"times: got 1 .* there are 0 singular points"):
        plan_crossing(robot, CLEAR, duration=1.5, times=[1.0])


def test_a_stop_on_the_locus_is_refused_with_what_gravity_leaves_of_condition_8(robot):
    heavy = ParallelRobot.from_description(replace(robot.description, gravity=(0.0, -9.81, 0.0)))
    point = locate_singularities(heavy, LINE)[0]
    with pytest.raises(NoLaw, match="no law can rest on the locus") as refused:
        plan_crossing(heavy, Line(LINE.start, point.platform), duration=1.0)
    proof = refused.value.proof
    assert proof.stop
    assert proof.s == pytest.approx(1.0, abs=1e-9)
    assert abs(proof.gamma) > 0.1  # [N] of the weight along t_s: there is nothing else at rest


def test_a_law_that_meets_the_locus_again_is_refused(robot):
    law, s = law_of_least_degree(robot, 0.15, 0.2)
    with pytest.raises(NoLaw, match="does not always advance"):
        check_advance(law, [s])


def test_an_acceleration_that_is_rounding_is_printed_without_a_sign(robot):
    plan = plan_crossing(robot, LINE, duration=1.5, times=[1.0], speeds=[1.5])
    (crossing,) = plan.crossings
    for acceleration in (-1e-12, 0.0, 1e-12):
        facts = motion_facts(replace(plan, crossings=(replace(crossing, acceleration=acceleration),)))
        assert any('s" = 0 1/s2' in fact.value for fact in facts)


def test_accelerations_at_crossings_meet_condition_8_and_their_slopes_are_differences():
    conditions = [Condition8(2.0, 0.7, -0.3, 0.4), Condition8(-1.5, 0.2, 0.9, -0.6)]
    problem, speeds = SimpleNamespace(duration=1.3, conditions=conditions), np.array([0.8, 2.1])
    values, slopes = RaisedDegree._acceleration(problem, speeds)
    v, a = speeds / 1.3, values / 1.3**2  # per second
    for (alpha, beta, gamma, delta), one_v, one_a in zip(conditions, v, a, strict=True):
        assert alpha * one_a + beta * one_v**2 + delta * one_v + gamma == pytest.approx(0.0, abs=1e-15)
    ahead, behind = (RaisedDegree._acceleration(problem, speeds + h)[0] for h in (1e-4, -1e-4))
    np.testing.assert_allclose(slopes, (ahead - behind) / 2e-4, rtol=1e-9)
