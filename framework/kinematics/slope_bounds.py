"""Platform and loops as functions of the joints, with their first and second derivatives, bounded over boxes.

A loop equation is made of vectors that turn: the axis e of a frame, and the point p of another one. Along
the chain of joints from the one to the other, i not behind j,

    dp/dq_j = u_j = w_j x (p - o_j),    d2p/dq_i dq_j = w_i x u_j,    |d3p/dq_h dq_i dq_j| <= |u_j|

for joints that turn about w at o; for a slide u_j is its direction, and a slide before the last joint makes
them zero. |u_j| is the lever of joint j; over a box it grows by what the joints behind it may move p. So
slopes at the middle, and how they change over a box, need no interval of a sine.

All is in radians and lengths of the robot, as `loop_matrices`. A point of a closure that holds all three
translations is taken on the axes of the base, where the joints of the two chains do not mix: the same
equations at closed loops. What pinocchio computes at the middle of a box is trusted to `rounding`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.errors import InvalidInput
from framework.kinematics.frames import FrameStack, between, cross, frames_at, integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.slope_table import BASE, Chain, SlopeTable, Term, moving_balls
from framework.linalg.krawczyk import UP

ROUNDING = 1e-13  # of positions and directions, in lengths of all links: a thousand units of rounding


class _Derivatives(NamedTuple):
    """Of one chain at S configurations."""

    turning: Array  # (S, L, 3) w_j, of the second frame as seen from the first; 0 of slides
    point: Array  # (S, L, 3) u_j
    bent: Array  # (S, L, L, 3) d2p
    way: Array  # (S, 3) from the first frame's origin to the second one's
    lever: Array  # (S, L) |u_j|


@dataclass(frozen=True, eq=False)
class SlopeBounds:
    """The equations of a robot in its `moving` joints: a table made once."""

    robot: ParallelRobot
    chains: tuple[Chain, ...]
    terms: tuple[Term, ...]
    row_scale: Array  # (R,)
    column_scale: Array  # (k,)
    rounding: float  # of values and derivatives at one configuration, without dimension

    @staticmethod
    def of(robot: ParallelRobot, *, reach: float = 1.0) -> SlopeBounds:
        """The table of a robot; slides are trusted within `reach` lengths of the robot from the reference.

        Raises:
            InvalidInput: a ball joint moves: its coordinates do not turn about axes one after the other.
        """
        balls = moving_balls(robot)
        if balls:
            raise InvalidInput(
                f"{robot.name}: bounds over boxes of joints are for hinges and slides, not for "
                f"the ball joint {balls[0]}"
            )
        loops = robot.loops
        turning = np.concatenate([~robot.translations, loops.rotation])
        sizes = np.concatenate([np.ones(robot.n), robot.row_sizes])
        links = sum(float(np.linalg.norm(placement.translation)) for placement in robot.model.jointPlacements)
        links += sum(float(np.linalg.norm(robot.model.frames[k].placement.translation)) for k in robot.frames)
        links += float(np.abs(between(robot, robot.neutral, robot.reference.q)[robot.sliding]).sum())
        slid = max(reach, 1.0) * np.count_nonzero(robot.sliding[robot.moving])
        size = links / robot.length + 1.0 + float(slid)
        table = SlopeTable.of(robot)
        return SlopeBounds(
            robot,
            tuple(table.chains),
            tuple(table.terms),
            np.where(turning, 1.0, 1.0 / robot.length) / sizes,
            robot.column_scale[robot.moving],
            ROUNDING * size / min(float(sizes.min()), 1.0),
        )

    def moved(self, u: Array) -> Array:
        """Configurations (S, nq) that are off the reference by u (S, k) [rad, lengths]."""
        step = np.zeros((len(u), self.robot.model.nv))
        step[:, self.robot.moving] = u * self.column_scale
        return integrate(self.robot, np.repeat(self.robot.reference.q[None], len(u), axis=0), step)

    def at(self, q: Array) -> Linearised:
        """The equations at q (S, nq)."""
        robot, at = self.robot, frames_at(self.robot, q)
        derivatives = [_derivatives(chain, at) for chain in self.chains]
        S, R, k = len(q), len(self.row_scale), len(self.column_scale)
        values, slopes, seconds = np.zeros((S, R)), np.zeros((S, R, k)), np.zeros((S, R, k, k))
        for term in self.terms:
            chain, own = self.chains[term.chain], derivatives[term.chain]
            places, row = chain.places, term.row
            if term.kind == "joint":
                slopes[:, row, term.other] = 1.0 / self.column_scale[term.other] / self.row_scale[row]
                continue
            value, first, second = _term(term, chain, own, at)
            values[:, row] += value
            slopes[:, row, places] += first
            seconds[:, row, places[:, None], places] += second
        distance = robot.loops.distance
        values[:, robot.n :][:, distance] -= 0.5 * robot.loops.length[distance]
        scale = self.row_scale[:, None] * self.column_scale
        return Linearised(
            self,
            at,
            values * self.row_scale,
            slopes * scale,
            seconds * scale[:, :, None] * self.column_scale,
            derivatives,
        )


@dataclass(frozen=True, eq=False)
class Linearised:
    """Values and derivatives of the R equations at the middles of S boxes; the loops have their values."""

    bounds: SlopeBounds
    frames: FrameStack
    values: Array  # (S, R) of the loops; those of the platform are not what its coordinates are
    slopes: Array  # (S, R, k)
    seconds: Array  # (S, R, k, k)
    derivatives: list[_Derivatives]  # of each chain

    def take(self, which: BoolArray | IntArray) -> Linearised:
        """Some of the boxes."""
        at = self.frames
        return Linearised(
            self.bounds,
            FrameStack(at.position[which], at.rotation[which], at.screws[which], at.carried, at.q[which]),
            self.values[which],
            self.slopes[which],
            self.seconds[which],
            [_Derivatives(*(part[which] for part in own)) for own in self.derivatives],
        )

    def changes(self, radii: Array) -> Changes:
        """How far all this can be from what it is at the middle within radii (S, k)."""
        S, R, k = self.slopes.shape
        bounds, way = self.bounds, radii * self.bounds.column_scale
        thirds = np.zeros((S, R, k, k))
        widened = [
            _widened(chain, own, way[:, chain.places])
            for chain, own in zip(bounds.chains, self.derivatives, strict=True)
        ]
        for term in bounds.terms:
            chain = bounds.chains[term.chain]
            if term.kind != "joint":
                r = way[:, chain.places]
                own = _thirds(term, chain, self.derivatives[term.chain], widened[term.chain], r)
                thirds[:, term.row, chain.places[:, None], chain.places] += own
        scale = bounds.row_scale[:, None] * bounds.column_scale
        thirds *= UP * scale[:, :, None] * bounds.column_scale
        rounding, seconds = bounds.rounding, np.abs(self.seconds) + bounds.rounding
        slopes = np.einsum("srij,sj->sri", seconds + 0.5 * thirds, radii)
        values = np.einsum("srij,si,sj->sr", 0.5 * seconds + thirds / 6, radii, radii, optimize=True)
        more = rounding * (1 + radii.sum(axis=1, keepdims=True))
        return Changes(UP * (values + more), UP * slopes + rounding, thirds + rounding)


class Changes(NamedTuple):
    """Bounds over S boxes, rounding and all."""

    values: Array  # (S, R) of the exact ones there against values + slopes d
    slopes: Array  # (S, R, k) of the exact ones there against those computed at the middle
    seconds: Array  # (S, R, k, k)


def _derivatives(chain: Chain, at: FrameStack) -> _Derivatives:
    screws = at.screws[:, chain.columns] * chain.signs[:, None]
    turning = screws[..., 3:]
    point = screws[..., :3] + cross(turning, at.position[:, chain.second, None])
    own = np.arange(len(chain.places))
    inner = np.minimum(own[:, None], own)
    bent = cross(turning[:, inner], point[:, chain.outer])
    origin = 0.0 if chain.first == BASE else at.position[:, chain.first]
    lever = np.linalg.norm(point, axis=2)
    return _Derivatives(turning, point, bent, at.position[:, chain.second] - origin, lever)


def _term(term: Term, chain: Chain, own: _Derivatives, at: FrameStack) -> tuple[Array, Array, Array]:
    """Value (S,), slopes (S, L) and their derivatives (S, L, L)."""
    S = len(own.way)
    if chain.first == BASE:
        axis = np.broadcast_to(np.eye(3)[term.axis], (S, 3))
    else:
        axis = at.rotation[:, chain.first, :, term.axis]
    f = term.factor
    if term.kind == "point":
        return (
            f * np.einsum("sc,sc->s", axis, own.way),
            f * np.einsum("sc,sjc->sj", axis, own.point),
            f * np.einsum("sc,sijc->sij", axis, own.bent),
        )
    if term.kind == "distance":
        first = np.einsum("sc,sjc->sj", own.way, own.point)
        second = np.einsum("sic,sjc->sij", own.point, own.point)
        second = second + np.einsum("sc,sijc->sij", own.way, own.bent)
        return 0.5 * f * np.einsum("sc,sc->s", own.way, own.way), f * first, f * second
    if term.kind == "turn":  # axis . the part of R(q) R(middle)' that is not symmetric: 0 at the middle
        number = np.arange(len(chain.places))
        inner = np.minimum(number[:, None], number)
        swept = 0.5 * cross(own.turning[:, inner], own.turning[:, chain.outer])
        second = np.einsum("sc,sijc->sij", axis, swept)
        return np.zeros(S), np.einsum("sc,sjc->sj", axis, own.turning), second
    carried = at.rotation[:, chain.second, :, term.other]
    own_turn = cross(own.turning, carried[:, None])
    number = np.arange(len(chain.places))
    bent = cross(own.turning[:, np.minimum(number[:, None], number)], own_turn[:, chain.outer])
    return (
        f * np.einsum("sc,sc->s", axis, carried),
        f * np.einsum("sc,sjc->sj", axis, own_turn),
        f * np.einsum("sc,sijc->sij", axis, bent),
    )


def _widened(chain: Chain, own: _Derivatives, r: Array) -> Array:
    """The levers (S, L) over a box: joints behind move the point."""
    lever, reach = own.lever.copy(), np.zeros(len(r))
    for j in reversed(range(len(chain.places))):
        if chain.turns[j]:
            lever[:, j] += reach
        reach = UP * (reach + r[:, j] * lever[:, j])
    return lever


def _thirds(term: Term, chain: Chain, own: _Derivatives, lever: Array, r: Array) -> Array:
    """Bounds (S, L, L) on the third derivatives, times the radii of the third joint."""
    number, turns = np.arange(len(chain.places)), chain.turns
    i, j, k = number[:, None, None], number[:, None], number
    inner, outer = np.minimum(np.minimum(i, j), k), np.maximum(np.maximum(i, j), k)
    middle = i + j + k - inner - outer
    f = abs(term.factor)
    if term.kind in ("direction", "turn"):
        return f * np.einsum("ijk,sk->sij", (turns[i] & turns[j] & turns[k]).astype(float), r)
    moved = turns[inner] & turns[middle] & (turns[outer] | (outer != middle))
    if term.kind == "point":
        return f * np.einsum("sijk,sk->sij", lever[:, outer] * moved, r)
    first, last = np.minimum(i, j)[:, :, 0], chain.outer
    bent = lever[:, last] * (turns[first] & (turns[last] | (first != last)))
    mixed = lever[:, :, None, None] * bent[:, None]
    mixed = mixed + mixed.transpose(0, 2, 1, 3) + mixed.transpose(0, 2, 3, 1)
    far = np.linalg.norm(own.way, axis=1) + np.sum(lever * r, axis=1)
    return f * np.einsum("sijk,sk->sij", mixed + far[:, None, None, None] * (lever[:, outer] * moved), r)
