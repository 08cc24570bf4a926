"""Proofs of refusals, in numbers that anyone can check: `NoLaw.proof`."""

from __future__ import annotations

from dataclasses import dataclass

from framework.motion.infeasibility import Infeasible


@dataclass(frozen=True)
class UnmetCondition:
    """Condition (8) at path coordinate s, alpha s" + beta s'^2 + gamma = 0, which nothing there meets.

    `stop`: the path ends there, with s' = s" = 0, and gamma is not zero. Else alpha is zero, and no
    s'^2 > 0 makes beta s'^2 + gamma vanish.
    """

    s: float
    alpha: float
    beta: float
    gamma: float
    stop: bool


@dataclass(frozen=True)
class HoldingTorque:
    """The motor at `joint` must hold more than its limit at rest, at the end s = 0 or 1 of the path.

    torque, limit: motor side [N m], or [N] of a motor that slides.
    """

    joint: str
    s: float
    torque: float
    limit: float


@dataclass(frozen=True, eq=False)
class NoAdmissibleSpeed:
    """A proof by Farkas' lemma that no squared speed of this degree keeps all limits.

    A thousandth of the limits is kept free, and a hundredth of the squared mean speed is never fallen below
    where that was looked at (`LIMIT_MARGIN` and `MIN_SQUARED_SPEED_RATIO` of `speed_program`).

    least_peak: the least peak of torque, over its limit, of a law in the duration asked; None
        where none was found or asked for, or no motor has a limit of torque.
    least_duration: the least duration [s] of one within the limits; None where none was found.
    infeasible: the cone program, and the combination of its rows that contradicts itself.
    """

    degree: int
    least_peak: float | None
    least_duration: float | None
    infeasible: Infeasible

    @property
    def contradiction(self) -> tuple[float, float]:
        """The residual of A' q = 0 (rounding), and b' q (well below zero), of the combination q."""
        return self.infeasible.contradiction

    @property
    def sentence(self) -> str:
        """The least peak and the least duration that are possible, in words."""
        parts = []
        if self.least_peak is not None:
            parts.append(f"the least peak of torque is {self.least_peak:.4g} times the limits")
        if self.least_duration is not None:
            parts.append(f"within the limits the quickest law takes {self.least_duration:.4g} s")
        elif self.least_peak is not None:
            parts.append("within the limits none of any duration was found")
        return "; ".join(parts)
