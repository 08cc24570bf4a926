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
    tried = sorted(words) == sorted(typed)
    return None if tried or len(instead) > MAX_ADVICE_LENGTH else instead


def _mend_words(mend: Callable[[str], list[str] | None], arguments: Sequence[str]) -> str:
    """Replace words, alone or behind an option's `=`, by the words of `mend`, if any."""
    words: list[str] = []
    for word in arguments:
        flag, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        meant = mend(value)
        words += [word] if meant is None else [*([flag] if equals else []), *meant]
    return one_line(shlex.join(["crossing", *(word for word in words if word != "--json")]))


_COUNTS = {"None": 1.0, "?": 1.0, "+": math.inf, "*": math.inf}  # values of an option, by its `nargs`


def _remove_option(words: Sequence[str], option: argparse.Action) -> list[str]:
    """Remove an option and its values from the words of a command line."""
    rest: list[str] = []
    values = 0.0  # number of values of the option that may follow
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
            rest.append(word)
    return rest


def _typed_words(value: Any) -> list[str]:
    """Return the value of an option as words of a command line."""
    if value is True:
        return []
    if isinstance(value, Mapping):
        same = set(value.values())
        return (
            [f"{same.pop():.6g}"] if len(same) == 1 else [f"{key}={part:.6g}" for key, part in value.items()]
        )
    if isinstance(value, list | tuple):
        return [word for part in value for word in _typed_words(part)]
    return [value if isinstance(value, str) else f"{value:.6g}"]
