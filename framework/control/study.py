"""Many runs of one controlled crossing on robots that differ from their model.

Runs are computed in chunks by any `concurrent.futures.Executor`. Each run is drawn from its own seed and has
the same result in any chunk, so results depend neither on the executor nor on the chunks. Finished chunks can
be stored, for a study that is interrupted.
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
from framework.numerics.kept import ArrayField, Arrays, KeptChunks, fits
from framework.numerics.tasks import iterate_results

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
        """Seeds of the failed runs; `draw(robot, spread, seed)` returns the same robot again."""
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
        keeper: stores finished chunks; chunks that it has already are not computed again.
        progress: called with the number of finished runs. Without an executor, the share of the motion that
            is done counts for runs that are not finished.

    Raises:
        InvalidInput: fewer than one run, a negative seed.
    """
    if runs < 1 or isinstance(runs, bool):
        raise InvalidInput(f"runs: needs at least 1, got {runs!r}")
    if seed < 0:
        raise InvalidInput(f"seed: needs a whole number of at least 0, got {seed!r}")
    started = time.perf_counter()
    finished = _select_chunks(keeper.read() if keeper is not None else [], runs)

    def report(partial_runs: float = 0.0) -> None:
        progress(sum(map(len, finished)) + int(partial_runs))

    task = partial(run_chunk, controller, loop, spread, seed)

    def run_and_report(part: range) -> Run:
        return task(part, lambda share: report(share * len(part)))

    missing = _missing_chunks(finished, runs, min(chunk or RUNS_PER_CHUNK, RUNS_PER_CHUNK))
    report()
    for part, run in iterate_results(run_and_report if executor is None else task, missing, executor):
        finished[part] = run
        if keeper is not None:
            keeper.keep(part, run)
        report()
    in_order = [finished[part] for part in sorted(finished, key=lambda part: part.start)]
    return _join_chunks(in_order, name, spread, seed, time.perf_counter() - started)


def _join_chunks(chunks: Sequence[Run], controller: str, spread: Spread, seed: int, seconds: float) -> Study:
    """Join the runs of all chunks, in order, into one study."""
    arrays = {name: np.concatenate([getattr(run, name) for run in chunks]) for name in _stored_arrays(0, 0)}
    return Study(controller=controller, spread=spread, seed=seed, **_run_fields(arrays), seconds=seconds)


def _select_chunks(stored: list[tuple[range, Run]], runs: int) -> dict[range, Run]:
    """Select stored chunks within the first `runs` runs that overlap no earlier one."""
    chunks: dict[range, Run] = {}
    end = 0
    for part, run in sorted(stored, key=lambda item: item[0].start):
        if end <= part.start < part.stop <= runs:
            chunks[part] = run
            end = part.stop
    return chunks


def _missing_chunks(finished: Iterable[range], runs: int, chunk: int) -> list[range]:
    """List the unfinished of the first `runs` runs, in chunks of at most `chunk`."""
    missing: list[range] = []
    end = 0
    end_of_all = range(runs, runs)  # closes the last gap
    for part in (*sorted(finished, key=lambda part: part.start), end_of_all):
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
    report_progress: Callable[[float], None] = lambda share: None,
) -> Run:
    """Do the runs of one chunk; report the share of the motion that is done."""
    robot = controller.reference.robot
    variations = [draw(robot, spread, (seed, number)) for number in chunk]
    return run_closed_loop(controller, loop, spread, variations, report_progress=report_progress)


# ------------------------------------------------------------------ finished runs on disk


def _stored_arrays(runs: int, motors: int) -> dict[str, ArrayField]:
    """Return types and shapes of a chunk's stored arrays, by field of `Run`."""
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
    """The stored chunks of one controller's runs, in a folder."""

    chunks: KeptChunks
    motors: int  # of the robot

    @staticmethod
    def of(out: Path, setup: Mapping[str, Any], controller: str) -> KeptRuns:
        """Return the store in the folder `out` for runs of this setup (JSON)."""
        plan = dict(setup["plan"])
        plan.pop("seconds", None)  # the same plan, made in another time
        return KeptRuns(KeptChunks.of(out, {**setup, "plan": plan}, controller), len(setup["limit"]))

    def read(self) -> list[tuple[range, Run]]:
        """Read the stored runs with the range of their numbers; ignore other files."""
        runs = []
        for name, arrays in self.chunks.read().items():
            try:
                first, stop = map(int, name.split("-"))
            except ValueError:
                continue
            if fits(arrays, _stored_arrays(stop - first, self.motors)):
                x = np.empty((0, 0, 0))  # not stored
                runs.append((range(first, stop), Run(**_run_fields(arrays), x=x)))
        return runs

    def keep(self, chunk: range, run: Run) -> None:
        """Store a finished chunk.

        Raises:
            OutputError: the chunk cannot be written.
        """
        arrays = {name: np.asarray(getattr(run, name)) for name in _stored_arrays(0, 0)}
        self.chunks.keep(f"{chunk.start}-{chunk.stop}", arrays)


def _run_fields(arrays: Arrays) -> dict[str, Any]:
    """Convert stored arrays to fields of `Run` and `Study`."""
    return {**arrays, "why": tuple(arrays["why"].tolist())}
