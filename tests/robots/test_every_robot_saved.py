"""A plan that is saved and read back is the plan that was saved, field by field."""

import json
from dataclasses import asdict, fields

import numpy as np
import pytest

import robots
from framework import CrossingPlan, InvalidInput, NoAnswer, load_plan, plan_scene
from framework.model.description import FLEXIBILITIES
from framework.planning.result import Crossing
from framework.planning.saved import plan_document, save_plan
from tests.robots.every_robot import RIGID, SCENES, in_stages

LAWS = {"as the scene says": {}, "optimal": {"law": "optimal"}}


def kinds(name: str, scene: str) -> list[tuple[str, str]]:
    """Flexibilities in which the robot differs, with laws: all but the slow ones in its first scene."""
    description = RIGID[name].description
    differing = [one for one in FLEXIBILITIES if description.least_flexibility(one) == one]
    if scene != next(iter(description.scenes)):
        return [("rigid", "as the scene says")]
    return [*((flexibility, "as the scene says") for flexibility in differing), ("rigid", "optimal")]


PAPER = [
    ("five_bar", "C", "rigid", "optimal"),
    *(("five_bar", "C", flexibility, "as the scene says") for flexibility in FLEXIBILITIES),
]
CASES = list(
    dict.fromkeys([(robot, scene, *kind) for robot, scene in SCENES for kind in kinds(robot, scene)] + PAPER)
)
# Deflections of a deformed robot start from another guess when they are computed anew; torques contain their
# second derivatives, in which the rounding of the end nodes grows: 2.4e-7 of the peak on gough_stewart.
EXACT, DEFORMED, DEFORMED_TORQUE = 1e-12, 1e-8, 1e-6


def at_once(case) -> bool:
    """A polynomial and an optimal law, rigid, and the scene of the paper on its springs."""
    robot, scene, flexibility, law = case
    return (robot, scene) == ("five_bar", "C") and (law != "optimal" or flexibility == "rigid")


@pytest.mark.slow
@pytest.mark.parametrize("case", in_stages(CASES, at_once=at_once))
def test_a_plan_comes_back_as_it_was(case, tmp_path):
    name, scene, flexibility, law = case
    robot = robots.load(name, flexibility=flexibility)
    try:
        plan = plan_scene(robot, scene, **LAWS[law])
    except NoAnswer:  # nothing to save, and nothing to load
        with pytest.raises(InvalidInput):
            load_plan(tmp_path)
        return
    save_plan(plan, tmp_path)
    assert_same(load_plan(tmp_path), plan)


def assert_same(again: CrossingPlan, plan: CrossingPlan) -> None:
    """Assert that a plan read back is the one that was saved."""
    share = DEFORMED if plan.geometry == "deformed" else EXACT
    assert {field.name for field in fields(plan)} == {
        *("robot", "request", "law", "crossings", "dynamics", "certificate", "seconds", "reason"),
        "optimality",
    }
    assert again.robot.description == plan.robot.description
    assert again.robot.flexibility == plan.robot.flexibility
    assert (again.request, again.seconds, again.reason) == (plan.request, plan.seconds, plan.reason)
    assert type(again.law) is type(plan.law)
    assert again.law.to_dict() == plan.law.to_dict()
    assert len(again.crossings) == len(plan.crossings)
    for one, other in zip(again.crossings, plan.crossings, strict=True):
        assert_same_crossing(one, other, share, plan)
    t = np.linspace(0.0, plan.duration, 301)
    np.testing.assert_array_equal(again.platform(t), plan.platform(t))
    allowed = (DEFORMED_TORQUE if plan.geometry == "deformed" else EXACT) * max(plan.peak_torque.values())
    np.testing.assert_allclose(again.torque(t), plan.torque(t), rtol=0, atol=allowed)
    np.testing.assert_allclose(again.motor_angle(t), plan.motor_angle(t), rtol=share, atol=share)
    size = np.abs(plan.deflection(t)).max(initial=0.0)
    np.testing.assert_allclose(again.deflection(t), plan.deflection(t), rtol=0, atol=share * size)
    assert again.exceeded.keys() == plan.exceeded.keys()
    certificate = again.certificate
    assert certificate.monotone == plan.certificate.monotone
    assert certificate.tail <= plan.request.tolerance
    if plan.geometry == "rigid":
        assert (certificate.nodes, certificate.passes) == (plan.certificate.nodes, plan.certificate.passes)
    assert (again.optimality is None) == (plan.optimality is None)
    if again.optimality is not None:
        np.testing.assert_array_equal(again.optimality.reference, plan.optimality.reference)
        one, other = asdict(again.optimality.specification), asdict(plan.optimality.specification)
        for key in one:
            np.testing.assert_array_equal(one[key], other[key])
    # what is saved once more is what was saved, but for the numbers that are computed anew
    one, other = (json.loads(json.dumps(plan_document(each))) for each in (again, plan))
    for key in set(one) - {"crossings", "peak_torque", "certificate", "exceeded", "motor_use", "neglected"}:
        assert one[key] == other[key], key
    for use, same in zip(one["motor_use"], other["motor_use"], strict=True):
        assert (use["joint"], use["limit"], use["allowed"]) == (same["joint"], same["limit"], same["allowed"])
        assert use["ratio"] == pytest.approx(same["ratio"], rel=DEFORMED_TORQUE)
    assert len(one["neglected"]) == len(other["neglected"])
    for effect, same in zip(one["neglected"], other["neglected"], strict=True):
        assert (effect["effect"], effect["motor"]) == (same["effect"], same["motor"])
        assert effect["torque"] == pytest.approx(same["torque"], rel=1e-6)


def assert_same_crossing(one: Crossing, other: Crossing, share: float, plan: CrossingPlan) -> None:
    """Assert that two crossings are the same, `share` of the size of their numbers apart at most."""
    assert (one.kind, one.time, one.speed, one.acceleration) == (
        *(other.kind, other.time, other.speed),
        other.acceleration,
    )
    np.testing.assert_allclose(one.s, other.s, rtol=0, atol=share)
    np.testing.assert_allclose(one.twist, other.twist, rtol=0, atol=10 * share)
    np.testing.assert_allclose(one.platform, other.platform, rtol=0, atol=share * plan.robot.length)
    assert one.residual < 1e-11
    assert (one.condition is None) == (other.condition is None)
    if one.condition is not None:
        size = max(map(abs, other.condition))
        np.testing.assert_allclose(one.condition, other.condition, rtol=0, atol=10 * share * size)
