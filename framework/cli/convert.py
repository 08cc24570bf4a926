"""`crossing convert`: a robot file out of a file of a foreign dialect."""

from __future__ import annotations

import argparse
from typing import Any

from framework.cli import arguments
from framework.cli.parser import Report, add_missing_fields, add_robot, command
from framework.model.readers.recognise import DIALECTS
from framework.model.robot_file_writer import write_robot_file

TEXT = (
    "write our robot file from another dialect: Gepetto's robot.yaml beside robot.urdf, URDF+ <loop>, "
    "ROS <constraint>, MJCF <equality>; --base LINK: of one part of it, such as a leg"
)


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "convert", run, TEXT)
    add_robot(parser, "path of a file of a foreign dialect, or catalogue name")
    parser.add_argument("--out", metavar="DIR", required=True, help="write NAME.yaml and NAME.urdf there")
    add_missing_fields(parser)


def run(options: argparse.Namespace) -> Report:
    """Write NAME.yaml and NAME.urdf into --out."""
    description, _, dialect = arguments.parsed(options)
    written = write_robot_file(description, options.out)
    document = {
        "robot": description.name,
        "dialect": dialect,
        "file": str(written),
        "urdf": str(written.with_suffix(".urdf")),
    }
    closures = ", ".join(closure.name for closure in description.closures)
    text = (
        f"{description.name}, read as {DIALECTS[dialect]}: loops closed by {closures}\n"
        f"  written to        {written}"
    )
    return document, f"{text}\n  next              crossing check {written}"
