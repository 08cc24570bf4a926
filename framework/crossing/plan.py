"""Plan a crossing: locate the singular points, meet condition (8) in each, prove the torques finite."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from framework.crossing.condition import (
    Condition8,
    CrossingPoint,
    Deflection,
    condition_at,
    crossing_point,
    imposed_point,
)
from framework.crossing.result import Crossing, CrossingPlan
from framework.crossing.timing import CrossingTime, check_advance, choose_timing
from framework.dynamics.crossings import check_kind, rigid_crossings
from framework.dynamics.inverse_dynamics import TOLERANCE, checked_geometry, resolve
from framework.dynamics.result import InverseDynamics, SingularityCrossing
from framework.errors import InvalidInput, NoLaw
from framework.kinematics.tracking import Branch
from framework.model import ParallelRobot
from framework.motion.chebyshev import TimeFunction
from framework.motion.law import Condition, Law, MotionLaw, check_duration, is_number
from framework.motion.path import Path
from framework.singularity.points_on_path import SearchedPath, SingularPoint, search_path

LARGEST_SPEED = 1e6  # whole paths in the duration; what a law can keep is a few
SMOOTHNESS = {True: 4, False: 2}  # derivatives of s that vanish at both ends: elastic, rigid


def plan_crossing(
    robot: ParallelRobot,
    path: Path,
    *,
    duration: float,
    times: Sequence[float] | None = None,
    speeds: Sequence[float] | None = None,
    at: Sequence[float] | None = None,
    geometry: str | None = None,
    smoothness: int | None = None,
    tolerance: float = TOLERANCE,
    searched: SearchedPath | None = None,
) -> CrossingPlan:
    """A rest-to-rest law along the path that crosses its singular points with finite torques.

    Args:
        duration: of the motion [s].
        times: instants of the crossings [s], ascending, one for each singular point; chosen when
            None. An empty list asks for a law without crossing conditions.
        speeds: s' at the crossings [1/s]; chosen when None.
        at: path coordinates to impose condition (8) at, instead of the located singular points.
        geometry: "rigid" takes forces on the undeformed robot (the paper's small displacements);
            "deformed", the default for elastic robots, on the deformed one, whose singular points
            are elsewhere.
        smoothness: derivatives of s that vanish at both ends; 2 for rigid, 4 for elastic robots.
        tolerance: tail of the torques that counts as resolved.
        searched: what `search_path` found on this path, if at hand.

    Raises:
        InvalidInput: an argument that cannot be right; says what is valid.
        NoLaw: no law can cross (a stop on the locus, a tangential touch, a path orthogonal to t_s,
            a singularity that is not of Type 2), or none that always advances was found.
        UncontrolledMotions: two motions or more are uncontrolled at once.
        UnboundedTorque: the law meets a singularity without condition (8); no torque is returned.
        NotConverged, OutOfReach, Type1Singularity, SingularPath: see `inverse_dynamics`.

    Source: Briot and Arakelian 2010, condition (8) and Eqs. (19)-(31).
    """
    started = time.perf_counter()
    geometry = checked_geometry(robot, geometry)
    task = _task(robot, path, duration, times, speeds, at, smoothness, searched)
    branch, points, targets, choice = task.branch, task.points, task.targets, task.crossing_times
    smoothness = task.smoothness

    def crossings(
        deflections: TimeFunction | None, before: MotionLaw | None
    ) -> list[tuple[CrossingPoint, Condition8]]:
        found = []
        for target, crossing_time in zip(targets, choice, strict=True):
            here = _deflection(deflections, crossing_time.time) if geometry == "deformed" else None
            if isinstance(target, SingularPoint):
                near = target.s if before is None else float(before(crossing_time.time))
                place = crossing_point(branch, target, here, near)
            else:
                place = target
            found.append((place, condition_at(branch, place, here)))
        return found

    def choose_law(deflections: TimeFunction | None, before: MotionLaw | None) -> Law:
        law = _law(crossings(deflections, before), choice, duration, smoothness)
        if before is None:
            check_advance(law, [point.s for point in points], robot.name)
        return law

    dynamics = resolve(branch, points, choose_law, geometry=geometry, tolerance=tolerance)
    law = dynamics.law
    assert isinstance(law, Law)
    certificate = replace(dynamics.certificate, monotone=law.advance(smoothness) > 0)
    check_advance(law, [found.s for found in dynamics.crossings], robot.name)
    met = {
        crossing_time: condition
        for (_, condition), crossing_time in zip(crossings(dynamics.deflections, law), choice, strict=True)
    }
    reported = tuple(_crossing(found, law, met, duration) for found in dynamics.crossings)
    return CrossingPlan(robot, path, law, reported, dynamics, certificate, time.perf_counter() - started)


def reported_crossings(dynamics: InverseDynamics, law: Law) -> tuple[Crossing, ...]:
    """What a finished motion does at its singular instants, whoever chose its law."""
    return tuple(_crossing(found, law, {}, law.duration) for found in dynamics.crossings)


def _crossing(
    at: SingularityCrossing, law: Law, met: dict[CrossingTime, Condition8], duration: float
) -> Crossing:
    """What the finished motion does at a singular instant; `met` holds the conditions imposed, by timing."""
    near = [timing for timing in met if abs(timing.time - at.time) < 1e-9 * duration]
    found = CrossingTime(at.time, float(law(at.time, 1)))
    time, speed = near[0] if near else found
    return Crossing(
        s=at.s,
        time=time,
        speed=speed,
        acceleration=met[near[0]].acceleration(speed) if near else float(law(time, 2)),
        kind=at.kind,
        twist=at.twist,
        platform=at.platform,
        residual=at.residual,
        condition=met[near[0]] if near else None,
    )


def uncertified_law(
    robot: ParallelRobot,
    path: Path,
    *,
    duration: float,
    times: Sequence[float] | None = None,
    speeds: Sequence[float] | None = None,
    at: Sequence[float] | None = None,
    smoothness: int | None = None,
    searched: SearchedPath | None = None,
) -> tuple[Law, tuple[SingularityCrossing, ...]]:
    """The law of `plan_crossing` on the undeformed robot before anything is proved, for raw sampling.

    With it the instants at singular points and t_s . W_p there, zero or not.

    Raises:
        As `plan_crossing`, but no UnboundedTorque and no NotConverged.
    """
    task = _task(robot, path, duration, times, speeds, at, smoothness, searched)
    crossings = [(place, condition_at(task.branch, place, None)) for place in _at_rest(task)]
    law = _law(crossings, task.crossing_times, duration, task.smoothness)
    check_advance(law, [point.s for point in task.points], robot.name)
    return law, rigid_crossings(task.branch, task.points, law)


@dataclass(frozen=True)
class _Task:
    """What is asked, checked, with the path followed and its singular points located."""

    branch: Branch
    points: tuple[SingularPoint, ...]
    targets: list[SingularPoint | CrossingPoint]  # where condition (8) is to hold
    crossing_times: tuple[CrossingTime, ...]  # one for each target
    smoothness: int


def _task(
    robot: ParallelRobot,
    path: Path,
    duration: float,
    times: Sequence[float] | None,
    speeds: Sequence[float] | None,
    at: Sequence[float] | None,
    smoothness: int | None,
    searched: SearchedPath | None,
) -> _Task:
    smoothness = _checked_smoothness(robot, smoothness)
    _check_numbers(duration, times, speeds, at)
    branch, points = search_path(robot, path) if searched is None else searched
    targets = _targets(branch, points, times, speeds, at)
    crossing_times = _choose_timing(branch, targets, duration, times, speeds, smoothness)
    return _Task(branch, points, targets, crossing_times, smoothness)


def _at_rest(task: _Task) -> list[CrossingPoint]:
    """The crossing points of the undeformed robot."""
    return [
        crossing_point(task.branch, target, None, target.s) if isinstance(target, SingularPoint) else target
        for target in task.targets
    ]


def _deflection(deflections: TimeFunction | None, t: float) -> Deflection | None:
    if deflections is None:
        return None
    return Deflection(*(deflections(t, order) for order in range(3)))


def _law(
    crossings: list[tuple[CrossingPoint, Condition8]],
    crossing_times: Sequence[CrossingTime],
    duration: float,
    smoothness: int,
) -> Law:
    inner = [
        Condition(crossing_time.time, order, value)
        for (place, condition), crossing_time in zip(crossings, crossing_times, strict=True)
        for order, value in enumerate(
            (place.s, crossing_time.speed, condition.acceleration(crossing_time.speed))
        )
    ]
    return Law.rest_to_rest(duration, smoothness, inner)


def _targets(
    branch: Branch,
    points: tuple[SingularPoint, ...],
    times: Sequence[float] | None,
    speeds: Sequence[float] | None,
    at: Sequence[float] | None,
) -> list[SingularPoint | CrossingPoint]:
    """Where condition (8) is to hold; refuses what no law can cross."""
    robot = branch.robot
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
    where = f"{robot.name}: at s = {at.s:.6g} the path"
    check_kind(robot, at)
    if at.s < 1e-9 or at.s > 1 - 1e-9:
        end = "starts" if at.s < 0.5 else "ends"
        raise NoLaw(
            f"{where} {end} on a Type 2 singularity; a stop on the locus can never be crossed: "
            f"move the path's end"
        )
    if at.contact == "tangential":
        raise NoLaw(
            f"{where} touches the locus without crossing it; finite torques would ask for condition "
            f"(8) and its time derivative at once: move the path off the locus or across it"
        )


def _choose_timing(
    branch: Branch,
    targets: list[SingularPoint | CrossingPoint],
    duration: float,
    times: Sequence[float] | None,
    speeds: Sequence[float] | None,
    smoothness: int,
) -> tuple[CrossingTime, ...]:
    """Times and speeds of the crossings on the undeformed robot, those left open chosen."""
    if not targets:
        return ()
    for t in times or ():
        if not 0 < t < duration:
            raise InvalidInput(
                f"times: a crossing at t = {t:g} s must lie inside the motion, (0, {duration:g}) s"
            )
    crossings = []
    for target in targets:
        place = (
            crossing_point(branch, target, None, target.s) if isinstance(target, SingularPoint) else target
        )
        crossings.append((place, condition_at(branch, place, None)))

    def build(crossing_times: Sequence[CrossingTime]) -> Law:
        return _law(crossings, crossing_times, duration, smoothness)

    return choose_timing(
        [place.s for place, _ in crossings], duration, times, speeds, smoothness, build, branch.robot.name
    )


def _checked_smoothness(robot: ParallelRobot, smoothness: int | None) -> int:
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
    duration: float,
    times: Sequence[float] | None,
    speeds: Sequence[float] | None,
    at: Sequence[float] | None,
) -> None:
    check_duration(duration)
    for name, values in (("times", times), ("speeds", speeds), ("at", at)):
        for value in values if values is not None else ():
            if not is_number(value):
                raise InvalidInput(f"{name}: must be finite numbers, got {value!r}")
    for speed in speeds if speeds is not None else ():
        if speed <= 0:
            raise InvalidInput(f"speeds: s' at a crossing must be greater than zero, got {speed:g}")
        if speed > LARGEST_SPEED / duration:
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
