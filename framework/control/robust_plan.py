"""A plan with a margin on its limits, with which a stated spread of robots passes, `plan_robustly`.

A law at the torque limits leaves nothing to a controller. A margin on the limits leaves it some, and costs
time or torque. A margin is searched by doubling and bisection: a smaller one may do where a larger one
fails, and is not found then. A plan counts as robust if lqg is
predicted to keep the tolerance within the torque limits, and then passes in trials (`SensorTrial.is_enough`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.control.prediction import LoopPrediction
from framework.control.sensors import ControlLoop
from framework.control.study import SensorTrial, StudySetup
from framework.control.variations import Spread
from framework.dynamics.motor_limits import motor_limits
from framework.errors import NoAnswer
from framework.planning.result import CrossingPlan
from framework.tolerances import LARGEST_MARGIN, MARGIN_STEP

TRIED = "lqg with {0.sensors} passes with {0.passed} of {0.runs} robots"


class RobustPlan(NamedTuple):
    """A plan that lqg keeps with robots of a spread."""

    plan: CrossingPlan
    margin: float  # share of the limits left to feedback
    prediction: LoopPrediction
    trial: SensorTrial  # which is enough
    unguarded: CrossingPlan  # without margin: what robustness costs


def plan_robustly(
    make_plan: Callable[[float], CrossingPlan],
    spread: Spread,
    *,
    loop: ControlLoop | None = None,
    period: float = 1e-3,
    seed: int = 0,
) -> RobustPlan:
    """Find a plan of small margin with which robots of a spread pass under lqg.

    Args:
        make_plan: returns the plan for a margin on the limits; without limits it is asked for margin 0 alone.
        spread: of the robots about the model.
        loop: sensors, known delay and tolerance, by default encoders on the motors; limits are the plan's.
        period: sampling period [s].
        seed: of the robots that try the plan.

    Raises:
        NoAnswer: no margin helps, or none with which there is a plan.
    """
    loop = loop or ControlLoop()
    unguarded = make_plan(0.0)
    reasons: list[str] = []

    def judge(plan: CrossingPlan, margin: float) -> RobustPlan | None:
        """Return the plan if it is robust; else keep the reason."""
        setup = StudySetup(plan, period, loop, spread, seed)
        prediction = setup.linear_models.tune_lqg(loop)[1]
        if not prediction.is_within(loop.tolerance):
            reasons.append(prediction.sentence)
            return None
        trial = setup.try_sensors([prediction])[-1]
        if not trial.is_enough:
            reasons.append(TRIED.format(trial))
            return None
        return RobustPlan(plan, margin, prediction, trial, unguarded)

    best = judge(unguarded, 0.0)
    if best is not None:
        return best
    if np.isinf(motor_limits(unguarded.robot, "torque_limit", unguarded.request.torque_limit)).all():
        raise NoAnswer(f"robust: {reasons[-1]}; without torque limits a margin does not help")
    low, high = 0.0, 2 * MARGIN_STEP
    while best is None and high <= LARGEST_MARGIN:
        try:
            best = judge(make_plan(high), high)
        except NoAnswer as refusal:
            with_margin = f"with a margin of {high:.1%} {refusal.sentence}"
            raise NoAnswer(f"robust: {reasons[-1]}, and {with_margin}") from None
        if best is None:
            low, high = high, 2 * high
    if best is None:
        raise NoAnswer(f"robust: not with margins up to {low:.1%}: {reasons[-1]}")
    while high - low > MARGIN_STEP:
        middle = (low + high) / 2
        better = judge(make_plan(middle), middle)
        low, high, best = (middle, high, best) if better is None else (low, middle, better)
    return best
