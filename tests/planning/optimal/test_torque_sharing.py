"""Redundant motors share the load: against linear programs of a point that three massless struts move."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.optimize import linprog

import robots
from framework import InvalidInput, Line, ParallelRobot, load_plan, plan_crossing
from framework.dynamics.torque_distribution import (
    _SharedMotion,
    distribute_torques,
    least_peak_torques,
    second_differences,
)
from framework.laws.squared_speed import ONE_CELL, SpeedBasis, Stretch
from framework.numerics.chebyshev import TimeGrid
from framework.numerics.cone_program import Affine
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.law_problem import MotorRows
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.optimal.speed_program import INTERNAL_WEIGHT, SpeedProgram

BASES = np.array([[0.0, 0.0], [1.0, 0.0], [0.4, 1.0]])  # of the struts [m]
MASS = 2.0  # of the point [kg]
START, GOAL = np.array([0.3, 0.35]), np.array([0.6, 0.45])  # [m]
FORCE = 5.0  # limit of each strut [N]

LEG = """
  <joint name="swing_{k}" type="continuous">
    <parent link="base"/><child link="sleeve_{k}"/><origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/>
  </joint>
  <link name="sleeve_{k}"/>
  <joint name="slide_{k}" type="prismatic">
    <parent link="sleeve_{k}"/><child link="rod_{k}"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="1000" velocity="1000"/>
  </joint>
  <link name="rod_{k}">{body}</link>"""
BODY = (
    f'<inertial><mass value="{MASS}"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """A point of mass on the first of three struts, which slide along their own lines."""
    folder = tmp_path_factory.mktemp("struts")
    legs = [LEG.format(k=k, x=x, y=y, body=BODY if k == 0 else "") for k, (x, y) in enumerate(BASES)]
    (folder / "struts.urdf").write_text(f'<robot name="struts"><link name="base"/>{"".join(legs)}</robot>')
    ways = START - BASES
    reference = {f"slide_{k}": float(np.hypot(*way)) for k, way in enumerate(ways)}
    reference |= {f"swing_{k}": float(np.arctan2(way[1], way[0])) for k, way in enumerate(ways)}
    (folder / "struts.yaml").write_text(
        "version: 1\nurdf: struts.urdf\ngravity: [0, 0, 0]\nplatform: {frame: rod_0, axes: [x, y]}\n"
        "actuators: [{joint: slide_0}, {joint: slide_1}, {joint: slide_2}]\nclosures:\n"
        "  - {name: first, frames: [rod_0, rod_1], kind: spherical}\n"
        "  - {name: second, frames: [rod_0, rod_2], kind: spherical}\n"
        f"reference: {reference}\n"
    )
    return ParallelRobot.from_file(folder / "struts.yaml")


def strut_directions(point):
    """Unit vectors (2, 3) along the struts to a point."""
    ways = (point - BASES).T
    return ways / np.linalg.norm(ways, axis=0)


def largest_acceleration(s):
    """The largest |s"| [1/s^2] within the forces: a linear program in three forces and s"."""
    balance = np.column_stack([strut_directions(START + s * (GOAL - START)), -MASS * (GOAL - START)])
    bounds = [(-FORCE, FORCE)] * 3 + [(0, None)]
    return linprog([0, 0, 0, -1], A_eq=balance, b_eq=np.zeros(2), bounds=bounds).x[3]


def least_duration():
    """The duration [s] of full acceleration, then full braking: a straight path has no centrifugal force."""
    s = np.linspace(0.0, 1.0, 2001)
    nodes = np.linspace(0.0, 1.0, 101)
    limit = np.interp(s, nodes, [largest_acceleration(node) for node in nodes])
    work = np.concatenate([[0.0], np.cumsum(0.5 * (limit[1:] + limit[:-1]) * np.diff(s))])
    root = np.sqrt(2.0 * np.minimum(work, work[-1] - work))  # s'
    return float((2.0 * np.diff(s) / (root[1:] + root[:-1])).sum())


def least_peak(plan, t):
    """The least peak [N] of three forces that accelerate the point as the plan does, (T,)."""
    peaks = []
    for point, acceleration in zip(plan.platform(t), plan.platform(t, 2), strict=True):
        balance = np.column_stack([strut_directions(point), np.zeros(2)])
        sizes = np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), -np.ones(6)])
        found = linprog(
            [0, 0, 0, 1],
            A_ub=sizes,
            b_ub=np.zeros(6),
            A_eq=balance,
            b_eq=MASS * acceleration,
            bounds=[(None, None)] * 4,
        )
        peaks.append(found.x[3])
    return np.array(peaks)


def largest_imbalance(plan):
    """The largest force [N] missing for the acceleration of the point at samples of the motion."""
    t = np.linspace(0.0, plan.duration, 301)
    forces = np.array(
        [strut_directions(x) @ f for x, f in zip(plan.platform(t), plan.torque(t), strict=True)]
    )
    return np.abs(forces - MASS * plan.platform(t, 2)).max()


@pytest.mark.slow
def test_the_quickest_law_is_that_of_a_linear_program_and_its_bound_holds(robot, tmp_path):
    path = Line(START, GOAL)
    plan = plan_crossing(robot, path, optimize="time", torque_limit=FORCE)
    least = least_duration()
    assert least < plan.duration < 1.005 * least
    assert 0.995 * least < bound_plan(plan).value <= least
    assert np.abs(plan.torque(np.linspace(0.0, plan.duration, 2001))).max() <= FORCE
    assert largest_imbalance(plan) < 1e-9
    slower = plan_crossing(robot, path, optimize="time", torque_limit=FORCE, torque_sharing="least_norm")
    assert slower.duration > 1.02 * plan.duration
    plan.save(tmp_path)
    loaded = load_plan(tmp_path)
    t = np.linspace(0.0, plan.duration, 50)
    assert np.abs(loaded.torque(t) - plan.torque(t)).max() < 1e-6 * FORCE


@pytest.mark.slow
def test_the_least_peak_is_that_of_the_best_distribution_of_its_motion(robot):
    plan = plan_crossing(robot, Line(START, GOAL), duration=1.0, optimize="peak_torque")
    peak = max(plan.peak_torque.values())
    assert least_peak(plan, np.linspace(0.0, plan.duration, 101)).max() == pytest.approx(peak, rel=2e-3)
    assert largest_imbalance(plan) < 1e-9


def test_a_polynomial_within_limits_keeps_them_by_the_distribution_of_its_torques(robot):
    path = Line(START, GOAL)
    of_least_norm = plan_crossing(robot, path, duration=1.0)
    least = least_peak(of_least_norm, np.linspace(0.0, 1.0, 41)).max()
    peak = max(of_least_norm.peak_torque.values())
    limit = 0.5 * (least + peak)
    plan = plan_crossing(robot, path, duration=1.0, torque_limit=limit)
    assert plan.law.kind == "polynomial"
    assert least <= max(plan.peak_torque.values()) <= limit < peak
    assert largest_imbalance(plan) < 1e-9
    assert plan.certificate.tail < 1e-10
    assert plan.certificate.max_residual_torque < 1e-9


def test_torques_of_least_norm_over_unequal_limits_are_those_of_the_pseudo_inverse(robot):
    plan, limits = plan_crossing(robot, Line(START, GOAL), duration=1.0), np.array([5.0, 2.0, 8.0])
    shared = distribute_torques(plan.dynamics, np.full(3, np.inf), limits, least_norm=True, least_peak=False)
    for t in np.linspace(0.0, 1.0, 9):
        directions = strut_directions(plan.platform(t)) * limits
        expected = limits * (np.linalg.pinv(directions) @ (MASS * plan.platform(t, 2)))
        np.testing.assert_allclose(shared.torque(t), expected, rtol=0, atol=1e-9)


def test_bends_of_internal_torques_are_their_second_differences():
    random = np.random.default_rng(0)
    frames, x = random.standard_normal((6, 4, 2)), random.standard_normal((6, 2))
    torques = np.einsum("kmr,kr->km", frames, x)
    bends = second_differences(frames) @ x.ravel()
    assert bends.reshape(4, 4) == pytest.approx(np.diff(torques, 2, axis=0), abs=1e-13)


def test_elastic_robots_share_by_least_norm_alone():
    elastic = robots.load("standing_quadruped", flexibility="flexible_joints")
    with pytest.raises(InvalidInput, match="torque_sharing"):
        plan_crossing(elastic, Line(np.zeros(6), np.ones(6)), duration=1.0, torque_sharing="free")


def test_torques_beside_a_node_are_those_of_their_polynomials_with_the_friction_of_the_node():
    """At three points of each interval beside a node, in its cell; friction jumps between nodes."""
    rng = np.random.default_rng(5)
    grid = TimeGrid(np.array([0.0, 0.3, 1.0]), 6)
    cells = [[Polynomial(rng.normal(size=6)) for _ in range(2)] for _ in range(2)]  # of two motors
    times = grid.times.reshape(2, 6)
    torques = np.concatenate(
        [np.transpose([p(t) for p in cell]) for cell, t in zip(cells, times, strict=True)]
    )
    friction = rng.choice([-0.5, 0.0, 0.5], size=(12, 2))
    motion = _SharedMotion(None, None, grid, torques, friction, ())
    expected = np.zeros((12, 2))
    for cell, node, motor in np.ndindex(2, 6, 2):
        for other in {max(node - 1, 0), min(node + 1, 5)} - {node}:
            for part in (0.25, 0.5, 0.75):
                at = times[cell, node] + part * (times[cell, other] - times[cell, node])
                size = abs(cells[cell][motor](at) + friction[6 * cell + node, motor])
                expected[6 * cell + node, motor] = max(expected[6 * cell + node, motor], size)
    np.testing.assert_allclose(motion._largest_beside(None), expected, rtol=1e-10)


def test_a_motor_s_torque_is_what_the_motion_asks_and_its_part_of_the_internal_torques():
    rng = np.random.default_rng(0)
    by_y, by_x, constant = rng.standard_normal((3, 4, 5)), rng.standard_normal((3, 4, 2)), np.arange(4.0)
    rows = MotorRows(
        torque=tuple(Affine(SparseRows.of(matrix), constant) for matrix in by_y),
        squared_speed=(),
        internal=tuple(map(SparseRows.of, by_x)),
    )
    y, x = rng.standard_normal(5), rng.standard_normal(2)
    np.testing.assert_allclose(rows.torques(y, x), by_y @ y + by_x @ x + constant, rtol=1e-12)


def test_smoothness_counts_bends_of_the_speed_and_of_internal_torques_apart():
    """Rows on y alone, those of a robot without internal torques, and then rows on x alone."""
    rng = np.random.default_rng(0)
    frames = rng.standard_normal((6, 4, 2))
    stretch = Stretch()
    program = SimpleNamespace(
        problem=SimpleNamespace(task=SimpleNamespace(stretch=stretch), sigma=stretch.inverse),
        xi=np.linspace(-1.0, 1.0, 11),
        basis=SpeedBasis(np.array(ONE_CELL), 5),
        _inner_points=slice(1, 10),
        _inner_weights=rng.uniform(0.5, 1.0, 9),
        frames=None,
    )
    program.bends = SpeedProgram.bends.func(program)
    alone = SpeedProgram.curvature.func(program).parts["y"]
    program.frames = frames
    rows = SpeedProgram.curvature.func(program).parts
    y, x = rng.standard_normal(5), rng.standard_normal(12)
    bends = INTERNAL_WEIGHT / np.sqrt(6) * (second_differences(frames) @ x)
    expected = np.concatenate([alone @ y, bends])
    assert rows["y"].shape[0] == rows["x"].shape[0]
    np.testing.assert_allclose(rows["y"] @ y + rows["x"] @ x, expected, rtol=1e-12)


@pytest.mark.parametrize("limit", [(1.0, 2.0, 3.0), (1.0, np.inf, 0.5), (np.inf, np.inf, np.inf)])
def test_the_least_peak_of_a_point_is_that_of_a_linear_program(limit):
    """Internal torques x n of one redundant motor; motors without a limit do not count."""
    rng = np.random.default_rng(1)
    torques, n = rng.standard_normal((2, 6, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    found = least_peak_torques(torques, n[:, :, None] * n[:, None], np.array(limit), 1)
    counted = np.isfinite(limit)
    for old, new, along in zip(torques, found, n, strict=True):
        x = along @ (new - old)
        np.testing.assert_allclose(new, old + x * along, atol=1e-9)
        if counted.any():
            rows = np.array([[s * a, -b] for a, b in zip(along, limit, strict=True) for s in (1, -1)])
            right = np.array([-s * t for t in old for s in (1, -1)])
            kept = np.repeat(counted, 2)
            least = linprog([0, 1], A_ub=rows[kept], b_ub=right[kept], bounds=[(None, None)] * 2).fun
            assert np.max(np.abs(new) / limit) == pytest.approx(least, rel=1e-6)
        else:
            assert x == 0.0
