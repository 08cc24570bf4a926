"""Many runs of one controlled crossing on robots that differ from their model.

Runs go out in chunks through any `concurrent.futures.Executor`. Each run is drawn from its own seed, and
comes out the same in any chunk: results depend neither on the executor nor on chunks, and finished chunks
can be kept for a study that is stopped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from framework.control.closed_loop import run_closed_loop
from framework.control.estimation import Controller
from framework.control.run_monitor import ControlLoop, Outcomes, Run
from framework.control.variation import Spread, draw
from framework.errors import InvalidInput
from framework.parallel.kept import ArrayField, Arrays, KeptChunks, fits
from framework.parallel.tasks import iterate_results

RUNS_PER_CHUNK = 250  # runs that are stacked; more do not make a run cheaper


@dataclass(frozen=True, eq=False, kw_only=True)
class Study(Outcomes):
    """The outcomes of many runs, drawn one after the other."""

    controller: str
    spread: Spread
    seed: int
    seconds: float

    @property
    def probability(self) -> float:
        """Share of the runs that passed."""
        return float(self.passed.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the probability of passing."""
        from scipy.stats import binomtest  # takes time to import

        passes = binomtest(int(np.count_nonzero(self.passed)), len(self.passed))
        low, high = passes.proportion_ci(method="wilson")
        return float(low), float(high)

    @property
    def failures(self) -> list[tuple[int, int]]:
        """Seeds of the runs that failed, from which `draw(robot, spread, seed)` makes each again."""
        return [(self.seed, int(k)) for k in np.flatnonzero(~self.passed)]


def run_study(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    *,
    runs: int,
    name: str = "controller",
    seed: int = 0,
    executor: Executor | None = None,
    chunk: int | None = None,
    keeper: KeptRuns | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Study:
    """Do `runs` closed-loop runs, each of a robot drawn from the spread.

    Args:
        executor: where chunks of runs are computed; this process when None. It must be able to pickle
            the controller.
        chunk: runs that are computed together, at most and by default 250; no result depends on it.
        keeper: where finished chunks are kept, and taken from if they are there already.
        progress: called with the number of runs that are finished; in this process those under way count
            by their share of the motion.

    Raises:
        InvalidInput: fewer than one run, a negative seed.
    """
    if runs < 1 or isinstance(runs, bool):
        raise InvalidInput(f"runs: needs at least 1, got {runs!r}")
    if seed < 0:
        raise InvalidInput(f"seed: needs a whole number of at least 0, got {seed!r}")
    started = time.perf_counter()
    finished = _select_chunks(keeper.read() if keeper is not None else [], runs)

    def report(under_way: float = 0.0) -> None:
        progress(sum(map(len, finished)) + int(under_way))

    task = partial(run_chunk, controller, loop, spread, seed)

    def run_and_report(part: range) -> Run:
        return task(part, lambda share: report(share * len(part)))

    missing = _missing(finished, runs, min(chunk or RUNS_PER_CHUNK, RUNS_PER_CHUNK))
    report()
    for part, run in iterate_results(run_and_report if executor is None else task, missing, executor):
        finished[part] = run
        if keeper is not None:
            keeper.keep(part, run)
        report()
    in_order = [finished[part] for part in sorted(finished, key=lambda part: part.start)]
    return _join(in_order, name, spread, seed, time.perf_counter() - started)


def _join(chunks: Sequence[Run], controller: str, spread: Spread, seed: int, seconds: float) -> Study:
    """Join the runs of all chunks into one study."""
    kept = {name: np.concatenate([getattr(run, name) for run in chunks]) for name in _kept_arrays(0, 0)}
    return Study(controller=controller, spread=spread, seed=seed, **_with_reasons(kept), seconds=seconds)


def _select_chunks(stored: list[tuple[range, Run]], runs: int) -> dict[range, Run]:
    """Return the stored chunks that belong to the study and do not overlap."""
    chunks: dict[range, Run] = {}
    end = 0
    for part, run in sorted(stored, key=lambda item: item[0].start):
        if end <= part.start < part.stop <= runs:
            chunks[part] = run
            end = part.stop
    return chunks


def _missing(finished: Iterable[range], runs: int, chunk: int) -> list[range]:
    """Return the other runs, in chunks."""
    missing, end = [], 0
    for part in (*sorted(finished, key=lambda part: part.start), range(runs, runs)):
        gap = range(end, part.start)
        missing += [gap[first : first + chunk] for first in range(0, len(gap), chunk)]
        end = part.stop
    return missing


def run_chunk(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    seed: int,
    chunk: range,
    advanced: Callable[[float], None] = lambda share: None,
) -> Run:
    """Do the runs of one chunk."""
    robot = controller.reference.robot
    variations = [draw(robot, spread, (seed, number)) for number in chunk]
    return run_closed_loop(controller, loop, spread, variations, advanced=advanced)


# ------------------------------------------------------------------ finished runs on disk


def _kept_arrays(runs: int, motors: int) -> dict[str, ArrayField]:
    """Return the arrays of a chunk of runs, fields of `Run`."""
    numbers = ArrayField("f", (runs,))
    return {
        "passed": ArrayField("b", (runs,)),
        "why": ArrayField("U", (runs,)),
        "tracking_error": numbers,
        "end_error": numbers,
        "peak_torque": ArrayField("f", (runs, motors)),
        "payload": numbers,
    }


@dataclass(frozen=True)
class KeptRuns:
    """Chunks of one controller's runs in a folder."""

    chunks: KeptChunks
    motors: int  # of the robot

    @staticmethod
    def of(out: Path, setup: Mapping[str, Any], controller: str) -> KeptRuns:
        """Return the place in the folder `out` for runs of that setup, a document of JSON."""
        plan = {key: value for key, value in setup["plan"].items() if key != "seconds"}
        return KeptRuns(KeptChunks.of(out, {**setup, "plan": plan}, controller), len(setup["limit"]))

    def read(self) -> list[tuple[range, Run]]:
        """Return the finished runs, by their numbers."""
        runs = []
        for name, arrays in self.chunks.read().items():
            try:
                first, stop = map(int, name.split("-"))
            except ValueError:
                continue  # not one of ours: computed anew
            if fits(arrays, _kept_arrays(stop - first, self.motors)):
                x = np.empty((0, 0, 0))  # not kept
                runs.append((range(first, stop), Run(**_with_reasons(arrays), x=x)))
        return runs

    def keep(self, chunk: range, run: Run) -> None:
        """Store a finished chunk.

        Raises:
            OutputError: the chunk cannot be written.
        """
        arrays = {name: np.asarray(getattr(run, name)) for name in _kept_arrays(0, 0)}
        self.chunks.keep(f"{chunk.start}-{chunk.stop}", arrays)


def _with_reasons(kept: Arrays) -> dict[str, Any]:
    """Return the arrays of a chunk as fields of `Run` and `Study`, its reasons as words."""
    return {**kept, "why": tuple(kept["why"].tolist())}
