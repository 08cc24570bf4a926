"""How the Jacobian of platform and loops changes as the robot moves: its time derivative, exactly.

An entry is the power of a wrench W (of a loop equation, or a unit wrench of the platform) on the screw S of a
joint, both about the base's origin, so that d/dt (W . S) = W' . S + W . S'. The wrenches turn with the frames
that they are fixed to; S' comes from pinocchio (`computeJointJacobiansTimeVariation`).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.kinematics.closures import wrench_rates
from framework.kinematics.frames import cross, scratch_of
from framework.kinematics.inverse_kinematics import Motion
from framework.kinematics.parallel_robot import ParallelRobot


def jacobian_rate(robot: ParallelRobot, motion: Motion) -> Array:
    """Time derivative (T, n + m, nv) of `System.jacobian` along a motion."""
    equations, at, v = robot.equations, motion.system.frames, motion.v
    model, data = robot.model, scratch_of(robot).data
    screw_rates = np.empty_like(at.screws)
    for k, (row, rates) in enumerate(zip(motion.q, v, strict=True)):
        screw_rates[k] = pin.computeJointJacobiansTimeVariation(model, data, row, rates).T
    twists = np.einsum("fv,tvi->tfi", at.carried, at.screws * v[:, :, None])  # at the base's origin
    twists[..., :3] += cross(twists[..., 3:], at.position)
    n, bodies, platform = robot.n, equations.bodies, robot.platform
    wrench, rate = np.zeros((2, len(v), len(bodies), 6))
    wrench[:, :n] = platform.wrenches(at)
    wrench[:, n:] = motion.system.loops.take(robot.independent).wrench
    rate[:, :n] = platform.wrench_rates(at, twists[:, 0, 3:], screw_rates)
    rate[:, n:] = wrench_rates(equations.loops, at, twists)
    # about the base's origin
    moved = cross(twists[:, bodies, :3], wrench[..., :3])
    rate[..., 3:] += moved + cross(at.position[:, bodies], rate[..., :3])
    wrench[..., 3:] += cross(at.position[:, bodies], wrench[..., :3])
    entries = equations.pattern.entries
    return equations.pattern.dense(entries(rate, at.screws) + entries(wrench, screw_rates))
