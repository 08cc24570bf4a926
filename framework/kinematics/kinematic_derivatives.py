"""Exact derivatives of the pose and of A, B, C along the motors and along the springs, loops closed.

With F = [platform - x ; closures] and the motors held, the passive joints close what a deflection opens,
P dq_p = -dc, and the platform goes along; with the platform held instead, all joints follow. A, B and C
change with the wrenches and the screws that make dF/dq (`jacobian_change`), in the basis of
`matrices_and_rates`.

Springs are whatever joints stand beside those of the robot: the geometric parameters of a robot are those of
`framework.identification.geometry.geometry_of(robot).model`, and these are the derivatives along them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays
from framework.errors import SingularPose, point
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.forward_kinematics import check_motors_are_free
from framework.kinematics.frame_variations import bracket, tree_columns
from framework.kinematics.inverse_kinematics import require_mobility
from framework.kinematics.linearised_loops import ClosedStack, assembled_at
from framework.kinematics.loop_matrices import find_near_type2
from framework.kinematics.motion_changes import solve_rates
from framework.kinematics.motion_rates import jacobian_change
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import matrices_and_changes
from framework.tolerances import RANK_LOST


@dataclass(frozen=True, eq=False)
class PoseSlopes(ReadOnlyArrays):
    """Derivatives of a pose along k joints: of joints q, platform x, and A, B, C of `velocity_matrices`."""

    q: Array  # (nv, k) along pinocchio's velocity vector
    x: Array  # (n, k) of the platform's coordinates [m, rad]
    A: Array  # (k, m, n)
    B: Array  # (k, m, n_a)
    C: Array  # (k, m, n_e)


@dataclass(frozen=True, eq=False)
class KinematicDerivatives(ReadOnlyArrays):
    """Derivatives at one pose, idle joints held.

    Attributes:
        motors: along the motors' joints, joint side of the gears; deflections held.
        springs: along the deflections q_e; motors held.
        q_a: (n_a, n_e) of the motors' joints along the deflections, with the platform held.
    """

    motors: PoseSlopes
    springs: PoseSlopes
    q_a: Array


def kinematic_derivatives(robot: ParallelRobot, q: ArrayLike | Configuration) -> KinematicDerivatives:
    """Compute how the pose at q (nq,) depends on the motors and on the deflections of springs.

    Loop equations that springs alone can close stay open, such as those of planar robots across their plane.

    Raises:
        InvalidInput: q is not assembled; motors that depend on one another, or a platform that does not
            determine the joints.
        SingularPose: the motors do not hold the robot there (Type 2): they do not tell the pose.
        NotAssembled: the platform does not determine the joints there (Type 1).
    """
    closed = assembled_at(robot, q)
    require_mobility(robot)
    check_motors_are_free(robot)
    linearised, n_e = closed.linearised, robot.n_e
    if len(find_near_type2(robot, linearised, RANK_LOST)):
        raise SingularPose(
            f"{robot.name}: at {', '.join(robot.axis_names)} = {point(closed.x[0])} the motors do not hold "
            f"the robot (Type 2), and the pose has no derivative along them",
            platform=closed.x[0],
        )
    nothing = np.zeros((1, n_e, robot.n + len(robot.loops.names)))
    held = solve_rates(robot, linearised, nothing, robot.elastic, np.eye(n_e)[None])[0]
    return KinematicDerivatives(
        motors=_slopes(robot, closed, robot.actuated),
        springs=_slopes(robot, closed, robot.elastic),
        q_a=held[:, robot.actuated].T,
    )


def _slopes(robot: ParallelRobot, closed: ClosedStack, columns: IntArray) -> PoseSlopes:
    """Compute the slopes along k joints of the velocity vector, which the passive joints follow."""
    k = len(columns)
    steps = np.eye(robot.model.nv)[columns]
    if len(robot.following):
        opened = closed.linearised.closures[0][:, columns].T
        steps[:, robot.following] = -closed.linearised.passive_factors.solve(opened[:, None])[:, 0]
    linearised, tree = closed.linearised.select(np.zeros(k, dtype=np.intp)), tree_columns(robot)
    screws = linearised.frames.screws
    stepped = screws * steps[..., None]
    before = tree.before.T.astype(float) @ stepped
    changes = jacobian_change(robot, linearised, linearised.frames.carried @ stepped, bracket(before, screws))
    matrices = matrices_and_changes(robot, linearised, changes)[1]
    twist = closed.linearised.platform[0] @ steps.T
    x = np.linalg.solve(robot.platform.rate_matrix(closed.x)[0], twist)
    return PoseSlopes(steps.T, x, *matrices)
