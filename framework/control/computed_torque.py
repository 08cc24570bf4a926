"""Computed torque: the inverse dynamics of the measured state, naive or aware of the singularity.

Both controllers ask for the platform acceleration ddx_c = ddx + k_d (dx error) + k_p (x error) and compute
torques from P' lambda = r_p, tau = r_a - J_a' lambda (see `framework.dynamics.forces`). At a Type 2
singularity P loses rank. The naive controller inverts P nevertheless: condition (8) holds for the plan, but
not for the feedback added to it. The aware controller starts from the multipliers of the plan, which are
finite at the crossing, and corrects them only in directions in which P is regular. Elsewhere both are equal.
After Pagis, Bouton, Briot and Martinet, Enlarging parallel robot workspace through Type-2 singularity
crossing, Control Engineering Practice 39, 2015, who switch to a model that stays consistent near the
singularity.
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
    """Computed torque in platform coordinates.

    `multipliers` (K, m) of the plan make the controller aware of the singularity; None: the naive one.
    """

    reference: Reference
    frequency: float  # [rad/s] of the error dynamics
    damping: float
    multipliers: Array | None

    @staticmethod
    def tune(
        reference: Reference, *, aware: bool, frequency: float = 20.0, damping: float = 1.0
    ) -> ComputedTorque:
        """Return the controller whose error dynamics have a natural `frequency` [rad/s] and damping ratio.

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
        """Compute motor torques (R, n_a) [N m]; infinite where the naive controller divides by zero."""
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
    """Compute joint rates and accelerations for the platform's rates of the states and ddx (R, n).

    With F = [X; J] of platform and loops, F v = [twist; 0] and F a = [twist rate; 0] - drift. Wrenches are
    those of the plan at instant k.

    `motion_at` factors all instants as one band matrix, so its rounding depends on the number of runs. Here
    each run is solved on its own. Infinite where the platform does not determine the joints.
    """
    robot = reference.robot
    frames, columns = frames_at(robot, state.q), robot.moving
    rows = robot.loops
    loops = loop_equations(rows, frames).jacobian
    F = np.concatenate([robot.platform.jacobian(frames), loops], axis=1)[:, :, columns]
    twist, twist_rate = robot.platform.twist(state.x, state.dx, ddx)
    v, a = np.zeros((2, len(state.q), robot.model.nv))
    v[:, columns] = solve(F, np.concatenate([twist, np.zeros((len(twist), len(rows.names)))], axis=1))
    motions = frame_motions(robot, frames, state.q, v)
    platform_part = twist_rate - robot.platform.drift(frames, motions)
    loop_part = -closure_drift(rows, frames, motions)
    a[:, columns] = solve(F, np.concatenate([platform_part, loop_part], axis=1))
    s = np.asarray(reference.law(np.repeat(reference.times[k], len(state.q))))
    return _Motion(state.q, v, a, loops, reference.wrenches.evaluate(robot, frames, s))


def _planned_multipliers(reference: Reference) -> Array:
    """Compute the multipliers lambda (K, m) of the scaled loop rows along the plan.

    At the crossing the passive rows P' lambda = r_p do not determine lambda. All rows J' lambda = r - S' tau
    do, with the torque tau of the plan.
    """
    robot, motion = reference.robot, reference.motion
    r = tree_forces(robot, motion)
    n = robot.gear_ratio
    r[:, robot.actuated] -= n * (reference.torque - robot.rotor_inertia * n * motion.a[:, robot.actuated])
    J = scaled_loops(robot, motion.linearised)
    inverse = np.linalg.pinv(J.transpose(0, 2, 1))  # (K, m, nv)
    return np.matvec(inverse, r * robot.column_scale)
