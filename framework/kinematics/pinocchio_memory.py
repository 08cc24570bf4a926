"""Pinocchio's working memory for a mechanism, read as numpy arrays without copies.

Reading a stack of poses element by element through pinocchio's accessors costs more than computing them.
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

    The arrays are views of the memory of `data`: they change with every call of pinocchio on it.
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

    @staticmethod
    def of(model: pin.Model, frames: tuple[int, ...]) -> Scratch:
        """Allocate working memory for a model and some of its frames.

        Raises:
            RuntimeError: `eigenpy.sharedMemory` is switched off, so that pinocchio hands out copies.
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


def _view_vector(vector: Any, first_part: str, width: int) -> Array:
    """View a C++ vector of pinocchio as an array (elements, width), its elements with `first_part` ahead.

    A C++ vector keeps its elements in one block of memory, at a constant stride [bytes].
    """
    first, second = (getattr(vector[k], first_part) for k in range(2))
    stride = second.ctypes.data - first.ctypes.data
    return as_strided(first, (len(vector), width), (stride, first.itemsize))


def carrying_joints(model: pin.Model, bodies: IntArray) -> Array:
    """Return 1 where a column of the velocity vector moves one of the bodies (F,), else 0, (F, nv)."""
    carried = np.zeros((len(bodies), model.nv))
    for f, body in enumerate(bodies):
        for joint in model.supports[int(body)]:
            if joint:
                first = model.joints[joint].idx_v
                carried[f, first : first + model.joints[joint].nv] = 1.0
    return carried
