"""The result of `simulate`: the motion and its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.closures import loop_wrenches
from framework.kinematics.frames import frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.output import select_fields
from framework.simulation.drive import PlannedMotion
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.methods import Integration
from framework.simulation.trajectory import Cubics, Occurrence, Trajectory
from framework.tolerances import FILE_ROUNDING


@dataclass(frozen=True, repr=False, eq=False)
class Simulation(ReadOnlyArrays):
    """A simulated motion with its errors.

    Attributes:
        tracking_error: largest distance of the platform from its planned position at the same instant [m];
            for a platform that only turns, the largest angle [rad]. None without a planned motion.
        turning_error: largest angle from the planned attitude [rad]; None unless the platform both moves and
            turns, and a planned motion exists.
        closure_error: largest residual of all loop equations, redundant ones included, at `times` and at the
            ends of all steps [m or rad].
        energy_error: largest difference, at the ends of steps, between the change of kinetic, elastic and
            gravitational energy and the work of motors, wrenches and damping, over the energy exchanged.
        unresolved: estimate of the largest part of the motion that a step leaves out [rad, robot lengths]. It
            is above the tolerance only where the loops lose rank for an instant. For method fast the estimate
            is that of all steps together.
    """

    robot: ParallelRobot
    method: str
    times: Array  # (T,) [s]
    q: Array  # (T, nq)
    v: Array  # (T, nv)
    tracking_error: float | None
    turning_error: float | None
    closure_error: float
    energy_error: float
    unresolved: float
    steps: int
    iterations: int  # of Newton's method; of fixed steps, their number
    seconds: float  # computing time
    occurrences: tuple[Occurrence, ...]
    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Simulated time [s], up to a terminal event."""
        return float(self.times[-1])

    def configuration(self, t: ArrayLike) -> Array:
        """Return all coordinates (T, nq) at t (T,) [s]."""
        return self._states(t)[0]

    def velocity(self, t: ArrayLike) -> Array:
        """Return all joint rates (T, nv) at t (T,) [s]."""
        return self._states(t)[1]

    def _states(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return coordinates (T, nq) and rates (T, nv) at t (T,) [s]."""
        return self.trajectory(np.atleast_1d(np.asarray(t, dtype=float)))

    def platform(self, t: ArrayLike, order: int = 0) -> Array:
        """Compute platform coordinates (T, n) [m, rad] at t (T,) [s]; with order 1 the twist on its axes."""
        if order not in (0, 1):
            raise InvalidInput(f"order: 0 or 1, got {order!r}")
        q, v = self._states(t)
        frames = frames_at(self.robot, q)
        if order == 1:
            return np.matvec(self.robot.platform.jacobian(frames), v)
        return self.robot.platform.coordinates(frames)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of the result, for JSON."""
        errors = ("tracking_error", "turning_error", "closure_error", "energy_error")
        return {
            "robot": self.robot.name,
            "flexibility": self.robot.flexibility,
            **select_fields(self, "method", "duration", *errors),
            "unresolved": self.unresolved if np.isfinite(self.unresolved) else None,
            "steps": self.steps,
            "events": [{"name": event.name, "time": event.time} for event in self.occurrences],
            "seconds": self.seconds,
        }

    def __repr__(self) -> str:
        """Return robot, method, duration, number of steps and errors in one line."""
        tracking = "" if self.tracking_error is None else f", tracking error {self.tracking_error:.1e}"
        return (
            f"Simulation({self.robot.name}, {self.robot.flexibility}, {self.method}: {self.duration:g} s in "
            f"{self.steps} steps{tracking}, closure error {self.closure_error:.1e}, energy error "
            f"{self.energy_error:.1e})"
        )


def simulation_result(
    equations: EquationsOfMotion,
    method: str,
    run: Integration,
    planned: PlannedMotion | None,
    *,
    samples: int,
    seconds: float,
) -> Simulation:
    """Return the result of a run, with states at equidistant instants and errors.

    Args:
        method: name of the method, of `METHODS`.
        planned: the planned motion with which the run is compared, if any.
        samples: number of equidistant instants; fixed steps are reported at their ends instead.
        seconds: computing time [s].
    """
    robot, trajectory = equations.robot, run.trajectory
    edges = trajectory.edges
    occurrences = tuple(run.record.occurred)
    end = min([edges[-1], *(event.time for event in occurrences if event.terminal)])

    if isinstance(trajectory, Cubics):  # fixed steps
        times = np.append(edges[edges < end], end)
    else:
        times = np.linspace(edges[0], end, samples)
    q, v = trajectory(times)
    edge_q, edge_v = trajectory(edges)  # at the ends of all steps

    tracking, turning = (None, None) if planned is None else _path_errors(robot, planned, times, q)
    return Simulation(
        robot=robot,
        method=method,
        times=times,
        q=q,
        v=v,
        tracking_error=tracking,
        turning_error=turning,
        closure_error=max(_largest_gap(robot, times, q), _largest_gap(robot, edges, edge_q)),
        energy_error=_energy_error(equations, run, edge_q, edge_v),
        unresolved=run.unresolved,
        steps=len(edges) - 1,
        iterations=run.iterations,
        seconds=seconds,
        occurrences=occurrences,
        trajectory=trajectory,
    )


def _energy_error(equations: EquationsOfMotion, run: Integration, q: Array, v: Array) -> float:
    """Compute the `energy_error` of a `Simulation`.

    The error is divided by the largest of the work exchanged, the range of the energy, and the kinetic
    energy. The divisor is at least the rounding error of the work that lifts the robot by its length, or
    accelerates it over its length in the duration.

    Args:
        run: the run, with the energy that motors and external wrenches supplied.
        q, v: states (K + 1, nq) and (K + 1, nv) at the ends of all steps.
    """
    robot = equations.robot
    energy = equations.energy(q, v)  # (K + 1,)
    error = np.abs(energy - energy[0] - np.array(run.record.supplied)).max()
    kinetic = energy - equations.energy(q, np.zeros_like(v))

    # the divisor: the energy exchanged, at least its rounding
    gravity = np.linalg.norm(robot.model.gravity.linear)
    duration = run.trajectory.edges[-1] - run.trajectory.edges[0]
    acceleration = gravity + robot.length / duration**2
    rounding = np.finfo(float).eps * robot.mass * acceleration * robot.length
    exchanged = max(run.record.exchanged, np.ptp(energy), kinetic.max(), rounding)
    return float(error / exchanged) if exchanged > 0 else 0.0


def _largest_gap(robot: ParallelRobot, times: Array, q: Array) -> float:
    """Compute the largest residual [m or rad] of all loop equations at times (T,) [s] and q (T, nq).

    Redundant loop equations are included: they were not integrated, but must hold as well.

    Raises:
        NotAssembled: a loop equation opens that was redundant at the reference.
    """
    gaps = np.abs(loop_wrenches(robot.rows, frames_at(robot, q)).residual)  # (T, rows)
    dropped = robot.structure.dropped
    integrated = gaps[:, robot.structure.independent]
    # a dropped equation follows from the others, so it may be open by some multiple of their gaps
    allowed = FILE_ROUNDING * robot.row_lengths[dropped] + 10 * integrated.max(initial=0.0)
    torn = gaps[:, dropped] > allowed  # (T, redundant equations)
    if torn.any():
        instant = int(np.argmax(torn.any(axis=1)))
        row = int(dropped[np.argmax(torn[instant])])
        raise NotAssembled(
            f"{robot.name}: the simulation tears a loop: {robot.rows.names[row]}, which repeats other loop "
            f"equations at the reference, is open by {gaps[instant, row]:.3g} m or rad at t = "
            f"{times[instant]:.6g} s; give a reference that lies on the motion",
            q=q[instant],
            residual=float(gaps[instant, row]),
        )
    return float(gaps.max(initial=0.0))


def _path_errors(
    robot: ParallelRobot, planned: PlannedMotion, times: Array, q: Array
) -> tuple[float, float | None]:
    """Compute `tracking_error` and `turning_error` of a `Simulation` at times (T,) [s] and q (T, nq).

    Returns:
        The largest distance [m] of the platform from its plan, and the largest angle [rad] or None. For a
        platform that only turns the angle stands alone, in the first place.
    """
    x = planned.platform(np.minimum(times, planned.duration))  # (T, n)
    offset = robot.platform.residual(frames_at(robot, q), x)  # (T, n)
    masks = [mask for mask in (robot.translations, ~robot.translations) if mask.any()]  # (n,) each
    errors = [float(np.linalg.norm(offset[:, mask], axis=1).max()) for mask in masks]
    tracking_error, *turning_error = errors  # a platform that only moves or only turns has one error
    return tracking_error, turning_error[0] if turning_error else None
