"""Follow a branch of assembled configurations by predictor and corrector, never jumping to another branch.

The platform follows a path (`tracking`), or the motors turn from angle to angle (`motor_curves`). A step
along the tangent is accepted if its correction is small against it and its end belongs to the branch;
otherwise it is halved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import LEAST_DIVISOR, Array, BoolArray
from framework.kinematics.frames import difference, integrate, largest_motion
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.mechanism import Mechanism
from framework.tolerances import BRANCH_CORRECTION, BRANCH_STEP_SHARE, BRANCH_TURN

MIN_STEP_RATIO = 1e-7  # of the curve: if shorter steps are refused too, the branch has ended
MAX_PREDICTOR_MOVE = 1.0  # [rad, lengths] of a joint in a step: beside a singularity tangents lead far
FIRST_STEP_RATIO = 1 / 8  # of the curve
BRANCH_GROWTH = 0.2 * BRANCH_CORRECTION  # [rad, lengths] after a smaller correction the step is doubled
MAX_STEP_RATIO = 2 * FIRST_STEP_RATIO  # of the curve: steps grow up to this
END_ROUNDING = 1e-12  # of the curve: a pose that near to its end is the end


class BranchPoses(NamedTuple):
    """K assembled configurations of the branch, with its tangents."""

    q: Array  # (K, nq)
    linearised: LinearisedLoops
    rate: Array  # (K, nv) joint rates with respect to the parameter of the curve

    @property
    def last(self) -> BranchPoses:
        """The last pose, K = 1."""
        return self._part(slice(-1, None)) if len(self.q) > 1 else self

    def first(self, count: int) -> BranchPoses:
        """Return the first poses."""
        return self._part(slice(count)) if count < len(self.q) else self

    def _part(self, which: slice) -> BranchPoses:
        return BranchPoses(self.q[which], self.linearised.select(which), self.rate[which])


class FollowedCurve(NamedTuple):
    """The followed part of a branch, at K poses."""

    at: Array  # (K,) parameter, from 0 ascending; the last one is 1 if the whole curve could be followed
    stretches: tuple[BranchPoses, ...]  # K poses together

    @property
    def q(self) -> Array:
        """The configurations (K, nq)."""
        return np.concatenate([poses.q for poses in self.stretches])

    @property
    def rate(self) -> Array:
        """The joint rates (K, nv) with respect to the parameter."""
        return np.concatenate([poses.rate for poses in self.stretches])

    @property
    def last(self) -> BranchPoses:
        """The last pose."""
        return self.stretches[-1].last

    @property
    def complete(self) -> bool:
        """Whether the whole curve was followed."""
        return bool(self.at[-1] == 1.0)


class StepMeasure(NamedTuple):
    """Measures of whether T steps stayed on their branches."""

    correction: Array  # (T,) [rad, lengths] by which the predictor was corrected
    small: BoolArray  # (T,) whether it is small, or small against the step
    straight: BoolArray  # (T,) whether the tangent has turned no more than one branch allows


def measure(robot: Mechanism, correction: Array, along: Array, beyond: Array) -> StepMeasure:
    """Measure steps by their corrections and by the tangents' steps before and after, each (T, nv)."""
    corrected, advance = largest_motion(robot, correction), largest_motion(robot, along)
    straight = is_straight(largest_motion(robot, beyond - along), corrected, advance)
    return StepMeasure(corrected, is_small(corrected, advance), straight)


def is_small(correction: Array, advance: Array) -> BoolArray:
    """Whether steps by `advance` (T,) along the tangent needed no more correction (T,) than on one branch."""
    least = np.maximum(BRANCH_CORRECTION, BRANCH_STEP_SHARE * advance)
    return (correction <= least) & (advance <= MAX_PREDICTOR_MOVE)


def is_straight(turned: Array, correction: Array, advance: Array) -> BoolArray:
    """Whether tangents have turned by no more (T,) than on one branch, see `is_small`."""
    return turned <= BRANCH_TURN * correction + BRANCH_STEP_SHARE * advance


def follow(
    robot: Mechanism,
    start: BranchPoses,
    arrive: Callable[[Array, Array], BranchPoses | None],
    belong: Callable[[BranchPoses, BranchPoses, BoolArray], BoolArray],
    *,
    end: Callable[[float, BranchPoses], tuple[float, BranchPoses] | None] | None = None,
    step: float = FIRST_STEP_RATIO,
    at_once: int = 1,
) -> FollowedCurve:
    """Follow the branch through `start` (K = 1), at parameter 0, towards parameter 1.

    Args:
        arrive: the poses at parameters (T,) near configurations (T, nq), up to the first whose loops do not
            close; None if it is the first of all.
        belong: which of K poses (second argument) are on the branch of their predecessors, the first after
            a pose (first argument); the third tells whose tangent has turned no more than on one branch.
        end: the end of the branch not far ahead of a pose, if it finds one: parameter and pose. It is
            called after a refused step; if it returns None the step is halved.
        step: the first one, as a share of the curve.
        at_once: poses computed together along one tangent, each accepted as a step from its predecessor.
    """
    parameter, pose, parameters, stretches = 0.0, start, [np.zeros(1)], [start]
    while parameter < 1.0:
        step = float(cut_to_predictor(robot, pose.rate, np.array([min(step, 1.0 - parameter)]))[0])
        if step < MIN_STEP_RATIO:
            break
        ahead = _parameters_ahead(robot, pose, parameter, step, at_once)
        lengths = (ahead - parameter)[:, None]
        arrived = arrive(ahead, integrate(robot, pose.q, lengths * pose.rate))
        accepted = None if arrived is None else _accept_steps(robot, pose, arrived, lengths, belong)
        if accepted is not None:
            poses, correction = accepted
            parameters.append(ahead[: len(poses.q)])
            stretches.append(poses)
            parameter, pose = float(parameters[-1][-1]), poses.last
            if correction < BRANCH_GROWTH and step < MAX_STEP_RATIO:
                step = min(2.0 * step, MAX_STEP_RATIO)
            continue
        ended = None if end is None else end(parameter, pose)
        if ended is not None:
            parameters.append(np.array([ended[0]]))
            stretches.append(ended[1])
            break
        step *= 0.5
    return FollowedCurve(np.concatenate(parameters), tuple(stretches))


def cut_to_predictor(robot: Mechanism, rate: Array, step: Array) -> Array:
    """Cut steps (T,) of the parameter so that no joint moves by `MAX_PREDICTOR_MOVE` at rates (T, nv)."""
    speed = largest_motion(robot, rate)
    longest = 0.99 * MAX_PREDICTOR_MOVE / np.maximum(speed, LEAST_DIVISOR)  # 0.99: not longer by rounding
    return np.where(step * speed > MAX_PREDICTOR_MOVE, longest, step)


def _parameters_ahead(
    robot: Mechanism, pose: BranchPoses, parameter: float, step: float, count: int
) -> Array:
    """Return up to `count` parameters one step apart, to the end and as far as the predictor may lead."""
    lengths = step * np.arange(1, count + 1)
    speed = largest_motion(robot, pose.rate)[0]
    near = (parameter + lengths < 1.0 + 0.5 * MIN_STEP_RATIO) & (lengths * speed < MAX_PREDICTOR_MOVE)
    near[0] = True
    ahead = parameter + lengths[near]
    return np.where(ahead > 1.0 - END_ROUNDING, 1.0, ahead)


def _accept_steps(
    robot: Mechanism,
    start: BranchPoses,
    arrived: BranchPoses,
    lengths: Array,
    belong: Callable[[BranchPoses, BranchPoses, BoolArray], BoolArray],
) -> tuple[BranchPoses, float] | None:
    """Return the poses of accepted steps, up to the first refused, and the correction of the last step.

    `lengths` (T, 1) are the parameters of the steps' ends, from the start. None if the first is refused.
    """
    steps = np.diff(lengths[: len(arrived.q)], axis=0, prepend=0.0)
    q, rate = np.concatenate([start.q, arrived.q[:-1]]), np.concatenate([start.rate, arrived.rate[:-1]])
    along = steps * rate
    corrections = difference(robot, integrate(robot, q, along), arrived.q)
    correction, small, straight = measure(robot, corrections, along, steps * arrived.rate)
    count = _count_leading(small)
    if count:
        count = _count_leading(belong(start, arrived.first(count), straight[:count]))
    return (arrived.first(count), float(correction[count - 1])) if count else None


def _count_leading(true: BoolArray) -> int:
    """Count the leading true values of (K,)."""
    return len(true) if true.all() else int(np.argmin(true))
