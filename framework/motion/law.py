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

from framework.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.errors import InvalidInput, check_order
from framework.motion.chebyshev import derivative_matrix, evaluate, extrema, nodes
from framework.tolerances import INDEPENDENT_CONDITIONS, SAME_PLACE

# Durations [s] whose fourth power and its inverse are far from overflow, with room for all other factors.
MIN_DURATION, MAX_DURATION = 1e-30, 1e30
SEARCH_SAMPLES = 16  # per coefficient of s', where a search among many laws looks at it


def check_duration(duration: float) -> None:
    """Raise InvalidInput unless the duration is a positive number of seconds that a law can be made for."""
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


class PlannedLaw(ABC):
    """A law of this package, with exact derivatives, that can be written to a file.

    `kind` names it, `coefficients` (degree + 1,) are those of its Chebyshev series.
    """

    kind: ClassVar[str]
    coefficients: Array
    duration: float

    @property
    def degree(self) -> int:
        """Return the degree of its series."""
        return len(self.coefficients) - 1

    @property
    def edges(self) -> Array:
        """Instants (k,) [s], ends included, between which some thirty points resolve the law.

        Empty for a law that needs no panels.
        """
        return np.empty(0)

    @abstractmethod
    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return s(t) or its derivative [1/s^order], with the shape of t."""

    @abstractmethod
    def orders(self, t: ArrayLike, count: int) -> list[Array]:
        """Return s and its first derivatives, `count` in all, each with the shape of t."""

    @abstractmethod
    def advance(self, smoothness: int) -> float:
        """Return the least s' over its mean, the zeros at the ends divided out."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""


def orders_of(law: MotionLaw, t: ArrayLike, count: int = 3) -> list[Array]:
    """Return s and its first time derivatives, `count` in all, of any law, each with the shape of t."""
    if isinstance(law, PlannedLaw):
        return law.orders(t, count)
    return [np.asarray(law(t, order)) for order in range(count)]


class Condition(NamedTuple):
    """The derivative of the given `order` of s is `value` [1/s^order] at `time` [s]."""

    time: float
    order: int
    value: float


def conditions_at_instants(times: Iterable[float], values: Iterable[Iterable[float]]) -> list[Condition]:
    """Return conditions: s and its derivatives have `values` (k, m) at times (k,)."""
    return [
        Condition(float(time), order, float(value))
        for time, orders in zip(times, values, strict=True)
        for order, value in enumerate(orders)
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
        local = self._local(t)
        return evaluate(local.ravel(), self._series(order)[:, None]).reshape(local.shape)

    def orders(self, t: ArrayLike, count: int) -> list[Array]:
        series = np.stack([self._series(order) for order in range(count)], axis=1)
        local = self._local(t)
        return list(evaluate(local.ravel(), series).T.reshape(count, *local.shape))

    def _local(self, t: ArrayLike) -> Array:
        """Return instants t as places in [-1, 1]."""
        local = np.asarray(t, dtype=float) * (2.0 / self.duration) - 1.0
        if not np.all(np.abs(local) <= 1.0 + SAME_PLACE):
            raise InvalidInput(f"time {t!r} is outside [0, {self.duration:g}] s")
        return np.minimum(np.maximum(local, -1.0), 1.0)

    def _series(self, order: int) -> Array:
        """Return the series (degree + 1,) of a derivative."""
        if not order:
            return self.coefficients
        scale = (2.0 / self.duration) ** order
        return np.asarray(scale * (derivative_matrix(len(self.coefficients), order) @ self.coefficients))

    @staticmethod
    def from_conditions(conditions: Sequence[Condition], duration: float) -> Law:
        """Solve for the law of least degree, one less than the number of conditions.

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
        rows, inverse, sizes = _condition_rows(
            tuple((time * scale - 1.0, order) for time, order, _ in conditions)
        )
        orders = np.array([order for _, order, _ in conditions])
        values = np.array([value for *_, value in conditions]) / scale**orders / sizes
        solution = inverse @ values
        for _ in range(2):  # the rows are of very different slope: refine away what the inverse lost
            solution += inverse @ (values - rows @ solution)
        return Law(np.asarray(solution, dtype=float), duration)

    @staticmethod
    def rest_to_rest(duration: float, smoothness: int, inner: Sequence[Condition] = ()) -> Law:
        """Return the law from s = 0 to s = 1 through `inner`, `smoothness` derivatives zero at both ends.

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
        """Return the smallest of s'(t) / (t (T - t))^smoothness on [0, T], over its mean; positive: monotone.

        The zeros that the ends force on s' are divided out first, so that the sign near the ends is
        decided by the law and not by rounding.
        """
        return _least_over_mean(_divide_out_ends(self.degree, smoothness) @ self.coefficients)


def laws_through(duration: float, smoothness: int, times: Array, values: Array) -> tuple[Array, Array]:
    """Return `Law.advance` and the peak of s", on samples, of many laws of `rest_to_rest`, for a search.

    s' = (1 - x^2)^smoothness p(x) with x in [-1, 1] is at rest at both ends whatever p is, so that s(1) = 1
    and the inner conditions are all that p has to meet.

    Args:
        times: (m, k) [s], of the inner conditions.
        values: (m, k, 3) of s, s' and s" there.

    Returns:
        Both (m,), the second in [1/s^2]. Where conditions repeat or contradict each other, the first is
        negative infinity.
    """
    count, scale = len(times), 2.0 / duration
    places = np.append(np.repeat(times * scale - 1.0, 3, axis=1), np.ones((count, 1)), axis=1)
    orders = np.append(np.tile(np.arange(3), times.shape[1]), 0)
    integrals = _integrals(smoothness, len(orders))[orders]
    angles = np.arccos(np.clip(places, -1.0, 1.0))
    basis = np.cos(angles.T[..., None] * np.arange(integrals.shape[1]))
    rows = (basis @ integrals).swapaxes(0, 1)
    right = np.append(values.reshape(count, len(orders) - 1), np.ones((count, 1)), axis=1) / scale**orders
    regular = np.linalg.det(rows) != 0.0
    series = np.linalg.solve(rows[regular], right[regular][..., None])[..., 0]
    slopes, bends = np.split(series @ _search_samples(smoothness, len(orders)), 2, axis=1)
    advances, peaks = np.full(count, -np.inf), np.full(count, np.inf)
    advances[regular] = slopes.min(axis=1) / np.abs(series @ _inside(len(orders)).T).mean(axis=1)
    peaks[regular] = np.abs(bends).max(axis=1) * scale**2
    return advances, peaks


def _least_over_mean(series: Array) -> float:
    """Return the least value on [-1, 1] of a Chebyshev series (size,), over the mean of its size."""
    ends = np.sum(series), np.sum(series[::2]) - np.sum(series[1::2])
    turning = evaluate(extrema(series), series)
    return float(min(*ends, turning.min(initial=np.inf)) / np.mean(np.abs(_inside(len(series)) @ series)))


@lru_cache(maxsize=64)
def _condition_rows(places: tuple[tuple[float, int], ...]) -> tuple[Array, Array, Array]:
    """Return rows (k, k) of derivatives of Chebyshev polynomials at (x, order), their inverse and divisors.

    Raises:
        InvalidInput: two rows repeat each other.
    """
    count = len(places)
    instants, orders = np.array([x for x, _ in places]), [order for _, order in places]
    derivatives = np.array([derivative_matrix(count, order) for order in orders])
    rows = np.einsum("ij,ijk->ik", chebyshev.chebvander(instants, count - 1), derivatives)
    sizes = np.abs(rows).max(axis=1)
    rows /= np.where(sizes > 0, sizes, 1.0)[:, None]
    left, values, right = np.linalg.svd(rows)
    if not values[-1] > INDEPENDENT_CONDITIONS:
        raise InvalidInput(
            "the conditions on the law repeat or contradict each other, or are too near to each other in time"
        )
    return rows, (right.T / values) @ left.T, sizes


@lru_cache(maxsize=64)
def _inside(size: int) -> Array:
    """Return the matrix from Chebyshev coefficients (size,) to values at more points inside [-1, 1]."""
    return np.asarray(chebyshev.chebvander(nodes(2 * size + 4)[1:-1], size - 1), dtype=float)


@lru_cache(maxsize=64)
def _search_samples(smoothness: int, size: int) -> Array:
    """Return the matrix (size, 2 m) from coefficients of p to samples (m,) of p and of s"."""
    local, bends = nodes(SEARCH_SAMPLES * size), _integrals(smoothness, size)[2]
    polynomials = chebyshev.chebvander(local, len(bends) - 1)
    return np.vstack([polynomials[:, :size], polynomials @ bends]).T


@lru_cache(maxsize=64)
def _divide_out_ends(degree: int, smoothness: int) -> Array:
    """Return the matrix from the coefficients of s to the series of s'(x) / (1 - x^2)^smoothness."""
    size = max(degree - 2 * smoothness, 1)
    local = nodes(2 * size + 4)[1:-1]
    slopes = chebyshev.chebvander(local, degree) @ derivative_matrix(degree + 1)
    return np.asarray(np.linalg.pinv(_inside(size)) @ (slopes / ((1 - local**2)[:, None]) ** smoothness))


@lru_cache(maxsize=64)
def _integrals(smoothness: int, size: int) -> Array:
    """Return the series (n, size) of the integrals of (1 - x^2)^smoothness T_k(x), and two derivatives."""
    ends = chebyshev.chebpow([0.5, 0.0, -0.5], smoothness)  # 1 - x^2 = (1 - T_2) / 2
    integrals = np.zeros((2 * smoothness + size + 1, size))
    for k, unit in enumerate(np.eye(size)):
        series = chebyshev.chebint(chebyshev.chebmul(ends, unit[: k + 1]), lbnd=-1)
        integrals[: len(series), k] = series
    return np.array([derivative_matrix(len(integrals), order) @ integrals for order in range(3)])
