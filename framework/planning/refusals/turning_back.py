"""Laws that do not always advance: they would meet a singular point again, where condition (8) is not met."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.errors import NoLaw
from framework.laws.law import MotionLaw, law_derivatives
from framework.tolerances import AT_REST, OVERSHOOT


def check_advance(law: MotionLaw, s: Sequence[float], name: str) -> None:
    """Refuse a law that turns back, leaves the path or repeats a crossing.

    The singular points are at s (k,). A law that always advances passes; so does one that overshoots an end
    by less than `tolerances.OVERSHOOT` and comes back to it, as the paper's case C does with degree 8.

    Args:
        name: of the robot.

    Raises:
        NoLaw: says where and when.
    """
    fault = _find_fault(law, s)
    if fault is not None:
        raise NoLaw(f"{name}: the law does not always advance: it {fault}; choose other times or speeds")


def _find_fault(law: MotionLaw, singular: Sequence[float]) -> str | None:
    """Find the fault of a law with singular points (k,), in words.

    None without any.
    """
    times = np.linspace(0.0, law.duration, 2001)
    s, ds = law_derivatives(law, times, 2)
    for end, beyond in ((0.0, -s), (1.0, s - 1.0)):
        worst = np.argmax(beyond)
        if beyond[worst] > OVERSHOOT:
            return f"leaves the path at s = {end:g}, up to s = {s[worst]:.4g} at t = {times[worst]:.4g} s"
    is_inside = (s > 0) & (s < 1)
    is_backwards = is_inside & (ds < -AT_REST * np.abs(ds).max())
    if is_backwards.any():
        first = np.argmax(is_backwards)
        return f"runs backwards at t = {times[first]:.4g} s, s = {s[first]:.4g}"
    for place in singular:
        meetings = np.flatnonzero(np.diff(s > place))
        if len(meetings) > 1:
            instants = ", ".join(f"{times[k]:.4g}" for k in meetings)
            count = len(meetings)
            return f"meets the singular point s = {place:.6g} {count} times (about t = {instants} s)"
    return None
