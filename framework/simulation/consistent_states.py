"""Consistent states: the loops are closed, and forces are in balance along motions without mass.

The loops may allow motions Z_0 that move no mass: M Z_0 = 0 and J Z_0 = 0. An example is the stretch of a rod
in series with the twist of a gear, if the legs are massless. Such a motion has no initial value of its own.
Gravity and inertia vanish along it, so its coordinate follows from the balance of its springs,
Z_0' (S' n tau - K (q - rest) - D v) = 0.

Accelerations of consistent states need no time steps. With the external forces f they satisfy

    M a + c + g + K (q - rest) + D v = S' n tau + f + J' lambda,        J a + drift = 0.

The equations contain all coordinates and are therefore regular at Type 2. With Z the allowed motions that
move mass,

    a = a_0 + Z alpha,    J a_0 = -drift,
    Z' M Z alpha = Z' (S' n tau + f - c - g - K (q - rest) - D v - M a_0).

The component of a along Z_0 depends on the rates of the torques and stays undetermined. It does not affect
M a. Sums run in the order of their index (`ordered_sums`), so a state gives the same result alone and in a
stack.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled, NotConverged
from framework.kinematics.closures import closure_drift, loop_curvature, loop_wrenches, scale_jacobian
from framework.kinematics.frames import frame_motions, integrate
from framework.kinematics.line_springs import Lines
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray
from framework.numerics.ordered_sums import matmul, matvec
from framework.simulation.drive import NO_FORCES, WorldForces
from framework.simulation.equations import EquationsOfMotion, State, Tangent, singular_vectors
from framework.tolerances import (
    EIGENVALUE_ROUNDING,
    EXPORT_ROUNDING,
    LOOP_GAP,
    RANK_ROUNDING,
    SPRINGS_BALANCED,
)

MAX_ITERATIONS = 12  # of Newton's method, here and in collocation steps
ROUNDING_STEP = 1e-14  # [rad, robot lengths]: smaller steps and errors are rounding


class AllowedMotions(NamedTuple):
    """The motions that the loops allow at T states."""

    basis: Array  # (T, nv, d) joint rates of d independent motions, by ascending inertia
    light: BoolArray  # (T, d) whether a motion moves no mass; such motions come first
    # (T, nv, R) pseudo-inverse of J: the least joint rates for a unit rate of each loop equation
    closing: Array


def allowed_motions(equations: EquationsOfMotion, tangent: Tangent) -> AllowedMotions:
    """Compute the motions that the loops allow, the same to the last bit in every stack.

    The basis spans the null space Z of the loops' Jacobian J and diagonalises Z' M Z. Redundant rows do not
    add to the rank m of J. A further loss of rank is a singularity of the closures and adds no motion.
    """
    robot = equations.robot
    m = equations.rank
    scale = robot.column_scale[:, None]  # (nv, 1)

    # null space of the loops, in joint rates divided by their scale
    row_lengths = robot.unit_lengths(equations.rows.rotation)  # (R,)
    J = scale_jacobian(robot, tangent.jacobian, row_lengths)  # (T, R, nv)
    U, values, V_rows = singular_vectors(J, m)
    Z = V_rows[:, m:].swapaxes(1, 2)  # (T, nv, d)

    # Eigenvectors of the reduced mass matrix are motions of independent inertia. A motion has no mass if this
    # inertia is rounding beside all inertias of the robot.
    mass = tangent.mass * scale * scale[:, 0]
    reduced_mass = matmul(Z.swapaxes(1, 2), matmul(mass, Z))  # Z' M Z, (T, d, d)
    inertias, axes = np.linalg.eigh(reduced_mass)  # (T, d) ascending, (T, d, d)
    joint_inertias = np.diagonal(mass, axis1=1, axis2=2)  # (T, nv)
    all_inertias = np.concatenate([inertias, joint_inertias], axis=1)
    light = inertias <= EIGENVALUE_ROUNDING * all_inertias.max(axis=1, initial=0.0, keepdims=True)
    return AllowedMotions(
        basis=scale * matmul(Z, axes),
        light=light,
        closing=scale * (_pseudo_inverse(U, values, V_rows) / row_lengths),
    )


def _pseudo_inverse(left: Array, values: Array, right: Array) -> Array:
    """Compute pseudo-inverses (T, k, R) of rank m <= k from singular value decompositions.

    Args:
        left: left singular vectors (T, R, m), in columns.
        values: singular values (T, m).
        right: right singular vectors (T, k, k), in rows.
    """
    m = values.shape[1]
    rounding = np.finfo(float).eps * right.shape[1]
    is_nonzero = values > rounding * values.max(axis=1, initial=0.0, keepdims=True)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=is_nonzero)
    columns = right[:, :m].swapaxes(1, 2)  # (T, k, m)
    return matmul(columns * inverse[:, None], left.swapaxes(1, 2))


def consistent_state(
    equations: EquationsOfMotion,
    q: Array,
    v: Array,
    torque: Array,
    world: WorldForces = NO_FORCES,
) -> State:
    """Find the consistent state next to q (nq,), v (nv,) by Newton's method.

    In a consistent state the loops are closed, and massless parts are in balance under the motor torques
    `torque` (n_a,) [N m], motor side, and the external wrenches of `world` at t = 0.

    Raises:
        InvalidInput: a motion has neither mass nor stiffness nor damping; the message names its joints.
        NotAssembled: the loops do not close from q.
        NotConverged: the springs of massless parts find no balance.
    """
    robot = equations.robot
    scale = equations.robot.column_scale
    driven = equations.motor_forces(torque[None])[0]
    size = np.inf
    for _ in range(MAX_ITERATIONS):
        tangent = equations.tangent_at_rest(q)
        allowed = allowed_motions(equations, tangent)
        light = allowed.basis[0][:, allowed.light[0]]  # (nv, k)
        # the least step that closes the loops, measured in radians and robot lengths; `tangent` has T = 1
        step = -allowed.closing[0] @ tangent.residual[0]
        if light.shape[1]:
            # sum of gravity, springs and damping minus motor and external forces
            unbalanced = tangent.force[0] + tangent.by_v[0] @ v - driven
            unbalanced -= world(robot, np.zeros(1), q[None], np.atleast_2d(v))[0]
            step += light @ balancing_step(equations, tangent, light, unbalanced)
        size = float(np.abs(step / scale).max(initial=0.0))
        # a step of a radian or of the robot's length, or NaN: Newton's method diverges, reported below
        if not size < 1.0:
            break
        q = integrate(robot, q[None], step[None])[0]
        if size < ROUNDING_STEP:
            break

    tangent = equations.tangent_at_rest(q)
    gaps = np.abs(loop_wrenches(robot.rows, tangent.frames).residual[0])
    gap = float(gaps.max(initial=0.0))
    # the last step has closed what can close; rounded rows share what remains, as when a motion is planned
    open_gap = EXPORT_ROUNDING if robot.rounded.names else LOOP_GAP
    if not np.all(gaps <= open_gap * robot.row_lengths):
        raise NotAssembled(
            f"the start is not assembled: a loop stays {gap:.3g} m or rad apart",
            name=robot.name,
            q=q,
            residual=gap,
        )
    if not size < LOOP_GAP:
        raise NotConverged(
            f"the springs of the massless parts find no balance at the start (the last Newton "
            f"step was {size:.3g} rad or robot lengths)",
            name=robot.name,
            residual=size,
        )
    return State(q, allowed_velocity(equations, tangent, v))


def balancing_step(equations: EquationsOfMotion, tangent: Tangent, light: Array, unbalanced: Array) -> Array:
    """Compute the Newton step (k,) towards balance along massless motions `light` (nv, k).

    The step is -(light' (K - C) light)^-1 light' unbalanced, with the stiffness K of the springs and the
    curvature C of the loops under their forces. If a motion has damping but no stiffness, it has no balance
    and keeps its initial value: the step is zero.

    Args:
        tangent: terms at one configuration at rest (T = 1).
        unbalanced: residual (nv,) of the balance of forces without the loop forces.

    Raises:
        InvalidInput: a motion has neither mass nor stiffness nor damping.
    """
    # loop forces that balance the other forces in the sense of least squares
    multipliers = np.linalg.lstsq(tangent.jacobian[0].T, unbalanced, rcond=EIGENVALUE_ROUNDING)[0]
    curvature = loop_curvature(equations.robot, equations.rows, tangent.frames, multipliers[None])[0]
    robot = equations.robot
    stiffness, damping = np.diag(equations.stiffness), np.diag(equations.damping)
    if robot.line_springs.names:
        lines = Lines.of(robot, tangent.frames)
        stiffness, damping = stiffness + lines.force_slope()[0], damping + lines.damping[0]
    springs = light.T @ stiffness @ light  # (k, k)
    dampers = light.T @ damping @ light

    # a motion without stiffness belongs to an eigenvalue of the springs that is rounding
    stiffest = (np.diag(stiffness) * robot.column_scale**2).max(initial=0.0)  # [N m]
    rounding = EIGENVALUE_ROUNDING * max(float(stiffest), LEAST_DIVISOR)
    if np.linalg.eigvalsh(springs + dampers)[0] <= rounding:
        softest = light @ np.linalg.eigh(springs).eigenvectors[:, 0]  # (nv,) joint rates
        sizes = np.abs(softest / robot.column_scale)  # [rad, robot lengths]
        # the four joints that move most; nearly all joints move a little
        moving = [k for k in np.argsort(-sizes)[:4] if sizes[k] > 0.1 * sizes.max()]
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: a motion of "
            f"{', '.join(map(robot.coordinates.name_of, moving))} has neither mass nor stiffness, so its "
            f"acceleration is undetermined; give these links an <inertial>, the rotor an inertia, or a spring"
        )
    if np.linalg.eigvalsh(springs)[0] <= rounding:  # damping alone
        return np.zeros(light.shape[1])

    slope = springs - light.T @ curvature @ light  # (k, k) of the residual along the motions
    return -np.linalg.lstsq(slope, light.T @ unbalanced, rcond=None)[0]


def allowed_velocity(equations: EquationsOfMotion, tangent: Tangent, v: Array) -> Array:
    """Project a velocity v (nv,) onto the velocities that the loops allow, (nv,).

    An impulse of the loop forces changes v by dv: M dv + J' impulse = 0 and J (v + dv) = 0. Both are solved
    with joint rates over their units and with the dimensionless J, so that one tolerance decides which
    singular values are zero. `tangent` has the terms of one configuration (T = 1).
    """
    m = equations.rank
    if not m:
        return v
    scale = equations.robot.column_scale  # (nv,) units of the joints: 1 rad or the robot's length
    lengths = equations.robot.unit_lengths(equations.rows.rotation)
    J = scale_jacobian(equations.robot, tangent.jacobian, lengths)[0]  # (m, nv) of the configuration
    if len(J) > m:
        U, _, _ = singular_vectors(J[None], m)
        J = U[0].T @ J
    mass = tangent.mass[0] * scale[:, None] * scale
    # M is divided by its largest entry, to have the size of J; this scales the impulse alone
    largest = max(float(np.diag(mass).max()), LEAST_DIVISOR)
    matrix = np.block([[mass / largest, J.T], [J, np.zeros((m, m))]])
    right = np.append(np.zeros_like(v), -J @ (v / scale))
    # least squares, as massless motions make the matrix singular
    dv_and_impulse = np.linalg.lstsq(matrix, right, rcond=EIGENVALUE_ROUNDING)[0]
    return v + scale * dv_and_impulse[: len(v)]


# ------------------------------------------------------------------ accelerations


class Accelerations(NamedTuple):
    """Joint accelerations of T states under given torques."""

    a: Array  # (T, nv) zero along motions without mass, which leave a undetermined
    undetermined: BoolArray  # (T, nv) joints that such a motion moves: their a depends on the torques' rates


def accelerations(
    equations: EquationsOfMotion, q: Array, v: Array, torque: Array, applied: Array
) -> Accelerations:
    """Compute joint accelerations (T, nv) at T states.

    Args:
        q, v: configurations (T, nq) and velocities (T, nv) that close the loops.
        torque: motor torques (T, n_a) [N m], motor side.
        applied: generalised external forces (T, nv) [N m, N].

    Raises:
        InvalidInput: the springs of parts without mass are not in balance; or a motion has neither mass nor
            stiffness nor damping.
    """
    tangent = equations.tangent(q, v, np.zeros(v.shape))
    Z, light, closing = allowed_motions(equations, tangent)  # (T, nv, d), (T, d), (T, nv, R)
    force = equations.motor_forces(torque) + applied - tangent.force  # (T, nv) without the loop forces
    robot = equations.robot
    for k in np.flatnonzero(light.any(axis=1)).tolist():  # parts without mass must be in balance
        massless = Z[k][:, light[k]]  # (nv, k)
        step = massless @ balancing_step(equations, equations.tangent_at_rest(q[k]), massless, -force[k])
        distances = np.abs(step / robot.column_scale)
        worst = int(np.argmax(distances))
        if distances[worst] > SPRINGS_BALANCED:
            row = f", row {k}" if len(q) > 1 else ""
            raise InvalidInput(
                f"q{row}: {robot.coordinates.name_of(worst)} of {robot.name}, {robot.flexibility}, has no "
                f"mass and is {distances[worst]:.3g} rad or robot lengths from where its springs balance "
                f"these torques: its acceleration would be infinite; `Stepper.start` gives the state next to "
                f"this one"
            )

    drift = closure_drift(equations.rows, frame_motions(robot, tangent.frames, v), q, v)
    a = -matvec(closing, drift)  # a_0, (T, nv)

    # Solve Z' M Z alpha = Z' (force - M a_0). For motions without mass the equation is alpha = 0: their rows
    # and columns are replaced by those of the unit matrix, and their right sides by 0.
    Z_rows = Z.swapaxes(1, 2)  # Z'
    reduced_mass = matmul(Z_rows, matmul(tangent.mass, Z))  # Z' M Z, (T, d, d)
    inertia = np.where(light[:, None] | light[:, :, None], np.eye(light.shape[1]), reduced_mass)
    along_Z = matvec(Z_rows, force - matvec(tangent.mass, a))  # (T, d)
    alpha = np.linalg.solve(inertia, np.where(light, 0.0, along_Z)[..., None])[..., 0]
    a += matvec(Z, alpha)

    light_rates = np.abs(Z * light[:, None]).max(axis=2, initial=0.0)  # (T, nv)
    return Accelerations(a, undetermined=light_rates / robot.column_scale > RANK_ROUNDING)
