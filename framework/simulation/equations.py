"""The equations of motion of a robot with closed loops, in all its coordinates, for a stack of states.

    M(q) dv/dt + c(q, v) + g(q) + K (q - rest) + D v = S' n tau + J(q)' lambda,        F(q) = 0

M carries armature and rotors, n^2 I_a on the actuated columns; K the springs of the robot and those on
joints of its URDF; D the viscous damping of its joints and what the caller adds; n tau is the motor torque
on the joint side; F are the independent loop equations and J their Jacobian. Nothing is divided by what
vanishes at a Type 2 singularity: there the passive columns of J lose rank, J itself does not.

One call of pinocchio a state gives all; what follows is stacked numpy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, collect_frames, difference, forces_on_joints
from framework.kinematics.inverse_kinematics import require_joints_close
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import Scratch
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, ArrayLike
from framework.tolerances import EIGENVALUE_ROUNDING


class Tangent(NamedTuple):
    """The left side of the equations at T states with derivatives, and the closures."""

    force: Array  # (T, nv) M a + c + g + K (q - rest) + D v
    by_q: Array  # (T, nv, nv)
    by_v: Array  # (T, nv, nv)
    mass: Array  # (T, nv, nv) with rotors
    frames: FrameStack
    residual: Array  # (T, m) F [m, rad]
    jacobian: Array  # (T, m, nv) J


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """A robot made ready for simulation; `damping` [N m s/rad, N s/m] acts on every joint rate.

    Dry friction is left out, and with it the share of a planned motion's torques that overcomes it.
    """

    robot: ParallelRobot
    damping: Array  # (nv,)
    rows: LoopRows
    rotors: Array  # (nv,) [kg m^2], joint side; 1 on massless joints that move nothing and are held
    stiffness: Array  # (nv,)
    scratch: Scratch  # working memory of pinocchio: one object does not serve two threads at once

    @staticmethod
    def of(robot: ParallelRobot, damping: ArrayLike | None = None) -> EquationsOfMotion:
        """Return the equations of a robot.

        Raises:
            InvalidInput: damping of the wrong length or negative; loops that only springs can close.
            NotAssembled: the loops do not close at the reference.
        """
        damping = check_damping(damping, (robot.nv,))
        require_joints_close(robot)
        plain = EquationsOfMotion(
            robot=robot,
            damping=damping + robot.joint_damping,
            rows=robot.loops,
            rotors=robot.rotors,
            stiffness=robot.all_stiffness,
            scratch=Scratch.of(robot.model, robot.frames),
        )
        return plain._load_idle_joints()

    def _load_idle_joints(self) -> EquationsOfMotion:
        """Give a unit inertia to idle joints without mass.

        Nothing drives them, so all stay still.
        """
        idle = self.robot.structure.idle
        if not len(idle):
            return self
        mass = self.tangent_at_rest(self.robot.q_near).mass[0]
        massless = idle[np.diag(mass)[idle] <= EIGENVALUE_ROUNDING * np.diag(mass).max()]
        rotors = self.rotors.copy()
        rotors[massless] = 1.0
        return replace(self, rotors=rotors)

    def spring_force(self, q: Array) -> Array:
        """Compute K (q - rest), (T, nv)."""
        return spring_forces(self.robot, self.stiffness, self.robot.joint_rest, q)

    def motor_forces(self, torque: Array) -> Array:
        """Compute S' n tau (T, nv), the generalised forces of motor torques (T, n_a), joint side."""
        force = np.zeros((len(torque), self.robot.nv))
        force[:, self.robot.actuated] = self.robot.gear_ratio * torque
        return force

    def tangent(self, q: Array, v: Array, a: Array) -> Tangent:
        """Compute all terms and derivatives at q (T, nq), v and a (T, nv).

        Pinocchio gives the tree: tau = M a + c + g with its derivatives and M, and frames. Rotors, springs
        and dampers of joints are added.
        """
        model, data, (T, nv) = self.robot.model, self.scratch.data, v.shape
        force, (by_q, by_v, mass) = np.empty((T, nv)), np.empty((3, T, nv, nv))

        def compute(k: int) -> pin.Model:
            pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
            force[k], by_q[k], by_v[k], mass[k] = data.tau, data.dtau_dq, data.dtau_dv, data.M
            return model

        frames = collect_frames(self.scratch, q, compute)
        mass[:, range(nv), range(nv)] += self.rotors
        by_q[:, range(nv), range(nv)] += self.stiffness
        by_v[:, range(nv), range(nv)] += self.damping
        force += self.rotors * a + self.damping * v + self.spring_force(q)
        loops = loop_equations(self.rows, frames)
        return Tangent(force, by_q, by_v, mass, frames, loops.residual, loops.jacobian)

    def tangent_at_rest(self, q: Array) -> Tangent:
        """Compute all terms and derivatives at one configuration (nq,) at rest, T = 1."""
        rest = np.zeros((1, self.robot.nv))
        return self.tangent(q[None], rest, rest)

    def energy(self, q: Array, v: Array) -> Array:
        """Compute the sum of kinetic, gravitational and elastic energy (T,) [J], heights from the base.

        Rotors add n^2 I v^2 / 2, springs K (q - rest)^2 / 2.
        """
        model, data = self.robot.model, self.scratch.data
        tree = [
            pin.computeKineticEnergy(model, data, a, b) + pin.computePotentialEnergy(model, data, a)
            for a, b in zip(q, v, strict=True)
        ]
        offset = difference(self.robot, self.robot.neutral, q) - self.robot.joint_rest
        stored = 0.5 * (v**2 @ self.robot.rotors) + 0.5 * (offset**2 @ self.stiffness)
        return np.array(tree) + stored


def spring_forces(robot: ParallelRobot, stiffness: Array, rest: Array, q: Array) -> Array:
    """Compute the forces K (q - rest) (T, nv) of springs at q (T, nq).

    Stiffness and rest are (nv,) or (T, nv); q is counted from the neutral configuration.
    """
    if not stiffness.any():
        return np.zeros((len(q), robot.nv))
    springs = stiffness * (difference(robot, robot.neutral, q) - rest)
    return forces_on_joints(robot, robot.neutral, q, springs)


def check_damping(damping: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    """Return a checked damping of joint rates; 0 by default.

    It is one number, (nv,) or of the `shape`, whose last is nv.

    Raises:
        InvalidInput: it has another shape, or is negative somewhere.
    """
    if damping is None:
        return np.zeros(shape)
    try:
        dampings = np.asarray(damping, dtype=float)
    except (TypeError, ValueError):
        dampings = np.array(np.nan)  # refused below
    if dampings.shape not in ((), shape[-1:], shape) or not np.all((dampings >= 0) & np.isfinite(dampings)):
        raise InvalidInput(
            f"damping: needs {' x '.join(map(str, shape))} numbers (or one for all), none negative, got "
            f"{damping!r}"
        )
    return dampings
