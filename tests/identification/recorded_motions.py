"""Recorded motions of robots that differ from their files: sums of sines, torques by `dynamics_at`."""

import numpy as np

from framework import CrossingPlan, ParallelRobot, assemble, dynamics_at
from framework.identification import Recording
from framework.kinematics.inverse_kinematics import close_loops

ENCODER_STEP = 2 * np.pi / 2**16
HARMONICS = (1, 3, 5, 7, 9)


def platform_sines(
    robot: ParallelRobot, *, duration: float, rate: float, size: float, seed: int, harmonics=HARMONICS
):
    """Times (T,) and x, dx, ddx (T, n) of the platform; `size` in lengths of the robot."""
    random = np.random.default_rng(seed)
    t = np.arange(int(duration * rate) + 1) / rate
    w = 2 * np.pi / duration * np.array(harmonics)[:, None, None]
    phase = random.uniform(0, 2 * np.pi, (len(w), 1, robot.n))
    amplitude = random.standard_normal((len(w), 1, robot.n))
    amplitude *= size * robot.platform_scale / np.sqrt((amplitude**2).sum(axis=0))
    angle = w * t[:, None] + phase
    x = robot.reference.x + (amplitude * np.sin(angle)).sum(axis=0)
    dx = (amplitude * w * np.cos(angle)).sum(axis=0)
    return t, x, dx, -(amplitude * w**2 * np.sin(angle)).sum(axis=0)


def exact_motors(robot: ParallelRobot, x, dx, ddx) -> tuple[np.ndarray, np.ndarray]:
    """Angles and torques (T, n_a) of the motors along a motion of the platform, dry friction included."""
    q = np.repeat(assemble(robot, x[0]).q[None], len(x), axis=0)
    for k in range(1, len(x)):
        q[k] = close_loops(robot, x[k : k + 1], q[k - 1 : k]).q[0]
    instant = dynamics_at(robot, q, dx=dx, ddx=ddx)
    speed = instant.v[:, robot.actuated]
    sign = np.where(np.abs(speed) < 1e-12, 0.0, np.sign(speed))
    dry = robot.joint_friction[robot.actuated] * sign / robot.gear_ratio
    return robot.gear_ratio * robot.actuated_coordinates(q), instant.torque + dry


def sines(robot: ParallelRobot, *, duration: float, rate: float, size: float, seed: int) -> Recording:
    """The exact motion of a robot."""
    t, *motion = platform_sines(robot, duration=duration, rate=rate, size=size, seed=seed)
    names = (*motor_columns(robot), *(f"platform_{axis}" for axis in robot.axis_names))
    return Recording("sines", names, np.column_stack([t, *exact_motors(robot, *motion), motion[0]]))


def motor_columns(robot: ParallelRobot) -> tuple[str, ...]:
    """Names of the columns of time, of motor angles and of torques."""
    return "time", *(f"{what}_{j}" for what in ("motor_angle", "torque") for j in robot.actuator_names)


def planned_motors(plan: CrossingPlan, samples: int) -> np.ndarray:
    """Time, angles and torques of the motors (samples, 1 + 2 n_a) along a plan."""
    t = np.linspace(0.0, plan.duration, samples)
    return np.column_stack([t, plan.motor_angle(t), plan.torque(t)])


def measured(exact: Recording, robot: ParallelRobot, seed: int, *, torque: float = 0.01) -> Recording:
    """The same as encoders of 16 bits and motor currents show it; `torque` as a share of the largest."""
    random, values, n = np.random.default_rng(seed), exact.values.copy(), robot.n_a
    angles, torques = slice(1, 1 + n), slice(1 + n, 1 + 2 * n)
    values[:, angles] = np.round(values[:, angles] / ENCODER_STEP) * ENCODER_STEP
    size = torque * np.abs(values[:, torques]).max(axis=0)
    values[:, torques] += size * random.standard_normal(values[:, torques].shape)
    return Recording(exact.source, exact.names, values)
