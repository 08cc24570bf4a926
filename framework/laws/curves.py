"""Paths through points that are not a straight line: arcs, splines and rounded polylines.

If some coordinates are in metres and others in radians, an arc's circle and a spline's chords count 1 m like
1 rad. Through the same points in other units such a path is another curve; only a line stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import Polynomial

from framework.errors import InvalidInput
from framework.laws.law import is_number
from framework.laws.path import HIGHEST_ORDER, NO_KNOTS, PointPath, check_points
from framework.numerics.arrays import Array
from framework.tolerances import DEGENERATE_PATH, SMALLEST_BLEND


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
        points = check_points([self.start, self.via, self.end], 3, "arc")
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
        points = check_points(self.points, 2, "spline")
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
        points = check_points(self.points, 3, "polyline")
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
        self._store(points=points, blend=blend, knots=knots, _arc_lengths=arc_lengths, _directions=directions)

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
