"""Natural frequencies of an elastic robot with motors that turn freely, regular at Type 2.

With locked motors the first frequency vanishes at Type 2, see `dynamics.stiffness.locked_motor_frequency`.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.forces import mass_matrices
from framework.kinematics.linearised_loops import linearised_at, scaled_loops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array


def free_motor_frequency(robot: ParallelRobot, q: Array) -> Array:
    """Compute the first natural frequency (T,) [Hz] with free motors at assembled q (T, nq).

    The frequencies solve Z'KZ z = omega^2 Z'MZ z, where Z spans the motions that the loops allow, M includes
    the rotors, and K has the springs that make the robot flexible. Rigid motions, one for each degree of
    freedom of the rigid robot, have no frequency and are left out. A motion without mass has an infinite
    frequency. Without springs the result is infinite.

    Raises:
        numpy.linalg.LinAlgError: a motion has neither mass nor stiffness.
    """
    from scipy.linalg import eigh

    if not robot.n_e:
        return np.full(len(q), np.inf)
    stiffness = np.zeros(robot.nv)
    stiffness[robot.elastic] = robot.stiffness
    loops = scaled_loops(robot, linearised_at(robot, q, None))
    frequency = np.empty(len(q))
    for k, tree_mass in enumerate(mass_matrices(robot, q)):
        _U, _values, V_rows = np.linalg.svd(loops[k])
        null = V_rows[len(loops[k]) :].T  # (nv, d)
        Z = robot.column_scale[:, None] * null
        mass = Z.T @ (tree_mass + np.diag(robot.rotors)) @ Z
        springs = Z.T @ (stiffness[:, None] * Z)
        # mass is singular for massless parts, springs for rigid motions; the eigenvalues
        # mu = 1 / (omega^2 + shift) are finite for both
        shift = np.trace(springs) / max(np.trace(mass), np.finfo(float).tiny)
        mu = eigh(mass, springs + shift * mass, eigvals_only=True)  # ascending, the n_e vibrations first
        first = mu[robot.n_e - 1]
        frequency[k] = np.sqrt(max(1.0 / first - shift, 0.0)) / (2.0 * np.pi) if first > 0.0 else np.inf
    return frequency
