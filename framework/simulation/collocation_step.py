"""One step of collocation on the equations of motion and the loop equations themselves.

At every node the unknowns are all accelerations a (nv,) and multipliers lambda (m,):

    M a + c + g + K (q - rest) + D v - S' n tau - J' lambda = 0        F(q) = 0

with v = v0 + h A a and q = q0 moved by h A v. The loops are closed at the nodes, and the last node is the
end of the step: there is no drift. Nothing is divided by the mass matrix, so coordinates without mass
are found from the balance of their springs in the same solve. Newton's method with all derivatives but
the curvature of rotations with several degrees of freedom; the system is as large as the step has
unknowns, and steps are long.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ReadOnlyArrays
from framework.kinematics.frames import integrate
from framework.simulation.collocation import Collocation
from framework.simulation.curvature import loop_curvature
from framework.simulation.drive import Drive, Gains
from framework.simulation.equations import EquationsOfMotion, Tangent

ITERATIONS = 12
FRESH = 0.02  # a contraction better than this keeps the factorised matrix
ROUNDING = 1e-15  # of a coordinate: Newton's steps shrink no further
TOO_FAR = 3.0  # [rad, lengths] that a Newton step may not move a joint


@dataclass(frozen=True, eq=False)
class Step(ReadOnlyArrays):
    """A step from `time` over `length` [s]: values at its nodes, the last one at its end."""

    table: Collocation
    time: float
    length: float
    start: Array  # (nq,)
    start_velocity: Array  # (nv,)
    q: Array  # (s, nq)
    v: Array  # (s, nv)
    a: Array  # (s, nv)
    multipliers: Array  # (s, m)
    slope: Array  # (s, nv) rate of the tangent offset from `start`; v itself where all joints are lines
    power: Array  # (s,) of the motors [W]
    iterations: int
    unresolved: float  # next coefficient of the motion's series [rad, robot lengths]

    @property
    def times(self) -> Array:
        return self.time + self.length * self.table.nodes


@dataclass(frozen=True, eq=False)
class Failure:
    """Why a step was not found."""

    reason: str
    residual: float


def solve_step(
    equations: EquationsOfMotion,
    drive: Drive,
    table: Collocation,
    *,
    time: float,
    length: float,
    q0: Array,
    v0: Array,
    guess: tuple[Array, Array],
    accuracy: float,
) -> Step | Failure:
    """Newton's method from guessed accelerations (s, nv) and multipliers (s, m) at the nodes."""
    from scipy.linalg.lapack import dgetrf, dgetrs

    robot, nv, h = equations.robot, equations.robot.model.nv, length
    scale = robot.column_scale
    times = drive.before_breaks(time + h * table.nodes)
    a, multipliers = guess[0].copy(), guess[1].copy()
    gains = drive.gains(time, q0, v0)
    accuracy = accuracy + ROUNDING * float(np.abs(q0).max())
    factors, before, slope = None, np.inf, np.zeros_like(a)
    held = None if drive.feedback else drive(times, a[:, :0], a[:, :0])  # a torque of time alone
    for iteration in range(1, ITERATIONS + 1):
        v = v0 + h * table.once @ a
        slope = _slope(equations, table, h, q0=q0, v=v, near=slope)
        q = integrate(robot, q0, h * table.once @ slope)
        torque = drive(times, q, v) if held is None else held
        at = equations.tangent(q, v, a)
        force = at.force - equations.applied(torque) - np.einsum("smi,sm->si", at.jacobian, multipliers)
        wrong = np.concatenate([force, at.residual / h**2], axis=1).ravel()
        if not np.all(np.isfinite(wrong)):
            return Failure("not finite", np.inf)
        if factors is None:
            *factors, singular = dgetrf(
                _matrix(equations, table, h, at, multipliers=multipliers, gains=gains)
            )
            if singular:
                return Failure("singular equations", np.inf)
        change = -dgetrs(*factors, wrong)[0].reshape(len(a), -1)
        moved = float(np.abs(h**2 * table.twice @ change[:, :nv] / scale).max())
        if not moved < TOO_FAR:
            return Failure("Newton steps too far", moved)
        a, multipliers = a + change[:, :nv], multipliers + change[:, nv:]
        rate = moved / before if before > 0 else 0.0
        if moved <= accuracy or (iteration > 1 and rate < 0.5 and moved * rate / (1 - rate) <= accuracy):
            v = v0 + h * table.once @ a
            slope = _slope(equations, table, h, q0=q0, v=v, near=slope)
            q = integrate(robot, q0, h * table.once @ slope)
            power = np.sum(robot.gear_ratio * torque * v[:, robot.actuated], axis=1)
            left = _unresolved(equations, table, h, slope)
            return Step(table, time, h, q0, v0, q, v, a, multipliers, slope, power, iteration, left)
        if iteration > 2 and rate > 2.0 and moved > 1e-8:
            return Failure("Newton diverges", moved)
        if rate > FRESH:
            factors = None
        before = moved
    return Failure("Newton does not converge", moved)


def _slope(
    equations: EquationsOfMotion, table: Collocation, h: float, *, q0: Array, v: Array, near: Array
) -> Array:
    """Rate (s, nv) of the tangent offset from q0 for velocities v at the nodes."""
    model = equations.robot.model
    if model.nq == model.nv:
        return v
    slope = near if near.any() else v
    for _ in range(20):
        q = integrate(equations.robot, q0, h * table.once @ slope)
        inward = [pin.dDifference(model, q0, end, pin.ARG1) for end in q]
        new = np.einsum("sij,sj->si", np.array(inward), v)
        if np.abs(new - slope).max() <= 1e-15 * max(np.abs(v).max(), 1e-300):
            return new
        slope = new
    return slope


def _matrix(
    equations: EquationsOfMotion,
    table: Collocation,
    h: float,
    at: Tangent,
    *,
    multipliers: Array,
    gains: Gains | None,
) -> Array:
    """Newton's matrix (s (nv + m), s (nv + m)), rows and columns node by node."""
    nv, m, s = equations.robot.model.nv, len(equations.rows.names), table.stages
    by_q = at.by_q - loop_curvature(equations.rows, at.frames, equations.geometry.before, multipliers)
    by_v = at.by_v
    if gains is not None:
        columns = equations.robot.actuated
        by_v = by_v.copy()
        by_q[:, columns] -= equations.robot.gear_ratio[:, None] * gains.by_q
        by_v[:, columns] -= equations.robot.gear_ratio[:, None] * gains.by_v
    whole = np.zeros((s, nv + m, s, nv + m))
    whole[:, :nv, :, :nv] = (h * table.once)[:, None, :, None] * by_v[:, :, None]
    whole[:, :nv, :, :nv] += (h**2 * table.twice)[:, None, :, None] * by_q[:, :, None]
    whole[:, nv:, :, :nv] = table.twice[:, None, :, None] * at.jacobian[:, :, None]
    nodes = np.arange(s)
    whole[nodes, :nv, nodes, :nv] += at.mass
    whole[nodes, :nv, nodes, nv:] = -at.jacobian.transpose(0, 2, 1)
    return whole.reshape(s * (nv + m), s * (nv + m))


def _unresolved(equations: EquationsOfMotion, table: Collocation, h: float, slope: Array) -> float:
    """Size of the first Legendre coefficient that the step leaves out [rad, robot lengths].

    Guessed from the fall of the last four, two by two, since a motion may be even or odd.
    """
    series = np.abs(table.series @ slope) / equations.robot.column_scale
    last = float(series[-2:].max())
    fall = min(1.0, last / max(float(series[-4:-2].max(initial=0.0)), 1e-300))
    return h * last * fall / (2 * table.stages)
