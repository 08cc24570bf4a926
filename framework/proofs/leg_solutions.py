"""All configurations for given motors, a given platform or both, leg by leg.

Newton's method closes the loops from many starts. The distinct solutions of each leg (`split_legs`) are
combined, a leg after those on which it depends, in every way that closes the loops. If a leg has at most four
joints, at most one of them a slide, paving the joints proves that it has no other solutions (`leg_paving`).

Solutions count once if all that a robot shows is the same: positions of motors, origins of frames, lines of
joints. A universal joint may turn over, its first hinge by half a turn. Then the rod behind it has turned by
half a turn about its own line, its axes point the other way, and every line is where it was.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.kinematics.closures import direction_gaps, scaled_equations
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate_columns, tree_columns
from framework.kinematics.inverse_kinematics import remove_idle_spin
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import Leg, split_legs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, select
from framework.proofs.leg_paving import are_leg_solutions_complete
from framework.proofs.passive_joints import (
    RANDOM_STARTS,
    close_all_loops,
    distinct_rows,
    draw_starts,
    shortest_offset,
)
from framework.tolerances import LOOP_GAP, SAME_PLACE

MAX_COMBINATIONS = 512  # of one solution for each leg


class LegSolutions(NamedTuple):
    """Configurations with closed loops and without flipped closures, by one solution of each leg."""

    q: Array  # (T, nq) distinct in what they show
    legs: tuple[Leg, ...]
    counts: tuple[int, ...]  # solutions of each leg
    complete: tuple[bool, ...]  # whether each leg has no other solutions beside the legs it depends on
    truncated: bool  # whether there are more combinations than were tested

    @property
    def are_all(self) -> bool:
        """Whether there are provably no other configurations."""
        if self.truncated:
            return False
        impossible = (not count and done for count, done in zip(self.counts, self.complete, strict=True))
        return all(self.complete) or any(impossible)


def solve_legs(
    robot: ParallelRobot, q: Array, columns: IntArray, x: Array | None, *, start_count: int = RANDOM_STARTS
) -> LegSolutions:
    """Find all positions of joints that close the loops, and solve the platform's equations if x is given.

    A leg is a set of joints with the equations that determine these once the joints that it needs, of other
    legs, have their positions (`split_legs`).

    Args:
        q: (nq,) configuration in which the joints that move are as at the reference; the others stay.
        columns: (k,) of the joints that move.
        x: (n,) platform coordinates; None leaves the platform free.
        start_count: number of starts of Newton's method.
    """
    first_row = robot.n if x is None else 0  # without the platform's equations
    legs = split_legs(robot, np.arange(first_row, len(robot.equations.pattern)), columns)
    solutions = _search_solutions(robot, q, columns, legs, x, start_count)

    # combine the solutions, a leg after those on which it depends
    configurations = q[None]  # (C, nq) of the legs combined so far
    counts = [0] * len(legs)
    truncated = False
    pending = columns  # of the legs that are not combined yet
    for k in sorted(range(len(legs)), key=lambda k: len(legs[k].needed)):
        leg, own = legs[k], columns[legs[k].columns]
        steps = solutions[k] * robot.column_scale[own]  # (S, joints) [rad, m]
        pending = np.setdiff1d(pending, own)
        if len(leg.needed):  # whether a solution closes depends on the configuration of the other legs
            tried = _set_joints(robot, configurations, own, steps)  # (C S, nq)
            closed = _closed_and_distinct(robot, tried, leg.rows, pending, x)
            configurations = tried[closed]
            counts[k] = len(np.unique(closed % len(steps)))  # solutions that close in any configuration
        else:  # a solution closes in all configurations or in none
            alone = _set_joints(robot, q[None], own, steps)  # (S, nq)
            closed = _closed_and_distinct(robot, alone, leg.rows, np.setdiff1d(columns, own), x)
            configurations = _set_joints(robot, configurations, own, steps[closed])
            counts[k] = len(closed)
        truncated |= len(configurations) > MAX_COMBINATIONS
        configurations = configurations[:MAX_COMBINATIONS]

    complete = [
        _is_leg_complete(robot, leg, columns, leg_solutions, configurations, q, x)
        for leg, leg_solutions in zip(legs, solutions, strict=True)
    ]
    # the legs have the independent loop equations; the redundant ones have to close, too
    gaps = scaled_equations(robot, robot.rows, frames_at(robot, configurations)).residual
    is_closed = np.abs(gaps).max(axis=1, initial=0.0) < LOOP_GAP
    return LegSolutions(configurations[is_closed], legs, tuple(counts), tuple(complete), truncated)


def _set_joints(robot: ParallelRobot, configurations: Array, own: IntArray, steps: Array) -> Array:
    """Move the joints `own` of C configurations by each of S `steps`; return (C S, nq)."""
    repeated = np.repeat(configurations, len(steps), axis=0)
    return integrate_columns(robot, repeated, own, np.tile(steps, (len(configurations), 1)))


def _closed_and_distinct(
    robot: ParallelRobot, q: Array, rows: IntArray, pending: IntArray, x: Array | None
) -> IntArray:
    """Return the indices of distinct q (T, nq) that close `rows` and flip no closure.

    Distinct are `shown_places`. What the joints of the `pending` columns move does not count.
    """
    is_closed = _gaps(robot, q, x)[:, rows].max(axis=1, initial=0.0) < LOOP_GAP
    frames = frames_at(robot, q)
    first, second, *_ = robot.directions
    is_placed = _is_placed(frames, pending)
    directions = select(robot.directions, is_placed[first] & is_placed[second])
    flips = np.linalg.norm(direction_gaps(directions, frames), axis=2)  # (T, d) 0, or sqrt(2) and more
    candidates = np.flatnonzero(is_closed & (flips.max(axis=1, initial=0.0) < 1.0))
    return candidates[distinct_rows(shown_places(robot, q[candidates], pending))]


def _is_placed(frames: FrameStack, pending: IntArray) -> BoolArray:
    """Return which frames (F,) no joint of the `pending` columns carries."""
    return np.all(frames.carried[:, pending] == 0.0, axis=1)


def shown_places(robot: ParallelRobot, q: Array, pending: IntArray | tuple[()] = ()) -> Array:
    """Compute numbers (T, d) that agree if two configurations q (T, nq) show the same.

    The numbers are dimensionless: positions of motors and of joints that are platform coordinates, origins of
    frames, the platform's attitude if it has coordinates, and the line of each joint. A line is given by the
    projector on its screw, which is the same for both directions of an axis; a ball, by the projector on its
    three screws, which is the same for any axes.

    Args:
        pending: columns of joints that are not placed; what they move is left out.
    """
    frames = frames_at(robot, q)
    tree = tree_columns(robot)
    unplaced = np.array(pending, dtype=int)
    screws = frames.screws / np.repeat([robot.length, 1.0], 3)  # (T, nv, 6)
    screws[:, np.any(tree.precedes[unplaced], axis=0)] = 0.0
    parts = []
    for own in _joints_and_balls(robot):
        S = screws[:, own].swapaxes(1, 2)  # (T, 6, joints)
        parts.append(S @ np.linalg.pinv(S))

    is_placed = _is_placed(frames, unplaced)
    parts.append(frames.position[:, is_placed] / robot.length)
    if is_placed[0] and not robot.translations.all():
        parts.append(frames.platform_rotation)
    stated = np.union1d(robot.actuated, getattr(robot.platform, "columns", robot.actuated))
    turns = np.exp(1j * difference(robot, robot.reference.q, q) / robot.column_scale)
    turns = turns[:, np.setdiff1d(stated, unplaced)]
    parts += [turns.real, turns.imag]
    return np.hstack([part.reshape(len(q), np.prod(part.shape[1:], dtype=int)) for part in parts])


@lru_cache(maxsize=16)
def _joints_and_balls(robot: ParallelRobot) -> list[IntArray]:
    """Return the columns of each joint; three passive hinges or more through a point are one ball.

    Files model balls so. Nothing else is fixed to the links between such hinges.
    """
    model = robot.model
    parents = model.parents.tolist()
    single = {model.joints[j].idx_v for j in range(1, model.njoints) if model.joints[j].nv == 1}
    hinges = single.difference(robot.actuated.tolist(), np.flatnonzero(robot.sliding).tolist())
    is_hinge = [joint.idx_v in hinges for joint in model.joints]  # passive, by joint
    carries_frame = {model.frames[frame].parentJoint for frame in robot.frames}
    chains: list[list[int]] = []  # of hinges, each through a point of the one before; or one other joint
    for j in range(1, model.njoints):
        before = j - 1
        is_next_hinge = before > 0 and parents[j] == before and is_hinge[j] and is_hinge[before]
        is_only_child = parents.count(before) == 1 and before not in carries_frame
        distance = np.linalg.norm(model.jointPlacements[j].translation)  # [m] of both joints
        if is_next_hinge and is_only_child and distance <= SAME_PLACE * robot.length:
            chains[-1].append(j)
        else:
            chains.append([j])
    groups: list[list[int]] = []
    for chain in chains:
        groups += [chain] if len(chain) >= 3 else [[j] for j in chain]
    owner = tree_columns(robot).owner
    return [np.flatnonzero(np.isin(owner, group)) for group in groups]


def _search_solutions(
    robot: ParallelRobot,
    q: Array,
    columns: IntArray,
    legs: tuple[Leg, ...],
    x: Array | None,
    start_count: int,
) -> list[Array]:
    """Search the solutions (S, joints) of each leg, the nearest to the reference first.

    Solutions are offsets of the joints from the reference [rad, robot lengths]. A leg may close from a start
    from which others do not.
    """

    def platform_equations(frames: FrameStack) -> tuple[Array, Array]:
        """Compute dimensionless offsets (T, n) of the platform from x, and their slopes (T, n, nv)."""
        if x is None:
            return np.empty((len(frames.q), 0)), np.empty((len(frames.q), 0, robot.nv))
        offsets = robot.platform.residual(frames, np.tile(x, (len(frames.q), 1))) / robot.platform_scale
        slopes = robot.platform.jacobian(frames) * robot.column_scale
        return offsets, slopes / robot.platform_scale[:, None]

    starts = draw_starts(robot, q, columns, start_count)
    ends, closed = close_all_loops(robot, starts, columns, platform_equations)
    if len(robot.structure.idle):  # an idle spin would make equal solutions differ
        ends = ends[closed]
        platform = robot.platform.coordinates(frames_at(robot, ends))
        ends = remove_idle_spin(robot, robot.reference.q, ends, platform)
    gaps = _gaps(robot, ends, x)  # (S, n + m)
    offsets = (shortest_offset(robot, ends) / robot.column_scale)[:, columns]

    solutions = []
    for leg in legs:
        earlier = [other.rows for other in legs if np.isin(other.columns, leg.needed).any()]
        rows = np.concatenate([leg.rows, *earlier])
        joints = offsets[gaps[:, rows].max(axis=1, initial=0.0) < LOOP_GAP][:, leg.columns]
        joints = joints[np.argsort(np.linalg.norm(joints, axis=1), kind="stable")]
        solutions.append(joints[distinct_rows(np.exp(1j * joints))])
    return solutions


def _gaps(robot: ParallelRobot, q: Array, x: Array | None) -> Array:
    """Compute the absolute residuals (T, n + m) of platform and loops [robot lengths, rad] at q (T, nq)."""
    residual = linearised_at(robot, q, None if x is None else np.tile(x, (len(q), 1))).residual
    return np.asarray(np.abs(residual / np.concatenate([robot.platform_scale, robot.loop_lengths])))


def _is_leg_complete(
    robot: ParallelRobot,
    leg: Leg,
    columns: IntArray,
    solutions: Array,
    configurations: Array,
    q: Array,
    x: Array | None,
) -> bool:
    """Return whether a leg of k joints provably has no solutions besides `solutions` (s, k).

    Solutions are offsets from the reference [rad, robot lengths]. The legs on which this leg depends are
    placed as in each of the `configurations` (C, nq) in turn. Without any, C = 0, the proof is that the leg
    has no solution at all. It is made only for a leg that depends on no other one, and only for a platform
    without attitude, because no configuration shows where other legs and the attitude are.
    """
    own = columns[leg.columns]
    previous = columns[leg.needed]
    fixed = np.ones(robot.nv, dtype=bool)  # joints that the proof keeps where they are
    fixed[columns] = False
    fixed[previous] = True
    if not len(configurations):
        if len(previous) or len(solutions) or (x is not None and not robot.platform.is_point):
            return False
        return are_leg_solutions_complete(robot, own, fixed, q, solutions, x)
    if x is not None and robot.sliding[own].all():  # x is affine in slides
        slopes = robot.platform.jacobian(frames_at(robot, configurations))[:, :, own]  # (C, n, k)
        return len(solutions) == 1 and bool((np.linalg.matrix_rank(slopes) == len(own)).all())
    offsets = shortest_offset(robot, configurations) / robot.column_scale
    # configurations with the same placement of the previous legs need one proof
    return all(
        are_leg_solutions_complete(robot, own, fixed, configurations[k], solutions - offsets[k, own], x)
        for k in distinct_rows(np.exp(1j * offsets[:, previous]))
    )
