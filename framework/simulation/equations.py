"""The equations of motion of a robot with closed loops, in all its coordinates, for a stack of states.

    M(q) dv/dt + c(q, v) + g(q) + K (q - rest) + D v = S' n tau + J(q)' lambda,        F(q) = 0

* M: inertia with armature and rotors, n^2 I_a on the actuated columns;
* K: the springs of the robot file and those on joints of the URDF;
* D: the viscous damping of the joints and what the caller adds;
* n tau: the motor torques on the joint side;
* F, J: the independent loop equations and their Jacobian.

The equations are regular at a Type 2 singularity: the passive columns of J lose rank there, but J does not.
Pinocchio is called once for each state; all other computations treat the whole stack.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, Scratch, collect_frames, difference, forces_on_joints
from framework.kinematics.inverse_kinematics import require_joints_close
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, ArrayLike
from framework.tolerances import EIGENVALUE_ROUNDING


class Tangent(NamedTuple):
    """The left side of the equations at T states with its derivatives, and the loop equations."""

    force: Array  # (T, nv) M a + c + g + K (q - rest) + D v
    by_q: Array  # (T, nv, nv) derivatives of the force by tangent steps of q
    by_v: Array  # (T, nv, nv) derivatives of the force by v
    mass: Array  # (T, nv, nv) with rotors
    frames: FrameStack
    residual: Array  # (T, m) F [m, rad]
    jacobian: Array  # (T, m, nv) J


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """A robot prepared for simulation, without dry friction."""

    robot: ParallelRobot
    damping: Array  # (nv,) [N m s/rad, N s/m] of every joint rate
    rows: LoopRows  # the independent ones
    rotors: Array  # (nv,) [kg m^2], joint side; 1 on idle joints without mass
    stiffness: Array  # (nv,) [N m/rad, N/m]
    scratch: Scratch  # working memory of pinocchio: one object does not serve two threads at once

    @staticmethod
    def of(robot: ParallelRobot, damping: ArrayLike | None = None) -> EquationsOfMotion:
        """Return the equations of a robot; `damping`, one number or (nv,), is added to that of its joints.

        Raises:
            InvalidInput: damping of the wrong length or negative; loops that only springs can close.
            NotAssembled: the loops do not close at the reference.
        """
        added = check_damping(damping, (robot.nv,))
        require_joints_close(robot)
        equations = EquationsOfMotion(
            robot=robot,
            damping=added + robot.joint_damping,
            rows=robot.loops,
            rotors=robot.rotors,
            stiffness=robot.all_stiffness,
            scratch=Scratch.of(robot.model, robot.frames),
        )
        return equations._load_idle_joints()

    def _load_idle_joints(self) -> EquationsOfMotion:
        """Return the equations with unit inertia on idle joints without mass.

        No force acts on such a joint, so any inertia makes its equation solvable and changes nothing else.
        """
        idle = self.robot.structure.idle
        if not len(idle):
            return self
        inertias = np.diag(self.tangent_at_rest(self.robot.q_near).mass[0])  # (nv,)
        massless = idle[inertias[idle] <= EIGENVALUE_ROUNDING * inertias.max()]
        rotors = self.rotors.copy()
        rotors[massless] = 1.0
        return replace(self, rotors=rotors)

    def spring_force(self, q: Array) -> Array:
        """Compute the spring forces K (q - rest) (T, nv) at q (T, nq)."""
        return spring_forces(self.robot, self.stiffness, self.robot.joint_rest, q)

    def motor_forces(self, torque: Array) -> Array:
        """Compute the generalised forces S' n tau (T, nv) of motor torques tau (T, n_a), motor side."""
        force = np.zeros((len(torque), self.robot.nv))
        force[:, self.robot.actuated] = self.robot.gear_ratio * torque
        return force

    def tangent(self, q: Array, v: Array, a: Array) -> Tangent:
        """Compute all terms and derivatives at q (T, nq), v and a (T, nv).

        For the open tree pinocchio computes the frames, tau = M a + c + g, the derivatives of tau, and M.
        Rotors, springs and dampers are added here.
        """
        model, data = self.robot.model, self.scratch.data
        T, nv = v.shape
        force = np.empty((T, nv))
        by_q, by_v, mass = np.empty((3, T, nv, nv))

        def compute(k: int) -> pin.Model:
            """Compute the terms of the tree at state k; return the model for its frames."""
            pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
            force[k] = data.tau
            by_q[k] = data.dtau_dq
            by_v[k] = data.dtau_dv
            mass[k] = data.M
            return model

        frames = collect_frames(self.scratch, q, compute)
        diagonal = range(nv)
        mass[:, diagonal, diagonal] += self.rotors
        by_q[:, diagonal, diagonal] += self.stiffness
        by_v[:, diagonal, diagonal] += self.damping
        force += self.rotors * a + self.damping * v + self.spring_force(q)
        loops = loop_equations(self.rows, frames)
        return Tangent(force, by_q, by_v, mass, frames, loops.residual, loops.jacobian)

    def tangent_at_rest(self, q: Array) -> Tangent:
        """Compute all terms and derivatives at one configuration q (nq,) at rest, T = 1."""
        rest = np.zeros((1, self.robot.nv))
        return self.tangent(q[None], rest, rest)

    def energy(self, q: Array, v: Array) -> Array:
        """Compute the sum (T,) [J] of kinetic, gravitational and elastic energy.

        Heights are above the base. Rotors add n^2 I v^2 / 2, springs K (q - rest)^2 / 2.
        """
        model, data = self.robot.model, self.scratch.data
        tree = [pin.computeMechanicalEnergy(model, data, *state) for state in zip(q, v, strict=True)]
        rotors = 0.5 * (v**2 @ self.robot.rotors)
        offset = difference(self.robot, self.robot.neutral, q) - self.robot.joint_rest
        springs = 0.5 * (offset**2 @ self.stiffness)
        return np.array(tree) + (rotors + springs)


def spring_forces(robot: ParallelRobot, stiffness: Array, rest: Array, q: Array) -> Array:
    """Compute the spring forces K (q - rest) (T, nv) at q (T, nq).

    K and `rest`, an offset from the neutral configuration, are (nv,) or (T, nv).
    """
    if not stiffness.any():
        return np.zeros((len(q), robot.nv))
    springs = stiffness * (difference(robot, robot.neutral, q) - rest)
    return forces_on_joints(robot, robot.neutral, q, springs)


def check_damping(damping: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    """Return the damping of joint rates as an array; 0 by default.

    Args:
        damping: one number, (nv,) numbers, or an array of `shape` [N m s/rad, N s/m].
        shape: largest shape allowed, which ends with nv.

    Raises:
        InvalidInput: the damping has another shape, or is negative or not finite somewhere.
    """
    if damping is None:
        return np.zeros(shape)
    try:
        dampings = np.asarray(damping, dtype=float)
    except (TypeError, ValueError):
        dampings = np.array(np.nan)  # refused below
    has_valid_shape = dampings.shape in ((), shape[-1:], shape)
    if not has_valid_shape or not np.all((dampings >= 0) & np.isfinite(dampings)):
        raise InvalidInput(
            f"damping: needs {' x '.join(map(str, shape))} numbers (or one for all), none negative, got "
            f"{damping!r}"
        )
    return dampings
