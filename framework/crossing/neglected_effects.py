"""What a motion's torques leave out, each effect with the motor torque that it is worth at this motion.

Springs left rigid, geometry and inertia of the deflections, dry friction, masses of bodies: the torques of
the model with one effect more, less those without (`fuller_model`). Idle turns: the torque that holds them,
which the certificate has. What the reader of a foreign file left out has no number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.fuller_model import FullerModel
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.kinematics.idle_turns import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import FLEXIBILITIES, RobotDescription
from framework.tolerances import TORQUE_TAIL

PEAK_SAMPLES = 501  # equidistant instants
MAX_NAMES = 4  # of springs or turns that are listed one by one


class NeglectedEffect(NamedTuple):
    """An effect that the torques of a motion leave out.

    effect: in words.
    torque: largest change of a motor's torque that it makes [N m or N, motor side]; None where it is unknown.
    motor: the joint of that motor; empty where no one motor is concerned.
    share: the torque over the largest of all motors of that unit; None where it is unknown.
    """

    effect: str
    torque: float | None
    motor: str
    share: float | None


def neglected_effects(
    dynamics: InverseDynamics, *, whole: RobotDescription | None = None
) -> tuple[NeglectedEffect, ...]:
    """Compute what the torques of a motion leave out, the largest share first, what has no number last.

    What is within the tail of the torques is none. All is of first order, each effect by itself: a number
    near the largest torque or above it, as springs have under a load across a crossing, is an order of size.

    Args:
        whole: the description with all masses, where the motion's robot was made without some of them; by
            default that of its robot.
    """
    effects = [
        *_without_bodies(dynamics, whole),
        *_of_springs(dynamics, whole or dynamics.robot.description),
        *_of_friction(dynamics),
        *_of_idle_turns(dynamics),
        *(NeglectedEffect(text, None, "", None) for text in dynamics.robot.description.left_out),
    ]
    resolved = max(TORQUE_TAIL, dynamics.certificate.tail)
    effects = [effect for effect in effects if effect.share is None or effect.share > resolved]
    return tuple(sorted(effects, key=lambda one: -1.0 if one.share is None else one.share, reverse=True))


def _peaks(dynamics: InverseDynamics) -> Array:
    """Return the largest torque (n_a,) of all motors of the same unit as each."""
    times = np.linspace(0.0, dynamics.duration, PEAK_SAMPLES)
    units, peaks = np.array(dynamics.robot.torque_units), np.abs(dynamics.torque(times)).max(axis=0)
    largest = np.array([peaks[units == unit].max() for unit in units])
    return np.maximum(largest, np.finfo(float).tiny)


def _measured(effect: str, dynamics: InverseDynamics, difference: Array) -> NeglectedEffect:
    """Return the effect of a difference of torques (T, n_a)."""
    largest = np.abs(difference).max(axis=0)
    if not np.all(np.isfinite(largest)):
        return NeglectedEffect(f"{effect}: no number, the torques have a pole", None, "", None)
    shares = largest / _peaks(dynamics)
    k = int(np.argmax(shares))
    return NeglectedEffect(effect, float(largest[k]), dynamics.robot.actuator_names[k], float(shares[k]))


def _unknown(effect: str, failure: NoAnswer) -> NeglectedEffect:
    return NeglectedEffect(f"{effect}: no number, {failure}", None, "", None)


# ------------------------------------------------------------------ springs


def _of_springs(dynamics: InverseDynamics, description: RobotDescription) -> Iterator[NeglectedEffect]:
    """Yield the springs left rigid, by part, and what of the deflections the torques leave out."""
    groups = _groups(dynamics, description)
    if not groups:
        return
    try:
        robot = ParallelRobot.from_description(description, flexibility=FLEXIBILITIES[-1])
        fuller = FullerModel.of(dynamics, robot)
        known = fuller.known_deflections()
        base = fuller.moved(known)
        planned = dynamics.torque_without_friction(fuller.grid.times)
        rigid = fuller.torque(base)
    except NoAnswer as failure:
        yield from (_unknown(group.effect, failure) for group in groups)
        return
    for group in groups:
        moving = np.isin(robot.elastic_names, group.coordinates)
        try:
            torque = (
                fuller.torque(fuller.moved(np.where(moving, base.caused, known))) if moving.any() else rigid
            )
        except NoAnswer as failure:
            yield _unknown(group.effect, failure)
            continue
        yield _measured(group.effect, dynamics, torque - (rigid if group.left_rigid else planned))


class _Group(NamedTuple):
    """Deflections that are left out: their coordinates, and whether their springs are rigid."""

    effect: str
    coordinates: tuple[str, ...]
    left_rigid: bool


def _groups(dynamics: InverseDynamics, description: RobotDescription) -> list[_Group]:
    robot = dynamics.robot
    modelled = set(robot.elastic_names)
    groups = []
    for part in ("joint", "link"):
        springs = [
            spring
            for spring in description.active_springs(FLEXIBILITIES[-1])
            if spring.part == part and not modelled.issuperset(spring.coordinates)
        ]
        coordinates = tuple(name for spring in springs for name in spring.coordinates)
        if springs:
            names = _listed([spring.name for spring in springs])
            groups.append(_Group(f"springs of {part}s left rigid ({names})", coordinates, True))
    if robot.n_e and dynamics.geometry == "rigid":
        groups.append(_Group("deformed geometry", robot.elastic_names, False))
    if robot.n_e and not robot.elastic_inertia:
        groups.append(_Group("inertia of the elastic motion", (), False))
    return groups


def _listed(names: Sequence[str]) -> str:
    """Return a few names, and how many more there are."""
    more = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {more} more" if more > 0 else "")


# ------------------------------------------------------------------ bodies, friction, idle turns


def _without_bodies(dynamics: InverseDynamics, whole: RobotDescription | None) -> Iterator[NeglectedEffect]:
    """Yield the masses of the whole robot that the motion's has not."""
    if whole is None or whole.urdf_text == dynamics.robot.description.urdf_text:
        return
    effect = "mass of bodies"
    try:
        robot = ParallelRobot.from_description(whole, flexibility=dynamics.robot.flexibility)
        fuller = FullerModel.of(dynamics, robot)
        torque = fuller.torque(fuller.moved(fuller.known_deflections()))
    except NoAnswer as failure:
        yield _unknown(effect, failure)
        return
    yield _measured(effect, dynamics, torque - dynamics.torque_without_friction(fuller.grid.times))


def _of_friction(dynamics: InverseDynamics) -> Iterator[NeglectedEffect]:
    """Yield the dry friction of joints that the torques do not count with."""
    robot, friction = dynamics.robot, dynamics.robot.joint_friction.copy()
    if dynamics.friction is not None:
        friction[robot.actuated] = 0.0
    if not friction.any():
        return
    effect = f"dry friction of {robot.friction_sizes(np.flatnonzero(friction))} (joint side)"
    try:
        rough = FullerModel.of(dynamics, robot, friction=friction)
        known = rough.known_deflections()
        torques = [one.torque(one.moved(known)) for one in (rough, replace(rough, friction=None))]
    except NoAnswer as failure:
        yield _unknown(effect, failure)
        return
    yield _measured(effect, dynamics, torques[0] - torques[1])


def _of_idle_turns(dynamics: InverseDynamics) -> Iterator[NeglectedEffect]:
    """Yield the torque that would hold idle turns as planned, by its order also that of the motors' error."""
    robot, held = dynamics.robot, dynamics.certificate.max_held_torque
    if not held:
        return
    turns = np.setdiff1d(robot.structure.idle, driven_turns(robot))
    names = _listed([robot.coordinates.name_of(k) for k in (turns if len(turns) else robot.structure.idle)])
    torque = held / float(np.abs(robot.gear_ratio).min())
    yield NeglectedEffect(
        f"what nothing holds of {names}", torque, "", torque / float(_peaks(dynamics).max())
    )
