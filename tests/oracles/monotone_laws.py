"""Whether a polynomial law of a given degree advances through given points at given times: a linear program.

It shares no code with the framework. In the share x of the duration T, the law has s' = (x (1 - x))^R p(x),
with p in Legendre polynomials. Each point asks for s, s' and s" = acceleration(s') at its time. The program
maximises the least p at many points. Speeds that are left open are scanned.
"""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import linprog

POINTS = 400  # of x, where p is positive
SPEEDS = {1: 48, 2: 14, 3: 8}  # scanned for each point, by the number of points
SLOWEST, QUICKEST = 0.05, 15.0  # paths in the duration
POSITIVE = 1e-3  # least p over its mean, above what the points leave open between them


def advances(
    duration: float,
    smoothness: int,
    places: Sequence[float],
    times: Sequence[float],
    accelerations: Sequence[Callable[[float], float]],
    *,
    speeds: Sequence[float] | None = None,
    degree: int = 24,
) -> bool:
    """Return whether some law of the degree advances, with s' and s" = acceleration(s') at its points."""
    count = len(places)
    scanned = np.geomspace(SLOWEST, QUICKEST, SPEEDS[count]) / duration
    choices = [tuple(speeds)] if speeds is not None else product(scanned, repeat=count)
    rows, positive, mean = _rows(smoothness, np.array(times) / duration, degree - 2 * smoothness)
    for choice in choices:
        wanted = [1.0, *places]
        for v, acceleration in zip(choice, accelerations, strict=True):
            wanted += [v * duration, acceleration(v) * duration**2]
        if _least(rows, positive, mean, np.array(wanted)) > POSITIVE:
            return True
    return False


def _rows(smoothness: int, x: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of what is given, values of p at all points, and its mean, on the coefficients of p."""

    def weight(at: np.ndarray) -> np.ndarray:
        return (at * (1.0 - at)) ** smoothness

    def values(at: np.ndarray) -> np.ndarray:
        return legendre.legvander(2.0 * at - 1.0, size - 1)

    def integral(end: float) -> np.ndarray:
        nodes, weights = legendre.leggauss(size + 2 * smoothness + 4)
        at = 0.5 * end * (nodes + 1.0)
        return 0.5 * end * (weights * weight(at)) @ values(at)

    slopes = np.array(
        [2.0 * legendre.legval(2.0 * x - 1.0, legendre.legder(unit)) for unit in np.eye(size)]
    ).T
    rows = [integral(1.0), *map(integral, x)]
    for at, value, slope in zip(x, values(x), slopes, strict=True):
        change = smoothness * (1.0 - 2.0 * at) / (at * (1.0 - at))  # of the weight, over the weight
        rows += [weight(at) * value, weight(at) * (slope + change * value)]
    points = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, POINTS))
    return np.array(rows), values(points), np.eye(1, size)[0]


def _least(rows: np.ndarray, positive: np.ndarray, mean: np.ndarray, wanted: np.ndarray) -> float:
    """The largest least p over the mean of p; minus infinity where nothing meets the rows."""
    size = rows.shape[1]
    scale = np.abs(rows).max(axis=1)
    above = np.hstack([-positive, np.ones((len(positive), 1))])
    found = linprog(
        -np.eye(1, size + 1, size)[0],
        A_ub=above,
        b_ub=np.zeros(len(above)),
        A_eq=np.hstack([rows / scale[:, None], np.zeros((len(rows), 1))]),
        b_eq=wanted / scale,
        bounds=(None, None),
    )
    return float(found.x[-1] / (mean @ found.x[:-1])) if found.status == 0 else -np.inf
