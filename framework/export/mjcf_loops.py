"""A robot's loops as points that coincide, MuJoCo's `connect`: one, two on a hinge's axis, three of a weld.

Any other closure is written as the first of these that locks its axes and more, if the robot cannot move
along the axes that are added: they are closed at random configurations beside the reference, springs
deflected, and as the loop equations are analytic, then everywhere on that branch. Rods of a parallelogram
that lock two axes for the sake of few equations are points that coincide in this way.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from framework.arrays import Array
from framework.errors import InvalidInput
from framework.kinematics.assembly import nearby_configurations
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import Closure, locked_axes
from framework.model.loop_rows import loop_rows

POINT, WELD = locked_axes("spherical"), locked_axes("fixed")
HINGES = {locked_axes("revolute", axis): k for k, axis in enumerate("xyz")}  # and the axis that is free
# Axes on which there are more points than the origin. MuJoCo's own weld weighs its couples with the inertia
# of a body about its centre, which makes it soft where that is next to nothing (a rod about its own axis).
OFF_ORIGIN = {POINT: (), **{axes: (k,) for axes, k in HINGES.items()}, WELD: (0, 1)}
TRIED_DEFLECTION = 1e-3  # [rad, robot lengths] by which springs are, where the loops are looked at
# [rad, robot lengths]: the square of TRIED_DEFLECTION, by which a free axis opens, is above it
CLOSED_GAP = 1e-10


def equality_axes(robot: ParallelRobot) -> dict[str, tuple[str, ...]]:
    """Return the axes that the equalities of each closure lock; a value is one of OFF_ORIGIN.

    Raises:
        InvalidInput: a closure that none of them says; names it, and the axes along which the robot moves.
    """
    closures, poses = robot.description.closures, None
    locked = {}
    for closure in closures:
        if closure.axes in OFF_ORIGIN:
            locked[closure.name] = closure.axes
            continue
        poses = _configurations_beside(robot) if poses is None else poses
        locked[closure.name] = _more_locked(robot, closure, poses)
    return locked


def _more_locked(robot: ParallelRobot, closure: Closure, poses: Array) -> tuple[str, ...]:
    """Return the first kind that locks a closure's axes, and other axes, closed at configurations (K, nq)."""
    lacking = dict[tuple[str, ...], float]()
    placements, names = frames_at(robot, poses), frame_names(robot)
    for axes in OFF_ORIGIN:
        if not set(closure.axes) <= set(axes):
            continue
        rows = loop_rows([replace(closure, axes=axes)], names)
        lengths = np.where(rows.rotation, 1.0, robot.length)
        gap = float((np.abs(loop_equations(rows, placements).residual) / lengths).max(initial=0.0))
        if gap <= CLOSED_GAP:
            return axes
        lacking[axes] = gap
    least = min(lacking, key=lacking.__getitem__, default=())
    added = ", ".join(axis for axis in least if axis not in closure.axes)
    raise InvalidInput(
        f"{robot.name}: MuJoCo has no equality for closure {closure.name!r}, which locks "
        f"{', '.join(closure.axes)} (valid: kinds spherical, revolute and fixed"
        f"{f'; the robot has to move along {added}' if added else ''})"
    )


def _configurations_beside(robot: ParallelRobot) -> Array:
    """Return assembled configurations (K, nq) at and beside the reference, springs at rest and deflected."""
    rest = robot.reference.q
    share = np.random.default_rng(0).uniform(-1, 1, robot.n_e)
    deflections = TRIED_DEFLECTION * robot.column_scale[robot.elastic] * share
    starts = [rest, integrate_columns(robot, rest, robot.elastic, deflections)] if robot.n_e else [rest]
    return np.array([rest, *(q for start in starts for q in nearby_configurations(robot, start))])


def frame_names(robot: ParallelRobot) -> list[str]:
    """Return names of `robot.frames`, in their order."""
    closures = robot.description.closures
    ends = (name for closure in closures for name in closure.frames)
    return list(dict.fromkeys([robot.description.platform.frame, *ends]))
