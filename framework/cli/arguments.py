"""Make the robot, the path and the motion that a command line requests, and write the files of --out."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from framework.catalogue import robot_file
from framework.cli.parser import Report
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.external_wrenches import wrench_on_platform
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.curves import Polyline
from framework.laws.path import Line, Path
from framework.model.description import FLEXIBILITIES
from framework.model.readers.describe import Propose
from framework.model.readers.recognise import parse_any
from framework.model.robot_file import unused_parameters
from framework.model.urdf_elements import ParsedRobot
from framework.numerics.fields import MAX_ROWS, number
from framework.numerics.interruption import check_interruption
from framework.numerics.kept import KeptChunks, remove_stores
from framework.numerics.output import PROGRAM, check_files, write_files, written_together
from framework.numerics.tasks import executor_of
from framework.planning.motion_table import DEFAULT_ROWS, MotionTable, motion_columns, select_columns
from framework.planning.options import TYPED
from framework.planning.remedies import plan_or_advise
from framework.planning.request import MOTOR_LIMITS, Request
from framework.planning.result import CrossingPlan
from framework.planning.saved import is_plan_folder, load_plan
from framework.planning.scenes import scene, scene_path, scene_request

if TYPE_CHECKING:
    from framework.fidelity.predicted_level import ChosenLevel

AUTO = "auto"
MotionOptions = dict[str, Any]  # options of `plan_crossing`, by name
WRENCH_OPTIONS = ("wrench", "wrench_on")


def take_level(options: Namespace) -> ChosenLevel | None:
    """Choose the level of --flexibility auto, and set its options; None otherwise.

    If the motion is the scene's, unchanged, it is the level that the scene keeps of a study. Else the level
    is predicted.

    Raises:
        InvalidInput: --geometry as well, or no motion.
    """
    if options.flexibility != AUTO:
        return None
    from framework.fidelity.predicted_level import options_of_level, predict_level, scene_level

    if options.geometry is not None:
        raise InvalidInput(
            "--geometry: each level of --flexibility auto has its own; leave one of them out"
        ).advising({"geometry": None})
    options.flexibility = FLEXIBILITIES[0]
    robot = load(options)
    requested = request(options, robot)
    description = robot.description
    typed = motion_options(options, robot)
    typed.pop("keep_limits", None)
    chosen = None if typed or options.scene is None else scene_level(description, options.scene)
    if chosen is None:
        chosen = predict_level(description, options.scene or requested.path, **typed)
    for key, value in options_of_level(description, chosen.level).items():
        if key != "smoothness" or options.smoothness is None:
            setattr(options, key, value)
    return chosen


def load(options: Namespace) -> ParallelRobot:
    """Load the robot, assembled at its reference, as `load_mechanism` does."""
    mechanism = load_mechanism(options)
    robot = ParallelRobot.assemble_or_advise(mechanism)
    if not mechanism.description.reference and not np.array_equal(robot.q_near, mechanism.q_near):
        options.warnings.append(
            f"{robot.name}: no reference is given; a search has found one within the joints' limits, which "
            f"`crossing check` prints"
        )
    return robot


def load_mechanism(options: Namespace) -> Mechanism:
    """Load the mechanism with the springs of --flexibility; warn if springs are missing."""
    flexibility = getattr(options, "flexibility", "rigid")
    others = ", or a folder of `crossing plan --out`" if hasattr(options, "robot_file") else ""
    file = robot_file(options.robot, others=others)
    mechanism = Mechanism.from_file(file, flexibility=flexibility, **_missing_fields(options))
    if mechanism.flexibility != flexibility:
        options.warnings.append(
            f"{mechanism.name} has no springs of its own for --flexibility {flexibility}: taken as "
            f"{mechanism.flexibility}"
        )
    warn_of_unused(options, mechanism)
    return mechanism


def warn_of_unused(options: Namespace, mechanism: Mechanism) -> None:
    """Warn of parameters of the robot file whose values change nothing."""
    options.warnings += [
        f"{mechanism.name}: the parameter {name} is used nowhere; write ${{{name}}} where it counts, in the "
        f"robot file or its URDF"
        for name in unused_parameters(mechanism.description)
    ]


def parse_file(options: Namespace, *, propose: Propose) -> ParsedRobot:
    """Read a robot file, or a file of a foreign dialect completed by the options."""
    return parse_any(robot_file(options.robot), propose=propose, **_missing_fields(options))


def named_words(option: str, words: Sequence[str], form: str) -> dict[str, str]:
    """Parse words NAME=TEXT."""
    pairs = [word.partition("=") for word in words]
    for (name, _, text), word in zip(pairs, words, strict=True):
        if not name or not text:
            raise InvalidInput(f"{option}: needs {form}, got {word!r}")
    return {name: text for name, _, text in pairs}


def named_numbers(option: str, words: Sequence[str], form: str) -> dict[str, float]:
    """Parse words NAME=VALUE with finite numbers."""
    texts = named_words(option, words, f"{form} with a finite number")
    return {name: number(f"{option} {name}", text) for name, text in texts.items()}


def _missing_fields(options: Namespace) -> MotionOptions:
    """Return the fields that options add to a foreign file, for `parse_any`."""
    values = vars(options)
    fields = {key: values.get(key) for key in ("platform", "axes", "motors", "base", "platform_joints")}
    form = "JOINT=VALUE"
    fields["reference"] = named_numbers("--reference", values.get("reference") or [], form)
    fields["parameters"] = named_numbers("--set", values.get("set") or [], "NAME=VALUE")
    locked = dict[str, float | None]()  # None: at the reference
    for word in values.get("lock") or []:
        locked |= named_numbers("--lock", [word], form) if "=" in word else {word: None}
    for key, option in (("closures", "close"), ("packages", "package")):  # of convert alone
        if values.get(option):
            fields[key] = values[option]
    return fields | {"locked": locked}


def path(options: Namespace, robot: ParallelRobot) -> Path:
    """Return the path of --scene, or the line of --from and --to."""
    start, end, via = options.start, options.end, options.via or []
    if (options.blend is None) == bool(via):
        missing = "--via: needs --blend r" if via else "--blend: needs a corner, --via X.."
        raise InvalidInput(f"{missing}: blends begin and end r from each corner [m]")
    if options.scene is not None:
        if via or start is not None or end is not None:
            raise InvalidInput("--scene already has a path; give either --scene or --from and --to").advising(
                _NO_LINE
            )
        return scene_path(scene(robot, options.scene))
    if start is None or end is None:
        scenes = list(robot.description.scenes)
        if getattr(options, "to_mode", None) or getattr(options, "in_joints", None):
            raise InvalidInput("--in, --to-mode: need both --from and --to")
        if not scenes:
            raise InvalidInput(f"give both --from and --to: {robot.name} has no scenes")
        raise InvalidInput(
            f"give either --scene (of {robot.name}: {', '.join(scenes)}) or both --from and --to"
        ).advising({**_NO_LINE, "scene": scenes[0]})
    flags = ["--from", *["--via"] * len(via), "--to"]
    for flag, corner in zip(flags, [start, *via, end], strict=True):
        finite_numbers(f"{flag} ({', '.join(robot.axis_names)})", corner, robot.n)
    return Polyline([start, *via, end], options.blend) if via else Line(start, end)


def request(options: Namespace, robot: ParallelRobot) -> Request:
    """Return the request of the options; typed options override the scene's."""
    typed = motion_options(options, robot)
    along = path(options, robot)
    if options.scene is not None:
        planned = scene_request(robot, options.scene, **typed)
        stated = scene(robot, options.scene)
        dropped = {
            name: " ".join(f"{value:g}" for value in getattr(stated, name))
            for name in ("times", "speeds")
            if getattr(stated, name) and getattr(planned, name) is None and name not in typed
        }
        if dropped and typed.keys().isdisjoint(("law", "optimize", "longest", "margin")):  # limits alone
            options.warnings.append(
                f"{' and '.join(dropped)} at crossings belong to the scene's own law, and are left out here "
                f"({' '.join(f'--{name} {values}' for name, values in dropped.items())})"
            )
        return planned
    if "duration" not in typed and not (typed.get("optimize") == "time" or "longest" in typed):
        raise InvalidInput(
            "--duration: needed in seconds, unless --optimize time finds the least, or --longest bounds it"
        )
    return Request.of(robot, along, **typed)


def options_with_wrenches(options: Namespace, robot: ParallelRobot) -> MotionOptions:
    """Return the typed options of the motion, by default with the scene's wrenches."""
    of_scene = {} if options.scene is None else {"wrenches": scene(robot, options.scene).wrenches}
    return of_scene | motion_options(options, robot)


def motion_options(options: Namespace, robot: ParallelRobot) -> MotionOptions:
    """Return the options of the motion that were typed, wrenches included."""
    return typed_options(options) | wrenches(options, robot)


def typed_options(options: Namespace) -> MotionOptions:
    """Return the options of the motion that were typed, with shares and limits of motors as numbers.

    `TYPED` are the options of a plan that the command line has, by name; one that was not typed is None.
    """
    values = vars(options)
    typed = {key: values[key] for key in TYPED if values.get(key) is not None}
    if "margin" in typed:  # "10%" or 0.1
        typed["margin"] = share("--margin", typed["margin"])
    for name in set(MOTOR_LIMITS) & typed.keys():
        typed[name] = limits(TYPED[name].flag, typed[name])
    return typed


def wrenches(options: Namespace, robot: ParallelRobot) -> MotionOptions:
    """Return the option `wrenches` by --wrench and --wrench-on; nothing without any.

    Raises:
        InvalidInput: a wrench is not 6 numbers, or a frame has two wrenches.
    """
    by_frame = {} if options.wrench is None else dict([wrench_on_platform(robot, options.wrench)])
    for frame, *words in options.wrench_on or []:
        if frame in by_frame:
            raise InvalidInput(f"--wrench, --wrench-on: {frame} has two wrenches; add them up")
        try:
            by_frame[frame] = tuple(map(float, words))
        except ValueError:
            raise InvalidInput(f"--wrench-on {frame}: needs 6 numbers, got {' '.join(words)}") from None
    return {"wrenches": by_frame} if by_frame else {}


def limits(option: str, words: Sequence[str]) -> list[float | None] | dict[str, float | None]:
    """Parse limits of motors: numbers, or JOINT=N of some; `none` is no limit."""
    joints, _, texts = zip(*(word.rpartition("=") for word in words), strict=True)
    try:
        values = [None if text == "none" else float(text) for text in texts]
    except ValueError:
        raise InvalidInput(f"{option}: needs numbers, JOINT=N or none, got {' '.join(words)}") from None
    if not any(joints):
        return values
    if not all(joints):
        raise InvalidInput(f"{option}: needs either numbers or JOINT=N of some, got {' '.join(words)}")
    return dict(zip(joints, values, strict=True))


def share(name: str, text: str) -> float:
    """Parse a share such as 10% or 0.1."""
    try:
        return float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        raise InvalidInput(f"{name}: needs a share such as 10% or 0.1, got {text!r}") from None


def load_or_plan(options: Namespace) -> CrossingPlan:
    """Load the plan of a folder, or else plan by the options.

    Raises:
        As `saved_plan`, `load_plan` and `plan_crossing`.
    """
    saved = saved_plan(options)
    if saved is not None:
        return saved
    robot = load(options)
    check_columns(options, robot)
    return plan_or_advise(robot, request(options, robot))


def check_columns(options: Namespace, robot: ParallelRobot) -> None:
    """Refuse unknown --columns before the plan is computed, which takes time."""
    select_columns(motion_columns(robot), getattr(options, "columns", None))


def saved_plan(options: Namespace) -> CrossingPlan | None:
    """Load the plan if ROBOT is a folder of a plan; None otherwise.

    Raises:
        InvalidInput: options of the motion with a folder, which has its own motion; --robot-file without a
            folder.
    """
    if not is_plan_folder(options.robot):
        if options.robot_file is not None:
            raise InvalidInput("--robot-file: goes with a folder of `crossing plan --out`").advising(
                {"robot_file": None}
            )
        return None
    refuse_options(
        options, _OF_A_PLAN, f"the plan in {options.robot} has its own; leave it out, or plan again"
    )
    return load_plan(options.robot, robot_file=options.robot_file)


def check_rows(options: Namespace) -> None:
    """Refuse --samples together with --rate."""
    if options.rate is not None and options.samples is not None:
        raise InvalidInput("--samples, --rate: both say how many rows; leave one of them out").advising(
            {"samples": None}
        )


def motion_rows(options: Namespace, plan: CrossingPlan) -> MotionTable:
    """Return the rows of motion.csv by --samples or --rate, and --columns."""
    period = row_period(options, plan)
    return plan.samples(options.samples or DEFAULT_ROWS, period=period, columns=options.columns)


def row_period(options: Namespace, plan: CrossingPlan) -> float | None:
    """Return the time [s] between rows by --rate; None for --samples rows."""
    if options.rate is None:
        return None
    least, most = 1.0 / plan.duration, (MAX_ROWS - 1) / plan.duration
    if not least <= options.rate <= most:
        raise InvalidInput(
            f"--rate: needs {least:.4g} to {most:.4g} rows a second here, got {options.rate:g}"
        )
    return 1.0 / options.rate


def refuse_options(options: Namespace, keys: Iterable[str], reason: str) -> None:
    """Refuse the first typed option among `keys`, for a reason.

    The remedy is to leave the option out. The flexibility rigid may be the default, and is not refused.
    """
    for key in keys:
        value = getattr(options, key, None)
        if value is not None and value is not False and value != "rigid":
            flag = flag_of(key)
            raise InvalidInput(f"{flag}: {reason}").advising({flag[2:]: None})


def flag_of(key: str) -> str:
    """Return the flag of an option by its key among the parsed options."""
    name = {"start": "from", "end": "to", "scenes": "scene"}.get(key, key)
    return f"--{name.removeprefix('spread_').replace('_', '-')}"


_NO_LINE = dict.fromkeys(("from", "to", "via", "blend"))  # remedy: leave these options out
_OF_A_PLAN = (
    "scene",
    "scenes",
    "start",
    "end",
    "via",
    "blend",
    "set",
    "flexibility",
    *TYPED,
    *WRENCH_OPTIONS,
)


# ------------------------------------------------------------------ files of --out


def write_page(file: FilePath, page: str | bytes, options: Namespace, option: str = "--html") -> Report:
    """Write one file and return the report on its name and size."""
    write_files({file: page}, option=option, overwrite=options.overwrite)
    size = file.stat().st_size
    return {"file": str(file), "bytes": size}, [f"written to {file} ({size / 1e6:.2f} MB)"]


def check_page(file: str | FilePath | None, options: Namespace, option: str = "--html") -> None:
    """Refuse a page or picture that cannot be written, before long work; None is no file."""
    if file is not None:
        check_files({FilePath(file): PROGRAM}, option=option, overwrite=options.overwrite)


@contextmanager
def written_out(
    options: Namespace, document: str, files: Collection[str] = (), outdated: Collection[str] = ()
) -> Iterator[FilePath | None]:
    """Yield a folder whose files `written_together` moves into --out; None without --out.

    The block does all the work, so that foreign `document` and `files` are refused before.
    """
    if options.out is None:
        yield None
        return
    with written_together(FilePath(options.out), document=document, files=files, outdated=outdated) as folder:
        yield folder
    options.written = options.out


def count_chunks(store: KeptChunks | None, unit: str) -> str:
    """Count the finished chunks of a store, each a `unit`; empty if none is finished."""
    count = 0 if store is None else len(store.read())
    return f"{count} {unit}" if count else ""


def start_workers(options: Namespace, *modules: str) -> AbstractContextManager[Executor | None]:
    """Return the context of the executor of --workers or --dask, whose processes import modules at once."""
    return executor_of(workers=options.workers, dask=options.dask, imports=modules)


@contextmanager
def written_stepwise(
    options: Namespace, document: str, files: Collection[str], describe_kept: Callable[[], str]
) -> Iterator[FilePath | None]:
    """Yield the folder of `written_out`, for long work that may be interrupted.

    After an interruption finished parts stay in --out, and the message states them: `describe_kept()`, empty
    if nothing is finished.
    """
    with written_out(options, document, files) as folder:
        try:
            yield folder
            check_interruption()  # which other code may have caught
        except KeyboardInterrupt as stop:
            finished = describe_kept()
            sentence = f"{finished} are kept in {options.out}, and the same command goes on from them"
            raise type(stop)(*([sentence] if finished else [])) from None
    if options.out is not None:
        remove_stores(FilePath(options.out))
