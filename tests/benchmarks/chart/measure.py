"""Methods as data, and the one way in which all of them are measured.

A method makes something ready for a setting (models, loads, starts: not timed) and hands back what is timed.
Its stage knows the reference and says how far the result is from it. The settings of a method go from cheap
to dear in one or more series (all but the first number of a setting are equal in a series). A series ends
where its error is below FINEST, where it has bent up, or where one run takes too long. Then all runs of a
stage are repeated in turns; time is processor time: the least, and the upper quartile as the spread.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from itertools import groupby
from typing import Any, Literal, NamedTuple

import numpy as np

from framework import FrameworkError, InvalidInput
from framework.errors import choose_from

Setting = tuple[float, ...]
FINEST = 1e-13  # error, in the unit of the stage, below which no finer setting is tried
BEND = 3  # settings in a row with more error than the least before: the curve has bent up
SHORTEST = 2e-3  # [s] a run that is shorter is repeated within one measurement


class Effort(NamedTuple):
    """How much is spent: repeats after the first run, its longest time [s], and settings of a series."""

    repeats: int
    longest: float
    settings: int


FULL, QUICK = Effort(9, 0.6, 99), Effort(0, 0.1, 1)


class Judged(NamedTuple):
    """How far a result is from the reference; `profile` has the error in each class of the stage's."""

    error: float
    profile: tuple[float, ...] = ()


@dataclass(frozen=True)
class Method:
    """One way to an answer.

    name: as in a row; label: as in a figure.
    prepare: makes ready, and gives what is timed and leaves a result for the stage to judge.
    given: what it is given besides the robot, for readers of the chart.
    unit: of a setting; `settings` go from cheap to dear in each series.
    source: where the setting of a peer's method comes from; ours have none.
    package: that may not be installed.
    panel: of the figure, where a stage has several problems.
    frontier: whether it is the formula of the one robot, written for it.
    """

    name: str
    label: str
    prepare: Callable[[Setting], Callable[[], Any]]
    given: str
    unit: str
    settings: tuple[Setting, ...]
    source: str = ""
    package: str | None = None
    panel: str = ""
    frontier: bool = False

    @property
    def kind(self) -> Literal["ours", "peer", "frontier"]:
        return "frontier" if self.frontier else "peer" if self.source else "ours"

    @property
    def installed(self) -> bool:
        return self.package is None or find_spec(self.package) is not None

    @property
    def series(self) -> list[list[Setting]]:
        """The settings, one list for each series."""
        return [list(group) for _, group in groupby(self.settings, key=lambda setting: setting[1:])]


def no_remark(rows: Sequence[Row]) -> str:
    """Nothing besides the times."""
    return ""


@dataclass(frozen=True)
class Stage:
    """Methods for one question, their reference, and how the chart shows them.

    goals: errors to which the times of the methods are compared; none where the figure is a map.
    profile, profiled: the classes of `Judged.profile`, and what they are.
    profile_title: what to say of these errors.
    remark: what the reader should see besides the times, from the rows.
    short: names of at most five curves, by method of one panel, for the figure that is read at a glance.
    """

    name: str
    title: str
    reference: str
    error: str
    methods: tuple[Method, ...]
    judge: Callable[[Method, Setting, Any], Judged]
    goals: tuple[float, ...] = ()
    remark: Callable[[Sequence[Row]], str] = no_remark
    profile: tuple[float, ...] = ()
    profiled: str = ""
    profile_title: str = ""
    short: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_map(self) -> bool:
        """Whether the figure is a map over the two numbers of a setting, named by the unit of its method."""
        return not self.goals

    @property
    def has_peers(self) -> bool:
        """Whether some methods are others'."""
        return any(method.kind == "peer" for method in self.methods)

    @property
    def panels(self) -> tuple[str, ...]:
        """The problems of the stage, in the order of its methods."""
        return tuple(dict.fromkeys(method.panel for method in self.methods))

    def only(self, panel: str) -> Stage:
        """The stage with the methods of one problem."""
        return replace(self, methods=tuple(one for one in self.methods if one.panel == panel))

    def method(self, name: str) -> Method:
        """The method of that name.

        Raises:
            InvalidInput: there is none; lists those that there are.
        """
        known = {method.name: method for method in self.methods}
        if name not in known:
            raise InvalidInput(f"{self.name}: {choose_from('method', name, known)}")
        return known[name]

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages of peers that are not installed."""
        return tuple(dict.fromkeys(str(m.package) for m in self.methods if not m.installed))


class Row(NamedTuple):
    """One point of the chart. `error` is not finite where the method gave no result, `note` says why."""

    stage: str
    method: str
    setting: Setting
    seconds: float
    upper: float  # quartile of the repeats [s]
    error: float
    profile: tuple[float, ...] = ()
    note: str = ""

    @property
    def key(self) -> str:
        """What makes the row again: `python -m tests.benchmarks.chart --row KEY`."""
        return f"{self.stage}:{self.method}:{','.join(f'{value:.12g}' for value in self.setting)}"


class Trial(NamedTuple):
    """A row after its first run, and how to run it again."""

    row: Row
    run: Callable[[], Any]
    runs: int  # in one measurement


def rows_of(stage: Stage, effort: Effort = FULL) -> list[Row]:
    """All rows of a stage whose peers are installed."""
    installed = [method for method in stage.methods if method.installed]
    trials = [
        trial
        for method in installed
        for series in method.series
        for trial in _series(stage, method, series, effort)
    ]
    return _repeated(trials, 0 if stage.is_map else effort.repeats)


def _series(stage: Stage, method: Method, settings: list[Setting], effort: Effort) -> Iterator[Trial]:
    least, worse = np.inf, 0
    for setting in settings[: effort.settings]:
        trial = tried(stage, method, setting)
        yield trial
        if stage.goals and np.isfinite(trial.row.error):
            worse = worse + 1 if trial.row.error > least else 0
            least = min(least, trial.row.error)
            if least < FINEST or worse == BEND or trial.row.seconds > effort.longest:
                return


def measured(stage: Stage, method: Method, setting: Setting, *, repeats: int = FULL.repeats) -> Row:
    """One row alone."""
    return _repeated([tried(stage, method, setting)], repeats)[0]


def tried(stage: Stage, method: Method, setting: Setting) -> Trial:
    """The first run of a row, which also makes what is made once."""
    try:
        run = method.prepare(setting)
        began = time.process_time()
        result = run()
        first = time.process_time() - began
        error, profile = stage.judge(method, setting, result)
        if np.isnan(error):
            raise ArithmeticError("no number")
    except (FrameworkError, ArithmeticError, ValueError, np.linalg.LinAlgError) as failure:
        note = " ".join(str(failure).split())[:200] or type(failure).__name__
        lost = Row(stage.name, method.name, setting, np.nan, np.nan, np.inf, note=note)
        return Trial(lost, lambda: None, 0)
    row = Row(stage.name, method.name, setting, first, first, float(error), tuple(map(float, profile)))
    return Trial(row, run, max(1, round(SHORTEST / max(first, 1e-6))))


def _repeated(trials: Sequence[Trial], repeats: int) -> list[Row]:
    """The rows with the least time of the repeats and their upper quartile, in turns."""
    times = np.full((repeats, len(trials)), np.nan)
    for round_ in times:
        for k, trial in enumerate(trials):
            began = time.process_time()
            for _ in range(trial.runs):
                trial.run()
            round_[k] = (time.process_time() - began) / max(trial.runs, 1)
    if not repeats:
        return [trial.row for trial in trials]
    return [
        trial.row._replace(seconds=float(least), upper=float(upper)) if trial.runs else trial.row
        for trial, least, upper in zip(
            trials, times.min(axis=0), np.quantile(times, 0.75, axis=0), strict=True
        )
    ]


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


def pairs(values: Sequence[float], others: Sequence[float]) -> tuple[Setting, ...]:
    """Settings of two numbers, a series over `values` for each of the others."""
    return tuple((float(value), float(other)) for other in others for value in values)
