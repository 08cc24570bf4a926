"""`crossing check` and `crossing convert` on files of foreign dialects."""

import json
import math
from pathlib import Path

import pytest

from framework.model import read_robot_file

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


def test_a_platform_of_too_few_coordinates_is_converted_for_check_to_explain(crossing, tmp_path):
    said = ["--platform", "tip_predecessor", "--axes", "x", *SAID[-3:]]
    assert crossing("convert", PLUS, *said, "--out", str(tmp_path))[0] == 0


def test_convert_says_itself_that_loops_stay_open(crossing, tmp_path):
    """A rod of 5 m between two tips that are 2.7 m apart at most; platform and motors are stated."""
    said = ["--platform", "left_tip", "--axes", "x", "y", *SAID[-3:], "--out", str(tmp_path), "--json"]
    bare = str(Path(__file__).parents[1] / "urdf" / "five_bar" / "five_bar.urdf")
    code, out, _ = crossing("convert", bare, "--close", "left_tip", "right_tip", "distance", "5", *said)
    written, (remark,) = (json.loads(out)[key] for key in ("file", "remarks"))
    assert code == 0
    assert remark.startswith("NOT ASSEMBLED, so that nothing can be planned yet: the loops do not close")
    assert remark in Path(written).read_text()
    assert crossing("check", written)[0] == 1


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


INERTIA = '<inertial pos="0.05 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>'
CRANK_ROCKER = f"""<mujoco model="bars"><compiler angle="radian"/><worldbody>
<body name="crank"><joint name="crank" axis="0 1 0"/>{INERTIA}
<body name="coupler" pos="0.1 0 0"><joint name="coupler" axis="0 1 0"/>{INERTIA}
<site name="end" pos="0.22 0 0"/></body></body>
<body name="rocker" pos="0.25 0 0"><joint name="rocker" axis="0 1 0"/>{INERTIA}
<site name="pin" pos="0.2 0 0"/></body></worldbody>
<equality><connect site1="end" site2="pin"/></equality>
<actuator><motor joint="crank"/></actuator>KEY</mujoco>"""


def rocker_at(angle, sign):
    """Angle of the rocker for one of the crank: circles of 0.22 about its end and 0.2 about the pivot."""
    x, z = 0.1 * math.cos(angle) - 0.25, -0.1 * math.sin(angle)
    length = math.hypot(x, z)
    between = math.acos((length**2 + 0.2**2 - 0.22**2) / (2 * 0.2 * length))
    return math.remainder(-(math.atan2(z, x) + sign * between), math.tau)


def test_a_reference_that_convert_chooses_is_away_from_singularities_and_the_other_mode_is_told(
    crossing, tmp_path
):
    """The rocker turns between +-acos of the stretched bars, 1.572 rad, where it is at Type 1."""
    file = tmp_path / "bars.xml"
    file.write_text(CRANK_ROCKER.replace("KEY", ""))
    code, out, _ = crossing("convert", str(file), "--out", str(tmp_path / "out"), "--json")
    remarks = json.loads(out)["remarks"]
    assert (code, any("from a Type 1 singularity" in remark for remark in remarks)) == (0, True)
    reference = read_robot_file(tmp_path / "out" / "bars.yaml").reference
    limit = math.acos((0.25**2 + 0.2**2 - 0.32**2) / (2 * 0.25 * 0.2))  # between rocker and ground
    assert abs(reference["rocker"]) > math.pi - limit + 0.05
    (mode,) = [remark for remark in remarks if remark.startswith("mode:")]
    words = mode.split(", with ")[1].split()
    code, out, _ = crossing("convert", str(file), *words, "--out", str(tmp_path / "other"), "--json")
    other = read_robot_file(tmp_path / "other" / "bars.yaml").reference
    assert other["crank"] == pytest.approx(reference["crank"], abs=1e-5)
    expected = sorted(rocker_at(reference["crank"], sign) % math.tau for sign in (1, -1))
    assert sorted(each["rocker"] % math.tau for each in (reference, other)) == pytest.approx(
        expected, abs=1e-4
    )


def test_a_reference_that_the_file_states_stays_beside_a_singularity_and_the_remedy_leads_away(
    crossing, tmp_path
):
    file = tmp_path / "bars.xml"
    file.write_text(CRANK_ROCKER.replace("KEY", '<keyframe><key qpos="-0.57 -0.15 -1.5767"/></keyframe>'))
    _, out, _ = crossing("convert", str(file), "--out", str(tmp_path / "out"), "--json")
    assert read_robot_file(tmp_path / "out" / "bars.yaml").reference["rocker"] == pytest.approx(
        -1.577, abs=1e-3
    )
    (remark,) = [remark for remark in json.loads(out)["remarks"] if "farther is" in remark]
    words = remark.split("farther is ")[1].split()
    _, out, _ = crossing("convert", str(file), *words, "--out", str(tmp_path / "far"), "--json")
    assert not any("singularity" in remark for remark in json.loads(out)["remarks"])
