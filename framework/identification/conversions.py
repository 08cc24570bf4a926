"""Columns of a recording in other units, with other signs, or exchanged: declared, or found by the model.

No column is converted unless somebody says so. But if the recording contradicts the model, and one change
that people forget makes the squared misfit fall tenfold, the refusal names the column and the option that
declares the change.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from framework.errors import InvalidInput, NoAnswer, check_choice, expect
from framework.identification.recording import (
    LINEAR_AXES,
    Recording,
    are_usual_steps,
    check_recording,
    read_recording,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.tolerances import CLEAR_MISFIT, FAULT_RATIO

_SECOND = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_ANGLE = {"rad": 1.0, "deg": np.pi / 180.0, "turn": 2.0 * np.pi}
_LENGTH = {"m": 1.0, "mm": 1e-3}
_POSITION = {**_ANGLE, **_LENGTH}
_TORQUE = {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "N": 1.0}
UNITS = {  # SI values of the units that the columns of a kind may have; the first is the default
    "time": _SECOND,
    "motor_angle": _POSITION,
    "torque": _TORQUE,
    "platform": _POSITION,
    "joint": _POSITION,
    "distance": _LENGTH,
    "touch": _LENGTH,
}


@dataclass(frozen=True)
class Conversions:
    """What turns the columns of a file into SI units and the robot's directions.

    Columns are named by kind (`motor_angle`, for all of them) or in full.
    """

    units: Mapping[str, str] = field(default_factory=dict)  # {"motor_angle": "deg"}, or SI units as "0.02"
    signs: Mapping[str, float] = field(default_factory=dict)  # such as {"torque_left": -1}
    swaps: Mapping[str, str] = field(default_factory=dict)  # columns that are exchanged for one another
    zeros: Mapping[str, float] = field(default_factory=dict)  # readings of columns whose value is zero
    headers: Mapping[str, str] = field(default_factory=dict)  # words of a file in place of columns' names
    unwrapped: Sequence[str] = ()  # columns of angles that jump by whole turns, which are counted on

    def __post_init__(self) -> None:
        """Check that each field but the last is a mapping."""
        for name, given in [*vars(self).items()][:-1]:
            expect(name, given, Mapping, '{"motor_angle": ...}')

    def convert(self, data: Recording) -> Recording:
        """Return the recording in SI units, with its columns exchanged and turned.

        Raises:
            InvalidInput: an unknown column or unit, or a sign that is neither 1 nor -1.
        """
        names = list(data.names)
        for one, other in self.swaps.items():
            for name in (one, other):
                check_choice("column of --swap", name, data.names)
            i, j = data.names.index(one), data.names.index(other)
            names[i], names[j] = names[j], names[i]
        values = data.values.copy()
        for column, unit in self.units.items():
            chosen = _columns_of(names, column, "--unit")
            try:
                sizes = [float(unit)] * len(chosen)  # such as that of an encoder's count
            except ValueError:
                tables = [_units_of(names[k]) for k in chosen]
                check_choice(f"unit of {column}", unit, {name for table in tables for name in table})
                sizes = [table.get(unit, 1.0) for table in tables]
            if not np.isfinite(sizes).all() or 0.0 in sizes:
                raise InvalidInput(f"unit of {column}: needs a name or a number but 0, got {unit!r}")
            values[:, chosen] *= sizes
        for column, sign in self.signs.items():
            if abs(sign) != 1.0:
                raise InvalidInput(f"--sign {column}: needs 1 or -1, got {sign:g}")
            values[:, _columns_of(names, column, "--sign")] *= sign
        for column in self.unwrapped:
            chosen = _columns_of(names, column, "--unwrap")
            angles = [k for k in chosen if "rad" in _units_of(names[k])]
            if not angles:
                raise InvalidInput(f"--unwrap {column}: has no angles")
            times = data.column("time") if "time" in data.names else np.arange(float(len(data)))
            for k in angles:
                values[:, k] = _count_turns(data, times, values[:, k], names[k])
        for column, zero in self.zeros.items():
            values[:, _columns_of(names, column, "--zero")] -= zero
        return replace(data, names=tuple(names), values=values)

    def __str__(self) -> str:
        """Return the options of the command line that declare these conversions."""
        options: dict[str, Mapping[str, str | float]] = {
            "--unit": self.units,
            "--sign": self.signs,
            "--zero": self.zeros,
            "--swap": self.swaps,
            "--column": self.headers,
        }
        words = []
        for option, pairs in options.items():
            texts = [v if isinstance(v, str) else f"{v:g}" for v in pairs.values()]
            words += [option] * bool(pairs) + [
                shlex.quote(f"{k}={v}") for k, v in zip(pairs, texts, strict=True)
            ]
        return " ".join([*words, *["--unwrap"] * bool(self.unwrapped), *self.unwrapped])


def _count_turns(data: Recording, times: Array, angles: Array, name: str) -> Array:
    """Count the turns of angles (T,) [rad] that begin anew after one turn.

    Between samples of the usual distance a motor turns by less than half a turn. Over a gap in time it turns
    by a mean speed between those before and behind the gap.

    Raises:
        InvalidInput: steps change by half a turn from one to the next, so that the motor may turn faster; or
            these speeds differ by a turn over a gap.
    """
    speed_steps = 8  # samples from which a speed is taken
    known = np.flatnonzero(~np.isnan(angles))
    if len(known) < 2:
        return angles
    t, steps = times[known], np.diff(times[known])
    counted = np.unwrap(angles[known])
    is_gap = ~are_usual_steps(t)
    gaps = np.flatnonzero(is_gap)  # behind these samples
    jumps = np.abs(np.diff(np.where(is_gap, np.nan, np.diff(counted)))) > np.pi
    if jumps.any():
        raise InvalidInput(
            f"{data.source}: {name} makes half a turn or more from one sample to the next near "
            f"{data.row(int(known[1 + np.argmax(jumps)]))}; record at a higher rate"
        )
    ends = np.array([-1, *gaps, len(t) - 1])
    for k, first, last in zip(gaps, ends[:-2] + 1, ends[2:], strict=True):
        i, j = max(first, k - speed_steps), min(last, k + 1 + speed_steps)
        rises, durations = counted[[k, j]] - counted[[i, k + 1]], t[[k, j]] - t[[i, k + 1]]
        speeds = rises[durations > 0] / durations[durations > 0]  # of those that are known
        turns = np.round((counted[k] + speeds * steps[k] - counted[k + 1]) / (2.0 * np.pi))
        if not len(turns) or np.ptp(turns):
            raise InvalidInput(
                f"{data.source}: {name} may make more or fewer turns between {data.row(int(known[k]))} "
                f"and {data.row(int(known[k + 1]))}; record without this gap"
            )
        counted[k + 1 :] += 2.0 * np.pi * turns[0]
    result = angles.copy()
    result[known] = counted
    return result


def load_recording(
    robot: ParallelRobot, data: Recording | str | Path, conversions: Conversions | None
) -> Recording:
    """Check a recording, or read one if `data` is a file name, and convert its columns.

    Raises:
        InvalidInput: the file cannot be read, time does not advance, or a conversion is unknown.
    """
    conversions = conversions or Conversions()
    if not isinstance(data, Recording):
        data = read_recording(robot, data, headers=conversions.headers)
    elif conversions.headers:
        raise InvalidInput("--column: names columns of a file, and this recording has been read")
    check_recording(data)
    return conversions.convert(data)


def _kind_of(column: str) -> str:
    """Return the kind of a column, a key of UNITS: `torque` of `torque_left`, and of itself."""
    return next(kind for kind in UNITS if column == kind or column.startswith(f"{kind}_"))


def _units_of(column: str) -> Mapping[str, float]:
    """Return the SI values of the units that a column may have: `platform_x` only those of lengths.

    The word `platform` itself stands for all its columns, with units of lengths and of angles.
    """
    if column.startswith("platform_"):
        return _LENGTH if column.removeprefix("platform_") in LINEAR_AXES else _ANGLE
    return UNITS[_kind_of(column)]


def _columns_of(names: Sequence[str], column: str, option: str) -> list[int]:
    """Return the indices of the columns that `column` names, in full or by kind."""
    kinds = dict.fromkeys(_kind_of(name) for name in names)
    check_choice(f"column of {option}", column, [*kinds, *names])
    return [k for k, name in enumerate(names) if column in (name, _kind_of(name))]


def suspects(data: Recording, kinds: Sequence[str]) -> Iterator[Conversions]:
    """Yield the conversions that people forget to state, one at a time.

    They are another unit or the opposite sign of a column or of all columns of a kind, the exchange of two
    columns of a kind, and a motor whose angle and torque are both affected.

    Args:
        kinds: of the columns that are suspected, keys of UNITS.
    """
    for kind in kinds:
        names = [name for name in data.names if _kind_of(name) == kind]
        for column in [kind, *names] if len(names) > 1 else names:
            affected = names if column == kind else [column]
            units = {unit: value for name in affected for unit, value in _units_of(name).items()}
            for unit, value in units.items():
                if value != 1.0:  # not the SI unit, which is assumed
                    yield Conversions(units={column: unit})
            if kind != "time":
                yield Conversions(signs={column: -1.0})
        for one, other in combinations(names, 2):
            if _units_of(one) == _units_of(other):
                yield Conversions(swaps={one: other})
    if "torque" in kinds:  # a motor that turns the other way, or two whose plugs are exchanged
        motors = [name.removeprefix("torque_") for name in data.names if _kind_of(name) == "torque"]
        both = {joint: (f"motor_angle_{joint}", f"torque_{joint}") for joint in motors}
        for columns in both.values():
            yield Conversions(signs=dict.fromkeys(columns, -1.0))
        for one, other in combinations(motors, 2):
            yield Conversions(swaps=dict(zip(both[one], both[other], strict=True)))


def _search_zero(
    data: Recording, column: str, measure: Callable[[Recording], float]
) -> tuple[float, Conversions]:
    """Search the zero of a column with the least misfit, within the travel of the column."""
    from scipy.optimize import minimize_scalar  # slow to import

    def misfit(zero: float) -> float:
        """Compute the squared misfit with a zero, a large number where poses fail."""
        return min(measure(Conversions(zeros={column: zero}).convert(data)), 1.0 / CLEAR_MISFIT)

    sizes = np.ptp(data.column(column)) * 0.5 ** np.arange(6)
    grid = np.array([*-sizes, 0.0, *sizes[::-1]])
    best = int(np.clip(np.argmin([misfit(zero) for zero in grid]), 1, len(grid) - 2))
    found = minimize_scalar(misfit, bounds=grid[[best - 1, best + 1]], options={"maxiter": 12})
    return float(found.fun), Conversions(zeros={column: float(f"{found.x:.6g}")})


def refuse_mistaken_columns(
    data: Recording,
    kinds: Sequence[str],
    misfit: Callable[[Recording], float],
    further: Sequence[Conversions] = (),
) -> None:
    """Raise InvalidInput if one change of a column reduces the squared misfit by FAULT_RATIO.

    Args:
        kinds: the kinds of columns that may be wrong.
        misfit: squared misfit of a recording to the model; raises NoAnswer or InvalidInput without one.
        further: conversions that people forget with this robot.
    """

    def measure(recording: Recording) -> float:
        """Compute the misfit; infinite if there is none."""
        try:
            return misfit(recording)
        except (NoAnswer, InvalidInput):
            return np.inf

    own = measure(data)
    if own <= CLEAR_MISFIT:
        return
    trials = [(measure(change.convert(data)), change) for change in [*suspects(data, kinds), *further]]
    least, change = min(trials, key=lambda trial: trial[0], default=(np.inf, Conversions()))
    is_blind = not any(_kind_of(name) == "platform" for name in data.names)  # poses would show a zero
    if least * FAULT_RATIO > min(own, 1.0) and "torque" in kinds and is_blind:
        motors = [name for name in data.names if _kind_of(name) == "motor_angle"]
        trials = [_search_zero(data, motor, measure) for motor in motors]
        least, change = min(trials, key=lambda trial: trial[0])
    if least * FAULT_RATIO > min(own, 1.0):
        return
    alike = [str(other) for value, other in trials if value <= 2.0 * least and other is not change]
    others = f" (or {' or '.join(alike[:2])}, which fits as well)" if alike else ""
    state = "does not fit at all" if np.isinf(own) else f"is off by {100 * np.sqrt(own):.3g} % of the data"
    raise InvalidInput(
        f"{data.source}: the model {state}, but with {change}{others} only by {100 * np.sqrt(least):.2g} %; "
        f"declare so if it is true, or look at the robot file"
    )
