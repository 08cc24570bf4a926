"""The points of a path where condition (8) is to hold, and the refusal of points that no law can cross.

Condition (8) keeps the motors' torques finite at a Type 2 singularity (`planning.condition`). The poses with
such a singularity form the locus.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from framework.dynamics.singularity_crossings import check_kind
from framework.errors import InvalidInput, NoLaw
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.parallel_robot import ParallelRobot
from framework.planning.condition import coefficients_at, imposed_point
from framework.planning.refusals import UnmetCondition
from framework.planning.request import Request
from framework.singularity.points_on_path import SearchedPath, SingularPoint
from framework.tolerances import SAME_PLACE


class CrossingTime(NamedTuple):
    """The time [s] and speed s' [1/s] of a crossing."""

    time: float
    speed: float


@dataclass(frozen=True, eq=False)
class PathToCross:
    """A path, its singular points, and the points where condition (8), t_s . W_p = 0, is to hold.

    searched: the path with its singular points, under the wrenches of the request.
    crossing_points: the points where condition (8) is to hold, singular ones or imposed by the user. They
        have the condition of the undeformed robot, and so have singular points of `searched` at these s.
    explained: whether a refusal also searches for limits and a duration within which a law exists.
    """

    searched: SearchedPath
    crossing_points: Sequence[SingularPoint]
    explained: bool = True

    @property
    def branch(self) -> Branch:
        """The poses along the path."""
        return self.searched.branch

    @property
    def points(self) -> tuple[SingularPoint, ...]:
        """The singular points of the undeformed robot on the path."""
        return self.searched.points


def path_to_cross(searched: SearchedPath, request: Request, *, explained: bool = True) -> PathToCross:
    """Choose the points at which a request asks for condition (8), t_s . W_p = 0.

    They are the imposed points, if any, else the singular ones. An empty list of times asks for a law without
    crossing conditions, and so for no points. Singular points that no law can cross are refused; imposed
    points are not checked. The result contains the external wrenches of the request.

    Args:
        searched: the path with its singular points, without wrenches.

    Raises:
        InvalidInput: the number of times or speeds is not that of the points.
        NoLaw, UncontrolledMotions: no law can cross one of the singular points.
    """
    searched = searched.under(request.external_wrenches)
    branch = searched.branch
    if request.at is None and request.times == ():
        if request.speeds:
            raise InvalidInput(
                f"speeds: got {len(request.speeds)}, but times is empty: no crossing is asked for"
            )
        return PathToCross(searched, (), explained)
    _check_counts(request, searched.points)
    if request.at is None:
        for singular in searched.points:
            check_crossable(branch, singular)
    to_cross = searched.points if request.at is None else [imposed_point(branch, s) for s in request.at]
    # with their conditions, springs at rest
    crossed = tuple(replace(point, condition=coefficients_at(branch, point, None)) for point in to_cross)
    points = crossed
    if request.at is not None:  # the singular points have the conditions that are imposed there
        points = searched.points
        for imposed in crossed:
            points = tuple(
                replace(point, condition=imposed.condition)
                if abs(point.s - imposed.s) < SAME_PLACE
                else point
                for point in points
            )
    return PathToCross(searched._replace(points=points), crossed, explained)


def _check_counts(request: Request, points: Sequence[SingularPoint]) -> None:
    """Refuse another number of times or speeds than of points to cross, by default the singular `points`."""
    count = len(points if request.at is None else request.at)
    for name, values in (("times", request.times), ("speeds", request.speeds)):
        if values is None or len(values) == count:
            continue
        there = f"{'is' if count == 1 else 'are'} {count}"
        if request.at is None:
            places = f" at s = {', '.join(f'{point.s:.6g}' for point in points)}" if points else ""
            there += f" singular point{'s' * (count != 1)} on the path{places}"
        else:
            there += " imposed by `at`"
        listed = ", ".join(f"{value:g}" for value in values)
        raise InvalidInput(f"{name}: got {len(values)} ({listed}), but there {there}")


def check_crossable(branch: Branch, singular: SingularPoint) -> None:
    """Refuse a singular point that no law can cross.

    Raises:
        UncontrolledMotions: locked motors leave a motion free that condition (8) does not describe.
        NoLaw: the singularity is not of Type 2, to which condition (8) applies, or the path starts or ends
            there.
    """
    check_kind(branch.robot, singular)
    if not singular.is_at_path_end:
        return
    end = "starts" if singular.s < 0.5 else "ends"
    alpha, beta, gamma, _delta = coefficients_at(branch, singular, deflection=None)
    unmet = UnmetCondition(singular.s, alpha, beta, gamma, stop=True)
    raise NoLaw(
        f"at s = {singular.s:.6g} the path {end} on a Type 2 singularity",
        clauses=("no law can rest on the locus: move the path's end",),
        name=branch.robot.name,
        # at rest condition (8) is gamma = 0; if it is met by chance, the refusal has no proof
        proof=unmet if gamma else None,
    )


def check_one_condition_each(robot: ParallelRobot, points: Sequence[SingularPoint]) -> None:
    """Refuse points at which the polynomial law would have several conditions to meet.

    Where the path touches the locus, finite torques need condition (8), t_s . W_p = 0, and its time
    derivative. A point where several motions t_s are uncontrolled at once needs one condition for each.
    """
    for singular in points:
        if singular.is_imposed:
            continue
        where = f"at s = {singular.s:.6g}"
        if singular.corank > 1:
            raise NoLaw(
                f"{where} {singular.corank} motions are uncontrolled at once, each with a condition (8) of "
                f"its own, and the polynomial meets one, the optimal law each",
                name=robot.name,
            )
        if singular.contact == "tangential":
            raise NoLaw(
                f"{where} the path touches the locus without crossing it",
                name=robot.name,
                clauses=(
                    "finite torques ask for condition (8) and its time derivative at once, and the "
                    "polynomial meets the first, the optimal law both",
                    "or move the path off the locus or across it",
                ),
            )
