"""Poses for many sets of motor angles at once, and for motor angles that come one after the other.

A stack is led from its start in a few equal steps, all rows in one call, and what is asked of a step of
`continuation` is asked of every row. Of rows of which some step is refused, the turning points
ahead are looked for in one call as well. A row without one is led alone, in steps as short as it takes
(`forward_kinematics`), and there it is told whether it arrives, or where and why it cannot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from framework.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays
from framework.errors import NotAssembled, finite_numbers
from framework.kinematics.assembly import Configuration
from framework.kinematics.closures import loop_wrenches
from framework.kinematics.continuation.forward_kinematics import (
    ForwardPose,
    check_motors_are_free,
    close_at_motors,
    forward_kinematics,
    motor_driven_rates,
    motors_turning_points,
    start_pose,
    type2_singularity,
)
from framework.kinematics.continuation.predictor_corrector import FIRST_STEP_RATIO, measure
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.modes import keeps_sign, passive_determinants
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.tolerances import BRANCHES_CROSS, BRANCHES_MEET, RANK_LOST

STEP_COUNT = round(1 / FIRST_STEP_RATIO)
MAX_STEP_ITERATIONS = 10  # of Newton's method; a step along the tangent that needs more is no good one


@dataclass(frozen=True, eq=False)
class PoseStack(ReadOnlyArrays):
    """Poses for T sets of motor angles; rows of `refused` are NaN. See `ForwardPose`."""

    q: Array  # (T, nq)
    x: Array  # (T, n)
    residual: Array  # (T,) the largest of all loop equations [m or rad]
    clearance: Array  # (T,) least singular value of P met on the way (radians, robot lengths)
    refused: Mapping[int, NotAssembled]  # by row: `Type2Singularity` says where it lies


def forward_kinematics_stack(
    robot: ParallelRobot, q_a: ArrayLike, *, near: ArrayLike | Configuration | None = None
) -> PoseStack:
    """Compute all joints and the platform for T sets of motor joints (T, n_a), each led from one pose.

    Args:
        near: an assembled configuration (nq,), the reference by default.

    Raises:
        InvalidInput: as `forward_kinematics`; what it refuses of single rows stands in the answer.
    """
    expect_robot(robot)
    targets = np.atleast_2d(
        finite_numbers(f"q_a ({', '.join(robot.actuator_names)})", q_a, robot.n_a, stacks=True)
    )
    check_motors_are_free(robot)
    start = start_pose(robot, near)
    turn = np.zeros((len(targets), robot.model.nv))
    turn[:, robot.actuated] = targets - robot.actuated_coordinates(start.q[None])
    stack, share = _lead(robot, start.q, start.x, turn)
    short = np.flatnonzero(share < 1.0)
    refused: dict[int, NotAssembled] = _turning(robot, stack, short, share, targets, turn)
    for k in map(int, short):
        if k not in refused:
            try:
                alone = forward_kinematics(robot, targets[k], near=start)
            except NotAssembled as refusal:
                refused[k] = refusal
            else:
                for name, values in stack.items():
                    values[k] = getattr(alone, name)
    for values in stack.values():
        values[list(refused)] = np.nan
    return PoseStack(**stack, refused=MappingProxyType(dict(sorted(refused.items()))))


def _turning(
    robot: ParallelRobot,
    stack: dict[str, Array],
    short: IntArray,
    share: Array,
    targets: Array,
    turn: Array,
) -> dict[int, NotAssembled]:
    """Return the refusals of those rows, led as far as `share` says, that have a turning point ahead."""
    if not len(short) or not len(robot.following):
        return {}
    ahead = motors_turning_points(robot, stack["q"][short], share[short], turn[short])
    platform = robot.platform.coordinates(ahead.linearised.frames)
    x = robot.platform.unwrap(platform, stack["x"][short])
    residual = np.abs(ahead.linearised.residual[:, robot.n :]).max(axis=1)
    return {
        int(k): type2_singularity(
            robot, ahead.share[i], ahead.q[i], x[i], targets[k], residual=float(residual[i])
        )
        for i, k in enumerate(short)
        if ahead.found[i]
    }


def _lead(robot: ParallelRobot, q: Array, x: Array, turn: Array) -> tuple[dict[str, Array], Array]:
    """Follow motors that turn (T, nv) in `STEP_COUNT` steps; return the poses and the share (T,) of each way.

    A row of which a step is refused stays before it.
    """
    count, start = len(turn), q
    q, x = np.repeat(q[None], count, axis=0), np.repeat(x[None], count, axis=0)
    linearised = linearised_at(robot, q, None)
    rate, share, least = _rates(robot, linearised, turn), np.zeros(count), clearance(robot, linearised)
    sign, size = passive_determinants(linearised)
    live = np.flatnonzero(least > RANK_LOST)

    for k in range(1, STEP_COUNT + 1):
        predicted = integrate(robot, q[live], rate[live] / STEP_COUNT)
        corrected, linearised, closed = close_at_motors(
            robot, start, k / STEP_COUNT * turn[live], predicted, iterations=MAX_STEP_ITERATIONS
        )
        live, predicted, corrected = live[closed], predicted[closed], corrected[closed]
        linearised = linearised.select(np.flatnonzero(closed))
        clear, ahead = clearance(robot, linearised), _rates(robot, linearised, turn[live])
        determinants = passive_determinants(linearised)
        step = measure(
            robot, difference(robot, predicted, corrected), rate[live] / STEP_COUNT, ahead / STEP_COUNT
        )
        kept = step.small & (step.straight | (clear > BRANCHES_CROSS))
        kept &= clear > BRANCHES_MEET
        kept &= keeps_sign((sign[live], size[live]), determinants)
        live = live[kept]
        q[live], rate[live], share[live] = corrected[kept], ahead[kept], k / STEP_COUNT
        sign[live], size[live] = (part[kept] for part in determinants)
        least[live] = np.minimum(least[live], clear[kept])
        x[live] = robot.platform.unwrap(robot.platform.coordinates(linearised.frames)[kept], x[live])
    residual = np.abs(loop_wrenches(robot.rows, frames_at(robot, q)).residual).max(axis=1, initial=0.0)
    return {"q": q, "x": x, "residual": residual, "clearance": least}, share


def _rates(robot: ParallelRobot, linearised: LinearisedLoops, turn: Array) -> Array:
    """Compute rates (T, nv) of all joints while the motors turn; of the motors alone where P is singular."""
    rate = motor_driven_rates(robot, linearised, turn)
    return turn if rate is None else rate


def follow_motors(
    robot: ParallelRobot,
    samples: Iterable[ArrayLike],
    *,
    near: ArrayLike | Configuration | None = None,
    single_turn: bool = False,
) -> Iterator[ForwardPose]:
    """Yield the pose of each sample of the motors' joints; each starts from the one before.

    The platform's turns are counted on through the whole stream.

    Args:
        samples: motor joints (n_a,), joint side of the gears [rad, m], such as encoders give.
        near: an assembled configuration (nq,) to begin with, the reference by default.
        single_turn: hinges are given modulo a turn, and each sample is taken on the turn nearest to the one
            before; else by their word.

    Raises:
        InvalidInput, Type2Singularity, NotAssembled: of the sample that is asked for, see
            `forward_kinematics`. The stream ends there; what was yielded last is where the robot was.
    """
    expect_robot(robot)
    turning = ~robot.sliding[robot.actuated]
    pose = start_pose(robot, near)
    for sample in samples:
        q_a = finite_numbers(f"q_a ({', '.join(robot.actuator_names)})", sample, robot.n_a)
        if single_turn:
            turns = np.round((robot.actuated_coordinates(pose.q[None])[0] - q_a) / (2 * np.pi))
            q_a = np.where(turning, q_a + 2 * np.pi * turns, q_a)
        pose = forward_kinematics(robot, q_a, near=pose)
        yield pose
