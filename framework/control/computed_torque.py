"""Computed torque: the inverse dynamics of what is measured, naive or aware of the singularity.

Both ask for the platform acceleration ddx_c = ddx + k_d (dx error) + k_p (x error) and compute torques from
P' lambda = r_p, tau = r_a - J_a' lambda (see `framework.dynamics.forces`). At a Type 2 singularity P loses
rank. The naive law divides by it: condition (8) holds for the plan, and not for the feedback added to it.
The aware law takes the multipliers of the plan, finite through the crossing, and solves for their
correction only in the directions that P still has; where P is regular both are the same. After Pagis,
Bouton, Briot and Martinet, Enlarging parallel robot workspace through Type-2 singularity crossing,
Control Engineering Practice 39, 2015, who switch to a model that stays consistent near the singularity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.control.estimation import Measurement, RobotState, consistent_solution, estimated_state
from framework.control.reference import Reference
from framework.dynamics.forces import tree_forces
from framework.errors import InvalidInput
from framework.kinematics.closures import closure_drift, loop_equations, scale_jacobian
from framework.kinematics.external_wrenches import AppliedWrench
from framework.kinematics.frames import frame_motions, frames_at
from framework.kinematics.loop_matrices import scaled_loops
from framework.linalg.ordered_sums import matvec, solve


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """Computed torque in platform coordinates; `multipliers` (K, m) of the plan, None for the naive law."""

    reference: Reference
    frequency: float  # [rad/s] of the error dynamics
    damping: float
    multipliers: Array | None

    @staticmethod
    def tune(
        reference: Reference, *, aware: bool, frequency: float = 20.0, damping: float = 1.0
    ) -> ComputedTorque:
        """Return the law with error dynamics of one natural `frequency` [rad/s].

        Raises:
            InvalidInput: the robot has springs, or redundant motors.
        """
        robot = reference.robot
        if robot.n_e or robot.n_a != robot.n:
            raise InvalidInput(
                f"controller computed_torque: for rigid robots with as many motors as platform axes; "
                f"{robot.name} has {robot.n_e} springs, {robot.n_a} motors, {robot.n} axes: use feedforward"
            )
        multipliers = _planned_multipliers(reference) if aware else None
        return ComputedTorque(reference, frequency, damping, multipliers)

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m]; infinite where the naive law divides by zero."""
        ref, robot = self.reference, self.reference.robot
        state = estimated_state(ref, k, measurement, aware=self.multipliers is not None)
        command = (
            ref.ddx[k]
            + 2 * self.damping * self.frequency * (ref.dx[k] - state.dx)
            + self.frequency**2 * (ref.x[k] - state.x)
        )
        motion = _constrained_motion(ref, k, state, command)
        columns = robot.following
        J = scale_jacobian(robot, motion.loops, robot.loops.rotation)  # (R, m, nv) dimensionless
        r = tree_forces(robot, motion) * robot.column_scale
        P = J[:, :, columns].transpose(0, 2, 1)
        if self.multipliers is None:
            multipliers = solve(P, r[:, columns])
        else:
            planned = self.multipliers[k]
            multipliers = planned + consistent_solution(P, r[:, columns] - matvec(P, planned))
        torque = ((r - matvec(J.transpose(0, 2, 1), multipliers)) / robot.column_scale)[:, robot.actuated]
        n = robot.gear_ratio
        return robot.rotor_inertia * n * motion.a[:, robot.actuated] + torque / n


class _Motion(NamedTuple):
    """The motions of R runs, with the Jacobian of their loop equations."""

    q: Array  # (R, nq)
    v: Array  # (R, nv)
    a: Array  # (R, nv)
    loops: Array  # (R, m, nv)
    wrenches: tuple[AppliedWrench, ...]


def _constrained_motion(reference: Reference, k: int, state: RobotState, ddx: Array) -> _Motion:
    """Compute joint velocities and accelerations for platform rates of the states and ddx (R, n).

    Under the wrenches of the plan at instant k.

    As `motion_at`, but run by run where that factors all instants as one band matrix: there the length of
    the stack rounds differently. Infinite where the platform does not determine the joints.
    """
    robot = reference.robot
    frames, columns = frames_at(robot, state.q), robot.moving
    rows = robot.loops
    loops = loop_equations(rows, frames).jacobian
    whole = np.concatenate([robot.platform.jacobian(frames), loops], axis=1)[:, :, columns]
    twist, dtwist = robot.platform.twist(state.x, state.dx, ddx)
    v, a = np.zeros((2, len(state.q), robot.model.nv))
    v[:, columns] = solve(whole, np.concatenate([twist, np.zeros((len(twist), len(rows.names)))], axis=1))
    motions = frame_motions(robot, frames, state.q, v)
    platform_drift = robot.platform.drift(frames, motions)
    drift = np.concatenate([dtwist - platform_drift, -closure_drift(rows, frames, motions)], axis=1)
    a[:, columns] = solve(whole, drift)
    s = np.asarray(reference.law(np.repeat(reference.times[k], len(state.q))))
    return _Motion(state.q, v, a, loops, reference.wrenches.evaluate(robot, frames, s))


def _planned_multipliers(reference: Reference) -> Array:
    """Compute the multipliers (K, m) of the scaled loop rows along the plan, finite at the crossing too.

    There P alone cannot tell them; all rows of J' lambda = r - S tau can, once tau is known.
    """
    robot, motion = reference.robot, reference.motion
    r = tree_forces(robot, motion)
    n = robot.gear_ratio
    r[:, robot.actuated] -= n * (reference.torque - robot.rotor_inertia * n * motion.a[:, robot.actuated])
    J = scaled_loops(robot, motion.linearised)
    transposed = np.linalg.pinv(J.transpose(0, 2, 1))  # (K, m, nv)
    return np.matvec(transposed, r * robot.column_scale)
