"""One iteration for every flexibility: deflections that hold the forces that they cause.

On the time nodes: close the loops at x(t) and q_e(t), take the forces of the tree with all coordinates
and their time derivatives, put q_e = -K^-1 (force on the elastic coordinates), repeat. The first pass,
at q_e = 0, is the small-displacement hypothesis of Briot and Arakelian 2010 (A and B of the rigid
robot). A rigid robot has no springs and needs that pass only.

With G(q_e) the deflections that the forces at q_e cause, sought is a polynomial in time with q_e = G(q_e).
Springs that carry inertia make that a differential equation, K q_e + M q_e" = f, whose solutions differ by
free vibrations; the passes from q_e = 0 build up the one without, q_e = K^-1 f - K^-1 M (K^-1 f)" + ...
Where the motion is slow against the vibrations a few passes are enough. Else they grow again after their
smallest change, first at the end nodes: a second derivative amplifies rounding by the fourth power of the
degree, so that dG is far from normal, though nearly nilpotent. Then Newton's method takes over,

    (I - dG) step = G(q_e) - q_e,

solved by GMRES, which needs dG along some directions only, one pass each: its k-th step is the best of all
combinations of k passes, of which plain repetition is one. It works on as many coefficients of q_e as are
needed, found by raising their number until what is cut off is small enough.
What is left in the end, the change that one more pass would make, belongs to the result
(`DeflectionSolution.change`).

Source: Knoll and Keyes, Jacobian-free Newton-Krylov methods, J. Comput. Phys. 193 (2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from framework.arrays import Array
from framework.dynamics.elastic_pass import Pass, moving, moving_with, one_pass, spring_scale
from framework.dynamics.forces import Forces
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.loaded_balance import forces_in_balance
from framework.errors import NoAnswer, NotConverged
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.krylov import gmres
from framework.motion.chebyshev import TimeFunction, TimeGrid
from framework.motion.law import MotionLaw
from framework.tolerances import MAX_DEFLECTION, SETTLED_SHARE

GOOD_CONTRACTION = 0.3  # of the change, by a pass; where it is less, Newton's method takes over
DEFLECTION_ROUNDING = 1e-18  # [rad, robot lengths] a change of no meaning, however small the deflections
DIFFERENCE_STEP = 1e-6  # of the deflections, along a direction: half of the digits, some for curvature
GMRES_TOLERANCE = 1e-3  # of the change: what differences can tell and curvature allows
MIN_SINGULAR_RATIO = 1e-5  # of the size of I - dG: below it a direction is a free vibration, not asked for
MAX_GMRES_DIRECTIONS = 50  # dG is nearly nilpotent on few coefficients, and hopeless where it takes more
MIN_STEP_SHARE = 1 / 64  # of a step of Newton's method
ROUNDING_CHANGE = 1e-6  # a change so small is rounding where a step leaves more than the next share of it
STALLED_SHARE = 0.5  # of the change: a shortened step is taken at once where it leaves less
MAX_PASSES, MAX_PASSES_OF_MANY_NODES = 200, 12  # on one grid: of few nodes, of very many
MAX_PASS_NODES = 200 * 128  # passes times nodes on one grid: what costs more is nearly hopeless
MIN_GROWTH, MAX_GROWTH = 1.2, 1.5  # times the coefficients, when some are to be added
# The law to use when the robot deflects like this, after this law; None before the first pass.
LawChoice = Callable[[TimeFunction | None, MotionLaw | None], MotionLaw]


@dataclass(frozen=True, eq=False)
class DeflectionSolution:
    """The motion on the nodes of `grid`, its forces, and the deflections that it has and causes."""

    grid: TimeGrid
    law: MotionLaw
    motion: Motion
    forces: Forces
    deflections: TimeFunction  # (n_e) of `motion`, or where a pass makes them better, what its forces cause
    caused: Array  # (T, n_e) deflections that `forces` cause
    passes: int = 1
    change: float = 0.0  # that one more pass would make, over the largest deflection or spring force
    plain: bool = True  # no need of Newton's method
    obstacle: str = ""  # what ended the iteration; empty if the grid can tell no more, or need not


def solve_deflections(
    branch: Branch,
    grid: TimeGrid,
    choose_law: LawChoice,
    geometry: str,
    start: TimeFunction | None,
    before: MotionLaw,
    *,
    tolerance: float = 1e-10,
    is_fine: Callable[[Pass], bool] = lambda _: True,
) -> DeflectionSolution:
    """Deflections and forces at the nodes of the grid, as near to agreement as they come.

    Args:
        geometry: "rigid" takes the forces at q_e = 0 and only moves the motors by what they deflect;
            "deformed" goes on until the deflections settle.
        start, before: the deflections and the law to begin with.
        tolerance: change over the largest deflection that counts as settled.
        is_fine: whether the grid resolves the forces of the undeformed robot; if not, no deflections are
            sought on it.

    Raises:
        NotConverged: the springs are too soft: the forces of the undeformed robot deflect them by more
            than a linear spring can mean.
        NotAssembled: the first deflections tear the loops.
    """
    robot = branch.robot
    if geometry == "rigid" or start is None:
        rest = TimeFunction(grid.edges, np.zeros((len(grid.edges) - 1, grid.size, robot.n_e)))
        here = one_pass(branch, grid, before, rest, None)
        if geometry == "rigid":
            return _small_displacements(branch, grid, here)
        _check_stiffness(robot, grid, here)
        if not is_fine(here):
            return DeflectionSolution(
                grid, here.law, here.motion, here.forces, rest, here.caused, change=np.inf
            )
    else:
        function = grid.fit_truncated(start(grid.times))
        here = one_pass(branch, grid, choose_law(function, before), function, None)
    return _Iteration(branch, grid, choose_law, tolerance).run(here)


def given_deflections(
    branch: Branch, grid: TimeGrid, law: MotionLaw, known: KnownDeflections
) -> DeflectionSolution:
    """Deflections that are known, and how far they are from those that their forces cause.

    Raises:
        NotAssembled: they tear the loops.
    """
    deflections = known(grid.times)
    motion = moving_with(branch, grid.times, law, deflections)
    forces, change = forces_in_balance(branch.robot, motion, deflections[0])
    caused = -forces.spring_force / branch.robot.stiffness
    return DeflectionSolution(grid, law, motion, forces, grid.fit(deflections[0]), caused, change=change)


def _small_displacements(branch: Branch, grid: TimeGrid, here: Pass) -> DeflectionSolution:
    deflections, motion = grid.fit(here.caused), here.motion
    if branch.robot.n_e:
        motion = moving(branch, grid, here.law, deflections, here)[1]
    return DeflectionSolution(grid, here.law, motion, here.forces, deflections, here.caused)


def _check_stiffness(robot: ParallelRobot, grid: TimeGrid, here: Pass) -> None:
    size = np.abs(here.caused / spring_scale(robot))
    if np.all(size <= MAX_DEFLECTION):
        return
    instant, k = np.unravel_index(int(np.argmax(np.nan_to_num(size, nan=np.inf))), size.shape)
    unit = "m" if robot.sliding[robot.elastic][k] else "rad"
    raise NotConverged(
        f"{robot.name}: the springs are too soft for so quick a motion: the forces of the undeformed robot "
        f"would deflect {robot.elastic_names[k]} by {abs(here.caused[instant, k]):.3g} {unit} at t = "
        f"{grid.times[instant]:.4g} s; use stiffer springs or geometry rigid",
        residual=float(size[instant, k]),
    )


@dataclass
class _Iteration:
    """Plain passes, and then Newton's method, from one pass on."""

    branch: Branch
    grid: TimeGrid
    choose_law: LawChoice
    tolerance: float
    passes: int = 1
    obstacle: str = ""

    def run(self, here: Pass) -> DeflectionSolution:
        """Until the change within what the grid resolves is settled, or is the least to be had."""
        # what a pass leaves of the change, as far as is known
        ratio, last = GOOD_CONTRACTION, (here, np.inf)
        while True:
            following = self.grid.fit_truncated(here.caused)
            step = following.coefficients - here.function.coefficients
            lacking = self.grid.values(TimeFunction(self.grid.edges, step))[0]
            inner, outer = self._share(lacking, here), self._share(here.residual - lacking, here)
            if np.isfinite(last[1]):
                ratio = inner / last[1]
            if inner <= self.tolerance and inner * ratio <= SETTLED_SHARE * self.tolerance:
                return self._result(here, following)
            if inner <= outer:
                return self._result(here, here.function)
            if ratio > GOOD_CONTRACTION:
                break
            last = here, inner
            try:
                here = self._at(here, following)
            except NoAnswer:
                break
        here = self._newton(here if ratio < 1 else last[0])
        return replace(self._result(here, here.function), plain=False)

    def _newton(self, here: Pass) -> Pass:
        """Steps of Newton's method on ever more coefficients."""
        count = self._resolved_count(here)
        cut = here.function.coefficients.copy()
        cut[:, count:] = 0.0
        try:
            here = self._at(here, TimeFunction(self.grid.edges, cut))
        except NoAnswer as failure:
            self.obstacle = str(failure)
            return here
        stalled = False
        while self.passes < self._max_passes:
            inner, outer = self._within(here, count)
            settled = inner <= max(outer, SETTLED_SHARE * self.tolerance)
            new = None if settled else self._improved(here, count, inner)
            if new is not None:
                here, stalled = new, False
                continue
            resolved = settled and outer <= SETTLED_SHARE * self.tolerance
            if resolved or count == self.grid.resolvable or (stalled and not settled):
                break
            count, stalled = self._needed_count(count, max(inner, outer)), not settled
        return here

    @property
    def _max_passes(self) -> int:
        """Passes at most, fewer where each looks at more nodes."""
        return min(MAX_PASSES, max(MAX_PASSES_OF_MANY_NODES, MAX_PASS_NODES // len(self.grid.times)))

    def _resolved_count(self, here: Pass) -> int:
        """How many coefficients of the deflections the change does not hide."""
        series = np.abs(self.grid.fit(here.caused * self._weights(here)).coefficients)
        known = (series > self._share(here.residual, here) * series.max()).any(axis=(0, 2))
        return min(self.grid.resolvable, int(np.flatnonzero(known).max(initial=7)) + 1)

    def _needed_count(self, count: int, outer: float) -> int:
        """How many it takes if they go on falling as they did, to `outer` after this many."""
        falling = np.log(SETTLED_SHARE * self.tolerance) / np.log(min(outer, 0.5))
        needed = np.ceil(count * min(max(falling, MIN_GROWTH), MAX_GROWTH))
        return min(self.grid.resolvable, int(needed))

    def _improved(self, here: Pass, count: int, inner: float) -> Pass | None:
        """The pass after a step, halved until it helps; None if it does not, or has come to rounding."""
        try:
            wanted = SETTLED_SHARE * SETTLED_SHARE * self.tolerance / inner
            step = self._step(here, count, max(GMRES_TOLERANCE, wanted))
        except NoAnswer as failure:
            self.obstacle = str(failure)
            return None
        share = 1.0
        least = MIN_STEP_SHARE if inner > ROUNDING_CHANGE else 1.0
        while share >= least and self.passes < self._max_passes:
            series = here.function.coefficients + share * step
            series[:, count:] = 0.0
            try:
                new = self._at(here, TimeFunction(self.grid.edges, series))
            except NoAnswer as failure:
                self.obstacle = str(failure)
            else:
                left = self._within(new, count)[0] / inner
                if left < STALLED_SHARE or (left < 1.0 - 0.1 * share and inner > ROUNDING_CHANGE):
                    self.obstacle = ""
                    return new
            share *= 0.5
        self.obstacle = self.obstacle or "no step of Newton's method brings them nearer"
        return None

    def _step(self, here: Pass, count: int, left: float) -> Array:
        """Coefficients of a step of Newton's method, a share of the change left by its linear equations."""
        weights = self._weights(here)

        def leading(values: Array) -> Array:
            """The first coefficients of values (T, n_e), weighted, as one vector."""
            return self.grid.fit(values * weights).coefficients[:, :count].ravel()

        def step(unknowns: Array) -> Array:
            series = np.zeros_like(here.function.coefficients)
            series[:, :count] = unknowns.reshape(len(series), count, -1) / weights
            return series

        def applied(direction: Array) -> Array:
            """(I - dG) along a direction."""
            series = here.function.coefficients + width * step(direction)
            moved = self._at(here, TimeFunction(self.grid.edges, series))
            return direction - leading(moved.caused - here.caused) / width

        right = leading(here.residual)
        most = min(MAX_GMRES_DIRECTIONS, max(1, self._max_passes - self.passes))
        width = DIFFERENCE_STEP * float(np.linalg.norm(leading(here.caused)))
        return step(gmres(applied, right, left=left, most=most, weak=MIN_SINGULAR_RATIO))

    def _at(self, here: Pass, function: TimeFunction) -> Pass:
        """The pass at these deflections, near another one.

        Raises:
            NoAnswer: it does not exist.
        """
        self.passes += 1
        largest = float(np.abs(self.grid.values(function)[0] / spring_scale(self.branch.robot)).max())
        if not largest <= MAX_DEFLECTION:
            raise NotConverged(f"deflections of {largest:.3g} rad or robot lengths", residual=largest)
        return one_pass(self.branch, self.grid, self.choose_law(function, here.law), function, here)

    def _within(self, here: Pass, count: int) -> tuple[float, float]:
        """The parts of what a pass lacks in the first coefficients, and in the others."""
        series = self.grid.fit(here.residual).coefficients.copy()
        series[:, count:] = 0.0
        within = self.grid.values(TimeFunction(self.grid.edges, series))[0]
        return self._share(within, here), self._share(here.residual - within, here)

    def _share(self, lacking: Array, here: Pass) -> float:
        """`lacking` over the largest deflection or the largest spring force, whichever is more."""
        if np.abs(lacking / spring_scale(self.branch.robot)).max(initial=0.0) <= DEFLECTION_ROUNDING:
            return 0.0
        return float((np.abs(lacking) * self._weights(here)).max())

    def _weights(self, here: Pass) -> Array:
        """One over the deflection (n_e,) that is as much as the largest, or whose force is."""
        scale, stiffness = spring_scale(self.branch.robot), self.branch.robot.stiffness
        caused = np.abs(here.caused)
        largest, force = float((caused / scale).max()), float((caused * stiffness * scale).max())
        return np.maximum(1.0 / (scale * largest), stiffness * scale / force)

    def _result(self, here: Pass, deflections: TimeFunction) -> DeflectionSolution:
        return DeflectionSolution(
            grid=self.grid,
            law=here.law,
            motion=here.motion,
            forces=here.forces,
            deflections=deflections,
            caused=here.caused,
            passes=self.passes,
            change=self._share(here.residual, here),
            obstacle=self.obstacle,
        )
