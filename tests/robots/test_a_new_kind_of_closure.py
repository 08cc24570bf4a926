"""Kinds of closure that the framework does not have, added as CONTRIBUTING says and in no other way.

A rod of prescribed length that stays in a plane needs a line of kinds alone. A pin at a prescribed distance
along an axis needs a new kind of row as well. Both are put into the 5R, where a closed form says what they
are: the first stands for the robot's right rod, the second for a pin on a frame beside the tip.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework import ParallelRobot, plan_scene
from framework.control.control_cycle import SinglePose
from framework.kinematics.closures import closure_drift, loop_curvature, loop_equations
from framework.kinematics.frames import frame_motions, frames_at
from framework.kinematics.modes import legs
from framework.model import description, loop_rows, read_robot_file
from framework.model.description import Closure, locked_axes
from framework.model.loop_rows import RowKind
from framework.model.placement import placement
from framework.model.robot_file_writer import write_robot_file
from framework.model.urdf_edits import add_frame
from framework.proofs.assembly_modes import assembly_modes
from framework.proofs.derivative_bounds import DerivativeBounds
from framework.proofs.leg_paving import collect_leg_equations
from framework.proofs.working_modes import working_modes
from tests.oracles.placements import placements
from tests.robots.every_robot import assert_same_torques
from tests.robots.test_closures_of_all_kinds import without_right_rod
from tests.urdf_edits import edited

LENGTH = {"planar_rod": 0.25, "pin_ahead": 0.07}  # [m] that of the 5R's rods; and any


@pytest.fixture(autouse=True)
def recipe(monkeypatch):
    """What CONTRIBUTING asks for: a line a kind, and the row that is new."""
    monkeypatch.setitem(description._LOCKED, "planar_rod", ("z", "distance"))
    monkeypatch.setitem(description._LOCKED, "pin_ahead", ("y", "z", "ahead"))

    def satisfy(offset, length):
        return np.array([length, *offset[1:]])

    row = RowKind("u.d", coefficients=lambda length: (1.0, length), satisfy=satisfy)
    monkeypatch.setitem(loop_rows.ROW_KINDS, "ahead", row)


def with_pin_ahead(of_5r):
    """The 5R whose tip is met by a pin at a distance from a frame behind it."""
    length = LENGTH["pin_ahead"]
    behind = placement(translation=(-length, 0.0, 0.0))
    urdf_text = edited(of_5r.urdf_text, (add_frame, "behind_tip", "left_tip", behind))
    closure = Closure("tip", ("behind_tip", "right_tip"), locked_axes("pin_ahead"), length)
    return replace(of_5r, urdf_text=urdf_text, closures=(closure,))


def described(kind):
    of_5r = robots.load("five_bar").description
    if kind == "pin_ahead":
        return with_pin_ahead(of_5r)
    rod = Closure("rod", ("right_end", "left_tip"), locked_axes("planar_rod"), LENGTH["planar_rod"])
    return replace(without_right_rod(of_5r), closures=(rod,))


def errors(robot, q):
    """The rows in closed form [m]: out of the plane, and off the length; or off the pin, across and along."""
    (closure,) = robot.description.closures
    first, second = placements(robot.model, closure.frames, q)
    d = first.rotation.T @ (second.translation - first.translation)
    if closure.axes == ("z", "distance"):
        return np.array([d[2], (d @ d - closure.length**2) / (2 * closure.length)])
    return np.array([d[1], d[2], d[0] - closure.length])


def anywhere(robot):
    """A configuration with open loops, and joint rates."""
    rng = np.random.default_rng(5)
    q = robot.reference.q + 0.3 * rng.standard_normal(robot.model.nv) * robot.column_scale
    return q, rng.standard_normal(robot.model.nv) * robot.column_scale


KINDS = pytest.mark.parametrize("kind", LENGTH)


@KINDS
def test_a_robot_file_says_it_and_keeps_it(kind, tmp_path):
    written = write_robot_file(described(kind), tmp_path)
    assert f"kind: {kind}" in written.read_text()
    again = ParallelRobot.from_description(read_robot_file(written))
    assert again.description.closures == described(kind).closures


@KINDS
def test_rows_and_their_derivatives_are_those_of_the_closed_form(kind):
    robot, h = ParallelRobot.from_description(described(kind)), 1e-4
    q, v = anywhere(robot)
    frames, steps = frames_at(robot, q[None]), h * np.eye(robot.model.nv)
    loops = loop_equations(robot.rows, frames)
    np.testing.assert_allclose(loops.residual[0], errors(robot, q), atol=1e-15)
    jacobian = np.array([errors(robot, q + step) - errors(robot, q - step) for step in steps]).T / (2 * h)
    np.testing.assert_allclose(loops.jacobian[0], jacobian, atol=1e-7)  # h^2
    bend = (errors(robot, q + h * v) - 2 * errors(robot, q) + errors(robot, q - h * v)) / h**2
    drift = closure_drift(robot.rows, frame_motions(robot, frames, v[None]), q[None], v[None])[0]
    np.testing.assert_allclose(drift, bend, atol=1e-6)  # h^2, and rounding over h^2
    multipliers = np.arange(1.0, 1 + len(bend))
    curvature = loop_curvature(robot, robot.rows, frames, multipliers[None])[0]
    np.testing.assert_allclose(v @ curvature @ v, multipliers @ drift, rtol=1e-12)
    single = SinglePose(robot)
    rows = [robot.rows.names.index(name) for name in single.rows.names]
    single.evaluate_pose(q)
    np.testing.assert_allclose(single.residual, loops.residual[0, rows], atol=1e-15)
    np.testing.assert_allclose(single.jacobian, loops.jacobian[0, rows], atol=1e-15)
    single.evaluate_motion(q, v)
    np.testing.assert_allclose(single.drift(q, v), drift[rows], atol=1e-13)


@KINDS
def test_a_plan_has_the_torques_of_the_robot_that_it_stands_for(kind):
    robot = ParallelRobot.from_description(described(kind))
    assert_same_torques(plan_scene(robots.load("five_bar"), "C"), plan_scene(robot, "C"))


@KINDS
def test_bounds_over_boxes_hold_for_the_closed_form(kind):
    robot, rng = ParallelRobot.from_description(described(kind)), np.random.default_rng(2)
    bounds = DerivativeBounds.of(robot)
    u = rng.uniform(-1, 1, (6, len(bounds.column_scale)))
    radii, middle = 0.3 * rng.uniform(0.1, 1.0, u.shape), bounds.evaluate(bounds.configurations(u))
    rest = middle.remainders(radii)

    def scaled(u):
        values = [errors(robot, q)[robot.structure.independent] for q in bounds.configurations(u)]
        return np.array(values) * bounds.row_scale[robot.n :]

    for _ in range(12):
        d = radii * rng.choice([-1.0, 1.0, 0.5], radii.shape)
        change = scaled(u + d) - scaled(u)
        off = change - np.einsum("sri,si->sr", middle.slopes[:, robot.n :], d)
        assert (np.abs(off) <= rest.values[:, robot.n :] + 4 * bounds.rounding).all()


@KINDS
def test_bounds_along_a_leg_hold(kind):
    robot, rng = ParallelRobot.from_description(described(kind)), np.random.default_rng(1)
    for leg in legs(robot):
        fixed = np.ones(robot.model.nv, dtype=bool)
        fixed[robot.moving] = False
        fixed[robot.moving[leg.needed]] = True
        own = robot.moving[leg.columns]
        equations = collect_leg_equations(robot, own, fixed, robot.reference.q, robot.reference.x, 2.0)
        r = 10.0 ** rng.uniform(-3, 0.5, (200, len(own)))
        c, share = rng.uniform(-2, 2, r.shape), rng.uniform(-1, 1, r.shape)
        lines, there = equations.enclose(c, r), equations.enclose(c + share * r, 0 * r).values
        rest = np.abs(there - lines.values - np.matvec(lines.slopes, share * r))
        assert np.all(rest <= lines.errors)


@cache
def count_modes(robot):
    """Numbers of assembly modes and of working modes at the reference, with what is proved of each."""
    counted = (
        assembly_modes(robot, robot.actuated_coordinates(robot.reference.q[None])[0]),
        working_modes(robot, robot.reference.x),
    )
    return [(len(found.modes), found.status) for found in counted]


@KINDS
def test_modes_are_as_many_as_those_of_the_robot_that_it_stands_for(kind):
    original, robot = robots.load("five_bar"), ParallelRobot.from_description(described(kind))
    assert count_modes(robot) == count_modes(original)
