"""A plan read back from its folder is the plan that was written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    InvalidInput,
    Law,
    Line,
    ParallelRobot,
    Polyline,
    RobotFileError,
    Spline,
    load_plan,
    plan_crossing,
    plan_scene,
)
from framework.cli import main
from framework.planning.saved import plan_document, save_plan
from framework.planning.scenes import path_of

LINE = Line([0.1, 0.345], [-0.05, 0.195])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """plan.json of scene C."""
    folder = tmp_path_factory.mktemp("saved")
    plan = plan_crossing(robots.load("five_bar"), LINE, duration=1.5, times=[1.0], speeds=[1.5])
    assert plan.save(folder) == folder / "plan.json"
    return plan, folder


def edited(plan, folder, change):
    """plan.json of the plan with other values at some keys, `a.b` being key b of what stands at a."""
    saved = json.loads(json.dumps(plan_document(plan)))
    for key, value in change.items():
        *way, last = [int(step) if step.isdigit() else step for step in key.split(".")]
        there = saved
        for step in way:
            there = there[step]
        there[last] = value
    (folder / "plan.json").write_text(json.dumps(saved))
    return folder


@pytest.mark.slow
def test_an_optimal_law_on_springs_comes_back(tmp_path):
    robot = robots.load("five_bar", flexibility="flexible_joints")
    plan = plan_crossing(robot, LINE, duration=1.5, law="optimal")
    save_plan(plan, tmp_path)
    again = load_plan(tmp_path)
    times = np.linspace(0.0, plan.duration, 301)
    np.testing.assert_array_equal(again.law(times), plan.law(times))
    # torques hold two derivatives of deflections, in which rounding grows at the ends: 1e-9 of the peak
    # there, more or less with the processor, and a hundredth of that elsewhere
    torque, peak = plan.torque(times), np.abs(plan.torque(times)).max()
    np.testing.assert_allclose(again.torque(times), torque, rtol=0, atol=1e-8 * peak)
    np.testing.assert_allclose(again.torque(times)[3:-3], torque[3:-3], rtol=0, atol=1e-10 * peak)
    np.testing.assert_allclose(again.deflection(times), plan.deflection(times), atol=1e-12)


@pytest.mark.parametrize(
    "path",
    [
        Line([0.1, 0.345], [-0.05, 0.195]),
        Arc([0.0, 0.0], [1.0, 1.0], [2.0, 0.0]),
        Spline([[0.0, 0.0], [1.0, 1.0], [2.0, 0.5]]),
        Polyline([[0.0, 0.0], [1.0, 1.0], [2.0, 0.5]], blend=0.1),
    ],
    ids=["line", "arc", "spline", "polyline"],
)
def test_each_kind_of_path_comes_back(path):
    assert path_of(path.kind, json.loads(json.dumps(path.points.tolist())), path.blend) == path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"law": {"degree": 8}}, "law.chebyshev: missing"),
        ({"law.degree": 12}, "law.degree: the file says 12, the robot now needs 8"),
        ({"law.domain": [0.0, 2.0]}, "law.domain"),
        ({"law.chebyshev": [0.5, float("nan")]}, "finite"),
        ({"law.chebyshev": [0.5] * 20_000}, "law.chebyshev: needs 2 to 2000 numbers, got 20000"),
        ({"law.chebyshev": "abc"}, "law.chebyshev: needs a list"),
        ({"law.kind": "spline"}, "spline"),
        ({"robot_file": "no_such_robot"}, "there is no .*no_such_robot; if it has moved, name it again"),
        ({"request": None}, "request: needs a mapping"),
        ({"request.path": None}, "request.path: needs a mapping"),
        ({"request.path": {"circle": [[0, 0]]}}, "circle"),
        ({"request.path": {"line": [[0, 0]]}}, "2 points"),
        ({"request.path": []}, "request.path: needs a mapping"),
        ({"request.colour": "red"}, "colour"),
        ({"request.torque_limit": [[]]}, "torque_limit: needs one positive number"),
        ({"request.speed_limit": [[1.0, 1.0]]}, "speed_limit: needs one positive number"),
        ({"request.times": 1.0}, "times: needs a list"),
        ({"request.smoothness": 3.5}, "smoothness"),
        ({"request.law": "cubic"}, "cubic"),
        ({"flexibility": "soft"}, "soft"),
        ({"geometry": "bent"}, "bent"),
        ({"request.geometry": "bent"}, "bent"),
        ({"duration": -1.0}, "duration"),
        ({"duration": 2.0}, "the request says 1.5"),
        ({"duration": None}, "duration: needs a number, got None"),
        ({"version": 2}, "this program reads plans of version 3, got 2; plan again"),
        ({"version": 1}, "this program reads plans of version 3, got 1; plan again"),
    ],
)
def test_what_is_not_a_plan_is_refused_by_name(written, tmp_path, change, says):
    with pytest.raises(InvalidInput, match=says):
        load_plan(edited(written[0], tmp_path, change))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"peak_torque": {"left_motor": 1.0, "right_motor": 1.0}}, "peak_torque.left_motor"),
        ({"crossings": []}, "crossings: the file says 0"),
        ({"peak_torque": {}}, "peak_torque.left_motor: the file says 'nothing'"),
        ({"crossings.0.kind": "leg_passive"}, "kind"),
        ({"crossings.0.time": 0.9}, "time"),
        ({"crossings.0.speed": 1.51}, "speed"),
        ({"crossings.0.acceleration": 1.0}, "acceleration"),
        ({"crossings.0.twist": [1.0, 0.0]}, "twist"),
        ({"crossings.0.platform": [0.0, 0.0]}, "platform"),
        ({"crossings.0.condition": None}, "condition"),
        ({"crossings.0.condition.alpha": 1.0}, "alpha"),
        ({"certificate.monotone": True}, "monotone"),  # this law overshoots
        ({"request.path": {"line": [[0.1, 0.345], [-0.04, 0.195]]}}, "has changed since"),
    ],
)
def test_a_plan_that_says_other_than_its_law_does_is_refused_by_name(written, tmp_path, change, says):
    with pytest.raises(InvalidInput, match=says) as caught:
        load_plan(edited(written[0], tmp_path, change))
    assert "has changed since" in str(caught.value)


def test_the_peaks_of_motors_are_compared_whatever_their_names(write_robot, tmp_path):
    """Motors named like a key of crossings, and with a dot: rounding agrees, other peaks do not."""
    file = write_robot()
    for path in (file, tmp_path / "five_bar.urdf"):
        text = path.read_text().replace("left_motor", "residual").replace("right_motor", "leg.hip")
        path.write_text(text)
    plan = plan_crossing(ParallelRobot.from_file(file), LINE, duration=1.5)
    peaks = dict(plan.peak_torque)
    assert load_plan(edited(plan, tmp_path, {"peak_torque": peaks})).peak_torque == peaks
    for motor in ("residual", "leg.hip"):
        load_plan(edited(plan, tmp_path, {"peak_torque": peaks | {motor: peaks[motor] * (1 + 1e-12)}}))
        with pytest.raises(InvalidInput, match=rf"peak_torque.{motor}: .*has changed since"):
            load_plan(edited(plan, tmp_path, {"peak_torque": peaks | {motor: peaks[motor] * 1.01}}))


@pytest.mark.parametrize(
    "key", ["certificate", "exceeded", "neglected", "neglected_friction", "robot", "law"]
)
def test_a_key_that_is_missing_is_named(written, tmp_path, capsys, key):
    saved = plan_document(written[0])
    del saved[key]
    (tmp_path / "plan.json").write_text(json.dumps(saved))
    with pytest.raises(InvalidInput, match=rf"plan.json: {key}: missing \(given: version, "):
        load_plan(tmp_path)
    assert main(["report", str(tmp_path)]) == 2
    assert f"plan.json: {key}: missing (given: version, " in capsys.readouterr().err


def test_a_plan_of_an_older_program_is_refused_by_its_version_in_one_line(written, tmp_path):
    saved = plan_document(written[0])
    del saved["version"]
    (tmp_path / "plan.json").write_text(json.dumps(saved))
    with pytest.raises(InvalidInput, match="got none, as before version 2; plan again") as caught:
        load_plan(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "says"), [("", "not JSON"), ("[]", "one JSON object"), ("{}", "version")])
def test_a_file_that_is_no_plan_is_refused(tmp_path, text, says):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(InvalidInput, match=says):
        load_plan(tmp_path)


class Bow:
    """A path of one's own making."""

    n, knots = 2, np.empty(0)

    def __call__(self, s, order=0):
        return LINE(s, order)


class OwnLaw(Law):
    """A law of one's own making, which can be written down as the polynomial that it is."""


class SecretLaw(Law):
    """A law of one's own making that plan.json knows nothing of."""

    kind = "secret"

    def to_dict(self):
        return {"kind": self.kind}


def test_what_a_user_made_is_saved_where_it_can_be_and_refused_where_it_cannot(tmp_path):
    robot = robots.load("five_bar")
    plan = plan_crossing(robot, LINE, duration=1.5)
    own = replace(plan, law=OwnLaw(plan.law.coefficients, plan.duration))
    save_plan(own, tmp_path / "own")
    assert load_plan(tmp_path / "own").law.to_dict() == plan.law.to_dict()
    secret = replace(plan, law=SecretLaw(plan.law.coefficients, plan.duration))
    with pytest.raises(InvalidInput, match=r"'secret' \(valid: optimal, polynomial\).*to_csv"):
        save_plan(secret, tmp_path / "secret")
    with pytest.raises(InvalidInput, match=r"path: only lines, arcs, splines and polylines.*not Bow"):
        save_plan(plan_crossing(robot, Bow(), duration=1.5), tmp_path / "bow")
    assert [file.name for file in tmp_path.iterdir()] == ["own"]


def test_a_plan_that_overshoots_says_so_once_more(tmp_path):
    """The paper's case C with degree 8 on the deformed robot needs smoothness 4; the rigid one overshoots."""
    plan = plan_scene(robots.load("five_bar"), "C")
    save_plan(plan, tmp_path)
    assert load_plan(tmp_path).certificate == plan.certificate


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


@pytest.fixture
def project(write_robot, tmp_path):
    """A folder with a robot file in it, and a plan of that in a folder below."""
    file = write_robot()
    home = tmp_path / "home"
    home.mkdir()
    moved = home / file.name
    file.rename(moved)
    (tmp_path / "five_bar.urdf").rename(home / "five_bar.urdf")
    save_plan(plan_scene(ParallelRobot.from_file(moved), "C"), home / "plans" / "C")
    return home


def test_a_plan_and_its_robot_move_together(project):
    """The path of the robot file is relative to plan.json."""
    saved = json.loads((project / "plans" / "C" / "plan.json").read_text())
    assert Path(saved["robot_file"]) == Path("..", "..", "my_robot.yaml")
    moved = project.rename(project.with_name("elsewhere"))
    again = load_plan(moved / "plans" / "C")
    assert again.robot.description.file.resolve() == moved / "my_robot.yaml"


def test_a_robot_file_that_has_moved_can_be_named_again(project, capsys):
    out, moved = project / "plans" / "C", project / "renamed.yaml"
    (project / "my_robot.yaml").rename(moved)
    with pytest.raises(RobotFileError, match="name it again"):
        load_plan(out)
    assert load_plan(out, robot_file=moved).robot.description.file == moved
    for command in ("report", "simulate", "show", "robustness"):
        assert main([command, str(out)]) == 2
        assert "--robot-file" in capsys.readouterr().err
    assert main(["simulate", str(out), "--robot-file", str(moved)]) == 0
    assert main(["simulate", "five_bar", "--scene", "C", "--robot-file", str(moved)]) == 2
    assert "goes with a folder" in capsys.readouterr().err


def test_an_optimal_law_without_a_smoothness_is_refused_by_name(tmp_path):
    plan = plan_scene(robots.load("five_bar"), "A", duration=None, optimize="time", torque_limit=0.3)
    for smoothness in (-1, 0, 1.5, True, 10**40, "2"):
        with pytest.raises(InvalidInput, match="smoothness"):
            load_plan(edited(plan, tmp_path, {"law.smoothness": smoothness}))
