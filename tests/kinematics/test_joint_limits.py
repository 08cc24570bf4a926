"""Position limits of the URDF: said when a motion leaves them, kept on request, right in our own files."""

import numpy as np
import pytest

import robots
from framework import (
    LimitsExceeded,
    Line,
    NoAnswer,
    NoLaw,
    ParallelRobot,
    check_robot,
    plan_crossing,
    plan_scene,
    track_path,
)
from framework.kinematics.tree_model import positions_beyond_limits
from framework.planning.saved import plan_document
from framework.planning.scenes import scene_path
from tests.robots.every_robot import CASES, RIGID, SCENES, in_stages

FAR = Line([-0.2, 0.25, 0.4], [-0.2, 1.9, 0.4])  # legs of the 3-RPR beyond their 1.2 m


@pytest.fixture(scope="module")
def three_rpr():
    return robots.load("three_rpr")


def test_a_leg_longer_than_its_urdf_allows_is_said(three_rpr):
    plan = plan_crossing(three_rpr, FAR, duration=1.5)
    # leg 1 reaches from the origin to the platform's point: its end is its longest
    assert plan.exceeded["motor_1"] == f"position {np.hypot(0.2, 1.9):.6g} m of 1.2 at s = 1"
    assert set(plan.exceeded) == {"motor_1", "motor_2", "motor_3"}
    assert plan_document(plan)["exceeded"] == plan.exceeded


def test_on_request_it_is_refused(three_rpr):
    with pytest.raises(LimitsExceeded, match=r"three_rpr: .*motor_1: position .* m of 1\.2") as refusal:
        plan_crossing(three_rpr, FAR, duration=1.5, keep_limits=True)
    assert set(refusal.value.exceeded) == {"motor_1", "motor_2", "motor_3"}
    kept = plan_scene(three_rpr, "clear", keep_limits=True)
    assert kept.exceeded == {}


def test_limits_of_motors_are_kept_on_the_same_request(write_robot):
    robot = ParallelRobot.from_file(write_robot(("actuators.0.torque_limit", 1e-6)))
    with pytest.raises(NoLaw, match="times the limits"):
        plan_scene(robot, "A")
    lifted = plan_scene(robot, "A", torque_limit=np.inf)
    assert "torque" in lifted.exceeded["left_motor"]
    with pytest.raises(LimitsExceeded, match=r"left_motor: torque .* of 1e-06"):
        plan_scene(robot, "A", torque_limit=np.inf, keep_limits=True)


def test_a_passive_joint_has_limits_too(write_robot):
    def elbow_up_to(limit):
        old = '<limit lower="-6.28" upper="6.28"'
        joint = '<joint name="right_elbow" type="revolute">'
        text = robots.CATALOGUE["five_bar"].file.with_suffix(".urdf").read_text()
        block = text[text.index(joint) : text.index("</joint>", text.index(joint))]
        assert old in block
        return write_robot(urdf=((block, block.replace(old, f'<limit lower="-6.28" upper="{limit}"')),))

    robot = ParallelRobot.from_file(elbow_up_to(1.5))
    plan = plan_scene(robot, "C")
    times = np.linspace(0.0, plan.duration, 2001)
    elbow = plan.dynamics.configuration(times)[:, 3]
    s = plan.law(times[np.argmax(elbow)])
    assert plan.exceeded == {"right_elbow": f"position {elbow.max():.6g} rad of 1.5 at s = {s:.4g}"}
    assert any("right_elbow: position" in advice for advice in check_robot(robot).advice)


LIMITS = {
    "left out": ("", None),
    "the same": ('lower="0" upper="0"', None),
    "one left out is 0": ('upper="2"', (0.0, 2.0)),
    "both": ('lower="-1" upper="2"', (-1.0, 2.0)),
}


@pytest.mark.parametrize(("said", "meant"), LIMITS.values(), ids=LIMITS)
def test_what_a_urdf_says_of_limits(write_robot, said, meant):
    robot = ParallelRobot.from_file(write_robot(urdf=(('lower="-6.28" upper="6.28"', said),)))
    found = {limit.joint: (limit.lower, limit.upper) for limit in robot.limits}
    assert found.get("left_motor") == meant
    assert len(found) == (3 if meant is None else 4)


def test_rounding_at_a_limit_is_no_excess(three_rpr):
    q = np.tile(three_rpr.q_near, (3, 1))
    slide = next(limit for limit in three_rpr.limits if limit.joint == "motor_2")
    q[:, slide.coordinate] = [0.0, -1e-16, 1.2 + 2e-16]
    assert positions_beyond_limits(three_rpr.limits, q) == {}
    q[:, slide.coordinate] = [0.5, -0.1, 1.25]
    assert positions_beyond_limits(three_rpr.limits, q) == {
        "motor_2": "position -0.1 m of 0 and 1.25 m of 1.2"
    }


@pytest.mark.parametrize(("name", "scene"), SCENES)
def test_our_own_scenes_keep_the_limits_of_our_own_files(name, scene):
    """Not within rounding but with a ten-thousandth to spare, which springs need."""
    robot = RIGID[name]
    branch = track_path(robot, scene_path(robot.description.scenes[scene]))
    q = branch.guess(np.linspace(0.0, 1.0, 201))
    for joint, coordinate, _, lower, upper, _ in robot.limits:
        margin = 1e-4 * (upper - lower)
        assert lower + margin < q[:, coordinate].min(), joint
        assert q[:, coordinate].max() < upper - margin, joint


@pytest.mark.parametrize("case", in_stages(CASES))
def test_our_own_plans_keep_them_with_springs_as_well(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    for scene in robot.description.scenes:
        try:
            plan = plan_scene(robot, scene)
        except NoAnswer:
            continue
        assert {joint: said for joint, said in plan.exceeded.items() if "position" in said} == {}
