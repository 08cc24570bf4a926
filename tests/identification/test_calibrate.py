"""Calibrated geometry against the one that the poses were made with, and what poses cannot show."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import InvalidInput, Line, NoAnswer, NotConverged, ParallelRobot, assemble, forward_kinematics
from framework.cli import main
from framework.identification import Recording, calibrate
from framework.identification.calibrate import NOISE, _prediction_error, _solve_at_platform
from framework.identification.geometry import parametrise_geometry, select_measurements
from framework.kinematics.continuation.forward_kinematics import forward_kinematics_stack
from tests.identification.measured_poses import TRACKER, off_by, only, poses, with_geometry

KINDS = ("five_bar", "three_rrr", "delta", "gough_stewart")
NOMINAL = {name: robots.load(name) for name in KINDS}
SEEDS = {"five_bar": 10, "three_rrr": 3, "delta": 2, "gough_stewart": 1}
MEASURED = ("motor_angle", "platform")


@cache
def calibrated(name: str, seed: int, count: int):
    """Parameters a millimetre and a degree off, and what so many poses of that robot show of them."""
    _, values, true = off_by(NOMINAL[name], 100 + seed)
    return values, calibrate(NOMINAL[name], only(poses(true, NOMINAL[name], count, seed), *MEASURED))


def share_of_noise(found) -> float:
    """The largest error of the platform's coordinates held out, over the tracker's noise."""
    driven = found.robot.n_a
    return float((found.error_after[driven:] / found.measured.noise[driven:]).max())


@pytest.mark.slow
def test_poses_held_out_are_predicted_to_the_noise():
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 0)
    done: list[int] = []
    found = calibrate(nominal, only(poses(true, nominal, 48, 1), *MEASURED), progress=done.append)
    assert done == list(range(1, found.steps + 1))
    assert found.error_before[2:].max() > 5e-4
    assert share_of_noise(found) < 1.6
    assert 0.7 < found.noise < 1.4
    x = [forward_kinematics(robot, [1.2, 1.0]).x for robot in (true, found.calibrated_robot())]
    np.testing.assert_allclose(x[0], x[1], rtol=0, atol=3 * TRACKER)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_millimetre_and_a_degree_converge(name):
    for seed in range(SEEDS[name]):
        _, found = calibrated(name, seed, 60)
        assert 0.6 < found.noise < 1.5
        assert found.error_after.max() < 0.05 * found.error_before.max()  # more than noise beside Type 2


@pytest.mark.slow
@pytest.mark.parametrize("count", [8, 12, 60])
def test_parameters_are_within_three_deviations(count):
    """Of combinations that are determined; the prior's width counts where they are not."""
    inside = []
    for seed in range(10):
        values, found = calibrated("five_bar", seed, count)
        in_plane = np.array([not name.endswith((".z", ".rx", ".ry")) for name in found.geometry.names])
        inside.append(np.abs(found.values - values)[in_plane] < 3.0 * found.deviations[in_plane])
    assert np.mean(inside) >= 0.95


def test_fewer_equations_than_parameters_leave_the_noise_assumed():
    nominal = NOMINAL["five_bar"]
    _, values, true = off_by(nominal, 0)
    found = calibrate(nominal, only(poses(true, nominal, 4, 0, noise=1e-6), *MEASURED))
    assert found.noise == 1.0
    assert found.degrees_of_freedom < 1.0
    assert (np.abs(found.values - values) < 3.0 * found.deviations + 1e-12).mean() >= 0.95


def test_loops_that_do_not_close_at_poses_held_out_are_refused():
    nominal = NOMINAL["five_bar"]
    geometry = parametrise_geometry(nominal)
    measured = select_measurements(geometry, only(poses(nominal, nominal, 8, 0), *MEASURED), NOISE)
    start = forward_kinematics_stack(geometry.model, measured.values[:, :2]).q
    values = np.zeros(len(geometry.names))
    assert _prediction_error(geometry, measured, start, "motors", values).max() < 3 * TRACKER
    values[geometry.names.index("right_rod_tip.x")] = 1.0
    with pytest.raises(NotConverged, match="loops do not close"):
        _prediction_error(geometry, measured, start, "motors", values)


def test_poses_on_both_sides_of_type_2_calibrate_where_the_platform_is_measured():
    """The motors lead to the other side's poses by no way; without the whole platform they are refused."""
    nominal = NOMINAL["five_bar"]
    true = off_by(nominal, 3)[2]
    random = np.random.default_rng(3)
    x = Line([0.1, 0.345], [-0.05, 0.195])(np.linspace(0.0, 1.0, 32)) + 0.02 * random.uniform(-1, 1, (32, 2))
    angles = true.actuated_coordinates(np.array([assemble(true, each).q for each in x])) * true.gear_ratio
    x += TRACKER * random.standard_normal(x.shape)
    names = ("motor_angle_left_motor", "motor_angle_right_motor", "platform_x", "platform_y")
    data = Recording("both_sides", names, np.column_stack([angles, x]))
    found = calibrate(nominal, data)
    assert found.poses == "platform"
    assert 0.5 < found.noise < 1.6
    assert [name for name, *_ in found.errors_held_out()] == list(names[:2])
    assert (found.error_after[:2] < 2 * TRACKER / 0.25).all()  # the tracker's noise, seen from the cranks
    assert found.error_before[:2].max() > 5e-3
    back = found.calibrated_robot()
    motors = [robot.actuated_coordinates(assemble(robot, [-0.02, 0.21]).q[None]) for robot in (true, back)]
    np.testing.assert_allclose(motors[0], motors[1], rtol=0, atol=1e-3)
    with pytest.raises(NoAnswer):
        calibrate(nominal, only(data, "motor_angle", "platform_x"))


def test_slides_beyond_their_ranges_reach_as_far_as_they_are_measured():
    robot = robots.load("three_rpr")  # slides of at most 1.2 m
    x = robot.reference.x + np.array([1.5, 0.4, 0.0])
    q_a = robot.actuated_coordinates(assemble(robot, x).q[None])  # (1, 3) up to 1.97 m
    names = (
        *(f"motor_angle_{joint}" for joint in robot.actuator_names),
        "platform_x",
        "platform_y",
        "platform_rz",
    )
    geometry = parametrise_geometry(robot)

    def solve(q_a: np.ndarray) -> np.ndarray | None:
        data = Recording("far", names, np.column_stack([q_a * robot.gear_ratio, x[None]]))
        return _solve_at_platform(geometry, select_measurements(geometry, data, NOISE))

    np.testing.assert_allclose(geometry.model.actuated_coordinates(solve(q_a)), q_a, rtol=0, atol=1e-12)
    assert solve(0.1 * q_a) is None


def test_an_error_of_one_rod_is_found_and_named():
    nominal = NOMINAL["five_bar"]
    geometry = parametrise_geometry(nominal)
    values = np.zeros(len(geometry.names))
    values[geometry.names.index("right_rod_tip.x")] = 2e-3
    true = with_geometry(geometry, values)
    found = calibrate(nominal, only(poses(true, nominal, 40, 3), *MEASURED))
    off = np.abs(found.values) / found.deviations
    assert geometry.names[int(off.argmax())] == "right_rod_tip.x"
    assert (np.abs(found.values - values) < 3.0 * found.deviations + 1e-12).all()


@pytest.mark.parametrize("name", ["five_bar", pytest.param("delta", marks=pytest.mark.slow)])
def test_poses_do_not_change_along_what_is_unseen(name):
    """The first derivative of poses along each direction vanishes: by differences over a range of steps."""
    nominal = NOMINAL[name]
    _, _, true = off_by(nominal, 0)
    data = only(poses(true, nominal, 24, 1), *MEASURED)
    found = calibrate(nominal, data)
    geometry, rows = found.geometry, np.flatnonzero(np.arange(len(data)) % 4 != 3)[:6]
    q_a = data.values[rows, : nominal.n_a] / nominal.gear_ratio
    own = forward_kinematics_stack(nominal, q_a).x
    random = np.random.default_rng(0)
    unseen = found.combinations.unseen
    for direction in unseen[random.permutation(len(unseen))[:6]]:
        step = 1e-6 * direction / np.abs(direction).max()
        ahead, back = (
            forward_kinematics_stack(with_geometry(geometry, sign * step), q_a).x for sign in (1.0, -1.0)
        )
        # the second order of a step of 1e-6 is 1e-12
        assert np.abs(ahead - own).max() < 1e-11
        assert np.abs(ahead - back).max() < 1e-12 * nominal.length


@pytest.mark.slow
def test_what_poses_cannot_show_is_named_with_what_would():
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 0)
    data = poses(true, nominal, 40, 1)
    found = calibrate(nominal, only(data, *MEASURED))
    assert "left_elbow.rz not at all; joint_left_elbow would show it" in found.unseen
    assert any("left_motor.z and left_elbow.z only as their sum" in said for said in found.unseen)
    with_elbows = calibrate(nominal, data)
    assert with_elbows.combinations.rank > found.combinations.rank
    assert not any(said.startswith("left_elbow.rz") for said in with_elbows.unseen)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [("motor_angle", "platform_x"), ("motor_angle", "joint")])
def test_parts_of_poses_and_loops_alone_calibrate_as_well(columns):
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 2)
    found = calibrate(nominal, only(poses(true, nominal, 60, 1), *columns), noise={"joint": 1e-5})
    assert (found.error_after[2:] < 0.1 * found.error_before[2:]).all()


@pytest.mark.slow
def test_outliers_count_little_and_are_named():
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 0)
    data = only(poses(true, nominal, 48, 1), *MEASURED)
    values = data.values.copy()
    values[[4, 20, 41], 2] += 5e-3
    found = calibrate(nominal, Recording("poses", data.names, values))
    assert {4, 20, 41} <= set(found.outliers)
    assert "sample 5" in found.outlier_rows
    x = [forward_kinematics(robot, [1.2, 1.0]).x for robot in (true, found.calibrated_robot())]
    np.testing.assert_allclose(x[0], x[1], rtol=0, atol=1e-4)


RODS = (0.3, 0.32)  # [m] of the two sliders below


def sliders_with_rods(
    folder: Path, lengths: tuple[float, float], texts: tuple[str, ...] = ()
) -> ParallelRobot:
    """Two sliders on the x axis that carry a point in the plane by rods, `distance` closures."""
    inertial = '<inertial><mass value="0.1"/>' + (
        '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    slides = (("left", "base", "x"), ("right", "base", "x"), ("tx", "base", "x"), ("ty", "sx", "y"))
    children = {"left": "a", "right": "b", "tx": "sx", "ty": "point"}
    text = '<robot name="sliders"><link name="base"/>'
    for name, parent, axis in slides:
        link = children[name]
        text += f'<link name="{link}">{inertial}</link><joint name="{name}" type="prismatic">'
        text += f'<parent link="{parent}"/><child link="{link}"/><axis xyz="{" ".join(AXES[axis])}"/>'
        text += '<origin xyz="${shift} 0 0"/>' if texts and name == "right" else ""
        text += '<limit lower="-2" upper="2" effort="9" velocity="9"/></joint>'
    (folder / "sliders.urdf").write_text(text + "</robot>")
    closures = [
        f"  - {{name: rod_{a}, frames: [{a}, point], kind: distance, length: {length}}}"
        for a, length in zip("ab", texts or lengths, strict=True)
    ]
    file = folder / f"sliders_{lengths[0]}.yaml"
    if texts:
        closures.append(f"parameters: {{l: {lengths[0]}, shift: 0.0, unused: 1.0}}")
    lines = ["version: 1", "urdf: sliders.urdf", "platform: {frame: point, axes: [x, y]}", "actuators:"]
    lines += ["  - {joint: left}", "  - {joint: right}", "closures:", *closures]
    lines += ["reference: {left: -0.2, right: 0.2, tx: 0.0, ty: 0.23}"]
    file.write_text("\n".join(lines) + "\n")
    return ParallelRobot.from_file(file)


AXES = {"x": "100", "y": "010"}


def heights(lengths: tuple[float, float], noise: float) -> Recording:
    """Positions of the point by the closed form, at random positions of the sliders; the noise in metres."""
    random = np.random.default_rng(0)
    left, right = random.uniform(0.1, 0.25, (2, 40)) * [[-1.0], [1.0]]
    base = right - left  # law of cosines
    along = (lengths[0] ** 2 - lengths[1] ** 2 + base**2) / (2.0 * base)
    x, y = left + along, np.sqrt(lengths[0] ** 2 - along**2)
    rows = np.column_stack([left, right, x, y])
    rows[:, 2:] += noise * random.standard_normal((40, 2))
    names = ("motor_angle_left", "motor_angle_right", "platform_x", "platform_y")
    return Recording("poses", names, rows)


def least_deviations(lengths: tuple[float, float], columns: slice, noise: float) -> np.ndarray:
    """The Cramer-Rao bound of both lengths from the poses of a fit, by differences of the closed form."""
    slopes = []
    for step in 1e-6 * np.eye(2):
        ahead, back = (heights(tuple(lengths + sign * step), 0.0).values for sign in (1.0, -1.0))
        slopes.append((ahead - back)[np.arange(40) % 4 != 3, columns].ravel() / 2e-6)
    return noise * np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.array(slopes).T)))


@pytest.mark.parametrize(
    ("names", "columns"), [("platform", slice(2, 4)), ("platform_y", slice(3, 4))], ids=["x and y", "y"]
)
def test_lengths_of_distance_closures_are_calibrated(names, columns, tmp_path):
    """To the Cramer-Rao bound: heights are nearly functions of the sum of both lengths alone.

    The noise of 30 poses has 28 degrees of freedom or more, so that it is known to 3 / sqrt(56) = 40 %;
    Student's t widens intervals by a tenth.
    """
    true = (RODS[0] + 2e-3, RODS[1] - 1.5e-3)
    nominal = sliders_with_rods(tmp_path, RODS)
    data = only(heights(true, 1e-5), "motor_angle", names)
    found = calibrate(nominal, data, joints=["rod_a", "rod_b"], noise={"motor_angle": 1e-9})
    assert found.geometry.names == ("rod_a.length", "rod_b.length")
    assert (np.abs(found.values - np.subtract(true, RODS)) < 4.0 * found.deviations).all()
    np.testing.assert_allclose(found.deviations, 1.1 * least_deviations(true, columns, 1e-5), rtol=0.4)
    written = ParallelRobot.from_file(found.write(tmp_path / "new"))
    lengths = [closure.length for closure in written.description.closures]
    np.testing.assert_allclose(lengths, np.add(RODS, found.values), rtol=1e-12)


@pytest.mark.slow
def test_numbers_of_the_robot_file_are_calibrated_by_name(tmp_path):
    """Both rods grow with l, and `shift` places the right slide, whose encoder shows an offset."""
    nominal = sliders_with_rods(tmp_path, RODS, ("${l}", "${l + 0.02}"))
    data = only(heights((RODS[0] + 2e-3, RODS[1] + 2e-3), 1e-5), *MEASURED)
    values = data.values.copy()
    values[:, 1] -= 1e-3
    shifted = Recording("poses", data.names, values)
    found = calibrate(nominal, shifted, joints=["l", "shift"], noise={"motor_angle": 1e-9})
    assert found.geometry.names == ("l", "shift")
    assert (np.abs(found.values - [2e-3, 1e-3]) < 4.0 * found.deviations).all()
    assert found.deviations.max() < 1e-5
    lengths = [closure.length for closure in found.calibrated_robot().description.closures]
    np.testing.assert_allclose(lengths, np.add(RODS, found.values[0]), rtol=0, atol=1e-12)
    with pytest.raises(InvalidInput, match="unused changes no joint origin and no length"):
        calibrate(nominal, data, joints=["unused"])
    with pytest.raises(InvalidInput, match="joints: l and rod_a: give parameters"):
        calibrate(nominal, data, joints=["l", "rod_a"])


def measured_by(column: str, values: np.ndarray, lengths: tuple[float, float], x, y) -> Recording:
    """Positions of the sliders by the closed form with the point at x, y, and what a fixture shows there."""
    left, right = x - np.sqrt(lengths[0] ** 2 - y**2), x + np.sqrt(lengths[1] ** 2 - y**2)
    names = ("motor_angle_left", "motor_angle_right", column)
    return Recording("poses", names, np.column_stack([left, right, values]))


@pytest.mark.parametrize(
    ("wrong", "lengths", "joints"),
    [
        ((2e-3, -1.5e-3), (), ["rod_a", "rod_b"]),
        # numbers of the file: rods that are both too long move the point along a curved valley
        pytest.param((2e-3, 2e-3), [("${l}", "${l + 0.02}")], ["l"], marks=pytest.mark.slow),
    ],
)
def test_a_ball_bar_from_an_unknown_point_calibrates_lengths(tmp_path, wrong, lengths, joints):
    """Distances from a point beside the plane of the mechanism, whose place is found as well."""
    true, centre = np.add(RODS, wrong), np.array([0.03, -0.2, 0.05])
    random = np.random.default_rng(2)
    x, y = random.uniform(-0.08, 0.08, 60), random.uniform(0.18, 0.27, 60)
    distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + centre[2] ** 2)
    data = measured_by("distance_bar", distance + 1e-6 * random.standard_normal(60), true, x, y)
    nominal, k = sliders_with_rods(tmp_path, RODS, *lengths), len(joints)
    found = calibrate(nominal, data, joints=joints, noise={"motor_angle": 1e-9, "platform": 1e-6})
    assert found.geometry.names[k:] == ("distance_bar.x", "distance_bar.y", "distance_bar.z")
    assert (np.abs(found.values[:k] - wrong[:k]) < 4.0 * found.deviations[:k]).all()
    assert k == 1 or found.deviations[:k].max() < 1e-4
    (fixture,) = found.geometry.fixtures
    off_centre = np.abs(np.abs(fixture.start + found.values[k:]) - np.abs(centre))
    assert (off_centre < 4.0 * found.deviations[k:]).all()


def test_touches_calibrate_numbers_of_the_robot_file(tmp_path):
    """A plane's numbers change no dimension, whatever the numbers of the file do."""
    true, block = (RODS[0] + 2e-3, RODS[1] + 2e-3), np.repeat((0.0, 0.02, 0.05), 20)
    x = np.tile(np.linspace(-0.08, 0.08, 20), 3)
    touched = 0.2 + 0.03 * x + block + 1e-6 * np.random.default_rng(3).standard_normal(60)
    data = measured_by("touch_y", block, true, x, touched)
    nominal = sliders_with_rods(tmp_path, RODS, ("${l}", "${l + 0.02}"))
    found = calibrate(nominal, data, joints=["l"], noise={"motor_angle": 1e-6, "platform": 1e-6})
    assert abs(found.values[0] - 2e-3) < 4.0 * found.deviations[0]
    np.testing.assert_allclose(found.geometry.slopes(found.values), [[1, 0, 0, 0]] * 2, atol=1e-9)


@pytest.mark.parametrize("gauges", [(0.0,), (0.0, 0.02, 0.05)], ids=["one height", "gauge blocks"])
def test_touches_of_a_plane_show_what_their_heights_show(gauges, tmp_path):
    """At one height rods and plane are the same to the slides; blocks of known height tell them apart."""
    true = (RODS[0] + 2e-3, RODS[1] + 2e-3)
    x = np.tile(np.linspace(-0.08, 0.08, 20), len(gauges))
    block = np.repeat(gauges, 20)
    y = 0.2 + 0.03 * x + block
    touched = y + 1e-6 * np.random.default_rng(3).standard_normal(len(y))  # not quite the point
    data = measured_by("touch_y", block, true, x, touched)
    options = {"joints": ["rod_a", "rod_b"], "noise": {"motor_angle": 1e-6, "platform": 1e-6}}
    found = calibrate(sliders_with_rods(tmp_path, RODS), data, **options)
    assert found.geometry.names[2:] == ("touch_y.height", "touch_y.slope_x", "touch_y.slope_z")
    off = np.abs(found.values[:2] - np.subtract(true, RODS))
    assert (off < 4.0 * found.deviations[:2] + 1e-6).all()
    sum_is_seen = abs(found.values[:2].sum() - 4e-3) < 1e-4
    assert sum_is_seen == (len(gauges) > 1)
    assert any("touch_y.slope_z" in said for said in found.unseen)


def test_further_poses_leave_the_deviations_that_are_said(tmp_path):
    """Poses in a window of a millimetre leave the rods to the file; those advised are measured as well."""

    def measure(x: np.ndarray, y: np.ndarray) -> Recording:
        return measured_by("platform_y", y + 1e-6 * random.standard_normal(len(y)), true, x, y)

    random = np.random.default_rng(0)
    true = (RODS[0] + 1e-3, RODS[1] - 1e-3)
    nominal = sliders_with_rods(tmp_path, RODS)
    options = {"joints": ["rod_a", "rod_b"], "noise": {"motor_angle": 1e-6, "platform": 1e-6}}
    near = measure(*(np.array([[0.0], [0.2]]) + random.uniform(-5e-4, 5e-4, (2, 40))))
    first = calibrate(nominal, near, **options)
    further = measure(*first.further.platform.T)
    rows = near.values.copy()
    rows[[0, 1, 2, 4, 5, 6]] = further.values  # not of every fourth row, which is held out
    second = calibrate(nominal, Recording("poses", near.names, rows), **options)
    assert (first.further.deviations < 0.2 * first.deviations).all()
    ratios = second.deviations / first.further.deviations
    assert (ratios > 0.5).all()
    assert (ratios < 2.0).all()  # both estimate the noise, from 30 equations


@pytest.mark.parametrize(
    ("change", "option"),
    [
        (lambda v: v * [1, 1, 1e3, 1e3], "--unit platform=mm"),
        (lambda v: v[:, [0, 1, 3, 2]], "--swap platform_x=platform_y"),
        (lambda v: v * [1, 1, -1, 1], "--sign platform_x=-1"),
        (lambda v: v * [1e3, 1e3, 1, 1], "--unit motor_angle=mm"),
    ],
)
def test_a_mistaken_column_is_named(change, option, tmp_path):
    data = heights(RODS, 1e-5)
    mistaken = Recording("poses", data.names, change(data.values)[:8])
    with pytest.raises(InvalidInput, match=option):
        calibrate(sliders_with_rods(tmp_path, RODS), mistaken)


def test_a_robot_that_is_another_one_is_refused():
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 0, length=2e-2, angle=np.radians(5.0))
    with pytest.raises(NotConverged, match="times the assumed noise"):
        calibrate(nominal, only(poses(true, nominal, 24, 1), *MEASURED), length_error=1e-4, angle_error=1e-3)


@pytest.mark.parametrize(
    ("columns", "options", "message"),
    [
        (("platform",), {}, "no column motor_angle_left_motor"),
        (("motor_angle",), {}, "do not determine the geometry"),
        (MEASURED, {"joints": ["elbow"]}, "unknown joint 'elbow'"),
        (MEASURED, {"noise": {"camera": 1.0}}, "unknown kind of noise 'camera'"),
        (MEASURED, {"length_error": -1.0}, "length_error: must be greater than zero"),
    ],
)
def test_what_cannot_be_calibrated_is_said(columns, options, message):
    nominal = NOMINAL["five_bar"]
    with pytest.raises(InvalidInput) as said:
        calibrate(nominal, only(poses(nominal, nominal, 8, 0), *columns), **options)
    assert message in str(said.value)


def test_the_command_line_calibrates_and_writes_the_robot(tmp_path, capsys):
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 0)
    data = tmp_path / "poses.csv"
    data.write_text(only(poses(true, nominal, 40, 1), *MEASURED).as_csv())
    assert main(["calibrate", "five_bar", str(data), "--out", str(tmp_path / "new"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["errors_held_out"]["platform_x"]["after"] < 3e-5
    assert main(["check", found["robot_file"]]) == 0
    capsys.readouterr()
    again = ["calibrate", found["robot_file"], str(data), "--noise", "platform=2e-5"]
    assert main(again) == 0
    assert "not seen by these data" in capsys.readouterr().out
    assert main(["calibrate", "five_bar", str(data), "--noise", "platform"]) == 2
    assert "KIND=VALUE" in capsys.readouterr().err


def test_the_assumed_noise_drops_out_where_the_data_estimate_it():
    """Few poses, so that the file's own deviations determine some parameters and the data the others."""
    nominal = NOMINAL["five_bar"]
    _, _, true = off_by(nominal, 4)
    data = only(poses(true, nominal, 12, 3), *MEASURED)
    one = calibrate(nominal, data)
    two = calibrate(nominal, data, noise={kind: 3.0 * size for kind, size in NOISE.items()})
    assert two.noise == pytest.approx(one.noise / 3.0, rel=1e-3)
    assert two.degrees_of_freedom == pytest.approx(one.degrees_of_freedom, rel=1e-3)
    np.testing.assert_allclose(two.deviations, one.deviations, rtol=1e-3)
