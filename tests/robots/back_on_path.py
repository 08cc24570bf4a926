"""How far the planned torques, integrated forward, leave a robot from its path."""

from __future__ import annotations

import numpy as np

from framework import CrossingPlan, ParallelRobot
from framework.kinematics.frames import frames_at
from framework.kinematics.platform import platform_coordinates
from tests.oracles.forward_simulation import simulate_robot
from tests.oracles.massless_simulation import massless_directions, simulate_massless

BACK = 1e-8  # [m, rad]


def misses(robot: ParallelRobot, plan: CrossingPlan, *, rtol: float) -> np.ndarray:
    """Distance from the path (T, n) [m, rad] of the robot under the planned torques, from rest."""
    torque, edges = plan.torque, plan.dynamics.torques.edges
    times = np.union1d(np.linspace(0.0, plan.duration, 6), edges)  # forces have kinks where panels meet
    q0 = plan.dynamics.configuration(np.zeros(1))[0]
    options = {"q0": q0, "times": times, "rtol": rtol, "atol": 0.01 * rtol}
    if massless_directions(robot, q0).shape[1]:
        q = simulate_massless(robot, torque, **options)
    else:
        q, _ = simulate_robot(robot, torque, **options)
    off = platform_coordinates(robot, frames_at(robot, q)) - plan.platform(times)
    turning = ~robot.translations
    off[:, turning] = (off[:, turning] + np.pi) % (2 * np.pi) - np.pi
    return off
