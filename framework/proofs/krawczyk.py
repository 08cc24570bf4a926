"""Krawczyk's test: proof that equations have exactly one solution in a box.

For F(z) = 0 with the Jacobian J, a point z0, a matrix Y near the inverse of J(z0) and radii r, the map
z - Y F(z) takes the box B = z0 + [-r, r] to within

    image = |Y F(z0)| + max over B of |1 - Y J| r

of z0. If image < r entry by entry, F has one solution in B and no other (Krawczyk 1969; Moore 1977; Neumaier,
Interval Methods for Systems of Equations, 1990, section 5.1). The same holds for holomorphic F on discs of
complex numbers (Rump 1983). Where the test fails, the box is made a little larger than its image and tested
again (epsilon-inflation, Rump 2010). Rounding is bounded as `rounding` says.

`prove_existence` is the test of linearised equations in real unknowns, of which one may be a parameter;
`enclose_solutions` that of quadrics with complex solutions. `regular_ball` has its own bound of the image.

A solution of a real system in a disc about a real point is real: its conjugate is in it too, and there is one
alone. A disc away from its mirror image holds a solution that is not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import (
    ROUND_UP,
    WIDENING_RATIO,
    approximate_inverses,
    gamma,
    identity_defect,
)
from framework.proofs.study_quadric import ComplexArray, append_row, matrix_products

MAX_TESTS = 6  # of boxes that are widened until the test holds
MIN_RADIUS, MAX_RADIUS = 1e-300, 1e100  # of discs, away from underflow and overflow
RANDOM_CHARTS = 200


Tested = TypeVar("Tested", bound=Any)  # S boxes: proved (S,), radii (S, k), radii (S, k) of the image


def widen_until_proved(
    test: Callable[[Array], Tested], radii: Array, min_radius: float, max_radius: float
) -> Tested:
    """Test boxes of radii (S, k); widen boxes without a proof, and repeat.

    A wider box contains the image of the one tested.
    """
    tested = test(radii)
    for _ in range(MAX_TESTS - 1):
        if tested.proved.all():
            break
        wider = np.minimum(WIDENING_RATIO * tested.image, max_radius) + min_radius
        tested = test(np.where(tested.proved[:, None], tested.radii, wider))
    return tested


class Existence(NamedTuple):
    """Existence of one solution in S boxes, for each value of the parameter p."""

    proved: BoolArray  # (S,)
    lower: Array  # (S, k) off the middle: all solutions in the box are within
    upper: Array
    along: Array  # (S, k) slope of the solutions along the parameter, 1 for p itself; 0 without a parameter
    spread: Array  # (S, k) distance of the solutions from middle + along * p, 0 for p itself


def prove_existence(
    equations: LinearEnclosure, changes: Array, radii: Array, parameter: IntArray | None
) -> Existence:
    """Test whether m equations have one solution in each of S boxes.

    The unknowns are u (m,), and one parameter p if k = m + 1. With F = values + J_u du + J_p dp within
    errors, and Y near the inverse of J_u, the map takes du to

        root + slope dp + error,    root = -Y values,    slope = -Y J_p,
        |error| <= |Y| (errors + |changes| r) + |1 - Y J_u| r_u.

    Args:
        equations: values and slopes at the middle, with the errors of the values there.
        changes: (S, m, k) bounds on the changes of the slopes within the box.
        parameter: (S,) the unknown that is p; None without.
    """
    m, k = equations.slopes.shape[1:]
    order = np.tile(np.arange(k), (len(radii), 1))  # (S, k) of the unknowns, p last
    if parameter is not None:
        order = np.argsort(order == parameter[:, None], axis=1, kind="stable")
    J_u, J_p = np.split(np.take_along_axis(equations.slopes, order[:, None], axis=2), [m], axis=2)
    r_u, r_p = np.split(np.take_along_axis(radii, order, axis=1), [m], axis=1)
    Y = approximate_inverses(J_u)  # (S, m, m)

    root = -np.matvec(Y, equations.values)  # (S, m)
    slope = -(Y @ J_p)  # (S, m, k - m)
    uncertain = equations.errors + gamma(m) * np.abs(equations.values)
    uncertain = uncertain + np.matvec(changes + gamma(m) * np.abs(equations.slopes), radii)
    error = np.matvec(np.abs(Y), uncertain) + np.matvec(identity_defect(Y, J_u), r_u)
    error = ROUND_UP * error + gamma(m) * np.abs(root)
    reach = ROUND_UP * (error + ROUND_UP * np.matvec(np.abs(slope), r_p))  # of solutions from the root
    is_inside = ROUND_UP * (np.abs(root) + reach) < r_u  # the image in the box

    def restore(of_u: Array, of_p: Array) -> Array:
        """Join values of u (S, m) and p (S, k - m) to vectors (S, k) of all unknowns."""
        return np.take_along_axis(np.hstack([of_u, of_p]), np.argsort(order, axis=1), axis=1)

    return Existence(
        proved=is_inside.all(axis=1) & Y.any(axis=(1, 2)),
        lower=restore(root - reach, -r_p),
        upper=restore(root + reach, r_p),
        along=restore(slope.sum(axis=2), np.ones_like(r_p)),
        spread=restore(ROUND_UP * error + np.abs(root), np.zeros_like(r_p)),
    )


# ------------------------------------------------------------------ quadrics in complex unknowns


class Enclosures(NamedTuple):
    """Polydiscs about S points of P^(N-1), in the chart."""

    proved: BoolArray  # (S,) each holds exactly one solution
    radii: Array  # (S, N)
    image: Array  # (S, N) radii of the image of the polydisc


def enclose_solutions(quadrics: ComplexArray, radii: Array, chart: Array, z: ComplexArray) -> Enclosures:
    """Enclose solutions z (S, N) of N - 1 quadrics with coefficients in discs.

    The equations are F(z) = (z' Q z, chart . z - 1) = 0 for Q (N - 1, N, N), with the Jacobian (2 Q z, chart)
    that changes by 2 |Q| r within radii r. With Y near its inverse the image of a polydisc has the radii

        |Y F(z)| + (|1 - Y J(z)| + |Y| 2 |Q| r) r.

    The proof holds for every system with coefficients in the discs.

    Args:
        quadrics: the middles of the symmetric matrices.
        radii: (N - 1, N, N) of their entries; zero where they are exact as they stand.
        chart: (N,) real and exact, z in it.
    """
    rounding = gamma(2 * len(chart))  # of a quadratic form in complex numbers
    z_size = np.abs(z)  # (S, N)
    Q_size = ROUND_UP * np.abs(quadrics)
    Q_error = rounding * Q_size + radii  # (N - 1, N, N)

    gradients = matrix_products(quadrics, z)  # (S, N - 1, N) Q z
    gradient_errors = matrix_products(Q_error, z_size)
    J = append_row(2 * gradients, chart)  # (S, N, N)
    J_error = append_row(2 * ROUND_UP * gradient_errors, rounding * np.abs(chart))
    residual = np.abs(np.column_stack([np.matvec(gradients, z), z @ chart - 1.0]))  # (S, N) |F(z)|
    residual += ROUND_UP * np.column_stack(
        [np.matvec(gradient_errors, z_size), rounding * (z_size @ np.abs(chart) + 1.0)]
    )
    Y = approximate_inverses(J)
    Y_size = np.abs(Y)
    offset = ROUND_UP**2 * np.matvec(Y_size, residual)  # |Y F(z)|
    defect = identity_defect(Y, J) + Y_size @ J_error  # |1 - Y J(z)|

    def test(r: Array) -> Enclosures:
        """Bound the image of polydiscs of radii r (S, N)."""
        J_change = append_row(2 * ROUND_UP * matrix_products(Q_size + radii, r), 0.0 * chart)
        image = ROUND_UP * (offset + ROUND_UP**2 * np.matvec(defect + Y_size @ J_change, r))
        return Enclosures(np.all(image < r, axis=1), r, image)

    return widen_until_proved(test, 2 * offset + MIN_RADIUS, MIN_RADIUS, MAX_RADIUS)


def choose_chart(z: ComplexArray) -> Array:
    """Choose a random real chart (N,) far from vanishing at all points z (S, N)."""
    charts = np.random.default_rng(0).standard_normal((RANDOM_CHARTS, z.shape[1]))
    charts /= np.linalg.norm(charts, axis=1, keepdims=True)
    heights = np.abs(charts @ z.T) / np.linalg.norm(z, axis=1)
    return charts[np.argmax(heights.min(axis=1, initial=np.inf))]


def are_apart(z: ComplexArray, radii: Array) -> bool:
    """Return whether polydiscs about z (S, N) are pairwise disjoint.

    Two are if their discs of some coordinate do not meet.
    """
    gap = np.abs(z[:, None] - z[None]) / ROUND_UP - radii[:, None] - radii[None]
    disjoint = (gap > 0).any(axis=2) | np.eye(len(z), dtype=bool)
    return bool(disjoint.all())
