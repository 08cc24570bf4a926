"""The equations of motion of a robot with closed loops, in all its coordinates, for a stack of states.

    M(q) dv/dt + c(q, v) + g(q) + K (q - rest) + D v + s(q, v) = S' n tau + J(q)' lambda,        F(q) = 0

* M: inertia with armature and rotors, n^2 I_a on the actuated columns;
* K: the springs of the robot file and those on joints of the URDF;
* D: the viscous damping of the joints and what the caller adds;
* s: springs and dampers between two points (`kinematics.line_springs`);
* n tau: the motor torques on the joint side;
* F, J: the R loop equations and their Jacobian of rank m. R = m unless no m fixed rows suffice in all poses;
  then lambda is the shortest of all that have the same forces.

The equations are regular at a Type 2 singularity: the passive columns of J lose rank there, but J does not.
Pinocchio is called once for each state; all other computations treat the whole stack.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, real_numbers
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import (
    FrameStack,
    difference,
    forces_on_joints,
    frames_at,
    scratch_of,
)
from framework.kinematics.inverse_kinematics import require_joints_close
from framework.kinematics.line_springs import Lines, lines_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, ArrayLike
from framework.tolerances import EIGENVALUE_ROUNDING


class State(NamedTuple):
    """Configuration q (nq,) and velocity v (nv,) of a robot, or (R, nq) and (R, nv) of R robots."""

    q: Array
    v: Array


def stack_states(states: Sequence[State]) -> State:
    """Return K states (nq,), (nv,) as one stack (K, nq), (K, nv)."""
    q, v = zip(*states, strict=True)
    return State(np.array(q), np.array(v))


class Tangent(NamedTuple):
    """The equations linearised at T states: left side with derivatives, and the R loop equations."""

    force: Array  # (T, nv) M a + c + g + K (q - rest) + D v + s [N m, N]
    by_q: Array  # (T, nv, nv) derivatives of the force by tangent steps of q
    by_v: Array  # (T, nv, nv) derivatives of the force by v
    mass: Array  # (T, nv, nv) M, with rotors
    frames: FrameStack
    residual: Array  # (T, R) F [m, rad]
    jacobian: Array  # (T, R, nv) J


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """A robot prepared for simulation, without dry friction."""

    robot: ParallelRobot
    damping: Array  # (nv,) [N m s/rad, N s/m] of every joint rate
    rows: LoopRows  # of the R loop equations that suffice in all poses
    rotors: Array  # (nv,) inertia [kg m^2, kg], joint side; 1 on idle joints without mass
    stiffness: Array  # (nv,) [N m/rad, N/m]

    @staticmethod
    def of(robot: ParallelRobot, damping: ArrayLike | None = None) -> EquationsOfMotion:
        """Return the equations of motion of a robot.

        Args:
            damping: viscous damping added to that of the joints, one number or (nv,) [N m s/rad, N s/m].

        Raises:
            InvalidInput: damping of the wrong length or negative; loops that only springs can close.
            NotAssembled: the loops do not close at the reference.
        """
        added = check_damping(damping, (robot.nv,))  # one number or (nv,)
        require_joints_close(robot)
        equations = EquationsOfMotion(
            robot=robot,
            damping=added + robot.joint_damping,
            rows=robot.spanning_loops,
            rotors=robot.rotors,
            stiffness=robot.all_stiffness,
        )
        idle = robot.structure.idle  # columns of the velocity vector
        if not len(idle):
            return equations
        # unit inertia on idle joints without mass: no force acts on such a joint, so any inertia makes its
        # equation solvable and changes nothing else
        inertias = np.diag(equations.tangent_at_rest(robot.q_near).mass[0])  # (nv,)
        massless = idle[inertias[idle] <= EIGENVALUE_ROUNDING * inertias.max()]
        rotors = robot.rotors.copy()
        rotors[massless] = 1.0
        return replace(equations, rotors=rotors)

    @property
    def rank(self) -> int:
        """Number m of loop equations that are independent in a regular pose."""
        return len(self.robot.structure.independent)

    def motor_forces(self, torque: Array) -> Array:
        """Compute generalised forces S' n tau (T, nv) of motor torques tau (T, n_a) [N m], motor side."""
        force = np.zeros((len(torque), self.robot.nv))
        force[:, self.robot.actuated] = self.robot.gear_ratio * torque
        return force

    def tangent(self, q: Array, v: Array, a: Array) -> Tangent:
        """Linearise the equations at q (T, nq), v (T, nv) and a (T, nv).

        For the tree without loops pinocchio computes the frames, M a + c + g with its derivatives, and M.
        Rotors, springs and dampers are added here.

        Returns:
            The left side with its derivatives by q, v and a, and the loop equations.
        """
        data = scratch_of(self.robot).data
        T, nv = v.shape
        force = np.empty((T, nv))
        by_q, by_v, mass = np.empty((3, T, nv, nv))
        for k, state in enumerate(zip(q, v, a, strict=True)):
            pin.computeRNEADerivatives(self.robot.model, data, *state)
            force[k] = data.tau
            by_q[k] = data.dtau_dq
            by_v[k] = data.dtau_dv
            mass[k] = data.M
        frames = frames_at(self.robot, q)
        # rotors, springs and dampers act on single joints, so their matrices are diagonal
        diagonal = range(nv)
        mass[:, diagonal, diagonal] += self.rotors
        by_q[:, diagonal, diagonal] += self.stiffness
        by_v[:, diagonal, diagonal] += self.damping
        springs = spring_forces(self.robot, self.stiffness, self.robot.joint_rest, q)
        force += self.rotors * a + self.damping * v + springs
        if self.robot.line_springs.names:
            lines = Lines.of(self.robot, frames)
            force += lines.forces(v)
            by_q += lines.force_slope(v)
            by_v += lines.damping
        loops = loop_equations(self.rows, frames)
        return Tangent(force, by_q, by_v, mass, frames, loops.residual, loops.jacobian)

    def tangent_at_rest(self, q: Array) -> Tangent:
        """Linearise the equations at one configuration q (nq,) without motion, T = 1."""
        rest = np.zeros((1, self.robot.nv))
        return self.tangent(q[None], rest, rest)

    def energy(self, q: Array, v: Array) -> Array:
        """Compute the sum (T,) [J] of kinetic, gravitational and elastic energy at q (T, nq), v (T, nv).

        Heights are above the base. Rotors add n^2 I v^2 / 2, springs K (q - rest)^2 / 2.
        """
        model = self.robot.model
        data = scratch_of(self.robot).data
        tree = [pin.computeMechanicalEnergy(model, data, *state) for state in zip(q, v, strict=True)]
        rotors = 0.5 * (v**2 @ self.robot.rotors)
        deflection = difference(self.robot, self.robot.neutral, q) - self.robot.joint_rest  # (T, nv)
        springs = 0.5 * (deflection**2 @ self.stiffness)
        if self.robot.line_springs.names:
            springs += lines_at(self.robot, q).energy
        return np.array(tree) + (rotors + springs)

    def dissipated_power(self, q: Array, v: Array) -> Array:
        """Compute the power (T,) [W] that dampers dissipate at q (T, nq) and v (T, nv)."""
        power: Array = v**2 @ self.damping
        if self.robot.line_springs.names:
            power += np.vecdot(lines_at(self.robot, q).damping_forces(v), v)
        return power


def singular_vectors(jacobian: Array, m: int) -> tuple[Array, Array, Array]:
    """Decompose J (T, R, nv) of rank m: U (T, R, m), values (T, m), all right vectors in rows (T, nv, nv).

    Rounding and open loops add to the rank of R > m rows. The m largest singular values are those of J.
    """
    U, values, V_rows = np.linalg.svd(jacobian)
    return U[:, :, :m], values[:, :m], V_rows


def spring_forces(robot: ParallelRobot, stiffness: Array, rest: Array, q: Array) -> Array:
    """Compute the spring forces K (q - rest) (T, nv) at q (T, nq).

    Args:
        stiffness: K, (nv,) or (T, nv) [N m/rad, N/m].
        rest: rest position of the springs as an offset from the neutral configuration, (nv,) or (T, nv).
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
        dampings = real_numbers("damping", damping)
    except InvalidInput:
        dampings = np.array(np.nan)  # refused below
    has_valid_shape = dampings.shape in ((), shape[-1:], shape)
    if not has_valid_shape or not np.all((dampings >= 0) & np.isfinite(dampings)):
        raise InvalidInput(
            f"damping: needs {' x '.join(map(str, shape))} numbers (or one for all), none negative, got "
            f"{damping!r}"
        )
    return dampings
