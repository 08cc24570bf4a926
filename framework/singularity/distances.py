"""Distances of poses from singularities, by measures used in design.

All measures but g are functions of the dimensionless matrices of A v = B dq_a: twists and joint rates are in
radians and characteristic lengths (`robot.length`). A is a block of columns of a matrix with orthonormal
rows, so its singular values are cosines: 1 at best, 0 at a Type 2 singularity, whatever the unit of length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import dimensionless_matrices
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import singular_values
from framework.singularity.type2 import signed_measure
from framework.tolerances import RANK_LOST

SINGULAR_VALUE_FLOOR = 1e-30  # least divisor: its inverse is huge, but does not overflow when squared


class Distances(NamedTuple):
    """Distances from singularities at T configurations.

    Torques [N m/N for hinges, N/N for slides] balance a force of 1 N on the platform, without a moment, in
    the worst direction of its translations. Redundant motors exert the torques of least norm. The torques are
    infinite where the motors do not hold such a force (Type 2), and NaN for a platform that only turns.

    A pressure angle is the angle between the force that one motor exerts on the platform and the velocity
    that it gives the platform while all other motors are locked. For the 5R its complement is the
    transmission angle between the two distal rods. An angle between twists is defined without a
    characteristic length only if all coordinates are translations, or all are turns. So the pressure angle is
    NaN unless the platform has two or three coordinates of one kind, and as many motors.
    """

    g: Array  # (T,) smallest singular value of P with the sign of det P, see `signed_measure`
    sigma_A: Array  # (T,) smallest singular value of A, dimensionless, 0 .. 1
    torque_norm: Array  # (T,) largest 2-norm of all motor torques, joint side
    torque_largest: Array  # (T,) largest torque of a single motor, joint side
    motor_torque_norm: Array  # (T,) `torque_norm` on the motor side of the gears
    motor_torque_largest: Array  # (T,) `torque_largest` on the motor side
    pressure_angle: Array  # (T, n_a) [rad], 0 at best, pi/2 at a Type 2 singularity

    @property
    def transmission_angle(self) -> Array:
        """Complement of the pressure angle (T, n_a) [rad]."""
        return np.pi / 2 - self.pressure_angle


def singularity_distances(robot: ParallelRobot, linearised: LinearisedLoops) -> Distances:
    """Compute distances from singularities at T configurations without a Type 1 singularity."""
    A, B, _ = dimensionless_matrices(robot, linearised)
    # v = J dq_a with J = A^-1 B = V S^-1 U' B (T, n, n_a) and A = U S V'
    U, values, V_rows = np.linalg.svd(A, full_matrices=False)
    sigma_A = values[:, -1]
    if robot.n_a > robot.n:  # redundant motors: dq_a = B^+ A v yields the torques of least norm
        U, values, V_rows = np.linalg.svd(np.linalg.pinv(B) @ A, full_matrices=False)
        B = np.eye(robot.n_a)
    inverse = 1.0 / np.maximum(values, SINGULAR_VALUE_FLOOR)
    J = V_rows.swapaxes(1, 2) @ (inverse[:, :, None] * (U.swapaxes(1, 2) @ B))

    torque_norm, torque_largest = _worst_torques(robot, J, V_rows, values, np.ones(robot.n_a))
    gear = robot.gear_ratio
    if (gear == gear[0]).all():
        motor_norm, motor_largest = torque_norm / gear[0], torque_largest / gear[0]
    else:
        motor_norm, motor_largest = _worst_torques(robot, J, V_rows, values, gear)
    return Distances(
        g=signed_measure(robot, linearised),
        sigma_A=sigma_A,
        torque_norm=torque_norm,
        torque_largest=torque_largest,
        motor_torque_norm=motor_norm,
        motor_torque_largest=motor_largest,
        pressure_angle=_pressure_angles(robot, J),
    )


def _worst_torques(
    robot: ParallelRobot, J: Array, V_rows: Array, values: Array, gear: Array
) -> tuple[Array, Array]:
    """Compute the largest torques that balance a force of 1 N in any direction.

    By virtual work W' v = tau' dq_a, the torques are tau = J' W with v = J dq_a. They are infinite where a
    vanishing singular value belongs to a twist that moves the platform's point.

    Args:
        J: (T, n, n_a) in radians and robot lengths.
        V_rows: (T, n, n) right singular vectors of A, dimensionless twists, one a row.
        values: (T, n) singular values of A.
        gear: (n_a,) ratios by which gears reduce the torques.

    Returns:
        The largest 2-norm (T,) of all torques; the largest single torque (T,).
    """
    translations = robot.translations
    if not translations.any():
        undefined = np.full(len(J), np.nan)
        return undefined, undefined

    units = robot.length / (robot.column_scale[robot.actuated] * gear)  # back to metres and radians
    torques = J[:, translations] * units  # (T, translations, n_a)
    moves_point = np.abs(V_rows[:, :, translations]).max(axis=2) > RANK_LOST  # (T, n)
    is_lost = ((values < RANK_LOST) & moves_point).any(axis=1)

    norm = singular_values(torques)[:, 0]  # the largest ones: over all directions of the force
    largest = np.linalg.norm(torques, axis=1).max(axis=1)  # over all directions, then over the motors
    return np.where(is_lost, np.inf, norm), np.where(is_lost, np.inf, largest)


def _pressure_angles(robot: ParallelRobot, J: Array) -> Array:
    """Compute the pressure angles (T, n_a) [rad] from J (T, n, n_a) of v = J dq_a.

    Each is the angle between a column of J and the normal of all other columns.
    """
    has_one_unit = robot.translations.all() or not robot.translations.any()
    if not has_one_unit or robot.n < 2 or robot.n_a != robot.n:
        return np.full((len(J), robot.n_a), np.nan)
    speeds = np.linalg.norm(J, axis=1, keepdims=True)  # (T, 1, n_a); 0 at Type 1: the motor moves nothing
    directions = J / np.where(speeds > 0, speeds, 1.0)  # (T, n, n_a) of the platform's velocity by each motor
    U, values, V_rows = np.linalg.svd(directions)
    inverse = 1.0 / np.maximum(values, SINGULAR_VALUE_FLOOR)  # finite at Type 2
    # Rows of the inverse matrix (T, n_a, n): forces with unit power on the direction of one motor, and with
    # no power on those of all others. Such a force is normal to all other directions, so the cosine of the
    # pressure angle is 1 over its norm.
    forces = (V_rows.swapaxes(1, 2) * inverse[:, None]) @ U.swapaxes(1, 2)
    angle = np.arccos(np.minimum(1.0 / np.linalg.norm(forces, axis=2), 1.0))
    return np.where(speeds[:, 0] > 0, angle, np.nan)
