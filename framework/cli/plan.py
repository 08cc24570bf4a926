"""`crossing plan`: a motion through the singular points, with torques and proof."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_motion,
    add_number,
    add_options,
    add_out,
    add_path,
    add_robot,
    add_rows,
    integer_between,
)
from framework.dynamics.finite_differences import finite_difference_torques
from framework.errors import InvalidInput, check_choice, finite_numbers
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.diagnostics.mistaken_units import remarks_on_bodies
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import Law
from framework.numerics.arrays import Array
from framework.numerics.fields import MAX_ROWS, MIN_ROWS
from framework.numerics.output import Document, json_text, select_fields, write_csv
from framework.numerics.time_limit import end_searches_by_ctrl_c
from framework.planning.joint_path import JointPath, flip_legs, is_flip, with_platform_joints
from framework.planning.motion_table import DEFAULT_ROWS, sample_times
from framework.planning.options import MOTION
from framework.planning.plan import law_before_proof, max_torque_ratio
from framework.planning.plan_facts import Fact, motion_facts, smoothness_facts, torque_facts, torque_text
from framework.planning.remedies import plan_or_advise
from framework.planning.request import Request
from framework.planning.result import CrossingPlan
from framework.planning.saved import FILE, plan_document, read_document
from framework.singularity.points_on_path import search_path

if TYPE_CHECKING:
    from framework.fidelity.predicted_level import ChosenLevel

MOTION_FILE = "motion.csv"
LEAST_BEND = "least"  # value of --bend without a number
IMPROVING = "planning: best law so far {}; Ctrl-C ends the search for better ones"
FIGURES = ("robot", "law", "torques", "singularity", "wrench", "eye", "phase_plane", "vibrations")
FIGURE_FILES = tuple(f"{name}.{kind}" for name in FIGURES for kind in ("png", "pdf"))  # PDFs are one now
# files of a plan that a new plan in the same folder replaces, also those that the new one does not have
VIBRATION_FILES = ("vibrations.csv", "response.csv")  # of robots with springs
FILES = (MOTION_FILE, f"{MOTION_FILE}-metadata.json", "figures.pdf")  # of every plan
OF_A_PLAN = ("report.html", *FIGURE_FILES, *VIBRATION_FILES)

ROBUST = (
    "  robust            margin {0.margin:.1%}: {0.prediction.sentence}; {0.trial.passed} of "
    "{0.trial.runs} wrong robots passed"
)
COST = "  its cost          {:+.2%} of the duration, {:+.2%} of the peak torque, against no margin"
RAW_FILES = ("raw.csv", "raw_torques.pdf", "raw_torques.png")
RAW = "{0.name}: raw sampling, proves nothing: {1} samples, largest {2}"
SINGULAR = "  singular          t = {0.time:.9g} s, s = {0.s:.12g}, t_s . W_p = {0.wrench:.6g}"


def add_plan_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing plan`."""
    add_robot(parser)
    add_path(parser)
    group = parser.topic(MOTION)
    group.add_argument(
        "--in",
        dest="in_joints",
        nargs="+",
        metavar="JOINT",
        help="joints without motors, in whose positions --from, --via and --to are [rad, m]",
    )
    group.add_argument(
        "--to-mode",
        nargs="+",
        metavar="MOTOR",
        help="reach --to in another working mode, with the legs of these motors flipped",
    )
    add_flexibility(parser, auto="the least that is enough for 1 %%, kept by the scene or predicted")
    add_motion(parser)
    add_options(parser, "keep_limits")
    parser.topic(MOTION).add_argument(
        "--bend",
        nargs="?",
        const=LEAST_BEND,
        metavar="P",
        help="where no law can cross, bend the path as little as helps, at most 5%% of its length, ends "
        "kept, and say what larger bends need; or by this share of its length, such as 0.5%%",
    )
    robust = parser.topic("feedback")
    robust.add_argument(
        "--robust",
        nargs="+",
        metavar="NAME=P",
        help="leave the controller lqg a margin on the torque limits, as small as found, with which robots "
        "pass that differ by these shares, such as payload=10%% stiffness=20%% friction=5%%; say its cost",
    )
    robust.add_argument(
        "--sensors", nargs="+", metavar="NAME", help="that lqg reads, as in robustness (default: motors)"
    )
    add_out(parser, "write plan.json, motion.csv and figures there")
    parser.add_argument(
        "--samples",
        type=integer_between(MIN_ROWS, MAX_ROWS),
        metavar="N",
        help=f"rows of motion.csv (default: {DEFAULT_ROWS})",
    )
    add_rows(parser)
    add_number(parser, "--at", "T", "print torques and platform at these instants [s]", nargs="+")
    parser.add_argument(
        "--raw",
        action="store_true",
        help="no proof: sample the torques as they come, spikes included, to look at",
    )


def run_plan(options: Namespace) -> Report:
    """Plan; with --out write plan.json, motion.csv and figures, all or none."""
    level = arguments.take_level(options)
    robot, request = _request(options, arguments.load(options))
    options.warnings += remarks_on_bodies(robot)
    _check_options(options, level)
    arguments.check_rows(options)
    arguments.check_columns(options, robot)
    if options.at is not None and request.duration is not None:
        sample_times(request.duration, DEFAULT_ROWS, at=options.at)  # before the plan, which takes time
    if options.raw:
        with arguments.written_out(options, "raw.json", RAW_FILES) as folder:
            return report_raw(options, robot, request, folder)
    out = None if options.out is None else FilePath(options.out)
    replaced = "" if out is None else _describe_replaced(out)
    with arguments.written_out(options, FILE, FILES, OF_A_PLAN) as folder:
        plan, entries, lines = _make_plan(options, robot, request, level)
        document = plan_document(plan, out) | entries
        if folder is not None:
            options.progress.start("drawing the figures")
            from framework.show.plots import save_figures

            motion = arguments.motion_rows(options, plan)
            (folder / FILE).write_text(json_text(document))
            (folder / MOTION_FILE).write_text(motion.as_csv(), encoding="utf-8")
            metadata = folder / f"{MOTION_FILE}-metadata.json"
            metadata.write_text(motion.metadata(MOTION_FILE), encoding="utf-8")
            save_figures(plan, folder)
            _write_vibrations(plan, folder)
    if replaced:
        options.written += replaced
    instants = _instants(plan, options)
    table = [[f"{value:.6g}" for value in row.values()] for row in instants]
    rows = ["  " + "\t".join(row) for row in [[*instants[0]], *table]] if instants else []
    return document | ({"instants": instants} if instants else {}), [*plan_lines(plan), *lines, *rows]


def _instants(plan: CrossingPlan, options: Namespace) -> list[dict[str, float]]:
    """Return the columns of motion.csv at the instants of --at, a dictionary an instant.

    An instant beyond a duration that was found is refused beside the report of the plan.
    """
    if options.at is None:
        return []
    columns = ["time", "s", *(f"platform_{axis}" for axis in plan.robot.axis_names), "torque"]
    try:
        table = plan.samples(at=options.at, columns=options.columns or columns)
    except InvalidInput as error:
        options.refusal = error
        return []
    return [dict(zip(table.names, row, strict=True)) for row in table.rows.tolist()]


def _request(options: Namespace, robot: ParallelRobot) -> tuple[ParallelRobot, Request]:
    """Return the robot and the request, in the joints of --in or of the path to --to-mode, if any."""
    if options.in_joints is None and options.to_mode is None:
        return robot, arguments.request(options, robot)
    if options.scene is not None or (options.in_joints is not None and options.to_mode is not None):
        raise InvalidInput("--in, --to-mode: give one of them, with --from and --to, and no --scene")
    typed = arguments.motion_options(options, robot)  # with wrenches along the axes of the platform
    if options.in_joints is not None:
        selected = with_platform_joints(robot, options.in_joints)
        return selected, Request.of(selected, arguments.path(options, selected), **typed)
    if options.start is None or options.start != options.end or options.via:
        line = arguments.path(options, robot)
        ends = line(0.0), line(1.0)
    else:  # no line, but a flip that ends where it starts
        ends = (finite_numbers(f"--from ({', '.join(robot.axis_names)})", options.start, robot.n),) * 2
    to_joints = _find_path_to_mode(robot, *ends, options.to_mode)
    selected = with_platform_joints(robot, to_joints.joints)
    return selected, Request.of(selected, to_joints.path, **typed)


def _find_path_to_mode(robot: ParallelRobot, start: Array, goal: Array, motors: Sequence[str]) -> JointPath:
    """Find a path in joints from start to goal (n,), with the legs of motors flipped.

    Start and goal are platform coordinates. At the goal the other motors have the same positions as without
    the flip.
    """
    from framework.proofs.working_modes import working_modes  # takes time to import; other plans need none

    for motor in motors:
        check_choice("--to-mode", motor, robot.actuator_names)
    poses = [assemble(robot, x).q for x in (start, goal)]
    working = working_modes(robot, goal)
    modes = [mode.q for mode in working.modes if is_flip(robot, mode.q, poses[1], motors)]
    if not modes and working.are_all:
        raise InvalidInput(
            f"--to-mode: no pose at --to has just the legs of {', '.join(motors)} flipped; `crossing pose "
            f"{robot.name} --platform X.. --all` lists all"
        )
    return flip_legs(robot, poses[0], poses[1], motors, modes=modes)


def _check_options(options: Namespace, level: ChosenLevel | None) -> None:
    """Refuse options that contradict each other."""
    asks_for_rows = options.rate is not None or options.columns is not None
    if level is not None and (options.in_joints or options.to_mode):
        raise InvalidInput("--in, --to-mode: need a --flexibility other than auto").advising(
            {"flexibility": None}
        )
    if level is not None and options.bend is not None:
        raise InvalidInput(
            "--bend: the level of --flexibility auto is for the path as it is; leave one of them out"
        ).advising({"bend": None})
    if options.bend is not None and options.raw:
        raise InvalidInput("--bend: finds a plan with a proof; leave --raw out").advising({"raw": None})
    if options.robust and (options.raw or options.bend is not None):
        raise InvalidInput("--robust: of a plan with a proof, on the path as it is; leave --raw, --bend out")
    if options.sensors and not options.robust:
        raise InvalidInput("--sensors: of the controller that --robust asks for").advising({"sensors": None})
    if asks_for_rows and options.raw:
        raise InvalidInput("--rate, --columns: of a plan's rows; leave --raw out")
    if options.at is not None and options.raw:
        raise InvalidInput("--at: of a plan with a proof; leave --raw out").advising({"raw": None})
    if asks_for_rows and options.at is None and options.out is None:
        raise InvalidInput("--rate, --columns: of the rows that --out writes; give --out FOLDER")


def _describe_replaced(folder: FilePath) -> str:
    """Return a clause on the plan that --out replaces; empty without one."""
    with suppress(InvalidInput):
        saved = read_document(folder / FILE, "plan")
        if {"robot", "duration"} <= saved.keys():
            figures = " and its figures" * any((folder / name).exists() for name in FIGURE_FILES)
            return f", replaces the plan of {saved['robot']} over {saved['duration']} s{figures}"
    return ""


def _write_vibrations(plan: CrossingPlan, folder: FilePath) -> None:
    """Write natural frequencies and the response to torques along a path, with springs."""
    from framework.show.vibration_figures import path_vibrations

    on_path = path_vibrations(plan)
    if on_path is None:
        return
    s, result = on_path
    robot = plan.robot
    locked, free = (
        [f"{kind}_{k + 1}" for k in range(values.shape[1])]
        for kind, values in (("locked", result.natural), ("free", result.resonances))
    )
    heads = ["s", *locked, *free, "stiffness", *(f"softest_{axis}" for axis in result.axes)]
    rows = np.column_stack([s, result.natural, result.resonances, result.stiffness, result.softest])
    pairs = [f"{axis}_{motor}" for axis in robot.axis_names for motor in robot.actuator_names]
    response = result.response.reshape(-1, len(pairs))  # a row for each s and frequency
    over = [np.repeat(s, len(result.frequency)), np.tile(result.frequency, len(s))]
    columns = ["s", "frequency", *(f"gain_{pair}" for pair in pairs), *(f"phase_{pair}" for pair in pairs)]
    parts = [*over, np.abs(response), np.angle(response, deg=True)]
    tables = ((heads, rows), (columns, np.column_stack(parts)))
    for name, (names, table) in zip(VIBRATION_FILES, tables, strict=True):
        np.savetxt(folder / name, table, fmt="%.7g", delimiter=",", header=",".join(names), comments="")


def _make_plan(
    options: Namespace, robot: ParallelRobot, request: Request, level: ChosenLevel | None
) -> tuple[CrossingPlan, Document, list[str]]:
    """Plan; return the plan, and a document and lines on the level or the bend chosen.

    The level is that of --flexibility auto, the bend that of --bend.
    """
    bend = options.bend
    progress = options.progress
    progress.start("planning")
    if options.robust:
        return _plan_robustly(options, robot, request)
    if bend is None:
        with end_searches_by_ctrl_c(lambda words: progress.start(IMPROVING.format(words))):
            plan = plan_or_advise(robot, request)
        if level is None:
            return plan, {}, []
        return plan, {"fidelity": level._asdict()}, [f"  fidelity          {level.sentence}"]
    from framework.planning.path_modification import plan_request_with_modified_path  # most plans need none

    share = None if bend == LEAST_BEND else arguments.share("--bend", bend)
    modified = plan_request_with_modified_path(robot, request, bend=share)
    size = f"{1e3 * modified.moved:.3g} mm"
    if modified.turned:
        size += f" and {modified.turned:.3g} rad"
    bent = "not at all: it needs none"
    if modified.share:
        bent = f"by at most {size}, {100 * modified.share:.2g} % of its length, its ends kept; a spline now"
    facts = [Fact("path bent", bent)]
    for choice in modified.choices:
        peaks = torque_text(robot, choice.peak_torque, 4)
        facts.append(Fact(f"  --bend {100 * choice.share:.3g}%", f"peak torque {peaks}"))
    document = modified._asdict() | {"choices": [choice._asdict() for choice in modified.choices]}
    plan = document.pop("plan")
    return plan, {"bend": document}, [fact.line for fact in facts]


def _plan_robustly(
    options: Namespace, robot: ParallelRobot, request: Request
) -> tuple[CrossingPlan, Document, list[str]]:
    """Plan with the margin that --robust finds; return also its document and lines."""
    from framework.control.robust_plan import plan_robustly
    from framework.control.sensors import ControlLoop
    from framework.control.variations import Spread

    shares = dict.fromkeys(("payload", "stiffness", "friction"), 0.0)
    for word in options.robust:
        name, _, size = word.partition("=")
        check_choice("--robust", name, shares)
        shares[name] = arguments.share(f"--robust {name}", size)
    if request.margin:
        raise InvalidInput("--margin: --robust finds it; leave one of them out").advising({"margin": None})
    robust = plan_robustly(
        lambda margin: plan_or_advise(robot, replace(request, margin=margin)),
        Spread(**shares),
        loop=ControlLoop(sensors=" ".join(options.sensors or ["motors"])),
    )
    plan, unguarded = robust.plan, robust.unguarded
    longer = plan.duration / unguarded.duration - 1
    torque = max(plan.peak_torque.values()) / max(unguarded.peak_torque.values()) - 1
    document = {
        "margin": robust.margin,
        "spread": shares,
        "predicted": asdict(robust.prediction),
        "tried": robust.trial._asdict(),
        "duration_without": unguarded.duration,
        "peak_torque_without": unguarded.peak_torque,
    }
    lines = [ROBUST.format(robust), COST.format(longer, torque)] if robust.margin else [ROBUST.format(robust)]
    return plan, {"robust": document}, lines


def _bound_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the fact on the bound of all laws, or why none is known.

    Empty for polynomials.
    """
    best = plan.optimality
    if best is None:
        return []
    from framework.planning.optimal.peak_bound import bound_plan, explain_missing_bound  # of these alone

    bound = bound_plan(plan)
    if bound is None:
        return [Fact("bound", f"none is known for {explain_missing_bound(plan)}")]
    if best.specification.goal == "time":
        cost = plan.duration
        least = f"takes less than {bound.value:.4g} s"
    else:
        cost = max_torque_ratio(plan, best.reference)
        peaks = torque_facts(plan.robot, bound.value * best.reference, 4)
        least = f"has a peak below {peaks[best.reference.argmax()].text}"
    ratio = cost / bound.value
    above = f"{100 * (ratio - 1):z.1f} % more" if ratio < 10 else f"{ratio:.0f} times as much"
    uncounted_limits = ["required times"] * bool(best.specification.times)
    uncounted_limits += ["torque-speed curves and RMS torques"] * (best.specification.drives is not None)
    uncounted = f"; {' and '.join(uncounted_limits)} are not counted" if uncounted_limits else ""
    return [Fact("bound", f"no law {least}, this one {above}{uncounted}")]


def plan_lines(plan: CrossingPlan) -> list[str]:
    """Return the report on a plan, in words."""
    robot = plan.robot
    law = f"law of degree {plan.law.degree}" if plan.law.kind == Law.kind else f"{plan.law.kind} law"
    law = plan.reason if plan.is_chain else law
    head = f"{robot.name}, {robot.flexibility}, {plan.geometry} geometry: {law} over {plan.duration:g} s"
    reason = [] if plan.is_chain else [Fact("law", plan.reason)]
    facts = [*reason, *smoothness_facts(plan), *_bound_facts(plan), *motion_facts(plan)]
    return [head, *(fact.line for fact in facts)]


def report_raw(options: Namespace, robot: ParallelRobot, request: Request, folder: FilePath | None) -> Report:
    """Report raw samples of the torques of a law that is not proved.

    Raises:
        InvalidInput: the optimal law or --keep-limits is requested; both need a proof.
    """
    no_raw = {"raw": None}
    if request.kind == "optimal":
        raise InvalidInput(
            "--raw samples the polynomial law only, which needs no proof to be chosen"
        ).advising(no_raw)
    if request.keep_limits:
        raise InvalidInput(
            "--keep-limits: is for a plan, and --raw proves none; leave one of them out"
        ).advising(no_raw)
    searched = search_path(robot, request.path).under(request.external_wrenches)
    law, crossings = law_before_proof(searched, request)
    raw = finite_difference_torques(
        robot,
        request.path,
        law,
        samples=options.samples or DEFAULT_ROWS,
        geometry=request.geometry,
        branch=searched.branch,
    )
    largest = dict(zip(robot.actuator_names, np.abs(raw.torque).max(axis=0), strict=True))
    document = {
        "robot": robot.name,
        "raw": True,
        "proved": False,
        "samples": len(raw.time),
        # a sample at the singular instant can be infinite, which becomes null in JSON
        "largest_sample": largest,
        "crossings": [select_fields(each, "s", "time", "wrench") for each in crossings],
    }
    if folder is not None:
        from framework.show.plots import plot_raw_torques, save_figure

        rows = np.column_stack([raw.time, raw.motor_angle, raw.torque, raw.deflection])
        motors, springs = robot.actuator_names, robot.elastic_names
        names = {"motor_angle": motors, "torque": motors, "deflection": springs}
        write_csv(folder / "raw.csv", names, rows)
        (folder / "raw.json").write_text(json_text(document))
        poles = [crossing.time for crossing in crossings]
        save_figure(lambda: plot_raw_torques(raw, robot, poles), folder / "raw_torques")
    head = RAW.format(robot, len(raw.time), torque_text(robot, largest))
    return document, [head, *map(SINGULAR.format, crossings)]
