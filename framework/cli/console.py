"""The output of commands: reports on stdout, complaints in one line on stderr.

Names and numbers come from files and command lines of strangers, with control characters, line breaks or
thousands of letters.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO

from framework.cli.layout import GREEN, RED, add_colour, lay_out, shows_colours, width_of, wrap_line
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


def printable(text: str, allowed: str = "\n") -> str:
    """Return a text with control characters, except `allowed`, and lone surrogates as escapes."""

    def write(letter: str) -> str:
        """Return a letter, or a blank or an escape for one that a terminal would obey."""
        if letter.isprintable() or letter in allowed:
            return letter
        return " " if letter.isspace() else letter.encode("unicode_escape").decode("ascii")

    return "".join(map(write, text))


def report(text: str) -> None:
    """Print a report on stdout, in the width and the colours of its terminal; raises as `tell`."""
    if sys.stdout is not None:
        visible = printable(text, "\n\t")
        _tell(lay_out(visible, width_of(sys.stdout), colour=shows_colours(sys.stdout)), sys.stdout)


def tell(text: str, *, aside: bool = False) -> None:
    """Print a text unchanged on stdout, or `aside` on stderr.

    Raises:
        OutputError: the text cannot be written, for a full disk say; later texts get lost.
    """
    _tell(printable(text), sys.stderr if aside else sys.stdout)


def _tell(text: str, stream: TextIO | None) -> None:
    """Print a text; close a stream whose reader has gone."""
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
    """Print one line on stderr, wrapped to the width of a terminal and broken before `TRY`.

    If that fails, the exit code alone tells.
    """
    stream = sys.stderr
    if stream is None:  # closed by whoever started the program
        return
    line = f"{PROGRAM}{printable(message)}"
    width, colour = width_of(stream), shows_colours(stream)
    if width is not None:
        why, advised, command = line.partition(f"; {TRY}")
        line = "\n".join([*wrap_line(why, width, 2), *([f"  {TRY}{command}"] if advised else [])])
    if colour:
        line = line.replace(PROGRAM, add_colour(PROGRAM, RED), 1).replace(TRY, add_colour(TRY, GREEN))
    with suppress(OSError):
        _print(line, stream)


def _print(text: str, stream: TextIO) -> None:
    encoding = stream.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)


def _close(stream: TextIO) -> None:
    """Redirect a stream to the null device, which the interpreter can flush on exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
