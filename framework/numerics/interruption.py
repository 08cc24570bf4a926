"""Orderly ends by Ctrl-C and SIGTERM: the program cleans up, reports the end in one line and exits.

Both signals raise a KeyboardInterrupt in the main thread, so that every `with` and `finally` block runs.
Further signals are ignored meanwhile, since programs are often signalled twice.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Handler = Callable[[int, FrameType | None], object]
SIGNAL_INTERVAL = 0.1  # [s] until a lost signal is repeated, and between two checks for signals in a wait


class Terminated(KeyboardInterrupt):
    """SIGTERM has arrived."""


def exit_code(stop: KeyboardInterrupt) -> int:
    """Return 128 plus the number of the signal, as shells do: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + _signal_of(stop)


def _signal_of(stop: KeyboardInterrupt) -> signal.Signals:
    """Return the signal that raised an interruption."""
    return signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT


@dataclass
class Heard:
    """Handler of signals that raises an interruption at the first one, and the record of that.

    Further signals are ignored. Other code may catch the exception and raise another one, or none, instead;
    the record shows that it was raised.
    """

    stop: KeyboardInterrupt | None = None  # Terminated after SIGTERM
    is_lost: bool = False  # Python has dropped the exception: the next signal raises it again

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Raise `Terminated` or KeyboardInterrupt for the first signal."""
        if self.stop is None or self.is_lost:
            warnings.simplefilter("ignore")  # an interrupted import may warn
            self.is_lost = False
            self.stop = Terminated() if number == signal.SIGTERM else KeyboardInterrupt()
            raise self.stop

    def check(self) -> None:
        """Raise the interruption once more, if one has arrived."""
        if self.stop is not None:
            raise self.stop from None


def check_interruption() -> None:
    """Raise the interruption that other code has caught, if one has arrived in an `interruptible` block."""
    for handler in map(signal.getsignal, SIGNALS):
        if isinstance(handler, Heard):
            handler.check()


@contextmanager
def interruptible() -> Iterator[Heard]:
    """Let the first SIGINT or SIGTERM in the block raise KeyboardInterrupt.

    Further signals are ignored, and so are signals that were ignored before the block. Outside the main
    thread the block has no effect on signals. The yielded record shows whether a signal has arrived.

    Python drops an exception that is raised in a weakref callback or in __del__. If the interruption is lost
    so, the signal is sent again until it interrupts other code.
    """
    heard = Heard()
    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    heeded = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]

    def raise_lost(unraisable: sys.UnraisableHookArgs) -> None:
        """Repeat an interruption that Python has dropped; report other dropped exceptions."""
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            sys.__unraisablehook__(unraisable)
            return
        number = _signal_of(unraisable.exc_value)
        heard.is_lost = True
        # `Thread.start` would wait, and could be interrupted
        _thread.start_new_thread(_send_again, (number, threading.get_ident(), has_ended))

    has_ended = threading.Event()  # the block
    with _handle_signals(heeded, heard), warnings.catch_warnings():
        hook, sys.unraisablehook = sys.unraisablehook, raise_lost
        try:
            yield heard
        finally:
            sys.unraisablehook = hook
            has_ended.set()


def _send_again(number: int, thread: int, has_ended: threading.Event) -> None:
    """Send a signal to a thread after SIGNAL_INTERVAL, unless the block has ended by then."""
    if not has_ended.wait(SIGNAL_INTERVAL):
        signal.pthread_kill(thread, number)


@contextmanager
def defer_signals() -> Iterator[None]:
    """Defer SIGINT and SIGTERM until the block ends; then raise the first one that has arrived."""
    if threading.current_thread() is not threading.main_thread():  # signals interrupt the main thread alone
        yield
        return
    arrived: list[int] = []
    try:
        with _handle_signals(SIGNALS, lambda number, frame: arrived.append(number)):
            yield
    finally:
        if arrived:
            signal.raise_signal(arrived[0])


@contextmanager
def _handle_signals(numbers: Iterable[int], handler: Handler) -> Iterator[None]:
    """Let a handler receive the signals with some numbers for the duration of the block."""
    handlers = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, previous_handler in handlers.items():
            signal.signal(number, previous_handler)
