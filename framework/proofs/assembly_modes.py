"""All poses of the platform for given motors: the assembly modes, each proved, and their number.

Where every leg asks a linear condition of the platform's displacement (`find_leg_conditions`: rods between
two points, whatever drives them), these make a system of quadrics with a known bound on its solutions: 40 for
six legs in space, 8 for three about a point, 6 for three in a plane, 2 for points on circles or spheres. All
its complex solutions are led from those of a random system (`homotopy`), and each is enclosed by the test of
Krawczyk: one solution there and no other, for all coefficients within their rounding. In which sense the real
ones are all is the `status`:

proved                     as many as the bound are proved and apart, or all joints are paved: there are no
                           others
numerically complete       as many paths as the bound end at solutions that are apart, the real ones proved,
                           or leave for infinity by their growth (symmetric platforms have fewer poses than
                           the bound); up to four times tried, and paths are followed without a proof
at least                   paths end at solutions that are not single, or are lost; or there is no known bound
architecturally singular   in every pose the conditions depend on one another: no pose is isolated

For all other robots closed poses are sought from many starts, and enclosed by the theorem of Newton and
Kantorovich. Where few joints follow the motors, these are paved (`leg_paving`), which proves that there are
no others; else their number is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.closures import find_flipped_closure
from framework.kinematics.continuation.forward_kinematics import motor_joints_of, motors_are_free
from framework.kinematics.frames import difference, frames_at, integrate_columns
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

RANDOM_STARTS = 300  # of the joints, where poses of the platform are not known


@dataclass(frozen=True, eq=False)
class AssemblyMode(ReadOnlyArrays):
    """A pose of the robot at the given motor angles."""

    q: Array  # (nq,)
    x: Array  # (n,)
    proved: bool  # that the pose exists and is single in a neighbourhood


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """The assembly modes found, the nearest to the reference first."""

    modes: tuple[AssemblyMode, ...]
    status: Status  # in which sense they are all
    bound: int | None  # on isolated complex solutions; None where none is known
    count: PathCount | None  # None without a homotopy
    method: str

    @property
    def complete(self) -> bool:
        """Whether all modes are proved to be known."""
        return self.status == "proved"

    @property
    def sentence(self) -> str:
        """The number of modes, the kind of proof, and the method, in a sentence."""
        if self.status == "architecturally singular":
            return f"none is isolated: the robot is architecturally singular; {self.method}"
        proved = sum(mode.proved for mode in self.modes)
        bound = "" if self.bound is None else f" of at most {self.bound}"
        count = f"{len(self.modes)} real{bound}"
        if self.status == "at least":
            count = f"at least {proved} real{bound}"
        if self.status == "numerically complete":
            count += ", complete up to numerical path tracking"
        rest = "" if proved == len(self.modes) else f", {len(self.modes) - proved} found and not proved"
        return f"{count}, each proved to exist and to be single{rest}; {self.method}"


def assembly_modes(robot: ParallelRobot, q_a: ArrayLike) -> AssemblyModes:
    """Find all poses of the robot with motor joints q_a (n_a,) [rad, m].

    Joint side of the gears, springs at rest. Poses of the platform count: joints inside a leg that turn over
    while it stays are one mode.

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
    """Return the modes at the platform displacements that solve the legs' conditions.

    q (1, nq) has the motors in place. A displacement R, p takes the reference's frame to R position + p,
    R rotation; a translation takes its origin to position + p.
    """
    reference_frames = frames_at(robot, robot.reference.q[None])
    position = reference_frames.position[0, 0]
    rotation = reference_frames.rotation[0, 0]
    p = solutions.p * robot.length
    family = conditions.group.family
    if family.name == "translations":
        closed = find_joints_at_poses(robot, q, position + p, None)
    else:
        closed = find_joints_at_poses(robot, q, solutions.R @ position + p, solutions.R @ rotation)
    modes = []
    for pose, proved in zip(closed, solutions.proved, strict=True):
        if pose is not None:
            x = robot.platform.coordinates(frames_at(robot, pose[None]))
            modes.append(AssemblyMode(pose, robot.platform.unwrap(x, robot.reference.x)[0], bool(proved)))
    modes.sort(key=lambda mode: distance_from_reference(robot, mode.q))
    # a solution without joints would be one of the conditions that are not the legs' own
    status = solutions.status if len(modes) == len(solutions.R) else "at least"
    method = f"homotopy in {family.name}: {solutions.count.sentence}"
    return AssemblyModes(tuple(modes), status, family.bound, solutions.count, method)


def _search_modes(robot: ParallelRobot, q: Array) -> AssemblyModes:
    """Search modes from random starts, motors as in q (1, nq); one per platform pose."""
    poses, closed = close_all_loops(robot, draw_starts(robot, q, RANDOM_STARTS), None)
    candidates = sorted(remove_whole_turns(robot, poses[closed]), key=partial(distance_from_reference, robot))
    modes: list[AssemblyMode] = []
    scale = robot.platform_scale
    for pose in candidates:
        frames = frames_at(robot, pose[None])
        x = robot.platform.unwrap(robot.platform.coordinates(frames), robot.reference.x)[0]
        offsets = [robot.platform.residual(frames, mode.x[None])[0] / scale for mode in modes]
        is_new = all(np.abs(offset).max() > DISTINCT_SOLUTIONS for offset in offsets)
        if is_new and find_flipped_closure(robot, frames) is None:
            modes.append(AssemblyMode(pose, x, has_one_solution_near(robot, pose)))
    complete = all(mode.proved for mode in modes) and _has_no_other_poses(robot, q[0], candidates)
    status: Status = "proved" if complete else "at least"
    paved = ", joints paved" if status == "proved" else ""
    return AssemblyModes(
        tuple(modes), status, None, None, f"{RANDOM_STARTS} starts of Newton's method{paved}"
    )


def _has_no_other_poses(robot: ParallelRobot, q: Array, poses: list[Array]) -> bool:
    """Return whether the loops provably close in no other poses than `poses` (nq,).

    Motors are as in q (nq,). All joints that follow the motors are paved as if they were one leg.
    """
    joints = robot.following
    is_fixed = ~np.isin(np.arange(robot.model.nv), joints)
    offsets = difference(robot, q, np.reshape(poses, (-1, len(q))))[:, joints] / robot.column_scale[joints]
    return are_leg_solutions_complete(robot, joints, is_fixed, q, offsets[distinct_rows(offsets)], None)
