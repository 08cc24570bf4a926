"""The law nearest to a given one that an elastic robot can follow with deflections as smooth as the law.

Its scalars are the values of t_s . W_p where the undeformed robot is singular: what condition (8) lacks there
so that the loaded robot passes where it is singular.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.restoration import first_coefficient_count, solve_balance
from framework.errors import InvalidInput, NotConverged
from framework.laws.clock import OnParameter
from framework.laws.exact_duration import SpeedSpace
from framework.laws.optimal_law import OptimalLaw
from framework.laws.speed_basis import ONE_CELL, SpeedBasis
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import nodes
from framework.numerics.cone_program import Affine
from framework.planning.optimal.law_problem import LawProblem, condition_rows
from framework.planning.optimal.optimal_task import Task, crossing_places, other_law
from framework.planning.optimal.undeformed_law import problem_of

SERIES_DEGREE, SAMPLES_PER_DEGREE = 60, 12  # of z as one series, under which deflections are smooth
SCALAR_STEP = 1e-4  # of the terms of a condition, for differences


def in_balance(
    task: Task, law: OptimalLaw, before: KnownDeflections | None
) -> tuple[OptimalLaw, KnownDeflections]:
    """Find the law and its deflections, from those of a law before if there was one.

    Raises:
        NotConverged: there is none near.
    """
    places = crossing_places(task, None, None)
    problem = problem_of(task, places)
    if law.basis.is_spline:
        law = _fit_series(problem, law)
    space = SpeedSpace(law.basis, law.stretch)
    equalities = condition_rows(problem, law.basis)
    met = equalities.matrix @ law.coefficients

    def family(scalars: Array) -> OnParameter:
        """Return the law nearest to `law` whose conditions have values shifted by scalars (k,)."""
        wanted = met + np.pad(scalars, (0, len(met) - len(scalars)))
        try:
            moved = Affine(equalities.matrix, -wanted)
            y = space.adjust(law.coefficients, moved, law.duration, relative=True)
            changed = OptimalLaw(y, law.smoothness, law.duration, law.dense_at)
        except InvalidInput:
            raise _none_near(task) from None
        return OnParameter(changed, task.branch.knots)

    sizes = np.linalg.norm(equalities.matrix.toarray() * law.coefficients, axis=1)[: len(places)]
    found = solve_balance(
        task.branch,
        family,
        SCALAR_STEP * np.where(sizes > 0.0, sizes, 1.0),
        first_coefficient_count(law.degree),
        before,
    )
    return family(found.scalars).law, found.deflections


def _fit_series(problem: LawProblem, law: OptimalLaw) -> OptimalLaw:
    """Return the law of a series nearest in dz/z to a law of splines, with its duration and condition (8).

    Raises:
        NotConverged: the series is not positive.
    """
    basis = SpeedBasis(np.array(ONE_CELL), SERIES_DEGREE + 1)
    xi = nodes(SAMPLES_PER_DEGREE * SERIES_DEGREE)
    share = basis.matrix(xi).toarray() / (law.basis.matrix(xi) @ law.coefficients)[:, None]
    y = np.linalg.lstsq(share, np.ones(len(xi)), rcond=None)[0]
    space = SpeedSpace(basis, law.stretch)
    try:
        y = space.adjust(y, condition_rows(problem, basis), law.duration, relative=True)
        return OptimalLaw(y, law.smoothness, law.duration, law.dense_at)
    except InvalidInput:
        raise _none_near(problem.task) from None


def _none_near(task: Task) -> NotConverged:
    return NotConverged(
        f"{task.branch.robot.name}: no law near the best crosses where the deflected robot is singular; use "
        f"{other_law(task)}stiffer springs, or geometry rigid",
        residual=np.inf,
    )
