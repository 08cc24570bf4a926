"""Controllers by name, tuned for a reference, its control loop, and a spread of robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from framework.control.controllers import ComputedTorque, Controller, FeedforwardPD
from framework.control.prediction import LinearModels
from framework.control.reference import Reference
from framework.control.regulators import Tuning, Weights, tune_lqr
from framework.control.sensors import ControlLoop
from framework.control.variations import Spread
from framework.errors import check_choice
from framework.numerics.fields import number

GAINS = ("bandwidth", "integral", "torque_share")  # fields of Tuning that a label may have
REGULATOR_GAINS = ("torque_share",)  # those of lqr and lqg; the others have the rest


class Setting(NamedTuple):
    """What a controller is tuned for."""

    reference: Reference
    loop: ControlLoop
    spread: Spread
    tuning: Tuning
    models: LinearModels | None = None  # about the reference, for the spread and these estimates


def _tune_lqg(setting: Setting) -> Controller:
    """Tune time-varying gains with a Kalman filter."""
    reference, loop, spread, tuning, models = setting
    models = models or LinearModels.of(reference, spread, tuning)
    return models._replace(tuning=tuning).tune_lqg(loop)[0]


def _fixed_gain_options(setting: Setting) -> dict[str, Any]:
    """Return loop, bandwidth and integral of controllers with fixed gains."""
    tuning = setting.tuning
    return {"loop": setting.loop, "bandwidth": tuning.bandwidth, "integral": tuning.integral}


CONTROLLERS: Mapping[str, Callable[[Setting], Controller]] = {
    "feedforward": lambda one: FeedforwardPD.tune(one.reference, **_fixed_gain_options(one)),
    "lqr": lambda one: tune_lqr(
        one.reference, loop=one.loop, weights=Weights(torque=one.tuning.torque_share)
    ),
    "lqg": _tune_lqg,
    "computed_torque": lambda one: ComputedTorque.tune(one.reference, aware=True, **_fixed_gain_options(one)),
    "naive_computed_torque": lambda one: ComputedTorque.tune(
        one.reference, aware=False, **_fixed_gain_options(one)
    ),
}


def split_label(label: str) -> tuple[str, dict[str, Any]]:
    """Return name and gains of a label such as `feedforward bandwidth=20`.

    Raises:
        InvalidInput: unknown name, a gain that this controller does not have, or no number.
    """
    name, *changes = label.split() or [""]
    check_choice("controller", name, CONTROLLERS)
    gains: dict[str, Any] = {}
    for change in changes:
        key, _, value = change.partition("=")
        own = [gain for gain in GAINS if (gain in REGULATOR_GAINS) == (name in ("lqr", "lqg"))]
        check_choice(f"gain of {name}", key, own)
        gains[key] = number(f"{name}: {key}", value)
    return name, gains


def tuned_controller(
    name: str,
    reference: Reference,
    *,
    loop: ControlLoop | None = None,
    spread: Spread | None = None,
    tuning: Tuning | None = None,
    models: LinearModels | None = None,
) -> Controller:
    """Return the controller of a name, tuned for a loop and a spread of robots.

    Args:
        loop: sensors and known delay; by default encoders on the motors, without delay.
        spread: of robots about the model, by default none; lqg estimates what differs.
        tuning: what a designer chooses.
        models: linear models of these, if there are any.

    Raises:
        InvalidInput: unknown name, or a robot that the controller cannot drive.
    """
    check_choice("controller", name, CONTROLLERS)
    setting = Setting(reference, loop or ControlLoop(), spread or Spread(), tuning or Tuning(), models)
    return CONTROLLERS[name](setting)
