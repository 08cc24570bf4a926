"""Follow a path from the reference without jumping to another branch.

A straight segment leads from the reference's platform coordinates to the start of the path; then the path is
followed. A step along the tangent is accepted if it passes the tests of `predictor_corrector` and its end is
in the same working mode. Otherwise it is halved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
from framework.kinematics.continuation.branch import Branch as Branch
from framework.kinematics.continuation.predictor_corrector import (
    BRANCH_GROWTH,
    FIRST_STEP_RATIO,
    MAX_PREDICTOR_MOVE,
    MAX_STEP_RATIO,
    MIN_STEP_RATIO,
    CurveEquations,
    Curves,
    limit_steps,
    measure_steps,
)
from framework.kinematics.frames import (
    difference,
    difference_rates,
    integrate,
    integrate_columns,
    largest_motion,
)
from framework.kinematics.inverse_kinematics import close_each, close_loops, require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    count_lost_ranks,
    equation_sizes,
    linearised_at,
    type1_matrix,
)
from framework.kinematics.modes import keeps_working_mode
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.laws.path import Line, Path, check_path
from framework.numerics.arrays import Array, ArrayLike, BoolArray
from framework.tolerances import BRANCHES_CROSS, FILE_ROUNDING, SAME_PLACE

POSES_AT_ONCE = round(1 / FIRST_STEP_RATIO)  # they span the path; a stack takes little longer than one pose
LOOP_SINGULARITY = (
    "a singularity of the loop equations, where no configuration can be told from its neighbours"
)


class BranchPoses(NamedTuple):
    """K assembled configurations of a branch, with their tangents."""

    s: Array  # (K,) path coordinates
    linearised: LinearisedLoops  # at these poses
    rate: Array  # (K, nv) dq/ds

    @property
    def q(self) -> Array:
        """Configurations (K, nq)."""
        return self.linearised.frames.q

    def select(self, which: slice) -> BranchPoses:
        """Return the poses `which`."""
        return BranchPoses(self.s[which], self.linearised.select(which), self.rate[which])


class FollowedCurve(NamedTuple):
    """The part of a branch that could be followed, as K poses."""

    s: Array  # (K,) path coordinates, ascending from 0, to 1 if the whole curve was followed
    q: Array  # (K, nq)
    rate: Array  # (K, nv) joint rates dq/ds
    last: BranchPoses  # the last pose

    @property
    def complete(self) -> bool:
        """Whether the whole curve was followed."""
        return bool(self.s[-1] == 1.0)


def assemble(robot: ParallelRobot, x: ArrayLike | None = None) -> Configuration:
    """Close the robot's loops at the reference, or with the platform at x (n,).

    Raises:
        InvalidInput: x has the wrong length or is not finite.
        NotAssembled: the loops do not close at the reference.
        OutOfReach, Type1Singularity: x cannot be reached from the reference in its working mode.
    """
    expect_robot(robot)
    reference = robot.reference
    if x is None:
        return reference
    target = finite_numbers(f"platform coordinates ({', '.join(robot.axis_names)})", x, robot.n)
    distance = float(np.abs(target - reference.x).max())
    if distance == 0.0:
        return reference
    require_square(robot)
    if distance < FILE_ROUNDING * robot.length:  # one Newton solution cannot leave the working mode
        closed = close_loops(robot, target[None], reference.q[None])
        steps = 1
    else:
        segment = Line(reference.x, target)
        branch = _follow_branch(robot, segment, reference.q, "the way from the reference to the point")
        closed = branch.close(1.0)  # cheap, since s = 1 is a knot
        steps = len(branch.s)
    return Configuration(closed.q[0], target, float(np.abs(closed.linearised.residual).max()), steps)


def track_path(robot: ParallelRobot, path: Path) -> Branch:
    """Follow the path from s = 0 to 1 on the branch of the reference.

    Raises:
        InvalidInput: path and platform differ in the number of coordinates, or see `check_path`.
        OutOfReach: the path leaves the workspace; names the leg and the place.
        Type1Singularity: the path runs into a pose where a leg is stretched or folded.
    """
    expect_robot(robot)
    check_path(path)
    if path.n != robot.n:
        raise InvalidInput(
            f"the path has {path.n} coordinates, the platform of {robot.name} has {robot.n} "
            f"({', '.join(robot.axis_names)})"
        )
    require_square(robot)
    start = assemble(robot, path(0.0))
    return _follow_branch(robot, path, start.q, "the path")


def follow_path(robot: ParallelRobot, path: Path, q: Array, *, to_the_end: bool = False) -> FollowedCurve:
    """Follow the path from the pose q (nq,) at s = 0 until path or branch ends.

    A stretch of up to `POSES_AT_ONCE` steps follows the tangent of the last pose. If not even its first step
    is accepted, the steps are halved. The poses stay in one working mode; they may pass Type 2 singularities.
    Springs keep the deflections of q. A branch ends at a Type 1 singularity.

    Args:
        to_the_end: whether to add the Type 1 singularity at the end of the branch, if it is found. Otherwise
            the last pose lies just before it.
    """
    start = np.zeros(1)
    pose = _with_tangents(robot, path, start, linearised_at(robot, q[None], path(start)))
    stretches = [pose]  # of poses followed so far, each stretch from one tangent
    step = FIRST_STEP_RATIO
    while pose.s[0] < 1.0:
        step = float(limit_steps(robot, pose.rate, np.minimum(step, 1.0 - pose.s))[0])
        if step < MIN_STEP_RATIO:
            break

        accepted = _take_steps(robot, path, pose, _parameters_ahead(robot, pose, step))
        if accepted is not None:
            poses, correction = accepted
            stretches.append(poses)
            pose = poses.select(slice(-1, None))  # the last one
            if correction < BRANCH_GROWTH and step < MAX_STEP_RATIO:
                step = min(2.0 * step, MAX_STEP_RATIO)
            continue

        # refused: the branch ends ahead, or the step is too long
        end = _type1_end(robot, path, pose) if to_the_end else None
        if end is not None:
            stretches.append(end)
            break
        step *= 0.5
    return FollowedCurve(
        s=np.concatenate([poses.s for poses in stretches]),
        q=np.concatenate([poses.q for poses in stretches]),
        rate=np.concatenate([poses.rate for poses in stretches]),
        last=stretches[-1].select(slice(-1, None)),
    )


def _take_steps(
    robot: ParallelRobot, path: Path, start: BranchPoses, s_ahead: Array
) -> tuple[BranchPoses, float] | None:
    """Take steps along the tangent of the pose `start` (K = 1) to path coordinates `s_ahead` (T,).

    All ends are predicted from the same pose, but each step is judged from the end of the previous one. A
    step is accepted if the loops close, the correction is small, and its end is in the same working mode. If
    the tangent turns much, the loops must also be far from losing rank at the end, where branches cross.

    Returns:
        The poses of the steps before the first refused one, and the correction of the last of these; None if
        the first step is refused.
    """
    lengths = (s_ahead - start.s)[:, None]  # in s, from the start
    guess = integrate(robot, start.q, lengths * start.rate)
    ends = _close_ahead(robot, path, s_ahead, guess)
    if ends is None:
        return None

    # judge each step as if it had been predicted from the end of the previous one
    steps = np.diff(lengths[: len(ends.q)], axis=0, prepend=0.0)  # (K, 1) in s
    q = np.concatenate([start.q, ends.q[:-1]])  # configurations at the starts of the steps
    predicted = steps * np.concatenate([start.rate, ends.rate[:-1]])
    corrections = difference(robot, integrate(robot, q, predicted), ends.q)
    correction, is_small, is_straight = measure_steps(robot, corrections, predicted, steps * ends.rate)
    if not is_small[0]:
        return None

    ends = ends.select(slice(_count_leading(is_small)))
    accepted = keeps_working_mode(robot, start.linearised, ends.linearised)
    # where the tangent turns much, another branch must not cross near the end
    curved = np.flatnonzero(accepted & ~is_straight[: len(accepted)])
    accepted[curved] = count_lost_ranks(robot, ends.linearised.select(curved), BRANCHES_CROSS) == 0
    count = _count_leading(accepted)
    return (ends.select(slice(count)), float(correction[count - 1])) if count else None


def _close_ahead(robot: ParallelRobot, path: Path, s: Array, predicted: Array) -> BranchPoses | None:
    """Close the loops of poses (T, nq) predicted at s (T,), up to the first that does not close.

    None if the first pose does not close, or if a pose has no tangent.
    """
    _, linearised, closed = close_each(robot, path(s), predicted, farthest=MAX_NEWTON_STEP)
    count = _count_leading(closed)
    if not count:
        return None
    try:
        return _with_tangents(robot, path, s[:count], linearised.select(slice(count)))
    except NotAssembled:  # a pose is singular to the last bit and has no tangent
        return None


def _with_tangents(robot: ParallelRobot, path: Path, s: Array, linearised: LinearisedLoops) -> BranchPoses:
    """Compute the tangents dq/ds (K, nv) at K poses, with constant deflections.

    Args:
        s: path coordinates (K,) of the poses.
        linearised: the loops at the poses.

    Returns:
        The poses with their tangents.

    Raises:
        NotAssembled: a pose is singular to the last bit and has no tangent.
    """
    twist, _ = robot.platform.twist(path(s), path(s, 1))
    return BranchPoses(s, linearised, joint_rates(robot, linearised, twist))


def _parameters_ahead(robot: ParallelRobot, pose: BranchPoses, step: float) -> Array:
    """Return up to POSES_AT_ONCE path coordinates ahead of a pose (K = 1), `step` apart.

    Those beyond which the tangent would move a joint by more than MAX_PREDICTOR_MOVE are left out, except the
    first.
    """
    lengths = step * np.arange(1, POSES_AT_ONCE + 1)
    speed = largest_motion(robot, pose.rate)[0]  # of the fastest joint along s
    s_ahead = pose.s + lengths
    is_on_path = s_ahead < 1.0 + 0.5 * MIN_STEP_RATIO  # with room for rounding
    allowed = is_on_path & (lengths * speed < MAX_PREDICTOR_MOVE)
    allowed[0] = True  # at least one step
    s_ahead = s_ahead[allowed]
    return np.where(s_ahead > 1.0 - SAME_PLACE, 1.0, s_ahead)  # the last step ends at 1 to the last bit


def _count_leading(flags: BoolArray) -> int:
    """Count the leading true flags of K flags (K,)."""
    return int(np.cumprod(flags).sum())


def _type1_end(robot: ParallelRobot, path: Path, pose: BranchPoses) -> BranchPoses | None:
    """Find the next Type 1 singularity ahead of a pose (K = 1); None without any."""
    sizes = equation_sizes(robot)  # (n + m,) by which the equations become dimensionless
    at_rest = np.zeros((1, robot.nv))  # no joint but the moving ones follows a prescribed motion

    def evaluate(q: Array, share: Array) -> CurveEquations:
        """Compute the n + m equations and their derivatives at q (T, nq) and s = `share` (T,)."""
        share = np.clip(share, 0.0, 1.0)
        x = path(share)
        linearised = linearised_at(robot, q, x)
        by_share = np.zeros_like(linearised.residual)
        path_twist, _ = robot.platform.twist(x, path(share, 1))
        by_share[:, : robot.n] = -path_twist  # F = [platform - x ; closures], of which x depends on s
        matrix = type1_matrix(robot, linearised)
        return CurveEquations(matrix, by_share / sizes, linearised.residual / sizes, linearised)

    curves = Curves(robot, columns=robot.moving, turn=at_rest, evaluate=evaluate)
    ahead = curves.find_turning_points(pose.q, pose.s)
    if not ahead.found[0]:
        return None
    return BranchPoses(ahead.share, ahead.linearised, at_rest)  # dq/ds is infinite: zero stands for it


def _follow_branch(robot: ParallelRobot, path: Path, q: Array, subject: str) -> Branch:
    """Follow the branch along the whole path from the pose q (nq,) at s = 0.

    `subject` is the name of the path in errors.

    Raises:
        OutOfReach, Type1Singularity, UncontrolledMotions: the branch ends early.
    """
    followed = follow_path(robot, path, q, to_the_end=True)
    if not followed.complete:
        raise _branch_end_error(robot, path, followed, subject)
    offset = difference(robot, q, followed.q)
    rate = difference_rates(robot, q, followed.q, followed.rate)
    return Branch(robot, path, origin=q, s=followed.s, u=offset, du=rate)


def _branch_end_error(
    robot: ParallelRobot,
    path: Path,
    followed: FollowedCurve,
    subject: str,
    *,
    # relative singular value below which the loops have lost rank at the end of a branch
    type_1_end_ratio: float = 1e-4,
) -> OutOfReach | Type1Singularity | UncontrolledMotions:
    """Return the error for a branch that could only be `followed` to an early end.

    At such an end either the loops lose rank, or a leg is stretched or folded. `subject` is the name of the
    path in the message.
    """
    last = followed.last
    s = float(last.s[0])
    x = path(s)
    linearised = last.linearised
    count = int(count_lost_ranks(robot, linearised, type_1_end_ratio)[0])
    if count:
        return escape_error(robot, s, x, count, f"{subject} runs into {LOOP_SINGULARITY}")
    joint = weakest_leg(robot, linearised)
    place = f"at s = {s:.6g}, {robot.place(x)}"
    if _closes_beyond(robot, path, last):
        return Type1Singularity(
            f"{robot.name}: {subject} meets a Type 1 singularity {place}: the leg of {joint} is stretched "
            f"or folded there and could go on in another working mode",
            s=s,
            platform=x,
            joint=joint,
        )
    return OutOfReach(
        f"{robot.name}: {subject} leaves the workspace {place}: the leg of {joint} cannot follow"
        + remark_on_reach(robot, path(1.0)[robot.platform.sliding]),
        q=last.q[0],
        residual=float(np.abs(linearised.residual).max()),
        s=s,
        platform=x,
        joint=joint,
    )


def _longest_reach(robot: ParallelRobot) -> float:
    """Compute the summed length [m] of the links from base to platform.

    Slides are at the far end of their range, springs at rest. A slide without limits, such as those of a
    floating joint, makes the length practically infinite.
    """
    model = robot.model
    frame = model.frames[robot.frames[0]]  # the platform's frame
    reach = float(np.linalg.norm(frame.placement.translation))
    for k in list(model.supports[frame.parentJoint])[1:]:  # the joints from the base, without the world
        joint = model.joints[k]
        reach += float(np.linalg.norm(model.jointPlacements[k].translation))
        if robot.sliding[joint.idx_v] and joint.idx_v not in robot.elastic:
            ends = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            reach += float(np.abs(ends).max())
    return reach


def remark_on_reach(robot: ParallelRobot, position: Array) -> str:
    """Return a remark on a platform out of reach of the links; empty if within reach.

    `position` has the prescribed translations of the platform's origin [m].
    """
    distance, reach = np.linalg.norm(position), _longest_reach(robot)
    if distance <= reach:
        return ""
    return (
        f"; points are in m: {point(position)} is {distance:.4g} m from the base, "
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


def _closes_beyond(
    robot: ParallelRobot,
    path: Path,
    last: BranchPoses,
    *,
    look_ahead: tuple[float, ...] = (1e-3, 1e-2),  # in s
    look_ahead_nudge: float = 0.02,  # motion of joints [rad or m] from the last pose
) -> bool:
    """Return whether the loops close again a little further along the path, on any branch.

    Newton's method starts from the last pose after all joints have moved slightly, in either direction.
    """
    ahead = last.s + look_ahead
    ahead = np.repeat(ahead[ahead <= 1.0], 2)  # each twice, for both directions
    if not len(ahead):
        return False
    nudge = np.full((len(ahead), len(robot.moving)), look_ahead_nudge)
    nudge[1::2] *= -1.0
    guess = integrate_columns(robot, last.q, robot.moving, nudge)
    return bool(close_each(robot, path(ahead), guess).closed.any())


def escape_error(robot: ParallelRobot, s: float, x: Array, count: int, reason: str) -> UncontrolledMotions:
    """Return the error for `count` uncontrolled motions at s and platform x (n,), with a `reason`."""
    words = {1: "one uncontrolled motion", 2: "two uncontrolled motions at once"}
    return UncontrolledMotions(
        f"{robot.name}: {words.get(count, f'{count} uncontrolled motions at once')} at s = {s:.6g}, "
        f"{robot.place(x)}: {reason}",
        s=s,
        platform=x,
        count=count,
    )
