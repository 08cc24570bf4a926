"""Write a plan as a trajectory for ros2_control's joint_trajectory_controller.

The layout is that of trajectory_msgs/JointTrajectory, with the joints in the order of the robot file's
motors. On the joint side of the gears, positions are motor angles over gear ratio, as in the URDF, and effort
is gear ratio times motor torque. On the motor side, angles and torques are those of the motors. The effort
includes the torque that accelerates the rotor: a simulator without rotor inertia needs less. The spring of a
drive is behind its joint, so angles and torques of an elastic robot are those before the spring, and the
angle of the link differs by the deflection. The header's frame_id, which the controller does not read, says
which side of the gears is meant and whether the values are those before springs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.errors import check_choice, whole_number
from framework.planning.motion_table import sample_times
from framework.planning.result import CrossingPlan

FIELDS = ("positions", "velocities", "accelerations", "effort")
SAMPLE_RANGE, DEFAULT_SAMPLES = (2, 1_000_000), 501
NANOSECONDS = 1_000_000_000  # in a second
SIDES = {
    "joint": "joint side of the gears: position = motor angle / gear ratio, "
    "effort = motor torque * gear ratio",
    "motor": "motor side of the gears: position = motor angle, effort = motor torque",
}


def joint_trajectory(
    plan: CrossingPlan, *, samples: int = DEFAULT_SAMPLES, period: float | None = None, side: str = "joint"
) -> dict[str, Any]:
    """Return the message of a plan as plain data: header, joint_names, points.

    The `samples` points are equidistant in time, or stand a `period` [s] apart, the last at the end. Each
    has positions [rad, m], velocities, accelerations, effort [N m, N], and `time_from_start` {sec, nanosec}.

    Raises:
        InvalidInput: samples is no whole number of at least 2, the period is longer than the plan, or the
            side is neither joint nor motor.
    """
    check_choice("side", side, SIDES)
    samples = whole_number("samples", samples, *SAMPLE_RANGE)
    # positions, velocities, accelerations and effort, each (T, n_a)
    robot = plan.robot
    times = sample_times(plan.duration, samples, period)
    gear = robot.gear_ratio if side == "joint" else np.ones(robot.n_a)
    motion = [plan.motor_angle(times, order) / gear for order in range(3)]
    effort = plan.torque(times) * gear
    rows = np.stack([*motion, effort], axis=1).tolist()  # (T, 4, n_a), each row in the order of FIELDS
    points = []
    for time, row in zip(times.tolist(), rows, strict=True):
        seconds, nanoseconds = divmod(round(time * NANOSECONDS), NANOSECONDS)
        duration = {"sec": seconds, "nanosec": nanoseconds}
        points.append({**dict(zip(FIELDS, row, strict=True)), "time_from_start": duration})
    frame_id = f"{side}_side{'_before_springs' if robot.n_e else ''}"
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id},
        "joint_names": list(robot.actuator_names),
        "points": points,
    }


def describe_side(plan: CrossingPlan, side: str) -> str:
    """Describe which side of gears and springs the trajectory refers to."""
    return SIDES[side] + ("; before the springs of drives and links" if plan.robot.n_e else "")
