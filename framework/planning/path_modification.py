"""The least bend of a path that lets a robot cross where no timing can.

t_s is the platform's twist that the motors do not control at a crossing. Where a path runs orthogonal to t_s,
the acceleration s" of a law has no effect on condition (8), t_s . W_p = 0. So the tangent at the crossing
s = c is turned towards t_s. The path becomes x(s) + k d b(s) with a factor k, where d are the rates of the
platform coordinates that move the platform along t_s, and

    b(s) = (s / m)^(N m) ((1 - s) / (1 - m))^(N (1 - m)),  b"(c) = 0,

is a bump of height 1 at m with its steepest slope at c; N = 10 is its order. Among all m, this one turns the
tangent most for a given height of the bump. The bend shifts the crossing a little and keeps both ends of the
path. The bent path is a spline through points of that curve, and all proofs are made on the spline.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NoAnswer, NoLaw, UncontrolledMotions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.curves import Spline
from framework.laws.law import is_number
from framework.numerics.arrays import Array
from framework.planning.feasibility import feasibility_on_path
from framework.planning.plan import plan_request
from framework.planning.refusals import HoldingTorque, UnmetCondition
from framework.planning.request import MOTION_SAMPLES, Request, path_length
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import search_path
from framework.tolerances import SAME_PLACE

MAX_BEND_SHARE = 0.05  # largest bend divided by the path's length; a larger one would make another path
END_SHARE = 0.15  # least distance in s of a crossing from both ends: nearer, the bump ends with a kink
# DOUBLED_BENDS bends are tried to each side, each twice the last. The first, 0.04 % of the path's length, is
# of the size of errors in building a robot. COMPARED_BENDS is the number of bends from the least sufficient
# one to the largest whose torques are compared.
DOUBLED_BENDS, COMPARED_BENDS = 8, 6


class BendChoice(NamedTuple):
    """The size of a bend, and the peak torques of the plan on the bent path."""

    share: float  # of the path's length
    peak_torque: dict[str, float]  # [N m, N] by joint of the motor


class ModifiedPathPlan(NamedTuple):
    """A plan, and the distance of its path from the requested path; 0 if no bend was needed.

    Distances are between points of equal s.

    moved: the largest distance of the translations [m].
    turned: the largest norm of the difference of the rotation vectors [rad].
    share: the largest distance divided by the path's length, with rotations multiplied by the robot's length.
    choices: this bend and larger ones to the same side, with the torques of their plans.
    """

    plan: CrossingPlan
    moved: float = 0.0
    turned: float = 0.0
    share: float = 0.0
    choices: tuple[BendChoice, ...] = ()


def plan_request_with_modified_path(
    robot: ParallelRobot, request: Request, *, bend: float | None = None
) -> ModifiedPathPlan:
    """Plan a request; if no law can cross, bend the path.

    The path is bent at the crossing whose tangent is the most orthogonal to t_s, by the least bend that has a
    plan within the limits of the request, with a reserve. Without a torque limit the least bend may need a
    large torque: `choices` has the torques of larger bends.

    Args:
        bend: the bend to use instead of the least, as a share of the path's length. The path is bent to the
            side of smaller torques.

    Raises:
        InvalidInput: a bend that is not in (0, MAX_BEND_SHARE].
        NoLaw: no bend helps; the message has the refusal of the unbent path.
        NoAnswer: for other reasons, as `plan_request`.
    """
    if bend is not None and not (is_number(bend) and 0.0 < bend <= MAX_BEND_SHARE):
        raise InvalidInput(
            f"bend: must be a share in (0, {MAX_BEND_SHARE:g}] of the path's length, got {bend!r}"
        )
    try:
        return ModifiedPathPlan(plan_request(robot, request))
    except UncontrolledMotions:  # a NoLaw that no bend mends
        raise
    except NoLaw as refusal:
        proof = refusal.proof
        is_about_end = isinstance(proof, HoldingTorque) or (isinstance(proof, UnmetCondition) and proof.stop)
        # no bend moves an end of the path
        modification = None if is_about_end else _modification_at_crossing(robot, request)
        if modification is None:
            raise
        modified = modification.plan_with_least() if bend is None else modification.plan_with(bend)
        if modified is None:
            tried = f"up to {100 * MAX_BEND_SHARE:g}" if bend is None else f"{100 * bend:g}"
            raise refusal.adding(f"nor does a bend of {tried} % of its length help").advising(None) from None
        return modified


class _Modification(NamedTuple):
    """A request and the unit bend of its path: a displacement as large as the path is long."""

    robot: ParallelRobot
    request: Request  # with the path that is to be bent
    s: Array  # (m,) path coordinates of the points of the bent spline
    unit_bend: Array  # (m, n) displacement of these points by the unit bend, zero at both ends
    unit_lengths: Array  # (n,) [m] that count as one unit of each platform coordinate
    length: float  # [m] of the path

    def plan_bent(self, share: float) -> CrossingPlan | None:
        """Plan on the bent path; return None without a plan.

        Args:
            share: the size of the bend divided by the path's length; the sign says to which side.
        """
        points = self.request.path(self.s) + share * self.unit_bend
        try:
            request = replace(self.request, path=Spline(points))
            return plan_request(self.robot, request, explained=False)  # the refusal is not reported
        except (NoAnswer, InvalidInput):  # the latter if the bent path has another number of crossings
            return None

    def plan_with(self, bend: float) -> ModifiedPathPlan | None:
        """Plan with a bend, a share of the length, to the side of smaller torques; None without a plan."""
        plans = [plan for plan in map(self.plan_bent, (bend, -bend)) if plan is not None]
        best = min(plans, key=lambda plan: max(plan.peak_torque.values()), default=None)
        return None if best is None else self._measure(best, choices=())

    def plan_with_least(self) -> ModifiedPathPlan | None:
        """Plan with the least sufficient bend, and compare larger ones; None without a plan."""
        least = self._find_least()
        if least is None:
            return None
        share, plan = least
        choices = [BendChoice(abs(share), plan.peak_torque)]
        if abs(share) < MAX_BEND_SHARE:
            bends = np.geomspace(abs(share), MAX_BEND_SHARE, COMPARED_BENDS).tolist()
            for bend in bends[1:]:  # the first is the least sufficient one
                larger = self.plan_bent(np.copysign(bend, share))
                if larger is not None:
                    choices.append(BendChoice(bend, larger.peak_torque))
        return self._measure(plan, tuple(choices))

    def _find_least(self) -> tuple[float, CrossingPlan] | None:
        """Find the least sufficient bend with a reserve, and its plan.

        Bends are tried to both sides, each twice the last, until one has a plan. Bisection between this bend
        and half of it gives the least bend. The bend is a share of the path's length; its sign is the side.
        The reserve is left out if the request has no plan with it.
        """
        max_bisections = 3  # after which the least bend is known to a factor of 2^(1/8), or 9 %
        reserve = 1.1  # by which the least bend is multiplied
        shares = MAX_BEND_SHARE / 2.0 ** np.arange(DOUBLED_BENDS)[::-1]  # ascending
        for share in np.outer(shares, [1.0, -1.0]).ravel().tolist():  # each to both sides
            plan = self.plan_bent(share)
            if plan is not None:
                break
        else:  # no bend has a plan
            return None

        refused = 0.5 * share
        bisections = max_bisections if abs(share) > shares[0] else 0  # half of the first bend was not tried
        for _ in range(bisections):
            middle = np.copysign(np.sqrt(refused * share), share)
            middle_plan = self.plan_bent(middle)
            if middle_plan is None:
                refused = middle
            else:
                share, plan = middle, middle_plan

        with_reserve = reserve * share
        reserved = self.plan_bent(with_reserve)
        return (share, plan) if reserved is None else (with_reserve, reserved)

    def _measure(self, plan: CrossingPlan, choices: tuple[BendChoice, ...]) -> ModifiedPathPlan:
        """Return the plan with the distances of its path from the requested path, and with `choices`."""
        s = np.linspace(0.0, 1.0, MOTION_SAMPLES)
        change = plan.path(s) - self.request.path(s)  # (MOTION_SAMPLES, n)
        is_translation = self.robot.translations
        distance = _largest_norm(change[:, is_translation])
        turn = _largest_norm(change[:, ~is_translation])
        share = _largest_norm(change * self.unit_lengths) / self.length
        return ModifiedPathPlan(plan, distance, turn, share, choices)


def _modification_at_crossing(robot: ParallelRobot, request: Request) -> _Modification | None:
    """Return the bend at the crossing whose tangent is most orthogonal to t_s.

    The result is None if every crossing is too close to an end of the path for a bend.
    """
    path = request.path
    searched = search_path(robot, path)
    candidates = [
        (feasibility, singular.twist)
        for feasibility, singular in zip(feasibility_on_path(searched), searched.points, strict=True)
        if feasibility is not None and END_SHARE < singular.s < 1 - END_SHARE
    ]
    if not candidates:
        return None
    feasibility, twist = min(candidates, key=lambda pair: pair[0].tangent_share)
    c = feasibility.s  # the crossing

    # d of this file's docstring: the coordinate rates (n,) that move the platform along t_s
    rate_matrix = robot.platform.rate_matrix(path(c)[None])[0]  # (n, n) twist per coordinate rate
    direction = np.linalg.solve(rate_matrix, twist)

    # the largest displacement [m] by the bend b(s) d, which the unit bend scales to the path's length
    unit_lengths = robot.length / robot.platform_scale
    bump_height = np.abs(_evaluate_bump(np.linspace(0.0, 1.0, MOTION_SAMPLES), c)).max()
    largest = bump_height * np.linalg.norm(direction * unit_lengths)
    length = path_length(robot, path)

    # The crossing must be near the middle of an interval of the spline: a knot between two intervals is an
    # edge between panels in time, which no crossing may meet.
    min_intervals = 9
    least = min_intervals + 2 * len(path.knots)
    count = min(range(least - 1, least + 3), key=lambda intervals: abs(c * intervals % 1.0 - 0.5))
    s = np.linspace(0.0, 1.0, count + 1)
    unit_bend = _evaluate_bump(s, c)[:, None] * direction * (length / largest)
    return _Modification(robot, request, s, unit_bend, unit_lengths, length)


def _largest_norm(rows: Array) -> float:
    """Return the largest norm of the rows (T, k)."""
    return float(np.linalg.norm(rows, axis=1).max())


def _evaluate_bump(s: Array, c: float) -> Array:
    """Evaluate b(s) of this file's docstring for a crossing at c.

    With N = 10, b and its first two derivatives vanish at both ends for c in [END_SHARE, 1 - END_SHARE]. The
    peak m follows from c: with c as the inflexion point before the peak, (m - c)^2 (N - 1) = m (1 - m), or

        N m^2 - 2 p m + (N - 1) c^2 = 0,        p = (N - 1) c + 1/2.

    For c > 1/2 the bump of 1 - c is mirrored. In the middle both would do. SAME_PLACE decides there, so that
    rounding of c does not.
    """
    N = 10.0
    inflexion = min(c, 1.0 - c)
    p = inflexion * (N - 1) + 0.5
    root = (p + np.sqrt(p**2 - N * (N - 1) * inflexion**2)) / N  # the larger one: the peak is behind
    m = root if c <= 0.5 + SAME_PLACE else 1.0 - root
    rising = (s / m) ** (N * m)
    falling = ((1.0 - s) / (1.0 - m)) ** (N * (1.0 - m))
    return rising * falling
