"""Platform and loop equations as sums of terms along chains of joints, for bounds over boxes.

A term is a product of vectors that turn with the joints: an axis of one frame, and an axis or the origin of
another. Its chain is the joints that move the second frame relative to the first. `derivative_bounds`
collects the terms once for each robot, `leg_paving` those of one leg.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import difference, scratch_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform
from framework.kinematics.tree_model import is_ball
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.tolerances import FILE_ROUNDING

BASE = -1  # index that stands for the base in place of a frame


def list_unbounded_joints(robot: ParallelRobot) -> list[str]:
    """Return the moving joints, in words, whose equations have no bounds over boxes.

    These are ball joints, whose coordinates are not angles about successive axes, and couplings of joints.
    """
    moving = set(robot.moving.tolist())
    words = list[str]()
    for name, joint in zip(robot.model.names, robot.model.joints, strict=True):
        columns = range(joint.idx_v, joint.idx_v + joint.nv)
        if is_ball(joint) and not moving.isdisjoint(columns):
            words.append(f"the ball joint {name}")
    if robot.rows.has_couplings:
        words.append("couplings of joints")
    return words


def stretched_length(robot: ParallelRobot, q: Array) -> float:
    """Bound the distance between any two frames [robot lengths] at q (nq,).

    The bound is the length of all links and slides stretched into one line.
    """
    frame_placements = [robot.model.frames[k].placement for k in robot.frames]
    placements = [*robot.model.jointPlacements, *frame_placements]
    link_lengths = sum(np.linalg.norm(placement.translation) for placement in placements)
    slide_lengths = np.abs(difference(robot, robot.neutral, q)[robot.sliding]).sum()
    return float(link_lengths + slide_lengths) / robot.length


Ends = tuple[int, int]  # first and second frame, as indices into Mechanism.frames; the first may be BASE


class Chain(NamedTuple):
    """The L unknown joints between two frames."""

    ends: Ends  # the two frames
    unknowns: IntArray  # (L,) indices of the joints among the unknowns of the equations
    columns: IntArray  # (L,) indices of the joints in pinocchio's velocity vector
    signs: Array  # (L,) -1 where the joint carries the first frame, else 1
    turns: BoolArray  # (L,) whether the joint is a hinge

    def joint_tuples(self, count: int) -> IntArray:
        """Return all tuples of `count` joints (count, L, .., L), each sorted from the first frame on."""
        shape = count * self.columns.shape  # (L, .., L), `count` times
        return np.sort(np.indices(shape), axis=0)


class Term(NamedTuple):
    """The part of one chain in an equation."""

    row: int  # of the equation
    ends: Ends  # of the chain
    kind: str  # point: axis . p; direction: axis . second axis; square: p . p; turn: axis . rotation
    first_axis: int  # of the first frame, 0..2
    second_axis: int = 0  # of the second frame, 0..2, in a direction
    factor: float = 1.0  # of the product


def collect_terms(robot: ParallelRobot) -> list[Term]:
    """Return the terms of all equations; a platform whose coordinates are joints has none.

    The platform's frame has the number 0.
    """
    terms = list[Term]()
    platform = robot.platform
    if isinstance(platform, FramePlatform):
        for coordinate, axis in enumerate(platform.axes.tolist()):  # 0..5: along x, y, z; about x, y, z
            kind = "point" if robot.translations[coordinate] else "turn"
            terms.append(Term(coordinate, (BASE, 0), kind, first_axis=axis % 3))
    base_axes = _rows_on_base(robot)
    for row in range(len(robot.loops.names)):
        number = robot.n + row  # of the equation; those of the platform come first
        if row in base_axes:  # the origin of the second frame less the origin of the first
            for frame, factor in ((robot.loops.second[row], 1.0), (robot.loops.first[row], -1.0)):
                terms.append(Term(number, (BASE, frame), "point", base_axes[row], factor=factor))
        else:
            terms.append(loop_term(robot.loops, row, number))
    return terms


def loop_term(rows: LoopRows, row: int, number: int) -> Term:
    """Return the term of one loop equation, along the chain between both frames.

    The term is the product of an axis of the first frame with an axis of the second frame (direction) or with
    its origin (point), or the squared distance between the origins (square). Loop equation `row` gets the
    `number` among all equations of the caller.
    """
    kind = "square" if rows.square[row] else "point"
    if rows.rotation[row]:
        kind = "direction"
    ends = rows.first[row], rows.second[row]
    return Term(number, ends, kind, rows.first_axis[row], rows.second_axis[row], rows.weight[row])


def chain_between(robot: ParallelRobot, ends: Ends, unknowns: IntArray) -> Chain:
    """Return the chain of unknown joints between two frames, `ends` (first, second).

    `unknowns` (k,) are columns of the velocity vector. All other joints count as fixed.
    """
    first, second = ends
    supports = robot.model.supports
    bodies = scratch_of(robot).bodies
    # joints from the base to each frame; joint 0 is the base. Joints that carry both frames do not move them
    # relative to each other
    first_chain = [] if first == BASE else list(supports[int(bodies[first])])
    second_chain = list(supports[int(bodies[second])])
    carrying_first = [(joint, -1.0) for joint in reversed(first_chain) if joint not in second_chain]
    carrying_second = [(joint, 1.0) for joint in second_chain if joint and joint not in first_chain]

    columns = unknowns.tolist()
    indices = list[int]()
    signs = list[float]()
    for joint, sign in carrying_first + carrying_second:
        column = robot.model.joints[joint].idx_v
        if column in columns:
            indices.append(columns.index(column))
            signs.append(sign)
    chosen = np.array(indices, dtype=np.intp)
    return Chain(ends, chosen, unknowns[chosen], np.array(signs), ~robot.sliding[unknowns[chosen]])


def planar_axis(robot: ParallelRobot) -> int | None:
    """Return the base axis (0..2) normal to a planar robot; None without such an axis."""
    normal = planar_normal(robot)
    if normal is None:
        return None
    axis = int(np.argmax(np.abs(normal)))
    return axis if np.abs(np.delete(normal, axis)).max() < FILE_ROUNDING else None


def _rows_on_base(robot: ParallelRobot) -> dict[int, int]:
    """Return the base axis (0..2) for each loop row that is written on a base axis.

    These are the rows of closures that lock all translations (of a planar robot, both in the plane) between
    frames without a common moving joint. Such equations are equivalent on any three axes. On the axes of the
    base no second derivative mixes joints of the two chains. Rows are indices among the independent loop
    equations, `robot.loops`; `robot.rows` are all of them, with redundant ones.
    """
    loops = robot.loops
    normal = planar_axis(robot)
    axes = [k for k in range(3) if k != normal]
    carried = scratch_of(robot).carried[:, robot.moving]  # (frames, k) whether a joint carries a frame
    base_axes: dict[int, int] = {}
    for ends in set(zip(loops.first.tolist(), loops.second.tolist(), strict=True)):
        if carried[list(ends)].all(axis=0).any():  # a joint carries both frames
            continue
        rows = _translation_rows(loops, ends)
        if len(_translation_rows(robot.rows, ends)) == 3 and len(rows) == len(axes):
            base_axes |= dict(zip(rows, axes, strict=True))
    return base_axes


def _translation_rows(rows: LoopRows, ends: Ends) -> list[int]:
    """Return the rows that lock translations between two frames."""
    return np.flatnonzero(rows.translation & (rows.first == ends[0]) & (rows.second == ends[1])).tolist()
