"""Run tasks on any `concurrent.futures.Executor`, and yield their results as they are finished."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

from framework.errors import InvalidInput
from framework.numerics.workers import Workers

SIGNAL_INTERVAL = 0.1  # [s] between two checks for Ctrl-C
DASK_TIMEOUT = "10s"  # for a dask scheduler to answer
K = TypeVar("K")
R = TypeVar("R")


def iterate_results(
    task: Callable[[K], R], chunks: Iterable[K], executor: Executor | None
) -> Iterator[tuple[K, R]]:
    """Yield each chunk with its result, in the order in which the results are finished.

    Without an executor the results are computed in this process. An executor must be able to pickle the task.
    If the iteration ends early, waiting chunks are cancelled.
    """
    if executor is None:
        for chunk in chunks:
            yield chunk, task(chunk)
        return
    waiting = {executor.submit(task, chunk): chunk for chunk in chunks}
    try:
        while waiting:
            # a signal may wake another thread, so this thread checks from time to time
            for future in wait(waiting, SIGNAL_INTERVAL, FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
    finally:
        for future in waiting:
            future.cancel()


@contextmanager
def executor_of(*, workers: int = 1, dask: str | None = None) -> Iterator[Executor | None]:
    """Yield an executor of processes or of a dask scheduler; None, for this process, with one worker.

    Args:
        dask: the scheduler's address; `workers` then has no effect.

    Raises:
        InvalidInput: dask.distributed is not installed, no scheduler answers at the address, or no worker is
            connected to it within DASK_TIMEOUT.
    """
    if dask is not None:
        with _dask_client(dask) as client:
            yield client.get_executor()
    elif workers == 1:
        yield None
    else:
        with Workers(workers) as processes:
            yield processes


@contextmanager
def _dask_client(address: str) -> Iterator[Any]:
    """Yield a client of the dask scheduler at an address, with at least one worker."""
    try:
        from distributed import Client
    except ImportError:
        raise InvalidInput("--dask: needs dask.distributed: pip install distributed") from None
    try:
        connected = Client(address, timeout=DASK_TIMEOUT)
    except (OSError, ValueError) as error:
        raise InvalidInput(f"--dask: no scheduler answers at {address}: {error}") from None
    with connected as client:
        try:
            client.wait_for_workers(1, timeout=DASK_TIMEOUT)
        except TimeoutError:
            raise InvalidInput(
                f"--dask: the scheduler at {address} has no workers, {DASK_TIMEOUT} long; start some: dask "
                f"worker {address}"
            ) from None
        yield client
