"""How far given deflections are from balance along a motion, and what would change that.

At a prescribed platform x(t) with deflections l the robot is in balance if

    r + K l = S' tau + J' lambda        r = forces of the open tree, J = d closures/dq, S the motors' columns

has a solution (tau, lambda). With Y the motions that keep the loops closed while the motors are locked and
x is free,

    F = Y' (r + K l) = 0

are as many equations as springs. Nothing in F divides by the measure of the singularity, so F is as smooth
there as anywhere; only the deflections that solve it are not, unless the law lets them.

Derivatives are those of r + K l - J' lambda with lambda fixed at its best: they make Newton's method on
(l, tau, lambda) at once, from which Y' takes tau and lambda away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, IntArray
from framework.dynamics.forces import tree_forces
from framework.dynamics.tangent_stiffness import moving_columns
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import Motion, joint_rates, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import matvec, solve


class Course(NamedTuple):
    """Path coordinates (T,), a platform's motion (T, n) and deflections (T, n_e), with time derivatives."""

    s: Array
    x: Array
    dx: Array
    ddx: Array
    l: Array  # noqa: E741
    dl: Array
    ddl: Array


class Loaded(NamedTuple):
    """The motion of a course, and what springs and bodies ask of motors and loops."""

    motion: Motion
    load: Array  # (T, nv) r + K l


class LoadedBalance(NamedTuple):
    """What is out of balance along a course."""

    course: Course
    loaded: Loaded
    F: Array  # (T, n_e) along orthonormal Y, in units of the springs
    size: float  # the largest load, in the same
    Y: Array  # (T, f, n_e); f columns move while the motors are locked
    multipliers: Array  # (T, m) of the loop equations
    wrenches: ExternalWrenches
    stiffer: float  # than those of the robot its springs are


def spring_units(robot: ParallelRobot) -> Array:
    """Deflections (n_e,) [rad, m] that store alike; that of the softest spring is 1 or a robot length."""
    scale = robot.column_scale[robot.elastic]
    compliance = 1.0 / (robot.stiffness * scale**2)
    return np.asarray(scale * np.sqrt(compliance / compliance.max(initial=0.0)))


def balance_along(
    robot: ParallelRobot, course: Course, near: Array, *, wrenches: ExternalWrenches, stiffer: float = 1.0
) -> LoadedBalance:
    """Compute what is out of balance along a course, from configurations near it (T, nq).

    Under wrenches of the world, with springs `stiffer` times as stiff.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    loaded = _loaded(robot, course, near, wrenches, stiffer)
    columns, units = _locked(robot)
    J, load = _loops(robot, loaded.motion), loaded.load[:, columns] * units
    m = J.shape[1]
    Q, R = np.linalg.qr(J.swapaxes(1, 2), mode="complete")
    multipliers = solve(R[:, :m], matvec(Q[:, :, :m].swapaxes(1, 2), load))
    Y = Q[:, :, m:]
    return LoadedBalance(
        course,
        loaded,
        matvec(Y.swapaxes(1, 2), load),
        float(np.abs(load).max()),
        Y,
        multipliers,
        wrenches,
        stiffer,
    )


def slopes_along(robot: ParallelRobot, balance: LoadedBalance, directions: Sequence[Course]) -> Array:
    """Compute by how much small steps, d directions, change r + K l - J' lambda: (T, f, d).

    By central differences, which are exact for what is linear or quadratic, as rates and accelerations are.

    Raises:
        NotAssembled: a step tears the loops.
    """
    sides = [
        Course(*(own + sign * step for own, step in zip(balance.course, direction, strict=True)))
        for sign in (1.0, -1.0)
        for direction in directions
    ]
    columns, units = _locked(robot)
    left = []
    for side in sides:
        motion = balance.loaded.motion
        bent = joint_rates(robot, motion.linearised, side.x - balance.course.x, side.l - balance.course.l)
        near = integrate(robot, motion.q, bent)
        loaded = _loaded(robot, side, near, balance.wrenches, balance.stiffer)
        held = matvec(_loops(robot, loaded.motion).swapaxes(1, 2), balance.multipliers)
        left.append(loaded.load[:, columns] * units - held)
    forth, back = np.array(left).reshape(2, len(directions), *left[0].shape)
    return np.asarray(0.5 * np.moveaxis(forth - back, 0, 2))


def _loaded(
    robot: ParallelRobot, course: Course, near: Array, wrenches: ExternalWrenches, stiffer: float
) -> Loaded:
    """Close the loops along a course and compute the loads."""
    step = np.zeros((len(near), robot.model.nv))
    step[:, robot.elastic] = course.l - difference(robot, robot.neutral, near)[:, robot.elastic]
    closed = close_loops(robot, course.x, integrate(robot, near, step))
    motion = motion_at(robot, closed, course.dx, course.ddx, course.dl, course.ddl)
    motion = motion.under(wrenches.at(robot, closed.linearised.frames, course.s))
    load = tree_forces(robot, motion)
    load[:, robot.elastic] += stiffer * robot.stiffness * course.l
    return Loaded(motion, load)


def _locked(robot: ParallelRobot) -> tuple[IntArray, Array]:
    """Columns (f,) that move while the motors are locked, elastic ones first, and their units."""
    columns = moving_columns(robot)
    units = robot.column_scale[columns].copy()
    units[: robot.n_e] = spring_units(robot)
    return columns, units


def _loops(robot: ParallelRobot, motion: Motion) -> Array:
    """Independent loop equations (T, m, f) along those columns, in their units."""
    columns, units = _locked(robot)
    weights = np.where(robot.loops.rotation, 1.0, 1.0 / robot.length) / robot.structure.row_sizes
    return np.asarray(motion.linearised.closures[:, :, columns] * weights[:, None] * units)
