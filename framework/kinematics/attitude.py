"""The attitude of a platform in one, two or three coordinates: charts of SO(3).

A chart turns the attitude R of the platform's frame into coordinates. To first order their rates are what
k couples yield on the angular velocity w of the frame,

    v = couples(R) w = E(x) dx,

and every one of A, B, C, t_s and W_p of the robot stands on this v; so W_p . v is a power in every chart.

    one axis      the twist angle about that base axis [rad], counted on through full turns: v = dx; the
                  couple is along the axis where the platform turns about it alone
    two axes      R = R_1(x_1) R_2(x_2) R_3(free): two hinges in series, the axis named first next to the
                  base, and whatever turn about the platform's third axis follows: v = dx. Which way the
                  third axis points depends on x alone. Singular where the second angle is a right one.
    three axes    the rotation vector: smooth, without an order of angles, singular only at a whole turn.
                  v = w = E(x) dx with E the left Jacobian of SO(3)

The attitude of a humanoid's ankle is R = Ry(pitch) Rx(roll): axes [ry, rx]. The parasitic turn of a
3-PRS is the free one: with R = Ry(t) Rx(p) Rz it is atan(sin p sin t / (cos p + cos t)), J. A. Carretero et
al., Kinematic analysis and optimization of a new three degree-of-freedom spatial parallel manipulator,
Journal of Mechanical Design 122, 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.linalg.ordered_sums import cross, dot
from framework.linalg.rotations import (
    left_jacobian_coefficients,
    left_jacobian_series,
    rotation_matrix,
    rotation_vector,
)
from framework.tolerances import FILE_ROUNDING

AttitudeRates = tuple[Array, Array, Array]  # coordinates (T, k) and two time derivatives, or turns and rates


class Attitude(Protocol):
    """A chart of k coordinates; T attitudes are rotations R (T, 3, 3), columns the frame's axes."""

    constant: bool  # whether the couples are the same at every attitude
    by_rates: bool  # whether v = dx

    def coordinates(self, rotation: Array) -> Array:
        """Compute coordinates x (T, k) [rad]."""
        ...

    def residual(self, rotation: Array, x: Array) -> Array:
        """Compute the offset of R from the attitude of x, (T, k), turns the short way: its rate is v."""
        ...

    def couples(self, rotation: Array) -> Array:
        """Compute the couples (T, k, 3), or (k, 3) if constant, in base axes: v = couples w."""
        ...

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        """Compute the couples' time derivatives (T, k, 3) at angular velocities w (T, 3)."""
        ...

    def couple_rate_changes(self, rotation: Array, w: Array, turn: Array, dw: Array) -> Array:
        """Compute what a small `turn` (T, 3) with a change dw of w makes of `couple_rates`, (T, k, 3)."""
        ...

    def turning(self, rotation: Array, v: Array) -> Array:
        """Compute w (T, 3) with couples w = v (T, k), without a turn that no coordinate measures."""
        ...

    def rates(self, x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
        """Compute v = E(x) dx and its time derivative, (T, k)."""
        ...

    def rate_changes(self, motion: AttitudeRates, step: AttitudeRates) -> AttitudeRates:
        """Compute the small turn of a step, and what it makes of v = E(x) dx and of its time derivative.

        `motion` and `step` are x, dx, ddx and small changes of them, each (T, k).
        """
        ...

    def unwrap(self, x: Array, near: Array) -> Array:
        """Compute coordinates (T, k) of the same attitudes next to `near` (k,) or (T, k)."""
        ...


def attitude_about(axes: IntArray) -> Attitude:
    """Return the chart of one, two or three different axes 0..2 in the stated order."""
    if len(axes) == 2:
        return TwoAngles.about(axes)
    return TwistAngle(axes) if len(axes) == 1 else RotationVector(axes)


@dataclass(frozen=True, eq=False)
class TwistAngle(ReadOnlyArrays):
    """One axis, and the turn about it by the swing-twist decomposition: that which leaves the least."""

    axes: IntArray  # (1,)
    constant = True
    by_rates = True

    def coordinates(self, rotation: Array) -> Array:
        i = int(self.axes[0])
        j, k = (i + 1) % 3, (i + 2) % 3
        sine = rotation[:, k, j] - rotation[:, j, k]
        return np.arctan2(sine, rotation[:, j, j] + rotation[:, k, k])[:, None]

    def residual(self, rotation: Array, x: Array) -> Array:
        return _short_way(self.coordinates(rotation) - x)

    def couples(self, rotation: Array) -> Array:
        return np.eye(3)[self.axes]

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        return np.zeros((len(w), 1, 3))

    def couple_rate_changes(self, rotation: Array, w: Array, turn: Array, dw: Array) -> Array:
        return np.zeros((len(w), 1, 3))

    def turning(self, rotation: Array, v: Array) -> Array:
        return v @ np.eye(3)[self.axes]

    def rates(self, x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
        return dx, ddx

    def rate_changes(self, motion: AttitudeRates, step: AttitudeRates) -> AttitudeRates:
        return step

    def unwrap(self, x: Array, near: Array) -> Array:
        return _by_full_turns(x, near)


@dataclass(frozen=True, eq=False)
class SwingTwistAngle(TwistAngle):
    """The same angle of a frame that turns about other axes too.

    With e the axis and u = R e, dx = (e + u) . w / (1 + e . u): along e alone where w is, else not.
    """

    constant = False

    def couples(self, rotation: Array) -> Array:
        axis = np.eye(3)[self.axes]
        both = axis + rotation[:, :, int(self.axes[0])]
        return (both / self._size(rotation)[:, None])[:, None]

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        i = int(self.axes[0])
        turned, size = rotation[:, :, i], self._size(rotation)[:, None]
        moved = cross(w, turned)
        both = np.eye(3)[self.axes] + turned
        return (moved / size - both * (moved[:, i, None] / size**2))[:, None]

    def couple_rate_changes(self, rotation: Array, w: Array, turn: Array, dw: Array) -> Array:
        i = int(self.axes[0])
        turned, size = rotation[:, :, i], self._size(rotation)[:, None]
        moved, shifted = cross(w, turned), cross(turn, turned)
        both = cross(dw, turned) + cross(w, shifted)
        sizes = [part[:, i, None] for part in (moved, shifted, both)]
        numerator = np.eye(3)[self.axes] + turned
        crossed = moved * sizes[1] + shifted * sizes[0] + numerator * sizes[2]
        twice = 2.0 * numerator * sizes[0] * sizes[1]
        return (both / size - crossed / size**2 + twice / size**3)[:, None]

    def _size(self, rotation: Array) -> Array:
        i = int(self.axes[0])
        return np.asarray(1.0 + rotation[:, i, i])


def twist_angle_for(angle: TwistAngle, rotations: Array) -> TwistAngle:
    """Return the chart for a frame with these attitudes (T, 3, 3): does it turn about the axis alone?"""
    axes = rotations[:, int(angle.axes[0])]  # the base's axis in the frame
    alone = np.abs(axes - axes[0]).max() <= FILE_ROUNDING
    return angle if alone else SwingTwistAngle(angle.axes)


@dataclass(frozen=True, eq=False)
class TwoAngles(ReadOnlyArrays):
    """Two axes a, b of the base: R = R_a(x_1) R_b(x_2) R_c(free), x_2 within a right angle.

    The angular velocity is w = dx_1 a + dx_2 R_a b + (free rate) R c; the couples are the two that
    yield dx_1 and dx_2 on it and nothing on the free turn.
    """

    axes: IntArray  # (2,)
    basis: Array  # (3, 3) rows a, b and c, a right-handed or a left-handed set
    hand: float  # a x b = hand c
    constant = False
    by_rates = True

    @staticmethod
    def about(axes: IntArray) -> TwoAngles:
        """Return the chart of two different axes 0..2."""
        order = [*axes, 3 - int(axes.sum())]
        basis = np.eye(3)[order]
        return TwoAngles(axes, basis, float(np.linalg.det(basis)))

    def coordinates(self, rotation: Array) -> Array:
        along = rotation @ self.basis[2] @ self.basis.T  # R c on a, b, c: (T, 3)
        first = np.arctan2(-self.hand * along[:, 1], along[:, 2])
        second = np.arctan2(self.hand * along[:, 0], np.hypot(along[:, 1], along[:, 2]))
        return np.stack([first, second], axis=1)

    def residual(self, rotation: Array, x: Array) -> Array:
        return _short_way(self.coordinates(rotation) - x)

    def couples(self, rotation: Array) -> Array:
        sine, cosine, tangent = self._parts(rotation)
        a, b, c = self.basis
        first = a + self.hand * tangent * (self.hand * sine * b - cosine * c)
        return np.stack([first, cosine * b + self.hand * sine * c], axis=1)

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        sine, cosine, tangent = self._parts(rotation)
        _, b, c = self.basis
        rates = np.sum(self.couples(rotation) * w[:, None], axis=2)
        first, second = rates[:, :1], (1 + tangent**2) * rates[:, 1:]
        across, along = self.hand * sine * b - cosine * c, cosine * b + self.hand * sine * c
        return np.stack(
            [
                self.hand * (second * across + self.hand * tangent * first * along),
                -self.hand * first * across,
            ],
            axis=1,
        )

    def couple_rate_changes(self, rotation: Array, w: Array, turn: Array, dw: Array) -> Array:
        sine, cosine, tangent = self._parts(rotation)
        _, b, c = self.basis
        couples, hand = self.couples(rotation), self.hand
        (first, second), (step, shift) = (
            (dot(couples[:, 0], turned)[:, None], dot(couples[:, 1], turned)[:, None]) for turned in (w, turn)
        )
        changed = self.couple_rates(rotation, turn)
        dfirst, dsecond = ((dot(changed[:, k], w) + dot(couples[:, k], dw))[:, None] for k in range(2))
        across, along = hand * sine * b - cosine * c, cosine * b + hand * sine * c
        slope = 1 + tangent**2  # of the tangent
        return np.stack(
            [
                hand * slope * ((2 * tangent * second * shift + dsecond) * across)
                + slope * (second * step + shift * first) * along
                + tangent * (dfirst * along - hand * first * step * across),
                -hand * dfirst * across - first * step * along,
            ],
            axis=1,
        )

    def turning(self, rotation: Array, v: Array) -> Array:
        sine, cosine, _ = self._parts(rotation)
        a, b, c = self.basis
        return v[:, :1] * a + v[:, 1:] * (cosine * b + self.hand * sine * c)

    def rates(self, x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
        return dx, ddx

    def rate_changes(self, motion: AttitudeRates, step: AttitudeRates) -> AttitudeRates:
        return step

    def unwrap(self, x: Array, near: Array) -> Array:
        return _by_full_turns(x, near)

    def _parts(self, rotation: Array) -> tuple[Array, Array, Array]:
        """Compute the sine and cosine of the first angle and tangent of the second, each (T, 1)."""
        first, second = np.split(self.coordinates(rotation), 2, axis=1)
        return np.sin(first), np.cos(first), np.tan(second)


@dataclass(frozen=True, eq=False)
class RotationVector(ReadOnlyArrays):
    """Three axes: the rotation vector, its components in the stated order."""

    axes: IntArray  # (3,) a permutation
    constant = True
    by_rates = False

    def coordinates(self, rotation: Array) -> Array:
        return rotation_vector(rotation)[:, self.axes]

    def residual(self, rotation: Array, x: Array) -> Array:
        target = rotation_matrix(self._vector(x))
        return rotation_vector(rotation @ target.transpose(0, 2, 1))[:, self.axes]

    def couples(self, rotation: Array) -> Array:
        return np.eye(3)[self.axes]

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        return np.zeros((len(w), 3, 3))

    def couple_rate_changes(self, rotation: Array, w: Array, turn: Array, dw: Array) -> Array:
        return np.zeros((len(w), 3, 3))

    def turning(self, rotation: Array, v: Array) -> Array:
        return self._vector(v)

    def rates(self, x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
        r, dr, ddr = (self._vector(part) for part in (x, dx, ddx))
        a, da, b, db = left_jacobian_series(dot(r, r), dot(r, dr))
        swept, swept_twice = cross(r, dr), cross(r, cross(r, dr))
        omega = dr + a * swept + b * swept_twice
        alpha = (
            ddr
            + a * cross(r, ddr)
            + da * swept
            + b * (cross(dr, swept) + cross(r, cross(r, ddr)))
            + db * swept_twice
        )
        return omega[:, self.axes], alpha[:, self.axes]

    def rate_changes(self, motion: AttitudeRates, step: AttitudeRates) -> AttitudeRates:
        """Compute them from phi = E(x) step: dw = phi' + phi x w, and the rate of that along the motion."""
        omega, alpha = (self._vector(part) for part in self.rates(*motion))
        r, dr, ddr = (self._vector(part) for part in motion)
        s, ds, dds = (self._vector(part) for part in step)
        square_rate, square_second = 2.0 * dot(r, dr), 2.0 * (dot(dr, dr) + dot(r, ddr))
        (a, a1, a2), (b, b1, b2) = left_jacobian_coefficients(dot(r, r))[..., None]
        rate, second = square_rate[:, None], square_second[:, None]
        da, dda = a1 * rate, a2 * rate**2 + a1 * second
        db, ddb = b1 * rate, b2 * rate**2 + b1 * second
        # r x s and r x (r x s) with two time derivatives
        once = cross(r, s)
        donce = cross(dr, s) + cross(r, ds)
        ddonce = cross(ddr, s) + 2.0 * cross(dr, ds) + cross(r, dds)
        twice = cross(r, once)
        dtwice = cross(dr, once) + cross(r, donce)
        ddtwice = cross(ddr, once) + 2.0 * cross(dr, donce) + cross(r, ddonce)
        phi = s + a * once + b * twice
        dphi = ds + da * once + a * donce + db * twice + b * dtwice
        ddphi = dds + dda * once + 2 * da * donce + a * ddonce + ddb * twice + 2 * db * dtwice + b * ddtwice
        changes = (phi, dphi + cross(phi, omega), ddphi + cross(dphi, omega) + cross(phi, alpha))
        turn, dw, dalpha = (part[:, self.axes] for part in changes)
        return turn, dw, dalpha

    def unwrap(self, x: Array, near: Array) -> Array:
        angle = np.sqrt(dot(x, x))[:, None]
        about = x / np.where(angle > 0, angle, 1.0)
        missing = dot(about, near)[:, None] - angle
        return x + 2 * np.pi * np.round(missing / (2 * np.pi)) * about

    def _vector(self, x: Array) -> Array:
        """Return vectors (T, 3) on the base's axes of components (T, 3) in the stated order."""
        vector = np.empty_like(x)
        vector[:, self.axes] = x
        return vector


def _short_way(difference: Array) -> Array:
    return np.mod(difference + np.pi, 2 * np.pi) - np.pi


def _by_full_turns(x: Array, near: Array) -> Array:
    return x + 2 * np.pi * np.round((near - x) / (2 * np.pi))
