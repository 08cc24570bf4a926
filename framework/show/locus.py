"""The singular locus as something to draw: the zero level of g near where the robot moves.

A robot whose platform has two free translations gets curves over its workspace (all its other coordinates
held), one with three a patch of surface about a singular instant. Both are as coarse as a picture may be.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import NotAssembled
from framework.kinematics.assembly import passive_columns
from framework.kinematics.closures import column_scale
from framework.kinematics.frames import move
from framework.kinematics.inverse_kinematics import mode_signs, moving_columns, system_at
from framework.kinematics.singularity import measured_matrix
from framework.model import ParallelRobot

GRID = 81  # points along an edge of the workspace
STEPS = 8  # Newton steps to a neighbouring point
PATCH = 11  # points along an edge of the patch
REACH = 1.2  # half an edge of the grid, in lengths of the robot


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, and how much of the plane was reached."""

    curves: list[Array]  # (m, 2) platform coordinates each
    axes: tuple[int, int]  # which platform coordinates
    reached: int  # points of the grid on the working mode


class _Reached(NamedTuple):
    closed: Array  # (T,) bool
    q: Array  # (T, nq)
    g: Array  # (T,) det P: it changes sign where g does, and needs no border


def straight_axes(robot: ParallelRobot) -> list[int]:
    """Which platform coordinates are translations."""
    return [k for k, axis in enumerate(robot.platform_axes) if axis < 3]


def locus_curves(robot: ParallelRobot, q: Array, x: Array) -> LocusCurves | None:
    """Zero level of g about a configuration q (nq,) with the platform at x (n,), by inverse kinematics.

    The grid is filled from x outwards, each point from a neighbour of its own working mode. None for a
    robot without exactly two translations, without passive joints, or with redundant motors (whose g has
    no sign).
    """
    straight = straight_axes(robot)
    if len(straight) != 2 or not len(passive_columns(robot)) or robot.n_a != robot.n:
        return None
    span = np.linspace(-REACH, REACH, 2 * (GRID // 2) + 1) * robot.length
    size = len(span)
    middle = size // 2
    grid = np.full((size, size, robot.model.nq), np.nan)
    g = np.full((size, size), np.nan)
    grid[middle, middle] = q
    start = _reach(robot, x[None], q[None], None)
    g[middle, middle] = start.g[0]
    sign = float(mode_signs(robot, system_at(robot, q[None], x[None]))[0][0])
    tried = np.zeros((size, size), dtype=int)
    front = [(middle, middle)]
    while front:
        asked, guesses = [], []
        for i, j in front:
            for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if 0 <= a < size and 0 <= b < size and np.isnan(g[a, b]) and tried[a, b] < 2:
                    tried[a, b] += 1
                    asked.append((a, b))
                    guesses.append(grid[i, j])
        if not asked:
            break
        targets = np.repeat(x[None], len(asked), axis=0)
        targets[:, straight[0]] += span[[a for a, _ in asked]]
        targets[:, straight[1]] += span[[b for _, b in asked]]
        found = _reach(robot, targets, np.array(guesses), sign)
        front = []
        for (a, b), closed, there, value in zip(asked, *found, strict=True):
            if closed and np.isnan(g[a, b]):
                grid[a, b], g[a, b] = there, value
                front.append((a, b))
    return LocusCurves(
        [x[straight] + curve for curve in _zero_level(span, g)],
        (straight[0], straight[1]),
        int(np.isfinite(g).sum()),
    )


def _zero_level(span: Array, g: Array) -> list[Array]:
    """Curves (m, 2) where g (size, size), sampled on span x span, changes sign."""
    from matplotlib.figure import Figure

    if not np.nanmin(g) < 0 < np.nanmax(g):
        return []
    ax = Figure().subplots()
    found = ax.contour(span, span, np.ma.masked_invalid(g).T, levels=[0.0])
    return [np.asarray(curve) for curve in found.allsegs[0] if len(curve) > 1]


def _reach(robot: ParallelRobot, x: Array, guess: Array, sign: float | None) -> _Reached:
    """Newton's method on many points at once, each for itself; those that fail or change mode are told."""
    columns, lengths = moving_columns(robot), column_scale(robot)[moving_columns(robot)]
    q = guess.copy()
    alive = np.ones(len(x), dtype=bool)
    size = np.full(len(x), np.inf)
    for _ in range(STEPS):
        system = system_at(robot, q, x)
        jacobian = system.jacobian[:, :, columns]
        jacobian[~alive] = np.eye(len(columns))
        try:
            newton = -np.linalg.solve(jacobian, system.residual[..., None])[..., 0] / lengths
        except np.linalg.LinAlgError:
            newton = -np.einsum("tij,tj->ti", np.linalg.pinv(jacobian), system.residual) / lengths
        size = np.abs(newton).max(axis=1)
        alive &= np.isfinite(size) & (size < 0.5)
        step = np.zeros((len(x), robot.model.nv))
        step[np.ix_(alive, columns)] = newton[alive] * lengths
        q = move(robot, q, step)
        if not alive.any() or size[alive].max() < 1e-7:
            break
    system = system_at(robot, q, x)
    alive &= size < 1e-5
    if sign is not None:
        alive &= mode_signs(robot, system)[0] == sign
    return _Reached(alive, q, np.linalg.det(measured_matrix(robot, system)))


class LocusPatch(NamedTuple):
    """A piece of the singular surface: points (PATCH, PATCH, 3) in platform translations."""

    points: Array


def locus_patch(robot: ParallelRobot, q: Array, x: Array) -> LocusPatch | None:
    """The singular surface about a singular configuration, with the platform's orientation held.

    None for a robot without exactly three translations, or where the surface cannot be followed.
    """
    straight = straight_axes(robot)
    if len(straight) != 3 or not len(passive_columns(robot)) or robot.n_a != robot.n:
        return None

    def measure(shift: Array) -> Array:
        targets = np.repeat(x[None], len(shift), axis=0)
        targets[:, straight] += shift
        found = _reach(robot, targets, np.repeat(q[None], len(shift), axis=0), None)
        if not found.closed.all():
            raise NotAssembled("the patch leaves the workspace", q=q, residual=np.nan)
        return found.g

    step = 1e-4 * robot.length
    try:
        slope = measure(step * np.eye(3)) - measure(-step * np.eye(3))
        normal = slope / np.linalg.norm(slope)
        aside = np.linalg.svd(normal[None])[2][1:]  # (2, 3)
        span = np.linspace(-0.12, 0.12, PATCH) * robot.length
        flat = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2) @ aside
        height, value = np.zeros(len(flat)), measure(flat)
        rate = np.full(len(flat), np.linalg.norm(slope) / (2 * step))
        for _ in range(5):
            bounded = np.clip(-value / rate, -0.02 * robot.length, 0.02 * robot.length)
            after = measure(flat + (height + bounded)[:, None] * normal)
            moved = np.abs(bounded) > 1e-9 * robot.length
            rate = np.where(moved, (after - value) / np.where(moved, bounded, 1.0), rate)
            height, value = height + bounded, after
        if not np.abs(height).max() < 0.15 * robot.length:
            return None
    except (NotAssembled, FloatingPointError):
        return None
    points = flat + height[:, None] * normal + x[straight]
    return LocusPatch(points.reshape(PATCH, PATCH, 3))
