"""Paths given in joints without motors, through which a robot changes its working mode.

Along a path of the platform a leg that is stretched cannot be followed further (Type 1). In passive joints
the same motion is regular where [selected joints; loops] has full rank: a stretched elbow is an angle like
any other. What remains singular is Type 2, where the motors lose hold, which plans cross. With a motor among
the joints Type 2 itself would look like Type 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice, product

import numpy as np

from framework.errors import FrameworkError, InvalidInput, NoLaw, check_choice
from framework.kinematics.continuation.tracking import track_path
from framework.kinematics.frames import difference
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import JointPlatform
from framework.laws.path import Line, Path
from framework.model.description import Platform
from framework.numerics.arrays import Array, Names
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import FILE_ROUNDING, SAME_PLACE

# sets of joints compared at both ends: all 4845 of four joints out of twenty, two decompositions each
MAX_SETS = 5000
# sets of joints, and lines in them, that are followed: they bound a search without success; of three hinges
# a set has up to eight ways around, so that the six best sets are tried on all
MAX_TRACKED_SETS, MAX_TRACKED = 8, 48
BRANCH_SAMPLES = 65  # of a line, for the least singular value; narrower dips go unseen


@dataclass(frozen=True)
class JointPath:
    """A path x(s) of the positions [rad, m] of joints without motors, as many as the platform has axes."""

    joints: Names
    path: Path


def passive_joints(robot: ParallelRobot) -> list[str]:
    """Return the names of the joints of one freedom without motor and spring."""
    joints = [robot.model.joints[k] for k in range(1, robot.model.njoints)]
    columns = set(robot.passive.tolist())
    names = list(robot.model.names)[1:]
    return [
        name for name, joint in zip(names, joints, strict=True) if joint.nv == 1 and joint.idx_v in columns
    ]


def with_platform_joints(robot: ParallelRobot, joints: Sequence[str]) -> ParallelRobot:
    """Return the robot with the positions of passive joints as its platform coordinates.

    Raises:
        InvalidInput: unknown joints, joints with a motor, or another number than the platform has axes.
        SingularReference: at the reference these joints do not determine the others.
    """
    valid = passive_joints(robot)
    names = tuple(joints)
    if names == robot.axis_names:
        return robot
    for name in names:
        if name in robot.actuator_names:
            raise InvalidInput(
                f"joints: {name} has a motor: in motors, what plans cross would end a path; valid: "
                f"{', '.join(valid)}"
            )
        check_choice("joints", name, valid)
    if len(set(names)) != robot.n or len(names) != robot.n:
        raise InvalidInput(
            f"joints: needs {robot.n} different ones, as many as the platform has axes, got {names}"
        )
    description = robot.description
    platform = Platform(description.platform.frame, joints=names)
    described = replace(description, platform=platform, scenes={})
    mechanism = replace(Mechanism.of(robot), description=described, q_near=robot.reference.q)
    return ParallelRobot.of(mechanism)


def choose_joint_path(robot: ParallelRobot, start: Array, goal: Array) -> JointPath:
    """Choose joints in which the line between two poses start, goal (nq,) is regular.

    Of the sets of passive joints, and of both ways around for hinges that turn by more than a quarter, the
    one with the largest least singular value of [selected joints; loops] along the line is taken.

    Raises:
        NoLaw: no line in a set of joints leads from one pose to the other.
    """
    names = passive_joints(robot)
    ends = np.stack([start, goal])
    sets = list(islice(combinations(names, robot.n), MAX_SETS))
    at_ends = np.array([_least_singular_value(robot, ends, joints) for joints in sets])
    best: tuple[float, JointPath] | None = None
    tracked = 0
    for k in np.argsort(-at_ends, kind="stable")[:MAX_TRACKED_SETS].tolist():
        if at_ends[k] <= SAME_PLACE:
            break
        try:
            selected = with_platform_joints(robot, sets[k])
        except FrameworkError:  # not regular at the reference
            continue
        for line in _lines_between(selected, start, goal)[: MAX_TRACKED - tracked]:
            tracked += 1
            try:
                branch = track_path(selected, line)
            except FrameworkError:
                continue
            q = branch.guess(np.linspace(0.0, 1.0, BRANCH_SAMPLES))
            if not _is_same_pose(robot, q[[0, -1]], ends):
                continue
            least = _least_singular_value(robot, q, sets[k])
            if best is None or least > best[0]:
                best = least, JointPath(sets[k], line)
    if best is None:
        raise NoLaw(
            f"{robot.name}: of {tracked} lines in joints without motors none leads from one pose to the other"
        )
    return best[1]


def _least_singular_value(robot: ParallelRobot, q: Array, joints: Sequence[str]) -> float:
    """Compute the least singular value of [selected joints; loops] at q (T, nq), dimensionless."""
    columns = [robot.model.joints[robot.model.getJointId(name)].idx_v for name in joints]
    selected = np.zeros((len(q), robot.n, robot.nv))
    selected[:, np.arange(robot.n), columns] = 1.0
    loops = linearised_at(robot, q).jacobian[:, robot.n :] * robot.column_scale
    matrix = np.concatenate([selected, loops / robot.loop_lengths[:, None]], axis=1)[:, :, robot.moving]
    return float(singular_values(matrix).min())


def _lines_between(robot: ParallelRobot, start: Array, goal: Array) -> list[Line]:
    """Return the lines in a robot's joints from start to goal (nq,), the shortest ways first."""
    assert isinstance(robot.platform, JointPlatform)
    a, b = start[robot.platform.q_indices], goal[robot.platform.q_indices]
    hinges = ~robot.translations
    nearest = np.where(hinges, (b - a + np.pi) % (2.0 * np.pi) - np.pi, b - a)
    around = nearest - 2.0 * np.pi * np.sign(nearest)
    ways = [
        (near, other) if turns and abs(near) > 0.5 * np.pi else (near,)
        for near, other, turns in zip(nearest, around, hinges, strict=True)
    ]
    changes = sorted((np.array(change) for change in product(*ways)), key=lambda change: np.abs(change).sum())
    return [Line(a, a + change) for change in changes if np.abs(change).max() > SAME_PLACE]


def _is_same_pose(robot: ParallelRobot, q: Array, expected: Array) -> bool:
    """Return whether poses q and expected (T, nq) are the same, but for whole turns."""
    offset = np.array([difference(robot, e, p) for e, p in zip(expected, q, strict=True)])
    hinges = np.where(robot.sliding, 0.0, np.round(offset / (2.0 * np.pi)) * 2.0 * np.pi)
    return bool(np.abs((offset - hinges) / robot.column_scale).max() < FILE_ROUNDING)
