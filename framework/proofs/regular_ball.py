"""The largest ball about a pose of the platform that is proved to be free of singularities.

The ball is one cell (`CellTest`), or is covered by cubes. A cube without proof is halved along each axis, the
nearest first, until the nearest remaining cube is too small to be cut (`branch_and_bound`). All cubes within
a radius belong to one branch if each agrees with its neighbour towards the pose: at its point nearest to the
pose it has the same joints. Two regular cubes that agree at one point of a common face agree all over it; the
rest follows by induction.

The test proves that a cell of platform coordinates x is free of singularities on one branch. Let the middle
x_m have the joints q_m, F = [platform - x ; loops], and Y be the inverse of dF/dq at the middle. If, by
`derivative_bounds`, the map q - Y F takes the box |q - q_m| < r into itself and contracts it (Krawczyk), then
for every x of the cell the box holds one pose, and no Type 1 singularity. There is no Type 2 singularity
either if a bound on |1 - Y_P P|, with Y_P near the inverse of P at the middle, has a spectral radius below 1
(`_passive_block_is_regular`). A turn of the platform is measured from the middle by the antisymmetric part of
R R_m'. Its size is the sine of the angle, which is no more than the change of the coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.attitude import RotationVector, TwistAngle, TwoAngles
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform
from framework.numerics.arrays import Array, BoolArray, IntArray, assign, join, select
from framework.proofs.branch_and_bound import Examined, branch_and_bound
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives, Remainders
from framework.proofs.equation_terms import list_unbounded_joints
from framework.proofs.krawczyk import MIN_RADIUS, NewtonMap, widen_until_proved
from framework.proofs.rounding import ROUND_UP, WIDENING_RATIO, approximate_inverses, gamma, identity_defect
from framework.tolerances import LOOP_GAP

MAX_CELLS = 20_000
MAX_CUTS = 12  # halvings of the first cube; the smallest cubes are about a thousandth of the ball wide
MAX_TURN = np.pi / 2 / ROUND_UP  # [rad] of a ball; beyond a right angle the sine has two angles
OFF_CENTRE = 0.4370160244488211  # position of the pose in the first cube, over its width: on no cube's face


def prove_regular_ball(
    robot: ParallelRobot,
    q: Array,
    x: Array,
    within: float,
    *,
    max_cells: int = MAX_CELLS,
    max_work: float = 3e8,  # number of cells times the fourth power of the number of joints: some seconds
) -> float:
    """Return the radius [robot lengths, rad] of a ball about a pose proved free of singularities.

    The pose has the platform coordinates x (n,) and the configuration q (nq,). In the open ball no pose on
    the branch of q is singular, of Type 1 or Type 2. The radius is 0 if nothing is proved. For platforms that
    turn about three axes or have more than three coordinates, only one cell is tried. Nothing is proved for
    platforms that turn about two axes, or about one without moving in a plane, nor for robots with moving
    ball joints or couplings.

    Args:
        within: the largest radius of interest [robot lengths, rad].
        max_cells: number of cells tested at most; the last batch may exceed it.
    """
    platform = robot.platform
    attitude = platform.attitude if isinstance(platform, FramePlatform) else None
    turns_in_plane = isinstance(attitude, TwistAngle) and planar_normal(robot) is not None
    unmeasured_turn = isinstance(attitude, TwistAngle | TwoAngles) and not turns_in_plane
    if list_unbounded_joints(robot) or unmeasured_turn:
        return 0.0

    test = CellTest(DerivativeBounds.of(robot), x)
    single_radius = _prove_one_cell(test, q, min(within, MAX_TURN))
    if robot.n > 3 or isinstance(attitude, RotationVector):
        return single_radius
    # the work of a cell grows as the fourth power of the number of joints
    affordable_cells = int(max_work / len(robot.moving) ** 4)
    return max(single_radius, _prove_cubes(test, q, within, min(max_cells, affordable_cells)))


def _prove_one_cell(test: CellTest, q: Array, within: float) -> float:
    """Compute the radius of the largest ball about q (nq,) proved as one cell; 0 for none.

    First the radii `within` / 2^k [robot lengths, rad] are tried, down to rounding. Then radii in small
    steps are tried, from the largest proved one to its double.
    """
    steps_per_octave = 20  # radii tried between the largest proved radius and its double
    halvings = np.arange(np.finfo(float).nmant)  # as many as a number has binary digits
    halved = _largest_proved(test, q, np.ldexp(within, -halvings))
    if not halved:
        return 0.0
    radii = halved * np.exp2(np.arange(steps_per_octave) / steps_per_octave)
    return _largest_proved(test, q, radii[radii <= within])


def _largest_proved(test: CellTest, q: Array, radii: Array) -> float:
    """Return the largest of the radii (S,) of balls about q (nq,) that are proved; 0 for none."""
    at_pose = np.zeros((len(radii), len(test.x)))
    cells = test(at_pose, np.tile(q, (len(radii), 1)), radii, dual_norm=2)
    return float(radii[cells.proved].max(initial=0.0))


class _Cubes(NamedTuple):
    """S cubes of nested grids, each with its cell; an untested cube has the cell of its parent.

    The first cube contains the pose at 0 and has the width 1. Each level halves the width.
    """

    level: IntArray  # (S,) number of halvings of the first cube
    numbers: IntArray  # (S, n) index of the cube along each axis, among the cubes of its level
    cells: Cells  # of S

    @property
    def widths(self) -> Array:
        """Widths (S, 1) of the cubes."""
        return np.ldexp(1.0, -self.level[:, None])

    def middles(self) -> Array:
        """Compute the middles (S, n) of cubes, relative to the pose."""
        return (self.numbers + 0.5) * self.widths - OFF_CENTRE

    def nearest_points(self) -> Array:
        """Compute the point (S, n) of each cube that is nearest to the pose, relative to the pose."""
        lower = self.numbers * self.widths - OFF_CENTRE
        upper = (self.numbers + 1) * self.widths - OFF_CENTRE
        return np.clip(0.0, lower, upper)

    def split(self) -> _Cubes:
        """Split each cube into 2^n cubes of half the width."""
        S, n = self.numbers.shape
        corners = np.indices((2,) * n).reshape(n, -1).T  # (2^n, n) all rows of 0 and 1
        parent = np.repeat(np.arange(S), len(corners))
        numbers = 2 * self.numbers[parent] + np.tile(corners, (S, 1))
        return _Cubes(self.level[parent] + 1, numbers, select(self.cells, parent))

    def inward_neighbours(self) -> IntArray:
        """Find for each cube the index (S,) of its neighbour towards the pose; -1 for none.

        Outside of each cube, at its point nearest to the pose, lies one cube of the smallest size (level
        MAX_CUTS). The neighbour is the cube of the stack that contains this smallest cube. Along each axis a
        given cube of this stack covers `count` smallest cubes. The number of the one sought is that of the
        smallest cube about the pose, clipped to the range from one before to one behind the covered ones. The
        cube about the pose is its own neighbour.
        """
        pose = int(np.floor(OFF_CENTRE * 2**MAX_CUTS))  # number of the smallest cube about the pose
        count = 2 ** (MAX_CUTS - self.level[:, None])  # (S, 1) smallest cubes along an edge
        inward = np.clip(pose, self.numbers * count - 1, (self.numbers + 1) * count)  # (S, n)

        # of the cubes that contain the smallest one, one for each level, at most one is in the stack
        keys = np.column_stack([self.level, self.numbers]).tolist()
        index_of = {tuple(key): index for index, key in enumerate(keys)}
        neighbour = np.full(len(keys), -1)
        for level in np.unique(self.level).tolist():
            # numbers (S, n) of the cubes of this level that contain the smallest cubes: each coarser level
            # halves the numbers
            ancestors = inward >> (MAX_CUTS - level)
            for k, numbers in enumerate(ancestors.tolist()):
                neighbour[k] = index_of.get((level, *numbers), neighbour[k])
        return neighbour


def _prove_cubes(test: CellTest, q: Array, within: float, max_cells: int) -> float:
    """Return the distance of the nearest cube that is not proved to be on the branch of q (nq,).

    Distances are in robot lengths and rad. Cubes are tested up to the distance `within`, at most `max_cells`
    of them. First each cube is tested alone. Then the proved ones are compared with their neighbours.
    """
    n = len(test.x)  # platform coordinates
    # the nearest faces of the first cube are OFF_CENTRE of its width away from the pose
    width = within / OFF_CENTRE * ROUND_UP  # [robot lengths, rad]
    start = test(np.zeros((1, n)), q[None], np.array([width]))
    first = _Cubes(np.zeros(1, dtype=np.intp), np.zeros((1, n), dtype=np.intp), start)

    def distances(cubes: _Cubes) -> Array:
        """Compute the distances (S,) of cubes from the pose, rounded down."""
        return width * np.linalg.norm(cubes.nearest_points(), axis=1) / ROUND_UP

    def examine(cubes: _Cubes) -> Examined[_Cubes, _Cubes]:
        """Test cubes; split cubes without proof, but leave the smallest ones undecided."""
        z = width * cubes.middles()  # (S, n)
        tested = test(z, _continue_joints(test, cubes.cells, z), 0.5 * width * cubes.widths[:, 0])
        # a cube whose joints turn out to be on another branch is not proved, and keeps its parent's cell
        is_elsewhere = (tested.signs != start.signs).any(axis=1)
        parents = cubes.cells._replace(proved=np.zeros(len(z), dtype=bool))
        assign(tested, is_elsewhere, select(parents, is_elsewhere))  # in the arrays of `tested`
        cubes = cubes._replace(cells=tested)
        proved = cubes.cells.proved
        is_smallest = cubes.level == MAX_CUTS
        undecided = select(cubes, ~proved & is_smallest)
        pending = select(cubes, ~proved & ~is_smallest).split()
        return Examined(select(cubes, proved), undecided, pending)

    tested, limit = branch_and_bound(examine, first, max_examined=max_cells, distance=distances, limit=within)
    proved = join(tested.proved)
    proved = select(proved, distances(proved) < limit)
    if not len(proved.level):
        return 0.0
    # the ball ends at the nearest cube without proof, or on another branch
    disagreeing = select(proved, ~_agree_with_inner_neighbours(test, width, proved, q))
    return float(distances(disagreeing).min(initial=limit))


def _agree_with_inner_neighbours(test: CellTest, width: float, cubes: _Cubes, q: Array) -> BoolArray:
    """Return whether each cube is on the branch of its inward neighbour, (S,).

    The cube about the pose must have the joints q (nq,) of the pose. At the point nearest to the pose each
    cube has exactly one configuration, in the joint box of a cell of size zero. Two cubes share this
    configuration if the joint boxes of both contain this box. `width` is that of the first cube [robot
    lengths, rad].
    """
    cells = cubes.cells
    nearest = width * cubes.nearest_points()
    neighbour = cubes.inward_neighbours()
    joints = _continue_joints(test, cells, nearest)
    points = test(nearest, joints, np.zeros(len(nearest)))  # cells of size zero, with radii of joint boxes
    # a cube without a neighbour (-1) does not agree, although it is compared with the last cube
    agree = points.proved & (neighbour >= 0)
    for sharing_cells in (cells, select(cells, neighbour)):
        agree &= _contain_joint_boxes(test, sharing_cells, joints, ROUND_UP * points.radii)
    has_pose = (nearest == 0).all(axis=1)  # the cube about the pose
    agree[has_pose] &= _contain_joint_boxes(test, select(cells, has_pose), q, LOOP_GAP)
    return agree


def _contain_joint_boxes(test: CellTest, cells: Cells, q: Array, radii: Array | float) -> BoolArray:
    """Return whether the joint boxes of S cells contain boxes of `radii` (S, k) about q (S, nq), (S,).

    The joint box of a cell has the radii `cells.radii` about the joints at the middle of the cell.
    """
    robot = test.bounds.robot
    offset = difference(robot, cells.q, q)[:, robot.moving] / test.bounds.column_scale
    return np.all(ROUND_UP * np.abs(offset) + radii <= cells.radii, axis=1)


def _continue_joints(test: CellTest, cells: Cells, z: Array) -> Array:
    """Continue joints (S, nq) from the middles of cells to points z (S, n).

    The joints are extrapolated along the slope of the cell, then Newton's method closes the loops. Where it
    fails, the extrapolated joints are returned.
    """
    robot = test.bounds.robot
    change = np.matvec(cells.joint_slopes, z - cells.z)  # (S, k)
    step = np.clip(change, -MAX_NEWTON_STEP, MAX_NEWTON_STEP)  # the slope may be huge near a singularity
    guess = integrate_columns(robot, cells.q, robot.moving, step * test.bounds.column_scale)
    result = close_each(robot, test.x + z * robot.platform_scale, guess)
    return np.where(result.closed[:, None], result.q, guess)


class Cells(NamedTuple):
    """S cells of platform coordinates, with the k moving joints at their middles."""

    z: Array  # (S, n) middles, relative to the pose [robot lengths, rad]
    q: Array  # (S, nq) configurations at the middles
    proved: BoolArray  # (S,) to be free of singularities
    joint_slopes: Array  # (S, k, n) derivatives of the joints along z
    radii: Array  # (S, k) of the joint box that holds one pose for each x of the cell [robot lengths, rad]
    signs: Array  # (S, 2) of det dF/dq and det P at the middle: equal on one branch


class CellTest(NamedTuple):
    """The test of cells about a pose of a robot."""

    bounds: DerivativeBounds  # of F along the moving joints
    x: Array  # (n,) platform coordinates of the pose

    def __call__(self, z: Array, q: Array, half: Array, *, dual_norm: int = 1) -> Cells:
        """Test S cells, each about one point.

        F is [platform - x ; loops], and dF (S, k, k) its Jacobian along the joints. The rows of the loops and
        the columns of the passive joints are the block P of dF. All of them are dimensionless.

        Args:
            z: (S, n) middles of the cells, relative to the pose [robot lengths, rad].
            q: (S, nq) configurations at the middles, with closed loops.
            half: (S,) half widths of cubes, or radii of balls [robot lengths, rad].
            dual_norm: 1 if the cells are cubes, 2 if they are balls: the exponent of the norm that
                `_bound_over_cell` takes of slopes.
        """
        robot = self.bounds.robot
        derivatives = self.bounds.evaluate(q)
        F = derivatives.values.copy()  # (S, k) its rows of the platform do not contain the value yet
        x = self.x + z * robot.platform_scale  # (S, n) [m, rad]
        F[:, : robot.n] = robot.platform.residual(derivatives.frames, x) / robot.platform_scale
        dF = derivatives.slopes  # (S, k, k)

        newton = NewtonMap.of(dF, F)
        # dF dq = [dz; 0], so the first n columns of the inverse are the derivatives of the joints
        joint_slopes = newton.Y[:, :, : robot.n]
        boxes = _prove_joint_boxes(derivatives, newton, _bound_over_cell(joint_slopes, half, dual_norm))
        regular = _passive_block_is_regular(derivatives, joint_slopes, half, boxes, dual_norm)

        P = dF[:, robot.n :, robot.n_a :]
        signs = np.column_stack([np.linalg.slogdet(block).sign for block in (dF, P)])
        return Cells(z, q, boxes.proved & regular, joint_slopes, boxes.radii, signs)


class _JointBoxes(NamedTuple):
    """Boxes of k joints about the middles of S cells."""

    proved: BoolArray  # (S,) to hold one pose for each x of the cell
    hopeless: BoolArray  # (S,) whether Newton's map does not contract in the box, so in no wider one either
    radii: Array  # (S, k) of the boxes
    image: Array  # (S, k) radii of the box in which the joints are, for all x of the cell
    error: Array  # (S, k) largest distance of the joints from their linear change with x
    remainders: Remainders  # of the equations within the radii


def _bound_over_cell(slopes: Array, half: Array, dual_norm: int) -> Array:
    """Bound |slopes . dz| (S, ..) over changes dz (S, n) in S cells, slopes (S, .., n).

    Hoelder's inequality gives the bound `half` (S,) times a norm of the slopes, with the exponent
    `dual_norm`: the 1-norm over cubes of half width `half`, the 2-norm over balls of this radius.
    """
    sizes = np.linalg.norm(slopes, dual_norm, axis=-1)
    return (sizes.T * half).T  # `half` multiplies along the first axis


def _prove_joint_boxes(derivatives: Derivatives, newton: NewtonMap, reach: Array) -> _JointBoxes:
    """Widen boxes of k joints about the middles of S cells until Krawczyk's test holds.

    The map q - Y F takes a box of radii r into a box of radii reach + error, with

        error = |Y F| + |1 - Y dF| r + |Y| (remainder of F in the box).

    Args:
        derivatives: of F at the middles.
        newton: the map at the middles.
        reach: (S, k) largest linear change of the joints with x within the cell.
    """
    offset = np.abs(newton.root)

    def test(radii: Array) -> _JointBoxes:
        """Bound the images of boxes of radii (S, k)."""
        remainders = derivatives.remainders(radii)
        error = ROUND_UP * (offset + newton.errors(remainders.values, radii))
        image = ROUND_UP * (reach + error)
        bound = np.abs(newton.Y) @ remainders.slopes + newton.defect  # of |1 - Y dF| in the box
        contracts = _spectral_radius_below_one(bound) & newton.has_inverse
        is_inside = (image < radii).all(axis=1)
        return _JointBoxes(is_inside & contracts, ~contracts, radii, image, error, remainders)

    return widen_until_proved(test, WIDENING_RATIO * (offset + reach) + MIN_RADIUS)


def _passive_block_is_regular(
    derivatives: Derivatives, joint_slopes: Array, half: Array, boxes: _JointBoxes, dual_norm: int
) -> BoolArray:
    """Return whether P is regular all over the cells, (S,): no Type 2 singularity.

    P is the block of dF/dq of loops and passive joints, P_m its value at the middle, and Y is near the
    inverse of P_m. From the middle the joints change by joint_slopes dz, up to their error. P is regular
    where the bound N on |1 - Y P|,

        N = |1 - Y P_m| + |Y dP joint_slopes| |dz| + |Y| (|dP| error + |change of dP| radii / 2),

    has a spectral radius below 1.

    Args:
        joint_slopes: (S, k, n) derivatives of the joints along the platform's coordinates.
        half: (S,) half widths of cubes, or radii of balls [robot lengths, rad].
        boxes: (S, k) boxes that hold the joints of the cells.
        dual_norm: 1 if the cells are cubes, 2 if they are balls.
    """
    robot = derivatives.bounds.robot
    rounding = derivatives.bounds.rounding
    P = derivatives.slopes[:, robot.n :, robot.n_a :]  # (S, s, s)
    dP = derivatives.hessians[:, robot.n :, robot.n_a :]  # (S, s, s, k)
    dP_change = boxes.remainders.hessians[:, robot.n :, robot.n_a :]  # (S, s, s, k) bounds
    s, k = dP.shape[2:]
    Y = approximate_inverses(P)
    Y_size = np.abs(Y)
    dP_size = np.abs(dP)

    # linear change of Y P with the platform's coordinates, and its rounding
    changes = np.einsum("sij,sjkl,sln->sikn", Y, dP, joint_slopes, optimize=True)  # (S, s, s, n)
    step = _bound_over_cell(joint_slopes, half, dual_norm=1)  # (S, k) of the joints
    rounded = np.einsum("sij,sjkl,sl->sik", Y_size, dP_size, step, optimize=True)
    N = identity_defect(Y, P) + _bound_over_cell(changes, half, dual_norm) + gamma(s * k) * rounded

    # remaining change of P; along a line from the middle, dP changes by half its largest change on average
    P_errors = np.einsum("sjkl,sl->sjk", dP_size + rounding, boxes.error)
    P_errors += 0.5 * np.einsum("sjkl,sl->sjk", dP_change, boxes.radii)
    P_errors += rounding * (1 + step.sum(axis=1))[:, None, None]
    N = ROUND_UP * (N + Y_size @ P_errors)
    return _spectral_radius_below_one(N) & Y.any(axis=(1, 2))  # Y is zero where P_m is singular


def _spectral_radius_below_one(N: Array) -> BoolArray:
    """Return whether matrices N >= 0 (S, k, k) have a spectral radius below 1, (S,); False if undecided.

    This holds if N w < w for a vector w > 0 (Collatz 1942). The best w is the Perron eigenvector. The row
    sums are close to it; `shift` times the largest row sum is added to all of them, so that w > 0.
    """
    shift = 0.1  # share of the largest row sum, added to all row sums to make positive weights
    sums = N.sum(axis=2)
    w = sums + shift * sums.max(axis=1, keepdims=True)
    return np.asarray((ROUND_UP * np.matvec(N, w) < w).all(axis=1))
