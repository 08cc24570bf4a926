"""The motor torques of a recorded motion as linear equations of the base parameters.

With G' = N' S the equations N' Y theta + constant = G' tau (`base_parameters`) give each motor's own equation

    tau = B (N' Y theta + constant),    B = E (G' E)^+,    E = diag(root mean square of the torques),

where tau is B G' tau if motors are redundant: the part of the torques that moves the robot. Each equation is
a series in time with the noise of one motor, and with that of the accelerations times the inertia. Not valid
are the instants near Type 2, where G' loses rank, and those at which the sign of the motor's speed is
unknown: there dry friction may have any value.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import mass_matrices
from framework.identification.base_parameters import BaseParameters, parameter_regressor
from framework.identification.measured_motion import MeasuredMotion
from framework.kinematics.motion_rates import Motion, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import MIN_NOISE_RATIO


class TorqueRows(NamedTuple):
    """Equations torque = matrix @ beta + constant of n_a motors at T instants, motor side of the gears."""

    times: Array  # (T,) [s]
    matrix: Array  # (T, n_a, r) derivatives with respect to the base parameters
    matrix_noise: Array  # (T, n_a, r) what errors of the motion add to `matrix`
    constant: Array  # (T, n_a) of springs, and of armature and damping of joints without a motor
    torque: Array  # (T, n_a) measured [N m, N]
    motion_noise: Array  # (T, n_a) deviation of the torques by errors of the accelerations, as white noise
    valid: BoolArray  # (T, n_a)
    independent: float  # share n / n_a of the equations that are independent

    def restrict(self, instants: BoolArray) -> TorqueRows:
        """Return the equations with only those of the instants in a mask (T,) valid."""
        return self._replace(valid=self.valid & instants[:, None])


def torque_rows(robot: ParallelRobot, measured: MeasuredMotion, base: BaseParameters) -> TorqueRows:
    """Compute the equations of the motor torques at the T instants of a recorded motion."""
    chunk = 512  # instants whose regressors of all joints are in memory at once
    leading = base.combinations.leading
    scale = np.sqrt(np.mean(measured.torque**2, axis=0))  # (n_a,) the diagonal of E
    matrices, noises, constants, torques, motion_noise, least = [], [], [], [], [], []
    for start in range(0, len(measured.times), chunk):
        part = slice(start, start + chunk)
        motion = _select(measured.motion, part)
        regressor = parameter_regressor(robot, motion, base.described)
        noisier = parameter_regressor(robot, _select(measured.noisier, part), base.described)
        scaled_G = regressor.motors * scale  # (t, n, n_a) G' E
        B = scale[:, None] * np.linalg.pinv(scaled_G)  # (t, n_a, n)
        matrices.append(B @ regressor.matrix[:, :, leading])
        noises.append(B @ (noisier.matrix - regressor.matrix)[:, :, leading])
        constants.append(np.matvec(B, regressor.constant))
        torques.append(np.matvec(B @ regressor.motors, measured.torque[part]))
        inertia = B @ _inertia(robot, motion, of_motors=measured.source == "motors")  # (t, n_a, k)
        noise = inertia * measured.acceleration_noise[part, None]
        motion_noise.append(np.linalg.norm(noise, axis=2))
        unit_G = regressor.motors / robot.platform_scale[:, None] / robot.column_scale[robot.actuated]
        least.append(singular_values(unit_G / robot.gear_ratio)[:, -1])
    clearances = np.concatenate(least)  # (T,) distances from Type 2
    sign_known = measured.sign_known
    if robot.n_a > robot.n:  # the friction of one motor is in the equations of all
        sign_known = np.repeat(sign_known.all(axis=1, keepdims=True), robot.n_a, axis=1)
    return TorqueRows(
        times=measured.times,
        matrix=np.concatenate(matrices),
        matrix_noise=np.concatenate(noises),
        constant=np.concatenate(constants),
        torque=np.concatenate(torques),
        motion_noise=np.concatenate(motion_noise),
        valid=sign_known & (clearances > MIN_NOISE_RATIO * clearances.max())[:, None],
        independent=robot.n / robot.n_a,
    )


def _select(motion: Motion, part: slice) -> Motion:
    """Return a part of the instants of a motion."""
    return Motion(motion.q[part], motion.v[part], motion.a[part], motion.linearised.select(part))


def _inertia(robot: ParallelRobot, motion: Motion, *, of_motors: bool) -> Array:
    """Compute wrenches (T, n, k) for unit accelerations of the k motors' joints, or platform coordinates.

    They are N' (M + rotors) N, times the platform's motion N_a^+ for unit rates of the motors.
    """
    _, N = motor_speeds(robot, motion.linearised)  # (T, nv, n)
    motors = robot.actuated
    mass = mass_matrices(robot, motion.q)  # (T, nv, nv)
    mass[:, motors, motors] += robot.gear_ratio**2 * robot.rotor_inertia
    by_platform = N.swapaxes(1, 2) @ mass @ N  # (T, n, n)
    return by_platform @ np.linalg.pinv(N[:, motors]) if of_motors else by_platform
