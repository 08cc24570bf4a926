"""The progress line: the work of a command, the share done and the time taken, on one line of the terminal.

It appears once a command takes longer than `FIRST` seconds and is removed when the command ends. A thread
writes it, also during work that counts nothing. Where stderr is no terminal, or one that cannot rewrite a
line, nothing is shown: logs and pipes have the answer alone.
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from framework.cli.console import printable
from framework.interruption import defer_signals

FIRST, INTERVAL = 1.0, 0.2  # s
ERASE = "\r\x1b[K"


class Progress:
    """The line of one command, shown while the block runs."""

    def __init__(self, doing: str) -> None:
        """Prepare the line; no thread runs before the block begins."""
        self.start(doing)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Progress:
        """Begin to show the line, if standard error is a terminal that can erase."""
        if sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
            self._thread = threading.Thread(target=self._show, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(self, doing: str, total: float = math.inf, unit: str = "") -> Callable[[float], None]:
        """Name the current work; return the function to call with the number done of `total`."""
        self._doing, self._total, self._unit = doing, total, unit
        self._done, self._since = 0.0, time.monotonic()
        return self._advance

    def end(self) -> None:
        """Remove the line, for good."""
        if self._thread is not None:
            with defer_signals():
                self._ended.set()
                self._thread.join()
            self._thread = None

    @property
    def sentence(self) -> str:
        """The current work, the share done and the time taken."""
        seconds = time.monotonic() - self._since
        if self._done and math.isfinite(self._total):
            left = seconds * (self._total / self._done - 1.0)
            whole = self._unit if self._total == 1.0 else f"{self._total:g} {self._unit}"
            how_far = f"{100 * self._done / self._total:.0f} % of {whole}"
            return f"{self._doing}: {how_far} in {seconds:.0f} s, about {left:.0f} s to go"
        counted = f"{self._done:g} {self._unit}, " if self._done else ""
        return f"{self._doing}: {counted}{seconds:.0f} s"

    def _advance(self, done: float) -> None:
        self._done = done

    def _show(self) -> None:
        """Rewrite the line at each change until the block ends; then erase the line."""
        printed, wait = "", FIRST
        with suppress(OSError, ValueError):  # the terminal has gone
            while not self._ended.wait(wait):
                line, wait = printable(self.sentence)[: shutil.get_terminal_size().columns - 1], INTERVAL
                if line != printed:
                    sys.stderr.write(f"{ERASE}{line}")
                    sys.stderr.flush()
                printed = line
            if printed:
                sys.stderr.write(ERASE)
                sys.stderr.flush()
