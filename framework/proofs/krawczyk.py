"""Krawczyk's test: proof that equations have exactly one solution in a box.

Let F(z) = 0 have the Jacobian J, and Y be near the inverse of J(z0). The map z -> z - Y F(z) takes the box
B = z0 + [-r, r] into a box about z0 with the radii

    image = |Y F(z0)| + max over B of |1 - Y J| r.

If image < r entry by entry, F has exactly one solution in B (Krawczyk 1969; Moore 1977; Neumaier, Interval
Methods for Systems of Equations, 1990, section 5.1). The same holds for holomorphic F on discs of complex
numbers (Rump 1983). If the test fails, it is repeated with a box a little larger than the image
(epsilon-inflation, Rump 2010). All rounding errors are bounded, see `rounding`.

If a real system has exactly one solution in a disc about a real point, this solution is real: its conjugate
lies in the disc, too. If a disc does not meet its mirror image, the solution in it is not real.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import ROUND_UP, WIDENING_RATIO, approximate_inverses, gamma, identity_defect
from framework.proofs.study_quadric import ComplexArray, append_row, matrix_products

MIN_RADIUS, MAX_RADIUS = 1e-14, 10.0  # [rad, robot lengths, or units of z] of widened boxes


class NewtonMap(NamedTuple):
    """The map z -> z - Y F(z) about S points, in k unknowns.

    z is the offset from the point.
    """

    # both real or complex
    Y: Any  # (S, k, k) near the inverse of J at the point; zero where J is singular
    root: Any  # (S, k) value of the map at the point: -Y F
    rounding: Array  # (S, k) bound on the error of `root`
    defect: Array  # (S, k, k) bound on |1 - Y J| at the point

    @staticmethod
    def of(J: Any, values: Any) -> NewtonMap:
        """Return the map for equations with the values F (S, k) and the Jacobian J (S, k, k)."""
        Y = approximate_inverses(J)
        rounding = gamma(2 * values.shape[1]) * np.matvec(np.abs(Y), np.abs(values))
        return NewtonMap(Y, -np.matvec(Y, values), rounding, identity_defect(Y, J))

    @property
    def has_inverse(self) -> BoolArray:
        """Whether J is regular at each point, (S,); otherwise the map proves nothing."""
        return np.asarray(self.Y.any(axis=(1, 2)))

    def errors(self, value_errors: Array, radii: Array) -> Array:
        """Bound the distance (S, k) of the map from `root`, over boxes of radii (S, k).

        At the middle F has `values` and the Jacobian J, and the map is root = -Y values. At the offset z,
        z - Y F(z) = root - Y (F(z) - values - J z) + (1 - Y J) z. `defect` bounds |1 - Y J|, and `rounding`
        the error of `root`.

        Args:
            value_errors: (S, k) bounds on the distance of F from values + J z within the boxes.
        """
        errors = self.rounding + np.matvec(np.abs(self.Y), value_errors) + np.matvec(self.defect, radii)
        return ROUND_UP**2 * errors


# a record of S boxes with proved (S,), hopeless (S,), radii (S, k), image (S, k)
Tested = TypeVar("Tested", bound=Any)


def widen_until_proved(test: Callable[[Array], Tested], radii: Array) -> Tested:
    """Test boxes of radii (S, k); widen boxes without a proof beyond their image, and test again.

    `test` takes radii (S, k) and returns its record of the boxes. At most `max_tests` tests are made, and no
    more once all boxes are proved or hopeless, which no wider one proves. Wider radii are at least
    MIN_RADIUS, and MAX_RADIUS or little more at most.
    """
    max_tests = 6
    tested = test(radii)
    for _ in range(max_tests - 1):
        if (tested.proved | tested.hopeless).all():
            break
        wider = np.minimum(WIDENING_RATIO * tested.image, MAX_RADIUS) + MIN_RADIUS
        tested = test(np.where(tested.proved[:, None], tested.radii, wider))
    return tested


class Existence(NamedTuple):
    """Existence of one solution in S boxes, for each value of the parameter p."""

    proved: BoolArray  # (S,)
    lower: Array  # (S, k) lower bound on all solutions in the box, as an offset from the middle
    upper: Array  # (S, k) upper bound, from the middle too
    along: Array  # (S, k) derivative of the solutions with respect to p; 0 without a parameter
    spread: Array  # (S, k) largest distance of the solutions from middle + along * p


def prove_existence(
    equations: LinearEnclosure, slope_changes: Array, radii: Array, parameter: IntArray | None
) -> Existence:
    """Prove by Krawczyk's test that m equations have one solution in each of S boxes.

    There are k = m unknowns, or k = m + 1 with a parameter p, which takes all values within its radius. The
    equation of the parameter is z_p = p, so the square J (S, k, k) has the unit row of p below the slopes.
    The map z -> z - Y F(z) of this file's docstring takes the box to root + along p + error. Here root is its
    value at the middle, -Y F(0), and along = Y [0; 1] its derivative by p. If this image lies inside the box,
    each p has exactly one solution, and the solution lies in the image.

    Args:
        equations: values and slopes at the middle, with the errors of the values there.
        slope_changes: (S, m, k) bounds on the changes of the slopes within the box.
        radii: (S, k) of the boxes.
        parameter: (S,) index of the unknown p; None without a parameter.
    """
    S, m, k = equations.slopes.shape
    # J, values and errors of m equations and of z_p = p, which is exact; p = 0 at the middle
    parameter_rows = np.zeros((S, 0, k)) if parameter is None else np.eye(k)[parameter][:, None]
    is_parameter = parameter_rows.any(axis=1)  # (S, k)
    J = np.hstack([equations.slopes, parameter_rows])
    exact = np.zeros((S, k - m))  # value and error of z_p = p
    newton = NewtonMap.of(J, np.hstack([equations.values, exact]))
    value_errors = equations.errors + ROUND_UP * np.matvec(slope_changes, radii)  # (S, m)
    errors = newton.errors(np.hstack([value_errors, exact]), radii)  # (S, k)

    # the image of the box
    along = newton.Y[:, :, m:].sum(axis=2)  # (S, k) the column of p, or 0 without p
    p_radius = np.max(radii, axis=1, where=is_parameter, initial=0.0)[:, None]  # (S, 1)
    reach = ROUND_UP * (errors + np.abs(along) * p_radius)  # (S, k) largest distance from the root
    is_inside = ROUND_UP * (np.abs(newton.root) + reach) < radii  # (S, k) the image is in the box
    is_inside |= is_parameter  # p is given, not solved for
    return Existence(
        proved=is_inside.all(axis=1) & newton.has_inverse,
        lower=newton.root - reach,
        upper=newton.root + reach,
        along=along,
        spread=ROUND_UP * (errors + np.abs(newton.root)),
    )


# ------------------------------------------------------------------ quadrics in complex unknowns


class Enclosures(NamedTuple):
    """Polydiscs about S points of the projective space P^(N-1), in a chart: a disc for each coordinate."""

    proved: BoolArray  # (S,) to hold exactly one solution
    hopeless: BoolArray  # (S,) whether the Jacobian at the middle is singular
    radii: Array  # (S, N)
    image: Array  # (S, N) radii of the image of the polydisc


def enclose_solutions(quadrics: ComplexArray, radii: Array, chart: Array, z: ComplexArray) -> Enclosures:
    """Enclose solutions z (S, N) of N - 1 quadrics with coefficients in discs.

    The equations are F(z) = (z' Q z, chart . z - 1) = 0 for Q (N - 1, N, N). Their Jacobian (2 Q z, chart)
    changes by at most 2 |Q| r within radii r. The proof holds for every system with coefficients in the
    discs. Tests begin with twice the image of the point z.

    Args:
        quadrics: the middles of the symmetric matrices Q.
        radii: (N - 1, N, N) of the entries of Q; zero for exact entries.
        chart: (N,) real and exact; z is normalised to chart . z = 1.
    """
    z_size = np.abs(z)
    gradients = matrix_products(quadrics, z)  # (S, N - 1, N) Q z
    F = np.column_stack([np.matvec(gradients, z), z @ chart - 1.0])
    newton = NewtonMap.of(append_row(2 * gradients, chart), F)

    rounding = gamma(2 * len(chart))  # of a quadratic form in complex numbers
    Q_size = ROUND_UP * np.abs(quadrics) + radii
    gradient_errors = matrix_products(rounding * Q_size + radii, z_size)
    chart_error = rounding * (z_size @ np.abs(chart) + 1.0)
    F_errors = np.column_stack([np.matvec(gradient_errors, z_size), chart_error])

    def test(r: Array) -> Enclosures:
        """Bound the image of polydiscs of radii r (S, N)."""
        Qz_errors = gradient_errors + matrix_products(Q_size, r)
        J_errors = append_row(2 * Qz_errors, rounding * np.abs(chart))
        value_errors = F_errors + np.matvec(J_errors, r)  # of F against its linear form at z
        image = ROUND_UP * (np.abs(newton.root) + newton.errors(value_errors, r))
        return Enclosures(np.all(image < r, axis=1) & newton.has_inverse, ~newton.has_inverse, r, image)

    first_image = test(np.zeros_like(F_errors)).image
    return widen_until_proved(test, 2 * first_image + MIN_RADIUS)


def choose_chart(z: ComplexArray) -> Array:
    """Choose a real chart (N,), with chart . z far from 0 at all z (S, N).

    Of `random_charts` unit vectors the chart is the one with the largest minimum of |chart . z| / |z|.
    """
    random_charts = 200
    charts = np.random.default_rng(0).standard_normal((random_charts, z.shape[1]))
    charts /= np.linalg.norm(charts, axis=1, keepdims=True)
    heights = np.abs(charts @ z.T) / np.linalg.norm(z, axis=1)  # (random_charts, S)
    return charts[np.argmax(heights.min(axis=1, initial=np.inf))]


def are_apart(z: ComplexArray, radii: Array) -> bool:
    """Return whether polydiscs of radii (S, N) about z (S, N) are pairwise disjoint.

    Two of them are disjoint if their discs are so in some coordinate.
    """
    distances = np.abs(z[:, None] - z) / ROUND_UP  # (S, S, N), rounded down
    gaps = distances - radii[:, None] - radii
    is_apart = (gaps > 0).any(axis=2)  # (S, S), False on the diagonal
    return int(is_apart.sum()) == len(z) * (len(z) - 1)
