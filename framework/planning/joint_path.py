"""Paths given in joints without motors, through which a robot changes its working mode.

Along a path of the platform a leg that is stretched cannot be followed further (Type 1). In passive joints
the same motion is regular where [selected joints; loops] has full rank: a stretched elbow is an angle like
any other. What remains singular is Type 2, where the motors lose hold, which plans cross. With a motor among
the joints Type 2 itself would look like Type 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice, pairwise, product

import numpy as np

from framework.errors import FrameworkError, InvalidInput, NoLaw, check_choice
from framework.kinematics.continuation.tracking import follow_path, track_path
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import JointPlatform
from framework.kinematics.tree_model import shares_beyond_limits
from framework.laws.curves import Spline
from framework.laws.path import Line, Path
from framework.model.description import Platform
from framework.numerics.arrays import Array, Names
from framework.numerics.ordered_sums import singular_values
from framework.numerics.time_limit import check_time
from framework.singularity.points_on_path import search_path
from framework.tolerances import FILE_ROUNDING, SAME_PLACE

MAX_SETS = 5000  # of joints that are compared: all 4845 of four joints out of twenty
# sets of joints, and lines in them, that are followed: they bound a search without success; of three hinges
# a set has up to eight ways around
MAX_TRACKED_SETS, MAX_TRACKED = 6, 24
BRANCH_SAMPLES = 65  # of a line, for the least singular value; narrower dips go unseen
DIRECTIONS = 12  # of the platform that are drawn, besides its axes, in which legs are stretched
FOLD_POSES = 192  # on the way by a stretched leg; an even number, so that none is at the fold itself
FOLD_POINTS = 13  # of these, of the spline
FARTHEST_POSE = 0.2  # [rad, lengths] of Newton's steps from one pose to the next, well below a flip


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
    """Choose joints and a path in them between two poses start, goal (nq,) of different working modes.

    Of the lines in sets of passive joints, both ways around for hinges that turn by more than a quarter, the
    one with the largest least singular value along it is taken. Where none leads to the goal, the path goes
    to a nearby place where a leg is stretched or folded, and returns with this leg flipped.

    Raises:
        NoLaw: none of these paths leads from the start to the platform and the motors of the goal, or each
            meets singularities that no law passes.
    """
    return _choose_path(robot, start, [goal], goal, lambda q: _is_same_mode(robot, q, goal), ())


def flip_legs(
    robot: ParallelRobot, start: Array, goal: Array, motors: Sequence[str], *, modes: Sequence[Array] = ()
) -> JointPath:
    """Choose a path in joints, as `choose_joint_path`, on which just the legs of these motors flip.

    Args:
        start: the pose (nq,) at its start.
        goal: the pose (nq,) without the flip, with the platform as at the end of the path.
        motors: names of those that stand elsewhere at the end; the others are as at the goal.
        modes: known poses (nq,) of this kind, to which lines are tried first.

    Raises:
        NoLaw: as `choose_joint_path`.
    """

    def is_end(q: Array) -> bool:
        """Return whether at q (nq,) the platform is at the goal, and just these motors are elsewhere."""
        return _is_same_place(robot, q, goal) and is_flip(robot, q, goal, motors)

    return _choose_path(robot, start, modes, goal, is_end, motors)


def is_flip(robot: ParallelRobot, q: Array, goal: Array, motors: Sequence[str]) -> bool:
    """Return whether just these motors are elsewhere at q (nq,) than at the goal (nq,), by no whole turns."""
    is_elsewhere = _distances(robot, q, goal)[robot.actuated] > SAME_PLACE
    return np.array_equal(is_elsewhere, np.isin(robot.actuator_names, motors))


def _choose_path(
    robot: ParallelRobot,
    start: Array,
    modes: Sequence[Array],
    goal: Array,
    is_end: Callable[[Array], bool],
    motors: Sequence[str],
) -> JointPath:
    """Choose a line to a mode, or a path by stretched legs to an end.

    Args:
        motors: names of those whose legs flip, one after the other if there are several.

    Raises:
        NoLaw: as `choose_joint_path`.
    """
    tracked = 0
    for mode in modes:
        line, count = _choose_line(robot, start, mode)
        if line is not None:
            return line
        tracked += count
    x = robot.platform.coordinates(frames_at(robot, np.stack([start, goal])))  # (2, n) at both ends
    beyond = None  # the first path that leaves the joints' limits
    ways = 0
    for q in _pass_folds(robot, start, goal, x, motors):
        ways += 1
        if not is_end(q[-1]):
            continue
        is_within = not shares_beyond_limits(robot.limits, q).any()
        path = _fit_joint_path(robot, q, is_end) if is_within or beyond is None else None
        if path is not None and is_within:
            return path
        beyond = path if beyond is None else beyond
    if beyond is not None:
        return beyond
    followed = 2 * robot.n + DIRECTIONS
    places = "" if ways else f"; no leg was stretched or folded on {followed} lines of the platform"
    raise NoLaw(
        f"of {tracked} lines in joints without motors, and {ways} ways by stretched or folded legs, none "
        f"that a law can pass leads to the other working mode{places}",
        name=robot.name,
    )


def _pass_folds(
    robot: ParallelRobot, start: Array, goal: Array, x: Array, motors: Sequence[str]
) -> Iterator[Array]:
    """Yield poses (T, nq) from a start by one fold of a leg, or by several, to a place of the platform.

    Ways by one fold come first. Those that flip one leg of several go on by further folds from there.

    Args:
        start: pose (nq,).
        goal: pose (nq,) without flips, with the platform at the place.
        x: platform coordinates (2, n) at the start and at the place.
        motors: names of those whose legs are to flip.
    """
    partial: dict[str, Array] = {}  # the first way that flips just this motor's leg
    for x_fold in _find_folds(robot, start, x[0]):
        check_time()
        q = _pass_fold(robot, start, x[0], x_fold, x[1])
        if q is None:
            continue
        yield q
        for motor in motors if len(motors) > 1 else ():
            if is_flip(robot, q[-1], goal, [motor]):
                partial.setdefault(motor, q)
    for flipped, first in partial.items():
        left = [motor for motor in motors if motor != flipped]
        for rest in _pass_folds(robot, first[-1], first[-1], x[[1, 1]], left):
            yield np.concatenate([first, rest[1:]])


def _choose_line(robot: ParallelRobot, start: Array, goal: Array) -> tuple[JointPath | None, int]:
    """Choose the most regular line in joints between poses (nq,); count lines followed."""
    ends = np.stack([start, goal])
    sets, at_ends = _rate_sets(robot, ends)
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
            check_time()
            tracked += 1
            try:
                q = track_path(selected, line).guess(np.linspace(0.0, 1.0, BRANCH_SAMPLES))  # (T, nq)
            except FrameworkError:
                continue
            if not all(_is_same_pose(robot, *pair) for pair in zip(q[[0, -1]], ends, strict=True)):
                continue
            (least,) = _rate_sets(robot, q, [sets[k]])[1]
            if best is None or least > best[0]:
                best = least, JointPath(sets[k], line)
    return best and best[1], tracked


def _rate_sets(
    robot: ParallelRobot, q: Array, sets: Sequence[Names] | None = None
) -> tuple[Sequence[Names], Array]:
    """Compute how well n joints determine all others at poses q (T, nq); return sets and values (S,).

    The motions that close the loops are spanned by N (moving, n), with N' N = 1. Rates of the joints of a set
    determine such a motion by the rows of N that belong to them: the worse, the smaller their least singular
    value over all poses, which is 1 at best. By default all sets of passive joints are compared.
    """
    if sets is None:
        sets = list(islice(combinations(passive_joints(robot), robot.n), MAX_SETS))
    loops = linearised_at(robot, q).jacobian[:, robot.n :] * robot.column_scale / robot.loop_lengths[:, None]
    N = np.linalg.svd(loops[:, :, robot.moving]).Vh[:, -robot.n :].swapaxes(1, 2)  # (T, moving, n)
    row_of = {robot.coordinates.name_of(column): k for k, column in enumerate(robot.moving.tolist())}
    rows = np.array([[row_of[name] for name in joints] for joints in sets]).reshape(-1, robot.n)  # (S, n)
    least = np.full(len(rows), np.inf)
    for pose in N:  # one by one: all poses of thousands of sets would fill the memory
        least = np.minimum(least, singular_values(pose[rows])[:, -1])
    return sets, least


def _find_folds(robot: ParallelRobot, start: Array, x: Array) -> list[Array]:
    """Find places (n,) where lines end at a stretched leg, nearest first.

    Lines of the platform lead from the pose `start` (nq,), at x (n,), in many directions; a folded leg ends
    them too.
    """
    random = np.random.default_rng(0).normal(size=(DIRECTIONS, robot.n))
    axes = np.eye(robot.n)
    directions = np.concatenate([axes, -axes, random / np.linalg.norm(random, axis=1)[:, None]])
    reach = 2.0 * np.where(robot.platform.translations, robot.length, 1.0)  # (n,) [m, rad]
    pose = linearised_at(robot, start[None], x[None])
    ends = []
    for direction in directions:
        check_time()
        line = Line(x, x + reach * direction)
        try:
            followed = follow_path(robot, line, pose, to_the_end=True)
        except FrameworkError:
            continue
        if not followed.complete:
            ends.append(float(followed.last.s[0]) * direction)
    return [x + reach * end for end in sorted(ends, key=np.linalg.norm)]


def _pass_fold(
    robot: ParallelRobot, start: Array, x_start: Array, x_fold: Array, x_goal: Array
) -> Array | None:
    """Follow poses (FOLD_POSES, nq) to a fold of a leg and to another place; None if refused.

    At a fold the platform moves as the square of what the joints do. So it goes as

        x(u) = x_fold + u^2 ((1 - u) (x_start - x_fold) + (1 + u) (x_goal - x_fold)) / 2,  u from -1 to 1,

    under which all joints move smoothly in u. Each pose is extrapolated from the three before it, through the
    fold to the flipped leg, and closed by Newton's method.
    """
    u = np.linspace(-1.0, 1.0, FOLD_POSES)[:, None]
    x = x_fold + 0.5 * u**2 * (
        (1.0 - u) * (x_start - x_fold) + (1.0 + u) * (x_goal - x_fold)
    )  # (FOLD_POSES, n)
    poses, step, bend = [start], np.zeros(robot.nv), np.zeros(robot.nv)
    for k in range(1, FOLD_POSES):
        guess = integrate(robot, poses[-1][None], (step + bend)[None])
        result = close_each(robot, x[k : k + 1], guess, farthest=FARTHEST_POSE)
        if not result.closed[0]:
            return None
        poses.append(result.q[0])
        last, step = step, difference(robot, *poses[-2:])
        bend = step - last if k > 1 else bend
    return np.array(poses)


def _fit_joint_path(robot: ParallelRobot, q: Array, is_end: Callable[[Array], bool]) -> JointPath | None:
    """Fit a spline in passive joints to poses q (T, nq); None if unusable.

    It is unusable if it leads elsewhere or no law passes it.
    """
    folds = len(q) // (FOLD_POSES - 1)
    chosen = np.round(np.linspace(0, len(q) - 1, folds * (FOLD_POINTS - 1) + 1)).astype(int)
    sets, least = _rate_sets(robot, q[chosen])
    steps = np.array([difference(robot, *pair) for pair in pairwise(q)])  # (T - 1, nv)
    offsets = np.concatenate([np.zeros((1, robot.nv)), np.cumsum(steps, axis=0)])[chosen]  # (m, nv)
    for k in np.argsort(-least, kind="stable")[:MAX_TRACKED_SETS].tolist():
        try:
            selected = with_platform_joints(robot, sets[k])
            assert isinstance(selected.platform, JointPlatform)
            columns = [robot.model.joints[robot.model.getJointId(name)].idx_v for name in sets[k]]
            path = Spline(q[0, selected.platform.q_indices] + offsets[:, columns])
            searched = search_path(selected, path)
        except FrameworkError:  # not regular, or through a Type 1 singularity
            continue
        poses = searched.branch.guess(np.array([0.0, 1.0]))
        has_ends = _is_same_pose(robot, poses[0], q[0]) and is_end(poses[1])
        if has_ends and all(point.kind == "type_2" and point.corank == 1 for point in searched.points):
            return JointPath(sets[k], path)
    return None


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
    """Return whether poses q and expected (nq,) are the same, but for whole turns."""
    return bool(_distances(robot, q, expected).max() < FILE_ROUNDING)


def _is_same_mode(robot: ParallelRobot, q: Array, expected: Array) -> bool:
    """Return whether platform and motors agree at q and expected (nq,), but for whole turns.

    Of universal and ball joints two settings may belong to one pose of the links.
    """
    at_motors = _distances(robot, q, expected)[robot.actuated]
    return bool(at_motors.max() < FILE_ROUNDING) and _is_same_place(robot, q, expected)


def _is_same_place(robot: ParallelRobot, q: Array, expected: Array) -> bool:
    """Return whether the platform has the same coordinates at q and expected (nq,)."""
    frames = frames_at(robot, np.stack([q, expected]))
    x, _ = robot.platform.coordinates(frames)
    offset = robot.platform.residual(frames, np.stack([x, x]))[1]  # (n,)
    scale = np.where(robot.platform.translations, robot.length, 1.0)
    return bool(np.abs(offset / scale).max() < FILE_ROUNDING)


def _distances(robot: ParallelRobot, q: Array, expected: Array) -> Array:
    """Compute distances (nv,) of all joints of q from those expected, less whole turns [rad, lengths]."""
    offset = difference(robot, expected, q)
    turns = np.where(robot.sliding, 0.0, np.round(offset / (2.0 * np.pi)) * 2.0 * np.pi)
    return np.abs((offset - turns) / robot.column_scale)
