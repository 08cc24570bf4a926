"""The command line: `crossing COMMAND`, one file a command. Open `plan` first, then `arguments`.

It parses and prints, and computes nothing.

What commands share
    parser              the parser, and the options of several commands
    arguments           from options to the robot, the path and the request
    console             reports on stdout, errors in one line on stderr

Commands
    robots, check, convert   the catalogue; what a file describes; files of other dialects
    locate, pose             singular points on a path; all joints of a pose
    workspace_map, design_study  `map`, and `map --study`
    plan, raw                `plan`, and `plan --raw`
    fidelity, simulate       how good the model and the plan are
    robustness, replay       `robustness`, and `robustness STUDY --replay K`
    show, report, export     pages, reports, files for other programs

Exit codes: 0 done, 1 the answer is no (`check`: not assembled at its reference), 2 misuse or bad input, 70 a
fault of this program, 130 ended by Ctrl-C, 143 by SIGTERM: all but 0 with one line on stderr. A page that is
served ends by a signal as it should: 0. With --json there is one JSON object on stdout
and nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from framework.cli.console import complain, one_line, tell
from framework.cli.parser import Misuse, OneLineParser
from framework.errors import FrameworkError, NoAnswer
from framework.interruption import Heard, Terminated, exit_code, interruptible

# Commands in the order of --help, and the modules that have them: imported when they are asked for.
COMMANDS = {
    "robots": "robots",
    "check": "check",
    "convert": "convert",
    "locate": "locate",
    "map": "workspace_map",
    "pose": "pose",
    "plan": "plan",
    "fidelity": "fidelity",
    "simulate": "simulate",
    "robustness": "robustness",
    "show": "show",
    "report": "report",
    "export": "export",
}
UNEXPECTED_EXIT_CODE = 70  # exit code; sysexits.h calls it EX_SOFTWARE
DEBUG_VARIABLE = "CROSSING_DEBUG"  # environment variable: set, an unexpected error shows its traceback


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    with interruptible() as heard:
        try:
            return _run(given, heard)
        except KeyboardInterrupt as stop:
            return interrupted(stop, given)


def interrupted(stop: KeyboardInterrupt, given: Sequence[str]) -> int:
    """Say that a command was interrupted; returns the exit code."""
    words = "terminated" if isinstance(stop, Terminated) else "interrupted"
    return _refused(stop, one_line(": ".join([words, *map(str, stop.args)])), exit_code(stop), given)


def _run(given: Sequence[str], heard: Heard) -> int:
    try:
        options = _parser(given).parse_args(given)
        options.warnings = []
        options.refusal = None
        with np.errstate(all="ignore"):  # what is not finite is told as an error, not as a warning
            document, text = options.run(options)
        if options.warnings:
            document = {**document, "warnings": options.warnings}
            text = "\n".join([text, *(f"  warning           {warning}" for warning in options.warnings)])
        heard.check()
        if options.refusal is not None:
            document = {**document, "error": _error_document(options.refusal, str(options.refusal))}
        tell(json.dumps(document, allow_nan=False) if options.json else text)
        if options.refusal is not None:
            complain(one_line(str(options.refusal)))
            return 1
    except (FrameworkError, Misuse) as error:
        heard.check()
        return _refused(error, one_line(str(error)), 1 if isinstance(error, NoAnswer) else 2, given)
    except Exception as error:  # whatever else happens, nobody meant it to
        heard.check()  # an import that is interrupted may fail in other words
        if os.environ.get(DEBUG_VARIABLE):
            raise
        return _refused(error, one_line(_unexpected(error)), UNEXPECTED_EXIT_CODE, given)
    return 0


def _refused(error: BaseException, message: str, code: int, given: Sequence[str]) -> int:
    """Say why there is no answer; returns the exit code."""
    complain(message)
    if "--json" in given:
        tell(json.dumps({"error": _error_document(error, message)}, allow_nan=False))
    return code


def _unexpected(error: Exception) -> str:
    """The sentence for an error that is a fault of the program: what, where, and what to do."""
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


def _error_document(error: BaseException, message: str) -> dict[str, Any]:
    """An error for machines: its kind, the sentence, and the numbers that it carries."""
    document: dict[str, Any] = {"kind": type(error).__name__.lstrip("_"), "message": message}
    for key in ("time", "s", "wrench", "joint", "residual", "platform"):
        value = getattr(error, key, None)
        if (isinstance(value, float) and np.isfinite(value)) or isinstance(value, str):
            document[key] = value
        elif isinstance(value, np.ndarray):
            document[key] = value.tolist()
    return document


def _parser(given: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of the command that is given, or of all where none is."""
    parser = OneLineParser(
        prog="crossing",
        description="Carry parallel robots through Type 2 singularities with finite motor torques.",
    )
    parser.set_defaults(json=False)
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=OneLineParser)

    for command in given[:1] if given and given[0] in COMMANDS else COMMANDS:
        import_module(f"framework.cli.{COMMANDS[command]}").add(commands)
    return parser


def _version() -> str:
    return f"crossing {version('parallel-singularity-crossing')}"
