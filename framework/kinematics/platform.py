"""The platform's coordinates x, its velocity v, and the relation v = E(x) dx/dt between them.

The components of v (n,) are the powers of n unit wrenches on the motion of the mechanism. All other
quantities refer to v: A v = B dq_a + C dq_e, the twist t_s, and the wrench W_p, whose power is W_p . v. So
the unit wrenches and E(x) define a platform:

    a frame on base axes    translations of its origin [m]: unit forces, v = dx; turns: the couples of a
                            chart (`attitude`) [rad]
    joints of the tree      their positions [rad, m]: the couple about the joint's axis, or the force along
                            it, which has power on that joint only; v = dx

dx and ddx are the time derivatives of x. Second derivatives of E and of the couples are complex steps of
their analytic first derivatives. With translations and none or three turns, v is (linear, angular) of the
frame at its origin on base axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from framework.kinematics.attitude import Attitude, TwistAngle, attitude_about, twist_angle_for
from framework.kinematics.frames import FrameMotions, FrameStack
from framework.kinematics.tree_model import is_slide
from framework.laws.path import Path
from framework.model.description import AXES, Platform
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import cross, matmul, matvec
from framework.numerics.rotations import whole_turns, wrap_angles

STEP: Any = 2.0**-120 * 1j  # of complex-step derivatives; its square is far below rounding
CoordinateRates = tuple[Array, Array, Array]  # x and two time derivatives, or displacements and rates


@dataclass(frozen=True, eq=False)
class _Coordinates(ReadOnlyArrays):
    """Platform coordinates x (n,) with v = dx; the common part of both kinds."""

    translations: BoolArray  # (n,) mask of coordinates in m; the others are turns [rad]
    # both are empty if the coordinates are positions of joints
    sliding: IntArray  # indices into x of the translations of the frame's origin
    along: IntArray  # base axis 0..2 of each of these translations

    @cached_property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.translations)

    @cached_property
    def is_point(self) -> bool:
        """Whether all coordinates are translations of the frame's origin."""
        return len(self.sliding) == self.n

    def twist(self, x: Array, dx: Array, ddx: Array | None = None) -> tuple[Array, Array]:
        """Compute v and dv/dt, each (T, n), for x, dx and ddx, each (T, n); ddx is zero if None."""
        return dx, np.zeros(dx.shape) if ddx is None else ddx

    def unit_twists(self, motion: CoordinateRates) -> Array:
        """Compute E' and two time derivatives of E' along a `motion` x, dx, ddx, (3, T, n, n).

        Row k is v at a unit rate of coordinate k.
        """
        twists = np.zeros((3, *motion[0].shape, self.n))  # E is the identity, so its derivatives are zero
        twists[0] = np.eye(self.n)
        return twists

    def rate_matrix(self, x: Array) -> Array:
        """Compute the matrix E (T, n, n) of v = E(x) dx at x (T, n)."""
        return self.unit_twists((x, np.zeros_like(x), np.zeros_like(x)))[0].swapaxes(1, 2)

    def path_twist(self, path: Path, s: float) -> Array:
        """Compute v (n,) on a path at path coordinate s, with ds/dt = 1."""
        parameter = np.array([s])
        v, _ = self.twist(path(parameter), path(parameter, 1))
        return v[0]


@dataclass(frozen=True, eq=False)
class FramePlatform(_Coordinates):
    """Translations of the origin of the mechanism's first frame along base axes, and its attitude."""

    axes: IntArray  # (n,) 0..5 into the twist (linear, angular)
    units: Array  # (n, 6) unit force (of a translation) or couple (of a turn) along each of these axes
    turning: IntArray  # indices into x of the turns, which the chart describes together
    attitude: Attitude  # chart of the turns

    @staticmethod
    def from_axes(names: Names) -> FramePlatform:
        """Return the platform whose coordinates belong to base axes named x, y, z, rx, ry or rz.

        The names are in the order of x. Translations and turns may stand in any order.
        """
        axes = np.array([AXES.index(name) for name in names])  # 0..2 translations, 3..5 turns
        translations = axes < 3
        sliding, turning = np.flatnonzero(translations), np.flatnonzero(~translations)  # indices into x
        return FramePlatform(
            translations=translations,
            sliding=sliding,
            along=axes[sliding],  # the base axes of the translations
            axes=axes,
            units=np.eye(6)[axes],  # unit forces and couples
            turning=turning,
            attitude=attitude_about(axes[turning] - 3),  # chart of the turns, about base axes 0..2
        )

    def choose_chart(self, rotations: Array) -> FramePlatform:
        """Return the same coordinates with the chart that suits attitudes R (T, 3, 3) of the frame."""
        if not isinstance(self.attitude, TwistAngle):
            return self
        return replace(self, attitude=twist_angle_for(self.attitude, rotations))

    @cached_property
    def constant(self) -> bool:
        """Whether the wrenches are the same at every pose."""
        return self.attitude.constant

    def coordinates(self, frames: FrameStack) -> Array:
        """Compute x (T, n) [m, rad]: positions of the frame's origin, angles of its attitude."""
        x = np.empty((len(frames.position), self.n))
        x[:, self.sliding] = frames.platform_origin[:, self.along]
        x[:, self.turning] = self.attitude.coordinates(frames.platform_rotation)
        return x

    def residual(self, frames: FrameStack, x: Array) -> Array:
        """Compute the offset (T, n) of the frame from x [m, rad], with turns within half a turn.

        The rate of the offset is v.
        """
        if self.is_point:
            return frames.platform_origin[:, self.along] - x
        offset = np.empty((len(x), self.n))
        offset[:, self.sliding] = frames.platform_origin[:, self.along] - x[:, self.sliding]
        offset[:, self.turning] = self.attitude.residual(frames.platform_rotation, x[:, self.turning])
        return offset

    def unwrap(self, x: Array, near: Array) -> Array:
        """Shift x (T, n) by the whole turns that bring x nearest to `near` (n,) or (T, n)."""
        x = x.copy()
        x[:, self.turning] = self.attitude.unwrap(x[:, self.turning], near[..., self.turning])
        return x

    def wrenches(self, frames: FrameStack) -> Array:
        """Compute the unit wrenches (T, n, 6), or (n, 6) if constant, about the frame's origin.

        They are unit forces and the couples of the attitude. Their powers on the frame's twist are v.
        """
        if self.constant:
            return self.units
        couples = self.attitude.couples(frames.platform_rotation)
        wrenches = np.repeat(self.units[None].astype(couples.dtype), len(couples), axis=0)
        wrenches[:, self.turning, 3:] = couples
        return wrenches

    def joint_incidence(self, carried: Array) -> Array:
        """Return 1 where a joint can move a coordinate, else 0, (n, nv).

        `carried` (nv,) is 1 for a joint that carries the frame. Such a joint can move all coordinates.
        """
        return np.repeat(carried[None], self.n, axis=0)

    def jacobian(self, frames: FrameStack) -> Array:
        """Compute the Jacobian (T, n, nv) of v: powers of the unit wrenches at unit joint rates."""
        twists = frames.frame_jacobian()  # (T, 6, nv) of the platform's frame
        return twists[:, self.axes] if self.constant else matmul(self.wrenches(frames), twists)

    def wrench_rates(self, motions: FrameMotions, screw_rates: Array) -> Array:
        """Compute two time derivatives (2, T, n, 6) of the unit wrenches about the base's origin.

        The moment of a unit force f at the origin p has the derivatives p' x f and p" x f. The first
        derivative of the chart's couples is analytic; a complex step of it gives the second. `screw_rates`
        are used only by `JointPlatform`.
        """
        rates = np.zeros((2, len(motions.twist), self.n, 6))
        origin_rates = motions.rates[1:, :, :1, 3]  # p' and p" of frame 0, (2, T, 1, 3)
        rates[..., 3:] = cross(origin_rates, self.units[:, :3])
        if not self.constant:
            axes, axis_rates = motions.rates[:2, :, 0, :3]  # (T, 3, 3) each, one axis a row
            rotation = (axes + STEP * axis_rates).swapaxes(1, 2)
            w = motions.twist[:, 0, 3:] + STEP * motions.twist_rate[:, 0, 3:]
            couples = self.attitude.couple_rates(rotation, w)
            rates[:, :, self.turning, 3:] = couples.real, couples.imag / STEP.imag
        return rates

    def drift(self, motions: FrameMotions) -> Array:
        """Compute dv/dt (T, n) for motions of frames: C dw/dt + dC/dt w for couples C."""
        rate = np.empty((len(motions.twist), self.n))
        # accelerations of the origin, the last of the four vectors of frame 0
        rate[:, self.sliding] = motions.rates[2][:, 0, 3, self.along]
        if len(self.turning):
            rotation = motions.rates[0, :, 0, :3].swapaxes(1, 2)  # (T, 3, 3) the axes as columns
            w, dw = motions.twist[:, 0, 3:], motions.twist_rate[:, 0, 3:]
            turns = matvec(self.attitude.couples(rotation), dw)
            rate[:, self.turning] = turns + matvec(self.attitude.couple_rates(rotation, w), w)
        return rate

    def frame_twist(self, frames: FrameStack, v: Array) -> Array:
        """Compute the twist (T, 6) of the frame for v (T, n), zero along axes without a coordinate."""
        twist = np.zeros((len(v), 6))
        twist[:, self.along] = v[:, self.sliding]
        twist[:, 3:] = self.attitude.angular_velocity(frames.platform_rotation, v[:, self.turning])
        return twist

    def twist(self, x: Array, dx: Array, ddx: Array | None = None) -> tuple[Array, Array]:
        """Compute v = E(x) dx and dv/dt, each (T, n); E is the identity except for rotation vectors."""
        dx, ddx = super().twist(x, dx, ddx)
        if self.attitude.rates_are_velocities:
            return dx, ddx
        turns = self.turning
        v, dv = dx.copy(), ddx.copy()
        rates = dx[:, turns]
        v[:, turns], dv[:, turns] = self.attitude.rates(x[:, turns], rates, rates, ddx[:, turns])
        return v, dv

    def unit_twists(self, motion: CoordinateRates) -> Array:
        """Compute the transpose of E and its two time derivatives along a `motion` x, dx, ddx, (3, T, n, n).

        E is the identity except for rotation vectors. Their three unit rates at T instants are evaluated as a
        stack of 3 T instants; a complex step gives the second derivative.
        """
        twists = super().unit_twists(motion)
        if self.attitude.rates_are_velocities:
            return twists
        turns = self.turning
        x, dx, ddx = (np.repeat(part[:, turns], 3, axis=0) for part in motion)  # (3 T, 3)
        units = np.tile(np.eye(3), (len(motion[0]), 1))  # (3 T, 3)
        v, dv = self.attitude.rates(x + STEP * dx, dx + STEP * ddx, units, np.zeros_like(units))
        rows = np.stack([v.real, dv.real, dv.imag / STEP.imag])  # (3, 3 T, 3)
        twists[..., turns[:, None], turns] = rows.reshape(3, -1, 3, 3)  # the block of the turns
        return twists


@dataclass(frozen=True, eq=False)
class JointPlatform(_Coordinates):
    """Positions of joints of the tree, with the same methods as `FramePlatform`."""

    columns: IntArray  # (n,) indices of the joints into pinocchio's velocity vector
    q_indices: IntArray  # (n,) indices of the joints into q

    @staticmethod
    def from_joints(names: Names, model: pin.Model) -> JointPlatform:
        """Return the platform whose coordinates are the positions of the hinges and slides `names`."""
        joints = [model.joints[model.getJointId(name)] for name in names]
        nothing = np.empty(0, dtype=np.intp)  # no coordinate is a translation of the frame
        return JointPlatform(
            translations=np.array([is_slide(joint) for joint in joints]),
            sliding=nothing,
            along=nothing,
            columns=np.array([joint.idx_v for joint in joints]),
            q_indices=np.array([joint.idx_q for joint in joints]),
        )

    def choose_chart(self, rotations: Array) -> JointPlatform:
        """Return the coordinates themselves: joints need no chart of attitudes."""
        return self

    def coordinates(self, frames: FrameStack) -> Array:
        """Return the positions x (T, n) of the joints [rad, m]."""
        return frames.q[:, self.q_indices]

    def residual(self, frames: FrameStack, x: Array) -> Array:
        """Compute the offset (T, n) of the joints from x [rad, m], with hinges within half a turn."""
        offset = frames.q[:, self.q_indices] - x
        return np.where(self.translations, offset, wrap_angles(offset))

    def unwrap(self, x: Array, near: Array) -> Array:
        """Shift hinges of x (T, n) by the whole turns nearest to `near` (n,) or (T, n)."""
        return np.where(self.translations, x, x + whole_turns(near - x))

    def wrenches(self, frames: FrameStack) -> Array:
        """Compute the unit wrenches (T, n, 6): couples about hinges and forces along slides."""
        # as a wrench the screw (d, 0) of a slide is a force along d; a hinge's (v, w) becomes the couple w
        wrenches = frames.screws[:, self.columns].copy()
        wrenches[:, ~self.translations, :3] = 0.0
        return wrenches

    def wrench_rates(self, motions: FrameMotions, screw_rates: Array) -> Array:
        """Return two time derivatives (2, T, n, 6) of the unit wrenches about the base's origin.

        A wrench is a couple about the axis of a hinge or a force along the axis of a slide, so its
        derivatives are those of the axis. A slide's force needs no moment about the base's origin: a moment
        has no power on a slide.

        Args:
            screw_rates: two time derivatives (2, T, nv, 6) of the joints' screws (linear, angular).
        """
        rates = screw_rates[:, :, self.columns].copy()
        rates[:, :, ~self.translations, :3] = 0.0  # of a hinge only the couple
        return rates

    def joint_incidence(self, carried: Array) -> Array:
        """Return 1 where a coordinate is the joint's own position, (n, nv)."""
        return np.eye(len(carried))[self.columns]

    def jacobian(self, frames: FrameStack) -> Array:
        """Return the derivative (T, n, nv) of v along joint rates: rows of the identity."""
        unit_rows = np.eye(frames.screws.shape[1])[self.columns]
        return np.repeat(unit_rows[None], len(frames.q), axis=0)

    def frame_twist(self, frames: FrameStack, v: Array) -> Array:
        """Compute the twist (T, 6) of the frame at its origin for v (T, n), the rates of the joints."""
        screws = frames.screws[:, self.columns]  # (T, n, 6)
        twist = matvec(screws.swapaxes(1, 2), v)  # at the base's origin
        twist[:, :3] += np.cross(twist[:, 3:], frames.platform_origin)
        return twist

    def drift(self, motions: FrameMotions) -> Array:
        """Return zeros (T, n): v consists of joint rates, so its Jacobian is constant."""
        return np.zeros((len(motions.twist), self.n))


PlatformCoordinates = FramePlatform | JointPlatform


def platform_coordinates(platform: Platform, model: pin.Model) -> PlatformCoordinates:
    """Return the coordinates that the platform of a robot file declares."""
    if platform.joints:
        return JointPlatform.from_joints(platform.joints, model)
    return FramePlatform.from_axes(platform.axes)
