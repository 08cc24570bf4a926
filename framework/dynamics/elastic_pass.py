"""One pass of the fixed-point iteration: from deflections to forces to the deflections caused by these.

q_e are the deflections of the springs, x the platform coordinates on the path, s(t) the law.
"""

from __future__ import annotations

from typing import NamedTuple

from framework.dynamics.forces import Forces, joint_forces
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import integrate, integrate_columns
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import Motion, joint_rates, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw, law_derivatives
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid


class Pass(NamedTuple):
    """A motion with deflections on the time nodes, its forces, and the deflections caused."""

    law: MotionLaw
    deflections: TimeFunction  # (n_e) [rad, m] of the motion
    q_e: Array  # (T, n_e) their values at the nodes
    motion: Motion
    forces: Forces
    caused: Array  # (T, n_e) deflections that the forces cause

    @property
    def residual(self) -> Array:
        """The caused deflections minus the deflections of the motion (T, n_e); zero in balance."""
        return self.caused - self.q_e


def evaluate_pass(
    branch: Branch, grid: TimeGrid, law: MotionLaw, deflections: TimeFunction, neighbour: Pass | None
) -> Pass:
    """Compute motion and forces with given deflections, and the caused deflections -force/K.

    Args:
        deflections: deflections (n_e) as a function of time.
        neighbour: a pass with similar deflections, from whose configurations the loops are closed; None to
            close the loops from the branch.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    q_e, motion = evaluate_deflected_motion(branch, grid, law, deflections, neighbour)
    forces = joint_forces(branch.robot, motion)
    caused = -forces.spring_force / branch.robot.stiffness  # Eq. (3b) with linear springs
    return Pass(law, deflections, q_e, motion, forces, caused)


def evaluate_deflected_motion(
    branch: Branch, grid: TimeGrid, law: MotionLaw, deflections: TimeFunction, neighbour: Pass | None
) -> tuple[Array, Motion]:
    """Compute deflections (T, n_e) and the motion of all joints at the nodes of the grid.

    Args:
        branch: configurations along the path, springs at rest.
        grid: T nodes in time.
        deflections: deflections (n_e) as a function of time.
        neighbour: a pass on the same grid with similar deflections, if available.
    """
    at_nodes = grid.values(deflections)  # the deflections and two time derivatives, (T, n_e) each
    return at_nodes[0], motion_with_deflections(branch, grid.times, law, at_nodes, neighbour)


def motion_with_deflections(
    branch: Branch,
    times: Array,
    law: MotionLaw,
    deflections: tuple[Array, Array, Array],
    neighbour: Pass | None = None,
) -> Motion:
    """Compute the motion of all joints at instants (T,) with given deflections.

    The loops are closed by Newton's method from a guess: the branch's configurations with the springs
    deflected or, nearer, one step along the tangent from a neighbour.

    Args:
        branch: configurations along the path, springs at rest.
        times: instants [s].
        deflections: values, first and second time derivatives, each (T, n_e).
        neighbour: a pass at the same instants with similar deflections; None without one.
    """
    robot = branch.robot
    q_e, *deflection_rates = deflections
    s_and_rates = law_derivatives(law, times)  # s and two time derivatives, (T,) each
    x, dx, ddx = time_derivatives(branch.path, s_and_rates)
    if neighbour is None:
        guess = integrate_columns(robot, branch.guess(s_and_rates[0]), robot.elastic, q_e)
    else:  # the neighbour's loop equations are already factored, so a step along the tangent is cheap
        linearised = neighbour.motion.linearised
        # (T, n) twist from the neighbour's pose to x
        platform_step = -robot.platform.residual(linearised.frames, x)
        step = joint_rates(robot, linearised, platform_step, q_e - neighbour.q_e)
        guess = integrate(robot, neighbour.motion.q, step)
    closed = close_loops(robot, x, guess)
    # the motion, under the external wrenches at these s
    return branch.load_motion(motion_at(robot, closed, dx, ddx, *deflection_rates), s_and_rates[0])


def spring_scale(robot: ParallelRobot) -> Array:
    """Return scales (n_e,): the robot's length for springs that stretch, 1 for springs that turn."""
    return robot.column_scale[robot.elastic]
