"""`crossing locate`: the singular points on a path."""

from __future__ import annotations

import argparse
from typing import Any

from framework.cli import arguments
from framework.cli.parser import Report, add_path, add_robot, command
from framework.errors import point
from framework.singularity.points_on_path import locate_singularities


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "locate", run, "find the singular points on a path")
    add_robot(parser)
    add_path(parser)


def run(options: argparse.Namespace) -> Report:
    """The singular points in the order of the path."""
    robot = arguments.load(options)
    path = arguments.path(options, robot)
    points = locate_singularities(robot, path)
    document = {
        "robot": robot.name,
        "singularities": [
            {
                "s": found.s,
                "kind": found.kind,
                "contact": found.contact,
                "corank": found.corank,
                "twist": found.twist.tolist(),
                "platform": found.platform.tolist(),
                "slope": found.slope,
            }
            for found in points
        ],
    }
    if not points:
        return document, f"{robot.name}: no singularity on the path"
    axes = ", ".join(robot.axis_names)
    return document, "\n".join(
        f"s = {found.s:.15f}  {found.kind} ({found.contact})  {axes} = {point(found.platform)}  "
        f"t_s = {point(found.twist)}  dg/ds = {found.slope:.6g}"
        for found in points
    )
