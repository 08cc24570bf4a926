"""`crossing locate`: the singular points on a path, springs at rest, and their shift by deflections."""

from __future__ import annotations

import shlex
from argparse import Namespace
from contextlib import suppress
from itertools import chain

import numpy as np

from framework.atlas.nearest import nearest_singular_pose
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_options,
    add_path,
    add_reference,
    add_robot,
    add_wrenches,
)
from framework.errors import NoAnswer, OutOfReach, Type1Singularity
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Line, Part, Path
from framework.numerics.output import Document, select_fields
from framework.planning.feasibility import feasibility_at, optimal_durations
from framework.planning.plan_facts import twist_text
from framework.planning.request import Request
from framework.singularity.points_on_path import SearchedPath, SingularPoint, search_path, spring_shift

BEFORE_END = 0.999  # of s at the end of the branch: at the end itself the joints have no rates
BEYOND = (2.0, 1.5, 1.2, 1.05)  # lengths of a line through the nearest singular pose, over its distance
PATH_OPTIONS = ("blend", *arguments.WRENCH_OPTIONS, "torque_limit", "speed_limit", "margin")
MISS = "near miss at s = {0.s:.9f}  {1}  |g| = {2:.3g}"
POINT = "s = {0.s:.15f}  {0.kind} ({0.contact})  {1}  t_s = {2}  dg/ds = {0.slope:.6g}"
UNRESOLVED = "  two crossings nearer together than {0.resolution:.2g} in s would look the same"


def add_locate_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing locate`."""
    add_robot(parser)
    add_reference(parser)
    add_path(parser)
    add_flexibility(parser)
    add_options(parser, "torque_limit", "speed_limit", "margin")
    add_wrenches(parser)


def run_locate(options: Namespace) -> Report:
    """Report the singular points and near misses in the order of the path."""
    robot = arguments.load(options)
    if options.scene is options.start is options.end is options.via is None:
        reason = (
            "of a path, and without one the nearest singular pose is sought; leave it out, or give --scene"
        )
        arguments.refuse_options(options, PATH_OPTIONS, reason)
        return _report_nearest(robot, options)
    path = arguments.path(options, robot)
    typed = arguments.options_with_wrenches(options, robot)
    # a request needs a duration, on which singular points do not depend
    request = Request.of(robot, path, **{"duration": 1.0, **typed})
    try:
        searched = search_path(robot, path).under(request.external_wrenches)
    except (OutOfReach, Type1Singularity) as end:
        return _report_beginning(robot, path, end, options)
    optimal = optimal_durations(searched, request)
    singularities = []
    near_misses = []
    lines: list[str] = []
    for singular in searched.points:
        entry, sentences = _describe_point(searched, singular)
        singularities.append(entry)
        lines += sentences
    if not lines:
        lines.append(f"{robot.name}: no singularity on the path")
    elif optimal:
        lines.append(f"  {optimal.sentence}")
    for miss in searched.near_misses:
        near_misses.append({"s": miss.s, "platform": path(miss.s), "g": miss.g})
        lines.append(MISS.format(miss, robot.place(path(miss.s)), abs(miss.g)))
    document = {
        "robot": robot.name,
        "flexibility": robot.flexibility,
        "singularities": singularities,
        "least_duration": optimal and optimal.shortest,
        "near_misses": near_misses,
    }
    return document, lines


def _report_beginning(
    robot: ParallelRobot, path: Path, end: OutOfReach | Type1Singularity, options: Namespace
) -> Report:
    """Report the singular points on the part of a path before its `end`, which stays the refusal."""
    share = BEFORE_END * end.s
    points = search_path(robot, Part(path, 0.0, share)).points if share > 0.0 else ()
    if not points:
        raise end
    options.refusal = end
    lines = [f"{robot.name}: before the path ends at s = {end.s:.6g}:"]
    entries: list[Document] = []
    for at in points:
        s = at.s * share
        entries.append({"s": s, **select_fields(at, "kind", "contact", "twist", "platform")})
        twist = twist_text(robot, at.twist)
        lines.append(f"s = {s:.12f}  {at.kind} ({at.contact})  {robot.place(at.platform)}  t_s = {twist}")
    return {"robot": robot.name, "flexibility": robot.flexibility, "singularities": entries}, lines


def _report_nearest(robot: ParallelRobot, options: Namespace) -> Report:
    """Report the singular pose nearest to the reference, and a line that crosses there for this command."""
    model = {"set": options.set, "reference": options.reference, "flexibility": [options.flexibility]}
    stated = [(f"--{key}", *values) for key, values in model.items() if values and values != ["rigid"]]
    word = shlex.join([options.robot, *chain.from_iterable(stated)])
    nearest = nearest_singular_pose(robot, robot.reference.q)
    document = select_fields(nearest, "status", "distance", "at_least", "leg_end", "unit", "within", "twist")
    document = {"robot": robot.name, "flexibility": robot.flexibility, "nearest_singular_pose": document}
    start = robot.reference.x.round(6) + 0.0  # as printed; + 0.0 turns -0.0 into 0.0
    lines = [f"{robot.name}: from the reference to the nearest singular pose: {nearest.status}"]
    if nearest.x is None or nearest.twist is None:
        place, farther = " ".join(map(repr, start.tolist())), f"{2.0 * nearest.within:.3g}"
        lines.append(f"  to look farther   crossing map {word} --nearest {place} --within {farther}")
        return document, lines
    lines.append(f"  at {robot.place(nearest.x)}; t_s = {twist_text(robot, nearest.twist)}")
    for length in BEYOND:
        end = (start + length * (nearest.x - start)).round(6) + 0.0
        with suppress(NoAnswer):
            if search_path(robot, Line(start, end)).points:
                ends = (" ".join(map(repr, x.tolist())) for x in (start, end))
                lines.append("  to cross there    crossing locate {} --from {} --to {}".format(word, *ends))
                document["line"] = {"from": start, "to": end}
                break
    return document, lines


def _describe_point(searched: SearchedPath, singular: SingularPoint) -> tuple[Document, list[str]]:
    """Return a singular point as a document, and lines on the point.

    Both include the shift of the point by deflections, and condition (8).
    """
    robot = searched.branch.robot
    rates = spring_shift(searched.branch, singular)  # of s by each m or rad of deflection; NaN if undefined
    shift = None if np.isnan(rates).any() else dict(zip(robot.elastic_names, rates, strict=True))
    condition = feasibility_at(searched.branch, singular)
    keys = ("s", "kind", "contact", "corank", "twist", "platform", "slope", "resolution")
    entry = select_fields(singular, *keys) | {"shift": shift, "condition": None}
    lines = [POINT.format(singular, robot.place(singular.platform), twist_text(robot, singular.twist))]
    if singular.resolution is not None:
        lines.append(UNRESOLVED.format(singular))
    if shift is not None and robot.n_e:
        shifts = ", ".join(f"{rate:.6g} by {spring}" for spring, rate in shift.items() if rate)
        lines.append(f"  springs at rest; ds for each m or rad of deflection: {shifts or 'none'}")
    if condition is not None:
        entry["condition"] = {
            **condition.condition._asdict(),
            "acceleration": condition.acceleration and condition.acceleration[:2],
            **select_fields(condition, "weight_share", "tangent_share", "pace"),
        }
        lines.append(f"  {condition.sentence}")
    return entry, lines
