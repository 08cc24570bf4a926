"""The one place where a command speaks: its report on stdout, its complaint in one line on stderr.

Names and numbers in it come from files and command lines of strangers: they may hold control characters,
line breaks or thousands of letters.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO

from framework.errors import OutputError

MAX_MESSAGE_LENGTH = 1000  # [characters]
_BEGINNING_LENGTH = 800  # [characters] of a longer message that are shown before the gap


def one_line(message: str) -> str:
    """Return a message as one line of printable letters, its middle left out where it is long."""
    line = printable(" ".join(message.splitlines()))
    if len(line) <= MAX_MESSAGE_LENGTH:
        return line
    left_out = f" [... {len(line)} characters ...] "
    end_length = MAX_MESSAGE_LENGTH - _BEGINNING_LENGTH - len(left_out)
    return line[:_BEGINNING_LENGTH] + left_out + line[-end_length:]


def printable(text: str) -> str:
    """Return a text with its control characters (but line feeds) and lone surrogates written as escapes."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else " " if letter.isspace() else _escaped(letter)
        for letter in text
    )


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")


def tell(text: str, *, aside: bool = False) -> None:
    """Print a report on stdout, or on stderr if it is said `aside`.

    Raises:
        OutputError: it cannot be written, the disk being full; what is told after that gets lost.
    """
    stream = sys.stderr if aside else sys.stdout
    try:
        _print(text, stream)
    except BrokenPipeError:  # whoever reads has seen enough, as `head` does
        _close(stream)
    except OSError as error:
        _close(stream)
        raise OutputError(f"cannot write the answer: {error.strerror or error}") from None


def complain(message: str) -> None:
    """Print one line on stderr; if that cannot be written, the exit code has to say it."""
    with suppress(OSError):
        _print(f"crossing: {message}", sys.stderr)


def _print(text: str, stream: TextIO | None) -> None:
    if stream is None:  # closed by whoever started the program
        return
    encoding = stream.encoding or "utf-8"
    print(printable(text).encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)


def _close(stream: TextIO) -> None:
    """Lead a stream into nothing, so that the interpreter does not stumble over it when it ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
