"""What `check` advises: the closure that locks too much by its name, and springs that planning refuses."""

import re
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import Mechanism, SingularReference, check_robot
from framework.cli import main
from framework.kinematics.diagnostics.regular_reference import STEP, _move
from framework.kinematics.linearised_loops import linearised_at
from framework.model.readers import read_any

GEPETTO = Path(__file__).parents[2] / "data" / "dialects" / "gepetto"

SQUARE = """
<robot name="square">
  <link name="base"/>
  {links}
</robot>
"""
HINGE = """
  <joint name="{joint}" type="revolute">
    <parent link="{parent}"/><child link="{link}"/><origin xyz="{place}"/><axis xyz="0 0 1"/>
    <limit lower="-6" upper="6" effort="1" velocity="1"/>
  </joint>
  <link name="{link}"/>
"""
TIP = """
  <joint name="{link}_end" type="fixed">
    <parent link="{link}"/><child link="{link}_tip"/><origin xyz="{place}"/>
  </joint>
  <link name="{link}_tip"/>
"""


def square(tmp_path, kind):
    """A parallelogram of two cranks and a coupler, one metre each: one degree of freedom."""
    links = [
        HINGE.format(joint="left", parent="base", link="left_crank", place="0 0 0"),
        HINGE.format(joint="top", parent="left_crank", link="coupler", place="0 1 0"),
        HINGE.format(joint="right", parent="base", link="right_crank", place="1 0 0"),
        TIP.format(link="coupler", place="1 0 0"),
        TIP.format(link="right_crank", place="0 1 0"),
    ]
    (tmp_path / "square.urdf").write_text(SQUARE.format(links="".join(links)))
    file = tmp_path / "square.yaml"
    file.write_text(
        f"""
version: 1
urdf: square.urdf
platform: {{frame: coupler_tip, axes: [x]}}
actuators: [{{joint: left}}]
closures: [{{name: corner, frames: [coupler_tip, right_crank_tip], kind: {kind}}}]
reference: {{left: 0, top: 0, right: 0}}
"""
    )
    return Mechanism.from_file(file)


def test_a_closure_that_locks_the_robot_is_named(tmp_path):
    found = check_robot(square(tmp_path, "fixed"))
    assert found.mobility == 0
    assert any("look at corner first" in advice for advice in found.advice)


def test_the_right_closure_is_no_suspect(tmp_path):
    found = check_robot(square(tmp_path, "revolute"))
    assert found.mobility == 1
    assert not any("look at" in advice for advice in found.advice)
    assert any(
        "corner.z" in advice and "other loop equations say the same" in advice for advice in found.advice
    )


@pytest.mark.parametrize(("closure", "told"), [({}, 1), ({"axis": "z"}, 0), ({"kind": "spherical"}, 0)])
def test_an_axis_that_the_file_leaves_out_is_told(write_robot, closure, told):
    stated = {"name": "tip", "frames": ["left_tip", "right_tip"], "kind": "revolute"}
    found = check_robot(Mechanism.from_file(write_robot(("closures", [stated | closure]))))
    assert found.square
    notes = [note for note in found.advice if note == "closure tip: no axis is given: it is z of left_tip"]
    assert len(notes) == told


def test_a_robot_that_is_singular_beside_its_reference_too_is_refused(tmp_path):
    """An elbow that would lift the tip out of the plane has to stay where it is, to second order too."""
    for name in ("robot.yaml", "robot.urdf"):
        text = (GEPETTO / name).read_text(encoding="utf-8")
        motor, mark, elbow = text.partition('<joint name="left_elbow"')
        text = motor + mark + elbow.replace('<axis xyz="0 0 1"/>', '<axis xyz="7.3 0 1"/>', 1)
        (tmp_path / name).write_text(text, encoding="utf-8")
    robot = Mechanism.from_description(read_any(tmp_path, platform="tip_A", axes=["x", "y"]))
    with pytest.raises(SingularReference, match="on a singularity of the loops"):
        check_robot(robot)


def rewritten(folder, pattern, change):
    """The file of the 5R with heavy legs, what a pattern of its URDF's attributes matches changed."""
    source = robots.load("five_bar_heavy").description.file
    urdf = source.with_suffix(".urdf").read_text(encoding="utf-8")
    (folder / "five_bar_heavy.urdf").write_text(re.sub(pattern, change, urdf))
    file = folder / "edited.yaml"
    file.write_text(source.read_text(encoding="utf-8"))
    return file


def in_millimetres(match):
    return f'xyz="{" ".join(str(1000.0 * float(word)) for word in match[1].split())}"'


def in_square_millimetres(match):
    return f'{match[1]}="{1e6 * float(match[2])}"'


@pytest.mark.parametrize(
    ("pattern", "change", "words"),
    [
        ('xyz="([^"]*)"', in_millimetres, "the longest link measures 250 m: lengths are in m"),
        # kg mm^2 in place of kg m^2: sqrt(1e6) times the radius, and a rod of 0.25 m has 0.25 / sqrt(12) m
        (
            '(i[xyz]{2})="([^"]*)"',
            in_square_millimetres,
            "left_motor carries has a radius of gyration of 72.2 m",
        ),
        ('value="[^"]*"', 'value="0"', "no link has a mass: all torques will be those of the rotors"),
    ],
    ids=["millimetres", "kg mm2", "no mass"],
)
def test_a_urdf_in_other_units_is_doubted_by_check_and_by_plan(tmp_path, capsys, pattern, change, words):
    file = rewritten(tmp_path, pattern, change)
    assert main(["check", str(file)]) == 0
    assert words in capsys.readouterr().out
    ends = (["100", "345"], ["90", "335"]) if "250 m" in words else (["0.1", "0.345"], ["0.09", "0.335"])
    assert main(["plan", str(file), "--from", *ends[0], "--to", *ends[1], "--duration", "1.5"]) == 0
    assert f"warning           {'what ' * ('gyration' in words)}{words}" in capsys.readouterr().out


def test_no_robot_of_the_catalogue_is_doubted():
    for name in ("five_bar", "five_bar_heavy", "three_rpr", "slider_crank", "gough_stewart", "agile_eye"):
        advice = "; ".join(check_robot(robots.load(name)).advice)
        assert "measures" not in advice
        assert "weigh" not in advice


def test_check_says_by_how_much_the_loops_close_beside_the_reference(write_robot):
    """The left elbow is given 0.03 rad aside: with the motors as given no pose is as near."""
    file = write_robot(("reference.left_elbow", -0.80362))
    mechanism = Mechanism.from_file(file)
    found = next(advice for advice in check_robot(mechanism).advice if "beside the reference" in advice)
    joint, step = re.search(r"given, (\w+) by ([-+][\d.]+) rad", found).groups()
    closed = check_robot(mechanism).reference
    steps = {name: closed[name] - value for name, value in mechanism.description.reference.items()}
    assert abs(steps[joint]) == max(map(abs, steps.values()))
    assert float(step) == pytest.approx(steps[joint], rel=5e-3)
    exact = check_robot(Mechanism.from_file(write_robot()))
    assert not any("beside the reference" in advice for advice in exact.advice)


def test_a_pose_moves_in_steps_along_the_motion_that_loops_allow():
    """By a step of the joint that turns most; the allowed motions of the 5R by numpy."""
    robot = robots.load("five_bar")
    q = robot.reference.q
    rows = linearised_at(robot, q[None]).closures[0][:, robot.joints]
    direction = np.linalg.svd(rows)[2][-2:].T @ [0.6, -0.8]
    reached = _move(robot, q, direction, 1)[-1]
    expected = STEP * direction / np.abs(direction).max()
    np.testing.assert_allclose((reached - q)[robot.joints], expected, atol=STEP**2)
