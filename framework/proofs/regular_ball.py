"""The largest ball about a pose of the platform that is proved to be free of singularities.

It is one cell (`CellTest`), or made of many: cubes, cut in two along each axis where they are not
proved, those nearest to the pose first, until the nearest one that is left is too small to be cut
(`branch_and_bound`). They have
one branch in common if each has, in its point that is nearest to the pose, the same joints as the cube next
to it there on the way to the pose: then all agree within any radius, by induction, for two that are regular
agree everywhere on a face that they share if they do so in one point of it.

A cell of platform coordinates is proved to be free of singularities on one branch. In a cell about a middle
x_m, with joints q_m there and Y the inverse of dF/dq, F = [platform - x ; loops], the joints are q_m + Y (x -
x_m) but for an error e, if by the bounds of `derivative_bounds` the map q - Y F takes the box |q - q_m| < r
into itself and contracts it (Krawczyk). Then for every x of the cell the box has one pose and no Type 1
singularity; and none of Type 2 if a matrix that bounds |1 - Y_P P| there,

    |1 - Y_P P_m| + sum_i |Y_P dP/dq . Y_i| |dx_i| + |Y_P| (|dP/dq| e + change of dP/dq),    Y_P near 1 / P_m,

has a spectral radius below 1. A turn of the platform is measured from the middle by the part of
R R_m' that is not symmetric, the sine of the angle: no more than the change of its coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray, join, select
from framework.kinematics.attitude import RotationVector, TwistAngle, TwoAngles
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform
from framework.proofs.branch_and_bound import Examined, branch_and_bound
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives, Remainders
from framework.proofs.equation_terms import moving_balls
from framework.proofs.rounding import ROUND_UP, WIDENING_RATIO, gamma, identity_defect, inverses, times
from framework.tolerances import LOOP_GAP

MAX_CELLS = 20_000
MAX_WORK = 3e8  # cells times the fourth power of the joints: some seconds
CELLS_PER_BATCH = 1024
MAX_CUTS = 12  # of the first cube: then a cube is a thousandth of the ball
MAX_HALVINGS = 40  # of the radius of a single cell
STEPS_PER_OCTAVE = 20  # between the last two of these
MAX_TURN = 1.0  # [rad] below a right angle, where its sine no longer tells a turn
MAX_STEP = 0.5  # [rad, lengths] a joint is moved at most before the loops are closed
OFF_CENTRE = 0.4370160244488211  # where in the first cube the pose lies: on no face of a smaller one
MAX_WIDENINGS = 6  # of the box of joints, until the test holds
MAX_RADIUS = 10.0  # [rad, lengths] of a box of joints
MIN_RADIUS = 1e-14  # [rad, lengths]
PERRON_SHIFT = 0.1  # of the largest row sum, added to row sums as weights


class RegularBall(NamedTuple):
    """A ball that is proved to be free of singularities."""

    radius: float  # [robot lengths, rad] of the open ball; 0 where nothing is proved
    cells: int  # that were tested


def regular_ball(
    robot: ParallelRobot, q: Array, x: Array, within: float, *, max_cells: int = MAX_CELLS
) -> RegularBall:
    """Prove a ball about the pose x (n,), q (nq,) to be free of singularities.

    In the ball no pose on the branch of q is singular, of Type 1 or Type 2. Of platforms that turn about
    three axes or have more than three coordinates, one cell is tried. Of those that turn about two, or about
    one and do not move in a plane, and of robots whose ball joints move or whose joints are coupled, nothing
    is proved.

    Args:
        within: the largest radius of interest [robot lengths, rad].
        max_cells: cells that are tested, up to a batch.
    """
    platform = robot.platform
    turning = platform.attitude if isinstance(platform, FramePlatform) else None
    planar = isinstance(turning, TwistAngle) and planar_normal(robot) is not None
    unknown_turn = isinstance(turning, TwoAngles) or (isinstance(turning, TwistAngle) and not planar)
    if moving_balls(robot) or robot.rows.has_couplings or unknown_turn:
        return RegularBall(0.0, 0)
    test = CellTest(DerivativeBounds.of(robot), x, robot.platform_scale)
    single = _single_cell(test, q, min(within, MAX_TURN))
    if robot.n > 3 or isinstance(turning, RotationVector):
        return RegularBall(single, MAX_HALVINGS + STEPS_PER_OCTAVE)
    many = _many_cells(test, q, within, min(max_cells, int(MAX_WORK / len(robot.moving) ** 4)))
    return RegularBall(max(single, many.radius), many.cells)


def _single_cell(test: CellTest, q: Array, within: float) -> float:
    """Compute the largest radius of one cell, a ball, that is found by halving and then in steps."""
    best = 0.0
    for exponents in (-np.arange(MAX_HALVINGS), np.arange(STEPS_PER_OCTAVE) / STEPS_PER_OCTAVE):
        radii = (best or within) * np.exp2(exponents)
        radii = radii[radii <= within]
        joints = np.repeat(q[None], len(radii), axis=0)
        proved = test(np.zeros((len(radii), len(test.x))), joints, radii, ball=True).proved
        best = float(radii[proved].max(initial=best))
        if best == 0.0:
            break
    return best


class _Cubes(NamedTuple):
    """S cubes of a grid, each with its cell; an untested one with its parent's."""

    level: IntArray  # (S,)
    places: IntArray  # (S, n)
    cells: Cells

    def parts(self) -> _Cubes:
        """Return the cubes of half the width in each."""
        n = self.places.shape[1]
        corners = np.stack(np.meshgrid(*[[0, 1]] * n, indexing="ij"), axis=-1).reshape(-1, n)
        parent = np.repeat(np.arange(len(self.level)), len(corners))
        places = 2 * self.places[parent] + np.tile(corners, (len(self.level), 1))
        return _Cubes(self.level[parent] + 1, places, select(self.cells, parent))


class _Grid(NamedTuple):
    """Cubes that halve a first one again and again, about the pose at 0."""

    width: float  # of the first one

    def middles(self, cubes: _Cubes) -> Array:
        """Compute their middles (S, n)."""
        return self.width * ((cubes.places + 0.5) * 0.5 ** cubes.level[:, None] - OFF_CENTRE)

    def nearest(self, cubes: _Cubes) -> Array:
        """Compute their points (S, n) that are nearest to the pose."""
        size = 0.5 ** cubes.level[:, None]
        lower, upper = ((cubes.places + side) * size - OFF_CENTRE for side in (0, 1))
        return self.width * np.clip(0.0, lower, upper)

    def distances(self, cubes: _Cubes) -> Array:
        """Compute the distances (S,) of the cubes from the pose."""
        return np.linalg.norm(self.nearest(cubes), axis=1) / ROUND_UP

    def inward(self, cubes: _Cubes) -> IntArray:
        """Return the smallest cubes (S, n) behind the nearest points, on the way to the pose."""
        pose = int(np.floor(OFF_CENTRE * 2**MAX_CUTS))
        size = 2 ** (MAX_CUTS - cubes.level[:, None])
        return np.clip(pose, cubes.places * size - 1, (cubes.places + 1) * size)


def _many_cells(test: CellTest, q: Array, within: float, max_cells: int) -> RegularBall:
    """Prove the ball of cubes: to the nearest one that is not proved, or disagrees with its neighbour."""
    n, grid = len(test.x), _Grid(within / OFF_CENTRE * ROUND_UP)
    start = test(np.zeros((1, n)), q[None], np.array([grid.width]))
    first = _Cubes(np.zeros(1, dtype=np.intp), np.zeros((1, n), dtype=np.intp), start)

    def examine(cubes: _Cubes) -> Examined[_Cubes, _Cubes]:
        """Test cubes; cut cubes without proof into parts, undecided at the last cut."""
        cubes = _test_cubes(test, grid, cubes, start.signs)
        proved = cubes.cells.proved
        undecided = select(cubes, ~proved & (cubes.level == MAX_CUTS))
        ahead = select(cubes, ~proved & (cubes.level < MAX_CUTS)).parts()
        return Examined(select(cubes, proved), undecided, ahead)

    end = branch_and_bound(
        examine, first, batch=CELLS_PER_BATCH, max_examined=max_cells, distance=grid.distances, limit=within
    )
    proved = join(end.proved)
    distances = grid.distances(proved)
    proved, distances = select(proved, distances < end.limit), distances[distances < end.limit]
    if not len(distances):
        return RegularBall(0.0, end.examined)
    disagree = ~_agree(test, grid, proved, q)
    return RegularBall(min(end.limit, float(distances[disagree].min(initial=np.inf))), end.examined)


def _test_cubes(test: CellTest, grid: _Grid, cubes: _Cubes, signs: Array) -> _Cubes:
    """Test cubes; one whose joints come out on another branch is not proved, and keeps its parent's cell."""
    z = grid.middles(cubes)
    half = 0.5 * grid.width * 0.5 ** np.asarray(cubes.level, dtype=float)
    parent = cubes.cells._replace(proved=np.zeros(len(half), dtype=bool))
    verdict = test(z, _close(test, parent, z), half)
    elsewhere = (verdict.signs != signs).any(axis=1)
    cells = [
        np.where(elsewhere.reshape(-1, *[1] * (new.ndim - 1)), old, new)
        for old, new in zip(parent, verdict, strict=True)
    ]
    return cubes._replace(cells=Cells(*cells))


def _agree(test: CellTest, grid: _Grid, cubes: _Cubes, q: Array) -> BoolArray:
    """Whether each cube has its inward neighbour's joints, and the pose's own cube has q, (S,)."""
    robot, scale, cells = test.bounds.robot, test.bounds.column_scale, cubes.cells
    neighbour = _inward_neighbours(grid, cubes)
    nearest = grid.nearest(cubes)
    joints = _close(test, cells, nearest)
    point = test(nearest, joints, np.zeros(len(nearest)))
    agree = point.proved & (neighbour >= 0)
    for index in (np.arange(len(nearest)), neighbour):
        offset = difference(robot, cells.q[index], joints)[:, robot.moving] / scale
        agree &= (ROUND_UP * (np.abs(offset) + point.radii) <= cells.radii[index]).all(axis=1)
    home = (nearest == 0).all(axis=1)
    offset = difference(robot, cells.q[home], np.repeat(q[None], np.count_nonzero(home), axis=0))
    offset = np.abs(offset[:, robot.moving] / scale) + LOOP_GAP
    agree[home] &= (offset <= cells.radii[home]).all(axis=1)
    return agree


def _inward_neighbours(grid: _Grid, cubes: _Cubes) -> IntArray:
    """Find the cube (S,) behind each one's nearest point, on the way to the pose; -1 for none, or itself."""
    inward, neighbour = grid.inward(cubes).astype(np.intp), np.full(len(cubes.level), -1)
    for level in np.unique(cubes.level):
        of_level = np.flatnonzero(cubes.level == level)
        number_of = {
            tuple(places): k for k, places in zip(of_level, cubes.places[of_level].tolist(), strict=True)
        }
        behind = (inward >> (MAX_CUTS - level)).tolist()
        numbers = [number_of.get(tuple(places), k) for places, k in zip(behind, neighbour, strict=True)]
        neighbour = np.array(numbers, dtype=np.intp)
    return neighbour


def _close(test: CellTest, cells: Cells, z: Array) -> Array:
    """Compute joints (S, nq) at points z (S, n), on from the middle of a cell each."""
    robot = test.bounds.robot
    offset = np.einsum("skn,sn->sk", cells.slope, z - cells.z)
    change = np.clip(offset, -MAX_STEP, MAX_STEP) * test.bounds.column_scale
    guess = integrate_columns(robot, cells.q, robot.moving, change)
    result = close_each(robot, test.x + z * test.scale, guess)
    return np.where(result.closed[:, None], result.q, guess)


class Cells(NamedTuple):
    """S cells with joints at their middles."""

    z: Array  # (S, n) middles off the pose [robot lengths, rad]
    q: Array  # (S, nq)
    proved: BoolArray  # (S,)
    slope: Array  # (S, k, n) of the joints along the platform's coordinates
    radii: Array  # (S, k) of the box with one pose for each x
    signs: Array  # (S, 2) of det dF/dq and det P at the middle


class CellTest(NamedTuple):
    """The test of cells about a pose of a robot."""

    bounds: DerivativeBounds
    x: Array  # (n,)
    scale: Array  # (n,)

    def __call__(self, z: Array, q: Array, half: Array, *, ball: bool = False) -> Cells:
        """Test cells of half a width (S,), or balls of that radius, joints q (S, nq) near their middles."""
        bounds, n, n_a = self.bounds, self.bounds.robot.n, self.bounds.robot.n_a
        derivatives = bounds.evaluate(q)
        off = bounds.robot.platform.residual(derivatives.frames, self.x + z * self.scale) / self.scale
        values = np.concatenate([off, derivatives.values[:, n:]], axis=1)
        inverse = inverses(derivatives.slopes)
        along = inverse[:, :, :n]
        box = _joint_boxes(derivatives, values, inverse, _extent(along, half, ball))
        regular = _passive_block_is_regular(derivatives, along, half, box, ball)
        signs = np.stack(
            [np.linalg.slogdet(P)[0] for P in (derivatives.slopes, derivatives.slopes[:, n:, n_a:])], axis=1
        )
        return Cells(z, q, box.proved & regular, along, box.radii, signs)


class _JointBoxes(NamedTuple):
    """Boxes of joints with one pose for each x of a cell."""

    proved: BoolArray  # (S,)
    error: Array  # (S, k)
    radii: Array  # (S, k)
    remainders: Remainders


def _extent(along: Array, half: Array, ball: bool) -> Array:
    """Bound along dz (S, ...) over cells or balls, the last axis that of z (n)."""
    size = np.linalg.norm(along, axis=-1) if ball else np.abs(along).sum(axis=-1)
    return size * half.reshape(-1, *[1] * (size.ndim - 1))


def _joint_boxes(derivatives: Derivatives, values: Array, inverse: Array, reach: Array) -> _JointBoxes:
    """Widen boxes of joints until Krawczyk's test holds; x moves the joints by reach (S, k) at most."""
    k, size = inverse.shape[1], np.abs(inverse)
    exact = np.abs(times(inverse, values)) + times(
        size, gamma(k) * np.abs(values) + derivatives.bounds.rounding
    )
    rest = identity_defect(inverse, derivatives.slopes)
    invertible = (size > 0).any(axis=(1, 2))
    radii = WIDENING_RATIO * (exact + reach) + MIN_RADIUS
    for widening in range(MAX_WIDENINGS):
        remainders = derivatives.remainders(radii)
        error = ROUND_UP * (exact + times(size, remainders.values) + times(rest, radii))
        contracts = _spectral_radius_below_one(size @ remainders.slopes + rest, radii)
        into_itself = (ROUND_UP * (reach + error) < radii).all(axis=1)
        proved = into_itself & contracts & invertible
        if proved.all() or widening == MAX_WIDENINGS - 1:
            break
        wider = np.minimum(WIDENING_RATIO * (reach + error), MAX_RADIUS) + MIN_RADIUS
        radii = np.where(proved[:, None], radii, wider)
    return _JointBoxes(proved, error, radii, remainders)


def _passive_block_is_regular(
    derivatives: Derivatives, along: Array, half: Array, box: _JointBoxes, ball: bool
) -> BoolArray:
    """Whether P = dF/dq of loops and passive joints is regular all over the cells (S,): no Type 2."""
    n, n_a, rounding = derivatives.bounds.robot.n, derivatives.bounds.robot.n_a, derivatives.bounds.rounding
    P, dP = derivatives.slopes[:, n:, n_a:], derivatives.hessians[:, n:, n_a:]
    Y, s, k = inverses(P), P.shape[1], along.shape[1]
    Y_size, dP_size = np.abs(Y), np.abs(dP)
    changes = np.einsum("sij,sjkl,sln->sikn", Y, dP, along, optimize=True)
    step = _extent(along, half, ball=False)
    rounded = np.einsum("sij,sjkl,sl->sik", Y_size, dP_size, step, optimize=True)
    N = identity_defect(Y, P) + _extent(changes, half, ball) + gamma(s * k) * rounded
    beside = np.einsum("sjkl,sl->sjk", dP_size + rounding, box.error)
    beside += 0.5 * np.einsum("sjkl,sl->sjk", box.remainders.hessians[:, n:, n_a:], box.radii)
    beside += rounding * (1 + step.sum(axis=1))[:, None, None]
    N = ROUND_UP * (N + Y_size @ beside)
    return _spectral_radius_below_one(N, np.ones((1, s))) & (Y_size > 0).any(axis=(1, 2))


def _spectral_radius_below_one(N: Array, weights: Array) -> BoolArray:
    """Whether matrices N >= 0 (S, k, k) have a spectral radius below 1, by N w < w."""
    rows = N.sum(axis=2)
    shifted = rows + PERRON_SHIFT * rows.max(axis=1, keepdims=True)  # near the eigenvector of Perron
    below = np.zeros(len(N), dtype=bool)
    for w in (weights, np.ones_like(rows), shifted):
        below |= (ROUND_UP * times(N, np.broadcast_to(w, rows.shape)) < w).all(axis=1)
    return below
