"""A path through dozens of singular points.

What goes wrong: a platform that keeps turning meets the locus several times a turn. One law through n of them
has degree 5 + 3 n; times and speeds that make it advance are searched for in 2 n dimensions, each trial
costs n^3, and a search that is bounded by the number of unknowns takes minutes to find nothing.
Why: one polynomial with three conditions at each of many points swings between them.
What we do: the number of trials is bounded, whatever the number of unknowns, and through more than eight
points no law is searched for at all. Cut the path instead.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import (
    Condition,
    Law,
    Line,
    NoLaw,
    ParallelRobot,
    assemble,
    inverse_dynamics,
    locate_singularities,
    plan_crossing,
)
from framework.planning import polynomial
from framework.planning.polynomial import LAWS_PER_UNKNOWN, MAX_CROSSINGS, MAX_ROUNDS, choose_timing
from framework.planning.request import Request
from tests.oracles.massless_legs import crossings

OPEN = Request(path=Line([0.0], [1.0]), duration=1.0)
COUNTS = (1, 2, 4, 8, 16, 32)


@cache
def massless_legs(name: str) -> ParallelRobot:
    """A robot of the catalogue of which only the platform has mass."""
    description = robots.load(name).description
    root = ElementTree.fromstring(description.urdf_text)
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is not None and link.get("name") != "platform":
            link.remove(inertial)
    text = ElementTree.tostring(root, encoding="unicode")
    return ParallelRobot.from_description(replace(description, urdf_text=text))


def trials(count: int, monkeypatch: pytest.MonkeyPatch) -> int:
    """How many laws our search tries before it gives up on points that no law can pass in good order."""
    tried = 0

    def measure(_duration, _smoothness, times, values, _ends):
        nonlocal tried
        tried += len(times)
        return -1.0 - values[:, :, 1].sum(axis=1), np.ones(len(times))  # runs backwards, whatever is asked

    monkeypatch.setattr(polynomial, "speed_ratios_and_peaks", measure)
    s = np.arange(1, count + 1) / (count + 1)
    points = [SimpleNamespace(s=place, acceleration_at=np.zeros_like) for place in s]
    with pytest.raises(NoLaw):
        choose_timing(points, OPEN)
    return tried


@pytest.mark.parametrize("count", COUNTS)
def test_the_search_is_bounded(count, monkeypatch):
    starts = len(polynomial._first_timings([0.5], OPEN))
    most = starts + 1 + MAX_ROUNDS * LAWS_PER_UNKNOWN * 2 * count
    assert trials(count, monkeypatch) <= (starts if count > MAX_CROSSINGS else most)


def test_a_platform_that_keeps_turning_is_told_to_cut_its_path():
    robot = robots.load("three_rpr")
    start = assemble(robot).x
    path = Line(start, start + np.array([0.0, 0.0, 6 * np.pi]))
    found = locate_singularities(robot, path)
    assert len(found) > MAX_CROSSINGS
    with pytest.raises(NoLaw, match=f"meets {len(found)} singular points.*cut the path, take law optimal"):
        plan_crossing(robot, path, duration=10.0, law="polynomial")


@pytest.mark.slow
def test_the_optimal_law_passes_all_points_of_a_platform_that_keeps_turning():
    """Condition (8) at each, with Newton's and Euler's equations of a platform on legs without mass."""
    robot = massless_legs("three_rpr")
    start = assemble(robot).x
    path = Line(start, start + np.array([0.0, 0.0, 6 * np.pi]))
    plan = plan_crossing(robot, path, duration=10.0)
    assert plan.law.kind == "optimal"
    assert plan.duration == 10.0
    assert len(plan.crossings) == len(locate_singularities(robot, path)) > MAX_CROSSINGS
    assert max(crossing.residual for crossing in plan.crossings) < 1e-11
    body = max(robot.model.inertias, key=lambda inertia: inertia.mass)
    times = np.array([crossing.time for crossing in plan.crossings])
    turn, rate, acceleration = (plan.platform(times, order)[:, 2] for order in range(3))
    (x, y), cosine, sine = body.lever[:2], np.cos(turn), np.sin(turn)
    lever = np.array([cosine * x - sine * y, sine * x + cosine * y])
    force = body.mass * (acceleration * np.array([-lever[1], lever[0]]) - rate**2 * lever)
    moment = body.inertia[2, 2] * acceleration + lever[0] * force[1] - lever[1] * force[0]
    wrench = np.vstack([force, moment]).T
    twists = np.array([crossing.twist for crossing in plan.crossings])
    np.testing.assert_allclose(np.sum(wrench * twists, axis=1), 0, atol=1e-9 * np.abs(wrench).max())
    assert np.all(np.diff(plan.law(np.linspace(0.0, 10.0, 2001))) > 0)


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("delta", 1),
        ("three_rpr", 2),
        pytest.param("gough_stewart", 1, marks=pytest.mark.slow),
        pytest.param("three_rpr", 6, marks=pytest.mark.slow),
    ],
)
def test_a_law_through_singular_points_has_the_torques_of_virtual_work(name, count):
    """In forty digits, also as near to the singular instants as 1 us."""
    tolerance, exact = 1e-10, crossings(name, count)
    conditions = [
        Condition(float(t), order, float(value))
        for t, values in exact.conditions
        for order, value in enumerate(values)
    ]
    law = Law.rest_to_rest(float(exact.duration), 2, conditions)
    path = Line(*([float(c) for c in end] for end in exact.ends))
    torque = inverse_dynamics(massless_legs(name), path, law, tolerance=tolerance).torque
    near = [float(t) + side * 10.0**-k for t, _ in exact.conditions for k in range(1, 7) for side in (-1, 1)]
    times = np.concatenate([np.linspace(0.0, law.duration, 24), near])
    expected = exact.torque(times)
    np.testing.assert_allclose(torque(times), expected, rtol=0, atol=tolerance * np.abs(expected).max())
