"""Condition (8) of the undeformed robot at a singular point, before any law is sought.

In alpha s" + beta s'^2 + gamma + delta s' = 0 each term is a power in the uncontrolled motion: alpha is due
to the acceleration s", beta to the curvature of path and joints, gamma to weight, joint springs and external
wrenches, and delta to viscous damping.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.singularity_crossings import check_kind
from framework.errors import NoLaw, NotConverged
from framework.kinematics.continuation.tracking import Branch
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.numerics.arrays import Array
from framework.planning.condition import Condition8, coefficients_at, undeformed_crossing
from framework.planning.crossing_points import PathToCross, stops_at
from framework.planning.motion_scales import coordinate_sizes
from framework.planning.request import Request
from framework.planning.specification import specification_of
from framework.singularity.points_on_path import SearchedPath, SingularPoint

LARGE_CURVATURE = 4.0  # |s"| / s'^2: the largest that polynomial laws reach
VECTOR_ROUNDING = 1e-12  # norm of a motion in robot lengths and radians, of unit size unless it is zero


@dataclass(frozen=True)
class Feasibility:
    """Condition (8) of the undeformed robot at a singular point, and its geometric causes.

    weight_share: |cos| of the angle between gravity and the velocity of the centre of mass in the
        uncontrolled motion; on massless legs, the share of the weight along t_s.
    tangent_share: |cos| of the angle between the path's tangent and t_s, turns multiplied by the robot's
        length.
    wrenches: whether external wrenches act along the path.
    """

    s: float
    condition: Condition8
    weight_share: float
    tangent_share: float
    wrenches: bool = False

    @property
    def orthogonal(self) -> bool:
        """Whether s" has no effect on t_s . W_p."""
        return self.condition.alpha == 0.0

    @property
    def acceleration(self) -> tuple[float, float, float] | None:
        """The coefficients of the required s" = a + b s'^2 + c s'; None where s" has no effect.

        They are a [1/s^2], b [-] and c [1/s].
        """
        alpha, beta, gamma, delta = self.condition
        return None if self.orthogonal else (0.0 - gamma / alpha, 0.0 - beta / alpha, 0.0 - delta / alpha)

    @property
    def weightless(self) -> bool:
        """Whether neither weight nor a wrench enters the condition.

        Without damping, such a condition is independent of the duration.
        """
        return self.condition.gamma == 0.0

    @property
    def steady_speed(self) -> float | None:
        """The least s' > 0 [1/s] that meets condition (8) at s" = 0, or None."""
        _, beta, gamma, delta = self.condition
        if beta == 0.0:
            roots = [-gamma / delta] if delta else []
        else:
            discriminant = delta**2 - 4.0 * beta * gamma
            signs = (-1, 1) if discriminant > 0 else ()
            roots = [(-delta + sign * np.sqrt(discriminant)) / (2.0 * beta) for sign in signs]
        return min((root for root in roots if root > 0), default=None)

    @property
    def pace(self) -> float | None:
        """The time (2 / |s"|)^(1/2) [s] in which the s" required by weight covers the path from rest.

        None where s" has no effect, or without weight.
        """
        if self.acceleration is None or self.weightless:
            return None
        return float(np.sqrt(2.0 / abs(self.acceleration[0])))

    @property
    def forbids_every_law(self) -> bool:
        """Whether no acceleration and no speed meets the condition."""
        return self.orthogonal and not self.condition.holds_anyway and self.steady_speed is None

    @property
    def sentence(self) -> str:
        """The condition, the required s", and the consequences for path and speed, in one line."""
        alpha, beta, gamma, delta = self.condition
        damping = f", delta = {delta:.6g}" if delta else ""
        return (
            f"condition (8) at s = {self.s:.6g} has alpha = {alpha:.6g}, beta = {beta:.6g}, "
            f"gamma = {gamma:.6g}{damping}, with "
            f"{100 * self.weight_share:.3g} % of the weight and {100 * self.tangent_share:.3g} % of the "
            f"path's tangent along t_s: {'; '.join([self._demand_text(), *self._consequence_texts()])}"
        )

    @property
    def short_sentence(self) -> str:
        """The acceleration that the condition requires, in one clause."""
        weight = "" if self.wrenches else f", with {100 * self.weight_share:.3g} % of the weight along t_s"
        pace = "" if self.pace is None else f", the pace of {self.pace:.3g} s for the path at any duration"
        return f"condition (8) at s = {self.s:.6g}{weight}: {self._demand_text()}{pace}"

    def _demand_text(self) -> str:
        """Return the required s" in words."""
        if self.condition.holds_anyway:
            return "it holds whatever s' and s\" are"
        if self.acceleration is None:
            only = (
                "no law meets it" if self.steady_speed is None else f"only s' = {self.steady_speed:.4g} does"
            )
            return f's" has no effect, {only}; turn the path towards t_s'
        constant, *rates = self.acceleration
        demand = f's" = {constant:.6g}'
        for coefficient, variable in zip(rates, ("s'^2", "s'"), strict=True):
            if coefficient:
                demand += f" {'-' if coefficient < 0 else '+'} {abs(coefficient):.6g} {variable}"
        return demand

    def _consequence_texts(self) -> list[str]:
        """Return the consequences of the condition for speed, pace and path, as clauses."""
        if self.acceleration is None:
            return []
        clauses = []
        forces, s = ("weight and wrenches", "") if self.wrenches else ("weight", "s")
        if self.steady_speed is not None:
            clauses.append(f"s' = {self.steady_speed:.4g} 1/s needs no s\"")
        if self.pace is not None:
            clauses.append(f"the {forces} set{s} the pace, {self.pace:.3g} s for the whole path from rest")
        elif self.condition.delta:
            clauses.append(f"no {forces} enter{s}, but damping does: the slower, the more it counts")
        else:
            clauses.append(f"no {forces} enter{s}, so what it asks for looks alike at all durations")
        curvature = abs(self.acceleration[1])  # |s"| over s'^2
        if curvature > LARGE_CURVATURE:
            clauses.append(
                f"s' changes e-fold over {1 / curvature:.2g} of the path there: make it smoother "
                f"(straighter), or nearer to t_s"
            )
        return clauses


def feasibility_at(branch: Branch, singular: SingularPoint) -> Feasibility | None:
    """Compute condition (8) at a singular point.

    None where one condition is not enough, or is of no use: several motions escape, or the singularity is not
    of Type 2.
    """
    if singular.corank > 1:
        return None
    try:
        check_kind(branch.robot, singular)
    except NoLaw:
        return None
    robot = branch.robot
    crossing = undeformed_crossing(singular)
    condition = coefficients_at(branch, crossing, deflection=None)
    centre_jacobian = pin.jacobianCenterOfMass(robot.model, robot.model.createData(), crossing.q)
    centre_velocity = centre_jacobian @ crossing.motion
    size, tangent = coordinate_sizes(robot), robot.platform.path_twist(branch.path, crossing.s)
    return Feasibility(
        crossing.s,
        condition,
        weight_share=_cosine(robot.model.gravity.linear, centre_velocity / robot.length),
        tangent_share=_cosine(tangent * size, crossing.twist * size),
        wrenches=bool(branch.wrenches.entries),
    )


def feasibility_on_path(searched: SearchedPath) -> tuple[Feasibility | None, ...]:
    """Compute condition (8) at each singular point of a path, as `feasibility_at` does."""
    return tuple(feasibility_at(searched.branch, singular) for singular in searched.points)


def _cosine(a: Array, b: Array) -> float:
    """Compute |cos| of the angle between two vectors; 0 if a is zero or b is rounding."""
    norm_a, norm_b = np.linalg.norm(a), np.linalg.norm(b)
    if norm_a == 0.0 or norm_b <= VECTOR_ROUNDING:
        return 0.0
    return float(abs(a @ b) / (norm_a * norm_b))


def is_crossable(searched: SearchedPath) -> bool:
    """Return whether condition (8) admits a law at each singular point of a path."""
    return not any(
        feasibility is None
        or singular.contact == "tangential"
        or stops_at(singular)
        or feasibility.forbids_every_law
        for singular, feasibility in zip(searched.points, feasibility_on_path(searched), strict=True)
    )


class OptimalDurations(NamedTuple):
    """The least duration [s] found of a law of free shape within the limits.

    It is 0 without limits, and None with a `refusal` if no law was found. There is never a longest duration:
    the squared speeds z of the laws of free shape that meet condition (8) and the limits are a convex set.
    Near an end of the path a smooth law needs little more than the torques of the weight, and z may be scaled
    by a factor close to zero there. Without limits there is no shortest duration either, since condition (8)
    concerns z and z' at the crossing alone.
    """

    shortest: float | None
    refusal: str = ""

    @property
    def sentence(self) -> str:
        """The durations, in one line."""
        if self.shortest is None:
            return f"within the limits no law of free shape was found ({self.refusal})"
        if not self.shortest:
            return "without limits laws of free shape have no shortest duration and no longest"
        return (
            f"within the limits the quickest law of free shape found takes {self.shortest:.4g} s; none is "
            f"the slowest"
        )


def optimal_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """Compute the durations of laws of free shape through all singular points.

    The springs are at rest; the limits and the smoothness are those of the request. None if no law can cross,
    or if a law of free shape cannot have that smoothness.
    """
    from framework.planning.optimal.optimal_task import Task  # slow to import, and seldom needed
    from framework.planning.optimal.undeformed_law import find_undeformed_law

    if request.smoothness > HIGHEST_SMOOTHNESS or not is_crossable(searched):
        return None
    robot = searched.branch.robot
    specification = replace(specification_of(robot, request), goal="time", duration=None, longest=None)
    if not (specification.limited or specification.limited_speeds):
        return OptimalDurations(0.0)
    to_cross = PathToCross(searched, searched.points)
    open_request = replace(request, times=None, speeds=None, at=None)
    try:
        best = find_undeformed_law(Task(to_cross, open_request, specification))
    except (NoLaw, NotConverged) as refusal:
        return OptimalDurations(None, str(refusal))
    return OptimalDurations(best.law.duration)
