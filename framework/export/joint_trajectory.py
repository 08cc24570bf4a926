"""A plan as the trajectory that ros2_control's joint_trajectory_controller takes.

The layout is that of trajectory_msgs/JointTrajectory, joints in the order of the robot file's motors, all on
the joint side of the gears: positions and their derivatives are those of the URDF's joints, motor angles over
gear ratio; effort is what a motor sends into its joint, gear ratio times motor torque. The rotor's share is
in it: a simulator without rotor inertia needs less. In a robot with springs a drive's spring is behind its
joint, so that these are angles and torques before it, and the link stands aside by the deflection.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.crossing.result import CrossingPlan
from framework.errors import whole_number

FIELDS = ("positions", "velocities", "accelerations", "effort")
SAMPLES, DEFAULT = (2, 1_000_000), 501
NANOSECONDS = 1_000_000_000
SIDE = "joint side of the gears: position = motor angle / gear ratio, effort = motor torque * gear ratio"
BEFORE_SPRINGS = "; before the springs of drives and links"


def joint_trajectory(plan: CrossingPlan, *, samples: int = DEFAULT) -> dict[str, Any]:
    """The message as plain data, for YAML or JSON: header, joint_names and `samples` equidistant points.

    Positions [rad, m], velocities, accelerations, effort [N m, N]; `time_from_start` {sec, nanosec}.

    Raises:
        InvalidInput: not a whole number of at least 2 samples.
    """
    samples = whole_number("samples", samples, *SAMPLES)
    robot, times = plan.robot, np.linspace(0.0, plan.duration, samples)
    position, velocity, acceleration = (
        plan.motor_angle(times, order) / robot.gear_ratio for order in range(3)
    )
    effort = plan.torque(times) * robot.gear_ratio
    columns = (position, velocity, acceleration, effort)
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(robot.actuator_names),
        "points": [
            {
                **{name: values.tolist() for name, values in zip(FIELDS, rows, strict=True)},
                "time_from_start": _duration(time),
            }
            for time, *rows in zip(times, *columns, strict=True)
        ],
    }


def side_told(plan: CrossingPlan) -> str:
    """Which side of gears and springs the trajectory is on, in a line."""
    return SIDE + (BEFORE_SPRINGS if plan.robot.n_e else "")


def _duration(seconds: float) -> dict[str, int]:
    """builtin_interfaces/Duration."""
    whole, rest = divmod(round(float(seconds) * NANOSECONDS), NANOSECONDS)
    return {"sec": whole, "nanosec": rest}
