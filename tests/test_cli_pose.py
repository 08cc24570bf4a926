"""`crossing pose`: from the platform to the motors and back, and what it says of limits and misuse."""

from functools import partial

import numpy as np
import pytest

import robots
from framework import assemble
from framework.cli import main
from framework.kinematics.continuation.forward_kinematics import motors_are_free

ROUND = ["five_bar", "delta", "gough_stewart", "three_rrr", "agile_eye", "orthoglide"]


@pytest.fixture
def posed(document):
    return partial(document, "pose")


@pytest.mark.parametrize("name", ROUND)
def test_the_motors_of_a_pose_give_it_back(posed, name):
    robot = robots.load(name)
    assert motors_are_free(robot)
    x = assemble(robot).x + 0.02 * robot.length * np.resize([1.0, -0.5, 0.7], robot.n)
    there = posed(name, "--platform", *x)
    np.testing.assert_allclose(list(there["platform"].values()), x, rtol=0, atol=1e-12)
    back = posed(name, "--motors", *there["motor_joints"].values())
    for part in ("joints", "platform", "motor_angles"):
        expected = list(there[part].values())
        np.testing.assert_allclose(list(back[part].values()), expected, rtol=1e-9, atol=1e-9)
    assert max(there["closure_error"], back["closure_error"]) < 1e-11
    assert (there["working_mode"], there["assembly_mode"]) == (back["working_mode"], back["assembly_mode"])


def test_degrees_and_millimetres_are_told(capsys):
    for more in [], ["--all"]:
        main(["pose", "five_bar", "--motors", "72", "109", *more])
        told = "".join(capsys.readouterr())
        assert "angles are in rad: left_motor at 72 rad is 11.5 turns" in told
        assert "try:" not in told
    line = "--from 100 345 --to -50 195 --duration 1.5"
    assert main(["plan", "five_bar", *line.split()]) == 1
    told = capsys.readouterr().err
    assert f"points are in m: (100, 345) is {np.hypot(100, 345):.4g} m from the base" in told


def test_a_platform_out_of_reach_has_no_working_mode(capsys):
    assert main(["pose", "five_bar", "--platform", "0", "2", "--all"]) == 1
    out, err = capsys.readouterr()
    assert "0 of left_motor" in out
    assert "out of reach" in err


def test_motor_angles_are_gear_ratio_times_the_joint(posed):
    there = posed("five_bar", "--platform", 0.0, 0.3)
    for joint, angle in there["motor_joints"].items():
        assert there["motor_angles"][joint] == pytest.approx(50 * angle, rel=1e-15)
        assert there["joints"][joint] == angle


def test_a_pose_says_what_it_is_singular_for(posed, crossing):
    found = posed("five_bar", "--platform", 0, np.sqrt(0.06))["singularity"]
    assert (found["regular"], found["kinds"], found["torque_norm"]) == (False, ["type_2"], None)
    assert (
        "Type 2 singularity\n  t_s               x 0, y "
        in crossing("pose", "five_bar", "--platform", "0", str(np.sqrt(0.06)))[1]
    )
    assert posed("agile_eye", "--platform", 0, 0, 0)["singularity"]["regular"]


def test_limits_that_a_pose_leaves_are_named(crossing):
    assert "limits" not in crossing("pose", "five_bar", "--motors", "1.3", "1.2")[1]
    limits = robots.load("gough_stewart").limits
    legs = [limit.upper + 0.01 for limit in limits if limit.joint.endswith("motor")]
    text = crossing("pose", "gough_stewart", "--motors", *legs)[1]
    assert text.count("exceeds its limits: position") == 6


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((), 2, "give either --motors or --platform"),
        (("--motors", "1", "1", "--platform", "0", "0.3"), 2, "give either --motors or --platform"),
        (("--motors", "1"), 2, "must be 2 finite numbers"),
        (("--platform", "0", "nan"), 2, "must be 2 finite numbers"),
        (("--platform", "0", "3"), 1, "left_motor"),
        (("--motors", "1.2", "-1.9"), 1, "Type 2 singularity on the way"),
        (("--motors", "1.2", "1.9", "--all", "--torque-limit", "1"), 2, "--all: lists poses alone"),
    ],
)
def test_what_cannot_be_is_one_line(refusal, arguments, code, words):
    assert words in refusal(code, "pose", "five_bar", *arguments)


@pytest.mark.slow
def test_all_poses_of_the_motors_and_all_ways_to_a_platform(posed, crossing):
    found = posed("three_rpr", "--motors", 0.749, 0.769, 0.6, "--all")["assembly_modes"]
    assert (len(found["modes"]), found["complete"], found["bound"]) == (6, True, 6)
    assert all(mode["proved"] and mode["singularity"]["regular"] for mode in found["modes"])
    ways = posed("five_bar", "--platform", 0.1, 0.345, "--all")["working_modes"]
    assert (len(ways["modes"]), ways["solutions"], ways["complete"]) == (4, [2, 2], True)
    assert (
        "6 real of at most 6, each proved to exist"
        in crossing("pose", "three_rpr", "--motors", "0.749", "0.769", "0.6", "--all")[1]
    )


def test_a_pose_says_what_the_limits_of_the_motors_leave_to_its_joints(posed, crossing):
    limits = posed("humanoid_ankle", "--platform", 0.1, -0.1)["limits"]
    assert limits.keys() == {"wrench", "speed"}
    normals, offsets = (np.array(limits["wrench"][key]) for key in ("normals", "offsets"))
    for k, (low, high) in enumerate(limits["wrench"]["alone"]):
        for value in (low, high):
            assert np.max(normals @ (value * np.eye(2)[k]) - offsets) == pytest.approx(0.0, abs=1e-9)
    said = crossing("pose", "humanoid_ankle", "--platform", "0.1", "-0.1")[1]
    assert f"ankle_pitch {limits['wrench']['alone'][0][0]:.4g} .. " in said
    assert "rigid, without contact, the weight held" in said


def test_limits_of_motors_may_be_said_beside_the_robot(posed):
    assert posed("five_bar", "--platform", 0, 0.3)["limits"] == {}
    limits = posed("five_bar", "--platform", 0, 0.3, "--torque-limit", 0.2, "--speed-limit", 50, 60)
    twice = posed("five_bar", "--platform", 0, 0.3, "--torque-limit", 0.4)["limits"]
    np.testing.assert_allclose(twice["wrench"]["alone"], 2 * np.array(limits["limits"]["wrench"]["alone"]))
    assert limits["limits"].keys() == {"wrench", "speed"}
    assert main(["pose", "five_bar", "--platform", "0", "0.3", "--torque-limit", "1", "2", "3"]) == 2


def test_an_elastic_pose_has_its_stiffness_by_axis_and_direction_and_its_vibrations(document, crossing):
    """Along an axis the inverse of the compliance; of a payload on massless rods omega^2 is K over mass."""
    words = ("pose", "five_bar", "--platform", "0.05", "0.3")
    told = document(*words, "--flexibility", "flexible_links")["stiffness"]
    K = np.array(told["matrix"])
    np.testing.assert_allclose(list(told["along"].values()), 1 / np.diagonal(np.linalg.inv(K)), rtol=1e-9)
    softest = np.array(list(told["softest"].values()))
    least, vectors = np.linalg.eigh(K)
    np.testing.assert_allclose(np.abs(softest @ vectors[:, 0]), 1.0, rtol=1e-9)
    frequencies = np.array([one["frequency"] for one in told["vibrations"]])
    np.testing.assert_allclose((frequencies / frequencies[0]) ** 2, least / least[0], rtol=1e-6)
    assert "stiffness" not in document(*words)
    assert "softest           " in crossing(*words, "--flexibility", "flexible_links")[1]


@pytest.mark.slow
def test_the_softest_direction_and_the_vibrations_of_a_pose_are_drawn(crossing, tmp_path):
    words = ["pose", "five_bar", "--platform", "0.05", "0.3", "--flexibility"]
    picture = tmp_path / "modes.svg"
    assert "drawn" in crossing(*words, "flexible_links", "--picture", picture)[1]
    assert picture.read_bytes().startswith(b"<?xml")
    code, _, message = crossing(*words, "rigid", "--picture", tmp_path / "rigid.svg")
    assert code == 2
    remedy = message.split("; try: crossing ")[1].split()
    assert "--picture" in remedy
    assert remedy[remedy.index("--flexibility") + 1] == "flexible_links"
    assert main([*words, "flexible_links", "--picture", str(tmp_path / "modes.bmp")]) == 2
    assert [file.name for file in tmp_path.iterdir()] == ["modes.svg"]
