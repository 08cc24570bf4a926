"""Wrenches of the world on bodies of a robot, constant or along its path, and the joint forces they make.

A wrench (force, moment) acts ON the body of a frame, at the frame's origin, on axes of the base, or on those
of the frame, with which it then turns. It is one part of the forces of the open tree (`dynamics.forces`),

    r = RNEA(q, v, a) - sum over wrenches of J(q)' w(s),        J (6, nv) the Jacobian of the frame,

so that all that stands on r has it: condition (8), torques, deflections and their geometric stiffness, laws.
A wrench does not depend on velocity; one that does (a cutting force, drag) is not among these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.errors import InvalidInput, choose_from, finite_numbers, short
from framework.kinematics.frames import FrameStack, rotations
from framework.kinematics.mechanism import Mechanism, frame_of
from framework.kinematics.pinocchio_memory import carriers, scratch_of
from framework.linalg.ordered_sums import cross, matvec
from framework.motion.path import NO_KNOTS

AXES_OF_WRENCHES = ("base", "tool")
TABLE_DEGREE = 3  # of the spline through a table: the torque of an elastic robot has w" in it


class AppliedWrench(NamedTuple):
    """A wrench of the world on the body that a joint carries, at T configurations."""

    joint: int
    wrench: Array  # (T, 6) about the base's origin, base axes
    generalised: Array  # (T, nv) the joint forces J' w
    origin: Array  # (T, 3) where it acts, which moves with the body
    turns: bool  # with the body, on axes of its frame


@dataclass(frozen=True, eq=False)
class FrameWrench(ReadOnlyArrays):
    """A wrench on the body of one frame.

    `rows` are (force, moment) (6,), or a table (K, 7) of rows with the path coordinate s before it, from 0
    to 1: a cubic spline leads through it, twice continuously differentiable (of less degree through fewer
    than four rows).
    """

    frame: str
    rows: Array
    axes: str = AXES_OF_WRENCHES[0]

    def __call__(self, s: Array) -> Array:
        """Compute the wrench (T, 6) at path coordinates s (T,), on its own axes."""
        if self.rows.ndim == 1:
            return np.broadcast_to(self.rows, (len(s), 6))
        return np.asarray(self._spline(s), dtype=float)

    @property
    def knots(self) -> Array:
        """The path coordinates between 0 and 1 at which the third derivative jumps."""
        if self.rows.ndim == 1:
            return NO_KNOTS
        degree = self._spline.k
        return np.unique(self._spline.t[degree + 1 : -degree - 1])

    @property
    def document(self) -> Any:
        """The wrench as a robot file or plan.json has it: its numbers, with axes where they turn."""
        numbers = self.rows.tolist()
        return numbers if self.axes == AXES_OF_WRENCHES[0] else {"wrench": numbers, "axes": self.axes}

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.rows[:, 0], self.rows[:, 1:], k=min(TABLE_DEGREE, len(self.rows) - 1))

    @staticmethod
    def of(frame: str, given: Any) -> FrameWrench:
        """Return the wrench in 6 numbers, in a table, or in {wrench: either, axes: base or tool}.

        Raises:
            InvalidInput: it is none of these.
        """
        name, axes = f"wrenches: {frame}", AXES_OF_WRENCHES[0]
        if isinstance(given, Mapping):
            for key in given:
                if key not in ("wrench", "axes"):
                    raise InvalidInput(f"{name}: {choose_from('key', key, ('wrench', 'axes'))}")
            axes, given = given.get("axes", axes), given.get("wrench")
            if axes not in AXES_OF_WRENCHES:
                raise InvalidInput(f"{name}: {choose_from('axes', axes, AXES_OF_WRENCHES)}")
        if not _is_table(given):
            return FrameWrench(frame, finite_numbers(name, given, 6), axes)
        rows = finite_numbers(f"{name}: each row of the table (s, force, moment)", given, 7, stacks=True)
        s = rows[:, 0]
        if len(s) < 2 or np.any(np.diff(s) <= 0) or s[0] != 0.0 or s[-1] != 1.0:
            raise InvalidInput(f"{name}: s of the rows must ascend from 0 to 1, got {short(s.tolist())}")
        return FrameWrench(frame, rows, axes)


def _is_table(values: Any) -> bool:
    """Whether these are rows of numbers, right or wrong."""
    if isinstance(values, np.ndarray):
        return values.ndim > 1
    return isinstance(values, list | tuple) and any(np.iterable(row) for row in values)


@dataclass(frozen=True)
class ExternalWrenches:
    """All wrenches of the world on a robot along its path."""

    entries: tuple[FrameWrench, ...] = ()

    @staticmethod
    def of(wrenches: Mapping[str, Any] | None) -> ExternalWrenches:
        """Return the wrenches in {frame: wrench}, see `FrameWrench.of`; none for None.

        Raises:
            InvalidInput: numbers that are no wrench.
        """
        expect_wrenches(wrenches)
        return ExternalWrenches(
            tuple(FrameWrench.of(str(frame), given) for frame, given in (wrenches or {}).items())
        )

    def check_frames(self, mechanism: Mechanism) -> None:
        """Raise InvalidInput unless the robot has all frames."""
        for entry in self.entries:
            check_frame(mechanism, entry.frame)

    @property
    def knots(self) -> Array:
        """The path coordinates between 0 and 1 between which the wrenches are analytic."""
        return np.unique(np.concatenate([NO_KNOTS, *(entry.knots for entry in self.entries)]))

    @property
    def document(self) -> dict[str, Any]:
        """The wrenches by frame, as a robot file or plan.json has them."""
        return {entry.frame: entry.document for entry in self.entries}

    def at(self, mechanism: Mechanism, frames: FrameStack, s: Array) -> tuple[AppliedWrench, ...]:
        """Compute the wrenches at T configurations, whose frames are given, at path coordinates s (T,)."""
        return tuple(
            applied_wrench(mechanism, frames, entry.frame, entry(s), turns=entry.axes != AXES_OF_WRENCHES[0])
            for entry in self.entries
        )


NO_WRENCHES = ExternalWrenches()


def expect_wrenches(wrenches: Any) -> None:
    """Raise InvalidInput unless this is a mapping by frame, or None."""
    if not isinstance(wrenches, Mapping | None):
        raise InvalidInput(f"wrenches: needs a wrench by frame, {{name: (6,)}}, got {short(wrenches)}")


def check_frame(mechanism: Mechanism, frame: object) -> None:
    """Raise InvalidInput unless this is a link or a joint of the robot."""
    model = mechanism.model
    if not model.existFrame(str(frame)) or frame == model.frames[0].name:  # the universe carries nothing
        names = [model_frame.name for model_frame in model.frames[1:]]
        raise InvalidInput(f"wrenches: {choose_from('frame', frame, names)}")


def applied_wrench(
    mechanism: Mechanism, frames: FrameStack, frame: str, wrench: ArrayLike, *, turns: bool = False
) -> AppliedWrench:
    """Compute what a wrench (6,) or (T, 6) at a frame's origin is at T configurations.

    Args:
        frames: of the robot, at these configurations.
        turns: whether it is on axes of its frame, not of the base.
    """
    index = frame_of(mechanism.model, frame)
    position, rotation = _placed(mechanism, frames, index)
    wrench = np.broadcast_to(np.asarray(wrench, dtype=float), (len(position), 6))
    if turns:
        wrench = matvec(rotation[:, None], wrench.reshape(-1, 2, 3)).reshape(-1, 6)
    wrench = moved_wrench(wrench, position)
    joint = int(mechanism.model.frames[index].parentJoint)
    carried = carriers(mechanism.model, np.array([joint]))[0]
    generalised = matvec(frames.screws, wrench) * carried
    return AppliedWrench(joint, read_only(wrench), read_only(generalised), read_only(position), turns)


def moved_wrench(wrench: Array, arm: Array) -> Array:
    """Move wrenches (..., 6) from a point to the place from which an arm (..., 3) leads there."""
    moved = wrench.copy()
    moved[..., 3:] += cross(arm, wrench[..., :3])
    return moved


def _placed(mechanism: Mechanism, frames: FrameStack, index: int) -> tuple[Array, Array]:
    """Compute origins (T, 3) and rotations (T, 3, 3) of one frame of pinocchio's."""
    if index in mechanism.frames:
        k = mechanism.frames.index(index)
        return frames.position[:, k], frames.rotation[:, k]
    model, data = mechanism.model, scratch_of(mechanism).data
    poses = np.empty((len(frames.q), 12))
    for k, q in enumerate(frames.q):
        pin.forwardKinematics(model, data, q)
        placement = pin.updateFramePlacement(model, data, index)
        poses[k, :9], poses[k, 9:] = placement.rotation.ravel(order="F"), placement.translation
    return poses[:, 9:], rotations(poses)
