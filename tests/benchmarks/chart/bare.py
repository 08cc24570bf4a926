"""The rigid 5R as one writes it who has pinocchio and numpy alone: loops over poses, stacks where numpy can.

Nothing of the framework is called; the model is the catalogue's `pin.Model`. It stands for what others can do
without us, at its best: no closure objects, no checks, every pose started from the one before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, ROTOR_INERTIA, SIDES

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
SETTLED, MOST = 1e-8, 20  # [rad] a step of Newton's method whose successor is below rounding; steps at most


class Loads(NamedTuple):
    """A motion at T instants: P' lambda = r_p and tau = r_a - J_a' lambda."""

    passive: Array  # P' (T, 2, 2)
    actuated: Array  # J_a' (T, 2, 2)
    forces: Array  # r (T, 4) [N m]
    accelerations: Array  # (T, 2) of the motors [rad/s^2]


class BareFiveBar:
    """Model, frames and columns of the 5R."""

    def __init__(self, model: pin.Model | None = None, size: float = 1.0) -> None:
        self.model = given.robot().model if model is None else model
        self.rotor_inertia = ROTOR_INERTIA * size**2
        self.data = self.model.createData()
        self.tips = [self.model.getFrameId(f"{side}_tip") for side in SIDES]
        columns = [self.model.joints[self.model.getJointId(f"{side}_motor")].idx_v for side in SIDES]
        self.motors = np.array(columns)
        self.others = np.array([k for k in range(self.model.nv) if k not in columns])

    def tip_places(self, q: Array) -> tuple[Array, Array]:
        """Both tips (4,) [m] and their derivatives (4, 4)."""
        pin.computeJointJacobians(self.model, self.data, q)
        places, slopes = np.empty(4), np.empty((4, 4))
        for k, tip in enumerate(self.tips):
            places[2 * k : 2 * k + 2] = pin.updateFramePlacement(self.model, self.data, tip).translation[:2]
            slopes[2 * k : 2 * k + 2] = pin.getFrameJacobian(self.model, self.data, tip, AXES)[:2]
        return places, slopes

    def close(self, x: Array, q: Array) -> tuple[Array, Array]:
        """Joints (4,) with both tips at x (2,), by Newton's method from q, and the derivatives (4, 4)."""
        target, q = np.concatenate([x, x]), q.copy()
        for _ in range(MOST):
            places, slopes = self.tip_places(q)
            step = np.linalg.solve(slopes, target - places)
            q += step
            if np.abs(step).max() < SETTLED:
                return q, self.tip_places(q)[1]
        raise ArithmeticError("the loops do not close")

    def joints(self, x: Array, start: Array) -> tuple[Array, Array]:
        """Joints (T, 4) and the tips' derivatives (T, 4, 4) with the tips at x (T, 2), from pose to pose."""
        q, slopes = np.empty((len(x), 4)), np.empty((len(x), 4, 4))
        for k, place in enumerate(x):
            start, slopes[k] = self.close(place, start)
            q[k] = start
        return q, slopes

    def rates(self, x: Array, dx: Array, ddx: Array, start: Array) -> tuple[Array, Array, Array]:
        """Joints, their rates and their accelerations (T, 4) each of the motion x(t), x', x" (T, 2)."""
        q, v, a, _ = self._motion(x, dx, ddx, start)
        return q, v, a

    def loads(self, x: Array, dx: Array, ddx: Array, start: Array) -> Loads:
        """What the motion x(t), x', x" (T, 2) asks of the joints."""
        q, v, a, slopes = self._motion(x, dx, ddx, start)
        forces = np.array([pin.rnea(self.model, self.data, *motion) for motion in zip(q, v, a, strict=True)])
        loop = (slopes[:, :2] - slopes[:, 2:]).transpose(0, 2, 1)
        return Loads(loop[:, self.others], loop[:, self.motors], forces, np.asarray(a[:, self.motors]))

    def _motion(self, x: Array, dx: Array, ddx: Array, start: Array) -> tuple[Array, Array, Array, Array]:
        q, slopes = self.joints(x, start)
        v = np.linalg.solve(slopes, np.concatenate([dx, dx], axis=1)[..., None])[..., 0]
        drift, still = np.empty((len(x), 4)), np.zeros(4)
        for k in range(len(x)):
            pin.forwardKinematics(self.model, self.data, q[k], v[k], still)
            for leg, tip in enumerate(self.tips):
                acceleration = pin.getFrameClassicalAcceleration(self.model, self.data, tip, AXES)
                drift[k, 2 * leg : 2 * leg + 2] = acceleration.linear[:2]
        a = np.linalg.solve(slopes, (np.concatenate([ddx, ddx], axis=1) - drift)[..., None])[..., 0]
        return q, v, np.asarray(a), slopes

    def torques(self, loads: Loads) -> Array:
        """Motor torques (T, 2) [N m], at each instant for itself."""
        multipliers = np.linalg.solve(loads.passive, loads.forces[:, self.others][..., None])
        joint = loads.forces[:, self.motors] - (loads.actuated @ multipliers)[..., 0]
        return np.asarray(self.rotor_inertia / GEAR_RATIO * loads.accelerations + joint / GEAR_RATIO)

    def singularity(self, q: Array) -> float:
        """The determinant of the passive columns of the loop."""
        slopes = self.tip_places(q)[1]
        (a, b), (c, d) = (slopes[:2] - slopes[2:])[:, self.others]
        return float(a * d - b * c)
