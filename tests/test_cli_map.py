"""`crossing map`: what it tells and writes, and maps that are killed and begun again."""

import json
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.atlas.map_files import setup_document
from framework.atlas.quantities import choose_quantities
from framework.atlas.survey import Window
from framework.atlas.workspace_map import workspace_map
from framework.cli import main
from tests.maps_in_processes import FILES, begun, files, kept


@pytest.mark.slow
def test_a_map_is_told_and_written(document, tmp_path):
    told = document("map", "five_bar", "--scene", "C", "--size", 12, "--quantity", "g", "--out", tmp_path)
    assert sum(told["poses"].values()) == 144
    assert set(told["quantities"]) == {"g"}
    assert len(told["robot_hash"]) == 64
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {*FILES, "map.html", "map_g.pdf", "map_g.png"}
    with np.load(tmp_path / "map.npz") as arrays:
        assert arrays["g"].shape == (12, 12)
    lines = (tmp_path / "map.csv").read_text().splitlines()
    assert lines[0] == "x,y,reached,assembly_mode,g"
    assert len(lines) == 145
    assert json.loads((tmp_path / "map.json").read_text()) == {
        key: told[key] for key in told if key != "seconds"
    }


@pytest.mark.slow
def test_a_map_of_a_slice_holds_the_other_coordinates(document):
    told = document(
        "map", "three_rpr", "--over", "x", "rz", "--at", 0, 0.1, 0.2, "--size", 6, "--quantity", "g"
    )
    assert told["axes"] == ["x", "rz"]
    assert told["held"] == {"y": 0.1}


@pytest.mark.slow
def test_the_margin_of_a_pose_is_told_with_its_status(document):
    told = document("map", "five_bar", "--size", 5, "--quantity", "g", "--nearest", 0, 0.3)
    found = told["nearest_singular_pose"]
    assert found["distance"] == pytest.approx(0.3 - np.sqrt(0.06), rel=1e-9)  # straight below, on the locus
    assert 0.99 < found["at_least"] / found["distance"] <= 1
    assert "at most 0.05505" in found["status"]
    within = document(
        "map", "five_bar", "--size", 5, "--quantity", "g", "--nearest", 0, 0.3, "--within", 0.03
    )
    assert within["nearest_singular_pose"]["at_least"] == pytest.approx(0.03)


def test_what_is_kept_of_a_map_is_named_by_the_working_mode_too():
    described = robots.load("five_bar").description
    given = described.reference  # the left leg turned over, about the line from its base to the tip
    turned = given["left_motor"] + given["left_elbow"]
    other = {**given, "left_motor": turned, "left_elbow": -given["left_elbow"]}
    window, keys = Window((0, 1), np.array([0.0, 0.25]), np.array([0.05, 0.3]), (4, 4), np.zeros(2)), ()
    setups = []
    for reference in (described.reference, other):
        robot = ParallelRobot.from_description(replace(described, reference=reference))
        setups.append(setup_document(robot, window, choose_quantities(robot, keys)))
    assert setups[0]["robot_hash"] == setups[1]["robot_hash"]
    assert setups[0] != setups[1]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["four_bar", "--over", "x", "y"], "rz alone"),
        (["four_bar", "--window", "0", "1", "0", "1"], "--window"),
        (["five_bar", "--quantity", "beauty"], "unknown quantity"),
        (["five_bar", "--over", "x", "z"], "axes of a map"),
        (["five_bar", "--window", "1", "0", "0", "1"], "window"),
        (["five_bar", "--window", "0", "1", "0", "inf"], "--window"),
        (["five_bar", "--window", "-1000", "1000", "-1000", "1000"], "lengths are in m"),
        (["five_bar", "--at", "1"], "at"),
        (["five_bar", "--out", ""], "--out"),
        (["five_bar", "--nearest", "1"], "platform coordinates"),
        (["five_bar", "--scene", "Z"], "unknown scene"),
        (
            ["humanoid_ankle", "--keep-limits", "--window", "0.2", "0.3", "0.2", "0.3"],
            "contain the reference",
        ),
    ],
)
def test_misuse_is_told_in_one_line(refusal, arguments, complaint):
    assert complaint in refusal(2, "map", *arguments)


@pytest.mark.slow
def test_a_map_that_is_stopped_says_what_is_kept_and_goes_on(crossing, tmp_path, monkeypatch):
    module, count = sys.modules[workspace_map.__module__], []
    filled = module.fill_band

    def stopped(*given):
        if len(count) == 2:
            raise KeyboardInterrupt
        count.append(given[3].name)
        return filled(*given)

    command = ("map", "five_bar", "--size", 40, "--quantity", "g", "--out", tmp_path)  # three bands
    monkeypatch.setattr(module, "fill_band", stopped)
    code, _, err = crossing(*command)
    assert code == 130
    assert "2 bands are kept" in err
    monkeypatch.setattr(module, "fill_band", lambda *given: count.append(given[3].name) or filled(*given))
    assert crossing(*command)[0] == 0
    assert len(count) == len(set(count)) == 3
    assert not kept(tmp_path)


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    out = tmp_path_factory.mktemp("maps") / "serial"
    assert begun(out).wait() == 0
    return files(out)


@pytest.mark.slow
def test_a_map_that_is_killed_goes_on_and_computes_nothing_twice(serial, tmp_path):
    killed = tmp_path / "killed"
    assert begun(killed, lasts=3).wait() == -signal.SIGKILL
    there = {file: file.stat().st_mtime_ns for file in kept(killed)}
    assert len(there) == 3
    assert begun(killed).wait() == 0
    assert len(kept(killed)) == 8  # of 120 columns
    # a band that is computed is written: those that were there have not been
    assert {file: file.stat().st_mtime_ns for file in there} == there
    assert files(killed) == serial


@pytest.mark.slow
def test_processes_give_the_same_files_bit_by_bit(serial, tmp_path):
    assert begun(tmp_path / "two", workers=2).wait() == 0
    assert files(tmp_path / "two") == serial


@pytest.mark.slow
def test_a_map_that_keeps_limits_says_beyond_which_range_a_pose_is(tmp_path, capsys):
    command = ["map", "humanoid_ankle", "--keep-limits", "--size", "20", "--wrench", "35", "10"]
    assert main([*command, "--out", str(tmp_path), "--json"]) == 0
    poses = json.loads(capsys.readouterr().out)["poses"]
    assert poses["reached"] > 0
    assert poses["beyond the range of ankle_roll"] > 0
    assert poses["beyond the torque limits at rest"] > 0
    assert sum(poses.values()) == 400
    assert "beyond the range of ankle_roll" in (tmp_path / "map.csv").read_text()
    with np.load(tmp_path / "map.npz") as arrays:
        assert list(arrays["reason_words"]) == list(poses)
        assert np.isfinite(arrays["holding"]).sum() == poses["reached"]


@pytest.mark.slow
def test_limits_of_torque_are_kept_whatever_is_mapped(capsys):
    command = ["map", "humanoid_ankle", "--keep-limits", "--size", "12", "--wrench", "35", "10", "--json"]
    counts = []
    for quantity in ([], ["--quantity", "conditioning"]):
        assert main([*command, *quantity]) == 0
        counts.append(json.loads(capsys.readouterr().out)["poses"])
    assert counts[0] == counts[1]
    assert counts[0]["beyond the torque limits at rest"] > 0
    assert main([*command[:-3], "300", "100", "--json"]) == 1
    assert "no pose of the map within one step of the reference" in capsys.readouterr().err
