"""Speeds and accelerations along a path that the motors allow, as curves over s.

At each s, the limits |c + d s' + p s'^2 + q s"| <= limit of all motors leave a region of (s', s"), with dry
friction in c and viscous damping in d. The highest s' is at a corner of this region, where two edges meet
(the maximum velocity curve of Pfeiffer and Johanni, IEEE J. Robotics and Automation 3, 1987). The range of s"
at the speed of the law is the intersection of the region with a line s' = const. At a Type 2 singularity d, p
and q have poles along one direction: whatever the limits, the range closes to the single s" of condition (8).
"""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from framework.dynamics.motor_friction import motor_friction
from framework.dynamics.torque_distribution import internal_frames
from framework.kinematics.continuation.tracking import track_path
from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array
from framework.planning.optimal.phase_plane import AffineInSpeed, Demand, demand
from framework.planning.result import CrossingPlan

LAW_SAMPLES = 241  # instants of the law, besides those at a crossing
CROSSING_OFFSETS = np.geomspace(1e-5, 0.05, 25)  # of instants beside a crossing, over the duration
MAX_COMBINATIONS = 100  # of torques that redundant motors share, whose limits are compared pair by pair
CORNER_ROUNDING = 1e-9  # share of a limit by which a corner of the region may exceed it


class LimitCurves(NamedTuple):
    """A plan's law at T instants beside the crossings, with limits of s' and s".

    No instant is on a crossing. The limits are those of the undeformed robot. `highest_speed` is infinite
    where nothing limits s', and NaN where the motors cannot even hold the robot.
    """

    s: Array  # (T,) path coordinate of the law
    speed: Array  # (T,) s' of the law [1/s]
    acceleration: Array  # (T,) s" of the law [1/s^2]
    highest_speed: Array  # (T,) [1/s]
    lowest_acceleration: Array  # (T,) [1/s^2] at the law's speed
    highest_acceleration: Array  # (T,) [1/s^2]
    torque_limit: Array  # (n_a,) [N m], motor side

    @property
    def known(self) -> bool:
        """Whether torques limit s" anywhere; unknown where many redundant motors share the load."""
        return bool(np.isfinite(self.highest_acceleration).any())


def limit_curves(plan: CrossingPlan) -> LimitCurves:
    """Compute the limits of s' and s" along a plan; without torque limits, its peak torque is the limit."""
    robot = plan.robot
    # ascending instants (T,) [s], dense at the ends and beside crossings, and never on a crossing
    offsets = plan.duration * CROSSING_OFFSETS
    times = 0.5 * plan.duration * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, LAW_SAMPLES)))
    for crossing in plan.crossings:
        times = times[np.abs(times - crossing.time) > offsets[0]]
        times = np.concatenate([times, crossing.time - offsets, crossing.time + offsets])
    times = np.unique(times[(times >= 0) & (times <= plan.duration)])
    s, speed, acceleration = (plan.law(times, order) for order in range(3))
    s = np.clip(s, 0.0, 1.0)
    # demand on the undeformed robot's motors at s (T,), with dry friction
    branch = track_path(robot, plan.path).with_wrenches(plan.dynamics.wrenches)
    required = demand(branch, Smoothstep(0), s)  # Smoothstep(0) is the identity: sigma = s
    friction = required.friction(motor_friction(robot, plan.request.friction))
    torque = required.torque._replace(constant=required.torque.constant + friction)
    required = required._replace(torque=torque)

    torque_limit = np.full(robot.n_a, max(plan.peak_torque.values()))
    speed_limit = np.full(robot.n_a, np.inf)
    shares_freely = False
    if plan.optimality is not None:
        specification = plan.optimality.specification
        torque_limit = specification.torque_limit if specification.limited else torque_limit
        speed_limit = specification.speed_limit
        shares_freely = specification.shares_freely
    limits = torque_limit
    if shares_freely:
        required, limits = _combine_torques(required, torque_limit, robot.n_a - robot.n)
    lowest, highest = _bound_acceleration(required, speed, limits)
    fastest = highest_speed(required, limits, speed_limit)
    return LimitCurves(s, speed, acceleration, fastest, lowest, highest, torque_limit)


def _combine_torques(required: Demand, limit: Array, r: int) -> tuple[Demand, Array]:
    """Combine torques that redundant motors share freely; return S combinations and their limits (S,).

    In units of the limits, torques t have a distribution within [-1, 1] if |nu . t| <= |nu|_1 for all nu that
    are orthogonal to the r internal torques. Those of r + 1 motors, the others zero, suffice. The limits are
    infinite if there are more than MAX_COMBINATIONS of them.

    Args:
        required: torques of the motors.
        limit: torque limits (n_a,).
        r: number of redundant motors.
    """
    limited = np.flatnonzero(np.isfinite(limit))
    if comb(len(limited), r + 1) > MAX_COMBINATIONS:
        return required, np.full(len(limit), np.inf)
    assert required.internal is not None
    internal = internal_frames(required.internal, r) / limit[:, None]  # (T, n_a, r)
    subsets = np.array(list(combinations(limited, r + 1)), dtype=int).reshape(-1, r + 1)
    # the last left singular vector of r + 1 rows is orthogonal to their r columns
    nu = np.linalg.svd(internal[:, subsets])[0][..., -1]  # (T, S, r + 1)
    weights = np.zeros((len(internal), *subsets.shape[:1], len(limit)))
    np.put_along_axis(weights, np.broadcast_to(subsets, nu.shape), nu / limit[subsets], axis=2)
    weights /= np.abs(nu).sum(axis=2, keepdims=True)
    torque = AffineInSpeed(*(np.matvec(weights, part) for part in required.torque))
    damping = np.matvec(weights, required.damping)
    return required._replace(torque=torque, damping=damping), np.ones(len(subsets))


def _bound_acceleration(required: Demand, speed: Array, limit: Array) -> tuple[Array, Array]:
    """Compute the least and the largest s" (T,) [1/s^2] within torque limits.

    Args:
        required: torques of the motors with sigma = s.
        speed: s' (T,) [1/s] of the law.
        limit: torque limits (n_a,) [N m].
    """
    constant, per_z, per_u = required.torque
    ds = speed[:, None]
    steady_torque = constant + (required.damping + per_z * ds) * ds  # (T, n_a) at s" = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        # s" (T, n_a) at which each motor is at a limit; 0 / 0 of a motor that s" does not load is left out
        at_limits = [(-limit - steady_torque) / per_u, (limit - steady_torque) / per_u]
        lowest, highest = np.sort(at_limits, axis=0)
    return np.nanmax(lowest, axis=1), np.nanmin(highest, axis=1)


def highest_speed(required: Demand, torque_limit: Array, speed_limit: Array) -> Array:
    """Compute the largest s' (T,) [1/s] at which some s" keeps all limits: a corner of their region.

    Each sign of each of the k limited torques gives an edge

        (per_speed s' + per_z s'^2 + per_u s") / limit <= 1 - constant / limit,        m = 2 k edges.

    Args:
        required: torques and speeds of the motors with sigma = s, so that z = s'^2 and u = s".
        torque_limit, speed_limit: limits (n_a,) [N m, rad/s], infinite for unlimited motors.

    Returns:
        Infinite where nothing limits s'; NaN where the motors cannot even hold the robot.
    """
    constant, per_z, per_u = required.torque
    is_limited = np.isfinite(torque_limit)
    by_torque = np.full(len(constant), np.inf)
    if is_limited.any():
        terms = np.stack([required.damping, per_z, per_u, constant], axis=2)[:, is_limited]
        shares = terms / torque_limit[is_limited, None]
        edges = np.concatenate([shares, -shares], axis=1)  # (T, m, 4)
        edges[..., 3] = 1.0 - edges[..., 3]  # the bound, from the share of the constant torque
        by_torque = _highest_corner(edges)
    with np.errstate(divide="ignore"):
        by_speed = (speed_limit / np.abs(required.speed)).min(axis=1)
    # without a corner at s' >= 0 no s" holds the robot
    return np.minimum(np.where(by_torque < 0, np.nan, by_torque), by_speed)


def _highest_corner(edges: Array) -> Array:
    """Find the largest s' (T,) of all corners that keep the bounds; -inf without a corner.

    Args:
        edges: (T, m, 4) coefficients of s', s'^2 and s", and the bound of their sum.
    """
    coefficients = edges[..., :3].swapaxes(1, 2)  # (T, 3, m)
    bound = edges[:, None, :, 3]  # (T, 1, m)
    first, second = np.triu_indices(edges.shape[1], 1)  # (pairs,) indices of all pairs of edges
    corners = _intersect_edges(edges[:, first], edges[:, second])  # (2, T, pairs, 3)
    with np.errstate(invalid="ignore"):
        values = corners @ coefficients  # (2, T, pairs, m)
        sizes = np.abs(corners) @ np.abs(coefficients)  # of the terms
    is_inside = np.all(values <= bound + CORNER_ROUNDING * (1.0 + sizes), axis=3)  # not for NaN
    return np.where(is_inside, corners[..., 0], -np.inf).max(axis=(0, 2))


def _intersect_edges(first: Array, second: Array) -> Array:
    """Intersect edges `first` with edges `second`, (T, pairs, 4) each.

    Elimination of s" leaves a s'^2 + b s' = c, which is solved without cancellation. s" then follows from the
    edge with the larger coefficient of s".

    Args:
        first, second: coefficients of s', s'^2 and s", and the value of their sum on the edge.

    Returns:
        Both corners (s', s'^2, s") of each pair, (2, T, pairs, 3); NaN if the edges do not meet.
    """
    per_u_first, per_u_second = first[..., 2:3], second[..., 2:3]
    b, a, _, c = np.moveaxis(first * per_u_second - second * per_u_first, 2, 0)  # s" is eliminated
    steeper = np.where(np.abs(per_u_first) > np.abs(per_u_second), first, second)
    per_speed, per_z, per_u, bound = np.moveaxis(steeper, 2, 0)  # (T, pairs) each
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(b**2 + 4.0 * a * c), b))  # both terms have one sign
        roots = np.stack([q / a, -c / q])  # whose product is -c / a
        speed = np.where(np.isfinite(roots), roots, np.nan)
        acceleration = (bound - (per_speed + per_z * speed) * speed) / per_u
    return np.stack([speed, speed**2, acceleration], axis=3)
