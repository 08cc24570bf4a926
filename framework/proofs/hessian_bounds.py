"""Bounds on the second derivatives of positions, attitudes and distances along chains of joints.

A joint enters a loop equation once, by its cosine and sine or its length, when the loop is seen from one of
its frames. So second derivatives are bounded along the chain from the point that is carried: for two hinges
by the lesser of their distances from it, links stretched out; for a hinge and a slide by one; two slides have
none. They hold in boxes of any width, where those of `derivative_bounds` are sharp in small ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.parallel_robot import ParallelRobot


class ChainBounds(NamedTuple):
    """Bounds on second-order terms over B boxes, all in robot lengths."""

    position: Array  # (B,) of the carried point
    attitude: Array  # (B,) of a direction
    distance: Array  # (B,) [m] of half the squared distance of both ends, over the robot's length
    length: Array  # (B,) of the chain


@dataclass(frozen=True, eq=False)
class LeverChain:
    """The joints from a point to the frame of its observer, with their levers."""

    robot_length: float  # [m]
    turning: BoolArray  # (n,) the leg's joints that are hinges of the chain
    sliding: BoolArray  # (n,)
    levers: Array  # (n,) [m] from the joint to the point, slides at rest
    between: Array  # (n, nv) slides on that way
    length: float  # [m] of the chain, slides at rest
    slides: Array  # (nv,) of the chain

    @staticmethod
    def of(robot: ParallelRobot, columns: IntArray, first: int | None, second: int) -> LeverChain:
        """Walk from the origin of the second frame to the first, None for the base."""
        model = robot.model
        start = model.frames[robot.frames[second]]
        end = None if first is None else model.frames[robot.frames[first]]
        down = [] if end is None else [int(j) for j in model.supports[end.parentJoint] if j]
        up = [int(j) for j in model.supports[start.parentJoint] if j]
        levers, between = np.zeros(len(columns)), np.zeros((len(columns), model.nv))
        inside, slides = np.zeros(len(columns), dtype=bool), np.zeros(model.nv)
        length = float(np.linalg.norm(start.placement.translation))

        def pass_joint(joint: int) -> None:
            is_own = columns == model.joints[joint].idx_v
            inside[is_own], levers[is_own], between[is_own] = True, length, slides

        for joint in [j for j in reversed(up) if j not in down]:
            pass_joint(joint)
            length += float(np.linalg.norm(model.jointPlacements[joint].translation))
            slides[_slides_of(robot, joint)] = 1.0
        for joint in [j for j in down if j not in up]:
            length += float(np.linalg.norm(model.jointPlacements[joint].translation))
            slides[_slides_of(robot, joint)] = 1.0
            pass_joint(joint)
        length += 0.0 if end is None else float(np.linalg.norm(end.placement.translation))
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
        distance = (length * position + 0.5 * travel**2) * self.robot_length
        return ChainBounds(position, 0.5 * total**2, distance, length)


def _slides_of(robot: ParallelRobot, joint: int) -> IntArray:
    """Return the sliding columns of a joint."""
    first, count = robot.model.joints[joint].idx_v, robot.model.joints[joint].nv
    columns = np.arange(first, first + count)
    return columns[robot.sliding[columns]]
