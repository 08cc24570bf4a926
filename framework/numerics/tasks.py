"""Run tasks in parallel: in processes of this machine or on dask workers; results as they are finished.

Processes need about a second to import what they compute with. Meanwhile, and as long as tasks wait, this
process computes, too. So short work is done before the others begin, and no slower than without them.

`Workers` is an executor of processes of which any may be killed, and which end with their parent, however it
ends. `concurrent.futures.ProcessPoolExecutor` gives up all tasks when one of its processes is killed, and
leaves its processes running when the parent is killed. Here each thread of the parent sends its tasks to a
process through a pipe. A broken pipe shows which task was lost, and that task starts again. A worker process
whose parent has ended ends itself.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple, TypeVar

from framework.errors import InvalidInput, LostWorkers, whole_number
from framework.numerics import MAX_WORKERS
from framework.numerics.interruption import SIGNAL_INTERVAL

DASK_TIMEOUT = "10s"  # for a dask scheduler to answer
MAX_TRIES = 3  # number of processes that may be lost over one task
PICKLING_ERRORS = (pickle.PicklingError, AttributeError, TypeError)
K = TypeVar("K")
R = TypeVar("R")


def iterate_results(
    compute: Callable[[K], R], tasks: Mapping[str, K], executor: Executor | None
) -> Iterator[tuple[str, R]]:
    """Yield the name and the result of each task, in the order in which the results are finished.

    If the iteration ends early, waiting tasks are cancelled.

    Args:
        compute: must be picklable for an executor of processes.
        executor: None computes the results in this process, in the order of the tasks. Beside `Workers` this
            process takes the last of the tasks that have not begun.

    Raises:
        Exception: what `compute` raises.
    """
    if executor is None:
        for name, task in tasks.items():
            yield name, compute(task)
        return
    names = {executor.submit(compute, task): name for name, task in tasks.items()}
    waiting = list(names) if isinstance(executor, Workers) else []
    try:
        while names:
            future = waiting.pop() if waiting else None
            if future is not None and future.cancel():  # it has not begun
                name = names.pop(future)
                yield name, compute(tasks[name])
            # a signal may wake another thread, so this thread checks from time to time
            for done in wait(names, 0.0 if waiting else SIGNAL_INTERVAL, FIRST_COMPLETED).done:
                yield names.pop(done), done.result()
    finally:
        for future in names:
            future.cancel()


@contextmanager
def executor_of(
    *, workers: int = 1, dask: str | None = None, imports: Iterable[str] = ()
) -> Iterator[Executor | None]:
    """Yield an executor of processes or of a dask scheduler; None, for this process, with one worker.

    Args:
        workers: number of processes, this one included.
        dask: the scheduler's address; `workers` then has no effect.
        imports: names of modules that the processes import at once.

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
        with Workers(workers - 1) as processes:
            for _ in range(workers - 1):
                processes.submit(_import_all, tuple(imports))
            yield processes
            processes.stop()  # all results are there; some may still import


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


# ------------------------------------------------------------------ worker processes


class _Worker(NamedTuple):
    """A worker process with the parent's end of its pipe."""

    process: SpawnProcess
    pipe: Connection  # carries calls to the process, and answers back


class Workers(Executor):
    """An executor of `count` processes, 1 or more; tasks and results must be picklable.

    A thread of the parent takes a task and sends it to an idle process, or to a new one if none is idle. Then
    it waits for the answer. If an exception, Ctrl-C included, leaves the `with` block, processes are killed
    and waiting tasks are dropped.

    Raises:
        InvalidInput: an invalid number of processes.
    """

    def __init__(self, count: int) -> None:
        """Prepare a thread for each process; a process starts with its first task."""
        self._threads = ThreadPoolExecutor(whole_number("workers", count, 1, MAX_WORKERS))
        self._lock = threading.Lock()  # of the next three attributes
        self._alive: set[SpawnProcess] = set()  # all processes
        self._idle: list[_Worker] = []  # processes without a task
        self._stopped = False  # whether no process may start any more
        self._pickled: tuple[Callable[..., Any] | None, bytes] = (None, b"")  # the last function

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Submit a call; the future raises `LostWorkers` if MAX_TRIES processes are lost.

        It is pickled here, a function once: a thread could not while this one caches properties of `fn`.
        """
        if fn is not self._pickled[0]:
            self._pickled = fn, pickle.dumps(fn)
        return self._threads.submit(self._call_in_worker, self._pickled[1], pickle.dumps((args, kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more tasks; wait for accepted tasks, or drop tasks that have not begun; end processes."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        while self._idle:
            self._end_process(self._idle.pop())

    def stop(self) -> None:
        """Kill all processes and drop all tasks."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            self._stopped = True
            for process in self._alive:
                process.kill()
        self.shutdown()

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        """Wait for all tasks; stop the processes after an error of a `kind`, also one during the wait."""
        if kind is not None:
            self.stop()
            return
        try:
            self.shutdown()
        except BaseException:
            self.stop()
            raise

    def _call_in_worker(self, *call: bytes) -> Any:
        """Compute a pickled function of pickled (args, kwargs) in a worker process, or raise its error.

        Raises:
            LostWorkers: no process can be started, or MAX_TRIES processes were lost over the call.
        """
        message = pickle.dumps(call)
        for _ in range(MAX_TRIES):
            with self._lock:
                idle = self._idle.pop() if self._idle else None
            try:
                worker = idle or self._start_process()
            except OSError as error:
                raise LostWorkers(f"no worker process can be started: {error}") from None
            try:
                worker.pipe.send_bytes(message)
                answer = worker.pipe.recv_bytes()
            except (EOFError, OSError):  # the process was killed
                self._end_process(worker)
                continue
            self._idle.append(worker)
            has_succeeded, result = pickle.loads(answer)
            if has_succeeded:
                return result
            raise result
        raise LostWorkers(
            f"{MAX_TRIES} worker processes were killed one after the other over the same task, for want "
            f"of memory perhaps; take fewer --workers"
        )

    def _start_process(self) -> _Worker:
        """Start a process; raise LostWorkers after `stop`."""
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve_calls, args=(theirs,), daemon=True)
        with self._lock:
            if self._stopped:
                raise LostWorkers("the worker processes were stopped")
            resource_tracker.ensure_running()  # first, as its start unblocks SIGINT
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited: Ctrl-C is for the parent
            process.start()
            self._alive.add(process)
        theirs.close()  # otherwise the pipe would not break when the process ends
        return _Worker(process, ours)

    def _end_process(self, worker: _Worker) -> None:
        """End a process by closing its pipe, and wait for its end."""
        worker.pipe.close()
        worker.process.join()
        with self._lock:
            self._alive.discard(worker.process)


def _import_all(modules: Iterable[str]) -> None:
    """Import modules by their names."""
    for name in modules:
        import_module(name)


def _serve_calls(pipe: Connection) -> None:
    """Answer calls in a worker process until the pipe breaks."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            call = pipe.recv_bytes()
        except EOFError:
            return
        pipe.send_bytes(_answer_call(call))


def _answer_call(call: bytes) -> bytes:
    """Return the pickled answer to a pickled call: (True, result) or (False, error)."""
    try:
        fn, arguments = pickle.loads(call)
        args, kwargs = pickle.loads(arguments)
        return pickle.dumps((True, _load_function(fn)(*args, **kwargs)))
    except Exception as error:  # noqa: BLE001 - an executor returns all errors of tasks
        error.add_note(f"in a worker process:\n{traceback.format_exc()}")
        return pickle.dumps((False, _picklable_error(error)))


@lru_cache(maxsize=1)
def _load_function(pickled: bytes) -> Callable[..., Any]:
    """Unpickle a function, one object for many tasks, so that the caches of a robot serve all tasks."""
    return pickle.loads(pickled)


def _picklable_error(error: Exception) -> Exception:
    """Return an error, as a RuntimeError with the same message if pickling fails."""
    try:
        pickle.loads(pickle.dumps(error))
    except PICKLING_ERRORS:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _end_with_parent() -> None:
    """Wait for the end of the parent process, then end this one at once."""
    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
