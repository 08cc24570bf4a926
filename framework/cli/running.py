"""One command run: its report on stdout, or one sentence about what failed on stderr, and the exit code."""

from __future__ import annotations

import argparse
import json
import os
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from framework.cli.commands import Misuse
from framework.cli.console import complain, one_line, report, tell
from framework.cli.progress import Progress
from framework.errors import FrameworkError, NoAnswer
from framework.interruption import Heard

UNEXPECTED_EXIT_CODE = 70  # exit code; sysexits.h calls it EX_SOFTWARE
DEBUG_VARIABLE = "CROSSING_DEBUG"  # environment variable: set, an unexpected error shows its traceback


def run(options: argparse.Namespace, heard: Heard) -> int:
    """Run the parsed command and tell its report; returns the exit code 0, or 1 where its answer is no.

    Raises:
        FrameworkError: the command refuses.
    """
    options.warnings = []
    options.refusal = None
    with np.errstate(all="ignore"), Progress("at work") as options.progress:  # errors tell what is not finite
        document, text = options.run(options)
    if options.warnings:
        document = {**document, "warnings": options.warnings}
        text = "\n".join([text, *(f"  warning           {warning}" for warning in options.warnings)])
    heard.check()
    if options.refusal is not None:
        document = {**document, "error": error_document(options.refusal, str(options.refusal))}
    if options.json:
        tell(json.dumps(document, allow_nan=False))
    else:
        report(text)
    if options.refusal is None:
        return 0
    complain(one_line(str(options.refusal)))
    return 1


def failed(error: Exception, heard: Heard, arguments: Sequence[str]) -> int:
    """Say why a command ended without an answer; returns the exit code."""
    heard.check()  # an import that is interrupted may fail in other words
    if isinstance(error, FrameworkError | Misuse):
        return refused(error, one_line(str(error)), 1 if isinstance(error, NoAnswer) else 2, arguments)
    if os.environ.get(DEBUG_VARIABLE):
        raise error
    return refused(error, one_line(_unexpected(error)), UNEXPECTED_EXIT_CODE, arguments)


def refused(error: BaseException, message: str, code: int, arguments: Sequence[str]) -> int:
    """Say one sentence on stderr, with --json also as a document on stdout; returns the exit code."""
    complain(message)
    if "--json" in arguments:
        tell(json.dumps({"error": error_document(error, message)}, allow_nan=False))
    return code


def _unexpected(error: Exception) -> str:
    """Return the sentence for an error that is a fault of the program: the error, its place, the remedy."""
    package = Path(__file__).parents[1]
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename]
    ours = [frame for frame in frames if package in Path(frame.filename).parents]
    where = "".join(
        f" ({Path(frame.filename).relative_to(package.parent).as_posix()}, line {frame.lineno})"
        for frame in ours[-1:]
    )
    return (
        f"unexpected {type(error).__name__}: {str(error)[:300] or 'no message'}{where}. This is a fault of "
        f"the program: please report it with the command and the files that it reads "
        f"({DEBUG_VARIABLE}=1 shows the traceback)"
    )


def error_document(error: BaseException, message: str) -> dict[str, Any]:
    """Return an error for JSON: its kind, the sentence, and the numbers that it carries."""
    document: dict[str, Any] = {"kind": type(error).__name__.lstrip("_"), "message": message}
    for key in ("time", "s", "wrench", "joint", "residual", "platform"):
        value = getattr(error, key, None)
        if (isinstance(value, float) and np.isfinite(value)) or isinstance(value, str):
            document[key] = value
        elif isinstance(value, np.ndarray):
            document[key] = value.tolist()
    return document
