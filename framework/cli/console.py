"""Run a command: its report on stdout, complaints in one line on stderr, progress meanwhile, the exit code.

A complaint ends with the command line to try instead, where the error has a remedy. Texts may contain names
from untrusted files and command lines, with control characters, line breaks or thousands of letters.

A report is text. A label ends with two blanks or more; continuation lines are indented below the text behind
the label. Consecutive lines with tabs are a table, with its head first. In a terminal, lines are broken
between words, columns fit the width, and a few words have colours. Otherwise lines are not broken, so that
programs find each fact in one line.

The progress line states the work of a command, the share done and the time taken. It appears `FIRST` seconds
after the start and is erased when the command ends. A thread writes it, so that it also moves during work
that reports no progress. If stderr is no terminal, or one that cannot rewrite a line, nothing is shown: logs
and pipes get the answer alone.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import re
import shutil
import sys
import textwrap
import threading
import time
import traceback
from argparse import Namespace
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TextIO

import numpy as np

from framework.cli.commands import Misuse, advise
from framework.errors import FrameworkError, NoAnswer, OutputError
from framework.numerics.interruption import Heard, defer_signals
from framework.numerics.output import Document, plain

PROGRAM, TRY = "crossing: ", "try: "  # prefixes of a complaint, and of its advice
MAX_MESSAGE_LENGTH = 1000  # [characters]
GAP = "  "  # between columns
RED, GREEN, YELLOW, BOLD = "31;1", "32", "33", "1"
LABELS = {"warning": YELLOW, "note": YELLOW, "undecided": YELLOW, "failed": RED, "refused": RED}
# blanks at which no line is broken: between a name and its value, between a number and its unit
GLUED = re.compile(
    r" (?==)|(?<==) |(?<=\d) (?=(?:N|m|mm|s|ms|rad|kg|Hz|%|1/s2?|MB)\b|%)|(?<=\bN) (?=m\b)"
    r"|(?<=t_s) (?=\. W_p)|(?<=t_s \.) |(?<=\b[xyz],) (?=r?[xyz]\b)|(?<=\b[xyz]) (?=-?\d)"
    r"|(?<=\br[xyz]) (?=-?\d)| (?=\.\. )|(?<= \.\.) "
)
NUMBER = re.compile(r"[-+<>~]?\s?(\d|-?$)|-|inf|nan")
LABEL = re.compile(r" *\S.*? {2,}(?=\S)")
FIRST, INTERVAL = 1.0, 0.2  # [s] until the progress line appears, and between its changes
ERASE = "\r\x1b[K"
UNEXPECTED_EXIT_CODE = os.EX_SOFTWARE  # 70
DEBUG_VARIABLE = "CROSSING_DEBUG"  # if this is set, an unexpected error shows its traceback


def one_line(message: str, most: int = MAX_MESSAGE_LENGTH) -> str:
    """Return a message as one printable line of at most `most` letters.

    A longer message loses its middle.
    """
    line = printable(" ".join(message.splitlines()))
    if len(line) <= most:
        return line
    left_out = f" [... {len(line)} characters ...] "
    beginning = line[: max(most - 200, 0)]  # about 200 letters are left for the hint and the end
    return beginning + left_out + line[len(line) - most + len(beginning) + len(left_out) :]


def printable(text: str, allowed: str = "\n") -> str:
    """Escape control characters, except `allowed`, and lone surrogates of a text."""

    def write(letter: str) -> str:
        """Return a letter, or a blank or an escape in its place."""
        if letter.isprintable() or letter in allowed:
            return letter
        return " " if letter.isspace() else letter.encode("unicode_escape").decode("ascii")

    return "".join(map(write, text))


def report(text: str) -> None:
    """Print a report on stdout, laid out for the terminal; its reader may go before the end, as `head` does.

    Raises:
        As `tell`.
    """
    if sys.stdout is not None:
        visible = printable(text, "\n\t")
        laid_out = lay_out(visible, width_of(sys.stdout), colour=shows_colours(sys.stdout))
        _print_answer(laid_out, sys.stdout, may_be_cut=True)


def tell(text: str, *, aside: bool = False) -> None:
    """Print a text on stdout without layout, or `aside` on stderr.

    Raises:
        OutputError: the text cannot be written, because the disk is full for example. Later texts are lost.
    """
    _print_answer(printable(text), sys.stderr if aside else sys.stdout)


def _print_answer(text: str, stream: TextIO | None, *, may_be_cut: bool = False) -> None:
    """Print a text; close the stream if its reader has gone, silently if the text may be cut."""
    if stream is None:  # closed by the process that started the program
        return
    try:
        _print_text(text, stream)
    except OSError as error:
        # the interpreter can flush the null device on exit
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        if may_be_cut and isinstance(error, BrokenPipeError):
            return
        raise OutputError(f"cannot write the answer: {error.strerror or error}") from None


def complain(message: str, instead: str) -> None:
    """Print one line on stderr, with the command to try `instead` if not empty; a terminal gets two lines.

    If stderr cannot be written, the exit code alone reports the failure.
    """
    stream = sys.stderr
    if stream is None:  # closed by the process that started the program
        return
    width = width_of(stream)
    text = "\n".join(wrap_line(f"{PROGRAM}{printable(message)}", width, 2))
    label = TRY
    if shows_colours(stream):
        text = add_colour(PROGRAM, RED) + text[len(PROGRAM) :]
        label = add_colour(TRY, GREEN)
    if instead:
        text += f"{'; ' if width is None else chr(10) + '  '}{label}{printable(instead)}"
    with suppress(OSError):
        _print_text(text, stream)


def _print_text(text: str, stream: TextIO) -> None:
    """Print a text; escape letters that the stream's encoding lacks."""
    encoding = stream.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)


# ------------------------------------------------------------------ layout


def width_of(stream: TextIO) -> int | None:
    """Return the columns of a terminal; None for another stream."""
    return shutil.get_terminal_size().columns if stream.isatty() else None


def shows_colours(stream: TextIO) -> bool:
    """Return whether a stream shows colours, by the terminal, NO_COLOR and FORCE_COLOR."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR", "") not in ("", "0"):
        return True
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def add_colour(text: str, colour: str) -> str:
    """Wrap a text in the codes of a colour."""
    return f"\x1b[{colour}m{text}\x1b[0m" if text else text


def lay_out(text: str, width: int | None, *, colour: bool = False) -> str:
    """Lay a report out in `width` columns; None: lines of any length.

    Successive lines with tabs are the rows of a table. In other lines a label, such as "  warning", ends at
    two spaces or at a comma.
    """
    lines: list[str] = []
    for tabbed, rows in itertools.groupby(text.split("\n"), lambda line: "\t" in line):
        if tabbed:
            cells = [row.split("\t") for row in rows]
            head = cells[0][0]
            indent = len(head) - len(head.lstrip())
            columns = [
                [cell.strip() for cell in column] for column in itertools.zip_longest(*cells, fillvalue="")
            ]
            lines += _lay_out_table(columns, width, indent, colour)
            continue
        for row in rows:
            pieces = wrap_line(row, width)
            label = row.strip().partition("  ")[0].partition(",")[0]
            if colour and row.startswith("  ") and label in LABELS:
                pieces[0] = pieces[0].replace(label, add_colour(label, LABELS[label]), 1)
            lines += pieces
    return "\n".join(lines)


def wrap_line(line: str, width: int | None, indent: int | None = None) -> list[str]:
    """Break a line longer than `width` between words; keep numbers with their units.

    `indent` is that of all lines but the first, by default the column of the text behind the label.
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
    """Lay out a table by columns; wrap cells to fit the width.

    Columns that do not fit follow in a second table below, which repeats the first column.

    Args:
        columns: cells of each column, its heading first.
        width: letters of a line; None without a limit.
        indent: blanks in front of each line.
        colour: whether the head is bold.
    """
    room = math.inf if width is None else width - indent  # letters for columns and the gaps between them
    parts = [[GLUED.sub("\xa0", cell).split(" ") for cell in column] for column in columns]
    least = [max(max(map(len, cell)) for cell in column) for column in parts]  # no line break divides a part
    # where each column ends if all are as narrow as possible
    ends = itertools.accumulate(least, lambda end, most: end + len(GAP) + most)
    fitting = max(2, sum(end <= room for end in ends))
    if fitting < len(columns):
        first = _lay_out_table(columns[:fitting], width, indent, colour)
        return first + _lay_out_table([columns[0], *columns[fitting:]], width, indent, colour)
    widths = [max(map(len, column)) for column in columns]
    room -= len(GAP) * (len(widths) - 1)
    while sum(widths) > room and widths != least:  # narrow the widest of the columns that can be narrowed
        widths[max(range(len(widths)), key=lambda k: (widths[k] > least[k], widths[k]))] -= 1
    cells = []
    for column, width in zip(columns, widths, strict=True):
        align = str.rjust if all(map(NUMBER.match, column[1:])) else str.ljust
        cells.append([[align(line, width) for line in wrap_line(cell, width, 0)] for cell in column])
    joined = []  # the indented lines of each row
    for row in zip(*cells, strict=True):
        widths = [len(lines[0]) for lines in row]
        padded = (map(str.ljust, line, widths) for line in itertools.zip_longest(*row, fillvalue=""))
        joined.append([(" " * indent + GAP.join(line)).rstrip() for line in padded])
    head, *rows = joined
    if colour:
        head = [add_colour(line, BOLD) for line in head]
    return list(itertools.chain(head, *rows))


# ------------------------------------------------------------------ progress


class Progress:
    """The progress line of one command, shown while the block runs."""

    def __init__(self, doing: str) -> None:
        """Prepare the line; its thread starts with the block."""
        self.start(doing)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Progress:
        """Start to show the line, if stderr is a terminal that can erase."""
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
        with defer_signals():
            self._ended.set()
            if self._thread is not None:
                self._thread.join()

    @property
    def sentence(self) -> str:
        """Current work, share done, and time taken."""
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
        """Rewrite the line at each change until the block ends, then erase the line."""
        printed = ""
        wait = FIRST
        with suppress(OSError, ValueError):  # the terminal has gone
            while not self._ended.wait(wait):
                line = printable(self.sentence)[: shutil.get_terminal_size().columns - 1]
                if line != printed:
                    print(f"{ERASE}{line}", end="", file=sys.stderr, flush=True)
                printed = line
                wait = INTERVAL
            if printed:
                print(ERASE, end="", file=sys.stderr, flush=True)


# ------------------------------------------------------------------ one command


def run(options: Namespace, heard: Heard, arguments: Sequence[str]) -> int:
    """Run the parsed command, print its report and return the exit code.

    Args:
        options: the parsed options, to which the command adds warnings and a refusal.
        heard: the interruption that has arrived, if any; `check` raises it, also if other code has caught it.
        arguments: the words of the command line.

    Raises:
        FrameworkError: the command ends without a report.
    """
    options.warnings = []
    options.refusal = options.written = None
    # commands report values that are not finite
    with np.errstate(all="ignore"), Progress("at work") as options.progress:
        document, lines = options.run(options)
    if options.written is not None:
        lines.append(f"  written to        {options.written}")
    if options.warnings:
        document = {**document, "warnings": options.warnings}
        lines += (f"  warning           {warning}" for warning in options.warnings)
    heard.check()
    if options.refusal is not None:
        message, entry = describe_error(options.refusal, str(options.refusal), arguments)
        document = {**document, "error": entry}
    if options.json:
        tell(json.dumps(plain(document), allow_nan=False))
    else:
        report("\n".join(lines))
    if options.refusal is None:
        return 0
    complain(message, entry.get("try", ""))
    return exit_code_of(options.refusal)


def report_failure(error: Exception, heard: Heard, arguments: Sequence[str]) -> int:
    """Report why a command ended without an answer and return the exit code."""
    heard.check()  # an interrupted import may raise another error
    if isinstance(error, FrameworkError | Misuse):
        return report_refusal(error, str(error), exit_code_of(error), arguments)
    if os.environ.get(DEBUG_VARIABLE):
        raise error
    return report_refusal(error, _describe_fault(error), UNEXPECTED_EXIT_CODE, arguments)


def exit_code_of(error: Exception) -> int:
    """Return 1 for a question without an answer, 2 for misuse or wrong input."""
    return 1 if isinstance(error, NoAnswer) else 2


def report_refusal(error: BaseException, message: str, code: int, arguments: Sequence[str]) -> int:
    """Print the refusal on stderr, with --json also on stdout; return the exit code."""
    message, entry = describe_error(error, message, arguments)
    complain(message, entry.get("try", ""))
    if "--json" in arguments:
        with suppress(OutputError):  # the line on stderr and the code say it
            tell(json.dumps({"error": entry}, allow_nan=False))
    return code


def _describe_fault(error: Exception) -> str:
    """Return the sentence for a fault: the error, its place in this package, the remedy."""
    package = Path(__file__).parents[1]
    where = ""
    for frame in traceback.extract_tb(error.__traceback__):  # the innermost frame comes last
        file = Path(frame.filename)
        if package in file.parents:
            where = f" ({file.relative_to(package.parent).as_posix()}, line {frame.lineno})"
    return (
        f"unexpected {type(error).__name__}: {str(error)[:300] or 'no message'}{where}. This is a fault of "
        f"the program: please report it with the command and the files that it reads "
        f"({DEBUG_VARIABLE}=1 shows the traceback)"
    )


def describe_error(error: BaseException, message: str, arguments: Sequence[str]) -> tuple[str, Document]:
    """Return the message of an error in one line, and its entry for JSON: with advice and numbers."""
    instead = one_line(advise(error, arguments) or "")
    if len(instead) > MAX_MESSAGE_LENGTH // 2:  # too long to be of use
        instead = ""
    advice = f"; {TRY}{instead}" if instead else ""
    message = one_line(message, most=MAX_MESSAGE_LENGTH - len(advice))
    document: Document = {"kind": type(error).__name__.lstrip("_"), "message": message + advice}
    if instead:
        document["try"] = instead
    for key in ("time", "s", "wrench", "joint", "residual", "platform", "nearest"):
        value = plain(getattr(error, key, None))
        if isinstance(value, float | str | list | dict):
            document[key] = value
    return message, document
