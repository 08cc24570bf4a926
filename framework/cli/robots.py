"""`crossing robots`, `crossing check` and `crossing convert`: the catalogue and files of robots."""

from __future__ import annotations

import re
from argparse import Namespace
from collections import defaultdict
from dataclasses import asdict
from importlib import import_module
from pathlib import Path as FilePath

import numpy as np

from framework.catalogue import catalogue
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_missing_fields,
    add_out,
    add_overwrite,
    add_robot,
    not_empty,
)
from framework.errors import (
    FrameworkError,
    InvalidInput,
    MissingPackage,
    NotAssembled,
    check_choice,
    list_names,
    point,
)
from framework.kinematics.diagnostics.diagnosis import Diagnosis, check_robot, reference_in_words
from framework.kinematics.diagnostics.proposal import propose
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.readers.recognise import DIALECTS
from framework.model.robot_file_writer import write_robot_file
from framework.model.urdf_elements import ParsedRobot
from framework.numerics.output import Document, select_fields, write_files
from framework.proofs.converted_reference import choose_reference
from framework.tolerances import SAME_PLACE

REMARK = "  {0:18s}  {1.summary}; singularities: {2}; {1.source}"


def add_robots_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing robots`."""
    parser.add_argument(
        "--picture", type=not_empty, metavar="FILE", help="draw them all into one picture (.png, .svg, .pdf)"
    )
    add_overwrite(parser)


def run_robots(options: Namespace) -> Report:
    """List the catalogue, one row for each robot."""
    arguments.check_page(options.picture, options, "--picture")
    rows: list[Document] = []
    robots: list[ParallelRobot] = []
    lines = ["name\tdof\tloops\tsprings\tscenes"]
    remarks = []
    for name, entry in catalogue().items():
        try:
            robot = entry.load()
        except MissingPackage as missing:  # the URDF is part of a package that is not installed
            figures: Document = {"needs": missing.package}
            cells = ["-", "-", "-", f"not installed: pip install {missing.package}"]
        else:
            robots.append(robot)
            diagnosis = check_robot(robot)
            figures = {
                "degrees_of_freedom": diagnosis.mobility - len(diagnosis.idle_joints),
                "loops": len(robot.description.closures),
                "springs": len(robot.description.springs) + len(robot.description.line_springs),
                "scenes": list(robot.description.scenes),
            }
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
        file = FilePath(options.picture)
        write_files({file: picture}, option="--picture", overwrite=options.overwrite)
        lines.append(f"drawn into {options.picture}")
    return {"robots": rows}, lines


# ------------------------------------------------------------------ crossing check

LISTS = ("platform_axes", "actuators", "passive_joints", "idle_joints", "springs", "massless_joints")
REPORT = """\
{robot}, {flexibility}
  platform          {platform_axes} at {place}
  actuated joints   {actuators}
  passive joints    {passive_joints}
  idle joints       {idle_joints}
  springs           {springs}
  mobility          {mobility}{idle}; A is {shape}
  closures          {rank} of {loop_equations} loop equations independent{redundant}; closed to \
{closure_error:.1e}
  mass              {mass:g} kg; without mass of their own: {massless_joints}
  reference         {{{angles}}}
  mode              working {working_mode:+d} (changes at Type 1), assembly {assembly_mode:+d} (changes at \
Type 2); smallest singular value of the passive joints' loop equations {smallest}"""


def add_check_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing check`."""
    add_robot(parser, "catalogue name, or path of a robot file or of a file of a foreign dialect")
    add_missing_fields(parser)
    add_flexibility(parser)


def run_check(options: Namespace) -> Report:
    """Examine a robot; report its mobility, masses, reference pose and advice."""
    mechanism = arguments.load_mechanism(options)
    diagnosis = check_robot(mechanism)
    options.refusal = _find_refusal(diagnosis, reference_in_words(mechanism))
    facts = asdict(diagnosis)
    smallest = diagnosis.smallest_singular_value
    idle, redundant = len(diagnosis.idle_joints), ", ".join(diagnosis.redundant_rows)
    names = map(mechanism.coordinates.name_of, range(mechanism.model.nv))
    least = dict(zip(names, SAME_PLACE * mechanism.column_scale, strict=True))  # of what is not rounding
    angles = [
        f"{joint}: {value if abs(value) > least.get(joint, SAME_PLACE) else 0.0:.6g}"
        for joint, value in diagnosis.reference.items()
    ]
    turns = np.array([axis not in ("x", "y", "z") for axis in diagnosis.platform_axes])
    words = {key: ", ".join(facts[key]) or "none" for key in LISTS} | {
        "place": point(diagnosis.platform, mechanism.unit_lengths(turns)),
        "idle": f", {idle} of them idle" if idle else "",
        "shape": _describe_axes(diagnosis),
        "redundant": f"; redundant: {redundant}" if redundant else "",
        "angles": ", ".join(angles),
        "smallest": "unknown" if smallest is None else f"{smallest:.3g}",
    }
    description, flexibility = mechanism.description, mechanism.flexibility
    sprung = description.least_flexibility("flexible_links")  # with all springs of the file
    if sprung != description.least_flexibility(flexibility):
        words["springs"] += f"; all of the file with --flexibility {sprung}"
    notes = [f"  note              {advice}" for advice in diagnosis.advice]
    return facts, [REPORT.format_map(facts | words), *notes]


def _find_refusal(diagnosis: Diagnosis, reference: str) -> FrameworkError | None:
    """Return the reason why other commands refuse the robot, or None.

    `reference` states the reference in words.
    """
    if not diagnosis.assembled:
        instead = "" if diagnosis.square else ", where A is not square: the notes say at what to look first"
        return NotAssembled(
            f"the loops do not close near {reference}; they do at the pose that is "
            f"printed as reference{instead}",
            name=diagnosis.robot,
            q=np.array(list(diagnosis.reference.values())),
            residual=diagnosis.gap_at_reference,
        ).advising({"reference": diagnosis.reference} if diagnosis.square else None)
    if diagnosis.square:
        return None
    why = f"A is {_describe_axes(diagnosis)}; the notes say what other commands need"
    return InvalidInput(f"{diagnosis.robot}: {why}")


def _describe_axes(diagnosis: Diagnosis) -> str:
    """Describe whether A is square, or which platform axes and motors do not fit."""
    if diagnosis.square:
        return "square"
    axes, motors = diagnosis.platform_axes, diagnosis.actuators
    freedoms = diagnosis.mobility - len(diagnosis.idle_joints)
    if len(axes) == freedoms == len(motors):
        return f"square, but the axes {', '.join(axes)} do not tell the {freedoms} degrees of freedom apart"
    counts = f"{len(axes)} platform axes and {len(motors)} actuators for {freedoms} degrees of freedom"
    return f"not square: {counts}"


# ------------------------------------------------------------------ crossing convert


def add_convert_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing convert`."""
    add_robot(parser, "path of a file of a foreign dialect, or catalogue name")
    add_out(parser, "write NAME.yaml and NAME.urdf there", required=True)
    add_overwrite(parser)
    add_missing_fields(parser)
    parser.add_argument(
        "--close",
        nargs="+",
        action="append",
        metavar="WORD",
        help="close a loop: FRAME FRAME KIND, then the joint's axis x, y or z (default: z), or a length [m]",
    )
    parser.add_argument(
        "--package", nargs="+", metavar="NAME=FOLDER", help="where meshes of package://NAME/ are"
    )


def run_convert(options: Namespace) -> Report:
    """Write NAME.yaml and NAME.urdf into --out."""
    options.robot = _find_description(options.robot)
    parsed = arguments.parse_file(options, propose=propose)
    description, chosen = choose_reference(parsed)
    remarks = [*parsed.remarks, *chosen]
    friction = _dry_friction(parsed)
    if friction:
        remarks.append(f"in the file, but no plan counts with it: dry friction of {friction} (joint side)")
    written = write_robot_file(description, options.out, comments=remarks, overwrite=options.overwrite)
    if description.left_out:
        remarks.append(f"left out: {'; '.join(description.left_out)}")
    document = {
        "robot": description.name,
        "dialect": parsed.dialect,
        "file": str(written),
        "urdf": str(written.with_suffix(".urdf")),
        "remarks": [*parsed.remarks, *chosen],
        "left_out": description.left_out,
    }
    loops = [closure.name for closure in description.closures]
    loops += [coupling.name for coupling in description.couplings]
    lines = [
        f"{description.name}, read as {DIALECTS[parsed.dialect]}: loops closed by {list_names(loops)}",
        *(f"  {remark}" for remark in remarks),
        f"  written to        {written}",
        f"  next              crossing check {written}",
    ]
    return document, lines


def _find_description(name: str) -> str:
    """Return the file of a robot of the package robot_descriptions; any other word as it is."""
    if not re.fullmatch(r"\w+_description", name) or FilePath(name).exists():
        return name
    try:
        from robot_descriptions import DESCRIPTIONS
    except ImportError:
        raise MissingPackage(
            f"{name}: is in the package robot_descriptions, which is not installed: pip install "
            f"robot_descriptions",
            package="robot_descriptions",
        ) from None
    check_choice("robot", name, DESCRIPTIONS)
    module = import_module(f"robot_descriptions.{name}")  # fetches the files when it is imported first
    return str(getattr(module, "MJCF_PATH", None) or module.URDF_PATH)


def _dry_friction(parsed: ParsedRobot) -> str:
    """State the dry friction of joints without a motor, by size."""
    slides = {joint.name for joint in parsed.tree.joints.values() if joint.kind == "prismatic"}
    joints = defaultdict[str, list[str]](list)  # by size and unit
    for name, dynamics in parsed.description.joints.items():
        if dynamics.friction and name not in parsed.description.motor_joints:  # plans count that of motors
            joints[f"{dynamics.friction:g} {'N' if name in slides else 'N m'}"].append(name)
    return "; ".join(f"{', '.join(names)} {size} each" for size, names in joints.items())
