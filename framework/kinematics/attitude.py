"""The attitude of a platform in one, two or three coordinates: charts of SO(3).

A chart maps the attitude R of the platform's frame to k coordinates x. The velocity v consists of the powers
of k couples on the angular velocity w of the frame,

    v = couples(R) w = E(x) dx,

where dx are the time derivatives of x.

A, B, C, t_s and W_p of the robot refer to this v, so W_p . v is a power in every chart. The couples,
their rates and E(x) are analytic functions, so complex steps differentiate them.

    one axis      the twist angle about that base axis [rad], counted through full turns: v = dx. If the
                  platform turns about this axis alone, the couple is along it
    two axes      R = R_1(x_1) R_2(x_2) R_3(free): two hinges in series, the axis named first next to the
                  base, followed by any turn about the platform's third axis: v = dx. The direction of the
                  third axis depends on x alone. Singular where x_2 is a right angle
    three axes    the rotation vector: smooth, without an order of angles, singular only at a whole turn.
                  v = w = E(x) dx with E the left Jacobian of SO(3)

The attitude of a humanoid's ankle is R = Ry(pitch) Rx(roll): axes [ry, rx]. The parasitic turn of a 3-PRS is
the free turn: with R = Ry(t) Rx(p) Rz it is atan(sin p sin t / (cos p + cos t)), J. A. Carretero et al.,
Kinematic analysis and optimization of a new three degree-of-freedom spatial parallel manipulator, Journal of
Mechanical Design 122, 2000.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput
from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import cross, dot
from framework.numerics.rotations import (
    left_jacobian_coefficients,
    rotation_matrix,
    rotation_vector,
    whole_turns,
    wrap_angles,
)
from framework.tolerances import FILE_ROUNDING


@dataclass(frozen=True, eq=False)
class Attitude(ReadOnlyArrays):
    """A chart of k coordinates of attitudes R.

    R is the argument `rotation` (T, 3, 3); its columns are the axes of the frame. The methods of this class
    hold for couples along base axes and v = dx. Without axes (k = 0) the class itself is the chart of a
    platform that does not turn.
    """

    axes: IntArray  # (k,) base axes 0..2 in the stated order
    constant = True  # whether the couples are the same at every attitude
    rates_are_velocities = True  # whether v = dx

    def coordinates(self, rotation: Array) -> Array:
        """Compute coordinates x (T, k) [rad]."""
        return np.empty((len(rotation), 0))

    def residual(self, rotation: Array, x: Array) -> Array:
        """Compute the offset (T, k) [rad] of R from the attitude of x, within half a turn.

        The rate of the offset is v.
        """
        return wrap_angles(self.coordinates(rotation) - x)

    def couples(self, rotation: Array) -> Array:
        """Compute the couples (T, k, 3), or (k, 3) if constant, on base axes: v = couples w."""
        return np.eye(3)[self.axes]

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        """Compute the couples' time derivatives (T, k, 3) at angular velocities w (T, 3)."""
        return np.zeros((len(w), len(self.axes), 3))

    def angular_velocity(self, rotation: Array, v: Array) -> Array:
        """Compute the angular velocity w (T, 3) with couples(R) w = v (T, k) and no free turn."""
        return v @ np.eye(3)[self.axes]

    def rates(self, x: Array, dx: Array, u: Array, du: Array) -> tuple[Array, Array]:
        """Compute E(x) u and its time derivative, (T, k) each, for u (T, k), such as dx.

        dx and du (T, k) are the time derivatives of x (T, k) and u. E is the identity where v = dx.
        """
        return u, du

    def unwrap(self, x: Array, near: Array) -> Array:
        """Return the coordinates (T, k) of the attitudes x that are nearest to `near` (k,) or (T, k)."""
        return x + whole_turns(near - x)


def attitude_about(axes: IntArray) -> Attitude:
    """Return the chart for zero to three different axes 0..2 in the stated order."""
    return (Attitude, TwistAngle, TwoAngles, RotationVector)[len(axes)](axes)


@dataclass(frozen=True, eq=False)
class TwistAngle(Attitude):
    """The turn about one axis by the swing-twist decomposition: the remaining rotation is the smallest."""

    def coordinates(self, rotation: Array) -> Array:
        """Compute the angle (T, 1) [rad] about axis i: arctan2(R_kj - R_jk, R_jj + R_kk), ijk cyclic.

        For a turn by an angle t about the axis alone, the two arguments are 2 sin t and 2 cos t.
        """
        i = int(self.axes[0])
        j, k = (i + 1) % 3, (i + 2) % 3
        sine = rotation[:, k, j] - rotation[:, j, k]  # sine and cosine of the angle, times the same factor
        cosine = rotation[:, j, j] + rotation[:, k, k]
        return np.arctan2(sine, cosine)[:, None]


@dataclass(frozen=True, eq=False)
class DirectionChart(Attitude):
    """Angles whose couples depend on the attitude only by the direction u = R e of a frame axis e."""

    constant = False

    @property
    def frame_axis(self) -> int:
        """The index of the frame axis e."""
        return int(self.axes[0])

    @abstractmethod
    def direction_couples(self, u: Array, du: Array) -> tuple[Array, Array]:
        """Compute the couples and their rates, (T, k, 3) each, for u (T, 3) and its rate du (T, 3).

        Both are analytic in u and du, so complex steps differentiate them.
        """

    def couples(self, rotation: Array) -> Array:
        """Compute the couples (T, k, 3) on base axes at attitudes (T, 3, 3)."""
        u = rotation[:, :, self.frame_axis]
        return self.direction_couples(u, np.zeros_like(u))[0]

    def couple_rates(self, rotation: Array, w: Array) -> Array:
        """Compute the couples' time derivatives (T, k, 3); u moves at w x u."""
        u = rotation[:, :, self.frame_axis]
        return self.direction_couples(u, cross(w, u))[1]


@dataclass(frozen=True, eq=False)
class SwingTwistAngle(DirectionChart, TwistAngle):
    """The angle of `TwistAngle` for a frame that also turns about other axes.

    With e the axis and u = R e, dx = (e + u) . w / (1 + e . u). If w is along e, dx is its size.
    """

    def direction_couples(self, u: Array, du: Array) -> tuple[Array, Array]:
        """Compute the couple (e + u) / (1 + e . u) and its rate, (T, 1, 3) each.

        `du` (T, 3) is the rate of the direction u (T, 3).
        """
        i = self.frame_axis  # e is a unit vector of the base, so e . u is the component i of u
        divisor = 1.0 + u[:, i, None]
        couple = (np.eye(3)[i] + u) / divisor  # (T, 3)
        rate = (du - couple * du[:, i, None]) / divisor
        return couple[:, None], rate[:, None]


def twist_angle_for(angle: TwistAngle, rotations: Array) -> TwistAngle:
    """Return `angle` if attitudes (T, 3, 3) turn about its axis alone, else a `SwingTwistAngle`.

    Raises:
        InvalidInput: the frame also turns about other axes, and its first attitude has no twist angle.
    """
    i = int(angle.axes[0])
    axes = rotations[:, i]  # (T, 3) the base's axis i in coordinates of the frame
    if np.abs(axes - axes[0]).max() <= FILE_ROUNDING:  # constant: the frame turns about this axis alone
        return angle
    if 1.0 + rotations[0, i, i] <= FILE_ROUNDING:
        raise InvalidInput(
            f"platform: r{'xyz'[i]} of its frame is against that of the base, where the turn about it is not "
            f"defined; choose another frame or other axes"
        )
    return SwingTwistAngle(angle.axes)


@dataclass(frozen=True, eq=False)
class TwoAngles(DirectionChart):
    """Two axes a, b of the base: R = R_a(x_1) R_b(x_2) R_c(free), x_2 within a right angle.

    The angular velocity is w = dx_1 a + dx_2 R_a b + (free rate) R c. The powers of the two couples on w are
    dx_1 and dx_2, whatever the free rate is. They depend on u = R c and on the `handedness` h: a x b = h c.
    """

    @property
    def frame_axis(self) -> int:
        """The index of the third axis c."""
        return 3 - int(self.axes.sum())

    @property
    def handedness(self) -> float:
        """The sign h: 1 if a, b and c are right-handed, else -1."""
        return float(np.linalg.det(np.eye(3)[[*self.axes, self.frame_axis]]))

    def coordinates(self, rotation: Array) -> Array:
        """Compute the angles x_1, x_2 (T, 2) [rad] from u = R c: u = R_a(x_1) R_b(x_2) c."""
        u = rotation[:, :, self.frame_axis]
        along_a, along_b, along_c = u[:, [*self.axes, self.frame_axis]].T  # (T,) each
        # u = h sin x_2 a + cos x_2 (cos x_1 c - h sin x_1 b), with cos x_2 >= 0
        first = np.arctan2(-self.handedness * along_b, along_c)
        second = np.arctan2(self.handedness * along_a, np.hypot(along_b, along_c))
        return np.stack([first, second], axis=1)

    def direction_couples(self, u: Array, du: Array) -> tuple[Array, Array]:
        """Compute the two couples and their time derivatives, (T, 2, 3) each.

        Primes are time derivatives, u' = `du`. q = u - (a . u) a is the part of u (T, 3) normal to the first
        axis a. With p = q / q^2, which has the direction of q and the length 1 / |q|, and the rate g = p . q'
        of log |q|, the couples and their rates are

            a - (a . u) p             rate  -(a . u') p - (a . u) p',    p' = q' / q^2 - 2 g p
            R_a b = h u x a / |q|     rate  h u' x a / |q| - g R_a b
        """
        a = np.eye(3)[self.axes[0]]
        au, dau = u[:, self.axes[:1]], du[:, self.axes[:1]]  # (T, 1) a.u and its rate
        q, dq = u - au * a, du - dau * a  # (T, 3)
        square = dot(q, q)[:, None]
        p = q / square
        g = dot(p, dq)[:, None]
        dp = dq / square - 2.0 * g * p

        factor = self.handedness / np.sqrt(square)  # h / |q|
        b = factor * cross(u, a)
        db = factor * cross(du, a) - g * b

        couples = np.stack([a - au * p, b], axis=1)
        rates = np.stack([-dau * p - au * dp, db], axis=1)
        return couples, rates

    def angular_velocity(self, rotation: Array, v: Array) -> Array:
        """Compute w = dx_1 a + dx_2 R_a b (T, 3), with the free turn at rest.

        v = dx (T, 2) are the rates of both angles. R_a is the turn by x_1 about the first axis a, which takes
        the second axis b with it.
        """
        a = np.eye(3)[self.axes[0]]
        turned_b = self.couples(rotation)[:, 1]  # R_a b, the second couple
        return v[:, :1] * a + v[:, 1:] * turned_b


@dataclass(frozen=True, eq=False)
class RotationVector(Attitude):
    """Three axes: the rotation vector, with its components in the stated order."""

    rates_are_velocities = False

    def coordinates(self, rotation: Array) -> Array:
        """Compute the rotation vectors (T, 3) [rad], components in the stated order."""
        return rotation_vector(rotation)[:, self.axes]

    def residual(self, rotation: Array, x: Array) -> Array:
        """Compute the rotation vector (T, 3) [rad] of the turn from the attitude of x to R."""
        target = rotation_matrix(self._vector(x))
        return rotation_vector(rotation @ target.transpose(0, 2, 1))[:, self.axes]

    def rates(self, x: Array, dx: Array, u: Array, du: Array) -> tuple[Array, Array]:
        """Compute w = E(r) u and dw/dt, each (T, 3), for rotation vectors r.

        The rotation vector r and its rate dr are the arguments x and dx. The left Jacobian E gives
        w = u + a f + b s with f = r x u and s = r x f. Its coefficients a and b are functions of |r|^2, whose
        rate is 2 r.dr. The rates of f and s are dr x u + r x du and dr x f + r x df. For u = dr, w is the
        angular velocity.

        Args:
            x, dx, u, du: (T, 3) each, with components in the stated order of the axes.
        """
        r, dr, u, du = map(self._vector, (x, dx, u, du))
        f = cross(r, u)
        df = cross(dr, u) + cross(r, du)
        s = cross(r, f)
        ds = cross(dr, f) + cross(r, df)
        # values (T, 1) and slopes along |r|^2
        (a, a_slope), (b, b_slope) = left_jacobian_coefficients(dot(r, r))[..., None]
        square_rate = 2.0 * dot(r, dr)[:, None]
        by_f = a_slope * square_rate * f + a * df  # the rate of a f
        by_s = b_slope * square_rate * s + b * ds  # the rate of b s
        return (u + a * f + b * s)[:, self.axes], (du + by_f + by_s)[:, self.axes]

    def unwrap(self, x: Array, near: Array) -> Array:
        """Add whole turns along rotation vectors x (T, 3) [rad] until nearest to `near`."""
        angle = np.sqrt(dot(x, x))[:, None]
        axis = x / np.where(angle > 0, angle, 1.0)  # zero for the zero rotation
        difference = dot(axis, near)[:, None] - angle  # of the part of `near` along the axis
        return x + whole_turns(difference) * axis

    def _vector(self, x: Array) -> Array:
        """Return vectors (T, 3) on base axes for components x (T, 3) in the stated order."""
        vector = np.empty_like(x)
        vector[:, self.axes] = x
        return vector
