"""Motor torques by virtual work under wrenches of the world, written anew: a witness of plans.

Of the robot its tree, its index sets and the words of its file are taken, as in `equations_of_motion`. Along
every motion Z that the closures allow, the motors' work is that of inertia, weight, springs and damping less
that of the world's wrenches w on their frames:

    Z' S n tau = Z' (M a + h + K (q - rest) + D v - J' w).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework import CrossingPlan
from tests.oracles.closure_rows import closure_rows, frame_of
from tests.oracles.forward_simulation import kinematics, mass_matrix, motors, rotors, springs


class VirtualWork(NamedTuple):
    """The torques that do the work at T instants, and what the plan's leave of it."""

    torque: np.ndarray  # (T, n_a) [N m], motor side
    left: float  # the largest work that the plan's torques leave, over the largest of its terms


def virtual_work(plan: CrossingPlan, t: np.ndarray, wrenches: Mapping[str, np.ndarray]) -> VirtualWork:
    """Of a plan at instants t (T,) under wrenches (T, 6) by frame, on base axes."""
    robot, dynamics = plan.robot, plan.dynamics
    model, data = robot.model, robot.model.createData()
    q, v, a, planned = (
        dynamics.configuration(t),
        dynamics.velocity(t),
        dynamics.velocity(t, 2),
        dynamics.torque(t),
    )
    driven = np.array([motors(robot, unit) for unit in np.eye(robot.n_a)]).T  # (nv, n_a)
    torque, left, size = np.empty_like(planned), [], []
    for k in range(len(t)):
        kinematics(model, data, q[k], v[k])
        J = closure_rows(model, data, robot.description.closures).jacobian
        terms = [(mass_matrix(model, data, q[k]) + np.diag(rotors(robot))) @ a[k]]
        terms += [pin.nonLinearEffects(model, data, q[k], v[k]), -springs(robot, q[k])]
        terms += [robot.joint_damping * v[k]]
        for frame, wrench in wrenches.items():
            axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            terms.append(
                -pin.computeFrameJacobian(model, data, q[k], frame_of(model, frame), axes).T @ wrench[k]
            )
        values, right = np.linalg.svd(J)[1:]
        Z = right[np.sum(values > 1e-9 * values[0]) :].T / np.abs(right).max()
        load = Z.T @ np.sum(terms, axis=0)
        torque[k] = np.linalg.lstsq(Z.T @ driven, load, rcond=None)[0]
        left.append(np.abs(load - Z.T @ driven @ planned[k]).max())
        size.append(np.abs(Z).T @ np.abs(terms).max(axis=0))
    return VirtualWork(torque, float(np.max(left) / np.max(size)))
