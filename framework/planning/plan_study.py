"""A study of plans over the parameters of a robot file: which stiffness, mass or length is enough?

Each combination of parameter values gets a plan, and the caller's functions compute numbers of the plan. The
plans are made in this process or by any `concurrent.futures.Executor`, of processes or of a dask cluster.
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

REFUSALS = (NoAnswer, RobotFileError, SingularReference)  # of one combination; other errors end the study
Quantities = Mapping[str, Callable[[CrossingPlan], float]]


@dataclass(frozen=True, eq=False)
class PlanStudy(ReadOnlyArrays):
    """Quantities of the plans for D combinations of parameter values."""

    parameters: Mapping[str, Array]  # (D,) values of each parameter, by name
    quantities: Mapping[str, Array]  # (D,) values of each quantity, by name; NaN without a plan
    why: tuple[str, ...]  # (D,) reason why there is no plan; empty with a plan


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
        file: robot file that declares the parameters, or the robot's name in the catalogue.
        motion: path to follow, or the name of a scene.
        parameters: values of each parameter, by name.
        quantities: functions by name, each of which computes a number of a plan; executors of processes need
            functions that can be pickled.
        flexibility: which springs of the robot exist: "rigid" (none), "flexible_joints" or "flexible_links".
        executor: makes the plans, by default in this process; `numerics.tasks.executor_of` creates one.
        progress: called with the number of plans done.
        options: options of `plan_crossing`.

    Raises:
        InvalidInput: the file does not declare a parameter, a parameter has no values, or an option is
            invalid.

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
    # all combinations of values, each as a mapping from parameters to values
    combinations = [dict(zip(parameters, values, strict=True)) for values in product(*parameters.values())]
    if not combinations:
        raise InvalidInput("parameters: needs at least one value of each")
    plan_combination = partial(_plan_combination, path, flexibility, motion, options, quantities)
    columns = complete_chunks(
        partial(compute_rows, plan_combination, tuple(quantities), REFUSALS),
        {str(k): [combination] for k, combination in enumerate(combinations)},  # one plan for each chunk
        lambda chunk: {},  # arrays of a stored chunk: none is stored
        executor=executor,
        keeper=None,
        progress=lambda names: progress(len(names)),
    )
    why = tuple(columns.pop(WHY).tolist())
    values_by_name = {name: np.array([chosen[name] for chosen in combinations]) for name in parameters}
    return PlanStudy(values_by_name, columns, why)


def _plan_combination(
    file: str,
    flexibility: str,
    motion: Path | str,
    options: Mapping[str, Any],
    quantities: Quantities,
    parameters: Mapping[str, float],
) -> Mapping[str, float]:
    """Compute the quantities of the plan for the values of all `parameters`; others as in `plan_study`.

    Raises:
        NoAnswer, RobotFileError, SingularReference: there is no plan.
    """
    robot = load_robot(file, flexibility=flexibility, parameters=parameters)
    plan_motion = plan_scene if isinstance(motion, str) else plan_crossing
    plan = plan_motion(robot, motion, **options)  # type: ignore[arg-type]
    return {name: float(measure(plan)) for name, measure in quantities.items()}
