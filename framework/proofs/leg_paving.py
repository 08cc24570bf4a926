"""Proof that the equations of a leg have no solutions besides the known ones, by paving its joints.

The equations are those of the loops whose moving joints all belong to the leg, and those of the platform's
position and attitude; `derivative_bounds` encloses them.

A known solution is the only one in some box about it (`unique_radii`). All other boxes are narrowed and
halved until none of them can hold a solution, or one is too small to be halved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import difference, frames_at, scratch_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, BoolArray, IntArray, select
from framework.proofs.branch_and_bound import NO_AXIS, Boxes, Examined, branch_and_bound, narrow_or_halve
from framework.proofs.derivative_bounds import DerivativeBounds
from framework.proofs.equation_terms import BASE, Term, loop_term, stretched_length
from framework.proofs.interval_newton import LinearEnclosure, contract, damped_inverses
from framework.proofs.rounding import ROUND_UP, identity_defect
from framework.tolerances import DISTINCT_SOLUTIONS, FRAME_ROUNDING, LOOP_GAP, RANK_ROUNDING

Equations = Callable[[Array, Array], LinearEnclosure]  # takes the middles and radii (B, n) of boxes


def are_leg_solutions_complete(
    robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, candidates: Array, x: Array | None
) -> bool:
    """Return whether a leg of k joints provably has no solutions but candidates; False if undecided.

    Args:
        own: (k,) columns of the velocity vector of the leg's joints.
        fixed: (nv,) mask of columns that keep their values in q (nq,). If x contains rotations, q must be
            assembled at x, since the platform's attitude is taken from q.
        candidates: (c, k) offsets of the joints from q [rad, robot lengths]. Those that solve the equations
            are the known solutions.
        x: (n,) coordinates of the platform; None with locked motors.
    """
    platform = robot.platform
    if x is not None and isinstance(platform, JointPlatform):
        # the platform's coordinates are joints: fix these joints at x, and leave x out of the equations
        is_unknown = np.isin(own, platform.columns, invert=True)
        own = own[is_unknown]
        candidates = candidates[:, is_unknown]
        fixed = fixed.copy()
        fixed[platform.columns] = True
        q = q.copy()
        q[platform.q_indices] = x
        x = None
    if not len(own):  # no joints are left: the only solution is the candidate without coordinates
        return len(candidates) > 0
    # few joints are paved, at most one of them a slide, without balls and couplings
    is_many = len(own) > 4 or np.count_nonzero(robot.sliding[own]) > 1
    if is_many or robot.rows.has_couplings or not single_columns(robot.model).issuperset(own.tolist()):
        return False

    slide_reach = _bound_slides(robot, q, x)
    equations = collect_leg_equations(robot, own, fixed, q, x, slide_reach)
    is_slide = robot.sliding[own]
    if not equations.terms or not all(_is_bounded(equations, k) for k in np.flatnonzero(is_slide).tolist()):
        return False
    residuals = equations.enclose(candidates, np.zeros_like(candidates)).values  # (c, m)
    points = candidates[np.abs(residuals).max(axis=1) < LOOP_GAP]
    period = np.where(is_slide, np.inf, 2 * np.pi)
    known = KnownSolutions(points, unique_radii(equations, points), period)
    # one box of all hinge angles, and of slides about zero; half a turn is rounded up: the ends overlap
    slide_zeros = -difference(robot, robot.neutral, q)[own] / robot.length  # (k,) offsets
    radii = np.where(is_slide, slide_reach, ROUND_UP * np.pi)
    region = Boxes(np.where(is_slide, slide_zeros, 0.0)[None], radii[None])
    return has_only_known_solutions(equations.enclose, region, known)


class KnownSolutions(NamedTuple):
    """Known solutions, each alone in a box about its point."""

    points: Array  # (k, n) offsets of n joints [rad, robot lengths]
    radii: Array  # (k,) of the boxes, equal in all coordinates
    period: Array  # (n,) of the coordinates: a whole turn of angles, inf of lengths

    def contains(self, boxes: Boxes) -> BoolArray:
        """Return whether each of B boxes lies in the box of one solution, (B,).

        Angles are compared modulo whole turns, so distances are the shortest ones modulo the period.
        """
        offset = np.mod(np.abs(boxes.middle[:, None] - self.points), self.period)  # (B, k, n)
        distance = np.minimum(offset, self.period - offset)
        farthest = (distance + boxes.radii[:, None]).max(axis=2)  # (B, k) points of the boxes
        return np.any(farthest < self.radii, axis=1)


def unique_radii(equations: DerivativeBounds, points: Array) -> Array:
    """Compute radii (k,) of boxes about points (k, n) with at most one solution each; 1 at most.

    Let J (m, n) be the Jacobian at a point, Y its pseudo-inverse and dJ a bound on the change of J within the
    box. Two solutions in the box are impossible if the mean Jacobian between any two of its points has full
    rank, which holds if |1 - Y J| + |Y| dJ has row sums below 1. Within radius r <= 1, dJ is at most r times
    its value within radius 1, because it grows at least in proportion to the radius. So the row sums are at
    most defect + r change, with the largest row sums of |1 - Y J| and, at radius 1, of |Y| dJ. The result is
    the r for which this bound is 1. The `equations` have n unknowns [rad, robot lengths].
    """
    derivatives = equations.evaluate(equations.configurations(points))
    J = derivatives.slopes  # (k, m, n)
    Y = np.linalg.pinv(J)  # (k, n, m)
    defect = identity_defect(Y, J).sum(axis=2).max(axis=1)  # (k,)
    dJ = derivatives.remainders(np.ones_like(points)).slopes  # (k, m, n) in boxes of radius 1
    change = np.matvec(np.abs(Y), dJ.sum(axis=2)).max(axis=1)  # (k,)
    return np.minimum((1.0 - ROUND_UP * defect) / (ROUND_UP * change), 1.0)


def has_only_known_solutions(equations: Equations, region: Boxes, known: KnownSolutions) -> bool:
    """Return whether the boxes of a region provably hold only known solutions; False if undecided.

    The region, the `equations` and the solutions have one offset for each joint [rad, robot lengths]. A box
    is dropped if its linear enclosure has no solution, or if it lies in the box of a known solution.
    Otherwise the enclosure narrows it, or it is cut.
    """
    max_boxes = 60_000

    def test(boxes: Boxes) -> Examined[Boxes, None]:
        """Narrow boxes; drop boxes without other solutions; test again or halve the rest."""
        linear = equations(*boxes)
        remaining = contract(linear, boxes.radii, damped_inverses(linear, boxes.radii))
        all_narrow = boxes.sub_boxes(remaining.lower, remaining.upper)
        unfinished = ~remaining.empty & ~known.contains(all_narrow)

        # narrow the boxes that may hold another solution again, halve them, or leave them undecided
        narrow = select(all_narrow, unfinished)
        is_small = narrow.radii.max(axis=1) < DISTINCT_SOLUTIONS
        no_axis = np.full(narrow.size, NO_AXIS)
        undecided, pending = narrow_or_halve(select(boxes, unfinished), narrow, no_axis, is_small)
        return Examined(proved=None, undecided=undecided, pending=pending)

    # One undecided box spoils the proof. All boxes get the distance 0: then none is nearer than an undecided
    # box, so that the search ends with the first one.
    tested, _ = branch_and_bound(
        test, region, max_examined=max_boxes, distance=lambda boxes: np.zeros(boxes.size)
    )
    return not (tested.undecided.size or tested.pending.size)


# ------------------------------------------------------------------ the equations


def collect_leg_equations(
    robot: ParallelRobot, own: IntArray, fixed: BoolArray, q: Array, x: Array | None, slide_reach: float
) -> DerivativeBounds:
    """Collect the m equations of a leg in offsets (n,) of its joints from q.

    An equation counts if a joint of the leg moves it and all others that move it are fixed. The platform's
    frame has the number 0.

    Args:
        own: (n,) columns of the velocity vector of the leg's joints.
        fixed: (nv,) mask of the columns that keep their values in q.
        q: (nq,) configuration, assembled at x if x contains rotations.
        x: (n_x,) platform coordinates; None with locked motors.
        slide_reach: largest length of the leg's slides [robot lengths].
    """
    carried = scratch_of(robot).carried  # (frames, nv) whether a joint carries a frame
    free = ~fixed  # joints that are neither fixed nor the leg's
    free[own] = False

    # a joint moves a loop row if it carries just one of the row's two frames
    rows = robot.rows
    moves_row = carried[rows.second] != carried[rows.first]  # (rows, nv)
    loops = np.flatnonzero(moves_row[:, own].any(axis=1) & ~moves_row[:, free].any(axis=1))
    terms = [loop_term(rows, row, number) for number, row in enumerate(loops.tolist())]
    constants = rows.constant[loops].tolist()
    platform = robot.platform
    is_on_platform = carried[0, own].any() and not carried[0, free].any()
    if x is not None and isinstance(platform, FramePlatform) and is_on_platform:
        # positions of the frame's origin [m]; with all rotations in x (three, or one in a plane) also the
        # cosines between the axes of the base and those of the frame, as in q
        values = [("point", (axis,), x[k]) for axis, k in zip(platform.along, platform.sliding, strict=True)]
        if len(platform.turning) == (3 if planar_normal(robot) is None else 1):
            rotation = frames_at(robot, q[None]).rotation[0, 0]
            values += [("direction", axes, cosine) for axes, cosine in np.ndenumerate(rotation)]
        for kind, axes, value in values:
            terms.append(Term(len(terms), (BASE, 0), kind, *axes))
            constants.append(value)
    # a cosine has no unit, a position is divided by the robot's length
    units = [1.0 if term.kind == "direction" else robot.length for term in terms]
    return DerivativeBounds(
        robot=robot,
        origin=q,
        unknowns=own,
        terms=terms,
        linear=np.zeros((len(terms), len(own))),
        constants=np.array(constants),
        row_scale=1.0 / np.array(units),
        rounding=FRAME_ROUNDING * (1.0 + stretched_length(robot, q) + slide_reach),
    )


def _bound_slides(robot: ParallelRobot, q: Array, x: Array | None) -> float:
    """Bound the length [robot lengths] of a slide that leads from one end of a closed loop to the other.

    The slide is no longer than all other links in one line, plus the distances that the rows of the robot and
    the platform's coordinates x (n,) prescribe. x is None with locked motors.
    """
    prescribed = robot.rows.reach.sum() + (0.0 if x is None else np.abs(x).sum())  # [m]
    return ROUND_UP * (stretched_length(robot, q) + float(prescribed) / robot.length)


def _is_bounded(equations: DerivativeBounds, slide: int) -> bool:
    """Return whether a slide moves the end of some chain at its own speed in all poses.

    `_bound_slides` holds for such a slide. The speed is an analytic function of the joints: if it has its
    greatest value, 1, at random joints, it is 1 in all poses, except by chance.

    Args:
        slide: index of the slide among the unknowns.
    """
    offsets = np.random.default_rng(0).uniform(-2, 2, (3, len(equations.unknowns)))  # of three poses
    slopes = equations.evaluate(equations.configurations(offsets)).slopes[:, :, slide]  # (3, m)
    for ends in equations.chains:
        rows = [term.row for term in equations.terms if term.ends == ends and term.kind == "point"]
        squared_speed = (slopes[:, rows] ** 2).sum(axis=1)  # (3,) of the end, for a unit rate of the slide
        if np.all(squared_speed > 1 - RANK_ROUNDING):
            return True
    return False
