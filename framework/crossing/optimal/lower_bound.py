"""An estimate of the best possible law: the phase plane without smoothness at the ends, on a refined grid.

z = (ds/dt)^2 is linear on each cell of the path, zero at both ends; torques are looked at in the middle of
the cells, and a crossing is the middle of one. Accelerations may jump: up to the size of the cells this is a
relaxation, and its optimum is an estimate of the best that any law can do, and no proof.

Viscous damping is linearised about the law before, first that of the plan, until the optimum settles.

Source: Verscheure et al., IEEE TAC 54 (2009), whose discretisation this is; condition (8) is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from framework.arrays import Array
from framework.crossing.condition import CrossingPoint, crossing_point
from framework.crossing.optimal.phase_plane import SquaredSpeed, crossing_rows, demand
from framework.crossing.result import CrossingPlan, Optimality
from framework.crossing.specification import Specification
from framework.errors import NotConverged
from framework.kinematics.continuation.tracking import Branch, track_path
from framework.motion.cone_program import Affine, ConeProgram, Optimum, Rows, solve_cone_program
from framework.motion.optimal_law import Smoothstep
from framework.singularity.points_on_path import locate_singularities
from framework.tolerances import SAME_PLACE

PATH_CELLS = 120
MAX_TANGENTS = 20  # of damping
CROSSING_OFFSET = 1e-6  # in s, beside a crossing, where a cell's middle would be on it
SPEED_SAMPLES = 2001  # of the speed of a plan
MIN_LINEARISED_SPEED_RATIO = 1e-3  # of the mean or largest speed, about which damping is linearised
OPTIMUM_CHANGE = 1e-3  # share by which the optimum changes no more
# units of time over the plan's duration, one after the other if the solver gives up
TIME_UNITS = (1.0, 0.5, 2.0)


def estimated_best(plan: CrossingPlan, cells: int = PATH_CELLS) -> float | None:
    """Estimate the least duration [s], or the least peak of torque over its limit, of any law.

    Of the undeformed robot, with its damping and the dry friction planned with, under what the plan's law was
    asked for. None for energy and for a polynomial.

    Raises:
        NotConverged: the solver finds no optimum, or that with damping does not settle.
    """
    if plan.optimality is None or plan.optimality.specification.goal == "energy":
        return None
    specification = plan.optimality.specification
    branch = track_path(plan.robot, plan.path)
    points = locate_singularities(plan.robot, plan.path, branch=branch)
    branch = branch.under(plan.dynamics.wrenches)
    places = [crossing_point(branch, singular, None, singular.s) for singular in points]
    edges = _edges(np.array([place.s for place in places]), cells)
    before = _speed_of(plan) if plan.robot.is_damped else None
    best = np.inf
    for _ in range(MAX_TANGENTS):
        program = _LinearCells.of(branch, places, edges, plan.optimality, before)
        size, z = _optimum(program, plan)
        if before is None or abs(size / best - 1.0) <= OPTIMUM_CHANGE:
            break
        best, before = size, _speed_between(edges, z)
    else:
        raise NotConverged(
            f"{plan.robot.name}: no estimate of the best law: damping does not settle", residual=np.inf
        )
    if specification.goal == "time":
        return size
    return max(size, float((_at_rest(branch, specification.friction) / program.reference).max()))


def _optimum(program: _LinearCells, plan: CrossingPlan) -> tuple[float, Array]:
    """Compute the least duration [s] or peak, and z (k - 1,) [1/s^2] at the inner edges.

    Raises:
        NotConverged: the solver finds none.
    """
    for factor in TIME_UNITS:
        unit = factor * plan.duration
        optimum = solve_cone_program(program.cone_program(unit))
        if isinstance(optimum, Optimum):
            value = optimum.value * (unit if program.specification.goal == "time" else 1.0)
            return value, optimum.unknowns["z"] / unit**2
    raise NotConverged(
        f"{plan.robot.name}: no estimate of the best law found ({optimum.status})", residual=np.inf
    )


def _speed_of(plan: CrossingPlan) -> SquaredSpeed:
    """Return s'^2 of a plan as a function of s."""
    t = np.linspace(0.0, plan.duration, SPEED_SAMPLES)
    s, speed = plan.law(t), plan.law(t, 1)
    least = MIN_LINEARISED_SPEED_RATIO / plan.duration
    return lambda at: np.interp(at, s, np.maximum(speed, least) ** 2)


def _speed_between(edges: Array, inner: Array) -> SquaredSpeed:
    """Return s'^2 as a function of s, linear between its values at the edges, zero at both ends."""
    z = np.concatenate([[0.0], inner, [0.0]])
    least = MIN_LINEARISED_SPEED_RATIO**2 * float(z.max())
    return lambda at: np.maximum(np.interp(at, edges, z), least)


def _at_rest(branch: Branch, friction: Array) -> Array:
    """Compute the larger torque (n_a,) [N m] of both ends, of gravity and dry friction under a smooth law."""
    demanded = demand(branch, Smoothstep(2), np.array([0.0, 1.0]), None, "rigid")
    return np.asarray(np.abs(demanded.torque.constant + demanded.friction(friction)).max(axis=0))


def _edges(crossings: Array, cells: int) -> Array:
    """Return ends of the cells in s, narrower towards both ends of the path; crossings are in a middle."""
    edges = 0.5 - 0.5 * np.cos(np.pi * np.arange(cells + 1) / cells)
    for s in crossings:
        half = 0.25 * np.pi / cells * np.sqrt(s * (1.0 - s))
        edges = np.concatenate([edges[np.abs(edges - s) > 1.5 * half], [s - half, s + half]])
    return np.sort(edges)


class _LinearCells(NamedTuple):
    """A problem with z linear on each cell of s, zero at both ends: the matrices of its rows."""

    specification: Specification
    reference: Array  # (n_a,) [N m] of the peak
    width: Array  # (k,) of the cells
    mean: Any  # (k, k - 1), z in the middle of the cells
    torque: tuple[Affine, ...]  # of each motor, in the cells without a crossing
    squared_speed: Any  # (k m, k - 1), over the limits
    conditions: Affine

    @staticmethod
    def of(
        branch: Branch, places: Sequence[CrossingPoint], edges: Array, plan: Optimality, before: SquaredSpeed | None
    ) -> _LinearCells:
        """Compute torques, speeds and condition (8) in the middle of the cells, or beside a crossing there."""
        specification = plan.specification
        conditions = [crossing_rows(branch, Smoothstep(0), place, None, before) for place in places]
        # u' is not in these unknowns: without its rows the estimate is lower
        rows = np.array([[s, *row] for s, several in conditions for row in several if row[3] == 0.0]).reshape(-1, 5)
        middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
        on_crossing = (np.abs(middle[:, None] - rows[:, 0]) < SAME_PLACE).any(axis=1)
        asked = demand(
            branch, Smoothstep(0), np.where(on_crossing, middle + CROSSING_OFFSET, middle), None, "rigid", before
        )
        at_edges = sparse.identity(len(edges), format="csr")[:, 1:-1]
        mean = 0.5 * (at_edges[1:] + at_edges[:-1])
        slope = sparse.diags_array(0.5 / width) @ (at_edges[1:] - at_edges[:-1])
        crossed = np.searchsorted(edges, rows[:, 0]) - 1
        smooth = np.setdiff1d(np.arange(len(width)), crossed)  # in a crossing's cell condition (8) stands instead
        constant = asked.torque.constant + asked.friction(specification.friction)

        def combine(z: Array, u: Array, cells: Array) -> Any:
            return sparse.csr_array(sparse.diags_array(z) @ mean[cells] + sparse.diags_array(u) @ slope[cells])

        return _LinearCells(
            specification,
            np.where(specification.limited_motors, specification.torque_limit, plan.reference),
            width,
            mean,
            tuple(
                Affine(combine(per_z[smooth], per_u[smooth], smooth), start[smooth])
                for start, per_z, per_u in zip(constant.T, asked.torque.per_z.T, asked.torque.per_u.T, strict=True)
            ),
            sparse.vstack(
                [sparse.diags_array(ratio**2) @ mean for ratio in (asked.speed / specification.speed_limit).T],
                format="csr",
            ),
            Affine(combine(rows[:, 2], rows[:, 3], crossed), rows[:, 1]),
        )

    def cone_program(self, unit: float) -> ConeProgram:
        """Return the program in a unit of time [s]."""
        goal, limited = self.specification.goal, self.specification.limited_motors
        cells, n = self.mean.shape
        one = sparse.csr_array(np.ones((len(self.torque[0].offset), 1)))
        nonnegative = [Rows({"z": -self.squared_speed / unit**2}, np.ones(self.squared_speed.shape[0]))]
        for motor, (matrix, offset) in enumerate(self.torque):
            for sign in (-1.0, 1.0):
                row = {"z": sign * matrix / (unit**2 * self.reference[motor])}
                start = sign * offset / self.reference[motor]
                if goal == "peak_torque":
                    nonnegative.append(Rows({**row, "peak": one}, start))
                if limited[motor]:
                    nonnegative.append(Rows(row, start + 1.0))
        if self.specification.most is not None:
            longest = np.array([self.specification.most / unit])
            nonnegative.append(Rows({"v": -sparse.csr_array(self.width[None])}, longest))
        z, mean = sparse.identity(n, format="csr"), {"r": self.mean}
        v, zero = sparse.identity(cells, format="csr"), np.zeros(cells)
        cones = [
            [Rows({"z": z}, np.ones(n)), Rows({"z": z}, -np.ones(n)), Rows({"r": 2.0 * z}, np.zeros(n))],
            [Rows({"v": v, **mean}, zero), Rows({"v": v, "r": -self.mean}, zero), Rows({}, zero + 2.0)],
        ]
        cost = {"v": self.width} if goal == "time" else {"peak": np.ones(1)}
        equal = [Rows({"z": self.conditions.matrix / unit**2}, self.conditions.offset)]
        sizes = {"z": n, "r": n, "v": cells, "peak": 1}
        return ConeProgram(sizes, cost, None, equal, nonnegative, cones)
