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

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.tree_model import single_columns
from framework.linalg.ordered_sums import cross
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.completeness import KnownSolutions, has_no_others, unique_radius
from framework.proofs.equation_terms import BASE, joints_between
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import REACH_MARGIN
from framework.tolerances import FRAME_ROUNDING, LOOP_GAP

MAX_JOINTS = 4
INITIAL_PARTS = 2  # of a whole turn
SLIDE_SLOPE_ROUNDING = 1e-9  # of the unit by which translations change with a slide
RANDOM_SEED = 5


def leg_solutions_complete(
    robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, near: Array, x: Array | None
) -> bool:
    """Whether the joints of a leg are proved to have no other values; False if not decided.

    Args:
        own: columns of the velocity vector that are theirs.
        fixed: (nv,) columns that keep the values which they have in q (nq,), assembled if x determines more
            than positions.
        near: (k, n) known values of the joints, off those in q, in radians and robot lengths; of these the
            solutions count.
        x: (n,) coordinates of the platform; None with locked motors.
    """
    slides = robot.sliding[own]
    too_many = len(own) > MAX_JOINTS or slides.sum() > 1
    if robot.rows.has_couplings or too_many or not single_columns(robot.model).issuperset(own.tolist()):
        return False
    equations = LegEquations.of(robot, own, fixed, q, x)
    values = equations(near, 0.0 * near).values
    region = _region(equations) if values.shape[1] else None
    if region is None:
        return False
    points = near[np.abs(values).max(axis=1) < LOOP_GAP]
    period = np.where(slides, np.inf, 2 * np.pi)
    radii = np.array([unique_radius(equations, point) for point in points])
    return has_no_others(equations, region, KnownSolutions(points, radii, period))


def _region(equations: LegEquations) -> Boxes | None:
    """Return boxes of all turns of the hinges and all of a slide that can close; None without a bound."""
    robot, own = equations.robot, equations.own
    slides = robot.sliding[own]
    half = np.pi / INITIAL_PARTS
    axes = [np.arange(-np.pi + half, np.pi, 2 * half)] * int((~slides).sum())
    radii = np.full(len(own), half)
    if slides.any():
        farthest = equations.farthest_slide()
        if farthest is None:
            return None
        axes.insert(int(np.argmax(slides)), -equations.slides(equations.q)[own[slides]] / robot.length)
        radii[slides] = farthest
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(own))
    return Boxes(middles, np.repeat(radii[None], len(middles), axis=0))


@dataclass(frozen=True, eq=False)
class LegEquations:
    """The equations of a leg in its own joints [rad, robot lengths] from q, all others fixed."""

    robot: ParallelRobot
    own: IntArray
    q: Array  # (nq,)
    x: Array | None
    loops: IntArray  # of `robot.rows`
    chains: tuple[LeverChain, ...]  # of the loops, then of the platform's frame if its position counts
    chain_of: IntArray  # (loops,)
    attitude: Array | None  # (3, 3) of the platform's frame, where x determines it

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, x: Array | None) -> LegEquations:
        """Collect the equations whose joints are the leg's, or fixed."""
        carried, rows = scratch_of(robot).carried, robot.rows
        feels = carried[rows.second] != carried[rows.first]
        free_joints = ~fixed
        free_joints[own] = False
        loops = np.flatnonzero(feels[:, own].any(axis=1) & ~feels[:, free_joints].any(axis=1))
        ends = np.stack([rows.first[loops], rows.second[loops]], axis=1)
        pairs, chain_of = np.unique(ends, axis=0, return_inverse=True)
        chains = [LeverChain.of(robot, own, *pair) for pair in pairs.tolist()]
        platform = robot.platform
        if isinstance(platform, JointPlatform):
            x = x if x is not None and np.isin(platform.columns, own).any() else None
        elif x is None or not carried[0, own].any() or carried[0, free_joints].any():
            x = None
        else:
            chains.append(LeverChain.of(robot, own, BASE, 0))
        attitude, turns = None, 1 if planar_normal(robot) is not None else 3
        if x is not None and isinstance(platform, FramePlatform) and len(platform.turning) == turns:
            attitude = frames_at(robot, q[None]).rotation[0, 0]
        return LegEquations(robot, own, q, x, loops, tuple(chains), chain_of, attitude)

    def __call__(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the equations in boxes (B, n)."""
        robot, own = self.robot, self.own
        frames = frames_at(robot, integrate_columns(robot, self.q, own, middle * robot.column_scale[own]))
        slid = np.abs(self.slides(frames.q))
        slid[:, own] += np.where(robot.sliding[own], radii * robot.column_scale[own], 0.0)
        bounds = [chain.hessian_bounds(radii, slid) for chain in self.chains]
        enclosure = self._loops(frames, bounds)
        if self.x is not None:
            on_joints = isinstance(robot.platform, JointPlatform)
            enclosure = enclosure.join(
                self._joints(frames, radii) if on_joints else self._position(frames, bounds[-1])
            )
        if self.attitude is not None:
            enclosure = enclosure.join(self._attitude(frames, self.attitude, bounds[-1]))
        values, slopes, errors = enclosure
        units = np.where(robot.sliding[own], robot.length, 1.0)
        chain_lengths = np.max([bound.length for bound in bounds], axis=0, initial=0.0)  # (B,)
        rounding = FRAME_ROUNDING * (1.0 + chain_lengths)
        return LinearEnclosure(values, slopes * units, errors + np.reshape(rounding, (-1, 1)))

    def _loops(self, frames: FrameStack, bounds: list[ChainBounds]) -> LinearEnclosure:
        """Enclose loop equations: residual and slopes at the middle, bounds of second-order terms."""
        rows, loops = self.robot.rows, self.loops
        equations, lengths = loop_equations(rows, frames), self.robot.row_lengths[loops]
        kind = np.where(rows.square[loops], 2, rows.rotation[loops])  # place in `ChainBounds`
        chain_bounds = np.reshape(bounds, (len(bounds), 4, len(frames.q)))
        errors = chain_bounds[self.chain_of, kind].T * np.abs(rows.derivative_weight[loops])
        slopes = equations.jacobian[:, loops][:, :, self.own] / lengths[:, None]
        return LinearEnclosure(equations.residual[:, loops] / lengths, slopes, errors)

    def _position(self, frames: FrameStack, bound: ChainBounds) -> LinearEnclosure:
        """Enclose the position of the platform's frame against x."""
        platform, length = self.robot.platform, self.robot.length
        assert self.x is not None
        values = (frames.position[:, 0, platform.along] - self.x[platform.sliding]) / length
        slopes = frames.frame_jacobian(0)[:, platform.along][:, :, self.own] / length
        errors = np.repeat(bound.position[:, None], len(platform.sliding), axis=1)
        return LinearEnclosure(values, slopes, errors)

    def _attitude(self, frames: FrameStack, attitude: Array, bound: ChainBounds) -> LinearEnclosure:
        """Enclose the axes of the platform's frame against the attitude (3, 3)."""
        count, n = len(frames.q), len(self.own)
        axes = frames.rotation[:, 0].swapaxes(1, 2)  # (B, 3, 3), one axis a row
        turns = frames.frame_jacobian(0)[:, 3:][:, :, self.own].swapaxes(1, 2)  # (B, n, 3)
        turned = cross(turns[:, None], axes[:, :, None])  # (B, axis, n, 3)
        slopes = turned.swapaxes(2, 3).reshape(count, 9, n)
        errors = np.repeat(bound.attitude[:, None], 9, axis=1)
        return LinearEnclosure((axes - attitude.T).reshape(count, 9), slopes, errors)

    def _joints(self, frames: FrameStack, radii: Array) -> LinearEnclosure:
        """Enclose the platform's own joints against x: sine and cosine of hinges' offsets."""
        platform, robot = self.robot.platform, self.robot
        assert isinstance(platform, JointPlatform)
        assert self.x is not None
        hinges = ~platform.translations
        scale = np.where(hinges, 1.0, robot.length)
        off = platform.residual(frames, self.x) / scale
        along = np.eye(robot.model.nv)[platform.columns][:, self.own] / scale[:, None]
        curvature = 0.5 * (radii @ np.where(hinges[:, None], along, 0.0).T) ** 2
        sine, cosine = np.where(hinges, np.sin(off), off), np.where(hinges, np.cos(off), 1.0)
        rates = np.concatenate([cosine, np.where(hinges, -np.sin(off), 0.0)], axis=1)
        is_own = np.tile(np.isin(platform.columns, self.own), 2)
        return LinearEnclosure(
            np.concatenate([sine, cosine - 1.0], axis=1)[:, is_own],
            (rates[:, :, None] * np.tile(along, (2, 1)))[:, is_own],
            np.tile(curvature, 2)[:, is_own],
        )

    def slides(self, q: Array) -> Array:
        """Compute how far the slides are out in q (..., nq), (..., nv) [m]; 0 for hinges."""
        return np.where(self.robot.sliding, difference(self.robot, self.robot.neutral, q), 0.0)

    def farthest_slide(self) -> float | None:
        """Bound the leg's slide [robot lengths] at which a chain can close; None without a bound.

        The translations of a chain change by one unit with its slide, whatever its hinges do.
        """
        robot, n = self.robot, len(self.own)
        random = np.random.default_rng(RANDOM_SEED).uniform(-2, 2, (3, n))
        slopes = self(random, 0.0 * random).slopes
        slide = np.flatnonzero(robot.sliding[self.own])[0]
        position = ~robot.rows.rotation[self.loops]
        others = np.abs(self.slides(self.q))
        others[self.own[slide]] = 0.0
        ends = robot.rows.reach[self.loops].sum()
        ends += 0.0 if self.x is None else np.abs(self.x).sum()
        bounds = []
        for k, chain in enumerate(self.chains):
            rows = np.flatnonzero(position & (self.chain_of == k))
            if k == len(self.chains) - 1 and self.x is not None:
                rows = len(self.loops) + np.arange(len(robot.platform.sliding))
            squares = np.sum(slopes[:, rows, slide] ** 2, axis=1)
            if np.all(squares > 1 - SLIDE_SLOPE_ROUNDING):
                bounds.append((chain.length + chain.slides @ others + ends) / robot.length)
        return REACH_MARGIN * min(bounds) if bounds else None


# ------------------------------------------------------------------ second derivatives


class ChainBounds(NamedTuple):
    """Bounds on second-order terms over B boxes, all in robot lengths."""

    position: Array  # (B,) of the carried point
    attitude: Array  # (B,) of a direction
    square: Array  # (B,) [m] of half the squared distance of both ends, over the robot's length
    length: Array  # (B,) of the chain


class LeverChain(NamedTuple):
    """The joints from a point to the frame of its observer, with their levers."""

    robot_length: float  # [m]
    turning: BoolArray  # (n,) the leg's joints that are hinges of the chain
    sliding: BoolArray  # (n,)
    levers: Array  # (n,) [m] from the joint to the point, slides at rest
    between: Array  # (n, nv) slides on that way
    length: float  # [m] of the chain, slides at rest
    slides: Array  # (nv,) of the chain

    @staticmethod
    def of(robot: ParallelRobot, columns: IntArray, first: int, second: int) -> LeverChain:
        """Walk from the origin of the second frame to the first, or to BASE."""
        model = robot.model
        levers, between = np.zeros(len(columns)), np.zeros((len(columns), model.nv))
        inside, slides = np.zeros(len(columns), dtype=bool), np.zeros(model.nv)
        length, *rest = (
            float(np.linalg.norm(model.frames[robot.frames[k]].placement.translation))
            for k in (second, first)
            if k != BASE
        )
        for number, sign in reversed(joints_between(robot, first, second)):
            joint = model.joints[number]
            own, span = columns == joint.idx_v, slice(joint.idx_v, joint.idx_v + joint.nv)
            inside |= own
            if sign > 0.0:  # the joint stands before its link
                levers[own], between[own] = length, slides
            length += float(np.linalg.norm(model.jointPlacements[number].translation))
            slides[span] = robot.sliding[span]
            if sign < 0.0:
                levers[own], between[own] = length, slides
        length += sum(rest)
        slide = robot.sliding[columns]
        return LeverChain(robot.length, inside & ~slide, inside & slide, levers, between, length, slides)

    def hessian_bounds(self, radii: Array, slid: Array) -> ChainBounds:
        """Bound second-order terms in boxes of radii (B, n), slides out by at most `slid` (B, nv) [m]."""
        levers = (self.levers + slid @ self.between.T) / self.robot_length
        length = (self.length + slid @ self.slides) / self.robot_length
        turns, slides = radii * self.turning, (radii * self.sliding).sum(axis=1)
        lesser = np.minimum(levers[:, :, None], levers[:, None])
        curved = 0.5 * np.einsum("bi,bij,bj->b", turns, lesser, turns)
        total = turns.sum(axis=1)
        position = curved + total * slides
        travel = (turns * levers).sum(axis=1) + slides
        square = (length * position + 0.5 * travel**2) * self.robot_length
        return ChainBounds(position, 0.5 * total**2, square, length)
