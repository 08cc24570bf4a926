"""Closed forms of the paper's 5R, the same lines for floats and for numbers of fifty digits.

Given floats they are what one would program first; given `mpmath` numbers they are the truth. What differs
between the two is digits and nothing else. Legs: left, right; elbows outward; lengths in metres.
Source: Briot and Arakelian 2010, Eqs. (12)-(16), as in `tests/oracles/five_bar.py`.
"""

from dataclasses import replace
from typing import Any

import mpmath
import numpy as np

import robots
from framework import Line, ParallelRobot
from tests.oracles import five_bar as oracle

mp = mpmath.mp.clone()
mp.dps = 50
Number = Any  # float or mp.mpf

BASES, LENGTH, GEAR, PAYLOAD = (-0.2, 0.2), 0.25, 50, 10  # [m], [m], -, [kg]
START, END = (0.1, 0.345), (-0.05, 0.195)  # scene C
LINE = Line(START, END)
DURATION, CROSSING_TIME, CROSSING_SPEED = 1.5, 1.0, 1.5  # [s], [s], [1/s]


def exact(value: float | str) -> Number:
    """A decimal number as the paper means it: 0.1 is a tenth."""
    return mp.mpf(repr(value) if isinstance(value, float) else value)


def cross(a: tuple[Number, Number], b: tuple[Number, Number]) -> Number:
    return a[0] * b[1] - a[1] * b[0]


def legs(x: Number, y: Number, stretch: tuple[Number, Number] = (0, 0)) -> list[tuple[Any, Any]]:
    """(crank, rod) of both legs, for rods longer by `stretch` [m]."""
    convert = exact if isinstance(x, mp.mpf) else float
    found = []
    for base, elbow, longer in zip(BASES, (1, -1), stretch, strict=True):
        length, rod = convert(LENGTH), convert(LENGTH) + longer
        reach = x - convert(base), y
        square = reach[0] ** 2 + reach[1] ** 2
        along = ((length**2 - rod**2) / square + 1) / 2
        across = elbow * (length**2 / square - along**2) ** 0.5
        crank = along * reach[0] - across * reach[1], along * reach[1] + across * reach[0]
        found.append((crank, (reach[0] - crank[0], reach[1] - crank[1])))
    return found


def rods_cross(x: Number, y: Number) -> Number:
    """Cross product of the rods [m^2]: zero in Type 2, det A / 4."""
    (_, left), (_, right) = legs(x, y)
    return cross(left, right)


def load_torque(x: Number, y: Number, force: tuple[Number, Number]) -> tuple[Number, Number]:
    """Motor torques (B / n)' A^-T W_p [N m] that hold a force W_p [N] on the payload, Eqs. (4) and (9)."""
    (crank, rod), (other_crank, other_rod) = legs(x, y)
    below = cross(rod, other_rod)
    left = cross(force, other_rod) / below * cross(crank, rod) / GEAR
    right = cross(rod, force) / below * cross(other_crank, other_rod) / GEAR
    return left, right


def on_line(s: Number) -> tuple[Number, Number]:
    """Point of scene C at path coordinate s."""
    convert = exact if isinstance(s, mp.mpf) else float
    x, y = (convert(START[k]) + s * (convert(END[k]) - convert(START[k])) for k in range(2))
    return x, y


def power_law(inner: tuple[Number, Number, Number] | None, smoothness: int = 2) -> tuple[Number, ...]:
    """Exact law of scene C in powers of t, through (s, s', s'') = `inner` at the crossing time."""
    crossing = None if inner is None else (mp.mpf(CROSSING_TIME), inner)
    return oracle.polynomial_law(mp.mpf(DURATION), smoothness, crossing)


def value(powers: tuple[Number, ...], t: Number, order: int = 0) -> Number:
    """A polynomial in powers of t, or its derivative."""
    return sum(c * mp.ff(k, order) * t ** (k - order) for k, c in enumerate(powers) if k >= order)


def exact_torque(powers: tuple[Number, ...], t: Number) -> tuple[Number, Number]:
    """Load torques along scene C under a law, to forty digits and more."""
    t = mp.mpf(t)
    x, y = on_line(mp.mpf(value(powers, t)))
    push = PAYLOAD * value(powers, t, 2)
    return load_torque(x, y, tuple(push * (exact(END[k]) - exact(START[k])) for k in range(2)))


def without_rotors(flexibility: str = "rigid", **changes: Any) -> ParallelRobot:
    """The 5R whose motors have no inertia: its torques are load torques. `changes` of the description."""
    description = robots.load("five_bar").description
    actuators = tuple(replace(motor, rotor_inertia=0.0) for motor in description.actuators)
    return ParallelRobot.from_description(
        replace(description, actuators=actuators, **changes), flexibility=flexibility
    )


def crossing_coordinate() -> Number:
    """Where scene C meets the locus, to fifty digits."""
    return mp.findroot(lambda s: rods_cross(*on_line(s)), mp.mpf("0.667"))


def relative(found: Any, expected: Any) -> float:
    """Largest error over the largest expected value."""
    found, expected = np.array(found, dtype=float), np.array(expected, dtype=float)
    return float(np.abs(found - expected).max() / np.abs(expected).max())
