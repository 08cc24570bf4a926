"""The output of commands: reports on stdout, complaints in one line on stderr, progress in between.

Names and numbers come from files and command lines of strangers, with control characters, line breaks or
thousands of letters.

A report is text. Two blanks or more end a label; a long line goes on below the text of its label. Lines with
tabs that follow one another are a table, the first one its head. In a terminal, lines are broken between
words and columns fit its width, with a little colour. Without a terminal lines are not broken, so that
programs find each fact in one line.

The progress line has the work of a command, the share done and the time taken. It appears once a command
takes longer than `FIRST` seconds and is removed when the command ends. A thread writes it, also during work
that counts nothing. Where stderr is no terminal, or one that cannot rewrite a line, nothing is shown: logs
and pipes have the answer alone.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TextIO

from framework.errors import OutputError
from framework.numerics.interruption import defer_signals

PROGRAM, TRY = "crossing: ", "try: "  # what a complaint begins with, and what advice does
MAX_MESSAGE_LENGTH = 1000  # [characters]
GAP = "  "  # between columns
RED, GREEN, YELLOW, BOLD = "31;1", "32", "33", "1"
LABELS = {"warning": YELLOW, "note": YELLOW, "undecided": YELLOW, "failed": RED, "refused": RED}
# blanks within what is read as one: a name and its value, a number and its unit
GLUED = re.compile(
    r" (?==)|(?<==) |(?<=\d) (?=(?:N|m|mm|s|ms|rad|kg|Hz|%|1/s2?|MB)\b|%)|(?<=\bN) (?=m\b)"
    r"|(?<=t_s) (?=\. W_p)|(?<=t_s \.) |(?<=\b[xyz],) (?=r?[xyz]\b)|(?<=\b[xyz]) (?=-?\d)"
    r"|(?<=\br[xyz]) (?=-?\d)| (?=\.\. )|(?<= \.\.) "
)
NUMBER = re.compile(r"[-+<>~]?\s?(\d|-?$)|-|inf|nan")
LABEL = re.compile(r" *\S.*? {2,}(?=\S)")
FIRST, INTERVAL = 1.0, 0.2  # s
ERASE = "\r\x1b[K"


def one_line(message: str, most: int = MAX_MESSAGE_LENGTH) -> str:
    """Return a message as one printable line of at most `most` letters.

    Its middle is left out.
    """
    line = printable(" ".join(message.splitlines()))
    if len(line) <= most:
        return line
    left_out = f" [... {len(line)} characters ...] "
    beginning = line[: max(most - 200, 0)]
    return beginning + left_out + line[len(line) - most + len(beginning) + len(left_out) :]


def printable(text: str, allowed: str = "\n") -> str:
    """Return a text with control characters, except `allowed`, and lone surrogates as escapes."""

    def write(letter: str) -> str:
        """Return a letter; a blank or an escape for a control character."""
        if letter.isprintable() or letter in allowed:
            return letter
        return " " if letter.isspace() else letter.encode("unicode_escape").decode("ascii")

    return "".join(map(write, text))


def report(text: str) -> None:
    """Print a report on stdout in the layout of its terminal.

    Raises as `tell`.
    """
    if sys.stdout is not None:
        visible = printable(text, "\n\t")
        _print_answer(lay_out(visible, width_of(sys.stdout), colour=shows_colours(sys.stdout)), sys.stdout)


def tell(text: str, *, aside: bool = False) -> None:
    """Print a text unchanged on stdout, or `aside` on stderr.

    Raises:
        OutputError: the text cannot be written, for a full disk say; later texts get lost.
    """
    _print_answer(printable(text), sys.stderr if aside else sys.stdout)


def _print_answer(text: str, stream: TextIO | None) -> None:
    """Print a text; close a stream whose reader has gone."""
    if stream is None:  # closed by whoever started the program
        return
    try:
        _print_text(text, stream)
    except BrokenPipeError:  # whoever reads has seen enough, as `head` does
        _close_stream(stream)
    except OSError as error:
        _close_stream(stream)
        raise OutputError(f"cannot write the answer: {error.strerror or error}") from None


def complain(message: str) -> None:
    """Print one line on stderr, wrapped and broken before `TRY`.

    It is wrapped to the width of a terminal. If that fails, the exit code alone tells.
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
        _print_text(line, stream)


def _print_text(text: str, stream: TextIO) -> None:
    encoding = stream.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)


def _close_stream(stream: TextIO) -> None:
    """Redirect a stream to the null device, which the interpreter can flush on exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


# ------------------------------------------------------------------ layout


def width_of(stream: TextIO) -> int | None:
    """Return the columns of a terminal, None where the stream is none."""
    return shutil.get_terminal_size().columns if stream.isatty() else None


def shows_colours(stream: TextIO) -> bool:
    """Whether a stream shows colours: a terminal does unless NO_COLOR; FORCE_COLOR: any stream does."""
    if os.environ.get("NO_COLOR"):
        return False
    able = stream.isatty() and os.environ.get("TERM") != "dumb"
    return able or os.environ.get("FORCE_COLOR", "") not in ("", "0")


def add_colour(text: str, colour: str) -> str:
    """Add the codes by which a terminal shows a text in a colour."""
    return f"\x1b[{colour}m{text}\x1b[0m" if text else text


def lay_out(text: str, width: int | None, *, colour: bool = False) -> str:
    """Lay a report out in `width` columns; in lines of any length if None."""
    lines: list[str] = []
    for tabbed, rows in itertools.groupby(text.split("\n"), lambda line: "\t" in line):
        if tabbed:
            cells = [row.split("\t") for row in rows]
            columns = list(itertools.zip_longest(*cells, fillvalue=""))
            indent = len(columns[0][0]) - len(columns[0][0].lstrip())
            stripped = [[cell.strip() for cell in column] for column in columns]
            lines += _lay_out_table(stripped, width, indent, colour)
            continue
        for row in rows:
            pieces = wrap_line(row, width)
            label = row.strip().partition("  ")[0].partition(",")[0]
            if colour and row.startswith("  ") and label in LABELS:
                pieces[0] = pieces[0].replace(label, add_colour(label, LABELS[label]), 1)
            lines += pieces
    return "\n".join(lines)


def wrap_line(line: str, width: int | None, indent: int | None = None) -> list[str]:
    """Break a line longer than `width` between words.

    A number and its unit stay together. `indent`: of all lines but the first; by default that of the text
    behind a label.
    """
    if width is None or len(line) <= width:
        return [line]
    if indent is None:
        label = LABEL.match(line)
        indent = label.end() if label and label.end() <= width // 2 else len(line) - len(line.lstrip()) + 2
    pieces = textwrap.wrap(
        GLUED.sub("\xa0", line),
        width,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    )
    return [piece.replace("\xa0", " ") for piece in pieces]


def _lay_out_table(
    columns: Sequence[Sequence[str]], width: int | None, indent: int, colour: bool
) -> list[str]:
    """Lay out a table by columns, its cells wrapped to fit the width.

    Columns beyond the width stand in a second table below, behind the first column once more.
    """
    room = math.inf if width is None else width - indent
    least = [max(len(word) for cell in column for word in _split_words(cell)) for column in columns]
    ends = itertools.accumulate(least, lambda end, most: end + len(GAP) + most)
    fitting = max(2, sum(end <= room for end in ends))
    if fitting < len(columns):
        rest = [columns[0], *columns[fitting:]]
        return _lay_out_table(columns[:fitting], width, indent, colour) + _lay_out_table(
            rest, width, indent, colour
        )
    widths = [max(map(len, column)) for column in columns]
    while sum(widths) + len(GAP) * (len(widths) - 1) > room and widths != least:
        widths[max(range(len(widths)), key=lambda k: (widths[k] > least[k], widths[k]))] -= 1
    cells = map(_wrap_column, columns, widths)
    head, *rows = (_join_cells(row, indent) for row in zip(*cells, strict=True))
    return [
        *([add_colour(line, BOLD) for line in head] if colour else head),
        *itertools.chain.from_iterable(rows),
    ]


def _join_cells(cells: Sequence[list[str]], indent: int) -> list[str]:
    """Join cells, each of lines of one width, into indented lines side by side."""
    height = max(map(len, cells))
    padded = [lines + [" " * len(lines[0])] * (height - len(lines)) for lines in cells]
    return [(" " * indent + GAP.join(parts)).rstrip() for parts in zip(*padded, strict=True)]


def _wrap_column(column: Sequence[str], width: int) -> list[list[str]]:
    """Wrap the cells of a column into lines of one width.

    Numbers stand to the right.
    """
    right = all(NUMBER.match(cell) for cell in column[1:])
    return [
        [line.rjust(width) if right else line.ljust(width) for line in wrap_line(cell, width, 0)]
        for cell in column
    ]


def _split_words(cell: str) -> list[str]:
    """Return the unbreakable parts of a cell: words, and numbers with their units."""
    return GLUED.sub("\xa0", cell).split(" ")


# ------------------------------------------------------------------ progress


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
        """Name the current work; return the function for its progress.

        That is called with the number done of `total`.
        """
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
