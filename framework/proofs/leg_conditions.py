"""The conditions of each leg on the platform's pose while the motors are locked, linear in displacements.

A leg is a chain of joints from the base to the platform: of the tree and of one or more closures. Its passive
joints are moved at random and the platform's displacements noted; what linear condition on the functions of
`study_quadric` they all meet is the null space of that table. A rod between two points gives one such
condition, whatever joints it has at its ends; nobody has to say which leg is a rod. Legs that ask for
something else give too few conditions, and then there is no system to solve.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal
from framework.model.description import AXES, Closure
from framework.model.loop_rows import ROW_KINDS
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.proofs.equation_terms import planar_axis
from framework.proofs.passive_joints import draw_starts
from framework.proofs.study_quadric import (
    Displacements,
    displacement_functions,
    planar_displacements,
    spatial_displacements,
    spherical_displacements,
    translation_displacements,
)
from framework.tolerances import LEG_COEFFICIENT_ROUNDING, RANK_ROUNDING

SAMPLE_POSES = 60  # poses of a leg: three for each of the functions
MAX_LEGS = 32
RANDOM_SEED = 3


@dataclass(frozen=True, eq=False)
class LegConditions(ReadOnlyArrays):
    """Linear conditions (K, M) on the platform's displacement, motors locked."""

    group: Displacements
    coefficients: Array  # (K, M) of unit size, lengths in lengths of the robot
    rounding: float  # of the coefficients, relative to the largest of their condition


class _Edge(NamedTuple):
    """A joint of the tree or a closure, from one body to another."""

    to: int
    joint: int  # of the tree; 0 for a closure
    closure: Closure | None
    forward: bool


def find_leg_conditions(robot: ParallelRobot, q: Array) -> LegConditions | None:
    """Find the conditions of all legs, motors as in q (nq,); None if too few.

    A leg's conditions are the null space of a table: rows are random poses of the leg, columns the functions
    of the platform's displacement there.
    """
    group = _displacement_group(robot)
    if group is None:
        return None
    K = group.family.equations
    M = len(group.chosen)
    sampler = _Sampler.of(robot, q, of_point=group.family.name == "translations")
    conditions = [np.zeros((0, M))]
    rounding = 0.0
    for count, chain in enumerate(_leg_chains(robot)):
        poses = sampler.sample_displacements(chain) if count < MAX_LEGS else None
        if poses is None:
            return None
        table = displacement_functions(*poses)[:, group.chosen]  # (SAMPLE_POSES, M)
        sizes, right = np.linalg.svd(table)[1:]
        rank = int(np.sum(sizes > RANK_ROUNDING * sizes[0]))
        rounding = max(rounding, LEG_COEFFICIENT_ROUNDING * float(sizes[0] / sizes[rank - 1]))
        conditions.append(right[rank:])  # the null space of the table
    rows = np.concatenate(conditions)
    if not len(rows) or np.linalg.matrix_rank(rows, rtol=RANK_ROUNDING) < K:
        return None
    if len(rows) > K:  # more conditions than freedoms: as many as needed, mixed
        rows = np.random.default_rng(RANDOM_SEED).standard_normal((K, len(rows))) @ rows
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return LegConditions(group, rows, rounding)


def _displacement_group(robot: ParallelRobot) -> Displacements | None:
    """Choose the group of the platform's displacements; None without a known family."""
    if not len(robot.following) or robot.rows.has_couplings:
        return None
    if planar_normal(robot) is not None:
        axis = planar_axis(robot)
        moves_in_plane = axis not in robot.platform.along and len(robot.platform.sliding) == 2
        if axis is None or not moves_in_plane:
            return None
        if robot.n == 2:
            return translation_displacements(tuple(sorted(int(k) for k in robot.platform.along)))
        return planar_displacements(axis) if robot.n == 3 else None
    if robot.n == 3 and not robot.translations.any():
        return spherical_displacements()
    return spatial_displacements() if robot.translations.any() else None


def _leg_chains(robot: ParallelRobot) -> Iterator[list[_Edge]]:
    """Yield all chains from the base to the platform's body that pass no body twice."""
    model = robot.model
    edges: list[list[_Edge]] = [[] for _ in range(model.njoints)]  # from each body

    def connect(first: int, second: int, joint: int, closure: Closure | None) -> None:
        edges[first].append(_Edge(second, joint, closure, True))
        edges[second].append(_Edge(first, joint, closure, False))

    for joint in range(1, model.njoints):
        connect(model.parents[joint], joint, joint, None)
    for closure in robot.description.closures:
        first, second = (model.frames[model.getFrameId(name)].parentJoint for name in closure.frames)
        connect(first, second, 0, closure)
    platform = model.frames[robot.frames[0]].parentJoint

    def continue_chain(body: int, passed: frozenset[int]) -> Iterator[list[_Edge]]:
        """Return all continuations from a body to the platform that pass no body twice."""
        if body == platform:
            yield []
            return
        for edge in edges[body]:
            if edge.to not in passed:
                for rest in continue_chain(edge.to, passed | {edge.to}):
                    yield [edge, *rest]

    yield from continue_chain(0, frozenset({0}))


class _Sampler(NamedTuple):
    """Draws random poses of chains."""

    robot: ParallelRobot
    links: list[list[pin.SE3]]  # of every joint against its parent, motors and springs locked, at random
    reference: pin.SE3  # of the platform's frame
    normal: Array | None  # (3,) of a planar robot, base axes
    data: pin.Data  # at the reference
    of_point: bool  # the platform is a point: its displacement is that of the frame's origin

    @staticmethod
    def of(robot: ParallelRobot, q: Array, *, of_point: bool) -> _Sampler:
        """Draw SAMPLE_POSES poses of all joints, motors locked.

        Passive joints move by up to half a turn or a robot length.
        """
        model = robot.model
        data = model.createData()
        links = []
        for pose in draw_starts(robot, q[None], SAMPLE_POSES):
            pin.forwardKinematics(model, data, pose)
            links.append([pin.SE3(placement) for placement in data.liMi])
        pin.framesForwardKinematics(model, data, robot.reference.q)
        return _Sampler(
            robot, links, pin.SE3(data.oMf[robot.frames[0]]), planar_normal(robot), data, of_point
        )

    def sample_displacements(self, chain: list[_Edge]) -> tuple[Array, Array] | None:
        """Sample platform displacements R (T, 3, 3), p (T, 3) [robot lengths].

        The platform is at the end of a chain. None where a closure allows no group of motions to draw from.
        """
        R = np.empty((SAMPLE_POSES, 3, 3))
        p = np.empty((SAMPLE_POSES, 3))
        rng = np.random.default_rng(RANDOM_SEED)
        frame = self.robot.model.frames[self.robot.frames[0]]
        for k in range(SAMPLE_POSES):
            pose = pin.SE3.Identity()
            for edge in chain:
                step = self.links[k][edge.joint]
                if edge.closure is not None:
                    step = self._draw_closure_pose(edge.closure, rng)
                if step is None:
                    return None
                pose = pose * (step if edge.forward else step.inverse())
            pose = pose * frame.placement
            displacement = pose * self.reference.inverse()
            R[k] = displacement.rotation
            p[k] = displacement.translation / self.robot.length
            if self.of_point:
                p[k] = (pose.translation - self.reference.translation) / self.robot.length
        return R, p

    def _draw_closure_pose(self, closure: Closure, rng: np.random.Generator) -> pin.SE3 | None:
        """Draw a pose that a closure allows, of its second body in its first.

        Offsets along locked axes are zero, turns about free axes random; a closure with a length keeps it. In
        a plane a closure with all turns free turns about the normal alone. None if the motions are no group:
        with two free turns, or several distances.
        """
        ends = [self.robot.model.getFrameId(name) for name in closure.frames]
        placements = [self.robot.model.frames[k].placement for k in ends]
        locked_shifts, locked_turns = np.isin(AXES, closure.axes).reshape(2, 3)
        free_turns = 3 - np.count_nonzero(locked_turns)
        distances = [ROW_KINDS[name] for name in closure.axes if name in ROW_KINDS]
        if free_turns == 2 or len(distances) > 1:
            return None
        offset = rng.uniform(-1, 1, 3) * self.robot.length
        offset[locked_shifts] = 0.0
        turn = rng.uniform(-np.pi, np.pi, 3)  # a rotation vector, in the first frame
        if free_turns == 3 and self.normal is not None:
            R_a, R_b = (self.data.oMf[k].rotation for k in ends)
            normal = R_a.T @ self.normal  # in the first frame
            if distances:
                offset -= normal * (normal @ offset)
            rotation = pin.exp3(normal * turn[0]) @ R_a.T @ R_b
        else:
            turn[locked_turns] = 0.0
            rotation = pin.exp3(turn)
        for distance in distances:
            assert closure.length is not None
            offset = distance.satisfy(offset, closure.length)
        return placements[0] * pin.SE3(rotation, offset) * placements[1].inverse()
