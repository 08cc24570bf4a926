"""`crossing fidelity` and `crossing capacity`: the least model for a motion, and its largest load."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import Report, add_motion, add_out, add_path, add_path_and_motion, add_robot
from framework.fidelity.capacity import Capacity, capacity_request, largest_load_of
from framework.fidelity.fidelity_study import ERROR_ROUNDING, FidelityStudy, fidelity_study
from framework.fidelity.model_comparison import Comparison
from framework.fidelity.predicted_level import format_percent
from framework.model.description import LEVELS
from framework.numerics.arrays import Array
from framework.numerics.output import Document, json_text, select_fields
from framework.planning.options import LIMITS
from framework.planning.plan_facts import torque_text

STUDY_FILE = "fidelity.json"

HEAD = """\
{0.robot.name}: {1} levels judged to {2} of the path, {0.length:.4g} m in {0.highest.duration:g} s, and of \
the peak torque; {0.seconds:.2g} s
  level\tplan\ttorque\tplatform\tlaw\tdeflection\tpredicted\tby"""

GROWTH = (
    "  growth            errors grow e-fold every {:.2g} s, {:.2g} times in the motion: weight and torques "
    "carry the platform away, {}"
)
FRICTION = "  in no level       dry friction of {}: {} of the motors' work"
TO_KEEP = "  to keep           fidelity: {{level: {level}, tolerance: {tolerance:g}}}"
BY_LUCK = "  by luck           {} leaves out errors that cancel: {}, which model more, {} not enough"


def add_fidelity_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing fidelity`."""
    add_robot(parser)
    add_path(parser)
    parser.topic(LIMITS).add_argument(
        "--tolerance",
        default="1%",
        metavar="P",
        help="errors that are small enough, a share such as 1%% or 0.01 (default: 1%%)",
    )
    add_motion(parser)
    add_out(parser, "write fidelity.json and a figure of the errors there")


def run_fidelity(options: Namespace) -> Report:
    """Compare all levels; with --out write numbers and a figure."""
    with arguments.written_out(options, STUDY_FILE, ("fidelity.pdf", "fidelity.png")) as folder:
        study, document, lines = _report_study(options)
        if folder is not None:
            from framework.show.plots import save_figure
            from framework.show.study_figures import plot_fidelity

            options.progress.start("drawing the figure")
            (folder / STUDY_FILE).write_text(json_text(document))
            save_figure(lambda: plot_fidelity(study), folder / "fidelity")
    return document, lines


def _report_study(options: Namespace) -> tuple[FidelityStudy, Document, list[str]]:
    """Study all levels; return the study, its document and its report.

    The report ends with the line to add to a scene.
    """
    robot = arguments.load(options)
    tolerance = arguments.share("--tolerance", options.tolerance)
    path = arguments.path(options, robot)
    typed = arguments.motion_options(options, robot)
    progress = options.progress.start("planning and simulating", len(LEVELS), "levels")
    study = fidelity_study(robot, options.scene or path, tolerance=tolerance, progress=progress, **typed)
    options.refusal = study.refusal
    document = study.to_dict()
    lines = fidelity_lines(study)
    entry = study.scene_entry
    if entry is not None and options.scene is not None and not typed:
        document["fidelity"] = entry
        lines.append(TO_KEEP.format_map(entry))
    return study, document, lines


def fidelity_lines(study: FidelityStudy) -> list[str]:
    """Return the report on a study, in words."""
    plan = study.highest
    places = ", ".join(f"{crossing.s:.6g}" for crossing in plan.crossings)
    lines = [HEAD.format(study, len(study.levels), _format_percent(study.tolerance))]
    lines += [_format_row(study, comparison) for comparison in study.levels]
    for comparison in study.levels:
        notes = (comparison.same_as and f"the same torques as {comparison.same_as}", comparison.reason)
        lines += [f"  remark            {comparison.level.name}: {note}" for note in notes if note]
    lines.append(f"  crossing          s = {places}" if places else "  crossing          none")
    if study.fall >= 1.0:
        judged = "so the motors have controllers" if study.has_control else "and nothing corrects them"
        lines.append(GROWTH.format(plan.duration / study.fall, study.fall, judged))
    if study.neglected_work:
        lines.append(FRICTION.format(plan.neglected_friction, _format_percent(study.neglected_work)))
    lines += [f"  in no level       {what}" for what in study.robot.description.left_out]
    if study.enough is None:
        return lines
    name = study.enough.level.name
    torque = _largest_error(study, study.enough.torque_error)
    platform = _largest_error(study, study.enough.platform_error)
    lines.append(f"  enough            {name}: torques off by {torque}, platform by {platform}")
    if study.by_luck:
        are = "are" if len(study.by_luck) > 1 else "is"
        lines.append(BY_LUCK.format(name, ", ".join(study.by_luck), are))
    return [*lines, f"  predicted         {study.indicated.level.name}, by the indicators alone"]


def _format_row(study: FidelityStudy, comparison: Comparison) -> str:
    """Return the row of the table for one level."""
    same_law = 1e-12  # difference in s of two laws that is rounding
    name = comparison.level.name
    indicators = study.indicators
    plan = torque = law = deflection = "-"
    if comparison.motion is not None:
        plan = f"{1e3 * comparison.seconds:.0f} ms"
        torque = _format_percent(comparison.torque)
        difference = study.law_difference(comparison)
        law = "same" if difference <= same_law else f"{difference:.1e}"
        if comparison.deflection is not None:
            deflection = "{} {:.2g}".format(*comparison.deflection)
    platform, predicted = map(_format_percent, (comparison.platform, indicators.error[name]))
    cells = (f"  {name}", plan, torque, platform, law, deflection, predicted, indicators.words[name])
    return "\t".join(cells)


def _format_percent(share: float) -> str:
    """Format a share in per cent, with rounding errors as 0."""
    largest = 10.0  # error from which on > 1000 % is printed
    if not np.isfinite(share):
        return "-"
    if share >= largest:
        return "> 1000 %"
    return format_percent(share if share >= ERROR_ROUNDING else 0.0)


def _largest_error(study: FidelityStudy, errors: Array) -> str:
    """State the largest error, and where on the path this is."""
    place = study.place(errors)
    return _format_percent(np.nanmax(errors)) + ("" if place is None else f" (at s = {place:.4g})")


# ------------------------------------------------------------------ crossing capacity

CAPACITY = """\
{0.plan.robot.name}, {0.plan.robot.flexibility}: {0.multiple:.6g} times the wrench is planned, over \
{0.plan.duration:.6g} s
  peak torque       {1}"""
REFUSED = "  {1:16s}  {0.refused:.6g} times: {0.refusal}"
IMPOSSIBLE = "  no law, proved    with {0.impossible:.6g} times{1}"
UNDECIDED = "  undecided         {0.undecided:.6g} times: {0.failure}"
UNBOUND = "  binds             nothing refused up to {0.multiple:.6g} times"


def add_capacity_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing capacity`."""
    add_robot(parser)
    add_path_and_motion(parser)


def run_capacity(options: Namespace) -> Report:
    """Report the largest planned multiple, and why a larger one is refused."""
    robot = arguments.load(options)
    path = arguments.path(options, robot)
    request = capacity_request(robot, path, **arguments.options_with_wrenches(options, robot))
    progress = options.progress.start("planning with multiples of the wrench", unit="plans")
    capacity = largest_load_of(robot, request, progress=progress)
    if capacity.multiple == 0.0:
        options.refusal = capacity.refusal or capacity.failure
    plan = capacity.plan
    document = {
        "robot": plan.robot.name,
        "flexibility": plan.robot.flexibility,
        **select_fields(capacity, "multiple", "refused", "proved", "impossible", "undecided"),
        "binds": capacity.refusal and str(capacity.refusal),
        "failure": capacity.failure and str(capacity.failure),
        "wrenches": plan.request.wrenches,
        "duration": plan.duration,
        "peak_torque": plan.peak_torque,
    }
    return document, capacity_lines(capacity)


def capacity_lines(capacity: Capacity) -> list[str]:
    """Return the report on a capacity, in words."""
    robot = capacity.plan.robot
    lines = [CAPACITY.format(capacity, torque_text(robot, capacity.plan.peak_torque))]
    if capacity.refusal is not None:
        lines.append(REFUSED.format(capacity, "refused, proved" if capacity.proved else "refused"))
    if np.isfinite(capacity.impossible):
        lines.append(IMPOSSIBLE.format(capacity, "" if robot.is_damped else " and more"))
    if capacity.failure is not None:
        lines.append(UNDECIDED.format(capacity))
    if not np.isfinite(capacity.end):
        lines.append(UNBOUND.format(capacity))
    return lines
