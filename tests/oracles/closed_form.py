"""What geometry and Lagrange's equations say of a robot without its URDF, for laws that several share."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Kinematics:
    """Motor coordinates in closed form at places in the workspace (count, n), and how well they agree."""

    places: np.ndarray
    motors: Function  # (n_a,) of x (n,)
    rates: Function  # (n_a, n) of x: of the motors over the platform's twist
    motors_within: float  # [m, rad]
    rates_within: float


@dataclass(frozen=True)
class Crossing:
    """A scene through one Type 2 singularity, in closed form.

    The same path is `unprepared` in a scene without condition (8); the scene `clear` meets no singularity.
    """

    scene: str
    unprepared: str
    clear: str
    lines: Function  # (n, n) of x: singular at Type 2, with t_s as null vector
    bracket: tuple[float, float]  # of s
    rates: Function  # (n_a, n) of x: of the motors over the rates of x
    force: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # Lagrange's, on the coordinates x
    gear: float
    share: float  # of the acceleration at the crossing, which is not enough
    twist_within: float
    force_within: Callable[[np.ndarray], float]  # of a force (n,)
    torque_within: Callable[[np.ndarray], float] | None = None  # of a torque (n_a,), away from the crossing
    away: float = 0.0  # [s]
    power_within: float = 1e-10  # of condition (8), over the force; or
    power: float = 0.0  # [W] for a unit twist

    def s(self, path: Function) -> float:
        """Path coordinate of the singular point."""

        def measure(s: float) -> float:
            return float(np.linalg.det(self.lines(path(s))))

        return float(brentq(measure, *self.bracket, xtol=1e-15, rtol=1e-15))

    def twist(self, x: np.ndarray) -> np.ndarray:
        """t_s (n,), of unit translation or, of a robot that only turns, unit rotation."""
        null = np.linalg.svd(self.lines(x))[2][-1]
        return np.asarray(null / np.linalg.norm(null[:3]))
