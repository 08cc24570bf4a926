"""Balls and free bodies inside the tree: one robot, whatever joints its file has them written with."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import (
    Line,
    LoadedJoint,
    ParallelRobot,
    RobotFileError,
    check_robot,
    plan_crossing,
    plan_scene,
    simulate,
)
from framework.kinematics.frames import frames_at
from framework.model.description import Closure, RobotDescription
from framework.model.placement import placement, to_rpy
from framework.model.readers import read_any
from framework.model.urdf_edits import joint_element, vector_text
from framework.model.urdf_elements import Joint
from framework.proofs.working_modes import working_modes
from robots.generators.gough_stewart import platform_joints
from tests.model.readers.leg import FILE, ankle, with_thin_rods
from tests.robots.every_robot import assert_same_torques

# of a ball at the reference from its zero: by more than a right angle
TURN = pin.exp3(np.array([0.3, 2.0, -0.4]))


AXES = ("rx", "ry", "rz")
AXES_OF_ALL = ("x", "y", "z", *AXES)
BALL_1 = platform_joints()[0]


def joint_of(root: ElementTree.Element, name: str) -> ElementTree.Element:
    return next(joint for joint in root.findall("joint") if joint.get("name") == name)


def ball(root: ElementTree.Element, name: str, first: str, last: str) -> None:
    """A ball, whose zero is turned by TURN from theirs, in place of the hinges from `first` to `last`."""
    start, end = joint_of(root, first), joint_of(root, last)
    origin = start.find("origin")
    place = pin.rpy.rpyToMatrix(np.array(origin.get("rpy", "0 0 0").split(), float)) @ TURN.T
    turned = placement(place, np.array(origin.get("xyz", "0 0 0").split(), float))
    parent, child = start.find("parent").get("link"), end.find("child").get("link")
    while end is not start:
        below = end.find("parent").get("link")
        root.remove(end)
        root.remove(next(link for link in root.findall("link") if link.get("name") == below))
        end = next(joint for joint in root.findall("joint") if joint.find("child").get("link") == below)
    root.remove(start)
    root.append(joint_element(Joint(name, "spherical", turned, parent=parent, child=child)))


def hexapod_on_balls(folder: Path) -> Path:
    """The Gough-Stewart platform of the catalogue as URDF+, with balls at both ends of its legs."""
    description = robots.load("gough_stewart").description
    root = ElementTree.fromstring(description.urdf_text)
    ball(root, "ball", "ball_x", "ball_z")
    for i in range(1, 7):
        ball(root, f"leg_{i}_foot", f"leg_{i}_swing", f"leg_{i}_tilt")
    for closure in description.closures:
        loop = ElementTree.SubElement(root, "loop", name=closure.name, type="spherical")
        for end, frame in zip(("predecessor", "successor"), closure.frames, strict=True):
            ElementTree.SubElement(loop, end, link=frame)
    file = folder / "gough_stewart.urdf"
    file.write_text(ElementTree.tostring(root, encoding="unicode"))
    return file


def at_zero_of_all(root: ElementTree.Element) -> dict[str, float]:
    """The reference in which every ball has turned by TURN."""
    balls = [joint.get("name") for joint in root.findall("joint") if joint.get("type") == "spherical"]
    return {
        f"{name}_{axis}": value for name in balls for axis, value in zip(AXES, pin.log3(TURN), strict=True)
    }


def without_spin_inertia(description: RobotDescription) -> ParallelRobot:
    """The robot with legs as thin as lines: one that turns about itself feels nothing."""
    root = ElementTree.fromstring(description.urdf_text)
    for link in root.findall("link"):
        if re.fullmatch(r"leg_\d_(tube|rod)", link.get("name")):
            link.find("inertial/inertia").set("izz", "0")
    text = ElementTree.tostring(root, encoding="unicode")
    return ParallelRobot.from_description(replace(description, urdf_text=text))


@pytest.fixture(scope="module")
def hexapods(tmp_path_factory) -> tuple[ParallelRobot, ParallelRobot]:
    """The one of the catalogue and the one on balls."""
    own = robots.load("gough_stewart").description
    file = hexapod_on_balls(tmp_path_factory.mktemp("urdf+"))
    read = read_any(
        file,
        platform="platform",
        axes=own.platform.axes,
        motors=[actuator.joint for actuator in own.actuators],
        reference={**own.reference, **at_zero_of_all(ElementTree.parse(file).getroot())},
    )
    on_balls = replace(read, actuators=own.actuators, scenes=own.scenes)
    return without_spin_inertia(own), without_spin_inertia(on_balls)


def test_legs_on_balls_spin_idly_and_nothing_is_singular_about_them(hexapods):
    ours, balls = map(check_robot, hexapods)
    assert balls.idle_joints == tuple(f"leg_{i}_foot_rz" for i in range(1, 7))
    assert balls.mobility == ours.mobility + 6
    assert (balls.working_mode, balls.assembly_mode) == (ours.working_mode, ours.assembly_mode)
    assert balls.closure_error < 1e-13


@pytest.mark.parametrize("scene", ["tilt", "turn"])
def test_a_hexapod_on_balls_takes_the_torques_of_the_one_on_hinges(hexapods, scene):
    """`turn` crosses a Type 2 singularity; the balls are turned by more than 90 degrees all the way."""
    ours, balls = (plan_scene(robot, scene) for robot in hexapods)
    assert_same_torques(ours, balls, within=1e-11)
    assert balls.certificate.max_closure_error < 1e-12
    assert [c.s for c in balls.crossings] == pytest.approx([c.s for c in ours.crossings], abs=1e-12)


def test_velocities_with_balls_are_those_of_the_configurations(hexapods):
    """Central differences of where the frames are, which feel no idle spin."""
    _, robot = hexapods
    plan, step = plan_scene(robot, "tilt"), 1e-4
    before, at, after = (frames_at(robot, plan.configuration([t])) for t in (1.0 - step, 1.0, 1.0 + step))
    jacobians = np.array([at.frame_jacobian(frame)[0] for frame in range(len(robot.frames))])
    twists = jacobians @ plan.velocity(1.0)
    slopes = (after.position - before.position)[0] / (2 * step)
    np.testing.assert_allclose(twists[:, :3], slopes, atol=1e-7)
    turned = pin.log3(after.rotation[0, 0] @ before.rotation[0, 0].T) / (2 * step)
    np.testing.assert_allclose(twists[0, 3:], turned, atol=1e-7)


def test_a_platform_that_floats_is_held_by_all_six_legs():
    """`floating` in a URDF: legs end at their tips, and a sixth loop takes the place of a ball."""
    own = robots.load("gough_stewart").description
    root = ElementTree.fromstring(own.urdf_text)
    tip = joint_of(root, "ball_x").find("parent").get("link")
    ball(root, "float", "ball_x", "ball_z")
    joint = joint_of(root, "float")
    joint.set("type", "floating")
    joint.find("parent").set("link", "base")
    turned = ElementTree.Element("origin", xyz="0.5 -0.2 0.3", rpy=vector_text(to_rpy(TURN.T)))
    joint.remove(joint.find("origin"))
    joint.append(turned)
    home = robots.load("gough_stewart")
    place = frames_at(home, home.reference.q[None])
    corner = pin.SE3(place.rotation[0, 0], place.position[0, 0]) * pin.SE3(np.eye(3), BALL_1)
    start = pin.SE3(TURN.T, np.array([0.5, -0.2, 0.3])).actInv(corner)
    found = [*start.translation, *pin.log3(start.rotation)]
    description = replace(
        own,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        closures=(*own.closures, Closure("ball_1", (tip, "platform_1"), ("x", "y", "z"))),
        reference=dict(own.reference) | dict(zip([f"float_{k}" for k in AXES_OF_ALL], found, strict=True)),
    )
    floating = ParallelRobot.from_description(description)
    of_it = [name for name in floating.coordinates.names if name.startswith("float")]
    assert of_it == [f"float_{axis}" for axis in AXES_OF_ALL]
    assert_same_torques(*(plan_scene(robot, "tilt") for robot in (home, floating)), within=1e-11)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"motors": ["ball"]}, "--motors: unknown movable joint 'ball' (valid: leg_1_motor, "),
        ({"reference": {"ball": 1.0}}, "--reference: unknown movable joint 'ball'; did you mean 'ball_r"),
        (
            {"reference": {"ball_rw": 1.0}},
            "--reference: unknown movable joint 'ball_rw'; did you mean 'ball_r",
        ),
    ],
)
def test_a_ball_has_no_motor_and_three_coordinates(said, message, tmp_path):
    motors = [f"leg_{i}_motor" for i in range(1, 7)]
    with pytest.raises(RobotFileError, match=re.escape(message)):
        read_any(
            hexapod_on_balls(tmp_path), **{"platform": "platform", "axes": ["x"], "motors": motors} | said
        )


def test_a_coordinate_of_a_ball_has_a_name_of_its_own(tmp_path):
    file = hexapod_on_balls(tmp_path)
    file.write_text(file.read_text().replace('"leg_1_motor"', '"ball_rx"'))
    message = "joint 'ball': its coordinate 'ball_rx' has the name of another joint"
    with pytest.raises(RobotFileError, match=message):
        read_any(file)


def test_an_mjcf_ankle_plans_alike_wherever_its_balls_have_their_zero(tmp_path):
    """Rods at an odd angle at the zero pose, brought back by a keyframe."""
    quaternion = pin.Quaternion(TURN)
    turn = vector_text([quaternion.w, *quaternion.coeffs()[:3]])
    back = vector_text([quaternion.w, *(-quaternion.coeffs()[:3])])
    text = with_thin_rods(FILE.read_text())
    turned = re.sub(r'(<body name="left_ankle_rod_[ab]")', rf'\1 quat="{turn}"', text)
    start = "0 0 0.7 1 0 0 0 0 0 0 0"  # of the trunk, hip, knee, pitch and roll
    key = f'<keyframe><key qpos="{start} 0 {back} 0 {back}"/></keyframe></mujoco>'
    plans = [
        plan_crossing(ankle(tmp_path, each), Line([-0.4, -0.2], [0.2, 0.3]), duration=1.0)
        for each in (text, turned.replace("</mujoco>", key))
    ]
    assert_same_torques(*plans, within=1e-11)
    assert all(plan.certificate.max_closure_error < 1e-13 for plan in plans)


HALF = np.sqrt(0.5)


def ankle_with_bulky_rods(folder: Path, inertia: float) -> ParallelRobot:
    """The ankle whose rods have an inertia of this order [kg m^2] that is not symmetric about their lines."""
    root = ElementTree.fromstring(with_thin_rods(FILE.read_text()))
    for body in root.iter("body"):
        if body.find("joint[@type='ball']") is not None:
            inertial = body.find("inertial")
            moments = np.array(inertial.get("fullinertia").split(), float)
            inertial.set("fullinertia", vector_text(moments + inertia * np.array([1, 2, 1.5, 0.3, 0.3, 0])))
    return ankle(folder, ElementTree.tostring(root, encoding="unicode"))


def test_a_rod_that_would_spin_is_held_if_that_costs_little_and_else_by_what_the_refusal_says(tmp_path):
    path = Line([-0.4, -0.2], [0.2, 0.3])
    light = ankle_with_bulky_rods(tmp_path, 1e-5)
    plan = plan_crossing(light, path, duration=1.0)
    peak = max(plan.peak_torque.values())
    assert 1e-6 * peak < plan.certificate.max_held_torque < 1e-4 * peak
    assert simulate(light, plan).tracking_error < 1e-5  # m, rad: the rods spin there
    bulky = ankle_with_bulky_rods(tmp_path, 0.2)
    with pytest.raises(LoadedJoint) as caught:
        plan_crossing(bulky, path, duration=1.0)
    parent, rod = re.search(r"closure {frames: \[(\S+), (\S+)\], axes: \[rz\]}", str(caught.value)).groups()
    turns = [
        Closure(
            f"turn_{leg}", (parent.replace("_a_", f"_{leg}_"), rod.replace("rod_a", f"rod_{leg}")), ("rz",)
        )
        for leg in "ab"
    ]
    closures = (*bulky.description.closures, *turns)
    locked = ParallelRobot.from_description(replace(bulky.description, closures=closures))
    plan = plan_crossing(locked, path, duration=1.0)
    assert plan.certificate.max_held_torque == 0.0
    assert simulate(locked, plan).tracking_error < 1e-12


@pytest.mark.slow
def test_a_rod_on_balls_is_one_working_mode_however_it_spins(tmp_path):
    """Each crank has two angles for a pose of the foot, and the rods no two ways to stand between them."""
    x, ours = [0.1, 0.2], working_modes(robots.load("humanoid_ankle"), [0.1, 0.2])
    balls = working_modes(ankle(tmp_path), x)
    upright = [mode.motors for mode in balls.modes if abs(mode.q[-2]) < 1]  # the cross not turned over
    zeros = np.arctan2(
        [-0.002346359528693609, 0.0058995075739472075], [0.04293593596233938, 0.04259337754140823]
    )
    cranks = np.unique(np.round([mode.motors for mode in ours.modes] - zeros, 9), axis=0)
    assert len(cranks) == len(upright) == 4
    np.testing.assert_allclose(np.sort(upright, axis=0), np.sort(cranks, axis=0), atol=1e-8)


@pytest.mark.parametrize(
    ("line", "quat"), [("x", "1 0 0 0"), ("y", f"{HALF} 0 0 {-HALF}"), ("z", f"{HALF} 0 {HALF} 0")]
)
def test_a_bent_rod_is_held_about_its_own_line_whatever_frame_the_ball_has(tmp_path, crossing, line, quat):
    """A rod of 0.24 m along an axis of its ball, its centre of mass 1.4 mm beside the line."""
    axis = "xyz".index(line)
    tip, centre = (vector_text(np.roll(v, axis)) for v in ([0.24, 0, 0], [0.12, 1e-3, 1e-3]))
    file = tmp_path / "bent.xml"
    file.write_text(f"""<mujoco model="bent"><compiler angle="radian"/><worldbody>
      <body name="arm"><joint name="arm" axis="0 1 0"/>
        <inertial pos="0 0 0.02" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
        <body name="rod" pos="0 0 0.05" quat="{quat}"><joint name="ball" type="ball"/>
          <inertial pos="{centre}" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
          <site name="end" pos="{tip}"/></body></body>
      <body name="flap" pos="0.24 0 0"><joint name="flap" axis="0 1 0"/>
        <inertial pos="0.05 0 0" mass="1" diaginertia="1e-2 1e-2 1e-2"/>
        <site name="horn" pos="0 0 0.05"/></body>
      </worldbody><equality><connect site1="end" site2="horn"/></equality>
      <actuator><motor name="m" joint="arm"/></actuator></mujoco>""")
    out = tmp_path / "robot"
    assert crossing("convert", file, "--out", out)[0] == 0
    move = ("--from", "0", "--to", "0.3", "--duration", "1")
    code, text, err = crossing("plan", out / "bent.yaml", *move)
    assert (code, err) == (0, "")
    assert f"idle turns        ball_r{line} held still" in text
    assert f"what nothing holds of ball_r{line}: worth" in text
    locked = tmp_path / "locked"
    assert crossing("convert", file, "--lock", f"ball_r{line}", "--out", locked)[0] == 0
    assert crossing("plan", locked / "bent.yaml", *move)[0] == 0
