"""The passive joints of a robot with its motors locked: those of a pose of the platform, and their proof.

Newton's method on the loops, redundant ones too, from many starts at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.closures import loop_equations, scale_jacobian
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate, integrate_columns
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import equation_sizes, passive_matrix, type1_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.rotations import wrap_angles
from framework.proofs.equation_terms import stretched_length
from framework.tolerances import DISTINCT_SOLUTIONS, FRAME_ROUNDING, LOOP_GAP, RANK_ROUNDING

RANDOM_STARTS = 24  # for each pose of the platform
MAX_SEARCH_STEPS, MAX_SEARCH_STEP = 40, 0.6  # of Newton's method; [rad, lengths] that one may move a joint
RANDOM_SEED = 11
MAX_INVERSE_DEFECT = 0.1  # largest row sum of |X M - 1| of an inverse X that a proof uses
INVERSE_FACTOR = 1.2  # of its norm: more than 1 / (1 - MAX_INVERSE_DEFECT)


def joints_at(robot: ParallelRobot, q: Array, place: Array, turn: Array | None) -> list[Array | None]:
    """Find joints (nq,) that bring the platform's frame to places (k, 3), turns (k, 3, 3), or None.

    Motors and springs stay as in q (1, nq). Of several joint angles at one pose those next to the reference.
    """
    count = len(place)
    places = np.repeat(place, RANDOM_STARTS, axis=0)
    turns = None if turn is None else np.repeat(turn, RANDOM_STARTS, axis=0)

    def pose_rows(frames: FrameStack) -> tuple[Array, Array]:
        """Compute the offset of the frame from the poses, (S, 3 or 6), and its slopes.

        Attitudes differ by the axial vector of (G - G^T) / 2, with G = R R_target^T.
        """
        off, slopes = frames.position[:, 0] - places, frames.frame_jacobian(0) * robot.column_scale
        if turns is None:
            return off / robot.length, slopes[:, :3] / robot.length
        gap = frames.rotation[:, 0] @ turns.swapaxes(1, 2)
        turned = 0.5 * (gap - gap.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]]
        # a half turn has no sine either: it is told from none by the trace
        turned[:, 0] += np.where(np.trace(gap, axis1=1, axis2=2) < 0, 1.0, 0.0)
        slopes[:, :3] /= robot.length
        return np.concatenate([off / robot.length, turned], axis=1), slopes

    poses, closed = close_all_loops(
        robot, np.tile(random_starts(robot, q, RANDOM_STARTS), (count, 1)), pose_rows
    )
    nearest_poses: list[Array | None] = []
    for k in range(count):
        starts_of = slice(k * RANDOM_STARTS, (k + 1) * RANDOM_STARTS)
        candidates = nearest_turn(robot, poses[starts_of][closed[starts_of]])
        nearest_poses.append(min(candidates, key=partial(distance_from_reference, robot), default=None))
    return nearest_poses


def close_all_loops(
    robot: ParallelRobot,
    q: Array,
    more: Callable[[FrameStack], tuple[Array, Array]] | None,
    columns: IntArray | None = None,
) -> tuple[Array, BoolArray]:
    """Close the loops by Newton's method from q (T, nq); return configurations (T, nq), and which are closed.

    Args:
        columns: the joints that move; the passive ones by default.
        more: further equations and their slopes along all joints, (T, e) and (T, e, nv), without dimension.
    """
    columns, size = robot.following if columns is None else columns, np.full(len(q), np.inf)
    weights = 1.0 / robot.row_lengths
    last = False
    for _ in range(MAX_SEARCH_STEPS):
        frames = frames_at(robot, q)
        loops = loop_equations(robot.rows, frames)
        values, slopes = loops.residual * weights, scale_jacobian(robot, loops.jacobian, robot.rows.rotation)
        if more is not None:
            added = more(frames)
            values, slopes = np.hstack([values, added[0]]), np.hstack([slopes, added[1]])
        size = np.abs(values).max(axis=1)
        if last or not len(q):
            break
        last = bool((size < LOOP_GAP).all())  # and one step more, to rounding
        inverse = np.linalg.pinv(slopes[:, :, columns], rcond=RANK_ROUNDING)
        change = -np.matvec(inverse, values)
        change /= np.maximum(np.abs(change).max(axis=1, keepdims=True) / MAX_SEARCH_STEP, 1.0)
        q = integrate_columns(robot, q, columns, change * robot.column_scale[columns])
    return q, size < LOOP_GAP


def random_starts(robot: ParallelRobot, q: Array, count: int, columns: IntArray | None = None) -> Array:
    """Draw configurations (count, nq): q (1, nq), and others with joints (the passive ones) anywhere."""
    columns = robot.passive if columns is None else columns
    spread = np.where(robot.sliding[columns], robot.length, np.pi)
    others = np.random.default_rng(RANDOM_SEED).uniform(-spread, spread, (count - 1, len(spread)))
    return integrate_columns(robot, q, columns, np.concatenate([np.zeros((1, len(spread))), others]))


def shortest_offset(robot: ParallelRobot, q: Array, columns: IntArray) -> Array:
    """Compute offsets (..., nv) of q (..., nq) from the reference, hinges in `columns` below half a turn."""
    offset = difference(robot, robot.reference.q, q)
    hinges = columns[~robot.sliding[columns]]
    offset[..., hinges] = wrap_angles(offset[..., hinges])
    return offset


def nearest_turn(robot: ParallelRobot, q: Array) -> Array:
    """Return the same configurations (..., nq), passive hinges less than half a turn from the reference."""
    return integrate(robot, robot.reference.q, shortest_offset(robot, q, robot.passive))


def distance_from_reference(robot: ParallelRobot, q: Array) -> float:
    """Compute the distance of a configuration (nq,) from the reference [rad, lengths]."""
    return float(np.linalg.norm(difference(robot, robot.reference.q, q) / robot.column_scale))


def is_proved(robot: ParallelRobot, q: Array, *, locked: str = "motors") -> bool:
    """Whether the loops have one solution near q (nq,), by the theorem of Newton and Kantorovich.

    The motors are locked, or the platform is (`locked`), and the springs. beta^2 K |F| <= 1/2 with F the loop
    equations (and the platform's), beta the norm of the inverse of their Jacobian and K a bound on its
    change: no joint turns a frame that is farther away than all links are long, and an equation is a product
    of two vectors that turn. All in radians and lengths of the robot, norms of largest entries.
    """
    linearised = linearised_at(robot, q[None], None)
    matrix = (passive_matrix if locked == "motors" else type1_matrix)(robot, linearised)[0]
    if matrix.shape[0] != matrix.shape[1]:
        return False
    inverse = np.linalg.pinv(matrix)
    if np.abs(inverse @ matrix - np.eye(len(matrix))).sum(axis=1).max() > MAX_INVERSE_DEFECT:
        return False
    values = float(np.abs(linearised.residual[0] / equation_sizes(robot))[robot.n :].max())
    size = stretched_length(robot, q) + 1.0  # with a length to spare for slides near by
    units = np.where(robot.loops.square, robot.length, 1.0)
    steepest = np.abs(robot.loops.derivative_weight * units).max(initial=1.0)
    bend = 8.0 * size**2 * steepest / robot.structure.row_sizes.min(initial=1.0)
    beta = INVERSE_FACTOR * float(np.abs(inverse).sum(axis=1).max())
    return bool(beta**2 * len(matrix) ** 2 * bend * (values + FRAME_ROUNDING * size) <= 0.5)


def distinct_rows(joints: Array) -> list[int]:
    """Return the indices of the rows of (T, k) that repeat no earlier row, hinges up to whole turns."""
    distinct: list[int] = []
    for k, turns in enumerate(np.exp(1j * joints)):
        offsets = (np.abs(turns - np.exp(1j * joints[earlier])).max(initial=0.0) for earlier in distinct)
        if all(offset > DISTINCT_SOLUTIONS for offset in offsets):
            distinct.append(k)
    return distinct
