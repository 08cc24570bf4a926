"""The result of inverse dynamics: torques, motor angles and deflections as functions of time.

They are Chebyshev series on panels in time. Where the robot is singular (Type 2), t_s . W_p is the power of
the required wrench in the uncontrolled motion; condition (8) sets it to zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.dynamics.motor_friction import PlannedFriction
from framework.errors import check_order, real_numbers, whole_number
from framework.kinematics.external_wrenches import NO_WRENCHES, ExternalWrenches
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw, law_derivatives
from framework.laws.path import HIGHEST_ORDER, Path, time_derivatives
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.chebyshev import TimeFunction
from framework.singularity.points_on_path import SingularPoint


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """The numbers that prove the torques of a result.

    nodes: number of Chebyshev nodes in time, on all panels together.
    tail: largest of the last Chebyshev coefficients of torques and deflections divided by the largest
        coefficient. With a pole, coefficients do not decay with more nodes: they stay of the size of its
        residue.
    passes: number of evaluations of forces at given deflections, on all grids together.
    change: relative change of deflections or spring forces by one more pass; 0 with rigid geometry, which has
        no iteration.
    max_closure_error: largest residual of a loop or platform equation [m or rad], on the nodes and half-way
        between them, redundant loop equations included.
    max_residual_torque: largest torque that the planned motion would need in a joint in addition to motors
        and springs, half-way between the nodes [N m or N]; idle joints are not counted.
    max_held_torque: largest torque that the planned motion would need in an idle joint, such as the spin of a
        rod about its own line [N m or N]. The motors' torques have errors of the same order of magnitude. 0
        without idle joints; at most `tolerances.HELD_IDLE` of a motor's largest torque on the joint side.
    end_speed: largest motor speed at both ends divided by the largest of the motion. Zero if the law is
        smooth enough; an elastic robot whose springs carry inertia needs more smoothness than its default.
    monotone: whether s' > 0 at all instants between the ends.
    rounded_gap: largest gap [m or rad] of loop equations that are left out because they repeat others up to
        rounding; 0 if there are none.
    """

    nodes: int
    tail: float
    passes: int
    change: float
    max_closure_error: float = 0.0
    max_residual_torque: float = 0.0
    max_held_torque: float = 0.0
    end_speed: float
    monotone: bool
    rounded_gap: float = 0.0

    @property
    def unresolved(self) -> float:
        """The relative error of the series: `tail` or `change`, the larger one."""
        return max(self.tail, self.change)


@dataclass(frozen=True, eq=False, kw_only=True)
class SingularityCrossing(SingularPoint):
    """A singular point of the deflected robot at an instant of a motion.

    The slope is that of the undeformed robot.

    wrench: t_s . W_p at this instant [N, or N m for a pure turn], with the inertia of all bodies.
    scale: the largest sum, along the motion, of the absolute values of the terms of t_s . W_p; at least
        mass length / duration^2. Condition (8) holds if wrench / scale is rounding.
    """

    time: float  # [s]
    speed: float  # s' [1/s]
    acceleration: float  # s" [1/s^2]
    wrench: float
    scale: float

    @property
    def residual(self) -> float:
        """|t_s . W_p| relative to `scale`."""
        return abs(self.wrench) / self.scale if self.scale > 0 else 0.0


@dataclass(frozen=True, repr=False, eq=False)
class InverseDynamics(ReadOnlyArrays):
    """The torques of a motion as functions of time, with the certificate."""

    robot: ParallelRobot
    path: Path
    law: MotionLaw
    geometry: str
    torques: TimeFunction  # (n_a) [N m], motor side, without dry friction
    motor_angles: TimeFunction  # (n_a) [rad], motor side
    deflections: TimeFunction  # (n_e) [m, rad]
    deflection_rates: tuple[TimeFunction, ...]  # (n_e) their first and second time derivatives
    offsets: TimeFunction  # (nv) all coordinates as tangent offset from `origin`
    origin: Array  # (nq,)
    crossings: tuple[SingularityCrossing, ...]
    certificate: Certificate
    friction: PlannedFriction | None = None  # dry, of the driven joints
    wrenches: ExternalWrenches = NO_WRENCHES  # along the path

    def __repr__(self) -> str:
        """Return robot, geometry, duration, crossings and tail in one line."""
        return (
            f"InverseDynamics({self.robot.name}, {self.robot.flexibility}, {self.geometry}: "
            f"{self.duration:g} s, crossings at {[round(p.time, 6) for p in self.crossings]} s, tail "
            f"{self.certificate.tail:.1e})"
        )

    @property
    def duration(self) -> float:
        """The duration of the motion [s]."""
        return self.law.duration

    def torque(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate motor torques [N m] or time derivatives of an order, (T, n_a); a scalar t gives (n_a,).

        With dry friction of the driven joints, the torques jump where a motor reverses; their derivatives are
        those of the smooth part.
        """
        smooth = self.torques(t, order)
        return smooth if self.friction is None or order > 0 else smooth + self.friction(t)

    def motor_angle(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate motor angles [rad] (gear ratio times joint angle) or derivatives of an order, (T, n_a).

        Accelerations come from `motion`, since the second derivative of a series loses digits at the ends.
        """
        if order != 2:
            return self.motor_angles(t, order)
        times = real_numbers("t", t)
        accelerations = self.robot.gear_ratio * self.motion(times.ravel()).a[:, self.robot.actuated]
        return accelerations.reshape(*times.shape, -1)

    def deflection(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate deflections of the springs [m, rad] or their time derivatives, (T, n_e)."""
        return self.deflection_rates[order - 1](t) if order in (1, 2) else self.deflections(t, order)

    def platform(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate platform coordinates [m, rad] or their time derivatives up to order 4, (T, n)."""
        check_order(order, HIGHEST_ORDER)
        times = real_numbers("t", t)
        return time_derivatives(self.path, law_derivatives(self.law, times, order + 1))[order]

    def configuration(self, t: ArrayLike) -> Array:
        """Evaluate all joint coordinates q (T, nq) at t (T,), deflections included."""
        return integrate(self.robot, self.origin, self.offsets(np.atleast_1d(t)))

    def motion(self, t: ArrayLike, *, closed: bool = True) -> Motion:
        """Compute the motion of all joints at t (T,) with external wrenches.

        Args:
            closed: whether the loops are closed to rounding; if not, the poses are those of the series.
        """
        times = np.atleast_1d(real_numbers("t", t))
        s_and_rates = law_derivatives(self.law, times)  # s and two time derivatives, (T,) each
        x, dx, ddx = time_derivatives(self.path, s_and_rates)
        q = self.configuration(times)
        poses = close_loops(self.robot, x, q) if closed else linearised_at(self.robot, q, x)
        rates = [rate(times) for rate in self.deflection_rates] if self.robot.n_e else []
        motion = motion_at(self.robot, poses, dx, ddx, *rates)
        return motion.with_wrenches(self.wrenches.evaluate(self.robot, poses.frames, s_and_rates[0]))

    def velocity(self, t: ArrayLike, order: int = 1) -> Array:
        """Compute joint velocities (order 1) or accelerations (order 2), (T, nv).

        They come from `motion`: derivatives of the series of offsets lose digits on short panels.
        """
        whole_number("order", order, 1, 2)
        motion = self.motion(t)
        return motion.v if order == 1 else motion.a
