"""Laws that do not always advance: they would meet a singular point again, where condition (8) is not met."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.errors import NoLaw
from framework.motion.law import MotionLaw, law_derivatives
from framework.tolerances import AT_REST, OVERSHOOT

LAW_SAMPLES = 2001  # equidistant instants at which a law is looked at
ADVICE = "choose other times or speeds"


def check_advance(law: MotionLaw, s: Sequence[float], name: str) -> None:
    """Refuse a law that runs backwards, leaves the path, or meets a singular point s (k,) twice.

    A law that always advances passes; so does one that overshoots an end by less than
    `tolerances.OVERSHOOT` and comes back to it, as the paper's case C does with degree 8.

    Args:
        name: of the robot.

    Raises:
        NoLaw: says where and when.
    """
    times = np.linspace(0.0, law.duration, LAW_SAMPLES)
    values, rates = law_derivatives(law, times, 2)
    refused = f"{name}: the law does not always advance: it"
    for end, beyond in ((0.0, -values), (1.0, values - 1.0)):
        worst = np.argmax(beyond)
        if beyond[worst] > OVERSHOOT:
            raise NoLaw(
                f"{refused} leaves the path at s = {end:g}, up to s = {values[worst]:.4g} at "
                f"t = {times[worst]:.4g} s; {ADVICE}"
            )
    inside = (values > 0) & (values < 1)
    backwards = inside & (rates < -AT_REST * np.abs(rates).max())
    if np.any(backwards):
        k = np.argmax(backwards)
        raise NoLaw(f"{refused} runs backwards at t = {times[k]:.4g} s, s = {values[k]:.4g}; {ADVICE}")
    for singular in s:
        crossed = np.flatnonzero(np.diff(values > singular))
        if len(crossed) > 1:
            instants = ", ".join(f"{times[k]:.4g}" for k in crossed)
            raise NoLaw(
                f"{refused} meets the singular point s = {singular:.6g} {len(crossed)} times (about t = "
                f"{instants} s); {ADVICE}"
            )
