"""CPU time of whole plans. Prints, asserts nothing about time: `make bench`."""

import time

import numpy as np
import pytest

import robots
from framework import NoAnswer, plan_scene
from framework.model import FLEXIBILITIES

pytestmark = pytest.mark.benchmark
GOAL = 60.0  # ms, of every plan of the catalogue
REPEATS = 5


def milliseconds(robot, scene: str) -> float:
    """Median CPU time of the plan of a scene."""
    spent = []
    for _ in range(REPEATS):
        start = time.process_time()
        plan_scene(robot, scene)
        spent.append(time.process_time() - start)
    return 1e3 * float(np.median(spent))


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
def test_plans_of_the_catalogue(flexibility, capsys):
    rows = []
    for name in robots.CATALOGUE:
        robot = robots.load(name, flexibility=flexibility)
        for scene in robot.description.scenes:
            try:
                rows.append((milliseconds(robot, scene), f"{name} {scene}"))
            except NoAnswer:
                continue
    with capsys.disabled():
        print(f"\n  {flexibility}: median {np.median([spent for spent, _ in rows]):.1f} ms")
        for spent, scene in sorted(rows):
            print(f"  {scene:32} {spent:7.1f} ms{'  above the goal' if spent > GOAL else ''}")
    assert rows
