"""Once from deflections to the forces that they meet, and to the deflections that these cause."""

from __future__ import annotations

from typing import NamedTuple

from framework.arrays import Array
from framework.dynamics.forces import Forces, joint_forces
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import integrate, integrate_columns
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import Motion, joint_rates, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.chebyshev import TimeFunction, TimeGrid
from framework.motion.law import MotionLaw, law_derivatives
from framework.motion.path import time_derivatives


class Pass(NamedTuple):
    """The motion on the nodes with the deflections `function`, and what it causes."""

    law: MotionLaw
    function: TimeFunction  # (n_e)
    q_e: Array  # (T, n_e) its values
    motion: Motion
    forces: Forces
    caused: Array  # (T, n_e) deflections that the forces cause

    @property
    def residual(self) -> Array:
        """What the deflections lack (T, n_e) to be those that their forces cause."""
        return self.caused - self.q_e


def one_pass(
    branch: Branch, grid: TimeGrid, law: MotionLaw, function: TimeFunction, before: Pass | None
) -> Pass:
    """The pass with these deflections; `before` is one near it, if any.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    q_e, motion = moving(branch, grid, law, function, before)
    forces = joint_forces(branch.robot, motion)
    caused = -forces.spring_force / branch.robot.stiffness  # Eq. (3b) with linear springs
    return Pass(law, function, q_e, motion, forces, caused)


def moving(
    branch: Branch, grid: TimeGrid, law: MotionLaw, function: TimeFunction, before: Pass | None
) -> tuple[Array, Motion]:
    """Deflections (T, n_e) and all coordinates at the nodes."""
    values = grid.values(function)
    return values[0], moving_with(branch, grid.times, law, values, before)


def moving_with(
    branch: Branch,
    times: Array,
    law: MotionLaw,
    deflections: tuple[Array, Array, Array],
    before: Pass | None = None,
) -> Motion:
    """Compute all coordinates at instants (T,) for deflections (T, n_e) and their two time derivatives."""
    robot, (q_e, *rates) = branch.robot, deflections
    s = law_derivatives(law, times)
    x, dx, ddx = time_derivatives(branch.path, s)
    if before is None:
        near = integrate_columns(robot, branch.guess(s[0]), robot.elastic, q_e)
    else:  # along the tangent, by the factors that are there already
        linearised = before.motion.linearised
        ahead = -robot.platform.residual(linearised.frames, x)
        near = integrate(robot, before.motion.q, joint_rates(robot, linearised, ahead, q_e - before.q_e))
    closed = close_loops(robot, x, near)
    return branch.load_motion(motion_at(robot, closed, dx, ddx, *rates), s[0])


def spring_scale(robot: ParallelRobot) -> Array:
    """Length of the robot for springs that stretch, 1 for those that turn (n_e,)."""
    return robot.column_scale[robot.elastic]
