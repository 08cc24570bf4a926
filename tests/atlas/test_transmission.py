"""A linkage as a transmission: the split of its inertia, its limits, and the error of a static mapping."""

import json

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, ParallelRobot, assemble
from framework.atlas.transmission import _mapping_error, transmission
from framework.catalogue import own_file

CASES = [("humanoid_ankle", [-0.3, -0.2], [0.3, 0.2], [0.0, 0.0]), ("humanoid_knee", [0.5], [1.5], [1.0])]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case[0])
def result(request):
    name, lower, upper, posture = request.param
    robot = robots.load(name)
    return transmission(robot, lower=lower, upper=upper, posture=posture, frequencies=[4.0], points=5)


def test_the_parts_of_the_inertia_add_up(result):
    total = result.carried + result.links + result.rotors
    np.testing.assert_allclose(total, result.inertia, atol=1e-12 * np.abs(result.inertia).max())


def test_motors_move_as_differences_of_assembled_poses_say(result):
    """G against central differences of motor angles, and backlash as the inverse of it."""
    robot, pose = result.robot, len(result.x) // 3
    h = 1e-5
    for k in range(robot.n):
        step = h * np.eye(robot.n)[k]
        ahead, behind = (
            robot.actuated_coordinates(assemble(robot, result.x[pose] + sign * step).q[None])[0]
            for sign in (1, -1)
        )
        expected = robot.gear_ratio * (ahead - behind) / (2 * h)
        np.testing.assert_allclose(result.gear[pose, :, k], expected, rtol=1e-6)
    motors = result.gear[pose] / robot.gear_ratio[:, None]
    np.testing.assert_allclose(result.backlash[pose], np.abs(np.linalg.inv(motors)).sum(axis=1), rtol=1e-9)


def test_the_armature_of_the_pose_explains_all_but_the_linkage(result):
    """What is left of the error scales with the mass of cranks and rods: without them there is none."""
    for error in result.errors:
        k = result.robot.axis_names.index(error.axis)
        assert error.own_armature[k] < 0.15 * error.constant_armature[k] < 0.15 * error.nothing_known[k]


def test_the_play_of_a_joint_lets_the_resting_motors_joint_turn_by_its_backlash(tmp_path, crossing):
    """The poses at both ends of the play, with the backlash of the robot file between their motor joints."""
    folder = own_file("humanoid_knee").parent
    text = (
        (folder / "humanoid_knee.yaml").read_text().replace("joint: motor,", "joint: motor, backlash: 1e-4,")
    )
    (tmp_path / "humanoid_knee.urdf").write_text((folder / "humanoid_knee.urdf").read_text())
    (tmp_path / "knee.yaml").write_text(text)
    robot = ParallelRobot.from_file(tmp_path / "knee.yaml")
    result = transmission(robot, lower=[0.5], upper=[1.5], posture=[1.0], frequencies=[4.0], points=3)
    ends = [result.x[1] + sign * result.play[1] / 2 for sign in (-1, 1)]
    low, high = (robot.actuated_coordinates(assemble(robot, x).q[None])[0] for x in ends)
    np.testing.assert_allclose(np.abs(high - low), 1e-4, rtol=1e-6)
    (tmp_path / "knee.yaml").write_text(text.replace("backlash: 1e-4", "backlash: -1"))
    code, _, said = crossing("check", tmp_path / "knee.yaml")
    assert code == 2
    assert "backlash" in said


def test_springs_and_dampers_between_points_are_counted_by_energy_and_power(tmp_path):
    """The held torque is the slope of the spring's energy; the error of a sine with all known loses both."""
    folder = own_file("humanoid_knee").parent
    text = (folder / "humanoid_knee.yaml").read_text()
    spring = "springs:\n  - {name: calf, between: [thigh, rod], stiffness: 900, rest: 0.2, damping: 40}\n"
    (tmp_path / "humanoid_knee.urdf").write_text((folder / "humanoid_knee.urdf").read_text())
    (tmp_path / "knee.yaml").write_text(text.replace("springs:\n", spring))
    robot, bare = ParallelRobot.from_file(tmp_path / "knee.yaml"), robots.load("humanoid_knee")
    options = {"lower": [0.5], "upper": [1.5], "posture": [1.0], "frequencies": [2.0], "points": 3}
    sprung, plain = transmission(robot, **options), transmission(bare, **options)
    h = 1e-4
    model, data = robot.model, robot.model.createData()
    lengths = []
    for x in (1.0 - h, 1.0, 1.0 + h):
        pin.framesForwardKinematics(model, data, assemble(robot, [x]).q)
        thigh, rod = (data.oMf[model.getFrameId(name)].translation.copy() for name in ("thigh", "rod"))
        lengths.append(np.linalg.norm(rod - thigh))
    before, middle, after = lengths
    slope = (after - before) / (2 * h)
    assert sprung.springs[1, 0] == pytest.approx(900 * (middle - 0.2) * slope, rel=1e-6)
    assert sprung.damping[1, 0, 0] - plain.damping[1, 0, 0] == pytest.approx(40 * slope**2, rel=1e-6)
    (error,), (without,) = sprung.errors, plain.errors
    np.testing.assert_allclose(error.own_springs, without.own_springs, rtol=1e-9)
    assert error.own_armature[0] > 2 * without.own_armature[0]


def test_without_mass_in_the_linkage_nothing_is_left_of_the_error():
    from dataclasses import replace

    robot = robots.load("humanoid_knee")
    model = robot.model.copy()
    body = model.frames[robot.frames[0]].parentJoint
    for joint in range(1, model.njoints):
        if joint != body:
            model.inertias[joint] = pin.Inertia.Zero()
    light = replace(robot, model=model)
    result = transmission(light, lower=[0.5], upper=[1.5], posture=[1.0], frequencies=[4.0], points=5)
    np.testing.assert_allclose(result.errors[0].own_armature, 0.0, atol=1e-9)
    assert result.errors[0].nothing_known > 1


MJCF_LEG = """\
<mujoco><compiler angle="radian"/>
 <worldbody><body name="thigh"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <body name="crank" pos="0 0.02 0.1"><joint name="crank" axis="0 1 0" armature="0.03"/>
   <inertial pos="0.02 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
   <body name="rod" pos="0.05 0 0"><joint name="ball" type="ball"/>
    <inertial pos="0 0 -0.1" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/><site name="end" pos="0 0 -0.2"/></body>
  </body>
  <body name="foot" pos="0 0 -0.1"><joint name="flex" axis="0 1 0" range="-0.4 0.3" armature="0.002"/>
   <inertial pos="0.05 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
   <site name="eye" pos="0.05 0.02 0"/></body>
 </body></worldbody>
 <equality><connect site1="end" site2="eye"/></equality>
 <actuator><motor joint="crank" forcerange="-40 40"/></actuator>
</mujoco>"""


def test_a_file_of_a_legged_robot_states_its_rotors_as_armature(tmp_path, crossing):
    """A parallelogram turns motor and foot alike: the foot feels the armature itself, within the limits."""
    (tmp_path / "leg.xml").write_text(MJCF_LEG)
    words = ("--platform-joints", "flex", "--base", "thigh", "--out", tmp_path)
    assert crossing("convert", tmp_path / "leg.xml", *words)[0] == 0
    (file,) = tmp_path.glob("*.yaml")
    result = transmission(ParallelRobot.from_file(file), frequencies=[4.0], points=5, posture=[0.0])
    np.testing.assert_allclose(result.x[[0, -1], 0], [-0.4, 0.3])
    np.testing.assert_allclose(result.rotors[:, 0, 0], 0.03, rtol=1e-9)
    np.testing.assert_allclose(result.carried[:, 0, 0], 1e-3 + 0.5 * 0.05**2 + 0.002, rtol=1e-9)
    total = result.carried + result.links + result.rotors
    np.testing.assert_allclose(total, result.inertia, rtol=1e-12)
    (error,) = result.errors
    largest = 0.03 * 0.2 * (8 * np.pi) ** 2  # [N m] of the rotor in the sine
    assert error.nothing_known[0] - error.own_armature[0] > 0.95 * largest
    np.testing.assert_allclose(error.own_armature, error.constant_armature, rtol=1e-9)


@pytest.mark.slow
def test_the_command_writes_a_table_and_three_pictures(tmp_path, document, crossing):
    words = (
        "transmission",
        "humanoid_knee",
        "--lower",
        "0.9",
        "--upper",
        "1.1",
        "--frequencies",
        "2",
        "--points",
        "5",
    )
    told = document(*words)
    assert told["axes"]["knee"]["rotors"][0] > 0
    code, out, _ = crossing(*words, "--out", tmp_path / "knee")
    assert code == 0
    assert "nothing known" in out
    stems = {path.stem for path in (tmp_path / "knee").iterdir()}
    assert stems == {"transmission", "inertia", "limits", "mapping"}
    assert json.loads((tmp_path / "knee" / "transmission.json").read_text())["poses"] == told["poses"]


def test_what_is_no_transmission_is_refused(refusal):
    with pytest.raises(InvalidInput, match="as many motors"):
        transmission(robots.load("two_arms"))
    assert "lower and upper" in refusal(2, "transmission", "five_bar")
    assert "lower < upper" in refusal(2, "transmission", "humanoid_knee", "--lower", "1", "--upper", "0.5")
    assert "frequencies: must be greater" in refusal(2, "transmission", "humanoid_knee", "--frequencies", "0")


def test_without_weight_and_dampers_all_torques_of_a_sine_grow_with_the_square_of_its_frequency():
    robot = robots.load("three_rrr")
    once, thrice = (_mapping_error(robot, robot.reference.x, np.eye(3), 0, f) for f in (1.0, 3.0))
    for slow, quick in zip(once[2:], thrice[2:], strict=True):
        np.testing.assert_allclose(quick, 9.0 * slow, rtol=1e-9, atol=1e-9 * quick.max())
    assert min(once.mapped) > 0.0
