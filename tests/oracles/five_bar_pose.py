"""The paper's planar 5R at many poses at once, by vectors of the plane: what maps are held against.

Leg i is a crank b from its motor to its elbow and a rod p from there to the payload, elbows outward. With
the motors locked the payload is carried by two springs in series a leg, that of the drive, which the rod
pulls with the lever c = b x p / |p|, and that of the rod:

    K = sum of u u' / (1 / k_rod + c^2 / k_drive),        u = p / |p|.

A force F = sum of f_i u_i on the payload asks the motors for tau_i = c_i f_i / n.
"""

from typing import NamedTuple

import numpy as np

BASES = np.array([[-0.2, 0.0], [0.2, 0.0]])
SIDES = np.array([1.0, -1.0])  # the elbow lies left or right of the line from the motor to the payload
LENGTH = 0.25
DRIVE, ROD = 25000.0, 350000.0
GEAR = 50.0
PAYLOAD = 10.0


class Pose(NamedTuple):
    """At payload places (T, 2), leg by leg (T, 2, ...)."""

    crank: np.ndarray  # (T, 2, 2) b
    rod: np.ndarray  # (T, 2, 2) p

    @property
    def along(self) -> np.ndarray:
        """Unit vectors of the rods, (T, 2, 2)."""
        return self.rod / np.linalg.norm(self.rod, axis=-1, keepdims=True)

    @property
    def lever(self) -> np.ndarray:
        """Moment arms (T, 2) of the rods about the motors."""
        return cross(self.crank, self.along)

    @property
    def sine(self) -> np.ndarray:
        """Sine (T,) of the angle from the left rod to the right one: 0 at Type 2."""
        return cross(self.along[:, 0], self.along[:, 1])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The component of a x b normal to the plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def reachable(x: np.ndarray) -> np.ndarray:
    """How far (T,) payload places (T, 2) are inside of both legs' reach [m]; negative outside."""
    far = np.linalg.norm(x[:, None] - BASES, axis=2)
    return 2 * LENGTH - far.max(axis=1)


def pose(x: np.ndarray) -> Pose:
    """The pose with the elbows outward."""
    way = x[:, None] - BASES
    far = np.linalg.norm(way, axis=2, keepdims=True)
    normal = np.stack([-way[..., 1], way[..., 0]], axis=2) / far
    aside = SIDES[:, None] * np.sqrt(LENGTH**2 - (far / 2) ** 2)
    crank = way / 2 + aside * normal
    return Pose(crank, way - crank)


def worst_torque(at: Pose) -> np.ndarray:
    """Largest 2-norm (T,) of the motor torques, motor side, against a unit force."""
    pulled = np.linalg.inv(at.along.swapaxes(1, 2))  # f = pulled F
    return np.linalg.norm(at.lever[..., None] / GEAR * pulled, ord=2, axis=(1, 2))


def stiffness(at: Pose, *, rods: bool) -> np.ndarray:
    """K (T, 2, 2) of the payload with locked motors; `rods`: they give way, too."""
    each = 1.0 / (float(rods) / ROD + at.lever**2 / DRIVE)
    return np.einsum("tl,tli,tlj->tij", each, at.along, at.along)


def energy(x: np.ndarray, start: Pose) -> np.ndarray:
    """Energy (T,) of the springs, payload at x (T, 2), motors locked where `start` (T = 1) has them.

    Each leg deflects so that drive and rod pull alike, by Newton's method on the drive's angle.
    """
    total = np.zeros(len(x))
    for leg in range(2):
        locked = np.arctan2(*start.crank[0, leg][::-1])
        angle = np.full(len(x), locked)
        for _ in range(60):
            crank = LENGTH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            turned = np.stack([-crank[:, 1], crank[:, 0]], axis=1)
            rod = x - BASES[leg] - crank
            size = np.linalg.norm(rod, axis=1)
            slope = -(rod * turned).sum(axis=1) / size
            bend = ((turned**2).sum(axis=1) + (rod * crank).sum(axis=1) - slope**2) / size
            first = DRIVE * (angle - locked) + ROD * (size - LENGTH) * slope
            angle = angle - first / (DRIVE + ROD * (slope**2 + (size - LENGTH) * bend))
        total += 0.5 * DRIVE * (angle - locked) ** 2 + 0.5 * ROD * (size - LENGTH) ** 2
    return total
