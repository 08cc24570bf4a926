"""One rung of the fidelity ladder judged: its torques in the forward simulation of the highest model."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.crossing.path_length import coordinate_sizes, path_length
from framework.crossing.plan import plan_request
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.dynamics.inverse_dynamics import checked_geometry
from framework.errors import FrameworkError, NoAnswer
from framework.kinematics.frames import frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import RobotDescription
from framework.model.rungs import LADDER, Rung, with_bodies
from framework.simulation import Event, Simulation, simulate

SAME = 1e-9  # of the peak: torques are planned to 1e-10; those that differ by less are the same
# Path lengths from the plan, and share of the peak torque, or twice the tolerance if that is more: what is so
# far off is another motion, and not simulated
LOST = 0.1
METHOD = "stiff"  # quick vibrations that nobody excites cost nothing
STEP_ERRORS = (1e-3, 1e-5)  # of the tolerance, that a step may leave unresolved, tried in turn
# of the tolerance: by how much the highest rung's own torques may leave the path before shorter steps are
# tried; what is left with the shortest stands in its row
FLOOR = 0.1
LEAST_STEP_ERROR = 1e-12  # [robot lengths] what planned torques are good for
INSTANTS = 1001
NEAR = np.geomspace(1e-6, 0.1, 41)  # of the duration, from a crossing: where differences may be narrow


@dataclass(frozen=True, eq=False)
class Judged(ReadOnlyArrays):
    """One rung: its plan, and what its torques do in the highest model.

    torque_error, platform_error: at the judge's instants (T,): the difference from the highest rung's torques
        over their peak, and the distance of the platform from the rung's own plan over the path's length. nan
        where there is no plan, and after that plan or its simulation has ended.
    reason: why there is no plan, or where the platform was lost; empty otherwise.
    same_as: the lowest rung that gives the same torques; empty if none does.
    """

    rung: Rung
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
        times = np.linspace(0.0, self.plan.duration, INSTANTS)
        largest = np.abs(self.plan.deflection(times)).max(axis=0)
        k = int(np.argmax(largest / robot.column_scale[robot.elastic]))
        return robot.elastic_names[k], float(largest[k])


@dataclass
class Judge:
    """The plan of the highest rung, its torques simulated, and the seconds spent on simulations."""

    highest: CrossingPlan
    tolerance: float
    length: float  # of the path, turns multiplied by the robot's length [m]
    times: Array  # (T,) [s]
    peak: Array  # (n_a,) the largest torque of the motors of the same unit
    step_error: float  # of simulations [robot lengths]
    top: Judged
    seconds: float

    @classmethod
    def of(cls, highest: CrossingPlan, tolerance: float) -> Judge:
        """The judge by a plan of the highest rung.

        Raises:
            NoAnswer: its simulation does not come to the end.
            InvalidInput: the robot cannot be simulated.
        """
        robot, duration, units = highest.robot, highest.duration, np.array(highest.robot.torque_units)
        near = [at.time + side * NEAR * duration for at in highest.crossings for side in (-1.0, 1.0)]
        times = np.unique(np.concatenate([np.linspace(0.0, duration, INSTANTS), *near]))
        times = times[(times >= 0.0) & (times <= duration)]
        peaks = np.array(list(highest.peak_torque.values()))
        peak = np.array([peaks[units == unit].max() for unit in units])
        length = path_length(robot, highest.path)
        still = np.zeros(len(times))
        top = Judged(LADDER[-1], highest, still, still)
        judge = cls(highest, tolerance, length, times, np.maximum(peak, np.finfo(float).tiny), 0.0, top, 0.0)
        for step_error in STEP_ERRORS:
            judge.step_error = max(step_error * tolerance * length / robot.length, LEAST_STEP_ERROR)
            judge.top = judge._simulated(LADDER[-1], highest)
            if judge.top.platform <= FLOOR * tolerance:
                break
        return judge

    @property
    def lost(self) -> float:
        """Share of path length or peak torque beyond which it is another motion."""
        return max(LOST, 2.0 * self.tolerance)

    def judged(self, rung: Rung, below: list[Judged]) -> Judged:
        """A rung, those below it having been judged; what robot or torques do not tell apart only once."""
        description = self.highest.robot.description
        if below and adds_nothing(description, rung, below[-1].rung):
            return replace(below[-1], rung=rung, same_as=below[-1].same_as or below[-1].rung.name)
        try:
            plan = self.highest if rung is LADDER[-1] else self._planned(rung)
        except FrameworkError as refusal:
            nothing = np.full(len(self.times), np.nan)
            return Judged(rung, None, nothing, nothing, reason=f"no plan: {refusal}")
        for lower in below:
            if lower.plan is not None and self._torque_error(plan, lower.plan).max() <= SAME:
                return replace(lower, rung=rung, plan=plan, same_as=lower.same_as or lower.rung.name)
        if self._torque_error(plan, self.highest).max() <= SAME:
            return replace(self.top, rung=rung, plan=plan)
        return self._simulated(rung, plan)

    def _planned(self, rung: Rung) -> CrossingPlan:
        """The plan of a rung, for the duration, and the times and speeds of crossings, of the highest one."""
        top = self.highest
        model = model_of(top.robot.description, rung)
        asked = replace(top.request, geometry=checked_geometry(model, rung.geometry))
        if rung.bodies == "none":  # without forces there is no condition (8) to meet
            asked = Request(
                path=top.path,
                duration=top.duration,
                times=(),
                smoothness=asked.smoothness,
                tolerance=asked.tolerance,
                law="polynomial",
            )
        elif top.optimality is not None:
            asked = replace(asked, law="optimal", times=None)
        elif asked.at is None and asked.times is None:
            speeds = tuple(at.speed for at in top.crossings)
            asked = replace(asked, times=tuple(at.time for at in top.crossings), speeds=speeds or None)
        return plan_request(model, asked)

    def _torque_error(self, plan: CrossingPlan, other: CrossingPlan) -> Array:
        """Difference (T,) of the torques of two plans over the peak, each at rest after its end."""
        torques = [one.torque(np.minimum(self.times, one.duration)) for one in (plan, other)]
        return np.asarray((np.abs(torques[0] - torques[1]) / self.peak).max(axis=1))

    def _simulated(self, rung: Rung, plan: CrossingPlan) -> Judged:
        """What the torques of a plan do in the highest model.

        Raises:
            NoAnswer: the simulation of the highest rung's torques does not come to the end.
        """
        torque, off = self._torque_error(plan, self.highest), np.full(len(self.times), np.nan)
        if torque.max() > self.lost:
            return Judged(rung, plan, torque, off, reason="torques of another motion, not simulated")
        began = time.perf_counter()
        try:
            run = self._run(plan)
        except NoAnswer as failure:
            if plan is self.highest:
                raise
            return Judged(rung, plan, torque, off, reason=f"no simulation: {failure}")
        finally:
            self.seconds += time.perf_counter() - began
        reached = self.times <= min(run.duration, plan.duration)
        t = self.times[reached]
        off[reached] = self._distance(run.configuration(t), plan.platform(t))
        reason = ""
        if run.occurrences:
            s = float(plan.law(run.duration))
            reason = (
                f"{100 * self.lost:.3g} % off its path, and lost, at t = {run.duration:.4g} s, s = {s:.4g}"
            )
        return Judged(rung, plan, torque, off, reason)

    def _run(self, plan: CrossingPlan) -> Simulation:
        """The highest model under the torques of a plan, from its own rest at the start of the path."""
        start, robot = self.highest.configuration(0.0), self.highest.robot

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
            events=(Event(room, "lost", terminal=True, direction=-1),),
            samples=2,
        )

    def _distance(self, q: Array, x: Array) -> Array:
        """Distance (T,) of the platform at q (T, nq) from x (T, n), in path lengths."""
        robot = self.highest.robot
        off = robot.platform.residual(frames_at(robot, q), x) * coordinate_sizes(robot)
        return np.asarray(np.linalg.norm(off, axis=1) / self.length)


def model_of(description: RobotDescription, rung: Rung) -> ParallelRobot:
    """The robot as a rung sees it: other masses and springs in its description, and no other solver."""
    seen = with_bodies(description, rung.bodies)
    robot = ParallelRobot.from_description(seen, flexibility=rung.flexibility)
    return robot if rung.elastic_inertia else replace(robot, elastic_inertia=False)


def adds_nothing(description: RobotDescription, rung: Rung, below: Rung) -> bool:
    """Whether a robot has nothing of what a rung takes into account beyond the one below it."""
    if rung.bodies != below.bodies:
        return False
    springs = [description.active_springs(one.flexibility) for one in (rung, below)]
    elastic = (rung.geometry, rung.elastic_inertia) != (below.geometry, below.elastic_inertia)
    return springs[0] == springs[1] and not (elastic and springs[0])
