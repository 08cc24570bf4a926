"""The equations of platform and loops as terms along chains of joints, for bounds over boxes.

A loop equation is made of vectors that turn: the axis of a frame, and the point of another one. A chain is
what carries the second frame as seen from the first. Written down once a robot, for `derivative_bounds`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform
from framework.kinematics.tree_model import is_ball
from framework.model.loop_rows import LoopRows
from framework.tolerances import FILE_ROUNDING

BASE = -1  # in place of a frame


def moving_balls(robot: ParallelRobot) -> list[str]:
    """Return the names of the ball joints that move with the platform."""
    model, moving = robot.model, set(robot.moving.tolist())
    return [
        str(name)
        for name, joint in zip(model.names, model.joints, strict=True)
        if is_ball(joint) and not moving.isdisjoint(range(joint.idx_v, joint.idx_v + 3))
    ]


class Chain(NamedTuple):
    """The joints that move, from one frame to another one."""

    first: int  # frame, as index into Mechanism.frames, or BASE
    second: int
    places: IntArray  # (L,) among the `moving` columns
    columns: IntArray  # (L,) of pinocchio's velocity vector
    signs: Array  # (L,) -1 where the joint carries the first frame
    turns: BoolArray  # (L,)

    @property
    def outer(self) -> IntArray:
        """(L, L) the later one of two joints."""
        own = np.arange(len(self.places))
        return np.asarray(np.maximum(own[:, None], own))


class Term(NamedTuple):
    """The part of one chain in an equation."""

    row: int
    chain: int
    kind: str  # point: axis . p; direction: axis . (axis of the second frame); distance; turn; joint
    axis: int  # of the first frame
    selected: int  # axis of the second frame, or place of the joint
    factor: float  # of the equation; 1 / length of a distance


@dataclass(frozen=True, eq=False)
class EquationTerms:
    """The terms of all equations along the chains of a robot."""

    robot: ParallelRobot
    chains: list[Chain]
    terms: list[Term]

    @staticmethod
    def of(robot: ParallelRobot) -> EquationTerms:
        """Collect the terms of platform and loops."""
        table = EquationTerms(robot, [], [])
        platform, loops, n = robot.platform, robot.loops, robot.n
        chain = table.chain(BASE, 0)
        for k in range(n):
            if isinstance(platform, FramePlatform):
                kind = "point" if robot.translations[k] else "turn"
                table.terms.append(Term(k, chain, kind, int(platform.axes[k]) % 3, 0, 1.0))
            else:
                place = int(np.flatnonzero(robot.moving == platform.columns[k])[0])  # type: ignore[attr-defined]
                table.terms.append(Term(k, chain, "joint", 0, place, 1.0))
        on_base = _rows_on_base(robot, table)
        for row in range(len(loops.names)):
            first, second = int(loops.first[row]), int(loops.second[row])
            if row in on_base:
                for frame, sign in ((second, 1.0), (first, -1.0)):
                    own = table.chain(BASE, frame)
                    table.terms.append(Term(n + row, own, "point", on_base[row], 0, sign))
                continue
            kind = _kind(loops, row)
            factor = {"distance": 1.0 / (loops.length[row] or 1.0), "direction": float(loops.sign[row])}
            axes = int(loops.first_axis[row]), int(loops.second_axis[row])
            own = table.chain(first, second)
            table.terms.append(Term(n + row, own, kind, *axes, factor.get(kind, 1.0)))
        return table

    def chain(self, first: int, second: int) -> int:
        """Return the index of a chain, which is added where it is new."""
        for place, chain_known in enumerate(self.chains):
            if (chain_known.first, chain_known.second) == (first, second):
                return place
        model, bodies = self.robot.model, scratch_of(self.robot).bodies
        first_joints = [] if first == BASE else list(model.supports[int(bodies[first])])
        second_joints = list(model.supports[int(bodies[second])])
        back = [j for j in reversed(first_joints) if j not in second_joints]
        ahead = [j for j in second_joints if j not in first_joints]
        place_of = {int(column): place for place, column in enumerate(self.robot.moving)}
        both = [(int(model.joints[j].idx_v), -1.0) for j in back if j]
        both += [(int(model.joints[j].idx_v), 1.0) for j in ahead if j]
        both = [(column, sign) for column, sign in both if column in place_of]
        columns = np.array([column for column, _ in both], dtype=np.intp)
        places = np.array([place_of[int(column)] for column in columns], dtype=np.intp)
        signs = np.array([sign for _, sign in both], dtype=float)
        self.chains.append(Chain(first, second, places, columns, signs, ~self.robot.sliding[columns]))
        return len(self.chains) - 1


def planar_axis(robot: ParallelRobot) -> int | None:
    """Return the base axis that is the normal of a planar robot; None for any other."""
    normal = planar_normal(robot)
    if normal is None:
        return None
    axis = int(np.argmax(np.abs(normal)))
    aside = np.delete(normal, axis)
    return axis if np.abs(aside).max() < FILE_ROUNDING else None


def _kind(loops: LoopRows, row: int) -> str:
    """Return the kind of term of a loop equation."""
    if loops.distance[row]:
        return "distance"
    return "direction" if loops.rotation[row] else "point"


def _rows_on_base(robot: ParallelRobot, table: EquationTerms) -> dict[int, int]:
    """Return axes of the base for the rows of points that are to coincide, where no joint carries both."""
    loops, across = robot.loops, planar_axis(robot)
    carried = scratch_of(robot).carried[:, robot.moving]
    base_axes: dict[int, int] = {}
    points = ~(loops.rotation | loops.distance)
    for first, second in sorted({(int(a), int(b)) for a, b in zip(loops.first, loops.second, strict=True)}):
        if (carried[first] * carried[second]).any():
            continue
        rows = np.flatnonzero(points & (loops.first == first) & (loops.second == second))
        closing = np.flatnonzero((robot.rows.first == first) & (robot.rows.second == second))
        closing = closing[~(robot.rows.rotation | robot.rows.distance)[closing]]
        axes = [k for k in range(3) if k != across]
        if len(closing) == 3 and len(rows) == len(axes):
            base_axes |= dict(zip(rows.tolist(), axes, strict=True))
    return base_axes
