"""What becomes of a small error under planned torques that nothing corrects.

With G' tau the wrench of the motors and W the wrench that the platform asks for, a platform off by d follows

    M d" = -d (W - G' tau)/dx d,

velocities left aside, and in W the planned accelerations. Where that repels, weight or the torques themselves
carry the platform off, the faster the farther it is: a robot that stands on its legs falls over unless
somebody looks. Nothing is divided by what vanishes at a Type 2 singularity.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.dynamics.platform_wrench import platform_wrench
from framework.dynamics.result import InverseDynamics
from framework.kinematics.inverse_kinematics import close_loops, motion_at

INSTANTS = 65
STEP = 1e-4  # [rad, robot lengths] for a difference of wrenches
SLIGHT, MOST = 1e-4, 300.0  # exponents of growth that are 1 to rounding, and beyond all numbers


def repelling_rates(result: InverseDynamics, times: Array) -> Array:
    """The largest rate (T,) [1/s] at which an error of the platform grows; 0 where all errors swing or stay.

    Springs are taken for rigid where they are.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    robot = result.robot
    x, near, torque = result.platform(times), result.configuration(times), result.torque(times)
    still = np.zeros_like(x)

    def unbalanced(moved: Array, ddx: Array) -> Array:
        """W - G' tau (T, n) at rest with accelerations ddx."""
        at = platform_wrench(robot, motion_at(robot, close_loops(robot, moved, near), still, ddx))
        return at.asked - np.einsum("tan,ta->tn", at.motor_speed, torque)

    rest, units = unbalanced(x, still), np.eye(robot.n)
    inertia = np.stack([unbalanced(x, still + unit) - rest for unit in units], axis=2)
    steps = STEP * np.where(robot.translations, robot.length, 1.0)
    slope = [
        (unbalanced(x + h * unit, still) - unbalanced(x - h * unit, still)) / (2.0 * h)
        for h, unit in zip(steps, units, strict=True)
    ]
    squares = np.linalg.eigvals(np.linalg.solve(inertia, -np.stack(slope, axis=2)))
    return np.asarray(np.sqrt(squares.astype(complex)).real.max(axis=1))


def open_loop_growth(result: InverseDynamics) -> float:
    """How many times as far as by itself a constant push takes the platform by the end of a motion.

    2 (cosh L - 1) / L^2 with L the integral of the repelling rate over the motion; 1 where nothing repels.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    times = np.linspace(0.0, result.duration, INSTANTS)
    rate = repelling_rates(result, times)
    exponent = float(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times)))
    return float(2.0 * (np.cosh(min(exponent, MOST)) - 1.0) / exponent**2) if exponent > SLIGHT else 1.0
