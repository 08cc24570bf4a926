"""Proof that the equations of a leg have no solutions besides the known ones, by paving its joints.

The equations are those of the loops whose moving joints all belong to the leg, and those of the platform's
position and attitude. Seen from one frame of a loop, each joint enters a loop equation once, by the cosine
and sine of its angle or by its length. So the second derivatives of a carried point are bounded: along two
hinges by the lesser of their distances from the point, all links in one line; along a hinge and a slide by 1;
along two slides by 0. These bounds hold in boxes of any width; the bounds of `derivative_bounds` are sharp in
small boxes.

A known solution is the only one in some box about it (`unique_radii`). All other boxes are narrowed and
halved until none of them can hold a solution, or one is too small to be halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate_columns, scratch_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, BoolArray, IntArray, select
from framework.proofs.branch_and_bound import NO_AXIS, Boxes, Examined, branch_and_bound, narrow_or_halve
from framework.proofs.equation_terms import BASE, joints_between
from framework.proofs.interval_newton import LinearEnclosure, contract, damped_inverses
from framework.proofs.passive_joints import attitude_equations
from framework.proofs.rounding import REACH_MARGIN, ROUND_UP, identity_defect
from framework.tolerances import DISTINCT_SOLUTIONS, FRAME_ROUNDING, LOOP_GAP, RANK_ROUNDING

MAX_JOINTS = 4  # of a leg that is paved
MAX_BOXES = 60_000  # tested for a leg

Equations = Callable[[Array, Array], LinearEnclosure]  # takes the middles and radii (B, n) of boxes


def are_leg_solutions_complete(
    robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, candidates: Array, x: Array | None
) -> bool:
    """Return whether a leg of k joints provably has no solutions but candidates; False if undecided.

    Args:
        own: (k,) columns of the velocity vector of the leg's joints.
        fixed: (nv,) mask of columns that keep their values in q (nq,). If x contains rotations, q must be
            assembled at x, since the platform's attitude is taken from q.
        candidates: (c, k) offsets of the joints from q [rad, robot lengths]. Those that solve the equations
            are the known solutions.
        x: (n,) coordinates of the platform; None with locked motors.
    """
    platform = robot.platform
    if x is not None and isinstance(platform, JointPlatform):
        # the platform's coordinates are joints: fix these joints at x, and leave x out of the equations
        is_unknown = np.isin(own, platform.columns, invert=True)
        own = own[is_unknown]
        candidates = candidates[:, is_unknown]
        fixed = fixed.copy()
        fixed[platform.columns] = True
        q = q.copy()
        q[platform.q_indices] = x
        x = None
    if not len(own):  # no joints are left: the only solution is the candidate without coordinates
        return len(candidates) > 0
    if not _is_paveable(robot, own):
        return False

    equations = LegEquations.of(robot, own, fixed, q, x)
    region = _joint_region(equations) if equations.kinds else None
    if region is None:
        return False
    residuals = equations(candidates, np.zeros_like(candidates)).values  # (c, m) in boxes of zero radius
    points = candidates[np.abs(residuals).max(axis=1) < LOOP_GAP]
    period = np.where(robot.sliding[own], np.inf, 2 * np.pi)
    known = KnownSolutions(points, unique_radii(equations, points), period)
    return has_only_known_solutions(equations, region, known)


def _is_paveable(robot: ParallelRobot, own: IntArray) -> bool:
    """Return whether the joints (k,) of a leg can be paved.

    They must be few, with at most one slide and no ball joint, and the robot must have no couplings.
    """
    if len(own) > MAX_JOINTS or np.count_nonzero(robot.sliding[own]) > 1 or robot.rows.has_couplings:
        return False
    return single_columns(robot.model).issuperset(own.tolist())


def _joint_region(equations: LegEquations) -> Boxes | None:
    """Return a box of all hinge angles, and all slide lengths at which the chain can close.

    The box has offsets of the joints from q. A slide reaches from its zero to the bound of `bound_slide`, in
    both directions. Without such a bound the result is None.
    """
    robot = equations.robot
    own = equations.own
    middle = np.zeros(len(own))  # offsets from q
    radii = np.full(len(own), ROUND_UP * np.pi)  # half a turn of each hinge
    for slide in np.flatnonzero(robot.sliding[own]):  # at most one
        farthest = equations.bound_slide()
        if farthest is None:
            return None
        middle[slide] = -_slide_lengths(robot, equations.q)[own[slide]] / robot.length  # the slide's zero
        radii[slide] = farthest
    return Boxes(middle[None], radii[None])


class KnownSolutions(NamedTuple):
    """Known solutions, each alone in a box about its point."""

    points: Array  # (k, n) offsets of n joints [rad, robot lengths]
    radii: Array  # (k,) of the boxes, equal in all coordinates
    period: Array  # (n,) of the coordinates: a whole turn of angles, inf of lengths

    def contains(self, boxes: Boxes) -> BoolArray:
        """Return whether each of B boxes lies in the box of one solution, (B,).

        Angles are compared modulo whole turns, so distances are the shortest ones modulo the period.
        """
        offset = np.mod(np.abs(boxes.middle[:, None] - self.points), self.period)  # (B, k, n)
        distance = np.minimum(offset, self.period - offset)
        farthest = (distance + boxes.radii[:, None]).max(axis=2)  # (B, k) points of the boxes
        return np.any(farthest < self.radii, axis=1)


def unique_radii(equations: Equations, points: Array) -> Array:
    """Compute radii (k,) of boxes about points (k, n) with at most one solution each; 1 at most.

    Let J (m, n) be the Jacobian at a point, Y its pseudo-inverse and dJ a bound on the change of J within the
    box. Two solutions in the box are impossible if the mean Jacobian between any two of its points has full
    rank, which holds if |1 - Y J| + |Y| dJ has row sums below 1. Up to radius 1, dJ grows in proportion to
    the radius. The errors of the equations in a box of radius 1 bound second-order terms, so the row sums of
    dJ at radius 1 are twice these errors.
    """
    linear = equations(points, np.ones_like(points))  # in boxes of radius 1
    Y = np.linalg.pinv(linear.slopes)  # (k, n, m)
    defect = identity_defect(Y, linear.slopes).sum(axis=2).max(axis=1)
    change = 2 * np.matvec(np.abs(Y), linear.errors).max(axis=1)  # largest row sum of |Y| dJ at radius 1
    return np.minimum((1.0 - ROUND_UP * defect) / (ROUND_UP * change), 1.0)


def has_only_known_solutions(equations: Equations, region: Boxes, known: KnownSolutions) -> bool:
    """Return whether the boxes of a region provably hold only known solutions; False if undecided.

    The region, the `equations` and the solutions have one offset for each joint [rad, robot lengths]. A box
    is dropped if its linear enclosure has no solution, or if it lies in the box of a known solution.
    Otherwise the enclosure narrows it, or it is cut.
    """

    def test(boxes: Boxes) -> Examined[Boxes, None]:
        """Narrow boxes; drop boxes without other solutions; test again or halve the rest."""
        linear = equations(*boxes)
        remaining = contract(linear, boxes.radii, damped_inverses(linear, boxes.radii))
        all_narrow = boxes.sub_boxes(remaining.lower, remaining.upper)
        is_open = ~remaining.empty & ~known.contains(all_narrow)

        # narrow the boxes that may hold another solution again, halve them, or leave them undecided
        narrow = select(all_narrow, is_open)
        is_small = narrow.radii.max(axis=1) < DISTINCT_SOLUTIONS
        no_axis = np.full(narrow.size, NO_AXIS)
        undecided, pending = narrow_or_halve(select(boxes, is_open), narrow, no_axis, is_small)
        return Examined(None, undecided, pending)

    # One undecided box spoils the proof. With equal distances no box is nearer, so the search ends there.
    end = branch_and_bound(test, region, max_examined=MAX_BOXES, distance=lambda boxes: np.zeros(boxes.size))
    return not (end.undecided.size or end.pending.size)


@dataclass(frozen=True, eq=False)
class LegEquations:
    """The m equations of a leg in the offsets of its n joints from q [rad, robot lengths].

    These are loop equations, then up to three coordinates of the platform's position, then nine of its
    attitude. All other joints are fixed, or enter none of the equations.
    """

    robot: ParallelRobot
    own: IntArray  # (n,) columns of the leg's joints in the velocity vector
    q: Array  # (nq,) configuration of offsets zero
    x: Array | None  # (platform coordinates,) if only the leg and fixed joints carry the platform
    loops: IntArray  # (loops,) indices into `robot.rows`
    chains: list[LeverChain]  # between the frames of loops, then from the base to the platform
    chain_of: IntArray  # (m,) index of each equation's chain
    kinds: list[str]  # of the m equations: position, attitude or square, the field of `ChainBounds`
    attitude: Array | None  # (3, 3) of the platform's frame, if x determines it

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, x: Array | None) -> LegEquations:
        """Collect the equations whose joints are the leg's, or fixed.

        A loop row counts if a joint of the leg moves it and no free joint does, and so do the coordinates x
        of the platform. They determine its attitude if they include all rotations: three, or one in a plane.
        The platform's frame has the number 0.

        Args:
            own: (n,) columns of the velocity vector of the leg's joints.
            fixed: (nv,) mask of the columns that keep their values in q.
            q: (nq,) configuration, assembled at x if x contains rotations.
            x: (platform coordinates,) of the platform; None with locked motors.
        """
        carried = scratch_of(robot).carried  # (frames, nv) whether a joint carries a frame
        rows = robot.rows
        free = ~fixed  # columns of joints that are neither fixed nor the leg's
        free[own] = False

        # loops, each with the chain between its frames; a joint moves a row if it carries one frame alone
        moves_row = carried[rows.second] != carried[rows.first]  # (rows, nv)
        loops = np.flatnonzero(moves_row[:, own].any(axis=1) & ~moves_row[:, free].any(axis=1))
        pairs, chain_of = np.unique(
            np.column_stack([rows.first[loops], rows.second[loops]]), axis=0, return_inverse=True
        )
        slid = np.abs(_slide_lengths(robot, q))  # (nv,) [m] of fixed slides
        slid[own] = 0.0
        chains = [LeverChain.of(robot, own, slid, *pair) for pair in pairs.tolist()]
        kinds = np.select(
            [rows.square[loops], rows.rotation[loops]], ["square", "attitude"], "position"
        ).tolist()

        # coordinates of the platform
        attitude = None
        platform = robot.platform
        is_determined = carried[0, own].any() and not carried[0, free].any()
        if not (isinstance(platform, FramePlatform) and is_determined):
            x = None  # other joints move the platform, too
        elif x is not None:
            kinds += ["position"] * len(platform.sliding)
            if len(platform.turning) == (3 if planar_normal(robot) is None else 1):
                attitude = frames_at(robot, q[None]).rotation[0, 0]
                kinds += ["attitude"] * 9  # three coordinates of each axis
            chain_of = np.append(chain_of, np.full(len(kinds) - len(loops), len(chains)))
            chains.append(LeverChain.of(robot, own, slid, BASE, 0))
        return LegEquations(robot, own, q, x, loops, chains, chain_of, kinds, attitude)

    def __call__(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the m equations in boxes of middles and radii (B, n) [rad, robot lengths].

        The middles are offsets from q; values and slopes are those at the middles.
        """
        robot = self.robot
        own = self.own
        units = robot.column_scale[own]
        frames = frames_at(robot, integrate_columns(robot, self.q, own, middle * units))
        parts = [self._linearise_loops(frames)]
        if self.x is not None:
            parts.append(self._linearise_position(frames, self.x))
        if self.attitude is not None:
            axes, axis_slopes = attitude_equations(frames, self.attitude)
            parts.append((axes, axis_slopes[:, :, own]))
        values, slopes = map(np.hstack, zip(*parts, strict=True))  # (B, m), (B, m, n)
        return LinearEnclosure(values, slopes * units, self._bound_errors(frames.q, radii))

    def _bound_errors(self, q: Array, radii: Array) -> Array:
        """Bound the second-order terms and the rounding (B, m) in boxes of radii (B, n) about q (B, nq).

        Each equation has the bound of its chain for its kind.
        """
        robot = self.robot
        own = self.own
        slid = np.abs(_slide_lengths(robot, q)[:, own])  # (B, n) [m] at the middles
        slid += np.where(robot.sliding[own], radii * robot.column_scale[own], 0.0)  # largest in the boxes
        bounds = [chain.bound_second_order(radii, slid) for chain in self.chains]
        pairs = zip(self.chain_of, self.kinds, strict=True)
        terms = [getattr(bounds[chain], kind) for chain, kind in pairs]  # (B,) each
        errors = np.reshape(terms, (len(self.kinds), len(q))).T
        # a loop row is a weight times the position, attitude or half square that the bounds are for
        errors[:, : len(self.loops)] *= np.abs(robot.rows.derivative_weight[self.loops])
        longest = np.max([bound.length for bound in bounds], axis=0, initial=0.0)  # (B,) chain, if any
        return errors + FRAME_ROUNDING * (1.0 + np.reshape(longest, (-1, 1)))

    def _linearise_loops(self, frames: FrameStack) -> tuple[Array, Array]:
        """Compute the residuals (B, loops) of the loop equations in boxes, and slopes (B, loops, n)."""
        loops = self.loops
        lengths = self.robot.row_lengths[loops]
        equations = loop_equations(self.robot.rows, frames)
        slopes = equations.jacobian[:, loops][:, :, self.own]
        return equations.residual[:, loops] / lengths, slopes / lengths[:, None]

    def _linearise_position(self, frames: FrameStack, x: Array) -> tuple[Array, Array]:
        """Compute offsets (B, t) of the platform's frame from x [robot lengths], and slopes (B, t, n).

        The `frames` are those at the middles of B boxes, the offsets those along the t translations.
        `platform.along` are the base axes of the translations, `platform.sliding` their indices in x.
        """
        platform = self.robot.platform
        offset = frames.position[:, 0, platform.along] - x[platform.sliding]
        slopes = frames.frame_jacobian(0)[:, platform.along][:, :, self.own]
        return offset / self.robot.length, slopes / self.robot.length

    def bound_slide(self) -> float | None:
        """Bound the length [robot lengths] of the leg's slide in closed loops; None if unknown.

        If the slide translates the end of a chain by its own length at all hinge angles (tested at random
        joints), it is no longer than the rest of the chain stretched into one line.
        """
        robot = self.robot
        slide = np.flatnonzero(robot.sliding[self.own])[0]  # its index among the leg's joints
        joints = np.random.default_rng(0).uniform(-2, 2, (3, len(self.own)))  # three poses
        squares = self(joints, np.zeros_like(joints)).slopes[:, :, slide] ** 2  # (3, m)
        is_translation = np.array(self.kinds) != "attitude"
        # [m] largest distance that the equations allow between the ends of a chain
        offset = robot.rows.reach[self.loops].sum()
        offset += 0.0 if self.x is None else np.abs(self.x).sum()

        bounds = []
        for k, chain in enumerate(self.chains):
            squared_speed = squares[:, is_translation & (self.chain_of == k)].sum(axis=1)  # of the end
            if np.all(squared_speed > 1 - RANK_ROUNDING):
                bounds.append((chain.length[0] + offset) / robot.length)  # without the slide itself
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

    The leg's slides change lengths. A length [m] is therefore stored as a row (1 + n,): first the sum of the
    links and of fixed slides, then, for each of the leg's joints, 1 if it is a slide that adds its length.
    """

    robot_length: float  # [m]
    turning: BoolArray  # (n,) which of the leg's joints are hinges of the chain
    sliding: BoolArray  # (n,) which are slides of the chain
    levers: Array  # (n, 1 + n) from the joint to the point
    length: Array  # (1 + n,) of the chain

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, slid: Array, first: int, second: int) -> LeverChain:
        """Add up the links from the second frame's origin to the first frame, or to BASE.

        The chain is followed from the second frame. `own` (n,) are the columns of the leg's joints, `slid`
        (nv,) the lengths [m] of fixed slides.
        """
        model = robot.model
        n = len(own)
        is_slide = robot.sliding[own]
        is_inside = np.zeros(n, dtype=bool)
        length = np.zeros(1 + n)  # of the chain up to the joint reached, as a row of the class
        length[0] = _offset_on_body(robot, second)
        levers = np.zeros((n, 1 + n))
        for number, sign in reversed(joints_between(robot, first, second)):
            joint = model.joints[number]
            is_joint = own == joint.idx_v  # (n,) whether it is one of the leg's joints
            is_inside |= is_joint
            # the chain up to this joint, with its link and its slide
            longer = length.copy()
            longer[0] += np.linalg.norm(model.jointPlacements[number].translation)
            longer[0] += slid[joint.idx_v : joint.idx_v + joint.nv].sum()
            longer[1:] += is_joint & is_slide
            # a joint that carries the first frame is at the far end of its link
            levers[is_joint] = length if sign > 0.0 else longer
            length = longer
        if first != BASE:
            length[0] += _offset_on_body(robot, first)
        return LeverChain(robot.length, is_inside & ~is_slide, is_inside & is_slide, levers, length)

    def bound_second_order(self, radii: Array, slid: Array) -> ChainBounds:
        """Bound the second-order terms in boxes of radii (B, n) [rad, robot lengths].

        The leg's slides are extended by at most `slid` (B, n) [m]. The second derivative of the carried point
        p is at most the lesser lever along two hinges, and 1 along a hinge and a slide. That of a direction
        is at most 1 along two hinges. The point moves by at most `travel`. With the first derivatives u_i of
        p, p . p / 2 has the second derivatives p . d2p + u_i . u_j.
        """
        lengths = np.insert(slid, 0, 1.0, axis=1) / self.robot_length  # (B, 1 + n), see the class
        levers = lengths @ self.levers.T  # (B, n)
        length = lengths @ self.length  # (B,)

        turns = radii * self.turning  # (B, n) 0 for slides
        total_turn = radii @ self.turning  # (B,) of all hinges
        total_slide = radii @ self.sliding  # (B,) of all slides
        lesser = np.minimum(levers[:, :, None], levers[:, None])  # (B, n, n) lever of two hinges
        position = 0.5 * np.einsum("bi,bij,bj->b", turns, lesser, turns) + total_turn * total_slide
        travel = (turns * levers).sum(axis=1) + total_slide  # of the point
        square = (length * position + 0.5 * travel**2) * self.robot_length
        return ChainBounds(position, 0.5 * total_turn**2, square, length)


def _slide_lengths(robot: ParallelRobot, q: Array) -> Array:
    """Compute the lengths (..., nv) [m] of slides in q (..., nq); 0 for hinges."""
    return np.where(robot.sliding, difference(robot, robot.neutral, q), 0.0)


def _offset_on_body(robot: ParallelRobot, frame: int) -> float:
    """Return the distance [m] of a frame from its body's joint."""
    return float(np.linalg.norm(robot.model.frames[robot.frames[frame]].placement.translation))
