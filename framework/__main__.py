"""`python -m framework` is `crossing`, and this is where both begin: it hears signals before it imports."""

from __future__ import annotations

import signal
import sys

from framework.interruption import SIGNALS, interruptible, uninterrupted


def main() -> int:
    """Run the command that this process was started for; returns the exit code."""
    with interruptible():
        try:
            with uninterrupted():  # compiled modules do not bear an exception while they are imported
                from framework.cli import interrupted
                from framework.cli import main as command_line
        except KeyboardInterrupt as stop:
            return interrupted(stop, sys.argv[1:])
        code = command_line()
    for number in SIGNALS:  # what has been said stands: only the interpreter is left to end
        signal.signal(number, signal.SIG_IGN)
    return code


if __name__ == "__main__":
    raise SystemExit(main())
