"""Controllers by name, tuned for a reference, its control loop, and a spread of robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from framework.control.controllers import ComputedTorque, Controller, FeedforwardPD
from framework.control.linear_model import DISTURBANCES
from framework.control.reference import Reference
from framework.control.regulators import Weights, tune_lqg, tune_lqr
from framework.control.sensors import ControlLoop
from framework.control.variations import Spread
from framework.errors import check_choice
from framework.numerics.fields import not_negative, positive


@dataclass(frozen=True)
class Tuning:
    """What a designer may choose of the controllers."""

    # [rad/s] of feedforward (each motor) and computed torque (the platform); None: 40 and 20, or less as the
    # delay demands
    bandwidth: float | None = None
    integral: float = 0.0  # [1/s] of feedforward and computed torque, against constant disturbances
    # of lqr and lqg: torque corrections, as shares of the peak, that cost as much as a deviation of the
    # platform by 1e-3 robot lengths; a larger share gives faster control
    torque_share: float = 0.3
    # of lqg: kinds of DISTURBANCES that are estimated; None: those of the spread of robots
    estimates: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check signs and names."""
        if self.bandwidth is not None:
            positive("bandwidth", self.bandwidth)
        not_negative("integral", self.integral)
        positive("torque_share", self.torque_share)
        for name in self.estimates or ():
            check_choice("estimates", name, DISTURBANCES)


class Setting(NamedTuple):
    """What a controller is tuned for."""

    reference: Reference
    loop: ControlLoop
    spread: Spread
    tuning: Tuning


def _tune_feedforward(setting: Setting) -> Controller:
    reference, loop, _spread, tuning = setting
    return FeedforwardPD.tune(reference, loop=loop, bandwidth=tuning.bandwidth, integral=tuning.integral)


def _tune_computed_torque(setting: Setting, *, aware: bool) -> Controller:
    reference, loop, _spread, tuning = setting
    return ComputedTorque.tune(
        reference, aware=aware, loop=loop, bandwidth=tuning.bandwidth, integral=tuning.integral
    )


def _tune_lqr(setting: Setting) -> Controller:
    return tune_lqr(setting.reference, loop=setting.loop, weights=Weights(torque=setting.tuning.torque_share))


def _tune_lqg(setting: Setting) -> Controller:
    reference, loop, spread, tuning = setting
    weights = Weights(torque=tuning.torque_share)
    return tune_lqg(reference, loop=loop, spread=spread, estimates=tuning.estimates, weights=weights)


CONTROLLERS: Mapping[str, Callable[[Setting], Controller]] = {
    "feedforward": _tune_feedforward,
    "lqr": _tune_lqr,
    "lqg": _tune_lqg,
    "computed_torque": partial(_tune_computed_torque, aware=True),
    "naive_computed_torque": partial(_tune_computed_torque, aware=False),
}


def tuned_controller(
    name: str,
    reference: Reference,
    *,
    loop: ControlLoop | None = None,
    spread: Spread | None = None,
    tuning: Tuning | None = None,
) -> Controller:
    """Return the controller of a name, tuned for a loop and a spread of robots.

    Args:
        loop: sensors and known delay; by default encoders on the motors, without delay.
        spread: of robots about the model, by default none; lqg estimates what differs.
        tuning: what a designer chooses.

    Raises:
        InvalidInput: unknown name, or a robot that the controller cannot drive.
    """
    check_choice("controller", name, CONTROLLERS)
    setting = Setting(reference, loop or ControlLoop(), spread or Spread(), tuning or Tuning())
    return CONTROLLERS[name](setting)
