"""`crossing fidelity` and `crossing plan --flexibility auto`: what they print, write and refuse."""

import json
import re
from dataclasses import replace

import pytest

import robots
from framework import fidelity_study

NAMES = [
    *("kinematics", "payload", "rigid", "flexible_joints", "flexible_links"),
    *("deformed", "elastic_inertia"),
]


def test_the_table_has_a_line_a_level_and_names_the_least(crossing):
    code, text, _ = crossing("fidelity", "five_bar", "--scene", "C", "--tolerance", "1%")
    assert code == 0
    lines = text.splitlines()
    assert [line.split()[0] for line in lines[2:] if line.split()[0] in NAMES] == NAMES
    assert "  enough            payload: " in text
    assert "fidelity: {level: payload, tolerance: 0.01}" in text
    assert max(map(len, lines)) <= 150


def test_numbers_and_a_figure_are_written_together(document, tmp_path, monkeypatch):
    # figures take seconds: tests/show draws this one, here a note stands for it
    monkeypatch.setattr(
        "framework.show.plots.save_figure", lambda _, stem: stem.with_suffix(".png").write_text("figure")
    )
    out = tmp_path / "study"
    told = document("fidelity", "five_bar", "--scene", "A", "--tolerance", "0.001", "--out", out)
    assert told == json.loads((out / "fidelity.json").read_text())
    assert [entry["level"] for entry in told["levels"]] == NAMES
    assert {path.name for path in out.iterdir()} == {"fidelity.json", "fidelity.png"}
    least = next(entry for entry in told["levels"] if entry["enough"])
    assert told["fidelity"] == {"level": least["level"], "tolerance": 0.001}
    assert max(least["torque"], least["platform"]) <= 0.001


@pytest.mark.slow
def test_another_motion_than_that_of_the_scene_is_nothing_to_keep(document):
    assert "fidelity" not in document("fidelity", "five_bar", "--scene", "A", "--duration", "3")


def test_no_level_enough_is_an_answer_with_its_table(crossing, monkeypatch):
    study = replace(fidelity_study(robots.load("five_bar"), "A"), tolerance=1e-15)
    monkeypatch.setattr("framework.cli.fidelity.fidelity_study", lambda *_, **__: study)
    code, text, err = crossing("fidelity", "five_bar", "--scene", "A")
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
def test_what_is_refused_is_told_in_one_line(refusal, arguments, code, words):
    assert words in refusal(code, "fidelity", "five_bar", *arguments)


def test_auto_plans_with_what_the_scene_keeps(document, crossing):
    told = ["plan", "five_bar", "--scene", "C"]
    auto = document(*told, "--flexibility", "auto")
    same = document(*told, "--flexibility", "rigid", "--smoothness", "4")
    kept = {"level": "payload", "tolerance": 0.01, "simulated": True, "error": None}
    assert auto.pop("fidelity") == kept
    assert {**auto, "seconds": 0} == {**same, "seconds": 0}
    text = crossing("plan", "five_bar", "--scene", "C", "--flexibility", "auto")[1]
    assert "payload is enough for 1 %, as the scene keeps" in text


@pytest.mark.parametrize(
    "motion",
    [
        "--scene C --duration 2 --times 1.3 --speeds 1",
        pytest.param("--from 0.1 0.345 --to 0 0.3 --duration 1", marks=pytest.mark.slow),
    ],
)
def test_auto_predicts_what_no_scene_keeps(document, crossing, motion):
    told = ["plan", "five_bar", *motion.split(), "--flexibility", "auto"]
    fidelity = document(*told)["fidelity"]
    assert fidelity["level"] == "payload"
    assert not fidelity["simulated"]
    assert 0.0 < fidelity["error"] <= fidelity["tolerance"] == 0.01
    assert re.search(r"payload for 1 %, off by .* %: predicted, not simulated", crossing(*told)[1])


def test_auto_of_a_motion_that_no_model_can_make_is_refused_as_any(refusal):
    assert "unbounded torque" in refusal(1, "plan", "five_bar", "--scene", "B", "--flexibility", "auto")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--scene", "none"), "unknown scene 'none'"),
        ((), "give either --scene"),
        (("--scene", "C", "--bend"), "--bend: the level"),
        (("--scene", "C", "--geometry", "rigid"), "--geometry: each level"),
    ],
)
def test_what_auto_cannot_take_is_told(refusal, arguments, words):
    assert words in refusal(2, "plan", "five_bar", *arguments, "--flexibility", "auto")


def test_other_commands_know_no_auto(refusal):
    err = refusal(2, "simulate", "five_bar", "--scene", "C", "--flexibility", "auto")
    assert "invalid choice: 'auto'" in err


def test_a_level_that_there_is_not_is_told_with_its_place(refusal, tmp_path):
    for suffix in (".yaml", ".urdf"):
        text = robots.CATALOGUE["five_bar"].file.with_suffix(suffix).read_text()
        (tmp_path / f"five_bar{suffix}").write_text(text.replace("level: payload", "level: playload"))
    err = refusal(2, "check", tmp_path / "five_bar.yaml")
    assert "scenes.A.fidelity.level: unknown level 'playload'; did you mean 'payload'?" in err
