"""Condition (8) on a path: alpha s" + beta s'^2 + gamma + delta s' = 0 at the singular point.

At a Type 2 singularity the motors hold no wrench along the platform's twist t_s. Their torques stay finite if
the motion asks for none there: t_s . W_p = 0, with W_p the wrench that inertia and weight of all bodies ask
of the platform (Briot and Arakelian 2010, condition (8)).

t_s . W_p = motion . r, with r the forces of the open tree (`dynamics.forces`), wrenches of the world
included, and `motion` the joint rates of t_s with locked motors. On a path, r is affine in s" and quadratic
in s'. A few evaluations of the inverse dynamics give its coefficients (toppra recovers its constraint
coefficients in the same way). delta is due to viscous damping and to changing deflections.
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

    In N, or N m where t_s is a pure turn.
    A coefficient that is no more than rounding of its own terms is zero.
    """

    alpha: float
    beta: float
    gamma: float
    delta: float

    @property
    def holds_anyway(self) -> bool:
        """Whether t_s . W_p vanishes for all s' and s".

        So it does on a straight path across t_s, with no weight along t_s.
        """
        return not any(self)

    def acceleration(self, speed: Speed) -> Speed:
        """Return the s" [1/s^2] that makes t_s . W_p vanish at each s'.

        The speeds s' are in 1/s. Where any s" does, it is 0.
        """
        if self.holds_anyway:
            return 0.0 * speed
        return -(self.beta * speed**2 + self.delta * speed + self.gamma) / self.alpha


class Deflection(NamedTuple):
    """Deflections and their time derivatives at one instant, each (n_e,)."""

    value: Array
    rate: Array
    acceleration: Array

    @staticmethod
    def evaluate(deflections: Callable[[float, int], Array], time: float) -> Deflection:
        """Evaluate deflections(t, order) and two derivatives at an instant [s]."""
        return Deflection(*(deflections(time, order) for order in range(3)))


class CrossingPoint(NamedTuple):
    """A singular point of the (deflected) robot on its path."""

    s: float
    kind: str
    twist: Array  # (n,)
    motion: Array  # (nv,)
    q: Array  # (nq,)
    corank: int = 1  # motions that escape at once; `motion` is one of them
    touches: bool = False  # the locus without crossing it


def undeformed_crossing(singular: SingularPoint | CrossingPoint) -> CrossingPoint:
    """Return a singular point of the undeformed robot as a crossing point.

    An imposed point is a crossing point already, and is returned.
    """
    if isinstance(singular, CrossingPoint):
        return singular
    touches = singular.contact == "tangential"
    return CrossingPoint(
        singular.s, singular.kind, singular.twist, singular.motion, singular.q, singular.corank, touches
    )


def crossing_point(
    branch: Branch, singular: SingularPoint | CrossingPoint, deflection: Deflection | None, s_guess: float
) -> CrossingPoint:
    """Find the singular point of the (deflected) robot on its path near `s_guess`.

    An imposed point is returned as it is.

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
    """Poses along a path with constant deflections, each predicted from the poses closed last."""

    def __init__(self, branch: Branch, deflection: Deflection) -> None:
        """Start from the poses of the undeformed robot, its springs deflected."""
        self._branch = branch
        self._spring_step = np.zeros((1, branch.robot.model.nv))
        self._spring_step[:, branch.robot.elastic] = deflection.value
        self._closed: tuple[Array, ClosedStack] | None = None  # s (3,), the middle one the iterate; poses

    def close(self, s: Array) -> ClosedStack:
        """Close the loops at s (3,)."""
        branch = self._branch
        self._closed = s, close_loops(branch.robot, branch.path(s), self._predict(s))
        return self._closed[1]

    def predicted_pose(self, s: float) -> ClosedStack:
        """Predict the pose at s from the poses closed last.

        A step along their tangent is so short that it keeps the loops closed.
        """
        branch, places = self._branch, np.array([s])
        q, x = self._predict(places), branch.path(places)
        return ClosedStack(q, x, linearised_at(branch.robot, q, x))

    def _predict(self, s: Array) -> Array:
        """Predict configurations (k, nq) at s (k,) along the last tangent."""
        branch, robot = self._branch, self._branch.robot
        if self._closed is None:
            return integrate(robot, branch.guess(s), np.repeat(self._spring_step, len(s), axis=0))
        last_s, last = self._closed
        tangent = difference(robot, last.q[0], last.q[2:]) / (last_s[2] - last_s[0])  # (1, nv), dq/ds
        return integrate(robot, last.q[1], (s - last_s[1])[:, None] * tangent)


def imposed_point(branch: Branch, s: float) -> CrossingPoint:
    """Return the crossing point at a path coordinate s, singular or not.

    Rounded data impose points beside the singular one.
    """
    closed = branch.close(s)
    kind, twist, motion, _ = uncontrolled_motion(branch.robot, closed.linearised)
    return _orient_along_path(branch, s, closed, twist, motion, kind)


def _orient_along_path(
    branch: Branch, s: float, closed: ClosedStack, twist: Array, motion: Array, kind: str
) -> CrossingPoint:
    """Return the crossing point with twist and motion oriented along the path."""
    sign = sign_along(twist, branch.robot.platform.path_twist(branch.path, s))
    return CrossingPoint(s, kind, sign * twist, sign * motion, closed.q[0])


def condition_at(branch: Branch, crossing: CrossingPoint, deflection: Deflection | None) -> Condition8:
    """Compute the coefficients of a condition (8) on which s" has an effect.

    Raises:
        NoLaw: the path's tangent leaves t_s . W_p untouched by s", so no law can meet the condition.
        NotConverged: the same, but only with these deflections.
    """
    return require_effect(branch, crossing, coefficients_at(branch, crossing, deflection), deflection)


def require_effect(
    branch: Branch, crossing: CrossingPoint, condition: Condition8, deflection: Deflection | None
) -> Condition8:
    """Return a condition that some s" meets, or that holds anyway.

    Raises as `condition_at`.
    """
    robot = branch.robot
    if condition.holds_anyway or condition.alpha != 0.0:
        return condition
    axes, place = ", ".join(robot.axis_names), point(branch.path(crossing.s))
    where = f"{robot.name}: at s = {crossing.s:.6g}, {axes} = {place}"
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

    Each is the power of forces in the uncontrolled motion:

        alpha: of inertia at s" = 1
        beta:  of inertia at s' = 1
        gamma: of weight and wrenches at rest, and of inertia and damping while only the deflections change
        delta: of damping at s' = 1, and of inertia where s' and the rates of the deflections multiply

    The last is half the difference of inertia at +pace and -pace, where path and deflections move the joints
    equally fast. No other difference is taken, which would lose digits.
    """
    robot = branch.robot
    linearised = linearised_at(robot, crossing.q[None], branch.path(crossing.s)[None])
    deflection = deflection if robot.n_e else None
    pace = 1.0 if deflection is None else _equal_pace(branch, crossing, linearised, deflection.rate)
    motion = _unit_motions(branch, crossing, linearised, deflection, pace)
    wrenches = branch.wrenches.evaluate(robot, linearised.frames, np.array([crossing.s]))
    # powers of the joints (nv,), each to be summed: of five motions, and at rest
    inertial = inertial_forces(robot, motion) * crossing.motion  # (5, nv)
    damping = robot.joint_damping * motion.v * crossing.motion  # (5, nv)
    static = static_forces(robot, crossing.q[None], wrenches)[0] * crossing.motion  # (nv,)
    rigid_terms = np.array([inertial[0], inertial[1], static, damping[1]])  # alpha, beta, gamma, delta
    multiplied = 0.5 * (inertial[3] - inertial[4]) / pace
    elastic_terms = np.array([inertial[2] + damping[2], multiplied])  # of gamma and delta
    values = rigid_terms.sum(axis=1)
    values[2:] += elastic_terms.sum(axis=1)
    rate = float(np.abs(motion.v[1] / robot.column_scale).max())
    sizes = np.maximum(bounds_of_terms(branch, crossing, rate), np.abs(rigid_terms).sum(axis=1))
    sizes[2:] += np.abs(elastic_terms).sum(axis=1)
    # what stiff springs add is little, and yet no rounding where s" has an effect
    if deflection is None or not abs(values[0]) > NO_HOLD * sizes[0]:
        values = remove_rounding(values, sizes, 0)
    return Condition8(*map(float, values))


def _unit_motions(
    branch: Branch,
    crossing: CrossingPoint,
    linearised: LinearisedLoops,
    deflection: Deflection | None,
    pace: float,
) -> Motion:
    """Compute five motions that separate the terms of condition (8).

    They are: s" = 1; s' = 1; that of the deflections with s' = 0, with pace and with -pace.
    """
    robot = branch.robot
    elastic = np.zeros((2, 5, robot.n_e))  # rates and accelerations
    if deflection is not None:
        elastic[0, 2:] = deflection.rate
        elastic[1, 2] = deflection.acceleration
    speeds, accelerations = np.array([0.0, 1.0, 0.0, pace, -pace]), np.eye(5)[0]
    x, dx, ddx = time_derivatives(branch.path, [np.full(5, crossing.s), speeds, accelerations])
    stack = linearised.select(np.zeros(5, dtype=np.intp))
    return motion_at(robot, ClosedStack(stack.frames.q, x, stack), dx, ddx, *elastic)


def remove_rounding(values: Array, sizes: Array, alpha: int) -> Array:
    """Set coefficients (k,) that are rounding of their terms to zero.

    Where s" has no effect, no motion can make up for the others: more of them counts as rounding.

    Args:
        sizes: (k,) of the terms.
        alpha: index of the coefficient of s".
    """
    rounding = CONDITION_ROUNDING if abs(values[alpha]) > NO_HOLD * sizes[alpha] else NO_HOLD
    return np.where(np.abs(values) > rounding * sizes, values, 0.0)


def bounds_of_terms(branch: Branch, crossing: CrossingPoint, rate: float) -> Array:
    """Bound the sizes (4,) of the terms of alpha, beta, gamma and delta.

    Joint forces do not show the terms that cancelled before: on massless legs, all forces of a payload across
    t_s. So the mass of all bodies is taken to move as the platform does and, for beta, as joints of the
    robot's length do at their largest `rate` [1/s, over s'].
    """
    robot = branch.robot
    units = coordinate_sizes(robot)  # (n,) [m]
    tangent = float(np.abs(robot.platform.path_twist(branch.path, crossing.s) * units).max())
    escape = float(np.abs(crossing.twist * units).max())
    weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
    for wrench in branch.wrenches.entries:
        force, moment = np.linalg.norm(wrench(np.array([crossing.s])).reshape(2, 3), axis=1)
        weight += float(force + moment / robot.length)
    alpha, beta = robot.mass * tangent, robot.mass * robot.length * rate**2
    return escape * np.array([alpha, beta, weight, 0.0])


def _equal_pace(branch: Branch, crossing: CrossingPoint, linearised: LinearisedLoops, rate: Array) -> float:
    """Compute the s' at which path and deflections move joints equally fast.

    It is 1 where either is at rest. The deflections have rates (n_e,).
    """
    robot = branch.robot
    scale = robot.column_scale
    twist = robot.platform.path_twist(branch.path, crossing.s)
    tangent = joint_rates(robot, linearised, twist[None], np.zeros((1, robot.n_e)))  # dq/ds
    path_rate = float(np.abs(tangent / scale).max())
    elastic_rate = float(np.abs(rate / scale[robot.elastic]).max())
    if path_rate == 0.0 or elastic_rate == 0.0:
        return 1.0
    return elastic_rate / path_rate
