"""The planar 3-RRR: a platform that slides and turns in the plane, three motors at the base.

Scenes: `crossing` turns the platform through the pose where its three rods meet in a point (Type 2),
`clear` stays away from it.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("three_rrr"),
    summary="planar 3-RRR, platform x, y, rz, links of 0.6 m",
    source="Kotlarski, Heimann and Ortmaier, Frontiers of Mechanical Engineering 7(2), 2012",
    singularities=("type_2",),
    why="The lines of the three rods meet in one point: nothing turns the platform about it.",
)
