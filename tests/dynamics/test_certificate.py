"""What the certificate tells: which torques are resolved, and which never are."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import (
    Condition,
    InvalidInput,
    Law,
    Line,
    NoLaw,
    NotConverged,
    ParallelRobot,
    Spline,
    inverse_dynamics,
    locate_singularities,
    plan_crossing,
    track_path,
)
from framework.dynamics.elasticity import pass_at_rest
from framework.dynamics.finite_differences import finite_difference_torques
from framework.dynamics.forces import motor_torque
from framework.dynamics.motion_checks import measure_residuals
from framework.dynamics.result import Certificate
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from tests.oracles import five_bar as oracle
from tests.oracles.placements import placements

ROBOT = "five_bar"
LINE = Line([0.1, 0.345], [-0.05, 0.195])
CLEAR = Line([0.1, 0.345], [-0.05, 0.295])


class Brought:
    """A law that somebody brings: s and its derivatives by one function of (t, order)."""

    def __init__(self, values, duration=1.5):
        self.values, self.duration = values, duration

    def __call__(self, t, order=0):
        return self.values(np.asarray(t, dtype=float), order)


def tails(robot, law) -> list[float]:
    """Tail of the torques on 64, 128 and 256 nodes, whatever the law."""
    branch = track_path(robot, LINE)
    found = []
    for size in (64, 128, 256):
        grid = TimeGrid.clear_of(np.array([1.0]), np.array([0.0, 1.5]), size)
        state, _ = pass_at_rest(branch, grid, law, np.empty(0))
        found.append(grid.fit(motor_torque(robot, state.motion, state.forces.joint_torque)).tail)
    return found


def test_a_pole_keeps_the_tail_up_however_many_nodes(robot):
    (point,) = locate_singularities(robot, LINE)

    def crossing_at(s):
        return [Condition(1.0, 0, s), Condition(1.0, 1, 1.5), Condition(1.0, 2, 0.0)]

    right = tails(robot, Law.rest_to_rest(1.5, 4, crossing_at(point.s)))
    beside = tails(robot, Law.rest_to_rest(1.5, 4, crossing_at(2 / 3)))  # 72 micrometres
    unprepared = tails(robot, Law.rest_to_rest(1.5, 4))
    # a pole of residue rho on the axis leaves coefficients of size rho that do not fall at all
    assert max(right) < 1e-10
    assert min(beside) > 1e-5
    assert min(unprepared) > 1e-2
    assert min(unprepared) > 10 * max(beside)


def test_half_way_between_nodes_the_loops_are_as_closed_as_the_certificate_says():
    robot = robots.load("five_bar", flexibility="flexible_links")
    plan = plan_crossing(robot, LINE, duration=1.5)
    t = np.linspace(0.0, 1.5, 997)
    q = plan.dynamics.configuration(t)
    tips = (placements(robot.model, ("left_tip", "right_tip"), row) for row in q)
    gaps = [np.linalg.norm(left.translation - right.translation) for left, right in tips]
    assert max(gaps) < max(10 * plan.certificate.max_closure_error, 1e-14)


def test_the_certificate_sees_errors_of_the_series_of_torques_and_of_poses(robot):
    # residuals are measured on the series themselves: an error of 1e-6 in one of their coefficients shows
    motion = inverse_dynamics(robot, CLEAR, Law.rest_to_rest(1.5, 2))
    branch, grid = track_path(robot, CLEAR), motion.torques.grid
    state, _ = pass_at_rest(branch, grid, motion.law, np.empty(0))
    exact, _ = measure_residuals(branch, state, motion)
    assert exact.certificate.max_residual_torque < 1e-13
    assert exact.certificate.max_closure_error < 1e-14

    moved = motion.offsets.coefficients.copy()
    moved[:, 3, robot.actuated[0]] += 1e-6  # [rad] of a crank
    opened, _ = measure_residuals(branch, state, replace(motion, offsets=TimeFunction(grid.edges, moved)))
    reach = 0.5  # [m] of two links: the crank turns its whole leg
    assert 0.1e-6 * reach < opened.certificate.max_closure_error < 1.0001e-6 * reach

    turned = state.forces.joint_torque + 1e-6 * np.cos(3.0 * np.pi * grid.times / 1.5)[:, None]  # [N m]
    wrong = replace(state, forces=state.forces._replace(joint_torque=turned))
    missing, _ = measure_residuals(branch, wrong, motion)
    assert 1e-7 < missing.certificate.max_residual_torque < 1e-4


def test_knots_of_a_spline_get_panels_of_their_own(robot):
    points = [
        [0.1, 0.345],
        [0.08, 0.33],
        [0.05, 0.33],
        [0.03, 0.31],
        [0.02, 0.33],
        [0.0, 0.32],
        [-0.02, 0.31],
        [-0.05, 0.32],
    ]
    path = Spline(points)
    assert len(path.knots) == 2  # degree 5 through 8 points
    plan = plan_crossing(robot, path, duration=1.5)
    edges = plan.dynamics.torques.edges
    np.testing.assert_allclose(plan.law(edges[1:-1]), path.knots, atol=1e-12)
    assert plan.certificate.tail < 1e-10
    raw = finite_difference_torques(robot, path, plan.law, samples=3001)
    # second differences of motor angles of 50 rad at steps of 0.5 ms: h^2 and eps / h^2
    np.testing.assert_allclose(plan.torque(raw.time)[5:-5], raw.torque[5:-5], atol=1e-4)


def test_raw_sampling_agrees_with_closed_forms_away_from_the_crossing():
    robot = robots.load("five_bar", flexibility="flexible_links")
    plan = plan_crossing(robot, CLEAR, duration=1.5)
    exact = oracle.solve("A", "flexible_links", "deformed")
    few = slice(100, 2901, 100)
    raw = finite_difference_torques(robot, CLEAR, plan.law, samples=3001)
    np.testing.assert_allclose(raw.torque[few], oracle.torques(exact, raw.time[few]), atol=2e-6)


def test_gravity_in_the_plane_of_motion_bends_the_robot_at_rest():
    description = replace(robots.load("five_bar").description, gravity=(0.0, -9.81, 0.0))
    for flexibility in ("rigid", "flexible_links"):
        hanging = ParallelRobot.from_description(description, flexibility=flexibility)
        plan = plan_crossing(hanging, CLEAR, duration=1.5)
        for end in (0.0, 1.5):
            # statics by virtual work: motor torque = -(gear) J' (weight), J = A^-1 B in closed form
            x = plan.platform(end)
            if flexibility == "rigid":
                A, B, _ = oracle.velocity_matrices(x)
                holding = (np.linalg.solve(A, B).T @ [0.0, 98.1]) / 50.0
                np.testing.assert_allclose(plan.torque(end), holding, rtol=1e-12)
            np.testing.assert_allclose(plan.motor_angle(end, 1), 0.0, atol=1e-8)
            assert np.all(np.abs(plan.torque(end)) > 0.01)
        if hanging.n_e:
            assert np.all(np.abs(plan.deflection(0.0)) > 1e-6)


def test_a_crossing_under_gravity_is_proved_by_power(robot):
    description = replace(robot.description, gravity=(0.0, -9.81, 0.0))
    hanging = ParallelRobot.from_description(description, flexibility="flexible_links")
    plan = plan_crossing(hanging, LINE, duration=0.3)
    (crossing,) = plan.crossings
    # gravity pulls along t_s: 10 kg have to fall freely along it at that instant
    assert abs(crossing.acceleration) > 10.0
    assert crossing.platform @ [0, 1] > 0
    acceleration = plan.platform(crossing.time, 2)
    assert acceleration @ crossing.twist == pytest.approx(-9.81 * crossing.twist[1], rel=1e-9)


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_law_that_stands_still_on_the_locus_is_refused(robot, goes_on):
    """It goes to s_c, rests there and goes on, or never moves."""
    (point,) = locate_singularities(robot, LINE)
    reach = min(point.s, 1 - point.s) * goes_on
    s = np.polynomial.Polynomial([point.s]) + reach * np.polynomial.Polynomial([-1.0, 1.0]) ** 3
    with pytest.raises(NoLaw, match="stands still on a Type 2 singularity"):
        inverse_dynamics(robot, LINE, Brought(lambda t, order: s.deriv(order)(t) + 0.0 * t, duration=2.0))


@pytest.mark.parametrize(
    ("law", "message"), [(lambda t: 1.2 * t, "s must stay in"), (lambda t: t * np.nan, "one finite s")]
)
def test_laws_that_cannot_be_are_refused(robot, law, message):
    with pytest.raises(InvalidInput, match=message):
        inverse_dynamics(robot, CLEAR, Brought(lambda t, order: law(t), duration=1.0))


def test_what_falls_between_the_nodes_is_noticed(robot):
    """A smooth law with a bump of a thousandth of the path, 3 ms wide, that 64 nodes do not see."""

    def bumpy(t, order):
        u = (t - 0.75) / 3e-3
        factor = {0: 1.0, 1: -2 * u / 3e-3, 2: (4 * u**2 - 2) / 9e-6}[order]
        return Law.rest_to_rest(1.5, 4)(t, order) + 1e-3 * factor * np.exp(-(u**2))

    with pytest.raises(NotConverged, match="not resolved"):
        inverse_dynamics(robot, CLEAR, Brought(bumpy))


def test_elastic_bodies_with_inertia_do_not_feed_rounding_back():
    heavy = robots.load("five_bar_heavy", flexibility="flexible_links")
    twice = Line([0.1, 0.345], [-0.2, -0.2])
    plan = plan_crossing(heavy, twice, duration=0.8)
    assert len(plan.crossings) == 2
    assert plan.certificate.tail < 1e-10
    assert max(crossing.residual for crossing in plan.crossings) < 1e-11


class BroughtInPanels(Brought):
    """One with a name that laws of the package use, too."""

    edges = ()


@pytest.mark.parametrize("kind", [Brought, BroughtInPanels])
@pytest.mark.parametrize("order", [1, 2])
def test_a_law_whose_derivatives_are_not_its_own_is_refused(kind, order):
    good = Law.rest_to_rest(1.5, 4)
    wrong = kind(lambda t, k: good(t, k) * (1.001 if k == order else 1.0))
    with pytest.raises(InvalidInput, match=rf"law\(t, {order}\) is not the derivative"):
        inverse_dynamics(robots.load("five_bar"), CLEAR, wrong)


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_joints", "flexible_links"])
def test_deflections_that_are_only_rounding_refuse_no_motion(flexibility):
    """At constant speed along a line the payload of the 5R needs no force, and no spring deflects."""
    constant = Brought(lambda t, k: [t / 1.5, 1 / 1.5 + 0 * t, 0 * t][k])
    found = inverse_dynamics(robots.load("five_bar", flexibility=flexibility), CLEAR, constant)
    assert np.abs(found.deflection(np.linspace(0, 1.5, 50))).max(initial=0.0) < 1e-6


@pytest.mark.parametrize(("tail", "change"), [(1e-3, 1e-9), (1e-9, 1e-3)])
def test_a_motion_is_no_better_resolved_than_its_series_or_its_deflections(tail, change):
    certificate = Certificate(nodes=64, tail=tail, passes=1, change=change, end_speed=0.0, monotone=True)
    assert certificate.unresolved == 1e-3
