"""The comparison of one level of fidelity: its torques in the forward simulation of the highest model."""

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

EQUAL_TORQUES = (
    10 * TORQUE_TAIL
)  # difference over the peak; an effect that counts changes torques by 1e-7 and more
# Error of the platform over the path's length, or of torques over their peak, from which on a level has
# another motion and is not simulated; twice the tolerance if that is more.
MAX_ERROR = 0.1
UNLIMITED: Mapping[str, Any] = {"torque_limit": np.inf, "speed_limit": np.inf}
METHOD = "stiff"  # takes long steps where fast vibrations are not excited
STEP_ERRORS = (1e-3, 1e-5)  # error of an integration step over the tolerance, tried in turn
# Platform error of the highest level's own torques over the tolerance, from which on shorter steps are tried.
# The error with the shortest steps is reported.
OWN_ERROR = 0.1
MIN_STEP_ERROR = 1e-12  # [robot lengths] the accuracy of planned torques
MOTION_SAMPLES = 1001  # equidistant instants of a comparison
NEAR_CROSSING = np.geomspace(1e-6, 0.1, 41)  # of the duration: more instants, where differences may be narrow


@dataclass(frozen=True, eq=False)
class Comparison(ReadOnlyArrays):
    """One level: its plan, and the errors of its torques in the highest model.

    torque_error: (T,) difference from the highest level's torques over their peak, at the study's instants.
    platform_error: (T,) distance of the simulated platform from the level's own plan over the path's length.
        Both are nan without a plan, and after the end of the plan or its simulation.
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
        """The spring with the largest deflection (compared in rad, robot lengths), and that [m, rad]."""
        if self.plan is None or not self.plan.robot.n_e:
            return None
        robot = self.plan.robot
        times = np.linspace(0.0, self.plan.duration, MOTION_SAMPLES)
        largest = np.abs(self.plan.deflection(times)).max(axis=0)
        k = np.argmax(largest / robot.column_scale[robot.elastic])
        return robot.elastic_names[k], float(largest[k])


@dataclass
class HighestLevel:
    """The plan of the highest level and its simulation, the reference for all other levels.

    `seconds` is the time of all simulations so far.
    """

    plan: CrossingPlan
    tolerance: float
    length: float  # of the path, turns multiplied by the robot's length [m]
    times: Array  # (T,) [s]
    peak: Array  # (n_a,) the largest torque of the motors of the same unit
    step_error: float  # of integration steps [robot lengths]
    own: Comparison  # of the highest level with its own plan
    seconds: float

    @classmethod
    def of(cls, plan: CrossingPlan, tolerance: float) -> HighestLevel:
        """Simulate a plan of the highest level, with shorter steps if the platform leaves the path.

        The allowed error of a step is STEP_ERRORS times the tolerance times the path's length.

        Raises:
            NoAnswer: the simulation stops early.
            InvalidInput: the robot cannot be simulated.
        """
        robot, duration = plan.robot, plan.duration
        close_instants = [
            crossing.time + side * NEAR_CROSSING * duration
            for crossing in plan.crossings
            for side in (-1.0, 1.0)
        ]
        times = np.unique(np.concatenate([np.linspace(0.0, duration, MOTION_SAMPLES), *close_instants]))
        times = times[(times >= 0.0) & (times <= duration)]
        no_error = np.zeros(len(times))
        highest = cls(
            plan=plan,
            tolerance=tolerance,
            length=path_length(robot, plan.path),
            times=times,
            peak=largest_by_unit(robot, np.array(list(plan.peak_torque.values()))),
            step_error=0.0,  # set with the first simulation
            own=Comparison(LEVELS[-1], plan, torque_error=no_error, platform_error=no_error),
            seconds=0.0,
        )
        length = highest.length
        for step_error in STEP_ERRORS:
            highest.step_error = max(step_error * tolerance * length / robot.length, MIN_STEP_ERROR)
            highest.own = highest._simulate_level(LEVELS[-1], plan)
            if highest.own.platform <= OWN_ERROR * tolerance:
                break
        return highest

    @property
    def lost(self) -> float:
        """Error over path length or peak torque from which on a level has another motion."""
        return max(MAX_ERROR, 2.0 * self.tolerance)

    def compare(self, level: Level, below: list[Comparison]) -> Comparison:
        """Compare a level, after the levels `below`; reuse a result where robot or torques are equal."""
        description = self.plan.robot.description
        if below and adds_nothing(description, level, below[-1].level):
            return replace(below[-1], level=level, same_as=below[-1].same_as or below[-1].level.name)
        try:
            plan = self.plan if level is LEVELS[-1] else plan_of_level(description, level, self.plan)
        except FrameworkError as refusal:
            unknown = np.full(len(self.times), np.nan)
            return Comparison(level, None, unknown, unknown, reason=f"no plan: {refusal}")
        for lower in below:
            if lower.plan is not None and self._torque_error(plan, lower.plan).max() <= EQUAL_TORQUES:
                return replace(lower, level=level, plan=plan, same_as=lower.same_as or lower.level.name)
        if self._torque_error(plan, self.plan).max() <= EQUAL_TORQUES:
            return replace(self.own, level=level, plan=plan)
        return self._simulate_level(level, plan)

    def _torque_error(self, plan: CrossingPlan, reference: CrossingPlan) -> Array:
        """Return the largest difference (T,) of the torques of two plans over their peak.

        A plan that has ended keeps its last torque. Dry friction, the same in both, is left out: it would
        jump at slightly different instants.
        """
        torque, reference_torque = (
            one.dynamics.torque_without_friction(np.minimum(self.times, one.duration))
            for one in (plan, reference)
        )
        return (np.abs(torque - reference_torque) / self.peak).max(axis=1)

    def _simulate_level(self, level: Level, plan: CrossingPlan) -> Comparison:
        """Return the comparison of a level whose torques drive the highest model.

        Raises:
            NoAnswer: the simulation of the highest level's torques stops early.
        """
        torque_error = self._torque_error(plan, self.plan)
        platform_error = np.full(len(self.times), np.nan)
        if torque_error.max() > self.lost:
            reason = "torques of another motion, not simulated"
            return Comparison(level, plan, torque_error, platform_error, reason)
        started = time.perf_counter()
        try:
            run = self._run(plan)
        except NoAnswer as failure:
            if plan is self.plan:
                raise
            reason = f"no simulation: {failure}"
            return Comparison(level, plan, torque_error, platform_error, reason)
        finally:
            self.seconds += time.perf_counter() - started
        reached = self.times <= min(run.duration, plan.duration)
        t = self.times[reached]
        platform_error[reached] = self._distance(run.configuration(t), plan.platform(t))
        reason = ""
        if run.occurrences:
            s = float(plan.law(run.duration))
            reason = (
                f"{100 * self.lost:.3g} % off its path, and lost, at t = {run.duration:.4g} s, s = {s:.4g}"
            )
        return Comparison(level, plan, torque_error, platform_error, reason)

    def _run(self, plan: CrossingPlan) -> Simulation:
        """Simulate the highest model under the torques of a plan, from rest at the start of the path.

        The simulation ends where the platform's error reaches `lost`.
        """
        start, robot = self.plan.configuration(0.0), self.plan.robot

        def remaining_distance(t: float, q: Array, v: Array) -> float:
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
            events=(Event(remaining_distance, "lost", terminal=True, direction=-1),),
            samples=2,
        )

    def _distance(self, q: Array, x: Array) -> Array:
        """Return the distance (T,) of the platform at q (T, nq) from x (T, n), in path lengths."""
        robot = self.plan.robot
        difference = robot.platform.residual(frames_at(robot, q), x) * coordinate_sizes(robot)
        return np.linalg.norm(difference, axis=1) / self.length


def plan_of_level(description: RobotDescription, level: Level, reference: CrossingPlan) -> CrossingPlan:
    """Plan with a level, with the duration and the times and speeds of crossings of a reference plan.

    A polynomial law with these times is planned without limits, as only its torques are compared. An optimal
    law is optimised again.

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
    """Whether a robot has none of the effects that a level adds to the level below.

    Another geometry or the inertia of elastic motion is an effect only for a robot with springs.
    """
    if level.bodies != below.bodies:
        return False
    springs, springs_below = (description.active_springs(one.flexibility) for one in (level, below))
    same_elasticity = (level.geometry, level.elastic_inertia) == (below.geometry, below.elastic_inertia)
    return springs == springs_below and (same_elasticity or not springs)
