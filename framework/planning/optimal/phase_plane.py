"""Torques and condition (8) along a path, affine in z and u of the speed.

On a path x(phi(sigma)) with deflections q_e(sigma) all coordinates are functions of sigma, and with
z = (d sigma/dt)^2, u = z'/2 (see `optimal_law`)

    v = q' sqrt(z),     a = q" z + q' u,     torque = c0 + cz z + cu u,     t_s . W_p = likewise

so three evaluations of the inverse dynamics a point give everything (after toppra, which recovers its
constraint coefficients from such calls): at rest, and of the inertia alone at (z, u) = (1, 0) and (0, 1).
Differences against the forces at rest would lose digits where gravity is large. Viscous damping D adds
D q' sqrt(z), which is replaced by its tangent at the squared speed z0 of the law before,

    sqrt(z) = sqrt(z0)/2 + z / (2 sqrt(z0)) + O((z - z0)^2).

Torques are finite where condition (8) vanishes as often as the measure g of the singularity does. Where the
path touches the locus without crossing it that is the condition and its derivative along the path,

    c0' + cz' z + cz z' + cu' u + cu u' = 0,     z' = 2 u,

and where several motions escape at once one condition for each of them.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from framework.dynamics.forces import balanced_forces, inertial_forces, motor_torque, static_forces
from framework.dynamics.motor_friction import speed_signs
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack, linearised_at
from framework.kinematics.loop_matrices import passive_motion, type2_matrix
from framework.kinematics.motion_rates import Motion, motion_at
from framework.laws.optimal_law import OptimalLaw, Smoothstep
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, coefficients, derivative_matrix, evaluate, nodes
from framework.planning.condition import CrossingPoint, bounds_of_terms, remove_rounding
from framework.singularity.bordered_system import Border, solve_bordered
from framework.tolerances import CONDITION_ROUNDING, NO_HOLD

HALF_WIDTH, NODES = 0.02, 13  # in sigma, of the panel on which conditions are differentiated


class Deflections(Protocol):
    """q_e as a function of sigma, or its derivative: (M,) gives (M, n_e)."""

    def __call__(self, sigma: Array, order: int = 0) -> Array: ...


class SquaredSpeed(Protocol):
    """z (M,) [1/s^2] of a law at sigma (M,)."""

    def __call__(self, sigma: Array) -> Array: ...


class DeflectionsOnPath(NamedTuple):
    """Deflections of a motion as functions of sigma, where d sigma/dt = z^(1/2) and d2 sigma/dt2 = u."""

    law: OptimalLaw
    in_time: TimeFunction

    def __call__(self, sigma: Array, order: int = 0) -> Array:
        """Evaluate q_e or its derivative in sigma up to order 2, (M, n_e).

        dq_e/dt = q_e' z^(1/2) and d2q_e/dt2 = q_e" z + q_e' u, solved for q_e' and q_e".
        """
        t = np.minimum(self.law.time(sigma), self.law.duration)
        if order == 0:
            return self.in_time(t)
        z = self.law.squared_speed(sigma)[:, None]
        first = self.in_time(t, 1) / np.sqrt(z)
        if order == 1:
            return first
        u = 0.5 * self.law.squared_speed(sigma, 1)[:, None]
        return (self.in_time(t, 2) - first * u) / z


class AffineInSpeed(NamedTuple):
    """constant + per_z z + per_u u, each (M, k)."""

    constant: Array
    per_z: Array
    per_u: Array


class Demand(NamedTuple):
    """The torques and speeds asked of the motors at points sigma (M,)."""

    torque: AffineInSpeed  # (M, n_a) [N m], motor side, without damping
    damping: Array  # (M, n_a) [N m s], motor side: over d sigma/dt
    speed: Array  # (M, n_a) [rad], motor side: over d sigma/dt
    direction: Array | None = None  # (M, n_a) motor speeds over ds/dt, if dry friction acts on any

    def linearise_damping(self, before: Array | None) -> AffineInSpeed:
        """Return the torques with damping replaced by its tangent at z (M,) [1/s^2]; without damping at None.

        damping sqrt(z) = damping (sqrt(z0) / 2 + z / (2 sqrt(z0))) to first order.
        """
        if before is None:
            return self.torque
        root = np.sqrt(before)[:, None]
        constant = self.torque.constant + 0.5 * self.damping * root
        return AffineInSpeed(constant, self.torque.per_z + 0.5 * self.damping / root, self.torque.per_u)

    def friction(self, size: Array) -> Array:
        """Return torques (M, n_a) of dry friction of this size (n_a,), signed by the motors' speeds."""
        if self.direction is None:
            return np.zeros((len(self.speed), len(size)))
        return size * speed_signs(self.direction)


def demand(
    branch: Branch,
    phi: Smoothstep,
    sigma: Array,
    deflections: Deflections | None,
    geometry: str,
) -> Demand:
    """Compute torques and speeds of the motors at sigma (M,).

    As in `resolve`: with geometry "rigid" forces are those of the undeformed robot, and the deflections only
    move the motors.
    """
    robot = branch.robot
    deflected = _three_motions(branch, phi, sigma, deflections)
    force_motion = deflected
    if geometry == "rigid" and deflections is not None:
        force_motion = _three_motions(branch, phi, sigma, None)
    at_rest, per_z = slice(len(sigma)), slice(len(sigma), 2 * len(sigma))

    def motor_torques(forces: Array) -> Array:
        balanced = balanced_forces(robot, force_motion.linearised, forces)
        return motor_torque(robot, deflected, balanced.joint_torque)

    forces = _linearised_forces(branch, force_motion, (sigma, phi(sigma)), None)
    torque = motor_torques(forces)
    damping = np.zeros_like(torque[at_rest])
    if robot.is_damped:
        forces[at_rest] += robot.joint_damping * force_motion.v[per_z]
        damping = motor_torques(forces)[at_rest] - torque[at_rest]
    speed = deflected.v[per_z, robot.actuated] * robot.gear_ratio
    affine = AffineInSpeed(*torque.reshape(3, len(sigma), -1))
    return Demand(affine, damping, speed, _direction(branch, phi(sigma), deflected))


def _direction(branch: Branch, s: Array, three: Motion) -> Array | None:
    """Return dq_a/ds (M, n_a), motor side, at the poses of `_three_motions`; None without dry friction.

    The springs do not move here. Their rates would change a sign only beside a reversal.
    """
    robot = branch.robot
    if not robot.joint_friction[robot.actuated].any():
        return None
    x = branch.path(s)
    closed = ClosedStack(three.q[: len(s)], x, linearised_at(robot, three.q[: len(s)], x))
    motion = motion_at(robot, closed, branch.path(s, 1), 0.0 * x)
    return robot.gear_ratio * motion.v[:, robot.actuated]


def _linearised_forces(
    branch: Branch, motion: Motion, places: tuple[Array, Array], before: SquaredSpeed | None
) -> Array:
    """Return forces (3 M, nv) of the open tree on `_three_motions`: at rest, per z and per u.

    Weight and wrenches of the world are in the forces at rest. Damping is replaced by its tangent at the
    squared speed `before`, and left out without one.

    Args:
        places: sigma and s, each (M,).
    """
    robot, (sigma, s) = branch.robot, places
    at_rest, per_z = slice(len(sigma)), slice(len(sigma), 2 * len(sigma))
    forces = inertial_forces(robot, motion)
    wrenches = branch.wrenches.evaluate(robot, motion.linearised.frames.select(at_rest), s)
    forces[at_rest] = static_forces(robot, motion.q[at_rest], wrenches)
    if robot.is_damped and before is not None:
        root = np.sqrt(before(sigma))[:, None]
        damping = 0.5 * robot.joint_damping * motion.v[per_z]
        forces[at_rest] += damping * root
        forces[per_z] += damping / root
    return forces


def crossing_rows(
    branch: Branch,
    phi: Smoothstep,
    place: CrossingPoint,
    deflections: Deflections | None,
    before: SquaredSpeed | None = None,
) -> tuple[float, Array]:
    """Return sigma of a crossing and its conditions, rows (k, 4) on (1, z, u, u').

    Each row times (1, z, u, u') has to vanish at sigma. A path that crosses the locus, with one uncontrolled
    motion, has the one condition t_s . W_p = 0 without u'. Several motions have one each, and a touch adds
    the derivatives along the path. A coefficient is zero if it is no more than rounding of its terms: that of
    u on a path orthogonal to t_s; all coefficients on a straight path with no weight along t_s.
    """
    sigma, wrench_row = _wrench_row(branch, phi, place, deflections, before)
    if place.corank == 1 and not place.touches:
        per_curvature = 0.0  # u' enters at a touch alone
        return sigma, np.append(wrench_row, per_curvature)[None]
    return sigma, _rows_about(branch, phi, sigma, place, before)


def _rows_about(
    branch: Branch, phi: Smoothstep, sigma: float, place: CrossingPoint, before: SquaredSpeed | None
) -> Array:
    """Return the conditions (k, 4) of all uncontrolled motions of the rigid robot.

    At a touch, the derivative of each along the path is one more condition: (c0', cz', cu' + 2 cz, cu) per
    (1, z, u, u'), since z' = 2 u. It is that of a Chebyshev series through points about the crossing. Null
    vectors of the bordered system are smooth there, and so are the conditions.
    """
    half = min(HALF_WIDTH, sigma, 1.0 - sigma)
    points = np.append(sigma + half * nodes(NODES), sigma)
    values, size = _conditions_at_points(branch, phi, points, place.corank, before)
    rows = np.pad(values[-1], ((0, 0), (0, 1)))
    if place.corank > 1:
        size = size.max()
        rows = _independent_rows(rows, size)
    if place.touches:
        series = coefficients(values[:-1].reshape(NODES, -1))
        slopes = evaluate(np.zeros(1), derivative_matrix(NODES) @ series).reshape(-1, 3) / half
        slopes[:, 2] += 2.0 * rows[:, 1]
        rows = np.concatenate([rows, np.column_stack([slopes, rows[:, 2]])])
        size = np.concatenate([size, size / half])
    return np.where(np.abs(rows) > CONDITION_ROUNDING * size, rows, 0.0)


def _conditions_at_points(
    branch: Branch, phi: Smoothstep, points: Array, corank: int, before: SquaredSpeed | None
) -> tuple[Array, Array]:
    """Compute t_s . W_p (M, corank, 3) of all uncontrolled motions at rest, per z and per u.

    Also its scale (corank, 1), against which a value is rounding: the largest sum of sizes of its terms.

    Args:
        points: sigma (M,), the last one that of the singular pose.
    """
    robot, s = branch.robot, phi(points)
    closed = close_loops(robot, branch.path(s), branch.guess(s))
    matrices = type2_matrix(robot, closed.linearised)
    eta = solve_bordered(matrices, Border.of(matrices[-1], corank)).eta
    escaping = passive_motion(robot, eta.transpose(0, 2, 1))  # (M, corank, nv)
    motion = _three_motions(branch, phi, points, None, closed)
    forces = _linearised_forces(branch, motion, (points, s), before)
    terms = forces.reshape(3, len(points), 1, -1) * escaping
    sizes = np.abs(terms).sum(axis=3).max(axis=(0, 1))[:, None]
    return np.moveaxis(terms.sum(axis=3), 0, 2), sizes


def _independent_rows(rows: Array, size: float) -> Array:
    """Return independent combinations of rows (corank, 4), without any that is rounding of a size.

    Two motions of a symmetric robot may ask the same of the law.
    """
    _, singular_values, right = np.linalg.svd(rows)
    combinations = singular_values[:, None] * right[: len(singular_values)]
    return np.asarray(combinations[singular_values > NO_HOLD * size])


def _wrench_row(
    branch: Branch,
    phi: Smoothstep,
    place: CrossingPoint,
    deflections: Deflections | None,
    before: SquaredSpeed | None,
) -> tuple[float, Array]:
    """Return sigma of a crossing, and t_s . W_p at that point as (constant, per z, per u)."""
    robot, s = branch.robot, np.array([place.s])
    sigma, q, x = phi.inverse(s), place.q[None], branch.path(s)
    closed = ClosedStack(q, x, linearised_at(robot, q, x))
    motion = _three_motions(branch, phi, sigma, deflections, closed)
    terms = _linearised_forces(branch, motion, (sigma, s), before) * place.motion
    bounds = _bound_wrench_terms(branch, phi, place, float(sigma[0]), motion.v[1])
    size = np.maximum(np.abs(terms).sum(axis=1), bounds)
    return float(sigma[0]), remove_rounding(terms.sum(axis=1), size, 2)


def _bound_wrench_terms(
    branch: Branch, phi: Smoothstep, place: CrossingPoint, sigma: float, rates: Array
) -> Array:
    """Bound the terms of t_s . W_p (3,), constant, per z and per u, as `bounds_of_terms` does.

    With s'^2 = phi'^2 z and s" = phi' u + phi" z.

    Args:
        rates: of the joints (nv,) at z = 1.
    """
    slope, bend = (float(phi(np.array([sigma]), order)[0]) for order in (1, 2))
    rate = float(np.abs(rates / branch.robot.column_scale).max()) / slope
    alpha, beta, gamma, _ = bounds_of_terms(branch, place, rate)
    return np.array([gamma, slope**2 * beta + abs(bend) * alpha, slope * alpha])


def _three_motions(
    branch: Branch,
    phi: Smoothstep,
    sigma: Array,
    deflections: Deflections | None,
    closed: ClosedStack | None = None,
) -> Motion:
    """Return all coordinates at points sigma (M,) for (z, u) = (0, 0), (1, 0), (0, 1), stacked (3 M,).

    dx/dt = x' phi' z^(1/2) and d2x/dt2 = x' (phi' u + phi" z) + x" phi'^2 z.
    """
    robot, s = branch.robot, phi(sigma)
    if closed is None:
        guess = branch.guess(s)
        if deflections is not None:
            step = np.zeros((len(sigma), robot.model.nv))
            step[:, robot.elastic] = deflections(sigma)
            guess = integrate(robot, guess, step)
        closed = close_loops(robot, branch.path(s), guess)
    q, x = (np.tile(values, (3, 1)) for values in (closed.q, closed.x))
    z, u = (np.repeat(values, len(sigma))[:, None] for values in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]))
    ds, dds = (np.tile(phi(sigma, order), 3)[:, None] for order in (1, 2))  # in sigma
    slope, bend = (np.tile(branch.path(s, order), (3, 1)) for order in (1, 2))  # in s
    rates: tuple[Array, ...] = ()
    if deflections is not None and robot.n_e:
        first, second = (np.tile(deflections(sigma, order), (3, 1)) for order in (1, 2))
        rates = (first * np.sqrt(z), second * z + first * u)
    stacked = ClosedStack(q, x, linearised_at(robot, q, x))
    return motion_at(
        robot, stacked, slope * ds * np.sqrt(z), slope * (ds * u + dds * z) + bend * ds**2 * z, *rates
    )
