"""The Gough-Stewart platform, 6-UPS: a platform of 1.2 t that turns about all three axes.

Scenes: `tilt` from home without a singularity, `turn` through Fichter's singularity near a quarter turn about
the vertical, where the platform may screw itself down with all motors locked; `turn-unprepared` the same
path without condition (8).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("gough_stewart"),
    summary="Gough-Stewart platform 6-UPS, six legs with prismatic motors",
    source="The MathWorks, Stewart platform example of SimMechanics, 1998-2003",
    singularities=("type_2",),
    why="The lines of the six legs depend on one another: the twist t_s changes the length of none of them.",
)
