"""Predicted deviations of a closed loop by sensors, without runs, and the least sensors that pass.

    predictions = predict_by_sensors(reference, ControlLoop(delay=1e-3, counts=8192), Spread(payload=0.1))

The prediction is linear: it knows payload, friction, springs, the known delay, and the steps and noise of
sensors. It does not know places of joints, unknown delays, limits of torques, and errors so large that the
dynamics are no longer those about the plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from framework.control.controllers import Controller, FeedforwardPD, motor_gains
from framework.control.deviation import Feedback, Observer, closed_loop_deviation
from framework.control.linear_model import LinearModel, linearise_plan
from framework.control.reference import Reference
from framework.control.regulators import (
    UNIFORM,
    Regulator,
    Tuning,
    Weights,
    disturbances_of,
    prior_deviations,
    tune_lqg,
)
from framework.control.sensors import ControlLoop, sensors_of
from framework.control.variations import Spread
from framework.errors import InvalidInput
from framework.numerics.arrays import Array
from framework.tolerances import MAX_PREDICTED_SHARE

# of lqg, tried in turn: factors on the noise that the filter expects of its model, and on the torque share
CAUTIONS = ((1.0, 1.0), (3.0, 1.0), (3.0, 0.33), (10.0, 0.33))
LEAST_ROOM = 0.05  # share of the peak torque
# sets of sensors, the least first: encoders on motors, behind drives, on passive joints, cameras
SENSOR_SETS = (
    "motors",
    "motors links",
    "motors elbows",
    "motors links elbows",
    "motors platform",
    "motors links elbows platform",
)


@dataclass(frozen=True)
class LoopPrediction:
    """Largest standard deviations along the plan, of one controller with its sensors."""

    controller: str
    sensors: str
    platform: float  # [robot lengths, rad] of the platform from the plan; infinite if the loop diverges
    torque: float  # of a motor's torque from the planned one, share of its planned peak

    def is_within(self, tolerance: float) -> bool:
        """Return whether runs are expected to keep a tolerance [robot lengths, rad]."""
        return self.platform <= MAX_PREDICTED_SHARE * tolerance


def predict(name: str, controller: Controller, loop: ControlLoop, spread: Spread) -> LoopPrediction | None:
    """Predict the deviations of a controller; None unless linear, with the whole state.

    Args:
        name: name of the controller.
        controller: lqg, lqr with the whole state, or feedforward without integral.
        loop: the loop in which it works.
        spread: of robots about the model.
    """
    is_feedforward = isinstance(controller, FeedforwardPD) and not controller.integral
    sees_all = isinstance(controller, Regulator) and (
        controller.filter is not None or sensors_of(controller.reference.robot, loop).state
    )
    if not (is_feedforward or sees_all):
        return None
    models = LinearModels.of(controller.reference, spread, Tuning())
    if isinstance(controller, Regulator):
        if controller.filter is not None:  # its model may have more disturbances
            model = controller.model
            models = models._replace(model=model, others=varied_models(controller.reference, model, spread))
        return replace(_predict_regulator(controller, loop, models), controller=name)
    assert isinstance(controller, FeedforwardPD)
    gain = motor_gains(controller.reference, models.model, controller.feedback)
    delay = loop.delayed_periods(controller.reference.period)
    return _predict_feedback(name, Feedback(gain, delay, None, predicts=False), loop, models)


def _predict_regulator(controller: Regulator, loop: ControlLoop, models: LinearModels) -> LoopPrediction:
    """Predict the deviations of lqg, or of lqr that measures the whole state."""
    gain = controller.gain
    if controller.filter is not None:
        observer = Observer(controller.filter.C, controller.filter.gain, controller.filter.deviation)
    else:
        # disturbances are neither measured nor estimated: exact readings of the other states
        count, n_a, states = gain.shape
        N = models.model.A.shape[1]
        gain = np.concatenate([gain, np.zeros((count, n_a, N - states))], axis=2)
        C = np.broadcast_to(np.eye(states, N), (count, states, N))
        observer = Observer(C, C.swapaxes(1, 2), np.zeros(states))
    return _predict_feedback("lqg", Feedback(gain, controller.delay, observer, predicts=True), loop, models)


def _predict_feedback(
    name: str, feedback: Feedback, loop: ControlLoop, models: LinearModels
) -> LoopPrediction:
    """Predict the deviations of a feedback on the model and on robots with other springs."""
    reference, model = models.reference, models.model
    start = prior_deviations(reference, model, models.spread)
    start[: 2 * model.m] = 0.0  # robots start on the plan
    peak = np.abs(reference.torque).max(axis=0)
    platform, torque = 0.0, 0.0
    for true in (model, *models.others):
        deviation = closed_loop_deviation(model, feedback, start, true=true)
        x = deviation.z[:, : reference.robot.n] / reference.robot.platform_scale
        platform = max(platform, float(x.max()))
        torque = max(torque, float((deviation.torque / peak).max()))
    return LoopPrediction(name, loop.sensors, platform, torque)


class LinearModels(NamedTuple):
    """The linear models about one plan, for all sensors and weights of lqg."""

    reference: Reference
    spread: Spread
    tuning: Tuning
    model: LinearModel
    others: list[LinearModel]  # of robots with softer and stiffer springs

    @staticmethod
    def of(reference: Reference, spread: Spread, tuning: Tuning) -> LinearModels:
        """Compute the models.

        Raises:
            InvalidInput: a motion of the platform moves no mass.
        """
        kinds = tuple(dict.fromkeys([*disturbances_of(spread), *(tuning.estimates or ())]))
        model = linearise_plan(reference, kinds)
        return LinearModels(reference, spread, tuning, model, varied_models(reference, model, spread))

    def tune_lqg(self, loop: ControlLoop) -> tuple[Regulator, LoopPrediction]:
        """Tune lqg for the sensors of the loop with the first of CAUTIONS predicted to pass.

        If none is, take the one with the least prediction over the allowed deviation.
        """
        reference, spread, tuning, model, others = self
        peak = np.abs(reference.torque).max(axis=0)
        limit = np.array(loop.limit) if loop.limit is not None else reference.torque_limit
        room = max(float((limit / peak).min()) - 1.0, LEAST_ROOM)  # share of the peak left to feedback
        best: tuple[float, Regulator, LoopPrediction] | None = None
        for noise, torque in CAUTIONS if others else CAUTIONS[:1]:
            weights = Weights(torque=torque * tuning.torque_share).with_noise(noise)
            controller = tune_lqg(
                reference, loop=loop, spread=spread, estimates=tuning.estimates, weights=weights, model=model
            )
            prediction = _predict_regulator(controller, loop, self)
            excess = max(
                prediction.platform / (MAX_PREDICTED_SHARE * loop.tolerance), prediction.torque / room
            )
            if best is None or excess < best[0]:
                best = excess, controller, prediction
            if excess <= 1:
                break
        assert best is not None
        return best[1:]


def varied_models(reference: Reference, model: LinearModel, spread: Spread) -> list[LinearModel]:
    """Return the linear models with all springs softer and stiffer by one standard deviation.

    A disturbance is a constant force; springs that differ also change the frequencies of vibrations, which
    may destabilise a controller that counts on them.
    """
    if not (reference.robot.n_e and spread.stiffness):
        return []
    factors = (1 - UNIFORM * spread.stiffness, 1 + UNIFORM * spread.stiffness)
    robots = [replace(reference.robot, stiffness=factor * reference.robot.stiffness) for factor in factors]
    return [linearise_plan(replace(reference, robot=robot), model.kinds, like=model) for robot in robots]


def predict_by_sensors(
    reference: Reference,
    loop: ControlLoop,
    spread: Spread,
    *,
    tuning: Tuning | None = None,
    sets: Sequence[str] = SENSOR_SETS,
) -> list[LoopPrediction]:
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
    models = LinearModels.of(reference, spread, tuning or Tuning())
    predictions: list[LoopPrediction] = []
    seen: list[Array] = []
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
        predictions.append(models.tune_lqg(one)[1])
    return predictions


def suggest_sensors(predictions: Sequence[LoopPrediction], tolerance: float) -> LoopPrediction | None:
    """Return the first prediction that keeps the tolerance [robot lengths, rad]; None if none does."""
    return next((one for one in predictions if one.is_within(tolerance)), None)
