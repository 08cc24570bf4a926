"""Bounds on what a call may take that hold on a loaded machine, too."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

import pytest

T = TypeVar("T")
PATIENCE = 120.0  # [s] on a machine with much else to do


def wait_for(condition: Callable[[], T]) -> T:
    """What a condition gives once it gives something."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)
    return found


@contextmanager
def bounded(work: float, *, hang: float = 300.0) -> Iterator[None]:
    """Fail if the body takes more than `work` seconds of processor time in this thread.

    Waiting for a processor that others use is not counted. What waits for something that never comes does
    no work at all: it is ended after `hang` seconds of the clock.
    """

    def end(signum: int, frame: FrameType | None) -> None:
        pytest.fail(f"not done within {hang:g} s of the clock")

    before = signal.signal(signal.SIGALRM, end)
    start = time.thread_time()
    try:
        signal.setitimer(signal.ITIMER_REAL, hang)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    spent = time.thread_time() - start
    assert spent < work, f"took {spent:.3g} s of processor time; at most {work:g} s"
