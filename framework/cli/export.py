"""`crossing export`: a robot for MuJoCo, a plan for ros2_control or as a table, a controller, a lesson."""

from __future__ import annotations

import inspect
import json
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path as FilePath

import yaml

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_motion,
    add_number,
    add_overwrite,
    add_robot_or_plan,
    add_rows,
    integer_between,
)
from framework.control import ControlLoop, Spread, TableController, Tuning, controller_table, reference_of
from framework.control.prediction import LinearModels
from framework.errors import InvalidInput, NoAnswer
from framework.files.mjcf import START, mjcf_text, ranges_left_out
from framework.files.trajectory_file import (
    DEFAULT_SAMPLES,
    SAMPLE_RANGE,
    SIDES,
    describe_side,
    joint_trajectory,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.output import PROGRAM, check_files, json_text, write_files
from framework.planning.motion_table import DEFAULT_ROWS
from framework.planning.options import MOTION
from framework.planning.result import CrossingPlan
from framework.planning.saved import is_plan_folder
from framework.planning.scenes import scene, scene_path

Export = tuple[ParallelRobot, dict[FilePath, str], list[str]]  # robot, texts by file, lines of the report
SIDE = "joint"  # side of the gears by default
SUFFIXES = {
    "mjcf": (".xml", ".mjcf"),
    "ros2_control": (".yaml", ".yml", ".json"),
    "csv": (".csv",),
    "lesson": (".html",),
    "controller": (".csv",),
}
FORMATS_OF = {  # formats that take an option; all formats take the others
    "scene": ("ros2_control", "csv", "lesson", "controller"),
    "samples": ("ros2_control", "csv"),
    "side": ("ros2_control",),
    "rate": ("ros2_control", "csv"),
    "at": ("csv",),
    "columns": ("csv",),
    "hinges": ("mjcf",),
    "wrench": ("ros2_control", "csv", "controller"),
    "wrench_on": ("ros2_control", "csv", "controller"),
    "sensors": ("controller",),
    "period": ("controller",),
    "known_delay": ("controller",),
}


def add_export_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing export`."""
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
        help="NAME.xml, for ros2_control NAME.yaml or .json, NAME.csv, for a lesson NAME.html, for a "
        "controller NAME.csv with NAME.json and NAME_run.py; - is stdout",
    )
    add_overwrite(parser)
    parser.add_argument(
        "--samples",
        type=integer_between(*SAMPLE_RANGE),
        metavar="N",
        help=f"points of the trajectory (default: 501), rows of csv (default: {DEFAULT_ROWS})",
    )
    add_rows(parser)
    add_number(parser, "--at", "T", "rows of csv at these instants instead [s]", nargs="+")
    parser.add_argument(
        "--side", choices=tuple(SIDES), help="of the gears that the trajectory is on (default: joint)"
    )
    parser.add_argument("--hinges", action="store_true", help="in a MuJoCo model: balls as three hinges each")
    control = parser.topic("a controller")
    control.add_argument(
        "--sensors", nargs="+", metavar="NAME", help="of lqg, as in robustness (default: motors)"
    )
    add_number(control, "--period", "T", "sampling period [s] (default: 1e-3)")
    add_number(control, "--known-delay", "T", "from measurement to torque [s] (default: 0)")
    group = parser.topic(MOTION)
    group.add_argument("--scene", metavar="S", help="a scene of the robot file, to be planned")
    parser.set_defaults(start=None, end=None, via=None, blend=None)
    add_flexibility(parser)
    add_motion(parser)


def run_export(options: Namespace) -> Report:
    """Write the complete file, and what stands beside it, or none."""
    to_stdout = options.out == "-"
    file = FilePath(f"stdout{SUFFIXES[options.program][0]}" if to_stdout else options.out)
    _check_options(options, file)
    arguments.check_rows(options)
    if not to_stdout:
        check_files(_begin_files(options, file), option="--out", overwrite=options.overwrite)
    robot, texts, lines = WRITERS[options.program](options, file)
    if to_stdout:
        return {"robot": robot.name, "format": options.program, "text": texts[file]}, [texts[file].rstrip()]
    write_files(texts, option="--out", overwrite=options.overwrite)
    document = {
        "robot": robot.name,
        "flexibility": robot.flexibility,
        "format": options.program,
        "file": str(file),
    }
    description, *rest = lines
    head = f"{robot.name}, {robot.flexibility}: {description}, written to {file}"
    return document, [head, *(f"  {line}" for line in rest)]


def _check_options(options: Namespace, file: FilePath) -> None:
    """Refuse a file of another format, and options that the format does not take."""
    program = options.program
    suffixes = SUFFIXES[program]
    if not file.name:
        raise InvalidInput(f"--out: needs the name of a file, got {options.out!r}")
    if file.suffix not in suffixes:
        raise InvalidInput(
            f"--out: {program} is written to {' or '.join(suffixes)}, got {options.out!r}"
        ).advising({"out": str(file.with_suffix(suffixes[0]))})
    for key, formats in FORMATS_OF.items():
        if program not in formats:
            reason = f"of {', '.join(formats)} only, not of {program}; leave it out"
            arguments.refuse_options(options, [key], reason)


def _begin_files(options: Namespace, file: FilePath) -> dict[FilePath, str]:
    """Return how the text of each file begins, for `check_files`."""
    match options.program:
        case "csv":
            first = "" if options.columns else "time,s,"
            return {file: first, file.with_name(f"{file.name}-metadata.json"): '{\n "@context": '}
        case "controller":
            return {
                file: "",  # numbers
                file.with_suffix(".json"): '{\n  "robot": ',
                file.with_name(f"{file.stem}_run.py"): _read_program(),
            }
        case _:
            return {file: '{\n  "header": ' if file.suffix == ".json" else PROGRAM}


def _read_program() -> str:
    """Return the program that runs a controller in a table."""
    return FilePath(inspect.getfile(TableController)).read_text(encoding="utf-8")


def _controller_file(options: Namespace, file: FilePath) -> Export:
    """Return lqg for a plan as a table, its description, and a program that runs both.

    It expects a payload and springs that are 10 and 20 % off, friction of 5 % of the peak, 8192 counts.
    """
    plan = _plan_of(options)
    reference = reference_of(plan, period=1e-3 if options.period is None else options.period)
    sensors = tuple(options.sensors or ["motors"])
    loop = ControlLoop(
        sensors=" ".join(sensors), delay=options.known_delay or 0.0, counts=8192, link_counts=2**18
    )
    spread = Spread(payload=0.1, stiffness=0.2 if plan.robot.n_e else 0.0, friction=0.05)
    controller, prediction = LinearModels.of(reference, spread, Tuning()).tune_lqg(loop)
    if warning := prediction.warning(loop.tolerance):
        options.warnings.append(warning)
    table, description = controller_table(controller, sensors)
    program = file.with_name(f"{file.stem}_run.py")
    texts = {
        file: table,
        file.with_suffix(".json"): json_text(description),
        program: _read_program(),
    }
    lines = [
        "lqg as a table",
        f"described in {file.with_suffix('.json').name}, run by {program.name}",
        f"predicted standard deviation of the platform, not tried: {prediction.platform:.2g} robot lengths "
        "or rad",
    ]
    return plan.robot, texts, lines


def _model_file(options: Namespace, file: FilePath) -> Export:
    """Return a robot as a MuJoCo model, without a motion."""
    saved = arguments.saved_plan(options)
    robot = arguments.load(options) if saved is None else saved.robot
    lines = ["a MuJoCo model with its loops", START]
    if left_out := ranges_left_out(robot):
        lines.append(f"without the ranges of {', '.join(left_out)}: the reference is outside")
    return robot, {file: mjcf_text(robot, hinges=options.hinges)}, lines


def _plan_of(options: Namespace) -> CrossingPlan:
    """Return the plan of a folder, or plan --scene."""
    if not (is_plan_folder(options.robot) or options.scene):
        robot = arguments.load(options)  # refuses what is no robot either
        scenes = list(robot.description.scenes)
        listed = f"of {robot.name}: {', '.join(scenes)}" if scenes else f"{robot.name} has none"
        raise InvalidInput(
            f"give --scene ({listed}), or the folder that `crossing plan --out` wrote, to be exported"
        ).advising({"scene": scenes[0]} if scenes else None)
    return arguments.load_or_plan(options)


def _table_file(options: Namespace, file: FilePath) -> Export:
    """Return the rows of a motion, with their metadata beside the file."""
    plan = _plan_of(options)
    if options.at is None:
        motion = arguments.motion_rows(options, plan)
    else:
        arguments.refuse_options(options, ("samples", "rate"), "--at says which rows; leave one of them out")
        motion = plan.samples(at=options.at, columns=options.columns)
    metadata = file.with_name(f"{file.name}-metadata.json")
    size = f"{len(motion.rows)} rows of {len(motion.names)} columns"
    texts = {file: motion.as_csv(), metadata: motion.metadata(file.name)}
    return plan.robot, texts, [f"{size} over {plan.duration:g} s"]


def _trajectory_file(options: Namespace, file: FilePath) -> Export:
    """Return a motion as a joint trajectory, in YAML or JSON."""
    plan = _plan_of(options)
    side = options.side or SIDE
    period = arguments.row_period(options, plan)
    message = joint_trajectory(plan, samples=options.samples or DEFAULT_SAMPLES, period=period, side=side)
    sentence = describe_side(plan, side)
    if file.suffix == ".json":
        text = json.dumps(message, indent=2) + "\n"
    else:
        text = f"# {sentence}; by {PROGRAM}\n" + yaml.safe_dump(message, sort_keys=False)
    size = f"a joint trajectory of {len(message['points'])} points"
    return plan.robot, {file: text}, [f"{size} over {plan.duration:g} s", sentence]


def _lesson_file(options: Namespace, file: FilePath) -> Export:
    """Return a page on which readers try condition (8) for a scene."""
    if options.scene is None:
        raise InvalidInput("a lesson is about a scene of a robot: give --scene")
    from framework.show.lesson import lesson_page  # matplotlib takes time to import

    robot = arguments.load(options)
    chosen = scene(robot, options.scene)
    if chosen.wrenches is not None:
        raise InvalidInput(f"--scene {chosen.name} has wrenches of the world, which a lesson does not have")
    duration = chosen.duration if options.duration is None else options.duration
    if duration is None:
        raise InvalidInput(f"--scene {chosen.name} has no duration, which a lesson needs; give --duration")
    try:
        page = lesson_page(robot, scene_path(chosen), duration=duration, name=f"Scene {chosen.name}")
    except NoAnswer as error:
        raise error.naming(f"--scene {chosen.name}: {error.name}") from None
    return robot, {file: page}, ["a lesson of five steps, to be opened in a browser"]


WRITERS: dict[str, Callable[[Namespace, FilePath], Export]] = {
    "mjcf": _model_file,
    "ros2_control": _trajectory_file,
    "csv": _table_file,
    "lesson": _lesson_file,
    "controller": _controller_file,
}
