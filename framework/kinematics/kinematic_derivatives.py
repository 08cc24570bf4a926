"""Exact derivatives of the pose and of A, B, C along the motors and along the springs, loops closed.

F = [platform - x ; closures]. If the motors rest while a deflection changes the closures by dc, the passive
joints close them, P dq_p = -dc, and the platform moves. If the platform rests, all joints follow the
deflection. The derivatives of A, B and C follow from those of dF/dq (`jacobian_rates`), with the choice of
rows of `matrices_and_rates`.

Springs may be any joints added to those of a robot. The geometric parameters of a robot are the springs of
`framework.identification.geometry.parametrise_geometry(robot).model`, so this module also computes
derivatives along geometric parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import SingularPose
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.forward_kinematics import check_motors_are_free
from framework.kinematics.inverse_kinematics import require_mobility
from framework.kinematics.linearised_loops import ClosedStack, assembled_at
from framework.kinematics.loop_matrices import find_near_type2
from framework.kinematics.motion_rates import jacobian_rates, moving_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import matrices_and_derivatives
from framework.numerics.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays


@dataclass(frozen=True, eq=False)
class PoseSlopes(ReadOnlyArrays):
    """Derivatives of joints q, platform x and `velocity_matrices` A, B, C of a pose along k joints."""

    q: Array  # (nv, k) as tangent vectors
    x: Array  # (n, k) of the platform's coordinates [m, rad]
    A: Array  # (k, m, n)
    B: Array  # (k, m, n_a)
    C: Array  # (k, m, n_e)


@dataclass(frozen=True, eq=False)
class KinematicDerivatives(ReadOnlyArrays):
    """Derivatives at one pose, with idle joints at rest.

    Attributes:
        motors: along the motors' joints, joint side of the gears, at constant deflections.
        springs: along the deflections q_e, motors at rest.
        q_a: (n_a, n_e) of the motors' joints along the deflections, platform at rest.
    """

    motors: PoseSlopes
    springs: PoseSlopes
    q_a: Array


def kinematic_derivatives(robot: ParallelRobot, q: ArrayLike | Configuration) -> KinematicDerivatives:
    """Compute the derivatives of a pose q (nq,) along motors and springs.

    Loop equations that only springs can close stay open, for instance those of a planar robot for motions out
    of its plane.

    Raises:
        InvalidInput: q is not assembled; no motor can move alone; or the platform does not determine the
        joints. SingularPose: the motors do not determine the pose (Type 2). NotAssembled: the platform does
        not determine the joints (Type 1).
    """
    closed = assembled_at(robot, q)
    require_mobility(robot)
    check_motors_are_free(robot)
    linearised = closed.linearised
    if len(find_near_type2(robot, linearised)):
        raise SingularPose(
            f"{robot.name}: at {robot.place(closed.x[0])} the motors do not hold "
            f"the robot (Type 2), and the pose has no derivative along them",
            platform=closed.x[0],
        )
    # (n_e, 1, n + m) changes of F by a unit deflection of each spring
    gaps = np.moveaxis(linearised.jacobian[:, :, robot.elastic], 2, 0)
    joints = -moving_rates(robot, linearised, gaps)[:, 0]  # (n_e, moving), motors first
    return KinematicDerivatives(
        motors=_pose_derivatives(robot, closed, robot.actuated),
        springs=_pose_derivatives(robot, closed, robot.elastic),
        q_a=joints[:, : robot.n_a].T,
    )


def _pose_derivatives(robot: ParallelRobot, closed: ClosedStack, columns: IntArray) -> PoseSlopes:
    """Compute the derivatives of pose and matrices along k joints; passive joints close the loops."""
    linearised = closed.linearised
    steps = np.eye(robot.nv)[columns]  # (k, nv) unit rates of the joints
    if len(robot.following):
        gaps = linearised.closures[0][:, columns].T  # (k, m) rates at which these joints open the loops
        steps[:, robot.following] = -linearised.passive_factors.solve(gaps[:, None])[:, 0]
    copies = linearised.select(np.zeros(len(columns), dtype=np.intp))  # the same pose for each joint
    jacobian_slopes, _ = jacobian_rates(robot, copies, steps)
    _, slopes = matrices_and_derivatives(robot, copies, jacobian_slopes)
    twists = linearised.platform[0] @ steps.T  # (n, k)
    dx = np.linalg.solve(robot.platform.rate_matrix(closed.x)[0], twists)  # v = E dx
    return PoseSlopes(steps.T, dx, *slopes)
