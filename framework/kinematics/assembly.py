"""The assembled reference of a robot, and which of its loop equations are independent there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from framework.arrays import Array, IntArray
from framework.errors import NotAssembled
from framework.kinematics.closures import column_scale, loop_equations, scaled
from framework.kinematics.frames import frames_at, move
from framework.kinematics.platform import platform_coordinates, platform_jacobian
from framework.model import ParallelRobot
from framework.model.parallel_robot import LoopRows

# A row that others repeat, repeats them up to rounding; between that and a real one lie orders of
# magnitude. Relative to the largest row, in lengths of the robot.
REDUNDANT = 1e-9
CLOSED = 1e-12  # largest loop equation of a closed robot, in lengths of the robot and radians
LONGEST_STEP = 0.5  # [rad or lengths of the robot] that one Newton step may move a joint


@dataclass(frozen=True)
class Configuration:
    """A configuration whose loops are closed: holding one proves it.

    `q` (nq,), platform `x` (n,), largest loop equation `residual` [m or rad], Newton `iterations`.
    """

    q: Array
    x: Array
    residual: float
    iterations: int


@lru_cache(maxsize=128)
def reference_configuration(robot: ParallelRobot) -> Configuration:
    """The assembled configuration nearest to the robot file's `reference`, springs at rest.

    Damped Newton steps of least norm on all loop equations, redundant ones included. It decides the
    working and the assembly mode. Memoised: a pure function of a frozen robot.

    Raises:
        NotAssembled: the loops do not close from there; carries the last iterate and the residual.
    """
    rows = robot.rows
    weights = np.where(rows.rotation, 1.0, 1.0 / robot.length)
    free = np.setdiff1d(np.arange(robot.model.nv), robot.elastic)
    lengths = column_scale(robot)[free]

    def mismatch(q: Array) -> float:
        return float(np.linalg.norm(weights * loop_equations(rows, frames_at(robot, q)).residual[0]))

    q = robot.q_near[None]
    now, iterations = mismatch(q), 0
    while iterations < 100:
        iterations += 1
        loops = loop_equations(rows, frames_at(robot, q))
        jacobian = scaled(robot, loops.jacobian, rows)[0][:, free]
        residual = weights * loops.residual[0]
        step = np.zeros((1, robot.model.nv))
        joint = -np.linalg.lstsq(jacobian, residual, rcond=REDUNDANT)[0]
        step[0, free] = joint * min(1.0, LONGEST_STEP / max(np.abs(joint).max(), 1e-300)) * lengths
        fraction = 1.0
        while (after := mismatch(move(robot, q, fraction * step))) > now and fraction > 1e-4:
            fraction *= 0.5
        if after >= now:
            break
        q, now = move(robot, q, fraction * step), after
        if now < 1e-15:
            break
    at = frames_at(robot, q)
    loop = np.abs(loop_equations(rows, at).residual[0])
    worst = int(np.argmax(weights * loop))
    if weights[worst] * loop[worst] > CLOSED:
        unit = "rad" if rows.rotation[worst] else "m"
        raise NotAssembled(
            f"{robot.name}: the loops do not close near the reference: {rows.names[worst]} stays "
            f"{loop[worst]:.3g} {unit} apart after {iterations} iterations; check the link lengths "
            f"and give a reference nearer to an assembled configuration",
            q=q[0],
            residual=float(loop[worst]),
        )
    return Configuration(q[0], platform_coordinates(robot, at)[0], float(loop.max()), iterations)


@lru_cache(maxsize=128)
def independent_rows(robot: ParallelRobot) -> IntArray:
    """Ascending indices of loop equations that do not repeat others, found at the reference.

    A planar robot written in 3D closes its loop out of the plane for nothing; such rows are redundant
    everywhere. Found once, by rank-revealing QR; a rank that drops in passing is a singularity and is
    the business of `singularity`. Memoised: a pure function of a frozen robot.
    """
    from scipy.linalg import qr

    at = frames_at(robot, reference_configuration(robot).q[None])
    jacobian = scaled(robot, loop_equations(robot.rows, at).jacobian, robot.rows)[0]
    _, upper, order = qr(jacobian.T, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > REDUNDANT * diagonal[0]))
    return np.sort(order[:rank])


@lru_cache(maxsize=128)
def idle_columns(robot: ParallelRobot) -> IntArray:
    """Passive joints to hold still because their motion moves nothing, such as a rod about its axis.

    Passive motions that neither the loops nor the platform feel at the reference; one joint of each is
    chosen by pivoting. They carry no load as long as the body that they turn is balanced about them.
    """
    from scipy.linalg import qr

    at = frames_at(robot, reference_configuration(robot).q[None])
    loops = scaled(robot, loop_equations(robot.rows, at).jacobian, robot.rows)[0]
    felt = np.concatenate([scaled(robot, platform_jacobian(robot, at), None)[0], loops])
    passive = felt[:, robot.passive]
    if not passive.shape[1]:
        return np.empty(0, dtype=np.intp)
    values, right = np.linalg.svd(passive)[1:]
    rank = int(np.sum(values > REDUNDANT * max(float(values[0]), 1.0)))
    order = qr(right[rank:], mode="r", pivoting=True)[1]
    return np.sort(robot.passive[order[: len(robot.passive) - rank]])


@lru_cache(maxsize=128)
def passive_columns(robot: ParallelRobot) -> IntArray:
    """The passive joints that follow the platform and the motors: all but the idle ones."""
    return np.setdiff1d(robot.passive, idle_columns(robot))


@lru_cache(maxsize=128)
def loop_rows(robot: ParallelRobot) -> LoopRows:
    """The table of the independent loop equations."""
    return robot.rows.take(independent_rows(robot))
