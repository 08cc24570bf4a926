"""Closing the loops of a mechanism near the reference of its file; neither platform nor motors are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.errors import NotAssembled
from framework.kinematics.closures import loop_equations, scaled
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.locked_directions import turned_over
from framework.kinematics.mechanism import Mechanism, columns_of

# A row that others repeat, repeats them up to rounding; between that and a real one lie orders of
# magnitude. Relative to the largest row, in lengths of the robot.
REDUNDANT = 1e-9
CLOSED = 1e-12  # largest loop equation of a closed robot, in lengths of the robot and radians
FAR = 0.2  # [rad, lengths] that a joint may end from where the robot file puts it
LONGEST_STEP = 0.5  # [rad or lengths of the robot] that one Newton step may move a joint
NEARBY = 0.05  # [rad, lengths] from the reference to the configurations that its rank is compared with
WAYS, DRAWN = 2, 8  # so many of them if they lie in different directions, out of so many drawn
SAME_WAY = 0.99  # cosine between two directions, either sign
# Singular values of the reference, without dimension, that count as zero if they are not zero nearby. At a
# distance d from where branches cross, loops are closed to d^2 between them: at 1e-6 all are the same.
CROSSED = 1e-6


@dataclass(frozen=True, eq=False)
class Configuration(ReadOnlyArrays):
    """A configuration whose loops are closed: holding one proves it.

    `q` (nq,), platform `x` (n,), largest loop equation `residual` [m or rad], Newton `iterations`.
    """

    q: Array
    x: Array
    residual: float
    iterations: int


class Closing(NamedTuple):
    """Where the loops are least open."""

    q: Array  # (nq,)
    residual: float  # largest loop equation [m or rad]
    worst: float  # the same, in lengths of the robot and radians
    iterations: int


def close_reference(mechanism: Mechanism) -> Closing:
    """The assembled configuration at the robot file's `reference`, springs at rest.

    The joints that the file gives are held while the others close the loops; if that cannot be, all
    joints give way, as little as possible. It decides the working and the assembly mode.

    Raises:
        NotAssembled: the loops do not close from there, or only far from what the file gives, or turned
            over; carries the last iterate and the residual.
    """
    given = columns_of(mechanism.model, mechanism.description.reference)
    others = np.setdiff1d(mechanism.joints, given)
    closing = _close(mechanism, mechanism.q_near, others) if len(given) and len(others) else None
    if closing is None or closing.worst > CLOSED:
        closing = _close(mechanism, mechanism.q_near, mechanism.joints)
    if closing.worst > CLOSED:
        raise _left_open(mechanism, closing)
    turned = turned_over(mechanism, frames_at(mechanism, closing.q[None]))
    if turned is not None:
        raise NotAssembled(
            f"{mechanism.name}: near the reference the loops close only with {turned} turned over, its "
            f"frames pointing apart; give a reference nearer to an assembled configuration",
            q=closing.q,
            residual=closing.residual,
        )
    _check_near(mechanism, closing, given)
    return closing


def _close(mechanism: Mechanism, start: Array, free: IntArray) -> Closing:
    """Damped Newton steps of least norm of the columns `free` on all loop equations, from `start`."""
    rows, lengths = mechanism.rows, mechanism.column_scale[free]
    weights = np.where(rows.rotation, 1.0, 1.0 / mechanism.length)

    def mismatch(q: Array) -> float:
        return float(np.linalg.norm(weights * loop_equations(rows, frames_at(mechanism, q)).residual[0]))

    q, iterations = start[None], 0
    now = mismatch(q)
    while iterations < 100 and now > 1e-15:
        iterations += 1
        loops = loop_equations(rows, frames_at(mechanism, q))
        jacobian = scaled(mechanism, loops.jacobian, rows.rotation)[0][:, free]
        joint = -np.linalg.lstsq(jacobian, weights * loops.residual[0], rcond=REDUNDANT)[0]
        step = np.zeros((1, mechanism.model.nv))
        step[0, free] = joint * min(1.0, LONGEST_STEP / max(np.abs(joint).max(), 1e-300)) * lengths
        fraction = 1.0
        while (after := mismatch(integrate(mechanism, q, fraction * step))) > now and fraction > 1e-4:
            fraction *= 0.5
        if after >= now:
            break
        q, now = integrate(mechanism, q, fraction * step), after
    left = np.abs(loop_equations(rows, frames_at(mechanism, q)).residual[0])
    return Closing(q[0], float(left.max()), float((weights * left).max()), iterations)


def _left_open(mechanism: Mechanism, closing: Closing) -> NotAssembled:
    """What to say of loops that stay open."""
    rows = mechanism.rows
    left = np.abs(loop_equations(rows, frames_at(mechanism, closing.q[None])).residual[0])
    row = int(np.argmax(left * np.where(rows.rotation, mechanism.length, 1.0)))
    return NotAssembled(
        f"{mechanism.name}: the loops do not close near the reference: {rows.names[row]} stays "
        f"{left[row]:.3g} {'rad' if rows.rotation[row] else 'm'} apart after {closing.iterations} "
        f"iterations; check the link lengths and give a reference nearer to an assembled configuration",
        q=closing.q,
        residual=float(left[row]),
    )


def _check_near(mechanism: Mechanism, closing: Closing, given: IntArray) -> None:
    """Refuse an assembled configuration in which a joint is far from what the file gives."""
    moved = difference(mechanism, mechanism.q_near, closing.q[None])[0]
    far = np.abs(moved / mechanism.column_scale)[given]
    if not far.max(initial=0.0) > FAR:
        return
    column = int(given[np.argmax(far)])
    joint = mechanism.joint_of(column)
    value = mechanism.description.reference[joint]
    raise NotAssembled(
        f"{mechanism.name}: the reference is not near an assembled configuration: {joint} is given as "
        f"{value:g}, the loops close at {value + moved[column]:.4g}; give all joints, so that one way of "
        f"assembling is meant",
        q=closing.q,
        residual=closing.residual,
    )


def nearby_configurations(mechanism: Mechanism, reference: Array) -> tuple[Array, ...]:
    """Assembled configurations (nq,) about `NEARBY` from the reference (nq,), springs at rest.

    The reference moved along motions that its loops allow, drawn at random but always alike, and closed
    again; of a structure none.
    """
    joints, lengths = mechanism.joints, mechanism.column_scale
    values, right = np.linalg.svd(loop_matrix(mechanism, reference)[:, joints])[1:]
    allowed = right[int(np.sum(values > CROSSED * values.max(initial=0.0))) :]
    random = np.random.default_rng(0)
    found: list[Array] = []
    ways: list[Array] = []
    for _ in range(DRAWN if len(allowed) > 1 else len(allowed)):
        motion = (allowed @ random.standard_normal(len(joints))) @ allowed  # whatever basis `allowed` is
        step = np.zeros((1, mechanism.model.nv))
        step[0, joints] = NEARBY * motion / np.abs(motion).max() * lengths[joints]
        closing = _close(mechanism, integrate(mechanism, reference[None], step)[0], joints)
        way = difference(mechanism, reference, closing.q[None])[0] / lengths
        size = float(np.linalg.norm(way))
        new = all(abs(way @ other) < SAME_WAY * size * np.linalg.norm(other) for other in ways)
        if closing.worst <= CLOSED and size > 0.1 * NEARBY and new:
            found.append(closing.q)
            ways.append(way)
        if len(found) == WAYS:
            break
    return tuple(found)


def loop_matrix(mechanism: Mechanism, q: Array) -> Array:
    """Jacobian (rows, nv) of all loop equations at q (nq,), without dimension."""
    rows = mechanism.rows
    jacobian = loop_equations(rows, frames_at(mechanism, q[None])).jacobian
    return scaled(mechanism, jacobian, rows.rotation)[0]
