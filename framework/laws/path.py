"""Paths x(s) of the platform, s in [0, 1], with derivatives in s; the straight line among them.

All paths share one call, `path(s, order)`: s of shape (T,) gives (T, n), a scalar gives (n,). At its `knots`
inside (0, 1) a path has only finitely many continuous derivatives. Functions of time get a panel on either
side of each knot. A path does not depend on a robot.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from framework.errors import InvalidInput, check_order, expect_call, finite_numbers, real_numbers
from framework.laws.law import compose_derivatives
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import gauss_legendre
from framework.tolerances import PATH_JUMP, SAME_PLACE, WRONG_DERIVATIVE

HIGHEST_ORDER = 4  # of the derivatives of x and s that the torque of an elastic robot needs
HIGHEST_STATED = 10  # of those that an end in motion may state; springs with inertia follow ever higher ones
NO_KNOTS: Array = read_only(np.empty(0))
GRID_INTERVALS = 4096  # of the grids of s on which derivatives of a user's own path are compared


class Path(Protocol):
    """Any object with `n` coordinates, `knots` (k,) inside (0, 1) and a call `path(s, order)`."""

    @property
    def n(self) -> int: ...

    @property
    def knots(self) -> Array: ...

    def __call__(self, s: ArrayLike, order: int = 0) -> Array: ...


def expect_path(path: object) -> None:
    """Raise InvalidInput unless an object has the call and the attributes of a path."""
    expect_call("path", path, ("n", "knots"), "a Line, an Arc, a Spline or a Polyline")


def check_points(points: Any, least: int, kind: str) -> Array:
    """Return points (m, n) as an array.

    Args:
        least: least number m of points.
        kind: kind of the path, for messages.

    Raises:
        InvalidInput: no path can pass through the points.
    """
    try:
        array = real_numbers("points", points).copy()
    except InvalidInput:
        raise InvalidInput(f"{kind}: points must be lists of numbers of one length, got {points!r}") from None
    if array.ndim != 2 or array.shape[0] < least or array.shape[1] < 1:
        raise InvalidInput(f"{kind}: needs at least {least} points (m, n), got {points!r}")
    finite_numbers(f"{kind}: points", array, array.shape[1], stacks=True)
    if (array[1:] == array[:-1]).all(axis=1).any():
        raise InvalidInput(f"{kind}: two points in a row are the same: {points!r}")
    return array


class PointPath(ReadOnlyArrays):
    """A path defined by its `points` (m, n); paths of one kind through the same points are equal."""

    kind: ClassVar[str]
    highest_order: ClassVar[int] = HIGHEST_STATED
    points: Any
    blend: Any = None  # only a polyline has one

    def _store(self, **values: Any) -> None:
        """Set checked or derived fields; a frozen object refuses plain assignment."""
        self.__dict__.update(values)
        ReadOnlyArrays.__post_init__(self)

    @cached_property
    def n(self) -> int:
        """The number of coordinates."""
        return int(self.points.shape[1])

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s; s of any shape (...) gives (..., n)."""
        check_order(order)
        s_values = real_numbers("s", s)
        if s_values.ndim == 1:
            return self._evaluate(s_values, order)
        values = self._evaluate(s_values.reshape(-1), order)
        return values.reshape(*s_values.shape, values.shape[1])

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute x(s) or its derivative of an `order` (T, n) at s (T,)."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        """Return whether the other path has the same kind, points and blend."""
        return (
            isinstance(other, PointPath)
            and type(self) is type(other)
            and np.array_equal(self.points, other.points)
            and self.blend == other.blend
        )

    def __hash__(self) -> int:
        return hash((self.kind, self.blend, (self.points + 0.0).tobytes()))  # + 0.0 turns -0.0 into 0.0

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(map(str, self.points.tolist()))})"


@dataclass(frozen=True, eq=False)
class Part:
    """The part of a path between the path coordinates `start` and `end`."""

    path: Path
    start: float
    end: float

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return self.path.n

    @property
    def highest_order(self) -> int:
        """The highest order of a derivative that the path has."""
        return highest_order(self.path)

    @property
    def knots(self) -> Array:
        """The knots of the path on this part, (k,)."""
        knots = self.path.knots
        return (knots[(knots > self.start) & (knots < self.end)] - self.start) / (self.end - self.start)

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s of this part."""
        share = self.end - self.start
        return share**order * self.path(self.start + share * np.asarray(s, dtype=float), order)


@dataclass(frozen=True, eq=False, repr=False)
class Line(PointPath):
    """The straight segment from `start` to `end`, both (n,): x(s) = start + s (end - start)."""

    start: Any
    end: Any
    points: Array = field(init=False)

    kind: ClassVar[str] = "line"
    knots: ClassVar[Array] = NO_KNOTS

    def __post_init__(self) -> None:
        points = check_points([self.start, self.end], 2, "line")
        self._store(start=points[0], end=points[1], points=points)

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute x(s) or its derivative of an `order` in s, (T, n)."""
        direction = self.end - self.start
        if order == 0:
            return self.start + s[:, None] * direction
        derivative = direction if order == 1 else np.zeros(self.n)
        return np.zeros((len(s), 1)) + derivative


def highest_order(path: Path) -> int:
    """Return the highest order of derivatives of a path; HIGHEST_ORDER of a user's own."""
    return int(getattr(path, "highest_order", HIGHEST_ORDER))


def time_derivatives(path: Path, law_values: list[Array]) -> list[Array]:
    """Compute time derivatives of x(s(t)), orders 0 .. len(law_values) - 1 (at most 4), each (T, n).

    `law_values[k]` (T,) is the k-th time derivative of s.
    """
    order = len(law_values) - 1
    check_order(order, HIGHEST_ORDER)
    s, *s_rates = law_values  # (T,) each
    by_s = [path(s, k) for k in range(order + 1)]  # x and its derivatives by s
    return compose_derivatives(by_s, [rate[..., None] for rate in s_rates])


# ------------------------------------------------------------------ the check of a user's own path


def check_path(path: Path) -> None:
    """Test x' and x'' of a user's own path against x on a few short intervals.

    Torques are computed from x(s), x'(s) and x''(s) as the path returns them. If x' is not the derivative of
    x, these torques belong to no motion, however well their series converge. The test compares both sides of

        x(b) - x(a) = int_a^b x'(s) ds,    x'(b) - x'(a) = int_a^b x''(s) ds

    on intervals without knots. Gauss's rule evaluates the integrals, so no step size has to be chosen, as it
    would for difference quotients.

    Raises:
        InvalidInput: not a path; knots that do not ascend inside (0, 1); a value that is missing or not
            finite; path(s, 1) or path(s, 2) is not the derivative of the order below, or jumps.
    """
    expect_path(path)
    if isinstance(path, PointPath):
        return  # its derivatives are exact
    starts, lengths = _test_intervals(path)
    for order in (1, 2):
        _check_derivative(path, order, starts, lengths)
        # A derivative jumps if its largest change between points of a grid is not at least halved by a finer
        # grid in that interval.
        grid = np.linspace(0.0, 1.0, GRID_INTERVALS + 1)[1:-1]
        start, end, coarse_change, _ = _find_largest_change(path, order, grid)
        fine_grid = np.linspace(start, end, GRID_INTERVALS)
        jump, _, fine_change, largest = _find_largest_change(path, order, fine_grid)
        if fine_change > max(0.5 * coarse_change, PATH_JUMP * largest):
            fault = "have no bound" if order == 1 else "have to jump"
            raise InvalidInput(
                f"path: path(s, {order}) jumps at s = {jump:.6g} by {fine_change:.3g}, where the torque "
                f"would {fault}: round it, as a Polyline does its corners"
            )


def _check_derivative(path: Path, order: int, starts: Array, lengths: Array) -> None:
    """Compare means of a derivative over intervals with difference quotients of the order below.

    The mean of path(s, order) over [a, b] must be (path(b, order - 1) - path(a, order - 1)) / (b - a). The
    intervals have `starts` and `lengths` (intervals,) in s.
    """
    values = _evaluate_path(path, np.append(starts, starts + lengths), order - 1)  # (2 intervals, n)
    at_start, at_end = np.split(values, 2)
    quotients = (at_end - at_start) / lengths[:, None]  # (intervals, n)

    nodes, weights = gauss_legendre(5)
    s = starts[:, None] + 0.5 * lengths[:, None] * (nodes + 1.0)  # (intervals, nodes)
    derivatives = _evaluate_path(path, s.ravel(), order).reshape(*s.shape, path.n)
    means = 0.5 * np.einsum("k,ikn->in", weights, derivatives)  # (intervals, n), by Gauss's rule

    # the means may differ from the quotients by a share of the largest derivative, and by what rounding of
    # the values makes of a quotient
    largest = np.maximum(np.abs(means), np.abs(quotients)).max(axis=0)  # (n,)
    rounding = SAME_PLACE * np.abs(values).max(axis=0) / lengths[:, None]  # (intervals, n)
    allowed = WRONG_DERIVATIVE * largest + rounding
    excess = np.abs(means - quotients) - allowed
    if np.any(excess > 0):
        i, component = np.unravel_index(np.argmax(excess), excess.shape)
        raise InvalidInput(
            f"path: path(s, {order}) is not the derivative of path(s, {order - 1}): at s = "
            f"{starts[i]:.4g} coordinate {component} has {means[i, component]:.6g} instead of "
            f"{quotients[i, component]:.6g}"
        )


def _find_largest_change(path: Path, order: int, s: Array) -> tuple[float, float, float, float]:
    """Find the interval between neighbouring points s (T,) on which a derivative of a path changes most.

    Args:
        order: 1 or 2, the order of the derivative.

    Returns:
        The ends of the interval in s, the change on it, and the largest absolute value at all points.
    """
    values = _evaluate_path(path, s, order)
    changes = np.abs(np.diff(values, axis=0)).max(axis=1)  # (T - 1,)
    k = changes.argmax()
    return s[k], s[k + 1], changes[k], np.abs(values).max()


def _test_intervals(path: Path) -> tuple[Array, Array]:
    """Choose starts and lengths of test intervals between knots, (intervals,) each.

    Each panel, between two knots or ends of the path, has `difference_intervals` at equal distances.
    """
    difference_intervals = 9
    knots = real_numbers("path: knots", path.knots)
    edges = np.concatenate(([0.0], knots, [1.0]))
    widths = np.diff(edges) / difference_intervals  # (panels,)
    if not np.all(widths > 0):
        raise InvalidInput(f"path: knots must ascend inside (0, 1), got {knots.tolist()}")
    steps = np.arange(difference_intervals)
    starts = edges[:-1, None] + widths[:, None] * steps  # (panels, intervals of each)
    lengths = np.broadcast_to(np.minimum(1.0 / GRID_INTERVALS, widths)[:, None], starts.shape)
    return starts.ravel(), lengths.ravel()


def _evaluate_path(path: Path, s: Array, order: int) -> Array:
    """Evaluate path(s, order) as an array (T, n) of finite numbers."""
    values = real_numbers("path(s)", path(s, order))
    if values.shape != (len(s), path.n) or not np.all(np.isfinite(values)):
        raise InvalidInput(
            f"path: path(s, {order}) must give {path.n} finite numbers for each s, shape "
            f"({len(s)}, {path.n}), got shape {values.shape}"
        )
    return values
