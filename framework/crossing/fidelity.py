"""Which model of a robot is enough for a motion: each rung of the ladder judged against the highest.

A rung plans the motion with what it knows. Its torques then drive the forward simulation of the highest
model that the robot's file can express, from rest at the start of the path, and nothing corrects them on
the way. The rung is enough if the platform stays by its plan, within the tolerance of the path's length,
and the torques by those of the highest rung, within the tolerance of their peak. Comparing neighbours would
not do: where legs have no mass two rungs agree exactly, and say nothing of the springs above them.

What the torques of too low a rung do near a singularity is part of the answer. They act there on a robot
that cannot resist a force along t_s: whatever of t_s . W_p they leave pushes the platform off its path, as
far as the simulation says.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.crossing.foretold import Foretold, foretell
from framework.crossing.plan import plan_request
from framework.crossing.request import SMOOTHNESS, Request
from framework.crossing.result import CrossingPlan
from framework.crossing.rung_judge import Judge, Judged, model_of
from framework.crossing.scenes import scene_request
from framework.errors import InvalidInput, NoAnswer, choose_from
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.description import FLEXIBILITIES, RobotDescription
from framework.model.rungs import LADDER, RUNGS
from framework.motion.law import is_number
from framework.motion.path import Path

LEAST_TOLERANCE = 1e-8  # torques are planned to 1e-10, and said to be the same when they agree to 1e-9
ROUNDING = 1e-12  # of the path or the peak


@dataclass(frozen=True, eq=False)
class FidelityStudy(ReadOnlyArrays):
    """The rungs judged for one motion; `highest` is the plan of the highest."""

    tolerance: float
    highest: CrossingPlan
    length: float  # of the path, turns multiplied by the robot's length [m]
    times: Array  # (T,) [s] of the rungs' errors
    rungs: tuple[Judged, ...]  # as in `LADDER`
    foretold: Foretold
    simulating: float  # seconds of all that simulations took
    seconds: float

    @property
    def robot(self) -> ParallelRobot:
        """The highest model."""
        return self.highest.robot

    def is_enough(self, judged: Judged) -> bool:
        """Whether a rung keeps torque and platform within the tolerance."""
        return max(judged.torque, judged.platform) <= self.tolerance

    @cached_property
    def enough(self) -> Judged | None:
        """The least rung that is enough; None if none is, not even the highest."""
        return next((judged for judged in self.rungs if self.is_enough(judged)), None)

    @cached_property
    def foretold_rung(self) -> Judged:
        """What the indicators alone would choose; of rungs with the same torques the lowest."""
        judged = {judged.rung.name: judged for judged in self.rungs}
        chosen = judged[self.foretold.chosen(self.tolerance)]
        return judged[chosen.same_as] if chosen.same_as else chosen

    def law_difference(self, judged: Judged) -> float:
        """How far the law of a rung is from the highest one's, in s; infinite without a plan."""
        if judged.plan is None:
            return np.inf
        laws = [plan.law(np.minimum(self.times, plan.duration)) for plan in (judged.plan, self.highest)]
        return float(np.abs(laws[0] - laws[1]).max())

    def place(self, errors: Array) -> float | None:
        """Where on the path (s) errors (T,) are largest; None where there are none beyond rounding."""
        known = np.nan_to_num(errors)
        if known.max() <= ROUNDING:
            return None
        return float(self.highest.law(self.times[np.argmax(known)]))

    @property
    def kept(self) -> dict[str, Any] | None:
        """What a scene of the robot file keeps of this study, its `fidelity`; None if no rung is enough."""
        found = self.enough
        return None if found is None else {"rung": found.rung.name, "tolerance": self.tolerance}

    @property
    def refusal(self) -> NoAnswer | None:
        """Why no model is accurate enough; None if one is."""
        if self.enough is not None:
            return None
        top = self.rungs[-1]
        how = top.reason or f"leave the path by {100 * top.platform:.2g} % of its length"
        return NoAnswer(
            f"{self.robot.name}: no model is accurate to {100 * self.tolerance:g} %: in the full elastic "
            f"simulation even the torques of the most detailed one, {top.rung.name}, {how}; without "
            f"feedback, errors of rounding and integration grow along this motion"
        )

    def to_dict(self) -> dict[str, Any]:
        """The numbers, for JSON."""
        return {
            "robot": self.robot.name,
            "tolerance": self.tolerance,
            "duration": self.highest.duration,
            "path_length": self.length,
            "peak_torque": self.highest.peak_torque,
            "crossings": [{"s": at.s, "time": at.time} for at in self.highest.crossings],
            "enough": None if self.enough is None else self.enough.rung.name,
            "foretold": self.foretold_rung.rung.name,
            "growth": _finite(self.foretold.growth),
            "rungs": [self._entry(judged) for judged in self.rungs],
            "simulating": self.simulating,
            "seconds": self.seconds,
        }

    def _entry(self, judged: Judged) -> dict[str, Any]:
        name, spring = judged.rung.name, judged.deflection
        return {
            "rung": name,
            "models": judged.rung.summary,
            "enough": self.is_enough(judged),
            "same_as": judged.same_as or None,
            "reason": judged.reason or None,
            "seconds": None if judged.plan is None else judged.plan.seconds,
            "torque": _finite(judged.torque),
            "torque_at": self.place(judged.torque_error),
            "platform": _finite(judged.platform),
            "platform_at": self.place(judged.platform_error),
            "deflection": None if spring is None else {"spring": spring[0], "largest": spring[1]},
            "law": _finite(self.law_difference(judged)),
            "foretold": _finite(self.foretold.error[name]),
            "indicator": self.foretold.words[name],
        }


def fidelity_study(
    robot: ParallelRobot,
    path: Path | str,
    *,
    tolerance: float = 0.01,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> FidelityStudy:
    """The least model of a robot that is enough for a motion, with its evidence.

    Args:
        robot: with whatever springs; the rungs are made from its description.
        path: to follow, or the name of a scene.
        tolerance: share of the path's length, and of the peak torque, that a rung may be off.
        progress: called with the number of rungs that are done.
        options: of `plan_crossing`, but no geometry, for each rung has its own. The smoothness is by default
            that of the highest for all rungs.

    Raises:
        InvalidInput: an option that cannot be right, or a robot that cannot be simulated.
        NoAnswer: the highest rung has no plan, or its simulation does not come to the end: nothing to judge
            by.
    """
    expect_robot(robot)
    if not (is_number(tolerance) and LEAST_TOLERANCE <= tolerance < 1):
        raise InvalidInput(f"tolerance: needs a share in [{LEAST_TOLERANCE:g}, 1), got {tolerance!r}")
    if options.get("geometry") is not None:
        raise InvalidInput("geometry: each rung of the ladder has its own; leave it out")
    began = time.perf_counter()
    top = model_of(robot.description, LADDER[-1])
    asked = scene_request(top, path, **options) if isinstance(path, str) else Request.of(top, path, **options)
    judge = Judge.of(plan_request(top, asked), tolerance)
    rungs: list[Judged] = []
    for rung in LADDER:
        rungs.append(judge.judged(rung, rungs))
        if progress is not None:
            progress(len(rungs))
    plans = {judged.rung.name: judged.plan for judged in rungs}
    return FidelityStudy(
        tolerance=tolerance,
        highest=judge.highest,
        length=judge.length,
        times=judge.times,
        rungs=tuple(rungs),
        foretold=foretell(plans, judge.highest, judge.length),
        simulating=judge.seconds,
        seconds=time.perf_counter() - began,
    )


def kept_options(description: RobotDescription, scene: str) -> dict[str, Any]:
    """What plans a scene with the rung that it keeps: flexibility, geometry, and the smoothness of the study.

    Rungs below `rigid` are planned with all bodies: leaving them out saves nothing.

    Raises:
        InvalidInput: no such scene, or it keeps no rung.
    """
    if scene not in description.scenes:
        raise InvalidInput(f"{description.name}: {choose_from('scene', scene, description.scenes)}")
    kept = description.scenes[scene].fidelity
    if kept is None:
        raise InvalidInput(
            f"flexibility auto: scene {scene} of {description.name} keeps no rung that was found enough; run "
            f"`crossing fidelity` on it, and put the line that it prints into the scene"
        )
    rung = RUNGS[kept.rung]
    flexibility = description.least_flexibility(rung.flexibility)
    elastic = bool(description.active_springs(FLEXIBILITIES[-1]))
    return {
        "flexibility": flexibility,
        "geometry": "rigid" if flexibility == FLEXIBILITIES[0] else rung.geometry,
        "smoothness": SMOOTHNESS[elastic],
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
