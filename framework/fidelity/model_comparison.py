"""The comparison of the levels of fidelity: their torques in the forward simulation of the highest model.

All levels make one motion (`level_motions`). The simulation begins at rest at the start of the path.

Where the robot falls so fast that even errors of integration would carry it off its path, the motors have a
controller each: it pulls the motor back to the angle that the level plans.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from framework.dynamics.open_loop import MotorControl, fall_exponent
from framework.dynamics.pointwise_dynamics import motor_inertia
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.fidelity.fidelity_indicators import LevelMotion
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.frames import frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.fidelity_levels import LEVELS, LEVELS_BY_NAME, Level
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.planning.motion_scales import coordinate_sizes, largest_by_unit, path_length
from framework.planning.result import CrossingPlan
from framework.simulation import Event, Simulation, simulate
from framework.simulation.drive import Drive
from framework.tolerances import TORQUE_TAIL

# Difference over the peak of torques that are equal; an effect that counts changes torques by 1e-7 and more.
EQUAL_TORQUES = 10 * TORQUE_TAIL
# Error of the platform over the path's length that ends a simulation; twice the tolerance if that is more.
MAX_ERROR = 0.1
STEP_ERRORS = (1e-3, 1e-5)  # error of an integration step over the tolerance, tried in turn
# Platform error of the reference's own torques over the tolerance, from which on shorter steps are tried.
# The error with the shortest steps is reported.
OWN_ERROR = 0.1
# Time constants of the fall in a motion, from which on the motors have a controller: without one, the error
# of the shortest steps would grow beyond OWN_ERROR.
MAX_FALL = float(np.log(OWN_ERROR / STEP_ERRORS[-1]))
CONTROL_TO_FALL = 10.0  # frequency of the motors' feedback over the rate of the fall: it catches the robot
MIN_STEP_ERROR = 1e-12  # [robot lengths] the accuracy of planned torques
MOTION_SAMPLES = 1001  # equidistant instants of a comparison
NEAR_CROSSING = np.geomspace(1e-6, 0.1, 41)  # of the duration: more instants, where differences may be narrow


@dataclass(frozen=True, eq=False)
class Comparison(ReadOnlyArrays):
    """One level: its torques along the motion, and their errors in the highest model.

    motion: the level's motion with its torques; None if its model cannot make it.
    torque_error: (T,) difference from the reference's torques over their peak, at the study's instants.
    platform_error: (T,) distance of the simulated platform from the level's motion over the path's length.
        Both are nan without a motion, the latter also after the simulation was lost.
    reason: why there is no motion, or where the platform was lost; empty otherwise.
    seconds: time that the torques took.
    same_as: the lowest level that gives the same torques; empty if none does.
    """

    level: Level
    motion: InverseDynamics | None
    torque_error: Array
    platform_error: Array
    reason: str = ""
    seconds: float = 0.0
    same_as: str = ""

    @property
    def torque(self) -> float:
        """The largest torque error; infinite without torques."""
        return np.inf if self.motion is None else float(self.torque_error.max())

    @property
    def platform(self) -> float:
        """The largest platform error; infinite where the platform was lost.

        A simulation may end before the last instant by rounding, without an error there.
        """
        return np.inf if self.reason else float(np.nanmax(self.platform_error))

    @property
    def deflection(self) -> tuple[str, float] | None:
        """The spring with the largest deflection (compared in rad, robot lengths), and that [m, rad]."""
        if self.motion is None or not self.motion.robot.n_e:
            return None
        robot = self.motion.robot
        times = np.linspace(0.0, self.motion.duration, MOTION_SAMPLES)
        largest = np.abs(self.motion.deflection(times)).max(axis=0)
        k = np.argmax(largest / robot.column_scale[robot.elastic])
        return robot.elastic_names[k], float(largest[k])


def measure_fall(motion: InverseDynamics) -> tuple[float, MotorControl | None]:
    """Return the exponent by which a disturbance grows over a motion, and the feedback of the motors.

    They have feedback where the exponent, the rate of the fall times the duration, is above MAX_FALL.
    """
    fall = fall_exponent(motion)
    if fall <= MAX_FALL:
        return fall, None
    inertia = motor_inertia(motion.robot, motion.configuration(0.0)[0])
    frequency = CONTROL_TO_FALL * fall / motion.duration  # [1/s]
    return fall, MotorControl.of(inertia, frequency)


@dataclass
class ReferenceMotion:
    """The motion of a study, and the highest model, which simulates all levels.

    `seconds` is the time of all simulations so far.
    """

    plan: CrossingPlan
    highest: ParallelRobot
    tolerance: float
    length: float  # of the path, turns multiplied by the robot's length [m]
    times: Array  # (T,) [s]
    peak: Array  # (n_a,) the largest torque of the motors of the same unit
    fall: float  # time constants of the fall in the motion, see `open_loop.fall_exponent`
    control: MotorControl | None  # of the motors, where the robot falls
    step_error: float = 0.0  # of integration steps [robot lengths]; set with the first simulation
    seconds: float = 0.0

    @classmethod
    def of(cls, plan: CrossingPlan, highest: ParallelRobot, tolerance: float) -> ReferenceMotion:
        """Sample the motion of a plan, and tune controllers if the robot falls."""
        duration = plan.duration
        offsets = np.concatenate([-NEAR_CROSSING, NEAR_CROSSING]) * duration
        close_instants = [crossing.time + offsets for crossing in plan.crossings]
        times = np.concatenate([np.linspace(0.0, duration, MOTION_SAMPLES), *close_instants])
        fall, control = measure_fall(plan.dynamics)
        return cls(
            plan=plan,
            highest=highest,
            tolerance=tolerance,
            length=path_length(plan.robot, plan.path),
            times=np.unique(np.clip(times, 0.0, duration)),
            peak=largest_by_unit(plan.robot, np.array(list(plan.peak_torque.values()))),
            fall=fall,
            control=control,
        )

    @property
    def lost(self) -> float:
        """Platform error over path length from which on the platform counts as lost."""
        return max(MAX_ERROR, 2.0 * self.tolerance)

    def compare_levels(self, motions: Iterable[tuple[str, LevelMotion]]) -> Iterator[Comparison]:
        """Yield the comparison of each level; levels with equal torques share one simulation.

        Raises:
            InvalidInput: the robot cannot be simulated.
        """
        reference = self._simulate_reference()
        previous = None  # the comparison of the level below
        unknown = np.full(len(self.times), np.nan)
        for name, (motion, seconds, reason) in motions:
            level = LEVELS_BY_NAME[name]
            if motion is None:
                comparison = Comparison(level, None, unknown, unknown, reason)
            elif previous is not None and self._is_equal(motion, previous.motion):
                comparison = replace(previous, same_as=previous.same_as or previous.level.name)
            elif self._is_equal(motion, self.plan.dynamics):
                comparison = reference
            else:
                comparison = self._simulate(level, motion)
            previous = replace(comparison, level=level, motion=motion, seconds=seconds)
            yield previous

    def _simulate_reference(self) -> Comparison:
        """Simulate the reference's own torques, with shorter steps if needed.

        The allowed error of a step is STEP_ERRORS times the tolerance times the path's length.
        """
        allowed = self.tolerance * self.length / self.highest.length
        for step_error in STEP_ERRORS:
            self.step_error = max(step_error * allowed, MIN_STEP_ERROR)
            own = self._simulate(LEVELS[-1], self.plan.dynamics)
            if own.platform <= OWN_ERROR * self.tolerance:
                break
        return own

    def _is_equal(self, motion: InverseDynamics, other: InverseDynamics | None) -> bool:
        """Return whether the torques of two motions are equal but for rounding."""
        return other is not None and bool(self._torque_error(motion, other).max() <= EQUAL_TORQUES)

    def _torque_error(self, motion: InverseDynamics, reference: InverseDynamics) -> Array:
        """Return the largest difference (T,) of two motions' torques over their peak.

        Dry friction, the same in both, is left out.
        """
        torque, reference_torque = (one.torque_without_friction(self.times) for one in (motion, reference))
        return (np.abs(torque - reference_torque) / self.peak).max(axis=1)

    def _simulate(self, level: Level, motion: InverseDynamics) -> Comparison:
        """Compare a level whose torques drive the highest model."""
        platform_error, reason = np.full(len(self.times), np.nan), ""
        started = time.perf_counter()
        try:
            run = self._simulate_motion(motion)
            reached = self.times <= run.duration
            t = self.times[reached]
            platform_error[reached] = self._platform_distance(run.configuration(t), motion.platform(t))
            if run.occurrences:
                s = float(motion.law(np.array(run.duration)))
                lost = f"{100 * self.lost:.3g} % off its path, and lost, at t = {run.duration:.4g} s"
                reason = f"{lost}, s = {s:.4g}"
        except NoAnswer as failure:
            reason = f"no simulation: {failure}"
        self.seconds += time.perf_counter() - started
        torque_error = self._torque_error(motion, self.plan.dynamics)
        return Comparison(level, motion, torque_error, platform_error, reason)

    def _simulate_motion(self, motion: InverseDynamics) -> Simulation:
        """Simulate the highest model under the torques of a level, from rest.

        The simulation ends where the platform's error reaches `lost`.
        """

        def remaining_distance(t: float, q: Array, v: Array) -> float:
            planned = motion.platform(np.array([min(t, motion.duration)]))
            return float(self.lost - self._platform_distance(q[None], planned)[0])

        robot, plan = self.highest, self.plan
        has_same_springs = plan.robot.elastic_names == robot.elastic_names
        start = plan.configuration(0.0) if has_same_springs else assemble(robot, plan.platform(0.0)).q
        return simulate(
            robot,
            self._make_drive(motion),
            method="stiff",  # takes long steps where fast vibrations are not excited
            tolerance=self.step_error,
            start=start,
            start_velocity=np.zeros(robot.model.nv),
            duration=motion.duration,
            events=(Event(remaining_distance, "lost", terminal=True, direction=-1),),
            samples=2,
        )

    def _make_drive(self, motion: InverseDynamics) -> Drive:
        """Return the torques of a level, with controllers of the motors if any."""
        robot, control = self.highest, self.control
        feedforward = Drive.of(robot, motion)
        if control is None:
            return feedforward

        def torque(t: Array, q: Array, v: Array) -> Array:
            """Compute motor torques (T, n_a)."""
            angle = robot.gear_ratio * robot.actuated_coordinates(q)
            speed = robot.gear_ratio * v[:, robot.actuated]
            return feedforward.function(t, q, v) + control.torque(
                motion.motor_angle(t) - angle, motion.motor_angle(t, 1) - speed
            )

        return replace(feedforward, function=torque, feedback=True)

    def _platform_distance(self, q: Array, x: Array) -> Array:
        """Return distances (T,) of the platform at q (T, nq) from x (T, n).

        In path lengths.
        """
        robot = self.highest
        offset = robot.platform.residual(frames_at(robot, q), x) * coordinate_sizes(robot)
        return np.linalg.norm(offset, axis=1) / self.length
