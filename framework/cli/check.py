"""`crossing check`: what kind of mechanism a file describes, and what is wrong with it."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.parser import Report, add_flexibility, add_missing_fields, add_robot, command
from framework.errors import NotAssembled, point
from framework.kinematics.diagnostics.diagnosis import check_robot


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "check", run)
    add_robot(parser, "catalogue name, or path of a robot file or of a file of a foreign dialect")
    add_missing_fields(parser)
    add_flexibility(parser)


def run(options: argparse.Namespace) -> Report:
    """What `check_robot` finds."""
    found = check_robot(arguments.load_mechanism(options))
    if not found.assembled:
        options.refusal = NotAssembled(
            f"{found.robot}: the loops do not close near the reference that is given; they do at the pose "
            f"that is printed as reference",
            q=np.array(list(found.reference.values())),
            residual=found.gap_at_reference,
        )
    rank = f"{found.rank} of {found.loop_equations} loop equations independent"
    if found.redundant_rows:
        rank += f"; redundant: {', '.join(found.redundant_rows)}"
    idle = f", {len(found.idle_joints)} of them idle" if found.idle_joints else ""
    lines = [
        f"{found.robot}, {found.flexibility}",
        f"  platform          {', '.join(found.platform_axes)} at {point(found.platform)}",
        f"  actuated joints   {', '.join(found.actuators)}",
        f"  passive joints    {', '.join(found.passive_joints)}",
        f"  idle joints       {', '.join(found.idle_joints) or 'none'}",
        f"  springs           {', '.join(found.springs) or 'none'}",
        f"  mobility          {found.mobility}{idle}; A is {'square' if found.square else 'NOT square'}",
        f"  closures          {rank}; closed to {found.closure_error:.1e}",
        f"  mass              {found.mass:g} kg; without mass of their own: "
        f"{', '.join(found.massless_joints) or 'none'}",
        "  reference         {"
        + ", ".join(f"{joint}: {value:.6g}" for joint, value in found.reference.items())
        + "}",
        f"  mode              working {found.working_mode:+d} (changes at Type 1), assembly "
        f"{found.assembly_mode:+d} (changes at Type 2); smallest singular value of the passive "
        f"joints' loop equations "
        f"{'unknown' if found.smallest_singular_value is None else f'{found.smallest_singular_value:.3g}'}",
        *(f"  note              {advice}" for advice in found.advice),
    ]
    return asdict(found), "\n".join(lines)
