"""Continue reached poses to their neighbours on a grid, in the same working mode.

A pose is predicted from a neighbour along the tangent and corrected by Newton's method. It is accepted as
part of the neighbour's branch only if the correction is small and no Type 1 singularity lies between: rules
of `predictor_corrector`, here for a stack of steps. Coarse poses are reached first, then the poses between
them with half the stride, and so on: each pose is computed once, and stacks are long.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.continuation.predictor_corrector import accept_steps, is_small
from framework.kinematics.frames import difference, integrate, largest_motion
from framework.kinematics.inverse_kinematics import close_in_place
from framework.kinematics.linearised_loops import linearised_at, linearised_at_reference
from framework.kinematics.modes import ModeStates, share_working_mode
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, assign, select

STEP_PARTS = 4  # into which a step that is too long to be trusted is divided
DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1))  # rows and columns from a neighbour to a pose


ReasonArray = NDArray[np.uint8]  # of `PoseReason`


class PoseReason(IntEnum):
    """Reasons why a pose has no value, of which the largest is reported."""

    REACHED = 0
    NO_NEIGHBOUR = 1  # no neighbour is reached
    OPEN = 2  # the loops close from no neighbour
    OTHER_MODE = 3  # the loops close, but the step is not trusted: it passes Type 1, or comes too near


REASON_WORDS = {
    PoseReason.REACHED: "reached",
    PoseReason.NO_NEIGHBOUR: "not joined to the reference",
    PoseReason.OPEN: "out of reach",
    PoseReason.OTHER_MODE: "another working mode, or too near its end",
}


class StepEnds(NamedTuple):
    """The ends of steps from T poses."""

    states: ModeStates  # valid where the step was accepted, as their configurations
    reason: ReasonArray  # (T,) REACHED where the step was accepted, else why not

    @property
    def q(self) -> Array:
        """Configurations (T, nq), valid where the step was accepted."""
        return self.states.q


def fill_grid(robot: ParallelRobot, x: Array, q: Array, reason: ReasonArray, strides: Sequence[int]) -> None:
    """Assemble the poses of a grid from their neighbours, in place.

    A pose whose reason is NO_NEIGHBOUR is tried from each reached neighbour until one succeeds. Poses with
    another reason are not tried.

    Args:
        x: (I, J, n) platform coordinates.
        q: (I, J, nq) configurations; NaN at poses that are not reached.
        reason: (I, J) `PoseReason` of each pose.
        strides: distances between neighbours [rows or columns], descending; poses are counted from the first
            one. With the last stride a step that cannot be trusted is divided into `STEP_PARTS`.
    """
    wanted = reason == PoseReason.NO_NEIGHBOUR
    near = wanted.copy()  # (I, J) poses at which steps may begin or end
    for stride in strides:
        for direction in DIRECTIONS:
            near[::stride, ::stride] |= _shift_mask(wanted[::stride, ::stride], *direction)
    # the states of these poses, each computed once, by their numbers
    numbers = np.cumsum(near).reshape(near.shape) - 1
    of_reference = ModeStates.of(robot, linearised_at_reference(robot))
    states = ModeStates(*(np.empty((near.sum(), *part.shape[1:])) for part in of_reference))
    filled = near & np.isfinite(q[..., 0])
    if filled.any():
        assign(states, numbers[filled], ModeStates.of(robot, linearised_at(robot, q[filled])))
    for stride in strides:
        lattice = np.s_[::stride, ::stride]
        parts = STEP_PARTS if stride == strides[-1] else 1
        grid = x[lattice], q[lattice], reason[lattice], wanted[lattice], numbers[lattice]
        _fill_lattice(robot, *grid, states, parts)


def _fill_lattice(
    robot: ParallelRobot,
    x: Array,
    q: Array,
    reason: ReasonArray,
    wanted: BoolArray,
    numbers: IntArray,
    states: ModeStates,
    parts: int,
) -> None:
    """Fill the wanted poses (I, J) of one lattice in waves, in place.

    In each wave every wanted pose that is not filled is tried from one filled neighbour, from which it has
    not been tried before. If a pose fails for several reasons, the largest is stored. The end of a step hands
    its state on to the steps that begin there.

    Args:
        x: (I, J, n) platform coordinates.
        q: (I, J, nq) configurations; NaN at poses that are not filled.
        reason: (I, J) `PoseReason` of each pose.
        wanted: (I, J) mask of the poses to fill.
        numbers: (I, J) of the poses' states.
        states: of the filled poses, to which those of new ends are added.
        parts: number of parts into which a step that is not trusted is divided.
    """
    untried = np.ones((len(DIRECTIONS), *reason.shape), dtype=bool)  # neighbours of each pose
    while True:
        is_target, (i, j), between = _choose_neighbours(np.isfinite(q[..., 0]), wanted, untried)
        if not is_target.any():
            return
        # step from all neighbours at once
        opposite_i, opposite_j = (2 * np.argwhere(is_target).T - (i, j))[:, between]
        opposites = between, select(states, numbers[opposite_i, opposite_j])
        starts = select(states, numbers[i, j])
        ends = continue_states(robot, starts, x[i, j], x[is_target], parts, opposites)
        reached = ends.reason == PoseReason.REACHED
        assign(states, numbers[is_target][reached], select(ends.states, reached))
        q[is_target] = np.where(reached[:, None], ends.q, np.nan)
        reason[is_target] = np.where(reached, PoseReason.REACHED, np.maximum(reason[is_target], ends.reason))


def _choose_neighbours(
    filled: BoolArray, wanted: BoolArray, untried: BoolArray
) -> tuple[BoolArray, IntArray, IntArray]:
    """Choose an untried, filled neighbour for each wanted pose that is not filled.

    Args:
        filled, wanted: masks (I, J).
        untried: (4, I, J) neighbours of each pose in DIRECTIONS; those chosen are removed, in place.

    Returns:
        Mask (I, J) of these poses; rows and columns (2, poses) of their neighbours; which of the poses also
        have a filled neighbour opposite to this one.
    """
    is_target, is_between = np.zeros((2, *filled.shape), dtype=bool)
    sources = np.zeros((*filled.shape, 2), dtype=np.intp)  # row and column of the neighbour
    for k, (down, right) in enumerate(DIRECTIONS):
        chosen = _shift_mask(filled, down, right) & wanted & ~filled & untried[k] & ~is_target
        untried[k] &= ~chosen
        is_target |= chosen
        is_between |= chosen & _shift_mask(filled, -down, -right)
        sources[chosen] = np.argwhere(chosen) - (down, right)  # DIRECTIONS lead from neighbour to pose
    return is_target, sources[is_target].T, np.flatnonzero(is_between[is_target])


def _shift_mask(mask: BoolArray, down: int, right: int) -> BoolArray:
    """Return a mask (I, J) moved `down` rows and `right` columns, -1, 0 or 1 each; false at the border."""
    rows, columns = mask.shape
    return np.pad(mask, 1)[1 - down :, 1 - right :][:rows, :columns]


def step_poses(robot: ParallelRobot, q: Array, start: Array, end: Array, parts: int = 1) -> StepEnds:
    """Continue configurations q (T, nq) from platform coordinates `start` to `end` (T, n).

    A step that closes the loops but is not trusted (OTHER_MODE) is tried again in `parts` equal steps:
    shorter steps need smaller corrections, so they are trusted unless the branch really ends at Type 1.
    """
    return continue_states(robot, ModeStates.of(robot, linearised_at(robot, q)), start, end, parts)


def continue_states(
    robot: ParallelRobot,
    states: ModeStates,
    start: Array,
    end: Array,
    parts: int,
    opposites: tuple[IntArray, ModeStates] | None = None,
) -> StepEnds:
    """Continue T configurations from `start` to `end` (T, n), as `step_poses` and with its `parts`.

    The `opposites` of `_step_once` are for the undivided steps.
    """
    ends = _step_once(robot, states, start, end, opposites)
    untrusted = np.flatnonzero(ends.reason == PoseReason.OTHER_MODE)
    if parts == 1 or not len(untrusted):
        return ends

    # repeat these steps part by part; in place, `ends` holds the states reached so far
    assign(ends.states, untrusted, select(states, untrusted))  # the starts
    live = untrusted  # steps whose parts have all been accepted so far
    for k in range(parts):
        offset = end[live] - start[live]
        part_start = start[live] + offset * (k / parts)
        part = _step_once(robot, select(ends.states, live), part_start, part_start + offset / parts)
        assign(ends.states, live, part.states)
        ends.reason[live] = part.reason
        live = live[part.reason == PoseReason.REACHED]
        if not len(live):
            break
    return ends


def _step_once(
    robot: ParallelRobot,
    states: ModeStates,
    start: Array,
    end: Array,
    opposites: tuple[IntArray, ModeStates] | None = None,
) -> StepEnds:
    """Continue T configurations from `start` to `end` (T, n) in one step.

    A step that closes the loops is accepted by the rules of `accept_steps`; otherwise its reason is
    OTHER_MODE, or OPEN if the loops do not close.

    Args:
        opposites: steps (k,) whose ends lie halfway between their starts and other poses; states of these.
    """
    newton_steps = 10  # largest number that corrects a prediction
    # [rad, robot lengths] a step below it is the last: it leaves the loops open by less than its square
    last_step = 1e-6
    # predict
    # The platform's step as a twist (T, n). If the platform turns, the same change of coordinates is one
    # twist at the start and another one at the end. The one at the end gives the tangent there, by which
    # steps are accepted. `twist` also returns a derivative, which is not used.
    start_twist, _ = robot.platform.twist(start, end - start)
    end_twist, _ = robot.platform.twist(end, end - start)
    prediction = states.joint_rates(robot, start_twist)  # (T, nv) step along the tangent, springs at rest
    predicted = integrate(robot, states.q, prediction)

    # Between two poses at -h and h the cubic polynomial along both tangents, (q(h) + q(-h)) / 2
    # + h (q'(-h) - q'(h)) / 4, is wrong by h^4. Balls turn along the chord first: then their turns, which do
    # not commute, are wrong by no lower power.
    guess = predicted.copy()
    if opposites is not None and len(opposites[0]):
        between, others = opposites
        half_step = end[between] - start[between]
        opposite_twist, _ = robot.platform.twist(end[between] + half_step, half_step)
        half = 0.5 * difference(robot, states.q[between], others.q)  # (k, nv) along the chord
        bend = 0.25 * (prediction[between] - others.joint_rates(robot, opposite_twist))
        middle = integrate(robot, integrate(robot, states.q[between], half), bend)
        offset = largest_motion(robot, difference(robot, predicted[between], middle))
        is_near = is_small(offset, largest_motion(robot, prediction[between]))  # both on one branch
        guess[between[is_near]] = middle[is_near]

    # correct, and judge the steps that close
    reason = np.full(len(start), PoseReason.OPEN, dtype=np.uint8)
    ends = select(states, np.arange(len(start)))  # a copy, of which the starts stay where no loop closes
    corrected = guess
    for closed, loops, _ in close_in_place(
        robot, end, corrected, iterations=newton_steps, farthest=MAX_NEWTON_STEP, enough=last_step
    ):
        # the loops before so short a step serve for its end
        closed_states = ModeStates.of(robot, loops)._replace(q=corrected[closed])
        accepted, _correction = accept_steps(
            robot,
            difference(robot, predicted[closed], corrected[closed]),
            prediction[closed],
            closed_states.joint_rates(robot, end_twist[closed]),
            keeps_mode=share_working_mode(robot, select(states, closed), closed_states),
            ends=loops,
        )
        reason[closed] = np.where(accepted, PoseReason.REACHED, PoseReason.OTHER_MODE)
        assign(ends, closed, closed_states)
    return StepEnds(ends, reason)
