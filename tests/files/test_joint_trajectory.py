"""A plan as a trajectory for ros2_control: what the joints do, in the message's own words."""

import json

import numpy as np
import pytest
import yaml

import robots
from framework import InvalidInput, plan_scene
from framework.cli import main
from framework.files.trajectory_file import joint_trajectory


@pytest.fixture(scope="module")
def plan():
    return plan_scene(robots.load("five_bar_heavy"), "C")


def column(message, name):
    return np.array([point[name] for point in message["points"]])


def seconds(message):
    return np.array(
        [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in message["points"]]
    )


def test_positions_are_the_urdf_s_joints(plan):
    message = joint_trajectory(plan, samples=7)
    q = plan.configuration(seconds(message))
    np.testing.assert_allclose(column(message, "positions"), q[:, plan.robot.actuated], rtol=0, atol=1e-8)
    assert message["joint_names"] == ["left_motor", "right_motor"]
    assert seconds(message)[-1] == pytest.approx(plan.duration, abs=1e-9)


def test_velocities_and_accelerations_are_derivatives(plan):
    message = joint_trajectory(plan, samples=3001)
    step = plan.duration / 3000
    for of, by in (("positions", "velocities"), ("velocities", "accelerations")):
        f, rates = column(message, of), column(message, by)[2:-2]
        central = (f[:-4] - 8 * f[1:-3] + 8 * f[3:-1] - f[4:]) / (12 * step)  # to the fourth order
        np.testing.assert_allclose(central, rates, rtol=0, atol=1e-7 * np.abs(rates).max())


def test_effort_does_the_motors_work(plan):
    message = joint_trajectory(plan, samples=101)
    times = np.linspace(0.0, plan.duration, 101)
    work = np.sum(plan.torque(times) * plan.motor_angle(times, 1), axis=1)
    given = np.sum(column(message, "effort") * column(message, "velocities"), axis=1)
    np.testing.assert_allclose(given, work, rtol=0, atol=1e-12 * np.abs(work).max())


def test_of_a_robot_with_springs_it_is_what_the_motors_do_before_them(tmp_path, capsys):
    plan = plan_scene(robots.load("five_bar", flexibility="flexible_links"), "A")
    message = joint_trajectory(plan, samples=11)
    times, gear = np.linspace(0.0, plan.duration, 11), plan.robot.gear_ratio
    np.testing.assert_allclose(column(message, "positions") * gear, plan.motor_angle(times), rtol=1e-13)
    np.testing.assert_allclose(column(message, "effort"), plan.torque(times) * gear, rtol=1e-13)
    links = np.cumsum(plan.configuration(times)[:, plan.robot.actuated], axis=0)
    assert np.abs(np.cumsum(column(message, "positions"), axis=0) - links).max() < 1e-9
    file = tmp_path / "file.yaml"
    words = ["export", "five_bar", "--scene", "A", "--flexibility", "flexible_links", "--to", "ros2_control"]
    assert main([*words, "--samples", "3", "--out", str(file)]) == 0
    assert file.read_text().startswith("# joint side of the gears")
    assert "before the springs" in file.read_text().splitlines()[0]
    assert "before the springs" in capsys.readouterr().out


def test_a_duration_has_whole_seconds_and_nanoseconds():
    slow = plan_scene(robots.load("five_bar"), "A")
    for point in joint_trajectory(slow, samples=11)["points"]:
        assert 0 <= point["time_from_start"]["nanosec"] < 1_000_000_000


def test_a_file_is_named_for_what_it_holds(tmp_path, capsys):
    words = ["export", "five_bar", "--scene", "A", "--to", "ros2_control", "--out"]
    assert main([*words, str(tmp_path / "file.xml")]) == 2
    assert "ros2_control is written to .yaml or .yml or .json" in capsys.readouterr().err


@pytest.mark.parametrize("samples", [1, 1.5, "many", float("nan")])
def test_samples_that_cannot_be(plan, samples):
    with pytest.raises(InvalidInput, match="samples"):
        joint_trajectory(plan, samples=samples)


def test_points_stand_a_period_apart_and_the_last_at_the_end(plan):
    message = joint_trajectory(plan, period=0.4)
    np.testing.assert_allclose(seconds(message), [0.0, 0.4, 0.8, 1.2, 1.5], rtol=0, atol=1e-9)
    ends = joint_trajectory(plan, samples=2)
    for of in ("positions", "velocities", "accelerations", "effort"):
        every = column(message, of)
        np.testing.assert_allclose(column(ends, of), every[[0, -1]], rtol=0, atol=1e-14 * np.abs(every).max())
    with pytest.raises(InvalidInput, match="period"):
        joint_trajectory(plan, period=1.6)


@pytest.mark.usefixtures("quick_figures")
def test_yaml_and_json_say_the_same_from_a_scene_and_from_a_folder(tmp_path):
    said = ["--to", "ros2_control", "--samples", "5", "--out"]
    assert main(["plan", "five_bar", "--scene", "A", "--out", str(tmp_path / "plan")]) == 0
    assert main(["export", "five_bar", "--scene", "A", *said, str(tmp_path / "one.yaml")]) == 0
    assert main(["export", str(tmp_path / "plan"), *said, str(tmp_path / "two.json")]) == 0
    one = yaml.safe_load((tmp_path / "one.yaml").read_text())
    two = json.loads((tmp_path / "two.json").read_text())
    assert one["joint_names"] == two["joint_names"]
    np.testing.assert_allclose(column(one, "positions"), column(two, "positions"), rtol=0, atol=1e-12)


def test_rows_at_a_rate_are_those_of_the_plan(tmp_path, capsys):
    file, words = tmp_path / "rows.csv", ["export", "five_bar", "--scene", "A", "--to", "csv"]
    code = main([*words, "--rate", "70", "--columns", "time", "torque", "--out", str(file)])
    assert code == 0, capsys.readouterr().err
    rows = np.genfromtxt(file, delimiter=",", names=True)
    assert rows.dtype.names == ("time", "torque_left_motor", "torque_right_motor")
    assert len(rows) == 106  # 1.5 s of 1/70 s, and the start
    plan = plan_scene(robots.load("five_bar"), "A")
    np.testing.assert_allclose(rows["torque_left_motor"], plan.torque(rows["time"])[:, 0], rtol=0, atol=1e-15)
    described = json.loads((tmp_path / "rows.csv-metadata.json").read_text())
    assert len(described["tableSchema"]["columns"]) == 3
    assert main([*words, "--rate", "70", "--samples", "9", "--out", str(file)]) == 2
    assert "--samples, --rate" in capsys.readouterr().err


@pytest.mark.parametrize("foreign", ["rows.csv", "rows.csv-metadata.json"])
def test_rows_and_their_metadata_are_written_together_or_not_at_all(foreign, tmp_path, capsys):
    (tmp_path / foreign).write_text("a file of somebody else")
    words = ["export", "five_bar", "--scene", "A", "--to", "csv", "--out", str(tmp_path / "rows.csv")]
    assert main(words) == 2
    assert f"{foreign} is there already" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == [foreign]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("five_bar", "--to", "ros2_control"), 2, "give --scene"),
        (("five_bar", "--to", "mjcf", "--rate", "9"), 2, "--rate: of ros2_control, csv only"),
        (("five_bar", "--scene", "B", "--to", "ros2_control"), 1, "unbounded torque"),
        (
            ("five_bar", "--to", "mjcf", "--scene", "C"),
            2,
            "--scene: of ros2_control, csv, lesson, controller only, not of mjcf",
        ),
    ],
)
def test_what_cannot_be_exported_is_one_line_and_no_file(refusal, arguments, code, words, tmp_path):
    file = tmp_path / f"file{'.xml' if 'mjcf' in arguments else '.json'}"
    assert words in refusal(code, "export", *arguments, "--out", file)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("side", ["joint", "motor"])
def test_power_is_the_same_on_both_sides_of_the_gears(plan, side):
    message = joint_trajectory(plan, samples=5, side=side)
    assert message["header"]["frame_id"] == f"{side}_side"
    times = np.linspace(0.0, plan.duration, 5)
    gear = plan.robot.gear_ratio if side == "joint" else 1.0
    np.testing.assert_allclose(column(message, "positions") * gear, plan.motor_angle(times), atol=1e-6)
    power = column(message, "effort") * column(message, "velocities")
    np.testing.assert_allclose(power, plan.torque(times) * plan.motor_angle(times, 1), atol=1e-12)


def test_a_file_of_a_robot_with_springs_says_that_it_is_before_them(tmp_path):
    file = tmp_path / "file.json"
    words = ["export", "five_bar", "--scene", "A", "--flexibility", "flexible_links", "--to", "ros2_control"]
    assert main([*words, "--side", "motor", "--samples", "3", "--out", str(file)]) == 0
    assert json.loads(file.read_text())["header"]["frame_id"] == "motor_side_before_springs"


def test_another_side_is_refused(plan):
    with pytest.raises(InvalidInput, match=r"unknown side 'output'.*valid: joint, motor"):
        joint_trajectory(plan, side="output")
