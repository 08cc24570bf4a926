"""The torques of an elastic robot beside a motion in balance, linear in the change of its law.

With given deflections, functions of the law's parameter, load and torques are affine in z = (d sigma/dt)^2
and u = z'/2 of the law, but for viscous damping, which follows z^(1/2). A small change of z changes the
balance F by F_z dz + F_u du. Deflections follow so that F stays zero,

    F_l dl + F_l' dl' + F_l" dl" = -(F_z dz + F_u du),

and torques follow both. Where the loaded robot is singular, deflections stay smooth only if a scalar of the
law follows too (see `restoration`): that this scalar does not change is condition (8) of the loaded robot.

Torques are those of `forces_in_balance`, regular at Type 2 as long as F = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.balance_equations import BalanceEquations, BalanceState
from framework.dynamics.force_changes import force_changes
from framework.dynamics.loaded_balance import (
    LoadedBalance,
    locked_columns,
    loop_weights,
    motion_and_load,
    spring_units,
)
from framework.dynamics.restoration import BalanceSolution
from framework.dynamics.tangent_stiffness import factor_transposed
from framework.kinematics.linearised_loops import ClosedStack
from framework.kinematics.motion_changes import coordinate_changes
from framework.kinematics.motion_rates import motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.clock import OnParameter
from framework.laws.optimal_law import OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, coefficients
from framework.numerics.ordered_sums import solve


class TorqueResponse(NamedTuple):
    """Motor torques about a motion, linear in the coefficients y (n,) of the squared speed.

    Functions are of xi in place of time.
    """

    y: Array  # (n,) of the motion
    scalars: Array  # (k, n) derivatives by y of the law's scalars
    torque: TimeFunction  # (n_a,) [N m] along the motion, motor side
    slopes: TimeFunction  # (n_a n,) derivatives of the torque by y
    speed: TimeFunction  # (n_a,) [rad] of the motors over d sigma/dt


def respond_to_law(solution: BalanceSolution) -> TorqueResponse:
    """Compute the response of torques to each coefficient of an optimal law, at a motion in balance."""
    equations, state = solution.equations, solution.state
    clock = state.samples.clock
    assert isinstance(clock, OnParameter)
    terms, terms_by_y = _law_terms(clock.law, state.samples.parameters)
    by_terms = _split_by_law_terms(equations, state)
    F_y = by_terms.F @ terms_by_y  # (T, n_e, n)
    linear = equations.linearise(state, equations.slopes(state))
    changes = linear.follow(F_y.reshape(-1, F_y.shape[2]))  # of deflections and scalars
    series, scalars = np.split(changes, [state.series.size])
    series = series.reshape(*state.series.shape, -1)  # (panels, N, n_e, n)
    slopes = by_terms.torque @ terms_by_y + _torques_of_deflections(equations.branch.robot, state, series)
    functions = [
        TimeFunction(clock.edges, coefficients(values.reshape(len(series), -1, values[0].size)))
        for values in (by_terms.torque @ terms[..., None], slopes, by_terms.speed)
    ]
    return TorqueResponse(clock.law.coefficients, scalars, *functions)


def _law_terms(law: OptimalLaw, xi: Array) -> tuple[Array, Array]:
    """Return the terms of a law at xi (T, 4), and their derivatives by its coefficients (T, 4, n).

    They are 1, z, u and z^(1/2).
    """
    half_rate = 0.5 * law.stretch(law.stretch.inverse(xi), 1)[:, None]  # u = z'/2 = xi' (dz/dxi) / 2
    z_by_y = law.basis.matrix(xi).toarray()
    u_by_y = half_rate * law.basis.matrix(xi, 1).toarray()
    z, u = z_by_y @ law.coefficients, u_by_y @ law.coefficients
    root_by_y = z_by_y / (2.0 * np.sqrt(z))[:, None]
    terms = np.stack([np.ones_like(z), z, u, np.sqrt(z)], axis=1)
    return terms, np.stack([0.0 * z_by_y, z_by_y, u_by_y, root_by_y], axis=1)


def _torques_of_deflections(robot: ParallelRobot, state: BalanceState, series: Array) -> Array:
    """Compute changes (T, n_a, n) of torques by changes of deflections, series (panels, N, n_e, n)."""
    panels, N, n_e, n = series.shape
    slopes = _torque_slopes_by_springs(robot, state.balance)
    torque = np.zeros((*slopes[0].shape[:2], n))
    for slope, basis in zip(slopes, state.samples.bases, strict=True):  # value, rate, acceleration
        changes = np.einsum("ptj,pjei->ptei", basis.reshape(panels, 2 * N, N), series)
        torque += slope @ changes.reshape(-1, n_e, n)
    return torque


class _LawTerms(NamedTuple):
    """F and torques at given deflections, at rest, per z, u and z^(1/2) of the law; and motor speeds."""

    F: Array  # (T, n_e, 4)
    torque: Array  # (T, n_a, 4) [N m], motor side
    speed: Array  # (T, n_a) [rad] over d sigma/dt, motor side


def _split_by_law_terms(equations: BalanceEquations, state: BalanceState) -> _LawTerms:
    """Compute F and torques at the configurations of a state, from their values at four (z, u)."""
    robot, balance = equations.branch.robot, state.balance
    loads, accelerations, speeds = [], [], []
    for z_and_u in ((0.0, 0.0), (1.0, 0.0), (4.0, 0.0), (0.0, 1.0)):
        prescribed = equations.prescribe_at(state, *z_and_u)
        closed = ClosedStack(balance.motion.q, prescribed.x, balance.motion.linearised)
        loads.append(motion_and_load(robot, prescribed, closed, balance.wrenches, balance.stiffer)[1])
        motion = motion_at(robot, closed, prescribed.dx, prescribed.ddx, prescribed.dl, prescribed.ddl)
        accelerations.append(motion.a[:, robot.actuated])
        speeds.append(motion.v[:, robot.actuated])
    load, acceleration = (_split_terms(values) for values in (loads, accelerations))
    columns, units = locked_columns(robot)
    F = balance.Y.swapaxes(1, 2) @ (load[:, columns] * units[:, None])
    return _LawTerms(F, _balance_motors(robot, balance, load, acceleration), speeds[1] * robot.gear_ratio)


def _split_terms(values: list[Array]) -> Array:
    """Split values a + b z + c u + d z^(1/2) into their four terms (T, k, 4).

    Args:
        values: (T, k) at (z, u) = (0, 0), (1, 0), (4, 0) and (0, 1).
    """
    at_rest, once, fourfold, per_u = values
    per_root = 0.5 * (4.0 * (once - at_rest) - (fourfold - at_rest))
    return np.stack([at_rest, once - at_rest - per_root, per_u - at_rest, per_root], axis=2)


def _torque_slopes_by_springs(robot: ParallelRobot, balance: LoadedBalance) -> list[Array]:
    """Compute slopes (T, n_a, n_e) of torques by deflections, by their rates and by their accelerations.

    Deflections count in the units of the springs.
    """
    prescribed, units = balance.prescribed, spring_units(robot)
    closed = ClosedStack(balance.motion.q, prescribed.x, balance.motion.linearised)
    moving = motion_at(robot, closed, prescribed.dx, prescribed.ddx, prescribed.dl, prescribed.ddl)
    changes = coordinate_changes(robot, moving, robot.elastic)
    load_changes = changes
    if not robot.elastic_inertia:  # rates of deflections cause no forces
        load_changes = coordinate_changes(robot, balance.motion, robot.elastic)
    multipliers = balance.multipliers * loop_weights(robot)
    forces = force_changes(robot, balance.motion, multipliers, load_changes)  # (3, T, n_e, nv)
    forces[1:] *= robot.elastic_inertia
    forces[0][:, range(robot.n_e), robot.elastic] += balance.stiffer * robot.stiffness
    accelerations = changes.accelerations[..., robot.actuated]
    return [
        _balance_motors(robot, balance, force.swapaxes(1, 2), acceleration.swapaxes(1, 2)) * units
        for force, acceleration in zip(forces, accelerations, strict=True)
    ]


def _balance_motors(
    robot: ParallelRobot, balance: LoadedBalance, forces: Array, accelerations: Array
) -> Array:
    """Compute the torques (T, n_a, k) [N m] that balance forces of the tree with the loops, motor side.

    The loops take what loads the joints that move while the motors are locked, J' lambda = forces in the
    least squares; motors take the rest, and accelerate their rotors.

    Args:
        forces: (T, nv, k) of the open tree.
        accelerations: (T, n_a, k) of the actuated joints.
    """
    columns, units = locked_columns(robot)
    J = balance.motion.linearised.closures * loop_weights(robot)[:, None]  # (T, m, nv)
    Q, R, _ = factor_transposed(J[:, :, columns] * units)
    multipliers = solve(R, Q.swapaxes(1, 2) @ (forces[:, columns] * units[:, None]))
    joint_torque = forces[:, robot.actuated] - J[:, :, robot.actuated].swapaxes(1, 2) @ multipliers
    gear = robot.gear_ratio[:, None]
    return joint_torque / gear + robot.rotor_inertia[:, None] * gear * accelerations
