"""Jogging: one platform coordinate or one motor moves at a time, with the loops closed throughout.

The platform follows a straight line (`tracking`), or a motor turns (`forward_kinematics`). The motion ends
where the robot could continue in another working or assembly mode; the reason is given in words. A motion of
the platform crosses Type 2 singularities, a motion of a motor ends there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled, Type2Singularity
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.continuation.forward_kinematics import forward_kinematics
from framework.kinematics.continuation.tracking import follow_path, weakest_leg
from framework.kinematics.inverse_kinematics import close_each, require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    assembled_at,
    clearance,
    linearised_at_reference,
    type1_matrix,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.laws.path import Line
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import least_singular_values
from framework.singularity.type2 import singularity_measure, twist_norm, uncontrolled_motion
from framework.tolerances import NEAR_SINGULAR_RATIO, SINGULAR_RATIO

# Largest motion of the platform along t_s, to show an uncontrolled motion: [robot lengths], [rad].
LOOSE_SHIFT, LOOSE_TURN = 0.03, 0.1
# Distance of a motor from a Type 2 singularity at which it stops [rad, robot lengths].
MOTOR_STOP_DISTANCE = 1e-8
LOOSE_SHARES = np.linspace(-1.0, 1.0, 9)  # shares of the largest motion along t_s at which poses are computed

# Name of a singularity, and its meaning.
CLASSES = {
    "type_2": ("Type 2 singularity", "the motors do not hold the platform along t_s"),
    "leg_passive": ("leg-passive singularity", "passive joints of a leg move by themselves"),
    "constraint": ("constraint singularity", "the platform gains a freedom that it should not have"),
    "closure": ("singularity of the loops", "they do not determine how their joints move"),
}


@dataclass(frozen=True, eq=False)
class JoggedPose:
    """A pose reached by jogging, and its distance from a singularity."""

    q: Array  # (nq,)
    x: Array  # (n,) platform coordinates
    motors: Array  # (n_a,) joint side [rad, m]
    g: float | None  # signed measure, zero at Type 2; None if every joint has a motor
    smallest: float | None  # least singular value of P; None if every joint has a motor
    level: str  # of proximity to a singularity: regular, near or singular
    kind: str  # of the singularity: type_1, type_2, leg_passive, constraint, closure, or ""
    verdict: str  # level and kind in words
    twist: Array  # (n,) t_s, or beside the locus what comes nearest, of unit size
    stopped: str  # why the motion ended early, or ""


def describe_jogged_pose(robot: ParallelRobot, q: Array, stopped: str = "") -> JoggedPose:
    """Describe the distance of a configuration q (nq,) from singularities of Type 1 and Type 2.

    The level of each type follows from the least singular value of its matrix, divided by its usual size: the
    value at the reference. Near both types the result describes Type 2. `stopped` says why a motion to q
    ended early.

    Raises:
        InvalidInput: q is not assembled.
    """
    linearised = assembled_at(robot, q)

    type1_value, type2_value = _least_singular_values(robot, linearised)
    usual_type1_value, usual_type2_value = _least_singular_values(robot, linearised_at_reference(robot))
    level = _proximity_level(type1_value, usual_type1_value)
    type2_level = _proximity_level(type2_value, usual_type2_value)

    kind = ""
    verdict = "regular: the motors hold the platform in every direction"
    if type2_level != "regular":
        level = type2_level
        kind = uncontrolled_motion(robot, linearised).kind
        name, meaning = CLASSES[kind]
        verdict = f"{name}: {meaning}" if level == "singular" else f"near a {name}"
    elif level != "regular":
        kind = "type_1"
        words = (
            "at Type 1: the leg of {} is" if level == "singular" else "near Type 1: the leg of {} is nearly"
        )
        verdict = f"{words.format(weakest_leg(robot, linearised))} stretched or folded"

    has_measure = robot.n_p > 0  # else every joint has a motor, and there is no Type 2
    measure = singularity_measure(robot, linearised)
    twist = linearised.platform[0] @ measure.motion[0]
    return JoggedPose(
        q=q,
        x=linearised.x[0],
        motors=robot.actuated_coordinates(q[None])[0],
        g=float(measure.g[0]) if has_measure else None,
        smallest=type2_value if has_measure else None,
        level=level,
        kind=kind,
        verdict=verdict,
        twist=twist / (twist_norm(robot, twist) or 1.0),  # a twist of zeros remains zero
        stopped=stopped,
    )


def _proximity_level(value: float, usual: float) -> str:
    """Return regular, near or singular by comparing a least singular value with its usual size.

    Args:
        value: the least singular value at a pose.
        usual: that at the reference. At least SINGULAR_RATIO counts, as the reference may be nearly singular.
    """
    usual = max(usual, SINGULAR_RATIO)
    if value >= NEAR_SINGULAR_RATIO * usual:
        return "regular"
    return "near" if value > SINGULAR_RATIO * usual else "singular"


class LooseMotion(NamedTuple):
    """A motion of the platform along t_s to both sides of a singular pose, loops closed."""

    q: Array  # (9, nq) at LOOSE_SHARES of the motion, from one end to the other
    shift: float  # [m] largest shift of the platform's point to either side
    turn: float  # [rad] largest turn of the platform to either side
    motors: Array  # (n_a,) largest motion of each motor, joint side [rad, m]; of second order on the locus


def loose_motion(robot: ParallelRobot, pose: JoggedPose, *, shift: float = LOOSE_SHIFT) -> LooseMotion | None:
    """Compute poses along t_s with the loops closed; None if the loops do not close.

    To first order the loops allow this motion with locked motors. When the loops are closed exactly, the
    motions of the motors are of second order in that of the platform.

    Args:
        pose: a singular pose.
        shift: largest shift of the platform [robot lengths].
    """
    linear = float(np.linalg.norm(pose.twist[robot.translations]))
    angular = float(np.linalg.norm(pose.twist[~robot.translations]))
    largest_turn = LOOSE_TURN * shift / LOOSE_SHIFT
    # the largest motion is t_s / divisor, whose shift or turn has the largest value allowed, and neither more
    divisor = max(linear / (shift * robot.length), angular / largest_turn)
    E = robot.platform.rate_matrix(pose.x[None])[0]  # v = E dx
    if divisor == 0 or np.linalg.matrix_rank(E) < robot.n:
        return None

    largest_change = np.linalg.solve(E, pose.twist / divisor)  # (n,) of the platform's coordinates
    x = pose.x + LOOSE_SHARES[:, None] * largest_change
    stack = close_each(robot, x, np.tile(pose.q, (len(x), 1)), farthest=MAX_NEWTON_STEP)
    if not stack.closed.all():
        return None
    motor_motions = np.abs(robot.actuated_coordinates(stack.q) - pose.motors)  # (9, n_a)
    return LooseMotion(
        q=stack.q, shift=linear / divisor, turn=angular / divisor, motors=motor_motions.max(axis=0)
    )


def move_platform(robot: ParallelRobot, q: Array, index: int, value: float) -> JoggedPose:
    """Move the platform coordinate number `index` to `value` [m, rad], the others at rest.

    The motion ends at the limit of the working mode.

    Raises:
        InvalidInput: q is not assembled, there is no such coordinate, or the platform does not determine the
            joints.
    """
    start = assembled_at(robot, q)
    _check_request(index, robot.n, value)
    target = start.x[0].copy()
    target[index] = value
    return move_platform_straight(robot, q, target)


def drag_platform(robot: ParallelRobot, q: Array, place: Array) -> JoggedPose:
    """Move the platform's origin towards a point `place` (3,) [m] on base axes.

    Coordinates other than translations keep their values.

    Raises:
        InvalidInput: q is not assembled, the point is not finite, or the platform does not determine the
            joints.
    """
    if place.shape != (3,) or not np.all(np.isfinite(place)):
        raise InvalidInput("place: needs three finite numbers")
    target = assembled_at(robot, q).x[0].copy()
    # the translations among the coordinates, each along one of the base axes
    target[robot.platform.sliding] = place[robot.platform.along]
    return move_platform_straight(robot, q, target)


def move_platform_straight(robot: ParallelRobot, q: Array, target: Array) -> JoggedPose:
    """Move the platform straight to coordinates `target` (n,).

    The motion stops where the working mode ends or a joint reaches its limit.

    Raises:
        InvalidInput: q is not assembled, or the platform does not determine the joints.
    """
    require_square(robot)
    start = assembled_at(robot, q)
    x = start.x[0]

    def pose_after(share: float) -> JoggedPose:
        """Compute the pose after a share of the motion, or at the end of the working mode."""
        end = x + share * (target - x)  # (n,) straight ahead, until the working mode ends
        if np.array_equal(end, start.x[0]):
            return describe_jogged_pose(robot, start.q[0])
        try:
            followed = follow_path(robot, Line(start.x[0], end), start)
            last = followed.last.linearised
            if followed.complete:
                return describe_jogged_pose(robot, last.q[0])
        except NotAssembled:  # the start is singular
            last = start
        reason = (
            f"The edge of the workspace: the leg of {weakest_leg(robot, last)} is stretched or folded "
            f"here (Type 1 singularity) and reaches no further in this working mode."
        )
        return describe_jogged_pose(robot, last.q[0], reason)

    return _stop_at_limits(robot, start.q[0], pose_after)


def _stop_at_limits(robot: ParallelRobot, q: Array, pose_after: Callable[[float], JoggedPose]) -> JoggedPose:
    """Find the last pose of a motion from q (nq,) within joint limits, by bisection.

    If q itself exceeds a limit, the limits are ignored.

    Args:
        pose_after: computes the pose after a share, 0 to 1, of the motion.
    """
    # to find where a motion ends at a joint limit: at most 0.4 % of the motion is left out
    limit_bisections = 8
    pose = pose_after(1.0)
    excesses = positions_beyond_limits(robot.limits, pose.q[None])
    if not excesses or positions_beyond_limits(robot.limits, q[None]):
        return pose

    last_inside = describe_jogged_pose(robot, q)
    inside, outside = 0.0, 1.0  # shares of the motion, within limits and beyond
    for _ in range(limit_bisections):
        middle = 0.5 * (inside + outside)
        pose = pose_after(middle)
        if positions_beyond_limits(robot.limits, pose.q[None]):
            outside = middle
        else:
            last_inside, inside = pose, middle
    stops = "; ".join(f"{joint}, {excess}" for joint, excess in excesses.items())
    return replace(last_inside, stopped=f"A joint stops at its limit in the URDF (asked for: {stops}).")


def move_motor(robot: ParallelRobot, q: Array, index: int, value: float) -> JoggedPose:
    """Turn the joint of motor number `index` to `value` [rad, m] in this assembly mode, the others at rest.

    Raises:
        InvalidInput: q is not assembled, there is no such motor, or the motors depend on one another.
    """
    start = assembled_at(robot, q)
    _check_request(index, robot.n_a, value)
    motors = robot.actuated_coordinates(start.q)[0]

    def turn(angle: float) -> Array:
        """Compute q (nq,) after the motor has turned by `angle` [rad, m]."""
        target = motors.copy()
        target[index] += angle
        return forward_kinematics(robot, target, near=q).q

    def stop_before(angle: float, sign: float) -> Array:
        """Compute q (nq,) just before a singularity, else at the start.

        The motor stops MOTOR_STOP_DISTANCE before the singularity. While `turn` can compute no pose there,
        the motor goes back by tenfold longer distances.

        Args:
            angle: size of the motor's turn to the singularity [rad, m].
            sign: direction of the turn, 1 or -1.
        """
        retreat = MOTOR_STOP_DISTANCE * robot.column_scale[robot.actuated[index]]
        while angle > 1.001 * retreat:  # a start that is as near already stays, whatever the rounding
            angle -= retreat
            retreat *= 10.0
            try:
                return turn(sign * angle)
            except Type2Singularity as earlier:  # another singularity, at a share of the turn
                angle *= earlier.share
        return q

    def pose_after(share: float) -> JoggedPose:
        """Compute the pose after a share of the turn, or just before a singularity on the way."""
        angle = share * (value - motors[index])
        try:
            return describe_jogged_pose(robot, turn(angle))
        except Type2Singularity as end:
            pose = describe_jogged_pose(robot, stop_before(end.share * abs(angle), np.sign(angle)))
            name, _ = CLASSES.get(pose.kind, CLASSES["type_2"])
            reason = (
                f"A {name}: here the motors lose their hold of the platform and can turn no further in this "
                f"assembly mode. Led by the platform, the robot goes across."
            )
            return replace(pose, stopped=reason)
        except NotAssembled as end:
            return describe_jogged_pose(robot, end.q, str(end))

    return _stop_at_limits(robot, q, pose_after)


def _check_request(index: int, count: int, value: float) -> None:
    """Raise InvalidInput for an index outside 0 .. count - 1, or a value that is not finite."""
    if not 0 <= index < count:
        raise InvalidInput(f"index: needs 0 .. {count - 1}, got {index}")
    if not np.isfinite(value):
        raise InvalidInput(f"value: needs a finite number, got {value!r}")


def _least_singular_values(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[float, float]:
    """Compute the least singular values of the Type 1 matrix and of P at one pose (T = 1)."""
    type1_values = least_singular_values(type1_matrix(robot, linearised))  # (1,)
    return float(type1_values[0]), float(clearance(robot, linearised)[0])
