"""How long whole calls of `plan_crossing` with the optimal law take, beside the polynomial's. Prints, asserts
nothing about time: `make bench`.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

import robots
from framework.crossing.plan import plan_crossing
from framework.crossing.scenes import scene_path

pytestmark = pytest.mark.benchmark
REPEATS = 5
SCENES = [("five_bar", "C", "rigid"), ("five_bar", "C", "flexible_links"), ("gough_stewart", "turn", "rigid")]


def seconds(robot, path, duration: float, law: str) -> float:
    """Median processor time of one call, after a first one that fills the robot's caches."""
    spent = []
    for _ in range(1 + REPEATS):
        start = time.process_time()
        plan = plan_crossing(robot, path, duration=duration, law=law)
        spent.append(time.process_time() - start)
        assert plan.law.kind == law
        assert plan.certificate.monotone
    return float(np.median(spent[1:]))


@pytest.mark.parametrize(("name", "scene", "flexibility"), SCENES)
def test_an_optimal_law_beside_a_polynomial(name, scene, flexibility, capsys):
    robot = robots.load(name, flexibility=flexibility)
    asked = robot.description.scenes[scene]
    optimal, polynomial = (
        seconds(robot, scene_path(asked), asked.duration, law) for law in ("optimal", "polynomial")
    )
    with capsys.disabled():
        print(
            f"\n  {name} {scene}, {flexibility}: optimal law {1e3 * optimal:6.0f} ms, polynomial "
            f"{1e3 * polynomial:6.0f} ms, ratio {optimal / polynomial:.1f}"
        )
