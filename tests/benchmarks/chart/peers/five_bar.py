"""The 5R as the other simulators are told it: plain numbers and closed forms, nothing of the framework.

The numbers are those of Briot and Arakelian 2010, section 3 (`closed_form`), the 1 kg rods
are those of `five_bar_heavy`. The plane is horizontal, so gravity does no work. Each builder of this folder
makes its model out of a `FiveBar`, never out of a URDF or a robot file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from framework.model import FLEXIBILITIES
from framework.numerics import Array
from tests.benchmarks.chart import closed_form

LENGTH = float(closed_form.LENGTH)  # of every link [m]
BASES = tuple(map(float, closed_form.BASES))  # abscissae of the motors [m], left and right
GEAR_RATIO = float(closed_form.GEAR_RATIO)
ROTOR_INERTIA = float(closed_form.ROTOR_INERTIA) * GEAR_RATIO**2  # on the joint side of the gear [kg m^2]
PAYLOAD = float(closed_form.PAYLOAD)  # [kg]
SIDES = ("left", "right")


class Planned(Protocol):
    """A motion to be followed."""

    def platform(self, t: ArrayLike, order: int = 0, /) -> Array:
        """The payload (T, 2) [m] at times (T,) [s]."""


@dataclass(frozen=True)
class FiveBar:
    """What may differ between two 5R robots; None stands for a rigid drive or rod.

    `size` multiplies all lengths and, squared, the rotors' inertia.
    """

    link_mass: float = 0.0  # of each crank and rod, uniform and slender [kg]
    drive_stiffness: float | None = None  # [N m/rad]
    rod_stiffness: float | None = None  # [N/m]
    payload: float = PAYLOAD  # [kg]
    size: float = 1.0

    @property
    def length(self) -> float:
        """Of every link [m]."""
        return LENGTH * self.size

    @property
    def bases(self) -> tuple[float, ...]:
        """Abscissae of the motors [m]."""
        return tuple(base * self.size for base in BASES)

    @property
    def rotor_inertia(self) -> float:
        """On the joint side of the gear [kg m^2]."""
        return ROTOR_INERTIA * self.size**2

    @classmethod
    def of(cls, name: str, flexibility: str) -> FiveBar:
        """The robot of the catalogue: five_bar or five_bar_heavy, with one of the flexibilities."""
        elastic = FLEXIBILITIES.index(flexibility)
        return cls(
            link_mass={"five_bar": 0.0, "five_bar_heavy": 1.0}[name],
            drive_stiffness=float(closed_form.DRIVE_STIFFNESS) if elastic >= 1 else None,
            rod_stiffness=float(closed_form.ROD_STIFFNESS) if elastic >= 2 else None,
        )


class Run(NamedTuple):
    """A forward simulation: where the payload went, and what it took."""

    time: Array  # (T,) [s]
    platform: Array  # (T, 2) [m]
    seconds: float  # wall time of the integration alone
    gap: float = 0.0  # largest distance between the two tips [m], where the loop is soft

    def error(self, plan: Planned) -> Array:
        """Distance (T,) [m] of the payload from its place on the planned path."""
        return np.asarray(np.linalg.norm(self.platform - plan.platform(self.time), axis=1))


def start_angles(platform: Sequence[float] | Array) -> Array:
    """Absolute angles of cranks and rods (2, 2) [rad], leg by leg, of the unloaded robot at rest."""
    x, y = (Decimal(float(c)) for c in platform)
    both = [[np.array(part, dtype=float) for part in leg] for leg in closed_form.legs((x, y))]
    return np.array([[np.arctan2(part[1], part[0]) for part in leg] for leg in both])
