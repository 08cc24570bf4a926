"""Parts without mass: found from the balance of their springs, and refused when nothing balances."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import InvalidInput, NotAssembled, ParallelRobot, plan_scene, simulate
from framework.model.description import LineSpring
from framework.simulation.consistent_states import allowed_motions, consistent_state
from framework.simulation.equations import EquationsOfMotion

ROBOT = "five_bar"
FLEXIBILITY = "flexible_links"


@pytest.fixture(scope="module")
def plan(robot):
    return plan_scene(robot, "C")


def motions(robot, q):
    equations = EquationsOfMotion.of(robot)
    rest = np.zeros((1, robot.model.nv))
    at = equations.tangent(np.asarray(q)[None], rest, rest)
    allowed = allowed_motions(equations, at)
    basis, light = allowed.basis[0], allowed.light[0]  # (nv, d), (d,)
    return at, (basis[:, ~light], basis[:, light])


def test_two_motions_of_the_5R_with_massless_legs_move_no_mass(robot, plan):
    for t in (0.0, 0.7, 1.0):
        at, (massive, light) = motions(robot, plan.dynamics.configuration(t)[0])
        assert (massive.shape[1], light.shape[1]) == (
            4,
            2,
        )  # payload and rotors; gear against rod in each leg
        np.testing.assert_allclose(at.mass[0] @ light, 0, atol=1e-12)
        np.testing.assert_allclose(at.jacobian[0] @ light, 0, atol=1e-12)
    heavy = robots.load("five_bar_heavy", flexibility="flexible_links")
    assert motions(heavy, plan.dynamics.configuration(0.0)[0])[1][1].shape[1] == 0


def test_a_planned_state_is_in_balance(robot, plan):
    equations = EquationsOfMotion.of(robot)
    for t in (0.0, 0.5, 1.0):
        q, v = plan.dynamics.configuration(t)[0], plan.dynamics.velocity(t)[0]
        new_q, new_v = consistent_state(equations, q, v, plan.torque(t))
        np.testing.assert_allclose(new_q, q, atol=1e-11)
        np.testing.assert_allclose(new_v, v, atol=1e-8)


def test_a_start_out_of_balance_moves_nothing_that_has_mass(robot, plan):
    q = plan.dynamics.configuration(0.5)[0]
    at, (_, light) = motions(robot, q)
    pushed = q + light @ np.array([1e-4, -2e-4])
    back, _ = consistent_state(
        EquationsOfMotion.of(robot), pushed, np.zeros(robot.model.nv), plan.torque(0.5)
    )
    # along the massless motions only, up to their curvature
    np.testing.assert_allclose(at.mass[0] @ (back - pushed), 0, atol=1e-6)
    assert np.abs(back - q).max() < 1e-6


def test_light_legs_tend_to_massless_ones(plan):
    """Driven by the torques for massless legs, legs of mass m leave the path in proportion to m."""
    heavy = robots.load("five_bar_heavy", flexibility="flexible_links")
    off = []
    for factor in (1e-3, 1e-5):
        model = heavy.model.copy()
        for joint in range(1, model.njoints):
            payload = model.inertias[joint].mass > 5
            if not payload:
                model.inertias[joint].mass *= factor
                model.inertias[joint].inertia *= factor
        other = replace(heavy, model=model)
        off.append(simulate(other, plan, duration=0.4, method="stiff", tolerance=1e-9).tracking_error)
    assert off[0] > 1e-9
    assert off[1] < 0.1 * off[0]


def test_a_motion_with_neither_mass_nor_stiffness_is_refused_and_named():
    robot = robots.load("five_bar")
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        model.inertias[joint].setZero()
    weightless = replace(robot, model=model, rotor_inertia=np.zeros(2))
    with pytest.raises(InvalidInput, match=r"a motion of .*neither mass nor stiffness.*<inertial>"):
        simulate(weightless, lambda t: [0.0, 0.0], duration=0.1)


def test_massless_motions_that_dampers_between_points_hold_keep_their_start():
    """Dampers from the tip to two points of the base resist all motions, and no spring drives one."""
    description = robots.load("five_bar").description
    dampers = tuple(LineSpring((base, "left_tip"), damping=4.0) for base in ("left_crank", "base"))
    robot = ParallelRobot.from_description(replace(description, line_springs=dampers))
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        model.inertias[joint].setZero()
    robot = replace(robot, model=model, rotor_inertia=np.zeros(2))
    start = robot.reference.q
    q, _ = consistent_state(EquationsOfMotion.of(robot), start, np.zeros(robot.nv), np.zeros(2))
    np.testing.assert_allclose(q, start, rtol=0, atol=1e-13)


def test_a_start_that_does_not_close_is_refused(robot):
    with pytest.raises(NotAssembled, match="not assembled"):
        simulate(robot, lambda t: [0.0, 0.0], start=np.full(robot.model.nq, 1.0), duration=0.1)
