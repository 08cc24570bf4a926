"""Consistent states: the loops are closed, and forces are in balance along motions without mass.

The loops may allow motions Z that move no mass: M Z = 0 and J Z = 0. An example is the stretch of a rod in
series with the twist of a gear, if the legs are massless. Such a motion has no initial value of its own.
Gravity and inertia vanish along it, so its coordinate follows from the balance of its springs,
Z' (S' n tau - K (q - rest) - D v) = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled, NotConverged
from framework.kinematics.closures import loop_curvature, loop_wrenches, scale_jacobian
from framework.kinematics.frames import integrate
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray
from framework.numerics.ordered_sums import matmul
from framework.simulation.equations import EquationsOfMotion, Tangent
from framework.simulation.schemes import State
from framework.simulation.world_forces import NO_FORCES, WorldForces
from framework.tolerances import EIGENVALUE_ROUNDING, LOOP_GAP

MAX_PASSES = 60  # Newton steps towards a consistent state
ROUNDING_STEP = 1e-14  # [rad, robot lengths]: a smaller Newton step is rounding, and the last one
# singular values below this share of the largest count as zero in least squares
CLOSING_CUTOFF, MOMENTUM_CUTOFF = 1e-12, 1e-13


class AllowedMotions(NamedTuple):
    """The motions that the loops allow at T states."""

    basis: Array  # (T, nv, d) joint rates of d independent motions, by ascending inertia
    light: BoolArray  # (T, d) whether a motion moves no mass; such motions come first
    closing: Array  # (T, nv, m) pseudo-inverse of J: the least motion that changes one loop equation by 1


def allowed_motions(equations: EquationsOfMotion, tangent: Tangent) -> AllowedMotions:
    """Compute the motions that the loops allow, the same to the last bit in every stack.

    The basis spans the null space Z of the loops' Jacobian J and diagonalises Z' M Z. Redundant rows are left
    out of J. A further loss of rank is a singularity of the closures and adds no allowed motion.
    """
    robot, rows = equations.robot, tangent.jacobian.shape[1]
    scale = robot.column_scale[:, None]  # (nv, 1)
    J = scale_jacobian(robot, tangent.jacobian, equations.rows.rotation)  # (T, m, nv)
    U, sizes, V_rows = np.linalg.svd(J)
    Z = V_rows[:, rows:].swapaxes(1, 2)  # (T, nv, d)
    mass = tangent.mass * scale * scale[:, 0]  # of joint rates over their scale
    reduced_mass = matmul(Z.swapaxes(1, 2), matmul(mass, Z))  # Z' M Z, (T, d, d)
    inertias, axes = np.linalg.eigh(reduced_mass)  # (T, d) ascending, (T, d, d)
    joint_inertias = np.diagonal(mass, axis1=1, axis2=2)  # (T, nv)
    all_inertias = np.concatenate([inertias, joint_inertias], axis=1)
    light = inertias <= EIGENVALUE_ROUNDING * all_inertias.max(axis=1, initial=0.0, keepdims=True)
    return AllowedMotions(
        basis=scale * matmul(Z, axes),
        light=light,
        closing=scale * (_pseudo_inverse(U, sizes, V_rows) / robot.loop_lengths),
    )


def _pseudo_inverse(left: Array, sizes: Array, right: Array) -> Array:
    """Compute pseudo-inverses (T, k, m), m <= k, from singular value decompositions.

    Args:
        left: left singular vectors (T, m, m), in columns.
        sizes: singular values (T, m).
        right: right singular vectors (T, k, k), in rows.
    """
    m = sizes.shape[1]
    rounding = np.finfo(float).eps * right.shape[1]
    is_nonzero = sizes > rounding * sizes.max(axis=1, initial=0.0, keepdims=True)
    inverse = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=is_nonzero)
    columns = right[:, :m].swapaxes(1, 2)  # (T, k, m)
    return matmul(columns * inverse[:, None], left.swapaxes(1, 2))


def free_motions(equations: EquationsOfMotion, tangent: Tangent) -> tuple[Array, Array]:
    """Compute bases of the allowed motions of one state, (nv, d) with mass and (nv, k) without."""
    allowed = allowed_motions(equations, tangent)
    basis, light = allowed.basis[0], allowed.light[0]
    return basis[:, ~light], basis[:, light]


def consistent_state(
    equations: EquationsOfMotion,
    q: Array,
    v: Array,
    torque: Array,
    world: WorldForces = NO_FORCES,
) -> State:
    """Find the consistent state next to q (nq,), v (nv,) by Newton's method.

    In a consistent state the loops are closed, and massless parts are in balance under motor torques (n_a,)
    [N m] and the external wrenches at t = 0.

    Raises:
        InvalidInput: a motion has neither mass nor stiffness nor damping; the message names its joints.
        NotAssembled: the loops do not close from q.
        NotConverged: the springs of massless parts find no balance.
    """
    robot, scale = equations.robot, equations.robot.column_scale
    driven = equations.motor_forces(torque[None])[0]
    size = np.inf
    for _ in range(MAX_PASSES):
        tangent = equations.tangent_at_rest(q)
        light = free_motions(equations, tangent)[1]
        # the least step that closes the loops
        loops = tangent.jacobian[0] * scale
        step = -np.linalg.lstsq(loops, tangent.residual[0], rcond=CLOSING_CUTOFF)[0] * scale
        if light.shape[1]:
            # sum of gravity, springs and damping minus motor and external forces
            unbalanced = tangent.force[0] + equations.damping * v - driven
            unbalanced -= world(robot, np.zeros(1), q[None])[0]
            step += light @ balancing_step(equations, tangent, light, unbalanced)
        size = float(np.abs(step / scale).max(initial=0.0))
        if not size < 1.0:
            break
        q = integrate(robot, q[None], step[None])[0]
        if size < ROUNDING_STEP:
            break
    tangent = equations.tangent_at_rest(q)
    gaps = np.abs(loop_wrenches(robot.rows, tangent.frames).residual[0])
    gap = float(gaps.max(initial=0.0))
    if not np.all(gaps <= LOOP_GAP * robot.row_lengths):
        raise NotAssembled(
            f"{robot.name}: the start is not assembled: a loop stays {gap:.3g} m or rad apart",
            q=q,
            residual=gap,
        )
    if not size < LOOP_GAP:
        raise NotConverged(
            f"{robot.name}: the springs of the massless parts find no balance at the start (the last Newton "
            f"step was {size:.3g} rad or robot lengths)",
            residual=size,
        )
    return State(q, allowed_velocity(equations, tangent, v))


def balancing_step(equations: EquationsOfMotion, tangent: Tangent, light: Array, unbalanced: Array) -> Array:
    """Compute the Newton step (k,) towards balance along massless motions `light` (nv, k).

    The step is -(light' (K - C) light)^-1 light' unbalanced. Here `unbalanced` (nv,) is the residual of the
    balance of forces, K the stiffness of the springs, and C the curvature of the loops under their forces. A
    motion with damping but no stiffness has no balance and keeps its initial value: the step is zero.

    Raises:
        InvalidInput: a motion has neither mass nor stiffness nor damping.
    """
    # loop forces that balance the other forces in the sense of least squares
    multipliers = np.linalg.lstsq(tangent.jacobian[0].T, unbalanced, rcond=None)[0]
    curvature = loop_curvature(equations.robot, equations.rows, tangent.frames, multipliers[None])[0]
    springs = light.T @ np.diag(equations.stiffness) @ light  # (k, k)
    dampers = light.T @ np.diag(equations.damping) @ light
    stiffest = (equations.stiffness * equations.robot.column_scale**2).max(initial=0.0)
    rounding = EIGENVALUE_ROUNDING * max(float(stiffest), LEAST_DIVISOR)
    if np.linalg.eigvalsh(springs + dampers)[0] <= rounding:
        raise _undetermined_motion_error(equations, light @ np.linalg.eigh(springs)[1][:, 0])
    if np.linalg.eigvalsh(springs)[0] <= rounding:
        return np.zeros(light.shape[1])
    slope = springs - light.T @ curvature @ light
    return -np.linalg.lstsq(slope, light.T @ unbalanced, rcond=None)[0]


def _undetermined_motion_error(equations: EquationsOfMotion, rates: Array) -> InvalidInput:
    """Return the error that names the joints of an undetermined motion, with rates (nv,)."""
    robot = equations.robot
    motion = np.abs(rates) / robot.column_scale
    largest = [int(k) for k in np.argsort(-motion) if motion[k] > 0.1 * motion.max()]
    joints = [robot.coordinates.name_of(k) for k in largest]
    return InvalidInput(
        f"{robot.name}, {robot.flexibility}: a motion of {', '.join(joints[:4])} has "
        f"neither mass nor stiffness, so its acceleration is undetermined; give these links an "
        f"<inertial>, the rotor an inertia, or a spring"
    )


def allowed_velocity(equations: EquationsOfMotion, tangent: Tangent, v: Array) -> Array:
    """Compute the velocity (nv,) that an impulse of the loop forces makes of v (nv,).

    The loops allow the new velocity v + dv. The equations are M dv + J' impulse = 0 and J (v + dv) = 0.
    """
    rows = len(equations.rows.names)
    if not rows:
        return v
    scale = equations.robot.column_scale
    J = scale_jacobian(equations.robot, tangent.jacobian, equations.rows.rotation)[0]  # (m, nv)
    mass = tangent.mass[0] * scale[:, None] * scale
    largest = max(float(np.diag(mass).max()), LEAST_DIVISOR)
    matrix = np.block([[mass / largest, J.T], [J, np.zeros((rows, rows))]])
    right = np.append(np.zeros_like(v), -J @ (v / scale))
    dv_and_impulse = np.linalg.lstsq(matrix, right, rcond=MOMENTUM_CUTOFF)[0]
    return v + scale * dv_and_impulse[: len(v)]
