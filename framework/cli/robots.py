"""`crossing robots`: list the catalogue, with facts about each robot."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path as FilePath
from typing import Any

from framework.catalogue import catalogue
from framework.cli.parser import Report, command, not_empty
from framework.errors import MissingPackage
from framework.kinematics.diagnostics.diagnosis import check_robot
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.output import Document, select_fields, write_file

REMARK = "  {0:18s}  {1.summary}; singularities: {2}; {1.source}"


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "robots", run)
    parser.add_argument(
        "--picture", type=not_empty, metavar="FILE", help="draw them all into one picture (.png, .svg, .pdf)"
    )


def run(options: Namespace) -> Report:
    """List the catalogue, one row for each robot."""
    rows: list[Document] = []
    robots: list[ParallelRobot] = []
    lines, remarks = ["name\tdof\tloops\tsprings\tscenes"], []
    for name, entry in catalogue().items():
        try:
            robot = entry.load()
        except MissingPackage as missing:  # the URDF is part of a package that is not installed
            figures: Document = {"needs": missing.package}
            cells = ["-", "-", "-", f"not installed: pip install {missing.package}"]
        else:
            robots.append(robot)
            figures = _count_parts(robot)
            *numbers, scenes = figures.values()
            cells = [*map(str, numbers), ", ".join(scenes)]
        about = select_fields(entry, "summary", "singularities", "source")
        rows.append({"name": name, **figures, **about, "file": str(entry.file)})
        lines.append("\t".join([name, *cells]))
        kinds = ", ".join(entry.singularities) or "none on its scenes"
        remarks.append(REMARK.format(name, entry, kinds))
    lines += remarks
    if options.picture is not None:
        from framework.show.drawing import gallery_picture  # matplotlib takes time to import

        options.progress.start("drawing the picture")
        picture = gallery_picture(robots, FilePath(options.picture).suffix[1:])
        write_file(FilePath(options.picture), picture, option="--picture")
        lines.append(f"drawn into {options.picture}")
    return {"robots": rows}, lines


def _count_parts(robot: ParallelRobot) -> Document:
    """Count freedoms, loops and springs of a robot, and list its scenes."""
    description, diagnosis = robot.description, check_robot(robot)
    return {
        "degrees_of_freedom": diagnosis.mobility - len(diagnosis.idle_joints),
        "loops": len(description.closures),
        "springs": len(description.springs),
        "scenes": list(description.scenes),
    }
