"""One leg of a humanoid: what a link carries moves, and the rest stands where the file's reference has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from framework import Line, ParallelRobot, plan_crossing
from framework.errors import RobotFileError
from framework.model.readers import read_any
from tests.model.readers.test_balls import ankle_with_turned_zeros

ANKLE = Path(__file__).parents[2] / "data" / "dialects" / "humanoid_ankle.xml"
SAID = {"platform": "roll_link", "axes": ["ry", "rx"]}
TRUNK = """<body name="trunk" pos="1 2 3" euler="0.4 0.5 0.6"><freejoint name="float"/><geom size="0.1"/>
  <body name="thigh"><joint name="hip" axis="0 1 0"/><geom size="0.05"/>
  <body name="shank"><joint name="knee" axis="0 1 0"/>"""
ARM = '<body name="arm"><joint name="elbow"/><geom size="0.1"/><site name="hand"/></body>'


@pytest.fixture
def humanoid(tmp_path) -> Path:
    """The ankle below a trunk that floats, a hip and a knee; hip and knee bent, the shank upright."""
    text = ankle_with_turned_zeros()
    text = text.replace('<body name="shank">', TRUNK).replace(
        "</worldbody>", f"</body></body>{ARM}</worldbody>"
    )
    text = text.replace('qpos="', 'qpos="0.3 0.1 0.9 1 0 0 0 -0.4 0.4 ').replace(
        '"/></keyframe>', ' 0"/></keyframe>'
    )
    text = text.replace("<equality>", '<equality><connect name="hand" body1="arm" anchor="0 0 0"/>')
    motors = "".join(f'<motor joint="{joint}" gear="5"/>' for joint in ("hip", "knee", "elbow"))
    file = tmp_path / "humanoid.xml"
    file.write_text(text.replace("<actuator>", f"<actuator>{motors}"))
    return file


def test_a_leg_alone_is_the_leg(humanoid):
    leg = ParallelRobot.from_file(humanoid, base="shank", **SAID)
    alone = ParallelRobot.from_file(ANKLE, **SAID)
    assert leg.actuator_names == alone.actuator_names == ("drive_a", "drive_b")
    assert leg.rows.names == alone.rows.names
    plans = [plan_crossing(robot, Line([-0.4, -0.2], [0.2, 0.3]), duration=1.0) for robot in (leg, alone)]
    times = np.linspace(0.0, 1.0, 21)
    ours, theirs = (plan.torque(times) for plan in plans)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * np.abs(theirs).max())


def test_all_joints_move_without_a_base(humanoid):
    description = read_any(humanoid, **SAID)
    assert [actuator.joint for actuator in description.actuators][:3] == ["hip", "knee", "elbow"]
    assert {"float_x", "float_rz", "hip", "rod_a_ball_ry"} < description.reference.keys()


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("shanc", "--base: unknown link 'shanc'; did you mean 'shank'"),
        ("roll_link", "--base: no joint moves that link 'roll_link' carries; give a link nearer to the root"),
        ("pitch_link", "--base: no loop moves that link 'pitch_link' carries"),
    ],
)
def test_bases_that_cannot_be(humanoid, base, message):
    if base == "pitch_link":
        text = humanoid.read_text()
        humanoid.write_text(
            text.replace('<connect name="loop_a"', '<connect active="false"').replace(
                '<connect name="loop_b"', '<connect active="false"'
            )
        )
    with pytest.raises(RobotFileError, match=message):
        read_any(humanoid, base=base, **SAID)


def test_our_own_files_lock_joints_themselves():
    with pytest.raises(
        RobotFileError, match="--base: for files of foreign dialects; a robot file of ours has"
    ):
        read_any(Path("urdf/five_bar/five_bar.yaml"), base="base")
