"""Optimal laws of several requests on one path, and what they say against each other.

Every law is a counterexample to a worse one, and to a refusal, of any request whose constraints it keeps.
Values are measured anew on samples of the torques, and torques are held against the equations of motion in
all coordinates.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from framework import CrossingPlan, NoAnswer, ParallelRobot, plan_crossing
from framework.laws.path import Path
from tests.oracles.equations_of_motion import defects_of

SAMPLES = 8001  # of a motion
BEATEN = 1.01  # a law of more than this times the cost of another contradicts it
ROUNDING = 1e-6  # of durations; of torques, which are sampled here, and there bounded between nodes


@dataclass(frozen=True)
class Asked:
    """What an optimal law is asked for; limits [N m] of every motor or of each, durations [s].

    ends: s', s" at start and goal; laws are compared at the same ends alone.
    times: instants of the crossings.
    """

    goal: str
    duration: float | None = None
    longest: float | None = None
    torque_limit: float | tuple[float, ...] | None = None
    label: str = ""
    ends: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    times: tuple[float, ...] = ()

    def options(self) -> dict[str, Any]:
        """The options of `plan_crossing`."""
        bounds = {"duration": self.duration, "longest": self.longest}
        options = {name: value for name, value in bounds.items() if value is not None}
        if self.torque_limit is not None:
            limit = self.torque_limit
            options["torque_limit"] = list(limit) if isinstance(limit, tuple) else limit
        for name, derivatives in zip(("start_speed", "end_speed"), self.ends, strict=True):
            if derivatives:
                options[name] = derivatives
        if self.times:
            options["times"] = list(self.times)
        return {"law": "optimal", "optimize": self.goal, **options}

    def __str__(self) -> str:
        options = self.options()
        del options["law"]
        return self.label or ", ".join(f"{name}={value!r}" for name, value in options.items())


@dataclass(frozen=True)
class Answer:
    """A law, or a refusal, with its measures; times in [s]."""

    asked: Asked
    plan: CrossingPlan | None = None
    refusal: NoAnswer | None = None
    failure: Exception | None = None  # no answer at all: a defect
    duration: float = np.nan
    peaks: np.ndarray = field(default_factory=lambda: np.empty(0))  # (n_a,) [N m]
    energy: float = np.nan  # integral of the sum of torque^2

    @property
    def peak(self) -> float:
        """The largest torque [N m]."""
        return float(self.peaks.max(initial=0.0))

    @property
    def value(self) -> float:
        """What the goal counts."""
        return self.cost(self.asked)

    def cost(self, asked: Asked) -> float:
        """What the goal of a request counts of this law: [s], [N m] or of its limit, [N^2 m^2 s]."""
        return {"time": self.duration, "peak_torque": self.peak, "energy": self.energy}[asked.goal]

    def keeps(self, asked: Asked) -> bool:
        """Whether the law is within the constraints of a request."""
        if self.plan is None or self.asked.ends != asked.ends:
            return False
        if asked.duration is not None and abs(self.duration / asked.duration - 1.0) > ROUNDING:
            return False
        if asked.times and not np.allclose(
            [crossing.time for crossing in self.plan.crossings], asked.times, rtol=ROUNDING, atol=0.0
        ):
            return False
        if asked.longest is not None and self.duration > asked.longest * (1.0 + ROUNDING):
            return False
        return asked.torque_limit is None or bool(np.all(self.peaks <= asked.torque_limit))


def answer(robot: ParallelRobot, path: Path, asked: Asked, **options: Any) -> Answer:
    """Plan, and measure the law."""
    try:
        plan = plan_crossing(robot, path, **asked.options(), **options)
    except NoAnswer as refusal:
        return Answer(asked, refusal=refusal)
    except Exception as failure:  # noqa: BLE001 - every one is a finding, and the others are to be asked still
        return Answer(asked, failure=failure)
    t = np.linspace(0.0, plan.duration, SAMPLES)
    torque = plan.torque(t)
    return Answer(
        asked,
        plan,
        duration=plan.duration,
        peaks=np.abs(torque).max(axis=0),
        energy=float(np.trapezoid((torque**2).sum(axis=1), t)),
    )


def contradictions(answers: Iterable[Answer]) -> list[str]:
    """Return what is wrong with each answer, and what the laws say against each other."""
    answers = list(answers)
    found = [f"{one.asked}: {fault}" for one in answers for fault in faults(one)]
    for one in answers:
        laws = [other for other in answers if other is not one and other.keeps(one.asked)]
        if not laws or one.failure is not None:
            continue
        best = min(laws, key=lambda law: law.cost(one.asked))
        cost = best.cost(one.asked)
        if one.refusal is not None:
            found.append(f"{one.asked}: refused, but [{best.asked}] is within it, {cost:.6g}: {one.refusal}")
        elif one.value > BEATEN * cost:
            excess = 100 * (one.value / cost - 1)
            found.append(f"{one.asked}: {one.value:.6g}, {excess:.2g} % above [{best.asked}], {cost:.6g}")
    return found


def faults(one: Answer) -> list[str]:
    """Return how an answer contradicts its own request, the equations of motion, or its certificate."""
    if one.failure is not None:
        return [f"{type(one.failure).__name__}: {one.failure}"]
    if one.plan is None:
        return []
    found = []
    if not one.keeps(one.asked):
        found.append(f"its own law takes {one.duration:.9g} s, peaks {one.peaks} N m")
    at_ends = [[one.plan.law(t, order) for order in (1, 2)] for t in (0.0, one.plan.duration)]
    stated = [[*end, 0.0, 0.0][:2] for end in one.asked.ends]
    if not np.allclose(at_ends, stated, rtol=ROUNDING, atol=ROUNDING / one.plan.duration**2):
        found.append(f"s' and s\" are {at_ends} at its ends")
    if not one.plan.certificate.monotone:
        found.append("not monotone")
    defect = defects_of(one.plan)
    if max(defect.open / max(one.plan.robot.length, 1.0), defect.acceleration, defect.force) > 1e-8:
        found.append(f"equations of motion: {defect}")
    return found
