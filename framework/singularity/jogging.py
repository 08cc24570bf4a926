"""A robot moved by hand: one platform coordinate or one motor at a time, its loops closed all the way.

From the configuration given, a straight way is followed in small steps and never past a place where the
robot could go on in another working or assembly mode: it stops there and says why. The platform crosses
Type 2 singularities without noticing; the motors end at them, as motors do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.assembly import loop_rows, passive_columns, reference_configuration
from framework.kinematics.closures import column_scale, scaled
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.inverse_kinematics import (
    System,
    close_loops,
    joint_rates,
    keeps_working_mode,
    mode_signs,
    moving_columns,
    require_square,
    system_at,
)
from framework.kinematics.loop_matrices import passive_matrix
from framework.kinematics.platform import platform_coordinates, platform_twist
from framework.kinematics.tracking import weakest_leg
from framework.model import ParallelRobot
from framework.singularity.classification import singularity_measure, uncontrolled_motion, unit_twist

SHORTEST = 1e-7  # of the way asked for: between the last place that closes and the first that does not
LONGEST = 0.1  # [rad, lengths] that a step may move a joint
CORRECTION = 0.03  # [rad, lengths] that closing the loops may move a joint after a step
CLOSED = 1e-6  # [rad, lengths] of a configuration that counts as assembled
NEAR, ON = 0.3, 0.01  # of the reference's smallest singular value: near a singularity, on it

_CLASSES = {
    "type_2": "Type 2 singularity: the motors do not hold the platform",
    "leg_passive": "a leg's passive joints move by themselves",
    "constraint": "constraint singularity: the platform gains freedoms",
    "closure": "singularity of the loops themselves",
}


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the hand has brought the robot, and how near that is to a singularity."""

    q: Array  # (nq,)
    x: Array  # (n,)
    motors: Array  # (n_a,) joint side [rad, m]
    g: float | None  # None: every joint has a motor
    smallest: float | None  # smallest singular value of P
    level: str  # regular, near, singular
    legs: bool  # that singularity is one of the legs, Type 1
    verdict: str  # the class, in words
    twist: Array  # (n,) least controlled, of unit size
    stopped: str  # why it went no further, or ""


def pose_at(robot: ParallelRobot, q: Array, stopped: str = "") -> Pose:
    """What there is to know about an assembled configuration q (nq,)."""
    x = platform_coordinates(robot, frames_at(robot, q[None]))
    system = system_at(robot, q[None], x)
    motors = difference(robot, np.asarray(pin.neutral(robot.model)), q[None])[0, robot.actuated]
    usual, usual_legs = _usual_sizes(robot)
    legs = _smallest(_leg_matrix(robot, system))
    level, verdict = "regular", "regular: the motors hold the platform in every direction"
    stretched = legs < NEAR * usual_legs
    if stretched:
        level = "near" if legs > ON * usual_legs else "singular"
        verdict = (
            f"{'near' if level == 'near' else 'at'} Type 1: the leg of {weakest_leg(robot, system)} is "
            f"{'nearly ' if level == 'near' else ''}stretched or folded"
        )
    if not len(passive_columns(robot)):
        return Pose(q, x[0], motors, None, None, level, stretched, verdict, np.zeros(robot.n), stopped)
    smallest = _smallest(passive_matrix(robot, system)[0])
    measure = singularity_measure(robot, system)
    twist = system.platform[0] @ measure.motion[0]
    twist = twist / (unit_twist(robot, twist) or 1.0)
    if smallest < NEAR * usual:
        level = "near" if smallest > ON * usual else "singular"
        stretched = False
        kind = _CLASSES[uncontrolled_motion(robot, system).kind]
        verdict = kind if level == "singular" else f"near a {kind}".replace("near a a ", "near: a ")
    return Pose(q, x[0], motors, float(measure.g[0]), smallest, level, stretched, verdict, twist, stopped)


def move_platform(robot: ParallelRobot, q: Array, index: int, value: float) -> Pose:
    """Bring one platform coordinate to `value`, the others held, as far as the working mode goes.

    Raises:
        InvalidInput: q is not assembled, no such coordinate, or the platform does not fix the joints.
    """
    require_square(robot)
    start = _assembled(robot, q)
    _check(index, robot.n, value)
    target = start.copy()
    target[index] = value
    rest = np.zeros((1, robot.n_e))

    def step(here: Array, at: float, to: float) -> Array | None:
        x, ahead = (start + part * (target - start) for part in (at, to))
        system = system_at(robot, here[None], x[None])
        twist, _ = platform_twist(robot, x[None], (target - start)[None])
        try:
            rate = joint_rates(robot, system, twist, rest) * (to - at)
            guess = integrate(robot, here[None], rate)
            closed = close_loops(robot, ahead[None], guess)
        except NotAssembled:
            return None
        small = _is_small(robot, rate[0], difference(robot, guess[0], closed.q)[0])
        return closed.q[0] if small and keeps_working_mode(robot, system, closed.system) else None

    there, share = _as_far_as_possible(step, q)
    if share == 1.0:
        return pose_at(robot, there)
    system = system_at(robot, there[None], (start + share * (target - start))[None])
    return pose_at(
        robot,
        there,
        f"The edge of the workspace: the leg of {weakest_leg(robot, system)} is stretched or folded here "
        f"(Type 1 singularity) and reaches no further in this working mode.",
    )


def move_motor(robot: ParallelRobot, q: Array, index: int, value: float) -> Pose:
    """Turn one motor's joint to `value` [rad, m], the other motors held, as far as the assembly mode goes.

    Raises:
        InvalidInput: q is not assembled, there is no such motor, or the motors depend on one another.
    """
    _assembled(robot, q)
    _check(index, robot.n_a, value)
    if not motors_are_free(robot):
        raise InvalidInput(
            f"{robot.name}: its {robot.n_a} motors drive {robot.n} degrees of freedom, so none of them can "
            f"move while all others rest; move the platform"
        )
    columns, lengths = passive_columns(robot), column_scale(robot)
    column = robot.actuated[index]
    start = difference(robot, np.asarray(pin.neutral(robot.model)), q[None])[0, column]

    def equations(here: Array) -> System:
        return system_at(robot, here[None], platform_coordinates(robot, frames_at(robot, here[None])))

    def step(here: Array, at: float, to: float) -> Array | None:
        system = equations(here)
        sign = mode_signs(robot, system)[1][0]
        rate = np.zeros(robot.model.nv)
        rate[column] = (to - at) * (value - start)
        try:
            J = system.closures[0]
            rate[columns] = -np.linalg.solve(J[:, columns], J[:, column] * rate[column])
            guess = now = integrate(robot, here[None], rate[None])[0]
            for _ in range(12):
                system = equations(now)
                newton = np.zeros(robot.model.nv)
                newton[columns] = -np.linalg.solve(
                    system.closures[0][:, columns], system.residual[0, robot.n :]
                )
                now = integrate(robot, now[None], newton[None])[0]
                if np.abs(newton / lengths).max() < 1e-10:
                    break
            else:
                return None
        except np.linalg.LinAlgError:
            return None
        same_mode = mode_signs(robot, equations(now))[1][0] == sign
        small = _is_small(robot, rate, difference(robot, guess, now[None])[0])
        return now if same_mode and small else None

    there, share = _as_far_as_possible(step, q)
    reason = (
        "A Type 2 singularity: here the motors lose their hold of the platform and can turn no further in "
        "this assembly mode. The platform can be led across; the motors cannot lead it."
    )
    return pose_at(robot, there, "" if share == 1.0 else reason)


def motors_are_free(robot: ParallelRobot) -> bool:
    """Whether one motor can move while the others rest."""
    return robot.n_a == robot.n and len(passive_columns(robot)) == len(loop_rows(robot).names)


def _as_far_as_possible(step: Callable[[Array, float, float], Array | None], q: Array) -> tuple[Array, float]:
    """Follow a way from 0 to 1 by steps that may be refused; where it ends, and how far that is."""
    at, length = 0.0, 0.25
    while at < 1.0:
        to = min(1.0, at + length)
        following = step(q, at, to)
        if following is None:
            length *= 0.5
            if length < SHORTEST:
                return q, at
        else:
            q, at, length = following, to, 2 * length
    return q, 1.0


def _is_small(robot: ParallelRobot, predicted: Array, corrected: Array) -> bool:
    lengths = column_scale(robot)
    return bool(
        np.abs(predicted / lengths).max() < LONGEST and np.abs(corrected / lengths).max() < CORRECTION
    )


def _assembled(robot: ParallelRobot, q: Array) -> Array:
    """The platform's coordinates at q, which has to be a configuration of closed loops."""
    if q.shape != (robot.model.nq,) or not np.all(np.isfinite(q)):
        raise InvalidInput(f"q: needs {robot.model.nq} finite numbers")
    x = platform_coordinates(robot, frames_at(robot, q[None]))
    if np.abs(system_at(robot, q[None], x).residual).max() > CLOSED * max(robot.length, 1.0):
        raise InvalidInput("q: its loops are not closed")
    return np.asarray(x[0])


def _check(index: int, count: int, value: float) -> None:
    if not 0 <= index < count:
        raise InvalidInput(f"index: needs 0 .. {count - 1}, got {index}")
    if not np.isfinite(value):
        raise InvalidInput(f"value: needs a finite number, got {value!r}")


def _leg_matrix(robot: ParallelRobot, system: System) -> Array:
    both = [scaled(robot, system.platform, None), scaled(robot, system.closures, loop_rows(robot))]
    return np.asarray(np.concatenate(both, axis=1)[0][:, moving_columns(robot)])


def _smallest(matrix: Array) -> float:
    return float(np.linalg.svd(matrix, compute_uv=False).min(initial=np.inf))


@lru_cache(maxsize=32)
def _usual_sizes(robot: ParallelRobot) -> tuple[float, float]:
    """Smallest singular values at the reference, of P and of the legs: what is small is judged by them."""
    reference = reference_configuration(robot)
    system = system_at(robot, reference.q[None], reference.x[None])
    passive = _smallest(passive_matrix(robot, system)[0])
    return max(passive, 0.01), max(_smallest(_leg_matrix(robot, system)), 0.01)
