"""Assembly and working modes against the geometry of each robot and against published counts."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

import robots
from framework import InvalidInput, OutOfReach, ParallelRobot, assemble, dynamics_at
from framework.kinematics.diagnostics.diagnosis import describe_pose
from framework.proofs import converted_reference
from framework.proofs.assembly_modes import _null_space, assembly_modes
from framework.proofs.converted_reference import _other_modes
from framework.proofs.passive_joints import distance_from_reference
from framework.proofs.working_modes import working_modes
from tests.kinematics.linkages import frame, joint, linkage
from tests.robots.test_three_rpr import legs as three_rpr_legs
from tests.singularity.test_points_on_path import LEFT, LENGTH, RIGHT

# The 3-RPR of Innocenti and Parenti-Castelli with six real poses at these lengths: Wenger and Chablat, ARK
# 1998, and Zein, Wenger and Chablat, Robotica 25, 2007; unit 0.05 m
SIX = 0.05 * np.array([14.98, 15.38, 12.0])


def test_the_3_rpr_has_its_six_published_poses_and_no_other():
    robot = robots.load("three_rpr")
    found = assembly_modes(robot, SIX)
    assert (len(found.modes), found.complete, found.bound) == (6, True, 6)
    assert found.sentence.startswith("6 real of at most 6, each proved")
    for mode in found.modes:
        assert mode.proved
        np.testing.assert_allclose([float(leg[2]) for leg in three_rpr_legs(mode.x)], SIX, atol=1e-12)
        assert describe_pose(robot, mode.q).closure_error < 1e-12


def test_the_5r_has_two_poses_and_their_places_are_where_two_circles_meet():
    robot = robots.load("five_bar")
    for q_a in ([1.2, 1.9], [0.4, 2.2], [2.0, 0.9]):
        found = assembly_modes(robot, q_a)
        left, right = (
            motor + LENGTH * np.array([np.cos(a), np.sin(a)])
            for motor, a in zip((LEFT, RIGHT), q_a, strict=True)
        )
        way = right - left
        half = np.linalg.norm(way) / 2
        if half > LENGTH:
            assert found.modes == ()
            assert found.complete  # proved: they do not meet
            continue
        across = np.sqrt(LENGTH**2 - half**2) * np.array([-way[1], way[0]]) / (2 * half)
        exact = sorted([tuple(left + way / 2 + across), tuple(left + way / 2 - across)])
        np.testing.assert_allclose(sorted(tuple(mode.x) for mode in found.modes), exact, atol=1e-12)
        assert found.complete


def test_the_agile_eye_has_its_eight_published_modes():
    """At its reference: Bonev, Chablat and Wenger, ICRA 2006."""
    robot = robots.load("agile_eye")
    q_a = robot.actuated_coordinates(robot.reference.q[None])[0]
    found = assembly_modes(robot, q_a)
    assert (len(found.modes), found.complete) == (8, True)
    np.testing.assert_allclose(found.modes[0].x, robot.reference.x, atol=1e-9)


def check_modes(robot, found, q_a) -> None:
    """The reference is the first, and all close the loops with these motors."""
    np.testing.assert_allclose(found.modes[0].x, robot.reference.x, atol=1e-9)
    for mode in found.modes:
        assert describe_pose(robot, mode.q).closure_error < 1e-9
        np.testing.assert_allclose(robot.actuated_coordinates(mode.q[None])[0], q_a, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "finite"), [("gough_stewart", 28), ("delta", 36)])
def test_the_paths_of_a_symmetric_platform_that_have_no_pose_end_at_infinity(name, finite):
    robot = robots.load(name)
    q_a = robot.actuated_coordinates(robot.reference.q[None])[0]
    found = assembly_modes(robot, q_a)
    assert (found.status, found.complete) == ("numerically complete", False)
    assert (found.count.finite, found.count.infinite, found.count.lost) == (finite, 40 - finite, 0)
    assert "complete up to numerical path tracking" in found.sentence
    check_modes(robot, found, q_a)
    assert all(mode.proved for mode in found.modes)


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("slider_crank", "proved"),  # two joints follow: they are paved
        ("four_bar", "proved"),
        pytest.param("par4", "at least", marks=pytest.mark.slow),
        ("humanoid_ankle", "at least"),
    ],
)
def test_other_robots_are_searched(name, status):
    robot = robots.load(name)
    q_a = robot.actuated_coordinates(robot.reference.q[None])[0]
    found = assembly_modes(robot, q_a)
    assert (found.status, found.bound, found.count) == (status, None, None)
    assert found.modes[0].proved
    check_modes(robot, found, q_a)


def test_redundant_motors_are_refused():
    with pytest.raises(InvalidInput, match="depend on one another"):
        assembly_modes(robots.load("two_arms"), np.zeros(12))


@pytest.mark.parametrize(
    ("name", "count"), [("five_bar", 4), ("three_rrr", 8), ("biglide", 4), ("slider_crank", 2)]
)
def test_working_modes_are_those_of_their_legs(name, count):
    robot = robots.load(name)
    found = working_modes(robot, robot.reference.x)
    assert len(found.modes) == count == np.prod(found.solutions)
    assert (found.status, found.proved_legs) == ("proved", (True,) * len(found.legs))
    assert found.sentence.startswith(f"{count}, proved to be all")
    doubtful = replace(found, modes=(replace(found.modes[0], proved=False), *found.modes[1:]))
    assert (doubtful.status, doubtful.sentence.split(",")[0]) == ("at least", f"at least {count - 1}")
    assert len({tuple(mode.signs) for mode in found.modes}) == count
    assert sum(np.allclose(mode.q, robot.reference.q, atol=1e-9) for mode in found.modes) == 1
    for mode in found.modes:
        assert mode.proved
        pose = describe_pose(robot, mode.q)
        assert pose.closure_error < 1e-12
        np.testing.assert_allclose(list(pose.platform.values()), robot.reference.x, atol=1e-9)


def test_a_leg_of_negative_length_is_beyond_the_limits():
    robot = robots.load("three_rpr")
    found = working_modes(robot, robot.reference.x)
    assert len(found.modes) == 8
    assert [mode.within_limits for mode in found.modes] == [True] + 7 * [False]


def test_hinges_beyond_their_limits_are_turned_back_within():
    robot = robots.load("delta")  # at the reference, arm 1 points inward, half a turn from its way outward
    found = working_modes(robot, [0.05, 0.05, -1.0])
    assert all(mode.within_limits for mode in found.modes)
    assert max(describe_pose(robot, mode.q).closure_error for mode in found.modes) < 1e-9


def test_endless_hinges_are_told_within_half_a_turn(write_robot):
    """The 5R with endless joints, whose elbows count a turn more and a turn less at the reference."""
    turned = {"left_elbow": 2.0 * np.pi - 0.83362, "right_elbow": 1.538591 - 2.0 * np.pi}
    file = write_robot(*((f"reference.{name}", float(angle)) for name, angle in turned.items()))
    urdf = file.with_name("five_bar.urdf")
    urdf.write_text(re.sub("<limit.*/>", "", urdf.read_text()).replace('"revolute"', '"continuous"'))
    robot = ParallelRobot.from_file(file)
    motors = robot.actuated_coordinates(robot.reference.q[None])[0]
    for mode in (*assembly_modes(robot, motors).modes, *working_modes(robot, robot.reference.x).modes):
        assert np.abs(mode.q[robot.passive]).max() <= np.pi
        assert describe_pose(robot, mode.q).closure_error < 1e-12


@pytest.mark.parametrize("x", [(0.1, 0.345), (0.0, 0.2), (0.3, 0.1), (0.0, 0.9)])
def test_the_5r_has_as_many_working_modes_as_its_circles_meet(x):
    robot = robots.load("five_bar")
    elbows = 1
    for motor in (LEFT, RIGHT):  # both links are as long: they reach up to twice their length
        elbows *= 2 if np.linalg.norm(np.array(x) - motor) < 2 * LENGTH else 0
    found = working_modes(robot, x)
    assert (len(found.modes), found.status) == (elbows, "proved" if elbows else found.status)
    assert any(found.proved_legs)  # without modes, a leg that does not reach


def test_what_is_not_paved_is_said_to_be_more():
    robot = robots.load("bricard")  # six joints in one loop; mirrored, it is another solution
    found = working_modes(robot, robot.reference.x)
    assert (found.status, found.proved_legs) == ("at least", (False,))
    assert "2 or more of hinge_1" in found.sentence  # without those whose ring is turned over


def circles_meet(a, radius_a, b, radius_b):
    """The two points at given distances from two points of a plane."""
    way = np.subtract(b, a)
    apart = np.linalg.norm(way)
    along = (apart**2 + radius_a**2 - radius_b**2) / (2 * apart)
    up = np.sqrt(radius_a**2 - along**2) * np.array([-way[1], way[0]]) / apart
    return [a + along * way / apart + sign * up for sign in (1, -1)]


def planar(folder, elements, platform, reference) -> ParallelRobot:
    rest = (
        f"platform: {{joints: [{platform}]}}\nactuators: [{{joint: crank}}]\nclosures:\n"
        "  - {name: pin, frames: [pin, eye], axes: [x, y]}\n"
    )
    if "bolt" in elements:
        rest += "  - {name: bolt, frames: [bolt, lug], axes: [x, y]}\n"
    values = ", ".join(f"{name}: {value}" for name, value in reference.items())
    description = linkage(folder, elements, f"{rest}reference: {{{values}}}\n").description
    return ParallelRobot.from_description(description)


def test_poses_are_counted_by_all_joints_where_the_motor_is_the_platform(tmp_path):
    """The block is where the circle of the rod meets its rail, on either side of the crank's pin."""
    crank, rod, angle = 0.11, 0.3, 0.7
    block = crank * np.cos(angle) + np.sqrt(rod**2 - (crank * np.sin(angle)) ** 2)
    elements = (
        joint("crank", "base", mass=1)
        + joint("rod", "crank_link", (crank, 0, 0), mass=1)
        + frame("pin", "rod_link", (rod, 0, 0))
        + joint("block", "base", axis="x", kind="prismatic", limit='lower="-9" upper="9"', mass=1)
        + frame("eye", "block_link", (0, 0, 0))
    )
    tilt = -np.arcsin(crank * np.sin(angle) / rod)
    robot = planar(tmp_path, elements, "crank", {"crank": angle, "rod": tilt - angle, "block": block})
    found = assembly_modes(robot, [angle])
    blocks = [float(mode.q[robot.coordinates.names.index("block")]) for mode in found.modes]
    np.testing.assert_allclose(blocks, [block, 2 * crank * np.cos(angle) - block], atol=1e-12)
    assert found.complete


def test_poses_are_counted_by_hinges_that_carry_no_frame(tmp_path):
    """A chain whose end is pinned to the base: its middle hinge alone tells where two circles meet."""
    crank, coupler, rocker, angle, foot = 0.1, 0.29, 0.2, 0.9, np.array([0.3, 0.0])
    pin = crank * np.array([np.cos(angle), np.sin(angle)])
    elements = (
        joint("crank", "base", mass=1)
        + joint("coupler", "crank_link", (crank, 0, 0), mass=1)
        + joint("rocker", "coupler_link", (coupler, 0, 0), mass=1)
        + frame("pin", "rocker_link", (rocker, 0, 0))
        + frame("eye", "base", (*foot, 0))
    )
    expected = []
    for head in circles_meet(pin, coupler, foot, rocker):
        along, down = (np.arctan2(*np.subtract(b, a)[::-1]) for a, b in ((pin, head), (head, foot)))
        expected.append({"crank": angle, "coupler": float(along - angle), "rocker": float(down - along)})
    robot = planar(tmp_path, elements, "crank", expected[0])
    found = assembly_modes(robot, [angle])
    assert (len(found.modes), found.complete) == (2, True)
    turns = [np.exp(1j * np.array(list(robot.reference_values(mode.q).values()))) for mode in found.modes]
    for one in expected:
        assert min(np.abs(turn - np.exp(1j * np.array(list(one.values())))).max() for turn in turns) < 1e-9


@pytest.mark.parametrize("platform", ["crank", "rocker", "arm"])
def test_a_chain_of_two_dyads_has_four_poses_whatever_is_called_the_platform(tmp_path, platform):
    """Circles about the crank's pin and the rocker's foot meet twice, and so do two about the dyad's ends."""
    foot, far, angle = np.array([0.3, 0.0]), np.array([0.55, 0.02]), 0.9
    crank, coupler, rocker, bar, arm = 0.1, 0.29, 0.2, 0.27, 0.18
    pin = crank * np.array([np.cos(angle), np.sin(angle)])
    heads = circles_meet(pin, coupler, foot, rocker)
    tips = [(head, tip) for head in heads for tip in circles_meet(head, bar, far, arm)]
    elements = (
        joint("crank", "base", mass=1)
        + joint("coupler", "crank_link", (crank, 0, 0), mass=1)
        + frame("pin", "coupler_link", (coupler, 0, 0))
        + joint("rocker", "base", (*foot, 0), mass=1)
        + frame("eye", "rocker_link", (rocker, 0, 0))
        + joint("bar", "rocker_link", (rocker, 0, 0), mass=1)
        + frame("bolt", "bar_link", (bar, 0, 0))
        + joint("arm", "base", (*far, 0), mass=1)
        + frame("lug", "arm_link", (arm, 0, 0))
    )

    def joints(head, tip):
        def turn(v):
            return float(np.arctan2(v[1], v[0]))

        rocks = turn(head - foot)
        return {
            "crank": angle,
            "coupler": turn(head - pin) - angle,
            "rocker": rocks,
            "bar": turn(tip - head) - rocks,
            "arm": turn(tip - far),
        }

    robot = planar(tmp_path, elements, platform, joints(*tips[0]))
    found = assembly_modes(robot, [angle])
    assert (len(found.modes), found.complete) == (4, True)
    expected = [joints(*tip) for tip in tips]
    for mode in found.modes:
        values = robot.reference_values(mode.q)
        gaps = [max(abs(np.exp(1j * values[n]) - np.exp(1j * one[n])) for n in one) for one in expected]
        assert min(gaps) < 1e-9
        expected.pop(int(np.argmin(gaps)))


def test_a_rod_that_turns_over_in_its_universal_joint_is_no_mode(tmp_path):
    """A crank reaches the ball at two angles; for each the hinges of its rod have two solutions."""
    crank, rod, x = 0.12, 0.35, 0.31
    elements = (
        joint("motor", "base", (0, 0.05, 0), axis="y", mass=1)
        + joint("u_x", "motor_link", (0, 0, crank), axis="x")
        + joint("u_y", "u_x_link", axis="y", mass=1)
        + frame("tip", "u_y_link", (0, 0, rod))
        + joint("block", "base", axis="x", kind="prismatic", limit='lower="-9" upper="9"', mass=1)
    )

    def reach(angle):
        return np.linalg.norm([crank * np.sin(angle) - x, 0.05, crank * np.cos(angle)]) - rod

    angles = [brentq(reach, *ends) for ends in ((-np.pi / 2, 0.0), (np.pi, 1.5 * np.pi))]
    ball = np.array([x - crank * np.sin(angles[0]), -0.05, -crank * np.cos(angles[0])]) / rod
    c, s = np.cos(angles[0]), np.sin(angles[0])
    ball = np.array([c * ball[0] - s * ball[2], ball[1], s * ball[0] + c * ball[2]])  # on axes of the crank
    values = {"motor": angles[0], "u_x": np.arctan2(-ball[1], ball[2]), "u_y": np.arcsin(ball[0]), "block": x}
    rest = (
        "platform: {joints: [block]}\nactuators: [{joint: motor}]\n"
        "closures: [{name: ball, frames: [tip, block_link], kind: spherical}]\n"
        f"reference: {{{', '.join(f'{name}: {value}' for name, value in values.items())}}}\n"
    )
    robot = ParallelRobot.from_description(linkage(tmp_path, elements, rest).description)
    found = working_modes(robot, [x])
    assert (found.solutions, found.status) == ((2, 1), "proved")  # of the leg, of the block
    turns = np.exp(1j * np.array([mode.motors[0] for mode in found.modes]))
    np.testing.assert_allclose(turns, np.exp(1j * np.array(angles)), atol=1e-12)


def test_a_link_may_be_called_like_a_joint_or_like_pinocchios_base(write_robot):
    """In MJCF a body and its joint often share a name; each look-up of a frame states its type."""
    links = {"left_crank": "left_motor", "left_rod": "left_elbow", "right_crank": "universe"}
    changes = []
    for link, name in links.items():
        changes += [
            (f'{end}="{link}"', f'{end}="{name}"') for end in ("link name", "child link", "parent link")
        ]
    robot = ParallelRobot.from_file(write_robot(urdf=tuple(changes)))
    expected = assembly_modes(robots.load("five_bar"), [1.2, 1.9])
    found = assembly_modes(robot, [1.2, 1.9])
    np.testing.assert_allclose(
        [mode.x for mode in found.modes], [mode.x for mode in expected.modes], atol=1e-12
    )
    with pytest.raises(OutOfReach, match=r"links in one line reach 0\.7 m"):
        assemble(robot, [0.9, 0.3])
    force = {"universe": [1.0, 2.0, 0, 0, 0, 0]}
    assert np.isfinite(dynamics_at(robot, robot.reference.q, wrenches=force).torque).all()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_a_table_of_known_singular_values_has_their_ratio_as_condition_number(scale):
    rng = np.random.default_rng(0)
    U, V = (np.linalg.qr(rng.standard_normal((n, n)))[0] for n in (6, 5))
    null_space, condition_number = _null_space(scale * (U[:, :3] * [8.0, 2.0, 0.5]) @ V[:3])
    assert condition_number == pytest.approx(16.0, rel=1e-12)
    assert null_space.shape == (2, 5)
    np.testing.assert_allclose(null_space @ V[:3].T, 0.0, atol=1e-14)


def test_the_other_mode_of_few_joints_is_told_as_a_reference_that_leads_there():
    """Below the line between the elbows of the 5R, as far as the reference is above."""
    robot = robots.load("five_bar")
    (remark,) = _other_modes(robot)
    words = remark.partition("--reference ")[2].split()
    stated = {name: float(value) for name, value in (word.split("=") for word in words)}
    other = ParallelRobot.from_description(replace(robot.description, reference=stated)).reference.x
    left, right = (
        motor + LENGTH * np.array([np.cos(angle), np.sin(angle)])
        for motor, angle in ((LEFT, stated["left_motor"]), (RIGHT, stated["right_motor"]))
    )
    middle = 0.5 * (robot.reference.x + other)
    across = np.array([left[1] - right[1], right[0] - left[0]])
    assert across @ (middle - left) == pytest.approx(0.0, abs=1e-6)
    assert (right - left) @ (robot.reference.x - other) == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(robot.reference.x - other) > 0.1


def test_other_modes_of_many_joints_are_left_to_a_command(monkeypatch):
    robot = robots.load("gough_stewart")
    other = assemble(robot, robot.reference.x + 0.1).q
    found = SimpleNamespace(modes=[SimpleNamespace(q=robot.reference.q), SimpleNamespace(q=other)])
    monkeypatch.setattr(converted_reference, "assembly_modes", lambda robot, motors: found)
    (remark,) = _other_modes(robot)
    assert "in 1 ways, which crossing pose FILE --motors" in remark
    assert "--reference" not in remark


def test_distances_of_poses_are_in_rad_and_in_lengths_of_the_robot():
    robot = robots.load("three_rpr")
    slides = np.flatnonzero(robot.sliding)
    assert 0 < len(slides) < robot.nv
    for k in range(robot.nv):
        step = (robot.length if k in slides else 1.0) * np.eye(robot.nv)[k]
        assert distance_from_reference(robot, robot.reference.q + 0.3 * step) == pytest.approx(0.3)
