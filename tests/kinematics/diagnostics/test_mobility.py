"""Freedoms counted by hand: what is idle, what is loose, and along which axes a platform moves."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot, SingularReference, assemble, check_robot
from framework.kinematics.assembly import close_reference
from framework.kinematics.diagnostics.mobility import count_freedoms, motions_within_limits
from framework.model.readers import read_any
from tests.kinematics.linkages import frame, joint, linkage
from tests.robots.every_robot import RIGID

# One leg of a biped built like Agility's Cassie, in round numbers of our own: motors at the hip (three), the
# knee and the foot; a rod on balls from the thigh to a spring at the heel; a crank and a rod for the foot
LEG = """
<body name="{side}_roll" pos="0 {y} 0"><joint name="{side}_roll" axis="1 0 0"/>{mass}
<body name="{side}_yaw"><joint name="{side}_yaw" axis="0 0 1"/>{mass}
<body name="{side}_thigh"><joint name="{side}_pitch" axis="0 1 0"/>{mass}
  <body name="{side}_rod" pos="0 0.05 0"><joint name="{side}_rod" type="ball"/>
    <inertial pos="0 {off} -0.25" mass="0.1" diaginertia="1e-3 1e-3 1e-5"/>
  </body>
  <body name="{side}_knee" pos="0 0 -0.1"><joint name="{side}_knee" axis="0 1 0"/>{mass}
  <body name="{side}_shin" pos="0.05 0 -0.05"><joint name="{side}_shin" axis="0 1 0" stiffness="1500"/>{mass}
  <body name="{side}_tarsus" pos="0 0 -0.4"><joint name="{side}_tarsus" axis="0 1 0"/>{mass}
    <body name="{side}_heel" pos="-0.05 0.02 0"><joint name="{side}_heel" axis="0 1 0" stiffness="1200"/>
      {mass}
    </body>
    <body name="{side}_crank" pos="0 0.02 0.1"><joint name="{side}_crank" axis="0 1 0"/>{mass}
      <body name="{side}_plantar" pos="0.06 0 0"><joint name="{side}_plantar" axis="0 1 0"/>{mass}</body>
    </body>
    <body name="{side}_foot" pos="0 0 -0.2"><joint name="{side}_foot" axis="0 1 0"/>{mass}</body>
  </body></body></body>
</body></body></body>
"""
LOOPS = """
<connect body1="{side}_rod" body2="{side}_heel" anchor="0 0 -0.5"/>
<connect body1="{side}_plantar" body2="{side}_foot" anchor="0 0 -0.3"/>
"""
MOTORS = "".join(f'<motor joint="{{side}}_{name}"/>' for name in ("roll", "yaw", "pitch", "knee", "foot"))
MASS = '<inertial pos="0.02 0.01 -0.03" mass="1" diaginertia="1e-3 1e-3 1e-3"/>'
ROOT = """
<joint name="root_x" type="slide" axis="1 0 0"/><joint name="root_y" type="slide" axis="0 1 0"/>
<joint name="root_z" type="slide" axis="0 0 1"/><joint name="root_rz" axis="0 0 1"/>
<joint name="root_ry" axis="0 1 0"/><joint name="root_rx" axis="1 0 0"/>
"""


def biped(folder, off=0.0):
    """Two legs on a pelvis that floats; `off` [m] puts the rods' centres of mass off their axes."""
    sides = {"left": 0.1, "right": -0.1}
    legs = "".join(LEG.format(side=side, y=y, mass=MASS, off=off) for side, y in sides.items())
    loops, motors = ("".join(text.format(side=side) for side in sides) for text in (LOOPS, MOTORS))
    file = folder / "biped.xml"
    file.write_text(
        f'<mujoco><worldbody><body name="pelvis">{ROOT}{MASS}{legs}</body></worldbody>'
        f"<equality>{loops}</equality><actuator>{motors}</actuator></mujoco>"
    )
    axes = ["x", "y", "z", "rx", "ry", "rz"]
    return ParallelRobot.from_description(read_any(file, platform="pelvis", axes=axes))


def test_a_biped_of_cassies_build_has_22_freedoms(tmp_path):
    """32 joints; each leg's rod takes three, its foot linkage, which is plane, two: 32 - 2 (3 + 2).

    Or: six of the pelvis and, a leg, five motors, two springs and the turn of the rod about itself. What the
    motors and the pelvis do not tell of are the springs, whose parts move, and the rods, which stay in place.
    """
    robot = biped(tmp_path)
    found = count_freedoms(robot)
    assert (found.freedoms, found.working) == (22, 20)
    assert [name.rpartition("_")[0] for name in found.idle] == ["left_rod", "right_rod"]
    for side in ("left", "right"):
        loose = [name for name in found.loose if name.startswith(side)]
        assert len(loose) == 2
        assert set(loose) <= {f"{side}_{part}" for part in ("shin", "tarsus", "heel")} | {
            f"{side}_rod_{axis}" for axis in "XYZ"
        }
    checked = check_robot(robot)
    assert checked.mobility == 22
    assert not checked.square
    assert any("10 actuators for 20 degrees of freedom" in advice for advice in checked.advice)
    assert any("masses move there by themselves" in advice for advice in checked.advice)


def test_a_rod_whose_centre_of_mass_is_off_its_axis_is_not_idle(tmp_path):
    found = count_freedoms(biped(tmp_path, off=0.03))
    assert (found.freedoms, found.idle, len(found.loose)) == (22, (), 6)


@pytest.mark.parametrize(("centre", "idle"), [((0.1, 0, 0), False), ((0, 0, 0), True)])
def test_a_pendulum_is_loose_and_a_balanced_wheel_idle(write_robot, centre, idle):
    wheel = joint("wheel", "left_tip", mass=2.0, centre=centre)
    robot = ParallelRobot.from_file(write_robot(urdf=(("</robot>", f"{wheel}</robot>"),)))
    found = check_robot(robot)
    assert found.mobility == 3
    assert (found.idle_joints, found.loose_joints) == ((("wheel",), ()) if idle else ((), ("wheel",)))
    assert found.square is idle


def dead_point(folder):
    """A foot on a motor, and a crank and a rod in one line with it, at its extreme."""
    elements = (
        joint("crank", "base", mass=1.0, centre=(0.05, 0.01, 0))
        + joint("rod", "crank_link", (0.1, 0, 0), mass=1.0, centre=(0.1, 0, 0))
        + frame("rod_end", "rod_link", (0.2, 0, 0))
        + joint("foot", "base", (0.3, -0.15, 0), mass=1.0)
        + frame("foot_end", "foot_link", (0, 0.15, 0))
    )
    return linkage(
        folder,
        elements,
        "platform: {frame: foot_link, axes: [rz]}\nactuators: [{joint: foot}]\n"
        "closures: [{name: pin, frames: [rod_end, foot_end], kind: spherical}]\n",
    )


def test_what_moves_in_a_singular_pose_alone_is_not_loose(tmp_path):
    """At the dead point the crank may start while the foot rests; beside it the foot's motor holds it."""
    robot = dead_point(tmp_path)
    np.testing.assert_allclose(close_reference(robot).q, 0.0, atol=1e-15)
    with pytest.raises(SingularReference, match="singularity of the loops"):
        ParallelRobot.of(robot)
    checked = check_robot(robot)
    assert (checked.mobility, checked.idle_joints, checked.loose_joints) == (1, (), ())
    assert checked.stuck_axes == ""
    assert any("said of a pose beside the reference" in advice for advice in checked.advice)


@pytest.mark.parametrize(
    ("axes", "stuck", "proposals"),
    [
        (["x", "z"], "z", {("x", "y"), ("x", "rz"), ("y", "rz")}),
        (["z"], "z", {("x", "y"), ("x", "rz"), ("y", "rz")}),
        (["z", "rx"], "z, rx", {("x", "y"), ("x", "rz"), ("y", "rz")}),
        (
            ["x", "y", "rz"],
            "x and y and rz independently of each other",
            {("x", "y"), ("x", "rz"), ("y", "rz")},
        ),
        (["x", "y", "z"], "z", {("x", "y"), ("x", "rz"), ("y", "rz")}),
        (["x", "y"], "", set()),
    ],
)
def test_axes_along_which_a_five_bar_cannot_move(write_robot, axes, stuck, proposals):
    robot = ParallelRobot.from_file(write_robot(("platform.axes", axes), ("scenes", {})))
    found = check_robot(robot)
    assert (found.stuck_axes, set(found.axes_that_do)) == (stuck, proposals)
    assert set(axes) not in map(set, found.axes_that_do)
    assert any(f"cannot move along {stuck}: it has 2" in advice for advice in found.advice) is bool(stuck)
    assert found.square is not bool(stuck)


def test_a_frame_on_a_hinge_axis_can_only_turn(tmp_path):
    elements = (
        joint("left", "base")
        + joint("top", "left_link", (0, 1, 0))
        + frame("corner", "top_link", (1, 0, 0))
        + joint("right", "base", (1, 0, 0))
        + frame("end", "right_link", (0, 1, 0))
    )
    rest = "actuators: [{joint: left}]\nclosures: [{name: pin, frames: [corner, end], kind: revolute}]\n"
    robot = linkage(tmp_path, elements, f"platform: {{frame: left_link, axes: [x]}}\n{rest}")
    found = check_robot(robot)
    assert (found.stuck_axes, found.axes_that_do) == ("x", (("rz",),))
    turning = linkage(tmp_path, elements, f"platform: {{frame: left_link, axes: [rz]}}\n{rest}")
    assert check_robot(turning).square


def test_proposed_axes_do(write_robot):
    """Each proposal makes a robot that is square and can be assembled a little way along each axis."""
    file = write_robot(("platform.axes", ["x", "z"]), ("scenes", {}))
    for axes in check_robot(ParallelRobot.from_file(file)).axes_that_do:
        robot = ParallelRobot.from_file(write_robot(("platform.axes", list(axes)), ("scenes", {})))
        here = assemble(robot).x
        for step in 1e-3 * np.eye(2):
            np.testing.assert_allclose(assemble(robot, here + step).x, here + step)


def test_a_leg_stretched_at_the_reference_is_told_as_such(write_robot):
    tip = np.array([-0.2, 0.0]) + 0.5 * np.array([np.cos(1.1), np.sin(1.1)])
    reach = tip - [0.2, 0.0]
    half = np.arccos(np.linalg.norm(reach) / 0.5)
    motor = np.arctan2(reach[1], reach[0]) - half
    reference = {"left_motor": 1.1, "left_elbow": 0.0, "right_motor": motor, "right_elbow": 2 * half}
    values = {name: float(value) for name, value in reference.items()}
    robot = ParallelRobot.from_file(write_robot(("reference", values), ("scenes", {})))
    found = check_robot(robot)
    assert found.stuck_axes == ""
    assert any("at the reference the platform cannot move along x and y" in a for a in found.advice)
    assert (found.mobility, found.working_mode, found.square) == (2, 0, False)


@pytest.mark.parametrize("name", RIGID)
def test_every_robot_of_ours_moves_along_its_axes_and_nothing_else_does(name):
    found = check_robot(robots.load(name))
    assert (found.stuck_axes, found.idle_joints, found.loose_joints) == ("", (), ())
    assert found.mobility == len(found.platform_axes)
    assert found.square
    assert found.assembled


def test_another_pose_is_sought_only_for_a_reference_beyond_the_limits():
    description = robots.load("slider_crank").description
    assert motions_within_limits(description) is None
    # crank and rod to the left, where the slide's range ends at 0
    mirrored = {"crank_bearing": 2.5, "crank_pin": 0.8, "slide": -0.15}
    assert motions_within_limits(replace(description, reference=mirrored)) is not None
