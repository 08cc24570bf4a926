"""Stage e: laws of motion in different bases, against the number of conditions that they have to meet.

From rest to rest in 1.5 s through 0 to 10 crossings, each with s, s' and s" given, as condition (8) gives
them: s and s' are those of s = t/T - sin(2 pi t/T) / (2 pi), and s" = 0 as on the 5R's straight path. All
but the optimal law are one and the same polynomial in different bases, or what is left of it when its
coefficients are printed. The optimal law is free between the crossings; it is given s" where it passes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import KroghInterpolator

from framework import Condition, Law, NoLaw
from framework.laws.optimal_law import Smoothstep, Stretch
from framework.numerics.arrays import Array, ArrayLike
from framework.planning.optimal.best_law import Best, find_best_law
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.phase_plane import AffineInSpeed, Demand
from framework.planning.specification import Specification
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, relative_error, singles
from tests.benchmarks.chart.reading import finite, short

T, SMOOTHNESS = 1.5, 2
CROSSINGS = tuple(range(11))
PRINTED = 6  # digits of printed coefficients
COUNTS = singles(*(6 + 3 * count for count in CROSSINGS))
BETWEEN = np.linspace(0.0, T, 201)

Evaluated = Callable[[ArrayLike, int], Array]  # t, order -> s or its derivative


class Asked(NamedTuple):
    """What is asked at an instant [s]: s and its derivatives."""

    time: float
    values: tuple[float, ...]


class TimedLaw(NamedTuple):
    """A law, and the instants (k,) at which it crosses."""

    law: Evaluated
    instants: tuple[float, ...]


def crossings(conditions: float) -> tuple[Asked, ...]:
    """What is asked inside the motion."""
    count = (round(conditions) - 6) // 3
    turn = 2 * np.pi / T
    times = [T * (k + 1) / (count + 1) for k in range(count)]
    return tuple(
        Asked(t, (float(t / T - np.sin(turn * t) / (2 * np.pi)), float((1 - np.cos(turn * t)) / T), 0.0))
        for t in times
    )


def _all(conditions: float) -> tuple[Asked, ...]:
    rest = (0.0,) * SMOOTHNESS
    return (Asked(0.0, (0.0, *rest)), *crossings(conditions), Asked(T, (1.0, *rest)))


def _powers(unit: float, *, printed: bool = False) -> Callable[[Setting], Callable[[], TimedLaw]]:
    """In powers of t / unit."""

    def prepare(setting: Setting) -> Callable[[], TimedLaw]:
        asked = _all(setting[0])

        def run() -> TimedLaw:
            identity = np.eye(round(setting[0]))
            rows = [
                polynomial.polyval(one.time / unit, polynomial.polyder(identity, order)) / unit**order
                for one in asked
                for order in range(len(one.values))
            ]
            right = [value for one in asked for value in one.values]
            series = np.linalg.solve(np.array(rows), np.array(right))
            series = _printed(series) if printed else series

            def law(t: ArrayLike, order: int) -> Array:
                slope = polynomial.polyder(series, order) / unit**order
                return np.asarray(polynomial.polyval(np.asarray(t, dtype=float) / unit, slope))

            return TimedLaw(law, _instants(setting))

        return run

    return prepare


def _printed(series: Array) -> Array:
    """Coefficients as a table of so many digits has them."""
    return np.array([float(f"{value:.{PRINTED - 1}e}") for value in series])


def _newton(setting: Setting) -> Callable[[], TimedLaw]:
    asked = _all(setting[0])
    times = np.array([one.time for one in asked for _ in one.values])
    values = np.array([value for one in asked for value in one.values])

    def run() -> TimedLaw:
        through = KroghInterpolator(times, values)
        return TimedLaw(lambda t, order: np.asarray(through.derivative(t, order)), _instants(setting))

    return run


def _chebyshev(setting: Setting, *, printed: bool = False) -> Callable[[], TimedLaw]:
    inner = [
        Condition(one.time, order, value)
        for one in crossings(setting[0])
        for order, value in enumerate(one.values)
    ]

    def run() -> TimedLaw:
        law = Law.rest_to_rest(T, SMOOTHNESS, inner)
        return TimedLaw(Law(_printed(law.coefficients), T) if printed else law, _instants(setting))

    return run


class _Unloaded(LawProblem):
    """The problem of a motor whose torque is s"."""

    def demand(self, sigma: Array) -> Demand:
        step = self.task.phi
        torque = AffineInSpeed(np.zeros((len(sigma), 1)), step(sigma, 2)[:, None], step(sigma, 1)[:, None])
        return Demand(torque, 0.0 * torque.constant, step(sigma, 1)[:, None])


def _optimal(setting: Setting) -> Callable[[], TimedLaw]:
    """The law of least peak of s" that passes the same places with the same s"."""
    asked = crossings(setting[0])
    step = Smoothstep(SMOOTHNESS)
    places = np.array([one.values[0] for one in asked])
    free = np.array([np.inf])
    specification = Specification("peak_torque", T, None, free, free, SMOOTHNESS, np.zeros(1))

    def run() -> TimedLaw:
        inside = step.inverse(places) if len(places) else np.empty(0)
        wanted = np.array([one.values[2] for one in asked])
        conditions = np.column_stack([-wanted, step(inside, 2), step(inside, 1), np.zeros(len(inside))])
        task = SimpleNamespace(phi=step, stretch=Stretch(tuple(inside)), specification=specification)
        best = find_best_law(_Unloaded(cast(Any, task), inside, conditions))
        if not isinstance(best, Best):
            raise NoLaw(f"no optimal law: {best.status}")
        return TimedLaw(best.law, tuple(float(t) for t in best.law.time(inside)))

    return run


def _instants(setting: Setting) -> tuple[float, ...]:
    return tuple(one.time for one in crossings(setting[0]))


@cache
def _exact(conditions: float) -> Array:
    """s" of the polynomial (T,) at BETWEEN, in fifty digits."""
    with localcontext(prec=2 * closed_form.DIGITS):  # powers of t lose what the fifty are to keep
        powers = closed_form.polynomial(
            [(Decimal(one.time), [Decimal(value) for value in one.values]) for one in _all(conditions)]
        )
        motion = closed_form.ExactMotion(powers, Decimal(0), Decimal(0))
        return np.array([float(motion.law(Decimal(float(t)), 2)) for t in BETWEEN])


def judge(method: Method, setting: Setting, result: TimedLaw) -> Judged:
    """How far s and s" are from what is asked at the crossings and at the ends, and from the polynomial."""
    conditions = 6 + 3 * len(result.instants)
    asked, largest = _all(conditions), 2 * np.pi / T**2
    instants = (0.0, *result.instants, T)
    missed = max(
        max(
            abs(float(result.law(t, 0)) - one.values[0]),
            abs(float(result.law(t, 2)) - one.values[2]) / largest,
        )
        for t, one in zip(instants, asked, strict=True)
    )
    if method.name == "optimal":
        return Judged(missed, (np.nan,))
    return Judged(missed, (relative_error(result.law(BETWEEN, 2), _exact(float(conditions))),))


def _remark(rows: Sequence[Row]) -> str:
    lines = []
    most = max(row.setting[0] for row in rows)
    bases = [_at(rows, name, most) for name in ("monomials", "normalised", "chebyshev")]
    if all(bases):
        off = [short(row.profile[0]) for row in bases if row is not None]
        lines.append(
            f'With {most:.0f} conditions s" is off along the motion by {off[0]} of its size in powers of t, '
            f"{off[1]} in powers of t/T, {off[2]} in Chebyshev polynomials."
        )
    for count in (9, 15):
        printed = _at(rows, "printed", count), _at(rows, "chebyshev_printed", count)
        if printed[0] is not None and printed[1] is not None:
            lines.append(
                f"Printed with {PRINTED} digits, a law of {count} conditions misses its crossings by "
                f"{short(printed[0].error)} in powers of t, by {short(printed[1].error)} in Chebyshev's."
            )
    optimal = finite(rows, "optimal")
    if optimal:
        worst, dearest = max(row.error for row in optimal), max(row.seconds for row in optimal)
        lines.append(
            f"The optimal law meets its conditions to {short(worst)} and takes up to {1e3 * dearest:.3g} ms."
        )
    return " ".join(lines)


def _at(rows: Sequence[Row], name: str, conditions: float) -> Row | None:
    return next((row for row in finite(rows, name) if row.setting[0] == conditions), None)


_GIVEN = "s, s', s\" at each crossing"
_SOLVED = "numpy.linalg.solve of the conditions in that basis"
_declared = partial(Method, given=_GIVEN, unit="conditions", settings=COUNTS)
STAGE = Stage(
    name="laws",
    title="What is asked at the crossings",
    reference="the conditions themselves, and the same polynomial in a hundred digits (closed_form.py)",
    error='largest miss of s, and of s" over its largest',
    methods=(
        _declared("chebyshev", "ours, Chebyshev basis", _chebyshev, kind="ours"),
        _declared(
            "optimal",
            "ours, optimal law",
            _optimal,
            given='s" where it crosses',
            settings=COUNTS[1::3],
            kind="ours",
        ),
        _declared("monomials", "powers of t in seconds", _powers(1.0), source=_SOLVED),
        _declared("normalised", "powers of t/T", _powers(T), source=_SOLVED),
        _declared(
            "chebyshev_printed",
            f"Chebyshev basis, {PRINTED} digits printed",
            partial(_chebyshev, printed=True),
            source="ours, coefficients rounded",
        ),
        _declared(
            "printed",
            f"powers of t, {PRINTED} digits printed",
            _powers(1.0, printed=True),
            source=f"{_SOLVED}, coefficients rounded",
        ),
        _declared(
            "newton",
            "Newton's form, scipy's Krogh",
            _newton,
            settings=COUNTS[:9],
            source="scipy KroghInterpolator, conditions in the order of time",
        ),
    ),
    judge=judge,
    remark=_remark,
    abscissa="number of conditions",
    linear=True,
    shown=("error", "profile"),
    profile=(1.0,),
    profile_error='largest error of s" over its largest',
    profile_title="Along the motion, of the polynomial",
)
