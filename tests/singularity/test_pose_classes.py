"""Each kind of singularity at a robot that has it, at poses built by geometry; distances by closed forms."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import robots
from framework import (
    InvalidInput,
    Line,
    ParallelRobot,
    assemble,
    classify,
    dynamics_at,
    locate_singularities,
    velocity_matrices,
)
from framework.kinematics.linearised_loops import linearised_at
from framework.singularity import pose_classes, type2
from robots.generators import delta, gough_stewart
from tests.oracles import five_bar as oracle
from tests.robots import test_n_four_bar as n_four_bar
from tests.robots import test_three_upu as three_upu
from tests.robots.transformed import scaled
from tests.singularity.test_drawn_locus import LINK, MOTORS, elbows

ROBOT = "five_bar"
TOP = np.sqrt(0.06)  # [m] above the base: both rods of the 5R in line


def configuration(robot, joints):
    """q (nq,) of joints by name, closed to rounding."""
    v = np.zeros(robot.model.nv)
    for joint, value in joints.items():
        v[robot.model.joints[robot.model.getJointId(joint)].idx_v] = value
    return pin.integrate(robot.model, pin.neutral(robot.model), v)


def five_bar(left_elbow, right_elbow, point):
    """The 5R with its elbows and the platform's point at these places."""
    angles = {}
    for side, motor, elbow in zip(("left", "right"), MOTORS, (left_elbow, right_elbow), strict=True):
        crank, rod = np.subtract(elbow, motor), np.subtract(point, elbow)
        angles[f"{side}_motor"] = np.arctan2(crank[1], crank[0])
        angles[f"{side}_elbow"] = np.arctan2(rod[1], rod[0]) - angles[f"{side}_motor"]
    return configuration(robots.load("five_bar"), angles)


def stretched():
    """The left leg of the 5R stretched, at 60 degrees."""
    along = np.array([0.5, np.sqrt(0.75)])
    point = MOTORS[0] + 2 * LINK * along
    return five_bar(MOTORS[0] + LINK * along, elbows(point)[1], point)


def on_the_self_motion_circle(angle):
    """Both elbows of the 5R at one place above the middle of the base; its point circles about them."""
    elbow = np.array([0.0, np.sqrt(LINK**2 - MOTORS[1][0] ** 2)])
    return five_bar(elbow, elbow, elbow + LINK * np.array([np.cos(angle), np.sin(angle)]))


def on_a_line_with_its_swing_axis():
    """Gough-Stewart with leg 2 along the first axis of its universal joint, about which it then spins."""
    base, corners = gough_stewart.base_joints(), gough_stewart.platform_joints()
    across = gough_stewart.home_axes(2)[:, 0]
    turn = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    centre = base[1] + 3.0 * across - turn @ corners[1]
    joints = {}
    for i in range(1, 7):
        home = gough_stewart.home_axes(i)
        leg = home.T @ (centre + turn @ corners[i - 1] - base[i - 1])
        joints[f"leg_{i}_motor"] = np.linalg.norm(leg)
        unit = leg / joints[f"leg_{i}_motor"]
        aligned = i == 2
        joints[f"leg_{i}_tilt"] = np.pi / 2 if aligned else np.arcsin(unit[0])
        joints[f"leg_{i}_swing"] = 0.2 if aligned else np.arctan2(-unit[1], unit[2])
    axes = gough_stewart.home_axes(1)
    tip = axes @ Rotation.from_euler("XY", [joints["leg_1_swing"], joints["leg_1_tilt"]]).as_matrix() @ axes.T
    ball = Rotation.from_matrix(tip.T @ turn).as_euler("XYZ")
    return configuration(
        robots.load("gough_stewart"), joints | dict(zip(("ball_x", "ball_y", "ball_z"), ball, strict=True))
    )


def delta_with_parallel_rods():
    """All six rods of the Delta vertical: they resist vertical forces and level couples alone."""
    arm = np.arccos((delta.PLATFORM - delta.BASE) / delta.ARM)  # from outward; above the base
    joints = {}
    robot = robots.load("delta")
    for leg in "123":
        joints[f"motor_{leg}"] = -arm
        for rod in "ab":
            joints[f"swing_{leg}{rod}"] = arm
    return robot, joints


def test_a_regular_pose_is_none_of_them(robot):
    found = classify(robot, assemble(robot), along=[0, 1])
    assert found.regular
    assert (found.kinds, found.legs, found.contact) == ((), (), "")
    assert (found.corank, found.corank_inverse, found.gained) == (0, 0, 0)
    assert found.sentence == "regular"


def test_type_1_names_the_leg():
    found = classify(robots.load("five_bar"), stretched())
    assert found.kinds == ("type_1",)
    assert found.legs == ("left_motor",)
    assert (found.corank, found.corank_inverse) == (0, 1)
    assert found.torque_norm > 0  # and finite: along the leg no motor is needed, across it the lever is known
    assert np.isfinite(found.torque_norm)


def test_type_2_gives_the_twist_that_the_motors_do_not_hold(robot):
    found = classify(robot, assemble(robot, [0, TOP]))
    assert found.kinds == ("type_2",)
    np.testing.assert_allclose(np.abs(found.twists), [[0, 1]], atol=1e-12)
    assert abs(found.g) < 1e-14
    assert found.torque_norm == found.motor_torque_largest == np.inf
    np.testing.assert_allclose(found.transmission_angle, 0, atol=1e-7)


def test_both_at_once_are_both_named(robot):
    motor_to_elbow = np.array([-MOTORS[0][0], np.sqrt(LINK**2 - MOTORS[0][0] ** 2)])
    found = classify(robot, on_the_self_motion_circle(np.arctan2(motor_to_elbow[1], motor_to_elbow[0])))
    assert found.kinds == ("type_1", "type_2")
    assert found.legs == ("left_motor",)


def test_the_self_motion_circle_is_type_2_all_round():
    for angle in (0.3, 2.0, 4.0):
        found = classify(robots.load("five_bar"), on_the_self_motion_circle(angle))
        assert found.kinds == ("type_2",)
        np.testing.assert_allclose(
            np.abs(found.twists @ [np.cos(angle), np.sin(angle)]), 0, atol=1e-9
        )  # along the circle


def test_a_leg_that_spins_about_itself_is_leg_passive():
    found = classify(robots.load("gough_stewart"), on_a_line_with_its_swing_axis())
    assert found.kinds == ("leg_passive",)
    assert (found.corank, found.corank_inverse, len(found.twists)) == (1, 1, 0)


def test_a_platform_that_gains_freedoms_is_a_constraint_singularity():
    robot = robots.load("three_upu")
    found = classify(robot, configuration(robot, three_upu.joints(np.array([0, 0, 0.5]))))
    assert found.kinds == ("constraint",)
    assert (found.corank, found.gained) == (2, 2)


def test_loops_that_lose_rank_by_themselves_are_told_from_all_others():
    robot = robots.load("n_four_bar")
    found = classify(robot, configuration(robot, n_four_bar.configuration(2, np.pi / 2)))
    assert found.kinds == ("closure",)
    assert found.gained == 2


def test_several_kinds_at_one_pose():
    """Parallel rods leave the Delta two translations, Type 2, and a turn that it has nowhere else."""
    robot, joints = delta_with_parallel_rods()
    found = classify(robot, configuration(robot, joints))
    assert found.kinds == ("type_2", "constraint")
    assert found.corank == 3
    np.testing.assert_allclose(np.linalg.svd(found.twists[:, :2])[1], 1, atol=1e-9)
    np.testing.assert_allclose(found.twists[:, 2], 0, atol=1e-12)


@pytest.fixture(scope="module")
def griffis_duffy(tmp_path_factory):
    """Two triangles, the corners of each tied to the middles of the other's sides: Griffis and Duffy 1993."""
    folder = tmp_path_factory.mktemp("griffis_duffy")

    def triangle(radius, phase):
        angle = np.deg2rad(np.array([0, 120, 240]) + phase)
        corners = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        middles = (corners + np.roll(corners, -1, axis=0)) / 2
        return np.stack([corners, middles], axis=1).reshape(6, 3)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gough_stewart, "base_joints", lambda: triangle(3.0, 0))
        patch.setattr(gough_stewart, "platform_joints", lambda: np.roll(triangle(1.0, 60), 1, axis=0))
        (folder / "gough_stewart.urdf").write_text(gough_stewart.urdf(), encoding="utf-8")
        legs = gough_stewart.platform_joints() + np.array([0, 0, 2.0]) - gough_stewart.base_joints()
    text = robots.CATALOGUE["gough_stewart"].file.read_text(encoding="utf-8")
    head, _, rest = text.partition("reference:")
    lengths = "".join(f"\n  leg_{i + 1}_motor: {float(np.linalg.norm(leg))!r}" for i, leg in enumerate(legs))
    file = folder / "griffis_duffy.yaml"
    file.write_text(f"{head}reference:{lengths}\n", encoding="utf-8")
    assert "scenes" in rest
    return ParallelRobot.from_file(file)


def test_an_architecturally_singular_platform_is_told_from_one_that_is_singular_here(griffis_duffy):
    for x in ([0, 0, 2, 0, 0, 0], [0.2, -0.1, 2.1, 0.2, -0.1, 0.3]):
        found = classify(griffis_duffy, assemble(griffis_duffy, x))
        assert "architectural" in found.kinds
    robot = robots.load("gough_stewart")
    for along, contact in (([0, 0, 1, 0, 0, 0], "transversal"), ([1, 0, 0, 0, 0, 0], "tangential")):
        flat = classify(robot, assemble(robot, np.zeros(6)), along=along)
        assert flat.kinds == ("type_2",)
        assert (flat.corank, len(flat.twists), flat.contact) == (3, 3, contact)


def test_a_touch_a_crossing_and_a_near_miss_are_told_apart(robot):
    on = assemble(robot, [0, TOP])
    assert classify(robot, on, along=[0, 1]).contact == "transversal"
    assert classify(robot, on, along=[1, 0]).contact == "tangential"  # the locus is level there, by symmetry

    def lost(y):
        return classify(robot, assemble(robot, [0, y])).sigma_A - 4e-5

    beside = assemble(robot, [0, brentq(lost, TOP + 1e-9, TOP + 1e-3, xtol=1e-14)])
    miss = classify(robot, beside, along=[1, 0])
    assert miss.sigma_A == pytest.approx(4e-5, abs=1e-9)
    assert miss.regular
    assert miss.contact == ""
    assert np.isfinite(miss.torque_norm)


@pytest.mark.parametrize("point", [[0.1, 0.345], [-0.05, 0.195], [0.15, 0.1]])
def test_the_distances_of_the_5r_are_those_of_its_geometry(robot, point):
    found = classify(robot, assemble(robot, point))
    A, B = oracle.velocity_matrices(point)[:2]  # joint side
    held = np.linalg.solve(A.T, np.eye(2)).T @ np.asarray(B)  # row: torques of a unit force along an axis
    assert found.torque_norm == pytest.approx(np.linalg.norm(held, 2), rel=1e-9)
    assert found.torque_largest == pytest.approx(np.linalg.norm(held, axis=0).max(), rel=1e-9)
    assert found.motor_torque_norm == pytest.approx(found.torque_norm / 50, rel=1e-12)
    left, right = ((point - elbow) / LINK for elbow in elbows(np.array(point)))
    between = np.arccos(np.abs(left @ right))  # of the two rods
    np.testing.assert_allclose(found.transmission_angle, between, rtol=1e-9)


@pytest.mark.parametrize("name", ["delta", "agile_eye", "gough_stewart", "humanoid_knee", "two_arms"])
def test_the_conditioning_is_that_of_orthonormal_rows_that_passive_joints_do_not_enter(name):
    robot = robots.load(name)
    A = velocity_matrices(robot, robot.reference.q).A * robot.platform_scale  # from a null space by QR
    assert classify(robot, robot.reference.q).sigma_A == pytest.approx(np.linalg.svd(A).S[-1], rel=1e-12)


def test_the_worst_torque_per_newton_is_reached_and_not_passed_by_statics():
    robot = robots.load("delta")
    q = assemble(robot).q
    found = classify(robot, q)
    rng, worst = np.random.default_rng(4), 0.0
    rest = dynamics_at(robot, q).torque
    for force in rng.standard_normal((100, 3)):
        wrench = np.concatenate([force / np.linalg.norm(force), np.zeros(3)])
        torque = dynamics_at(robot, q, wrenches={"platform": wrench}).torque - rest  # motor side
        worst = max(worst, float(np.linalg.norm(torque)))
        assert np.abs(torque).max() <= found.motor_torque_largest * (1 + 1e-9)
    assert worst <= found.motor_torque_norm * (1 + 1e-9)
    assert worst > 0.9 * found.motor_torque_norm


def test_no_contact_is_given_where_no_path_can_be_followed(robot):
    q = on_the_self_motion_circle(np.arctan2(np.sqrt(LINK**2 - 0.04), 0.2))
    with pytest.raises(InvalidInput, match="does not determine its joints"):
        classify(robot, q, along=[0.8, 0.6])


@pytest.mark.parametrize("resting", [0, 1])
def test_the_twist_is_of_a_motion_that_moves_the_platform(resting, monkeypatch):
    """Of two motions one leaves the platform at rest, whichever comes last: t_s is that of the other."""
    robot = robots.load("five_bar")
    linearised = linearised_at(robot, robot.reference.q[None])
    X = linearised.platform[0]
    _, _, V = np.linalg.svd(X)
    moving, still = 3.0 * V[0] + 0.5 * V[1], V[-1]  # X still = 0
    motions = np.array([still, moving] if resting == 0 else [moving, still])
    space = type2.UncontrolledSpace(frozenset({"type_2", "leg_passive"}), motions, 2)
    monkeypatch.setattr(type2, "uncontrolled_space", lambda *given, **options: space)
    found = type2.uncontrolled_motion(robot, linearised)
    assert (found.kind, found.corank) == ("type_2", 2)
    assert np.linalg.norm(found.twist) == pytest.approx(1.0)
    np.testing.assert_allclose(X @ found.motion, found.twist, atol=1e-12)


@pytest.mark.parametrize(("beside", "there"), [(0.0, 0.0), (0.0, 0.3), (0.3, 0.0)])
def test_a_robot_is_singular_everywhere_if_it_is_so_at_all_poses_that_are_drawn(beside, there, monkeypatch):
    """With the reference singular, poses beside it or beside the pose in question may be regular."""
    robot = SimpleNamespace(reference=SimpleNamespace(q=0.0))
    nearby = {0.0: [beside] * 3, 1.0: [there] * 3}  # clearances of poses near the reference, near the pose
    monkeypatch.setattr(pose_classes, "nearby_configurations", lambda robot, q: nearby[q])
    monkeypatch.setattr(pose_classes, "linearised_at_reference", lambda robot: robot.reference.q)
    monkeypatch.setattr(pose_classes, "linearised_at", lambda robot, q: q)
    monkeypatch.setattr(pose_classes, "clearance", lambda robot, values: np.atleast_1d(values))
    assert pose_classes._is_singular_everywhere(robot, 1.0) == (beside == there == 0.0)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_slides_cross_the_locus_whatever_the_size_of_the_robot(size):
    robot = ParallelRobot.from_description(scaled(robots.load("orthoglide").description, size))
    (point,) = locate_singularities(robot, Line([0, 0, 0], [0.15 * size] * 3))
    q = assemble(robot, point.platform).q
    assert classify(robot, q, along=size * np.array([1.0, 0.3, -0.2])).contact == "transversal"
