"""The singular locus as something to draw: the zero level of g near where the robot moves.

A robot whose platform has two free translations gets curves over its workspace (all its other coordinates
held), one with three a patch of surface about a singular instant. Both are as coarse as a picture may be,
with their points pulled onto the locus itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array
from framework.kinematics.inverse_kinematics import close_each, mode_signs, system_at
from framework.kinematics.loop_matrices import measured_matrix
from framework.kinematics.parallel_robot import ParallelRobot

GRID = 61  # points along an edge of the workspace
REACH = 1.2  # half an edge of the grid, in lengths of the robot
STEPS = 10  # Newton steps to a neighbouring point
NEIGHBOUR = 0.5  # [rad, lengths] that a step may move a joint by
PATCH = 11  # points along an edge of the patch
PATCH_SIZE = 0.12  # half an edge of the patch, in lengths of the robot
STEEPEST = 0.2  # of the patch's distance from its plane, in lengths of the robot: beyond, it is left out


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, and how much of the plane was reached."""

    curves: list[Array]  # (m, 2) platform coordinates each
    axes: tuple[int, int]  # which platform coordinates
    reached: int  # points of the grid on the working mode
    about: Array  # (n,) platform coordinates of the grid's centre; those not among `axes` are held
    reach: float  # [m] half an edge of the grid

    def serves(self, x: Array) -> bool:
        """Whether these are the curves about x (T, n) too: the same held coordinates, well inside."""
        off = np.abs(x - self.about)
        held = np.delete(off, self.axes, axis=1)
        return bool(held.max(initial=0.0) < 1e-9 and off[:, self.axes].max() < 0.5 * self.reach)


class _Reached(NamedTuple):
    closed: NDArray[np.bool_]  # (T,)
    q: Array  # (T, nq)
    g: Array  # (T,) det P: it changes sign where g does, and needs no border


def locus_curves(robot: ParallelRobot, q: Array, x: Array) -> LocusCurves | None:
    """Zero level of g about a configuration q (nq,) with the platform at x (n,), by inverse kinematics.

    The grid is filled from x outwards, each point from a neighbour of its own working mode. None for a
    robot without exactly two translations, without passive joints, or with redundant motors (whose g has
    no sign).
    """
    straight = _straight(robot)
    if len(straight) != 2 or not _has_signed_measure(robot):
        return None
    span = np.linspace(-REACH, REACH, GRID) * robot.length
    grid, g = _filled(robot, q, x, span)
    curves = []
    slopes = np.gradient(g, span, span)
    for curve in _zero_level(span, g):
        nearest = np.clip(np.searchsorted(span, curve - 0.5 * (span[1] - span[0])), 0, GRID - 1)
        at = (nearest[:, 0], nearest[:, 1])
        normal = np.stack([slopes[0][at], slopes[1][at]], axis=1)
        size = np.linalg.norm(normal, axis=1)
        known = np.isfinite(size) & (size > 0) & np.isfinite(grid[at]).all(axis=1)
        pulled = np.full(curve.shape, np.nan)
        if known.any():
            onto = normal[known] / size[known, None]
            measure = _measure_about(robot, grid[at][known], x, straight)
            pulled[known] = _pulled_onto(measure, curve[known], onto, size[known], 0.5 * (span[1] - span[0]))
        curves += [x[straight] + piece for piece in _unbroken(pulled)]
    return LocusCurves(
        curves=curves,
        axes=(straight[0], straight[1]),
        reached=int(np.isfinite(g).sum()),
        about=x.copy(),
        reach=REACH * robot.length,
    )


def locus_patch(robot: ParallelRobot, q: Array, x: Array) -> Array | None:
    """The singular surface (PATCH, PATCH, 3) about a singular configuration, the orientation held.

    None for a robot without exactly three translations, or where the surface cannot be followed.
    """
    straight = _straight(robot)
    if len(straight) != 3 or not _has_signed_measure(robot):
        return None
    step = 1e-4 * robot.length
    there = _measure_about(robot, np.repeat(q[None], 6, axis=0), x, straight)(
        np.concatenate([step * np.eye(3), -step * np.eye(3)])
    )
    slope = (there[:3] - there[3:]) / (2 * step)
    size = float(np.linalg.norm(slope))
    if not (np.isfinite(size) and size > 0):
        return None
    normal = slope / size
    aside = np.linalg.svd(normal[None])[2][1:]  # (2, 3)
    span = np.linspace(-PATCH_SIZE, PATCH_SIZE, PATCH) * robot.length
    flat = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2) @ aside
    measure = _measure_about(robot, np.repeat(q[None], len(flat), axis=0), x, straight)
    onto = np.repeat(normal[None], len(flat), axis=0)
    points = _pulled_onto(measure, flat, onto, np.full(len(flat), size), STEEPEST * robot.length)
    if np.isnan(points).any():
        return None
    return (points + x[straight]).reshape(PATCH, PATCH, 3)


def _straight(robot: ParallelRobot) -> list[int]:
    """Which platform coordinates are translations along base axes."""
    return robot.platform.sliding.tolist()


def _has_signed_measure(robot: ParallelRobot) -> bool:
    return len(robot.following) > 0 and robot.n_a == robot.n


def _filled(robot: ParallelRobot, q: Array, x: Array, span: Array) -> tuple[Array, Array]:
    """Configurations (GRID, GRID, nq) and det P on span x span about x, nan where the mode does not reach."""
    straight = _straight(robot)
    middle = GRID // 2
    grid = np.full((GRID, GRID, robot.model.nq), np.nan)
    g = np.full((GRID, GRID), np.nan)
    grid[middle, middle], g[middle, middle] = q, _reach(robot, x[None], q[None], None).g[0]
    sign = float(mode_signs(robot, system_at(robot, q[None], x[None]))[0][0])
    tried = np.zeros((GRID, GRID), dtype=int)
    front = [(middle, middle)]
    while front:
        asked, guesses = [], []
        for i, j in front:
            for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if 0 <= a < GRID and 0 <= b < GRID and np.isnan(g[a, b]) and tried[a, b] < 2:
                    tried[a, b] += 1
                    asked.append((a, b))
                    guesses.append(grid[i, j])
        if not asked:
            break
        targets = np.repeat(x[None], len(asked), axis=0)
        targets[:, straight] += span[np.array(asked)]
        front = []
        for place, closed, there, value in zip(
            asked, *_reach(robot, targets, np.array(guesses), sign), strict=True
        ):
            if closed and np.isnan(g[place]):
                grid[place], g[place] = there, value
                front.append(place)
    return grid, g


def _zero_level(span: Array, g: Array) -> list[Array]:
    """Curves (m, 2) where g (size, size), sampled on span x span, changes sign."""
    from contourpy import contour_generator

    if not np.nanmin(g) < 0 < np.nanmax(g):
        return []
    curves = contour_generator(span, span, np.ma.masked_invalid(g).T).lines(0.0)
    return [np.asarray(curve) for curve in curves if len(curve) > 1]


def _unbroken(curve: Array) -> list[Array]:
    """The pieces (m, 2), two points or more, of a curve (T, 2) between points that are not numbers."""
    good = np.asarray(np.isfinite(curve).all(axis=1))
    pieces = np.split(np.arange(len(curve)), np.flatnonzero(np.diff(good)) + 1)
    return [curve[piece] for piece in pieces if good[piece[0]] and len(piece) > 1]


def _measure_about(
    robot: ParallelRobot, near: Array, x: Array, straight: list[int]
) -> Callable[[Array], Array]:
    """det P of shifts (T, 2 or 3) of x from configurations near (T, nq); nan where loops do not close."""

    def measure(shift: Array) -> Array:
        targets = np.repeat(x[None], len(shift), axis=0)
        targets[:, straight] += shift
        found = _reach(robot, targets, near, None)
        return np.where(found.closed, found.g, np.nan)

    return measure


def _pulled_onto(
    measure: Callable[[Array], Array], start: Array, normal: Array, slope: Array, farthest: float
) -> Array:
    """Points (T, k) moved along their normals to where the measure vanishes, by the secant method.

    Not a number for a point that would have to go farther than `farthest`, or whose loops do not close.
    """
    height, value, rate = np.zeros(len(start)), measure(start), slope
    for _ in range(5):
        step = np.clip(-value / rate, -0.2 * farthest, 0.2 * farthest)
        step = np.where(np.isfinite(step), step, 0.0)
        after = measure(start + (height + step)[:, None] * normal)
        moved = np.abs(step) > 1e-9 * farthest
        rate = np.where(moved, (after - value) / np.where(moved, step, 1.0), rate)
        height, value = height + step, after
    good = np.isfinite(value) & (np.abs(height) < farthest)
    return np.where(good[:, None], start + height[:, None] * normal, np.nan)


def _reach(robot: ParallelRobot, x: Array, guess: Array, sign: float | None) -> _Reached:
    """The robot assembled at x (T, n) from guesses (T, nq) near by, where it can be without changing mode."""
    q, system, closed = close_each(robot, x, guess, iterations=STEPS, farthest=NEIGHBOUR)
    if sign is not None:
        closed &= mode_signs(robot, system)[0] == sign
    return _Reached(closed, q, np.linalg.det(measured_matrix(robot, system)))
