"""What the solved equations leave out, measured along the whole motion, on the nodes of time and between.

The motion is found from the loop equations that are independent at the reference, with the idle joints held
still. Here all loop equations are looked at, and what the joints would have to give beside motors and springs
for the motion to be as planned: nothing, if it is right. With r the inverse dynamics of the tree, J the loop
equations' Jacobian, S the motors' columns and tau_joint their torques on the joint side,

    r - S' tau_joint = J' lambda + X' w        along the actuated and passive joints
    idle             = r - J' lambda           along the idle ones

X is the platform's Jacobian and w a wrench that would have to hold it; [X; J] is regular at Type 2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.dynamics.elasticity import Deflected
from framework.dynamics.forces import tree_forces
from framework.dynamics.result import InverseDynamics
from framework.errors import LoadedJoint, NotAssembled
from framework.kinematics.inverse_kinematics import (
    ClosedStack,
    Motion,
    motion_at,
    system_at,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tracking import Branch
from framework.motion.path import along

OPEN = 1e-9  # [rad, lengths of the robot] that a dropped loop equation may be open on a node
# Load of an idle joint over the largest one of a joint of the open tree, forces times the robot's length. It
# would move the joint, and change the torques by as much at most; they are resolved to 1e-10.
LOADED = 1e-9


class Neglected(NamedTuple):
    """The largest of what is left out, over all instants."""

    closure_error: float  # of all loop equations and of the platform [m or rad]
    residual_torque: float  # that joints would have to give beside motors and springs [N m or N]


def measure_neglected(branch: Branch, state: Deflected, result: InverseDynamics) -> Neglected:
    """Look at all loop equations and all joints of a motion, at its nodes and half-way between them.

    Raises:
        NotAssembled: a loop equation that was dropped at the reference is open on a node.
    """
    robot, nodes = branch.robot, state.grid.times
    on_nodes = state.motion.system.loops.residual
    _check_dropped_rows(robot, nodes, on_nodes, state.motion.q)
    times = _instants(robot, nodes)
    closed = planned_pose(result, times)
    gaps = (on_nodes, closed.system.loops.residual, closed.system.residual[:, : robot.n])
    motion = motion_of_forces(branch, result, times, closed)
    residual = _residual_torques(robot, motion, _joint_torques(state, times))
    return Neglected(
        closure_error=max(float(np.abs(gap).max(initial=0.0)) for gap in gaps),
        residual_torque=float(np.abs(residual).max(initial=0.0)),
    )


def check_idle_joints(branch: Branch, state: Deflected, result: InverseDynamics) -> None:
    """Raise LoadedJoint if this motion would load a joint that is held still because it seemed idle."""
    robot, idle = branch.robot, branch.robot.idle
    if not len(idle):
        return
    times, scale = _instants(robot, state.grid.times), robot.column_scale
    motion = motion_of_forces(branch, result, times, planned_pose(result, times))
    loads = _residual_torques(robot, motion, _joint_torques(state, times))[:, idle]
    worst = int(np.argmax(np.abs(loads * scale[idle])))
    instant, k = divmod(worst, len(idle))
    load, column = float(loads[instant, k]), int(idle[k])
    if abs(load) * scale[column] <= LOADED * float(np.abs(tree_forces(robot, motion) * scale).max()):
        return
    joint = robot.joint_of(column)
    raise LoadedJoint(
        f"{robot.name}: nothing holds {joint}, which this motion would load with {load:.3g} "
        f"{'N' if robot.sliding[column] else 'N m'} at t = {times[instant]:.6g} s: it would move, and change "
        f"all other forces; lock it (`locked`, or a closure), give it a motor or a spring, or leave out the "
        f"inertia that it carries",
        joint=joint,
        torque=load,
        time=float(times[instant]),
    )


def _instants(robot: ParallelRobot, nodes: Array) -> Array:
    """Half-way between the nodes; with idle joints the nodes too, where all other joints are in balance."""
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    return np.sort(np.concatenate([nodes, middle])) if len(robot.idle) else middle


def planned_pose(result: InverseDynamics, times: Array) -> ClosedStack:
    """The coordinates as functions of time, nothing solved."""
    q, x = result.configuration(times), result.platform(times)
    return ClosedStack(q, x, system_at(result.robot, q, x))


def motion_of_forces(branch: Branch, result: InverseDynamics, times: Array, closed: ClosedStack) -> Motion:
    """The motion whose forces are taken: with rigid geometry that of the robot without deflections."""
    robot = branch.robot
    if robot.n_e and result.geometry == "rigid":
        s = [result.law(times, order) for order in range(3)]
        _, dx, ddx = along(branch.path, s)
        return motion_at(robot, branch.closed(s[0]), dx, ddx)
    rates = [result.deflection(times, order) for order in (1, 2)]
    return motion_at(robot, closed, result.platform(times, 1), result.platform(times, 2), *rates)


def _joint_torques(state: Deflected, times: Array) -> Array:
    """Torques (T, n_a) of the motors on the joint side, without the rotors."""
    return state.grid.fit(state.forces.joint_torque)(times)


def _check_dropped_rows(robot: ParallelRobot, times: Array, residual: Array, q: Array) -> None:
    """Raise NotAssembled if a loop equation (T, rows) that is not among the independent ones is open."""
    scale = robot.row_lengths
    dropped = np.setdiff1d(np.arange(len(scale)), robot.independent)
    if not len(dropped):
        return
    instant, k = divmod(int(np.argmax(np.abs(residual[:, dropped]) / scale[dropped])), len(dropped))
    row = dropped[k]
    gap = abs(float(residual[instant, row]))
    if gap <= OPEN * scale[row]:
        return
    unit = "rad" if robot.rows.rotation[row] else "m"
    raise NotAssembled(
        f"{robot.name}: {robot.rows.names[row]}, which repeats other loop equations at the reference, is "
        f"open by {gap:.3g} {unit} at t = {times[instant]:.6g} s: this motion tears the loop; give a "
        f"reference on the motion's own way",
        q=q[instant],
        residual=gap,
    )


def _residual_torques(robot: ParallelRobot, motion: Motion, torque: Array) -> Array:
    """What all joints (T, nv) would have to give beside the joint torques (T, n_a) of the motors.

    A wrench on the platform is given by the joints that carry it; springs are left out.
    """
    forces, columns, idle = tree_forces(robot, motion), robot.moving, robot.idle
    load = forces[:, columns].copy()
    load[:, : robot.n_a] -= torque
    held = motion.system.factors.solve_transposed(load[None])[0]  # w and lambda
    given = np.zeros_like(forces)
    given[:, columns] = np.einsum("tn,tnv->tv", held[:, : robot.n], motion.system.platform[:, :, columns])
    loops = np.einsum("tm,tmv->tv", held[:, robot.n :], motion.system.closures[:, :, idle])
    given[:, idle] = forces[:, idle] - loops
    return given
