"""The law nearest to a given one that an elastic robot can follow with deflections as smooth as the law.

A law s = phi(sigma(t)) is a squared speed z = (d sigma/dt)^2. It has one free scalar for each crossing: the
value of t_s . W_p where the undeformed robot is singular, the power that condition (8) sets to zero. These
scalars differ from zero so that the loaded robot meets condition (8) at its own singular points.

Balance alone does not ensure that springs start and stop at rest, as the law does: springs that carry inertia
may be in balance while they vibrate at an end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.restoration import LEAST_MISFIT, BalanceSolution, solve_balance
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, NotConverged
from framework.laws.optimal_law import OnParameter, OptimalLaw
from framework.laws.squared_speed import ONE_CELL, SpeedBasis, SpeedSpace
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import nodes
from framework.numerics.cone_program import Affine
from framework.planning.optimal.law_problem import LawProblem, condition_rows
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.undeformed_law import problem_of
from framework.tolerances import MAX_END_ACCELERATION, MAX_END_RATE

# degree of z as one series, which makes deflections smooth; samples of z for each degree, to fit it
SERIES_DEGREE, SAMPLES_PER_DEGREE = 60, 12
END_SAMPLES = 401  # of a motion, for the largest rates of its springs
NEGLIGIBLE_RATE = 1e-6  # of a spring, over that of the quickest; slower springs are not checked, for rounding
SCALAR_STEP = 1e-4  # of differences in a scalar, over the size of the terms of its condition


def find_law_in_balance(
    task: Task,
    law: OptimalLaw,
    previous: KnownDeflections | None,
    places: Sequence[float] | None = None,
    *,
    misfit: float = LEAST_MISFIT,
) -> tuple[OptimalLaw, BalanceSolution]:
    """Find the nearest law with deflections in balance, and the deflections.

    Args:
        law: the law near which the result is sought.
        previous: deflections of a similar law, from which the search begins.
        places: s of the required times and speeds; by default the crossing points.
        misfit: of the balance, at which deflections are accepted.

    Raises:
        NotConverged: there is no such law near the given one.
    """
    problem = problem_of(task, places)
    if law.basis.is_spline:
        law = _fit_series(problem, law)
    space = SpeedSpace(law.basis, law.stretch)
    conditions = condition_rows(problem, law.basis)
    instants = problem.instants_until(law.duration)
    # values of all conditions; those on required speeds and on ends in motion are set to what is required
    values = conditions.matrix @ law.coefficients
    count = len(task.targets)  # of conditions (8)
    values[count:] = -conditions.offset[count:]

    def shift_conditions(shifts: Array) -> OnParameter:
        """Return the law nearest to `law` whose first k conditions have values shifted by (k,)."""
        targets = values + np.pad(shifts, (0, len(values) - len(shifts)))
        try:
            equalities = Affine(conditions.matrix, -targets)
            y = space.adjust(law.coefficients, equalities, instants, relative=True)
            shifted = replace(law, coefficients=y)
        except InvalidInput:
            raise _no_law_near(task) from None
        return OnParameter(shifted, task.branch.knots)

    # sizes of the terms of each condition (8), to which the steps of differences are proportional
    terms = np.linalg.norm(conditions.matrix.toarray() * law.coefficients, axis=1)[:count]
    balance = solve_balance(
        task.branch,
        shift_conditions,
        SCALAR_STEP * np.where(terms > 0.0, terms, 1.0),
        previous,
        misfit=misfit,
    )
    return balance.law, balance


def _fit_series(problem: LawProblem, law: OptimalLaw) -> OptimalLaw:
    """Fit a law with z as one series to a law of splines, with the same duration and condition (8).

    The fit minimises the sum of squares of (z - z_splines) / z_splines.

    Raises:
        NotConverged: the series is not positive.
    """
    basis = SpeedBasis(np.array(ONE_CELL), SERIES_DEGREE + 1)
    xi = nodes(SAMPLES_PER_DEGREE * SERIES_DEGREE)
    # rows of z / z_splines at xi on the coefficients of the series, fitted to 1
    ratio = basis.matrix(xi).toarray() / (law.basis.matrix(xi) @ law.coefficients)[:, None]
    y = np.asarray(np.linalg.lstsq(ratio, np.ones(len(xi)), rcond=None)[0], dtype=float)
    space = SpeedSpace(basis, law.stretch)
    try:
        instants = problem.instants_until(law.duration)
        y = space.adjust(y, condition_rows(problem, basis), instants, relative=True)
        return replace(law, coefficients=y, cells=ONE_CELL)
    except InvalidInput:
        raise _no_law_near(problem.task) from None


def _no_law_near(task: Task) -> NotConverged:
    """Return the refusal of a task if no law near the best crosses in balance."""
    return NotConverged(
        "no law near the best crosses where the deflected robot is singular",
        name=task.robot.name,
        residual=np.inf,
    )


def measure_rest(dynamics: InverseDynamics, law: OptimalLaw) -> float:
    """Return the largest motion of a spring at an end where the law is at rest; at most 1 counts as rest.

    It is the larger of a spring's rate over MAX_END_RATE of its largest rate, and of its acceleration over
    MAX_END_ACCELERATION of its largest acceleration.

    Args:
        dynamics: the motion under the law.
    """
    robot = dynamics.robot
    is_at_rest = [not is_moving for is_moving in law.moving]
    t = np.linspace(0.0, dynamics.duration, END_SAMPLES)
    ratios = [0.0]
    for order, allowed in ((1, MAX_END_RATE), (2, MAX_END_ACCELERATION)):
        values = np.abs(dynamics.deflection(t, order)) / robot.column_scale[robot.elastic]  # (T, n_e)
        largest = values.max(axis=0)
        counted = largest > NEGLIGIBLE_RATE * largest.max()
        at_ends = values[[0, -1]][is_at_rest][:, counted] / largest[counted]
        ratios.append(float(at_ends.max(initial=0.0)) / allowed)
    return max(ratios)
