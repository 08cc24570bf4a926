"""The polynomial motion law s(t) from its boundary conditions.

The law is solved in normalised time and in the Chebyshev basis. In raw powers of t the twelfth-degree
law of the paper has coefficients of size 400 that cancel, and rounding them to two decimals moves the
end of the motion from s = 1 to s = 1.77.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import InvalidInput, check_order
from framework.numerics.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays
from framework.numerics.chebyshev import derivative_matrix, evaluate, extrema, nodes
from framework.tolerances import INDEPENDENT_CONDITIONS, SAME_PLACE

# Durations [s] whose fourth power and its inverse are far from overflow, with room for all other factors.
MIN_DURATION, MAX_DURATION = 1e-30, 1e30
SEARCH_SAMPLES = 16  # per coefficient of s', where a search among many laws looks at it


def check_duration(duration: float) -> None:
    """Raise InvalidInput unless a duration is a number in [MIN_DURATION, MAX_DURATION] s."""
    if not (is_number(duration) and duration > 0):
        raise InvalidInput(f"duration: must be a positive number of seconds, got {duration!r}")
    if not MIN_DURATION <= duration <= MAX_DURATION:
        raise InvalidInput(f"duration: must lie in [{MIN_DURATION:g}, {MAX_DURATION:g}] s, got {duration!r}")


def is_number(value: object) -> bool:
    """Whether a value is one finite real number, of Python or numpy."""
    if type(value) is float:
        return math.isfinite(value)
    if isinstance(value, bool):
        return False
    return isinstance(value, int | float | np.integer | np.floating) and bool(np.isfinite(value))


class MotionLaw(Protocol):
    """Anything with a `duration` [s] and `law(t, order)`, t of shape (T,), values in [0, 1]."""

    @property
    def duration(self) -> float: ...

    def __call__(self, t: ArrayLike, order: int = 0) -> Array: ...


class ExactLaw(ABC):
    """A motion law of this package, whose derivatives are exact and need no check."""

    @property
    def edges(self) -> Array:
        """Instants (k,) [s], ends included, between which some thirty points resolve the law.

        Empty for a law that needs no panels.
        """
        return np.empty(0)

    @abstractmethod
    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return s(t) or its derivative [1/s^order], with the shape of t."""


class PlannedLaw(ExactLaw):
    """An exact law that plans choose and files can store.

    `kind` is its name in files, `coefficients` are those of its Chebyshev series or splines.
    """

    kind: ClassVar[str]
    coefficients: Array
    duration: float

    @property
    def degree(self) -> int:
        """Return the degree of the polynomials that the coefficients multiply."""
        return len(self.coefficients) - 1

    @abstractmethod
    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        """Return s and its time derivatives up to order `count` - 1.

        Each has the shape of t [1/s^order].
        """

    @abstractmethod
    def advance(self, smoothness: int) -> float:
        """Return the least s' over its mean; positive if monotone.

        The zeros of s' at both ends are divided out.
        """

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""


def edges_of(law: MotionLaw) -> Array:
    """Return the edges (k,) [s] of an exact law; none of other laws."""
    return law.edges if isinstance(law, ExactLaw) else np.empty(0)


def law_derivatives(law: MotionLaw, t: ArrayLike, count: int = 3) -> list[Array]:
    """Compute s and its derivatives up to order `count` - 1 of any law.

    Each has the shape of t [1/s^order].
    """
    if isinstance(law, PlannedLaw):
        return law.derivatives(t, count)
    return [np.asarray(law(t, order)) for order in range(count)]


class Condition(NamedTuple):
    """The derivative of the given `order` of s is `value` [1/s^order] at `time` [s]."""

    time: float
    order: int
    value: float


def conditions_at_instants(times: Iterable[float], values: Iterable[Iterable[float]]) -> list[Condition]:
    """Return the conditions that s and its derivatives have `values` (k, m) at times (k,)."""
    return [
        Condition(float(time), order, float(value))
        for time, derivatives in zip(times, values, strict=True)
        for order, value in enumerate(derivatives)
    ]


@dataclass(frozen=True, eq=False)
class Law(ReadOnlyArrays, PlannedLaw):
    """Polynomial law: Chebyshev `coefficients` (degree + 1,) on [0, `duration`] [s]."""

    coefficients: Array
    duration: float

    kind: ClassVar[str] = "polynomial"

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return s(t) or its derivative [1/s^order], with the shape of t.

        Raises:
            InvalidInput: t lies outside [0, duration], where the polynomial means nothing, or is not finite.
        """
        check_order(order)
        x = self._normalise(t)
        return evaluate(x.ravel(), self._series(order)[:, None]).reshape(x.shape)

    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        """Compute s and its time derivatives of orders 0 .. count - 1, each shaped like t [1/s^order]."""
        series = np.stack([self._series(order) for order in range(count)], axis=1)
        x = self._normalise(t)
        return list(evaluate(x.ravel(), series).T.reshape(count, *x.shape))

    def _normalise(self, t: ArrayLike) -> Array:
        """Return the normalised times x = 2 t / duration - 1 in [-1, 1]; refuse t outside the duration."""
        x = np.asarray(t, dtype=float) * (2.0 / self.duration) - 1.0
        if not np.all(np.abs(x) <= 1.0 + SAME_PLACE):
            raise InvalidInput(f"time {t!r} is outside [0, {self.duration:g}] s")
        return np.minimum(np.maximum(x, -1.0), 1.0)

    def _series(self, order: int) -> Array:
        """Return the Chebyshev series (degree + 1,) [1/s^order] of a time derivative."""
        if not order:
            return self.coefficients
        scale = (2.0 / self.duration) ** order
        return scale * (derivative_matrix(len(self.coefficients), order) @ self.coefficients)

    @staticmethod
    def from_conditions(conditions: Sequence[Condition], duration: float) -> Law:
        """Solve for the law of least degree that meets the conditions.

        The degree is one less than their number. The unknown Chebyshev coefficients solve one linear equation
        a condition, in normalised time.

        Raises:
            InvalidInput: the duration is not positive, a condition is not finite or lies outside
                [0, duration], or two of them contradict or repeat each other.
        """
        check_duration(duration)
        for time, order, value in conditions:
            if not (is_number(value) and is_number(time) and 0 <= time <= duration):
                raise InvalidInput(
                    f"condition s^({order})({time!r}) = {value!r} must be finite and inside "
                    f"[0, {duration:g}] s"
                )
        scale = 2.0 / duration
        rows, inverse, row_sizes = _condition_rows(
            tuple((time * scale - 1.0, order) for time, order, _ in conditions)
        )
        orders = np.array([order for _, order, _ in conditions])
        # with more digits than a float has, where the machine has them
        values = np.array([value for *_, value in conditions], np.longdouble)
        right_side = values / scale**orders / row_sizes
        solution = inverse @ right_side
        for _ in range(2):  # iterative refinement: rows of high order are ill-conditioned
            solution += inverse @ (right_side - rows @ solution)
        return Law(solution.astype(float), duration)

    @staticmethod
    def rest_to_rest(duration: float, smoothness: int, inner: Sequence[Condition] = ()) -> Law:
        """Return the law from s(0) = 0 to s(duration) = 1 that meets the conditions `inner`.

        At both ends the derivatives of s up to order `smoothness` are zero.
        Degree 2 (smoothness + 1) + len(inner) - 1: with the three conditions of one crossing 8 for a
        rigid robot (smoothness 2) and 12 for an elastic one (4), as counted by Briot and Arakelian
        2010, Eqs. (19)-(31).
        """
        ends = [
            Condition(time, order, value if order == 0 else 0.0)
            for time, value in ((0.0, 0.0), (duration, 1.0))
            for order in range(smoothness + 1)
        ]
        return Law.from_conditions([*ends, *inner], duration)

    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""
        return {
            "degree": self.degree,
            "chebyshev": self.coefficients.tolist(),
            "domain": [0.0, self.duration],
        }

    def advance(self, smoothness: int) -> float:
        """Return the least p(x) on [-1, 1] over the mean of |p|, where s' = (1 - x^2)^smoothness p(x).

        Positive for a monotone law. x = 2 t / T - 1 is the normalised time. At rest at the ends s' has the
        zeros of (1 - x^2)^smoothness; these are divided out, so that rounding does not decide the sign near
        the ends.
        """
        return _least_over_mean(_divide_out_ends(self.degree, smoothness) @ self.coefficients)


def advances_and_peaks(duration: float, smoothness: int, times: Array, values: Array) -> tuple[Array, Array]:
    """Return `Law.advance` (m,) and the peak of |s"| (m,) [1/s^2] of m laws of `rest_to_rest`.

    Both are estimates on samples, for a search among many laws. s' = (1 - x^2)^smoothness p(x) with x in
    [-1, 1] is at rest at both ends for all p. So p has to meet s(1) = 1 and the inner conditions only: its
    Chebyshev coefficients solve one linear equation each.

    Args:
        times: (m, k) [s], of the inner conditions.
        values: (m, k, 3) of s, s' and s" at these times.

    Returns:
        The advance is negative infinity where conditions repeat or contradict each other.
    """
    count = len(times)
    scale = 2.0 / duration
    end = np.ones((count, 1))  # both x and s at the end
    x = np.append(np.repeat(times * scale - 1.0, 3, axis=1), end, axis=1)  # (m, c), c = 3 k + 1
    orders = np.append(np.tile(np.arange(3), times.shape[1]), 0)  # (c,)
    targets = np.append(values.reshape(count, len(orders) - 1), end, axis=1) / scale**orders  # (m, c)
    rows = _rows_of_laws_at_rest(smoothness, x, orders)
    is_regular = np.linalg.det(rows) != 0.0
    series = np.linalg.solve(rows[is_regular], targets[is_regular][..., None])[..., 0]  # of p
    p, accelerations = np.split(series @ _search_samples(smoothness, len(orders)), 2, axis=1)
    mean = np.abs(series @ _interior_values(len(orders)).T).mean(axis=1)
    advances = np.full(count, -np.inf)
    peaks = np.full(count, np.inf)
    advances[is_regular] = p.min(axis=1) / mean
    peaks[is_regular] = np.abs(accelerations).max(axis=1) * scale**2
    return advances, peaks


def _rows_of_laws_at_rest(smoothness: int, x: Array, orders: IntArray) -> Array:
    """Return the matrices (m, c, c) from coefficients of p to derivatives of s.

    Row i of a matrix is that of the derivative of order `orders[i]` at x[:, i], x (m, c). Each is a Chebyshev
    series of degree n - 1, with T_k(x) = cos(k arccos x).
    """
    integrals = _rest_integrals(smoothness, len(orders))[orders]  # (c, n, c) series of each row
    angles = np.arccos(np.clip(x, -1.0, 1.0)).T[..., None]  # (c, m, 1)
    polynomials = np.cos(angles * np.arange(integrals.shape[1]))  # (c, m, n) values of T_k
    return (polynomials @ integrals).swapaxes(0, 1)


def _least_over_mean(series: Array) -> float:
    """Return the least value on [-1, 1] of a Chebyshev series (size,) over its mean absolute value.

    The least value is at an end, where T_k is 1 or (-1)^k, or at a zero of the derivative.
    """
    at_plus_one = np.sum(series)
    at_minus_one = np.sum(series[::2]) - np.sum(series[1::2])
    at_extrema = evaluate(extrema(series), series)
    mean = np.mean(np.abs(_interior_values(len(series)) @ series))
    return float(min(at_plus_one, at_minus_one, at_extrema.min(initial=np.inf)) / mean)


@lru_cache(maxsize=64)
def _condition_rows(conditions: tuple[tuple[float, int], ...]) -> tuple[Array, Array, Array]:
    """Return the rows (k, k) of k conditions on k coefficients.

    Their inverse and their sizes (k,) come with them. A condition (x, order) has the derivatives of all T_j
    at x as its row. Each row is divided by its size, the largest absolute entry.

    Raises:
        InvalidInput: rows are linearly dependent.
    """
    count = len(conditions)
    x = np.array([x for x, _ in conditions])
    derivatives = np.array([derivative_matrix(count, order) for _, order in conditions])  # (k, k, k)
    rows = np.einsum("ij,ijk->ik", chebyshev.chebvander(x, count - 1), derivatives)  # T_j(x_i) times D_i
    sizes = np.abs(rows).max(axis=1)
    rows /= np.where(sizes > 0, sizes, 1.0)[:, None]
    U, S, V_rows = np.linalg.svd(rows)
    if not S[-1] > INDEPENDENT_CONDITIONS:
        raise InvalidInput(
            "the conditions on the law repeat or contradict each other, or are too near to each other in time"
        )
    return rows, (V_rows.T / S) @ U.T, sizes


@lru_cache(maxsize=64)
def _interior_values(size: int) -> Array:
    """Return the matrix (2 size + 2, size) from Chebyshev coefficients to values at nodes inside (-1, 1)."""
    return np.asarray(chebyshev.chebvander(nodes(2 * size + 4)[1:-1], size - 1), dtype=float)


@lru_cache(maxsize=64)
def _search_samples(smoothness: int, size: int) -> Array:
    """Return the matrix (size, 2 m) from coefficients of p to samples.

    The first m are samples of p, the last m of d2s/dx2.
    """
    second_derivatives = _rest_integrals(smoothness, size)[2]  # (n, size)
    polynomials = chebyshev.chebvander(nodes(SEARCH_SAMPLES * size), len(second_derivatives) - 1)
    return np.vstack([polynomials[:, :size], polynomials @ second_derivatives]).T


@lru_cache(maxsize=64)
def _divide_out_ends(degree: int, smoothness: int) -> Array:
    """Return the matrix from coefficients of s to the series of p.

    p is s'(x) / (1 - x^2)^smoothness. The series is fitted to values of p at nodes inside (-1, 1), where the
    division is possible.
    """
    size = max(degree - 2 * smoothness, 1)
    x = nodes(2 * size + 4)[1:-1]
    slopes = chebyshev.chebvander(x, degree) @ derivative_matrix(degree + 1)
    quotients = slopes / ((1 - x**2)[:, None]) ** smoothness
    return np.linalg.pinv(_interior_values(size)) @ quotients


@lru_cache(maxsize=64)
def _rest_integrals(smoothness: int, size: int) -> Array:
    """Return the series (3, n, size) of s, ds/dx and d2s/dx2 for p = T_k.

    k runs from 0 to size - 1. s is the integral of (1 - x^2)^smoothness p(x) from -1.
    """
    bump = chebyshev.chebpow([0.5, 0.0, -0.5], smoothness)  # 1 - x^2 = (1 - T_2) / 2
    integrals = np.zeros((2 * smoothness + size + 1, size))
    for k, unit_vector in enumerate(np.eye(size)):
        T_k = unit_vector[: k + 1]
        series = chebyshev.chebint(chebyshev.chebmul(bump, T_k), lbnd=-1)
        integrals[: len(series), k] = series
    return np.array([derivative_matrix(len(integrals), order) @ integrals for order in range(3)])
