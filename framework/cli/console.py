"""The one place where a command speaks: its report on stdout, its complaint in one line on stderr.

Names and numbers in it come from files and command lines of strangers: they may hold control characters,
line breaks or thousands of letters.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO

from framework.cli.layout import GREEN, RED, coloured, laid_out, shows_colours, width_of, wrapped
from framework.errors import OutputError

PROGRAM, TRY = "crossing: ", "try: "  # what a complaint begins with, and what advice does
MAX_MESSAGE_LENGTH = 1000  # [characters]
_END_LENGTH = 200  # [characters] of a longer message, the gap included


def one_line(message: str, most: int = MAX_MESSAGE_LENGTH) -> str:
    """Return a message as one line of printable letters, at `most` so many, its middle left out."""
    line = printable(" ".join(message.splitlines()))
    if len(line) <= most:
        return line
    left_out = f" [... {len(line)} characters ...] "
    beginning = line[: max(most - _END_LENGTH, 0)]
    return beginning + left_out + line[len(line) - most + len(beginning) + len(left_out) :]


def printable(text: str) -> str:
    """Return a text with its control characters (but line feeds) and lone surrogates written as escapes."""
    return _printable(text, "\n")


def _printable(text: str, kept: str) -> str:
    return "".join(
        letter if letter.isprintable() or letter in kept else " " if letter.isspace() else _escaped(letter)
        for letter in text
    )


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")


def report(text: str) -> None:
    """Print a report on stdout, in the width and the colours of its terminal; raises as `tell`."""
    if sys.stdout is not None:
        shown = _printable(text, "\n\t")
        _tell(laid_out(shown, width_of(sys.stdout), colour=shows_colours(sys.stdout)), sys.stdout)


def tell(text: str, *, aside: bool = False) -> None:
    """Print a text as it is on stdout, or on stderr if it is said `aside`.

    Raises:
        OutputError: it cannot be written, the disk being full; what is told after that gets lost.
    """
    _tell(printable(text), sys.stderr if aside else sys.stdout)


def _tell(text: str, stream: TextIO | None) -> None:
    if stream is None:  # closed by whoever started the program
        return
    try:
        _print(text, stream)
    except BrokenPipeError:  # whoever reads has seen enough, as `head` does
        _close(stream)
    except OSError as error:
        _close(stream)
        raise OutputError(f"cannot write the answer: {error.strerror or error}") from None


def complain(message: str) -> None:
    """Print one line on stderr, broken where a terminal needs it, and before `TRY`.

    If it cannot be written, the exit code has to say it.
    """
    stream = sys.stderr
    if stream is None:  # closed by whoever started the program
        return
    line = f"{PROGRAM}{printable(message)}"
    width, colour = width_of(stream), shows_colours(stream)
    if width is not None:
        why, advised, command = line.partition(f"; {TRY}")
        line = "\n".join([*wrapped(why, width, 2), *([f"  {TRY}{command}"] if advised else [])])
    if colour:
        line = line.replace(PROGRAM, coloured(PROGRAM, RED), 1).replace(TRY, coloured(TRY, GREEN))
    with suppress(OSError):
        _print(line, stream)


def _print(text: str, stream: TextIO) -> None:
    encoding = stream.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)


def _close(stream: TextIO) -> None:
    """Lead a stream into nothing, so that the interpreter does not stumble over it when it ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
