"""How the motion of all joints changes with that of the platform and the deflections: exact derivatives.

With v and a from (dF/dq) v = [twist; 0] and its time derivative, a small step of the platform moves the
joints by dq, and

    (dF/dq) dv = [d twist; 0] - d((dF/dq) v)/dq dq,        (dF/dq) da = [d twist rate; 0] - ...,

with the derivatives of `frame_variations` at fixed v and a. Regular at Type 2, like the motion itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.closures import closure_drift, closure_rates
from framework.kinematics.frame_variations import complex_step_derivative, step_frames, vary_motions
from framework.kinematics.frames import full_motion
from framework.kinematics.idle_turns import driven_turns
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import Motion, moving_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import CoordinateRates
from framework.kinematics.tree_model import ball_columns
from framework.numerics.arrays import Array, IntArray
from framework.numerics.ordered_sums import cross


class MotionSteps(NamedTuple):
    """k small steps at T instants, each a displacement with changes of rates and accelerations."""

    twist: CoordinateRates  # of the platform, (T, k, n) each: along v, of v, of dv/dt
    columns: IntArray  # (c,) of the joints that step by themselves: deflections, idle joints
    joints: CoordinateRates  # of these joints, (T, k, c) each


class MotionChanges(NamedTuple):
    """Changes of the joints' positions, rates and accelerations by steps, each (T, k, nv)."""

    q: Array
    v: Array
    a: Array


def position_steps(robot: ParallelRobot, x: CoordinateRates, columns: IntArray) -> MotionSteps:
    """Return unit steps of k = n + c coordinates at T instants.

    Rates and accelerations stay. Coordinates are those of a platform at x, dx, ddx (T, n), then c `columns`
    of deflections or idle joints.
    """
    count, n = x[0].shape
    size = n + len(columns)  # k
    units = np.repeat(np.eye(size)[None], count, axis=0)  # (T, k, k)
    position, rate, acceleration = (np.repeat(part, size, axis=0) for part in x)  # (T k, n) each
    twists = robot.platform.twist_changes((position, rate, acceleration), units[..., :n].reshape(-1, n))
    joints = units[..., n:]
    unchanged = np.zeros_like(joints)
    return MotionSteps((*np.reshape(twists, (3, count, size, n)),), columns, (joints, unchanged, unchanged))


def motion_changes(robot: ParallelRobot, motion: Motion, steps: MotionSteps) -> MotionChanges:
    """Compute the changes dq, dv and da of a motion by small steps.

    The equations of the header are solved in turn.

    Raises:
        NotAssembled: the platform does not determine the joints at some instant.
    """
    linearised, joints = motion.linearised, steps.joints
    displacement, dtwist, dtwist_rate = steps.twist  # (T, k, n) each

    def solve(platform: Array, loops: Array, prescribed: Array) -> Array:
        """Solve for joint rates (T, k, nv) by rates of platform (T, k, n) and loops (T, k, m)."""
        right = np.concatenate([platform, loops], axis=2)
        return solve_rates(robot, linearised, right, steps.columns, prescribed)

    closed_loops = np.zeros((*displacement.shape[:2], len(robot.loops.names)))
    dq = solve(displacement, closed_loops, joints[0])
    ahead = step_frames(robot, linearised.frames, dq)

    same_rates = vary_motions(robot, ahead, motion.v, motion.a, np.zeros_like(dq))
    platform_change = complex_step_derivative(robot.platform.frame_velocity(same_rates))
    dv = solve(
        dtwist - platform_change, -complex_step_derivative(closure_rates(robot.loops, same_rates)), joints[1]
    )

    same_accelerations = vary_motions(robot, ahead, motion.v, motion.a, dv)
    platform_change = complex_step_derivative(robot.platform.drift(same_accelerations))
    drift_change = complex_step_derivative(closure_drift(robot.loops, same_accelerations))
    da = solve(dtwist_rate - platform_change, -drift_change, joints[2])
    return MotionChanges(dq, dv, da)


def coordinate_changes(
    robot: ParallelRobot, motion: Motion, x: CoordinateRates, elastic: IntArray
) -> MotionChanges:
    """Compute the changes of a motion (T, 3 k, nv) by unit steps of coordinates.

    All positions step, then rates, then accelerations: of a platform at x, dx, ddx (T, n), of the `elastic`
    joints and of the idle ones, k in all. With dq, dv, da the changes by a step of a position they are

        by positions (dq, dv, da),  by rates (0, dq, 2 dv - [v, dq]),  by accelerations (0, 0, dq).

    The bracket [v, dq] of the fields of motion is zero but for balls, whose rates belong to no coordinate. It
    has no part along the steps of idle joints, which keep their rates.
    """
    steps = position_steps(robot, x, np.concatenate([elastic, robot.structure.idle]))
    dq, dv, da = motion_changes(robot, motion, steps)
    still, bracket = np.zeros_like(dq), np.zeros_like(dq)
    for ball in ball_columns(robot.model):
        bracket[..., ball] = cross(motion.v[:, None, ball], dq[..., ball])
    turns = dq[:, robot.n + len(elastic) :]
    bracket -= bracket[..., robot.structure.idle] @ turns
    blocks = ((dq, still, still), (dv, dq, still), (da, 2.0 * dv - bracket, dq))
    return MotionChanges(*(np.concatenate(block, axis=1) for block in blocks))


def solve_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, right: Array, columns: IntArray, prescribed: Array
) -> Array:
    """Solve (dF/dq) rates = right (T, k, n + m) for joint rates (T, k, nv).

    The rates of some columns (c,) are `prescribed` (T, k, c); those of the moving joints follow.

    Raises:
        NotAssembled: the platform does not determine the joints (Type 1).
    """
    rates = full_motion(robot, columns, prescribed)
    right = right - prescribed @ linearised.jacobian[:, :, columns].swapaxes(1, 2)
    rates[..., robot.moving] = moving_rates(robot, linearised, right.swapaxes(0, 1)).swapaxes(0, 1)
    return rates


def require_turns_at_rest(robot: ParallelRobot) -> None:
    """Raise InvalidInput where the damping or the armature of balls drives an idle turn."""
    turns = driven_turns(robot)
    if len(turns):
        names = ", ".join(robot.coordinates.name_of(int(column)) for column in turns)
        raise InvalidInput(
            f"{robot.name}: the damping or the armature of balls drives the idle turns {names}; "
            f"they are taken for turns at rest here: leave damping and armature of these balls out"
        )
