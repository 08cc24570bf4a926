"""A joint trajectory read back from the YAML or JSON that `crossing export --to ros2_control` writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from framework.arrays import Array
from framework.errors import RobotFileError
from framework.export.joint_trajectory import FIELDS, FRAME_IDS, NANOSECONDS
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
    try:
        if content.lstrip().startswith("{"):
            return json.loads(content)
        return yaml.load(content, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError) as error:
        raise RobotFileError(f"neither YAML nor JSON: {' '.join(str(error).split())}") from None
