"""Condition (8) on a path: alpha s" + beta s'^2 + gamma + delta s' = 0 at the singular point.

At a Type 2 singularity the motors cannot exert a wrench along the platform's twist t_s. Their torques stay
finite only if the motion requires none there: t_s . W_p = 0, where W_p is the wrench on the platform that the
inertia and weight of all bodies require (Briot and Arakelian 2010, condition (8)).

t_s . W_p = motion . r, where r are the generalised forces of the open tree (`dynamics.forces`), less the
external wrenches, and `motion` are the joint rates of t_s with locked motors. On a path, r is affine in s"
and quadratic in s', so a few evaluations of the inverse dynamics give the coefficients (toppra finds its
constraint coefficients in the same way). delta comes from viscous damping and from changing deflections.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from framework.dynamics.forces import inertial_forces, static_forces
from framework.errors import NoLaw, NotConverged, point
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack, LinearisedLoops, linearised_at
from framework.kinematics.loop_matrices import type2_matrix
from framework.kinematics.motion_rates import Motion, joint_rates, motion_at
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.planning.motion_scales import coordinate_sizes
from framework.singularity.bordered_system import root_of_g
from framework.singularity.points_on_path import SingularPoint
from framework.singularity.type2 import least_controlled_motion, sign_along, uncontrolled_motion
from framework.tolerances import CONDITION_ROUNDING, NO_HOLD

Speed = TypeVar("Speed", float, Array)


class Condition8(NamedTuple):
    """Coefficients of condition (8), t_s . W_p = alpha s" + beta s'^2 + delta s' + gamma.

    The unit is N, or N m where t_s is a pure turn. A coefficient of the size of rounding is set to zero.
    """

    alpha: float
    beta: float
    gamma: float
    delta: float

    @property
    def holds_anyway(self) -> bool:
        """Whether t_s . W_p vanishes for all s' and s", as on a straight path across t_s without weight."""
        return not any(self)

    def acceleration(self, speed: Speed) -> Speed:
        """Return the s" [1/s^2] that makes t_s . W_p vanish at speeds s' [1/s]; 0 if any s" does."""
        if self.holds_anyway:
            return 0.0 * speed
        return -(self.beta * speed**2 + self.delta * speed + self.gamma) / self.alpha


class Deflection(NamedTuple):
    """Deflections [m, rad] and two time derivatives at one instant, each (n_e,)."""

    value: Array
    rate: Array
    acceleration: Array

    @staticmethod
    def evaluate(deflections: Callable[[float, int], Array], time: float) -> Deflection:
        """Evaluate the function deflections(t, order) at a time [s]."""
        return Deflection(*(deflections(time, order) for order in range(3)))


class CrossingPoint(NamedTuple):
    """A point of the path where condition (8) is to hold, of the deflected or the undeformed robot."""

    s: float
    kind: str
    twist: Array  # (n,) t_s
    motion: Array  # (nv,) joint rates of t_s with locked motors
    q: Array  # (nq,)
    corank: int = 1  # number of motions that escape at once; `motion` is one of them
    touches: bool = False  # whether the path touches the locus without crossing it


def undeformed_crossing(singular: SingularPoint | CrossingPoint) -> CrossingPoint:
    """Convert a singular point of the undeformed robot to a crossing point."""
    if isinstance(singular, CrossingPoint):  # imposed by the user
        return singular
    touches = singular.contact == "tangential"
    return CrossingPoint(
        singular.s, singular.kind, singular.twist, singular.motion, singular.q, singular.corank, touches
    )


def crossing_point(
    branch: Branch, singular: SingularPoint | CrossingPoint, deflection: Deflection | None, s_guess: float
) -> CrossingPoint:
    """Find the singular point of the deflected robot near `s_guess` on the path.

    A point imposed by the user is returned unchanged; so is the point of a robot without deflections.

    Raises:
        NoLaw: the deflected robot has no singular point there.
    """
    if isinstance(singular, CrossingPoint) or deflection is None or not len(deflection.value):
        return undeformed_crossing(singular)
    robot, poses = branch.robot, _DeflectedPoses(branch, deflection)
    root = root_of_g(lambda s: type2_matrix(robot, poses.close(s).linearised), s_guess)
    if not root.converged:
        raise NoLaw(
            f"{robot.name}: the deflected robot has no singular point near s = {singular.s:.6g}; the "
            f"deflections are too large for the path to cross the locus there"
        )
    closed = poses.predicted_pose(root.place)
    twist, motion = least_controlled_motion(robot, closed.linearised)
    return _orient_along_path(branch, root.place, closed, twist, motion, singular.kind)


class _DeflectedPoses:
    """Poses along a path at constant deflections, each predicted from the last poses closed."""

    def __init__(self, branch: Branch, deflection: Deflection) -> None:
        """Start from the poses of the undeformed robot and deflect the springs."""
        self._branch = branch
        self._spring_step = np.zeros((1, branch.robot.nv))
        self._spring_step[:, branch.robot.elastic] = deflection.value
        # the last s (3,) at which `root_of_g` asked for poses, the iterate in the middle, and these poses
        self._closed: tuple[Array, ClosedStack] | None = None

    def close(self, s: Array) -> ClosedStack:
        """Close the loops at s (3,)."""
        branch = self._branch
        self._closed = s, close_loops(branch.robot, branch.path(s), self._predict(s))
        return self._closed[1]

    def predicted_pose(self, s: float) -> ClosedStack:
        """Predict the pose at s from the last poses closed.

        The step along their tangent is so short that the loops stay closed.
        """
        branch, s_row = self._branch, np.array([s])
        q, x = self._predict(s_row), branch.path(s_row)
        return ClosedStack(q, x, linearised_at(branch.robot, q, x))

    def _predict(self, s: Array) -> Array:
        """Predict configurations (k, nq) at s (k,) along the tangent of the last poses."""
        branch, robot = self._branch, self._branch.robot
        if self._closed is None:
            return integrate(robot, branch.guess(s), np.repeat(self._spring_step, len(s), axis=0))
        last_s, last = self._closed
        tangent = difference(robot, last.q[0], last.q[2:]) / (last_s[2] - last_s[0])  # dq/ds (1, nv)
        return integrate(robot, last.q[1], (s - last_s[1])[:, None] * tangent)


def imposed_point(branch: Branch, s: float) -> CrossingPoint:
    """Return the crossing point imposed at s, singular or not.

    With rounded data an imposed point lies beside the singular one.
    """
    closed = branch.close(s)
    kind, twist, motion, _ = uncontrolled_motion(branch.robot, closed.linearised)
    return _orient_along_path(branch, s, closed, twist, motion, kind)


def _orient_along_path(
    branch: Branch, s: float, closed: ClosedStack, twist: Array, motion: Array, kind: str
) -> CrossingPoint:
    """Return the crossing point, its twist and motion signed along the path."""
    sign = sign_along(twist, branch.robot.platform.path_twist(branch.path, s))
    return CrossingPoint(s, kind, sign * twist, sign * motion, closed.q[0])


def condition_at(branch: Branch, crossing: CrossingPoint, deflection: Deflection | None) -> Condition8:
    """Compute the coefficients of condition (8); refuse a condition that s" cannot meet.

    Raises:
        NoLaw: s" has no effect on t_s . W_p, so that no law can meet the condition.
        NotConverged: s" has no effect with these deflections.
    """
    return require_effect(branch, crossing, coefficients_at(branch, crossing, deflection), deflection)


def require_effect(
    branch: Branch, crossing: CrossingPoint, condition: Condition8, deflection: Deflection | None
) -> Condition8:
    """Return a condition that some s" meets or that always holds; raise as `condition_at`."""
    robot = branch.robot
    if condition.holds_anyway or condition.alpha != 0.0:
        return condition
    axes, x = ", ".join(robot.axis_names), point(branch.path(crossing.s))
    where = f"{robot.name}: at s = {crossing.s:.6g}, {axes} = {x}"
    if deflection is not None and robot.n_e:
        raise NotConverged(
            f'{where} s" has no effect on t_s . W_p once the robot deflects: with these deflections the path '
            f"runs orthogonal to t_s; use stiffer springs, geometry rigid, or another direction",
            residual=0.0,
        )
    raise NoLaw(
        f'{where} the path runs orthogonal to t_s: s" has no effect on t_s . W_p there; cross in another '
        f"direction"
    )


def coefficients_at(branch: Branch, crossing: CrossingPoint, deflection: Deflection | None) -> Condition8:
    """Compute the coefficients of condition (8) at a crossing point.

    Each coefficient is the power of these generalised forces in the uncontrolled motion:

        alpha: inertia at s" = 1
        beta:  inertia at s' = 1
        gamma: weight and external wrenches at rest, and inertia and damping while only deflections change
        delta: damping at s' = 1, and the inertial forces that are bilinear in s' and the deflection rates

    The bilinear forces are half the difference of the inertial forces at s' = +pace and -pace. At this pace
    path and deflections move the joints equally fast, so that the difference loses few digits. The other
    coefficients need no difference.
    """
    robot = branch.robot
    linearised = linearised_at(robot, crossing.q[None], branch.path(crossing.s)[None])
    deflection = deflection if robot.n_e else None
    pace = 1.0 if deflection is None else _equal_pace(branch, crossing, linearised, deflection.rate)
    motion = _unit_motions(branch, crossing, linearised, deflection, pace)
    wrenches = branch.wrenches.evaluate(robot, linearised.frames, np.array([crossing.s]))
    # powers at the joints, to be summed over them: of the five motions (5, nv), and at rest (nv,)
    inertial = inertial_forces(robot, motion) * crossing.motion
    damping = robot.joint_damping * motion.v * crossing.motion
    static = static_forces(robot, crossing.q[None], wrenches)[0] * crossing.motion
    rigid_terms = np.array([inertial[0], inertial[1], static, damping[1]])  # alpha, beta, gamma, delta
    bilinear = 0.5 * (inertial[3] - inertial[4]) / pace
    elastic_terms = np.array([inertial[2] + damping[2], bilinear])  # gamma, delta
    values = rigid_terms.sum(axis=1)
    values[2:] += elastic_terms.sum(axis=1)

    rate = np.abs(motion.v[1] / robot.column_scale).max()
    sizes = np.maximum(bounds_of_terms(branch, crossing, rate), np.abs(rigid_terms).sum(axis=1))
    sizes[2:] += np.abs(elastic_terms).sum(axis=1)
    # stiff springs add small terms, which are not rounding as long as s" has an effect
    if deflection is None or not abs(values[0]) > NO_HOLD * sizes[0]:
        values = remove_rounding(values, sizes, 0)
    return Condition8(*values.tolist())


def _unit_motions(
    branch: Branch,
    crossing: CrossingPoint,
    linearised: LinearisedLoops,
    deflection: Deflection | None,
    pace: float,
) -> Motion:
    """Compute five motions that separate the terms of condition (8).

    Springs rest in the first two, s" = 1 and s' = 1. They move in the others, at s' = 0, pace and -pace.
    """
    robot = branch.robot
    elastic = np.zeros((2, 5, robot.n_e))  # rates and accelerations of the deflections
    if deflection is not None:
        elastic[0, 2:] = deflection.rate
        elastic[1, 2] = deflection.acceleration
    speeds, accelerations = np.array([0.0, 1.0, 0.0, pace, -pace]), np.eye(5)[0]
    x, dx, ddx = time_derivatives(branch.path, [np.full(5, crossing.s), speeds, accelerations])
    stack = linearised.select(np.zeros(5, dtype=np.intp))
    return motion_at(robot, ClosedStack(stack.frames.q, x, stack), dx, ddx, *elastic)


def remove_rounding(values: Array, sizes: Array, alpha: int) -> Array:
    """Set coefficients (k,) of condition (8) to zero where no larger than rounding.

    Where s" has no effect, no motion can compensate the other coefficients. They then count as rounding up to
    a larger share of their terms.

    Args:
        sizes: sums (k,) of the absolute terms of each coefficient.
        alpha: index of the coefficient of s".
    """
    rounding = CONDITION_ROUNDING if abs(values[alpha]) > NO_HOLD * sizes[alpha] else NO_HOLD
    return np.where(np.abs(values) > rounding * sizes, values, 0.0)


def bounds_of_terms(branch: Branch, crossing: CrossingPoint, rate: float) -> Array:
    """Bound the sizes (4,) of the terms of alpha, beta, gamma and delta.

    The powers at the joints do not show terms that cancelled within a joint force, such as all forces of a
    payload across t_s on massless legs. So the mass of all bodies is taken to move like the platform and, for
    beta, like joints of the robot's length at their largest `rate` dq/ds [1].
    """
    robot = branch.robot
    units = coordinate_sizes(robot)  # (n,) [m]
    tangent = np.abs(robot.platform.path_twist(branch.path, crossing.s) * units).max()
    escape = np.abs(crossing.twist * units).max()
    weight = robot.mass * np.linalg.norm(robot.model.gravity.linear)
    for wrench in branch.wrenches.entries:
        force, moment = np.linalg.norm(wrench(np.array([crossing.s])).reshape(2, 3), axis=1)
        weight += force + moment / robot.length
    alpha, beta = robot.mass * tangent, robot.mass * robot.length * rate**2
    return escape * np.array([alpha, beta, weight, 0.0])


def _equal_pace(branch: Branch, crossing: CrossingPoint, linearised: LinearisedLoops, rate: Array) -> float:
    """Compute the s' [1/s] at which path and deflections move joints equally fast.

    It is 1 if either moves no joint. `rate` (n_e,) are the deflection rates.
    """
    robot = branch.robot
    scale = robot.column_scale
    twist = robot.platform.path_twist(branch.path, crossing.s)
    tangent = joint_rates(robot, linearised, twist[None])  # dq/ds (1, nv)
    path_rate = np.abs(tangent / scale).max()
    elastic_rate = np.abs(rate / scale[robot.elastic]).max()
    return elastic_rate / path_rate if path_rate and elastic_rate else 1.0
