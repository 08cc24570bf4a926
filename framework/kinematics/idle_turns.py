"""The motion of idle turns, which neither the platform nor the loops determine.

A rod between two balls may turn about its own axis without moving a centre of mass. The turn rests if nothing
acts on it. Damping in the balls drives it; without damping, armature in the balls does. With G the diagonal
matrix of damping or armature, Z(q) the motion of the turn alone, and joint rates v and accelerations a,

    Z' G v = 0        no damping torque along the turn, or no angular momentum of the armature
    Z' G a = -dZ/dt' G v

So the rates of the turn remain a function of the pose, linear in the rates of the platform, which motion laws
need. Only balls with equal values about all three axes count, because their effect does not depend on the
angle of the turn. `dynamics.motion_checks` measures the torque that remains: of armature beside damping,
and of the rod's own inertia.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at_reference
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import ball_columns
from framework.numerics.arrays import Array, IntArray, read_only


@dataclass(frozen=True, eq=False)
class IdleTurns:
    """The k idle turns at T instants."""

    motions: Array  # Z (T, nv, k): the motion of each turn alone
    rows: Array  # Z' G (T, k, nv); for a resting turn the unit row of its joint
    weights: Array  # G (k, nv) of each turn; zero for a resting turn

    def add_turns(self, rates: Array, right: Array | float = 0.0) -> Array:
        """Add turns Z y to rates (..., T, nv), with Z' G (rates + Z y) = right (T, k)."""
        residual = right - np.matvec(self.rows, rates)  # (..., T, k)
        y = np.linalg.solve(self.rows @ self.motions, residual[..., None])[..., 0]
        return rates + np.matvec(self.motions, y)

    def rows_rate(self, robot: ParallelRobot, linearised: LinearisedLoops, jacobian_rate: Array) -> Array:
        """Compute the time derivative (T, k, nv) of `rows` from that of dF/dq (T, n + m, nv)."""
        rates = _closing_motions(robot, linearised, jacobian_rate @ self.motions)
        return rates.swapaxes(1, 2) * self.weights


def idle_turns(robot: ParallelRobot, linearised: LinearisedLoops) -> IdleTurns | None:
    """Return the idle turns at T instants; None if all idle joints rest."""
    weights = _driving_weights(robot)
    if not weights.any():
        return None
    motions = turn_motions(robot, linearised)
    rows = motions.swapaxes(1, 2) * weights
    for k in np.flatnonzero(~weights.any(axis=1)):
        rows[:, k, robot.structure.idle[k]] = 1.0  # the turn rests
    return IdleTurns(motions, rows, weights)


def driven_turns(robot: ParallelRobot) -> IntArray:
    """Return the idle columns whose turns damping or armature of balls drives."""
    return robot.structure.idle[_driving_weights(robot).any(axis=1)]


@lru_cache(maxsize=16)
def _driving_weights(robot: ParallelRobot) -> Array:
    """Return the diagonal of G for each idle turn, (k, nv).

    It holds the damping of all balls if the turn moves a damped ball. Otherwise it holds their armature if
    the turn moves a ball with armature, and zeros if not. The turn's motion is that at the reference.
    """
    weights = np.zeros((len(robot.structure.idle), robot.nv))
    damping = _isotropic_ball_values(robot, robot.joint_damping)
    armature = _isotropic_ball_values(robot, robot.model.armature)
    if len(weights) and (damping.any() or armature.any()):
        motions = turn_motions(robot, linearised_at_reference(robot))[0]  # (nv, k)
        for k, motion in enumerate(motions.T):
            if np.any(damping * motion):  # the turn moves a damped ball
                weights[k] = damping
            elif np.any(armature * motion):
                weights[k] = armature
    return read_only(weights)


def _isotropic_ball_values(robot: ParallelRobot, values: Array) -> Array:
    """Return values (nv,) on balls that have the same value about all axes, zero elsewhere."""
    isotropic = np.zeros(robot.nv)
    for ball in ball_columns(robot.model):
        if np.ptp(values[ball]) == 0.0:
            isotropic[ball] = values[ball]
    return isotropic


def turn_motions(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute Z (T, nv, k): all joint rates at unit rate of one idle joint, the others at rest."""
    idle = robot.structure.idle
    motions = _closing_motions(robot, linearised, linearised.jacobian[:, :, idle])
    motions[:, idle] = np.eye(len(idle))
    return motions


def _closing_motions(robot: ParallelRobot, linearised: LinearisedLoops, gaps: Array) -> Array:
    """Compute motions (T, nv, k) of the moving joints that cancel changes `gaps` (T, n + m, k) of F."""
    closing = -linearised.factors.solve(np.moveaxis(gaps, 2, 0))  # (k, T, moving)
    motions = np.zeros((len(gaps), robot.nv, len(closing)))
    motions[:, robot.moving] = np.moveaxis(closing, 0, 2)
    return motions
