"""Exudyn, driven by our torques, must take the payload along our path, through the singularity."""

import numpy as np
import pytest

from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, FiveBar
from tests.witness.installed import witness
from tests.witness.plans import CROSSING, DURATION, ROBOTS, plan_of, wrong_law

exudyn = witness("exudyn", "tests.benchmarks.chart.peers.exudyn_five_bar")

FLEXIBILITIES = ("rigid", "flexible_joints", "flexible_links")
STEPS = (1e-3, 5e-4, 2.5e-4)  # [s]
SPARE = 1.2  # motors that give so much of what the right law asks at most


def run(name, flexibility, plan, step, *, limit=np.inf, rotor_speeds=(0.0, 0.0)):
    return exudyn.prepared(
        FiveBar.of(name, flexibility),
        lambda t: np.clip(plan.torque(t), -limit, limit),
        plan.platform(0.0),
        step=step,
        duration=DURATION,
        rotor_speeds=rotor_speeds,
    )()


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
@pytest.mark.parametrize("name", ["five_bar", pytest.param("five_bar_heavy", marks=pytest.mark.slow)])
def test_the_distance_from_the_path_falls_with_the_square_of_the_step(name, flexibility):
    plan = plan_of(name, flexibility)
    rotor_speeds = plan.motor_angle(0.0, 1) / GEAR_RATIO  # 1e-7 rad/s with heavy elastic legs, else rounding
    errors = []
    for step in STEPS:
        done = run(name, flexibility, plan, step, rotor_speeds=rotor_speeds)
        error, after = done.error(plan), done.time > CROSSING
        errors.append([error[~after].max(), error[after].max()])
    coarse, middle, fine = np.array(errors)  # (2,) each: up to the singularity, and behind it
    assert np.all(np.abs(np.log2(coarse / middle) - 2) < 0.05)
    assert np.all(np.abs(np.log2(middle / fine) - 2) < 0.05)
    rest = np.abs(4 * fine - middle) / 3  # extrapolated to step 0: what is left is ours
    assert np.all(rest < 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_the_deformed_robot_with_flexible_links_stays_on_the_path(name):
    plan = plan_of(name, "flexible_links")
    assert plan.geometry == "deformed"
    assert run(name, "flexible_links", plan, 5e-5).error(plan).max() < 2e-9


@pytest.mark.parametrize(
    ("name", "flexibility", "scene", "leaves"),
    [
        ("five_bar", "flexible_links", "B", 1e-2),
        pytest.param("five_bar", "flexible_links", "C-printed", 5e-5, marks=pytest.mark.slow),
        pytest.param("five_bar", "rigid", "B", 5e-3, marks=pytest.mark.slow),
        pytest.param("five_bar_heavy", "rigid", "B", 5e-3, marks=pytest.mark.slow),
    ],
)
def test_motors_that_suffice_for_the_right_law_fail_under_a_wrong_one(name, flexibility, scene, leaves):
    right, wrong = plan_of(name, flexibility), wrong_law(name, flexibility, scene)
    limit = SPARE * max(right.peak_torque.values())
    done = run(name, flexibility, wrong, 2e-4, limit=limit)
    before = done.time < CROSSING - 0.15
    assert done.error(wrong)[~before].max() > leaves
    assert done.error(wrong)[before].max() < 0.1 * leaves
    assert run(name, flexibility, right, 2e-4, limit=limit).error(right).max() < 1e-6


def test_the_pole_is_odd_and_forgives_a_rigid_robot_with_boundless_motors():
    """Why a motor limit is part of the test above: 64 N m for half a millisecond do carry it through."""
    wrong = wrong_law("five_bar", "rigid", "B")
    assert np.abs(wrong.torque(np.linspace(0, DURATION, 3001))).max() > 50
    assert run("five_bar", "rigid", wrong, 1e-4).error(wrong).max() < 1e-6
