"""A model with more effects than the one a motion was computed with, along nearly the same motion.

The fuller model has its own condition (8) and, with springs, its own singular point on the path. So the law
is corrected by a polynomial of least degree. It vanishes at both ends, as smoothly as laws of the fuller
model do, and takes the law through the singular points of the fuller model at the same instants and speeds,
with the accelerations of its condition (8). Then the torques are bounded, and their difference is what the
motion lacks. The deflections are caused by the forces of the first model: one pass, of first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from framework.arrays import Array, ArrayLike
from framework.crossing.condition import Deflection, condition_at, crossing_point
from framework.crossing.refusals.turning_back import check_advance
from framework.crossing.request import SMOOTHNESS
from framework.dynamics.elastic_pass import Pass, evaluate_pass
from framework.dynamics.forces import balanced_forces, motor_torque, tree_forces
from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.result import InverseDynamics, SingularityCrossing
from framework.errors import NoLaw, NotConverged
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.chebyshev import TimeFunction, TimeGrid
from framework.motion.law import Law, MotionLaw, conditions_at_instants
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.tolerances import RESOLVABLE_TAIL, SAME_PLACE


@dataclass(frozen=True)
class CorrectedLaw:
    """A law plus a polynomial that vanishes at its ends."""

    law: MotionLaw
    correction: Law

    @property
    def duration(self) -> float:
        return self.law.duration

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        return self.law(t, order) + self.correction(t, order)


@dataclass(frozen=True, eq=False)
class FullerModel:
    """A motion with its torques, and the same path searched with a robot of more effects.

    friction: dry friction (nv,) of the joints [N m or N] of the fuller model, None without.
    """

    dynamics: InverseDynamics
    searched: SearchedPath
    friction: Array | None = None

    @classmethod
    def of(
        cls, dynamics: InverseDynamics, robot: ParallelRobot, *, friction: Array | None = None
    ) -> FullerModel:
        """Search the path of a motion with a fuller robot.

        Raises:
            NoAnswer: the robot cannot follow the path.
        """
        return cls(dynamics, search_path(robot, dynamics.path).under(dynamics.wrenches), friction)

    @property
    def robot(self) -> ParallelRobot:
        """The fuller robot."""
        return self.searched.branch.robot

    @property
    def grid(self) -> TimeGrid:
        """The nodes of the motion."""
        torques = self.dynamics.torques
        return TimeGrid(torques.edges, torques.coefficients.shape[1])

    def known_deflections(self) -> Array:
        """Return the deflections (T, n_e) of the fuller robot at which the motion's forces were computed."""
        dynamics, robot = self.dynamics, self.robot
        deflections = np.zeros((len(self.grid.times), robot.n_e))
        if dynamics.geometry == "deformed":
            columns = [robot.elastic_names.index(name) for name in dynamics.robot.elastic_names]
            deflections[:, columns] = dynamics.deflection(self.grid.times)
        return deflections

    @cached_property
    def first_pass(self) -> Pass:
        """The motion and forces with the deflections of the motion; raises NoAnswer as `compute_pass`."""
        return self.compute_pass(self.known_deflections())

    @property
    def planned_torque(self) -> Array:
        """The motors' torques (T, n_a) [N m or N] of the motion on the nodes, without dry friction."""
        return self.dynamics.torque_without_friction(self.grid.times)

    def compute_pass(self, deflections: Array) -> Pass:
        """Compute motion and forces on the nodes with deflections (T, n_e), under the corrected law.

        Raises:
            NoAnswer: no correction of the law makes the torques bounded.
        """
        function = self.grid.fit(deflections)
        law = self._correct_law(function)
        return evaluate_pass(self.searched.branch, self.grid, law, function, None)

    def torque(self, evaluated: Pass) -> Array:
        """Compute the motors' torques (T, n_a) [N m or N], motor side, on the nodes.

        Torques with dry friction jump where a joint changes direction, and no tail tells a pole from a jump.
        So a pole is looked for with smooth friction: of each joint, the polynomial through the signs of its
        rate at the crossings. There it equals the friction, on which condition (8) depends.

        Raises:
            NotConverged: the torques have a pole.
        """
        robot, motion = self.robot, evaluated.motion
        smooth = np.zeros_like(motion.v)
        if self.friction is not None and self.dynamics.crossings:
            from scipy.interpolate import KroghInterpolator  # takes time to import

            times = np.array([crossing.time for crossing in self.dynamics.crossings])
            smooth = self.friction * KroghInterpolator(times, self._rate_signs(times))(self.grid.times)
        torque = self._torque_with_friction(evaluated, smooth)
        tail = self.grid.fit(torque).tail
        if not tail <= RESOLVABLE_TAIL:
            raise NotConverged("the torques of the fuller model have a pole on this motion", residual=tail)
        if self.friction is None:
            return torque
        return self._torque_with_friction(
            evaluated, self.friction * speed_signs(motion.v / robot.column_scale)
        )

    def _torque_with_friction(self, evaluated: Pass, friction: Array) -> Array:
        """Compute torques (T, n_a) with joint forces of friction (T, nv)."""
        robot, motion = self.robot, evaluated.motion
        if not friction.any():
            return motor_torque(robot, motion, evaluated.forces.joint_torque)
        forces = tree_forces(robot, motion) + friction
        return motor_torque(robot, motion, balanced_forces(robot, motion.linearised, forces).joint_torque)

    def _rate_signs(self, times: Array) -> Array:
        """Compute the signs (k, nv) of the joints' rates at instants (k,) of the motion [s]."""
        return speed_signs(self.dynamics.velocity(times) / self.robot.column_scale)

    def _correct_law(self, function: TimeFunction) -> CorrectedLaw:
        """Correct the law to meet condition (8) of the fuller model with deflections in time.

        The correction is zero at both ends. At each crossing, s, s' and s" change from those planned to those
        of `_correct_crossing`.

        Raises:
            NoAnswer: as `_correct_crossing`; two crossings meet one singular point; the law turns back.
        """
        duration, smoothness = self.dynamics.duration, SMOOTHNESS[self.robot.n_e > 0]
        corrections = conditions_at_instants([0.0, duration], np.zeros((2, smoothness + 1)))
        singular = []  # s of the fuller model
        for crossing in self.dynamics.crossings:
            planned = [float(self.dynamics.law(crossing.time, order)) for order in range(3)]
            corrected = self._correct_crossing(crossing, function, planned)
            singular.append(corrected[0])
            corrections += conditions_at_instants([crossing.time], [np.subtract(corrected, planned)])
        if not np.all(np.diff(singular) > SAME_PLACE):
            raise NotConverged("crossings of the motion meet the same singular point of the fuller model")
        law = CorrectedLaw(self.dynamics.law, Law.from_conditions(corrections, duration))
        try:
            check_advance(law, singular, self.robot.name)
        except NoLaw as refusal:
            raise NotConverged(f"the corrected law turns back: {refusal}") from None
        return law

    def _correct_crossing(
        self, crossing: SingularityCrossing, function: TimeFunction, planned: list[float]
    ) -> tuple[float, float, float]:
        """Compute s, s' and s" with which the fuller model crosses at the instant of a crossing.

        s' stays as planned. Dry friction adds its power in the uncontrolled motion to gamma of condition (8).

        Args:
            planned: s, s' and s" of the law.

        Raises:
            NoAnswer: the fuller model has no such singular point, or no s" meets its condition (8).
        """
        branch, speed, acceleration = self.searched.branch, planned[1], planned[2]
        singular = min(self.searched.points, key=lambda point: abs(point.s - crossing.s), default=None)
        if singular is None or singular.corank > 1:
            raise NotConverged("the fuller model has no simple singular point at the crossing")
        deflection = Deflection.evaluate(function, crossing.time)
        point = crossing_point(branch, singular, deflection, crossing.s)
        condition = condition_at(branch, point, deflection)
        if self.friction is not None:
            friction = self.friction * self._rate_signs(np.array([crossing.time]))[0]
            power = float(friction @ point.motion)
            condition = condition._replace(gamma=condition.gamma + power)
        if condition.alpha == 0.0 and not condition.holds_anyway:
            raise NotConverged("no acceleration at the crossing makes up for it")
        if not condition.holds_anyway:
            acceleration = condition.acceleration(speed)
        return point.s, speed, acceleration
