"""A plan read back from its folder is the plan that was written."""

from __future__ import annotations

import json

import numpy as np
import pytest

import robots
from framework import Arc, InvalidInput, Line, Spline, load_plan, plan_crossing, plan_scene
from framework.cli import main
from framework.crossing.result import path_points
from framework.crossing.scenes import path_of


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """plan.json of scene C, on the deformed robot."""
    folder = tmp_path_factory.mktemp("saved")
    robot = robots.load("five_bar", flexibility="flexible_links")
    path = Line([0.1, 0.345], [-0.05, 0.195])
    plan = plan_crossing(robot, path, duration=1.5, times=[1.0], speeds=[1.5])
    (folder / "plan.json").write_text(json.dumps(plan.to_dict()))
    return plan, folder


def test_the_law_comes_back_as_it_was_and_so_do_the_torques(written):
    plan, folder = written
    again = load_plan(folder)
    times = np.linspace(0.0, plan.duration, 301)
    np.testing.assert_array_equal(again.law(times), plan.law(times))
    np.testing.assert_allclose(again.torque(times), plan.torque(times), atol=1e-11)  # N m
    np.testing.assert_allclose(again.platform(times), plan.platform(times), atol=1e-15)
    assert again.robot.flexibility == "flexible_links"
    assert again.geometry == "deformed"
    assert [c.kind for c in again.crossings] == ["type_2"]
    np.testing.assert_allclose(again.crossings[0].time, 1.0, atol=1e-9)
    np.testing.assert_allclose(again.crossings[0].speed, 1.5, atol=1e-7)


def test_an_optimal_law_comes_back_with_what_it_was_best_at(tmp_path):
    path = Line([0.1, 0.345], [-0.05, 0.195])
    plan = plan_crossing(robots.load("five_bar"), path, optimize="time", torque_limit=0.165, margin=0.1)
    (tmp_path / "plan.json").write_text(json.dumps(plan.to_dict()))
    again = load_plan(tmp_path)
    times = np.linspace(0.0, plan.duration, 301)
    assert again.duration == plan.duration
    np.testing.assert_array_equal(again.law(times), plan.law(times))
    np.testing.assert_allclose(again.torque(times), plan.torque(times), atol=1e-11)  # N m
    assert again.reason == plan.reason
    assert again.optimality.to_dict() == plan.optimality.to_dict()
    np.testing.assert_allclose(again.optimality.wish.torque_limit, 0.9 * 0.165)


def test_an_optimal_law_on_springs_comes_back(tmp_path):
    robot = robots.load("five_bar", flexibility="flexible_joints")
    plan = plan_crossing(robot, Line([0.1, 0.345], [-0.05, 0.195]), duration=1.5, law="optimal")
    (tmp_path / "plan.json").write_text(json.dumps(plan.to_dict()))
    again = load_plan(tmp_path)
    times = np.linspace(0.0, plan.duration, 301)
    np.testing.assert_array_equal(again.law(times), plan.law(times))
    np.testing.assert_allclose(again.torque(times), plan.torque(times), atol=1e-10)  # N m
    np.testing.assert_allclose(again.deflection(times), plan.deflection(times), atol=1e-12)


def test_the_table_of_an_optimal_law_agrees_with_itself(tmp_path):
    """motion.csv: s from 0 to 1, its derivatives those of its columns, torques within the limit."""
    path = Line([0.1, 0.345], [-0.05, 0.195])
    plan = plan_crossing(robots.load("five_bar"), path, optimize="time", torque_limit=0.165)
    plan.to_csv(tmp_path / "motion.csv", 3001)
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert (table["s"][0], table["s"][-1]) == pytest.approx((0.0, 1.0), abs=1e-12)
    for value, slope in (("s", "ds"), ("ds", "dds")):
        gained = np.trapezoid(table[slope], table["time"])
        jump = 0.5 * table["time"][1] * np.ptp(table[slope])  # the most that one steep step can hide
        assert gained == pytest.approx(table[value][-1] - table[value][0], abs=jump)
    expected = path(table["s"])
    np.testing.assert_allclose(table["platform_x"], expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(table["platform_y"], expected[:, 1], atol=1e-12)
    for joint in plan.robot.actuator_names:
        assert np.abs(table[f"torque_{joint}"]).max() <= 0.165


@pytest.mark.parametrize(
    "path",
    [
        Line([0.1, 0.345], [-0.05, 0.195]),
        Arc([0.0, 0.0], [1.0, 1.0], [2.0, 0.0]),
        Spline([[0.0, 0.0], [1.0, 1.0], [2.0, 0.5]]),
    ],
    ids=["line", "arc", "spline"],
)
def test_each_kind_of_path_comes_back(path):
    ((kind, points),) = path_points(path).items()
    s = np.linspace(0, 1, 17)
    np.testing.assert_array_equal(path_of(kind, points)(s), path(s))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"law": {"degree": 8}}, "chebyshev"),
        ({"law": {"chebyshev": [0.5, float("nan")]}}, "finite"),
        ({"law": {"chebyshev": "abc"}}, "not a plan"),
        ({"robot_file": "no_such_robot"}, "no_such_robot"),
        ({"path": None}, "path"),
        ({"path": {"circle": [[0, 0]]}}, "circle"),
        ({"path": {"line": [[0, 0]]}}, "2 points"),
        ({"path": []}, "not a plan"),
        ({"flexibility": "soft"}, "soft"),
        ({"geometry": "bent"}, "bent"),
        ({"duration": -1.0}, "duration"),
        ({"duration": None}, "not a plan"),
        ({"peak_torque": {"left_motor": 1.0, "right_motor": 1.0}}, "has changed since"),
    ],
)
def test_what_is_not_a_plan_is_refused_by_name(written, tmp_path, change, says):
    plan, _ = written
    (tmp_path / "plan.json").write_text(json.dumps({**plan.to_dict(), **change}))
    with pytest.raises(InvalidInput, match=says):
        load_plan(tmp_path)


@pytest.mark.parametrize(
    ("text", "says"), [("", "not JSON"), ("[]", "one JSON object"), ("{}", "flexibility")]
)
def test_a_file_that_is_no_plan_is_refused(tmp_path, text, says):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(InvalidInput, match=says):
        load_plan(tmp_path)


def test_a_folder_without_a_plan_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="No such file"):
        load_plan(tmp_path)


def test_a_robot_outside_the_catalogue_is_found_by_its_file(write_robot, tmp_path, capsys):
    file = write_robot()
    assert main(["plan", str(file), "--scene", "C", "--json"]) == 0
    saved = json.loads(capsys.readouterr().out)
    assert saved["robot_file"] == str(file)
    (tmp_path / "plan.json").write_text(json.dumps(saved))
    assert load_plan(tmp_path).robot.description.file == file


@pytest.mark.parametrize("smoothness", [-1, 0, 1.5, True, 10**40, "2"])
def test_an_optimal_law_without_a_smoothness_is_refused_by_name(tmp_path, smoothness):
    plan = plan_scene(robots.load("five_bar"), "A", duration=None, optimize="time", torque_limit=0.3)
    saved = plan.to_dict()
    saved["law"]["smoothness"] = smoothness
    (tmp_path / "plan.json").write_text(json.dumps(saved))
    with pytest.raises(InvalidInput, match="smoothness"):
        load_plan(tmp_path)
