"""Poses, joint screws and motions of a robot's frames, and steps between configurations, all in stacks.

This module and those of forces call pinocchio in a Python loop over configurations; everything else works on
stacks in numpy. Pinocchio's results are read through views of its memory (`Scratch`): reading them element by
element through its accessors takes longer than computing them.

Twists are (linear, angular) and wrenches (force, moment), on the axes of the base. They refer to the base's
origin (pinocchio's WORLD), except for `FrameStack.frame_jacobian`, which refers to the frame's own origin.

A screw S_j is the twist that a unit rate of joint j gives to the bodies that it carries. A screw S fixed to a
body with the twist V changes at the rate of the Lie bracket [V, S]. Source: J. Carpentier and N. Mansard,
Analytical Derivatives of Rigid Body Dynamics Algorithms, Robotics: Science and Systems 2018.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import as_strided

from framework.kinematics.mechanism import Mechanism
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import cross, matvec


class Scratch(NamedTuple):
    """Pinocchio's working memory for a mechanism, with its results as arrays.

    The first six arrays are views of the memory of `data`, which every call of pinocchio with `data` changes.
    """

    data: pin.Data
    placements: Array  # (frames of the model, 12) the three axes of a frame, then its origin [m]
    screws: Array  # (nv, 6) of the joints: the twist that each unit rate gives to the carried bodies
    velocities: Array  # (bodies of the model, 6) twists
    accelerations: Array  # (bodies of the model, 6) time derivatives of these twists
    joint_placements: Array  # (bodies of the model, 12) of the joints, like `placements`
    forces: Array  # (bodies of the model, 6) wrenches through the joints, on their own axes, by RNEA
    frames: IntArray  # (F,) rows of `placements`: the frames `Mechanism.frames`
    bodies: IntArray  # (F,) rows of `velocities`: the bodies that carry these frames
    carried: Array  # (F, nv) 1 where the joint of the column carries the frame, else 0

    @staticmethod
    def of(model: pin.Model, frames: tuple[int, ...]) -> Scratch:
        """Allocate working memory for a model and some of its frames.

        Raises:
            RuntimeError: `eigenpy.sharedMemory` is off, so pinocchio returns copies of its memory.
        """
        data = model.createData()
        if data.J.flags.owndata:
            raise RuntimeError("pinocchio hands out copies of its memory: call eigenpy.sharedMemory(True)")
        bodies = np.array([model.frames[frame].parentJoint for frame in frames], dtype=np.intp)
        return Scratch(
            data=data,
            placements=_view_vector(data.oMf, "rotation", 12),
            screws=data.J.reshape(6, -1).T,
            velocities=_view_vector(data.ov, "linear", 6),
            accelerations=_view_vector(data.oa, "linear", 6),
            joint_placements=_view_vector(data.oMi, "rotation", 12),
            forces=_view_vector(data.f, "linear", 6),
            frames=np.array(frames, dtype=np.intp),
            bodies=bodies,
            carried=carrying_joints(model)[bodies],
        )


def scratch_of(mechanism: Mechanism) -> Scratch:
    """Return the working memory of this thread, which every call of pinocchio overwrites.

    Allocating a `pin.Data` takes longer than a hundred calls with it (7.7 ms for 81 joints). The memory
    belongs to the model, so a mechanism and the robot made of it share the same memory. A model to which a
    caller has added frames or joints gets new memory: pinocchio writes beyond the old one.
    """
    model = mechanism.model
    sizes = model.nframes, model.njoints
    return _thread_scratch(model, mechanism.frames, sizes, threading.get_ident())


@lru_cache(maxsize=16)  # of several megabytes each
def _thread_scratch(
    model: pin.Model, frames: tuple[int, ...], sizes: tuple[int, int], thread: int
) -> Scratch:
    """Allocate working memory, one for each `thread`, and anew if the `sizes` of the model change."""
    return Scratch.of(model, frames)


def _view_vector(vector: Any, first_part: str, width: int) -> Array:
    """View a C++ vector of pinocchio as an array (elements, width) of doubles.

    A C++ vector stores its elements, two at least in every model, in one block of memory at a constant
    stride. Of each element the view shows `width` doubles, from the attribute `first_part` on: pinocchio
    stores the parts of a pose, a twist or a wrench one directly after the other. The vector must outlive the
    view.
    """
    first, second = (getattr(vector[k], first_part) for k in range(2))
    stride = second.ctypes.data - first.ctypes.data  # [bytes] between two elements
    return as_strided(first, (len(vector), width), (stride, first.itemsize))


def carrying_joints(model: pin.Model) -> Array:
    """Return 1 where the joint of a column carries a body, else 0, (bodies, nv)."""
    carried = np.zeros((model.njoints, model.nv))
    for j in range(1, model.njoints):  # body 0 is the base; parents precede their children
        joint = model.joints[j]
        carried[j] = carried[model.parents[j]]
        carried[j, joint.idx_v : joint.idx_v + joint.nv] = 1.0
    return carried


class TreeColumns(NamedTuple):
    """Which columns of pinocchio's velocity vector move which bodies of the tree."""

    owner: IntArray  # (nv,) joint of each column; also the index of the body next to this joint
    carried: Array  # (bodies, nv) 1 where the joint of the column carries the body, else 0
    precedes: BoolArray  # (nv, nv) whether column i moves the body of column j, and so the screw of j


@lru_cache(maxsize=64)
def tree_columns(mechanism: Mechanism) -> TreeColumns:
    """Return which bodies and screws each column moves."""
    model = mechanism.model
    owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
    carried = carrying_joints(model)
    return TreeColumns(owner, carried, precedes=carried[owner].T > 0.0)


class FrameStack(NamedTuple):
    """Frames (F, `Mechanism.frames`) of the robot and screws of its joints at T configurations."""

    placements: Array  # (T, F, 4, 3) the three axes of each frame, then its origin [m]
    screws: Array  # (T, nv, 6) twists, at the base's origin, that unit rates give to the carried bodies
    carried: Array  # (F, nv) 1 where the joint carries the frame, else 0
    q: Array  # (T, nq)

    @staticmethod
    def of(scratch: Scratch, placements: Array, screws: Array, q: Array) -> FrameStack:
        """Return the frames of a stack of `placements` (T, frames of the model, 12) and `screws`."""
        robot_frames = placements.take(scratch.frames, axis=1)  # (T, F, 12)
        axes_and_origins = robot_frames.reshape(*robot_frames.shape[:2], 4, 3)
        return FrameStack(axes_and_origins, screws, scratch.carried, q)

    @property
    def position(self) -> Array:
        """Origins of the frames, (T, F, 3) [m]."""
        return self.placements[:, :, 3]

    @property
    def rotation(self) -> Array:
        """Rotation matrices of the frames, (T, F, 3, 3), columns are the axes."""
        return self.placements[:, :, :3].swapaxes(2, 3)

    @property
    def platform_origin(self) -> Array:
        """Origin of the platform's frame, which is the first, (T, 3) [m]."""
        return self.placements[:, 0, 3]

    @property
    def platform_rotation(self) -> Array:
        """Rotation matrix of the platform's frame, (T, 3, 3), columns are the axes."""
        return self.rotation[:, 0]

    def select(self, which: slice | IntArray) -> FrameStack:
        """Return the frames at the configurations `which`."""
        return FrameStack(self.placements[which], self.screws[which], self.carried, self.q[which])

    def frame_jacobian(self, frame: int = 0) -> Array:
        """Compute the Jacobian (T, 6, nv) of a frame's twist at its origin, on base axes.

        `frame` is an index into `Mechanism.frames`: 0 is the platform's frame.
        """
        twists = self.screws.copy()  # (T, nv, 6) of the joints, still at the base's origin
        twists[..., :3] += cross(self.screws[..., 3:], self.position[:, frame, None])
        carries_frame = self.carried[frame]  # (nv,) 1 or 0
        return (twists * carries_frame[:, None]).swapaxes(1, 2)


class FrameMotions(NamedTuple):
    """Twists of F frames at T instants, with velocities and accelerations of axes and origins.

    In a twist (v, w), v is the velocity of the point of the body that coincides with the base's origin.
    """

    twist: Array  # (T, F, 6)
    twist_rate: Array  # (T, F, 6) time derivative
    rates: Array  # (3, T, F, 4, 3) axes and origins, then their velocities, then their accelerations


def frames_at(mechanism: Mechanism, q: Array, models: Iterable[pin.Model] | None = None) -> FrameStack:
    """Compute poses of all frames and screws of all joints at q (T, nq).

    Each row may have a model of its own, of the same structure, one of `models`.
    """
    models = repeat(mechanism.model) if models is None else models
    scratch = scratch_of(mechanism)
    placements = np.empty((len(q), *scratch.placements.shape))  # (T, frames of the model, 12)
    screws = np.empty((len(q), *scratch.screws.shape))
    for k, (model, position) in enumerate(zip(models, q, strict=False)):
        pin.computeJointJacobians(model, scratch.data, position)
        pin.updateFramePlacements(model, scratch.data)
        placements[k], screws[k] = scratch.placements, scratch.screws
    return FrameStack.of(scratch, placements, screws, q)


def rotation_matrices(placements: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of placements (..., 12): three axes, then the origin."""
    axes = placements[..., :9].reshape(*placements.shape[:-1], 3, 3)  # one axis a row
    return axes.swapaxes(-1, -2)


def frame_velocities(twist: Array, placements: Array) -> Array:
    """Compute the velocities (..., F, 4, 3) of the axes and the origins of F frames.

    Args:
        twist: (..., F, 6) twists (linear, angular) of the frames' bodies at the base's origin.
        placements: (..., F, 4, 3) the three axes of each frame, then its origin.
    """
    velocities = cross(twist[..., None, 3:], placements)  # w x c
    velocities[..., 3, :] += twist[..., :3]  # axes are directions, without linear velocity
    return velocities


def move_wrench(wrench: Array, arm: Array) -> Array:
    """Refer each `wrench` (f, m) (..., 6) to another point.

    The arms (..., 3) [m] lead from the new points to the old ones. The moment m becomes m + arm x f; the
    force f does not change.
    """
    result = wrench.copy()
    result[..., 3:] += cross(arm, wrench[..., :3])
    return result


def frame_motions(mechanism: Mechanism, frames: FrameStack, v: Array) -> FrameMotions:
    """Compute the motions of `frames` at joint rates v (T, nv) without joint accelerations."""
    return move_with_bodies(mechanism, frames, body_twists(mechanism, frames.q, v, np.zeros(v.shape)))


def move_with_bodies(mechanism: Mechanism, frames: FrameStack, twists: Array) -> FrameMotions:
    """Compute the motions of `frames` on bodies with twists (2, T, bodies, 6) of `body_twists`.

    With the twist (v, w) of a frame, its axes c move at c' = w x c, and its origin c at c' = v + w x c. So
    c" = dw/dt x c + w x c', plus dv/dt for origins.
    """
    twist, twist_rate = twists.take(scratch_of(mechanism).bodies, axis=2)  # (T, F, 6) each
    velocity = frame_velocities(twist, frames.placements)
    acceleration = frame_velocities(twist_rate, frames.placements) + cross(twist[..., None, 3:], velocity)
    return FrameMotions(twist, twist_rate, np.array([frames.placements, velocity, acceleration]))


def body_twists(mechanism: Mechanism, q: Array, v: Array, a: Array) -> Array:
    """Compute twists and twist rates (2, T, bodies, 6) of bodies at q (T, nq) and v, a (T, nv)."""
    scratch = scratch_of(mechanism)
    twists = np.empty((2, len(q), *scratch.velocities.shape))
    # of pinocchio's functions this one leaves the twists of bodies at the base's origin in its memory
    for k, state in enumerate(zip(q, v, a, strict=True)):
        pin.computeForwardKinematicsDerivatives(mechanism.model, scratch.data, *state)
        twists[0, k], twists[1, k] = scratch.velocities, scratch.accelerations
    return twists


def bracket(a: Array, b: Array) -> Array:
    """Compute the bracket [a, b] (..., 6): the rate of a screw b fixed to a body with twist a.

    With a = (v, w) and b = (c, u), all (..., 3), it is (w x c + v x u, w x u).
    """
    parts = b.reshape(*b.shape[:-1], 2, 3)  # c and u
    rates = cross(a[..., None, 3:], parts)  # w x c and w x u, with one w for both
    rates[..., 0, :] += cross(a[..., :3], parts[..., 1, :])  # v x u
    return rates.reshape(*rates.shape[:-2], 6)


def bracket_wrenches(screws: Array, wrenches: Array) -> Array:
    """Compute the wrenches (T, nv, 6) whose power on any twist V is [V, S] . W.

    For screws S = (v, w) and wrenches W = (f, m), both (T, nv, 6), they are (w x f, v x f + w x m).
    """
    linear, angular = screws[..., :3], screws[..., 3:]
    force, moment = wrenches[..., :3], wrenches[..., 3:]
    return np.concatenate([cross(angular, force), cross(linear, force) + cross(angular, moment)], axis=-1)


def integrate(mechanism: Mechanism, q: Array, step: Array) -> Array:
    """Move configurations q (..., nq) by tangent vectors `step` (..., nv) [rad, m], as pinocchio does.

    At a ball joint, whose position is a quaternion, the step is a rotation vector; elsewhere it is added.
    """
    if not mechanism.has_balls:
        return q + step
    starts = np.broadcast_to(q, (*step.shape[:-1], mechanism.model.nq))
    return _apply_to_pairs(pin.integrate, mechanism, starts, step).reshape(starts.shape)


def _apply_to_pairs(
    function: Callable[..., Array], mechanism: Mechanism, first: Array, second: Array
) -> Array:
    """Apply a function of pinocchio to pairs of rows of `first` (..., k) and `second` (..., l).

    Returns:
        The results of all pairs one after the other, (pairs, ...).
    """
    # pinocchio takes contiguous vectors only
    firsts, seconds = (np.ascontiguousarray(stack).reshape(-1, stack.shape[-1]) for stack in (first, second))
    return np.array([function(mechanism.model, *pair) for pair in zip(firsts, seconds, strict=True)])


def full_motion(mechanism: Mechanism, columns: IntArray, motion: Array) -> Array:
    """Return tangent vectors (..., nv) with `motion` (..., k) in `columns` (k,), zero elsewhere."""
    full = np.zeros((*motion.shape[:-1], mechanism.nv))
    full[..., columns] = motion
    return full


def integrate_columns(mechanism: Mechanism, q: Array, columns: IntArray, step: Array) -> Array:
    """Move configurations q (..., nq) by `step` (..., k) in `columns` (k,); the other joints rest."""
    return integrate(mechanism, q, full_motion(mechanism, columns, step))


def largest_motion(mechanism: Mechanism, motion: Array) -> Array:
    """Return the largest |entry| (T,) [rad, robot lengths] of tangent vectors `motion` (T, nv) [rad, m]."""
    return np.abs(motion / mechanism.column_scale).max(axis=1, initial=0.0)


def difference(mechanism: Mechanism, start: Array, q: Array) -> Array:
    """Compute tangent vectors (..., nv) [rad, m] from start (..., nq) to q (..., nq).

    It is the inverse of `integrate`. The three entries of a ball joint are a rotation vector.
    """
    if not mechanism.has_balls:
        return q - start
    shape = np.broadcast_shapes(start.shape, q.shape)  # (..., nq)
    starts, ends = np.broadcast_to(start, shape), np.broadcast_to(q, shape)
    differences = _apply_to_pairs(pin.difference, mechanism, starts, ends)
    return differences.reshape(*shape[:-1], mechanism.nv)


def difference_jacobian(mechanism: Mechanism, start: Array, q: Array) -> Array:
    """Compute the derivative (T, nv, nv) of `difference` from start (nq,) to q (T, nq) along q."""
    by_end = pin.ArgumentPosition.ARG1  # by q, the second argument of pinocchio's `difference`
    rows = map(np.ascontiguousarray, q)
    return np.array([pin.dDifference(mechanism.model, start, row, by_end) for row in rows])


def forces_on_joints(mechanism: Mechanism, start: Array, q: Array, force: Array) -> Array:
    """Convert forces conjugate to rates of a `difference` to generalised forces (T, nv).

    Let d (T, nv) be the difference from `start` (nq,) to q (T, nq), and D its derivative along q, so that
    dd/dt = D v at joint rates v. The `force` (T, nv) has the power force . dd/dt = (D' force) . v. D is the
    identity except on balls, whose angular velocity is not the rate of the rotation vector.
    """
    if not (mechanism.has_balls and force.any()):
        return force
    return matvec(difference_jacobian(mechanism, start, q).swapaxes(1, 2), force)


def forces_on_joints_slope(mechanism: Mechanism, start: Array, q: Array, stiffness: Array) -> Array:
    """Compute the derivative (T, nv, nv) of the `forces_on_joints` of springs with `stiffness` (nv,).

    The springs are at rest at `start` (nq,) and deflected to q (T, nq). The matrix D' of `forces_on_joints`
    does not appear: a ball has equal stiffness about all axes, so its torque is along its rotation vector,
    which D' does not change.
    """
    if not mechanism.has_balls:
        return np.broadcast_to(np.diag(stiffness), (len(q), mechanism.nv, mechanism.nv))
    return stiffness[:, None] * difference_jacobian(mechanism, start, q)


def difference_rates(mechanism: Mechanism, start: Array, q: Array, v: Array) -> Array:
    """Compute the rates (T, nv) of `difference` from start (nq,) to q (T, nq) at joint rates v (T, nv)."""
    if not mechanism.has_balls:
        return v
    return matvec(difference_jacobian(mechanism, start, q), v)
