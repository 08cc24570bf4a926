"""Motor torques of one instant for a prescribed motion, also on a Type 2 singularity, and their derivatives.

The pose, rates and accelerations of the platform, and external wrenches are prescribed. Motor torques follow
from the independent loop equations (`forces`). Their record is `instant.Instant`.

At a Type 2 singularity the motors do not control the platform's twist t_s, along which the motion requires
the force t_s . W_p. The equation M tau = w of `balanced_forces` then reads 0 = 0 along t_s if condition (8),
t_s . W_p = 0, holds, and has no solution otherwise. If the condition holds, tau(t) = M(t)^-1 w(t) has a
removable singularity. By l'Hopital's rule the limit depends on the first time derivatives of M and w, and so
on the jerk of the platform, but on no higher derivative. Hence the motion

    x(t) = x + x' t + x" t^2 / 2 + x''' t^3 / 6

is followed on one short Chebyshev panel around the instant, which is no node. The value of the series of tau
at this instant is the limit, and the decay of the coefficients is the certificate.

Derivatives vary the motion and keep the loops closed. T = dq/dx' are the joint rates for unit rates of the
platform's coordinates x. G = n T_a are the motors' speeds for these rates, with the gear ratio n. r are the
forces of the open tree, J is the Jacobian of the loop equations and lambda are the loop forces (`forces`).
The motor torques t solve G' t = T' (r + rotors), and their changes solve

    G' dt = T' d(r + rotors - J' lambda)          at fixed lambda.

The right side needs the change of the forces (`forces.driven_force_changes`) along the change of the joints'
motion (`coordinate_changes`). G' is singular at Type 2. With redundant motors the part of t that drives
bodies is the solution of least norm, t = G k with k (n,), and dt = dG k + G dk.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.dynamics.body_parameters import body_parameters, tree_regressor
from framework.dynamics.forces import (
    Forces,
    balanced_forces,
    driven_force_changes,
    least_motor_torques,
    motor_torque,
    tree_forces,
)
from framework.dynamics.instant import (
    Instant,
    Wrenches,
    apply_wrenches,
    entry_of,
    instant_of,
    stack_rows,
    stack_wrenches,
)
from framework.errors import NotAssembled, SingularPose
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops, require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    assembled_at,
    find_near_type2,
    type2_matrix,
)
from framework.kinematics.motion_rates import (
    Motion,
    coordinate_changes,
    motion_at,
    motor_speeds,
    require_turns_at_rest,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import PANEL_NODES, TimeGrid, coefficients, evaluate, tail
from framework.numerics.ordered_sums import matvec
from framework.singularity.bordered_system import root_of_g
from framework.singularity.type2 import UNCROSSABLE, uncontrolled_motion
from framework.tolerances import CONDITION_RESIDUAL, RANK_LOST, TORQUE_TAIL


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
            is given, the motion crosses the locus, and condition (8), t_s . W_p = 0, holds.
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
            motion.linearised.select(k),
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
    G, _rates = motor_speeds(robot, assembled_at(robot, q))
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
    require_square(robot)
    closed = assembled_at(robot, q, stacks=True)
    count = len(closed.q)
    rates = np.zeros((3, count, robot.n))
    for k, (name, values) in enumerate((("dx", dx), ("ddx", ddx), ("dddx", dddx))):
        if values is not None:
            rates[k] = stack_rows(name, values, robot.n, count)
    applied = stack_wrenches(robot, wrenches, count)
    motion = apply_wrenches(robot, motion_at(robot, closed, *rates[:2]), applied)
    return PrescribedMotion(closed.x, rates, motion, applied, entry_of(q))


def type2_pose(robot: ParallelRobot, x: Array, torque: str) -> SingularPose:
    """Return the error for a pose x (n,) at Type 2; `torque` continues the message "torque ..."."""
    return SingularPose(
        f"at {robot.place(x)} the motors do not hold the robot (Type 2): torque {torque}",
        name=robot.name,
        platform=x,
    )


def _forces_through_singularity(
    robot: ParallelRobot, closed: LinearisedLoops, rates: Array, wrenches: Wrenches
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
    singular = motion_at(robot, closed, dx[None], ddx[None])
    motion = _TaylorMotion(robot, closed.x, singular, rates, wrenches)
    uncontrolled = uncontrolled_motion(robot, closed)
    if uncontrolled.kind != "type_2" or uncontrolled.corank > 1:
        several = f"a Type 2 singularity with {uncontrolled.corank} uncontrolled motions"
        reason = UNCROSSABLE.get(uncontrolled.kind, several)
        raise motion.make_error(f"the robot is in {reason}: its torque has no limit")
    if not singular.v.any():
        raise motion.make_error(
            "the motion stands still on a Type 2 singularity: no law can rest on the locus"
        )
    half_panel = motion.choose_half_panel()
    motion.check_condition(motion.find_crossing(half_panel))
    return motion.interpolate_forces(half_panel)


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
            f"at {self.robot.place(x)} {reason}", name=self.robot.name, platform=x, wrench=wrench
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

    def type2_matrices(self, times: Array) -> Array:
        """Compute the Type 2 matrices (T, n, n) at instants (T,) [s]."""
        return type2_matrix(self.robot, self.evaluate(times).linearised)

    def choose_half_panel(self) -> float:
        """Return the time t [s] in which no joint moves more than its travel [rad, robot lengths].

        Each of |v| t, |a| t^2/2 and |jerk| t^3/6 is at most that travel. The jerk of the joints is not known,
        so that of the platform stands for it. Term k gives t = (k! travel / largest derivative)^(1/k).
        """
        max_joint_travel = 0.05  # [rad, robot lengths] from the middle of the panel to either end
        scale = self.robot.column_scale
        jerk = self.rates[2] / self.robot.platform_scale
        derivatives = (self.singular.v / scale, self.singular.a / scale, jerk)
        largest = np.array([np.abs(values).max() for values in derivatives])
        orders = np.arange(1, len(derivatives) + 1)
        factorials = np.cumprod(orders)
        with np.errstate(divide="ignore"):  # a derivative that is zero does not limit t
            return float(np.min((factorials * max_joint_travel / largest) ** (1 / orders)))

    def find_crossing(self, half_panel: float) -> float:
        """Find the instant [s] at which g is zero, which is t = 0 up to rounding of the pose.

        Args:
            half_panel: half the width [s] of the panel on which the instant is sought.

        Raises:
            SingularPose: g does not change sign there, or the motors do not hold the robot on both sides.
        """
        # of half a panel: a root of g farther from the instant is another singularity
        max_root_offset = 0.01
        # of half a panel: offset to both sides at which the motors must hold the robot
        side_offset = 0.1
        if self.robot.n_a > self.robot.n:
            return 0.0  # with redundant motors g has a double root, without a change of sign
        root, converged = root_of_g(self.type2_matrices, 0.0, low=-half_panel, high=half_panel)
        both_sides = self.type2_matrices(np.array([-side_offset, side_offset]) * half_panel)
        signs, _log_sizes = np.linalg.slogdet(both_sides)  # the determinant is a measure g, up to a factor
        changes_sign = np.prod(signs) < 0
        is_regular = np.linalg.svd(both_sides, compute_uv=False).min() > RANK_LOST
        is_at_root = converged and abs(root) <= max_root_offset * half_panel
        if is_at_root and changes_sign and is_regular:
            return root
        raise self.make_error(
            "the motion does not cross the Type 2 singularity but runs along or touches it: torque is then a "
            "limit that needs more than the jerk; plan the motion"
        )

    def check_condition(self, instant: float) -> None:
        """Raise SingularPose if the motion violates condition (8) at an instant [s].

        With the inertia of all bodies, condition (8), t_s . W_p = 0, reads eta . r = 0. eta are the joint
        rates of the uncontrolled motion, whose platform twist t_s has unit size, and r the forces of the open
        tree. eta . r is therefore a force, or a moment if the platform only turns.
        """
        robot = self.robot
        motion = self.evaluate(np.array([instant]))
        uncontrolled = uncontrolled_motion(robot, motion.linearised)
        (r,) = tree_forces(robot, motion)  # of the one instant
        terms = r * uncontrolled.motion  # (nv,), whose sum is eta . r
        rate = np.abs(motion.v / robot.column_scale).max()
        largest_eta = np.abs(uncontrolled.motion / robot.column_scale).max()
        # if all terms are rounding, their scale is the centripetal force of the robot's mass at its length
        centripetal = robot.mass * robot.length**2 * rate**2 * largest_eta
        scale = max(np.abs(terms).sum(), centripetal)
        wrench = float(terms.sum())
        if abs(wrench) > CONDITION_RESIDUAL * scale:
            unit = "N" if np.any(uncontrolled.twist[robot.translations]) else "N m"
            raise self.make_error(
                f"the robot is in a Type 2 singularity and t_s . W_p = {wrench:.6g} {unit}, where condition "
                f"(8) asks for zero: no torque is large enough",
                wrench,
            )

    def interpolate_forces(self, half_panel: float) -> Forces:
        """Interpolate joint torques (1, n_a) and spring forces (1, n_e) at t = 0.

        The panel from -half_panel to half_panel [s] is halved until the series of the forces is resolved.

        Raises:
            SingularPose: the series is not resolved.
        """
        max_halvings = 8
        robot = self.robot
        least_tail = np.inf
        for halvings in range(max_halvings):
            edges = np.array([-half_panel, half_panel]) / 2**halvings
            try:
                motion = self.evaluate(TimeGrid(edges, PANEL_NODES).times)
            except NotAssembled:
                continue  # a shorter motion may stay within reach
            forces = balanced_forces(robot, motion.linearised, tree_forces(robot, motion))
            series = coefficients(np.concatenate(forces, axis=1))
            least_tail = min(least_tail, tail(series))
            if tail(series) <= TORQUE_TAIL:
                value = evaluate(np.zeros(1), series)  # in the middle of the panel
                return Forces(value[:, : robot.n_a], value[:, robot.n_a :])
        raise self.make_error(
            f"the torques near the Type 2 singularity are not resolved (tail {least_tail:.2g}): another "
            f"singularity is very near"
        )


# ------------------------------------------------------------------ derivatives


@dataclass(frozen=True, eq=False)
class DynamicsDerivatives(ReadOnlyArrays):
    """Motor torques at one instant and their derivatives; at T instants, T is the first axis of all arrays.

    Torques are on the motor side, with rotors, armature, and damping and springs of joints. Each derivative
    varies one of the platform's coordinates x, their rates and their accelerations, and keeps the others.
    """

    torque: Array  # (n_a,) [N m, N] as `dynamics_at` gives it
    torque_x: Array  # (n_a, n) per m, rad
    torque_dx: Array  # (n_a, n) per m/s, rad/s
    torque_ddx: Array  # (n_a, n) per m/s2, rad/s2
    _robot: ParallelRobot = field(repr=False)
    _motion: Motion = field(repr=False)  # of T instants, T = 1 for one

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the p inertial parameters of all bodies, such as LINK.mass."""
        return body_parameters(self._robot)[0]

    @cached_property
    def regressor(self) -> Array:
        """The derivatives (n_a, p) of the torques by the parameters, computed on first use."""
        G, rates = motor_speeds(self._robot, self._motion.linearised)
        # (T, n, p) wrenches on the platform for unit parameters, (dq/dv)' Y
        wrenches = rates.swapaxes(1, 2) @ tree_regressor(self._robot, self._motion)
        stack = least_motor_torques(self._robot, G.swapaxes(1, 2), wrenches)
        return read_only(stack if self.torque.ndim == 2 else stack[0])


def dynamics_derivatives(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None = None,
    ddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> DynamicsDerivatives:
    """Compute the derivatives of the torques of `dynamics_at` at an assembled configuration q (nq,).

    When x varies, all joints follow with closed loops. An elastic robot keeps the deflections of q, as in
    `dynamics_at`. External wrenches keep their components on base axes and move with their frames.

    Args:
        q: assembled configuration, as returned by `assemble`; or a stack of T instants (T, nq).
        dx, ddx: rates (n,) and accelerations (n,) of the platform coordinates, 0 by default; or (T, n).
        wrenches: external wrenches (6,) or (T, 6) [N, N m] by URDF link or joint, (force, moment) ON
            its body at its origin, on base axes.

    Raises:
        InvalidInput: as `dynamics_at`; or damping or armature of balls drives an idle turn.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
        SingularPose: the pose is singular of Type 2, where torques and their derivatives have a pole;
            `forward_derivatives` is regular there.
    """
    prescribed = prescribed_motion(robot, q, dx=dx, ddx=ddx, wrenches=wrenches)
    require_turns_at_rest(robot)
    motion = prescribed.motion
    singular = find_near_type2(robot, motion.linearised)
    if len(singular):
        raise type2_pose(robot, prescribed.x[singular[0]], "and its derivatives have a pole there")
    rate, acceleration, _ = prescribed.rates
    changes = coordinate_changes(robot, motion, robot.structure.idle, (prescribed.x, rate, acceleration))
    motions = changes.q[:, : robot.n]  # (T, n, nv) T', joint rates for unit rates of x
    speeds = robot.gear_ratio * motions[..., robot.actuated]  # (T, n, n_a) G'
    r = tree_forces(robot, motion)
    joint_torque = balanced_forces(robot, motion.linearised, r).joint_torque

    # slopes (3, T, n_a, k) of the torques by x, dx and ddx: those of the rotors and, if redundant, dG k
    accelerations = changes.accelerations[..., robot.actuated]
    slopes = (robot.rotor_inertia * robot.gear_ratio * accelerations).swapaxes(2, 3)
    if robot.n_a > robot.n:
        # dG k: torques t = G k of least norm are computed like the motors' speeds at the rates k of x, and
        # change like these speeds at constant rates
        inverse = np.asarray(np.linalg.pinv(speeds.swapaxes(1, 2)), dtype=float)
        k = matvec(inverse, joint_torque / robot.gear_ratio)
        at_rest = np.zeros_like(k)
        at_k = motion_at(robot, motion.linearised, k, at_rest)
        at_k_changes = coordinate_changes(robot, at_k, robot.structure.idle, (prescribed.x, k, at_rest))
        speed_changes = robot.gear_ratio * at_k_changes.v[:, : robot.n, robot.actuated]
        slopes[0, ..., : robot.n] += speed_changes.swapaxes(1, 2)
    # the motors balance the other part of the wrench T' d(r + rotors - J' lambda) on the platform
    force_change = driven_force_changes(robot, motion, r, joint_torque, changes).swapaxes(2, 3)
    slopes += least_motor_torques(robot, speeds, motions @ force_change - speeds @ slopes)

    torque_x, torque_dx, torque_ddx = slopes[:, prescribed.entry, ..., : robot.n]  # without idle joints
    return DynamicsDerivatives(
        torque=motor_torque(robot, motion, joint_torque)[prescribed.entry],
        torque_x=torque_x,
        torque_dx=torque_dx,
        torque_ddx=torque_ddx,
        _robot=robot,
        _motion=motion,
    )
