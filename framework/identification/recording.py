"""Recorded motions: CSV files with the columns of motion.csv, read strictly, and simulated sensors.

Columns are time, motor_angle_JOINT and torque_JOINT (motor side of the gear), platform_AXIS, distance_NAME
and touch_AXIS (see `fixtures`), and joint_NAME for joints that have a sensor but no motor, in SI units and
radians. Other columns are ignored. So are rows that lack time, a motor angle or a torque (an empty cell, nan)
and rows that repeat the one before: loggers write these where a sensor said nothing new. Other columns may
have gaps, as those of trackers that are slower than motors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from framework.argument_errors import explain_errors
from framework.errors import (
    LARGEST_NUMBER,
    InvalidInput,
    check_choice,
    choose_from,
    list_names,
    real_numbers,
    short,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.fields import MAX_ROWS, CheckedNumbers, NotNegative, Positive
from framework.numerics.input import csv_rows, read_text
from framework.simulation.simulate import Simulation
from framework.tolerances import SAME_PLACE

HELD_OUT_EVERY = 4  # every fourth part of a recording is held out for validation
LINEAR_AXES = ("x", "y", "z")
DISTANCE, TOUCH = "distance_", "touch_"  # prefixes of columns that refer to fixtures


@dataclass(frozen=True, eq=False)
class Recording(ReadOnlyArrays):
    """Measured samples by column name, in SI units, on the motor side of the gears."""

    source: str  # named in error messages
    names: Names  # of the columns
    values: Array  # (T, columns); NaN where a column of neither time nor motors has no number
    lines: tuple[int, ...] = ()  # (T,) of the file, counted from 1 with the header; empty without a file
    others: Names = ()  # columns of the file that are not read
    left_out: int = 0  # rows that lack a number or repeat the one before

    def __post_init__(self) -> None:
        """Refuse values of another shape than (T, columns)."""
        values = real_numbers("values", self.values)
        if values.ndim != 2 or values.shape[1] != len(self.names):
            columns = f"a row for each sample, and columns {', '.join(map(str, self.names))}"
            raise InvalidInput(f"values: need {columns}, got an array of shape {values.shape}")
        self.__dict__["values"] = values
        super().__post_init__()

    def __len__(self) -> int:
        """Return the number of samples T."""
        return len(self.values)

    def row(self, k: int) -> str:
        """Name the sample with index k as a spreadsheet counts rows, or by its number."""
        return f"line {self.lines[k]}" if self.lines else f"sample {k + 1}"

    def column(self, name: str) -> Array:
        """Return one column (T,).

        Raises:
            InvalidInput: the column is missing.
        """
        return self._select([name])[:, 0]

    @explain_errors
    def columns(self, prefix: str, endings: Sequence[str]) -> Array:
        """Return the columns PREFIX_ENDING of k endings as an array (T, k).

        Raises:
            InvalidInput: a column is missing.
        """
        return self._select([f"{prefix}_{ending}" for ending in endings])

    def _select(self, names: Sequence[str]) -> Array:
        """Return the columns `names` (k,) as an array (T, k)."""
        missing = [str(name) for name in names if name not in self.names]
        if missing:
            others = ""
            if self.others:
                listed = list_names(self.others, most=12)
                others = f", and unread {listed}; --column {missing[0]}=HEADER says which of these it is"
            raise InvalidInput(
                f"{self.source}: no column {', '.join(missing)}; it has {', '.join(self.names) or 'none'}"
                f"{others}"
            )
        return self.values[:, [self.names.index(name) for name in names]]

    def has(self, prefix: str, endings: Sequence[str]) -> bool:
        """Return whether the recording has all columns PREFIX_ENDING."""
        return all(f"{prefix}_{ending}" in self.names for ending in endings)

    def as_csv(self) -> str:
        """Return the samples as CSV text, with all digits."""
        lines = [",".join(map(repr, row)) for row in self.values.tolist()]
        return "\n".join([",".join(self.names), *lines]) + "\n"

    def complete(self, prefix: str = "") -> Recording:
        """Return the samples with numbers in all columns whose names begin with `prefix`."""
        columns = [k for k, name in enumerate(self.names) if name.startswith(prefix)]
        lacks = np.isnan(self.values[:, columns]).any(axis=1)  # (T,)
        if not lacks.any():
            return self
        left_out = self.left_out + int(np.count_nonzero(lacks))
        return replace(self.rows(np.flatnonzero(~lacks)), left_out=left_out)

    @explain_errors
    def rows(self, index: slice | IntArray) -> Recording:
        """Return the recording of the samples at an index or a slice."""
        lines = tuple(np.array(self.lines)[index].tolist()) if self.lines else ()
        return replace(self, values=self.values[index], lines=lines)


def recording_columns(robot: ParallelRobot) -> Names:
    """Return all column names that a recording of this robot may have."""
    joints = robot.actuator_names
    passive = [robot.coordinates.name_of(int(column)) for column in robot.passive]
    # a tracker measures positions even if they are no coordinates of the platform
    axes = dict.fromkeys([*robot.axis_names, *LINEAR_AXES])
    return (
        "time",
        *(f"motor_angle_{joint}" for joint in joints),
        *(f"torque_{joint}" for joint in joints),
        *(f"platform_{axis}" for axis in axes),
        *(f"{TOUCH}{axis}" for axis in LINEAR_AXES),
        *(f"joint_{name}" for name in passive),
    )


def read_recording(
    robot: ParallelRobot,
    file: str | Path,
    *,
    headers: Mapping[str, str] = MappingProxyType({}),
    largest_bytes: int = 200_000_000,
) -> Recording:
    """Read a recording of a robot from a CSV file, ignoring unknown columns.

    Args:
        headers: words of the file's first line in place of columns' names, such as {"time": "t [s]"}.

    Raises:
        InvalidInput: no such file; a row with too many or too few cells; a cell that is not a finite number;
            a repeated column; no column of this robot; time that does not advance. Messages name row and
            column.
    """
    text = read_text(file, f"{file}", largest=largest_bytes)
    text_rows = csv_rows(f"{file}", text)
    header = [name.strip() for name in next(text_rows, (1, [""]))[1]]
    for name, word in headers.items():
        if not name.startswith(DISTANCE):
            check_choice("column of --column", name, recording_columns(robot))
        check_choice("header of --column", word, header)
    names = {word: name for name, word in headers.items()}
    if len(names) < len(headers):
        raise InvalidInput(f"--column: {len(headers)} names for {len(names)} header of {file}")
    header = [names.get(word, word) for word in header]
    # the header must name columns of this robot, each once
    valid = recording_columns(robot)
    if not set(header) & set(valid):
        raise InvalidInput(
            f"{file}: the first line has no column of {robot.name}: "
            f"{choose_from('column', ', '.join(header[:4]), valid)}"
        )
    repeated = sorted({name for name in header if header.count(name) > 1})
    if repeated:
        raise InvalidInput(f"{file}: column {repeated[0]} is there {header.count(repeated[0])} times")

    # read the columns of this robot
    columns = [k for k, name in enumerate(header) if name in valid or name.startswith(DISTANCE)]
    rows = [(line, _read_row(f"{file}: line {line}", header, columns, cells)) for line, cells in text_rows]
    values = np.array([numbers for _, numbers in rows]).reshape(len(rows), len(columns))  # (T, columns)
    has_numbers = ~np.isnan(values)
    empty = [header[k] for k in np.array(columns)[~has_numbers.any(axis=0)]]
    if rows and empty:
        raise InvalidInput(f"{file}: column {empty[0]} has no number")
    needed = [header[k] == "time" or header[k].startswith(("motor_angle_", "torque_")) for k in columns]
    used = has_numbers[:, needed].all(axis=1)
    if "time" in header:
        differs = (values[1:] != values[:-1]) & (has_numbers[1:] | has_numbers[:-1])
        used[1:] &= differs.any(axis=1)
    if np.count_nonzero(used) < 2:
        raise InvalidInput(f"{file}: {np.count_nonzero(used)} rows of numbers; at least 2 are needed")
    recording = Recording(
        source=str(file),
        names=tuple(header[k] for k in columns),
        values=values[used],
        lines=tuple(line for (line, _), is_used in zip(rows, used, strict=True) if is_used),
        others=tuple(name for k, name in enumerate(header) if k not in columns),
        left_out=int(np.count_nonzero(~used)),
    )
    check_recording(recording)
    return recording


def _read_row(where: str, header: Sequence[str], columns: Sequence[int], cells: Sequence[str]) -> list[float]:
    """Read the numbers of the row `cells` at indices `columns`, NaN for none; `where` names file and line.

    Raises:
        InvalidInput: another number of cells than of names in `header`; a cell that is no number of at most
            LARGEST_NUMBER.
    """
    if len(cells) != len(header):
        hint = "; decimals need points, not commas" if len(cells) == 2 * len(header) else ""
        raise InvalidInput(f"{where}: {len(cells)} cells for {len(header)} columns{hint}")
    numbers = []
    for k in columns:
        if cells[k].strip().lower() in ("", "nan"):
            numbers.append(np.nan)
            continue
        try:
            number = float(cells[k])
        except ValueError:
            number = np.nan  # refused like any other that is not finite
        if not abs(number) <= LARGEST_NUMBER:
            raise InvalidInput(f"{where}: {header[k]} needs a finite number, got {short(cells[k])}")
        numbers.append(number)
    return numbers


def are_usual_steps(times: Array) -> BoolArray:
    """Return which steps (T - 1,) between times (T,) [s] are no gaps in a recording."""
    longest = 1.5  # of the median step
    steps = np.diff(times)
    return np.asarray(steps <= longest * np.median(steps))


def check_recording(recording: Recording) -> None:
    """Raise InvalidInput if time does not advance."""
    if "time" in recording.names:
        not_later = np.flatnonzero(np.diff(recording.column("time")) <= 0.0)
        if len(not_later):
            where = recording.row(int(not_later[0]))
            raise InvalidInput(f"{recording.source}: time does not advance after {where}")


# ------------------------------------------------------------------ simulated sensors


@dataclass(frozen=True)
class Sensors(CheckedNumbers):
    """Noise (standard deviations) and resolution (steps) of sensors, on the motor side; 0 for none.

    By default encoders have 16 bits per motor turn, or steps of a micrometre. Torques are known from motor
    currents to 1 % of each motor's largest torque. A tracker measures the platform to 20 micrometres.
    """

    rate: Positive = 1000.0  # [Hz]
    angle_noise: NotNegative = 0.0  # [rad or m]
    angle_step: NotNegative = 2.0 * np.pi / 2**16  # [rad]
    slide_step: NotNegative = 1e-6  # [m] of slides without a gear
    torque_noise: NotNegative = 0.01  # share of the motor's largest torque
    torque_step: NotNegative = 0.0  # share of the motor's largest torque
    platform_noise: NotNegative = 2e-5  # [m]; for turns this is divided by the robot's length [rad]
    seed: int = 0


def record_sensors(
    simulation: Simulation, torque: Callable[[Array], Array], sensors: Sensors | None = None
) -> Recording:
    """Sample a simulated motion with the errors of sensors.

    The columns are time, motor angles, motor torques and platform.

    Args:
        torque: returns motor torques (T, n_a) [N m, N], motor side, at instants t (T,) [s]; for example
            `plan.torque`.
        sensors: errors of the sensors; by default those of `Sensors()`.

    Raises:
        InvalidInput: more than ten million samples.
    """
    sensors = sensors or Sensors()
    robot = simulation.robot
    random = np.random.default_rng(sensors.seed)
    periods = simulation.duration * sensors.rate
    count = int(periods * (1.0 + SAME_PLACE)) + 1  # with a sample at the end, despite rounding
    if count > MAX_ROWS:
        raise InvalidInput(f"sensors: rate {sensors.rate:g} Hz makes {count} samples, at most {MAX_ROWS}")

    times = np.arange(count) / sensors.rate
    times[-1] = min(times[-1], simulation.duration)
    angles = robot.gear_ratio * robot.actuated_coordinates(simulation.configuration(times))  # (T, n_a)
    torques = np.asarray(torque(times))  # (T, n_a)
    is_slide = np.array(robot.torque_units) == "N"  # motors of slides without a gear exert forces
    steps = np.where(is_slide, sensors.slide_step, sensors.angle_step)
    largest = np.abs(torques).max(axis=0)
    platform_noise = sensors.platform_noise * robot.platform_scale / robot.length

    # these are the first of `recording_columns`, in the same order
    columns = [
        times[:, None],
        _add_sensor_errors(random, angles, sensors.angle_noise, steps),
        _add_sensor_errors(random, torques, sensors.torque_noise * largest, sensors.torque_step * largest),
        _add_sensor_errors(random, simulation.platform(times), platform_noise, step=0.0),
    ]
    values = np.concatenate(columns, axis=1)
    return Recording(f"sensors of {robot.name}", recording_columns(robot)[: values.shape[1]], values)


def _add_sensor_errors(
    random: np.random.Generator, values: Array, noise: Array | float, step: Array | float
) -> Array:
    """Add normal noise to values (T, k), and round to multiples of a step, for each column or one for all."""
    noisy = values + noise * random.standard_normal(values.shape)
    divisor = np.where(np.asarray(step) > 0, step, 1.0)  # against 0 / 0
    return np.where(np.asarray(step) > 0, np.round(noisy / divisor) * step, noisy)


def make_sensors(properties: dict[str, float]) -> Sensors:
    """Return sensors with properties by name, and defaults for the others.

    Raises:
        InvalidInput: an unknown name, or a value out of range.
    """
    for name in properties:
        check_choice("property of --sensors", name, vars(Sensors()))
    values: dict[str, Any] = {**properties, "seed": int(properties.get("seed", 0))}
    return Sensors(**values)
