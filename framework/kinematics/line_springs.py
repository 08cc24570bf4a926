"""Springs and dampers between two points of a mechanism, along their line, and their joint forces.

A spring joins the origins p_1 and p_2 of two frames. With d = p_2 - p_1, the length L = |d| and the direction
u = d / L, it pulls the points together with the tension

    f = k (L - L_0) + c dL/dt.

J' f holds the spring, where J (nv,) = dL/dq, and is part of the forces of the open tree (`dynamics.forces`).
With D (3, nv) = dd/dq it changes by

    d(J' f)/dq = f d2L/dq2 + J' (k J + c d(dL/dt)/dq),        d2L/dq2 = G + D' (1 - u u') D / L,

where G is the change of the joint forces of constant forces u at p_2 and -u at p_1. A spring of free length
L_0 = 0 is regular also where its points meet.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.external_wrenches import AppliedWrench, applied_wrench, wrench_slope
from framework.kinematics.frames import FrameStack, frames_at
from framework.kinematics.mechanism import LineSprings, Mechanism
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.numerics.ordered_sums import dot, matmul, matvec


class Lines(NamedTuple):
    """The lines of K springs at T configurations."""

    mechanism: Mechanism
    springs: LineSprings
    frames: FrameStack
    length: Array  # (T, K) [m]
    u: Array  # (T, K, 3) unit direction from the first to the second point; 0 where these meet
    D: Array  # (T, K, 3, nv) derivative of the separation of the points by the joints
    J: Array  # (T, K, nv) derivative of the length

    @staticmethod
    def of(mechanism: Mechanism, frames: FrameStack, springs: LineSprings | None = None) -> Lines:
        """Compute the lines of a mechanism's springs; `springs` replaces their numbers."""
        springs = mechanism.line_springs if springs is None else springs
        separation = frames.position[:, springs.second] - frames.position[:, springs.first]
        length = np.sqrt(dot(separation, separation))
        u = separation / np.maximum(length, LEAST_DIVISOR)[..., None]
        D = np.zeros((*length.shape, 3, mechanism.nv))  # (T, K, 3, nv)
        for k, (first, second) in enumerate(zip(springs.first, springs.second, strict=True)):
            D[:, k] = frames.frame_jacobian(second)[:, :3] - frames.frame_jacobian(first)[:, :3]
        J = matmul(u[:, :, None], D)[:, :, 0]
        return Lines(mechanism, springs, frames, length, u, D, J)

    @property
    def energy(self) -> Array:
        """The elastic energy (T,) [J]."""
        energy: Array = 0.5 * (self.springs.stiffness * (self.length - self.springs.rest) ** 2).sum(axis=1)
        return energy

    def tensions(self, v: Array | None = None) -> Array:
        """Compute the tensions (T, K) [N] at joint rates v (T, nv), or at rest."""
        tension: Array = self.springs.stiffness * (self.length - self.springs.rest)
        return tension if v is None else tension + self.springs.damping * matvec(self.J, v)

    def forces(self, v: Array | None = None) -> Array:
        """Compute the joint forces (T, nv) that hold the springs at joint rates v (T, nv), or at rest."""
        return matvec(self.J.swapaxes(1, 2), self.tensions(v))

    def damping_forces(self, v: Array) -> Array:
        """Compute the joint forces (T, nv) that hold the dampers alone at joint rates v (T, nv)."""
        return matvec(self.J.swapaxes(1, 2), self.springs.damping * matvec(self.J, v))

    @property
    def stiffness(self) -> Array:
        """The stiffness (T, nv, nv) of the springs without the geometric stiffness of their tension."""
        return self._sum_along(self.springs.stiffness)

    @property
    def damping(self) -> Array:
        """The derivative (T, nv, nv) of the forces by the joint rates."""
        return self._sum_along(self.springs.damping)

    def force_slope(self, v: Array | None = None) -> Array:
        """Compute the derivative (T, nv, nv) of the forces at joint rates v along tangent steps (columns)."""
        springs, J = self.springs, self.J
        length = np.maximum(self.length, LEAST_DIVISOR)
        # f / L; of a spring of free length 0 the constant k
        pull = springs.stiffness * (1.0 - springs.rest / length)
        if v is not None:
            pull = pull + springs.damping * matvec(J, v) / length
        tension = self.tensions(v)
        slope = self.stiffness
        for k in range(len(springs.names)):
            across = self.D[:, k] - self.u[:, k, :, None] * J[:, k, None]  # (1 - u u') D, (T, 3, nv)
            turning = matmul(across.swapaxes(1, 2), across)
            moving = -sum(
                wrench_slope(self.mechanism, self.frames.screws, unit)
                for unit in self._pulls_on(k, np.ones(len(J)))
            )  # G
            slope = slope + tension[:, k, None, None] * moving + pull[:, k, None, None] * turning
            if v is not None and np.any(springs.damping):
                curvature = moving + turning / length[:, k, None, None]  # d2L/dq2
                by_q = matvec(curvature.swapaxes(1, 2), v)  # of dL/dt
                damping = springs.damping[..., k] * np.ones(len(J))
                slope = slope + (damping[:, None] * J[:, k])[:, :, None] * by_q[:, None]
        return slope

    def pulls(self, v: Array | None = None) -> tuple[AppliedWrench, ...]:
        """Return the wrenches ON the bodies at both ends of each spring."""
        tension = self.tensions(v)
        ends = (self._pulls_on(k, tension[:, k]) for k in range(len(self.springs.names)))
        return tuple(wrench for pair in ends for wrench in pair)

    def _pulls_on(self, k: int, tension: Array) -> tuple[AppliedWrench, AppliedWrench]:
        """Return the wrenches ON the bodies at the ends of spring k under a `tension` (T,)."""
        wrench = np.zeros((len(tension), 6))
        wrench[:, :3] = tension[:, None] * self.u[:, k]  # ON the first body
        frames = [self.mechanism.frames[ends[k]] for ends in (self.springs.first, self.springs.second)]
        first, second = (self.mechanism.model.frames[frame].name for frame in frames)
        return (
            applied_wrench(self.mechanism, self.frames, first, wrench),
            applied_wrench(self.mechanism, self.frames, second, -wrench),
        )

    def _sum_along(self, gain: Array) -> Array:
        """Compute the sum (T, nv, nv) of J' gain J over the springs."""
        return matmul((self.J * gain[..., None]).swapaxes(1, 2), self.J)


def lines_at(mechanism: Mechanism, q: Array) -> Lines:
    """Compute the lines of a mechanism's springs at configurations q (T, nq)."""
    return Lines.of(mechanism, frames_at(mechanism, q))
