"""Estimates of the least peak, time and energy of any law on a path, by another discretisation.

    torque = c + cz z + cu u,      z = s'^2,    u = s" = z'/2      condition (8): gamma + beta z + alpha u = 0

z is linear on about a thousand cells of s and zero at both ends. Torques are looked at in the middle of the
cells; a crossing is the middle of one, in which condition (8) stands instead. Accelerations may jump, so
that up to the size of the cells the optimum is below that of every smooth law. It is no bound: where a law
nearly stops, it has been seen 2.5 % above a law that exists.

Torques are virtual work with the closures of `closure_rows`. Of the framework the poses on the path and its
singular points are taken. The energy of a required duration is not convex: the least of several local
optima, each of which waits somewhere else, is no bound either.

Source: Verscheure et al., IEEE TAC 54 (2009).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import clarabel
import numpy as np
import pinocchio as pin
from scipy import sparse

from framework import ParallelRobot, locate_singularities, track_path
from framework.laws.path import Path
from tests.oracles.closure_rows import closure_rows, frame_of
from tests.oracles.forward_simulation import kinematics, mass_matrix, motors, rotors

CELLS = 1000
WAITING_WIDTH = 0.02  # in s, where a law waits at first
MAX_INNER_PLACES, MAX_TANGENTS = 2, 6  # of waits inside the path; of steps from each
MIN_GAIN, NEARLY = 1e-3, 0.999  # of a step, of the energy; of a duration
LEAST_HALF_WIDTH, NARROWER_CELLS = 1 / 64, 10  # of the cell of a crossing, to others there; on either side
WEIGHTLESS = 1e-9  # [1/s^2]: gamma over alpha and beta
MAX_ENTRY = 100.0  # of a row of torques: beside a crossing they are larger, and scaled
TOLERANCE = 1e-10  # of the cone solver: at its own 1e-8 it takes 6 % too much energy for the least
NULL = 1e-9  # of the largest singular value of the closures
MAX_UNIT_CHANGES, MAX_UNIT_RATIO = 6, 4.0
AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Along(NamedTuple):
    """constant + per_z z + per_u u, each (P, k)."""

    constant: np.ndarray
    per_z: np.ndarray
    per_u: np.ndarray


class _Place(NamedTuple):
    """The robot at one s: motions that the closures allow, motors on them, and forces of the open tree."""

    motions: np.ndarray  # (nv, n)
    driven: np.ndarray  # (n, n_a): work of unit motor torques
    forces: np.ndarray  # (3, nv): at rest, per z, per u


def torques_along(robot: ParallelRobot, path: Path, s: np.ndarray) -> Along:
    """Compute the motor torques [N m] at s (P,), none of them singular."""
    found = []
    for place in _places(robot, path, s):
        work = place.motions.T @ place.forces.T
        found.append(np.linalg.lstsq(place.driven, work, rcond=None)[0].T)
    return Along(*np.moveaxis(np.array(found), 1, 0))


def conditions_at(robot: ParallelRobot, path: Path, s: np.ndarray) -> np.ndarray:
    """Compute condition (8) (k, 3), (gamma, beta, alpha), at singular s (k,)."""
    rows = []
    for place in _places(robot, path, s):
        left = np.linalg.svd(place.driven)[0][:, -1]  # the motion that no motor feels
        rows.append(place.forces @ place.motions @ left)
    return np.array(rows).reshape(-1, 3)


def _places(robot: ParallelRobot, path: Path, s: np.ndarray) -> list[_Place]:
    """Compute kinematics and forces at s (P,) on the path."""
    model, data = robot.model, robot.model.createData()
    poses = track_path(robot, path).close(s).q if len(s) else np.empty((0, model.nq))
    points, slopes, bends = (path(s, order) for order in range(3))
    assert len(points) == len(poses)
    unit = np.array([motors(robot, one) for one in np.eye(robot.n_a)]).T
    return [_place(robot, data, unit, q, dx, ddx) for q, dx, ddx in zip(poses, slopes, bends, strict=True)]


def _place(
    robot: ParallelRobot, data: Any, unit: np.ndarray, q: np.ndarray, dx: np.ndarray, ddx: np.ndarray
) -> _Place:
    """Compute one place: q' and q" from closures and platform, then the forces of the open tree."""
    model, still = robot.model, np.zeros(robot.model.nv)
    kinematics(model, data, q, still)
    loops = closure_rows(model, data, robot.description.closures).jacobian
    all_rows = np.vstack([loops, _platform_rows(robot, data)])
    dq = np.linalg.lstsq(all_rows, np.concatenate([np.zeros(len(loops)), dx]), rcond=NULL)[0]
    kinematics(model, data, q, dq)
    drift = closure_rows(model, data, robot.description.closures).drift
    ddq = np.linalg.lstsq(all_rows, np.concatenate([-drift, ddx - _platform_drift(robot, data)]), rcond=NULL)[
        0
    ]
    inertia = mass_matrix(model, data, q) + np.diag(rotors(robot))
    weight = pin.computeGeneralizedGravity(model, data, q).copy()
    centrifugal = pin.nonLinearEffects(model, data, q, dq) - weight
    values, right = np.linalg.svd(loops)[1:]
    motions = right[np.sum(values > NULL * values[0]) :].T
    return _Place(motions, motions.T @ unit, np.array([weight, inertia @ ddq + centrifugal, inertia @ dq]))


def _platform_rows(robot: ParallelRobot, data: Any) -> np.ndarray:
    frame = frame_of(robot.model, robot.description.platform.frame)
    return np.asarray(pin.getFrameJacobian(robot.model, data, frame, AXES)[_platform_axes(robot)])


def _platform_drift(robot: ParallelRobot, data: Any) -> np.ndarray:
    frame = frame_of(robot.model, robot.description.platform.frame)
    return pin.getFrameClassicalAcceleration(robot.model, data, frame, AXES).vector[_platform_axes(robot)]


def _platform_axes(robot: ParallelRobot) -> list[int]:
    """Rows of the platform's twist; one turn at most, about an axis that does not turn."""
    axes = ["x", "y", "z", "rx", "ry", "rz"]
    names = robot.description.platform.axes
    assert names
    assert sum(len(name) == 2 for name in names) <= 1
    return [axes.index(name) for name in names]


# ------------------------------------------------------------------ cells


def edges_about(crossings: np.ndarray, count: int) -> np.ndarray:
    """Return ends of cells in s, narrower towards both ends and crossings, each in the middle of one."""
    edges = 0.5 - 0.5 * np.cos(np.pi * np.arange(count + 1) / count)
    for s in crossings:
        width = 0.5 * np.pi / count * np.sqrt(s * (1.0 - s))
        about = width * np.geomspace(LEAST_HALF_WIDTH, 1.0, NARROWER_CELLS)
        edges = np.concatenate([edges[np.abs(edges - s) > 1.5 * width], s - about, s + about])
    return np.sort(edges)


@dataclass(frozen=True)
class BestLaws:
    """Torques and condition (8) on the cells of a path; estimates of the best of all laws on it."""

    robot: ParallelRobot
    path: Path
    cells: int = CELLS

    @cached_property
    def crossings(self) -> np.ndarray:
        """s (k,) of the singular points."""
        return np.array([point.s for point in locate_singularities(self.robot, self.path)])

    @cached_property
    def edges(self) -> np.ndarray:
        """Ends of the cells in s."""
        return edges_about(self.crossings, self.cells)

    @cached_property
    def rows(self) -> np.ndarray:
        """Condition (8) (k, 3) at the crossings."""
        return conditions_at(self.robot, self.path, self.crossings)

    @cached_property
    def crossed(self) -> np.ndarray:
        """Indices (k,) of the cells with a crossing."""
        return np.searchsorted(self.edges, self.crossings) - 1

    @cached_property
    def smooth(self) -> np.ndarray:
        """Indices of the cells without a crossing."""
        return np.setdiff1d(np.arange(len(self.edges) - 1), self.crossed)

    @cached_property
    def torques(self) -> Along:
        """Torques in the middle of the cells without a crossing."""
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        return torques_along(self.robot, self.path, middle[self.smooth])

    @cached_property
    def holding(self) -> float:
        """The largest torque [N m] at rest at both ends: every smooth law has it."""
        return float(np.abs(torques_along(self.robot, self.path, np.array([0.0, 1.0])).constant).max())

    def least_peak(self, longest: float) -> float:
        """Estimate the least peak [N m] of laws within a duration [s]."""
        return max(self._cone("peak_torque", longest=longest), self.holding)

    def least_time(self, limit: float) -> float:
        """Estimate the least duration [s] of laws within a torque limit [N m]."""
        return self._cone("time", limit=limit)

    def least_energy(self, longest: float) -> float:
        """Estimate the least energy [N^2 m^2 s] of laws within a duration [s]."""
        return self._cone("energy", longest=longest)

    def waiting_places(self) -> list[float]:
        """Return s of the ends, and of the least |torque|^2 at rest between crossings."""
        power = (self.torques.constant**2).sum(axis=1)
        inner = np.flatnonzero((power[1:-1] < power[:-2]) & (power[1:-1] < power[2:])) + 1
        best = inner[np.argsort(power[inner])[:MAX_INNER_PLACES]]
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])[self.smooth]
        return [0.0, 1.0, *map(float, middle[best])]

    def _waiting(self, z: np.ndarray, place: float, duration: float) -> np.ndarray:
        """Return z at the inner edges, lowered about a place so that the law takes a duration [s]."""
        about = np.abs(self.edges[1:-1] - place) < WAITING_WIDTH
        low, high = 1e-12 / duration**2, float(z.max())
        for _ in range(60):
            level = np.sqrt(low * high)
            lowered = np.where(about, np.minimum(z, level), z)
            low, high = (level, high) if self.time(lowered)[0] > duration else (low, level)
        return lowered

    def time(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the duration [s] of z at the inner edges, and its derivatives."""
        root = np.sqrt(np.concatenate([[0.0], np.maximum(z, 1e-300), [0.0]]))
        each = 2.0 * np.diff(self.edges) / (root[1:] + root[:-1])
        slope = each / (root[1:] + root[:-1])
        return float(each.sum()), -0.5 * (slope[1:] + slope[:-1]) / root[1:-1]

    def _operators(self) -> tuple[Any, Any]:
        """Return z in the middle of the cells, and u, of z at the inner edges."""
        at_edges = sparse.identity(len(self.edges), format="csr")[:, 1:-1]
        mean = sparse.csr_array(0.5 * (at_edges[1:] + at_edges[:-1]))
        slope = sparse.diags_array(0.5 / np.diff(self.edges)) @ (at_edges[1:] - at_edges[:-1])
        return mean, sparse.csr_array(slope)

    def _torque_rows(self) -> list[Any]:
        """Return the matrix of each motor's torque on z at the inner edges."""
        mean, slope = (matrix[self.smooth] for matrix in self._operators())
        per_z, per_u = self.torques.per_z.T, self.torques.per_u.T
        return [
            sparse.diags_array(z) @ mean + sparse.diags_array(u) @ slope
            for z, u in zip(per_z, per_u, strict=True)
        ]

    def _condition_rows(self) -> Any:
        mean, slope = (matrix[self.crossed] for matrix in self._operators())
        return sparse.diags_array(self.rows[:, 1]) @ mean + sparse.diags_array(self.rows[:, 2]) @ slope

    def _units(self, limit: float | None = None) -> tuple[float, float]:
        """Return units of time [s] and torque [N m] by condition (8) and weight; 1 s where nothing falls."""
        gamma, inertia = np.abs(self.rows[:, 0]), np.abs(self.rows[:, 1:]).max(axis=1)
        falls = gamma > WEIGHTLESS * inertia
        time = float(np.sqrt(inertia[falls] / gamma[falls]).min(initial=np.inf))
        if not np.isfinite(time):
            size = float(np.median(np.abs(self.torques.per_u)))
            return (1.0, size) if limit is None else (float(np.sqrt(size / limit)), limit)
        return time, limit or float(np.median(np.abs(self.torques.constant)))

    def _cone(self, goal: str, **bounds: float) -> float:
        """Return the optimum; NaN where the solver finds none."""
        solution = self._solution(goal, **bounds)
        return np.nan if solution is None else solution.value

    def _solution(
        self,
        goal: str,
        longest: float | None = None,
        limit: float | None = None,
        *,
        tangent: _Tangent | None = None,
        start: _Optimum | None = None,
    ) -> _Optimum | None:
        """Solve in units that are corrected by the optimum, first those of a start."""
        unit, size = self._units(limit)
        unit = min(longest or np.inf, unit)
        if start is not None:
            unit, size = start.duration, np.sqrt(start.value / start.duration)
        for _ in range(MAX_UNIT_CHANGES):
            found = _ConeProgram(self, goal, unit, size, longest, limit, tangent).solve()
            if found is None:
                unit *= 0.3
                continue
            own = np.sqrt(found.value / found.duration) if goal == "energy" else found.peak
            ratios = np.array([found.duration / unit, 1.0 if limit else own / size])
            if max(ratios.max(), 1.0 / ratios.min()) < MAX_UNIT_RATIO:
                break
            unit, size = found.duration, limit or own
        return found


class _Tangent(NamedTuple):
    """A required duration [s], and the z (k,) at whose tangent to T(z) it is asked for."""

    z: np.ndarray
    duration: float


class _Optimum(NamedTuple):
    """The optimum, its duration [s] and peak [N m], and z (k,) [1/s^2] at the inner edges."""

    value: float
    duration: float
    peak: float
    z: np.ndarray


class _ConeProgram:
    """One program in units of time [s] and torque [N m]: z, peak, roots r, durations v, energies e."""

    def __init__(
        self,
        laws: BestLaws,
        goal: str,
        unit: float,
        size: float,
        longest: float | None,
        limit: float | None,
        tangent: _Tangent | None,
    ) -> None:
        self.laws, self.goal, self.unit, self.size, self.limit = laws, goal, unit, size, limit
        self.longest, self.tangent = longest, tangent
        self.cells = len(laws.edges) - 1
        self.n = self.cells - 1
        energies = len(laws.smooth) if goal == "energy" else 0
        self.sizes = {"z": self.n, "peak": 1, "r": self.n, "v": self.cells, "e": energies}
        self.matrices: list[Any] = []
        self.offsets: list[np.ndarray] = []
        self.cones: list[Any] = []

    def rows(self, **blocks: Any) -> Any:
        """Return rows of all unknowns."""
        height = next(iter(blocks.values())).shape[0]
        return sparse.hstack(
            [blocks.get(name, sparse.csr_array((height, size))) for name, size in self.sizes.items()],
            format="csr",
        )

    def add(self, cone: Any, matrix: Any, offset: np.ndarray) -> None:
        """Ask for matrix x + offset in a cone."""
        self.matrices.append(-matrix)
        self.offsets.append(offset)
        self.cones.append(cone)

    def add_products(
        self, first: Any, second: Any, root: Sequence[Any], constants: Sequence[np.ndarray]
    ) -> None:
        """Ask for first * second >= sum of (root + constant)^2, each line one cone."""
        height, parts = first.shape[0], [first + second, first - second, *(2.0 * one for one in root)]
        order = np.arange(len(parts) * height).reshape(len(parts), height).T.ravel()
        zero = np.zeros(height)
        matrix = sparse.csr_array(sparse.vstack(parts))[order]
        offset = np.stack([zero, zero, *(2.0 * one for one in constants)]).T.ravel()
        self.matrices.append(-matrix)
        self.offsets.append(offset)
        self.cones += [clarabel.SecondOrderConeT(len(parts))] * height

    def solve(self) -> _Optimum | None:
        """Return the optimum in SI units; None where the solver finds none."""
        laws = self.laws
        torques = [matrix / (self.size * self.unit**2) for matrix in laws._torque_rows()]
        starts = list(laws.torques.constant.T / self.size)
        self._add_condition()
        self._add_peak(torques, starts)
        self._add_bounds()
        self._add_roots(np.diff(laws.edges), torques, starts)
        counted = {"time": "v", "peak_torque": "peak", "energy": "e"}[self.goal]
        objective = (
            np.concatenate([np.full(size, name == counted) for name, size in self.sizes.items()]) * 1.0
        )
        solved = self._solved(objective)
        if solved is None:
            return None
        x = np.array(solved.x)
        z = x[: self.n]
        peaks = [np.abs(m @ z + c).max() for m, c in zip(torques, starts, strict=True)]
        scale = {"time": self.unit, "peak_torque": self.size, "energy": self.size**2 * self.unit}[self.goal]
        duration = laws.time(z)[0] * self.unit
        return _Optimum(
            float(objective @ x) * scale, duration, float(max(peaks)) * self.size, z / self.unit**2
        )

    def _add_condition(self) -> None:
        """Ask for condition (8) in the cells with a crossing."""
        condition = self.laws._condition_rows() / self.unit**2
        norm = 1.0 / np.abs(condition).max(axis=1).toarray().ravel()
        rows = self.rows(z=sparse.diags_array(norm) @ condition)
        self.add(clarabel.ZeroConeT(len(norm)), rows, norm * self.laws.rows[:, 0])

    def _add_peak(self, torques: list[Any], starts: list[np.ndarray]) -> None:
        """Ask for torques up to the peak."""
        one = sparse.csr_array(np.ones((len(starts[0]), 1)))
        for matrix, start in zip(torques, starts, strict=True):
            largest = np.abs(matrix).max(axis=1).toarray().ravel()
            big = sparse.diags_array(1.0 / np.maximum(1.0, largest / MAX_ENTRY))
            for sign in (1.0, -1.0):
                rows = self.rows(z=sign * big @ matrix, peak=big @ one)
                self.add(clarabel.NonnegativeConeT(len(start)), rows, sign * big @ start)

    def _add_bounds(self) -> None:
        """Ask for the limit, the longest duration, and the tangent of a required one."""
        if self.limit is not None:
            ceiling = self.rows(peak=sparse.csr_array([[-1.0]]))
            self.add(clarabel.NonnegativeConeT(1), ceiling, np.array([self.limit / self.size]))
        if self.longest is not None:
            whole = self.rows(v=sparse.csr_array(-np.ones((1, self.cells))))
            self.add(clarabel.NonnegativeConeT(1), whole, np.array([self.longest / self.unit]))
        if self.tangent is not None:
            time, slope = self.laws.time(self.tangent.z)
            row, offset = slope / self.unit**2, time - slope @ self.tangent.z - self.tangent.duration
            norm = float(np.abs(row).max())
            above = self.rows(z=sparse.csr_array(row[None] / norm))
            self.add(clarabel.NonnegativeConeT(1), above, np.array([offset / norm]))

    def _add_roots(self, width: np.ndarray, torques: list[Any], starts: list[np.ndarray]) -> None:
        """Ask for r^2 <= z, v r >= width in the mean of a cell, and e r >= width torque^2."""
        root = sparse.identity(self.n, format="csr")
        z, constant = self.rows(z=root), np.ones(self.n)
        height = np.arange(3 * self.n).reshape(3, self.n).T.ravel()
        matrix = sparse.csr_array(sparse.vstack([z, z, 2.0 * self.rows(r=root)]))[height]
        self.matrices.append(-matrix)
        self.offsets.append(np.stack([constant, -constant, 0 * constant]).T.ravel())
        self.cones += [clarabel.SecondOrderConeT(3)] * self.n
        mean, _ = self.laws._operators()
        each = sparse.identity(self.cells, format="csr")
        scale = sparse.diags_array(1.0 / np.sqrt(width))
        nothing = self.rows(v=0.0 * each)
        self.add_products(
            self.rows(v=scale @ each), self.rows(r=scale @ mean), [nothing], [np.ones(self.cells)]
        )
        if self.goal == "energy":
            smooth = self.laws.smooth
            each, mean, h = sparse.identity(len(smooth), format="csr"), mean[smooth], np.sqrt(width[smooth])
            self.add_products(
                self.rows(e=each),
                self.rows(r=mean),
                [self.rows(z=sparse.diags_array(h) @ matrix) for matrix in torques],
                [h * start for start in starts],
            )

    def _solved(self, objective: np.ndarray) -> Any:
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.direct_solve_method, settings.max_threads = False, "qdldl", 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
        n = len(objective)
        solution = clarabel.DefaultSolver(
            sparse.csc_matrix((n, n)),
            objective,
            sparse.csc_matrix(sparse.vstack(self.matrices)),
            np.concatenate(self.offsets),
            self.cones,
            settings,
        ).solve()
        return solution if str(solution.status) in ("Solved", "AlmostSolved") else None


# ------------------------------------------------------------------ energy of a required duration


def least_energy_lasting(laws: BestLaws, duration: float) -> float:
    """Estimate the least energy [N^2 m^2 s] of laws of a duration [s]: the least found from several starts.

    T(z) is convex, and its tangent at a slow z is at least D where T is; the first z waits at one place.
    """
    free = laws._solution("energy", longest=duration)
    if free is None:
        return np.nan
    found = [free.value] if free.duration > NEARLY * duration else []
    for place in [] if found else laws.waiting_places():
        z, least = laws._waiting(free.z, place, duration), np.inf
        for _ in range(MAX_TANGENTS):
            solution = laws._solution("energy", longest=None, tangent=_Tangent(z, duration), start=free)
            if solution is None or solution.value > (1.0 - MIN_GAIN) * least:
                break
            z, least = solution.z, solution.value
        found.append(least if solution is None else min(least, solution.value))
    return min(found)
