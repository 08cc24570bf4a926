"""Distances of poses from singularities, by measures of design.

All but g are functions of A v = B dq_a without dimension: twists and joint rates in radians and lengths, the
characteristic length being `robot.length`. There the rows of A are part of an orthonormal basis, so that the
singular values of A are cosines: 1 where nothing is lost, 0 at a Type 2 singularity, the same for a robot
drawn in millimetres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import dimensionless_matrices
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import singular_values
from framework.singularity.type2 import singularity_measure
from framework.tolerances import RANK_LOST

SINGULAR_VALUE_FLOOR = 1e-30  # instead of a singular value that is zero to the last bit


class Distances(NamedTuple):
    """Distances from singularities at T configurations.

    Torques are those that hold a unit force [1 N] on the platform, in the worst direction among its
    translations, without a moment [N m/N for hinges, N/N for slides]; of redundant motors the least ones.
    Infinite where the motors do not hold such a force (Type 2), not a number for a platform that only turns.

    A pressure angle is that between the force which one motor exerts on the platform and the velocity which
    it gives the platform while all other motors are locked; for the 5R its complement is the transmission
    angle between the two distal rods. It is defined where twists have an angle without a choice of length,
    for two or three translations alone, or turns alone, and as many motors; else it is not a number.
    """

    g: Array  # (T,) smallest singular value of P with the sign of det P, see `singularity_measure`
    sigma_A: Array  # (T,) smallest singular value of A, without dimension, 0 .. 1
    torque_norm: Array  # (T,) largest 2-norm of all motor torques, joint side
    torque_largest: Array  # (T,) largest torque of a single motor, joint side
    motor_torque_norm: Array  # (T,) the same on the motor side of the gears
    motor_torque_largest: Array  # (T,)
    pressure_angle: Array  # (T, n_a) [rad], 0 best, pi/2 at a Type 2 singularity

    @property
    def transmission_angle(self) -> Array:
        """Complement of the pressure angle (T, n_a) [rad]."""
        return np.pi / 2 - self.pressure_angle


def singularity_distances(robot: ParallelRobot, linearised: LinearisedLoops) -> Distances:
    """Compute distances from singularities at T configurations at which x determines the joints."""
    A, B, _ = dimensionless_matrices(robot, linearised)
    sigma_A = singular_values(A)[:, -1]
    if robot.n_a > robot.n:  # least torques are those of dq_a = B^+ A v: A becomes B^+ A, B the unit matrix
        A = np.linalg.pinv(B) @ A
        B = np.broadcast_to(np.eye(robot.n_a), (len(A), robot.n_a, robot.n_a))
    # v = J dq_a with J = A^-1 B by A = U S V': J = V S^-1 U' B, (T, n, n_a) without dimension
    U, values, V_rows = np.linalg.svd(A, full_matrices=False)
    inverse = 1.0 / np.maximum(values, SINGULAR_VALUE_FLOOR)
    J = V_rows.swapaxes(1, 2) @ (inverse[:, :, None] * (U.swapaxes(1, 2) @ B))
    torque_norm, torque_largest = _worst_torques(robot, J, V_rows, values, np.ones(robot.n_a))
    motor_norm, motor_largest = _worst_torques(robot, J, V_rows, values, robot.gear_ratio)
    return Distances(
        g=singularity_measure(robot, linearised).g,
        sigma_A=sigma_A,
        torque_norm=torque_norm,
        torque_largest=torque_largest,
        motor_torque_norm=motor_norm,
        motor_torque_largest=motor_largest,
        pressure_angle=_pressure_angles(robot, J),
    )


def _worst_torques(
    robot: ParallelRobot, J: Array, right: Array, values: Array, gear: Array
) -> tuple[Array, Array]:
    """Compute the largest 2-norm (T,) and single torque (T,) against a unit force, over ratios `gear` (n_a,).

    By virtual work W' v = tau' dq_a the torques are tau = J' W, with J (T, n, n_a) of v = J dq_a. They are
    infinite where a direction (a row of `right`) of a vanishing singular value moves the platform's point.
    """
    translations = robot.translations
    if not translations.any():
        undefined = np.full(len(J), np.nan)
        return undefined, undefined
    units = robot.length / (robot.column_scale[robot.actuated] * gear)  # back to metres and radians
    torques = J[:, translations] * units  # (T, translations, n_a)
    moves_point = np.abs(right[:, :, translations]).max(axis=2) > RANK_LOST
    is_lost = ((values < RANK_LOST) & moves_point).any(axis=1)
    norm = singular_values(torques)[:, 0]
    largest = np.linalg.norm(torques, axis=1).max(axis=1)
    return np.where(is_lost, np.inf, norm), np.where(is_lost, np.inf, largest)


def _pressure_angles(robot: ParallelRobot, J: Array) -> Array:
    """Compute the pressure angles (T, n_a) [rad].

    They are the angles of each column of J to the normal of all others.
    """
    has_one_unit = robot.translations.all() or not robot.translations.any()
    if not has_one_unit or robot.n < 2 or robot.n_a != robot.n:
        return np.full((len(J), robot.n_a), np.nan)
    size = np.linalg.norm(J, axis=1, keepdims=True)  # 0 where a motor does not move the platform: Type 1
    unit = J / np.where(size > 0, size, 1.0)  # (T, n, n_a) velocities of the platform, one motor each
    U, values, V_rows = np.linalg.svd(unit)
    inverse = 1.0 / np.maximum(values, SINGULAR_VALUE_FLOOR)
    # rows of the inverse: forces without power on the velocities of all other motors
    forces = (V_rows.swapaxes(1, 2) * inverse[:, None]) @ U.swapaxes(1, 2)
    angle = np.arccos(np.minimum(1.0 / np.linalg.norm(forces, axis=2), 1.0))
    return np.where(size[:, 0] > 0, angle, np.nan)
