"""Controllers by name, tuned for a reference, its control loop, and a spread of robots."""

from __future__ import annotations

from typing import Any

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


CONTROLLERS = ("feedforward", "lqr", "lqg", "computed_torque", "naive_computed_torque")


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
    loop, spread, tuning = loop or ControlLoop(), spread or Spread(), tuning or Tuning()
    if name == "lqr":
        return tune_lqr(reference, loop=loop, weights=Weights(torque=tuning.torque_share))
    if name == "lqg":
        models = models or LinearModels.of(reference, spread, tuning)
        return models._replace(tuning=tuning).tune_lqg(loop)[0]
    gains: dict[str, Any] = {"loop": loop, "bandwidth": tuning.bandwidth, "integral": tuning.integral}
    if name == "feedforward":
        return FeedforwardPD.tune(reference, **gains)
    return ComputedTorque.tune(reference, aware=name == "computed_torque", **gains)
