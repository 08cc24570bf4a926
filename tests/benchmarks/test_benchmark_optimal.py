"""How long whole calls of `plan_crossing` with the optimal law take, beside the polynomial's: `make bench`.

Prints the times; asserts what an optimum is, not how fast it is found.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

import robots
from framework import plan_crossing
from framework.planning.scenes import scene_path

pytestmark = pytest.mark.benchmark
REPEATS = 5
SCENES = [("five_bar", "C", "rigid"), ("five_bar", "C", "flexible_links"), ("gough_stewart", "turn", "rigid")]


def measured(robot, path, duration: float, law: str):
    """Median processor time of one call, after a first one that fills the robot's caches, and its plan."""
    spent, plan = [], None
    for _ in range(1 + REPEATS):
        start = time.process_time()
        plan = plan_crossing(robot, path, duration=duration, law=law)
        spent.append(time.process_time() - start)
        assert plan.law.kind == law
        assert plan.certificate.monotone
    return float(np.median(spent[1:])), plan


@pytest.mark.parametrize(("name", "scene", "flexibility"), SCENES)
def test_an_optimal_law_beside_a_polynomial(name, scene, flexibility, capsys):
    robot = robots.load(name, flexibility=flexibility)
    asked = robot.description.scenes[scene]
    (optimal, best), (polynomial, other) = (
        measured(robot, scene_path(asked), asked.duration, law) for law in ("optimal", "polynomial")
    )
    assert [best.duration, other.duration] == pytest.approx([asked.duration] * 2, rel=1e-9)
    # of all laws of this duration the optimal one has the least peak over all motors
    assert max(best.peak_torque.values()) < max(other.peak_torque.values())
    with capsys.disabled():
        print(
            f"\n  {name} {scene}, {flexibility}: optimal law {1e3 * optimal:6.0f} ms, polynomial "
            f"{1e3 * polynomial:6.0f} ms, ratio {optimal / polynomial:.1f}"
        )
