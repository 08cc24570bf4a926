"""Where on the path condition (8) is to hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from framework.crossing.condition import (
    NO_HOLD,
    Condition8,
    CrossingPoint,
    coefficients_at,
    crossing_point,
    imposed_point,
)
from framework.crossing.refusal_proofs import UnmetCondition
from framework.crossing.request import Request
from framework.dynamics.crossings import check_kind
from framework.errors import InvalidInput, NoLaw
from framework.kinematics.tracking import Branch
from framework.singularity.points_on_path import SearchedPath, SingularPoint

END = 1e-9  # of the path: a singular point this near to an end is at it


@dataclass(frozen=True, eq=False)
class TargetedPath:
    """The path followed, its singular points, and where on it condition (8) is to hold."""

    searched: SearchedPath
    targets: Sequence[SingularPoint | CrossingPoint]

    @property
    def branch(self) -> Branch:
        """The path as it was followed."""
        return self.searched.branch

    @property
    def points(self) -> tuple[SingularPoint, ...]:
        """The singular points of the undeformed robot on it."""
        return self.searched.points

    @cached_property
    def at_rest(self) -> list[tuple[CrossingPoint, tuple[Condition8, float]]]:
        """For every target the point of the undeformed robot, and what `coefficients_at` says of it."""
        places = [
            crossing_point(self.branch, target, None, target.s)
            if isinstance(target, SingularPoint)
            else target
            for target in self.targets
        ]
        return [(place, coefficients_at(self.branch, place, None)) for place in places]


def targeted_path(searched: SearchedPath, request: Request) -> TargetedPath:
    """A path that has been searched, with the places that a request is about.

    Raises:
        InvalidInput: times or speeds are not as many as these places.
        NoLaw, UncontrolledMotions: no law can cross at one of them.
    """
    return TargetedPath(searched, _targets(searched.branch, searched.points, request))


def _targets(
    branch: Branch, points: tuple[SingularPoint, ...], request: Request
) -> list[SingularPoint | CrossingPoint]:
    """Where condition (8) is to hold; refuses what no law can cross."""
    times, speeds, at = request.times, request.speeds, request.at
    if at is not None:
        targets: list[SingularPoint | CrossingPoint] = [imposed_point(branch, s) for s in at]
        what = f"{len(at)} imposed by `at`"
    else:
        targets = [*points]
        what = f"{len(points)} singular point{'s' * (len(points) != 1)} on the path"
        if points:
            what += " at s = " + ", ".join(f"{found.s:.6g}" for found in points)
    if times is not None and len(times) == 0 and at is None:
        if speeds:
            raise InvalidInput(f"speeds: got {len(speeds)}, but times is empty: no crossing is asked for")
        return []
    for name, given in (("times", times), ("speeds", speeds)):
        if given is not None and len(given) != len(targets):
            raise InvalidInput(
                f"{name}: got {len(given)} ({', '.join(f'{value:g}' for value in given)}), but there "
                f"{'is' if len(targets) == 1 else 'are'} {what}"
            )
    for target in points if at is None else ():
        _check_crossable(branch, target)
    return targets


def _check_crossable(branch: Branch, at: SingularPoint) -> None:
    check_kind(branch.robot, at)
    if not END < at.s < 1 - END:
        end = "starts" if at.s < 0.5 else "ends"
        condition, _ = coefficients_at(branch, crossing_point(branch, at, None, at.s), None)
        asks = abs(condition.gamma) > NO_HOLD * condition.scale
        raise NoLaw(
            f"{branch.robot.name}: at s = {at.s:.6g} the path {end} on a Type 2 singularity; a stop on the "
            f"locus can never be crossed: move the path's end",
            proof=UnmetCondition(at.s, *condition[:3], stop=True) if asks else None,
        )
