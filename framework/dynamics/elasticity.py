"""Fixed-point iteration of forces and deflections to balance, for every flexibility.

A pass closes the loops at x(t) and q_e(t) on the time nodes, computes the forces of the tree with all
coordinates and their time derivatives, and returns q_e = -K^-1 (force on the elastic coordinates). The first
pass, at q_e = 0, is the small-displacement hypothesis of Briot and Arakelian 2010 (A and B of the rigid
robot). A rigid robot has no springs and needs only this pass.

Let G(q_e) be the deflections caused by the forces at q_e. The unknown is a polynomial in time with
q_e = G(q_e). If springs carry inertia, this is a differential equation, K q_e + M q_e" = f, whose solutions
differ by free vibrations. Passes from q_e = 0 converge to the solution without vibrations,
q_e = K^-1 f - K^-1 M (K^-1 f)" + ... A few passes suffice if the motion is slow compared with the vibrations.
Otherwise the change grows again after a minimum: a second derivative amplifies rounding by the fourth power
of the degree. Such motions are left to Newton's method in `restoration`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.forces import Forces, balanced_forces, joint_forces, tree_forces
from framework.dynamics.loaded_balance import balancing_forces
from framework.errors import NoAnswer, SpringsTooSoft
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import integrate, integrate_columns
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import Motion, joint_rates, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw, law_derivatives
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.numerics.time_limit import check_time
from framework.tolerances import MAX_DEFLECTION, SETTLED_SHARE

# chooses the law for given deflections, which are None before the first pass
LawChoice = Callable[[TimeFunction | None], MotionLaw]


@dataclass(frozen=True, eq=False)
class Pass:
    """A motion with deflections on the nodes of a grid, its forces, and the deflections that they cause."""

    grid: TimeGrid
    law: MotionLaw
    deflections: TimeFunction  # (n_e) [rad, m] of `motion`, or caused by its forces if a pass improves them
    q_e: Array  # (T, n_e) those of the motion that causes the forces
    motion: Motion
    forces: Forces
    caused: Array  # (T, n_e) deflections that the forces cause
    passes: int = 1  # number of passes up to this one
    change: float = 0.0  # by one more pass, over the largest deflection or spring force
    is_settled: bool = True  # as far as this grid allows

    @property
    def residual(self) -> Array:
        """The caused deflections minus those of the motion (T, n_e); zero in balance."""
        return self.caused - self.q_e


def solve_deflections(
    branch: Branch,
    at_rest: Pass,
    choose_law: LawChoice,
    geometry: str,
    *,
    tolerance: float,
    is_fine: Callable[[Pass], bool],
) -> Pass:
    """Solve for deflections and forces at the nodes of a grid.

    Args:
        at_rest: the pass from which the iteration begins.
        geometry: "rigid" computes forces at q_e = 0, and corrects the motors for the deflections; "deformed"
            iterates until the deflections settle.
        tolerance: relative change of deflections that counts as settled.
        is_fine: whether the grid resolves the forces of the undeformed robot; if not, the iteration is left
            to a finer grid.

    Raises:
        SpringsTooSoft: the forces of the undeformed robot deflect springs beyond the range of a linear one.
        NotAssembled: the first deflections tear the loops.
    """
    if geometry == "rigid":
        if not branch.robot.n_e:
            return at_rest
        grid = at_rest.grid
        deflections = grid.fit(at_rest.caused)  # by the forces of the undeformed robot
        motion = motion_with_deflections(branch, grid.times, at_rest.law, grid.values(deflections), at_rest)
        return replace(at_rest, motion=motion, deflections=deflections)
    robot = branch.robot
    size = np.abs(at_rest.caused / robot.column_scale[robot.elastic])  # (T, n_e) [rad, robot lengths]
    if not np.all(size <= MAX_DEFLECTION):
        # the largest deflection; NaN counts as infinite
        instant, k = np.unravel_index(np.argmax(np.nan_to_num(size, nan=np.inf)), size.shape)
        unit = "m" if robot.sliding[robot.elastic][k] else "rad"
        raise SpringsTooSoft(
            f"the springs are too soft for so quick a motion: the forces of the undeformed robot "
            f"would deflect {robot.elastic_names[k]} by {abs(at_rest.caused[instant, k]):.3g} {unit} at t = "
            f"{at_rest.grid.times[instant]:.4g} s",
            name=robot.name,
            residual=float(size[instant, k]),
        )
    if not is_fine(at_rest):
        return replace(at_rest, change=np.inf)  # not converged on this grid, so that a finer one is tried
    return _iterate_passes(branch, choose_law, tolerance, at_rest)


def _iterate_passes(branch: Branch, choose_law: LawChoice, tolerance: float, current: Pass) -> Pass:
    """Repeat passes until the change is settled, is below the truncation error, or contracts no longer.

    Args:
        tolerance: relative change of deflections that counts as settled.
        current: the first pass.
    """
    # change by a pass over the change by the last pass; above this ratio, passes end
    good_contraction = 0.3
    robot, grid = branch.robot, current.grid
    last_change = np.inf
    passes = 1
    while True:
        check_time()
        following = grid.fit_truncated(current.caused)  # deflections of the next pass
        # the part of the residual that the next pass removes; the rest is truncated
        resolved_change = grid.values(following)[0] - current.q_e
        change = _relative_size(robot, resolved_change, current)
        truncation = _relative_size(robot, current.residual - resolved_change, current)
        # before the second pass the contraction is unknown, and assumed
        contraction = change / last_change if np.isfinite(last_change) else good_contraction
        # change * contraction estimates the change by the next pass
        is_solved = change <= tolerance and change * contraction <= SETTLED_SHARE * tolerance
        # the grid cannot resolve a change below the truncation error; further passes would not settle, or
        # take too long, if they contract slowly
        if is_solved or change <= truncation or contraction > good_contraction:
            break
        last_change = change
        try:
            current = evaluate_pass(branch, grid, choose_law(following), following, current)
        except NoAnswer:
            break
        passes += 1
    return replace(
        current,
        passes=passes,
        change=_relative_size(robot, current.residual, current),
        deflections=following if is_solved else current.deflections,
        is_settled=change <= max(tolerance, truncation),
    )


def assess_deflections(branch: Branch, grid: TimeGrid, law: MotionLaw, known: KnownDeflections) -> Pass:
    """Evaluate the motion with known deflections; its `change` is their relative residual of balance.

    Args:
        known: function of instants (T,) that returns the deflections and two time derivatives.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    deflections = known(grid.times)
    motion = motion_with_deflections(branch, grid.times, law, deflections)
    values = deflections[0]  # (T, n_e), without their time derivatives
    forces, residual = balancing_forces(branch.robot, motion, values)
    caused = -forces.spring_force / branch.robot.stiffness  # deflections under these spring forces
    return Pass(grid, law, grid.fit(values), values, motion, forces, caused, change=residual)


def _relative_size(robot: ParallelRobot, residual: Array, current: Pass) -> float:
    """Return the largest ratio of a residual (T, n_e) to the largest deflection or spring force.

    A residual is compared as a deflection with the largest deflection, and as a force with the largest force;
    the larger ratio counts. Deflections alone would hide errors of stiff springs, forces alone those of soft
    springs.

    Args:
        residual: deflections [rad, m].
        current: the pass with the largest deflection and force.
    """
    # [rad, robot lengths] a change that is rounding, however small the deflections
    deflection_rounding = 1e-18
    scale = robot.column_scale[robot.elastic]  # (n_e,) robot length if stretched, 1 if turned
    stiffness = robot.stiffness
    if np.abs(residual / scale).max(initial=0.0) <= deflection_rounding:
        return 0.0
    caused = np.abs(current.caused)
    largest_deflection = float((caused / scale).max())  # [rad, robot lengths]
    largest_force = float((caused * stiffness * scale).max())  # as a moment
    weights = np.maximum(1.0 / (scale * largest_deflection), stiffness * scale / largest_force)  # (n_e,)
    return float((np.abs(residual) * weights).max())


# ------------------------------------------------------------------ one pass


def pass_at_rest(branch: Branch, grid: TimeGrid, law: MotionLaw, crossings: Array) -> tuple[Pass, Array]:
    """Compute the pass with springs at rest on a grid of T nodes, and the forces of the open tree.

    All instants are one stack, whose loops are closed and whose motion is computed once.

    Args:
        crossings: instants (k,) [s] of crossings, where the motor torques may have no value.

    Returns:
        The pass; the forces r (k + T, nv) at the crossings, then on the grid.
    """
    robot, k = branch.robot, len(crossings)
    motion = motion_at_rest(branch, np.concatenate([crossings, grid.times]), law)  # at k + T instants
    on_grid = motion.select(slice(k, None))
    r = tree_forces(robot, motion)  # (k + T, nv)
    forces = balanced_forces(robot, on_grid.linearised, r[k:])
    q_e = np.zeros(forces.spring_force.shape)
    caused = -forces.spring_force / robot.stiffness  # q_e = -K^-1 f, as in this file's docstring
    return Pass(grid, law, grid.fit(q_e), q_e, on_grid, forces, caused), r


def evaluate_pass(
    branch: Branch, grid: TimeGrid, law: MotionLaw, deflections: TimeFunction, neighbour: Pass | None
) -> Pass:
    """Compute motion and forces with given deflections, and the caused deflections -force/K.

    Args:
        deflections: deflections (n_e) as a function of time.
        neighbour: a pass with similar deflections, from whose configurations the loops are closed; None to
            close the loops from the branch.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    at_nodes = grid.values(deflections)  # the deflections and two time derivatives, (T, n_e) each
    motion = motion_with_deflections(branch, grid.times, law, at_nodes, neighbour)
    forces = joint_forces(branch.robot, motion)
    caused = -forces.spring_force / branch.robot.stiffness  # Eq. (3b) with linear springs
    return Pass(grid, law, deflections, at_nodes[0], motion, forces, caused)


def motion_with_deflections(
    branch: Branch,
    times: Array,
    law: MotionLaw,
    deflections: tuple[Array, Array, Array],
    neighbour: Pass | None = None,
) -> Motion:
    """Compute the motion of all joints at instants (T,) with given deflections.

    The loops are closed by Newton's method from a guess: the branch's configurations with the springs
    deflected or, nearer, one step along the tangent from a neighbour.

    Args:
        branch: configurations along the path, springs at rest.
        times: instants [s].
        deflections: values, first and second time derivatives, each (T, n_e).
        neighbour: a pass at the same instants with similar deflections; None without one.
    """
    robot = branch.robot
    q_e, *deflection_rates = deflections
    s_and_rates = law_derivatives(law, times)  # s and two time derivatives, (T,) each
    x, dx, ddx = time_derivatives(branch.path, s_and_rates)
    if neighbour is None:
        guess = integrate_columns(robot, branch.guess(s_and_rates[0]), robot.elastic, q_e)
    else:  # the neighbour's loop equations are already factored, so a step along the tangent is cheap
        linearised = neighbour.motion.linearised
        # (T, n) twist from the neighbour's pose to x
        platform_step = -robot.platform.residual(linearised.frames, x)
        step = joint_rates(robot, linearised, platform_step, q_e - neighbour.q_e)
        guess = integrate(robot, neighbour.motion.q, step)
    closed = close_loops(robot, x, guess)
    # the motion, under the external wrenches at these s
    return branch.load_motion(motion_at(robot, closed, dx, ddx, *deflection_rates), s_and_rates[0])


def motion_at_rest(branch: Branch, times: Array, law: MotionLaw) -> Motion:
    """Compute the motion of all joints at instants (T,) [s] on the branch itself, springs at rest."""
    s_and_rates = law_derivatives(law, times)  # s and two time derivatives, (T,) each
    _x, dx, ddx = time_derivatives(branch.path, s_and_rates)
    return branch.load_motion(motion_at(branch.robot, branch.close(s_and_rates[0]), dx, ddx), s_and_rates[0])
