"""The platform's coordinates x, its velocity v, and how the rates of one make the other.

v (n,) is the power of n wrenches of unit size on the motion of the mechanism, and v = E(x) dx. All other
quantities refer to v: A v = B dq_a + C dq_e, the twist t_s, and the wrench W_p, whose power is W_p . v. So a
platform is defined by these wrenches and by E(x):

    a frame on base axes    translations of its origin [m]: unit forces, v = dx; turns: the couples of a
                            chart (`attitude`) [rad]
    joints of the tree      their positions [rad, m]: the couple about the joint's axis or the force
                            along it, which only that joint feels; v = dx

With translations and none or three turns, v is (linear, angular) of the frame at its origin on base axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from framework.kinematics.attitude import Attitude, TwistAngle, attitude_about, twist_angle_for
from framework.kinematics.frames import FrameMotions, FrameStack
from framework.laws.path import Path
from framework.model.description import AXES, Platform
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import cross, matmul, matvec
from framework.numerics.rotations import whole_turns, wrap_angles

STEP: Any = 2.0**-120 * 1j  # of complex-step derivatives: its square is far below rounding
CoordinateRates = tuple[Array, Array, Array]  # x and two time derivatives, or displacements and rates


@dataclass(frozen=True, eq=False)
class _Coordinates(ReadOnlyArrays):
    """The part of a platform's n coordinates x that does not depend on their kind."""

    translations: BoolArray  # (n,) [m]; the others are turns [rad]
    sliding: IntArray  # indices in x of translations of the frame's origin along base axes
    along: IntArray  # those axes, 0..2

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.translations)

    @property
    def is_point(self) -> bool:
        """Whether all coordinates are translations of the frame's origin."""
        return len(self.sliding) == self.n

    def twist(self, x: Array, dx: Array, ddx: Array | None = None) -> tuple[Array, Array]:
        """Compute v and dv/dt, each (T, n), for coordinates x and their rates, each (T, n)."""
        return dx, np.zeros_like(dx) if ddx is None else ddx

    def unit_twists(self, motion: CoordinateRates) -> Array:
        """Compute v of unit rates of each coordinate, its rate and acceleration (3, T, n, n), a row each.

        They are the columns of E and their time derivatives along a motion x, dx and ddx (T, n).
        """
        twists = np.zeros((3, *motion[0].shape, self.n))
        twists[0] = np.eye(self.n)
        return twists

    def rate_matrix(self, x: Array) -> Array:
        """Compute the matrix E (T, n, n) of v = E(x) dx at x (T, n)."""
        return self.unit_twists((x, np.zeros_like(x), np.zeros_like(x)))[0].swapaxes(1, 2)

    def path_twist(self, path: Path, s: float) -> Array:
        """Compute v (n,) of the platform for ds/dt = 1 at path coordinate s."""
        parameter = np.array([s])
        return self.twist(path(parameter), path(parameter, 1))[0][0]


@dataclass(frozen=True, eq=False)
class FramePlatform(_Coordinates):
    """Translations of the origin of the mechanism's first frame along base axes, and its attitude."""

    axes: IntArray  # (n,) 0..5 into the twist (linear, angular)
    units: Array  # (n, 6) unit forces and couples along them
    turning: IntArray  # indices in x of the turns
    attitude: Attitude  # of no coordinates where it does not turn

    @staticmethod
    def from_axes(names: Names) -> FramePlatform:
        """Return the coordinates on axes out of x, y, z, rx, ry, rz."""
        axes = np.array([AXES.index(name) for name in names])
        translations = axes < 3
        sliding, turning = np.flatnonzero(translations), np.flatnonzero(~translations)
        return FramePlatform(
            translations=translations,
            sliding=sliding,
            along=axes[sliding],
            axes=axes,
            units=np.eye(6)[axes],
            turning=turning,
            attitude=attitude_about(axes[turning] - 3),
        )

    def choose_chart(self, rotations: Array) -> FramePlatform:
        """Return the same coordinates with the chart that attitudes R (T, 3, 3) of the frame need."""
        if not isinstance(self.attitude, TwistAngle):
            return self
        return replace(self, attitude=twist_angle_for(self.attitude, rotations))

    @property
    def constant(self) -> bool:
        """Whether the wrenches are the same at every pose."""
        return self.attitude.constant

    def coordinates(self, frames: FrameStack) -> Array:
        """Compute x (T, n) [m, rad]: positions of the frame's origin, angles of its attitude."""
        x = np.empty((len(frames.position), self.n))
        x[:, self.sliding] = frames.position[:, 0, self.along]
        x[:, self.turning] = self.attitude.coordinates(frames.rotation[:, 0])
        return x

    def residual(self, frames: FrameStack, x: Array) -> Array:
        """Compute the offset (T, n) of the frame from x [m, rad].

        Turns count the short way. Its rate is v.
        """
        if self.is_point:
            return frames.position[:, 0, self.along] - x
        offset = np.empty((len(x), self.n))
        offset[:, self.sliding] = frames.position[:, 0, self.along] - x[:, self.sliding]
        offset[:, self.turning] = self.attitude.residual(frames.rotation[:, 0], x[:, self.turning])
        return offset

    def unwrap(self, x: Array, near: Array) -> Array:
        """Compute coordinates x (T, n) with turns counted on from `near`, (n,) or (T, n)."""
        x = x.copy()
        x[:, self.turning] = self.attitude.unwrap(x[:, self.turning], near[..., self.turning])
        return x

    def wrenches(self, frames: FrameStack) -> Array:
        """Compute the wrenches (T, n, 6), or (n, 6) if constant, at the frame's origin, whose power is v.

        They are unit forces and the couples of the attitude.
        """
        if self.constant:
            return self.units
        couples = self.attitude.couples(frames.rotation[:, 0])
        wrenches = np.repeat(self.units[None].astype(couples.dtype), len(couples), axis=0)
        wrenches[:, self.turning, 3:] = couples
        return wrenches

    def joint_incidence(self, carried: Array) -> Array:
        """Return 1 where a joint moves a coordinate, else 0, (n, nv).

        `carried` (nv,) is 1 where the joint carries the frame: it then moves all coordinates.
        """
        return np.repeat(carried[None], self.n, axis=0)

    def jacobian(self, frames: FrameStack) -> Array:
        """Compute the derivative (T, n, nv) of v along joint rates: powers of the wrenches on twists."""
        twists = frames.frame_jacobian(0)  # (T, 6, nv)
        return twists[:, self.axes] if self.constant else matmul(self.wrenches(frames), twists)

    def wrench_rates(self, motions: FrameMotions, screws: Array) -> Array:
        """Compute the rates of couples p x f of unit forces f, and of the attitude's couples."""
        rates = np.zeros((2, len(motions.twist), self.n, 6))
        rates[..., 3:] = cross(motions.rates[1:, :, :1, 3], self.units[:, :3])
        if not self.constant:
            axes, w = motions.rates[:2, :, 0, :3], motions.twist[:, 0, 3:]
            rotation = (axes[0] + STEP * axes[1]).swapaxes(1, 2)
            couples = self.attitude.couple_rates(rotation, w + STEP * motions.twist_rate[:, 0, 3:])
            rates[:, :, self.turning, 3:] = couples.real, couples.imag / STEP.imag
        return rates

    def drift(self, motions: FrameMotions) -> Array:
        """Compute dv/dt (T, n): of turns C dw/dt + dC/dt w, with the chart's couples C."""
        rate = np.empty((len(motions.twist), self.n))
        rate[:, self.sliding] = motions.rates[2][:, 0, 3, self.along]
        if len(self.turning):
            rotation = motions.rates[0, :, 0, :3].swapaxes(1, 2)
            w, dw = motions.twist[:, 0, 3:], motions.twist_rate[:, 0, 3:]
            turns = matvec(self.attitude.couples(rotation), dw)
            rate[:, self.turning] = turns + matvec(self.attitude.couple_rates(rotation, w), w)
        return rate

    def frame_twist(self, frames: FrameStack, v: Array) -> Array:
        """Compute the twist (T, 6) of the frame with velocities v (T, n).

        It is zero along free axes and turns.
        """
        twist = np.zeros((len(v), 6))
        twist[:, self.along] = v[:, self.sliding]
        twist[:, 3:] = self.attitude.angular_velocity(frames.rotation[:, 0], v[:, self.turning])
        return twist

    def twist(self, x: Array, dx: Array, ddx: Array | None = None) -> tuple[Array, Array]:
        """Compute v = E(x) dx and dv/dt, each (T, n).

        Only a rotation vector has E other than 1.
        """
        ddx = np.zeros_like(dx) if ddx is None else ddx
        if self.attitude.rates_are_velocities:
            return dx, ddx
        turns = self.turning
        v, dv = dx.copy(), ddx.copy()
        rates = dx[:, turns]
        v[:, turns], dv[:, turns] = self.attitude.rates(x[:, turns], rates, rates, ddx[:, turns])
        return v, dv

    def unit_twists(self, motion: CoordinateRates) -> Array:
        """Compute E' and its time derivatives (3, T, n, n); only a rotation vector has E other than 1."""
        twists = super().unit_twists(motion)
        if self.attitude.rates_are_velocities:
            return twists
        turns = self.turning
        x, dx, ddx = (np.repeat(part[:, turns], len(turns), axis=0) for part in motion)
        units = np.tile(np.eye(len(turns)), (len(motion[0]), 1))
        v, dv = self.attitude.rates(x + STEP * dx, dx + STEP * ddx, units, np.zeros_like(units))
        columns = np.stack([v.real, dv.real, dv.imag / STEP.imag]).reshape(3, -1, len(turns), len(turns))
        twists[..., turns[:, None], turns] = columns
        return twists


@dataclass(frozen=True, eq=False)
class JointPlatform(_Coordinates):
    """Positions of joints of the tree, with the methods of `FramePlatform`."""

    columns: IntArray  # (n,) entries of pinocchio's velocity vector
    places: IntArray  # (n,) entries of q

    @staticmethod
    def from_joints(names: Names, model: pin.Model) -> JointPlatform:
        """Return the coordinates on joints of one degree of freedom."""
        joints = [model.joints[model.getJointId(name)] for name in names]
        slides = np.array([joint.shortname().startswith("JointModelP") for joint in joints])
        nothing = np.empty(0, dtype=np.intp)
        columns = np.array([joint.idx_v for joint in joints])
        q_indices = np.array([joint.idx_q for joint in joints])
        return JointPlatform(slides, nothing, nothing, columns, q_indices)

    def choose_chart(self, rotations: Array) -> JointPlatform:
        """Return the coordinates themselves: joints need no chart of attitudes."""
        return self

    def coordinates(self, frames: FrameStack) -> Array:
        """Return the positions x (T, n) of the joints [rad, m]."""
        return frames.q[:, self.places]

    def residual(self, frames: FrameStack, x: Array) -> Array:
        """Compute the offset (T, n) of the joints from x [rad, m], hinges the short way round."""
        offset = frames.q[:, self.places] - x
        return np.where(self.translations, offset, wrap_angles(offset))

    def unwrap(self, x: Array, near: Array) -> Array:
        """Compute positions (T, n) with hinges counted on from `near`; slides stay."""
        return np.where(self.translations, x, x + whole_turns(near - x))

    def wrenches(self, frames: FrameStack) -> Array:
        """Compute couples about hinges and forces along slides, (T, n, 6)."""
        wrenches = frames.screws[:, self.columns].copy()
        wrenches[:, ~self.translations, :3] = 0.0
        return wrenches

    def wrench_rates(self, motions: FrameMotions, screws: Array) -> Array:
        """Return the rates of axes, as couples of hinges and forces of slides (which feel no couple)."""
        rates = screws[:, :, self.columns].copy()
        rates[:, :, ~self.translations, :3] = 0.0
        return rates

    def joint_incidence(self, carried: Array) -> Array:
        """Return 1 where a coordinate is the joint's own position, (n, nv)."""
        return np.eye(len(carried))[self.columns]

    def jacobian(self, frames: FrameStack) -> Array:
        """Return dv/dq' (T, n, nv): the rows of the identity that belong to the joints."""
        unit_rows = np.eye(frames.screws.shape[1])[self.columns]
        return np.repeat(unit_rows[None], len(frames.q), axis=0)

    def frame_twist(self, frames: FrameStack, v: Array) -> Array:
        """Compute the twist (T, 6) at the frame's origin: joint screws times v (T, n)."""
        screws = frames.screws[:, self.columns]
        twist = matvec(np.swapaxes(screws, 1, 2), v)  # at the base's origin
        twist[:, :3] += np.cross(twist[:, 3:], frames.position[:, 0])
        return twist

    def drift(self, motions: FrameMotions) -> Array:
        """Return zeros (T, n): dJ/dt is zero, since the joints' rates are v itself."""
        return np.zeros((len(motions.twist), self.n))


PlatformCoordinates = FramePlatform | JointPlatform


def platform_coordinates(platform: Platform, model: pin.Model) -> PlatformCoordinates:
    """Return the coordinates that a robot file asks for."""
    if platform.joints:
        return JointPlatform.from_joints(platform.joints, model)
    return FramePlatform.from_axes(platform.axes)


def frame_wrench(platform: PlatformCoordinates, frames: FrameStack, W: Array) -> Array:
    """Compute the wrench (T, 6) at the frame's origin of components W (T, n).

    Its power is W . v.
    """
    wrenches = np.broadcast_to(platform.wrenches(frames), (len(W), platform.n, 6))
    return matvec(wrenches.swapaxes(1, 2), W)
