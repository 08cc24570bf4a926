"""The comparison of the levels of fidelity: the torques of each drive a simulation of the highest model.

If the robot falls so fast that even integration errors would carry it off its path, each motor has a
controller, which drives the motor back to its planned angle.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from framework.dynamics.open_loop import MotorControl
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.fidelity.predicted_level import OWN_ERROR, STEP_ERRORS, LevelMotion, measure_fall
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.frames import frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import LEVELS, LEVELS_BY_NAME, Level
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.planning.request import MOTION_SAMPLES, largest_by_unit, path_length
from framework.planning.result import CrossingPlan
from framework.simulation import Event, Simulation, simulate
from framework.simulation.drive import Drive
from framework.tolerances import CLOSED_LOOP, TORQUE_TAIL

# Torques count as equal if they differ by less than this share of the peak. Relevant effects change torques
# by a share of 1e-7 or more.
EQUAL_TORQUES = 10 * TORQUE_TAIL
MAX_ERROR = 0.1  # platform error over the path's length that ends a simulation, or twice the tolerance
NEAR_CROSSING = np.geomspace(1e-6, 0.1, 41)  # offsets of further instants from crossings, over the duration


@dataclass(frozen=True, eq=False)
class Comparison(ReadOnlyArrays):
    """The torques of one level along the motion, and their errors in the highest model.

    motion: the motion with the level's torques; None if the level's model cannot follow the motion.
    torque_error: (T,) difference from the reference's torques divided by their peak, at the study's instants;
        NaN without a motion.
    platform_error: (T,) distance of the simulated platform from the level's motion divided by the path's
        length; NaN without a motion, and after the platform was lost.
    reason: why there is no motion, or where the platform was lost; empty otherwise.
    seconds: computing time of the torques.
    same_as: the lowest level with equal torques; empty if there is none.
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
        """The largest platform error; infinite without a motion, or if the platform was lost."""
        # by rounding, a complete simulation may end just before the last instant, whose error is then NaN
        return np.inf if self.reason else float(np.nanmax(self.platform_error))

    @property
    def deflection(self) -> tuple[str, float] | None:
        """The name of the spring of largest deflection, and the deflection [m, rad]; None without springs.

        Deflections in m are compared with those in rad as shares of the robot's length.
        """
        if self.motion is None or not self.motion.robot.n_e:
            return None
        robot = self.motion.robot
        times = np.linspace(0.0, self.motion.duration, MOTION_SAMPLES)
        largest = np.abs(self.motion.deflection(times)).max(axis=0)
        k = np.argmax(largest / robot.column_scale[robot.elastic])  # index of the spring
        return robot.elastic_names[k], float(largest[k])


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """The motion of a study, and the highest model, in which the torques of all levels are simulated."""

    plan: CrossingPlan  # of the motion
    highest: ParallelRobot
    tolerance: float  # allowed error, as a share of the path's length and of the peak torque
    length: float  # [m] of the path, with rotations multiplied by the robot's length
    times: Array  # (T,) [s] instants at which errors are measured
    peak: Array  # (n_a,) [N m, N] for each motor the largest planned torque of motors of the same unit
    fall: float  # time constants in the motion with which errors grow where the robot falls by itself
    control: MotorControl | None  # feedback of the motors, if the robot falls

    @classmethod
    def of(cls, plan: CrossingPlan, highest: ParallelRobot, tolerance: float) -> ReferenceMotion:
        """Choose the instants of a comparison, dense at crossings; tune controllers if the robot falls."""
        duration = plan.duration
        offsets = np.concatenate([-NEAR_CROSSING, NEAR_CROSSING]) * duration
        instants_beside = [crossing.time + offsets for crossing in plan.crossings]
        times = np.concatenate([np.linspace(0.0, duration, MOTION_SAMPLES), *instants_beside])
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
    def max_error(self) -> float:
        """The platform error, as a share of the path's length, at which the platform counts as lost."""
        return max(MAX_ERROR, 2.0 * self.tolerance)

    def compare_levels(self, motions: Iterable[tuple[str, LevelMotion]]) -> Iterator[Comparison]:
        """Yield the comparison of each level with the plan of the motion.

        A level whose torques equal those of the level below, or of the plan, takes the errors from there and
        is not simulated again. The lowest level comes first.

        Raises:
            InvalidInput: the robot cannot be simulated.
        """
        # the step error of all simulations is the first with which the plan's own torques keep the platform
        # on its path; else the last one
        allowed = self.tolerance * self.length / self.highest.length  # platform error [robot lengths]
        for share in STEP_ERRORS:
            step_error = max(share * allowed, CLOSED_LOOP)  # [robot lengths]; loops are closed no better
            reference = self._simulate(LEVELS[-1], self.plan.dynamics, step_error)
            if reference.platform <= OWN_ERROR * self.tolerance:
                break
        previous = None  # the comparison of the level below
        unknown = np.full(len(self.times), np.nan)  # errors of a level without a motion
        for name, (motion, seconds, reason) in motions:
            level = LEVELS_BY_NAME[name]
            if motion is None:
                comparison = Comparison(
                    level, motion=None, torque_error=unknown, platform_error=unknown, reason=reason
                )
            elif previous is not None and self._is_equal(motion, previous.motion):
                lowest = previous.same_as or previous.level.name
                comparison = replace(previous, same_as=lowest)
            elif self._is_equal(motion, self.plan.dynamics):
                comparison = reference
            else:
                comparison = self._simulate(level, motion, step_error)
            previous = replace(comparison, level=level, motion=motion, seconds=seconds)
            yield previous

    def _is_equal(self, motion: InverseDynamics, other: InverseDynamics | None) -> bool:
        """Return whether the torques of two motions are equal but for rounding."""
        return other is not None and bool(self._torque_error(motion, other).max() <= EQUAL_TORQUES)

    def _torque_error(self, motion: InverseDynamics, reference: InverseDynamics) -> Array:
        """Return the largest difference (T,) of two motions' torques without dry friction, over the peaks."""
        torque = motion.torques(self.times)
        difference = torque - reference.torques(self.times)
        return (np.abs(difference) / self.peak).max(axis=1)

    def _simulate(self, level: Level, motion: InverseDynamics, step_error: float) -> Comparison:
        """Compare a level with the plan by simulating its torques in the highest model."""
        platform_error = np.full(len(self.times), np.nan)
        reason = ""
        try:
            simulation = self._simulate_motion(motion, step_error)
            end = simulation.duration
            reached = self.times <= end
            t = self.times[reached]
            platform_error[reached] = self._platform_distance(simulation.configuration(t), motion.platform(t))
            if simulation.occurrences:  # the only event, "lost", has ended the simulation
                lost = f"{100 * self.max_error:.3g} % off its path, and lost, at t = {end:.4g} s"
                reason = f"{lost}, s = {float(motion.law(end)):.4g}"
        except NoAnswer as failure:
            reason = f"no simulation: {failure.sentence}"
        torque_error = self._torque_error(motion, self.plan.dynamics)
        return Comparison(level, motion, torque_error, platform_error, reason)

    def _simulate_motion(self, motion: InverseDynamics, step_error: float) -> Simulation:
        """Simulate the highest model under the torques of a level's motion, from rest.

        The simulation ends when the platform's error reaches `max_error`: the event "lost".
        """

        def remaining_distance(t: float, q: Array, v: Array) -> float:
            """Return `max_error` less the platform's error; zero ends the simulation."""
            planned = motion.platform(np.array([min(t, motion.duration)]))
            return float(self.max_error - self._platform_distance(q[None], planned)[0])

        robot = self.highest
        plan = self.plan
        has_same_springs = plan.robot.elastic_names == robot.elastic_names
        start = plan.configuration(0.0) if has_same_springs else assemble(robot, plan.platform(0.0)).q
        return simulate(
            robot,
            self._make_drive(motion),
            method="stiff",  # takes long steps while fast vibrations are not excited
            tolerance=step_error,
            start=start,
            start_velocity=np.zeros(robot.nv),
            duration=motion.duration,
            events=(Event(remaining_distance, "lost", terminal=True, direction=-1),),
            samples=2,
        )

    def _make_drive(self, motion: InverseDynamics) -> Drive:
        """Return the drive with the torques of a level's motion, plus controllers of the motors if any."""
        robot = self.highest
        control = self.control
        feedforward = Drive.of(robot, motion)
        if control is None:
            return feedforward

        def torque(t: Array, q: Array, v: Array) -> Array:
            """Compute motor torques (T, n_a) at t (T,), q (T, nq) and v (T, nv)."""
            angle_error = motion.motor_angle(t) - robot.gear_ratio * robot.actuated_coordinates(q)
            speed_error = motion.motor_angle(t, order=1) - robot.gear_ratio * v[:, robot.actuated]
            return feedforward.function(t, q, v) + control.torque(angle_error, speed_error)

        return replace(feedforward, function=torque, feedback=True)

    def _platform_distance(self, q: Array, x: Array) -> Array:
        """Compute the distances (T,) of the platform at q (T, nq) from x (T, n), in path lengths.

        Rotations are multiplied by the robot's length.
        """
        robot = self.highest
        offset = robot.platform.residual(frames_at(robot, q), x) / robot.platform_scale  # [robot lengths]
        return np.linalg.norm(offset * robot.length, axis=1) / self.length
