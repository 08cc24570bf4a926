"""Follow a path from the reference without jumping to another branch.

A straight segment leads from the reference's platform coordinates to the start of the path; then the path
is followed. Both are followed on the panels of `path_sheet`. What they do not resolve is followed in single
steps along the tangent, each accepted by the same tests or halved. So a refusal tells where and why a branch
ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import (
    InvalidInput,
    NotAssembled,
    OutOfReach,
    Type1Singularity,
    UncontrolledMotions,
    finite_numbers,
    point,
)
from framework.kinematics.assembly import MAX_NEWTON_STEP, Configuration
from framework.kinematics.continuation.arclength import CurveEquations, Curves
from framework.kinematics.continuation.branch import Branch as Branch
from framework.kinematics.continuation.path_sheet import (
    MIN_SHEET_PANEL,
    BranchPoses,
    follow_panels,
    judge_steps,
    with_tangents,
)
from framework.kinematics.continuation.predictor_corrector import MAX_PREDICTOR_MOVE
from framework.kinematics.frames import integrate, integrate_columns, largest_motion
from framework.kinematics.inverse_kinematics import close_each, close_loops, require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    count_lost_ranks,
    linearised_at,
    linearised_at_reference,
    type1_matrix,
)
from framework.kinematics.mechanism import frame_index
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Line, Path, check_path
from framework.numerics.arrays import LEAST_DIVISOR, Array, ArrayLike, IntArray
from framework.tolerances import BRANCH_CORRECTION, FILE_ROUNDING, MAX_TURNS, SAME_PLACE

LOOP_SINGULARITY = (
    "a singularity of the loop equations, where no configuration can be told from its neighbours"
)


class FollowedPath(NamedTuple):
    """The part of a branch that could be followed: panels, then single poses where panels do not suffice."""

    panels: tuple[BranchPoses, ...]  # ascending from s = 0
    steps: tuple[BranchPoses, ...]  # K = 1 each; the first one is the last pose of the panels, or the start

    @property
    def last(self) -> BranchPoses:
        """The last pose (K = 1)."""
        return self.steps[-1]

    @property
    def complete(self) -> bool:
        """Whether the whole path was followed."""
        return bool(self.last.s[0] == 1.0)


def assemble(robot: ParallelRobot, x: ArrayLike | None = None) -> Configuration:
    """Close the robot's loops at the reference, or with the platform at x (n,).

    Raises:
        InvalidInput: x has the wrong length, is not finite, or is more than MAX_TURNS away.
        NotAssembled: the loops do not close at the reference.
        OutOfReach, Type1Singularity: x cannot be reached from the reference in its working mode.
    """
    reference = robot.reference
    if x is None:
        return reference
    target = finite_numbers(f"platform coordinates ({', '.join(robot.axis_names)})", x, robot.n)
    if np.array_equal(target, reference.x):
        return reference
    require_square(robot)
    if _is_near_reference(robot, target):
        linearised, steps = close_loops(robot, target[None], reference.q[None]), 1
    else:
        followed = _follow_from_reference(robot, target)
        linearised = followed.last.linearised
        steps = sum(len(panel.s) for panel in followed.panels) + len(followed.steps)
    return Configuration(linearised.frames.q[0], target, float(np.abs(linearised.residual).max()), steps)


def _follow_from_reference(robot: ParallelRobot, x: Array) -> FollowedPath:
    """Follow the straight way from the reference to x (n,), in the working mode of the reference."""
    name = "the way from the reference to the point"
    way = Line(robot.reference.x, x)
    start = linearised_at_reference(robot)
    _check_turns(robot, way, name)
    return _follow_to_end(robot, way, start, name)


def _is_near_reference(robot: ParallelRobot, x: Array) -> bool:
    """Return whether Newton's method leads from the reference to x (n,) in one mode."""
    return float(np.abs(x - robot.reference.x).max()) < FILE_ROUNDING * robot.length


def track_path(robot: ParallelRobot, path: Path) -> Branch:
    """Follow the path from s = 0 to 1 on the branch of the reference.

    Raises:
        InvalidInput: path and platform differ in the number of coordinates, or see `check_path`.
        OutOfReach: the path leaves the workspace; names the leg and the place.
        Type1Singularity: the path runs into a pose where a leg is stretched or folded.
    """
    check_path(path)
    if path.n != robot.n:
        raise InvalidInput(
            f"the path has {path.n} coordinates, the platform of {robot.name} has {robot.n} "
            f"({', '.join(robot.axis_names)})"
        )
    require_square(robot)
    _check_turns(robot, path, "the path")
    x = finite_numbers("the start of the path", path(0.0), robot.n)
    start = linearised_at_reference(robot)
    if not _is_near_reference(robot, x):
        start = _follow_from_reference(robot, x).last.linearised
    followed = _follow_to_end(robot, path, start, "the path")
    return Branch.through(robot, path, followed.panels, followed.steps)


def _check_turns(robot: ParallelRobot, path: Path, what: str) -> None:
    """Raise InvalidInput if a coordinate of the platform turns by more than MAX_TURNS on `what`."""
    if robot.translations.all():
        return
    travel = np.abs(np.diff(path(np.linspace(0.0, 1.0, 201)), axis=0)).sum(axis=0)  # (n,) [m, rad]
    for name, angle, slides in zip(robot.axis_names, travel.tolist(), robot.translations, strict=True):
        if not slides and angle > MAX_TURNS * 2.0 * np.pi:
            raise InvalidInput(
                f"{what} turns {name} by {angle:.4g} rad, {angle / (2.0 * np.pi):.3g} turns; at most "
                f"{MAX_TURNS} are followed: points are in rad, and of turns that repeat plan one"
            )


def follow_path(
    robot: ParallelRobot, path: Path, pose: LinearisedLoops, *, to_the_end: bool = False
) -> FollowedPath:
    """Follow the path from a pose (T = 1) at s = 0, or near it, until path or branch ends.

    The poses stay in one working mode; they may pass Type 2 singularities. Springs keep their deflections. A
    branch ends at a Type 1 singularity.

    Args:
        to_the_end: whether to add the Type 1 singularity at the end of the branch, if it is found. Otherwise
            the last pose lies just before it.

    Raises:
        NotAssembled: the pose is singular to the last bit.
    """
    panels = follow_panels(robot, path, pose)
    if panels:
        last = panels[-1].last
    else:
        start = close_loops(robot, path(np.zeros(1)), pose.q)
        last = with_tangents(robot, path, np.zeros(1), start)
    return FollowedPath(tuple(panels), tuple(_follow_steps(robot, path, last, to_the_end=to_the_end)))


def _follow_steps(
    robot: ParallelRobot, path: Path, pose: BranchPoses, *, to_the_end: bool
) -> list[BranchPoses]:
    """Follow the path from a pose (K = 1) in single steps; return this pose and all that follow."""
    min_step, max_step = 1e-7, 1 / 4  # in s; if a shorter step is refused, the branch has ended
    small_correction = 0.2 * BRANCH_CORRECTION  # [rad, lengths] after a smaller one the step is doubled
    poses = [pose]
    step = MIN_SHEET_PANEL
    seeks_end = to_the_end  # once from each pose
    while pose.s[0] < 1.0:
        speed = float(largest_motion(robot, pose.rate)[0])  # [rad, lengths] of a joint, over s
        # tangents lead far away near a singularity; 0.99 leaves room for rounding
        step = min(step, 1.0 - float(pose.s[0]), 0.99 * MAX_PREDICTOR_MOVE / max(speed, LEAST_DIVISOR))
        if step < min_step:
            break
        following = _take_step(robot, path, pose, step)
        if following is not None:
            pose, correction = following
            poses.append(pose)
            seeks_end = to_the_end
            if correction < small_correction and step < max_step:
                step = min(2.0 * step, max_step)
            continue
        # refused: the branch ends ahead, or the step is too long
        end = _type1_end(robot, path, pose) if seeks_end else None
        seeks_end = False
        if end is not None:
            poses.append(end)
            break
        step *= 0.5
    return poses


def _take_step(
    robot: ParallelRobot, path: Path, pose: BranchPoses, step: float
) -> tuple[BranchPoses, float] | None:
    """Take a step in s along the tangent of a pose (K = 1); None if its end is not on the branch.

    Returns:
        The pose at the end (K = 1), and the correction of its prediction [rad, lengths].
    """
    s = pose.s + step
    s = np.where(s > 1.0 - SAME_PLACE, 1.0, s)  # the last step ends at 1 to the last bit
    predicted = integrate(robot, pose.q, step * pose.rate)
    closing = close_each(robot, path(s), predicted, farthest=MAX_NEWTON_STEP)
    if not closing.closed.all():
        return None
    try:
        end = with_tangents(robot, path, s, closing.linearised)
    except NotAssembled:  # the end is singular to the last bit and has no tangent
        return None
    keeps_branch, correction = judge_steps(robot, pose, end)
    return (end, float(correction[0])) if keeps_branch[0] else None


def _type1_end(robot: ParallelRobot, path: Path, pose: BranchPoses) -> BranchPoses | None:
    """Find the next Type 1 singularity ahead of a pose (K = 1); None without any."""
    sizes = robot.equation_sizes  # (n + m,) by which the equations become dimensionless
    at_rest = np.zeros((1, robot.nv))  # no joint but the moving ones follows a prescribed motion

    def evaluate(q: Array, share: Array, _: IntArray) -> CurveEquations:
        """Compute the n + m equations and their slopes at q (T, nq) and s = `share` (T,)."""
        share = np.clip(share, 0.0, 1.0)
        x = path(share)
        linearised = linearised_at(robot, q, x)
        slopes = np.zeros((*linearised.residual.shape, len(sizes) + 1))
        slopes[:, :, :-1] = type1_matrix(robot, linearised)
        path_twist, _derivative = robot.platform.twist(x, path(share, 1))
        # F = [platform - x ; closures], of which x depends on s
        slopes[:, : robot.n, -1] = -path_twist / sizes[: robot.n]
        return CurveEquations(linearised.residual / sizes, slopes)

    curves = Curves(robot, columns=robot.moving, turn=at_rest, evaluate=evaluate)
    ahead = curves.find_turning_points(pose.q, pose.s, np.zeros(1, dtype=np.intp))
    if not ahead.found[0]:
        return None
    # dq/ds is infinite: zero stands for it
    return BranchPoses(ahead.share, linearised_at(robot, ahead.q, path(ahead.share)), at_rest)


def _follow_to_end(robot: ParallelRobot, path: Path, pose: LinearisedLoops, subject: str) -> FollowedPath:
    """Follow the whole path from a pose (T = 1) at s = 0.

    `subject` is the name of the path in errors.
    """
    followed = follow_path(robot, path, pose, to_the_end=True)
    if not followed.complete:
        raise _branch_end_error(robot, path, followed.last, subject)
    return followed


def _branch_end_error(
    robot: ParallelRobot, path: Path, last: BranchPoses, subject: str
) -> OutOfReach | Type1Singularity | UncontrolledMotions:
    """Return the error for a branch that ends early, at the pose `last` (K = 1).

    At such an end either the loops lose rank, or a leg is stretched or folded. `subject` is the name of the
    path in the message.
    """
    # relative singular value below which the loops have lost rank at the end of a branch
    type_1_end_ratio = 1e-4
    s = float(last.s[0])
    x = path(s)
    linearised = last.linearised
    count = int(count_lost_ranks(robot, linearised, type_1_end_ratio)[0])
    if count:
        return uncontrolled_error(robot, s, x, count, f"{subject} runs into {LOOP_SINGULARITY}")
    joint = weakest_leg(robot, linearised)
    place = f"at s = {s:.6g}, {robot.place(x)}"
    if _closes_beyond(robot, path, last):
        return Type1Singularity(
            f"{subject} meets a Type 1 singularity {place}: the leg of {joint} is stretched "
            f"or folded there and could go on in another working mode",
            name=robot.name,
            s=s,
            platform=x,
            joint=joint,
        )
    return OutOfReach(
        f"{subject} leaves the workspace {place}: the leg of {joint} cannot follow",
        name=robot.name,
        q=last.q[0],
        residual=float(np.abs(linearised.residual).max()),
        s=s,
        platform=x,
        joint=joint,
    ).adding(remark_on_reach(robot, path(1.0)[robot.platform.sliding]))


def reach_of_links(robot: ParallelRobot, travel: Array) -> float:
    """Return the farthest place [m] of the platform's origin from the base that its links allow.

    It is the length of the shortest chain of links to the platform, springs at rest, slides at their `travel`
    (nv,). Links hang together by joints, and by closures that hold two points at a distance or in one place.
    """
    model = robot.model

    def arm(frame: pin.Frame) -> float:
        """Return the distance [m] of a frame from the joint that carries it."""
        return float(np.linalg.norm(frame.placement.translation))

    lengths = np.full((model.njoints, model.njoints), np.inf)  # [m] between the origins of two joints
    for k in range(1, model.njoints):
        column = model.joints[k].idx_v
        slide = travel[column] if robot.sliding[column] and column not in robot.elastic else 0.0
        lengths[model.parents[k], k] = np.linalg.norm(model.jointPlacements[k].translation) + slide
    for closure in robot.description.closures:
        if closure.length is not None or {"x", "y", "z"} <= set(closure.axes):
            first, second = (model.frames[frame_index(model, name)] for name in closure.frames)
            ends = first.parentJoint, second.parentJoint
            lengths[ends] = min(lengths[ends], arm(first) + (closure.length or 0.0) + arm(second))
    lengths = np.minimum(lengths, lengths.T)
    shortest = np.where(np.arange(model.njoints) == 0, 0.0, np.inf)  # (njoints,) from the base
    for _ in range(model.njoints):  # a chain passes each joint once
        shortest = np.minimum(shortest, (shortest[:, None] + lengths).min(axis=0))
    platform = model.frames[robot.frames[0]]
    return float(shortest[platform.parentJoint]) + arm(platform)


def remark_on_reach(robot: ParallelRobot, position: Array) -> str:
    """Return a clause on a platform beyond the reach of the links at a position [m]; else an empty one."""
    travel = np.full(robot.nv, np.inf)  # [m] of slides without limits, such as those of a floating joint
    for limit in robot.limits:
        travel[limit.column] = max(abs(limit.lower), abs(limit.upper))
    reach = reach_of_links(robot, travel)
    distance = np.linalg.norm(position)
    if distance <= reach:
        return ""
    return (
        f"points are in m: {point(position)} is {distance:.4g} m from the base, "
        f"{distance / robot.length:.3g} times the size of the robot, and its links in one line reach "
        f"{reach:.3g} m"
    )


def weakest_leg(robot: ParallelRobot, linearised: LinearisedLoops) -> str:
    """Return the name of the motor's joint of the leg nearest to a Type 1 singularity (T = 1).

    Of all motors it moves most in the joint motion that moves the platform least.
    """
    matrix = type1_matrix(robot, linearised)[0]
    least_motion = np.linalg.svd(matrix).Vh[-1]  # (moving,) of the least singular value, motors first
    motor = np.argmax(np.abs(least_motion[: robot.n_a]))
    return robot.actuator_names[motor]


def _closes_beyond(robot: ParallelRobot, path: Path, last: BranchPoses) -> bool:
    """Return whether the loops close again a little further along the path, on any branch.

    Newton's method starts from the last pose after all joints have moved slightly, in either direction.
    """
    look_ahead = (1e-3, 1e-2)  # in s
    look_ahead_nudge = 0.02  # motion of joints [rad or m] from the last pose
    ahead = last.s + look_ahead
    ahead = np.repeat(ahead[ahead <= 1.0], 2)  # each twice, for both directions
    if not len(ahead):
        return False
    nudge = np.full((len(ahead), len(robot.moving)), look_ahead_nudge)
    nudge[1::2] *= -1.0
    guess = integrate_columns(robot, last.q, robot.moving, nudge)
    return bool(close_each(robot, path(ahead), guess).closed.any())


def uncontrolled_error(
    robot: ParallelRobot, s: float, x: Array, count: int, reason: str
) -> UncontrolledMotions:
    """Return the error for `count` uncontrolled motions at s and platform x (n,), with a `reason`."""
    words = {1: "one uncontrolled motion", 2: "two uncontrolled motions at once"}
    return UncontrolledMotions(
        f"{words.get(count, f'{count} uncontrolled motions at once')} at s = {s:.6g}, "
        f"{robot.place(x)}: {reason}",
        name=robot.name,
        s=s,
        platform=x,
        count=count,
    )
