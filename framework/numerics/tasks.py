"""Tasks through any `concurrent.futures.Executor`, their results as they are finished."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

from framework.errors import InvalidInput
from framework.numerics.workers import Workers

SIGNAL_INTERVAL = 0.1  # [s] between two looks whether Ctrl-C was pressed
DASK_TIMEOUT = "10s"  # patience with a dask scheduler
K = TypeVar("K")
R = TypeVar("R")


def iterate_results(
    task: Callable[[K], R], chunks: Iterable[K], executor: Executor | None
) -> Iterator[tuple[K, R]]:
    """Yield chunks with results in the order of their end.

    Without an executor they are computed in this process. Waiting chunks are cancelled when the iteration
    ends early. An executor must be able to pickle the task.
    """
    if executor is None:
        for chunk in chunks:
            yield chunk, task(chunk)
        return
    waiting = {executor.submit(task, chunk): chunk for chunk in chunks}
    try:
        while waiting:
            # a signal may wake another thread: this one has to look for it
            for future in wait(waiting, SIGNAL_INTERVAL, FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
    finally:
        for future in waiting:
            future.cancel()


@contextmanager
def executor_of(*, workers: int = 1, dask: str | None = None) -> Iterator[Executor | None]:
    """Yield an executor of processes or of a dask scheduler.

    With one worker it is None, for this process.

    Args:
        dask: the scheduler's address, instead of `workers`.

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
    """Yield a client of the dask scheduler at an address, with a worker."""
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
