"""The measure of a Type 2 singularity, and the twist t_s that the motors do not hold.

At a Type 2 singularity the passive columns P of the independent loop equations lose rank, P eta = 0. With
locked motors the passive joints can move at the rates eta, and the platform along t_s.

The smooth measure g of a square P is the scalar of `bordered_system`. With the border (b, c) of P,
P eta + b g = 0, c' eta = 1 and psi' P + g c' = 0, psi' b = 1. So the gradient of g is dg = -psi' dP eta
(Govaerts 2000, section 3.3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.closures import loop_force_changes
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    moving_loops,
    passive_matrix,
    passive_motion,
    type2_matrix,
)
from framework.kinematics.loop_structure import null_directions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import ball_columns
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import cross, least_singular_values, singular_values
from framework.singularity.bordered_system import Border, solve_bordered
from framework.tolerances import RANK_LOST, RANK_ROUNDING

# Kinds that no law can cross, because the platform's path does not determine the motion of the joints there.
UNCROSSABLE = {
    "leg_passive": "a singularity inside a leg, whose passive joints then move without platform and motors",
    "constraint": "a constraint singularity: the platform gains freedoms that it has nowhere else",
    "closure": "a singularity of the loop equations themselves, whatever the motors do",
}


class Uncontrolled(NamedTuple):
    """A motion that the loops allow with locked motors, at one configuration."""

    kind: str  # type_2, leg_passive, constraint or closure
    twist: Array  # (n,) unit twist t_s on the platform's axes, see `twist_norm`; zeros if kind is not type_2
    motion: Array  # (nv,) joint rates of the twist
    corank: int  # number of independent motions with locked motors


def uncontrolled_motion(robot: ParallelRobot, linearised: LinearisedLoops) -> Uncontrolled:
    """Classify a singular configuration (T = 1) and find its twist t_s.

    type_2: the platform moves along t_s. leg_passive: only passive joints inside a leg move. constraint: the
    platform gains freedoms beyond its n (Zlatanov, Bonev and Gosselin 2002). closure: the loop equations lose
    rank, whatever the motors do, and only other bodies gain freedoms. Of several kinds the first in
    `PRECEDENCE` is returned; `classify` lists all of them, and decides whether the configuration is singular
    at all.
    """
    space = uncontrolled_space(robot, linearised, at_least=1)
    kind = min(space.kinds, key=PRECEDENCE.index)
    twists = space.motions @ linearised.platform[0].T  # (corank, n)
    twist, motion = twists[-1], space.motions[-1]  # those of the least singular value
    if kind != "type_2":
        return Uncontrolled(kind, np.zeros_like(twist), motion, space.corank)
    # of several motions the platform may rest in this one, and move in another
    if space.corank > 1 and _count_rank(twist[None]) == 0:
        k = np.argmax(np.linalg.norm(twists, axis=1))
        twist, motion = twists[k], space.motions[k]
    scale = twist_norm(robot, twist)
    return Uncontrolled(kind, twist / scale, motion / scale, space.corank)


# Of several kinds `uncontrolled_motion` returns the first: no law can cross closure and constraint.
PRECEDENCE = ("closure", "constraint", "type_2", "leg_passive")


class UncontrolledSpace(NamedTuple):
    """All motions that the loops allow with locked motors, at one configuration."""

    kinds: frozenset[str]  # of PRECEDENCE
    motions: Array  # (c, nv) independent joint rates, those of the least singular value last
    freedoms: int  # instantaneous freedoms with motors free; more than usual where the loops lose rank

    @property
    def corank(self) -> int:
        """The number c of these motions."""
        return len(self.motions)


def uncontrolled_space(
    robot: ParallelRobot, linearised: LinearisedLoops, *, at_least: int = 0
) -> UncontrolledSpace:
    """Compute the motions with locked motors, the null space of P (T = 1), and their kinds.

    Args:
        at_least: least number of motions to return, even if their singular values are not small.
    """
    P = passive_matrix(robot, linearised)[0]
    null_vectors = null_directions(P, at_least=min(at_least, P.shape[1]))  # (c, n_p) dimensionless rates
    corank = len(null_vectors)  # c
    motions = passive_motion(robot, null_vectors)  # (c, nv)
    # (f, moving) rates that the loops allow with motors free, orthonormal in radians and robot lengths
    freedoms = null_directions(moving_loops(robot, linearised)[0])
    # freedoms beyond the usual number, that of moving joints minus that of independent loop equations
    gained = len(freedoms) - (len(robot.moving) - len(robot.loops.names))
    twists = linearised.frames.frame_jacobian()[0].T.copy()  # (nv, 6) of the platform for unit joint rates
    twists[:, :3] /= robot.length  # linear velocities in lengths of the robot

    # number of independent motions of the platform: in all directions, and along its axes
    rank = _count_rank(motions @ twists)
    on_axes = linearised.platform[0] / robot.platform_scale[:, None]  # (n, nv) dimensionless
    rank_on_axes = _count_rank(motions @ on_axes.T)

    kinds = set()
    if gained > 0:  # the loops have lost rank
        units = robot.column_scale[robot.moving]
        gains_freedom = _count_rank(freedoms * units @ twists[robot.moving]) > robot.n  # of the platform
        kinds.add("constraint" if gains_freedom else "closure")
    elif rank > rank_on_axes:  # the platform leaves its axes
        kinds.add("constraint")
    if corank > gained:  # more motions are uncontrolled than the loops have gained
        # of the motions gained, those of a closure singularity do not move the platform
        gained_by_platform = 0 if "closure" in kinds else gained
        if rank_on_axes > gained_by_platform:
            kinds.add("type_2")
        if corank > max(rank, gained):  # the platform rests in some motions
            kinds.add("leg_passive")
    return UncontrolledSpace(frozenset(kinds), motions, len(freedoms))


def _count_rank(rows: Array) -> int:
    """Count the singular values of dimensionless rows (k, n) above RANK_LOST; that of one row is its norm."""
    values = np.linalg.norm(rows, axis=1) if len(rows) == 1 else singular_values(rows)
    return int((values > RANK_LOST).sum())


def twist_norm(robot: ParallelRobot, twist: Array) -> float:
    """Return the speed of the platform's point in a twist (n,), or the turning rate if the point rests.

    With the unit twist t_s, t_s . W_p is a force [N], or a torque [N m] if t_s is a pure turn.
    """
    part = robot.translations if moves_point(robot, twist) else ~robot.translations
    return float(np.linalg.norm(twist[part]))


def moves_point(robot: ParallelRobot, twist: Array) -> bool:
    """Return whether a twist (n,) moves the platform's point, not only turns about the point."""
    linear = np.linalg.norm(twist[robot.translations])
    angular = np.linalg.norm(twist[~robot.translations])
    return bool(linear > RANK_LOST * robot.length * angular)


def sign_along(twist: Array, direction: Array) -> float:
    """Return the sign, 1 or -1, that turns a twist (n,) along a direction (n,).

    If the two are orthogonal up to rounding, the sign makes the largest component of the twist positive.
    """
    forward = twist @ direction
    if abs(forward) <= RANK_ROUNDING * np.linalg.norm(twist) * np.linalg.norm(direction):
        forward = twist[np.argmax(np.abs(twist))]
    return -1.0 if forward < 0 else 1.0


def has_signed_measure(robot: ParallelRobot) -> bool:
    """Return whether g has a sign, with passive joints and no redundant motors."""
    return robot.n_p > 0 and robot.n_a == robot.n


def signed_measure(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the g (T,) of `singularity_measure` alone, in half of the time."""
    P = type2_matrix(robot, linearised)
    if not P.shape[2]:  # every joint has a motor: det P = 1, no motion is uncontrolled
        return np.ones(len(P))
    return np.asarray(least_singular_values(P) * np.linalg.slogdet(P).sign)


class SingularityMeasure(NamedTuple):
    """The measure g and the uncontrolled motion, or what comes nearest, at T configurations."""

    g: Array  # (T,) the smallest singular value of P with the sign of det P
    motion: Array  # (T, nv) joint rates with locked motors that open the loops least, of unit size


def singularity_measure(robot: ParallelRobot, linearised: LinearisedLoops) -> SingularityMeasure:
    """Compute g (T,) and the uncontrolled motion (T, nv) at successive configurations, for figures.

    Where no motion is uncontrolled, it is the one with locked motors that opens the loops least.

    g and the motion are continuous, except that g has a kink and the motion jumps where the two least
    singular values are equal. So roots are found on the smooth measures of `bordered_system` instead.
    """
    P = type2_matrix(robot, linearised)
    if not P.shape[2]:  # every joint has a motor: det P = 1, no motion is uncontrolled
        return SingularityMeasure(np.ones(len(P)), np.zeros((len(P), robot.nv)))
    _, values, V_rows = np.linalg.svd(P)
    eta = V_rows[:, -1]  # (T, n_p) right singular vectors of the least values, with arbitrary signs

    # give eta signs that are continuous from one configuration to the next
    cosines = np.sum(eta[1:] * eta[:-1], axis=1)  # (T - 1,) between successive configurations
    flips = np.where(cosines < 0, -1.0, 1.0)
    eta[1:] *= np.cumprod(flips)[:, None]

    g = values[:, -1] * np.linalg.slogdet(P).sign
    return SingularityMeasure(g, passive_motion(robot, eta))


class MeasureGradient(NamedTuple):
    """The bordered block G of a square P and its gradient, at T configurations; g is its first entry."""

    G: Array  # (T, size, size)
    eta: Array  # (T, n_p) dimensionless passive rates closest to an uncontrolled motion, c' eta = 1
    G_by_q: Array  # (T, size, size, nv) dG/dq [1/rad, 1/m]


def measure_gradient(
    robot: ParallelRobot, linearised: LinearisedLoops, border: Border | None = None
) -> MeasureGradient:
    """Compute G and dG/dq (T, size, size, nv) at configurations with a square P.

    With the loop forces f = J' psi at constant multipliers, -dG/dq_j = psi' (dP/dq_j) eta = sum of eta_i
    df_i/dq_j, of any columns psi and eta. Derivatives of psi . F along two joints may be exchanged, so this
    is df_j along eta: one motion instead of one for each joint. Only turns about two axes of a ball do not
    commute, which adds eta x f.

    Args:
        border: b and c, (n_p, size) for all or (T, n_p, size); by default each configuration has that of its
            P, of size 1.
    """
    P = passive_matrix(robot, linearised)
    border = Border.of(P) if border is None else border
    solution = solve_bordered(P, border)
    transposed_border = Border(border.c, border.b, border.values)
    psi = solve_bordered(P.swapaxes(1, 2), transposed_border).eta  # (T, n_p, size)
    units = robot.loop_lengths * robot.structure.row_sizes  # of the loop equations
    motions = passive_motion(robot, solution.eta.swapaxes(1, 2))  # (T, size, nv)
    wrenches = linearised.wrenches[:, robot.n :]
    balls = ball_columns(robot.model)  # (b, 3)
    rows = list[Array]()  # (T, size, nv) each, of one column psi
    for multipliers in np.moveaxis(psi, 2, 0) / units:
        forces = linearised.frames, wrenches, linearised.spread(multipliers)
        changes = loop_force_changes(robot, robot.spanning_loops, *forces, motions)  # of f along each eta
        if len(balls):
            f = np.vecmat(multipliers, linearised.closures)[:, None]  # (T, 1, nv)
            changes[..., balls] += cross(motions[..., balls], f[..., balls])
        rows.append(-changes)
    return MeasureGradient(solution.G, solution.eta[:, :, 0], np.stack(rows, axis=1))
