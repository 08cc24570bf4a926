"""Closures of a robot file as acceleration-level constraints, written anew for the tests.

The framework locks a rotation by keeping two axes perpendicular. Here the locked part of the relative
angular velocity is zero instead, so that the two have only the words of the robot file in common.
With d = p2 - p1 and e an axis carried by the first frame, each closure gives J v = 0, J a + drift = 0:

    three translations   d' = 0                     some translations   (e . d)' = 0
    three rotations      w2 - w1 = 0                two rotations       e . (w2 - w1) = 0
    one rotation         n . (w2 - w1) = 0, n the common normal of one axis on each body (universal joint)
    a distance           d . d' = 0
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from framework.model.description import Closure

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
REDUNDANT = 1e-9  # of the largest pivot


class ClosureRows(NamedTuple):
    """J v = 0 and J a + drift = 0 at one state."""

    jacobian: np.ndarray  # (m, nv)
    drift: np.ndarray  # (m,)


def frame_of(model: pin.Model, name: str) -> int:
    """The frame of a link or, if there is none of that name, of a joint."""
    link = pin.FrameType.BODY
    return model.getFrameId(name, link) if model.existFrame(name, link) else model.getFrameId(name)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of two vectors; ten times as fast as numpy's."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def closure_rows(model: pin.Model, data: pin.Data, closures: Sequence[Closure]) -> ClosureRows:
    """All rows, redundant ones included.

    `data` must be at forwardKinematics(q, v, 0), computeJointJacobians and updateFramePlacements.
    """
    parts = [_rows(model, data, closure) for closure in closures]
    return ClosureRows(np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts]))


def closure_errors(model: pin.Model, data: pin.Data, closures: Sequence[Closure]) -> np.ndarray:
    """How far the closures are open [m, rad]: the rows of `closure_rows` are the derivatives."""
    return np.concatenate([_errors(model, data, closure) for closure in closures])


def independent(jacobian: np.ndarray) -> np.ndarray:
    """Ascending indices of rows that do not repeat others."""
    upper, order = qr(jacobian.T, mode="r", pivoting=True)
    pivots = np.abs(np.diag(upper))
    return np.sort(order[: np.sum(pivots > REDUNDANT * pivots[0])])


def range_rows(jacobian: np.ndarray, rank: int) -> np.ndarray:
    """U' (rank, m), U an orthonormal basis of the range of J (m, nv); one matrix where no row repeats others.

    Rows chosen at one pose may repeat each other at another: overconstrained loops take the range anew.
    """
    return np.eye(rank) if len(jacobian) == rank else np.linalg.svd(jacobian)[0][:, :rank].T


def _rows(model: pin.Model, data: pin.Data, closure: Closure) -> tuple[np.ndarray, np.ndarray]:
    first, second = (frame_of(model, name) for name in closure.frames)
    J1, J2 = (pin.getFrameJacobian(model, data, f, WORLD_AXES).reshape(6, -1) for f in (first, second))
    v1, v2 = (pin.getFrameVelocity(model, data, f, WORLD_AXES).vector for f in (first, second))
    a1, a2 = (pin.getFrameClassicalAcceleration(model, data, f, WORLD_AXES).vector for f in (first, second))
    R1, R2 = data.oMf[first].rotation, data.oMf[second].rotation
    d = data.oMf[second].translation - data.oMf[first].translation
    J, v, a = J2 - J1, v2 - v1, a2 - a1
    spin, bend = v1[3:], a1[3:]  # of the first frame
    rows, drift = [], []
    if closure.length is not None:
        rows.append(d @ J[:3] / closure.length)
        drift.append((v[:3] @ v[:3] + d @ a[:3]) / closure.length)
    held = ["xyz".index(axis) for axis in closure.axes if len(axis) == 1]
    if len(held) == 3:
        rows += [*J[:3]]
        drift += [*a[:3]]
    else:
        for k in held:
            e = R1[:, k]
            de = cross(spin, e)
            dde = cross(bend, e) + cross(spin, de)
            rows.append(e @ J[:3] + cross(e, d) @ J1[3:])
            drift.append(e @ a[:3] + 2 * de @ v[:3] + dde @ d)
    locked = ["xyz".index(axis[1]) for axis in closure.axes if len(axis) == 2]
    if len(locked) == 3:
        rows += [*J[3:]]
        drift += [*a[3:]]
    elif len(locked) == 2:
        for k in locked:
            e = R1[:, k]
            rows.append(e @ J[3:])
            drift.append(e @ a[3:] + cross(spin, e) @ v[3:])
    elif locked:
        u, w = _crossed(R1, R2, locked[0])
        normal = cross(u, w)
        rows.append(normal @ J[3:])
        swept = cross(cross(spin, u), w) + cross(u, cross(v2[3:], w))
        drift.append(normal @ a[3:] + swept @ v[3:])
    return np.array(rows).reshape(-1, model.nv), np.array(drift)


def _errors(model: pin.Model, data: pin.Data, closure: Closure) -> np.ndarray:
    first, second = (data.oMf[frame_of(model, name)] for name in closure.frames)
    R1, R2 = first.rotation, second.rotation
    d = second.translation - first.translation
    errors = []
    if closure.length is not None:
        errors.append((d @ d - closure.length**2) / (2 * closure.length))
    held = ["xyz".index(axis) for axis in closure.axes if len(axis) == 1]
    errors += [*d] if len(held) == 3 else [R1[:, k] @ d for k in held]
    locked = ["xyz".index(axis[1]) for axis in closure.axes if len(axis) == 2]
    if len(locked) == 3:
        errors += [*(R1 @ pin.log3(R1.T @ R2))]
    elif len(locked) == 2:
        (free,) = {0, 1, 2} - set(locked)
        tilt = cross(R1[:, free], R2[:, free])
        errors += [R1[:, k] @ tilt for k in locked]
    elif locked:
        u, w = _crossed(R1, R2, locked[0])
        errors.append(-u @ w)
    return np.array(errors)


def _crossed(R1: np.ndarray, R2: np.ndarray, locked: int) -> tuple[np.ndarray, np.ndarray]:
    """Axes of a universal joint: of the free axes the first is carried by the first frame."""
    first, second = (k for k in range(3) if k != locked)
    return R1[:, first], R2[:, second]
