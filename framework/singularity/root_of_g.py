"""The root of the bordered measure g near a guess, to rounding, however the matrix is moved.

One parameter p moves the matrix: the path coordinate s of a robot at rest or with given deflections, the
time t of a motion. Newton's method, each step with the border of the matrix at its own p and with the slope
by central differences; so g is smooth at the root itself, where any border from elsewhere would do less well.
Source of g: Govaerts 2000, see `bordered_system`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.singularity.bordered_system import solve_near
from framework.tolerances import NEWTON_STEP

STENCIL_HALF_WIDTH = 1e-4  # half the width of the central difference, as a share of the interval of p
MAX_ITERATIONS = 20


class Slope(NamedTuple):
    """g and its derivatives by p, with the border of the matrix at p."""

    g: float
    slope: float
    upper: float  # g at the upper end of the stencil
    bend: float  # its second derivative; 0 where the stencil lies on one side


class Root(NamedTuple):
    """The result of Newton's method."""

    place: float
    depth: float  # what is left of g: 0 if the last step was small enough for the next one to be rounding
    converged: bool
    slope: float  # dg/dp, by the last stencil
    bend: float  # d2g/dp2, likewise; 0 at an end of the interval


def stencil(place: float, low: float = 0.0, high: float = 1.0) -> Array:
    """Return the places (3,) about p for the slope; at an end of [low, high] on one side."""
    half = STENCIL_HALF_WIDTH * (high - low)
    return np.clip([place - half, place, place + half], low, high)


def slope_of_g(matrices: Array, places: Array, size: int = 1) -> Slope:
    """Compute g and dg/dp from matrices (3, n, n) at places (3,) of a `stencil`, the border `size` wide."""
    g = solve_near(matrices, 1, size).g
    lower, middle, upper = map(float, g)
    width = float(places[2] - places[0])
    both_sides = places[0] < places[1] < places[2]
    bend = 4.0 * (lower - 2.0 * middle + upper) / width**2 if both_sides else 0.0
    return Slope(middle, (upper - lower) / width, upper, bend)


def root_of_g(
    matrices: Callable[[Array], Array],
    start: float,
    *,
    low: float = 0.0,
    high: float = 1.0,
    size: int = 1,
    longest: float = np.inf,
) -> Root:
    """Find the root of g near `start`, within [low, high].

    Args:
        matrices: the matrices (3, n, n) at three values (3,) of p.
        size: width of the border; more than 1 where other singular values are small beside the one sought.
        longest: a Newton step beyond this leads away from the root sought, and none is found.
    """
    place, depth, slope, bend = start, np.inf, 0.0, 0.0
    for _ in range(MAX_ITERATIONS):
        places = stencil(place, low, high)
        depth, slope, _, bend = slope_of_g(matrices(places), places, size)
        step = -depth / slope if slope else np.inf
        if not abs(step) < longest:
            break
        place = float(np.clip(place + step, low, high))
        if abs(step) < NEWTON_STEP * (high - low):
            return Root(place, 0.0, True, slope, bend)
    return Root(place, depth, False, slope, bend)
