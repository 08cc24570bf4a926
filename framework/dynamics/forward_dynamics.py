"""Forward dynamics: accelerations under motor torques, regular at Type 2, and their exact derivatives.

The accelerations come from the simulation (`simulation.consistent_states`) and are regular at Type 2. The
forces in loops and joints are computed as for a prescribed motion (`Instant`).

For the derivatives, the coordinates y of the robot with closed loops are those of the platform and the
deflections. T = dq/dy are the joint rates for unit rates of y. r are the forces of the open tree, lambda the
loop forces, tau the motor torques, n the gear ratio, and S selects the actuated columns. The equations of
motion, and their changes at fixed lambda, are

    T' (r + rotors + springs - S' n tau) = 0,
    T' d(r - J' lambda + rotors + springs) = T' S' n dtau.

`driven_force_changes` gives the derivatives of the left side by y, y' and y". The derivative by y" is the
inertia, which is regular at a Type 2 singularity.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from framework.dynamics.forces import Forces, driven_force_changes, tree_forces
from framework.dynamics.instant import (
    Instant,
    apply_wrenches,
    entry_of,
    instant_of,
    stack_rows,
    stack_wrenches,
)
from framework.errors import InvalidInput
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import assembled_at, require_closed_rates
from framework.kinematics.motion_rates import Motion, coordinate_changes, platform_twists
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import CoordinateRates
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.ordered_sums import solve
from framework.simulation.consistent_states import accelerations
from framework.simulation.equations import EquationsOfMotion


def forward_dynamics(
    robot: ParallelRobot,
    q: ArrayLike,
    v: ArrayLike,
    torque: ArrayLike,
    *,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> Instant:
    """Compute the accelerations and loads under motor torques at q (nq,) with joint rates v (nv,).

        M a + c + g + K (q - rest) = S' n tau + f + J' lambda,        J a + drift = 0

    Here c are the centrifugal and Coriolis forces, g is the weight, K are the stiffnesses of springs, n is
    the gear ratio, f are the external forces and lambda the loop forces. The equations contain all
    coordinates and are regular at Type 2. For rigid robots this function inverts `dynamics_at`. For elastic
    robots, `dynamics_at` takes springs as rigid, while here the deflections in q cause forces. In the result
    `a` is NaN for a motion without mass (an elastic robot with massless links), `torque` is the argument, and
    `spring_force` is -K times the deflections.

    Args:
        q: an assembled configuration, as returned by `assemble` or `forward_kinematics`; or a stack of T
            states (T, nq), for which the first axis of all results is T. Accelerations, loop forces and
            reactions of a state are the same alone and in a stack, to the last bit.
        v: (nv,) or (T, nv) [rad/s, m/s], as returned by `dynamics_at(robot, q, dx=...)` or a plan.
        torque: (n_a,) or (T, n_a) [N m, N], motor side.
        wrenches: external wrenches (6,) or (T, 6) [N, N m] by URDF link or joint, (force, moment) ON
            its body at its origin, on base axes.

    Raises:
        InvalidInput: q or v opens the loops; an argument has the wrong shape; a frame is unknown; parts
            without mass are not in balance, or have neither mass nor spring. For a stack the message names
            the row.
    """
    # stacks of T states, checked
    closed = assembled_at(robot, q, stacks=True)
    count = len(closed.q)
    rates = stack_rows("v", v, robot.nv, count)
    torques = stack_rows(f"torque ({', '.join(robot.actuator_names)})", torque, robot.n_a, count)
    require_closed_rates(robot, closed, rates)

    at_rest = np.zeros((count, robot.nv))
    # the motion without accelerations, under the external wrenches
    unaccelerated = Motion(closed.q, rates.copy(), at_rest, closed)
    unaccelerated = apply_wrenches(robot, unaccelerated, stack_wrenches(robot, wrenches, count))
    applied = sum((wrench.generalised for wrench in unaccelerated.wrenches), start=at_rest)
    solution = accelerations(_equations_of(robot), closed.q, rates, torques, applied)
    motion = replace(unaccelerated, a=solution.a)

    # forces on the joints: motors less their rotors, and springs
    deflections = robot.coordinates.positions(closed.q)[:, robot.elastic]
    forces = Forces(
        joint_torque=robot.gear_ratio * torques - (robot.rotors * solution.a)[:, robot.actuated],
        spring_force=-robot.stiffness * deflections,
    )
    entry = entry_of(q)
    instant = instant_of(robot, motion, tree_forces(robot, motion), forces, entry)
    acceleration = np.where(solution.undetermined, np.nan, solution.a)
    return replace(instant, torque=torques[entry], a=acceleration[entry])


_equations_of = lru_cache(maxsize=16)(EquationsOfMotion.of)  # by robot


@dataclass(frozen=True, eq=False)
class ForwardDerivatives(ReadOnlyArrays):
    """Accelerations of one state under motor torques, and their derivatives.

    The d coordinates y are the platform's x (n,) and, for an elastic robot, the deflections (n_e,). Each
    derivative varies one of positions, rates and torques. Torques are on the motor side, motor accelerations
    on the joint side of the gears. For a stack of T states the first axis of every array is T.
    """

    acceleration: Array  # (d,) y"
    acceleration_y: Array  # (d, d) by y
    acceleration_dy: Array  # (d, d) by y'
    acceleration_torque: Array  # (d, n_a) per N m, N
    motor: Array  # (n_a,) accelerations of the motors' joints
    motor_y: Array  # (n_a, d)
    motor_dy: Array  # (n_a, d)
    motor_torque: Array  # (n_a, n_a)


def forward_derivatives(
    robot: ParallelRobot,
    q: ArrayLike,
    v: ArrayLike,
    torque: ArrayLike,
    *,
    wrenches: Mapping[str, ArrayLike] | None = None,
    turning: Collection[str] = (),
) -> ForwardDerivatives:
    """Compute the derivatives of `forward_dynamics`, assembled at q (nq,) with joint rates v (nv,).

    Args:
        q: assembled configuration, as returned by `assemble`; or a stack of T states (T, nq).
        v: (nv,) or (T, nv) [rad/s, m/s] joint rates that keep the loops closed.
        torque: (n_a,) or (T, n_a) [N m, N], motor side.
        wrenches: external wrenches (6,) or (T, 6) [N, N m] by URDF link or joint, (force, moment) ON
            its body at its origin, on base axes.
        turning: names of frames whose wrenches turn with the frame, as on the axes of a tool; other wrenches
            keep their components on base axes.

    Raises:
        InvalidInput: as `forward_dynamics`; a platform that does not determine the joints; a motion without
            mass, for which torques do not determine the acceleration.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
    """
    require_square(robot)
    instant = forward_dynamics(robot, q, v, torque, wrenches=wrenches)
    if not np.isfinite(instant.a).all():
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: some motion has no mass, so that torques do not tell its "
            f"acceleration; give the links of the springs mass, or leave the springs out"
        )
    motion = instant._motion
    motion = motion.with_wrenches(
        tuple(wrench._replace(turns=wrench.frame in turning) for wrench in motion.wrenches)
    )
    x, dx, ddx = platform_rates_of(robot, motion)
    # steps of x, then of the coordinates that the platform does not determine
    others = np.concatenate([robot.elastic, robot.structure.idle])
    changes = coordinate_changes(robot, motion, others, (x, dx, ddx))
    joint_torque = np.atleast_2d(instant.joint_torque)
    force_change = driven_force_changes(robot, motion, instant._forces, joint_torque, changes)
    d = robot.n + robot.n_e  # coordinates y; the other steps are those of idle joints

    # derivatives of y" and of idle joints' accelerations by y, dy and torque, (T, k, d or n_a) each
    motions = changes.q  # (T, k, nv) joint rates for unit rates
    by_y, by_dy, inertia = motions @ force_change.swapaxes(2, 3)  # (T, k, k) each
    by_torque = robot.gear_ratio * motions[..., robot.actuated]
    right_sides = (-by_y[..., :d], -by_dy[..., :d], by_torque)
    slopes = [np.linalg.solve(inertia, right_side) for right_side in right_sides]
    # those of the motors' accelerations: partial derivatives, and by the chain rule those by y"
    motor_by_y, motor_by_dy, motor_by_ddy = changes.accelerations[..., robot.actuated].swapaxes(2, 3)
    motor_slopes = [motor_by_ddy @ slope for slope in slopes]  # (T, n_a, d or n_a) each
    motor_slopes[0] += motor_by_y[..., :d]
    motor_slopes[1] += motor_by_dy[..., :d]
    fields = (  # in the order of ForwardDerivatives, for all T states
        np.concatenate([ddx, motion.a[:, robot.elastic]], axis=1),
        *(slope[:, :d] for slope in slopes),  # without idle joints
        motion.a[:, robot.actuated],
        *motor_slopes,
    )
    return ForwardDerivatives(*(stack[entry_of(q)] for stack in fields))


def platform_rates_of(robot: ParallelRobot, motion: Motion) -> CoordinateRates:
    """Compute the platform's coordinates x and their derivatives dx, ddx, each (T, n), of a motion.

    The twist is v = E(x) dx and its rate is E ddx + E' dx. Both equations are solved with E.
    """
    platform = robot.platform
    x = platform.coordinates(motion.linearised.frames)
    twist, twist_rate = platform_twists(robot, motion)
    E = platform.rate_matrix(x)
    dx = solve(E, twist)
    _twist, quadratic_terms = platform.twist(x, dx)  # E' dx
    ddx = solve(E, twist_rate - quadratic_terms)
    return x, dx, ddx
