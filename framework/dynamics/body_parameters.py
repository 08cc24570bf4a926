"""The inertial parameters of a robot's bodies, and the derivatives of the open tree's forces by them.

Each moving body has ten parameters (m, m c, I about the origin of its joint) on the axes of its link. Forces
are linear in them, r = Y(q, v, a) pi, with Y from pinocchio's `computeJointTorqueRegressor`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from framework.kinematics.frames import scratch_of
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.motion_rates import Motion
from framework.kinematics.tree_model import link_axes, link_of
from framework.numerics.arrays import Array, IntArray, read_only

INERTIAL = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_ENTRIES = np.tril_indices(3)  # rows and columns in I of Ixx, Ixy, Iyy, Ixz, Iyz, Izz


@lru_cache(maxsize=64)
def body_parameters(robot: Mechanism) -> tuple[tuple[str, ...], Array]:
    """Return names LINK.mass, LINK.mx .. LINK.Izz, and values (p,), of all moving bodies.

    A body is the link behind a joint, with all parts fixed to it. The values are mass [kg], mass times the
    position of the centre of mass [kg m] and inertia [kg m^2] about the joint's origin, on the link's axes.
    """
    bodies = range(1, robot.model.njoints)
    names = [f"{link_of(robot.model, j)}.{parameter}" for j in bodies for parameter in INERTIAL]
    return tuple(names), read_only(np.concatenate([link_parameters(robot.model, j) for j in bodies]))


def tree_regressor(robot: Mechanism, motion: Motion, bodies: IntArray | None = None) -> Array:
    """Compute Y (T, nv, 10 b), the derivatives of the open tree's forces by inertial parameters.

    Args:
        motion: positions, velocities and accelerations of all joints at T instants.
        bodies: (b,) pinocchio indices of the joints that carry the bodies; all bodies by default.
    """
    model = robot.model
    data = scratch_of(robot).data
    bodies = np.arange(1, model.njoints) if bodies is None else bodies
    regressor = np.empty((len(motion.q), model.nv, len(bodies), 10))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        all_columns = pin.computeJointTorqueRegressor(model, data, q, v, a)  # (nv, 10 (njoints - 1))
        regressor[k] = all_columns.reshape(model.nv, -1, 10)[:, bodies - 1]
    # pinocchio's parameters are on the axes of joints, those of this package on the axes of links
    transforms = _link_to_joint_transforms(robot)[bodies - 1]  # (b, 10, 10)
    on_link_axes = regressor[:, :, :, None] @ transforms
    return on_link_axes.reshape(*regressor.shape[:2], -1)


@lru_cache(maxsize=64)
def _link_to_joint_transforms(robot: Mechanism) -> Array:
    """Return the matrices (bodies, 10, 10) from parameters on link axes to parameters on joint axes."""
    joints = range(1, robot.model.njoints)
    return np.stack([parameter_transform(link_axes(robot.model, j)) for j in joints])


def link_parameters(model: pin.Model, j: int) -> Array:
    """Return the inertial parameters (10,) of joint j's body on link axes, about the joint's origin."""
    return link_axes(model, j).actInv(model.inertias[j]).toDynamicParameters()


def pseudo_inertia(parameters: Array) -> Array:
    """Return the pseudo-inertia (..., 4, 4) of inertial parameters (..., 10), in the order of `INERTIAL`.

    It is [[S, m c], [(m c)', m]] with the mass m, the centre of mass c, the inertia I and the second moments
    S = int r r' dm = tr(I) / 2 - I. It is positive semidefinite if and only if the body is physically
    possible (Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3(1), 2018).
    """
    rows, columns = _ENTRIES
    inertia = np.zeros((*parameters.shape[:-1], 3, 3))
    inertia[..., rows, columns] = inertia[..., columns, rows] = parameters[..., 4:]
    half_trace = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)

    matrix = np.zeros((*parameters.shape[:-1], 4, 4))
    matrix[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - inertia
    matrix[..., :3, 3] = matrix[..., 3, :3] = parameters[..., 1:4]
    matrix[..., 3, 3] = parameters[..., 0]
    return matrix


def from_pseudo_inertia(matrix: Array) -> Array:
    """Return the inertial parameters (..., 10) of a pseudo-inertia (..., 4, 4), with I = tr(S) - S."""
    rows, columns = _ENTRIES
    second_moments = matrix[..., :3, :3]
    trace = np.trace(second_moments, axis1=-2, axis2=-1)
    inertia = trace[..., None, None] * np.eye(3) - second_moments
    mass, first_moments = matrix[..., 3, 3:], matrix[..., 3, :3]
    return np.concatenate([mass, first_moments, inertia[..., rows, columns]], axis=-1)


def parameter_transform(placement: pin.SE3) -> Array:
    """Return the matrix (10, 10) from parameters on a frame to parameters on its reference frame.

    With H = `placement`, the homogeneous matrix of the frame in its reference, the pseudo-inertia P becomes
    H P H'. This is linear in the parameters, so the columns of the matrix are the images of unit parameters.
    """
    H = placement.homogeneous
    return from_pseudo_inertia(H @ pseudo_inertia(np.eye(10)) @ H.T).T
