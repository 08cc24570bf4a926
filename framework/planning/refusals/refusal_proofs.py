"""The grounds of refusals: proofs (`NoLaw.proof`), or numbers of a search (`NoLaw.evidence`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from framework.errors import format_distinct, round_up
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.planning.specification import Specification
from framework.tolerances import LIMIT_MARGIN

# Ratio of advised limits to the least peak found. Limits nearer to that peak hardly admit a smooth law.
RAISED_RATIO = 1.0 + 10.0 * LIMIT_MARGIN


class UnmetCondition(NamedTuple):
    """A condition (8) alpha s" + beta s'^2 + gamma = 0 at s that no motion can meet.

    stop: whether the path starts or ends at s, where s' = s" = 0 and gamma is not zero. Otherwise alpha is
        zero, and beta s'^2 + gamma vanishes for no s'^2 > 0.
    """

    s: float
    alpha: float
    beta: float
    gamma: float
    stop: bool


class StaticFold(NamedTuple):
    """A fold of the static equilibria at an end s of the path, met as the springs get softer.

    compliance: compliance of the softest springs with an equilibrium, divided by that of the robot's springs.
    """

    s: float
    compliance: float


class LeastLimits(NamedTuple):
    """The least limits of torque or speed within which a law was found.

    torque_peak: the least peak of torque found in the requested duration and within the speed limits, over
        the torque limits; None if no law was found, or without a torque limit.
    speed_peak: the least peak of speed found in the requested duration and within the torque limits, over the
        speed limits; None as above.
    together: whether limits of torque and of speed must both be raised. Both peaks are then of one law, for
        which the larger of the torque ratio and the squared speed ratio is least.
    options: limits (n_a,) a little above these peaks, motor side, as options of a plan without margin;
        several entries are alternatives.
    """

    torque_peak: float | None
    speed_peak: float | None
    together: bool
    options: list[dict[str, Array]]

    @staticmethod
    def of(
        specification: Specification, torque: float | None, speed: float | None, *, together: bool
    ) -> LeastLimits:
        """Return the least limits for the ratios of peak torque and speed to a specification's limits."""
        limits = {}
        if torque is not None:
            limits["torque_limit"] = RAISED_RATIO * torque * specification.torque_limit
        if speed is not None:
            limits["speed_limit"] = RAISED_RATIO * speed * specification.speed_limit
        options = [limits] if together else [{name: limit} for name, limit in limits.items()]
        return LeastLimits(torque, speed, together, options)


def advice_of(robot: ParallelRobot, limits: dict[str, Array]) -> str:
    """Return the advice to raise limits (n_a,) of torque and speed, in words."""
    units = {"torque_limit": robot.torque_units, "speed_limit": robot.speed_units}
    words = (f"{name} {_format_limits(robot, limit, units[name])}" for name, limit in limits.items())
    return f"{' with '.join(words)} would do"


def _format_limits(robot: ParallelRobot, limits: Array, units: Sequence[str]) -> str:
    """Return limits (n_a,) rounded up to four digits: one for all motors, or by joint."""
    rounded = [f"{round_up(limit, 4):.4g}" for limit in limits]
    if len(set(rounded)) == 1 and len(set(units)) == 1:
        return f"{rounded[0]} {units[0]}"
    by_joint = zip(robot.actuator_names, rounded, strict=True)
    return " ".join(f"{joint}={number}" for joint, number in by_joint if number != "inf")


class HoldingTorque(NamedTuple):
    """A motor torque that holds the robot at an end s of the path, above the limit.

    joint: name of the motor's joint.
    torque, limit: motor side [N m], or [N] for a sliding motor.
    """

    joint: str
    s: float
    torque: float
    limit: float


def _ratio_text(ratio: float | None) -> str:
    """Return a ratio with enough digits to differ from 1; empty for None."""
    return "" if ratio is None else format_distinct(ratio, 1.0)[0]


class SearchEvidence(NamedTuple):
    """The numbers of a search that found no law; no proof that none exists.

    cells: number of intervals of the piecewise polynomial that represents the squared speed.
    least: the least limits within which a law of the requested duration was found.
    quickest: the least duration [s] found within the limits; None without a law.
    limits: options with raised limits for which a plan was found; None without a plan.
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
