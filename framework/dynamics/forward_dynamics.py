"""Forward dynamics: accelerations under motor torques, and the forces in loops and joints.

The accelerations come from the simulation (`simulation.consistent_states`) and are regular at Type 2. The
forces in loops and joints are computed as for a prescribed motion (`Instant`).
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from framework.dynamics.forces import Forces, tree_forces
from framework.dynamics.pointwise_dynamics import Instant, entry_of, instant_of
from framework.dynamics.reactions import apply_wrenches, stack_wrenches, stacked_rows
from framework.errors import InvalidInput
from framework.kinematics.linearised_loops import ClosedStack, assembled_at, scaled_loops
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import matvec
from framework.simulation.consistent_states import accelerations
from framework.simulation.equations import EquationsOfMotion
from framework.tolerances import FILE_ROUNDING


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
        wrenches: external wrenches, as for `dynamics_at`.

    Raises:
        InvalidInput: q or v opens the loops; an argument has the wrong shape; a frame is unknown; parts
            without mass are not in balance, or have neither mass nor spring. For a stack the message names
            the row.
    """
    expect_robot(robot)
    closed = assembled_at(robot, q, stacks=True)
    count = len(closed.q)
    rates = stacked_rows("v", v, robot.nv, count)
    torques = stacked_rows(f"torque ({', '.join(robot.actuator_names)})", torque, robot.n_a, count)
    _check_rates(robot, closed, rates)
    at_rest = np.zeros((count, robot.nv))
    unaccelerated = Motion(closed.q, rates.copy(), at_rest, closed.linearised)
    unaccelerated = apply_wrenches(robot, unaccelerated, stack_wrenches(robot, wrenches, count))
    applied = sum((wrench.generalised for wrench in unaccelerated.wrenches), start=at_rest)
    solution = accelerations(_equations_of(robot, threading.get_ident()), closed.q, rates, torques, applied)
    motion = replace(unaccelerated, a=solution.a)
    deflections = robot.coordinates.positions(closed.q)[:, robot.elastic]
    forces = Forces(
        joint_torque=robot.gear_ratio * torques - (robot.rotors * solution.a)[:, robot.actuated],
        spring_force=-robot.stiffness * deflections,
    )
    entry = entry_of(q)
    instant = instant_of(robot, motion, tree_forces(robot, motion), forces, entry)
    acceleration = np.where(solution.undetermined, np.nan, solution.a)
    return replace(instant, torque=torques[entry], a=acceleration[entry])


@lru_cache(maxsize=16)  # megabytes each
def _equations_of(robot: ParallelRobot, thread: int) -> EquationsOfMotion:
    """Return the equations of motion of a robot, with working memory for one thread."""
    return EquationsOfMotion.of(robot)


def _check_rates(robot: ParallelRobot, closed: ClosedStack, v: Array) -> None:
    """Refuse joint rates v (T, nv) that open the loops: J v must be zero but for rounding."""
    speeds = v / robot.column_scale  # [rad/s, robot lengths/s]
    loop_rates = np.abs(matvec(scaled_loops(robot, closed.linearised), speeds)).max(axis=1, initial=0.0)
    opening_rows = np.flatnonzero(loop_rates > FILE_ROUNDING * np.abs(speeds).max(axis=1, initial=0.0))
    if len(opening_rows):
        first = opening_rows[0]
        row = f", row {first}" if len(v) > 1 else ""
        raise InvalidInput(
            f"v{row}: the loops of {robot.name} open with {loop_rates[first]:.3g} rad/s or robot "
            f"lengths/s; see `dynamics_at`"
        )
