"""A study of plans over the parameters of a robot file: which stiffness, mass or length is enough?

One plan is made for each set of values, with numbers of it that the caller chooses. The sets are computed in
this process or by any `concurrent.futures.Executor`: of processes, or of a dask cluster.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from framework.catalogue import load_robot, robot_file
from framework.errors import InvalidInput, NoAnswer, RobotFileError, SingularReference, choose_from
from framework.laws.path import Path
from framework.model.parameters import declared_parameters
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.input import read_text
from framework.numerics.kept import WHY, complete_chunks, compute_rows
from framework.planning.plan import plan_crossing
from framework.planning.result import CrossingPlan
from framework.planning.scenes import plan_scene

REFUSALS = (NoAnswer, RobotFileError, SingularReference)  # of one set; other errors are those of the call
Quantities = Mapping[str, Callable[[CrossingPlan], float]]


@dataclass(frozen=True, eq=False)
class PlanStudy(ReadOnlyArrays):
    """Quantities of the plans of D sets of parameters, NaN without a plan."""

    parameters: Mapping[str, Array]  # (D,) values, by name
    quantities: Mapping[str, Array]  # (D,) by name
    why: tuple[str, ...]  # (D,) empty, or why there is no plan


def plan_study(
    file: str | os.PathLike[str],
    motion: Path | str,
    parameters: Mapping[str, Sequence[float]],
    *,
    quantities: Quantities,
    flexibility: str = "rigid",
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda done: None,
    **options: Any,
) -> PlanStudy:
    """Plan one motion for each combination of values of a robot file's parameters.

    Args:
        file: of the robot, which declares the parameters, or its name in the catalogue.
        motion: path to follow, or the name of a scene.
        parameters: values of each parameter, by name.
        quantities: functions of a plan, each to one number, by name; executors of processes take only
            functions that can be pickled.
        executor: where the plans are made, by default this process; `numerics.tasks.executor_of` makes one.
        progress: called with the number of plans that are done.
        options: of `plan_crossing`.

    Raises:
        InvalidInput: the file declares no parameter of a name, or an option cannot be right.

    Example:
        >>> quantities = {"duration": lambda plan: plan.duration}
        >>> study = plan_study("arm.yaml", "pick", {"mass": [1, 2]}, quantities=quantities)  # doctest: +SKIP
        >>> study.quantities["duration"]  # doctest: +SKIP
    """
    path = str(robot_file(file))
    declared = declared_parameters(read_text(path, f"{path}: cannot read it"))
    for unknown in parameters.keys() - declared.keys():
        raise InvalidInput(f"{path}: {choose_from('parameter', unknown, declared)}")
    if WHY in quantities:
        raise InvalidInput(f"quantities: {WHY!r} is the name of the reasons; choose another")
    sets = [dict(zip(parameters, values, strict=True)) for values in product(*parameters.values())]
    if not sets:
        raise InvalidInput("parameters: needs at least one value of each")
    plan_set = partial(_plan_set, path, flexibility, motion, options, quantities)
    columns = complete_chunks(
        partial(compute_rows, plan_set, tuple(quantities), REFUSALS),
        {str(k): [one] for k, one in enumerate(sets)},
        lambda chunk: {},
        executor=executor,
        keeper=None,
        progress=lambda names: progress(len(names)),
    )
    why = tuple(columns.pop(WHY).tolist())
    return PlanStudy({name: np.array([one[name] for one in sets]) for name in parameters}, columns, why)


def _plan_set(
    file: str,
    flexibility: str,
    motion: Path | str,
    options: Mapping[str, Any],
    quantities: Quantities,
    parameters: Mapping[str, float],
) -> Mapping[str, float]:
    """Compute the quantities of the plan with one set of parameters.

    Raises one of REFUSALS.
    """
    robot = load_robot(file, flexibility=flexibility, parameters=parameters)
    planned = plan_scene if isinstance(motion, str) else plan_crossing
    plan = planned(robot, motion, **options)  # type: ignore[arg-type]
    return {name: float(of(plan)) for name, of in quantities.items()}
