"""`crossing report`: write one HTML page about a saved plan."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

from framework.cli.parser import Report, add_moved_robot, command, not_empty
from framework.cli.writing import write_page
from framework.planning.saved import load_plan


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "report", run)
    parser.add_argument("folder", metavar="DIR", help="folder of `crossing plan --out`")
    add_moved_robot(parser)
    parser.add_argument(
        "--html", type=not_empty, metavar="FILE", help="where to write it (default: DIR/report.html)"
    )


def run(options: Namespace) -> Report:
    """Read a plan, prove its torques again, and write the page."""
    from framework.show.captions import describe_saved_plan
    from framework.show.report import report_page

    options.progress.start("proving the plan anew, and drawing the page")
    folder = Path(options.folder)
    plan = load_plan(folder, robot_file=options.robot_file)
    page = report_page(plan, name=describe_saved_plan(plan, folder.resolve().name))
    return write_page(Path(options.html or folder / "report.html"), page)
