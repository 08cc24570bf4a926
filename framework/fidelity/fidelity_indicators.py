"""Indicators of what each level of fidelity leaves out, without a simulation or deformed geometry.

Each thing that a level leaves out changes the torques by a share that can be told from the plans of the
undeformed robot and from its vibrations:

* bodies, legs: their share in what the motion asks of the platform (regular at Type 2, unlike torques);
* springs: a body on a spring of frequency omega that follows x(t) needs m (x" + x""/omega^2), so that max
  |d4s/dt4| / (omega^2 max |d2s/dt2|) of the force that moves what is on the spring is left out: of the
  rotors' for springs of joints and links, of the legs' for elastic inertia. Long motions and high
  frequencies make it small: it goes as 1 / (frequency times duration)^2;
* deformed geometry: the angle [rad] by which deflections move the joints without a motor. It turns the
  forces, and moves the singular point about as far: the band in which a robot that crosses at the
  undeformed point has no equilibrium is as wide as the deflection.

A share of the force is taken for the same share of the path. But a share of the weight W_g pushes all the
time, and moves the platform by 1/2 W_g T^2 / m, times max |d2s/dt2| / (W - W_g) in path lengths; and what
is off grows where weight and torques carry it farther off. What a level leaves out in all is the largest of
what it and those above it leave out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.result import CrossingPlan
from framework.dynamics.open_loop import open_loop_growth
from framework.dynamics.platform_wrench import platform_wrench
from framework.errors import NotAssembled
from framework.kinematics.frames import difference
from framework.kinematics.inverse_kinematics import close_loops
from framework.model.fidelity_levels import LEVELS
from framework.statics.vibrations import free_motor_frequency

MOTION_SAMPLES = 65  # equidistant instants at which bodies and vibrations are looked at


class Indicators(NamedTuple):
    """The error of each level as its indicators estimate it, and the indicators in words."""

    error: Mapping[str, float]
    words: Mapping[str, str]
    growth: float  # of what is off, by weight and torques that nothing corrects; see `open_loop_growth`

    def chosen(self, tolerance: float) -> str:
        """Return the least level that leaves out no more than the tolerance."""
        return next(name for name, error in self.error.items() if error <= tolerance)


def indicators_of(plans: Mapping[str, CrossingPlan | None]) -> Indicators:
    """Compute the indicators of a motion from its plans by name of level."""
    rigid = plans["rigid"]
    if rigid is None:  # there is nothing to compute them from: everything may matter
        return _accumulated({}, {}, np.inf)
    shares = _shares(rigid, plans["payload"])
    out, words = dict[str, float](), dict[str, str]()
    out["kinematics"] = shares.bodies * shares.drift
    words["kinematics"] = f"bodies make {_percent(shares.bodies)} of the force"
    out["payload"] = shares.legs * shares.drift
    words["payload"] = f"the payload makes {_percent(1.0 - shares.legs)} of the force"
    for below, name, moved in (
        ("rigid", "flexible_joints", shares.rotors),
        ("flexible_joints", "flexible_links", max(shares.rotors, shares.legs)),
    ):
        ratio, cycles = _slowness(rigid, plans[name])
        out[below] = ratio * moved
        words[below] = f"{cycles:.3g} vibrations in the duration" if np.isfinite(cycles) else "no springs"
    links = plans["flexible_links"]
    bending = np.inf if links is None else _bending(rigid, links)
    out["flexible_links"] = bending * shares.drift
    words["flexible_links"] = f"the joints move by {bending:.2g} rad or robot lengths"
    ratio, cycles = _slowness(rigid, links)
    out["deformed"] = ratio * shares.legs
    words["deformed"] = f"legs make {_percent(shares.legs)} of the force"
    return _accumulated(out, words, _growth(rigid))


def _growth(plan: CrossingPlan) -> float:
    try:
        return open_loop_growth(plan.dynamics)
    except NotAssembled:  # on the border of the workspace: nobody knows
        return np.inf


def _accumulated(out: Mapping[str, float], words: Mapping[str, str], growth: float) -> Indicators:
    """Return errors that do not grow upwards: each level also leaves out what those above it do."""
    error, names = dict[str, float](), [level.name for level in LEVELS]
    largest = 0.0
    for name in reversed(names):
        largest = max(largest, 0.0 if name == names[-1] else _times(growth, out.get(name, np.inf)))
        error[name] = largest
    sentences = {name: words.get(name, "") for name in names}
    return Indicators({name: error[name] for name in names}, sentences, growth)


def _times(growth: float, error: float) -> float:
    """Return the error as it grows; no error does not grow."""
    return growth * error if error > 0.0 else 0.0


class _Shares(NamedTuple):
    """Parts of what a motion asks of the platform, over all of it at the same place and time: the largest."""

    bodies: float
    legs: float
    rotors: float
    drift: float  # times the share of the path, that a share of the force is of the path's length


def _shares(rigid: CrossingPlan, payload: CrossingPlan | None) -> _Shares:
    motion = rigid.dynamics.motion(np.linspace(0.0, rigid.duration, MOTION_SAMPLES))
    robot = rigid.robot
    full = platform_wrench(robot, motion)
    size = robot.platform_scale  # moments: a force times the robot's length

    def largest(wrench: Array) -> float:
        return float(np.abs(wrench * size).max())

    all_of_it = max(largest(full.asked), np.finfo(float).tiny)
    legs = 1.0
    if payload is not None:
        legs = largest(full.asked - platform_wrench(payload.robot, motion).asked) / all_of_it
    still = replace(motion, v=np.zeros_like(motion.v), a=np.zeros_like(motion.a))
    weight = platform_wrench(robot, still).asked
    t = np.linspace(0.0, rigid.duration, 1001)
    pushing = 0.5 * rigid.duration**2 * float(np.abs(rigid.law(t, 2)).max())
    moving = max(largest(full.asked - weight), np.finfo(float).tiny)
    return _Shares(
        bodies=largest(full.asked - full.rotors) / all_of_it,
        legs=legs,
        rotors=largest(full.rotors) / all_of_it,
        drift=max(1.0, pushing * largest(weight) / moving),
    )


def _slowness(rigid: CrossingPlan, elastic: CrossingPlan | None) -> tuple[float, float]:
    """Return max |d4s/dt4| / (omega^2 max |d2s/dt2|), and the first frequency times the duration."""
    if elastic is None:
        return np.inf, 0.0
    t = np.linspace(0.0, elastic.duration, MOTION_SAMPLES)
    frequency = float(free_motor_frequency(elastic.robot, elastic.configuration(t)).min())
    times = np.linspace(0.0, rigid.duration, 1001)
    fourth, second = (float(np.abs(rigid.law(times, order)).max()) for order in (4, 2))
    return fourth / (second * (2.0 * np.pi * frequency) ** 2), frequency * rigid.duration


def _bending(rigid: CrossingPlan, elastic: CrossingPlan) -> float:
    """Return how far deflections move the joints without a motor, at most [rad, robot lengths].

    What a motor takes up, such as the twist of its own gear, changes no geometry.
    """
    times = np.linspace(0.0, elastic.duration, 257)
    near = rigid.configuration(np.minimum(times, rigid.duration))
    undeformed = close_loops(rigid.robot, elastic.platform(times), near).q  # with the platform where it is
    turned = []
    for robot, q in ((rigid.robot, undeformed), (elastic.robot, elastic.configuration(times))):
        columns = {robot.coordinates.name_of(int(column)): column for column in robot.following}
        joints = difference(robot, robot.neutral, q) / robot.column_scale
        turned.append(joints[:, [columns[name] for name in sorted(columns)]])
    return float(np.abs(turned[0] - turned[1]).max(initial=0.0))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
