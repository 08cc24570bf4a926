"""Read a file that a person names, within limits.

A pipe, a device or a folder may never end or never begin, and a large file may take all memory: all are
refused before they are read.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from framework.errors import InvalidInput

LARGEST_FILE = 10_000_000  # bytes


def read_text(
    file: str | Path,
    complaint: str,
    *,
    error: type[InvalidInput] = InvalidInput,
    largest: int = LARGEST_FILE,
) -> str:
    """Read the text of a regular file of at most `largest` bytes, in UTF-8.

    Raises:
        InvalidInput: or the `error` given, with `complaint` and the reason: the file is missing, is no
            regular file, is too large, cannot be read, or is not UTF-8 text.
    """
    try:
        _check_regular(os.stat(file))  # to open a device can already do something
        with open(file, "rb", opener=_open_without_waiting) as stream:
            _check_regular(os.fstat(stream.fileno()))
            content = stream.read(largest + 1)
            size = max(len(content), os.fstat(stream.fileno()).st_size)
        if size > largest:
            raise _Unfit(f"{size} bytes; at most {largest} are read")
        return content.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        reason = "not UTF-8 text"
    except ValueError:
        reason = "not a file name"
    except OSError as problem:
        reason = problem.strerror or str(problem)
    raise error(f"{complaint}: {reason}")


class _Unfit(OSError):
    """A file that exists but must not be read."""


def _check_regular(status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise _Unfit("not a regular file")


def _open_without_waiting(file: str, flags: int) -> int:
    """Open a file without waiting, should a pipe have replaced the file meanwhile."""
    return os.open(file, flags | getattr(os, "O_NONBLOCK", 0))
