"""Exact derivatives of the pose and of A, B, C along the motors and along geometric parameters, loops closed.

With F = [platform - x ; closures] and the motors held, the passive joints close what a parameter opens,
P dq_p = -dc, and the platform goes along; with the platform held instead, all joints follow. A, B and C
change with the wrenches and the screws that make dF/dq (`jacobian_change`), in the basis of
`matrices_and_rates`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays
from framework.errors import SingularPose, point
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.forward_kinematics import check_motors_are_free
from framework.kinematics.frame_variations import bracket, tree_columns
from framework.kinematics.geometric_parameters import (
    GeometricParameters,
    equation_slopes,
    geometric_parameters,
)
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import ClosedStack, assembled_at
from framework.kinematics.loop_matrices import near_type_2
from framework.kinematics.motion_changes import solved_rates
from framework.kinematics.motion_rates import jacobian_change
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import VelocityMatrices, matrices_and_changes
from framework.tolerances import RANK_LOST


@dataclass(frozen=True, eq=False)
class PoseSlopes(ReadOnlyArrays):
    """Derivatives of a pose along k numbers: of joints q, platform x, and A, B, C of `velocity_matrices`."""

    q: Array  # (nv, k) along pinocchio's velocity vector
    x: Array  # (n, k) of the platform's coordinates [m, rad]
    A: Array  # (k, m, n)
    B: Array  # (k, m, n_a)
    C: Array  # (k, m, n_e)


@dataclass(frozen=True, eq=False)
class KinematicDerivatives(ReadOnlyArrays):
    """Derivatives at one pose; deflections and idle joints held.

    motors: along the motors' joints, joint side of the gears.
    parameters: along p geometric parameters with the motors held; their `names` are JOINT.x .. JOINT.rz and
        FRAME.x .. FRAME.rz, see `geometric_parameters`.
    regressor: (n + m, p) of F, platform and independent loop equations, with all joints held.
    q_a: (n_a, p) of the motors' joints along the parameters, with the platform held.
    """

    motors: PoseSlopes
    parameters: PoseSlopes
    names: tuple[str, ...]
    regressor: Array
    q_a: Array


def kinematic_derivatives(robot: ParallelRobot, q: ArrayLike | Configuration) -> KinematicDerivatives:
    """Compute how the pose at q (nq,) depends on the motors and on geometric parameters.

    Raises:
        InvalidInput: q is not assembled; motors that depend on one another, or a platform that does not
            determine the joints.
        SingularPose: the motors do not hold the robot there (Type 2): they do not tell the pose.
        NotAssembled: the platform does not determine the joints there (Type 1).
    """
    closed = assembled_at(robot, q)
    require_square(robot)
    check_motors_are_free(robot)
    linearised, n = closed.linearised, robot.n
    if len(near_type_2(robot, linearised, RANK_LOST)):
        raise SingularPose(
            f"{robot.name}: at {', '.join(robot.axis_names)} = {point(closed.x[0])} the motors do not hold "
            f"the robot (Type 2), and the pose has no derivative along them",
            platform=closed.x[0],
        )
    parameters = geometric_parameters(robot, closed.q[0])
    regressor = equation_slopes(robot, linearised, parameters.displacements)  # (n + m, p)
    nothing = np.empty(0, dtype=np.intp)
    motors = _followed(robot, closed, np.eye(robot.n_a), np.zeros((robot.n_a, regressor.shape[0])))
    passive = _followed(robot, closed, np.zeros((regressor.shape[1], robot.n_a)), regressor.T)
    held = solved_rates(robot, linearised, -regressor.T[None], nothing, np.zeros((1, 1, 0)))[0]
    none = GeometricParameters((), np.zeros((robot.n_a, 6)), *_no_places(robot, robot.n_a))
    return KinematicDerivatives(
        motors=_slopes(robot, closed, motors, none, np.zeros((n, robot.n_a))),
        parameters=_slopes(robot, closed, passive, parameters, regressor[:n]),
        names=parameters.names,
        regressor=regressor,
        q_a=held[:, robot.actuated].T,
    )


def _followed(robot: ParallelRobot, closed: ClosedStack, motors: Array, opened: Array) -> Array:
    """Compute joint steps (k, nv) for steps of the motors (k, n_a) while F changes by itself, (k, n + m)."""
    steps = np.zeros((len(motors), robot.model.nv))
    steps[:, robot.actuated] = motors
    if len(robot.following):
        loops = opened[:, robot.n :] + motors @ closed.linearised.closures[0][:, robot.actuated].T
        steps[:, robot.following] = -closed.linearised.passive_factors.solve(loops[:, None])[:, 0]
    return steps


def _slopes(
    robot: ParallelRobot, closed: ClosedStack, steps: Array, parameters: GeometricParameters, moved: Array
) -> PoseSlopes:
    """Compute the slopes for joint steps (k, nv) beside parameters, which move the platform by (n, k)."""
    k = len(steps)
    linearised, tree = closed.linearised.at(np.zeros(k, dtype=np.intp)), tree_columns(robot)
    frames = linearised.frames
    stepped = frames.screws * steps[..., None]
    displaced = frames.carried @ stepped + parameters.displacements
    before = (
        tree.before.T.astype(float) @ stepped + parameters.screws[:, None] * parameters.columns[..., None]
    )
    changes = jacobian_change(robot, linearised, displaced, bracket(before, frames.screws))
    matrices: VelocityMatrices = matrices_and_changes(robot, linearised, changes)[1]
    twist = closed.linearised.platform[0] @ steps.T + moved
    x = np.linalg.solve(robot.platform.rate_matrix(closed.x)[0], twist)
    return PoseSlopes(steps.T, x, *matrices)


def _no_places(robot: ParallelRobot, count: int) -> tuple[BoolArray, BoolArray]:
    """Return that k parameters displace nothing."""
    return (
        np.zeros((count, len(robot.frames)), dtype=bool),
        np.zeros((count, robot.model.nv), dtype=bool),
    )
