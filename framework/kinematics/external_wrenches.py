"""External wrenches on bodies of a robot, constant or along its path, and their joint forces.

A wrench (force, moment) acts ON the body of a frame, at the frame's origin. Its components are on base axes,
or on the frame's axes; in the second case it turns with the frame. It is part of the forces of the open tree
(`dynamics.forces`),

    r = RNEA(q, v, a) - sum over wrenches of J(q)' w(s),        J (6, nv) the Jacobian of the frame,

so it affects everything that depends on r: condition (8), torques, deflections, geometric stiffness, laws.
Wrenches that depend on velocity (a cutting force, drag) are not supported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, choose_from, finite_numbers, short
from framework.kinematics.frames import (
    FrameStack,
    bracket_wrenches,
    move_wrench,
    rotation_matrices,
    scratch_of,
    tree_columns,
)
from framework.kinematics.mechanism import Mechanism, frame_index
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform
from framework.laws.path import NO_KNOTS
from framework.model.description import FrameWrench
from framework.numerics.arrays import Array, ArrayLike, read_only
from framework.numerics.ordered_sums import cross, matvec


class AppliedWrench(NamedTuple):
    """An external wrench on the body of a frame at T configurations."""

    frame: str
    joint: int  # index of the joint that moves the body
    wrench: Array  # (T, 6) about the base's origin, base axes
    generalised: Array  # (T, nv) the joint forces J' w
    origin: Array  # (T, 3) origin of the frame, where the wrench acts
    turns: bool  # whether the wrench turns with the frame

    @property
    def at_origin(self) -> Array:
        """The wrench (T, 6) at the frame's origin, base axes."""
        return move_wrench(self.wrench, -self.origin)


@dataclass(frozen=True)
class ExternalWrenches:
    """All external wrenches on a robot along its path."""

    entries: tuple[FrameWrench, ...] = ()

    @staticmethod
    def of(wrenches: Mapping[str, Any] | None) -> ExternalWrenches:
        """Return the wrenches of a mapping {frame: wrench}; none for None.

        A wrench is (force, moment) (6,), a table (K, 7) of rows (s, force, moment), or one of these with its
        axes: {wrench: ..., axes: base or tool}.

        Raises:
            InvalidInput: a value is not a wrench.
        """
        expect_wrenches(wrenches)
        if not wrenches:
            return NO_WRENCHES
        named = wrenches.items()
        return ExternalWrenches(tuple(FrameWrench.of(str(frame), wrench) for frame, wrench in named))

    def check_frames(self, mechanism: Mechanism) -> None:
        """Raise InvalidInput unless the robot has the frames of all wrenches."""
        for entry in self.entries:
            check_frame(mechanism, entry.frame)

    def times(self, factor: float) -> ExternalWrenches:
        """Return the wrenches multiplied by a `factor`."""
        return ExternalWrenches(tuple(entry.times(factor) for entry in self.entries))

    @property
    def is_nonzero(self) -> bool:
        """Whether any wrench is not zero."""
        # force and moment are the last six columns; in a table of wrenches s stands before them
        return any(np.any(entry.rows[..., -6:]) for entry in self.entries)

    @property
    def knots(self) -> Array:
        """Path coordinates (k,) in (0, 1) between which the wrenches are analytic."""
        return np.unique(np.concatenate([NO_KNOTS, *(entry.knots for entry in self.entries)]))

    @property
    def document(self) -> dict[str, Any]:
        """The wrenches by frame, in the form of a robot file or plan.json."""
        return {entry.frame: entry.document for entry in self.entries}

    def evaluate(self, mechanism: Mechanism, frames: FrameStack, s: Array) -> tuple[AppliedWrench, ...]:
        """Compute the wrenches and their joint forces at T configurations.

        Args:
            frames: frames of the robot at these configurations.
            s: path coordinates (T,).
        """
        wrenches = self.evaluate_on_base_axes(mechanism, frames, s)
        return tuple(
            applied_wrench(mechanism, frames, entry.frame, wrenches[entry.frame], turns=entry.turns)
            for entry in self.entries
        )

    def evaluate_on_base_axes(self, mechanism: Mechanism, frames: FrameStack, s: Array) -> dict[str, Array]:
        """Compute the wrenches (T, 6) by frame at s (T,), about the frames' origins on base axes."""
        wrenches = {}
        for entry in self.entries:
            wrench = entry(s)
            if entry.turns:
                _, rotation = _frame_placement(mechanism, frames, frame_index(mechanism.model, entry.frame))
                parts = wrench.reshape(-1, 2, 3)  # force and moment, on axes of the frame
                wrench = matvec(rotation[:, None], parts).reshape(-1, 6)
            wrenches[entry.frame] = wrench
        return wrenches


NO_WRENCHES = ExternalWrenches()


def wrench_on_platform(robot: ParallelRobot, W: ArrayLike) -> tuple[str, tuple[float, ...]]:
    """Return the platform's frame and its wrench (6,) for components W (n,) on the platform's axes.

    Raises:
        InvalidInput: W is not n finite numbers; or it has components on joints, or on axes that turn with the
            platform.
    """
    components = finite_numbers(f"wrench ({', '.join(robot.axis_names)})", W, robot.n)
    platform = robot.platform
    if isinstance(platform, FramePlatform):
        is_on_base_axes = platform.constant or not components[platform.turning].any()
        if is_on_base_axes:  # `units` (n, 6) are the unit force or couple of each axis
            return robot.description.platform.frame, tuple((components @ platform.units).tolist())
    raise InvalidInput(
        f"wrench: axes of {robot.name} ({', '.join(robot.axis_names)}) move with it; give the wrench on a "
        f"frame, (force, moment) on base axes"
    )


def expect_wrenches(wrenches: Any) -> None:
    """Raise InvalidInput unless `wrenches` is a mapping by frame, or None."""
    if not isinstance(wrenches, Mapping | None):
        raise InvalidInput(f"wrenches: needs a wrench by frame, {{name: (6,)}}, got {short(wrenches)}")


def check_frame(mechanism: Mechanism, frame: object) -> None:
    """Raise InvalidInput unless `frame` is a link or a joint of the robot."""
    model = mechanism.model
    # frame 0 is pinocchio's universe, which carries nothing; a link may have its name
    if not model.existFrame(str(frame)) or frame_index(model, str(frame)) == 0:
        names = [model_frame.name for model_frame in model.frames[1:]]
        raise InvalidInput(f"wrenches: {choose_from('frame', frame, names)}")


def applied_wrench(
    mechanism: Mechanism, frames: FrameStack, frame: str, wrench: ArrayLike, *, turns: bool = False
) -> AppliedWrench:
    """Compute the joint forces of a wrench, (6,) or (T, 6), at T configurations.

    Args:
        frames: frames of the robot at these configurations.
        wrench: (force, moment) about the origin of `frame`, on base axes.
        turns: whether the wrench turns with its frame.
    """
    index = frame_index(mechanism.model, frame)
    origin, _ = _frame_placement(mechanism, frames, index)
    at_origin = np.broadcast_to(np.asarray(wrench, dtype=float), (len(origin), 6))
    at_base = move_wrench(at_origin, origin)
    joint = mechanism.model.frames[index].parentJoint
    carried = tree_columns(mechanism).carried[joint]  # (nv,)
    return AppliedWrench(
        frame=frame,
        joint=joint,
        wrench=read_only(at_base),
        generalised=read_only(matvec(frames.screws, at_base) * carried),
        origin=read_only(origin),
        turns=turns,
    )


def wrench_slope(mechanism: Mechanism, screws: Array, applied: AppliedWrench) -> Array:
    """Compute the derivative (T, nv, nv) of the joint forces of the wrench `applied`.

    Row j, column i is the derivative of S_j . w along joint i, with S_j the screw of joint j (`screws` (T,
    nv, 6)) and w = (f, m + p x f) the wrench about the base's origin, which acts at the point p. For joints
    i, j that move the frame it is the sum of two terms:

        [S_i, S_j] . w       if joint i precedes j and so changes S_j
        S_j . dw             a wrench on base axes changes only because p moves, by d_i: dw = (0, d_i x f);
                             a wrench on axes of the frame moves as a whole: S_j . dw = -[S_i, S_j] . w
    """
    columns = tree_columns(mechanism)
    moves_frame = columns.carried[applied.joint]  # (nv,) 1 for joints that move the frame, else 0
    screws = screws * moves_frame[:, None]
    by_screw = bracket_wrenches(screws, applied.wrench[:, None]) @ screws.swapaxes(1, 2)  # (T, j, i)
    if applied.turns:
        by_wrench = -by_screw
    else:
        linear, angular = screws[..., :3], screws[..., 3:]
        d = linear + cross(angular, applied.origin[:, None])  # (T, nv, 3) velocity of p for each joint
        by_wrench = angular @ cross(d, applied.wrench[:, None, :3]).swapaxes(1, 2)
    precedes = columns.precedes.T  # (j, i) whether joint i precedes joint j
    return by_screw * precedes + by_wrench


def _frame_placement(mechanism: Mechanism, frames: FrameStack, index: int) -> tuple[Array, Array]:
    """Compute origin (T, 3) and rotation (T, 3, 3) of pinocchio's frame of an `index`.

    `frames` has the configurations, and the placements of some frames.
    """
    if index in mechanism.frames:  # its placement is known
        k = mechanism.frames.index(index)
        return frames.position[:, k], frames.rotation[:, k]
    model, scratch = mechanism.model, scratch_of(mechanism)
    placements = np.empty((len(frames.q), 12))  # the three axes of the frame, then its origin
    for k, q in enumerate(frames.q):
        pin.forwardKinematics(model, scratch.data, q)
        pin.updateFramePlacement(model, scratch.data, index)
        placements[k] = scratch.placements[index]
    return placements[:, 9:], rotation_matrices(placements)
