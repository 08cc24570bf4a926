"""`crossing map`: quantities over the workspace of a robot, and its singular locus.

With --study: a small map for each set of the parameters of a robot file.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from operator import call
from pathlib import Path as FilePath

import numpy as np

from framework.atlas.design_study import DOCUMENT as STUDY_DOCUMENT
from framework.atlas.design_study import (
    SIZES,
    DesignStudy,
    StudyTask,
    design_study,
    read_designs,
    study_setup,
    write_study,
)
from framework.atlas.map_files import DOCUMENT, STATISTICS, map_document, setup_document, write_map
from framework.atlas.nearest import NearestSingularPose, nearest_singular_pose
from framework.atlas.quantities import QUANTITIES, choose_quantities, has_torque_limits, quantity_unit
from framework.atlas.survey import (
    EDGE_POSES,
    MAX_EDGE_POSES,
    Window,
    grid_shape,
    map_axes,
    map_point,
    survey_window,
)
from framework.atlas.workspace_map import (
    WorkspaceMap,
    check_reference,
    check_window,
    restrict_to_ranges,
    workspace_map,
)
from framework.catalogue import robot_file
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    MAX_LISTED,
    Report,
    add_executor,
    add_flexibility,
    add_missing_fields,
    add_number,
    add_out,
    add_robot,
    integer_between,
)
from framework.errors import InvalidInput, finite_numbers, point
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.kept import KeptChunks
from framework.numerics.output import select_fields
from framework.numerics.tasks import iterate_results
from framework.planning.options import LIMITS, MODEL
from framework.planning.scenes import scene, scene_path

PAGE = "map.html"  # of maps over two axes
STUDY_FILES = ("study.npz", "study.csv", "study.pdf", "study.png")
STUDY_EDGE_POSES = 41  # by default
NOT_FOR_STUDIES = (
    "scene",
    "at",
    "nearest",
    "within",
    "wrench",
    "platform",
    "axes",
    "motors",
    "reference",
    "base",
    "set",
)


def add_map_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing map`."""
    add_robot(parser)
    group = parser.topic("what to map")
    group.add_argument("--scene", metavar="S", help="draw the path of this scene, and hold what it holds")
    group.add_argument(
        "--quantity", nargs="+", metavar="Q", help=f"of {', '.join(QUANTITIES)} (default: those that apply)"
    )
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
        "least and largest value of the first axis, then of the second if there is one [m, rad] (default: "
        "all it reaches)",
        nargs="+",
    )
    group.add_argument(
        "--size",
        type=integer_between(2, MAX_EDGE_POSES),
        metavar="N",
        help=f"poses along an edge (default: {EDGE_POSES}, of a study {STUDY_EDGE_POSES})",
    )
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
        "write map.json, map.npz, map.csv, a figure of each quantity and, over two axes, map.html there; a "
        "map that is stopped keeps what is finished there, and the same command goes on from it",
    )
    group.add_argument(
        "--study",
        action="store_true",
        help="a small map for each set of the parameters that the robot file declares, told in one table and "
        "one figure",
    )
    group.add_argument("--table", metavar="CSV", help="of the sets of parameters, instead of all of them")
    add_missing_fields(parser)


def run_map(options: Namespace) -> Report:
    """Compute, report and write a map, or the maps of a study."""
    if options.table is not None and not options.study:
        raise InvalidInput("--table: is read with --study only; add it, or leave --table out").advising(
            {"study": True}
        )
    report = report_design_study if options.study else report_workspace_map
    module = "framework.atlas.workspace_map" if options.out is None else "framework.show.map"
    with arguments.start_workers(options, module) as executor:
        return report(options, executor)


def report_workspace_map(options: Namespace, executor: Executor | None) -> Report:
    """Compute, report and write a map."""
    robot = arguments.load(options)
    if options.keep_limits:
        check_reference(robot)
    path = None if options.scene is None else scene_path(scene(robot, options.scene))
    names = options.quantity  # None for all that apply
    if options.keep_limits and has_torque_limits(robot):
        names = [*(names or [quantity.key for quantity in choose_quantities(robot, None)]), "holding"]
    quantities = choose_quantities(robot, names, options.wrench)
    centre = path(np.zeros(1))[0] if options.at is None and path is not None else options.at
    size = options.size or EDGE_POSES
    if options.window is None:
        over = {"axes": options.over, "at": centre}
        window = survey_window(robot, **over, size=size, keep_limits=options.keep_limits)
    else:
        axes = map_axes(robot, options.over)
        bounds = finite_numbers("--window", options.window, 2 * len(axes))
        window = Window(axes, bounds[::2], bounds[1::2], grid_shape(axes, size), map_point(robot, centre))
    if options.keep_limits:
        check_window(robot, window)
    keys = [quantity.key for quantity in quantities]
    files = ["map.npz", "map.csv", *(f"map_{key}.{kind}" for key in keys for kind in ("pdf", "png"))]
    if len(window.axes) > 1:
        files.append(PAGE)
    setup = setup_document(robot, window, quantities)
    store = None if options.out is None else KeptChunks.of(FilePath(options.out), setup)
    kept = partial(arguments.count_chunks, store, "bands")
    with arguments.written_stepwise(options, DOCUMENT, files, kept) as folder:
        margin = _find_margin(options, robot)
        workspace = workspace_map(
            robot,
            window,
            keys,
            wrench=options.wrench,
            executor=executor,
            keeper=store,
            progress=options.progress.start("mapping", float(np.prod(window.shape)), "poses"),
        )
        if options.keep_limits:
            workspace = restrict_to_ranges(workspace)
        if folder is not None:
            options.progress.start("drawing the figures")
            # workers of dask may be elsewhere, and the files are of this machine
            _write_files(workspace, folder, path, None if options.dask else executor)
    return _report_map(workspace, margin, is_whole=options.window is None)


def _write_files(
    workspace: WorkspaceMap, folder: FilePath, path: Path | None, executor: Executor | None
) -> None:
    """Write tables, figures and page of a map; processes of the executor draw figures."""
    from framework.show.map import map_page, save_map_figures

    workspace.locus  # noqa: B018 - traced once, not in each process
    parts: dict[str, Callable[[], object]] = {
        key: partial(save_map_figures, workspace, folder, path=path, keys=[key]) for key in workspace.values
    }
    parts["tables"] = partial(write_map, workspace, folder)
    for _ in iterate_results(call, parts, executor):
        pass
    if len(workspace.window.axes) > 1:
        (folder / PAGE).write_text(map_page(workspace, path=path), encoding="utf-8")


def _find_margin(options: Namespace, robot: ParallelRobot) -> NearestSingularPose | None:
    """Find the singular pose nearest to --nearest; None without the option."""
    if options.nearest is not None:
        pose = assemble(robot, options.nearest)
        progress = options.progress.start("following rays to the nearest singular pose", unit="steps")
        return nearest_singular_pose(robot, pose.q, within=options.within, progress=progress)
    if options.within is None:
        return None
    message = "--within: belongs to --nearest; give both, or leave it out"
    raise InvalidInput(message).advising({"within": None})


def _report_map(workspace: WorkspaceMap, margin: NearestSingularPose | None, *, is_whole: bool) -> Report:
    """Return a map as a document, and in text its counts, locus and statistics.

    Args:
        is_whole: whether the window was chosen to hold all that is reached.
    """
    robot = workspace.robot
    window = workspace.window
    size = " x ".join(map(str, window.shape[: len(window.axes)]))
    document = {**map_document(workspace), "seconds": workspace.seconds}
    bounds = zip(window.axes, window.lower, window.upper, strict=True)
    spans = ", ".join(f"{robot.axis_names[k]} = {low:.4g} .. {high:.4g}" for k, low, high in bounds)
    cut = ""
    if edges := workspace.open_edges:
        axes = list(window.axes)
        ends = np.abs(np.array([window.lower, window.upper]) - window.constants[axes])
        reach = (ends / robot.platform_scale[axes]).max()
        far = f", {reach:.2g} robot lengths or rad away" if is_whole else " (--window)"
        cut = f"; more may be reached beyond its {', '.join(edges)}{far}"
    lines = [f"{robot.name}: {size} poses, {spans}, {workspace.seconds:.2f} s{cut}", "  poses\tcount"]
    lines += [f"  {why}\t{count}" for why, count in workspace.counts.items() if count]
    lines += [f"  under load: {why}\t{count}" for why, count in workspace.load_counts.items() if count]
    lines.append(f"  locus: {workspace.locus_sentence}, {workspace.locus.seconds:.2f} s")
    if len(window.axes) == 1:
        lines += [f"  singular: {each.kind} at {robot.place(each.x[0])}" for each in workspace.locus.curves]
    lines.append("\t".join(["  quantity", *STATISTICS]))
    for quantity in workspace.quantities:
        values = map(document["quantities"][quantity.key].get, STATISTICS)
        cells = ("-" if value is None else f"{value:.3g}" for value in values)
        lines.append("\t".join([f"  {quantity.name} [{quantity_unit(robot, quantity)}]", *cells]))
        if softest := document["quantities"][quantity.key].get("softest"):
            lines.append("    least at {place}, in the direction {words}".format_map(softest))
    if margin is not None:
        lines.append(f"  nearest singular pose: {margin.status}")
        if margin.x is not None and margin.twist is not None:
            lines.append(f"    at {robot.place(margin.x)}; t_s {point(margin.twist)}")
        keys = ("status", "distance", "at_least", "leg_end", "unit", "within", "asked", "twist")
        document["nearest_singular_pose"] = select_fields(margin, *keys) | {"platform": margin.x}
    return document, lines


# ------------------------------------------------------------------ map --study


def report_design_study(options: Namespace, executor: Executor | None) -> Report:
    """Map each design of a study; write and report the results."""
    reason = "not for a study, whose robots have values of their own"
    arguments.refuse_options(options, NOT_FOR_STUDIES, reason)
    file = robot_file(options.robot)
    designs = read_designs(file, options.table)
    robot = ParallelRobot.from_file(file, flexibility=options.flexibility)
    arguments.warn_of_unused(options, robot)
    axis_names = [robot.axis_names[k] for k in map_axes(robot, options.over)]
    count = 2 * len(axis_names)
    window = options.window and tuple(finite_numbers("--window", options.window, count).tolist())
    task = StudyTask(
        file=str(file.resolve()),
        names=designs.names,
        flexibility=options.flexibility,
        axes=tuple(axis_names),
        window=window,
        size=options.size or STUDY_EDGE_POSES,
        keys=tuple(quantity.key for quantity in choose_quantities(robot, options.quantity)),
    )
    setup = study_setup(task, designs)
    store = None if options.out is None else KeptChunks.of(FilePath(options.out), setup)
    kept = partial(arguments.count_chunks, store, "chunks")
    with arguments.written_stepwise(options, STUDY_DOCUMENT, STUDY_FILES, kept) as folder:
        progress = options.progress.start("mapping", len(designs.values), "designs")
        study = design_study(task, designs, executor=executor, keeper=store, progress=progress)
        if folder is not None:
            from framework.show.plots import save_figure
            from framework.show.study_figures import plot_study

            write_study(study, folder)
            options.progress.start("drawing the figure")
            save_figure(lambda: plot_study(study), folder / "study")
    return _report_study(study, robot.name)


def _report_study(study: DesignStudy, robot: str) -> Report:
    """Return all designs as a document, and a table of the first ones."""
    entries = []
    for k, (design, why) in enumerate(zip(study.designs.values, study.why, strict=True)):
        parameters = dict(zip(study.designs.names, design, strict=True))
        values = {key: column[k] for key, column in study.columns.items()}
        entries.append({"parameters": parameters, **values, "why": why})
    document = {"robot": robot, "designs": entries, "units": study.units}
    count = len(entries)
    size = study.task.size
    refused = sum(map(bool, study.why))
    lines = [f"{robot}: {count} designs, {size} x {size} poses each, {refused} make no robot"]
    # table of the first designs: parameters, areas, medians, and refusals
    columns = [key for key in study.columns if key.endswith((*SIZES.values(), "_median"))]
    heads = [*study.designs.names, *(f"{key} [{study.units[key]}]" for key in columns)]
    numbers = np.column_stack([study.designs.values, *(study.columns[key] for key in columns)])
    rows = [[f"{value:.4g}" if np.isfinite(value) else "-" for value in row] for row in numbers]
    if refused > 0:
        heads.append("why no robot")
        rows = [[*row, why] for row, why in zip(rows, study.why, strict=True)]
    lines += ["  " + "\t".join(row) for row in [heads, *rows[:MAX_LISTED]]]
    if count > MAX_LISTED:
        lines.append(f"  and {count - MAX_LISTED} more; --out or --json keeps all")
    return document, lines
