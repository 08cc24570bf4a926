"""Curves over s of the speeds and accelerations along the path that the motors allow.

At each s the limits |c + d s' + p s'^2 + q s"| <= limit of all motors leave a region of (s', s"), with dry
friction of the motors in c and viscous damping in d. Where two of its edges meet is the highest s' (the
maximum velocity curve of Pfeiffer and Johanni, IEEE J. Robotics and Automation 3, 1987), and the line
s' = const through it is the range of s". At a Type 2 singularity d, p and q have poles along one direction:
whatever the limits, the range closes to the one s" of condition (8).
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
CROSSING_OFFSETS = np.geomspace(1e-5, 0.05, 25)  # of the duration, instants beside a crossing
CORNER_ROUNDING = 1e-9  # of a limit, by which a corner of the region may exceed it


class MotorDemand(NamedTuple):
    """Torques constant + per_speed s' + per_z s'^2 + per_u s" at T places.

    Each is (T, n_a).
    """

    constant: Array
    per_speed: Array
    per_z: Array
    per_u: Array
    motor_speed: Array  # (T, n_a) over s', motor side


class LimitCurves(NamedTuple):
    """A plan's law at T instants, with limits of s' and s".

    No instant is on a crossing. The limits are those of the undeformed robot. `highest_speed` is infinite
    where nothing limits s', and not a number where the motors cannot even hold the robot.
    """

    s: Array  # (T,)
    speed: Array  # (T,) s' of the law [1/s]
    acceleration: Array  # (T,) s" of the law [1/s^2]
    highest_speed: Array  # (T,) [1/s]
    lowest_acceleration: Array  # (T,) [1/s^2] at the law's speed
    highest_acceleration: Array  # (T,) [1/s^2]
    torque_limit: Array  # (n_a,) [N m], motor side


def limit_curves(plan: CrossingPlan) -> LimitCurves:
    """Compute the limit curves of a plan.

    Without limits, they are for its own peak torque.
    """
    torque_limit, speed_limit = _choose_limits(plan)
    times = _choose_instants(plan)
    s, speed, acceleration = (plan.law(times, order) for order in range(3))
    s = np.clip(s, 0.0, 1.0)
    required = _motor_demand(plan, s)
    lowest, highest = _bound_acceleration(required, speed, torque_limit)
    fastest = highest_speed(required, torque_limit, speed_limit)
    return LimitCurves(s, speed, acceleration, fastest, lowest, highest, torque_limit)


def _motor_demand(plan: CrossingPlan, s: Array) -> MotorDemand:
    """Compute torques and speeds of the undeformed robot at s (T,).

    Damping and the planned friction count.
    """
    robot = plan.robot
    branch = track_path(robot, plan.path).with_wrenches(plan.dynamics.wrenches)
    required = demand(branch, Smoothstep(0), s)  # sigma = s
    constant, per_z, per_u = required.torque
    friction = required.friction(motor_friction(robot, plan.request.friction))
    return MotorDemand(constant + friction, required.damping, per_z, per_u, np.abs(required.speed))


def _choose_limits(plan: CrossingPlan) -> tuple[Array, Array]:
    """Return limits (n_a,) of torque [N m] and speed [rad/s].

    Without any, the plan's peak torque is the limit.
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
    """Compute the least and the largest s" (T,) within torque limits.

    The speeds are s' (T,), the limits (n_a,).
    """
    constant, per_speed, per_z, per_u, _ = required
    at_zero = constant + (per_speed + per_z * speed[:, None]) * speed[:, None]  # the torques where s" = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(-limit - at_zero) / per_u, (limit - at_zero) / per_u]), axis=0)
    return np.nanmax(ends[0], axis=1), np.nanmin(ends[1], axis=1)


def highest_speed(required: MotorDemand, torque_limit: Array, speed_limit: Array) -> Array:
    """Compute the largest s' (T,) at which some s" keeps all limits.

    It is a corner of their region. Each sign of each of k torques gives an edge per_speed s' + per_z s'^2 +
    per_u s" <= limit - constant, all over the limit, so m = 2 k.
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
    """Return the largest s' (T,) of all corners that keep the bounds.

    The edges are (T, m, 3); without a corner it is -inf.
    """
    highest = np.full(len(bound), -np.inf)
    for i, j in combinations(range(bound.shape[1]), 2):
        for corner in _intersect_edges(edges[:, (i, j)], bound[:, (i, j)]):
            terms = edges * corner[:, None]  # (T, m, 3)
            values = np.einsum("tmk,tk->tm", edges, corner)  # their sums
            tolerance = CORNER_ROUNDING * (1.0 + np.abs(terms).sum(axis=-1))
            is_inside = np.all(values <= bound + tolerance, axis=1)
            highest = np.where(is_inside & (corner[:, 0] > highest), corner[:, 0], highest)
    return highest


def _intersect_edges(edges: Array, bound: Array) -> list[Array]:
    """Intersect pairs of edges (T, 2, 3) with bounds (T, 2).

    Return both corners (s', s'^2, s") (T, 3). Elimination of s" leaves a s'^2 + b s' = c, solved without
    cancellation. s" is that of the edge with the larger coefficient. Not a number where the edges do not
    meet.
    """
    per_speed, per_z, per_u = np.moveaxis(edges, -1, 0)

    def eliminate_u(coefficient: Array) -> Array:
        return np.asarray(coefficient[:, 0] * per_u[:, 1] - coefficient[:, 1] * per_u[:, 0])

    a = eliminate_u(per_z)
    b = eliminate_u(per_speed)
    c = eliminate_u(bound)
    steeper = np.arange(len(bound)), np.where(np.abs(per_u[:, 0]) > np.abs(per_u[:, 1]), 0, 1)
    corners = []
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(b**2 + 4.0 * a * c), b))  # the roots are q / a and -c / q
        for root in (q / a, -c / q):
            speed = np.where(np.isfinite(root), root, np.nan)
            remaining = bound[steeper] - (per_speed[steeper] + per_z[steeper] * speed) * speed
            corners.append(np.stack([speed, speed**2, remaining / per_u[steeper]], axis=1))
    return corners
