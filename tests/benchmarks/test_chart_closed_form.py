"""The references of the chart, against the five-bar solved by power series, and against what it must obey."""

from decimal import Decimal

import numpy as np
import pytest

import robots
from framework import plan_scene
from tests.benchmarks.chart import closed_form, elastic_form
from tests.oracles import five_bar as oracle

TIMES = np.array([0.1, 0.5, 0.9, 1.0, 1.0 + 1e-9, 1.2, 1.45])


def test_rigid_torques_are_those_of_the_power_series():
    expected = oracle.torques(oracle.solve("C", "rigid", "rigid"), TIMES)
    np.testing.assert_allclose(closed_form.motion().torque(TIMES), expected, rtol=1e-14, atol=1e-17)


def test_the_singular_point():
    assert abs(oracle.mp.mpf(str(closed_form.singular_s())) - oracle.locus_position()) < 1e-45


def test_with_heavy_links_condition_8_bounds_the_torque():
    """And the planner, which shares nothing with it, finds the same torques."""
    motion = closed_form.motion(1.0)
    near = motion.torque([1.0 - 1e-12, 1.0, 1.0 + 1e-12])
    assert np.ptp(near, axis=0).max() < 1e-9
    plan = plan_scene(robots.load("five_bar_heavy"), "C")
    assert plan.crossings[0].acceleration == pytest.approx(float(motion.law(closed_form.CROSSING_TIME, 2)))
    np.testing.assert_allclose(plan.torque(TIMES), motion.torque(TIMES), atol=1e-12)


def test_beside_the_point_there_is_a_pole():
    motion = closed_form.motion(offset=1e-6)
    s_c = closed_form.singular_s()
    when = Decimal(1) - Decimal("1e-6") / closed_form.CROSSING_SPEED  # to first order
    for _ in range(5):
        when -= (motion.law(when) - s_c) / motion.law(when, 1)
    near = [float(when + Decimal(d)) for d in ("1e-9", "1e-10")]
    close, closer = np.abs(motion.torque(near)).max(axis=1)
    assert closer / close == pytest.approx(10, rel=1e-2)


def test_deflections_are_those_of_the_power_series():
    times = np.array([0.1, 0.9, 0.999, 1.001, 1.3])
    solved = oracle.solve("C", "flexible_links", "deformed")
    expected = oracle.deflections(solved, times)[:, 2:]
    found = elastic_form.elastic_motion(1.0)
    assert abs(oracle.mp.mpf(str(found.motion.s_c)) - solved.s_c) < 1e-16
    np.testing.assert_allclose(found.rods(times), expected, atol=1e-16)
