"""The platform's coordinates x, its twist v, and how the rates of one make the other.

Translations are the coordinates of the frame's origin in the base frame [m]. A platform that turns about one
axis has the twist angle about that base axis as coordinate [rad], counted on through full turns. One that
turns about all three has the rotation vector of its frame with respect to the base: smooth, without an
order of angles, singular only at a whole turn. v is (linear, angular) at the frame's origin on base axes,
so v = T(x) dx with T the left Jacobian of SO(3) in the last case and the identity in all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.kinematics.frames import FrameStack, cross
from framework.linalg.ordered_sums import dot
from framework.model.description import AXES
from framework.motion.path import Path


@dataclass(frozen=True, eq=False)
class PlatformCoordinates(ReadOnlyArrays):
    """The coordinates x (n,) of a platform by kind: their places in x, and their axes 0..2."""

    axes: IntArray  # (n,) 0..5 into the twist (linear, angular)
    translations: NDArray[np.bool_]  # (n,) the others are turns
    sliding: IntArray
    along: IntArray
    turning: IntArray
    about: IntArray

    @staticmethod
    def of(names: Sequence[str]) -> PlatformCoordinates:
        """The coordinates on axes out of x, y, z, rx, ry, rz."""
        axes = np.array([AXES.index(name) for name in names])
        translations = axes < 3
        sliding, turning = np.flatnonzero(translations), np.flatnonzero(~translations)
        return PlatformCoordinates(axes, translations, sliding, axes[sliding], turning, axes[turning] - 3)

    def coordinates(self, at: FrameStack) -> Array:
        """Coordinates x (T, n) of the platform on its axes, in the base frame [m, rad]."""
        sliding, along, turning, about = self.sliding, self.along, self.turning, self.about
        x = np.empty((len(at.position), len(self.axes)))
        x[:, sliding] = at.position[:, 0, along]
        if len(turning) == 1:
            x[:, turning] = _twist_angle(at.rotation[:, 0], int(about[0]))[:, None]
        elif len(turning):
            x[:, turning] = _logarithm(at.rotation[:, 0])[:, about]
        return x

    def residual(self, at: FrameStack, x: Array) -> Array:
        """How far the platform is from x, (T, n); turns are taken the short way round."""
        sliding, along, turning, about = self.sliding, self.along, self.turning, self.about
        if not len(turning):
            return at.position[:, 0, along] - x
        if len(turning) == 1:
            difference = self.coordinates(at) - x
            difference[:, turning] = np.mod(difference[:, turning] + np.pi, 2 * np.pi) - np.pi
            return difference
        difference = np.empty((len(x), len(self.axes)))
        difference[:, sliding] = at.position[:, 0, along] - x[:, sliding]
        target = rotation_matrix(self._rotation_vector(x))
        difference[:, turning] = _logarithm(at.rotation[:, 0] @ target.transpose(0, 2, 1))[:, about]
        return difference

    def unwrap(self, x: Array, near: Array) -> Array:
        """Coordinates x (T, n) with turns counted on through full ones, next to `near` (n,) or (T, n)."""
        turning = self.turning
        if not len(turning):
            return x
        vector = x[:, turning]
        angle = np.sqrt(dot(vector, vector))[:, None]
        about = vector / np.where(angle > 0, angle, 1.0)
        missing = dot(about, near[..., turning])[:, None] - angle
        x = x.copy()
        x[:, turning] = vector + 2 * np.pi * np.round(missing / (2 * np.pi)) * about
        return x

    def jacobian(self, at: FrameStack) -> Array:
        """Derivative (T, n, nv) of the platform's twist on its axes along pinocchio's velocity vector."""
        only = at._replace(position=at.position[:, :1], carried=at.carried[:1])
        return only.jacobian[:, 0, self.axes]

    def twist(self, x: Array, dx: Array, ddx: Array | None = None) -> tuple[Array, Array]:
        """Twist v and its time derivative (T, n) for coordinates x and their rates, each (T, n)."""
        ddx = np.zeros_like(dx) if ddx is None else ddx
        turning, order = self.turning, self.about
        if len(turning) < 2:
            return dx, ddx
        r, dr, ddr = (self._rotation_vector(part) for part in (x, dx, ddx))
        a, da, b, db = _left_jacobian_series(dot(r, r), dot(r, dr))
        swept, swept_twice = cross(r, dr), cross(r, cross(r, dr))
        omega = dr + a * swept + b * swept_twice
        alpha = (
            ddr
            + a * cross(r, ddr)
            + da * swept
            + b * (cross(dr, swept) + cross(r, cross(r, ddr)))
            + db * swept_twice
        )
        v, dv = dx.copy(), ddx.copy()
        v[:, turning], dv[:, turning] = omega[:, order], alpha[:, order]
        return v, dv

    def path_twist(self, path: Path, s: float) -> Array:
        """Twist (n,) of the platform for ds/dt = 1 at path coordinate s."""
        here = np.array([s])
        return self.twist(path(here), path(here, 1))[0][0]

    def _rotation_vector(self, x: Array) -> Array:
        """The rotation vector (T, 3) among coordinates (T, n)."""
        vector = np.zeros((len(x), 3))
        vector[:, self.about] = x[:, self.turning]
        return vector


def rotation_matrix(vector: Array) -> Array:
    """Rotation matrices (T, 3, 3) of rotation vectors (T, 3) [rad]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _logarithm(rotation: Array) -> Array:
    """Rotation vectors (T, 3) of rotations (T, 3, 3), NaN where one is not finite."""
    trace = rotation[:, 0, 0] + rotation[:, 1, 1] + rotation[:, 2, 2]
    if (trace > 0.0).all():  # by less than 120 degrees: what is not symmetric says it all
        doubled = (rotation - rotation.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]]  # 2 sin(t) times the axis
        angle = np.arctan2(0.5 * np.sqrt(dot(doubled, doubled)), 0.5 * (trace - 1.0))
        return np.asarray(0.5 * doubled / np.sinc(angle / np.pi)[:, None])
    from scipy.spatial.transform import Rotation

    finite = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    if not finite.all():
        rotation = np.where(finite[:, None, None], rotation, np.eye(3))
    return np.where(finite[:, None], Rotation.from_matrix(rotation).as_rotvec(), np.nan)


def _left_jacobian_series(square: Array, half_rate: Array) -> tuple[Array, Array, Array, Array]:
    """a = (1 - cos t) / t^2, b = (t - sin t) / t^3 and their time derivatives, each (T, 1).

    `square` is t^2, `half_rate` half its time derivative. Below one radian by their series, which the
    closed forms lose to cancellation.
    """
    small = square < 1.0
    t = np.sqrt(np.where(small, 1.0, square))
    a_series, b_series, da_series, db_series = (np.zeros_like(square) for _ in range(4))
    term_a, term_b = 0.5, 1.0 / 6.0
    for k in range(12):  # the last term is below 1e-17 for t < 1
        power = square**k
        a_series += term_a * power
        b_series += term_b * power
        term_a /= -(2 * k + 3) * (2 * k + 4)
        term_b /= -(2 * k + 4) * (2 * k + 5)
        da_series += term_a * (k + 1) * power  # derivative with respect to t^2
        db_series += term_b * (k + 1) * power
    a = np.where(small, a_series, (1 - np.cos(t)) / t**2)
    b = np.where(small, b_series, (t - np.sin(t)) / t**3)
    da = np.where(small, da_series, (t * np.sin(t) - 2 * (1 - np.cos(t))) / (2 * t**4))
    db = np.where(small, db_series, (t * (1 - np.cos(t)) - 3 * (t - np.sin(t))) / (2 * t**5))
    rate = (2 * half_rate)[:, None]
    return a[:, None], da[:, None] * rate, b[:, None], db[:, None] * rate


def _twist_angle(rotation: Array, axis: int) -> Array:
    """Angle (T,) about one base axis in the swing-twist decomposition of rotations (T, 3, 3)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    return np.arctan2(rotation[:, k, j] - rotation[:, j, k], rotation[:, j, j] + rotation[:, k, k])
