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

from framework.arrays import Array, BoolArray, select
from framework.errors import InvalidInput
from framework.kinematics.frames import FrameStack, frames_at, integrate_columns
from framework.kinematics.loop_matrices import equation_sizes
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import cross
from framework.proofs.equation_terms import BASE, Chain, EquationTerms, Term, moving_balls, stretched_length
from framework.proofs.rounding import ROUND_UP
from framework.tolerances import FRAME_ROUNDING


class _ChainDerivatives(NamedTuple):
    """The derivatives of one chain at S configurations."""

    turning: Array  # (S, L, 3) w_j, of the second frame as seen from the first; 0 of slides
    point: Array  # (S, L, 3) u_j
    bent: Array  # (S, L, L, 3) d2p
    offset: Array  # (S, 3) from the first frame's origin to the second one's
    lever: Array  # (S, L) |u_j|


@dataclass(frozen=True, eq=False)
class DerivativeBounds:
    """The equations of a robot in its `moving` joints: a table made once."""

    robot: ParallelRobot
    chains: list[Chain]
    terms: list[Term]
    row_scale: Array  # (R,)
    column_scale: Array  # (k,)
    rounding: float  # of values and derivatives at one configuration, without dimension

    @staticmethod
    def of(robot: ParallelRobot, *, reach: float = 1.0) -> DerivativeBounds:
        """Make the table of a robot, for slides within `reach` robot lengths of the reference.

        Raises:
            InvalidInput: a ball joint moves: its coordinates do not turn about axes one after the other; or
                joints are coupled.
        """
        if robot.rows.has_couplings:
            raise InvalidInput(
                f"{robot.name}: bounds over boxes of joints are for loops of frames, not for "
                f"couplings of joints"
            )
        balls = moving_balls(robot)
        if balls:
            raise InvalidInput(
                f"{robot.name}: bounds over boxes of joints are for hinges and slides, not for "
                f"the ball joint {balls[0]}"
            )
        slid = max(reach, 1.0) * np.count_nonzero(robot.sliding[robot.moving])
        size = stretched_length(robot, robot.reference.q) + 1.0 + float(slid)
        table = EquationTerms.of(robot)
        return DerivativeBounds(
            robot,
            table.chains,
            table.terms,
            1.0 / equation_sizes(robot),
            robot.column_scale[robot.moving],
            FRAME_ROUNDING * size / robot.structure.row_sizes.min(initial=1.0),
        )

    def configurations(self, u: Array) -> Array:
        """Return the configurations (S, nq) at offsets u (S, k) [rad, lengths] from the reference."""
        return integrate_columns(self.robot, self.robot.reference.q, self.robot.moving, u * self.column_scale)

    def evaluate(self, q: Array) -> Derivatives:
        """Evaluate the equations and their derivatives at q (S, nq)."""
        frames = frames_at(self.robot, q)
        derivatives = [_derivatives(chain, frames) for chain in self.chains]
        scale = self.row_scale[:, None] * self.column_scale  # (R, k)
        values, slopes = np.zeros((len(q), len(scale))), np.zeros((len(q), *scale.shape))
        hessians = np.zeros((len(q), *scale.shape, scale.shape[1]))
        for term in self.terms:
            row, joints = term.row, self.chains[term.chain].places
            if term.kind == "joint":
                slopes[:, row, term.selected] = 1.0 / self.column_scale[term.selected] / self.row_scale[row]
                continue
            value, first, second = _term(term, self.chains[term.chain], derivatives[term.chain], frames)
            values[:, row] += value
            slopes[:, row, joints] += first
            hessians[:, row, joints[:, None], joints] += second
        values[:, self.robot.n :] -= self.robot.loops.constant
        return Derivatives(
            self,
            frames,
            values * self.row_scale,
            slopes * scale,
            hessians * scale[:, :, None] * self.column_scale,
            derivatives,
        )


class Derivatives(NamedTuple):
    """Values and derivatives of the R equations at the middles of S boxes; the loops have their values."""

    bounds: DerivativeBounds
    frames: FrameStack
    values: Array  # (S, R) of the loops; those of the platform are not what its coordinates are
    slopes: Array  # (S, R, k)
    hessians: Array  # (S, R, k, k)
    derivatives: list[_ChainDerivatives]  # of each chain

    def take(self, which: BoolArray) -> Derivatives:
        """Return the derivatives in the boxes `which` of the S."""
        return Derivatives(
            self.bounds,
            self.frames.select(np.flatnonzero(which)),
            self.values[which],
            self.slopes[which],
            self.hessians[which],
            [select(own, which) for own in self.derivatives],
        )

    def remainders(self, radii: Array) -> Remainders:
        """Bound the change of values and derivatives within radii (S, k) of the middle."""
        thirds, rounding = self._third_bounds(radii * self.bounds.column_scale), self.bounds.rounding
        hessians = np.abs(self.hessians) + rounding
        slopes = np.einsum("srij,sj->sri", hessians + 0.5 * thirds, radii)
        values = np.einsum("srij,si,sj->sr", 0.5 * hessians + thirds / 6, radii, radii, optimize=True)
        widening = rounding * (1 + radii.sum(axis=1, keepdims=True))
        return Remainders(ROUND_UP * (values + widening), ROUND_UP * slopes + rounding, thirds + rounding)

    def _third_bounds(self, radii: Array) -> Array:
        """Bound the third derivatives (S, R, k, k), times the radii (S, k) of the third joint."""
        bounds, thirds = self.bounds, np.zeros_like(self.hessians)
        for term in bounds.terms:
            if term.kind != "joint":
                chain, derivative = bounds.chains[term.chain], self.derivatives[term.chain]
                r = radii[:, chain.places]
                third = _thirds(term, chain, derivative, _widen_levers(chain, derivative, r), r)
                thirds[:, term.row, chain.places[:, None], chain.places] += third
        scale = bounds.row_scale[:, None] * bounds.column_scale
        return thirds * (ROUND_UP * scale[:, :, None] * bounds.column_scale)


class Remainders(NamedTuple):
    """Bounds over S boxes, rounding and all."""

    values: Array  # (S, R) of the exact values against values + slopes d
    slopes: Array  # (S, R, k) of the exact slopes against those computed at the middle
    hessians: Array  # (S, R, k, k)


def _derivatives(chain: Chain, frames: FrameStack) -> _ChainDerivatives:
    """Compute the derivatives of one chain."""
    screws = frames.screws[:, chain.columns] * chain.signs[:, None]
    turning = screws[..., 3:]
    point = screws[..., :3] + cross(turning, frames.position[:, chain.second, None])
    bent = cross(turning[:, chain.inner], point[:, chain.outer])
    origin = 0.0 if chain.first == BASE else frames.position[:, chain.first]
    lever = np.linalg.norm(point, axis=2)
    return _ChainDerivatives(turning, point, bent, frames.position[:, chain.second] - origin, lever)


def _term(
    term: Term, chain: Chain, derivative: _ChainDerivatives, frames: FrameStack
) -> tuple[Array, Array, Array]:
    """Compute the value (S,), slopes (S, L) and their derivatives (S, L, L)."""
    S, f = len(derivative.offset), term.factor
    vector, moved, bent = derivative.offset, derivative.point, derivative.bent
    if term.kind == "square":
        axis, f = vector, 2.0 * f
    elif chain.first == BASE:
        axis = np.broadcast_to(np.eye(3)[term.axis], (S, 3))
    else:
        axis = frames.rotation[:, chain.first, :, term.axis]
    if term.kind == "turn":  # axis . the part of R(q) R(middle)' that is not symmetric: 0 at the middle
        vector, moved = np.zeros((S, 3)), derivative.turning
        bent = 0.5 * cross(moved[:, chain.inner], moved[:, chain.outer])
    if term.kind == "direction":
        vector = frames.rotation[:, chain.second, :, term.selected]
        moved = cross(derivative.turning, vector[:, None])
        bent = cross(derivative.turning[:, chain.inner], moved[:, chain.outer])
    value, first = np.einsum("sc,sc->s", axis, vector), np.einsum("sc,sjc->sj", axis, moved)
    second = np.einsum("sc,sijc->sij", axis, bent)
    if term.kind == "square":
        value, second = 0.5 * value, second + np.einsum("sic,sjc->sij", moved, moved)
    return f * value, f * first, f * second


def _widen_levers(chain: Chain, derivative: _ChainDerivatives, r: Array) -> Array:
    """Bound the levers (S, L) over a box: joints behind move the point."""
    lever, reach = derivative.lever.copy(), np.zeros(len(r))
    for j in reversed(range(len(chain.places))):
        if chain.turns[j]:
            lever[:, j] += reach
        reach = ROUND_UP * (reach + r[:, j] * lever[:, j])
    return lever


def _thirds(term: Term, chain: Chain, derivative: _ChainDerivatives, lever: Array, r: Array) -> Array:
    """Bound the third derivatives (S, L, L), times the radii of the third joint."""
    number, turns = np.arange(len(chain.places)), chain.turns
    i, j, k = number[:, None, None], number[:, None], number
    inner, outer = np.minimum(np.minimum(i, j), k), np.maximum(np.maximum(i, j), k)
    middle = i + j + k - inner - outer
    f = abs(term.factor)
    if term.kind in ("direction", "turn"):
        return f * np.einsum("ijk,sk->sij", (turns[i] & turns[j] & turns[k]).astype(float), r)
    is_bent = turns[inner] & turns[middle] & (turns[outer] | (outer != middle))
    if term.kind == "point":
        return f * np.einsum("sijk,sk->sij", lever[:, outer] * is_bent, r)
    first, last = chain.inner, chain.outer
    bent = lever[:, last] * (turns[first] & (turns[last] | (first != last)))
    mixed = lever[:, :, None, None] * bent[:, None]
    mixed = mixed + mixed.transpose(0, 2, 1, 3) + mixed.transpose(0, 2, 3, 1)
    far = np.linalg.norm(derivative.offset, axis=1) + np.sum(lever * r, axis=1)
    f *= 2.0
    return f * np.einsum("sijk,sk->sij", mixed + far[:, None, None, None] * (lever[:, outer] * is_bent), r)
