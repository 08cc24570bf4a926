"""What `check` advises: the closure that locks too much by its name, and springs that planning refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from framework import check_robot
from framework.errors import SingularReference
from framework.kinematics.mechanism import Mechanism
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
