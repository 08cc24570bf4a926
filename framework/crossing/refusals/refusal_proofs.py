"""Proofs of refusals, in numbers that anyone can check: `NoLaw.proof`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.specification import Specification
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.infeasibility import Infeasible
from framework.tolerances import LIMIT_MARGIN

RAISED_RATIO = 1.0 + 3.0 * LIMIT_MARGIN  # of limits over the least peak, for the margins that planning keeps


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


class LeastLimits(NamedTuple):
    """Limits (n_a,) with which a law of one degree exists, in proportion to those that were asked for.

    torque_peak, speed_peak: the least peaks of torque and of speed over their limits, in the duration asked,
        each within the limits of the other; None where that is none, not found, or has no limit. At most 1
        of those that need not be raised.
    torque, speed: those limits, motor side, the share included that planning leaves free; None as the peaks.
    together: neither is enough alone. Then the larger of torque and squared speed is least.
    """

    torque_peak: float | None
    speed_peak: float | None
    torque: Array | None
    speed: Array | None
    together: bool

    @staticmethod
    def of(
        specification: Specification, torque: float | None, speed: float | None, *, together: bool
    ) -> LeastLimits:
        """Return the limits for peaks over those of a specification."""

        def raised(peak: float | None, limit: Array) -> Array | None:
            return None if peak is None else RAISED_RATIO * peak * limit

        limits = raised(torque, specification.torque_limit), raised(speed, specification.speed_limit)
        return LeastLimits(torque, speed, *limits, together)

    def sentences(self, robot: ParallelRobot, margin: float) -> list[str]:
        """Return which limits would do, in words; `margin` is the share of them that is left free."""
        named = [
            f"{name} {_listed(robot, limit / (1.0 - margin), units)}"
            for name, limit, units in (
                ("torque_limit", self.torque, robot.torque_units),
                (
                    "speed_limit",
                    self.speed,
                    robot.speed_units,
                ),
            )
            if limit is not None
        ]
        joined = [" with ".join(named)] if self.together else named
        return [f"{' or '.join(joined)} would do"] if named else []


def _listed(robot: ParallelRobot, limits: Array, units: Sequence[str]) -> str:
    """Return limits rounded up to four digits: one of all motors, or by joint."""
    rounded = [_rounded_up(limit) for limit in limits]
    if len(set(rounded)) == 1 and len(set(units)) == 1:
        return f"{rounded[0]} {units[0]}"
    return " ".join(
        f"{joint}={number}"
        for joint, number in zip(robot.actuator_names, rounded, strict=True)
        if number != "inf"
    )


def _rounded_up(value: float) -> str:
    """Return a positive number as a text of four digits that is not below it."""
    if not np.isfinite(value):
        return "inf"
    unit = 10.0 ** (np.floor(np.log10(value)) - 3)
    return f"{np.ceil(value / unit) * unit:.4g}"


@dataclass(frozen=True)
class HoldingTorque:
    """The motor at `joint` must hold more than its limit at rest, at the end s = 0 or 1 of the path.

    torque, limit: motor side [N m], or [N] of a motor that slides.
    """

    joint: str
    s: float
    torque: float
    limit: float
    least: LeastLimits | None = None


@dataclass(frozen=True, eq=False)
class NoAdmissibleSpeed:
    """A proof by Farkas' lemma that no squared speed of this degree keeps all limits.

    A thousandth of the limits is kept free, and a hundredth of the squared mean speed is never fallen below
    where that was looked at (`LIMIT_MARGIN` and `MIN_SQUARED_SPEED_RATIO` of `speed_program`).

    least: the limits with which there is a law of this degree in the duration asked.
    least_duration: the least duration [s] of one within the limits; None where none was found.
    infeasible: the cone program, and the combination of its rows that contradicts itself.
    """

    degree: int
    least: LeastLimits
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
        peaks = {"torque": self.least.torque_peak, "speed": self.least.speed_peak}
        if self.least.together:
            parts.append(
                f"torques {self.least.torque_peak:.4g} and speeds {self.least.speed_peak:.4g} times the "
                f"limits are needed together"
            )
            peaks = {}
        stated = {what: peak for what, peak in peaks.items() if peak is not None}
        parts += [f"the least peak of {what} is {peak:.4g} times the limits" for what, peak in stated.items()]
        if self.least_duration is not None:
            parts.append(f"within the limits the quickest law takes {self.least_duration:.4g} s")
        elif stated:
            parts.append("within the limits none of any duration was found")
        return "; ".join(parts)
