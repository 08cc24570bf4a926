"""The growth of a small error under planned torques without feedback.

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
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import motion_at

GROWTH_INSTANTS = 65  # at which the rate of growth is computed and integrated over the motion
DIFFERENCE_STEP = 1e-4  # [rad, robot lengths] for a difference of wrenches
# Exponents of growth below which the growth is 1 but for rounding, and above which it overflows.
MIN_EXPONENT, MAX_EXPONENT = 1e-4, 300.0


def repelling_rates(result: InverseDynamics, times: Array) -> Array:
    """Compute the largest rate (T,) [1/s] at which an error of the platform grows; 0 where none does.

    Springs are taken for rigid where they are.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    robot = result.robot
    x, near, s = result.platform(times), result.configuration(times), result.law(times)
    torque = result.torque_without_friction(times)
    still = np.zeros_like(x)

    def unbalanced(moved: Array, ddx: Array) -> Array:
        """Compute W - G' tau (T, n) at rest with accelerations ddx."""
        closed = close_loops(robot, moved, near)
        wrenches = result.wrenches.at(robot, closed.linearised.frames, s)
        required = platform_wrench(robot, motion_at(robot, closed, still, ddx).under(wrenches))
        return required.asked - np.einsum("tan,ta->tn", required.motor_speed, torque)

    rest, units = unbalanced(x, still), np.eye(robot.n)
    inertia = np.stack([unbalanced(x, still + unit) - rest for unit in units], axis=2)
    steps = DIFFERENCE_STEP * robot.platform_scale
    slope = [
        (unbalanced(x + h * unit, still) - unbalanced(x - h * unit, still)) / (2.0 * h)
        for h, unit in zip(steps, units, strict=True)
    ]
    squares = np.linalg.eigvals(np.linalg.solve(inertia, -np.stack(slope, axis=2)))
    return np.asarray(np.sqrt(squares.astype(complex)).real.max(axis=1))


def open_loop_growth(result: InverseDynamics) -> float:
    """Compute how much farther than a free mass a constant push takes the platform by the end of a motion.

    2 (cosh L - 1) / L^2 with L the integral of the repelling rate over the motion; 1 where nothing repels.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    times = np.linspace(0.0, result.duration, GROWTH_INSTANTS)
    rate = repelling_rates(result, times)
    exponent = float(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times)))
    if exponent <= MIN_EXPONENT:
        return 1.0
    return float(2.0 * (np.cosh(min(exponent, MAX_EXPONENT)) - 1.0) / exponent**2)
