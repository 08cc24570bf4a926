"""Torque on a Type 2 singularity itself: the plan's, the closed form's, and refusals that say why."""

import numpy as np
import pytest

import robots
from framework import NoAnswer, SingularPose, assemble, dynamics_at, plan_scene
from framework.dynamics.pointwise_dynamics import _TaylorMotion
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.motion_rates import motion_at
from tests.oracles import five_bar as oracle

ON_THE_AXIS = np.array([0.0, np.sqrt(0.06)])  # of the 5R: its rods in one line, level, and t_s upright
TO_AND_FRO = np.array([0.3, -0.4])
QUICK = ("five_bar", "biglide", "four_bar")
NAMES = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in robots.CATALOGUE]


def on_the_axis():
    robot = robots.load("five_bar")
    return robot, assemble(robot, ON_THE_AXIS).q


@pytest.mark.parametrize("name", NAMES)
def test_it_is_the_torque_of_the_plan(name):
    robot, crossed = robots.load(name), 0
    for scene, asked in robot.description.scenes.items():
        if asked.times == ():
            continue
        try:
            plan = plan_scene(robot, scene)
        except NoAnswer:
            continue
        for crossing in plan.crossings:
            crossed += 1
            t = crossing.time
            dx, ddx, dddx = (plan.platform(t, order) for order in (1, 2, 3))
            found = dynamics_at(robot, plan.dynamics.motion(t).q[0], dx=dx, ddx=ddx, dddx=dddx)
            torque = plan.torque(t)
            # the plan itself is resolved to its tail
            np.testing.assert_allclose(found.torque, torque, rtol=0, atol=1e-10 * np.abs(torque).max())
    free_of_type_2 = (
        *("agile_eye", "delta_hinges", "gough_stewart", "humanoid_ankle", "n_four_bar"),
        *("standing_quadruped", "three_upu", "two_arms"),
    )
    assert crossed or name in free_of_type_2


@pytest.mark.parametrize("smoothness", [2, 4])
def test_it_is_the_limit_of_the_5r_to_fifty_digits(smoothness):
    exact = oracle.solve(scene="C", flexibility="rigid", geometry="rigid", smoothness=smoothness)
    s, ds, dds, ddds = (float(exact.law(1.0, order)) for order in range(4))
    start, end = (np.array(point, dtype=float) for point in oracle.SCENES["C"][:2])
    along = end - start
    robot = robots.load("five_bar")
    q = assemble(robot, start + s * along).q
    found = dynamics_at(robot, q, dx=ds * along, ddx=dds * along, dddx=ddds * along)
    np.testing.assert_allclose(found.torque, oracle.torques(exact, [1.0])[0], rtol=0, atol=1e-12)
    other = dynamics_at(robot, q, dx=ds * along, ddx=dds * along, dddx=(ddds + 10.0) * along)
    assert np.abs(other.torque - found.torque).max() > 1e-3  # the limit contains the jerk


def test_a_constant_wrench_of_the_world_is_in_the_limit():
    """Against regular instants on either side, extrapolated to the fourth order."""
    robot, q = on_the_axis()
    wrenches = {"left_tip": [5.0, 0.0, 0.0, 0.0, 0.0, 0.0]}  # level: t_s . W_p stays zero
    jerk = np.array([2.0, 3.0])
    on = dynamics_at(robot, q, dx=TO_AND_FRO, dddx=jerk, wrenches=wrenches)

    def beside(t):
        x = ON_THE_AXIS + t * TO_AND_FRO + t**3 / 6 * jerk
        here = assemble(robot, x).q
        return dynamics_at(
            robot, here, dx=TO_AND_FRO + t**2 / 2 * jerk, ddx=t * jerk, wrenches=wrenches
        ).torque

    means = [0.5 * (beside(t) + beside(-t)) for t in (0.004, 0.008)]
    limit = (4 * means[0] - means[1]) / 3
    np.testing.assert_allclose(on.torque, limit, rtol=0, atol=1e-6 * np.abs(limit).max())


def test_springs_that_rest_leave_the_limit_of_the_rigid_robot():
    robot, q = on_the_axis()
    elastic = robots.load("five_bar", flexibility="flexible_links")
    moving = {"dx": TO_AND_FRO, "dddx": np.array([2.0, 3.0])}
    found = dynamics_at(elastic, assemble(elastic, ON_THE_AXIS).q, **moving)
    np.testing.assert_allclose(found.torque, dynamics_at(robot, q, **moving).torque, rtol=1e-9)


def test_without_a_jerk_it_is_asked_for():
    robot, q = on_the_axis()
    with pytest.raises(SingularPose, match=r"Type 2.*third order; give dddx"):
        dynamics_at(robot, q, dx=TO_AND_FRO)


def test_condition_8_violated_is_told_in_newtons():
    """t_s is upright there, and a payload of 10 kg is asked to accelerate by 0.5 m/s^2."""
    robot, q = on_the_axis()
    with pytest.raises(SingularPose, match=r"t_s \. W_p = .*condition \(8\)") as caught:
        dynamics_at(robot, q, dx=TO_AND_FRO, ddx=[0.0, 0.5], dddx=[0.0, 0.0])
    assert abs(caught.value.wrench) == pytest.approx(5.0, rel=1e-9)


@pytest.mark.parametrize(
    ("dx", "words"), [([0.0, 0.0], "stands still"), ([0.4, 0.0], "runs along or touches it")]
)
def test_what_does_not_cross_the_locus_has_no_limit_of_third_order(dx, words):
    robot, q = on_the_axis()
    with pytest.raises(SingularPose, match=words):
        dynamics_at(robot, q, dx=dx, dddx=[0.0, 0.0])


@pytest.mark.parametrize("share", [-0.05, -0.005, 0.005, 0.05])
def test_a_root_far_from_the_instant_is_another_singularity(share):
    """The motion is straight and meets the axis at a share of half a panel; a hundredth is near."""
    robot, _ = on_the_axis()
    half = 0.05 / 5.0  # [s]: a joint travels 0.05 rad at some 5 rad/s
    x, rates = ON_THE_AXIS - share * half * TO_AND_FRO, np.array([TO_AND_FRO, 0 * TO_AND_FRO, 0 * TO_AND_FRO])
    closed = assembled_at(robot, assemble(robot, x).q)
    motion = _TaylorMotion(robot, closed.x, motion_at(robot, closed, rates[:1], rates[1:2]), rates, {})
    if abs(share) < 0.01:
        assert motion.find_crossing(half) == pytest.approx(share * half, abs=1e-9 * half)
    else:
        with pytest.raises(SingularPose, match="along or touches"):
            motion.find_crossing(half)
