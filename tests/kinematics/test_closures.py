"""Loop equations of whole robots: derivatives along any motion, and the same loops as rows written anew."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import Line, Mechanism, NotAssembled, ParallelRobot, check_robot, plan_crossing
from framework.kinematics.closures import closure_drift, loop_equations, loop_wrenches, scale_jacobian
from framework.kinematics.frames import frame_motions, frames_at
from tests.oracles.closure_rows import closure_rows
from tests.oracles.forward_simulation import kinematics

NAMES = list(robots.CATALOGUE)


def anywhere(robot, seed: int):
    """A configuration whose loops may be open, and joint rates."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(
        robot.model, robot.q_near, 0.3 * rng.standard_normal(robot.model.nv) * robot.column_scale
    )
    return q, rng.standard_normal(robot.model.nv) * robot.column_scale


@pytest.mark.parametrize("name", NAMES)
def test_each_equation_is_a_wrench_between_its_two_bodies(name):
    """Its rate is the power of the wrench on the twist of the second body relative to the first."""
    robot = robots.load(name, flexibility="flexible_links")
    q, v = anywhere(robot, 2)
    at = frames_at(robot, q[None])
    motions = frame_motions(robot, at, v[None])
    twist = np.concatenate([motions.rates[1, 0, :, 3], motions.twist[0, :, 3:]], axis=1)
    first, second = robot.rows.first, robot.rows.second
    relative = twist[second] - twist[first]
    # the first body seen at the origin of the second frame
    apart = at.position[0, second] - at.position[0, first]
    relative[:, :3] -= np.cross(twist[first, 3:], apart)
    power = np.sum(loop_wrenches(robot.rows, at).wrench[0] * relative, axis=1)
    jacobian = loop_equations(robot.rows, at).jacobian[0]
    np.testing.assert_allclose(power, jacobian @ v, rtol=0, atol=1e-12 * max(robot.length, 1.0))


@pytest.mark.parametrize("name", NAMES)
def test_closed_loops_allow_what_rows_written_anew_allow(name):
    robot = robots.load(name)
    q = robot.reference.q
    model, data = robot.model, robot.model.createData()
    v = np.random.default_rng(3).standard_normal(model.nv) * robot.column_scale
    kinematics(model, data, q, v)
    anew = closure_rows(model, data, robot.description.closures)
    at = frames_at(robot, q[None])
    ours = loop_equations(robot.rows, at).jacobian[0]
    scale = robot.column_scale
    level = 1e-9 * np.linalg.norm(ours * scale, 2)
    ranks = [np.linalg.matrix_rank(rows * scale, tol=level) for rows in (ours, anew.jacobian)]
    both = np.linalg.matrix_rank(np.vstack([ours, anew.jacobian]) * scale, tol=level)
    assert ranks == [both, both]
    # and the accelerations: of a motion that both allow, J a + drift = 0 has the same solutions
    allowed = v - scale * (np.linalg.pinv(ours * scale, rcond=1e-9) @ (ours @ v))
    kinematics(model, data, q, allowed)
    anew = closure_rows(model, data, robot.description.closures)
    drift = closure_drift(robot.rows, frame_motions(robot, at, allowed[None]), q[None], allowed[None])[0]
    a = scale * np.linalg.lstsq(ours * scale, -drift, rcond=1e-9)[0]
    size = max(np.abs(drift).max(), np.abs(anew.drift).max(), robot.length)
    np.testing.assert_allclose(ours @ a, -drift, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(anew.jacobian @ a, -anew.drift, rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("name", ["three_upu", "slider_crank", "gough_stewart"])
def test_scaled_matrices_map_unit_motions_to_robot_lengths_and_radians(name):
    robot = robots.load(name)
    q, v = anywhere(robot, 4)
    jacobian = loop_equations(robot.rows, frames_at(robot, q[None])).jacobian
    rate = scale_jacobian(robot, jacobian, robot.row_lengths)[0] @ (v / robot.column_scale)
    unit = np.where(robot.rows.rotation, 1.0, robot.length)
    np.testing.assert_allclose(rate * unit, jacobian[0] @ v, rtol=1e-12, atol=1e-13 * robot.length)


# overconstrained loops of rounded dimensions


def five_bar(raised: float = 0.0) -> Mechanism:
    """The planar 5R, one of its tips raised out of the plane [m]: then no pose closes its loop."""
    description = robots.load("five_bar").description
    tip = '<child link="right_tip"/>'
    before, after = description.urdf_text.split(tip)
    after = after.replace('xyz="0.25 0 0"', f'xyz="0.25 0 {raised!r}"', 1)
    return Mechanism.from_description(replace(description, urdf_text=f"{before}{tip}{after}"))


def test_a_rounded_loop_is_planned_and_its_gap_said():
    path = Line([0.1, 0.345], [-0.05, 0.195])
    asked = {"duration": 1.5, "times": [1.0], "speeds": [1.5]}
    exact = plan_crossing(ParallelRobot.of(five_bar()), path, **asked)
    robot = ParallelRobot.of(five_bar(3.8e-7))
    plan = plan_crossing(robot, path, **asked)
    assert robot.rounded.names == ("tip.z",)
    assert exact.certificate.rounded_gap == 0.0
    assert plan.certificate.rounded_gap == pytest.approx(3.8e-7, rel=1e-6)
    assert plan.certificate.max_closure_error < 1e-12
    instants = np.linspace(0.0, 1.5, 31)
    np.testing.assert_allclose(plan.torque(instants), exact.torque(instants), atol=1e-9)
    assert "rounded and overconstrained by 3.8e-07 m" in "; ".join(check_robot(five_bar(3.8e-7)).advice)


def test_a_gap_that_is_no_rounding_is_refused():
    with pytest.raises(NotAssembled, match=r"tip\.z stays 0\.003 m apart"):
        ParallelRobot.of(five_bar(3e-3))
