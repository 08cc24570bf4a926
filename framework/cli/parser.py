"""Declare the options that commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from framework.cli.commands import OneLineParser
from framework.model.description import FLEXIBILITIES
from framework.numerics import MAX_WORKERS
from framework.numerics.output import Document
from framework.planning.options import MODEL, MOTION, TYPED

Report = tuple[Document, list[str]]  # for programs, and the lines for people
MISSING = "what the file does not say, or says otherwise"
MAX_LISTED = 20  # entries that a report for people lists; the document has all


def integer_between(least: int, most: int) -> Callable[[str], int]:
    """Return an argparse type: whole numbers within bounds."""

    def read(text: str) -> int:
        """Parse a whole number; refuse other texts by argparse's error."""
        with suppress(ValueError):
            if least <= (number := int(text)) <= most:
                return number
        raise argparse.ArgumentTypeError(
            f"needs a whole number of at least {least} and at most {most}, got {text!r}"
        )

    return read


def add_robot(parser: OneLineParser, text: str = "catalogue name, or path of a robot file") -> None:
    """Add ROBOT."""
    parser.add_argument("robot", metavar="ROBOT", help=text)
    parser.topic(MODEL).add_argument(
        "--set",
        nargs="+",
        metavar="NAME=VALUE",
        help="values in place of the first ones of the robot file's parameters",
    )


def add_number(group: Any, flag: str, metavar: str, text: str, **settings: Any) -> None:
    """Add an option that takes a number, or several with `nargs`."""
    group.add_argument(flag, metavar=metavar, help=text, **{"type": float, **settings})


def not_empty(text: str) -> str:
    """Check the name of a file or folder; an argparse type."""
    if not text:
        raise argparse.ArgumentTypeError("needs a name, got an empty text")
    if text == "-":
        raise argparse.ArgumentTypeError("needs a name, got '-', which only `crossing export` takes")
    return text


def add_out(parser: OneLineParser, text: str, *, required: bool = False) -> None:
    """Add --out, the folder into which a command writes."""
    parser.add_argument("--out", type=not_empty, metavar="DIR", required=required, help=text)


def add_overwrite(parser: OneLineParser) -> None:
    """Add --overwrite."""
    parser.add_argument(
        "--overwrite", action="store_true", help="also files that are edited, or not of this program"
    )


def add_missing_fields(parser: OneLineParser) -> None:
    """Add options for fields that a file of a foreign dialect may lack."""
    group = parser.topic(MISSING)
    add_reference(parser)
    for flag, count, metavar, text in (
        ("--platform", None, "FRAME", "frame of the platform"),
        ("--axes", "+", "AXIS", "its axes, of x y z rx ry rz"),
        ("--motors", "+", "JOINT", "joints with a motor"),
        ("--platform-joints", "+", "JOINT", "joints whose positions are the platform's"),
        ("--lock", "+", "JOINT[=VALUE]", "hold joints, at the reference or at a value [rad, m]"),
        ("--base", None, "LINK", "only what this link carries moves, such as one leg"),
    ):
        group.add_argument(flag, nargs=count, metavar=metavar, help=text)


def add_reference(parser: OneLineParser) -> None:
    """Add --reference."""
    parser.topic(MISSING).add_argument(
        "--reference", nargs="+", metavar="JOINT=VALUE", help="near an assembled configuration [rad, m]"
    )


def add_robot_or_plan(parser: OneLineParser) -> None:
    """Add ROBOT, which may be a folder of `crossing plan --out`, and --robot-file."""
    add_robot(parser, "catalogue name, path of a robot file, or folder of `crossing plan --out`")
    add_moved_robot(parser)


def add_moved_robot(parser: OneLineParser) -> None:
    """Add --robot-file, for commands that read a folder of `crossing plan --out`."""
    parser.topic(MOTION).add_argument(
        "--robot-file", metavar="FILE", help="of the plan in the folder, if it has moved"
    )


def add_flexibility(parser: OneLineParser, *, auto: str = "") -> None:
    """Add --flexibility; the choice auto only with the help text `auto`."""
    parser.topic(MODEL).add_argument(
        "--flexibility",
        choices=(*FLEXIBILITIES, "auto") if auto else FLEXIBILITIES,
        default="rigid",
        help=f"which springs exist{f'; auto: {auto}' if auto else ''} (default: rigid)",
    )


def add_path(parser: OneLineParser, *, several: bool = False) -> None:
    """Add --scene, which takes `several` scenes or one, and --from, --to, --via, --blend."""
    group = parser.topic(MOTION)
    if several:
        group.add_argument(
            "--scene", dest="scenes", nargs="+", metavar="S", help="scenes of the robot file, side by side"
        )
    else:
        group.add_argument("--scene", metavar="S", help="a scene of the robot file: its path and motion")
    for flag, end, name in (("--from", "start", "first"), ("--to", "end", "last")):
        add_number(
            group, flag, "X", f"{name} point of the platform, on its axes [m, rad]", dest=end, nargs="+"
        )
    add_number(
        group,
        "--via",
        "X",
        "a corner between them, of straight segments that --blend rounds; may be repeated [m, rad]",
        nargs="+",
        action="append",
    )
    add_number(group, "--blend", "r", "how far from a corner its smooth blend begins and ends [m]")


def add_options(parser: OneLineParser, *names: str) -> None:
    """Add options of a plan by name, with the flag, help and type that `planning.options` declares.

    An option that the user does not type has the value None.
    """
    for name in names:
        option = TYPED[name]
        text = option.summary.replace("%", "%%")
        parser.topic(option.topic).add_argument(option.flag, default=None, help=text, **(option.typed or {}))


def add_path_and_motion(parser: OneLineParser, *, without: str = "", several: bool = False) -> None:
    """Add the options of a path (or `several` scenes), the springs and the motion."""
    add_path(parser, several=several)
    add_flexibility(parser)
    add_motion(parser, without=without)


def add_motion(parser: OneLineParser, *, without: str = "") -> None:
    """Add the options of `plan_crossing`, except `without` and --keep-limits."""
    add_options(parser, *(name for name in TYPED if name not in ("keep_limits", without)))
    add_wrenches(parser)


def add_wrenches(parser: OneLineParser) -> None:
    """Add --wrench and --wrench-on."""
    group = parser.topic(MODEL)
    add_number(
        group,
        "--wrench",
        "W",
        "constant, of the world on the platform, along its axes [N, N m]; in place of a scene's",
        nargs="+",
    )
    group.add_argument(
        "--wrench-on",
        nargs=7,
        action="append",
        metavar=("FRAME", "FX", "FY", "FZ", "MX", "MY", "MZ"),
        help="the same on the body of a link or joint, at its origin, base axes [N, N m]; may be repeated",
    )


def add_rows(parser: OneLineParser) -> None:
    """Add --rate and --columns of motion.csv, which `motion_rows` reads."""
    add_number(parser, "--rate", "F", "rows a second instead, the last at the end, such as 1000 [1/s]")
    parser.add_argument(
        "--columns",
        nargs="+",
        metavar="NAME",
        help="of the rows, or what the names of several begin with, such as time motor torque (default: all)",
    )


def add_executor(parser: OneLineParser) -> None:
    """Add --workers and --dask, which `executor_of` reads."""
    group = parser.topic("processes")
    group.add_argument(
        "--workers",
        type=integer_between(1, MAX_WORKERS),
        default=1,
        metavar="N",
        help="processes, this one included (default: 1)",
    )
    group.add_argument("--dask", metavar="ADDRESS", help="of a dask scheduler, instead of --workers")
