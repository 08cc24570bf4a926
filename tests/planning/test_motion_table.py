"""motion.csv agrees with itself, and with Pinocchio's forward kinematics of its joint columns."""

import csv
import io
import json
import re

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, plan_scene
from framework.planning.motion_table import Column, MotionTable

SAMPLES = 201
# springs; many passive joints; a platform that turns, too; slides, and a joint that turns all the way round
CASES = [
    *(("five_bar", "C", "flexible_links"), ("delta", None, "rigid")),
    *(("three_rpr", None, "rigid"), ("slider_crank", "full_turn", "rigid")),
]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case[0])
def plan(request):
    name, scene, flexibility = request.param
    robot = robots.load(name, flexibility=flexibility)
    return plan_scene(robot, scene or next(iter(robot.description.scenes)))


@pytest.fixture
def table(plan):
    """motion.csv as a reader has it, by columns."""
    text = io.StringIO()
    plan.to_csv(text, SAMPLES)
    text.seek(0)
    return np.genfromtxt(text, delimiter=",", names=True, deletechars="")


def test_names_of_joints_with_commas_and_quotes_stay_one_column_each():
    columns = tuple(Column(name, "rad", "") for name in ("joint_left,elbow", 'joint_1/4"', "joint_ plain"))
    text = MotionTable(columns, np.array([[1.0, 1e-300, -1.0 / 3.0]])).as_csv()
    header, values = csv.reader(io.StringIO(text))
    assert header == [column.name for column in columns]
    assert list(map(float, values)) == [1.0, 1e-300, -1.0 / 3.0]


def test_every_column_has_a_plain_name_of_its_own_and_a_unit(plan, table):
    columns = plan.samples(2).columns
    assert [column.name for column in columns] == list(table.dtype.names)
    assert len({column.name for column in columns}) == len(columns)
    for column in columns:
        assert re.fullmatch(r"\w+", column.name)
        assert re.fullmatch(r"1|(1|s|m|rad|N|N m)(/s2?)?", column.unit)
    described = json.loads(plan.samples(2).metadata("motion.csv"))
    told = {one["name"]: one["schema:unitText"] for one in described["tableSchema"]["columns"]}
    assert told == {column.name: column.unit for column in columns}


@pytest.mark.parametrize("period", [1e-3, 0.00737, 0.4])
def test_rows_of_a_period_end_with_the_motion_whatever_it_takes(period):
    plan = plan_scene(robots.load("five_bar"), "C", duration=1.5037, times=None, speeds=None)
    text = io.StringIO()
    plan.to_csv(text, period=period, columns=["torque", "time", "motor_velocity_left_motor"])
    names, *rows = (line.split(",") for line in text.getvalue().splitlines())
    assert names == ["torque_left_motor", "torque_right_motor", "time", "motor_velocity_left_motor"]
    times = np.array([float(row[2]) for row in rows])
    np.testing.assert_allclose(times[:-1], period * np.arange(len(rows) - 1), rtol=0, atol=1e-15)
    assert times[-1] == 1.5037
    assert 0.0 < times[-1] - times[-2] <= period * (1 + 1e-9)
    torques = np.array([[float(value) for value in row[:2]] for row in rows])
    np.testing.assert_array_equal(torques, plan.torque(times))


def test_rows_that_divide_the_duration_end_with_one_row():
    table = plan_scene(robots.load("five_bar"), "C").samples(period=1e-3, columns=["time"])
    np.testing.assert_allclose(table.rows[:, 0], np.linspace(0.0, 1.5, 1501), atol=1e-15)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"period": 0.0}, "period: needs"),
        ({"period": 2.0}, "to 1.5 s, the duration"),
        ({"period": 1e-9}, "period: needs"),
        ({"columns": ["torqe"]}, "unknown column 'torqe'"),
    ],
)
def test_rows_that_cannot_be_are_refused(options, says):
    with pytest.raises(InvalidInput, match=says):
        plan_scene(robots.load("five_bar"), "C").samples(**options)


def test_velocities_and_accelerations_are_those_of_their_columns(plan, table):
    """What a column gains in time is the integral of its derivative: Simpson's rule on the samples."""
    pairs = {"ds": "s", "dds": "ds"}
    for name in table.dtype.names:
        for lower, higher in (("", "velocity_"), ("velocity_", "acceleration_")):
            group, rate, rest = name.partition(f"_{higher}")
            value = f"{group}_angle_{rest}" if group == "motor" and not lower else f"{group}_{lower}{rest}"
            if rate:
                pairs[name] = value
    assert len(pairs) == 2 + 2 * (plan.robot.n + plan.robot.n_a + plan.robot.n_e + len(plan.robot.passive))
    h = table["time"][1]
    # each derivative of a series through n values multiplies their rounding by up to n^2 on [-1, 1]
    n = plan.certificate.nodes
    eps = max(np.finfo(float).eps, plan.certificate.max_closure_error)  # joints are known as loops are closed
    worse = n**2 * 2.0 / plan.duration
    for rate, value in pairs.items():
        y, order = table[rate], 1 + ("acceleration" in rate or rate == "dds")
        simpson = h / 3 * (y[:-2:2] + 4 * y[1:-1:2] + y[2::2])
        # of the rule: h^5/90 times the fourth derivative, which fourth differences of the samples estimate
        allowed = 4.0 * h / 90 * np.abs(np.diff(y, 4)).max() + 2 * h * worse**order * eps
        allowed += 4 * eps * np.abs(table[value]).max() * max(worse ** (order - 1), 1.0)
        np.testing.assert_allclose(np.diff(table[value][::2]), simpson, rtol=0, atol=allowed)


def test_the_joints_carry_the_platform_where_the_table_says(plan, table):
    robot = plan.robot
    model, data = robot.model, robot.model.createData()
    v = np.zeros((SAMPLES, model.nv))
    for k, joint in enumerate(robot.actuator_names):
        v[:, robot.actuated[k]] = table[f"motor_angle_{joint}"] / robot.gear_ratio[k]
    for k, spring in enumerate(robot.elastic_names):
        v[:, robot.elastic[k]] = table[f"deflection_{spring}"]
    for column in robot.passive:
        v[:, column] = table[f"joint_{robot.coordinates.name_of(column)}"]
    frame = model.getFrameId(robot.description.platform.frame)
    assert sum(axis.startswith("r") for axis in robot.axis_names) <= 1
    for row in range(0, SAMPLES, 20):
        pin.framesForwardKinematics(model, data, pin.integrate(model, pin.neutral(model), v[row]))
        turned = pin.Quaternion(data.oMf[frame].rotation)
        for axis in robot.axis_names:
            told = table[f"platform_{axis}"][row]
            k = "xyz".index(axis[-1])
            if axis.startswith("r"):  # the only turn here: twist about the axis, modulo a turn
                angle = 2 * np.arctan2(turned.coeffs()[k], turned.w)
                assert abs(np.exp(1j * angle) - np.exp(1j * told)) < 1e-9
            else:
                assert abs(data.oMf[frame].translation[k] - told) < 1e-9 * robot.length
