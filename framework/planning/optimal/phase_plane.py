"""Torques and condition (8) along a path, affine in the squared speed z and its half slope u.

On a path x(phi(sigma)) all coordinates of the undeformed robot are functions of sigma. With
z = (d sigma/dt)^2 and u = z'/2 (see `optimal_law`)

    v = q' sqrt(z),     a = q" z + q' u,     torque = c0 + cz z + cu u,

and t_s . W_p is affine in z and u like the torque. Three evaluations of the inverse dynamics at a point
therefore give all coefficients (as toppra recovers its constraint coefficients): one at rest, and two of the
inertia alone, at (z, u) = (1, 0) and (0, 1). Differences against the forces at rest would lose digits where
gravity is large. Viscous damping D adds D q' sqrt(z), with sqrt(z) replaced by its tangent at the squared
speed z0 of the previous law,

    sqrt(z) = sqrt(z0)/2 + z / (2 sqrt(z0)) + O((z - z0)^2).

Torques are finite if t_s . W_p has a zero of the same order as the measure g of the singularity. Where the
path touches the locus without crossing it, this requires condition (8) and its derivative along the path,

    c0' + cz' z + cz z' + cu' u + cu u' = 0,     z' = 2 u.

Where several motions are uncontrolled at once, each of them has its own condition.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from framework.dynamics.forces import balanced_forces, inertial_forces, motor_torque, static_forces
from framework.dynamics.motor_friction import speed_signs
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack, linearised_at, passive_motion, type2_matrix
from framework.kinematics.motion_rates import Motion, motion_at
from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import coefficients, derivative_matrix, evaluate, nodes
from framework.planning.condition import bounds_of_terms, remove_rounding
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import CONDITION_ROUNDING, NO_HOLD

# half width in sigma, and nodes, of the panel on which conditions are differentiated
HALF_WIDTH, NODES = 0.02, 13


class SquaredSpeed(Protocol):
    """A function that returns z (M,) [1/s^2] of a law at sigma (M,)."""

    def __call__(self, sigma: Array) -> Array: ...


class AffineInSpeed(NamedTuple):
    """The k functions constant + per_z z + per_u u at M points, each coefficient (M, k)."""

    constant: Array
    per_z: Array
    per_u: Array


class Demand(NamedTuple):
    """Torques and speeds of the motors at points sigma (M,), motor side."""

    torque: AffineInSpeed  # (M, n_a) [N m], without friction
    damping: Array  # (M, n_a) [N m s], viscous torque over d sigma/dt
    speed: Array  # (M, n_a) [rad], over d sigma/dt
    direction: Array | None = None  # (M, n_a) motor speeds over ds/dt; None without dry friction

    def linearise_damping(self, z0: Array | None) -> AffineInSpeed:
        """Return the torques with damping linearised about z0 (M,) [1/s^2]; None leaves damping out.

        damping sqrt(z) = damping (sqrt(z0) / 2 + z / (2 sqrt(z0))) to first order.
        """
        if z0 is None:
            return self.torque
        root = np.sqrt(z0)[:, None]
        half_damping = 0.5 * self.damping
        constant, per_z, per_u = self.torque
        return AffineInSpeed(constant + half_damping * root, per_z + half_damping / root, per_u)

    def friction(self, size: Array) -> Array:
        """Return torques (M, n_a) [N m] of dry friction, with the signs of the motor speeds.

        Args:
            size: (n_a,) [N m] torque of each motor's dry friction.
        """
        if self.direction is None:  # no motor has dry friction
            return np.zeros((len(self.speed), len(size)))
        return size * speed_signs(self.direction)


def demand(branch: Branch, phi: Smoothstep, sigma: Array) -> Demand:
    """Compute torques and speeds of the undeformed robot's motors at sigma (M,), with s = phi(sigma).

    Args:
        phi: the map from sigma to s.
    """
    robot = branch.robot
    s = phi(sigma)
    count = len(sigma)
    probes = _probe_motions(branch, phi, sigma)

    def motor_torques(forces: Array) -> AffineInSpeed:
        """Compute motor torques (M, n_a) that balance tree forces (3, M, nv), per (1, z, u)."""
        balanced = balanced_forces(robot, probes.linearised, forces.reshape(3 * count, -1))
        torque = motor_torque(robot, probes, balanced.joint_torque)
        return AffineInSpeed(*torque.reshape(3, count, -1))

    forces = _linearised_forces(branch, probes, sigma, s, z0=None)  # without damping
    torque = motor_torques(forces)
    damping = np.zeros_like(torque.constant)
    rates = _rates_per_root_z(probes)
    # torques are linear in forces: their change by damping forces at sqrt(z) = 1 is the coefficient of
    # sqrt(z)
    if robot.is_damped:
        forces[0] += robot.joint_damping * rates
        damping = motor_torques(forces).constant - torque.constant
    speed = rates[:, robot.actuated] * robot.gear_ratio
    return Demand(torque, damping, speed, _motor_direction(branch, s, probes))


def _rates_per_root_z(probes: Motion) -> Array:
    """Return the joint rates (M, nv) at z = 1, the second third of `_probe_motions`."""
    return np.split(probes.v, 3)[1]


def _motor_direction(branch: Branch, s: Array, probes: Motion) -> Array | None:
    """Compute dq_a/ds (M, n_a), motor side, at the poses of `_probe_motions`; None without dry friction.

    Args:
        s: (M,) path coordinates.
        probes: (3 M,) motions, of which the first M give the poses.
    """
    robot = branch.robot
    if not robot.joint_friction[robot.actuated].any():
        return None
    q = probes.q[: len(s)]
    x = branch.path(s)
    closed = ClosedStack(q, x, linearised_at(robot, q, x))
    motion = motion_at(robot, closed, branch.path(s, 1), 0.0 * x)
    return robot.gear_ratio * motion.v[:, robot.actuated]


def _linearised_forces(
    branch: Branch, probes: Motion, sigma: Array, s: Array, z0: SquaredSpeed | None
) -> Array:
    """Compute forces (3, M, nv) of the open tree per (1, z, u), from `_probe_motions`.

    Forces at rest include weight and external wrenches. Damping D q' sqrt(z) is linearised about the squared
    speed z0; None leaves damping out.

    Args:
        probes: (3 M,) motions of the joints.
        sigma, s: parameters (M,) of the points, s = phi(sigma).
    """
    robot = branch.robot
    at_rest = slice(len(sigma))
    forces = inertial_forces(robot, probes).reshape(3, len(sigma), -1)
    wrenches = branch.wrenches.evaluate(robot, probes.linearised.frames.select(at_rest), s)
    forces[0] = static_forces(robot, probes.q[at_rest], wrenches)
    if robot.is_damped and z0 is not None:
        root = np.sqrt(z0(sigma))[:, None]
        # sqrt(z) = sqrt(z0) / 2 + z / (2 sqrt(z0)) to first order
        half_damping = 0.5 * robot.joint_damping * _rates_per_root_z(probes)
        forces[0] += half_damping * root
        forces[1] += half_damping / root
    return forces


def crossing_rows(
    branch: Branch, phi: Smoothstep, crossing: SingularPoint, z0: SquaredSpeed | None = None
) -> Array:
    """Compute the conditions on a law at a crossing as rows (k, 4) per (1, z, u, u').

    Each row times (1, z, u, u') must vanish. A transversal crossing with one uncontrolled motion has the
    single condition t_s . W_p = 0, without u'. Several motions have one condition each, and a touch adds the
    derivatives along the path. A coefficient that is only rounding of its terms is set to zero: for example
    that of u on a path orthogonal to t_s, or all coefficients on a straight path without weight along t_s.

    Args:
        phi: the map from sigma to s.
        z0: the squared speed about which damping is linearised, if any.
    """
    if crossing.corank > 1 or crossing.contact == "tangential":
        return _rows_about(branch, phi, crossing, z0)
    wrench_row = _wrench_row(branch, phi, crossing, z0)
    per_du = 0.0  # u' enters only at a touch
    return np.append(wrench_row, per_du)[None]


def _rows_about(branch: Branch, phi: Smoothstep, crossing: SingularPoint, z0: SquaredSpeed | None) -> Array:
    """Compute the conditions (k, 4) per (1, z, u, u') of all uncontrolled motions at a crossing.

    At a touch, the derivative of each condition along the path is a further condition: since z' = 2 u, it is
    (c0', cz', cu' + 2 cz, cu) per (1, z, u, u'). The derivative is that of a Chebyshev series through points
    about the crossing. Null vectors of the bordered system are smooth there, and so are the conditions.

    Args:
        phi: the map from sigma to s.
        z0: the squared speed about which damping is linearised, if any.
    """
    sigma = float(phi.inverse(crossing.s))
    half_width = min(HALF_WIDTH, sigma, 1.0 - sigma)
    points = np.append(sigma + half_width * nodes(NODES), sigma)  # the crossing is the last one
    values, scale = _conditions_at_points(branch, phi, points, crossing.corank, z0)
    rows = np.pad(values[-1], ((0, 0), (0, 1)))  # (corank, 4), zero per u'
    if crossing.corank > 1:
        scale = scale.max()
        rows = _independent_rows(rows, scale)

    if crossing.contact == "tangential":
        series = coefficients(values[:-1].reshape(NODES, -1))  # of (c0, cz, cu) on the panel
        slopes = evaluate(np.zeros(1), derivative_matrix(NODES) @ series).reshape(-1, 3) / half_width
        slopes[:, 2] += 2.0 * rows[:, 1]  # cu' + 2 cz
        derivative_rows = np.column_stack([slopes, rows[:, 2]])  # with cu per u'
        rows = np.concatenate([rows, derivative_rows])
        scale = np.concatenate([scale, scale / half_width])  # a derivative is a change over the half width
    return np.where(np.abs(rows) > CONDITION_ROUNDING * scale, rows, 0.0)


def _conditions_at_points(
    branch: Branch, phi: Smoothstep, sigma: Array, corank: int, z0: SquaredSpeed | None
) -> tuple[Array, Array]:
    """Compute t_s . W_p (M, corank, 3) of all uncontrolled motions per (1, z, u), and scales (corank, 1).

    The scale is the largest sum of sizes of the terms of t_s . W_p. Values that are smaller by far are
    rounding.

    Args:
        phi: the map from sigma to s.
        sigma: parameters (M,) of the points, the last one that of the singular pose.
        corank: number of uncontrolled motions.
        z0: the squared speed about which damping is linearised, if any.
    """
    robot = branch.robot
    s = phi(sigma)
    closed = close_loops(robot, branch.path(s), branch.guess(s))
    # null vectors that are smooth along the path: the border is that of the singular pose
    matrices = type2_matrix(robot, closed.linearised)
    eta = solve_bordered(matrices, Border.of(matrices[-1], corank)).eta
    uncontrolled = passive_motion(robot, eta.transpose(0, 2, 1))  # (M, corank, nv)
    probes = _probe_motions(branch, phi, sigma, closed)
    forces = _linearised_forces(branch, probes, sigma, s, z0)
    terms = forces[:, :, None] * uncontrolled  # (3, M, corank, nv)
    scales = np.abs(terms).sum(axis=3).max(axis=(0, 1))[:, None]
    return np.moveaxis(terms.sum(axis=3), 0, 2), scales


def _independent_rows(rows: Array, size: float) -> Array:
    """Return independent combinations (k, 4) of rows (corank, 4); combinations of rounding are left out.

    Two motions of a symmetric robot may require the same condition.

    Args:
        rows: conditions of all uncontrolled motions.
        size: largest sum of sizes of the terms of a row; singular values far below it are rounding.
    """
    _, singular_values, right = np.linalg.svd(rows)
    combinations = singular_values[:, None] * right[: len(singular_values)]
    return np.asarray(combinations[singular_values > NO_HOLD * size])


def _wrench_row(
    branch: Branch,
    phi: Smoothstep,
    crossing: SingularPoint,
    z0: SquaredSpeed | None,
) -> Array:
    """Compute t_s . W_p (3,) at a crossing per (1, z, u).

    Coefficients that are only rounding of their terms are set to zero.

    Args:
        phi: the map from sigma to s.
        z0: the squared speed about which damping is linearised, if any.
    """
    robot = branch.robot
    s = np.array([crossing.s])
    sigma = phi.inverse(s)
    q = crossing.q[None]
    x = branch.path(s)
    closed = ClosedStack(q, x, linearised_at(robot, q, x))
    probes = _probe_motions(branch, phi, sigma, closed)
    terms = _linearised_forces(branch, probes, sigma, s, z0)[:, 0] * crossing.motion  # (3, nv)
    bounds = _bound_wrench_terms(branch, phi, crossing, float(sigma[0]), _rates_per_root_z(probes)[0])
    scale = np.maximum(np.abs(terms).sum(axis=1), bounds)
    return remove_rounding(terms.sum(axis=1), scale, alpha_index=2)  # the coefficient of u, and so of s"


def _bound_wrench_terms(
    branch: Branch, phi: Smoothstep, crossing: SingularPoint, sigma: float, rates: Array
) -> Array:
    """Bound the terms of t_s . W_p (3,) per (1, z, u).

    `bounds_of_terms` bounds the terms of gamma + beta s'^2 + alpha s", with s'^2 = phi'^2 z and
    s" = phi' u + phi" z.

    Args:
        crossing: the crossing, with t_s.
        sigma: its parameter.
        rates: joint rates (nv,) at z = 1.
    """
    dphi, ddphi = (float(phi(sigma, order)) for order in (1, 2))
    rate = float(np.abs(rates / branch.robot.column_scale).max()) / dphi  # largest joint rate per s'
    alpha, beta, gamma, _ = bounds_of_terms(branch, crossing, rate)
    return np.array([gamma, dphi**2 * beta + abs(ddphi) * alpha, dphi * alpha])


def _probe_motions(
    branch: Branch, phi: Smoothstep, sigma: Array, closed: ClosedStack | None = None
) -> Motion:
    """Compute the motions (3 M,) of all joints at (z, u) = (0, 0), (1, 0) and (0, 1).

    The M motions at one (z, u) follow those at the one before. The platform's derivatives by sigma are
    x' phi' and x' phi" + x" phi'^2, where x' and x" are those by s.

    Args:
        closed: configurations (M,) at sigma, if known.
    """
    robot = branch.robot
    s = phi(sigma)
    if closed is None:
        closed = close_loops(robot, branch.path(s), branch.guess(s))
    dphi, ddphi = (phi(sigma, order)[:, None] for order in (1, 2))
    dx, ddx = (branch.path(s, order) for order in (1, 2))
    rates = _probe_rates(dx * dphi, dx * ddphi + ddx * dphi**2)
    q = np.tile(closed.q, (3, 1))
    x = np.tile(closed.x, (3, 1))
    return motion_at(robot, ClosedStack(q, x, linearised_at(robot, q, x)), *rates)


def _probe_rates(slope: Array, curvature: Array) -> tuple[Array, ...]:
    """Return rates and accelerations (3 M, k) of a function y at the (z, u) of `_probe_motions`.

    With its derivatives y' = `slope` and y" = `curvature` (M, k) by sigma, dy/dt = y' z^(1/2) and
    d2y/dt2 = y" z + y' u.
    """
    zero = np.zeros_like(slope)
    return np.concatenate([zero, slope, zero]), np.concatenate([zero, curvature, slope])
