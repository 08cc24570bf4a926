"""A plan as the trajectory that ros2_control's joint_trajectory_controller takes.

The layout is that of trajectory_msgs/JointTrajectory, joints in the order of the robot file's motors. On the
joint side of the gears positions and their derivatives are those of the URDF's joints, motor angles over gear
ratio, and effort is what a motor sends into its joint, gear ratio times motor torque; on the motor side they
are the motors'. The rotor's share is in it: a simulator without rotor inertia needs less. In a robot with
springs a drive's spring is behind its joint, so that these are angles and torques before it, and the link
stands aside by the deflection. The header's frame_id, which the controller does not read, says the side, one
of FRAME_IDS; `read_joint_trajectory` reads the YAML or JSON of `crossing export` back.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from framework.arrays import Array
from framework.crossing.result import CrossingPlan
from framework.errors import RobotFileError, check_choice, whole_number
from framework.fields import (
    Table,
    entries,
    integer,
    list_of,
    number,
    one_of,
    read_table,
    record,
    required,
    text,
)
from framework.input import read_text
from framework.model.documents import naming

FIELDS = ("positions", "velocities", "accelerations", "effort")
SAMPLE_RANGE, DEFAULT_SAMPLES = (2, 1_000_000), 501
NANOSECONDS = 1_000_000_000
SIDES = {
    "joint": "joint side of the gears: position = motor angle / gear ratio, "
    "effort = motor torque * gear ratio",
    "motor": "motor side of the gears: position = motor angle, effort = motor torque",
}
# of the header: the side, and whether all is before the springs of drives and links
FRAME_IDS = {
    f"{side}_side{'_before_springs' if before else ''}": (side, before)
    for side in SIDES
    for before in (False, True)
}
BEFORE_SPRINGS = "; before the springs of drives and links"


def joint_trajectory(
    plan: CrossingPlan, *, samples: int = DEFAULT_SAMPLES, side: str = "joint"
) -> dict[str, Any]:
    """Return the message as plain data, for YAML or JSON: header, joint_names, `samples` equidistant points.

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
    frame_id = next(name for name, meaning in FRAME_IDS.items() if meaning == (side, robot.n_e > 0))
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
    """Return a line that says on which side of gears and springs the trajectory is."""
    return SIDES[side] + (BEFORE_SPRINGS if plan.robot.n_e else "")


def _duration(seconds: float) -> dict[str, int]:
    """Return a builtin_interfaces/Duration."""
    seconds_part, rest = divmod(round(float(seconds) * NANOSECONDS), NANOSECONDS)
    return {"sec": seconds_part, "nanosec": rest}


# ------------------------------------------------------------------ read back


class TrajectoryFile(NamedTuple):
    """A trajectory, T points of n joints, and on which side of the gears."""

    side: str  # "joint" or "motor": that of all positions, their derivatives and efforts
    before_springs: bool  # of drives and links: the links stand aside by the deflections
    joint_names: tuple[str, ...]  # (n,)
    times: Array  # (T,) [s]
    positions: Array  # (T, n) [rad, m]
    velocities: Array  # (T, n)
    accelerations: Array  # (T, n)
    effort: Array  # (T, n) [N m, N]


_NUMBERS = required(list_of(number))
_DURATION: Table = {"sec": required(integer), "nanosec": required(integer)}


def _seconds(where: str, given: Any) -> float:
    """Read a builtin_interfaces/Duration, in seconds."""
    duration = read_table(where, given, _DURATION)
    if duration["sec"] < 0 or not 0 <= duration["nanosec"] < NANOSECONDS:
        raise RobotFileError(
            f"{where}: needs sec of at least 0 and nanosec of 0 to {NANOSECONDS - 1}, got {duration}"
        )
    return float(duration["sec"] + duration["nanosec"] / NANOSECONDS)


_HEADER: Table = {
    "stamp": required(record(_DURATION)),
    "frame_id": required(one_of("side", FRAME_IDS)),
}
_POINT: Table = {
    **dict.fromkeys(FIELDS, _NUMBERS),
    "time_from_start": required(_seconds),
}
_MESSAGE: Table = {
    "header": required(record(_HEADER)),
    "joint_names": required(entries(text)),
    "points": required(entries(record(_POINT))),
}


def read_joint_trajectory(file: str | Path) -> TrajectoryFile:
    """Read the trajectory in a YAML or JSON file (which is YAML, too).

    Raises:
        RobotFileError: it cannot be read; or names the key, what was given and what is valid: a key is
            missing or unknown, no side is said, a point has not one number a joint, times do not grow.
    """
    content = read_text(file, f"{file}: cannot read it", error=RobotFileError)
    with naming(file):
        message = read_table("", _parse(content), _MESSAGE)
        names, points = message["joint_names"], message["points"]
        if len(set(names)) < len(names):
            raise RobotFileError(f"joint_names: needs different names, got {', '.join(names)}")
        for i, point in enumerate(points):
            for key in FIELDS:
                if len(point[key]) != len(names):
                    raise RobotFileError(
                        f"points[{i}].{key}: needs {len(names)} numbers, one for each of joint_names "
                        f"({', '.join(names)}), got {len(point[key])}"
                    )
        times = np.array([point["time_from_start"] for point in points])
        if np.any(np.diff(times) <= 0):
            i = int(np.argmax(np.diff(times) <= 0)) + 1
            raise RobotFileError(
                f"points[{i}].time_from_start: must be after {times[i - 1]:.9g} s of the point before, got "
                f"{times[i]:.9g} s"
            )
    side, before_springs = FRAME_IDS[message["header"]["frame_id"]]
    columns = (np.array([point[key] for point in points]) for key in FIELDS)
    return TrajectoryFile(side, before_springs, names, times, *columns)


def _parse(content: str) -> Any:
    """Read a text as JSON if { is its first letter, else as YAML."""
    try:
        if content.lstrip().startswith("{"):
            return json.loads(content)
        return yaml.load(content, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError) as error:
        raise RobotFileError(f"neither YAML nor JSON: {' '.join(str(error).split())}") from None
