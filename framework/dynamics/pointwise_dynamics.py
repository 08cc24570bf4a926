"""Motor torques of one instant for a prescribed motion, also on a Type 2 singularity.

The pose, rates and accelerations of the platform, and external wrenches are prescribed. Motor torques follow
from the independent loop equations (`forces`). Their record is `instant.Instant`.

At a Type 2 singularity the equation M tau = w of `balanced_forces` reads 0 = 0 along t_s if condition (8),
t_s . W_p = 0, holds, and has no solution otherwise. If the condition holds, tau(t) = M(t)^-1 w(t) has a
removable singularity. By l'Hopital's rule the limit depends on the first time derivatives of M and w, and so
on the jerk of the platform, but on no higher derivative. Hence the motion

    x(t) = x + x' t + x" t^2 / 2 + x''' t^3 / 6

is followed on one short Chebyshev panel around the instant, which is no node. The value of the series of tau
at this instant is the limit, and the decay of the coefficients is the certificate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import Forces, balanced_forces, tree_forces
from framework.dynamics.instant import (
    Instant,
    Wrenches,
    apply_wrenches,
    entry_of,
    instant_of,
    stack_rows,
    stack_wrenches,
)
from framework.dynamics.platform_wrench import motor_speeds
from framework.errors import SingularPose
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops, require_square
from framework.kinematics.linearised_loops import (
    ClosedStack,
    LinearisedLoops,
    assembled_at,
    find_near_type2,
    type2_matrix,
)
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.chebyshev import TimeGrid
from framework.singularity.type2 import UNCROSSABLE, Uncontrolled, uncontrolled_motion
from framework.tolerances import CONDITION_RESIDUAL, RANK_LOST, TORQUE_TAIL

PANEL_NODES = 24  # an even number, so that no node is in the middle
MAX_JOINT_TRAVEL = 0.02  # [rad, robot lengths] from the middle of the panel to either end


def dynamics_at(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None = None,
    ddx: ArrayLike | None = None,
    dddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> Instant:
    """Compute motor torques, loop forces, joint reactions and inertia at an assembled configuration q (nq,).

    Args:
        q: as returned by `assemble` or `forward_kinematics`; or a stack of T instants (T, nq), for which the
            first axis of all results is T.
        dx, ddx: rates (n,) and accelerations (n,) of the platform coordinates, 0 by default; or (T, n).
        wrenches: external wrenches by URDF link or joint: ON its body, at its origin, (force, moment) (6,) on
            base axes [N, N m]; or (T, 6). They are assumed constant.
        dddx: third derivatives (n,), or (T, n), used only on a Type 2 singularity.

    Raises:
        InvalidInput: q leaves the loops open; an argument has the wrong shape; a frame is unknown; the
            platform does not determine the joints.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
        SingularPose: the pose is singular of Type 2. There the torque is a limit. It is computed only if dddx
            is given, the motion crosses the locus, and condition (8) holds.
    """
    prescribed = prescribed_motion(robot, q, dx=dx, ddx=ddx, dddx=dddx, wrenches=wrenches)
    motion = prescribed.motion
    r = tree_forces(robot, motion)
    forces = balanced_forces(robot, motion.linearised, r)
    # replace the torques at Type 2, where the equations are singular, by their limits
    for k in map(int, find_near_type2(robot, motion.linearised)):
        if dddx is None:
            raise type2_pose(
                robot,
                prescribed.x[k],
                "is a limit there that needs the motion to third order; give dddx, or plan the motion",
            )
        limit = _forces_through_singularity(
            robot,
            ClosedStack(motion.q[[k]], prescribed.x[[k]], motion.linearised.select(k)),
            prescribed.rates[:, k],
            {frame: wrench[k] for frame, wrench in prescribed.wrenches.items()},
        )
        forces.joint_torque[k] = limit.joint_torque[0]
        forces.spring_force[k] = limit.spring_force[0]
    return instant_of(robot, motion, r, forces, prescribed.entry)


def motor_inertia(robot: ParallelRobot, q: Array) -> Array:
    """Compute the inertia (n_a,) [kg m^2, kg] that each motor moves by itself, motor side.

    Raises:
        InvalidInput, NotAssembled, SingularPose: as `dynamics_at` for q (nq,).
    """
    G, _rates = motor_speeds(robot, assembled_at(robot, q).linearised)
    twists = np.linalg.pinv(G[0])  # (n, n_a) of the platform, for unit motor speeds
    return np.diag(twists.T @ dynamics_at(robot, q).platform_inertia @ twists)


class PrescribedMotion(NamedTuple):
    """The prescribed motion at T instants, with external wrenches."""

    x: Array  # (T, n) platform coordinates
    rates: Array  # (3, T, n) their first, second and third time derivatives
    motion: Motion
    wrenches: Wrenches
    entry: int | slice  # index of results: 0 for one configuration, all for a stack


def prescribed_motion(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None,
    ddx: ArrayLike | None,
    dddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None,
) -> PrescribedMotion:
    """Check the arguments of `dynamics_at` and compute the prescribed motion.

    Args:
        q: assembled configuration (nq,), or a stack (T, nq).
        dx, ddx, dddx: time derivatives (n,) or (T, n) of the platform coordinates; None for 0.
        wrenches: external wrenches (6,) or (T, 6) [N, N m] by URDF link or joint, on base axes.

    Raises:
        InvalidInput, NotAssembled: as `dynamics_at`.
    """
    expect_robot(robot)
    require_square(robot)
    closed = assembled_at(robot, q, stacks=True)
    count = len(closed.q)
    zeros = np.zeros(robot.n)
    derivatives = {"dx": dx, "ddx": ddx, "dddx": dddx}
    rates = np.stack(
        [
            stack_rows(name, zeros if values is None else values, robot.n, count)
            for name, values in derivatives.items()
        ]
    )
    applied = stack_wrenches(robot, wrenches, count)
    motion = apply_wrenches(robot, motion_at(robot, closed, *rates[:2]), applied)
    return PrescribedMotion(closed.x, rates, motion, applied, entry_of(q))


def require_hold(robot: ParallelRobot, linearised: LinearisedLoops, x: Array) -> None:
    """Raise SingularPose if one of the platform's poses x (T, n) is singular of Type 2."""
    singular = find_near_type2(robot, linearised)
    if len(singular):
        raise type2_pose(robot, x[singular[0]], "and its derivatives have a pole there")


def type2_pose(robot: ParallelRobot, x: Array, torque: str) -> SingularPose:
    """Return the error for a pose x (n,) at Type 2; `torque` continues the message "torque ..."."""
    return SingularPose(
        f"{robot.name}: at {robot.place(x)} the motors do not hold the robot (Type 2): torque {torque}",
        platform=x,
    )


def _forces_through_singularity(
    robot: ParallelRobot, closed: ClosedStack, rates: Array, wrenches: Wrenches
) -> Forces:
    """Compute joint torques (1, n_a) and spring forces (1, n_e) of a motion on a Type 2 singularity.

    The torques beside the singularity are regular, and their interpolation at t = 0 is the limit.

    Args:
        closed: the singular configuration, T = 1.
        rates: first, second and third time derivatives (3, n) of the platform coordinates.
        wrenches: external wrenches (6,) by frame, constant on base axes.

    Raises:
        SingularPose: a singularity of another kind; condition (8) does not hold (`wrench` is then t_s . W_p);
            the motion does not cross the locus; the torques on both sides cannot be resolved.
    """
    dx, ddx, _ = rates
    singular = apply_wrenches(robot, motion_at(robot, closed, dx[None], ddx[None]), wrenches)
    motion = _TaylorMotion(robot, closed.x, singular, rates, wrenches)
    uncontrolled = uncontrolled_motion(robot, closed.linearised)
    if uncontrolled.kind != "type_2" or uncontrolled.corank > 1:
        several = f"a Type 2 singularity with {uncontrolled.corank} uncontrolled motions"
        reason = UNCROSSABLE.get(uncontrolled.kind, several)
        raise motion.make_error(f"the robot is in {reason}: its torque has no limit")
    if not singular.v.any():
        raise motion.make_error(
            "the motion stands still on a Type 2 singularity: no law can rest on the locus"
        )
    half_panel = motion.choose_half_panel()
    grid = TimeGrid(np.array([-half_panel, half_panel]), PANEL_NODES)
    beside = motion.evaluate(grid.times)
    motion.check_crossing(beside)
    motion.check_condition(uncontrolled)
    return motion.interpolate_forces(grid, beside)


class _TaylorMotion(NamedTuple):
    """A motion through a singular configuration at t = 0, by a Taylor polynomial of third order of x."""

    robot: ParallelRobot
    x: Array  # (1, n) platform coordinates at t = 0
    singular: Motion  # at t = 0
    rates: Array  # (3, n) first, second and third time derivatives of x at t = 0
    wrenches: Wrenches  # (6,) by frame, constant on base axes

    def make_error(self, reason: str, wrench: float | None = None) -> SingularPose:
        """Return the error for the singular pose at t = 0.

        Args:
            reason: why there is no torque; ends the message.
            wrench: t_s . W_p [N or N m] if condition (8) is violated.
        """
        x = self.x[0]
        return SingularPose(
            f"{self.robot.name}: at {self.robot.place(x)} {reason}", platform=x, wrench=wrench
        )

    def evaluate(self, times: Array) -> Motion:
        """Compute the motion at instants (T,) [s].

        The loops are closed from a guess of second order for all joints.
        """
        rate, acceleration, jerk = self.rates
        t = times[:, None]
        dx = rate + t * acceleration + t**2 / 2 * jerk
        ddx = acceleration + t * jerk
        displacement = t * rate + t**2 / 2 * acceleration + t**3 / 6 * jerk
        joint_steps = t * self.singular.v + t**2 / 2 * self.singular.a
        guess = integrate(self.robot, np.repeat(self.singular.q, len(t), axis=0), joint_steps)
        closed = close_loops(self.robot, self.x + displacement, guess)
        return apply_wrenches(self.robot, motion_at(self.robot, closed, dx, ddx), self.wrenches)

    def choose_half_panel(self) -> float:
        """Return the time t [s] in which no joint moves more than MAX_JOINT_TRAVEL.

        Each of |v| t, |a| t^2/2 and |jerk| t^3/6 is at most that travel. The jerk of the joints is not known,
        so that of the platform stands for it. Term k gives t = (k! travel / largest derivative)^(1/k).
        """
        scale = self.robot.column_scale
        jerk = self.rates[2] / self.robot.platform_scale
        derivatives = (self.singular.v / scale, self.singular.a / scale, jerk)
        largest = np.array([np.abs(values).max() for values in derivatives])
        orders = np.arange(1, len(derivatives) + 1)
        factorials = np.cumprod(orders)
        with np.errstate(divide="ignore"):  # a derivative that is zero does not limit t
            return float(np.min((factorials * MAX_JOINT_TRAVEL / largest) ** (1 / orders)))

    def check_crossing(self, beside: Motion) -> None:
        """Raise SingularPose unless the motion passes from one side of the locus to the other.

        With redundant motors g has a double root at the locus, without a change of sign, and is not checked.

        Args:
            beside: the motion at ascending instants, from before to after t = 0.
        """
        robot = self.robot
        if robot.n_a > robot.n:
            return
        both_ends = type2_matrix(robot, beside.linearised)[[0, -1]]
        signs, _log_sizes = np.linalg.slogdet(both_ends)  # the determinant is a measure g, up to a factor
        is_regular = np.linalg.svd(both_ends, compute_uv=False).min() > RANK_LOST
        if np.prod(signs) > 0 or not is_regular:
            raise self.make_error(
                "the motion does not cross the Type 2 singularity but runs along or touches it: torque is "
                "then a limit that needs more than the jerk; plan the motion"
            )

    def check_condition(self, uncontrolled: Uncontrolled) -> None:
        """Raise SingularPose if the motion violates condition (8) at t = 0.

        With the inertia of all bodies, condition (8), t_s . W_p = 0, reads eta . r = 0. eta are the joint
        rates of the uncontrolled motion, whose platform twist t_s has unit size, and r the forces of the open
        tree. eta . r is therefore a force, or a moment if the platform only turns.
        """
        robot = self.robot
        (r,) = tree_forces(robot, self.singular)  # of the one instant
        terms = r * uncontrolled.motion  # (nv,), whose sum is eta . r
        rate = np.abs(self.singular.v / robot.column_scale).max()
        escape_rate = np.abs(uncontrolled.motion / robot.column_scale).max()
        # if all terms are rounding, their scale is the centripetal force of the robot's mass at its length
        centripetal = robot.mass * robot.length**2 * rate**2 * escape_rate
        scale = max(np.abs(terms).sum(), centripetal)
        wrench = float(terms.sum())
        if abs(wrench) > CONDITION_RESIDUAL * scale:
            unit = "N" if np.any(uncontrolled.twist[robot.translations]) else "N m"
            raise self.make_error(
                f"the robot is in a Type 2 singularity and t_s . W_p = {wrench:.6g} {unit}, where condition "
                f"(8) asks for zero: no torque is large enough",
                wrench,
            )

    def interpolate_forces(self, grid: TimeGrid, beside: Motion) -> Forces:
        """Interpolate joint torques (1, n_a) and spring forces (1, n_e) at t = 0.

        Args:
            grid: nodes on both sides of t = 0, none of them at t = 0.
            beside: the motion at these nodes.

        Raises:
            SingularPose: the series of the forces is not resolved.
        """
        robot = self.robot
        forces = balanced_forces(robot, beside.linearised, tree_forces(robot, beside))
        function = grid.fit(np.concatenate(forces, axis=1))
        if function.tail > TORQUE_TAIL:
            raise self.make_error(
                f"the torques near the Type 2 singularity are not resolved (tail {function.tail:.2g}): "
                f"another singularity is very near"
            )
        value = function(np.zeros(1))
        return Forces(joint_torque=value[:, : robot.n_a], spring_force=value[:, robot.n_a :])
