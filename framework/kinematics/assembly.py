"""Closing the loops of a mechanism near the reference of its file; neither platform nor motors are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from framework.arrays import LEAST_DIVISOR, Array, IntArray, ReadOnlyArrays
from framework.errors import NotAssembled, finite_numbers
from framework.kinematics.closures import find_turned_over, loop_equations, scale_jacobian
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.mechanism import Mechanism, columns_of
from framework.kinematics.mistaken_units import remark_on_turns
from framework.tolerances import BRANCHES_MEET, CLOSED_LOOP, RANK_ROUNDING, REFERENCE_MOVE

MAX_NEWTON_STEP = 0.5  # [rad or lengths of the robot] that one Newton step may move a joint
NEARBY_DISTANCE = 0.05  # [rad, lengths] from the reference to where its rank is compared with
MAX_NEARBY, NEARBY_DRAWS = 2, 8  # configurations taken, if they lie in different directions, and drawn
MIN_NEARBY_RATIO = 0.1  # of that distance: what closes nearer has come back
SAME_DIRECTION_COSINE = 0.99  # between two directions, either sign
MAX_ITERATIONS = 100
ROUNDING_GAP = 1e-15  # [rad, lengths] below which no Newton step improves the loops
MIN_DAMPING = 1e-4  # share of a Newton step that is still tried


@dataclass(frozen=True, eq=False)
class Configuration(ReadOnlyArrays):
    """A configuration whose loops are closed: holding one proves it.

    `q` (nq,), platform `x` (n,), largest loop equation `residual` [m or rad], Newton `iterations`.
    """

    q: Array
    x: Array
    residual: float
    iterations: int


def configuration(robot: Mechanism, given: Any, *, stacks: bool = False) -> Array:
    """Return all joints q (nq,), of an array or of what `assemble` and `forward_kinematics` return.

    Args:
        stacks: whether T configurations (T, nq) will do as well.

    Raises:
        InvalidInput: it has the wrong shape, or is not finite.
    """
    q = getattr(given, "q", given)
    return finite_numbers(f"q, all joints of {robot.name},", q, robot.model.nq, stacks=stacks)


class Closing(NamedTuple):
    """The configuration found by closing the loops, and what stays open."""

    q: Array  # (nq,)
    residual: float  # largest loop equation [m or rad]
    worst: float  # the same, in lengths of the robot and radians
    iterations: int


def close_reference(mechanism: Mechanism) -> Closing:
    """Return the assembled configuration at the robot file's `reference`, springs at rest.

    The joints that the file gives are held while the others close the loops; if that cannot be, all
    joints give way, as little as possible. It decides the working and the assembly mode.

    Raises:
        NotAssembled: the loops do not close from there, or only far from what the file gives, or turned
            over; carries the last iterate and the residual.
    """
    given_columns = columns_of(mechanism.model, mechanism.description.reference)
    others = np.setdiff1d(mechanism.joints, given_columns)
    closing = _close(mechanism, mechanism.q_near, others) if len(given_columns) and len(others) else None
    if closing is None or closing.worst > CLOSED_LOOP:
        closing = _close(mechanism, mechanism.q_near, mechanism.joints)
    if closing.worst > CLOSED_LOOP:
        raise _open_error(mechanism, closing)
    turned = find_turned_over(mechanism, frames_at(mechanism, closing.q[None]))
    if turned is not None:
        raise _not_assembled(
            mechanism,
            f"near the reference the loops close only with {turned} turned over, its frames pointing apart; "
            f"give a reference nearer to an assembled configuration",
            closing,
        )
    _check_near(mechanism, closing, given_columns)
    return closing


def _close(mechanism: Mechanism, start: Array, free: IntArray) -> Closing:
    """Close all loops by damped Newton steps of least norm of the columns `free`, from `start`."""
    rows, lengths = mechanism.rows, mechanism.column_scale[free]
    weights = np.where(rows.rotation, 1.0, 1.0 / mechanism.length)

    def mismatch(q: Array) -> float:
        return float(np.linalg.norm(weights * loop_equations(rows, frames_at(mechanism, q)).residual[0]))

    q, iterations = start[None], 0
    reduced = mismatch(q)
    while iterations < MAX_ITERATIONS and reduced > ROUNDING_GAP:
        iterations += 1
        loops = loop_equations(rows, frames_at(mechanism, q))
        jacobian = scale_jacobian(mechanism, loops.jacobian, rows.rotation)[0][:, free]
        joint = -np.linalg.lstsq(jacobian, weights * loops.residual[0], rcond=RANK_ROUNDING)[0]
        step = np.zeros((1, mechanism.model.nv))
        step[0, free] = joint * min(1.0, MAX_NEWTON_STEP / max(np.abs(joint).max(), LEAST_DIVISOR)) * lengths
        fraction = 1.0
        while (
            after := mismatch(integrate(mechanism, q, fraction * step))
        ) > reduced and fraction > MIN_DAMPING:
            fraction *= 0.5
        if after >= reduced:
            break
        q, reduced = integrate(mechanism, q, fraction * step), after
    left = np.abs(loop_equations(rows, frames_at(mechanism, q)).residual[0])
    return Closing(q[0], float(left.max()), float((weights * left).max()), iterations)


def _open_error(mechanism: Mechanism, closing: Closing) -> NotAssembled:
    """Return the error for loops that stay open."""
    rows = mechanism.rows
    left = np.abs(loop_equations(rows, frames_at(mechanism, closing.q[None])).residual[0])
    row = int(np.argmax(left * np.where(rows.rotation, mechanism.length, 1.0)))
    return _not_assembled(
        mechanism,
        f"the loops do not close near the reference: {rows.names[row]} stays {left[row]:.3g} "
        f"{'rad' if rows.rotation[row] else 'm'} apart after {closing.iterations} iterations; check the link "
        f"lengths and give a reference nearer to an assembled configuration",
        closing._replace(residual=float(left[row])),
    )


def _check_near(mechanism: Mechanism, closing: Closing, given: IntArray) -> None:
    """Refuse an assembled configuration in which a joint is far from what the file gives."""
    moved = difference(mechanism, mechanism.q_near, closing.q[None])[0]
    far = np.abs(moved / mechanism.column_scale)[given]
    if not far.max(initial=0.0) > REFERENCE_MOVE:
        return
    column = int(given[np.argmax(far)])
    joint = mechanism.coordinates.name_of(column)
    value = mechanism.description.reference[joint]
    raise _not_assembled(
        mechanism,
        f"the reference is not near an assembled configuration: {joint} is given as {value:g}, the loops "
        f"close at {value + moved[column]:.4g}; give all joints, so that one way of assembling is meant",
        closing,
    )


def _not_assembled(mechanism: Mechanism, what: str, closing: Closing) -> NotAssembled:
    turns = remark_on_turns(mechanism, mechanism.description.reference)
    return NotAssembled(f"{mechanism.name}: {what}{turns}", q=closing.q, residual=closing.residual)


def nearby_configurations(mechanism: Mechanism, reference: Array) -> tuple[Array, ...]:
    """Find assembled configurations (nq,) about `NEARBY_DISTANCE` from the reference (nq,), springs at rest.

    The reference moved along motions that its loops allow, drawn at random but always alike, and closed
    again; of a structure none.
    """
    joints, lengths = mechanism.joints, mechanism.column_scale
    values, right = np.linalg.svd(all_loops_matrix(mechanism, reference)[:, joints])[1:]
    allowed = right[int(np.sum(values > BRANCHES_MEET * values.max(initial=0.0))) :]
    random = np.random.default_rng(0)
    configurations: list[Array] = []
    ways: list[Array] = []
    for _ in range(NEARBY_DRAWS if len(allowed) > 1 else len(allowed)):
        motion = (allowed @ random.standard_normal(len(joints))) @ allowed  # whatever basis `allowed` is
        step = np.zeros((1, mechanism.model.nv))
        step[0, joints] = NEARBY_DISTANCE * motion / np.abs(motion).max() * lengths[joints]
        closing = _close(mechanism, integrate(mechanism, reference[None], step)[0], joints)
        direction = difference(mechanism, reference, closing.q[None])[0] / lengths
        size = float(np.linalg.norm(direction))
        new = all(
            abs(direction @ earlier) < SAME_DIRECTION_COSINE * size * np.linalg.norm(earlier)
            for earlier in ways
        )
        if closing.worst <= CLOSED_LOOP and size > MIN_NEARBY_RATIO * NEARBY_DISTANCE and new:
            configurations.append(closing.q)
            ways.append(direction)
        if len(configurations) == MAX_NEARBY:
            break
    return tuple(configurations)


def all_loops_matrix(mechanism: Mechanism, q: Array) -> Array:
    """Compute the Jacobian (rows, nv) of all loop equations at q (nq,), without dimension."""
    rows = mechanism.rows
    jacobian = loop_equations(rows, frames_at(mechanism, q[None])).jacobian
    return scale_jacobian(mechanism, jacobian, rows.rotation)[0]
