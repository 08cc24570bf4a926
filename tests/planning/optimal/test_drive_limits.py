"""Torque-speed curves and RMS torques of motors: kept, reached, and refused with what exceeds them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import robots
from framework import Line, NoLaw, ParallelRobot, plan_crossing
from framework.dynamics.drive_limits import drive_limits
from framework.errors import InvalidInput, RobotFileError

LINE = Line([0.1, 0.345], [-0.05, 0.195])
PAPERS = 0.165  # [N m]
CURVE = {"torque_limit": PAPERS, "corner_speed": 30.0, "no_load_speed": 60.0}

MASS, FORCE, CORNER, NO_LOAD = 3.0, 2.0, 0.3, 0.7  # kg, N, m/s, m/s; the mass moves by 1 m
TREE = f"""<robot name="cart"><link name="world"/><link name="drive"/>
<link name="cart"><inertial><mass value="{MASS}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="belt" type="prismatic"><parent link="world"/><child link="drive"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="0" velocity="0"/></joint>
<joint name="rail" type="prismatic"><parent link="world"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="0" velocity="0"/></joint></robot>"""
FILE = """
version: 1
urdf: cart.urdf
platform: {{joints: [rail]}}
actuators: [{{joint: belt, {limits}}}]
couplings: [{{joint: rail, of: belt, ratio: 1}}]
"""


def cart(folder, limits):
    """A cart on a belt, of one freedom: its motor moves it and nothing else."""
    (folder / "cart.urdf").write_text(TREE)
    (folder / "cart.yaml").write_text(FILE.format(limits=limits))
    return ParallelRobot.from_file(folder / "cart.yaml")


def torques_and_speeds(plan):
    times = np.linspace(0.0, plan.duration, 20001)
    return plan.torque(times), plan.motor_angle(times, 1)


def largest_torque(speed, corner=30.0, no_load=60.0, torque=PAPERS):
    return torque * np.clip((no_load - np.abs(speed)) / (no_load - corner), 0.0, 1.0)


def largest_excess(plan):
    """The largest excess of a driving torque over the curve, and of any over its peak, relative to this."""
    torque, speed = torques_and_speeds(plan)
    driving = torque * speed > 0.0
    allowed = np.where(driving, largest_torque(speed), PAPERS)
    return np.max(np.abs(torque) - allowed) / PAPERS


def duration_of_bang_bang():
    """The least time of a cart over 1 m: full force along the curve, then full braking."""

    def force(v):
        return FORCE * np.clip((NO_LOAD - v) / (NO_LOAD - CORNER), 0.0, 1.0)

    def rest(v_switch):
        """The way that is left [m] after braking from a speed, and the time that all takes."""
        rates = lambda v, _: [1.0, v] / (force(v) / MASS)  # noqa: E731 - of time and way by speed
        time, way = solve_ivp(rates, (0.0, v_switch), [0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
        return 1.0 - way - 0.5 * MASS * v_switch**2 / FORCE, time + MASS * v_switch / FORCE

    v_switch = brentq(lambda v: rest(v)[0], 0.01, NO_LOAD * (1.0 - 1e-9))
    return rest(v_switch)[1]


def test_a_cart_is_as_quick_as_its_torque_speed_curve_allows(tmp_path):
    limits = f"torque_limit: {FORCE}, corner_speed: {CORNER}, no_load_speed: {NO_LOAD}"
    plan = plan_crossing(cart(tmp_path, limits), Line([0.0], [1.0]), optimize="time")
    least = duration_of_bang_bang()
    assert least > 1.05 * 2.0 * np.sqrt(MASS / FORCE)  # the curve binds
    assert least < plan.duration < 1.008 * least


@pytest.mark.slow
def test_a_cart_is_as_quick_as_its_rms_force_allows(tmp_path):
    rms = 0.5  # [N]; the least integral of squared forces over 1 m in the time T is 12 m^2 / T^3
    robot = cart(tmp_path, f"torque_limit: {10 * FORCE}, rms_torque_limit: {rms}")
    plan = plan_crossing(robot, Line([0.0], [1.0]), optimize="time")
    least = (12.0 * (MASS / rms) ** 2) ** 0.25
    assert least < plan.duration < 1.01 * least
    cycle = 8.0  # [s]
    plan = plan_crossing(robot, Line([0.0], [1.0]), optimize="time", cycle_time=cycle)
    least = (12.0 * (MASS / rms) ** 2 / cycle) ** (1.0 / 3.0)
    assert least < plan.duration < 1.01 * least


@pytest.mark.slow
@pytest.mark.parametrize("ends", [(0.2, 0.0), (0.0, 0.2), (0.25, 0.1)])
def test_a_cart_in_motion_is_as_quick_as_its_rms_force_allows(tmp_path, ends):
    """From speed u to v over a way of 1 m in T the least integral of (dv/dt)^2 is that of linear forces."""
    rms, (u, v) = 0.5, ends
    robot = cart(tmp_path, f"torque_limit: {10 * FORCE}, rms_torque_limit: {rms}")
    plan = plan_crossing(robot, Line([0.0], [1.0]), optimize="time", start_speed=u, end_speed=v)

    def mean_square(T):
        return 4.0 * MASS**2 * (3.0 - 3.0 * (u + v) * T + (u**2 + u * v + v**2) * T**2) / T**4

    least = brentq(lambda T: mean_square(T) - rms**2, 0.5, 4.0)
    assert least < plan.duration < 1.015 * least


@pytest.mark.slow
@pytest.mark.parametrize(("flexibility", "reached"), [("rigid", 1e-3), ("flexible_links", 4e-3)])
def test_the_quickest_law_reaches_the_curve_and_stays_within(flexibility, reached):
    robot = robots.load("five_bar", flexibility=flexibility)
    plan = plan_crossing(robot, LINE, optimize="time", **CURVE)
    assert largest_excess(plan) < 0.0
    torque, speed = torques_and_speeds(plan)
    assert np.max(np.abs(speed)) > 1.5 * CURVE["corner_speed"]
    on_the_slope = np.abs(speed) > 1.1 * CURVE["corner_speed"]
    assert np.min((largest_torque(speed) - torque * np.sign(speed))[on_the_slope]) < reached * PAPERS
    uses = {(use.joint, use.limit): use.ratio for use in plan.motor_use}
    assert 1.0 - reached < uses["left_motor", "torque-speed curve"] <= 1.0


@pytest.mark.slow
def test_a_law_beyond_the_curve_is_refused_with_motor_instant_speed_and_torque():
    with pytest.raises(
        NoLaw, match=r"left_motor needs .* N m at .* rad/s at t = .*torque-speed curve allows"
    ) as no:
        plan_crossing(robots.load("five_bar"), LINE, optimize="time", longest=0.8, **CURVE)
    longest = no.value.remedy["longest"]
    plan = plan_crossing(robots.load("five_bar"), LINE, optimize="time", longest=longest, **CURVE)
    assert 0.8 < plan.duration <= longest


@pytest.mark.slow
def test_a_law_beyond_an_rms_torque_alone_is_refused_with_limits_that_do():
    robot = robots.load("five_bar")
    with pytest.raises(
        NoLaw, match=r"left_motor needs an RMS torque of .* rms_torque_limit .* would do"
    ) as no:
        plan_crossing(robot, LINE, duration=1.5, rms_torque_limit=0.01)
    assert plan_crossing(robot, LINE, duration=1.5, **no.value.remedy).motor_use


@pytest.mark.slow
def test_a_refusal_by_torques_advises_what_also_keeps_rms_torques():
    robot = robots.load("five_bar")
    limits = {"torque_limit": PAPERS, "rms_torque_limit": 0.08}
    with pytest.raises(NoLaw, match=r"each needs .* times the torque limits .* would do") as no:
        plan_crossing(robot, LINE, duration=0.5, **limits)
    longer = no.value.remedy["duration"]
    assert longer > 1.05 * plan_crossing(robot, LINE, optimize="time", torque_limit=PAPERS).duration
    plan = plan_crossing(robot, LINE, duration=longer, **limits)
    assert all(use.ratio <= 1.0 for use in plan.motor_use)
    raised = no.value.evidence.limits
    assert set(raised) == {"torque_limit", "rms_torque_limit"}
    assert plan_crossing(robot, LINE, duration=0.5, **raised).duration == 0.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"torque_limit": 1.0, "corner_speed": 20.0}, "no_load_speed: needed for .* left_motor"),
        (
            {"torque_limit": 1.0, "corner_speed": 20.0, "no_load_speed": 20.0},
            "corner_speed: left_motor needs less",
        ),
        ({"corner_speed": 10.0, "no_load_speed": 20.0}, "torque_limit: needed for"),
        ({"rms_torque_limit": 1.0, "duration": 2.0, "cycle_time": 1.0}, "cycle_time: must be at least"),
    ],
)
def test_a_curve_that_lacks_a_number_is_refused(options, message):
    with pytest.raises(InvalidInput, match=message):
        plan_crossing(robots.load("five_bar"), LINE, **{"duration": 1.5, **options})


def test_a_curve_of_a_file_that_lacks_a_number_is_refused(tmp_path):
    with pytest.raises(RobotFileError, match=r"torque_limit: required, as part of a torque-speed curve"):
        cart(tmp_path, "corner_speed: 1, no_load_speed: 2")


def test_a_limit_that_the_file_states_for_one_motor_counts_for_it_alone():
    description = robots.load("five_bar").description
    first, second = description.actuators
    motors = first, replace(second, rms_torque_limit=0.05)
    robot = ParallelRobot.from_description(replace(description, actuators=motors))
    drives = drive_limits(robot, np.full(2, PAPERS))
    np.testing.assert_array_equal(drives.rms_torque_limit, [np.inf, 0.05])
    assert drive_limits(robots.load("five_bar"), np.full(2, PAPERS)) is None
