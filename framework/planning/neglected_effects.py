"""The effects that a motion's torques leave out, each with the motor torque that it would add.

* Springs left rigid, geometry and inertia of the deflections, dry friction: the number is the difference of
  the torques of the model with and without the effect (`model_on_motion`).
* Idle turns: the number is the torque that would hold them, which the certificate contains.
* Parts of a foreign file that its reader left out: there is no number.

Masses without which the robot was made, as at the lower levels of fidelity, are not listed: the robot does
not know of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.kinematics.inverse_kinematics import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import FLEXIBILITIES
from framework.numerics.arrays import Array
from framework.planning.model_on_motion import ModelOnMotion
from framework.planning.motion_scales import largest_by_unit
from framework.tolerances import TORQUE_TAIL

MAX_NAMES = 4  # of springs or idle turns that are listed by name

# Each effect in words, with a function that computes the torques (T, n_a) it adds, or raises NoAnswer.
Differences = Iterator[tuple[str, Callable[[], Array]]]


class NeglectedEffect(NamedTuple):
    """An effect that the torques of a motion leave out.

    effect: description in words.
    torque: the largest torque that the effect adds at a motor [N m or N, motor side]; None if unknown.
    motor: the joint of that motor; empty if the effect concerns no single motor.
    share: `torque` divided by the largest planned torque of motors of the same unit; None if unknown.
    """

    effect: str
    torque: float | None = None
    motor: str = ""
    share: float | None = None


def neglected_effects(dynamics: InverseDynamics) -> tuple[NeglectedEffect, ...]:
    """Compute the neglected effects of a motion, largest first, unknown ones last.

    Effects smaller than the tail of the torques are not listed. Each number is a first-order estimate for one
    effect alone. It is only an order of magnitude if it comes near the largest torque, as for springs under a
    load across a crossing.
    """
    robot = dynamics.robot
    times = np.linspace(0.0, dynamics.duration, 501)
    peaks = largest_by_unit(robot, np.abs(dynamics.torque(times)).max(axis=0))
    differences = [*_spring_differences(dynamics), *_friction_differences(dynamics)]
    effects = [
        *(_measure_effect(robot, peaks, *difference) for difference in differences),
        *_idle_turn_effects(dynamics, peaks),
        *map(NeglectedEffect, robot.description.left_out),
    ]
    unknown = [effect for effect in effects if effect.share is None]
    resolved = max(TORQUE_TAIL, dynamics.certificate.tail)
    measured = [effect for effect in effects if (effect.share or 0.0) > resolved]
    return (*sorted(measured, key=lambda effect: -(effect.share or 0.0)), *unknown)


def _measure_effect(
    robot: ParallelRobot, peaks: Array, effect: str, difference: Callable[[], Array]
) -> NeglectedEffect:
    """Measure the largest torque of an effect relative to the planned peaks (n_a,).

    If the torque cannot be computed, the result says why.
    """
    try:
        largest = np.abs(difference()).max(axis=0)
    except NoAnswer as failure:
        return NeglectedEffect(f"{effect}: no number, {failure}")
    if not np.all(np.isfinite(largest)):
        return NeglectedEffect(f"{effect}: no number, the torques have a pole")
    shares = largest / peaks
    motor = np.argmax(shares)
    joint = robot.actuator_names[motor]
    return NeglectedEffect(effect, float(largest[motor]), joint, float(shares[motor]))


# ------------------------------------------------------------------ springs


def _spring_differences(dynamics: InverseDynamics) -> Differences:
    """Yield the effects of springs left rigid, and of geometry and inertia of active springs."""
    robot, description = dynamics.robot, dynamics.robot.description

    @cache
    def fullest() -> ModelOnMotion:
        """Return the model with all springs."""
        return ModelOnMotion.of(
            dynamics, ParallelRobot.from_description(description, flexibility=FLEXIBILITIES[-1])
        )

    def torque_with(coordinates: Sequence[str]) -> Array:
        """Compute torques (T, n_a) of the fullest model with deflections of more `coordinates`."""
        fuller = fullest()
        deflecting = np.isin(fuller.robot.elastic_names, coordinates)
        deflections = np.where(deflecting, fuller.first_pass.caused, fuller.known_deflections())
        return fuller.torque(fuller.compute_pass(deflections))

    def left_rigid(coordinates: Sequence[str]) -> Array:
        """Compute the change of torque (T, n_a) by springs that the motion leaves rigid."""
        return torque_with(coordinates) - fullest().torque(fullest().first_pass)

    for part in ("joint", "link"):
        springs = [
            spring
            for spring in description.active_springs(FLEXIBILITIES[-1])
            if spring.part == part and not set(robot.elastic_names).issuperset(spring.coordinates)
        ]
        coordinates = [name for spring in springs for name in spring.coordinates]
        if springs:
            names = _list_names([spring.name for spring in springs])
            yield f"springs of {part}s left rigid ({names})", partial(left_rigid, coordinates)
    if robot.n_e and dynamics.geometry == "rigid":
        yield "deformed geometry", lambda: torque_with(robot.elastic_names) - fullest().planned_torque
    if robot.n_e and not robot.elastic_inertia:
        yield "inertia of the elastic motion", lambda: torque_with(()) - fullest().planned_torque


def _list_names(names: Sequence[str]) -> str:
    """Return at most MAX_NAMES names and the number of the rest, in words."""
    rest = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {rest} more" if rest > 0 else "")


# ------------------------------------------------------------------ friction, idle turns


def _friction_differences(dynamics: InverseDynamics) -> Differences:
    """Yield the effect of the dry friction that the torques do not contain."""
    robot, friction = dynamics.robot, neglected_friction(dynamics)
    if not friction.any():
        return

    def difference() -> Array:
        """Compute the change of torque (T, n_a) by the friction."""
        rough = ModelOnMotion.of(dynamics, robot, friction=friction)
        smooth = replace(rough, friction=None)
        return rough.torque(rough.first_pass) - smooth.torque(smooth.first_pass)

    yield f"dry friction of {robot.friction_sizes(np.flatnonzero(friction))} (joint side)", difference


def neglected_friction(dynamics: InverseDynamics) -> Array:
    """Return the dry friction (nv,) [N m or N] of joints that the torques do not contain."""
    friction = dynamics.robot.joint_friction.copy()
    if dynamics.friction is not None:
        friction[dynamics.robot.actuated] = 0.0
    return friction


def _idle_turn_effects(dynamics: InverseDynamics, peaks: Array) -> Iterator[NeglectedEffect]:
    """Yield the torque that would hold the idle turns as planned, an estimate of the torques' error."""
    robot, holding = dynamics.robot, dynamics.certificate.max_held_torque
    if not holding:
        return
    idle = robot.structure.idle
    still_turns = np.setdiff1d(idle, driven_turns(robot))
    names = _list_names([robot.coordinates.name_of(k) for k in (still_turns if len(still_turns) else idle)])
    torque = float(holding / np.abs(robot.gear_ratio).min())
    yield NeglectedEffect(f"what nothing holds of {names}", torque, share=float(torque / peaks.max()))
