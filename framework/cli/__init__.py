"""The command line: `crossing COMMAND`, one file a command.

Exit codes: 0 done, 1 the answer is no, 2 misuse or bad input (one line on stderr). With --json there
is one JSON object on stdout and nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from framework.cli import check, convert, locate, plan, report, robots, robustness, show, simulate
from framework.cli.parser import Misuse, OneLineParser
from framework.errors import FrameworkError, NoAnswer

COMMANDS = (
    robots,
    check,
    convert,
    locate,
    plan,
    simulate,
    robustness,
    show,
    report,
)  # in the order of --help


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options = _parser().parse_args(given)
        with np.errstate(all="ignore"):  # what is not finite is told as an error, not as a warning
            document, text = options.run(options)
    except (FrameworkError, Misuse) as error:
        print(f"crossing: {error}", file=sys.stderr)
        if "--json" in given:
            _print(json.dumps({"error": _error_document(error)}, allow_nan=False))
        return 1 if isinstance(error, NoAnswer) else 2
    _print(json.dumps(document, allow_nan=False) if options.json else text)
    return 0


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:  # whoever reads has seen enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _error_document(error: Exception) -> dict[str, Any]:
    """An error for machines: its kind, the sentence, and the numbers that it carries."""
    document: dict[str, Any] = {"kind": type(error).__name__.lstrip("_"), "message": str(error)}
    for key in ("time", "s", "wrench", "joint", "residual", "platform"):
        value = getattr(error, key, None)
        if (isinstance(value, float) and np.isfinite(value)) or isinstance(value, str):
            document[key] = value
        elif isinstance(value, np.ndarray):
            document[key] = value.tolist()
    return document


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="crossing",
        description="Carry parallel robots through Type 2 singularities with finite motor torques.",
    )
    parser.set_defaults(json=False)
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=OneLineParser)

    for command in COMMANDS:
        command.add(commands)
    return parser


def _version() -> str:
    return f"crossing {version('parallel-singularity-crossing')}"
