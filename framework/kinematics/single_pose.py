"""The loop equations of one configuration after another, in as few calls of numpy as it takes.

The same equations as in `closures`, which is for stacks: there a call on each of a dozen small arrays costs
more than Pinocchio. Every equation is a product of two vectors of frames, a . b; all vectors are gathered at
once from the axes and origins of the frames, in arrays that are allocated once.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.kinematics.frames import FrameStack, rotations
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import Scratch

_NEXT, _BEFORE = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])
_SKEW = np.array([0, 3, 2, 3, 0, 1, 2, 1, 0]) - 1  # places of w in the matrix of w x, zeros at the sign 0
_SKEW_SIGN = np.array([0.0, -1.0, 1.0, 1.0, 0.0, -1.0, -1.0, 1.0, 0.0])


class SinglePose:
    """Loop equations, Jacobian and drift of one configuration at a time; it serves one thread."""

    def __init__(self, robot: ParallelRobot) -> None:
        rows, scratch = robot.rows, Scratch.of(robot.model, robot.frames)
        self.robot, self.scratch, count, m = robot, scratch, len(scratch.frames), len(rows.names)
        turning, distance = rows.rotation, rows.distance
        origin = np.full(m, 3)
        # vectors of frames, four of each: its axes and its origin
        self._frames = np.empty((count, 12))
        self._vectors = self._frames.reshape(4 * count, 3)
        self._gathered = np.concatenate(
            [
                4 * rows.first + np.where(distance, origin, rows.first_axis),
                4 * rows.second + np.where(turning, rows.second_axis, origin),
                4 * rows.first + origin,
                4 * rows.second + origin,
            ]
        )
        self._of_rows = np.empty((4 * m, 3))
        self._turning, self._distance = turning[:, None], distance[:, None]
        self._straight = rows.only_translations
        length = np.where(distance, rows.length, 1.0)
        self._weight = np.where(distance, 0.5 / length, 1.0 - rows.coupled)
        self._constant = np.where(distance, 0.5 * length, 0.0)
        self._unit = np.where(distance, 1.0 / length, 1.0)[:, None]
        self._sign = np.where(turning, rows.sign, 1.0)[:, None]
        self._signs = scratch.carried[rows.second] - scratch.carried[rows.first]
        self._coupled = rows.coupling_jacobian(robot.model.nv)
        self._wrench = np.empty((m, 6))
        self.residual = np.empty(m)  # of all loop equations [m, rad]
        self.jacobian = np.empty((m, robot.model.nv))

    def place(self, q: Array) -> None:
        """Compute residual (rows,) and jacobian (rows, nv) of all loop equations at q (nq,)."""
        scratch = self.scratch
        pin.computeJointJacobians(self.robot.model, scratch.data, q)
        pin.updateFramePlacements(self.robot.model, scratch.data)
        scratch.update()
        a, b = self._measure(q)
        wrench, lever = self._wrench, self._second_points if self._straight else self._levers(b)
        force = a if self._straight else a * self._unit
        both = lever.take(_NEXT, axis=1) * force.take(_BEFORE, axis=1)
        np.subtract(both[:, :3], both[:, 3:], out=wrench[:, 3:])
        wrench[:, :3] = force if self._straight else np.where(self._turning, 0.0, force)
        np.matmul(wrench, scratch.columns.T, out=self.jacobian)
        self.jacobian *= self._signs
        if self.robot.rows.has_couplings:
            self.jacobian += self._coupled

    def move(self, q: Array, v: Array) -> None:
        """Compute residual, twists and drift accelerations at q (nq,) with joint rates v (nv,)."""
        scratch = self.scratch
        pin.computeForwardKinematicsDerivatives(self.robot.model, scratch.data, q, v, np.zeros(len(v)))
        pin.updateFramePlacements(self.robot.model, scratch.data)
        scratch.update()
        self._measure(q)

    def drift(self) -> Array:
        """Return the second time derivative (rows,) of the equations at the last `move`."""
        scratch, count = self.scratch, len(self._frames)
        twist, rate = (
            scratch.velocities.take(scratch.bodies, axis=0),
            scratch.accelerations.take(scratch.bodies, axis=0),
        )
        vectors = self._frames.reshape(count, 4, 3)
        turning, swinging = _crossed(twist), _crossed(rate)
        first = vectors @ turning
        first[:, 3] += twist[:, :3]
        second = vectors @ swinging
        second += first @ turning
        second[:, 3] += rate[:, :3]
        m = len(self._weight)
        a0, b0 = self._factors(self._of_rows)
        a1, b1 = self._factors(first.reshape(-1, 3).take(self._gathered, axis=0))
        a2, b2 = self._factors(second.reshape(-1, 3).take(self._gathered, axis=0))
        terms = a2 * b0
        terms += 2.0 * a1 * b1
        terms += a0 * b2
        return np.asarray(self._weight * terms.sum(axis=1)).reshape(m)

    def frame_stack(self, q: Array) -> FrameStack:
        """Return the frames of the last `place` or `move` at q (nq,), as a stack of one."""
        frames, scratch = self._frames[None], self.scratch
        return FrameStack(frames[..., 9:], rotations(frames), scratch.columns[None], scratch.carried, q[None])

    def platform_twist(self) -> tuple[Array, Array]:
        """Return velocity and angular velocity (3,) of the platform's frame at the last `move`."""
        twist = self.scratch.velocities[self.scratch.bodies[0]]
        linear, w, p = twist[:3], twist[3:], self._frames[0, 9:]
        both = w.take(_NEXT) * p.take(_BEFORE)
        return linear + both[:3] - both[3:], w

    @property
    def platform_origin(self) -> Array:
        """The origin (3,) of the platform's frame at the last `place` or `move`."""
        return self._frames[0, 9:]

    @property
    def _second_points(self) -> Array:
        return self._of_rows[3 * len(self._weight) :]

    def _measure(self, q: Array) -> tuple[Array, Array]:
        """Gather the vectors of the frames, compute the residual, and return both factors (rows, 3)."""
        self.scratch.placements.take(self.scratch.frames, axis=0, out=self._frames)
        self._vectors.take(self._gathered, axis=0, out=self._of_rows)
        a, b = self._factors(self._of_rows)
        np.einsum("ij,ij->i", a, b, out=self.residual)
        if not self._straight:
            self.residual *= self._weight
            self.residual -= self._constant
        rows = self.robot.rows
        if rows.has_couplings:
            self.residual[rows.coupled] = rows.coupling_residual(q[None])[0]
        return a, b

    def _factors(self, vectors: Array) -> tuple[Array, Array]:
        """Return both factors (rows, 3) of the equations from vectors (4 rows, 3), or from their rates."""
        m = len(self._weight)
        apart = vectors[3 * m :] - vectors[2 * m : 3 * m]
        if self._straight:
            return vectors[:m], apart
        second = np.where(self._turning, vectors[m : 2 * m], apart) * self._sign
        return np.where(self._distance, apart, vectors[:m]), second

    def _levers(self, second: Array) -> Array:
        """Return what crosses the force (rows, 3): the second origin, or an axis that turns."""
        return np.where(self._turning, second, self._second_points)


def _crossed(twists: Array) -> Array:
    """Return matrices (F, 3, 3) with c @ matrix = w x c for rows c and twists (F, 6)."""
    return (twists.take(3 + _SKEW, axis=1) * -_SKEW_SIGN).reshape(-1, 3, 3)
