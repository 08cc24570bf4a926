"""One level of fidelity compared: its torques in the forward simulation of the highest model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.crossing.motion_scales import coordinate_sizes, largest_by_unit, path_length
from framework.crossing.plan import plan_request
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.dynamics.inverse_dynamics import checked_geometry
from framework.errors import FrameworkError, NoAnswer
from framework.kinematics.frames import frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import RobotDescription
from framework.model.fidelity_levels import LEVELS, Level, with_bodies
from framework.simulation import Event, Simulation, simulate
from framework.tolerances import TORQUE_TAIL

# Path lengths from the plan, and share of the peak torque, or twice the tolerance if that is more: what is so
# far off is another motion, and not simulated
EQUAL_TORQUES = 10 * TORQUE_TAIL  # difference over the peak; levels that see one differ by 1e-7 and more
MAX_ERROR = 0.1
UNLIMITED: Mapping[str, Any] = {"torque_limit": np.inf, "speed_limit": np.inf}
METHOD = "stiff"  # quick vibrations that nobody excites cost nothing
STEP_ERRORS = (1e-3, 1e-5)  # of the tolerance, that a step may leave unresolved, tried in turn
# of the tolerance: by how much the highest level's own torques may leave the path before shorter steps are
# tried; what is left with the shortest stands in its row
OWN_ERROR = 0.1
MIN_STEP_ERROR = 1e-12  # [robot lengths] what planned torques are good for
MOTION_SAMPLES = 1001  # equidistant instants of a comparison
NEAR_CROSSING = np.geomspace(1e-6, 0.1, 41)  # of the duration: more instants, where differences may be narrow


@dataclass(frozen=True, eq=False)
class Comparison(ReadOnlyArrays):
    """One level: its plan, and the errors of its torques in the highest model.

    torque_error, platform_error: at the study's instants (T,): the difference from the highest level's
        torques over their peak, and the distance of the platform from the level's own plan over the path's
        length. nan where there is no plan, and after that plan or its simulation has ended.
    reason: why there is no plan, or where the platform was lost; empty otherwise.
    same_as: the lowest level that gives the same torques; empty if none does.
    """

    level: Level
    plan: CrossingPlan | None
    torque_error: Array
    platform_error: Array
    reason: str = ""
    same_as: str = ""

    @property
    def torque(self) -> float:
        """The largest torque error; infinite without a plan."""
        return np.inf if self.plan is None else float(self.torque_error.max())

    @property
    def platform(self) -> float:
        """The largest platform error; infinite where the platform was lost."""
        return np.inf if self.reason else float(np.nanmax(self.platform_error))

    @property
    def deflection(self) -> tuple[str, float] | None:
        """The spring that gives way most, over the robot's length, and by how much [m, rad]."""
        if self.plan is None or not self.plan.robot.n_e:
            return None
        robot = self.plan.robot
        times = np.linspace(0.0, self.plan.duration, MOTION_SAMPLES)
        largest = np.abs(self.plan.deflection(times)).max(axis=0)
        k = np.argmax(largest / robot.column_scale[robot.elastic])
        return robot.elastic_names[k], float(largest[k])


@dataclass
class HighestLevel:
    """The highest level, with which the others are compared: its plan, and that simulated.

    `seconds` is the time that all simulations took.
    """

    plan: CrossingPlan
    tolerance: float
    length: float  # of the path, turns multiplied by the robot's length [m]
    times: Array  # (T,) [s]
    peak: Array  # (n_a,) the largest torque of the motors of the same unit
    step_error: float  # of simulations [robot lengths]
    own: Comparison
    seconds: float

    @classmethod
    def of(cls, plan: CrossingPlan, tolerance: float) -> HighestLevel:
        """Simulate a plan of the highest level.

        Raises:
            NoAnswer: its simulation does not come to the end.
            InvalidInput: the robot cannot be simulated.
        """
        robot, duration = plan.robot, plan.duration
        close_instants = [
            one.time + side * NEAR_CROSSING * duration for one in plan.crossings for side in (-1.0, 1.0)
        ]
        times = np.unique(np.concatenate([np.linspace(0.0, duration, MOTION_SAMPLES), *close_instants]))
        times = times[(times >= 0.0) & (times <= duration)]
        peak = largest_by_unit(robot, np.array(list(plan.peak_torque.values())))
        length = path_length(robot, plan.path)
        still = np.zeros(len(times))
        own = Comparison(LEVELS[-1], plan, still, still)
        highest = cls(plan, tolerance, length, times, peak, 0.0, own, 0.0)
        for step_error in STEP_ERRORS:
            highest.step_error = max(step_error * tolerance * length / robot.length, MIN_STEP_ERROR)
            highest.own = highest._simulate_level(LEVELS[-1], plan)
            if highest.own.platform <= OWN_ERROR * tolerance:
                break
        return highest

    @property
    def lost(self) -> float:
        """Share of path length or peak torque beyond which a motion counts as another one."""
        return max(MAX_ERROR, 2.0 * self.tolerance)

    def compare(self, level: Level, below: list[Comparison]) -> Comparison:
        """Compare a level after the lower ones; reuse results where robot or torques are equal."""
        description = self.plan.robot.description
        if below and adds_nothing(description, level, below[-1].level):
            return replace(below[-1], level=level, same_as=below[-1].same_as or below[-1].level.name)
        try:
            plan = self.plan if level is LEVELS[-1] else plan_of_level(description, level, self.plan)
        except FrameworkError as refusal:
            nothing = np.full(len(self.times), np.nan)
            return Comparison(level, None, nothing, nothing, reason=f"no plan: {refusal}")
        for lower in below:
            if lower.plan is not None and self._torque_error(plan, lower.plan).max() <= EQUAL_TORQUES:
                return replace(lower, level=level, plan=plan, same_as=lower.same_as or lower.level.name)
        if self._torque_error(plan, self.plan).max() <= EQUAL_TORQUES:
            return replace(self.own, level=level, plan=plan)
        return self._simulate_level(level, plan)

    def _torque_error(self, plan: CrossingPlan, reference: CrossingPlan) -> Array:
        """Return how far torques of two plans differ (T,), over the peak, each at rest after its end.

        Dry friction is the same in both, and left out: it jumps a little earlier in one than in the other.
        """
        torques = [
            one.dynamics.torque_without_friction(np.minimum(self.times, one.duration))
            for one in (plan, reference)
        ]
        return (np.abs(torques[0] - torques[1]) / self.peak).max(axis=1)

    def _simulate_level(self, level: Level, plan: CrossingPlan) -> Comparison:
        """Simulate the torques of a plan in the highest model.

        Raises:
            NoAnswer: the simulation of the highest level's torques does not come to the end.
        """
        torque, off = self._torque_error(plan, self.plan), np.full(len(self.times), np.nan)
        if torque.max() > self.lost:
            return Comparison(level, plan, torque, off, reason="torques of another motion, not simulated")
        started = time.perf_counter()
        try:
            run = self._run(plan)
        except NoAnswer as failure:
            if plan is self.plan:
                raise
            return Comparison(level, plan, torque, off, reason=f"no simulation: {failure}")
        finally:
            self.seconds += time.perf_counter() - started
        reached = self.times <= min(run.duration, plan.duration)
        t = self.times[reached]
        off[reached] = self._distance(run.configuration(t), plan.platform(t))
        reason = ""
        if run.occurrences:
            s = float(plan.law(run.duration))
            reason = (
                f"{100 * self.lost:.3g} % off its path, and lost, at t = {run.duration:.4g} s, s = {s:.4g}"
            )
        return Comparison(level, plan, torque, off, reason)

    def _run(self, plan: CrossingPlan) -> Simulation:
        """Simulate the highest model under the torques of a plan, from its rest at the start of the path."""
        start, robot = self.plan.configuration(0.0), self.plan.robot

        def room(t: float, q: Array, v: Array) -> float:
            planned = plan.platform(np.array([min(t, plan.duration)]))
            return float(self.lost - self._distance(q[None], planned)[0])

        return simulate(
            robot,
            plan,
            method=METHOD,
            tolerance=self.step_error,
            start=start,
            start_velocity=np.zeros(robot.model.nv),
            wrenches=self.plan.request.wrenches or {},
            events=(Event(room, "lost", terminal=True, direction=-1),),
            samples=2,
        )

    def _distance(self, q: Array, x: Array) -> Array:
        """Return the distance (T,) of the platform at q (T, nq) from x (T, n), in path lengths."""
        robot = self.plan.robot
        off = robot.platform.residual(frames_at(robot, q), x) * coordinate_sizes(robot)
        return np.linalg.norm(off, axis=1) / self.length


def plan_of_level(description: RobotDescription, level: Level, reference: CrossingPlan) -> CrossingPlan:
    """Plan with a level, for the duration, and the times and speeds of crossings, of another level's plan.

    A polynomial is compared, not judged: no limits bind it.

    Raises:
        As `plan_crossing`.
    """
    model = model_of(description, level)
    request = replace(reference.request, geometry=checked_geometry(model, level.geometry))
    if level.bodies == "none":  # without forces there is no condition (8) to meet
        request = Request(
            path=reference.path,
            duration=reference.duration,
            times=(),
            smoothness=request.smoothness,
            tolerance=request.tolerance,
            law="polynomial",
            **UNLIMITED,
        )
    elif reference.optimality is not None:
        request = replace(request, law="optimal", times=None)
    elif request.at is None and request.times is None:
        times = tuple(crossing.time for crossing in reference.crossings)
        speeds = tuple(crossing.speed for crossing in reference.crossings)
        request = replace(request, times=times, speeds=speeds or None, **UNLIMITED)
    return plan_request(model, request)


def model_of(description: RobotDescription, level: Level) -> ParallelRobot:
    """Return the robot with the masses and springs of a level."""
    simplified = with_bodies(description, level.bodies)
    robot = ParallelRobot.from_description(simplified, flexibility=level.flexibility)
    return robot if level.elastic_inertia else replace(robot, elastic_inertia=False)


def adds_nothing(description: RobotDescription, level: Level, below: Level) -> bool:
    """Whether a robot has none of the effects that a level adds to the level below."""
    if level.bodies != below.bodies:
        return False
    springs = [description.active_springs(compared.flexibility) for compared in (level, below)]
    elastic = (level.geometry, level.elastic_inertia) != (below.geometry, below.elastic_inertia)
    return springs[0] == springs[1] and not (elastic and springs[0])
