"""Forces and tangent stiffness of T configurations with locked motors, along motions that the loops allow.

With the energy V of springs and weight, the external wrench w on the platform x and the closures c, the
balance is dV/dq - w . dx/dq = lambda . dc/dq. The tangent stiffness along motions Z with constant c is

    H = Z' (d2V/dq2 - lambda . d2c/dq2 - w . d2x/dq2) Z.

Second derivatives are exact: they are the changes of the joint forces of lambda and w along the motions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.forces import all_spring_forces
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.closures import loop_force_changes
from framework.kinematics.external_wrenches import applied_wrench, wrench_slope
from framework.kinematics.frames import frames_at, scratch_of
from framework.kinematics.line_springs import Lines
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at, scaled_loops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform
from framework.numerics.arrays import LEAST_DIVISOR, Array, ArrayLike
from framework.numerics.ordered_sums import factor_transposed, matmul, matvec, solve
from framework.tolerances import EIGENVALUE_ROUNDING


class Load(NamedTuple):
    """The load on T configurations: weight and wrench, of which each bears a share of its own."""

    w: Array  # (n,) external wrench ON the platform, on the platform's axes
    share: Array  # (T,) share of weight and w that acts, 0 .. 1
    preload: Array  # (T, nv) spring forces at which the robot is in balance without load


class EquilibriumEquations(NamedTuple):
    """Equations of closed loops and of balanced forces at T configurations, with their derivatives.

    Unknown are the f joints that move with locked motors, in radians and robot lengths, and the share of the
    load. In equilibrium `values`, `closing_step` and `energy_slope` are zero.
    """

    values: Array  # F (T, f): the energy slope along Z, over the largest entry of H, minus the closing step
    slopes: Array  # (T, f, f + 1) dF by the joints and by the share
    closing_step: Array  # (T, f) the shortest step that closes the loops, to first order
    null_space: Array  # (T, f, d) orthonormal steps Z that keep the loops closed
    energy_slope: Array  # (T, d) [N m] derivative along Z of the energy V - w . x, after the closing step
    H: Array  # (T, d, d) [N m] tangent stiffness along Z


def check_wrench(robot: ParallelRobot, wrench: ArrayLike | None) -> Array:
    """Return the external wrench (n,) [N, N m] on the platform, zero by default.

    Equilibria are minima of an energy, so that the wrench needs a potential. Rotations about several axes do
    not commute: the work of a constant moment then depends on the path.

    Raises:
        InvalidInput: not n finite numbers, or a moment on a platform that turns about several axes.
    """
    w = np.zeros(robot.n) if wrench is None else finite_numbers("wrench", wrench, robot.n)
    if np.count_nonzero(~robot.translations) > 1 and np.any(w[~robot.translations]):
        raise InvalidInput("wrench: a moment on a platform that turns about several axes has no potential")
    return w


def evaluate_equilibrium(robot: ParallelRobot, q: Array, load: Load) -> EquilibriumEquations:
    """Compute the equations of equilibrium at configurations q (T, nq), with loops open or closed.

    With the Jacobian J of the loop equations and the QR factorisation J' = Q R, the shortest step that closes
    the loops is -Q R'^-1 residual. The energy slope after this step is that at q, plus the tangent stiffness
    between Z and the step. Slope and stiffness H are divided by the largest entry of H. The Jacobian of F is
    the scaled stiffness along Z and the identity across Z: 1 + Z (H / largest - 1) Z'. H is shifted by
    rounding, so that steps lead downhill where H is singular.
    """
    columns = robot.unlocked
    lengths = robot.column_scale[columns]
    linearised = linearised_at(robot, q, robot.platform.coordinates(frames_at(robot, q)))
    J = scaled_loops(robot, linearised)[:, :, columns]
    residual = linearised.residual[:, robot.n :] * (1.0 / robot.loop_lengths)  # of the loop equations
    Q, R, Z = factor_transposed(J)
    closing_step = -matvec(Q, solve(R.swapaxes(1, 2), residual))

    # stiffness along the d + 1 columns [Z, closing step]: H, bordered by the products with the closing step
    steps = np.concatenate([Z, closing_step[:, :, None]], axis=2)
    stiffness = tangent_stiffness(robot, linearised, q, steps * lengths[:, None], load)
    H, slope_change = stiffness[:, :-1, :-1], stiffness[:, :-1, -1]  # the change (T, d) by the closing step
    forces, forces_by_share = _forces(robot, linearised, q, load)
    Z_rows = Z.swapaxes(1, 2)
    energy_slope = matvec(Z_rows, forces[:, columns] * lengths) + slope_change
    slope_by_share = matvec(Z_rows, forces_by_share[:, columns] * lengths)

    largest = np.abs(H).max(axis=(1, 2), initial=LEAST_DIVISOR)[:, None]  # (T, 1) [N m]
    along_Z = H / largest[:, None] - (1.0 - EIGENVALUE_ROUNDING) * np.eye(Z.shape[2])
    by_joints = np.eye(len(columns)) + matmul(Z, matmul(along_Z, Z_rows))
    by_share = matvec(Z, slope_by_share / largest)
    return EquilibriumEquations(
        values=matvec(Z, energy_slope / largest) - closing_step,
        slopes=np.concatenate([by_joints, by_share[:, :, None]], axis=2),
        closing_step=closing_step,
        null_space=Z,
        energy_slope=energy_slope,
        H=H,
    )


def tangent_stiffness(
    robot: ParallelRobot, linearised: LinearisedLoops, q: Array, steps: Array, load: Load
) -> Array:
    """Compute the tangent stiffness (T, p, p) along steps (T, f, p) [N m] at q (T, nq).

    It is steps' (d2V/dq2 - lambda . d2c/dq2 - w . d2x/dq2) steps with the potential V of springs and weight,
    the loop equations c, and the wrench w on platform coordinates x. Weight and wrench are those of `load`,
    multiplied by its share. The multipliers lambda are the least-squares solution of J' lambda = forces, with
    J the scaled derivative of c along the f columns that move with locked motors.

    The curvature lambda . d2c/dq2 + w . d2x/dq2 is the symmetric part of d(J' lambda + X' w)/dq at constant
    lambda and w, with the Jacobians J of c and X of x. The derivative itself is not symmetric on ball joints,
    as turns about different axes do not commute. Coordinates x that are joints have no curvature.

    Args:
        steps: columns are p steps [rad, m] of the joints that move with locked motors.
    """
    columns = robot.unlocked
    J = scaled_loops(robot, linearised)[:, :, columns]
    forces, _forces_by_share = _forces(robot, linearised, q, load)
    scaled_forces = forces[:, columns] * robot.column_scale[columns]
    Q, R, _null = factor_transposed(J)
    multipliers = solve(R, matvec(Q.swapaxes(1, 2), scaled_forces)) * (1.0 / robot.loop_lengths)
    data = scratch_of(robot).data
    of_weight = np.array([pin.computeGeneralizedGravityDerivatives(robot.model, data, row) for row in q])
    slopes = load.share[:, None, None] * of_weight  # of the joint forces of weight, (T, nv, nv)
    if robot.line_springs.names:
        slopes += Lines.of(robot, linearised.frames).force_slope()
    stiffness = 0.5 * (slopes + slopes.swapaxes(1, 2))  # the second derivatives of the potential
    between_joints = stiffness[:, columns[:, None], columns]
    force_changes = robot.all_stiffness[columns][:, None] * steps + matmul(between_joints, steps)

    # the changes of J' lambda and X' w along the steps, as motions of all joints
    frames = linearised.frames
    motions = np.zeros((len(steps), steps.shape[2], robot.nv))
    motions[:, :, columns] = steps.swapaxes(1, 2)
    loop_wrenches = linearised.wrenches[:, robot.n :]
    spread = linearised.spread(multipliers)
    changes = loop_force_changes(robot, robot.spanning_loops, frames, loop_wrenches, spread, motions)
    if isinstance(robot.platform, FramePlatform):
        at_origin = load.share[:, None] * (load.w @ robot.platform.units)  # (T, 6) on base axes
        applied = applied_wrench(robot, frames, robot.description.platform.frame, at_origin)
        changes += matmul(motions, wrench_slope(robot, frames.screws, applied).swapaxes(1, 2))
    curvature = matmul(changes, motions.swapaxes(1, 2))  # (T, p, p), before it is made symmetric
    return matmul(steps.swapaxes(1, 2), force_changes) - 0.5 * (curvature + curvature.swapaxes(1, 2))


def _forces(robot: ParallelRobot, linearised: LinearisedLoops, q: Array, load: Load) -> tuple[Array, Array]:
    """Compute joint forces dV/dq - w . dx/dq (T, nv) at q, and their derivatives by the load's share.

    The forces are springs - preload + share (preload + weight - wrench). Under the whole load, share 1, the
    preload cancels.
    """
    data = scratch_of(robot).data
    springs = all_spring_forces(robot, q, robot.all_stiffness)
    weight = np.array([pin.computeGeneralizedGravity(robot.model, data, row) for row in q])
    wrench = matvec(linearised.platform.swapaxes(1, 2), np.broadcast_to(load.w, (len(q), robot.n)))
    by_share = load.preload + weight - wrench
    return springs - load.preload + load.share[:, None] * by_share, by_share
