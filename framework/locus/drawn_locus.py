"""The singular locus as something to draw: traced curves, or a patch of surface, near where the robot moves.

A robot whose platform has two free translations gets curves over its workspace (all its other coordinates
held), see `trace_locus`; one with three a patch of surface about a singular instant, as coarse as a picture
may be, with its points pulled onto the locus itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.loop_matrices import type2_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.locus.traced_locus import REGION_REACH, trace_locus
from framework.tolerances import SAME_PLACE

NEWTON_STEPS = 10  # Newton steps to a neighbouring point
MAX_JOINT_STEP = 0.5  # [rad, lengths] that a step may move a joint by
PATCH_POINTS = 11  # points along an edge of the patch
PATCH_SIZE = 0.12  # half an edge of the patch, in lengths of the robot
MAX_PATCH_HEIGHT = 0.2  # [robot lengths] over its plane: a steeper patch is left out
DIFFERENCE_STEP = 1e-4  # [robot lengths] for the slope of g
SECANT_STEPS, MIN_SECANT_STEP = 5, 1e-9  # of points pulled onto the locus; over the largest height


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, in one working mode."""

    curves: list[Array]  # (m, 2) platform coordinates each
    axes: tuple[int, int]  # which platform coordinates
    about: Array  # (n,) platform coordinates of the centre; those not among `axes` are held
    reach: float  # [m] half an edge of the square that was searched

    def serves(self, x: Array) -> bool:
        """Whether these are the curves about x (T, n) too: the same held coordinates, well inside."""
        off = np.abs(x - self.about)
        held = np.delete(off, self.axes, axis=1)
        kept = held.max(initial=0.0) < SAME_PLACE * self.reach
        return bool(kept and off[:, self.axes].max() < 0.5 * self.reach)


class _Reached(NamedTuple):
    closed: NDArray[np.bool_]  # (T,)
    g: Array  # (T,) det P: it changes sign where g does, and needs no border


def locus_curves(robot: ParallelRobot, q: Array, x: Array) -> LocusCurves | None:
    """Trace the locus about an assembled configuration q (nq,), platform at x (n,), in its working mode.

    None for a robot without exactly two translations, without passive joints, or with redundant motors (whose
    g has no sign).
    """
    straight = _straight(robot)
    if len(straight) != 2 or not _has_signed_measure(robot):
        return None
    traced = trace_locus(robot, q, one_mode=True)
    return LocusCurves(
        curves=[curve.x[:, straight] for curve in traced.curves if curve.kind != "joints_only"],
        axes=(straight[0], straight[1]),
        about=x.copy(),
        reach=REGION_REACH * robot.length,
    )


def locus_patch(robot: ParallelRobot, q: Array, x: Array) -> Array | None:
    """Compute the singular surface (m, m, 3), m = PATCH_POINTS, about a singular pose, orientation held.

    None for a robot without exactly three translations, or where the surface cannot be followed.
    """
    straight = _straight(robot)
    if len(straight) != 3 or not _has_signed_measure(robot):
        return None
    step = DIFFERENCE_STEP * robot.length
    measures = _measure_about(robot, np.repeat(q[None], 6, axis=0), x, straight)(
        np.concatenate([step * np.eye(3), -step * np.eye(3)])
    )
    slope = (measures[:3] - measures[3:]) / (2 * step)
    size = float(np.linalg.norm(slope))
    if not (np.isfinite(size) and size > 0):
        return None
    normal = slope / size
    aside = np.linalg.svd(normal[None])[2][1:]  # (2, 3)
    span = np.linspace(-PATCH_SIZE, PATCH_SIZE, PATCH_POINTS) * robot.length
    flat = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2) @ aside
    measure = _measure_about(robot, np.repeat(q[None], len(flat), axis=0), x, straight)
    onto = np.repeat(normal[None], len(flat), axis=0)
    points = _pulled_onto(measure, flat, onto, np.full(len(flat), size), MAX_PATCH_HEIGHT * robot.length)
    if np.isnan(points).any():
        return None
    return (points + x[straight]).reshape(PATCH_POINTS, PATCH_POINTS, 3)


def _straight(robot: ParallelRobot) -> list[int]:
    """Return the platform coordinates that are translations along base axes."""
    return robot.platform.sliding.tolist()


def _has_signed_measure(robot: ParallelRobot) -> bool:
    return len(robot.following) > 0 and robot.n_a == robot.n


def _measure_about(
    robot: ParallelRobot, near: Array, x: Array, straight: list[int]
) -> Callable[[Array], Array]:
    """Return det P as a function of shifts (T, 2 or 3) of x, nan where loops do not close; near (T, nq)."""

    def measure(shift: Array) -> Array:
        targets = np.repeat(x[None], len(shift), axis=0)
        targets[:, straight] += shift
        reached = _reach(robot, targets, near)
        return np.where(reached.closed, reached.g, np.nan)

    return measure


def _pulled_onto(
    measure: Callable[[Array], Array], start: Array, normal: Array, slope: Array, farthest: float
) -> Array:
    """Move points (T, k) along their normals to where the measure vanishes, by the secant method.

    Not a number for a point that would have to go farther than `farthest`, or whose loops do not close.
    """
    height, value, rate = np.zeros(len(start)), measure(start), slope
    for _ in range(SECANT_STEPS):
        step = np.clip(-value / rate, -0.2 * farthest, 0.2 * farthest)
        step = np.where(np.isfinite(step), step, 0.0)
        after = measure(start + (height + step)[:, None] * normal)
        moved = np.abs(step) > MIN_SECANT_STEP * farthest
        rate = np.where(moved, (after - value) / np.where(moved, step, 1.0), rate)
        height, value = height + step, after
    good = np.isfinite(value) & (np.abs(height) < farthest)
    return np.where(good[:, None], start + height[:, None] * normal, np.nan)


def _reach(robot: ParallelRobot, x: Array, guess: Array) -> _Reached:
    """Compute det P of the robot assembled at x (T, n) from guesses (T, nq) near by, where it can be."""
    _, linearised, closed = close_each(robot, x, guess, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
    return _Reached(closed, np.linalg.det(type2_matrix(robot, linearised)))
