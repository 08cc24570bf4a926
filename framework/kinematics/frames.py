"""Poses, joint screws and motions of a robot's frames for a stack of configurations.

The only place, with `dynamics.forces`, that loops over configurations in Python: pinocchio is called
there and nothing else; all that follows is stacked numpy. Twists are (linear, angular) on the axes of the
base frame: those of frames at the frame's origin (pinocchio's LOCAL_WORLD_ALIGNED), the screws of the
joints at the origin of the base (pinocchio's WORLD).
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import as_strided

from framework.arrays import Array, IntArray
from framework.kinematics.mechanism import Mechanism
from framework.linalg.ordered_sums import FEW, matvec

_PLUS, _MINUS = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; several times faster than np.cross on stacks."""
    if a.size + b.size < FEW:
        both = a.take(_PLUS, -1) * b.take(_MINUS, -1)
        return both[..., :3] - both[..., 3:]
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2]
    product = np.empty(np.broadcast(a, b).shape)
    np.subtract(a2 * b3, a3 * b2, out=product[..., 0])
    np.subtract(a3 * b1, a1 * b3, out=product[..., 1])
    np.subtract(a1 * b2, a2 * b1, out=product[..., 2])
    return product


class FrameStack(NamedTuple):
    """The robot's frames (F of them, `Mechanism.frames`) at T configurations."""

    position: Array  # (T, F, 3) [m]
    rotation: Array  # (T, F, 3, 3), columns are the frame's axes
    screws: (
        Array  # (T, nv, 6) twist, at the base's origin, of what a joint carries when it moves at unit rate
    )
    carried: Array  # (F, nv) 1 where the joint carries the frame, else 0
    q: Array  # (T, nq) the configurations

    def at(self, k: int | slice | IntArray) -> FrameStack:
        """The frames of one configuration, T = 1, or of some."""
        here = slice(k, k + 1) if isinstance(k, int) else k
        position, rotation, screws, carried, q = self
        return FrameStack(position[here], rotation[here], screws[here], carried, q[here])

    @property
    def jacobian(self) -> Array:
        """Jacobians of all frames at their origins, (T, F, 6, nv)."""
        linear, angular = self.screws[:, None, :, :3], self.screws[:, None, :, 3:]
        at_origin = linear + cross(angular, self.position[:, :, None])
        both = np.concatenate([at_origin, np.broadcast_to(angular, at_origin.shape)], axis=3)
        return np.asarray((both * self.carried[:, :, None]).swapaxes(2, 3))


class FrameMotions(NamedTuple):
    """How the frames move at T instants."""

    rates: Array  # (2, T, F, 6) `twist` and `drift`

    @property
    def twist(self) -> Array:
        """Twists (T, F, 6) of the frames at their origins."""
        return self.rates[0]

    @property
    def drift(self) -> Array:
        """Their classical accelerations (T, F, 6) when all joint accelerations are zero."""
        return self.rates[1]

    @staticmethod
    def at_origins(spatial: Array, position: Array) -> FrameMotions:
        """From twists and spatial accelerations (2, T, F, 6) at the base's origin, which are written over."""
        spatial[..., :3] += cross(spatial[..., 3:], position)
        spatial[1, ..., :3] += cross(spatial[0, ..., 3:], spatial[0, ..., :3])
        return FrameMotions(spatial)


def frames_at(mechanism: Mechanism, q: Array) -> FrameStack:
    """Poses of all frames and screws of all joints at q (T, nq)."""
    model, scratch = mechanism.model, scratch_of(mechanism)
    data, placements, columns = scratch.data, scratch.placements, scratch.columns
    poses = np.empty((len(q), *placements.shape))
    screws = np.empty((len(q), *columns.shape))
    for k in range(len(q)):
        pin.computeJointJacobians(model, data, q[k])
        pin.updateFramePlacements(model, data)
        if scratch.refresh is not None:
            scratch.refresh()
        poses[k] = placements
        screws[k] = columns
    poses = poses.take(scratch.frames, axis=1)
    return FrameStack(poses[:, :, 9:], rotations(poses), screws, scratch.carried, q)


def rotations(placements: Array) -> Array:
    """Rotation matrices (..., 3, 3) of placements (..., 12) as `Scratch` has them."""
    return placements[..., :9].reshape(*placements.shape[:-1], 3, 3).swapaxes(-1, -2)


def frame_motions(mechanism: Mechanism, at: FrameStack, q: Array, v: Array) -> FrameMotions:
    """Twists and drift accelerations of the frames `at` q (T, nq) with joint rates v (T, nv)."""
    model, scratch = mechanism.model, scratch_of(mechanism)
    data, velocities, accelerations = scratch.data, scratch.velocities, scratch.accelerations
    rest = np.zeros(model.nv)
    moving = np.empty((2, len(q), *velocities.shape))
    twist, drift = moving
    for k in range(len(q)):
        pin.computeForwardKinematicsDerivatives(model, data, q[k], v[k], rest)
        if scratch.refresh is not None:
            scratch.refresh()
        twist[k] = velocities
        drift[k] = accelerations
    return FrameMotions.at_origins(moving.take(scratch.bodies, axis=2), at.position)


class Scratch(NamedTuple):
    """Pinocchio's working memory for a mechanism, and what is read from it, seen as arrays.

    The arrays show the memory of `data` itself: they change with every call of pinocchio on it. Where its
    layout is not the expected one they are copies, which `refresh` brings up to date after a call.
    """

    data: pin.Data
    placements: Array  # (frames of the model, 12): the three axes of a frame, then its origin
    columns: Array  # (nv, 6) the joints' screws
    velocities: Array  # (bodies of the model, 6) twists at the base's origin
    accelerations: Array  # (bodies of the model, 6) their time derivatives
    joints: Array  # (bodies of the model, 12) placements of the joints, as `placements`
    forces: Array  # (bodies of the model, 6) (force, moment) through the joints on their own axes, by RNEA
    frames: IntArray  # (F,) rows of `placements`
    bodies: IntArray  # (F,) rows of `velocities` that carry the frames
    carried: Array  # (F, nv)
    refresh: Callable[[], None] | None  # None: the arrays are pinocchio's own memory

    @staticmethod
    def of(model: pin.Model, frames: tuple[int, ...]) -> Scratch:
        """New working memory for a model and some of its frames."""
        data = model.createData()
        moved = np.linspace(0.5, 1.0, model.nv)  # a motion in which most numbers differ from one another
        q = pin.integrate(model, pin.neutral(model), moved)
        pin.rnea(model, data, q, moved, moved)
        pin.computeForwardKinematicsDerivatives(model, data, q, moved, moved)
        pin.updateFramePlacements(model, data)
        public, memory = _by_accessors(data), _by_memory(data)
        shown = memory is not None and all(map(np.array_equal, memory, public))
        arrays = memory if shown and memory is not None else public

        def refresh() -> None:
            for array, now in zip(arrays, _by_accessors(data), strict=True):
                array[...] = now

        bodies = np.array([model.frames[frame].parentJoint for frame in frames], dtype=np.intp)
        return Scratch(
            data=data,
            placements=arrays[0],
            columns=arrays[1],
            velocities=arrays[2],
            accelerations=arrays[3],
            joints=arrays[4],
            forces=arrays[5],
            frames=np.array(frames, dtype=np.intp),
            bodies=bodies,
            carried=carriers(model, bodies),
            refresh=None if shown else refresh,
        )


def scratch_of(mechanism: Mechanism) -> Scratch:
    """The working memory of this thread: what a call leaves there, the next one writes over.

    Making a `pin.Data` costs more than a hundred of the calls that use it (7.7 ms for 81 joints). It belongs
    to the model, so a mechanism and the robot made of it share it.
    """
    return _scratch(mechanism.model, mechanism.frames, threading.get_ident())


@lru_cache(maxsize=16)  # megabytes each
def _scratch(model: pin.Model, frames: tuple[int, ...], thread: int) -> Scratch:
    return Scratch.of(model, frames)


def _by_accessors(data: pin.Data) -> tuple[Array, ...]:
    """The six arrays of `Scratch` by pinocchio's public accessors, element by element, as copies.

    It costs more than computing what they hold.
    """
    return (
        np.array([[*pose.rotation.T.ravel(), *pose.translation] for pose in data.oMf]),
        data.J.reshape(6, -1).T.copy(),
        np.array([motion.vector for motion in data.ov]),
        np.array([motion.vector for motion in data.oa]),
        np.array([[*pose.rotation.T.ravel(), *pose.translation] for pose in data.oMi]),
        np.array([force.vector for force in data.f]),
    )


def _by_memory(data: pin.Data) -> tuple[Array, ...] | None:
    """The six arrays of `Scratch` on pinocchio's own memory; None where that is not laid out as expected."""
    blocks = (
        _block([pose.rotation for pose in data.oMf], 12),
        None if data.J.flags.owndata else data.J.reshape(6, -1).T,
        _block([motion.linear for motion in data.ov], 6),
        _block([motion.linear for motion in data.oa], 6),
        _block([pose.rotation for pose in data.oMi], 12),
        _block([force.linear for force in data.f], 6),
    )
    found = tuple(block for block in blocks if block is not None)
    return found if len(found) == len(blocks) else None


def _block(first_numbers: list[Array], width: int) -> Array | None:
    """All elements of one of pinocchio's vectors as an array (elements, width), None if they are no block.

    A C++ vector keeps its elements in one block, a fixed number of bytes apart; `first_numbers` are
    views of the first numbers of each.
    """
    if any(numbers.flags.owndata for numbers in first_numbers):
        return None  # copies, no views
    addresses = np.array([numbers.__array_interface__["data"][0] for numbers in first_numbers])
    apart = np.unique(np.diff(addresses))
    if len(apart) != 1 or apart[0] < 8 * width:
        return None
    return as_strided(first_numbers[0], (len(addresses), width), (int(apart[0]), 8))


def carriers(model: pin.Model, bodies: IntArray) -> Array:
    """1 where a joint (a column) carries a body, else 0; (F, nv)."""
    carried = np.zeros((len(bodies), model.nv))
    for f, body in enumerate(bodies):
        for joint in model.supports[int(body)]:
            if joint:
                first = model.joints[joint].idx_v
                carried[f, first : first + model.joints[joint].nv] = 1.0
    return carried


def integrate(mechanism: Mechanism, q: Array, step: Array) -> Array:
    """q (..., nq) moved by tangent vectors (..., nv): pinocchio's integrate, stacked."""
    model = mechanism.model
    if model.nq == model.nv:  # every joint a line: integrating is adding
        return q + step
    q = np.broadcast_to(q, (*step.shape[:-1], model.nq))
    flat = [
        pin.integrate(model, np.ascontiguousarray(a), np.ascontiguousarray(b))
        for a, b in zip(q.reshape(-1, model.nq), step.reshape(-1, model.nv), strict=True)
    ]
    return np.array(flat).reshape(*step.shape[:-1], model.nq)


def difference(mechanism: Mechanism, start: Array, q: Array) -> Array:
    """Tangent vectors (T, nv) from one configuration `start` (nq,) to q (T, nq)."""
    model = mechanism.model
    if model.nq == model.nv:
        return q - start
    return np.array([pin.difference(model, start, np.ascontiguousarray(row)) for row in q])


def difference_rates(mechanism: Mechanism, start: Array, q: Array, v: Array) -> Array:
    """Rates (T, nv) of `difference` from `start` (nq,) to q (T, nq) when the joints move with v (T, nv)."""
    model = mechanism.model
    if model.nq == model.nv:
        return v
    by_q = [pin.dDifference(model, start, np.ascontiguousarray(row), pin.ArgumentPosition.ARG1) for row in q]
    return matvec(np.array(by_q), v)


def between(mechanism: Mechanism, start: Array, q: Array) -> Array:
    """Tangent vectors (..., nv) from configurations start (..., nq) to q (..., nq), broadcast."""
    model = mechanism.model
    if model.nq == model.nv:
        return np.asarray(q - start)
    pairs = np.broadcast_arrays(start, q)
    flat = (np.ascontiguousarray(part).reshape(-1, model.nq) for part in pairs)
    ways = [pin.difference(model, one, two) for one, two in zip(*flat, strict=True)]
    return np.array(ways).reshape(*pairs[0].shape[:-1], model.nv)
