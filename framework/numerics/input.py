"""Read files that users name, within limits.

Reading a pipe or a device may never end or never begin, and a large file may take all memory. Such files are
refused before they are read.
"""

from __future__ import annotations

import csv
import io
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from framework.errors import InvalidInput

LARGEST_FILE = 10_000_000  # bytes that are read by default


def read_text(
    file: str | Path, complaint: str, *, error: type[InvalidInput] = InvalidInput, largest: int = LARGEST_FILE
) -> str:
    """Read the text of a regular file of at most `largest` bytes, in UTF-8.

    Line ends of other systems become line feeds.

    Raises:
        InvalidInput: or another `error`. The message is `complaint` and the reason: the file is missing, is
            no regular file, is too large, cannot be read, or is not UTF-8 text.
    """
    try:
        _check_regular(os.stat(file))  # before it is opened: opening a device may have effects
        # without blocking, in case a pipe has replaced the file in the meantime
        with open(file, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as stream:
            _check_regular(os.fstat(stream.fileno()))
            content = stream.read(largest + 1)
            size = max(len(content), os.fstat(stream.fileno()).st_size)
        if size > largest:
            raise _UnreadableFile(f"{size} bytes; at most {largest} are read")
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        reason = "not UTF-8 text; save it as UTF-8"
    except ValueError:
        reason = "not a file name"
    except OSError as problem:
        reason = problem.strerror or str(problem)
    raise error(f"{complaint}: {reason}")


def csv_rows(where: str, text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number in which each row of a CSV text ends, and its cells; skip empty lines.

    Cells are separated by commas or, if the first line has none, by semicolons or tabs. These leave the comma
    to decimals, which become points.

    Raises:
        InvalidInput: the text is empty or no CSV, such as a quote that does not end; `where` names the file.
    """
    first = text.lstrip().partition("\n")[0]
    if not first:
        raise InvalidInput(f"{where}: is empty")
    separator = next((mark for mark in ",;\t" if mark in first), ",")
    reader = csv.reader(io.StringIO(text), delimiter=separator)
    line = 0
    try:
        for cells in reader:
            line = reader.line_num
            if cells:
                yield line, cells if separator == "," else [cell.replace(",", ".") for cell in cells]
    except csv.Error as error:
        raise InvalidInput(f"{where}: line {line + 1}: not a row of CSV: {error}") from None


class _UnreadableFile(OSError):
    """A file that exists but must not be read."""


def _check_regular(status: os.stat_result) -> None:
    """Refuse anything but a regular file."""
    if not stat.S_ISREG(status.st_mode):
        raise _UnreadableFile("not a regular file")
