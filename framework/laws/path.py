"""Paths x(s) of the platform, s in [0, 1], with derivatives in s.

All paths share one call, `path(s, order)`: s of shape (T,) gives (T, n), a scalar gives (n,).
`knots` (inside (0, 1)) are the places where a path is only finitely smooth; functions of time get a
panel on either side of them.

A path knows no robot: where some coordinates are metres and others radians, an arc's circle and a spline's
chords count 1 m like 1 rad. Through the same points in other units it is another curve; a line is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import comb
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.polynomial import Polynomial

from framework.errors import InvalidInput, check_order, expect_call
from framework.laws.law import is_number
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.tolerances import DEGENERATE_PATH, PATH_JUMP, SMALLEST_BLEND, WRONG_DERIVATIVE

HIGHEST_ORDER = 4  # derivatives of x, and of s, that an elastic robot's torque needs
NO_KNOTS: Array = read_only(np.empty(0))
MAX_COORDINATE = 1e30  # [m, rad] coordinate whose powers do not overflow
DIFFERENCE_ROUNDING = 1e-10  # of x(b) - x(a), over the largest value: what a user's own formula may lose
DIFFERENCE_INTERVALS = 9
JUMP_INTERVALS, JUMP_GRIDS = 4096, 2  # of [0, 1]; then of the interval of the largest change
INTERVAL_LENGTH = 1e-3  # in s; shorter between knots that are closer
GOLDEN_RATIO = 0.5 * (5.0**0.5 - 1.0)  # its multiples modulo 1 spread evenly and hit no regular grid


class Path(Protocol):
    """Anything with `n` coordinates, `knots` and `path(s, order)`."""

    @property
    def n(self) -> int: ...

    @property
    def knots(self) -> Array: ...

    def __call__(self, s: ArrayLike, order: int = 0) -> Array: ...


def expect_path(path: object) -> None:
    """Raise InvalidInput unless an object has the call and attributes of a path."""
    expect_call("path", path, ("n", "knots"), "a Line, an Arc, a Spline or a Polyline")


def _check_points(points: Any, least: int, kind: str) -> Array:
    """Return points (m, n) as an array.

    Raises InvalidInput unless a path can pass through them.
    """
    try:
        array = np.array(points, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{kind}: points must be lists of numbers of one length, got {points!r}") from None
    if array.ndim != 2 or array.shape[0] < least or array.shape[1] < 1:
        raise InvalidInput(f"{kind}: needs at least {least} points (m, n), got {points!r}")
    if not np.all(np.isfinite(array)):
        raise InvalidInput(f"{kind}: points must be finite numbers, got {points!r}")
    if np.any(np.abs(array) > MAX_COORDINATE):
        raise InvalidInput(f"{kind}: points must be at most {MAX_COORDINATE:g} in size, got {points!r}")
    if np.any(np.linalg.norm(np.diff(array, axis=0), axis=1) == 0):
        raise InvalidInput(f"{kind}: two points in a row are the same: {points!r}")
    return read_only(array)


def _set_fields(frozen: object, **values: Any) -> None:
    """Set derived attributes of a frozen object."""
    for name, value in values.items():
        object.__setattr__(frozen, name, value)


class PointPath(ReadOnlyArrays):
    """A path that its `points` (m, n) define: equal to another of its kind through the same points."""

    kind: ClassVar[str]
    points: Any
    blend: Any = None  # of a polyline

    @property
    def n(self) -> int:
        return int(self.points.shape[1])

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Compute x(s), or its derivative by s of an order.

        s of any shape (...) gives (..., n).
        """
        check_order(order)
        s_values = np.asarray(s, dtype=float)
        values = self._evaluate(s_values.reshape(-1), order)
        return values.reshape(*s_values.shape, values.shape[1])

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute x(s) or its derivative at s (T,), (T, n)."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        """Return whether another path has the same kind, points and blend."""
        return (
            isinstance(other, PointPath)
            and type(self) is type(other)
            and np.array_equal(self.points, other.points)
            and self.blend == other.blend
        )

    def __hash__(self) -> int:
        return hash((self.kind, self.blend, (self.points + 0.0).tobytes()))  # 0.0 is -0.0

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
        _set_fields(self, start=points[0], end=points[1], points=points)

    def _evaluate(self, s: Array, order: int) -> Array:
        direction = self.end - self.start
        if order == 0:
            return self.start + s[:, None] * direction
        return 0.0 * s[:, None] + (direction if order == 1 else 0.0 * direction)


@dataclass(frozen=True, eq=False, repr=False)
class Arc(PointPath):
    """The circular arc from `start` through `via` to `end`, each (n,), n >= 2, at constant speed.

    Its circle is one in the numbers of the points, 1 m like 1 rad.
    `center` (n,), `radius` and the signed `angle` [rad] that it sweeps follow from them.
    """

    start: Any
    via: Any
    end: Any
    points: Array = field(init=False)
    center: Array = field(init=False)
    radius: float = field(init=False)
    angle: float = field(init=False)
    _spokes: Array = field(init=False)  # (2, n) unit vectors of its plane, the first towards the start

    kind: ClassVar[str] = "arc"
    knots: ClassVar[Array] = NO_KNOTS

    def __post_init__(self) -> None:
        """Compute center, radius, plane and signed angle [rad] of the arc through the three points.

        The plane has the unit vectors u, towards the start, and the part of the chord to `via` across u.
        """
        points = _check_points([self.start, self.via, self.end], 3, "arc")
        start, via, end = points
        center = _circle_center(points)
        radius = float(np.linalg.norm(start - center))
        u = (start - center) / radius
        chord = via - start
        across = chord - (chord @ u) * u
        spokes = np.array([u, across / np.linalg.norm(across)])
        along_u, along_w = spokes @ (points[1:] - center).T  # (2,) of via and end
        angle_via, angle_end = (np.arctan2(along_w, along_u) % (2 * np.pi)).tolist()
        # `via` lies between the ends: its angle decides in which direction the arc turns
        angle = angle_end if angle_via < angle_end else angle_end - 2 * np.pi
        _set_fields(self, start=start, via=via, end=end, points=points)
        _set_fields(self, center=read_only(center), radius=radius, angle=angle, _spokes=read_only(spokes))

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute c + r (cos(a s) u + sin(a s) w), or its derivative by s, (T, n)."""
        u, w = self._spokes
        phase = s[:, None] * self.angle + order * np.pi / 2  # each derivative turns by a quarter
        values = self.radius * self.angle**order * (np.cos(phase) * u + np.sin(phase) * w)
        return values + self.center if order == 0 else values


def _circle_center(points: Array) -> Array:
    """Compute the centre (n,) of the circle through three points (3, n); refuse points on a line.

    The centre is as far from each end of a chord: chord . (centre - start) = |chord|^2 / 2 for the chords
    from the start to both other points. Of all solutions the shortest lies in the plane of the chords.
    """
    start = points[0]
    chords = points[1:] - start
    shorter, longer = chords
    along = (longer @ shorter) / (shorter @ shorter) * shorter
    if np.linalg.norm(longer - along) <= DEGENERATE_PATH * np.linalg.norm(longer):
        raise InvalidInput(f"arc: its three points lie on a line: {points.tolist()}")
    return start + np.linalg.lstsq(chords, 0.5 * np.sum(chords**2, axis=1))[0]


@dataclass(frozen=True, eq=False, repr=False)
class Spline(PointPath):
    """The spline through `points` (m, n) with four continuous derivatives, by chord length (1 m like 1 rad).

    Degree 5, or m - 1 for fewer than six points: the torque of an elastic robot needs x''''.
    """

    kind: ClassVar[str] = "spline"
    points: Any
    knots: Array = field(init=False, repr=False)
    _shares: Array = field(init=False, repr=False)  # (m,) of the chord length, of the points

    def __repr__(self) -> str:
        return f"Spline({self.points.tolist()})"

    def __post_init__(self) -> None:
        """Check the distances between points; compute their shares of the chord length, and the inner knots.

        Not a knot: none at the two points next to an end. scipy 1.13 finds them for odd degrees only.
        """
        points = _check_points(self.points, 2, "spline")
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if chords.min() < DEGENERATE_PATH * chords.max():
            k = int(np.argmin(chords))
            raise InvalidInput(
                f"spline: points {k} and {k + 1} are {chords[k]:.3g} apart, others {chords.max():.3g}: too "
                f"uneven to tell their places on the curve"
            )
        shares = np.concatenate(([0.0], np.cumsum(chords) / chords.sum()))
        shares[-1] = 1.0
        _set_fields(self, points=points, knots=read_only(shares[3:-3]), _shares=read_only(shares))

    @cached_property
    def _spline(self) -> Any:
        """The interpolating spline of degree 5 at most, over shares of the chord length."""
        from scipy.interpolate import make_interp_spline

        degree = min(5, len(self.points) - 1)
        knots = np.concatenate((np.zeros(degree + 1), self.knots, np.ones(degree + 1)))
        return make_interp_spline(self._shares, self.points, k=degree, t=knots)

    def _evaluate(self, s: Array, order: int) -> Array:
        """Evaluate the spline or its derivative, zero beyond the degree, (T, n)."""
        return np.zeros((len(s), self.n)) if order > self._spline.k else self._spline(s, nu=order)


# The blend of a corner along w in [-1, 1] leads the speed on a segment from 0 to 1 by f' with f'(-1) = 0,
# f'(1) = 1 and f" = 35/32 (1 - w^2)^3, so that four derivatives are continuous.
_BLEND_CURVATURE = Polynomial([1.0, 0.0, -1.0]) ** 3 * (35.0 / 32.0)
_BLEND = _BLEND_CURVATURE.integ(2, lbnd=-1.0)


@dataclass(frozen=True, eq=False, repr=False)
class Polyline(PointPath):
    """Straight segments through `points` (m, n), m >= 3, that smooth blends join about the inner points.

    A blend begins and ends at the distance `blend` [1 m like 1 rad] from its corner, which it passes at 0.137
    `blend` times the change in direction (0.19 `blend` of a right angle). Four derivatives are continuous.
    s is the share of the length of the segments; in blends the path is a little shorter.

    Raises:
        InvalidInput: points that make no path, a blend that is not positive or too long for a segment, or
            segments that turn straight back.
    """

    points: Any
    blend: Any
    knots: Array = field(init=False, repr=False)
    _arc_lengths: Array = field(init=False)  # (m,) of the points
    _directions: Array = field(init=False)  # (m - 1, n)

    kind: ClassVar[str] = "polyline"

    def __repr__(self) -> str:
        return f"Polyline({self.points.tolist()}, blend={self.blend!r})"

    def __post_init__(self) -> None:
        """Check points and blend; compute lengths, directions and knots.

        Knots are where blends begin and end.
        """
        points = _check_points(self.points, 3, "polyline")
        chords = np.diff(points, axis=0)
        lengths = np.linalg.norm(chords, axis=1)
        directions = chords / lengths[:, None]
        longest = 0.5 * lengths.min()
        if not (is_number(self.blend) and SMALLEST_BLEND * longest <= self.blend <= (1.0 + 1e-5) * longest):
            raise InvalidInput(
                f"polyline: blend must be from {SMALLEST_BLEND * longest:.2g} to {longest:.6g}, half of the "
                f"shortest segment, got {self.blend!r}"
            )
        blend = min(float(self.blend), longest)
        back = np.linalg.norm(directions[1:] + directions[:-1], axis=1) < DEGENERATE_PATH
        if back.any():
            corner = int(np.argmax(back)) + 1
            raise InvalidInput(
                f"polyline: at point {corner}, {points[corner].tolist()}, it turns straight back: no smooth "
                f"path does; stop there, and plan two motions"
            )
        arc_lengths = np.concatenate(([0.0], np.cumsum(lengths)))
        knots = (arc_lengths[1:-1, None] + blend * np.array([-1.0, 1.0])) / arc_lengths[-1]
        knots = np.unique(np.round(knots, 14))  # one where two blends meet
        _set_fields(self, points=points, blend=blend, knots=read_only(knots))
        _set_fields(self, _arc_lengths=read_only(arc_lengths), _directions=read_only(directions))

    def _evaluate(self, s: Array, order: int) -> Array:
        """Compute x(s) or its derivative by s, (T, n).

        About the nearest corner c, x = c + b (-f(-w) d_1 + f(w) d_2), with directions d_1, d_2 of the
        segments that meet there, w the distance from it over b, and the blend f of `_blend_value`. A
        derivative by s is one by w times the power of dw/ds = total / b, with the total length.
        """
        total = self._arc_lengths[-1]
        corners = self._arc_lengths[1:-1]
        corner = np.abs(s[:, None] * total - corners).argmin(axis=1)  # (T,) the nearest
        w = (s * total - corners[corner]) / self.blend
        first = (-1.0) ** (order + 1) * _blend_value(-w, order)  # the derivative of -f(-w)
        second = _blend_value(w, order)
        value = first[:, None] * self._directions[corner] + second[:, None] * self._directions[corner + 1]
        value = value * self.blend * (total / self.blend) ** order
        return value + self.points[corner + 1] if order == 0 else value


def _blend_value(w: Array, order: int) -> Array:
    """Compute the blend f(w), or a derivative.

    f is 0 for w <= -1 and w for w >= 1.
    """
    blend = _BLEND.deriv(order)
    line = Polynomial([0.0, 1.0]).deriv(order)
    return np.where(w <= -1.0, 0.0, np.where(w >= 1.0, line(w), blend(w)))


def time_derivatives(path: Path, law_values: list[Array]) -> list[Array]:
    """Compute time derivatives of x(s(t)), orders 0 .. len(law_values) - 1 (at most 4), each (T, n).

    `law_values[k]` (T,) is the k-th time derivative of s. Faa di Bruno's formula: that of order m is the sum
    of x^(k)(s) B_mk over k, with Bell polynomials B_mk = sum over i of binom(m-1, i-1) s^(i) B_(m-i)(k-1).
    """
    order = len(law_values) - 1
    check_order(order, HIGHEST_ORDER)
    x = [path(law_values[0], k) for k in range(order + 1)]  # derivatives in s
    ds = [value[..., None] for value in law_values]  # derivatives of s in time
    bell = {(m, 0): np.array(float(m == 0)) for m in range(order + 1)}
    derivatives = [x[0]]
    for m in range(1, order + 1):
        for k in range(1, m + 1):
            terms = [comb(m - 1, i - 1) * ds[i] * bell[m - i, k - 1] for i in range(1, m - k + 2)]
            bell[m, k] = np.sum(terms, axis=0)
        derivatives.append(np.sum([x[k] * bell[m, k] for k in range(1, m + 1)], axis=0))
    return derivatives


# ------------------------------------------------------------------ the check of a user's own path


def check_path(path: Path) -> None:
    """Test x' and x'' of a user's own path against x.

    The test is made on a few short intervals. Torques are made of x(s), x'(s) and x''(s) as the path gives
    them: with an x' that is not the derivative of x they belong to no motion, however well they converge.
    Tested are the integrals

        x(b) - x(a) = int_a^b x'(s) ds,    x'(b) - x'(a) = int_a^b x''(s) ds,

    between the knots by Gauss's rule, which needs no step of a difference.

    Raises:
        InvalidInput: no path, knots that do not ascend inside (0, 1), a value that is missing or not finite,
            path(s, 1) or path(s, 2) that is not the derivative of the order below, or jumps.
    """
    expect_path(path)
    if isinstance(path, PointPath):
        return  # one of our own
    starts, lengths = _test_intervals(path)
    for order in (1, 2):
        _check_derivative(path, order, starts, lengths)
        _check_continuous(path, order)


def _check_derivative(path: Path, order: int, starts: Array, lengths: Array) -> None:
    """Compare means of a derivative over intervals with difference quotients of the order below.

    The mean of path(s, order) over [a, b] must be (path(b, order - 1) - path(a, order - 1)) / (b - a).
    """
    ends = np.concatenate([starts, starts + lengths])
    at_start, at_end = np.split(_evaluate_path(path, ends, order - 1), 2)
    nodes, weights = np.polynomial.legendre.leggauss(5)
    s = starts[:, None] + 0.5 * lengths[:, None] * (nodes + 1.0)  # (intervals, nodes)
    derivatives = _evaluate_path(path, s.ravel(), order).reshape(*s.shape, path.n)
    means = 0.5 * np.einsum("k,ikn->in", weights, derivatives)  # (intervals, n), by Gauss's rule
    quotients = (at_end - at_start) / lengths[:, None]
    # of the largest derivative, and what rounding of the values makes of the quotient
    size = np.maximum(np.abs(means), np.abs(quotients)).max(axis=0)
    value_size = np.maximum(np.abs(at_start), np.abs(at_end)).max(axis=0)
    allowed = WRONG_DERIVATIVE * size + DIFFERENCE_ROUNDING * value_size / lengths[:, None]
    excess = np.abs(means - quotients) - allowed
    if np.any(excess > 0):
        i, component = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise InvalidInput(
            f"path: path(s, {order}) is not the derivative of path(s, {order - 1}): at s = "
            f"{starts[i]:.4g} coordinate {component} has {means[i, component]:.6g} instead of "
            f"{quotients[i, component]:.6g}"
        )


def _check_continuous(path: Path, order: int) -> None:
    """Refuse a derivative that jumps.

    It does where its largest change is not halved on a grid refined about the change.
    """
    s = np.linspace(0.0, 1.0, JUMP_INTERVALS + 1)[1:-1]
    changes = []
    for _ in range(JUMP_GRIDS):
        values = _evaluate_path(path, s, order)
        change = np.abs(np.diff(values, axis=0)).max(axis=1)
        k = int(change.argmax())
        changes.append(change[k])
        s = np.linspace(s[k], s[k + 1], JUMP_INTERVALS)
    if changes[-1] > max(0.5 * changes[0], PATH_JUMP * np.abs(values).max()):
        raise InvalidInput(
            f"path: path(s, {order}) jumps at s = {s[0]:.6g} by {changes[-1]:.3g}, where the torque would "
            f"{'have no bound' if order == 1 else 'have to jump'}: round it, as a Polyline does its corners"
        )


def _test_intervals(path: Path) -> tuple[Array, Array]:
    """Return starts and lengths of intervals (DIFFERENCE_INTERVALS,) in [0, 1] that contain no knot.

    Starts are multiples of the golden ratio modulo 1, moved down where the interval would reach over a knot.
    """
    knots = np.asarray(path.knots, dtype=float)
    edges = np.concatenate(([0.0], knots, [1.0]))
    if not np.all(np.diff(edges) > 0):
        raise InvalidInput(f"path: knots must ascend inside (0, 1), got {knots.tolist()}")
    starts = np.mod(GOLDEN_RATIO * np.arange(1, DIFFERENCE_INTERVALS + 1), 1.0)
    panel = np.searchsorted(edges, starts, side="right") - 1
    lengths = np.minimum(INTERVAL_LENGTH, np.diff(edges)[panel])
    return np.minimum(starts, edges[panel + 1] - lengths), lengths


def _evaluate_path(path: Path, s: Array, order: int) -> Array:
    """Evaluate path(s, order) as an array (T, n) of finite numbers."""
    values = np.asarray(path(s, order), dtype=float)
    if values.shape != (len(s), path.n) or not np.all(np.isfinite(values)):
        raise InvalidInput(
            f"path: path(s, {order}) must give {path.n} finite numbers for each s, shape "
            f"({len(s)}, {path.n}), got shape {values.shape}"
        )
    return values
