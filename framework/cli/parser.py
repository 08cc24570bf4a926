"""The options that commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from framework.cli.commands import COMMANDS
from framework.crossing.options import TYPED
from framework.model.description import FLEXIBILITIES
from framework.parallel import MAX_WORKERS

Report = tuple[dict[str, Any], str]  # for machines, for people


def integer_between(least: int, most: int) -> Callable[[str], int]:
    """Return a reader of whole numbers within bounds, for argparse."""

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if not least <= number <= most:
            raise argparse.ArgumentTypeError(
                f"needs a whole number of at least {least} and at most {most}, got {text!r}"
            )
        return number

    return read


def command(commands: Any, name: str, run: Callable[[argparse.Namespace], Report], more: str = "") -> Any:
    """Add a command with --json; `run` gives its report. Its own help has `more` to say than the list."""
    text = COMMANDS[name].text
    parser = commands.add_parser(name, help=text, description=f"{text}. {more}" if more else text)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")
    parser.set_defaults(run=run)
    return parser


def add_robot(parser: argparse.ArgumentParser, text: str = "catalogue name, or path of a robot file") -> None:
    """Add ROBOT."""
    parser.add_argument("robot", metavar="ROBOT", help=text)


def add_missing_fields(parser: argparse.ArgumentParser) -> None:
    """Add the options for what a file of a foreign dialect may leave out."""
    group = parser.add_argument_group("what the file does not say, or says otherwise")
    group.add_argument("--platform", metavar="FRAME", help="frame of the platform")
    group.add_argument("--axes", nargs="+", metavar="AXIS", help="its axes, of x y z rx ry rz")
    group.add_argument("--motors", nargs="+", metavar="JOINT", help="joints with a motor")
    group.add_argument(
        "--reference", nargs="+", metavar="JOINT=VALUE", help="near an assembled configuration [rad, m]"
    )
    group.add_argument(
        "--platform-joints", nargs="+", metavar="JOINT", help="joints whose positions are the platform's"
    )
    group.add_argument(
        "--lock",
        nargs="+",
        metavar="JOINT[=VALUE]",
        help="hold joints, at the reference or at a value [rad, m]",
    )
    group.add_argument("--base", metavar="LINK", help="only what this link carries moves, such as one leg")


def add_moved_robot(parser: argparse.ArgumentParser) -> None:
    """Add --robot-file, for commands that read a folder of `crossing plan --out`."""
    parser.add_argument(
        "--robot-file",
        metavar="FILE",
        help="of the plan in the folder, if it has moved",
    )


def add_flexibility(parser: argparse.ArgumentParser, *, auto: str = "") -> None:
    """Add --flexibility; `auto`: the help of that choice, where the command has it."""
    parser.add_argument(
        "--flexibility",
        choices=(*FLEXIBILITIES, "auto") if auto else FLEXIBILITIES,
        default="rigid",
        help=f"which springs exist{f'; auto: {auto}' if auto else ''} (default: rigid)",
    )


def add_path(parser: argparse.ArgumentParser) -> None:
    """Add --scene, --from and --to."""
    parser.add_argument("--scene", metavar="S", help="a scene of the robot file")
    parser.add_argument(
        "--from", dest="start", type=float, nargs="+", metavar="X", help="first platform point"
    )
    parser.add_argument("--to", dest="end", type=float, nargs="+", metavar="X", help="last platform point")


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add these options of a plan, declared in `crossing.options`; those not typed are None."""
    for name in names:
        option = TYPED[name]
        text = option.summary.replace("%", "%%")
        parser.add_argument(option.flag, default=None, help=text, **(option.typed or {}))


def add_motion(parser: argparse.ArgumentParser, *, without: str = "") -> None:
    """Add what `plan_crossing` may be told but one option; --keep-limits is for `crossing plan` alone."""
    add_options(parser, *(name for name in TYPED if name not in ("keep_limits", without)))
    add_wrenches(parser)


def add_wrenches(parser: argparse.ArgumentParser) -> None:
    """Add --wrench and --wrench-on."""
    parser.add_argument(
        "--wrench",
        type=float,
        nargs="+",
        metavar="W",
        help="constant, of the world on the platform, along its axes [N, N m]; in place of a scene's",
    )
    parser.add_argument(
        "--wrench-on",
        nargs=7,
        action="append",
        metavar=("FRAME", "FX", "FY", "FZ", "MX", "MY", "MZ"),
        help="the same on the body of a link or joint, at its origin, base axes [N, N m]; may be repeated",
    )


def add_executor(parser: argparse.ArgumentParser) -> None:
    """Add --workers and --dask, for `executor_of`."""
    parser.add_argument(
        "--workers",
        type=integer_between(1, MAX_WORKERS),
        default=1,
        metavar="N",
        help="processes (default: 1)",
    )
    parser.add_argument("--dask", metavar="ADDRESS", help="of a dask scheduler, instead of --workers")


@contextmanager
def progress_bar(total: float, unit: str, *, silent: bool = False) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr while the block runs, if a person looks at it; call it with the number done."""
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, disable=True if silent else None, leave=False) as bar:

        def advance(done: float) -> None:
            bar.update(done - bar.n)

        yield advance
