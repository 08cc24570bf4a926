"""The region in which a locus is followed: about a pose, in one working mode or all; and starts in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, join, select
from framework.kinematics.frames import difference, frames_at
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import leg_determinants
from framework.locus.curve_tracing import Curve, Points
from framework.locus.locus_equations import LocusEquations
from framework.locus.special_points import root_between
from framework.tolerances import RANK_ROUNDING

WAY_STEPS = 10  # to a start
NEWTON_STEPS, MAX_JOINT_STEP = 6, 0.7  # in each of these; [rad, lengths] of one
MAX_ROTATION = 3.0  # [rad] of a rotation vector: its chart ends at pi
# of the last determinant in a working mode: what is left of it where a curve is cut
CUT_CLEARANCE_RATIO = 1e-3


class Region(NamedTuple):
    """The part of the configuration space in which curves are followed."""

    equations: LocusEquations
    q: Array  # (nq,) its centre
    x: Array  # (n,)
    reach: float  # [m]
    mode: Array | None  # (legs,) signs of the only working mode that counts

    def contains(self, q: Array) -> BoolArray:
        """Whether configurations (T, nq) are in the region, (T,)."""
        robot = self.equations.robot
        x = robot.platform.coordinates(frames_at(robot, q))
        turns = x[:, ~robot.translations]
        inside = (turns.shape[1] < 3) | (np.linalg.norm(turns, axis=1) < MAX_ROTATION)
        off = (x - self.x)[:, robot.translations]
        if self.equations.in_motors:
            moving = self.equations.robot.actuated[list(self.equations.free)]
            off = difference(robot, self.q, q)[:, moving[robot.sliding[moving]]]
        inside &= np.abs(off).max(axis=1, initial=0.0) < self.reach
        if self.mode is None:
            return inside
        return inside & (self.clearance(q) > -RANK_ROUNDING)

    def clearance(self, q: Array) -> Array:
        """Compute the least determinant of a leg (T,) at q (T, nq), negative beyond the working mode."""
        robot = self.equations.robot
        linearised = linearised_at(robot, q, None)
        mode = np.ones(1) if self.mode is None else self.mode
        return (leg_determinants(robot, linearised) * mode).min(axis=1)

    def clip(self, curve: Curve) -> Curve:
        """Return the part of a curve in the working mode, which ends next to a Type 1 singularity."""
        points = curve.points
        if self.mode is None or len(points.q) < 2:
            return curve
        clear = self.clearance(points.q)
        clipped = points
        for end, last, inner in ((0, 0, 1), (1, -1, -2)):
            if curve.ends[end] != "left" or clear[last] >= 0 or clear[inner] <= 0:
                continue
            inside, outside = points.single(inner), points.single(last)
            if end == 0:  # the region is entered: seen from its inside, the other way round
                inside, outside = inside.reverse(), outside.reverse()
            edge = self._edge(inside, outside, CUT_CLEARANCE_RATIO * float(clear[inner]))
            clipped = select(clipped, slice(None, -1) if end else slice(1, None))
            if edge is not None:
                clipped = join([clipped, edge] if end else [edge.reverse(), clipped])
        return Curve(clipped, curve.ends)

    def _edge(self, inside: Points, outside: Points, margin: float) -> Points | None:
        """Find the point between two neighbours at which the clearance is a margin."""

        def excess(point: Points) -> float:
            return float(self.clearance(point.q)[0]) - margin

        return root_between(self.equations, inside, outside, excess, small=0.1 * margin)


def draw_in_mode(region: Region, count: int, seed: int) -> Array:
    """Draw configurations (count, nq) of the region's working mode, led from its centre to random targets.

    All take their steps together; a configuration that cannot take a step stays.
    """
    equations, robot = region.equations, region.equations.robot
    axes = list(equations.free) if not equations.in_motors else list(range(robot.n))
    spread = np.where(robot.translations[axes], region.reach, np.pi)
    x = np.repeat(region.x[None], count, axis=0)
    target = x.copy()
    target[:, axes] += np.random.default_rng(seed).uniform(-spread, spread, (count, len(axes)))
    q = np.repeat(region.q[None], count, axis=0)
    for k in range(1, WAY_STEPS + 1):
        step = x + k / WAY_STEPS * (target - x)
        reached, _, closed = close_each(robot, step, q, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
        closed[closed] &= region.contains(reached[closed])
        q = np.where(closed[:, None], reached, q)
    return q


def draw_joints(equations: LocusEquations, q: Array, count: int, seed: int) -> Array:
    """Draw configurations (count, nq) to search from: hinges anywhere, slides about q (nq,)."""
    columns, rng = equations.robot.moving, np.random.default_rng(seed)
    spread = np.where(equations.robot.sliding[columns], 1.0, np.pi)
    offsets = rng.uniform(-spread, spread, (count, len(columns)))
    return equations.move(np.repeat(q[None], count, axis=0), offsets)
