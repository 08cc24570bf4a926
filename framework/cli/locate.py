"""`crossing locate`: the singular points on a path, springs at rest, and how far the springs move them."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.cli import arguments
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_options,
    add_path,
    add_robot,
    add_wrenches,
    command,
)
from framework.crossing.durations import optimal_durations, polynomial_durations
from framework.crossing.feasibility import Feasibility, feasibility_on_path
from framework.errors import point
from framework.kinematics.parallel_robot import ParallelRobot
from framework.output import Document
from framework.singularity.points_on_path import SearchedPath, SingularPoint, search_path
from framework.singularity.spring_shift import spring_shift
from framework.singularity.type2 import moves_point

MISS = "near miss at s = {0.s:.9f}  {1}  |g| = {2:.3g}"
POINT = "s = {0.s:.15f}  {0.kind} ({0.contact})  {1}  t_s = {2}  dg/ds = {0.slope:.6g}"
# of a singular point, with --json
TOLD = (
    "s",
    "kind",
    "contact",
    "corank",
    "twist",
    "platform",
    "slope",
    "resolution",
)  # of a point, with --json


def add(commands: Any) -> None:
    """Add the command to the parser."""
    details = (
        "With --flexibility: the singular points of the undeformed robot, springs at rest, and the rate at "
        "which each deflection moves them along the path. How far the springs give, and so where the "
        "deformed robot is singular, depends on the motion: crossing plan tells."
    )
    parser = command(commands, "locate", run, details)
    add_robot(parser)
    add_path(parser)
    add_flexibility(parser)
    add_options(parser, "torque_limit", "speed_limit", "margin")
    add_wrenches(parser)


def run(options: Namespace) -> Report:
    """Report the singular points in the order of the path."""
    robot = arguments.load(options)
    path = arguments.path(options, robot)
    any_duration = arguments.request_of_any_duration(options, robot, path)
    searched = search_path(robot, path).under(any_duration.external_wrenches)
    points = searched.points
    shifts = [_shift(searched, singular) for singular in points]
    feasible = feasibility_on_path(searched)
    polynomial = polynomial_durations(searched, any_duration.smoothness)
    optimal = optimal_durations(searched, any_duration)
    facts = list(zip(points, shifts, feasible, strict=True))
    document = {
        "robot": robot.name,
        "flexibility": robot.flexibility,
        "singularities": [_singularity(*fact) for fact in facts],
        "durations": {
            "polynomial": None if polynomial is None else polynomial.to_list(),
            "optimal": None if optimal is None else optimal.to_list(),
        },
        "near_misses": [
            {"s": miss.s, "platform": path(miss.s), "g": miss.g} for miss in searched.near_misses
        ],
    }
    lines = [] if points else [f"{robot.name}: no singularity on the path"]
    for fact in facts:
        lines += _lines(robot, *fact)
    if points:
        lines += [] if polynomial is None else [f"  {polynomial.sentence}{polynomial.advice}"]
        lines += [] if optimal is None else [f"  {optimal.sentence}"]
    lines += [MISS.format(miss, robot.place(path(miss.s)), abs(miss.g)) for miss in searched.near_misses]
    return document, "\n".join(lines)


def _singularity(
    singular: SingularPoint, shift: dict[str, float] | None, condition: Feasibility | None
) -> Document:
    entry = {key: getattr(singular, key) for key in TOLD}
    return entry | {"shift": shift, "condition": None if condition is None else condition.to_dict()}


def _lines(
    robot: ParallelRobot,
    singular: SingularPoint,
    shift: dict[str, float] | None,
    condition: Feasibility | None,
) -> list[str]:
    words = (robot.place(singular.platform), twist_text(robot, singular.twist))
    lines = [POINT.format(singular, *words)]
    if singular.resolution is not None:
        lines.append(
            f"  two crossings nearer together than {singular.resolution:.2g} in s would look the same"
        )
    if shift is not None and robot.n_e:
        moved = ", ".join(f"{rate:.6g} by {spring}" for spring, rate in shift.items() if rate)
        lines.append(f"  springs at rest; ds for each m or rad of deflection: {moved or 'none'}")
    if condition is not None:
        lines.append(f"  {condition.sentence}")
    return lines


def twist_text(robot: ParallelRobot, twist: Array) -> str:
    """Return the twist t_s on the platform's axes, with the unit in which it is normalised."""
    return f"{point(twist)} of unit {'speed' if moves_point(robot, twist) else 'turning rate'}"


def _shift(searched: SearchedPath, singular: SingularPoint) -> dict[str, float] | None:
    """Compute ds for each m or rad of deflection by spring; None where deflections do not move the point."""
    rates = spring_shift(searched.branch, singular)
    names = searched.branch.robot.elastic_names
    return None if np.isnan(rates).any() else dict(zip(names, rates, strict=True))
