"""Estimates of the least energy of any law on a path, by another discretisation.

    torque = c + cz z + cu u,      z = s'^2,    u = s" = z'/2      condition (8): gamma + beta z + alpha u = 0

z is linear on cells of s and zero at both ends. Torques are looked at in the middle of the cells; a crossing
is the middle of one, in which condition (8) stands instead. Accelerations may jump, so that up to the size of
the cells the optimum is below that of every smooth law. The energy and the duration are convex in z, and so
is the problem within a longest duration. That of a required duration is not: it has several local optima,
each of which waits somewhere else, and the least of those found is no bound.

Torques are virtual work with the closures of `closure_rows`. Of the framework the poses on the path and its
singular points are taken.

Source: Verscheure et al., IEEE TAC 54 (2009).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from framework import ParallelRobot, locate_singularities, track_path
from framework.laws.path import Path
from tests.oracles.closure_rows import closure_rows, frame_of
from tests.oracles.forward_simulation import kinematics, mass_matrix, motors, rotors

CELLS = 120
LEAST_HALF_WIDTH, NARROWER_CELLS = 1 / 64, 10  # of the cell of a crossing, to others there; on either side
NULL = 1e-9  # of the largest singular value of the closures
PACES = np.geomspace(1.0, 30.0, 60)  # of the first law, over the slowest
WAITING_WIDTH = 0.05  # in s, where a law of a required duration waits at first
LEAST_SPEED = 1e-4  # over the first law's
SETTLED, MAX_STEPS = 1e-10, 1000  # change of the energy over the first law's; steps
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


def edges_about(crossings: np.ndarray, count: int) -> np.ndarray:
    """Return ends of cells in s, narrower towards both ends and crossings, each in the middle of one."""
    edges = 0.5 - 0.5 * np.cos(np.pi * np.arange(count + 1) / count)
    for s in crossings:
        width = 0.5 * np.pi / count * np.sqrt(s * (1.0 - s))
        about = width * np.geomspace(LEAST_HALF_WIDTH, 1.0, NARROWER_CELLS)
        edges = np.concatenate([edges[np.abs(edges - s) > 1.5 * width], s - about, s + about])
    return np.sort(edges)


@dataclass(frozen=True)
class EnergyOnCells:
    """Energy, duration and condition (8) of laws by their speeds s' at the inner edges of cells."""

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
    def width(self) -> np.ndarray:
        return np.diff(self.edges)

    @cached_property
    def crossed(self) -> np.ndarray:
        """Indices (k,) of the cells with a crossing."""
        return np.searchsorted(self.edges, self.crossings) - 1

    @cached_property
    def smooth(self) -> np.ndarray:
        """Indices of the cells without a crossing."""
        return np.setdiff1d(np.arange(len(self.width)), self.crossed)

    @cached_property
    def rows(self) -> np.ndarray:
        """Condition (8) (k, 3) at the crossings, each row of size 1."""
        rows = conditions_at(self.robot, self.path, self.crossings)
        return rows / np.abs(rows).max(axis=1, keepdims=True)

    @cached_property
    def torques(self) -> Along:
        """Torques in the middle of the cells without a crossing."""
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        return torques_along(self.robot, self.path, middle[self.smooth])

    def square_and_acceleration(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return z and u in the middle of the cells."""
        z = np.concatenate([[0.0], speed, [0.0]]) ** 2
        return 0.5 * (z[1:] + z[:-1]), 0.5 * np.diff(z) / self.width

    def mean_speed(self, speed: np.ndarray) -> np.ndarray:
        """Return s' in the middle of the cells."""
        speed = np.concatenate([[0.0], speed, [0.0]])
        return 0.5 * (speed[1:] + speed[:-1])

    def duration(self, speed: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the duration [s] and its derivatives by the speeds."""
        mean = self.mean_speed(speed)
        slope = -0.5 * self.width / mean**2
        return float((self.width / mean).sum()), slope[1:] + slope[:-1]

    def energy(self, speed: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the energy [N^2 m^2 s] and its derivatives by the speeds."""
        z, u = (part[self.smooth, None] for part in self.square_and_acceleration(speed))
        torque = self.torques.constant + self.torques.per_z * z + self.torques.per_u * u
        power, time = (torque**2).sum(axis=1), self.width[self.smooth] / self.mean_speed(speed)[self.smooth]
        by_z, by_u, by_mean = np.zeros((3, len(self.width)))
        by_z[self.smooth] = 2.0 * time * (torque * self.torques.per_z).sum(axis=1)
        by_u[self.smooth] = 2.0 * time * (torque * self.torques.per_u).sum(axis=1)
        by_mean[self.smooth] = -time * power / self.mean_speed(speed)[self.smooth]
        bend = by_u / self.width
        by_square = 0.5 * (by_z[1:] + by_z[:-1] + bend[:-1] - bend[1:])
        return float(time @ power), 2.0 * speed * by_square + 0.5 * (by_mean[1:] + by_mean[:-1])

    def conditions(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left of condition (8) (k,) and its derivatives (k, n) by the speeds."""
        z, u = (part[self.crossed] for part in self.square_and_acceleration(speed))
        slopes = np.zeros((len(self.rows), len(self.edges)))
        half, bend = 0.5 * self.rows[:, 1], 0.5 * self.rows[:, 2] / self.width[self.crossed]
        for row, k in enumerate(self.crossed):
            slopes[row, k : k + 2] = half[row] - bend[row], half[row] + bend[row]
        left = self.rows[:, 0] + self.rows[:, 1] * z + self.rows[:, 2] * u
        return left, 2.0 * speed * slopes[:, 1:-1]

    def quickest_start(self, duration: float) -> np.ndarray:
        """Return the speeds of least energy among multiples of one law that takes a duration [s] or less."""
        speed = np.sqrt(self.edges[1:-1] * (1.0 - self.edges[1:-1]))
        speed *= self.duration(speed)[0] / duration
        return min((speed * pace for pace in PACES), key=lambda speed: self.energy(speed)[0])

    def waiting_start(self, duration: float, place: float) -> np.ndarray:
        """Return speeds lowered about a place until the law takes a duration [s]."""
        speed, low, high = self.quickest_start(duration), 1e-6, 1.0
        about = np.abs(self.edges[1:-1] - place) < WAITING_WIDTH
        for _ in range(60):
            level = np.sqrt(low * high)
            lasting = self.duration(np.where(about, level * speed, speed))[0]
            low, high = (level, high) if lasting > duration else (low, level)
        return np.where(about, low * speed, speed)

    def least(self, duration: float, start: np.ndarray, kind: str) -> float:
        """Return the optimum next to a start, of at most (`ineq`) or exactly (`eq`) this duration [s]."""
        size, scale = self.energy(start)[0], start.max() ** 2

        def relative(ratio: np.ndarray) -> tuple[float, np.ndarray]:
            value, slope = self.energy(ratio * start)
            return value / size, slope * start / size

        within = {
            "type": kind,
            "fun": lambda ratio: 1.0 - self.duration(ratio * start)[0] / duration,
            "jac": lambda ratio: -self.duration(ratio * start)[1] * start / duration,
        }
        crossing = {
            "type": "eq",
            "fun": lambda ratio: self.conditions(ratio * start)[0] / scale,
            "jac": lambda ratio: self.conditions(ratio * start)[1] * start / scale,
        }
        found: Any = minimize(
            relative,
            np.ones(len(start)),
            jac=True,
            method="SLSQP",
            bounds=[(LEAST_SPEED, None)] * len(start),
            constraints=[within, crossing],
            options={"maxiter": MAX_STEPS, "ftol": SETTLED},
        )
        return float(found.fun * size)


def least_energy(robot: ParallelRobot, path: Path, longest: float) -> float:
    """Estimate the least energy [N^2 m^2 s] of laws within a duration [s]."""
    laws = EnergyOnCells(robot, path)
    return laws.least(longest, laws.quickest_start(longest), "ineq")


def least_energy_lasting(robot: ParallelRobot, path: Path, duration: float) -> float:
    """Estimate the least energy [N^2 m^2 s] of laws of a duration [s] that wait at one of the ends."""
    laws = EnergyOnCells(robot, path, 100)
    return min(laws.least(duration, laws.waiting_start(duration, place), "eq") for place in (0.0, 1.0))
