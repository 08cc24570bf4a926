"""What is predicted of each level without a simulation, against the simulations."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import robots
from framework import InvalidInput, NoAnswer, UnboundedTorque, fidelity_study, plan_scene
from framework.dynamics.open_loop import ErrorDynamics, MotorControl, error_dynamics, open_loop_error
from framework.dynamics.platform_wrench import platform_wrench
from framework.dynamics.pointwise_dynamics import motor_inertia
from framework.fidelity import predicted_level
from framework.fidelity.predicted_level import (
    Indicators,
    LevelError,
    LevelMotion,
    compute_indicators,
    predict_errors,
    predict_level,
    scene_level,
)
from framework.model.description import LEVELS
from framework.planning.request import path_length
from framework.planning.scenes import scene_request
from tests.fidelity.test_fidelity_study import PLANNED
from tests.robots.every_robot import in_stages


def quick(case) -> bool:
    return case in [("five_bar", "C"), ("humanoid_ankle", "swing")]


@pytest.mark.parametrize("case", in_stages(PLANNED, at_once=quick))
def test_the_level_that_simulation_found_is_predicted(case):
    name, scene = case
    description = robots.load(name).description
    kept = scene_level(description, scene)
    predicted = predict_level(description, scene, tolerance=kept.tolerance)
    assert (predicted.level, predicted.simulated) == (kept.level, False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [("humanoid_ankle", "swing"), ("n_four_bar", "swing"), ("par4", "cross"), ("two_arms", "turn")]
)
def test_errors_are_predicted_to_a_tenth(case):
    """Of all levels that are within 10 %; what is predicted of one is at least what those above leave out."""
    name, scene = case
    study = fidelity_study(robots.load(name), scene, tolerance=1e-3)
    predicted = predict_errors(study.robot.description, scene).error
    simulated = [max(one.torque, one.platform) for one in study.levels]
    compared = [k for k in range(len(simulated) - 1) if simulated[k] < 0.1]
    for k in compared:
        expected = max(simulated[k:-1])
        assert predicted[study.levels[k].level.name] == pytest.approx(expected, rel=0.1, abs=1e-5)
    assert len(compared) >= 4


def test_a_scene_of_another_duration_is_predicted_and_keeps_nothing():
    description = robots.load("five_bar").description
    unlike = replace(description, scenes={"C": replace(description.scenes["C"], fidelity=None)})
    assert scene_level(unlike, "C") is None
    assert predict_level(unlike, "C", duration=3.0, times=None, speeds=None).level == "payload"
    with pytest.raises(InvalidInput, match="geometry: each level"):
        predict_level(description, "C", geometry="deformed")


@pytest.mark.parametrize("options", [{}, {"smoothness": 5}])
def test_all_levels_follow_a_law_as_smooth_as_springs_need_or_as_asked(monkeypatch, options):
    asked = []

    def refuse(robot, request):
        asked.append(request.smoothness)
        raise NoAnswer("planned nowhere")

    monkeypatch.setattr(predicted_level, "plan_request", refuse)
    elastic = robots.load("five_bar", flexibility="flexible_joints")
    predict_errors(elastic.description, "C", **options)
    assert asked == [scene_request(elastic, "C", **options).smoothness]


def test_a_motion_without_a_rigid_plan_may_need_everything():
    with pytest.raises(UnboundedTorque):
        plan_scene(robots.load("five_bar"), "B")
    assert predict_level(robots.load("five_bar").description, "B").level == LEVELS[-1].name


def test_a_controller_that_is_stiffer_than_weight_makes_the_rod_swing():
    """m d" = (w - k) d, without damping and from d = lacking / (k - w) at rest: a cosine about that."""
    times, weight, mass, gear = np.linspace(0.0, 2.0, 2049), 3.0, 2.0, 5.0
    constant = np.ones((len(times), 1, 1))
    falling = ErrorDynamics(-constant / mass, 0.0 * constant, constant * weight / mass)
    control = MotorControl(k_p=np.array([1.0]), k_d=np.zeros(1))  # 25 N/m at the rod
    swinging = falling.with_control(control, gear * constant)
    off = open_loop_error(swinging, times, np.full((len(times), 1), -0.1))[:, 0]
    stiffness = 25.0 - weight
    expected = 0.1 / stiffness * (1.0 - np.cosh(1j * times * np.sqrt(stiffness / mass)).real)
    np.testing.assert_allclose(off, expected, rtol=1e-4, atol=1e-8)


def test_errors_of_the_platform_are_accelerated_by_the_robot_s_own_mass():
    """A free payload of 10 kg on massless legs: the 5R's platform, whose rotors weigh little."""
    plan = plan_scene(robots.load("five_bar"), "A")
    dynamics = error_dynamics(plan.dynamics, np.linspace(0.0, 1.5, 5))
    np.testing.assert_allclose(np.linalg.eigvalsh(dynamics.per_wrench).min(axis=1), -0.1, rtol=0.1)


def test_an_error_that_is_not_a_number_is_not_none():
    """Of the level and of those below, which leave out what it does."""
    names = [level.name for level in LEVELS]
    errors = {name: LevelError(0.01, 0.02) for name in names[:-1]}
    errors[names[2]] = LevelError(np.nan, 0.0)
    indicators = Indicators.of(errors)
    assert [indicators.error[name] for name in names] == [np.inf] * 3 + [0.02] * (len(names) - 4) + [0.0]
    assert indicators.choose_level(0.1) == names[3]
    assert set(indicators.words) == set(names)
    assert [bool(indicators.words[name]) for name in names] == [
        name not in (names[2], names[-1]) for name in names
    ]
    assert all(share in indicators.words[names[0]] for share in ("torques 1", "platform 2"))


def test_open_loop_errors_are_those_of_an_equation_with_known_solution_to_second_order():
    """d = (t^3, t^4 - t^2): the wrench that d" = B w + C d' + A d asks, with all three matrices changing."""

    def error(count):
        t = np.linspace(0.0, 1.5, count)
        d = np.stack([t**3, t**4 - t**2], axis=1)
        d1 = np.stack([3 * t**2, 4 * t**3 - 2 * t], axis=1)
        d2 = np.stack([6 * t, 12 * t**2 - 2], axis=1)
        wave = np.array([[np.cos(t), np.sin(2 * t)], [t, 1 + t**2]]).transpose(2, 0, 1)
        B, C, A = np.eye(2) + 0.3 * wave, -0.5 * wave, wave.swapaxes(1, 2)
        forcing = d2 - np.matvec(C, d1) - np.matvec(A, d)
        wrench = np.linalg.solve(B, forcing[..., None])[..., 0]
        return np.abs(open_loop_error(ErrorDynamics(B, C, A), t, wrench) - d).max()

    assert error(101) < 2e-3
    assert error(101) / error(201) == pytest.approx(4.0, rel=0.05)


def test_a_level_whose_torques_lead_the_robot_where_it_says_has_no_error_of_the_platform():
    plan = plan_scene(robots.load("five_bar"), "A")
    highest, times = plan.dynamics, np.linspace(0.0, plan.duration, 2049)
    missing = 0.01 * np.sin(3.0 * times)[:, None] * [1.0, -0.5]  # [N m] of the level's torques
    speed = platform_wrench(highest.robot, highest.motion(times)).motor_speed
    wrench = np.einsum("tan,ta->tn", speed, missing)
    displacement = CubicSpline(times, open_loop_error(error_dynamics(highest, times), times, wrench))
    level = SimpleNamespace(
        torques=lambda t: highest.torques(t) - 0.01 * np.sin(3.0 * t)[:, None] * [1.0, -0.5],
        platform=lambda t: highest.platform(t) + displacement(t),
    )
    motions = {one.name: highest for one in LEVELS} | {"payload": level}
    indicators = compute_indicators({k: LevelMotion(v, 0.0) for k, v in motions.items()}, None)
    size = np.abs(displacement(times)).max()
    assert size > 0.3 * path_length(highest.robot, highest.path)
    share = missing.max() / np.abs(highest.torques(times)).max()  # of the torque
    assert indicators.error["payload"] == pytest.approx(share, rel=1e-3)


@pytest.mark.parametrize("fall", [12.0, 24.0])
def test_motors_that_catch_a_falling_robot_are_ten_times_as_quick_as_its_fall(monkeypatch, fall):
    """An error of a motor alone, I a + k_d v + k_p d = 0, decays with both its rates at ten of the fall's."""
    monkeypatch.setattr(predicted_level, "fall_exponent", lambda motion: fall)
    motion = plan_scene(robots.load("five_bar"), "A").dynamics
    found, control = predicted_level.measure_fall(motion)
    assert found == fall
    inertia = motor_inertia(motion.robot, motion.configuration(0.0)[0])
    for moved, k_p, k_d in zip(inertia, control.k_p, control.k_d, strict=True):
        rate = -10.0 * fall / motion.duration
        assert moved * rate**2 + k_d * rate + k_p == pytest.approx(0.0, abs=1e-9 * k_p)
        assert k_d / (2.0 * moved) == pytest.approx(-rate)
