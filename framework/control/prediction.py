"""Predicted deviations of a closed loop by sensors, without runs, and the least sensors that pass.

    predictions = predict_by_sensors(reference, ControlLoop(delay=1e-3, counts=8192), Spread(payload=0.1))

The prediction is linear: it knows payload, friction, springs, the known delay, and the steps and noise of
sensors. It does not know places of joints, unknown delays, limits of torques, and errors so large that the
dynamics are no longer those about the plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from framework.control.by_name import Tuning
from framework.control.controllers import Controller, FeedforwardPD, motor_gains
from framework.control.deviation import Feedback, Observer, closed_loop_deviation
from framework.control.linear_model import LinearModel, linearise_plan
from framework.control.reference import Reference
from framework.control.regulators import (
    Regulator,
    Weights,
    disturbances_of,
    prior_deviations,
    tune_lqg,
)
from framework.control.sensors import ControlLoop, sensors_of
from framework.control.variations import Spread
from framework.errors import InvalidInput
from framework.tolerances import MAX_PREDICTED_SHARE

# sets of sensors, the least first: encoders on motors, behind drives, on passive joints, cameras
SENSOR_SETS = ("motors", "motors links", "motors elbows", "motors links elbows", "motors platform")


@dataclass(frozen=True)
class Prediction:
    """Largest standard deviations along the plan, of one controller with its sensors."""

    controller: str
    sensors: str
    platform: float  # [robot lengths, rad] of the platform from the plan; infinite if the loop diverges
    torque: float  # of a motor's torque from the planned one, share of its planned peak

    def is_within(self, tolerance: float) -> bool:
        """Return whether runs are expected to keep a tolerance [robot lengths, rad]."""
        return self.platform <= MAX_PREDICTED_SHARE * tolerance


def predict(
    name: str,
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    model: LinearModel | None = None,
) -> Prediction | None:
    """Predict the deviations of a controller; None for one that is not linear, or does not see all.

    Args:
        name: name of the controller.
        controller: lqg, lqr with the whole state, or feedforward without integral.
        loop: the loop in which it works.
        spread: of robots about the model.
        model: linear model with the disturbances of the spread, if there is one.
    """
    reference = controller.reference
    if isinstance(controller, FeedforwardPD) and not controller.integral:
        model = model or linearise_plan(reference, disturbances_of(spread))
        gain = motor_gains(reference, model, controller.feedback)
        feedback = Feedback(gain, loop.delayed_periods(reference.period), None, predicts=False)
    elif isinstance(controller, Regulator) and controller.filter is not None:
        model = controller.model
        observer = Observer(controller.filter.C, controller.filter.gain, controller.filter.deviation)
        feedback = Feedback(controller.gain, controller.delay, observer, predicts=True)
    elif isinstance(controller, Regulator) and sensors_of(reference.robot, loop).state:
        model = model or linearise_plan(reference, disturbances_of(spread))
        count, n_a, states = controller.gain.shape
        gain = np.zeros((count, n_a, model.A.shape[1]))  # disturbances are neither measured nor estimated
        gain[:, :, :states] = controller.gain
        # the state without disturbances: an observer that takes it from exact readings
        C = np.broadcast_to(np.eye(states, model.A.shape[1]), (count, states, model.A.shape[1]))
        observer = Observer(C, C.swapaxes(1, 2), np.zeros(states))
        feedback = Feedback(gain, controller.delay, observer, predicts=True)
    else:
        return None
    start = prior_deviations(reference, model, spread)
    start[: 2 * model.m] = 0.0  # robots start on the plan
    deviation = closed_loop_deviation(model, feedback, start)
    platform = deviation.z[:, : reference.robot.n] / reference.robot.platform_scale
    peak = np.abs(reference.torque).max(axis=0)
    return Prediction(name, loop.sensors, float(platform.max()), float((deviation.torque / peak).max()))


def predict_by_sensors(
    reference: Reference,
    loop: ControlLoop,
    spread: Spread,
    *,
    tuning: Tuning | None = None,
    sets: Sequence[str] = SENSOR_SETS,
) -> list[Prediction]:
    """Predict the deviations of lqg for each set of sensors that the robot can have.

    Args:
        reference: plan at the sampling instants.
        loop: known delay and steps of encoders; its sensors do not count.
        spread: of robots about the model.
        tuning: what a designer chooses of lqg.
        sets: sets of sensors; those that read the same as an earlier one are left out.

    Raises:
        InvalidInput: a motion of the platform moves no mass.
    """
    tuning = tuning or Tuning()
    estimates = disturbances_of(spread) if tuning.estimates is None else tuning.estimates
    kinds = tuple(dict.fromkeys([*disturbances_of(spread), *estimates]))
    model = linearise_plan(reference, kinds)
    weights = Weights(torque=tuning.torque_share)
    predictions: list[Prediction] = []
    seen: list[np.ndarray] = []
    for sensors in sets:
        one = replace(loop, sensors=sensors)
        try:
            rows = sensors_of(reference.robot, one)
        except InvalidInput:  # no elbows
            continue
        S = np.unique(rows.joints.S, axis=0)
        if not rows.platform and any(np.array_equal(S, other) for other in seen):
            continue  # links of rigid robots are their motors
        seen.append(S)
        controller = tune_lqg(
            reference, loop=one, spread=spread, estimates=estimates, weights=weights, model=model
        )
        prediction = predict("lqg", controller, one, spread)
        if prediction is not None:
            predictions.append(prediction)
    return predictions


def suggest_sensors(predictions: Sequence[Prediction], tolerance: float) -> Prediction | None:
    """Return the first prediction that keeps the tolerance [robot lengths, rad]; None if none does."""
    return next((one for one in predictions if one.is_within(tolerance)), None)
