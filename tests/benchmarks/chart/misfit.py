"""Panel of the map of failure: the deformed 5R beside its loaded condition, over the load and the misfit.

The law crosses `misfit` (of the path) beside the singular point of the deformed robot. Then there is no
equilibrium in a band about that point, whatever the torque, and away from it there is one: the right answer
is no. Judged are the elongations of the rods, as near to the point as 10 us; an answer where there is none
counts as wrong. Springs are softer by the factor that the load over the stiffness is more than the paper's.
"""

from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import cache, partial

import numpy as np
from scipy import optimize
from scipy.interpolate import make_interp_spline

from framework import Condition, Law, inverse_dynamics
from framework.dynamics.finite_differences import finite_difference_torques
from framework.numerics.arrays import Array
from tests.benchmarks.chart import closed_form, elastic_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.elastic import (
    FEW,
    SPEED,
    T_C,
    T,
    branch_of,
    repeated_on_nodes,
    rod_columns,
    scaled,
)
from tests.benchmarks.chart.measure import Method, Outcome, Setting, pairs

LOADS = (0.01, 0.1, 1.0, 3.0, 10.0, 16.0)  # over the stiffness, over the paper's
MISFITS = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2)  # of the path
NEAREST = 5  # decades of seconds to the singular point
SAMPLES, DEGREE = 257, 5  # of tables, read by a spline
NO_ANSWER = 1e3  # error of an answer where there is none

Rods = Callable[[Array], Array]  # times (T,) -> elongations (T, 2) [m]


@cache
def law(cell: Setting) -> Law:
    """Through the point that is `misfit` beside the singular one of the deformed robot."""
    s_c = float(elastic_form.elastic_motion(1 / cell[0]).motion.s_c) + cell[1]
    inner = [Condition(T_C, order, value) for order, value in enumerate((s_c, SPEED, 0.0))]
    return Law.rest_to_rest(T, elastic_form.SMOOTHNESS, inner)


def _proved(cell: Setting) -> Callable[[], Rods]:
    robot, chosen = scaled(1 / cell[0]), law(cell)
    columns = rod_columns(robot)

    def run() -> Rods:
        deflections = inverse_dynamics(robot, given.path(), chosen, geometry="deformed").deflections
        return lambda t: deflections(t)[:, columns]

    return run


def _repeated(cell: Setting) -> Callable[[], Rods]:
    branch, chosen = branch_of(1 / cell[0]), law(cell)
    return lambda: repeated_on_nodes(branch, chosen).rods


def _differences(cell: Setting) -> Callable[[], Rods]:
    branch, chosen = branch_of(1 / cell[0]), law(cell)

    def run() -> Rods:
        table = finite_difference_torques(
            branch.robot, branch.path, chosen, samples=SAMPLES, geometry="deformed", passes=FEW, branch=branch
        )
        rods = table.deflection[:, rod_columns(branch.robot)]
        sound = np.isfinite(rods).all(axis=1)
        return make_interp_spline(table.time[sound], rods[sound], k=DEGREE)

    return run


def _root(cell: Setting) -> Callable[[], Rods]:
    """scipy's root, instant by instant, on the two equations of the 5R in floats, from the instant before."""
    chosen, stiffness = law(cell), float(closed_form.ROD_STIFFNESS) / cell[0]
    length, payload = float(closed_form.LENGTH), float(closed_form.PAYLOAD)
    start, end = (complex(*map(float, point)) for point in (closed_form.START, closed_form.END))
    times = np.linspace(0.0, T, SAMPLES)
    bases, elbows = np.array(list(map(float, closed_form.BASES))), np.array(closed_form.ELBOWS)

    def lacking(stretch: Array, x: complex, load: complex) -> Array:
        eps = (stretch - 1) * length
        reach = x - bases
        square = np.abs(reach) ** 2
        along_ = ((length**2 - (length + eps) ** 2) / square + 1) / 2
        rod = reach - (along_ + 1j * elbows * np.sqrt(length**2 / square - along_**2)) * reach
        below = (np.conj(rod[0]) * rod[1]).imag
        share = np.array([(np.conj(load) * rod[1]).imag, (np.conj(rod[0]) * load).imag]) / below
        return np.asarray((eps - share * (length + eps) / stiffness) / length)

    def run() -> Rods:
        x, loads = start + chosen(times) * (end - start), -payload * chosen(times, 2) * (end - start)
        table, stretch = np.empty((SAMPLES, 2)), np.ones(2)
        for k in range(SAMPLES):
            solved = optimize.root(lacking, stretch, (x[k], loads[k]), tol=1e-14)
            if not (solved.success or np.abs(solved.fun).max() < 1e-12):
                raise ArithmeticError(f"scipy's root at t = {times[k]:.4g} s: {solved.message}")
            stretch = solved.x
            table[k] = (stretch - 1) * length
        return make_interp_spline(times, table, k=DEGREE)

    return run


@cache
def _exact(cell: Setting) -> tuple[Array, Array | None]:
    """Instants (T,) [s] on both sides of the point, and elongations (T, 2) [m]; None where there are none."""
    scale = 1 / cell[0]
    solved = elastic_form.elastic_motion(scale)
    with localcontext(prec=closed_form.DIGITS):
        s_c = solved.motion.s_c
        powers = closed_form.law_through(s_c + Decimal(cell[1]), Decimal(0), elastic_form.SMOOTHNESS)
        motion = closed_form.ExactMotion(powers, s_c, Decimal(0))
        pole = motion.singular_time()
        try:
            ways = [
                elastic_form.followed(
                    motion,
                    [pole + side * d for d in _approach(pole)],
                    closed_form.ROD_STIFFNESS * solved.scale,
                )
                for side in (-1, 1)
            ]
        except ArithmeticError:
            return np.empty(0), None
        times = [[float(pole + side * d) for d in _approach(pole)] for side in (-1, 1)]
    return np.concatenate(times), np.array([*ways[0], *ways[1]], dtype=float)


def _approach(pole: Decimal) -> list[Decimal]:
    """Distances [s] from far to near, each half the one before."""
    far = min(pole, closed_form.DURATION - pole) * Decimal("0.99")
    near = [far / 2**k for k in range(60)]
    return [d for d in near if d > Decimal(10) ** -NEAREST]


def _judged(rods_of: Callable[[Setting], Callable[[], Rods]]) -> Callable[[Setting], Callable[[], Outcome]]:
    """Errors of the rods over their largest elongation."""

    def prepare(cell: Setting) -> Callable[[], Outcome]:
        run, (times, exact) = rods_of(cell), _exact(cell)

        def judged() -> Outcome:
            rods = run()
            if exact is None:
                return Outcome(np.array([NO_ANSWER]), np.zeros(1), 1.0)
            return Outcome(rods(times), exact, float(np.abs(exact).max()))

        return judged

    return prepare


_TABLE = f"{SAMPLES} samples, spline of degree {DEGREE}"
UNIT = "load / stiffness, misfit [path]"
_declared = partial(Method, given="path and law", unit=UNIT, settings=pairs(LOADS, MISFITS))
METHODS = (
    _declared("proved", "ours, proved", _judged(_proved)),
    _declared("root", "scipy root at each instant", _judged(_root), source=f"hybr to 1e-14, {_TABLE}"),
    _declared("repeated", "plain repetition", _judged(_repeated), source="as in the stage elastic"),
    _declared("differences", f"differences, {FEW} passes", _judged(_differences), source=_TABLE),
)
