"""Pinocchio's working memory for a mechanism, read as numpy arrays without copies.

Reading poses element by element through pinocchio's accessors takes longer than computing them.
"""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import as_strided

from framework.kinematics.mechanism import Mechanism
from framework.numerics.arrays import Array, IntArray


class Scratch(NamedTuple):
    """Pinocchio's working memory for a mechanism, with its results as arrays.

    The arrays are views of the memory of `data`. So every call of pinocchio with `data` changes them.
    """

    data: pin.Data
    placements: Array  # (frames of the model, 12) the three axes of a frame, then its origin
    columns: Array  # (nv, 6) screws of the joints
    velocities: Array  # (bodies of the model, 6) twists at the base's origin
    accelerations: Array  # (bodies of the model, 6) time derivatives of these twists
    joints: Array  # (bodies of the model, 12) placements of the joints, like `placements`
    forces: Array  # (bodies of the model, 6) (force, moment) through the joints on their own axes, by RNEA
    frames: IntArray  # (F,) rows of `placements` that the mechanism needs
    bodies: IntArray  # (F,) rows of `velocities` of the bodies of these frames
    carried: Array  # (F, nv) 1 where the column moves the frame, else 0

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
            columns=data.J.reshape(6, -1).T,
            velocities=_view_vector(data.ov, "linear", 6),
            accelerations=_view_vector(data.oa, "linear", 6),
            joints=_view_vector(data.oMi, "rotation", 12),
            forces=_view_vector(data.f, "linear", 6),
            frames=np.array(frames, dtype=np.intp),
            bodies=bodies,
            carried=carrying_joints(model, bodies),
        )


def scratch_of(mechanism: Mechanism) -> Scratch:
    """Return the working memory of this thread, which every call of pinocchio overwrites.

    Allocating a `pin.Data` takes longer than a hundred calls with it (7.7 ms for 81 joints). The memory
    belongs to the model, so a mechanism and the robot made of it share the same memory.
    """
    return _thread_scratch(mechanism.model, mechanism.frames, threading.get_ident())


@lru_cache(maxsize=16)  # of several megabytes each
def _thread_scratch(model: pin.Model, frames: tuple[int, ...], thread: int) -> Scratch:
    """Allocate working memory; the `thread` makes the cache return one to each thread."""
    return Scratch.of(model, frames)


def _view_vector(vector: Any, first_part: str, width: int) -> Array:
    """View a C++ vector of pinocchio as an array (elements, width) of doubles.

    The first `width` doubles of each element begin with its attribute `first_part`. A C++ vector stores its
    elements in one block of memory, at a constant stride [bytes].
    """
    first, second = (getattr(vector[k], first_part) for k in range(2))
    stride = second.ctypes.data - first.ctypes.data
    return as_strided(first, (len(vector), width), (stride, first.itemsize))


def carrying_joints(model: pin.Model, bodies: IntArray) -> Array:
    """Return 1 where a column moves one of the bodies (F,), else 0, (F, nv)."""
    carried = np.zeros((len(bodies), model.nv))
    for f, body in enumerate(bodies):
        for joint in model.supports[int(body)]:
            if joint:  # joint 0 is the base
                first = model.joints[joint].idx_v
                carried[f, first : first + model.joints[joint].nv] = 1.0
    return carried
