"""From motor torques to accelerations at one instant, with the forces in loops and joints.

The accelerations are those of the simulation (`simulation.accelerations`), regular at Type 2; what loops and
joints then carry is computed as for a motion that is prescribed (`instant`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from framework.arrays import Array, ArrayLike
from framework.dynamics.forces import Forces
from framework.dynamics.instant import Instant, instant_of
from framework.dynamics.reactions import given_wrenches, loaded_tree_forces, loads_on
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.closures import scaled
from framework.kinematics.inverse_kinematics import Motion, assembled_at
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.simulation.accelerations import accelerations
from framework.simulation.equations import EquationsOfMotion

CLOSING = 1e-6  # rates of loop equations over those of joints that are no rounding of a joint velocity


def forward_dynamics(
    robot: ParallelRobot,
    q: ArrayLike,
    v: ArrayLike,
    torque: ArrayLike,
    *,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> Instant:
    """What the robot does at an assembled configuration q (nq,) with joint rates v (nv,) under motor torques.

    `a` of the answer has NaN where a motion without mass leaves the acceleration open (an elastic robot of
    massless links); its `torque` are the given ones, its `spring_force` that of the springs' deflections.

    Args:
        v: as `dynamics_at(robot, q, dx=...)` or a plan gives them.
        torque: (n_a,) [N m], motor side.
        wrenches: of the world, as for `dynamics_at`.

    Raises:
        InvalidInput: q or v opens the loops; an argument of the wrong length, or a frame that is not there;
            parts without mass out of balance, or without mass and spring.
    """
    expect_robot(robot)
    closed = assembled_at(robot, q)
    rates = finite_numbers("v", v, robot.model.nv)
    _check_rates(robot, closed.system.closures, rates)
    given = finite_numbers(f"torque ({', '.join(robot.actuator_names)})", torque, robot.n_a)
    at_rest = Motion(closed.q, rates[None], np.zeros((1, robot.model.nv)), closed.system)
    loads = loads_on(robot, at_rest, given_wrenches(robot, wrenches, 1))
    applied = sum((load.generalised[0] for load in loads), start=np.zeros(robot.model.nv))
    equations = EquationsOfMotion.of(robot)
    found = accelerations(equations, closed.q[0], rates, given, applied)
    motion = replace(at_rest, a=found.a[None])
    r = loaded_tree_forces(robot, motion, loads)
    rotors = robot.rotor_inertia * robot.gear_ratio**2 * found.a[robot.actuated]
    springs = -robot.stiffness * closed.q[:, robot.elastic]
    forces = Forces((robot.gear_ratio * given - rotors)[None], springs)
    instant = instant_of(robot, motion, loads, r, forces, single=True)
    return replace(instant, torque=given, a=np.where(found.undetermined, np.nan, found.a))


def _check_rates(robot: ParallelRobot, loops: Array, v: Array) -> None:
    """Refuse joint rates (nv,) under which the loop equations (1, m, nv) open."""
    speeds = v / robot.column_scale
    opening = scaled(robot, loops, robot.loops.rotation)[0] @ speeds
    worst = float(np.abs(opening).max(initial=0.0))
    if worst > CLOSING * float(np.abs(speeds).max(initial=0.0)):
        raise InvalidInput(
            f"v: the loops of {robot.name} open with {worst:.3g} rad/s or robot lengths/s; see `dynamics_at`"
        )
