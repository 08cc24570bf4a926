"""Jogging: one platform coordinate or one motor moves at a time, the loops closed all along.

The platform follows a straight line (`tracking`), or a motor turns (`forward_kinematics`). The motion ends
where the robot could go on in another working or assembly mode, with the reason in words. A platform crosses
Type 2 singularities; motors end there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled, Type2Singularity
from framework.kinematics.continuation.forward_kinematics import forward_kinematics
from framework.kinematics.continuation.tracking import follow_path, weakest_leg
from framework.kinematics.inverse_kinematics import close_each, require_square
from framework.kinematics.linearised_loops import (
    ClosedStack,
    LinearisedLoops,
    assembled_at,
    linearised_at_reference,
)
from framework.kinematics.loop_matrices import clearance, type1_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.laws.path import Line
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import singular_values
from framework.singularity.type2 import singularity_measure, twist_norm, uncontrolled_motion

NEAR_SINGULAR_RATIO, SINGULAR_RATIO = 0.3, 0.01  # least singular values over those at the reference
LIMIT_BISECTIONS = 8  # of a motion that ends at the limit of a joint: its last 0.4 % may be left out
# Motion of the platform along t_s that shows an escaping motion [robot lengths], [rad].
LOOSE_SHIFT, LOOSE_TURN = 0.03, 0.1
# Distance of a motor from a Type 2 singularity at which it stops [rad, robot lengths].
MOTOR_STOP_DISTANCE = 1e-8
USUAL_SIZE_FLOOR = 0.01  # singular value: of a reference that is nearly singular itself
MAX_RETREATS = 6  # from a singularity, each ten times as far as the last
MAX_LOOSE_STEP = 0.5  # [rad, robot lengths] of a joint in a Newton step along t_s
LOOSE_SHARES = np.linspace(-1.0, 1.0, 9)  # of that motion along t_s

# What a singularity is called, and what it means.
CLASSES = {
    "type_2": ("Type 2 singularity", "the motors do not hold the platform along t_s"),
    "leg_passive": ("leg-passive singularity", "passive joints of a leg move by themselves"),
    "constraint": ("constraint singularity", "the platform gains a freedom that it should not have"),
    "closure": ("singularity of the loops", "they do not determine how their joints move"),
}

_TYPE_1 = {
    "near": "near Type 1: the leg of {joint} is nearly stretched or folded",
    "singular": "at Type 1: the leg of {joint} is stretched or folded",
}
_MOTORS_END = (
    "A {name}: here the motors lose their hold of the platform and can turn no further in this assembly "
    "mode. Led by the platform, the robot goes across."
)


@dataclass(frozen=True, eq=False)
class JoggedPose:
    """A pose reached by jogging, and its distance from a singularity."""

    q: Array  # (nq,)
    x: Array  # (n,)
    motors: Array  # (n_a,) joint side [rad, m]
    g: float | None  # None: every joint has a motor
    smallest: float | None  # smallest singular value of P
    level: str  # regular, near, singular
    kind: str  # of that singularity: type_1, type_2, leg_passive, constraint, closure, or ""
    verdict: str  # the class, in words
    twist: Array  # (n,) least controlled, of unit size
    stopped: str  # the reason why the motion ended early, or ""


def describe_jogged_pose(robot: ParallelRobot, q: Array, stopped: str = "") -> JoggedPose:
    """Describe a jogged robot at an assembled configuration q (nq,): its distance from singularities.

    Type 1 and Type 2 are near where the least singular value of their matrix is small beside its usual one.

    Raises:
        InvalidInput: q is not assembled.
    """
    closed = assembled_at(robot, q)
    linearised = closed.linearised
    type1_value, type2_value = _least_singular_values(robot, linearised)
    usual = np.maximum(_least_singular_values(robot, linearised_at_reference(robot)), USUAL_SIZE_FLOOR)
    has_measure = len(robot.following) > 0  # else every joint has a motor, and there is no Type 2
    type1_level = _proximity_level(type1_value / usual[0])
    type2_level = _proximity_level(type2_value / usual[1]) if has_measure else "regular"
    level, kind, verdict = type1_level, "", "regular: the motors hold the platform in every direction"
    if type2_level != "regular":
        level, kind = type2_level, uncontrolled_motion(robot, linearised).kind
        name, meaning = CLASSES[kind]
        verdict = f"{name}: {meaning}" if level == "singular" else f"near a {name}"
    elif type1_level != "regular":
        kind, verdict = "type_1", _TYPE_1[level].format(joint=weakest_leg(robot, linearised))
    measure = singularity_measure(robot, linearised)
    twist = linearised.platform[0] @ measure.motion[0]
    return JoggedPose(
        q=q,
        x=closed.x[0],
        motors=robot.actuated_coordinates(q[None])[0],
        g=float(measure.g[0]) if has_measure else None,
        smallest=type2_value if has_measure else None,
        level=level,
        kind=kind,
        verdict=verdict,
        twist=twist / (twist_norm(robot, twist) or 1.0),
        stopped=stopped,
    )


def _proximity_level(share: float) -> str:
    """Return regular, near or singular for a least singular value over its usual size."""
    if share >= NEAR_SINGULAR_RATIO:
        return "regular"
    return "near" if share > SINGULAR_RATIO else "singular"


class LooseMotion(NamedTuple):
    """A motion of the platform along t_s, to either side of a singular pose, its loops closed."""

    q: Array  # (9, nq) from one end to the other, the pose itself in the middle
    shift: float  # [m] of the platform's point to either side
    turn: float  # [rad] of the platform to either side
    motors: Array  # (n_a,) joint side [rad, m], largest motion of each motor: of second order on the locus


def loose_motion(robot: ParallelRobot, pose: JoggedPose, *, shift: float = LOOSE_SHIFT) -> LooseMotion | None:
    """Compute closed poses along t_s, which show how little the motors turn; None where the loops open.

    To first order the loops allow this motion with locked motors. With the loops closed exactly the motors
    move by the square of the platform's motion. `shift` is the largest of the platform [robot lengths].
    """
    linear = float(np.linalg.norm(pose.twist[robot.translations]))
    angular = float(np.linalg.norm(pose.twist[~robot.translations]))
    largest_turn = LOOSE_TURN * shift / LOOSE_SHIFT
    size = max(linear / (shift * robot.length), angular / largest_turn)  # of t_s over the largest motion
    E = robot.platform.rate_matrix(pose.x[None])[0]  # v = E dx
    if size == 0 or np.linalg.matrix_rank(E) < robot.n:
        return None
    largest_change = np.linalg.solve(E, pose.twist / size)  # (n,) of the platform's coordinates
    x = pose.x + LOOSE_SHARES[:, None] * largest_change
    stack = close_each(robot, x, np.repeat(pose.q[None], len(x), axis=0), farthest=MAX_LOOSE_STEP)
    if not stack.closed.all():
        return None
    motors = robot.actuated_coordinates(stack.q)
    return LooseMotion(stack.q, linear / size, angular / size, np.abs(motors - pose.motors).max(axis=0))


def move_platform(robot: ParallelRobot, q: Array, index: int, value: float) -> JoggedPose:
    """Move one platform coordinate to `value`, the others at rest.

    The motion ends where the working mode does.

    Raises:
        InvalidInput: q is not assembled, no such coordinate, or the platform does not fix the joints.
    """
    start = assembled_at(robot, q)
    _check_request(index, robot.n, value)
    target = start.x[0].copy()
    target[index] = value
    return move_platform_straight(robot, q, target)


def drag_platform(robot: ParallelRobot, q: Array, place: Array) -> JoggedPose:
    """Move the platform's origin towards a point (3,) of the base [m].

    It goes as far as its coordinates allow.

    Raises:
        InvalidInput: q is not assembled, the point is not finite, or the platform does not fix the joints.
    """
    if place.shape != (3,) or not np.all(np.isfinite(place)):
        raise InvalidInput("place: needs three finite numbers")
    target = assembled_at(robot, q).x[0].copy()
    target[robot.platform.sliding] = place[robot.platform.along]
    return move_platform_straight(robot, q, target)


def move_platform_straight(robot: ParallelRobot, q: Array, target: Array) -> JoggedPose:
    """Move the platform straight to coordinates `target` (n,).

    It goes as far as working mode and joint limits allow.

    Raises:
        InvalidInput: q is not assembled, or the platform does not fix the joints.
    """
    require_square(robot)
    start = assembled_at(robot, q)
    x = start.x[0]
    return _stop_at_limits(
        robot, start.q[0], lambda share: _follow_line(robot, start, x + share * (target - x))
    )


def _stop_at_limits(robot: ParallelRobot, q: Array, pose_after: Callable[[float], JoggedPose]) -> JoggedPose:
    """Find the last pose of a motion from q (nq,) within joint limits.

    It is found by bisection. `pose_after` returns the pose after a share of the motion.
    """
    pose = pose_after(1.0)
    excesses = positions_beyond_limits(robot.limits, pose.q[None])
    if not excesses or positions_beyond_limits(robot.limits, q[None]):
        return pose
    last, inside, outside = describe_jogged_pose(robot, q), 0.0, 1.0  # shares of the motion
    for _ in range(LIMIT_BISECTIONS):
        middle = 0.5 * (inside + outside)
        pose = pose_after(middle)
        if positions_beyond_limits(robot.limits, pose.q[None]):
            outside = middle
        else:
            last, inside = pose, middle
    stops = "; ".join(f"{joint}, {excess}" for joint, excess in excesses.items())
    return replace(last, stopped=f"A joint stops at its limit in the URDF (asked for: {stops}).")


def _follow_line(robot: ParallelRobot, start: ClosedStack, target: Array) -> JoggedPose:
    """Move the platform straight to coordinates `target` (n,), as far as the working mode goes."""
    q = start.q[0]
    if np.array_equal(target, start.x[0]):
        return describe_jogged_pose(robot, q)
    try:
        followed = follow_path(robot, Line(start.x[0], target), q)
        end, linearised = followed.last.q[0], followed.last.linearised
        if followed.complete:
            return describe_jogged_pose(robot, end)
    except NotAssembled:  # the start is singular
        end, linearised = q, start.linearised
    return describe_jogged_pose(
        robot,
        end,
        f"The edge of the workspace: the leg of {weakest_leg(robot, linearised)} is stretched or folded here "
        f"(Type 1 singularity) and reaches no further in this working mode.",
    )


def move_motor(robot: ParallelRobot, q: Array, index: int, value: float) -> JoggedPose:
    """Turn one motor's joint to `value` [rad, m], the others at rest, in this assembly mode.

    Raises:
        InvalidInput: q is not assembled, there is no such motor, or the motors depend on one another.
    """
    start = assembled_at(robot, q)
    _check_request(index, robot.n_a, value)
    motors = robot.actuated_coordinates(start.q)[0]

    def turn(angle: float) -> Array:
        """Return the joints (nq,) after a turn of the motor [rad, m]."""
        target = motors.copy()
        target[index] = motors[index] + angle
        return forward_kinematics(robot, target, near=q).q

    def stop_before(angle: float, sign: float) -> Array:
        """Return joints (nq,) just before a singularity.

        It lies after a turn of this size and sign.
        """
        retreat = MOTOR_STOP_DISTANCE * robot.column_scale[robot.actuated[index]]
        for _ in range(MAX_RETREATS):
            angle, retreat = angle - retreat, 10.0 * retreat
            if angle <= 0.0:
                break
            try:
                return turn(sign * angle)
            except Type2Singularity as earlier:
                angle *= earlier.share
        return q

    def pose_after(share: float) -> JoggedPose:
        """Return the pose after a share of the turn.

        It is just before a singularity that lies between.
        """
        angle = share * (value - motors[index])
        try:
            return describe_jogged_pose(robot, turn(angle))
        except Type2Singularity as end:
            pose = describe_jogged_pose(robot, stop_before(end.share * abs(angle), np.sign(angle)))
            name = CLASSES[pose.kind][0] if pose.kind in CLASSES else "Type 2 singularity"
            return replace(pose, stopped=_MOTORS_END.format(name=name))
        except NotAssembled as end:
            return describe_jogged_pose(robot, end.q, str(end))

    return _stop_at_limits(robot, q, pose_after)


def _check_request(index: int, count: int, value: float) -> None:
    """Refuse an index out of range and a value that is not finite."""
    if not 0 <= index < count:
        raise InvalidInput(f"index: needs 0 .. {count - 1}, got {index}")
    if not np.isfinite(value):
        raise InvalidInput(f"value: needs a finite number, got {value!r}")


def _least_singular_values(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[float, float]:
    """Compute the least singular values of the legs (Type 1) and of P (Type 2), T = 1."""
    legs = singular_values(type1_matrix(robot, linearised)).min()
    return float(legs), float(clearance(robot, linearised)[0])
