"""Many runs of one controlled crossing on robots that differ from their model.

Runs are computed in chunks by any `concurrent.futures.Executor`. Each run is drawn from its own seed and has
the same result in any chunk, so results depend neither on the executor nor on the chunks. Finished chunks can
be stored, for a study that is interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from framework.control.closed_loop import ControlLoop, Outcomes, run_closed_loop
from framework.control.controllers import Controller
from framework.control.variation import Spread, draw
from framework.errors import InvalidInput
from framework.numerics.kept import ArrayField, Arrays, KeptChunks, complete_chunks

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
        """Fraction of the runs that passed."""
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
    keeper: KeptChunks | None = None,
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
    size = min(chunk or RUNS_PER_CHUNK, RUNS_PER_CHUNK)
    chunks = {f"{first}-{first + size}": range(runs)[first : first + size] for first in range(0, runs, size)}
    finished: Collection[str] = ()

    def report(names: Collection[str], partial_runs: float = 0.0) -> None:
        nonlocal finished
        finished = names
        progress(sum(len(chunks[name]) for name in names) + int(partial_runs))

    task = partial(run_chunk, controller, loop, spread, seed)

    def run_and_report(part: range) -> Arrays:
        return task(part, lambda share: report(finished, share * len(part)))

    arrays = complete_chunks(
        run_and_report if executor is None else task,
        chunks,
        partial(_chunk_fields, controller.reference.robot.n_a),
        executor=executor,
        keeper=keeper,
        progress=report,
    )
    outcomes: dict[str, Any] = {**arrays, "why": tuple(arrays["why"].tolist())}
    seconds = time.perf_counter() - started
    return Study(controller=name, spread=spread, seed=seed, seconds=seconds, **outcomes)


def run_chunk(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    seed: int,
    chunk: range,
    report_progress: Callable[[float], None] = lambda share: None,
) -> Arrays:
    """Do the runs of one chunk; return their outcomes as arrays, by field of `Outcomes`.

    `report_progress` is called with the share of the motion that is done.
    """
    robot = controller.reference.robot
    variations = [draw(robot, spread, (seed, number)) for number in chunk]
    run = run_closed_loop(controller, loop, spread, variations, report_progress=report_progress)
    return {field.name: np.asarray(getattr(run, field.name)) for field in fields(Outcomes)}


def _chunk_fields(motors: int, chunk: range) -> dict[str, ArrayField]:
    """Return types and shapes of the outcomes of a chunk, by field of `Outcomes`."""
    numbers = ArrayField("f", (len(chunk),))
    return dict.fromkeys(("tracking_error", "end_error", "payload"), numbers) | {
        "passed": ArrayField("b", (len(chunk),)),
        "why": ArrayField("U", (len(chunk),)),
        "peak_torque": ArrayField("f", (len(chunk), motors)),
    }


def run_store(out: Path, setup: Mapping[str, Any], controller: str) -> KeptChunks:
    """Return the store in the folder `out` for runs of a controller.

    `setup` is a document of JSON, of which the time to plan does not count.
    """
    plan = {key: value for key, value in setup["plan"].items() if key != "seconds"}
    return KeptChunks.of(out, {**setup, "plan": plan}, controller)
