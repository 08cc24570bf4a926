"""The smallest change of a path that lets a robot cross where no timing can.

Where a path runs orthogonal to t_s, s" has no hold on condition (8). So its tangent at the crossing c is
turned towards t_s, x(s) + size d b(s) with d the coordinates that move the platform along t_s and

    b(s) = (s / m)^(N m) ((1 - s) / (1 - m))^(N (1 - m)),  b"(c) = 0,

a bump with its peak, 1, at m and its steepest slope at c. Among all m, this one turns the tangent most for a
given size of the bump. The crossing moves along. The ends stay, and the bent path is a spline through points
of that curve: everything is proved on the spline.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NoAnswer, NoLaw, UncontrolledMotions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import is_number
from framework.laws.path import Path, Spline
from framework.numerics.arrays import Array
from framework.planning.feasibility import feasibility_on_path
from framework.planning.motion_scales import coordinate_sizes, path_length
from framework.planning.plan import plan_request
from framework.planning.refusals.refusal_proofs import HoldingTorque, UnmetCondition
from framework.planning.request import Request
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import search_path

MAX_BEND_SHARE = 0.05  # of the path's length: a bend beyond that makes another path
END_SHARE = 0.15  # in s: nearer to an end the bump would not vanish smoothly there
BEND_SAMPLES = 1001  # equidistant places at which the size of a bend is measured
# bends to each side, each twice the last, from 0.04 % of the path on: less is a matter of making the robot
DOUBLED_BENDS, COMPARED_BENDS = 8, 6  # the latter from the least sufficient one to the largest
BISECTIONS, RESERVE = 3, 1.1  # the least bend is then known to 2^(1/8), 9 %; factor on it
MIN_INTERVALS = 9  # of the bent spline


class BendChoice(NamedTuple):
    """A bend over the path's length, and torque peaks [N m] by joint."""

    share: float
    peak_torque: dict[str, float]


class ModifiedPathPlan(NamedTuple):
    """A plan, and the distance of its path from the path asked for.

    moved, turned: the largest distance [m], and the largest norm of the difference of rotation vectors
    [rad], between points of the same s; both 0 where no bend was needed.
    share: the largest distance over the path's length, turns multiplied by the robot's length.
    choices: this bend and larger ones to the same side, with the torques of their plans.
    """

    plan: CrossingPlan
    moved: float
    turned: float
    share: float
    choices: tuple[BendChoice, ...] = ()


def plan_request_with_modified_path(
    robot: ParallelRobot, request: Request, *, bend: float | None = None
) -> ModifiedPathPlan:
    """Plan a request; bend the path where no law can cross.

    The crossing most orthogonal to t_s is bent. Bends are tried to both sides, each twice the last, until the
    request is planned, within its limits if it has any. The least bend is bisected between that and the last
    refused one, and a tenth of it added. Without a torque limit the least bend may well need a large torque:
    `choices` has the torques of larger bends.

    Args:
        bend: this share of the path's length instead of the least, to the side with the smaller torques.

    Raises:
        InvalidInput: a bend that is not in (0, MAX_BEND_SHARE].
        As `plan_request`; NoLaw with the reason of the path itself where no bend helps.
    """
    if bend is not None and not (is_number(bend) and 0.0 < bend <= MAX_BEND_SHARE):
        raise InvalidInput(
            f"bend: must be a share in (0, {MAX_BEND_SHARE:g}] of the path's length, got {bend!r}"
        )
    try:
        return ModifiedPathPlan(plan_request(robot, request), 0.0, 0.0, 0.0)
    except UncontrolledMotions:
        raise
    except NoLaw as refusal:
        proof = refusal.proof
        # what is proved of an end of the path holds with any bend, which keeps the ends
        at_end = isinstance(proof, HoldingTorque) or (isinstance(proof, UnmetCondition) and proof.stop)
        modification = None if at_end else _modification_at_crossing(robot, request)
        if modification is None:
            raise
        modified = modification.plan_with_least() if bend is None else modification.plan_with(bend)
        if modified is None:
            tried = f"up to {100 * MAX_BEND_SHARE:g}" if bend is None else f"{100 * bend:g}"
            raise NoLaw(
                f"{refusal}; nor does a bend of {tried} % of its length help",
                proof=proof,
            ) from None
    return modified


class _Modification(NamedTuple):
    """A request and the unit bend of its path.

    A bend of 1 moves the path by its own length.
    """

    robot: ParallelRobot
    request: Request
    s: Array  # (m,) of the points of the bent spline
    unit: Array  # (m, n) of which a share is added to these points
    size: Array  # (n,) [m] of 1 of each coordinate
    length: float  # [m]

    def plan_bent(self, share: float) -> CrossingPlan | None:
        """Plan on the path bent by this part of its length.

        None without a plan.
        """
        path = self.request.path
        points = path(self.s) + share * self.unit
        points[[0, -1]] = path(self.s[[0, -1]])
        try:
            request = replace(self.request, path=Spline(points))
            return plan_request(self.robot, request, explained=False)
        except (NoAnswer, InvalidInput):  # the latter: not as many crossings as times or speeds
            return None

    def plan_with(self, bend: float) -> ModifiedPathPlan | None:
        """Plan with this bend, to the side of smaller torques; None without a plan."""
        plans = [plan for plan in (self.plan_bent(bend), self.plan_bent(-bend)) if plan is not None]
        if not plans:
            return None
        best = min(plans, key=lambda plan: max(plan.peak_torque.values()))
        return self._measure(best, choices=())

    def plan_with_least(self) -> ModifiedPathPlan | None:
        """Plan with the least sufficient bend, and with larger ones to compare.

        None without a plan.
        """
        least = self._find_least()
        if least is None:
            return None
        share, plan = least
        choices = [BendChoice(abs(share), plan.peak_torque)]
        if abs(share) < MAX_BEND_SHARE:
            for size in np.geomspace(abs(share), MAX_BEND_SHARE, COMPARED_BENDS)[1:].tolist():
                larger = self.plan_bent(float(np.copysign(size, share)))
                choices += [] if larger is None else [BendChoice(size, larger.peak_torque)]
        return self._measure(plan, tuple(choices))

    def _find_least(self) -> tuple[float, CrossingPlan] | None:
        """Find the least sufficient bend, signed by its side, and its plan.

        A reserve is added. The reserve is left out where the request is not planned with it.
        """
        sizes = MAX_BEND_SHARE / 2.0 ** np.arange(DOUBLED_BENDS)[::-1]
        for share in (side * float(size) for size in sizes for side in (1.0, -1.0)):
            plan = self.plan_bent(share)
            if plan is not None:
                break
        else:
            return None
        refused = 0.5 * share
        for _ in range(BISECTIONS if abs(share) > sizes[0] else 0):
            middle = float(np.copysign(np.sqrt(refused * share), share))
            middle_plan = self.plan_bent(middle)
            if middle_plan is None:
                refused = middle
            else:
                share, plan = middle, middle_plan
        with_reserve = RESERVE * share
        reserved = self.plan_bent(with_reserve)
        return (share, plan) if reserved is None else (with_reserve, reserved)

    def _measure(self, plan: CrossingPlan, choices: tuple[BendChoice, ...]) -> ModifiedPathPlan:
        """Measure the distance and the turn between a plan's path and the original."""
        s = np.linspace(0.0, 1.0, BEND_SAMPLES)
        change = plan.path(s) - self.request.path(s)
        is_translation = self.robot.translations
        distance = _largest_norm(change[:, is_translation])
        turn = _largest_norm(change[:, ~is_translation])
        share = _largest_norm(change * self.size) / self.length
        return ModifiedPathPlan(plan, distance, turn, share, choices)


def _modification_at_crossing(robot: ParallelRobot, request: Request) -> _Modification | None:
    """Return the bend at the crossing most orthogonal to t_s.

    None without room for a bend.
    """
    path = request.path
    searched = search_path(robot, path)
    candidates = [
        (feasibility.tangent_share, singular)
        for singular, feasibility in zip(searched.points, feasibility_on_path(searched), strict=True)
        if feasibility is not None and END_SHARE < singular.s < 1 - END_SHARE
    ]
    if not candidates:
        return None
    _, singular = min(candidates, key=lambda pair: pair[0])
    c = singular.s
    size, length = coordinate_sizes(robot), path_length(robot, path)
    direction = _coordinates_of_twist(robot, path(c), singular.twist)  # d of the head of this file
    bump = _evaluate_bump(np.linspace(0.0, 1.0, BEND_SAMPLES), c)
    largest = np.abs(bump).max() * np.linalg.norm(direction * size)  # [m], of the bend b(s) d
    s = np.linspace(0.0, 1.0, _choose_intervals(path, c) + 1)
    unit = _evaluate_bump(s, c)[:, None] * direction * (length / largest)
    return _Modification(robot, request, s, unit, size, length)


def _coordinates_of_twist(robot: ParallelRobot, x: Array, twist: Array) -> Array:
    """Compute the rates (n,) of coordinates x (n,) of a twist (n,)."""
    twists = robot.platform.twist(np.repeat(x[None], robot.n, axis=0), np.eye(robot.n))[0]  # a row a rate
    return np.asarray(np.linalg.solve(twists.T, twist))


def _choose_intervals(path: Path, c: float) -> int:
    """Choose the number of intervals with c nearest to the middle of one.

    A knot is an edge between panels of time, which a crossing must not meet.
    """
    least = MIN_INTERVALS + 2 * len(path.knots)
    return min(range(least - 1, least + 3), key=lambda count: abs(c * count % 1.0 - 0.5))


def _largest_norm(rows: Array) -> float:
    """Return the largest norm of the rows (T, k)."""
    return float(np.linalg.norm(rows, axis=1).max())


def _evaluate_bump(s: Array, c: float) -> Array:
    """Evaluate b(s) of the head of this file for a crossing at c.

    N = 10: b and two derivatives of it vanish at both ends for c in [END_SHARE, 1 - END_SHARE].
    c is an inflexion before the peak m where (m - c)^2 (N - 1) = m (1 - m), a quadratic equation in m. For c
    beyond the middle, the bump is that of 1 - c, mirrored.
    """
    N, near_end = 10.0, min(c, 1.0 - c)
    half_sum = near_end * (N - 1) + 0.5  # N m^2 - 2 half_sum m + (N - 1) near_end^2 = 0
    root = (half_sum + np.sqrt(half_sum**2 - N * (N - 1) * near_end**2)) / N
    m = root if c <= 0.5 else 1.0 - root
    return (s / m) ** (N * m) * ((1.0 - s) / (1.0 - m)) ** (N * (1.0 - m))
