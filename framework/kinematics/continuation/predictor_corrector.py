"""Follow a branch of assembled configurations by predictor and corrector, never jumping to another branch.

One loop for both ways to lead a robot: its platform along a path (`tracking`), its motors from angle to angle
(`forward_kinematics`). A step along the tangent counts only if what corrects it is small against it, and if
the place where it arrives belongs to the branch; otherwise it is halved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.kinematics.frames import difference, integrate
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.mechanism import Mechanism
from framework.tolerances import BRANCH_CORRECTION, BRANCH_STEP_SHARE, BRANCH_TURN

MIN_STEP_RATIO = 1e-7  # of the way: where shorter steps do not count either, the branch has ended
MAX_PREDICTOR_MOVE = 1.0  # [rad, lengths] of a joint in a step: beside a singularity tangents lead far
FIRST_STEP_RATIO = 1 / 8  # of the way
END_ROUNDING = 1e-12  # of the way: a place that near to its end is the end


class Place(NamedTuple):
    """An assembled configuration of the branch, and how it goes on."""

    q: Array  # (1, nq)
    linearised: LinearisedLoops
    rate: Array  # (1, nv) joint rates with respect to the parameter of the way
    clearance: float = np.inf  # from where the branch ends, if its parameter knows one


class Way(NamedTuple):
    """A branch as far as it could be followed, at K places."""

    at: Array  # (K,) parameter, from 0 ascending; the last one is 1 if the whole way could be followed
    places: tuple[Place, ...]  # K

    @property
    def q(self) -> Array:
        """The configurations (K, nq)."""
        return np.concatenate([place.q for place in self.places])

    @property
    def rate(self) -> Array:
        """The joint rates (K, nv) with respect to the parameter."""
        return np.concatenate([place.rate for place in self.places])

    @property
    def last(self) -> Place:
        """The place at which it ends."""
        return self.places[-1]

    @property
    def complete(self) -> bool:
        """Whether the whole way was followed."""
        return bool(self.at[-1] == 1.0)


class StepMeasure(NamedTuple):
    """The measures by which T steps are judged to have stayed on their branches."""

    correction: Array  # (T,) [rad, lengths] by which the predictor was corrected
    small: BoolArray  # (T,) whether that is small, or small against the step
    straight: BoolArray  # (T,) whether the tangent has turned no more than one branch allows


def measure(robot: Mechanism, moved: Array, along: Array, beyond: Array) -> StepMeasure:
    """Measure steps by their corrections and by the tangents' steps before and after, each (T, nv)."""
    motions = np.array([moved, along, beyond - along]) / robot.column_scale
    correction, advance, turned = np.abs(motions).max(axis=2, initial=0.0)
    straight = is_straight(turned, correction, advance)
    return StepMeasure(correction, is_small(correction, advance), straight)


def is_small(correction: Array, advance: Array) -> BoolArray:
    """Whether steps by `advance` (T,) along the tangent needed no more correction (T,) than on one branch."""
    least = np.maximum(BRANCH_CORRECTION, BRANCH_STEP_SHARE * advance)
    return (correction <= least) & (advance <= MAX_PREDICTOR_MOVE)


def is_straight(turned: Array, correction: Array, advance: Array) -> BoolArray:
    """Whether tangents have turned by no more (T,) than on one branch, see `is_small`."""
    return turned <= BRANCH_TURN * correction + BRANCH_STEP_SHARE * advance


def follow(
    robot: Mechanism,
    start: Place,
    arrive: Callable[[Array, Array], list[Place]],
    belongs: Callable[[Place, Place, bool], bool],
    *,
    end: Callable[[float, Place], tuple[float, Place] | None] | None = None,
    step: float = FIRST_STEP_RATIO,
    at_once: int = 1,
) -> Way:
    """Follow the branch through `start`, at parameter 0, towards parameter 1.

    Args:
        arrive: the places at parameters (T,) near configurations (T, nq), as far as loops close.
        belongs: whether a place (the second) is on the branch of the one before it; the third argument says
            whether the tangent has turned no more than the corrections of one branch allow.
        end: where the branch ends not far ahead of a place, if that is known: its parameter and the place.
            It is asked where a step does not count; without an answer the step is halved.
        step: the first one, as a share of the way.
        at_once: places that are looked for together along one tangent; each counts as a step from the one
            before it, or not at all.
    """
    parameter, place, parameters, places = 0.0, start, [0.0], [start]
    while parameter < 1.0:
        fastest = float(np.abs(place.rate / robot.column_scale).max(initial=0.0))
        step = min(step, 1.0 - parameter)
        if step * fastest > MAX_PREDICTOR_MOVE:
            step = 0.99 * MAX_PREDICTOR_MOVE / fastest  # rounding is not to make it longer again
        if step < MIN_STEP_RATIO:
            break
        further = (parameter + step * k for k in range(2, at_once + 1))
        inside = (s for s in further if s < 1.0 + 0.5 * MIN_STEP_RATIO)
        near = (s for s in inside if (s - parameter) * fastest < MAX_PREDICTOR_MOVE)
        ahead = np.array([1.0 if s > 1.0 - END_ROUNDING else s for s in (parameter + step, *near)])
        predicted, correction = integrate(robot, place.q, place.rate * (ahead - parameter)[:, None]), np.inf
        for following, next_place in zip(ahead, arrive(ahead, predicted), strict=False):
            along, beyond = (following - parameter) * place.rate, (following - parameter) * next_place.rate
            moved = difference(robot, integrate(robot, place.q, along)[0], next_place.q)
            measured = measure(robot, moved, along, beyond)
            if not (measured.small[0] and belongs(place, next_place, bool(measured.straight[0]))):
                break
            parameter, place, correction = float(following), next_place, float(measured.correction[0])
            parameters.append(parameter)
            places.append(place)
            if correction < 0.2 * BRANCH_CORRECTION and step < 2 * FIRST_STEP_RATIO:
                step = min(2.0 * step, 2 * FIRST_STEP_RATIO)
                break
        if correction == np.inf:  # not one step counts
            ended = None if end is None else end(parameter, place)
            if ended is not None:
                parameters.append(ended[0])
                places.append(ended[1])
                break
            step *= 0.5
    return Way(np.array(parameters), tuple(places))
