"""`crossing plan`: a motion through the singular points, with torques and proof."""

from __future__ import annotations

import os
from argparse import Namespace
from contextlib import nullcontext, suppress
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from framework.cli import arguments
from framework.cli.locate import twist_text
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_motion,
    add_options,
    add_out,
    add_path,
    add_robot,
    add_rows,
    command,
    integer_between,
)
from framework.crossing.motion_table import DEFAULT_ROWS, MotionTable
from framework.crossing.neglected_effects import NeglectedEffect
from framework.crossing.optimal.peak_bound import bound_plan
from framework.crossing.options import MOTION
from framework.crossing.path_modification import plan_request_with_modified_path
from framework.crossing.plan import (
    ADVANCES,
    NEARLY_STOPS,
    law_before_proof,
    max_torque_ratio,
    plan_request,
)
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.crossing.saved import FILE, plan_document, read_document
from framework.dynamics.finite_differences import finite_difference_torques
from framework.errors import InvalidInput, point
from framework.kinematics.diagnostics.diagnosis import remarks_on_bodies
from framework.kinematics.idle_turns import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.law import Law
from framework.motion.optimal_law import OptimalLaw
from framework.output import Document, json_text, write_csv, written_together
from framework.singularity.points_on_path import search_path

if TYPE_CHECKING:
    from framework.fidelity.chosen_level import ChosenLevel

MOTION_FILE = "motion.csv"
NOTABLE_END_SPEED = 1e-6  # of the largest motor speed, that motors have at the ends: worth a line
LEAST_BEND = "least"  # --bend without a value
MAX_SAMPLES = 1_000_000
FIGURES = ("robot", "law", "torques", "singularity", "wrench", "eye", "phase_plane")
# about a plan that another one replaces: its report, figures that not every plan has, and PDFs now in one
OF_A_PLAN = ("report.html", *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")))

CROSSING = """\
  crossing          t = {0.time:.6g} s at s = {0.s:.15f}, {place}
                    t_s = {twist}, s' = {0.speed:.6g} 1/s, s" = {acceleration:.6g} 1/s2, |t_s . W_p| \
{0.residual:.1e} of its peak"""
LOADED = " " * 20 + "singular under its loads at s = {0.s:.9f}, {0.distance:.2g} {1} from there"
SINGULAR = "  singular          t = {0.time:.9g} s, s = {0.s:.12g}, t_s . W_p = {0.wrench:.6g}"
CERTIFICATE = (
    "  certificate       tail {0.tail:.1e} on {0.nodes} nodes, {0.passes} {passes}{settled}, loops closed to "
    "{0.max_closure_error:.1e}, joints in balance to {0.max_residual_torque:.1e} N m or N"
)


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "plan", run)
    add_robot(parser)
    add_path(parser)
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
    add_out(parser, "write plan.json, motion.csv and figures there")
    parser.add_argument(
        "--samples",
        type=integer_between(2, MAX_SAMPLES),
        metavar="N",
        help=f"rows of motion.csv (default: {DEFAULT_ROWS})",
    )
    add_rows(parser)
    parser.add_argument(
        "--raw",
        action="store_true",
        help="no proof: sample the torques as they come, spikes included, to look at",
    )


def run(options: Namespace) -> Report:
    """Plan, and with --out write plan.json, motion.csv and figures, all or nothing."""
    level = arguments.take_level(options)
    robot = arguments.load(options)
    request = arguments.request(options, robot)
    options.warnings += remarks_on_bodies(robot)
    if level is not None and options.bend is not None:
        raise InvalidInput(
            "--bend: the level of --flexibility auto is for the path as it is; leave one of them out"
        ).advising({"bend": None})
    if options.bend is not None and options.raw:
        raise InvalidInput("--bend: finds a plan with a proof; leave --raw out").advising({"raw": None})
    out = None if options.out is None else FilePath(options.out)
    if options.raw:
        writing = nullcontext() if out is None else written_together(out, document="raw.json")
        with writing as folder:
            return report_raw(options, robot, request, folder)
    if out is None:
        if options.rate is not None or options.columns is not None:
            raise InvalidInput("--rate, --columns: of the rows that --out writes; give --out FOLDER")
        plan, entries, lines = _make_plan(robot, request, level, options.bend)
        return plan_document(plan) | entries, plan_text(plan) + lines
    replaced, present = _describe_replaced(out), [name for name in OF_A_PLAN if os.path.isfile(out / name)]
    with written_together(out, document=FILE, beside=OF_A_PLAN) as folder:
        plan, entries, lines = _make_plan(robot, request, level, options.bend)
        options.progress.start("drawing the figures")
        document = plan_document(plan, out) | entries
        _write_plan(plan, document, arguments.motion_rows(options, plan), folder)
    removed = [name for name in present if not os.path.exists(out / name)]
    replaced += f"; {', '.join(removed)} of that is removed" * bool(removed)
    options.written = f"{out}{replaced}"
    return document, plan_text(plan) + lines


def _describe_replaced(folder: FilePath) -> str:
    """Return the plan that --out replaces, as the end of a sentence; empty without one."""
    with suppress(InvalidInput):
        saved = read_document(folder / FILE, "plan")
        if {"robot", "duration"} <= saved.keys():
            return f", replaces the plan of {saved['robot']} over {saved['duration']} s"
    return ""


def _write_plan(plan: CrossingPlan, document: Document, motion: MotionTable, folder: FilePath) -> None:
    """Write plan.json, motion.csv with its metadata, and figures."""
    from framework.show.plots import save_figures

    (folder / FILE).write_text(json_text(document))
    (folder / MOTION_FILE).write_text(motion.as_csv(), encoding="utf-8")
    (folder / f"{MOTION_FILE}-metadata.json").write_text(motion.metadata(MOTION_FILE), encoding="utf-8")
    save_figures(plan, folder)


def _make_plan(
    robot: ParallelRobot, request: Request, level: ChosenLevel | None, bend: str | None
) -> tuple[CrossingPlan, Document, str]:
    """Plan; return also a document and a line on the level of --flexibility auto or the bend of --bend."""
    if level is not None:
        line = f"\n  fidelity          {level.sentence}"
        return plan_request(robot, request), {"fidelity": level._asdict()}, line
    if bend is None:
        return plan_request(robot, request), {}, ""
    share = None if bend == LEAST_BEND else arguments.share("--bend", bend)
    modified = plan_request_with_modified_path(robot, request, bend=share)
    size = f"{1e3 * modified.moved:.3g} mm" + f" and {modified.turned:.3g} rad" * bool(modified.turned)
    sentence = f"by at most {size}, {100 * modified.share:.2g} % of its length, its ends kept; a spline now"
    line = f"\n  path bent         {sentence if modified.share else 'not at all: it needs none'}"
    for choice in modified.choices:
        peaks = arguments.peaks(robot, choice.peak_torque, 4)
        line += f"\n    --bend {100 * choice.share:.3g}%".ljust(19) + f" peak torque {peaks}"
    entry = {key: getattr(modified, key) for key in ("moved", "turned", "share")}
    choices = [choice._asdict() for choice in modified.choices]
    return modified.plan, {"bend": {**entry, "choices": choices}}, line


def _describe_bound(plan: CrossingPlan) -> list[str]:
    """Return a line on the bound of all laws and the plan's gap to the bound, if any."""
    best = plan.optimality
    bound = None if best is None else bound_plan(plan)
    if bound is None or best is None:
        return []
    if best.specification.goal == "time":
        cost, least = plan.duration, f"takes less than {bound.value:.4g} s"
    else:
        cost = max_torque_ratio(plan, best.reference)
        motor = best.reference.argmax()
        peak = f"{bound.value * best.reference[motor]:.4g} {plan.robot.torque_units[motor]}"
        least = f"has a peak below {peak}"
    over = cost / bound.value - 1.0
    return [f"  bound             no law {least}, this one {100 * over:.1f} % more"]


def _describe_smoothness(plan: CrossingPlan) -> list[str]:
    """Return a line on an optimal law's gap to the least cost found, and on the turns of its speed."""
    if plan.optimality is None or not isinstance(plan.law, OptimalLaw):
        return []
    goal = plan.optimality.specification.goal.replace("_", " ")
    over = f"{100 * plan.optimality.gap:.2g} % above the least {goal} found"
    times = f"{plan.law.turns} time" + "s" * (plan.law.turns != 1)
    return [f"  smoothed          {over}; its speed turns {times}"]


def plan_text(plan: CrossingPlan) -> str:
    """Return the report on a plan, in words."""
    robot = plan.robot
    law = f"law of degree {plan.law.degree}" if plan.law.kind == Law.kind else f"{plan.law.kind} law"
    lines = [f"{robot.name}, {robot.flexibility}, {plan.geometry} geometry: {law} over {plan.duration:g} s"]
    chosen = plan.request.kind == "auto" and plan.reason != ADVANCES
    if plan.law.kind != Law.kind or chosen or NEARLY_STOPS in plan.reason:
        lines.append(f"  law               {plan.reason}")
    lines += [*_describe_smoothness(plan), *_describe_bound(plan), *_wrenches(plan), *_crossings(plan)]
    lines.append(f"  peak torque       {arguments.peaks(robot, plan.peak_torque)}")
    return "\n".join([*lines, *_certificate(plan), *_warnings(plan)])


def _wrenches(plan: CrossingPlan) -> list[str]:
    """Return a line for each wrench of the world."""
    lines = []
    for wrench in plan.dynamics.wrenches.entries:
        axes = f"axes of {'the frame' if wrench.turns else 'the base'}"
        if wrench.rows.ndim == 1:
            force, moment = point(wrench.rows[:3]), point(wrench.rows[3:])
            values = f"force {force} N, moment {moment} N m"
        else:
            values = f"a table of {len(wrench.rows)} rows over s"
        lines.append(f"  wrench            on {wrench.frame}: {values}, {axes}")
    return lines


def _crossings(plan: CrossingPlan) -> list[str]:
    """Return lines for each crossing: place, twist, speed, and its shift under loads."""
    robot, lines = plan.robot, []
    for crossing, loaded in zip(plan.crossings, plan.loaded_points, strict=True):
        words = {
            "place": robot.place(crossing.platform),
            "twist": twist_text(robot, crossing.twist),
            "acceleration": round(crossing.acceleration, 9) + 0.0,
        }
        lines.append(CROSSING.format(crossing, **words))
        if loaded is not None:
            unit = "m" if robot.translations.any() else "rad"
            lines.append(LOADED.format(loaded, unit))
    return lines or ["  crossing          none"]


def _certificate(plan: CrossingPlan) -> list[str]:
    """Return the certificate in lines, with idle turns and open loops of robots that have some."""
    robot, certificate = plan.robot, plan.certificate
    settled = ""
    if robot.n_e and plan.geometry == "deformed":
        settled = f", deflections settled to {certificate.change:.1e}"
    passes = "pass" if certificate.passes == 1 else "passes"
    lines = [CERTIFICATE.format(certificate, passes=passes, settled=settled)]
    if certificate.max_held_torque:
        lines.append(
            f"  idle turns        {_idle_turns(robot)}; what nothing holds there: "
            f"{certificate.max_held_torque:.1e} N m or N"
        )
    if certificate.rounded_gap:
        gap = certificate.rounded_gap
        lines.append(f"  rounded           loops that repeat others stay open by {gap:.1e} m or rad")
    return lines


def _warnings(plan: CrossingPlan) -> list[str]:
    """Return lines on effects left out, limits exceeded and a law that overshoots."""
    lines = [f"  left out          {_describe_neglected(plan, effect)}" for effect in plan.neglected]
    if any((effect.share or 0.0) > 1.0 for effect in plan.neglected):
        lines.append(
            "  warning           what is left out is worth more than the plan's own torques: plan with it, "
            "--flexibility, or more gently, a higher --smoothness or a longer duration"
        )
    lines += arguments.excesses(plan.exceeded)
    if plan.certificate.end_speed > NOTABLE_END_SPEED:
        lines.append(
            f"  warning           the motors start and stop with {plan.certificate.end_speed:.1e} of their "
            f"largest speed: the springs carry inertia; a higher --smoothness mends it"
        )
    if not plan.certificate.monotone:
        s = plan.law(np.linspace(0.0, plan.duration, 2001))
        lines.append(
            f"  warning           the law overshoots its ends (s from {s.min():.6g} to {s.max():.6g}); other "
            f"times or speeds, or a higher --smoothness, avoid it"
        )
    return lines


def _describe_neglected(plan: CrossingPlan, neglected: NeglectedEffect) -> str:
    """Return an effect that a plan leaves out, with its torque, in words."""
    if neglected.torque is None or neglected.share is None:
        return neglected.effect
    robot = plan.robot
    motor = robot.actuator_names.index(neglected.motor) if neglected.motor else 0
    joint = f" at {neglected.motor}" if neglected.motor else ""
    share = f"{neglected.share:.2g} times" if neglected.share > 1.0 else f"{100 * neglected.share:.2g} % of"
    return (
        f"{neglected.effect}: worth {neglected.torque:.2g} {robot.torque_units[motor]}{joint}, "
        f"{share} the largest"
    )


def _idle_turns(robot: ParallelRobot) -> str:
    """Return the idle turns held still, and the ones that balls drive, in words."""
    driven = driven_turns(robot)
    kinds = {
        "held still": np.setdiff1d(robot.structure.idle, driven),
        "as damping or armature of their balls drives them": driven,
    }
    names = {kind: ", ".join(map(robot.coordinates.name_of, columns)) for kind, columns in kinds.items()}
    return "; ".join(f"{joints} {kind}" for kind, joints in names.items() if joints)


def report_raw(
    options: Namespace,
    robot: ParallelRobot,
    request: Request,
    folder: FilePath | None,
) -> Report:
    """Report the law without its proof: raw samples of its torques.

    Raises:
        InvalidInput: the optimal law is asked for, which is nothing without its proof.
    """
    if options.rate is not None or options.columns is not None:
        raise InvalidInput("--rate, --columns: of a plan's rows; leave --raw out")
    samples = options.samples or DEFAULT_ROWS
    if request.kind == "optimal":
        raise InvalidInput(
            "--raw samples the polynomial law only, which needs no proof to be chosen"
        ).advising({"raw": None})
    if request.keep_limits:
        raise InvalidInput(
            "--keep-limits: is for a plan, and --raw proves none; leave one of them out"
        ).advising({"raw": None})
    searched = search_path(robot, request.path).under(request.external_wrenches)
    law, crossings = law_before_proof(searched, request)
    raw = finite_difference_torques(
        robot,
        request.path,
        law,
        samples=samples,
        geometry=request.geometry,
        branch=searched.branch,
    )
    largest = dict(zip(robot.actuator_names, np.abs(raw.torque).max(axis=0), strict=True))
    document = {
        "robot": robot.name,
        "raw": True,
        "proved": False,
        "samples": samples,
        # a sample at the singular instant itself can be infinite, for which JSON has no number
        "largest_sample": largest,
        "crossings": [{key: getattr(each, key) for key in ("s", "time", "wrench")} for each in crossings],
    }
    if folder is not None:
        _write_raw(raw, robot, [crossing.time for crossing in crossings], document, folder)
    lines = [
        f"{robot.name}: raw sampling, proves nothing: {samples} samples, largest "
        + arguments.peaks(robot, largest)
    ]
    lines += [SINGULAR.format(crossing) for crossing in crossings]
    return document, "\n".join(lines)


def _write_raw(
    raw: Any, robot: ParallelRobot, poles: list[float], document: Document, folder: FilePath
) -> None:
    """Write raw samples of the torques: table, document and figure."""
    from framework.show.plots import plot_raw_torques, save

    rows = np.column_stack([raw.time, raw.motor_angle, raw.torque, raw.deflection])
    motors, springs = robot.actuator_names, robot.elastic_names
    write_csv(folder / "raw.csv", {"motor_angle": motors, "torque": motors, "deflection": springs}, rows)
    (folder / "raw.json").write_text(json_text(document))
    save(lambda: plot_raw_torques(raw, robot, poles), folder / "raw_torques")
