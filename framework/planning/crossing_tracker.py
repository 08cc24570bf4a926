"""The crossings of a deflected robot, followed from one set of deflections to the next.

Deflections q_e move a singular point along the path: it is the root s of g(s, q_e). Both change little from
pass to pass of the deflections, so that the last poses and slopes of g are nearly right for the next ones. An
iteration takes a Newton step of the loops towards the new deflections, then a secant step of g in s, for all
crossings in one stack.

The roots are found to rounding. A law through a point beside the singular one has a pole there: 1e-12 in s
are enough for passes to settle forty times worse, or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from framework.errors import NoLaw
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import integrate
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    linearised_at,
    passive_motion,
    type2_matrix,
)
from framework.kinematics.motion_rates import solve_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.planning.condition import coefficients_at, require_effect
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.points_on_path import SingularPoint
from framework.singularity.type2 import Uncontrolled, twist_norm


class TrackedPoints(NamedTuple):
    """Singular points of a deflected robot, as one stack of k poses."""

    s: Array  # (k,)
    pose: LinearisedLoops  # at these points, T = k
    deflections: Array  # (k, n_e) [m, rad] of the poses
    slopes: Array  # (k,) dg/ds
    motions: Array  # (k, nv) joint rates of the uncontrolled motions
    border: Border | None = None  # of g; None before the first deflections

    @staticmethod
    def from_undeformed(branch: Branch, points: Sequence[SingularPoint]) -> TrackedPoints:
        """Return the singular points of the undeformed robot as they were found."""
        s = np.array([point.s for point in points])
        pose = points[0].pose  # the stack of one
        if len(points) > 1:
            pose = linearised_at(branch.robot, np.array([point.q for point in points]), branch.path(s))
        slopes = np.array([point.slope for point in points])
        motions = np.array([point.motion for point in points])
        return TrackedPoints(s, pose, np.zeros((len(s), branch.robot.n_e)), slopes, motions)


def track_points(branch: Branch, start: TrackedPoints, deflections: Array) -> TrackedPoints:
    """Find the singular points of the robot with deflections (k, n_e), from those with others.

    Raises:
        NoLaw: the deflected robot has no singular point near one of them.
    """
    max_iterations = 12
    longest_step = 0.1  # in s
    last_step = 1e-10  # in s: shorter steps that no longer shrink are rounding
    closed = 1e-16  # gap of the loops that is rounding
    least_secant = 1e-9  # in s: differences of g over shorter steps are rounding
    secant_to_gap = 1e3  # step in s over the last gap: over shorter ones g differs as the loops close
    rounding = 2e-15  # in s
    robot = branch.robot
    s, pose, slopes, border = start.s, start.pose, start.slopes, start.border
    spring_step = deflections - start.deflections
    step = g = gap = np.full(len(s), np.nan)
    last_size = np.inf  # of the last step with closed loops
    for _ in range(max_iterations):
        last_gap = gap
        pose, gap = _step_loops(robot, pose, branch.path(s), spring_step)
        spring_step = 0.0 * spring_step  # the first step has made it

        # a secant step of g; with the border of a pose beside the root it has the sign of det P
        P = type2_matrix(robot, pose)
        border = border or Border.of(P)
        last_g = g
        solution = solve_bordered(P, border)
        g = solution.g
        is_secant = np.abs(step) > np.maximum(least_secant, secant_to_gap * last_gap)
        slopes = np.where(is_secant, (g - last_g) / np.where(is_secant, step, 1.0), slopes)
        step = -g / np.where(slopes == 0.0, np.nan, slopes)
        size = np.abs(step).max(initial=0.0)
        if not size < longest_step:
            break
        s = s + step
        if gap.max() < closed:  # g of open loops says nothing, however small
            if size < rounding or 0.5 * last_size < size < last_step:
                motions = passive_motion(robot, solution.eta[..., 0])
                return TrackedPoints(s, pose, deflections, slopes, motions, border)
            last_size = size
    worst = start.s[np.argmax(np.nan_to_num(np.abs(step), nan=np.inf))]
    raise NoLaw(
        f"the deflected robot has no singular point near s = {worst:.6g}",
        clauses=("the deflections are too large for the path to cross the locus there",),
        name=robot.name,
    )


def _step_loops(
    robot: ParallelRobot, pose: LinearisedLoops, x: Array, spring_step: Array
) -> tuple[LinearisedLoops, Array]:
    """Take a Newton step of k poses towards platform coordinates x (k, n), springs moved by (k, n_e).

    Returns:
        The poses, and about the gap (k,) [m, rad] that the step leaves: the square of what it closes.
    """
    residual = pose.residual.copy()  # (k, rows) of platform and loops
    residual[:, : robot.n] = robot.platform.residual(pose.frames, x)
    gap = np.abs(np.concatenate([residual, spring_step], axis=1)).max(axis=1) ** 2
    q = integrate(robot, pose.frames.q, solve_rates(robot, pose, -residual, spring_step))
    return linearised_at(robot, q, x), gap


@dataclass
class CrossingTracker:
    """The points of k crossings, followed from pass to pass; points that the user imposes rest.

    branch: poses of the undeformed robot.
    points: the crossing points of the undeformed robot.
    times: (k,) [s] of the crossings.
    tracked: the singular points with the last deflections; None before the first ones.
    crossings: the points with the last deflections, each with its condition (8), t_s . W_p = 0.
    """

    branch: Branch
    points: Sequence[SingularPoint]
    times: Array
    tracked: TrackedPoints | None = None
    crossings: list[SingularPoint] = field(default_factory=list)

    def follow(self, deflections: Callable[[Any, int], Array]) -> list[SingularPoint]:
        """Return the crossing points of the deflected robot, each with its condition (8).

        Condition (8), t_s . W_p = 0, gives the s" for which no work is required in the uncontrolled motion
        t_s. The points are followed from those of the last call, which `tracked` and `crossings` hold; points
        that the user imposes stay where they are.

        Args:
            deflections: deflections (k, n_e) and their time derivatives as a function of times and order.

        Raises:
            NoLaw: the deflected robot has no singular point there.
            NotConverged: s" has no effect on the condition with these deflections.
        """
        branch, points = self.branch, self.points
        if not points:
            return []
        at_crossings = np.array([deflections(self.times, order) for order in range(3)])  # (3, k, n_e)
        if not points[0].is_imposed:
            start = self.tracked or TrackedPoints.from_undeformed(branch, points)
            self.tracked = tracked = track_points(branch, start, at_crossings[0])
            points = []  # of Type 2: at others no law is planned
            numbers = zip(tracked.s.tolist(), tracked.slopes.tolist(), tracked.motions, strict=True)
            for k, (s, slope, motion) in enumerate(numbers):
                pose = tracked.pose.select(k)
                twist = pose.platform[0] @ motion
                scale = twist_norm(branch.robot, twist)
                free = Uncontrolled("type_2", twist / scale, motion / scale, corank=1)
                points.append(SingularPoint.of(branch, s, pose, free, contact="transversal", slope=slope))
        self.crossings = []
        for k, point in enumerate(points):
            condition = coefficients_at(branch, point, at_crossings[:, k])
            crossing = replace(point, condition=condition)
            self.crossings.append(require_effect(branch, crossing, deflected=True))
        return self.crossings
