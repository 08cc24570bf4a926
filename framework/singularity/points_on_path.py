"""The singular points of a path and their kinds; paths through Type 1 are refused."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotConverged, Type1Singularity
from framework.kinematics.closures import loop_equations, scale_jacobian
from framework.kinematics.continuation.branch import Branch, with_continuation
from framework.kinematics.continuation.tracking import escape_error, track_path, weakest_leg
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.loop_matrices import scaled_loops, type1_matrix, type2_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values
from framework.singularity.bordered_system import differentiate_g, stencil
from framework.singularity.piecewise_measure import (
    Measured,
    Panel,
    Samples,
    Unresolved,
    find_candidates,
    resolve_panels,
)
from framework.singularity.rank_deficiency import (
    VANISHING_TOGETHER,
    Contact,
    NearMiss,
    block_slopes,
    find_contacts,
    find_near_misses,
)
from framework.singularity.type2 import sign_along, uncontrolled_motion
from framework.tolerances import MIN_PANEL_WIDTH, RANK_LOST

MAX_CONTINUATIONS = 16


@dataclass(frozen=True, eq=False)
class SingularPoint(ReadOnlyArrays):
    """A place on the path where the motors lose hold of the robot, springs at rest.

    `kind` is type_2, leg_passive, constraint or closure (see `uncontrolled_motion`); `contact` is
    transversal or tangential. `corank` motions escape at once; `slope` is dg/ds, and for several of
    them that of the one which is let go most slowly, without sign. `motion` are the joint rates of the twist.
    Two singular points nearer together than `resolution`, in s, would look like this tangential one; None
    where that was not measured, and for transversal ones.
    """

    s: float
    kind: str
    contact: str
    corank: int
    twist: Array  # (n,) t_s of unit speed (see `twist_norm`), pointing along the path; zeros if not type_2
    platform: Array  # (n,)
    slope: float
    q: Array  # (nq,)
    motion: Array  # (nv,)
    resolution: float | None = None


class SearchedPath(NamedTuple):
    """A followed path with its singular points and near misses."""

    branch: Branch
    points: tuple[SingularPoint, ...]
    near_misses: tuple[NearMiss, ...] = ()  # minima of |g|, at ends too, below a hundredth of its largest

    def under(self, wrenches: ExternalWrenches) -> SearchedPath:
        """Return the same path under wrenches of the world.

        Singular points do not depend on them.

        Raises:
            InvalidInput: the robot has no such frame.
        """
        return self._replace(branch=self.branch.with_wrenches(wrenches))


def search_path(robot: ParallelRobot, path: Path, *, branch: Branch | None = None) -> SearchedPath:
    """Follow the path; find its singular points, each to rounding, and its near misses.

    Args:
        branch: the path as followed by `track_path`, if at hand.

    Raises:
        As `locate_singularities`.
    """
    branch = track_path(robot, path) if branch is None else branch
    check_branch(robot, path, branch)
    samples, type1, type1_panels = _continue_branch(branch)
    _refuse_type_1(type1, type1_panels)
    if not len(robot.following):  # every joint has a motor: locked, nothing moves
        return SearchedPath(branch, ())
    power = 1 if len(robot.loops.names) == len(robot.following) else 2
    passive = Measured(samples.branch, partial(type2_matrix, robot), power)
    try:
        resolved = resolve_panels(samples, passive)
        if samples.branch is branch:  # without continuations: better guesses through the panels' nodes
            edges = np.array([resolved[0].start, *(panel.end for panel in resolved)])
            q = np.concatenate([samples.loops(panel.start, panel.end).frames.q for panel in resolved])
            branch = branch.through(edges, q)
            passive = passive._replace(branch=branch)
        ranks_lost = find_contacts(passive, resolved)
        misses = find_near_misses(passive, resolved, ranks_lost)
    except Unresolved as unresolved:
        raise _unresolved_error(passive, unresolved) from None
    points = tuple(_singular_point(passive, contact) for contact in ranks_lost)
    return SearchedPath(branch, points, tuple(misses))


def check_branch(robot: ParallelRobot, path: Path, branch: Branch) -> None:
    """Raise InvalidInput unless the branch belongs to this path and this robot."""
    if branch.robot is not robot or branch.path != path:
        raise InvalidInput(
            f"branch, searched: of {branch.robot!r} along {branch.path!r}, not of {robot!r} along {path!r}"
        )


def locate_singularities(
    robot: ParallelRobot, path: Path, *, branch: Branch | None = None
) -> tuple[SingularPoint, ...]:
    """Find all singular points on the path, ascending in s, each to rounding.

    Args:
        branch: the path as followed by `track_path`, if at hand.

    Raises:
        OutOfReach, Type1Singularity: the path cannot be followed, or meets a stretched or folded leg.
        SingularPath: the path runs along the singular locus.
        UncontrolledMotions: several motions escape so near one another that they cannot be told apart, or
            where the path starts or ends.
        NotConverged: g cannot be resolved, or needs loop equations that were dropped; says where.
    """
    return search_path(robot, path, branch=branch).points


class _ContinuedBranch(NamedTuple):
    """A branch continued where the inverse kinematics is singular and the branch yet smooth."""

    samples: Samples  # the branch closed on panels
    type1: Measured  # the matrix of the inverse kinematics along the branch
    panels: list[Panel] | Unresolved  # its measure on panels; or the error where one is not resolved


def _continue_branch(branch: Branch) -> _ContinuedBranch:
    """Continue the branch wherever the inverse kinematics is singular and the branch yet smooth."""
    for _ in range(MAX_CONTINUATIONS):
        samples = Samples(branch, {})
        type1 = Measured(branch, partial(type1_matrix, branch.robot))
        resolved: list[Panel] | Unresolved
        try:
            resolved = resolve_panels(samples, type1)
            suspects = [candidate.s for candidate in find_candidates(resolved)]
        except Unresolved as unresolved:
            resolved, suspects = unresolved, [unresolved.s]
        continued = _continue_at_first(branch, suspects)
        if continued is None:
            break
        branch = continued
    return _ContinuedBranch(samples, type1, resolved)


def _continue_at_first(branch: Branch, parameters: list[float]) -> Branch | None:
    """Continue the branch at the first path coordinate at which that succeeds.

    None if it succeeds at none.
    """
    for s in parameters:
        if not branch.is_continued(np.array([s]))[0]:
            continued = with_continuation(branch, s)
            if continued is not None:
                return continued
    return None


def _refuse_type_1(type1: Measured, resolved: list[Panel] | Unresolved) -> None:
    """Raise Type1Singularity for the first s at which a leg is stretched or folded."""
    if isinstance(resolved, Unresolved):  # the branch has a kink, or another one meets it
        singular = [_most_singular_s(type1, resolved.s)]
    else:
        singular = [contact.s for contact in find_contacts(type1, resolved) if _is_type_1(type1, contact.s)]
    if not singular:
        return
    s, branch, robot = singular[0], type1.branch, type1.branch.robot
    x = branch.path(s)
    joint = weakest_leg(robot, type1.guess(np.array([s])))
    raise Type1Singularity(
        f"{robot.name}: the path meets a Type 1 singularity at s = {s:.6g}, {robot.place(x)}: the leg of "
        f"{joint} is stretched or folded there",
        s=s,
        platform=x,
        joint=joint,
    )


def _most_singular_s(type1: Measured, s: float) -> float:
    """Find the s at which the least singular value is smallest.

    Candidates are the knots of the branch about s, and s to three digits. A knot on the singularity itself
    may be on another branch; then guesses are wrong up to the next knots, between which the singularity lies.
    """
    knots = type1.branch.s
    k = int(np.searchsorted(knots, s))
    close_knots = knots[np.abs(knots - s) < 10 * MIN_PANEL_WIDTH]
    neighbours = knots[max(k - 1, 0) : k + 1]
    candidates = np.concatenate([close_knots, neighbours, [round(s, 3)]])
    least_values = singular_values(type1.matrix(type1.guess(candidates)))[:, -1]
    return float(candidates[np.argmin(least_values)])


def _unresolved_error(passive: Measured, unresolved: Unresolved) -> Exception:
    """Return the error for a measure that is not resolved at s.

    If several singular values of its matrix vanish there, as many motions escape together; else it is
    `unresolved` itself.
    """
    branch, s = passive.branch, unresolved.s
    values = singular_values(passive.matrix(passive.guess(np.array([s])))[0])
    count = int(np.sum(values < VANISHING_TOGETHER**passive.power))
    if count < 2:
        return unresolved
    reason = "the path passes a singularity, or so near to one that it cannot be told from it"
    return escape_error(branch.robot, s, branch.path(s), count, reason)


def _check_dropped_rows(branch: Branch, s: float, linearised: LinearisedLoops) -> None:
    """Raise NotConverged if dropped loop equations are needed at s.

    The independent ones then have a lower rank than all rows. An overconstrained robot repeats its loop
    equations in proportions that change as it moves; the rows that say it all at the reference need not do so
    everywhere.
    """
    robot = branch.robot
    if not len(robot.structure.dropped):
        return
    all_rows = loop_equations(robot.rows, linearised.frames).jacobian
    all_scaled = scale_jacobian(robot, all_rows, robot.rows.rotation)[0][:, robot.moving]
    all_values = singular_values(all_scaled)
    values = singular_values(scaled_loops(robot, linearised)[0][:, robot.moving])
    if np.sum(values > RANK_LOST) < np.sum(all_values > RANK_LOST):
        dropped = [robot.rows.names[k] for k in robot.structure.dropped]
        raise NotConverged(
            f"{robot.name}: the loops are sound at s = {s:.6g}, but the loop equations that were dropped as "
            f"redundant at the reference ({', '.join(dropped)}) are needed there; give a reference nearer to "
            f"this place",
            residual=float(values[-1]),
        )


def _is_type_1(type1: Measured, s: float) -> bool:
    """Whether motors' joints can move at s, where the matrix is singular, while the platform rests.

    The matrix is singular too where passive joints alone move without the platform; that is not Type 1. The
    matrix of Type 2 then loses rank together with it.
    """
    robot, branch = type1.branch.robot, type1.branch
    linearised = branch.close(s).linearised
    _check_dropped_rows(branch, s, linearised)
    type1_value = float(singular_values(type1.matrix(linearised)[0])[-1])
    type2_value = singular_values(type2_matrix(robot, linearised)[0]).min(initial=np.inf)
    if type2_value > max(RANK_LOST, 1e2 * type1_value):  # only the first matrix is singular
        return True
    return uncontrolled_motion(robot, linearised).kind == "type_2"


def _singular_point(passive: Measured, contact: Contact) -> SingularPoint:
    """Describe the singular point at a contact: its twist, dg/ds and pose."""
    branch, s = passive.branch, contact.s
    robot, points = branch.robot, stencil(s)
    closed = branch.close(points)
    linearised = closed.linearised.select(1)  # at s
    _check_dropped_rows(branch, s, linearised)
    uncontrolled = uncontrolled_motion(robot, linearised)
    along = sign_along(uncontrolled.twist, robot.platform.path_twist(branch.path, s))
    P = passive.matrix(closed.linearised)
    if uncontrolled.corank > 1:
        slopes = block_slopes(passive.evaluate, s, uncontrolled.corank).slope
        slope = singular_values(slopes)[-1]
    else:
        _, slope, upper, _ = differentiate_g(P, points)
        # a border at the root leaves the sign of g open: that of det P above the root decides
        slope *= np.sign(upper) * np.linalg.slogdet(P[2])[0] if points[2] > s else 1.0
    return SingularPoint(
        s=s,
        kind=uncontrolled.kind,
        contact=contact.kind,
        corank=uncontrolled.corank,
        twist=along * uncontrolled.twist,
        platform=branch.path(s),
        slope=float(slope),
        q=closed.q[1],
        motion=along * uncontrolled.motion,
        resolution=contact.resolution,
    )
