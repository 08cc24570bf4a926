"""The linear model about a plan, against the robot's own motion; lqr and lqg on it, and what is predicted."""

import importlib.util
import warnings
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import InvalidInput, plan_scene
from framework.control import (
    ControlLoop,
    Measurement,
    Spread,
    Tuning,
    draw,
    linear_model,
    linearise_plan,
    predict,
    predict_by_sensors,
    prediction,
    reference_of,
    run_closed_loop,
    suggest_sensors,
    tuned_controller,
)
from framework.control.deviation import Observer, Plant, closed_loop_deviation
from framework.control.linear_model import linearise_variants
from framework.control.prediction import LinearModels
from framework.control.sensors import sensors_of
from framework.control.variations import apply_variation
from framework.dynamics.forward_dynamics import forward_derivatives
from framework.kinematics.frames import integrate
from framework.simulation import Stepper
from framework.tolerances import GOOD_EXCESS

WRONG = Spread(payload=0.1, stiffness=0.2, friction=0.05)
LOOP = ControlLoop(delay=1e-3, counts=8192, link_counts=2**18)


@cache
def reference(name, scene, flexibility, period=1e-3):
    return reference_of(plan_scene(robots.load(name, flexibility=flexibility), scene), period=period)


@pytest.mark.parametrize(
    ("name", "scene", "flexibility"),
    [
        ("five_bar", "C", "flexible_links"),  # links without mass: deflections in static balance
        ("five_bar_heavy", "C", "flexible_links"),
        ("two_arms", "lift", "rigid"),  # redundant motors
    ],
)
def test_small_errors_evolve_as_those_of_the_robot(name, scene, flexibility):
    """100 periods from a third of the motion, across no refactored code: the stepper's equations."""
    ref = reference(name, scene, flexibility)
    robot, model = ref.robot, linearise_plan(ref)
    rates = np.gradient(model.joints, ref.period, axis=0)
    rates[:, :, model.m :] += model.joints[:, :, : model.m]
    first = len(ref.times) // 3
    z = np.zeros(2 * model.m)
    z[: robot.n] = 1e-6 * robot.platform_scale * np.linspace(1.0, -0.5, robot.n)
    q = np.stack([ref.motion.q[first], integrate(robot, ref.motion.q[first], model.joints[first] @ z)])
    v = np.stack([ref.motion.v[first], ref.motion.v[first] + rates[first] @ z])
    stepper = Stepper.of(robot)
    for k in range(first, first + 100):
        for _ in range(4):
            q, v = stepper.step(q, v, np.tile(ref.period_torque[k], (2, 1)), ref.period / 4)
        z = model.F[k] @ z
        x, _ = stepper.platform(q, v)
        size = np.abs(z[: robot.n] / robot.platform_scale).max()
        assert np.abs((x[1] - x[0] - z[: robot.n]) / robot.platform_scale).max() < 0.04 * max(size, 1e-6)


def test_links_without_mass_leave_the_states_of_platform_and_motors():
    model = linearise_plan(reference("five_bar", "C", "flexible_links"))
    assert model.A.shape[1:] == (8, 8)
    assert np.isfinite(model.A).all()  # at the crossing, too


@pytest.mark.parametrize("period", [1e-3, pytest.param(4e-3, marks=pytest.mark.slow)])
def test_static_balance_changes_no_vibration_that_samples_tell_apart(period, monkeypatch):
    """The arms of a delta are each fast alone; together they vibrate at 222 Hz."""
    ref = reference("delta", "pick", "flexible_links", period)

    def frequencies():
        model = linearise_plan(ref)
        poles = np.linalg.eigvals(model.A[len(ref.times) // 2, : 2 * model.m, : 2 * model.m])
        return np.sort(poles.imag[poles.imag > 0]) / (2 * np.pi)  # [Hz]

    slow = frequencies()
    monkeypatch.setattr(linear_model, "LEAST_BALANCED_SHARE", np.inf)  # none of these is without mass
    every = frequencies()
    told_apart = every[every < 0.5 / period]
    assert len(told_apart) > 2
    np.testing.assert_allclose(slow[: len(told_apart)], told_apart, rtol=0.014)


def test_a_heavier_payload_moves_the_robot_as_its_column_says():
    """A robot with another payload under the planned torques, for 0.2 s."""
    ref = reference("five_bar", "C", "flexible_links")
    robot, model = ref.robot, linearise_plan(ref, ("payload",))
    one = draw(robot, Spread(payload=0.02), (3, 1))
    first = 300
    z = np.append(np.zeros(2 * model.m), one.payload - 1)
    rates = np.gradient(model.joints, ref.period, axis=0)[first] @ z
    q = np.stack([ref.motion.q[first], integrate(robot, ref.motion.q[first], model.joints[first] @ z)])
    v = np.stack([ref.motion.v[first], ref.motion.v[first] + rates])
    stepper = Stepper.of([robot, apply_variation(robot, one)], like=robot)
    for k in range(first, first + 200):
        for _ in range(4):
            q, v = stepper.step(q, v, np.tile(ref.period_torque[k], (2, 1)), ref.period / 4)
        z = model.F[k] @ z
    x, _ = stepper.platform(q, v)
    np.testing.assert_allclose(x[1] - x[0], z[: robot.n], atol=0.05 * np.abs(z[: robot.n]).max())


def test_stiffer_springs_deflect_less_by_at_most_their_share():
    """At constant platform and motors only the deflections in static balance change at once."""
    ref = reference("five_bar", "C", "flexible_links")
    robot, model = ref.robot, linearise_plan(ref, ("springs",))
    deflections = ref.motion.q[:, robot.elastic]
    for spring in range(robot.n_e):
        change = model.joints[:, robot.elastic, 2 * model.m + spring]  # (K, n_e)
        assert (change[:, spring] * deflections[:, spring] <= 1e-15).all()
        own = np.abs(change[:, spring]) * robot.stiffness[spring]
        assert (own <= 1.01 * np.abs(deflections[:, spring]) * robot.stiffness[spring] + 1e-12).all()


def test_gravity_and_torques_are_disturbances_in_their_units():
    """The accelerations of the robot itself, with gravity along x and with a torque more."""
    ref = reference("five_bar", "C", "rigid")
    robot, model = ref.robot, linearise_plan(ref, ("gravity", "torque"))
    columns = model.A[:, model.m : 2 * model.m, 2 * model.m :]
    k = 400
    other = robot.model.copy()
    other.gravity.linear = other.gravity.linear + np.array([1.0, 0.0, 0.0])
    pulled = replace(robot, model=other)
    q, v, torque = ref.motion.q[k], ref.motion.v[k], ref.torque[k]
    more = np.array([1.0, 0.0]) * np.abs(ref.torque).max(axis=0)
    there = forward_derivatives(robot, q, v, torque).acceleration
    for column, acceleration in (
        (0, forward_derivatives(pulled, q, v, torque).acceleration),
        (3, forward_derivatives(robot, q, v, torque + more).acceleration),
    ):
        np.testing.assert_allclose(columns[k, :, column], acceleration - there, rtol=1e-6)
    np.testing.assert_allclose(columns[:, :, 2], 0.0, atol=1e-9)  # along z, across the plane


@pytest.mark.parametrize("flexibility", ["rigid", pytest.param("flexible_links", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "sensors", "delay", "within"),
    [
        ("lqr", "joints", 2e-3, 1e-5),
        ("lqg", "motors", 2e-3, 1e-5),
        ("feedforward", "joints", 2e-3, 5e-4),  # whose gains do not know the delay
        pytest.param("lqr", "joints", 0.0, 1e-5, marks=pytest.mark.slow),
        pytest.param("lqg", "motors", 0.0, 1e-5, marks=pytest.mark.slow),
    ],
)
def test_the_nominal_robot_follows_its_plan_whatever_the_known_delay(
    name, sensors, delay, within, flexibility
):
    ref = reference("five_bar", "C", flexibility, 2e-3)
    loop = ControlLoop(sensors=sensors, delay=delay)
    controller = tuned_controller(name, ref, loop=loop, spread=WRONG)
    run = run_closed_loop(controller, loop, Spread(), [draw(ref.robot, Spread(), (0, 0))])
    assert run.tracking_error[0] < within  # robot lengths


@pytest.mark.parametrize("delay", [0.0, 1e-2])
def test_on_its_plan_a_controller_asks_for_the_torque_of_the_period_in_which_it_acts(delay):
    ref = reference("five_bar", "C", "rigid", 2e-3)
    controller = tuned_controller("lqg", ref, loop=ControlLoop(delay=delay))
    readings = np.zeros((1, controller.observer.plant.C.shape[1]))
    for k in (0, 100, len(ref.times) - 1):
        on_plan = Measurement(ref.motor_angle[[k]], ref.motor_speed[[k]], None, readings)
        acts = min(k + round(delay / 2e-3), len(ref.times) - 1)
        np.testing.assert_allclose(controller.torque(k, on_plan)[0], ref.period_torque[acts], atol=1e-12)


def test_errors_that_a_controller_does_not_know_are_predicted_as_those_that_its_filter_does_not_estimate():
    ref = reference("five_bar", "C", "rigid", 1e-2)
    wrong, loop = Spread(payload=0.3, friction=0.05), ControlLoop()
    narrow = tuned_controller("lqg", ref, loop=loop, spread=Spread(friction=0.05))
    wide = tuned_controller("lqg", ref, loop=loop, spread=wrong, tuning=Tuning(estimates=("friction",)))
    ours, other = (predict("lqg", each, loop, wrong) for each in (narrow, wide))
    np.testing.assert_allclose([ours.platform, ours.torque], [other.platform, other.torque], rtol=1e-6)


@pytest.mark.slow
def test_wrong_elastic_robots_pass_with_a_delay_and_are_as_far_off_as_predicted():
    """Scene C with wrong payload, springs and friction, 1 ms late, torques of 1.2 times the peak."""
    ref = reference("five_bar", "C", "flexible_links")
    loop = replace(LOOP, limit=tuple(1.2 * np.abs(ref.torque).max(axis=0)))
    controller = tuned_controller("lqg", ref, loop=loop, spread=WRONG)
    run = run_closed_loop(controller, loop, WRONG, [draw(ref.robot, WRONG, (0, k)) for k in range(12)])
    assert run.passed.all()
    instants = np.minimum(5 * np.arange(len(run.x)), len(ref.times) - 1)
    off = (run.x - ref.x[instants][:, None]) / ref.robot.platform_scale
    simulated = np.sqrt((off**2).mean(axis=1)).max()
    predicted = predict("lqg", controller, loop, WRONG).platform
    assert 1 / 1.5 < predicted / simulated < 1.5


@pytest.mark.parametrize(
    ("flexibility", "told_apart"),
    [
        ("rigid", ["motors", "motors elbows", "platform"]),
        ("flexible_joints", ["motors", "motors links", "motors elbows", "motors links elbows", "platform"]),
    ],
)
def test_sets_of_sensors_that_read_the_same_are_predicted_once(flexibility, told_apart):
    """Behind a rigid drive an encoder reads what the motor's own does, in whatever order they are named."""
    robot = robots.load("five_bar", flexibility=flexibility)
    models = SimpleNamespace(tune_lqg=lambda loop: (None, loop.sensors))
    sets = ["motors", "motors links", "motors elbows", "elbows motors", "motors links elbows", "platform"]
    given = {"sets": sets, "models": models}
    assert predict_by_sensors(SimpleNamespace(robot=robot), LOOP, WRONG, **given) == told_apart


@pytest.mark.slow
def test_more_sensors_never_deviate_more_and_the_least_that_pass_are_named():
    ref = reference("delta", "pick", "flexible_joints", 2e-3)
    predictions = {one.sensors: one for one in predict_by_sensors(ref, LOOP, WRONG)}
    motors, elbows = predictions["motors"], predictions["motors elbows"]
    assert elbows.platform < 0.5 * motors.platform
    between = 3 * elbows.platform  # a tolerance whose half only elbows keep
    assert not motors.is_within(between)
    one = [motors, elbows, predictions["motors platform"]]
    assert suggest_sensors(one, between) == elbows
    assert suggest_sensors([motors], between) is None


@pytest.mark.slow
def test_weights_are_chosen_for_springs_at_the_ends_of_their_spread(monkeypatch):
    """Springs wrong by 40 %: the chosen weights hold at more of the ends than those of a narrow spread."""
    ref = reference("five_bar", "C", "flexible_links", 3e-3)
    loop = replace(LOOP, sensors="motors elbows")
    wide = LinearModels.of(ref, replace(WRONG, stiffness=0.4), Tuning())
    narrow = LinearModels.of(ref, replace(WRONG, stiffness=0.01), Tuning()).tune_lqg(loop)[0]
    chosen, expected = wide.tune_lqg(loop)
    assert wide._replace(tuned={}).predict("lqg", chosen, loop) == expected
    assert expected.ends > wide.predict("lqg", narrow, loop).ends
    for factors in ("NOISE_FACTORS", "TORQUE_FACTORS"):
        monkeypatch.setattr(prediction, factors, (1.0,))
    stated = wide._replace(tuned={}).tune_lqg(loop)[1]
    assert expected.excess(loop.tolerance) <= max(stated.excess(loop.tolerance), GOOD_EXCESS)


def test_of_a_double_integrator_the_deviation_is_that_of_its_closed_form():
    """x" = u + theta under u = -4 x - 4 x': x ends at theta / 4, in exact steps of 1 ms."""
    h, count = 1e-3, 8000
    F = np.array([[1.0, h, h**2 / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    G = np.array([[h**2 / 2], [h], [0.0]])
    rows = np.zeros((count, 0, 3)), np.zeros((count, 0, 1))
    plant = Plant(np.tile(F, (count, 1, 1)), np.tile(G, (count, 1, 1)), *rows)
    gain = np.tile([[4.0, 4.0, 0.0]], (count, 1, 1))
    for delay in (0, 3):
        deviation = closed_loop_deviation([plant], np.array([[0.0], [0.0], [0.2]]), gain, delay)
        np.testing.assert_allclose(deviation.z[0, -1, 0], 0.05, rtol=1e-3)
        np.testing.assert_allclose(deviation.torque[0, -1], 0.2, rtol=1e-3)


def test_of_a_filtered_number_the_deviation_is_that_of_its_closed_form():
    """z+ = z + u, y = z + noise of 1, z~ = z^ + (y - z^) / 2, u = -z~ / 2: by its 2 x 2 Lyapunov equation."""
    count = 4000
    one = np.ones((count, 1, 1))
    plant = Plant(one, one, one, 0 * one)
    observer = Observer(plant, 0.5 * one, np.ones(1))
    step = np.array([[0.75, -0.25], [0.25, 0.25]])  # of (z, z^)
    by_noise = np.array([[-0.25], [0.25]])
    variance = np.linalg.solve(np.eye(4) - np.kron(step, step), np.kron(by_noise, by_noise))[0, 0]
    z = closed_loop_deviation([plant], np.zeros((1, 1)), 0.5 * one, 0, observer).z[0, 100:, 0]
    np.testing.assert_allclose((z**2).mean(), variance, rtol=0.05)
    assert z.std() < 0.2 * np.sqrt(variance)  # 32 samples


def test_a_loop_that_diverges_is_infinite_without_a_warning_and_leaves_the_others_alone():
    """Feedback of the wrong sign, a period late: z+ = z + 100 u, u = z as predicted through the delay."""
    one = np.ones((400, 1, 1))
    model, held = Plant(one, 100 * one, one, 0 * one), Plant(one, 0 * one, one, 0 * one)
    observer = Observer(model, one, np.ones(1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        deviation = closed_loop_deviation([model, held], np.ones((1, 1)), -one, 1, observer)
    assert np.isinf(deviation.z[0, -1]).all()
    assert np.isinf(deviation.torque[:, -1]).all()  # also of the robot that torques do not move
    np.testing.assert_allclose(deviation.z[1, :5, 0], 1.0)


def test_a_robot_with_other_springs_is_read_by_its_own_readings():
    """Readings twice as large count as twice the error: the first estimate is z, not half of it."""
    one = np.ones((3, 1, 1))
    model, other = Plant(one, one, one, 0 * one), Plant(one, one, 2 * one, 0 * one)
    observer = Observer(model, 0.5 * one, np.zeros(1))
    z = closed_loop_deviation([model, other], np.ones((1, 1)), one, 0, observer).z[:, :, 0]
    np.testing.assert_allclose(z[0, :2], [1.0, 0.5])
    np.testing.assert_allclose(z[1, :2], [1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("name", ["feedforward", "computed_torque"])
def test_the_integral_of_a_constant_error_grows_with_time(name):
    """At rest at the start, the motors beside the plan: the torque grows by as much every period."""
    ref = reference("five_bar", "C", "rigid", 2e-3)
    resting = replace(
        ref, **{key: np.zeros_like(getattr(ref, key)) + getattr(ref, key)[0] for key in ("motor_angle", "x")}
    )
    off = Measurement(ref.motor_angle[:1] + 0.05, 0 * ref.motor_speed[:1], None)
    torque = {}
    for integral in (0.0, 5.0):
        controller = tuned_controller(name, resting, tuning=Tuning(bandwidth=20.0, integral=integral))
        driver = controller.start(1)
        torque[integral] = np.array([driver.torque(k, off)[0] for k in range(6)])
    added = torque[5.0] - torque[0.0]
    np.testing.assert_allclose(added, np.outer(np.arange(1, 7), added[0]), rtol=0.05)
    assert (added[0] * torque[0.0][0] > 0).all()


def test_sensors_are_read_by_name_and_refused_by_name():
    robot = robots.load("five_bar", flexibility="flexible_joints")
    elbows = [
        robot.coordinates.name_of(c) for c in range(robot.nv) if "elbow" in robot.coordinates.name_of(c)
    ]
    for names in ("motors", "motors links elbows", "platform", "motors imu", "joints"):
        seen = sensors_of(robot, ControlLoop(sensors=names)).see_platform
        assert seen == (names in ("platform", "motors imu", "joints"))
    one = sensors_of(robot, ControlLoop(sensors=f"motors elbows:{elbows[0]}", counts=100))
    assert one.S.shape == (3, robot.nv)
    np.testing.assert_allclose(one.step[:2] * robot.gear_ratio, 2 * np.pi / 100)
    links = sensors_of(robot, ControlLoop(sensors="links"))
    assert (np.abs(links.S).sum(axis=1) == 2).all()  # joint and deflection
    with pytest.raises(InvalidInput, match="passive joint"):
        sensors_of(robot, ControlLoop(sensors="elbows:knee"))
    with pytest.raises(InvalidInput, match="motors"):
        ControlLoop(sensors="motors eyes")


@pytest.mark.slow
def test_the_command_suggests_sensors_and_sweeps_gains(document, crossing, refusal):
    short = ["robustness", "five_bar", "--scene", "C", "--smoothness", "4", "--period", "5e-3", "--runs", "2"]
    told = document(*short, "--sensors", "suggest")
    assert (told["sensors"], told["studies"][0]["controller"]) == ("motors", "lqg")
    assert told["tried"] == [{"sensors": "motors", "passed": 20, "runs": 20}]
    assert {one["sensors"] for one in told["predicted"]} >= {"motors", "motors elbows"}
    alone = [*short[:-1], "0"]
    assert document(*alone)["predicted"] == told["predicted"]
    assert "--runs 0" in refusal(2, *alone, "--out", "here")
    swept = document(*short, "--sweep", "bandwidth=5..40")
    gains = [study["controller"] for study in swept["studies"]]
    assert gains[0] == "feedforward bandwidth=5"
    assert gains[-1] == "feedforward bandwidth=40"
    assert (
        swept["studies"][0]["tracking_error"]["largest"] > swept["studies"][-1]["tracking_error"]["largest"]
    )
    assert "--sweep" in refusal(2, *short, "--sweep", "colour=1..2")
    assert "bandwidth: needs a number" in refusal(2, *short, "--controller", "feedforward bandwidth=x")
    assert "unknown gain of feedforward 'width'" in refusal(2, *short, "--controller", "feedforward width=3")
    # six studies of a regulator without a bandwidth would be equal
    sweep = ("--controller", "lqg", "--sweep", "bandwidth=5..40")
    assert "unknown gain of lqg 'bandwidth'" in refusal(2, *short, *sweep)
    assert "2000 periods of 0.005 s" in refusal(2, *short, "--known-delay", "10")
    assert "no sensors" in refusal(1, *short, "--sensors", "suggest", "--tolerance", "1e-9")


def test_an_exported_controller_runs_alone_as_ours_does(tmp_path, crossing):
    """A program of its own reads the table, and asks for the same torques to rounding."""
    file, delay = tmp_path / "move.csv", 1e-2
    words = ("export", "five_bar", "--scene", "C", "--smoothness", "4", "--to", "controller")
    numbers = ("--period", "5e-3", "--known-delay", str(delay), "--sensors", "motors", "elbows")
    assert crossing(*words, *numbers, "--out", file)[0] == 0
    spec = importlib.util.spec_from_file_location("exported", tmp_path / "move_run.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    alone = program.TableController(file)

    plan = plan_scene(robots.load("five_bar"), "C", smoothness=4)
    ref = reference_of(plan, period=5e-3)
    loop = ControlLoop(sensors="motors elbows", delay=delay, counts=8192, link_counts=2**18)
    ours = tuned_controller("lqg", ref, loop=loop, spread=Spread(payload=0.1, friction=0.05)).start(1)
    random = np.random.default_rng(2)
    S = ours.regulator.sensors.S
    for k in range(40):
        off = 1e-3 * random.standard_normal(len(S))
        measured = Measurement(ref.motor_angle[[k]], ref.motor_speed[[k]], None, off[None])
        expected = ours.torque(k, measured)[0]
        np.testing.assert_allclose(alone.update(S @ ref.motion.q[k] + off), expected, rtol=1e-6, atol=1e-9)
    # on the plan the torques are planned ones, also after its end
    alone = program.TableController(file)
    planned = np.concatenate([ref.motion.q, ref.motion.q[[-1] * 4]]) @ S.T
    sent = np.array([alone.update(readings) for readings in planned])
    np.testing.assert_allclose(sent[-5:], np.tile(ref.torque[-1], (5, 1)), atol=1e-6 * np.abs(sent).max())


def test_varied_springs_deviate_as_much_as_those_that_are_drawn(monkeypatch):
    """Drawn stiffnesses are uniform within +- 20 %: their deviation is 20 % / sqrt(3)."""
    ref = reference("five_bar", "C", "flexible_links")
    monkeypatch.setattr(prediction, "linearise_variants", lambda reference, kinds, stiffnesses: stiffnesses)
    models = prediction.LinearModels.of(ref, Spread(stiffness=0.2), Tuning())
    varied = np.array(models.within) / ref.robot.stiffness  # (3, n_e)
    ends = np.array(models.ends) / ref.robot.stiffness
    np.testing.assert_allclose(np.sort(np.unique(ends.round(12))), [0.8, 1.2])
    np.testing.assert_allclose(varied.mean(axis=0), 1.0, rtol=1e-15)
    np.testing.assert_allclose(varied[1:].std(axis=0), 0.2 / np.sqrt(3.0), rtol=1e-12)


@pytest.mark.slow
def test_robots_that_differ_in_springs_alone_have_the_models_of_their_own_linearisations():
    ref = reference("five_bar", "C", "flexible_links")
    softer = replace(ref.robot, stiffness=ref.robot.stiffness * np.array([0.8, 1.2, 0.9, 1.1]))
    model, varied = linearise_variants(ref, ("springs",), [ref.robot.stiffness, softer.stiffness])
    own = linearise_plan(replace(ref, robot=softer), ("springs",), like=model)
    for key in ("A", "B", "F", "G", "joints", "joints_by_torque"):
        expected = getattr(own, key)
        np.testing.assert_allclose(getattr(varied, key), expected, atol=1e-9 * np.abs(expected).max())
