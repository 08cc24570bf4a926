"""Paths x(s) of the platform, s in [0, 1], with derivatives in s.

All paths share one call, `path(s, order)`: s of shape (T,) gives (T, n), a scalar gives (n,). At its `knots`
inside (0, 1) a path has only finitely many continuous derivatives. Functions of time get a panel on either
side of each knot.

A path does not depend on a robot. If some coordinates are in metres and others in radians, an arc's circle
and a spline's chords count 1 m like 1 rad. Through the same points in other units such a path is another
curve; only a line stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.polynomial import Polynomial

from framework.errors import InvalidInput, check_order, expect_call
from framework.laws.law import compose_derivatives, is_number
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import gauss_legendre
from framework.numerics.fields import LARGEST_NUMBER
from framework.tolerances import DEGENERATE_PATH, PATH_JUMP, SAME_PLACE, SMALLEST_BLEND, WRONG_DERIVATIVE

HIGHEST_ORDER = 4  # of the derivatives of x and s that the torque of an elastic robot needs
NO_KNOTS: Array = read_only(np.empty(0))
DIFFERENCE_INTERVALS = 9  # between two knots, on which derivatives of a user's own path are tested
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


def _check_points(points: Any, least: int, kind: str) -> Array:
    """Return points (m, n) as an array.

    Args:
        least: least number m of points.
        kind: kind of the path, for messages.

    Raises:
        InvalidInput: no path can pass through the points.
    """
    try:
        array = np.array(points, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{kind}: points must be lists of numbers of one length, got {points!r}") from None
    if array.ndim != 2 or array.shape[0] < least or array.shape[1] < 1:
        raise InvalidInput(f"{kind}: needs at least {least} points (m, n), got {points!r}")
    if not np.all(np.isfinite(array)):
        raise InvalidInput(f"{kind}: points must be finite numbers, got {points!r}")
    if np.any(np.abs(array) > LARGEST_NUMBER):
        raise InvalidInput(f"{kind}: points must be at most {LARGEST_NUMBER:g} in size, got {points!r}")
    if np.any(np.linalg.norm(np.diff(array, axis=0), axis=1) == 0):
        raise InvalidInput(f"{kind}: two points in a row are the same: {points!r}")
    return array


class PointPath(ReadOnlyArrays):
    """A path defined by its `points` (m, n); paths of one kind through the same points are equal."""

    kind: ClassVar[str]
    points: Any
    blend: Any = None  # only a polyline has one

    def _store(self, **values: Any) -> None:
        """Set checked or derived fields; a frozen object refuses plain assignment."""
        self.__dict__.update(values)
        ReadOnlyArrays.__post_init__(self)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return int(self.points.shape[1])

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s) or its derivative of an `order` in s; s of any shape (...) gives (..., n)."""
        check_order(order)
        s_values = np.asarray(s, dtype=float)
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


@dataclass(frozen=True, eq=False, repr=False)
class Line(PointPath):
    """The straight segment from `start` to `end`, both (n,): x(s) = start + s (end - start)."""

    start: Any
    end: Any
    points: Array = field(init=False)

    kind: ClassVar[str] = "line"
    knots: ClassVar[Array] = NO_KNOTS

    def __post_init__(self) -> None:
        points = _check_points([self.start, self.end], 2, "line")
        self._store(start=points[0], end=points[1], points=points)

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute x(s) or its derivative of an `order` in s, (T, n)."""
        direction = self.end - self.start
        if order == 0:
            return self.start + s[:, None] * direction
        derivative = direction if order == 1 else np.zeros(self.n)
        return np.tile(derivative, (len(s), 1))


@dataclass(frozen=True, eq=False, repr=False)
class Arc(PointPath):
    """The circular arc from `start` through `via` to `end`, each (n,), n >= 2, at constant speed.

    The circle counts 1 m like 1 rad. `center` (n,), `radius` and the signed `angle` [rad] swept follow from
    the three points.
    """

    start: Any
    via: Any
    end: Any
    points: Array = field(init=False)
    center: Array = field(init=False)
    radius: float = field(init=False)
    angle: float = field(init=False)
    _spokes: Array = field(init=False)  # (2, n) orthonormal in its plane, the first towards the start

    kind: ClassVar[str] = "arc"
    knots: ClassVar[Array] = NO_KNOTS

    def __post_init__(self) -> None:
        """Compute center, radius, plane and signed angle [rad] of the arc.

        The unit vectors of the plane are u, towards the start, and w, along the part of the chord from
        `start` to `via` that is orthogonal to u.
        """
        points = _check_points([self.start, self.via, self.end], 3, "arc")
        start, via, end = points
        center = _circle_center(points)
        radius = float(np.linalg.norm(start - center))
        u = (start - center) / radius
        chord = via - start
        w = chord - (chord @ u) * u
        spokes = np.array([u, w / np.linalg.norm(w)])

        # angles of via and end from the start, in [0, 2 pi). If the end comes before via, the arc turns the
        # other way.
        along_u, along_w = spokes @ (points[1:] - center).T  # (2,) each
        angle_via, angle_end = (np.arctan2(along_w, along_u) % (2 * np.pi)).tolist()
        angle = angle_end if angle_via < angle_end else angle_end - 2 * np.pi
        self._store(
            start=start,
            via=via,
            end=end,
            points=points,
            center=center,
            radius=radius,
            angle=angle,
            _spokes=spokes,
        )

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute c + r (cos(a s) u + sin(a s) w) or a derivative in s, (T, n).

        c is the centre, r the radius and a the angle [rad] of the arc; u and w span its plane.
        """
        u, w = self._spokes
        phase = s[:, None] * self.angle + order * np.pi / 2  # each derivative advances the phase by pi/2
        values = self.radius * self.angle**order * (np.cos(phase) * u + np.sin(phase) * w)
        return values + self.center if order == 0 else values


def _circle_center(points: Array) -> Array:
    """Compute the centre (n,) of the circle through three points (3, n); refuse points on a line.

    Both chords from the start satisfy chord . (centre - start) = |chord|^2 / 2. Of all solutions for
    centre - start the one of least norm lies in the plane of the chords.
    """
    start = points[0]
    chords = points[1:] - start
    to_via, to_end = chords
    along = (to_end @ to_via) / (to_via @ to_via) * to_via  # the part of to_end along to_via
    if np.linalg.norm(to_end - along) <= DEGENERATE_PATH * np.linalg.norm(to_end):
        raise InvalidInput(f"arc: its three points lie on a line: {points.tolist()}")
    to_center, *_ = np.linalg.lstsq(chords, 0.5 * np.sum(chords**2, axis=1))
    return start + to_center


@dataclass(frozen=True, eq=False, repr=False)
class Spline(PointPath):
    """The spline through `points` (m, n), in the chord length as its parameter (1 m like 1 rad).

    It has degree 5, or m - 1 for fewer than six points, so that the four derivatives are continuous that the
    torque of an elastic robot needs.
    """

    kind: ClassVar[str] = "spline"
    points: Any
    knots: Array = field(init=False, repr=False)
    _shares: Array = field(init=False, repr=False)  # (m,) values of s at the points

    def __repr__(self) -> str:
        return f"Spline({self.points.tolist()})"

    def __post_init__(self) -> None:
        """Check the distances between points; compute s at the points, and the inner knots in s.

        Neither the ends nor the two points next to each end are inner knots: this is the not-a-knot condition
        of a spline of degree 5. The knots are computed here because scipy 1.13 does so for odd degrees only.
        """
        points = _check_points(self.points, 2, "spline")
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if chords.min() < DEGENERATE_PATH * chords.max():
            k = np.argmin(chords)  # the shortest chord
            raise InvalidInput(
                f"spline: points {k} and {k + 1} are {chords[k]:.3g} apart, others {chords.max():.3g}: too "
                f"uneven to tell their places on the curve"
            )
        shares = np.concatenate(([0.0], np.cumsum(chords) / chords.sum()))
        shares[-1] = 1.0
        left_out = 3  # values of s at each end that are no inner knots
        knots = shares[left_out:-left_out]  # none for fewer than 7 points
        self._store(points=points, knots=knots, _shares=shares)

    @cached_property
    def _spline(self) -> Any:
        """The interpolating spline in s, of degree 5 or less."""
        from scipy.interpolate import make_interp_spline

        degree = min(HIGHEST_ORDER + 1, len(self.points) - 1)
        knots = np.concatenate((np.zeros(degree + 1), self.knots, np.ones(degree + 1)))
        return make_interp_spline(self._shares, self.points, k=degree, t=knots)

    def _evaluate(self, s: Array, order: int) -> Array:
        """Evaluate the spline or its derivative of an `order` in s, (T, n)."""
        if order > self._spline.k:  # scipy refuses orders above the degree; these derivatives are zero
            return np.zeros((len(s), self.n))
        return self._spline(s, nu=order)


# A blend f(w), w in [-1, 1], raises the speed along a segment from f'(-1) = 0 to f'(1) = 1. With
# f" = 35/32 (1 - w^2)^3, whose integral is 1, four derivatives of the path are continuous.
_BLEND_CURVATURE = Polynomial([1.0, 0.0, -1.0]) ** 3 * (35.0 / 32.0)
_BLEND = _BLEND_CURVATURE.integ(2, lbnd=-1.0)


@dataclass(frozen=True, eq=False, repr=False)
class Polyline(PointPath):
    """Straight segments between `points` (m, n), m >= 3, with corners rounded by smooth blends.

    A blend begins and ends at the distance `blend` [1 m like 1 rad] from its corner. It passes the corner at
    0.137 `blend` times the change in direction, which is 0.19 `blend` for a right angle. Four derivatives are
    continuous. s is the share of the length of the sharp polyline, which is a little longer than the path.

    Raises:
        InvalidInput: points that make no path; a blend that is too short, or too long for a segment; or
            segments that turn straight back.
    """

    points: Any
    blend: Any
    knots: Array = field(init=False, repr=False)
    _arc_lengths: Array = field(init=False)  # (m,) along the segments, at the points
    _directions: Array = field(init=False)  # (m - 1, n)

    kind: ClassVar[str] = "polyline"

    def __repr__(self) -> str:
        return f"Polyline({self.points.tolist()}, blend={self.blend!r})"

    def __post_init__(self) -> None:
        """Check points and blend; compute lengths, directions and knots, the ends of blends."""
        points = _check_points(self.points, 3, "polyline")
        chords = np.diff(points, axis=0)
        lengths = np.linalg.norm(chords, axis=1)
        directions = chords / lengths[:, None]
        longest = 0.5 * lengths.min()  # blend: two of them share a segment
        # the tolerance accepts a longest blend that was printed, and rounded up
        if not (is_number(self.blend) and SMALLEST_BLEND * longest <= self.blend <= (1.0 + 1e-5) * longest):
            raise InvalidInput(
                f"polyline: blend must be from {SMALLEST_BLEND * longest:.2g} to {longest:.6g}, half of the "
                f"shortest segment, got {self.blend!r}"
            )
        blend = min(float(self.blend), longest)
        turns_back = np.linalg.norm(directions[1:] + directions[:-1], axis=1) < DEGENERATE_PATH
        if turns_back.any():
            corner = np.argmax(turns_back) + 1
            raise InvalidInput(
                f"polyline: at point {corner}, {points[corner].tolist()}, it turns straight back: no smooth "
                f"path does; stop there, and plan two motions"
            )
        arc_lengths = np.concatenate(([0.0], np.cumsum(lengths)))
        blend_ends = (arc_lengths[1:-1, None] + blend * np.array([-1.0, 1.0])) / arc_lengths[-1]
        # rounding to 14 digits makes the ends of two blends that meet equal, and `unique` merges them
        knots = np.unique(np.round(blend_ends, 14))
        self._store(
            points=points,
            blend=blend,
            knots=knots,
            _arc_lengths=arc_lengths,
            _directions=directions,
        )

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute x(s) or its derivative of an `order` in s, (T, n).

        Near a corner c, x = c + b ((w - f(w)) d_1 + f(w) d_2). The segments before and after c have the
        directions d_1 and d_2, b is `blend`, and w b is the distance from c along the segments. The blend f
        is 0 for w <= -1 and w for w >= 1. By the chain rule each derivative in s has a factor
        dw/ds = total length / b.
        """
        length = self._arc_lengths[-1]
        corners = self._arc_lengths[1:-1]
        corner = np.abs(s[:, None] * length - corners).argmin(axis=1)  # (T,) index of the nearest corner
        w = (s * length - corners[corner]) / self.blend
        # w and f(w), or their derivatives by w
        line = Polynomial([0.0, 1.0]).deriv(order)(w)
        f = np.where(w <= -1.0, 0.0, np.where(w >= 1.0, line, _BLEND.deriv(order)(w)))
        along_before = (line - f)[:, None] * self._directions[corner]
        along_after = f[:, None] * self._directions[corner + 1]
        value = (along_before + along_after) * self.blend * (length / self.blend) ** order
        return value + self.points[corner + 1] if order == 0 else value


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
        _check_continuous(path, order)


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


def _check_continuous(path: Path, order: int) -> None:
    """Refuse a path whose derivative of this order, 1 or 2, jumps.

    The largest change between neighbouring points of a grid is compared with the largest change on a finer
    grid in that interval. A derivative jumps if the finer grid does not at least halve the change.
    """
    coarse = _find_largest_change(path, order, np.linspace(0.0, 1.0, GRID_INTERVALS + 1)[1:-1])
    fine = _find_largest_change(path, order, np.linspace(coarse.start, coarse.end, GRID_INTERVALS))
    if fine.change > max(0.5 * coarse.change, PATH_JUMP * fine.largest_value):
        fault = "have no bound" if order == 1 else "have to jump"
        raise InvalidInput(
            f"path: path(s, {order}) jumps at s = {fine.start:.6g} by {fine.change:.3g}, where the torque "
            f"would {fault}: round it, as a Polyline does its corners"
        )


class _LargestChange(NamedTuple):
    """The interval of a grid on which a derivative of a path changes most."""

    start: float  # s
    end: float  # s
    change: float  # of the derivative on the interval
    largest_value: float  # absolute, of the derivative at all points of the grid


def _find_largest_change(path: Path, order: int, s: Array) -> _LargestChange:
    """Find the interval between neighbouring points s (T,) on which a derivative of a path changes most.

    Args:
        order: 1 or 2, the order of the derivative.

    Returns:
        The ends of the interval in s, the change on it, and the largest absolute value at all points.
    """
    values = _evaluate_path(path, s, order)
    changes = np.abs(np.diff(values, axis=0)).max(axis=1)  # (T - 1,)
    k = changes.argmax()
    return _LargestChange(s[k], s[k + 1], changes[k], np.abs(values).max())


def _test_intervals(path: Path) -> tuple[Array, Array]:
    """Choose starts and lengths of test intervals between knots, (intervals,) each.

    Each panel, between two knots or ends of the path, has DIFFERENCE_INTERVALS at equal distances.
    """
    knots = np.asarray(path.knots, dtype=float)
    edges = np.concatenate(([0.0], knots, [1.0]))
    widths = np.diff(edges) / DIFFERENCE_INTERVALS  # (panels,)
    if not np.all(widths > 0):
        raise InvalidInput(f"path: knots must ascend inside (0, 1), got {knots.tolist()}")
    steps = np.arange(DIFFERENCE_INTERVALS)
    starts = edges[:-1, None] + widths[:, None] * steps  # (panels, intervals of each)
    lengths = np.broadcast_to(np.minimum(1.0 / GRID_INTERVALS, widths)[:, None], starts.shape)
    return starts.ravel(), lengths.ravel()


def _evaluate_path(path: Path, s: Array, order: int) -> Array:
    """Evaluate path(s, order) as an array (T, n) of finite numbers."""
    values = np.asarray(path(s, order), dtype=float)
    if values.shape != (len(s), path.n) or not np.all(np.isfinite(values)):
        raise InvalidInput(
            f"path: path(s, {order}) must give {path.n} finite numbers for each s, shape "
            f"({len(s)}, {path.n}), got shape {values.shape}"
        )
    return values
