"""The 5R as the other simulators are told it: plain numbers and closed forms, nothing of ours.

The numbers are those of the oracle (Briot and Arakelian, 2010, section 3), the 1 kg rods are those of
`five_bar_heavy`. The plane is horizontal, so gravity does no work. Each builder of this folder makes
its model out of a `FiveBar`, never out of the URDF or the robot file that are under test.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tests.oracles import five_bar as oracle

LENGTH = float(oracle.LENGTH)  # of every link [m]
BASES = tuple(map(float, oracle.BASES))  # abscissae of the motors [m], left and right
GEAR_RATIO = float(oracle.GEAR_RATIO)
ROTOR_INERTIA = float(oracle.ROTOR_INERTIA) * GEAR_RATIO**2  # on the joint side of the gear [kg m^2]
PAYLOAD = float(oracle.PAYLOAD)  # [kg]
SIDES = ("left", "right")


@dataclass(frozen=True)
class FiveBar:
    """What may differ between two 5R robots; None stands for a rigid drive or rod."""

    link_mass: float = 0.0  # of each crank and rod, uniform and slender [kg]
    drive_stiffness: float | None = None  # [N m/rad]
    rod_stiffness: float | None = None  # [N/m]

    @classmethod
    def of(cls, name: str, flexibility: str) -> FiveBar:
        """The robot of the catalogue: five_bar or five_bar_heavy, with one of the flexibilities."""
        elastic = oracle.FLEXIBILITIES.index(flexibility)
        return cls(
            link_mass={"five_bar": 0.0, "five_bar_heavy": 1.0}[name],
            drive_stiffness=float(oracle.DRIVE_STIFFNESS) if elastic >= 1 else None,
            rod_stiffness=float(oracle.ROD_STIFFNESS) if elastic >= 2 else None,
        )


class Run(NamedTuple):
    """A forward simulation: where the payload went, and what it took."""

    time: np.ndarray  # (T,) [s]
    platform: np.ndarray  # (T, 2) [m]
    seconds: float  # wall time of the integration alone
    gap: float = 0.0  # largest distance between the two tips [m], where the loop is soft

    def error(self, plan) -> np.ndarray:
        """Distance (T,) [m] of the payload from its place on the planned path."""
        return np.linalg.norm(self.platform - plan.platform(self.time), axis=1)


def start_angles(platform) -> np.ndarray:
    """Absolute angles of cranks and rods (2, 2) [rad], leg by leg, of the unloaded robot at rest."""
    cranks = oracle.inverse_kinematics(platform)  # (2,)
    elbows = np.column_stack([BASES + LENGTH * np.cos(cranks), LENGTH * np.sin(cranks)])  # (2, 2)
    rods = np.asarray(platform) - elbows
    return np.column_stack([cranks, np.arctan2(rods[:, 1], rods[:, 0])])
