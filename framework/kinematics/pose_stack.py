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
from framework.kinematics.continuation import FIRST_STEP, measure
from framework.kinematics.forward_kinematics import (
    CROSSING,
    MEETING,
    ForwardPose,
    check_motors_are_free,
    forward_kinematics,
    motors_turning_points,
    start_pose,
    type2_singularity,
)
from framework.kinematics.frames import between, difference, frames_at, integrate
from framework.kinematics.inverse_kinematics import VANISHED, System, system_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.newton import Linear, Which, newton
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot

STEPS = round(1 / FIRST_STEP)
PASSES = 10  # of Newton's method; a step along the tangent that needs more is no good one


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
    """All joints and the platform for T sets of motor joints (T, n_a), each led there from one pose.

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
    """The refusals of those rows, led as far as `share` says, that have a turning point ahead."""
    if not len(short) or not len(robot.following):
        return {}
    ahead = motors_turning_points(robot, stack["q"][short], share[short], turn[short])
    platform, residuals = robot.platform.coordinates(ahead.system.frames), ahead.system.residual[:, robot.n :]
    x = robot.platform.unwrap(platform, stack["x"][short])
    residual = np.abs(residuals).max(axis=1)
    return {
        int(k): type2_singularity(
            robot, ahead.share[i], ahead.q[i], x[i], targets[k], residual=float(residual[i])
        )
        for i, k in enumerate(short)
        if ahead.found[i]
    }


def _lead(robot: ParallelRobot, q: Array, x: Array, turn: Array) -> tuple[dict[str, Array], Array]:
    """Poses on the way of motors that turn (T, nv), in STEPS steps, and the share (T,) gone of each way.

    A row of which a step is refused stays before it.
    """
    count, columns, start, last = len(turn), robot.following, q, np.log(VANISHED)
    q, x = np.repeat(q[None], count, axis=0), np.repeat(x[None], count, axis=0)
    system = system_at(robot, q, None)
    rate, share, least = _rates(robot, system, turn), np.zeros(count), clearance(robot, system)
    sign, size = _determinants(system)
    live = np.flatnonzero(least > VANISHED)

    def evaluate(q: Array, which: Which) -> System:
        return system_at(robot, q, None)

    def linear(system: System) -> Linear:
        return Linear(system.residual[:, robot.n :], system.passive_factors)

    for k in range(1, STEPS + 1):
        predicted = integrate(robot, q[live], rate[live] / STEPS)
        off = k / STEPS * turn[live] - difference(robot, start, predicted)
        exact = np.zeros_like(off)
        exact[:, robot.actuated] = off[:, robot.actuated]
        there = integrate(robot, predicted, exact)
        if len(columns):
            there, _, closed = newton(robot, there, columns, evaluate, linear, iterations=PASSES)
            live, predicted, there = live[closed], predicted[closed], there[closed]
        system = system_at(robot, there, None)
        clear, ahead = clearance(robot, system), _rates(robot, system, turn[live])
        sign_there, size_there = _determinants(system)
        step = measure(robot, between(robot, predicted, there), rate[live] / STEPS, ahead / STEPS)
        kept = step.small & (step.straight | (clear > CROSSING))
        kept &= clear > MEETING
        kept &= (sign_there == sign[live]) & (size_there - size[live] > last)
        live = live[kept]
        q[live], rate[live], share[live] = there[kept], ahead[kept], k / STEPS
        sign[live], size[live] = sign_there[kept], size_there[kept]
        least[live] = np.minimum(least[live], clear[kept])
        x[live] = robot.platform.unwrap(robot.platform.coordinates(system.frames)[kept], x[live])
    residual = np.abs(loop_wrenches(robot.rows, frames_at(robot, q)).residual).max(axis=1, initial=0.0)
    return {"q": q, "x": x, "residual": residual, "clearance": least}, share


def _rates(robot: ParallelRobot, system: System, turn: Array) -> Array:
    """Rates (T, nv) of all joints while the motors turn; those of the motors alone where P is singular."""
    rate, columns = turn.copy(), robot.following
    if len(columns):
        driven = np.einsum("tmv,tv->tm", system.closures, turn)
        try:
            rate[:, columns] = -system.passive_factors.solve(driven)
        except np.linalg.LinAlgError:
            return turn
    return rate


def _determinants(system: System) -> tuple[Array, Array]:
    """Signs and logarithms (T,) of det P; of no columns 1 and 0."""
    if system.equations.passive_band is None:
        return np.ones(len(system.residual)), np.zeros(len(system.residual))
    return system.passive_factors.slogdet


def follow_motors(
    robot: ParallelRobot,
    samples: Iterable[ArrayLike],
    *,
    near: ArrayLike | Configuration | None = None,
    single_turn: bool = False,
) -> Iterator[ForwardPose]:
    """The pose for each sample of the motors' joints, as it comes; each starts from the one before.

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
    here = start_pose(robot, near)
    for sample in samples:
        q_a = finite_numbers(f"q_a ({', '.join(robot.actuator_names)})", sample, robot.n_a)
        if single_turn:
            turns = np.round((robot.actuated_coordinates(here.q[None])[0] - q_a) / (2 * np.pi))
            q_a = np.where(turning, q_a + 2 * np.pi * turns, q_a)
        here = forward_kinematics(robot, q_a, near=here)
        yield here
