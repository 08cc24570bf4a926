"""All poses of the platform for given motor joints: the assembly modes, each proved, and their number.

A leg is a chain from the base to the platform, made of joints of the tree and of one or more closures. Its
passive joints are moved at random, and the functions of `study_quadric` are evaluated at the resulting
displacements of the platform. The null space of this table contains the linear conditions that all
displacements satisfy. A rod between two points gives one condition, whatever joints it has at its ends, so
rods are recognised without being declared.

If the legs give enough conditions, these are a system of quadrics with a known bound on the number of
solutions: 40 for six legs in space, 8 for three about a point, 6 for three in a plane, 2 for points on
circles or spheres. `homotopy` finds all real solutions. The `status` says in which sense they are all:

proved                     as many solutions as the bound are proved and pairwise apart, or the joints are
                           paved: there are no others
numerically complete       as many paths as the bound end at solutions that are apart, the real ones proved,
                           or grow like paths to infinity (symmetric platforms have fewer poses than the
                           bound). Path tracking is not proved; while paths are lost all are tracked again,
                           up to four times in all
at least                   some paths are lost or end at multiple solutions, or no bound is known
architecturally singular   the conditions depend on one another in every pose: no pose is isolated

If the legs give too few conditions, Newton's method searches closed poses from many starts, leg by leg
(`leg_solutions`), and Krawczyk's test proves each. If only few joints of each leg follow the motors, paving
these joints proves that there are no other poses; otherwise the number found is a lower bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.continuation.forward_kinematics import motor_joints_of, motors_are_free
from framework.kinematics.frames import FrameStack, frames_at, integrate_columns
from framework.kinematics.mechanism import frame_index
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.model.description import AXES, Closure
from framework.model.loop_rows import ROW_KINDS
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.proofs.equation_terms import planar_axis
from framework.proofs.homotopy import PathCount, RealSolutions, Status, find_real_solutions
from framework.proofs.leg_solutions import shown_places, solve_legs
from framework.proofs.passive_joints import (
    RANDOM_STARTS,
    distance_from_reference,
    distinct_rows,
    draw_starts,
    find_joints_at_pose,
    has_one_solution_near,
    remove_whole_turns,
    turn_within_ranges,
)
from framework.proofs.study_quadric import (
    Displacements,
    displacement_functions,
    planar_displacements,
    spatial_displacements,
    spherical_displacements,
    translation_displacements,
)
from framework.tolerances import LEG_COEFFICIENT_ROUNDING, RANK_ROUNDING

SAMPLE_POSES = 60  # of a leg: more than three for each of the 17 functions
STARTS_AT_POSE = 48  # of Newton's method for the joints at one pose of the platform


@dataclass(frozen=True, eq=False)
class AssemblyMode(ReadOnlyArrays):
    """A pose of the robot at the given motor joints."""

    q: Array  # (nq,) configuration
    x: Array  # (n,) platform coordinates, angles within half a turn of the reference
    proved: bool  # to exist, and to be the only pose in a neighbourhood


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """The assembly modes found, the nearest to the reference first."""

    modes: tuple[AssemblyMode, ...]
    status: Status  # in which sense the modes found are all
    bound: int | None  # on the number of isolated complex solutions, if known
    count: PathCount | None  # how the paths of the homotopy end; None without one
    method: str  # clause with the method and its effort

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

    q_a is on the joint side of the gears; springs are at rest. Poses are distinct if joints are, except for
    universal joints and rods that have turned over without moving a line (`leg_solutions`).

    Raises:
        InvalidInput: q_a has the wrong length or is not finite, or the motors depend on one another.
    """
    target = motor_joints_of(robot, q_a)
    if not motors_are_free(robot):
        raise InvalidInput(f"{robot.name}: its motors depend on one another: none of them can be given alone")
    reference = robot.reference.q
    motor_step = target - robot.actuated_coordinates(reference[None])[0]
    q = integrate_columns(robot, reference, robot.actuated, motor_step)  # loops open

    conditions = find_leg_conditions(robot, q)
    if conditions is None:
        # Newton's method from random starts, leg by leg; no bound is known, and there are no homotopy paths
        solutions = solve_legs(robot, q, robot.following, None)
        modes = _modes_of(
            robot, list(solutions.q), [has_one_solution_near(robot, pose) for pose in solutions.q]
        )
        method = f"{RANDOM_STARTS} starts of Newton's method"
        status: Status = "at least"
        if solutions.are_all and all(mode.proved for mode in modes):
            status = "proved"
            method += ", joints paved"
        return AssemblyModes(modes, status, bound=None, count=None, method=method)
    return _modes_at_displacements(robot, q, conditions[0], find_real_solutions(*conditions))


def _modes_at_displacements(
    robot: ParallelRobot, q: Array, group: Displacements, solutions: RealSolutions
) -> AssemblyModes:
    """Find the modes at the platform displacements of a group that solve the leg conditions.

    The motors stay as in q (nq,). A displacement (R, p) moves the platform's frame from its reference pose
    (position, rotation) to (R position + p, R rotation). If the platform only translates, R = 1, and the
    rotation is left free. At each displacement the joints may have several solutions. The translations of the
    `solutions` are in robot lengths.
    """
    reference_frames = frames_at(robot, robot.reference.q[None])
    position = reference_frames.position[0, 0]  # (3,) of the platform's frame, number 0
    rotation = reference_frames.rotation[0, 0]  # (3, 3)
    status = solutions.status
    poses = list[Array]()
    proved = list[bool]()
    for R, p, is_proved in zip(solutions.R, solutions.p, solutions.proved, strict=True):
        target_rotation = None if group.only_translates else R @ rotation  # None leaves it free
        pose = find_joints_at_pose(robot, q, R @ position + p * robot.length, target_rotation)
        if pose is None:
            # Leg conditions come from sampled poses. If the joints of a displacement are not found, the
            # conditions may differ from the loops, and these modes are not proved to be all.
            status = "at least"
            continue
        x = _platform_coordinates(robot, frames_at(robot, pose[None]))
        joints = solve_legs(robot, q, robot.following, x, start_count=STARTS_AT_POSE)
        poses += [pose, *joints.q]
        proved += [bool(is_proved)] * (1 + len(joints.q))
        if not joints.are_all and (status == "proved" or len(joints.q) > 1):
            status = "at least"
    method = f"homotopy in {group.name}: {solutions.count.sentence}"
    return AssemblyModes(_modes_of(robot, poses, proved), status, group.bound, solutions.count, method)


def _modes_of(
    robot: ParallelRobot, poses: Sequence[Array], proved: Sequence[bool]
) -> tuple[AssemblyMode, ...]:
    """Return the modes of `poses` (nq,), those that show the same once, nearest to the reference first."""
    if not poses:
        return ()
    turned = remove_whole_turns(robot, np.array(poses))
    distances = [distance_from_reference(robot, pose) for pose in turned]
    order = np.argsort(distances, kind="stable")
    distinct = order[distinct_rows(shown_places(robot, turned[order]))]
    x = [_platform_coordinates(robot, frames_at(robot, pose[None])) for pose in turned]
    within = turn_within_ranges(robot, turned, robot.passive)
    return tuple(AssemblyMode(within[k], x[k], proved[k]) for k in distinct)


def _platform_coordinates(robot: ParallelRobot, frames: FrameStack) -> Array:
    """Return the platform's coordinates (n,) in one pose, angles within half a turn of the reference."""
    return robot.platform.unwrap(robot.platform.coordinates(frames), robot.reference.x)[0]


# ------------------------------------------------------------------ conditions of the legs


class _Edge(NamedTuple):
    """A joint of the tree or a closure, from one body to another."""

    start: int  # body
    end: int  # body
    joint: int  # of the tree; 0 for a closure
    closure: Closure | None  # None for a joint of the tree
    forward: bool  # from parent to child, or from a closure's first frame to its second


def find_leg_conditions(robot: ParallelRobot, q: Array) -> tuple[Displacements, Array, float] | None:
    """Find the conditions of all legs, motors as in q (nq,); None if too few.

    The conditions of a leg span the null space of a table with a row for each random pose of the leg, and a
    column for each function of the platform's displacement.

    Returns:
        The group with its M functions; K conditions (K, M), each row of unit size, lengths in robot lengths;
        the error of the coefficients, relative to the largest coefficient of each condition.
    """
    max_legs = 32  # a robot with more chains from the base to the platform has no conditions
    group = _displacement_group(robot)
    if group is None:
        return None
    sampler = _Sampler.of(robot, q)
    conditions = list[Array]()
    rounding = 0.0
    for count, chain in enumerate(_leg_chains(robot)):  # each chain is a leg
        if count == max_legs or not all(_motions_are_group(edge.closure) for edge in chain):
            return None
        # conditions are the combinations of the group's functions that are zero in all poses of the leg
        R, p = sampler.sample_displacements(chain, group.only_translates)
        null_space, condition_number = _null_space(displacement_functions(R, p)[:, group.chosen])
        conditions.append(null_space)
        rounding = max(rounding, LEG_COEFFICIENT_ROUNDING * condition_number)
    rows = np.concatenate(conditions)
    K = group.equations  # number of conditions that have isolated solutions
    if len(rows) < K or np.linalg.matrix_rank(rows, rtol=RANK_ROUNDING) < K:
        return None  # too few, or too few that are independent
    if len(rows) > K:  # the homotopy needs K conditions: random combinations keep all solutions
        rows = np.random.default_rng(1).standard_normal((K, len(rows))) @ rows
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return group, rows, rounding


def _null_space(table: Array) -> tuple[Array, float]:
    """Return an orthonormal basis of a table's null space, and the condition number of its row space.

    The table has the shape (poses, M), the basis the shape (M - rank, M). The condition number is the ratio
    of the largest to the least singular value above rounding.
    """
    _, singular_values, V_rows = np.linalg.svd(table)
    rank = np.count_nonzero(singular_values > RANK_ROUNDING * singular_values[0])
    return V_rows[rank:], singular_values[0] / singular_values[rank - 1]


def _displacement_group(robot: ParallelRobot) -> Displacements | None:
    """Choose the group of the platform's displacements; None if `study_quadric` has none.

    A planar robot has to move normal to a base axis, with both translations in the plane: alone (n = 2) or
    with the rotation (n = 3). Robots without joints that follow the motors, or with couplings, have no group.
    """
    if not robot.n_p or robot.rows.has_couplings:
        return None
    if planar_normal(robot) is not None:
        axis = planar_axis(robot)  # normal to the plane
        translations = robot.platform.along.tolist()  # base axes along which the platform translates
        if axis is None or axis in translations or len(translations) != 2:
            return None
        if robot.n == 2:
            return translation_displacements(tuple(sorted(translations)))
        return planar_displacements(axis) if robot.n == 3 else None

    if robot.n == 3 and not robot.translations.any():
        return spherical_displacements()
    return spatial_displacements() if robot.translations.any() else None


def _leg_chains(robot: ParallelRobot) -> Iterator[list[_Edge]]:
    """Yield all chains of edges from the base to the platform's body that visit no body twice.

    An edge is a joint of the tree or a closure, in one of both directions. Bodies have the numbers of the
    joints of the tree that carry them; the base is body 0. The search is depth first.
    """
    model = robot.model
    forward = [
        _Edge(model.parents[joint], joint, joint, closure=None, forward=True)
        for joint in range(1, model.njoints)
    ]
    for closure in robot.description.closures:
        first, second = (model.frames[frame_index(model, name)].parentJoint for name in closure.frames)
        forward.append(_Edge(first, second, joint=0, closure=closure, forward=True))  # no joint of the tree
    edges = list[_Edge]()  # in both directions
    for edge in forward:
        edges += [edge, edge._replace(start=edge.end, end=edge.start, forward=False)]

    platform = model.frames[robot.frames[0]].parentJoint  # the platform's frame is the robot's first one
    pending: list[list[_Edge]] = [[]]  # chains that begin at the base, the next one first
    while pending:
        chain = pending.pop(0)
        bodies = [0, *(edge.end for edge in chain)]
        if bodies[-1] == platform:
            yield chain
        else:
            next_edges = [edge for edge in edges if edge.start == bodies[-1] and edge.end not in bodies]
            pending = [[*chain, edge] for edge in next_edges] + pending


def _motions_are_group(closure: Closure | None) -> bool:
    """Return whether the relative motions that a closure allows form a group; True for a joint (None).

    They do not if exactly two rotations are free, as two such motions in a row may turn about any axis, or if
    several distances are prescribed.
    """
    if closure is None:
        return True
    free_turns = np.isin(AXES[3:], closure.axes, invert=True)
    return np.count_nonzero(free_turns) != 2 and len(ROW_KINDS.keys() & closure.axes) <= 1


class _Sampler(NamedTuple):
    """Draws random poses of chains of joints and closures."""

    robot: ParallelRobot
    placements: list[list[pin.SE3]]  # in each of SAMPLE_POSES poses, of every joint in its parent
    normal: Array | None  # (3,) normal to the plane of a planar robot, on base axes; None in space
    data: pin.Data  # with the frames of the reference

    @staticmethod
    def of(robot: ParallelRobot, q: Array) -> _Sampler:
        """Draw SAMPLE_POSES poses of all joints, motors and springs locked as in q (nq,).

        Passive joints move by up to half a turn or a robot length.
        """
        data = robot.model.createData()
        placements = []
        for pose in draw_starts(robot, q, robot.passive, SAMPLE_POSES):
            pin.forwardKinematics(robot.model, data, pose)
            placements.append([pin.SE3(placement) for placement in data.liMi])
        pin.framesForwardKinematics(robot.model, data, robot.reference.q)
        return _Sampler(robot, placements, planar_normal(robot), data)

    def sample_displacements(self, chain: list[_Edge], only_translates: bool) -> tuple[Array, Array]:
        """Sample displacements R (T, 3, 3), p (T, 3) [robot lengths] of the platform, moved by one chain.

        The poses along the chain are multiplied, from the base to the platform. Joints are placed as drawn
        before, closures are drawn now. If the platform `only_translates`, p is the translation of its frame's
        origin.
        """
        rng = np.random.default_rng(1)  # a fixed seed, so that results are the same in every run
        platform = self.robot.frames[0]
        reference = self.data.oMf[platform]
        rotations = []
        translations = []
        for placements in self.placements:
            pose = pin.SE3.Identity()  # of the body reached, from the base
            for edge in chain:
                step = placements[edge.joint]
                if edge.closure is not None:
                    step = self._draw_closure_pose(edge.closure, rng)
                pose = pose * (step if edge.forward else step.inverse())
            pose = pose * self.robot.model.frames[platform].placement  # of the platform's frame
            displacement = pose * reference.inverse()
            rotations.append(displacement.rotation)
            origin_shift = pose.translation - reference.translation
            translations.append(origin_shift if only_translates else displacement.translation)
        return np.array(rotations), np.array(translations) / self.robot.length

    def _draw_closure_pose(self, closure: Closure, rng: np.random.Generator) -> pin.SE3:
        """Draw a pose that a closure allows, of the second body in the first.

        Offsets along free axes and rotations about free axes are drawn, those along locked axes are zero. A
        closure with a length keeps the length. In a planar robot a closure with three free rotations turns
        about the normal alone, away from its attitude at the reference.
        """
        ends = [frame_index(self.robot.model, name) for name in closure.frames]
        placements = [self.robot.model.frames[k].placement for k in ends]
        locked_shifts, locked_turns = np.isin(AXES, closure.axes).reshape(2, 3)  # x, y, z; rx, ry, rz
        distances = [ROW_KINDS[name] for name in closure.axes if name in ROW_KINDS]
        # draw the offset between the frames' origins and the rotation vector, both in the first frame
        offset = rng.uniform(-1, 1, 3) * self.robot.length
        offset[locked_shifts] = 0.0
        turn = rng.uniform(-np.pi, np.pi, 3)

        if self.normal is None or locked_turns.any():
            turn[locked_turns] = 0.0
            rotation = pin.exp3(turn)
        else:
            R_a, R_b = (self.data.oMf[k].rotation for k in ends)  # of both frames at the reference
            normal = R_a.T @ self.normal  # in the first frame
            if distances:
                offset -= normal * (normal @ offset)  # in the plane
            # turn by one of the random angles, away from the attitude of the second frame in the first
            rotation = pin.exp3(normal * turn[0]) @ R_a.T @ R_b

        for distance in distances:
            assert closure.length is not None
            offset = distance.satisfy(offset, closure.length)
        return placements[0] * pin.SE3(rotation, offset) * placements[1].inverse()
