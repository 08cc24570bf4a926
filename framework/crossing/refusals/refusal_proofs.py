"""What refusals rest on: proofs (`NoLaw.proof`), or what a search found instead (`NoLaw.evidence`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.specification import Specification
from framework.errors import told_apart
from framework.kinematics.parallel_robot import ParallelRobot
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
    """Limits (n_a,) within which a law was found, in proportion to those that were asked for.

    torque_peak, speed_peak: the least peaks of torque and of speed found, over their limits, in the duration
        asked, each within the limits of the other; None where none was found or that has no limit.
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

    @property
    def options(self) -> list[dict[str, Array]]:
        """The limits that may be raised, as options of a plan, without the margin that it leaves free."""
        raised = {"torque_limit": self.torque, "speed_limit": self.speed}
        given = {name: limit for name, limit in raised.items() if limit is not None}
        return [given] if self.together else [{name: limit} for name, limit in given.items()]


def advice_of(robot: ParallelRobot, limits: dict[str, Array]) -> str:
    """Return in words the limits (n_a,) of torque and speed that would do."""
    units = {"torque_limit": robot.torque_units, "speed_limit": robot.speed_units}
    named = (f"{name} {_listed(robot, limit, units[name])}" for name, limit in limits.items())
    return f"{' with '.join(named)} would do"


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


def _ratio_text(ratio: float | None) -> str:
    return "" if ratio is None else told_apart(ratio, 1.0)[0]


@dataclass(frozen=True, eq=False)
class SearchEvidence:
    """What a search found in place of a law within the limits: no proof that there is none.

    cells: of the squared speed, on which it was searched.
    least: the limits within which a law was found, in the duration asked.
    quickest: the least duration [s] found within the limits; None where none was found.
    limits: options with raised limits that were planned, or None.
    """

    cells: int
    least: LeastLimits
    quickest: float | None = None
    limits: dict[str, Array] | None = None

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        parts = []
        peaks = {"torque": self.least.torque_peak, "speed": self.least.speed_peak}
        if self.least.together:
            parts.append(
                f"torques {_ratio_text(self.least.torque_peak)} and speeds "
                f"{_ratio_text(self.least.speed_peak)} times the limits were needed together"
            )
            peaks = {}
        parts += [
            f"the least peak of {what} found is {_ratio_text(peak)} times the limits"
            + (f", of which a search leaves {LIMIT_MARGIN:.2%}" if peak <= 1.0 else "")
            for what, peak in peaks.items()
            if peak is not None
        ]
        if self.quickest is not None:
            parts.append(f"within the limits the quickest law found takes {self.quickest:.4g} s")
        return "; ".join([*parts, f"searched on {self.cells} cells"])
