"""Bounds on the second derivatives of places, attitudes and distances along chains of joints.

A joint enters a loop equation once, by its cosine and sine or its length, when the loop is seen from one of
its frames. So second derivatives are bounded along the chain from the point that is carried: for two hinges
by the lesser of their distances from it, links stretched out; for a hinge and a slide by one; two slides have
none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.parallel_robot import ParallelRobot


@dataclass(frozen=True, eq=False)
class Chain:
    """The way from a point to the frame from which it is seen."""

    length: float  # [m] of the robot
    turning: BoolArray  # (n,) the leg's joints that are hinges of the chain
    sliding: BoolArray  # (n,)
    reach: Array  # (n,) [m] from the joint to the point, slides at rest
    between: Array  # (n, nv) slides on that way
    whole: float  # [m] length of the chain, slides at rest
    slides: Array  # (nv,) of the chain

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, first: int | None, second: int) -> Chain:
        """From the origin of the second frame to the first, None for the base."""
        model = robot.model
        start = model.frames[robot.frames[second]]
        end = None if first is None else model.frames[robot.frames[first]]
        down = [] if end is None else [int(j) for j in model.supports[end.parentJoint] if j]
        up = [int(j) for j in model.supports[start.parentJoint] if j]
        reach, between = np.zeros(len(own)), np.zeros((len(own), model.nv))
        inside, slides = np.zeros(len(own), dtype=bool), np.zeros(model.nv)
        far = float(np.linalg.norm(start.placement.translation))

        def pass_by(joint: int) -> None:
            here = own == model.joints[joint].idx_v
            inside[here], reach[here], between[here] = True, far, slides

        for joint in [j for j in reversed(up) if j not in down]:
            pass_by(joint)
            far += float(np.linalg.norm(model.jointPlacements[joint].translation))
            slides[_slides_of(robot, joint)] = 1.0
        for joint in [j for j in down if j not in up]:
            far += float(np.linalg.norm(model.jointPlacements[joint].translation))
            slides[_slides_of(robot, joint)] = 1.0
            pass_by(joint)
        far += 0.0 if end is None else float(np.linalg.norm(end.placement.translation))
        slide = robot.sliding[own]
        return Chain(robot.length, inside & ~slide, inside & slide, reach, between, far, slides)

    def bends(self, r: Array, away: Array) -> Array:
        """Bounds (4, B) on the second-order terms of a place, an attitude and L times a distance; the chain's
        length. All in robot lengths, in boxes of radii r (B, n) with slides out by away (B, nv) at most.
        """
        reach = (self.reach + away @ self.between.T) / self.length
        whole = (self.whole + away @ self.slides) / self.length
        turns, slides = r * self.turning, (r * self.sliding).sum(axis=1)
        lesser = np.minimum(reach[:, :, None], reach[:, None])
        curved = 0.5 * np.einsum("bi,bij,bj->b", turns, lesser, turns)
        total = turns.sum(axis=1)
        place = curved + total * slides
        moved = (turns * reach).sum(axis=1) + slides
        return np.array([place, 0.5 * total**2, (whole * place + 0.5 * moved**2) * self.length, whole])


def _slides_of(robot: ParallelRobot, joint: int) -> IntArray:
    first, count = robot.model.joints[joint].idx_v, robot.model.joints[joint].nv
    columns = np.arange(first, first + count)
    return columns[robot.sliding[columns]]
