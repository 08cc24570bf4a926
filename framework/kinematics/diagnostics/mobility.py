"""The freedoms of a robot or mechanism, with idle and loose motions, and proposals for the platform's axes.

At a configuration the joints have f freedoms: joints less independent loop equations, springs locked. A
motion that moves neither a motor nor a platform coordinate is of one of two kinds:

* idle: no centre of mass moves, as when a rod turns about its own axis between two balls. Weight does not
  drive the motion. Planning keeps it at rest, or lets damping or armature of the balls drive it;
* loose: masses move, as with a pendulum on the platform or a linkage without a motor. No plan determines the
  motion.

If the platform cannot move along an axis at a single pose, the pose is singular; this is not a property of
the mechanism. So an axis counts as stuck only if it is also stuck at neighbouring closed poses.

`LoopMotions` are the motions of a mechanism that has no platform yet, from which `proposal` chooses one. All
motions are in radians and lengths of the robot.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import FrameworkError, NotAssembled
from framework.kinematics.assembly import joint_loops_matrix, loops_at, nearby_configurations
from framework.kinematics.assembly_search import find_closed_pose
from framework.kinematics.frames import frames_at, full_motion
from framework.kinematics.loop_structure import (
    DISTANCE_APART,
    assemble_mechanism,
    choose_rows,
    motion_matrix,
    numerical_rank,
    rounded_gap,
)
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.model.description import AXES, RobotDescription
from framework.numerics.arrays import Array, Names
from framework.numerics.ordered_sums import least_singular_values, singular_values, split_row_space
from framework.tolerances import FILE_ROUNDING, NEARLY_AT_REST, RANK_ROUNDING

PROPOSED_AXES_CLEARANCE = 0.02  # least singular value of proposed axes [lengths of the robot, rad]
MAX_LISTED = 4  # number of proposals, or of joints, that a message lists
BESIDE_SINGULARITY = "reference: a pose beside the file's, which is on a singularity of the loops"


class Mobility(NamedTuple):
    """The freedoms of a robot at its reference."""

    freedoms: int  # number of all degrees of freedom, springs locked
    idle: Names  # a joint for each motion that moves no centre of mass
    loose: Names  # a joint for each motion that moves masses without any motor or platform coordinate

    @property
    def working(self) -> int:
        """Number of degrees of freedom without the idle ones."""
        return self.freedoms - len(self.idle)


class PlatformAxes(NamedTuple):
    """Platform axes that are stuck, such as "x, rz" or "x and rz independently of each other"."""

    stuck: str  # axes stuck at the reference and at nearby poses; empty without any
    stuck_here: str  # axes stuck at the reference
    twist_rank: int  # number of independent twists of the platform's frame, 0..6
    proposals: tuple[Names, ...]  # sets of sufficient axes, if the stated axes are not sufficient


def count_freedoms(robot: ParallelRobot) -> Mobility:
    """Count the degrees of freedom at the reference; name a joint for each idle and loose one."""
    q = robot.reference.q
    motions, platform_rates = _platform_motions(robot, q)  # (nv, f), (n, f)
    driven_rates = np.concatenate([platform_rates, motions[robot.actuated]])
    undriven = motions @ null_space(driven_rates)  # (nv, k) neither motors nor platform move

    mass_velocities = mass_centre_jacobian(robot, q) @ undriven  # (3 b, k)
    with_mass, without_mass = split_row_space(mass_velocities, NEARLY_AT_REST, scale=(1.0, 1.0))
    idle = _choose_joints(undriven @ without_mass.T)
    loose = _choose_joints(undriven @ with_mass.T, excluded=idle)
    return Mobility(
        freedoms=motions.shape[1],
        idle=tuple(map(robot.coordinates.turn_name, idle)),
        loose=tuple(map(robot.coordinates.turn_name, loose)),
    )


def examine_platform_axes(robot: ParallelRobot, freedoms: int) -> PlatformAxes:
    """Find axes along which the platform cannot move, and sets of sufficient axes.

    An axis counts as `stuck` if the platform can move along it neither at the assembled reference nor at any
    nearby closed pose, and as `stuck_here` if the platform cannot move along it at the reference.

    Args:
        freedoms: number of degrees of freedom that the axes have to describe.
    """
    q, names = robot.reference.q, robot.axis_names
    _, rates = _platform_motions(robot, q)  # (n, f)
    # (n, k) orthonormal combinations of the n axes along which the platform cannot move
    stuck_here = null_space(rates.T)
    if not stuck_here.shape[1] and robot.n == freedoms:
        return PlatformAxes(stuck="", stuck_here="", twist_rank=freedoms, proposals=())
    stuck = stuck_here  # at the pose with fewest of them
    twists = []  # (6, f) at each pose, of the platform's frame [rad, robot lengths]
    for pose in (q, *nearby_configurations(robot, q)):
        motions, rates = _platform_motions(robot, pose)
        stuck = min(stuck, null_space(rates.T), key=lambda immovable: immovable.shape[1])
        twists.append(scaled_twists(robot, frames_at(robot, pose[None]).frame_jacobian()[0]) @ motions)
    twist_rank = max(int(np.linalg.matrix_rank(matrix, tol=FILE_ROUNDING)) for matrix in twists)
    return PlatformAxes(
        stuck=_name_stuck_axes(stuck, names),
        stuck_here=_name_stuck_axes(stuck_here, names),
        twist_rank=twist_rank,
        proposals=_propose_axes(robot, twists, freedoms) if twist_rank == freedoms else (),
    )


def _propose_axes(robot: ParallelRobot, twists: list[Array], freedoms: int) -> tuple[Names, ...]:
    """Return up to MAX_LISTED sets of axes, other than those of the robot, along which its frame moves.

    The frame can move along a set if at one pose at least it can move independently along all of its axes; at
    the reference this is tried. Sets with the fewest turns come first. Two turns are coordinates in series,
    and their order matters. So the reverse order of two turns of the robot counts as another set.

    Args:
        twists: (6, f) at each pose, twists of the frame in the f motions that the loops allow.
        freedoms: number of axes in a set.
    """
    stated = robot.axis_names
    if not freedoms:
        return ()
    proposals: list[Names] = []
    # an axis is an index into AXES: 0 to 2 are translations, 3 to 5 are turns
    by_turns = sorted(combinations(range(6), freedoms), key=lambda axes: sum(axis >= 3 for axis in axes))
    for axes in by_turns:
        clearance = max(least_singular_values(matrix[list(axes)]) for matrix in twists)  # at the best pose
        if clearance <= PROPOSED_AXES_CLEARANCE:
            continue
        names = tuple(AXES[axis] for axis in axes)
        are_two_turns = freedoms == 2 and min(axes) >= 3
        if set(names) != set(stated):
            proposals.append(names)
        elif are_two_turns:
            proposals.append(stated[::-1])
    return tuple(islice((names for names in proposals if _is_movable_along(robot, names)), MAX_LISTED))


def _is_movable_along(robot: ParallelRobot, axes: Names) -> bool:
    """Return whether the robot can be built with other axes, and its platform moves along all."""
    platform = replace(robot.description.platform, axes=axes, joints=())
    reference = robot.reference_values(robot.reference.q)
    described = replace(robot.description, platform=platform, reference=reference)
    try:
        other = ParallelRobot.from_description(described)
    except FrameworkError:
        return False
    return not null_space(_platform_motions(other, other.reference.q)[1].T).shape[1]


def find_free_motions(robot: Mechanism, q: Array, rank: int) -> Array:
    """Compute orthonormal joint motions (nv, f) that loops of a `rank` allow at q (nq,)."""
    null_vectors = np.linalg.svd(joint_loops_matrix(robot, q)).Vh[rank:]  # (f, joints)
    return full_motion(robot, robot.joints, null_vectors).T


def _platform_motions(robot: ParallelRobot, q: Array) -> tuple[Array, Array]:
    """Compute the joint motions (nv, f) that the loops allow at q (nq,), and the platform's rates (n, f)."""
    motions = find_free_motions(robot, q, len(robot.structure.independent))
    return motions, motion_matrix(robot, robot.platform, q)[: robot.n] @ motions


def scaled_twists(robot: Mechanism, twists: Array) -> Array:
    """Return twists (6, nv) of a frame made dimensionless: radians and lengths of the robot."""
    units = np.repeat([robot.length, 1.0], 3)  # of the linear and the angular parts
    return twists / units[:, None] * robot.column_scale


def mass_centre_jacobian(robot: Mechanism, q: Array) -> Array:
    """Compute the Jacobian (3 b, nv) of the mass centres of the b bodies with mass at q (nq,).

    It is dimensionless, in radians and robot lengths. The velocity of a centre is on the axes of its body.
    """
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, q)
    velocities = [np.empty((0, model.nv))]  # for a robot without mass
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        if body.mass > 0.0:
            twists = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, model.nv)
            velocities.append(twists[:3] - pin.skew(body.lever) @ twists[3:])  # v + w x lever
    return np.concatenate(velocities) / robot.length * robot.column_scale


def _name_stuck_axes(stuck: Array, names: Names) -> str:
    """Write immovable combinations `stuck` (n, k) of the axes `names`: single ones first, then mixed ones.

    The columns of `stuck` are orthonormal.
    """
    # the norm is 1 if the axis is immovable by itself, 0 if it is in no combination
    norms = dict(zip(names, np.linalg.norm(stuck, axis=1), strict=True))
    alone = [name for name, norm in norms.items() if norm > 1.0 - FILE_ROUNDING]
    if len(alone) == stuck.shape[1]:
        return ", ".join(alone)
    involved = [name for name, norm in norms.items() if norm > FILE_ROUNDING]
    together = " and ".join(name for name in involved if name not in alone)
    return ", ".join([*alone, f"{together} independently of each other"])


def null_space(matrix: Array) -> Array:
    """Compute an orthonormal basis (c, k) of the null space of a matrix (m, c)."""
    return split_row_space(matrix, FILE_ROUNDING, scale=(1.0, 1.0))[1].T


def _choose_joints(motions: Array, excluded: tuple[int, ...] = ()) -> tuple[int, ...]:
    """Choose k joints, ascending and none of `excluded`, whose rates determine k motions (nv, k)."""
    joints = np.setdiff1d(np.arange(len(motions)), excluded)
    return tuple(joints[choose_rows(motions[joints], motions.shape[1])].tolist())


class LoopMotions(NamedTuple):
    """A mechanism at a closed pose, with the motions that its loops allow."""

    mechanism: Mechanism
    q: Array  # (nq,) the closed pose
    basis: Array  # (nv, f) all motions, orthonormal
    working: Array  # (nv, w) the motions that move a mass or a motor
    remarks: tuple[str, ...]  # on the pose

    @property
    def freedoms(self) -> int:
        """Number of the working motions."""
        return self.working.shape[1]

    def rates(self, names: Iterable[str]) -> Array:
        """Return the rates (k, w) of the joints `names` in the working motions."""
        return self.working[velocity_columns(self.mechanism.model, names)]

    def choose_independent(self, motions: Array, names: Iterable[str]) -> list[str]:
        """Choose joints with independent rates in `motions` (nv, k) from `names`, in this order."""
        chosen: list[str] = []
        for name in names:
            rows = motions[velocity_columns(self.mechanism.model, [*chosen, name])]
            if np.linalg.matrix_rank(rows, tol=PROPOSED_AXES_CLEARANCE) > len(chosen):
                chosen.append(name)
        return chosen


def motions_within_limits(description: RobotDescription) -> LoopMotions | None:
    """Return the motions at the nearest closed pose within the joints' limits.

    None if the reference of the file is within the limits, or if no closed pose within them is found; also
    without a reference, as `assemble_mechanism` has then sought one.
    """
    mechanism = Mechanism.from_description(description)
    if not description.reference or not positions_beyond_limits(mechanism.limits, mechanism.q_near[None]):
        return None
    try:
        pose = find_closed_pose(mechanism)
        within = motions_near_reference(replace(description, reference=mechanism.reference_values(pose.q)))
    except NotAssembled:
        return None
    remark = (
        f"reference: the nearest closed pose within the joints' limits, {pose.farthest} from "
        f"the file's, from which nothing can be proposed"
    )
    return within._replace(remarks=(remark, *within.remarks))


def motions_near_reference(description: RobotDescription) -> LoopMotions:
    """Return the motions at the closed reference, or at a pose near it with more independent loops.

    If loops are singular at the reference, the pose where they are farthest from this is chosen.
    """
    mechanism, remarks = _assemble(Mechanism.from_description(description))
    q = mechanism.q_near
    rank = numerical_rank(joint_loops_matrix(mechanism, q))
    nearby = nearby_configurations(mechanism, q)
    if any(numerical_rank(joint_loops_matrix(mechanism, pose)) > rank for pose in nearby):
        poses = [*nearby, *nearby_configurations(mechanism, q, distance=DISTANCE_APART)]
        values = singular_values(np.array([joint_loops_matrix(mechanism, pose) for pose in poses]))
        rank = int(np.sum(values > RANK_ROUNDING * values[:, :1], axis=1).max())
        clearance = values[:, rank - 1] / values[:, 0]  # (poses,) least singular value over the largest
        # a pose beyond the ranges only if all are: the clearance is at most 1
        within = [not positions_beyond_limits(mechanism.limits, pose[None]) for pose in poses]
        q = poses[int(np.argmax(clearance + 2.0 * np.array(within)))]
        remarks.append(BESIDE_SINGULARITY)
        beside, _ = assemble_mechanism(mechanism.with_nearby_pose(q))
        if beside.rounded.names:  # some rows are independent there by rounding alone
            mechanism, rank = beside, numerical_rank(joint_loops_matrix(beside, q))
    if beyond := positions_beyond_limits(mechanism.limits, q[None]):
        places = "; ".join(f"{joint} at {place}" for joint, place in beyond.items())
        remarks.append(f"reference: outside the joints' ranges: {places}")
    basis = find_free_motions(mechanism, q, rank)
    return LoopMotions(mechanism, q, basis, _working_motions(mechanism, q, basis), tuple(remarks))


def _assemble(mechanism: Mechanism) -> tuple[Mechanism, list[str]]:
    """Return the mechanism with a closed pose as `q_near`, and remarks on the pose.

    If the loops do not close near the reference, the nearest closed pose is sought.
    """
    try:
        assembled, closing = assemble_mechanism(mechanism)
    except NotAssembled:
        pose = find_closed_pose(mechanism)
        gap = np.abs(loops_at(mechanism, mechanism.q_near).residual * mechanism.row_lengths).max()
        remark = (
            f"reference: the nearest closed pose, {pose.farthest} from the file's, whose loops "
            f"are {gap:.2g} m or rad open"
        )
        return replace(mechanism, q_near=pose.q), [remark]
    remarks = []
    if assembled.rounded.names:
        gap = rounded_gap(assembled, closing.q[None])
        remarks.append(f"rounded and overconstrained by {gap:.2g} m: see `crossing check`")
    q = closing.q
    file_positions, closed_positions = mechanism.coordinates.positions(np.stack([mechanism.q_near, q]))
    moves = np.abs(closed_positions - file_positions)  # (nv,) [rad, m]
    column = int(np.argmax(moves))
    if moves[column] > FILE_ROUNDING:
        name, unit = mechanism.coordinates.name_of(column), mechanism.unit_of(column)
        farthest = f"{name} {moves[column]:.3g} {unit}"
        sought = not mechanism.description.reference and not assembled.rounded.names  # within the ranges
        if not sought and positions_beyond_limits(assembled.limits, q[None]):
            with suppress(NotAssembled):  # no closed pose is found within the ranges
                q, farthest = find_closed_pose(assembled)
        moved_in = not np.array_equal(assembled.q_near, mechanism.q_near)
        closed = "closed within the joints' limits" if moved_in else "closed"
        remarks.append(f"reference: {farthest} from the file's, {closed}; --reference chooses others")
    return replace(assembled, q_near=q), remarks


def _working_motions(mechanism: Mechanism, q: Array, basis: Array) -> Array:
    """Return the motions (nv, w) of a basis (nv, f) that move a mass or a motor at q (nq,).

    Joints of couplings, such as those of a thread, count as motors, unless no body has mass.
    """
    description = mechanism.description
    velocities = mass_centre_jacobian(mechanism, q) @ basis
    with_mass, without_mass = split_row_space(velocities, NEARLY_AT_REST, scale=(1.0, 1.0))
    idle = basis @ without_mass.T

    motors = list(description.motor_joints)
    if velocities.any():
        motors += coupled_joints(description)
    motor_rates = idle[velocity_columns(mechanism.model, motors)]  # of the motors in the idle motions
    with_motor, _ = split_row_space(motor_rates, NEARLY_AT_REST, scale=(1.0, 1.0))
    return np.concatenate([basis @ with_mass.T, idle @ with_motor.T], axis=1)


def coupled_joints(description: RobotDescription) -> list[str]:
    """Return the names of the joints of all couplings."""
    return [name for coupling in description.couplings for name in coupling.joints]
