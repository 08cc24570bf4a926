"""Torques and condition (8) along a path, affine in the squared speed z and its half slope u.

Forces along a path are affine in s'^2 and s" (`dynamics.path_forces`). A law s = phi(sigma(t)) with
z = (d sigma/dt)^2 and u = z'/2 (see `optimal_law`) has

    s'^2 = phi'^2 z,     s" = phi' u + phi" z,     torque = c0 + cz z + cu u,

and t_s . W_p is affine in z and u like the torque. Viscous damping adds a term in s' = phi' sqrt(z), with
sqrt(z) replaced by its tangent at the squared speed z0 of the previous law,

    sqrt(z) = sqrt(z0)/2 + z / (2 sqrt(z0)) + O((z - z0)^2).

Torques are finite if t_s . W_p has a zero of the same order as the measure g of the singularity. Where the
path touches the locus without crossing it, this requires condition (8) and its derivative along the path,

    c0' + cz' z + cz z' + cu' u + cu u' = 0,     z' = 2 u.

Where several motions are uncontrolled at once, each of them has its own condition.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from framework.dynamics.forces import balancing_torques, internal_projectors
from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.path_forces import PathForces
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import passive_motion, type2_matrix
from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import coefficients, derivative_matrix, evaluate, nodes
from framework.planning.condition import coefficients_at
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

    def with_damping(self, damping: Array, z0: Array | None) -> AffineInSpeed:
        """Add damping sqrt(z), linearised about z0 (M,) [1/s^2]; None leaves damping out.

        damping sqrt(z) = damping (sqrt(z0) / 2 + z / (2 sqrt(z0))) to first order.
        """
        if z0 is None:
            return self
        root = np.sqrt(z0)[:, None]
        half_damping = 0.5 * damping
        return AffineInSpeed(
            self.constant + half_damping * root, self.per_z + half_damping / root, self.per_u
        )


class PathTerms(NamedTuple):
    """The k functions static + centrifugal s'^2 + inertial s" + damping s' at M points, (M, k) each."""

    static: Array
    centrifugal: Array
    inertial: Array
    damping: Array

    def transform(self, phi: Smoothstep, sigma: Array) -> tuple[AffineInSpeed, Array]:
        """Return the functions of z and u at sigma (M,), and damping (M, k) over d sigma/dt.

        Here s'^2 = phi'^2 z and s" = phi' u + phi" z.
        """
        dphi, ddphi = (phi(sigma, order)[:, None] for order in (1, 2))
        per_z = self.centrifugal * dphi**2 + self.inertial * ddphi
        return AffineInSpeed(self.static, per_z, self.inertial * dphi), self.damping * dphi

    def linearise(self, phi: Smoothstep, sigma: Array, z0: SquaredSpeed | None) -> AffineInSpeed:
        """Return the functions at sigma (M,), with damping linearised about a squared speed z0, if any."""
        affine, damping = self.transform(phi, sigma)
        return affine.with_damping(damping, None if z0 is None else z0(sigma))


class Demand(NamedTuple):
    """Torques and speeds of the motors at points sigma (M,), motor side."""

    torque: AffineInSpeed  # (M, n_a) [N m], without friction
    damping: Array  # (M, n_a) [N m s], viscous torque over d sigma/dt
    speed: Array  # (M, n_a) [rad], over d sigma/dt
    direction: Array | None = None  # (M, n_a) motor speeds over ds/dt; None without dry friction
    internal: Array | None = None  # (M, n_a, n_a) projectors on internal torques of redundant motors

    def friction(self, size: Array) -> Array:
        """Return torques (M, n_a) of dry friction, of a size (n_a,) [N m], by the signs of the speeds."""
        if self.direction is None:  # no motor has dry friction
            return np.zeros((len(self.speed), len(size)))
        return size * speed_signs(self.direction)


def demand(branch: Branch, phi: Smoothstep, sigma: Array) -> Demand:
    """Compute torques and speeds of the undeformed robot's motors at sigma (M,), with s = phi(sigma)."""
    robot = branch.robot
    s = phi(sigma)
    closed = close_loops(robot, branch.path(s), branch.guess(s))
    *forces, motion = PathForces.compute(branch, s, closed)
    terms = balancing_torques(robot, closed, np.stack(forces)) / robot.gear_ratio
    # rotors resist the accelerations q" s'^2 + q' s" of the motors
    rotors = robot.rotor_inertia * robot.gear_ratio
    rates = motion.v[:, robot.actuated]
    terms[1] += rotors * motion.a[:, robot.actuated]
    terms[2] += rotors * rates
    has_friction = bool(robot.joint_friction[robot.actuated].any())
    internal = internal_projectors(robot, closed) if robot.n_a > robot.n else None
    speed = rates * robot.gear_ratio
    torque, damping = PathTerms(*terms).transform(phi, sigma)
    return Demand(torque, damping, speed * phi(sigma, 1)[:, None], speed if has_friction else None, internal)


def crossing_rows(
    branch: Branch, phi: Smoothstep, crossing: SingularPoint, z0: SquaredSpeed | None = None
) -> Array:
    """Compute the conditions on a law at a crossing as rows (k, 4) per (1, z, u, u').

    Each row times (1, z, u, u') must vanish. A transversal crossing with one uncontrolled motion has the
    single condition t_s . W_p = 0, without u'. Several motions have one condition each, and a touch adds the
    derivatives along the path. A coefficient that is only rounding of its terms is set to zero: for example
    that of u on a path orthogonal to t_s, or all coefficients on a straight path without weight along t_s.

    Args:
        z0: the squared speed about which damping is linearised, if any.
    """
    if crossing.corank > 1 or crossing.contact == "tangential":
        return _rows_about(branch, phi, crossing, z0)
    condition = crossing.condition or coefficients_at(branch, crossing, deflection=None)
    alpha, beta, gamma, delta = condition
    terms = PathTerms(*(np.array([[value]]) for value in (gamma, beta, alpha, delta)))
    sigma = phi.inverse(np.array([crossing.s]))
    row = np.concatenate(terms.linearise(phi, sigma, z0), axis=1)  # (1, 3)
    per_du = np.zeros((1, 1))  # u' enters only at a touch
    return np.concatenate([row, per_du], axis=1)


def _rows_about(branch: Branch, phi: Smoothstep, crossing: SingularPoint, z0: SquaredSpeed | None) -> Array:
    """Compute the conditions (k, 4) per (1, z, u, u') of all uncontrolled motions at a crossing.

    At a touch, the derivative of each condition along the path is a further condition: since z' = 2 u, it is
    (c0', cz', cu' + 2 cz, cu) per (1, z, u, u'). The derivative is that of a Chebyshev series through points
    about the crossing. Null vectors of the bordered system are smooth there, and so are the conditions.
    """
    sigma = float(phi.inverse(crossing.s))
    half_width = min(HALF_WIDTH, sigma, 1.0 - sigma)
    points = np.append(sigma + half_width * nodes(NODES), sigma)  # the crossing is the last one
    values, scale = _conditions_at_points(branch, phi, points, crossing.corank, z0)
    rows = np.pad(values[-1], ((0, 0), (0, 1)))  # (corank, 4), zero per u'
    if crossing.corank > 1:
        # independent combinations (k, 4): two motions of a symmetric robot may require the same condition
        scale = scale.max()  # of sums of sizes of the terms of a row; singular values far below are rounding
        _, singular_values, right = np.linalg.svd(rows)
        combinations = singular_values[:, None] * right[: len(singular_values)]
        rows = combinations[singular_values > NO_HOLD * scale]

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

    The last of sigma (M,) is that of the singular pose. The scale is the largest sum of sizes of the terms of
    t_s . W_p. Values that are smaller by far are rounding.
    """
    robot = branch.robot
    s = phi(sigma)
    closed = close_loops(robot, branch.path(s), branch.guess(s))
    # null vectors that are smooth along the path: the border is that of the singular pose
    matrices = type2_matrix(robot, closed)
    eta = solve_bordered(matrices, Border.of(matrices[-1], corank)).eta
    uncontrolled = passive_motion(robot, eta.transpose(0, 2, 1))  # (M, corank, nv)
    *forces, _motion = PathForces.compute(branch, s, closed)
    terms = PathTerms(*forces).linearise(phi, sigma, z0)  # of forces (M, nv)
    powers = np.stack(terms)[:, :, None] * uncontrolled  # (3, M, corank, nv)
    scales = np.abs(powers).sum(axis=3).max(axis=(0, 1))[:, None]
    return np.moveaxis(powers.sum(axis=3), 0, 2), scales
