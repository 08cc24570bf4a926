"""The passive joints at a pose of the platform or with locked motors, and the proof that a solution exists.

Newton's method closes the loops, redundant equations included, from many starts at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from framework.kinematics.closures import scaled_equations
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate, integrate_columns
from framework.kinematics.linearised_loops import linearised_at, passive_matrix, type1_matrix
from framework.kinematics.mechanism import velocity_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import cross
from framework.numerics.rotations import wrap_angles
from framework.proofs.equation_terms import stretched_length
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.krawczyk import prove_existence
from framework.proofs.rounding import approximate_inverses
from framework.tolerances import DISTINCT_SOLUTIONS, FRAME_ROUNDING, LOOP_GAP, RANK_ROUNDING

RANDOM_STARTS = 300  # of a search for all solutions


def find_joints_at_pose(
    robot: ParallelRobot, q: Array, position: Array, rotation: Array | None
) -> Array | None:
    """Find the configuration (nq,) nearest to the reference with the platform's frame at a pose.

    Motors and springs stay as in q (nq,). The result is None if no configuration is found.

    Args:
        position: (3,) of the frame's origin [m].
        rotation: (3, 3) of the frame; None to leave the rotation free.
    """
    start_count = 24  # of Newton's method

    def pose_equations(frames: FrameStack) -> tuple[Array, Array]:
        """Compute dimensionless offsets (T, 3 or 12) from the pose, and slopes (T, .., nv).

        The first 3 offsets are of its origin, the others of its axes. The derivative of an axis e along a
        joint that turns about w_j is w_j x e.
        """
        jacobian = frames.frame_jacobian()  # (T, 6, nv)
        offsets = (frames.platform_origin - position) / robot.length
        slopes = jacobian[:, :3] * robot.column_scale / robot.length
        if rotation is None:
            return offsets, slopes
        axes = frames.platform_rotation.swapaxes(1, 2)  # (T, 3, 3), one axis a row; those of R are columns
        turns = (axes - rotation.T).reshape(-1, 9)
        w = jacobian[:, 3:].swapaxes(1, 2)  # (T, nv, 3)
        turn_slopes = cross(w[:, None], axes[:, :, None]).swapaxes(2, 3).reshape(-1, 9, robot.nv)
        return np.hstack([offsets, turns]), np.hstack([slopes, turn_slopes * robot.column_scale])

    starts = draw_starts(robot, q, robot.passive, start_count)
    ends, closed = close_all_loops(robot, starts, robot.following, pose_equations)
    poses = remove_whole_turns(robot, ends[closed])
    return min(poses, key=partial(distance_from_reference, robot), default=None)


def close_all_loops(
    robot: ParallelRobot,
    q: Array,
    columns: IntArray,
    extra_equations: Callable[[FrameStack], tuple[Array, Array]] | None = None,
) -> tuple[Array, BoolArray]:
    """Close the loops by Newton's method from q (T, nq); return q (T, nq), mask (T,) of closed loops.

    Redundant equations are included, so each step solves a least-squares problem; steps are cut to
    `max_step`. One more step after all loops are closed reduces the residuals to rounding.

    Args:
        columns: of the joints that move, in the velocity vector.
        extra_equations: computes e equations (T, e) to solve with the loops, and their slopes (T, e, nv)
            along all joints, dimensionless.
    """
    max_steps = 40  # of Newton's method
    max_step = 0.6  # [rad, robot lengths] largest motion of a joint in one step
    is_last = False  # whether the step after all loops were closed has been taken
    for _ in range(max_steps):
        frames = frames_at(robot, q)
        values, slopes = scaled_equations(robot, robot.rows, frames)
        if extra_equations is not None:
            extra_values, extra_slopes = extra_equations(frames)
            values = np.hstack([values, extra_values])
            slopes = np.hstack([slopes, extra_slopes])

        residual = np.abs(values).max(axis=1)  # (T,) largest of each configuration
        if is_last or not len(q):
            break
        is_last = bool((residual < LOOP_GAP).all())

        # a step of least norm, shortened so that no joint moves by more than `max_step`
        step = -np.matvec(np.linalg.pinv(slopes[:, :, columns], rcond=RANK_ROUNDING), values)
        step /= np.maximum(np.abs(step).max(axis=1, keepdims=True) / max_step, 1.0)
        q = integrate_columns(robot, q, columns, step * robot.column_scale[columns])
    return q, residual < LOOP_GAP


def draw_starts(robot: ParallelRobot, q: Array, columns: IntArray, count: int) -> Array:
    """Draw configurations (count, nq): q (nq,) itself, then q with some joints at random.

    These joints have the `columns` (k,) of the velocity vector. Hinges turn by up to half a turn, slides move
    by up to a robot length.
    """
    random_seed = 11
    max_step = np.where(robot.sliding[columns], robot.length, np.pi)  # (k,) [rad, m]
    steps = np.zeros((count, len(columns)))
    steps[1:] = np.random.default_rng(random_seed).uniform(-max_step, max_step, (count - 1, len(max_step)))
    return integrate_columns(robot, q, columns, steps)


def shortest_offset(robot: ParallelRobot, q: Array, columns: IntArray | slice = slice(None)) -> Array:
    """Compute offsets (..., nv) [rad, m] of q (..., nq) from the reference.

    Angles of hinges in `columns`, by default all, are wrapped to within half a turn.
    """
    offset = difference(robot, robot.reference.q, q)
    chosen = offset[..., columns]
    offset[..., columns] = np.where(robot.sliding[columns], chosen, wrap_angles(chosen))
    return offset


def remove_whole_turns(robot: ParallelRobot, q: Array) -> Array:
    """Turn passive hinges of q (..., nq) to within half a turn of the reference."""
    return integrate(robot, robot.reference.q, shortest_offset(robot, q, robot.passive))


def turn_within_ranges(robot: ParallelRobot, q: Array, columns: IntArray) -> Array:
    """Turn hinges in `columns` of q (T, nq) by whole turns into their ranges, endless ones to (-pi, pi].

    Hinges stay if no whole turn leads into their range, and if a coupling counts their turns.
    """
    coupled = [name for coupling in robot.description.couplings for name in coupling.joints]
    turning = np.isin(columns, list(single_columns(robot.model))) & ~robot.sliding[columns]
    hinges = np.setdiff1d(columns[turning], velocity_columns(robot.model, coupled))
    lower, upper = robot.joint_ranges[:, hinges]
    angle = robot.coordinates.positions(q)[:, hinges]  # (T, hinges)
    whole_turn = 2.0 * np.pi
    up, down = np.maximum(lower - angle, 0.0), np.maximum(angle - upper, 0.0)
    turned = angle + whole_turn * (np.ceil(up / whole_turn) - np.ceil(down / whole_turn))
    turned = np.where((lower <= turned) & (turned <= upper), turned, angle)
    turned = np.where(np.isinf(lower) & np.isinf(upper), -wrap_angles(-angle), turned)
    return integrate_columns(robot, q, hinges, turned - angle)


def distance_from_reference(robot: ParallelRobot, q: Array) -> float:
    """Compute the distance [rad, robot lengths] of q (nq,) from the reference."""
    return float(np.linalg.norm(difference(robot, robot.reference.q, q) / robot.column_scale))


def has_one_solution_near(robot: ParallelRobot, q: Array, *, platform_locked: bool = False) -> bool:
    """Return whether the loops provably have one solution near q (nq,), motors locked.

    With `platform_locked` the platform is locked instead of the motors; springs are always locked. The test
    is Krawczyk's, for a box of joints with equal radii [rad, robot lengths]. Its k equations are those of the
    loops, and those of the platform if it is locked. The result is False unless k joints are unknown, and for
    loops of which no k equations imply the others in all poses: the root of k of them may leave others open.
    """
    if robot.structure.varies:
        return False
    linearised = linearised_at(robot, q[None])
    values = linearised.residual / robot.equation_sizes  # (1, n + loops)
    J = type1_matrix(robot, linearised)  # of platform and loops
    if not platform_locked:
        values = values[:, robot.n :]
        J = passive_matrix(robot, linearised)  # of the loops
    _, k, joints = J.shape
    if k != joints:
        return False
    # bounds by the length L of all links in one line: no joint turns a frame at a larger distance. An
    # equation is a product of two vectors that turn, with second derivatives of at most 4 L^2 for L >= 1
    max_length = stretched_length(robot, q) + 1.0  # one robot length to spare for slides nearby
    row_size = robot.structure.row_sizes.min(initial=1.0)
    units = np.where(robot.loops.square, robot.length, 1.0)
    max_weight = np.abs(robot.loops.derivative_weight * units).max(initial=1.0)
    second_derivative = (2 * max_length) ** 2 * max_weight / row_size  # dimensionless
    rounding = FRAME_ROUNDING * max_length / row_size
    inverse_size = np.abs(approximate_inverses(J))
    radius = 2 * np.matvec(inverse_size, np.abs(values) + rounding).max()  # twice the Newton step
    slope_changes = np.full_like(J, second_derivative * k * radius + rounding)  # k joints move by the radius
    equations = LinearEnclosure(values, J, np.full_like(values, rounding))
    proof = prove_existence(equations, slope_changes, np.full_like(values, radius), parameter=None)
    return bool(proof.proved[0])


def distinct_rows(points: Array) -> list[int]:
    """Return the indices of rows of points (T, d) that repeat no earlier row.

    Each row is compared with the distinct rows before it. Angles are given as points exp(i angle) of the unit
    circle, where whole turns make no difference; slides [robot lengths] may be given like angles [rad].
    """
    distinct = list[int]()
    for k, point in enumerate(points):
        offsets = np.abs(points[distinct] - point).max(axis=1, initial=0.0)
        if (offsets > DISTINCT_SOLUTIONS).all():
            distinct.append(k)
    return distinct
