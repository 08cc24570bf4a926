"""A map as a page of its own, with the values of the pose under the pointer: one file, nothing fetched."""

from __future__ import annotations

from html import escape

import numpy as np

from framework.atlas.quantities import Quantity, unit_of
from framework.atlas.workspace_map import WorkspaceMap
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.numerics.output import Document
from framework.show.map import (
    UNEXPLAINED,
    cell_edges,
    colours,
    is_to_scale,
    path_on_map,
    title,
)
from framework.show.standalone import pack, page_part, standalone_page
from framework.show.style import LOCUS, NOT_CARRIED, PATH, UNREACHED

COLOR_LEVELS = 256
LEAD = "All poses are reached from the robot's reference without leaving its working mode."
SIDES = "White is 0, on the locus; the two colours are its two sides, deeper with |g|."
BRIGHT_IS_LARGE, BRIGHT_IS_SMALL = "Bright is large, and good.", "Bright is small, and good."
ON_LOCUS = "On the purple locus (Type 2) the motors do not hold the platform."


def map_page(workspace: WorkspaceMap, *, path: Path | None = None) -> str:
    """Return the page as HTML."""
    heading = title(workspace)
    return standalone_page(
        heading,
        page_part(
            "map.html",
            title=escape(heading),
            lead=escape(f"{LEAD} {ON_LOCUS}" if workspace.locus.curves else LEAD),
            found=escape(f"Singular locus: {workspace.locus.sentence}."),
        ),
        _document(workspace, path),
        styles=["map.css"],
        scripts=["map.js"],
    )


def _document(workspace: WorkspaceMap, path: Path | None) -> Document:
    """Return the data of the map's page: quantities, reasons, curves and legend."""
    robot, window = workspace.robot, workspace.window
    curves = [_curve(curve.x, LOCUS, 2.0, []) for curve in workspace.locus.curves]
    legend: list[tuple[str, str, bool]] = [("singular locus (Type 2)", LOCUS, False)] if curves else []
    if len(workspace.locus.unexplained):
        legend.append((UNEXPLAINED, LOCUS, False))
    mark = robot.reference.x[list(window.axes)]
    if path is not None:
        line, projected = path_on_map(workspace, path)
        curves.append(_curve(line, PATH, 2.5, [7, 4]))
        legend.append((f"path, from the dot on{projected}", PATH, False))
        mark = line[0]
    if workspace.load is not None:
        lost = int(workspace.reached.sum()) - workspace.load_counts[LOAD_WORDS[LoadReason.CARRIED]]
        legend.append((f"load not carried: {lost} poses", NOT_CARRIED, True))
    legend.append(
        ("not reached within all limits" if workspace.keeps_limits else "not reached", UNREACHED, True)
    )
    return {
        "shape": window.shape,
        "axes": [f"{robot.axis_names[k]} [{robot.axis_units[k]}]" for k in window.axes],
        "spans": window.spans,
        "edges": [cell_edges(span)[[0, -1]] for span in window.spans],
        "to_scale": is_to_scale(workspace),
        "quantities": [_quantity(workspace, quantity) for quantity in workspace.quantities],
        "reason": pack(workspace.reason.astype(np.uint8)),
        "reasons": workspace.reason_words,
        "assembly": pack(workspace.assembly.astype(np.int8).view(np.uint8)),
        "has_sides": robot.n_a == robot.n and len(robot.passive) > 0,
        "load": None if workspace.load is None else pack(workspace.load),
        "loads": [LOAD_WORDS[kind] for kind in LoadReason],
        "unreached": _rgb(UNREACHED),
        "not_carried": _rgb(NOT_CARRIED),
        "curves": curves,
        "marks": [np.round(mark, 9)],
        "crosses": np.round(workspace.locus.unexplained, 9),
        "legend": legend,
    }


def _quantity(workspace: WorkspaceMap, quantity: Quantity) -> Document:
    """Return a quantity for the page: values, range and colours."""
    palette, norm = colours(workspace, quantity)
    shades = np.round(255 * palette(np.linspace(0.0, 1.0, COLOR_LEVELS))[:, :3]).astype(int)
    return {
        "key": quantity.key,
        "name": quantity.name,
        "unit": unit_of(workspace.robot, quantity),
        "reading": _reading(quantity),
        "values": pack(workspace.values[quantity.key].astype("<f4")),
        "range": [norm.vmin or 0.0, norm.vmax or 0.0],
        "decades": quantity.decades,
        "loaded": quantity.loaded,
        "colours": shades,
    }


def _reading(quantity: Quantity) -> str:
    """Return which colours of a quantity are good, in words."""
    if quantity.signed:
        return SIDES
    return BRIGHT_IS_LARGE if quantity.large_is_good else BRIGHT_IS_SMALL


def _curve(points: Array, colour: str, width: float, dash: list[int]) -> Document:
    return {"points": np.round(points, 9), "colour": colour, "width": width, "dash": dash}


def _rgb(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
