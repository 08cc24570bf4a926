"""Exudyn on other mechanisms: the slider-crank under our torques, and a published one that tests Exudyn."""

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import robots
from framework import plan_scene
from tests.witness.installed import witness

slider_crank = witness("exudyn", "tests.witness.exudyn_slider_crank")
n_four_bar = witness("exudyn", "tests.witness.exudyn_n_four_bar")

SCREW, ROD = 1e5, 2e5  # [N/m], as in the robot file


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_joints", "flexible_links"])
def test_our_torques_take_the_slider_crank_through_its_dead_centre(flexibility):
    plan = plan_scene(robots.load("slider_crank", flexibility=flexibility), "dead_centre")
    sag = plan.deflection(0.0)  # under the weight of the parts, at the start
    springs = slider_crank.Springs(
        screw=(SCREW, sag[0]) if len(sag) > 0 else None,
        rod=(ROD, sag[1]) if len(sag) > 1 else None,
        rotor_speed=plan.motor_angle(0.0, 1)[0] / slider_crank.GEAR_RATIO,
    )
    errors = []
    for step in (1e-3, 5e-4):
        times, angles = slider_crank.simulate(
            springs, lambda t: plan.torque(t)[:, 0], 1.0, step=step, duration=plan.duration
        )
        error = np.abs(angles - plan.platform(times)[:, 0])
        after = times > plan.crossings[0].time
        errors.append([error[~after].max(), error[after].max()])
    coarse, fine = np.array(errors)  # (2,) each [rad]: up to the dead centre, and behind it
    assert np.all(np.abs(np.log2(coarse / fine) - 2) < 0.05)
    assert np.all(np.abs(4 * fine - coarse) / 3 < 1e-7)


def falling_row(loops: int, times: np.ndarray) -> np.ndarray:
    """Angle (T,) [rad] of the N-four-bar: a pendulum that turns over, x" = c sin x, x(0) = 0, x'(0) = v.

    I = (N + 1) / 3 + N, c = g ((N + 1) / 2 + N) / I, and w, the speed at the bottom, from w^2 = v^2 + 4 c:
    x = pi + 2 am(w t / 2 - K(m), m) with m = 4 c / w^2.
    """
    inertia = (loops + 1) / 3 + loops
    c = n_four_bar.GRAVITY * ((loops + 1) / 2 + loops) / inertia
    w = np.sqrt(n_four_bar.SPEED**2 + 4 * c)
    m = 4 * c / w**2
    return np.pi + 2 * ellipj(w * times / 2 - ellipk(m), m)[3]


def test_exudyn_passes_the_singularities_of_the_n_four_bar():
    """Ten times in 10 s all links lie on one line; what the simulator does there is known in closed form."""
    errors = []
    for step in (1e-2, 5e-3, 1e-3):
        times, angles, _ = n_four_bar.simulate(2, step=step, duration=10.0)
        exact = falling_row(2, times)
        errors.append(np.abs(angles - exact).max())
    assert exact[-1] > 10 * np.pi
    assert abs(np.log2(errors[0] / errors[1]) - 2) < 0.05
    assert errors[2] < 1e-3
