"""Several uncontrolled motions at once: the flat pose of the Gough-Stewart platform.

What goes wrong: with the platform in the plane of the base all six legs lie in one plane and resist no
vertical force and no tilting moment: three null vectors at once. The determinant changes its sign there like
at any crossing, and the last singular vector of A is one of three at random. A condition (8) for that one
leaves forces and moments along the others, and the torques a pole.
Why: a law s(t) has one acceleration and one speed to give, and there are three wrenches to balance.
What we do: count the vanishing singular values, ask the condition (8) of each motion, and refuse if they
contradict each other. Where they agree the robot passes: straight down it falls freely through its base.
Beside the flat pose there are three crossings, each of its own, and each is found.
"""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import (
    Line,
    NoLaw,
    UnboundedTorque,
    UncontrolledMotions,
    locate_singularities,
    plan_crossing,
    simulate,
)
from framework.planning.optimal import optimal_task
from tests.robots.test_gough_stewart import gradient, kinetic_energy, plucker, potential_energy

START = np.array([0.1, 0.05, 1.0, 0.2, 0.1, 0.0])  # and to the opposite pose, through the flat one


def test_we_count_them_and_refuse_what_they_cannot_have_together():
    robot, path = robots.load("gough_stewart"), Line(START, -START)
    (point,) = locate_singularities(robot, path)
    assert point.corank == 3
    assert point.s == pytest.approx(0.5, abs=1e-10)
    with pytest.raises(UncontrolledMotions, match=r"3 uncontrolled motions at once at s = 0\.5") as refusal:
        plan_crossing(robot, path, duration=1.0)
    assert refusal.value.count == 3
    with pytest.raises(NoLaw, match=r"3 motions are uncontrolled at once.* the optimal law each"):
        plan_crossing(robot, path, duration=1.0, law="polynomial")


@pytest.mark.parametrize(("z", "second", "meets"), [(2.0, 0.0, True), (-2.0, 0.0, False), (2.0, 0.1, False)])
def test_two_conditions_at_once_determine_the_speed(monkeypatch, z, second, meets):
    """Two rows, and one that repeats the first but for `second`, of z = s'^2 and u = s" that are chosen."""
    slopes = np.array([[1.0, 2.0], [3.0, -1.0], [2.0, 4.0]])
    constant = -slopes @ [z, 0.7] + [0.0, 0.0, second]
    rows = np.column_stack([constant, slopes, np.zeros(3)])
    monkeypatch.setattr(optimal_task, "crossing_rows", lambda branch, phi, point: rows[[0, 1 + bool(second)]])
    branch = SimpleNamespace(path=Line(START, -START))
    point = SimpleNamespace(s=0.5, corank=2)
    task = SimpleNamespace(robot=robots.load("gough_stewart"), branch=branch, phi=None, targets=[point])
    with nullcontext() if meets else pytest.raises(UncontrolledMotions, match="two uncontrolled motions"):
        optimal_task.check_speeds(task)


@pytest.mark.parametrize("options", [dict(times=[]), dict(at=[0.5])])
def test_no_condition_or_a_single_one_leaves_a_pole(options):
    with pytest.raises(UnboundedTorque, match=r"s = 0\.5"):
        plan_crossing(robots.load("gough_stewart"), Line(START, -START), duration=1.0, **options)


@pytest.mark.slow
def test_it_falls_through_its_base():
    """The three forces of a level platform agree: it has to fall as its weight alone would make it.

    In 1.2 s: nothing controls three of its motions, and what rounding puts into them grows with the time of
    the fall (in 2 s to 3e-6 or 4e-6 m, as the processor rounds).
    """
    robot, top = robots.load("gough_stewart"), np.array([0.0, 0.0, 0.6, 0.0, 0.0, 0.1])
    plan = plan_crossing(robot, Line(top, -top), duration=1.2)
    (crossing,) = plan.crossings
    assert plan.law.kind == "optimal"
    level, down = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e-9]), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    falling = -gradient(potential_energy, level)[2] / (2 * kinetic_energy(level, down).real)  # Lagrange
    assert plan.platform(crossing.time, 2)[2] == pytest.approx(falling, rel=1e-6)
    assert simulate(robot, plan).tracking_error < 1e-6


@pytest.mark.parametrize("aside", [0.1, 0.01])
def test_beside_the_flat_pose_there_are_three_crossings(aside):
    end = -START + aside * np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    points = locate_singularities(robots.load("gough_stewart"), Line(START, end))
    for point in points:
        values = np.linalg.svd(plucker(point.platform), compute_uv=False)
        assert values[-1] < 1e-12
        assert point.corank == 1
    signs = [np.linalg.slogdet(plucker(x)).sign for x in Line(START, end)(np.linspace(0.0, 1.0, 2000))]
    assert len(points) == np.count_nonzero(np.diff(signs))
