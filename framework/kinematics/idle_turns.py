"""The motion of idle turns, which neither the platform nor the loops determine.

A rod between two balls may turn about its own line and moves no centre of mass by that. Where nothing acts on
such a turn it is held still. Where balls have damping (or armature, which counts where no damping does), it
goes as these drive it: with G their values on the diagonal and Z(q) the motion of the turn alone,

    Z' G v = 0        no torque of the damping along the turn; no angular momentum of the armature
    Z' G a = -dZ/dt' G v

so that the rates remain a function of the pose, linear in those of the platform, as the laws need it. Only
balls count whose three values are alike: nothing there depends on the angle of the turn. What the other of
the two and the rod's own inertia leave to be held, `dynamics.residuals` measures on the planned motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from framework.arrays import Array, IntArray, read_only
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at_reference
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import is_ball


@dataclass(frozen=True, eq=False)
class IdleTurns:
    """The k idle turns at T instants."""

    ways: Array  # Z (T, nv, k): the motion of each turn alone
    rows: Array  # (T, k, nv): a motion v is free along the turns where rows v = 0
    weights: Array  # G (k, nv) of each turn; zero where it is held still

    def add_turns(self, rates: Array, right: Array | float = 0.0) -> Array:
        """Return rates (..., T, nv) with the turns added for which rows rates = right (T, k)."""
        missing = right - np.einsum("tkv,...tv->...tk", self.rows, rates)
        turns = np.linalg.solve(self.rows @ self.ways, missing[..., None])[..., 0]
        return rates + np.einsum("tvk,...tk->...tv", self.ways, turns)

    def rows_rate(self, robot: ParallelRobot, linearised: LinearisedLoops, jacobian_rate: Array) -> Array:
        """Compute the time derivative (T, k, nv) of the rows for that of dF/dq (T, n + m, nv)."""
        rates = _following(robot, linearised, jacobian_rate @ self.ways)
        return rates.transpose(0, 2, 1) * self.weights


def idle_turns(robot: ParallelRobot, linearised: LinearisedLoops) -> IdleTurns | None:
    """Return the idle turns where balls drive some of them; None where all are held still."""
    weights = _weights(robot)
    if not weights.any():
        return None
    ways = turn_motions(robot, linearised)
    rows = ways.transpose(0, 2, 1) * weights
    for k in np.flatnonzero(~weights.any(axis=1)):
        rows[:, k, robot.structure.idle[k]] = 1.0
    return IdleTurns(ways, rows, weights)


def driven_turns(robot: ParallelRobot) -> IntArray:
    """Return those of the robot's idle columns whose turns balls drive; the others are held still."""
    return robot.structure.idle[_weights(robot).any(axis=1)]


@lru_cache(maxsize=16)
def _weights(robot: ParallelRobot) -> Array:
    """Choose what drives each idle turn (k, nv): damping of balls, else armature, else nothing."""
    weights = np.zeros((len(robot.structure.idle), robot.model.nv))
    drives = [_alike_on_balls(robot, values) for values in (robot.joint_damping, robot.model.armature)]
    if len(weights) and any(values.any() for values in drives):
        ways = turn_motions(robot, linearised_at_reference(robot))[0]
        for k, direction in enumerate(ways.T):
            felt = [values for values in drives if np.abs(values * direction).max() > 0.0]
            weights[k] = felt[0] if felt else 0.0
    return read_only(weights)


def _alike_on_balls(robot: ParallelRobot, values: Array) -> Array:
    """Return values (nv,) of coordinates, but zero outside balls that have the same about all axes."""
    alike = np.zeros(robot.model.nv)
    for joint in robot.model.joints[1:]:
        columns = slice(joint.idx_v, joint.idx_v + joint.nv)
        if is_ball(joint) and np.ptp(values[columns]) == 0.0:
            alike[columns] = values[columns]
    return alike


def turn_motions(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute Z (T, nv, k): motions of the joints that turn one idle joint alone."""
    idle = robot.structure.idle
    ways = _following(robot, linearised, linearised.jacobian[:, :, idle])
    ways[:, idle] = np.eye(len(idle))
    return ways


def _following(robot: ParallelRobot, linearised: LinearisedLoops, left: Array) -> Array:
    """Compute the motions (T, nv, k) of the joints that follow which undo what is left (T, n + m, k)."""
    motions = np.zeros((len(left), robot.model.nv, left.shape[2]))
    motions[:, robot.moving] = -linearised.factors.solve(left.transpose(2, 0, 1)).transpose(1, 2, 0)
    return motions
