"""`crossing check` and `crossing convert` on files of foreign dialects."""

import json
from pathlib import Path

import pytest

DATA = Path(__file__).parent / "data" / "dialects"
PLUS = str(DATA / "five_bar_plus.urdf")
SAID = ["--platform", "tip_predecessor", "--axes", "x", "y", "--motors", "left_motor", "right_motor"]
POSE = ["left_motor=1.271863", "left_elbow=-0.83362", "right_motor=1.083625", "right_elbow=1.538591"]
CASES = [
    ("five_bar_plus.urdf", SAID),
    ("five_bar_ros.urdf", ["--platform", "tip_parent", "--axes", "x", "y", "--reference", *POSE]),
    ("gepetto", ["--platform", "tip_A", "--axes", "x", "y"]),
    ("five_bar_sites.xml", ["--platform", "left_tip", "--axes", "x", "y"]),
    ("five_bar_anchor.xml", ["--platform", "tip", "--axes", "x", "y"]),
]


@pytest.mark.parametrize(
    ("file", "options"), [CASES[0], *(pytest.param(*case, marks=pytest.mark.slow) for case in CASES[1:])]
)
def test_a_foreign_file_is_checked_converted_and_located(crossing, file, options, tmp_path):
    code, out, _ = crossing("check", str(DATA / file), *options, "--json")
    assert (code, json.loads(out)["mobility"]) == (0, 2)
    code, out, _ = crossing("convert", str(DATA / file), *options, "--out", str(tmp_path), "--json")
    assert code == 0
    written = json.loads(out)["file"]
    line = ["--from", "0.1", "0.345", "--to", "-0.05", "0.195"]
    code, out, _ = crossing("locate", written, *line, "--json")
    assert code == 0
    (found,) = json.loads(out)["singularities"]
    assert found["s"] == pytest.approx(0.667006874764298, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check", PLUS], "the file does not say: give --platform FRAME (of: base"),
        (["check", PLUS, *SAID, "--reference", "left_motor"], "--reference: needs JOINT=VALUE"),
        (
            ["check", PLUS, *SAID, "--reference", "left_motor=inf"],
            "--reference left_motor: needs a finite number",
        ),
        (["check", PLUS, *SAID, "--reference", "elbow=1"], "--reference: unknown movable joint 'elbow'"),
        (["convert", PLUS, *SAID], "required: --out"),
        (["check", "nowhere.sdf"], "nowhere.sdf: cannot read it"),
        (["check", str(DATA)], "a folder without robot.yaml"),
    ],
)
def test_misuse_is_one_line_and_code_2(refusal, arguments, message):
    assert message in refusal(2, *arguments)


def test_convert_says_the_size_of_dry_friction_with_its_unit(crossing, tmp_path):
    _, out, _ = crossing("convert", str(DATA / "five_bar_defaults.xml"), "--out", str(tmp_path))
    friction = next(line for line in out.splitlines() if "dry friction" in line)
    assert "no plan counts with it" in friction
    assert all(name in friction for name in ("passive_1", "passive_2"))
    assert "motor_1" not in friction  # that of driven joints is planned with
    assert friction.count("0.1 N m each") == 1


def test_export_says_where_a_simulation_starts(crossing, tmp_path):
    file = tmp_path / "five_bar.xml"
    code, out, _ = crossing("export", "five_bar", "--to", "mjcf", "--out", str(file))
    assert code == 0
    assert all("start from the keyframe `reference`" in text for text in (out, file.read_text()))
