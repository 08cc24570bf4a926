"""`crossing robots`: the catalogue, and what each robot is."""

from __future__ import annotations

import argparse
from pathlib import Path as FilePath
from typing import Any

from framework.catalogue import catalogue
from framework.cli.parser import Report, command, not_empty
from framework.errors import MissingPackage
from framework.kinematics.diagnostics.diagnosis import check_robot
from framework.output import write_file


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "robots", run)
    parser.add_argument(
        "--picture", type=not_empty, metavar="FILE", help="draw them all into one picture (.png, .svg, .pdf)"
    )


def run(options: argparse.Namespace) -> Report:
    """List the catalogue, one row for each entry."""
    rows: list[dict[str, Any]] = []
    figures: dict[str, Any]
    drawn = []
    for name, entry in catalogue().items():
        try:
            robot = entry.load()
            drawn.append(robot)
        except MissingPackage as missing:  # its URDF is somebody else's, and not here
            figures = {"needs": missing.package}
        else:
            description, diagnosis = robot.description, check_robot(robot)
            figures = {
                "degrees_of_freedom": diagnosis.mobility - len(diagnosis.idle_joints),
                "loops": len(description.closures),
                "springs": len(description.springs),
                "scenes": list(description.scenes),
            }
        rows.append(
            {
                "name": name,
                **figures,
                "summary": entry.summary,
                "singularities": list(entry.singularities),
                "source": entry.source,
                "file": str(entry.file),
            }
        )
    lines = ["name\tdof\tloops\tsprings\tscenes"]
    for row in rows:
        if "needs" in row:
            lines.append(f"{row['name']}\t-\t-\t-\tnot installed: pip install {row['needs']}")
        else:
            numbers = "\t".join(str(row[key]) for key in ("degrees_of_freedom", "loops", "springs"))
            lines.append(f"{row['name']}\t{numbers}\t{', '.join(row['scenes'])}")
    for row in rows:
        kinds = ", ".join(row["singularities"]) or "none on its scenes"
        about = f"{row['summary']}; singularities: {kinds}; {row['source']}"
        lines.append(f"  {row['name']:18s}  {about}")
    if options.picture is not None:
        from framework.show.gallery import gallery_picture  # matplotlib takes time to import

        options.progress.start("drawing the picture")
        picture = gallery_picture(drawn, FilePath(options.picture).suffix[1:])
        write_file(FilePath(options.picture), picture, option="--picture")
        lines.append(f"drawn into {options.picture}")
    return {"robots": rows}, "\n".join(lines)
