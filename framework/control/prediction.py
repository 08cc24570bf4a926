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

from framework.control.closed_loop import MAX_DEVIATION, torque_range
from framework.control.controllers import Controller, FeedforwardPD, motor_gains
from framework.control.deviation import Feedback, Observer, Plant, closed_loop_deviation
from framework.control.linear_model import LinearModel, linearise_plan, linearise_variants
from framework.control.reference import Reference
from framework.control.regulators import (
    UNIFORM,
    Regulator,
    Tuning,
    Weights,
    disturbances_of,
    prior_deviations,
    reading_rows,
    regulator_gains,
    tune_lqg,
)
from framework.control.sensors import ControlLoop, sensors_of
from framework.control.variations import Spread
from framework.errors import InvalidInput
from framework.numerics.arrays import Array
from framework.tolerances import CAUTIONS, LEAST_ROOM, MAX_PREDICTED_SHARE

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
    load: float  # the same over what the torque limit leaves at that instant; above 1 torques are cut
    ends: float = 1.0  # share of the robots with springs at the ends of the spread that keep the tolerance

    def is_within(self, tolerance: float) -> bool:
        """Return whether runs are expected to keep a tolerance [robot lengths, rad] and the torque limits."""
        return self.platform <= MAX_PREDICTED_SHARE * tolerance and self.load <= 1


class LinearModels(NamedTuple):
    """The linear models about one plan, for all controllers, sensors and weights."""

    reference: Reference
    spread: Spread
    tuning: Tuning
    within: list[LinearModel]  # of the controller, and with springs softer and stiffer by a deviation
    ends: list[LinearModel]  # of robots with springs at the ends of the spread
    gains: dict[float, Array]  # of the first model, by the weight of torques; kept by `tune_lqg`
    tuned: dict[str, tuple[Regulator, LoopPrediction]]  # results of `tune_lqg`, by loop and tuning

    @staticmethod
    def of(reference: Reference, spread: Spread, tuning: Tuning) -> LinearModels:
        """Compute the models.

        A disturbance is a constant force; springs that differ also change the frequencies of vibrations,
        which may destabilise a controller that counts on them. At the ends of the spread all, every other
        one, or one half of the springs are soft or stiff, and the rest the contrary.

        Raises:
            InvalidInput: a motion of the platform moves no mass.
        """
        robot, size = reference.robot, spread.stiffness
        kinds = tuple(dict.fromkeys([*disturbances_of(spread), *(tuning.estimates or ())]))
        if not (robot.n_e and size):
            return LinearModels(reference, spread, tuning, [linearise_plan(reference, kinds)], [], {}, {})
        springs = np.arange(robot.n_e)
        other, half = np.where(springs % 2, 1, -1), np.where(springs < robot.n_e / 2, 1, -1)
        every = np.ones(robot.n_e)
        signs = [k * pattern for pattern in (UNIFORM * every, every, other, half) for k in (-1, 1)]
        factors = [every, *(1 + size * sign for sign in signs)]
        models = linearise_variants(reference, kinds, [factor * robot.stiffness for factor in factors])
        return LinearModels(reference, spread, tuning, models[:3], models[3:], {}, {})

    def predict(self, name: str, controller: Controller, loop: ControlLoop) -> LoopPrediction | None:
        """Predict the deviations of a controller; None unless linear, with the whole state.

        Args:
            name: name of the controller.
            controller: lqg, lqr with the whole state, or feedforward without integral.
            loop: the loop in which it works.
        """
        for tuned, prediction in self.tuned.values():
            if tuned is controller:
                return prediction
        closed = self._close_loop(controller, loop)
        if closed is None:
            return None
        feedback, plants = closed
        count = len(self.within)
        platform, torque, load = self._largest(loop, feedback, plants[0], plants[:count], noise=True)
        prediction = LoopPrediction(name, loop.sensors, *(float(x.max()) for x in (platform, torque, load)))
        if not self.ends:
            return prediction
        if not prediction.is_within(loop.tolerance):
            return replace(prediction, ends=0.0)
        platform, _torque, load = self._largest(loop, feedback, plants[0], plants[count:], noise=False)
        is_kept = (platform <= MAX_PREDICTED_SHARE * loop.tolerance) & (load <= 1)
        return replace(prediction, ends=float(is_kept.mean()))

    def _largest(
        self, loop: ControlLoop, feedback: Feedback, model: Plant, robots: list[Plant], *, noise: bool
    ) -> tuple[Array, Array, Array]:
        """Compute the largest deviations (R,) along the plan of R robots: platform, torque, and load."""
        reference, robot = self.reference, self.reference.robot
        start = prior_deviations(reference, self.within[0], self.spread)
        start[: 2 * self.within[0].m] = 0.0  # robots start on the plan
        deviation = closed_loop_deviation(model, feedback, start, robots=robots, noise=noise)
        platform = (deviation.z[:, :, : robot.n] / robot.platform_scale).max(axis=(1, 2))
        planned = np.abs(reference.torque)  # (K, n_a)
        peak = planned.max(axis=0)
        lowest, highest = torque_range(reference, loop)
        limit = np.where(reference.torque < 0.0, -lowest, highest)
        left = np.maximum(limit - planned, LEAST_ROOM * peak)
        return (
            np.where(platform < MAX_DEVIATION, platform, np.inf),
            (deviation.torque / peak).max(axis=(1, 2)),
            (deviation.torque / left).max(axis=(1, 2)),
        )

    def _close_loop(self, controller: Controller, loop: ControlLoop) -> tuple[Feedback, list[Plant]] | None:
        """Return the feedback of a controller, and the robots with its readings; None unless linear."""
        robot, models = self.reference.robot, (*self.within, *self.ends)
        if isinstance(controller, FeedforwardPD) and not controller.integral:
            # of angles and speeds of motors
            gain = motor_gains(self.reference, models[0], controller.feedback)
            delay = loop.delayed_periods(self.reference.period)
            return Feedback(gain, delay, None, predicts=False), [Plant.of(model) for model in models]
        if not isinstance(controller, Regulator):
            return None
        gain = controller.gain
        if controller.filter is not None:  # of estimates
            own = controller.filter
            observer = Observer(own.gain, own.deviation)
            readings = [reading_rows(model, own.sensors, robot.n) for model in models]
        elif sensors_of(robot, loop).state:  # of the exact h and h'; disturbances are not estimated
            count, n_a, states = gain.shape
            N = models[0].A.shape[1]
            C = np.broadcast_to(np.eye(states, N), (count, states, N))
            observer = Observer(C.swapaxes(1, 2), np.zeros(states))
            gain = np.concatenate([gain, np.zeros((count, n_a, N - states))], axis=2)
            readings = [(C, np.zeros((count, states, n_a)))] * len(models)
        else:
            return None
        plants = [Plant(model.F, model.G, *rows) for model, rows in zip(models, readings, strict=True)]
        return Feedback(gain, controller.delay, observer, predicts=True), plants

    def tune_lqg(self, loop: ControlLoop) -> tuple[Regulator, LoopPrediction]:
        """Tune lqg for the sensors of the loop with the first of CAUTIONS predicted to pass at all ends.

        If none is, take the one that passes at most ends, or else the one of least prediction over the
        allowed deviation.
        """
        reference, spread, tuning = self.reference, self.spread, self.tuning
        key = repr((loop, tuning))
        if key in self.tuned:
            return self.tuned[key]
        best: tuple[tuple[float, float], Regulator, LoopPrediction] | None = None
        for noise, torque in CAUTIONS if self.ends else CAUTIONS[:1]:
            weights = Weights(torque=torque * tuning.torque_share).with_noise(noise)
            if weights.torque not in self.gains:  # they do not depend on sensors
                self.gains[weights.torque] = regulator_gains(reference, self.within[0], weights)
            controller = tune_lqg(
                reference,
                loop=loop,
                spread=spread,
                estimates=tuning.estimates,
                weights=weights,
                model=self.within[0],
                gain=self.gains[weights.torque],
            )
            prediction = self.predict("lqg", controller, loop)
            assert prediction is not None
            allowed = MAX_PREDICTED_SHARE * loop.tolerance
            excess = max(prediction.platform / allowed, prediction.load)
            rank = (-prediction.ends, max(excess, 1.0))
            if best is None or rank < best[0]:
                best = rank, controller, prediction
            if excess <= 1 and prediction.ends == 1:
                break
        assert best is not None
        self.tuned[key] = best[1:]
        return best[1:]


def predict(name: str, controller: Controller, loop: ControlLoop, spread: Spread) -> LoopPrediction | None:
    """Predict the deviations of a controller; None unless linear, with the whole state.

    Args:
        name: name of the controller.
        controller: lqg, lqr with the whole state, or feedforward without integral.
        loop: the loop in which it works.
        spread: of robots about the model.
    """
    kinds = controller.model.kinds if isinstance(controller, Regulator) else None
    return LinearModels.of(controller.reference, spread, Tuning(estimates=kinds)).predict(
        name, controller, loop
    )


def predict_by_sensors(
    reference: Reference,
    loop: ControlLoop,
    spread: Spread,
    *,
    tuning: Tuning | None = None,
    sets: Sequence[str] = SENSOR_SETS,
    models: LinearModels | None = None,
) -> list[LoopPrediction]:
    """Predict the deviations of lqg for each set of sensors that the robot can have.

    Args:
        reference: plan at the sampling instants.
        loop: known delay and steps of encoders; its sensors do not count.
        spread: of robots about the model.
        tuning: what a designer chooses of lqg.
        sets: sets of sensors; those that read the same as an earlier one are left out.
        models: linear models of these, if there are any.

    Raises:
        InvalidInput: a motion of the platform moves no mass.
    """
    models = models or LinearModels.of(reference, spread, tuning or Tuning())
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
