"""Plan a crossing: locate the singular points, meet condition (8) in each, prove the torques finite."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.condition import Condition8
from framework.crossing.feasibility import feasibility_on_path
from framework.crossing.limits import Limit, motor_limits
from framework.crossing.optimal import Wish
from framework.crossing.optimal_motion import Task, optimal_motion
from framework.crossing.polynomial import Ground, polynomial_at_rest, polynomial_motion
from framework.crossing.request import Request, checked_smoothness, targets_of
from framework.crossing.result import Crossing, CrossingPlan, Optimality
from framework.crossing.timing import CrossingTime
from framework.dynamics.crossings import rigid_crossings
from framework.dynamics.inverse_dynamics import TOLERANCE, checked_geometry
from framework.dynamics.result import InverseDynamics, SingularityCrossing
from framework.errors import (
    InvalidInput,
    LimitsExceeded,
    NoLaw,
    NotConverged,
    UncontrolledMotions,
    choose_from,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.cone_program import GOALS
from framework.motion.law import Law, MotionLaw, check_duration
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS
from framework.motion.path import Path
from framework.singularity.points_on_path import SearchedPath, search_path

CREEPING = 0.1  # least speed over its mean (the ends divided out) below which a polynomial is given up
LAWS = ("auto", "polynomial", "optimal")


def plan_crossing(
    robot: ParallelRobot,
    path: Path,
    *,
    duration: float | None = None,
    times: Sequence[float] | None = None,
    speeds: Sequence[float] | None = None,
    at: Sequence[float] | None = None,
    geometry: str | None = None,
    smoothness: int | None = None,
    tolerance: float = TOLERANCE,
    law: str = "auto",
    optimize: str | None = None,
    longest: float | None = None,
    torque_limit: Limit = None,
    speed_limit: Limit = None,
    margin: float = 0.0,
    keep_limits: bool = False,
    searched: SearchedPath | None = None,
) -> CrossingPlan:
    """A rest-to-rest law along the path that crosses its singular points with finite torques.

    Args:
        duration: of the motion [s]; not with optimize="time", which finds the least.
        times: instants of the crossings [s], ascending, one for each singular point; chosen when
            None. An empty list asks for a law without crossing conditions.
        speeds: s' at the crossings [1/s]; chosen when None.
        at: path coordinates to impose condition (8) at, instead of the located singular points.
        geometry: "rigid" takes forces on the undeformed robot (the paper's small displacements);
            "deformed", the default for elastic robots, on the deformed one, whose singular points
            are elsewhere.
        smoothness: derivatives of s that vanish at both ends; 2 for rigid, 4 for elastic robots.
        tolerance: tail of the torques that counts as resolved.
        law: "polynomial" through `times` and `speeds`, "optimal" (see `optimal_law`), or "auto": the
            polynomial where one exists that advances comfortably, and else the optimal law. The plan's
            `reason` says which it was and why.
        optimize: what the optimal law is best at: "time"; "peak_torque", the default: the largest torque
            over its limit, or in N m if no motor has one; "energy": the integral over the motion of the sum
            of (torque over limit)^2. A small weight on the roughness of the law is added.
        longest: duration [s] that the optimal law may not exceed, instead of `duration`.
        torque_limit, speed_limit: of the motors [N m], [rad/s], motor side, a number for all or one for
            each; the robot file's by default. The optimal law never exceeds them.
        margin: share of all limits that is left to the controllers.
        keep_limits: refuse a plan that leaves the limits of its motors or of the URDF's joints, which is
            otherwise returned and says so (`CrossingPlan.exceeded`).
        searched: what `search_path` found on this path, if at hand.

    Raises:
        InvalidInput: an argument that cannot be right; says what is valid.
        NoLaw: no law can cross (a stop on the locus, a tangential touch, a path orthogonal to t_s,
            a singularity that is not of Type 2), or none that always advances was found.
        UncontrolledMotions: two motions or more are uncontrolled at once.
        UnboundedTorque: the law meets a singularity without condition (8); no torque is returned.
        LimitsExceeded: only with `keep_limits`.
        NotConverged, OutOfReach, Type1Singularity, SingularPath: see `inverse_dynamics`.

    Source: Briot and Arakelian 2010, condition (8) and Eqs. (19)-(31).
    """
    started = time.perf_counter()
    geometry = checked_geometry(robot, geometry)
    request = Request(duration, times, speeds, at, checked_smoothness(robot, smoothness))
    limits = motor_limits(robot, torque_limit, speed_limit, margin)
    limited = torque_limit is not None or speed_limit is not None or margin > 0
    asked = optimize is not None or longest is not None or limited
    kind = _kind_of_law(law, asked, request)
    free = kind == "optimal" or (kind == "auto" and request.smoothness <= HIGHEST_SMOOTHNESS)
    wish = _wish(optimize, longest, limits, request) if free else None
    branch, points = search_path(robot, path) if searched is None else searched
    work = _Work(
        Ground(branch, points, targets_of(branch, points, request)), request, geometry, tolerance, started
    )
    try:
        plan = _best(work, wish if kind == "optimal" else None, fallback=wish)
    except UncontrolledMotions:
        raise
    except NoLaw as refusal:
        told = [found.sentence(duration) for found in feasibility_on_path(work.searched) if found is not None]
        raise NoLaw("; ".join([str(refusal), *told])) from None
    exceeded = plan.exceeded if keep_limits else {}
    if exceeded:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in exceeded.items())
        raise LimitsExceeded(f"{robot.name}: the motion leaves limits: {listed}", exceeded=exceeded)
    return plan


def _best(work: _Work, wish: Wish | None, *, fallback: Wish | None) -> CrossingPlan:
    """The plan with the optimal law if there is a wish, else with the polynomial or what it falls back on."""
    if wish is not None:
        return _optimal(work, wish, "it was asked for")
    try:
        plan, advance = _polynomial(work)
    except UncontrolledMotions:
        raise
    except NoLaw as refusal:
        if fallback is None:
            raise
        try:
            return _optimal(work, fallback, f"there is no polynomial: {refusal}")
        except (NoLaw, NotConverged) as second:
            raise NoLaw(f"{refusal}; nor does the optimal law help: {second}") from None
    if fallback is None or not plan.crossings or work.request.speeds is not None or advance >= CREEPING:
        return plan
    nearly_stops = f"the polynomial nearly stops: its least speed is {advance:.2g} of its mean"
    try:
        return _optimal(work, fallback, nearly_stops)
    except (NoLaw, NotConverged):
        return plan


class _Work(NamedTuple):
    """What planning with either law needs to know."""

    ground: Ground
    request: Request
    geometry: str
    tolerance: float
    started: float

    @property
    def searched(self) -> SearchedPath:
        return SearchedPath(self.ground.branch, self.ground.points)


def _kind_of_law(law: str, asked: bool, request: Request) -> str:
    """Which law to use: "polynomial", "optimal", or "auto" for the first where it does."""
    if law not in LAWS:
        raise InvalidInput(choose_from("law", law, LAWS))
    if asked and law == "polynomial":
        raise InvalidInput("optimize, longest, limits and margin are for the optimal law, not the polynomial")
    if asked or law == "optimal":
        if request.times is not None:
            raise InvalidInput("times: belong to the polynomial; the optimal law finds its own")
        return "optimal"
    if request.duration is None:
        raise InvalidInput("duration: needed, unless optimize time finds the least, or longest bounds it")
    return "polynomial" if law == "polynomial" or request.times is not None else "auto"


def _wish(optimize: str | None, longest: float | None, limits: tuple[Array, Array], request: Request) -> Wish:
    goal = "peak_torque" if optimize is None else optimize
    if goal not in GOALS:
        raise InvalidInput(choose_from("optimize", goal, GOALS))
    if longest is not None:
        check_duration(longest)
    if longest is not None and request.duration is not None:
        raise InvalidInput("longest: bounds a duration that is open; give either, not both")
    if goal == "time" and request.duration is not None:
        raise InvalidInput("duration: with optimize time it is found; give longest to bound it")
    if goal == "time" and not (np.isfinite(limits[0]).any() or np.isfinite(limits[1]).any()):
        raise InvalidInput(
            "torque_limit: optimize time needs a limit of torque or speed, given or in the robot file"
        )
    if goal != "time" and request.duration is None and longest is None:
        raise InvalidInput(
            f"duration: optimize {goal} needs one, or longest: without, slower is always better"
        )
    if request.smoothness > HIGHEST_SMOOTHNESS:
        raise InvalidInput(
            f"smoothness: got {request.smoothness}, the optimal law has at most {HIGHEST_SMOOTHNESS}"
        )
    return Wish(goal, request.duration, longest, *limits, request.smoothness)


def _polynomial(work: _Work) -> tuple[CrossingPlan, float]:
    """The plan with the polynomial law, and how well that advances."""
    ground, request = work.ground, work.request
    dynamics, law, met = polynomial_motion(ground, request, geometry=work.geometry, tolerance=work.tolerance)
    advance = law.advance(request.smoothness)
    certificate = replace(dynamics.certificate, monotone=advance > 0)
    reported = tuple(_crossing(found, law, met, law.duration) for found in dynamics.crossings)
    seconds = time.perf_counter() - work.started
    robot, path = dynamics.robot, dynamics.path
    return CrossingPlan(
        robot, path, law, reported, dynamics, certificate, seconds, "the polynomial advances"
    ), advance


def _optimal(work: _Work, wish: Wish, reason: str) -> CrossingPlan:
    """The plan with the optimal law."""
    ground = work.ground
    task = Task(ground.branch, ground.points, ground.targets, work.request.speeds, wish, work.geometry)
    dynamics, law, best = optimal_motion(task, tolerance=work.tolerance)
    certificate = replace(dynamics.certificate, monotone=law.advance(law.smoothness) > 0)
    optimality = Optimality(wish, best.reference)
    return CrossingPlan(
        dynamics.robot,
        dynamics.path,
        law,
        reported_crossings(dynamics, law),
        dynamics,
        certificate,
        time.perf_counter() - work.started,
        reason,
        optimality,
    )


def reported_crossings(dynamics: InverseDynamics, law: MotionLaw) -> tuple[Crossing, ...]:
    """What a finished motion does at its singular instants, whoever chose its law."""
    return tuple(_crossing(found, law, {}, law.duration) for found in dynamics.crossings)


def _crossing(
    at: SingularityCrossing, law: MotionLaw, met: dict[CrossingTime, Condition8], duration: float
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
    request = Request(duration, times, speeds, at, checked_smoothness(robot, smoothness))
    branch, points = search_path(robot, path) if searched is None else searched
    ground = Ground(branch, points, targets_of(branch, points, request))
    law = polynomial_at_rest(ground, request)
    return law, rigid_crossings(branch, points, law)
