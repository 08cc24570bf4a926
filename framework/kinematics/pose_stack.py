"""Poses for many sets of motor angles at once, and for motor angles that come one after the other.

A stack is led from its start in a few equal steps, all rows in one call, and what is asked of a step of
`continuation` is asked of every row. A row of which some step is refused is led alone, in steps as short as
it takes (`forward_kinematics`), and there it is told whether it arrives, or where and why it cannot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays
from framework.errors import NotAssembled, finite_numbers
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation import FIRST_STEP, measure
from framework.kinematics.forward_kinematics import (
    CROSSING,
    ForwardPose,
    check_motors_are_free,
    forward_kinematics,
    start_pose,
)
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import VANISHED, System, system_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.newton import Linear, Which, newton
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot

STEPS = round(1 / FIRST_STEP)


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
    stack, arrived = _lead(robot, start.q, start.x, targets)
    refused = {}
    for k in map(int, np.flatnonzero(~arrived)):
        try:
            alone = forward_kinematics(robot, targets[k], near=start)
        except NotAssembled as refusal:
            refused[k] = refusal
            for values in stack.values():
                values[k] = np.nan
        else:
            for name, values in stack.items():
                values[k] = getattr(alone, name)
    return PoseStack(**stack, refused=MappingProxyType(refused))


def _lead(robot: ParallelRobot, q: Array, x: Array, targets: Array) -> tuple[dict[str, Array], BoolArray]:
    """Poses on the way to targets (T, n_a) in STEPS steps, and which of them (T,) have arrived."""
    count, columns = len(targets), robot.following
    turn = np.zeros((count, robot.model.nv))
    turn[:, robot.actuated] = targets - robot.actuated_coordinates(q[None])
    start, x = q, np.repeat(x[None], count, axis=0)
    q = np.repeat(q[None], count, axis=0)
    system = system_at(robot, q, None)
    on_branch, rate = np.ones(count, dtype=bool), _rates(robot, system, turn)
    least, determinant = clearance(robot, system), _determinants(system)
    on_branch &= least > VANISHED

    def evaluate(q: Array, which: Which) -> System:
        return system_at(robot, q, None)

    def linear(system: System) -> Linear:
        return Linear(system.residual[:, robot.n :], system.passive_factors)

    for k in range(1, STEPS + 1):
        predicted = integrate(robot, q, rate / STEPS)
        off = k / STEPS * turn - difference(robot, start, predicted)
        exact = np.zeros_like(turn)
        exact[:, robot.actuated] = off[:, robot.actuated]
        there = integrate(robot, predicted, exact)
        if len(columns):
            there, system, closed = newton(robot, there, columns, evaluate, linear)
            on_branch &= closed
        there = np.where(on_branch[:, None], there, q)  # who has lost the branch stays where it was
        system = system_at(robot, there, None)
        ahead = _rates(robot, system, turn)
        clear, now = clearance(robot, system), _determinants(system)
        moved = _differences(robot, predicted, there)
        measured = measure(robot, moved, rate / STEPS, ahead / STEPS)
        on_branch &= measured.small & (measured.straight | (clear > CROSSING))
        on_branch &= (now[0] == determinant[0]) & (now[1] - determinant[1] > np.log(VANISHED))
        q = np.where(on_branch[:, None], there, q)
        rate = np.where(on_branch[:, None], ahead, 0.0)
        determinant, least = now, np.minimum(least, clear)
        x = robot.platform.unwrap(robot.platform.coordinates(system.frames), x)
    return {"q": q, "x": x, "residual": system.gap, "clearance": least}, on_branch


def _differences(robot: ParallelRobot, start: Array, q: Array) -> Array:
    """Tangent vectors (T, nv) from each of start (T, nq) to each of q (T, nq)."""
    if robot.model.nq == robot.model.nv:
        return q - start
    return np.array([difference(robot, one, two[None])[0] for one, two in zip(start, q, strict=True)])


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
