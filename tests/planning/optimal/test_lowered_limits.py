"""Limits that one law's motion lowers bind no other law of the search."""

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing
from framework.errors import NotConverged
from framework.planning.optimal import elastic_search

OPTIONS = {"geometry": "rigid", "optimize": "time", "torque_limit": 0.4}


def plan():
    """Plan the path of the paper with springs in the gears."""
    robot = robots.load("five_bar", flexibility="flexible_joints")
    return plan_crossing(robot, Line([0.1, 0.345], [-0.05, 0.195]), **OPTIONS)


@pytest.mark.slow
def test_a_rough_motion_does_not_lower_the_limits_of_later_laws(monkeypatch):
    """A spike of torque that rounding lets through costs hardly more than the shares of smoother laws."""
    smooth = plan()
    true_excess, calls = elastic_search.limit_excess, []

    def excess(dynamics, specification):
        calls.append(dynamics)
        return 135.0 if len(calls) == 1 else true_excess(dynamics, specification)

    monkeypatch.setattr(elastic_search, "limit_excess", excess)
    rough = plan()
    assert len(calls) > 1
    np.testing.assert_allclose(rough.duration, smooth.duration, rtol=3e-2)


@pytest.mark.slow
def test_refusal_says_by_how_much_the_nearest_motion_exceeds_the_limits(monkeypatch):
    """Without a proof the refusal names neither a holding torque nor a remedy."""
    monkeypatch.setattr(elastic_search, "limit_excess", lambda *_: 135.0)
    with pytest.raises(NotConverged, match=r"no law was found .* takes 135 times the limits") as refusal:
        plan()
    assert "would do" not in str(refusal.value)
    assert "at rest" not in str(refusal.value)
