"""Fixed steps: of second order, without drift, alike alone and in stacks."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import InvalidInput, NotConverged, plan_scene, simulate
from framework.simulation import Stepper
from framework.simulation.stepper import CLOSING_SHARE


def held_torque(robot, plan, scheme, steps):
    """End of a run under the planned torques of the middle of each step, and its largest open loop."""
    stepper = Stepper.of(robot, scheme=scheme)
    h = plan.duration / steps
    state = stepper.start(plan.dynamics.configuration(0.0)[0], torque=plan.torque(0.0))
    for torque in plan.torque((np.arange(steps) + 0.5) * h):
        state = stepper.step(*state, torque, h)
    gap = np.abs(stepper.terms(state.q[None], state.v[None]).residual).max()
    return stepper.platform(*state)[0], gap


CASES = [
    ("five_bar_heavy", "rigid", "midpoint"),
    ("five_bar", "flexible_joints", "extrapolated"),
]


@pytest.mark.parametrize(("name", "flexibility", "scheme"), CASES)
def test_halving_the_step_quarters_the_error(name, flexibility, scheme):
    robot = robots.load(name, flexibility=flexibility)
    plan = plan_scene(robot, "A")
    end = plan.platform(plan.duration)
    ends, gaps = zip(*(held_torque(robot, plan, scheme, steps) for steps in (250, 500)), strict=True)
    coarse, fine = (np.abs(one - end).max() for one in ends)
    assert fine < 1e-5
    assert coarse / fine == pytest.approx(4.0, rel=0.3)
    assert max(gaps) < 1e-9


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_joints", "flexible_links"])
def test_the_scheme_is_chosen_by_the_springs(flexibility):
    stepper = Stepper.of(robots.load("five_bar", flexibility=flexibility))
    assert stepper.scheme == ("extrapolated" if flexibility == "flexible_links" else "midpoint")


def test_one_robot_serves_many_runs_and_one_that_is_lost_disturbs_none():
    robot = robots.load("five_bar")
    stepper = Stepper.of(robot)
    start = stepper.start(np.repeat(robot.q_near[None], 3, axis=0))
    torque = np.array([[0.1, 0.0], [np.nan, 0.0], [0.1, 0.0]])
    state = stepper.step(*start, torque, 1e-3)
    assert np.all(np.isnan(state.v[1]))
    np.testing.assert_array_equal(state.q[0], state.q[2])
    np.testing.assert_array_equal(state.q[0], stepper.step(start.q[0], start.v[0], torque[0], 1e-3).q)


def test_open_loops_close_and_do_not_overshoot():
    robot = robots.load("five_bar_heavy")
    stepper = Stepper.of(robot)
    q, v = stepper.start(robot.q_near)
    q = q + np.array([0.0, 0.0, 0.0, 1e-4])
    gaps = []
    for _ in range(40):
        q, v = stepper.step(q, v, np.zeros(2), 1e-3)
        gaps.append(np.abs(stepper.terms(q[None], v[None]).residual).max())
    assert max(gaps) <= 3e-5
    assert gaps[-1] < 1e-9


def test_stiff_springs_cost_no_small_steps():
    """Springs a million times stiffer than the 5R's: an explicit method would need h < 1e-6 s."""
    robot = robots.load("five_bar", flexibility="flexible_links")
    stiff = replace(robot, stiffness=1e6 * robot.stiffness)
    plan = plan_scene(stiff, "C")
    for method, apart in (("fast", 1e-4), ("stiff", 1e-6)):
        assert (
            simulate(stiff, plan, method=method, step=2e-3 if method == "fast" else None).tracking_error
            < apart
        )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Stepper.of([]), "at least one robot"),
        (lambda: Stepper.of(robots.load("five_bar"), scheme="euler"), "scheme 'euler'"),
        (
            lambda: Stepper.of(robots.load("five_bar", flexibility="flexible_links"), scheme="midpoint"),
            "extrapolated",
        ),
        (lambda: Stepper.of([robots.load("five_bar"), robots.load("four_bar")]), "one structure"),
        (lambda: Stepper.of(robots.load("five_bar"), damping=[1.0]), "damping"),
    ],
)
def test_misuse_is_named(make, message):
    with pytest.raises(InvalidInput, match=message):
        make()


def test_running_away_is_told():
    with pytest.raises(NotConverged, match="runs away"):
        simulate(robots.load("five_bar"), lambda t, q, v: 1e6 * v[[0, 2]] + 1e3, duration=1.0, method="fast")


def test_extrapolation_closes_loops_at_one_rate():
    """Whole and half steps reach (1 - share) of an open loop, so that twice the half less the whole does."""
    robot = robots.load("five_bar", flexibility="flexible_links")
    stepper = Stepper.of(robot, scheme="extrapolated")
    q = robot.reference.q.copy()
    q[robot.passive[-1]] += 1e-6
    v = np.zeros(robot.nv)
    before = stepper.terms(q[None], v[None]).residual
    after = stepper.terms(*(part[None] for part in stepper.step(q, v, np.zeros(2), 1e-4))).residual
    np.testing.assert_allclose(after, (1 - CLOSING_SHARE) * before, atol=1e-3 * np.abs(before).max())
