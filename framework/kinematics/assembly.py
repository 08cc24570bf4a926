"""The assembled reference of a robot, and which of its loop equations are independent there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.errors import NotAssembled, SingularReference
from framework.kinematics.closures import column_scale, loop_equations, scaled
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.locked_directions import turned_over
from framework.kinematics.platform import platform_coordinates, platform_jacobian
from framework.model import ParallelRobot
from framework.model.parallel_robot import LoopRows

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


@lru_cache(maxsize=128)
def reference_configuration(robot: ParallelRobot) -> Configuration:
    """The assembled configuration at the robot file's `reference`, springs at rest.

    The joints that the file gives are held while the others close the loops; if that cannot be, all
    joints give way, as little as possible. It decides the working and the assembly mode. Memoised: a
    pure function of a frozen robot.

    Raises:
        NotAssembled: the loops do not close from there, or only far from what the file gives, or turned
            over; carries the last iterate and the residual.
    """
    model = robot.model
    given = [model.joints[model.getJointId(name)].idx_v for name in robot.description.reference]
    movable = np.setdiff1d(np.arange(model.nv), robot.elastic)
    others = np.setdiff1d(movable, given)
    closing = _close(robot, robot.q_near, others) if len(given) and len(others) else None
    if closing is None or closing.worst > CLOSED:
        closing = _close(robot, robot.q_near, movable)
    at = frames_at(robot, closing.q[None])
    residual = np.abs(loop_equations(robot.rows, at).residual[0])
    if closing.worst > CLOSED:
        row = int(np.argmax(residual * np.where(robot.rows.rotation, robot.length, 1.0)))
        unit = "rad" if robot.rows.rotation[row] else "m"
        raise NotAssembled(
            f"{robot.name}: the loops do not close near the reference: {robot.rows.names[row]} stays "
            f"{residual[row]:.3g} {unit} apart after {closing.iterations} iterations; check the link "
            f"lengths and give a reference nearer to an assembled configuration",
            q=closing.q,
            residual=float(residual[row]),
        )
    turned = turned_over(robot, at)
    if turned is not None:
        raise NotAssembled(
            f"{robot.name}: near the reference the loops close only with {turned} turned over, its frames "
            f"pointing apart; give a reference nearer to an assembled configuration",
            q=closing.q,
            residual=float(residual.max()),
        )
    _check_near(robot, closing.q, float(residual.max()), given)
    x = platform_coordinates(robot, at)[0]
    return Configuration(closing.q, x, float(residual.max()), closing.iterations)


class _Closing(NamedTuple):
    q: Array  # (nq,)
    worst: float  # largest loop equation, in lengths of the robot and radians
    iterations: int


def _close(robot: ParallelRobot, start: Array, free: IntArray) -> _Closing:
    """Damped Newton steps of least norm of the columns `free` on all loop equations, from `start`."""
    rows, lengths = robot.rows, column_scale(robot)[free]
    weights = np.where(rows.rotation, 1.0, 1.0 / robot.length)

    def mismatch(q: Array) -> float:
        return float(np.linalg.norm(weights * loop_equations(rows, frames_at(robot, q)).residual[0]))

    q, iterations = start[None], 0
    now = mismatch(q)
    while iterations < 100 and now > 1e-15:
        iterations += 1
        loops = loop_equations(rows, frames_at(robot, q))
        jacobian = scaled(robot, loops.jacobian, rows)[0][:, free]
        joint = -np.linalg.lstsq(jacobian, weights * loops.residual[0], rcond=REDUNDANT)[0]
        step = np.zeros((1, robot.model.nv))
        step[0, free] = joint * min(1.0, LONGEST_STEP / max(np.abs(joint).max(), 1e-300)) * lengths
        fraction = 1.0
        while (after := mismatch(integrate(robot, q, fraction * step))) > now and fraction > 1e-4:
            fraction *= 0.5
        if after >= now:
            break
        q, now = integrate(robot, q, fraction * step), after
    worst = np.abs(weights * loop_equations(rows, frames_at(robot, q)).residual[0]).max()
    return _Closing(q[0], float(worst), iterations)


def _check_near(robot: ParallelRobot, q: Array, residual: float, given: list[int]) -> None:
    """Refuse an assembled configuration in which a joint is far from what the file gives."""
    moved = difference(robot, robot.q_near, q[None])[0]
    for column in sorted(given, key=lambda column: -abs(moved[column] / column_scale(robot)[column])):
        if abs(moved[column]) > FAR * column_scale(robot)[column]:
            value = robot.description.reference[robot.joint_of(column)]
            raise NotAssembled(
                f"{robot.name}: the reference is not near an assembled configuration: "
                f"{robot.joint_of(column)} is given as {value:g}, the loops close at "
                f"{value + moved[column]:.4g}; give all joints, so that one way of assembling is meant",
                q=q,
                residual=residual,
            )
        break


@lru_cache(maxsize=128)
def nearby_configurations(robot: ParallelRobot) -> tuple[Array, ...]:
    """Assembled configurations (nq,) about `NEARBY` from the reference, springs at rest; of a structure none.

    The reference moved along motions that its loops allow, drawn at random but always alike, and closed
    again. Memoised: a pure function of a frozen robot.
    """
    reference, joints = reference_configuration(robot).q, _joints(robot)
    values, right = np.linalg.svd(_loop_matrix(robot, reference)[:, joints])[1:]
    allowed = right[int(np.sum(values > CROSSED * values.max(initial=0.0))) :]
    random, lengths = np.random.default_rng(0), column_scale(robot)
    found: list[Array] = []
    ways: list[Array] = []
    for _ in range(DRAWN if len(allowed) > 1 else len(allowed)):
        motion = random.standard_normal(len(allowed)) @ allowed
        step = np.zeros((1, robot.model.nv))
        step[0, joints] = NEARBY * motion / np.abs(motion).max() * lengths[joints]
        closing = _close(robot, integrate(robot, reference[None], step)[0], joints)
        way = difference(robot, reference, closing.q[None])[0] / lengths
        size = float(np.linalg.norm(way))
        new = all(abs(way @ other) < SAME_WAY * size * np.linalg.norm(other) for other in ways)
        if closing.worst <= CLOSED and size > 0.1 * NEARBY and new:
            found.append(closing.q)
            ways.append(way)
        if len(found) == WAYS:
            break
    return tuple(found)


@lru_cache(maxsize=128)
def singular_reference(robot: ParallelRobot) -> SingularReference | None:
    """Why nothing can be decided at the reference once for all; None where it can.

    Which loop equations repeat others and which joints are idle is decided there. It is wrong everywhere
    else if the loops, or the loops and the platform along the passive joints, have a lower rank at the
    reference than nearby. Memoised: a pure function of a frozen robot.
    """
    here, joints = reference_configuration(robot).q, _joints(robot)
    nearby = nearby_configurations(robot)
    for q in nearby:
        rows = _lost_rows(_loop_matrix(robot, here)[:, joints], _loop_matrix(robot, q)[:, joints])
        columns = _lost_rows(_felt_matrix(robot, here).T, _felt_matrix(robot, q).T)
        if len(rows) or len(columns):
            lost = [robot.rows.names[k] for k in rows]
            still = [robot.joint_of(int(robot.passive[k])) for k in columns]
            poses = [_joint_angles(robot, other) for other in nearby]
            return SingularReference(robot.name, rows=lost, joints=still, poses=poses)
    return None


def _joint_angles(robot: ParallelRobot, q: Array) -> dict[str, float]:
    """Angles [rad, m] of all joints but springs at q (nq,)."""
    angles = difference(robot, np.asarray(pin.neutral(robot.model)), q[None])[0]
    return {robot.joint_of(int(column)): float(angles[column]) for column in _joints(robot)}


def _joints(robot: ParallelRobot) -> IntArray:
    """All columns but those of springs."""
    return np.setdiff1d(np.arange(robot.model.nv), robot.elastic)


def _loop_matrix(robot: ParallelRobot, q: Array) -> Array:
    """Jacobian (rows, nv) of all loop equations at q (nq,), without dimension."""
    return scaled(robot, loop_equations(robot.rows, frames_at(robot, q[None])).jacobian, robot.rows)[0]


def _felt_matrix(robot: ParallelRobot, q: Array) -> Array:
    """Jacobian (n + rows, n_p) of the platform and all loop equations along the passive joints at q (nq,)."""
    platform = scaled(robot, platform_jacobian(robot, frames_at(robot, q[None])), None)[0]
    return np.concatenate([platform, _loop_matrix(robot, q)])[:, robot.passive]


def _lost_rows(here: Array, nearby: Array) -> IntArray:
    """Rows that `nearby` has more in its rank than `here`, as independent of those of `here` as can be."""
    rank = _rank(nearby)
    if _rank(here, CROSSED) >= rank:
        return np.empty(0, dtype=np.intp)
    kept = _pivots(here)[: _rank(here, CROSSED)]
    span = np.linalg.qr(nearby[kept].T)[0]
    return np.sort(_pivots(nearby - nearby @ span @ span.T)[: rank - len(kept)])


def _rank(matrix: Array, level: float = REDUNDANT) -> int:
    """Number of singular values above `level` times the largest."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > level * values.max(initial=0.0)))


def _pivots(matrix: Array) -> IntArray:
    """Rows of a matrix, each the farthest from the span of those before it."""
    from scipy.linalg import qr

    return np.asarray(qr(matrix.T, mode="r", pivoting=True)[1])


def _check_reference(robot: ParallelRobot) -> None:
    singular = singular_reference(robot)
    if singular is not None:
        raise singular


@lru_cache(maxsize=128)
def independent_rows(robot: ParallelRobot) -> IntArray:
    """Ascending indices of loop equations that do not repeat others, found at the reference.

    A planar robot written in 3D closes its loop out of the plane for nothing; such rows are redundant
    everywhere. Found once, by rank-revealing QR on the joints (springs locked); a rank that drops in
    passing is a singularity and is the business of `singularity`. Memoised: a pure function of a frozen
    robot.

    Raises:
        SingularReference: the rank is higher nearby.
    """
    _check_reference(robot)
    return independent_at_reference(robot)


def independent_at_reference(robot: ParallelRobot) -> IntArray:
    """What `independent_rows` gives, whatever the rank is nearby."""
    return _independent(_loop_matrix(robot, reference_configuration(robot).q)[:, _joints(robot)])


def rows_of_springs_alone(robot: ParallelRobot) -> tuple[str, ...]:
    """Names of loop equations that springs can move and joints cannot, at the reference or nearby.

    No loop may rely on them.
    """
    kept = independent_rows(robot)
    for q in (reference_configuration(robot).q, *nearby_configurations(robot)) if robot.n_e else ():
        with_springs = _independent(_loop_matrix(robot, q))
        if len(with_springs) > len(kept):
            return tuple(robot.rows.names[row] for row in np.setdiff1d(with_springs, kept))
    return ()


def _independent(jacobian: Array) -> IntArray:
    """Ascending indices of rows that do not repeat others."""
    return np.sort(_pivots(jacobian)[: _rank(jacobian)])


@lru_cache(maxsize=128)
def idle_columns(robot: ParallelRobot) -> IntArray:
    """Passive joints to hold still because their motion moves nothing, such as a rod about its axis.

    Passive motions that neither the loops nor the platform feel at the reference; one joint of each is
    chosen by pivoting. They carry no load as long as the body that they turn is balanced about them;
    `dynamics.neglected` measures it.

    Raises:
        SingularReference: fewer are idle nearby.
    """
    _check_reference(robot)
    passive = _felt_matrix(robot, reference_configuration(robot).q)
    if not passive.shape[1]:
        return np.empty(0, dtype=np.intp)
    values, right = np.linalg.svd(passive)[1:]
    rank = int(np.sum(values > REDUNDANT * max(float(values[0]), 1.0)))
    order = _pivots(right[rank:].T) if rank < len(right) else np.empty(0, dtype=np.intp)
    return np.sort(robot.passive[order[: len(robot.passive) - rank]])


@lru_cache(maxsize=128)
def passive_columns(robot: ParallelRobot) -> IntArray:
    """The passive joints that follow the platform and the motors: all but the idle ones."""
    return np.setdiff1d(robot.passive, idle_columns(robot))


@lru_cache(maxsize=128)
def loop_rows(robot: ParallelRobot) -> LoopRows:
    """The table of the independent loop equations."""
    return robot.rows.take(independent_rows(robot))
