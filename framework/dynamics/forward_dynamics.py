"""Forward dynamics: accelerations under motor torques, and the forces in loops and joints, of states.

The accelerations are those of the simulation (`simulation.accelerations`), regular at Type 2; the forces in
loops and joints are computed as for a prescribed motion (`Instant`).
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from framework.arrays import Array, ArrayLike
from framework.dynamics.forces import Forces, tree_forces
from framework.dynamics.pointwise_dynamics import Instant, entry_of, instant_of
from framework.dynamics.reactions import apply_wrenches, stack_wrenches, stacked_rows
from framework.errors import InvalidInput
from framework.kinematics.linearised_loops import ClosedStack, assembled_at
from framework.kinematics.loop_matrices import scaled_loops
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.linalg.ordered_sums import matvec
from framework.simulation.accelerations import accelerations
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

    in all coordinates, so that nothing is singular at Type 2. For rigid robots it inverts `dynamics_at`. That
    takes springs for rigid, while this counts the forces of their deflections in q. `a` of the result is NaN
    for a motion without mass (an elastic robot of massless links), `torque` the argument, `spring_force` that
    of the deflections.

    Args:
        q: assembled, of `assemble` or `forward_kinematics`; or a stack of T states (T, nq), and all results
            then have T as their first axis. Accelerations, loop forces and reactions of a state are the same
            alone and in a stack, to the last bit.
        v: (nv,) or (T, nv) [rad/s, m/s], of `dynamics_at(robot, q, dx=...)` or a plan.
        torque: (n_a,) or (T, n_a) [N m, N], motor side.
        wrenches: of the world, as for `dynamics_at`.

    Raises:
        InvalidInput: q or v opens the loops; an argument of the wrong shape, or a frame that is not there;
            parts without mass out of balance, or without mass and spring. Of a stack it names the row.
    """
    expect_robot(robot)
    closed = assembled_at(robot, q, stacks=True)
    count, nv = len(closed.q), robot.model.nv
    rates = stacked_rows("v", v, nv, count)
    torques = stacked_rows(f"torque ({', '.join(robot.actuator_names)})", torque, robot.n_a, count)
    _check_rates(robot, closed, rates)
    at_rest = Motion(closed.q, rates.copy(), np.zeros((count, nv)), closed.linearised)
    at_rest = apply_wrenches(robot, at_rest, stack_wrenches(robot, wrenches, count))
    applied = sum((wrench.generalised for wrench in at_rest.wrenches), start=np.zeros((count, nv)))
    solution = accelerations(_equations_of(robot, threading.get_ident()), closed.q, rates, torques, applied)
    motion = replace(at_rest, a=solution.a)
    rotors = (robot.rotors * solution.a)[:, robot.actuated]
    forces = Forces(
        robot.gear_ratio * torques - rotors,
        -robot.stiffness * robot.coordinates.positions(closed.q)[:, robot.elastic],
    )
    entry = entry_of(q)
    instant = instant_of(robot, motion, tree_forces(robot, motion), forces, entry)
    determined = np.where(solution.undetermined, np.nan, solution.a)
    return replace(instant, torque=torques[entry], a=determined[entry])


@lru_cache(maxsize=16)  # megabytes each; their working memory serves one thread
def _equations_of(robot: ParallelRobot, thread: int) -> EquationsOfMotion:
    return EquationsOfMotion.of(robot)


def _check_rates(robot: ParallelRobot, closed: ClosedStack, v: Array) -> None:
    """Refuse joint rates (T, nv) under which the loop equations open."""
    speeds = v / robot.column_scale
    opening = np.abs(matvec(scaled_loops(robot, closed.linearised), speeds)).max(axis=1, initial=0.0)
    wrong = np.flatnonzero(opening > FILE_ROUNDING * np.abs(speeds).max(axis=1, initial=0.0))
    if len(wrong):
        row = f", row {wrong[0]}" if len(v) > 1 else ""
        raise InvalidInput(
            f"v{row}: the loops of {robot.name} open with {opening[wrong[0]]:.3g} rad/s or robot lengths/s; "
            f"see `dynamics_at`"
        )
