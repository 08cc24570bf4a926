"""Motion laws s(t): their protocol, and the polynomial law that meets given conditions.

The polynomial is solved in the Chebyshev basis over normalised time, because powers of t are ill-conditioned:
the twelfth-degree law of the paper has coefficients of size 400 that cancel, and rounding them to two
decimals moves the end of the motion from s = 1 to s = 1.77.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from math import comb, isfinite
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import (
    LARGEST_NUMBER,
    InvalidInput,
    check_order,
    finite_numbers,
    real_numbers,
    whole_number,
)
from framework.numerics.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import derivative_matrix, evaluate, extrema, nodes
from framework.numerics.ordered_sums import solve
from framework.tolerances import INDEPENDENT_CONDITIONS, SAME_PLACE

DEGREES_PER_PANEL = 12  # of a law; below twice as many a single panel is enough
NO_HIGH = read_only(np.empty(0))  # coefficients of a law of least degree above that degree


def check_duration(duration: float, name: str = "duration") -> None:
    """Raise InvalidInput unless a duration called `name` is in [1 / LARGEST_NUMBER, LARGEST_NUMBER] s."""
    shortest = 1.0 / LARGEST_NUMBER
    if (type(duration) is not float and not is_number(duration)) or not duration > 0:
        raise InvalidInput(f"{name}: must be a positive number of seconds, got {duration!r}")
    if not shortest <= duration <= LARGEST_NUMBER:
        raise InvalidInput(f"{name}: must lie in [{shortest:g}, {LARGEST_NUMBER:g}] s, got {duration!r}")


def is_number(value: object) -> bool:
    """Return whether a value is a single finite real number of Python or numpy."""
    if type(value) is float:
        return isfinite(value)
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return isfinite(value)
    except OverflowError:  # a whole number beyond the range of floats
        return False


def normalise_time(t: ArrayLike, duration: float) -> Array:
    """Return the normalised time x = 2 t / duration - 1 in [-1, 1], with the shape of t.

    Raises:
        InvalidInput: t is not finite, or outside [0, duration].
    """
    x = real_numbers("t", t) * (2.0 / duration) - 1.0
    if not (np.abs(x) <= 1.0 + SAME_PLACE).all():
        raise InvalidInput(f"time {t!r} is outside [0, {duration:g}] s")
    return x.clip(-1.0, 1.0)


class MotionLaw(Protocol):
    """Any object with a `duration` [s] and a call `law(t, order)`.

    The call returns the path coordinate s in [0, 1], or its time derivative of this order, with the shape
    (T,) of t. Torques need it smooth between the knots of the path: no jumps of s", as a trapezoid has.
    """

    @property
    def duration(self) -> float: ...

    def __call__(self, t: ArrayLike, order: int = 0) -> Array: ...


class Ends(NamedTuple):
    """The derivatives of s at both ends of a law: s', s", ... [1/s^order]; none at an end at rest.

    Derivatives beyond the last stated one vanish, up to the smoothness of the law. More than these may be
    stated.
    """

    start: tuple[float, ...] = ()
    goal: tuple[float, ...] = ()

    @property
    def moving(self) -> tuple[bool, bool]:
        """Whether start and goal are in motion."""
        return bool(self.start), bool(self.goal)

    def zeros(self, smoothness: int) -> tuple[int, int]:
        """Return the order of the zero of s' at each end: `smoothness` at rest, 0 in motion."""
        return 0 if self.start else smoothness, 0 if self.goal else smoothness

    def derivatives(self, orders: int) -> Array:
        """Return the first derivatives (2, orders) of s at the start and at the goal [1/s^order]."""
        return np.array([[*end, *[0.0] * orders][:orders] for end in self])

    def conditions(self, smoothness: int) -> tuple[Array, Array]:
        """Return s and its given derivatives at the start and at the goal, (a,) and (b,) [1/s^order]."""
        start, goal = (np.array([s, *end, *[0.0] * (smoothness - len(end))]) for s, end in enumerate(self))
        return start, goal

    def least_degree(self, smoothness: int, crossings: int) -> int:
        """Return the degree of the polynomial with s, s' and s" at each crossing."""
        return sum(map(len, self.conditions(smoothness))) + 3 * crossings - 1


REST = Ends()


class ExactLaw(ABC):
    """A motion law of this package: its derivatives are exact and need no check."""

    @property
    def edges(self) -> Array:
        """Panel edges (k,) [s], ends included; empty for a law that needs no panels.

        Some thirty Chebyshev points resolve the law on each panel.
        """
        return np.empty(0)

    @abstractmethod
    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return s(t) or its derivative [1/s^order], with the shape of t."""


class PlannedLaw(ExactLaw):
    """An exact law that plans can choose and files can store.

    `kind` is the law's name in files; `coefficients` multiply its Chebyshev polynomials or splines.
    """

    kind: ClassVar[str]
    coefficients: Array
    duration: float

    @property
    def degree(self) -> int:
        """The degree of the law's polynomials."""
        return len(self.coefficients) - 1

    @abstractmethod
    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        """Return s and its time derivatives of orders below `count`, each shaped like t [1/s^order]."""

    @abstractmethod
    def least_speed_ratio(self, smoothness: int, ends: Ends = REST) -> float:
        """Return the least s' divided by the mean |s'|, without the zeros at the ends.

        The factors of s' that vanish at ends at rest are divided out first. The result is positive for a
        monotone law, and small if the law nearly stops.

        Args:
            smoothness: number of derivatives of s that vanish at an end at rest.
            ends: which of them are in motion.
        """

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""


def edges_of(law: MotionLaw) -> Array:
    """Return the panel edges (k,) [s] of an exact law; empty for other laws."""
    return law.edges if isinstance(law, ExactLaw) else np.empty(0)


def law_derivatives(law: MotionLaw, t: ArrayLike, count: int = 3) -> list[Array]:
    """Compute s and its derivatives of orders below `count`, each shaped like t [1/s^order]."""
    if isinstance(law, PlannedLaw):
        return law.derivatives(t, count)
    return [np.asarray(law(t, order)) for order in range(count)]


def compose_derivatives(outer: Sequence[Array], inner: Sequence[Array]) -> list[Array]:
    """Compute the derivatives of f(g(t)) by t, of orders 0 .. n.

    Let F_k(t) = f^(k)(g(t)). By the chain rule F_k' = F_(k+1) g'. By Leibniz's rule for this product, the
    derivative of order m of F_k is the sum over i < m of

        binom(m - 1, i) F_(k+1)^(i) g^(m-i).

    Args:
        outer: f and its derivatives by its argument, at g(t), of orders 0 .. n.
        inner: derivatives of g by t, of orders 1 .. n.

    Returns:
        n + 1 arrays, with the shape of the arguments broadcast.
    """

    by_order = [list(outer)]  # F_k for k = 0 .. n, then derivatives of order m for k = 0 .. n - m
    for m in range(1, len(outer)):
        derivatives = []
        for k in range(len(outer) - m):
            total = inner[m - 1] * outer[k + 1]  # i = 0; inner[j - 1] is g^(j)
            for i in range(1, m):
                total = total + comb(m - 1, i) * inner[m - i - 1] * by_order[i][k + 1]
            derivatives.append(total)
        by_order.append(derivatives)
    return [derivatives[0] for derivatives in by_order]


class Condition(NamedTuple):
    """The time derivative of s of this `order` equals `value` [1/s^order] at `time` [s]."""

    time: float
    order: int
    value: float


def conditions_at_instants(times: Iterable[float], values: Iterable[Iterable[float]]) -> list[Condition]:
    """Return conditions that set s and its derivatives at times (k,) [s] to `values` (k, m) [1/s^order].

    Column j of the values is the derivative of order j.
    """
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

    def __post_init__(self) -> None:
        """Refuse a duration that is not positive, and coefficients that are no finite numbers in a row."""
        ReadOnlyArrays.__post_init__(self)
        check_duration(self.duration)
        values = self.coefficients
        is_row = type(values) is np.ndarray and values.dtype == float and values.ndim == 1 and values.size
        if not is_row or not values @ values <= LARGEST_NUMBER**2:
            values = finite_numbers("coefficients", values, np.size(values) or 1)
            self.__dict__["coefficients"] = read_only(values)

    @property
    def edges(self) -> Array:
        """Panel edges (k,) [s] of a law of high degree, Chebyshev nodes; empty for others."""
        panels = self.degree // DEGREES_PER_PANEL
        return 0.5 * self.duration * (nodes(panels + 1) + 1.0) if panels > 1 else np.empty(0)

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return s(t) or its derivative [1/s^order], with the shape of t.

        Raises:
            InvalidInput: t is not finite, or outside [0, duration], where the polynomial is no motion.
        """
        check_order(order)
        x = normalise_time(t, self.duration)
        order = min(order, len(self.coefficients))  # all further derivatives are zero, too
        scale = (2.0 / self.duration) ** order
        series = scale * (derivative_matrix(len(self.coefficients), order) @ self.coefficients)
        return evaluate(x.ravel(), series[:, None]).reshape(x.shape)

    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        """Compute s and its time derivatives of orders below `count`, each shaped like t [1/s^order]."""
        x = normalise_time(t, self.duration)
        try:
            series = np.empty((len(self.coefficients), count))  # one column for each order
        except (TypeError, ValueError):
            raise InvalidInput(f"count: needs a whole number of at least 0, got {count!r}") from None
        scale = 2.0 / self.duration  # of a derivative by x
        for order in range(count):
            matrix = derivative_matrix(len(self.coefficients), order)
            series[:, order] = scale**order * (matrix @ self.coefficients)
        return list(evaluate(x.ravel(), series).T.reshape(count, *x.shape))

    @staticmethod
    def from_conditions(conditions: Sequence[Condition], duration: float, high: Array = NO_HIGH) -> Law:
        """Solve for the polynomial law of degree k - 1 + h that meets k conditions.

        The Chebyshev coefficients solve one linear equation per condition, in normalised time.

        Args:
            high: (h,) given coefficients of the degrees from k on.

        Raises:
            InvalidInput: the duration is not positive; a condition is not finite or lies outside
                [0, duration]; or conditions contradict or repeat each other.
        """
        check_duration(duration)
        numbers = real_numbers("conditions", [(time, value) for time, _, value in conditions])
        times, stated = numbers.reshape(-1, 2).T  # (k,) [s], (k,) [1/s^order]
        orders = [order for _, order, _ in conditions]
        is_valid = np.isfinite(stated) & (times >= 0.0) & (times <= duration)
        if not is_valid.all():
            time, order, value = conditions[int(is_valid.argmin())]
            raise InvalidInput(
                f"condition s^({order})({time!r}) = {value!r} must be finite and inside [0, {duration:g}] s"
            )
        scale = 2.0 / duration  # dx/dt of the normalised time x
        x = times * scale - 1.0  # (k,)
        rows, inverse, row_sizes = _condition_rows(tuple(zip(x.tolist(), orders, strict=True)))
        values = stated.astype(np.longdouble) / scale ** np.array(orders)
        if len(high):  # what is left for the degrees below k
            given = np.concatenate([np.zeros(len(conditions)), high])
            polynomials = chebyshev.chebvander(x, len(given) - 1)  # (k, k + h)
            series = np.array([derivative_matrix(len(given), order) @ given for order in orders])
            values -= (polynomials * series).sum(axis=1)
        right_side = values / row_sizes

        # Rows of high order are ill-conditioned. Two refinements with residuals in long double recover the
        # digits that the inverse loses.
        solution = inverse @ right_side
        for _ in range(2):
            solution += inverse @ (right_side - rows @ solution)
        return Law(np.concatenate([solution.astype(float), high]), duration)

    @staticmethod
    def rest_to_rest(
        duration: float,
        smoothness: int,
        inner: Sequence[Condition] = (),
        high: Array = NO_HIGH,
        ends: Ends = REST,
    ) -> Law:
        """Return the law from rest at s = 0 to rest at s = 1 that meets the conditions `inner`.

        The derivatives of s up to order `smoothness` are zero at both ends, unless `ends` states others. The
        degree is 2 (smoothness + 1) + len(inner) - 1. With the three conditions of one crossing it is 8 for a
        rigid robot (smoothness 2) and 12 for an elastic one (smoothness 4), as in Briot and Arakelian 2010,
        Eqs. (19)-(31).

        Args:
            duration: [s].
            smoothness: order of the highest derivative of s that is given at both ends.
            inner: conditions at instants between the ends.
            high: given coefficients of the degrees that the conditions leave open.
            ends: derivatives at ends in motion.
        """
        # so many conditions, of degree 61, are refused below as too near to each other
        smoothness = whole_number("smoothness", smoothness, 0, 30)
        at_ends = conditions_at_instants((0.0, duration), ends.conditions(smoothness))
        return Law.from_conditions([*at_ends, *inner], duration, high)

    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""
        return {
            "degree": self.degree,
            "chebyshev": self.coefficients.tolist(),
            "domain": [0.0, self.duration],
        }

    def least_speed_ratio(self, smoothness: int, ends: Ends = REST) -> float:
        """Return the least p divided by the mean |p|, where s' = (1 - x^2)^smoothness p(x).

        The result is positive for a monotone law. In normalised time x in [-1, 1], s' of a law at rest at
        both ends has the factor (1 - x^2)^smoothness, and none at an end in motion. This factor is divided
        out because rounding would decide the sign of s' near the ends.
        """
        if smoothness not in range(self.degree + 1):
            raise InvalidInput(f"smoothness: needs a whole number up to {self.degree}, got {smoothness!r}")
        return _least_speed_ratio(self, ends.zeros(smoothness))


@lru_cache(maxsize=16)
def _least_speed_ratio(law: Law, zeros: tuple[int, int]) -> float:
    """Compute `Law.least_speed_ratio`, which a plan needs several times of the same law."""
    p = _divide_out_ends(law.degree, zeros) @ law.coefficients  # Chebyshev series
    return least_value(p[None]) / float(np.abs(_interior_values(len(p)) @ p).mean())


def speed_ratios_and_peaks(
    duration: float, smoothness: int, times: Array, values: Array, ends: Ends = REST
) -> tuple[Array, Array]:
    """Estimate `Law.least_speed_ratio` (m,) and the peak of |s"| (m,) [1/s^2] of m laws.

    The laws are those of `Law.rest_to_rest`, with ds/dx = (1 - x^2)^smoothness p(x) in the normalised time x
    if both ends are at rest; the ratio is the least p over the mean |p|. The least p and the peak are taken
    at samples, which is fast enough for a search among many laws.

    Args:
        duration: of all laws [s].
        smoothness: number of derivatives of s that are given at both ends.
        ends: those at ends in motion.
        times: inner instants (m, k) [s].
        values: s, s' and s" (m, k, 3) that are required at these instants [1/s^order].

    Returns:
        Ratios and peaks; minus and plus infinity where conditions repeat or contradict each other.
    """
    # (r, degree + 1) of the r laws that exist, and a mask (m,) of these
    coefficients, is_regular = _solve_laws(duration, ends.conditions(smoothness), times, values)
    to_p, to_samples = _matrices_for_search(coefficients.shape[1] - 1, ends.zeros(smoothness))
    p = coefficients @ to_p.T  # Chebyshev series, one law a row
    mean = np.abs(p @ _interior_values(p.shape[1]).T).mean(axis=1)  # (r,) mean |p|
    p_samples, accelerations = np.split(coefficients @ to_samples.T, 2, axis=1)  # p and d2s/dx2, (r, N) each
    ratios = np.full(len(times), -np.inf)
    peaks = np.full(len(times), np.inf)
    ratios[is_regular] = p_samples.min(axis=1) / mean
    x_rate = 2.0 / duration  # dx/dt, by which derivatives in x become time derivatives
    peaks[is_regular] = np.abs(accelerations).max(axis=1) * x_rate**2
    return ratios, peaks


def _solve_laws(
    duration: float, at_ends: Sequence[Array], times: Array, values: Array
) -> tuple[Array, BoolArray]:
    """Solve for the Chebyshev coefficients (r, c) of the r laws whose c conditions are independent.

    A law meets the conditions of its ends and its instants.

    Args:
        duration: of all m laws [s].
        at_ends: s and its derivatives (a,) at each end [1/s^order].
        times: inner instants (m, k) [s].
        values: s, s' and s" (m, k, 3) at these instants [1/s^order].

    Returns:
        The coefficients; a mask (m,) of the laws to which they belong.
    """
    count, instants = times.shape
    scale = 2.0 / duration  # dx/dt of the normalised time x
    end_counts = [len(values_at_end) for values_at_end in at_ends]
    orders = np.array([*chain(*map(range, end_counts)), *([0, 1, 2] * instants)])  # (c,) of the conditions
    end_x = np.repeat([-1.0, 1.0], end_counts)
    inner_x = np.repeat(times * scale - 1.0, 3, axis=1)  # (m, 3 k), the same for s, s' and s"
    x = np.hstack([np.tile(end_x, (count, 1)), inner_x])  # (m, c)

    targets = np.zeros(x.shape)
    targets[:, : len(end_x)] = np.concatenate(at_ends)  # s, then its derivatives
    targets[:, len(end_x) :] = values.reshape(inner_x.shape)
    targets /= scale**orders  # derivatives by x: those by time over powers of dx/dt
    rows, row_sizes = _scaled_rows(x, orders)
    inverse = solve(rows, np.broadcast_to(np.eye(x.shape[1]), rows.shape))  # (m, c, c)
    # 1 / |inverse| bounds the least singular value from below, and costs no decomposition of its own
    is_regular = 1.0 / np.linalg.norm(inverse, axis=(1, 2)) > INDEPENDENT_CONDITIONS  # (m,)
    rows, inverse = rows[is_regular], inverse[is_regular]
    right_sides = (targets / row_sizes)[is_regular, :, None]
    coefficients = inverse @ right_sides
    coefficients += inverse @ (right_sides - rows @ coefficients)  # what the inverse loses
    return coefficients[..., 0], is_regular


def least_value(series: Array) -> float:
    """Compute the least value on [-1, 1] of all Chebyshev series c (k, size).

    The least value is at an end, where T_j is 1 or (-1)^j, or at an extremum. As |T_j| <= 1, no value is
    below c_0 minus the sum of |c_j| over j > 0. Extrema are computed only for series whose bound is below the
    least value at the ends.
    """
    signs = (-1.0) ** np.arange(series.shape[1])  # T_j(-1)
    least_at_ends = min(series.sum(axis=1).min(), (series @ signs).min())
    lower_bounds = 2.0 * series[:, 0] - np.abs(series).sum(axis=1)  # c_0 is in the sum, too: hence 2 c_0
    candidates = series[lower_bounds < least_at_ends]
    inner = [evaluate(extrema(c), c).min(initial=np.inf) for c in candidates]
    return float(min([least_at_ends, *inner]))


@lru_cache(maxsize=64)
def _condition_rows(conditions: tuple[tuple[float, int], ...]) -> tuple[Array, Array, Array]:
    """Return the linear equations of k conditions: rows (k, k), their inverse, row sizes (k,).

    A condition (x, order) sets a derivative of s at the normalised time x.
    """
    x, orders = zip(*conditions, strict=True)
    rows, row_sizes = _scaled_rows(np.array(x), orders)
    U, S, V_rows = np.linalg.svd(rows)  # S descends
    if not S[-1] > INDEPENDENT_CONDITIONS:
        raise InvalidInput(
            "the conditions on the law repeat or contradict each other, or are too near to each other in time"
        )
    return rows, (V_rows.T / S) @ U.T, row_sizes


def _scaled_rows(x: Array, orders: Iterable[int]) -> tuple[Array, Array]:
    """Return the linear equations (..., k, k) of k conditions, and the sizes (..., k) of their rows.

    Row i contains the derivatives of order `orders[i]` of all T_j at the normalised time x[..., i]. It is
    divided by its size, the largest of their absolute values.
    """
    count = x.shape[-1]
    polynomials = chebyshev.chebvander(x, count - 1)  # (..., k, k) T_j(x_i)
    derivatives = np.array([derivative_matrix(count, order) for order in orders])  # (k, k, k)
    rows = np.einsum("...ij,ijk->...ik", polynomials, derivatives)
    row_sizes = np.abs(rows).max(axis=-1)
    row_sizes[row_sizes == 0.0] = 1.0  # a zero row stays, and makes the rows dependent
    return rows / row_sizes[..., None], row_sizes


@lru_cache(maxsize=64)
def _interior_values(size: int) -> Array:
    """Return the matrix (2 size + 2, size) from `size` Chebyshev coefficients to values inside (-1, 1).

    The values are those at 2 size + 4 Chebyshev nodes without the two ends, about two for each coefficient.
    """
    return np.asarray(chebyshev.chebvander(nodes(2 * size + 4)[1:-1], size - 1))


@lru_cache(maxsize=64)
def _matrices_for_search(degree: int, zeros: tuple[int, int]) -> tuple[Array, Array]:
    """Return the matrices from coefficients (degree + 1,) of a law s to coefficients of p, and to samples.

    The law has ds/dx = (1 + x)^a (1 - x)^b p(x) with the `zeros` (a, b), where x in [-1, 1] is the normalised
    time and p a Chebyshev series with c coefficients. The samples are N of p, then N of d2s/dx2, at
    N = `search_samples` c nodes x.
    """
    search_samples = 16
    to_p = _divide_out_ends(degree, zeros)  # (c, degree + 1)
    T_values = chebyshev.chebvander(nodes(search_samples * len(to_p)), degree)  # (N, degree + 1)
    p_samples = T_values[:, : len(to_p)] @ to_p
    accelerations = T_values @ derivative_matrix(degree + 1, 2)
    return to_p, np.vstack([p_samples, accelerations])


@lru_cache(maxsize=64)
def _divide_out_ends(degree: int, zeros: tuple[int, int]) -> Array:
    """Return the matrix (size, degree + 1) from coefficients of s to coefficients of p.

    p = s'(x) / ((1 + x)^a (1 - x)^b) with the `zeros` (a, b) and the normalised time x in [-1, 1]. Both s, of
    this degree, and p are Chebyshev series in x. p is fitted by least squares at more than 2 size Chebyshev
    nodes, without the ends x = -1 and 1, where the quotient is 0/0.
    """
    a, b = zeros
    size = max(degree - a - b, 1)  # number of coefficients of p
    x = nodes(2 * size + 4)[1:-1]
    # (2 size + 2, degree + 1) slopes s'(x) at the nodes for unit coefficients of s
    slopes = chebyshev.chebvander(x, degree) @ derivative_matrix(degree + 1)
    quotients = slopes / ((1.0 + x) ** a * (1.0 - x) ** b)[:, None]
    return np.linalg.pinv(_interior_values(size)) @ quotients
