"""All singular poses of a robot with one or two freedoms, in boxes, with a proof that there are no others.

Boxes are of all moving joints: hinges turn all the way round, slides move within a reach. The proof trusts
pinocchio's positions and directions at one configuration up to `tolerances.FRAME_ROUNDING`.

Let F = [platform - x ; loops]. A singular set consists of the poses in which a block of dF/dq loses rank, so
that the bordered scalar g of the block is zero. A box is dropped if the loops cannot close in it, or if g is
zero nowhere in it. It is narrowed by the equations {loops = 0, g = 0}. It is kept if Krawczyk's test proves
that a slightly larger box holds exactly one singular pose for each value of one of its joints (with one
freedom: a single pose), and if the tube about this arc is small.

Sources: Merlet, Parallel Robots, 2nd ed., Springer 2006, chapter 11; Bohigas, Manubens and Ros, Singularities
of Robot Mechanisms, Springer 2017, who pave {closures = 0, rank lost} by linear relaxations.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, finite_numbers, whole_number
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.modes import legs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import JointPlatform
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays, join, select
from framework.numerics.fields import positive
from framework.numerics.ordered_sums import singular_values
from framework.numerics.rotations import wrap_angles
from framework.proofs.branch_and_bound import NO_AXIS, Boxes, Examined, branch_and_bound, narrow_or_halve
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives, Remainders
from framework.proofs.interval_newton import (
    Contracted,
    LinearEnclosure,
    contract,
    enclose_bordered_solutions,
    pivoted_inverses,
)
from framework.proofs.krawczyk import prove_existence
from framework.proofs.rounding import ROUND_UP


@dataclass(frozen=True, eq=False)
class PavedSet(ReadOnlyArrays):
    """The poses of one kind of singularity, in B proved and U undecided boxes.

    A proved box holds exactly one singular pose for every value of its joint `along` (with one freedom:
    exactly one singular pose). Neighbouring boxes overlap.
    """

    name: str  # type_2; or type_1 of the motors of a leg
    x: Array  # (B, n) middles in the platform's coordinates [m, rad]
    x_radii: Array  # (B, n) the proved poses are within these radii
    q: Array  # (B, nq) middles in the joints
    along: IntArray  # (B,) index of the parameter among the moving joints; -1 with one freedom
    undecided_x: Array  # (U, n) middles of undecided boxes
    undecided_x_radii: Array  # (U, n)

    @property
    def complete(self) -> bool:
        """Whether all boxes are decided."""
        return not len(self.undecided_x)


@dataclass(frozen=True, eq=False)
class SingularPaving:
    """All singular sets of a robot; no pose outside of their boxes is singular."""

    robot: ParallelRobot
    sets: tuple[PavedSet, ...]  # Type 2, then Type 1 of each leg
    window: Array | None  # (2, n) least and largest platform coordinates [m, rad]
    resolution: float  # [m, robot lengths] largest width of proved boxes
    reach: float  # [robot lengths] of slides about the reference; hinges turn all the way round
    seconds: float  # computing time

    @property
    def complete(self) -> bool:
        """Whether every box is decided."""
        return all(paved.complete for paved in self.sets)

    @property
    def sentence(self) -> str:
        """Sentence with the numbers of proved and undecided boxes."""
        region = "" if self.window is None else " in the window"
        if self.robot.sliding[self.robot.moving].any():
            region += f", slides within {self.reach:.3g} robot lengths of the reference,"
        counts = ", ".join(f"{paved.name}: {len(paved.x)}" for paved in self.sets)
        count = sum(len(paved.undecided_x) for paved in self.sets)
        undecided = "no box undecided" if self.complete else f"or within {count} undecided ones"
        return f"all singular poses{region} lie within boxes of {self.resolution:.3g} ({counts}), {undecided}"


def pave_singularities(
    robot: ParallelRobot,
    *,
    window: ArrayLike | None = None,
    resolution: float = 1e-3,
    reach: float = 1.2,
    max_boxes: int = 500_000,
) -> SingularPaving:
    """Enclose all Type 1 and Type 2 poses of a robot with one or two freedoms, over all modes.

    Joint limits are ignored, springs are at rest, and loop equations that are redundant at the reference are
    left out. Poses in which P loses rank without a motion of the platform count as Type 2; `classify`
    distinguishes them.

    Args:
        window: (2, n) least and largest platform coordinates [m, rad], angles up to whole turns; everywhere
            by default.
        resolution: largest width of a box in the platform's coordinates [m; robot lengths for turns].
        reach: of slides about the reference, in robot lengths.
        max_boxes: number of boxes tested for each set; the remaining boxes are undecided.

    Raises:
        InvalidInput: the robot has more freedoms, redundant motors, no passive joints or moving ball joints;
            or an option is not a positive number.
    """
    require_square(robot)
    if robot.n > 2 or robot.n_a != robot.n or not robot.n_p:
        raise InvalidInput(
            f"{robot.name}: paving is for robots of one or two freedoms, a motor for each, and passive joints"
        )
    turning = not robot.translations.all() and not isinstance(robot.platform, JointPlatform)
    if turning and planar_normal(robot) is None:
        raise InvalidInput(f"{robot.name}: a platform that turns is paved in a plane only")
    resolution = positive("resolution", resolution)
    reach = positive("reach", reach)
    max_boxes = whole_number("max_boxes", max_boxes, 1, 10**9)
    region = None
    if window is not None:
        region = finite_numbers(
            "window, least and largest platform coordinates,", window, robot.n, stacks=True
        )
        if region.shape != (2, robot.n) or not (region[0] < region[1]).all():
            raise InvalidInput(f"window: needs (2, {robot.n}) numbers, the least and the largest")

    # pave Type 2, then Type 1 of each leg
    start = time.perf_counter()
    bounds = DerivativeBounds.of(robot, reach=reach)
    others = None  # of the loop equations that `DerivativeBounds.of` leaves out, if these may open
    if robot.structure.varies:
        others = DerivativeBounds.of(robot.with_fixed_rows(robot.structure.dropped), reach=reach)
    sets = tuple(
        _pave_set(SingularBoxTest(bounds, others, block, region, resolution), reach, max_boxes)
        for block in singular_sets(bounds.robot)
    )
    return SingularPaving(robot, sets, region, resolution, reach, time.perf_counter() - start)


def _pave_set(test: SingularBoxTest, reach: float, max_boxes: int) -> PavedSet:
    """Pave one set over all turns of hinges and slides within `reach` [robot lengths].

    At most `max_boxes` boxes are tested; the others are undecided.
    """
    bounds = test.bounds
    robot = bounds.robot
    k = len(robot.moving)
    # half a turn is rounded up, so that the ends of the region overlap
    region_radii = np.where(robot.sliding[robot.moving], reach, ROUND_UP * np.pi)
    region = Boxes(np.zeros((1, k)), region_radii[None])
    tested, _ = branch_and_bound(test, region, max_examined=max_boxes)

    arcs = join(tested.proved)
    undecided = join([tested.undecided, tested.pending])  # too small, or not tested
    if test.others is not None:  # an arc of some loop equations proves no pose that closes the others
        unproved = join([undecided, Boxes(arcs.middle, arcs.radii)])
        undecided = select(unproved, ~(test.are_others_open(unproved) | test.are_regular(unproved)))
        arcs = select(arcs, slice(0))

    # where the platform may be in undecided boxes
    derivatives = bounds.evaluate(bounds.configurations(undecided.middle))
    remainders = derivatives.remainders(undecided.radii).values
    return PavedSet(
        name=test.block.name,
        x=arcs.x,
        x_radii=arcs.x_radii,
        q=bounds.configurations(arcs.middle),
        along=arcs.along,
        undecided_x=robot.platform.coordinates(derivatives.frames),
        undecided_x_radii=_platform_radii(derivatives, undecided.radii, remainders),
    )


def _platform_radii(derivatives: Derivatives, radii: Array, remainders: Array) -> Array:
    """Bound the change (S, n) [m, rad] of platform coordinates over S boxes.

    Args:
        derivatives: of the equations at the middles.
        radii: (S, k) of the boxes [rad, robot lengths].
        remainders: (S, R) of the values within these radii.
    """
    robot = derivatives.bounds.robot
    slopes = np.abs(derivatives.slopes[:, : robot.n])  # (S, n, k)
    change = np.matvec(slopes, radii) + remainders[:, : robot.n]
    return robot.platform_scale * ROUND_UP * change


class SingularSet(NamedTuple):
    """Poses in which a block of s rows and columns of dF/dq loses rank."""

    name: str  # type_2, or type_1 with the motors of the leg
    rows: IntArray  # (s,) equations of the block: of the platform, then of the loops
    columns: IntArray  # (s,) joints of the block, as indices into the moving columns


def singular_sets(robot: ParallelRobot) -> list[SingularSet]:
    """Return the blocks of dF/dq that lose rank: Type 2, then Type 1 of each leg.

    The block of Type 2 is that of loops and passive joints. The block of a leg has the equations and the
    joints of the leg, motors included.
    """
    loops = np.arange(robot.n, robot.n + len(robot.loops.names))
    passive = np.arange(robot.n_a, len(robot.moving))
    sets = [SingularSet("type_2", loops, passive)]
    for leg in legs(robot):
        motors = " and ".join(leg.motors) or "joints without a motor"
        sets.append(SingularSet(f"type_1 of {motors}", leg.rows, leg.columns))
    return sets


def enclose_measure(
    block: SingularSet, derivatives: Derivatives, remainders: Remainders
) -> tuple[BoolArray, LinearEnclosure, Array]:
    """Enclose the bordered scalar g of a block P (S, s, s), and its slope (S, k), over boxes.

    With border vectors b and c (s,), g solves [P b; c' 0] [eta; g] = [0; 1] and [P' c; b' 0] [psi; g] = [0;
    1]. Its slope along the k joints is -psi' dP eta (Govaerts 2000).

    Args:
        block: the rows and columns of P in the Jacobian.
        derivatives: of the equations at the middles of S boxes.
        remainders: bounds on the errors of these derivatives within the boxes.

    Returns:
        Whether poses in a box are singular if and only if g = 0 (S,); g as one equation, with the error of
        its value at the middle; bounds (S, 1, k) on the changes of its slopes within the box.
    """
    entries = (slice(None), block.rows[:, None], block.columns)  # of the block
    rounding = derivatives.bounds.rounding
    P = derivatives.slopes[entries]  # (S, s, s)
    right, left = enclose_bordered_solutions(P, remainders.slopes[entries], rounding)  # (eta, g), (psi, g)
    eta = right.z[:, :-1]  # (S, s)
    eta_error = right.error[:, :-1]
    psi = left.z[:, :-1]
    psi_error = left.error[:, :-1]
    dP = derivatives.hessians[entries]  # (S, s, s, k)
    dP_change = remainders.hessians[entries] + rounding  # bounds

    # The change of psi' dP eta is at most the sum of three changes: one factor changes at a time (dP, eta,
    # psi), while the others have their largest sizes.
    psi_size = np.abs(psi)
    eta_size = np.abs(eta) + eta_error
    dP_size = np.abs(dP)
    slope_changes = _bilinear_form(psi_size, dP_change, eta_size)
    slope_changes += _bilinear_form(psi_size, dP_size, eta_error)
    slope_changes += _bilinear_form(psi_error, dP_size + dP_change, eta_size)
    g = LinearEnclosure(
        values=right.z[:, -1:], slopes=-_bilinear_form(psi, dP, eta), errors=right.last_error[:, None]
    )
    return right.valid & left.valid, g, ROUND_UP * slope_changes


def _bilinear_form(left: Array, matrices: Array, right: Array) -> Array:
    """Compute left' M_l right (S, 1, k) of vectors (S, s) for k matrices M_l, in (S, s, s, k)."""
    return np.einsum("si,sijl,sj->sl", left, matrices, right, optimize=True)[:, None]


class Arcs(NamedTuple):
    """B boxes with a proved arc in each, and the platform's coordinates along the arcs."""

    x: Array  # (B, n) at the middles [m, rad]
    x_radii: Array  # (B, n) the arcs are within these radii
    middle: Array  # (B, k) of the boxes [rad, robot lengths]
    radii: Array  # (B, k)
    along: IntArray  # (B,) index of the joint that is the parameter of the arc; NO_AXIS for a point


class _SingularEquations(NamedTuple):
    """The m loop equations and g = 0 in S boxes, and the platform's coordinates."""

    valid: BoolArray  # (S,) whether poses in the box are singular if and only if g = 0
    at_middle: LinearEnclosure  # with the errors of the values at the middle alone
    errors: Array  # (S, m + 1) of values + slopes d in the box itself
    slope_changes: Array  # (S, m + 1, k) bounds on the changes of the slopes in the wider box
    x: Array  # (S, n) at the middle
    x_slopes: Array  # (S, n, k) dimensionless
    x_errors: Array  # (S, n) bounds on the error of x + x_slopes d in the wider box, dimensionless


@dataclass(frozen=True, eq=False)
class SingularBoxTest:
    """The test of boxes for one set of singular poses."""

    bounds: DerivativeBounds  # of the robot's equations
    others: DerivativeBounds | None  # of the loop equations that these need not imply, if there are any
    block: SingularSet  # the block of dF/dq that loses rank
    window: Array | None  # (2, n) least and largest platform coordinates [m, rad]
    resolution: float  # [m, robot lengths] largest width of a box with an arc
    tested_box_ratio: float = 1.5  # radii of the box of Krawczyk's test, divided by those of the box itself
    widening: float = 4.0  # [1/rad] times the largest radius squared: widens tested boxes for curved arcs
    min_size_ratio: float = 0.01  # a box smaller than this share of the resolution is left undecided

    def __call__(self, boxes: Boxes) -> Examined[Boxes, Arcs]:
        """Drop, keep, narrow or cut S boxes of k joints.

        The loops narrow all boxes. The measure g is valid in a box if its poses are singular exactly where g
        = 0; there, loops and g narrow the box further and prove arcs. A box with a proved arc that is too
        large is cut across the parameter of the arc.
        """
        # the loops narrow boxes, and drop those in which they cannot close or that are outside of the window
        n = self.bounds.robot.n  # the first n equations are those of the platform
        derivatives = self.bounds.evaluate(self.bounds.configurations(boxes.middle))
        errors = derivatives.remainders(boxes.radii).values
        loops = LinearEnclosure(derivatives.values[:, n:], derivatives.slopes[:, n:], errors[:, n:])
        remaining = contract(loops, boxes.radii, pivoted_inverses(loops.slopes, boxes.radii))
        possible = ~remaining.empty & self._meets_window(derivatives, boxes.radii, errors)
        if self.others is not None:
            possible &= ~self.are_others_open(boxes)
        boxes = select(boxes, possible)
        remaining = select(remaining, possible)
        loops = select(loops, possible)
        derivatives = derivatives.take(np.flatnonzero(possible))

        # Krawczyk's test proves arcs in boxes that are a little wider, by their radii (S, k)
        wider = self.tested_box_ratio * boxes.radii
        wider += self.widening * boxes.radii.max(axis=1, keepdims=True, initial=0.0) ** 2
        equations = self._singular_equations(derivatives, loops, boxes.radii, wider)
        valid = equations.valid
        narrowed, parameter, is_arc, arcs = self._decide_arcs(
            select(boxes, valid), wider[valid], select(equations, valid)
        )

        # where g is valid, its narrower boxes replace those that the loops alone have left, in place
        remaining.lower[valid], remaining.upper[valid] = narrowed
        axis = np.full(boxes.size, NO_AXIS)  # (S,) joint across which a box must be cut
        axis[valid] = parameter

        # boxes with a small arc are finished; narrow the others again, cut them or leave them undecided
        unfinished = ~remaining.empty
        unfinished[valid] &= ~is_arc
        narrow = select(boxes.sub_boxes(*remaining), unfinished)
        is_small = self.bounds.robot.length * narrow.radii.sum(axis=1) < self.min_size_ratio * self.resolution
        undecided, pending = narrow_or_halve(select(boxes, unfinished), narrow, axis[unfinished], is_small)
        return Examined(arcs, undecided, pending)

    def are_others_open(self, boxes: Boxes) -> BoolArray:
        """Return whether one of the other loop equations has no root in S boxes, (S,)."""
        assert self.others is not None
        n = self.others.robot.n
        derivatives = self.others.evaluate(self.others.configurations(boxes.middle))
        errors = derivatives.remainders(boxes.radii).values[:, n:]
        change = ROUND_UP * (np.matvec(np.abs(derivatives.slopes[:, n:]), boxes.radii) + errors)
        return np.asarray((np.abs(derivatives.values[:, n:]) > change).any(axis=1))

    def are_regular(self, boxes: Boxes) -> BoolArray:
        """Return whether all loop equations together prove that S boxes hold no singular pose, (S,).

        Type 2: all of them along the passive joints have full rank; Type 1: the platform's equations and all
        of them. A singular value changes by no more than the matrix does (Weyl).
        """
        assert self.others is not None
        n = self.bounds.robot.n
        of_bounds, of_others = (
            bounds.evaluate(bounds.configurations(boxes.middle)) for bounds in (self.bounds, self.others)
        )
        slopes = np.concatenate([of_bounds.slopes, of_others.slopes[:, n:]], axis=1)  # (S, n + rows, k)
        remainders = [part.remainders(boxes.radii).slopes for part in (of_bounds, of_others)]
        changes = np.concatenate([remainders[0], remainders[1][:, n:]], axis=1)
        if self.block.name == "type_2":
            slopes, changes = slopes[:, n:, self.block.columns], changes[:, n:, self.block.columns]
        least = singular_values(slopes).min(axis=1)
        return least > ROUND_UP * np.linalg.norm(changes + self.bounds.rounding, axis=(1, 2))

    def _meets_window(self, derivatives: Derivatives, radii: Array, errors: Array) -> BoolArray:
        """Return whether boxes may have poses in the window, (S,).

        The window (2, n) holds the least and the largest platform coordinates; without one, all boxes do. The
        distance from its middle is at most half its width plus the change within the box. Angles are compared
        modulo whole turns.

        Args:
            derivatives: of the R equations at the middles of S boxes.
            radii: (S, k) of the boxes.
            errors: (S, R) bounds on the remainders of the equations in the boxes.
        """
        robot = self.bounds.robot
        if self.window is None:
            return np.ones(len(radii), dtype=bool)
        offset = robot.platform.coordinates(derivatives.frames) - self.window.mean(axis=0)
        offset = np.where(robot.translations, offset, wrap_angles(offset))
        reach = 0.5 * np.ptp(self.window, axis=0) + _platform_radii(derivatives, radii, errors)
        return (np.abs(offset) <= reach).all(axis=1)

    def _singular_equations(
        self, derivatives: Derivatives, loops: LinearEnclosure, radii: Array, wider: Array
    ) -> _SingularEquations:
        """Join loops and measure g to the equations of singular poses.

        Each equation is linearised at the middle of a box: value + slope d at the offset d. Two errors belong
        to this linear form: of the value at d = 0 (rounding), and of the whole form anywhere in the box.

        Args:
            derivatives: of all equations at the middles of S boxes.
            loops: the loop equations; their `errors` hold anywhere in the boxes.
            radii: (S, k) of the boxes.
            wider: (S, k) radii of larger boxes, in which changes of the slopes are bounded.
        """
        n = self.bounds.robot.n  # the first n equations are those of the platform
        remainders = derivatives.remainders(wider)  # bounds for values and slopes in the larger boxes
        # g.errors (S, 1) hold at the middles, g_slope_changes (S, 1, k) in the larger boxes
        valid, g, g_slope_changes = enclose_measure(self.block, derivatives, remainders)
        g_errors = ROUND_UP * (g.errors + np.matvec(g_slope_changes, radii))  # anywhere in the boxes
        loops_at_middle = loops._replace(errors=np.full_like(loops.errors, self.bounds.rounding))
        return _SingularEquations(
            valid=valid,
            at_middle=loops_at_middle.concatenate(g),
            errors=np.hstack([loops.errors, g_errors]),
            slope_changes=np.hstack([remainders.slopes[:, n:], g_slope_changes]),
            x=self.bounds.robot.platform.coordinates(derivatives.frames),
            x_slopes=derivatives.slopes[:, :n],
            x_errors=remainders.values[:, :n],
        )

    def _decide_arcs(
        self, boxes: Boxes, wider: Array, equations: _SingularEquations
    ) -> tuple[Contracted, IntArray, BoolArray, Arcs]:
        """Narrow S boxes by the equations, and prove an arc in boxes of radii `wider` (S, k).

        With two freedoms the set is a curve. Its parameter p is the joint along which the tangent leaves the
        box first; along this joint the tested box is not wider than the box, and `wider` is changed. With one
        freedom the set is a point.

        Returns:
            The parts of the boxes that hold all singular poses; the parameter of the arc (S,), across which a
            large box is cut, NO_AXIS without a proof; whether an arc is proved and small enough (S,); these
            arcs.
        """
        robot = self.bounds.robot
        at_middle = equations.at_middle
        in_box = at_middle._replace(errors=equations.errors)
        remaining = contract(in_box, boxes.radii, pivoted_inverses(in_box.slopes, boxes.radii))

        # choose the parameter
        parameter = None
        along = np.full(boxes.size, NO_AXIS)
        p_radius = np.zeros((boxes.size, 1))  # largest |p| in the box
        if robot.n == 2:
            tangent = np.linalg.svd(in_box.slopes).Vh[:, -1]  # (S, k) the null vector of the slopes
            along = parameter = np.argmax(np.abs(tangent) / boxes.radii, axis=1)
            p_radius = np.take_along_axis(boxes.radii, parameter[:, None], axis=1)
            np.put_along_axis(wider, parameter[:, None], p_radius, axis=1)

        # a proof bounds all solutions, so it narrows the box further, in place
        proof = prove_existence(at_middle, equations.slope_changes, wider, parameter)
        proved = proof.proved[:, None]
        np.maximum(remaining.lower, proof.lower, out=remaining.lower, where=proved)
        np.minimum(remaining.upper, proof.upper, out=remaining.upper, where=proved)

        # the arc runs along p, |p| <= p_radius, within a tube about its tangent
        half_length = np.abs(np.matvec(equations.x_slopes, proof.along)) * p_radius  # (S, n)
        x_radii = half_length + equations.x_errors + np.matvec(np.abs(equations.x_slopes), proof.spread)
        x_radii *= ROUND_UP  # (S, n) in robot lengths and rad
        is_arc = proof.proved & ~remaining.empty
        is_arc &= (2 * robot.length * x_radii <= self.resolution).all(axis=1)
        proved_boxes = boxes.sub_boxes(proof.lower, proof.upper)
        arcs = Arcs(
            equations.x, robot.platform_scale * x_radii, proved_boxes.middle, proved_boxes.radii, along
        )
        return remaining, np.where(proof.proved, along, NO_AXIS), is_arc, select(arcs, is_arc)
