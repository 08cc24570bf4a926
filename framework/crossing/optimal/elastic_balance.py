"""The law nearest to a given one that an elastic robot can follow with deflections as smooth as the law.

Its scalars are the values of t_s . W_p where the undeformed robot is singular: what condition (8) lacks there
so that the loaded robot passes where it is singular.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.crossing.optimal.law_problem import condition_rows
from framework.crossing.optimal.optimal_task import Task, crossing_places, other_law
from framework.crossing.optimal.undeformed_law import problem_of
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.restoration import coefficients_for, restored
from framework.errors import InvalidInput, NotConverged
from framework.motion.clock import OnParameter
from framework.motion.cone_program import Affine
from framework.motion.exact_duration import SpeedSpace
from framework.motion.optimal_law import OptimalLaw

SCALAR_STEP = 1e-4  # of the terms of a condition, for differences


def in_balance(
    task: Task, law: OptimalLaw, before: KnownDeflections | None
) -> tuple[OptimalLaw, KnownDeflections]:
    """Find the law and its deflections, from those of a law before if there was one.

    Raises:
        NotConverged: there is none near.
    """
    places = crossing_places(task, None, None)
    space = SpeedSpace(law.basis, law.stretch)
    equalities = condition_rows(problem_of(task, places), law.basis)
    met = equalities.matrix @ law.coefficients

    def family(scalars: Array) -> OnParameter:
        """Return the law nearest to `law` whose conditions have values shifted by scalars (k,)."""
        wanted = met + np.pad(scalars, (0, len(met) - len(scalars)))
        try:
            moved = Affine(equalities.matrix, -wanted)
            y = space.adjust(law.coefficients, moved, law.duration, relative=True)
            changed = OptimalLaw(y, law.smoothness, law.duration, law.dense_at)
        except InvalidInput:
            raise NotConverged(
                f"{task.branch.robot.name}: no law near the best crosses where the deflected robot is "
                f"singular; use {other_law(task)}stiffer springs, or geometry rigid",
                residual=np.inf,
            ) from None
        return OnParameter(changed, task.branch.knots)

    sizes = np.linalg.norm(equalities.matrix.toarray() * law.coefficients, axis=1)[: len(places)]
    found = restored(
        task.branch,
        family,
        SCALAR_STEP * np.where(sizes > 0.0, sizes, 1.0),
        coefficients_for(law.degree),
        before,
    )
    return family(found.scalars).law, found.deflections
