"""The planar 3-RPR: a platform that slides and turns in the plane on three legs of driven length.

Scenes: `crossing` passes the pose where the lines of the three legs meet in a point (Type 2), `clear` stops
before it.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("three_rpr"),
    summary="planar 3-RPR, platform x, y, rz, legs of driven length",
    source="after Innocenti and Parenti-Castelli 1998; Zein, Wenger and Chablat, Robotica 25, 2007",
    singularities=("type_2",),
    why="The lines of the three legs meet in one point: nothing turns the platform about it.",
)
