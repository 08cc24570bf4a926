"""`crossing fidelity` and `crossing plan --flexibility auto`: what they print, write and refuse."""

import json
import re
from dataclasses import replace

import pytest

import robots
from framework import fidelity_study
from framework.cli import main

NAMES = [
    *("kinematics", "payload", "rigid", "flexible_joints", "flexible_links"),
    *("deformed", "elastic_inertia"),
]


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def test_the_table_has_a_line_a_level_and_names_the_least(capsys):
    code, text, _ = run(capsys, "fidelity", "five_bar", "--scene", "C", "--tolerance", "1%")
    assert code == 0
    lines = text.splitlines()
    assert [line.split()[0] for line in lines[2:] if line.split()[0] in NAMES] == NAMES
    assert "  enough            payload: " in text
    assert "fidelity: {level: payload, tolerance: 0.01}" in text
    assert max(map(len, lines)) <= 150


def test_numbers_and_a_figure_are_written_together(capsys, tmp_path, monkeypatch):
    # figures take seconds: tests/show draws this one, here a note stands for it
    monkeypatch.setattr(
        "framework.show.plots.save_figure", lambda _, stem: stem.with_suffix(".png").write_text("figure")
    )
    out = tmp_path / "study"
    code, text, err = run(
        capsys, "fidelity", "five_bar", "--scene", "A", "--tolerance", "0.001", "--json", "--out", out
    )
    assert (code, err) == (0, "")
    document = json.loads(text)
    assert document == json.loads((out / "fidelity.json").read_text())
    assert [entry["level"] for entry in document["levels"]] == NAMES
    assert {path.name for path in out.iterdir()} == {"fidelity.json", "fidelity.png"}
    least = next(entry for entry in document["levels"] if entry["enough"])
    assert document["fidelity"] == {"level": least["level"], "tolerance": 0.001}
    assert max(least["torque"], least["platform"]) <= 0.001


@pytest.mark.slow
def test_another_motion_than_that_of_the_scene_is_nothing_to_keep(capsys):
    code, text, _ = run(capsys, "fidelity", "five_bar", "--scene", "A", "--duration", "3", "--json")
    assert code == 0
    assert "fidelity" not in json.loads(text)


def test_no_level_enough_is_an_answer_with_its_table(capsys, monkeypatch):
    study = replace(fidelity_study(robots.load("five_bar"), "A"), tolerance=1e-15)
    monkeypatch.setattr("framework.cli.fidelity.fidelity_study", lambda *_, **__: study)
    code, text, err = run(capsys, "fidelity", "five_bar", "--scene", "A")
    assert code == 1
    assert "no model is accurate to" in err
    assert err.count("\n") == 1
    assert "elastic_inertia" in text
    assert "to keep" not in text


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--scene", "B"), 1, "unbounded torque"),
        (("--scene", "none"), 2, "unknown scene 'none'"),
        ((), 2, "give either --scene"),
        (("--scene", "C", "--tolerance", "much"), 2, "--tolerance: needs a share"),
        (("--scene", "C", "--tolerance", "0"), 2, "tolerance: needs a share in"),
        (("--scene", "C", "--geometry", "rigid"), 2, "geometry: each level"),
        (("--scene", "C", "--out", ""), 2, "--out"),
    ],
)
def test_what_is_refused_is_told_in_one_line(capsys, arguments, code, words):
    found, out, err = run(capsys, "fidelity", "five_bar", *arguments)
    assert (found, out) == (code, "")
    assert words in err
    assert err.count("\n") == 1


# ------------------------------------------------------------------ plan --flexibility auto


def test_auto_plans_with_what_the_scene_keeps(capsys):
    told = ["plan", "five_bar", "--scene", "C", "--json"]
    auto = json.loads(run(capsys, *told, "--flexibility", "auto")[1])
    same = json.loads(run(capsys, *told, "--flexibility", "rigid", "--smoothness", "4")[1])
    kept = {"level": "payload", "tolerance": 0.01, "simulated": True, "error": None}
    assert auto.pop("fidelity") == kept
    assert {**auto, "seconds": 0} == {**same, "seconds": 0}
    text = run(capsys, "plan", "five_bar", "--scene", "C", "--flexibility", "auto")[1]
    assert "payload is enough for 1 %, as the scene keeps" in text


@pytest.mark.parametrize(
    "motion", ["--scene C --duration 2 --times 1.3 --speeds 1", "--from 0.1 0.345 --to 0 0.3 --duration 1"]
)
def test_auto_predicts_what_no_scene_keeps(capsys, motion):
    told = ["plan", "five_bar", *motion.split(), "--flexibility", "auto"]
    fidelity = json.loads(run(capsys, *told, "--json")[1])["fidelity"]
    assert fidelity["level"] == "payload"
    assert not fidelity["simulated"]
    assert 0.0 < fidelity["error"] <= fidelity["tolerance"] == 0.01
    assert re.search(r"payload for 1 %, off by .* %: predicted, not simulated", run(capsys, *told)[1])


def test_auto_of_a_motion_that_no_model_can_make_is_refused_as_any(capsys):
    code, out, err = run(capsys, "plan", "five_bar", "--scene", "B", "--flexibility", "auto")
    assert (code, out) == (1, "")
    assert "unbounded torque" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--scene", "none"), "unknown scene 'none'"),
        ((), "give either --scene"),
        (("--scene", "C", "--bend"), "--bend: the level"),
        (("--scene", "C", "--geometry", "rigid"), "--geometry: each level"),
    ],
)
def test_what_auto_cannot_take_is_told(capsys, arguments, words):
    code, out, err = run(capsys, "plan", "five_bar", *arguments, "--flexibility", "auto")
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_other_commands_know_no_auto(capsys):
    code, _, err = run(capsys, "simulate", "five_bar", "--scene", "C", "--flexibility", "auto")
    assert code == 2
    assert "invalid choice: 'auto'" in err


def test_a_level_that_there_is_not_is_told_with_its_place(capsys, tmp_path):
    for suffix in (".yaml", ".urdf"):
        text = robots.CATALOGUE["five_bar"].file.with_suffix(suffix).read_text()
        (tmp_path / f"five_bar{suffix}").write_text(text.replace("level: payload", "level: playload"))
    code, _, err = run(capsys, "check", tmp_path / "five_bar.yaml")
    assert code == 2
    assert "scenes.A.fidelity.level: unknown level 'playload'; did you mean 'payload'?" in err
