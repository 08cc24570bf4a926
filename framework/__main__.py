"""`python -m framework` is `crossing`, and this is where both begin: it hears signals before it imports."""

from __future__ import annotations

import gc
import os
import signal
import sys
from contextlib import suppress

from framework.numerics.interruption import SIGNALS, defer_signals, interruptible

ENDED_BY = {128 + number for number in SIGNALS}  # exit codes
# Objects between two searches for garbage, not Python's 700: imports and figures make many objects and hardly
# any cycle, and searching them all takes a twentieth of the time of `plan --out`.
GARBAGE_THRESHOLD = 20_000


def main() -> int:
    """Run the command that this process was started for; returns the exit code."""
    gc.set_threshold(GARBAGE_THRESHOLD)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: threads would wait in vain
    with interruptible():
        try:
            with defer_signals():  # compiled modules do not bear an exception while they are imported
                from framework.cli import main as command_line
                from framework.cli import report_interruption
        except KeyboardInterrupt as stop:
            code = report_interruption(stop, sys.argv[1:])
        else:
            code = command_line()
    for number in SIGNALS:  # what has been said stands: only the interpreter is left to end
        signal.signal(number, signal.SIG_IGN)
    if code in ENDED_BY:  # one that came up in an extension's code would end the interpreter in its own way
        gc.collect()  # a `with` that was interrupted as it was entered or left is cleaned up when it is freed
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
    return code


if __name__ == "__main__":
    raise SystemExit(main())
