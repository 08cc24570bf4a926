"""motion.csv: a motion sampled in time, with the units of its columns."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, choose_from, finite_numbers, short, whole_number
from framework.kinematics.parallel_robot import ParallelRobot, length_units
from framework.laws.law import is_number, law_derivatives
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.fields import MAX_ROWS, MIN_ROWS
from framework.tolerances import SAME_PLACE

RATES = ("", "/s", "/s2")  # suffixes of units, indexed by the order of the time derivative
DEFAULT_ROWS = 1501  # instants of a table without a stated number or period
NamesAndUnits = tuple[Sequence[str], Sequence[str]]  # of the components of a quantity


class Column(NamedTuple):
    """A column of motion.csv."""

    name: str
    unit: str  # SI
    what: str  # description of the quantity


class MotionTable(NamedTuple):
    """Samples of a motion: one row for each instant, one entry for each column."""

    columns: tuple[Column, ...]
    rows: Array  # (T, number of columns) in the units of the columns

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return [column.name for column in self.columns]

    def as_csv(self) -> str:
        """Return the table as CSV text; numbers have all their digits."""
        header = io.StringIO()
        csv.writer(header, lineterminator="\n").writerow(self.names)  # names of joints may have commas
        return header.getvalue() + "".join(",".join(map(repr, row)) + "\n" for row in self.rows.tolist())

    def metadata(self, file: str) -> str:
        """Return a description of the columns of `file`: JSON by W3C's CSV on the Web."""
        columns = [
            {
                "name": column.name,
                "datatype": "double",
                "dc:description": column.what,
                "schema:unitText": column.unit,
            }
            for column in self.columns
        ]
        document = {"@context": "http://www.w3.org/ns/csvw", "url": file, "tableSchema": {"columns": columns}}
        return json.dumps(document, indent=1) + "\n"


def sample_times(
    duration: float, count: int, period: float | None = None, at: ArrayLike | None = None
) -> Array:
    """Return `count` equidistant instants [s], the multiples of a period and the end, or those of `at`.

    Raises:
        InvalidInput: `count` is no whole number from MIN_ROWS to MAX_ROWS; the period is longer than
            the duration, or so short that there are more than MAX_ROWS instants; an instant outside.
    """
    if at is not None:
        times = finite_numbers("at", at, np.size(at))
        if not (len(times) and times.min() >= 0.0 and times.max() <= duration):
            raise InvalidInput(f"at: needs instants of 0 to {duration:.6g} s, the duration, got {short(at)}")
        return times
    if period is None:
        return np.linspace(0.0, duration, whole_number("samples", count, MIN_ROWS, MAX_ROWS))
    least = duration / (MAX_ROWS - 1)
    if not (is_number(period) and least <= period <= duration):
        raise InvalidInput(f"period: needs {least:.3g} to {duration:.6g} s, the duration, got {period!r}")
    # the last period may be shorter, but not by rounding alone
    periods = np.ceil(duration / period * (1.0 - SAME_PLACE))
    return np.append(period * np.arange(periods), duration)


def motion_table(
    dynamics: InverseDynamics, times: Array, columns: Sequence[str] | None = None
) -> MotionTable:
    """Sample a motion at instants (T,) [s].

    Args:
        columns: names of columns, or prefixes that several names share, such as torque; all by default.

    Raises:
        InvalidInput: a column is unknown; the message lists the valid ones.
    """
    robot, coordinates = dynamics.robot, dynamics.robot.coordinates
    joints = [  # each (T, nv): positions, velocities, accelerations
        coordinates.positions(dynamics.configuration(times)),
        coordinates.to_file_axes(dynamics.velocity(times, 1)),
        coordinates.to_file_axes(dynamics.velocity(times, 2)),
    ]
    # in the order of `motion_columns`, each (T, number of components)
    values = [np.stack([times, *law_derivatives(dynamics.law, times)], axis=1)]
    values += [dynamics.platform(times), dynamics.motor_angle(times)]
    values += [dynamics.torque(times), dynamics.deflection(times)]
    for quantity in (dynamics.platform, dynamics.motor_angle, dynamics.deflection):
        values += [quantity(times, 1), quantity(times, 2)]
    values += [joint[:, robot.passive] for joint in joints]

    all_columns = motion_columns(robot)
    chosen = select_columns(all_columns, columns)
    rows = np.concatenate(values, axis=1)[:, chosen]
    return MotionTable(tuple(all_columns[k] for k in chosen), rows)


def select_columns(columns: Sequence[Column], wanted: Sequence[str] | None) -> list[int]:
    """Return the indices of the wanted columns, by names or prefixes of names; all when None.

    Raises:
        InvalidInput: a column is unknown; the message lists the valid ones.
    """
    names = [column.name for column in columns]
    if wanted is None:
        return list(range(len(names)))
    selected: dict[int, None] = {}  # an ordered set: each column once, in the order wanted
    for prefix in wanted:
        # the underscores let a prefix match whole words only: "ds" is no prefix of "dds"
        matching = [k for k, name in enumerate(names) if f"{name}_".startswith(f"{prefix}_")]
        if not matching:
            raise InvalidInput(choose_from("column", prefix, names))
        selected |= dict.fromkeys(matching)
    return list(selected)


def motion_columns(robot: ParallelRobot) -> tuple[Column, ...]:
    """Return the columns of motion.csv, in their order."""
    # names and units of the components of each quantity; those without a motor are called passive
    axes = robot.axis_names, robot.axis_units
    forces = robot.actuator_names, robot.torque_units
    motors = robot.actuator_names, ["m" if unit == "N" else "rad" for unit in robot.torque_units]
    springs = robot.elastic_names, length_units(robot.sliding[robot.elastic])
    passive_names = [robot.coordinates.name_of(column) for column in robot.passive]
    passive = passive_names, length_units(robot.sliding[robot.passive])
    ball = turning = ""
    if robot.has_balls:
        ball = "; of a ball, a component of the rotation vector about the axes of its origin"
        turning = "; of a ball, the angular velocity about axes of what it carries"
    return (
        Column("time", "s", "instant"),
        Column("s", "1", "path coordinate"),
        Column("ds", "1/s", "time derivative of the path coordinate"),
        Column("dds", "1/s2", "second time derivative of the path coordinate"),
        *_quantity_columns("platform", axes, "platform coordinate"),
        *_quantity_columns("motor_angle", motors, "motor angle, motor side of the gear"),
        *_quantity_columns("torque", forces, "motor torque, motor side of the gear"),
        *_quantity_columns("deflection", springs, "deflection of a spring"),
        *_rate_columns("platform", axes, "of the platform coordinate"),
        *_rate_columns("motor", motors, "of the motor angle, motor side of the gear"),
        *_rate_columns("deflection", springs, "of the deflection"),
        *_quantity_columns("joint", passive, f"position of a joint without a motor{ball}"),
        *_rate_columns("joint", passive, f"of the position of a joint without a motor{turning}"),
    )


def _quantity_columns(
    prefix: str, names_and_units: NamesAndUnits, description: str, order: int = 0
) -> list[Column]:
    """Return a column for each component of a quantity or of its time derivative of an order."""
    pairs = zip(*names_and_units, strict=True)
    return [Column(f"{prefix}_{name}", f"{unit}{RATES[order]}", description) for name, unit in pairs]


def _rate_columns(prefix: str, names_and_units: NamesAndUnits, description: str) -> list[Column]:
    """Return the columns of the first and second time derivatives, as "of the deflection"."""
    derivative = f"time derivative {description}"
    return [
        *_quantity_columns(f"{prefix}_velocity", names_and_units, derivative, 1),
        *_quantity_columns(f"{prefix}_acceleration", names_and_units, f"second {derivative}", 2),
    ]
