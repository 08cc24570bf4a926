"""A certified motion under an optimal law, and its cost by the goal of its task."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.result import InverseDynamics
from framework.laws.optimal_law import OptimalLaw
from framework.planning.optimal.best_law import Best
from framework.planning.optimal.optimal_task import Task
from framework.planning.request import motor_peaks, share_within

ENERGY_SAMPLES = 2001  # instants, for the integral of squared torques by the trapezoidal rule


class OptimalMotion(NamedTuple):
    """A certified motion, its law, and the optimum from which the law was made."""

    dynamics: InverseDynamics
    law: OptimalLaw
    best: Best

    def cost(self, goal: str) -> float:
        """Return the duration [s], the peak torque over the reference, or the energy [s].

        The energy is the integral of (torque / reference)^2, summed over the motors.
        """
        reference = self.best.reference
        if goal == "time":
            return self.dynamics.duration
        if goal == "peak_torque":
            return float((motor_peaks(self.dynamics)[0] / reference).max())
        t = np.linspace(0.0, self.dynamics.duration, ENERGY_SAMPLES)
        return float(np.trapezoid(((self.dynamics.torque(t) / reference) ** 2).sum(axis=1), t))

    def describe_cost(self, goal: str) -> str:
        """Describe the cost, such as `0.231 s`."""
        if goal == "peak_torque":
            peaks = motor_peaks(self.dynamics)[0]
            unit = self.dynamics.robot.torque_units[int(peaks.argmax())]
            return f"peak torque {peaks.max():.4g} {unit}"
        cost = f"{self.cost(goal):.4g} s"
        return cost if goal == "time" else f"energy {cost}"


def certify_motion(
    task: Task, law: OptimalLaw, best: Best, known: KnownDeflections | None = None
) -> OptimalMotion:
    """Compute and certify the motion of a law along the path of a task.

    Args:
        best: the optimum from which the law was made.
        known: deflections in balance; None to solve for the deflections.

    Raises:
        NoAnswer: as `inverse_dynamics`.
    """
    dynamics = resolve(task.to_cross.searched, lambda _: law, **task.request.model_options, known=known)
    return OptimalMotion(share_within(dynamics, task.specification, optimal=True), law, best)
