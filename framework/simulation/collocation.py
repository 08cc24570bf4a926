"""One step of collocation on the equations of motion and the loop equations themselves.

The tables are computed, not copied. Radau IIA of s stages: nodes are the zeros of
P_s(2c - 1) - P_{s-1}(2c - 1), the last one the end of the step. Order 2s - 1 at the end of a step, s along
it; free motions that a step does not resolve decay (L-stable), and a coordinate without inertia is solved
for, not integrated.

At every node the unknowns are all accelerations a (nv,) and multipliers lambda (m,):

    M a + c + g + K (q - rest) + D v - S' n tau - f - J' lambda = 0        F(q) = 0

with f the forces of the world, v = v0 + h A a and q = q0 moved by h A v. The loops are closed at the nodes,
and the last node is the end of the step: there is no drift. Nothing is divided by the mass matrix, so
coordinates without mass are found from the balance of their springs in the same solve. Newton's method with
all derivatives but the curvature of rotations with several degrees of freedom; see `newton_matrix`.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II, Springer 1996, sections IV.5 and VI.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.polynomial import legendre

from framework.arrays import LEAST_DIVISOR, Array, ReadOnlyArrays
from framework.kinematics.frames import integrate
from framework.kinematics.loop_curvature import loop_curvature
from framework.simulation.drive import Drive, Gains
from framework.simulation.equations import EquationsOfMotion, Tangent
from framework.simulation.newton_matrix import NewtonMatrix

MAX_ITERATIONS = 12  # of Newton's method
REFACTORING_RATE = 0.02  # a contraction better than this keeps the factorised matrix
COORDINATE_ROUNDING = 1e-15  # of a coordinate: Newton's steps shrink no further
MAX_NEWTON_STEP = 3.0  # [rad, lengths] that a Newton step may not move a joint
# of steps [rad, lengths] that lead nowhere
DIVERGENCE_RATE, DIVERGENCE_STEP = 2.0, 1e-8
MAX_SLOPE_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Collocation(ReadOnlyArrays):
    """A table: `nodes` c (s,) in (0, 1], `once` A (s, s), its inverse, and Legendre series of values."""

    nodes: Array
    once: Array  # integrals from 0 to each node of the polynomial through values at the nodes
    rates: Array  # inverse of `once`
    series: Array  # (s, s) values at the nodes to Legendre coefficients on [0, 1]
    series_with_start: Array  # (s + 1, s + 1) the same with the value at 0 in front
    series_of_integral: Array  # (s + 1, s) values at the nodes to coefficients of their integral from 0

    @property
    def stages(self) -> int:
        return len(self.nodes)

    def basis(self, places: Array, degree: int | None = None) -> Array:
        """Compute Legendre polynomials (T, degree + 1), degree s by default, at points (T,) in [0, 1]."""
        return np.asarray(legendre.legvander(2 * places - 1, self.stages if degree is None else degree))


@lru_cache(maxsize=32)
def radau(stages: int) -> Collocation:
    """Compute the table of Radau IIA with that many stages."""
    from scipy.special import roots_jacobi

    inner = roots_jacobi(stages - 1, 1.0, 0.0)[0] if stages > 1 else np.empty(0)
    nodes = np.append((inner + 1) / 2, 1.0)
    series = np.linalg.inv(legendre.legvander(2 * nodes - 1, stages - 1))
    of_integral = legendre.legint(np.eye(stages), lbnd=-1, scl=0.5, axis=0) @ series
    once = legendre.legvander(2 * nodes - 1, stages) @ of_integral
    with_start = np.linalg.inv(legendre.legvander(2 * np.append(0.0, nodes) - 1, stages))
    rates = np.asarray(np.linalg.inv(once), dtype=float)
    return Collocation(nodes, once, rates, series, with_start, of_integral)


@dataclass(frozen=True, eq=False)
class CollocationStep(ReadOnlyArrays):
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
    power: Array  # (s,) of the motors and the world [W]
    iterations: int
    unresolved: float  # next coefficient of the motion's series [rad, robot lengths]

    @property
    def times(self) -> Array:
        return self.time + self.length * self.table.nodes


@dataclass(frozen=True, eq=False)
class StepFailure:
    """The reason why a step was not found."""

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
) -> CollocationStep | StepFailure:
    """Solve a step by Newton's method from guesses of accelerations (s, nv) and multipliers (s, m)."""
    robot, h = equations.robot, length
    scale = robot.column_scale
    times = drive.before_breaks(time + h * table.nodes)
    a, multipliers = guess[0].copy(), guess[1].copy()
    gains = drive.gains(time, q0, v0)
    accuracy = accuracy + COORDINATE_ROUNDING * float(np.abs(q0).max())
    matrix, before, slope = None, np.inf, np.zeros_like(a)
    held = None if drive.feedback else drive(times, a[:, :0], a[:, :0])  # a torque of time alone
    for iteration in range(1, MAX_ITERATIONS + 1):
        q, v, slope = _nodes(equations, table, h, q0=q0, v0=v0, a=a, near=slope)
        torque = drive(times, q, v) if held is None else held
        tangent = equations.tangent(q, v, a)
        applied = equations.applied(torque)
        if drive.world.acts:
            applied += drive.world(robot, times, q)
            tangent = tangent.under(drive.world.slope(robot, times, q, equations.geometry.before))
        force = tangent.force - applied - np.einsum("smi,sm->si", tangent.jacobian, multipliers)
        if not (np.all(np.isfinite(force)) and np.all(np.isfinite(tangent.residual))):
            return StepFailure("not finite", np.inf)
        if matrix is None:
            matrix = _matrix(equations, table, h, tangent, multipliers=multipliers, gains=gains)
            if matrix is None:
                return StepFailure("singular equations", np.inf)
        change, more_a, more_multipliers = matrix.solve(force, tangent.residual)
        moved = float(np.abs(change / scale).max())
        if not moved < MAX_NEWTON_STEP:
            return StepFailure("Newton steps too far", moved)
        a, multipliers = a + more_a, multipliers + more_multipliers
        rate = moved / before if before > 0 else 0.0
        if moved <= accuracy or (iteration > 1 and rate < 0.5 and moved * rate / (1 - rate) <= accuracy):
            q, v, slope = _nodes(equations, table, h, q0=q0, v0=v0, a=a, near=slope)
            power = np.sum(robot.gear_ratio * torque * v[:, robot.actuated], axis=1)
            power += np.sum(drive.world(robot, times, q) * v, axis=1)
            left = _unresolved(equations, table, h, slope)
            return CollocationStep(
                table, time, h, q0, v0, q, v, a, multipliers, slope, power, iteration, left
            )
        if iteration > 2 and rate > DIVERGENCE_RATE and moved > DIVERGENCE_STEP:
            return StepFailure("Newton diverges", moved)
        if rate > REFACTORING_RATE:
            matrix = None
        before = moved
    return StepFailure("Newton does not converge", moved)


def _nodes(
    equations: EquationsOfMotion,
    table: Collocation,
    h: float,
    *,
    q0: Array,
    v0: Array,
    a: Array,
    near: Array,
) -> tuple[Array, Array, Array]:
    """Return q (s, nq), v (s, nv) and the slope (s, nv) of `CollocationStep` for accelerations a (s, nv)."""
    v = v0 + h * table.once @ a
    slope = _slope(equations, table, h, q0=q0, v=v, near=near)
    return integrate(equations.robot, q0, h * table.once @ slope), v, slope


def _slope(
    equations: EquationsOfMotion, table: Collocation, h: float, *, q0: Array, v: Array, near: Array
) -> Array:
    """Compute the rate (s, nv) of the tangent offset from q0 for velocities v at the nodes."""
    model = equations.robot.model
    if model.nq == model.nv:
        return v
    slope = near if near.any() else v
    for _ in range(MAX_SLOPE_ITERATIONS):
        q = integrate(equations.robot, q0, h * table.once @ slope)
        inward = [pin.dDifference(model, q0, end, pin.ARG1) for end in q]
        new = np.einsum("sij,sj->si", np.array(inward), v)
        if np.abs(new - slope).max() <= COORDINATE_ROUNDING * max(np.abs(v).max(), LEAST_DIVISOR):
            return new
        slope = new
    return slope


def _matrix(
    equations: EquationsOfMotion,
    table: Collocation,
    h: float,
    tangent: Tangent,
    *,
    multipliers: Array,
    gains: Gains | None,
) -> NewtonMatrix | None:
    """Return Newton's matrix; None where the equations are singular."""
    by_q = tangent.by_q - loop_curvature(
        equations.rows, tangent.frames, equations.geometry.before, multipliers
    )
    by_v = tangent.by_v
    if gains is not None:
        columns = equations.robot.actuated
        by_v = by_v.copy()
        by_q[:, columns] -= equations.robot.gear_ratio[:, None] * gains.by_q
        by_v[:, columns] -= equations.robot.gear_ratio[:, None] * gains.by_v
    by_motion = np.concatenate([tangent.mass, by_v, by_q], axis=2)
    return NewtonMatrix.of(h, table.rates, by_motion, tangent.jacobian)


def _unresolved(equations: EquationsOfMotion, table: Collocation, h: float, slope: Array) -> float:
    """Estimate the first Legendre coefficient that the step leaves out [rad, robot lengths].

    Guessed from the fall of the last four, two by two, since a motion may be even or odd.
    """
    series = np.abs(table.series @ slope) / equations.robot.column_scale
    last = float(series[-2:].max())
    fall = min(1.0, last / max(float(series[-4:-2].max(initial=0.0)), LEAST_DIVISOR))
    return h * last * fall / (2 * table.stages)
