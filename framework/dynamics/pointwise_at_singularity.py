"""Pointwise dynamics on a Type 2 singularity: the limit of the torques, for a motion given to third order.

It serves `pointwise_dynamics` alone. The torques of a plan are series whose nodes avoid the singular instant
(`inverse_dynamics`).

At the singular instant M tau = w (see `forces`) is 0 = 0 along t_s if condition (8), t_s . W_p = 0, holds,
and has no solution if it does not. On both sides tau(t) = M(t)^-1 w(t) is one function with a removable
singularity. By l'Hopital its value depends on the time derivatives of M and w, and so, through w, on the jerk
of the platform, but on no higher derivative. Hence the motion

    x(t) = x + x' t + x" t^2 / 2 + x''' t^3 / 6

is followed on one short Chebyshev panel about the instant, with no node at the instant. The series of tau
gives the limit, as along a whole plan; how fast the coefficients fall is the certificate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import factorial

import numpy as np

from framework.arrays import Array
from framework.dynamics.forces import Forces, balanced_forces, tree_forces
from framework.dynamics.reactions import apply_wrenches
from framework.errors import NotAssembled, SingularPose
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack
from framework.kinematics.loop_matrices import type2_matrix
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.chebyshev import TimeGrid, coefficients, evaluate, tail
from framework.singularity.bordered_system import root_of_g
from framework.singularity.type2 import UNCROSSABLE, uncontrolled_motion
from framework.tolerances import CONDITION_RESIDUAL, RANK_LOST, TORQUE_TAIL

MAX_ROOT_OFFSET = 0.01  # of half a panel, from the singular pose to the root of g: a farther one is another
PANEL_NODES = 24  # an even number, so that none is at its middle
MAX_JOINT_TRAVEL = 0.05  # [rad, robot lengths] from the middle of the first panel to its ends
MAX_HALVINGS = 8  # of the panel, after which the torques count as not resolved
SIDE_OFFSET = 0.1  # of half a panel, where the motors must hold the robot again, in another assembly mode


def forces_through_singularity(
    robot: ParallelRobot,
    closed: ClosedStack,
    *,
    rates: tuple[Array, Array, Array],
    wrenches: Mapping[str, Array],
) -> Forces:
    """Compute joint torques (1, n_a) and spring forces (1, n_e) of a motion on a Type 2 singularity.

    Args:
        closed: the singular configuration, T = 1.
        rates: first, second and third time derivatives of the platform coordinates, each (n,).
        wrenches: of the world, (6,) by frame, constant in base axes.

    Raises:
        SingularPose: a singularity of another kind; condition (8) does not hold (`wrench` is then t_s . W_p);
            the motion does not cross the locus; the torques on both sides cannot be resolved.
    """
    place = f"{robot.name}: at {robot.place(closed.x[0])}"
    uncontrolled = uncontrolled_motion(robot, closed.linearised)
    if uncontrolled.kind != "type_2" or uncontrolled.corank > 1:
        several = f"a Type 2 singularity with {uncontrolled.corank} uncontrolled motions"
        reason = UNCROSSABLE.get(uncontrolled.kind, several)
        raise SingularPose(f"{place} the robot is in {reason}: its torque has no limit", platform=closed.x[0])
    singular = motion_at(robot, closed, rates[0][None], rates[1][None])
    half = _half_panel(robot, singular, rates[2])
    if not np.isfinite(half):
        raise SingularPose(
            f"{place} the motion stands still on a Type 2 singularity: a stop there can never be crossed",
            platform=closed.x[0],
        )

    def motion_beside(t: Array) -> Motion:
        return apply_wrenches(robot, _taylor_motion(robot, singular, closed.x, np.array(rates), t), wrenches)

    instant = _crossing_instant(robot, motion_beside, half, place, closed.x[0])
    crossing = motion_beside(np.array([instant]))
    _check_condition(robot, crossing, tree_forces(robot, crossing)[0], place)
    torques, least_tail = _interpolate_torques(robot, motion_beside, half)
    if torques is None:
        raise SingularPose(
            f"{place} the torques near the Type 2 singularity are not resolved (tail {least_tail:.2g}): "
            f"another singularity is very near",
            platform=closed.x[0],
        )
    return torques


def _taylor_motion(robot: ParallelRobot, singular: Motion, x: Array, rates: Array, t: Array) -> Motion:
    """Compute the motion at t (T,) from a singular one at x (1, n) with `rates` (3, n)."""
    powers = np.stack([t, t**2 / 2, t**3 / 6], axis=1)
    dx = rates[0] + powers[:, :2] @ rates[1:]
    ddx = rates[1] + powers[:, :1] @ rates[2:]
    steps = powers[:, :1] * singular.v + powers[:, 1:2] * singular.a
    guess = integrate(robot, np.repeat(singular.q, len(t), axis=0), steps)
    return motion_at(robot, close_loops(robot, x + powers @ rates, guess), dx, ddx)


def _interpolate_torques(
    robot: ParallelRobot, motion_beside: Callable[[Array], Motion], half: float
) -> tuple[Forces | None, float]:
    """Interpolate joint torques to t = 0 on panels of +-`half` [s] and less; return the least tail, too."""
    least = np.inf
    for _ in range(MAX_HALVINGS):
        grid = TimeGrid(np.array([-half, half]), PANEL_NODES)
        half *= 0.5
        try:
            motion = motion_beside(grid.times)
        except NotAssembled:
            continue  # a shorter motion stays within reach
        forces = balanced_forces(robot, motion.linearised, tree_forces(robot, motion))
        series = coefficients(np.concatenate(forces, axis=1))
        least = min(least, tail(series))
        if tail(series) <= TORQUE_TAIL:
            value = evaluate(np.zeros(1), series)
            return Forces(value[:, : robot.n_a], value[:, robot.n_a :]), least
    return None, least


def _half_panel(robot: ParallelRobot, motion: Motion, jerk: Array) -> float:
    """Return the time [s] in which no joint moves more than MAX_JOINT_TRAVEL; infinite at rest."""
    lengths = robot.platform_scale
    sizes = [motion.v[0] / robot.column_scale, motion.a[0] / robot.column_scale, jerk / lengths]
    if not np.any(sizes[0]):
        return float("inf")
    largest = [float(np.abs(size).max(initial=0.0)) for size in sizes]
    return min(
        (factorial(order) * MAX_JOINT_TRAVEL / size) ** (1 / order)
        for order, size in enumerate(largest, start=1)
        if size > 0
    )


def _crossing_instant(
    robot: ParallelRobot, motion_beside: Callable[[Array], Motion], half: float, place: str, x: Array
) -> float:
    """Find the instant [s] at which g vanishes, off zero by rounding of the pose."""
    if robot.n_a > robot.n:
        return 0.0  # g of redundant motors has a double root

    def matrices(t: Array) -> Array:
        return type2_matrix(robot, motion_beside(t).linearised)

    root = root_of_g(matrices, 0.0, low=-half, high=half)
    both_sides = matrices(np.array([-SIDE_OFFSET, SIDE_OFFSET]) * half)
    changes_sign = np.prod(np.linalg.slogdet(both_sides)[0]) < 0
    is_regular = np.linalg.svd(both_sides, compute_uv=False).min() > RANK_LOST
    is_at_root = root.converged and abs(root.place) <= MAX_ROOT_OFFSET * half
    if not (is_at_root and changes_sign and is_regular):
        raise SingularPose(
            f"{place} the motion does not cross the Type 2 singularity but runs along or touches it: torque "
            f"is then a limit that needs more than the jerk; plan the motion",
            platform=x,
        )
    return root.place


def _check_condition(robot: ParallelRobot, motion: Motion, forces: Array, place: str) -> None:
    """Refuse a motion (T = 1) that violates condition (8), with the forces (nv,) of its open tree."""
    uncontrolled = uncontrolled_motion(robot, motion.linearised)
    terms = forces * uncontrolled.motion
    # the terms of a motion without forces are rounding: compare with centripetal forces, too
    rate, escape = (float(np.abs(v / robot.column_scale).max()) for v in (motion.v, uncontrolled.motion))
    turning = robot.mass * robot.length**2 * rate**2 * escape
    size = max(float(np.abs(terms).sum()), turning)
    wrench = float(terms.sum())
    if abs(wrench) > CONDITION_RESIDUAL * size:
        unit = "N" if np.any(uncontrolled.twist[robot.translations]) else "N m"
        x = robot.platform.coordinates(motion.linearised.frames)[0]
        raise SingularPose(
            f"{place} the robot is in a Type 2 singularity and t_s . W_p = {wrench:.6g} {unit}, where "
            f"condition (8) asks for zero: no torque is large enough",
            platform=x,
            wrench=wrench,
        )
