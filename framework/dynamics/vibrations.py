"""Frequencies of a robot on its springs, motors free to turn: regular at Type 2 too.

With locked motors the first frequency vanishes there, see `dynamics.stiffness.locked_motor_frequency`.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.stiffness import mass_matrices
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import scaled_loops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array


def free_motor_frequency(robot: ParallelRobot, q: Array) -> Array:
    """Compute the first natural frequency (T,) [Hz], motors free to turn, at assembled q (T, nq).

    With Z what the loops allow, Z'KZ z = omega^2 Z'MZ z; M carries the rotors, K the springs that make the
    robot flexible. The motors are free, so that as many modes as the robot has degrees of freedom have no
    frequency and are left out. Motions without mass have an infinite one; all are infinite without springs.

    Raises:
        numpy.linalg.LinAlgError: a motion has neither mass nor stiffness.
    """
    from scipy.linalg import eigh

    if not robot.n_e:
        return np.full(len(q), np.inf)
    scale = robot.column_scale
    stiffness = np.zeros(robot.model.nv)
    stiffness[robot.elastic] = robot.stiffness
    loops = scaled_loops(robot, linearised_at(robot, q, None))
    frequency = np.empty(len(q))
    for k, tree_mass in enumerate(mass_matrices(robot, q)):
        null = np.linalg.svd(loops[k])[2][len(loops[k]) :].T  # (nv, d) what the loops allow
        Z = scale[:, None] * null
        mass = Z.T @ (tree_mass + np.diag(robot.rotors)) @ Z
        springs = Z.T @ (stiffness[:, None] * Z)
        # M singular (massless parts) and K singular (rigid motions): 1 / (omega^2 + shift) is finite for both
        shift = float(np.trace(springs) / max(np.trace(mass), np.finfo(float).tiny))
        shares = eigh(mass, springs + shift * mass, eigvals_only=True)[::-1]
        first = float(shares[Z.shape[1] - robot.n_e])
        frequency[k] = np.sqrt(max(1.0 / first - shift, 0.0)) / (2.0 * np.pi) if first > 0.0 else np.inf
    return frequency
