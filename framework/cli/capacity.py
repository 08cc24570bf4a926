"""`crossing capacity`: the largest multiple of a wrench with which a path is still crossed."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.parser import Report, add_path_and_motion, add_robot, command
from framework.crossing.capacity import Capacity, capacity_request, largest_load_of
from framework.crossing.plan_facts import torque_text
from framework.output import Document

NUMBERS = ("multiple", "refused", "proved", "impossible", "undecided")  # of a capacity, with --json


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
    """Report the largest multiple, and why a larger one is refused."""
    robot = arguments.load(options)
    path, typed = arguments.path(options, robot), arguments.options_with_wrenches(options, robot)
    progress = options.progress.start("planning with multiples of the wrench", unit="plans")
    capacity = largest_load_of(robot, capacity_request(robot, path, **typed), progress=progress)
    if capacity.multiple == 0.0:
        options.refusal = capacity.refusal or capacity.failure
    return _document(capacity), capacity_text(capacity)


def _document(capacity: Capacity) -> Document:
    """Return the capacity for JSON, in which infinite numbers are null."""
    plan = capacity.plan
    return {
        "robot": plan.robot.name,
        "flexibility": plan.robot.flexibility,
        **{key: getattr(capacity, key) for key in NUMBERS},
        "binds": capacity.refusal and str(capacity.refusal),
        "failure": capacity.failure and str(capacity.failure),
        "wrenches": plan.request.wrenches,
        "duration": plan.duration,
        "peak_torque": plan.peak_torque,
    }


def capacity_text(capacity: Capacity) -> str:
    """Return the report on a capacity, in words."""
    plan = capacity.plan
    lines = [
        f"{plan.robot.name}, {plan.robot.flexibility}: {capacity.multiple:.6g} times the wrench is planned, "
        f"over {plan.duration:.6g} s",
        f"  peak torque       {torque_text(plan.robot, plan.peak_torque)}",
    ]
    if capacity.refusal is not None:
        word = "refused, proved" if capacity.proved else "refused"
        lines.append(f"  {word:16s}  {capacity.refused:.6g} times: {capacity.refusal}")
    if np.isfinite(capacity.impossible):
        beyond = "" if plan.robot.is_damped else " and more"
        lines.append(f"  no law, proved    with {capacity.impossible:.6g} times{beyond}")
    if capacity.failure is not None:
        lines.append(f"  undecided         {capacity.undecided:.6g} times: {capacity.failure}")
    if not np.isfinite(capacity.end):
        lines.append(f"  binds             nothing refused up to {capacity.multiple:.6g} times")
    return "\n".join(lines)
