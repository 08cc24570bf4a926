"""How near a robot is to a Type 2 singularity, and which twist t_s its motors cannot hold.

Type 2: the passive columns P of the independent loop equations lose rank, P eta = 0; with the motors
locked the passive joints may move along eta, and the platform along t_s. Its measure is that of
`bordered_system`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.kinematics.inverse_kinematics import System
from framework.kinematics.loop_matrices import (
    VANISHED,
    instantaneous_motions,
    measured_matrix,
    passive_matrix,
    passive_motion,
)
from framework.kinematics.parallel_robot import ParallelRobot

# What no law can cross, by kind: what the joints do there is not a function of the platform's path.
UNCROSSABLE = {
    "leg_passive": "a singularity inside a leg, whose passive joints then move without platform and motors",
    "constraint": "a constraint singularity: the platform gains freedoms that it has nowhere else",
    "closure": "a singularity of the loop equations themselves, whatever the motors do",
}

ORTHOGONAL = 1e-12  # cosine between t_s and a path that rounding makes


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
    twist = system.platform[0] @ motion
    freedoms = instantaneous_motions(robot, system)
    if freedoms.shape[1] > robot.n:
        moved = system.frames.jacobian[0, 0][:, robot.moving] @ freedoms
        moved[:3] /= robot.length
        rank = int(np.sum(np.linalg.svd(moved, compute_uv=False) > VANISHED))
        return Uncontrolled("constraint" if rank > robot.n else "closure", 0 * twist, motion, corank)
    if np.abs(size).max() < VANISHED:
        return Uncontrolled("leg_passive", 0 * twist, motion, corank)
    if np.abs(np.where(robot.translations, twist / robot.length, twist)).max() < VANISHED:
        return Uncontrolled("constraint", 0 * twist, motion, corank)
    scale = unit_twist(robot, twist)
    return Uncontrolled("type_2", twist / scale, motion / scale, corank)


def unit_twist(robot: ParallelRobot, twist: Array) -> float:
    """What to divide a twist (n,) by: its speed, or its turning rate where the point rests.

    Along a unit twist, t_s . W_p is a force [N] (a torque [N m] for a pure turn).
    """
    part = robot.translations if moves_point(robot, twist) else ~robot.translations
    return float(np.linalg.norm(twist[part]))


def moves_point(robot: ParallelRobot, twist: Array) -> bool:
    """Whether a twist (n,) moves the platform's point, or only turns the platform about it."""
    linear = np.linalg.norm(twist[robot.translations])
    angular = np.linalg.norm(twist[~robot.translations])
    return bool(linear > VANISHED * robot.length * angular)


def sign_along(twist: Array, direction: Array) -> float:
    """1 or -1, with which a twist (n,) points along a direction (n,).

    Where the two are orthogonal but for rounding, its largest component is made positive: the sign is then a
    matter of definition, and may not be one of rounding.
    """
    forward = float(twist @ direction)
    if abs(forward) <= ORTHOGONAL * np.linalg.norm(twist) * np.linalg.norm(direction):
        forward = float(twist[np.argmax(np.abs(twist))])
    return -1.0 if forward < 0 else 1.0


class SingularityMeasure(NamedTuple):
    """How a motion approaches and leaves a singularity, at T instants."""

    g: Array  # (T,) the smallest singular value of P with the sign of det P
    motion: Array  # (T, nv) the joint rates nearest to an uncontrolled motion, of unit size


def singularity_measure(robot: ParallelRobot, system: System) -> SingularityMeasure:
    """g and the least controlled motion along a motion, to look at.

    This g is continuous, with a bend where two singular values change places; the motion is continued
    but for such places. Roots are found on the smooth measures of `bordered_system`.
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
