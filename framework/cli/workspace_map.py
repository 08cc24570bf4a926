"""`crossing map`: what a robot can do over its workspace, and where it is singular."""

from __future__ import annotations

import argparse
from argparse import Namespace
from pathlib import Path as FilePath

import numpy as np

from framework.atlas.map_files import DOCUMENT, map_document, setup_document, write_map
from framework.atlas.nearest import NearestSingularPose, nearest_singular_pose
from framework.atlas.quantities import QUANTITIES, Quantity, choose_quantities, has_torque_limits, unit_of
from framework.atlas.ranges import check_reference, check_window, restrict_to_ranges
from framework.atlas.survey import EDGE_POSES, survey_window
from framework.atlas.window import MAX_EDGE_POSES, Window, held_coordinates, map_axes
from framework.atlas.workspace_map import WorkspaceMap, workspace_map
from framework.cli import arguments
from framework.cli.design_study import STUDY_EDGE_POSES, finite_window, report_design_study
from framework.cli.parser import (
    Report,
    add_executor,
    add_flexibility,
    add_missing_fields,
    add_number,
    add_out,
    add_robot,
    command,
    integer_between,
)
from framework.cli.writing import written_stepwise
from framework.crossing.options import LIMITS, MODEL
from framework.crossing.scenes import scene, scene_path
from framework.errors import InvalidInput, point
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.path import Path
from framework.parallel.kept import KeptChunks
from framework.parallel.tasks import executor_of

STATISTICS = ("least", "median", "largest")  # of a quantity over the map
MORE = (
    "Poses are reached from the reference by continuation, so the map never leaves its working mode; what is "
    "not reached has no value and a reason."
)


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    parser = command(commands, "map", run, MORE)
    add_robot(parser)
    group = parser.topic("what to map")
    group.add_argument("--scene", metavar="S", help="draw the path of this scene, and hold what it holds")
    group.add_argument(
        "--quantity", nargs="+", metavar="Q", help=f"of {', '.join(QUANTITIES)} (default: those that apply)"
    )
    _add_window(group)
    parser.topic(LIMITS).add_argument(
        "--keep-limits",
        action="store_true",
        help="only what is reached within the ranges that the URDF gives its joints, and held at rest within "
        "the motors' limits of torque where they have some",
    )
    add_flexibility(parser)
    add_number(
        parser.topic(MODEL),
        "--wrench",
        "W",
        "of the world on the platform, beside the weight [N, N m], for holding, loaded_stiffness "
        "and loaded_frequency",
        nargs="+",
    )
    add_number(
        group,
        "--nearest",
        "X",
        "platform point whose nearest singular pose is looked for, its margin [m, rad]",
        nargs="+",
    )
    add_number(
        group, "--within", "R", "how far it is looked for, half a robot length or 0.5 rad by default [m, rad]"
    )
    add_executor(parser)
    add_out(
        parser,
        "write map.json, map.npz, map.csv, a figure of each quantity and map.html there; a map that is "
        "stopped keeps what is finished there, and the same command goes on from it",
    )
    group.add_argument(
        "--study",
        action="store_true",
        help="a small map for each set of the parameters that the robot file declares, told in one table and "
        "one figure",
    )
    group.add_argument("--table", metavar="CSV", help="of the sets of parameters, instead of all of them")
    add_missing_fields(parser)


def _add_window(group: argparse._ArgumentGroup) -> None:
    """Add the options for the poses of the map."""
    group.add_argument(
        "--over", nargs=2, metavar="AXIS", help="two axes of the platform (default: its first translations)"
    )
    add_number(
        group,
        "--at",
        "X",
        "platform point about which the map lies [m, rad] (default: the reference)",
        nargs="+",
    )
    add_number(
        group,
        "--window",
        "X",
        "least and largest value of the first axis, then of the second [m, rad] (default: all it reaches)",
        nargs=4,
    )
    group.add_argument(
        "--size",
        type=integer_between(2, MAX_EDGE_POSES),
        metavar="N",
        help=f"poses along an edge (default: {EDGE_POSES}, of a study {STUDY_EDGE_POSES})",
    )


def run(options: Namespace) -> Report:
    """Compute, report and write a map."""
    if options.study:
        return report_design_study(options)
    if options.table is not None:
        raise InvalidInput("--table: is read with --study only; add it, or leave --table out").advising(
            {"study": True}
        )
    robot = arguments.load(options)
    if options.keep_limits:
        check_reference(robot)
    path = None if options.scene is None else scene_path(scene(robot, options.scene))
    quantities = choose_quantities(robot, _quantities(options, robot), options.wrench)
    window = _window(options, robot, path)
    if options.keep_limits:
        check_window(robot, window)
    margin = None
    if options.within is not None and options.nearest is None:
        raise InvalidInput("--within: belongs to --nearest; give both, or leave it out").advising(
            {"within": None}
        )
    if options.nearest is not None:
        pose = assemble(robot, options.nearest)
        margin = nearest_singular_pose(robot, pose.q, within=options.within)
    if options.out is None:
        return _report(_compute_map(options, robot, window, quantities, None), margin)
    store = KeptChunks.of(FilePath(options.out), setup_document(robot, window, quantities))
    with written_stepwise(options, DOCUMENT, lambda: len(store.read()), "bands") as folder:
        workspace = _compute_map(options, robot, window, quantities, store)
        options.progress.start("drawing the figures")
        _write(workspace, path, folder)
    return _report(workspace, margin)


def _quantities(options: Namespace, robot: ParallelRobot) -> list[str] | None:
    """Return the quantities' names, by default all that apply; with --keep-limits also `holding`."""
    names = None if options.quantity is None else list(options.quantity)
    if not options.keep_limits or not has_torque_limits(robot):
        return names
    return [*(names or [quantity.key for quantity in choose_quantities(robot, None)]), "holding"]


def _window(options: Namespace, robot: ParallelRobot, path: Path | None) -> Window:
    """Return the window of options: given bounds, or the region that a survey finds reached."""
    axes = None if options.over is None else tuple(options.over)
    centre = path(np.zeros(1))[0] if options.at is None and path is not None else options.at
    size = options.size or EDGE_POSES
    if options.window is None:
        return survey_window(robot, axes=axes, at=centre, size=size, keep_limits=options.keep_limits)
    bounds = np.array(finite_window(options))
    return Window(
        map_axes(robot, axes), bounds[::2], bounds[1::2], (size, size), held_coordinates(robot, centre)
    )


def _compute_map(
    options: Namespace,
    robot: ParallelRobot,
    window: Window,
    quantities: tuple[Quantity, ...],
    store: KeptChunks | None,
) -> WorkspaceMap:
    """Map the window by several processes; keep poses within limits if asked."""
    progress = options.progress.start("mapping", float(np.prod(window.shape)), "poses")
    with executor_of(workers=options.workers, dask=options.dask) as executor:
        workspace = workspace_map(
            robot,
            window,
            [quantity.key for quantity in quantities],
            wrench=options.wrench,
            executor=executor,
            keeper=store,
            progress=progress,
        )
    return restrict_to_ranges(workspace) if options.keep_limits else workspace


def _write(workspace: WorkspaceMap, path: Path | None, folder: FilePath) -> None:
    """Write a map into a folder: numbers, figures and page."""
    from framework.show.map import save_map_figures
    from framework.show.map_page import map_page

    write_map(workspace, folder)
    save_map_figures(workspace, folder, path=path)
    (folder / "map.html").write_text(map_page(workspace, path=path), encoding="utf-8")


def _report(workspace: WorkspaceMap, margin: NearestSingularPose | None) -> Report:
    """Return a map as a document, and in text its counts, locus and statistics."""
    robot, shape = workspace.robot, workspace.window.shape
    document = {**map_document(workspace), "seconds": workspace.seconds}
    spans = _spans(robot, workspace.window)
    lines = [f"{robot.name}: {shape[0]} x {shape[1]} poses, {spans}, {workspace.seconds:.2f} s"]
    lines.append("  poses\tcount")
    lines += [f"  {why}\t{count}" for why, count in workspace.counts.items() if count]
    lines += [f"  under load: {why}\t{count}" for why, count in workspace.load_counts.items() if count]
    lines += [f"  the window cuts off what is reached, at its {edge}" for edge in workspace.open_edges]
    lines.append(f"  locus: {workspace.locus.sentence}, {workspace.locus.seconds:.2f} s")
    lines.append("\t".join(["  quantity", *STATISTICS]))
    for quantity in workspace.quantities:
        entry = document["quantities"][quantity.key]
        cells = (f"{entry[key]:.3g}" if entry[key] is not None else "-" for key in STATISTICS)
        lines.append("\t".join([f"  {quantity.name} [{unit_of(robot, quantity)}]", *cells]))
    if margin is not None:
        lines += _margin_lines(robot, margin)
        keys = ("status", "distance", "at_least", "leg_end", "unit", "within")
        document["nearest_singular_pose"] = {
            **{key: getattr(margin, key) for key in keys},
            "platform": margin.x,
            "twist": margin.twist,
        }
    return document, "\n".join(lines)


def _spans(robot: ParallelRobot, window: Window) -> str:
    """Return the ends of a window in words."""
    ends = zip(window.axes, window.lower, window.upper, strict=True)
    return ", ".join(f"{robot.axis_names[k]} = {low:.4g} .. {high:.4g}" for k, low, high in ends)


def _margin_lines(robot: ParallelRobot, margin: NearestSingularPose) -> list[str]:
    """Return lines on the nearest singular pose."""
    lines = [f"  nearest singular pose: {margin.status}"]
    if margin.x is not None and margin.twist is not None:
        coordinates = zip(robot.axis_names, margin.x, strict=True)
        place = ", ".join(f"{name} = {value + 0.0:.6g}" for name, value in coordinates)
        lines.append(f"    at {place}; t_s {point(margin.twist)}")
    return lines
