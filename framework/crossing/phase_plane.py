"""What a robot asks of the speed along its path: torques and condition (8), affine in z and u.

On a path x(phi(sigma)) with deflections q_e(sigma) all coordinates are functions of sigma, and with
z = (d sigma/dt)^2, u = z'/2 (see `optimal_law`)

    v = q' sqrt(z),     a = q" z + q' u,     torque = c0 + cz z + cu u,     t_s . W_p = likewise

so three evaluations of the inverse dynamics a point, at (z, u) = (0, 0), (1, 0) and (0, 1), give everything
(after toppra, which recovers its constraint coefficients from such calls). Friction that grows with speed
would add a term in sqrt(z) and break this.

Torques are finite where condition (8) vanishes as often as the measure g of the singularity does. Where the
path touches the locus without crossing it that is the condition and its derivative along the path,

    c0' + cz' z + cz z' + cu' u + cu u' = 0,     z' = 2 u,

and where several motions escape at once one condition for each of them.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from framework.arrays import Array
from framework.crossing.condition import NO_HOLD, CrossingPoint
from framework.dynamics.forces import loop_forces, motor_torque, tree_forces
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import ClosedStack, Motion, close_loops, motion_at, system_at
from framework.kinematics.loop_matrices import measured_matrix, passive_motion
from framework.kinematics.tracking import Branch
from framework.motion.chebyshev import TimeFunction, coefficients, derivative_matrix, evaluate, nodes
from framework.motion.optimal_law import OptimalLaw, Smoothstep
from framework.singularity.bordered_system import Border, bordered

ROUNDING = 1e-13  # of such a condition: where the path touches the locus, more left out of it is a pole
HALF_WIDTH, NODES = 0.02, 13  # in sigma, of the panel on which conditions are differentiated


class Deflections(Protocol):
    """q_e as a function of sigma, or its derivative: (M,) gives (M, n_e)."""

    def __call__(self, sigma: Array, order: int = 0) -> Array: ...


class DeflectionsOnPath(NamedTuple):
    """Deflections of a motion as functions of sigma: with t(sigma), q_e' = dq_e/dt z^(-1/2) and so on."""

    law: OptimalLaw
    in_time: TimeFunction

    def __call__(self, sigma: Array, order: int = 0) -> Array:
        """q_e or its derivative in sigma up to order 2, (M, n_e)."""
        t = np.minimum(self.law.time(sigma), self.law.duration)
        if order == 0:
            return self.in_time(t)
        z = self.law.squared_speed(sigma)[:, None]
        first = self.in_time(t, 1) / np.sqrt(z)
        if order == 1:
            return first
        u = 0.5 * self.law.squared_speed(sigma, 1)[:, None]
        return np.asarray((self.in_time(t, 2) - first * u) / z)


class AffineInSpeed(NamedTuple):
    """constant + per_z z + per_u u, each (M, k)."""

    constant: Array
    per_z: Array
    per_u: Array

    @staticmethod
    def of(values: Array) -> AffineInSpeed:
        """From values (3, M, k) at (z, u) = (0, 0), (1, 0), (0, 1)."""
        with np.errstate(invalid="ignore"):  # a point on the very singularity has infinite torques
            return AffineInSpeed(values[0], values[1] - values[0], values[2] - values[0])


class Demand(NamedTuple):
    """What the motors must give at points sigma (M,)."""

    torque: AffineInSpeed  # (M, n_a) [N m], motor side
    speed: Array  # (M, n_a) [rad], motor side: over d sigma/dt


def demand(
    branch: Branch, phi: Smoothstep, sigma: Array, deflections: Deflections | None, geometry: str
) -> Demand:
    """Torques and speeds of the motors at points sigma (M,).

    As in `resolve`: with geometry "rigid" forces are those of the undeformed robot, and only the motors move
    by what the springs give way.
    """
    robot = branch.robot
    deflected = _three_motions(branch, phi, sigma, deflections)
    carrying = deflected
    if geometry == "rigid" and deflections is not None:
        carrying = _three_motions(branch, phi, sigma, None)
    torque = motor_torque(robot, deflected, loop_forces(robot, carrying).joint_torque)
    speed = deflected.v[len(sigma) : 2 * len(sigma), robot.actuated] * robot.gear_ratio
    return Demand(AffineInSpeed.of(torque.reshape(3, len(sigma), -1)), np.abs(speed))


def crossing_rows(
    branch: Branch, phi: Smoothstep, at: CrossingPoint, deflections: Deflections | None
) -> tuple[float, Array]:
    """sigma of a crossing, and what has to vanish there, (k, 4): (constant, per z, per u, per u').

    The first row is t_s . W_p. What is not beyond rounding is zero: all of it on a straight path orthogonal
    to t_s, and the share of u on a bent one.
    """
    sigma, row = _wrench_row(branch, phi, at, deflections)
    if at.corank == 1 and not at.touches:
        return sigma, np.append(row, 0.0)[None]
    return sigma, _rows_about(branch, phi, sigma, at)


def _rows_about(branch: Branch, phi: Smoothstep, sigma: float, at: CrossingPoint) -> Array:
    """The conditions of all motions that escape the undeformed robot; at a touch also their derivatives.

    A null vector of the bordered system is smooth about the place, and so is what it makes of the forces.
    """
    robot, half = branch.robot, min(HALF_WIDTH, sigma, 1.0 - sigma)
    points = np.append(sigma + half * nodes(NODES), sigma)
    closed = close_loops(robot, branch.path(phi(points)), branch.guess(phi(points)))
    matrices = measured_matrix(robot, closed.system)
    eta = bordered(matrices, Border.of(matrices[-1], at.corank)).eta
    escaping = passive_motion(robot, eta.transpose(0, 2, 1))  # (M, corank, nv)
    forces = tree_forces(robot, _three_motions(branch, phi, points, None, closed))
    parts = forces.reshape(3, len(points), 1, -1) * escaping
    rest, one, pushed = parts.sum(axis=3)
    values = np.stack([rest, one - rest, pushed - rest], axis=2)  # (M, corank, 3)
    size = np.abs(parts).sum(axis=3).max(axis=(0, 1))[:, None]
    rows = np.pad(values[-1], ((0, 0), (0, 1)))
    if at.corank > 1:  # symmetric robots ask the same of the law more than once
        share, right = np.linalg.svd(rows)[1:]
        rows = (share[:, None] * right[: len(share)])[share > NO_HOLD * size.max()]
        size = size.max()
    if at.touches:
        series = coefficients(values[:-1].reshape(NODES, -1))
        slopes = evaluate(np.zeros(1), derivative_matrix(NODES) @ series).reshape(-1, 3) / half
        slopes[:, 2] += 2.0 * rows[:, 1]
        rows = np.concatenate([rows, np.column_stack([slopes, rows[:, 2]])])
        size = np.concatenate([size, size / half])
    return np.where(np.abs(rows) > ROUNDING * size, rows, 0.0)


def _wrench_row(
    branch: Branch, phi: Smoothstep, at: CrossingPoint, deflections: Deflections | None
) -> tuple[float, Array]:
    """sigma of a crossing, and t_s . W_p there as (constant, per z, per u)."""
    robot = branch.robot
    sigma, q, x = phi.inverse(np.array([at.s])), at.q[None], branch.path(np.array([at.s]))
    closed = ClosedStack(q, x, system_at(robot, q, x))
    motion = _three_motions(branch, phi, sigma, deflections, closed)
    parts = tree_forces(robot, motion) * at.motion
    rest, one, pushed = parts.sum(axis=1)
    row = np.array([rest, one - rest, pushed - rest])
    # on massless legs the forces of a payload cancel before they get here
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    size = np.where(robot.translations, 1.0, robot.length)
    moved = np.abs(robot.platform.path_twist(branch.path, at.s)) * size
    slope, bend = (float(phi(sigma, order)[0]) for order in (1, 2))
    push = mass * float(moved.max()) * np.array([0.0, slope**2 + abs(bend), slope])
    size = np.maximum(np.abs(parts).sum(axis=1), push)
    return float(sigma[0]), np.where(np.abs(row) > NO_HOLD * size, row, 0.0)


def _three_motions(
    branch: Branch,
    phi: Smoothstep,
    sigma: Array,
    deflections: Deflections | None,
    closed: ClosedStack | None = None,
) -> Motion:
    """All coordinates at points sigma (M,) for (z, u) = (0, 0), (1, 0), (0, 1), stacked (3 M,)."""
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
    ds, dds = (np.tile(phi(sigma, order), 3)[:, None] for order in (1, 2))
    slope, bend = (np.tile(branch.path(s, order), (3, 1)) for order in (1, 2))
    rates: tuple[Array, ...] = ()
    if deflections is not None and robot.n_e:
        first, second = (np.tile(deflections(sigma, order), (3, 1)) for order in (1, 2))
        rates = (first * np.sqrt(z), second * z + first * u)
    stacked = ClosedStack(q, x, system_at(robot, q, x))
    return motion_at(
        robot, stacked, slope * ds * np.sqrt(z), slope * (ds * u + dds * z) + bend * ds**2 * z, *rates
    )
