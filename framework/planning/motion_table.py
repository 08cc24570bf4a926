"""motion.csv: a motion sampled in time, with the units of its columns."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, choose_from, whole_number
from framework.kinematics.parallel_robot import length_units
from framework.laws.law import is_number, law_derivatives
from framework.numerics.arrays import Array
from framework.tolerances import SAME_PLACE

# of a quantity and its time derivatives by order: part of the column's name, description, suffix of the unit
DERIVATIVES = (
    ("", "", ""),
    ("velocity_", "time derivative ", "/s"),
    ("acceleration_", "second time derivative ", "/s2"),
)
MIN_SAMPLES, MAX_SAMPLES = 2, 10_000_000
DEFAULT_ROWS = 1501
NamesAndUnits = tuple[Sequence[str], Sequence[str]]  # of the components of a quantity


class Column(NamedTuple):
    """A column of motion.csv."""

    name: str  # of letters, digits and underscores
    unit: str  # SI
    what: str  # description of the quantity


LAW_COLUMNS = (
    Column("time", "s", "instant"),
    Column("s", "1", "path coordinate"),
    Column("ds", "1/s", "time derivative of the path coordinate"),
    Column("dds", "1/s2", "second time derivative of the path coordinate"),
)


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
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.names)
        writer.writerows([[repr(value) for value in row] for row in self.rows.tolist()])
        return text.getvalue()

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
        document = {
            "@context": "http://www.w3.org/ns/csvw",
            "url": file,
            "tableSchema": {"columns": columns},
        }
        return json.dumps(document, indent=1) + "\n"


def sample_times(duration: float, count: int, period: float | None = None) -> Array:
    """Return `count` equidistant instants [s], or the multiples of a period and the end.

    Raises:
        InvalidInput: `count` is no whole number from MIN_SAMPLES to MAX_SAMPLES; the period is longer than
            the duration, or so short that there are more than MAX_SAMPLES instants.
    """
    if period is None:
        return np.linspace(0.0, duration, whole_number("samples", count, MIN_SAMPLES, MAX_SAMPLES))
    least = duration / (MAX_SAMPLES - 1)
    if not (is_number(period) and least <= period <= duration):
        raise InvalidInput(f"period: needs {least:.3g} to {duration:.6g} s, the duration, got {period!r}")
    # the last period may be shorter, but not by rounding alone
    periods = np.ceil(duration / period * (1.0 - SAME_PLACE))
    return np.append(period * np.arange(periods), duration)


def motion_table(
    dynamics: InverseDynamics, times: Array, columns: Sequence[str] | None = None
) -> MotionTable:
    """Sample a motion.

    Args:
        dynamics: the motion with its torques.
        times: instants (T,) [s].
        columns: names of columns, or prefixes that several names share, such as torque; all by default.

    Raises:
        InvalidInput: a column is unknown; the message lists the valid ones.
    """
    parts = [*_quantity_tables(dynamics, times), *_joint_tables(dynamics, times)]
    all_columns = [column for part in parts for column in part.columns]
    chosen = _select_columns([column.name for column in all_columns], columns)
    rows = np.concatenate([part.rows for part in parts], axis=1)[:, chosen]
    return MotionTable(tuple(all_columns[k] for k in chosen), rows)


def _quantity_tables(dynamics: InverseDynamics, times: Array) -> list[MotionTable]:
    """Return the tables of law, platform, motors and springs, and of their rates, at times (T,)."""
    robot = dynamics.robot
    # names and units of the components of each quantity
    axes = robot.axis_names, robot.axis_units
    forces = robot.actuator_names, robot.torque_units
    motors = robot.actuator_names, ["m" if unit == "N" else "rad" for unit in robot.torque_units]
    springs = robot.elastic_names, length_units(robot.sliding[robot.elastic])
    parts = [
        MotionTable(LAW_COLUMNS, np.stack([times, *law_derivatives(dynamics.law, times)], axis=1)),
        _tabulate("platform", axes, "platform coordinate", dynamics.platform(times)),
        _tabulate("motor_angle", motors, "motor angle, motor side of the gear", dynamics.motor_angle(times)),
        _tabulate("torque", forces, "motor torque, motor side of the gear", dynamics.torque(times)),
        _tabulate("deflection", springs, "deflection of a spring", dynamics.deflection(times)),
    ]
    for prefix, components, of_what, evaluate in (
        ("platform", axes, "of the platform coordinate", dynamics.platform),
        ("motor", motors, "of the motor angle, motor side of the gear", dynamics.motor_angle),
        ("deflection", springs, "of the deflection", dynamics.deflection),
    ):
        parts += [_tabulate(prefix, components, of_what, evaluate(times, order), order) for order in (1, 2)]
    return parts


def _joint_tables(dynamics: InverseDynamics, times: Array) -> list[MotionTable]:
    """Return the tables of positions, velocities and accelerations of passive joints at times (T,)."""
    robot, coordinates, passive = dynamics.robot, dynamics.robot.coordinates, dynamics.robot.passive
    joints = [coordinates.name_of(column) for column in passive], length_units(robot.sliding[passive])
    position = "position of a joint without a motor"
    ball = turning = ""
    if robot.has_balls:
        ball = "; of a ball, a component of the rotation vector about the axes of its origin"
        turning = "; of a ball, the angular velocity about axes of what it carries"
    positions = coordinates.positions(dynamics.configuration(times))  # (T, nv)
    tables = [_tabulate("joint", joints, f"{position}{ball}", positions[:, passive])]
    for order in (1, 2):
        rates = coordinates.to_file_axes(dynamics.velocity(times, order))[:, passive]
        tables.append(_tabulate("joint", joints, f"of the {position}{turning}", rates, order))
    return tables


def _tabulate(
    prefix: str, components: NamesAndUnits, description: str, rows: Array, order: int = 0
) -> MotionTable:
    """Return the table of a quantity, or of its first or second time derivative.

    Args:
        prefix: beginning of the columns' names, such as "motor" of "motor_velocity_NAME".
        components: names and units of the components of the quantity.
        description: of the quantity; of a derivative, the end of its description, as in "of the deflection".
        rows: values (T, number of components).
        order: of the time derivative.
    """
    infix, derivative, per_time = DERIVATIVES[order]
    columns = [
        Column(f"{prefix}_{infix}{name}", f"{unit}{per_time}", f"{derivative}{description}")
        for name, unit in zip(*components, strict=True)
    ]
    return MotionTable(tuple(columns), rows)


def _select_columns(names: Sequence[str], wanted: Sequence[str] | None) -> list[int]:
    """Return the indices of the wanted columns, by names or prefixes of names; all when None.

    Raises:
        InvalidInput: a column is unknown; the message lists the valid ones.
    """
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
