"""What condition (8) asks of any law at a singular point, told before a law is sought.

alpha s" + beta s'^2 + gamma = 0 on the undeformed robot: gamma is what the weight (and springs of the robot
itself) do in the uncontrolled motion, beta what the bends of path and joints ask, alpha what s" can do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from framework.crossing.condition import NO_HOLD, Condition8, CrossingPoint, coefficients_at, crossing_point
from framework.dynamics.crossings import check_kind
from framework.errors import NoLaw
from framework.kinematics.tracking import Branch
from framework.singularity.points_on_path import SearchedPath, SingularPoint

BENT = 4.0  # |s"| over s'^2 from which the bends count: what a polynomial of that duration has at its most


@dataclass(frozen=True)
class Feasibility:
    """Condition (8) of the undeformed robot at the singular point `s`, and where it comes from.

    weight_share: |cos| of the angle between gravity and the motion of the centre of mass in the uncontrolled
    motion; on massless legs the share of the weight along t_s. tangent_share: |cos| of that between the
    path's tangent and t_s, turns multiplied by the robot's length.
    """

    s: float
    condition: Condition8
    weight_share: float
    tangent_share: float
    orthogonal: bool  # s" has no effect on t_s . W_p

    @property
    def constant(self) -> float:
        """The s" [1/s^2] asked for at s' -> 0; not a number where s" has no effect."""
        return np.nan if self.orthogonal else 0.0 - self.condition.gamma / self.condition.alpha

    @property
    def per_squared_speed(self) -> float:
        """What s'^2 adds to it, [-]; not a number where s" has no effect."""
        return np.nan if self.orthogonal else 0.0 - self.condition.beta / self.condition.alpha

    @property
    def weightless(self) -> bool:
        """Whether nothing but motion enters the condition, which then looks alike at all durations."""
        return abs(self.condition.gamma) <= NO_HOLD * self.condition.scale

    @property
    def steady_speed(self) -> float | None:
        """The s' [1/s] that meets the condition with s" = 0, if there is one."""
        product = self.condition.gamma * self.condition.beta
        if self.weightless or product >= 0 or abs(self.condition.beta) <= NO_HOLD * self.condition.scale:
            return None
        return float(np.sqrt(-self.condition.gamma / self.condition.beta))

    @property
    def pace(self) -> float | None:
        """The time [s] in which the s" that the weight asks for covers the whole path from rest."""
        if self.orthogonal or self.weightless or self.condition.holds_anyway:
            return None
        return float(np.sqrt(2.0 / abs(self.constant)))

    def to_dict(self) -> dict[str, Any]:
        """As `locate --json` has it; what does not exist is null."""
        return {
            "alpha": self.condition.alpha,
            "beta": self.condition.beta,
            "gamma": self.condition.gamma,
            "acceleration": None if self.orthogonal else [self.constant, self.per_squared_speed],
            "weight_share": self.weight_share,
            "tangent_share": self.tangent_share,
            "pace": self.pace,
        }

    @property
    def sentence(self) -> str:
        """The condition and which way to go, in one line."""
        alpha, beta, gamma = (self._cleared(value) for value in self.condition[:3])
        return (
            f"condition (8) at s = {self.s:.6g} has alpha = {alpha}, beta = {beta}, gamma = {gamma}, with "
            f"{100 * self.weight_share:.3g} % of the weight and {100 * self.tangent_share:.3g} % of the "
            f"path's tangent along t_s: {self._asks()}"
        )

    def _asks(self) -> str:
        if self.condition.holds_anyway:
            return "it holds whatever s' and s\" are"
        if self.orthogonal:
            only = (
                "no law meets it" if self.steady_speed is None else f"only s' = {self.steady_speed:.4g} does"
            )
            return f's" has no effect, {only}; turn the path towards t_s'
        beta = float(self._cleared(self.condition.beta))
        asked = f's" = {float(self._cleared(self.condition.gamma)) / -self.condition.alpha + 0.0:.6g}'
        if beta:
            asked += f" {'+-'[beta * self.condition.alpha > 0]} {abs(self.per_squared_speed):.6g} s'^2"
        return "; ".join([asked, *self._ways()])

    def _cleared(self, coefficient: float) -> str:
        """A coefficient as it is read; what is rounding against the others is 0."""
        return f"{0.0 if abs(coefficient) <= NO_HOLD * self.condition.scale else coefficient:.6g}"

    def _ways(self) -> list[str]:
        ways = []
        if self.steady_speed is not None:
            ways.append(f"s' = {self.steady_speed:.4g} 1/s needs no s\"")
        if self.pace is None:
            ways.append("no weight enters, so what it asks for looks alike at all durations")
        else:
            ways.append(f"the weight sets the pace, {self.pace:.3g} s for the whole path from rest")
        if abs(self.per_squared_speed) > BENT:
            ways.append(
                f"s' changes e-fold over {1 / abs(self.per_squared_speed):.2g} of the path there: make it "
                f"smoother (straighter), or nearer to t_s"
            )
        return ways


def feasibility_at(branch: Branch, at: SingularPoint) -> Feasibility | None:
    """What condition (8) asks for at a singular point; None if it is none that one condition lets pass."""
    if at.corank > 1:
        return None
    try:
        check_kind(branch.robot, at)
    except NoLaw:
        return None
    return _feasibility(branch, crossing_point(branch, at, None, at.s))


def feasibility_on_path(searched: SearchedPath) -> tuple[Feasibility | None, ...]:
    """The same for all singular points of a path."""
    return tuple(feasibility_at(searched.branch, at) for at in searched.points)


def _feasibility(branch: Branch, here: CrossingPoint) -> Feasibility:
    robot = branch.robot
    condition, own = coefficients_at(branch, here, None)
    data = robot.model.createData()
    falling = pin.jacobianCenterOfMass(robot.model, data, here.q) @ here.motion
    length = np.where(robot.translations, 1.0, robot.length)
    return Feasibility(
        here.s,
        condition,
        weight_share=_cosine(robot.model.gravity.linear, falling),
        tangent_share=_cosine(robot.platform.path_twist(branch.path, here.s) * length, here.twist * length),
        orthogonal=abs(condition.alpha) <= NO_HOLD * own,
    )


def _cosine(a: Any, b: Any) -> float:
    """|cos| of the angle between two vectors; 0 if one of them is zero or rounding."""
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return abs(float(np.dot(a, b))) / size if size > 1e-12 * float(np.linalg.norm(a)) else 0.0
