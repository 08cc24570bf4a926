"""Deflections and law found together: balance, rest at both ends, and one answer whatever it started from."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.linalg import null_space
from scipy.sparse import csr_array

import robots
from framework import CrossingPlan, plan_crossing, plan_scene
from framework.dynamics.balance_equations import BalanceEquations, LinearBalance
from framework.dynamics.forces import tree_forces
from framework.dynamics.restoration import deflections_of
from framework.dynamics.singularity_crossings import deformed_crossings
from framework.kinematics.linearised_loops import type2_matrix
from framework.kinematics.motion_rates import motor_speeds
from framework.laws.optimal_law import OnParameter
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.points_on_path import search_path
from framework.tolerances import MAX_END_RATE
from tests.dynamics.upright_robots import drawn, is_right, judged

ROBOTS = {"light five-bar": 7, "heavy five-bar": 1, "orthoglide": 5}  # none has a polynomial that advances
STIFF = 0.01  # compliance over that of the catalogue
CASES = [("light five-bar", STIFF), *(pytest.param(kind, 1.0, marks=pytest.mark.slow) for kind in ROBOTS)]


@cache
def planned(kind: str, softness: float) -> CrossingPlan:
    """An upright robot with elastic drives and links, across its locus."""
    asked = drawn(ROBOTS[kind])
    return plan_crossing(asked.robot(softness), asked.path, duration=asked.duration, law="optimal")


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "softness"), CASES)
def test_the_equations_of_motion_hold_beside_the_crossing_too(kind, softness):
    assert is_right(judged(planned(kind, softness)))


@pytest.mark.parametrize(("kind", "softness"), CASES)
def test_the_motion_begins_and_ends_at_rest(kind, softness):
    plan = planned(kind, softness)
    quickest = np.abs(plan.dynamics.deflection(np.linspace(0.0, plan.duration, 201), 1)).max(axis=0)
    allowed = 1e-4 if softness == STIFF else MAX_END_RATE
    for t in (0.0, plan.duration):
        assert np.all(np.abs(plan.dynamics.deflection(t, 1)) <= allowed * quickest)


def smooth_noise(splines, rng, count):
    """Random Chebyshev series (T, count) of degree 20 at the nodes of splines."""
    return chebyshev.chebvander(splines.nodes.p, 20) @ rng.normal(size=(21, count))


def test_slopes_of_the_balance_are_those_of_central_differences():
    plan, rng = planned("light five-bar", STIFF), np.random.default_rng(0)
    branch = search_path(plan.robot, plan.path).branch
    known = deflections_of(branch, plan.law)

    def slowed(scalars):
        """The law at another pace, which changes rates and accelerations alone."""
        coefficients = plan.law.coefficients * (1.0 + scalars[0])
        return OnParameter(replace(plan.law, coefficients=coefficients, duration=0.0), branch.knots)

    equations = BalanceEquations(branch, slowed, np.array([1e-4]))
    splines, series = known.splines, known.series / equations.units
    step = 1e-5 * np.abs(series).max() * splines.fit(smooth_noise(splines, rng, series.shape[1]))
    state, pace = equations.evaluate(splines, series, np.zeros(1)), np.array([1e-5])
    near = state.balance.motion.q
    ahead = equations.evaluate(splines, series + step, pace, near=near).balance.F
    behind = equations.evaluate(splines, series - step, -pace, near=near).balance.F
    by_series, by_scalars, _ = equations.slopes(state)
    foreseen = (by_series @ step.ravel() + by_scalars @ pace).reshape(ahead.shape)
    change = 0.5 * (ahead - behind)
    assert np.abs(change - foreseen).max() <= 1e-6 * np.abs(change).max()


def test_one_step_squares_a_small_error():
    plan = planned("light five-bar", STIFF)
    branch = search_path(plan.robot, plan.path).branch
    known = deflections_of(branch, plan.law)
    equations = BalanceEquations(branch, lambda _: known.clock, np.zeros(0))
    splines, series = known.splines, known.series / equations.units
    noise = smooth_noise(splines, np.random.default_rng(0), series.shape[1])
    off = 1e-3 * np.abs(series).max() * splines.fit(noise)
    state = equations.evaluate(splines, series + off, np.zeros(0))
    step = equations.linearise(state).step(state)
    new = equations.evaluate(splines, state.series + step.series, np.zeros(0))
    assert new.misfit <= 1e-3 * state.misfit


@pytest.mark.parametrize(
    ("name", "scene", "duration"),
    [
        ("standing_quadruped", "sway", 0.35),  # redundant motors
        pytest.param("delta", "cross", 0.12, marks=pytest.mark.slow),
    ],
)
def test_polynomials_too_quick_for_passes_are_in_balance(name, scene, duration):
    robot = robots.load(name, flexibility="flexible_links")
    plan = plan_scene(robot, scene, duration=duration, law="polynomial")
    assert is_right(judged(plan))
    times = np.linspace(0.1, 0.9, 9) * plan.duration
    for t, torque in zip(times, plan.torque(times), strict=True):
        # redundant motors have the torques of least norm: none along directions in which they only strain
        motion = plan.dynamics.motion(t)
        speeds, _ = motor_speeds(robot, motion.linearised)
        straining = null_space(speeds[0].T)
        held = torque - robot.rotor_inertia * robot.gear_ratio * motion.a[0, robot.actuated]
        assert np.abs(straining.T @ held).max(initial=0.0) <= 1e-9 * np.abs(torque).max()


@pytest.mark.parametrize(("weak", "vibration"), [(1e-12, 1e-6), (5e-6, 1e-5)])
def test_steps_leave_the_least_of_what_must_rest_among_those_that_change_the_balance_as_little(
    weak, vibration
):
    """Of eight unknowns three hardly change F: along these R y + rest is at its least."""
    rng = np.random.default_rng(5)
    by_series = csr_array(np.diag([1.0, 2.0, 1.0, 3.0, 1.0, weak, weak, weak]))
    by_scalars = np.zeros((8, 1))
    by_scalars[0] = 1.0
    rest = rng.standard_normal((2, 9))
    linear = LinearBalance.factorise(by_series, by_scalars, rest.copy(), vibration)
    assert linear.vibrations.shape == (9, 2)  # of the three and the redundant scalar, those that R sees
    F, at_rest = rng.standard_normal((8, 1)), rng.standard_normal((2, 1))
    F[5:] = 0.0
    y = linear._least_change(F, at_rest)
    remaining = linear.rest @ y + at_rest
    np.testing.assert_allclose(linear.vibrations.T @ linear.rest.T @ remaining, 0.0, atol=1e-8)
    np.testing.assert_allclose(linear._change_balance(y) + F, 0.0, atol=10.0 * vibration)


def test_a_secant_step_to_a_crossing_leads_to_the_wrench_there_too():
    """However far from the root of g an instant is within rounding, the wrench is that at the root."""
    plan = planned("light five-bar", STIFF)
    crossing = plan.crossings[0]

    def found_from(t):
        """The crossing found from an instant, with the wrench at this instant and g at the two probes."""
        times = t + np.array([0.0, np.copysign(1e-6, 0.5 * plan.duration - t)]) * plan.duration
        motion = plan.dynamics.motion(times)
        forces = tree_forces(plan.robot, motion)
        matrices = type2_matrix(plan.robot, motion.linearised)
        g = solve_bordered(matrices, Border.of(matrices[0])).g
        (found,) = deformed_crossings(plan.dynamics, (replace(crossing, time=t),))
        return found.wrench, forces[0] @ crossing.motion, (g[1] - g[0]) / (times[1] - times[0])

    _, at_root, slope = found_from(crossing.time)
    for g in (-8e-13, 8e-13):  # `deformed_crossings` takes a secant step below 1e-12
        wrench, at_instant, _ = found_from(crossing.time + g / slope)
        assert abs(wrench - at_root) <= 0.05 * abs(at_instant - at_root)
