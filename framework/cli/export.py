"""`crossing export`: a robot for MuJoCo, a plan for ros2_control, or a page to learn from."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path as FilePath
from typing import Any

import yaml

from framework.cli import arguments
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_motion,
    add_robot_or_plan,
    add_rows,
    command,
    integer_between,
)
from framework.crossing.motion_table import DEFAULT_ROWS
from framework.crossing.options import MOTION
from framework.crossing.result import CrossingPlan
from framework.crossing.saved import is_plan_folder
from framework.crossing.scenes import scene, scene_path
from framework.errors import InvalidInput, NoAnswer
from framework.export.mjcf import START, mjcf_text, ranges_left_out
from framework.export.trajectory_file import (
    DEFAULT_SAMPLES,
    SAMPLE_RANGE,
    SIDES,
    describe_side,
    joint_trajectory,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.output import write_file

SIDE = "joint"  # of the gears, by default
SUFFIXES = {
    "mjcf": (".xml", ".mjcf"),
    "ros2_control": (".yaml", ".yml", ".json"),
    "csv": (".csv",),
    "lesson": (".html",),
}


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "export", run)
    add_robot_or_plan(parser)
    parser.add_argument(
        "--to",
        dest="program",
        choices=tuple(SUFFIXES),
        required=True,
        metavar="FORMAT",
        help=f"one of {', '.join(SUFFIXES)}",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        required=True,
        help="NAME.xml, for ros2_control NAME.yaml or NAME.json, NAME.csv, for a lesson NAME.html",
    )
    parser.add_argument(
        "--samples",
        type=integer_between(*SAMPLE_RANGE),
        metavar="N",
        help=f"points of the trajectory (default: 501), rows of csv (default: {DEFAULT_ROWS})",
    )
    add_rows(parser)
    parser.add_argument(
        "--side", choices=tuple(SIDES), help="of the gears that the trajectory is on (default: joint)"
    )
    parser.add_argument(
        "--hinges",
        action="store_true",
        help="in a MuJoCo model: balls as three hinges each",
    )
    group = parser.topic(MOTION)
    group.add_argument("--scene", metavar="S", help="a scene of the robot file, to be planned")
    parser.set_defaults(start=None, end=None, via=None, blend=None)
    add_flexibility(parser)
    add_motion(parser)


def run(options: Namespace) -> Report:
    """Write the file, whole or not at all."""
    file = FilePath(options.out)
    if not file.name:
        raise InvalidInput(f"--out: needs the name of a file, got {options.out!r}")
    if file.suffix not in SUFFIXES[options.program]:
        valid = " or ".join(SUFFIXES[options.program])
        raise InvalidInput(f"--out: {options.program} is written to {valid}, got {options.out!r}").advising(
            {"out": str(file.with_suffix(SUFFIXES[options.program][0]))}
        )
    if options.hinges and options.program != "mjcf":
        raise InvalidInput("--hinges: of a MuJoCo model only; leave it out").advising({"hinges": None})
    if options.program != "csv" and not (options.rate is None and options.columns is None):
        raise InvalidInput("--rate, --columns: of csv only; leave them out").advising(
            dict.fromkeys(("rate", "columns"))
        )
    if options.program == "csv" and options.side is not None:
        raise InvalidInput("--side: the columns of csv say theirs; leave it out").advising({"side": None})
    lines: list[str] = []
    if options.program == "mjcf":
        if any(option is not None for option in (options.scene, options.samples, options.side)):
            raise InvalidInput(
                "--scene, --samples, --side: a MuJoCo model has no motion; leave them out"
            ).advising(dict.fromkeys(("scene", "samples", "side")))
        saved = is_plan_folder(options.robot)
        robot = arguments.load_or_plan(options).robot if saved else arguments.load(options)
        text, description = mjcf_text(robot, hinges=options.hinges), "a MuJoCo model with its loops"
        lines.append(f"  {START}")
        if left_out := ranges_left_out(robot):
            lines.append(f"  without the ranges of {', '.join(left_out)}: the reference is outside")
    elif options.program == "lesson":
        robot, text = _lesson(options)
        description = "a lesson of five steps, to be opened in a browser"
    else:
        if not (is_plan_folder(options.robot) or options.scene):
            raise InvalidInput("give --scene, or the folder that `crossing plan --out` wrote, to be exported")
        plan = arguments.load_or_plan(options)
        robot = plan.robot
        text, description = _motion_file(options, plan, file)
        if options.program == "ros2_control":
            lines.append(f"  {describe_side(plan, options.side or SIDE)}")
    write_file(file, text, option="--out")
    document = {
        "robot": robot.name,
        "flexibility": robot.flexibility,
        "format": options.program,
        "file": str(file),
    }
    head = f"{robot.name}, {robot.flexibility}: {description}, written to {file}"
    return document, "\n".join([head, *lines])


def _motion_file(options: Namespace, plan: CrossingPlan, file: FilePath) -> tuple[str, str]:
    """Return the text and the description of a motion, for a file; write metadata beside rows of csv."""
    over = f"over {plan.duration:g} s"
    if options.program == "csv":
        motion = arguments.motion_rows(options, plan)
        beside = file.with_name(f"{file.name}-metadata.json")
        write_file(beside, motion.metadata(file.name), option="--out")
        return motion.as_csv(), f"{len(motion.rows)} rows of {len(motion.names)} columns {over}"
    side = options.side or SIDE
    message = joint_trajectory(plan, samples=options.samples or DEFAULT_SAMPLES, side=side)
    description = f"a joint trajectory of {len(message['points'])} points {over}"
    if file.suffix == ".json":
        return json.dumps(message, indent=2) + "\n", description
    return f"# {describe_side(plan, side)}\n" + yaml.safe_dump(message, sort_keys=False), description


def _lesson(options: Namespace) -> tuple[ParallelRobot, str]:
    """Return the robot and the page about one of its scenes."""
    if options.scene is None or options.samples is not None or options.side is not None:
        raise InvalidInput("a lesson is about a scene of a robot: give --scene, without --samples and --side")
    if options.wrench is not None or options.wrench_on is not None:
        raise InvalidInput("--wrench, --wrench-on: a lesson has no wrenches of the world; leave them out")
    from framework.show.lesson import lesson_page  # matplotlib takes time to import

    robot = arguments.load(options)
    chosen = scene(robot, options.scene)
    if chosen.wrenches is not None:
        raise InvalidInput(f"--scene {chosen.name} has wrenches of the world, which a lesson does not have")
    try:
        if chosen.duration is None:
            raise InvalidInput(f"--scene {chosen.name} has no duration, which a lesson needs")
        page = lesson_page(robot, scene_path(chosen), duration=chosen.duration, name=f"Scene {chosen.name}")
    except NoAnswer as error:
        error.args = (f"--scene {chosen.name}: {error}",)
        raise
    return robot, page
