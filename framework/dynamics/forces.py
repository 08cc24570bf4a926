"""Generalised forces of the open tree, the forces that balance them, and their first-order changes.

r is the inverse dynamics of the tree (RNEA) less the generalised forces of external wrenches, J is the
Jacobian of the loop equations, and lambda are the forces in the loops. Then

    passive    0           = r_p - P' lambda           P: the passive columns of J
    elastic    -K q_e      = r_e - J_e' lambda         the paper's Eq. (3b)
    actuated   tau_joint   = r_a - J_a' lambda         Eq. (3a) without the rotors

At a Type 2 singularity P eta = 0 for some joint rates eta, so lambda exists only if eta . r_p = 0. This is
condition (8) with the inertia of all bodies, legs included, and with external wrenches. With massless legs
eta . r_p = t_s . W_p, the form in the paper (Briot and Arakelian 2010).

To first order and at constant lambda, a change of the motion changes the right sides by

    d(r - J' lambda) = dr/dq dq + dr/dv dv + M da - (d(J' lambda)/dq) dq.

lambda may stay constant because J' dlambda does no work along motions that keep the loops closed. dr/dq,
dr/dv and the mass matrix M come from pinocchio's `computeRNEADerivatives`.
"""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from framework.kinematics.closures import loop_force_changes
from framework.kinematics.external_wrenches import AppliedWrench, wrench_slope
from framework.kinematics.frames import difference, forces_on_joints, forces_on_joints_slope, scratch_of
from framework.kinematics.line_springs import Lines, lines_at
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import Motion, MotionChanges, freeze_deflections, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, mirror_upper
from framework.numerics.ordered_sums import matvec, solve


class Forces(NamedTuple):
    """Forces at T instants; joint side of the gears, rotors not included."""

    joint_torque: Array  # (T, n_a) [N m] or [N]
    spring_force: Array  # (T, n_e) force -K q_e of the springs on the elastic coordinates


class JointMotion(Protocol):
    """Positions q (T, nq), velocities v and accelerations a (T, nv) of all joints; external wrenches."""

    @property
    def q(self) -> Array: ...
    @property
    def v(self) -> Array: ...
    @property
    def a(self) -> Array: ...
    @property
    def wrenches(self) -> tuple[AppliedWrench, ...]: ...


def tree_forces(robot: ParallelRobot, motion: JointMotion) -> Array:
    """Compute the generalised forces r (T, nv) of the open tree: inverse dynamics less external wrenches.

    They include gravity, armature, and springs and damping of joints and between points. For a robot without
    `elastic_inertia`, deflections count as constant.
    """
    inertial = _inertial_motion(robot, motion)
    forces = _rnea(robot.model, inertial)
    if robot.joint_stiffness.any():
        forces += spring_torques(robot, inertial.q, robot.joint_stiffness)
    if robot.is_damped:
        forces += robot.joint_damping * inertial.v
    if robot.line_springs.names:
        forces += lines_at(robot, inertial.q).forces(inertial.v)
    for wrench in motion.wrenches:
        forces -= wrench.generalised
    return forces


def static_forces(robot: ParallelRobot, q: Array, wrenches: tuple[AppliedWrench, ...] = ()) -> Array:
    """Compute the forces r (T, nv) of the open tree at rest at q (T, nq).

    They are those of gravity, and of springs on joints and between points, less external wrenches
    (`tree_forces` without motion).
    """
    forces = np.empty((len(q), robot.nv))
    data = scratch_of(robot).data
    for k in range(len(q)):
        forces[k] = pin.computeGeneralizedGravity(robot.model, data, q[k])
    if robot.joint_stiffness.any() or robot.line_springs.names:
        forces += all_spring_forces(robot, q, robot.joint_stiffness)
    for wrench in wrenches:
        forces -= wrench.generalised
    return forces


def inertial_forces(robot: ParallelRobot, motion: JointMotion) -> Array:
    """Compute the forces (T, nv) of inertia of bodies and armature, a part of `tree_forces`.

    It is linear in accelerations and quadratic in rates. A difference of `tree_forces` with and without
    motion would lose digits where gravity dominates.
    """
    return _rnea(robot.weightless, _inertial_motion(robot, motion))


def _inertial_motion(robot: ParallelRobot, motion: JointMotion) -> JointMotion:
    """Return the motion that causes inertial forces: without `elastic_inertia`, deflections are constant."""
    if robot.n_e and not robot.elastic_inertia:
        return freeze_deflections(robot, motion.q, motion.v, motion.a)
    return motion


def _rnea(model: pin.Model, motion: JointMotion) -> Array:
    """Compute the inverse dynamics (T, nv) of the tree's bodies by the recursive Newton-Euler algorithm.

    Args:
        model: `robot.model`, or its copy without gravity, `robot.weightless`.
    """
    pool = _model_pool(model, threading.get_ident())
    if pool.getModel(0) != model:  # the pool has a copy, and the model was changed in place since
        _model_pool.cache_clear()
        pool = _model_pool(model, threading.get_ident())
    forces = np.empty((len(motion.q), model.nv))
    # one call for the stack: instants are columns, of arrays in column order, and one thread computes them
    pin.rneaInParallel(1, pool, motion.q.T, motion.v.T, motion.a.T, forces.T)
    return forces


@lru_cache(maxsize=16)  # of several megabytes each
def _model_pool(model: pin.Model, thread: int) -> pin.ModelPool:
    """Copy a model into a pool with working memory for one call at a time, in each `thread` its own."""
    return pin.ModelPool(model, 1)


def mass_matrices(robot: ParallelRobot, q: Array) -> Array:
    """Compute the mass matrices (T, nv, nv) of the open tree at q (T, nq), rotors not included."""
    model = robot.model
    data = scratch_of(robot).data
    upper = np.empty((len(q), model.nv, model.nv))
    for k in range(len(q)):
        upper[k] = pin.crba(model, data, q[k])
    return mirror_upper(upper)


def spring_torques(robot: ParallelRobot, q: Array, stiffness: Array) -> Array:
    """Compute the torques K (q - rest) (T, nv) that hold springs of stiffness (nv,) at q (T, nq).

    q - rest is a tangent vector at the neutral configuration; its force is then moved to the joints at q.
    """
    offset = difference(robot, robot.neutral, q)
    return forces_on_joints(robot, robot.neutral, q, stiffness * (offset - robot.joint_rest))


def all_spring_forces(robot: ParallelRobot, q: Array, stiffness: Array) -> Array:
    """Compute the forces (T, nv) of springs on joints and between points at q (T, nq)."""
    forces = spring_torques(robot, q, stiffness) if stiffness.any() else np.zeros((len(q), robot.nv))
    return forces + lines_at(robot, q).forces() if robot.line_springs.names else forces


def damping_forces(robot: ParallelRobot, q: Array, v: Array) -> Array:
    """Compute the damping forces (T, nv) of joints and between points at q (T, nq) and rates v (T, nv)."""
    forces: Array = robot.joint_damping * v
    return forces + lines_at(robot, q).damping_forces(v) if robot.line_springs.names else forces


def joint_forces(robot: ParallelRobot, motion: Motion) -> Forces:
    """Compute joint torques (T, n_a) and spring forces (T, n_e) that balance a motion's tree forces."""
    return balanced_forces(robot, motion.linearised, tree_forces(robot, motion))


def balanced_forces(robot: ParallelRobot, linearised: LinearisedLoops, r: Array) -> Forces:
    """Compute the forces of motors and springs that balance forces r (T, nv) of the open tree.

    If the motors were free, a wrench w on the platform would balance r. Column k of M is the wrench that
    would balance a unit torque of motor k alone. The motor torques tau make both wrenches equal:

        F' [w; lambda_0] = r        F' [M; Lambda] = unit torques of the motors        M tau = w

    F is the Jacobian of platform and loop equations along actuated and passive joints. It is regular at Type
    2 and already factored. M = (dq_a/dx)' (n, n_a) is singular at Type 2; only there the torques are infinite
    or 0 / 0. With redundant motors the sum of squares of the motor-side torques is least. The loop forces are
    lambda = lambda_0 - Lambda tau, and the springs take r_e - J_e' lambda.
    """
    torques, of_tree, of_motors = _balance(robot, linearised, r[None])
    torque = torques[0]
    if not robot.n_e:
        return Forces(torque, np.zeros((len(r), 0)))

    with np.errstate(invalid="ignore"):  # an infinite torque gives NaN
        # [w; lambda_0] - [M; Lambda] tau
        multipliers = of_tree[0] - np.vecmat(torque, of_motors.swapaxes(0, 1))
    multipliers[:, : robot.n] = 0.0  # w - M tau is rounding
    to_springs = linearised.jacobian[:, :, robot.elastic].swapaxes(1, 2)  # (T, n_e, n + m)
    return Forces(torque, r[:, robot.elastic] - matvec(to_springs, multipliers))


def balancing_torques(robot: ParallelRobot, linearised: LinearisedLoops, r: Array) -> Array:
    """Compute joint torques (k, T, n_a) that balance k forces r (k, T, nv) of the open tree at each pose."""
    return _balance(robot, linearised, r)[0]


def _balance(robot: ParallelRobot, linearised: LinearisedLoops, r: Array) -> tuple[Array, Array, Array]:
    """Solve the equations of `balanced_forces` for k forces r (k, T, nv) at each pose.

    Returns:
        The torques (k, T, n_a); [w; lambda_0] (k, T, n + m); [M; Lambda] (n_a, T, n + m), transposed.
    """
    columns = robot.moving  # actuated, then passive
    count = len(r)
    # right sides for all r, then one for the unit torque of each motor
    right_sides = np.zeros((count + robot.n_a, *r.shape[1:2], len(columns)))
    right_sides[:count] = r.take(columns, axis=2)
    right_sides[count:, :, : robot.n_a] = np.eye(robot.n_a)[:, None]
    balancing = linearised.factors.solve(right_sides, transposed=True)  # (k + n_a, T, n + m)
    of_tree, of_motors = balancing[:count], balancing[count:]
    w = of_tree[:, :, : robot.n].transpose(1, 2, 0)  # (T, n, k)
    M = of_motors[:, :, : robot.n].transpose(1, 2, 0)  # (T, n, n_a)
    if robot.n_a == robot.n:
        torques = solve(M, w)  # (T, n_a, k)
    else:  # least in norm on the motor side
        torques = robot.gear_ratio[:, None] * least_motor_torques(robot, M * robot.gear_ratio, w)
    return torques.transpose(2, 0, 1), of_tree, of_motors


def loop_multipliers(
    robot: ParallelRobot, linearised: LinearisedLoops, r: Array, joint_torque: Array
) -> Array:
    """Solve r - S' tau_joint = X' w + J' lambda for [w; lambda] (T, n + m).

    w is the platform wrench missing for balance, and lambda are the forces of the independent loop equations.
    S selects the actuated columns, and X and J are the Jacobians of platform and loops.

    Args:
        r: (T, nv) forces of the open tree.
        joint_torque: (T, n_a) tau_joint.
    """
    right_side = r.take(robot.moving, axis=1)
    right_side[:, : robot.n_a] -= joint_torque
    return linearised.factors.solve(right_side, transposed=True)


def least_motor_torques(robot: ParallelRobot, matrix: Array, wrenches: Array) -> Array:
    """Solve matrix (T, n, n_a) @ torques = wrenches (..., T, n, k) for torques of least norm.

    Row i of the matrix contains the component of the platform wrench on axis i by unit motor torques, and k
    counts right sides. With the QR factorisation matrix' = Q R, the solution for redundant motors is
    Q R'^-1 wrenches. Rows of forces are multiplied by the robot's length, so that all rows are moments.
    Otherwise the moments of a small robot would lose digits beside its forces.

    Returns:
        Torques (..., T, n_a, k), motor side.
    """
    if robot.n_a == robot.n:
        return solve(matrix, wrenches)
    scale = robot.platform_scale[:, None]
    Q, R = np.linalg.qr((scale * matrix).swapaxes(1, 2))
    return Q @ solve(R.swapaxes(1, 2), scale * wrenches)


def internal_projectors(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the projectors (T, n_a, n_a) on motor torques that move nothing, motor side.

    Such torques of redundant motors strain the robot alone: they exert no wrench G' tau on the platform, with
    the motors' speeds G for unit twists. The QR factorisation G = Q R gives the projector 1 - Q Q'.
    """
    G, _rates = motor_speeds(robot, linearised)  # (T, n_a, n)
    Q = np.linalg.qr(robot.platform_scale * G)[0]
    return np.eye(robot.n_a) - Q @ Q.swapaxes(1, 2)


def motor_torque(robot: ParallelRobot, motion: Motion, joint_torque: Array) -> Array:
    """Compute the motors' torques (T, n_a) [N m] on the motor side from joint torques (T, n_a) and rotors.

    tau = I_a n ddq_a + tau_joint / n, Eqs. (3a) and (11c) of the paper, with the rotor inertia I_a, the gear
    ratio n, and ddq_a on the joint side.
    """
    n = robot.gear_ratio
    return robot.rotor_inertia * n * motion.a[:, robot.actuated] + joint_torque / n


def force_changes(robot: ParallelRobot, motion: Motion, multipliers: Array, changes: MotionChanges) -> Array:
    """Compute d(r - J' lambda) (3, T, k, nv) for k steps of positions, of rates and of accelerations.

    A step of positions with closed loops also changes rates and accelerations, and a step of rates also
    changes accelerations.

    Args:
        multipliers: (T, m) the constant lambda of the independent loop equations.
        changes: changes of q, v and a by unit steps of k coordinates.
    """
    linearised = motion.linearised
    dq = changes.q
    # derivatives of r by q, along tangent vectors, v and a, (T, nv, nv) each; mass: with armature, not rotors
    data = scratch_of(robot).data
    by_q, by_v, mass = np.empty((3, len(dq), robot.nv, robot.nv))
    for k, state in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        pin.computeRNEADerivatives(robot.model, data, *state)
        by_q[k] = data.dtau_dq
        by_v[k] = data.dtau_dv
        mass[k] = data.M
    if robot.joint_stiffness.any():
        by_q += forces_on_joints_slope(robot, robot.neutral, motion.q, robot.joint_stiffness)
    by_v += np.diag(robot.joint_damping)
    if robot.line_springs.names:
        lines = Lines.of(robot, linearised.frames)
        by_q += lines.force_slope(motion.v)
        by_v += lines.damping
    for wrench in motion.wrenches:
        by_q -= wrench_slope(robot, linearised.frames.screws, wrench)
    wrenches = linearised.wrenches[:, robot.n :]  # of the loop equations
    of_loops = loop_force_changes(
        robot, robot.spanning_loops, linearised.frames, wrenches, linearised.spread(multipliers), dq
    )

    # changes are rows, so slopes are transposed and on the right; the mass matrix is symmetric
    changed = changes.accelerations @ mass
    rate_changes = np.array([changes.v, dq])  # by steps of positions; dq also by unit steps of rates
    changed[:2] += rate_changes @ by_v.swapaxes(1, 2)
    changed[0] += dq @ by_q.swapaxes(1, 2) - of_loops  # steps of positions alone change positions
    return changed


def driven_force_changes(
    robot: ParallelRobot, motion: Motion, r: Array, joint_torque: Array, changes: MotionChanges
) -> Array:
    """Compute d(r - J' lambda + rotors + springs) (3, T, k, nv) for k steps.

    The first axis is for steps of positions, of rates and of accelerations, see `force_changes`.

    Args:
        r: the motion's `tree_forces` (T, nv).
        joint_torque: torques (T, n_a) of the motors, joint side; they determine the loop forces lambda.
    """
    multipliers = loop_multipliers(robot, motion.linearised, r, joint_torque)[:, robot.n :]
    changed = force_changes(robot, motion, multipliers, changes)
    changed += robot.rotors * changes.accelerations
    # springs resist steps of positions, the first ones
    changed[0][..., robot.elastic] += robot.stiffness * changes.q[..., robot.elastic]
    return changed
