"""Panel of the map of failure: condition (8) imposed beside the singular point, against the step.

The law is right for a point that is `offset` away in s, so where the 5R is singular a force is left along t_s
and the true torque has a pole, as infinite as any and the narrower the smaller the offset. A table does not
see it. Errors are against that torque, as near to its pole as 10 us, over the largest one of the right law.
"""

from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import cache

import numpy as np

from framework.laws.law import MotionLaw
from framework.numerics.arrays import Array
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.along import Torque, direct
from tests.benchmarks.chart.measure import Method, Outcome, Setting
from tests.benchmarks.chart.torque import (
    DifferencedLaw,
    T,
    doubled,
    pointwise,
    pseudo_inverse,
    scene_c,
    tabulated,
)

OFFSETS = tuple(10.0**-k for k in (2, 4, 6, 8, 10, 12))  # of the path
STEPS = tuple(T / 2**k for k in (4, 6, 8, 10, 12))  # [s]
MEAN_STEPS = tuple(T / size for size in (16, 32, 64, 128))  # [s] of Chebyshev nodes
NEAREST = 5  # decades of seconds to the pole
DEGREE, CUT, AGREEMENT = 9, 1e-3, 1e-9  # of splines; of singular values; of tables [N m]
PROVED = tuple((offset, 1e-10) for offset in OFFSETS)  # with a tolerance in place of a step
CELLS = tuple((offset, step) for step in STEPS for offset in OFFSETS)


def _tabulated(torque: Callable[[MotionLaw, Array], Array]) -> Callable[[Setting], Callable[[], Torque]]:
    def prepare(setting: Setting) -> Callable[[], Torque]:
        law, samples = given.law(offset=setting[0]), T / setting[1] + 1
        return lambda: tabulated(lambda t: torque(law, t), (samples, DEGREE)).table

    return prepare


def _differences(setting: Setting) -> Callable[[], Torque]:
    law, samples = DifferencedLaw(given.law(offset=setting[0]), setting[1]), T / setting[1] + 1
    return lambda: tabulated(lambda t: pointwise(law, t, direct), (samples, DEGREE)).table


def _doubled(setting: Setting) -> Callable[[], Torque]:
    run = doubled(given.law(offset=setting[0]), AGREEMENT)
    return lambda: run().table


def _nodes(setting: Setting) -> Callable[[], Torque]:
    case = scene_c(given.law(offset=setting[0]))
    return lambda: case.nodes(T / setting[1])


def _proved(setting: Setting) -> Callable[[], Torque]:
    case = scene_c(given.law(offset=setting[0]))
    return lambda: case.proved(setting[1])


@cache
def _exact(offset: float) -> tuple[Array, Array, float]:
    """Instants (T,) [s], torques there (T, 2) [N m], and the largest torque of the right law."""
    motion = given.exact(offset=offset)
    with localcontext(prec=closed_form.DIGITS):
        pole = motion.singular_time()
        near = [float(pole + sign * Decimal(10) ** -k) for k in range(1, NEAREST + 1) for sign in (-1, 1)]
    even = np.delete(np.linspace(0.0, T, 61), 40)  # not the crossing time, which is too near to the pole
    times = np.sort(np.concatenate([even, near]))
    return times, motion.torque(times), float(np.abs(given.exact().torque(even)).max())


def _direct(law: MotionLaw, times: Array) -> Array:
    return pointwise(law, times, direct)


def _cut(law: MotionLaw, times: Array) -> Array:
    return pointwise(law, times, pseudo_inverse(CUT))


def _judged(
    torque_of: Callable[[Setting], Callable[[], Torque]],
) -> Callable[[Setting], Callable[[], Outcome]]:
    """Errors over the largest torque of the right law."""

    def prepare(setting: Setting) -> Callable[[], Outcome]:
        run, (times, exact, size) = torque_of(setting), _exact(setting[0])
        return lambda: Outcome(run()(times), exact, size)

    return prepare


_EXACT, _PATH, _SPLINES = "path followed; s, s', s\" exact", "path and law", "splines of degree 9"
_NODES = tuple((offset, step) for step in MEAN_STEPS for offset in OFFSETS)
_STEP = f"step as in the map, {_SPLINES}"
_TABLES = f"as in the stage torque, until tables agree to {AGREEMENT} N m"
UNIT = "distance to Type 2 [path], step [s]"
METHODS = (
    Method("proved", "ours, proved", _judged(_proved), _PATH, UNIT, PROVED),
    Method("nodes", "ours, nodes, not proved", _judged(_nodes), _EXACT, UNIT, _NODES),
    Method("table", "pointwise", _judged(_tabulated(_direct)), _EXACT, UNIT, CELLS, _SPLINES),
    Method(
        "pseudo_inverse",
        f"pseudo-inverse, cut {CUT:.0e}",
        _judged(_tabulated(_cut)),
        _EXACT,
        UNIT,
        CELLS,
        _SPLINES,
    ),
    Method(
        "differences",
        "central differences",
        _judged(_differences),
        "path followed; s alone",
        UNIT,
        CELLS,
        _STEP,
    ),
    Method("doubled", "Pinocchio's tables, doubled", _judged(_doubled), _PATH, UNIT, PROVED, _TABLES),
)
