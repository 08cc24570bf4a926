"""`crossing check`: the mechanism that a file describes, and faults of the description."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.parser import Report, add_flexibility, add_missing_fields, add_robot, command
from framework.errors import FrameworkError, InvalidInput, NotAssembled, point
from framework.kinematics.diagnostics.diagnosis import Diagnosis, check_robot, reference_in_words

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


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "check", run)
    add_robot(parser, "catalogue name, or path of a robot file or of a file of a foreign dialect")
    add_missing_fields(parser)
    add_flexibility(parser)


def run(options: Namespace) -> Report:
    """Examine a robot; report its mobility, masses, reference pose and advice."""
    mechanism = arguments.load_mechanism(options)
    diagnosis = check_robot(mechanism)
    options.refusal = _find_refusal(diagnosis, reference_in_words(mechanism))
    facts, smallest = asdict(diagnosis), diagnosis.smallest_singular_value
    idle, redundant = len(diagnosis.idle_joints), ", ".join(diagnosis.redundant_rows)
    angles = [f"{joint}: {value:.6g}" for joint, value in diagnosis.reference.items()]
    words = {key: ", ".join(facts[key]) or "none" for key in LISTS}
    words["place"] = point(diagnosis.platform)
    words["idle"] = f", {idle} of them idle" if idle else ""
    words["shape"] = "square" if diagnosis.square else "NOT square"
    words["redundant"] = f"; redundant: {redundant}" if redundant else ""
    words["angles"] = ", ".join(angles)
    words["smallest"] = "unknown" if smallest is None else f"{smallest:.3g}"
    notes = [f"  note              {advice}" for advice in diagnosis.advice]
    return facts, [REPORT.format_map(facts | words), *notes]


def _find_refusal(diagnosis: Diagnosis, reference: str) -> FrameworkError | None:
    """Return the reason why other commands refuse the robot, or None.

    `reference` states the reference in words.
    """
    if not diagnosis.assembled:
        instead = "" if diagnosis.square else ", where A is not square: the notes say at what to look first"
        return NotAssembled(
            f"{diagnosis.robot}: the loops do not close near {reference}; they do at the pose that is "
            f"printed as reference{instead}",
            q=np.array(list(diagnosis.reference.values())),
            residual=diagnosis.gap_at_reference,
        ).advising({"reference": diagnosis.reference} if diagnosis.square else None)
    if diagnosis.square:
        return None
    return InvalidInput(
        f"{diagnosis.robot}: A is not square: {len(diagnosis.platform_axes)} platform axes and "
        f"{len(diagnosis.actuators)} actuators for {diagnosis.mobility - len(diagnosis.idle_joints)} degrees "
        f"of freedom; the notes say what other commands need"
    )
