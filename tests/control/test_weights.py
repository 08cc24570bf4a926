"""The costs and the noise by which lqg is tuned: against least squares over whole motions of small models."""

from types import SimpleNamespace

import numpy as np
import pytest

from framework.control import Spread
from framework.control import draw as draw_robot
from framework.control.deviation import Plant
from framework.control.regulators import (
    Weights,
    plant_with_readings,
    prior_starts,
    regulator_gains,
    tune_filter,
)
from framework.control.sensors import IMU_NOISE, LEAST_NOISE, PLATFORM_NOISE, LoopSensors

K, N_A, N, M = 4, 2, 2, 3  # periods, motors, coordinates of the platform, pairs of states
STATES = 2 * M + 1  # with one disturbance
WEIGHTS = Weights(
    position=2e-3, speed=3e-2, torque=0.4, acceleration=0.05, motor_torque=0.07, correlation=0.03
)
PERIOD, LENGTH, SCALE = 2e-3, 0.8, np.array([0.5, 1.0])


class Plan(SimpleNamespace):
    """What is used of a planned motion."""

    @property
    def peak_torque(self) -> np.ndarray:
        """The largest torques (n_a,)."""
        return np.abs(self.torque).max(axis=0)


def draw(seed: int):
    """A robot of which little is needed, the linear model of its plan, and the plan."""
    rng = np.random.default_rng(seed)
    model = SimpleNamespace(
        m=M,
        A=rng.normal(size=(K, STATES, STATES)),
        B=rng.normal(size=(K, STATES, N_A)),
        F=np.eye(STATES) + 0.3 * rng.normal(size=(K, STATES, STATES)),
        G=1e-2 * rng.normal(size=(K, STATES, N_A)),
    )
    robot = SimpleNamespace(
        n=N,
        platform_scale=SCALE,
        length=LENGTH,
        model=SimpleNamespace(gravity=SimpleNamespace(linear=np.array([0.0, -3.0, 4.0]))),
        coordinates=SimpleNamespace(positions=lambda q: q),
        elastic=np.array([2, 3]),
        actuated=np.array([0, 1]),
        column_scale=np.array([1.0, LENGTH, 1.0, LENGTH, LENGTH]),
    )
    plan = Plan(
        robot=robot,
        period=PERIOD,
        torque=rng.normal(size=(K, N_A)),
        ddx=rng.normal(size=(K, N)),
        motion=SimpleNamespace(q=1e-2 * rng.normal(size=(K, 5))),
    )
    return rng, model, plan


def test_gains_are_the_least_cost_of_the_rest_of_the_motion():
    """Against least squares for all torques to come: deviations and torques over those of equal cost."""
    _, model, plan = draw(1)
    gain = regulator_gains(plan, model, WEIGHTS)
    cost = np.zeros((4, STATES))
    cost[[0, 1], [0, 1]] = 1.0 / (2e-3 * SCALE)
    cost[[2, 3], [M, M + 1]] = 1.0 / (3e-2 * SCALE)
    per_torque = np.diag(1.0 / (0.4 * np.abs(plan.torque).max(axis=0)))
    for first in range(K):
        # z_k (STATES, STATES + torques) of the state at `first` and of the torques from there on
        count = K - first
        z, rows = np.eye(STATES, STATES + count * N_A), []
        for k in range(first, K):
            u = np.eye(N_A, STATES + count * N_A, STATES + (k - first) * N_A)
            rows.append(per_torque @ u)
            z = model.F[k] @ z + model.G[k] @ u
            rows.append(cost @ z)
        rows = np.concatenate(rows)
        torques = -np.linalg.lstsq(rows[:, STATES:], rows[:, :STATES], rcond=None)[0]
        np.testing.assert_allclose(-gain[first], torques[:N_A], rtol=1e-7, atol=1e-9 * np.abs(torques).max())


def test_a_motor_that_is_idle_in_the_plan_stays_so_in_any_unit_of_torques():
    _, model, plan = draw(2)
    plan.torque[:, 1] = 0.0
    gain = regulator_gains(plan, model, WEIGHTS)
    small = SimpleNamespace(**vars(model) | {"G": 1e-3 * model.G})
    plan.torque *= 1e3
    np.testing.assert_allclose(regulator_gains(plan, small, WEIGHTS), 1e3 * gain, rtol=1e-6)
    plan.torque *= 1e-3
    plan.torque = plan.torque[:, :1]
    alone = SimpleNamespace(**vars(model) | {"G": model.G[:, :, :1]})
    np.testing.assert_allclose(gain[:, :1], regulator_gains(plan, alone, WEIGHTS), rtol=1e-6)
    assert np.abs(gain[:, 1]).max() < 1e-6 * np.abs(gain[:, 0]).max()


def sensors_with(**others) -> LoopSensors:
    """Encoders of a motor that turns, of one that slides, and of a joint behind springs."""
    columns = np.array([0, 1, 4])
    return LoopSensors(np.eye(5)[columns], columns, np.array([1e-3, 2e-3, 0.0]), **others)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("seen", [{}, {"platform": True}, {"platform": True, "imu": True}])
def test_the_filter_is_the_conditional_mean_of_its_model(noise, seen):
    """Against projections on all readings so far, of states that are linear in independent unit normals."""
    rng, model, plan = draw(3)
    sensors = sensors_with(**{"platform": False, "imu": False, "state": False} | seen)
    # noise of steps and of readings; of joints behind springs also their deflection
    scale = np.array([1.0, LENGTH, LENGTH])
    deviation = [np.hypot(np.array([1e-3, 2e-3, 0.0]) / 12**0.5, max(noise, LEAST_NOISE) * scale)]
    deflected = np.abs(plan.motion.q[:, [2, 3]] / [1.0, LENGTH]).max()
    trust = [np.array([0.0, 0.0, deflected * LENGTH])]
    if sensors.platform:
        deviation.append(max(noise, PLATFORM_NOISE) * SCALE)
        trust.append(np.zeros(N))
    if sensors.imu:
        deviation.append(np.full(N, IMU_NOISE))
        trust.append(np.full(N, 10 * IMU_NOISE))
    deviation, trust = np.concatenate(deviation), np.concatenate(trust)
    readings = len(deviation)
    plant = Plant(model.F, model.G, rng.normal(size=(K, readings, STATES)), np.zeros((K, readings, N_A)))
    prior = rng.normal(size=(STATES, STATES + 1)) * 1e-2
    observer = tune_filter(plan, model, plant, sensors, Spread(noise=noise), WEIGHTS, prior)
    np.testing.assert_allclose(observer.noise, deviation, rtol=1e-12)

    of_readings = np.hypot(deviation, WEIGHTS.deflection * trust)
    persist = np.sqrt(0.03 * PERIOD)
    largest = 5.0 * SCALE / LENGTH + np.abs(plan.ddx).max(axis=0)  # [m/s^2] gravity, and the plan's
    starts = prior.shape[1]
    count = starts + K * (readings + M)  # of the unit normals: start, readings, accelerations
    z = np.zeros((STATES, count))
    z[:, :starts] = prior
    past = np.zeros((0, count))
    for k in range(K):
        at = starts + k * (readings + M)
        y = plant.C[k] @ z
        y[:, at : at + readings] += np.diag(of_readings)
        new = y - y @ np.linalg.pinv(past) @ past if len(past) else y
        gain = z @ new.T @ np.linalg.inv(new @ new.T)
        np.testing.assert_allclose(observer.gain[k], gain, rtol=1e-6, atol=1e-8 * np.abs(gain).max())
        past = np.concatenate([past, y])
        z = model.F[k] @ z
        peaks = np.abs(plan.torque).max(axis=0)
        by_motors = 0.07 * np.abs(model.B[k, M + N : 2 * M]) @ peaks
        unmodelled = persist * np.concatenate([0.05 * largest, by_motors])
        z[M : 2 * M, at + readings : at + readings + M] += np.diag(unmodelled)


def test_more_noise_is_of_accelerations_and_motors_alone():
    more = WEIGHTS.with_noise(3.0)
    assert (more.acceleration, more.motor_torque) == pytest.approx((0.15, 0.21))
    assert vars(more.with_noise(1 / 3)) == pytest.approx(vars(WEIGHTS))


def test_an_accelerometer_reads_the_mean_acceleration_of_the_last_period():
    rng, model, plan = draw(4)
    model.joints, model.joints_by_torque = np.zeros((K, 5, STATES)), np.zeros((K, 5, N_A))
    sensors = LoopSensors(np.zeros((0, 5)), np.arange(0), np.zeros(0), platform=False, imu=True, state=False)
    plant = plant_with_readings(model, sensors, plan)
    for k in range(K - 1):
        z, torque = rng.normal(size=STATES), rng.normal(size=N_A)
        after = model.F[k] @ z + model.G[k] @ torque
        reading = plant.C[k + 1] @ after + plant.D[k + 1] @ torque
        np.testing.assert_allclose(reading, (after - z)[M : M + N] / PERIOD, rtol=1e-9, atol=1e-9)


def test_starts_have_the_second_moments_of_robots_as_they_are_drawn():
    """Dry friction is never negative: its mean is common to all motors, and no deviation about zero."""
    spread = Spread(payload=0.1, stiffness=0.2, friction=0.05)
    robot = SimpleNamespace(
        n_e=2, n_a=3, platform_scale=SCALE, column_scale=np.ones(4), model=SimpleNamespace(njoints=5)
    )
    names = ("payload", "friction a", "friction b", "friction c", "spring d", "spring e")
    model = SimpleNamespace(columns=np.array([0]), m=N + 1, names=names)
    drawn = [draw_robot(robot, spread, (5, number)) for number in range(4000)]
    theta = np.array([np.concatenate([[one.payload - 1], one.friction, one.stiffness - 1]) for one in drawn])
    size = np.array([0.1, *[0.05] * 3, *[0.2] * 2])  # the largest of each
    starts = prior_starts(SimpleNamespace(robot=robot), model, spread)[2 * model.m :] / size[:, None]
    np.testing.assert_allclose(starts @ starts.T, (theta / size).T @ (theta / size) / len(theta), atol=0.02)
