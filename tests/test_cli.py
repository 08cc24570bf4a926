"""The command line: exit codes, one line of complaint, JSON alone on stdout, files as in the contract."""

import json
import re
import subprocess
import sys
from html import unescape
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.polynomial import chebyshev

import robots
from framework import plan_scene
from framework.cli import main
from framework.cli.commands import parser_of
from framework.dynamics.finite_differences import finite_difference_torques
from framework.model.description import FLEXIBILITIES
from framework.planning.saved import save_plan
from tests.conftest import FIVE_BAR, REMOVED
from tests.oracles import five_bar as oracle
from tests.oracles import five_bar_pose

LINE = ["--from", "0.1", "0.345", "--to", "-0.05", "0.195"]  # through the singularity
CLEAR = ["--from", "0.1", "0.345", "--to", "-0.05", "0.295"]  # past it
PLAN = ["plan", "five_bar"]
FREE = [*PLAN, *LINE, "--duration", "1.5"]
PLAN_KEYS = [
    "version",
    "robot",
    "robot_file",
    "parameters",
    "flexibility",
    "platform_joints",
    "geometry",
    "duration",
    "request",
    "law",
    "crossings",
    "peak_torque",
    "exceeded",
    "motor_use",
    "neglected_friction",
    "neglected",
    "certificate",
    "reason",
    "optimality",
    "seconds",
]
PASSIVE = ["left_elbow", "right_elbow"]
UNITS = ["m", "rad", "N m"]
CROSSING_KEYS = [
    "s",
    "time",
    "speed",
    "acceleration",
    "kind",
    "twist",
    "platform",
    "residual",
    "condition",
    "loaded",
]
CERTIFICATE_KEYS = [
    "nodes",
    "tail",
    "passes",
    "change",
    "max_closure_error",
    "max_residual_torque",
    "max_held_torque",
    "end_speed",
    "monotone",
    "rounded_gap",
]


# ------------------------------------------------------------------ what is done


def test_robots_lists_the_catalogue(crossing, document, monkeypatch):
    rows = document("robots")["robots"]
    assert {row["name"] for row in rows} == set(robots.CATALOGUE)
    for row in rows:
        robot = robots.load(row["name"])
        assert (row["degrees_of_freedom"], row["scenes"]) == (robot.n, list(robot.description.scenes))
        assert Path(row["file"]).is_file()
    few = {name: robots.CATALOGUE[name] for name in ("biglide", "four_bar")}
    monkeypatch.setattr("framework.cli.robots.catalogue", lambda: few)
    assert all(name in crossing("robots")[1] for name in few)


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
def test_check_examines_a_robot(document, flexibility):
    found = document("check", "five_bar", "--flexibility", flexibility)
    assert (found["robot"], found["flexibility"], found["mobility"]) == ("five_bar", flexibility, 2)
    assert found["square"] is True
    # a planar loop written in 3D: three equations, the one out of the plane for nothing
    assert (found["loop_equations"], found["rank"], found["redundant_rows"]) == (3, 2, ["tip.z"])
    assert found["mass"] == pytest.approx(10.0)
    assert set(found["massless_joints"]) == {"left_motor", "right_motor", "right_elbow"}
    assert found["closure_error"] < 1e-12
    assert found["working_mode"] in (-1, 1)
    assert found["assembly_mode"] in (-1, 1)
    assert [advice.split()[0] for advice in found["advice"]] == [
        "tip.z:"
    ]  # redundant, as in all planar robots


def test_a_robot_that_is_not_square_has_one_exit_code_in_every_command(crossing, write_robot):
    motor = {"joint": "left_motor"}
    file = write_robot(
        ("actuators", [motor]), ("scenes.C", {"line": [[0.1, 0.345], [-0.05, 0.195]], "duration": 1})
    )
    code, out, err = crossing("check", file)
    assert (code, err.count("\n")) == (2, 1)
    assert "A is not square: " in out
    assert "add actuators" in out
    assert "2 platform axes and 1 actuators for 2 degrees of freedom" in err
    for command in ("locate", "plan"):
        assert crossing(command, file, "--scene", "C")[0] == 2


@pytest.mark.parametrize("path", [["--scene", "C"], LINE])
def test_locate_finds_the_singular_points(document, path):
    found = document("locate", "five_bar", *path)
    assert found["robot"] == "five_bar"
    (point,) = found["singularities"]
    assert {"s", "kind", "twist", "platform", "slope"} <= set(point)
    assert point["s"] == pytest.approx(float(oracle.locus_position("C")), abs=1e-12)
    assert point["kind"] == "type_2"
    np.testing.assert_allclose(point["platform"], [0.1 - 0.15 * point["s"], 0.345 - 0.15 * point["s"]])
    assert np.linalg.norm(point["twist"]) == pytest.approx(1.0)
    assert point["slope"] != 0.0


def test_locate_tells_what_the_crossing_asks_of_a_law(crossing, document):
    (at,) = document("locate", "five_bar", "--scene", "C")["singularities"]
    alpha, acceleration = at["condition"]["alpha"], at["condition"]["acceleration"]
    np.testing.assert_allclose(abs(alpha), 10 * 0.15 * abs(np.sum(at["twist"])), rtol=1e-9)  # 10 kg
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-9)
    assert "condition (8) at s = 0.667007 has alpha = " in crossing("locate", "five_bar", "--scene", "C")[1]


def test_a_scenes_times_are_named_where_another_duration_does_not_suit_them(refusal):
    err = refusal(2, "plan", "five_bar", "--scene", "C", "--duration", 1500)
    assert "t = 1 s (s' = 1.5 1/s)" in err
    assert "a scene belong to its own duration" in err


def test_locate_tells_a_near_miss_with_its_place_and_how_near_it_is(refusal, crossing, document):
    """A level path one micrometre above the locus, whose top is at sqrt(0.06) m, symmetric about x = 0."""
    beside = ["--from", "0.06", str(0.06**0.5 + 1e-6), "--to", "-0.06", str(0.06**0.5 + 1e-6)]
    found = document("locate", "five_bar", *beside)
    assert found["singularities"] == []
    (miss,) = found["near_misses"]
    assert miss["s"] == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(miss["platform"], [0.0, 0.06**0.5 + 1e-6], atol=1e-9)
    assert 1e-7 < abs(miss["g"]) < 1e-5
    text = crossing("locate", "five_bar", *beside)[1]
    assert "no singularity on the path" in text
    assert "near miss at s = 0.500000" in text
    err = refusal(1, "plan", "five_bar", *beside, "--duration", 1.5, "--law", "polynomial")
    assert "misses a singularity by |g| = " in err


def rods_in_line(x) -> float:
    """The sine of the angle between the rods of the 5R at x, which is 0 where it is singular."""
    return float(five_bar_pose.pose(np.array([x])).sine[0])


def test_locate_tells_what_lies_before_a_path_ends(crossing):
    code, text, err = crossing("locate", "five_bar", "--from", "0.1", "0.345", "--to", "-0.1", "-0.6")
    assert code == 1
    assert "leaves the workspace at s = 0.815063" in err
    start, way = np.array([0.1, 0.345]), np.array([-0.2, -0.945])
    found = [float(s) for s in re.findall(r"^s = ([0-9.]+)  type_2", text, re.MULTILINE)]
    signs = np.sign([rods_in_line(start + s * way) for s in np.linspace(0.0, 0.81, 400)])
    assert len(found) == np.count_nonzero(np.diff(signs)) == 3
    for s in found:
        assert abs(rods_in_line(start + s * way)) < 1e-9


@pytest.mark.slow
def test_locate_without_a_path_gives_a_line_that_crosses_at_the_nearest_singular_pose(crossing, document):
    text = crossing("locate", "five_bar")[1]
    (line,) = re.findall(r"to cross there +crossing (.*)$", text, re.MULTILINE)
    (at, *_) = document(*line.split())["singularities"]
    assert abs(rods_in_line(at["platform"])) < 1e-9
    distance = document("locate", "five_bar")["nearest_singular_pose"]["distance"]
    code, _, err = crossing("locate", "five_bar", "--torque-limit", "1")
    assert code == 2
    assert "--torque-limit: of a path" in err
    assert np.linalg.norm(np.array(at["platform"]) - [0.1, 0.345]) == pytest.approx(distance, rel=1e-6)


def test_locate_without_a_path_says_how_to_look_farther_where_it_finds_no_singular_pose(crossing):
    """The dead centre of the slider-crank is 1.1253 rad from its reference."""
    text = crossing("locate", "slider_crank")[1]
    assert "no singular pose in the ball searched" in text
    (line,) = re.findall(r"to look farther +crossing (.*)$", text, re.MULTILINE)
    assert crossing(*line.split()[:-1], "1.2")[0] == 0


def test_locate_finds_none_where_there_is_none(crossing, document):
    assert document("locate", "five_bar", *CLEAR)["singularities"] == []
    assert "no singularity" in crossing("locate", "five_bar", "--scene", "A")[1]


@pytest.mark.parametrize(
    ("flexibility", "geometry", "degree"),
    [("rigid", "rigid", 8), ("flexible_joints", "deformed", 12), ("flexible_links", "deformed", 12)],
)
def test_plan_gives_the_object_of_the_contract(document, flexibility, geometry, degree):
    found = document(*PLAN, "--scene", "C", "--flexibility", flexibility)
    assert list(found) == PLAN_KEYS
    keys = ("version", "robot", "robot_file", "flexibility", "geometry", "duration")
    assert [found[key] for key in keys] == [3, "five_bar", "five_bar", flexibility, geometry, 1.5]
    assert list(found["law"]) == ["degree", "chebyshev", "domain"]
    assert (found["law"]["degree"], found["law"]["domain"]) == (degree, [0.0, 1.5])
    (crossing,) = found["crossings"]
    assert list(crossing) == CROSSING_KEYS
    assert [crossing[key] for key in ("time", "speed", "kind")] == [1.0, 1.5, "type_2"]
    # the law as stored is the law of the crossing: t = 1 s is x = 1/3 of [0, 1.5] s
    series = np.array(found["law"]["chebyshev"])
    assert len(series) == degree + 1
    assert chebyshev.chebval(1 / 3, series) == pytest.approx(crossing["s"], abs=1e-14)
    assert set(found["peak_torque"]) == {"left_motor", "right_motor"}
    assert list(found["certificate"]) == CERTIFICATE_KEYS
    assert found["certificate"]["tail"] < 1e-10
    assert found["seconds"] > 0


def test_plan_says_the_same_to_people(crossing):
    code, out, err = crossing(*PLAN, "--scene", "C", "--flexibility", "flexible_links")
    assert (code, err) == (0, "")
    for words in ("degree 12", "t = 1 s", "left_motor", "N m", "tail", "nodes"):
        assert words in out


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--times", "0.95", "--speeds", "1.4"], (1.5, 0.95, 1.4)),
        (["--speeds", "1.3"], (1.5, 1.0, 1.3)),
        (["--duration", "2", "--times", "1.3", "--speeds", "1.1"], (2.0, 1.3, 1.1)),
    ],
)
def test_what_is_typed_overrides_the_scene(document, options, expected):
    found = document(*PLAN, "--scene", "C", *options)
    (crossing,) = found["crossings"]
    assert (found["duration"], crossing["time"], crossing["speed"]) == expected


def test_instants_have_the_torques_of_the_closed_form(crossing, document, refusal):
    scene = ["five_bar", "--scene", "C"]
    rows = document("plan", *scene, "--at", 0.3, 1.0)["instants"]
    motors = ["torque_left_motor", "torque_right_motor"]
    assert list(rows[0]) == ["time", "s", "platform_x", "platform_y", *motors]
    torques = [[row[motor] for motor in motors] for row in rows]
    exact = oracle.solve("C", "rigid", "rigid", 2)
    np.testing.assert_allclose(torques, oracle.torques(exact, [0.3, 1.0]), rtol=0, atol=1e-11)
    table = ["--to", "csv", "--at", 0.3, "--columns", "torque", "--out", "-"]
    _, out, _ = crossing("export", *scene, *table)
    printed = [*map(float, out.splitlines()[1].split(","))]
    np.testing.assert_allclose(printed, torques[0], rtol=0, atol=1e-12)
    assert "at: needs instants of 0 to 1.5 s" in refusal(2, "plan", *scene, "--at", 1.6)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize("is_written", [False, True])
def test_a_plan_whose_duration_is_found_is_kept_if_an_instant_is_beyond_it(crossing, tmp_path, is_written):
    line = ["five_bar", "--from", 0.1, 0.34, "--to", 0.08, 0.33, "--optimize", "time", "--torque-limit", 1]
    folder = tmp_path / "quick"
    code, out, said = crossing(
        "plan", *line, "--at", 30, "--json", *(["--out", folder] if is_written else [])
    )
    document = json.loads(out)
    assert code == 2
    assert f"0 to {document['duration']:.6g} s" in said
    assert "instants" in document["error"]["message"]
    if is_written:
        assert json.loads((folder / "plan.json").read_text())["law"] == document["law"]


def test_a_line_of_ones_own_is_planned_with_times_and_speeds_of_the_programs_choice(document):
    found = document(*FREE)
    (crossing,) = found["crossings"]
    assert 0 < crossing["time"] < 1.5
    assert crossing["speed"] > 0
    assert found["certificate"]["monotone"] is True


def test_negative_numbers_may_be_written_with_an_exponent(document):
    plain, exponent = (document("locate", "five_bar", *LINE[:4], to, "0.195") for to in ("-0.05", "-5e-2"))
    assert plain == exponent


@pytest.mark.usefixtures("quick_figures")
def test_out_writes_the_plan_and_its_figures(document, tmp_path):
    out = tmp_path / "new" / "folder"
    printed = document(*PLAN, "--scene", "C", "--flexibility", "flexible_links", "--out", out)
    assert {path.name for path in out.iterdir()} == {
        *("plan.json", "motion.csv", "motion.csv-metadata.json", "figures.txt"),
        *("vibrations.csv", "response.csv"),
    }
    assert (out / "figures.txt").read_text() == "five_bar, flexible_links"
    natural = np.genfromtxt(out / "vibrations.csv", delimiter=",", names=True)
    assert natural["s"][-1] == pytest.approx(1.0)
    assert natural["locked_1"].min() < 1e-3 * natural["locked_1"].max()  # [Hz] at the crossing, t = 1 s
    response = np.genfromtxt(out / "response.csv", delimiter=",", names=True)
    assert np.isfinite(response["gain_x_left_motor"]).all()
    assert len(response) % len(natural) == 0
    stored = json.loads((out / "plan.json").read_text())
    assert list(stored) == list(printed)
    assert {**stored, "seconds": 0} == {**printed, "seconds": 0}


@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize(
    ("flexibility", "samples", "springs"),
    [("rigid", 101, []), ("flexible_links", 1501, ["left_drive", "right_drive", "left_rod", "right_rod"])],
)
def test_out_writes_the_motion(document, tmp_path, flexibility, samples, springs):
    options = [] if samples == 1501 else ["--samples", samples]  # the default
    stored = document(*PLAN, "--scene", "C", "--flexibility", flexibility, "--out", tmp_path, *options)
    lines = (tmp_path / "motion.csv").read_text().splitlines()
    motors = ["left_motor", "right_motor"]
    old = [
        *("time", "s", "ds", "dds", "platform_x", "platform_y"),
        *(f"motor_angle_{joint}" for joint in motors),
        *(f"torque_{joint}" for joint in motors),
        *(f"deflection_{spring}" for spring in springs),
    ]
    rates = ("velocity", "acceleration")
    assert lines[0].split(",") == [
        *old,
        *(f"platform_{rate}_{axis}" for rate in rates for axis in "xy"),
        *(f"motor_{rate}_{joint}" for rate in rates for joint in motors),
        *(f"deflection_{rate}_{spring}" for rate in rates for spring in springs),
        *(f"joint_{joint}" for joint in PASSIVE),
        *(f"joint_{rate}_{joint}" for rate in rates for joint in PASSIVE),
    ]
    described = json.loads((tmp_path / "motion.csv-metadata.json").read_text())
    assert described["url"] == "motion.csv"
    columns = described["tableSchema"]["columns"]
    assert [column["name"] for column in columns] == lines[0].split(",")
    assert {column["schema:unitText"] for column in columns[: len(old)]} <= {"s", "1", "1/s", "1/s2", *UNITS}
    rows = np.array([[float(value) for value in line.split(",")] for line in lines[1:]])
    assert rows.shape == (samples, len(columns))
    t, s = rows[:, 0], rows[:, 1]
    np.testing.assert_allclose(t, np.linspace(0, 1.5, samples), atol=1e-15)
    for order in range(3):
        series = chebyshev.chebder(stored["law"]["chebyshev"], order, scl=2 / 1.5)
        np.testing.assert_allclose(rows[:, 1 + order], chebyshev.chebval(2 * t / 1.5 - 1, series), atol=1e-12)
    x = np.column_stack([0.1 - 0.15 * s, 0.345 - 0.15 * s])
    np.testing.assert_allclose(rows[:, 4:6], x, atol=1e-15)


# ------------------------------------------------------------------ the answer is no


LONG_LEGS = ["plan", "three_rpr", "--from", -0.2, 0.25, 0.4, "--to", -0.2, 1.9, 0.4, "--duration", 1.5]


def test_positions_beyond_the_limits_are_said_or_on_request_refused(crossing, document, refusal, tmp_path):
    found = document(*LONG_LEGS)["exceeded"]
    assert set(found) == {"motor_1", "motor_2", "motor_3"}
    code, text, _ = crossing(*LONG_LEGS)
    assert code == 0
    assert all(f"{joint} exceeds its limits: {said}" in text for joint, said in found.items())
    assert f"motor_2: {found['motor_2']}" in refusal(
        1, *LONG_LEGS, "--keep-limits", "--out", tmp_path / "out"
    )
    assert list(tmp_path.iterdir()) == []
    assert "--keep-limits" in refusal(2, *LONG_LEGS, "--keep-limits", "--raw")


POLE = re.compile(r"unbounded torque at t = ([\d.]+) s, .*x, y = \(\S+, \S+\).* t_s \. W_p = (\S+) N ")


@pytest.mark.parametrize(("scene", "flexibility"), [("B", "rigid"), ("C-printed", "flexible_links")])
def test_a_pole_is_no_plan_and_leaves_nothing_behind(refusal, tmp_path, scene, flexibility):
    out = tmp_path / "out"
    command = [*PLAN, "--scene", scene, "--flexibility", flexibility, "--json", "--out", out]
    found = POLE.search(refusal(1, *command))
    assert 0 < float(found[1]) < 1.5
    assert abs(float(found[2])) > 1e-3
    assert list(tmp_path.iterdir()) == []


def test_a_pole_leaves_the_files_of_an_earlier_plan_alone(refusal, tmp_path):
    earlier = '{"robot": "five_bar"}'
    (tmp_path / "plan.json").write_text(earlier)
    refusal(1, *PLAN, "--scene", "B", "--out", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]
    assert (tmp_path / "plan.json").read_text() == earlier


def test_raw_shows_the_spike_and_says_that_it_proves_nothing(document, tmp_path):
    samples = 1501  # by default
    found = document(*PLAN, "--scene", "B", "--raw", "--out", tmp_path)
    assert (found["raw"], found["proved"], found["samples"]) == (True, False, samples)
    (crossing,) = found["crossings"]
    assert abs(crossing["wrench"]) > 1.0  # [N]
    assert {path.name for path in tmp_path.iterdir()} == {
        *("raw.csv", "raw.json", "raw_torques.pdf", "raw_torques.png")
    }
    header, *lines = (tmp_path / "raw.csv").read_text().splitlines()
    names = header.split(",")
    rows = np.array([[float(value) for value in line.split(",")] for line in lines])
    assert len(rows) == samples
    plan = plan_scene(robots.load("five_bar"), "C")
    for joint, peak in plan.peak_torque.items():
        torque = np.abs(rows[:, names.index(f"torque_{joint}")])
        assert found["largest_sample"][joint] == torque.max()
        assert torque.max() > 20 * peak
        # the spike stands at the pole; differences smear it over the next samples
        assert rows[np.argmax(torque), 0] == pytest.approx(crossing["time"], abs=3 * 1.5 / samples)


def test_a_raw_sample_without_bound_is_no_number_for_machines(crossing, document, monkeypatch, tmp_path):
    command = [*PLAN, "--scene", "B", "--raw", "--samples", "51"]

    def without_bound(*arguments, **options):
        raw = finite_difference_torques(*arguments, **options)
        raw.torque[25] = [np.inf, np.nan]  # a sample on the pole itself, as rounding has it
        return raw

    monkeypatch.setattr("framework.cli.plan.finite_difference_torques", without_bound)
    assert document(*command)["largest_sample"] == {"left_motor": None, "right_motor": None}
    code, out, err = crossing(*command, "--out", tmp_path)
    assert (code, err) == (0, "")
    assert "left_motor inf" in out
    assert json.loads((tmp_path / "raw.json").read_text())["largest_sample"]["left_motor"] is None


def test_raw_spikes_grow_with_the_samples_and_certified_peaks_do_not(document, tmp_path):
    spikes = [
        document(*PLAN, "--scene", "C-printed", "--raw", "--samples", samples)["largest_sample"]["left_motor"]
        for samples in (1501, 6001)  # the nearest one 0.23 and 0.023 ms from the pole
    ]
    assert spikes[1] > 3 * spikes[0]
    assert list(tmp_path.iterdir()) == []


# a motion that asks for what is not there, words
NO_ANSWERS = [
    ("locate five_bar --from 0.1 0.345 --to 0.1 0.6", ["leg of left_motor", "s = 0.2", "(0.1, 0.4)"]),
    ("plan five_bar --from 0.1 0.345 --to 0.1 0.6 --duration 1", ["leg of left_motor", "(0.1, 0.4)"]),
    ("plan five_bar --from 0.1 0.7 --to 0.1 0.345 --duration 1", ["reference", "leg of"]),
    ("plan five_bar --scene C --law polynomial --times 0.01", ["law", "times or speeds"]),  # leaves the path
]


@pytest.mark.parametrize(("command", "words"), NO_ANSWERS, ids=[command for command, _ in NO_ANSWERS])
def test_where_the_answer_is_no_the_exit_code_is_1(refusal, tmp_path, command, words):
    out = ["--out", tmp_path / "out"] if command.startswith("plan") else []
    message = refusal(1, *command.split(), *out)
    for word in words:
        assert word in message
    assert list(tmp_path.iterdir()) == []


SLOW = pytest.mark.slow  # all commands take the same search


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [["check"], pytest.param(["locate"], marks=SLOW), pytest.param(["plan", "--scene", "C"], marks=SLOW)],
)
def test_loops_that_cannot_close_are_no_answer(refusal, write_robot, command):
    far = write_robot(urdf=(('xyz="0.2 0 0"', 'xyz="1.4 0 0"'),))  # motors 1.6 m apart, 1 m of links
    name, *options = command
    message = refusal(1, name, far, *options)
    assert "my_robot: the loops do not close" in message
    assert "tip." in message


# ------------------------------------------------------------------ what was given cannot be right


# command, words of the complaint
MISUSE = [
    ("fly", ["'fly'", "robots", "plan"]),
    ("help convrt", ["'convrt'", "did you mean 'convert'?"]),
    ("show five_bar --html film.html --port 8000", ["--port", "served page", "try: crossing show five_bar"]),
    ("show five_bar --port 65536", ["--port", "at most 65535", "'65536'"]),
    ("export five_bar --to mjcf --out a.xml --sample 3", ["did you mean --samples?"]),
    ("robots five_bar", ["unrecognized arguments: five_bar"]),
    ("check", ["ROBOT"]),
    ("check five_baar", ["unknown robot 'five_baar'", "did you mean 'five_bar'", "five_bar_heavy", ".yaml"]),
    ("check missing.yaml", ["missing.yaml", "cannot read"]),
    ("check five_bar --scene C", ["unrecognized arguments: --scene C"]),
    ("check five_bar --flexibility soft", ["--flexibility", "'soft'", "flexible_links"]),
    ("plan five_bar --flexibility", ["--flexibility", "expected one argument"]),
    ("plan five_bar --scene C --flex rigid", ["unrecognized arguments: --flex", "--flexibility?"]),
    ("plan five_bar --scene C --fast", ["unrecognized arguments: --fast"]),
    ("plan five_bar --scene C --geometry round", ["--geometry", "'round'", "rigid", "deformed"]),
    ("plan five_bar --scene D", ["unknown scene 'D'", "A, B, C, C-printed, bow"]),
    ("plan five_bar", ["--scene", "--from", "C-printed"]),
    ("locate five_bar --from 0.1 0.345", ["--from and --to"]),
    ("locate five_bar --scene C --from 0.1 0.345", ["--scene", "--from"]),
    ("locate five_bar --from 0.1 --to 0 0.2", ["--from", "2 finite numbers", "x, y", "got [0.1]"]),
    ("locate five_bar --from 0.1 0.345 --to 0 0.2 0", ["--to", "2 finite numbers", "got [0.0, 0.2, 0.0]"]),
    ("locate five_bar --from 0.1 nan --to 0 0.2", ["--from", "finite", "nan"]),
    ("locate five_bar --from 0.1 y --to 0 0.2", ["--from", "'y'"]),
    ("locate five_bar --from 0.1 0.345 --to 0.1 0.345", ["0.345", "same"]),
    ("plan five_bar --from 0.1 0.345 --to 0 0.3", ["--duration", "--longest"]),
    ("plan five_bar --scene C --duration 0", ["duration", "positive", "0"]),
    ("plan five_bar --scene C --longest -1", ["longest", "positive", "-1"]),
    ("plan five_bar --scene C --time-limit 0", ["time_limit", "positive", "0"]),
    ("plan five_bar --scene C --duration long", ["--duration", "'long'"]),
    ("plan five_bar --scene C --times 0", ["times", "t = 0 s", "(0, 1.5)"]),
    ("plan five_bar --scene C --times 0.9 1.1", ["times", "got 2 (0.9, 1.1)", "1 singular point", "0.667"]),
    ("plan five_bar --scene C --speeds 0", ["speeds", "greater than zero", "0"]),
    ("plan five_bar --scene A --speeds 1.0", ["speeds", "got 1 (1)", "0 singular points"]),
    ("plan five_bar --scene C --smoothness 1", ["smoothness", "got 1", "2 .. "]),
    ("plan five_bar --scene C --flexibility flexible_joints --smoothness 3", ["smoothness", "got 3", "4 .."]),
    ("plan five_bar --scene C --smoothness 2.5", ["--smoothness", "'2.5'"]),
    ("plan five_bar --scene C --samples 1", ["samples", "at least 2", "1"]),
    ("plan five_bar --scene C --samples many", ["--samples", "'many'"]),
    ("plan five_bar --scene C --raw --samples 2", ["samples", "at least 5", "2"]),
    ("plan five_bar --scene C --out", ["--out", "expected one argument"]),
]


@pytest.mark.parametrize(("command", "words"), MISUSE, ids=[command for command, _ in MISUSE])
def test_misuse_has_exit_code_2_and_is_told_in_one_line(refusal, command, words):
    message = refusal(2, *command.split())
    for word in words:
        assert word in message


def test_a_count_of_times_is_checked_before_anything_is_written(refusal, tmp_path):
    refusal(2, *PLAN, "--scene", "C", "--times", "0.9", "1.1", "--out", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["file", "file/below"])
@pytest.mark.parametrize("raw", [[], ["--raw"]])
def test_an_out_that_cannot_be_written_is_told(refusal, tmp_path, place, raw):
    (tmp_path / "file").write_text("mine")
    message = refusal(2, *PLAN, "--scene", "C", *raw, "--out", tmp_path / place)
    assert "--out" in message
    assert str(tmp_path / place) in message
    assert (tmp_path / "file").read_text() == "mine"


def test_a_malformed_robot_file_or_urdf_is_misuse(refusal, write_robot):
    assert "springs[0].stiffness" in refusal(2, "check", write_robot(("springs.0.stiffness", 0)))
    assert "mass" in refusal(2, "check", write_robot(urdf=(('<mass value="10"/>', ""),)))


@pytest.mark.slow
@pytest.mark.usefixtures("quick_figures")
def test_the_quickest_way_is_planned_simulated_and_reported(crossing, tmp_path):
    folder = tmp_path / "quick"
    limits = ("--optimize", "time", "--torque-limit", 0.165, "--margin", "10%")
    code, out, _ = crossing("plan", "five_bar", "--scene", "C", *limits, "--out", folder)
    assert code == 0
    assert "optimal law over" in out
    saved = json.loads((folder / "plan.json").read_text())
    assert saved["law"]["kind"] == "optimal"
    assert max(saved["peak_torque"].values()) <= 0.9 * 0.165
    assert crossing("simulate", folder)[0] == 0
    assert crossing("report", folder)[0] == 0
    page = (folder / "report.html").read_text()
    for option in ("optimize='time'", "torque_limit=(0.165,)", "margin=0.1"):
        assert option in unescape(page)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--margin", "ten"), "--margin: needs a share"),
        (("--law", "optimal", "--raw"), "--raw samples the polynomial"),
        (("--optimize", "time"), "torque_limit or speed_limit is needed"),
        (("--law", "polynomial", "--torque-limit", 1.0), "for the optimal law"),
    ],
)
def test_options_of_the_laws_that_do_not_go_together(refusal, options, words):
    assert words in refusal(2, "plan", "five_bar", "--scene", "C", *options)


@pytest.mark.parametrize(
    ("command", "same"), [([], ["--help"]), (["help"], ["--help"]), (["help", "plan"], ["plan", "--help"])]
)
def test_help_is_no_misuse(capfd, command, same):
    texts = []
    for arguments in (command, same):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 0
        texts.append(capfd.readouterr().out)
    assert texts[0] == texts[1]
    assert "plan" in texts[0]


def test_the_version_has_a_short_option(capfd):
    with pytest.raises(SystemExit) as caught:
        main(["-V"])
    assert caught.value.code == 0
    assert capfd.readouterr().out == f"crossing {version('parallel-singularity-crossing')}\n"


# ------------------------------------------------------------------ in a process of its own


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["plan", "five_bar", "--scene", "C", "--json"], 0),
        pytest.param(["plan", "five_bar", "--scene", "B", "--json"], 1, marks=pytest.mark.slow),
        (["plan", "five_bar", "--scene", "nowhere", "--json"], 2),
    ],
)
def test_python_m_framework_is_the_same_program(tmp_path, arguments, code):
    done = subprocess.run(
        [sys.executable, "-m", "framework", *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == code
    assert list(tmp_path.iterdir()) == []
    if code == 0:
        assert list(json.loads(done.stdout)) == PLAN_KEYS
        assert done.stderr == ""
    else:
        assert done.stderr == f"crossing: {json.loads(done.stdout)['error']['message']}\n"
        assert done.stderr.count("\n") == 1


def test_a_plan_of_a_small_robot_waits_for_no_scipy():
    """Its import takes longer than the plan."""
    command = [sys.executable, "-X", "importtime", "-m", "framework", *PLAN, "--scene", "C"]
    done = subprocess.run(command, capture_output=True, text=True)
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert done.returncode == 0
    assert "framework.planning.plan" in imported
    assert not {name for name in imported if name.startswith("scipy")}


def test_a_reader_that_has_seen_enough_gets_no_traceback():
    command = [sys.executable, "-m", "framework", "check", "five_bar"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        running.stdout.close()  # as `| head -1` does, long before the program writes
        assert running.stderr.read() == ""


@pytest.mark.parametrize(("scene", "reason"), [("C", "Broken pipe"), ("none", "unknown scene")])
def test_json_that_its_reader_has_left_is_no_answer(scene, reason):
    with subprocess.Popen(
        [sys.executable, "-m", "framework", *PLAN, "--scene", scene, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        running.stdout.close()
        (line,) = running.stderr.read().splitlines()
    assert reason in line
    assert running.returncode == 2


# ------------------------------------------------------------------ springs that there are, or not


def test_locate_says_how_the_springs_move_the_singular_points(crossing, document):
    options = ["locate", "five_bar", "--scene", "C", "--flexibility"]
    rigid, links = document(*options, "rigid"), document(*options, "flexible_links")
    (at_rest,), (point,) = rigid["singularities"], links["singularities"]
    assert (rigid["flexibility"], links["flexibility"]) == ("rigid", "flexible_links")
    assert point["s"] == pytest.approx(at_rest["s"], abs=1e-12)  # springs at rest
    assert at_rest["shift"] == {}
    assert list(point["shift"]) == ["left_drive", "right_drive", "left_rod", "right_rod"]
    assert [abs(rate) > 0.1 for rate in point["shift"].values()] == [False, False, True, True]
    assert "springs at rest" in crossing(*options, "flexible_links")[1]


@pytest.mark.parametrize(
    ("kept", "asked", "label"),
    [
        ((), "flexible_links", "rigid"),
        ((), "flexible_joints", "rigid"),
        (("link",), "flexible_joints", "rigid"),
        (("joint",), "flexible_links", "flexible_joints"),
    ],
)
@pytest.mark.parametrize("command", ["check", "locate", "plan"])
def test_a_flexibility_without_springs_is_told_and_not_claimed(
    document, crossing, write_robot, command, kept, asked, label
):
    springs = yaml.safe_load(FIVE_BAR.read_text(encoding="utf-8"))["springs"]
    chosen = [spring for spring in springs if spring["part"] in kept]
    file = write_robot(("springs", chosen or REMOVED))
    options = [command, file, *(["--scene", "C"] if command != "check" else []), "--flexibility", asked]
    found = document(*options)
    assert found["flexibility"] == label
    (warning,) = found["warnings"]
    assert asked in warning
    assert warning.endswith(f"taken as {label}")
    assert crossing(*options)[1].endswith(f"  warning           {warning}\n")


def test_a_flexibility_with_springs_is_no_cause_for_a_warning(document):
    assert "warnings" not in document("check", "five_bar", "--flexibility", "flexible_links")


@pytest.mark.parametrize(
    "options",
    [
        ["--torque-limit", 0.165],
        ["--torque-limit", 0.165, "--times", 1, "--speeds", 1.5],
        ["--law", "optimal"],
    ],
)
def test_times_of_a_scene_that_limits_alone_leave_out_are_told(document, options):
    found = document("plan", "five_bar", "--scene", "C", *options)
    told = [warning for warning in found.get("warnings", []) if "--times 1 --speeds 1.5" in warning]
    assert len(told) == (options == ["--torque-limit", 0.165])
    if "--times" in options:
        assert found["crossings"][0]["time"] == pytest.approx(1.0)


def test_what_is_about_an_earlier_plan_goes_with_it(tmp_path, capsys, monkeypatch):
    def save_eye(plan, folder) -> None:  # drawn where there is a crossing
        if plan.crossings:
            (folder / "eye.png").touch()

    monkeypatch.setattr("framework.show.plots.save_figures", save_eye)
    out = tmp_path / "move"
    main(["plan", "five_bar", "--scene", "C", "--out", str(out)])
    assert "replaces" not in capsys.readouterr().out
    for name in ("report.html", "torques.pdf", "notes.txt"):
        (out / name).write_text("of scene C")
    assert (out / "eye.png").exists()
    main(["plan", "five_bar", "--scene", "A", "--out", str(out)])
    assert "replaces the plan of five_bar over 1.5 s" in capsys.readouterr().out
    left = {file.name for file in out.iterdir()}
    assert "notes.txt" in left
    assert not left & {"report.html", "torques.pdf", "eye.png"}


def test_figures_are_replaced_only_where_the_earlier_plan_had_some(tmp_path, capsys, monkeypatch):
    """A folder of `save_plan` has none; `plan --out` draws some."""
    monkeypatch.setattr("framework.show.plots.save_figures", lambda _, folder: (folder / "law.png").touch())
    save_plan(plan_scene(robots.load("five_bar"), "A"), tmp_path)
    for end in ("replaces the plan of five_bar over 1.5 s\n", "over 1.5 s and its figures\n"):
        main(["plan", "five_bar", "--scene", "A", "--out", str(tmp_path)])
        assert capsys.readouterr().out.endswith(end)


@pytest.mark.usefixtures("quick_figures")
def test_what_nobody_planned_stays(tmp_path):
    (tmp_path / "report.html").write_text("mine")
    main(["plan", "five_bar", "--scene", "A", "--out", str(tmp_path)])
    assert (tmp_path / "report.html").read_text() == "mine"


def test_values_of_a_repeated_option_are_joined():
    words = ["plan", "five_bar", "--times", "1", "--times", "2", "3", "--duration", "4", "--duration", "5"]
    options = parser_of(words).parse_args(words)
    assert (options.times, options.duration) == ([1.0, 2.0, 3.0], 5.0)
    words = [
        "robustness",
        "move",
        "--controller",
        "lqr",
        "--sensors",
        "motors",
        "--controller",
        "feedforward",
    ]
    options = parser_of(words).parse_args(words)
    assert (options.controller, options.sensors) == (["lqr", "feedforward"], ["motors"])


def test_parameters_may_stand_before_the_robot():
    options = parser_of(["check"]).parse_args(["check", "--set", "a=1", "b=2", "five_bar", "--json"])
    assert (options.robot, options.set, options.json) == ("five_bar", ["a=1", "b=2"], True)


def test_unknown_columns_are_refused_before_planning(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("framework.cli.plan.plan_or_advise", None)
    words = ["plan", "five_bar", "--scene", "C", "--columns", "tim", "--out", str(tmp_path / "plan")]
    assert main(words) == 2
    assert "unknown column 'tim'; did you mean 'time'?" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_lesson_takes_the_duration_that_is_typed(tmp_path, monkeypatch):
    durations = []
    monkeypatch.setattr(
        "framework.show.lesson.lesson_page", lambda *_, duration, name: durations.append(duration) or name
    )
    words = ["export", "five_bar", "--scene", "C", "--to", "lesson", "--out", str(tmp_path / "page.html")]
    words.append("--overwrite")  # the page of this test does not name the program
    assert main([*words, "--duration", "2"]) == main(words) == 0
    assert durations == [2.0, 1.5]
