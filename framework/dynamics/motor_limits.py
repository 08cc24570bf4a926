"""Limits of the motors' torques and speeds, from the robot file or stated for a plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from framework.errors import InvalidInput, choose_from, real_numbers, short
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, has_entries, read_only

# One limit for all motors; a limit for each motor, None or infinite if unlimited; or limits by joint.
Limit = float | Sequence[float | None] | Mapping[str, float | None] | Array | None


def motor_limits(robot: ParallelRobot, name: str, stated: Limit) -> Array:
    """Return the limits (n_a,) of all motors, motor side, infinite for unlimited motors.

    Args:
        name: `torque_limit` or `rms_torque_limit` [N m, or N for sliding motors]; `speed_limit`,
            `corner_speed` or `no_load_speed` [rad/s, m/s]. A corner speed may be zero.
        stated: one positive number for all motors; or one for each in the order of `robot.actuator_names`; or
            numbers by joint, where joints left out have the limits of the robot file; or None for the limits
            of the robot file. A motor whose entry is None or infinite has no limit.

    Raises:
        InvalidInput: a wrong number of limits, a joint without a motor, or a limit that is not positive.
    """
    if stated is None:
        return _limits_in_file(robot, name)
    if isinstance(stated, Mapping):
        in_file = {motor.joint: getattr(motor, name) for motor in robot.description.actuators}
        for joint in stated:
            if joint not in in_file:
                raise InvalidInput(choose_from("motor", joint, in_file)).naming(name)
        values = list({**in_file, **stated}.values())
    else:
        values = list(stated) if has_entries(stated) else [stated]  # type: ignore[arg-type]
    try:
        numbers = real_numbers(name, [np.inf if limit is None else limit for limit in values])
    except InvalidInput:
        numbers = np.empty(0)  # refused by its shape
    has_bool = any(isinstance(value, bool) for value in values)
    may_vanish = name == "corner_speed"
    is_valid = numbers >= 0 if may_vanish else numbers > 0
    if has_bool or numbers.shape not in ((1,), (robot.n_a,)) or not np.all(is_valid):
        needed = "number of at least 0" if may_vanish else "positive number"
        motors = ", ".join(robot.actuator_names)
        raise InvalidInput(
            f"needs one {needed}, or one for each motor ({motors}), None where there is no limit, or "
            f"some by joint, got {short(stated)}"
        ).naming(name)
    return np.broadcast_to(numbers, robot.n_a).copy()


@lru_cache(maxsize=16)
def _limits_in_file(robot: ParallelRobot, name: str) -> Array:
    """Return the limits (n_a,) of the robot file, as `motor_limits`."""
    return read_only(motor_limits(robot, name, {}))


def is_limited(stated: Limit) -> bool:
    """Return whether stated limits, in any form of `Limit`, bound a motor; None and infinity do not."""
    if stated is None:
        return False
    values = stated.values() if isinstance(stated, Mapping) else np.atleast_1d(np.array(stated, object))
    return any(value is not None and value != np.inf for value in values)


def shortest_form(limits: Array) -> tuple[float | None, ...]:
    """Return limits (n_a,) as a tuple, with None for infinity.

    The tuple has a single entry if all limits are equal.
    """
    values = tuple(limit if np.isfinite(limit) else None for limit in limits.tolist())
    return values[:1] if len(set(values)) == 1 else values
