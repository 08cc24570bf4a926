"""How far a motion with its torques is from the equations of motion: a witness for any robot, at any instant.

Of the robot its tree, its index sets and the words of its file are taken, as in `forward_simulation`;
frames, loop equations and the platform's coordinates are computed anew. What joint accelerations and motor
torques leave of

    M a + h - f = J' lambda,        J v = 0,        J a + drift = 0,        closures(q) = 0

is measured, with the lambda that leaves least. Massless parts need no other treatment: nothing is solved for.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework import CrossingPlan, ParallelRobot
from tests.oracles.closure_rows import closure_errors, closure_rows, frame_of
from tests.oracles.forward_simulation import kinematics, mass_matrix, motors, rotors, springs


class Defects(NamedTuple):
    """The largest of what the equations leave at some instants."""

    open: float  # closures [m, rad]
    speed: float  # rates of the closures, over the largest sum of the sizes of their terms
    acceleration: float  # their second derivatives, over that of theirs
    force: float  # generalised force that nothing holds, over the largest of the terms
    platform: float  # distance from where the platform is said to be [m, rad]


def defects(
    robot: ParallelRobot, *, q: np.ndarray, v: np.ndarray, a: np.ndarray, torque: np.ndarray, x: np.ndarray
) -> Defects:
    """Of configurations q (T, nq), v and a (T, nv), motor torques (T, n_a) [N m] and platform x (T, n)."""
    model, closures = robot.model, robot.description.closures
    data, found, sizes = model.createData(), [], []
    platform = frame_of(model, robot.description.platform.frame)
    for k in range(len(q)):
        kinematics(model, data, q[k], v[k])
        J, drift = closure_rows(model, data, closures)
        gaps = closure_errors(model, data, closures)
        off = apart(robot, q[k], data.oMf[platform], x[k])
        inertia = (mass_matrix(model, data, q[k]) + np.diag(rotors(robot))) @ a[k]
        terms = [inertia, pin.nonLinearEffects(model, data, q[k], v[k]), -springs(robot, q[k])]
        terms += [robot.joint_damping * v[k], -motors(robot, torque[k])]
        load = np.sum(terms, axis=0)
        held = J.T @ np.linalg.lstsq(J.T, load, rcond=1e-12)[0]
        found.append([np.abs(left).max() for left in (gaps, J @ v[k], J @ a[k] + drift, load - held, off)])
        speeds = np.abs(J) @ np.abs(v[k])
        sizes.append(
            [1.0, speeds.max(), (np.abs(J) @ np.abs(a[k]) + np.abs(drift)).max(), np.abs(terms).max(), 1.0]
        )
    return Defects(*(np.max(found, axis=0) / np.max(sizes, axis=0)).tolist())


def defects_of(plan: CrossingPlan) -> Defects:
    """What 23 instants of a plan leave of the equations of motion."""
    t = np.linspace(0.0, plan.duration, 23)
    motion = plan.dynamics
    return defects(
        plan.robot,
        q=motion.configuration(t),
        v=motion.velocity(t),
        a=motion.velocity(t, 2),
        torque=plan.torque(t),
        x=plan.platform(t),
    )


def defects_at(plan: CrossingPlan, t: np.ndarray) -> Defects:
    """What instants (T,) of a plan leave of the equations of motion, by its motion as a whole."""
    motion = plan.dynamics.motion(t)
    return defects(plan.robot, q=motion.q, v=motion.v, a=motion.a, torque=plan.torque(t), x=plan.platform(t))


def apart(robot: ParallelRobot, q: np.ndarray, pose: pin.SE3, x: np.ndarray) -> np.ndarray:
    """The platform at q (nq,), its frame's pose, less coordinates x (n,) of the robot file [m, rad].

    One angle is that of the turn nearest to the frame's about its axis; three are a rotation vector; joints
    are their positions.
    """
    axes = robot.description.platform.axes
    if robot.description.platform.joints:
        joints = [robot.model.joints[robot.model.getJointId(j)] for j in robot.description.platform.joints]
        return np.array([q[joint.idx_q] for joint in joints]) - x
    turn = np.zeros(3)
    off = np.zeros(len(axes))
    for k, axis in enumerate(axes):
        if axis.startswith("r"):
            turn["xyz".index(axis[1])] = x[k]
        else:
            off[k] = pose.translation["xyz".index(axis)] - x[k]
    turning = [k for k, axis in enumerate(axes) if axis.startswith("r")]
    rest = pin.Quaternion(pin.exp3(turn).T @ pose.rotation)  # what is left of the turn
    if len(turning) == 1:
        about = "xyz".index(axes[turning[0]][1])
        off[turning] = (2 * np.arctan2(rest.coeffs()[about], rest.w) + np.pi) % (2 * np.pi) - np.pi
    elif turning:
        off[turning] = pin.log3(rest.matrix())[["xyz".index(axes[k][1]) for k in turning]]
    return off
