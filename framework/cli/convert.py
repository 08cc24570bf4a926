"""`crossing convert`: write a robot file from a file of a foreign dialect."""

from __future__ import annotations

import argparse
from collections import defaultdict
from typing import Any

from framework.cli import arguments
from framework.cli.parser import Report, add_missing_fields, add_out, add_robot, command
from framework.kinematics.diagnostics.proposal import propose
from framework.model.description import ParsedRobot
from framework.model.readers.recognise import DIALECTS
from framework.model.robot_file_writer import write_robot_file


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "convert", run)
    add_robot(parser, "path of a file of a foreign dialect, or catalogue name")
    add_out(parser, "write NAME.yaml and NAME.urdf there", required=True)
    add_missing_fields(parser)


def run(options: argparse.Namespace) -> Report:
    """Write NAME.yaml and NAME.urdf into --out."""
    parsed = arguments.parse_file(options, propose=propose)
    description = parsed.description
    remarks, friction = list(parsed.remarks), _dry_friction(parsed)
    if friction:
        remarks.append(f"in the file, but no plan counts with it: dry friction of {friction} (joint side)")
    written = write_robot_file(description, options.out, comments=remarks)
    if description.left_out:
        remarks.append(f"left out: {'; '.join(description.left_out)}")
    document = {
        "robot": description.name,
        "dialect": parsed.dialect,
        "file": str(written),
        "urdf": str(written.with_suffix(".urdf")),
        "remarks": parsed.remarks,
        "left_out": description.left_out,
    }
    loops = [closure.name for closure in description.closures]
    loops += [coupling.name for coupling in description.couplings]
    lines = [
        f"{description.name}, read as {DIALECTS[parsed.dialect]}: loops closed by {', '.join(loops)}",
        *(f"  {remark}" for remark in remarks),
        f"  written to        {written}",
        f"  next              crossing check {written}",
    ]
    return document, lines


def _dry_friction(parsed: ParsedRobot) -> str:
    """State the dry friction of joints without a motor, by size."""
    slides = {joint.get("name") for joint in parsed.urdf.findall("./joint[@type='prismatic']")}
    joints = defaultdict[str, list[str]](list)  # by size and unit
    for name, dynamics in parsed.description.joints.items():
        if dynamics.friction and name not in parsed.description.motor_joints:  # plans count that of motors
            joints[f"{dynamics.friction:g} {'N' if name in slides else 'N m'}"].append(name)
    return "; ".join(f"{', '.join(names)} {size} each" for size, names in joints.items())
