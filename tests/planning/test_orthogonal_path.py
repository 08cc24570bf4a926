"""Paths orthogonal to t_s where they cross: s" has no hold there, and the speed must meet condition (8)."""

from dataclasses import replace

import numpy as np
import pytest

from framework import Arc, Line, NoLaw, ParallelRobot, locate_singularities, plan_crossing, simulate
from tests.oracles.planar import without_rotors
from tests.singularity.test_points_on_path import locus

PLACE = locus(1.6)
G = np.array([0.0, -9.81])  # [m/s2]


def hanging() -> ParallelRobot:
    """The paper's robot, upright: a payload on legs without mass."""
    return ParallelRobot.from_description(replace(without_rotors().description, gravity=(*G, 0.0)))


def bent(robot: ParallelRobot, bend: float) -> tuple[Arc, np.ndarray]:
    """An arc through PLACE, orthogonal to t_s in its middle and bent that way [m], and t_s."""
    steep = np.array([0.03, 0.06])
    twist = locate_singularities(robot, Line(PLACE + steep, PLACE - steep))[0].twist
    along = 0.05 * np.array([-twist[1], twist[0]])
    return Arc(PLACE - along + bend * twist, PLACE, PLACE + along + bend * twist), twist


def speed_squared(path: Arc, twist: np.ndarray) -> float:
    """s'^2 [1/s2] of free fall along t_s: x'' s'^2 . t_s = g . t_s, for a payload on massless legs."""
    return float((G @ twist) / (path(0.5, 2) @ twist))


@pytest.mark.slow
def test_under_gravity_the_payload_crosses_in_free_fall_along_the_twist():
    robot = hanging()
    path, twist = next(
        found for found in (bent(robot, 0.02), bent(robot, -0.02)) if speed_squared(*found) > 0
    )
    plan = plan_crossing(robot, path, duration=0.6)  # upright, it falls off its path in longer ones
    crossing = min(plan.crossings, key=lambda at: abs(at.s - 0.5))
    assert plan.law.kind == "optimal"
    assert crossing.s == pytest.approx(0.5, abs=1e-9)
    assert crossing.speed**2 == pytest.approx(speed_squared(path, twist), rel=1e-9)
    assert crossing.residual < 1e-11
    assert plan.certificate.tail < 1e-9
    assert simulate(robot, plan).tracking_error < 1e-8


def test_bent_against_gravity_no_speed_holds_it():
    robot = hanging()
    path, _ = next(found for found in (bent(robot, 0.02), bent(robot, -0.02)) if speed_squared(*found) < 0)
    with pytest.raises(NoLaw, match=r"no speed meets \(both pull the same way"):
        plan_crossing(robot, path, duration=1.0, law="optimal")


def test_without_gravity_only_a_stop_would_do_on_a_bent_path():
    robot = without_rotors()
    path, _ = bent(robot, 0.02)
    with pytest.raises(NoLaw, match=r"orthogonal to t_s: condition \(8\) leaves"):
        plan_crossing(robot, path, duration=1.0, law="optimal")
