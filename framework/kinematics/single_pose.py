"""The loop equations of one configuration at a time, in few numpy calls.

The equations are those of `closures`, which works on stacks. For a single configuration its calls on a dozen
small arrays take longer than pinocchio. Here the arrays are allocated once and overwritten. Every equation is
a product of two vectors of frames (`row_factors`).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from framework.kinematics.closures import closure_drift, row_factors
from framework.kinematics.frames import FrameMotions, FrameStack, Scratch
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import cross


class SinglePose:
    """Loop equations, Jacobian and drift of one configuration at a time, for one thread."""

    def __init__(self, robot: ParallelRobot) -> None:
        """Allocate the memory of one pose: F frames, m loop equations and their Jacobian (m, nv)."""
        rows, scratch = robot.rows, Scratch.of(robot.model, robot.frames)
        count = len(rows.names)
        self.robot, self.scratch = robot, scratch
        self._placements = np.empty((len(scratch.frames), 4, 3))  # three axes and the origin of each frame
        self._is_rotation = rows.rotation[:, None]
        self._weight = rows.derivative_weight[:, None]
        self._signs = rows.joint_signs(scratch.carried)
        self._couplings = rows.coupling_jacobian(robot.nv)
        self._wrench = np.empty((count, 6))
        self.residual = np.empty(count)  # of all loop equations [m, rad]
        self.jacobian = np.empty((count, robot.nv))

    def evaluate_pose(self, q: Array) -> None:
        """Compute residual (m,) and Jacobian (m, nv) of all loop equations at q (nq,)."""
        scratch, rows, wrench = self.scratch, self.robot.rows, self._wrench
        pin.computeJointJacobians(self.robot.model, scratch.data, q)
        pin.updateFramePlacements(self.robot.model, scratch.data)
        force, second = self._update_residual(q)
        lever = self._placements.reshape(-1, 3).take(rows.vectors[3], axis=0)  # the second frame's origin
        # a translation row is a force at the second frame's origin, a rotation row the couple w x u
        if rows.only_translations:
            wrench[:, :3] = force
        else:
            force = self._weight * force
            lever = np.where(self._is_rotation, second, lever)
            wrench[:, :3] = np.where(self._is_rotation, 0.0, force)
        wrench[:, 3:] = cross(lever, force)
        np.matmul(wrench, scratch.columns.T, out=self.jacobian)
        self.jacobian *= self._signs
        if rows.has_couplings:
            self.jacobian += self._couplings

    def evaluate_motion(self, q: Array, v: Array) -> None:
        """Compute the residual and the twists of bodies at q (nq,) for joint rates v (nv,).

        Pinocchio also computes the rates of the twists at zero joint accelerations, which `drift` reads.
        """
        scratch = self.scratch
        pin.computeForwardKinematicsDerivatives(self.robot.model, scratch.data, q, v, np.zeros(len(v)))
        pin.updateFramePlacements(self.robot.model, scratch.data)
        self._update_residual(q)

    def drift(self) -> Array:
        """Return the second time derivative (m,) of the loop equations at the last `evaluate_motion`."""
        scratch = self.scratch
        twists = np.array([scratch.velocities, scratch.accelerations]).take(scratch.bodies, axis=1)
        return closure_drift(self.robot.rows, FrameMotions.of(self._placements, *twists))

    def frame_stack(self, q: Array) -> FrameStack:
        """Return the frames of the last `evaluate_pose` or `evaluate_motion` at q (nq,), T = 1."""
        return FrameStack(self._placements[None], self.scratch.columns[None], self.scratch.carried, q[None])

    def platform_twist(self) -> tuple[Array, Array]:
        """Return velocity and angular velocity (3,) of the platform's frame at the last `evaluate_motion`."""
        twist = self.scratch.velocities[self.scratch.bodies[0]]
        return twist[:3] + cross(twist[3:], self.platform_origin), twist[3:]

    @property
    def platform_origin(self) -> Array:
        """The origin (3,) of the platform's frame at the last `evaluate_pose` or `evaluate_motion`."""
        return self._placements[0, 3]

    def _update_residual(self, q: Array) -> tuple[Array, Array]:
        """Update the residual from pinocchio's frames; return both factors (m, 3) of the rows."""
        scratch, rows = self.scratch, self.robot.rows
        scratch.placements.reshape(-1, 4, 3).take(scratch.frames, axis=0, out=self._placements)
        a, b = row_factors(rows, self._placements)
        np.einsum("ij,ij->i", a, b, out=self.residual)  # a . b of each row
        if not rows.only_translations:
            self.residual *= rows.weight
            self.residual -= rows.constant
        if rows.has_couplings:
            self.residual[rows.coupled] = rows.coupling_residual(q[None])[0]
        return a, b
