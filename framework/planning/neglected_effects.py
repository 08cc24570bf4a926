"""The effects that a motion's torques leave out, measured by another model on nearly the same motion.

Condition (8) on s' and s" of a law s(t) keeps torques finite where the path is singular. The other model has
its own condition (8) and, with springs, its own singular points on the path. So the law is corrected by
polynomials of least degree. The corrected law passes the model's singular points at the planned instants and
speeds, with the accelerations that the model's condition (8) requires. The model's torques are then bounded,
and their difference from the motion's is the effect that the motion leaves out. The corrections vanish at
both ends, with as many derivatives as the laws of elastic robots if one of the two models has springs. A
polynomial that is as smooth at its ends becomes the polynomial with which the model itself would be planned,
for the same instants and speeds of the crossings.

`neglected_effects` lists the effects, each with the motor torque that it would add:

* Springs left rigid, geometry and inertia of the deflections, dry friction: the number is the difference of
  the torques of the model with and without the effect.
* Idle turns: the number is the torque that would hold them, which the certificate contains.
* Parts of a foreign file that its reader left out: there is no number.

Masses without which the robot was made, as at the lower levels of fidelity, are not listed: the robot does
not know of them. `framework.fidelity` compares the same torques between its levels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np

from framework.dynamics.elasticity import Pass, evaluate_pass
from framework.dynamics.forces import balanced_forces, motor_torque, tree_forces
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer, NoLaw, NotConverged, list_names
from framework.kinematics.inverse_kinematics import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import ExactLaw, Law, MotionLaw, conditions_at_instants, edges_of
from framework.model.description import FLEXIBILITIES
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.planning.crossing_tracker import CrossingTracker
from framework.planning.refusals import check_advance
from framework.planning.request import SMOOTHNESS, largest_by_unit, motor_peaks
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.tolerances import RESOLVABLE_TAIL, SAME_PLACE, TORQUE_TAIL

MAX_NAMES = 4  # of springs or turns that an effect names

# ------------------------------------------------------------------ the corrected law


@dataclass(frozen=True)
class CorrectedLaw(ExactLaw):
    """A law plus correction polynomials, each of which vanishes at both of its ends."""

    law: MotionLaw
    corrections: Mapping[float, Law]  # by the instant [s] at which the correction and its time begin

    @staticmethod
    def of(law: MotionLaw, times: Array, changes: Array, smoothness: int) -> CorrectedLaw:
        """Correct a law so that s, s' and s" change by given amounts at given instants.

        A law without panels, such as the polynomial, has one correction over the whole motion, so that the
        sum is the polynomial with which the model would be planned. Any other law has one around each
        crossing: for a crossing near an end of the motion, a single one would be large far away from it.

        Args:
            times: instants (k,) [s], ascending.
            changes: amounts (k, 3) for s, s' and s".
            smoothness: order up to which derivatives of a correction vanish at its ends.
        """
        # half-width of a local correction divided by the time to the next crossing or end
        corrected_share = 0.9
        starts, stops = np.zeros(1), np.array([law.duration])
        if len(edges_of(law)):
            gaps = np.diff([0.0, *times, law.duration])
            half_widths = corrected_share * np.minimum(gaps[:-1], gaps[1:])
            starts, stops = times - half_widths, times + half_widths
        corrections = {}
        for start, end in zip(starts.tolist(), stops.tolist(), strict=True):
            inside = (start < times) & (times < end)
            inner = conditions_at_instants(times[inside] - start, changes[inside])
            ends = conditions_at_instants([0.0, end - start], np.zeros((2, smoothness + 1)))
            corrections[start] = Law.from_conditions([*ends, *inner], end - start)
        return CorrectedLaw(law, corrections)

    @property
    def duration(self) -> float:
        """The duration of the law [s]."""
        return self.law.duration

    @property
    def edges(self) -> Array:
        """Instants (k,) [s] between which the law is smooth; empty without panels."""
        edges = edges_of(self.law)
        if not len(edges):
            return edges
        ends = [[start, start + polynomial.duration] for start, polynomial in self.corrections.items()]
        return np.unique(np.concatenate([edges, *ends]))

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return s(t) or its derivative [1/s^order], with the shape of t."""
        values = np.array(self.law(t, order))
        for start, polynomial in self.corrections.items():
            time = np.asarray(t) - start  # since the beginning of the correction
            inside = (time >= 0.0) & (time <= polynomial.duration)
            values[inside] += polynomial(time[inside], order)
        return values


# ------------------------------------------------------------------ another model on the motion


@dataclass(frozen=True, eq=False)
class ModelOnMotion:
    """A motion with its torques, and its path searched with another model of the robot.

    dynamics: the motion with the torques of its own model.
    searched: the path of the motion, followed with the other model.
    friction: dry friction (nv,) [N m or N] of the joints in the other model; None without.
    """

    dynamics: InverseDynamics
    searched: SearchedPath
    friction: Array | None = None

    @classmethod
    def of(
        cls, dynamics: InverseDynamics, robot: ParallelRobot, *, friction: Array | None = None
    ) -> ModelOnMotion:
        """Search the path of a motion with another model of the robot.

        Args:
            dynamics: the motion.
            robot: the other model.
            friction: dry friction (nv,) [N m or N] of its joints; None without.

        Raises:
            NoAnswer: the model cannot follow the path.
        """
        return cls(dynamics, search_path(robot, dynamics.path).under(dynamics.wrenches), friction)

    @property
    def robot(self) -> ParallelRobot:
        """The other model."""
        return self.searched.branch.robot

    @property
    def grid(self) -> TimeGrid:
        """The nodes in time on which the torques of the motion were computed."""
        return self.dynamics.torques.grid

    def known_deflections(self) -> Array:
        """Return the deflections (T, n_e) at which the forces of the motion were computed.

        Springs that only the other model has do not deflect, nor does any under rigid geometry.
        """
        dynamics, robot = self.dynamics, self.robot
        deflections = np.zeros((len(self.grid.times), robot.n_e))
        if dynamics.geometry == "deformed":
            columns = [robot.elastic_names.index(name) for name in dynamics.robot.elastic_names]
            deflections[:, columns] = dynamics.deflection(self.grid.times)
        return deflections

    @cached_property
    def first_pass(self) -> Pass:
        """Motion and forces of the other model at the known deflections."""
        return self.compute_pass(self.known_deflections())

    def resolve(self, geometry: str) -> InverseDynamics:
        """Compute the model's certified torques under the corrected law, without dry friction.

        Args:
            geometry: "rigid" for forces of the undeformed robot, "deformed" for those of the deflected one.

        Raises:
            NoAnswer: no correction of the law makes the torques bounded, or they cannot be resolved.
        """
        at_rest = self.grid.fit(np.zeros((len(self.grid.times), self.robot.n_e)))

        def choose_law(deflections: TimeFunction | None) -> CorrectedLaw:
            """Correct the law for the deflections, which rigid geometry ignores."""
            if deflections is None or geometry == "rigid":
                deflections = at_rest
            return self._correct_law(deflections)

        return resolve(self.searched, choose_law, geometry=geometry, tolerance=TORQUE_TAIL, friction="none")

    @property
    def planned_torque(self) -> Array:
        """The planned torques (T, n_a) [N m or N] at the nodes, without dry friction."""
        return self.dynamics.torques(self.grid.times)

    def compute_pass(self, deflections: Array) -> Pass:
        """Compute motion and forces at the nodes for deflections (T, n_e) under the corrected law.

        The deflections are not iterated, so that torques from this pass are estimates of first order.

        Raises:
            NoAnswer: no correction of the law makes the torques bounded.
        """
        series = self.grid.fit(deflections)
        law = self._correct_law(series)
        return evaluate_pass(self.searched.branch, self.grid, law, series, None)

    def torque(self, evaluated: Pass) -> Array:
        """Compute the motors' torques (T, n_a) [N m or N] of a pass at the nodes.

        `evaluated` has the motion of the other model and its forces without friction.

        Torques with dry friction jump where a joint changes direction, and the tail of a series cannot tell
        a pole from a jump. So the check for a pole uses a smooth friction, which equals the dry friction at
        the crossings: condition (8) contains it there.

        Raises:
            NotConverged: the torques have a pole.
        """
        smooth = 0.0 if self.friction is None else self.friction * self._smooth_signs()
        torque = self._torque_with_friction(evaluated, smooth)
        tail = self.grid.fit(torque).tail
        if not tail <= RESOLVABLE_TAIL:
            raise NotConverged("the torques of the other model have a pole on this motion", residual=tail)
        if self.friction is None:
            return torque
        # rates over the joints' scales, so that one threshold tells motion from rest
        dry = self.friction * speed_signs(evaluated.motion.v / self.robot.column_scale)
        return self._torque_with_friction(evaluated, dry)

    @cached_property
    def first_torque(self) -> Array:
        """The motors' torques (T, n_a) [N m or N] of the first pass, at the nodes."""
        return self.torque(self.first_pass)

    def torque_with(self, coordinates: Sequence[str]) -> Array:
        """Compute torques (T, n_a) [N m or N] while some springs deflect as the first pass causes.

        Args:
            coordinates: of these springs, by name. All others deflect as in the motion, or not at all.
        """
        is_deflecting = np.isin(self.robot.elastic_names, coordinates)
        deflections = np.where(is_deflecting, self.first_pass.caused, self.known_deflections())
        return self.torque(self.compute_pass(deflections))

    def _smooth_signs(self) -> Array:
        """Evaluate polynomials (T, nv) through the signs of joint rates at crossings; 0 without crossings."""
        from scipy.interpolate import KroghInterpolator  # takes time to import

        times = np.array([crossing.time for crossing in self.dynamics.crossings])
        if not len(times):
            return np.zeros((len(self.grid.times), self.robot.nv))
        return np.asarray(KroghInterpolator(times, self._rate_signs(times))(self.grid.times))

    def _torque_with_friction(self, evaluated: Pass, friction: Array | float) -> Array:
        """Compute motor torques (T, n_a) of a pass with friction (T, nv) [N m, N] at the joints."""
        robot, motion = self.robot, evaluated.motion
        forces = tree_forces(robot, motion) + friction
        return motor_torque(robot, motion, balanced_forces(robot, motion.linearised, forces).joint_torque)

    def _rate_signs(self, times: Array) -> Array:
        """Compute the signs (k, nv) of the joint rates at instants (k,) [s]."""
        return speed_signs(self.dynamics.velocity(times) / self.robot.column_scale)

    def _correct_law(self, deflections: TimeFunction) -> CorrectedLaw:
        """Correct the law to meet the model's condition (8) under deflections over time.

        Condition (8), alpha s" + beta s'^2 + gamma = 0 at a crossing, says that no power is required in the
        uncontrolled motion t_s. At each crossing s and s" become those of the model's singular point nearest
        to it, as deflected; s' stays as planned. Dry friction adds its power in t_s to gamma.

        Args:
            deflections: deflections (n_e) [m, rad] as a function of time.

        Raises:
            NoAnswer: the model has no such singular point, or no s" meets its condition (8); two crossings
                meet one singular point, or the law turns back.
        """
        crossings = self.dynamics.crossings
        times = np.array([crossing.time for crossing in crossings])
        nearest = [
            min(self.searched.points, key=lambda point: abs(point.s - crossing.s), default=None)
            for crossing in crossings
        ]
        singular = [point for point in nearest if point is not None and point.corank == 1]
        if len(singular) < len(crossings):
            raise NotConverged("the model has no simple singular point at the crossing")
        points = CrossingTracker(self.searched.branch, singular, times).follow(deflections)
        # (k, nv) [N m or N] of the joints at the crossings
        friction = np.zeros((len(times), self.robot.nv))
        if self.friction is not None:
            friction = self.friction * self._rate_signs(times)

        planned = np.array([(each.s, each.speed, each.acceleration) for each in crossings]).reshape(-1, 3)
        corrected = planned.copy()  # (k, 3) s, s', s" at the crossings
        for k, (point, force) in enumerate(zip(points, friction, strict=True)):
            condition = point.condition
            assert condition is not None  # of a followed point
            condition = condition._replace(gamma=condition.gamma + float(force @ point.motion))
            corrected[k, 0] = point.s
            if not condition.holds_anyway:
                if condition.alpha == 0.0:
                    raise NotConverged("no acceleration at the crossing meets the model's condition (8)")
                corrected[k, 2] = condition.acceleration(planned[k, 1])
        if not np.all(np.diff(corrected[:, 0]) > SAME_PLACE):
            raise NotConverged("crossings of the motion meet the same singular point of the model")
        has_springs = self.robot.n_e + self.dynamics.robot.n_e > 0
        law = CorrectedLaw.of(self.dynamics.law, times, corrected - planned, SMOOTHNESS[has_springs])
        try:
            check_advance(law, list(corrected[:, 0]))
        except NoLaw as refusal:
            raise NotConverged(f"the corrected law turns back: {refusal.sentence}") from None
        return law


# ------------------------------------------------------------------ the effects

# Effects in words, each with a function that computes the torques (T, n_a) it adds, or raises NoAnswer.
Differences = Iterator[tuple[str, Callable[[], Array]]]


class NeglectedEffect(NamedTuple):
    """An effect that the torques of a motion leave out.

    effect: description in words.
    torque: the largest torque that the effect adds at a motor [N m or N, motor side]; None if unknown.
    motor: the joint of that motor; empty if the effect concerns no single motor.
    share: `torque` divided by the largest planned torque of motors of the same unit; None if unknown.
    """

    effect: str
    torque: float | None = None
    motor: str = ""
    share: float | None = None


def neglected_effects(dynamics: InverseDynamics) -> tuple[NeglectedEffect, ...]:
    """Compute the neglected effects of a motion, largest first, unknown ones last.

    Effects smaller than the tail of the torques are not listed. Each number is a first-order estimate for one
    effect alone. It is only an order of magnitude if it comes near the largest torque, as for springs under a
    load across a crossing.
    """
    robot = dynamics.robot
    torque_peaks, _speed_peaks = motor_peaks(dynamics)
    peaks = largest_by_unit(robot, torque_peaks)
    effects = [
        _measure_effect(robot, peaks, effect, difference)
        for effect, difference in _list_differences(dynamics)
    ]
    effects += _idle_turn_effects(dynamics, peaks)
    effects += map(NeglectedEffect, robot.description.left_out)

    unknown = [effect for effect in effects if effect.share is None]
    resolved = max(TORQUE_TAIL, dynamics.certificate.tail)  # smaller shares are errors of the series
    measured = [effect for effect in effects if (effect.share or 0.0) > resolved]
    return (*sorted(measured, key=lambda effect: -(effect.share or 0.0)), *unknown)


def _measure_effect(
    robot: ParallelRobot, peaks: Array, effect: str, difference: Callable[[], Array]
) -> NeglectedEffect:
    """Measure the largest torque of an effect relative to the planned peaks.

    If the torque cannot be computed, the result says why.

    Args:
        peaks: largest planned torque (n_a,) of motors of the same unit.
        effect: description in words.
        difference: computes the torques (T, n_a) that the effect adds, or raises NoAnswer.
    """
    try:
        largest = np.abs(difference()).max(axis=0)
    except NoAnswer as failure:
        return NeglectedEffect(f"{effect}: no number, {failure.sentence}")
    if not np.all(np.isfinite(largest)):
        return NeglectedEffect(f"{effect}: no number, the torques have a pole")
    shares = largest / peaks
    motor = np.argmax(shares)  # index of the motor
    joint = robot.actuator_names[motor]
    return NeglectedEffect(effect, float(largest[motor]), joint, float(shares[motor]))


def _list_differences(dynamics: InverseDynamics) -> Differences:
    """Yield descriptions of effects, each with a function that computes its torques (T, n_a).

    The model with all springs measures springs left rigid, and geometry and inertia of active springs. It is
    made when the first effect is computed, so that a failure to make it is reported with that effect.
    """
    robot, description = dynamics.robot, dynamics.robot.description
    all_springs = FLEXIBILITIES[-1]

    @cache
    def elastic_model() -> ModelOnMotion:
        """Return the model in which all springs are active, on the given motion; made once."""
        model = ParallelRobot.from_description(description, flexibility=all_springs)
        return ModelOnMotion.of(dynamics, model)

    def torque_of_springs(coordinates: Sequence[str]) -> Array:
        """Compute the change of torque (T, n_a) by springs that the motion leaves rigid."""
        return elastic_model().torque_with(coordinates) - elastic_model().first_torque

    # springs of joints and of links, one effect each
    for part in ("joint", "link"):
        springs = [
            spring
            for spring in description.active_springs(all_springs)
            if spring.part == part and not set(robot.elastic_names).issuperset(spring.coordinates)
        ]
        coordinates = [name for spring in springs for name in spring.coordinates]
        if springs:
            names = list_names([spring.name for spring in springs], MAX_NAMES)
            yield f"springs of {part}s left rigid ({names})", partial(torque_of_springs, coordinates)

    # effects of the deflections of active springs, against the torques of the motion
    if robot.n_e and dynamics.geometry == "rigid":
        yield (
            "deformed geometry",
            lambda: elastic_model().torque_with(robot.elastic_names) - elastic_model().planned_torque,
        )
    if robot.n_e and not robot.elastic_inertia:
        yield (
            "inertia of the elastic motion",
            lambda: elastic_model().first_torque - elastic_model().planned_torque,
        )

    def torque_of_friction() -> Array:
        """Compute the change of torque (T, n_a) by the dry friction that the torques do not contain."""
        with_friction = ModelOnMotion.of(dynamics, robot, friction=friction)
        without = replace(with_friction, friction=None)
        return with_friction.first_torque - without.first_torque

    friction = neglected_friction(dynamics)
    if friction.any():
        yield (
            f"dry friction of {robot.friction_sizes(np.flatnonzero(friction))} (joint side)",
            torque_of_friction,
        )


def neglected_friction(dynamics: InverseDynamics) -> Array:
    """Return the dry friction (nv,) [N m or N] of joints that a motion's torques do not contain."""
    friction = dynamics.robot.joint_friction.copy()
    if dynamics.friction is not None:
        friction[dynamics.robot.actuated] = 0.0
    return friction


def _idle_turn_effects(dynamics: InverseDynamics, peaks: Array) -> Iterator[NeglectedEffect]:
    """Yield the torque that would hold the idle turns, an estimate of the error of the torques.

    Args:
        peaks: largest planned torque (n_a,) of motors of the same unit.
    """
    robot, holding = dynamics.robot, dynamics.certificate.max_held_torque
    if not holding:
        return
    idle = robot.structure.idle
    still_turns = np.setdiff1d(idle, driven_turns(robot))  # balls with damping or armature drive the others
    columns = still_turns if len(still_turns) else idle  # the coordinates to name
    names = list_names([robot.coordinates.turn_name(column) for column in columns], MAX_NAMES)
    torque = float(holding / np.abs(robot.gear_ratio).min())
    yield NeglectedEffect(f"what nothing holds of {names}", torque, share=float(torque / peaks.max()))
