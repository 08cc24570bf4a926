"""The freedoms of a robot, idle and loose motions among them, and proposals for the platform's axes.

At a configuration the joints have f freedoms: joints less independent loop equations, springs locked. A
motion in which no motor and no platform coordinate takes part is one of two kinds:

* idle: no centre of mass moves, as when a rod turns about its own axis between two balls. Weight does not
  turn it. Planning holds it at rest, or turns it by the damping or armature of its balls;
* loose: masses move, as with a pendulum on the platform or a linkage without a motor. No plan determines it.

An axis along which the platform cannot move at one pose alone is a singularity and no property of the
mechanism: axes count as stuck only if they are stuck at neighbouring closed poses, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.kinematics.assembly import all_loops_matrix, nearby_configurations
from framework.kinematics.closures import scale_jacobian
from framework.kinematics.frames import frames_at
from framework.kinematics.loop_structure import row_pivots
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import AXES
from framework.numerics.arrays import Array
from framework.tolerances import FILE_ROUNDING, NEARLY_AT_REST

PROPOSED_AXES_CLEARANCE = 0.02  # least singular value of proposed axes [lengths of the robot, rad]
MAX_PROPOSALS = 4


class Mobility(NamedTuple):
    """The freedoms of a robot at its reference."""

    freedoms: int  # all of them, springs locked
    idle: tuple[str, ...]  # a joint for each motion that moves no centre of mass
    loose: tuple[str, ...]  # a joint for each that moves masses without a motor or a platform coordinate

    @property
    def working(self) -> int:
        """Degrees of freedom of a motion of the robot: all except the idle ones."""
        return self.freedoms - len(self.idle)


class PlatformAxes(NamedTuple):
    """The platform's axes without motion, as "x, rz" or "x and rz independently of each other"."""

    stuck: str  # axes stuck at the reference and at nearby poses; empty if there are none
    stuck_here: str  # axes stuck at the reference
    velocities: int  # independent ones among all six of the frame
    proposals: tuple[tuple[str, ...], ...]  # sufficient axes, if the stated ones are not


def mobility_of(robot: ParallelRobot) -> Mobility:
    """Count the freedoms at the assembled reference."""
    q = robot.reference.q
    undriven = _hidden_motions(robot, q)  # (nv, k)
    with_mass, without_mass = split_space(centres_of_mass(robot, q) @ undriven, NEARLY_AT_REST)
    idle = _pivots(undriven @ without_mass)
    loose = _pivots(undriven @ with_mass, excluded=idle)
    return Mobility(
        freedoms=_motions(robot, q).shape[1],
        idle=tuple(map(robot.coordinates.name_of, idle)),
        loose=tuple(map(robot.coordinates.name_of, loose)),
    )


def platform_axes_of(robot: ParallelRobot, freedoms: int) -> PlatformAxes:
    """Examine the platform's axes at the assembled reference and nearby, for `freedoms` axes."""
    q = robot.reference.q
    stuck_here = _stuck(robot, q)
    if not stuck_here.shape[1] and robot.n == freedoms:
        return PlatformAxes(stuck="", stuck_here="", velocities=freedoms, proposals=())
    poses = [q, *nearby_configurations(robot, q)]
    twists = [
        scaled_twists(robot, frames_at(robot, pose[None]).frame_jacobian(0)[0]) @ _motions(robot, pose)
        for pose in poses
    ]  # (6, f) of the platform's frame, for the motions that the loops allow
    stuck = min((_stuck(robot, pose) for pose in poses), key=lambda combinations: combinations.shape[1])
    velocities = max(int(np.linalg.matrix_rank(matrix, tol=FILE_ROUNDING)) for matrix in twists)
    return PlatformAxes(
        stuck=_name_stuck_axes(stuck, robot.axis_names),
        stuck_here=_name_stuck_axes(stuck_here, robot.axis_names),
        velocities=velocities,
        proposals=_proposals(twists, freedoms, robot.axis_names) if velocities == freedoms else (),
    )


def _proposals(twists: list[Array], freedoms: int, stated: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return sets of axes along which a frame can move in one of the poses, fewest turns first.

    Two turns are coordinates in series, and their order matters: if the `stated` axes are two insufficient
    turns, the other order is proposed.
    """
    proposals: list[tuple[str, ...]] = []
    by_turns = sorted(combinations(range(6), freedoms), key=lambda axes: sum(axis >= 3 for axis in axes))
    for axes in by_turns if freedoms else ():
        least = max(np.linalg.svd(matrix[list(axes)], compute_uv=False)[-1] for matrix in twists)
        if least > PROPOSED_AXES_CLEARANCE:
            names = tuple(AXES[axis] for axis in axes)
            if set(names) != set(stated):
                proposals.append(names)
            elif freedoms == 2 and min(axes) >= 3:
                proposals.append(tuple(reversed(stated)))
    return tuple(proposals[:MAX_PROPOSALS])


def find_free_motions(robot: Mechanism, q: Array, rank: int) -> Array:
    """Compute orthonormal motions (nv, f) that loops of this rank allow at q (nq,) [rad, robot lengths]."""
    right = np.linalg.svd(all_loops_matrix(robot, q)[:, robot.joints])[2]
    motions = np.zeros((robot.model.nv, len(robot.joints) - rank))
    motions[robot.joints] = right[rank:].T
    return motions


def _motions(robot: ParallelRobot, q: Array) -> Array:
    """Compute orthonormal motions (nv, f) that the loops allow at q (nq,) [rad, robot lengths]."""
    return find_free_motions(robot, q, len(robot.structure.independent))


def _hidden_motions(robot: ParallelRobot, q: Array) -> Array:
    """Compute orthonormal motions (nv, k) at q (nq,) with motors and platform coordinates at rest."""
    motions = _motions(robot, q)
    rates = [_platform_rates(robot, q), np.eye(robot.model.nv)[robot.actuated]]
    return motions @ null_space(np.concatenate(rates) @ motions)


def _stuck(robot: ParallelRobot, q: Array) -> Array:
    """Compute combinations (n, k) of platform coordinates that no motion at q (nq,) changes."""
    return null_space((_platform_rates(robot, q) @ _motions(robot, q)).T)


def _platform_rates(robot: ParallelRobot, q: Array) -> Array:
    """Compute rates (n, nv) of the platform's coordinates, in radians and lengths of the robot."""
    jacobian = robot.platform.jacobian(frames_at(robot, q[None]))
    return scale_jacobian(robot, jacobian, ~robot.translations)[0]


def scaled_twists(robot: Mechanism, twists: Array) -> Array:
    """Return twists (6, nv) of a frame in radians and lengths of the robot."""
    units = np.repeat([robot.length, 1.0], 3)  # of velocities [m], of angular velocities [rad]
    return twists / units[:, None] * robot.column_scale


def centres_of_mass(robot: Mechanism, q: Array) -> Array:
    """Compute velocities (3 b, nv) of the centres of the b bodies with mass [lengths of the robot]."""
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, q)
    velocities = [np.empty((0, model.nv))]
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        if body.mass > 0.0:
            twists = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, model.nv)
            velocities.append(twists[:3] - pin.skew(body.lever) @ twists[3:])  # v + w x lever
    return np.concatenate(velocities) / robot.length * robot.column_scale


def _name_stuck_axes(stuck: Array, names: tuple[str, ...]) -> str:
    """Return the names of the axes in stuck combinations (n, k): each alone, or some together."""
    shares = dict(zip(names, np.linalg.norm(stuck, axis=1), strict=True))
    alone = [name for name, share in shares.items() if share > 1.0 - FILE_ROUNDING]
    if len(alone) == stuck.shape[1]:
        return ", ".join(alone)
    together = " and ".join(
        name for name, share in shares.items() if FILE_ROUNDING < share <= 1.0 - FILE_ROUNDING
    )
    return ", ".join([*alone, f"{together} independently of each other"])


def null_space(matrix: Array) -> Array:
    """Compute orthonormal columns (c, k) of the null space of a matrix (r, c)."""
    return split_space(matrix, FILE_ROUNDING)[1]


def split_space(matrix: Array, level: float) -> tuple[Array, Array]:
    """Compute orthonormal columns of the row space and of the null space, singular values to a level."""
    _, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > level))
    return right[:rank].T, right[rank:].T


def _pivots(motions: Array, excluded: tuple[int, ...] = ()) -> tuple[int, ...]:
    """Return k joints, ascending, whose rates determine k motions (nv, k), none of the excluded ones."""
    if not motions.shape[1]:
        return ()
    joints = np.setdiff1d(np.arange(len(motions)), excluded)
    pivots = row_pivots(motions[joints])[: motions.shape[1]]
    return tuple(np.sort(joints[pivots]).tolist())
