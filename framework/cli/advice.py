"""The command line to try after a refusal, from the remedy that the error carries: never from its words."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from framework.cli.commands import COMMANDS, Misuse, parser_of
from framework.cli.console import one_line

MAX_ADVICE_LENGTH = 500  # [characters] half of what a complaint may have


def advised(error: BaseException, arguments: Sequence[str]) -> str | None:
    """Return the command line to try instead of `arguments`; None where nothing is known to help."""
    if isinstance(error, Misuse):
        return error.instead if error.mend is None else _mended(error.mend, arguments)
    remedy: Mapping[str, Any] | None = getattr(error, "remedy", None)
    if not remedy or not arguments or arguments[0] not in COMMANDS:
        return None
    words = [word for word in arguments if word != "--json"]
    options = parser_of(words).option_actions
    for name, value in remedy.items():
        flag = f"--{name.replace('_', '-')}"
        if flag not in options:
            return None
        words = _without(words, options[flag])
        if value is not None and value is not False:
            words += [flag, *_words(value)]
    instead = one_line(shlex.join(["crossing", *words]))
    tried = sorted(words) == sorted(word for word in arguments if word != "--json")
    return None if tried or len(instead) > MAX_ADVICE_LENGTH else instead


def _mended(mend: Callable[[str], list[str] | None], arguments: Sequence[str]) -> str:
    """Return a command line with other words in place of some, alone or behind an option's `=`."""
    words: list[str] = []
    for word in arguments:
        flag, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        meant = mend(value)
        words += [word] if meant is None else [*([flag] if equals else []), *meant]
    return one_line(shlex.join(["crossing", *(word for word in words if word != "--json")]))


_COUNTS = {"None": 1.0, "?": 1.0, "+": math.inf, "*": math.inf}  # values of an option, by its `nargs`


def _without(words: Sequence[str], option: argparse.Action) -> list[str]:
    """Return the words of a command line without an option and its values."""
    kept: list[str] = []
    values = 0.0  # of the option that are still to come
    for word in words:
        flag, equals, _ = word.partition("=")
        if flag in option.option_strings:
            count = option.nargs
            many = float(count) if isinstance(count, int) else _COUNTS.get(str(count), 0.0)
            values = 0.0 if equals else many
        elif values and not word.startswith("--"):
            values -= 1
        else:
            values = 0
            kept.append(word)
    return kept


def _words(value: Any) -> list[str]:
    """Return the value of an option as it is typed."""
    if value is True:
        return []
    if isinstance(value, Mapping):
        same = set(value.values())
        return (
            [f"{same.pop():.6g}"] if len(same) == 1 else [f"{key}={part:.6g}" for key, part in value.items()]
        )
    if isinstance(value, list | tuple):
        return [word for part in value for word in _words(part)]
    return [value if isinstance(value, str) else f"{value:.6g}"]
