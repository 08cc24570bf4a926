"""The 5R with other masses, another size and duration, each with its exact motion, for maps of failure.

Sizes and durations need no new reference: with all lengths times a and times times b, the rotors' inertia
times a^2 and the masses kept, torques are a^2 / b^2 of those of scene C, and places a times as far.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from framework import Line, ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.peers.five_bar import FiveBar

SIZE = 128  # points of the series of torques: twice what they need
CHECKED = np.delete(np.linspace(0.0, 1.0, 61), 40)  # of the duration, not the very instant of the crossing


class Planned:
    """Torques and places of scene C as Chebyshev series, in its own units."""

    def __init__(self, motion: closed_form.ExactMotion) -> None:
        nodes = np.cos(np.pi * (np.arange(SIZE) + 0.5) / SIZE)
        times = 0.5 * given.DURATION * (nodes + 1.0)
        self.torques, self.places = (
            np.asarray(chebyshev.chebfit(nodes, values, SIZE - 1), dtype=float)
            for values in (motion.torque(times), motion.platform(times))
        )

    def torque(self, t: ArrayLike) -> Array:
        """(T, 2) [N m], motor side."""
        return _series(self.torques, t)

    def platform(self, t: ArrayLike, order: int = 0, /) -> Array:
        """(T, 2) [m]."""
        return _series(self.places, t)


def _series(coefficients: Array, t: ArrayLike) -> Array:
    local = np.clip(np.asarray(t, dtype=float) * (2.0 / given.DURATION) - 1.0, -1.0, 1.0)
    return np.asarray(np.cos(np.arccos(local)[..., None] * np.arange(len(coefficients))) @ coefficients)


@lru_cache(maxsize=64)
def planned(link: float, payload: float = float(closed_form.PAYLOAD)) -> Planned:
    """The reference's torques and path, for masses of each link and of the payload [kg]."""
    return Planned(closed_form.motion(link, payload=payload))


@dataclass(frozen=True)
class Variant:
    """Masses of the payload and of each link [kg], size and duration over those of the paper."""

    payload: float = 10.0
    link: float = 1.0
    size: float = 1.0
    slower: float = 1.0

    @property
    def duration(self) -> float:
        """[s]"""
        return given.DURATION * self.slower

    @property
    def path(self) -> Line:
        """Scene C's, as large as the robot."""
        return Line(self.size * given.path()(0.0), self.size * given.path()(1.0))

    @property
    def robot(self) -> ParallelRobot:
        return _robot(self.payload, self.link, self.size)

    @property
    def five_bar(self) -> FiveBar:
        """For the peers."""
        return FiveBar(link_mass=self.link, payload=self.payload, size=self.size)

    def torque(self, t: ArrayLike) -> Array:
        """Exact torques (T, 2) [N m], motor side."""
        factor = (self.size / self.slower) ** 2
        return factor * planned(self.link, self.payload).torque(np.asarray(t) / self.slower)

    def platform(self, t: ArrayLike, order: int = 0, /) -> Array:
        """Exact places (T, 2) [m]."""
        return self.size * planned(self.link, self.payload).platform(np.asarray(t) / self.slower)


@lru_cache(maxsize=64)
def _robot(payload: float, link: float, size: float) -> ParallelRobot:
    description = given.robot("five_bar_heavy").description
    root = ElementTree.fromstring(description.urdf_text)
    for origin in root.iter("origin"):
        origin.set("xyz", " ".join(repr(size * float(part)) for part in origin.get("xyz", "0 0 0").split()))
    for inertial in root.iter("inertial"):
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        assert mass is not None
        assert inertia is not None
        heavy = float(mass.get("value", "0")) == float(closed_form.PAYLOAD)
        mass.set("value", repr(payload if heavy else link))
        for axis, moment in inertia.items():
            inertia.set(axis, repr(link * size**2 * float(moment)))  # those of the payload are zero
    actuators = tuple(
        replace(one, rotor_inertia=size**2 * one.rotor_inertia) for one in description.actuators
    )
    text = ElementTree.tostring(root, encoding="unicode")
    return ParallelRobot.from_description(replace(description, urdf_text=text, actuators=actuators))
