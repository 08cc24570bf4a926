"""A controller as a table: reference and gains of every sampling period, for programs without this package.

One row a period, with matrices row by row. The description beside it (`columns`) says where each array stands
and what a cycle computes; `run_table.py` beside this module is a reader of 60 lines.
"""

from __future__ import annotations

import numpy as np

from framework.control.controllers import Controller
from framework.control.reference import Reference
from framework.control.regulators import Regulator
from framework.errors import InvalidInput
from framework.numerics.arrays import Array
from framework.numerics.output import Document

CYCLE = (
    "k is the period, d the delay in periods, u the torques acting in a period less the planned torque of it",
    "from k = 1 on: z = F[k-1] z + G[k-1] u[k-1]",
    "z = z + L[k] (readings - planned_readings[k] - C[k] z - D[k] u[k-1])",
    "a = z; for j = k .. k+d-1: a = F[j] a + G[j] u[j]; k+d at most the last row",
    "send torque[k+d] - gain[k+d] a, which acts from period k+d on; limit it first, and keep what was sent",
)


def controller_table(regulator: Controller, sensors: tuple[str, ...]) -> tuple[str, Document]:
    """Return a controller lqg as CSV and its description.

    Args:
        regulator: with a filter.
        sensors: names of the sensors, for the description.

    Raises:
        InvalidInput: a controller without a filter.
    """
    if not isinstance(regulator, Regulator) or regulator.sensors is None:
        raise InvalidInput("export: needs the controller lqg, whose filter reads sensors")
    reference: Reference = regulator.reference
    robot, model, observer, sensing = reference.robot, regulator.model, regulator.observer, regulator.sensors
    S = sensing.S
    planned = [robot.coordinates.positions(reference.motion.q) @ S.T]
    if sensing.platform:
        planned.append(reference.x)
    if sensing.imu:
        planned.append(np.diff(reference.dx, axis=0, prepend=reference.dx[:1]) / reference.period)
    arrays: dict[str, Array] = {
        "time": reference.times[:, None],
        "torque": reference.period_torque,
        "planned_readings": np.concatenate(planned, axis=1),
        "gain": regulator.gain,
        "F": observer.plant.F,
        "G": observer.plant.G,
        "L": observer.gain,
        "C": observer.plant.C,
        "D": observer.plant.D,
    }
    columns, first = {}, 0
    for name, array in arrays.items():
        size = int(np.prod(array.shape[1:]))
        columns[name] = {"first": first, "shape": list(array.shape[1:])}
        first += size
    table = np.concatenate([array.reshape(len(array), -1) for array in arrays.values()], axis=1)
    lines = [",".join(map(repr, row)) for row in table.tolist()]
    rows = [" + ".join(robot.coordinates.name_of(column) for column in np.flatnonzero(row)) for row in S]
    if sensing.platform:
        rows += [f"platform {name}" for name in robot.axis_names]
    if sensing.imu:
        rows += [f"acceleration {name}" for name in robot.axis_names]
    kept = [*robot.axis_names, *(robot.coordinates.name_of(column) for column in model.columns)]
    description = {
        "robot": robot.name,
        "period": reference.period,
        "delay": regulator.delay,
        "motors": robot.actuator_names,
        "torque": "N m, N, motor side of the gears",
        "sensors": sensors,
        "readings": rows,  # joint side of the gears, rad and m
        "states": [*kept, *(f"rate of {name}" for name in kept), *model.names],
        "columns": columns,
        "cycle": CYCLE,
    }
    return "\n".join(lines) + "\n", description
