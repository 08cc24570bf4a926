"""`crossing capacity`: the largest multiple of a wrench with which a path can be crossed."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.parser import Report, add_path_and_motion, add_robot, command
from framework.fidelity.capacity import Capacity, capacity_request, largest_load_of
from framework.numerics.output import Document, select_fields
from framework.planning.plan_facts import torque_text

HEAD = """\
{0.plan.robot.name}, {0.plan.robot.flexibility}: {0.multiple:.6g} times the wrench is planned, over \
{0.plan.duration:.6g} s
  peak torque       {1}"""
REFUSED = "  {1:16s}  {0.refused:.6g} times: {0.refusal}"
IMPOSSIBLE = "  no law, proved    with {0.impossible:.6g} times{1}"
UNDECIDED = "  undecided         {0.undecided:.6g} times: {0.failure}"
UNBOUND = "  binds             nothing refused up to {0.multiple:.6g} times"


def add(commands: Any) -> None:
    """Add the command to the parser."""
    details = (
        "By bisection over plans, from one within all limits to one that is refused; what binds is why that "
        "is, and from where it is proved that no law is left. Without --duration each plan is the quickest "
        "within the limits."
    )
    parser = command(commands, "capacity", run, details)
    add_robot(parser)
    add_path_and_motion(parser)


def run(options: argparse.Namespace) -> Report:
    """Report the largest planned multiple, and why a larger one is refused."""
    robot = arguments.load(options)
    path = arguments.path(options, robot)
    request = capacity_request(robot, path, **arguments.options_with_wrenches(options, robot))
    progress = options.progress.start("planning with multiples of the wrench", unit="plans")
    capacity = largest_load_of(robot, request, progress=progress)
    if capacity.multiple == 0.0:
        options.refusal = capacity.refusal or capacity.failure
    return _make_document(capacity), capacity_lines(capacity)


def _make_document(capacity: Capacity) -> Document:
    """Return the capacity for JSON, where infinite numbers become null."""
    plan = capacity.plan
    return {
        "robot": plan.robot.name,
        "flexibility": plan.robot.flexibility,
        **select_fields(capacity, "multiple", "refused", "proved", "impossible", "undecided"),
        "binds": capacity.refusal and str(capacity.refusal),
        "failure": capacity.failure and str(capacity.failure),
        "wrenches": plan.request.wrenches,
        "duration": plan.duration,
        "peak_torque": plan.peak_torque,
    }


def capacity_lines(capacity: Capacity) -> list[str]:
    """Return the report on a capacity, in words."""
    robot = capacity.plan.robot
    lines = [HEAD.format(capacity, torque_text(robot, capacity.plan.peak_torque))]
    if capacity.refusal is not None:
        lines.append(REFUSED.format(capacity, "refused, proved" if capacity.proved else "refused"))
    if np.isfinite(capacity.impossible):
        lines.append(IMPOSSIBLE.format(capacity, "" if robot.is_damped else " and more"))
    if capacity.failure is not None:
        lines.append(UNDECIDED.format(capacity))
    if not np.isfinite(capacity.end):
        lines.append(UNBOUND.format(capacity))
    return lines
