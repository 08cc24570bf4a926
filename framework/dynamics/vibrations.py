"""Vibrations along a path: natural frequencies, the softest direction, and the response to motor torques.

At rest, with free motors, small motions dq = Z dz that springs and loops allow obey

    (K (1 + i loss) + i w D - w^2 M) dz = Z' S' n tau,        x = X dz,

with K, M and X of `stiffness`, the damping D of joints and between points, and rotors in M. The response
X (...)^-1 Z' S' n is finite at a Type 2 singularity. Below its first resonance the robot moves as if rigid,
and the response falls with 1 / w^2. `loss` is the loss factor of springs, twice the damping ratio of a
vibration; the springs of a robot file have no damping of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.dynamics.stiffness import (
    compliant_motions,
    moving_axes,
    natural_frequencies,
    softest_motion,
)
from framework.errors import InvalidInput, real_numbers
from framework.kinematics.line_springs import Lines
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.fields import not_negative

LOSS = 0.02  # of bolted steel and gears: 1 % of the critical damping
SHOWN_FREQUENCIES = 4  # natural frequencies of each pose, with locked and with free motors


@dataclass(frozen=True, eq=False)
class Vibrations(ReadOnlyArrays):
    """Vibrations at T poses of a robot."""

    robot: ParallelRobot
    natural: Array  # (T, k) [Hz] the k lowest natural frequencies with locked motors; NaN where fewer
    resonances: Array  # (T, k) [Hz] the k lowest with free motors
    stiffness: Array  # (T,) [N/m] in the softest direction of the platform, motors locked
    softest: Array  # (T, j) this direction, a unit vector on the axes along which the platform moves
    frequency: Array  # (F,) [Hz] of the response
    response: Array  # (T, F, n, n_a) complex [m/(N m), rad/(N m)] platform by motor torques, motor side

    @property
    def axes(self) -> list[str]:
        """Names of the platform's axes in `softest`."""
        return [self.robot.axis_names[k] for k in moving_axes(self.robot)]

    @property
    def gain(self) -> Array:
        """Largest motion (T, F) along `axes` by motor torques of unit norm."""
        response = self.response[:, :, moving_axes(self.robot)]  # (T, F, j, n_a)
        return np.asarray(np.linalg.svd(response, compute_uv=False)[..., 0], dtype=float)


def platform_vibrations(
    robot: ParallelRobot, q: ArrayLike, *, frequencies: ArrayLike | None = None, loss: float = LOSS
) -> Vibrations:
    """Compute vibrations and response to motor torques at rest at q (T, nq).

    Args:
        frequencies: (F,) [Hz] of the response; by default 150 from a tenth of a low natural frequency to
            twice the highest that is returned.
        loss: loss factor of the springs, in addition to the damping of the robot file.

    Raises:
        InvalidInput: q leaves loops open; the robot has no springs; a frequency or the loss is negative;
            a motor moves neither mass nor a spring.
    """
    linearised = assembled_at(robot, q, stacks=True)
    q = linearised.q
    locked = compliant_motions(robot, linearised, q)
    columns = np.concatenate([robot.actuated, robot.unlocked])
    free = compliant_motions(robot, linearised, q, columns=columns)
    natural = natural_frequencies(locked, min(SHOWN_FREQUENCIES, locked.K.shape[1]))
    with_rigid = natural_frequencies(free, min(robot.n + SHOWN_FREQUENCIES, free.K.shape[1]))
    resonances = with_rigid[:, robot.n :]  # without the n motions of the rigid robot
    stiffness, softest = softest_motion(robot, locked)
    if frequencies is None:
        vibrating = np.concatenate([natural, resonances], axis=1)
        vibrating = vibrating[vibrating > 0.0]
        lowest, highest = np.percentile(vibrating, [20, 100]) if vibrating.size else (1.0, 100.0)
        frequencies = np.geomspace(0.1 * lowest, 2.0 * highest, 150)
    frequency = np.atleast_1d(real_numbers("frequencies", frequencies))
    if frequency.ndim > 1 or not (np.isfinite(frequency) & (frequency > 0.0)).all():
        raise InvalidInput(f"frequencies: needs numbers above 0 [Hz], got {frequencies!r}")
    not_negative("loss", loss)
    damping = np.diag(robot.joint_damping)  # of joints and between points
    if robot.line_springs.names:
        damping = damping + Lines.of(robot, linearised.frames).damping
    damping = free.Z.swapaxes(1, 2) @ damping[..., columns[:, None], columns] @ free.Z  # (T, d, d)
    # unit torques on the joint side, n tau along the first rows of Z, those of the motors (T, d, n_a)
    drive = free.Z[:, : robot.n_a].swapaxes(1, 2) * robot.gear_ratio
    w = 2 * np.pi * frequency[:, None, None]
    K, M, D = (matrix[:, None] for matrix in (free.K, free.M, damping))
    try:
        motion = np.linalg.solve(K * (1 + 1j * loss) + 1j * w * D - w**2 * M, drive[:, None].astype(complex))
    except np.linalg.LinAlgError:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: a motor moves neither mass nor a spring, so it has no "
            f"response; give its rotor an inertia"
        ) from None
    response = np.asarray(free.X[:, None] @ motion)  # (T, F, n, n_a)
    return Vibrations(robot, natural, resonances, stiffness, softest, frequency, response)
