"""Condition (8) of the undeformed robot at a singular point, and its consequences for every law.

In alpha s" + beta s'^2 + gamma + delta s' = 0 each term is a power in the uncontrolled motion, which locked
motors do not prevent; t_s is the platform's twist in this motion, and W_p the wrench that the motion requires
on the platform. s' and s" are derivatives of the path coordinate s over time. alpha is due to the
acceleration s", beta to the curvature of the path and to joint rates, gamma to weight, joint springs and
external wrenches, and delta to viscous damping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.singularity_crossings import check_kind
from framework.errors import NoLaw, NotConverged
from framework.kinematics.continuation.tracking import Branch
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.numerics.arrays import Array
from framework.planning.condition import coefficients_at
from framework.planning.crossing_points import PathToCross
from framework.planning.request import Request, specification_of
from framework.singularity.points_on_path import Condition8, SearchedPath, SingularPoint
from framework.tolerances import RANK_ROUNDING


@dataclass(frozen=True)
class Feasibility:
    """Condition (8) of the undeformed robot at a singular point, and how t_s lies to weight and path.

    It is t_s . W_p = 0 with the platform's twist t_s in the uncontrolled motion, and the wrench W_p that the
    motion along the path requires.

    s: path coordinate of the singular point.
    condition: coefficients of t_s . W_p = alpha s" + beta s'^2 + gamma + delta s'.
    weight_share: |cos| of the angle between gravity and the velocity of the centre of mass in the
        uncontrolled motion; on massless legs, the share of the weight along t_s.
    tangent_share: |cos| of the angle between the path's tangent and t_s. Rotations are multiplied by the
        robot's length.
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
        """The coefficients (a, b, c) of the required s" = a + b s'^2 + c s'.

        Units are a [1/s^2], b [-] and c [1/s]. None where s" has no effect.
        """
        if self.orthogonal:
            return None
        alpha, beta, gamma, delta = self.condition
        return 0.0 - gamma / alpha, 0.0 - beta / alpha, 0.0 - delta / alpha  # 0.0 - 0.0 is not -0.0

    @property
    def weightless(self) -> bool:
        """Whether the condition contains neither weight nor external wrenches.

        Without damping, such a condition is independent of the duration.
        """
        return self.condition.gamma == 0.0

    @property
    def steady_speed(self) -> float | None:
        """The least s' > 0 [1/s] that meets condition (8) at s" = 0, or None.

        It is a root of beta s'^2 + delta s' + gamma.
        """
        _alpha, beta, gamma, delta = self.condition
        discriminant = delta**2 - 4.0 * beta * gamma
        if discriminant < 0.0:
            return None
        # the larger root times beta, without cancellation; the product of both roots is gamma / beta
        scaled_root = -0.5 * (delta + math.copysign(math.sqrt(discriminant), delta))
        roots = [a / b for a, b in ((scaled_root, beta), (gamma, scaled_root)) if b != 0.0]
        return min((root for root in roots if 0.0 < root < math.inf), default=None)

    @property
    def pace(self) -> float | None:
        """The duration [s] of the whole path, from or to rest, at the constant s" required at s' = 0.

        It is (2 / |s"|)^(1/2), from 1 = |s"| t^2 / 2. None where s" has no effect, or without weight.
        """
        if self.acceleration is None or self.weightless:
            return None
        required, _, _ = self.acceleration  # s" at s' = 0
        return float(np.sqrt(2.0 / abs(required)))

    @property
    def _rest(self) -> str:
        """The end of the path at rest, in words: "to rest" if the s" required at s' = 0 brakes."""
        return "from rest" if self.acceleration is None or self.acceleration[0] > 0.0 else "to rest"

    @property
    def forbids_every_law(self) -> bool:
        """Whether no acceleration and no speed meets the condition."""
        return self.orthogonal and not self.condition.holds_anyway and self.steady_speed is None

    @property
    def sentence(self) -> str:
        """The condition, the required s", and the consequences for path and speed, in one line of text."""
        alpha, beta, gamma, delta = self.condition
        damping = f", delta = {delta:.6g}" if delta else ""
        clauses = "; ".join([self._demand_text(), *self._consequence_texts()])
        return (
            f"condition (8) at s = {self.s:.6g} has alpha = {alpha:.6g}, beta = {beta:.6g}, "
            f"gamma = {gamma:.6g}{damping}, with "
            f"{100 * self.weight_share:.3g} % of the weight and {100 * self.tangent_share:.3g} % of the "
            f"path's tangent along t_s: {clauses}"
        )

    @property
    def short_sentence(self) -> str:
        """The acceleration that the condition requires, in one clause."""
        weight = "" if self.wrenches else f", with {100 * self.weight_share:.3g} % of the weight along t_s"
        # weight sets a pace that no choice of the duration changes
        pace = "" if self.pace is None else f", which covers the path {self._rest} in {self.pace:.3g} s"
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
        """Return the consequences for speed, duration and path, as clauses."""
        large_curvature = 4.0  # of |s"| / s'^2; polynomial laws reach no larger values
        if self.acceleration is None:
            return []
        _constant, curvature, _damping = self.acceleration  # curvature: s" over s'^2
        clauses = []
        forces, s = ("weight and wrenches", "") if self.wrenches else ("weight", "s")
        if self.steady_speed is not None:
            clauses.append(f"s' = {self.steady_speed:.4g} 1/s needs no s\"")
        if self.pace is not None:
            clauses.append(f"the {forces} set{s} the pace, {self.pace:.3g} s for the whole path {self._rest}")
        elif self.condition.delta:
            clauses.append(f"no {forces} enter{s}, but damping does: the slower, the more it counts")
        else:
            clauses.append(f"no {forces} enter{s}, so a law that meets it may be stretched to any duration")
        if abs(curvature) > large_curvature:
            clauses.append(
                f"s' changes e-fold over {1 / abs(curvature):.2g} of the path there: make it smoother "
                f"(straighter), or nearer to t_s"
            )
        return clauses


def feasibility_at(branch: Branch, singular: SingularPoint) -> Feasibility | None:
    """Compute condition (8) at a singular point, and the directions of weight and path along t_s.

    The result has two cosines that explain the coefficients: `weight_share`, between gravity and the velocity
    of the centre of mass in the uncontrolled motion, and `tangent_share`, between the path's tangent and t_s.

    The result is None where several motions are uncontrolled, so that one condition is not enough, and where
    the singularity is not of Type 2, so that the condition does not apply.
    """
    if singular.corank > 1:
        return None
    try:
        check_kind(branch.robot, singular)
    except NoLaw:
        return None
    robot = branch.robot
    condition = coefficients_at(branch, singular, deflection=None)
    centre_jacobian = pin.jacobianCenterOfMass(robot.model, robot.model.createData(), singular.q)
    centre_velocity = centre_jacobian @ singular.motion  # (3,) in the uncontrolled motion
    tangent = robot.platform.path_twist(branch.path, singular.s)
    return Feasibility(
        singular.s,
        condition,
        # lengths over the robot's length, as `_cosine` compares the second vector with rounding
        weight_share=_cosine(robot.model.gravity.linear, centre_velocity / robot.length),
        tangent_share=_cosine(tangent / robot.platform_scale, singular.twist / robot.platform_scale),
        wrenches=bool(branch.wrenches.entries),
    )


def feasibility_on_path(searched: SearchedPath) -> tuple[Feasibility | None, ...]:
    """Compute condition (8), t_s . W_p = 0, at each singular point of a path, as `feasibility_at` does."""
    return tuple(feasibility_at(searched.branch, singular) for singular in searched.points)


def _cosine(a: Array, b: Array) -> float:
    """Compute |cos| of the angle between vectors a and b; 0 if either vanishes.

    b is part of a motion of unit size, so it vanishes where it is no larger than rounding.
    """
    norm_a, norm_b = np.linalg.norm(a), np.linalg.norm(b)
    if norm_a == 0.0 or norm_b <= RANK_ROUNDING:
        return 0.0
    return float(abs(a @ b) / (norm_a * norm_b))


def is_crossable(searched: SearchedPath) -> bool:
    """Return whether condition (8), t_s . W_p = 0, admits a law at each singular point of a path.

    It admits none where several motions are uncontrolled or the singularity is not of Type 2 (both without a
    feasibility), where the path touches the locus or ends on it, and where no speed or acceleration meets it.
    """
    return not any(
        feasibility is None
        or singular.contact == "tangential"
        or singular.is_at_path_end
        or feasibility.forbids_every_law
        for singular, feasibility in zip(searched.points, feasibility_on_path(searched), strict=True)
    )


class OptimalDurations(NamedTuple):
    """The least duration [s] found of a law of free shape within the limits.

    shortest: 0 without limits, since condition (8) concerns speed and acceleration at the crossing alone;
        None if no law was found.
    refusal: the reason why no law was found.

    There is never a longest duration. The squared speeds z of all laws that meet condition (8) and the limits
    form a convex set, and near an end of the path, where a smooth law needs little more than the torques of
    the weight, z may be scaled by a factor as small as desired.
    """

    shortest: float | None
    refusal: str = ""

    @property
    def sentence(self) -> str:
        """The durations, in one line."""
        if self.shortest is None:
            return f"within the limits no law of free shape was found ({self.refusal})"
        if self.shortest == 0.0:  # there are no limits
            return "without limits a law of free shape can be as quick or as slow as you like"
        return (
            f"within the limits the quickest law of free shape found takes {self.shortest:.4g} s; none is "
            f"the slowest"
        )


def optimal_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """Find the least duration [s] of a law of free shape through all singular points.

    The springs are at rest. Limits and smoothness are those of the request; its durations and its crossings
    are left open.

    Args:
        searched: the path with its singular points.

    Returns:
        None if no law can cross, or if the request asks for more smoothness than laws of free shape have. A
        duration of 0 without limits. No duration, but the reason, if the search finds no law.
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
        return OptimalDurations(None, refusal.sentence)
    return OptimalDurations(best.law.duration)
