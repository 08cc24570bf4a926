"""The singular points of a path and their kinds; a path through a Type 1 singularity is refused."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from framework.errors import InvalidInput, Type1Singularity
from framework.kinematics.assembly import MAX_ITERATIONS
from framework.kinematics.continuation.branch import Branch, with_continuation
from framework.kinematics.continuation.tracking import track_path, uncontrolled_error, weakest_leg
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.linearised_loops import LinearisedLoops, type1_matrix, type2_matrix
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array, ReadOnlyArrays, freeze
from framework.numerics.ordered_sums import least_singular_values, singular_values
from framework.singularity.bordered_system import differentiate_g, stencil
from framework.singularity.piecewise_measure import (
    VANISHING_TOGETHER,
    MeasuredMatrix,
    Panel,
    Unresolved,
    find_candidates,
    resolve_panels,
)
from framework.singularity.rank_deficiency import (
    Contact,
    NearMiss,
    block_slopes,
    find_contacts,
    find_near_misses,
)
from framework.singularity.type2 import Uncontrolled, measure_gradient, sign_along, uncontrolled_motion
from framework.tolerances import MIN_PANEL_WIDTH, RANK_LOST, SAME_PLACE

Speed = TypeVar("Speed", float, Array)


class Condition8(NamedTuple):
    """Coefficients of condition (8), t_s . W_p = alpha s" + beta s'^2 + delta s' + gamma = 0.

    `planning.condition` derives and computes them. The unit is N, or N m where t_s is a pure turn. A
    coefficient of the size of rounding is set to zero.
    """

    alpha: float
    beta: float
    gamma: float
    delta: float

    @property
    def holds_anyway(self) -> bool:
        """Whether t_s . W_p vanishes for all s' and s", as on a straight path orthogonal to t_s."""
        return not any(self)

    def acceleration(self, speed: Speed) -> Speed:
        """Return the s" [1/s^2] that meets the condition at speeds s' [1/s]; 0 if any s" does.

        alpha must not be zero, unless all coefficients are; `require_effect` ensures it.
        """
        if self.holds_anyway:
            return 0.0 * speed
        return -(self.beta * speed**2 + self.delta * speed + self.gamma) / self.alpha


@dataclass(frozen=True, eq=False)
class SingularPoint(ReadOnlyArrays):
    """A point of the path at which the motors do not hold the robot, springs at rest or deflected.

    Two singular points closer together than `resolution`, in s, cannot be told from a tangential point.
    `resolution` is None for transversal points, and where it was not measured. At a point that the user
    imposes (contact "imposed") the pose need not be singular; its motion opens the loops least.
    `condition` is (8) at the point, where a plan asks for it.
    """

    s: float
    kind: str  # type_2, leg_passive, constraint or closure, see `uncontrolled_motion`
    contact: str  # of the path with the locus: transversal, tangential or imposed
    corank: int  # number of motions that are uncontrolled at once
    twist: Array  # (n,) t_s of unit size (see `twist_norm`), pointing along the path; zeros if not type_2
    platform: Array  # (n,) coordinates x
    slope: float  # dg/ds; of corank > 1 the least slope of the singular values, without sign
    motion: Array  # (nv,) joint rates of the twist
    pose: LinearisedLoops = field(repr=False)  # the closed loops, T = 1
    resolution: float | None = None
    condition: Condition8 | None = None

    @staticmethod
    def of(
        branch: Branch,
        s: float,
        pose: LinearisedLoops,
        uncontrolled: Uncontrolled,
        *,
        contact: str,
        slope: float,
        resolution: float | None = None,
    ) -> SingularPoint:
        """Return the point at s, its twist turned along the path."""
        sign = sign_along(uncontrolled.twist, branch.robot.platform.path_twist(branch.path, s))
        return SingularPoint(
            s=s,
            kind=uncontrolled.kind,
            contact=contact,
            corank=uncontrolled.corank,
            twist=sign * uncontrolled.twist,
            platform=branch.path(s),
            slope=slope,
            motion=sign * uncontrolled.motion,
            pose=pose,
            resolution=resolution,
        )

    @property
    def q(self) -> Array:
        """Configuration (nq,)."""
        return self.pose.frames.q[0]

    def acceleration_at(self, speed: Speed) -> Speed:
        """Compute the s" [1/s^2] that meets condition (8) at speeds s' [1/s]."""
        assert self.condition is not None  # the point is one to cross
        return self.condition.acceleration(speed)

    @property
    def is_imposed(self) -> bool:
        """Whether the user imposes the point."""
        return self.contact == "imposed"

    @property
    def is_at_path_end(self) -> bool:
        """Whether the path starts or ends at the point."""
        return not SAME_PLACE < self.s < 1.0 - SAME_PLACE


class SearchedPath(NamedTuple):
    """A followed path with its singular points and near misses."""

    branch: Branch
    points: tuple[SingularPoint, ...]
    near_misses: tuple[NearMiss, ...] = ()  # minima of |g|, path ends included, below 1 % of the largest |g|

    def under(self, wrenches: ExternalWrenches) -> SearchedPath:
        """Return the same path under external wrenches, on which singular points do not depend.

        Raises:
            InvalidInput: the robot has no such frame.
        """
        return self._replace(branch=self.branch.with_wrenches(wrenches))


def search_path(robot: ParallelRobot, path: Path, *, branch: Branch | None = None) -> SearchedPath:
    """Follow the path; find its singular points to rounding, and its near misses.

    A path through a Type 1 singularity is refused first. Then the points are located where the passive
    columns P lose rank.

    Args:
        branch: the path as followed by `track_path`, if known.

    Raises:
        InvalidInput: `branch` belongs to another path or robot.
        OutOfReach, Type1Singularity, SingularPath, UncontrolledMotions, NotConverged: see
            `locate_singularities`.
    """
    if branch is None:
        branch = track_path(robot, path)
    else:
        check_branch(robot, path, branch)
    type1 = _measure_type_1(branch)
    if not robot.n_p:  # every joint has a motor: no motion is uncontrolled
        return SearchedPath(branch, ())

    # the Type 2 matrix on the same branch: P, or with redundant motors P'P, whose singular values are squares
    is_square = len(robot.loops.names) == robot.n_p
    type2 = replace(type1, matrix=partial(type2_matrix, robot), power=1 if is_square else 2)
    try:
        resolved = resolve_panels(type2)
        contacts = find_contacts(type2, resolved)
        misses = find_near_misses(type2, resolved, contacts)
    except Unresolved as unresolved:
        raise _unresolved_error(type2, unresolved) from None
    points = tuple(_singular_point(type2, contact) for contact in contacts)
    return SearchedPath(branch, points, tuple(misses))


def check_branch(robot: ParallelRobot, path: Path, branch: Branch) -> None:
    """Raise InvalidInput unless the branch belongs to this path and this robot."""
    if branch.robot is not robot or (branch.path is not path and branch.path != path):
        raise InvalidInput(
            f"branch, searched: of {branch.robot!r} along {branch.path!r}, not of {robot!r} along {path!r}"
        )


def locate_singularities(
    robot: ParallelRobot, path: Path, *, branch: Branch | None = None
) -> tuple[SingularPoint, ...]:
    """Find all singular points on the path to rounding, ascending in s.

    Args:
        branch: the path as followed by `track_path`, if known.

    Raises:
        OutOfReach, Type1Singularity: the path cannot be followed, or meets a stretched or folded leg.
        SingularPath: the path runs along the singular locus.
        UncontrolledMotions: several motions are uncontrolled too close to one another to be told apart, or at
            an end of the path.
        NotConverged: g cannot be resolved, or dropped loop equations are needed; the message says where.
    """
    return search_path(robot, path, branch=branch).points


def _measure_type_1(branch: Branch) -> MeasuredMatrix:
    """Continue the branch where its Type 1 matrix is singular; refuse Type 1 singularities.

    At a suspect, a candidate for a singular point or an s near which g is not resolved, the branch may still
    be smooth. Continuations then replace the inverse kinematics. Each round adds one, until no suspect allows
    another.

    Returns:
        The Type 1 matrix along the continued branch.

    Raises:
        Type1Singularity: the branch is not smooth, because a leg is stretched or folded.
    """
    for _ in range(MAX_ITERATIONS):
        # the branch's panels are closed already; a continuation replaces their poses
        closed = () if branch.continuations else branch.panels
        loops = {(float(panel.s[0]), float(panel.s[-1])): panel.linearised for panel in closed}
        type1 = MeasuredMatrix(branch, partial(type1_matrix, branch.robot), panel_loops=loops)
        panels: list[Panel] | Unresolved  # the panels of g, or why there are none
        try:
            panels = resolve_panels(type1)
            suspects = [candidate.s for candidate in find_candidates(panels)]
        except Unresolved as unresolved:
            panels = unresolved
            suspects = [unresolved.s]
        # where the branch has a continuation already, no other is tried
        fresh = [s for s in suspects if not branch.is_continued(np.array([s]))[0]]
        attempts = (with_continuation(branch, s) for s in fresh)
        continued = next((attempt for attempt in attempts if attempt is not None), None)
        if continued is None:
            break
        branch = continued
    if suspects:
        _refuse_type_1(type1, panels)
    return type1


def _refuse_type_1(type1: MeasuredMatrix, panels: list[Panel] | Unresolved) -> None:
    """Raise Type1Singularity for the first s at which a leg is stretched or folded.

    `panels` are those of the g of the Type 1 matrix, or why there are none.
    """
    if isinstance(panels, Unresolved):  # the branch has a kink, or meets another branch
        # The s of the least singular value among knots of the branch and s rounded to three digits, as
        # singular points are often at an s of few digits. A knot on the singularity itself may be on another
        # branch: then the guesses are wrong between its neighbours, and the singularity lies between these.
        knots = type1.branch.s
        k = np.searchsorted(knots, panels.s)
        close_knots = knots[np.abs(knots - panels.s) < 10 * MIN_PANEL_WIDTH]
        neighbours = knots[max(k - 1, 0) : k + 1]
        candidates = np.concatenate([close_knots, neighbours, [round(panels.s, 3)]])
        matrices = type1.matrix(type1.linearise_guesses(candidates))  # also where the loops do not close
        least_values = least_singular_values(matrices)
        singular = [float(candidates[np.argmin(least_values)])]
    else:
        contacts = [contact.s for contact in find_contacts(type1, panels)]
        singular = [s for s in contacts if _is_type_1(type1, s)]
    if not singular:
        return
    s = singular[0]
    branch = type1.branch
    robot = branch.robot
    x = branch.path(s)
    joint = weakest_leg(robot, type1.linearise_guesses(np.array([s])))
    raise Type1Singularity(
        f"the path meets a Type 1 singularity at s = {s:.6g}, {robot.place(x)}: the leg of "
        f"{joint} is stretched or folded there",
        name=robot.name,
        s=s,
        platform=x,
        joint=joint,
    )


def _unresolved_error(passive: MeasuredMatrix, unresolved: Unresolved) -> Exception:
    """Return the error for a measure that is not resolved at some s.

    Each singular value of the passive matrix that vanishes at s belongs to one uncontrolled motion. If two or
    more vanish, the error names their number. Otherwise the error is `unresolved` itself.
    """
    branch = passive.branch
    s = unresolved.s
    loops = passive.linearise_guesses(np.array([s]))  # the loops need not close at s
    values = singular_values(passive.matrix(loops)[0])
    # with power 2 the matrix is P'P, whose singular values are squares
    count = int(np.sum(values < VANISHING_TOGETHER**passive.power))
    if count < 2:
        return unresolved
    reason = "the path passes a singularity, or so near to one that it cannot be told from it"
    return uncontrolled_error(branch.robot, s, branch.path(s), count, reason)


def _is_type_1(type1: MeasuredMatrix, s: float) -> bool:
    """Return whether motor joints can move while the platform rests, at s where `type1` is singular.

    The Type 1 matrix is also singular where only passive joints can move while the platform rests. Such a
    pose is not of Type 1; the Type 2 matrix loses rank there, too.
    """
    branch = type1.branch
    linearised = branch.close(s)
    type1_value = least_singular_values(type1.matrix(linearised)[0])
    type2_value = singular_values(type2_matrix(branch.robot, linearised)[0]).min(initial=np.inf)
    # Type 1 if only its own matrix is singular. s is exact only to rounding, so its least value is not zero
    # and serves as the measure of that rounding, with a margin of 1e2.
    if type2_value > max(RANK_LOST, 1e2 * type1_value):
        return True
    # both are singular: poses of all other kinds make both so, but Type 2 leaves the Type 1 matrix regular
    return uncontrolled_motion(branch.robot, linearised).kind == "type_2"


def _singular_point(passive: MeasuredMatrix, contact: Contact) -> SingularPoint:
    """Describe the singular point at a contact of the passive columns: its twist, dg/ds and pose.

    dg/ds is positive where g grows. If several motions are uncontrolled, it is the least slope of their
    singular values, without sign.
    """
    branch, s, slope = passive.branch, contact.s, contact.slope
    linearised = branch.close(s) if contact.pose is None else contact.pose
    uncontrolled = uncontrolled_motion(branch.robot, linearised)
    freeze(linearised)
    if slope is None and uncontrolled.corank > 1:
        _, slopes, _ = block_slopes(passive.evaluate, s, uncontrolled.corank)
        slope = float(least_singular_values(slopes))
    elif slope is None:
        points = stencil(s)
        P = passive.evaluate(points)  # (3, n_p, n_p)
        _, slope, g_above = differentiate_g(P, points)
        if points[-1] != s:  # not at the end of the path
            # The border of a singular matrix gives g an arbitrary sign. At the upper end of the stencil,
            # beyond the root, det P has a sign, and g must have the same.
            slope *= float(np.sign(g_above) * np.linalg.slogdet(P[-1]).sign)
    return SingularPoint.of(
        branch, s, linearised, uncontrolled, contact=contact.kind, slope=slope, resolution=contact.resolution
    )


def spring_shift(branch: Branch, point: SingularPoint) -> Array:
    """Compute the shift ds/dq_e (n_e,) [1/m, 1/rad] of a singular point by deflections q_e.

    From g(s, q_e) = 0 it is -(dg/dq_e) / (dg/ds), with the loops closed. The deflections of a moving robot
    depend on its motion, and at rest none exist near a Type 2 singularity. So without a motion only this
    derivative is known. It is NaN if several motions are uncontrolled at once, or if the path touches the
    locus without crossing it: small deflections split such a point or remove it.
    """
    robot = branch.robot
    n_e = robot.n_e
    if not n_e or point.corank > 1 or point.contact != "transversal":
        return np.full(n_e, np.nan)
    linearised = branch.close(np.array([point.s]))
    gradient = measure_gradient(robot, linearised).G_by_q[0, 0, 0]  # dg/dq (nv,)

    # slopes of g along the path, and along each deflection with the platform at rest
    twists, deflections = np.zeros((1 + n_e, 1, robot.n)), np.zeros((1 + n_e, 1, n_e))
    twists[0] = robot.platform.path_twist(branch.path, point.s)
    deflections[1:, 0] = np.eye(n_e)
    rates = joint_rates(robot, linearised, twists, deflections)[:, 0]  # dq/ds, then dq/dq_e (1 + n_e, nv)
    path_slope, *spring_slopes = rates @ gradient
    shift = -np.array(spring_slopes) / path_slope
    # shifts are compared with rounding for a deflection of one radian or robot length
    is_rounding = np.abs(shift * robot.column_scale[robot.elastic]) < SAME_PLACE
    return np.where(is_rounding, 0.0, shift)
