"""States on which the loops close and the motions without mass are in balance.

Motions that the loops allow but that move no mass, M Z = 0 and J Z = 0 (a rod's stretch next to the gear's
twist, when the legs are massless), have no initial value of their own: gravity and inertia vanish along
them, and they stand where the springs balance, Z' (S' n tau - K (q - rest) - D v) = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled, NotConverged
from framework.kinematics.closures import loop_wrenches, scale_jacobian
from framework.kinematics.frame_variations import loop_curvature
from framework.kinematics.frames import integrate
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray
from framework.numerics.ordered_sums import matmul
from framework.simulation.equations import EquationsOfMotion, Tangent
from framework.simulation.world_forces import NO_FORCES, WorldForces
from framework.tolerances import EIGENVALUE_ROUNDING, LOOP_GAP

MAX_PASSES = 60
ROUNDING_STEP = 1e-14  # [rad, lengths] of a Newton step after which none is better
CLOSING_CUTOFF, MOMENTUM_CUTOFF = 1e-12, 1e-13  # singular values over the largest that count as zero


class AllowedMotions(NamedTuple):
    """The motions that the loops allow at T states."""

    basis: Array  # (T, nv, d) joint rates of motions that the loops allow, in the order of their inertia
    light: BoolArray  # (T, d) which of them move no mass; those come first
    closing: Array  # (T, nv, m) pseudo-inverse of J: the least motion that changes one loop equation by 1


def allowed_motions(equations: EquationsOfMotion, tangent: Tangent) -> AllowedMotions:
    """Compute the motions that the loops allow.

    They are the same to the last bit in every stack. They are the null space Z of the loops' Jacobian J,
    turned to the eigenvectors of Z' M Z. Redundant rows are left out of J; what else loses rank is a
    singularity of the closures and no free motion.
    """
    robot, rows = equations.robot, tangent.jacobian.shape[1]
    scale = robot.column_scale[:, None]  # (nv, 1)
    J = scale_jacobian(robot, tangent.jacobian, equations.rows.rotation)  # (T, m, nv)
    U, sizes, V_rows = np.linalg.svd(J)
    Z = V_rows[:, rows:].swapaxes(1, 2)  # (T, nv, d)
    mass = tangent.mass * scale * scale[:, 0]
    inertias, axes = np.linalg.eigh(matmul(Z.swapaxes(1, 2), matmul(mass, Z)))  # ascending
    diagonal = np.diagonal(mass, axis1=1, axis2=2)
    largest = np.maximum(inertias.max(axis=1, initial=0.0), diagonal.max(axis=1, initial=0.0))
    light = inertias <= EIGENVALUE_ROUNDING * largest[:, None]
    closing = _pseudo_inverse(U, sizes, V_rows) / robot.loop_lengths
    return AllowedMotions(scale * matmul(Z, axes), light, scale * closing)


def _pseudo_inverse(left: Array, sizes: Array, right: Array) -> Array:
    """Compute the pseudo-inverses (T, k, m) of matrices (T, m, k), m <= k, from their singular values."""
    rounding = np.finfo(float).eps * max(left.shape[1], right.shape[1])
    is_nonzero = sizes > rounding * sizes.max(axis=1, initial=0.0)[:, None]
    inverse = np.where(is_nonzero, 1.0 / np.where(is_nonzero, sizes, 1.0), 0.0)
    return matmul(right[:, : sizes.shape[1]].swapaxes(1, 2) * inverse[:, None], left.swapaxes(1, 2))


def free_motions(equations: EquationsOfMotion, tangent: Tangent) -> tuple[Array, Array]:
    """Compute bases of the motions that the loops allow, (nv, d) with mass and (nv, k) without (T = 1)."""
    allowed = allowed_motions(equations, tangent)
    basis, light = allowed.basis[0], allowed.light[0]
    return basis[:, ~light], basis[:, light]


def consistent_state(
    equations: EquationsOfMotion,
    q: Array,
    v: Array,
    torque: Array,
    world: WorldForces = NO_FORCES,
) -> tuple[Array, Array]:
    """Find the consistent state next to (q, v).

    In it the loops close and massless parts are in balance. Newton's method under motor torques (n_a,) [N m]
    and the forces of the world at t = 0.

    Raises:
        InvalidInput: a motion has neither mass nor stiffness nor damping; names its joints.
        NotAssembled: the loops do not close from q.
        NotConverged: the springs of massless parts find no balance.
    """
    robot, scale = equations.robot, equations.robot.column_scale
    driven = equations.motor_forces(torque[None])[0]
    size = np.inf
    for _ in range(MAX_PASSES):
        tangent = equations.tangent_at_rest(q)
        massive, light = free_motions(equations, tangent)
        # the least step that closes the loops, and the step of massless motions towards balance
        loops = tangent.jacobian[0] * scale
        step = -np.linalg.lstsq(loops, tangent.residual[0], rcond=CLOSING_CUTOFF)[0] * scale
        unbalanced = tangent.force[0] + equations.damping * v - driven  # gravity and springs less the motors
        unbalanced = unbalanced - world(robot, np.zeros(1), q[None])[0]
        if light.shape[1]:
            step = step + light @ balancing_step(equations, tangent, massive, light, unbalanced)
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
            f"{robot.name}: the springs of the massless parts find no balance at the start (last change "
            f"{size:.3g} rad or lengths of the robot)",
            residual=size,
        )
    return q, allowed_velocity(equations, tangent, v)


def balancing_step(
    equations: EquationsOfMotion, tangent: Tangent, massive: Array, light: Array, unbalanced: Array
) -> Array:
    """Compute the Newton step (k,) along the massless motions `light` (nv, k) towards the springs' balance.

    -(light' (K - C) light)^-1 light' unbalanced, with `unbalanced` (nv,) the forces out of balance, K the
    springs and C the curvature of the loops under their forces. Where damping alone acts there is no balance:
    the motion has an initial value, the given one, and the step is zero.

    Raises:
        InvalidInput: a motion has neither mass nor stiffness nor damping.
    """
    # forces of the loops that balance the others in the least squares
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
    """Return the error for joint rates (nv,) of a motion without mass, stiffness and damping."""
    robot = equations.robot
    motion = np.abs(rates) / robot.column_scale
    largest = [int(k) for k in np.argsort(-motion) if motion[k] > 0.1 * motion.max()]
    joints = [robot.coordinates.name_of(k) for k in largest]
    return InvalidInput(
        f"{robot.name}, {robot.flexibility}: a motion of {', '.join(joints[:4])} has "
        f"neither mass nor stiffness, its acceleration would be anything; give these links an "
        f"<inertial>, the rotor an inertia, or a spring"
    )


def allowed_velocity(equations: EquationsOfMotion, tangent: Tangent, v: Array) -> Array:
    """Compute the allowed velocity next to v (nv,), with the same momentum along the loops.

    An impulse of the loops changes v by dv: M dv + J' impulse = 0 and J (v + dv) = 0.
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
    change = np.linalg.lstsq(matrix, right, rcond=MOMENTUM_CUTOFF)[0][: len(v)]
    return v + scale * change
