"""How near a robot is to a Type 2 singularity, and which twist t_s its motors cannot hold.

Type 2: the passive columns P of the independent loop equations lose rank, P eta = 0; with the motors
locked the passive joints may move along eta, and the platform along t_s. Its measure is that of
`bordering`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import UncontrolledMotions, point
from framework.kinematics.assembly import loop_rows, passive_columns
from framework.kinematics.closures import column_scale, scaled
from framework.kinematics.inverse_kinematics import System, moving_columns, reference_system
from framework.model import ParallelRobot

# What no law can cross, by kind: what the joints do there is not a function of the platform's path.
UNCROSSABLE = {
    "leg_passive": "a singularity inside a leg, whose passive joints then move without platform and motors",
    "constraint": "a constraint singularity: the platform gains freedoms that it has nowhere else",
    "closure": "a singularity of the loop equations themselves, whatever the motors do",
}
UNLIKE = 0.02  # a loop equation below this share of a unit motion, or above its inverse, is brought to it
VANISHED = 1e-7  # of a unit motion (radians, robot lengths): less does not count as moving


def passive_matrix(robot: ParallelRobot, system: System) -> Array:
    """P (T, m, n_p): passive columns of the independent loop equations, without dimension."""
    loops = scaled(robot, system.closures, loop_rows(robot)) / _row_sizes(robot)[:, None]
    return loops[:, :, passive_columns(robot)]


@lru_cache(maxsize=128)
def _row_sizes(robot: ParallelRobot) -> Array:
    """What makes the largest entry of each loop equation (m,) 1 at the reference, for rows far from that.

    An equation may be written in any unit, or as any multiple of itself: none of that is a singularity.
    """
    loops = scaled(robot, reference_system(robot).closures, loop_rows(robot))[0]
    sizes = np.abs(loops[:, moving_columns(robot)]).max(axis=1, initial=0.0)
    return np.where((sizes < UNLIKE) | (sizes > 1 / UNLIKE), np.maximum(sizes, 1e-300), 1.0)


def measured_matrix(robot: ParallelRobot, system: System) -> Array:
    """The square matrix (T, n_p, n_p) whose singularity is Type 2: P, or P'P with redundant motors.

    With more motors than degrees of freedom P has more rows than columns; it loses rank at isolated
    places at most, which P'P touches without crossing.
    """
    P = passive_matrix(robot, system)
    return P if P.shape[1] == P.shape[2] else P.transpose(0, 2, 1) @ P


def mobile_matrix(robot: ParallelRobot, system: System) -> Array:
    """The matrix (T, n + m, n + m) of the inverse kinematics, without dimension.

    Columns: actuated, then passive. Singular in Type 1 singularities, and where the loop equations lose rank.
    """
    loops = scaled(robot, system.closures, loop_rows(robot)) / _row_sizes(robot)[:, None]
    both = [scaled(robot, system.platform, None), loops]
    return np.concatenate(both, axis=1)[:, :, moving_columns(robot)]


def passive_motion(robot: ParallelRobot, eta: Array) -> Array:
    """Joint rates (..., nv) of dimensionless passive rates eta (..., n_p)."""
    motion = np.zeros((*eta.shape[:-1], robot.model.nv))
    columns = passive_columns(robot)
    motion[..., columns] = eta * column_scale(robot)[columns]
    return motion


class Uncontrolled(NamedTuple):
    """The motion that locked motors do not hold, at one configuration."""

    kind: str  # type_2, leg_passive, constraint or closure
    twist: Array  # (n,) t_s on the platform's axes, see `unit_twist`; zeros when it does not move
    motion: Array  # (nv,) joint rates that belong to the twist
    corank: int  # number of independent such motions


def uncontrolled_motion(robot: ParallelRobot, system: System) -> Uncontrolled:
    """Classify a singular configuration (a system of T = 1) and find its twist t_s.

    type_2: the platform moves along t_s. leg_passive: only passive joints inside a leg move. In the
    other two the loop equations themselves lose rank, whatever the motors do. constraint: the platform
    gains freedoms beyond its n (Zlatanov, Bonev and Gosselin 2002). closure: it does not, other bodies do.
    """
    P = passive_matrix(robot, system)[0]
    values, right = np.linalg.svd(P)[1:]
    corank = max(int(np.sum(values < VANISHED * max(values[0], 1.0))), 1)
    motion = passive_motion(robot, right[-1])
    six = system.frames.jacobian[0, 0] @ motion  # the whole twist of the platform
    size = np.concatenate([six[:3] / robot.length, six[3:]])
    twist = six[robot.platform_axes]
    freedoms = instantaneous_motions(robot, system)
    if freedoms.shape[1] > robot.n:
        moved = system.frames.jacobian[0, 0][:, moving_columns(robot)] @ freedoms
        moved[:3] /= robot.length
        rank = int(np.sum(np.linalg.svd(moved, compute_uv=False) > VANISHED))
        return Uncontrolled("constraint" if rank > robot.n else "closure", 0 * twist, motion, corank)
    if np.abs(size).max() < VANISHED:
        return Uncontrolled("leg_passive", 0 * twist, motion, corank)
    if np.abs(size[robot.platform_axes]).max() < VANISHED:
        return Uncontrolled("constraint", 0 * twist, motion, corank)
    scale = unit_twist(robot, twist)
    return Uncontrolled("type_2", twist / scale, motion / scale, corank)


def lost_equations(robot: ParallelRobot, system: System, level: float = VANISHED) -> int:
    """How many of the independent loop equations of one configuration (T = 1) hold nothing there.

    Counted by singular values below `level`, in radians and robot lengths.
    """
    loops = scaled(robot, system.closures, loop_rows(robot))[0][:, moving_columns(robot)]
    values = np.linalg.svd(loops, compute_uv=False)
    return int(np.sum(values < level * max(float(values.max(initial=0.0)), 1.0)))


def escaping(robot: ParallelRobot, s: float, x: Array, count: int, what: str) -> UncontrolledMotions:
    """The error to raise where `count` motions escape the motors at path coordinate s, platform x (n,)."""
    words = {1: "one uncontrolled motion", 2: "two uncontrolled motions at once"}
    return UncontrolledMotions(
        f"{robot.name}: {words.get(count, f'{count} uncontrolled motions at once')} at s = {s:.6g}, "
        f"{', '.join(robot.axis_names)} = {point(x)}: {what}",
        s=s,
        platform=x,
        count=count,
    )


def instantaneous_motions(robot: ParallelRobot, system: System) -> Array:
    """Joint rates (k, f) of the `moving_columns` that the loops of one configuration allow, springs at rest.

    An orthonormal basis, in radians and robot lengths, turned back to joint rates. f is the number of
    degrees of freedom, and more where the loop equations lose rank.
    """
    columns = moving_columns(robot)
    loops = scaled(robot, system.closures, loop_rows(robot))[0][:, columns]
    values, right = np.linalg.svd(loops)[1:]
    rank = int(np.sum(values > VANISHED * max(float(values[0]), 1.0)))
    return right[rank:].T * column_scale(robot)[columns][:, None]


def unit_twist(robot: ParallelRobot, twist: Array) -> float:
    """What to divide a twist (n,) by: its speed, or its turning rate where the point rests.

    Along a unit twist, t_s . W_p is a force [N] (a torque [N m] for a pure turn).
    """
    linear = np.linalg.norm(twist[robot.platform_axes < 3])
    angular = np.linalg.norm(twist[robot.platform_axes >= 3])
    return float(linear if linear > VANISHED * robot.length * angular else angular)


class SingularityMeasure(NamedTuple):
    """How a motion approaches and leaves a singularity, at T instants."""

    g: Array  # (T,) the smallest singular value of P with the sign of det P
    motion: Array  # (T, nv) the joint rates nearest to an uncontrolled motion, of unit size


def singularity_measure(robot: ParallelRobot, system: System) -> SingularityMeasure:
    """g and the least controlled motion along a motion, to look at.

    This g is continuous, with a bend where two singular values change places; the motion is continued
    but for such places. Roots are found on the smooth measures of `bordering`.
    """
    P = measured_matrix(robot, system)
    if not P.shape[2]:  # every joint has a motor: det P = 1, nothing escapes
        return SingularityMeasure(np.ones(len(P)), np.zeros((len(P), robot.model.nv)))
    _, values, right = np.linalg.svd(P)
    weakest = right[:, -1]
    turned = np.where(np.sum(weakest[1:] * weakest[:-1], axis=1) < 0, -1.0, 1.0)
    signs = np.cumprod(np.concatenate([[1.0], turned]))
    return SingularityMeasure(
        values[:, -1] * np.linalg.slogdet(P)[0], passive_motion(robot, weakest * signs[:, None])
    )
