"""The 5R as one writes it who has pinocchio and numpy alone: loops over poses, stacks where numpy can.

Nothing of the framework is called: it gives the `pin.Model`, the names of frames and the pose to begin with.
It stands for what others can do without us, at its best: no checks, every pose started from the one before.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework import ParallelRobot
from framework.numerics import Array

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
SETTLED, MOST = 1e-8, 20  # a step of Newton's method whose successor is below rounding; steps at most


class Motion(NamedTuple):
    """A motion at T instants: joints (T, 4), their rates, and the rows of the loop and of the platform."""

    q: Array
    v: Array
    a: Array
    rows: Array  # (T, 4, 4)


def solve_each(matrices: Array, right: Array) -> Array:
    """Solutions (T, k) of matrices (T, k, k) for right sides (T, k)."""
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])


def newton_in_stacks(
    evaluate: Callable[[int, Array], tuple[Array, Array]], guess: Array
) -> tuple[Array, Array]:
    """Joints (T, k) with no residual, by Newton's method from guesses, and the derivatives (T, k, k) there.

    `evaluate` gives residual and derivatives at a pose of number k; all poses are solved in one stack.
    """
    q, settled = guess, False
    for _ in range(MOST):
        residuals, rows = map(np.array, zip(*(evaluate(k, pose) for k, pose in enumerate(q)), strict=True))
        if settled:
            return q, rows
        step = solve_each(rows, residuals)
        q, settled = q - step, np.abs(step).max() < SETTLED
    raise ArithmeticError("the loops do not close")


class BareRobot:
    """Model, frames and columns of the 5R; rows 0 and 1 close the loop, 2 and 3 move the platform."""

    def __init__(self, robot: ParallelRobot, start: Array) -> None:
        self.model, self.data, self.start = robot.model, robot.model.createData(), start
        (closure,), platform = robot.description.closures, robot.description.platform.frame
        self.frames = [robot.model.getFrameId(name) for name in (*closure.frames, platform)]
        self.motors, self.gear, self.rotor = np.array(robot.actuated), robot.gear_ratio, robot.rotor_inertia
        self.others = np.setdiff1d(np.arange(robot.model.nv), self.motors)

    def evaluate(self, q: Array, x: Array) -> tuple[Array, Array]:
        """Residual (4,) of the closed loop with the platform at x (2,), and the derivatives (4, 4)."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        one, other, platform = (
            pin.updateFramePlacement(model, data, frame).translation[:2] for frame in self.frames
        )
        slopes = [pin.getFrameJacobian(model, data, frame, AXES)[:2] for frame in self.frames]
        rows = np.vstack([slopes[0] - slopes[1], slopes[2]])
        return np.concatenate([one - other, platform - x]), rows

    def close(self, x: Array, q: Array) -> tuple[Array, Array]:
        """Joints with the platform at x (2,), by Newton's method from q, and the derivatives."""
        settled = False
        for _ in range(MOST):
            residual, rows = self.evaluate(q, x)
            if settled:
                return q, rows
            step = np.linalg.solve(rows, residual)
            q, settled = q - step, np.abs(step).max() < SETTLED
        raise ArithmeticError("the loops do not close")

    def joints(self, places: Iterable[Array], start: Array | None = None) -> tuple[Array, Array]:
        """Joints (T, 4) and the derivatives (T, 4, 4), from pose to pose."""
        pose, poses, rows = self.start if start is None else start, [], []
        for x in places:
            pose, derivatives = self.close(x, pose)
            poses.append(pose)
            rows.append(derivatives)
        return np.array(poses), np.array(rows)

    def motion(
        self, x: Array, dx: Array, ddx: Array, start: Array | None = None, guess: Array | None = None
    ) -> Motion:
        """The joints' motion under x(t), x', x" (T, 2) of the platform.

        From pose to pose, the first one near `start` (4,); or in stacks, each pose near its `guess` (T, 4).
        """
        model, data = self.model, self.data
        if guess is None:
            q, rows = self.joints(x, start)
        else:
            q, rows = newton_in_stacks(lambda k, pose: self.evaluate(pose, x[k]), guess)
        still = np.zeros_like(x)
        v = solve_each(rows, np.hstack([still, dx]))
        right = np.hstack([still, ddx])
        for k in range(len(q)):
            pin.forwardKinematics(model, data, q[k], v[k], np.zeros(model.nv))
            one, other, platform = (
                pin.getFrameClassicalAcceleration(model, data, frame, AXES).linear[:2]
                for frame in self.frames
            )
            right[k] -= np.concatenate([one - other, platform])
        return Motion(q, v, solve_each(rows, right), rows)

    def forces(self, motion: Motion) -> Array:
        """Of the open tree (T, 4)."""
        return np.array([pin.rnea(self.model, self.data, *one) for one in zip(*motion[:3], strict=True)])

    def passive(self, rows: Array) -> Array:
        """The loop's derivatives along the passive joints (.., 2, 2)."""
        return np.asarray(rows[..., :2, self.others])

    def torques_of(self, q: Array, v: Array, a: Array) -> Array:
        """Motor torques (T, 2) [N m] of a motion (T, 4) that is known, at each instant for itself."""
        rows = np.array([self.evaluate(pose, np.zeros(2))[1] for pose in q])
        return self.torques(Motion(q, v, a, rows))

    def torques(self, motion: Motion) -> Array:
        """Motor torques (T, 2) [N m], at each instant for itself."""
        r = self.forces(motion)
        back = self.passive(motion.rows).swapaxes(-1, -2)
        multipliers = solve_each(back, r[:, self.others])
        joint = r[:, self.motors] - np.matvec(motion.rows[:, :2, self.motors].swapaxes(-1, -2), multipliers)
        return np.asarray(self.rotor * self.gear * motion.a[:, self.motors] + joint / self.gear)
