"""The residual F of the balance along a motion with given deflections, and its derivatives.

With a prescribed platform motion x(t) and deflections l, the robot is in balance if

    r + K l = S' tau + J' lambda        r = forces of the open tree, J = d closures/dq, S the motors' columns

has a solution (tau, lambda). r + K l is called the load. The columns of Y span the motions that keep the
loops closed while the motors are locked and x is free. Then

    F = Y' (r + K l) = 0

has as many equations as there are springs. F is smooth at the singularity, because nothing in F is divided by
the singularity measure. The deflections that solve F = 0 are smooth there only under a law that respects
condition (8), t_s . W_p = 0.

Derivatives are those of r + K l - J' lambda at fixed lambda, the multipliers of least squares. Newton's
method on l is therefore Newton's method on (l, tau, lambda), with tau and lambda eliminated by Y'. With
redundant motors the change of G, which distributes their torques, is left out: slopes are off by 1e-3 or
less, and steps converge linearly.

Loads, Y and F are expressed in the f columns that move while the motors are locked, elastic columns first.
Units are those of `spring_units` for springs; otherwise radians and lengths of the robot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import Forces, force_changes, mass_matrices, tree_forces
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import Motion, coordinate_changes, motion_at, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.ordered_sums import factor_transposed, matvec, solve
from framework.tolerances import EIGENVALUE_ROUNDING


class DeflectedMotion(NamedTuple):
    """Path parameters (T,), platform motion (T, n) and deflections (T, n_e), with time derivatives."""

    s: Array
    x: Array
    dx: Array
    ddx: Array
    l: Array  # noqa: E741
    dl: Array
    ddl: Array

    @property
    def rates(self) -> tuple[Array, Array, Array, Array]:
        """Rates and accelerations of the platform (T, n), then of the deflections (T, n_e)."""
        return self.dx, self.ddx, self.dl, self.ddl


class LoadedBalance(NamedTuple):
    """The residual F of the balance along a prescribed motion."""

    prescribed: DeflectedMotion
    motion: Motion
    F: Array  # (T, n_e) Y' load
    largest_load: float  # the largest entry of the load r + K l, in spring units; F is compared with it
    Y: Array  # (T, f, n_e) orthonormal
    multipliers: Array  # (T, m) of the loop equations, of unit size
    wrenches: ExternalWrenches
    stiffer: float  # factor of the robot's spring stiffness


def spring_units(robot: ParallelRobot) -> Array:
    """Compute deflections (n_e,) [rad, m] of equal energy.

    The unit of the softest spring is 1 rad or a robot length.
    """
    scale = robot.column_scale[robot.elastic]
    compliance = 1.0 / (robot.stiffness * scale**2)
    return scale * np.sqrt(compliance / compliance.max(initial=0.0))


def springs_carry_inertia(branch: Branch) -> bool:
    """Return whether forces at the start of a path depend on accelerations of the deflections."""
    robot = branch.robot
    if not robot.elastic_inertia:
        return False
    start = np.zeros(1)
    closed = close_loops(robot, branch.path(start), branch.guess(start))
    at_rest = np.zeros((1, robot.n))
    motion = motion_at(robot, closed, at_rest, at_rest)
    mass = mass_matrices(robot, motion.q)
    inertia = coordinate_changes(robot, motion, robot.elastic).q @ mass  # (1, n_e, nv)
    return bool(np.abs(inertia).max() > EIGENVALUE_ROUNDING * np.abs(mass).max())


def evaluate_balance(
    robot: ParallelRobot,
    prescribed: DeflectedMotion,
    near: Array,
    *,
    wrenches: ExternalWrenches,
    stiffer: float = 1.0,
) -> LoadedBalance:
    """Compute the residual F (T, n_e) of the balance under external wrenches.

    Args:
        near: configurations (T, nq) near the result. With the prescribed deflections they are the first guess
            for closing the loops.
        stiffer: factor by which the springs are stiffer than those of the robot. A solution with stiff
            springs is easy to find, and leads to the solution of the robot by continuation.

    Raises:
        NotAssembled: the loops do not close with these deflections.
    """
    # replace the deflections of `near` (T, n_e) by the prescribed ones
    l_near = difference(robot, robot.neutral, near)[:, robot.elastic]
    guess = integrate_columns(robot, near, robot.elastic, prescribed.l - l_near)
    closed = close_loops(robot, prescribed.x, guess)
    motion, forces = motion_and_load(robot, prescribed, closed, wrenches, stiffer)  # r + K l (T, nv)
    load, multipliers, Y = _split_load(robot, motion, forces)
    F = matvec(Y.swapaxes(1, 2), load)
    largest_load = float(np.abs(load).max())
    return LoadedBalance(prescribed, motion, F, largest_load, Y, multipliers, wrenches, stiffer)


def balancing_forces(robot: ParallelRobot, motion: Motion, deflections: Array) -> tuple[Forces, float]:
    """Compute the forces of a motion with deflections (T, n_e), and the relative residual.

    Motors and loops balance the load r + K l in the sense of least squares, and Y Y' (r + K l) remains
    unbalanced. It is zero if the deflections are in balance. Otherwise the springs are taken to carry it,
    too, so that the forces are regular at Type 2. The relative residual is the largest unbalanced force
    divided by the largest spring force, both in the units of `locked_columns`.
    """
    r = tree_forces(robot, motion)
    forces = r.copy()
    forces[:, robot.elastic] += robot.stiffness * deflections
    units = spring_units(robot)
    load, multipliers, Y = _split_load(robot, motion, forces)
    unbalanced = matvec(Y, matvec(Y.swapaxes(1, 2), load))  # Y Y' load (T, f), elastic columns first
    loop_forces = matvec(motion.linearised.closures.swapaxes(1, 2), multipliers * loop_weights(robot))
    spring_force = unbalanced[:, : robot.n_e] / units - robot.stiffness * deflections
    largest = float(np.abs(spring_force * units).max())
    residual = float(np.abs(unbalanced).max()) / largest if largest > 0.0 else 0.0
    return Forces((r - loop_forces)[:, robot.actuated], spring_force), residual


def deflection_slopes(robot: ParallelRobot, balance: LoadedBalance, orders: int) -> Array:
    """Compute derivatives (T, f, orders n_e) of r + K l - J' lambda by deflections, in spring units.

    Args:
        orders: 1 for deflections alone; 3 for deflections, their rates and their accelerations.
    """
    columns, units = locked_columns(robot)
    motion, n_e = balance.motion, robot.n_e
    changes = coordinate_changes(robot, motion, robot.elastic)
    multipliers = balance.multipliers * loop_weights(robot)
    forces = force_changes(robot, motion, multipliers, changes)[:orders]
    in_units = forces[..., columns] * units * units[:n_e, None]
    # from (orders, T, n_e, f) to (T, f, orders n_e): row by force, column by order and spring
    slopes = in_units.transpose(1, 3, 0, 2).reshape(len(motion.q), len(columns), orders * n_e)
    slopes[:, range(n_e), range(n_e)] += balance.stiffer * robot.stiffness * units[:n_e] ** 2  # K
    return slopes


def forces_of_neighbour(robot: ParallelRobot, balance: LoadedBalance, prescribed: DeflectedMotion) -> Array:
    """Compute r + K l - J' lambda (T, f) along a neighbouring motion, with the multipliers of a balance.

    The result has the units of `locked_columns`.

    Args:
        balance: gives the multipliers lambda and the configurations from which the loops are closed.
        prescribed: platform motion of the neighbouring motion, with the deflections of the balance.

    Raises:
        NotAssembled: the loops do not close along the neighbouring motion.
    """
    columns, units = locked_columns(robot)
    closed = balance.motion.linearised
    if not np.array_equal(prescribed.x, closed.x):  # the law is one of time, not of s
        closed = close_loops(robot, prescribed.x, closed.q)
    _, load = motion_and_load(robot, prescribed, closed, balance.wrenches, balance.stiffer)
    multipliers = balance.multipliers * loop_weights(robot)
    loop_forces = matvec(closed.closures.swapaxes(1, 2), multipliers)
    return (load - loop_forces)[:, columns] * units


def motion_and_load(
    robot: ParallelRobot,
    prescribed: DeflectedMotion,
    closed: LinearisedLoops,
    wrenches: ExternalWrenches,
    stiffer: float,
) -> tuple[Motion, Array]:
    """Compute the motion of all joints in closed loops, and the load r + K l (T, nv).

    Args:
        prescribed: rates of platform and deflections, and the deflections l.
        closed: configurations with these deflections.
        stiffer: factor of the robot's spring stiffness.
    """
    motion = motion_at(robot, closed, *prescribed.rates[: 4 if robot.elastic_inertia else 2])
    motion = motion.with_wrenches(wrenches.evaluate(robot, closed.frames, prescribed.s))
    load = tree_forces(robot, motion)
    load[:, robot.elastic] += stiffer * robot.stiffness * prescribed.l
    return motion, load


def _split_load(robot: ParallelRobot, motion: Motion, forces: Array) -> tuple[Array, Array, Array]:
    """Select the load from forces (T, nv), and fit the multipliers of the loops.

    C' lambda = load of `constraint_rows` holds in the least squares: C' = Q R gives lambda = R^-1 Q' load.

    Returns:
        The load (T, f) of the columns that move while the motors are locked; the lambda (T, m) of the loops,
        without those of redundant motors; the orthonormal null space Y (T, f, n_e) of C.
    """
    columns, units = locked_columns(robot)
    Q, R, Y = factor_transposed(constraint_rows(robot, motion.linearised))
    load = forces[:, columns] * units
    multipliers = solve(R, matvec(Q.swapaxes(1, 2), load))
    return load, multipliers[:, : len(loop_weights(robot))], Y


def constraint_rows(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute rows C (T, c, f) whose forces C' lambda balance any load of the rigid robot.

    They are the loop equations J. For redundant motors, whose torques of least norm are t = G mu on the motor
    side, the rows G' follow; then Y spans motions that move no motor along the range of G.
    """
    columns, units = locked_columns(robot)
    rows = linearised.closures[:, :, columns] * loop_weights(robot)[:, None] * units
    if robot.n_a == robot.n:
        return rows
    G, _ = motor_speeds(robot, linearised)
    joint_torques = G * robot.gear_ratio[:, None]  # (T, n_a, n) by mu
    of_motors = np.zeros((len(rows), robot.n, len(columns)))
    of_motors[:, :, -robot.n_a :] = (joint_torques * units[-robot.n_a :, None]).swapaxes(1, 2)
    of_motors /= robot.platform_scale[:, None]
    return np.concatenate([rows, of_motors], axis=1)


def locked_columns(robot: ParallelRobot) -> tuple[IntArray, Array]:
    """Return the columns (f,) that move while the motors are locked, elastic ones first, and units (f,).

    Redundant motors are among them, last: springs let them move against each other.
    """
    columns = robot.unlocked
    if robot.n_a > robot.n:
        columns = np.append(columns, robot.actuated)
    units = robot.column_scale[columns].copy()
    units[: robot.n_e] = spring_units(robot)
    return columns, units


def loop_weights(robot: ParallelRobot) -> Array:
    """Return factors (m,) that bring the loop equations to unit size."""
    return 1.0 / robot.loop_lengths / robot.structure.row_sizes
