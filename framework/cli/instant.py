"""The loads of one instant, for `crossing pose`: motor torques and what loops and joints carry."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.cli import arguments
from framework.dynamics.pointwise_dynamics import Instant, dynamics_at
from framework.kinematics.parallel_robot import ParallelRobot


def loads_of_instant(robot: ParallelRobot, q: Array, options: argparse.Namespace) -> Instant | None:
    """Compute the loads of the instant that the options describe; None where they describe none."""
    wrenches = arguments.wrenches(options, robot)
    if options.velocity is None and options.acceleration is None and not wrenches:
        return None
    return dynamics_at(robot, q, dx=options.velocity, ddx=options.acceleration, **wrenches)


def loads_in_words(robot: ParallelRobot, instant: Instant | None) -> list[str]:
    """Return lines on the torques of motors, and on the forces of loops and joints."""
    if instant is None:
        return []
    torques = zip(robot.actuator_names, instant.torque, robot.torque_units, strict=True)
    said = ", ".join(f"{joint} {round(torque, 12) + 0.0:.9g} {unit}" for joint, torque, unit in torques)
    lines = [f"  motor torque      {said} (motor side)"]
    for what, wrenches in (("loop", instant.loop_forces), ("joint", instant.reactions)):
        lines += [f"  {what:<17} {name}: {_wrench_in_words(wrench)}" for name, wrench in wrenches.items()]
    if instant.indeterminate:
        lines.append(f"  indeterminate     {', '.join(instant.indeterminate)}")
    return lines


def _wrench_in_words(wrench: Array) -> str:
    """Return a force and a moment on base axes; `-` for what is indeterminate."""
    numbers = ["-" if np.isnan(value) else f"{round(value, 12) + 0.0:.6g}" for value in wrench]
    return f"force ({', '.join(numbers[:3])}) N, moment ({', '.join(numbers[3:])}) N m"


def loads_document(robot: ParallelRobot, instant: Instant) -> dict[str, Any]:
    """Return the loads of an instant for JSON; null for what is indeterminate."""
    return {
        "torque": dict(zip(robot.actuator_names, map(float, instant.torque), strict=True)),
        "loop_forces": {name: _numbers(wrench) for name, wrench in instant.loop_forces.items()},
        "reactions": {name: _numbers(wrench) for name, wrench in instant.reactions.items()},
        "indeterminate": list(instant.indeterminate),
    }


def _numbers(wrench: Array) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in wrench]
