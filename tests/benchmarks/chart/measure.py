"""Methods as data, and the one way in which all of them are measured.

A method makes something ready for a setting (models, tables: not timed) and hands back what is to be timed.
Its stage knows the reference and says how far the result is from it. Time is processor time, the least of
several runs; so what else the machine does does not show, and threads of a library count.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import FrameworkError, InvalidInput, choose_from

Setting = tuple[float, ...]
REPEATS, ENOUGH = 5, 0.1  # runs at most, and seconds of them that are enough
LONG = 1.0  # [s] a run that takes longer is made once
SHORTEST = 2e-3  # [s] a run that is shorter is repeated within one measurement


class Judged(NamedTuple):
    """How far a result is from the reference; `profile` has the error in each class of the stage's."""

    error: float
    profile: tuple[float, ...] = ()


@dataclass(frozen=True)
class Method:
    """One way to an answer.

    name: as in a row; label: as in a figure.
    given: what it is given besides the robot, for readers of the chart.
    unit: of a setting; `settings` go from cheap to dear.
    prepare: makes ready, and gives what is timed and leaves a result for the stage to judge.
    peer: a package that may not be installed.
    panel: of the figure, where a stage has several problems.
    shown: the setting whose profile the figure shows; the one with the least error if it is left out.
    """

    name: str
    label: str
    given: str
    unit: str
    settings: tuple[Setting, ...]
    prepare: Callable[[Setting], Callable[[], Any]]
    peer: str | None = None
    ours: bool = False
    panel: str = ""
    shown: Setting | None = None

    @property
    def installed(self) -> bool:
        return self.peer is None or find_spec(self.peer) is not None


@dataclass(frozen=True)
class Stage:
    """Methods for one question, their reference, and how the chart shows them.

    abscissa: "seconds" for work against precision, else the name of what the settings are.
    profile, profiled: the classes of `Judged.profile`, and what they are.
    profile_error, profile_title: what these errors are, if not the same, and what to say of it.
    map_axes: names of the two numbers of a setting, where the figure is a map of the error over them.
    sentence: what the reader should see in the figure, from its rows.
    """

    name: str
    title: str
    reference: str
    error: str
    methods: tuple[Method, ...]
    judge: Callable[[Method, Setting, Any], Judged]
    sentence: Callable[[Sequence[Row]], str]
    abscissa: str = "seconds"
    linear: bool = False  # the abscissa
    profile: tuple[float, ...] = ()
    profiled: str = ""
    profile_error: str = ""
    profile_title: str = ""
    map_axes: tuple[str, str] | None = None

    @property
    def timed(self) -> bool:
        """Whether it shows work against precision."""
        return self.abscissa == "seconds"

    @property
    def panels(self) -> tuple[str, ...]:
        """The problems of the stage, in the order of its methods."""
        return tuple(dict.fromkeys(method.panel for method in self.methods))

    def method(self, name: str) -> Method:
        """The method of that name.

        Raises:
            InvalidInput: there is none; lists those that there are.
        """
        found = {method.name: method for method in self.methods}
        if name not in found:
            raise InvalidInput(f"{self.name}: {choose_from('method', name, found)}")
        return found[name]

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages of peers that are not installed."""
        return tuple(dict.fromkeys(str(m.peer) for m in self.methods if not m.installed))


class Row(NamedTuple):
    """One point of the chart. `error` is not finite where the method gave no result, `note` says why."""

    stage: str
    method: str
    setting: Setting
    seconds: float
    error: float
    profile: tuple[float, ...] = ()
    note: str = ""

    @property
    def key(self) -> str:
        """What makes the row again: `python -m tests.benchmarks.chart --row KEY`."""
        return f"{self.stage}:{self.method}:{','.join(f'{value:.12g}' for value in self.setting)}"


def rows_of(stage: Stage, *, repeats: int = REPEATS) -> Iterator[Row]:
    """All rows of a stage whose peers are installed, one after another; those of a map, which are not about
    time, run once."""
    repeats = 1 if stage.map_axes else repeats
    for method in stage.methods:
        if method.installed:
            for setting in method.settings:
                yield measured(stage, method, setting, repeats=repeats)


def measured(stage: Stage, method: Method, setting: Setting, *, repeats: int = REPEATS) -> Row:
    """One row."""
    try:
        run = method.prepare(setting)
        seconds, result = _timed(run, repeats)
    except (FrameworkError, ArithmeticError, np.linalg.LinAlgError) as failure:
        note = " ".join(str(failure).split())
        return Row(
            stage.name, method.name, setting, np.nan, np.inf, note=note[:200] or type(failure).__name__
        )
    error, profile = stage.judge(method, setting, result)
    return Row(stage.name, method.name, setting, seconds, float(error), tuple(map(float, profile)))


def _timed(run: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Least processor time of a run [s], and its result. The first one also makes what is made once, and
    counts only if it is so long that no other is made."""
    began = time.process_time()
    result = run()
    first = time.process_time() - began
    if repeats <= 1 or first > LONG:
        return first, result
    count = max(1, round(SHORTEST / max(first, 1e-6)))
    spent, best = 0.0, np.inf
    for _ in range(repeats):
        began = time.process_time()
        for _ in range(count):
            run()
        once = time.process_time() - began
        best, spent = min(best, once / count), spent + once
        if spent > ENOUGH:
            break
    return best, result


def relative_error(found: Array, exact: Array) -> float:
    """The largest error over the largest exact value; infinite where something found is no number."""
    with np.errstate(all="ignore"):
        error = float(np.abs(found - exact).max() / np.abs(exact).max())
    return error if np.isfinite(error) else np.inf


def read_setting(text: str) -> Setting:
    """The setting of a row's key.

    Raises:
        InvalidInput: not numbers.
    """
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InvalidInput(
            f"--row: {text!r} is no setting, which is a number or several with commas"
        ) from None


def singles(*values: float) -> tuple[Setting, ...]:
    """Settings of one number each."""
    return tuple((float(value),) for value in values)
