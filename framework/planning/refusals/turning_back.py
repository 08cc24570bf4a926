"""The refusal of laws that do not always advance.

Such a law could meet a singular point a second time, at an instant where condition (8) does not hold.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.errors import NoLaw
from framework.laws.law import MotionLaw, law_derivatives
from framework.tolerances import AT_REST, OVERSHOOT


def check_advance(law: MotionLaw, s: Sequence[float], name: str) -> None:
    """Refuse a law that turns back, leaves the path or repeats a crossing.

    A law may overshoot an end by less than `tolerances.OVERSHOOT` and return to it, as the law of degree 8 in
    the paper's case C does.

    Args:
        s: path coordinates (k,) of the singular points.
        name: name of the robot.

    Raises:
        NoLaw: the law has such a fault; the message has its s and time.
    """
    fault = _find_fault(law, s)
    if fault:
        raise NoLaw(f"{name}: the law does not always advance: it {fault}; choose other times or speeds")


def _find_fault(law: MotionLaw, singular: Sequence[float]) -> str:
    """Find the first fault of a law with singular points at s (k,), in words; empty without one."""
    times = np.linspace(0.0, law.duration, 2001)
    s, ds = law_derivatives(law, times, 2)
    for end, overshoot in ((0.0, -s), (1.0, s - 1.0)):
        worst = np.argmax(overshoot)
        if overshoot[worst] > OVERSHOOT:
            return f"leaves the path at s = {end:g}, up to s = {s[worst]:.4g} at t = {times[worst]:.4g} s"
    is_inside = (s > 0) & (s < 1)
    is_backwards = is_inside & (ds < -AT_REST * np.abs(ds).max())
    if is_backwards.any():
        first = np.argmax(is_backwards)
        return f"runs backwards at t = {times[first]:.4g} s, s = {s[first]:.4g}"
    for s_singular in singular:
        meetings = times[:-1][np.diff(s > s_singular)]  # [s]
        if len(meetings) > 1:
            instants = f"{len(meetings)} times (about t = {', '.join(f'{t:.4g}' for t in meetings)} s)"
            return f"meets the singular point s = {s_singular:.6g} {instants}"
    return ""
