"""Run one command: its report on stdout, or one sentence on its failure on stderr, and the exit code.

The sentence ends with the command line to try instead. The remedy in the error determines it, and never the
message.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import traceback
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from framework.cli.commands import COMMANDS, Misuse, parser_of
from framework.cli.console import MAX_MESSAGE_LENGTH, TRY, Progress, complain, one_line, report, tell
from framework.errors import FrameworkError, NoAnswer
from framework.numerics.interruption import Heard
from framework.numerics.output import Document, plain

UNEXPECTED_EXIT_CODE = 70  # EX_SOFTWARE of sysexits.h
DEBUG_VARIABLE = "CROSSING_DEBUG"  # if this is set, an unexpected error shows its traceback
VALUE_COUNTS = {None: 1.0, "?": 1.0, "+": math.inf, "*": math.inf}  # largest number of values by `nargs`


def run(options: Namespace, heard: Heard, arguments: Sequence[str]) -> int:
    """Run the parsed command, print its report and return the exit code.

    Raises:
        FrameworkError: the command ends without a report.
    """
    options.warnings = []
    options.refusal = options.written = None
    with (
        np.errstate(all="ignore"),
        Progress("at work") as options.progress,
    ):  # commands report values that are not finite
        document, lines = options.run(options)
    if options.written is not None:
        lines.append(f"  written to        {options.written}")
    if options.warnings:
        document = {**document, "warnings": options.warnings}
        lines += (f"  warning           {warning}" for warning in options.warnings)
    heard.check()
    if options.refusal is not None:
        line, entry = describe_error(options.refusal, str(options.refusal), arguments)
        document = {**document, "error": entry}
    if options.json:
        tell(json.dumps(plain(document), allow_nan=False))
    else:
        report("\n".join(lines))
    if options.refusal is None:
        return 0
    complain(line)
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
    line, entry = describe_error(error, message, arguments)
    complain(line)
    if "--json" in arguments:
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
    """Return the line about an error, with advice, and its entry for JSON, with numbers."""
    instead = advise(error, arguments)
    advice = "" if instead is None else f"; {TRY}{instead}"
    line = one_line(message, most=MAX_MESSAGE_LENGTH - len(advice)) + advice
    document: Document = {"kind": type(error).__name__.lstrip("_"), "message": line}
    if instead is not None:
        document["try"] = instead
    for key in ("time", "s", "wrench", "joint", "residual", "platform", "nearest"):
        value = plain(getattr(error, key, None))
        if isinstance(value, float | str | list | dict):
            document[key] = value
    return line, document


# ------------------------------------------------------------------ advice


def advise(error: BaseException, arguments: Sequence[str]) -> str | None:
    """Return the command line to try instead of `arguments`; None without a remedy."""
    if isinstance(error, Misuse):
        return error.instead if error.mend is None else _mend_words(error.mend, arguments)
    remedy: Mapping[str, Any] | None = getattr(error, "remedy", None)
    if not remedy or not arguments or arguments[0] not in COMMANDS:
        return None
    words = typed = [word for word in arguments if word != "--json"]
    options = parser_of(typed).option_actions
    for name, value in remedy.items():
        flag = f"--{name.replace('_', '-')}"
        if flag not in options:
            return None
        words = _remove_option(words, options[flag])
        if value is not None and value is not False:
            words += [flag, *_typed_words(value)]
    instead = one_line(shlex.join(["crossing", *words]))
    is_same = sorted(words) == sorted(typed)
    return None if is_same or len(instead) > 500 else instead


def _mend_words(mend: Callable[[str], list[str] | None], arguments: Sequence[str]) -> str:
    """Replace the words, or values behind an option's `=`, that `mend` corrects."""
    words = ["crossing"]
    for word in arguments:
        flag, _, value = word.partition("=") if word.startswith("--") else ("", "", word)
        meant = mend(value)
        if meant is not None:
            words += [flag, *meant] if flag else meant
        elif word != "--json":
            words.append(word)
    return one_line(shlex.join(words))


def _remove_option(words: Sequence[str], option: argparse.Action) -> list[str]:
    """Remove an option and its values from the words of a command line."""
    count = option.nargs
    most = count if isinstance(count, int) else VALUE_COUNTS.get(count, 0.0)
    rest: list[str] = []
    values = 0.0  # number of values of the option that may still follow
    for word in words:
        flag, equals, _ = word.partition("=")
        if flag in option.option_strings:
            values = 0.0 if equals else most
        elif values and not word.startswith("--"):
            values -= 1
        else:
            values = 0.0
            rest.append(word)
    return rest


def _typed_words(value: Any) -> list[str]:
    """Return the value of an option as words of a command line; none for True."""
    if value is True:
        return []
    if isinstance(value, Mapping):
        distinct = set(value.values())
        if len(distinct) == 1:
            return _typed_words(distinct.pop())
        return [f"{key}={part:.6g}" for key, part in value.items()]
    if isinstance(value, list | tuple):
        return [word for part in value for word in _typed_words(part)]
    return [value if isinstance(value, str) else f"{value:.6g}"]
