"""Speeds and accelerations along a path that the motors allow, as curves over s.

At each s, the limits |c + d s' + p s'^2 + q s"| <= limit of all motors leave a region of (s', s"), with dry
friction in c and viscous damping in d. The highest s' is at a corner of this region, where two edges meet
(the maximum velocity curve of Pfeiffer and Johanni, IEEE J. Robotics and Automation 3, 1987). The range of s"
at the speed of the law is the intersection of the region with a line s' = const. At a Type 2 singularity d, p
and q have poles along one direction: whatever the limits, the range closes to the single s" of condition (8).
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from framework.dynamics.motor_friction import motor_friction
from framework.kinematics.continuation.tracking import track_path
from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array
from framework.planning.optimal.phase_plane import demand
from framework.planning.result import CrossingPlan

SPEED_SAMPLES = 241
CROSSING_OFFSETS = np.geomspace(1e-5, 0.05, 25)  # of instants beside a crossing, over the duration
CORNER_ROUNDING = 1e-9  # share of a limit by which a corner of the region may exceed it


class MotorDemand(NamedTuple):
    """Torques constant + per_speed s' + per_z s'^2 + per_u s" at T values of s; all (T, n_a)."""

    constant: Array
    per_speed: Array
    per_z: Array
    per_u: Array
    motor_speed: Array  # speed over s', motor side


class LimitCurves(NamedTuple):
    """A plan's law at T instants beside the crossings, with limits of s' and s".

    No instant is on a crossing. The limits are those of the undeformed robot. `highest_speed` is infinite
    where nothing limits s', and NaN where the motors cannot even hold the robot.
    """

    s: Array  # (T,)
    speed: Array  # (T,) s' of the law [1/s]
    acceleration: Array  # (T,) s" of the law [1/s^2]
    highest_speed: Array  # (T,) [1/s]
    lowest_acceleration: Array  # (T,) [1/s^2] at the law's speed
    highest_acceleration: Array  # (T,) [1/s^2]
    torque_limit: Array  # (n_a,) [N m], motor side


def limit_curves(plan: CrossingPlan) -> LimitCurves:
    """Compute the limit curves of a plan; its peak torque replaces absent limits."""
    torque_limit, speed_limit = _choose_limits(plan)
    times = _choose_instants(plan)
    s, speed, acceleration = (plan.law(times, order) for order in range(3))
    s = np.clip(s, 0.0, 1.0)
    required = _motor_demand(plan, s)
    lowest, highest = _bound_acceleration(required, speed, torque_limit)
    fastest = highest_speed(required, torque_limit, speed_limit)
    return LimitCurves(s, speed, acceleration, fastest, lowest, highest, torque_limit)


def _motor_demand(plan: CrossingPlan, s: Array) -> MotorDemand:
    """Compute torques and speeds of the undeformed robot's motors at s (T,), friction included."""
    robot = plan.robot
    branch = track_path(robot, plan.path).with_wrenches(plan.dynamics.wrenches)
    required = demand(branch, Smoothstep(0), s)  # sigma = s
    constant, per_z, per_u = required.torque
    friction = required.friction(motor_friction(robot, plan.request.friction))
    return MotorDemand(constant + friction, required.damping, per_z, per_u, np.abs(required.speed))


def _choose_limits(plan: CrossingPlan) -> tuple[Array, Array]:
    """Return limits (n_a,) of torque [N m] and speed [rad/s].

    Without any torque limit, the plan's peak torque is the limit of all motors.
    """
    unlimited = np.full(plan.robot.n_a, max(plan.peak_torque.values()))
    if plan.optimality is None:
        return unlimited, np.full(plan.robot.n_a, np.inf)
    specification = plan.optimality.specification
    return (specification.torque_limit if specification.limited else unlimited), specification.speed_limit


def _choose_instants(plan: CrossingPlan) -> Array:
    """Return instants (T,) [s], dense beside crossings and never on one."""
    times = 0.5 * plan.duration * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, SPEED_SAMPLES)))
    for crossing in plan.crossings:
        times = times[np.abs(times - crossing.time) > CROSSING_OFFSETS[0] * plan.duration]
        beside = crossing.time + plan.duration * np.concatenate([-CROSSING_OFFSETS, CROSSING_OFFSETS])
        times = np.concatenate([times, beside[(beside > 0) & (beside < plan.duration)]])
    return np.unique(times)


def _bound_acceleration(required: MotorDemand, speed: Array, limit: Array) -> tuple[Array, Array]:
    """Compute the least and the largest s" (T,) at speeds s' (T,) within torque limits (n_a,)."""
    constant, per_speed, per_z, per_u, _ = required
    at_zero = constant + (per_speed + per_z * speed[:, None]) * speed[:, None]  # torques with s" = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        # both ends (T, n_a) of the range of s" of each motor
        lowest, highest = np.sort([(-limit - at_zero) / per_u, (limit - at_zero) / per_u], axis=0)
    return np.nanmax(lowest, axis=1), np.nanmin(highest, axis=1)


def highest_speed(required: MotorDemand, torque_limit: Array, speed_limit: Array) -> Array:
    """Compute the largest s' (T,) at which some s" keeps all limits: a corner of their region.

    Each sign of each of the k limited torques gives an edge per_speed s' + per_z s'^2 + per_u s" <= limit -
    constant, divided by the limit: m = 2 k edges.
    """
    constant, per_speed, per_z, per_u, motor_speed = required
    is_limited = np.isfinite(torque_limit)
    limit = torque_limit[is_limited]
    edges = np.stack([per_speed, per_z, per_u], axis=-1)[:, is_limited] / limit[:, None]
    share = constant[:, is_limited] / limit
    edges = np.concatenate([edges, -edges], axis=1)  # (T, m, 3)
    bound = np.concatenate([1.0 - share, 1.0 + share], axis=1)  # (T, m)
    by_torque = _highest_corner(edges, bound) if is_limited.any() else np.full(len(constant), np.inf)
    with np.errstate(divide="ignore"):
        by_speed = (speed_limit / motor_speed).min(axis=1)
    return np.minimum(np.where(by_torque < 0, np.nan, by_torque), by_speed)


def _highest_corner(edges: Array, bound: Array) -> Array:
    """Find the largest s' (T,) of all corners that keep the bounds; -inf without a corner.

    Args:
        edges: (T, m, 3) coefficients of s', s'^2 and s".
        bound: (T, m) of their sums.
    """
    highest = np.full(len(bound), -np.inf)
    for i, j in combinations(range(bound.shape[1]), 2):
        for corner in _intersect_edges(edges[:, (i, j)], bound[:, (i, j)]):
            speed = corner[:, 0]
            sizes = np.abs(edges * corner[:, None]).sum(axis=-1)  # (T, m) of the terms
            values = np.einsum("tmk,tk->tm", edges, corner)
            is_inside = np.all(values <= bound + CORNER_ROUNDING * (1.0 + sizes), axis=1)
            highest = np.where(is_inside & (speed > highest), speed, highest)
    return highest


def _intersect_edges(edges: Array, bound: Array) -> list[Array]:
    """Intersect pairs of edges (T, 2, 3) with bounds (T, 2); return both corners (s', s'^2, s") (T, 3).

    Elimination of s" leaves a s'^2 + b s' = c, which is solved without cancellation. s" then follows from the
    edge with the larger coefficient of s". Corners are NaN if the edges do not meet.
    """
    per_u = edges[:, :, 2]
    coefficients = np.dstack([edges[:, :, :2], bound])  # (T, 2, 3) of s', s'^2 and the bound
    b, a, c = (coefficients[:, 0] * per_u[:, 1, None] - coefficients[:, 1] * per_u[:, 0, None]).T
    steeper = np.arange(len(bound)), np.where(np.abs(per_u[:, 0]) > np.abs(per_u[:, 1]), 0, 1)
    per_speed, per_z, _ = edges[steeper].T
    corners = []
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(b**2 + 4.0 * a * c), b))  # the roots are q / a and -c / q
        for root in (q / a, -c / q):
            speed = np.where(np.isfinite(root), root, np.nan)
            remaining = bound[steeper] - (per_speed + per_z * speed) * speed
            corners.append(np.stack([speed, speed**2, remaining / per_u[steeper]], axis=1))
    return corners
