"""`simulate`: drive a robot with motor torques, integrate its motion, and measure the errors.

A simulation is the second witness of a plan: do the planned torques produce the planned motion? All
coordinates are integrated, loops and springs included, and the equations stay regular at a Type 2
singularity. The simulation shares with the inverse dynamics:

* the robot: the tree with its springs as pinocchio reads it, index sets, gears, rotors (`model`);
* frames, loop equations with Jacobian and drift, and the platform's coordinates (`kinematics.frames`,
  `closures`, `platform`); the choice of independent equations and of idle joints (`kinematics.assembly`);
  the slopes of loops and wrenches in Newton's method, which affect its speed but not its solution;
* the start, which is the plan's own.

The computation of forces is not shared: the simulation has no law, no matrix A, no elimination of loop
forces, no condition at a crossing and no prescribed deflections. A fault in a shared part would make both
wrong alike. Therefore the tests compare every robot with equations of motion that share only the tree and
the keys of the robot file (`tests/oracles`: equations_of_motion.py at instants, forward_simulation.py by
integration).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from warnings import warn

import numpy as np

from framework.errors import (
    InvalidInput,
    NotAssembled,
    check_choice,
    expect,
    finite_numbers,
    real_numbers,
    whole_number,
)
from framework.kinematics.closures import loop_wrenches
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import linearised_at, require_closed_rates
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.platform import JointPlatform
from framework.laws.law import check_duration
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.fields import MAX_ROWS, MIN_ROWS
from framework.numerics.output import select_fields
from framework.simulation.consistent_states import ROUNDING_STEP, consistent_state
from framework.simulation.drive import Drive, ForceFunction, PlannedMotion, planned_motion
from framework.simulation.equations import EquationsOfMotion, State
from framework.simulation.methods import (
    METHODS,
    MethodSettings,
    RunRecord,
    integrate_by_collocation,
    integrate_by_fixed_steps,
)
from framework.simulation.trajectory import Cubics, Event, Occurrence, Trajectory
from framework.tolerances import AT_REST, FILE_ROUNDING, SAME_PLACE


@dataclass(frozen=True, repr=False, eq=False)
class Simulation(ReadOnlyArrays):
    """A simulated motion with its errors.

    Attributes:
        tracking_error: largest distance of the platform from its planned position at the same instant [m];
            for a platform that only turns, the largest angle [rad]. None without a planned motion.
        turning_error: largest angle from the planned attitude [rad]; None unless the platform both moves and
            turns, and a planned motion exists.
        frame_error: largest distance [m] of the platform's frame from its planned place; None unless the
            platform's coordinates are positions of joints, and a motion of this robot is planned.
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
    frame_error: float | None
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
        times = np.atleast_1d(real_numbers("t", t))
        if times.ndim > 1:
            raise InvalidInput(f"t: needs an instant or a list of instants (T,) [s], got shape {times.shape}")
        return self.trajectory(times)

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
        """Return method, errors, steps, events and computing time of the result, for JSON."""
        errors = ("tracking_error", "turning_error", "frame_error", "closure_error", "energy_error")
        return {
            "robot": self.robot.name,
            "flexibility": self.robot.flexibility,
            **select_fields(self, "method", "duration", *errors),
            # null if the estimate has overflowed, as JSON has no infinity
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


def _energy_error(equations: EquationsOfMotion, record: RunRecord, edges: Array, q: Array, v: Array) -> float:
    """Compute the `energy_error` of a `Simulation`.

    The error is divided by the largest of the work exchanged, the range of the energy, and the kinetic
    energy. The divisor is at least the rounding error of the work that lifts the robot by its length, or
    accelerates it over its length in the duration.

    Args:
        edges: (K + 1,) [s] ends of all steps.
        q, v: states (K + 1, nq) and (K + 1, nv) there.
    """
    robot = equations.robot
    energy = equations.energy(q, v)  # (K + 1,)
    error = np.abs(energy - energy[0] - np.array(record.supplied)).max()
    kinetic = energy - equations.energy(q, np.zeros_like(v))

    # the divisor: the energy exchanged, at least the rounding of a typical work
    gravity = np.linalg.norm(robot.model.gravity.linear)
    acceleration = gravity + robot.length / (edges[-1] - edges[0]) ** 2
    rounding = np.finfo(float).eps * robot.mass * acceleration * robot.length
    exchanged = max(record.exchanged, np.ptp(energy), kinetic.max(), rounding)
    return float(error / exchanged) if exchanged > 0 else 0.0


def _largest_gap(robot: ParallelRobot, times: Array, q: Array) -> float:
    """Compute the largest residual [m or rad] of all loop equations at times (T,) [s] and q (T, nq).

    Redundant loop equations are included: the simulation leaves them out, because they follow from the others
    at the reference. They must hold along the whole motion.

    Raises:
        NotAssembled: a loop equation opens that was redundant at the reference.
    """
    gaps = np.abs(loop_wrenches(robot.rows, frames_at(robot, q)).residual)  # (T, rows)
    solved = robot.structure.spanning  # indices of the rows; higher ones are rounded and not among `rows`
    solved = solved[solved < gaps.shape[1]]
    redundant = np.setdiff1d(np.arange(gaps.shape[1]), solved)
    largest_independent = gaps[:, solved].max(initial=0.0)
    # A redundant row is a combination of independent ones, so their gaps may add up in it: the factor 10 is a
    # margin for that. Frames that are rounded in the robot file open it, too.
    allowed = FILE_ROUNDING * robot.row_lengths[redundant] + 10 * largest_independent
    is_torn = gaps[:, redundant] > allowed  # (T, redundant rows)
    if is_torn.any():
        instant = int(np.argmax(is_torn.any(axis=1)))  # the first
        row = int(redundant[np.argmax(is_torn[instant])])
        raise NotAssembled(
            f"the simulation tears a loop: {robot.rows.names[row]}, which repeats other loop "
            f"equations at the reference, is open by {gaps[instant, row]:.3g} m or rad at t = "
            f"{times[instant]:.6g} s; give a reference that lies on the motion",
            name=robot.name,
            q=q[instant],
            residual=float(gaps[instant, row]),
        )
    return float(gaps.max(initial=0.0))


def _tracking_errors(
    robot: ParallelRobot, planned: PlannedMotion, times: Array, q: Array
) -> tuple[float, float | None, float | None]:
    """Compute tracking, turning and frame error of a `Simulation` at times (T,) [s] and q (T, nq)."""
    instants = np.minimum(times, planned.duration)  # rounding may exceed the duration
    frames = frames_at(robot, q)
    offset = robot.platform.residual(frames, planned.platform(instants))  # (T, n)
    masks = [mask for mask in (robot.translations, ~robot.translations) if mask.any()]  # (n,) each
    errors = [float(np.linalg.norm(offset[:, mask], axis=1).max()) for mask in masks]
    tracking_error, *turning_error = errors  # a platform that only moves or only turns has one error
    planned_q = planned.configuration(instants)
    frame_error = None
    if isinstance(robot.platform, JointPlatform) and planned_q.shape == q.shape:  # else with other springs
        distance = frames.platform_origin - frames_at(robot, planned_q).platform_origin  # (T, 3)
        frame_error = float(np.linalg.norm(distance, axis=1).max())
    return tracking_error, turning_error[0] if turning_error else None, frame_error


def simulate(
    robot: ParallelRobot | PlannedMotion,
    drive: PlannedMotion | Callable[..., ArrayLike] | None = None,
    *,
    method: str = "reference",
    start: ArrayLike | None = None,
    start_velocity: ArrayLike | None = None,
    duration: float | None = None,
    tolerance: float | None = None,
    step: float | None = None,
    stages: int | None = None,
    damping: ArrayLike | None = None,
    wrenches: Mapping[str, Any] | None = None,
    forces: Mapping[str, ForceFunction] | None = None,
    breaks: Sequence[float] = (),
    events: Sequence[Event] = (),
    samples: int = 501,
    progress: Callable[[float], None] | None = None,
) -> Simulation:
    """Simulate the forward dynamics of a robot under motor torques.

    Args:
        robot: the robot; or a plan without a `drive`, which is simulated on the plan's own robot.
        drive: a plan or a result of `inverse_dynamics`, applied without the torque that overcomes dry
            friction, as the simulated robot has none; or motor torques (n_a,) [N m], motor side, as
            torque(t) or as feedback torque(t, q, v).
        method: reference (collocation to `tolerance`, 1e-12); stiff (the same with fewer stages and 1e-7:
            fast vibrations that nothing excites cost nothing); fast (fixed steps of order 2, 1e-3 s, with the
            torque constant over a step, as in a control loop). Deprecated: explicit, which is reference.
        start, start_velocity: q (nq,) and v (nv,) at t = 0. By default they come from the planned motion (if
            it was planned with other springs: the assembled pose of its first point, at rest), else they are
            the assembled reference and rest. From there the loops are closed and massless parts balanced.
        duration: [s]; by default that of the planned motion.
        tolerance: what a step of reference or stiff may leave unresolved [rad, robot lengths].
        step: fixed step of fast, longest step of the others [s].
        stages: collocation nodes of a step, 3 to 30.
        damping: viscous damping added to that of the joints [N m s/rad, N s/m], one number or (nv,).
        wrenches: external wrenches by link or joint, each on this body at its origin, (force, moment) (6,)
            [N, N m] or a table over s; by default those of the planned motion; {} for none. A table needs a
            planned motion, which determines s at each instant.
        forces: forces of the world by joint or frame, functions of t, q (nq,), v (nv,): of a joint that moves
            its own force or torque, of other frames and links force and moment (6,) there, on base axes.
        breaks: instants [s] at which torque(t) jumps or has a kink; planned motions bring their own.
        events: functions whose zeros are reported; see `Event`.
        samples: number of equidistant instants in the result of reference and stiff; fast returns the ends of
            its steps.
        progress: called with the finished share of the motion, 0 to 1.

    Raises:
        InvalidInput: an invalid method, option or start; a motion with neither mass nor stiffness.
        NotAssembled: the loops do not close from the start, or a loop equation opens that was redundant at
            the reference.
        NotConverged: from some instant on no step can be solved, or fixed steps are too long for the motion.
    """
    began = clock.perf_counter()
    robot, drive = _robot_and_drive(robot, drive)
    check_choice("method", method, METHODS)
    if method == "explicit":
        warn("method explicit goes in 0.10: it is reference", DeprecationWarning, stacklevel=3)
    for event in events if isinstance(events, list | tuple) else [events]:
        expect("events", event, Event, "Event(lambda t, q, v: q[0])")
    settings = _method_settings(method, tolerance, step, stages)
    samples = whole_number("samples", samples, MIN_ROWS, MAX_ROWS)
    equations = EquationsOfMotion.of(robot, damping)
    complete_drive = Drive.of(robot, drive, breaks, wrenches, forces)
    planned = planned_motion(drive)
    # events are evaluated at twice as many instants as a step has nodes
    samples_of_step = 2 * settings.stages or 1
    record = RunRecord(_simulated_duration(duration, planned), events, samples_of_step, progress)
    state = _consistent_start(equations, complete_drive, planned, start, start_velocity)
    integrate = integrate_by_collocation if settings.stages else integrate_by_fixed_steps
    run = integrate(equations, complete_drive, state, record, settings)

    # the result: a terminal event ends it within a step, but the errors of loops and energy are those of the
    # whole step
    trajectory = run.trajectory
    edges = trajectory.edges  # (steps + 1,) [s] instants at which steps begin and end
    end = min([edges[-1], *(event.time for event in record.occurred if event.terminal)])
    if isinstance(trajectory, Cubics):  # the interpolant of methods with fixed steps
        times = np.append(edges[edges < end], end)
    else:
        times = np.linspace(edges[0], end, samples)
    q, v = trajectory(times)
    edge_q, edge_v = trajectory(edges)
    tracking = turning = frame_error = None
    if planned is not None:
        tracking, turning, frame_error = _tracking_errors(robot, planned, times, q)
    return Simulation(
        robot=robot,
        method=method,
        times=times,
        q=q,
        v=v,
        tracking_error=tracking,
        turning_error=turning,
        frame_error=frame_error,
        closure_error=max(_largest_gap(robot, times, q), _largest_gap(robot, edges, edge_q)),
        energy_error=_energy_error(equations, record, edges, edge_q, edge_v),
        unresolved=run.unresolved,
        steps=len(edges) - 1,
        iterations=run.iterations,
        seconds=clock.perf_counter() - began,
        occurrences=tuple(record.occurred),
        trajectory=trajectory,
    )


def _robot_and_drive(robot: Any, drive: Any) -> tuple[ParallelRobot, Any]:
    """Return the robot and its drive; a plan alone drives its own robot."""
    if drive is None and planned_motion(robot) is not None:
        robot, drive = getattr(robot, "robot", None), robot
    expect_robot(robot)
    return robot, drive


def _method_settings(
    method: str, tolerance: float | None, step: float | None, stages: int | None
) -> MethodSettings:
    """Return the method's settings, with the caller's numbers in place of defaults where not None.

    Args:
        tolerance: what a collocation step may leave unresolved [rad, robot lengths].
        step: length of fixed steps, or of the longest step [s].
        stages: number of nodes of a collocation step.
    """
    stage_range = (3, 30)
    settings = METHODS[method]
    if tolerance is not None:
        if not settings.stages:
            raise InvalidInput(f"tolerance: method {method} has none; its step [s] sets how exact it is")
        if not ROUNDING_STEP <= finite_numbers("tolerance", [tolerance], 1)[0] < 1:
            raise InvalidInput(f"tolerance: must lie in [{ROUNDING_STEP:g}, 1), got {tolerance!r}")
        settings = settings._replace(tolerance=float(tolerance))
    if stages is not None:
        if not settings.stages:
            raise InvalidInput(f"stages: method {method} has none")
        stages = whole_number("stages", stages, *stage_range)
        settings = settings._replace(stages=stages)
    if step is not None:
        if not finite_numbers("step", [step], 1)[0] > 0:
            raise InvalidInput(f"step: must be positive [s], got {step!r}")
        settings = settings._replace(step=float(step))
    return settings


def _simulated_duration(duration: float | None, planned: PlannedMotion | None) -> float:
    """Return the checked duration [s], by default that of the planned motion."""
    if duration is None:
        if planned is None:
            raise InvalidInput("duration: required [s] when the drive is a function")
        return planned.duration
    check_duration(duration)
    duration = float(duration)
    if planned is not None and duration > planned.duration * (1 + SAME_PLACE):
        raise InvalidInput(f"duration: the planned motion ends at {planned.duration:g} s, got {duration!r}")
    return duration


def _consistent_start(
    equations: EquationsOfMotion,
    drive: Drive,
    planned: PlannedMotion | None,
    start: ArrayLike | None,
    start_velocity: ArrayLike | None,
) -> State:
    """Return the consistent state at t = 0 next to the caller's start or, by default, the planned one.

    Without both it is the assembled reference at rest. Massless parts balance the torques of the drive.

    Args:
        start, start_velocity: q (nq,) and v (nv,) of the caller, or None.
    """
    robot = equations.robot
    q, v = robot.reference.q, np.zeros(robot.nv)
    if start is not None:
        q = finite_numbers("start", start, robot.model.nq)
    elif planned is not None:
        q, v = _planned_start(robot, planned)
    if start_velocity is not None:
        v = finite_numbers("start_velocity", start_velocity, robot.nv)
        require_closed_rates(robot, linearised_at(robot, q[None]), v[None], "start_velocity")
    torque = drive(np.zeros(1), q[None], v[None])[0]
    return consistent_state(equations, q, v, torque, drive.world)


def _planned_start(robot: ParallelRobot, planned: PlannedMotion) -> tuple[Array, Array]:
    """Return q (nq,) and v (nv,) at the start of a plan.

    A robot with other springs than the planned one has other coordinates. It starts at rest, assembled with
    its platform at the first point of the plan.
    """
    q, v = planned.configuration(0.0)[0], planned.velocity(0.0)[0]
    owner = getattr(planned, "robot", robot)
    if (owner.axis_names, owner.actuator_names) != (robot.axis_names, robot.actuator_names):
        raise InvalidInput(
            f"the plan is for {owner.name} ({', '.join(owner.axis_names)}), the robot is {robot.name} "
            f"({', '.join(robot.axis_names)}), of another build; plan for it"
        )
    if len(q) == robot.model.nq:
        return q, v
    # at rest if slow compared with the middle of the motion
    usual_speed = np.abs(planned.velocity(planned.duration / 2)).max(initial=0.0)
    if np.abs(v).max(initial=0.0) > AT_REST * usual_speed:
        raise InvalidInput(
            f"the plan is for {owner.name}, {owner.flexibility}, and starts in motion, the robot has other "
            f"springs ({robot.flexibility}); give start and start_velocity"
        )
    return assemble(robot, planned.platform(0.0)).q, np.zeros(robot.nv)
