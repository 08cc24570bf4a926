"""The grounds of refusals: proofs (`NoLaw.proof`), or numbers of a search (`NoLaw.evidence`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from framework.errors import format_distinct, round_up
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.planning.specification import Specification
from framework.tolerances import LIMIT_MARGIN

# of limits over the least peak: nearer ones leave little room for a smooth law
RAISED_RATIO = 1.0 + 10.0 * LIMIT_MARGIN


class UnmetCondition(NamedTuple):
    """Condition (8) at s that no motion can meet.

    It is alpha s" + beta s'^2 + gamma = 0. `stop`: the path ends at s, with s' = s" = 0, and gamma is not
    zero. Else alpha is zero, and no s'^2 > 0 makes beta s'^2 + gamma vanish.
    """

    s: float
    alpha: float
    beta: float
    gamma: float
    stop: bool


class StaticFold(NamedTuple):
    """Deflections at rest at an end s of the path end in a fold as the springs get softer.

    compliance: of the softest springs that reach, over that of the robot's.
    """

    s: float
    compliance: float


class LeastLimits(NamedTuple):
    """Limits (n_a,) within which a law was found, over the limits given.

    torque_peak: the least peak of torque found in the duration asked, over the torque limits and within the
        speed limits; None where no law was found, or without a torque limit.
    speed_peak: the same of speed, within the torque limits.
    torque, speed: limits a little above these peaks, motor side; None as the peaks.
    together: neither is enough alone, and the peaks are those of one law, with the larger of torque and
        squared speed least.
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
        """Return the least limits for peaks over the limits of a specification."""
        return LeastLimits(
            torque,
            speed,
            None if torque is None else RAISED_RATIO * torque * specification.torque_limit,
            None if speed is None else RAISED_RATIO * speed * specification.speed_limit,
            together,
        )

    @property
    def options(self) -> list[dict[str, Array]]:
        """The limits to raise, as options without margin.

        They are alternatives, or all needed together.
        """
        limits = {"torque_limit": self.torque, "speed_limit": self.speed}
        options = {name: limit for name, limit in limits.items() if limit is not None}
        return [options] if self.together else [{name: limit} for name, limit in options.items()]


def advice_of(robot: ParallelRobot, limits: dict[str, Array]) -> str:
    """Return limits (n_a,) of torque and speed that suffice, in words."""
    units = {"torque_limit": robot.torque_units, "speed_limit": robot.speed_units}
    words = (f"{name} {_format_limits(robot, limit, units[name])}" for name, limit in limits.items())
    return f"{' with '.join(words)} would do"


def _format_limits(robot: ParallelRobot, limits: Array, units: Sequence[str]) -> str:
    """Return limits rounded up to four digits: one for all motors, or by joint."""
    rounded = [f"{round_up(limit, 4):.4g}" for limit in limits]
    if len(set(rounded)) == 1 and len(set(units)) == 1:
        return f"{rounded[0]} {units[0]}"
    return " ".join(
        f"{joint}={number}"
        for joint, number in zip(robot.actuator_names, rounded, strict=True)
        if number != "inf"
    )


class HoldingTorque(NamedTuple):
    """A holding torque above a motor's limit at an end of the path.

    The motor is at `joint`, the end at s. torque, limit: motor side [N m], or [N] of a motor that slides.
    """

    joint: str
    s: float
    torque: float
    limit: float


def _ratio_text(ratio: float | None) -> str:
    """Return a ratio with enough digits to differ from 1; empty without one."""
    return "" if ratio is None else format_distinct(ratio, 1.0)[0]


class SearchEvidence(NamedTuple):
    """Numbers of a search without a law; no proof that none exists.

    cells: number of intervals of the piecewise polynomial that the squared speed was sought as.
    least: the limits within which a law was found, in the duration asked.
    quickest: the least duration [s] found within the limits; None where none was found.
    limits: options with raised limits within which a law was planned, or None.
    """

    cells: int
    least: LeastLimits
    quickest: float | None = None
    limits: dict[str, Array] | None = None

    @property
    def sentence(self) -> str:
        """The numbers of the search, in words."""
        parts = []
        peaks = {"torque": self.least.torque_peak, "speed": self.least.speed_peak}
        if self.least.together:
            parts.append(
                f"torques {_ratio_text(self.least.torque_peak)} and speeds "
                f"{_ratio_text(self.least.speed_peak)} times the limits were needed together"
            )
            peaks = {}
        for quantity, peak in peaks.items():
            if peak is not None:
                parts.append(f"the least peak of {quantity} found is {_ratio_text(peak)} times the limits")
                if peak <= 1.0:
                    parts[-1] += f", of which a search leaves {LIMIT_MARGIN:.2%}"
        if self.quickest is not None:
            parts.append(f"within the limits the quickest law found takes {self.quickest:.4g} s")
        return "; ".join([*parts, f"searched on {self.cells} cells"])
