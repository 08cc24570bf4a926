"""Fixed-point and Newton iteration of forces and deflections to balance, for every flexibility.

A pass closes the loops at x(t) and q_e(t) on the time nodes, computes the forces of the tree with all
coordinates and their time derivatives, and returns q_e = -K^-1 (force on the elastic coordinates). The first
pass, at q_e = 0, is the small-displacement hypothesis of Briot and Arakelian 2010 (A and B of the rigid
robot). A rigid robot has no springs and needs only this pass.

Let G(q_e) be the deflections caused by the forces at q_e. The unknown is a polynomial in time with
q_e = G(q_e). If springs carry inertia, this is a differential equation, K q_e + M q_e" = f, whose solutions
differ by free vibrations. Passes from q_e = 0 converge to the solution without vibrations,
q_e = K^-1 f - K^-1 M (K^-1 f)" + ... A few passes suffice if the motion is slow compared with the vibrations.
Otherwise the change grows again after a minimum, first at the end nodes: a second derivative amplifies
rounding by the fourth power of the degree, so that dG is far from normal, though nearly nilpotent. Newton's
method then follows,

    (I - dG) step = G(q_e) - q_e.

GMRES solves for the step. It needs dG along a few directions only, with one pass each; its k-th iterate is
the best combination of k passes. The number of coefficients of q_e is raised until the truncation error is
small enough. The result includes the change by one more pass (`DeflectionSolution.change`).

Source: Knoll and Keyes, Jacobian-free Newton-Krylov methods, J. Comput. Phys. 193 (2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from framework.dynamics.elastic_pass import (
    Pass,
    evaluate_deflected_motion,
    evaluate_pass,
    motion_with_deflections,
    spring_scale,
)
from framework.dynamics.forces import Forces
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.loaded_balance import balancing_forces
from framework.errors import NoAnswer, NotConverged
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.numerics.krylov import gmres
from framework.numerics.time_limit import check_time
from framework.tolerances import MAX_DEFLECTION, SETTLED_SHARE

GOOD_CONTRACTION = 0.3  # change by a pass over that by the last pass; above, Newton's method follows
DEFLECTION_ROUNDING = 1e-18  # [rad, robot lengths] a change that is rounding, however small the deflections
DIFFERENCE_STEP = 1e-6  # relative, of deflections: balances rounding and curvature of differences
GMRES_TOLERANCE = 1e-3  # of the residual: the accuracy of differences and curvature
MIN_SINGULAR_RATIO = 1e-5  # of the size of I - dG: directions below are free vibrations, and left out
MAX_GMRES_DIRECTIONS = 50  # dG is nearly nilpotent on few coefficients; more directions do not help
MIN_STEP_SHARE = 1 / 64  # of a Newton step in the line search
ROUNDING_CHANGE = 1e-6  # a smaller change counts as rounding unless a step reduces it below STALLED_SHARE
STALLED_SHARE = 0.5  # of the change: a shortened step that reduces it to less is accepted at once
MAX_PASSES, MAX_PASSES_OF_MANY_NODES = 200, 12  # on one grid: of few nodes, of very many
MAX_PASS_NODES = 200 * 128  # passes times nodes on one grid: costlier motions rarely converge
FEWEST_COEFFICIENTS = 8  # of deflections
MIN_GROWTH, MAX_GROWTH = 1.2, 1.5  # factors of the number of coefficients, when some are added
# chooses the law for given deflections and the law of the last pass; both are None before the first pass
LawChoice = Callable[[TimeFunction | None, MotionLaw | None], MotionLaw]


@dataclass(frozen=True, eq=False)
class DeflectionSolution:
    """The motion on the nodes of a grid, its forces, and its deflections before and after a pass."""

    grid: TimeGrid
    law: MotionLaw
    motion: Motion
    forces: Forces
    deflections: TimeFunction  # (n_e) of `motion`, or caused by its forces if a pass improves them
    caused: Array  # (T, n_e) deflections that `forces` cause
    passes: int = 1
    change: float = 0.0  # by one more pass, over the largest deflection or spring force
    plain: bool = True  # whether passes sufficed, without Newton's method
    obstacle: str = ""  # why the iteration ended; empty at convergence or at the resolution of the grid


def solve_deflections(
    branch: Branch,
    grid: TimeGrid,
    choose_law: LawChoice,
    geometry: str,
    start: TimeFunction | None,
    first_law: MotionLaw,
    *,
    tolerance: float = 1e-10,
    is_fine: Callable[[Pass], bool] = lambda _: True,
) -> DeflectionSolution:
    """Solve for deflections and forces at the nodes of the grid.

    Args:
        geometry: "rigid" computes forces at q_e = 0, and corrects the motors for the deflections; "deformed"
            iterates until the deflections settle.
        start, first_law: deflections and law from which the iteration begins.
        tolerance: relative change of deflections that counts as settled.
        is_fine: whether the grid resolves the forces of the undeformed robot; if not, the iteration is left
            to a finer grid.

    Raises:
        NotConverged: the springs are too soft: the forces of the undeformed robot deflect them beyond the
            range of a linear spring.
        NotAssembled: the first deflections tear the loops.
    """
    robot = branch.robot
    if geometry == "rigid" or start is None:
        rest = TimeFunction(grid.edges, np.zeros((len(grid.edges) - 1, grid.size, robot.n_e)))
        current = evaluate_pass(branch, grid, first_law, rest, None)
        if geometry == "rigid":
            return _small_displacements(branch, grid, current)
        _check_stiffness(robot, grid, current)
        if not is_fine(current):
            return DeflectionSolution(
                grid, current.law, current.motion, current.forces, rest, current.caused, change=np.inf
            )
    else:
        function = grid.fit_truncated(start(grid.times))
        current = evaluate_pass(branch, grid, choose_law(function, first_law), function, None)
    return _Iteration(branch, grid, choose_law, tolerance).run(current)


def assess_deflections(
    branch: Branch, grid: TimeGrid, law: MotionLaw, known: KnownDeflections
) -> DeflectionSolution:
    """Evaluate the motion with known deflections, and their distance from balance.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    deflections = known(grid.times)
    motion = motion_with_deflections(branch, grid.times, law, deflections)
    values = deflections[0]  # (T, n_e), without their time derivatives
    forces, residual = balancing_forces(branch.robot, motion, values)
    caused = -forces.spring_force / branch.robot.stiffness  # deflections under these spring forces
    return DeflectionSolution(grid, law, motion, forces, grid.fit(values), caused, change=residual)


def _small_displacements(branch: Branch, grid: TimeGrid, current: Pass) -> DeflectionSolution:
    """Return the deflections caused by forces of the undeformed robot, and the deflected motion."""
    deflections = grid.fit(current.caused)
    motion = current.motion
    if branch.robot.n_e:
        motion = evaluate_deflected_motion(branch, grid, current.law, deflections, current)[1]
    return DeflectionSolution(grid, current.law, motion, current.forces, deflections, current.caused)


def _check_stiffness(robot: ParallelRobot, grid: TimeGrid, current: Pass) -> None:
    """Raise NotConverged if forces of the undeformed robot deflect springs beyond `MAX_DEFLECTION`."""
    size = np.abs(current.caused / spring_scale(robot))
    if np.all(size <= MAX_DEFLECTION):
        return
    instant, k = np.unravel_index(np.argmax(np.nan_to_num(size, nan=np.inf)), size.shape)
    unit = "m" if robot.sliding[robot.elastic][k] else "rad"
    raise NotConverged(
        f"{robot.name}: the springs are too soft for so quick a motion: the forces of the undeformed robot "
        f"would deflect {robot.elastic_names[k]} by {abs(current.caused[instant, k]):.3g} {unit} at t = "
        f"{grid.times[instant]:.4g} s; use stiffer springs or geometry rigid",
        residual=float(size[instant, k]),
    )


@dataclass
class _Iteration:
    """The iteration for deflections: passes, then Newton's method if passes do not contract."""

    branch: Branch
    grid: TimeGrid
    choose_law: LawChoice
    tolerance: float
    passes: int = 1
    obstacle: str = ""

    def run(self, current: Pass) -> DeflectionSolution:
        """Repeat passes while the change contracts; then apply Newton's method.

        Passes end if the change is settled, or below the truncation error of the grid, which they cannot
        reduce.
        """
        contraction = GOOD_CONTRACTION
        previous = current
        last_change = np.inf
        while True:
            following = self.grid.fit_truncated(current.caused)
            resolved = following.coefficients - current.function.coefficients
            change, truncation = self._split_residual(current, resolved)
            if np.isfinite(last_change):
                contraction = change / last_change
            if change <= self.tolerance and change * contraction <= SETTLED_SHARE * self.tolerance:
                return self._solution_of_pass(current, following)
            if change <= truncation:
                return self._solution_of_pass(current, current.function)
            if contraction > GOOD_CONTRACTION:
                break
            previous = current
            last_change = change
            try:
                current = self._evaluate_near(current, following)
            except NoAnswer:
                break
        current = self._newton(current if contraction < 1 else previous)
        return replace(self._solution_of_pass(current, current.function), plain=False)

    def _newton(self, current: Pass) -> Pass:
        """Apply Newton's method to a growing number of coefficients."""
        count = self._resolved_count(current)
        truncated = current.function.coefficients.copy()
        truncated[:, count:] = 0.0
        try:
            current = self._evaluate_near(current, TimeFunction(self.grid.edges, truncated))
        except NoAnswer as failure:
            self.obstacle = str(failure)
            return current
        stalled = False
        while self.passes < self._max_passes:
            check_time()
            change, truncation = self._split_at(current, count)
            is_settled = change <= max(truncation, SETTLED_SHARE * self.tolerance)
            new = None if is_settled else self._line_search(current, count, change)
            if new is not None:
                current = new
                stalled = False
                continue
            is_resolved = is_settled and truncation <= SETTLED_SHARE * self.tolerance
            if is_resolved or count == self.grid.resolvable or (stalled and not is_settled):
                break
            count = self._needed_count(count, max(change, truncation))
            stalled = not is_settled
        return current

    @property
    def _max_passes(self) -> int:
        """The largest number of passes, which falls with the number of nodes."""
        return min(MAX_PASSES, max(MAX_PASSES_OF_MANY_NODES, MAX_PASS_NODES // len(self.grid.times)))

    def _resolved_count(self, current: Pass) -> int:
        """Count the coefficients of the deflections that stand out from the noise of the iteration.

        The noise is the relative change of the deflections by the pass, times the largest coefficient. The
        count runs up to the last coefficient above the noise, and is at least FEWEST_COEFFICIENTS.
        """
        series = np.abs(self.grid.fit(current.caused * self._unit_weights(current)).coefficients)
        noise = self._relative_size(current.residual, current) * series.max()
        above_noise = np.flatnonzero((series > noise).any(axis=(0, 2)))  # on any panel, of any spring
        return int(np.clip(above_noise.max(initial=0) + 1, FEWEST_COEFFICIENTS, self.grid.resolvable))

    def _needed_count(self, count: int, truncation: float) -> int:
        """Estimate the necessary number of coefficients from the truncation error of `count` coefficients.

        An error that falls as e^(-r count) is settled at count log(settled) / log(error).
        """
        decay = np.log(SETTLED_SHARE * self.tolerance) / np.log(min(truncation, 0.5))
        needed = np.ceil(count * min(max(decay, MIN_GROWTH), MAX_GROWTH))
        return min(self.grid.resolvable, int(needed))

    def _line_search(self, current: Pass, count: int, change: float) -> Pass | None:
        """Halve a Newton step until the change falls; return the pass after the step, or None."""
        try:
            target = SETTLED_SHARE * SETTLED_SHARE * self.tolerance / change
            step = self._newton_step(current, count, max(GMRES_TOLERANCE, target))
        except NoAnswer as failure:
            self.obstacle = str(failure)
            return None
        share = 1.0
        least_share = MIN_STEP_SHARE if change > ROUNDING_CHANGE else 1.0
        while share >= least_share and self.passes < self._max_passes:
            series = current.function.coefficients + share * step
            series[:, count:] = 0.0
            try:
                new = self._evaluate_near(current, TimeFunction(self.grid.edges, series))
            except NoAnswer as failure:
                self.obstacle = str(failure)
            else:
                ratio = self._split_at(new, count)[0] / change
                if ratio < STALLED_SHARE or (ratio < 1.0 - 0.1 * share and change > ROUNDING_CHANGE):
                    self.obstacle = ""
                    return new
            share *= 0.5
        self.obstacle = self.obstacle or "no step of Newton's method brings them nearer"
        return None

    def _newton_step(self, current: Pass, count: int, accuracy: float) -> Array:
        """Solve (I - dG) step = G(q_e) - q_e for coefficients (panels, size, n_e) of the step by GMRES.

        The unknowns are the first `count` coefficients, times weights. `accuracy` is the residual of the
        linear equations over their right side.
        """
        weights = self._unit_weights(current)

        def to_unknowns(values: Array) -> Array:
            """Return the weighted coefficients of values (T, n_e) as one vector."""
            return self.grid.fit(values * weights).coefficients[:, :count].ravel()

        def to_series(unknowns: Array) -> Array:
            """Return the series of unknowns, with zeros from coefficient `count` on."""
            series = np.zeros_like(current.function.coefficients)
            series[:, :count] = unknowns.reshape(len(series), count, -1) / weights
            return series

        def apply_linear(direction: Array) -> Array:
            """Compute (I - dG) direction by the difference of two passes."""
            series = current.function.coefficients + width * to_series(direction)
            perturbed = self._evaluate_near(current, TimeFunction(self.grid.edges, series))
            return direction - to_unknowns(perturbed.caused - current.caused) / width

        right = to_unknowns(current.residual)
        width = DIFFERENCE_STEP * float(np.linalg.norm(to_unknowns(current.caused)))
        most = min(MAX_GMRES_DIRECTIONS, max(1, self._max_passes - self.passes))
        series = gmres(apply_linear, right, tolerance=accuracy, max_products=most, cutoff=MIN_SINGULAR_RATIO)
        return to_series(series)

    def _evaluate_near(self, current: Pass, function: TimeFunction) -> Pass:
        """Evaluate a pass at the deflections `function`, with another pass as first guess.

        Raises:
            NoAnswer: the robot cannot have these deflections.
        """
        self.passes += 1
        q_e = self.grid.values(function)[0]
        largest = float(np.abs(q_e / spring_scale(self.branch.robot)).max())
        if not largest <= MAX_DEFLECTION:  # NaN is refused too
            raise NotConverged(f"deflections of {largest:.3g} rad or robot lengths", residual=largest)
        law = self.choose_law(function, current.law)
        return evaluate_pass(self.branch, self.grid, law, function, current)

    def _split_at(self, current: Pass, count: int) -> tuple[float, float]:
        """Return the relative residual of a pass in its first `count` coefficients, and in all others."""
        series = self.grid.fit(current.residual).coefficients.copy()
        series[:, count:] = 0.0
        return self._split_residual(current, series)

    def _split_residual(self, current: Pass, resolved: Array) -> tuple[float, float]:
        """Return the relative size of a part of the residual, given by its series, and of the rest."""
        values = self.grid.values(TimeFunction(self.grid.edges, resolved))[0]
        return self._relative_size(values, current), self._relative_size(current.residual - values, current)

    def _relative_size(self, residual: Array, current: Pass) -> float:
        """Return the largest residual (T, n_e) relative to the largest deflection or spring force."""
        if np.abs(residual / spring_scale(self.branch.robot)).max(initial=0.0) <= DEFLECTION_ROUNDING:
            return 0.0
        return float((np.abs(residual) * self._unit_weights(current)).max())

    def _unit_weights(self, current: Pass) -> Array:
        """Return weights (n_e,) of deflections, 1 / largest deflection or stiffness / largest force.

        The larger of the two counts.
        """
        scale = spring_scale(self.branch.robot)
        stiffness = self.branch.robot.stiffness
        caused = np.abs(current.caused)
        largest_deflection = float((caused / scale).max())  # [rad, robot lengths]
        largest_force = float((caused * stiffness * scale).max())  # as a moment
        return np.maximum(1.0 / (scale * largest_deflection), stiffness * scale / largest_force)

    def _solution_of_pass(self, current: Pass, deflections: TimeFunction) -> DeflectionSolution:
        """Return the solution of a pass, with its relative change and the obstacle to a smaller one."""
        return DeflectionSolution(
            grid=self.grid,
            law=current.law,
            motion=current.motion,
            forces=current.forces,
            deflections=deflections,
            caused=current.caused,
            passes=self.passes,
            change=self._relative_size(current.residual, current),
            obstacle=self.obstacle,
        )
