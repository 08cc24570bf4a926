"""Torques of an elastic robot near a motion in balance, linearised in its law.

Let deflections be given functions of the law's parameter. Load and torques are then affine in
z = (d sigma/dt)^2 and u = z'/2 of the law, except for viscous damping, which is proportional to z^(1/2). A
small change of z changes the residual F of the balance by F_z dz + F_u du. Deflections change so that F stays
zero,

    F_l dl + F_l' dl' + F_l" dl" = -(F_z dz + F_u du),

and torques depend on both changes. Where the loaded robot is singular, deflections stay smooth only if a
scalar of the law changes too (see `restoration`). Condition (8) of the loaded robot requires that this scalar
does not change.

Torques are those of `balancing_forces`, regular at Type 2 as long as F = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.balance_equations import BalanceEquations, BalanceState
from framework.dynamics.deflection_splines import DeflectionSplines, KnownDeflections
from framework.dynamics.forces import force_changes, tree_forces
from framework.dynamics.loaded_balance import (
    LoadedBalance,
    constraint_rows,
    locked_columns,
    loop_weights,
    motion_and_load,
    spring_units,
)
from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.restoration import BalanceSolution
from framework.kinematics.motion_rates import coordinate_changes, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import OnParameter, OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine
from framework.numerics.ordered_sums import factor_transposed, solve


class TorqueResponse(NamedTuple):
    """Motor torques linearised about a motion in the coefficients y (n,) of the squared speed."""

    y: Array  # (n,) of the motion
    scalar_slopes: Array  # (k, n) derivatives of the law's scalars by y
    series_slopes: Array  # (size, n_e, n) of the deflections' coefficients by y, in units of the springs
    rest: Affine  # (r,) of y: rates and accelerations of springs at both ends, over their largest
    splines: DeflectionSplines  # of xi
    motor_series: Array  # (size, n_a (n + 2)) coefficients of the motors' torques, slopes by y and speeds

    @property
    def holds_rest(self) -> bool:
        """Whether springs carry inertia, and could move at the ends."""
        return len(self.rest.offset) > 0

    def evaluate_motors(self, xi: Array) -> tuple[Array, Array, Array]:
        """Compute torques (M, n_a) [N m], their slopes (M, n_a, n) by y, and speeds (M, n_a), at xi (M,).

        Torques and speeds are those of the motion, motor side; speeds [rad] are over d sigma/dt.
        """
        n = len(self.y)
        values = self.splines.evaluate(self.motor_series, xi).reshape(len(xi), -1, n + 2)
        return values[..., 0], values[..., 1:-1], values[..., -1]


def respond_to_law(solution: BalanceSolution) -> TorqueResponse:
    """Linearise torques in the coefficients of an optimal law, about a motion in balance."""
    equations = solution.equations
    state = solution.state
    clock = state.clock
    assert isinstance(clock, OnParameter)
    terms, terms_by_y = _law_terms(clock.law, state.splines.nodes.p)  # (T, 4), (T, 4, n)
    F_per_term, torque_per_term, speed = _split_by_law_terms(equations, state)
    F_y = F_per_term @ terms_by_y  # (T, n_e, n)
    linear = equations.linearise(state)
    # derivatives by y of the splines' coefficients and of the law's scalars
    by_y = linear.cancel_changes(F_y.reshape(-1, F_y.shape[2]))
    rest_slopes = (linear.rest * linear.sizes) @ by_y
    rest = Affine(rest_slopes, linear.rest_of(state) - rest_slopes @ clock.law.coefficients)
    series_by_y, scalar_slopes = np.split(by_y, [state.series.size])
    series_by_y = series_by_y.reshape(*state.series.shape, -1)  # (size, n_e, n)
    torque = torque_per_term @ terms[..., None]  # (T, n_a, 1)
    # (T, n_a, n) by the changes of the deflections, their rates and their accelerations
    by_springs = _torque_slopes_by_springs(equations.branch.robot, state.balance)
    by_each_order = [
        slope @ state.splines.combine(basis, series_by_y)
        for slope, basis in zip(by_springs, state.bases, strict=True)
    ]
    slopes = torque_per_term @ terms_by_y + np.sum(by_each_order, axis=0)
    motors = np.concatenate([torque, slopes, speed[..., None]], axis=2)  # (T, n_a, n + 2)
    motor_series = state.splines.fit(motors.reshape(len(motors), -1))
    y = clock.law.coefficients
    return TorqueResponse(y, scalar_slopes, series_by_y, rest, state.splines, motor_series)


def peaks_at_nodes(solution: BalanceSolution, friction: Array) -> Array:
    """Compute the largest torques (n_a,) [N m, N] of a motion in balance at its nodes, motor side.

    Args:
        friction: (n_a,) [N m, N] dry friction of the motors.
    """
    robot = solution.equations.branch.robot
    balance = solution.state.balance
    motion = motion_at(robot, balance.motion.linearised, *balance.prescribed.rates)
    load = tree_forces(robot, balance.motion)  # (T, nv)
    load[:, robot.elastic] += balance.stiffer * robot.stiffness * balance.prescribed.l
    acceleration = motion.a[:, robot.actuated]
    torque = _balance_motors(robot, balance, load[..., None], acceleration[..., None])[..., 0]  # (T, n_a)
    speed = robot.gear_ratio * motion.v[:, robot.actuated]
    return np.asarray(np.abs(torque + friction * speed_signs(speed)).max(axis=0))


def foresee_deflections(solution: BalanceSolution, response: TorqueResponse, y: Array) -> KnownDeflections:
    """Return deflections in balance under another law, to first order.

    Args:
        y: (n,) coefficients of the other law.
    """
    series = solution.state.series + response.series_slopes @ (y - response.y)
    return KnownDeflections(solution.state.clock, solution.state.splines, series * solution.equations.units)


def renew_cells(deflections: KnownDeflections, factor: float) -> KnownDeflections:
    """Return deflections on uniform cells, `factor` times as many.

    Cells that were halved for one law would hold its vibrations under the next. Too few do not represent the
    vibrations that hold springs at rest: these seem to move at the ends.
    """
    clock, former, series = deflections
    count = int(factor * (len(former.cells) - 1))
    splines = DeflectionSplines.uniform(former.panels, count, continuity=former.continuity)
    return KnownDeflections(clock, splines, splines.fit(former.evaluate(series, splines.nodes.p)))


def _law_terms(law: OptimalLaw, xi: Array) -> tuple[Array, Array]:
    """Compute terms 1, z, u, z^(1/2) (T, 4) of a law, and slopes (T, 4, n) by y, at xi (T,)."""
    half_rate = 0.5 * law.stretch(law.stretch.inverse(xi), 1)[:, None]  # u = z'/2 = xi' (dz/dxi) / 2
    z_by_y = law.basis.matrix(xi).toarray()
    u_by_y = half_rate * law.basis.matrix(xi, 1).toarray()
    z = z_by_y @ law.coefficients
    u = u_by_y @ law.coefficients
    root = np.sqrt(z)
    root_by_y = z_by_y / (2.0 * root)[:, None]
    values = np.stack([np.ones_like(z), z, u, root], axis=1)
    return values, np.stack([0.0 * z_by_y, z_by_y, u_by_y, root_by_y], axis=1)


def _split_by_law_terms(equations: BalanceEquations, state: BalanceState) -> tuple[Array, Array, Array]:
    """Compute coefficients of F and torques from values at four (z, u), at a state's configurations.

    Four pairs determine the four coefficients of 1, z, u and z^(1/2), at the deflections of the state: the
    values are `terms` (pairs, 4) times the coefficients.

    Returns:
        The coefficients (T, n_e, 4) of F and (T, n_a, 4) of torques [N m], motor side; motor speeds (T, n_a)
        [rad] over d sigma/dt, motor side.
    """
    robot = equations.branch.robot
    balance = state.balance
    closed = balance.motion.linearised
    terms = np.array([[1.0, z, u, np.sqrt(z)] for z, u in ((0, 0), (1, 0), (4, 0), (0, 1))])
    loads = []
    motions = []
    for _, z, u, _ in terms.tolist():
        prescribed = equations.prescribe_at(state, z, u)
        _, load_at = motion_and_load(robot, prescribed, closed, balance.wrenches, balance.stiffer)
        loads.append(load_at)
        motions.append(motion_at(robot, closed, *prescribed.rates))  # with the rates of springs
    to_coefficients = np.linalg.inv(terms)
    load = np.einsum("kp,ptv->tvk", to_coefficients, loads)  # (T, nv, 4)
    accelerations = [motion.a[:, robot.actuated] for motion in motions]
    acceleration = np.einsum("kp,ptv->tvk", to_coefficients, accelerations)  # (T, n_a, 4)
    speed = motions[1].v[:, robot.actuated] * robot.gear_ratio  # at z = 1, where d sigma/dt = 1
    columns, units = locked_columns(robot)
    F = balance.Y.swapaxes(1, 2) @ (load[:, columns] * units[:, None])
    return F, _balance_motors(robot, balance, load, acceleration), speed


def _torque_slopes_by_springs(robot: ParallelRobot, balance: LoadedBalance) -> list[Array]:
    """Compute slopes (T, n_a, n_e) of torques by deflections, their rates and their accelerations.

    Deflections are in the units of the springs (`spring_units`).

    Args:
        balance: the balance about which torques are linearised. Its multipliers belong to loop equations of
            unit size (`loop_weights`), and its springs are `stiffer` than the robot's by this factor.
    """
    # with the rates of the springs, which the motion of the balance lacks if these carry no inertia
    motion = motion_at(robot, balance.motion.linearised, *balance.prescribed.rates)
    changes = coordinate_changes(robot, motion, robot.elastic)
    load_changes = changes  # of the motion that causes the load
    if not robot.elastic_inertia:  # rates of deflections cause no forces, but they move the rotors
        load_changes = coordinate_changes(robot, balance.motion, robot.elastic)
    multipliers = balance.multipliers * loop_weights(robot)
    forces = force_changes(robot, balance.motion, multipliers, load_changes)  # (3, T, n_e, nv)
    forces[1:] *= robot.elastic_inertia  # False: no forces by rates and accelerations
    forces[0][:, range(robot.n_e), robot.elastic] += balance.stiffer * robot.stiffness
    accelerations = changes.accelerations[..., robot.actuated]  # (3, T, n_e, n_a)
    # the changes by value, rate and acceleration side by side: (T, nv, 3 n_e) and (T, n_a, 3 n_e)
    forces, accelerations = (
        np.concatenate(list(values.swapaxes(2, 3)), axis=2) for values in (forces, accelerations)
    )
    slopes = _balance_motors(robot, balance, forces, accelerations)  # (T, n_a, 3 n_e)
    return [slope * spring_units(robot) for slope in np.split(slopes, 3, axis=2)]


def _balance_motors(
    robot: ParallelRobot, balance: LoadedBalance, forces: Array, accelerations: Array
) -> Array:
    """Compute the torques (T, n_a, k) [N m] that balance forces of the tree, motor side.

    Loop forces balance the columns that move while the motors are locked (`locked_columns`): J' lambda =
    forces in the least squares. Motors balance the rest, and accelerate their rotors.

    Args:
        forces: (T, nv, k) of the open tree.
        accelerations: (T, n_a, k) of the actuated joints.
    """
    columns, units = locked_columns(robot)
    linearised = balance.motion.linearised
    # J' = Q R gives lambda = R^-1 Q' forces, in units of the columns
    Q, R, _null_space = factor_transposed(constraint_rows(robot, linearised))
    multipliers = solve(R, Q.swapaxes(1, 2) @ (forces[:, columns] * units[:, None]))
    J_a = linearised.closures[:, :, robot.actuated] * loop_weights(robot)[:, None]  # (T, m, n_a)
    loop_multipliers = multipliers[:, : J_a.shape[1]]  # without those of redundant motors
    joint_torque = forces[:, robot.actuated] - J_a.swapaxes(1, 2) @ loop_multipliers
    gear = robot.gear_ratio[:, None]
    return joint_torque / gear + robot.rotor_inertia[:, None] * gear * accelerations
