"""Predicted deviations of a closed loop by sensors, without runs, and the least sensors that pass.

    predictions = predict_by_sensors(reference, ControlLoop(delay=1e-3, counts=8192), Spread(payload=0.1))

The prediction is linear: it knows payload, friction, springs, the known delay, and the steps and noise of
sensors. It does not know places of joints, unknown delays, limits of torques, and errors so large that the
dynamics are no longer those about the plan. So it is an estimate: runs decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from framework.control.closed_loop import MAX_DEVIATION, torque_range
from framework.control.controllers import Controller, FeedforwardPD, Tuning, motor_gains
from framework.control.deviation import Observer, Plant, closed_loop_deviation
from framework.control.linear_model import LinearModel, linearise_variants
from framework.control.reference import Reference
from framework.control.regulators import (
    UNIFORM,
    Regulator,
    Weights,
    disturbances_of,
    plant_with_readings,
    prior_starts,
    regulator_gains,
    tune_filter,
)
from framework.control.sensors import ControlLoop, sensors_of
from framework.control.variations import Spread
from framework.errors import InvalidInput
from framework.numerics.arrays import Array
from framework.tolerances import (
    GOOD_EXCESS,
    LEAST_ROOM,
    MAX_PREDICTED_SHARE,
    NOISE_FACTORS,
    TORQUE_FACTORS,
)

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

    @property
    def sentence(self) -> str:
        """The prediction in words, without a full stop."""
        return (
            f"{self.controller} with {self.sensors} is predicted to deviate by {self.platform:.2g} robot "
            f"lengths or rad and {self.torque:.2g} of the peak torques in one standard deviation"
        )

    def excess(self, tolerance: float) -> float:
        """Return the platform's deviation over the allowed share of a tolerance, or the load if larger."""
        return max(self.platform / (MAX_PREDICTED_SHARE * tolerance), self.load)

    def is_within(self, tolerance: float) -> bool:
        """Return whether runs are expected to keep a tolerance [robot lengths, rad] and the torque limits."""
        return self.excess(tolerance) <= 1

    def warning(self, tolerance: float) -> str:
        """Return why runs may fail at a tolerance [robot lengths, rad]; empty if they are to pass."""
        if not self.is_within(tolerance):
            return (
                f"{self.sentence}: more than {MAX_PREDICTED_SHARE:.0%} of the tolerance {tolerance:.4g}, or "
                f"more torque than the limits leave, so that runs may fail"
            )
        if self.ends < 1:
            return (
                f"{self.controller} with {self.sensors} is predicted to fail with {1 - self.ends:.0%} of the "
                f"combinations tried of springs at the ends of their spread"
            )
        return ""


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
        every = np.ones(robot.n_e)
        factors = [every]
        if robot.n_e and size:
            springs = np.arange(robot.n_e)
            other, half = np.where(springs % 2, 1, -1), np.where(springs < robot.n_e / 2, 1, -1)
            patterns = (UNIFORM * every, every, other, half)
            factors += [1 + sign * size * pattern for pattern in patterns for sign in (-1, 1)]
        models = linearise_variants(reference, kinds, [factor * robot.stiffness for factor in factors])
        return LinearModels(reference, spread, tuning, models[:3], models[3:], {}, {})

    def predict(self, name: str, controller: Controller, loop: ControlLoop) -> LoopPrediction | None:
        """Predict the deviations of a controller in a loop, as `predict` does."""
        for tuned, prediction in self.tuned.values():
            if tuned is controller:
                return prediction
        reference, models = self.reference, (*self.within, *self.ends)
        if isinstance(controller, FeedforwardPD) and not controller.integral:
            # of angles and speeds of motors
            gain = motor_gains(reference, models[0], controller.feedback)
            delay = loop.delayed_periods(reference.period)
            return self._deviate(name, loop, [Plant.of(model) for model in models], gain, delay)
        if not isinstance(controller, Regulator):
            return None
        if controller.sensors is None and not sensors_of(reference.robot, loop).state:
            return None
        plants = [plant_with_readings(model, controller.sensors, reference) for model in models]
        return self._deviate(name, loop, plants, controller.gain, controller.delay, controller.observer)

    def _deviate(
        self,
        name: str,
        loop: ControlLoop,
        plants: Sequence[Plant],
        gain: Array,
        delay: int,
        observer: Observer | None = None,
    ) -> LoopPrediction:
        """Predict `closed_loop_deviation` of the robots of `within`, then of those of `ends`, if any."""
        reference, scale = self.reference, self.reference.robot.platform_scale
        start = prior_starts(reference, self.within[0], self.spread)
        start[: 2 * self.within[0].m] = 0.0  # robots start on the plan
        deviation = closed_loop_deviation(plants, start, gain, delay, observer)
        platform = (deviation.z[:, :, : len(scale)] / scale).max(axis=(1, 2))  # (R,)
        platform = np.where(platform < MAX_DEVIATION, platform, np.inf)
        count = len(self.within)
        torque = deviation.torque[:count].max(axis=0)  # (K, n_a)
        peak = reference.peak_torque
        lowest, highest = torque_range(reference, loop)
        limit = np.where(reference.torque < 0.0, -lowest, highest)
        left = np.maximum(limit - np.abs(reference.torque), LEAST_ROOM * peak)
        is_kept = np.asarray(platform[count:] <= MAX_PREDICTED_SHARE * loop.tolerance)
        return LoopPrediction(
            controller=name,
            sensors=loop.sensors,
            platform=float(platform[:count].max()),
            torque=float((torque / peak).max()),
            load=float((torque / left).max()),
            ends=float(is_kept.mean()) if len(is_kept) else 1.0,
        )

    def tune_lqg(self, loop: ControlLoop) -> tuple[Regulator, LoopPrediction]:
        """Tune lqg for the sensors of the loop, with the weights of least predicted excess.

        They are the stated ones times factors on the filter's noise and on the torque share, the first that
        do well at all ends. Excesses below GOOD_EXCESS count as equal; of equal ones, take the one that keeps
        the tolerance at most ends.
        """
        key = repr((loop, self.tuning))
        if key in self.tuned:
            return self.tuned[key]
        reference, spread, tuning, model = self.reference, self.spread, self.tuning, self.within[0]
        sensors, delay = sensors_of(reference.robot, loop), loop.delayed_periods(reference.period)
        plants = [plant_with_readings(one, sensors, reference) for one in (*self.within, *self.ends)]
        # the filter counts disturbances that are not estimated as zero
        kinds = disturbances_of(spread) if tuning.estimates is None else tuning.estimates
        prior = prior_starts(reference, model, spread)
        unknown = [name.split()[0] not in {kind.rstrip("s") for kind in kinds} for name in model.names]
        prior[2 * model.m :][unknown] = 0.0

        def rank(tuned: tuple[Regulator, LoopPrediction]) -> tuple[float, float]:
            return max(tuned[1].excess(loop.tolerance), GOOD_EXCESS), -tuned[1].ends

        candidates: list[tuple[Regulator, LoopPrediction]] = []
        for noise, torque in product(NOISE_FACTORS, TORQUE_FACTORS):
            weights = Weights(torque=torque * tuning.torque_share, noise=noise)
            if weights.torque not in self.gains:  # they do not depend on sensors
                self.gains[weights.torque] = regulator_gains(reference, model, weights)
            gain = self.gains[weights.torque]
            observer = tune_filter(reference, model, plants[0], sensors, spread, weights, prior)
            prediction = self._deviate("lqg", loop, plants[: len(self.within)], gain, delay, observer)
            if self.ends and prediction.excess(loop.tolerance) <= GOOD_EXCESS:  # of good ones ends decide
                prediction = self._deviate("lqg", loop, plants, gain, delay, observer)
            candidates.append((Regulator(reference, model, gain, delay, observer, sensors), prediction))
            if rank(candidates[-1]) == (GOOD_EXCESS, -1.0):
                break
        controller, prediction = min(candidates, key=rank)
        if self.ends and prediction.excess(loop.tolerance) > GOOD_EXCESS:
            prediction = self._deviate("lqg", loop, plants, controller.gain, delay, controller.observer)
        self.tuned[key] = controller, prediction
        return controller, prediction


def predict(name: str, controller: Controller, loop: ControlLoop, spread: Spread) -> LoopPrediction | None:
    """Predict the deviations of a controller; None unless linear, with the whole state.

    Args:
        name: of the controller.
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
        S = np.unique(rows.S, axis=0)
        if not rows.platform and any(np.array_equal(S, other) for other in seen):
            continue  # links of rigid robots are their motors
        seen.append(S)
        predictions.append(models.tune_lqg(one)[1])
    return predictions


def suggest_sensors(predictions: Sequence[LoopPrediction], tolerance: float) -> LoopPrediction | None:
    """Return the first prediction that keeps the tolerance [robot lengths, rad]; None if none does."""
    return next((one for one in predictions if one.is_within(tolerance)), None)
