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
    spread: Array  # (S, k) distance of the solutions from middle + along * p


def prove_existence(
    equations: LinearEnclosure, changes: Array, radii: Array, parameter: IntArray | None
) -> Existence:
    """Test whether m equations have one solution in each of S boxes.

    With k = m + 1 unknowns one is a parameter p, whose own equation is d_p = p: so J (S, k, k) has the unit
    row of p below the slopes. With Y near the inverse of J the map takes the box to

        root + along p + error,    root = -Y [values; 0],    along = Y [0; 1],
        |error| <= |Y| [errors + |changes| r; 0] + |1 - Y J| r.

    Args:
        equations: values and slopes at the middle, with the errors of the values there.
        changes: (S, m, k) bounds on the changes of the slopes within the box.
        parameter: (S,) the unknown that is p; None without.
    """
    S, m, k = equations.slopes.shape
    own_rows = np.zeros((S, 0, k)) if parameter is None else np.eye(k)[parameter][:, None]  # (S, k - m, k)
    is_parameter = own_rows.any(axis=1)  # (S, k)
    J = np.concatenate([equations.slopes, own_rows], axis=1)
    Y = approximate_inverses(J)
    along = Y[:, :, m:].sum(axis=2)
    Y_m = Y[:, :, :m]

    root = -np.matvec(Y_m, equations.values)  # (S, k)
    uncertain = equations.errors + gamma(m) * np.abs(equations.values)
    uncertain = uncertain + np.matvec(changes + gamma(m) * np.abs(equations.slopes), radii)
    error = np.matvec(np.abs(Y_m), uncertain) + np.matvec(identity_defect(Y, J), radii)
    error = ROUND_UP * error + gamma(m) * np.abs(root)
    p_radius = np.max(radii, axis=1, where=is_parameter, initial=0.0)[:, None]  # (S, 1)
    reach = ROUND_UP * (error + ROUND_UP * np.abs(along) * p_radius)  # of solutions from the root
    is_inside = ROUND_UP * (np.abs(root) + reach) < radii  # the image in the box
    return Existence(
        proved=(is_inside | is_parameter).all(axis=1) & Y.any(axis=(1, 2)),
        lower=root - reach,
        upper=root + reach,
        along=along,
        spread=ROUND_UP * error + np.abs(root),
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
