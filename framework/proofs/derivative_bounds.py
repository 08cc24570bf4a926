"""Platform and loop equations with first and second derivatives along the joints, bounded over boxes.

A loop equation is a product of vectors that turn with the joints: an axis e of one frame, and a point p of
another. Let joint j turn about the unit vector w_j through the point o_j. For joints in the order h, i, j
along the chain from the first frame to the second (equal ones allowed),

    dp/dq_j = u_j = w_j x (p - o_j),    d2p/dq_i dq_j = w_i x u_j,    |d3p/dq_h dq_i dq_j| <= |u_j|.

If joint j slides, u_j is its direction. If joint h or i slides, the higher derivatives are zero. The lever of
joint j is |u_j|. Over a box it grows by at most the distance by which the joints between j and the second
frame can move p. Neither the slopes at the middle of a box nor the bounds on their change therefore need the
sine of an interval.

All quantities are in radians and robot lengths, as in `linearised_loops`. A closure that locks all three
translations is written on the axes of the base. At closed loops these equations are equivalent, and no second
derivative mixes joints of its two chains. Pinocchio's results at the middle of a box are trusted up to
`DerivativeBounds.rounding`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.frames import FrameStack, frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import JointPlatform
from framework.numerics.arrays import Array, IntArray, select
from framework.numerics.ordered_sums import cross
from framework.proofs.equation_terms import (
    BASE,
    Chain,
    Ends,
    Term,
    chain_between,
    collect_terms,
    list_unbounded_joints,
    stretched_length,
)
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import ROUND_UP
from framework.tolerances import FRAME_ROUNDING


class _ChainDerivatives(NamedTuple):
    """The vector p from the first to the second frame of a chain of L joints, at S configurations."""

    turn_axes: Array  # (S, L, 3) w_j of the second frame relative to the first; 0 of slides
    p: Array  # (S, 3)
    u: Array  # (S, L, 3) first derivatives of p
    seconds: Array  # (S, L, L, 3) second derivatives of p


@dataclass(frozen=True, eq=False)
class DerivativeBounds:
    """R equations of platform and loops in k unknown joints, with their scales.

    An equation is linear in joints, or the sum of its terms less a constant is zero.
    """

    robot: ParallelRobot
    origin: Array  # (nq,) configuration with the offsets zero
    unknowns: IntArray  # (k,) columns of the unknown joints in the velocity vector
    terms: list[Term]  # of the equations; none for a platform whose coordinates are joints
    linear: Array  # (R, k) slopes of equations without terms; 0 for all others
    constants: Array  # (R,) that are subtracted from the sums of terms
    row_scale: Array  # (R,) reciprocal of the unit of each equation
    rounding: float  # bound on the error of values and derivatives at one configuration, dimensionless

    @staticmethod
    def of(robot: ParallelRobot, *, reach: float = 1.0) -> DerivativeBounds:
        """Collect the equations of a robot, for slides within `reach` robot lengths.

        Where no m loop equations imply the others in all poses, those independent at the reference are taken.
        If they have full rank, all have; but their root need not close the others.

        Raises:
            InvalidInput: joints are coupled, or a ball joint moves.
        """
        robot = robot.with_fixed_rows(robot.structure.independent)
        excluded = list_unbounded_joints(robot)
        if excluded:
            raise InvalidInput(
                f"{robot.name}: bounds over boxes of joints are for loops of hinges and slides, not for "
                f"{excluded[0]}"
            )
        # Rounding of positions grows with the largest length [robot lengths]: all links in one line, all
        # slides extended by at least one robot length, and one more to spare.
        max_slide = max(reach, 1.0) * np.count_nonzero(robot.sliding[robot.moving])
        max_length = stretched_length(robot, robot.reference.q) + 1.0 + max_slide
        equations = robot.n + len(robot.loops.names)
        linear = np.zeros((equations, len(robot.moving)))  # 1 where the row's coordinate is the joint
        if isinstance(robot.platform, JointPlatform):
            linear[: robot.n] = robot.moving == robot.platform.columns[:, None]
        return DerivativeBounds(
            robot=robot,
            origin=robot.reference.q,
            unknowns=robot.moving,
            terms=collect_terms(robot),
            linear=linear,
            constants=np.append(np.zeros(robot.n), robot.loops.constant),  # none in platform equations
            row_scale=1.0 / robot.equation_sizes,
            rounding=FRAME_ROUNDING * max_length / robot.structure.row_sizes.min(initial=1.0),
        )

    @cached_property
    def chains(self) -> dict[Ends, Chain]:
        """Chains of the terms."""
        return {term.ends: chain_between(self.robot, term.ends, self.unknowns) for term in self.terms}

    @property
    def column_scale(self) -> Array:
        """Units (k,) of the joints."""
        return self.robot.column_scale[self.unknowns]

    @property
    def scale(self) -> Array:
        """Factors (R, k) that make slopes dimensionless."""
        return self.row_scale[:, None] * self.column_scale

    def configurations(self, u: Array) -> Array:
        """Return configurations (S, nq) offset from `origin` by u (S, k) [rad, robot lengths]."""
        return integrate_columns(self.robot, self.origin, self.unknowns, u * self.column_scale)

    def enclose(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the R equations in boxes of middles and radii (S, k) [rad, robot lengths]."""
        derivatives = self.evaluate(self.configurations(middle))
        errors = derivatives.remainders(radii).values
        return LinearEnclosure(derivatives.values, derivatives.slopes, errors)

    def evaluate(self, q: Array) -> Derivatives:
        """Evaluate the R equations, Jacobians and Hessians along k joints at q (S, nq).

        Each term contributes to one row, along the joints of one chain. All results are dimensionless: rows
        are divided by their units, columns multiplied by the units of the joints.
        """
        frames = frames_at(self.robot, q)
        chains = {ends: _differentiate_chain(chain, frames) for ends, chain in self.chains.items()}

        # sum the terms, in m and rad; `scale` (R, k) makes slopes dimensionless afterwards
        scale = self.scale
        values = np.tile(-self.constants, (len(q), 1))
        slopes = np.tile(self.linear, (len(q), 1, 1))
        hessians = np.zeros((*slopes.shape, len(self.unknowns)))
        for term in self.terms:
            chain = self.chains[term.ends]
            value, first, second = _differentiate_term(term, chain, chains[term.ends], frames)
            values[:, term.row] += value
            slopes[:, term.row, chain.unknowns] += first
            hessians[:, term.row, chain.unknowns[:, None], chain.unknowns] += second  # all pairs of joints
        hessians *= scale[:, :, None] * self.column_scale
        return Derivatives(self, frames, values * self.row_scale, slopes * scale, hessians, chains)


class Derivatives(NamedTuple):
    """Values and derivatives of the R equations at the middles of S boxes."""

    bounds: DerivativeBounds  # of the equations
    frames: FrameStack  # at the middles
    values: Array  # (S, R) loop residuals; the platform's rows are not the values of its coordinates
    slopes: Array  # (S, R, k) first derivatives along the joints
    hessians: Array  # (S, R, k, k) second derivatives
    chains: dict[Ends, _ChainDerivatives]  # of the vectors in the terms

    def take(self, boxes: IntArray) -> Derivatives:
        """Return the derivatives in some of the boxes, by index (b,)."""
        return Derivatives(
            self.bounds,
            self.frames.select(boxes),
            self.values[boxes],
            self.slopes[boxes],
            self.hessians[boxes],
            {ends: select(chain, boxes) for ends, chain in self.chains.items()},
        )

    def remainders(self, radii: Array) -> Remainders:
        """Bound the errors of Taylor's formula within radii r (S, k) of the middles.

        Let |H| be the moduli of the second derivatives at the middle, and T a bound on the third derivatives.
        At an offset d, |d| <= r, the exact values differ from values + slopes d by at most |H| r r / 2 + T r
        r r / 6, the exact slopes from `slopes` by at most |H| r + T r r / 2, and the exact second derivatives
        from `hessians` by at most T r. The rounding of values, slopes and `hessians` is added.
        """
        rounding = self.bounds.rounding
        # T r (S, R, k, k), the sum of |d3F / dq_i dq_j dq_l| r_l over the joints l and the terms of F
        thirds = np.zeros_like(self.hessians)
        with_units = radii * self.bounds.column_scale  # (S, k) [rad, m]
        for term in self.bounds.terms:
            chain = self.bounds.chains[term.ends]
            bound = _bound_thirds(term, chain, self.chains[term.ends], with_units[:, chain.unknowns])
            # the joints of the chain are some of the k unknowns: add to all pairs (i, j) of them
            thirds[:, term.row, chain.unknowns[:, None], chain.unknowns] += bound
        # terms are in m and rad: divide by the unit of the equation, multiply by the units of q_i and q_j
        thirds *= ROUND_UP * self.bounds.scale[:, :, None] * self.bounds.column_scale
        H_sizes = np.abs(self.hessians)
        H_sizes += rounding  # |H|
        by_H, by_T = (np.matvec(matrices, radii[:, None]) for matrices in (H_sizes, thirds))  # (S, R, k)
        slope_errors = by_H + 0.5 * by_T
        value_errors = np.matvec(0.5 * by_H + by_T / 6, radii)
        value_errors += rounding * (1 + radii.sum(axis=1, keepdims=True))  # of values + slopes d
        thirds += rounding
        return Remainders(
            values=ROUND_UP * value_errors, slopes=ROUND_UP * slope_errors + rounding, hessians=thirds
        )


class Remainders(NamedTuple):
    """Bounds on the errors of Taylor's formula over S boxes, rounding included."""

    values: Array  # (S, R) exact values against values + slopes d
    slopes: Array  # (S, R, k) exact slopes against those computed at the middle
    hessians: Array  # (S, R, k, k) exact second derivatives against those computed at the middle


def _differentiate_chain(chain: Chain, frames: FrameStack) -> _ChainDerivatives:
    """Compute the derivatives of one chain from the frames of S configurations.

    The point p has the first derivatives u_j = w_j x (p - o_j) and the second derivatives w_i x u_j, for i
    before j on the chain or i = j.
    """
    first, second = chain.ends
    # A joint that carries the first frame moves the second one backwards relative to it (sign -1). A screw is
    # the velocity at the base's origin and the turn axis, for a unit rate of the joint.
    screws = frames.screws[:, chain.columns] * chain.signs[:, None]  # (S, L, 6) at the base's origin
    turn_axes = screws[..., 3:]
    point = frames.position[:, second]
    u = screws[..., :3] + cross(turn_axes, point[:, None])
    p = point if first == BASE else point - frames.position[:, first]
    return _ChainDerivatives(turn_axes, p, u, _second_derivatives(chain, turn_axes, u))


def _second_derivatives(chain: Chain, turn_axes: Array, first: Array) -> Array:
    """Compute second derivatives w_i x first_j (S, L, L, 3) of a vector with first derivatives (S, L, 3).

    Of two joints of the chain the inner one, i, is nearer to the chain's first frame. It turns the derivative
    along the outer joint j. `turn_axes` (S, L, 3) are the axes w of the L joints, 0 of slides. The result is
    symmetric in i and j.
    """
    inner, outer = chain.joint_tuples(2)
    return cross(turn_axes[:, inner], first[:, outer])


def _term_vector(
    term: Term, chain: Chain, derivatives: _ChainDerivatives, frames: FrameStack
) -> tuple[Array, Array, Array]:
    """Return the vector (S, 3) of a term, with two derivatives.

    The first derivatives (S, L, 3) and second derivatives (S, L, L, 3) are along the joints. For a term of
    the kind "direction" the vector is an axis of the second frame, for "turn" the axial vector of the
    antisymmetric part of R(q) R(middle)', which is zero at the middle, and for "point" and "square" it is p.
    The chain has the L joints between the frames of the term, and `derivatives` are those of its p.
    """
    turn_axes, p, u, seconds = derivatives  # u and `seconds` are the derivatives of p
    if term.kind == "direction":
        axis = frames.rotation[:, term.ends[1], :, term.second_axis]
        slopes = cross(turn_axes, axis[:, None])
        return axis, slopes, _second_derivatives(chain, turn_axes, slopes)
    if term.kind == "turn":
        # [w_i]x [w_j]x has the antisymmetric part [w_i x w_j]x / 2
        return np.zeros_like(p), turn_axes, 0.5 * _second_derivatives(chain, turn_axes, turn_axes)
    return p, u, seconds


def _differentiate_term(
    term: Term, chain: Chain, derivatives: _ChainDerivatives, frames: FrameStack
) -> tuple[Array, Array, Array]:
    """Compute the value (S,), slopes (S, L) and second derivatives (S, L, L) of a term.

    A term is factor * axis . vector, with an axis of the first frame or of the base, or it is the square
    factor * p . p. The derivatives of a chain are relative to the first frame, so its axis counts as fixed.
    The square has the slopes 2 factor p . u_j and the second derivatives 2 factor (p . d2p + u_i . u_j).
    Arguments are those of `_term_vector`, at S configurations.
    """
    vector, first, second = _term_vector(term, chain, derivatives, frames)
    is_square = term.kind == "square"
    if is_square:
        axis = vector
    elif term.ends[0] == BASE:
        axis = np.broadcast_to(np.eye(3)[term.first_axis], vector.shape)
    else:
        axis = frames.rotation[:, term.ends[0], :, term.first_axis]

    value = np.einsum("sc,sc->s", axis, vector)
    slopes = np.einsum("sc,sjc->sj", axis, first)  # axis . u_j
    seconds = np.einsum("sc,sijc->sij", axis, second)  # axis . d2p_ij
    factor = term.factor
    if is_square:
        factor *= 2.0  # of the derivatives, not of the value
        seconds += np.einsum("sic,sjc->sij", first, first)  # u_i . u_j
    return term.factor * value, factor * slopes, factor * seconds


def _bound_levers(chain: Chain, lever: Array, radii: Array) -> Array:
    """Bound the levers (S, L) over boxes of radii (S, L), given each `lever` (S, L) at the middles.

    The chain has L joints. The lever of a joint is the size |u_j| of the derivative of the point along it. A
    joint moves the point by at most radius * lever. The levers of all hinges before it on the chain grow by
    no more than this; levers of slides are constant.
    """
    widened = lever.copy()
    travel = np.zeros(len(radii))  # of the point, due to joint j and the joints after it
    for j in reversed(range(len(chain.turns))):
        if chain.turns[j]:
            widened[:, j] += travel
        travel = ROUND_UP * (travel + radii[:, j] * widened[:, j])
    return widened


def _bound_thirds(term: Term, chain: Chain, derivatives: _ChainDerivatives, radii: Array) -> Array:
    """Bound sum_k |d3 term_ijk| r_k (S, L, L) over boxes of radii r (S, L) [rad, m].

    i, j and k are three of the L joints between the frames of the term. The lever of a joint is the speed of
    the point p for a unit rate of the joint. |d3p| is at most the lever of the outermost of the three joints
    if the two others turn, else 0. A direction moves like a point on which every hinge has the lever 1, and
    every slide the lever 0. `derivatives` are those of p at the middles.
    """
    turns = chain.turns
    if term.kind in ("direction", "turn"):
        lever = turns[None].astype(float)  # (1, L)
    else:
        lever = _bound_levers(chain, np.linalg.norm(derivatives.u, axis=2), radii)  # (S, L)
    inner, middle, outer = chain.joint_tuples(3)  # (L, L, L) each
    third_sizes = lever[:, outer] * (turns[inner] & turns[middle])  # (S, L, L, L) bounds of |d3p|
    thirds = np.einsum("sijk,sk->sij", third_sizes, radii)
    if term.kind == "square":
        distance = np.linalg.norm(derivatives.p, axis=1)  # |p| at the middle
        thirds = _bound_square_thirds(chain, lever, distance, thirds, radii)
    return abs(term.factor) * thirds


def _bound_square_thirds(chain: Chain, lever: Array, distance: Array, thirds: Array, radii: Array) -> Array:
    """Bound sum_k |d3(p . p)_ijk| r_k (S, L, L) over boxes of radii r (S, L), by the product rule.

    d3(p . p)_ijk = 2 (u_i . d2p_jk + u_j . d2p_ik + u_k . d2p_ij + p . d3p_ijk). The first derivative |u_j|
    is at most the lever of j. The second derivative |d2p_ij| is at most the lever of the outer joint if the
    inner joint turns, else 0.

    Args:
        chain: the L joints, of which `turns` marks the hinges.
        lever: (S, L) within the boxes.
        distance: |p| (S,) at the middles.
        thirds: bounds (S, L, L) of sum_k |d3p_ijk| r_k.
    """
    inner, outer = chain.joint_tuples(2)
    seconds = lever[:, outer] * chain.turns[inner]  # (S, L, L) of |d2p_ij|
    mixed = lever[:, :, None] * np.matvec(seconds, radii)[:, None]  # sum_k |u_i| |d2p_jk| r_k
    travel = np.sum(lever * radii, axis=1)[:, None, None]  # sum_k |u_k| r_k of p in the box
    largest_distance = distance[:, None, None] + travel
    return 2.0 * (mixed + mixed.swapaxes(1, 2) + travel * seconds + largest_distance * thirds)
