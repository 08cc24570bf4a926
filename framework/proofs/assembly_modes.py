"""All poses of the platform for given motor joints: the assembly modes, each proved, and their number.

A leg that is a rod between two points, however it is driven, imposes a linear condition on the platform's
displacement (`find_leg_conditions`). If all legs do, their conditions are a system of quadrics with a known
bound on the number of solutions: 40 for six legs in space, 8 for three about a point, 6 for three in a plane,
2 for points on circles or spheres. `homotopy` continues all complex solutions of a random system to solutions
of this one, and Krawczyk's test encloses each: the enclosure holds exactly one solution, for all coefficients
within their rounding. The `status` says in which sense the real solutions are all:

proved                     as many solutions as the bound are proved and pairwise apart, or the joints are
                           paved: there are no others
numerically complete       as many paths as the bound end at solutions that are apart, the real ones proved,
                           or grow like paths to infinity (symmetric platforms have fewer poses than the
                           bound). Path tracking is not proved; while paths are lost all are tracked again,
                           up to four times in all
at least                   some paths are lost or end at multiple solutions, or no bound is known
architecturally singular   the conditions depend on one another in every pose: no pose is isolated

For all other robots Newton's method searches closed poses from many starts, and the Newton-Kantorovich
theorem proves each. If only few joints follow the motors, paving these joints (`leg_paving`) proves that
there are no other poses; otherwise the number found is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.closures import find_flipped_closure
from framework.kinematics.continuation.forward_kinematics import motor_joints_of, motors_are_free
from framework.kinematics.frames import FrameStack, difference, frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.proofs.leg_conditions import LegConditions, find_leg_conditions
from framework.proofs.leg_paving import are_leg_solutions_complete
from framework.proofs.passive_joints import (
    close_all_loops,
    distance_from_reference,
    distinct_rows,
    draw_starts,
    find_joints_at_poses,
    has_one_solution_near,
    remove_whole_turns,
)
from framework.proofs.real_displacements import PathCount, RealSolutions, Status, find_real_solutions
from framework.tolerances import DISTINCT_SOLUTIONS

RANDOM_STARTS = 300  # of Newton's method, for robots without linear leg conditions


@dataclass(frozen=True, eq=False)
class AssemblyMode(ReadOnlyArrays):
    """A pose of the robot at the given motor joints."""

    q: Array  # (nq,)
    x: Array  # (n,)
    proved: bool  # to exist, and to be the only pose in a neighbourhood


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """The assembly modes found, the nearest to the reference first."""

    modes: tuple[AssemblyMode, ...]
    status: Status  # in which sense the modes found are all
    bound: int | None  # on the number of isolated complex solutions, if known
    count: PathCount | None  # None without a homotopy
    method: str

    @property
    def complete(self) -> bool:
        """Whether all modes are provably found."""
        return self.status == "proved"

    @property
    def sentence(self) -> str:
        """Sentence with the number of modes, the kind of proof and the method."""
        if self.status == "architecturally singular":
            return f"none is isolated: the robot is architecturally singular; {self.method}"
        proved = sum(mode.proved for mode in self.modes)
        bound = "" if self.bound is None else f" of at most {self.bound}"
        count = f"{len(self.modes)} real{bound}"
        if self.status == "at least":
            count = f"at least {proved} real{bound}"
        elif self.status == "numerically complete":
            count += ", complete up to numerical path tracking"
        unproved = "" if proved == len(self.modes) else f", {len(self.modes) - proved} found and not proved"
        return f"{count}, each proved to exist and to be single{unproved}; {self.method}"


def assembly_modes(robot: ParallelRobot, q_a: ArrayLike) -> AssemblyModes:
    """Find all poses of the robot with motor joints q_a (n_a,) [rad, m].

    q_a is on the joint side of the gears; springs are at rest. Configurations with the same pose of the
    platform are one mode, even if joints inside a leg have turned over.

    Raises:
        InvalidInput: q_a has the wrong length or is not finite, or the motors depend on one another.
    """
    expect_robot(robot)
    target = motor_joints_of(robot, q_a)
    if not motors_are_free(robot):
        raise InvalidInput(f"{robot.name}: its motors depend on one another: none of them can be given alone")
    reference = robot.reference.q[None]
    q = integrate_columns(robot, reference, robot.actuated, target - robot.actuated_coordinates(reference))
    conditions = find_leg_conditions(robot, q[0])
    if conditions is None:
        return _search_modes(robot, q)
    solutions = find_real_solutions(conditions.group, conditions.coefficients, conditions.rounding)
    return _modes_at_displacements(robot, q, conditions, solutions)


def _modes_at_displacements(
    robot: ParallelRobot, q: Array, conditions: LegConditions, solutions: RealSolutions
) -> AssemblyModes:
    """Find the modes at the platform displacements that solve the leg conditions.

    The motors stay as in q (1, nq). A displacement (R, p) moves the platform's frame from its reference pose
    (position, rotation) to (R position + p, R rotation). If the platform only translates, R = 1, and the
    rotation is left free.
    """
    reference_frames = frames_at(robot, robot.reference.q[None])
    position = reference_frames.position[0, 0]
    rotation = reference_frames.rotation[0, 0]
    p = solutions.p * robot.length
    rotations = None if conditions.group.only_translates else solutions.R @ rotation
    poses = find_joints_at_poses(robot, q, solutions.R @ position + p, rotations)
    modes = list[AssemblyMode]()
    for pose, proved in zip(poses, solutions.proved, strict=True):
        if pose is not None:
            x = _platform_coordinates(robot, frames_at(robot, pose[None]))
            modes.append(AssemblyMode(pose, x, bool(proved)))
    modes.sort(key=lambda mode: distance_from_reference(robot, mode.q))
    # Leg conditions come from sampled poses. If the joints of a displacement are not found, the conditions
    # may differ from the loops, and these modes are not proved to be all.
    status = solutions.status if len(modes) == len(solutions.R) else "at least"
    family = conditions.group.family
    method = f"homotopy in {family.name}: {solutions.count.sentence}"
    return AssemblyModes(tuple(modes), status, family.bound, solutions.count, method)


def _platform_coordinates(robot: ParallelRobot, frames: FrameStack) -> Array:
    """Return the platform's coordinates (n,) in one pose, angles within half a turn of the reference."""
    return robot.platform.unwrap(robot.platform.coordinates(frames), robot.reference.x)[0]


def _search_modes(robot: ParallelRobot, q: Array) -> AssemblyModes:
    """Search modes by Newton's method from random starts, with the motors as in q (1, nq)."""
    poses, closed = close_all_loops(
        robot, draw_starts(robot, q, robot.passive, RANDOM_STARTS), robot.following
    )
    candidates = sorted(remove_whole_turns(robot, poses[closed]), key=partial(distance_from_reference, robot))
    modes = list[AssemblyMode]()
    for pose in candidates:
        frames = frames_at(robot, pose[None])
        is_new = all(_are_poses_distinct(robot, frames, mode.x) for mode in modes)
        if is_new and find_flipped_closure(robot, frames) is None:
            x = _platform_coordinates(robot, frames)
            modes.append(AssemblyMode(pose, x, has_one_solution_near(robot, pose)))

    method = f"{RANDOM_STARTS} starts of Newton's method"
    if all(mode.proved for mode in modes) and _has_no_other_poses(robot, q[0], candidates):
        return AssemblyModes(tuple(modes), "proved", None, None, f"{method}, joints paved")
    return AssemblyModes(tuple(modes), "at least", None, None, method)


def _are_poses_distinct(robot: ParallelRobot, frames: FrameStack, x: Array) -> bool:
    """Return whether the platform in `frames` (one pose) is away from coordinates x (n,)."""
    offset = robot.platform.residual(frames, x[None])[0] / robot.platform_scale
    return bool(np.abs(offset).max() > DISTINCT_SOLUTIONS)


def _has_no_other_poses(robot: ParallelRobot, q: Array, poses: list[Array]) -> bool:
    """Return whether the loops provably close in no poses but `poses` (nq,).

    The motors are as in q (nq,). All joints that follow the motors are paved as if they were one leg.
    """
    joints = robot.following
    is_fixed = ~np.isin(np.arange(robot.model.nv), joints)
    candidates = np.reshape(poses, (-1, len(q)))  # (0, nq) without poses
    offsets = (difference(robot, q, candidates) / robot.column_scale)[:, joints]
    return are_leg_solutions_complete(robot, joints, is_fixed, q, offsets[distinct_rows(offsets)], None)
