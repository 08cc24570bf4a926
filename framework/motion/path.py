"""Where the platform goes: paths x(s), s in [0, 1], with derivatives in s.

All paths share one call, `path(s, order)`: s of shape (T,) gives (T, n), a scalar gives (n,).
`knots` (inside (0, 1)) are the places where a path is only finitely smooth; functions of time get a
panel on either side of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from framework.arrays import Array, ArrayLike
from framework.errors import InvalidInput

HIGHEST_ORDER = 4  # derivatives that an elastic robot's torque needs
LARGEST = 1e30  # [m, rad] coordinate whose powers do not overflow


@runtime_checkable
class Path(Protocol):
    """Anything with `n` coordinates, `knots` and `path(s, order)`."""

    @property
    def n(self) -> int: ...

    @property
    def knots(self) -> Array: ...

    def __call__(self, s: ArrayLike, order: int = 0) -> Array: ...


def _points(points: Any, least: int, kind: str) -> Array:
    """Points (m, n) as an array; raises InvalidInput when they do not make a path."""
    try:
        array = np.array(points, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{kind}: points must be lists of numbers of one length, got {points!r}") from None
    if array.ndim != 2 or array.shape[0] < least or array.shape[1] < 1:
        raise InvalidInput(f"{kind}: needs at least {least} points (m, n), got {points!r}")
    if not np.all(np.isfinite(array)):
        raise InvalidInput(f"{kind}: points must be finite numbers, got {points!r}")
    if np.any(np.abs(array) > LARGEST):
        raise InvalidInput(f"{kind}: points must be at most {LARGEST:g} in size, got {points!r}")
    if np.any(np.linalg.norm(np.diff(array, axis=0), axis=1) == 0):
        raise InvalidInput(f"{kind}: two points in a row are the same: {points!r}")
    array.flags.writeable = False
    return array


def _stack(s: ArrayLike, values: Array) -> Array:
    return values.reshape(*np.shape(s), values.shape[1])


class PointPath:
    """A path that its `points` (m, n) define: equal to another of its kind through the same points."""

    kind: ClassVar[str]
    points: Any

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, PointPath)
            and type(self) is type(other)
            and np.array_equal(self.points, other.points)
        )

    def __hash__(self) -> int:
        return hash((self.kind, self.points.tobytes()))


class Line(PointPath):
    """The straight segment from `start` to `end`, both (n,): x(s) = start + s (end - start)."""

    kind = "line"
    knots = np.empty(0)

    def __init__(self, start: ArrayLike, end: ArrayLike) -> None:
        self.points = _points([start, end], 2, "line")
        self.start, self.end = self.points
        self.n = len(self.start)

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        flat = np.atleast_1d(np.asarray(s, dtype=float)).reshape(-1, 1)
        direction = self.end - self.start
        if order == 0:
            return _stack(s, self.start + flat * direction)
        return _stack(s, np.broadcast_to(direction if order == 1 else 0.0 * direction, (len(flat), self.n)))

    def __repr__(self) -> str:
        return f"Line({self.start.tolist()}, {self.end.tolist()})"


class Arc(PointPath):
    """The circular arc from `start` through `via` to `end`, each (n,), n >= 2, at constant speed."""

    kind = "arc"
    knots = np.empty(0)

    def __init__(self, start: ArrayLike, via: ArrayLike, end: ArrayLike) -> None:
        self.points = points = _points([start, via, end], 3, "arc")
        self.start, self.via, self.end = points
        self.n = points.shape[1]
        first, second = self.via - self.start, self.end - self.start
        plane = np.array([[first @ first, first @ second], [first @ second, second @ second]])
        if self.n < 2 or np.linalg.det(plane) <= 1e-18 * np.trace(plane) ** 2:
            raise InvalidInput(f"arc: its three points lie on a line: {points.tolist()}")
        weights = np.linalg.solve(plane, 0.5 * np.diag(plane))
        self.center = self.start + weights @ np.array([first, second])
        spoke = self.start - self.center
        self.radius = float(np.linalg.norm(spoke))
        self._u = spoke / self.radius
        across = first - (first @ self._u) * self._u
        self._w = across / np.linalg.norm(across)
        angle_via, angle_end = (self._angle(point) for point in (self.via, self.end))
        # `via` lies between the ends: its angle decides which way round the arc goes
        self.angle = angle_end if angle_via < angle_end else angle_end - 2 * np.pi

    def _angle(self, point: Array) -> float:
        spoke = point - self.center
        return float(np.arctan2(spoke @ self._w, spoke @ self._u) % (2 * np.pi))

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        phase = np.atleast_1d(np.asarray(s, dtype=float)).reshape(-1, 1) * self.angle
        turned = phase + order * np.pi / 2
        wheel = self.radius * self.angle**order * (np.cos(turned) * self._u + np.sin(turned) * self._w)
        return _stack(s, wheel + self.center if order == 0 else wheel)

    def __repr__(self) -> str:
        return f"Arc({self.start.tolist()}, {self.via.tolist()}, {self.end.tolist()})"


@dataclass(frozen=True, eq=False)
class Spline(PointPath):
    """The spline through `points` (m, n) with four continuous derivatives, by chord length.

    Degree 5, or m - 1 for fewer than six points: the torque of an elastic robot needs x''''.
    """

    kind: ClassVar[str] = "spline"
    points: Any
    knots: Array = field(init=False, repr=False)
    n: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = _points(self.points, 2, "spline")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "n", points.shape[1])
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if chords.min() < 1e-9 * chords.max():
            k = int(np.argmin(chords))
            raise InvalidInput(
                f"spline: points {k} and {k + 1} are {chords[k]:.3g} apart, others {chords.max():.3g}: too "
                f"uneven to tell their places on the curve"
            )
        degree = min(5, len(points) - 1)
        inner = np.unique(self._spline.t[degree + 1 : -degree - 1])
        object.__setattr__(self, "knots", inner)

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import make_interp_spline

        chords = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        at = np.concatenate(([0.0], np.cumsum(chords) / chords.sum()))
        at[-1] = 1.0
        return make_interp_spline(at, self.points, k=min(5, len(self.points) - 1))

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        flat = np.atleast_1d(np.asarray(s, dtype=float)).ravel()
        if order > self._spline.k:
            return _stack(s, np.zeros((flat.size, self.n)))
        return _stack(s, self._spline(flat, nu=order))


def along(path: Path, law_values: list[Array]) -> list[Array]:
    """Time derivatives of x(s(t)), orders 0 .. len(law_values) - 1 (at most 4), each (T, n).

    `law_values[k]` (T,) is the k-th time derivative of s. Faa di Bruno's formula, written out.
    """
    order = len(law_values) - 1
    if order > HIGHEST_ORDER:
        raise InvalidInput(f"order {order} of the platform motion (valid: 0 .. {HIGHEST_ORDER})")
    s = law_values[0]
    x = [path(s, k) for k in range(order + 1)]
    d = [value[..., None] for value in law_values]
    out = [x[0]]
    if order >= 1:
        out.append(x[1] * d[1])
    if order >= 2:
        out.append(x[1] * d[2] + x[2] * d[1] ** 2)
    if order >= 3:
        out.append(x[1] * d[3] + 3 * x[2] * d[1] * d[2] + x[3] * d[1] ** 3)
    if order >= 4:
        out.append(
            x[1] * d[4]
            + x[2] * (4 * d[1] * d[3] + 3 * d[2] ** 2)
            + 6 * x[3] * d[1] ** 2 * d[2]
            + x[4] * d[1] ** 4
        )
    return out
