"""Forward dynamics: accelerations of motor torques, and the forces in loops and joints, of one state or many.

The accelerations are those of the simulation (`simulation.accelerations`), regular at Type 2; what loops and
joints then carry is computed as for a motion that is prescribed (`instant`).
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
from framework.dynamics.reactions import given_wrenches, stacked_rows, under_wrenches
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
    """Compute what the robot does under motor torques, assembled at q (nq,) with joint rates v (nv,).

        M a + c + g + K (q - rest) = S' n tau + f + J' lambda,        J a + drift = 0

    in all coordinates, so that nothing is singular at Type 2; of rigid robots it undoes `dynamics_at`, which
    takes springs for rigid, where here they push as they are deflected in q. `a` of the answer has
    NaN where a motion without mass leaves the acceleration open (an elastic robot of massless links); its
    `torque` are the given ones, its `spring_force` that of the springs' deflections.

    Args:
        q: as `assemble` or `forward_kinematics` give it; or a stack of T states (T, nq), and all that is told
            of one then has T as its first axis. Accelerations, loop forces and reactions of a state are those
            that it has alone, to the last bit.
        v: (nv,) or (T, nv) [rad/s, m/s], as `dynamics_at(robot, q, dx=...)` or a plan gives them.
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
    at_rest = under_wrenches(robot, at_rest, given_wrenches(robot, wrenches, count))
    applied = sum((wrench.generalised for wrench in at_rest.wrenches), start=np.zeros((count, nv)))
    equations = equations_of(robot)
    solution = accelerations(equations, closed.q, rates, torques, applied)
    motion = replace(at_rest, a=solution.a)
    r = tree_forces(robot, motion)
    rotors = (robot.rotors * solution.a)[:, robot.actuated]
    forces = Forces(
        robot.gear_ratio * torques - rotors,
        -robot.stiffness * robot.coordinates.positions(closed.q)[:, robot.elastic],
    )
    entry = entry_of(q)
    determined = np.where(solution.undetermined, np.nan, solution.a)
    instant = instant_of(robot, motion, r, forces, entry)
    return replace(instant, torque=torques[entry], a=determined[entry])


def equations_of(robot: ParallelRobot) -> EquationsOfMotion:
    """Return the equations of motion of a robot, made once for each thread."""
    return _equations(robot, threading.get_ident())


@lru_cache(maxsize=16)  # megabytes each; their working memory serves one thread
def _equations(robot: ParallelRobot, thread: int) -> EquationsOfMotion:
    return EquationsOfMotion.of(robot)


def _check_rates(robot: ParallelRobot, closed: ClosedStack, v: Array) -> None:
    """Refuse joint rates (T, nv) under which the loop equations open."""
    speeds = v / robot.column_scale
    opening = matvec(scaled_loops(robot, closed.linearised), speeds)
    left = np.abs(opening).max(axis=1, initial=0.0)
    wrong = np.flatnonzero(left > FILE_ROUNDING * np.abs(speeds).max(axis=1, initial=0.0))
    if len(wrong):
        row = f", row {wrong[0]}" if len(v) > 1 else ""
        raise InvalidInput(
            f"v{row}: the loops of {robot.name} open with {left[wrong[0]]:.3g} rad/s or robot lengths/s; see "
            f"`dynamics_at`"
        )
