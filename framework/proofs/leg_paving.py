"""Proof that the equations of a leg have no other solutions, by paving its joints (`completeness`).

The equations are those of the loops whose moving joints all belong to the leg, and those of the platform's
position and attitude. Seen from one frame of a loop, each joint enters a loop equation once, by the cosine
and sine of its angle or by its length. So the second derivatives of a carried point are bounded: along two
hinges by the lesser of their distances from the point, all links in one line; along a hinge and a slide by 1;
along two slides by 0. These bounds hold in boxes of any width; the bounds of `derivative_bounds` are sharp in
small boxes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate_columns, scratch_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import cross
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.completeness import KnownSolutions, has_only_known_solutions
from framework.proofs.equation_terms import BASE, joints_between
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import REACH_MARGIN
from framework.tolerances import FRAME_ROUNDING, LOOP_GAP

MAX_JOINTS = 4
INITIAL_PARTS = 2  # into which a whole turn is cut at first
SLIDE_SLOPE_ROUNDING = 1e-9  # of a squared slope along a slide, against 1
RANDOM_SEED = 5


def are_leg_solutions_complete(
    robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, candidates: Array, x: Array | None
) -> bool:
    """Return whether a leg provably has no solutions but candidates; False if undecided.

    Args:
        own: (k,) columns of the velocity vector of the leg's joints.
        fixed: (nv,) mask of columns that keep their values in q (nq,). If x contains rotations, q must be
            assembled at x, since the platform's attitude is taken from q.
        candidates: (c, k) offsets of the joints from q [rad, robot lengths]. Those that solve the equations
            are the known solutions.
        x: (n,) coordinates of the platform; None with locked motors.
    """
    platform = robot.platform
    if x is not None and isinstance(platform, JointPlatform):  # the platform's joints are fixed at x
        is_unknown = np.isin(own, platform.columns, invert=True)
        own = own[is_unknown]
        candidates = candidates[:, is_unknown]
        fixed = fixed.copy()
        fixed[platform.columns] = True
        q = q.copy()
        q[platform.q_indices] = x
        x = None
    if not len(own):
        return len(candidates) > 0
    if not _is_paveable(robot, own):
        return False
    equations = LegEquations.of(robot, own, fixed, q, x)
    residuals = equations(candidates, np.zeros_like(candidates)).values  # in boxes of zero radius
    region = _joint_region(equations) if residuals.shape[1] else None
    if region is None:
        return False
    points = candidates[np.abs(residuals).max(axis=1) < LOOP_GAP]
    period = np.where(robot.sliding[own], np.inf, 2 * np.pi)
    return has_only_known_solutions(equations, region, KnownSolutions.of(equations, points, period))


def _is_paveable(robot: ParallelRobot, own: IntArray) -> bool:
    """Return whether the joints (k,) of a leg can be paved.

    They must be few, with at most one slide and no ball joint, and the robot must have no couplings.
    """
    if len(own) > MAX_JOINTS or np.count_nonzero(robot.sliding[own]) > 1 or robot.rows.has_couplings:
        return False
    return single_columns(robot.model).issuperset(own.tolist())


def _joint_region(equations: LegEquations) -> Boxes | None:
    """Return boxes that cover all hinge angles, and all slide lengths at which the chain can close.

    The whole turn of each hinge is cut into INITIAL_PARTS. A slide reaches from its zero to the bound of
    `bound_slide`, in both directions. Without such a bound the result is None.
    """
    robot = equations.robot
    own = equations.own
    half_width = np.pi / INITIAL_PARTS
    middles = [np.arange(-np.pi + half_width, np.pi, 2 * half_width)] * len(own)  # along each joint
    radii = np.full(len(own), half_width)
    for slide in np.flatnonzero(robot.sliding[own]):  # at most one
        farthest = equations.bound_slide()
        if farthest is None:
            return None
        middles[slide] = -equations.slide_lengths(equations.q)[own[[slide]]] / robot.length  # from q
        radii[slide] = farthest
    grid = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, len(own))
    return Boxes(grid, np.tile(radii, (len(grid), 1)))


@dataclass(frozen=True, eq=False)
class LegEquations:
    """The equations of a leg in the offsets of its n joints from q [rad, robot lengths].

    All other joints are fixed, or enter none of the equations.
    """

    robot: ParallelRobot
    own: IntArray  # (n,) columns of the velocity vector
    q: Array  # (nq,)
    x: Array | None  # (platform coordinates,) if only the leg and fixed joints carry the platform
    loops: IntArray  # (loops,) indices into `robot.rows`
    chains: tuple[LeverChain, ...]  # of the loops, then of the platform's frame if x is not None
    chain_of: IntArray  # (loops,) index of each loop's chain
    attitude: Array | None  # (3, 3) of the platform's frame, if x determines it

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, x: Array | None) -> LegEquations:
        """Collect the equations whose joints are the leg's, or fixed.

        A loop row counts if a joint of the leg moves it and no free joint does, and so do the coordinates x
        of the platform. They determine its attitude if they include all rotations: three, or one in a plane.
        """
        carried = scratch_of(robot).carried
        rows = robot.rows
        free = ~fixed
        free[own] = False

        moves_row = carried[rows.second] != carried[rows.first]  # (rows, nv) a joint carries one frame
        loops = np.flatnonzero(moves_row[:, own].any(axis=1) & ~moves_row[:, free].any(axis=1))
        ends = np.stack([rows.first[loops], rows.second[loops]], axis=1)
        pairs, chain_of = np.unique(ends, axis=0, return_inverse=True)
        chains = [LeverChain.of(robot, own, *pair) for pair in pairs.tolist()]

        attitude = None
        platform = robot.platform
        is_determined = carried[0, own].any() and not carried[0, free].any()
        if not (isinstance(platform, FramePlatform) and is_determined):
            x = None  # other joints move the platform, too
        elif x is not None:
            chains.append(LeverChain.of(robot, own, BASE, 0))
            if len(platform.turning) == (3 if planar_normal(robot) is None else 1):
                attitude = frames_at(robot, q[None]).rotation[0, 0]
        return LegEquations(robot, own, q, x, loops, tuple(chains), chain_of, attitude)

    def __call__(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the equations in boxes (B, n) [rad, robot lengths]: loops, then platform."""
        robot = self.robot
        own = self.own
        units = robot.column_scale[own]
        frames = frames_at(robot, integrate_columns(robot, self.q, own, middle * units))
        slid = np.abs(self.slide_lengths(frames.q))  # (B, nv) [m] at the middles
        slid[:, own] += np.where(robot.sliding[own], radii * units, 0.0)  # largest within the boxes
        bounds = [chain.bound_second_order(radii, slid) for chain in self.chains]
        enclosures = [self._enclose_loops(frames, bounds)]
        if self.x is not None:
            enclosures.append(self._enclose_position(frames, bounds[-1], self.x))
        if self.attitude is not None:
            enclosures.append(self._enclose_attitude(frames, bounds[-1], self.attitude))
        values, slopes, errors = enclosures[0].concatenate(*enclosures[1:])
        longest = np.max([bound.length for bound in bounds], axis=0, initial=0.0)  # (B,) chain
        rounding = FRAME_ROUNDING * (1.0 + longest)
        return LinearEnclosure(values, slopes * units, errors + np.reshape(rounding, (-1, 1)))

    def _enclose_loops(self, frames: FrameStack, bounds: list[ChainBounds]) -> LinearEnclosure:
        """Enclose the loop equations in boxes.

        Values and slopes are those at the middles. The errors are the chain's bounds on the second-order
        terms of the product in a row: `square` for d.d, `attitude` for u.w, and `position` for u.d.
        """
        rows = self.robot.rows
        loops = self.loops
        lengths = self.robot.row_lengths[loops]
        equations = loop_equations(rows, frames)
        values = equations.residual[:, loops] / lengths
        slopes = equations.jacobian[:, loops][:, :, self.own] / lengths[:, None]
        errors = np.empty_like(values)  # (B, loops)
        for k, (row, chain) in enumerate(zip(loops, self.chain_of, strict=True)):
            bound = bounds[chain]
            if rows.square[row]:
                errors[:, k] = bound.square
            else:
                errors[:, k] = bound.attitude if rows.rotation[row] else bound.position
        return LinearEnclosure(values, slopes, errors * np.abs(rows.derivative_weight[loops]))

    def _enclose_position(self, frames: FrameStack, bound: ChainBounds, x: Array) -> LinearEnclosure:
        """Enclose (position - x) / length of the platform's frame along its translations.

        `platform.along` are the base axes of the translations, `platform.sliding` their indices in x.
        """
        platform = self.robot.platform
        length = self.robot.length
        position = frames.position[:, 0, platform.along]
        jacobian = frames.frame_jacobian(0)[:, platform.along]
        values = (position - x[platform.sliding]) / length
        errors = np.repeat(bound.position[:, None], values.shape[1], axis=1)  # already in robot lengths
        return LinearEnclosure(values, jacobian[:, :, self.own] / length, errors)

    def _enclose_attitude(self, frames: FrameStack, bound: ChainBounds, attitude: Array) -> LinearEnclosure:
        """Enclose 9 equations: the axes of the platform's frame less the `attitude` (3, 3).

        The derivative of an axis e along a joint that turns about w_j is w_j x e.
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
        """Bound the length [robot lengths] of the leg's slide in closed loops; None if unknown.

        If the slide translates the end of a chain by its own length at all hinge angles (tested at random
        joints), it is no longer than the rest of the chain stretched into one line.
        """
        robot = self.robot
        slide = np.flatnonzero(robot.sliding[self.own])[0]
        joints = np.random.default_rng(RANDOM_SEED).uniform(-2, 2, (3, len(self.own)))
        squares = self(joints, np.zeros_like(joints)).slopes[:, :, slide] ** 2  # (3, equations)
        chain_of = self.chain_of  # of each equation
        is_translation = ~robot.rows.rotation[self.loops]
        offset = robot.rows.reach[self.loops].sum()  # [m] between the ends of a chain, at most
        if self.x is not None:  # the position equations of the platform belong to the last chain
            offset += np.abs(self.x).sum()
            count = len(robot.platform.sliding)
            chain_of = np.append(chain_of, np.full(count, len(self.chains) - 1))
            is_translation = np.append(is_translation, np.full(count, True))
        lengths = np.insert(np.abs(self.slide_lengths(self.q)), 0, 1.0)  # (1 + nv,) as in `LeverChain`
        lengths[1 + self.own[slide]] = 0.0
        bounds = []
        for k, chain in enumerate(self.chains):
            translations = np.flatnonzero(is_translation & (chain_of == k))
            if np.all(squares[:, translations].sum(axis=1) > 1 - SLIDE_SLOPE_ROUNDING):
                bounds.append((chain.length @ lengths + offset) / robot.length)
        return REACH_MARGIN * min(bounds) if bounds else None


# ------------------------------------------------------------------ second derivatives


class ChainBounds(NamedTuple):
    """Bounds over B boxes on the second-order terms of a chain [robot lengths]."""

    position: Array  # (B,) of the carried point
    attitude: Array  # (B,) of a direction
    square: Array  # (B,) [m] of half the squared distance between the ends, divided by the robot's length
    length: Array  # (B,) largest length of the chain


class LeverChain(NamedTuple):
    """The joints between a carried point and the observing frame, with their levers.

    Slides change lengths. A length [m] is therefore stored as a row (1 + nv,): first the sum of the links,
    then, for each column of the velocity vector, 1 if this slide adds its own length.
    """

    robot_length: float  # [m]
    turning: BoolArray  # (n,) which of the leg's joints are hinges of the chain
    sliding: BoolArray  # (n,) which are slides of the chain
    levers: Array  # (n, 1 + nv) from the joint to the point
    length: Array  # (1 + nv,) of the chain

    @staticmethod
    def of(robot: ParallelRobot, columns: IntArray, first: int, second: int) -> LeverChain:
        """Add up the links from the second frame's origin to the first frame, or to BASE."""
        model = robot.model
        is_inside = np.zeros(len(columns), dtype=bool)
        length = np.zeros(1 + model.nv)
        length[0] = _offset_on_body(robot, second)
        levers = np.zeros((len(columns), 1 + model.nv))
        for number, sign in reversed(joints_between(robot, first, second)):
            joint = model.joints[number]
            is_joint = columns == joint.idx_v
            is_inside |= is_joint
            # the chain up to this joint, with its link and its slide
            longer = length.copy()
            longer[0] += _offset_length(model.jointPlacements[number])
            span = joint.idx_v + np.arange(joint.nv)
            longer[1 + span] = robot.sliding[span]
            # a joint that carries the first frame is at the far end of its link
            levers[is_joint] = length if sign > 0.0 else longer
            length = longer
        if first != BASE:
            length[0] += _offset_on_body(robot, first)
        is_slide = robot.sliding[columns]
        return LeverChain(robot.length, is_inside & ~is_slide, is_inside & is_slide, levers, length)

    def bound_second_order(self, radii: Array, slid: Array) -> ChainBounds:
        """Bound the second-order terms in boxes of radii (B, n).

        Slides are extended by at most `slid` (B, nv) [m]. The second derivative of the carried point p is at
        most the lesser lever along two hinges, and 1 along a hinge and a slide. That of a direction is at
        most 1 along two hinges. The point moves by at most `travel`. With the first derivatives u_i of p,
        p . p / 2 has the second derivatives p . d2p + u_i . u_j.
        """
        lengths = np.insert(slid, 0, 1.0, axis=1) / self.robot_length  # (B, 1 + nv)
        levers = lengths @ self.levers.T  # (B, n)
        length = lengths @ self.length  # (B,)
        turns = radii * self.turning  # (B, n)
        slide = radii @ self.sliding
        turn = radii @ self.turning
        lesser = np.minimum(levers[:, :, None], levers[:, None])  # (B, n, n) lever of two hinges
        position = 0.5 * np.einsum("bi,bij,bj->b", turns, lesser, turns) + turn * slide
        travel = (turns * levers).sum(axis=1) + slide  # of the point
        square = (length * position + 0.5 * travel**2) * self.robot_length
        return ChainBounds(position, 0.5 * turn**2, square, length)


def _offset_on_body(robot: ParallelRobot, frame: int) -> float:
    """Return the distance [m] of a frame from its body's joint."""
    return _offset_length(robot.model.frames[robot.frames[frame]].placement)


def _offset_length(placement: pin.SE3) -> float:
    """Return the length [m] of a placement's translation."""
    return float(np.linalg.norm(placement.translation))
