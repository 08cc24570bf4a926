"""The smallest change of a path that lets a robot cross where no timing can: `plan_bent`.

Where a path runs orthogonal to t_s, s" has no hold on condition (8). So its tangent at the crossing c is
turned towards t_s, x(s) + size d b(s) with d the coordinates that move the platform along t_s and

    b(s) = (s / m)^(N m) ((1 - s) / (1 - m))^(N (1 - m)),  b"(c) = 0,

a bump with its peak, 1, at m and its steepest slope at c: of all places of the peak, that turns the tangent
most for the distance moved. The crossing moves along with it. The ends stay where they are, and the bent path
is a spline through points of that curve: everything is proved on the spline.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.feasibility import feasibility_on_path
from framework.crossing.path_length import coordinate_sizes, path_length
from framework.crossing.plan import plan_request
from framework.crossing.refusal_proofs import HoldingTorque, UnmetCondition
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.errors import InvalidInput, NoAnswer, NoLaw, UncontrolledMotions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.path import Path, Spline
from framework.singularity.points_on_path import search_path

LARGEST = 0.05  # of the path's length: a bend beyond that makes another path
HALVINGS = 7  # the smallest bend tried is LARGEST / 2^7, 0.04 % of the length: a matter of making the robot
STEPS = 3  # bisections of the last factor of two: the least is known to 2^(1/8), 9 %
MARGIN = 0.1  # of its size, by which the bend is made larger than the least found
ORDER = 10.0  # N: b and two derivatives of it vanish at both ends for c in [ROOM, 1 - ROOM]
POINTS = 9  # of the spline, and two more for each knot of the path
ROOM = 0.15  # in s: nearer to an end the bump would not vanish smoothly there


class BentPlan(NamedTuple):
    """A plan and how far its path is from the one asked for; its path is `plan.path`.

    moved, turned: the largest distance [m], and the largest norm of the difference of rotation vectors
    [rad], between points of the same s; both 0 where no bend was needed.
    share: the largest distance over the path's length, turns multiplied by the robot's length.
    """

    plan: CrossingPlan
    moved: float
    turned: float
    share: float


def plan_bent(robot: ParallelRobot, path: Path, **options: Any) -> BentPlan:
    """`plan_crossing` with these options; where no law can cross, on the path with the least bend that helps.

    See `plan_bent_request`.
    """
    return plan_bent_request(robot, Request.of(robot, path, **options))


def plan_bent_request(robot: ParallelRobot, request: Request) -> BentPlan:
    """The plan of a request, on its path bent where it is nearest to orthogonal to t_s if it needs to be.

    Least means: of bends to either side, each twice the last, the first with which the request is planned,
    within its limits if it has any, bisected against the last that was refused; then `MARGIN` is added.
    Without a limit of torque the least bend may well ask for a large one.

    Raises:
        As `plan_request`; NoLaw with the reason of the path itself where no bend helps.
    """
    try:
        return BentPlan(plan_request(robot, request), 0.0, 0.0, 0.0)
    except UncontrolledMotions:
        raise
    except NoLaw as refusal:
        proof = refusal.proof  # of an end, which a bend keeps?
        at_end = isinstance(proof, HoldingTorque) or (isinstance(proof, UnmetCondition) and proof.stop)
        bend = None if at_end else _bend_at_crossing(robot, request.path)
        if bend is None:
            raise
        found = _least(robot, request, bend)
        if found is None:
            raise NoLaw(
                f"{refusal}; nor does a bend of up to {100 * LARGEST:g} % of its length help", proof=proof
            ) from None
    return found


class _Bend(NamedTuple):
    """A path and what it can be bent by, so that 1 moves it by its own length."""

    path: Path
    s: Array  # (m,)
    unit: Array  # (m, n)
    size: Array  # (n,) [m] of 1 of each coordinate
    length: float  # [m]

    def path_of(self, share: float) -> Spline:
        points = self.path(self.s) + share * self.unit
        points[[0, -1]] = self.path(self.s[[0, -1]])
        return Spline(points)


def _bend_at_crossing(robot: ParallelRobot, path: Path) -> _Bend | None:
    """The bend where the path is nearest to orthogonal to t_s; None where it has no room for one."""
    searched = search_path(robot, path)
    pairs = zip(searched.points, feasibility_on_path(searched), strict=True)
    room = [(told.tangent_share, at) for at, told in pairs if told is not None and ROOM < at.s < 1 - ROOM]
    if not room:
        return None
    at = min(room, key=lambda pair: pair[0])[1]
    x = np.repeat(path(at.s)[None], robot.n, axis=0)
    along_twist = np.linalg.solve(robot.platform.twist(x, np.eye(robot.n))[0].T, at.twist)
    size, length = coordinate_sizes(robot), path_length(robot, path)
    fine = np.linspace(0.0, 1.0, 1001)
    largest = np.abs(_shape(fine, at.s)).max() * float(np.linalg.norm(along_twist * size))
    least = POINTS + 2 * len(path.knots)  # no point, and so no knot, at c: knots part the panels of time
    intervals = max(range(least - 1, least + 3), key=lambda m: -abs(at.s * m % 1.0 - 0.5))
    s = np.linspace(0.0, 1.0, intervals + 1)
    unit = _shape(s, at.s)[:, None] * along_twist * (length / largest)
    return _Bend(path, s, unit, size, length)


def _shape(s: Array, at: float) -> Array:
    """b(s) of the head of this file, with the crossing c = `at`."""
    c = min(at, 1.0 - at)
    half = 2.0 * c * (ORDER - 1) + 1.0
    # the inflexion before the peak: (m - c)^2 (N - 1) = m (1 - m)
    m = (half + np.sqrt(half**2 - 4.0 * ORDER * (ORDER - 1) * c**2)) / (2.0 * ORDER)
    m = m if at <= 0.5 else 1.0 - m
    return (s / m) ** (ORDER * m) * ((1.0 - s) / (1.0 - m)) ** (ORDER * (1.0 - m))


def _least(robot: ParallelRobot, request: Request, bend: _Bend) -> BentPlan | None:
    """The least bend with which the request is planned."""

    def planned(share: float) -> CrossingPlan | None:
        try:
            return plan_request(robot, replace(request, path=bend.path_of(share)))
        except (NoAnswer, InvalidInput):  # the latter: not as many crossings as times or speeds
            return None

    tried = (side * LARGEST / 2.0**k for k in range(HALVINGS, -1, -1) for side in (1.0, -1.0))
    enough, plan = next(
        ((share, plan) for share in tried if (plan := planned(share)) is not None), (0.0, None)
    )
    if plan is None:
        return None
    refused = 0.5 * enough
    for _ in range(STEPS if abs(enough) > LARGEST / 2.0**HALVINGS else 0):
        middle = float(np.sqrt(refused * enough)) * np.sign(enough)
        better = planned(middle)
        refused, enough, plan = (middle, enough, plan) if better is None else (refused, middle, better)
    plan = planned((1.0 + MARGIN) * enough) or plan
    s = np.linspace(0.0, 1.0, 1001)
    change = plan.path(s) - bend.path(s)
    moved, turned, both = (
        float(np.linalg.norm(part, axis=1).max())
        for part in (change[:, robot.translations], change[:, ~robot.translations], change * bend.size)
    )
    return BentPlan(plan, moved, turned, both / bend.length)
