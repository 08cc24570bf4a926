"""Overconstrained loops of rounded dimensions: planned with the gap said, refused where it is no rounding."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Line, Mechanism, NotAssembled, ParallelRobot, check_robot, plan_crossing


def five_bar(raised: float = 0.0) -> Mechanism:
    """The planar 5R, one of its tips raised out of the plane [m]: then no pose closes its loop."""
    description = robots.load("five_bar").description
    tip = '<child link="right_tip"/>'
    before, after = description.urdf_text.split(tip)
    after = after.replace('xyz="0.25 0 0"', f'xyz="0.25 0 {raised!r}"', 1)
    return Mechanism.from_description(replace(description, urdf_text=f"{before}{tip}{after}"))


def test_a_rounded_loop_is_planned_and_its_gap_said():
    path = Line([0.1, 0.345], [-0.05, 0.195])
    asked = {"duration": 1.5, "times": [1.0], "speeds": [1.5]}
    exact = plan_crossing(ParallelRobot.of(five_bar()), path, **asked)
    robot = ParallelRobot.of(five_bar(3.8e-7))
    plan = plan_crossing(robot, path, **asked)
    assert robot.rounded.names == ("tip.z",)
    assert exact.certificate.rounded_gap == 0.0
    assert plan.certificate.rounded_gap == pytest.approx(3.8e-7, rel=1e-6)
    assert plan.certificate.max_closure_error < 1e-12
    instants = np.linspace(0.0, 1.5, 31)
    np.testing.assert_allclose(plan.torque(instants), exact.torque(instants), atol=1e-9)
    assert "rounded and overconstrained by 3.8e-07 m" in "; ".join(check_robot(five_bar(3.8e-7)).advice)


def test_a_gap_that_is_no_rounding_is_refused():
    with pytest.raises(NotAssembled, match=r"tip\.z stays 0\.003 m apart"):
        ParallelRobot.of(five_bar(3e-3))
