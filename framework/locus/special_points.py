"""Special points of a traced curve: where a measure along it vanishes, and where another curve crosses.

Where det [dF/du ; t'] changes its sign between two points another curve crosses. The simple branch point is
bracketed, and the second tangent found from the algebraic bifurcation equation psi' F" (w, w) = 0 over the
plane of both (Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chapter 8).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.arrays import Array, select
from framework.locus.curve_tracing import Points, advance
from framework.locus.locus_equations import LocusEquations
from framework.tolerances import DISTINCT_SOLUTIONS

# of det [dF/du ; t'] at the neighbours: nearer to a branch point the corrector loses its digits
BRANCH_POINT_RATIO = 1e-6
DIFFERENCE_STEP = 1e-3  # [rad, lengths] of second differences there
BRANCH_STEP = 0.02  # [rad, lengths] to the first point of the other curve
ROOT_SIZE, MAX_ROOT_STEPS = 1e-13, 40  # of a measure without dimension between two points


def root_between(
    equations: LocusEquations,
    first: Points,
    second: Points,
    measure: Callable[[Points], float],
    *,
    small: float = ROOT_SIZE,
) -> Points | None:
    """Find the point between two neighbours (S = 1) at which a measure of opposite signs vanishes.

    False position (the Illinois variant) on the share of the way, until the measure is `small`. Where the
    corrector fails, as near a branch point, the last point it led to; None if to none.
    """
    chord = float(np.linalg.norm(equations.offsets(first.q[0], second.q[0])))
    bend = (second.tangent - first.tangent) / chord
    low, high, at_low, at_high = 0.0, 1.0, measure(first), measure(second)
    root, last = None, 0  # which end was replaced last
    for _ in range(MAX_ROOT_STEPS):
        share = (low * at_high - high * at_low) / (at_high - at_low)
        point, good = advance(equations, first, np.array([share * chord]), bend)
        if not good[0]:
            return root
        root, value = point, measure(point)
        if abs(value) < small or high - low < ROOT_SIZE:
            break
        if value * at_low > 0:
            low, at_low, at_high, last = share, value, at_high * (0.5 if last == -1 else 1.0), -1
        else:
            high, at_high, at_low, last = share, value, at_low * (0.5 if last == 1 else 1.0), 1
    return root


def branch_point(equations: LocusEquations, first: Points, second: Points) -> Points:
    """Find the point between two neighbours at which another curve crosses, to 1e-6 of their distance."""

    def measure(point: Points) -> float:
        return float(point.orientation[0])

    small = BRANCH_POINT_RATIO * max(abs(measure(first)), abs(measure(second)))
    root = root_between(equations, first, second, measure, small=small)
    if root is not None:
        return root
    return first if abs(measure(first)) < abs(measure(second)) else second


def branches_at(equations: LocusEquations, crossing: Points) -> list[Points]:
    """Return points of the curve that crosses at a `branch_point`, one on each side."""
    tangent = _second_tangent(equations, crossing)
    points = []
    for direction in () if tangent is None else (tangent, -tangent):
        start = crossing._replace(tangent=direction[None])
        point, good = advance(equations, start, np.array([BRANCH_STEP]), np.zeros_like(start.tangent))
        points += [point] if good[0] else []
    return points


def _second_tangent(equations: LocusEquations, crossing: Points) -> Array | None:
    """Compute the unit tangent (k,) of the other curve at a branch point; None if not real."""
    evaluated = equations.evaluate(crossing.q, crossing.border)
    left, _, right = np.linalg.svd(evaluated.slopes[0])
    tangent = crossing.tangent[0]
    a, b = right[-2:] @ tangent
    normal = a * right[-1] - b * right[-2]  # in the plane of both tangents
    normal /= np.linalg.norm(normal)

    def second(w: Array) -> float:
        ends = equations.move(np.repeat(crossing.q, 2, axis=0), DIFFERENCE_STEP * np.stack([w, -w]))
        values = equations.evaluate(ends, select(crossing.border, np.zeros(2, dtype=np.intp))).values
        return float(left[:, -1] @ (values[0] + values[1] - 2 * evaluated.values[0]) / DIFFERENCE_STEP**2)

    along, across = second(tangent), second(normal)
    mixed = 0.25 * (second(tangent + normal) - second(tangent - normal))
    # w = tangent + r normal with along + 2 mixed r + across r^2 = 0; one root is the curve itself, r = 0
    roots = np.roots([across, 2 * mixed, along])
    if not len(roots) or np.abs(roots.imag).max() > DISTINCT_SOLUTIONS:
        return None
    second_tangent = tangent + roots.real[np.argmax(np.abs(roots))] * normal
    return second_tangent / np.linalg.norm(second_tangent)
