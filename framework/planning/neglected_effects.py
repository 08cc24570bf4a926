"""The effects that a motion's torques leave out, each with the motor torque that it adds at this motion.

Springs left rigid, geometry and inertia of the deflections, dry friction: the torques of the model with one
effect more, less those without (`model_on_motion`). Idle turns: the torque that holds them, which the
certificate has. Parts of a foreign file that its reader left out have no number. Masses that a robot was made
without, as the lower levels of fidelity are, are not known to it, and so no effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.kinematics.idle_turns import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import FLEXIBILITIES
from framework.numerics.arrays import Array
from framework.planning.model_on_motion import ModelOnMotion
from framework.planning.motion_scales import largest_by_unit
from framework.tolerances import TORQUE_TAIL

MAX_NAMES = 4  # of springs or turns that are listed one by one

# of each effect, in words: computes by how much it changes the torques (T, n_a); raises NoAnswer
Differences = Iterator[tuple[str, Callable[[], Array]]]


class NeglectedEffect(NamedTuple):
    """An effect that the torques of a motion leave out.

    effect: in words.
    torque: largest change of a motor's torque that it makes [N m or N, motor side]; None where it is unknown.
    motor: the joint of that motor; empty where no one motor is concerned.
    share: the torque over the largest of all motors of that unit; None where it is unknown.
    """

    effect: str
    torque: float | None = None
    motor: str = ""
    share: float | None = None


def neglected_effects(dynamics: InverseDynamics) -> tuple[NeglectedEffect, ...]:
    """Compute the effects that the torques of a motion leave out.

    The largest is first, unknown ones are last. Effects smaller than the tail of the torques are not listed.
    Each number is of first order, for one effect alone. Near the largest torque or above it, as of springs
    under a load across a crossing, a number is an order of magnitude.
    """
    torques = np.abs(dynamics.torque(np.linspace(0.0, dynamics.duration, 501))).max(axis=0)
    peaks = largest_by_unit(dynamics.robot, torques)
    differences = [*_spring_differences(dynamics), *_friction_differences(dynamics)]
    effects = [
        *(_measure_effect(dynamics.robot, peaks, *difference) for difference in differences),
        *_idle_turn_effects(dynamics, peaks),
        *map(NeglectedEffect, dynamics.robot.description.left_out),
    ]
    resolved = max(TORQUE_TAIL, dynamics.certificate.tail)
    effects = [effect for effect in effects if effect.share is None or effect.share > resolved]
    return tuple(sorted(effects, key=lambda one: -1.0 if one.share is None else one.share, reverse=True))


def _measure_effect(
    robot: ParallelRobot, peaks: Array, effect: str, difference: Callable[[], Array]
) -> NeglectedEffect:
    """Measure the largest torque of an effect over peaks (n_a,).

    Where none is known, the effect has the reason.
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
    """Yield the effects of springs that the motion leaves out.

    They are springs left rigid, by part, and geometry and inertia of deflections.
    """
    robot, description = dynamics.robot, dynamics.robot.description

    @cache
    def fullest() -> ModelOnMotion:
        """Return the model with all springs."""
        return ModelOnMotion.of(
            dynamics, ParallelRobot.from_description(description, flexibility=FLEXIBILITIES[-1])
        )

    def torque_with(coordinates: Sequence[str]) -> Array:
        """Compute the fullest model's torques (T, n_a) with deflections of more elastic coordinates."""
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
    """Return at most MAX_NAMES names in words, and the number of the rest."""
    rest = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {rest} more" if rest > 0 else "")


# ------------------------------------------------------------------ friction, idle turns


def _friction_differences(dynamics: InverseDynamics) -> Differences:
    """Yield the dry friction of joints that is not in the torques."""
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
    """Return the joints' dry friction (nv,) [N m or N] missing in the torques."""
    friction = dynamics.robot.joint_friction.copy()
    if dynamics.friction is not None:
        friction[dynamics.robot.actuated] = 0.0
    return friction


def _idle_turn_effects(dynamics: InverseDynamics, peaks: Array) -> Iterator[NeglectedEffect]:
    """Yield the torque that would hold idle turns as planned.

    It estimates the error of the motors' torques.
    """
    robot, holding = dynamics.robot, dynamics.certificate.max_held_torque
    if not holding:
        return
    turns = np.setdiff1d(robot.structure.idle, driven_turns(robot))
    turns = turns if len(turns) else robot.structure.idle
    names = _list_names([robot.coordinates.name_of(k) for k in turns])
    torque = holding / float(np.abs(robot.gear_ratio).min())
    share = torque / float(peaks.max())
    yield NeglectedEffect(f"what nothing holds of {names}", torque, share=share)
