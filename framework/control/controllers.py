"""The controllers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from framework.control.computed_torque import ComputedTorque
from framework.control.estimation import Controller
from framework.control.feedforward import FeedforwardPD
from framework.control.lqr import TimeVaryingLQR
from framework.control.reference import Reference
from framework.errors import check_choice

CONTROLLERS: Mapping[str, Callable[[Reference], Controller]] = {
    "feedforward": FeedforwardPD.tune,
    "lqr": TimeVaryingLQR.tune,
    "computed_torque": lambda reference: ComputedTorque.tune(reference, aware=True),
    "naive_computed_torque": lambda reference: ComputedTorque.tune(reference, aware=False),
}


def tuned_controller(name: str, reference: Reference) -> Controller:
    """Return the controller of that name with its default gains.

    Raises:
        InvalidInput: unknown name, or a robot that the controller is not for.
    """
    check_choice("controller", name, CONTROLLERS)
    return CONTROLLERS[name](reference)
