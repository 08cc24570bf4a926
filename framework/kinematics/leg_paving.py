"""Proof that the joints of a leg have no other solutions: their angles are paved (`linalg.paving`).

The equations are those of loops whose joints are the leg's or given, and of the platform's place and
attitude; how far they bend is bounded along their chains of joints (`chain_bends`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.chain_bends import Chain
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import between, cross, frames_at, integrate, scratch_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.linalg.paving import Known, Linearised, has_no_others

MOST_JOINTS = 4
PARTS = 2  # of a whole turn, to begin with
ALIKE = 1e-9  # equations that are met
ROUNDING = 1e-12  # of an equation, in lengths of its chain: ten thousand units of rounding
WIDEST = 0.5  # [rad, lengths] of a region in which a solution is the only one
SEED = 5


def joints_have_no_others(
    robot: ParallelRobot, own: IntArray, given: BoolArray, q: Array, near: Array, x: Array | None
) -> bool:
    """Whether joints are proved to have no values but those given; False if it is not known.

    Args:
        own: columns of the velocity vector that are theirs.
        given: (nv,) columns that keep the values which they have in q (nq,), assembled if x determines more
            than places.
        near: (k, n) the joints' values from those in q, in radians and robot lengths; of these the solutions
            count.
        x: (n,) coordinates of the platform; None with locked motors.
    """
    slides = robot.sliding[own]
    if len(own) > MOST_JOINTS or slides.sum() > 1 or not _has_single_columns(robot, own):
        return False
    equations = _Equations.of(robot, own, given, q, x)
    if not equations.count:
        return False
    points = near[np.abs(equations(near, 0.0 * near).values).max(axis=1) < ALIKE]
    cell = np.pi / PARTS
    ticks = [np.arange(-np.pi + cell, np.pi, 2 * cell)] * int((~slides).sum())
    radii = np.full(len(own), cell)
    if slides.any():
        farthest = equations.farthest_slide()
        if farthest is None:
            return False
        ticks.insert(int(np.argmax(slides)), -equations.value_of_slides()[own[slides]] / robot.length)
        radii[slides] = farthest
    centers = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(own))
    period = np.where(slides, np.inf, 2 * np.pi)
    known = Known(points, np.array([equations.lonely_radius(point) for point in points]), period)
    return has_no_others(equations, centers, np.repeat(radii[None], len(centers), axis=0), known)


def _has_single_columns(robot: ParallelRobot, own: IntArray) -> bool:
    joints = [robot.model.joints[j] for j in range(1, robot.model.njoints)]
    return all(any(joint.nv == 1 and joint.idx_v == column for joint in joints) for column in own)


@dataclass(frozen=True, eq=False)
class _Equations:
    """The equations of a leg, all other joints as in q; its own in radians and robot lengths from there."""

    robot: ParallelRobot
    own: IntArray
    q: Array  # (nq,)
    x: Array | None
    loops: IntArray  # of `robot.rows`
    chains: tuple[Chain, ...]  # of the loops, then of the platform's frame if its place counts
    chain_of: IntArray  # (loops,)
    attitude: Array | None  # (3, 3) of the platform's frame, where x determines it

    @staticmethod
    def of(robot: ParallelRobot, own: IntArray, given: BoolArray, q: Array, x: Array | None) -> _Equations:
        """Those equations whose joints are the leg's, or given; the attitude where x determines it."""
        carried, rows = scratch_of(robot).carried, robot.rows
        felt = carried[rows.second] != carried[rows.first]
        other = ~given
        other[own] = False
        loops = np.flatnonzero(felt[:, own].any(axis=1) & ~felt[:, other].any(axis=1))
        pairs = sorted({(int(rows.first[k]), int(rows.second[k])) for k in loops})
        places = [pairs.index((int(rows.first[k]), int(rows.second[k]))) for k in loops]
        chains = [Chain.of(robot, own, *pair) for pair in pairs]
        platform = robot.platform
        if isinstance(platform, JointPlatform):
            x = x if x is not None and np.isin(platform.columns, own).any() else None
        elif x is None or not carried[0, own].any() or carried[0, other].any():
            x = None
        else:
            chains.append(Chain.of(robot, own, None, 0))
        attitude, turns = None, 1 if planar_normal(robot) is not None else 3
        if x is not None and isinstance(platform, FramePlatform) and len(platform.turning) == turns:
            attitude = frames_at(robot, q[None]).rotation[0, 0]
        return _Equations(robot, own, q, x, loops, tuple(chains), np.array(places, dtype=np.intp), attitude)

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self(np.zeros((1, len(self.own))), np.zeros((1, len(self.own)))).values.size)

    def __call__(self, c: Array, r: Array) -> Linearised:
        """The equations in boxes c, r (B, n)."""
        robot, own, length = self.robot, self.own, self.robot.length
        step = np.zeros((len(c), robot.model.nv))
        step[:, own] = c * robot.column_scale[own]
        q = integrate(robot, self.q, step)
        at = frames_at(robot, q)
        away = np.abs(np.where(robot.sliding, between(robot, robot.neutral, q), 0.0))
        away[:, own] += np.where(robot.sliding[own], r * robot.column_scale[own], 0.0)
        rows, chosen = robot.rows, self.loops
        turning, distance = rows.rotation[chosen], rows.distance[chosen]
        equations = loop_equations(rows, at)
        weight = np.where(turning, 1.0, 1.0 / length)
        values = [equations.residual[:, chosen] * weight]
        slopes = [(equations.jacobian[:, chosen] * weight[:, None])[:, :, own]]
        kinds = np.array([chain.bends(r, away) for chain in self.chains]).reshape(len(self.chains), 4, len(c))
        bends = np.where(turning[:, None], kinds[self.chain_of, 1], kinds[self.chain_of, 0])
        ends = np.where(distance, rows.length[chosen], 1.0)[:, None]
        bends = [np.where(distance[:, None], kinds[self.chain_of, 2] / ends, bends).T]
        platform = robot.platform
        if isinstance(platform, JointPlatform) and self.x is not None:
            here, turns = np.isin(platform.columns, own), ~platform.translations
            off, unit = platform.residual(at, self.x) / np.where(turns, 1.0, length), np.eye(robot.model.nv)
            along = unit[platform.columns][:, own] / np.where(turns, 1.0, length)[:, None]
            sine, cosine = np.where(turns, np.sin(off), off), np.where(turns, np.cos(off), 1.0)
            bend = 0.5 * (np.where(turns[:, None], along, 0.0) @ r.T).T ** 2
            for value, slope in ((sine, cosine), (cosine - 1.0, np.where(turns, -np.sin(off), 0.0))):
                values.append(value[:, here])
                slopes.append((slope[:, :, None] * along)[:, here])
                bends.append(bend[:, here])
        elif self.x is not None:
            jacobian = at.jacobian[:, 0][:, :, own]
            values.append((at.position[:, 0, platform.along] - self.x[platform.sliding]) / length)
            slopes.append(jacobian[:, platform.along] / length)
            bends.append(np.repeat(kinds[-1, 0][:, None], len(platform.sliding), axis=1))
        if self.attitude is not None:
            axes = at.rotation[:, 0].swapaxes(1, 2)  # (B, 3, 3), one axis a row
            turned = cross(jacobian[:, None, 3:].swapaxes(2, 3), axes[:, :, None])  # (B, axis, n, 3)
            values.append((axes - self.attitude.T).reshape(len(c), 9))
            slopes.append(turned.swapaxes(2, 3).reshape(len(c), 9, len(own)))
            bends.append(np.repeat(kinds[-1, 1][:, None], 9, axis=1))
        size = ROUNDING * (1.0 + kinds[:, 3].max(axis=0, initial=0.0))
        scaled = np.concatenate(slopes, axis=1) * np.where(robot.sliding[own], length, 1.0)
        return Linearised(
            np.concatenate(values, axis=1), scaled, np.concatenate(bends, axis=1) + size[:, None]
        )

    def lonely_radius(self, point: Array) -> float:
        """The radius of a box about a point (n,) in which the equations have one solution at most.

        The mean of the Jacobian between two points in the box is regular: |Y| times its change is below one.
        """
        one = np.ones((1, len(point)))
        lines = self(point[None], one)
        Y = np.linalg.pinv(lines.slopes[0])
        if np.abs(Y @ lines.slopes[0] - np.eye(len(point))).sum(axis=1).max() > 1e-6:
            return 0.0
        change = 2 * np.abs(Y) @ lines.bends[0]
        return min(0.9 / float(change.max()), WIDEST)

    def value_of_slides(self) -> Array:
        """(nv,) how far the slides are out in q."""
        return np.where(self.robot.sliding, between(self.robot, self.robot.neutral, self.q), 0.0)

    def farthest_slide(self) -> float | None:
        """A bound on the leg's slide [robot lengths]: farther out, no chain closes; None if there is none.

        The translations of a chain change by one unit with its slide, whatever its hinges do.
        """
        rng, n = np.random.default_rng(SEED), len(self.own)
        lines = self(rng.uniform(-2, 2, (3, n)), np.zeros((3, n)))
        along = np.flatnonzero(self.robot.sliding[self.own])[0]
        position = ~self.robot.rows.rotation[self.loops]
        away = np.abs(self.value_of_slides())
        away[self.own[along]] = 0.0
        found = []
        for k, chain in enumerate(self.chains):
            rows = np.flatnonzero(position & (self.chain_of == k))
            if k == len(self.chains) - 1 and self.x is not None:
                rows = len(self.loops) + np.arange(len(self.robot.platform.sliding))
            ends = self.robot.rows.length[self.loops].sum() + (
                0.0 if self.x is None else np.abs(self.x).sum()
            )
            if np.all(np.sum(lines.slopes[:, rows, along] ** 2, axis=1) > 1 - 1e-9):
                found.append((chain.whole + chain.slides @ away + ends) / self.robot.length)
        return 1.01 * min(found) if found else None
