"""MuJoCo must find our torques on our motion, and be taken along our path by them."""

import numpy as np
import pytest

import robots
from framework import plan_scene
from tests.benchmarks.chart.peers.five_bar import FiveBar
from tests.witness.installed import witness
from tests.witness.plans import CROSSING, DURATION, ROBOTS, plan_of

inverse = witness("mujoco", "tests.benchmarks.chart.peers.mujoco_inverse")
forward = witness("mujoco", "tests.benchmarks.chart.peers.mujoco_forward")

ELASTIC = ("flexible_joints", "flexible_links")
SAME_TORQUE = 1e-9  # [N m], motor side
BALANCED = 1e-7  # [N m, N] in the equations of the joints: 1e-13 of the springs' stiffness, a few mm or mrad
NEAR = np.array([-1e-3, -1e-4, -1e-6, 0.0, 1e-6, 1e-4, 1e-3])  # [s] around the crossing
TIMES = np.union1d(np.linspace(0.0, DURATION, 301), CROSSING + NEAR)


def motion(plan):
    """q, v, a (T, nv) at TIMES."""
    dynamics = plan.dynamics
    return dynamics.configuration(TIMES), dynamics.velocity(TIMES), dynamics.velocity(TIMES, 2)


def tree_of(name, flexibility, **options):
    joints = list(plan_of(name, flexibility).robot.model.names)[1:]
    return inverse.Tree(FiveBar.of(name, flexibility), joints, **options)


def distances(name, flexibility, step, **options):
    """Largest distance from the path [m], and the largest gap between the tips [m], of a forward run."""
    plan = plan_of(name, flexibility)
    robot = FiveBar.of(name, flexibility)
    done = forward.prepared(robot, plan.torque, plan.platform(0.0), step=step, duration=DURATION, **options)()
    return done.error(plan).max(), done.gap


@pytest.mark.parametrize("flexibility", ELASTIC)
@pytest.mark.parametrize("name", ROBOTS)
def test_inverse_dynamics_of_elastic_robots_gives_our_torques_at_the_singularity_too(name, flexibility):
    plan = plan_of(name, flexibility)
    found = tree_of(name, flexibility).inverse(*motion(plan))
    assert found.gap.max() < 1e-14
    assert np.abs(found.torque - plan.torque(TIMES)).max() < SAME_TORQUE
    assert found.imbalance.max() < BALANCED


@pytest.mark.parametrize("name", ROBOTS)
def test_inverse_dynamics_of_rigid_robots_gives_our_torques_but_for_its_own_0_by_0(name):
    plan = plan_of(name, "rigid")
    tree = tree_of(name, "rigid")
    error = np.abs(tree.inverse(*motion(plan)).torque - plan.torque(TIMES)).max(axis=1)
    away = np.abs(TIMES - CROSSING) > 2e-3
    assert error[away].max() < SAME_TORQUE
    assert error[~away].max() > 1e3 * SAME_TORQUE
    # the equations themselves, with our torques in them, hold at every instant
    assert tree.imbalance(*motion(plan), plan.torque(TIMES)).max() < BALANCED


def test_forces_of_the_undeformed_robot_do_not_balance_the_deformed_one():
    """The witness tells a right torque from a wrong one: here small displacements, 70 um in 0.25 m."""
    plan = plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C", geometry="rigid")
    left = tree_of("five_bar", "flexible_links").imbalance(*motion(plan), plan.torque(TIMES))
    assert left.max() > 1e3 * BALANCED


@pytest.mark.parametrize("least_mass", [1e-3, 1e-6])
def test_the_least_mass_that_mujoco_is_given_shows_in_proportion(least_mass):
    """MuJoCo refuses bodies without mass: m [kg] on each link costs 5e-3 N m/kg of torque."""
    plan = plan_of("five_bar", "flexible_links")
    tree = tree_of("five_bar", "flexible_links", least_mass=least_mass)
    error = np.abs(tree.inverse(*motion(plan)).torque - plan.torque(TIMES)).max()
    assert 3e-3 < error / least_mass < 6e-3


@pytest.mark.parametrize("name", ROBOTS)
def test_rigid_robots_stay_on_the_path(name):
    coarse, wide = distances(name, "rigid", 2e-3)
    fine, narrow = distances(name, "rigid", 1e-3)
    assert fine < 1e-9
    assert abs(np.log2(coarse / fine) - 2) < 0.2
    assert abs(np.log2(wide / narrow) - 2) < 0.05


def test_elastic_robots_with_heavy_legs_stay_on_the_path_from_their_planned_start():
    """Legs with mass on springs do not quite start at rest: 2e-6 of the largest speed, 1.5e-9 m of path."""
    plan = plan_of("five_bar_heavy", "flexible_links")
    dynamics, names = plan.dynamics, list(plan.robot.model.names)[1:]
    states = zip(dynamics.configuration(0.0)[0], dynamics.velocity(0.0)[0], strict=True)
    planned = dict(zip(names, states, strict=True))
    orders = {}
    for joints in (None, planned):
        coarse, fine = (
            distances("five_bar_heavy", "flexible_links", step, joints=joints)[0] for step in (2e-3, 1e-3)
        )
        assert fine < 2e-9
        orders[joints is planned] = np.log2(coarse / fine)
    assert abs(orders[True] - 2) < 0.1
    assert orders[False] < 1.5


def test_legs_without_mass_are_beyond_a_forward_run():
    """Their stand-in mass costs 5 cm of path per kg, and less of it asks for a shorter step."""
    some, _ = distances("five_bar", "flexible_links", 1e-3, least_mass=0.2)
    less, _ = distances("five_bar", "flexible_links", 1e-3, least_mass=0.1)
    assert 4e-2 < less / 0.1 < 6e-2
    assert abs(some / less - 2) < 0.2
    with pytest.raises(ArithmeticError, match="MuJoCo"):
        distances("five_bar", "flexible_links", 1e-3, least_mass=1e-3)
