"""Condition (8) on a path: alpha s" + beta s'^2 + gamma + delta s' = 0 at the singular point.

t_s . W_p = motion . r with r the RNEA of the open tree and `motion` the joint rates that belong to t_s
(motors locked). On a path, r is affine in s" and quadratic in s', and its coefficients come out of four
evaluations of the inverse dynamics the robot already has (after toppra, which recovers its constraint
coefficients in the same way). delta appears only with deflections that are changing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.dynamics.forces import tree_forces
from framework.errors import NoLaw, NotConverged, point
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import ClosedStack, close_loops, motion_at, system_at
from framework.kinematics.loop_matrices import measured_matrix
from framework.kinematics.tracking import Branch
from framework.motion.path import along
from framework.singularity.classification import sign_along, uncontrolled_motion
from framework.singularity.points_on_path import SingularPoint
from framework.singularity.root_of_g import root_of_g

# |alpha| against the size of its own terms: below, s" has no hold on t_s . W_p beyond rounding
NO_HOLD = 1e-9


class Condition8(NamedTuple):
    """alpha s" + beta s'^2 + delta s' + gamma = t_s . W_p [N, or N m for a pure turn]."""

    alpha: float
    beta: float
    gamma: float
    delta: float
    scale: float  # what the coefficients would be if the terms of their sums did not cancel

    @property
    def holds_anyway(self) -> bool:
        """t_s . W_p is zero whatever s' and s" are: a straight path across t_s, without gravity along it."""
        return max(abs(value) for value in self[:4]) <= NO_HOLD * self.scale

    def acceleration(self, speed: float) -> float:
        """The s" [1/s^2] that makes t_s . W_p vanish at this s' [1/s]; 0 when any does."""
        if self.holds_anyway:
            return 0.0
        return -(self.beta * speed**2 + self.delta * speed + self.gamma) / self.alpha


class Deflection(NamedTuple):
    """Deflections and their time derivatives at one instant, each (n_e,)."""

    value: Array
    rate: Array
    acceleration: Array


class CrossingPoint(NamedTuple):
    """Where the (deflected) robot is singular on its path, and what holds there."""

    s: float
    kind: str
    twist: Array  # (n,)
    motion: Array  # (nv,)
    q: Array  # (nq,)
    corank: int = 1  # motions that escape at once; `motion` is one of them
    touches: bool = False  # the locus without crossing it


def crossing_point(
    branch: Branch, at: SingularPoint, deflection: Deflection | None, near: float
) -> CrossingPoint:
    """The singular point of the path; with a deflection, the one it has moved to,
    found from path coordinate `near`.

    Raises:
        NoLaw: the deflected robot has no singular point near.
    """
    if deflection is None or not len(deflection.value):
        touches = at.contact == "tangential"
        return CrossingPoint(at.s, at.kind, at.twist, at.motion, at.q, at.corank, touches)
    robot = branch.robot
    bent = np.zeros((1, robot.model.nv))
    bent[:, robot.elastic] = deflection.value
    before: tuple[Array, ClosedStack] | None = None

    def closed(s: Array) -> ClosedStack:
        """The robot on its path with the deflections, at s (T,); from its tangent where it was last."""
        if before is None:
            guess = integrate(robot, branch.guess(s), np.repeat(bent, len(s), axis=0))
        else:
            at, last = before
            tangent = difference(robot, last.q[0], last.q[2:]) / (at[2] - at[0])
            guess = integrate(robot, last.q[1], (s - at[1])[:, None] * tangent)
        return close_loops(robot, branch.path(s), guess)

    def passive(s: Array) -> Array:
        nonlocal before
        before = s, closed(s)
        return measured_matrix(robot, before[1].system)

    found = root_of_g(passive, near)
    if found.converged:
        return _oriented(branch, found.place, closed(np.array([found.place])))
    raise NoLaw(
        f"{robot.name}: the deflected robot has no singular point near s = {at.s:.6g}; the deflections "
        f"are too large for the path to cross the locus there"
    )


def imposed_point(branch: Branch, s: float) -> CrossingPoint:
    """A point of the path treated as singular whether it is or not, as rounded data would have it."""
    return _oriented(branch, s, branch.closed(s))


def _oriented(branch: Branch, s: float, closed: ClosedStack) -> CrossingPoint:
    """The uncontrolled motion there, its twist pointing along the path."""
    found = uncontrolled_motion(branch.robot, closed.system)
    sign = sign_along(found.twist, branch.robot.platform.path_twist(branch.path, s))
    return CrossingPoint(s, found.kind, sign * found.twist, sign * found.motion, closed.q[0])


def condition_at(branch: Branch, here: CrossingPoint, deflection: Deflection | None) -> Condition8:
    """Coefficients of condition (8) at a crossing point.

    Raises:
        NoLaw: the path's tangent leaves t_s . W_p untouched by s", so no law can meet the condition.
        NotConverged: the same, but only with these deflections.
    """
    return effective(branch, here, coefficients_at(branch, here, deflection), deflection)


def effective(
    branch: Branch, here: CrossingPoint, coefficients: tuple[Condition8, float], deflection: Deflection | None
) -> Condition8:
    """The condition of `coefficients_at`, if s" can meet it; raises as `condition_at`."""
    robot, (condition, own) = branch.robot, coefficients
    if condition.holds_anyway or abs(condition.alpha) > NO_HOLD * own:
        return condition
    where = f"{robot.name}: at s = {here.s:.6g}, {', '.join(robot.axis_names)} = {point(branch.path(here.s))}"
    if deflection is not None and robot.n_e:
        raise NotConverged(
            f'{where} s" has no effect on t_s . W_p once the robot deflects (alpha = '
            f"{condition.alpha:.2g}): with these deflections the path runs orthogonal to t_s; use stiffer "
            f"springs, geometry rigid, or another direction",
            residual=abs(condition.alpha) / own,
        )
    raise NoLaw(
        f"{where} the path runs orthogonal to t_s (alpha = "
        f'{condition.alpha:.2g}): s" has no effect on t_s . W_p there; cross in another direction'
    )


def coefficients_at(
    branch: Branch, here: CrossingPoint, deflection: Deflection | None
) -> tuple[Condition8, float]:
    """Coefficients of condition (8), and the size of the terms of alpha before they cancel."""
    robot = branch.robot
    speed, acceleration = np.array([0.0, 0.0, 1.0, -1.0]), np.array([0.0, 1.0, 0.0, 0.0])
    q = np.repeat(here.q[None], 4, axis=0)
    x = np.repeat(branch.path(here.s)[None], 4, axis=0)
    closed = ClosedStack(q, x, system_at(robot, q, x))
    _, dx, ddx = along(branch.path, [np.full(4, here.s), speed, acceleration])
    rates: tuple[Array, ...] = ()
    if deflection is not None and robot.n_e:
        rates = (np.tile(deflection.rate, (4, 1)), np.tile(deflection.acceleration, (4, 1)))
    forces = tree_forces(robot, motion_at(robot, closed, dx, ddx, *rates))
    rest, pushed, forth, back = forces @ here.motion
    alpha = pushed - rest
    # what s" = 1 asks for at most; on massless legs the forces of a payload cancel before they get here
    size = np.where(robot.translations, 1.0, robot.length)
    moved = np.abs(robot.platform.path_twist(branch.path, here.s)) * size
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    own = max(float(np.abs((forces[1] - forces[0]) * here.motion).sum()), mass * float(moved.max()))
    scale = max(float(np.abs(forces * here.motion).sum(axis=1).max()), own)
    condition = Condition8(
        alpha=float(alpha),
        beta=float(0.5 * (forth + back) - rest),
        gamma=float(rest),
        delta=float(0.5 * (forth - back)),
        scale=scale,
    )
    return condition, own
