"""`crossing transmission`: a linkage as a transmission, in numbers and three pictures."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from framework.atlas.transmission import AMPLITUDE, FREQUENCIES, LinkageTransmission, transmission
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import Report, add_number, add_out, add_robot, integer_between
from framework.numerics.output import Document, json_text

FILE = "transmission.json"
PARTS = ("carried", "links", "rotors", "inertia")
FIGURES = ("inertia", "limits", "mapping")  # and their ends .pdf and .png
HEAD = "{robot}: {poses} poses, {unreached} of the ranges not reached or singular; posture {posture}"
ERROR_HEAD = (
    f"  error [N m, N] of tau_joint = G^T tau_motor in a sine of {AMPLITUDE} about the posture, on its axis"
)


def add_transmission_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing transmission`."""
    add_robot(parser)
    group = parser.topic("where")
    for flag, text in (
        ("--lower", "least platform coordinates (default: limits of the platform's joints)"),
        ("--upper", "largest platform coordinates"),
        ("--posture", "of the constant armature and the sines (default: the reference)"),
    ):
        add_number(group, flag, "X", f"{text} [rad, m]", nargs="+")
    add_number(group, "--frequencies", "F", "of the sines [Hz] (default: 1 2 4 8)", nargs="+")
    group.add_argument(
        "--points",
        type=integer_between(2, 1000),
        metavar="N",
        help="poses along each axis (default: 81 of one axis, 25 of two, else 7)",
    )
    add_out(parser, f"write {FILE} and three pictures there")


def run_transmission(options: Namespace) -> Report:
    """Compute the transmission; with --out write file and pictures."""
    options.flexibility = "rigid"
    robot = arguments.load(options)
    names = tuple(f"{name}.{end}" for name in FIGURES for end in ("pdf", "png"))
    with arguments.written_out(options, FILE, names) as folder:
        options.progress.start("computing")
        result = transmission(
            robot,
            lower=options.lower,
            upper=options.upper,
            posture=options.posture,
            frequencies=options.frequencies or FREQUENCIES,
            points=options.points,
        )
        document = _make_document(result)
        if folder is not None:
            from framework.show.plots import save_figure
            from framework.show.transmission_figures import plot_inertia, plot_limits, plot_mapping

            options.progress.start("drawing the figures")
            (folder / FILE).write_text(json_text(document))
            for name, draw in zip(FIGURES, (plot_inertia, plot_limits, plot_mapping), strict=True):
                save_figure(lambda draw=draw: draw(result), folder / name)  # type: ignore[misc]
    return document, _format(document, robot.place(result.posture))


def _make_document(result: LinkageTransmission) -> Document:
    """Return the transmission as a document: ranges over the poses, by axis of the platform."""
    robot = result.robot
    limits = {"torque": result.axis_limits("wrenches"), "speed": result.axis_limits("speeds")}
    values = {part: np.einsum("pkk->pk", getattr(result, part)) for part in (*PARTS, "damping")}
    values |= {part: getattr(result, part) for part in ("friction", "play", "springs")}
    values |= {"gear": np.linalg.norm(result.gear, axis=1), "backlash_gain": result.backlash}
    axes: dict[str, Document] = {}
    for k, name in enumerate(robot.axis_names):
        axes[name] = {part: _range(value[:, k]) for part, value in values.items()}
        axes[name] |= {
            kind: None if ends is None else [_range(ends[:, end, k]) for end in (0, 1)]
            for kind, ends in limits.items()
        }
        axes[name]["armature"] = result.armature[k, k]
    return {
        "robot": robot.name,
        "poses": len(result.x),
        "unreached": result.unreached,
        "posture": dict(zip(robot.axis_names, result.posture, strict=True)),
        "axes": axes,
        "armature": result.armature,
        "errors": [{key: getattr(error, key) for key in error._fields} for error in result.errors],
    }


def _range(values: np.ndarray) -> list[float]:
    """Return least and largest of values."""
    return [float(values.min()), float(values.max())]


AXIS = """\
  {name}
    inertia [kg m^2, kg]  carried body {carried}, cranks and rods {links}, rotors {rotors}
    motors' angles        {gear} per unit of the axis; constant armature at the posture {armature:.4g}
    torque [N m, N]       least {torque[0]}, largest {torque[1]}
    speed [rad/s, m/s]    largest {speed[1]}
    reflected             dry friction {friction}; a play of 1 in all motors' joints moves it by \
{backlash_gain}\
{play}{held}"""
NO_ROTORS = (
    "  without rotors        the file states neither rotor inertia of the motors nor armature of their joints"
)
PLAY = "\n    play                  {} with motors at rest, by the backlash in the robot file"
HELD = "\n    springs and dampers   motors hold {springs} at rest [N m, N]; damping {damping} [N m s, N s/m]"
ROW = (
    "    {axis}\t{frequency:g} Hz\t{nothing_known:.3g}\t{constant_armature:.3g}\t{own_armature:.3g}"
    "\t{own_springs:.3g}\t{carried:.3g}"
)
COLUMNS = (
    "    axis\tsine\tnothing known\tconstant armature\tarmature of the pose"
    "\twith springs, dampers\tcarried body needs"
)


def _format(document: Document, posture: str) -> list[str]:
    """Return the report in words, with its posture in words."""
    lines = [HEAD.format_map(document | {"posture": posture})]
    for name, axis in document["axes"].items():
        words = {key: _words(value) for key, value in axis.items() if key != "armature"}
        words["play"] = PLAY.format(words["play"]) if axis["play"][1] else ""
        words["held"] = HELD.format_map(words) if any(axis["springs"] + axis["damping"]) else ""
        lines.append(AXIS.format_map({"name": name, "armature": axis["armature"], **words}))
    if not np.any(document["armature"]):
        lines.append(NO_ROTORS)
    lines += [ERROR_HEAD, COLUMNS]
    names = list(document["axes"])
    for error in document["errors"]:
        own = names.index(error["axis"])
        values = {key: value[own] for key, value in error.items() if key not in ("axis", "frequency")}
        lines.append(ROW.format_map(error | values))
    return lines


def _words(value: list[float] | list[list[float]] | None) -> str | list[str]:
    """Return a range in words, or a list of ranges; `not limited` for None."""
    if value is None:
        return ["not limited", "not limited"]
    if isinstance(value[0], list):
        return [str(_words(one)) for one in value]
    return f"{value[0]:.4g} .. {value[1]:.4g}"
