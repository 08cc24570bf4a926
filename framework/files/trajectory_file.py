"""A plan as the trajectory that ros2_control's joint_trajectory_controller takes.

The layout is that of trajectory_msgs/JointTrajectory, joints in the order of the robot file's motors. On the
joint side of the gears positions and their derivatives are those of the URDF's joints, motor angles over gear
ratio, and effort is what a motor sends into its joint, gear ratio times motor torque; on the motor side they
are the motors'. The rotor's share is in it: a simulator without rotor inertia needs less. In a robot with
springs a drive's spring is behind its joint, so that these are angles and torques before it, and the link
stands aside by the deflection. The header's frame_id, which the controller does not read, says the side, and
whether all is before the springs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.errors import check_choice, whole_number
from framework.planning.result import CrossingPlan

FIELDS = ("positions", "velocities", "accelerations", "effort")
SAMPLE_RANGE, DEFAULT_SAMPLES = (2, 1_000_000), 501
NANOSECONDS = 1_000_000_000
SIDES = {
    "joint": "joint side of the gears: position = motor angle / gear ratio, "
    "effort = motor torque * gear ratio",
    "motor": "motor side of the gears: position = motor angle, effort = motor torque",
}


def joint_trajectory(
    plan: CrossingPlan, *, samples: int = DEFAULT_SAMPLES, side: str = "joint"
) -> dict[str, Any]:
    """Return the message of a plan as plain data: header, joint_names, points.

    `samples` equidistant points, for YAML or JSON.

    Positions [rad, m], velocities, accelerations, effort [N m, N]; `time_from_start` {sec, nanosec}.

    Raises:
        InvalidInput: not a whole number of at least 2 samples, or another side than joint and motor.
    """
    check_choice("side", side, SIDES)
    samples = whole_number("samples", samples, *SAMPLE_RANGE)
    robot, times = plan.robot, np.linspace(0.0, plan.duration, samples)
    gear = robot.gear_ratio if side == "joint" else np.ones(robot.n_a)
    positions = [plan.motor_angle(times, order) / gear for order in range(3)]
    columns = (*positions, plan.torque(times) * gear)
    frame_id = f"{side}_side{'_before_springs' if robot.n_e else ''}"
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id},
        "joint_names": list(robot.actuator_names),
        "points": [
            {
                **{name: values.tolist() for name, values in zip(FIELDS, rows, strict=True)},
                "time_from_start": _duration(time),
            }
            for time, *rows in zip(times, *columns, strict=True)
        ],
    }


def describe_side(plan: CrossingPlan, side: str = "joint") -> str:
    """Describe on which side of gears and springs the trajectory is."""
    return SIDES[side] + ("; before the springs of drives and links" if plan.robot.n_e else "")


def _duration(seconds: float) -> dict[str, int]:
    """Return a builtin_interfaces/Duration."""
    seconds_part, rest = divmod(round(float(seconds) * NANOSECONDS), NANOSECONDS)
    return {"sec": seconds_part, "nanosec": rest}
