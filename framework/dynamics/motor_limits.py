"""Limits of the motors given beside a robot: one for all of them, or one for each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.arrays import Array
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot

Limit = float | Sequence[float] | Array | None


def limits_of_motors(robot: ParallelRobot, name: str, given: Limit) -> tuple[float, ...] | None:
    """Check limits: one positive number for all motors, or one for each; None if nothing is given.

    Raises:
        InvalidInput: it is neither.
    """
    if given is None:
        return None
    try:
        values: Array = np.atleast_1d(np.array(np.nan if isinstance(given, bool) else given, dtype=float))
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape not in ((1,), (robot.n_a,)) or not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise InvalidInput(
            f"{name}: needs one positive number, or one for each motor "
            f"({', '.join(robot.actuator_names)}), got {given!r}"
        )
    return tuple(values.tolist())
