"""The 5R as one writes it who has pinocchio and numpy alone: loops over poses, stacks where numpy can.

Nothing of the framework is called: it gives the `pin.Model`, the names of frames and the pose to begin with.
It stands for what others can do without us, at its best: no checks, every pose started from the one before.
"""

from collections.abc import Callable, Iterable, Sequence
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
    rows: Array  # (T, 4, 4); (T, 2, 4), those of the loop alone, where the motion is given


def solve_each(matrices: Array, right: Array) -> Array:
    """Solutions (T, k) of matrices (T, k, k) for right sides (T, k)."""
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])


def newton_in_stacks(evaluate: Callable[[Array], tuple[Array, Array]], guess: Array) -> tuple[Array, Array]:
    """Joints (T, k) with no residual, by Newton's method from guesses, and the derivatives (T, k, k) there.

    `evaluate` gives residuals and derivatives at poses (T, k).
    """
    q, settled = guess, False
    for _ in range(MOST):
        residuals, rows = evaluate(q)
        if settled:
            return q, rows
        step = solve_each(rows, residuals)
        q, settled = q - step, np.abs(step).max() < SETTLED
    raise ArithmeticError("the loops do not close")


class BareRobot:
    """Model, frames and columns of the 5R; rows 0 and 1 close the loop, 2 and 3 move the platform."""

    def __init__(self, robot: ParallelRobot, start: Array) -> None:
        self.model, self.data, self.start = robot.model, robot.model.createData(), start
        self.pool = pin.ModelPool(self.model, 1)
        (closure,), platform = robot.description.closures, robot.description.platform.frame
        self.frames = [robot.model.getFrameId(name) for name in (*closure.frames, platform)]
        self.motors, self.gear, self.rotor = np.array(robot.actuated), robot.gear_ratio, robot.rotor_inertia
        self.others = np.setdiff1d(np.arange(robot.model.nv), self.motors)

    def tips(self, q: Array, frames: Sequence[int]) -> tuple[Array, Array]:
        """Places (T, F, 2) of frames at poses (T, 4), and their derivatives (T, F, 2, 4)."""
        model, data = self.model, self.data
        places, slopes = np.empty((len(q), len(frames), 3)), np.empty((len(q), len(frames), 6, model.nv))
        for pose, place, slope in zip(q, places, slopes, strict=True):
            pin.computeJointJacobians(model, data, pose)
            for k, frame in enumerate(frames):
                place[k] = pin.updateFramePlacement(model, data, frame).translation
                slope[k] = pin.getFrameJacobian(model, data, frame, AXES)
        return places[..., :2], slopes[:, :, :2]

    def evaluate(self, q: Array, x: Array) -> tuple[Array, Array]:
        """Residuals (T, 4) of closed loops with the platform at x (T, 2), and the derivatives (T, 4, 4)."""
        places, slopes = self.tips(q, self.frames)
        residuals = np.hstack([places[:, 0] - places[:, 1], places[:, 2] - x])
        return residuals, np.hstack([slopes[:, 0] - slopes[:, 1], slopes[:, 2]])

    def close(self, x: Array, q: Array) -> tuple[Array, Array]:
        """Joints (4,) with the platform at x (2,), by Newton's method from q, and the derivatives (4, 4)."""
        joints, rows = newton_in_stacks(lambda pose: self.evaluate(pose, x), q[None])
        return joints[0], rows[0]

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
            q, rows = newton_in_stacks(lambda poses: self.evaluate(poses, x), guess)
        still = np.zeros_like(x)
        v = solve_each(rows, np.hstack([still, dx]))
        rest, drift = np.zeros(model.nv), np.empty((len(q), 3, 3))  # accelerations of the frames' points
        for pose, rate, points in zip(q, v, drift, strict=True):
            pin.forwardKinematics(model, data, pose, rate, rest)
            for k, frame in enumerate(self.frames):
                points[k] = pin.getFrameClassicalAcceleration(model, data, frame, AXES).linear
        one, other, platform = drift[..., :2].swapaxes(0, 1)  # (T, 2) each
        right = np.hstack([other - one, ddx - platform])
        return Motion(q, v, solve_each(rows, right), rows)

    def forces(self, motion: Motion) -> Array:
        """Of the open tree (T, 4): all instants in one call, which takes them as columns."""
        forces = np.empty_like(motion.q)
        pin.rneaInParallel(1, self.pool, motion.q.T, motion.v.T, motion.a.T, forces.T)
        return forces

    def passive(self, rows: Array) -> Array:
        """The loop's derivatives along the passive joints (.., 2, 2)."""
        return np.asarray(rows[..., :2, self.others])

    def torques_of(self, q: Array, v: Array, a: Array) -> Array:
        """Motor torques (T, 2) [N m] of a motion (T, 4) that is known, at each instant for itself."""
        slopes = self.tips(q, self.frames[:2])[1]
        return self.torques(Motion(q, v, a, slopes[:, 0] - slopes[:, 1]))

    def torques(self, motion: Motion) -> Array:
        """Motor torques (T, 2) [N m], at each instant for itself."""
        r = self.forces(motion)
        back = self.passive(motion.rows).swapaxes(-1, -2)
        multipliers = solve_each(back, r[:, self.others])
        joint = r[:, self.motors] - np.matvec(motion.rows[:, :2, self.motors].swapaxes(-1, -2), multipliers)
        return np.asarray(self.rotor * self.gear * motion.a[:, self.motors] + joint / self.gear)
