"""Simulated sensors: motor angles, torques and platform of a simulated motion, with noise and steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from framework.errors import InvalidInput, check_choice
from framework.identification.recording import Recording, recording_columns
from framework.numerics.arrays import Array
from framework.numerics.fields import not_negative, positive
from framework.simulation.result import Simulation

MAX_SAMPLES = 10_000_000


@dataclass(frozen=True)
class Sensors:
    """Noise (standard deviations) and resolution (steps) of sensors, on the motor side; 0 for none.

    By default encoders have 16 bits per motor turn, or steps of a micrometre. Torques are known from motor
    currents to 1 % of each motor's largest torque. A tracker measures the platform to 20 micrometres.
    """

    rate: float = 1000.0  # [Hz]
    angle_noise: float = 0.0  # [rad or m]
    angle_step: float = 2.0 * np.pi / 2**16  # [rad]
    slide_step: float = 1e-6  # [m] of slides without a gear
    torque_noise: float = 0.01  # share of the motor's largest torque
    torque_step: float = 0.0  # share of the motor's largest torque
    platform_noise: float = 2e-5  # [m]; for turns this is divided by the robot's length [rad]
    seed: int = 0

    def __post_init__(self) -> None:
        """Check that the rate is positive and all other values are not negative."""
        for name, value in vars(self).items():
            check = positive if name == "rate" else not_negative
            check(f"sensors: {name}", value)


def record_sensors(
    simulation: Simulation, torque: Callable[[Array], Array], sensors: Sensors | None = None
) -> Recording:
    """Sample a simulated motion with the errors of sensors.

    The columns are time, motor angles, motor torques and platform.

    Args:
        torque: returns motor torques (T, n_a) [N m, N], motor side, at instants t (T,) [s]; for example
            `plan.torque`.
        sensors: errors of the sensors; by default those of `Sensors()`.

    Raises:
        InvalidInput: more than ten million samples.
    """
    sensors = sensors or Sensors()
    robot = simulation.robot
    random = np.random.default_rng(sensors.seed)
    periods = simulation.duration * sensors.rate
    count = int(periods * (1.0 + 1e-12)) + 1  # with a sample at the end, despite rounding
    if count > MAX_SAMPLES:
        raise InvalidInput(f"sensors: rate {sensors.rate:g} Hz makes {count} samples, at most {MAX_SAMPLES}")
    times = np.arange(count) / sensors.rate
    times[-1] = min(times[-1], simulation.duration)
    angles = robot.gear_ratio * robot.actuated_coordinates(simulation.configuration(times))
    torques = np.asarray(torque(times))
    is_slide = np.array(robot.torque_units) == "N"  # without a gear
    steps = np.where(is_slide, sensors.slide_step, sensors.angle_step)
    largest = np.abs(torques).max(axis=0)
    platform_noise = sensors.platform_noise * robot.platform_scale / robot.length
    columns = [
        times[:, None],
        _add_sensor_errors(random, angles, sensors.angle_noise, steps),
        _add_sensor_errors(random, torques, sensors.torque_noise * largest, sensors.torque_step * largest),
        _add_sensor_errors(random, simulation.platform(times), platform_noise, 0.0),
    ]
    values = np.concatenate(columns, axis=1)
    return Recording(f"sensors of {robot.name}", recording_columns(robot)[: values.shape[1]], values)


def _add_sensor_errors(
    random: np.random.Generator, values: Array, noise: Array | float, step: Array | float
) -> Array:
    """Add noise of this standard deviation to values (T, k); round to multiples of `step`.

    Columns with a step of 0 are not rounded.
    """
    noisy = values + noise * random.standard_normal(values.shape)
    has_step = np.asarray(step) > 0
    divisor = np.where(has_step, step, 1.0)  # against 0 / 0
    return np.where(has_step, np.round(noisy / divisor) * step, noisy)


def make_sensors(properties: dict[str, float]) -> Sensors:
    """Return sensors with properties by name, and defaults for the others.

    Raises:
        InvalidInput: an unknown name, or a value out of range.
    """
    known = {field.name for field in fields(Sensors)}
    for name in properties:
        check_choice("property of --sensors", name, known)
    values: dict[str, Any] = {**properties, "seed": int(properties.get("seed", 0))}
    return Sensors(**values)
