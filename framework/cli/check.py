"""`crossing check`: what kind of mechanism a file describes, and what is wrong with it."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.parser import Report, add_flexibility, add_missing_fields, add_robot, command
from framework.errors import InvalidInput, NotAssembled, point
from framework.kinematics.diagnostics.diagnosis import check_robot, reference_in_words


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "check", run)
    add_robot(parser, "catalogue name, or path of a robot file or of a file of a foreign dialect")
    add_missing_fields(parser)
    add_flexibility(parser)


def run(options: argparse.Namespace) -> Report:
    """Examine a robot and report its mobility, its masses, its pose and advice."""
    mechanism = arguments.load_mechanism(options)
    diagnosis = check_robot(mechanism)
    if not diagnosis.assembled:
        options.refusal = NotAssembled(
            f"{diagnosis.robot}: the loops do not close near {reference_in_words(mechanism)}; they do at the "
            f"pose that is printed as reference",
            q=np.array(list(diagnosis.reference.values())),
            residual=diagnosis.gap_at_reference,
        ).advising({"reference": diagnosis.reference})
    elif not diagnosis.square:
        options.refusal = InvalidInput(
            f"{diagnosis.robot}: A is not square: {len(diagnosis.platform_axes)} platform axes and "
            f"{len(diagnosis.actuators)} actuators for {diagnosis.mobility - len(diagnosis.idle_joints)} "
            f"degrees of freedom; the notes say what other commands need"
        )
    rank = f"{diagnosis.rank} of {diagnosis.loop_equations} loop equations independent"
    if diagnosis.redundant_rows:
        rank += f"; redundant: {', '.join(diagnosis.redundant_rows)}"
    idle = f", {len(diagnosis.idle_joints)} of them idle" if diagnosis.idle_joints else ""
    square, smallest = "square" if diagnosis.square else "NOT square", diagnosis.smallest_singular_value
    lines = [
        f"{diagnosis.robot}, {diagnosis.flexibility}",
        f"  platform          {', '.join(diagnosis.platform_axes)} at {point(diagnosis.platform)}",
        f"  actuated joints   {', '.join(diagnosis.actuators)}",
        f"  passive joints    {', '.join(diagnosis.passive_joints)}",
        f"  idle joints       {', '.join(diagnosis.idle_joints) or 'none'}",
        f"  springs           {', '.join(diagnosis.springs) or 'none'}",
        f"  mobility          {diagnosis.mobility}{idle}; A is {square}",
        f"  closures          {rank}; closed to {diagnosis.closure_error:.1e}",
        f"  mass              {diagnosis.mass:g} kg; without mass of their own: "
        f"{', '.join(diagnosis.massless_joints) or 'none'}",
        "  reference         {"
        + ", ".join(f"{joint}: {value:.6g}" for joint, value in diagnosis.reference.items())
        + "}",
        f"  mode              working {diagnosis.working_mode:+d} (changes at Type 1), assembly "
        f"{diagnosis.assembly_mode:+d} (changes at Type 2); smallest singular value of the passive "
        f"joints' loop equations {'unknown' if smallest is None else f'{smallest:.3g}'}",
        *(f"  note              {advice}" for advice in diagnosis.advice),
    ]
    return asdict(diagnosis), "\n".join(lines)
