"""The measure of a Type 2 singularity, and the twist t_s that the motors cannot hold.

Type 2: the passive columns P of the independent loop equations lose rank, P eta = 0; with the motors
locked the passive joints may move along eta, and the platform along t_s. Its measure is that of
`bordered_system`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.loop_matrices import (
    instantaneous_motions,
    passive_matrix,
    passive_motion,
    type2_matrix,
)
from framework.kinematics.loop_structure import null_directions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import RANK_LOST

# What no law can cross, by kind: what the joints do there is not a function of the platform's path.
UNCROSSABLE = {
    "leg_passive": "a singularity inside a leg, whose passive joints then move without platform and motors",
    "constraint": "a constraint singularity: the platform gains freedoms that it has nowhere else",
    "closure": "a singularity of the loop equations themselves, whatever the motors do",
}

COSINE_ROUNDING = 1e-12  # cosine between t_s and a path that rounding makes


class Uncontrolled(NamedTuple):
    """The motion that the loops allow with locked motors, at one configuration."""

    kind: str  # type_2, leg_passive, constraint or closure
    twist: Array  # (n,) t_s on the platform's axes, see `twist_norm`; zeros when it does not move
    motion: Array  # (nv,) joint rates that belong to the twist
    corank: int  # number of independent such motions


def uncontrolled_motion(robot: ParallelRobot, linearised: LinearisedLoops) -> Uncontrolled:
    """Classify a singular configuration (T = 1) and find its twist t_s.

    type_2: the platform moves along t_s. leg_passive: only passive joints inside a leg move. In the
    other two the loop equations themselves lose rank, whatever the motors do. constraint: the platform
    gains freedoms beyond its n (Zlatanov, Bonev and Gosselin 2002). closure: it does not, other bodies do.
    `classify` names all kinds of a configuration, and says whether it is singular at all.
    """
    escaping = escaping_motions(robot, linearised, at_least=1)
    kind = next(kind for kind in PRECEDENCE if kind in escaping.kinds)
    twists = escaping.motions @ linearised.platform[0].T  # (corank, n)
    motion, twist = escaping.motions[-1], twists[-1]
    if kind != "type_2":
        return Uncontrolled(kind, 0 * twist, motion, escaping.corank)
    if _count_rank(twists[-1:]) == 0:  # this motion rests the platform, another one moves it
        strongest = int(np.argmax(np.linalg.norm(twists, axis=1)))
        motion, twist = escaping.motions[strongest], twists[strongest]
    scale = twist_norm(robot, twist)
    return Uncontrolled(kind, twist / scale, motion / scale, escaping.corank)


def least_controlled_motion(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute the unit twist (n,) and joint rates (nv,) least controlled.

    T is 1. On a Type 2 singularity of corank 1 they are those of `uncontrolled_motion`.
    """
    P = passive_matrix(robot, linearised)[0]
    motion = passive_motion(robot, np.linalg.svd(P)[2][-1])
    twist = linearised.platform[0] @ motion
    scale = twist_norm(robot, twist)
    return twist / scale, motion / scale


# Where several kinds meet, what no law can cross comes first.
PRECEDENCE = ("closure", "constraint", "type_2", "leg_passive")


class EscapingMotions(NamedTuple):
    """All motions that the loops allow with locked motors, at one configuration."""

    kinds: frozenset[str]  # of PRECEDENCE
    motions: Array  # (c, nv) independent joint rates, that of the least singular value last
    corank: int  # c, at least `at_least`
    freedoms: int  # instantaneous ones of the loops, motors free; more than usual where the loops lose rank


def escaping_motions(
    robot: ParallelRobot, linearised: LinearisedLoops, *, at_least: int = 0
) -> EscapingMotions:
    """Compute the motions with locked motors and the kinds of singularity.

    The motions are the null space of P (T = 1).

    Args:
        at_least: number of motions that count however large their singular values are.
    """
    P = passive_matrix(robot, linearised)[0]
    lost = null_directions(P, at_least=at_least) if P.shape[1] else np.zeros((0, 0))
    motions = passive_motion(robot, lost)  # (c, nv) the null space of P
    freedoms = instantaneous_motions(robot, linearised)  # (moving, f) of the loops, motors free
    gained = freedoms.shape[1] - (len(robot.moving) - len(robot.loops.names))
    twists = _platform_twists(robot, linearised)  # (nv, 6)
    # independent escaping motions of the platform: in all directions, and along its axes
    rank = _count_rank(motions @ twists)
    rank_on_axes = _count_rank(motions @ (linearised.platform[0] / robot.platform_scale[:, None]).T)
    kinds = set()
    if gained > 0:  # the loops have lost rank
        moves_platform = _count_rank(freedoms.T @ twists[robot.moving]) > robot.n
        kinds.add("constraint" if moves_platform else "closure")
    elif rank > rank_on_axes:  # the platform leaves its axes
        kinds.add("constraint")
    if len(lost) > gained:  # motions escape beyond those of loops that lost rank
        if rank_on_axes > (0 if "closure" in kinds else gained):
            kinds.add("type_2")
        if len(lost) > max(rank, gained):  # some motions rest the platform
            kinds.add("leg_passive")
    return EscapingMotions(frozenset(kinds), motions, len(lost), freedoms.shape[1])


def _platform_twists(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Return the platform's twist (nv, 6) for unit rates of each joint (T = 1) [robot lengths, rad]."""
    twists = linearised.frames.frame_jacobian(0)[0].T.copy()
    twists[:, :3] /= robot.length
    return twists


def _count_rank(rows: Array) -> int:
    """Count the singular values of dimensionless rows (k, n) above RANK_LOST."""
    return int(np.sum(singular_values(rows) > RANK_LOST)) if rows.size else 0


def twist_norm(robot: ParallelRobot, twist: Array) -> float:
    """Return the speed of a twist (n,), or its turning rate.

    The latter is taken where the platform's point rests. Along a unit twist, t_s . W_p is a force [N] (a
    torque [N m] for a pure turn).
    """
    part = robot.translations if moves_point(robot, twist) else ~robot.translations
    return float(np.linalg.norm(twist[part]))


def moves_point(robot: ParallelRobot, twist: Array) -> bool:
    """Whether a twist (n,) moves the platform's point; else the platform turns about the point."""
    linear = np.linalg.norm(twist[robot.translations])
    angular = np.linalg.norm(twist[~robot.translations])
    return bool(linear > RANK_LOST * robot.length * angular)


def sign_along(twist: Array, direction: Array) -> float:
    """Return the sign, 1 or -1, that turns a twist (n,) along a direction (n,).

    Where the two are orthogonal but for rounding, its largest component is made positive: the sign is then a
    matter of definition, and may not be one of rounding.
    """
    forward = float(twist @ direction)
    if abs(forward) <= COSINE_ROUNDING * np.linalg.norm(twist) * np.linalg.norm(direction):
        forward = float(twist[np.argmax(np.abs(twist))])
    return -1.0 if forward < 0 else 1.0


def has_signed_measure(robot: ParallelRobot) -> bool:
    """Whether the measure g of a robot has a sign.

    It needs passive joints and no redundant motors.
    """
    return len(robot.following) > 0 and robot.n_a == robot.n


class SingularityMeasure(NamedTuple):
    """The measure g and the least controlled motion, at T configurations."""

    g: Array  # (T,) the smallest singular value of P with the sign of det P
    motion: Array  # (T, nv) the joint rates nearest to an uncontrolled motion, of unit size


def singularity_measure(robot: ParallelRobot, linearised: LinearisedLoops) -> SingularityMeasure:
    """Compute g (T,) and the least controlled motion (T, nv) at successive configurations, for figures.

    This g is continuous, with a kink where the two least singular values are equal. The sign of the motion is
    continuous except there. Roots are found on the smooth measures of `bordered_system`.
    """
    P = type2_matrix(robot, linearised)
    if not P.shape[2]:  # every joint has a motor: det P = 1, nothing escapes
        return SingularityMeasure(np.ones(len(P)), np.zeros((len(P), robot.nv)))
    _, values, right = np.linalg.svd(P)
    weakest = right[:, -1]  # (T, n_p) right singular vectors of the least values
    cosines = np.sum(weakest[1:] * weakest[:-1], axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(cosines < 0, -1.0, 1.0)]))
    return SingularityMeasure(
        g=values[:, -1] * np.linalg.slogdet(P)[0],
        motion=passive_motion(robot, weakest * signs[:, None]),
    )
