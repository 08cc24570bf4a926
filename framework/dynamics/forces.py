"""Generalised forces of the open tree, and what the loops, the springs and the motors make of them.

With r = RNEA(q, v, a) of the tree and the loop equations' Jacobian J,

    passive    0           = r_p - P' lambda           P = J's passive columns
    elastic    -K q_e      = r_e - J_e' lambda         the paper's Eq. (3b)
    actuated   tau_joint   = r_a - J_a' lambda         Eq. (3a) without the rotors

At a Type 2 singularity P eta = 0, so lambda exists only if eta . r_p = 0: condition (8) with the inertia
of all bodies, legs included. With massless legs eta . r_p = t_s . W_p, the paper's form.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.kinematics.assembly import passive_columns
from framework.kinematics.frames import offset
from framework.kinematics.inverse_kinematics import Motion
from framework.model import ParallelRobot


class Forces(NamedTuple):
    """Forces at T instants; joint side of the gears, rotors not included."""

    joint_torque: Array  # (T, n_a) [N m] or [N]
    spring_force: Array  # (T, n_e) force of the springs on the elastic coordinates, -K q_e
    passive: Array  # (T, n_p) r_p: what the passive joints ask of the loops


def tree_forces(robot: ParallelRobot, motion: Motion) -> Array:
    """RNEA of the open tree and the springs on its own joints, (T, nv)."""
    model = robot.model
    data = model.createData()
    forces: Array = np.empty((len(motion.q), model.nv))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        forces[k] = pin.rnea(model, data, q, v, a)
    if robot.joint_stiffness.any():
        turned = offset(robot, pin.neutral(model), motion.q)
        forces = forces + np.asarray(robot.joint_stiffness * (turned - robot.joint_rest), dtype=float)
    return forces


def loop_forces(robot: ParallelRobot, motion: Motion) -> Forces:
    """Joint torques and spring forces along a motion, instant by instant.

    An instant exactly on a Type 2 singularity divides 0 by 0 and comes out as infinite.
    """
    r = tree_forces(robot, motion)
    J = motion.system.closures
    columns = passive_columns(robot)
    P, passive = J[:, :, columns], r[:, columns]
    if P.shape[1] > P.shape[2]:
        held = r - np.einsum("tmv,tm->tv", J, _least_torque(robot, r, J, P))
        return Forces(held[:, robot.actuated], held[:, robot.elastic], passive)
    try:
        multipliers = np.linalg.solve(P.transpose(0, 2, 1), passive[..., None])  # (T, m, 1)
    except np.linalg.LinAlgError:
        multipliers = np.array([_solve_or_infinite(p.T, f) for p, f in zip(P, passive, strict=True)])
    held = r - np.einsum("tmv,tm->tv", J, multipliers[..., 0])
    return Forces(held[:, robot.actuated], held[:, robot.elastic], passive)


def _least_torque(robot: ParallelRobot, r: Array, J: Array, P: Array) -> Array:
    """Multipliers (T, m) of a robot with redundant motors: those of the least motor torques.

    P' lambda = r_p leaves m - n_p of them open; they are chosen so that the sum of squares of
    tau_joint / n, the motor torques without the rotors, is least.
    """
    transposed = P.transpose(0, 2, 1)
    some = np.linalg.pinv(transposed) @ r[:, passive_columns(robot), None]
    free = np.linalg.svd(transposed)[2][:, P.shape[2] :].transpose(0, 2, 1)  # (T, m, m - n_p)
    through_gear = J[:, :, robot.actuated].transpose(0, 2, 1) / robot.gear_ratio[:, None]
    wanted = r[:, robot.actuated, None] / robot.gear_ratio[:, None] - through_gear @ some
    return (some + free @ (np.linalg.pinv(through_gear @ free) @ wanted))[..., 0]


def _solve_or_infinite(matrix: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(matrix, right[:, None]))
    except np.linalg.LinAlgError:
        return np.full((len(right), 1), np.inf)


def motor_torque(robot: ParallelRobot, motion: Motion, joint_torque: Array) -> Array:
    """Torque (T, n_a) [N m] on the motor side: rotor inertia and joint torque through the gear.

    tau = I_a n ddq_a + tau_joint / n, Eqs. (3a) and (11c), with n the gear ratio and ddq_a on the
    joint side.
    """
    n = robot.gear_ratio
    return robot.rotor_inertia * n * motion.a[:, robot.actuated] + joint_torque / n
