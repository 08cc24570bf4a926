"""Checks of a computed motion: residuals of all equations, near misses, and the errors if a check fails.

The motion is computed from the loop equations that are independent at the reference, with the idle joints at
rest or turned by `kinematics.idle_turns`. The checks evaluate all loop equations, on the nodes in time and
between them, and the residual torques: torques that the planned motion would need in addition to motors and
springs. They vanish if the motion is exact. With the forces r of the open tree, the Jacobian J of the loop
equations, the selection S of the actuated joints and the joint torques tau_joint,

    r - S' tau_joint = J' lambda + X' w        along the actuated and passive joints
    residual         = r - J' lambda           along the idle joints

X is the platform's Jacobian and w the platform wrench missing for balance; [X; J] is regular at Type 2.

Beside a singularity that the path misses, torques may rise like 1/|g|, in a peak as wide as the stretch of
the path on which |g| doubles. Nodes that are farther apart do not resolve this peak, however small the tail
of the series. So the torques are computed again where |g| is least and where it has doubled.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.elasticity import Pass, motion_at_rest
from framework.dynamics.forces import joint_forces, loop_multipliers, tree_forces
from framework.dynamics.result import InverseDynamics
from framework.dynamics.singularity_crossings import find_instants
from framework.errors import FrameworkError, LoadedJoint, NotAssembled, NotConverged, round_up
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import tree_columns
from framework.kinematics.inverse_kinematics import turn_motions
from framework.kinematics.linearised_loops import (
    linearised_at_reference,
    type2_matrix,
)
from framework.kinematics.loop_structure import rounded_gap
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import is_ball, link_of
from framework.laws.path import PointPath
from framework.model.description import AXES, Closure
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeGrid
from framework.singularity.piecewise_measure import extremum_near
from framework.singularity.points_on_path import SearchedPath
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import EXPORT_ROUNDING, HELD_IDLE, LOOP_GAP, RESOLVABLE_TAIL


class MissingForces(NamedTuple):
    """Forces that a planned motion would need beside motors and springs, at T instants."""

    times: Array  # (T,) [s]
    joint_torques: Array  # (T, n_a) of the series
    residual: Array  # (T, nv) the missing forces


def measure_residuals(
    branch: Branch, solution: Pass, result: InverseDynamics
) -> tuple[InverseDynamics, MissingForces]:
    """Return the result with the largest loop gap and residual torque, and the forces missing for balance.

    The forces are those between the nodes, at the poses of the series as they are: Newton's method closes the
    loops at the nodes alone. With springs at rest under rigid geometry, loops are closed there, too. The
    largest gap compares the numbers of all loop equations, in m or rad.

    Raises:
        NotAssembled: a loop equation that was left out opens.
    """
    robot = branch.robot
    gap_of_rounded = _check_rows_left_out(robot, solution)
    times = check_instants(robot, solution.grid)
    of_series = result.motion(times, closed=False)
    motion = motion_at_rest(branch, times, result.law) if forces_are_at_rest(result) else of_series
    torques = solution.grid.fit(solution.forces.joint_torque)(times)  # (T, n_a)
    forces = residual_torques(robot, motion, torques)  # (T, nv)
    residual = forces.copy()
    residual[:, robot.structure.idle] = 0.0  # no error of the series: `check_idle_joints` limits it

    gaps = (
        solution.motion.linearised.solved_residual,  # on the nodes
        of_series.linearised.solved_residual,  # at `times`, with the errors of the series
        of_series.linearised.residual[:, : robot.n],  # of the platform equations, at `times`
    )
    certificate = replace(
        result.certificate,
        max_closure_error=float(max(np.abs(gap).max(initial=0.0) for gap in gaps)),
        max_residual_torque=float(np.abs(residual).max()),
        rounded_gap=gap_of_rounded,
    )
    return replace(result, certificate=certificate), MissingForces(times, torques, forces)


def _check_rows_left_out(robot: ParallelRobot, solution: Pass) -> float:
    """Return the largest gap [m or rad] of rounded loop equations; refuse a motion that opens a left-out one.

    A dropped equation follows from the others at the reference; it may not do so elsewhere. A rounded one
    repeats others there up to the rounding of numbers in the file.

    Raises:
        NotAssembled: a dropped equation opens on some node, or a rounded one farther than rounding explains.
    """
    motion, dropped = solution.motion, robot.structure.dropped
    residual = motion.linearised.loops.residual[:, dropped]  # (T, dropped)
    scaled_gaps = np.abs(residual) / robot.row_lengths[dropped]  # in radians and robot lengths
    if scaled_gaps.max(initial=0.0) > LOOP_GAP:
        instant, k = np.unravel_index(scaled_gaps.argmax(), scaled_gaps.shape)
        row = dropped[k]  # its index among all loop equations
        gap = float(abs(residual[instant, k]))
        unit = "rad" if robot.rows.rotation[row] else "m"
        raise NotAssembled(
            f"{robot.rows.names[row]}, which repeats other loop equations at the reference, is open by "
            f"{gap:.3g} {unit} at t = {solution.grid.times[instant]:.6g} s: this motion tears the loop",
            clauses=("give a reference on the motion's own way",),
            name=robot.name,
            q=motion.q[instant],
            residual=gap,
        )
    gap = rounded_gap(robot, motion.q)
    if gap > EXPORT_ROUNDING * max(robot.length, 1.0):
        raise NotAssembled(
            f"{', '.join(robot.rounded.names)}, which repeat other loop equations but for "
            f"rounding at the reference, open by {gap:.3g} m or rad on the way: this motion tears the loop",
            clauses=("check the dimensions, or lock only what it takes (axes: [...])",),
            name=robot.name,
            q=motion.q[-1],
            residual=gap,
        )
    return gap


def check_idle_joints(robot: ParallelRobot, missing: MissingForces) -> float:
    """Return the largest torque [N m or N] that the planned motion needs at an idle joint.

    No motor supplies this torque, so the real joint would turn, and the motors' torques would change by the
    same order of magnitude.

    Raises:
        LoadedJoint: the torque is more than HELD_IDLE of a motor's largest torque on the joint side.
    """
    idle = robot.structure.idle
    if not len(idle):
        return 0.0
    loads = missing.residual[:, idle]  # (T, idle)

    # find the largest load, with forces of sliding joints converted to moments
    scale = robot.column_scale
    instant, k = np.unravel_index(np.abs(loads * scale[idle]).argmax(), loads.shape)
    load = float(loads[instant, k])
    column = int(idle[k])
    largest_torque = np.abs(missing.joint_torques * scale[robot.actuated]).max()
    if abs(load) * scale[column] <= HELD_IDLE * largest_torque:
        return float(np.abs(loads).max())

    joint = robot.coordinates.turn_name(column)
    raise LoadedJoint(
        f"nothing holds {joint}, which this motion would load with {load:.3g} "
        f"{'N' if robot.sliding[column] else 'N m'} at t = {missing.times[instant]:.6g} s: it would move, "
        f"and change all other forces",
        clauses=(_remedy(robot, column),),
        name=robot.name,
        joint=joint,
        torque=load,
        time=float(missing.times[instant]),
    )


def _remedy(robot: ParallelRobot, column: int) -> str:
    """Return advice on how to hold an idle coordinate, or to remove its load.

    The coordinate has the index `column` in the velocity vector. It is a joint, which can be locked, or a
    turn of a ball, which a closure between the bodies at both ends of the ball locks.
    """
    name = robot.coordinates.turn_name(column)
    ball = int(tree_columns(robot).owner[column])  # pinocchio's joint to which the coordinate belongs
    if not is_ball(robot.model.joints[ball]):
        return (
            f"lock it (locked: {{{name}: VALUE}} in a robot file, --lock {name} of `crossing convert`), give "
            f"it a motor, or leave out the inertia behind it"
        )
    closure = _closure_that_holds(robot, column, ball)
    ends = ", ".join(closure.frames) if closure else ""
    by_closure = f", or by a closure {{frames: [{ends}], axes: [{closure.axes[0]}]}}" if closure else ""
    return (
        f"lock {name} (--lock of `crossing convert`){by_closure}, or leave out its inertia about that line, "
        f"and the springs of the balls that it turns, and what is unlike about their axes"
    )


def check_instants(robot: ParallelRobot, grid: TimeGrid) -> Array:
    """Return the instants (T,) [s] of checks: half-way between the nodes of each panel.

    On the nodes the equations of all joints but the idle ones hold by construction. So robots with idle
    joints are checked on the nodes, too.
    """
    times = grid.times
    middles = (0.5 * (times[1:] + times[:-1]))[times[1:] > times[:-1]]  # an inner edge is a node twice
    return np.concatenate([middles, times]) if len(robot.structure.idle) else middles


def _closure_that_holds(robot: ParallelRobot, column: int, ball: int) -> Closure | None:
    """Return the closure that locks an idle turn of a ball, tried on the robot; None if none does.

    It locks the axis of the body in front of the ball that is nearest to the line of the turn.
    """
    model, reference = robot.model, linearised_at_reference(robot)
    columns = np.arange(3) + model.joints[ball].idx_v
    turn = turn_motions(robot, reference)[0, columns, robot.structure.idle.tolist().index(column)]  # (3,)
    line = turn @ reference.frames.screws[0, columns, 3:]  # on base axes
    front = model.frames[model.getFrameId(model.names[ball], pin.FrameType.JOINT)].parentFrame
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.reference.q)
    axis = AXES[3 + int(np.abs(data.oMf[front].rotation.T @ line).argmax())]
    frames = (str(model.frames[front].name), link_of(model, ball))
    closure = Closure(f"hold_{model.names[ball]}", frames, (axis,))
    description = replace(robot.description, closures=(*robot.description.closures, closure))
    try:
        trial = ParallelRobot.from_description(description, flexibility=robot.flexibility)
    except FrameworkError:
        return None
    return closure if len(trial.structure.idle) < len(robot.structure.idle) else None


def evaluate_motion(branch: Branch, result: InverseDynamics, times: Array) -> Motion:
    """Evaluate the motion that causes the forces of a result, at instants (T,) [s].

    With rigid geometry it is that of the undeformed robot.
    """
    return motion_at_rest(branch, times, result.law) if forces_are_at_rest(result) else result.motion(times)


def forces_are_at_rest(result: InverseDynamics) -> bool:
    """Return whether forces count springs at rest, as with rigid geometry, though deflections are known."""
    return bool(result.robot.n_e) and result.geometry == "rigid"


def residual_torques(robot: ParallelRobot, motion: Motion, torque: Array) -> Array:
    """Compute the generalised forces (T, nv) missing for balance under motor torques (T, n_a), joint side.

    They are X' w along actuated and passive joints, and r - J' lambda along idle joints (see the
    header). Elastic columns are zero.
    """
    columns = robot.moving
    idle = robot.structure.idle
    linearised, r = motion.linearised, tree_forces(robot, motion)
    multipliers = loop_multipliers(robot, linearised, r, torque)
    w, lambda_ = multipliers[:, : robot.n], multipliers[:, robot.n :]
    residual = np.zeros(r.shape)
    residual[:, columns] = np.vecmat(w, linearised.platform[:, :, columns])  # X' w
    loop_forces = np.vecmat(lambda_, linearised.closures[:, :, idle])  # J' lambda
    residual[:, idle] = r[:, idle] - loop_forces
    return residual


def unseen_near_miss(searched: SearchedPath, solution: Pass, result: InverseDynamics) -> NearMiss | None:
    """Find the first near miss at which the torques differ from their series, if any."""
    # at the ends the motion is at rest and the nodes are dense
    misses = [miss for miss in searched.near_misses if miss.s not in (0.0, 1.0)]
    instants = find_instants(solution.law, solution.grid.edges, [miss.s for miss in misses])
    for miss, times in zip(misses, instants, strict=True):
        for t in times:
            if not _is_resolved_near(searched.branch, solution, result, miss, t):
                return miss
    return None


def _is_resolved_near(
    branch: Branch, solution: Pass, result: InverseDynamics, miss: NearMiss, instant: float
) -> bool:
    """Return whether the series of the torques is accurate at a near miss.

    The torques are computed at the least |g| and, on both sides, where |g| is twice as large. They must agree
    with the series to the tolerance of a resolved torque, plus the relative rounding error of g.

    Args:
        miss: the near miss of the robot with springs at rest.
        instant: time [s] at which that robot passes the near miss.
    """
    robot = branch.robot
    edges = solution.grid.edges
    duration = edges[-1]

    def matrices(shares: Array) -> Array:
        """Compute the Type 2 matrices (T, n, n) at shares (T,) of the duration."""
        motion = evaluate_motion(branch, result, shares * duration)
        return type2_matrix(robot, motion.linearised)

    # deflections shift the least |g|: find it again; `closest.s` is a share of the duration
    closest = extremum_near(matrices, edges / duration, instant / duration, miss.size)
    doubled = closest.bracket(2 * abs(closest.g))  # shares on both sides at which |g| has doubled
    times = duration * np.array([closest.s, *doubled])
    motion = evaluate_motion(branch, result, times)
    torques = solution.forces.joint_torque
    error = np.abs(joint_forces(robot, motion).joint_torque - solution.grid.fit(torques)(times)).max()
    g_error = closest.rounding / max(abs(closest.g), closest.rounding)  # relative; torques are ~ 1 / g
    allowed = RESOLVABLE_TAIL + g_error
    return bool(error <= allowed * np.abs(torques).max())


def unsettled_error(robot: ParallelRobot, solution: Pass) -> NotConverged:
    """Return the error for deflections that did not converge, with the largest deflection.

    The forces of the last pass `caused` deflections (T, n_e) [rad, m]; one more pass would still change them
    by the share `change` of the largest.
    """
    size = np.abs(solution.caused / robot.column_scale[robot.elastic])  # (T, n_e) [rad, robot lengths]
    instant, k = np.unravel_index(np.argmax(size), size.shape)  # of the largest one
    unit = "m" if robot.sliding[robot.elastic][k] else "rad"
    return NotConverged(
        f"no deflections found that hold the forces they cause: with "
        f"{solution.caused[instant, k]:.3g} {unit} of {robot.elastic_names[k]} at t = "
        f"{solution.grid.times[instant]:.4g} s, {solution.change:.2g} of that is lacking",
        name=robot.name,
        residual=solution.change,
    )


def unresolved_error(
    searched: SearchedPath,
    result: InverseDynamics,
    tolerance: float,
    *,
    size: int,
    enough: float,
    unseen: NearMiss | None,
) -> NotConverged:
    """Return the error for a motion that the finest grid does not resolve.

    Args:
        result: the motion on the finest grid.
        tolerance: tail of the torques that counts as resolved.
        size: number of nodes per panel of the finest grid.
        enough: the least tolerance that some grid met.
        unseen: a near miss that no grid resolved, if any.
    """
    robot = searched.branch.robot
    certificate = result.certificate
    s = x = None  # path coordinate and platform coordinates (n,) of a near miss
    # the near miss to name: the unresolved one, or else that of the narrowest torque peak
    near_miss = unseen or min(searched.near_misses, key=lambda miss: miss.width, default=None)
    if certificate.tail > tolerance:
        problem = f"the torques are not resolved (tail {certificate.tail:.2g}, tolerance {tolerance:.2g})"
    elif certificate.change > tolerance:
        problem = (
            f"the deflections are not resolved (one more pass would change them by {certificate.change:.2g} "
            f"of the largest, tolerance {tolerance:.2g})"
        )
    elif unseen is not None:
        problem = f"the torques within {unseen.width:.2g} in s of a near miss are not resolved"
    else:
        gap = certificate.max_closure_error
        problem = f"the motion is not resolved (loops open by {gap:.2g} m or rad between nodes)"
    # the likely reason: a near miss, two singular points that are close, or a law that is not smooth
    advice = "is the law smooth, is the path far from other singularities?"
    if not isinstance(searched.branch.path, PointPath):
        advice = f"is every s at which the pieces of the path join among its `knots`, {advice}"
    if near_miss is not None:
        s = near_miss.s
        x = searched.branch.path(s)
        advice = (
            f"at s = {s:.9g}, {robot.place(x)} the path misses a singularity by "
            f"|g| = {abs(near_miss.g):.2g}: move it across the locus, or farther off"
        )
    elif len(searched.points) > 1:
        first, second = min(pairwise(searched.points), key=lambda pair: pair[1].s - pair[0].s)
        distance = second.s - first.s
        advice = f"is the law smooth? The path is singular at s = {first.s:.9g} and {distance:.2g} farther on"
    clauses: tuple[str, ...] = (advice,)
    remedy = None
    if tolerance < enough < RESOLVABLE_TAIL:
        remedy = {"tolerance": round_up(1.1 * enough, 2)}  # a grid has met it
        clauses = (f"tolerance {remedy['tolerance']:g} would do", *clauses)
    return NotConverged(
        f"{problem} by {size} nodes a panel",
        clauses=clauses,
        name=robot.name,
        residual=certificate.unresolved,
        s=s,
        platform=x,
    ).advising(remedy)
