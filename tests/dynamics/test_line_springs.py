"""Springs and dampers between two points: closed forms, MuJoCo's tendons, files, plans, simulation."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import robots
from framework import ParallelRobot, plan_scene, simulate
from framework.dynamics import dynamics_at, platform_stiffness
from framework.errors import RobotFileError
from framework.files.mjcf import convert_to_qpos, mjcf_text
from framework.kinematics.diagnostics.diagnosis import check_robot
from framework.kinematics.frames import integrate
from framework.kinematics.line_springs import lines_at
from framework.kinematics.mechanism import Mechanism
from framework.model.description import LineSpring
from framework.model.readers.recognise import parse_any
from framework.model.robot_file import read_robot_file
from framework.model.robot_file_writer import robot_document

STIFFNESS, REST, DAMPING = 300.0, 0.05, 4.0


def sprung(name: str, *springs: LineSpring, flexibility: str = "rigid") -> ParallelRobot:
    description = replace(robots.load(name).description, line_springs=springs)
    return ParallelRobot.from_description(description, flexibility=flexibility)


def to_ground(frame: str) -> LineSpring:
    return LineSpring(("base", frame), STIFFNESS, REST, DAMPING)


def test_motors_hold_the_pull_on_the_platform_by_virtual_power():
    with_spring, without = sprung("five_bar", to_ground("left_tip")), robots.load("five_bar")
    x, dx = with_spring.reference.x, np.array([0.4, -0.7])
    length, u = np.linalg.norm(x), x / np.linalg.norm(x)  # the base's origin is the spring's other end
    tension = STIFFNESS * (length - REST) + DAMPING * (u @ dx)
    instant = dynamics_at(with_spring, with_spring.reference.q, dx=dx)
    added = instant.torque - dynamics_at(without, with_spring.reference.q, dx=dx).torque
    for direction in np.eye(2):  # motor speeds of a motion of the platform along each axis
        rates = dynamics_at(with_spring, with_spring.reference.q, dx=direction).v
        speeds = with_spring.gear_ratio * rates[with_spring.actuated]
        assert added @ speeds == pytest.approx(tension * (u @ direction), rel=1e-11)


def test_reactions_at_rest_carry_weight_and_pull():
    robot = sprung("four_bar", to_ground("coupler_tip"))
    instant = dynamics_at(robot, robot.reference.q)
    pull = lines_at(robot, robot.reference.q[None]).pulls()[1]  # ON the coupler
    on_base = sum(instant.reactions[joint][:3] for joint in ("crank_bearing", "rocker_motor"))
    load = on_base + pull.wrench[0, :3] + robot.mass * np.array([0, -9.81, 0])
    assert load[:2] == pytest.approx(0, abs=1e-11)


def test_the_slope_of_the_forces_is_their_derivative_on_balls_too():
    springs = (
        LineSpring(("base", "platform"), STIFFNESS, REST, DAMPING),
        LineSpring(("leg_1_rod", "platform"), 50.0, 0.0, 2.0, "of no free length"),
    )
    robot = sprung("gough_stewart", *springs)
    random = np.random.default_rng(0)
    q = integrate(robot, robot.reference.q[None], 0.1 * random.standard_normal((1, robot.nv)))
    v = random.standard_normal((1, robot.nv))
    steps = 1e-6 * np.eye(robot.nv)
    ends = [lines_at(robot, integrate(robot, q, sign * steps)) for sign in (1, -1)]
    ahead, back = (lines.forces(np.repeat(v, robot.nv, axis=0)) for lines in ends)
    lines = lines_at(robot, q)
    assert lines.force_slope(v)[0] == pytest.approx((ahead - back).T / 2e-6, abs=1e-4)
    assert lines.damping[0] @ v[0] == pytest.approx(lines.damping_forces(v)[0], abs=1e-10)


@pytest.mark.parametrize("flexibility", ["rigid", pytest.param("flexible_links", marks=pytest.mark.slow)])
def test_planned_torques_follow_the_path_through_type_2_in_simulation(flexibility):
    robot = sprung("four_bar", to_ground("coupler_tip"), flexibility=flexibility)
    plan = plan_scene(robot, "dead_point")
    simulated = simulate(robot, plan)
    assert simulated.tracking_error < 1e-8
    assert simulated.energy_error < 1e-10
    unsprung = plan_scene(robots.load("four_bar"), "dead_point").torque(0.3)
    assert np.abs(plan.torque(0.3) - unsprung).max() > 0.01  # [N m] the spring matters


def test_fixed_steps_of_a_stiff_spring_agree_with_the_reference():
    robot = sprung("slider_crank", LineSpring(("base", "rod_tip"), 1e6, 0.13, 30.0))
    runs = [
        simulate(
            robot, lambda t: np.zeros(1), duration=0.02, start=robot.reference.q, method=method, **options
        )
        for method, options in (("reference", {}), ("fast", {"step": 2e-5}))
    ]
    exact, fast = runs
    assert np.ptp(exact.q[:, 0]) > 0.01  # the spring of 23 N moves the crank
    assert fast.q[-1] == pytest.approx(exact.q[-1], abs=1e-6)
    assert exact.energy_error < 1e-10


def test_a_spring_to_the_ground_stiffens_the_platform_along_its_line():
    spring = replace(to_ground("left_tip"), damping=0.0)
    elastic, parallel = (
        platform_stiffness(robot, robot.reference.q).stiffness
        for robot in (
            robots.load("five_bar", flexibility="flexible_links"),
            sprung("five_bar", spring, flexibility="flexible_links"),
        )
    )
    u = robots.load("five_bar").reference.x
    u = u / np.linalg.norm(u)
    assert parallel - elastic == pytest.approx(STIFFNESS * np.outer(u, u), abs=1e-6)


def test_mujoco_feels_the_same_forces_and_its_file_is_read_back(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    springs = (to_ground("coupler_tip"), LineSpring(("crank", "rocker_tip"), damping=3.0, name="damper"))
    robot = sprung("four_bar", *springs)
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot))
    data = mujoco.MjData(model)
    data.qpos[:] = convert_to_qpos(robot.model, robot.reference.q)
    data.qvel[:] = np.random.default_rng(0).standard_normal(model.nv)
    mujoco.mj_forward(model, data)
    lines = lines_at(robot, robot.reference.q[None])
    assert -data.qfrc_passive == pytest.approx(lines.forces(data.qvel[None].copy())[0], rel=1e-10)

    file = tmp_path / "exported.xml"
    file.write_text(mjcf_text(robot))
    description = parse_any(file, platform="crank", axes=["rz"]).description
    assert description.line_springs == (replace(springs[0], name="base-coupler_tip"), springs[1])
    assert not description.left_out


KEYS = {"between": ["base", "left_tip"], "stiffness": 40, "rest": 0.1, "damping": 3, "name": "return"}


def _file_with_spring(folder, spring):
    description = robots.load("five_bar").description
    content = robot_document(description) | {"springs": [spring]}
    (folder / "five_bar.urdf").write_text(description.urdf_text)
    (folder / "five_bar.yaml").write_text(yaml.safe_dump(content, default_flow_style=None))
    return folder / "five_bar.yaml"


def test_robot_files_state_springs_between_points(tmp_path):
    description = read_robot_file(_file_with_spring(tmp_path, KEYS))
    assert robot_document(description)["springs"] == [KEYS]
    robot = ParallelRobot.from_description(description)
    assert robot.spring_names == ("return",)


def test_a_spring_between_joints_of_the_base_is_said_to_do_nothing(tmp_path):
    still = KEYS | {"between": ["left_motor", "right_motor"]}
    for spring, words in ((still, ["return: as long in all poses"]), (KEYS, [])):
        advice = check_robot(Mechanism.from_file(_file_with_spring(tmp_path, spring))).advice
        assert [line[:28] for line in advice if "all poses" in line] == words


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rest": None}, "rest"),
        ({"stiffness": None}, "rest"),
        ({"stiffness": None, "rest": None, "damping": None}, "stiffness"),
        ({"between": ["base", "base"]}, "two different frames"),
        ({"between": ["left_tip", "payload"]}, "between"),
        ({"stiffness": -1}, "stiffness"),
        ({"length": 1}, "length"),
    ],
)
def test_a_spring_that_says_too_little_is_refused(tmp_path, change, words):
    spring = {key: value for key, value in (KEYS | change).items() if value is not None}
    with pytest.raises(RobotFileError, match=words):
        read_robot_file(_file_with_spring(tmp_path, spring))
