"""Wrenches of the world: plans under them against virtual work, and what they may be."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.interpolate import CubicSpline

import robots
from framework import (
    InvalidInput,
    ParallelRobot,
    RobotFileError,
    assemble,
    dynamics_at,
    load_plan,
    plan_crossing,
    plan_scene,
)
from framework.planning.saved import save_plan
from framework.planning.scenes import scene_path
from tests.oracles.closure_rows import frame_of
from tests.oracles.virtual_work import virtual_work

ROBOT = "five_bar"


# A mill pushes back and sideways while it cuts, on the axes of its tool; a press pushes down, ever more.
MILL_ROWS = [
    [0.0, 0, 0, 0, 0, 0, 0],
    [0.15, 0.4, -0.1, 0.2, 0, 0, 0.01],
    [0.35, 1, -0.3, 0.4, 0.01, 0, 0.02],
    [0.55, 0.9, -0.5, 0.3, 0.02, 0.01, 0.02],
    [0.8, 0.5, -0.2, 0.1, 0, 0, 0.01],
    [1.0, 0, 0, 0, 0, 0, 0],
]
PRESS = [0.1, 0.05, -1.0, 0.02, -0.01, 0.03]
CROSSINGS = {"five_bar": "C", "orthoglide": "cross", "delta": "cross", "gough_stewart": "turn"}
FORCES = {"five_bar": 4.0, "orthoglide": 20.0, "delta": 20.0, "gough_stewart": 1000.0}  # [N], [N m]
CASES = [
    pytest.param(name, flexibility, marks=() if name in ("five_bar", "orthoglide") else pytest.mark.slow)
    for name in CROSSINGS
    for flexibility in ("rigid", "flexible_links")
]


def mill(name: str, frame: str) -> dict:
    """The mill's force as a request has it."""
    rows = np.array(MILL_ROWS)
    rows[:, 1:] *= FORCES[name]
    return {frame: {"wrench": rows.tolist(), "axes": "tool"}}


def on_base_axes(plan, t: np.ndarray, frame: str) -> np.ndarray:
    """The mill's wrench (T, 6) on base axes, by splines of scipy's and rotations of pinocchio's."""
    model, data = plan.robot.model, plan.robot.model.createData()
    rows = np.array(MILL_ROWS) * [1.0, *6 * [FORCES[plan.robot.name]]]
    own = CubicSpline(rows[:, 0], rows[:, 1:])(plan.law(t))
    turned = np.empty_like(own)
    for k, q in enumerate(plan.dynamics.configuration(t)):
        pin.framesForwardKinematics(model, data, q)
        R = data.oMf[frame_of(model, frame)].rotation
        turned[k] = np.concatenate([R @ own[k, :3], R @ own[k, 3:]])
    return turned


def check_virtual_work(plan, wrenches: dict) -> None:
    """Torques do the work of all else, at the crossing too; away from it they are those of the witness.

    To rounding, or to what the certificate says that another pass of the deflections would change.
    """
    t = np.linspace(0.0, plan.duration, 41)
    witness = virtual_work(plan, t, {frame: wrench(t) for frame, wrench in wrenches.items()})
    assert witness.left < max(1e-11, plan.certificate.change)
    away = np.abs(t - plan.crossings[0].time) > 0.1 * plan.duration
    peak = np.abs(plan.torque(t)).max()
    assert np.abs(witness.torque - plan.torque(t))[away].max() < 1e-9 * peak


@pytest.mark.parametrize(("name", "flexibility"), CASES)
def test_torques_through_a_crossing_do_the_work_of_a_mill_and_of_a_press(name, flexibility):
    robot = robots.load(name, flexibility=flexibility)
    frame, path = robot.description.platform.frame, scene_path(robot.description.scenes[CROSSINGS[name]])
    duration = robot.description.scenes[CROSSINGS[name]].duration
    asked = {"duration": duration, "law": "polynomial"}
    free = plan_crossing(robot, path, **asked)
    press = (FORCES[name] * np.array(PRESS)).tolist()
    pressed = plan_crossing(robot, path, **asked, wrenches={frame: press})
    check_virtual_work(pressed, {frame: lambda t: np.tile(press, (len(t), 1))})
    milled = plan_crossing(robot, path, **asked, wrenches=mill(name, frame))
    check_virtual_work(milled, {frame: lambda t: on_base_axes(milled, t, frame)})
    for plan in (pressed, milled):  # condition (8) has the wrench in it, and the certificate looks at it
        assert len(plan.crossings) == 1
        assert plan.certificate.tail < 1e-9
        change = abs(plan.crossings[0].condition.gamma - free.crossings[0].condition.gamma)
        assert change > 1e-3 * FORCES[name]


@pytest.mark.parametrize("geometry", ["rigid", "deformed"])
def test_deflections_are_those_that_the_springs_have_under_the_wrench(geometry):
    """A slow motion's deflections grow by those of the wrench alone, which bends and turns the robot."""
    robot = robots.load("five_bar", flexibility="flexible_links")
    path = scene_path(robot.description.scenes["A"])
    pressed = plan_crossing(
        robot, path, duration=50.0, geometry=geometry, wrenches={"left_tip": [20, 5, 0, 0, 0, 0]}
    )
    start = pressed.deflection(0.0)
    at_rest = dynamics_at(
        robot,
        pressed.configuration(0.0) if geometry == "deformed" else assemble(robot, path(0.0)).q,
        wrenches={"left_tip": [20, 5, 0, 0, 0, 0]},
    )
    assert np.abs(start).max() > 1e-5
    np.testing.assert_allclose(start, -at_rest.spring_force / robot.stiffness, rtol=1e-9)


def test_an_optimal_law_with_a_table_keeps_its_limits_and_certificate(robot):
    path = scene_path(robot.description.scenes["C"])
    plan = plan_crossing(
        robot, path, optimize="time", torque_limit=0.3, wrenches=mill("five_bar", "left_tip")
    )
    free = plan_crossing(robot, path, optimize="time", torque_limit=0.3)
    assert max(plan.peak_torque.values()) <= 0.3
    assert plan.certificate.tail < 1e-9
    assert abs(plan.duration - free.duration) > 1e-3
    check_virtual_work(plan, {"left_tip": lambda t: on_base_axes(plan, t, "left_tip")})


@pytest.mark.parametrize(
    ("wrenches", "complaint"),
    [
        ([1, 2, 3], "needs a wrench by frame"),
        ({"nose": [0] * 6}, "unknown frame 'nose'"),
        ({"left_tip": [1, 2, 3]}, "must be 6 finite numbers"),
        ({"left_tip": [1, 2, 3, 0, 0, np.nan]}, "must be 6 finite numbers"),
        ({"left_tip": "down"}, "must be 6 finite numbers"),
        ({"left_tip": {"wrench": [0] * 6, "axes": "frame"}}, "unknown axes 'frame'"),
        ({"left_tip": {"force": [0] * 6}}, "unknown key 'force'"),
        ({"left_tip": {"axes": "tool"}}, "must be 6 finite numbers"),
        ({"left_tip": [[0.0] * 7]}, "must ascend from 0 to 1"),
        ({"left_tip": [[0.0] * 7, [0.9] * 7]}, "must ascend from 0 to 1"),
        ({"left_tip": [[0.0] * 7, [1.0] * 6]}, "each row of the table"),
        ({"left_tip": [[0.0] * 7, [np.nan] * 7]}, "1 of 2 rows are not"),
    ],
)
def test_wrenches_that_are_none_are_refused_by_name(robot, wrenches, complaint):
    with pytest.raises(InvalidInput, match=complaint):
        plan_crossing(robot, scene_path(robot.description.scenes["C"]), duration=1.5, wrenches=wrenches)


def test_a_saved_plan_comes_back_with_its_wrenches(robot, tmp_path):
    wrenches = mill("five_bar", "left_tip") | {"right_rod": (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)}
    plan = plan_crossing(robot, scene_path(robot.description.scenes["C"]), duration=1.5, wrenches=wrenches)
    save_plan(plan, tmp_path)
    back = load_plan(tmp_path)
    assert back.request.wrenches == plan.request.wrenches
    np.testing.assert_allclose(back.torque(0.4), plan.torque(0.4), rtol=0, atol=1e-13)


def robot_file(folder, wrenches):
    """The 5R with one more scene, under wrenches."""
    source = robots.load("five_bar").description.file
    content = yaml.safe_load(source.read_text())
    content["urdf"] = str(source.parent / content["urdf"])
    content["scenes"] = {"press": {"line": [[0.1, 0.345], [-0.05, 0.195]], "duration": 1.5}}
    content["scenes"]["press"]["wrenches"] = wrenches
    file = folder / "five_bar.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def test_the_wrenches_of_a_scene_are_those_of_its_plan_unless_others_are_given(tmp_path):
    file = robot_file(tmp_path, mill("five_bar", "left_tip") | {"right_elbow": [0, 1, 0, 0, 0, 0]})
    robot = ParallelRobot.from_file(file)
    plan = plan_scene(robot, "press")
    # a joint stands for the link behind it
    assert plan.request.wrenches == mill("five_bar", "left_tip") | {"right_rod": [0, 1, 0, 0, 0, 0]}
    free = plan_scene(robot, "press", wrenches={})
    assert free.request.wrenches is None
    assert free.peak_torque != plan.peak_torque


@pytest.mark.parametrize(
    ("wrenches", "complaint"),
    [
        ({"nose": [0] * 6}, "scenes.press.wrenches.nose: unknown frame 'nose'"),
        ({"left_tip": [0] * 5}, "scenes.press.wrenches: left_tip must be 6 finite numbers"),
        ([1], "scenes.press.wrenches: needs a mapping"),
    ],
)
def test_a_robot_file_with_wrong_wrenches_is_refused_by_the_key(tmp_path, wrenches, complaint):
    with pytest.raises(RobotFileError, match=complaint):
        ParallelRobot.from_file(robot_file(tmp_path, wrenches))
