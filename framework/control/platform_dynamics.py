"""The rigid robot's dynamics in its platform coordinates, which stay regular at Type 2.

    M_x(x) ddx + h_x(x, dx) = G(x)' tau        G = motor speeds for unit dx, singular at Type 2

Coordinates that describe the manifold of closed loops are free to choose; x serves everywhere but in Type 1
singularities, and there is no inverse of A in it. Bordalba, Ros and Porta choose a chart in the same spirit
(Direct Collocation / A Singularity-Robust LQR Controller for Parallel Robots, IROS 2018).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.control.reference import platform_rates
from framework.dynamics.forces import tree_forces
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import motion_at
from framework.kinematics.parallel_robot import ParallelRobot


class PlatformDynamics(NamedTuple):
    """M_x, h_x and G at T states."""

    mass: Array  # (T, n, n)
    bias: Array  # (T, n)
    motors: Array  # (T, n_a, n) G

    def acceleration(self, torque: Array) -> Array:
        """Compute ddx (T, n) for motor torques (T, n_a) [N m]."""
        pushed = np.einsum("tan,ta->tn", self.motors, torque) - self.bias
        return np.asarray(np.linalg.solve(self.mass, pushed[..., None])[..., 0])


def platform_dynamics(robot: ParallelRobot, x: Array, dx: Array, guess: Array) -> PlatformDynamics:
    """Compute the dynamics at x, dx (T, n), from configurations near them, guess (T, nq).

    Raises:
        NotAssembled: the loops do not close at some x.
    """
    closed = close_loops(robot, x, guess)
    motion = motion_at(robot, closed, dx, np.zeros_like(dx))  # a: what is left when ddx = 0
    N = platform_rates(robot, motion, x)
    rotors = np.zeros(robot.model.nv)
    rotors[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
    inertia = _joint_inertia(robot, motion.q) + np.diag(rotors)  # (T, nv, nv)
    held = tree_forces(robot, motion) + rotors * motion.a
    return PlatformDynamics(
        mass=N.transpose(0, 2, 1) @ inertia @ N,
        bias=np.einsum("tvn,tv->tn", N, held),
        motors=robot.gear_ratio[:, None] * N[:, robot.actuated],
    )


def _joint_inertia(robot: ParallelRobot, q: Array) -> Array:
    """Compute the joint-space inertia of the open tree (T, nv, nv)."""
    model = robot.model
    data = model.createData()
    upper = np.array([pin.crba(model, data, row).copy() for row in q])
    upper = np.triu(upper)
    return upper + np.triu(upper, 1).transpose(0, 2, 1)
