"""Time limits of searches: each step checks the time; a search that is ended keeps its best result.

Ctrl-C also ends a search that has a result (`end_searches_by_ctrl_c`).
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import FrameType

from framework.errors import NoAnswer


class SearchEnded(NoAnswer):
    """A time limit or Ctrl-C ended a search before its first result."""


@dataclass
class SearchTime:
    """The time limit of a search."""

    seconds: float  # [s] from the start of the search
    end: float  # on the clock of `time.monotonic` [s]
    on_result: Callable[[str], object]  # called at each result, with the result in words
    has_result: bool = False  # whether the search may end early
    has_ended: bool = False  # whether the limit or Ctrl-C has ended the search


_UNLIMITED = SearchTime(math.inf, math.inf, on_result=lambda words: None)
_clock: ContextVar[SearchTime] = ContextVar("clock", default=_UNLIMITED)


@contextmanager
def limit_time(seconds: float | None) -> Iterator[SearchTime]:
    """Limit the searches of a block to `seconds` from its start; None lifts the limit."""
    limit = math.inf if seconds is None else seconds
    clock = SearchTime(limit, time.monotonic() + limit, _clock.get().on_result)
    token = _clock.set(clock)
    try:
        yield clock
    finally:
        _clock.reset(token)


def check_time() -> None:
    """Raise SearchEnded if the current search is out of time."""
    clock = _clock.get()
    if time.monotonic() > clock.end:
        clock.has_ended = True
        raise SearchEnded(f"the search was ended after {clock.seconds:g} s, and no law was found yet")


def seconds_ended() -> float | None:
    """Return the time [s] after which the current search was ended; None if it was not."""
    clock = _clock.get()
    return clock.seconds if clock.has_ended else None


def report_result(words: str) -> None:
    """Report the best result of the current search, in words; the search may end early from now on."""
    clock = _clock.get()
    clock.has_result = True
    clock.on_result(words)


@contextmanager
def end_searches_by_ctrl_c(on_result: Callable[[str], object]) -> Iterator[None]:
    """End the searches of a block at the first Ctrl-C after a result.

    The first Ctrl-C moves the time limit of the running search to now, so that its next `check_time` ends it
    with its result. It also reinstates the previous handler of the signal: the next one interrupts as usual.

    Args:
        on_result: called with each result of a search in words; after the first Ctrl-C ends the search.

    Raises:
        KeyboardInterrupt: Ctrl-C came before a result, or twice, or the result was not proved.
    """
    started = time.monotonic()
    previous = signal.getsignal(signal.SIGINT)
    if not callable(previous) or threading.current_thread() is not threading.main_thread():
        yield  # an ignored signal stays ignored, and only the main thread receives signals
        return

    def end_search(number: int, frame: FrameType | None) -> None:
        """End a search with a result by its time limit; else interrupt as usual."""
        signal.signal(number, previous)
        clock = _clock.get()  # of the innermost `limit_time`
        if clock.has_result:
            clock.end = time.monotonic()
            clock.seconds = round(clock.end - started, 2)
        else:
            previous(number, frame)

    token = _clock.set(SearchTime(math.inf, math.inf, on_result))
    signal.signal(signal.SIGINT, end_search)
    try:
        yield
    except SearchEnded:
        is_interrupted = signal.getsignal(signal.SIGINT) is not end_search
        if is_interrupted:  # else a time limit ended the search
            raise KeyboardInterrupt from None
        raise
    finally:
        _clock.reset(token)
        if signal.getsignal(signal.SIGINT) is end_search:  # after Ctrl-C another handler may ignore signals
            signal.signal(signal.SIGINT, previous)
