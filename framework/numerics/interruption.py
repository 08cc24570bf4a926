"""Ctrl-C and SIGTERM end a program alike: it cleans up, reports the end in one line and exits.

Both reach the main thread as a KeyboardInterrupt, so that every `with` and `finally` is left in order.
Further signals are dropped meanwhile: a program is often signalled twice.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)
REPEAT_INTERVAL = 0.01  # s, long for a callback to end and short for who waits


class Terminated(KeyboardInterrupt):
    """SIGTERM has arrived."""


def exit_code(stop: KeyboardInterrupt) -> int:
    """Return 128 plus the number of the signal, as shells do: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)


class Heard:
    """The interruption that has arrived, if any; code in between may turn the exception into another."""

    def __init__(self) -> None:
        self.stop: KeyboardInterrupt | None = None

    def check(self) -> None:
        """Raise the interruption once more, if one has arrived."""
        if self.stop is not None:
            raise self.stop from None


@contextmanager
def interruptible() -> Iterator[Heard]:
    """Let the first SIGINT or SIGTERM in the block raise KeyboardInterrupt.

    It is raised in the main thread; further signals are dropped. Signals that the caller ignores stay
    ignored. In other threads than the main one nothing changes.
    """
    heard = Heard()
    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    handlers = {number: handler for number, handler in handlers.items() if handler is not signal.SIG_IGN}

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        """Ignore further signals and raise the error of this one: `Terminated` or KeyboardInterrupt."""
        for handled in handlers:
            signal.signal(handled, signal.SIG_IGN)
        warnings.simplefilter("ignore")  # an import that is broken off halfway may warn
        heard.stop = Terminated() if number == signal.SIGTERM else KeyboardInterrupt()
        raise heard.stop

    def raise_lost(unraisable: sys.UnraisableHookArgs) -> None:
        """Raise an interruption once more that ended in a callback.

        Callbacks of weakref and __del__ lose their errors.
        """
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            sys.__unraisablehook__(unraisable)
            return
        number = signal.SIGTERM if isinstance(unraisable.exc_value, Terminated) else signal.SIGINT
        signal.signal(number, stop)
        _thread.start_new_thread(repeat, (number,))  # `Thread.start` would wait, and be interrupted itself

    def repeat(number: int) -> None:
        """Signal the main thread once more, unless the block has ended."""
        if not ended.wait(REPEAT_INTERVAL):
            signal.pthread_kill(main_thread, number)

    main_thread = threading.get_ident()
    ended = threading.Event()
    for number in handlers:
        signal.signal(number, stop)
    hook, sys.unraisablehook = sys.unraisablehook, raise_lost
    try:
        with warnings.catch_warnings():
            yield heard
    finally:
        sys.unraisablehook = hook
        ended.set()
        for number, handler in handlers.items():
            signal.signal(number, handler)


@contextmanager
def defer_signals() -> Iterator[None]:
    """Defer SIGINT and SIGTERM until the block ends."""
    if threading.current_thread() is not threading.main_thread():  # no other one is interrupted
        yield
        return
    arrived: list[int] = []
    handlers = {number: signal.signal(number, lambda one, frame: arrived.append(one)) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for one in arrived[:1]:
            signal.raise_signal(one)
