"""Distances of poses from singularities, by measures used in design.

The measures are functions of the dimensionless matrices of A v = B dq_a: twists and joint rates are in
radians and characteristic lengths (`robot.length`). A is a block of columns of a matrix with orthonormal
rows, so its singular values are cosines: 1 at best, 0 at a Type 2 singularity, whatever the unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import dimensionless_matrices
from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.ordered_sums import least_singular_values
from framework.tolerances import RANK_LOST

SINGULAR_VALUE_FLOOR = 1e-30  # least divisor: its inverse is huge, but does not overflow when squared


@dataclass(frozen=True, eq=False)
class Distances(ReadOnlyArrays):
    """Distances from singularities at T configurations, each computed on first use."""

    robot: ParallelRobot
    linearised: LinearisedLoops  # without a Type 1 singularity

    @cached_property
    def sigma_A(self) -> Array:
        """Smallest singular value of A (T,), dimensionless, 0 .. 1.

        L = (I + X X')^-1/2 [I, -X] has orthonormal rows that annihilate the passive columns if X is that of
        `_passive_share`. Its first columns are A.
        """
        X = self._passive_share
        if X is None:
            return _motor_matrices(self.robot, self.linearised)[2]
        return 1.0 / np.sqrt(1.0 + np.linalg.eigvalsh(X @ X.swapaxes(1, 2))[:, -1])

    @cached_property
    def _passive_share(self) -> Array | None:
        """X (T, n, m) with X P = passive columns of the platform, dimensionless; None without P^-1."""
        robot = self.robot
        passive_columns = self.linearised.platform[:, :, robot.following].transpose(1, 0, 2)  # (n, T, n_p)
        try:
            X = self.linearised.passive_factors.solve(passive_columns, transposed=True)  # (n, T, m)
        except np.linalg.LinAlgError:  # redundant motors, no passive joints, or a P singular to the last bit
            return None
        return X.transpose(1, 0, 2) * (robot.loop_lengths / robot.platform_scale[:, None])

    @cached_property
    def J(self) -> Array:
        """J (T, n, n_a) of the platform's velocity v = J dq_a, dimensionless; huge near Type 2."""
        X = self._passive_share
        if X is None:
            return _motor_matrices(self.robot, self.linearised)[1]
        robot = self.robot
        units = robot.column_scale[robot.actuated]
        platform = self.linearised.platform[:, :, robot.actuated] * units / robot.platform_scale[:, None]
        loops = self.linearised.closures[:, :, robot.actuated] * units / robot.loop_lengths[:, None]
        return platform - X @ loops  # [I, -X] leaves v = [I, -X] (actuated columns) dq_a

    @cached_property
    def _are_lost(self) -> BoolArray:
        """Whether the motors do not hold some force (T,), as a twist without resistance moves the point."""
        is_near = (self.sigma_A < RANK_LOST) | (self.robot.n_a > self.robot.n)
        lost = np.zeros(len(is_near), dtype=bool)
        if is_near.any():
            near = self.linearised.select(np.flatnonzero(is_near))
            lost[is_near] = _motor_matrices(self.robot, near)[0]
        return lost

    def worst_torques(self, gear: Array) -> tuple[Array, Array]:
        """Compute the largest 2-norm of the motors' torques and the largest single torque, (T,) each.

        The torques [N m/N for hinges, N/N for slides] balance a force of 1 N on the platform, without a
        moment, in the worst direction of its translations. Redundant motors exert those of least norm. The
        torques are infinite where the motors do not hold such a force (Type 2), and NaN for a platform that
        only turns. By virtual work W' v = tau' dq_a they are tau = J' W.

        Args:
            gear: (n_a,) ratios by which gears reduce the torques; ones for the joint side.
        """
        robot = self.robot
        if not robot.translations.any():
            undefined = np.full(len(self.J), np.nan)
            return undefined, undefined
        units = robot.length / (robot.column_scale[robot.actuated] * gear)  # back to metres and radians
        torques = self.J[:, robot.translations] * units  # (T, translations, n_a)
        squares = np.linalg.eigvalsh(torques @ torques.swapaxes(1, 2))[:, -1]  # of the largest norms
        largest = np.linalg.norm(torques, axis=1).max(axis=1)  # over all directions, then over the motors
        lost = self._are_lost
        return np.where(lost, np.inf, np.sqrt(squares)), np.where(lost, np.inf, largest)


def _motor_matrices(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[BoolArray, Array, Array]:
    """Compute from A = U S V' and B whether a force is not held (T,), J (T, n, n_a) and sigma_A (T,).

    J = A^-1 B = V S^-1 U' B. With redundant motors dq_a = B^+ A v yields the torques of least norm. A force
    is not held where a vanishing singular value belongs to a twist that moves the platform's point.
    """
    A, B, _ = dimensionless_matrices(robot, linearised)
    sigma_A = least_singular_values(A)
    if robot.n_a > robot.n:
        A, B = np.linalg.pinv(B) @ A, np.eye(robot.n_a)
    U, values, V_rows = np.linalg.svd(A, full_matrices=False)
    inverse = 1.0 / np.maximum(values, SINGULAR_VALUE_FLOOR)
    J = V_rows.swapaxes(1, 2) @ (inverse[:, :, None] * (U.swapaxes(1, 2) @ B))
    moves_point = np.abs(V_rows[:, :, robot.translations]).max(axis=2, initial=0.0) > RANK_LOST  # (T, n)
    return ((values < RANK_LOST) & moves_point).any(axis=1), J, sigma_A


def pressure_angles(robot: ParallelRobot, J: Array) -> Array:
    """Compute the pressure angles (T, n_a) [rad] from J (T, n, n_a) of v = J dq_a.

    A pressure angle, 0 at best and pi/2 at Type 2, is the angle between the force that one motor exerts on
    the platform and the velocity that it gives the platform while all other motors are locked: that between a
    column of J and the normal of all other columns. For the 5R its complement is the transmission angle
    between the two distal rods. An angle between twists is defined without a characteristic length only if
    all coordinates are translations, or all are turns. So it is NaN unless the platform has two or three
    coordinates of one kind, and as many motors.
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
