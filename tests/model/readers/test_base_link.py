"""One leg of a humanoid: what a link carries moves, and the rest stands where the file's reference has it."""

import re
from pathlib import Path

import numpy as np
import pytest

from framework import RobotFileError, assemble, dynamics_at
from framework.model.readers import read_any
from tests.model.readers.leg import FILE, SAID, ankle, with_thin_rods

ALL = {key: value for key, value in SAID.items() if key != "base"}


def test_what_is_not_carried_stands_where_the_keyframe_has_it(tmp_path):
    """Hip and knee bent, the trunk turned back: the shank is upright, and the weight of the foot the same."""
    there = (
        "0.3 0.1 0.9 0.955336489125606 0 0.29552020666134 0 -1 0.4"  # trunk turned by 0.6 about y, hip, knee
    )
    key = f'<keyframe><key qpos="{there} 0 0 0 1 0 0 0 0 1 0 0 0"/></keyframe></mujoco>'
    bent = ankle(tmp_path, with_thin_rods(FILE.read_text()).replace("</mujoco>", key))
    straight = ankle(tmp_path)
    assert bent.actuator_names == ("left_ankle_drive_a_joint", "left_ankle_drive_b_joint")
    assert bent.rows.names == straight.rows.names
    for x in ([0.0, 0.0], [-0.5, 0.2]):
        found = [dynamics_at(robot, assemble(robot, x).q).torque for robot in (bent, straight)]
        np.testing.assert_allclose(found[0], found[1], rtol=1e-12)


def test_all_joints_move_without_a_base(tmp_path):
    file = tmp_path / "leg.xml"
    file.write_text(with_thin_rods(FILE.read_text()))
    description = read_any(file, **ALL)
    assert len(description.actuators) == 4
    whole = read_any(file, **SAID)
    assert len(whole.actuators) == 2
    assert whole.closures == description.closures


@pytest.mark.parametrize(
    ("base", "message"),
    [
        (
            "left_nee_pitch_link",
            "--base: unknown link 'left_nee_pitch_link'; did you mean 'left_knee_pitch_link'",
        ),
        (
            "left_ankle_roll_link",
            "--base: no joint moves that link 'left_ankle_roll_link' carries; give a link nearer to the root",
        ),
        ("left_ankle_pitch_link", "--base: no loop moves that link 'left_ankle_pitch_link' carries"),
    ],
)
def test_bases_that_cannot_be(tmp_path, base, message):
    text = with_thin_rods(FILE.read_text())
    if "no loop" in message:  # one that is closed elsewhere
        text = re.sub(r"<connect.*?/>", "", text)
        text = text.replace("<equality>", '<equality><connect body1="left_hip_pitch_link" anchor="0 0 0"/>')
    with pytest.raises(RobotFileError, match=re.escape(message)):
        ankle(tmp_path, text, base=base)


def test_the_armature_of_a_ball_acts_about_all_its_axes():
    joints = read_any(FILE, **SAID).joints
    assert {joints[f"left_ankle_rod_a_ball_{axis}"].armature for axis in ("rx", "ry", "rz")} == {0.001}


def test_our_own_files_lock_joints_themselves():
    with pytest.raises(
        RobotFileError, match="--base: for files of foreign dialects; a robot file of ours has"
    ):
        read_any(Path("urdf/five_bar/five_bar.yaml"), base="base")
