"""Close the loops of a mechanism near the reference of its file, with platform and motors free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from random import Random
from typing import Any, NamedTuple

import numpy as np

from framework.errors import NotAssembled, finite_numbers
from framework.kinematics.closures import LoopEquations, find_flipped_closure, scaled_equations
from framework.kinematics.frames import difference, frames_at, integrate_columns
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.numerics.arrays import LEAST_DIVISOR, Array, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import split_row_space
from framework.tolerances import BRANCHES_MEET, CLOSED_LOOP, FILE_ROUNDING, RANK_ROUNDING, REFERENCE_MOVE

MAX_NEWTON_STEP = 0.5  # [rad, robot lengths] largest motion of a joint in one Newton step
NEARBY_DISTANCE = 0.05  # [rad, robot lengths] from the reference to nearby poses, whose rank is compared
MAX_ITERATIONS = 25  # of Newton's and similar methods


@dataclass(frozen=True, eq=False)
class Configuration(ReadOnlyArrays):
    """A configuration with closed loops, as returned by solvers."""

    q: Array  # (nq,)
    x: Array  # (n,) platform coordinates
    residual: float  # largest residual of a loop equation [m or rad]
    iterations: int  # of Newton's method


def configuration(robot: Mechanism, pose: Any, *, stacks: bool = False) -> Array:
    """Return the checked q (nq,) of `pose`, an array or a `Configuration`.

    Args:
        stacks: whether T configurations (T, nq) are accepted as well.

    Raises:
        InvalidInput: wrong shape, or numbers that are not finite.
    """
    q = getattr(pose, "q", pose)
    return finite_numbers(f"q, all joints of {robot.name},", q, robot.model.nq, stacks=stacks)


class Closing(NamedTuple):
    """The last iterate of Newton's method on the loops, with the remaining residual."""

    q: Array  # (nq,)
    residual: float  # largest residual of a loop equation [m or rad]
    gap: float  # largest residual of a loop equation [robot lengths or rad]
    iterations: int  # number of Newton steps


def close_reference(mechanism: Mechanism) -> Closing:
    """Close the loops near the robot file's `reference`, springs at rest.

    First the joints whose positions the file states are at rest while the others close the loops. If that
    fails, all joints move, as little as possible. The result decides the working mode and the assembly mode.

    Raises:
        NotAssembled: the loops do not close from the reference, or only far from it, or flipped; carries the
            last iterate and the residual.
    """
    stated = velocity_columns(mechanism.model, mechanism.description.reference)
    others = np.setdiff1d(mechanism.joints, stated)  # of all columns but the springs'
    # q_near is the file's reference; if the file states all joints, all move at once
    closing = _close(mechanism, mechanism.q_near, others if len(others) else mechanism.joints)
    if closing.gap > CLOSED_LOOP and len(stated):
        closing = _close(mechanism, mechanism.q_near, mechanism.joints)
    if closing.gap > CLOSED_LOOP:
        rows = mechanism.rows
        gaps = np.abs(loops_at(mechanism, closing.q).residual)
        row = np.argmax(gaps)
        residual = float(gaps[row] * mechanism.row_lengths[row])
        unit = "rad" if rows.rotation[row] else "m"
        raise _not_assembled_error(
            mechanism,
            f"the loops do not close near the reference: {rows.names[row]} stays {residual:.3g} {unit} apart "
            f"after {closing.iterations} steps of Newton; check the link lengths and give a reference nearer "
            f"to an assembled configuration",
            closing._replace(residual=residual),
        )
    closure = find_flipped_closure(mechanism, frames_at(mechanism, closing.q[None]))
    if closure is not None:
        raise _not_assembled_error(
            mechanism,
            f"near the reference the loops close only with {closure} turned over, its frames pointing apart; "
            f"give a reference nearer to an assembled configuration",
            closing,
        )
    _check_distance(mechanism, closing, stated)
    return closing


def _close(mechanism: Mechanism, start: Array, free: IntArray) -> Closing:
    """Close all loops from `start` (nq,) by Newton steps of least norm in the columns `free` (k,).

    A step longer than `MAX_NEWTON_STEP` is shortened to it. A line search halves each step until the norm of
    the loop equations decreases. If the loops do not close, the result is the best iterate.
    """
    rounding_gap = 1e-15  # [rad, robot lengths] residual that no Newton step improves
    max_halvings = 14  # of a Newton step by the line search
    q, loops = start, loops_at(mechanism, start)
    iterations = 0
    while iterations < MAX_ITERATIONS and np.linalg.norm(loops.residual) > rounding_gap:
        iterations += 1
        # of all steps that close the linearised loops the one of least norm [rad, robot lengths], (k,)
        step = np.linalg.lstsq(loops.jacobian[:, free], -loops.residual, rcond=RANK_ROUNDING)[0].astype(float)
        step *= min(1.0, MAX_NEWTON_STEP / max(np.abs(step).max(), LEAST_DIVISOR))
        step *= mechanism.column_scale[free]  # robot lengths become metres

        for halvings in range(max_halvings + 1):
            trial = integrate_columns(mechanism, q, free, 0.5**halvings * step)
            trial_loops = loops_at(mechanism, trial)
            decrease = np.linalg.norm(loops.residual) - np.linalg.norm(trial_loops.residual)
            if decrease >= 0.0:
                break
        if decrease <= 0.0:  # no part of the step improves the iterate
            break
        q, loops = trial, trial_loops
    gaps = np.abs(loops.residual)
    residual = (gaps * mechanism.row_lengths).max(initial=0.0)
    return Closing(q, float(residual), float(gaps.max(initial=0.0)), iterations)


def loops_at(mechanism: Mechanism, q: Array) -> LoopEquations:
    """Compute residuals (rows,) and Jacobian (rows, nv) of all loops at q (nq,) [rad, robot lengths]."""
    residual, jacobian = scaled_equations(mechanism, mechanism.rows, frames_at(mechanism, q[None]))
    return LoopEquations(residual[0], jacobian[0])


def joint_loops_matrix(mechanism: Mechanism, q: Array) -> Array:
    """Compute the dimensionless Jacobian (rows, joints) of all loops at q (nq,), without springs."""
    return loops_at(mechanism, q).jacobian[:, mechanism.joints]


def allowed_joint_motions(mechanism: Mechanism, q: Array) -> Array:
    """Compute orthonormal motions (f, joints) that the loops allow at q (nq,) [rad, robot lengths]."""
    return split_row_space(joint_loops_matrix(mechanism, q), BRANCHES_MEET)[1]


def _check_distance(mechanism: Mechanism, closing: Closing, stated: IntArray) -> None:
    """Raise NotAssembled if `closing` moved a joint of the columns `stated` far from the file's value."""
    offset = difference(mechanism, mechanism.q_near, closing.q)  # (nv,) from the file's reference [rad, m]
    distances = np.abs(offset / mechanism.column_scale)[stated]  # [rad, robot lengths]
    if not distances.max(initial=0.0) > REFERENCE_MOVE:
        return
    column = stated[np.argmax(distances)]
    joint = mechanism.coordinates.name_of(column)
    value = mechanism.description.reference[joint]
    raise _not_assembled_error(
        mechanism,
        f"the reference is not near an assembled configuration: {joint} is given as {value:g}, the loops "
        f"close at {value + offset[column]:.4g}; give all joints, so that one way of assembling is meant",
        closing,
    )


def _not_assembled_error(mechanism: Mechanism, reason: str, closing: Closing) -> NotAssembled:
    """Return the error for a `reason`, with the pose of `closing` and a remark on angles in degrees."""
    error = NotAssembled(reason, name=mechanism.name, q=closing.q, residual=closing.residual)
    return error.adding(remark_on_turns(mechanism, mechanism.description.reference))


def remark_on_turns(mechanism: Mechanism, positions: Mapping[str, float]) -> str:
    """Return a clause on hinges whose `positions` by name exceed a full turn; empty without any."""
    turns = []
    columns = velocity_columns(mechanism.model, positions)
    for sliding, (joint, angle) in zip(mechanism.sliding[columns], positions.items(), strict=True):
        count = abs(angle) / (2.0 * np.pi)
        if count > 1.0 and not sliding:
            turns.append(f"{joint} at {angle:g} rad is {count:.3g} turns")
    return f"angles are in rad: {', '.join(turns)}" if turns else ""


def move_closed(mechanism: Mechanism, q: Array, motion: Array) -> Array | None:
    """Return the closed pose (nq,) after a motion (joints,) [rad, robot lengths] from q; None if open."""
    joints = mechanism.joints
    moved = integrate_columns(mechanism, q, joints, motion * mechanism.column_scale[joints])
    closing = _close(mechanism, moved, joints)
    return closing.q if closing.gap <= CLOSED_LOOP else None


def nearby_configurations(
    mechanism: Mechanism,
    reference: Array,
    *,
    distance: float = NEARBY_DISTANCE,  # [rad, robot lengths] of the joint that moves most
) -> tuple[Array, ...]:
    """Find assembled configurations (nq,) about a `distance` from the reference (nq,), springs at rest.

    Random motions that the loops allow, drawn with a fixed seed, lead away from the reference. Then the loops
    are closed again. The configurations lie in different directions from the reference. A rigid structure has
    none.
    """
    same_direction_cosine = 0.99  # two directions with a larger |cosine| count as the same
    max_nearby = 2  # number of configurations
    draws = 8  # number of random motions that are tried
    joints = mechanism.joints
    scale = mechanism.column_scale  # (nv,) the robot's length [m] for slides, 1 for turns
    allowed = allowed_joint_motions(mechanism, reference)  # (f, joints)
    random = Random(0)  # of the standard library: importing numpy's takes longer
    configurations: list[Array] = []
    directions: list[Array] = []  # (nv,) from the reference to these configurations
    # a single motion need not be drawn twice
    for _ in range(draws if len(allowed) > 1 else len(allowed)):
        # the projection of a random motion on the allowed motions does not depend on their basis
        drawn = np.array([random.gauss() for _ in joints])
        motion = (allowed @ drawn) @ allowed  # (joints,) [rad, robot lengths]
        q = move_closed(mechanism, reference, distance * motion / np.abs(motion).max())
        if q is None:
            continue
        offset = difference(mechanism, reference, q) / scale
        length = np.linalg.norm(offset)
        if length <= FILE_ROUNDING:  # the reference itself
            continue
        direction = offset / length
        if all(abs(direction @ other) < same_direction_cosine for other in directions):
            configurations.append(q)
            directions.append(direction)
        if len(configurations) == max_nearby:
            break
    return tuple(configurations)
