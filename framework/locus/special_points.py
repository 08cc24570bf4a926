"""Special points of a traced curve: where a measure along it vanishes, and where another curve crosses.

Where det [dF/du ; t'] changes its sign between two points another curve crosses. The simple branch point is
bracketed, and the second tangent found from the algebraic bifurcation equation psi' F" (w, w) = 0 over the
plane of both (Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chapter 8).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.arrays import Array
from framework.locus.curve_tracing import Points, advanced
from framework.locus.locus_equations import Borders, LocusEquations
from framework.tolerances import DISTINCT_SOLUTIONS

# of det [dF/du ; t'] at the neighbours: nearer to a branch point the corrector loses its digits
BRANCH_POINT_RATIO = 1e-6
DIFFERENCE_STEP = 1e-3  # [rad, lengths] of second differences there
BRANCH_STEP = 0.02  # [rad, lengths] to the first point of the other curve
ROOT_SIZE, MAX_ROOT_STEPS = 1e-13, 40  # of a measure without dimension between two points


class Between:
    """The curve between two neighbouring points (S = 1), by the share of the way from one to the other."""

    def __init__(self, equations: LocusEquations, first: Points, second: Points) -> None:
        self.equations, self.start = equations, first
        self.whole = float(np.linalg.norm(equations.apart(first.q[0], second.q[0])))
        self.bend = (second.tangent - first.tangent) / self.whole

    def at(self, share: float) -> Points | None:
        """Return the point at a share of the way; None where the corrector does not lead to it."""
        points, good = advanced(self.equations, self.start, np.array([share * self.whole]), self.bend)
        return points if good[0] else None


def root_between(
    equations: LocusEquations,
    first: Points,
    second: Points,
    measure: Callable[[Points], float],
    *,
    small: float = ROOT_SIZE,
) -> Points | None:
    """Find the point between two neighbours at which a measure, of opposite signs there, vanishes.

    False position (the Illinois variant) on the share of the way, until the measure is `small`. None where
    the corrector does not lead to it; near a branch point that is the last point that it led to.
    """
    between = Between(equations, first, second)
    low, high, at_low, at_high = 0.0, 1.0, measure(first), measure(second)
    root, last = None, 0  # which end was replaced last
    for _ in range(MAX_ROOT_STEPS):
        share = (low * at_high - high * at_low) / (at_high - at_low)
        point = between.at(share)
        if point is None:
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
    """Return points of the curve that crosses at a `branch_point`, one on each side of it."""
    evaluated = equations.at(crossing.q, crossing.border)
    left, _, right = np.linalg.svd(evaluated.slopes[0])
    tangent = crossing.tangent[0]
    a, b = right[-2:] @ tangent
    normal = a * right[-1] - b * right[-2]  # in the plane of both tangents
    normal /= np.linalg.norm(normal)

    def second(w: Array) -> float:
        ends = equations.moved(np.repeat(crossing.q, 2, axis=0), DIFFERENCE_STEP * np.stack([w, -w]))
        border = Borders(*(np.repeat(part, 2, axis=0) for part in crossing.border))
        values = equations.at(ends, border).values
        return float(left[:, -1] @ (values[0] + values[1] - 2 * evaluated.values[0]) / DIFFERENCE_STEP**2)

    along, across = second(tangent), second(normal)
    mixed = 0.25 * (second(tangent + normal) - second(tangent - normal))
    # w = tangent + r normal with along + 2 mixed r + across r^2 = 0; one root is the curve itself, r = 0
    roots = np.roots([across, 2 * mixed, along])
    if not len(roots) or np.abs(roots.imag).max() > DISTINCT_SOLUTIONS:
        return []
    branch_tangent = tangent + roots.real[np.argmax(np.abs(roots))] * normal
    branch_tangent /= np.linalg.norm(branch_tangent)
    points = []
    for direction in (branch_tangent, -branch_tangent):
        start = crossing._replace(tangent=direction[None])
        point, good = advanced(equations, start, np.array([BRANCH_STEP]), np.zeros_like(start.tangent))
        points += [point] if good[0] else []
    return points
