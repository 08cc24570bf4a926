"""All robots of the catalogue in one picture, each at its reference."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from framework.errors import InvalidInput, choose_from
from framework.kinematics.parallel_robot import ParallelRobot
from framework.show.captions import said
from framework.show.drawing import draw_robot
from framework.show.style import figure_file, styled

COLUMNS = 5
CELL = 1.7  # [in] of one robot
DOTS_PER_INCH = 110
PICTURE_KINDS = ("png", "svg", "pdf")


def gallery_picture(robots: Sequence[ParallelRobot], kind: str) -> bytes:
    """Draw robots side by side, with their names.

    Raises:
        InvalidInput: `kind` is not one of PICTURE_KINDS.
    """
    if kind not in PICTURE_KINDS:
        raise InvalidInput(choose_from("kind of picture", kind, PICTURE_KINDS))
    rows = -(-len(robots) // COLUMNS)
    with styled():
        drawing = Figure(figsize=(CELL * COLUMNS, CELL * rows), layout="constrained")
        cells = drawing.subplots(rows, COLUMNS, squeeze=False).ravel()
        for cell in cells:
            cell.set_axis_off()
        for robot, cell in zip(robots, cells, strict=False):
            draw_robot(robot, ax=cell)
            cell.set_axis_off()
            cell.set_title(said(robot.name))
        return figure_file(drawing, kind, dpi=DOTS_PER_INCH)
