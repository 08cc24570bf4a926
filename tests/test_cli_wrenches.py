"""Wrenches on the command line: --wrench along the platform's axes, --wrench-on a frame."""

import html

import numpy as np
import pytest

import robots
from framework import assemble, dynamics_at, plan_scene
from framework.planning.optimal.peak_bound import bound_plan
from framework.show.report import given_options, report_page

ROBOT = "five_bar"


@pytest.mark.slow
def test_plan_and_locate_count_the_wrench_that_is_typed(robot, document):
    plan = plan_scene(robot, "C", law="optimal", wrenches={"left_tip": [3.0, -4.0, 0, 0, 0, 0]})
    for typed in (["--wrench", "3", "-4"], ["--wrench-on", "left_tip", "3", "-4", "0", "0", "0", "0"]):
        told = document("plan", "five_bar", "--scene", "C", "--law", "optimal", *typed)
        assert told["peak_torque"] == pytest.approx(plan.peak_torque, rel=1e-9)
        assert told["request"]["wrenches"] == plan.request.wrenches
        place = document("locate", "five_bar", "--scene", "C", *typed)["singularities"][0]
        assert place["condition"]["gamma"] == pytest.approx(plan.crossings[0].condition.gamma, rel=1e-9)


@pytest.mark.slow
def test_a_folder_is_simulated_under_its_own_wrench_and_takes_no_other(refusal, document, tmp_path):
    words = ["plan", "five_bar", "--scene", "C", "--law", "optimal", "--wrench", "3", "-4"]
    document(*words, "--out", str(tmp_path / "out"))
    run = document("simulate", str(tmp_path / "out"))
    assert run["tracking_error"] < 1e-9
    assert "--wrench: the plan in" in refusal(2, "simulate", tmp_path / "out", "--wrench", "1", "1")


def test_pose_tells_torques_loops_and_reactions_of_an_instant(robot, document, crossing):
    instant = dynamics_at(
        robot,
        assemble(robot, [0.05, 0.3]),
        dx=[0.1, 0.2],
        ddx=[1.0, 2.0],
        wrenches={"left_tip": [3.0, 4.0, 0, 0, 0, 0]},
    )
    words = ["pose", "five_bar", "--platform", "0.05", "0.3", "--velocity", "0.1", "0.2"]
    words += ["--acceleration", "1", "2", "--wrench", "3", "4"]
    loads = document(*words)["dynamics"]
    torques = dict(zip(robot.actuator_names, instant.torque, strict=True))
    assert loads["torque"] == pytest.approx(torques, rel=1e-12)
    np.testing.assert_allclose(
        np.array(loads["loop_forces"]["tip"], dtype=float), instant.loop_forces["tip"], atol=1e-9
    )
    assert set(loads["reactions"]) == set(instant.reactions)
    assert loads["indeterminate"] == list(instant.indeterminate)
    text = crossing(*words)[1]
    assert f"motor torque      left_motor {torques['left_motor']:.9g} N m" in text
    assert "dynamics" not in document("pose", "five_bar", "--platform", "0.05", "0.3")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["plan", "five_bar", "--scene", "C", "--wrench", "1"], "wrench (x, y) must be 2 finite numbers"),
        (["plan", "five_bar", "--scene", "C", "--wrench", "1", "nan"], "must be 2 finite numbers"),
        (["plan", "five_bar", "--scene", "C", "--wrench-on", "tip", *"123456"], "unknown frame 'tip'"),
        (["plan", "five_bar", "--scene", "C", "--wrench-on", "left_tip", *"12345x"], "needs 6 numbers"),
        (
            ["plan", "five_bar", "--scene", "C", "--wrench", "1", "2", "--wrench-on", "left_tip", *"123456"],
            "left_tip has two wrenches",
        ),
        (
            ["export", "five_bar", "--scene", "C", "--to", "lesson", "--out", "a.html", "--wrench", "1", "2"],
            "--wrench: of ros2_control, csv, controller only, not of lesson",
        ),
        (["pose", "humanoid_ankle", "--platform", "0", "0", "--wrench", "1", "2"], "move with it"),
        (["pose", "five_bar", "--platform", "0", "0.3", "--all", "--wrench", "1", "2"], "lists poses alone"),
        (["pose", "five_bar", "--platform", "0", "0.3", "--velocity", "1"], "must be 2 finite numbers"),
    ],
)
def test_what_is_no_wrench_or_has_no_place_is_refused(refusal, words, complaint):
    assert complaint in refusal(2, *words)


def test_the_call_that_makes_a_plan_again_has_its_wrenches(robot):
    plan = plan_scene(robot, "A", wrenches={"left_tip": [0.0, 1.0, 0, 0, 0, 0.5]})
    assert given_options(plan)["wrenches"] == {"left_tip": [0.0, 1.0, 0, 0, 0, 0.5]}
    turning = {"left_tip": {"wrench": [0, 1, 0, 0, 0, 0], "axes": "tool"}}
    assert given_options(plan_scene(robot, "A", wrenches=turning))["wrenches"] == turning


def test_bounds_of_all_laws_count_the_wrenches(robot):
    """A push that the motors hold at rest is part of what every law needs."""
    plan = plan_scene(robot, "C", law="optimal", wrenches={"left_tip": [6.0, 0, 0, 0, 0, 0]})
    bound, peak = bound_plan(plan).value, max(plan.peak_torque.values())
    assert 0.98 * peak < bound * max(plan.optimality.reference) < peak


@pytest.mark.slow
def test_the_report_lists_the_wrenches():
    table = [[0.0, 3, 0, 4, 0, 0, 0], [1.0] + [0] * 6]
    wrenches = {"left_tip": [0.0, 1, 0, 0, 0, 0.5], "right_crank": table}
    page = html.unescape(report_page(plan_scene(robots.load("five_bar"), "A", wrenches=wrenches)))
    for frame, said in (
        ("left_tip", "force (0, 1, 0) N, moment (0, 0, 0.5) N m"),
        ("right_crank", "a table of 2 rows over s, force up to 5 N, moment up to 0 N m"),
    ):
        assert f"<td>wrench</td><td>on {frame}: {said}, axes of the base</td>" in page
