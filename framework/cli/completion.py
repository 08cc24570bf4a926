"""`crossing completion`: a script for a shell that completes commands, options, robots and files."""

from __future__ import annotations

from argparse import Namespace, _SubParsersAction
from typing import Any

from framework.catalogue import own_robots
from framework.cli.commands import OneLineParser, parser_of
from framework.cli.parser import Report
from framework.errors import MissingPackage

SHELLS = ("bash", "zsh", "fish")
_FILES = ("FILE", "DATA", "TABLE")  # metavars
_FOLDERS = ("DIR", "FOLDER")


def add_completion_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing completion`."""
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help=", ".join(SHELLS))


def run_completion(options: Namespace) -> Report:
    """Print the script."""
    try:
        import shtab
    except ImportError:
        raise MissingPackage(
            "completion is written by shtab, which is not installed: pip install shtab", package="shtab"
        ) from None
    parser: Any = parser_of([], whole=True)
    commands = next(action for action in parser._actions if isinstance(action, _SubParsersAction))
    for command in commands.choices.values():
        for action in command._actions:
            name = str(action.metavar or action.dest).upper()
            if name in _FOLDERS:
                action.complete = shtab.DIRECTORY
            elif name in _FILES:
                action.complete = shtab.FILE
            elif name == "ROBOT" and not action.option_strings:
                action.choices = list(own_robots())
    script = shtab.complete(parser, options.shell)
    return {"shell": options.shell, "script": script}, [script.rstrip("\n")]
