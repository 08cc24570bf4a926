"""How long a search may take: its steps ask whether the time is up, and the best result so far is taken."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from framework.errors import NoAnswer

NONE_FOUND_YET = "and no law was found yet"


class SearchEnded(NoAnswer):
    """The time limit ended a search that had found nothing yet."""


@dataclass
class SearchTime:
    """The time limit of a search [s]."""

    seconds: float
    end: float  # by the clock of `time.monotonic` [s]
    has_ended: bool = False  # whether the search was ended


_UNLIMITED = SearchTime(math.inf, math.inf)
_clock: ContextVar[SearchTime] = ContextVar("clock", default=_UNLIMITED)


@contextmanager
def limit_time(seconds: float | None) -> Iterator[SearchTime]:
    """Limit the searches of a block to seconds from its start; None lifts the limit."""
    limit = math.inf if seconds is None else seconds
    clock = SearchTime(limit, time.monotonic() + limit)
    token = _clock.set(clock)
    try:
        yield clock
    finally:
        _clock.reset(token)


def check_time() -> None:
    """Raise SearchEnded if the time of the current search is up."""
    clock = _clock.get()
    if time.monotonic() > clock.end:
        clock.has_ended = True
        raise SearchEnded(f"the search was ended after {clock.seconds:g} s, {NONE_FOUND_YET}")
