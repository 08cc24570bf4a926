"""Robots as one writes them who has pinocchio and numpy alone: loops over poses, stacks where numpy can.

Nothing of the framework is called: it gives the `pin.Model`, the names of frames and the pose to begin with.
It stands for what others can do without us, at its best: no checks, every pose started from the one before.
The platform's axes are x, y, z as far as it has them, then rotations.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework import ParallelRobot
from framework.numerics.arrays import Array

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
SETTLED, MOST = 1e-8, 20  # a step of Newton's method whose successor is below rounding; steps at most
FLAT, IN_SPACE, UPRIGHT = slice(0, 2), slice(0, 3), slice(0, 3, 2)  # axes along which loops of points close

Target = tuple[Array, Array | None]  # place of the platform along its axes, and rotation (3, 3)


class Motion(NamedTuple):
    """A motion at T instants: joints (T, nv), their rates, and the rows of the loops and of the platform."""

    q: Array
    v: Array
    a: Array
    rows: Any  # (T, nv, nv), or what `BareRobot.solve` takes


class BareRobot:
    """Model, frames and columns of a robot whose loops are points; `platform`: its axes, 0 (x) to 5 (rz)."""

    def __init__(self, robot: ParallelRobot, start: Array, axes: slice, platform: Sequence[int]) -> None:
        self.model, self.data = robot.model, robot.model.createData()
        self.start, self.axes, self.size = start, axes, len(platform)
        pairs = [tuple(map(robot.model.getFrameId, c.frames)) for c in robot.description.closures]
        held = robot.model.getFrameId(robot.description.platform.frame)
        self.frames = list(dict.fromkeys([frame for pair in pairs for frame in pair] + [held]))
        self.platform, width = self.frames.index(held), len(range(*axes.indices(3)))
        self.loops = [  # rows, and frames by their place among `frames`
            (slice(k * width, (k + 1) * width), self.frames.index(one), self.frames.index(other))
            for k, (one, other) in enumerate(pairs)
        ]
        self.angular = [axis - 3 for axis in platform if axis >= 3]
        is_run = list(platform) == list(range(len(platform)))
        self.held: slice | list[int] = slice(0, len(platform)) if is_run else list(platform)
        self.motors, self.gear, self.rotor = np.array(robot.actuated), robot.gear_ratio, robot.rotor_inertia
        self.others = np.setdiff1d(np.arange(robot.model.nv), self.motors)

    def evaluate(self, q: Array, target: Target) -> tuple[Array, Any]:
        """What loops and platform lack of closed and of the target (nv,), and the derivatives (nv, nv)."""
        model, data, (place, turn) = self.model, self.data, target
        pin.computeJointJacobians(model, data, q)
        places = [pin.updateFramePlacement(model, data, frame).translation for frame in self.frames]
        slopes = [pin.getFrameJacobian(model, data, frame, AXES) for frame in self.frames]
        lacking, rows, last = np.empty(len(q)), np.empty((len(q), len(q))), len(q) - self.size
        for span, one, other in self.loops:
            lacking[span] = (places[one] - places[other])[self.axes]
            np.subtract(slopes[one][self.axes], slopes[other][self.axes], out=rows[span])
        rows[last:] = slopes[self.platform][self.held]
        lacking[last : last + len(place)] = places[self.platform][: len(place)] - place
        if turn is not None:
            here = data.oMf[self.frames[self.platform]].rotation
            lacking[last + len(place) :] = -pin.log3(turn @ here.T)[self.angular]
        return lacking, rows

    def close(self, target: Target, q: Array) -> tuple[Array, Any]:
        """Joints with the platform there, by Newton's method from q, and the derivatives."""
        settled = False
        for _ in range(MOST):
            lacking, rows = self.evaluate(q, target)
            if settled:
                return q, rows
            step = self.step(rows, lacking)
            q, settled = q - step, np.abs(step).max() < SETTLED
        raise ArithmeticError("the loops do not close")

    def step(self, rows: Any, lacking: Array) -> Array:
        """Of Newton's method (nv,)."""
        return np.linalg.solve(rows, lacking)

    def solve(self, rows: Any, right: Array) -> Array:
        """With the derivatives of all poses and right sides (T, nv)."""
        return np.asarray(np.linalg.solve(rows, right[..., None])[..., 0])

    def joints(self, targets: Sequence[Target], start: Array | None = None) -> tuple[Array, list[Any]]:
        """Joints (T, nv) and the derivatives, from pose to pose."""
        q_k, q, rows = self.start if start is None else start, [], []
        for target in targets:
            q_k, here = self.close(target, q_k)
            q.append(q_k)
            rows.append(here)
        return np.array(q), rows

    def motion(self, x: Array, dx: Array, ddx: Array, start: Array | None = None) -> Motion:
        """Of the motion x(t), x', x" (T, n) of the platform."""
        targets, spins, spun = turned(x, dx, ddx, self.size - len(self.angular), self.angular)
        q, rows = self.joints(targets, start)
        return self.rates(q, self.stacked(rows), spins, spun)

    def rates(self, q: Array, rows: Any, twist: Array, change: Array) -> Motion:
        """With the platform's twist and its change (T, n)."""
        model, data, asked = self.model, self.data, np.zeros((2, *q.shape))
        asked[0, :, -self.size :], asked[1, :, -self.size :] = twist, change
        v, still = self.solve(rows, asked[0]), np.zeros(model.nv)
        for k in range(len(q)):
            pin.forwardKinematics(model, data, q[k], v[k], still)
            drift = [pin.getFrameClassicalAcceleration(model, data, f, AXES).vector for f in self.frames]
            for span, one, other in self.loops:
                asked[1, k, span] = (drift[other] - drift[one])[self.axes]
            asked[1, k, -self.size :] -= drift[self.platform][self.held]
        return Motion(q, v, self.solve(rows, asked[1]), rows)

    def stacked(self, rows: list[Any]) -> Any:
        """The derivatives of all poses as `solve` takes them."""
        return np.array(rows)

    def forces(self, motion: Motion) -> Array:
        """Of the open tree (T, nv)."""
        return np.array([pin.rnea(self.model, self.data, *one) for one in zip(*motion[:3], strict=True)])

    def passive(self, rows: Array) -> Array:
        """The loops' derivatives along the passive joints (.., m, m)."""
        return np.asarray(rows[..., : -self.size, self.others])

    def torques(self, motion: Motion) -> Array:
        """Motor torques (T, n) [N m], at each instant for itself."""
        r = self.forces(motion)
        back = self.passive(motion.rows).swapaxes(-1, -2)
        multipliers = np.linalg.solve(back, r[:, self.others, None])
        held = motion.rows[:, : -self.size, self.motors].swapaxes(-1, -2) @ multipliers
        return self.with_rotors(motion, r[:, self.motors] - held[..., 0])

    def with_rotors(self, motion: Motion, joint: Array) -> Array:
        return np.asarray(self.rotor * self.gear * motion.a[:, self.motors] + joint / self.gear)


def turned(
    x: Array, dx: Array, ddx: Array, linear: int, angular: Sequence[int]
) -> tuple[list[Target], Array, Array]:
    """Targets, twists and their changes (T, n), with rotation vectors along a line or about one axis."""
    w, dw, ddw = x[:, linear:], dx[:, linear:], ddx[:, linear:]
    if not angular:
        return [(place, None) for place in x], dx, ddx
    vectors = np.zeros((len(x), 3))
    vectors[:, angular] = w
    targets: list[Target] = [
        (place, pin.exp3(vector)) for place, vector in zip(x[:, :linear], vectors, strict=True)
    ]
    if len(angular) == 1:
        return targets, dx, ddx
    angle = np.linalg.norm(w, axis=1)[:, None]
    # omega = dw + (1 - cos)/a^2 w x dw + (a - sin)/a^3 w x (w x dw), and its derivative with d2w || dw
    rate = (w * dw).sum(axis=1)[:, None] / angle
    f, g = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    df = (np.sin(angle) - 2 * angle * f) / angle**2 * rate
    dg = (1 - np.cos(angle) - 3 * angle**2 * g) / angle**3 * rate

    def spin(v: Array) -> Array:
        return np.asarray(v + f * np.cross(w, v) + g * np.cross(w, np.cross(w, v)))

    inner = np.cross(w, dw)
    spun = spin(ddw) + df * inner + dg * np.cross(w, inner) + g * np.cross(dw, inner)
    return targets, np.hstack([dx[:, :linear], spin(dw)]), np.hstack([ddx[:, :linear], spun])
