"""Functions of version 0.7 that no command uses any more; they go in 0.9, with `moved_modules`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from framework.dynamics.forces import mass_matrices
from framework.dynamics.stiffness import platform_stiffness
from framework.errors import RobotFileError
from framework.files.trajectory_file import FIELDS, SIDES
from framework.kinematics.linearised_loops import linearised_at, scaled_loops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.input import read_text


def equilibrium(robot: ParallelRobot, q: ArrayLike, *, wrench: ArrayLike | None = None) -> Array:
    """Return q (nq,) of `platform_stiffness(robot, q, loaded=True, wrench=wrench)`."""
    return platform_stiffness(robot, q, loaded=True, wrench=wrench).q


def free_motor_frequency(robot: ParallelRobot, q: Array) -> Array:
    """Compute the first natural frequency (T,) [Hz] with free motors at assembled q (T, nq).

    The frequencies solve Z'KZ z = omega^2 Z'MZ z, where Z spans the motions that the loops allow, M includes
    the rotors, and K has the springs that make the robot flexible. Rigid motions, for which omega = 0, are
    left out. A motion without mass, and a robot without springs, have an infinite one.
    """
    from scipy.linalg import eigvals

    loops = scaled_loops(robot, linearised_at(robot, q, None))  # (T, m, nv)
    mass = mass_matrices(robot, q) + np.diag(robot.rotors)
    stiffness = np.zeros(robot.nv)
    stiffness[robot.elastic] = robot.stiffness
    frequency = np.full(len(q), np.inf)
    for k in range(len(q)):
        _, values, rows = np.linalg.svd(loops[k])
        rank = int(np.sum(values > 1e-9 * values[0]))
        Z = robot.column_scale[:, None] * rows[rank:].T  # (nv, d)
        # of K z = omega^2 M z those omega that are neither rounding nor infinite; M may be singular
        squares = eigvals(Z.T @ (stiffness[:, None] * Z), Z.T @ mass[k] @ Z).real
        squares = squares[np.isfinite(squares)]
        vibrations = squares[squares > 1e-9 * squares.max(initial=0.0)]
        if robot.n_e and len(vibrations):
            frequency[k] = np.sqrt(vibrations.min()) / (2.0 * np.pi)
    return frequency


class TrajectoryFile(NamedTuple):
    """A trajectory, T points of n joints, on one side of the gears."""

    side: str  # "joint" or "motor"
    before_springs: bool  # of drives and links
    joint_names: tuple[str, ...]  # (n,)
    times: Array  # (T,) [s]
    positions: Array  # (T, n) [rad, m]
    velocities: Array  # (T, n)
    accelerations: Array  # (T, n)
    effort: Array  # (T, n) [N m, N]


def read_joint_trajectory(file: str | Path) -> TrajectoryFile:
    """Read a trajectory that `crossing export --to ros2_control` wrote.

    Raises:
        RobotFileError: the file cannot be read, or is no such trajectory.
    """
    try:
        message = yaml.safe_load(read_text(file, f"{file}: cannot read it", error=RobotFileError))
        side, _, before = message["header"]["frame_id"].partition("_side")
        since = [point["time_from_start"] for point in message["points"]]
        times = np.array([each["sec"] + each["nanosec"] / 1e9 for each in since])
        columns = [np.array([point[key] for point in message["points"]], dtype=float) for key in FIELDS]
        names = tuple(message["joint_names"])
        whole = all(each.shape == (len(times), len(names)) for each in columns)
        if side not in SIDES or not whole or np.any(np.diff(times) <= 0):
            raise ValueError("needs a side of the gears, growing times and a number of each joint a point")
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RobotFileError(f"{file}: no trajectory of ros2_control: {error}") from None
    return TrajectoryFile(side, bool(before), names, times, *columns)
