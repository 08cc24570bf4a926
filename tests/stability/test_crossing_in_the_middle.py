"""A path that meets the locus in its very middle, to the last digit.

What goes wrong: the law is resolved on panels, cut in halves where it must be; two of them meet in the middle
of the path. An end of a panel is a node, and a node on the singular instant divides 0 by 0.
Why: symmetric paths are what people draw first.
What we do: panels of a smooth law end beside the crossing.
"""

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing, simulate

TOP = np.array([0.0, np.sqrt(0.06)])  # of the 5R's locus


@pytest.mark.parametrize("half", [(0.0, 0.1), pytest.param((0.02, 0.08), marks=pytest.mark.slow)])
def test_the_optimal_law_crosses_there_too(half):
    robot = robots.load("five_bar")
    plan = plan_crossing(robot, Line(TOP + half, TOP - half), duration=1.5, law="optimal")
    assert plan.crossings[0].s == pytest.approx(0.5, abs=1e-12)
    assert plan.certificate.tail < 1e-10
    assert simulate(robot, plan).tracking_error < 1e-9
