"""Deflections that hold the forces they cause, where plain passes do not find them.

The witness is the simulation, which takes nothing from the planner but torques and law: it brings the robot
along its path, or the torques are not those of the robot's deflections.
"""

import re

import pytest

import robots
from framework import Line, NotConverged, plan_crossing, plan_scene
from framework.dynamics import elasticity


@pytest.mark.slow
def test_a_tolerance_that_is_said_to_do_does():
    robot, scene = robots.load("five_bar", flexibility="flexible_links"), "C"
    with pytest.raises(NotConverged, match="would do") as caught:
        plan_scene(robot, scene, tolerance=1e-14)
    enough = float(re.search(r"tolerance (\S+) would do", str(caught.value)).group(1))
    assert caught.value.remedy == {"tolerance": enough}
    assert 1e-14 < enough < 1e-10
    certificate = plan_scene(robot, scene, tolerance=enough).certificate
    assert max(certificate.tail, certificate.change) <= enough


@pytest.mark.slow
def test_the_last_change_is_part_of_the_verdict(monkeypatch):
    """Deflections that are off refuse a plan, however smooth its torques."""
    robot = robots.load("five_bar", flexibility="flexible_links")

    def unsettle(honest):
        """Spoil the change of all solutions."""
        return lambda *arguments, **options: elasticity.replace(honest(*arguments, **options), change=5.5e-8)

    for name in ("solve_deflections", "assess_deflections"):
        spoiled = unsettle(getattr(elasticity, name))
        monkeypatch.setattr(f"framework.dynamics.inverse_dynamics.{name}", spoiled)
    with pytest.raises(NotConverged, match=r"one more pass would change them by 5\.5e-08"):
        plan_scene(robot, "C")


def hurried(duration: float) -> str:
    """What is said of scene C of the 5R in this time."""
    robot, path = robots.load("five_bar", flexibility="flexible_links"), Line([0.1, 0.345], [-0.05, 0.195])
    at_crossing = {"times": [0.6 * duration], "speeds": [1.2 / duration]}
    with pytest.raises(NotConverged) as caught:
        plan_crossing(robot, path, law="polynomial", duration=duration, **at_crossing)
    return str(caught.value)


@pytest.mark.slow
def test_too_soft_is_said_only_with_the_deflection_that_proves_it():
    angle = float(re.search(r"too soft .* would deflect left_drive by (\S+) rad", hurried(0.02)).group(1))
    assert angle > 1.0  # beyond what a linear spring means
    assert "too soft" not in hurried(0.05)
