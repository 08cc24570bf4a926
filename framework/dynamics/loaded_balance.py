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

from typing import NamedTuple

import numpy as np

from framework.dynamics.force_changes import force_changes, force_slopes
from framework.dynamics.forces import Forces, tree_forces
from framework.dynamics.tangent_stiffness import factor_transposed, moving_columns
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack
from framework.kinematics.motion_changes import MotionSteps, motion_changes
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.ordered_sums import matvec, solve


class Course(NamedTuple):
    """Path coordinates (T,), a platform's motion (T, n) and deflections (T, n_e), with time derivatives."""

    s: Array
    x: Array
    dx: Array
    ddx: Array
    l: Array  # noqa: E741
    dl: Array
    ddl: Array


class LoadedBalance(NamedTuple):
    """What is out of balance along a course."""

    course: Course
    motion: Motion
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
    return scale * np.sqrt(compliance / compliance.max(initial=0.0))


def balance_along(
    robot: ParallelRobot, course: Course, near: Array, *, wrenches: ExternalWrenches, stiffer: float = 1.0
) -> LoadedBalance:
    """Compute what is out of balance along a course, from configurations near it (T, nq).

    Under wrenches of the world, with springs `stiffer` times as stiff.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    lacking = course.l - difference(robot, robot.neutral, near)[:, robot.elastic]
    closed = close_loops(robot, course.x, integrate_columns(robot, near, robot.elastic, lacking))
    motion, load = _motion_and_load(robot, course, closed, wrenches, stiffer)
    load, multipliers, Y = _balanced(robot, motion, load)
    F = matvec(Y.swapaxes(1, 2), load)
    return LoadedBalance(course, motion, F, float(np.abs(load).max()), Y, multipliers, wrenches, stiffer)


def forces_in_balance(robot: ParallelRobot, motion: Motion, deflections: Array) -> tuple[Forces, float]:
    """Compute the forces of a motion with deflections (T, n_e), and what is out of balance.

    Motors and loops give what leaves least of the load in the least squares: nothing, if deflections are
    right. Springs hold part of what no motor can, so this is regular at Type 2. What is out of balance is
    counted over the largest force of a spring.
    """
    r = tree_forces(robot, motion)
    load = r.copy()
    load[:, robot.elastic] += robot.stiffness * deflections
    units = _locked(robot)[1]
    scaled, multipliers, Y = _balanced(robot, motion, load)
    lacking = matvec(Y, matvec(Y.swapaxes(1, 2), scaled))
    held = matvec(motion.linearised.closures.swapaxes(1, 2), multipliers * _row_weights(robot))
    spring_force = lacking[:, : robot.n_e] / units[: robot.n_e] - robot.stiffness * deflections
    largest = float(np.abs(spring_force * units[: robot.n_e]).max())
    change = float(np.abs(lacking).max()) / largest if largest > 0.0 else 0.0
    return Forces((r - held)[:, robot.actuated], spring_force), change


def deflection_slopes(robot: ParallelRobot, balance: LoadedBalance, orders: int) -> Array:
    """Compute derivatives of r + K l - J' lambda along deflections in spring units (T, f, orders n_e).

    `orders` is 1, or 3 with rates and accelerations of the deflections.
    """
    (columns, units), motion, n_e = _locked(robot), balance.motion, robot.n_e
    still = np.zeros((len(motion.q), orders * n_e, robot.n))
    joints = np.zeros((3, *still.shape[:2], n_e))
    for order in range(orders):
        joints[order, :, order * n_e : (order + 1) * n_e] = np.diag(units[:n_e])
    changes = motion_changes(robot, motion, MotionSteps((still,) * 3, robot.elastic, (*joints,)))
    multipliers = balance.multipliers * _row_weights(robot)
    forces = force_changes(robot, motion, force_slopes(robot, motion), multipliers, changes)
    slopes = (forces[..., columns] * units).swapaxes(1, 2)
    slopes[:, range(n_e), range(n_e)] += balance.stiffer * robot.stiffness * units[:n_e] ** 2
    return slopes


def load_at_rates(robot: ParallelRobot, balance: LoadedBalance, course: Course) -> Array:
    """Compute the load (T, f) of a course at the same configurations, with other rates."""
    (columns, units), motion = _locked(robot), balance.motion
    closed = ClosedStack(motion.q, course.x, motion.linearised)
    load = _motion_and_load(robot, course, closed, balance.wrenches, balance.stiffer)[1]
    return load[:, columns] * units


def _motion_and_load(
    robot: ParallelRobot, course: Course, closed: ClosedStack, wrenches: ExternalWrenches, stiffer: float
) -> tuple[Motion, Array]:
    """Compute the motion along a course whose loops are closed, and the load r + K l (T, nv)."""
    rates = (course.dl, course.ddl) if robot.elastic_inertia else ()
    motion = motion_at(robot, closed, course.dx, course.ddx, *rates)
    motion = motion.with_wrenches(wrenches.evaluate(robot, closed.linearised.frames, course.s))
    load = tree_forces(robot, motion)
    load[:, robot.elastic] += stiffer * robot.stiffness * course.l
    return motion, load


def _balanced(robot: ParallelRobot, motion: Motion, load: Array) -> tuple[Array, Array, Array]:
    """The load (T, f) along what moves while the motors are locked, the loops' multipliers, and Y."""
    columns, units = _locked(robot)
    range_, R, null = factor_transposed(_loops(robot, motion))
    load = load[:, columns] * units
    return load, solve(R, matvec(range_.swapaxes(1, 2), load)), null


def _locked(robot: ParallelRobot) -> tuple[IntArray, Array]:
    """Columns (f,) that move while the motors are locked, elastic ones first, and their units."""
    columns = moving_columns(robot)
    units = robot.column_scale[columns].copy()
    units[: robot.n_e] = spring_units(robot)
    return columns, units


def _loops(robot: ParallelRobot, motion: Motion) -> Array:
    """Independent loop equations (T, m, f) along those columns, in their units."""
    columns, units = _locked(robot)
    return motion.linearised.closures[:, :, columns] * _row_weights(robot)[:, None] * units


def _row_weights(robot: ParallelRobot) -> Array:
    """What makes the loop equations (m,) of unit size."""
    return 1.0 / robot.loop_lengths / robot.structure.row_sizes
