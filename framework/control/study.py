"""Many runs of one controlled crossing on robots that differ from their model.

Runs go out in chunks of a fixed size through any `concurrent.futures.Executor`. Each run is drawn from its
own seed, and chunks do not depend on the executor: neither do the results.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array
from framework.control.closed_loop import Loop, Run, run_closed_loop
from framework.control.estimation import Controller
from framework.control.variation import Spread, draw
from framework.errors import InvalidInput

CHUNK = 250  # runs that are stacked; more do not make a run cheaper
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Study:
    """What became of R runs. `passed`: the platform came to rest near the end of the path, see `Loop`."""

    controller: str
    spread: Spread
    seed: int
    passed: NDArray[np.bool_]  # (R,)
    why: tuple[str, ...]  # (R,) empty for those that passed
    tracking_error: Array  # (R,) [robot lengths, rad] largest distance from the plan on the way
    end_error: Array  # (R,) the same at the end
    peak_torque: Array  # (R, n_a) [N m], motor side
    payload: Array  # (R,) factor
    seconds: float

    @property
    def probability(self) -> float:
        """Share of the runs that passed."""
        return float(self.passed.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the probability of passing."""
        count, z = len(self.passed), 1.959963984540054
        middle = (self.probability + z**2 / (2 * count)) / (1 + z**2 / count)
        half = (
            z
            / (1 + z**2 / count)
            * np.sqrt(self.probability * (1 - self.probability) / count + z**2 / (4 * count**2))
        )
        return max(0.0, float(middle - half)), min(1.0, float(middle + half))

    @property
    def failures(self) -> list[tuple[int, int]]:
        """Seeds of the runs that failed: `draw(robot, spread, seed)` gives each of them back."""
        return [(self.seed, int(k)) for k in np.flatnonzero(~self.passed)]


class SerialExecutor(Executor):
    """Runs each task at once, in this process."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """The finished future of a call."""
        future: Future[T] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def run_study(
    controller: Controller,
    loop: Loop,
    spread: Spread,
    *,
    runs: int,
    name: str = "controller",
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Study:
    """`runs` closed-loop runs, each of a robot drawn from the spread.

    Args:
        executor: where chunks of runs are computed; this process when None. It must be able to pickle
            the controller.
        progress: called with the number of runs that are finished.

    Raises:
        InvalidInput: fewer than one run, a negative seed.
    """
    import time

    if runs < 1 or isinstance(runs, bool):
        raise InvalidInput(f"runs: needs at least 1, got {runs!r}")
    if seed < 0:
        raise InvalidInput(f"seed: a whole number of at least 0, got {seed!r}")
    started = time.perf_counter()
    place = SerialExecutor() if executor is None else executor
    chunks = [range(first, min(first + CHUNK, runs)) for first in range(0, runs, CHUNK)]
    waiting = [place.submit(run_chunk, controller, loop, spread, seed, chunk) for chunk in chunks]
    found: list[Run] = []
    for chunk, future in zip(chunks, waiting, strict=True):
        found.append(future.result())
        progress(chunk.stop)
    return Study(
        controller=name,
        spread=spread,
        seed=seed,
        passed=np.concatenate([run.passed for run in found]),
        why=tuple(reason for run in found for reason in run.why),
        tracking_error=np.concatenate([run.tracking_error for run in found]),
        end_error=np.concatenate([run.end_error for run in found]),
        peak_torque=np.concatenate([run.peak_torque for run in found]),
        payload=np.concatenate([run.payload for run in found]),
        seconds=time.perf_counter() - started,
    )


def run_chunk(controller: Controller, loop: Loop, spread: Spread, seed: int, chunk: range) -> Run:
    """The runs of one chunk."""
    robot = controller.reference.robot
    variations = [draw(robot, spread, (seed, number)) for number in chunk]
    return run_closed_loop(controller, loop, spread, variations)
