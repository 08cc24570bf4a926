"""What is asked of a plan, checked, and where on the path condition (8) is to hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.crossing.condition import CrossingPoint, imposed_point
from framework.dynamics.crossings import check_kind
from framework.errors import InvalidInput, NoLaw
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tracking import Branch
from framework.motion.law import check_duration, is_number
from framework.singularity.points_on_path import SingularPoint

LARGEST_SPEED = 1e6  # whole paths in the duration; what a law can keep is a few
SMOOTHNESS = {True: 4, False: 2}  # derivatives of s that vanish at both ends: elastic, rigid


@dataclass(frozen=True)
class Request:
    """What a law is to do, checked.

    duration: of the motion [s], None if it is to be found. times [s], speeds [1/s]: of the crossings, None
    if open. at: path coordinates to impose condition (8) at, instead of the singular points. smoothness:
    derivatives of s that vanish at both ends.

    Raises:
        InvalidInput: a number that cannot be right.
    """

    duration: float | None
    times: Sequence[float] | None
    speeds: Sequence[float] | None
    at: Sequence[float] | None
    smoothness: int

    def __post_init__(self) -> None:
        if self.duration is not None:
            check_duration(self.duration)
        _check_numbers(self.duration, self.times, self.speeds, self.at)


def targets_of(
    branch: Branch, points: tuple[SingularPoint, ...], request: Request
) -> list[SingularPoint | CrossingPoint]:
    """Where condition (8) is to hold; refuses what no law can cross."""
    robot = branch.robot
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
        _check_crossable(robot, target)
    return targets


def _check_crossable(robot: ParallelRobot, at: SingularPoint) -> None:
    check_kind(robot, at)
    if at.s < 1e-9 or at.s > 1 - 1e-9:
        end = "starts" if at.s < 0.5 else "ends"
        raise NoLaw(
            f"{robot.name}: at s = {at.s:.6g} the path {end} on a Type 2 singularity; a stop on the locus "
            f"can never be crossed: move the path's end"
        )


def checked_smoothness(robot: ParallelRobot, smoothness: int | None) -> int:
    """How many derivatives of s are to vanish at both ends: by default as many as the torque contains."""
    least = SMOOTHNESS[robot.n_e > 0]
    if smoothness is None:
        return least
    if isinstance(smoothness, bool) or not isinstance(smoothness, int | np.integer):
        raise InvalidInput(f"smoothness: needs a whole number, got {smoothness!r}")
    if not least <= smoothness <= 12:
        raise InvalidInput(
            f"smoothness: got {smoothness}, valid: {least} .. 12 (the torque of a {robot.flexibility} "
            f"robot contains derivatives of s up to order {least} at least; fewer zeros make it jump there)"
        )
    return int(smoothness)


def _check_numbers(
    duration: float | None,
    times: Sequence[float] | None,
    speeds: Sequence[float] | None,
    at: Sequence[float] | None,
) -> None:
    for name, values in (("times", times), ("speeds", speeds), ("at", at)):
        for value in values if values is not None else ():
            if not is_number(value):
                raise InvalidInput(f"{name}: must be finite numbers, got {value!r}")
    for speed in speeds if speeds is not None else ():
        if speed <= 0:
            raise InvalidInput(f"speeds: s' at a crossing must be greater than zero, got {speed:g}")
        if duration is not None and speed > LARGEST_SPEED / duration:
            raise InvalidInput(
                f"speeds: s' at a crossing must be at most {LARGEST_SPEED / duration:g} 1/s, a million paths "
                f"in the duration, got {speed:g}"
            )
    if times is not None and np.any(np.diff(times) <= 0):
        raise InvalidInput(f"times: must ascend, got {list(times)}")
    if at is not None and np.any(np.diff(at) <= 0):
        raise InvalidInput(f"at: must ascend, got {list(at)}")
    for s in at if at is not None else ():
        if not 0 < s < 1:
            raise InvalidInput(f"at: path coordinates must lie in (0, 1), got {s:g}")
