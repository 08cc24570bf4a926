"""Proof that the joints of a leg have no other solutions: their angles are paved (`completeness`).

The equations are those of loops whose joints are the leg's or given, and of the platform's place and
attitude. Their second derivatives are bounded along chains of joints. A joint enters a loop equation once, by
its cosine and sine or its length, when the loop is seen from one of its frames. So along the chain from the
carried point the bound is, for two hinges, the lesser of their distances from the point, links stretched out;
for a hinge and a slide, one; for two slides, zero. These bounds hold in boxes of any width, where those of
`derivative_bounds` are sharp in small ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import cross
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.completeness import KnownSolutions, has_no_others
from framework.proofs.equation_terms import BASE, joints_between
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import REACH_MARGIN
from framework.tolerances import FRAME_ROUNDING, LOOP_GAP

MAX_JOINTS = 4
INITIAL_PARTS = 2  # of a whole turn
SLIDE_SLOPE_ROUNDING = 1e-9  # of the unit by which translations change with a slide
RANDOM_SEED = 5


def are_leg_solutions_complete(
    robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, candidates: Array, x: Array | None
) -> bool:
    """Return whether a leg provably has no other solutions than the candidates.

    False if not decided.

    Args:
        own: (k,) columns of the velocity vector of the leg's joints.
        fixed: (nv,) mask of columns that keep their values in q (nq,). Where x has turns, q is assembled at
            x: the attitude is taken from there.
        candidates: (c, k) offsets of the joints from q [rad, robot lengths]; those that solve the equations
            are the known solutions.
        x: (n,) coordinates of the platform; None with locked motors.
    """
    platform = robot.platform
    if x is not None and isinstance(platform, JointPlatform):  # its joints are at x, as if they were fixed
        is_platform = np.isin(own, platform.columns)
        own, candidates = own[~is_platform], candidates[:, ~is_platform]
        fixed = fixed | np.isin(np.arange(robot.model.nv), platform.columns)
        q = q.copy()
        q[platform.places] = x
        x = None
    if not len(own):
        return len(candidates) > 0
    if not _is_paveable(robot, own):
        return False
    equations = LegEquations.of(robot, own, fixed, q, x)
    points_alone = np.zeros_like(candidates)  # radii of the boxes about the candidates
    values = equations(candidates, points_alone).values
    region = _joint_region(equations) if values.shape[1] else None
    if region is None:
        return False
    points = candidates[np.abs(values).max(axis=1) < LOOP_GAP]
    period = np.where(robot.sliding[own], np.inf, 2 * np.pi)
    return has_no_others(equations, region, KnownSolutions.of(equations, points, period))


def _is_paveable(robot: ParallelRobot, own: IntArray) -> bool:
    """Return whether joints (k,) are few, no balls and not coupled, with one slide at most."""
    has_few_joints = len(own) <= MAX_JOINTS and int(np.count_nonzero(robot.sliding[own])) <= 1
    has_balls = not single_columns(robot.model).issuperset(own.tolist())
    return has_few_joints and not has_balls and not robot.rows.has_couplings


def _joint_region(equations: LegEquations) -> Boxes | None:
    """Return boxes of all hinge turns and all slide lengths that can close.

    A whole turn of each hinge is cut in INITIAL_PARTS. A slide reaches from its zero as far as the chain can
    close; None without a bound on that.
    """
    robot = equations.robot
    own = equations.own
    is_slide = robot.sliding[own]
    half_width = np.pi / INITIAL_PARTS
    turns = np.arange(-np.pi + half_width, np.pi, 2 * half_width)
    axes = [turns] * int((~is_slide).sum())  # middles along each joint
    radii = np.full(len(own), half_width)
    if is_slide.any():
        farthest = equations.bound_slide()
        if farthest is None:
            return None
        zero = -equations.slide_lengths(equations.q)[own[is_slide]] / robot.length  # off q
        axes.insert(int(np.argmax(is_slide)), zero)
        radii[is_slide] = farthest
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(own))
    return Boxes(middles, np.repeat(radii[None], len(middles), axis=0))


@dataclass(frozen=True, eq=False)
class LegEquations:
    """The equations of a leg in its own n joints, all others fixed.

    Joints are offsets [rad, robot lengths] from q.
    """

    robot: ParallelRobot
    own: IntArray  # (n,) columns of the velocity vector
    q: Array  # (nq,)
    x: Array | None  # (platform coordinates,) where the leg and fixed joints alone carry the platform
    loops: IntArray  # of `robot.rows`
    chains: tuple[LeverChain, ...]  # of the loops, then of the platform's frame if its position counts
    chain_of: IntArray  # (loops,)
    attitude: Array | None  # (3, 3) of the platform's frame, where x determines it

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, x: Array | None) -> LegEquations:
        """Collect the equations whose joints are the leg's, or fixed.

        A loop row counts if a joint of the leg moves it and no free joint does; the platform's coordinates x
        alike. They determine the attitude of its frame if they have all turns: three, in a plane one.
        """
        carried = scratch_of(robot).carried
        rows = robot.rows
        platform = robot.platform
        free_joints = ~fixed
        free_joints[own] = False
        moves_row = carried[rows.second] != carried[rows.first]  # (rows, nv)
        loops = np.flatnonzero(moves_row[:, own].any(axis=1) & ~moves_row[:, free_joints].any(axis=1))
        ends = np.stack([rows.first[loops], rows.second[loops]], axis=1)
        pairs, chain_of = np.unique(ends, axis=0, return_inverse=True)
        chains = [LeverChain.of(robot, own, *pair) for pair in pairs.tolist()]
        is_determined = carried[0, own].any() and not carried[0, free_joints].any()
        attitude = None
        if not (isinstance(platform, FramePlatform) and is_determined):
            x = None
        elif x is not None:
            chains.append(LeverChain.of(robot, own, BASE, 0))
            if len(platform.turning) == (3 if planar_normal(robot) is None else 1):
                attitude = frames_at(robot, q[None]).rotation[0, 0]
        return LegEquations(robot, own, q, x, loops, tuple(chains), chain_of, attitude)

    def __call__(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the equations in boxes (B, n): loops, then platform.

        Slopes are along joints in radians and robot lengths.
        """
        robot = self.robot
        own = self.own
        frames = frames_at(robot, integrate_columns(robot, self.q, own, middle * robot.column_scale[own]))
        slid = np.abs(self.slide_lengths(frames.q))  # (B, nv) [m] at most in the box
        slid[:, own] += np.where(robot.sliding[own], radii * robot.column_scale[own], 0.0)
        bounds = [chain.bound_second_order(radii, slid) for chain in self.chains]
        enclosures = [self._enclose_loops(frames, bounds)]
        if self.x is not None:
            enclosures.append(self._enclose_position(frames, bounds[-1], self.x))
        if self.attitude is not None:
            enclosures.append(self._enclose_attitude(frames, bounds[-1], self.attitude))
        values, slopes, errors = enclosures[0].concatenate(*enclosures[1:])
        units = np.where(robot.sliding[own], robot.length, 1.0)
        longest = np.max([bound.length for bound in bounds], axis=0, initial=0.0)  # (B,) chain
        rounding = FRAME_ROUNDING * (1.0 + longest)
        return LinearEnclosure(values, slopes * units, errors + np.reshape(rounding, (-1, 1)))

    def _enclose_loops(self, frames: FrameStack, bounds: list[ChainBounds]) -> LinearEnclosure:
        """Enclose the loop equations in boxes.

        Values and slopes are at the middles; errors bound the second-order terms: `ChainBounds.square` of a
        row d.d, `attitude` of one u.w, and `position` of one u.d.
        """
        rows = self.robot.rows
        loops = self.loops
        lengths = self.robot.row_lengths[self.loops]
        equations = loop_equations(rows, frames)
        values = equations.residual[:, loops] / lengths
        slopes = equations.jacobian[:, loops][:, :, self.own] / lengths[:, None]
        field = np.where(rows.square[loops], 2, rows.rotation[loops])  # 0, 1, 2 of `ChainBounds`
        chain_bounds = np.reshape(bounds, (len(bounds), 4, len(frames.q)))  # (chains, fields, B)
        errors = chain_bounds[self.chain_of, field].T * np.abs(rows.derivative_weight[loops])
        return LinearEnclosure(values, slopes, errors)

    def _enclose_position(self, frames: FrameStack, bound: ChainBounds, x: Array) -> LinearEnclosure:
        """Enclose (position - x) / length of the frame, over B boxes, along its translation axes.

        `platform.along` are the base axes of the translations, `platform.sliding` their places in x.
        """
        platform = self.robot.platform
        length = self.robot.length
        position = frames.position[:, 0, platform.along]
        jacobian = frames.frame_jacobian(0)[:, platform.along]
        values = (position - x[platform.sliding]) / length
        errors = np.repeat(bound.position[:, None], values.shape[1], axis=1)  # in robot lengths already
        return LinearEnclosure(values, jacobian[:, :, self.own] / length, errors)

    def _enclose_attitude(self, frames: FrameStack, bound: ChainBounds, attitude: Array) -> LinearEnclosure:
        """Enclose frame axes less the attitude's (3, 3): 9 equations.

        An axis e changes by w_j x e along a joint that turns about w_j.
        """
        axes = frames.rotation[:, 0].swapaxes(1, 2)  # (B, 3, 3), one axis a row
        turning = frames.frame_jacobian(0)[:, 3:][:, :, self.own].swapaxes(1, 2)  # (B, n, 3)
        slopes = cross(turning[:, None], axes[:, :, None])  # (B, axis, n, 3)
        slopes = slopes.swapaxes(2, 3).reshape(-1, 9, len(self.own))
        errors = np.repeat(bound.attitude[:, None], 9, axis=1)
        return LinearEnclosure((axes - attitude.T).reshape(-1, 9), slopes, errors)

    def slide_lengths(self, q: Array) -> Array:
        """Compute the lengths (..., nv) [m] of slides in q (..., nq); 0 for hinges."""
        return np.where(self.robot.sliding, difference(self.robot, self.robot.neutral, q), 0.0)

    def bound_slide(self) -> float | None:
        """Bound the leg's slide [robot lengths] where a chain can close; None without.

        Where the translations of a chain change by one unit with its slide, whatever its hinges do (tested at
        random joints), the slide is no longer than the other links of the chain, stretched out.
        """
        robot = self.robot
        n = len(self.own)
        joints = np.random.default_rng(RANDOM_SEED).uniform(-2, 2, (3, n))
        slopes = self(joints, 0.0 * joints).slopes
        slide = np.flatnonzero(robot.sliding[self.own])[0]
        other_slides = np.abs(self.slide_lengths(self.q))  # (nv,) [m]
        other_slides[self.own[slide]] = 0.0
        ends = robot.rows.reach[self.loops].sum() + (0.0 if self.x is None else np.abs(self.x).sum())
        bounds = []
        for k, chain in enumerate(self.chains):
            # rows of the translations of this chain
            translations = np.flatnonzero(~robot.rows.rotation[self.loops] & (self.chain_of == k))
            if k == len(self.chains) - 1 and self.x is not None:
                translations = len(self.loops) + np.arange(len(robot.platform.sliding))
            change = np.sum(slopes[:, translations, slide] ** 2, axis=1)  # squared, per unit of the slide
            if np.all(change > 1 - SLIDE_SLOPE_ROUNDING):
                bounds.append((chain.length @ np.insert(other_slides, 0, 1.0) + ends) / robot.length)
        return REACH_MARGIN * min(bounds) if bounds else None


# ------------------------------------------------------------------ second derivatives


class ChainBounds(NamedTuple):
    """Bounds on second-order terms of a chain over B boxes [robot lengths]."""

    position: Array  # (B,) of the carried point
    attitude: Array  # (B,) of a direction
    square: Array  # (B,) [m] of half the squared distance of both ends, over the robot's length
    length: Array  # (B,) of the chain


class LeverChain(NamedTuple):
    """The joints from a point to its observer's frame, with their levers.

    Lengths [m] are rows (1 + nv,): all links stretched out, then 1 for each slide that adds to them.
    """

    robot_length: float  # [m]
    turning: BoolArray  # (n,) the leg's joints that are hinges of the chain
    sliding: BoolArray  # (n,)
    levers: Array  # (n, 1 + nv) from the joint to the point
    length: Array  # (1 + nv,) of the chain

    @staticmethod
    def of(robot: ParallelRobot, columns: IntArray, first: int, second: int) -> LeverChain:
        """Add up the links from the second frame's origin to the first frame, or to BASE."""
        model = robot.model
        inside, length = np.zeros(len(columns), dtype=bool), np.zeros(1 + model.nv)
        levers = np.zeros((len(columns), 1 + model.nv))
        length[0] = _offset_on_body(robot, second)
        for number, sign in reversed(joints_between(robot, first, second)):
            joint = model.joints[number]
            own, span = columns == joint.idx_v, joint.idx_v + np.arange(joint.nv)
            inside |= own
            longer = length.copy()
            longer[0] += _offset_length(model.jointPlacements[number])
            longer[1 + span] = robot.sliding[span]
            levers[own] = length if sign > 0.0 else longer
            length = longer
        if first != BASE:
            length[0] += _offset_on_body(robot, first)
        slide = robot.sliding[columns]
        return LeverChain(robot.length, inside & ~slide, inside & slide, levers, length)

    def bound_second_order(self, radii: Array, slid: Array) -> ChainBounds:
        """Bound second-order terms in boxes of radii (B, n).

        Slides are out by at most `slid` (B, nv) [m]. The second derivative of the point along two hinges is
        at most the lesser of their levers, along a hinge and a slide 1; of a direction along two hinges 1. A
        point moves by at most `travel`, and half its squared distance has the derivatives p . d2p + u_i .
        u_j.
        """
        shares = np.insert(slid, 0, 1.0, axis=1) / self.robot_length  # (B, 1 + nv)
        levers, length = shares @ self.levers.T, shares @ self.length  # (B, n), (B,)
        turns = radii * self.turning  # (B, n)
        slide = radii @ self.sliding
        turn = radii @ self.turning
        lesser = np.minimum(levers[:, :, None], levers[:, None])  # (B, n, n) lever of two hinges
        position = 0.5 * np.einsum("bi,bij,bj->b", turns, lesser, turns) + turn * slide
        travel = (turns * levers).sum(axis=1) + slide  # of the point
        square = (length * position + 0.5 * travel**2) * self.robot_length
        return ChainBounds(position, 0.5 * turn**2, square, length)


def _offset_on_body(robot: ParallelRobot, frame: int) -> float:
    """Return the distance [m] of a frame from the joint of its body."""
    return _offset_length(robot.model.frames[robot.frames[frame]].placement)


def _offset_length(placement: pin.SE3) -> float:
    """Return the length [m] of a placement's translation."""
    return float(np.linalg.norm(placement.translation))
