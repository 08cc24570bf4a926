"""Pinocchio's working memory for a mechanism, read as numpy arrays without copies.

Reading a stack of poses element by element through pinocchio's accessors costs more than computing them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import as_strided

from framework.kinematics.mechanism import Mechanism
from framework.numerics.arrays import Array, IntArray


class Scratch(NamedTuple):
    """Pinocchio's working memory for a mechanism, with its results as arrays.

    The arrays are views of the memory of `data`: they change with every call of pinocchio on it. If its
    layout is not the expected one they are copies, which `update` refreshes after a call.
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

    def update(self) -> None:
        """Refresh the arrays after a call of pinocchio."""
        if self.refresh is not None:
            self.refresh()

    @staticmethod
    def of(model: pin.Model, frames: tuple[int, ...]) -> Scratch:
        """Allocate working memory for a model and some of its frames."""
        data = model.createData()
        # results of a motion that all differ tell whether the views read the right numbers
        motion = np.linspace(0.5, 1.0, model.nv)
        q = pin.integrate(model, pin.neutral(model), motion)
        pin.rnea(model, data, q, motion, motion)
        pin.computeForwardKinematicsDerivatives(model, data, q, motion, motion)
        pin.updateFramePlacements(model, data)
        copies, views = _copy_arrays(data), _view_arrays(data)
        arrays = views if views is not None and all(map(np.array_equal, views, copies)) else copies

        def refresh() -> None:
            """Copy pinocchio's results into the arrays once more."""
            for array, current in zip(arrays, _copy_arrays(data), strict=True):
                array[...] = current

        bodies = np.array([model.frames[frame].parentJoint for frame in frames], dtype=np.intp)
        rows = np.array(frames, dtype=np.intp)
        refresher = refresh if arrays is copies else None
        return Scratch._make((data, *arrays, rows, bodies, carrying_joints(model, bodies), refresher))


def scratch_of(mechanism: Mechanism) -> Scratch:
    """Return the working memory of this thread, which every call of pinocchio overwrites.

    Making a `pin.Data` costs more than a hundred of the calls that use it (7.7 ms for 81 joints). It belongs
    to the model, so a mechanism and the robot made of the mechanism share it.
    """
    return _thread_scratch(mechanism.model, mechanism.frames, threading.get_ident())


@lru_cache(maxsize=16)  # megabytes each
def _thread_scratch(model: pin.Model, frames: tuple[int, ...], thread: int) -> Scratch:
    """Allocate the working memory of one thread, once.

    The thread's number is a key of the cache.
    """
    return Scratch.of(model, frames)


def _copy_arrays(data: pin.Data) -> tuple[Array, ...]:
    """Copy the six arrays of `Scratch` by pinocchio's public accessors, element by element.

    That costs more than computing the numbers.
    """
    return (
        np.array([[*pose.rotation.T.ravel(), *pose.translation] for pose in data.oMf]),
        data.J.reshape(6, -1).T.copy(),
        np.array([motion.vector for motion in data.ov]),
        np.array([motion.vector for motion in data.oa]),
        np.array([[*pose.rotation.T.ravel(), *pose.translation] for pose in data.oMi]),
        np.array([force.vector for force in data.f]),
    )


def _view_arrays(data: pin.Data) -> tuple[Array, ...] | None:
    """Return the six arrays of `Scratch` as views of pinocchio's memory.

    None if its layout is not the expected one.
    """
    blocks = (
        _view_vector([pose.rotation for pose in data.oMf], 12),
        None if data.J.flags.owndata else data.J.reshape(6, -1).T,
        _view_vector([motion.linear for motion in data.ov], 6),
        _view_vector([motion.linear for motion in data.oa], 6),
        _view_vector([pose.rotation for pose in data.oMi], 12),
        _view_vector([force.linear for force in data.f], 6),
    )
    views = tuple(block for block in blocks if block is not None)
    return views if len(views) == len(blocks) else None


def _view_vector(first_numbers: list[Array], width: int) -> Array | None:
    """View a C++ vector of pinocchio as an array (elements, width).

    None if its memory is not one block. The vector keeps its elements in one block at a constant stride
    [bytes]. `first_numbers` are views of the first numbers of each element.
    """
    if any(numbers.flags.owndata for numbers in first_numbers):
        return None  # they are copies
    addresses = np.array([numbers.__array_interface__["data"][0] for numbers in first_numbers])
    strides = np.unique(np.diff(addresses))
    if len(strides) != 1 or strides[0] < 8 * width:
        return None
    return as_strided(first_numbers[0], (len(addresses), width), (int(strides[0]), 8))


def carrying_joints(model: pin.Model, bodies: IntArray) -> Array:
    """Return 1 where a column of the velocity vector moves one of the bodies (F,), else 0, (F, nv)."""
    carried = np.zeros((len(bodies), model.nv))
    for f, body in enumerate(bodies):
        for joint in model.supports[int(body)]:
            if joint:
                first = model.joints[joint].idx_v
                carried[f, first : first + model.joints[joint].nv] = 1.0
    return carried
