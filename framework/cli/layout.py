"""Reports in the width of a terminal: lines broken between words, tables whose columns fit, a little colour.

A report is text. Two blanks or more end a label; a long line goes on below the text of its label. Lines with
tabs that follow one another are a table, the first one its head. Without a terminal lines are not broken, so
that programs find each fact in one line.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import shutil
import textwrap
from collections.abc import Sequence
from typing import TextIO

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
            lines += _table(stripped, width, indent, colour)
            continue
        for row in rows:
            pieces = wrap_line(row, width)
            label = row.strip().partition("  ")[0].partition(",")[0]
            if colour and row.startswith("  ") and label in LABELS:
                pieces[0] = pieces[0].replace(label, add_colour(label, LABELS[label]), 1)
            lines += pieces
    return "\n".join(lines)


def wrap_line(line: str, width: int | None, indent: int | None = None) -> list[str]:
    """Break a line longer than `width` between words, never within a number and its unit.

    `indent`: of all lines but the first; by default that of the text behind a label.
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


def _table(columns: Sequence[Sequence[str]], width: int | None, indent: int, colour: bool) -> list[str]:
    """Lay out a table by columns, its cells wrapped to fit the width.

    Columns beyond the width stand in a second table below, behind the first column once more.
    """
    room = math.inf if width is None else width - indent
    least = [max(len(word) for cell in column for word in _words(cell)) for column in columns]
    ends = itertools.accumulate(least, lambda end, most: end + len(GAP) + most)
    fitting = max(2, sum(end <= room for end in ends))
    if fitting < len(columns):
        rest = [columns[0], *columns[fitting:]]
        return _table(columns[:fitting], width, indent, colour) + _table(rest, width, indent, colour)
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
    """Wrap the cells of a column into lines of one width, numbers to the right."""
    right = all(NUMBER.match(cell) for cell in column[1:])
    return [
        [line.rjust(width) if right else line.ljust(width) for line in wrap_line(cell, width, 0)]
        for cell in column
    ]


def _words(cell: str) -> list[str]:
    """Return the unbreakable parts of a cell: words, and numbers with their units."""
    return GLUED.sub("\xa0", cell).split(" ")
