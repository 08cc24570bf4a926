"""The motor torques of a recorded motion as linear equations of the base parameters.

With G' = N' S the equations N' Y theta + constant = G' tau (`base_parameters`) give each motor's own equation

    tau = B (N' Y theta + constant),    B = E (G' E)^+,    E = diag(root mean square of the torques),

where tau is B G' tau if motors are redundant: the part of the torques that moves the robot. Each equation is
a series in time with the noise of one motor; errors of the accelerations change B N' Y. Not valid are the
instants near Type 2, where G' loses rank, those at which the sign of the motor's speed is unknown, where dry
friction may have any value, those at the ends and in gaps, where accelerations are noise, and those beside a
rest of the robot, where strokes meet and splines round the corners of accelerations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.identification.base_parameters import BaseParameters, parameter_regressor
from framework.identification.measured_motion import MeasuredMotion, SplineErrors
from framework.kinematics.motion_rates import Motion, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import MIN_NOISE_RATIO


class TorqueRows(NamedTuple):
    """Equations torque = matrix @ beta + constant of n_a motors at T instants, motor side of the gears."""

    times: Array  # (T,) [s]
    matrix: Array  # (T, n_a, r) derivatives with respect to the base parameters
    response: Array  # (T, n_a, r, k) derivatives of `matrix` with respect to accelerations of k signals
    constant: Array  # (T, n_a) of springs, and of armature and damping of joints without a motor
    torque: Array  # (T, n_a) measured [N m, N]
    valid: BoolArray  # (T, n_a)
    independent: float  # share n / n_a of the equations that are independent
    errors: SplineErrors  # of the k signals, motors' joints or platform

    def restrict(self, instants: BoolArray) -> TorqueRows:
        """Return the equations with only those of the instants in a mask (T,) valid."""
        return self._replace(valid=self.valid & instants[:, None])


def torque_rows(
    robot: ParallelRobot, measured: MeasuredMotion, base: BaseParameters, *, exact_motion: bool = False
) -> TorqueRows:
    """Compute the equations of the motor torques at the T instants of a recorded motion.

    The n balances of the platform, G' tau = matrix theta + constant of `parameter_regressor`, with parameters
    theta and torques tau (n_a,), become an equation for each motor by B = E (G' E)^+ from the left. E holds
    the motors' RMS torques: of all tau that meet the balances, B gives that with the least |E^-1 tau|. Valid
    are the equations away from Type 2 whose friction and acceleration are known.

    Args:
        base: the base parameters; the columns `leading` of the regressor are theirs.
        exact_motion: whether accelerations are without error; the response to errors is then empty.
    """
    chunk = 512  # instants whose regressors of all joints are in memory at once
    leading = base.combinations.leading
    rms_torque = np.sqrt(np.mean(measured.torque**2, axis=0))  # (n_a,) the diagonal of E
    parts = []  # of t instants each: matrix, response, constant, torque, clearance
    for start in range(0, len(measured.times), chunk):
        part = slice(start, start + chunk)
        motion = measured.motion.select(part)
        regressor = parameter_regressor(robot, motion, base.described)
        G_E = regressor.motors * rms_torque  # (t, n, n_a) G' E
        B = rms_torque[:, None] * np.linalg.pinv(G_E)  # (t, n_a, n)
        matrix = B @ regressor.matrix[:, :, leading]  # (t, n_a, r)
        response = np.empty(0)
        if not exact_motion:
            response = _response(robot, motion, base, B, of_motors=measured.source == "motors")
        constant = np.matvec(B, regressor.constant)  # (t, n_a)
        torque = np.matvec(B @ regressor.motors, measured.torque[part])  # (t, n_a)
        # the distance from Type 2: the least singular value of the dimensionless G' behind the gears
        unit_G = regressor.motors / robot.platform_scale[:, None] / robot.column_scale[robot.actuated]
        clearance = singular_values(unit_G / robot.gear_ratio)[:, -1]  # (t,)
        parts.append((matrix, response, constant, torque, clearance))
    matrix, response, constant, torque, clearance = map(np.concatenate, zip(*parts, strict=True))

    sign_known = measured.sign_known
    usable = measured.acceleration_known & (clearance > MIN_NOISE_RATIO * clearance.max())  # (T,)
    if robot.n_a > robot.n:  # the friction of one motor is in the equations of all
        sign_known = np.repeat(sign_known.all(axis=1, keepdims=True), robot.n_a, axis=1)
    return TorqueRows(
        times=measured.times,
        matrix=matrix,
        response=response,
        constant=constant,
        torque=torque,
        valid=sign_known & usable[:, None],
        independent=robot.n / robot.n_a,
        errors=measured.errors,
    )


def _response(
    robot: ParallelRobot, motion: Motion, base: BaseParameters, B: Array, *, of_motors: bool
) -> Array:
    """Compute derivatives (T, n_a, r, k) of the equations with respect to accelerations of k signals.

    Joints accelerate by N (T, nv, n) for unit accelerations of the platform, by N N_a^+ for those of motors.
    The regressor is linear in the accelerations, so that differences are exact.
    """
    _, N = motor_speeds(robot, motion.linearised)
    joints = N @ np.linalg.pinv(N[:, robot.actuated]) if of_motors else N  # (T, nv, k)
    at_rest = replace(motion, v=np.zeros_like(motion.v), a=np.zeros_like(motion.a))
    still = parameter_regressor(robot, at_rest, base.described).matrix
    response = np.zeros((*B.shape[:2], base.rank, joints.shape[2]))
    for k in range(joints.shape[2]):
        moving = parameter_regressor(robot, replace(at_rest, a=joints[:, :, k]), base.described).matrix
        response[..., k] = B @ (moving - still)[:, :, base.combinations.leading]
    return response
