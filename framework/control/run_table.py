"""Run a controller that `crossing export --to controller` wrote. Needs numpy only; copy and change it freely.

    controller = TableController("move.csv")
    torque = controller.update(readings)    # once a period, from rest at the start of the plan

As in a controller of ros2_control, the tables are read at the start, and `update` takes the state of the
sensors and returns the commands. Readings and torques stand in the order of `readings` and `motors` in the
description, move.json; readings are on the joint side of the gears, torques on the motor side.
"""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class TableController:
    """The state of one run: deviations z, and the torques that were sent."""

    def __init__(self, file: str | Path, limit: float | Array = np.inf) -> None:
        """Read NAME.csv and NAME.json beside it; `limit` bounds the torques [N m, N], motor side.

        A row of the CSV file belongs to one period and holds several arrays, flattened one after the other.
        The JSON file says of each array its first column and its shape.
        """
        description = json.loads(Path(file).with_suffix(".json").read_text(encoding="utf-8"))
        table = np.loadtxt(file, delimiter=",", ndmin=2)  # (K, numbers of a period)
        self.rows: dict[str, Array] = {}  # arrays (K, ...) by name
        for name, place in description["columns"].items():
            size = int(np.prod(place["shape"]))
            values = table[:, place["first"] : place["first"] + size]
            self.rows[name] = values.reshape(len(table), *place["shape"])
        self.delay = int(description["delay"])  # periods until a torque acts
        self.limit = limit
        # the state of the run, which `update` changes
        self.k = 0  # number of the period
        self.z = np.zeros(len(description["states"]))  # estimated deviations from the plan
        self.sent: list[Array] = []  # torques of all periods so far

    def deviation(self, k: int) -> Array:
        """Return the torque that acts in period k less the planned one, at last that of the last row."""
        planned = self.rows["torque"]
        return self.sent[max(k - self.delay, 0)] - planned[min(k, len(planned) - 1)]

    def update(self, readings: Array) -> Array:
        """Return the torques for the readings of this period; after the end keep to the last row."""
        rows, last = self.rows, len(self.rows["torque"]) - 1
        k = min(self.k, last)
        z = self.z
        expected = rows["C"][k] @ z
        if self.sent:
            before = self.deviation(self.k - 1)
            z = rows["F"][k - 1] @ z + rows["G"][k - 1] @ before
            expected = rows["C"][k] @ z + rows["D"][k] @ before
        self.z = z = z + rows["L"][k] @ (readings - rows["planned_readings"][k] - expected)
        target = min(k + self.delay, last)
        for j in range(k, target):  # through the torques under way
            z = rows["F"][j] @ z
            if self.sent:
                z = z + rows["G"][j] @ self.deviation(j)
        torque: Array = np.clip(rows["torque"][target] - rows["gain"][target] @ z, -self.limit, self.limit)
        self.sent.append(torque)
        self.k += 1
        return torque
