"""motion.csv: a motion sampled in time, its columns with their units."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, choose_from, whole_number
from framework.kinematics.parallel_robot import ParallelRobot, length_units
from framework.laws.law import is_number
from framework.numerics.arrays import Array
from framework.tolerances import SAME_PLACE

RATES = ("", "/s", "/s2")  # of a unit, by the order of the derivative


MIN_SAMPLES, MAX_SAMPLES = 2, 10_000_000
DEFAULT_ROWS = 1501


class Column(NamedTuple):
    """A column: its name of plain letters and underscores, its SI unit, its description."""

    name: str
    unit: str
    what: str


class MotionTable(NamedTuple):
    """Samples of a motion: rows (count, columns)."""

    columns: tuple[Column, ...]
    rows: Array

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return [column.name for column in self.columns]

    def as_csv(self) -> str:
        """Return the table as text, numbers to their last digit."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.names)
        writer.writerows([[repr(value) for value in row] for row in self.rows.tolist()])
        return text.getvalue()

    def metadata(self, file: str) -> str:
        """Describe the columns by W3C's CSV on the Web (JSON)."""
        columns = [
            {
                "name": column.name,
                "datatype": "double",
                "dc:description": column.what,
                "schema:unitText": column.unit,
            }
            for column in self.columns
        ]
        document = {
            "@context": "http://www.w3.org/ns/csvw",
            "url": file,
            "tableSchema": {"columns": columns},
        }
        return json.dumps(document, indent=1) + "\n"


def sample_times(duration: float, count: int, period: float | None = None) -> Array:
    """Return `count` equidistant instants [s], or multiples of a period and the end.

    Raises:
        InvalidInput: no whole number of at least two; no period within the duration that gives as few.
    """
    if period is None:
        return np.linspace(0.0, duration, whole_number("samples", count, MIN_SAMPLES, MAX_SAMPLES))
    least = duration / (MAX_SAMPLES - 1)
    if not (is_number(period) and least <= period <= duration):
        raise InvalidInput(f"period: needs {least:.3g} to {duration:.6g} s, the duration, got {period!r}")
    whole = int(np.ceil(duration / period * (1.0 - SAME_PLACE)))  # the last may be shorter
    return np.append(period * np.arange(whole), duration)


def motion_table(
    dynamics: InverseDynamics, times: Array, columns: Sequence[str] | None = None
) -> MotionTable:
    """Sample the motion at instants (T,) [s].

    Args:
        columns: names of columns, or the beginnings that several share, such as torque; all by default.

    Raises:
        InvalidInput: an unknown column; lists those that there are.
    """
    robot, law = dynamics.robot, dynamics.law
    coordinates, passive = robot.coordinates, robot.passive
    with_rates = (dynamics.platform, dynamics.motor_angle, dynamics.deflection)
    values = [  # in the order of `motion_columns`, each (T, k)
        times[:, None],
        *(law(times, order)[:, None] for order in range(3)),
        dynamics.platform(times),
        dynamics.motor_angle(times),
        dynamics.torque(times),
        dynamics.deflection(times),
        *(quantity(times, order) for quantity in with_rates for order in (1, 2)),
        coordinates.positions(dynamics.configuration(times))[:, passive],
        *(coordinates.to_file_axes(dynamics.velocity(times, order))[:, passive] for order in (1, 2)),
    ]
    every, rows = motion_columns(robot), np.concatenate(values, axis=1)
    chosen = select_columns(every, columns)
    return MotionTable(tuple(every[k] for k in chosen), rows[:, chosen])


def select_columns(every: Sequence[Column], wanted: Sequence[str] | None) -> list[int]:
    """Return the indices of columns by their names or beginnings of names.

    All of them when None.

    Raises:
        InvalidInput: an unknown column; lists those that there are.
    """
    names = [column.name for column in every]
    if wanted is None:
        return list(range(len(names)))
    selected: dict[int, None] = {}  # each once, in the order asked for
    for want in wanted:
        matching = [k for k, name in enumerate(names) if name == want or name.startswith(f"{want}_")]
        if not matching:
            raise InvalidInput(choose_from("column", want, names))
        selected |= dict.fromkeys(matching)
    return list(selected)


def motion_columns(robot: ParallelRobot) -> tuple[Column, ...]:
    """Return the columns of motion.csv, in their order."""
    axes = list(zip(robot.axis_names, robot.axis_units, strict=True))
    forces = list(zip(robot.actuator_names, robot.torque_units, strict=True))
    motors = [(joint, "m" if unit == "N" else "rad") for joint, unit in forces]
    springs = list(zip(robot.elastic_names, length_units(robot.sliding[robot.elastic]), strict=True))
    names = [robot.coordinates.name_of(column) for column in robot.passive]
    ball = turning = ""
    if robot.model.nq > robot.model.nv:
        ball = "; of a ball, a component of the rotation vector about the axes of its origin"
        turning = "; of a ball, the angular velocity about axes of what it carries"
    passive = list(zip(names, length_units(robot.sliding[robot.passive]), strict=True))
    return (
        Column("time", "s", "instant"),
        Column("s", "1", "path coordinate"),
        Column("ds", "1/s", "its time derivative"),
        Column("dds", "1/s2", "its second time derivative"),
        *_quantity_columns("platform", axes, 0, "platform coordinate"),
        *_quantity_columns("motor_angle", motors, 0, "motor angle, motor side of the gear"),
        *_quantity_columns("torque", forces, 0, "motor torque, motor side of the gear"),
        *_quantity_columns("deflection", springs, 0, "deflection of a spring"),
        *_rate_columns("platform", axes, "of the platform coordinate"),
        *_rate_columns("motor", motors, "of the motor angle, motor side of the gear"),
        *_rate_columns("deflection", springs, "of the deflection"),
        *_quantity_columns("joint", passive, 0, f"position of a joint without a motor{ball}"),
        *_rate_columns("joint", passive, f"of the position of a joint without a motor{turning}"),
    )


def _quantity_columns(
    prefix: str, named_units: Iterable[tuple[str, str]], order: int, description: str
) -> list[Column]:
    """Return a column for each name and unit, of a derivative's order."""
    return [Column(f"{prefix}_{name}", f"{unit}{RATES[order]}", description) for name, unit in named_units]


def _rate_columns(prefix: str, named_units: Sequence[tuple[str, str]], description: str) -> list[Column]:
    """Return the columns of the first and second time derivatives of quantities."""
    return [
        *_quantity_columns(f"{prefix}_velocity", named_units, 1, f"time derivative {description}"),
        *_quantity_columns(f"{prefix}_acceleration", named_units, 2, f"second time derivative {description}"),
    ]
