"""The commands in the order of --help, and the parser that lists them without importing one."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any, NamedTuple, NoReturn


class Command(NamedTuple):
    """The module of `framework.cli` that has a command, and what the list of commands says of it."""

    module: str
    text: str


COMMANDS = {
    "robots": Command("robots", "list the catalogue"),
    "check": Command("check", "mobility, rank, redundant rows, masses, closure error, mode"),
    "convert": Command(
        "convert",
        "write our robot file from another dialect: Gepetto's robot.yaml beside robot.urdf, URDF+ <loop>, "
        "ROS <constraint>, <loop_joint>, MJCF <equality>; --base LINK: of one part of it, such as a leg",
    ),
    "locate": Command("locate", "find the singular points on a path"),
    "map": Command(
        "workspace_map", "quantities over the workspace on one working mode, with the singular locus on top"
    ),
    "pose": Command(
        "pose", "all joints of a pose, from its motors or from its platform, in the modes of the reference"
    ),
    "plan": Command("plan", "plan a motion through the singular points, with torques and proof"),
    "capacity": Command("capacity", "the largest multiple of a wrench that is crossed within the limits"),
    "fidelity": Command("fidelity", "the least model that is enough for a motion, with its evidence"),
    "simulate": Command(
        "simulate", "drive the robot with the planned torques: tracking error, drift, energy"
    ),
    "robustness": Command(
        "robustness", "drive a planned crossing with a controller on many robots that differ from their model"
    ),
    "show": Command(
        "show",
        "play motions in the browser, side by side; without a motion, move the robot by hand. Ctrl-C ends it",
    ),
    "report": Command(
        "report",
        "write one HTML page about a plan: scene, figures, law, certificate, parameters, reproduction",
    ),
    "export": Command(
        "export", "a robot as MuJoCo's MJCF, a plan as a trajectory for ros2_control, a scene as a lesson"
    ),
    "calibrate": Command(
        "calibrate",
        "where joints are, from motor angles and measured poses or parts of poses, with standard deviations",
    ),
    "identify": Command(
        "identify",
        "masses, inertias, rotor inertias and friction from recorded motor angles and torques, with standard "
        "deviations",
    ),
}


class Misuse(Exception):
    """argparse found the command line wrong."""


class OneLineParser(argparse.ArgumentParser):
    """argparse with errors in one line, and negative numbers with exponents."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)
        # argparse takes -1e-3 for an option: its pattern for negative numbers knows no exponents
        self._negative_number_matcher = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse what is known, and complain of the rest in the name of the command that was given it."""
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            hint = self._option_like(unknown[0])
            self.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
        return parsed, unknown

    def _option_like(self, given: str) -> str:
        """Return the hint at the option that an unknown one may stand for; empty if none is like it."""
        from difflib import get_close_matches

        options = [option for option in self._option_string_actions if option.startswith("--")]
        begun = [option for option in options if len(given) > len("--") and option.startswith(given)]
        near = begun or get_close_matches(given.partition("=")[0], options, n=1)
        return f"; did you mean {' or '.join(near)}?" if near else ""

    def error(self, message: str) -> NoReturn:
        raise Misuse(f"{message} (see `{self.prog} --help`)")


class _Version(argparse.Action):
    """--version, looked up when it is asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(
            option_strings, dest=argparse.SUPPRESS, default=argparse.SUPPRESS, nargs=0, help=help
        )

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        parser.exit(message=f"crossing {version('parallel-singularity-crossing')}\n")


def parser_of(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of the command that the arguments begin with, or else one that lists all commands.

    Only the module of that command is imported.
    """
    parser = OneLineParser(
        prog="crossing",
        description="Carry parallel robots through Type 2 singularities with finite motor torques.",
    )
    parser.set_defaults(json=False)
    parser.add_argument("--version", action=_Version, help="say the version and end")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=OneLineParser)
    if arguments and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        from framework.errors import choose_from

        raise Misuse(f"{choose_from('command', arguments[0], COMMANDS)} (see `{parser.prog} --help`)")
    if arguments and arguments[0] in COMMANDS:
        import_module(f"framework.cli.{COMMANDS[arguments[0]].module}").add(commands)
    else:
        for name, command in COMMANDS.items():
            commands.add_parser(name, help=command.text)
    return parser
