"""The torque of dry friction that no model has: that of joints without a motor.

Its torque on the motors has no bound near Type 2, where condition (8) is met without it; its work has.
"""

from __future__ import annotations

import numpy as np

from framework.crossing.result import CrossingPlan

SAMPLES = 1001  # instants of the motion


def neglected_work(plan: CrossingPlan) -> float:
    """Compute the work of dry friction that a plan leaves out over that of its motors, each taken positive.

    Zero without such friction; infinite where the motors do no work.
    """
    robot, times = plan.robot, np.linspace(0.0, plan.duration, SAMPLES)
    friction = robot.joint_friction.copy()
    if plan.request.friction == "driven":
        friction[robot.actuated] = 0.0
    if not friction.any():
        return 0.0
    taken = np.abs(plan.dynamics.velocity(times)) @ friction
    given = np.abs(plan.torque(times) * plan.motor_angle(times, 1)).sum(axis=1)
    total = float(np.trapezoid(given, times))
    return float(np.trapezoid(taken, times)) / total if total else np.inf
