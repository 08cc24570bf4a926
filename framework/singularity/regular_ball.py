"""The largest ball about a pose of the platform that is proved to be free of singularities.

It is one cell (`regular_cells`), or made of many: cubes, cut in two along each axis where they are not
proved, those nearest to the pose first, until the nearest one that is left is too small to be cut. They have
one branch in common if each has, in its point that is nearest to the pose, the same joints as the cube next
to it there on the way to the pose: then all agree within any radius, by induction, for two that are regular
agree everywhere on a face that they share if they do so in one point of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.attitude import TwistAngle, TwoAngles
from framework.kinematics.frames import between, integrate
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform
from framework.kinematics.slope_bounds import SlopeBounds
from framework.kinematics.slope_table import moving_balls
from framework.linalg.krawczyk import UP
from framework.singularity.regular_cells import Cells, Prover

MOST = 20_000  # cells
WORK = 3e8  # cells times the fourth power of the joints: some seconds
AT_ONCE = 256  # cells that are cut at a time
LEVELS = 12  # a cube is cut so often at most: a thousandth of the ball
HALVINGS = 40  # of the radius of a single cell
FINE = 20  # steps between the last two of these
WIDEST_TURN = 1.0  # [rad] below a right angle, where its sine no longer tells a turn
SAME = 1e-9  # [rad, lengths] an assembled configuration may be off its closed pose
LONGEST = 0.5  # [rad, lengths] a joint is moved at most before the loops are closed
UNEVEN = 0.4370160244488211  # where in the first cube the pose lies: on no face of a smaller one


class RegularBall(NamedTuple):
    """What is proved."""

    radius: float  # [robot lengths, rad] of the open ball; 0 where nothing is proved
    cells: int  # that were looked at


def regular_ball(robot: ParallelRobot, q: Array, x: Array, within: float, *, most: int = MOST) -> RegularBall:
    """The ball about platform coordinates x (n,), joints q (nq,) there, of at most a radius.

    In it no pose on the branch of q is singular, of Type 1 or Type 2. Of platforms that turn about three axes
    or have more than three coordinates, one cell is tried; of those that turn about two, or about one and do
    not move in a plane, and of robots whose ball joints move, nothing is proved.

    Args:
        within: the radius [robot lengths, rad].
        most: cells that are tried.
    """
    platform = robot.platform
    turning = platform.attitude if isinstance(platform, FramePlatform) else None
    planar = isinstance(turning, TwistAngle) and planar_normal(robot) is not None
    if (
        moving_balls(robot)
        or isinstance(turning, TwoAngles)
        or (isinstance(turning, TwistAngle) and not planar)
    ):
        return RegularBall(0.0, 0)
    prover = Prover(SlopeBounds.of(robot), x, np.where(robot.translations, robot.length, 1.0))
    single = _single(prover, q, min(within, WIDEST_TURN))
    if robot.n > 3 or not (turning is None or planar):
        return RegularBall(single, HALVINGS + FINE)
    most = min(most, int(WORK / len(robot.moving) ** 4))
    many = _of_cells(prover, q, within, most)
    return RegularBall(max(single, many.radius), many.cells)


def _single(prover: Prover, q: Array, within: float) -> float:
    """The largest radius of one cell, a ball, that is found by halving and then in steps."""
    best = 0.0
    for exponents in (-np.arange(HALVINGS), np.arange(FINE) / FINE):
        tried = np.asarray((best or within) * np.exp2(exponents), dtype=np.float64)
        tried = tried[tried <= within]
        many = np.repeat(q[None], len(tried), axis=0)
        proved = prover.cells(np.zeros((len(tried), len(prover.x))), many, tried, ball=True).proved
        best = float(tried[proved].max(initial=best))
        if best == 0.0:
            break
    return best


class _Cubes(NamedTuple):
    """Cubes of a grid, with what is known of each."""

    level: IntArray  # (S,)
    places: IntArray  # (S, n)
    cells: Cells

    def take(self, which: BoolArray | IntArray) -> _Cubes:
        """Some of them."""
        return _Cubes(self.level[which], self.places[which], self.cells.take(which))

    @staticmethod
    def joined(parts: list[_Cubes]) -> _Cubes:
        """All cubes of several stacks."""
        cells = Cells(*map(np.concatenate, zip(*(part.cells for part in parts), strict=True)))
        return _Cubes(
            np.concatenate([part.level for part in parts]),
            np.concatenate([part.places for part in parts]),
            cells,
        )


class _Grid(NamedTuple):
    """Cubes that halve a first one again and again, about the pose at 0."""

    width: float  # of the first one

    def middles(self, level: IntArray, index: IntArray) -> Array:
        """Middles (S, n) of the cubes of an index (S, n) at levels (S,)."""
        return self.width * ((index + 0.5) * 0.5 ** level[:, None] - UNEVEN)

    def nearest(self, cubes: _Cubes) -> Array:
        """Their points (S, n) that are nearest to the pose."""
        size = 0.5 ** cubes.level[:, None]
        lower, upper = ((cubes.places + side) * size - UNEVEN for side in (0, 1))
        return self.width * np.clip(0.0, lower, upper)

    def distances(self, cubes: _Cubes) -> Array:
        """How far they are from the pose, (S,)."""
        return np.linalg.norm(self.nearest(cubes), axis=1) / UP

    def inward(self, cubes: _Cubes) -> IntArray:
        """The smallest cubes (S, n) behind these points, on the way to the pose."""
        pose = int(np.floor(UNEVEN * 2**LEVELS))
        size = 2 ** (LEVELS - cubes.level[:, None])
        return np.asarray(np.clip(pose, cubes.places * size - 1, (cubes.places + 1) * size))


def _of_cells(prover: Prover, q: Array, within: float, most: int) -> RegularBall:
    """The ball of cubes: to the nearest one that is not proved, or does not agree with its neighbour."""
    n, grid = len(prover.x), _Grid(within / UNEVEN * UP)
    start = prover.cells(np.zeros((1, n)), q[None], np.array([grid.width]))
    first = _Cubes(np.zeros(1, dtype=np.intp), np.zeros((1, n), dtype=np.intp), start)
    waiting, proved, count, limit = first, list[_Cubes](), 1, within
    while len(waiting.level):
        far = grid.distances(waiting)
        limit = min(limit, float(far[waiting.level == LEVELS].min(initial=np.inf)))
        waiting, far = waiting.take(far < limit), far[far < limit]
        if count > most:
            limit = min(limit, float(far.min(initial=np.inf)))
            break
        order = np.argsort(far, kind="stable")
        cubes = _cut(prover, grid, waiting.take(order[:AT_ONCE]), start.signs)
        count += len(cubes.level)
        proved.append(cubes.take(cubes.cells.proved))
        waiting = _Cubes.joined([waiting.take(order[AT_ONCE:]), cubes.take(~cubes.cells.proved)])
    if not proved:
        return RegularBall(0.0, count)
    known = _Cubes.joined(proved)
    far = grid.distances(known)
    known, far = known.take(far < limit), far[far < limit]
    apart = ~_agree(prover, grid, known, q)
    return RegularBall(min(limit, float(far[apart].min(initial=np.inf))), count)


def _cut(prover: Prover, grid: _Grid, cubes: _Cubes, signs: Array) -> _Cubes:
    """The cubes of half the width in each, tested; one on another branch keeps what it is cut from."""
    n = len(prover.x)
    halves = np.stack(np.meshgrid(*[[0, 1]] * n, indexing="ij"), axis=-1).reshape(-1, n)
    parts = len(halves)
    level = np.repeat(cubes.level + 1, parts)
    index = np.repeat(2 * cubes.places, parts, axis=0) + np.tile(halves, (len(cubes.level), 1))
    z, old = grid.middles(level, index), cubes.cells.take(np.repeat(np.arange(len(cubes.level)), parts))
    width = grid.width * 0.5 ** np.asarray(level, dtype=float)
    found = prover.cells(z, _closed(prover, old, z), 0.5 * width)
    other = (found.signs != signs).any(axis=1)
    old = old._replace(proved=np.zeros(len(z), dtype=bool))
    kept = [
        np.where(other.reshape(-1, *[1] * (new.ndim - 1)), was, new)
        for was, new in zip(old, found, strict=True)
    ]
    return _Cubes(level, index, Cells(*kept))


def _agree(prover: Prover, grid: _Grid, cubes: _Cubes, q: Array) -> BoolArray:
    """Whether each cube has the joints of its neighbour on the way to the pose, and the pose's own has q."""
    robot, scale, cells = prover.bounds.robot, prover.bounds.column_scale, cubes.cells
    inward, neighbour = grid.inward(cubes).astype(np.intp), np.full(len(cubes.level), -1)
    for level in np.unique(cubes.level):
        own = np.flatnonzero(cubes.level == level)
        place_of = {tuple(key): place for place, key in zip(own, cubes.places[own].tolist(), strict=True)}
        wanted = (inward >> (LEVELS - level)).tolist()
        places = [place_of.get(tuple(key), old) for key, old in zip(wanted, neighbour, strict=True)]
        neighbour = np.array(places, dtype=np.intp)
    near = grid.nearest(cubes)
    there = _closed(prover, cells, near)
    point = prover.cells(near, there, np.zeros(len(near)))
    agree = point.proved & (neighbour >= 0)
    for other in (np.arange(len(near)), neighbour):
        way = between(robot, cells.q[other], there)[:, robot.moving] / scale
        agree &= (UP * (np.abs(way) + point.radii) <= cells.radii[other]).all(axis=1)
    home = (near == 0).all(axis=1)
    way = between(robot, cells.q[home], np.repeat(q[None], np.count_nonzero(home), axis=0))
    agree[home] &= (np.abs(way[:, robot.moving] / scale) + SAME <= cells.radii[home]).all(axis=1)
    return np.asarray(agree)


def _closed(prover: Prover, cells: Cells, z: Array) -> Array:
    """Joints (S, nq) at points z (S, n), on from the middle of a cell each."""
    robot = prover.bounds.robot
    step = np.zeros((len(z), robot.model.nv))
    moved = np.einsum("skn,sn->sk", cells.slope, z - cells.z)
    step[:, robot.moving] = np.clip(moved, -LONGEST, LONGEST) * prover.bounds.column_scale
    guess = integrate(robot, cells.q, step)
    found = close_each(robot, prover.x + z * prover.scale, guess)
    return np.where(found.closed[:, None], found.q, guess)
